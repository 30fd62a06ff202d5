//! The base station: judges the objects that HORUS sealed, keeps them, and shows them to people.
//!
//! # Design
//!
//! **One judge.** Only [`Drone::take`] judges arriving bytes, object by object. [`profile`] determines whether an
//! object is intact, and the timestamp whether it is newer than the displayed one. The carrier is not trusted (black
//! channel).
//!
//! **Delivery cannot make old data new.** An object is shown only if it is newer than the displayed one of its kind, so
//! loss, duplicates and reordering have no effect. A HORUS that has restarted counts from 0 again, and is accepted
//! after three cycles in a row ([`drone`]).
//!
//! **Age first.** No data are shown without their present age ([`age`]). A position that is 0.4 s old is marked as
//! stale.
//!
//! **There is neither clock nor I/O** outside `live`. Time is an argument, in µs of the caller's clock, which must not
//! go back. So the same code runs on the bench in virtual time.
//!
//! | module | what |
//! |---|---|
//! | [`place`] | the kinds of objects, and the check whether bytes are an intact one |
//! | [`bundle`] | several objects in one message |
//! | [`drone`] | the state of one drone |
//! | [`age`] | the age of data whose delay was not measured |
//! | [`alarm`] | the alarms for the user |
//! | [`fleet`] | all drones |
//! | [`carrier`] | the carriers that bring objects |
//! | `intake` | from a carrier's bytes to the state of all drones |
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
