//! The firmware's tasks, and which of them have to check in before the watchdog is fed
//! ([`firmware_common::check_in`]).
//!
//! Every task has to check in. None of them needs the outside world for that: the deadline passes every 12.5 ms without
//! any frame, its task and `commit` call the scrub, and the scrub calls all others for a sign of life. Each of these
//! looks for work, and checks in although there is none.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);
