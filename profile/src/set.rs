//! A whole profile.
use core::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::{GpsObject, GpsValues, Identifier, Rejection, ReportedPosition, ReportedValues};

/// The most receivers a profile has room for (3oo5 redundancy).
pub const MAX_RECEIVERS: usize = 5;

/// The largest profile, bytes.
pub const SIZE_LIMIT: usize = Profile::<MAX_RECEIVERS>::SIZE;

/// Reported-Position and GPS1 to GPS`N`, `N` = 1, 2, 3 or 5, contiguous.
///
/// Another `N` does not compile.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
pub struct Profile<const N: usize> {
    reported: ReportedPosition,
    gps: [GpsObject; N],
}

impl<const N: usize> Profile<N> {
    const SUPPORTED: () = assert!(
        matches!(N, 1 | 2 | 3 | 5),
        "a profile has 1, 2, 3 or 5 receivers"
    );

    /// Bytes: 124, 184, 244 or 364.
    pub const SIZE: usize = {
        let () = Self::SUPPORTED;
        ReportedPosition::SIZE + N * GpsObject::SIZE
    };

    /// All zero, as a buffer is before anything has been put there: nothing in it verifies.
    pub const EMPTY: Self = {
        let () = Self::SUPPORTED;
        bytemuck::zeroed()
    };

    /// Objects: Reported-Position and `N` GPS.
    pub const OBJECTS: usize = {
        let () = Self::SUPPORTED;
        1 + N
    };

    /// A profile of objects that are sealed already.
    #[must_use]
    pub const fn new(reported: ReportedPosition, gps: [GpsObject; N]) -> Self {
        let () = Self::SUPPORTED;
        Self { reported, gps }
    }

    /// The profile that carries these values, every CRC computed.
    #[must_use]
    pub fn seal(reported: &ReportedValues, gps: &[GpsValues; N]) -> Self {
        let () = Self::SUPPORTED;
        let mut profile = Self::EMPTY;
        profile.reported = ReportedPosition::seal(reported);
        for ((object, values), identifier) in
            profile.gps_mut().iter_mut().zip(gps).zip(Identifier::GPS)
        {
            *object = GpsObject::seal(identifier, values);
        }
        profile
    }

    /// Its Reported-Position, verified or not.
    #[must_use]
    pub const fn reported(&self) -> &ReportedPosition {
        &self.reported
    }

    /// Its GPS objects, verified or not.
    #[must_use]
    pub fn gps(&self) -> &[GpsObject; N] {
        let (_, gps) = bytemuck::bytes_of(self).split_at(ReportedPosition::SIZE);
        bytemuck::from_bytes(gps)
    }

    fn gps_mut(&mut self) -> &mut [GpsObject; N] {
        let (_, gps) = bytemuck::bytes_of_mut(self).split_at_mut(ReportedPosition::SIZE);
        bytemuck::from_bytes_mut(gps)
    }

    /// As on the wire: [`Profile::SIZE`] bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        let () = Self::SUPPORTED;
        bytemuck::bytes_of(self)
    }

    /// Where object `index` lies in a profile: 0 is Reported-Position, 1 to `N` are GPS1 to GPS`N`.
    #[must_use]
    pub const fn place(index: usize) -> Option<Range<usize>> {
        let () = Self::SUPPORTED;
        if index > N {
            None
        } else if index == 0 {
            Some(0..ReportedPosition::SIZE)
        } else {
            let start = ReportedPosition::SIZE + (index - 1) * GpsObject::SIZE;
            Some(start..start + GpsObject::SIZE)
        }
    }

    /// The objects in `bytes`, each accepted or rejected by itself.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not [`Profile::SIZE`] bytes.
    pub fn read(bytes: &[u8]) -> Result<Reading<'_, N>, Rejection> {
        let () = Self::SUPPORTED;
        let profile: &Self = bytemuck::try_from_bytes(bytes).map_err(|_| Rejection::Length)?;
        Ok(profile.verify())
    }

    /// Its objects, each accepted or rejected by itself.
    #[must_use]
    pub fn verify(&self) -> Reading<'_, N> {
        let mut gps = [Err(Rejection::Length); N];
        for ((result, object), identifier) in gps.iter_mut().zip(self.gps()).zip(Identifier::GPS) {
            *result = GpsObject::verify(object.as_bytes(), identifier);
        }
        Reading {
            reported: ReportedPosition::verify(self.reported.as_bytes()),
            gps,
        }
    }
}

/// What a profile's bytes turned out to be, object by object.
#[derive(Clone, Copy)]
pub struct Reading<'a, const N: usize> {
    /// Reported-Position.
    pub reported: Result<&'a ReportedPosition, Rejection>,
    /// GPS1 to GPS`N`.
    pub gps: [Result<&'a GpsObject, Rejection>; N],
}

impl<const N: usize> Reading<'_, N> {
    /// Whether every object is accepted.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.reported.is_ok() && self.gps.iter().all(Result::is_ok)
    }
}

/// An accepted object of a profile.
#[derive(Clone, Copy)]
pub enum Object<'a> {
    /// Reported-Position.
    Reported(&'a ReportedPosition),
    /// GPS1 to GPS5, by its identifier.
    Gps(&'a GpsObject),
}

impl<'a> Object<'a> {
    /// Object number `index` of a profile in `bytes`, if it is intact and in its place.
    ///
    /// # Errors
    ///
    /// [`Rejection`] says why not; [`Rejection::Identifier`] if no profile has an object of that number.
    pub fn verify(index: usize, bytes: &'a [u8]) -> Result<Self, Rejection> {
        match Identifier::of_object(index) {
            Some(Identifier::REPORTED_POSITION) => {
                ReportedPosition::verify(bytes).map(Self::Reported)
            }
            Some(gps) => GpsObject::verify(bytes, gps).map(Self::Gps),
            None => Err(Rejection::Identifier),
        }
    }

    /// ms since HORUS start, wraps.
    #[must_use]
    pub const fn timestamp(self) -> u32 {
        match self {
            Self::Reported(object) => object.timestamp(),
            Self::Gps(object) => object.timestamp(),
        }
    }

    /// Which object it is.
    #[must_use]
    pub const fn identifier(self) -> Identifier {
        match self {
            Self::Reported(object) => object.identifier(),
            Self::Gps(object) => object.identifier(),
        }
    }

    /// As on the wire.
    #[must_use]
    pub fn as_bytes(self) -> &'a [u8] {
        match self {
            Self::Reported(object) => object.as_bytes(),
            Self::Gps(object) => object.as_bytes(),
        }
    }
}
