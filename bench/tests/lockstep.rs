//! The two different microcontrollers in lock-step: an STM32F427 sends a block over SPI1 by DMA, the nRF52840's SPIS
//! receives it by EasyDMA, and each core hears of the end by an interrupt: the sender's DMA stream, the receiver's END,
//! and the receiver's answer on a pin, which the sender takes by EXTI.

mod thumb;

use bench::engine::{Between, Lookahead, Node, Pair, Sent, Wiring};
use bench::stm32f427::{Oscillators, PinId, Stm32f427Part};
use nrf52840_model::{Nrf52840, Pin, PinChange, Settings};
use rigless::chip::{Timeline, spi};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;
use thumb::{COUNTER, EXTI, GPIOD, HANDLER, MAIN, RCC, Thumb, firmware, firmware_at};

const BLOCK: u32 = 0x2000_1000;
const BYTES: u32 = 64;

/// The far end of the sender's SPI is a cable: everything that happens on it, with its instant.
#[derive(Debug, Default)]
struct Cable {
    crossed: Vec<(u64, Clocked)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clocked {
    Select,
    Byte(u8),
    Deselect,
}

impl Store for Cable {}

impl spi::Peer for Cable {
    fn transfer(&mut self, mosi: u32, _bits: u8, timeline: &mut Timeline<'_, '_>) -> u32 {
        self.crossed.push((timeline.now().0, Clocked::Byte(u8::try_from(mosi).unwrap())));
        0xFF
    }

    fn select(&mut self, timeline: &mut Timeline<'_, '_>) {
        self.crossed.push((timeline.now().0, Clocked::Select));
    }

    fn deselect(&mut self, timeline: &mut Timeline<'_, '_>) {
        self.crossed.push((timeline.now().0, Clocked::Deselect));
    }
}

#[derive(Debug)]
struct Sender {
    part: Stm32f427Part,
}

const CS: PinId = PinId::new('D', 14);
const ANSWERED: PinId = PinId::new('A', 3);

impl Sender {
    fn new() -> Self {
        let mut part = Stm32f427Part::new(Oscillators::default());
        part.attach_spi(1, Cable::default(), CS);
        part.drive_pin(0, ANSWERED, false);
        Self { part }
    }

    fn cable(&self) -> Option<&Cable> {
        let chip: &dyn std::any::Any = self.part.mcu().spi[0].peer()?;
        chip.downcast_ref()
    }
}

impl Wiring for Sender {
    type Part = Stm32f427Part;

    fn part(&self) -> &Stm32f427Part {
        &self.part
    }

    fn part_mut(&mut self) -> &mut Stm32f427Part {
        &mut self.part
    }

    fn outgoing(&self) -> bool {
        self.cable().is_some_and(|cable| !cable.crossed.is_empty())
    }
}

#[derive(Debug)]
struct Receiver {
    part: Nrf52840,
    changes: Vec<PinChange>,
}

const CSN: Pin = Pin::p1(4);
const ANSWER: Pin = Pin::p1(5);

impl Receiver {
    fn new() -> Self {
        let mut part = Nrf52840::new(Settings::default());
        part.drive_pin(VirtualNanos(0), CSN, true);
        Self { part, changes: Vec::new() }
    }
}

impl Wiring for Receiver {
    type Part = Nrf52840;

    fn part(&self) -> &Nrf52840 {
        &self.part
    }

    fn part_mut(&mut self) -> &mut Nrf52840 {
        &mut self.part
    }

    fn settle(&mut self, _at: u64) -> bool {
        self.changes.extend(self.part.take_pin_changes().into_iter().filter(|change| change.pin == ANSWER));
        false
    }

    fn outgoing(&self) -> bool {
        !self.changes.is_empty()
    }
}

/// The wire's delay back to the sender, in ns.
const BACK: u64 = 1_000;

#[derive(Debug, Default)]
struct Wires {
    bytes: Vec<u8>,
    answers: Vec<u64>,
}

impl Between<Sender, Receiver> for Wires {
    type ToA = bool;
    type ToB = Clocked;

    fn lookahead(&self) -> Lookahead {
        Lookahead { a_to_b: 0, b_to_a: BACK }
    }

    fn leave_a(&mut self, node: &mut Node<Sender>, to_b: &mut Sent<Clocked>) {
        let cable = node.board_mut().part.spi_chip::<Cable>(1, 0).unwrap();
        for (at, clocked) in cable.crossed.drain(..) {
            to_b.send(at, clocked);
        }
    }

    fn leave_b(&mut self, node: &mut Node<Receiver>, to_a: &mut Sent<bool>) {
        for change in node.board_mut().changes.drain(..) {
            to_a.send(change.at + BACK, change.level);
        }
    }

    fn arrive_a(&mut self, at: u64, high: bool, node: &mut Node<Sender>) {
        if high {
            self.answers.push(at);
        }
        node.input(|board, at| board.part.drive_pin(at, ANSWERED, high));
    }

