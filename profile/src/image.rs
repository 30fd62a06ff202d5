//! The DPR image, which the flight controller reads.
//!
//! | offset | object | bytes |
//! |---|---|---|
//! | 0 | [Link-Status](LinkStatus) | 32 |
//! | 32 | [Reported-Position](ReportedPosition) | 64 |
//! | 96 | [GPS1](crate::GpsObject) … GPSn | 60 each |
//!
//! The first 96 bytes are all that a flight controller needs to fly by HORUS. From offset 32 on, the image is
//! the [`Profile`] as HORUS sent it, so every reader verifies the bytes that HORUS sealed. The bytes of an object that
//! did not arrive or was rejected are zero, and zeros do not verify.
use core::{fmt, ops::Range};

use bytemuck::{Pod, Zeroable};

use crate::{LinkStatus, Object, Profile, Reading, Rejection, ReportedPosition};

/// The offset of Link-Status.
pub const LINK_STATUS: usize = 0;

/// The offset of Reported-Position, where the profile begins.
pub const REPORTED_POSITION: usize = LINK_STATUS + LinkStatus::SIZE;

/// The offset of GPS1. The other GPS objects follow, 60 bytes each.
pub const GPS: usize = REPORTED_POSITION + ReportedPosition::SIZE;

const _: () = {
    assert!(REPORTED_POSITION == 32);
    assert!(GPS == 96);
    assert!(size_of::<Image<1>>() == 156 && Image::<1>::LEN == 156);
    assert!(size_of::<Image<2>>() == 216 && Image::<2>::LEN == 216);
    assert!(size_of::<Image<3>>() == 276 && Image::<3>::LEN == 276);
    assert!(size_of::<Image<5>>() == 396 && Image::<5>::LEN == 396);
};

/// The image of a DPR for a profile of `N` receivers.
// Every field has alignment 1, so there is no padding. `packed` proves that to bytemuck for any `N`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
pub struct Image<const N: usize> {
    link: LinkStatus,
    profile: Profile<N>,
}

impl<const N: usize> Image<N> {
    /// The size of the image in bytes: 156, 216, 276 or 396.
    pub const LEN: usize = LinkStatus::SIZE + Profile::<N>::SIZE;

    /// An image of zeros, in which no object verifies.
    pub const EMPTY: Self = Self { link: LinkStatus::EMPTY, profile: Profile::EMPTY };

    /// Link-Status, valid or not.
    #[must_use]
    pub const fn link(&self) -> &LinkStatus {
        &self.link
    }

    /// Puts Link-Status in its place.
    pub const fn set_link(&mut self, link: LinkStatus) {
        self.link = link;
    }

    /// The profile in the image. Its objects need not be valid.
    #[must_use]
    pub fn profile(&self) -> &Profile<N> {
        let (_, profile) = self.as_bytes().split_at(REPORTED_POSITION);
        bytemuck::from_bytes(profile)
    }

    /// Copies an accepted object into the image.
    ///
    /// # Errors
    ///
    /// [`Rejection::Identifier`] if this image has no room for the object. Then nothing is copied.
    pub fn deposit(&mut self, object: Object<'_>) -> Result<(), Rejection> {
        let index = object.index().ok_or(Rejection::Identifier)?;
        let slot = self.object_mut(index).ok_or(Rejection::Identifier)?;
        for (to, from) in slot.iter_mut().zip(object.as_bytes()) {
            *to = *from;
        }
        Ok(())
    }

    /// The bytes of the profile's object number `index`, for writing or clearing; `None` if there is no such object. 0
    /// is Reported-Position, 1 to `N` are GPS1 to GPS`N`.
    #[must_use]
    pub fn object_mut(&mut self, index: usize) -> Option<&mut [u8]> {
        let place = Self::place(index)?;
        self.as_bytes_mut().get_mut(place)
    }

    /// The range of the profile's object number `index` in the image; `None` if there is no such object.
    #[must_use]
    pub const fn place(index: usize) -> Option<Range<usize>> {
        match Profile::<N>::place(index) {
            Some(place) => Some(REPORTED_POSITION + place.start..REPORTED_POSITION + place.end),
            None => None,
        }
    }

    /// The [`Image::LEN`] bytes of the image in their order on the wire.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        bytemuck::bytes_of(self)
    }

    /// The [`Image::LEN`] bytes of the image in their order on the wire.
    #[must_use]
    pub fn as_bytes_mut(&mut self) -> &mut [u8] {
        bytemuck::bytes_of_mut(self)
    }

    /// The objects in `bytes`, each accepted or rejected separately.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not [`Image::LEN`].
    pub fn read(bytes: &[u8]) -> Result<ImageReading<'_, N>, Rejection> {
        let image: &Self = bytemuck::try_from_bytes(bytes).map_err(|_| Rejection::Length)?;
        Ok(image.verify())
    }

    /// The image's objects, each accepted or rejected separately.
    #[must_use]
    pub fn verify(&self) -> ImageReading<'_, N> {
        ImageReading { link: LinkStatus::verify(self.link.as_bytes()), profile: self.profile().verify() }
    }
}

impl<const N: usize> PartialEq for Image<N> {
    fn eq(&self, other: &Self) -> bool {
        self.as_bytes() == other.as_bytes()
    }
}

impl<const N: usize> Eq for Image<N> {}

impl<const N: usize> fmt::Debug for Image<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Image").field("link", self.link()).field("profile", self.profile()).finish()
    }
}

/// The results of verifying an image, object by object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageReading<'a, const N: usize> {
    /// The result for Link-Status.
    pub link: Result<&'a LinkStatus, Rejection>,
    /// The results for the objects of the profile.
    pub profile: Reading<'a, N>,
}
