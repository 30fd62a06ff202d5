//! Simulated delivery flights and u-blox receivers that observe them.
//!
//! HORUS takes its positions from u-blox receivers over a UART, I2C or SPI. On the bench those are byte sources: each
//! yields bursts of bytes, ordered in time. Two kinds exist, and the firmware cannot distinguish them as long as it
//! does not configure them:
//!
//! - [`Receiver::generated`]: a receiver that observes a [`Flight`], with its own navigation rate, noise, solution
//!   delay and clock, encoded as UBX ([`ubx`]); it accepts and acknowledges its configuration ([`config`]);
//! - [`Receiver::recorded`]: a [`Log`] that a real receiver sent, byte for byte, with whatever NMEA, RTCM and
//!   damaged messages it holds, at the pace of its own epochs. It answers nothing.
//!
//! # Design
//!
//! Everything is a pure function of its arguments. A [`Flight`] can be queried at any instant in any order; a receiver
//! draws its noise from a ChaCha stream keyed by seed and receiver number, so that it does not depend on the number of
//! receivers. Transcendental functions come from `libm`, not from the host's C library: the same seed gives the same
//! bytes on every host.
//!
//! Time is bench time, nanoseconds from the moment both boards leave reset. This crate decides when a burst starts; the
//! bench's UART model, or the reader of a bus, times the bytes within it.
#![forbid(unsafe_code)]

pub mod config;
pub mod flight;
pub mod geodesy;
pub mod log;
mod nmea;
pub mod receiver;
pub mod ubx;

pub use config::{Output, Port};
pub use flight::{Flight, State};
pub use geodesy::{Geodetic, TangentPlane};
pub use log::{Log, LogCounts, LogError, RecordedPosition};
pub use receiver::{Burst, Model, Receiver};
