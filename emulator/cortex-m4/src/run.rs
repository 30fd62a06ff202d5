//! The run loop.
//!
//! | what | when the loop checks it |
//! |---|---|
//! | the caller's `until`, [`Bus::due`], SysTick | each instruction compares its cycle, on the fast clock its address |
//! | [`crate::Signals`] | after an access that announced a change, and after each [`Bus::advance`] |
//! | exceptions | after each change of a signal, and after an instruction that may have changed a priority |
//! | the MPU's rights to execute | once for each page, or at each instruction of a page that is not open as a whole |
//!
//! An instruction executes as a whole. Its accesses take place at the cycle at which it began. If the clock counts wait
//! states, the cycles of its earlier accesses are added.

use crate::code::{BITS as PAGE_BITS, Code, Kind, Page};
use crate::execute::Flow;
use crate::op::{Block, Do, Op};
use crate::{Bound, Bus, Core, Cost, Exit, Fault, Purpose, Width, decode};

/// The number of cycles in which the fast clock executes a whole page straight through.
const PAGE_CYCLES: u64 = 1 << (PAGE_BITS - 1);

/// The point at which the run loop stops.
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

    #[inline(never)]
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
                self.attention |= change.signals;
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
                // An exception should have interrupted the instruction but did not come. The remaining cycles of the
                // instruction pass now.
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
                // The burst ends after one instruction, after which the core checks for exceptions.
                self.limit = self.limit.min(self.cycle + 1);
            }
            self.due = due;
            if stalled {
                self.cycle = self.limit.min(self.stalled_until);
                continue;
            }
            if self.waiting.is_some() || self.locked_up || self.halted || self.hung {
                if self.limit == u64::MAX {
                    // There is no further event, and the caller has set no end.
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
                // The caller handles the effects of this instruction in its next call.
                return Exit::Until;
            }
        }
    }

    #[inline(always)]
    fn execute_until_limit<B: Bus>(&mut self, bus: &mut B, code: &mut Code, single: bool) {
        let careful = single || self.passed.is_some() || self.refused_call.is_some();
        let careful = careful || self.ici != 0;
        self.note_short_way();
        loop {
            let pc = self.r[15];
            if self.rewritten != bus.rewritten() {
                code.forget_rewritten(bus);
                self.rewritten = bus.rewritten();
            }
            let place = code.page(bus, pc);
            let page = code.at(place);
            let kind = page.kind();
            let one_by_one = careful || self.notes_one_by_one();
            if !one_by_one && kind != Kind::Compared && !never_executable(pc) && self.mpu_opens_page(pc, PAGE_BITS) {
                self.burst(bus, page);
            } else {
                let op = *page.op(pc);
                let op = self.careful_op(bus, code, pc, op, kind != Kind::Compared);
                self.single_noted(bus, &op);
                if careful {
                    return;
                }
                if self.r[15] == pc {
                    self.cycle = self.repeat(&op, self.cycle);
                }
            }
            if self.cycle >= self.limit {
                return;
            }
        }
    }

    /// Returns the instruction at `pc` if `op`, which the page has decoded there, needs checks before it is used.
    /// `known` says that `op` matches memory.
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

    /// Executes the instructions of `page` from r15 on while they are in the page and the cycle is below the limit.
    #[inline(always)]
    fn burst<B: Bus>(&mut self, bus: &mut B, page: &Page) {
        if C::BOUND.is_some() {
            self.timed_burst(bus, page);
        } else {
            self.fast_burst(bus, page);
        }
    }

    /// A burst on a clock with bounds, which adds the cycles of each instruction.
    #[inline(never)]
    fn timed_burst<B: Bus>(&mut self, bus: &mut B, page: &Page) {
        let mut pc = self.r[15];
        loop {
            // EPSR.IT at the instruction, 0 outside IT blocks.
            let it = self.it;
            let mut op = page.op(pc);
            if it != 0 && (op.is_unconditional() || !op.block.allows(it)) {
                self.single(bus, op);
                return;
            }
            self.count_fetch(bus, op, pc);
            if it != 0 {
                self.it = after(it);
                self.kept_flags = self.flags;
            }
            if it != 0 && !self.passes(it >> 4) {
                self.pass_over(op);
                pc = self.r[15];
            } else {
                let stop = if it == 0 { page.end() } else { 0 };
                // Executes up to a taken branch, an IT block or `stop`.
                loop {
                    let (own, began) = (pc, self.cycle);
                    let next = pc.wrapping_add(u32::from(op.size));
                    let flow = match self.execute(bus, op, next) {
                        Ok(flow) => flow,
                        Err(fault) => {
                            self.fail(bus, op, it, fault);
                            return;
                        }
                    };
                    pc = if let Flow::To(target) = flow { target } else { next };
                    self.complete(op, pc, began);
                    if !matches!(flow, Flow::On) || pc >= stop || self.cycle >= self.limit {
                        if pc == own {
                            self.cycle = self.repeat(op, self.cycle);
                        }
                        break;
                    }
                    op = page.op(pc);
                    // At an address that is no multiple of 4, the previous instruction has already fetched the word
                    // with the first halfword.
                    if u32::from(op.size) & !(pc & 2) != 0 {
                        self.fetch_word(bus, pc.wrapping_add(u32::from(op.size)).wrapping_sub(2) & !3);
                    }
                }
                if it != 0 && op.block == Block::KeepsFlags {
                    self.flags = self.kept_flags;
                }
            }
            if self.cycle >= self.limit || !page.holds(pc) {
                return;
            }
        }
    }

    /// A burst on the fast clock. An instruction costs as many cycles as it has halfwords, so its address tells its
    /// cycle ([`Core::catch_up`]); only a branch changes the difference of the two. If the address has reached `stop`,
    /// the limit of time or the end of the page is reached. In an IT block `stop` is 0, so that the same comparison
    /// also tells when an instruction of the block has ended.
    #[inline(never)]
    fn fast_burst<B: Bus>(&mut self, bus: &mut B, page: &Page) {
        if self.it != 0 && !self.finish_block(bus, page) {
            return;
        }
        // EPSR.IT at the instruction, 0 outside IT blocks.
        let mut it = 0;
        let mut pc = self.r[15];
        self.count_from(pc, self.cycle);
        self.set_stop(page, pc);
        self.unnoted = pc;
        loop {
            let op = page.op(pc);
            pc = pc.wrapping_add(u32::from(op.size));
            match self.execute(bus, op, pc) {
                Ok(Flow::On) => {}
                Ok(Flow::To(target)) => {
                    if self.record.is_some() {
                        self.note_run(bus, page, pc, true);
                        self.unnoted = target;
                    }
                    let mut cycle = self.cycle_at(pc);
                    if target == self.r[15] {
                        cycle = self.repeat(op, cycle);
                    }
                    self.count_from(target, cycle);
                    self.stop_before_limit(page, target, cycle);
                    if it != 0 || !page.holds(target) {
                        self.stop = 0;
                    }
                    pc = target;
                }
                Ok(Flow::Block) => {
                    self.stop = 0;
                    // With a record the burst ends here, and the instructions of the block are executed one by one.
                    it = if self.record.is_some() { 0 } else { self.it };
                }
                Err(fault) => {
                    self.catch_up();
                    self.note_run(bus, page, self.r[15], false);
                    self.fail(bus, op, it, fault);
                    return;
                }
            }
            self.r[15] = pc;
            // These counts never come near 2^64, so the additions wrap and save an overflow check in each instruction.
            self.retired = self.retired.wrapping_add(1);
            if pc >= self.stop {
                if it != 0 {
                    if op.block == Block::KeepsFlags {
                        self.flags = self.kept_flags;
                    }
                    if let Some(next) = self.next_in_block(page) {
                        (it, pc) = (next, self.r[15]);
                        continue;
                    }
                }
                self.catch_up();
                self.note_run(bus, page, pc, false);
                return;
            }
        }
    }

    /// Repeats a branch to itself, `op`, up to the limit. Its first execution has ended at `cycle`. Counts the
    /// repetitions and returns the cycle at which the last one ends.
    ///
    /// A 16-bit `b .` changes no state and needs no further word of code, so all repetitions take the same time, except
    /// on the pessimistic clock, where a taken branch fetches its word again. On that clock, for another branch and
    /// without a limit, nothing is repeated and `cycle` is returned.
    #[cold]
    #[inline(never)]
    fn repeat(&mut self, op: &Op, cycle: u64) -> u64 {
        let is_steady = matches!(op.what, Do::B { .. }) && op.size == 2 && C::BOUND != Some(Bound::Worst);
        if !is_steady || self.limit == u64::MAX {
            return cycle;
        }
        let length = cost::<C>(op) + C::REFILL;
        let times = self.limit.saturating_sub(cycle).div_ceil(length);
        self.retired = self.retired.wrapping_add(times);
        cycle + times * length
    }

    /// Prepares the next instruction in or behind an IT block on the fast clock, after those whose condition fails.
    /// Returns its EPSR.IT, which is 0 behind the block, or `None` where the burst ends.
    #[inline(never)]
    fn next_in_block(&mut self, page: &Page) -> Option<u8> {
        loop {
            let (it, pc) = (self.it, self.r[15]);
            self.set_stop(page, pc);
            if pc >= self.stop || !page.holds(pc) {
                return None;
            }
            if it == 0 {
                return Some(0);
            }
            let op = page.op(pc);
            if op.is_unconditional() || !op.block.allows(it) {
                return None;
            }
            self.it = after(it);
            if self.passes(it >> 4) {
                self.kept_flags = self.flags;
                self.stop = 0;
                return Some(it);
            }
            self.r[15] = pc.wrapping_add(u32::from(op.size));
            self.retired = self.retired.wrapping_add(1);
        }
    }

    /// Sets `stop` to the address at which straight execution from `pc` on reaches the limit or the end of the page.
    #[inline(always)]
    fn set_stop(&mut self, page: &Page, pc: u32) {
        self.stop = page.end();
        self.stop_before_limit(page, pc, self.cycle_at(pc));
    }

    /// On the fast clock, notes that the instruction at `pc` begins at `cycle`.
    #[inline(always)]
    pub(crate) fn count_from(&mut self, pc: u32, cycle: u64) {
        self.origin = (cycle << 1).wrapping_sub(u64::from(pc));
    }

    /// On the fast clock, the cycle at which the instruction at `pc` begins if no branch comes before it.
    #[inline(always)]
    fn cycle_at(&self, pc: u32) -> u64 {
        self.origin.wrapping_add(u64::from(pc)) >> 1
    }

    /// On the fast clock, sets the cycle to that at which the instruction at r15 begins. Within a burst the cycle is
    /// not kept, so whoever needs it there calls this function first. It does nothing on the other clocks.
    #[inline(always)]
    pub(crate) fn catch_up(&mut self) {
        if C::BOUND.is_none() {
            self.cycle = self.cycle_at(self.r[15]);
        }
    }

    /// Sets `stop` to the address at which execution from `pc` at `cycle` reaches the limit, if straight execution may
    /// reach it within the page.
    #[inline(always)]
    fn stop_before_limit(&mut self, page: &Page, pc: u32, cycle: u64) {
        if self.limit < cycle.wrapping_add(PAGE_CYCLES) {
            let left = self.limit.saturating_sub(cycle) as u32;
            self.stop = page.end().min(pc.wrapping_add(2 * left));
        }
    }

    /// Makes the burst end after this instruction.
    #[inline(always)]
    pub(crate) fn end_burst(&mut self) {
        self.limit = 0;
        self.stop = 0;
    }

    /// Executes the rest of an IT block. Returns whether the burst may go on after the block.
    #[inline(never)]
    fn finish_block<B: Bus>(&mut self, bus: &mut B, page: &Page) -> bool {
        while self.it != 0 && self.cycle < self.limit && page.holds(self.r[15]) {
            self.single(bus, page.op(self.r[15]));
        }
        self.cycle < self.limit && page.holds(self.r[15])
    }

    /// Executes `op`, which is at r15, inside or outside an IT block.
    #[inline(never)]
    pub(crate) fn single<B: Bus>(&mut self, bus: &mut B, op: &Op) {
        let (it, pc) = (self.it, self.r[15]);
        self.count_fetch(bus, op, pc);
        if it != 0 && !self.begins_in_block(bus, op) {
            return;
        }
        let began = self.cycle;
        self.count_from(pc, began);
        let next = pc.wrapping_add(u32::from(op.size));
        match self.execute(bus, op, next) {
            Ok(flow) => {
                if it != 0 && op.block == Block::KeepsFlags {
                    self.flags = self.kept_flags;
                }
                if C::BOUND.is_none() {
                    self.cycle = self.cycle_at(pc);
                }
                let to = if let Flow::To(target) = flow { target } else { next };
                self.complete(op, to, began);
            }
            Err(fault) => self.fail(bus, op, it, fault),
        }
    }

    /// Counts an instruction that was executed from the cycle `began` on. The next instruction is at `next`.
    #[inline(always)]
    fn complete(&mut self, op: &Op, next: u32, began: u64) {
        self.r[15] = next;
        self.cycle = self.cycle.wrapping_add(cost::<C>(op));
        self.retired = self.retired.wrapping_add(1);
        if C::BOUND == Some(Bound::Best) && self.cycle > self.due {
            self.cut_short(op, began);
        }
    }

    /// Adds the wait states of fetching `op`. At a breakpoint, whose size is 0, no instruction is fetched yet: time
    /// stands still until the instruction at the breakpoint is executed.
    #[inline(always)]
    fn count_fetch<B: Bus>(&mut self, bus: &mut B, op: &Op, pc: u32) {
        if C::BOUND.is_some() && op.size != 0 {
            self.fetch_waits(bus, pc, u32::from(op.size));
        }
    }

    /// Ends an instruction that faulted. Its cycles are counted too.
    #[cold]
    #[inline(never)]
    fn fail<B: Bus>(&mut self, bus: &mut B, op: &Op, it: u8, fault: Fault) {
        self.it = it;
        self.cycle += cost::<C>(op);
        self.end_burst();
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
        if op.is_unconditional() {
            return true;
        }
        if !op.block.allows(it) {
            self.fail(bus, op, it, Fault::Undefined);
            return false;
        }
        self.it = after(it);
        self.kept_flags = self.flags;
        if self.passes(it >> 4) {
            return true;
        }
        self.pass_over(op);
        false
    }

    /// Counts an instruction in an IT block whose condition fails.
    #[inline(always)]
    fn pass_over(&mut self, op: &Op) {
        self.r[15] = self.r[15].wrapping_add(u32::from(op.size));
        self.cycle += if C::BOUND.is_some() { 1 } else { u64::from(op.size / 2) };
        self.retired += 1;
    }

    /// Adds the wait states of the words of an instruction that the previous instruction has not fetched.
    #[inline(always)]
    pub(crate) fn fetch_waits<B: Bus>(&mut self, bus: &mut B, pc: u32, size: u32) {
        let last = pc.wrapping_add(size - 2) & !3;
        for word in [pc & !3, last] {
            if word != self.fetched {
                self.fetch_word(bus, word);
            }
        }
    }

    /// Adds the wait states of fetching the word at `word`.
    #[inline(always)]
    fn fetch_word<B: Bus>(&mut self, bus: &mut B, word: u32) {
        let Some(bound) = C::BOUND else {
            return;
        };
        self.fetched = word;
        let waits = match bus.memory_waits(word, true, self.cycle, bound) {
            Some(waits) => waits,
            None => self.asked_waits(bus, word, Width::Word, Purpose::Fetch, bound),
        };
        self.cycle = self.cycle.wrapping_add(u64::from(waits));
    }

    /// Stops the run at a breakpoint or a semihosting call.
    #[cold]
    pub(crate) fn pause(&mut self, exit: Exit) {
        self.paused = Some(exit);
        self.end_burst();
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
