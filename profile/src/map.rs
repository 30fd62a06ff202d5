//! The memory map: everything that the flight controller can read over the SSI.
//!
//! | offset | object | bytes | written by |
//! |---|---|---|---|
//! | 0 | the [image]: Link-Status, Reported-Position, GPS1 … GPSn | [`Image::LEN`] | DPR, HORUS |
//! | `LEN` | [Port-Status](PortStatus) | 64 | DPR |
//! | `LEN` + 64 | [uplink](Uplink) of the base station, as it was stored | 64 | base station |
//! | `LEN` + 128 | [uplink](Uplink) of the flight controller, as it was stored | 64 | flight controller |
//! | `LEN` + 192 | end, or the [object of the hold](crate::hold), where there is one | 64 | hold |
//!
//! All bytes of one transaction were published at the same instant. The bytes of an object that may not be shown are
//! zeros, which do not verify. [`Map::PORT_STATUS`] and [`Map::uplink`] give the offsets.
//!
//! The map of a DPR without a hold ends before the hold's object. [`Map::LEN`] never includes the hold.
//!
//! A transaction without a request reads the map from its start. So a flight controller that clocks as many bytes as
//! the image has reads only the image.
//!
//! This module's functions take the [writer](Writer) of the role that an object belongs to, so types enforce the write
//! permissions.
use core::{fmt, ops::Range};

use bytemuck::{Pod, Zeroable};

use crate::{
    HoldObject, LinkStatus, PortStatus, Rejection, Uplink,
    criticality::{BaseStation, FlightController, MayWrite, Writer, WritesUplink, object},
    image::{self, Image, ImageReading},
};

/// The part of the map behind the image: Port-Status and both uplinks.
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PortArea {
    status: PortStatus,
    uplinks: [Uplink; 2],
}

impl PortArea {
    /// The size of Port-Status and both uplinks in bytes.
    pub const SIZE: usize = PortStatus::SIZE + 2 * Uplink::SIZE;

    /// Zeros, in which no object verifies.
    pub const EMPTY: Self = bytemuck::zeroed();

    /// Port-Status, valid or not.
    #[must_use]
    pub const fn status(&self) -> &PortStatus {
        &self.status
    }

    /// Puts Port-Status in its place.
    pub const fn set_status<W: MayWrite<object::PortStatus>>(&mut self, _writer: Writer<W>, status: PortStatus) {
        self.status = status;
    }

    /// The uplink of role `W`, valid or not.
    #[must_use]
    pub fn uplink<W: WritesUplink>(&self) -> &Uplink {
        let [base_station, flight_controller] = &self.uplinks;
        if W::INDEX == 0 { base_station } else { flight_controller }
    }

    /// Sets the uplink of role `W`, or [`Uplink::EMPTY`] if none may be shown.
    pub fn set_uplink<W: WritesUplink>(&mut self, _writer: Writer<W>, uplink: Uplink) {
        let [base_station, flight_controller] = &mut self.uplinks;
        *(if W::INDEX == 0 { base_station } else { flight_controller }) = uplink;
    }

    /// The bytes of Port-Status and both uplinks in their order on the wire.
    #[must_use]
    pub const fn as_bytes(&self) -> &[u8; Self::SIZE] {
        bytemuck::must_cast_ref(self)
    }

    /// Port-Status and both uplinks, each accepted or rejected separately.
    #[must_use]
    pub fn verify(&self) -> PortReading<'_> {
        PortReading {
            status: PortStatus::verify(self.status.as_bytes()),
            base_station: Uplink::verify::<BaseStation>(self.uplink::<BaseStation>().as_bytes()),
            flight_controller: Uplink::verify::<FlightController>(self.uplink::<FlightController>().as_bytes()),
        }
    }
}

impl fmt::Debug for PortArea {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PortArea").field("status", &self.status).field("uplinks", &self.uplinks).finish()
    }
}

/// The memory map of a DPR for a profile of `N` receivers.
// Every field has alignment 1, so there is no padding. `packed` proves that to bytemuck for any `N`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
pub struct Map<const N: usize> {
    image: Image<N>,
    port: PortArea,
}

const _: () = {
    assert!(PortArea::SIZE == 192 && size_of::<PortArea>() == 192);
    assert!(size_of::<Map<1>>() == 348 && Map::<1>::LEN == 348);
    assert!(size_of::<Map<2>>() == 408 && Map::<2>::LEN == 408);
    assert!(size_of::<Map<3>>() == 468 && Map::<3>::LEN == 468);
    assert!(size_of::<Map<5>>() == 588 && Map::<5>::LEN == 588);
    assert!(Map::<1>::LEN_WITH_HOLD == 412 && Map::<5>::LEN_WITH_HOLD == 652);
};

impl<const N: usize> Map<N> {
    /// The size of the map in bytes, without a hold: 348, 408, 468 or 588.
    pub const LEN: usize = Image::<N>::LEN + PortArea::SIZE;

    /// The size of the map in bytes with the object of a [hold](crate::hold): 412, 472, 532 or 652.
    pub const LEN_WITH_HOLD: usize = Self::LEN + HoldObject::SIZE;

