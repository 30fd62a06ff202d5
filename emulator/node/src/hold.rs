//! A debugger that halts a node's core, with breakpoints, watchpoints and steps.
//!
//! No time passes for a halted node: [`Node::advance`] returns at once. Whoever advances the node must also stop
//! everything else in the run. On silicon the firmware's watchdogs and other boards would go on; here they stand still,
//! so the firmware cannot detect that it was halted. A debugger that only halts, reads and resumes does not change the
//! run.
//!
//! | what | rule |
//! |---|---|
//! | breakpoint | halts before the instruction; any number of them, in flash and in RAM |
//! | watchpoint | halts after the instruction that made the access ([`cortex_m4::Watchpoint`]); ignores DMA |
//! | step | one instruction; interrupts that come before it run to the end of their handlers |
//! | step into a fault | halts before the handler's first instruction, since a fault handler need not return |
//! | reset of the part | ends a step; breakpoints and watchpoints stay |
//! | end of the firmware | halts if requested: at HardFault, an exception without a handler, or a lock-up |

use std::collections::BTreeSet;
use std::ops::Range;

use cortex_m4::{Cost, Exit, Register, Watched, Watchpoint};

use super::{Board, Node};

/// The exceptions HardFault, MemManage, BusFault and UsageFault, ARMv7-M ARM table B1-4.
const FAULTS: std::ops::RangeInclusive<u16> = 3..=6;

/// The reason for which a node's core halted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// The debugger requested the halt.
    Asked,
    /// The next instruction is at a breakpoint.
    Breakpoint,
    /// The last instruction made this access to a watched address.
    Watchpoint(Watched),
    /// A step is complete.
    Stepped,
    /// The part was reset, and the debugger had requested a halt after a reset.
    Reset,
    /// The firmware ended in a HardFault, in an exception without a handler or in a lock-up. The debugger had requested
    /// a halt at the end.
    Ended,
}

/// The point up to which a resumed core runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Resume {
    /// The core runs to the next breakpoint or watchpoint.
    Continue,
    /// The core executes one instruction.
    Step,
    /// The core executes instructions until the next one is outside this range of addresses.
    StepWithin(Range<u32>),
}

#[derive(Clone, Debug, Default)]
pub(super) struct Hold {
    halted: Option<Halt>,
    breakpoints: BTreeSet<u32>,
    /// The program counter, and the number of executed instructions, when the core was resumed. A breakpoint at this
    /// point does not halt the core again.
    resumed: Option<(u32, u64)>,
    step: Option<Step>,
    halts_after_reset: bool,
    halts_at_end: bool,
}

#[derive(Clone, Debug)]
struct Step {
    within: Range<u32>,
    /// Where the step began: the program counter, the stack pointer and the active exception.
    place: (u32, u32, u16),
    away: bool,
}

impl<B: Board, C: Cost> Node<B, C> {
    /// The reason for which the debugger has halted the core; `None` if it has not.
    #[must_use]
    pub fn halted(&self) -> Option<Halt> {
        self.hold.halted
    }

    /// Halts the core at the instruction that it has reached, unless it is already halted.
    pub fn halt(&mut self) {
        self.halt_for(Halt::Asked);
    }

    /// Resumes a halted core.
    pub fn resume(&mut self, how: Resume) {
        let place = self.place();
        self.hold.resumed = Some((place.0, self.core.retired()));
        self.hold.halted = None;
        self.hold.step = match how {
            Resume::Continue => None,
            // An empty range makes the step end after one instruction.
            Resume::Step => Some(Step { within: 0..0, place, away: false }),
            Resume::StepWithin(within) => Some(Step { within, place, away: false }),
        };
    }

    /// Makes the core halt before the instruction at `address` from now on.
    pub fn set_breakpoint(&mut self, address: u32) {
        self.hold.breakpoints.insert(address & !1);
        self.core.set_breakpoint(address);
    }

