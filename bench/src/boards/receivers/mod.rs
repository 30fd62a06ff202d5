//! The receivers' interfaces on the HORUS board. They connect a receiver's stream of messages to the pins of the
//! microcontroller.
//!
//! | file | interface | receivers | source |
//! |---|---|---|---|
//! | `uart` | UART, both ways | GPS1, GPS4, GPS5 | ZED-F9R data sheet (UBX-22024085) 5.1 |
//! | [`ddc`] | DDC: an I2C peripheral at address 0x42 with a stream in register 0xFF | GPS2 | 5.3, and see [`ddc`] |
//! | [`spi`] | SPI: a stream in either direction, without registers | GPS3 | 5.2, and see [`spi`] |
//! | `read_bytes` | bus traffic in the event log's form | | |
//!
//! `gnss_sim` generates a receiver's messages and applies its configuration. An interface accepts whole messages
//! ([`Receivers::offer`]), sends their bytes when the microcontroller reads them, and collects the bytes that the
//! microcontroller sends ([`Receivers::take_sent`]).
//!
//! # The output buffer
//!
//! On I2C and SPI a receiver keeps its messages until the host reads them. Its buffer holds 4 kB; a message that does
//! not fit is dropped whole (u-blox integration manuals, "If the amount of data configured is too much for a certain
//! port's bandwidth"). After 2 s without any communication the receiver puts no more messages into the buffer until the
//! host communicates again ("Extended TX timeout"; the M10 generation says 1.5 s). Messages in the buffer are kept, so
//! a host that reads again after a pause first gets messages that are up to 2 s old.

pub mod ddc;
mod read_bytes;
pub mod spi;
#[cfg(test)]
mod tests;
mod uart;

use std::collections::VecDeque;

use emulator_part::{I2cAnswer, I2cEvent, Pad, Pin, SpiFrame, UartFrame};
use gnss_sim::ubx;
use stm32f429::pin;

use crate::faults::{BusFault, Rng};
use ddc::Ddc;
use emulator_node::Input;
use read_bytes::Crossings;
pub use read_bytes::ReadBytes;
use spi::Spi;
use uart::Uart;

/// The size of a receiver's buffer of messages for a bus, bytes: u-blox integration manuals, "Extended TX timeout".
pub const BUFFER: usize = 4096;
/// The time without communication after which a receiver puts no more messages into its output buffer, ns.
pub const FORSAKEN: u64 = 2_000_000_000;

/// A bus transaction that has not ended within this time after its first byte counts as abandoned, ns.
pub const ABANDONED: u64 = 50_000_000;

#[derive(Clone, Debug, Default)]
struct Outbox {
    bytes: VecDeque<u8>,
    /// The groups of bytes in the buffer, each with its arrival (ns) and its length.
    since: VecDeque<(u64, usize)>,
    read_at: u64,
}

impl Outbox {
    /// Puts messages into the buffer at `at` (ns), if they fit and the bus was used within [`FORSAKEN`].
    fn put(&mut self, at: u64, mut messages: &[u8]) {
        if at.saturating_sub(self.read_at) > FORSAKEN {
            return;
        }
        while !messages.is_empty() {
            let (message, rest) = messages.split_at(message_at_start_of(messages));
            if self.bytes.len() + message.len() <= BUFFER {
                self.bytes.extend(message);
                self.since.push_back((at, message.len()));
            }
            messages = rest;
        }
    }

    fn take(&mut self) -> Option<(u8, u64)> {
        let byte = self.bytes.pop_front()?;
        let (since, left) = self.since.front_mut()?;
        let since = *since;
        *left -= 1;
        if *left == 0 {
            self.since.pop_front();
        }
        Some((byte, since))
    }
}

/// Returns the length of the UBX message at the start of `bytes`, or of the bytes before the first message.
fn message_at_start_of(bytes: &[u8]) -> usize {
    match ubx::Frame::at_start_of(bytes) {
        Some(frame) => frame.wire_len(),
        None => (1..bytes.len())
            .find(|&at| bytes[at - 1] == b'\n' || ubx::Frame::at_start_of(&bytes[at..]).is_some())
            .unwrap_or(bytes.len()),
    }
}

/// A byte that the microcontroller sent to a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SentByte {
    /// The instant at which the whole byte had arrived, ns.
    pub at: u64,
    /// The receiver's index, from 0.
    pub receiver: usize,
    /// The byte; `None` if the receiver cannot read it. The message of an unreadable byte is broken.
    pub byte: Option<u8>,
}

#[derive(Clone, Debug)]
enum Interface {
    Uart(Uart),
    I2c(Ddc),
    Spi(Spi),
}

