//! Exports a recording as CSV, GPX or KML.
//!
//! | form | what |
//! |---|---|
//! | CSV | every object that was shown, each value to the last bit |
//! | GPX 1.1 | the track of each drone by its Reported-Position, where that is valid; interrupted at a gap |
//! | KML 2.2 | the same tracks as in GPX |
//!
//! The output consists of numbers, times and drones' names, without any character to escape, so no library is needed.
//!
//! Heights are above the WGS-84 ellipsoid. KML expects heights above mean sea level, so the track in KML is drawn on
//! the ground.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, Read, Write};

use chrono::{DateTime, SecondsFormat};

use crate::drone::hold::HoldState;
use crate::drone::words;
use crate::intake::{Intake, Judged};
use crate::recorder::{Reader, Record};
use crate::{DroneId, Place, Verdict};

/// The form of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The export has a row for each object.
    Csv,
    /// The export has a track for GPS tools.
    Gpx,
    /// The export has a track for programs that show a globe.
    Kml,
}

/// The names of CSV's columns.
pub const COLUMNS: &str = "time,drone,object,timestamp_ms,age_ms,status,latitude_deg,longitude_deg,altitude_m,\
                           pitch_rad,yaw_rad,roll_rad,ax_m_s2,ay_m_s2,az_m_s2,words";

/// The time without valid positions after which a track is interrupted, µs.
pub const GAP_US: u64 = 2_000_000;

/// Writes a recording, which `reader` reads, in the form of the export. `progress` gets the number of bytes read.
/// Returns the number of written objects (CSV) or points (GPX, KML).
///
/// # Errors
///
/// Returns an error if the recording cannot be read or `to` cannot be written. A recording that is cut off is exported
/// up to the cut ([`Reader::torn`]).
pub fn export<R: Read, W: Write>(
    reader: &mut Reader<R>,
    form: Form,
    to: &mut W,
    mut progress: impl FnMut(u64),
) -> io::Result<u64> {
    let mut intake = Intake::default();
    let mut tracks = Tracks::new();
    let mut written = 0;
    if form == Form::Csv {
        writeln!(to, "{COLUMNS}")?;
    }
    while let Some(record) = reader.next_record()? {
        for judged in judge(&mut intake, &record).iter().filter(|judged| judged.verdict == Verdict::New) {
            let at_us = record.carried.at_us;
            match form {
                Form::Csv => {
                    to.write_all(row(&intake, judged, at_us).as_bytes())?;
                    written += 1;
                }
                Form::Gpx | Form::Kml => {
                    if judged.place == Place::Reported {
                        let position = position(&intake, judged);
                        tracks.entry(judged.drone).or_default().push((at_us, position));
                        written += u64::from(position.is_some());
                    }
                }
            }
        }
        progress(reader.bytes_read());
    }
    match form {
        Form::Csv => {}
        Form::Gpx => gpx(&tracks, to)?,
        Form::Kml => kml(&tracks, to)?,
    }
    to.flush()?;
    Ok(written)
}

/// Judges a record again, and returns the objects that were judged when the record was made. The result is empty if the
/// record's signature was refused then.
pub fn judge(intake: &mut Intake, record: &Record) -> Vec<Judged> {
    intake.take_if(&record.carried, |who, place| {
        let who = who.to_string();
        // A drone's sender may have another number now than when it was recorded, so only the drone's own id is
        // compared.
        let is_of = |drone: &str| drone.strip_prefix(&who).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'));
        record.found.iter().any(|found| found.place == place && is_of(&found.drone))
    })
}

/// Returns an instant in µs since 1970 as text.
#[must_use]
pub fn time(at_us: u64) -> String {
    let time = i64::try_from(at_us).ok().and_then(DateTime::from_timestamp_micros);
    time.map(|time| time.to_rfc3339_opts(SecondsFormat::Micros, true)).unwrap_or_default()
}

