//! The plausible range of a drone's position: one rule for all programs that display a position.
//!
//! A CRC proves that the values are those that were sealed, not that they are plausible. So the flight controller's
//! clients and the base station pass the values through [`checked`](crate::ReportedValues::checked) before they show a
//! position.

/// The northernmost latitude, degrees; the southernmost is its negative.
pub const MAX_LATITUDE: f64 = 90.0;

/// The easternmost longitude, degrees; the westernmost is its negative.
pub const MAX_LONGITUDE: f64 = 180.0;

/// The lowest altitude, m above the ellipsoid. The lowest land, at the Dead Sea, is 430 m below sea level. Sea level is
/// at most 107 m below the ellipsoid (EGM2008).
pub const MIN_ALTITUDE: f64 = -1_000.0;

/// The highest altitude, m above the ellipsoid: above the flight of any delivery drone, and above the 18 km limit of
/// receivers without an export licence.
pub const MAX_ALTITUDE: f64 = 20_000.0;

/// Whether latitude and longitude, degrees, and altitude, m, are numbers in their ranges. An altitude of NaN is
/// allowed: it is unknown in a 2D fix.
///
/// ```
/// use profile::range::is_position;
///
/// assert!(is_position(47.5, -180.0, f64::NAN));
/// assert!(!is_position(91.0, 8.7, 470.0) && !is_position(47.5, f64::NAN, 470.0));
/// assert!(!is_position(47.5, 8.7, 20_000.1) && !is_position(47.5, 8.7, f64::NEG_INFINITY));
/// ```
#[must_use]
pub fn is_position(latitude: f64, longitude: f64, altitude: f64) -> bool {
    let height = altitude.is_nan() | (MIN_ALTITUDE..=MAX_ALTITUDE).contains(&altitude);
    (latitude.abs() <= MAX_LATITUDE) & (longitude.abs() <= MAX_LONGITUDE) & height
}

macro_rules! checked {
    ($values:ident) => {
        impl crate::$values {
            /// Replaces values that are not marked valid, or are marked valid but impossible ([`range`](crate::range)),
            /// by NaN and clears their status bits.
            #[must_use]
            pub fn checked(mut self) -> Self {
                let status = self.status;
                let position =
                    status.position_valid() & crate::range::is_position(self.latitude, self.longitude, self.altitude);
                let angles = [self.pitch, self.yaw, self.roll];
                let attitude = status.attitude_valid() & angles.iter().all(|angle| angle.is_finite());
                let acceleration = status.acceleration_valid() & self.acceleration.iter().all(|axis| axis.is_finite());
                if !position {
                    (self.latitude, self.longitude) = (crate::ABSENT_F64, crate::ABSENT_F64);
                }
                if !position | self.altitude.is_nan() {
                    self.altitude = crate::ABSENT_F64;
                }
                if !attitude {
                    (self.pitch, self.yaw, self.roll) = (crate::ABSENT_F32, crate::ABSENT_F32, crate::ABSENT_F32);
                }
                if !acceleration {
                    self.acceleration = [crate::ABSENT_F32; 3];
                }
                self.status = status
                    .with_position_valid(position)
                    .with_attitude_valid(attitude)
                    .with_acceleration_valid(acceleration);
                self
            }
        }
    };
}

checked!(ReportedValues);
checked!(GpsValues);
