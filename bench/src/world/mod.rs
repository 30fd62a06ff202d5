//! The world around the two boards: the aircraft's flight controller, which reads the DPR over the SSI, and the base
//! station, to which the flight controller forwards what it read.
//!
//! Neither of the two runs firmware of this project, so neither is emulated. They are state machines in virtual time
//! that use the wire format through the crate `profile`, and are independent of the boards' design. The flight
//! controller reads and writes over the SSI; the base station only receives. Both check what they receive for freshness
//! and damage, as the real ones do.
//!
//! | file | what |
//! |---|---|
//! | [`ssi`] | the SSI's pins, and the state machine that carries a transaction on them |
//! | [`flight_controller`] | the instants of transactions, their requests, and the evaluation of their contents |
//! | [`base_station`] | the end of the radio link; the crate of that name decides what is shown |
//! | [`hold`] | what the active hold measures and acts on: climate, vibration, sensors |

pub mod base_station;
pub mod flight_controller;
pub mod hold;
pub mod ssi;

pub use base_station::BaseStation;
pub use flight_controller::FlightController;
