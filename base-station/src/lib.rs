//! The base station: where the objects that HORUS sealed are judged for the last time, kept, and shown to people.
//!
//! # Design
//!
//! **One judge.** Whatever brings bytes here, [`Drone::take`] judges them, object by object, and nothing else does. It
//! asks [`profile`] whether an object is intact and in its place, and its timestamp whether it is newer than what is
//! shown. The carrier is not trusted in anything (black channel).
//!
//! **Nothing on the way can make old data new.** Loss, duplicates and reordering change nothing: an object is shown
//! only if it is newer than the one of its kind that is shown. A HORUS that has restarted counts from 0 again, and is
//! believed after three cycles in a row ([`drone`]).
//!
//! **Age first.** A position that is 0.4 s old is stale, and says so. Nothing that arrived is ever shown without how
//! old it is now ([`age`]).
//!
//! **No clock, no I/O**, but in `live`, for the command. Time is an argument, in µs of the caller's clock, which must
//! not go back. So all of it runs on the bench in virtual time as it runs at a base station.
//!
//! | module | what |
//! |---|---|
//! | [`place`] | which object it is, and whether bytes are that object, intact |
//! | [`bundle`] | several objects in one message: which bytes are which |
//! | [`drone`] | what is known of one drone |
//! | [`age`] | how old data are whose way here nobody timed |
//! | [`alarm`] | what a person must be told |
//! | [`fleet`] | all drones |
//! | [`carrier`] | what brings objects here |
//! | `intake` | from what a carrier brought to what is known of all drones |
//! | `recorder` | every byte that a carrier brought, in a file |
//! | `live` | the lines of a real base station, their threads, and the recorder's |
//! | `export` | a recording as CSV, GPX, KML |
#![forbid(unsafe_code)]

pub mod age;
pub mod alarm;
pub mod bundle;
pub mod carrier;
pub mod drone;
#[cfg(feature = "recorder")]
pub mod export;
pub mod fleet;
#[cfg(feature = "mavlink")]
pub mod intake;
#[cfg(feature = "command")]
pub mod live;
pub mod place;
#[cfg(feature = "recorder")]
pub mod recorder;

pub use alarm::{Alarm, Change, Raised, Severity};
pub use bundle::Bundle;
pub use drone::{Drone, Verdict};
pub use fleet::{DroneId, Fleet, Source, Who};
pub use place::{Intact, Place};
