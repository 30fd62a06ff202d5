//! One board of the running link as gdb's target.

use std::collections::BTreeSet;

use bench_judge::Board as Side;
use bench_seam::Pin;
use cortex_m4::{Cost, Register, Watchpoint};
use gdbstub::common::Signal;
use gdbstub::stub::SingleThreadStopReason;
use gdbstub::target::ext::base::BaseOps;
use gdbstub::target::ext::base::single_register_access::{SingleRegisterAccess, SingleRegisterAccessOps};
use gdbstub::target::ext::base::singlethread::{
    SingleThreadBase, SingleThreadRangeStepping, SingleThreadRangeSteppingOps, SingleThreadResume,
    SingleThreadResumeOps, SingleThreadSingleStep, SingleThreadSingleStepOps,
};
use gdbstub::target::ext::breakpoints::{
    Breakpoints, BreakpointsOps, HwBreakpoint, HwBreakpointOps, HwWatchpoint, HwWatchpointOps, SwBreakpoint,
    SwBreakpointOps, WatchKind,
};
use gdbstub::target::ext::monitor_cmd::{ConsoleOutput, MonitorCmd, MonitorCmdOps};
use gdbstub::target::{Target, TargetError, TargetResult};
use gdbstub_arch::arm::ArmBreakpointKind;

use super::arch::{CoreRegisters, CortexM4, Number};
use crate::node::{self, Halt, Node, Resume};
use crate::sim::{Debugged, Error, Observer};

/// EFAULT of gdb's remote protocol ("Debugging with GDB", appendix E.13.9, Errno Values).
const BAD_ADDRESS: u8 = 14;

/// A node of either board.
pub(super) trait Debuggable {
    fn register(&self, register: Register) -> u32;
    fn set_register(&mut self, register: Register, value: u32);
    fn peek(&self, address: u32, to: &mut [u8]) -> usize;
    fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), node::Error>;
    fn halted(&self) -> Option<Halt>;
    fn halt(&mut self);
    fn resume(&mut self, how: Resume);
    fn set_breakpoint(&mut self, address: u32);
    fn clear_breakpoint(&mut self, address: u32);
    fn set_watchpoint(&mut self, watchpoint: Watchpoint);
    fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool;
    fn halt_after_reset(&mut self, on: bool);
    fn now(&self) -> u64;
    fn instructions(&self) -> u64;
    fn doing(&self) -> String;
    fn pin(&self, pin: Pin) -> bool;
    fn drive(&mut self, pin: Pin, level: Option<bool>);
}

impl<B: node::Board, C: Cost> Debuggable for Node<B, C> {
    fn register(&self, register: Register) -> u32 {
        self.core_register(register)
    }

    fn set_register(&mut self, register: Register, value: u32) {
        self.set_core_register(register, value);
    }

    fn peek(&self, address: u32, to: &mut [u8]) -> usize {
        self.peek(address, to)
    }

    fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), node::Error> {
        self.poke(address, from)
    }

    fn halted(&self) -> Option<Halt> {
        self.halted()
    }

    fn halt(&mut self) {
        self.halt();
    }

    fn resume(&mut self, how: Resume) {
        self.resume(how);
    }

    fn set_breakpoint(&mut self, address: u32) {
        self.set_breakpoint(address);
    }

    fn clear_breakpoint(&mut self, address: u32) {
        self.clear_breakpoint(address);
    }

    fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        self.set_watchpoint(watchpoint);
    }

    fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        self.clear_watchpoint(watchpoint)
    }

    fn halt_after_reset(&mut self, on: bool) {
        self.halt_after_reset(on);
    }

    fn now(&self) -> u64 {
        self.now()
    }

    fn instructions(&self) -> u64 {
        self.instructions()
    }

    fn doing(&self) -> String {
        self.doing()
    }

    fn pin(&self, pin: Pin) -> bool {
        self.pin(pin)
    }

    fn drive(&mut self, pin: Pin, level: Option<bool>) {
        self.drive(pin, level);
    }
}

/// One board of a run, and the run around it.
pub(super) struct Debuggee<'a, C: Cost> {
    pub(super) run: Debugged<C>,
    pub(super) side: Side,
    pub(super) observer: &'a mut dyn Observer,
    /// Receivers in the profile, and the seed: what `monitor faults` draws from.
    pub(super) gps: usize,
    pub(super) seed: u64,
    /// Breakpoints that gdb calls software's (`Z0`) and hardware's (`Z1`): both are the core's own here.
    software: BTreeSet<u32>,
    hardware: BTreeSet<u32>,
    watchpoints: Vec<Watchpoint>,
}

impl<'a, C: Cost> Debuggee<'a, C> {
    /// The board called `side` of `run`, halted.
    pub(super) fn new(run: Debugged<C>, side: Side, observer: &'a mut dyn Observer, (gps, seed): (usize, u64)) -> Self {
        let (software, hardware, watchpoints) = (BTreeSet::new(), BTreeSet::new(), Vec::new());
        let mut debuggee = Self { run, side, observer, gps, seed, software, hardware, watchpoints };
        debuggee.node().halt();
        debuggee
    }

