//! One board in virtual time: a core, its part's models, and the clock between them.
//!
//! The core runs a stretch of instructions at a time. A stretch ends at the next instant anything else happens: a
//! model's event, the horizon of [`Node::advance`], or an access of the firmware that changed what is due. A core that
//! waits runs nothing and its clock is set to the next such instant. Rigless calls a core waiting from its WFI until it
//! next runs, even when an interrupt has reached it meanwhile, so the node keeps a flag of its own for "runs nothing
//! until something happens".

use std::collections::BTreeSet;

use rigless::device::{Level, ResetCause};
use rigless::emulator::{
    Access, AccessKind, CoreBus, Error as EmulatorError, Exit, Host, HostCall, InterruptLine, Memory, Processor,
    Queued, Stop, StopReason,
};
use rigless::mcu::Mcu;
use rigless::session::Session;
use rigless::soc::{Endian, Width};
use rigless::time::{NO_DEADLINE, VirtualNanos};

use super::finding::{Finding, FindingKind};
use super::memory::{GuestMemory, Use};
use super::poll::{self, PollWatch};
use super::rtt::{self, LogLevel, LogLine, LogStream, RttFault};
use super::wiring::Carrier;
use super::{Clock, Digest, Error, Firmware, FlashAction, Part, Rate, Supply, Wiring};

/// How often the node empties the firmware's log, as a debug probe polls RTT, in virtual nanoseconds.
pub const PROBE_PERIOD: u64 = 1_000_000;

/// Most findings a node keeps; a firmware in a loop would otherwise fill the host's memory.
const MOST_FINDINGS: usize = 200;

/// Configurable Fault Status, HardFault Status and Bus Fault Address registers, ARMv7-M ARM B3.2.
const CFSR: u64 = 0xE000_ED28;
const HFSR: u64 = 0xE000_ED2C;
const BFAR: u64 = 0xE000_ED38;

/// Interrupt Control and State Register with its bit that makes the NMI pending, ARMv7-M ARM B3.2.4.
const ICSR: u64 = 0xE000_ED04;
const NMIPENDSET: u64 = 1 << 31;
/// The NMI's exception number, ARMv7-M ARM table B1-4.
const NMI: u32 = 2;
/// While an NMI stands that its handler has not cleared, the core is looked at this often, in instructions: it may
/// return, and has to be taken back.
const NMI_LOOK: u32 = 8;

/// HardFault's place in the vector table, ARMv7-M ARM table B1-4.
const HARD_FAULT: u64 = 3;

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
    pub cause: ResetCause,
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

/// What the models reach while they are called, and the clock: all of a node but its core and its session.
#[derive(Debug)]
struct Side {
    memory: GuestMemory,
    core_only: &'static [std::ops::Range<u64>],
    queue: Vec<Queued>,
    rate: Rate,
    clock: Clock,
    /// Instructions, and nanoseconds the core was awake, before it ran at this rate.
    before: (u64, u64),
    /// Nanoseconds the clock was set forward while the core slept.
    warped: u64,
    /// Instructions of polling loops that were counted and not run.
    skipped: u64,
    deadline: u64,
    horizon: u64,
    restart: bool,
    held: bool,
    /// The core has no clock.
    unclocked: bool,
    /// The instant of the call the models are in, for what they drive.
    instant: u64,
    watched: Vec<(u16, bool)>,
    edges: Vec<LineEdge>,
    findings: Vec<(FindingKind, u64, Option<u64>, String)>,
    poll: PollWatch,
    skips: bool,
    reported: Reported,
    /// Whether the models were called since errors were last looked for.
    touched: bool,
}

/// How much of the session's own lists has been turned into findings.
#[derive(Debug, Default)]
struct Reported {
    refused: usize,
    unimplemented: usize,
    undefined: usize,
    unrouted: usize,
    told: usize,
    unmapped: usize,
    of_part: usize,
}

impl Side {
    /// Nanoseconds the core was awake with `retired` instructions behind it.
    fn awake(&self, retired: u64) -> u64 {
        let (instructions, nanos) = self.before;
        nanos + self.clock.nanos(retired + self.skipped - instructions)
    }

    fn time(&self, retired: u64) -> u64 {
        self.warped + self.awake(retired)
    }

    /// The core goes on at `rate`.
    fn follow(&mut self, rate: Rate, retired: u64) {
        self.unclocked = rate.hz == 0;
        if rate != self.rate && rate.hz > 0 {
            self.before = (retired + self.skipped, self.awake(retired));
            (self.rate, self.clock) = (rate, Clock::fast(rate));
        }
    }

    /// How many instructions from `retired` reach `target`, at least one.
    fn until(&self, retired: u64, target: u64) -> u32 {
        let (instructions, nanos) = self.before;
        let count = instructions + self.clock.instructions(target.saturating_sub(self.warped + nanos));
        let left = count.saturating_sub(retired + self.skipped).clamp(1, 1 << 30);
        u32::try_from(left).unwrap_or(1 << 30)
    }

