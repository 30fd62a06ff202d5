//! A board that has only leads at the part's pins. Some pins are watched, some are driven, and some have a UART at the
//! far end.

use std::collections::{BTreeMap, BTreeSet};
use std::marker::PhantomData;

use emulator_part::{Pad, Part, Pin, SpiFrame, UartFrame};

use super::{Board, Input};

/// A change of a watched pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEdge {
    /// The instant of the change, in virtual nanoseconds.
    pub at: u64,
    /// The pin that changed.
    pub pin: Pin,
    /// The state in which the part holds the pin from then on.
    pub pad: Pad,
}

/// A change of the level that is driven from outside onto a watched pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrivenEdge {
    /// The instant of the change, in virtual nanoseconds.
    pub at: u64,
    /// The pin that is driven.
    pub pin: Pin,
    /// The level from then on; `None` if the pin is no longer driven from outside.
    pub level: Option<bool>,
}

/// A level that is driven onto a pin from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drive {
    /// The instant from which the level is driven, in virtual nanoseconds.
    pub at: u64,
    /// The pin onto which the level is driven.
    pub pin: Pin,
    /// Whether the level is high.
    pub level: bool,
}

/// Bytes that are sent to a UART one after the other, with eight bits, no parity and one stop bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sending {
    /// The instant at which the first byte begins, in virtual nanoseconds.
    pub at: u64,
    /// The pin at which the bytes arrive.
    pub pin: Pin,
    /// The baud rate in bits per second.
    pub baud: u32,
    /// The bytes to send to the pin, in order.
    pub bytes: Vec<u8>,
}

/// The leads that connect the pins of a part that has no board.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Connected {
    /// The pins whose changes are reported. A change within a UART or SPI frame is reported at the end of the frame at
    /// the latest. The levels of I2C are not reported.
    pub watched: Vec<Pin>,
    /// The levels that are driven onto pins from outside.
    pub driven: Vec<Drive>,
    /// The pins whose UART frames are collected as bytes.
    pub listened: Vec<Pin>,
    /// The bytes that are sent to pins.
    pub sent: Vec<Sending>,
    /// Pairs of pins with a wire between them. A level or UART frame that the part sends on one pin arrives at the
    /// other.
    pub wires: Vec<[Pin; 2]>,
}

/// A byte that the part sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SentByte {
    /// The instant at which the byte's stop bit ended, in virtual nanoseconds.
    pub at: u64,
    /// The pin on which the byte was sent.
    pub pin: Pin,
    /// The value of the byte.
    pub byte: u8,
}

/// A board that has only leads at the part's pins.
#[derive(Clone, Debug)]
pub struct Leads<P> {
    wires: Vec<[Pin; 2]>,
    watched: BTreeSet<Pin>,
    listened: BTreeSet<Pin>,
    pads: BTreeMap<Pin, Pad>,
    edges: Vec<PinEdge>,
    driven: Vec<DrivenEdge>,
    heard: Vec<SentByte>,
    /// The inputs that the part has yet to get, by their instant and then by their order.
    plan: BTreeMap<(u64, u64), Input>,
    planned: u64,
    /// For each pin to which bytes are sent, the instant, ns, at which the line is free for the next byte.
    free_at: BTreeMap<Pin, u64>,
    awaited: Option<Pin>,
    arrived: bool,
    part: PhantomData<P>,
}

impl<P> Leads<P> {
    /// Makes a board with these leads.
    #[must_use]
    pub fn new(connected: Connected) -> Self {
        let mut leads = Self {
            wires: connected.wires,
            watched: connected.watched.into_iter().collect(),
            listened: connected.listened.into_iter().collect(),
            pads: BTreeMap::new(),
            edges: vec![],
            driven: vec![],
            heard: vec![],
            plan: BTreeMap::new(),
            planned: 0,
            free_at: BTreeMap::new(),
            awaited: None,
            arrived: false,
            part: PhantomData,
        };
        for Sending { at, pin, baud, bytes } in connected.sent {
            leads.plan(0, Input::Level(pin, Some(true)));
            leads.send(at, pin, baud, &bytes);
        }
        for Drive { at, pin, level } in connected.driven {
            leads.plan(at, Input::Level(pin, Some(level)));
        }
        leads
    }

