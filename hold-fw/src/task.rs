//! The firmware's tasks. All of them must check in before the watchdog is fed ([`firmware_common::check_in`]).
//!
//! Each beat of the timer (every 25 ms) calls every task, and a task without work checks in as well. So no task depends
//! on an event from outside.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);
