//! The state of a core.

use std::marker::PhantomData;

use crate::Cost;
use crate::code::Code;
use crate::system::System;
use crate::watch::Watch;
use crate::watchpoint::Watchpoints;

/// How the part configures its core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Interrupt lines, up to 240.
    pub lines: u16,
    /// Implemented priority bits, 3 to 8.
    pub priority_bits: u8,
    /// Where the vector table is after a reset.
    pub vector_table: u32,
    /// SYST_CALIB, with its NOREF and SKEW bits.
    pub systick_calibration: u32,
    /// Core cycles of one tick of SysTick's external reference, 0 where there is none (NOREF). The STM32F4 has HCLK/8.
    pub systick_reference: u32,
    /// Regions of the MPU: 8, or 0 where there is none.
    pub mpu_regions: u8,
}

/// Why [`Core::run`] came back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The cycle asked for is reached (exceeded by less than an instruction, or an exception entry).
    Until,
    /// [`crate::Signals::stop`].
    Stopped,
    /// The next instruction is at a breakpoint of the caller's, see [`Core::set_breakpoint`]. It was not executed.
    Breakpoint,
    /// The instruction before this boundary accessed what the caller watches, see [`Core::set_watchpoint`] and
    /// [`Core::take_watched`].
    Watchpoint,
    /// The next instruction is `BKPT 0xAB`, a semihosting call; see [`Core::finish_host_call`]. It was not executed.
    HostCall,
    /// The core locked up just now (`locked_up`): it executes nothing until it is reset. Told once, as time goes on.
    Lockup,
    /// AIRCR.SYSRESETREQ was written: the part resets, see [`Core::reset`].
    ResetRequest,
    /// HardFault, MemManage, BusFault or UsageFault was entered just now, and the caller wants to know, see
    /// [`Core::tell_faults`]. The first instruction of its handler was not executed.
    Fault,
    /// The core halted for debug just now (DHCSR.S_HALT): it executes nothing until the debugger lets it go on. Told
    /// once, as time goes on.
    Halted,
}

/// One Cortex-M4 with FPU.
#[derive(Clone, Debug)]
pub struct Core<C: Cost> {
    /// r0 to r12; r13 is the stack pointer in use; r14; r15 is the address of the instruction being executed, or,
    /// between instructions, of the next one.
    pub(crate) r: [u32; 16],
    /// The stack pointer that is not in use: PSP while r13 is MSP, and the other way round.
    pub(crate) other_sp: u32,

    pub(crate) flag_n: bool,
    pub(crate) flag_z: bool,
    pub(crate) flag_c: bool,
    pub(crate) flag_v: bool,
    pub(crate) flag_q: bool,
    /// APSR.GE, bits 0 to 3.
    pub(crate) ge: u8,
    /// IT state as the EPSR holds it: 0 outside an IT block (ARM ARM A7.3.2).
    pub(crate) it: u8,
    /// EPSR.ICI of an interrupted load/store multiple: the register to go on with, 0 for none. Bits 15:12 of the xPSR.
    pub(crate) ici: u8,
    /// EPSR.T.
    pub(crate) thumb: bool,
    /// IPSR: 0 in thread mode.
    pub(crate) ipsr: u16,
    pub(crate) primask: bool,
    pub(crate) faultmask: bool,
    pub(crate) basepri: u8,
    /// CONTROL: bit 0 nPRIV, bit 1 SPSEL, bit 2 FPCA.
    pub(crate) control: u8,
    /// s0 to s31.
    pub(crate) s: [u32; 32],
    pub(crate) fpscr: u32,
    /// The local exclusive monitor holds an address.
    pub(crate) exclusive: Option<u32>,
    /// The event register of `WFE`.
    pub(crate) event: bool,
    /// In `WFI` or `WFE` (`true` for `WFE`).
    pub(crate) waiting: Option<bool>,
    pub(crate) locked_up: bool,
    pub(crate) halted: bool,
    /// See [`Core::hang`].
    pub(crate) hung: bool,
    /// Cycles since the core was made; goes on through resets and sleep.
    pub(crate) cycle: u64,
    /// Of those, cycles in which it slept, was halted or locked up, or hung.
    pub(crate) idle: u64,
    /// Instructions executed.
    pub(crate) retired: u64,
    /// Something may have become pending, or a priority changed: the run loop looks at exceptions before the next
    /// instruction.
    pub(crate) attention: bool,
    /// Interrupts, faults, timers, MPU, debug: 0xE000_0000 to 0xE00F_FFFF.
    pub(crate) system: System,
    /// What an aligned access of the code to memory needs of the MPU to go the short way ([`Core::load`]): to read,
    /// and to write. 0 while no access goes it.
    pub(crate) short_read: u32,
    pub(crate) short_write: u32,
    /// Instructions that were decoded.
    pub(crate) code: Code,
    /// Instructions are executed one after the other while `cycle` is below; 0 asks the run loop to look around.
    pub(crate) limit: u64,
    /// Something is due at this cycle.
    pub(crate) due: u64,
    /// Cycles that the instruction before this boundary has left, which was cut short by what is due.
    pub(crate) cut: u64,
    /// The same of instructions that an exception has interrupted: they pass with the next return.
    pub(crate) owed: u64,
    /// When lazy preservation last saved the floating-point state.
    pub(crate) preserved_fp: u64,
    /// N, Z, C and V before the instruction in an IT block that may have to leave them.
    pub(crate) kept_flags: (bool, bool, bool, bool),
    /// The last word of code that was fetched, for the wait states; odd for none.
    pub(crate) fetched: u32,
    /// The core executes nothing before this cycle.
    pub(crate) stalled_until: u64,
    /// Something that was met instead of an instruction: [`Core::run`] returns it.
    pub(crate) paused: Option<Exit>,
    /// [`Core::run`] came back from a breakpoint at this address: it is stepped over next.
    pub(crate) passed: Option<u32>,
    /// The semihosting call at this address is not answered: it is a plain `BKPT`.
    pub(crate) refused_call: Option<u32>,
    /// [`Bus::sleeps`](crate::Bus::sleeps) was told of a sleep, and not yet of its end.
    pub(crate) told_sleep: bool,
    /// [`Exit::Lockup`] was told.
    pub(crate) told_lockup: bool,
    /// [`Exit::Halted`] was told.
    pub(crate) told_halt: bool,
    /// The caller wants to know of each entry into a fault's handler; there was one of which it was not told.
    pub(crate) tells_faults: bool,
    pub(crate) in_fault: bool,
    /// Changes of the active exception.
    pub(crate) watch: Watch,
    /// What the caller watches of the data accesses.
    pub(crate) watchpoints: Watchpoints,
    pub(crate) cost: PhantomData<C>,
}

