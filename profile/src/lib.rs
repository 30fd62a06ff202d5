//! The HORUS profile: packed, CRC-protected objects, their air frames, and the image that a flight controller reads.
//!
//! HORUS, an independent flight-path monitor of an unmanned aircraft, writes its position and each GNSS receiver's
//! solution into a dual-ported RAM (DPR) by RFID, every [10 ms](CYCLE_MS), and never gets an answer. The flight
//! controller reads that RAM and forwards its contents, unchanged, to a base station. This crate has only the
//! definitions that these four share: no driver, no clock, no memory of its own.
//!
//! # Design
//!
//! **Black channel.** Nothing between sealing and verifying an object is trusted: neither the air, nor the RFID chips,
//! nor the DPR, nor the radio link. An object proves its validity itself, by its CRC, its identifier and its timestamp.
//! So each object is [accepted or rejected](Rejection) separately, and can be stored, forwarded or dropped without the
//! others.
//!
//! **The bytes are the object.** [`GpsObject`], [`ReportedPosition`] and [`LinkStatus`] are arrays of bytes with named
//! fields: they have alignment 1 and no padding, and every bit pattern is allowed. A received buffer is an object
//! without a copy, and the layout is the same on any host. Sizes and offsets are asserted when the crate is compiled.
//!
//! **A reference to an object does not imply its validity; [`verify`](GpsObject::verify) checks it.** Zeros
//! ([`EMPTY`](GpsObject::EMPTY)), a buffer scrubbed to 0x00 or 0xFF, and a bus that reads 0xFF can all be read as
//! objects, and none of them verifies.
//!
//! **The work does not depend on the data.** A function that judges received bytes computes every CRC before it
//! decides; only a wrong length ends it early. No function allocates, blocks or recurses, and all loops are bounded.
//!
//! # Layout
//!
//! All numbers are little-endian, except CRCs, which are stored most significant byte first (see [`crc`]).
//!
//! | bytes | Reported-Position (64) | bytes | GPS1 to GPS5 (60) | bytes | Link-Status (32) |
//! |---|---|---|---|---|---|
//! | 0..4 | u32 timestamp, ms | 0..4 | u32 timestamp, ms | 0..4 | u32 timestamp of the DPR, ms |
//! | 4..6 | u16 identifier | 4..6 | u16 identifier | 4..6 | u16 identifier |
//! | 6..8 | u16 status | 6..8 | u16 status | 6..8 | u16 status |
//! | 8..16 | f64 latitude, ° | 8..16 | f64 latitude, ° | 8..12 | u32 objects accepted |
//! | 16..24 | f64 longitude, ° | 16..24 | f64 longitude, ° | 12..16 | u32 objects rejected |
//! | 24..28 | position CRC over 8..24 | 24..32 | f64 altitude, m | 16..20 | u32 frames received |
//! | 28..36 | f64 altitude, m | 32..44 | f32 pitch, yaw, roll, rad | 20..24 | u32 frames missed |
//! | 36..48 | f32 pitch, yaw, roll, rad | 44..56 | f32 x, y, z acceleration, m/s² | 24..26 | u16 age, 100 µs |
//! | 48..60 | f32 x, y, z acceleration, m/s² | 56..60 | frame CRC over 0..56 | 26..28 | u16 access violations |
//! | 60..64 | frame CRC over 0..60 | | | 28..32 | frame CRC over 0..28 |
//!
//! A [`Profile`] is Reported-Position and 1, 2, 3 or 5 GPS objects, contiguous: 124, 184, 244 or 364 bytes. [`air`]
//! defines which objects travel in one frame, [`image`] their offsets in the DPR, [`ssi`] how a flight controller
//! requests them, [`sequence`] which cycles may be shown.
//!
//! Two kinds of object of 64 bytes follow the image in the [`map`]: [`PortStatus`] and two [`Uplink`]s. A DPR with a
//! [`hold`], the non-critical second function, adds [`HoldStatus`]. A [`CommandObject`] is written and not stored.
//! [`criticality`] defines which role may write which object.
//!
//! The objects are from H. D. Doran et al., *Mixed Criticality Communication within an Unmanned Delivery Rotorcraft*,
//! Tables 2 and 3. The paper's text gives Reported-Position 60 bytes; its Table 2 adds up to 64, as here. This project
//! defines Link-Status, the identifiers, the status bits, the units and the byte order.
//!
//! # Example
//!
//! ```
//! use profile::{FixType, Freshness, GpsStatus, GpsValues, Identifier, Profile, Rejection, ReportedValues, freshness};
//!
//! // HORUS: the solutions of three receivers at 1230 ms. The third has sent none.
//! let status = GpsStatus::new().with_fix_type(FixType::Fix3D).with_position_valid(true).with_heard(true);
//! let first = GpsValues { status, latitude: 47.4979, longitude: 8.7296, altitude: 493.2, ..GpsValues::absent(1230) };
//! let second = GpsValues { latitude: 47.4980, ..first };
//! let reported = ReportedValues { latitude: 47.4979, longitude: 8.7296, ..ReportedValues::absent(1230) };
//! let sent = Profile::<3>::seal(&reported, &[first, second, GpsValues::absent(1230)]);
//!
//! // One bit of GPS2 is damaged on the way: 64 bytes of Reported-Position, 60 of GPS1, and then its 20th.
//! let mut bytes = [0; Profile::<3>::SIZE];
//! bytes.copy_from_slice(sent.as_bytes());
//! bytes[64 + 60 + 20] ^= 0x10;
//!
//! // The base station rejects that object and accepts the others.
//! let read = Profile::<3>::read(&bytes)?;
//! assert_eq!(read.gps[1].err(), Some(Rejection::Crc));
//! assert_eq!(read.gps[0]?.values().altitude, 493.2);
//! let reported = read.reported?;
//! assert_eq!(reported.values().latitude, 47.4979);
//! assert_eq!(freshness(Some(1220), reported.timestamp()), Freshness::Fresh { missed: 0 });
//! # Ok::<(), Rejection>(())
//! ```
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::as_conversions, clippy::indexing_slicing)]