    fn target(&self, event: Option<VirtualNanos>) -> u64 {
        self.deadline.min(self.horizon).min(event.map_or(u64::MAX, |event| event.0))
    }

    fn find(&mut self, kind: FindingKind, at: u64, pc: Option<u64>, text: String) {
        self.findings.push((kind, at, pc, text));
    }

    /// Guest memory as a bus controller reaches it: not what hangs on the core's own bus.
    fn reachable(&mut self, address: u64, width: Width) -> Result<(), EmulatorError> {
        if self.core_only.iter().any(|range| range.contains(&address)) {
            let text = format!("a bus controller was pointed at {address:#010x}, which only the core reaches");
            self.find(FindingKind::Unreachable, self.instant, None, text);
            return Err(EmulatorError::Memory { address, width });
        }
        Ok(())
    }
}

impl Memory for Side {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, EmulatorError> {
        self.reachable(address, width)?;
        self.memory.value(address, bytes(width)).ok_or(EmulatorError::Memory { address, width })
    }

    fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), EmulatorError> {
        self.reachable(address, width)?;
        let writable = self.memory.usage(address, bytes(width)) == Some(Use::Written);
        let written = writable && self.memory.put(address, bytes(width), value);
        written.then_some(()).ok_or(EmulatorError::Memory { address, width })
    }

    fn program(&mut self, address: u64, width: Width, value: u64) -> Result<(), EmulatorError> {
        let programmed = self.memory.usage(address, bytes(width)) == Some(Use::Programmed);
        let written = programmed && self.memory.put(address, bytes(width), value);
        written.then_some(()).ok_or(EmulatorError::Memory { address, width })
    }
}

impl Host for Side {
    fn set_interrupt(&mut self, line: InterruptLine, level: Level) {
        let high = level == Level::High;
        if let Some((line, was)) = self.watched.iter_mut().find(|(watched, _)| *watched == line.index())
            && *was != high
        {
            *was = high;
            self.edges.push(LineEdge { at: self.instant, line: *line, high });
        }
        self.queue.push(Queued::Line(line, level));
    }

    fn request_reset(&mut self) {
        self.restart = true;
        self.queue.push(Queued::Return);
    }

    fn hold(&mut self, held: bool) {
        self.held = held;
        self.queue.push(Queued::Return);
    }
}

fn bytes(width: Width) -> usize {
    width.bytes() as usize
}

/// What the core reaches while it runs a stretch.
struct Lent<'a, B: Wiring> {
    side: &'a mut Side,
    session: &'a mut Session<Carrier<B>>,
}

impl<B: Wiring> Lent<'_, B> {
    /// A store to memory that is not mapped writable, or an access to a page routed here.
    fn access_memory(&mut self, access: &Access, usage: Use) -> Option<Option<u64>> {
        let width = bytes(access.width);
        match (access.kind, usage) {
            (AccessKind::Read, _) => Some(self.side.memory.value(access.address, width)),
            (AccessKind::Write, Use::Written) => {
                self.side.memory.put(access.address, width, access.value);
                Some(Some(access.value))
            }
            (AccessKind::Write, Use::Stored) => {
                if self.session.board_mut().0.part_mut().flash(access) == FlashAction::Program {
                    let was = self.side.memory.value(access.address, width)?;
                    self.side.memory.put(access.address, width, was & access.value);
                }
                Some(Some(access.value))
            }
            // The part's own model takes the store.
            (AccessKind::Write, Use::Programmed) => None,
        }
    }
}

impl<B: Wiring> CoreBus for Lent<'_, B> {
    fn access(&mut self, access: Access, _from_code: bool) -> Option<u64> {
        let at = access.virtual_time;
        self.side.instant = at.0;
        self.side.touched = true;
        if let Some(usage) = self.side.memory.usage(access.address, bytes(access.width)) {
            if let Some(answer) = self.access_memory(&access, usage) {
                return answer;
            }
        } else if self.session.mcu().bus().slot_at(access.address).is_none() {
            // Nothing is there. Rigless alone would answer zero; the part answers with a bus error.
            let verb = if access.kind == AccessKind::Read { "read" } else { "write" };
            let text =
                format!("{} bit {verb} at {:#010x}, where the part has nothing", access.width.bits(), access.address);
            self.side.find(FindingKind::Unmapped, at.0, access.program_counter, text);
            return None;
        }
        let (value, next) = self.session.access(access, self.side);
        self.side.deadline = next.0;
        let refused = self.session.refused();
        if refused.len() > self.side.reported.refused {
            self.side.reported.refused = refused.len();
            if let Some(fault) = refused.get(&access.address) {
                let text = format!("access at {:#010x}: {fault}", access.address);
                self.side.find(FindingKind::Refused, at.0, access.program_counter, text);
            }
        }
        if self.session.take_failure() {
            return None;
        }
        let board = &mut self.session.board_mut().0;
        if access.kind == AccessKind::Write
            && let FlashAction::Erase(range) = board.part_mut().flash(&access)
        {
            self.side.memory.erase(range.start, range.end);
        }
        match (access.kind, access.program_counter) {
            (AccessKind::Read, Some(pc)) if self.side.skips => {
                self.side.poll.read(pc, access.address, value, access.instruction_count);
            }
            _ => self.side.poll.other(access.instruction_count),
        }
        board.saw(&access, value);
        settle(self.session, self.side, at, access.instruction_count);
        Some(value)
    }

    fn time(&self, instructions: u64) -> VirtualNanos {
        VirtualNanos(self.side.time(instructions))
    }

    fn queued(&mut self) -> Vec<Queued> {
        let mut all = self.side.memory.take_changed();
        all.append(&mut self.side.queue);
        all
    }

    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        let side = &self.side;
        let board = &self.session.board().0;
        let target = side.target(event).min(board.next_event());
        let on = !side.restart
            && !side.held
            && !side.unclocked
            && side.poll.streak < poll::STREAK
            && target > side.time(instructions)
            && !board.outgoing();
        on.then(|| side.until(instructions, target))
    }
}

