//! The tests of HORUS in one binary: each file is a module of it.

mod cycle;
mod receiver;
mod transmitter;
mod ubx;
mod voted;