/// All receivers' interfaces.
#[derive(Clone, Debug)]
pub struct Receivers {
    interfaces: Vec<Interface>,
    attended: bool,
    heard: Vec<SentByte>,
    read: Vec<ReadBytes>,
    /// The first misuse of each kind, by which the microcontroller violated a receiver's data sheet: its instant, ns,
    /// and its description.
    misuses: Vec<(u64, String)>,
    told: Vec<(usize, &'static str)>,
    next: u64,
}

impl Receivers {
    /// Returns the interfaces of `receivers` receivers, none of which has sent a byte.
    #[must_use]
    pub fn new(receivers: usize) -> Self {
        let interfaces = [
            Interface::Uart(Uart::new(pin('D', 6), pin('D', 5))),
            Interface::I2c(Ddc::new(pin('F', 1), pin('F', 0))),
            Interface::Spi(Spi::new(spi::Wires {
                sck: pin('F', 7),
                miso: pin('F', 8),
                mosi: pin('F', 9),
                cs: pin('E', 3),
            })),
            Interface::Uart(Uart::new(pin('D', 2), pin('C', 12))),
            Interface::Uart(Uart::new(pin('E', 7), pin('E', 8))),
        ];
        Self {
            interfaces: interfaces.into_iter().take(receivers).collect(),
            attended: false,
            heard: vec![],
            read: vec![],
            misuses: vec![],
            told: vec![],
            next: u64::MAX,
        }
    }

    /// Queues `frames` on a receiver's UART and returns the instant, ns, at which the first of them begins.
    pub fn send(&mut self, at: u64, receiver: usize, frames: impl IntoIterator<Item = UartFrame>) -> u64 {
        let Some(Interface::Uart(uart)) = self.interfaces.get_mut(receiver) else { return at };
        let begins = uart.send(at, frames);
        self.plan();
        begins
    }

    /// Makes `messages` of a receiver on I2C or SPI readable from `at` (ns) on.
    pub fn offer(&mut self, at: u64, receiver: usize, messages: &[u8]) {
        match self.interfaces.get_mut(receiver) {
            Some(Interface::I2c(ddc)) => ddc.outbox.put(at, messages),
            Some(Interface::Spi(spi)) => spi.outbox.put(at, messages),
            Some(Interface::Uart(_)) | None => {}
        }
    }

    /// Begins `fault` of a receiver's bus at `now` (ns); `seed` determines all random values of the fault.
    pub fn begin_fault(&mut self, now: u64, receiver: usize, fault: BusFault, seed: u64) {
        match self.interfaces.get_mut(receiver) {
            Some(Interface::I2c(ddc)) => ddc.begin_fault(now, fault, Rng::new(seed)),
            Some(Interface::Spi(spi)) => spi.begin_fault(fault, Rng::new(seed)),
            Some(Interface::Uart(_)) | None => {}
        }
        self.plan();
    }

    /// Ends `fault` of a receiver's bus.
    pub fn end_fault(&mut self, receiver: usize, fault: BusFault) {
        match self.interfaces.get_mut(receiver) {
            Some(Interface::I2c(ddc)) => ddc.end_fault(fault),
            Some(Interface::Spi(spi)) => spi.end_fault(fault),
            Some(Interface::Uart(_)) | None => {}
        }
        self.plan();
    }

    /// Sets the bit rate at which a receiver's UART receives, in baud.
    pub fn listen_at(&mut self, receiver: usize, baud: u32) {
        if let Some(Interface::Uart(uart)) = self.interfaces.get_mut(receiver) {
            uart.listen_at(baud);
        }
    }

    /// Keeps the bytes that the microcontroller sends from now on, for [`Receivers::take_sent`]. The board's emulation
    /// stops after each of these bytes.
    pub fn attend(&mut self) {
        self.attended = true;
    }

    /// Takes the bytes that the microcontroller has sent to receivers since [`Receivers::attend`] or the last call.
    pub fn take_sent(&mut self) -> Vec<SentByte> {
        std::mem::take(&mut self.heard)
    }

    /// Whether the microcontroller has sent a byte that [`Receivers::take_sent`] has not taken yet.
    #[must_use]
    pub fn has_sent(&self) -> bool {
        !self.heard.is_empty()
    }

    /// Takes the bus transactions that have ended since the last call. A transaction that began [`ABANDONED`] before
    /// `now` (ns) counts as ended.
    pub fn take_read(&mut self, now: u64) -> Vec<ReadBytes> {
        for (receiver, interface) in self.interfaces.iter_mut().enumerate() {
            let (Interface::I2c(Ddc { crossings, .. }) | Interface::Spi(Spi { crossings, .. })) = interface else {
                continue;
            };
            if crossings.since().saturating_add(ABANDONED) <= now {
                crossings.spoil();
                crossings.end();
            }
            self.read.extend(crossings.take(receiver));
        }
        std::mem::take(&mut self.read)
    }