/// Lets the part and the board look at their pins until nothing moves any more.
fn settle<B: Wiring>(session: &mut Session<Carrier<B>>, side: &mut Side, at: VirtualNanos, instructions: u64) {
    loop {
        let board = &mut session.board_mut().0;
        let by_board = board.settle(at.0);
        let by_part = board.part_mut().settle(at.0);
        if !by_board && !by_part {
            side.follow(board.part().rate(), instructions);
            return;
        }
        side.deadline = session.resume(NO_DEADLINE, at, instructions, side).0;
    }
}

/// One board, running one firmware.
#[derive(Debug)]
pub struct Node<B: Wiring> {
    // Declared before `side`: dropped while the memory it maps is still there.
    cpu: Box<dyn Processor>,
    session: Session<Carrier<B>>,
    side: Side,
    firmware: Firmware,
    boot: u64,
    asleep: bool,
    locked_up: bool,
    /// Which of the session's resets were the supply's.
    by_supply: BTreeSet<usize>,
    semihosting: bool,
    exit: Option<u32>,
    traps: Traps,
    probe_at: u64,
    log_block: Option<u64>,
    log_lost: bool,
    log: LogStream,
    lines: Vec<LogLine>,
    console: Vec<u8>,
    findings: Vec<Finding>,
    reported: BTreeSet<(FindingKind, String)>,
}

/// Instructions the node stops at to report what happened, and goes on from.
#[derive(Debug, Default)]
struct Traps {
    hard_fault: Option<u64>,
    default_handler: BTreeSet<u64>,
    panic: BTreeSet<u64>,
}

impl<B: Wiring> Node<B> {
    /// `board` with `firmware` in its memory, at power-on.
    ///
    /// # Errors
    ///
    /// A board the emulator refuses, or an image that does not fit the part.
    pub fn new(board: B, firmware: &Firmware) -> Result<Self, Error> {
        let rate = board.part().rate();
        let core = board.part().core();
        let mut cpu = (core.processor)(Endian::Little)?;
        let mut memory = GuestMemory::new(board.part().bus().memory(), &core.aliases);
        memory.map_to(&mut *cpu);
        for (address, bytes) in firmware.segments() {
            if !memory.write(*address, bytes) {
                return Err(Error::Placement {
                    firmware: firmware.name().to_owned(),
                    part: B::Part::NAME,
                    address: *address,
                    length: bytes.len(),
                });
            }
        }
        let boot = core.boot.reset;
        let vector = |number: u64| memory.value(boot + 4 * number, 4).map(|address| address & !1);
        let traps = Traps {
            hard_fault: vector(HARD_FAULT).filter(|&address| firmware.name_of(address).is_some()),
            default_handler: firmware
                .symbol("DefaultHandler_")
                .or_else(|| firmware.symbol("DefaultHandler"))
                .map(|symbol| symbol.address)
                .into_iter()
                .collect(),
            panic: firmware.functions_called("rust_begin_unwind").collect(),
        };
        for &trap in traps.hard_fault.iter().chain(&traps.default_handler).chain(&traps.panic) {
            cpu.add_breakpoint(trap);
        }
        let core_only = board.part().core_only();
        let session = Session::new(Box::new(Carrier(board)), 0, NO_DEADLINE)?;
        let side = Side {
            memory,
            core_only,
            queue: Vec::new(),
            rate,
            clock: Clock::fast(rate),
            before: (0, 0),
            warped: 0,
            skipped: 0,
            deadline: 0,
            horizon: 0,
            restart: false,
            held: false,
            unclocked: false,
            instant: 0,
            watched: Vec::new(),
            edges: Vec::new(),
            findings: Vec::new(),
            poll: PollWatch::default(),
            skips: true,
            reported: Reported::default(),
            touched: false,
        };
        let mut node = Self {
            cpu,
            session,
            side,
            boot,
            asleep: false,
            locked_up: false,
            by_supply: BTreeSet::new(),
            semihosting: false,
            exit: None,
            traps,
            probe_at: PROBE_PERIOD,
            log_block: firmware.symbol("_SEGGER_RTT").map(|symbol| symbol.address),
            log_lost: false,
            log: LogStream::default(),
            lines: Vec::new(),
            console: Vec::new(),
            findings: Vec::new(),
            reported: BTreeSet::new(),
            firmware: firmware.clone(),
        };
        node.side.memory.take_changed();
        node.start();
        settle(&mut node.session, &mut node.side, VirtualNanos(0), 0);
        node.side.deadline = node.session.next_deadline().0;
        node.flush();
        Ok(node)
    }