    fn plan(&mut self, at: u64, input: Input) {
        self.plan.insert((at, self.planned), input);
        self.planned += 1;
    }

    /// Drives `pin` from `at` (ns) on (`Some`), or stops driving it (`None`).
    pub fn drive(&mut self, at: u64, pin: Pin, level: Option<bool>) {
        self.plan(at, Input::Level(pin, level));
    }

    /// Sends bytes to a UART's pin as [`Sending`] says, from `at` (ns) on or once all earlier bytes are sent.
    pub fn send(&mut self, at: u64, pin: Pin, baud: u32, bytes: &[u8]) {
        let mut at = at.max(self.free_at.get(&pin).copied().unwrap_or(0));
        for &byte in bytes {
            let frame = UartFrame::eight_n_one(byte, baud.max(1));
            // A UART frame reaches the part as an input at the frame's end, and states the instant at which it began.
            self.plan(at + frame.ns(), Input::Frame(pin, at, frame));
            at += frame.ns();
        }
        self.free_at.insert(pin, at);
    }

    /// Watches `pin` from now on, as if it were in [`Connected::watched`].
    pub fn watch(&mut self, pin: Pin) {
        self.watched.insert(pin);
    }

    /// Makes [`super::Node::advance`] return at each change of `pin` and at each byte that is sent on it. Changes count
    /// only for a watched pin, and bytes only for a pin whose bytes are collected.
    pub fn wait_for(&mut self, pin: Option<Pin>) {
        self.awaited = pin;
    }

    /// Takes the changes of watched pins since the last call, in order.
    pub fn take_edges(&mut self) -> Vec<PinEdge> {
        self.arrived = false;
        self.edges.sort_by_key(|edge| edge.at);
        std::mem::take(&mut self.edges)
    }

    /// Takes, in order, the changes since the last call of the levels driven from outside onto watched pins.
    pub fn take_driven(&mut self) -> Vec<DrivenEdge> {
        self.driven.sort_by_key(|edge| edge.at);
        std::mem::take(&mut self.driven)
    }

    /// Records the new state of `pin` at `at` (ns), if the pin is watched and its state has changed.
    fn note(&mut self, at: u64, pin: Pin, pad: Pad) {
        if self.pads.insert(pin, pad) != Some(pad) && self.watched.contains(&pin) {
            self.edges.push(PinEdge { at, pin, pad });
            self.arrived |= self.awaited == Some(pin);
        }
    }

    /// Records a level within a frame. Between frames [`Board::pin`] reports the pin's level.
    fn note_bit(&mut self, at: u64, pin: Pin, level: bool) {
        if self.watched.contains(&pin) {
            self.note(at, pin, Pad::Driven(level));
        }
    }

    fn note_driven(&mut self, at: u64, pin: Pin, level: Option<bool>) {
        if self.watched.contains(&pin) {
            self.driven.push(DrivenEdge { at, pin, level });
        }
    }

    /// Takes the bytes that the part sent since the last call, in order.
    pub fn take_sent(&mut self) -> Vec<SentByte> {
        std::mem::take(&mut self.heard)
    }

    /// Passes an input on to the pins that a wire joins to `pin`.
    fn carry(&mut self, at: u64, pin: Pin, input: impl Fn(Pin) -> Input) {
        for index in 0..self.wires.len() {
            let [one, other] = self.wires[index];
            for (from, to) in [(one, other), (other, one)] {
                if from == pin {
                    self.plan(at, input(to));
                }
            }
        }
    }
}

