//! A receiver on I2C: u-blox' DDC port, one event at a time, without the registers
//!
//! # Design
//!
//! The port has registers: 0xFD and 0xFE hold how many bytes wait (the high byte first), 0xFF is the stream. The
//! address counts up with each byte read and stays at 0xFF. So a cycle is: write 0xFD, restart, read two bytes;
//! restart, read as many bytes as wait, at most [`MOST`]; stop. A cycle in which there is a message to send writes that
//! instead.
//!
//! ```text
//! tick ── START ─ 0x84 0xFD ─ RESTART ─ 0x85 high low ─ RESTART ─ 0x85 byte … byte ─ STOP ── … ── tick
//! ```
//!
//! *One byte alone* is never read by itself: the STM32F4's I2C wants the acknowledge switched off and the STOP
//! requested within the time of that byte (RM0090, "I2C", master receiver), which no task of our priority can promise.
//! If one byte waits, registers 0xFD, 0xFE and 0xFF are read together. From two bytes on the DMA controller's end of
//! transfer makes the peripheral refuse the last byte (LAST), and it then waits for STOP or START as long as it takes.
//!
//! *Bounds*: what has not ended by the next tick has failed. The peripheral is then reset, the pins are taken from it,
//! nine clocks and a STOP free a receiver that holds SDA (UM10204, "Bus clear"), one level each [`STEP_US`], and the
//! pins go back. If the bus looks as it did before, it is left alone for [`HOLD_TICKS`], then the same again. Nothing
//! ever waits. A receiver may hold the clock for as long as 20 ms (ZED-F9R data sheet, "DDC"): to HORUS that is a
//! failed transaction, of which the bytes that have come are kept ([`Ddc::stream_under_way`]), and the bus is free
//! afterwards.
//!
//! Events that nobody asked for are bounded too: BTF stays set until the repeated START that follows is on the bus
//! (RM0090, "I2C", status register 1), and so calls the handler again meanwhile. After [`MOST_SPURIOUS`] calls without
//! progress the event interrupts are switched off until the tick, so that a bus that is held does not cost the
//! processor's time.
//!
//! # Sources
//!
//! - Registers, and that they count up: u-blox, *u-blox M9/F9 integration manuals*, "I2C interface", read access; in
//!   use in sparkfun/SparkFun_u-blox_GNSS_Arduino_Library (`checkUbloxI2C`), ArduPilot and gpsd. A count of 0xFFFF is
//!   taken for none: it is what a line that nobody drives reads.
//! - Events: RM0090, "I2C", transfer sequence diagrams for master transmitter and receiver, and "DMA requests".

use core::ops::Range;

use crate::source::{Backlog, Busy, Message};

/// The port's address, 7 bits.
pub const ADDRESS: u8 = 0x42;
const WRITE: u8 = ADDRESS << 1;
const READ: u8 = ADDRESS << 1 | 1;
/// The first of the two registers that say how many bytes wait.
const WAITING: u8 = 0xFD;

/// The most bytes of the stream that are read in one cycle: at 27 µs each 6.9 ms, which leaves 2.7 ms for a receiver
/// that stretches the clock, and 25.6 kB/s in all. A receiver with all three messages at 25 Hz sends 4.6 kB/s.
pub const MOST: usize = 256;

/// How long each level of a recovery lasts, µs: so 50 kHz, for which every I2C device is fast enough.
pub const STEP_US: u16 = 10;

/// Clocks of a recovery: a receiver that is sending a byte has let go of SDA after the eight bits and the acknowledge.
const CLOCKS: u8 = 9;

/// Ticks from a recovery that did not free the bus to the next.
pub const HOLD_TICKS: u8 = 10;

/// The most events without progress before the event interrupts are switched off. A repeated START is on the bus within
/// 5 µs, a handler takes 1 µs at least.
pub const MOST_SPURIOUS: u8 = 16;

/// What the bus looks like at the tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bus {
    /// SCL's level.
    pub scl: bool,
    /// SDA's level.
    pub sda: bool,
    /// The peripheral says that the bus is busy, or has not yet carried out a START or STOP.
    pub busy: bool,
}

