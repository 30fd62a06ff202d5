//! The tests of the STM32F429 in one binary: each file is a module of it.

mod anything;
mod board;
mod rig;
mod timer_output;
mod wrongly;
