//! HORUS's surroundings with their faults: its receivers and the antenna of its front end.

use std::collections::VecDeque;

use bench_judge::{Board as Side, Bytes, Event, What};
use cortex_m4::Cost;
use emulator_part::UartFrame;
use gnss_sim::{Burst, Receiver};
use horus_tx_fw::timing::{GNSS_BAUD, TICK_PULSE_TICKS, TICKS_PER_US};
use profile::Layout;
use st25r3916_model::AirEvent;

use super::board_events::BoardEvents;
use super::marks::of_tasks;
use crate::boards::front_end::Crossing;
use crate::boards::receivers::{ReadBytes, SentByte};
use crate::boards::{Horus, InputChange};
use crate::faults::receivers::{LineFaults, OnLine, ReceiverFault};
use crate::faults::{Fault, Faults, Timeline, Turn, WireFault, Wires};
use crate::trace::{self, Mark, TaskWatch, Wire};
use emulator_node::{LogLine, Node, Upstream};
use gnss_sim::Port;

/// The time for which the pin TICK is high before each tick, ns.
const TICK_PULSE_NS: u64 = TICK_PULSE_TICKS as u64 * 1_000 / TICKS_PER_US as u64;

/// The time from the end of a message of HORUS to the receiver's answer, ns. Real receivers take some tens of
/// milliseconds.
const ANSWERS_AFTER: u64 = 20_000_000;
/// How long a receiver ignores its input after a change of its bit rate, ns (u-blox integration manuals).
const DEAF_AFTER_BAUD: u64 = 100_000_000;
/// How long a restarting receiver neither sends nor receives, ns.
const STARTS: u64 = 300_000_000;

#[derive(Clone, Debug)]
struct Feed {
    receiver: Receiver,
    burst_at: u64,
    /// The receiver's answers to messages of HORUS, each with the instant (ns) at which it is sent.
    answers: VecDeque<(u64, Vec<u8>)>,
    /// The instant before which the receiver ignores its input, ns.
    deaf_until: u64,
}

impl Feed {
    fn new(mut receiver: Receiver) -> Self {
        let burst_at = receiver.next_at().unwrap_or(u64::MAX);
        Self { receiver, burst_at, answers: VecDeque::new(), deaf_until: 0 }
    }

    fn next_at(&self) -> u64 {
        self.burst_at.min(self.answers.front().map_or(u64::MAX, |(at, _)| *at))
    }

    fn take(&mut self, at: u64) -> Option<Burst> {
        if self.next_at() > at {
            return None;
        }
        if let Some((at_ns, bytes)) = self.answers.pop_front_if(|(answered, _)| *answered <= self.burst_at) {
            return Some(Burst { at_ns, bytes });
        }
        let burst = self.receiver.next();
        self.burst_at = self.receiver.next_at().unwrap_or(u64::MAX);
        burst
    }

    /// Passes a byte that HORUS has sent, and that had arrived by `at` (ns), to the receiver; `None` stands for an
    /// unreadable byte.
    fn hear(&mut self, at: u64, byte: Option<u8>) {
        if at < self.deaf_until {
            return;
        }
        let rate = self.receiver.bit_rate();
        if let Some(answer) = self.receiver.hear(at, byte) {
            self.answers.push_back((at + ANSWERS_AFTER, answer));
            self.burst_at = self.receiver.next_at().unwrap_or(u64::MAX);
            if self.receiver.bit_rate() != rate {
                self.deaf_until = at + DEAF_AFTER_BAUD;
            }
        }
    }

    /// Restarts the receiver at `at` (ns). Settings that it has not saved are lost.
    fn lose_settings(&mut self, at: u64) {
        self.answers.clear();
        self.deaf_until = at + STARTS;
        self.receiver.restart(at + STARTS, true);
        self.burst_at = self.receiver.next_at().unwrap_or(u64::MAX);
    }
}

#[derive(Clone, Debug)]
pub(super) struct Receivers {
    feeds: Vec<Feed>,
    /// The settings of each receiver that were last logged: the number of its dynamic model, and whether the receiver
    /// sends positions.
    settings: Vec<Option<(u8, bool)>>,
    lines: LineFaults,
    faults: Timeline,
    events: BoardEvents,
    wires: Wires,
    seed: u64,
    marks: Vec<Mark>,
    tasks: Option<TaskWatch>,
}

impl Receivers {
    pub(super) fn new(receivers: Vec<Receiver>, layout: Layout, faults: &Faults, seed: u64) -> Self {
        Self {
            settings: vec![None; receivers.len()],
            feeds: receivers.into_iter().map(Feed::new).collect(),
            lines: LineFaults::new(seed),
            faults: faults.timeline(true),
            events: BoardEvents::new(Side::Horus),
            wires: Wires::new(layout, seed),
            seed,
            marks: vec![],
            tasks: None,
        }
    }

    pub(super) fn watch_tasks(&mut self, tasks: TaskWatch) {
        self.tasks = Some(tasks);
    }

