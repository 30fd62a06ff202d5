//! Defines the kinds of objects, and checks whether bytes are an intact object.

use core::fmt;

use profile::criticality::BaseStation;
use profile::ssi::Request;
use profile::ssi::client::{Shown, View};
use profile::{HoldStatus, Identifier, Layout, LinkStatus, MAX_RECEIVERS, Object, PortStatus, Uplink, image};

/// A kind of object that a base station knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// Link-Status: 32 bytes.
    LinkStatus,
    /// Reported-Position: 64 bytes.
    Reported,
    /// GPS1 to GPS5, counted from 1: 60 bytes.
    Gps(u8),
    /// Port-Status: 64 bytes.
    PortStatus,
    /// The base station's uplink as the DPR stored it: 64 bytes.
    Uplink,
    /// Hold-Status, the object of the [active hold](profile::hold): 64 bytes.
    Hold,
}

impl Place {
    /// The number of kinds of objects.
    pub const COUNT: usize = 5 + MAX_RECEIVERS;

    /// All kinds of objects, in the order of the map.
    pub const ALL: [Self; Self::COUNT] = [
        Self::LinkStatus,
        Self::Reported,
        Self::Gps(1),
        Self::Gps(2),
        Self::Gps(3),
        Self::Gps(4),
        Self::Gps(5),
        Self::PortStatus,
        Self::Uplink,
        Self::Hold,
    ];

    /// Returns the kind of the profile's object number `index`: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5.
    #[must_use]
    pub fn of_object(index: usize) -> Option<Self> {
        Self::ALL.get(index.checked_add(1)?).copied().filter(|_| index <= MAX_RECEIVERS)
    }

    /// Returns the object's number in the order of the map: 0 for Link-Status, 1 for Reported-Position, 2 to 6 for the
    /// receivers, 7 for Port-Status, 8 for the uplink and 9 for Hold-Status.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::LinkStatus => 0,
            Self::Reported => 1,
            Self::Gps(receiver) => 1 + receiver as usize,
            Self::PortStatus => 2 + MAX_RECEIVERS,
            Self::Uplink => 3 + MAX_RECEIVERS,
            Self::Hold => 4 + MAX_RECEIVERS,
        }
    }

    /// Returns the object's size on the wire, bytes.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::LinkStatus => LinkStatus::SIZE,
            Self::Reported => profile::ReportedPosition::SIZE,
            Self::Gps(_) => profile::GpsObject::SIZE,
            Self::PortStatus => PortStatus::SIZE,
            Self::Uplink => Uplink::SIZE,
            Self::Hold => HoldStatus::SIZE,
        }
    }

    /// Returns the object's identifier; `None` for a receiver that does not exist.
    #[must_use]
    pub fn identifier(self) -> Option<Identifier> {
        match self {
            Self::LinkStatus => Some(Identifier::LINK_STATUS),
            Self::Reported => Some(Identifier::REPORTED_POSITION),
            Self::Gps(receiver) => Identifier::GPS.get(usize::from(receiver).checked_sub(1)?).copied(),
            Self::PortStatus => Some(Identifier::PORT_STATUS),
            Self::Uplink => Some(Identifier::UPLINK_BASE_STATION),
            Self::Hold => Some(Identifier::HOLD_STATUS),
        }
    }

    /// Returns the kind of the object with this identifier; `None` if a base station does not know it.
    #[must_use]
    pub fn of(identifier: Identifier) -> Option<Self> {
        Self::ALL.into_iter().find(|place| place.identifier() == Some(identifier))
    }

    /// Judges by [`profile`] whether `bytes` are an intact object of this kind. Bytes of another length are damaged.
    #[must_use]
    pub fn judge(self, bytes: &[u8]) -> Shown<Intact<'_>> {
        let damaged = Shown::Damaged(profile::Rejection::Length);
        // The layout with the most receivers has a place for every kind of object.
        let [.., layout] = Layout::ALL.map(Layout::with_hold);
        let offset = match self {
            Self::LinkStatus => Some(image::LINK_STATUS),
            Self::Reported | Self::Gps(_) => layout.in_image(self.index() - 1).map(|place| place.start),
            Self::PortStatus => Some(layout.port_status().start),
            Self::Uplink => Some(layout.uplink::<BaseStation>().start),
            Self::Hold => layout.hold().map(|place| place.start),
        };
        let (Some(Ok(offset)), Ok(length)) = (offset.map(u16::try_from), u16::try_from(bytes.len())) else {
            return damaged;
        };
        if bytes.len() != self.size() {
            return damaged;
        }
        let view = View::new(layout, Request { offset, length }, bytes);
        match self {
            Self::LinkStatus => view.link().map(|shown| map(shown, Intact::LinkStatus)),
            Self::Reported | Self::Gps(_) => view.object(self.index() - 1).map(|shown| map(shown, Intact::Object)),
            Self::PortStatus => view.port_status().map(|shown| map(shown, Intact::PortStatus)),
            Self::Uplink => view.uplink::<BaseStation>().map(|shown| map(shown, Intact::Uplink)),
            Self::Hold => view.hold().map(|shown| map(shown, Intact::Hold)),
        }
        .unwrap_or(damaged)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LinkStatus => f.write_str("Link-Status"),
            Self::Reported => f.write_str("Reported-Position"),
            Self::Gps(receiver) => write!(f, "GPS{receiver}"),
            Self::PortStatus => f.write_str("Port-Status"),
            Self::Uplink => f.write_str("Uplink"),
            Self::Hold => f.write_str("Hold-Status"),
        }
    }
}

