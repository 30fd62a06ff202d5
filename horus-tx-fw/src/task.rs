//! The firmware's tasks, and those of them that have to check in before the watchdog is fed.
//!
//! What makes each of them run is the cycle timer alone, so that neither a missing receiver nor a missing front end
//! keeps a task from checking in: the timer's interrupt calls `cycle` at every tick and `rf_slot` after every slot, and
//! after the first slot of a cycle `rf_slot` calls `vote`, and `gnss_tick`, which serves every receiver's source and
//! calls `parse`.

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

/// A task that has to check in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// The 10 ms cycle has filled and offered a profile.
    Cycle,
    /// The vote for the next tick has taken place.
    Vote,
    /// The front end's executor has been told of a slot.
    Rf,
    /// The parser of the receivers' bytes has been through all of them.
    Gnss,
}

impl check_in::Task for Task {
    const COUNT: u32 = 4;

    fn number(self) -> u32 {
        self as u32
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use firmware_common::check_in::CheckIn;

    #[test]
    fn one_missing_task_keeps_the_watchdog_unfed() {
        let tasks = [Task::Cycle, Task::Vote, Task::Rf, Task::Gnss];
        for missing in tasks {
            let list = CheckIn::new();
            tasks.into_iter().filter(|&task| task != missing).for_each(|task| list.check_in(task));
            assert!(!list.complete(), "without {missing:?}");
            list.check_in(missing);
            assert!(list.complete());
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
