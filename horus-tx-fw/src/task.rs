//! The firmware's tasks, all of which have to check in before the watchdog is fed.
//!
//! The cycle timer alone makes all of them run, so that no missing receiver or front end keeps a task from checking in.
//! Its interrupt calls `cycle` at every tick and `rf_slot` after every slot. After the first slot of a cycle `rf_slot`
//! calls `vote`, and `gnss_tick`, which serves every receiver's source and calls `parse`. `gnss_tick` also calls the
//! tasks that otherwise only hardware calls ([`Task::calls_for_sign_of_life`]).

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);

impl Task {
    /// Whether `gnss_tick` has to call this task so that it checks in, because usually only hardware calls it, and
    /// perhaps rarely.
    #[must_use]
    pub const fn calls_for_sign_of_life(self) -> bool {
        !matches!(self, Self::slot | Self::rf_slot | Self::cycle | Self::vote | Self::gnss_tick | Self::parse)
    }
}
