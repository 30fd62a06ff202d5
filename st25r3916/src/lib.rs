//! Driver for ST's NFC front ends ST25R3916 and ST25R3916B: NFC-F at 424 kbit/s, poller and listener.
//!
//! A [`Poller`] keeps its field on and sends frames of 1 to 254 bytes; it never listens. A [`Listener`] receives these
//! frames. It never answers, and its registers are set so that it cannot. There is no activation, no acknowledgement
//! and no retry: a lost frame stays lost, and both ends recover by themselves.
//!
//! Where data have to come back, an [`Exchange`] replaces the poller and an [`Answerer`] the listener: each frame gets
//! at most one answer, within a fixed window.
//!
//! # Simple use
//!
//! The module [`blocking`] runs a machine on `embedded-hal` traits, one call at a time:
//!
//! ```no_run
//! # use embedded_hal::{delay::DelayNs, digital::InputPin, spi::SpiDevice};
//! # use st25r3916::blocking::Error;
//! use st25r3916::{ListenerConfig, ListenerEvent, PollerConfig, blocking};
//!
//! // One board has SPI mode 1 at 10 MHz at most, the chip's IRQ pin and a delay.
//! # type Done<S, P> = Result<(), Error<S, P>>;
//! # fn poller<S: SpiDevice, P: InputPin, D: DelayNs>(spi: S, irq: P, delay: D) -> Done<S::Error, P::Error> {
//! let mut poller = blocking::Poller::new(spi, irq, delay, PollerConfig::new());
//! poller.send(b"up to 254 bytes")?;
//! # Ok(())
//! # }
//!
//! // The other board.
//! # fn listener<S: SpiDevice, P: InputPin, D: DelayNs>(spi: S, irq: P, delay: D) -> Done<S::Error, P::Error> {
//! let mut listener = blocking::Listener::new(spi, irq, delay, ListenerConfig::new());
//! if let Some(ListenerEvent::Frame { len, flags }) = listener.next(20_000)? {
//!     let payload = listener.payload(len);
//! #   let _ = (payload, flags);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Machines and executors
//!
//! A machine is a value with one method, `step`, which takes the last event ([`Input`]) and returns the next action
//! ([`Step`]): make one SPI transfer, wait for the IRQ pin with a time limit, or report an event to the caller. An
//! executor carries the steps out. The module [`executor`] has an executor that uses the hardware through an
//! [`executor::Port`]. Interrupts and DMA implement this port, and [`blocking`] implements it by polling. So the logic
//! is the same for both, and it is tested without hardware.
//!
//! | step | the executor | the next input |
//! |---|---|---|
//! | [`Step::Transfer`] | makes one transfer, chip select low throughout | [`Input::Done`] or [`Input::Failed`] |
//! | [`Step::Wait`] | reads the IRQ pin's level, and a timer | [`Input::Irq`] or [`Input::Timeout`] |
//! | [`Step::Delay`] | reads only a timer | [`Input::Timeout`] |
//! | [`Step::Event`] | passes it to the caller, who may swap buffers only now | [`Input::Start`] |
//!
//! Three guarantees hold for every machine, in every state and for every input:
//!
//! - a call returns one step after a small bounded number of instructions, which does not depend on the payload;
//! - every wait has a time limit, and every failure becomes an event with a [`Fault`] or a [`Dropped`];
//! - with a working chip and an executor that answers the outstanding step, the machine returns to
//!   [`PollerEvent::Ready`] or [`ListenerEvent::Listening`] by itself.
//!
//! The IRQ pin is a level: high while an unmasked interrupt is set, low once the interrupt registers are read. An
//! executor on an edge-triggered input reads the level when a [`Step::Wait`] begins.
//!
//! The states of each machine, with a diagram, are in [`poller`], [`listener`], [`exchange`] and [`answerer`].
//!
//! # An exchange, on both sides
//!
//! The owner of an [`executor::Executor`] handles one event after another. It sends the transmit command itself, at an
//! instant that it chooses, and then gives [`Input::Done`].
//!
//! ```
//! use st25r3916::{Answerer, AnswererEvent, Exchange, ExchangeEvent, Input, Step};
//!
//! /// The poller's side: what to do after an event.
//! fn hold(exchange: &mut Exchange, event: ExchangeEvent) -> Option<Step<ExchangeEvent>> {
//!     match event {
//!         ExchangeEvent::Ready => exchange.prepare(64).ok(), // once a cycle
//!         ExchangeEvent::Loaded => None, // send Exchange::transmit(), then step(Input::Done(&[0]))
//!         ExchangeEvent::Answer { .. } => Some(exchange.step(Input::Start)), // buffer[1..1 + len], then on
//!         ExchangeEvent::Prepared | ExchangeEvent::NoAnswer(_) | ExchangeEvent::Fault(_) => {
//!             Some(exchange.step(Input::Start))
//!         }
//!     }
//! }
//!
//! /// The side that listens and answers, which the link from HORUS to the DPR does not use.
//! fn port(answerer: &mut Answerer, event: AnswererEvent) -> Option<Step<AnswererEvent>> {
//!     match event {
//!         AnswererEvent::Frame { .. } => answerer.answer(128).ok(), // buffer[1..1 + len] is the frame
//!         AnswererEvent::Loaded => None, // send Answerer::transmit() at a fixed time after I_rxe, then Done
//!         _ => Some(answerer.step(Input::Start)),
//!     }
//! }
//! # let _ = (hold, port);
//! ```
//!
//! # Bring-up and one frame, call by call
//!
//! ```
//! use st25r3916::{Input, Listener, ListenerConfig, ListenerEvent, Poller, PollerConfig, PollerEvent};
//! use st25r3916::{FrameFlags, Fault, ListenerState, PollerState, ReadMode, Step, Transfer, Variant};
//!
//! /// The bytes of the short transfer that a step requests.
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
//! assert_eq!(mosi(poller.step(Input::Done(&[0]))), [0x00, 0x07, 0x3C]); // IO
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x7F, 0x00]); // identity?
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x31]))), [0x5A, 0, 0, 0, 0]); // a 3916B; stale interrupts
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 5]))), [0x02, 0x80]); // oscillator on
//! assert_eq!(poller.step(Input::Done(&[0; 2])), Step::Wait { us: 10_000 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x5A, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x80, 0, 0, 0]))), [0xEA]); // I_osc; RC calibration
//! assert_eq!(poller.step(Input::Done(&[0])), Step::Wait { us: 6_000 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x5A, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x2C, 0x80]); // I_dct; reg_s set
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x2C, 0x00]); // and cleared; VDD is measured
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0xDF]); // measure the supply
//! assert_eq!(poller.step(Input::Done(&[0])), Step::Wait { us: 1_000 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x5A, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x65, 0]); // I_dct; how much?
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 214]))), [0x00, 0x07, 0x3C]); // 214 · 23.4 mV: not sup3V
//! assert_eq!(poller.supply_mv(), Some(5_008));
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0xD6]); // adjust regulators
//! assert_eq!(poller.step(Input::Done(&[0])), Step::Wait { us: 6_000 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x5A, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x03, 0x1C, 0x22]); // I_dct; NFC-F, 424
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x07, 0x00]); // preamble 48 bits
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x0A, 0x00, 0x13, 0x2D, 0x00, 0x00, 0x02]); // receiver
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 7]))), [0xFB, 0x0C, 0x54, 0x00]); // correlator
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 4]))), [0x10, 0x00, 0x00]); // no-response timer off
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x26, 0xC5, 0xE3]); // antenna tuning
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x28, 0x40]); // 12 % AM
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0xFB, 0x28, 0x84]); // by active wave shaping
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0xFB, 0x2A, 0x80]); // drivers' non-overlap
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0xFB, 0x2E, 0x09, 0x28]); // the shape
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 4]))), [0xFB, 0x34, 0x01, 0x00, 0x79, 0x07]); // and its times
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 6]))), [0x16, 0x77, 0x7F, 0xFF, 0xFB]); // masks
//! // Every register that was written is read back before the field goes on.
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 5]))), [0x40, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x07, 0x3C]))), [0x6C, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x00]))), [0x43, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x1C, 0x22]))), [0x47, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x00]))), [0x4A, 0, 0, 0, 0, 0, 0]);
//! let receiver = [0, 0x00, 0x13, 0x2D, 0x00, 0x00, 0x02];
//! assert_eq!(mosi(poller.step(Input::Done(&receiver))), [0xFB, 0x4C, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x54, 0x00]))), [0x50, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x66, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0xC5, 0xE3]))), [0x68, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x40]))), [0xFB, 0x68, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x84]))), [0xFB, 0x6A, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x80]))), [0xFB, 0x6E, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x09, 0x28]))), [0xFB, 0x74, 0, 0, 0, 0]);
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0, 0x01, 0x00, 0x79, 0x07]))), [0x56, 0, 0, 0, 0]);
//! let masks = [0, 0x77, 0x7F, 0xFF, 0xFB];
//! assert_eq!(mosi(poller.step(Input::Done(&masks))), [0x02, 0x88]); // field on, receiver off
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 2]))), [0x42, 0, 0, 0]); // as written?
//! assert_eq!(poller.step(Input::Done(&[0, 0x88, 0x1C, 0x22])), Step::Event(PollerEvent::Ready));
//! assert_eq!(poller.variant(), Some(Variant::B));
//! assert_eq!(poller.state(), PollerState::Ready);
//!
//! let step = poller.prepare(244).expect("it is ready and 244 ≤ 254");
//! assert_eq!(mosi(step), [0xDB]); // clear FIFO
//! assert_eq!(mosi(poller.step(Input::Done(&[0]))), [0x22, 0x07, 0xA0]); // length
//! assert_eq!(mosi(poller.step(Input::Done(&[0; 3]))), [0x59, 0, 0, 0, 0, 0, 0, 0]); // empty?
//! assert_eq!(poller.step(Input::Done(&[0, 0xFB, 0, 0, 0, 0, 0, 0])), Step::Event(PollerEvent::Prepared));
//! // Once the payload is known, its first bytes are loaded after the byte 80.
//! let head = Transfer::Load { offset: 0, len: 16 };
//! assert_eq!(poller.step(Input::Start), Step::Transfer(head));
//! assert_eq!(poller.step(Input::Done(&[])), Step::Event(PollerEvent::Loaded));
//! // At an instant of its choice the executor sends this one byte, and then the rest of the payload.
//! assert_eq!(Poller::transmit().bytes(), [0xC4]);
//! let rest = Transfer::Load { offset: 16, len: 228 };
//! assert_eq!(poller.step(Input::Done(&[0])), Step::Transfer(rest));
//! assert_eq!(poller.step(Input::Done(&[])), Step::Wait { us: 4_815 + 100 - 182 });
//! assert_eq!(mosi(poller.step(Input::Irq)), [0x59, 0, 0, 0, 0, 0, 0, 0]);
//! let ended = [0, 0xFB, 0x08, 0, 0, 0, 0, 0]; // I_txe
//! let sent = Step::Event(PollerEvent::Sent { confirmed: true });
//! assert_eq!(poller.step(Input::Done(&ended)), sent);
//! assert_eq!(mosi(poller.step(Input::Start)), [0x42, 0, 0, 0]); // still configured?
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x88, 0x1C, 0x22]))), [0x71, 0]); // field still on?
//! assert_eq!(mosi(poller.step(Input::Done(&[0, 0x30]))), [0x40, 0, 0]); // one of the settings after each frame
//! assert_eq!(poller.step(Input::Done(&[0, 0x07, 0x3C])), Step::Event(PollerEvent::Ready));
//!
//! // The listener is a 3916: up to its regulators the steps are the same, without the RC calibration.
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
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0x80, 0, 0, 0]))), [0x2C, 0x80]); // I_osc
//! let _ = listener.step(Input::Done(&[0; 2]));
//! let _ = listener.step(Input::Done(&[0; 2]));
//! let _ = listener.step(Input::Done(&[0]));
//! let _ = listener.step(Input::Irq);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x65, 0]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 141]))), [0x00, 0x07, 0xBC]); // 3.3 V: sup3V
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0xD6]);
//! let _ = listener.step(Input::Done(&[0]));
//! let _ = listener.step(Input::Irq);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0, 0x80, 0, 0]))), [0x08, 0x5D]); // no automatic answer
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0x29, 0xFF]); // no load modulation:
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0xFB, 0x28, 0x00]); // no driver for it
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0x26, 0x00, 0xFF]); // antenna tuning
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0x2A, 0x13, 0x02]); // field detector's thresholds
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 3]))), [0x0A, 0x00, 0x13, 0x2D, 0x00, 0x00, 0x02]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 7]))), [0xFB, 0x0C, 0x54, 0x00]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 4]))), [0x16, 0xCF, 0xE7, 0x0F, 0xFB]); // masks
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 5]))), [0x03, 0xA0, 0x22]); // target, NFC-F, 424
//! let _ = listener.step(Input::Done(&[0; 3])); // the same registers read back
//! let _ = listener.step(Input::Done(&[0, 0x07, 0xBC]));
//! let _ = listener.step(Input::Done(&[0, 0x00]));
//! let _ = listener.step(Input::Done(&[0, 0x5D]));
//! let _ = listener.step(Input::Done(&[0, 0xFF]));
//! let _ = listener.step(Input::Done(&[0, 0, 0x00]));
//! let _ = listener.step(Input::Done(&[0, 0x00, 0xFF]));
//! let _ = listener.step(Input::Done(&[0, 0x13, 0x02]));
//! let _ = listener.step(Input::Done(&receiver));
//! let _ = listener.step(Input::Done(&[0, 0, 0x54, 0x00]));
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0xCF, 0xE7, 0x0F, 0xFB]))), [0x43, 0, 0]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0xA0, 0x22]))), [0x02, 0xC3]); // receiver, field detector
//! assert_eq!(mosi(listener.step(Input::Done(&[0; 2]))), [0xDB]); // clear FIFO
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0xD1]); // unmask receive data
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0x42, 0, 0, 0]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0xC3, 0xA0, 0x22]))), [0x71, 0]); // is there a field?
//! assert_eq!(listener.step(Input::Done(&[0, 0x10])), Step::Event(ListenerEvent::Listening));
//!
//! let mut buffer = [0; st25r3916::listener::BUFFER];
//! assert_eq!(listener.step(Input::Start), Step::Wait { us: 20_000 });
//! assert_eq!(listener.state(), ListenerState::Listening);
//! assert_eq!(mosi(listener.step(Input::Irq)), [0x59, 0, 0, 0, 0, 0, 0, 0]);
//! assert_eq!(listener.step(Input::Done(&[0, 0xFB, 0x20, 0, 0, 0, 0, 0])), Step::Wait { us: 6_000 }); // I_rxs
//! assert_eq!(mosi(listener.step(Input::Irq)), [0x59, 0, 0, 0, 0, 0, 0, 0]);
//! let read = Transfer::Read { offset: 0, len: 245 }; // 9F, then into the buffer; the CRC-16 is not read
//! assert_eq!(listener.step(Input::Done(&[0, 0xFB, 0x10, 0, 0, 0, 247, 0])), Step::Transfer(read)); // I_rxe
//! buffer[0] = 245; // what the transfer brought: LEN and the payload
//! let frame = ListenerEvent::Frame { len: 244, flags: FrameFlags::empty() };
//! assert_eq!(listener.step(Input::Done(&buffer[..245])), Step::Event(frame));
//! // The payload, buffer[1..245], is the caller's; with `Start` the receiver is armed again.
//! assert_eq!(mosi(listener.step(Input::Start)), [0x59, 0, 0, 0, 0, 0, 0, 0]); // none begun meanwhile?
//! assert_eq!(mosi(listener.step(Input::Done(&[0, 0xFB, 0, 0, 0, 0, 2, 0]))), [0xDB]); // its CRC-16
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0xD1]);
//! assert_eq!(mosi(listener.step(Input::Done(&[0]))), [0x40, 0, 0]); // one of the settings at each re-arming
//! assert_eq!(listener.step(Input::Done(&[0, 0x07, 0xBC])), Step::Wait { us: 20_000 });
//!
//! // A chip that lost its supply answers with its masks at their reset value.
//! let _ = listener.step(Input::Timeout);
//! let lost = ListenerEvent::Fault(Fault::Reset);
//! assert_eq!(listener.step(Input::Done(&[0; 8])), Step::Event(lost));
//! assert_eq!(listener.step(Input::Start), Step::Delay { us: 1_000 }); // then bring-up, as above
//! assert_eq!(mosi(listener.step(Input::Timeout)), [0xC1]);
//! ```
//!
//! # Features
//!
//! `defmt`: `defmt::Format` for every public type that an event can carry.
//!
//! # Sources
//!
//! "DS13541" is ST's data sheet of the ST25R3916B. Where the ST25R3916 differs (identity, overheat protection, antenna
//! tuning, the coding of the AM depth), the driver adapts to the identity that it reads. Values that the data sheet
//! leaves to the user follow public drivers, named in [`register`] and in `bring_up.rs`. The README lists what no
//! source settles.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod answerer;
pub mod blocking;
mod bring_up;
pub mod command;
pub mod exchange;
pub mod executor;
pub mod listener;
mod machine;
pub mod poller;
pub mod register;
mod sender;
mod status;

