//! Code that both boards' suites share: a cycle counter, and the bounds that the profile's code must keep.
//!
//! A suite of on-target tests is one program for each board. `cargo xtask test` runs it on the bench and, with `--on
//! hardware`, on the board. It is built for one clock (`cycles::CLOCK`). Bounds are in core cycles, read from DWT
//! CYCCNT, and stated for each of the bench's clocks (table in `docs/timing.md`); on a board those of the pessimistic
//! clock hold. The data may change a time only within a limit, the *spread*, which shows that the work is constant. On
//! a board the limit is greater because of wait states of the flash.
#![cfg_attr(target_os = "none", no_std)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
pub mod chip;
#[cfg(target_os = "none")]
pub mod cycles;
#[cfg(target_os = "none")]
pub mod profile_suite;
