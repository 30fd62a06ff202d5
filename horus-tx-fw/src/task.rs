//! The firmware's tasks, and those of them that have to check in before the watchdog is fed.
//!
//! Every task has to. What makes each of them run is the cycle timer alone, so that neither a missing receiver nor a
//! missing front end keeps a task from checking in: the timer's interrupt calls `cycle` at every tick and `rf_slot`
//! after every slot, and after the first slot of a cycle `rf_slot` calls `vote`, and `gnss_tick`, which serves every
//! receiver's source and calls `parse`. The tasks that hardware alone calls are called by `gnss_tick` as well, once a
//! cycle, for a sign of life ([`calls_for_sign_of_life`]): each of them looks at what is the case, and does nothing if
//! nothing is.

use firmware_common::check_in;

/// Every task of the firmware with its interrupt vector, the most urgent first: what a trace of the bench shows, by
/// name.
pub const TASKS: &[(&str, &str)] = &[
    ("slot", "TIM2"),
    ("rf_spi", "DMA2_STREAM0"),
    ("rf_spi_error", "DMA2_STREAM3"),
    ("rf_irq", "EXTI3"),
    ("rf_timer", "TIM5"),
    ("rf_slot", "CAN1_TX"),
    ("cycle", "CAN1_RX0"),
    ("vote", "CAN2_RX0"),
    ("gnss_tick", "CAN2_TX"),
    ("gnss1", "USART2"),
    ("gnss1_ring", "DMA1_STREAM5"),
    ("gnss2", "I2C2_EV"),
    ("gnss2_error", "I2C2_ER"),
    ("gnss2_read", "DMA1_STREAM2"),
    ("gnss2_step", "TIM4"),
    ("gnss3", "DMA2_STREAM5"),
    ("gnss3_error", "DMA2_STREAM6"),
    ("gnss3_step", "TIM3"),
    ("gnss4", "UART5"),
    ("gnss4_ring", "DMA1_STREAM0"),
    ("gnss5", "UART7"),
    ("gnss5_ring", "DMA1_STREAM3"),
    ("parse", "CAN1_RX1"),
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

/// Whether hardware alone calls the task at this place of [`TASKS`], so that it has to be asked for a sign of life.
#[must_use]
pub const fn calls_for_sign_of_life(place: usize) -> bool {
    const CALLED_BY_TASKS: [u32; 6] = [
        Task::named("slot").0,
        Task::named("rf_slot").0,
        Task::named("cycle").0,
        Task::named("vote").0,
        Task::named("gnss_tick").0,
        Task::named("parse").0,
    ];
    let mut nth = 0;
    while nth < CALLED_BY_TASKS.len() {
        if CALLED_BY_TASKS[nth] as usize == place {
            return false;
        }
        nth += 1;
    }
    true
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use firmware_common::check_in::CheckIn;

    #[test]
    fn one_missing_task_keeps_the_watchdog_unfed() {
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
            let (_, body) = source.split_once(&std::format!("fn {name}(")).expect("the task's function");
            let body = body.split("    #[task(").next().unwrap_or(body);
            let own = std::format!("Task::named(\"{name}\")");
            assert!(body.contains(&own), "{name} does not check in");
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
