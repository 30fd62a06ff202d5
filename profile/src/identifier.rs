//! Which object it is.

/// The identifier of an object: what it is, and so where it belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Identifier(pub u16);

impl Identifier {
    /// Reported-Position.
    pub const REPORTED_POSITION: Self = Self(0x4800);
    /// GPS1 to GPS5.
    pub const GPS: [Self; 5] = [
        Self(0x4801),
        Self(0x4802),
        Self(0x4803),
        Self(0x4804),
        Self(0x4805),
    ];
    /// Link-Status, written by the DPR.
    pub const LINK_STATUS: Self = Self(0x4400);
    /// Uplink object from the base station.
    pub const UPLINK_BASE_STATION: Self = Self(0x4200);
    /// Uplink object from the flight controller.
    pub const UPLINK_FLIGHT_CONTROLLER: Self = Self(0x4300);
    /// First of the active load's identifiers.
    pub const ACTIVE_LOAD: Self = Self(0x4100);

    /// The identifier of the GPS object of receiver `receiver`, 1 to 5.
    ///
    /// # Panics
    ///
    /// If `receiver` is not 1, 2, 3, 4 or 5; with a constant argument that is a compile-time error.
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

    /// The identifier of a profile's object number `index`: 0 is Reported-Position, 1 to 5 are GPS1 to GPS5.
    #[must_use]
    pub const fn of_object(index: usize) -> Option<Self> {
        match index {
            0 => Some(Self::REPORTED_POSITION),
            1..=5 => Some(Self::gps(index)),
            _ => None,
        }
    }
}
