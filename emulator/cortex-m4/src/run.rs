//! The run loop.
//!
//! | what | when the loop checks it |
//! |---|---|
//! | the caller's `until`, [`Bus::due`], SysTick | each instruction compares the cycle with the nearest of them |
//! | [`crate::Signals`] | after an access that announced a change, and after each [`Bus::advance`] |
//! | exceptions | after each event above, and after an instruction that may have changed a priority |
//! | the MPU's rights to execute | once for each page, or at each instruction of a page that is not open as a whole |
//!
//! An instruction executes as a whole. Its accesses take place at the cycle at which it began. If the clock counts wait
//! states, the cycles of its earlier accesses are added.

use crate::code::{BITS as PAGE_BITS, Code, Kind, Page};
use crate::op::{Block, Do, Op};
use crate::{Access, Bound, Bus, Core, Cost, Exit, Fault, Purpose, Width, decode};

/// The ways in which a burst goes on: through a constant page, through a watched page until it is written, or for one
/// instruction.
const ON: u8 = 0;
const WHILE_UNWRITTEN: u8 = 1;
const ONCE: u8 = 2;

/// How far the run loop continues.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pace {
    /// The run goes on until there is a reason to return to the caller.
    Free,
    /// The run executes one instruction, after any exception that is due.
    One,
    /// The run executes one instruction or one exception entry.
    OneOrEntry,
}

impl<C: Cost> Core<C> {
    /// Executes until the cycle `until`, or until another reason to return, see [`Exit`]. While the core sleeps, is
    /// halted, is locked up or hangs, time passes and the bus is advanced. A run after [`Exit::Breakpoint`] begins with
    /// the instruction at the breakpoint.
    pub fn run<B: Bus>(&mut self, bus: &mut B, until: u64) -> Exit {
        let mut code = std::mem::take(&mut self.code);
        let exit = self.run_with(bus, &mut code, until, Pace::Free);
        self.code = code;
        exit
    }

    /// Runs as [`Core::run`] does, but for at most one instruction or one exception entry, after which it returns
    /// [`Exit::Until`]. [`Core::retired`] and [`Core::exception_changes`] tell which of the two happened. A run in such
    /// steps has the same effect as one [`Core::run`].
    pub fn run_one<B: Bus>(&mut self, bus: &mut B, until: u64) -> Exit {
        let mut code = std::mem::take(&mut self.code);
        let exit = self.run_with(bus, &mut code, until, Pace::OneOrEntry);
        self.code = code;
        exit
    }

    /// Executes one instruction, even at a breakpoint, after any exception that is due. Returns [`Exit::Until`] unless
    /// there is another reason to return. If the core sleeps, is halted, is locked up or hangs, time passes until the
    /// next event.
    pub fn step<B: Bus>(&mut self, bus: &mut B) -> Exit {
        let mut code = std::mem::take(&mut self.code);
        self.passed = Some(self.r[15]);
        let exit = self.run_with(bus, &mut code, u64::MAX, Pace::One);
        self.code = code;
        exit
    }

    fn run_with<B: Bus>(&mut self, bus: &mut B, code: &mut Code, until: u64, pace: Pace) -> Exit {
        let single = pace != Pace::Free;
        let mut stepped = false;
        loop {
            let mut due = bus.due().min(self.system_due());
            if self.cycle >= due {
                bus.advance(self.cycle);
                self.system_advance();
                due = bus.due().min(self.system_due());
            }
            if let Some(change) = bus.signals().take_change() {
                self.attention = true;
                self.stalled_until = change.stalled_until;
                if change.forget_code {
                    code.forget();
                }
                if change.stop {
                    return Exit::Stopped;
                }
                continue;
            }
            let stalled = self.stalled_until > self.cycle;
            if self.take_reset_request() {
                return Exit::ResetRequest;
            }
            if self.attention && !stalled {
                if self.look_at_exceptions(bus) {
                    if pace == Pace::OneOrEntry {
                        return Exit::Until;
                    }
                    continue;
                }
                due = bus.due().min(self.system_due());
            }
            if self.cut > 0 {
                // No exception came where the instruction was cut short, so the rest of its cycles pass now.
                self.cycle += std::mem::take(&mut self.cut);
                continue;
            }
            let asleep = self.waiting.is_some();
            if asleep != self.told_sleep {
                self.told_sleep = asleep;
                let deep = self.sleep_deep();
                bus.sleeps(self.cycle, asleep, deep);
                continue;
            }
            self.told_lockup &= self.locked_up;
            self.told_halt &= self.halted;
            if self.locked_up && !self.told_lockup {
                self.told_lockup = true;
                return Exit::Lockup;
            }
            if self.halted && !self.told_halt {
                self.told_halt = true;
                return Exit::Halted;
            }
            if std::mem::take(&mut self.in_fault) {
                return Exit::Fault;
            }
            if self.cycle >= until || stepped {
                return Exit::Until;
            }
            stepped = single;
            self.limit = until.min(due);
            if self.attention && !stalled {
                // The burst ends after the next instruction, so that the core checks exceptions.
                self.limit = self.limit.min(self.cycle + 1);
            }
            self.due = due;
            if stalled {
                self.cycle = self.limit.min(self.stalled_until);
                continue;
            }
            if self.waiting.is_some() || self.locked_up || self.halted || self.hung {
                if self.limit == u64::MAX {
                    // No event will ever be due, and the caller set no end.
                    return Exit::Until;
                }
                let cycle = self.limit;
                self.skip_to(cycle);
                continue;
            }
            if !self.thumb {
                self.take_fault(bus, Fault::InvalidState);
                self.attention = true;
                continue;
            }
            if self.take_breakpoints_changed() {
                code.set_hardware(self.fpb_breakpoints().collect());
            }
            let recorded = self.watch.recorded();
            self.execute_until_limit(bus, code, single);
            self.watch.complete(recorded, self.cycle);
            if let Some(exit) = self.paused.take() {
                if exit == Exit::Watchpoint {
                    return exit;
                }
                self.retired -= 1;
                let pc = self.r[15];
                if exit != Exit::Breakpoint {
                    return exit;
                }
                self.passed = Some(pc);
                if code.is_callers(pc) {
                    return exit;
                }
                if self.hardware_breakpoint(bus) {
                    self.passed = None;
                    self.attention = true;
                }
            } else if pace == Pace::OneOrEntry {
                // The caller's next call handles the effects of this instruction.
                return Exit::Until;
            }
        }
    }

