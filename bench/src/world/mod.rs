//! The world around the two boards: the flight controller, which reads the DPR over the SSI, and the base station, to
//! which the flight controller forwards what it reads.
//!
//! The flight controller and the base station are state machines in virtual time. They are not emulated, because they
//! do not run firmware of this project. They use the wire format through the crate `profile` and check what they
//! receive for freshness and damage, as the real ones do.
//!
//! | file | what |
//! |---|---|
//! | [`ssi`] | the SSI's pins, and the state machine that carries out a transaction |
//! | [`flight_controller`] | the instants of transactions, their requests, and the evaluation of their contents |
//! | [`base_station`] | the end of the radio link; the crate `base-station-core` decides what is shown |

pub mod base_station;
pub mod flight_controller;
pub mod ssi;

pub use base_station::BaseStation;
pub use flight_controller::FlightController;
