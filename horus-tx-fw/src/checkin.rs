//! Who has to be alive before the watchdog is fed
//!
//! One independent watchdog guards the board (RM0090, "Independent watchdog"). It is fed from the idle
//! loop, and only when every task on the list has checked in since the last feed: a task that hangs, a
//! task that starves the ones below it and an interrupt that never comes all end in the same reset.

use core::sync::atomic::{AtomicU32, Ordering};

/// A task that has to check in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Task {
    /// The 10 ms cycle has filled and offered a profile.
    Cycle = 1,
    /// The radio's executor has been told of a slot.
    Rf = 2,
    /// The parser of the receivers' bytes has been through all of them.
    Gnss = 4,
}

const ALL: u32 = Task::Cycle as u32 | Task::Rf as u32 | Task::Gnss as u32;

/// The list.
#[derive(Debug, Default)]
pub struct CheckIn(AtomicU32);

impl CheckIn {
    /// Nobody has checked in.
    #[must_use]
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// `task` is alive.
    pub fn here(&self, task: Task) {
        self.0.fetch_or(task as u32, Ordering::Relaxed);
    }

    /// Whether everyone has checked in since this last said so.
    pub fn complete(&self) -> bool {
        self.0.compare_exchange(ALL, 0, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_missing_task_keeps_the_watchdog_unfed() {
        for missing in [Task::Cycle, Task::Rf, Task::Gnss] {
            let list = CheckIn::new();
            for task in [Task::Cycle, Task::Rf, Task::Gnss] {
                if task != missing {
                    list.here(task);
                    list.here(task);
                }
            }
            assert!(!list.complete());
            list.here(missing);
            assert!(list.complete());
            assert!(!list.complete(), "each feed asks everyone again");
        }
    }
}
