//! The tests of the judge in one binary: each file is a module of it.

mod base;
mod common;
mod fresh;
mod hang;
mod image;
mod injected;
mod latency;
mod log;
mod read;
mod ssi;