pub use answerer::{Answerer, AnswererCounters, AnswererEvent, AnswererState, Unanswered};
pub use bring_up::ReceiverMode;
pub use exchange::{Exchange, ExchangeCounters, ExchangeEvent, ExchangeState, NoAnswer};
pub use listener::{
    Dropped, FrameFlags, Listener, ListenerConfig, ListenerCounters, ListenerEvent, ListenerState, ReadMode,
};
pub use machine::{Fault, Input, Short, Step, Transfer};
pub use poller::{Poller, PollerConfig, PollerCounters, PollerEvent, PollerState};
pub use sender::{SendError, SendState};

/// The longest wait for a stable oscillator, µs (typically 0.7 ms).
pub const OSCILLATOR_US: u32 = 10_000;
/// The longest wait for the RC calibration of an ST25R3916B, µs (5 ms in the data sheet). After that time the bring-up
/// continues even without the interrupt at the calibration's end.
pub const CALIBRATION_US: u32 = 6_000;
/// The longest wait for the supply measurement, µs (25 µs in the data sheet).
pub const MEASUREMENT_US: u32 = 1_000;
/// The longest wait for the regulator adjustment, µs (at most 5 ms in the data sheet).
pub const REGULATOR_US: u32 = 6_000;
/// The longest time from a frame's sync (I_rxs) to its end (I_rxe), µs: 257 bytes take 4.852 ms.
pub const FRAME_US: u32 = 6_000;

