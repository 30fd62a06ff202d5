//! How a node advances through time.

use cortex_m4::{Bus, Cost, Exit, Register};
use emulator_part::{Cycle, NEVER, Reset};

use super::report::BRANCH_TO_ITSELF;
use super::{Board, FindingKind, Node, memory};

impl<B: Board, C: Cost> Node<B, C> {
    pub(super) fn present(&self) -> Cycle {
        self.core.cycle().min(self.side.horizon)
    }

    /// The instant that this board has reached, in virtual nanoseconds.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.side.time.ns(self.present())
    }

    /// The instant (virtual ns) at which `cycle` of this board's core begins.
    #[must_use]
    pub fn ns(&self, cycle: Cycle) -> u64 {
        self.side.ns(cycle)
    }

    /// The first cycle of this board's core that begins at or after `ns`.
    #[must_use]
    pub fn cycle_at(&self, ns: u64) -> Cycle {
        self.side.time.cycle(ns)
    }

    /// Returns the first instant at which this board may act by itself. It is the present while the core is awake.
    /// Without a supply it is the next instant of the board's chips.
    #[must_use]
    pub fn earliest(&self) -> u64 {
        if !self.powered {
            self.side.time.ns(self.side.board_due).max(self.now())
        } else if (self.core.is_asleep() && !self.side.stirred) || self.stopped() {
            self.side.time.ns(self.side.due().min(self.core.due())).max(self.now())
        } else {
            self.now()
        }
    }

    /// The longest time of an ordinary instruction at the core's present rate, in virtual nanoseconds.
    #[must_use]
    pub fn instruction_ns(&self) -> u64 {
        2 * self.side.time.cycle_ns()
    }

    fn stopped(&self) -> bool {
        self.exit.is_some() || self.core.locked_up() || self.core.is_hung() || self.side.clock.hz == 0
    }

    /// The status with which the firmware ended the run through semihosting.
    #[must_use]
    pub fn exit_status(&self) -> Option<u32> {
        self.exit
    }

    /// Whether the core sleeps or has no supply.
    #[must_use]
    pub fn is_asleep(&self) -> bool {
        !self.powered || self.core.is_asleep()
    }

    /// Runs to `to` (virtual ns), or to an earlier instruction boundary at which a signal left the board. An action of
    /// the caller on the board then happens at `to`. The core reacts after its present instruction.
    pub fn advance(&mut self, to: u64) {
        self.advance_or_restart(to, false);
    }

    /// Runs as [`Node::advance`] does, but stops at the next restart of the part, before the first instruction. Returns
    /// whether the part restarted.
    pub fn advance_to_restart(&mut self, to: u64) -> bool {
        self.advance_or_restart(to, true)
    }

    #[inline(never)]
    fn advance_or_restart(&mut self, to: u64, stops: bool) -> bool {
        loop {
            if self.halted().is_some() {
                return false;
            }
            if let Some(reset) = self.side.reset.take() {
                self.reset_by(reset);
                if stops {
                    return true;
                }
                continue;
            }
            let now = self.now();
            if now >= self.probe_at {
                self.probe(now);
            }
            if now >= to || self.side.board.outgoing() {
                return false;
            }
            self.side.horizon_ns = to.min(self.probe_at);
            let horizon = self.side.time.cycle(self.side.horizon_ns);
            self.side.horizon = horizon;
            if self.exit.is_some() || !self.powered {
                self.side.advance(horizon);
                self.core.skip_to(self.side.horizon);
                self.note_idle();
                continue;
            }
            self.side.stirred = false;
            let found = self.findings.len();
            self.note_idle();
            match self.run_held(horizon) {
                Exit::Until | Exit::Stopped => {}
                Exit::Halted => self.tell_halt(),
                Exit::Breakpoint => {
                    self.trapped();
                    self.met_breakpoint();
                    self.hold_at_end(found);
                }
                Exit::Fault => {
                    if self.is_in_hard_faults_handler() {
                        self.report_exception(FindingKind::HardFault);
                        self.hold_at_end(found);
                    }
                }
                Exit::Watchpoint => self.met_watchpoint(),
                Exit::HostCall => self.host_call(),
                Exit::Lockup => {
                    self.locked_up();
                    self.hold_at_end(found);
                }
                Exit::ResetRequest => self.side.reset = Some(Reset::Software),
            }
            self.note_idle();
            self.note_tasks();
        }
    }

    fn note_idle(&mut self) {
        let Self { core, side, powered, exit, .. } = self;
        let rests = core.is_asleep() || core.is_halted() || core.locked_up() || core.is_hung();
        side.note_idle(core.cycle(), core.idle(), rests || !*powered || exit.is_some());
    }

    /// Whether the firmware has stopped itself for good: the core loops on one instruction, with interrupts masked or
    /// in the handler of an exception.
    #[must_use]
    pub fn stopped_itself(&self) -> bool {
        let [primask, faultmask] = [Register::Primask, Register::Faultmask].map(|mask| self.core.register(mask) != 0);
        self.powered
            && !self.core.is_asleep()
            && (primask || faultmask || self.core.active_exception() != 0)
            && memory::value(&self.side.part, u64::from(self.core.pc()), 2) == Some(BRANCH_TO_ITSELF)
    }

    /// What the core is doing now, in words.
    #[must_use]
    #[inline(never)]
    pub fn doing(&self) -> String {
        let pc = u64::from(self.core.pc());
        let place = self.firmware.place_of(pc).map_or_else(|| format!("at {pc:#010x}"), |place| format!("in {place}"));
        if !self.powered {
            "its supply is off".to_owned()
        } else if self.core.locked_up() {
            "it is locked up".to_owned()
        } else if self.core.is_hung() {
            format!("it hangs {place}")
        } else if self.side.clock.hz == 0 {
            format!("its core has no clock, {place}")
        } else if self.stopped_itself() {
            format!("it has stopped itself {place}")
        } else if !self.core.is_asleep() {
            format!("it runs {place}")
        } else if self.side.due().min(self.core.due()) == NEVER {
            format!("it sleeps {place}, and nothing is due that could wake it")
        } else {
            format!("it sleeps {place}")
        }
    }
}