    /// Removes a breakpoint. Returns whether it was set.
    pub fn clear_breakpoint(&mut self, address: u32) -> bool {
        let was = self.hold.breakpoints.remove(&(address & !1));
        // The node itself may stop at this address to report an event, so its own stop must remain.
        if was && !self.is_trap(u64::from(address & !1)) {
            self.core.clear_breakpoint(address);
        }
        was
    }

    /// Makes the core halt after each instruction that makes the access of `watchpoint`.
    pub fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        self.core.set_watchpoint(watchpoint);
    }

    /// Removes a watchpoint. Returns whether it was set.
    pub fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        self.core.clear_watchpoint(watchpoint)
    }

    /// Sets whether the core halts after each reset of the part, before its first instruction.
    pub fn halt_after_reset(&mut self, on: bool) {
        self.hold.halts_after_reset = on;
    }

    /// Sets whether the core halts when the firmware ends ([`Halt::Ended`]): before the first instruction of a fault's
    /// handler, or at a lock-up.
    pub fn halt_at_end(&mut self, on: bool) {
        self.hold.halts_at_end = on;
    }

    fn is_trap(&self, address: u64) -> bool {
        let traps = &self.traps;
        traps.default_handler.contains(&address) || traps.panic.contains(&address)
    }

    fn place(&self) -> (u32, u32, u16) {
        (self.core.pc(), self.core.register(Register::R(13)), self.core.active_exception())
    }

    fn halt_for(&mut self, why: Halt) {
        self.hold.halted.get_or_insert(why);
        self.hold.step = None;
    }

    /// Runs the core to `until` at the latest, by single instructions if the debugger has requested a step.
    #[inline]
    pub(super) fn run_held(&mut self, until: u64) -> Exit {
        if self.hold.step.is_some() { self.run_step(until) } else { self.core.run(&mut self.side, until) }
    }

    #[cold]
    #[inline(never)]
    fn run_step(&mut self, until: u64) -> Exit {
        let (executed, changes) = (self.core.retired(), self.core.exception_changes());
        let exit = self.core.run_one(&mut self.side, until);
        let executed = self.core.retired() != executed;
        let entered = !executed && self.core.exception_changes() != changes;
        let place = self.place();
        let Some(step) = &mut self.hold.step else { return exit };
        if step.away {
            step.away = !executed || place != step.place;
        } else if executed && step.within.contains(&place.0) {
            step.place = place;
        } else if executed || entered && FAULTS.contains(&place.2) {
            self.hold.step = None;
            // If a watchpoint has halted the core, that reason is kept, because it is more specific than the end of a
            // step.
            if exit != Exit::Watchpoint {
                self.halt_for(Halt::Stepped);
            }
        } else if entered {
            step.away = true;
        }
        exit
    }

    pub(super) fn met_breakpoint(&mut self) {
        let pc = self.core.pc();
        if !self.hold.breakpoints.contains(&pc) {
            return;
        }
        // The handling of a trap may have removed the debugger's breakpoint at this address.
        self.core.set_breakpoint(pc);
        if self.hold.resumed != Some((pc, self.core.retired())) {
            self.halt_for(Halt::Breakpoint);
        }
    }

    pub(super) fn met_watchpoint(&mut self) {
        if let Some(watched) = self.core.take_watched() {
            self.halt_for(Halt::Watchpoint(watched));
        }
    }

    pub(super) fn hold_after_reset(&mut self) {
        if self.hold.step.is_some() || self.hold.halts_after_reset {
            self.halt_for(Halt::Reset);
        }
    }

    /// Halts the core after a trap or a lock-up that ended the firmware, if the debugger has requested this. `before`
    /// is the number of findings before the trap or lock-up.
    pub(super) fn hold_at_end(&mut self, before: usize) {
        let ended = self.findings().iter().skip(before).any(|finding| finding.kind.ends_run());
        if ended && self.hold.halts_at_end {
            self.halt_for(Halt::Ended);
        }
    }
}
