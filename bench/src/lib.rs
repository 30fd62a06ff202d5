//! Runs both firmwares' programs on an emulated pair of microcontrollers, with the air between them.
//!
//! [`emulator_node`] runs the ELF files in virtual time. [`boards`] has the circuits around the microcontrollers,
//! [`payload`] what an active hold measures and heats, [`world`] the other surroundings, [`faults`] the injected
//! faults. [`sim`] puts all of these together and writes one event log, which `bench-judge` judges. [`report`] has a
//! run's figures, [`plot`] its flight as a picture, and [`trace`] its wires. `gdb` lets a debugger attach to the link,
//! and [`desk`] lets a debug probe attach to a board. [`panel`] lets a user break things.
#![forbid(unsafe_code)]

pub mod boards;
#[cfg(feature = "runs")]
pub mod campaign;
#[cfg(feature = "runs")]
mod danger;
#[cfg(feature = "runs")]
pub mod desk;
pub mod faults;
#[cfg(feature = "gdb")]
pub mod gdb;
pub mod panel;
pub mod payload;
#[cfg(feature = "plot")]
pub mod plot;
pub mod report;
pub mod sim;
pub mod trace;
pub mod world;
