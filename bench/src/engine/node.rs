//! One board in virtual time: a core, its part, the chips around it, and the clock between them.
//!
//! The core runs until an instant is reached ([`Node::advance`]), and what is due in the part and on the board before
//! that happens on the way, each at its own instant. The part counts cycles of its core; a [`Timebase`] turns them into
//! the bench's nanoseconds and follows the part's clock tree. A node is plain data: a clone that is run on does what
//! the original does.

use std::collections::BTreeSet;

use bench_seam::{Clock, Cycle, NEVER, Part, Pin, Reset, Timebase, UartFrame};
use cortex_m4::{Access, Bound, Bus, BusError, Core, Cost, Exit, Fast, Register, Signals, Width};

use super::board::{Board, Input, View};
use super::finding::{Finding, FindingKind};
use super::rtt::{self, Channels, LogLine, Text};
use super::{Digest, Error, Firmware, memory};

/// How often the node empties the firmware's log, as a debug probe polls RTT, in virtual nanoseconds.
pub const PROBE_PERIOD: u64 = 1_000_000;

/// Most findings a node keeps; a firmware in a loop would otherwise fill the host's memory.
const MOST_FINDINGS: usize = 200;

/// Configurable Fault Status, HardFault Status and Bus Fault Address registers, ARMv7-M ARM B3.2.
const CFSR: u32 = 0xE000_ED28;
const HFSR: u32 = 0xE000_ED2C;
const BFAR: u32 = 0xE000_ED38;

/// HardFault's place in the vector table, ARMv7-M ARM table B1-4.
const HARD_FAULT: u64 = 3;

/// `B .` in Thumb.
const BRANCH_TO_ITSELF: u64 = 0xE7FE;

/// Where peripherals begin: below are code and RAM.
const PERIPHERALS: u32 = 0x4000_0000;
/// Where RAM begins: below is code.
const RAM: u32 = 0x2000_0000;

/// A watched interrupt line changing its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineEdge {
    /// The instant the model drove it, in virtual nanoseconds.
    pub at: u64,
    /// The line, as the vector table numbers interrupts.
    pub line: u16,
    /// Whether it rose.
    pub high: bool,
}

/// A restart of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetAt {
    /// When, in virtual nanoseconds.
    pub at: u64,
    /// Why.
    pub cause: Reset,
}

/// What restarts a part from outside, see [`Node::restart`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FromOutside {
    /// Its reset pin was pulled low for a moment. RAM keeps its contents.
    Pin,
    /// Its supply came on. RAM holds what it came up with: noise that follows from the seed.
    PowerOn(u64),
    /// Its supply dipped below the brown-out threshold. RAM keeps its contents, which is the harder case for a
    /// firmware.
    BrownOut,
}

/// How long a core was awake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Virtual nanoseconds the core executed instructions.
    pub awake: u64,
    /// Virtual nanoseconds in all.
    pub total: u64,
}

impl Usage {
    /// The processor load, 0 to 1.
    #[must_use]
    pub fn load(self) -> f64 {
        if self.total == 0 { 0.0 } else { self.awake as f64 / self.total as f64 }
    }

    /// What was used since `before`.
    #[must_use]
    pub fn since(self, before: Self) -> Self {
        Self { awake: self.awake - before.awake, total: self.total - before.total }
    }
}

/// All of a node that its core reaches while it runs: the part, the board and the clock.
#[derive(Clone, Debug)]
struct Side<B: Board> {
    part: B::Part,
    board: B,
    time: Timebase,
    clock: Clock,
    /// The core was awake, in ns, up to the last change of its clock; and its awake cycles then.
    awake: (u64, u64),
    /// Something reached the board since it was last settled.
    touched: bool,
    /// When a chip of the board next acts.
    board_due: Cycle,
    inputs: Vec<Input>,
    /// The restart that the part asked for, with its cycle.
    reset: Option<Reset>,
    watched: Vec<(u16, bool)>,
    edges: Vec<LineEdge>,
    /// What the part's models found, with instants.
    findings: Vec<Finding>,
    noted: usize,
    /// The core's cycles in which it did not run, as last told: see [`Side::changed`].
    idle: u64,
    /// Nothing outside the core happens past this cycle yet, which begins at this instant (ns): something may act on
    /// the board there.
    horizon: Cycle,
    horizon_ns: u64,
    /// Something acted on the board since the core last ran: it may wake.
    stirred: bool,
}

