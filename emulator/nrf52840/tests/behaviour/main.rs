//! Tests of the part's behaviour at its registers and pins.
mod anything;
mod clock;
mod memory;
mod peripherals;
mod pins;
mod rig;
mod spim;
mod spis;
mod time;
mod twis;
mod uarte;
