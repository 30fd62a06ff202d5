//! The carriers that bring objects. Each module packs and unpacks objects for one carrier.
//!
//! A carrier is not trusted: it brings a [`Bundle`](crate::Bundle) of bytes, which [`Drone::take`](crate::Drone::take)
//! judges.
//!
//! | carrier | how objects travel |
//! |---|---|
//! | datagrams | a profile, an image or a map as it is ([`Bundle::all`](crate::Bundle::all)) |
//! | MAVLink 2 | in TUNNEL messages (`mavlink`, decision 17) |
//! | a byte stream | a profile, an image or a map as it is, in frames that end with a zero byte ([`stream`]) |
//! | a broker | in messages that another base station publishes ([`published`], decision 19) |

#[cfg(feature = "mavlink")]
pub mod mavlink;

pub use base_station_core::carrier::{published, stream};
