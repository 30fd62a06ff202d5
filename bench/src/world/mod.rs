//! The world around the two boards: the aircraft's flight controller, which reads the DPR over SSI, and the base
//! station, which it forwards to.
//!
//! Neither runs our firmware, so neither is emulated: they are state machines in virtual time that know the wire
//! format, through `profile`, and nothing of how the boards are made. The flight controller is a source of SPI activity
//! and a sink of what comes back; the base station is a sink of bytes. Both verify what they receive, as the real ones
//! do: what is fresh and what is damaged.
//!
//! | file | what |
//! |---|---|
//! | [`ssi`] | the SSI's pins, and the state machine that carries a transaction on them |
//! | [`flight_controller`] | when transactions begin, what they ask for, what is made of what they bring |
//! | [`base_station`] | the end of the radio link; what is shown of what arrives is for the crate of that name to say |

pub mod base_station;
pub mod flight_controller;
pub mod ssi;

pub use base_station::BaseStation;
pub use flight_controller::FlightController;
