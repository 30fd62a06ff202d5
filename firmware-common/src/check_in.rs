//! Which tasks have checked in, so that the watchdog may be fed.
//!
//! A board's one watchdog is fed from its idle loop, which runs only when nothing else wants to, and only when every
//! task has checked in since it was last fed. So a task that hangs, a task that starves those below it and an interrupt
//! that never comes all end in the same reset. No task may need the outside world in order to check in; each firmware
//! says at its list of tasks what makes them run.

use core::{
    marker::PhantomData,
    sync::atomic::{AtomicU32, Ordering},
};

/// The tasks of a firmware that have to check in.
pub trait Task: Copy {
    /// How many there are, at most 32.
    const COUNT: u32;

    /// The number of this one, below [`Task::COUNT`].
    fn number(self) -> u32;
}

/// Which tasks `T` have checked in.
#[derive(Debug)]
pub struct CheckIn<T> {
    seen: AtomicU32,
    tasks: PhantomData<fn(T)>,
}

impl<T: Task> Default for CheckIn<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Task> CheckIn<T> {
    /// A bit for each task.
    const ALL: u32 = {
        assert!(T::COUNT >= 1 && T::COUNT <= 32);
        u32::MAX >> (32 - T::COUNT)
    };

    /// No task has checked in.
    #[must_use]
    pub const fn new() -> Self {
        Self { seen: AtomicU32::new(0), tasks: PhantomData }
    }

    /// Notes that `task` is alive. May be called from any priority.
    pub fn check_in(&self, task: T) {
        self.seen.fetch_or(1 << task.number(), Ordering::Relaxed);
    }

    /// Whether every task has checked in since this last answered yes. If so, all have to check in anew.
    pub fn complete(&self) -> bool {
        self.seen.compare_exchange(Self::ALL, 0, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Three {
        First,
        Second,
        Third,
    }

    impl Task for Three {
        const COUNT: u32 = 3;
        fn number(self) -> u32 {
            self as u32
        }
    }

    #[test]
    fn the_watchdog_may_be_fed_only_when_every_task_has_checked_in_since_the_last_time() {
        let tasks = [Three::First, Three::Second, Three::Third];
        for missing in tasks {
            let list = CheckIn::new();
            for task in tasks.into_iter().filter(|&task| task != missing) {
                list.check_in(task);
                list.check_in(task);
            }
            assert!(!list.complete(), "without {missing:?}");
            list.check_in(missing);
            assert!(list.complete());
            assert!(!list.complete(), "after one time all must check in anew");
        }
    }

    #[derive(Clone, Copy)]
    struct Many(u32);

    impl Task for Many {
        const COUNT: u32 = 32;
        fn number(self) -> u32 {
            self.0
        }
    }

    #[test]
    fn thirty_two_tasks_are_told_apart() {
        let list = CheckIn::new();
        (0..31).map(Many).for_each(|task| list.check_in(task));
        assert!(!list.complete());
        list.check_in(Many(31));
        assert!(list.complete());
    }
}
