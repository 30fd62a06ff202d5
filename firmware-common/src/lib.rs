//! The code that both boards' firmwares share.
//!
//! | module | what it does |
//! |---|---|
//! | [`check_in`] | which tasks have checked in since the watchdog was last fed |
//! | [`counter`] | the counters of which each firmware's telemetry is made |
//! | [`program`] | whether the program in flash has the CRC that the build gave it |
//! | [`last_stop`] | why the firmware last stopped itself, kept over the restart |
//! | [`log_section`] | lets the idle loop write to the log without masking interrupts |
//! | `memory` | words of flash and RAM by the linker's symbols (target only) |
//! | [`mpu`] | tables of the memory protection unit |
//! | [`nrf52840`] | what the firmwares for that part share: debug port, crystal, reset reason, supply |
//! | [`patrol`] | integrity of flash, code in RAM, guard words and RAM in use, round the clock |
//! | [`safe_state`] | the reaction to a panic or a fault: the board's safe state, one log message, the watchdog |
//! | [`start`] | the first instructions: reset flags, watchdog, and the code that runs from RAM |
//! | [`start_test`] | the test of the RAM before anything is stored in it |
//! | `task_table` | the table of tasks, from the attributes in `main.rs` |
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

pub mod check_in;
pub mod counter;
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