    /// Serves the firmware's semihosting calls, as a debug probe does: console output, and an exit that stops the core.
    #[must_use]
    pub fn with_semihosting(mut self) -> Self {
        self.semihosting = true;
        self
    }

    /// Whether proven polling loops are counted instead of run, as they are unless told otherwise. The run is the same
    /// either way.
    pub fn skip_polling_loops(&mut self, skip: bool) {
        self.side.skips = skip;
    }

    fn start(&mut self) {
        let memory = &self.side.memory;
        self.cpu.boot(self.boot, &|address, width| memory.value(address, bytes(width)));
        self.asleep = false;
        self.log.restart();
    }

    /// The instant this board has reached, in virtual nanoseconds.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.side.time(self.cpu.retired())
    }

    /// The first instant this board may act at without anything from outside. Its own present while the core is awake.
    #[must_use]
    pub fn earliest(&self) -> u64 {
        if self.asleep || self.exit.is_some() || self.locked_up || self.side.unclocked {
            self.deadline().min(self.cpu.next_event().map_or(u64::MAX, |event| event.0)).max(self.now())
        } else {
            self.now()
        }
    }

    /// The longest an instruction takes at the core's present rate, in virtual nanoseconds.
    #[must_use]
    pub fn instruction_ns(&self) -> u64 {
        self.side.clock.nanos(1) + 1
    }

    /// The next instant a model of the part or a chip of the board acts at.
    fn deadline(&self) -> u64 {
        self.side.deadline.min(self.board().next_event())
    }

    /// Where the next stretch ends at the latest.
    fn target(&self) -> u64 {
        self.side.target(self.cpu.next_event()).min(self.board().next_event())
    }

    /// The board, to read.
    #[must_use]
    pub fn board(&self) -> &B {
        &self.session.board().0
    }

    /// The board, to take out what its chips collected. What changes a pin or a bus goes through [`Node::input`].
    pub fn board_mut(&mut self) -> &mut B {
        &mut self.session.board_mut().0
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
        self.asleep
    }

    /// Something outside acts on the board now: a pin, a byte on a line, an edge of an SPI clock. The models hear of it
    /// at this instant, and so does the core if it raised an interrupt.
    pub fn input<T>(&mut self, act: impl FnOnce(&mut B, u64) -> T) -> T {
        self.input_with_memory(|board, _, at| act(board, at))
    }

    /// As [`Node::input`], for what makes a bus controller of the part reach memory at once rather than when the models
    /// settle.
    pub fn input_with_memory<T>(&mut self, act: impl FnOnce(&mut B, &mut dyn Memory, u64) -> T) -> T {
        let at = VirtualNanos(self.now());
        self.side.instant = at.0;
        let retired = self.cpu.retired();
        let answer = act(&mut self.session.board_mut().0, &mut self.side, at.0);
        self.side.deadline = self.session.resume(NO_DEADLINE, at, retired, &mut self.side).0;
        settle(&mut self.session, &mut self.side, at, retired);
        self.flush();
        answer
    }

    /// Runs to the first instruction boundary at or past `to`, or to one where something left the board.
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
            if self.take_restart() && stops {
                return true;
            }
            let now = self.now();
            if now >= self.probe_at {
                self.probe(now);
            }
            let stopped = self.exit.is_some() || self.locked_up || self.side.held || self.side.unclocked;
            if !stopped && self.cpu.next_event().is_some_and(|event| event.0 <= now) {
                self.cpu.on_event(VirtualNanos(now));
                self.asleep = false;
                continue;
            }
            if now >= self.deadline() {
                let reason = if self.asleep || stopped { StopReason::Idle } else { StopReason::Deadline };
                self.stop(reason);
                continue;
            }
            if now >= to || self.session.board().0.outgoing() {
                return false;
            }
            if stopped {
                self.side.warped += self.deadline().min(to) - now;
                continue;
            }
            // A sleeping firmware logs nothing, so only one that runs is stopped for its log.
            self.side.horizon = if self.asleep { to } else { to.min(self.probe_at) };
            self.run_stretch();
        }
    }

    /// The core's NMI input is level sensitive here: whatever stands after the handler has returned makes it pending
    /// again. Answers whether it stands.
    fn take_nmi(&mut self) -> bool {
        if !self.session.board().0.part().nmi() {
            return false;
        }
        if self.register(16) & 0x1FF != NMI {
            let now = VirtualNanos(self.now());
            self.cpu.debugger_access(Some(NMIPENDSET), ICSR, Width::W32, now);
            self.asleep = false;
        }
        true
    }

    fn run_stretch(&mut self) {
        let nmi = self.take_nmi();
        let target = self.target();
        if self.asleep {
            // Whatever could wake the core was asked of it and cleared the flag: it would run nothing.
            self.side.warped += target.saturating_sub(self.now());
            return;
        }
        let budget = self.side.until(self.cpu.retired(), target);
        let (exit, retired) = self.run(if nmi { budget.min(NMI_LOOK) } else { budget });
        match exit {
            Exit::Lockup if !self.locked_up => self.lock_up(),
            Exit::Breakpoint => self.trapped(),
            Exit::HostCall => self.host_call(),
            _ => {}
        }
        self.asleep = retired == 0 && self.side.queue.is_empty() && self.cpu.waiting() && exit == Exit::Waiting;
        self.flush();
        if std::mem::take(&mut self.side.touched) {
            self.report_errors();
        }
        if self.side.poll.streak >= poll::STREAK {
            self.skip_polling();
        }
        if self.asleep {
            self.side.warped += target.saturating_sub(self.now());
        }
    }

    /// The core locks up, as a fault inside a fault handler makes it: it runs nothing until it is reset.
    pub fn lock_up(&mut self) {
        self.locked_up = true;
        let pc = self.cpu.pc();
        self.find(FindingKind::Lockup, Some(pc), "the core locked up: a fault inside a fault handler".into());
        self.input(|board, at| board.part_mut().locked_up(at));
    }

    /// Restarts the part from outside, now. Its flags say why, as far as it has flags for it, and [`Node::resets`]
    /// lists it.
    pub fn restart(&mut self, why: FromOutside) {
        let at = VirtualNanos(self.now());
        self.side.instant = at.0;
        let retired = self.cpu.retired();
        let how = match why {
            FromOutside::Pin => None,
            FromOutside::PowerOn(_) => Some(Supply::PowerOn),
            FromOutside::BrownOut => Some(Supply::BrownOut),
        };
        if let Some(how) = how {
            self.by_supply.insert(self.session.resets().len());
            self.session.board_mut().0.part_mut().supply_failed(how);
        }
        self.session.reset_by_pin(at, retired, &mut self.side);
        self.side.deadline = self.session.resume(NO_DEADLINE, at, retired, &mut self.side).0;
        settle(&mut self.session, &mut self.side, at, retired);
        self.take_restart();
        if let FromOutside::PowerOn(seed) = why {
            self.side.memory.come_up(seed);
        }
        self.flush();
    }

    fn run(&mut self, budget: u32) -> (Exit, u64) {
        self.cpu.run(budget, &mut Lent { side: &mut self.side, session: &mut self.session })
    }

    /// Restarts the core after the models or the firmware asked for a reset, and answers whether it did.
    fn take_restart(&mut self) -> bool {
        let by_model = std::mem::take(&mut self.side.restart);
        let by_core = self.cpu.take_reset_request();
        if by_core {
            self.stop(StopReason::Reset);
            self.side.restart = false;
        }
        if by_core || by_model {
            // What the firmware logged last, before its start-up code clears the buffer.
            self.probe_log(self.now());
            self.locked_up = false;
            self.cpu.reset();
            self.start();
            self.flush();
        }
        by_core || by_model
    }

    fn stop(&mut self, reason: StopReason) {
        let at = VirtualNanos(self.now());
        let stop = Stop { at, instruction_count: self.cpu.retired(), reason };
        // The models' event was due at the deadline; the core stopped on the instruction boundary after it.
        self.side.instant = at.0.min(self.deadline());
        self.side.deadline = self.session.stop(stop, &mut self.side).0;
        self.side.instant = at.0;
        settle(&mut self.session, &mut self.side, at, stop.instruction_count);
        self.flush();
        self.report_errors();
    }

    fn flush(&mut self) {
        self.asleep &= self.side.queue.is_empty();
        let changed = self.side.memory.take_changed();
        for queued in changed.into_iter().chain(std::mem::take(&mut self.side.queue)) {
            self.cpu.ask(queued);
        }
    }

    /// Counts the iterations of a polling loop up to the next event instead of running them, once the loop is proven to
    /// change nothing. See [`super::poll`].
    fn skip_polling(&mut self) {
        let gap = self.side.poll.gap;
        let target = self.target();
        if u64::from(self.side.until(self.cpu.retired(), target)) < 3 * gap || !self.polls_a_status() {
            self.side.poll.streak = 0;
            return;
        }
        let before = self.all_registers();
        for _ in 0..gap {
            let harmless = self.next_is_harmless();
            let (exit, retired) = self.run(1);
            self.flush();
            if !harmless || retired != 1 || !matches!(exit, Exit::Budget | Exit::Returned) {
                self.side.poll.streak = 0;
                return;
            }
        }
        if self.side.poll.streak < poll::STREAK || self.side.poll.gap != gap || self.all_registers() != before {
            self.side.poll.streak = 0;
            return;
        }
        let target = self.target();
        let left = u64::from(self.side.until(self.cpu.retired(), target));
        self.side.skipped += left.saturating_sub(1) / gap * gap;
    }

    fn polls_a_status(&mut self) -> bool {
        let Some(address) = self.side.poll.address() else { return false };
        let bus = self.session.mcu().bus();
        let Some(slot) = bus.slot_at(address) else { return false };
        let peripheral = bus.slots()[slot].peripheral();
        let offset = address - peripheral.base;
        peripheral
            .registers
            .iter()
            .find(|register| u64::from(register.offset) == offset & !3)
            .is_some_and(|register| !poll::is_consumed_by_reading(register.name))
    }

    fn all_registers(&self) -> Vec<Option<Vec<u8>>> {
        poll::REGISTERS.map(|number| self.cpu.gdb_register(number)).collect()
    }

    fn next_is_harmless(&self) -> bool {
        let half = |address| self.side.memory.value(address, 2).and_then(|value| u16::try_from(value).ok());
        let pc = self.cpu.pc();
        let Some(first) = half(pc) else { return false };
        let second = if poll::is_wide(first) { half(pc + 2) } else { Some(0) };
        second.is_some_and(|second| poll::is_harmless(first, second, |number| self.register(number)))
    }

    /// Core register `number`: 0 to 15, then xPSR at 16.
    #[must_use]
    pub fn register(&self, number: usize) -> u32 {
        self.cpu
            .gdb_register(number)
            .and_then(|bytes| bytes.get(..4).and_then(|bytes| bytes.try_into().ok()))
            .map_or(0, u32::from_le_bytes)
    }

    /// The word at `address` as a debugger reads it: memory, or the processor's own registers.
    #[must_use]
    pub fn word(&mut self, address: u64) -> Option<u32> {
        let now = VirtualNanos(self.now());
        let own = self.cpu.debugger_access(None, address, Width::W32, now);
        own.or_else(|| self.side.memory.value(address, 4)).and_then(|word| u32::try_from(word).ok())
    }

    /// Fills `to` from memory at `address`.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`].
    pub fn read(&self, address: u64, to: &mut [u8]) -> Result<(), Error> {
        let length = to.len();
        self.side.memory.read(address, to).then_some(()).ok_or(Error::NotMemory { address, length })
    }

    /// Writes `from` to memory at `address`, flash included, as a debugger does.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`].
    pub fn write(&mut self, address: u64, from: &[u8]) -> Result<(), Error> {
        let written = self.side.memory.write(address, from);
        self.flush_memory();
        written.then_some(()).ok_or(Error::NotMemory { address, length: from.len() })
    }

    fn flush_memory(&mut self) {
        for queued in self.side.memory.take_changed() {
            self.cpu.ask(queued);
        }
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

    /// How long the core was awake since power-on. An instruction counts with the time the clock gives it, polling that
    /// was skipped included.
    #[must_use]
    pub fn usage(&self) -> Usage {
        Usage { awake: self.side.awake(self.cpu.retired()), total: self.now() }
    }

    /// Instructions the core retired since power-on, polling that was skipped included.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.cpu.retired() + self.side.skipped
    }

    /// How many of [`Node::instructions`] were proven polling and not run.
    #[must_use]
    pub fn instructions_skipped(&self) -> u64 {
        self.side.skipped
    }

    /// Every restart of the part so far.
    pub fn resets(&self) -> impl ExactSizeIterator<Item = ResetAt> {
        self.session.resets().iter().enumerate().map(|(nth, reset)| ResetAt {
            at: reset.at.0,
            cause: if self.by_supply.contains(&nth) { ResetCause::PowerOn } else { reset.cause },
        })
    }

    /// The log lines since last asked, console output through semihosting among them.
    pub fn take_log(&mut self) -> Vec<LogLine> {
        self.probe_log(self.now());
        std::mem::take(&mut self.lines)
    }

    /// Empties RTT up channel `channel` other than the log's (0).
    pub fn take_channel(&mut self, channel: u64) -> Vec<u8> {
        let Some(block) = self.log_block else { return Vec::new() };
        let bytes = rtt::drain(&mut self.side.memory, block, channel).unwrap_or_default();
        self.flush_memory();
        bytes
    }

    /// What went wrong since last asked.
    pub fn take_findings(&mut self) -> Vec<Finding> {
        self.report_errors();
        std::mem::take(&mut self.findings)
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
        for register in self.all_registers().into_iter().flatten() {
            digest.bytes(&register);
        }
        digest.word(self.now());
        digest.word(self.instructions());
        self.side.memory.digest(&mut digest);
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
        let symbol = pc.and_then(|pc| {
            let name = self.firmware.name_of(pc)?;
            Some(match self.firmware.line_of(pc) {
                Some(line) => format!("{name} ({line})"),
                None => name,
            })
        });
        self.findings.push(Finding { kind, at, pc, symbol, text });
    }

    /// A finding of the caller's own about this node, at its present.
    pub(crate) fn add_note(&mut self, kind: FindingKind, text: String) {
        self.find(kind, None, text);
    }

    /// Turns what the session listed since the last call into findings, stamped with the present.
    fn report_errors(&mut self) {
        let at = self.now();
        let mut found = std::mem::take(&mut self.side.findings);
        if let Some(error) = self.session.take_error()
            && !found.iter().any(|(kind, ..)| *kind == FindingKind::Unreachable)
        {
            found.push((FindingKind::Unreachable, at, None, format!("a model could not go on: {error}")));
        }
        self.report_session(at, &mut found);
        let part = self.session.board().0.part();
        if part.finding_count() != self.side.reported.of_part {
            self.side.reported.of_part = part.finding_count();
            found.extend(part.findings().into_iter().map(|(kind, at, text)| (kind, at, None, text)));
        }
        for (kind, at, pc, text) in found {
            // A list that grew is listed whole; what was already reported is dropped here.
            if self.reported.insert((kind, text.clone())) {
                self.add_finding(kind, at, pc, text);
            }
        }
    }

    fn report_session(&mut self, at: u64, found: &mut Vec<(FindingKind, u64, Option<u64>, String)>) {
        let session = &self.session;
        let reported = &mut self.side.reported;
        // The session keeps the first access for each address, so a list that did not grow has nothing new.
        if session.refused().len() != reported.refused {
            reported.refused = session.refused().len();
            for (address, fault) in session.refused() {
                found.push((FindingKind::Refused, at, None, format!("access at {address:#010x}: {fault}")));
            }
        }
        if session.unimplemented().len() != reported.unimplemented {
            reported.unimplemented = session.unimplemented().len();
            for (address, access) in session.unimplemented() {
                let text = match access.written {
                    Some(value) => format!(
                        "{}.{} ({address:#010x}) has no model and was written {value:#x}",
                        access.instance, access.register
                    ),
                    None => {
                        format!("{}.{} ({address:#010x}) has no model and was read", access.instance, access.register)
                    }
                };
                found.push((FindingKind::Unmodelled, at, Some(access.program_counter), text));
            }
        }
        if session.undefined().len() != reported.undefined {
            reported.undefined = session.undefined().len();
            for (address, access) in session.undefined() {
                let text = format!("{} has no register at {address:#010x}", access.instance);
                found.push((FindingKind::Undefined, at, Some(access.program_counter), text));
            }
        }
        if session.unrouted().len() != reported.unrouted {
            reported.unrouted = session.unrouted().len();
            for (instance, number) in session.unrouted() {
                let text = format!("{instance} raised interrupt {number}, which the core has no line for");
                found.push((FindingKind::Unrouted, at, None, text));
            }
        }
        let told = session.told().count();
        if told != reported.told {
            reported.told = told;
            for told in session.told() {
                let text = format!("{}.{}: {}", told.instance, told.register, told.reason);
                found.push((FindingKind::Misuse, told.at.0, None, text));
            }
        }
        if session.unmapped().len() != reported.unmapped {
            let unmapped = session.unmapped();
            reported.unmapped = unmapped.len();
            for access in unmapped {
                let text = format!("no register at {:#010x}", access.address);
                found.push((FindingKind::Unmapped, at, Some(access.program_counter), text));
            }
        }
    }

    /// The core is about to run an instruction the node watches.
    fn trapped(&mut self) {
        let pc = self.cpu.pc();
        if self.traps.hard_fault == Some(pc) {
            self.report_exception(FindingKind::HardFault);
        } else if self.traps.panic.contains(&pc) {
            self.report_panic();
        } else if self.traps.default_handler.contains(&pc) {
            self.report_exception(FindingKind::UnhandledInterrupt);
        }
        self.cpu.pass_breakpoint(pc);
    }

    fn report_exception(&mut self, kind: FindingKind) {
        let exception = self.register(16) & 0x1FF;
        let returns = self.register(14);
        // EXC_RETURN bit 2 says which stack the core pushed its frame on, ARMv7-M ARM table B1-8.
        let stack = if returns & 4 != 0 { self.register(35) } else { self.register(34) };
        let pushed = |index: u64| self.side.memory.value(u64::from(stack) + 4 * index, 4);
        let (lr, pc) = (pushed(5), pushed(6));
        let (cfsr, hfsr) = (self.word(CFSR).unwrap_or(0), self.word(HFSR).unwrap_or(0));
        let mut text = match kind {
            FindingKind::HardFault => {
                format!("HardFault: {} (CFSR {cfsr:#010x}, HFSR {hfsr:#010x})", fault_names(cfsr, hfsr))
            }
            _ => format!("exception {exception} (interrupt {}) has no handler", i64::from(exception) - 16),
        };
        if cfsr & 0x8000 != 0
            && let Some(address) = self.word(BFAR)
        {
            text += &format!(", bus fault address {address:#010x}");
        }
        if let Some(caller) = lr.and_then(|lr| self.firmware.name_of(lr)) {
            text += &format!(", called from {caller}");
        }
        self.find(kind, pc, text);
    }

    fn report_panic(&mut self) {
        let place = self.panic_place();
        let lr = u64::from(self.register(14)) & !1;
        let text = match place {
            Some(place) => format!("panicked at {place}; the message is in the log"),
            None => "panicked; the message is in the log".to_owned(),
        };
        self.find(FindingKind::Panic, Some(lr.saturating_sub(2)), text);
    }

    /// `PanicInfo` has no stable layout, but it holds a `&Location`: {file name, its length, line, column}. The first
    /// word of it that points to something of that shape is taken.
    fn panic_place(&self) -> Option<String> {
        let info = u64::from(self.register(0));
        let memory = &self.side.memory;
        (0..6).find_map(|index| {
            let location = memory.value(info + 4 * index, 4)?;
            let word = |index: u64| memory.value(location + 4 * index, 4);
            let (name, length, line, column) = (word(0)?, word(1)?, word(2)?, word(3)?);
            if !(4..=512).contains(&length) || line == 0 || line > 1_000_000 || column > 10_000 {
                return None;
            }
            let mut text = vec![0; usize::try_from(length).ok()?];
            memory.read(name, &mut text).then_some(())?;
            let text = String::from_utf8(text).ok().filter(|text| text.trim_end_matches('\0').ends_with(".rs"))?;
            Some(format!("{}:{line}:{column}", text.trim_end_matches('\0')))
        })
    }

    /// The firmware asked something of the host it is debugged from.
    fn host_call(&mut self) {
        let memory = &self.side.memory;
        let call = self.cpu.host_call(&mut |address, width| memory.value(address, bytes(width)));
        if !self.semihosting {
            self.cpu.answer_host_call(None);
            return;
        }
        let answer = match call {
            Some(HostCall::Exit { code }) => {
                self.exit = Some(code);
                if code != 0 {
                    let pc = self.cpu.pc();
                    self.find(
                        FindingKind::ExitStatus,
                        Some(pc),
                        format!("the firmware ended the run with status {code}"),
                    );
                }
                Some(0)
            }
            Some(HostCall::Write { handle: 1 | 2, address, length }) => {
                let mut text = vec![0; usize::try_from(length).unwrap_or(0)];
                let there = self.side.memory.read(address, &mut text);
                self.print(&text);
                // SYS_WRITE answers how many bytes it did not write.
                Some(if there { 0 } else { length })
            }
            Some(HostCall::OpenConsole { handle }) => Some(handle),
            Some(HostCall::Close { handle: 0..=2 }) => Some(0),
            Some(HostCall::IsTty { handle }) => Some(u64::from(handle <= 2)),
            Some(HostCall::Clock) => Some(self.now() / 10_000_000),
            Some(HostCall::Errno) => Some(0),
            Some(HostCall::TickFrequency) => Some(1_000_000_000),
            Some(HostCall::Elapsed { block }) => {
                let now = self.now();
                self.side.memory.put(block, 8, now);
                Some(0)
            }
            // There is no file system here: -1 is "failed" in every call that is left.
            Some(_) => Some(u64::from(u32::MAX)),
            None => {
                let operation = self.register(0);
                let text = format!("semihosting operation {operation:#x} is not served");
                self.find(FindingKind::Unmodelled, Some(self.cpu.pc()), text);
                Some(u64::from(u32::MAX))
            }
        };
        self.cpu.answer_host_call(answer);
    }

    fn print(&mut self, text: &[u8]) {
        self.console.extend_from_slice(text);
        let at = self.now();
        while let Some(end) = self.console.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.console.drain(..=end).collect();
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            self.lines.push(LogLine { at, timestamp: String::new(), level: LogLevel::None, text });
        }
    }

    /// A debug probe's look at the log, on a grid of [`PROBE_PERIOD`].
    fn probe(&mut self, now: u64) {
        self.probe_at = (now / PROBE_PERIOD + 1) * PROBE_PERIOD;
        self.probe_log(now);
    }

    fn probe_log(&mut self, at: u64) {
        let Some(block) = self.log_block else { return };
        match rtt::drain(&mut self.side.memory, block, 0) {
            Ok(bytes) if bytes.is_empty() => {}
            Ok(bytes) => {
                let lines = &mut self.lines;
                let malformed = self.log.take(self.firmware.log_table(), at, &bytes, |line| lines.push(line));
                if malformed > 0 {
                    let text = format!("{malformed} log frames did not decode: the log buffer overran");
                    self.add_finding(FindingKind::LogOverrun, at, None, text);
                }
            }
            Err(RttFault::NotYet) => {}
            Err(RttFault::Corrupt(text)) => {
                if !std::mem::replace(&mut self.log_lost, true) {
                    self.add_finding(FindingKind::LogCorrupt, at, None, text);
                }
            }
        }
        self.flush_memory();
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
