//! The firmware's tasks, and which of them have to check in before the watchdog is fed
//! ([`firmware_common::check_in`]).
//!
//! Every task has to check in. No task needs an event from outside for that: the deadline passes every 12.5 ms without
//! any frame, its task and `commit` call the scrub, and the scrub calls all others. Each task that is called so looks
//! for work, and checks in even if there is none.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);

/// The tasks of the second port, which exist with the feature `hold`; then they are also the last of [`TASKS`].
pub mod hold {
    include!(concat!(env!("OUT_DIR"), "/each_hold_task.rs"));

    macro_rules! names {
        ($($name:ident $vector:ident)*) => {
            /// Their names with their interrupt vectors.
            pub const TASKS: &[(&str, &str)] = &[$((stringify!($name), stringify!($vector))),*];
        };
    }

    each_hold_task!(names);
}
