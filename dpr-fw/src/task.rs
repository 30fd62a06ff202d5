//! The tasks that have to check in before the watchdog is fed ([`firmware_common::check_in`]).
//!
//! None of them needs the outside world for that: the deadline comes round every 12.5 ms without any frame, the commit
//! tasks call the scrub, and the scrub pends the RFID and SSI tasks, which check in although they have nothing to do.

/// A task that has to check in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The SSI's interrupt.
    Ssi,
    /// The RFID interrupts.
    Rf,
    /// Commit, called by a frame or by the deadline.
    Commit,
    /// Scrub.
    Scrub,
}

impl firmware_common::check_in::Task for Task {
    const COUNT: u32 = 4;

    fn number(self) -> u32 {
        self as u32
    }
}

#[cfg(test)]
mod tests {
    use super::Task;
    use firmware_common::check_in::CheckIn;

    #[test]
    fn each_of_the_four_tasks_is_waited_for() {
        let tasks = [Task::Ssi, Task::Rf, Task::Commit, Task::Scrub];
        for missing in tasks {
            let list = CheckIn::new();
            tasks.into_iter().filter(|&task| task != missing).for_each(|task| list.check_in(task));
            assert!(!list.complete(), "without {missing:?}");
            list.check_in(missing);
            assert!(list.complete());
        }
    }
}
