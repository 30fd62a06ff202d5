//! Tests of the simulated receivers.

mod configuration;
mod flight;
mod log;
mod messages;
mod receiver;
