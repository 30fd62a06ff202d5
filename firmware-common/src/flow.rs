//! Checks that the tasks of a cycle run in their order, each exactly once, and none too early.
//!
//! # Design
//!
//! The [check-in](crate::check_in) finds a task that does not run. This module finds one that runs although it is not
//! its turn: an interrupt that nothing has called for, a timer whose registers have changed, a task that was left out.
//! No independent watchdog of these parts has a window, so the firmware itself compares order and time.
//!
//! A firmware lists the *steps* of its cycle in their order ([`Step::TABLE`]), and counts the runs of each step. A step
//! may begin if every step that must precede it has run once more than itself. A preceding step that stands later in
//! the table belongs to the previous cycle, and has run as often. A step that a timer calls also has a *time*: how long
//! after the previous timed step it is due, with bounds for early and late. A counter that does not depend on that
//! timer measures this time, from the instant at which the previous step was due. So a timer that is slightly wrong is
//! found after some cycles.
//!
//! Only the task of a step writes the step's counter, so no lock is needed, and the check takes the same time whatever
//! it finds. A firmware that learns of a wrong step stops at once: it enters its safe state, in which nothing feeds the
//! watchdog.

use core::{
    marker::PhantomData,
    sync::atomic::{AtomicU32, Ordering},
};

/// What has to be true when a step begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// The indices of the steps that must have run since this step last began.
    pub after: &'static [usize],
    /// The time from when the last step with a time was due until this one is due, in counts of the firmware's counter;
    /// `None` if the time does not matter. A step that begins for the first time is due just then.
    pub time: Option<u32>,
}

/// The steps of a firmware's cycle.
pub trait Step: Copy {
    /// The rule of each step, in the order of the cycle; at most 8 steps.
    const TABLE: &'static [Rule];

    /// How much a step may begin before it is due, in counts of the firmware's counter.
    const EARLY: u32;

    /// How much a step may begin after it is due, in counts of the firmware's counter.
    const LATE: u32;

    /// Returns the index of this step in the table.
    fn index(self) -> usize;
}

const MOST: usize = 8;

/// The record of the steps that have run.
#[derive(Debug)]
pub struct Flow<S> {
    runs: [AtomicU32; MOST],
    due: AtomicU32,
    steps: PhantomData<fn(S)>,
}

impl<S: Step> Default for Flow<S> {
    fn default() -> Self {
        Self::new()
    }
}

