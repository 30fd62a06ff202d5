//! WGS-84 positions and the local tangent plane in which a flight is planned.
//!
//! A flight is planned in metres north, east and down of its start, and receivers report degrees and metres above the
//! ellipsoid. The conversion is exact (tangent plane, ECEF, geodetic), because 2 km away the surface already lies 0.3 m
//! below the plane.

use libm::{atan2, cos, sin, sqrt};

/// Semi-major axis of the WGS-84 ellipsoid, m (NIMA TR8350.2, table 3.1).
pub const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;

/// Flattening of the WGS-84 ellipsoid (NIMA TR8350.2, table 3.1).
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// First eccentricity squared, f (2 - f).
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// A position on or above the WGS-84 ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Degrees north, -90 ..= 90.
    pub latitude: f64,
    /// Degrees east, -180 ..= 180.
    pub longitude: f64,
    /// Metres above the ellipsoid.
    pub height: f64,
}

impl Geodetic {
    /// Earth-centred, earth-fixed coordinates, m.
    #[must_use]
    pub fn to_ecef(self) -> [f64; 3] {
        let (lat, lon) = (self.latitude.to_radians(), self.longitude.to_radians());
        let n = prime_vertical_radius(sin(lat));
        [
            (n + self.height) * cos(lat) * cos(lon),
            (n + self.height) * cos(lat) * sin(lon),
            (n * (1.0 - E2) + self.height) * sin(lat),
        ]
    }

    /// Returns the position at earth-centred, earth-fixed coordinates, m, by eight fixed-point iterations.
    #[must_use]
    pub fn from_ecef([x, y, z]: [f64; 3]) -> Self {
        let p = sqrt(x * x + y * y);
        let mut lat = atan2(z, p * (1.0 - E2));
        for _ in 0..8 {
            let n = prime_vertical_radius(sin(lat));
            lat = atan2(z + E2 * n * sin(lat), p);
        }
        // The height is calculated by a formula that has a small rounding error at every latitude.
        let n = prime_vertical_radius(sin(lat));
        let height = p * cos(lat) + z * sin(lat) - SEMI_MAJOR_AXIS * SEMI_MAJOR_AXIS / n;
        Self { latitude: lat.to_degrees(), longitude: atan2(y, x).to_degrees(), height }
    }
}

fn prime_vertical_radius(sin_lat: f64) -> f64 {
    SEMI_MAJOR_AXIS / sqrt(1.0 - E2 * sin_lat * sin_lat)
}

/// A plane that touches the surface of equal height at its origin, with axes north, east, down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentPlane {
    origin: Geodetic,
    origin_ecef: [f64; 3],
    /// The plane's axes north, east and down as unit vectors in ECEF, one in each row.
    axes: [[f64; 3]; 3],
}

impl TangentPlane {
    /// Returns the plane at `origin`.
    #[must_use]
    pub fn new(origin: Geodetic) -> Self {
        let (lat, lon) = (origin.latitude.to_radians(), origin.longitude.to_radians());
        let (sl, cl, so, co) = (sin(lat), cos(lat), sin(lon), cos(lon));
        Self {
            origin,
            origin_ecef: origin.to_ecef(),
            axes: [[-sl * co, -sl * so, cl], [-so, co, 0.0], [-cl * co, -cl * so, -sl]],
        }
    }

    /// The origin, where north = east = down = 0.
    #[must_use]
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// Returns the position `ned` metres north, east and down of the origin.
    #[must_use]
    pub fn to_geodetic(&self, ned: [f64; 3]) -> Geodetic {
        let mut ecef = self.origin_ecef;
        for (metres, axis) in ned.iter().zip(&self.axes) {
            for (sum, unit) in ecef.iter_mut().zip(axis) {
                *sum += metres * unit;
            }
        }
        Geodetic::from_ecef(ecef)
    }

    /// Returns the coordinates of `position`: metres north, east and down of the origin.
    #[must_use]
    pub fn to_ned(&self, position: Geodetic) -> [f64; 3] {
        let [x, y, z] = position.to_ecef();
        let [ox, oy, oz] = self.origin_ecef;
        let d = [x - ox, y - oy, z - oz];
        self.axes.map(|axis| axis.iter().zip(&d).map(|(unit, metres)| unit * metres).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ellipsoid_has_its_published_axes() {
        let equator = Geodetic { latitude: 0.0, longitude: 90.0, height: 0.0 }.to_ecef();
        assert!((equator[1] - 6_378_137.0).abs() < 1e-9 && equator[0].abs() < 1e-9);
        // A pole is one semi-minor axis away from the centre (NIMA TR8350.2, table 3.3).
        let pole = Geodetic { latitude: 90.0, longitude: 0.0, height: 0.0 }.to_ecef();
        assert!((pole[2] - 6_356_752.314_2).abs() < 1e-4, "{pole:?}");
    }

    #[test]
    fn geodetic_and_ecef_are_each_others_inverse() {
        for latitude in [-89.0, -45.0, -0.1, 0.0, 12.3, 47.4979, 89.0] {
            for longitude in [-179.0, -8.7, 0.0, 8.7289, 120.0] {
                for height in [-100.0, 0.0, 470.0, 12_000.0] {
                    let there = Geodetic { latitude, longitude, height };
                    let back = Geodetic::from_ecef(there.to_ecef());
                    assert!((back.latitude - latitude).abs() < 1e-13 * 90.0, "{there:?} {back:?}");
                    assert!((back.longitude - longitude).abs() < 1e-13 * 180.0, "{there:?} {back:?}");
                    assert!((back.height - height).abs() < 5e-9, "{there:?} {back:?}");
                }
            }
        }
    }

    #[test]
    fn the_tangent_plane_touches_the_earth_only_at_its_origin() {
        let origin = Geodetic { latitude: 47.4979, longitude: 8.7289, height: 470.0 };
        let plane = TangentPlane::new(origin);
        let at = plane.to_geodetic([0.0; 3]);
        assert!((at.latitude - origin.latitude).abs() < 1e-12 && (at.height - 470.0).abs() < 1e-8);
        // A point 2 km away on the plane is d²/2R = 0.31 m above the surface of equal height.
        let away = plane.to_geodetic([2_000.0, 0.0, 0.0]);
        assert!((away.height - 470.0 - 0.313).abs() < 0.002, "{away:?}");
        // A sea mile, 1852 m, is about one arc minute of latitude at 45°.
        let north = plane.to_geodetic([1_853.0, 0.0, 0.0]);
        assert!((north.latitude - origin.latitude - 1.0 / 60.0).abs() < 2e-5);
        for ned in [[10.0, -20.0, -60.0], [-3_000.0, 1_500.0, -120.0]] {
            let back = plane.to_ned(plane.to_geodetic(ned));
            for (a, b) in ned.iter().zip(&back) {
                assert!((a - b).abs() < 1e-8, "{ned:?} {back:?}");
            }
        }
    }
}
