//! Driver for ST's ST25R3916 and ST25R3916B NFC front ends: NFC-F at 424 kbit/s, poller and listener,
//! one way.
//!
//! A [`Poller`] keeps its field on and sends frames of 1 to 254 bytes; it never listens. A [`Listener`]
//! receives them; it never answers, and its driver registers are set so that it could not. There is no
//! activation, no acknowledgement and no retry: what is lost is lost, and both ends get back to work by
//! themselves.
//!
//! # Machines and executors
//!
//! Neither machine touches a bus. Each is a value with one method, `step`, which takes what just
//! happened ([`Input`]) and gives what to do next ([`Step`]): make one SPI transfer, wait for the IRQ
//! pin with a bound, or tell the caller something. Whoever carries the steps out is the executor: an
//! interrupt handler that starts a DMA transfer and comes back at its end, or the loop in
//! [`blocking`]. The logic is the same and is tested without hardware.
//!
//! | step | the executor | then gives |
//! |---|---|---|
//! | [`Step::Transfer`] | makes one transfer, chip select low throughout | [`Input::Done`] with what came in, or [`Input::Failed`] |
//! | [`Step::Wait`] | looks at the IRQ pin's level, and at a timer | [`Input::Irq`] or [`Input::Timeout`] |
//! | [`Step::Delay`] | looks at a timer alone | [`Input::Timeout`] |
//! | [`Step::Event`] | hands it to the caller, who may swap buffers now and only now | [`Input::Start`] |
//!
//! Three promises hold for every machine, in every state, whatever it is given:
//!
//! - a call returns one step after a small bounded number of instructions, the same whatever the payload says;
//! - every wait has a bound, and every failure becomes an event with a [`Fault`] or a [`Dropped`];
//! - with a working chip and an executor that answers the step outstanding, it comes back to
//!   [`PollerEvent::Ready`] or [`ListenerEvent::Listening`] by itself.
//!
//! The IRQ pin is a level: high while an unmasked interrupt is set, low once the interrupt registers are
//! read. Executors on an edge-triggered input look at the level when a [`Step::Wait`] begins.
//!
//! # Bring-up and one frame, call by call
//!
//! ```
//! use st25r3916::{Input, Listener, ListenerConfig, ListenerEvent, Poller, PollerConfig, PollerEvent};
//! use st25r3916::{FrameFlags, Fault, ReadMode, Step, Transfer, Variant};
//!
//! /// The bytes of the short transfer a step asks for.
//! fn mosi<E>(step: Step<E>) -> Vec<u8> {
//!     match step {
//!         Step::Transfer(Transfer::Short(short)) => short.bytes().to_vec(),
//!         _ => panic!("not a short transfer"),
//!     }
//! }
//!
//! // The poller.
//! let mut poller = Poller::new(PollerConfig::new());
//! assert_eq!(mosi(poller.step(Input::Start)), [0xC1]); // set default
//! assert_eq!(mosi(poller.step(Input::Done(&[0]))), [0x00, 0x07, 0x1C]); // IO
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x7F, 0x00]); // identity?
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x31]))), [0x5A, 0, 0, 0, 0]); // a 3916B; stale interrupts
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 5]))), [0x02, 0x80]); // oscillator on
//! assert_eq!(poller.step(Input::Done(&[0; 2])), Step::Wait { micros: 10_000 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x5A, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x80, 0, 0, 0]))), [0xEA]); // I_osc; RC calibration
//! assert_eq!(mosi(poller.step(Input::Done(&[0]))), [0xD6]); // adjust regulators
//! assert_eq!(poller.step(Input::Done(&[0])), Step::Wait { micros: 6_000 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x5A, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x03, 0x1C, 0x22]); // I_dct; NFC-F, 424
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x07, 0x00]); // preamble 48 bits
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x0A, 0x00]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x10, 0x00, 0x00]); // no-response timer off
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x28, 0x40]); // 12 % AM
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x16, 0x77, 0x7F, 0xFF, 0xFB]); // masks
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 5]))), [0x02, 0x88]); // field on, receiver off
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x42, 0, 0, 0]); // as written?
//! assert_eq!(poller.step(Input::Done(&[0, 0x88, 0x1C, 0x22])), Step::Event(PollerEvent::Ready));
//! assert_eq!(poller.variant(), Some(Variant::B));
//!
//! let step = poller.send(244).expect("it is ready and 244 ≤ 254");
//! assert_eq!(mosi(step), [0xDB]); // clear FIFO
//! assert_eq!(mosi(poller.step(Input::Done(&[0]))), [0x22, 0x07, 0xA0]); // length
//! let load = Transfer::Load { offset: 0, len: 244 }; // 80 and the payload
//! assert_eq!(poller.step(Input::Done(&[0; 3])), Step::Transfer(load));
//! assert_eq!(mosi(poller.step(Input::Done(&[]))), [0x59, 0, 0, 0, 0, 0, 0, 0]); // all there?
//! assert_eq!(poller.step(Input::Done(&[0, 0xFB, 0, 0, 0, 0, 244, 0])), Step::Event(PollerEvent::Loaded));
//! // At its own instant the executor sends this one byte:
//! assert_eq!(Poller::transmit().bytes(), [0xC4]);
//! assert_eq!(poller.step(Input::Done(&[0])), Step::Wait { micros: 4_815 + 500 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x59, 0, 0, 0, 0, 0, 0, 0]);
//! assert_eq!(poller.step(Input::Done(&[0, 0xFB, 0x08, 0, 0, 0, 0, 0])), Step::Event(PollerEvent::Sent)); // I_txe
//! assert_eq!(mosi(poller.step(Input::Start)), [0x42, 0, 0, 0]); // still configured?
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x88, 0x1C, 0x22]))), [0x71, 0]); // field still on?
//! assert_eq!(poller.step(Input::Done(&[0, 0x30])), Step::Event(PollerEvent::Ready));
//!
//! // The listener, from its regulators on (what is before is the same; this one is a 3916).
//! let config = ListenerConfig { read_mode: ReadMode::StoreAndForward, ..ListenerConfig::new() };
//! let mut listener = Listener::new(config);
//! let _ = listener.step(Input::Start);
//! let _ = listener.step(Input::Done(&[0]));
//! let _ = listener.step(Input::Done(&[0; 3]));
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0x2A]))), [0xFC, 0x04, 0x10]); // overheat protection
//! let _ = listener.step(Input::Done(&[0; 3]));
//! let _ = listener.step(Input::Done(&[0; 5]));
//! let _ = listener.step(Input::Done(&[0; 2]));
//! let _ = listener.step(Input::Irq);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0x80, 0, 0, 0]))), [0xD6]);
//! let _ = listener.step(Input::Done(&[0]));
//! let _ = listener.step(Input::Irq);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x08, 0x5D]); // no automatic answer
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0x29, 0xFF]); // no load modulation:
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0xFB, 0x28, 0x00]); // no driver for it
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0x26, 0x00, 0xFF]); // antenna tuning
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0x0F, 0x02]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0x16, 0xCF, 0xE7, 0x0F, 0xFB]); // masks
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 5]))), [0x03, 0xA0, 0x22]); // target, NFC-F, 424
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0x02, 0xC3]); // receiver, field detector
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0xDB]); // clear FIFO
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0xD1]); // unmask receive data
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0x42, 0, 0, 0]);
//! assert_eq!(listener.step(Input::Done(&[0, 0xC3, 0xA0, 0x22])), Step::Event(ListenerEvent::Listening));
//!
//! let mut buffer = [0; st25r3916::listener::BUFFER];
//! assert_eq!(listener.step(Input::Start), Step::Wait { micros: 20_000 });
//! assert_eq!(mosi(listener.step(Input::Irq)), [0x59, 0, 0, 0, 0, 0, 0, 0]);
//! assert_eq!(listener.step(Input::Done(&[0, 0xFB, 0x20, 0, 0, 0, 0, 0])), Step::Wait { micros: 6_000 }); // I_rxs
//! assert_eq!(mosi(listener.step(Input::Irq)), [0x59, 0, 0, 0, 0, 0, 0, 0]);
//! let read = Transfer::Read { offset: 0, len: 247 }; // 9F, then into the buffer
//! assert_eq!(listener.step(Input::Done(&[0, 0xFB, 0x10, 0, 0, 0, 247, 0])), Step::Transfer(read)); // I_rxe
//! buffer[0] = 245; // what the transfer brought: LEN, payload, CRC-16
//! let frame = ListenerEvent::Frame { len: 244, flags: FrameFlags::empty() };
//! assert_eq!(listener.step(Input::Done(&buffer[..247])), Step::Event(frame));
//! // The payload, buffer[1..245], is the caller's; with `Start` the receiver is armed again.
//! assert_eq!(mosi(listener.step(Input::Start)), [0x59, 0, 0, 0, 0, 0, 0, 0]); // none begun meanwhile?
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0xFB, 0, 0, 0, 0, 0, 0]))), [0xDB]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0xD1]);
//! assert_eq!(listener.step(Input::Done(&[0])), Step::Wait { micros: 20_000 });
//!
//! // A chip that lost its supply answers with its masks at their reset value.
//! let _ = listener.step(Input::Timeout);
//! let lost = ListenerEvent::Fault(Fault::Reset);
//! assert_eq!(listener.step(Input::Done(&[0; 8])), Step::Event(lost));
//! assert_eq!(listener.step(Input::Start), Step::Delay { micros: 1_000 }); // then bring-up, as above
//! assert_eq!(mosi(listener.step(Input::Timeout)), [0xC1]);
//! ```
//!
//! # Features
//!
//! `defmt`: `defmt::Format` for every public type that an event can carry.
//!
//! # Sources
//!
//! "DS13541" is ST's data sheet of the ST25R3916B. Where the ST25R3916 differs (identity, overheat
//! protection, antenna tuning, the coding of the AM depth) the driver reads which part it has and
//! adapts. What no data sheet settles is in the README's table of known trouble.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod blocking;
mod bring_up;
pub mod command;
pub mod listener;
mod machine;
pub mod poller;
pub mod register;
mod status;

