//! What the part does, seen from its registers and its pins.
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
