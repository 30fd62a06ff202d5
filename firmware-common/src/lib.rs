//! The code that the boards' firmwares share.
//!
//! | module | content |
//! |---|---|
//! | [`calls`] | the check that a task runs only after another one has called it |
//! | [`check_in`] | the record of the tasks that have checked in since the last feed of the watchdog |
//! | [`checked`] | state with a check word, which finds a flipped bit in what is kept from task to task |
//! | [`counter`] | the counters of the firmwares' telemetry |
//! | [`flow`] | the check that the tasks of a cycle run in their order and none too early |
//! | [`program`] | the check of the program in flash against the CRC from the build |
//! | [`last_stop`] | the reason of the firmware's last stop, which a restart does not erase |
//! | [`log_section`] | lets the idle loop write to the log without masking interrupts |
//! | `memory` | access to words of flash and RAM by the linker's symbols (target only) |
//! | [`mpu`] | tables for the memory protection unit |
//! | [`nrf52840`] | code for both nRF52840 firmwares: debug port, crystal, reset reason, supply |
//! | [`patrol`] | the endless check of flash, code in RAM, guard words and RAM in use |
//! | [`safe_state`] | the reaction to a panic or a fault: the board's safe state, one log message, the watchdog |
//! | [`start`] | the first instructions: reset flags, watchdog, and the code that runs from RAM |
//! | [`start_test`] | the test of the RAM before anything is stored in it |
//! | `task_table` | the table of tasks, from the attributes in `main.rs` |
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

pub mod calls;
pub mod check_in;
pub mod checked;
pub mod counter;
pub mod flow;
pub mod last_stop;
pub mod log_section;
#[cfg(target_os = "none")]
pub mod memory;
pub mod mpu;
pub mod nrf52840;
pub mod patrol;
pub mod program;
pub mod safe_state;
pub mod start;
pub mod start_test;
#[cfg(not(target_os = "none"))]
pub mod task_table;