    /// The instant, ns, at which the oldest bus transaction began among those that [`Receivers::take_read`] has yet to
    /// return; `u64::MAX` for none.
    #[must_use]
    pub fn untold_since(&self) -> u64 {
        let of = |interface: &Interface| match interface {
            Interface::Uart(_) => u64::MAX,
            Interface::I2c(ddc) => ddc.crossings.since(),
            Interface::Spi(spi) => spi.crossings.since(),
        };
        self.interfaces.iter().map(of).min().unwrap_or(u64::MAX)
    }

    /// Takes what the microcontroller did against the receivers' data sheets. Each kind is reported once in a run.
    pub fn take_misuses(&mut self) -> Vec<(u64, String)> {
        std::mem::take(&mut self.misuses)
    }

    fn misused(&mut self, at: u64, receiver: usize, what: Option<&'static str>) {
        if let Some(what) = what.filter(|what| !self.told.contains(&(receiver, what))) {
            self.told.push((receiver, what));
            self.misuses.push((at, format!("receiver {}: {what}", receiver + 1)));
        }
    }

    fn plan(&mut self) {
        let of = |interface: &Interface| match interface {
            Interface::Uart(uart) => uart.next_at(),
            Interface::I2c(ddc) => ddc.next_at(),
            Interface::Spi(_) => u64::MAX,
        };
        self.next = self.interfaces.iter().map(of).min().unwrap_or(u64::MAX);
    }

    pub(super) fn powered(&self, inputs: &mut Vec<Input>) {
        for interface in &self.interfaces {
            match interface {
                Interface::Uart(uart) => inputs.push(Input::Level(uart.to_part, Some(true))),
                Interface::I2c(ddc) => inputs.extend([ddc.scl, ddc.sda].map(|pin| Input::Level(pin, Some(true)))),
                Interface::Spi(_) => {}
            }
        }
    }

    pub(super) fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        for (receiver, interface) in self.interfaces.iter_mut().enumerate() {
            match interface {
                Interface::Uart(_) => {}
                Interface::I2c(ddc) => ddc.pin(pin, pad),
                Interface::Spi(spi) => {
                    if pin == spi.wires.cs {
                        spi.select(at, pad == Pad::Driven(false));
                        self.read.extend(spi.crossings.take(receiver));
                    }
                }
            }
        }
        self.plan();
    }

    /// Transfers a frame from `begins` to `ends` (ns). Returns `None` if no receiver drives MISO.
    pub(super) fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let (receiver, spi) =
            self.interfaces.iter_mut().enumerate().find_map(|(receiver, interface)| match interface {
                Interface::Spi(spi) if spi.is_clocked_by(frame) => Some((receiver, spi)),
                _ => None,
            })?;
        let mut heard = vec![];
        let (answer, misuse) = spi.clock(begins, ends, frame, |at, byte| heard.push(SentByte { at, receiver, byte }));
        self.hears(heard);
        self.misused(begins, receiver, misuse);
        answer
    }

    /// Passes a UART frame to the receiver. The microcontroller has sent the frame on `pin`; the frame ended at `at`
    /// (ns).
    pub(super) fn uart(&mut self, at: u64, pin: Pin, frame: &UartFrame) {
        let found = self.interfaces.iter_mut().enumerate().find_map(|(receiver, interface)| match interface {
            Interface::Uart(uart) if uart.from_part == pin => {
                Some(SentByte { at, receiver, byte: uart.hears(at, frame)? })
            }
            _ => None,
        });
        self.hears(found);
    }

    /// Passes an event of the microcontroller's I2C, which ended at `at` (ns), to the receiver on these pins.
    pub(super) fn i2c(&mut self, at: u64, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer {
        let found = self.interfaces.iter_mut().enumerate().find_map(|(receiver, interface)| match interface {
            Interface::I2c(ddc) if (ddc.scl, ddc.sda) == (scl, sda) => Some((receiver, ddc)),
            _ => None,
        });
        let Some((receiver, ddc)) = found else { return I2cAnswer::NOBODY };
        let mut heard = vec![];
        let (answer, misuse) = ddc.act(at, event, |byte| heard.push(SentByte { at, receiver, byte: Some(byte) }));
        self.read.extend(ddc.crossings.take(receiver));
        self.hears(heard);
        self.misused(at, receiver, misuse);
        self.plan();
        answer
    }

    fn hears(&mut self, heard: impl IntoIterator<Item = SentByte>) {
        if self.attended {
            self.heard.extend(heard);
        }
    }

    #[must_use]
    pub(super) fn next_event(&self) -> u64 {
        self.next
    }

    pub(super) fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        let mut moved = at >= self.next;
        for interface in &mut self.interfaces {
            match interface {
                Interface::Uart(uart) if moved => uart.settle(at, inputs),
                Interface::I2c(ddc) => moved |= ddc.settle(at, inputs),
                Interface::Uart(_) | Interface::Spi(_) => {}
            }
        }
        if moved {
            self.plan();
        }
    }
}
