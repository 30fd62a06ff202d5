//! What a core accesses while it runs: the part, the board around it, and the clock between them.

use std::collections::VecDeque;

use cortex_m4::{Access, Bound, Bus, BusError, Signals, Width};
use emulator_part::{Clock, Cycle, NEVER, Part, Reset, Timebase};

use super::LineEdge;
use super::board::{Board, Input, View};
use super::finding::Finding;

const PERIPHERALS: u32 = 0x4000_0000;
const RAM: u32 = 0x2000_0000;

/// The number of earlier clocks that are kept. A restart changes the clock three times.
const CHANGES: usize = 16;

#[derive(Clone, Debug)]
pub(super) struct Side<B: Board> {
    pub(super) part: B::Part,
    pub(super) board: B,
    pub(super) time: Timebase,
    /// The earlier clocks, each with the cycle at which it ended, oldest first.
    before: VecDeque<(Cycle, Timebase)>,
    pub(super) clock: Clock,
    /// How long the core was awake up to the last change of its clock, in ns. The second number is the same in cycles.
    pub(super) awake: (u64, u64),
    pub(super) touched: bool,
    /// The cycle at which a chip of the board next acts. `board_event` is the same instant in ns.
    pub(super) board_due: Cycle,
    board_event: u64,
    pub(super) inputs: Vec<Input>,
    pub(super) reset: Option<Reset>,
    pub(super) watched: Vec<(u16, bool)>,
    pub(super) edges: Vec<LineEdge>,
    pub(super) findings: Vec<Finding>,
    pub(super) noted: usize,
    idle: u64,
    /// The cycle since which the core has executed nothing; `None` while it executes.
    idle_from: Option<Cycle>,
    /// The cycle beyond which nothing outside the core may be simulated yet, because an actor beside the board may act
    /// at that cycle. `horizon_ns` is the same instant.
    pub(super) horizon: Cycle,
    pub(super) horizon_ns: u64,
    /// Whether an actor has acted on the board since the core last ran. The core may then have to wake.
    pub(super) stirred: bool,
    pub(super) sleeps: Option<Vec<(u64, bool)>>,
}

impl<B: Board> Side<B> {
    pub(super) fn new(part: B::Part, board: B) -> Self {
        let clock = part.clock();
        let time = Timebase::new(clock.hz, clock.ppb);
        Self {
            part,
            board,
            time,
            before: VecDeque::new(),
            clock,
            awake: (0, 0),
            touched: true,
            board_due: NEVER,
            board_event: u64::MAX,
            inputs: Vec::new(),
            reset: None,
            watched: Vec::new(),
            edges: Vec::new(),
            findings: Vec::new(),
            noted: 0,
            idle: 0,
            idle_from: None,
            horizon: 0,
            horizon_ns: 0,
            stirred: true,
            sleeps: None,
        }
    }

