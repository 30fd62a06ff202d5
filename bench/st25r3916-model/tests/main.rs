//! Runs all tests of the front end's model in one binary: each file is a module of it.

mod air;
mod air_chips;
mod air_late;
mod answers;
mod captures;
mod common;
mod controller;
mod exchange;
mod link;
mod misuse;
mod settings;
mod timing;
