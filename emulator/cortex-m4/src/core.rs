//! The state of a core and its public interface.

use std::marker::PhantomData;
use std::sync::Arc;

use crate::Cost;
use crate::code::Code;
use crate::coverage::Record;
use crate::flags::Flags;
use crate::system::System;
use crate::watch::Watch;
use crate::watchpoint::Watchpoints;

/// The properties of a core that its part determines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// The number of interrupt lines, up to 240.
    pub lines: u16,
    /// The number of implemented priority bits, 3 to 8.
    pub priority_bits: u8,
    /// The address of the vector table after a reset.
    pub vector_table: u32,
    /// The value of the register SYST_CALIB, with its NOREF and SKEW bits.
    pub systick_calibration: u32,
    /// The core cycles of one tick of SysTick's external reference clock, 0 where there is none (NOREF). The STM32F4
    /// has HCLK/8.
    pub systick_reference: u32,
    /// The number of MPU regions: 8, or 0 where there is no MPU.
    pub mpu_regions: u8,
}

/// The reason for which [`Core::run`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The core reached the cycle that the caller set as the end, or passed it by one instruction or exception entry.
    Until,
    /// The part called [`crate::Signals::stop`].
    Stopped,
    /// The next instruction is at one of the caller's breakpoints, see [`Core::set_breakpoint`]. The instruction was
    /// not executed.
    Breakpoint,
    /// The last instruction made an access that the caller watches, see [`Core::set_watchpoint`] and
    /// [`Core::take_watched`].
    Watchpoint,
    /// The next instruction is `BKPT 0xAB`, a semihosting call; see [`Core::finish_host_call`]. The instruction was not
    /// executed.
    HostCall,
    /// The core has just locked up (`locked_up`) and executes nothing until it is reset. [`Core::run`] returns this
    /// once for each lockup. Later calls let the time pass.
    Lockup,
    /// The firmware wrote AIRCR.SYSRESETREQ: the part has to reset the core, see [`Core::reset`].
    ResetRequest,
    /// The core has just entered HardFault, MemManage, BusFault or UsageFault, and the caller requested this exit, see
    /// [`Core::tell_faults`]. The first instruction of the handler was not executed.
    Fault,
    /// The core has just halted for debug (DHCSR.S_HALT) and executes nothing until the debugger resumes it.
    /// [`Core::run`] returns this once for each halt. Later calls let the time pass.
    Halted,
}

/// One Cortex-M4 core with FPU.
#[derive(Clone, Debug)]
pub struct Core<C: Cost> {
    /// The registers r0 to r15. r13 is the stack pointer in use. r15 is the address of the instruction that is being
    /// executed or, between instructions, of the next one.
    pub(crate) r: [u32; 16],
    /// The stack pointer that is not in use: PSP while r13 is MSP, and MSP while r13 is PSP.
    pub(crate) other_sp: u32,