    pub(super) fn add_faults(&mut self, faults: &Faults) {
        self.faults.add(faults.timeline(true));
    }

    /// Passes the ticks since the last call through the wire TICK, whose faults may change them.
    fn watch_ticks<C: Cost>(&mut self, node: &mut Node<Horus, C>) {
        let ticks = node.board_mut(Horus::take_ticks);
        for at in ticks.into_iter().flat_map(|at| self.wires.tick(at)) {
            self.events.note(at, What::Tick);
            let rose = at.saturating_sub(TICK_PULSE_NS);
            self.marks.extend([Mark::Level(rose, Wire::HorusTick, true), Mark::Level(at, Wire::HorusTick, false)]);
        }
    }

    /// Logs the changes of HORUS's state inputs, unless a fault hides them.
    fn watch_inputs<C: Cost>(&mut self, node: &mut Node<Horus, C>) {
        for InputChange { at, input, active, inactive } in node.board_mut(Horus::take_input_changes) {
            if self.wires.shows_inputs() {
                self.events.note(at, What::StateInput { input, active, inactive });
            }
        }
    }

    fn watch_settings(&mut self, now: u64) {
        for (receiver, (feed, told)) in self.feeds.iter().zip(&mut self.settings).enumerate() {
            let model = feed.receiver.dynamic_model();
            let set = model.zip(feed.receiver.output()).map(|(model, output)| (model, output.position > 0));
            if let Some((model, position)) = set.filter(|set| *told != Some(*set)) {
                *told = Some((model, position));
                self.events.note(now, What::Settings { receiver, model, position });
            }
        }
    }

    fn watch_buses<C: Cost>(&mut self, node: &mut Node<Horus, C>) {
        let now = node.now();
        let (given, misuses) = node.board_mut(|board| (board.receivers.take_read(now), board.receivers.take_misuses()));
        for ReadBytes { receiver, at, byte_ns, bytes, clean, since } in given {
            self.events.note(at, What::Fed { receiver, byte_ns, bytes: Bytes(bytes), clean, since: Some(since) });
        }
        for (at, text) in misuses {
            self.events.note(at, What::Misuse { board: Side::Horus, text });
        }
    }

    /// Passes the frames and bytes of `lines` to the board and into the log.
    fn feed<C: Cost>(&mut self, node: &mut Node<Horus, C>, lines: Vec<OnLine>) {
        for OnLine { at_ns, receiver, frames, clean } in lines {
            let bytes: Vec<u8> = frames.iter().map(|frame| frame.data as u8).collect();
            if Port::OF[receiver] != Port::Uart1 {
                // On a bus the receiver only offers its bytes. The board reports later when HORUS has read them.
                node.board_mut(|board| board.receivers.offer(at_ns, receiver, &bytes));
                self.events.note(at_ns.max(node.now()), What::Offered { receiver, bytes: Bytes(bytes) });
                continue;
            }
            // The receiver's frames are generated at the link's usual bit rate. They are converted if the receiver uses
            // another rate at present.
            let baud = self.feeds[receiver].receiver.bit_rate();
            let (frames, clean) = if baud == GNSS_BAUD { (frames, clean) } else { (at_rate(frames, baud), false) };
            let begins = node.board_mut(|board| board.receivers.send(at_ns, receiver, frames));
            let byte_ns = UartFrame::eight_n_one(0, baud).ns();
            self.events.note(begins, What::Fed { receiver, byte_ns, bytes: Bytes(bytes), clean, since: None });
        }
    }
}

fn at_rate(frames: Vec<UartFrame>, baud: u32) -> Vec<UartFrame> {
    let at = |frame: UartFrame| {
        let byte = frame.data as u8;
        if frame == UartFrame::eight_n_one(byte, GNSS_BAUD) { UartFrame::eight_n_one(byte, baud) } else { frame }
    };
    frames.into_iter().map(at).collect()
}

/// An upper limit of a byte's duration on a receiver's bus, ns. A byte is logged with the instant of its beginning, but
/// that instant is known only when the byte ends.
const ON_THE_WAY: u64 = 100_000;

/// The results of HORUS's side of the simulation, for the DPR's side, which is simulated later.
#[derive(Clone, Debug)]
pub(super) struct Notes {
    pub(super) lines: Vec<LogLine>,
    pub(super) events: Vec<Event>,
    pub(super) crossings: Vec<(u64, Crossing)>,
    /// The signals of TICK and of HORUS's tasks, for the trace.
    pub(super) marks: Vec<Mark>,
    /// The beginning, ns, of an unfinished transaction with a receiver. Its bytes are logged at its end.
    pub(super) untold_since: u64,
}

impl<C: Cost> Upstream<Horus, C> for Receivers {
    type Message = AirEvent;
    type Notes = Notes;