impl<S: Step> Flow<S> {
    /// Returns the state before the first step of the table.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(S::TABLE.len() <= MOST) }
        Self { runs: [const { AtomicU32::new(0) }; MOST], due: AtomicU32::new(0), steps: PhantomData }
    }

    /// Records that `step` begins. Returns whether it is the step's turn. `now` returns the firmware's counter, which
    /// wraps at 2^32; it is called if the step has a time. The steps with a time must belong to one task.
    #[inline(always)]
    #[must_use = "a firmware whose steps are out of order has to stop"]
    pub fn begin(&self, step: S, now: impl FnOnce() -> u32) -> bool {
        let index = step.index();
        let runs = |of: usize| self.runs.get(of).map_or(0, |runs| runs.load(Ordering::Relaxed));
        let (Some(rule), Some(own)) = (S::TABLE.get(index), self.runs.get(index)) else { return false };
        let before = own.load(Ordering::Relaxed);
        let next = before.wrapping_add(1);
        let mut in_order = true;
        for earlier in rule.after {
            in_order &= runs(*earlier) == if *earlier < index { next } else { before };
        }
        if let Some(time) = rule.time {
            let now = now();
            let due = if before == 0 { now } else { self.due.load(Ordering::Relaxed).wrapping_add(time) };
            in_order &= now.wrapping_sub(due.wrapping_sub(S::EARLY)) <= S::EARLY + S::LATE;
            self.due.store(due, Ordering::Relaxed);
        }
        own.store(next, Ordering::Relaxed);
        in_order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The steps of a cycle of 100 counts: a tick, a slot 30 counts later, and a task after each of them.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Four {
        Tick,
        Fill,
        Slot,
        Vote,
    }

    const ALL: [Four; 4] = [Four::Tick, Four::Fill, Four::Slot, Four::Vote];

    impl Step for Four {
        const TABLE: &'static [Rule] = &[
            Rule { after: &[2, 3], time: Some(70) },
            Rule { after: &[0], time: None },
            Rule { after: &[0], time: Some(30) },
            Rule { after: &[1, 2], time: None },
        ];
        const EARLY: u32 = 2;
        const LATE: u32 = 9;
        fn index(self) -> usize {
            self as usize
        }
    }

    /// Runs the steps, each with its time, after two cycles that end at count 0. Returns the first step out of order.
    fn first_wrong(steps: &[(Four, u32)]) -> Option<usize> {
        let flow = Flow::new();
        for base in [0_u32.wrapping_sub(200), 0_u32.wrapping_sub(100)] {
            for (step, after) in [(Four::Tick, 0), (Four::Slot, 30), (Four::Fill, 31), (Four::Vote, 32)] {
                assert!(flow.begin(step, || base.wrapping_add(after)), "{step:?}");
            }
        }
        steps.iter().position(|(step, now)| !flow.begin(*step, || *now))
    }

    // Shows SAFE-16.
    #[test]
    fn any_order_that_the_table_allows_passes() {
        use Four::{Fill, Slot, Tick, Vote};
        assert_eq!(first_wrong(&[(Tick, 0), (Fill, 1), (Slot, 30), (Vote, 31), (Tick, 100)]), None);
        assert_eq!(first_wrong(&[(Tick, 0), (Slot, 30), (Fill, 31), (Vote, 32), (Tick, 100)]), None);
    }

    // Shows SAFE-16.
    #[test]
    fn a_step_that_runs_twice_is_out_of_order() {
        for twice in ALL {
            let mut steps = vec![];
            for (step, now) in ALL.into_iter().zip([0, 1, 30, 31]) {
                steps.push((step, now));
                if step == twice {
                    // The repeated step begins at the right time, so only the order is wrong.
                    steps.push((step, now + if step == Four::Tick { 70 } else { 30 }));
                    assert_eq!(first_wrong(&steps), Some(steps.len() - 1), "{twice:?}");
                    break;
                }
            }
        }
    }

    // Shows SAFE-16.
    #[test]
    fn the_step_after_one_left_out_is_out_of_order() {
        let cycle = |base: u32| ALL.into_iter().zip([base, base + 1, base + 30, base + 31]);
        for left_out in ALL {
            let steps: Vec<_> = cycle(0).filter(|(step, _)| *step != left_out).chain(cycle(100)).collect();
            assert!(first_wrong(&steps).is_some_and(|wrong| wrong <= 3), "{left_out:?}");
        }
    }

    // Shows SAFE-16.
    #[test]
    fn a_step_passes_in_its_window_and_not_a_count_beside_it() {
        use Four::{Fill, Slot, Tick, Vote};
        for (tick, passes) in [(-3, false), (-2, true), (0, true), (9, true), (10, false)] {
            assert_eq!(first_wrong(&[(Tick, 0_u32.wrapping_add_signed(tick))]).is_none(), passes, "{tick}");
        }
        // The slot is due 30 counts after the tick was due, however late the tick was.
        for (slot, passes) in [(27, false), (28, true), (39, true), (40, false)] {
            let wrong = first_wrong(&[(Tick, 9), (Fill, 10), (Slot, slot), (Vote, 41)]);
            assert_eq!(wrong, if passes { None } else { Some(2) }, "{slot}");
        }
    }

    #[test]
    fn a_timer_one_count_too_slow_is_found_after_ten_cycles() {
        let mut steps = vec![];
        for cycle in 0..20 {
            steps.extend(ALL.into_iter().zip([0, 1, 30, 31]).map(|(step, after)| (step, 101 * cycle + after)));
        }
        assert_eq!(first_wrong(&steps), Some(4 * 10));
    }

    #[test]
    fn the_times_count_from_the_first_run_of_each_step() {
        use Four::{Fill, Slot, Tick, Vote};
        let flow = Flow::new();
        // The start may delay the first steps.
        for (step, now) in [(Tick, 7_000), (Fill, 7_001), (Slot, 7_050), (Vote, 7_051)] {
            assert!(flow.begin(step, || now), "{step:?}");
        }
        assert!(!flow.begin(Tick, || 7_100), "it is due at 7120");
    }
}
