//! The firmware's tasks. All of them must check in before the watchdog is fed ([`firmware_common::check_in`]).
//!
//! Each beat of the timer (every 25 ms) calls every task, and a task without work checks in as well. So no task depends
//! on an event from outside.

use firmware_common::flow::{self, Rule};

use crate::timing::{BEAT_MS, SLOT_US};

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);

/// A step of the hold's cycle. The firmware checks the order and the times of these steps ([`firmware_common::flow`]).
///
/// The slot comes first, because the timer starts at 0 and reaches the slot before the first beat. Each beat calls the
/// other tasks as well, but they are no steps: the front end and the sensors' bus decide when and how long they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The slot, [`SLOT_US`] after each beat. The first slot of a cycle sends the frame.
    Slot,
    /// The beat.
    Beat,
    /// The task `cycle`, which each beat calls.
    Cycle,
}

impl flow::Step for Step {
    const TABLE: &'static [Rule] = &[
        Rule { after: &[Self::Beat as usize], time: Some(SLOT_US) },
        Rule { after: &[Self::Slot as usize, Self::Cycle as usize], time: Some(1_000 * BEAT_MS - SLOT_US) },
        Rule { after: &[Self::Beat as usize], time: None },
    ];
    /// How early a step may begin, µs. The timer of the beats and the µs counter have one clock, and each may be up to
    /// 1 µs behind.
    const EARLY: u32 = 2;
    /// How late a step may begin, µs. No other interrupt has the priority of the timer's, and no lock masks it.
    const LATE: u32 = 20;

    #[inline(always)]
    fn index(self) -> usize {
        self as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slot_beat_and_cycle_follow_one_another_every_25_ms() {
        let flow = flow::Flow::new();
        for slot in [500, 25_500, 50_500] {
            assert!(flow.begin(Step::Slot, || slot), "slot {slot}");
            assert!(flow.begin(Step::Beat, || slot + 24_500), "beat after slot {slot}");
            assert!(flow.begin(Step::Cycle, || slot + 24_501), "cycle after slot {slot}");
        }
        assert!(!flow.begin(Step::Cycle, || 75_002), "a second time");
    }
}
