//! The tests of the STM32F429 in one binary.

mod anything;
mod board;
mod rig;
mod timer_output;
mod wrongly;
