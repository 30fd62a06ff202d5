//! Finds and verifies the objects of a transaction.
use core::ops::Range;

use crate::criticality::{BaseStation, FlightController, WritesUplink};
use crate::ssi::Request;
use crate::{HoldStatus, Layout, LinkStatus, Object, PortStatus, Rejection, ReportedPosition, Uplink, image};

/// What the transaction read at the place of one object of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown<T> {
    /// The object was read intact.
    Intact(T),
    /// There is no object: every byte is 0x00 or every byte is 0xFF, as after a scrub.
    Vacant,
    /// The bytes are not the expected object, for the given reason.
    Damaged(Rejection),
}

impl<T> Shown<T> {
    /// The object, if it is intact.
    pub fn intact(self) -> Option<T> {
        match self {
            Self::Intact(object) => Some(object),
            Self::Vacant | Self::Damaged(_) => None,
        }
    }

    /// Classifies `bytes`, given the result `verified` of verifying them. All bytes are read, whatever they are.
    fn new(bytes: &[u8], verified: Result<T, Rejection>) -> Self {
        let vacant = is_throughout(bytes, 0x00) | is_throughout(bytes, 0xFF);
        match verified {
            Ok(object) => Self::Intact(object),
            Err(_) if vacant => Self::Vacant,
            Err(why) => Self::Damaged(why),
        }
    }
}

fn is_throughout(bytes: &[u8], value: u8) -> bool {
    bytes.iter().fold(0, |difference, byte| difference | (byte ^ value)) == 0
}

/// The objects that a transaction read. An object is verified when it is accessed.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    layout: Layout,
    window: Request,
    bytes: &'a [u8],
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Prefix<'a> {
    pub(super) link: Result<&'a LinkStatus, Rejection>,
    pub(super) reported: Shown<&'a ReportedPosition>,
}

impl<'a> View<'a> {
    /// The objects in `miso`, which a transaction read from `window` of the map. Bytes beyond the window are ignored.
    #[must_use]
    pub fn new(layout: Layout, window: Request, miso: &'a [u8]) -> Self {
        let bytes = miso.get(..usize::from(window.length)).unwrap_or(miso);
        Self { layout, window, bytes }
    }

    /// The window of the map that the transaction read.
    #[must_use]
    pub const fn window(&self) -> Request {
        self.window
    }

    /// The bytes of the window that were read.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Whether the DPR was busy: every byte is 0xFF, or there are none.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        is_throughout(self.bytes, 0xFF)
    }

    /// The bytes at this range of the map; `None` if they were not all read.
    #[must_use]
    pub fn find(&self, place: Range<usize>) -> Option<&'a [u8]> {
        let start = place.start.checked_sub(usize::from(self.window.offset))?;
        let end = place.end.checked_sub(usize::from(self.window.offset))?;
        self.bytes.get(start..end)
    }

    /// Link-Status; `None` if it was not read.
    #[must_use]
    pub fn link(&self) -> Option<Shown<&'a LinkStatus>> {
        let bytes = self.find(image::LINK_STATUS..image::LINK_STATUS + LinkStatus::SIZE)?;
        Some(Shown::new(bytes, LinkStatus::verify(bytes)))
    }

    /// The profile's object number `index`: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5. `None` if there is no such
    /// object or it was not read.
    #[must_use]
    pub fn object(&self, index: usize) -> Option<Shown<Object<'a>>> {
        let bytes = self.find(self.layout.in_image(index)?)?;
        Some(Shown::new(bytes, Object::verify(index, bytes)))
    }

    /// Port-Status; `None` if it was not read.
    #[must_use]
    pub fn port_status(&self) -> Option<Shown<&'a PortStatus>> {
        let bytes = self.find(self.layout.port_status())?;
        Some(Shown::new(bytes, PortStatus::verify(bytes)))
    }

    /// The uplink of role `W` as the DPR stored it; `None` if it was not read.
    #[must_use]
    pub fn uplink<W: WritesUplink>(&self) -> Option<Shown<&'a Uplink>> {
        let bytes = self.find(self.layout.uplink::<W>())?;
        Some(Shown::new(bytes, Uplink::verify::<W>(bytes)))
    }

    /// Hold-Status; `None` if it was not read, or the layout has no [hold](Layout::with_hold).
    #[must_use]
    pub fn hold(&self) -> Option<Shown<&'a HoldStatus>> {
        let bytes = self.find(self.layout.hold()?)?;
        Some(Shown::new(bytes, HoldStatus::verify(bytes)))
    }

    /// Whether any object in the window is intact. All objects are checked, whatever the results are.
    pub(super) fn is_any_intact(&self) -> bool {
        let profile = (0..self.layout.objects()).filter_map(|index| self.object(index)?.intact()).count();
        let link = self.link().and_then(Shown::intact).is_some();
        let port = self.port_status().and_then(Shown::intact).is_some();
        let base_station = self.uplink::<BaseStation>().and_then(Shown::intact).is_some();
        let flight_controller = self.uplink::<FlightController>().and_then(Shown::intact).is_some();
        let hold = self.hold().and_then(Shown::intact).is_some();
        (profile > 0) | link | port | base_station | flight_controller | hold
    }

    pub(super) fn prefix(&self) -> Option<Prefix<'a>> {
        let link = self.find(image::LINK_STATUS..image::REPORTED_POSITION)?;
        let reported = self.find(image::REPORTED_POSITION..image::GPS)?;
        Some(Prefix {
            link: LinkStatus::verify(link),
            reported: Shown::new(reported, ReportedPosition::verify(reported)),
        })
    }
}
