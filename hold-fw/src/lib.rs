//! The firmware of the active hold, a payload unit that controls its temperature and measures vibration.
//!
//! # Design
//!
//! This library has all of the firmware's logic and runs on a host as well, where it is tested. The binary beside it is
//! an RTIC application. Only the binary's module `hw` accesses registers. The table lists the library's modules and the
//! RTIC tasks that use them (*start*: the code before the first task).
//!
//! | module | what it does | used by |
//! |---|---|---|
//! | [`timing`] | the times of a cycle | all tasks |
//! | [`exchange`] | sends one frame in each cycle and takes the answer | RFID interrupts |
//! | [`state`] | Hold-Status, commands | cycle, answer |
//! | [`climate`] | the control of the temperature, with its limits | cycle |
//! | [`kept`] | keeps lock, set-point, acknowledgements over a reset | answer, start |
//! | [`sensors`] | temperature, humidity, vibration, shocks | sensors |
//! | [`supply`] | the supply voltage, with its limits | cycle |
//! | [`integrity`] | the consequence of a memory fault | idle |
//! | [`protection`] | the regions that the memory protection unit opens | start |
//! | [`task`] | the tasks that must check in before the watchdog is fed | every task |
//! | [`telemetry`] | the counters that a debugger or the bench reads from RAM | every task |
//!
//! No safety function relies on the hold (docs/design.md#active-hold). Because it heats, it is built with the same
//! care as the other two firmwares.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod climate;
pub mod exchange;
pub mod integrity;
pub mod kept;
pub mod protection;
pub mod sensors;
pub mod state;
pub mod supply;
pub mod task;
pub mod telemetry;
pub mod timing;
