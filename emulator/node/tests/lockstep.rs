//! Tests of two different microcontrollers in lock-step. An STM32F429 sends a block over SPI1 by DMA, and the
//! nRF52840's SPIS receives it by EasyDMA. Each core is interrupted at the end. The receiver then answers on a pin,
//! which interrupts the sender by EXTI.

use crate::thumb;

use emulator_node::{Between, Board, Lookahead, Node, Pair, Sent};
use emulator_part::{Pad, Pin, SpiFrame, SpiMode};
use nrf52840::{Nrf52840, Settings, SpisWires};
use stm32f429::{Oscillators, Stm32f429, pin};
use thumb::{COUNTER, EXTI, GPIOA, GPIOD, HANDLER, MAIN, RCC, Thumb, firmware, firmware_at};

const BLOCK: u32 = 0x2000_1000;
const BYTES: u32 = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clocked {
    Select,
    Byte(u8, SpiMode),
    Deselect,
}

#[derive(Clone, Debug, Default)]
struct Sender {
    crossed: Vec<(u64, Clocked)>,
}

const SCK: Pin = pin('A', 5);
const MOSI: Pin = pin('A', 7);
const CS: Pin = pin('D', 14);
const ANSWERED: Pin = pin('A', 3);

impl Board for Sender {
    type Part = Stm32f429;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == CS {
            self.crossed.push((at, if pad.level() { Clocked::Deselect } else { Clocked::Select }));
        }
    }

    fn spi(&mut self, _begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        if frame.sck.contains(&Some(SCK)) && frame.mosi.contains(&Some(MOSI)) && frame.bits == 8 {
            self.crossed.push((ends, Clocked::Byte(u8::try_from(frame.data).unwrap(), frame.mode)));
        }
        Some(0xFF)
    }

    fn outgoing(&self) -> bool {
        !self.crossed.is_empty()
    }
}

#[derive(Clone, Debug, Default)]
struct Receiver {
    level: bool,
    changes: Vec<(u64, bool)>,
}

const SSI: SpisWires =
    SpisWires { sck: Pin::new(1, 1), mosi: Pin::new(1, 2), miso: Pin::new(1, 3), csn: Pin::new(1, 4) };
const ANSWER: Pin = Pin::new(1, 5);

impl Board for Receiver {
    type Part = Nrf52840;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        if pin == ANSWER && pad.level() != self.level {
            self.level = pad.level();
            self.changes.push((at, self.level));
        }
    }

    fn outgoing(&self) -> bool {
        !self.changes.is_empty()
    }
}

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
        for (at, clocked) in node.board_mut(|board| std::mem::take(&mut board.crossed)) {
            to_b.send(at, clocked);
        }
    }

    fn leave_b(&mut self, node: &mut Node<Receiver>, to_a: &mut Sent<bool>) {
        for (at, high) in node.board_mut(|board| std::mem::take(&mut board.changes)) {
            to_a.send(at + BACK, high);
        }
    }

    fn arrive_a(&mut self, at: u64, high: bool, node: &mut Node<Sender>) {
        if high {
            self.answers.push(at);
        }
        node.drive(ANSWERED, Some(high));
    }

    fn arrive_b(&mut self, _at: u64, clocked: Clocked, node: &mut Node<Receiver>) {
        let bytes = &mut self.bytes;
        node.input(|part, view, at| match clocked {
            Clocked::Select => part.spis_select(at, SSI.csn, view),
            Clocked::Deselect => part.spis_deselect(at, SSI.csn, view),
            Clocked::Byte(mosi, mode) => {
                bytes.push(mosi);
                part.spis_clock(at, mosi, mode, view);
            }
        });
    }
}

/// The sender's firmware: SPI1 at 2 MHz with DMA2 stream 3, whose interrupt comes at a block's end. It sends a block
/// whenever the receiver signals that it is ready.
fn sending() -> emulator_node::Firmware {
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
    main.store(GPIOA + 0x20, 5 << 20 | 5 << 28).store(GPIOA, 0xA800_0000 | 2 << 10 | 2 << 14);
    main.store(RCC + 0x44, 1 << 12 | 1 << 14);
    for word in 0..BYTES / 4 {
        main.store(BLOCK + 4 * word, 0x0302_0100 + word * 0x0404_0404);
    }
    main.store(STREAM3 + 0x08, SPI1 + 0x0C).store(STREAM3 + 0x0C, BLOCK);
    main.store(SPI1 + 0x04, 2).store(SPI1, 1 << 9 | 1 << 8 | 1 << 6 | 2 << 3 | 1 << 2).enable(59);
    main.idle();
    // The stream ends when its last byte is in the SPI. CS may rise only with TXE set and BSY clear.
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

/// The receiver's firmware: SPIS1 receives the block. A pulse on P1.05 says that the receiver is ready, first at the
/// start and then after each END.
fn receiving() -> emulator_node::Firmware {
    const SPIS1: u32 = 0x4000_4000;
    const P1: u32 = 0x5000_0300;
    let mut main = Thumb::at(0x400);
    main.store(P1 + 0x518, 1 << 5);
    // P1.01, P1.02 and P1.04 are connected inputs.
    main.store(P1 + 0x704, 0).store(P1 + 0x708, 0).store(P1 + 0x710, 0);
    main.store(SPIS1 + 0x508, 32 + 1).store(SPIS1 + 0x50C, 32 + 3).store(SPIS1 + 0x510, 32 + 2);
    main.store(SPIS1 + 0x514, 32 + 4);
    main.store(SPIS1 + 0x534, BLOCK).store(SPIS1 + 0x538, BYTES);
    main.store(SPIS1 + 0x544, BLOCK + 0x100).store(SPIS1 + 0x548, BYTES);
    main.store(SPIS1 + 0x200, 1 << 2).store(SPIS1 + 0x304, 1 << 1).store(SPIS1 + 0x500, 2).enable(4);
    main.store(SPIS1 + 0x24, 1).wait_for(SPIS1 + 0x128, 0).store(SPIS1 + 0x128, 0).store(SPIS1 + 0x28, 1);
    // The sender's core starts on its slow oscillator. The receiver waits until the sender is in its idle loop.
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
    let sender = Node::new(Stm32f429::new(Oscillators::default()), Sender::default(), &sending()).unwrap();
    let mut receiver = Node::new(Nrf52840::new(Settings::default()), Receiver::default(), &receiving()).unwrap();
    receiver.input(|part, _, _| part.wire_spis(SSI));
    receiver.drive(SSI.csn, Some(true));
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
    // A block is 64 bytes of 4 µs each. Handlers and wire add a few microseconds.
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
