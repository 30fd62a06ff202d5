//! Runs both firmwares' programs on an emulated pair of microcontrollers, with the air between them.
//!
//! [`emulator_node`] runs the ELF files in virtual time. [`boards`] has the circuits around the microcontrollers,
//! [`payload`] what an active hold measures and heats, [`world`] the other surroundings, [`faults`] the injected
//! faults. [`sim`] puts all of these together and writes one event log, which `bench-judge` judges. [`report`] has a
//! run's figures, [`plot`] its flight as a picture, and [`trace`] its wires. [`campaign`] tries faults on copies of a
//! bench, each alone. [`gdb`] lets a debugger attach to the link, and [`desk`] a debug probe to a board.
#![forbid(unsafe_code)]

pub mod boards;
pub mod campaign;
mod danger;
pub mod desk;
pub mod faults;
pub mod gdb;
pub mod payload;
pub mod plot;
pub mod report;
pub mod sim;
pub mod trace;
pub mod world;
