//! The firmware's tasks, and those of them that have to check in before the watchdog is fed.
//!
//! Every task has to. What makes each of them run is the cycle timer alone, so that neither a missing receiver nor a
//! missing front end keeps a task from checking in: the timer's interrupt calls `cycle` at every tick and `rf_slot`
//! after every slot, and after the first slot of a cycle `rf_slot` calls `vote`, and `gnss_tick`, which serves every
//! receiver's source and calls `parse`. The tasks that hardware alone calls are called by `gnss_tick` as well, once a
//! cycle, for a sign of life ([`Task::calls_for_sign_of_life`]): each of them looks at what is the case, and does
//! nothing if nothing is.

include!(concat!(env!("OUT_DIR"), "/each_task.rs"));

each_task!(firmware_common::task_table);

impl Task {
    /// Whether hardware alone calls the task, so that it has to be asked for a sign of life.
    #[must_use]
    pub const fn calls_for_sign_of_life(self) -> bool {
        !matches!(self, Self::slot | Self::rf_slot | Self::cycle | Self::vote | Self::gnss_tick | Self::parse)
    }
}
