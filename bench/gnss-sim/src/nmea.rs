//! NMEA sentences of a u-blox receiver with its factory settings: RMC, VTG and GGA of NMEA 0183 version 4.1x. GLL, GSA,
//! GSV and TXT are left out, because HORUS only has to ignore NMEA.

use crate::ubx::NavPvt;

pub(crate) fn sentences(pvt: &NavPvt) -> Vec<u8> {
    let time = format!("{:02}{:02}{:02}.{:02}", pvt.hour, pvt.minute, pvt.second, pvt.nano.max(0) / 10_000_000);
    let date = format!("{:02}{:02}{:02}", pvt.day, pvt.month, pvt.year % 100);
    let position = format!(
        "{},{},{},{}",
        angle(pvt.latitude_1e7, 2),
        if pvt.latitude_1e7 < 0 { 'S' } else { 'N' },
        angle(pvt.longitude_1e7, 3),
        if pvt.longitude_1e7 < 0 { 'W' } else { 'E' }
    );
    let course = f64::from(pvt.heading_of_motion_1e5) / 1e5;
    let metres_per_second = f64::from(pvt.ground_speed_mm_s) / 1e3;
    // A knot is 1852 m per hour.
    let knots = metres_per_second * 3_600.0 / 1_852.0;
    let geoid = f64::from(pvt.height_mm - pvt.height_msl_mm) / 1e3;
    let height = f64::from(pvt.height_msl_mm) / 1e3;
    let satellites = pvt.satellites.min(12);
    [
        format!("GNRMC,{time},A,{position},{knots:.3},{course:.2},{date},,,A,V"),
        format!("GNVTG,{course:.2},T,,M,{knots:.3},N,{:.3},K,A", metres_per_second * 3.6),
        format!("GNGGA,{time},{position},1,{satellites:02},0.80,{height:.1},M,{geoid:.1},M,,"),
    ]
    .iter()
    .flat_map(|body| {
        let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${body}*{sum:02X}\r\n").into_bytes()
    })
    .collect()
}

/// An angle in NMEA's form: the degrees in `digits` digits, then the minutes.
fn angle(degrees_1e7: i32, digits: usize) -> String {
    let angle = degrees_1e7.unsigned_abs();
    let minutes = f64::from(angle % 10_000_000) * 60.0 / 1e7;
    // The rounding of the minutes to five digits must not give 60 minutes.
    let minutes = minutes.min(59.999_99);
    format!("{:0digits$}{minutes:08.5}", angle / 10_000_000)
}