    fn leave(&mut self, node: &mut Node<Horus, C>, sent: &mut Vec<(u64, AirEvent)>) {
        let Self { feeds, .. } = self;
        node.board_mut(|board| {
            sent.extend(board.front_end.take_air());
            for SentByte { at, receiver, byte } in board.receivers.take_sent() {
                let Some(feed) = feeds.get_mut(receiver) else { continue };
                feed.hear(at, byte);
                board.receivers.listen_at(receiver, feed.receiver.bit_rate());
            }
        });
    }

    fn notes(&mut self, node: &mut Node<Horus, C>) -> Notes {
        let (transmits, crossings) =
            node.board_mut(|board| (board.front_end.take_transmits(), board.front_end.take_crossings()));
        for at in transmits {
            self.events.note(at, What::Command);
        }
        self.watch_ticks(node);
        self.watch_inputs(node);
        self.watch_buses(node);
        self.watch_settings(node.now());
        let untold_since = node.board().receivers.untold_since().min(node.now().saturating_sub(ON_THE_WAY));
        let mut marks = std::mem::take(&mut self.marks);
        self.events.watch(node);
        if let Some(tasks) = &mut self.tasks {
            marks.extend(of_tasks(trace::Board::Horus, tasks.take(node)));
        }
        Notes { lines: node.take_log(), events: self.events.take(), crossings, marks, untold_since }
    }

    fn next_at(&self) -> u64 {
        let bursts = self.feeds.iter().map(Feed::next_at).min().unwrap_or(u64::MAX);
        bursts.min(self.lines.next_at()).min(self.faults.next_at())
    }

    fn act(&mut self, at: u64, node: &mut Node<Horus, C>) {
        while let Some(turn) = self.faults.take(at) {
            let (Turn::Begins(episode) | Turn::Ends(episode)) = &turn else {
                self.events.turn(node, &turn);
                continue;
            };
            let begins = matches!(turn, Turn::Begins(_));
            match episode.fault {
                Fault::Receiver(receiver, ReceiverFault::LosesSettings) => {
                    if begins && let Some(feed) = self.feeds.get_mut(receiver) {
                        self.events.injected(node.now(), episode);
                        feed.lose_settings(node.now());
                        let baud = feed.receiver.bit_rate();
                        node.board_mut(|board| board.receivers.listen_at(receiver, baud));
                    }
                }
                Fault::Receiver(receiver, ReceiverFault::ForgetsModel) => {
                    if begins && let Some(feed) = self.feeds.get_mut(receiver) {
                        self.events.injected(node.now(), episode);
                        feed.receiver.forget_dynamic_model();
                    }
                }
                Fault::Receiver(receiver, ReceiverFault::Bus(fault)) => {
                    let now = node.now();
                    if begins {
                        self.events.injected(now, episode);
                        let seed = self.seed ^ episode.at;
                        node.board_mut(|board| board.receivers.begin_fault(now, receiver, fault, seed));
                    } else {
                        node.board_mut(|board| board.receivers.end_fault(receiver, fault));
                    }
                }
                Fault::Receiver(receiver, fault) if begins => {
                    self.events.injected(node.now(), episode);
                    self.lines.begin(node.now(), episode.until, receiver, fault);
                }
                Fault::Receiver(receiver, fault) => self.lines.end(receiver, fault),
                Fault::Input(input, says) => {
                    if begins {
                        self.events.injected(node.now(), episode);
                    }
                    let now = node.now();
                    node.board_mut(|board| board.set_input(now, input, begins.then_some(says)));
                }
                Fault::Wire(WireFault::Sky(fault)) => {
                    if begins {
                        self.events.injected(node.now(), episode);
                    }
                    for receiver in 0..self.feeds.len() {
                        if begins {
                            self.lines.begin(node.now(), episode.until, receiver, fault);
                        } else {
                            self.lines.end(receiver, fault);
                        }
                    }
                }
                Fault::Wire(fault) => {
                    // Earlier ticks pass through the wire before the new fault begins.
                    self.watch_ticks(node);
                    self.watch_inputs(node);
                    if begins {
                        self.events.injected(node.now(), episode);
                        self.wires.begin(fault);
                    } else {
                        self.wires.end(fault);
                    }
                }
                Fault::FrontEnd(fault) if begins => {
                    self.events.injected(node.now(), episode);
                    let now = node.now();
                    node.board_mut(|board| board.front_end.begin_fault(now, fault));
                }
                Fault::FrontEnd(fault) => {
                    let now = node.now();
                    node.board_mut(|board| board.front_end.end_fault(now, fault));
                }
                _ => self.events.turn(node, &turn),
            }
        }
        for index in 0..self.feeds.len() {
            while let Some(burst) = self.feeds[index].take(at) {
                if !burst.bytes.is_empty() {
                    let lines = self.lines.burst(burst.at_ns, index, &burst.bytes);
                    self.feed(node, lines);
                }
            }
        }
        let lines = self.lines.take(at);
        self.feed(node, lines);
    }
}
