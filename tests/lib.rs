//! What both boards' suites share: a cycle counter and the bounds that the profile's code must keep.
//!
//! A suite is one image per board, run by `cargo xtask test` on the bench and, with `--on hardware`, on the board.
//! Bounds are in core cycles, read from DWT CYCCNT, and hold on the bench's fast clock (one cycle for each halfword of
//! code) and on its optimistic one. On a board cycles include flash wait states, which is why the bounds leave room and
//! the *spread* between data is what shows that the work is constant.
#![cfg_attr(target_os = "none", no_std)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
pub mod cycles;
#[cfg(target_os = "none")]
pub mod profile_suite;