fn row(intake: &Intake, judged: &Judged, at_us: u64) -> String {
    let mut row = format!("{},{},{}", time(at_us), judged.drone, judged.place);
    let Some(drone) = intake.fleet().get(judged.drone) else { return row + "\n" };
    let _ = match judged.place {
        Place::LinkStatus => drone.link().map_or(Ok(()), |held| {
            let age_ms = held.age_us(at_us) / 1_000;
            let status = held.values.status;
            let words = if status.link_up() { "up" } else { "down" };
            write!(row, ",{},{age_ms},0x{:04x},,,,,,,,,,{words}", held.timestamp, status.bits())
        }),
        Place::Reported => drone.reported().map_or(Ok(()), |held| {
            let v = &held.values;
            let head = (held.timestamp, held.age_us(at_us) / 1_000, v.status.bits());
            values(&mut row, head, [v.latitude, v.longitude, v.altitude], [v.pitch, v.yaw, v.roll], v.acceleration)?;
            let valid = if v.status.position_valid() { "" } else { "; no position" };
            write!(row, ",{}{valid}", words::state(v.status.state()))
        }),
        Place::Gps(receiver) => drone.gps(usize::from(receiver)).map_or(Ok(()), |held| {
            let v = &held.values;
            let head = (held.timestamp, held.age_us(at_us) / 1_000, v.status.bits());
            values(&mut row, head, [v.latitude, v.longitude, v.altitude], [v.pitch, v.yaw, v.roll], v.acceleration)?;
            let valid = if v.status.position_valid() { "" } else { "; no position" };
            write!(row, ",{}{valid}", words::fix(v.status.fix_type()))
        }),
        Place::PortStatus => drone.port_status().map_or(Ok(()), |held| {
            let (status, age_ms) = (held.values.status, held.age_us(at_us) / 1_000);
            let words = if status.last_refused() { "last refused" } else { "none refused" };
            write!(row, ",{},{age_ms},0x{:04x},,,,,,,,,,{words}", held.timestamp, status.bits())
        }),
        // An uplink has no known age, because its timestamp is on the clock of the base station that sent it.
        Place::Uplink => drone.uplink().map_or(Ok(()), |uplink| {
            write!(row, ",{},,0x{:04x},,,,,,,,,,", uplink.timestamp(), uplink.values().status.bits())
        }),
        Place::Hold => drone.hold().and_then(HoldState::held).map_or(Ok(()), |held| {
            let v = &held.values;
            write!(row, ",{},{},0x{:04x},,,,,,,,,,", v.timestamp, held.age_us(at_us) / 1_000, v.status.bits())?;
            let [x, y, z] = v.vibration;
            let named = [
                ("temperature_c", v.temperature),
                ("humidity_percent", v.humidity),
                ("set_point_c", v.set_point),
                ("vibration_x_m_s2", x),
                ("vibration_y_m_s2", y),
                ("vibration_z_m_s2", z),
                ("greatest_shock_m_s2", v.greatest_shock),
                ("supply_v", v.supply),
                ("output", v.output),
            ];
            named.iter().enumerate().try_for_each(|(index, (name, value))| {
                write!(row, "{}{name} {value}", if index == 0 { "" } else { "; " })
            })
        }),
    };
    row + "\n"
}

/// Writes the values of an object with all digits that distinguish a number from every other. Unknown values are left
/// out.
fn values(
    row: &mut String,
    (timestamp, age_ms, status): (u32, u64, u16),
    position: [f64; 3],
    attitude: [f32; 3],
    acceleration: [f32; 3],
) -> std::fmt::Result {
    write!(row, ",{timestamp},{age_ms},0x{status:04x}")?;
    for value in position {
        if value.is_nan() { row.push(',') } else { write!(row, ",{value}")? }
    }
    for value in attitude.into_iter().chain(acceleration) {
        if value.is_nan() { row.push(',') } else { write!(row, ",{value}")? }
    }
    Ok(())
}

fn position(intake: &Intake, judged: &Judged) -> Option<[f64; 3]> {
    let held = intake.fleet().get(judged.drone)?.reported().filter(|_| judged.place == Place::Reported)?;
    let values = &held.values;
    values.status.position_valid().then_some([values.latitude, values.longitude, values.altitude])
}

type Tracks = BTreeMap<DroneId, Vec<(u64, Option<[f64; 3]>)>>;

fn segments(points: &[(u64, Option<[f64; 3]>)]) -> impl Iterator<Item = Vec<(u64, [f64; 3])>> {
    let valid = points.split(|(_, position)| position.is_none());
    let near =
        |(one, _): &(u64, Option<[f64; 3]>), (next, _): &(u64, Option<[f64; 3]>)| next.saturating_sub(*one) <= GAP_US;
    let runs = valid.flat_map(move |run| run.chunk_by(near));
    runs.map(|run| run.iter().filter_map(|(at_us, position)| Some((*at_us, (*position)?))).collect())
}

