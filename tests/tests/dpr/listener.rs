//! Measures the time of `st25r3916::Listener::step` for a whole frame, with the calls that the executor makes.

use core::hint::black_box;

use on_target_tests::{
    chip::{Chip, Status},
    cycles::{bounds, Cycles, Taken},
};
use st25r3916::{Input, Listener, ListenerConfig, ListenerEvent, Step, Transfer};

use super::frames::{Case, SIZE};

/// The number of bytes in a frame: LEN, payload and CRC-16.
const FRAME: usize = SIZE + 3;
/// The bits I_rxs and I_rxe of the main interrupts: sync detected, and end of a frame.
const RXS: u8 = 0x20;
const RXE: u8 = 0x10;
/// The bits of the register FIFO status 2 that report an incomplete last byte (fifo_lb) or its missing parity (np_lb).
const FIFO_LAST_BITS: u8 = 0x0F;
/// The number of steps from the sync of a frame until the receiver is ready for the next one: five waits with a status
/// read after each, four reads of the FIFO, the event, three transfers that make the receiver ready, and one that reads
/// a setting back.
const STEPS: usize = 19;

/// The flags that the chip reports for a frame in addition to the frame's bytes.
#[derive(Clone, Copy)]
struct Flags {
    error: u8,
    fifo: u8,
}

const CLEAN: Flags = Flags { error: 0, fifo: 0 };
/// The results of the waits for a frame that is read while it arrives. Each has the main interrupts that end the wait
/// (0 if its time is over), and the number of bytes in the FIFO then.
const WHILE_FILLING: [(u8, u8); 5] = [(RXS, 0), (0, 17), (0, 201), (0, 26), (RXE, 5)];
/// The results of the waits, as in [`WHILE_FILLING`], for a frame with a wrong LEN. The frame ends before its bytes are
/// read.
const AT_THE_END: [(u8, u8); 3] = [(RXS, 0), (0, 17), (RXE, 231)];

/// Makes one step of the listener. The function is not inlined, so that every call runs the same copy of the state
/// machine.
#[inline(never)]
fn step(listener: &mut Listener, input: Input<'_>) -> Step<ListenerEvent> {
    listener.step(input)
}

fn listening(chip: &mut Chip) -> Listener {
    let mut listener = Listener::new(ListenerConfig::new());
    let mut next = listener.step(Input::Start);
    for _ in 0..200 {
        next = match next {
            Step::Transfer(Transfer::Short(short)) => {
                let response = chip.respond(short.bytes());
                listener.step(Input::Done(&response[..short.bytes().len()]))
            }
            Step::Wait { .. } => listener.step(Input::Irq),
            Step::Delay { .. } => listener.step(Input::Timeout),
            Step::Event(ListenerEvent::Listening) => {
                let waits = listener.step(Input::Start);
                defmt::assert!(matches!(waits, Step::Wait { .. }));
                return listener;
            }
            _ => defmt::panic!("the listener does not come up: {}", next),
        };
    }
    defmt::panic!("the listener does not come up")
}

/// Receives one frame and records the time of step number `n` in element `n` of `taken`. Returns the number of steps.
fn frame(
    cycles: &Cycles,
    chip: &mut Chip,
    before: &Listener,
    bytes: &[u8; FRAME],
    flags: Flags,
    waits: &[(u8, u8)],
    taken: &mut [Taken; STEPS],
) -> usize {
    let mut listener = before.clone();
    let mut waits = waits.iter();
    let mut arm = |chip: &mut Chip| {
        // After the listed waits the receiver is made ready again. No further interrupt has come then, and the CRC-16
        // is still in the FIFO.
        let &(main, count) = waits.next().unwrap_or(&(0, 2));
        let Flags { error, fifo } = if main == RXS || (main, count) == (0, 2) { CLEAN } else { flags };
        chip.set_status(Status { main, error, count, fifo });
        main
    };
    let mut next = Step::Wait { us: 0 };
    let mut steps = 0;
    let mut delivered = false;
    let mut response;
    for taken in taken {
        let input = match next {
            Step::Wait { .. } if delivered => break,
            Step::Wait { .. } => {
                if arm(chip) == 0 {
                    Input::Timeout
                } else {
                    Input::Irq
                }
            }
            Step::Transfer(Transfer::Short(short)) => {
                response = chip.respond(short.bytes());
                Input::Done(&response[..short.bytes().len()])
            }
            Step::Transfer(Transfer::Read { offset, len }) => Input::Done(&bytes[offset..offset + len]),
            Step::Event(ListenerEvent::Frame { len, .. }) => {
                // A last byte that broke off does not count as part of the frame.
                defmt::assert_eq!(len, SIZE - usize::from(flags.fifo & FIFO_LAST_BITS != 0));
                delivered = true;
                arm(chip);
                Input::Start
            }
            _ => defmt::panic!("not a step of a frame: {}", next),
        };
        let (took, then) = cycles.timed(|| step(black_box(&mut listener), black_box(input)));
        taken.note(took);
        next = then;
        steps += 1;
    }
    defmt::assert!(delivered);
    steps
}

/// Times every step of the listener for frames with different bytes and flags. Then does so for frames with a wrong
/// LEN, whose FIFO is read at other instants.
pub(crate) fn steps(cycles: &Cycles) {
    let mut chip = Chip::new();
    let before = listening(&mut chip);
    let mut taken = [Taken::NONE; STEPS];
    let mut bytes = [0; FRAME];
    for case in [Case::Good, Case::EveryObject, Case::Zeros, Case::Ones] {
        bytes[0] = SIZE as u8 + 1;
        bytes[1..=SIZE].copy_from_slice(&case.payload(10));
        for flags in [CLEAN, Flags { error: 0x80, fifo: 0 }, Flags { error: 0xF0, fifo: 0x3F }] {
            defmt::assert_eq!(frame(cycles, &mut chip, &before, &bytes, flags, &WHILE_FILLING, &mut taken), STEPS);
        }
    }
    let mut worst = Taken::NONE;
    let mut spread = 0;
    for taken in taken {
        worst.note(taken.max);
        worst.note(taken.min);
        spread = spread.max(taken.spread());
    }
    // Different steps take different times. No step's time may depend on the frame's contents.
    worst.assert("Listener::step, any step of a frame", bounds(340, 370, 500, u32::MAX));
    Taken { min: 1_000, max: 1_000 + spread }
        .assert("Listener::step, spread of one step", bounds(1_016, 1_016, 1_016, 16));

    let mut wrong = [Taken::NONE; STEPS];
    for len in [0, 1, 3, 40, 255] {
        bytes[0] = len;
        frame(cycles, &mut chip, &before, &bytes, CLEAN, &AT_THE_END, &mut wrong);
    }
    for taken in wrong.iter().filter(|taken| taken.max > 0) {
        worst.note(taken.max);
    }
    worst.assert("Listener::step, LEN damaged", bounds(340, 370, 500, u32::MAX));
}
