//! A receiver on I2C: u-blox's DDC port, one event at a time, without the registers
//!
//! # Design
//!
//! The port's registers 0xFD and 0xFE hold the number of bytes that wait (the high byte first), and 0xFF is the stream.
//! The address counts up with each byte read and stays at 0xFF. So a cycle is: write 0xFD, restart, read two bytes;
//! restart, read the bytes that wait, at most [`MOST`]; stop. In a cycle in which HORUS sends a message to the
//! receiver, it reads nothing.
//!
//! ```text
//! tick ── START ─ 0x84 0xFD ─ RESTART ─ 0x85 high low ─ RESTART ─ 0x85 byte … byte ─ STOP ── … ── tick
//! ```
//!
//! *A single byte* is never read by itself. For such a read, the STM32F4's I2C needs the acknowledge switched off and
//! the STOP requested within the time of that byte (RM0090, "I2C", master receiver). No task of this priority can
//! guarantee that. If one byte waits, registers 0xFD, 0xFE and 0xFF are read together. From two bytes on, the end of
//! the DMA transfer makes the peripheral refuse the last byte (LAST). The peripheral then waits for STOP or START as
//! long as needed.
//!
//! *Bounds*: a transaction that has not ended by the next tick has failed. The peripheral is then reset and
//! disconnected from its pins. Nine clocks and a STOP free a receiver that holds SDA (UM10204, "Bus clear"), one level
//! each [`STEP_US`], and the pins are given back. If that did not free the bus, the recovery is repeated after
//! [`HOLD_TICKS`]. No code ever waits. A receiver may hold the clock for as long as 20 ms (ZED-F9R data sheet, "DDC").
//! HORUS takes that as a failed transaction, of which it keeps the bytes that have come ([`Ddc::stream_under_way`]).
//!
//! The number of unexpected events is bounded too. BTF, for example, stays set until the repeated START after it is on
//! the bus (RM0090, "I2C", status register 1), and calls the handler again until then. After [`MOST_SPURIOUS`] calls
//! without progress, or [`MOST_BUS_ERRORS`] bus errors since the tick, no event or error calls the handler until the
//! next tick. So a disturbed bus does not take the processor's time.
//!
//! # Sources
//!
//! - Source of the registers, and of the rule that their address counts up: u-blox, *u-blox M9/F9 integration manuals*,
//!   "I2C interface", read access; in use in sparkfun/SparkFun_u-blox_GNSS_Arduino_Library (`checkUbloxI2C`), ArduPilot
//!   and gpsd. A count of 0xFFFF is taken as zero, because a line that nobody drives reads as ones.
//! - Source of the order of events: RM0090, "I2C", transfer sequence diagrams for master transmitter and receiver, and
//!   "DMA requests".

use core::ops::Range;

use crate::source::{Backlog, Busy, Message, RING};

/// The I2C address of a receiver's port, 7 bits.
pub const ADDRESS: u8 = 0x42;
const WRITE: u8 = ADDRESS << 1;
const READ: u8 = ADDRESS << 1 | 1;
/// The number of waiting bytes is in two registers, of which this is the first.
const WAITING: u8 = 0xFD;

/// The most bytes of the receiver's stream that are read in one cycle: at 27 µs each they take 6.9 ms, which leaves 2.7
/// ms for a receiver that stretches the clock. This is 25.6 kB/s; a receiver with all three messages at 25 Hz sends 4.6
/// kB/s.
pub const MOST: usize = 256;

const _: () = assert!(RING >= 2 * MOST);

/// How long a recovery of the bus keeps each level, µs. The clock then has 50 kHz, which no I2C device is too slow for.
pub const STEP_US: u16 = 10;

/// The number of clocks in a recovery of the bus. A receiver that sends a byte releases SDA after eight bits and the
/// acknowledge.
const CLOCKS: u8 = 9;

/// The number of ticks until the next recovery of the bus, if a recovery did not free it.
pub const HOLD_TICKS: u8 = 10;