impl Bus {
    const fn is_free(self) -> bool {
        self.scl && self.sda && !self.busy
    }
}

/// What the peripheral's status register says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Events {
    /// SB: the START is on the bus.
    pub started: bool,
    /// ADDR: the receiver has acknowledged its address.
    pub addressed: bool,
    /// BTF: the byte is out and acknowledged, and the next one is wanted.
    pub byte_sent: bool,
    /// AF: no acknowledge.
    pub refused: bool,
    /// ARLO: somebody else drives the bus.
    pub arbitration_lost: bool,
    /// BERR: a START or STOP in the middle of a byte.
    pub bus_error: bool,
}

/// What the registers have to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Nothing.
    Nothing,
    /// Request a START, with the event interrupts on.
    Start,
    /// Write the data register.
    Put(u8),
    /// Clear ADDR, then write the data register.
    PutAddressed(u8),
    /// Give the DMA stream so many bytes to receive, at least 2, switch the event interrupts off, then clear ADDR.
    Receive(usize),
    /// Switch the event interrupts off and request a STOP.
    Stop,
    /// Switch the event interrupts off.
    Mute,
    /// Stop the stream, hold the peripheral in reset, take both pins from it and release them; [`Ddc::step`] in
    /// [`STEP_US`].
    Release,
    /// Drive the pins (false: low; true: released); [`Ddc::step`] in [`STEP_US`].
    Drive {
        /// SCL.
        scl: bool,
        /// SDA.
        sda: bool,
    },
    /// Set the peripheral up anew and give the pins back to it.
    Rejoin,
}

/// What came in, and what to do next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// Which of the bytes that were received belong to the receiver's stream.
    pub stream: Range<usize>,
    /// What next.
    pub then: Order,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Write the register's address, then read so many bytes from there.
    Select(usize),
    /// Read the two registers, or these and one byte of the stream.
    Waiting(usize),
    /// Read the stream.
    Stream(usize),
    /// Write a message.
    Message,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    Starting(Phase),
    Addressing(Phase),
    Writing(Phase, usize),
    Receiving(Phase),
    /// So many levels have been driven.
    Recovering(u8),
}

/// What has gone wrong so far. All counts wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Transactions that had not ended by the next tick.
    pub timed_out: u32,
    /// Recoveries of the bus.
    pub recoveries: u32,
    /// Transactions that ended early: no acknowledge, or arbitration lost.
    pub refused: u32,
}

/// One receiver's port.
#[derive(Clone, Debug)]
pub struct Ddc {
    state: State,
    message: Option<Message>,
    spurious: u8,
    hold: u8,
    /// What the bus looked like when it was last found not to be free.
    stuck: Option<Bus>,
    backlog: Backlog,
    /// More waits than is being read.
    leaves: bool,
    counts: Counts,
}

impl Default for Ddc {
    fn default() -> Self {
        Self::new()
    }
}