fn gpx(tracks: &Tracks, to: &mut impl Write) -> io::Result<()> {
    writeln!(to, r#"<?xml version="1.0" encoding="UTF-8"?>"#)?;
    writeln!(to, r#"<gpx version="1.1" creator="horus-base" xmlns="http://www.topografix.com/GPX/1/1">"#)?;
    for (drone, points) in tracks {
        writeln!(to, "<trk><name>{drone}</name><desc>heights above the WGS-84 ellipsoid</desc>")?;
        for segment in segments(points) {
            writeln!(to, "<trkseg>")?;
            for (at_us, [latitude, longitude, altitude]) in segment {
                write!(to, r#"<trkpt lat="{latitude}" lon="{longitude}">"#)?;
                if !altitude.is_nan() {
                    write!(to, "<ele>{altitude}</ele>")?;
                }
                writeln!(to, "<time>{}</time></trkpt>", time(at_us))?;
            }
            writeln!(to, "</trkseg>")?;
        }
        writeln!(to, "</trk>")?;
    }
    writeln!(to, "</gpx>")
}

fn kml(tracks: &Tracks, to: &mut impl Write) -> io::Result<()> {
    writeln!(to, r#"<?xml version="1.0" encoding="UTF-8"?>"#)?;
    writeln!(to, r#"<kml xmlns="http://www.opengis.net/kml/2.2"><Document>"#)?;
    for (drone, points) in tracks {
        writeln!(to, "<Placemark><name>{drone}</name><MultiGeometry>")?;
        for segment in segments(points) {
            write!(to, "<LineString><altitudeMode>clampToGround</altitudeMode><coordinates>")?;
            for (_, [latitude, longitude, altitude]) in segment {
                let altitude = if altitude.is_nan() { 0.0 } else { altitude };
                write!(to, "{longitude},{latitude},{altitude} ")?;
            }
            writeln!(to, "</coordinates></LineString>")?;
        }
        writeln!(to, "</MultiGeometry></Placemark>")?;
    }
    writeln!(to, "</Document></kml>")
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use profile::{GpsValues, Profile, ReportedStatus, ReportedValues};

    use super::*;
    use crate::intake::{Carried, Kind};
    use crate::recorder::{Parts, Recorder};

    #[derive(Clone, Default)]
    struct Memory(Rc<RefCell<Vec<u8>>>);

    impl Write for Memory {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.borrow_mut().extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Parts for Memory {
        type Part = Self;

        fn make(&mut self, _number: u32) -> io::Result<Self> {
            Ok(self.clone())
        }

        fn sync(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn recording() -> Vec<u8> {
        let memory = Memory::default();
        let mut recorder = Recorder::new(memory.clone());
        let mut intake = Intake::default();
        for (cycle, altitude) in [(0_u32, 470.125), (1, f64::NAN)] {
            let timestamp = 70_000 + 100 * cycle;
            let status = ReportedStatus::new().with_position_valid(true);
            let (latitude, longitude) = (47.497_912_345_678_91, 8.1 + f64::from(cycle) / 8.0);
            let reported =
                ReportedValues { status, latitude, longitude, altitude, ..ReportedValues::absent(timestamp) };
            let bytes = Profile::seal(&reported, &[GpsValues::absent(timestamp)]).as_bytes().to_vec();
            let at_us = 1_790_000_000_000_000 + 100_000 * u64::from(cycle);
            let carried = Carried { at_us, kind: Kind::Datagrams, line: 0, from: "127.0.0.1:4000".into(), bytes };
            let judged = intake.take(&carried);
            recorder.carried(&carried, &judged, &[]);
        }
        recorder.finish().unwrap();
        memory.0.take()
    }

    #[test]
    fn a_track_is_broken_where_nothing_valid_came() {
        let place = Some([47.0, 8.0, 470.0]);
        let at = |second: u64, position| (second * 1_000_000, position);
        let points = [at(0, place), at(2, place), at(5, place), at(6, None), at(7, place), at(8, place)];
        let found: Vec<Vec<u64>> =
            segments(&points).map(|part| part.iter().map(|(at, _)| at / 1_000_000).collect()).collect();
        assert_eq!(found, [vec![0, 2], vec![5], vec![7, 8]]);
    }

    fn exported(form: Form) -> (u64, String) {
        let recording = recording();
        let (mut out, mut read) = (vec![], 0);
        let count = export(&mut Reader::new(&recording[..]), form, &mut out, |bytes| read = bytes).unwrap();
        assert!(read > 0 && read <= recording.len() as u64);
        (count, String::from_utf8(out).unwrap())
    }

    #[test]
    fn csv_has_every_object_to_the_last_bit() {
        let (count, csv) = exported(Form::Csv);
        let rows: Vec<_> = csv.lines().collect();
        assert_eq!((count, rows.len(), rows[0]), (4, 5, COLUMNS));
        let columns: Vec<_> = rows[1].split(',').collect();
        assert_eq!(columns.len(), COLUMNS.split(',').count());
        assert_eq!(
            columns[..6],
            ["2026-09-21T14:13:20.000000Z", "127.0.0.1:4000", "Reported-Position", "70000", "0", "0x0008"]
        );
        assert_eq!(columns[6].parse(), Ok(47.497_912_345_678_91_f64));
        assert_eq!(columns[8..], ["470.125", "", "", "", "", "", "", "starting"]);
        assert!(rows.iter().all(|row| row.split(',').count() == columns.len()));
    }

    #[test]
    fn gpx_and_kml_have_the_track_of_valid_positions() {
        let (count, gpx) = exported(Form::Gpx);
        assert_eq!((count, gpx.matches("<trkpt").count(), gpx.matches("<ele>470.125</ele>").count()), (2, 2, 1));
        assert!(gpx.contains(r#"<trkpt lat="47.49791234567891" lon="8.225"><time>2026-09-21T14:13:20.100000Z</time>"#));
        let (count, kml) = exported(Form::Kml);
        assert_eq!(count, 2);
        assert!(kml.contains("<coordinates>8.1,47.49791234567891,470.125 8.225,47.49791234567891,0 </coordinates>"));
    }
}
