//! The position that a receiver states, and the values that the voter derives from it once, for all ticks.

use crate::{
    HIGHEST_MM, LATITUDE_MAX_E7, LONGITUDE_MAX_E7, LOWEST_MM, MOST_HORIZONTAL_ACCURACY_MM, MOST_VERTICAL_ACCURACY_MM,
    SPEED_MAX_MM_S, geometry::Place,
};

/// The position that a receiver states for one epoch, in the units of UBX NAV-PVT.
///
/// The values are integers. So they lose no precision before the vote, and every difference of two positions is exact.
/// No value can be infinite or not a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stated {
    /// The latitude, 1e-7 degrees north, WGS-84.
    pub latitude_e7: i32,
    /// The longitude, 1e-7 degrees east, WGS-84.
    pub longitude_e7: i32,
    /// The altitude, mm above the ellipsoid; `None` for a 2D fix, whose altitude is assumed.
    pub altitude_mm: Option<i32>,
    /// The velocity, mm/s north, east, down.
    pub velocity_mm_s: [i32; 3],
    /// The standard deviation of the horizontal position, mm (hAcc).
    pub horizontal_accuracy_mm: u32,
    /// The standard deviation of the altitude, mm (vAcc).
    pub vertical_accuracy_mm: u32,
}

impl Stated {
    /// The values that replace those of a statement that is not plausible. They are in range, but never used.
    const NOTHING: Self = Self {
        latitude_e7: 0,
        longitude_e7: 0,
        altitude_mm: None,
        velocity_mm_s: [0; 3],
        horizontal_accuracy_mm: 0,
        vertical_accuracy_mm: 0,
    };

    /// Whether each value is in range, and the accuracies are stated and good enough. The altitude of a 2D fix and its
    /// accuracy are not checked, since the receiver did not measure them.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        let speed_squared =
            self.velocity_mm_s.iter().fold(0_u64, |sum, axis| sum + u64::from(axis.unsigned_abs()).pow(2));
        let vertical = self.altitude_mm.is_none_or(|altitude| {
            (LOWEST_MM..=HIGHEST_MM).contains(&altitude)
                & (1..=MOST_VERTICAL_ACCURACY_MM).contains(&self.vertical_accuracy_mm)
        });
        (self.latitude_e7.unsigned_abs() <= LATITUDE_MAX_E7)
            & (self.longitude_e7.unsigned_abs() <= LONGITUDE_MAX_E7)
            & (speed_squared <= SPEED_MAX_MM_S.pow(2))
            & (1..=MOST_HORIZONTAL_ACCURACY_MM).contains(&self.horizontal_accuracy_mm)
            & vertical
    }
}

/// A position as it was stated, with the values that the voter needs at every tick, computed on arrival.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    pub(crate) plausible: bool,
    pub(crate) place: Place,
    pub(crate) altitude_mm: i32,
    pub(crate) has_altitude: bool,
    pub(crate) velocity: [f32; 3],
    pub(crate) speed: [f32; 2],
    pub(crate) accuracy: [f32; 2],
}

impl Fix {
    /// Returns the fix for what a receiver states. If the statement is not plausible, none of its values is used.
    #[must_use]
    pub fn new(stated: &Stated) -> Self {
        let plausible = stated.is_plausible();
        let stated = if plausible { stated } else { &Stated::NOTHING };
        let altitude_mm = stated.altitude_mm.unwrap_or(0);
        let velocity = stated.velocity_mm_s.map(metres);
        let [north, east, down] = velocity;
        Self {
            plausible,
            place: Place::new(stated.latitude_e7, stated.longitude_e7, metres(altitude_mm)),
            altitude_mm,
            has_altitude: stated.altitude_mm.is_some(),
            velocity,
            speed: [libm::sqrtf(north * north + east * east), if down < 0.0 { -down } else { down }],
            accuracy: [stated.horizontal_accuracy_mm, stated.vertical_accuracy_mm].map(|mm| mm as f32 / 1e3),
        }
    }

    /// Whether the statement behind this fix is plausible ([`Stated::is_plausible`]).
    #[must_use]
    pub const fn is_plausible(&self) -> bool {
        self.plausible
    }
}

impl Default for Fix {
    fn default() -> Self {
        Self::new(&Stated::NOTHING)
    }
}

pub(crate) fn metres(mm: i32) -> f32 {
    mm as f32 / 1e3
}