impl<P: Part> Board for Leads<P> {
    type Part = P;

    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        self.note(at, pin, pad);
        let level = match pad {
            Pad::Driven(level) => Some(level),
            Pad::Pulled(_) | Pad::Floating => None,
        };
        self.carry(at, pin, |to| Input::Level(to, level));
    }

    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let halves = 2 * u64::from(frame.bits.max(1));
        let at = |half: i64| begins.saturating_add_signed((ends - begins) as i64 * half / halves as i64);
        for pin in frame.mosi.into_iter().flatten() {
            frame.mosi_levels().for_each(|(half, level)| self.note_bit(at(half), pin, level));
        }
        for pin in frame.sck.into_iter().flatten() {
            frame.clock_levels().for_each(|(half, level)| self.note_bit(at(half as i64), pin, level));
        }
        None
    }

    fn uart(&mut self, at: u64, pin: Pin, frame: &UartFrame) {
        let began = at.saturating_sub(frame.ns());
        for (after_ps, level) in frame.levels() {
            self.note_bit(began + (after_ps + 500) / 1_000, pin, level);
        }
        if self.listened.contains(&pin) {
            self.heard.push(SentByte { at, pin, byte: (frame.data & 0xFF) as u8 });
            self.arrived |= self.awaited == Some(pin);
        }
        self.carry(at, pin, |to| Input::Frame(to, at.saturating_sub(frame.ns()), *frame));
    }

    fn next_event(&self) -> u64 {
        self.plan.first_key_value().map_or(u64::MAX, |(&(at, _), _)| at)
    }

    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        while self.next_event() <= at
            && let Some(((due, _), input)) = self.plan.pop_first()
        {
            match input {
                Input::Level(pin, level) => self.note_driven(due, pin, level),
                Input::Frame(pin, began, frame) => {
                    let level = |(after_ps, level): (u64, bool)| (began + (after_ps + 500) / 1_000, Some(level));
                    frame.levels().map(level).for_each(|(at, level)| self.note_driven(at, pin, level));
                }
            }
            inputs.push(input);
        }
    }

    fn outgoing(&self) -> bool {
        self.arrived
    }
}

#[cfg(test)]
mod tests {
    use emulator_part::{SpiMode, UartParity};
    use nrf52840::Nrf52840;

    use super::*;

    const ONE: Pin = Pin::new(0, 2);
    const OTHER: Pin = Pin::new(0, 3);

    fn settled(leads: &mut Leads<Nrf52840>, at: u64) -> Vec<Input> {
        let mut inputs = vec![];
        leads.settle(at, &mut inputs);
        inputs
    }

    #[test]
    fn a_wire_carries_what_is_driven_on_either_end_to_the_other() {
        let connected = Connected { wires: vec![[ONE, OTHER]], ..Connected::default() };
        let mut leads = Leads::<Nrf52840>::new(connected);
        for (from, to) in [(ONE, OTHER), (OTHER, ONE)] {
            for (pad, level) in [
                (Pad::Driven(true), Some(true)),
                (Pad::Driven(false), Some(false)),
                (Pad::Pulled(true), None),
                (Pad::Floating, None),
            ] {
                leads.pin(5, from, pad);
                assert_eq!(leads.next_event(), 5);
                assert_eq!(settled(&mut leads, 5), [Input::Level(to, level)]);
            }
        }
        leads.pin(6, Pin::new(1, 2), Pad::Driven(true));
        assert_eq!(settled(&mut leads, 6), []);
    }

    fn changes(leads: &mut Leads<Nrf52840>) -> Vec<(u64, Pad)> {
        leads.take_edges().into_iter().map(|edge| (edge.at, edge.pad)).collect()
    }

    #[test]
    fn a_watched_pin_shows_the_bits_of_a_uart_frame() {
        let mut leads = Leads::<Nrf52840>::new(Connected { watched: vec![ONE], ..Connected::default() });
        leads.pin(0, ONE, Pad::Driven(true));
        // The frame has 0x43 with even parity, at 1 Mbit/s: the bits are 0 11000010 1 1.
        let frame = UartFrame { parity: UartParity::Even, ..UartFrame::eight_n_one(0x43, 1_000_000) };
        leads.uart(20_000, ONE, &frame);
        leads.uart(20_000, OTHER, &frame);
        let levels = [(0, true), (9, false), (10, true), (12, false), (16, true), (17, false), (18, true)];
        assert_eq!(changes(&mut leads), levels.map(|(us, level)| (us * 1_000, Pad::Driven(level))));
        // The line is high before the next frame, which therefore begins with an edge.
        leads.uart(40_000, ONE, &UartFrame::eight_n_one(0xFF, 1_000_000));
        assert_eq!(changes(&mut leads), [(30_000, Pad::Driven(false)), (31_000, Pad::Driven(true))]);
    }