    pub(super) fn with<T>(&mut self, at: Cycle, call: impl FnOnce(&mut B::Part, &mut View<'_, B>) -> T) -> T {
        let Self { part, board, time, touched, .. } = self;
        let answer = call(part, &mut View { board, time, touched });
        self.after(at);
        answer
    }

    #[inline]
    pub(super) fn after(&mut self, at: Cycle) {
        if self.touched {
            self.settle(at);
        }
        if self.part.signals().is_announced() {
            self.changed(at);
        }
    }

    /// Lets the board's chips act up to `at`, and passes their inputs to the part. Repeats this until there are no more
    /// inputs.
    pub(super) fn settle(&mut self, at: Cycle) {
        let ns = self.time.ns(at);
        let mut inputs = std::mem::take(&mut self.inputs);
        loop {
            self.touched = false;
            inputs.clear();
            self.board.settle(ns, &mut inputs);
            if inputs.is_empty() && !self.touched {
                break;
            }
            for input in &inputs {
                let Self { part, board, time, touched, .. } = self;
                let mut view = View { board, time, touched };
                match *input {
                    Input::Level(pin, level) => part.drive(at, pin, level, &mut view),
                    Input::Frame(pin, begins, frame) => {
                        part.receive(time.cycle(begins), pin, frame, &mut view);
                    }
                }
            }
        }
        self.inputs = inputs;
        self.replan();
        if self.board.outgoing() {
            let signals = self.part.signals();
            signals.stop();
        }
    }

    fn replan(&mut self) {
        let event = self.board.next_event();
        if event != self.board_event {
            self.board_event = event;
            let due = self.time.cycle(event);
            if due != self.board_due {
                self.board_due = due;
                self.part.signals().announce_due();
            }
        }
    }

    /// Reads the part's new findings, clock, reset request and interrupt lines, after the part has announced a change.
    pub(super) fn changed(&mut self, at: Cycle) {
        // Findings are taken before a change of rate, because their cycles are counted at the old rate.
        let found = self.part.findings();
        if found.len() > self.noted {
            for finding in &found[self.noted..] {
                self.findings.push(Finding {
                    kind: finding.kind.into(),
                    at: self.time.ns(finding.at),
                    pc: finding.pc.map(u64::from),
                    symbol: None,
                    text: format!("{}: {}", finding.place, finding.text),
                });
            }
            self.noted = self.part.findings().len();
        }
        let clock = self.part.clock();
        if clock != self.clock {
            self.follow(clock, at);
        }
        if let Some(reset) = self.part.take_reset() {
            self.reset.get_or_insert(reset);
            self.part.signals().stop();
        }
        for index in 0..self.watched.len() {
            let (line, was) = self.watched[index];
            let high = self.part.signals().lines()[usize::from(line) / 64] >> (line % 64) & 1 != 0;
            if high != was {
                self.watched[index].1 = high;
                self.edges.push(LineEdge { at: self.time.ns(at), line, high });
            }
        }
    }

    fn follow(&mut self, clock: Clock, at: Cycle) {
        let stopped = std::mem::replace(&mut self.clock, clock).hz == 0;
        // If the clock stops, cycles are still counted at the last rate, so that they measure time. A core that waits
        // for its flash goes on waiting at the new rate.
        if clock.hz == 0 {
            self.part.signals().stall_until(NEVER);
        } else if stopped {
            self.part.signals().stall_until(0);
        }
        if clock.hz > 0 {
            let idle = self.idle + self.idle_from.map_or(0, |from| at.saturating_sub(from));
            // The cycle may be in the past, because the core's last instruction may have ended later.
            let cycles = (at - idle).max(self.awake.1);
            self.awake = (self.awake.0 + self.scaled(cycles - self.awake.1), cycles);
            if self.before.len() == CHANGES {
                self.before.pop_front();
            }
            self.before.push_back((at, self.time));
            self.time.change(at, clock.hz, clock.ppb);
            self.board_event = self.board.next_event();
            self.board_due = self.time.cycle(self.board_event);
            self.horizon = self.time.cycle(self.horizon_ns);
            self.part.signals().stop();
        }
    }

    /// Records that the core has executed nothing in `idle` cycles up to `cycle`, and whether it rests from then on.
    pub(super) fn note_idle(&mut self, cycle: Cycle, idle: u64, rests: bool) {
        (self.idle, self.idle_from) = (idle, rests.then_some(cycle));
    }

    /// The instant of `cycle` in ns. It is exact unless the clock has changed more than [`CHANGES`] times since
    /// `cycle`.
    pub(super) fn ns(&self, cycle: Cycle) -> u64 {
        let then = self.before.iter().find(|(until, _)| cycle < *until);
        then.map_or(&self.time, |(_, time)| time).ns(cycle)
    }

    pub(super) fn scaled(&self, cycles: u64) -> u64 {
        self.time.span_ns(cycles)
    }
}

impl<B: Board> Bus for Side<B> {
    #[inline(always)]
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        let Self { part, board, time, touched, .. } = self;
        let answer = part.read(access, &mut View { board, time, touched });
        if access.address >= PERIPHERALS {
            self.after(access.cycle);
        }
        answer
    }

    #[inline(always)]
    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        let Self { part, board, time, touched, .. } = self;
        let answer = part.write(access, value, &mut View { board, time, touched });
        // A store to an address of code goes to the flash controller.
        if !(RAM..PERIPHERALS).contains(&access.address) {
            self.after(access.cycle);
        }
        answer
    }

    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        self.part.read_memory(address, width)
    }

    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        self.part.write_memory(address, width, value)
    }

    #[inline]
    fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
        self.part.fetch(address)
    }

    #[inline]
    fn is_constant(&self, address: u32) -> bool {
        self.part.is_constant(address)
    }

    fn watch_code(&mut self, address: u32) -> bool {
        self.part.watch_code(address)
    }

    fn is_watched(&self, address: u32) -> bool {
        self.part.is_watched(address)
    }

    #[inline(always)]
    fn rewritten(&self) -> u64 {
        self.part.rewritten()
    }

    #[inline]
    fn due(&self) -> Cycle {
        self.part.due().min(self.board_due)
    }

    fn advance(&mut self, cycle: Cycle) {
        loop {
            let (part, board) = (self.part.due(), self.board_due);
            // The core's last instruction may have ended after the cycle `horizon`.
            if part.min(board) > cycle.min(self.horizon) {
                return;
            }
            if part <= board {
                self.with(part, |model, view| model.advance(part, view));
            } else {
                self.settle(board);
                self.after(board);
            }
        }
    }

    #[inline]
    fn signals(&mut self) -> &mut Signals {
        self.part.signals()
    }

    fn sleeps(&mut self, cycle: Cycle, asleep: bool, deep: bool) {
        let at = cycle.min(self.horizon);
        let slept = self.idle_from.map_or(0, |from| cycle.saturating_sub(from));
        self.note_idle(cycle, self.idle + slept, asleep);
        if let Some(sleeps) = &mut self.sleeps {
            sleeps.push((self.time.ns(at), asleep));
        }
        self.with(at, |part, view| part.sleeps(at, asleep, deep, view));
    }

    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32 {
        self.part.wait_states(access, bound)
    }

    #[inline(always)]
    fn memory_waits(&mut self, address: u32, fetch: bool, cycle: Cycle, bound: Bound) -> Option<u32> {
        self.part.memory_waits(address, fetch, cycle, bound)
    }

    fn bit_banding(&self) -> bool {
        self.part.bit_banding()
    }
}