/// The most events without progress before the event interrupts are switched off. A repeated START is on the bus within
/// 5 µs, and a handler takes 1 µs at least.
pub const MOST_SPURIOUS: u8 = 16;

/// If this number of bus errors comes between two ticks, the event interrupts are switched off until the next tick.
/// Each error costs a call of 1 to 2 µs, so together they cost 0.1 ms of a cycle. A pulse on SDA every 0.2 ms makes 50
/// errors.
pub const MOST_BUS_ERRORS: u8 = 64;

/// The state of the bus at the tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bus {
    /// The level of SCL.
    pub scl: bool,
    /// The level of SDA.
    pub sda: bool,
    /// Whether the peripheral reports a busy bus, or has not yet carried out a START or STOP that was requested.
    pub busy: bool,
}

impl Bus {
    const fn is_free(self) -> bool {
        self.scl && self.sda && !self.busy
    }
}

/// The events that the peripheral's status register reports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Events {
    /// SB: the START is on the bus.
    pub started: bool,
    /// ADDR: the receiver has acknowledged its address.
    pub addressed: bool,
    /// BTF: the byte was sent and acknowledged, and the next byte is needed.
    pub byte_sent: bool,
    /// AF: the receiver did not acknowledge a byte.
    pub refused: bool,
    /// ARLO: another device drives the bus.
    pub arbitration_lost: bool,
    /// BERR: a START or STOP came in the middle of a byte.
    pub bus_error: bool,
}

/// What the code that accesses the I2C registers has to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// There is nothing to do.
    Nothing,
    /// Request a START, with the interrupts of events and errors on.
    Start,
    /// Write the data register.
    Put(u8),
    /// Clear ADDR, then write the data register with this byte.
    PutAddressed(u8),
    /// Give the DMA stream this number of bytes to receive, at least 2, switch event interrupts off, then clear ADDR.
    Receive(usize),
    /// Switch the interrupts of events and errors off and request a STOP.
    Stop,
    /// Switch the interrupts of events and errors off.
    Mute,
    /// Stop the stream, hold the peripheral in reset, release both pins from it; call [`Ddc::step`] in [`STEP_US`].
    Release,
    /// Drive the pins (false: low; true: released); call [`Ddc::step`] in [`STEP_US`].
    Drive {
        /// The level of SCL.
        scl: bool,
        /// The level of SDA.
        sda: bool,
    },
    /// Set the peripheral up anew and give the pins back to it.
    Rejoin,
}

/// The result of a read whose bytes the DMA stream has moved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// The range of the received bytes that belong to the receiver's stream.
    pub stream: Range<usize>,
    /// The next order that the code with access to the registers has to carry out.
    pub then: Order,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Write a register's address, then read this number of bytes from that address on.
    Select(usize),
    /// Read the two registers of the number of waiting bytes, alone or with one byte of the stream.
    Waiting(usize),
    Stream(usize),
    Message,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    Starting(Phase),
    Addressing(Phase),
    Writing(Phase, usize),
    Receiving(Phase),
    Recovering(u8),
}

/// The counts of what has gone wrong so far. All counts wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Transactions that had not ended by the next tick.
    pub timed_out: u32,
    /// Recoveries of the bus.
    pub recoveries: u32,
    /// Transactions that ended early because there was no acknowledge or arbitration was lost.
    pub refused: u32,
}

/// The state of one receiver's port.
#[derive(Clone, Debug)]
pub struct Ddc {
    state: State,
    message: Option<Message>,
    spurious: u8,
    bus_errors: u8,
    hold: u8,
    /// The state of the bus at the last tick that did not find it free.
    stuck: Option<Bus>,
    backlog: Backlog,
    /// Whether more bytes wait in the receiver than the present read takes.
    leaves: bool,
    counts: Counts,
}

impl Default for Ddc {
    fn default() -> Self {
        Self::new()
    }
}

