//! The tasks that have to check in before the watchdog is fed.
//!
//! What makes each of them run is the cycle timer alone, so that neither a missing receiver nor a missing front end
//! keeps a task from checking in: the timer's interrupt calls `rf_slot` after every slot and `cycle` at every tick, and
//! `cycle` calls every receiver's line, each of which calls `parse`.

use firmware_common::check_in;

/// A task that has to check in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The 10 ms cycle has filled and offered a profile.
    Cycle,
    /// The front end's executor has been told of a slot.
    Rf,
    /// The parser of the receivers' bytes has been through all of them.
    Gnss,
}

impl check_in::Task for Task {
    const COUNT: u32 = 3;

    fn number(self) -> u32 {
        self as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::check_in::CheckIn;

    #[test]
    fn one_missing_task_keeps_the_watchdog_unfed() {
        let tasks = [Task::Cycle, Task::Rf, Task::Gnss];
        for missing in tasks {
            let list = CheckIn::new();
            tasks.into_iter().filter(|&task| task != missing).for_each(|task| list.check_in(task));
            assert!(!list.complete(), "without {missing:?}");
            list.check_in(missing);
            assert!(list.complete());
        }
    }
}
