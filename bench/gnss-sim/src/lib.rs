//! Simulated delivery flights and the u-blox receivers that see them.
//!
//! HORUS takes its positions from u-blox receivers that talk to it over a UART, I2C or SPI. On the bench those are byte
//! sources: each yields, ordered in time, the bursts of bytes that it has to say. Two kinds exist, and the firmware
//! cannot tell them apart as long as it does not configure them:
//!
//! - [`Receiver::generated`]: a receiver that watches a [`Flight`], with a navigation rate, noise, solution delay and
//!   clock of its own, encoded as UBX ([`ubx`]); it takes its configuration and answers it ([`config`]);
//! - [`Receiver::recorded`]: a [`Log`] that a real receiver sent, byte for byte, with whatever NMEA, RTCM and
//!   damaged messages it holds, at the pace of its own epochs. It answers nothing.
//!
//! # Design
//!
//! Everything is a pure function of its arguments. A [`Flight`] answers for any instant in any order; a receiver draws
//! its noise from a ChaCha stream keyed by seed and receiver number, so that one receiver's noise does not depend on
//! how many others there are. Transcendental functions come from `libm`, not from the host's C library: the same
//! seed gives the same bytes on every host.
//!
//! Time is bench time, nanoseconds from the moment both boards leave reset. This crate decides when a burst starts; the
//! bench's UART model times the bytes within it, or whoever reads the receiver over a bus.
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
