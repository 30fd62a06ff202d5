//! What the part does, seen from its registers and its pins.
mod clock;
mod memory;
mod pins;
mod rig;
mod serial;
mod time;
