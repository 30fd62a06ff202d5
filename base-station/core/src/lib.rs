//! What a base station does with a drone's objects before it shows them: it judges and keeps them.
//!
//! This is a crate of its own because the bench needs nothing else of the base station. The crate `base-station` gives
//! all of it under its own name, and its page has the rules.
#![forbid(unsafe_code)]

pub mod age;
pub mod alarm;
pub mod bundle;
pub mod carrier;
pub mod drone;
pub mod fleet;
pub mod place;

pub use alarm::{Alarm, Change, Raised, Severity};
pub use bundle::Bundle;
pub use drone::{Drone, Verdict};
pub use fleet::{DroneId, Fleet, Source, Who};
pub use place::{Intact, Place};
