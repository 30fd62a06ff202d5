//! A behavioural model of the ST25R3916 and ST25R3916B: SPI bytes in and out, the IRQ pin's level, the air, virtual time.
#![forbid(unsafe_code)]

mod air;
mod chip;
mod config;
mod report;

pub use air::{Air, AirEvent, Chunk, Counters, Faults, FrameStart, LastFrame, Technology};
pub use chip::Chip;
pub use config::{Config, Variant};
pub use report::{Kind, Report};
