//! Tests of the judge on logs, of runs and made by hand.

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
