//! The firmware's tasks. All of them must check in before the watchdog is fed ([`firmware_common::check_in`]).
//!
//! No task depends on an event from outside for its check-in. The deadline passes every 12.5 ms without any frame; its
//! task and `commit` call the scrub task, which calls all others. A task without work checks in as well.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);

/// The tasks of the second port (feature `hold`). With that feature, [`TASKS`] ends with them.
pub mod hold {
    include!(concat!(env!("OUT_DIR"), "/each_hold_task.rs"));

    macro_rules! names {
        ($($name:ident $vector:ident)*) => {
            /// The names of the second port's tasks with their interrupt vectors.
            pub const TASKS: &[(&str, &str)] = &[$((stringify!($name), stringify!($vector))),*];
        };
    }

    each_hold_task!(names);
}

impl Task {
    /// Whether only another task, or the task's own timer, calls this task. If such a task runs without a call, the DPR
    /// stops ([`firmware_common::calls`]). Every other task asks its hardware or its queue for work, and does nothing
    /// if there is none. How often such a task runs depends on who sends frames or reads the DPR, so it must not make
    /// the DPR stop.
    #[must_use]
    pub const fn is_step(self) -> bool {
        matches!(self, Self::deadline | Self::scrub | Self::port)
    }
}
