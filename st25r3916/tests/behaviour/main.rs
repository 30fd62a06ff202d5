//! Tests the behaviour of both machines against a small stand-in for the chip.

mod blocking;
mod capture;
mod listener;
mod poller;
mod properties;
mod stand_in;
