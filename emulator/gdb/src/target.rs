//! One board of a run as gdb's target.

use std::collections::BTreeSet;

use cortex_m4::{Register, Watchpoint};
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

use super::World;
use super::arch::{CoreRegisters, CortexM4, Number};
use emulator_node::{AnyNode, Halt, Resume};

/// The error number EFAULT of gdb's remote protocol ("Debugging with GDB", appendix E.13.9, Errno Values).
const BAD_ADDRESS: u8 = 14;

pub(super) struct Debuggee<W> {
    pub(super) world: W,
    /// The addresses of gdb's software (`Z0`) and hardware (`Z1`) breakpoints; the emulated core implements both.
    software: BTreeSet<u32>,
    hardware: BTreeSet<u32>,
    watchpoints: Vec<Watchpoint>,
}

impl<W: World> Debuggee<W> {
    /// Halts the board of `world` that the debugger is connected to, and returns it as gdb's target.
    pub(super) fn new(mut world: W) -> Self {
        world.node().halt();
        Self { world, software: BTreeSet::new(), hardware: BTreeSet::new(), watchpoints: Vec::new() }
    }

    pub(super) fn node(&mut self) -> &mut dyn AnyNode {
        self.world.node()
    }

    /// Runs the board for at most 10 ms of virtual time. Returns the reason if the board has halted or the run is over.
    pub(super) fn go(&mut self) -> Result<Option<SingleThreadStopReason<u32>>, W::Error> {
        self.world.go()?;
        Ok(match self.node().halted() {
            Some(why) => Some(self.reason(why)),
            None if self.world.is_over() => Some(SingleThreadStopReason::Exited(self.world.status())),
            None => None,
        })
    }

    pub(super) fn interrupt(&mut self) -> SingleThreadStopReason<u32> {
        self.node().halt();
        let why = self.node().halted().unwrap_or(Halt::Asked);
        self.reason(why)
    }

    pub(super) fn release(&mut self) {
        self.node().halt_at_end(false);
        for address in std::mem::take(&mut self.software).into_iter().chain(std::mem::take(&mut self.hardware)) {
            self.node().clear_breakpoint(address);
        }
        for watchpoint in std::mem::take(&mut self.watchpoints) {
            self.node().clear_watchpoint(watchpoint);
        }
        self.node().resume(Resume::Continue);
    }

    fn reason(&mut self, why: Halt) -> SingleThreadStopReason<u32> {
        let pc = self.node().core_register(Register::R(15));
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
                // gdb expects the address of the watchpoint. A wide access to that address may begin at a lower one.
                addr: watched.address.max(watched.watchpoint.address),
            },
            Halt::Stepped => SingleThreadStopReason::DoneStep,
            Halt::Reset => SingleThreadStopReason::Signal(Signal::SIGTRAP),
            Halt::Ended => SingleThreadStopReason::Signal(Signal::SIGSEGV),
        }
    }

    fn read_number(&mut self, number: Number) -> (u32, Option<u32>) {
        let node = self.node();
        let (low, high) = number.of_core();
        (node.core_register(low), high.map(|high| node.core_register(high)))
    }

    /// Writes a register only if its value changes, because a write of the same value may have effects too.
    fn write_number(&mut self, number: Number, words: (u32, Option<u32>)) {
        let (low, high) = number.of_core();
        for (register, value) in [(Some(low), Some(words.0)), (high, words.1)] {
            if let (Some(register), Some(value)) = (register, value)
                && self.node().core_register(register) != value
            {
                self.node().set_core_register(register, value);
            }
        }
    }
}

impl<W: World> Target for Debuggee<W> {
    type Arch = CortexM4;
    type Error = W::Error;

    fn base_ops(&mut self) -> BaseOps<'_, CortexM4, W::Error> {
        BaseOps::SingleThread(self)
    }

    fn support_breakpoints(&mut self) -> Option<BreakpointsOps<'_, Self>> {
        Some(self)
    }

    fn support_monitor_cmd(&mut self) -> Option<MonitorCmdOps<'_, Self>> {
        Some(self)
    }
}

impl<W: World> SingleThreadBase for Debuggee<W> {
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

impl<W: World> SingleRegisterAccess<()> for Debuggee<W> {
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

impl<W: World> SingleThreadResume for Debuggee<W> {
    fn resume(&mut self, _: Option<Signal>) -> Result<(), W::Error> {
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

impl<W: World> SingleThreadSingleStep for Debuggee<W> {
    fn step(&mut self, _: Option<Signal>) -> Result<(), W::Error> {
        self.node().resume(Resume::Step);
        Ok(())
    }
}

impl<W: World> SingleThreadRangeStepping for Debuggee<W> {
    fn resume_range_step(&mut self, start: u32, end: u32) -> Result<(), W::Error> {
        self.node().resume(Resume::StepWithin(start..end));
        Ok(())
    }
}

impl<W: World> Breakpoints for Debuggee<W> {
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

impl<W: World> SwBreakpoint for Debuggee<W> {
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

impl<W: World> HwBreakpoint for Debuggee<W> {
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

fn watchpoint(address: u32, length: u32, kind: WatchKind) -> Watchpoint {
    let reads = matches!(kind, WatchKind::Read | WatchKind::ReadWrite);
    let writes = matches!(kind, WatchKind::Write | WatchKind::ReadWrite);
    Watchpoint { address, length, reads, writes }
}

impl<W: World> HwWatchpoint for Debuggee<W> {
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

impl<W: World> MonitorCmd for Debuggee<W> {
    fn handle_monitor_cmd(&mut self, command: &[u8], mut out: ConsoleOutput<'_>) -> Result<(), W::Error> {
        let text = self.monitor(&String::from_utf8_lossy(command))?;
        out.write_raw(text.as_bytes());
        Ok(())
    }
}
