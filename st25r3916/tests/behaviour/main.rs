//! Tests how the machines behave against a small stand-in for the chip.

mod answerer;
mod blocking;
mod capture;
mod exchange;
mod listener;
mod poller;
mod properties;
mod stand_in;
