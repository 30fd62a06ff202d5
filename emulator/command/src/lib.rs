//! Runs firmware for an nRF52840 or an STM32F429ZI on an emulated part: what the command `emulator` does, for commands
//! of others.
//!
//! [`run`] runs an ELF file as [`Options`] say. The command's README has an example and the lines of a script.
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
