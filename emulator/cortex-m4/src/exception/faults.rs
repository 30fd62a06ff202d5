//! Faults, and exceptions that an instruction raises (ARM ARM B1.5.11, B1.5.14, B1.5.15).

use super::*;

impl<C: Cost> Core<C> {
    /// Makes pending the exception of a fault that came during stacking (`entry`) or unstacking. If an exception is
    /// already being entered, the core takes the one of higher priority first. ARM ARM B1.5.11.
    pub(super) fn derived_fault(&mut self, fault: Fault, entry: bool) {
        let (number, flag, kind) = match (fault, entry) {
            (Fault::MemData(_), true) => (MEM_MANAGE, CFSR_MSTKERR, debug_catch::INTERR),
            (Fault::MemData(_), false) => (MEM_MANAGE, CFSR_MUNSTKERR, debug_catch::INTERR),
            (Fault::NoCoprocessor, _) => (USAGE_FAULT, CFSR_NOCP, debug_catch::NOCPERR),
            (_, true) => (BUS_FAULT, CFSR_STKERR, debug_catch::INTERR),
            (_, false) => (BUS_FAULT, CFSR_UNSTKERR, debug_catch::INTERR),
        };
        self.system.scb.cfsr |= flag;
        self.pend_fault(number);
        self.catch(kind);
    }

    fn pend_escalated(&mut self, number: u16) {
        let nvic = &self.system.nvic;
        let taken =
            nvic::contains(&nvic.enabled, number) && i32::from(nvic.group_priority(number)) < self.execution_priority();
        if taken {
            self.system.nvic.pend(number);
        } else {
            self.system.scb.hfsr |= HFSR_FORCED;
            self.system.nvic.pend(HARD_FAULT);
        }
    }

    /// Makes the exception of a synchronous fault pending (ARM ARM B1.5.11, B1.5.15). If that exception is disabled or
    /// does not preempt, HardFault becomes pending instead. If HardFault does not preempt either, the core locks up.
    /// Returns whether an exception is to be taken.
    pub(super) fn pend_fault(&mut self, number: u16) -> bool {
        if self.execution_priority() <= -1 {
            if number != HARD_FAULT {
                self.system.scb.hfsr |= HFSR_FORCED;
            }
            self.lock_up();
            return false;
        }
        self.pend_escalated(number);
        true
    }

    /// Locks the core up as in the handler of HardFault or NMI, because that handler could not be entered.
    pub(super) fn lock_up_at(&mut self, number: u16) {
        self.set_stack(false);
        self.ipsr = number;
        self.exception_changed();
        self.system.nvic.activate(number);
        self.lock_up();
    }

    /// Locks the core up now, as a fault inside a fault handler does (ARM ARM B1.5.15).
    pub fn lock_up(&mut self) {
        self.locked_up = true;
        self.attention = true;
    }

    /// Halts the core at the first instruction of the handler, by a vector catch.
    pub(super) fn catch(&mut self, kinds: u32) {
        let forced = self.system.nvic.best == HARD_FAULT;
        if self.system.debug.catches(kinds | if forced { debug_catch::HARDERR } else { 0 }) {
            self.system.debug.halt_wanted |= DFSR_VCATCH;
            self.attention = true;
        }
    }

    /// Whether the core ignores the exception of a data bus fault at `address`: CCR.BFHFNMIGN is set, and the core is
    /// in HardFault or NMI or has FAULTMASK set (ARM ARM B3.2.8). The fault's status is set in any case (B3.2.15,
    /// B3.2.18), so that firmware can probe an address.
    pub(crate) fn ignores_bus_fault(&mut self, address: u32) -> bool {
        let ignores = self.system.scb.ccr & CCR_BFHFNMIGN != 0 && self.execution_priority() < 0;
        if ignores {
            self.note_fault_address(address, CFSR_MMARVALID);
            self.system.scb.cfsr |= CFSR_PRECISERR | CFSR_BFARVALID;
        }
        ignores
    }

