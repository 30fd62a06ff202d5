//! Whether Reported-Position follows from the GPS objects of its cycle.
//!
//! Kept simple until a voter is there, whose rule will say which value it must be: if it is valid, it lies within the
//! box that the valid GPS positions span (each coordinate by itself, the borders included), there are as many valid
//! GPS positions as it claims receivers that agree, and if it is not valid it has no position.

use profile::{ABSENT_F64, GpsValues, ReportedValues};

/// What is wrong with Reported-Position beside these GPS objects, if anything is.
pub(super) fn fault<'a>(reported: &ReportedValues, gps: impl Iterator<Item = &'a GpsValues> + Clone) -> Option<String> {
    let valid = gps.filter(|gps| gps.status.position_valid());
    let (count, agreeing) = (valid.clone().count(), usize::from(reported.status.receivers_agreeing()));
    if agreeing > count {
        return Some(format!("it claims {agreeing} receivers that agree, and {count} have a valid position"));
    }
    let place = [reported.latitude, reported.longitude, reported.altitude];
    if !reported.status.position_valid() {
        let absent = place.iter().all(|value| value.to_bits() == ABSENT_F64.to_bits());
        return (!absent).then(|| "it has a position and says that it is not valid".to_owned());
    }
    if count == 0 {
        return Some("it is valid, and no GPS object is".to_owned());
    }
    let names = ["latitude", "longitude", "altitude"];
    let coordinates: [fn(&GpsValues) -> f64; 3] = [|gps| gps.latitude, |gps| gps.longitude, |gps| gps.altitude];
    for ((name, value), of) in names.into_iter().zip(place).zip(coordinates) {
        // A 2D fix has no altitude; where there is none at all, Reported-Position has none either.
        let (least, most) = valid
            .clone()
            .map(of)
            .filter(|value| !value.is_nan())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| (least.min(value), most.max(value)));
        let across_the_date_line = name == "longitude" && most - least > 180.0;
        let missing = value.is_nan() && name != "altitude";
        if missing || !value.is_nan() && !across_the_date_line && !(least..=most).contains(&value) {
            return Some(format!("its {name} is {value}, those of the GPS objects are {least} to {most}"));
        }
    }
    None
}