pub use listener::{Dropped, FrameFlags, Listener, ListenerConfig, ListenerCounters, ListenerEvent, ReadMode};
pub use machine::{Fault, Input, Short, Step, Transfer};
pub use poller::{Poller, PollerConfig, PollerCounters, PollerEvent, Receiver, SendError};

/// The longest wait for a stable oscillator, in microseconds (typically 0.7 ms).
pub const OSCILLATOR_MICROS: u32 = 10_000;
/// The longest wait for the regulator adjustment, in microseconds (at most 5 ms in the data
/// sheet).
pub const REGULATOR_MICROS: u32 = 6_000;
/// The longest time from a frame's sync (I_rxs) to its end (I_rxe), in microseconds: 257 bytes
/// take 4.852 ms.
pub const FRAME_MICROS: u32 = 6_000;

/// Which part answered, from its identity register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Variant {
    /// ST25R3916.
    A,
    /// ST25R3916B.
    B,
}

/// The chip's supply voltage (VDD).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Supply {
    /// 4.1 V to 5.5 V.
    #[default]
    Volts5,
    /// 2.4 V to 3.6 V: sets `sup3V`.
    Volts3,
}

/// The air time of a frame at 424 kbit/s, first preamble bit to last CRC bit, in nanoseconds,
/// rounded up.
///
/// 48 bits of preamble, 16 of sync, then LEN, `payload` bytes and CRC-16; a bit is 32 carrier
/// periods of 13.56 MHz. 244 bytes: 4.814 ms; 254 bytes: 5.003 ms.
#[must_use]
pub const fn air_time_ns(payload: usize) -> u64 {
    let bits = 64 + 8 * (payload as u64 + 3);
    (bits * 32 * 100_000).div_ceil(1_356)
}

/// [`air_time_ns`] in microseconds, rounded up, without 64-bit arithmetic (a library call on a
/// Cortex-M4).
const fn air_time_micros(payload: u8) -> u32 {
    let bits = 64 + 8 * (payload as u32 + 3);
    (bits * 3_200).div_ceil(1_356)
}

/// The README's example is a test as well.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_times_are_those_of_the_bit_rate() {
        assert_eq!(air_time_ns(244), 4_814_160);
        assert_eq!(air_time_ns(254), 5_002_950);
        for payload in 0..=255_u8 {
            assert_eq!(u64::from(air_time_micros(payload)), air_time_ns(usize::from(payload)).div_ceil(1_000));
        }
    }

    #[test]
    fn the_machines_are_small() {
        assert!(size_of::<Poller>() <= 40, "{}", size_of::<Poller>());
        assert!(size_of::<Listener>() <= 104, "{}", size_of::<Listener>());
        assert!(size_of::<Step<ListenerEvent>>() <= 24);
    }
}