impl Ddc {
    /// Returns a port whose bus has not been examined yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Idle,
            message: None,
            spurious: 0,
            bus_errors: 0,
            hold: 0,
            stuck: None,
            backlog: Backlog::new(2),
            leaves: false,
            counts: Counts { timed_out: 0, recoveries: 0, refused: 0 },
        }
    }

    /// Returns the counts of what has gone wrong so far.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Sends `message` in the next cycle.
    ///
    /// # Errors
    ///
    /// [`Busy`] while another message waits.
    pub fn transmit(&mut self, message: &Message) -> Result<(), Busy> {
        // Not covered: a message that still waits: it leaves in the next cycle, or is dropped within eleven, and the
        // next one is made when its answer has come, or a second after it.
        if self.message.is_some() {
            return Err(Busy);
        }
        self.message = Some(*message);
        Ok(())
    }

    /// Returns the number of bytes of the stream that are being read, unless they are to be dropped ([`Backlog`]). The
    /// bytes of a failed transaction count too, because the receiver does not send them again.
    #[must_use]
    pub const fn stream_under_way(&self) -> Option<usize> {
        match self.state {
            State::Receiving(Phase::Stream(len)) if !self.backlog.is_old() => Some(len),
            _ => None,
        }
    }

    /// Serves the tick. `bus` is the state of the bus at the tick.
    pub fn poll(&mut self, bus: Bus) -> Order {
        self.backlog.tick();
        self.bus_errors = 0;
        match self.state {
            State::Idle if bus.is_free() => {
                self.start(if self.message.is_some() { Phase::Message } else { Phase::Select(2) })
            }
            State::Idle if self.hold > 0 && self.stuck == Some(bus) => {
                self.hold -= 1;
                Order::Nothing
            }
            State::Idle => {
                self.stuck = Some(bus);
                self.recover()
            }
            _ => {
                self.counts.timed_out = self.counts.timed_out.wrapping_add(1);
                self.recover()
            }
        }
    }

    /// Serves the peripheral's interrupt.
    pub fn event(&mut self, events: Events) -> Order {
        if events.arbitration_lost {
            // After a lost arbitration the peripheral does not control the bus, so there is no transfer to stop.
            return self.give_up(Order::Mute);
        }
        if events.refused {
            return self.give_up(Order::Stop);
        }
        // A bus error is ignored because of the erratum "spurious bus error detection in controller mode". If the error
        // was real, the transaction ends at the tick.
        self.bus_errors = self.bus_errors.saturating_add(u8::from(events.bus_error));
        // Not covered: only this line, as many bus errors as the limit: the pulses on SDA of these runs bring fewer in
        // a transaction.
        if self.bus_errors >= MOST_BUS_ERRORS {
            return Order::Mute;
        }
        self.spurious = self.spurious.saturating_add(1);
        // Not covered: only this line, an event in another state: the interrupts are off outside of a transaction.
        let order = match self.state {
            State::Starting(phase) if events.started => {
                self.state = State::Addressing(phase);
                Order::Put(if matches!(phase, Phase::Select(_) | Phase::Message) { WRITE } else { READ })
            }
            State::Addressing(phase) if events.addressed => match phase {
                Phase::Waiting(len) | Phase::Stream(len) => {
                    self.state = State::Receiving(phase);
                    Order::Receive(len)
                }
                Phase::Select(_) => {
                    self.state = State::Writing(phase, 1);
                    Order::PutAddressed(WAITING)
                }
                Phase::Message => {
                    self.state = State::Writing(phase, 1);
                    // Not covered: no message: this state is entered only with one, as in `message_byte`.
                    Order::PutAddressed(self.message_byte(0).unwrap_or(WAITING))
                }
            },
            State::Writing(Phase::Select(len), _) if events.byte_sent => self.start(Phase::Waiting(len)),
            // Not covered: only this line, a state without a message, as in `message_byte`.
            State::Writing(Phase::Message, sent) if events.byte_sent => match self.message_byte(sent) {
                Some(byte) => {
                    self.state = State::Writing(Phase::Message, sent + 1);
                    Order::Put(byte)
                }
                None => {
                    self.message = None;
                    self.end()
                }
            },
            _ if self.spurious >= MOST_SPURIOUS => return Order::Mute,
            _ => return Order::Nothing,
        };
        self.spurious = 0;
        order
    }

    /// Serves the end of a read. `first` holds the first three bytes that were received.
    pub fn received(&mut self, first: [u8; 3]) -> Received {
        let waiting = match u16::from_be_bytes([first[0], first[1]]) {
            u16::MAX => 0,
            count => usize::from(count),
        };
        let (stream, then) = match self.state {
            State::Receiving(Phase::Waiting(2)) => match waiting {
                0 => {
                    self.backlog.read(true);
                    (0..0, self.end())
                }
                1 => (0..0, self.start(Phase::Select(3))),
                count => {
                    self.leaves = count > MOST;
                    (0..0, self.start(Phase::Stream(count.min(MOST))))
                }
            },
            State::Receiving(Phase::Waiting(len)) => {
                let keeps = self.backlog.read(true);
                (2..if keeps && waiting > 0 { len } else { 2 }, self.end())
            }
            State::Receiving(Phase::Stream(len)) => {
                let keeps = self.backlog.read(!self.leaves);
                (0..if keeps { len } else { 0 }, self.end())
            }
            _ => (0..0, Order::Nothing),
        };
        Received { stream, then }
    }

    /// Serves the failure of the stream.
    pub fn stream_failed(&mut self) -> Order {
        match self.state {
            // Not covered: an error of the stream: it has one only at an address without memory, as in `hw/spi.rs`.
            State::Receiving(_) => self.recover(),
            _ => Order::Nothing,
        }
    }

    /// Drives the next level of the bus's recovery, when the level before it has lasted for [`STEP_US`].
    pub fn step(&mut self) -> Order {
        // Not covered: another state: the timer runs only in a recovery.
        let State::Recovering(step) = self.state else { return Order::Nothing };
        self.state = State::Recovering(step.saturating_add(1));
        // The recovery's last levels make the STOP, a rise of SDA while SCL is high.
        const LAST: u8 = 2 * CLOCKS;
        match step {
            0..LAST => Order::Drive { scl: step % 2 == 1, sda: true },
            LAST => Order::Drive { scl: false, sda: true },
            19 => Order::Drive { scl: false, sda: false },
            20 => Order::Drive { scl: true, sda: false },
            21 => Order::Drive { scl: true, sda: true },
            _ => {
                self.state = State::Idle;
                Order::Rejoin
            }
        }
    }

    fn message_byte(&self, index: usize) -> Option<u8> {
        // Not covered: no message: bytes are asked for only while one is being sent.
        self.message.as_ref().and_then(|message| message.bytes().get(index)).copied()
    }

    fn start(&mut self, phase: Phase) -> Order {
        self.state = State::Starting(phase);
        Order::Start
    }

    fn end(&mut self) -> Order {
        self.state = State::Idle;
        self.hold = 0;
        self.stuck = None;
        Order::Stop
    }

    fn give_up(&mut self, order: Order) -> Order {
        // Not covered: an event outside of a transaction: the interrupts are off then.
        if self.state == State::Idle || matches!(self.state, State::Recovering(_)) {
            return Order::Mute;
        }
        self.state = State::Idle;
        // A message that the receiver does not take is dropped. The configuration notices that no answer comes.
        self.message = None;
        self.counts.refused = self.counts.refused.wrapping_add(1);
        order
    }

    fn recover(&mut self) -> Order {
        self.counts.recoveries = self.counts.recoveries.wrapping_add(1);
        self.message = None;
        self.spurious = 0;
        self.hold = HOLD_TICKS;
        self.state = State::Recovering(0);
        Order::Release
    }
}

#[cfg(test)]
mod tests;
