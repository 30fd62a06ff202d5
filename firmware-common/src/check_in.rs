//! Which tasks have checked in, so that the watchdog may be fed.
//!
//! A board's one watchdog is fed from its idle loop, which runs only when nothing else wants to, and only when every
//! task has checked in since it was last fed. So a task that hangs, a task that starves those below it and an interrupt
//! that never comes all end in the same reset. No task may need the outside world in order to check in; each firmware
//! says at its list of tasks what makes them run.

use core::{
    marker::PhantomData,
    sync::atomic::{AtomicBool, Ordering},
};

/// The place of the task called `name` in a table of names and vectors.
///
/// # Panics
///
/// If there is none: as a constant it does not compile then.
#[must_use]
pub const fn place_of(name: &str, table: &[(&str, &str)]) -> u32 {
    const fn is_same(one: &[u8], other: &[u8]) -> bool {
        let mut nth = 0;
        while nth < one.len() && nth < other.len() && one[nth] == other[nth] {
            nth += 1;
        }
        nth == one.len() && nth == other.len()
    }
    let mut place = 0;
    while place < table.len() {
        if is_same(table[place].0.as_bytes(), name.as_bytes()) {
            return place as u32;
        }
        place += 1;
    }
    panic!("no task of this name")
}

/// The tasks of a firmware that have to check in.
pub trait Task: Copy {
    /// How many there are, at most 32.
    const COUNT: u32;

    /// The number of this one, below [`Task::COUNT`].
    fn number(self) -> u32;
}

/// The most tasks that a firmware can have.
const MOST: usize = 32;

/// Which tasks `T` have checked in.
#[derive(Debug)]
pub struct CheckIn<T> {
    seen: [AtomicBool; MOST],
    tasks: PhantomData<fn(T)>,
}

impl<T: Task> Default for CheckIn<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Task> CheckIn<T> {
    /// No task has checked in.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(T::COUNT >= 1 && T::COUNT as usize <= MOST) }
        Self { seen: [const { AtomicBool::new(false) }; MOST], tasks: PhantomData }
    }

    /// Notes that `task` is alive. May be called from any priority.
    pub fn check_in(&self, task: T) {
        // One store: a bit of a word that all tasks share takes four times as long, on the way of each frame.
        if let Some(own) = self.seen.get(task.number() as usize) {
            own.store(true, Ordering::Relaxed);
        }
    }

    /// Whether `task` has checked in since [`complete`](Self::complete) last answered yes.
    #[must_use]
    pub fn has_checked_in(&self, task: T) -> bool {
        self.seen.get(task.number() as usize).is_some_and(|own| own.load(Ordering::Relaxed))
    }

    /// Whether every task has checked in since this last answered yes. If so, all have to check in anew.
    pub fn complete(&self) -> bool {
        let tasks = self.seen.iter().take(T::COUNT as usize);
        let all = tasks.clone().all(|seen| seen.load(Ordering::Relaxed));
        if all {
            tasks.for_each(|seen| seen.store(false, Ordering::Relaxed));
        }
        all
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
                assert!(!list.has_checked_in(task));
                list.check_in(task);
                list.check_in(task);
                assert!(list.has_checked_in(task));
            }
            assert!(!list.complete(), "without {missing:?}");
            list.check_in(missing);
            assert!(list.complete());
            assert!(!list.complete(), "after one time all must check in anew");
        }
    }

    #[test]
    fn a_task_is_found_by_its_whole_name() {
        let table = [("rf", "A"), ("rf_slot", "B"), ("slot", "C")];
        assert_eq!(["rf", "rf_slot", "slot"].map(|name| place_of(name, &table)), [0, 1, 2]);
    }

    #[test]
    #[should_panic(expected = "no task of this name")]
    fn a_name_that_no_task_has_is_refused() {
        let _ = place_of("rf_", &[("rf", "A"), ("rf_slot", "B")]);
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
