//! Simulated delivery flights and u-blox receivers that observe them.
//!
//! HORUS takes its positions from u-blox receivers over a UART, I2C or SPI. On the bench these receivers are sources of
//! bytes: each gives bursts of bytes, ordered in time. There are two kinds, which the firmware cannot distinguish as
//! long as it does not configure them:
//!
//! - [`Receiver::generated`]: a receiver that observes a [`Flight`], with its own navigation rate, noise, solution
//!   delay and clock, encoded as UBX ([`ubx`]); it accepts and acknowledges its configuration ([`config`]);
//! - [`Receiver::recorded`]: a [`Log`] that a real receiver sent, byte for byte, with whatever NMEA, RTCM and
//!   damaged messages it holds, at the pace of its own epochs. It answers nothing.
//!
//! # Design
//!
//! Everything is a pure function of its arguments. A [`Flight`] can be queried at any instant and in any order. A
//! receiver draws its noise from a ChaCha stream keyed by seed and receiver number, so its noise does not depend on the
//! number of receivers. Transcendental functions come from `libm` and not from the host's C library, so the same seed
//! gives the same bytes on every host.
//!
//! Time is the bench's time, nanoseconds since both boards left reset. This crate determines when a burst starts; the
//! bench's UART model, or the reader of a bus, determines the instants of the bytes within it.
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
