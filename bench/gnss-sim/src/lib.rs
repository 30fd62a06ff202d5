//! Simulated delivery flights and u-blox receivers that observe them.
//!
//! Each simulated receiver is a source of bytes in bursts, ordered in time. There are two kinds:
//!
//! - [`Receiver::generated`] observes a [`Flight`] with its own navigation rate, noise, solution delay and clock, and
//!   sends UBX ([`ubx`]). It accepts and acknowledges its configuration ([`config`]).
//! - [`Receiver::recorded`] plays a [`Log`] that a real receiver sent, byte for byte, at the pace of its epochs. It
//!   answers nothing.
//!
//! # Design
//!
//! Everything is a pure function of its arguments. A receiver draws its noise from a ChaCha stream keyed by seed and
//! receiver number, so its noise does not depend on the number of receivers. Transcendental functions come from `libm`,
//! so the same seed gives the same bytes on every host.
//!
//! Times are nanoseconds since both boards left reset. This crate determines when a burst starts; the bench determines
//! the instants of the bytes within it.
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
