//! Who has checked in, so that the watchdog may be fed.
//!
//! The watchdog is fed from idle, which runs only when nothing else wants to, and only when every task has checked in since it was last
//! fed. No task needs the outside world for that: the deadline monitor comes round every 12.5 ms without any frame, commit calls the
//! scrub, and the scrub pends the RFID and SSI tasks, which check in although they have nothing to do.

use core::sync::atomic::{AtomicU32, Ordering};

/// A task that has to check in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// SSI interrupt.
    Ssi,
    /// RFID interrupts, with a front end that answers its transfers in time.
    Rf,
    /// Commit, by a frame or by the deadline.
    Commit,
    /// Scrub.
    Scrub,
}

const ALL: u32 = 0b1111;

/// The list of those who have.
#[derive(Debug, Default)]
pub struct Roll(AtomicU32);

impl Roll {
    /// Nobody yet.
    #[must_use]
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// `task` is alive.
    pub fn check_in(&self, task: Task) {
        self.0.fetch_or(1 << task as u32, Ordering::Relaxed);
    }

    /// Whether all are; if so, the list begins anew.
    pub fn complete(&self) -> bool {
        self.0.compare_exchange(ALL, 0, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_watchdog_is_fed_only_when_every_task_has_checked_in_since() {
        let tasks = [Task::Ssi, Task::Rf, Task::Commit, Task::Scrub];
        for missing in tasks {
            let roll = Roll::new();
            for task in tasks.into_iter().filter(|&task| task != missing) {
                roll.check_in(task);
                roll.check_in(task);
            }
            assert!(!roll.complete(), "without {missing:?}");
            roll.check_in(missing);
            assert!(roll.complete());
            assert!(!roll.complete());
        }
    }
}