    pub(crate) flags: Flags,
    pub(crate) flag_q: bool,
    /// The flags APSR.GE, in bits 0 to 3.
    pub(crate) ge: u8,
    /// The IT state as EPSR holds it, 0 outside an IT block (ARM ARM A7.3.2).
    pub(crate) it: u8,
    /// EPSR.ICI of an interrupted load/store multiple: the register with which it continues, 0 for none. It is in bits
    /// 15:12 of the xPSR.
    pub(crate) ici: u8,
    /// EPSR.T, the Thumb state.
    pub(crate) thumb: bool,
    /// IPSR, the number of the active exception, 0 in thread mode.
    pub(crate) ipsr: u16,
    pub(crate) primask: bool,
    pub(crate) faultmask: bool,
    pub(crate) basepri: u8,
    /// CONTROL: bit 0 is nPRIV, bit 1 SPSEL, bit 2 FPCA.
    pub(crate) control: u8,
    pub(crate) s: [u32; 32],
    pub(crate) fpscr: u32,
    /// The address that the local exclusive monitor holds, if it is set.
    pub(crate) exclusive: Option<u32>,
    /// The event register that `WFE` tests.
    pub(crate) event: bool,
    /// Whether the core sleeps: `Some(true)` in `WFE`, `Some(false)` in `WFI`.
    pub(crate) waiting: Option<bool>,
    pub(crate) locked_up: bool,
    pub(crate) halted: bool,
    pub(crate) hung: bool,
    /// The cycles since the core was made. Resets and sleep do not stop the count.
    pub(crate) cycle: u64,
    /// The cycles in which the core slept, was halted, was locked up, or hung. They also count in `cycle`.
    pub(crate) idle: u64,
    pub(crate) retired: u64,
    /// Whether the run loop must check for exceptions before the next instruction, because one became pending or a
    /// priority changed.
    pub(crate) attention: bool,
    /// The registers in 0xE000_0000 to 0xE00F_FFFF: interrupts, faults, timers, MPU, debug.
    pub(crate) system: System,
    /// The MPU rights with which an aligned read may go directly to memory ([`Core::load`]), 0 if no read may.
    pub(crate) short_read: u32,
    pub(crate) short_write: u32,
    pub(crate) code: Code,
    /// The limit of `cycle` below which the core executes instructions without a break. [`Core::end_burst`] makes the
    /// run loop check for other events.
    pub(crate) limit: u64,
    /// On the fast clock: the address up to which a burst executes without a check. At that address the limit of time
    /// or the end of the page is reached.
    pub(crate) stop: u32,
    /// On the fast clock: twice the cycle at which the present instruction began, minus its address. It is the same for
    /// all instructions between two branches.
    pub(crate) origin: u64,
    /// The value of [`Bus::rewritten`](crate::Bus::rewritten) when the decoded pages were last checked.
    pub(crate) rewritten: u64,
    /// The cycle at which the next event is due.
    pub(crate) due: u64,
    /// The remaining cycles of the last instruction, if an event in its middle cut it short.
    pub(crate) cut: u64,
    /// The remaining cycles of instructions that exceptions interrupted. They pass at the next exception return.
    pub(crate) owed: u64,
    /// The cycle at which lazy preservation last saved the floating-point state.
    pub(crate) preserved_fp: u64,
    /// The flags N, Z, C and V before the present instruction. In an IT block some instructions must leave these flags
    /// as they are.
    pub(crate) kept_flags: Flags,
    /// The address of the last word of code that was fetched. Wait states are counted from it. An odd value means that
    /// there is none.
    pub(crate) fetched: u32,
    /// The cycle before which the core executes nothing. The part sets it while the bus stalls the core.
    pub(crate) stalled_until: u64,
    /// The breakpoint or semihosting call that the core has reached. [`Core::run`] returns it.
    pub(crate) paused: Option<Exit>,
    /// The breakpoint at which [`Core::run`] last returned. The next run executes the instruction at this address.
    pub(crate) passed: Option<u32>,
    /// The address of a semihosting call that the caller does not answer, so that the core treats it as a plain `BKPT`.
    pub(crate) refused_call: Option<u32>,
    /// Whether the part has been told that the core fell asleep, but not yet that the core woke.
    pub(crate) told_sleep: bool,
    pub(crate) told_lockup: bool,
    pub(crate) told_halt: bool,
    pub(crate) tells_faults: bool,
    pub(crate) in_fault: bool,
    pub(crate) watch: Watch,
    pub(crate) watchpoints: Watchpoints,
    pub(crate) record: Option<Arc<Record>>,
    /// On the fast clock, the first instruction of the present burst that is not noted in `record` yet.
    pub(crate) unnoted: u32,
    pub(crate) cost: PhantomData<C>,
}