    #[test]
    fn watched_pins_show_clock_and_data_of_an_spi_frame() {
        const NS: u64 = 1_000;
        for (mode, idle, data) in [
            (SpiMode::Mode0, false, [(900, true), (1_100, false), (1_300, true)]),
            (SpiMode::Mode1, false, [(1_000, true), (1_200, false), (1_400, true)]),
            (SpiMode::Mode2, true, [(900, true), (1_100, false), (1_300, true)]),
            (SpiMode::Mode3, true, [(1_000, true), (1_200, false), (1_400, true)]),
        ] {
            let mut leads = Leads::<Nrf52840>::new(Connected { watched: vec![ONE, OTHER], ..Connected::default() });
            let pins = |pin| [Some(pin), None];
            let frame = SpiFrame {
                sck: pins(ONE),
                mosi: pins(OTHER),
                miso: None,
                mode,
                bits: 4,
                data: 0b1011,
                begins: 0,
                ends: 0,
            };
            for pin in [ONE, OTHER] {
                leads.pin(0, pin, Pad::Driven(pin == ONE && idle));
            }
            assert_eq!(leads.spi(NS, NS + 800, &frame), None);
            let edges = leads.take_edges();
            assert!(edges.is_sorted_by_key(|edge| edge.at));
            let of = |pin| edges.iter().filter(move |edge| edge.pin == pin).skip(1).map(|edge| (edge.at, edge.pad));
            let clock: Vec<_> = (0..8).map(|half| (NS + 100 * half, Pad::Driven((half % 2 == 0) != idle))).collect();
            assert_eq!(of(ONE).collect::<Vec<_>>(), clock, "{mode:?}");
            assert_eq!(of(OTHER).collect::<Vec<_>>(), data.map(|(at, level)| (at, Pad::Driven(level))), "{mode:?}");
        }
    }

    #[test]
    fn a_frame_crosses_a_wire_at_its_end() {
        let driven = vec![Drive { at: 1_000_000, pin: OTHER, level: true }];
        let connected = Connected { wires: vec![[ONE, OTHER]], driven, ..Connected::default() };
        let mut leads = Leads::<Nrf52840>::new(connected);
        let frame = UartFrame::eight_n_one(0x55, 115_200);
        let at = 500_000;
        leads.uart(at, ONE, &frame);
        assert_eq!(settled(&mut leads, at - 1), []);
        assert_eq!(settled(&mut leads, at), [Input::Frame(OTHER, at - frame.ns(), frame)]);
        assert_eq!(leads.next_event(), 1_000_000);
    }

    #[test]
    fn bytes_that_are_sent_later_follow_those_on_the_line() {
        let mut leads = Leads::<Nrf52840>::new(Connected::default());
        let frame = |byte| UartFrame::eight_n_one(byte, 1_000_000);
        leads.send(0, ONE, 1_000_000, b"ab");
        leads.send(5_000, ONE, 1_000_000, b"c");
        leads.send(5_000, OTHER, 1_000_000, b"d");
        let sent = [(ONE, 0, b'a'), (OTHER, 5_000, b'd'), (ONE, 10_000, b'b'), (ONE, 20_000, b'c')];
        assert_eq!(settled(&mut leads, 50_000), sent.map(|(pin, at, byte)| Input::Frame(pin, at, frame(byte))));
    }

    #[test]
    fn the_board_holds_its_node_up_for_the_awaited_pin_alone() {
        let connected = Connected { watched: vec![ONE, OTHER], listened: vec![ONE], ..Connected::default() };
        let mut leads = Leads::<Nrf52840>::new(connected);
        leads.wait_for(Some(ONE));
        leads.pin(1, OTHER, Pad::Driven(true));
        assert!(!leads.outgoing());
        leads.pin(2, ONE, Pad::Driven(true));
        assert!(leads.outgoing());
        leads.take_edges();
        assert!(!leads.outgoing(), "it was taken");
        leads.uart(100_000, ONE, &UartFrame::eight_n_one(0xFF, 1_000_000));
        assert!(leads.outgoing());
    }

    #[test]
    fn what_the_outside_drives_onto_a_watched_pin_is_told() {
        let driven = vec![Drive { at: 3_000, pin: ONE, level: true }, Drive { at: 3_000, pin: OTHER, level: true }];
        let mut leads = Leads::<Nrf52840>::new(Connected { watched: vec![ONE], driven, ..Connected::default() });
        leads.drive(4_000, ONE, None);
        settled(&mut leads, 5_000);
        let edge = |at, level| DrivenEdge { at, pin: ONE, level };
        assert_eq!(leads.take_driven(), [edge(3_000, Some(true)), edge(4_000, None)]);
    }
}
