//! A whole profile: Reported-Position and the GPS objects from which HORUS derives it.
use core::{fmt, ops::Range};

use bytemuck::{Pod, Zeroable};

use crate::{GpsObject, GpsValues, Identifier, Rejection, ReportedPosition, ReportedValues, crc};

/// The greatest number of receivers of a profile (3oo5 redundancy; paper, section 2.3).
pub const MAX_RECEIVERS: usize = 5;

/// The size of the largest profile, bytes.
pub const MAX_SIZE: usize = Profile::<MAX_RECEIVERS>::SIZE;

/// A profile of `N` receivers: Reported-Position, GPS1, … GPS`N`, contiguous.
///
/// `N` is 1 (no redundancy), 2 (1oo2), 3 (triple modular redundancy) or 5 (3oo5); any other `N` does not compile:
///
/// ```compile_fail,E0080
/// let four = profile::Profile::<4>::EMPTY;
/// ```
///
/// Object number 0 is Reported-Position, 1 to `N` are GPS1 to GPS`N`.
// Every field has alignment 1, so there is no padding. `packed` proves that to bytemuck for any `N`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
pub struct Profile<const N: usize> {
    reported: ReportedPosition,
    gps: [GpsObject; N],
}

const _: () = {
    assert!(Profile::<1>::SIZE == 124 && size_of::<Profile<1>>() == 124);
    assert!(Profile::<2>::SIZE == 184 && size_of::<Profile<2>>() == 184);
    assert!(Profile::<3>::SIZE == 244 && size_of::<Profile<3>>() == 244);
    assert!(Profile::<5>::SIZE == 364 && size_of::<Profile<5>>() == 364);
};

impl<const N: usize> Profile<N> {
    const SUPPORTED: () = assert!(matches!(N, 1 | 2 | 3 | 5), "a profile has 1, 2, 3 or 5 receivers");

    /// The size of the profile in bytes: 124, 184, 244 or 364.
    pub const SIZE: usize = {
        let () = Self::SUPPORTED;
        ReportedPosition::SIZE + N * GpsObject::SIZE
    };

    /// The number of objects of the profile: 2, 3, 4 or 6.
    pub const OBJECTS: usize = {
        let () = Self::SUPPORTED;
        1 + N
    };

    /// The profile as zeros, the contents of a buffer before the first write. No object in it verifies.
    pub const EMPTY: Self = {
        let () = Self::SUPPORTED;
        bytemuck::zeroed()
    };

    /// Returns the profile that consists of these sealed objects. `gps` begins with GPS1.
    #[must_use]
    pub const fn new(reported: ReportedPosition, gps: [GpsObject; N]) -> Self {
        let () = Self::SUPPORTED;
        Self { reported, gps }
    }

    /// Seals these values in a profile with all CRCs. `gps` begins with the values of GPS1.
    #[must_use]
    pub fn seal(reported: &ReportedValues, gps: &[GpsValues; N]) -> Self {
        let mut profile = Self::EMPTY;
        profile.reported = ReportedPosition::seal(reported);
        let objects = profile.gps_mut().iter_mut();
        for ((object, values), identifier) in objects.zip(gps).zip(Identifier::GPS) {
            *object = GpsObject::seal(identifier, values);
        }
        profile
    }

    /// Reported-Position, valid or not.
    #[must_use]
    pub const fn reported(&self) -> &ReportedPosition {
        &self.reported
    }

    /// The GPS objects, GPS1 first, valid or not.
    #[must_use]
    pub fn gps(&self) -> &[GpsObject; N] {
        let (_, gps) = self.as_bytes().split_at(ReportedPosition::SIZE);
        bytemuck::from_bytes(gps)
    }

    fn gps_mut(&mut self) -> &mut [GpsObject; N] {
        let (_, gps) = self.as_bytes_mut().split_at_mut(ReportedPosition::SIZE);
        bytemuck::from_bytes_mut(gps)
    }

    /// The [`Profile::SIZE`] bytes of the profile in their order on the wire.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        let () = Self::SUPPORTED;
        bytemuck::bytes_of(self)
    }

    /// The [`Profile::SIZE`] bytes of the profile in their order on the wire, for reception.
    #[must_use]
    pub fn as_bytes_mut(&mut self) -> &mut [u8] {
        let () = Self::SUPPORTED;
        bytemuck::bytes_of_mut(self)
    }

    /// The range of object number `index` in a profile; `None` if there is no such object.
    #[must_use]
    pub const fn place(index: usize) -> Option<Range<usize>> {
        let () = Self::SUPPORTED;
        match index {
            0 => Some(0..ReportedPosition::SIZE),
            // Not covered: only this line, an object beyond the profile: the DPR asks only for the objects that the
            // frame's place in the profile has.
            receiver if receiver <= N => {
                let end = ReportedPosition::SIZE + receiver * GpsObject::SIZE;
                Some(end - GpsObject::SIZE..end)
            }
            _ => None,
        }
    }

    /// The objects in `bytes`, each accepted or rejected separately.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not [`Profile::SIZE`].
    pub fn read(bytes: &[u8]) -> Result<Reading<'_, N>, Rejection> {
        let () = Self::SUPPORTED;
        let profile: &Self = bytemuck::try_from_bytes(bytes).map_err(|_| Rejection::Length)?;
        Ok(profile.verify())
    }

    /// The objects of the profile, each accepted or rejected separately.
    #[must_use]
    pub fn verify(&self) -> Reading<'_, N> {
        let mut gps = [Err(Rejection::Length); N];
        for ((judged, object), identifier) in gps.iter_mut().zip(self.gps()).zip(Identifier::GPS) {
            *judged = GpsObject::verify(object.as_bytes(), identifier);
        }
        Reading { reported: ReportedPosition::verify(self.reported.as_bytes()), gps }
    }
}