    #[inline(always)]
    fn execute_until_limit<B: Bus>(&mut self, bus: &mut B, code: &mut Code, single: bool) {
        let careful = single || self.passed.is_some() || self.refused_call.is_some();
        let careful = careful || self.ici != 0;
        loop {
            let pc = self.r[15];
            self.note_short_way();
            if code.rewritten() != bus.rewritten() {
                code.forget_rewritten(bus);
            }
            let place = code.page(bus, pc);
            let page = code.at(place);
            let kind = page.kind();
            let plain = !careful && !never_executable(pc) && self.mpu_opens_page(pc, PAGE_BITS);
            if plain && kind == Kind::Constant {
                self.burst::<B, ON>(bus, page, page.op(pc));
            } else if plain && kind == Kind::Watched {
                self.burst::<B, WHILE_UNWRITTEN>(bus, page, page.op(pc));
            } else {
                let op = *page.op(pc);
                let op = self.careful_op(bus, code, pc, op, kind != Kind::Compared);
                self.burst::<B, ONCE>(bus, code.at(place), &op);
                if careful {
                    return;
                }
            }
            if self.cycle >= self.limit {
                return;
            }
        }
    }

    /// Returns the instruction at `pc` if the page's decoded instruction `op` cannot be used unchecked. `known` says
    /// that `op` matches memory.
    #[inline(never)]
    fn careful_op<B: Bus>(&mut self, bus: &mut B, code: &mut Code, pc: u32, op: Op, known: bool) -> Op {
        if never_executable(pc) || !self.mpu_fetch(pc) || !self.mpu_fetch(pc.wrapping_add(2)) && op.size == 4 {
            return decode::fault(Fault::MemInstruction);
        }
        let refused = self.refused_call.take() == Some(pc);
        let over = self.passed.take() == Some(pc);
        let op = if over || !known { code.changing(bus, pc, over) } else { op };
        // EPSR.ICI belongs to an interrupted load/store multiple (ARM ARM B1.4.2).
        if self.ici != 0 && !matches!(op.what, Do::Ldm { .. } | Do::Stm { .. }) {
            self.ici = 0;
            return decode::fault(Fault::InvalidState);
        }
        if refused && matches!(op.what, Do::HostCall) { Op { what: Do::Bkpt, ..op } } else { op }
    }

    /// Executes `first`. Unless `GOES` is [`ONCE`], also executes the following instructions on `page` while the cycle
    /// is below the limit. With [`WHILE_UNWRITTEN`] it stops when a watched page is written.
    #[inline(never)]
    fn burst<B: Bus, const GOES: u8>(&mut self, bus: &mut B, page: &Page, first: &Op) {
        let mut op = first;
        let mut pc = self.r[15];
        let rewritten = bus.rewritten();
        loop {
            if GOES != ONCE && self.it != 0 {
                // IT blocks are handled one instruction at a time, so that the fast burst need not test for them.
                self.burst::<B, ONCE>(bus, page, op);
                pc = self.r[15];
            } else {
                let it = if GOES == ONCE { self.it } else { 0 };
                // At a breakpoint no instruction is fetched, and time stands still until the breakpoint is passed.
                if C::BOUND.is_some() && !matches!(op.what, Do::Breakpoint) {
                    self.fetch_waits(bus, pc, u32::from(op.size));
                }
                let began = self.cycle;
                if it == 0 || self.begins_in_block(bus, op) {
                    match self.execute(bus, op, pc) {
                        Ok(next) => {
                            if it != 0 && op.block == Block::KeepsFlags {
                                (self.flag_n, self.flag_z, self.flag_c, self.flag_v) = self.kept_flags;
                            }
                            self.r[15] = next;
                            pc = next;
                            // The count never comes near 2^64, so it needs no overflow check.
                            self.cycle = self.cycle.wrapping_add(cost::<C>(op));
                            self.retired = self.retired.wrapping_add(1);
                            if C::BOUND == Some(Bound::Best) && self.cycle > self.due {
                                self.cut_short(op, began);
                            }
                        }
                        Err(fault) => {
                            self.fail(bus, op, it, fault);
                            return;
                        }
                    }
                } else {
                    pc = self.r[15];
                }
            }
            if GOES == ONCE || self.cycle >= self.limit || !page.holds(pc) {
                return;
            }
            if GOES == WHILE_UNWRITTEN && bus.rewritten() != rewritten {
                return;
            }
            op = page.op(pc);
        }
    }

