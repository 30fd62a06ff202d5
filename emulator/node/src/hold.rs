//! A debugger that halts a node's core: breakpoints, watchpoints, steps.
//!
//! A halted node goes through no time at all: [`Node::advance`] comes back at once, and whoever steps the node has to
//! hold everything else of its world, too. So a firmware never finds out that it was halted, and neither do its
//! watchdogs, its timers or the other board; on silicon they all would. What is done here between [`Halt`] and
//! [`Resume`] without changing a register or memory changes nothing of what the run does.
//!
//! | what | rule |
//! |---|---|
//! | breakpoint | halts before the instruction; as many as wanted, in flash and in RAM |
//! | watchpoint | halts behind the instruction that loaded or stored there ([`cortex_m4::Watchpoint`]); not DMA's |
//! | step | one instruction; interrupts that come before it are handled on the way, to their ends |
//! | step into a fault | halts before the handler's first instruction, since a fault handler need not return |
//! | reset of the part | ends a step; breakpoints and watchpoints stay |
//! | end of the firmware | halts there where that is asked for: HardFault, an exception without a handler, lock-up |

use std::collections::BTreeSet;
use std::ops::Range;

use cortex_m4::{Cost, Exit, Register, Watched, Watchpoint};

use super::{Board, Node};

/// HardFault, MemManage, BusFault and UsageFault, ARMv7-M ARM table B1-4.
const FAULTS: std::ops::RangeInclusive<u16> = 3..=6;

/// Why a node's core halted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// The debugger asked for it.
    Asked,
    /// The next instruction is at a breakpoint.
    Breakpoint,
    /// The instruction before made this access.
    Watchpoint(Watched),
    /// A step is done.
    Stepped,
    /// The part was reset, and the debugger wanted to know.
    Reset,
    /// The firmware came to its end in a HardFault, in an exception without a handler or in a lock-up, and the debugger
    /// wanted to know.
    Ended,
}

/// How a halted core goes on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Resume {
    /// To the next breakpoint or watchpoint.
    Continue,
    /// By one instruction.
    Step,
    /// By instructions until the next one is outside these addresses.
    StepWithin(Range<u32>),
}

/// What a debugger wants of a core.
#[derive(Clone, Debug, Default)]
pub(super) struct Hold {
    halted: Option<Halt>,
    breakpoints: BTreeSet<u32>,
    /// Where the core was resumed: the program counter and the instructions executed by then. The breakpoint there does
    /// not halt it again.
    resumed: Option<(u32, u64)>,
    step: Option<Step>,
    halts_after_reset: bool,
    halts_at_end: bool,
}

/// A step under way.
#[derive(Clone, Debug)]
struct Step {
    /// The step goes on while the program counter is in here.
    within: Range<u32>,
    /// Where the core is in the code that is stepped: program counter, stack pointer, active exception.
    place: (u32, u32, u16),
    /// An interrupt is being handled.
    away: bool,
}

impl<B: Board, C: Cost> Node<B, C> {
    /// Why the core is halted by the debugger, if it is.
    #[must_use]
    pub fn halted(&self) -> Option<Halt> {
        self.hold.halted
    }

    /// Halts the core where it is, if it is not halted yet.
    pub fn halt(&mut self) {
        self.halt_for(Halt::Asked);
    }

    /// Lets a halted core go on.
    pub fn resume(&mut self, how: Resume) {
        let place = self.place();
        self.hold.resumed = Some((place.0, self.core.retired()));
        self.hold.halted = None;
        self.hold.step = match how {
            Resume::Continue => None,
            // No address is in this range.
            Resume::Step => Some(Step { within: 0..0, place, away: false }),
            Resume::StepWithin(within) => Some(Step { within, place, away: false }),
        };
    }

    /// Halts the core before the instruction at `address` from now on.
    pub fn set_breakpoint(&mut self, address: u32) {
        self.hold.breakpoints.insert(address & !1);
        self.core.set_breakpoint(address);
    }

    /// Takes a breakpoint back. Answers whether it was there.
    pub fn clear_breakpoint(&mut self, address: u32) -> bool {
        let was = self.hold.breakpoints.remove(&(address & !1));
        // Where the node itself stops to tell what happened, it goes on doing so.
        if was && !self.is_trap(u64::from(address & !1)) {
            self.core.clear_breakpoint(address);
        }
        was
    }

    /// Halts the core behind each instruction that accesses these addresses so, from now on.
    pub fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        self.core.set_watchpoint(watchpoint);
    }

    /// Takes a watchpoint back. Answers whether it was there.
    pub fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        self.core.clear_watchpoint(watchpoint)
    }

    /// Halts the core after each reset of the part from now on, before its first instruction, or no longer.
    pub fn halt_after_reset(&mut self, on: bool) {
        self.hold.halts_after_reset = on;
    }

    /// Halts the core from now on where the firmware comes to its end ([`Halt::Ended`]), or no longer. It halts before
    /// the first instruction of the handler, or behind the last one before a lock-up.
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

    /// Runs the core to `until` at the latest, as the debugger wants it.
    #[inline]
    pub(super) fn run_held(&mut self, until: u64) -> Exit {
        if self.hold.step.is_some() { self.run_step(until) } else { self.core.run(&mut self.side, until) }
    }

    /// Takes a step by one instruction or exception entry further.
    #[cold]
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
            // A watchpoint says more.
            if exit != Exit::Watchpoint {
                self.halt_for(Halt::Stepped);
            }
        } else if entered {
            step.away = true;
        }
        exit
    }

    /// The core is before an instruction that it was to stop at.
    pub(super) fn met_breakpoint(&mut self) {
        let pc = self.core.pc();
        if !self.hold.breakpoints.contains(&pc) {
            return;
        }
        // The trap there may have taken it back.
        self.core.set_breakpoint(pc);
        if self.hold.resumed != Some((pc, self.core.retired())) {
            self.halt_for(Halt::Breakpoint);
        }
    }

    /// The core is behind an access that is watched.
    pub(super) fn met_watchpoint(&mut self) {
        if let Some(watched) = self.core.take_watched() {
            self.halt_for(Halt::Watchpoint(watched));
        }
    }

    /// The part was reset.
    pub(super) fn hold_after_reset(&mut self) {
        if self.hold.step.is_some() || self.hold.halts_after_reset {
            self.halt_for(Halt::Reset);
        }
    }

    /// The node had this many findings before the core met a trap or locked up.
    pub(super) fn hold_at_end(&mut self, before: usize) {
        let ended = self.findings().iter().skip(before).any(|finding| finding.kind.ends_run());
        if ended && self.hold.halts_at_end {
            self.halt_for(Halt::Ended);
        }
    }
}