/// An intact object, as [`Place::judge`] returns it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Intact<'a> {
    /// Link-Status.
    LinkStatus(&'a LinkStatus),
    /// An object of the profile: Reported-Position or GPS1 to GPS5.
    Object(Object<'a>),
    /// Port-Status.
    PortStatus(&'a PortStatus),
    /// The base station's uplink.
    Uplink(&'a Uplink),
    /// Hold-Status.
    Hold(&'a HoldStatus),
}

impl Intact<'_> {
    /// Returns the object's timestamp, ms, which wraps. Link-Status and Port-Status count from the DPR's start, the
    /// profile's objects from HORUS's start, and Hold-Status from the hold's start. The uplink's timestamp is on the
    /// base station's clock.
    #[must_use]
    pub const fn timestamp(self) -> u32 {
        match self {
            Self::LinkStatus(object) => object.timestamp(),
            Self::Object(object) => object.timestamp(),
            Self::PortStatus(object) => object.timestamp(),
            Self::Uplink(object) => object.timestamp(),
            Self::Hold(object) => object.timestamp(),
        }
    }
}

fn map<T, U>(shown: Shown<T>, with: impl FnOnce(T) -> U) -> Shown<U> {
    match shown {
        Shown::Intact(object) => Shown::Intact(with(object)),
        Shown::Vacant => Shown::Vacant,
        Shown::Damaged(why) => Shown::Damaged(why),
    }
}

#[cfg(test)]
mod tests {
    use profile::criticality::{ActiveLoad, Dpr, Writer};
    use profile::{
        GpsObject, GpsValues, HoldValues, LinkValues, PortValues, Rejection, ReportedPosition, ReportedValues,
        UplinkValues,
    };

    use super::*;

    fn sealed(place: Place) -> Vec<u8> {
        match place {
            Place::LinkStatus => LinkStatus::seal(&LinkValues::default()).as_bytes().to_vec(),
            Place::Reported => ReportedPosition::seal(&ReportedValues::absent(10)).as_bytes().to_vec(),
            Place::Gps(_) => GpsObject::seal(place.identifier().unwrap(), &GpsValues::absent(10)).as_bytes().to_vec(),
            Place::PortStatus => PortStatus::seal(Writer::<Dpr>::claim(), &PortValues::default()).as_bytes().to_vec(),
            Place::Uplink => Uplink::seal(Writer::<BaseStation>::claim(), &UplinkValues::default()).as_bytes().to_vec(),
            Place::Hold => HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(10)).as_bytes().to_vec(),
        }
    }

    #[test]
    fn an_object_is_intact_in_its_own_place_and_in_no_other() {
        for own in Place::ALL {
            let bytes = sealed(own);
            assert_eq!(bytes.len(), own.size());
            for place in Place::ALL {
                match place.judge(&bytes) {
                    Shown::Intact(_) => assert_eq!(place, own),
                    Shown::Damaged(Rejection::Identifier | Rejection::PositionCrc) => {
                        assert!(place != own && place.size() == own.size());
                    }
                    Shown::Damaged(Rejection::Length) => assert_ne!(place.size(), own.size()),
                    other => panic!("{own} in place of {place}: {other:?}"),
                }
            }
        }
    }

    #[test]
    fn every_flipped_bit_of_every_object_is_found() {
        for place in Place::ALL {
            let good = sealed(place);
            for bit in 0..good.len() * 8 {
                let mut bytes = good.clone();
                bytes[bit / 8] ^= 0x80 >> (bit % 8);
                assert!(matches!(place.judge(&bytes), Shown::Damaged(_)), "{place}, bit {bit}");
            }
            assert_eq!(place.judge(&vec![0; good.len()]), Shown::Vacant);
            assert_eq!(place.judge(&vec![0xFF; good.len()]), Shown::Vacant);
            assert_eq!(place.judge(&good[1..]), Shown::Damaged(Rejection::Length));
            assert_eq!(place.judge(&[]), Shown::Damaged(Rejection::Length));
        }
    }

    #[test]
    fn a_receiver_that_does_not_exist_has_no_place() {
        for none in [0, 6, u8::MAX] {
            assert_eq!(Place::Gps(none).identifier(), None);
            assert_eq!(Place::Gps(none).judge(&sealed(Place::Gps(1))).intact(), None);
        }
        assert_eq!(Place::of(Identifier::COMMAND), None);
        for (index, place) in Place::ALL.into_iter().enumerate() {
            assert_eq!((place.index(), Place::of(place.identifier().unwrap())), (index, Some(place)));
        }
        assert_eq!((Place::of_object(5), Place::of_object(6)), (Some(Place::Gps(5)), None));
        assert_eq!(Place::of_object(usize::MAX), None);
    }
}
