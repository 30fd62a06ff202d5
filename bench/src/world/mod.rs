//! The world around the two boards: the aircraft's flight controller, which reads the DPR over SSI, and the base
//! station, which it forwards to.
//!
//! Neither runs our firmware, so neither is emulated: they are state machines in virtual time that know the wire
//! format, through `profile`, and nothing of how the boards are made. The flight controller is a source of SPI activity
//! and a sink of what comes back; the base station is a sink of bytes. Both judge what they see: what is fresh, what is
//! damaged, and whether an image was torn.

pub mod base_station;
pub mod flight_controller;
pub mod framing;

pub use base_station::BaseStation;
pub use flight_controller::FlightController;