    /// The board that the debugger is at.
    pub(super) fn node(&mut self) -> &mut dyn Debuggable {
        match self.side {
            Side::Horus => self.run.horus(),
            Side::Dpr => self.run.dpr(),
        }
    }

    /// Runs on for a while. Answers why the board stands still, if it does, or that the run is over.
    pub(super) fn go(&mut self) -> Result<Option<SingleThreadStopReason<u32>>, Error> {
        self.run.run(self.observer)?;
        Ok(match self.node().halted() {
            Some(why) => Some(self.reason(why)),
            None => self.run.is_over().then_some(SingleThreadStopReason::Exited(0)),
        })
    }

    /// Halts the board where it is.
    pub(super) fn interrupt(&mut self) -> SingleThreadStopReason<u32> {
        self.node().halt();
        let why = self.node().halted().unwrap_or(Halt::Asked);
        self.reason(why)
    }

    /// Forgets the debugger: the board goes on without any breakpoint.
    pub(super) fn release(&mut self) {
        for address in std::mem::take(&mut self.software).into_iter().chain(std::mem::take(&mut self.hardware)) {
            self.node().clear_breakpoint(address);
        }
        for watchpoint in std::mem::take(&mut self.watchpoints) {
            self.node().clear_watchpoint(watchpoint);
        }
        self.node().resume(Resume::Continue);
    }

    fn reason(&mut self, why: Halt) -> SingleThreadStopReason<u32> {
        let pc = self.node().register(Register::R(15));
        match why {
            Halt::Asked => SingleThreadStopReason::Signal(Signal::SIGINT),
            Halt::Breakpoint if self.hardware.contains(&pc) => SingleThreadStopReason::HwBreak(()),
            Halt::Breakpoint => SingleThreadStopReason::SwBreak(()),
            Halt::Watchpoint(watched) => SingleThreadStopReason::Watch {
                tid: (),
                kind: match (watched.watchpoint.reads, watched.watchpoint.writes) {
                    (true, true) => WatchKind::ReadWrite,
                    (true, false) => WatchKind::Read,
                    (false, _) => WatchKind::Write,
                },
                // gdb wants an address that it watches, and a wider access may begin before that.
                addr: watched.address.max(watched.watchpoint.address),
            },
            Halt::Stepped => SingleThreadStopReason::DoneStep,
            Halt::Reset => SingleThreadStopReason::Signal(Signal::SIGTRAP),
        }
    }

    fn read_number(&mut self, number: Number) -> (u32, Option<u32>) {
        let node = self.node();
        let (low, high) = number.of_core();
        (node.register(low), high.map(|high| node.register(high)))
    }

    /// Writes a register where that changes it: a write of its own sets nothing off then.
    fn write_number(&mut self, number: Number, words: (u32, Option<u32>)) {
        let (low, high) = number.of_core();
        for (register, value) in [(Some(low), Some(words.0)), (high, words.1)] {
            if let (Some(register), Some(value)) = (register, value)
                && self.node().register(register) != value
            {
                self.node().set_register(register, value);
            }
        }
    }
}

impl<C: Cost> Target for Debuggee<'_, C> {
    type Arch = CortexM4;
    type Error = Error;

    fn base_ops(&mut self) -> BaseOps<'_, CortexM4, Error> {
        BaseOps::SingleThread(self)
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }

    fn support_monitor_cmd(&mut self) -> Option<MonitorCmdOps<'_, Self>> {
        Some(self)
    }
}

impl<C: Cost> SingleThreadBase for Debuggee<'_, C> {
    fn read_registers(&mut self, registers: &mut CoreRegisters) -> TargetResult<(), Self> {
        registers.words.clear();
        for number in Number::all() {
            let (low, high) = self.read_number(number);
            registers.words.push(low);
            registers.words.extend(high);
        }
        Ok(())
    }

    fn write_registers(&mut self, registers: &CoreRegisters) -> TargetResult<(), Self> {
        let mut words = registers.words.iter().copied();
        for number in Number::all() {
            let wide = number.of_core().1.is_some();
            let low = words.next().ok_or(TargetError::NonFatal)?;
            let high = if wide { Some(words.next().ok_or(TargetError::NonFatal)?) } else { None };
            self.write_number(number, (low, high));
        }
        Ok(())
    }

    fn support_single_register_access(&mut self) -> Option<SingleRegisterAccessOps<'_, (), Self>> {
        Some(self)
    }

    fn read_addrs(&mut self, address: u32, data: &mut [u8]) -> TargetResult<usize, Self> {
        match self.node().peek(address, data) {
            0 if !data.is_empty() => Err(TargetError::Errno(BAD_ADDRESS)),
            length => Ok(length),
        }
    }

    fn write_addrs(&mut self, address: u32, data: &[u8]) -> TargetResult<(), Self> {
        self.node().poke(address, data).map_err(|_| TargetError::Errno(BAD_ADDRESS))
    }

    fn support_resume(&mut self) -> Option<SingleThreadResumeOps<'_, Self>> {
        Some(self)
    }
}

