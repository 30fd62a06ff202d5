//! The base station: judges the objects that HORUS sealed, keeps them, and shows them to people.
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
#![forbid(unsafe_code)]

pub mod carrier;
#[cfg(feature = "recorder")]
pub mod export;
#[cfg(feature = "mavlink")]
pub mod intake;
#[cfg(feature = "command")]
pub mod live;
#[cfg(feature = "recorder")]
pub mod recorder;
pub mod recording;
#[cfg(feature = "station")]
pub mod station;

pub use base_station_core::{
    Alarm, Bundle, Change, Drone, DroneId, Fleet, Intact, Place, Raised, Severity, Source, Verdict, Who, age, alarm,
    bundle, drone, fleet, place,
};