impl<const N: usize> PartialEq for Profile<N> {
    fn eq(&self, other: &Self) -> bool {
        self.as_bytes() == other.as_bytes()
    }
}

impl<const N: usize> Eq for Profile<N> {}

impl<const N: usize> fmt::Debug for Profile<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Profile").field("reported", self.reported()).field("gps", self.gps()).finish()
    }
}

/// The results of verifying a profile, object by object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading<'a, const N: usize> {
    /// The result for Reported-Position.
    pub reported: Result<&'a ReportedPosition, Rejection>,
    /// The results for GPS1 to GPS`N`.
    pub gps: [Result<&'a GpsObject, Rejection>; N],
}

impl<const N: usize> Reading<'_, N> {
    /// Whether every object is accepted.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.accepted() == Profile::<N>::OBJECTS
    }

    /// The number of accepted objects.
    #[must_use]
    pub fn accepted(&self) -> usize {
        let gps: usize = self.gps.iter().map(|object| usize::from(object.is_ok())).sum();
        usize::from(self.reported.is_ok()) + gps
    }
}

/// An accepted object of a profile, of either kind.
///
/// [`Object::verify`] returns only verified objects; an `Object` made in another way need not be valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Object<'a> {
    /// Reported-Position.
    Reported(&'a ReportedPosition),
    /// One of the objects GPS1 to GPS5; its identifier says which.
    Gps(&'a GpsObject),
}

impl<'a> Object<'a> {
    /// Object number `index` of a profile, if `bytes` are that object and are intact.
    ///
    /// # Errors
    ///
    /// The errors are those of [`ReportedPosition::verify`] for `index` 0, of [`GpsObject::verify`] for 1 to 5, and
    /// [`Rejection::Identifier`] for any other `index`.
    pub fn verify(index: usize, bytes: &'a [u8]) -> Result<Self, Rejection> {
        match Identifier::of_object(index) {
            Some(Identifier::REPORTED_POSITION) => ReportedPosition::verify(bytes).map(Self::Reported),
            Some(gps) => GpsObject::verify(bytes, gps).map(Self::Gps),
            None => Err(Rejection::Identifier),
        }
    }

    /// Does the same as [`verify`](Self::verify), with the frame CRC already `begun` over the first of `bytes`.
    ///
    /// # Errors
    ///
    /// The errors are those of [`verify`](Self::verify).
    pub fn verify_begun(index: usize, bytes: &'a [u8], begun: crc::Begun) -> Result<Self, Rejection> {
        match Identifier::of_object(index) {
            Some(Identifier::REPORTED_POSITION) => ReportedPosition::verify_begun(bytes, begun).map(Self::Reported),
            Some(gps) => GpsObject::verify_begun(bytes, gps, begun).map(Self::Gps),
            None => Err(Rejection::Identifier),
        }
    }

    /// The object's number in a profile: 0 for Reported-Position, 1 to 5 for GPS1 to GPS5; `None` for another
    /// identifier.
    #[must_use]
    pub const fn index(self) -> Option<usize> {
        match (self, self.identifier().object()) {
            (Self::Reported(_), Some(0)) => Some(0),
            (Self::Gps(_), Some(receiver @ 1..)) => Some(receiver),
            _ => None,
        }
    }

    /// The timestamp, ms since HORUS's start, wraps.
    #[must_use]
    pub const fn timestamp(self) -> u32 {
        match self {
            Self::Reported(object) => object.timestamp(),
            Self::Gps(object) => object.timestamp(),
        }
    }

    /// The object's identifier.
    #[must_use]
    pub const fn identifier(self) -> Identifier {
        match self {
            Self::Reported(object) => object.identifier(),
            Self::Gps(object) => object.identifier(),
        }
    }

    /// The 64 or 60 bytes of the object in their order on the wire.
    #[must_use]
    pub const fn as_bytes(self) -> &'a [u8] {
        match self {
            Self::Reported(object) => object.as_bytes(),
            Self::Gps(object) => object.as_bytes(),
        }
    }
}
