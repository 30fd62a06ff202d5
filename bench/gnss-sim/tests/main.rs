//! The tests of the receivers' model in one binary: each file is a module of it.

mod configuration;
mod flight;
mod log;
mod messages;
mod receiver;