impl<B: Board> Side<B> {
    /// Calls the part with its view of the board.
    fn with<T>(&mut self, at: Cycle, call: impl FnOnce(&mut B::Part, &mut View<'_, B>) -> T) -> T {
        let Self { part, board, time, touched, .. } = self;
        let answer = call(part, &mut View { board, time, touched });
        self.after(at);
        answer
    }

    /// The board acts on what reached it, and what changed is looked at.
    #[inline]
    fn after(&mut self, at: Cycle) {
        if self.touched {
            self.settle(at);
        }
        if self.part.signals().changed {
            self.changed(at);
        }
        let Self { board, part, time, .. } = self;
        board.watch(|| time.ns(at), part);
    }

    /// Lets the board's chips act up to `at`, and the part hear of what they do, until nothing moves any more.
    fn settle(&mut self, at: Cycle) {
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
            signals.stop = true;
            signals.changed = true;
        }
    }

    /// The board's next event may have moved.
    fn replan(&mut self) {
        let due = self.time.cycle(self.board.next_event());
        if due != self.board_due {
            self.board_due = due;
            self.part.signals().changed = true;
        }
    }

    /// The part drives something else into the core, or has other plans: what the engine must know of it.
    fn changed(&mut self, at: Cycle) {
        // Before the rate changes: the instants of what was found up to here are counted at the old one.
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
            self.part.signals().stop = true;
        }
        for index in 0..self.watched.len() {
            let (line, was) = self.watched[index];
            let high = self.part.signals().lines[usize::from(line) / 64] >> (line % 64) & 1 != 0;
            if high != was {
                self.watched[index].1 = high;
                self.edges.push(LineEdge { at: self.time.ns(at), line, high });
            }
        }
    }

    /// The core goes on at another rate from `at` on, or stands still.
    fn follow(&mut self, clock: Clock, at: Cycle) {
        self.clock = clock;
        // Cycles go on being counted at the last rate while the core has no clock: they are the bench's time then.
        self.part.signals().stalled_until = if clock.hz == 0 { NEVER } else { 0 };
        if clock.hz > 0 {
            let cycles = at - self.idle;
            self.awake = (self.awake.0 + self.scaled(cycles - self.awake.1), cycles);
            self.time.change(at, clock.hz, clock.ppb);
            self.board_due = self.time.cycle(self.board.next_event());
            // The same instant is another cycle now: the core must not run on to the old one.
            self.horizon = self.time.cycle(self.horizon_ns);
            self.part.signals().stop = true;
        }
    }

    /// So many cycles at the present rate, in ns.
    fn scaled(&self, cycles: u64) -> u64 {
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
        // A store into code is one to a flash controller.
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

    #[inline]
    fn due(&self) -> Cycle {
        self.part.due().min(self.board_due)
    }

    fn advance(&mut self, cycle: Cycle) {
        loop {
            let (part, board) = (self.part.due(), self.board_due);
            // The core's last instruction may have ended past the horizon.
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
        self.with(at, |part, view| part.sleeps(at, asleep, deep, view));
    }

    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32 {
        self.part.wait_states(access, bound)
    }

    fn bit_banding(&self) -> bool {
        self.part.bit_banding()
    }
}

/// One board, running one firmware.
#[derive(Clone, Debug)]
pub struct Node<B: Board, C: Cost = Fast> {
    core: Core<C>,
    side: Side<B>,
    firmware: Firmware,
    semihosting: bool,
    exit: Option<u32>,
    traps: Traps,
    resets: Vec<ResetAt>,
    probe_at: u64,
    log_block: Option<u64>,
    log: Channels,
    lines: Vec<LogLine>,
    console: Text,
    findings: Vec<Finding>,
    reported: BTreeSet<(FindingKind, String)>,
}

/// Instructions the node stops at to report what happened, and goes on from.
#[derive(Clone, Debug, Default)]
struct Traps {
    hard_fault: Option<u64>,
    default_handler: BTreeSet<u64>,
    panic: BTreeSet<u64>,
}

impl<B: Board, C: Cost> Node<B, C> {
    /// `part` on `board` with `firmware` in its memory, at power-on.
    ///
    /// # Errors
    ///
    /// An image that does not fit the part, or that has no vector table where the core looks for it.
    pub fn new(mut part: B::Part, board: B, firmware: &Firmware) -> Result<Self, Error> {
        for (address, bytes) in firmware.segments() {
            if !memory::write(&mut part, *address, bytes) {
                return Err(Error::Placement {
                    firmware: firmware.name().to_owned(),
                    part: B::Part::NAME,
                    address: *address,
                    length: bytes.len(),
                });
            }
        }
        let config = part.core();
        let boot = u64::from(config.vector_table);
        let vector = |number: u64| memory::value(&part, boot + 4 * number, 4);
        let (stack, entry) = (vector(0).unwrap_or(0), vector(1).unwrap_or(0));
        let erased = u64::from(u32::MAX);
        if entry & 1 == 0 || entry == erased || stack == 0 || stack == erased {
            let begins = firmware.segments().iter().map(|(address, _)| *address).min().unwrap_or(0);
            let firmware = firmware.name().to_owned();
            return Err(Error::NoVectors { firmware, part: B::Part::NAME, address: boot, begins });
        }
        let traps = Traps {
            hard_fault: vector(HARD_FAULT)
                .filter(|&handler| handler & 1 != 0 && memory::value(&part, handler & !1, 2).is_some())
                .map(|handler| handler & !1),
            default_handler: firmware
                .symbol("DefaultHandler_")
                .or_else(|| firmware.symbol("DefaultHandler"))
                .map(|symbol| symbol.address)
                .into_iter()
                .collect(),
            panic: firmware.functions_called("rust_begin_unwind").collect(),
        };
        let clock = part.clock();
        let mut node = Self {
            core: Core::new(config),
            side: Side {
                part,
                board,
                time: Timebase::new(clock.hz, clock.ppb),
                clock,
                awake: (0, 0),
                touched: true,
                board_due: NEVER,
                inputs: Vec::new(),
                reset: None,
                watched: Vec::new(),
                edges: Vec::new(),
                findings: Vec::new(),
                noted: 0,
                idle: 0,
                horizon: 0,
                horizon_ns: 0,
                stirred: true,
            },
            semihosting: false,
            exit: None,
            resets: Vec::new(),
            probe_at: PROBE_PERIOD,
            log_block: firmware.symbol("_SEGGER_RTT").map(|symbol| symbol.address),
            log: Channels::default(),
            lines: Vec::new(),
            console: Text::default(),
            findings: Vec::new(),
            reported: BTreeSet::new(),
            firmware: firmware.clone(),
            traps,
        };
        node.arm();
        // A part that was made leaves its pins as at power-on, which the board hears of here.
        node.side.with(0, |part, view| part.reset(0, Reset::PowerOn, view));
        node.side.reset = None;
        node.side.settle(0);
        node.core.reset(&mut node.side);
        Ok(node)
    }

    /// Has the core stop at every trap.
    fn arm(&mut self) {
        let traps = &self.traps;
        for &trap in traps.hard_fault.iter().chain(&traps.default_handler).chain(&traps.panic) {
            self.core.set_breakpoint(u32::try_from(trap).unwrap_or(u32::MAX));
        }
    }

    /// Serves the firmware's semihosting calls, as a debug probe does: console output, and an exit that stops the core.
    #[must_use]
    pub fn with_semihosting(mut self) -> Self {
        self.semihosting = true;
        self
    }

    /// The cycle this board has reached. The core's last instruction may end later.
    fn present(&self) -> Cycle {
        self.core.cycle().min(self.side.horizon)
    }

    /// The instant this board has reached, in virtual nanoseconds.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.side.time.ns(self.present())
    }

    /// When `cycle` of this board's core begins, in virtual nanoseconds. Exact since the clock tree last changed.
    #[must_use]
    pub fn ns(&self, cycle: Cycle) -> u64 {
        self.side.time.ns(cycle)
    }

    /// The first cycle of this board's core that begins at `ns` or later.
    #[must_use]
    pub fn cycle_at(&self, ns: u64) -> Cycle {
        self.side.time.cycle(ns)
    }

    /// The first instant this board may act at without anything from outside. Its own present while the core is awake.
    #[must_use]
    pub fn earliest(&self) -> u64 {
        if (self.core.is_asleep() && !self.side.stirred) || self.stopped() {
            self.side.time.ns(self.side.due().min(self.core.due())).max(self.now())
        } else {
            self.now()
        }
    }

    /// The longest an ordinary instruction takes at the core's present rate, in virtual nanoseconds.
    #[must_use]
    pub fn instruction_ns(&self) -> u64 {
        2 * self.side.time.cycle_ns()
    }

    fn stopped(&self) -> bool {
        self.exit.is_some() || self.core.locked_up() || self.side.clock.hz == 0
    }

    /// What is wired around the part, to read.
    #[must_use]
    pub fn board(&self) -> &B {
        &self.side.board
    }

    /// Something outside acts on the board's chips now, or takes out what they collected. The chips may have other
    /// plans afterwards, and the part hears of what they do at this instant.
    pub fn board_mut<T>(&mut self, act: impl FnOnce(&mut B) -> T) -> T {
        let answer = act(&mut self.side.board);
        let at = self.present();
        self.side.settle(at);
        self.side.after(at);
        self.side.stirred = true;
        answer
    }

    /// The microcontroller, to read.
    #[must_use]
    pub fn part(&self) -> &B::Part {
        &self.side.part
    }

    /// Something outside acts on the part now: its pins, a bus, an oscillator. `act` gets the part, what is around it,
    /// and the present cycle.
    pub fn input<T>(&mut self, act: impl FnOnce(&mut B::Part, &mut View<'_, B>, Cycle) -> T) -> T {
        let at = self.present();
        let answer = self.side.with(at, |part, view| act(part, view, at));
        self.side.part.signals().changed = true;
        self.side.stirred = true;
        answer
    }

    /// Drives `pin` from outside from now on, or lets go of it.
    pub fn drive(&mut self, pin: Pin, level: Option<bool>) {
        self.input(|part, view, at| part.drive(at, pin, level, view));
    }

    /// A UART frame whose start bit begins now arrives at `pin`.
    pub fn receive(&mut self, pin: Pin, frame: UartFrame) {
        self.input(|part, view, at| part.receive(at, pin, frame, view));
    }

    /// The image this node runs.
    #[must_use]
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// The firmware's exit status, once it ended the run through semihosting.
    #[must_use]
    pub fn exit_status(&self) -> Option<u32> {
        self.exit
    }

    /// Whether the core runs nothing until an interrupt.
    #[must_use]
    pub fn is_asleep(&self) -> bool {
        self.core.is_asleep()
    }

    /// Runs to `to` (virtual ns), or to an instruction boundary before it where something left the board. What acts on
    /// the board then acts at `to` itself; the core hears of it after the instruction that it is in.
    pub fn advance(&mut self, to: u64) {
        self.advance_or_restart(to, false);
    }

    /// As [`Node::advance`], but no further than the next restart of the part, before its core has run an instruction.
    /// Answers whether it restarted.
    pub fn advance_to_restart(&mut self, to: u64) -> bool {
        self.advance_or_restart(to, true)
    }

    fn advance_or_restart(&mut self, to: u64, stops: bool) -> bool {
        loop {
            if let Some(reset) = self.side.reset.take() {
                self.reset_by(reset);
                if stops {
                    return true;
                }
            }
            let now = self.now();
            if now >= self.probe_at {
                self.probe(now);
            }
            if now >= to || self.side.board.outgoing() {
                return false;
            }
            self.side.horizon_ns = to.min(self.probe_at);
            let horizon = self.side.time.cycle(self.side.horizon_ns);
            self.side.horizon = horizon;
            if self.exit.is_some() {
                self.side.advance(horizon);
                self.core.skip_to(horizon);
                continue;
            }
            self.side.stirred = false;
            match self.core.run(&mut self.side, horizon) {
                Exit::Until | Exit::Stopped | Exit::Halted => {}
                Exit::Breakpoint => self.trapped(),
                Exit::HostCall => self.host_call(),
                Exit::Lockup => self.locked_up(),
                Exit::ResetRequest => self.side.reset = Some(Reset::Software),
            }
            self.side.idle = self.core.idle();
        }
    }

    fn locked_up(&mut self) {
        let pc = u64::from(self.core.pc());
        let (cfsr, hfsr) = (self.word(u64::from(CFSR)).unwrap_or(0), self.word(u64::from(HFSR)).unwrap_or(0));
        let mut text = "the core locked up: a fault inside a fault handler".to_owned();
        if cfsr | hfsr != 0 {
            text += &format!(": {} (CFSR {cfsr:#010x}, HFSR {hfsr:#010x})", fault_names(cfsr, hfsr));
        }
        if self.instructions() == 0 {
            text += "; it has not run one instruction: does the reset vector lead into the image?";
        }
        self.find(FindingKind::Lockup, Some(pc), text);
        if B::Part::RESETS_ON_LOCKUP {
            self.side.reset = Some(Reset::Lockup);
        }
    }

    /// The core locks up now, as a fault inside a fault handler makes it: it runs nothing until it is reset.
    pub fn lock_up(&mut self) {
        self.core.lock_up();
        self.locked_up();
    }

    /// Restarts the part from outside, now. Its flags say why, as far as it has flags for it, and [`Node::resets`]
    /// lists it.
    pub fn restart(&mut self, why: FromOutside) {
        self.reset_by(match why {
            FromOutside::Pin => Reset::Pin,
            FromOutside::PowerOn(_) => Reset::PowerOn,
            FromOutside::BrownOut => Reset::BrownOut,
        });
        if let FromOutside::PowerOn(seed) = why {
            self.come_up(seed);
        }
    }

    fn reset_by(&mut self, cause: Reset) {
        let at = self.present();
        // What the firmware logged last, before its start-up code clears the buffer.
        self.probe_log(self.now());
        self.resets.push(ResetAt { at: self.now(), cause });
        self.side.with(at, |part, view| part.reset(at, cause, view));
        self.side.reset = None;
        self.side.settle(at);
        self.core.reset(&mut self.side);
        let unfinished = self.log.finish(self.now());
        self.lines.extend(unfinished);
        // What the last start did, the next may do again.
        self.reported.retain(|(kind, _)| *kind != FindingKind::HardFault && *kind != FindingKind::UnhandledInterrupt);
        self.arm();
    }

    /// Fills all RAM with noise that follows from `seed` (SplitMix64), as RAM comes up.
    fn come_up(&mut self, seed: u64) {
        let mut state = seed;
        for (start, size) in B::Part::RAM {
            let Some(bytes) = self.side.part.memory_mut(*start, *size) else { continue };
            for chunk in bytes.chunks_mut(8) {
                state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
                let mut word = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                word = (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
                let noise = (word ^ word >> 31).to_le_bytes();
                chunk.copy_from_slice(&noise[..chunk.len()]);
            }
        }
    }

    /// Core register `number`: 0 to 15, then xPSR at 16.
    #[must_use]
    pub fn register(&self, number: usize) -> u32 {
        match u8::try_from(number) {
            Ok(number @ 0..=15) => self.core.register(Register::R(number)),
            _ => self.core.register(Register::Xpsr),
        }
    }

    /// The word at `address` as a debugger reads it: memory, or the processor's own registers.
    #[must_use]
    pub fn word(&mut self, address: u64) -> Option<u32> {
        if let Some(word) = memory::value(&self.side.part, address, 4) {
            return u32::try_from(word).ok();
        }
        let address = u32::try_from(address).ok()?;
        if !(0xE000_0000..0xE010_0000).contains(&address) {
            return None;
        }
        self.core.debug_read(&mut self.side, address).ok()
    }

    /// Fills `to` from memory at `address`.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`].
    pub fn read(&self, address: u64, to: &mut [u8]) -> Result<(), Error> {
        let length = to.len();
        memory::read(&self.side.part, address, to).then_some(()).ok_or(Error::NotMemory { address, length })
    }

    /// Writes `from` to memory at `address`, flash included, as a debugger does.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`].
    pub fn write(&mut self, address: u64, from: &[u8]) -> Result<(), Error> {
        let written = memory::write(&mut self.side.part, address, from);
        let signals = self.side.part.signals();
        signals.code_changed = true;
        signals.changed = true;
        written.then_some(()).ok_or(Error::NotMemory { address, length: from.len() })
    }

    /// Where the firmware's `symbol` is.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`].
    pub fn address_of(&self, symbol: &str) -> Result<u64, Error> {
        self.firmware
            .symbol(symbol)
            .map(|symbol| symbol.address)
            .ok_or_else(|| Error::NoSymbol { firmware: self.firmware.name().to_owned(), symbol: symbol.to_owned() })
    }

    /// Fills `to` from the firmware's static `symbol`.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] and [`Error::NotMemory`].
    pub fn read_symbol(&self, symbol: &str, to: &mut [u8]) -> Result<(), Error> {
        self.read(self.address_of(symbol)?, to)
    }

    /// Records every change of interrupt line `line` from now on, for [`Node::take_edges`].
    pub fn watch_line(&mut self, line: u16) {
        if self.side.watched.iter().all(|&(watched, _)| watched != line) {
            self.side.watched.push((line, false));
        }
    }

    /// The changes of watched lines since last asked, in order.
    pub fn take_edges(&mut self) -> Vec<LineEdge> {
        std::mem::take(&mut self.side.edges)
    }

    /// How long the core was awake since power-on.
    #[must_use]
    pub fn usage(&self) -> Usage {
        let (ns, cycles) = self.side.awake;
        let since = (self.core.cycle() - self.core.idle()).saturating_sub(cycles);
        Usage { awake: ns + self.side.scaled(since), total: self.now() }
    }

    /// Instructions the core executed since power-on.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.core.retired()
    }

    /// Every restart of the part so far.
    #[must_use]
    pub fn resets(&self) -> &[ResetAt] {
        &self.resets
    }

    /// The log lines since last asked, console output through semihosting among them.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.probe_log(self.now());
        std::mem::take(&mut self.lines)
    }

    /// The log lines since last asked, as [`Node::take_log`], and then the lines that the firmware did not finish.
    pub fn finish_log(&mut self) -> Vec<LogLine> {
        let mut lines = self.take_log();
        let at = self.now();
        lines.extend(self.log.finish(at));
        lines.extend(self.console.finish().map(|bytes| rtt::text_line(at, "", &bytes)));
        lines
    }

    /// The bytes that came over RTT up channel `channel` since last asked, up to the latest 64 KiB. They are in the log
    /// as well.
    pub fn take_channel(&mut self, channel: u64) -> Vec<u8> {
        self.probe_log(self.now());
        self.log.take_raw(channel)
    }

    /// What the core is doing now, in words.
    #[must_use]
    pub fn doing(&self) -> String {
        let pc = u64::from(self.core.pc());
        let place = self.firmware.place_of(pc).map_or_else(|| format!("at {pc:#010x}"), |place| format!("in {place}"));
        if self.core.locked_up() {
            "it is locked up".to_owned()
        } else if self.side.clock.hz == 0 {
            format!("its core has no clock, {place}")
        } else if !self.core.is_asleep() {
            format!("it runs {place}")
        } else if self.side.due().min(self.core.due()) == NEVER {
            format!("it sleeps {place}, and nothing is due that could wake it")
        } else {
            format!("it sleeps {place}")
        }
    }

    /// What went wrong since last asked.
    pub fn take_findings(&mut self) -> Vec<Finding> {
        self.report_errors();
        let mut findings = std::mem::take(&mut self.findings);
        // At one instant what the part saw comes first: it is why the core then stops.
        findings.sort_by_key(|finding| (finding.at, finding.kind.ends_run()));
        findings
    }

    /// What went wrong so far and was not taken.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// A number that differs when anything the firmware could see differs: registers, RAM, time, instructions.
    #[must_use]
    pub fn digest(&self) -> u64 {
        let mut digest = Digest::new();
        let named = [Register::Xpsr, Register::Msp, Register::Psp, Register::Control, Register::Faultmask];
        let more = [Register::Basepri, Register::Primask, Register::Fpscr];
        let all = (0..16).map(Register::R).chain((0..32).map(Register::S)).chain(named).chain(more);
        for register in all {
            digest.word(u64::from(self.core.register(register)));
        }
        digest.word(self.core.cycle());
        digest.word(self.now());
        digest.word(self.instructions());
        for (start, size) in B::Part::RAM {
            digest.bytes(self.side.part.memory(*start, *size).unwrap_or_default());
        }
        digest.finish()
    }

    fn find(&mut self, kind: FindingKind, pc: Option<u64>, text: String) {
        let at = self.now();
        self.add_finding(kind, at, pc, text);
    }

    fn add_finding(&mut self, kind: FindingKind, at: u64, pc: Option<u64>, text: String) {
        if self.findings.len() >= MOST_FINDINGS {
            return;
        }
        let symbol = pc.and_then(|pc| self.firmware.place_of(pc));
        self.findings.push(Finding { kind, at, pc, symbol, text });
    }

    /// A finding of the caller's own about this node, at its present.
    pub(crate) fn add_note(&mut self, kind: FindingKind, text: String) {
        self.find(kind, None, text);
    }

    /// Takes what the models and the core listed since the last call.
    fn report_errors(&mut self) {
        self.side.changed(self.present());
        let mut found = std::mem::take(&mut self.side.findings);
        for (address, pc, cycle) in self.core.take_unmodelled() {
            found.push(Finding {
                kind: FindingKind::Unmodelled,
                at: self.side.time.ns(cycle),
                pc: Some(u64::from(pc)),
                symbol: None,
                text: format!("the core's register at {address:#010x} is not modelled"),
            });
        }
        for Finding { kind, at, pc, text, .. } in found {
            if self.reported.insert((kind, text.clone())) {
                self.add_finding(kind, at, pc, text);
            }
        }
    }

    /// The core is about to run an instruction the node watches.
    fn trapped(&mut self) {
        let pc = u64::from(self.core.pc());
        // A handler that is one branch to itself comes here at every turn.
        if memory::value(&self.side.part, pc, 2) == Some(BRANCH_TO_ITSELF) {
            self.core.clear_breakpoint(self.core.pc());
        }
        if self.traps.hard_fault == Some(pc) {
            self.report_exception(FindingKind::HardFault);
        } else if self.traps.panic.contains(&pc) {
            self.report_panic();
        } else if self.traps.default_handler.contains(&pc) {
            self.report_exception(FindingKind::UnhandledInterrupt);
        }
    }

    fn report_exception(&mut self, kind: FindingKind) {
        let exception = self.core.register(Register::Xpsr) & 0x1FF;
        let returns = self.register(14);
        // EXC_RETURN bit 2 says which stack the core pushed its frame on, ARMv7-M ARM table B1-8.
        let stack = self.core.register(if returns & 4 != 0 { Register::Psp } else { Register::Msp });
        let pushed = |index: u64| memory::value(&self.side.part, u64::from(stack) + 4 * index, 4);
        let (lr, pc) = (pushed(5), pushed(6));
        let (cfsr, hfsr) = (self.word(u64::from(CFSR)).unwrap_or(0), self.word(u64::from(HFSR)).unwrap_or(0));
        let mut text = match kind {
            FindingKind::HardFault => {
                format!("HardFault: {} (CFSR {cfsr:#010x}, HFSR {hfsr:#010x})", fault_names(cfsr, hfsr))
            }
            _ => format!("exception {exception} (interrupt {}) has no handler", i64::from(exception) - 16),
        };
        if cfsr & 0x8000 != 0
            && let Some(address) = self.word(u64::from(BFAR))
        {
            text += &format!(", bus fault address {address:#010x}");
        }
        if let Some(caller) = lr.and_then(|lr| self.firmware.name_of(lr)) {
            text += &format!(", called from {caller}");
        }
        if self.reported.insert((kind, text.clone())) {
            self.find(kind, pc, text);
        }
    }

    fn report_panic(&mut self) {
        let place = self.panic_place();
        let lr = u64::from(self.register(14)) & !1;
        let text = match place {
            Some(place) => format!("panicked at {place}; the message is in the log"),
            None => "panicked; the message is in the log".to_owned(),
        };
        let pc = self.panicking_call().unwrap_or(lr.saturating_sub(2));
        self.find(FindingKind::Panic, Some(pc), text);
    }

    /// Where the firmware's own code called what panicked: of the return addresses on the stack, the innermost that is
    /// not in the language's libraries. A word that only looks like one is rare above the stack pointer, and the text
    /// of the finding has the place from the panic itself.
    fn panicking_call(&self) -> Option<u64> {
        const LIBRARIES: [&str; 5] = ["core::", "<core::", "alloc::", "<alloc::", "compiler_builtins::"];
        let part = &self.side.part;
        let stack = u64::from(self.register(13));
        (0..128).find_map(|index| {
            let to = memory::value(part, stack + 4 * index, 4).filter(|to| to & 1 != 0)? & !1;
            let half = |back: u64| memory::value(part, to.checked_sub(back)?, 2);
            // BL, or BLX of a register: ARMv7-M ARM A7.7.18 and A7.7.19.
            let call = half(4)? & 0xF800 == 0xF000 && half(2)? & 0xD000 == 0xD000 || half(2)? & 0xFF87 == 0x4780;
            let function = self.firmware.name_of(to - 2)?;
            (call && !LIBRARIES.iter().any(|library| function.starts_with(library))).then_some(to - 2)
        })
    }

    /// `PanicInfo` has no stable layout, but it holds a `&Location`: {file name, its length, line, column}. The first
    /// word of it that points to something of that shape is taken.
    fn panic_place(&self) -> Option<String> {
        let info = u64::from(self.register(0));
        let part = &self.side.part;
        (0..6).find_map(|index| {
            let location = memory::value(part, info + 4 * index, 4)?;
            let word = |index: u64| memory::value(part, location + 4 * index, 4);
            let (name, length, line, column) = (word(0)?, word(1)?, word(2)?, word(3)?);
            if !(4..=512).contains(&length) || line == 0 || line > 1_000_000 || column > 10_000 {
                return None;
            }
            let mut text = vec![0; usize::try_from(length).ok()?];
            memory::read(part, name, &mut text).then_some(())?;
            let text = String::from_utf8(text).ok().filter(|text| text.trim_end_matches('\0').ends_with(".rs"))?;
            Some(format!("{}:{line}:{column}", text.trim_end_matches('\0')))
        })
    }

    /// The firmware asked something of the host it is debugged from: "Semihosting for AArch32 and AArch64", Arm
    /// 2021, section 3 (operations).
    fn host_call(&mut self) {
        if !self.semihosting {
            self.core.finish_host_call(None);
            return;
        }
        let (operation, parameter) = (self.register(0), u64::from(self.register(1)));
        let argument = |node: &Self, index: u64| memory::value(&node.side.part, parameter + 4 * index, 4).unwrap_or(0);
        const FAILED: u32 = u32::MAX;
        let answer = match operation {
            // SYS_OPEN: the console alone, called ":tt".
            0x01 => {
                let mut name = vec![0; usize::try_from(argument(self, 2)).unwrap_or(0).min(64)];
                let read = memory::read(&self.side.part, argument(self, 0), &mut name);
                // Modes 0 to 3 read, 4 to 7 write, 8 to 11 append (standard error).
                if read && name == b":tt" { u32::try_from(argument(self, 1) / 4).unwrap_or(0) } else { FAILED }
            }
            // SYS_CLOSE
            0x02 => 0,
            // SYS_WRITEC
            0x03 => {
                let character = memory::value(&self.side.part, parameter, 1).unwrap_or(0);
                self.print(&[u8::try_from(character).unwrap_or(0)]);
                0
            }
            // SYS_WRITE0
            0x04 => {
                let mut at = parameter;
                while let Some(byte @ 1..) = memory::value(&self.side.part, at, 1) {
                    self.print(&[u8::try_from(byte).unwrap_or(0)]);
                    at += 1;
                }
                0
            }
            // SYS_WRITE answers how many bytes it did not write.
            0x05 => {
                let length = argument(self, 2);
                let mut text = vec![0; usize::try_from(length).unwrap_or(0).min(1 << 20)];
                let there = memory::read(&self.side.part, argument(self, 1), &mut text);
                self.print(&text);
                if there { 0 } else { u32::try_from(length).unwrap_or(FAILED) }
            }
            // SYS_ISTTY
            0x09 => u32::from(argument(self, 0) <= 2),
            // SYS_CLOCK, in hundredths of a second; SYS_TIME, in seconds since power-on.
            0x10 => u32::try_from(self.now() / 10_000_000).unwrap_or(FAILED),
            0x11 => u32::try_from(self.now() / 1_000_000_000).unwrap_or(FAILED),
            // SYS_ERRNO
            0x13 => 0,
            // SYS_EXIT: a reason, ADP_Stopped_ApplicationExit is success. SYS_EXIT_EXTENDED: reason and status.
            0x18 => self.ended(if parameter == 0x2_0026 { 0 } else { 1 }),
            0x20 => {
                let status = argument(self, 1);
                self.ended(u32::try_from(status).unwrap_or(1))
            }
            // SYS_ELAPSED, SYS_TICKFREQ: nanoseconds.
            0x30 => {
                let now = self.now().to_le_bytes();
                if memory::write(&mut self.side.part, parameter, &now) { 0 } else { FAILED }
            }
            0x31 => 1_000_000_000,
            // There is no file system here, nor anything to read: these fail as on a host that has none.
            0x06 | 0x07 | 0x0A | 0x0C..=0x0F | 0x12 | 0x15 | 0x16 => FAILED,
            _ => {
                let text = format!("semihosting operation {operation:#x} is not served");
                self.find(FindingKind::Unmodelled, Some(u64::from(self.core.pc())), text);
                FAILED
            }
        };
        self.core.finish_host_call(Some(answer));
    }

    /// The firmware ended the run with `status`.
    fn ended(&mut self, status: u32) -> u32 {
        self.exit = Some(status);
        if status != 0 {
            let pc = u64::from(self.core.pc());
            self.find(FindingKind::ExitStatus, Some(pc), format!("the firmware ended the run with status {status}"));
        }
        0
    }

    fn print(&mut self, text: &[u8]) {
        let at = self.now();
        let Self { console, lines, .. } = self;
        console.take(text, |line| lines.push(rtt::text_line(at, "", line)));
    }

    /// A debug probe's look at the log, on a grid of [`PROBE_PERIOD`].
    fn probe(&mut self, now: u64) {
        self.probe_at = (now / PROBE_PERIOD + 1) * PROBE_PERIOD;
        self.probe_log(now);
    }

    fn probe_log(&mut self, at: u64) {
        let Some(block) = self.log_block else { return };
        let (lines, troubles) = self.log.probe(&mut self.side.part, block, &self.firmware, at);
        self.lines.extend(lines);
        for (kind, text) in troubles {
            self.add_finding(kind, at, None, text);
        }
    }
}

