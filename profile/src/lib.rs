//! The HORUS profile: packed, CRC-protected objects, their air frames and the DPR image.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::as_conversions, clippy::indexing_slicing)]

pub mod air;
pub mod crc;
mod freshness;
mod identifier;
pub mod image;
mod link_status;
mod object;
mod rejection;
mod set;
pub mod ssi;
mod status;
mod wire;

pub use freshness::{Freshness, freshness};
pub use identifier::Identifier;
pub use link_status::{LinkStatus, LinkValues};
pub use object::{ABSENT_F32, ABSENT_F64, GpsObject, GpsValues, ReportedPosition, ReportedValues};
pub use rejection::Rejection;
pub use set::{MAX_RECEIVERS, Object, Profile, Reading, SIZE_LIMIT};
pub use status::{FixType, GpsStatus, HorusState, LinkStatusBits, ReportedStatus};

/// The HORUS cycle, ms: every timestamp is the one before plus this.
pub const CYCLE_MS: u32 = 10;

#[cfg(test)]
mod smoke {
    use super::*;
    #[test]
    fn check_values_hold() {
        assert_eq!(crc::frame(b"123456789"), crc::FRAME.check);
        assert_eq!(crc::position(b"123456789"), crc::POSITION.check);
    }
    #[test]
    fn a_sealed_profile_verifies() {
        let p = Profile::<3>::seal(&ReportedValues::absent(10), &[GpsValues::absent(10); 3]);
        assert!(p.verify().complete());
        assert!(!Profile::<3>::EMPTY.verify().complete());
    }
}