    /// Ends an instruction that faulted. Its cycles are counted too.
    #[cold]
    #[inline(never)]
    fn fail<B: Bus>(&mut self, bus: &mut B, op: &Op, it: u8, fault: Fault) {
        self.it = it;
        self.cycle += cost::<C>(op);
        self.limit = 0;
        self.attention = true;
        self.take_fault(bus, fault);
    }

    /// On the optimistic clock, moves time back to an event that is due in the middle of `op`, which began at the cycle
    /// `began`. This is done if silicon interrupts the instruction there: a load/store multiple (TRM 3.9.1), and the
    /// lazy saving of the FP state (TRM 7.2). The remaining cycles pass at the return from the exception, or at once if
    /// there is none. The effects of `op` on registers and memory are already complete.
    #[cold]
    #[inline(never)]
    fn cut_short(&mut self, op: &Op, began: u64) {
        if std::mem::take(&mut self.preserved_fp) >= began || op.is_multiple() {
            let at = self.due.max(began);
            self.cut = self.cycle.saturating_sub(at);
            self.cycle -= self.cut;
        }
    }

    /// Whether `op`, in an IT block, is to be executed. If not, it was skipped or has faulted.
    #[inline(never)]
    fn begins_in_block<B: Bus>(&mut self, bus: &mut B, op: &Op) -> bool {
        let it = self.it;
        // Breakpoints and semihosting calls are not instructions. BKPT and fetch faults do not depend on the condition.
        if matches!(op.what, Do::Breakpoint | Do::HostCall | Do::Bkpt)
            || matches!(op.what, Do::Fault(Fault::BusInstruction | Fault::MemInstruction))
        {
            return true;
        }
        let last = it & 0xF == 8;
        if op.block == Block::Never || op.block == Block::Last && !last {
            self.fail(bus, op, it, Fault::Undefined);
            return false;
        }
        self.it = after(it);
        self.kept_flags = (self.flag_n, self.flag_z, self.flag_c, self.flag_v);
        if self.passes(it >> 4) {
            return true;
        }
        self.r[15] = self.r[15].wrapping_add(u32::from(op.size));
        self.cycle += if C::BOUND.is_some() { 1 } else { u64::from(op.size / 2) };
        self.retired += 1;
        false
    }

    /// Adds the wait states of the words of an instruction that the previous instruction has not fetched.
    fn fetch_waits<B: Bus>(&mut self, bus: &mut B, pc: u32, size: u32) {
        let Some(bound) = C::BOUND else {
            return;
        };
        let last = pc.wrapping_add(size.max(2) - 2) & !3;
        for word in [pc & !3, last] {
            if word != self.fetched {
                self.fetched = word;
                let access = Access {
                    address: word,
                    width: Width::Word,
                    purpose: Purpose::Fetch,
                    privileged: self.is_privileged(),
                    cycle: self.cycle,
                    pc,
                };
                self.cycle += u64::from(bus.wait_states(&access, bound));
            }
        }
    }

    /// Stops the run at a breakpoint or a semihosting call.
    #[cold]
    pub(crate) fn pause(&mut self, exit: Exit) {
        self.paused = Some(exit);
        self.limit = 0;
    }
}

/// Whether code at `pc` never executes, whatever the MPU says: in peripherals, devices and the system's space (ARM ARM
/// B3.1).
const fn never_executable(pc: u32) -> bool {
    pc >= 0xA000_0000 || pc >> 29 == 2
}

pub(crate) const fn after(it: u8) -> u8 {
    if it & 7 == 0 { 0 } else { it & 0xE0 | it << 1 & 0x1F }
}

#[inline(always)]
fn cost<C: Cost>(op: &Op) -> u64 {
    match C::BOUND {
        None => u64::from(op.size / 2),
        Some(Bound::Best) => u64::from(op.least),
        Some(Bound::Worst) => u64::from(op.most),
    }
}