    /// Handles a fault of the instruction at r15: sets the status and enters the handler, or locks the core up. The IT
    /// state must still be the one before that instruction.
    pub(crate) fn take_fault<B: Bus>(&mut self, bus: &mut B, fault: Fault) {
        if let Fault::BusData(address) = fault
            && self.ignores_bus_fault(address)
        {
            self.skip_instruction(bus);
            return;
        }
        let (number, flag, kind) = match fault {
            Fault::Undefined => (USAGE_FAULT, CFSR_UNDEFINSTR, debug_catch::STATERR),
            Fault::InvalidState => (USAGE_FAULT, CFSR_INVSTATE, debug_catch::STATERR),
            Fault::InvalidPc => (USAGE_FAULT, CFSR_INVPC, debug_catch::STATERR),
            Fault::NoCoprocessor => (USAGE_FAULT, CFSR_NOCP, debug_catch::NOCPERR),
            Fault::Unaligned => (USAGE_FAULT, CFSR_UNALIGNED, debug_catch::CHKERR),
            Fault::DivideByZero => (USAGE_FAULT, CFSR_DIVBYZERO, debug_catch::CHKERR),
            Fault::BusData(address) => {
                self.note_fault_address(address, CFSR_MMARVALID);
                (BUS_FAULT, CFSR_PRECISERR | CFSR_BFARVALID, debug_catch::BUSERR)
            }
            Fault::BusInstruction => (BUS_FAULT, CFSR_IBUSERR, debug_catch::BUSERR),
            Fault::BusStacking => (BUS_FAULT, CFSR_STKERR, debug_catch::INTERR),
            Fault::BusUnstacking => (BUS_FAULT, CFSR_UNSTKERR, debug_catch::INTERR),
            Fault::MemData(address) => {
                self.note_fault_address(address, CFSR_BFARVALID);
                (MEM_MANAGE, CFSR_DACCVIOL | CFSR_MMARVALID, debug_catch::MMERR)
            }
            Fault::MemInstruction => (MEM_MANAGE, CFSR_IACCVIOL, debug_catch::MMERR),
            Fault::MemStacking => (MEM_MANAGE, CFSR_MSTKERR, debug_catch::INTERR),
            Fault::MemUnstacking => (MEM_MANAGE, CFSR_MUNSTKERR, debug_catch::INTERR),
            Fault::VectorRead => {
                self.system.scb.hfsr |= HFSR_VECTTBL;
                (HARD_FAULT, 0, debug_catch::INTERR)
            }
            Fault::BusLazy | Fault::MemLazy => {
                // `fp_ready` has already made the exception of this fault pending. Either that exception preempts, or
                // the core is locked up.
                if !self.locked_up && self.preempts() {
                    let to = self.r[15];
                    self.enter(bus, to);
                }
                return;
            }
            Fault::Breakpoint => {
                self.breakpoint(bus);
                return;
            }
        };
        self.system.scb.cfsr |= flag;
        if self.pend_fault(number) {
            self.catch(kind);
            let to = self.r[15];
            self.enter(bus, to);
        }
    }

    /// Stores the address of a fault. MMFAR and BFAR are one register in this core, so an address in one of them makes
    /// the other invalid (TRM table 4-1).
    fn note_fault_address(&mut self, address: u32, other: u32) {
        self.system.scb.fault_address = address;
        self.system.scb.cfsr &= !other;
    }

    /// Continues behind a load or store whose bus fault is ignored. The ARM ARM leaves the loaded value UNKNOWN; here
    /// the registers keep their values.
    #[cold]
    fn skip_instruction<B: Bus>(&mut self, bus: &mut B) {
        let wide = bus.fetch(self.r[15]).is_ok_and(|first| first >> 11 >= 0x1D);
        self.r[15] = self.r[15].wrapping_add(if wide { 4 } else { 2 });
        // ITAdvance, ARM ARM A7.3.2.
        self.it = if self.it & 7 == 0 { 0 } else { self.it & 0xE0 | self.it << 1 & 0x1F };
    }

    /// Executes an SVC; r15 is the next instruction. If SVCall does not preempt, HardFault is taken instead, with the
    /// same return address, as in QEMU and as Zephyr's fault handler expects. A core that locks up stays at the SVC.
    pub(crate) fn supervisor_call<B: Bus>(&mut self, bus: &mut B) {
        let next = self.r[15];
        if self.pend_fault(SV_CALL) {
            self.enter(bus, next);
        } else {
            self.r[15] = next.wrapping_sub(2);
        }
    }

    /// Executes the instruction at r15, which is a BKPT or is at a breakpoint of the FPB: halts the core, or takes
    /// DebugMonitor or HardFault. ARM ARM C1.5.1.
    pub(crate) fn breakpoint<B: Bus>(&mut self, bus: &mut B) {
        if self.system.debug.halting() {
            self.halt(DFSR_BKPT);
            return;
        }
        let number = if self.monitor_can_be_taken() {
            self.system.scb.dfsr |= DFSR_BKPT;
            DEBUG_MONITOR
        } else {
            self.system.scb.hfsr |= HFSR_DEBUGEVT;
            self.system.scb.dfsr |= DFSR_BKPT;
            HARD_FAULT
        };
        if self.pend_fault(number) {
            let to = self.r[15];
            self.enter(bus, to);
        }
    }
}
