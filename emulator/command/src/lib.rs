//! Runs firmware for an nRF52840 or an STM32F429ZI on an emulated microcontroller. The command `emulator` does this,
//! and other programs may offer it in their own commands.
//!
//! [`run`] runs an ELF file as [`Options`] say. The README of the command has an example, and describes the lines of a
//! script.
#![forbid(unsafe_code)]

mod options;
mod output;
mod run;
mod script;
mod session;
mod trace;
mod verdict;

pub use options::Options;
pub use run::run;
pub use session::Session;
