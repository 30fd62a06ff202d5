//! The firmware's tasks, and which of them have to check in before the watchdog is fed
//! ([`firmware_common::check_in`]).
//!
//! Every task has to check in. No task needs an event from outside for that: each beat of the cycle timer calls all of
//! them, and each looks for work and checks in even if there is none.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);