/// A register as a debugger names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Register {
    /// r0 to r15; 13 is the stack pointer in use.
    R(u8),
    /// The program status register with its flags, IT state and exception number.
    Xpsr,
    /// The main stack pointer.
    Msp,
    /// The process stack pointer.
    Psp,
    /// CONTROL.
    Control,
    /// FAULTMASK.
    Faultmask,
    /// BASEPRI.
    Basepri,
    /// PRIMASK.
    Primask,
    /// s0 to s31.
    S(u8),
    /// The floating-point status and control register.
    Fpscr,
}

impl<C: Cost> Core<C> {
    /// A core as the supply has come on, before its first [`Core::reset`], at cycle 0.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            r: [0; 16],
            other_sp: 0,
            flag_n: false,
            flag_z: false,
            flag_c: false,
            flag_v: false,
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
            due: u64::MAX,
            cut: 0,
            owed: 0,
            preserved_fp: 0,
            kept_flags: (false, false, false, false),
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
            cost: PhantomData,
        }
    }
    /// Whether r13 is PSP.
    const fn on_process_stack(&self) -> bool {
        self.control & 2 != 0 && self.ipsr == 0
    }

    /// The value of a register. Between instructions r15 is the address of the next.
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

    /// Changes a register, as a debugger does. CONTROL keeps the stack pointers where they are.
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

    /// Cycles since the core was made.
    #[must_use]
    pub const fn cycle(&self) -> u64 {
        self.cycle
    }

    /// Cycles in which the core slept, was halted or locked up, or hung.
    #[must_use]
    pub const fn idle(&self) -> u64 {
        self.idle
    }

    /// Instructions executed, those included that an IT block skipped.
    #[must_use]
    pub const fn retired(&self) -> u64 {
        self.retired
    }

    /// In WFI or WFE.
    #[must_use]
    pub const fn is_asleep(&self) -> bool {
        self.waiting.is_some()
    }

    /// Halted for debug (DHCSR.S_HALT).
    #[must_use]
    pub const fn is_halted(&self) -> bool {
        self.halted
    }

    /// Locked up: only a reset, an NMI or a halting debugger gets it on.
    #[must_use]
    pub const fn locked_up(&self) -> bool {
        self.locked_up
    }

    /// The core executes nothing from the next instruction boundary on until it is reset, and takes no exception: as
    /// one that is stuck in its highest exception with all others masked, NMI among them. One that sleeps does not
    /// wake. All beside the execution goes on: its timers count, interrupts become pending, a debugger may halt it and
    /// reset it, and a step that a debugger asks for ends where it began.
    pub fn hang(&mut self) {
        self.hung = true;
    }

    /// Whether it hangs, see [`Core::hang`].
    #[must_use]
    pub const fn is_hung(&self) -> bool {
        self.hung
    }

    /// The next cycle at which something happens in the core itself, `u64::MAX` for never: SysTick, a DWT counter.
    #[must_use]
    pub fn due(&self) -> u64 {
        self.system_due()
    }

    /// From now on [`Core::run`] comes back with [`Exit::Fault`] at each entry into HardFault, MemManage, BusFault and
    /// UsageFault, wherever the vector table and the handler are; or no longer.
    pub fn tell_faults(&mut self, on: bool) {
        self.tells_faults = on;
    }

    /// Where the vector table is now: VTOR.
    #[must_use]
    pub fn vector_table(&self) -> u32 {
        self.system.scb.vtor
    }

    /// Stops [`Core::run`] before the instruction at `address`.
    pub fn set_breakpoint(&mut self, address: u32) {
        self.code.set_breakpoint(address & !1);
    }

    /// Takes a breakpoint back.
    pub fn clear_breakpoint(&mut self, address: u32) {
        self.code.clear_breakpoint(address & !1);
    }

    /// After [`Exit::HostCall`]: the operation and its parameter, r0 and r1.
    #[must_use]
    pub const fn host_call(&self) -> (u32, u32) {
        (self.r[0], self.r[1])
    }

    /// After [`Exit::HostCall`]: puts the answer into r0 and goes on behind the call. With `None` nobody answers: the
    /// instruction is a plain `BKPT`, as on a part without a debugger.
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

    /// Idle time passes until `cycle`, without the bus: for a core that executes nothing.
    pub fn skip_to(&mut self, cycle: u64) {
        if cycle > self.cycle {
            self.idle += cycle - self.cycle;
            self.cycle = cycle;
        }
    }
}
