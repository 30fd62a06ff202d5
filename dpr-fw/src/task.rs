//! The firmware's tasks, and those of them that have to check in before the watchdog is fed
//! ([`firmware_common::check_in`]).
//!
//! Every task has to. None of them needs the outside world for that: the deadline comes round every 12.5 ms without any
//! frame, it and `commit` call the scrub, and the scrub calls all others for a sign of life: each looks at what is the
//! case, and checks in although it has nothing to do.

use firmware_common::check_in;

/// Every task of the firmware with its interrupt vector, the most urgent first: what a trace of the bench shows, by
/// name.
pub const TASKS: &[(&str, &str)] = &[
    ("ssi_end", "SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1"),
    ("ssi_pause", "TIMER3"),
    ("rf_spi", "SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0"),
    ("rf_irq", "GPIOTE"),
    ("rf_timer", "TIMER0"),
    ("commit", "SWI0_EGU0"),
    ("deadline", "TIMER1"),
    ("scrub", "SWI1_EGU1"),
    ("port", "SWI2_EGU2"),
];

/// A task that has to check in: its place in [`TASKS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Task(u32);

impl Task {
    /// The task of this name.
    ///
    /// # Panics
    ///
    /// If there is none: as a constant it does not compile then.
    #[must_use]
    pub const fn named(name: &str) -> Self {
        Self(check_in::place_of(name, TASKS))
    }
}

impl check_in::Task for Task {
    const COUNT: u32 = TASKS.len() as u32;

    fn number(self) -> u32 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::check_in::CheckIn;

    #[test]
    fn each_of_the_tasks_is_waited_for() {
        let tasks = || TASKS.iter().map(|(name, _)| Task::named(name));
        for missing in tasks() {
            let list = CheckIn::new();
            tasks().filter(|&task| task != missing).for_each(|task| list.check_in(task));
            assert!(!list.complete(), "without {missing:?}");
            list.check_in(missing);
            assert!(list.complete());
        }
    }

    #[test]
    fn every_task_checks_in_where_the_firmware_binds_it() {
        for (name, _) in TASKS {
            let source = include_str!("main.rs");
            let (_, body) = source.split_once(&format!("fn {name}(")).expect("the task's function");
            let body = body.split("    #[task(").next().unwrap_or(body);
            assert!(body.contains(&format!("Task::named(\"{name}\")")), "{name} does not check in");
        }
    }

    /// `#[task(binds = VECTOR, ..)]` and the name of the function below it, in the order of the source.
    #[test]
    fn the_table_of_tasks_is_the_one_that_the_firmware_binds() {
        let mut bound = Vec::new();
        let mut vector = None;
        for line in include_str!("main.rs").lines().map(str::trim) {
            if let Some(rest) = line.strip_prefix("#[task(binds = ") {
                vector = rest.split([',', ')']).next();
            } else if let Some(vector) = vector.take() {
                let name = line.strip_prefix("fn ").and_then(|rest| rest.split('(').next());
                bound.push((name.expect("a function below its attribute"), vector));
            }
        }
        assert_eq!(bound, TASKS);
    }

    #[test]
    fn the_vectors_by_which_a_stop_is_named_are_those_of_the_table() {
        let source = include_str!("board.rs");
        let (_, list) = source.split_once("const TASK_VECTORS").expect("the list");
        let (list, _) = list.split_once("];").expect("its end");
        let vectors: Vec<&str> = list.split("Interrupt::").skip(1).filter_map(|rest| rest.split(',').next()).collect();
        let bound: Vec<&str> = TASKS.iter().map(|(_, vector)| *vector).collect();
        assert_eq!(vectors, bound);
    }
}
