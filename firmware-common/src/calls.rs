//! Checks that a task runs only after another one has called it.
//!
//! # Design
//!
//! A board whose work comes from outside has no fixed order of steps ([`flow`](crate::flow)): frames and transactions
//! come when others send them, and none of them may make the board stop. But the tasks that follow from this work run
//! only when a task before them calls for it. Whoever calls such a task leaves a mark, and the task takes the mark when
//! it begins. A task that finds none was not called: its interrupt came from nowhere, or it ran twice for one call.
//!
//! The number of calls does not count: a task that is called twice before it begins has one pending interrupt and one
//! mark, so it runs once. A task may also be called when it has begun and has not yet taken its mark. Its interrupt is
//! then pending again, so the mark stays for the next run.

use core::{
    marker::PhantomData,
    sync::atomic::{AtomicBool, Ordering},
};

use crate::check_in::{Task, MOST};

/// The marks of the calls of tasks of type `T`.
#[derive(Debug)]
pub struct Calls<T> {
    made: [AtomicBool; MOST],
    tasks: PhantomData<fn(T)>,
}

impl<T: Task> Default for Calls<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Task> Calls<T> {
    /// Returns the state in which no task is called.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(T::COUNT as usize <= MOST) }
        Self { made: [const { AtomicBool::new(false) }; MOST], tasks: PhantomData }
    }

    /// Marks that `task` is called; its interrupt becomes pending next. In between, `task` must not begin. So the
    /// callers must have a higher priority than `task`; a caller of a lower priority must be the only caller.
    #[inline(always)]
    pub fn make(&self, task: T) {
        if let Some(made) = self.made.get(task.number() as usize) {
            made.store(true, Ordering::Relaxed);
        }
    }

    /// Takes the mark of `task`, which begins to run. Returns whether there was one. `is_pending` returns whether the
    /// task's interrupt is pending again.
    #[inline(always)]
    #[must_use = "a firmware whose task was not called has to stop"]
    pub fn take(&self, task: T, is_pending: impl FnOnce() -> bool) -> bool {
        let Some(mark) = self.made.get(task.number() as usize) else { return false };
        let made = mark.load(Ordering::Relaxed);
        mark.store(false, Ordering::Relaxed);
        if is_pending() {
            mark.store(true, Ordering::Relaxed);
        }
        made
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Two {
        Scrub,
        Port,
    }

    impl Task for Two {
        const COUNT: u32 = 2;
        fn number(self) -> u32 {
            self as u32
        }
    }

    // Shows SAFE-16.
    #[test]
    fn a_task_finds_one_mark_for_any_number_of_calls() {
        let calls = Calls::new();
        assert!(!calls.take(Two::Scrub, || false));
        calls.make(Two::Scrub);
        calls.make(Two::Scrub);
        assert!(!calls.take(Two::Port, || false), "another task was called");
        assert!(calls.take(Two::Scrub, || false));
        assert!(!calls.take(Two::Scrub, || false));
    }

    #[test]
    fn a_call_while_the_task_begins_marks_its_next_run() {
        // The task is called again before it has read its mark, or after that but before it queries the pending
        // interrupt.
        let calls = Calls::new();
        calls.make(Two::Port);
        calls.make(Two::Port);
        assert!(calls.take(Two::Port, || true));
        assert!(calls.take(Two::Port, || false));
        calls.make(Two::Port);
        let late = || {
            calls.make(Two::Port);
            true
        };
        assert!(calls.take(Two::Port, late));
        assert!(calls.take(Two::Port, || false));
        assert!(!calls.take(Two::Port, || false));
    }
}
