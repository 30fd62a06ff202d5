//! The identifiers of objects.
use core::fmt;

/// The kind of an object, which determines where it belongs: the header word of every object (paper, section 2.1).
///
/// A valid object at another object's offset is [rejected](crate::Rejection::Identifier); a CRC alone would not reveal
/// GPS1 in place of GPS2.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Identifier(pub u16);

impl Identifier {
    /// Reported-Position.
    pub const REPORTED_POSITION: Self = Self(0x4800);
    /// GPS1 to GPS5, in this order.
    pub const GPS: [Self; 5] = [Self(0x4801), Self(0x4802), Self(0x4803), Self(0x4804), Self(0x4805)];
    /// Link-Status, which the DPR writes.
    pub const LINK_STATUS: Self = Self(0x4400);
    /// Port-Status, which the DPR writes.
    pub const PORT_STATUS: Self = Self(0x4401);
    /// A command from the flight controller to the DPR.
    pub const COMMAND: Self = Self(0x4301);
    /// The uplink of the flight controller.
    pub const UPLINK_FLIGHT_CONTROLLER: Self = Self(0x4300);
    /// The uplink of the base station.
    pub const UPLINK_BASE_STATION: Self = Self(0x4200);
    /// The first identifier of the active load; the last is 0x41FF. Each maker of a [hold](crate::hold) uses one.
    pub const ACTIVE_LOAD: Self = Self(0x4100);
    /// Hold-Status, the object of this project's own hold.
    pub const HOLD_STATUS: Self = Self::ACTIVE_LOAD;

    /// The identifier of the GPS object of receiver `receiver`, 1 to 5.
    ///
    /// # Panics
    ///
    /// Panics if `receiver` is not 1 to 5. For a constant argument that can be a compile-time error. Loops can iterate
    /// over [`Identifier::GPS`], which cannot panic.
    ///
    /// ```
    /// use profile::Identifier;
    ///
    /// const SECOND: Identifier = Identifier::gps(2);
    /// assert_eq!(SECOND, Identifier(0x4802));
    /// ```
    #[must_use]
    pub const fn gps(receiver: usize) -> Self {
        match receiver {
            1 => Self(0x4801),
            2 => Self(0x4802),
            3 => Self(0x4803),
            4 => Self(0x4804),
            5 => Self(0x4805),
            _ => panic!("receivers are numbered 1 to 5"),
        }
    }

    /// Whether this is an identifier of the active load: 0x4100 to 0x41FF.
    #[must_use]
    pub const fn is_active_load(self) -> bool {
        self.0 >> 8 == Self::ACTIVE_LOAD.0 >> 8
    }

    /// The identifier of object number `index` of a profile: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5.
    #[must_use]
    pub const fn of_object(index: usize) -> Option<Self> {
        match index {
            0 => Some(Self::REPORTED_POSITION),
            // Not covered: only this line, the end of the range: the callers ask for objects of a profile of three
            // receivers, the last of which is GPS3.
            1..=5 => Some(Self::gps(index)),
            _ => None,
        }
    }

    /// The object's number in a profile: 0 for Reported-Position, 1 to 5 for GPS1 to GPS5, `None` for any other.
    #[must_use]
    pub const fn object(self) -> Option<usize> {
        match self.0 {
            0x4800 => Some(0),
            0x4801 => Some(1),
            0x4802 => Some(2),
            0x4803 => Some(3),
            0x4804 => Some(4),
            0x4805 => Some(5),
            _ => None,
        }
    }
}

impl fmt::Debug for Identifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Identifier({:#06X})", self.0)
    }
}

impl fmt::Display for Identifier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::REPORTED_POSITION => f.write_str("Reported-Position"),
            Self::LINK_STATUS => f.write_str("Link-Status"),
            Self::PORT_STATUS => f.write_str("Port-Status"),
            Self::COMMAND => f.write_str("command to the DPR"),
            Self::HOLD_STATUS => f.write_str("Hold-Status"),
            Self::UPLINK_FLIGHT_CONTROLLER => f.write_str("uplink from the flight controller"),
            Self::UPLINK_BASE_STATION => f.write_str("uplink from the base station"),
            Self(other) => match self.object() {
                Some(receiver) => write!(f, "GPS{receiver}"),
                None => write!(f, "object {other:#06X}"),
            },
        }
    }
}