/// The bits of CFSR and HFSR by name, ARMv7-M ARM B3.2.15 and B3.2.16.
fn fault_names(cfsr: u32, hfsr: u32) -> String {
    const NAMES: [(u32, &str); 17] = [
        (1 << 0, "instruction access violation"),
        (1 << 1, "data access violation"),
        (1 << 3, "MPU fault on exception return"),
        (1 << 4, "MPU fault on exception entry"),
        (1 << 5, "MPU fault saving FPU state"),
        (1 << 8, "instruction bus error"),
        (1 << 9, "precise data bus error"),
        (1 << 10, "imprecise data bus error"),
        (1 << 11, "bus error on exception return"),
        (1 << 12, "bus error on exception entry"),
        (1 << 13, "bus error saving FPU state"),
        (1 << 16, "undefined instruction"),
        (1 << 17, "invalid state"),
        (1 << 18, "invalid PC load"),
        (1 << 19, "no coprocessor"),
        (1 << 24, "unaligned access"),
        (1 << 25, "division by zero"),
    ];
    let mut names: Vec<&str> = NAMES.iter().filter(|(bit, _)| cfsr & bit != 0).map(|&(_, name)| name).collect();
    if hfsr & 2 != 0 {
        names.push("vector table read");
    }
    if hfsr & (1 << 31) != 0 {
        names.push("breakpoint with no debugger");
    }
    if names.is_empty() { "no cause recorded".to_owned() } else { names.join(", ") }
}