    /// The offset of Port-Status in the map.
    pub const PORT_STATUS: usize = Image::<N>::LEN;

    /// Zeros, in which no object verifies.
    pub const EMPTY: Self = Self { image: Image::EMPTY, port: PortArea::EMPTY };

    /// A map of this image and these objects.
    #[must_use]
    pub const fn new(image: Image<N>, port: PortArea) -> Self {
        Self { image, port }
    }

    /// The image. Its objects need not be valid.
    #[must_use]
    pub fn image(&self) -> &Image<N> {
        let (image, _) = self.as_bytes().split_at(Self::PORT_STATUS);
        bytemuck::from_bytes(image)
    }

    /// Port-Status and uplinks, valid or not.
    #[must_use]
    pub const fn port(&self) -> &PortArea {
        &self.port
    }

    /// The range of Port-Status and both uplinks in the map.
    #[must_use]
    pub const fn port_area() -> Range<usize> {
        Self::PORT_STATUS..Self::LEN
    }

    /// The range of Port-Status in the map.
    #[must_use]
    pub const fn port_status() -> Range<usize> {
        Self::PORT_STATUS..Self::PORT_STATUS + PortStatus::SIZE
    }

    /// The range of the uplink of role `W` in the map.
    #[must_use]
    pub const fn uplink<W: WritesUplink>() -> Range<usize> {
        let start = Self::PORT_STATUS + PortStatus::SIZE + W::INDEX * Uplink::SIZE;
        start..start + Uplink::SIZE
    }

    /// The range of the hold's object in the map: the bytes after [`Map::LEN`].
    #[must_use]
    pub const fn hold() -> Range<usize> {
        Self::LEN..Self::LEN_WITH_HOLD
    }

    /// The [`Map::LEN`] bytes of the map in their order on the wire.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        bytemuck::bytes_of(self)
    }

    /// The objects in `bytes`, each accepted or rejected separately.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not [`Map::LEN`].
    pub fn read(bytes: &[u8]) -> Result<MapReading<'_, N>, Rejection> {
        let map: &Self = bytemuck::try_from_bytes(bytes).map_err(|_| Rejection::Length)?;
        Ok(map.verify())
    }

    /// The objects of the map, each accepted or rejected separately.
    #[must_use]
    pub fn verify(&self) -> MapReading<'_, N> {
        MapReading { image: self.image().verify(), port: self.port.verify() }
    }
}

impl<const N: usize> PartialEq for Map<N> {
    fn eq(&self, other: &Self) -> bool {
        self.as_bytes() == other.as_bytes()
    }
}

impl<const N: usize> Eq for Map<N> {}

impl<const N: usize> fmt::Debug for Map<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Map").field("image", self.image()).field("port", self.port()).finish()
    }
}

/// The bytes of the profile's object number `index` in `map`, for code that passes HORUS's objects on; `None` if there
/// is no such object or `map` is too short.
#[must_use]
pub fn profile_object_mut<W: MayWrite<object::Profile>, const N: usize>(
    _writer: Writer<W>,
    map: &mut [u8],
    index: usize,
) -> Option<&mut [u8]> {
    map.get_mut(Image::<N>::place(index)?)
}

/// The bytes of Link-Status in `map`; `None` if `map` is too short.
#[must_use]
pub fn link_status_mut<W: MayWrite<object::LinkStatus>>(
    _writer: Writer<W>,
    map: &mut [u8],
) -> Option<&mut [u8; LinkStatus::SIZE]> {
    let (_, from) = map.split_at_mut_checked(image::LINK_STATUS)?;
    from.first_chunk_mut()
}

/// The bytes of Port-Status and both uplinks in `map`, for the DPR; `None` if `map` is too short.
#[must_use]
pub fn port_area_mut<W: MayWrite<object::PortStatus>, const N: usize>(
    _writer: Writer<W>,
    map: &mut [u8],
) -> Option<&mut [u8; PortArea::SIZE]> {
    let (_, from) = map.split_at_mut_checked(Map::<N>::PORT_STATUS)?;
    from.first_chunk_mut()
}

/// The bytes of the hold's object in `map`, for code that passes the object on; `None` if `map` is too short.
#[must_use]
pub fn hold_mut<W: MayWrite<object::Hold>, const N: usize>(
    _writer: Writer<W>,
    map: &mut [u8],
) -> Option<&mut [u8; HoldObject::SIZE]> {
    let (_, from) = map.split_at_mut_checked(Map::<N>::LEN)?;
    from.first_chunk_mut()
}

/// The results of verifying Port-Status and both uplinks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortReading<'a> {
    /// The result for Port-Status.
    pub status: Result<&'a PortStatus, Rejection>,
    /// The result for the uplink of the base station.
    pub base_station: Result<&'a Uplink, Rejection>,
    /// The result for the uplink of the flight controller.
    pub flight_controller: Result<&'a Uplink, Rejection>,
}

/// The results of verifying a map, object by object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapReading<'a, const N: usize> {
    /// The results for the objects of the image.
    pub image: ImageReading<'a, N>,
    /// The results for Port-Status and both uplinks.
    pub port: PortReading<'a>,
}