impl<C: Cost> SingleRegisterAccess<()> for Debuggee<'_, C> {
    fn read_register(&mut self, (): (), number: Number, to: &mut [u8]) -> TargetResult<usize, Self> {
        let (low, high) = self.read_number(number);
        let mut length = 0;
        for (bytes, word) in to.as_chunks_mut::<4>().0.iter_mut().zip([Some(low), high].into_iter().flatten()) {
            *bytes = word.to_le_bytes();
            length += 4;
        }
        Ok(length)
    }

    fn write_register(&mut self, (): (), number: Number, value: &[u8]) -> TargetResult<(), Self> {
        let (words, rest) = value.as_chunks::<4>();
        let word = |index: usize| words.get(index).copied().map(u32::from_le_bytes);
        let wide = number.of_core().1.is_some();
        if !rest.is_empty() || words.len() != 1 + usize::from(wide) {
            return Err(TargetError::NonFatal);
        }
        self.write_number(number, (word(0).ok_or(TargetError::NonFatal)?, word(1)));
        Ok(())
    }
}

impl<C: Cost> SingleThreadResume for Debuggee<'_, C> {
    fn resume(&mut self, _: Option<Signal>) -> Result<(), Error> {
        self.node().resume(Resume::Continue);
        Ok(())
    }

    fn support_single_step(&mut self) -> Option<SingleThreadSingleStepOps<'_, Self>> {
        Some(self)
    }

    fn support_range_step(&mut self) -> Option<SingleThreadRangeSteppingOps<'_, Self>> {
        Some(self)
    }
}

impl<C: Cost> SingleThreadSingleStep for Debuggee<'_, C> {
    fn step(&mut self, _: Option<Signal>) -> Result<(), Error> {
        self.node().resume(Resume::Step);
        Ok(())
    }
}

impl<C: Cost> SingleThreadRangeStepping for Debuggee<'_, C> {
    fn resume_range_step(&mut self, start: u32, end: u32) -> Result<(), Error> {
        self.node().resume(Resume::StepWithin(start..end));
        Ok(())
    }
}

impl<C: Cost> Breakpoints for Debuggee<'_, C> {
    fn support_sw_breakpoint(&mut self) -> Option<SwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_breakpoint(&mut self) -> Option<HwBreakpointOps<'_, Self>> {
        Some(self)
    }

    fn support_hw_watchpoint(&mut self) -> Option<HwWatchpointOps<'_, Self>> {
        Some(self)
    }
}

impl<C: Cost> SwBreakpoint for Debuggee<'_, C> {
    fn add_sw_breakpoint(&mut self, address: u32, _: ArmBreakpointKind) -> TargetResult<bool, Self> {
        self.software.insert(address & !1);
        self.node().set_breakpoint(address);
        Ok(true)
    }

    fn remove_sw_breakpoint(&mut self, address: u32, _: ArmBreakpointKind) -> TargetResult<bool, Self> {
        let was = self.software.remove(&(address & !1));
        if !self.hardware.contains(&(address & !1)) {
            self.node().clear_breakpoint(address);
        }
        Ok(was)
    }
}

impl<C: Cost> HwBreakpoint for Debuggee<'_, C> {
    fn add_hw_breakpoint(&mut self, address: u32, _: ArmBreakpointKind) -> TargetResult<bool, Self> {
        self.hardware.insert(address & !1);
        self.node().set_breakpoint(address);
        Ok(true)
    }

    fn remove_hw_breakpoint(&mut self, address: u32, _: ArmBreakpointKind) -> TargetResult<bool, Self> {
        let was = self.hardware.remove(&(address & !1));
        if !self.software.contains(&(address & !1)) {
            self.node().clear_breakpoint(address);
        }
        Ok(was)
    }
}

/// gdb's watchpoint as the core has it.
fn watchpoint(address: u32, length: u32, kind: WatchKind) -> Watchpoint {
    let reads = matches!(kind, WatchKind::Read | WatchKind::ReadWrite);
    let writes = matches!(kind, WatchKind::Write | WatchKind::ReadWrite);
    Watchpoint { address, length, reads, writes }
}

impl<C: Cost> HwWatchpoint for Debuggee<'_, C> {
    fn add_hw_watchpoint(&mut self, address: u32, length: u32, kind: WatchKind) -> TargetResult<bool, Self> {
        let watchpoint = watchpoint(address, length, kind);
        if length == 0 {
            return Ok(false);
        }
        self.watchpoints.push(watchpoint);
        self.node().set_watchpoint(watchpoint);
        Ok(true)
    }

    fn remove_hw_watchpoint(&mut self, address: u32, length: u32, kind: WatchKind) -> TargetResult<bool, Self> {
        let watchpoint = watchpoint(address, length, kind);
        self.watchpoints.retain(|other| *other != watchpoint);
        Ok(self.node().clear_watchpoint(watchpoint))
    }
}

impl<C: Cost> MonitorCmd for Debuggee<'_, C> {
    fn handle_monitor_cmd(&mut self, command: &[u8], mut out: ConsoleOutput<'_>) -> Result<(), Error> {
        let text = self.monitor(&String::from_utf8_lossy(command))?;
        out.write_raw(text.as_bytes());
        Ok(())
    }
}
