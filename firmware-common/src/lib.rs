//! What the firmwares of both boards have alike, so that it exists once and means the same on both.
//!
//! | module | what it does |
//! |---|---|
//! | [`check_in`] | which tasks have checked in since the watchdog was last fed |
//! | [`counter`] | the counters of which each firmware's telemetry is made |
//! | [`image`] | whether the program in flash has the CRC that the build gave it |
//! | [`log_section`] | lets the idle loop write to the log without masking interrupts |
//! | [`safe_state`] | what a panic or a fault does: enter the board's safe state, log once, wait for the watchdog |
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

pub mod check_in;
pub mod counter;
pub mod image;
pub mod log_section;
pub mod safe_state;