/// A register, as a debugger names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Register {
    /// One of r0 to r15; r13 is the stack pointer in use.
    R(u8),
    /// The program status register with its flags, IT state and exception number.
    Xpsr,
    /// The main stack pointer.
    Msp,
    /// The process stack pointer.
    Psp,
    /// The register CONTROL.
    Control,
    /// The register FAULTMASK.
    Faultmask,
    /// The register BASEPRI.
    Basepri,
    /// The register PRIMASK.
    Primask,
    /// One of s0 to s31.
    S(u8),
    /// The floating-point status and control register.
    Fpscr,
}

impl<C: Cost> Core<C> {
    /// Makes a core as it is when the supply has come on, at cycle 0. [`Core::reset`] must follow before it runs.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            r: [0; 16],
            other_sp: 0,
            flags: Flags::new(0),
            flag_q: false,
            ge: 0,
            it: 0,
            ici: 0,
            thumb: true,
            ipsr: 0,
            primask: false,
            faultmask: false,
            basepri: 0,
            control: 0,
            s: [0; 32],
            fpscr: 0,
            exclusive: None,
            event: false,
            waiting: None,
            locked_up: false,
            halted: false,
            hung: false,
            cycle: 0,
            idle: 0,
            retired: 0,
            attention: true,
            system: System::new(&config),
            short_read: 0,
            short_write: 0,
            code: Code::default(),
            limit: 0,
            stop: 0,
            origin: 0,
            rewritten: 0,
            due: u64::MAX,
            cut: 0,
            owed: 0,
            preserved_fp: 0,
            kept_flags: Flags::new(0),
            fetched: 1,
            stalled_until: 0,
            paused: None,
            passed: None,
            refused_call: None,
            told_sleep: false,
            told_lockup: false,
            told_halt: false,
            tells_faults: false,
            in_fault: false,
            watch: Watch::default(),
            watchpoints: Watchpoints::default(),
            record: None,
            unnoted: 0,
            cost: PhantomData,
        }
    }
    const fn on_process_stack(&self) -> bool {
        self.control & 2 != 0 && self.ipsr == 0
    }

    /// The value of a register. Between instructions r15 is the address of the next one.
    #[must_use]
    pub fn register(&self, register: Register) -> u32 {
        match register {
            Register::R(n) => self.r[usize::from(n & 15)],
            Register::Xpsr => self.xpsr(),
            Register::Msp => {
                if self.on_process_stack() {
                    self.other_sp
                } else {
                    self.r[13]
                }
            }
            Register::Psp => {
                if self.on_process_stack() {
                    self.r[13]
                } else {
                    self.other_sp
                }
            }
            Register::Control => u32::from(self.control),
            Register::Faultmask => u32::from(self.faultmask),
            Register::Basepri => u32::from(self.basepri),
            Register::Primask => u32::from(self.primask),
            Register::S(n) => self.s[usize::from(n & 31)],
            Register::Fpscr => self.fpscr,
        }
    }

    /// Changes a register, as a debugger does. A write of CONTROL leaves MSP and PSP their values.
    pub fn set_register(&mut self, register: Register, value: u32) {
        match register {
            Register::R(13) => self.r[13] = value & !3,
            Register::R(15) => {
                self.r[15] = value & !1;
                self.passed = None;
            }
            Register::R(n) => self.r[usize::from(n & 15)] = value,
            Register::Xpsr => {
                let before = self.ipsr;
                self.set_xpsr(value);
                self.exception_changed_from(before);
            }
            Register::Msp if self.on_process_stack() => self.other_sp = value & !3,
            Register::Psp if !self.on_process_stack() => self.other_sp = value & !3,
            Register::Msp | Register::Psp => self.r[13] = value & !3,
            Register::Control => {
                let before = self.on_process_stack();
                self.control = (value & 7) as u8;
                if before != self.on_process_stack() {
                    std::mem::swap(&mut self.r[13], &mut self.other_sp);
                }
            }
            Register::Faultmask => self.faultmask = value & 1 != 0,
            Register::Basepri => self.basepri = (value & 0xFF) as u8,
            Register::Primask => self.primask = value & 1 != 0,
            Register::S(n) => self.s[usize::from(n & 31)] = value,
            Register::Fpscr => self.fpscr = value & crate::fp::FPSCR_BITS,
        }
        self.attention = true;
    }

    /// The address of the next instruction.
    #[must_use]
    pub const fn pc(&self) -> u32 {
        self.r[15]
    }

    /// The number of core cycles since the core was made.
    #[must_use]
    pub const fn cycle(&self) -> u64 {
        self.cycle
    }

    /// The number of core cycles in which the core slept, was halted or locked up, or hung.
    #[must_use]
    pub const fn idle(&self) -> u64 {
        self.idle
    }

    /// The number of executed instructions, including those that an IT block skipped.
    #[must_use]
    pub const fn retired(&self) -> u64 {
        self.retired
    }

    /// Whether the core sleeps in WFI or WFE.
    #[must_use]
    pub const fn is_asleep(&self) -> bool {
        self.waiting.is_some()
    }

    /// Whether the core is halted for debug (DHCSR.S_HALT).
    #[must_use]
    pub const fn is_halted(&self) -> bool {
        self.halted
    }

    /// Whether the core is locked up. Only a reset, an NMI or a halting debugger ends a lockup.
    #[must_use]
    pub const fn locked_up(&self) -> bool {
        self.locked_up
    }

    /// Makes the core hang until it is reset: from the next instruction boundary on it executes nothing, takes no
    /// exception (not even NMI) and does not wake. Its timers count on, and interrupts become pending. A debugger may
    /// halt and reset the core. If it steps a core that hangs, the program counter does not move.
    pub fn hang(&mut self) {
        self.hung = true;
    }

    /// Whether the core hangs, see [`Core::hang`].
    #[must_use]
    pub const fn is_hung(&self) -> bool {
        self.hung
    }

    /// The next cycle at which SysTick or a DWT counter of the core does something, `u64::MAX` for never.
    #[must_use]
    pub fn due(&self) -> u64 {
        self.system_due()
    }

    /// Sets whether [`Core::run`] returns [`Exit::Fault`] at each entry into HardFault, MemManage, BusFault and
    /// UsageFault, wherever the vector table and the handler are.
    pub fn tell_faults(&mut self, on: bool) {
        self.tells_faults = on;
    }

    /// The address of the vector table now: VTOR.
    #[must_use]
    pub fn vector_table(&self) -> u32 {
        self.system.scb.vtor
    }

    /// Makes [`Core::run`] return before it executes the instruction at `address`.
    pub fn set_breakpoint(&mut self, address: u32) {
        self.code.set_breakpoint(address & !1);
    }

    /// Removes a breakpoint.
    pub fn clear_breakpoint(&mut self, address: u32) {
        self.code.clear_breakpoint(address & !1);
    }

    /// The operation and the parameter of a semihosting call, r0 and r1, after [`Exit::HostCall`].
    #[must_use]
    pub const fn host_call(&self) -> (u32, u32) {
        (self.r[0], self.r[1])
    }

    /// Finishes a semihosting call after [`Exit::HostCall`]. `Some` goes into r0, and the program counter moves behind
    /// the call. With `None` the instruction acts as a plain `BKPT`, as on a part without a debugger.
    pub fn finish_host_call(&mut self, answer: Option<u32>) {
        let pc = self.r[15];
        match answer {
            Some(answer) => {
                self.r[0] = answer;
                self.r[15] = pc.wrapping_add(2);
                self.cycle += 1;
                self.retired += 1;
            }
            None => self.refused_call = Some(pc),
        }
    }

    /// Counts the cycles up to `cycle` as idle. The core executes nothing in them, and the bus is not advanced.
    pub fn skip_to(&mut self, cycle: u64) {
        if cycle > self.cycle {
            self.idle += cycle - self.cycle;
            self.cycle = cycle;
        }
    }
}
