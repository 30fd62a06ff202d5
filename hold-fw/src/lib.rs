//! The firmware of the active hold: a payload unit that keeps a climate and watches vibration.
//!
//! # Design
//!
//! This library has all the firmware's logic; it needs no MCU, and the host tests it. The binary beside it is an RTIC
//! table of tasks, and only the binary's module `hw` accesses registers. The modules of the library:
//!
//! | module | what it does | where it runs |
//! |---|---|---|
//! | [`timing`] | the times of a cycle | |
//! | [`exchange`] | sends one frame in each cycle and takes the answer | RFID interrupts |
//! | [`state`] | Hold-Status, commands | cycle, answer |
//! | [`climate`] | the control of the temperature, with its limits | cycle |
//! | [`kept`] | what a reset leaves: lock, set-point, acknowledgements | answer, start |
//! | [`sensors`] | temperature, humidity, vibration, shocks | sensors |
//! | [`integrity`] | what follows from a change of memory | idle |
//! | [`protection`] | the regions that the memory protection unit opens | start |
//! | [`task`] | the tasks that have to check in, so that the watchdog may be fed | every task |
//! | [`telemetry`] | the counters that a debugger, or the bench, reads from RAM | every task |
//!
//! Nobody relies on the hold for safety (docs/design.md#active-hold). It is built like the other two firmwares all the
//! same, since it heats.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod climate;
pub mod exchange;
pub mod integrity;
pub mod kept;
pub mod protection;
pub mod sensors;
pub mod state;
pub mod task;
pub mod telemetry;
pub mod timing;
