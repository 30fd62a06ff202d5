//! Records which tasks have checked in, so that the watchdog may be fed.
//!
//! The idle loop feeds the watchdog only when every task has checked in since it was last fed. So a task that hangs, a
//! task that starves those of lower priority, and an interrupt that never comes all end in a reset. No task may need an
//! event from outside the board in order to check in.

use core::{
    marker::PhantomData,
    sync::atomic::{AtomicBool, Ordering},
};

/// The tasks of a firmware that have to check in.
pub trait Task: Copy {
    /// The number of a firmware's tasks, at most 32.
    const COUNT: u32;

    /// Returns the number of this task, below [`Task::COUNT`].
    fn number(self) -> u32;
}

/// Makes `TASKS` and `Task` from the names and vectors of a firmware's tasks.
#[macro_export]
macro_rules! task_table {
    ($($name:ident $vector:ident)*) => {
        /// The name and interrupt vector of every task of the firmware, the most urgent first.
        pub const TASKS: &[(&str, &str)] = &[$((stringify!($name), stringify!($vector))),*];

        /// A task of the firmware, by the name of its function.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[allow(non_camel_case_types)]
        pub enum Task {
            $(#[doc = concat!("Bound to ", stringify!($vector), ".")] $name),*
        }

        impl Task {
            /// All tasks, the most urgent first.
            pub const ALL: [Self; TASKS.len()] = [$(Self::$name),*];
        }

        impl $crate::check_in::Task for Task {
            const COUNT: u32 = TASKS.len() as u32;

            fn number(self) -> u32 {
                self as u32
            }
        }
    };
}

/// Makes `TASK_VECTORS`, `call` and `task_of` in a firmware's binary. `Task`, `TASKS` and `Interrupt` must be in scope.
#[macro_export]
macro_rules! task_vectors {
    ($($name:ident $vector:ident)*) => {
        /// The vectors of the tasks, in the order of [`TASKS`].
        const TASK_VECTORS: [Interrupt; TASKS.len()] = [$(Interrupt::$vector),*];

        /// Calls `task`, which runs as soon as no task of the same or of a higher priority runs.
        #[inline(always)]
        pub(crate) fn call(task: Task) {
            rtic::pend(TASK_VECTORS[task as usize]);
        }

        /// Whether the interrupt of `task` is pending.
        #[allow(dead_code)]
        #[inline(always)]
        pub(crate) fn is_pending(task: Task) -> bool {
            cortex_m::peripheral::NVIC::is_pending(TASK_VECTORS[task as usize])
        }

        /// Returns the name of the task with this exception number: the number of the task's interrupt plus 16 (ARMv7-M
        /// ARM B1.5.2).
        pub(crate) fn task_of(exception: u16) -> &'static str {
            let is_its = |vector: &Interrupt| *vector as u16 + 16 == exception;
            let task = TASK_VECTORS.iter().position(is_its).and_then(|index| TASKS.get(index));
            task.map_or(if exception == 0 { "idle" } else { "none" }, |(name, _)| name)
        }
    };
}

pub(crate) const MOST: usize = 32;

/// The record of which tasks of type `T` have checked in.
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
    /// Returns the state in which no task has checked in.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(T::COUNT >= 1 && T::COUNT as usize <= MOST) }
        Self { seen: [const { AtomicBool::new(false) }; MOST], tasks: PhantomData }
    }

    /// Records that `task` runs. Tasks of any priority may call this.
    pub fn check_in(&self, task: T) {
        // Each task has a byte of its own, which is stored four times as fast as a bit in a shared word. A slower
        // check-in would delay each frame.
        if let Some(own) = self.seen.get(task.number() as usize) {
            own.store(true, Ordering::Relaxed);
        }
    }

    /// Whether `task` has checked in since [`complete`](Self::complete) last returned true.
    #[must_use]
    pub fn has_checked_in(&self, task: T) -> bool {
        self.seen.get(task.number() as usize).is_some_and(|own| own.load(Ordering::Relaxed))
    }

    /// Returns whether every task has checked in since the last call that returned true. If so, all tasks have to check
    /// in anew.
    pub fn complete(&self) -> bool {
        let tasks = self.seen.iter().take(T::COUNT as usize);
        // Not covered: the end of the places before the end of the tasks: each board has fewer tasks than there are
        // places.
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

    // Shows SAFE-2.
    #[test]
    fn the_watchdog_may_be_fed_only_after_every_task_checked_in() {
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

    #[allow(unreachable_pub)]
    mod two {
        crate::task_table! { slot TIM2 slot_irq GPIOTE }
    }

    #[test]
    fn the_table_has_each_task_in_its_place() {
        use two::{Task as Two, TASKS};
        assert_eq!(TASKS, [("slot", "TIM2"), ("slot_irq", "GPIOTE")]);
        assert_eq!(Two::ALL.map(Task::number), [0, 1]);
        assert_eq!((Two::ALL, Two::COUNT), ([Two::slot, Two::slot_irq], 2));
    }
}