/// The lowest supply voltage (VDD) that the data sheet allows, mV; a lower one is [`Fault::SupplyOutOfRange`].
pub const SUPPLY_MIN_MV: u16 = 2_400;
/// The supply voltage from which on the chip is set up for 5 V, mV; below, it is set up for 3.3 V (`sup3V`).
pub const SUPPLY_5V_MV: u16 = 3_600;
/// The highest supply voltage (VDD) that the data sheet allows, mV; a higher one is [`Fault::SupplyOutOfRange`].
pub const SUPPLY_MAX_MV: u16 = 5_500;

/// The type of the chip, by its identity register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Variant {
    /// ST25R3916.
    A,
    /// ST25R3916B.
    B,
}

/// The air time of a frame at 424 kbit/s, from the first preamble bit to the last CRC bit, µs, rounded up.
///
/// A frame consists of 48 bits of preamble, 16 of sync, then LEN, `payload` bytes and CRC-16. A bit is 32 carrier
/// periods of 13.56 MHz. 64-bit arithmetic is avoided, because it is a library call on a Cortex-M4.
const fn air_time_us(payload: u8) -> u32 {
    let bits = 64 + 8 * (payload as u32 + 3);
    (bits * 3_200).div_ceil(1_356)
}

/// This test compiles and runs the README's example.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_times_are_those_of_the_bit_rate() {
        assert_eq!((air_time_us(244), air_time_us(254)), (4_815, 5_003));
        for payload in 0..=255_u8 {
            let carrier_periods = (48 + 16 + 8 * (1 + u64::from(payload) + 2)) * 32;
            assert_eq!(u64::from(air_time_us(payload)), (carrier_periods * 1_000_000).div_ceil(13_560_000));
        }
    }

    #[test]
    fn the_machines_are_small() {
        assert!(size_of::<Poller>() <= 40, "{}", size_of::<Poller>());
        assert!(size_of::<Listener>() <= 104, "{}", size_of::<Listener>());
        assert!(size_of::<Step<ListenerEvent>>() <= 24);
        assert!(size_of::<Exchange>() <= 112, "{}", size_of::<Exchange>());
        assert!(size_of::<Answerer>() <= 124, "{}", size_of::<Answerer>());
    }
}