pub mod air;
mod command;
pub mod crc;
pub mod criticality;
mod freshness;
mod gps;
pub mod hold;
mod identifier;
pub mod image;
mod layout;
mod link_status;
pub mod map;
mod object_macro;
pub mod port_status;
mod profile;
pub mod range;
mod rejection;
mod reported;
pub mod sequence;
pub mod ssi;
mod status;
pub mod uplink;
mod wire;

pub use command::{Command, CommandObject, CommandValues};
pub use freshness::{Freshness, freshness};
pub use gps::{GpsObject, GpsValues};
pub use hold::{HoldCommand, HoldObject, HoldStatus, HoldStatusBits, HoldValues};
pub use identifier::Identifier;
pub use layout::Layout;
pub use link_status::{LinkStatus, LinkValues};
pub use port_status::{PortStatus, PortValues, Violation, Violations};
pub use profile::{MAX_RECEIVERS, MAX_SIZE, Object, Profile, Reading};
pub use rejection::Rejection;
pub use reported::{ReportedPosition, ReportedValues};
pub use status::{FixType, GpsStatus, HorusState, LinkStatusBits, PortStatusBits, ReportedStatus, ResetReason};
pub use uplink::{Uplink, UplinkStatus, UplinkValues};

/// The cycle of HORUS, ms: the step from each timestamp to the next (paper, section 2.2).
pub const CYCLE_MS: u32 = 10;

/// The value of a binary32 that is not known: the canonical quiet NaN, on the wire `00 00 C0 7F`.
pub const ABSENT_F32: f32 = f32::from_bits(0x7FC0_0000);

/// The value of a binary64 that is not known: the canonical quiet NaN, on the wire `00 00 00 00 00 00 F8 7F`.
pub const ABSENT_F64: f64 = f64::from_bits(0x7FF8_0000_0000_0000);

/// Compiles and runs the README's example as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// Compiles and runs the profile of another maker's hold as a test.
#[cfg(doctest)]
#[doc = include_str!("../../docs/profiles.md")]
struct ProfilesGuide;

/// Compiles and runs the Rust code of the flight controller's guide as a test.
#[cfg(all(doctest, feature = "embedded-hal"))]
#[doc = include_str!("../../docs/flight-controller.md")]
struct FlightControllerGuide;