impl Ddc {
    /// A port whose bus nobody has looked at yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Idle,
            message: None,
            spurious: 0,
            hold: 0,
            stuck: None,
            backlog: Backlog::new(),
            leaves: false,
            counts: Counts { timed_out: 0, recoveries: 0, refused: 0 },
        }
    }

    /// What has gone wrong so far.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Sends `message` in the next cycle.
    ///
    /// # Errors
    ///
    /// [`Busy`] while another one waits.
    pub fn transmit(&mut self, message: &Message) -> Result<(), Busy> {
        if self.message.is_some() {
            return Err(Busy);
        }
        self.message = Some(*message);
        Ok(())
    }

    /// How many bytes of the receiver's stream are being read, unless they are to be dropped ([`Backlog`]). If
    /// [`Ddc::poll`] then gives the transaction up, those that have come belong to the stream nevertheless: the
    /// receiver does not send them again.
    #[must_use]
    pub const fn stream_under_way(&self) -> Option<usize> {
        match self.state {
            State::Receiving(Phase::Stream(len)) if !self.backlog.is_old() => Some(len),
            _ => None,
        }
    }

    /// Serves the tick.
    pub fn poll(&mut self, bus: Bus) -> Order {
        self.backlog.tick();
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
            // The peripheral is no controller any more, so there is nothing to stop.
            return self.give_up(Order::Mute);
        }
        if events.refused {
            return self.give_up(Order::Stop);
        }
        // A bus error needs no answer: erratum "spurious bus error detection in controller mode"; a true one ends at
        // the tick.
        self.spurious += 1;
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
                    Order::PutAddressed(self.message_byte(0).unwrap_or(WAITING))
                }
            },
            State::Writing(Phase::Select(len), _) if events.byte_sent => self.start(Phase::Waiting(len)),
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

    /// The stream has ended: all bytes are there, `first` are the first three of them.
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

    /// The stream has failed.
    pub fn stream_failed(&mut self) -> Order {
        match self.state {
            State::Receiving(_) => self.recover(),
            _ => Order::Nothing,
        }
    }

    /// The time of a level is over.
    pub fn step(&mut self) -> Order {
        let State::Recovering(step) = self.state else { return Order::Nothing };
        self.state = State::Recovering(step.saturating_add(1));
        // The STOP: SDA rises while SCL is high.
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
        if self.state == State::Idle || matches!(self.state, State::Recovering(_)) {
            return Order::Mute;
        }
        self.state = State::Idle;
        // A message that is not taken is gone: whoever sent it notices that no answer comes.
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
mod tests {
    extern crate std;
    use super::*;
    use crate::source::{Rate, MESSAGE};
    use proptest::prelude::*;
    use std::{collections::VecDeque, vec, vec::Vec};

    const FREE: Bus = Bus { scl: true, sda: true, busy: false };

    /// What goes wrong at one order of a cycle.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Fault {
        /// The receiver holds the clock: nothing comes any more; of a read so many bytes have come.
        Held(usize),
        Refused,
        ArbitrationLost,
        /// An event that nobody asked for, so often.
        Spurious(u8),
        BusError,
        StreamFails,
    }

    /// A peripheral with a receiver behind it: carries orders out and calls with what they lead to.
    struct Rig {
        ddc: Ddc,
        waiting: VecDeque<u8>,
        register: u8,
        written: Vec<u8>,
        messages: Vec<Vec<u8>>,
        delivered: Vec<u8>,
        levels: Vec<(bool, bool)>,
        is_there: bool,
        bus: Bus,
    }

    impl Rig {
        /// A receiver that was read empty.
        fn new() -> Self {
            let mut rig = Self::with_backlog();
            rig.cycle(None);
            rig
        }

        /// A receiver that was never read.
        fn with_backlog() -> Self {
            Self {
                ddc: Ddc::new(),
                waiting: VecDeque::new(),
                register: 0xFF,
                written: Vec::new(),
                messages: Vec::new(),
                delivered: Vec::new(),
                levels: Vec::new(),
                is_there: true,
                bus: FREE,
            }
        }

        fn end_of_write(&mut self) {
            match self.written.len() {
                0 => {}
                1 => self.register = self.written[0],
                _ => self.messages.push(self.written.clone()),
            }
            self.written.clear();
        }

        fn read(&mut self, len: usize) -> Vec<u8> {
            let count = (self.waiting.len().min(0xFFFE) as u16).to_be_bytes();
            (0..len)
                .map(|_| {
                    let byte = match self.register {
                        0xFD => count[0],
                        0xFE => count[1],
                        _ => self.waiting.pop_front().unwrap_or(0xFF),
                    };
                    self.register = self.register.saturating_add(1);
                    byte
                })
                .collect()
        }

        fn deliver(&mut self, bytes: &[u8]) -> Order {
            let first = [bytes[0], bytes[1], bytes.get(2).copied().unwrap_or(0)];
            let Received { stream, then } = self.ddc.received(first);
            self.delivered.extend_from_slice(&bytes[stream]);
            then
        }

        /// One cycle; `fault` happens at the order of that number. Gives how many orders there were.
        fn cycle(&mut self, fault: Option<(usize, Fault)>) -> usize {
            let mut order = self.ddc.poll(self.bus);
            let mut orders = 0;
            let mut reads = false;
            let mut starting = false;
            loop {
                assert!(orders < 200, "a cycle has an end");
                let hit = fault.and_then(|(at, fault)| (at == orders).then_some(fault));
                orders += 1;
                let mut events = Events::default();
                let quiet = matches!(order, Order::Nothing | Order::Stop | Order::Mute | Order::Rejoin);
                match hit {
                    Some(Fault::Held(come)) if !quiet => {
                        if let (Order::Receive(len), Some(under_way)) = (order, self.ddc.stream_under_way()) {
                            assert_eq!(len, under_way);
                            let come = self.read(come % len);
                            self.delivered.extend_from_slice(&come);
                        }
                        self.written.clear();
                        return orders;
                    }
                    Some(Fault::Spurious(times)) if !quiet => {
                        for _ in 0..times {
                            let answer = self.ddc.event(Events::default());
                            assert!(matches!(answer, Order::Nothing | Order::Mute));
                            if answer == Order::Mute {
                                return orders;
                            }
                        }
                    }
                    Some(Fault::BusError) => events.bus_error = true,
                    _ => {}
                }
                order = match order {
                    Order::Nothing | Order::Mute | Order::Rejoin => return orders,
                    Order::Stop => {
                        self.end_of_write();
                        return orders;
                    }
                    Order::Start => {
                        self.end_of_write();
                        starting = true;
                        events.started = true;
                        self.ddc.event(events)
                    }
                    Order::Put(_) | Order::PutAddressed(_)
                        if matches!(hit, Some(Fault::Refused | Fault::ArbitrationLost)) =>
                    {
                        events.refused = hit == Some(Fault::Refused);
                        events.arbitration_lost = hit == Some(Fault::ArbitrationLost);
                        self.written.clear();
                        self.ddc.event(events)
                    }
                    Order::Put(address) if starting => {
                        starting = false;
                        assert_eq!(address >> 1, ADDRESS);
                        reads = address & 1 == 1;
                        events.addressed = self.is_there;
                        events.refused = !self.is_there;
                        self.ddc.event(events)
                    }
                    Order::Put(byte) | Order::PutAddressed(byte) => {
                        assert!(!reads, "nothing is written while a read is under way");
                        self.written.push(byte);
                        events.byte_sent = true;
                        self.ddc.event(events)
                    }
                    Order::Receive(_) if hit == Some(Fault::StreamFails) => self.ddc.stream_failed(),
                    Order::Receive(len) => {
                        assert!(reads && (2..=MOST).contains(&len), "a read of {len} bytes");
                        let bytes = self.read(len);
                        self.deliver(&bytes)
                    }
                    Order::Release => {
                        self.levels = vec![(true, true)];
                        self.ddc.step()
                    }
                    Order::Drive { scl, sda } => {
                        self.levels.push((scl, sda));
                        self.ddc.step()
                    }
                };
            }
        }
    }

    #[test]
    fn a_message_is_written_in_a_cycle_of_its_own_and_once() {
        let mut rig = Rig::new();
        rig.waiting.extend([1, 2, 3]);
        let message = Message::new(&[0xB5; MESSAGE], Rate::Usual);
        assert_eq!(rig.ddc.transmit(&message), Ok(()));
        assert_eq!(rig.ddc.transmit(&message), Err(Busy));
        rig.cycle(None);
        assert_eq!((rig.messages.len(), rig.delivered.len()), (1, 0));
        rig.cycle(None);
        assert_eq!((&rig.messages[..], &rig.delivered[..]), (&[vec![0xB5; MESSAGE]][..], &[1, 2, 3][..]));
        assert_eq!(*rig.ddc.counts(), Counts::default());
    }

    #[test]
    fn a_single_byte_is_read_together_with_its_count() {
        let mut rig = Rig::new();
        rig.waiting.push_back(0xFF);
        rig.cycle(None);
        assert_eq!(rig.delivered, [0xFF]);
        rig.cycle(None);
        assert_eq!(rig.delivered, [0xFF], "what is read of an empty stream is not the receiver's");
    }

    #[test]
    fn a_count_of_all_ones_is_none() {
        let mut ddc = Ddc::new();
        ddc.poll(FREE);
        ddc.state = State::Receiving(Phase::Waiting(2));
        assert_eq!(ddc.received([0xFF, 0xFF, 0]), Received { stream: 0..0, then: Order::Stop });
    }

    #[test]
    fn a_receiver_that_is_not_there_costs_one_start_a_cycle_and_no_recovery() {
        let mut rig = Rig::new();
        rig.is_there = false;
        for _ in 0..100 {
            assert!(rig.cycle(None) <= 3);
        }
        assert_eq!(*rig.ddc.counts(), Counts { timed_out: 0, recoveries: 0, refused: 100 });
    }

    #[test]
    fn a_recovery_is_nine_clocks_and_a_stop() {
        let mut rig = Rig::new();
        rig.bus.sda = false;
        rig.cycle(None);
        let rising = rig.levels.windows(2).filter(|pair| !pair[0].0 && pair[1].0).count();
        assert_eq!(rising, 10, "nine clocks, and that of the STOP");
        let stops: Vec<_> = rig.levels.windows(2).filter(|pair| pair[0] == (true, false) && pair[1].1).collect();
        assert_eq!(stops, [[(true, false), (true, true)]], "SDA rises once, while SCL is high");
        let falls = rig.levels.windows(2).filter(|pair| pair[0] == (true, true) && pair[1] == (true, false)).count();
        assert_eq!(falls, 0, "and no START is among it");
        assert_eq!(rig.levels.len(), 23);
    }

    #[test]
    fn a_bus_that_stays_stuck_is_tried_ten_times_a_second_and_a_free_one_at_once() {
        let mut rig = Rig::new();
        rig.waiting.extend([1, 2, 3]);
        rig.bus.scl = false;
        for _ in 0..100 {
            rig.cycle(None);
        }
        assert_eq!(rig.ddc.counts().recoveries, 10);
        rig.bus = FREE;
        rig.cycle(None);
        assert_eq!(rig.delivered, [], "they have waited for a second");
        rig.waiting.extend([4, 5]);
        rig.cycle(None);
        assert_eq!(rig.delivered, [4, 5]);
    }

    #[test]
    fn what_had_waited_before_the_first_read_is_dropped_until_the_receiver_is_empty() {
        let mut rig = Rig::with_backlog();
        rig.waiting.extend(std::iter::repeat_n(1, MOST + 44));
        rig.cycle(None);
        rig.waiting.extend([2, 2]);
        rig.cycle(None);
        assert!(rig.waiting.is_empty() && rig.delivered.is_empty());
        rig.waiting.push_back(3);
        rig.cycle(None);
        assert_eq!(rig.delivered, [3]);
        let mut rig = Rig::with_backlog();
        rig.waiting.push_back(1);
        rig.cycle(None);
        rig.waiting.extend([2, 2]);
        rig.cycle(None);
        assert_eq!(rig.delivered, [2, 2], "a single byte is an empty receiver's last, too");
    }

    #[test]
    fn what_is_read_after_one_failed_cycle_is_kept_and_after_two_it_is_dropped() {
        for (failures, kept) in [(1, true), (2, false)] {
            let mut rig = Rig::new();
            rig.waiting.extend([1, 2, 3]);
            for _ in 0..failures {
                rig.is_there = false;
                rig.cycle(None);
                rig.is_there = true;
            }
            rig.cycle(None);
            assert_eq!(!rig.delivered.is_empty(), kept, "{failures}");
        }
    }

    #[test]
    fn a_receiver_that_says_more_than_is_read_is_believed_again_when_it_has_been_read_empty() {
        let mut rig = Rig::new();
        rig.waiting.extend(std::iter::repeat_n(1, 3 * MOST));
        rig.cycle(None);
        assert_eq!(rig.delivered.len(), MOST, "one cycle's more is read in the next");
        rig.cycle(None);
        rig.cycle(None);
        assert!(rig.waiting.is_empty());
        assert_eq!(rig.delivered.len(), MOST);
        rig.waiting.push_back(2);
        rig.cycle(None);
        assert_eq!(rig.delivered.len(), MOST + 1);
    }

    #[test]
    fn bytes_of_a_transaction_that_is_given_up_are_not_kept_while_they_are_old() {
        for (ddc, kept) in [(Rig::new().ddc, Some(7)), (Ddc::new(), None)] {
            let mut ddc = ddc;
            ddc.state = State::Receiving(Phase::Stream(7));
            assert_eq!(ddc.stream_under_way(), kept);
        }
    }

    #[test]
    fn one_that_lets_go_of_the_clock_but_not_of_data_is_freed_in_the_next_cycle() {
        let mut rig = Rig::new();
        rig.bus.scl = false;
        rig.cycle(None);
        rig.cycle(None);
        assert_eq!(rig.ddc.counts().recoveries, 1);
        rig.bus = Bus { sda: false, ..FREE };
        rig.cycle(None);
        assert_eq!(rig.ddc.counts().recoveries, 2);
    }

    #[test]
    fn events_without_progress_are_switched_off() {
        let mut ddc = Ddc::new();
        ddc.poll(FREE);
        let calls = (0..1_000).take_while(|_| ddc.event(Events::default()) != Order::Mute).count();
        assert_eq!(calls, usize::from(MOST_SPURIOUS) - 1);
        assert_eq!(ddc.poll(FREE), Order::Release);
    }

    #[test]
    fn a_missing_timer_does_not_end_the_recoveries() {
        let mut ddc = Ddc::new();
        assert_eq!(ddc.poll(Bus { sda: false, ..FREE }), Order::Release);
        assert_eq!(ddc.poll(FREE), Order::Release);
        assert_eq!(*ddc.counts(), Counts { timed_out: 1, recoveries: 2, refused: 0 });
    }

    fn any_fault() -> impl Strategy<Value = Fault> {
        prop_oneof![
            (0..MOST).prop_map(Fault::Held),
            Just(Fault::Refused),
            Just(Fault::ArbitrationLost),
            (1..40_u8).prop_map(Fault::Spurious),
            Just(Fault::BusError),
            Just(Fault::StreamFails),
        ]
    }

    /// Whether `part` is `whole` with some left out.
    fn is_left_of(part: &[u8], whole: &[u8]) -> bool {
        let mut whole = whole.iter();
        part.iter().all(|byte| whole.any(|other| other == byte))
    }

    proptest! {
        #[test]
        fn every_byte_is_delivered_once_and_in_order(
            bursts in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..=MOST), 1..20),
        ) {
            let mut rig = Rig::new();
            let mut sent = Vec::new();
            for burst in bursts {
                rig.waiting.extend(&burst);
                sent.extend(burst);
                rig.cycle(None);
            }
            while !rig.waiting.is_empty() {
                rig.cycle(None);
            }
            prop_assert_eq!(rig.delivered, sent);
            prop_assert_eq!(*rig.ddc.counts(), Counts::default());
        }

        #[test]
        fn whatever_goes_wrong_ends_with_its_cycle_and_invents_nothing(
            cycles in proptest::collection::vec(
                (proptest::collection::vec(any::<u8>(), 0..200), any::<bool>(), 0..60_usize, any_fault()), 1..60),
        ) {
            let mut rig = Rig::new();
            let mut sent = Vec::new();
            for (burst, has_message, at, fault) in cycles {
                rig.waiting.extend(&burst);
                sent.extend(burst);
                if has_message {
                    // Refused only while the one before has not been tried.
                    let _ = rig.ddc.transmit(&Message::new(&[1; MESSAGE], Rate::Usual));
                }
                // The longest: a message, and 23 levels.
                prop_assert!(rig.cycle(Some((at, fault))) <= MESSAGE + 24 + 4);
            }
            // Without faults everything that is sent from now on comes, from the second cycle on.
            rig.cycle(None);
            rig.cycle(None);
            while !rig.waiting.is_empty() {
                rig.cycle(None);
            }
            prop_assert!(is_left_of(&rig.delivered, &sent));
            let before = rig.delivered.len();
            rig.waiting.extend(0..200_u8);
            rig.cycle(None);
            prop_assert_eq!(&rig.delivered[before..], &(0..200_u8).collect::<Vec<_>>()[..]);
        }
    }
}
