//! The firmware's tasks, and those of them that have to check in before the watchdog is fed
//! ([`firmware_common::check_in`]).
//!
//! Every task has to. None of them needs the outside world for that: the deadline comes round every 12.5 ms without any
//! frame, it and `commit` call the scrub, and the scrub calls all others for a sign of life: each looks at what is the
//! case, and checks in although it has nothing to do.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);