    fn arrive_b(&mut self, _at: u64, clocked: Clocked, node: &mut Node<Receiver>) {
        let bytes = &mut self.bytes;
        node.input(|board, at| match clocked {
            Clocked::Select => board.part.ssi_select(VirtualNanos(at), CSN),
            Clocked::Deselect => board.part.ssi_deselect(VirtualNanos(at), CSN),
            Clocked::Byte(mosi) => {
                bytes.push(mosi);
                board.part.ssi_clock(VirtualNanos(at), mosi);
            }
        });
    }
}

/// SPI1 at 2 MHz from the 16 MHz internal oscillator, transmitted by DMA2 stream 3, its end in that stream's interrupt.
/// A block goes out whenever the receiver says that it is ready.
fn sending() -> bench::engine::Firmware {
    const DMA2: u32 = 0x4002_6400;
    const STREAM3: u32 = DMA2 + 0x10 + 0x18 * 3;
    const SPI1: u32 = 0x4001_3000;
    let start = |code: &mut Thumb| {
        code.store(GPIOD + 0x18, 1 << 30);
        code.store(DMA2 + 0x08, 0x3D << 22).store(STREAM3 + 0x04, BYTES);
        code.store(STREAM3, 3 << 25 | 1 << 10 | 1 << 6 | 1 << 4 | 1);
    };
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x44, 1 << 12 | 1 << 14).exti3_on_pa3();
    main.store(RCC + 0x30, 1 | 1 << 3 | 1 << 22).store(GPIOD + 0x18, 1 << 14).store(GPIOD, 1 << 28);
    main.store(RCC + 0x44, 1 << 12 | 1 << 14);
    for word in 0..BYTES / 4 {
        main.store(BLOCK + 4 * word, 0x0302_0100 + word * 0x0404_0404);
    }
    main.store(STREAM3 + 0x08, SPI1 + 0x0C).store(STREAM3 + 0x0C, BLOCK);
    main.store(SPI1 + 0x04, 2).store(SPI1, 1 << 9 | 1 << 8 | 1 << 6 | 2 << 3 | 1 << 2).enable(59);
    main.idle();
    // The stream is done when its last byte is in the SPI: wait for TXE and not BSY before CS rises.
    let mut done = Thumb::at(HANDLER);
    done.store(DMA2 + 0x08, 0x3D << 22).wait_for(SPI1 + 0x08, 1);
    let again = done.here();
    done.mov(0, SPI1 + 0x08).ldr(1, 0, 0).test(1, 7).branch_if(thumb::If::CarrySet, again);
    done.store(GPIOD + 0x18, 1 << 14).ret();
    let mut answered = Thumb::at(HANDLER + 0x200);
    answered.store(EXTI + 0x14, 1 << 3).count(COUNTER);
    start(&mut answered);
    answered.ret();
    firmware("sending", &main, &[(59, &done), (9, &answered)])
}

/// SPIS1 into the block; a pulse on P1.05 says that it is ready, at first and after each END.
fn receiving() -> bench::engine::Firmware {
    const SPIS1: u32 = 0x4000_4000;
    const P1: u32 = 0x5000_0300;
    let mut main = Thumb::at(0x400);
    main.store(P1 + 0x518, 1 << 5);
    main.store(SPIS1 + 0x508, 32 + 1).store(SPIS1 + 0x50C, 32 + 3).store(SPIS1 + 0x510, 32 + 2);
    main.store(SPIS1 + 0x514, 32 + 4);
    main.store(SPIS1 + 0x534, BLOCK).store(SPIS1 + 0x538, BYTES);
    main.store(SPIS1 + 0x544, BLOCK + 0x100).store(SPIS1 + 0x548, BYTES);
    main.store(SPIS1 + 0x200, 1 << 2).store(SPIS1 + 0x304, 1 << 1).store(SPIS1 + 0x500, 2).enable(4);
    main.store(SPIS1 + 0x24, 1).wait_for(SPIS1 + 0x128, 0).store(SPIS1 + 0x128, 0).store(SPIS1 + 0x28, 1);
    // The sender's core starts on its slow oscillator: let it come to its idle loop first.
    main.mov(0, 4_000);
    let again = main.here();
    main.raw(&[0x3801]).branch_if(thumb::If::NotEqual, again);
    main.store(P1 + 0x508, 1 << 5).store(P1 + 0x50C, 1 << 5).idle();
    let mut end = Thumb::at(0x800);
    end.store(SPIS1 + 0x104, 0).count(COUNTER);
    end.wait_for(SPIS1 + 0x128, 0).store(SPIS1 + 0x128, 0).store(SPIS1 + 0x28, 1);
    end.store(P1 + 0x508, 1 << 5).store(P1 + 0x50C, 1 << 5).ret();
    firmware_at(0, "receiving", &main, &[(4, &end)])
}

fn after(end: u64) -> (Pair<Sender, Receiver, Wires>, [u64; 2]) {
    let sender = Node::new(Sender::new(), &sending()).unwrap();
    let receiver = Node::new(Receiver::new(), &receiving()).unwrap();
    let mut pair = Pair::new(sender, receiver, Wires::default());
    pair.run_until(end);
    assert_eq!(pair.a.take_findings(), []);
    assert_eq!(pair.b.take_findings(), []);
    let digests = [pair.a.digest(), pair.b.digest()];
    (pair, digests)
}

#[test]
fn two_parts_exchange_a_block_by_dma_and_interrupts() {
    let (mut pair, _) = after(5_000_000);
    let mut block = [0; BYTES as usize];
    pair.b.read(u64::from(BLOCK), &mut block).unwrap();
    let sent: Vec<u8> = (0..64).collect();
    assert_eq!(block.as_slice(), sent);
    let answered = pair.a.word(u64::from(COUNTER)).unwrap();
    let received = pair.b.word(u64::from(COUNTER)).unwrap();
    // A block is 64 bytes of 4 us; the two handlers and the wire add a few microseconds.
    assert!((15..=20).contains(&answered), "{answered} answers");
    assert!(received + 1 == answered || received == answered, "{received} blocks for {answered} answers");
    assert!(pair.between.bytes.starts_with(&sent));
    let periods: Vec<u64> = pair.between.answers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let (least, most) = (periods.iter().min().unwrap(), periods.iter().max().unwrap());
    assert!(most - least <= 50, "a block takes {least} to {most} ns");
    assert!(*least > 64 * 4_000);
}

#[test]
fn two_parts_do_the_same_every_time() {
    let (_, first) = after(3_000_000);
    let (_, second) = after(3_000_000);
    assert_eq!(first, second);
}
