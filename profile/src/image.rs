//! The DPR image: what the flight controller reads.
use core::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::{GpsObject, LinkStatus, Profile, Reading, Rejection, ReportedPosition};

/// Offset of Link-Status.
pub const LINK_STATUS: usize = 0;
/// Offset of Reported-Position.
pub const REPORTED_POSITION: usize = LINK_STATUS + LinkStatus::SIZE;
/// Offset of GPS1; the others follow it.
pub const GPS: usize = REPORTED_POSITION + ReportedPosition::SIZE;

/// Offset of the GPS object of receiver `receiver`, counted from 1.
#[must_use]
pub const fn gps(receiver: usize) -> usize {
    GPS + (receiver - 1) * GpsObject::SIZE
}

/// The image of a DPR for `N` receivers: Link-Status, Reported-Position, GPS1 to GPS`N`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
pub struct Image<const N: usize> {
    link: LinkStatus,
    profile: Profile<N>,
}

impl<const N: usize> Image<N> {
    /// Bytes: 156, 216, 276 or 396.
    pub const LEN: usize = LinkStatus::SIZE + Profile::<N>::SIZE;

    /// An image in which nothing verifies: all zero.
    pub const EMPTY: Self = {
        let () = Self::CHECK;
        bytemuck::zeroed()
    };

    const CHECK: () =
        assert!(size_of::<Self>() == Self::LEN && Self::LEN == GPS + N * GpsObject::SIZE);

    /// Link-Status, verified or not.
    #[must_use]
    pub const fn link(&self) -> &LinkStatus {
        &self.link
    }

    /// Puts Link-Status in its place.
    pub const fn set_link(&mut self, link: LinkStatus) {
        self.link = link;
    }

    /// The profile, verified or not.
    #[must_use]
    pub fn profile(&self) -> &Profile<N> {
        let (_, profile) = self.as_bytes().split_at(REPORTED_POSITION);
        bytemuck::from_bytes(profile)
    }

    /// The bytes of a profile's object number `index`, to deposit it as it is; `None` if there is no such object.
    #[must_use]
    pub fn object_mut(&mut self, index: usize) -> Option<&mut [u8]> {
        self.as_bytes_mut().get_mut(Self::place(index)?)
    }

    /// Where a profile's object number `index` lies in the image; `None` if there is no such object.
    #[must_use]
    pub const fn place(index: usize) -> Option<Range<usize>> {
        match Profile::<N>::place(index) {
            Some(place) => Some(REPORTED_POSITION + place.start..REPORTED_POSITION + place.end),
            None => None,
        }
    }

    /// As on the wire: [`Image::LEN`] bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        let () = Self::CHECK;
        bytemuck::bytes_of(self)
    }

    /// As on the wire: [`Image::LEN`] bytes.
    #[must_use]
    pub fn as_bytes_mut(&mut self) -> &mut [u8] {
        let () = Self::CHECK;
        bytemuck::bytes_of_mut(self)
    }

    /// The objects in `bytes`, each accepted or rejected by itself.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not [`Image::LEN`] bytes.
    pub fn read(bytes: &[u8]) -> Result<ImageReading<'_, N>, Rejection> {
        let () = Self::CHECK;
        let (link, profile) = bytes
            .split_at_checked(LinkStatus::SIZE)
            .ok_or(Rejection::Length)?;
        let profile = Profile::<N>::read(profile)?;
        Ok(ImageReading {
            link: LinkStatus::verify(link),
            profile,
        })
    }
}

/// What an image's bytes turned out to be, object by object.
#[derive(Clone, Copy)]
pub struct ImageReading<'a, const N: usize> {
    /// Link-Status.
    pub link: Result<&'a LinkStatus, Rejection>,
    /// The profile.
    pub profile: Reading<'a, N>,
}
