//! Encodes a recording's messages in the serialisation of ROS 1, which MCAP tools read with the schema in the file.
//! Numbers are little-endian without padding. Strings and arrays follow their length, a u32.

use profile::hold::{HoldCommand, Words};
use profile::{HoldValues, LinkValues, ReportedValues};

use crate::carrier::mavlink::commander::{CommandRecord, CommandState};
use crate::carrier::mavlink::voice::UplinkChange;
use crate::drone::words;
use crate::intake::{Carried, Judged, Kind};
use crate::{Alarm, DroneId, Place, Verdict};

#[derive(Clone, Copy, Debug)]
pub(super) struct Schema {
    pub(super) name: &'static str,
    pub(super) text: &'static str,
}

pub(super) const CARRIED: Schema = Schema {
    name: "horus_msgs/Carried",
    text: "# Bytes as they arrived at the base station, and what was found of each object in them.
uint8 MAVLINK_DATAGRAMS=1
uint8 MAVLINK_STREAM=2
uint8 DATAGRAMS=3
uint8 STREAM=4
uint8 PUBLISHED=5
uint64 at_us        # since 1970
uint8 kind          # how the line brings objects
uint16 line         # which socket or port
string from         # the datagram's sender, or STATION/DRONE of what another station published
uint8[] bytes       # unchanged
string[] drones     # of each object: which drone
uint8[] places      # 0 Link-Status, 1 Reported-Position, 2 to 6 GPS1 to GPS5, 7 Port-Status, 8 uplink, 9 Hold-Status
string[] verdicts   # new, duplicate, older, out-of-sequence, vacant, or why it was rejected
",
};

pub(super) const ALARM: Schema = Schema {
    name: "horus_msgs/Alarm",
    text: "# An alarm came or went.
string drone
string alarm
bool raised
string words
",
};

pub(super) const FIX: Schema = Schema {
    name: "sensor_msgs/NavSatFix",
    text: "std_msgs/Header header
sensor_msgs/NavSatStatus status
float64 latitude    # degrees, north positive
float64 longitude   # degrees, east positive
float64 altitude    # m above the WGS-84 ellipsoid
float64[9] position_covariance
uint8 position_covariance_type
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
================================================================================
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service
",
};

pub(super) const STATE: Schema = Schema {
    name: "horus_msgs/State",
    text: "# What HORUS says of itself in Reported-Position. What is not known is NaN.
uint32 timestamp_ms         # since HORUS's start
string state                # in words
uint8 state_code            # bits 8 to 11 of the status
uint8 receivers_agreeing
bool degraded
bool position_valid
bool memory_fault
bool without_crystal
float32 pitch               # rad
float32 yaw                 # rad, from true north, clockwise
float32 roll                # rad
float32[3] acceleration     # m/s2, front, right, down, gravity removed
",
};

pub(super) const LINK: Schema = Schema {
    name: "horus_msgs/Link",
    text: "# Link-Status, as the DPR sealed it.
uint32 timestamp_ms         # since the DPR's start
uint16 status               # its bits
bool up
uint32 objects_accepted
uint32 objects_rejected
uint32 frames_received
uint32 frames_missed
uint16 access_violations
float32 sample_age_ms       # of Reported-Position when the image was made
",
};

pub(super) const UPLINK: Schema = Schema {
    name: "horus_msgs/Uplink",
    text: "# An uplink object that this station sends to a drone's DPR, and what is known of it now.
string drone
uint32 timestamp_ms         # the object's
uint16 status               # the object's
uint8[] payload             # the object's
string state                # sent, written, refused, unanswered
string why                  # it was refused
",
};

pub(super) const HOLD: Schema = Schema {
    name: "horus_msgs/Hold",
    text: "# Hold-Status, as the active hold sealed it. What is not known is NaN.
uint32 timestamp_ms         # since the hold's start
uint16 status               # its bits
float32 temperature         # deg C
float32 humidity            # %
float32 set_point           # deg C
float32[3] vibration        # m/s2, RMS of the last second, x, y, z
float32 greatest_shock      # m/s2
float32 supply              # V
float32 output              # -1 cooling to 1 heating
uint16 base_station_number  # of the base station's last command that the hold acknowledged
uint16 base_station_outcome # 0 none yet, 1 done, 2 refused, 3 unknown, 4 too old
uint16 flight_controller_number
uint16 flight_controller_outcome
uint32 seconds              # since the hold's start
",
};

pub(super) const COMMAND: Schema = Schema {
    name: "horus_msgs/HoldCommand",
    text: "# A command that this station sends to a drone's active hold, and what is known of it now.
string drone
uint16 number               # the command's sequence number
uint16 word                 # 1 set-point, 2 lock, 3 unlock, 4 clear the greatest shock
float32 value               # of a set-point, deg C
string state                # pending, done, refused, unknown, too-old, lost
uint64 since_us             # since 1970: when it was given
uint64 at_us                # since 1970: when it came into this state
",
};

fn put(out: &mut Vec<u8>, bytes: &[u8]) {
    // Arrays are far shorter than 4 GiB. A longer array would be cut off, and the message would still be readable.
    let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
    out.extend(length.to_le_bytes());
    out.extend(bytes.iter().take(length as usize));
}

fn put_all<'a>(out: &mut Vec<u8>, items: impl ExactSizeIterator<Item = &'a str>) {
    out.extend(u32::try_from(items.len()).unwrap_or(u32::MAX).to_le_bytes());
    for item in items {
        put(out, item.as_bytes());
    }
}

pub(super) fn carried(carried: &Carried, judged: &[Judged]) -> Vec<u8> {
    let mut out = vec![];
    out.extend(carried.at_us.to_le_bytes());
    out.push(carried.kind as u8);
    out.extend(carried.line.to_le_bytes());
    put(&mut out, carried.from.as_bytes());
    put(&mut out, &carried.bytes);
    let drones: Vec<String> = judged.iter().map(|judged| judged.drone.to_string()).collect();
    put_all(&mut out, drones.iter().map(String::as_str));
    let places: Vec<u8> = judged.iter().filter_map(|judged| u8::try_from(judged.place.index()).ok()).collect();
    put(&mut out, &places);
    put_all(&mut out, judged.iter().map(|judged| judged.verdict.code()));
    out
}

pub(super) fn alarm(drone: DroneId, alarm: Alarm, raised: bool) -> Vec<u8> {
    let mut out = vec![];
    put(&mut out, drone.to_string().as_bytes());
    put(&mut out, alarm.code().as_bytes());
    out.push(u8::from(raised));
    put(&mut out, alarm.words().as_bytes());
    out
}

pub(super) fn state(values: &ReportedValues) -> Vec<u8> {
    let mut out = values.timestamp.to_le_bytes().to_vec();
    let status = values.status;
    put(&mut out, words::state(status.state()).as_bytes());
    out.push((status.bits() >> 8 & 0x0F) as u8);
    out.push(status.receivers_agreeing());
    let bits = [status.degraded(), status.position_valid(), status.memory_fault(), status.without_crystal()];
    out.extend(bits.map(u8::from));
    for value in [values.pitch, values.yaw, values.roll].into_iter().chain(values.acceleration) {
        out.extend(value.to_le_bytes());
    }
    out
}

pub(super) fn link(values: &LinkValues) -> Vec<u8> {
    let mut out = values.timestamp.to_le_bytes().to_vec();
    out.extend(values.status.bits().to_le_bytes());
    out.push(u8::from(values.status.link_up()));
    let counts = [values.objects_accepted, values.objects_rejected, values.frames_received, values.frames_missed];
    counts.iter().for_each(|count| out.extend(count.to_le_bytes()));
    out.extend(values.access_violations.to_le_bytes());
    out.extend((f32::from(values.age_100us) / 10.0).to_le_bytes());
    out
}

pub(super) fn uplink(told: &UplinkChange) -> Vec<u8> {
    let mut out = vec![];
    let values = told.uplink.values();
    put(&mut out, told.drone.to_string().as_bytes());
    out.extend(values.timestamp.to_le_bytes());
    out.extend(values.status.bits().to_le_bytes());
    put(&mut out, &values.payload);
    put(&mut out, told.state.code().as_bytes());
    put(&mut out, told.state.why().unwrap_or_default().as_bytes());
    out
}

pub(super) fn hold(values: &HoldValues) -> Vec<u8> {
    let mut out = values.timestamp.to_le_bytes().to_vec();
    out.extend(values.status.bits().to_le_bytes());
    let [x, y, z] = values.vibration;
    let HoldValues { temperature, humidity, set_point, greatest_shock, supply, output, .. } = *values;
    for value in [temperature, humidity, set_point, x, y, z, greatest_shock, supply, output] {
        out.extend(value.to_le_bytes());
    }
    for acknowledged in values.acknowledged {
        out.extend(acknowledged.number().to_le_bytes());
        out.extend(acknowledged.code().to_le_bytes());
    }
    out.extend(values.seconds.to_le_bytes());
    out
}

pub(super) fn command(told: &CommandRecord) -> Vec<u8> {
    let mut out = vec![];
    let (word, value) = told.command.encode();
    put(&mut out, told.drone.as_bytes());
    out.extend(told.number.to_le_bytes());
    out.extend(word.to_le_bytes());
    out.extend(value.to_le_bytes());
    put(&mut out, told.state.code().as_bytes());
    out.extend(told.since_us.to_le_bytes());
    out.extend(told.at_us.to_le_bytes());
    out
}

/// Decodes a [`COMMAND`] message; `None` if `data` are no such message.
pub(super) fn read_command(data: &[u8]) -> Option<CommandRecord> {
    let mut rest = data;
    let drone = string(&mut rest)?;
    let number = u16::from_le_bytes(*take::<2>(&mut rest)?);
    let word = u16::from_le_bytes(*take::<2>(&mut rest)?);
    let command = HoldCommand::decode(word, f32::from_le_bytes(*take::<4>(&mut rest)?))?;
    let state = string(&mut rest)?;
    let state = CommandState::ALL.into_iter().find(|known| known.code() == state)?;
    let since_us = u64::from_le_bytes(*take::<8>(&mut rest)?);
    let at_us = u64::from_le_bytes(*take::<8>(&mut rest)?);
    rest.is_empty().then_some(CommandRecord { drone, number, command, state, since_us, at_us })
}

pub(super) fn fix(at_us: u64, [latitude, longitude, altitude]: [f64; 3]) -> Vec<u8> {
    let mut out = vec![];
    out.extend(0_u32.to_le_bytes());
    let (seconds, rest_us) = (at_us / 1_000_000, at_us % 1_000_000);
    out.extend(u32::try_from(seconds).unwrap_or(u32::MAX).to_le_bytes());
    out.extend(u32::try_from(rest_us * 1_000).unwrap_or_default().to_le_bytes());
    put(&mut out, b"wgs84");
    out.push(0);
    out.extend(0_u16.to_le_bytes());
    for value in [latitude, longitude, altitude] {
        out.extend(value.to_le_bytes());
    }
    out.extend([0; 9 * 8]);
    out.push(0);
    out
}

/// An object in a recording, with the recorded verdict.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// The id of the drone as text.
    pub drone: String,
    /// The kind of the object.
    pub place: Place,
    /// The [code](Verdict::code) of the verdict.
    pub verdict: String,
}

/// Decodes a [`CARRIED`] message; `None` if `data` are no such message.
pub(super) fn read_carried(data: &[u8]) -> Option<(Carried, Vec<Found>)> {
    let mut rest = data;
    let at_us = u64::from_le_bytes(*take::<8>(&mut rest)?);
    let [kind] = *take::<1>(&mut rest)?;
    let line = u16::from_le_bytes(*take::<2>(&mut rest)?);
    let from = string(&mut rest)?;
    let bytes = array(&mut rest)?.to_vec();
    let drones = strings(&mut rest)?;
    let places = array(&mut rest)?;
    let verdicts = strings(&mut rest)?;
    let known = rest.is_empty() && drones.len() == places.len() && drones.len() == verdicts.len();
    let found = drones.into_iter().zip(places).zip(verdicts).map(|((drone, place), verdict)| {
        let place = Place::ALL.get(usize::from(*place)).copied()?;
        Some(Found { drone, place, verdict })
    });
    let found = found.collect::<Option<Vec<_>>>().filter(|_| known)?;
    Some((Carried { at_us, kind: Kind::of(kind)?, line, from, bytes }, found))
}

pub(super) fn take<'a, const N: usize>(rest: &mut &'a [u8]) -> Option<&'a [u8; N]> {
    let (taken, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(taken)
}

pub(super) fn array<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = u32::from_le_bytes(*take::<4>(rest)?);
    let (taken, after) = rest.split_at_checked(usize::try_from(length).ok()?)?;
    *rest = after;
    Some(taken)
}

pub(super) fn string(rest: &mut &[u8]) -> Option<String> {
    String::from_utf8(array(rest)?.to_vec()).ok()
}

fn strings(rest: &mut &[u8]) -> Option<Vec<String>> {
    let count = u32::from_le_bytes(*take::<4>(rest)?);
    // Each string takes at least four bytes. So even a wrong count cannot cause more work than there are bytes.
    (0..count).map(|_| string(rest)).collect()
}

impl Found {
    /// Returns whether the object was shown.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.verdict == Verdict::New.code()
    }
}

#[cfg(test)]
mod tests {
    use profile::criticality::{BaseStation, Writer};
    use profile::{Rejection, Uplink, UplinkValues};
    use proptest::prelude::*;

    use super::*;
    use crate::Who;
    use crate::carrier::mavlink::voice::State;

    proptest! {
        #[test]
        fn what_is_written_is_read(
            at_us in any::<u64>(), kind in 1..6_u8, line in any::<u16>(), from in ".{0,20}",
            bytes in prop::collection::vec(any::<u8>(), 0..400), objects in prop::collection::vec(0..7_usize, 0..7),
        ) {
            let arrived = Carried { at_us, kind: Kind::of(kind).unwrap(), line, from, bytes };
            let verdict = Verdict::Rejected(Rejection::Crc);
            let judged: Vec<_> = objects
                .iter()
                .map(|index| Judged { drone: Who::System(7).first(), place: Place::ALL[*index], verdict })
                .collect();
            let written = carried(&arrived, &judged);
            let (read, found) = read_carried(&written).unwrap();
            prop_assert_eq!(read, arrived);
            prop_assert_eq!(found.len(), judged.len());
            prop_assert!(found.iter().all(|found| found.drone == "7" && found.verdict == "crc" && !found.is_new()));
            for end in 0..written.len() {
                prop_assert!(read_carried(&written[..end]).is_none());
            }
        }

        #[test]
        fn anything_may_be_in_a_file(data in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = read_carried(&data);
        }
    }

    fn length(schema: Schema, text: usize) -> usize {
        let kinds = schema.text.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split(' ').next());
        let size = |kind| match kind {
            "bool" | "uint8" => 1,
            "uint16" => 2,
            "uint32" | "float32" | "string" | "uint8[]" => 4,
            "uint64" => 8,
            "float32[3]" => 12,
            other => panic!("{other}"),
        };
        kinds.map(size).sum::<usize>() + text
    }

    #[test]
    fn state_link_and_uplink_have_the_lengths_that_their_schemas_give() {
        let values = ReportedValues { pitch: 0.5, ..ReportedValues::absent(0x0102_0304) };
        let made = state(&values);
        assert_eq!(made.len(), length(STATE, "starting".len()));
        assert_eq!(
            (&made[..4], &made[8..16], &made[22..26]),
            (&[4, 3, 2, 1][..], &b"starting"[..], &[0, 0, 0, 0x3F][..])
        );
        let made = link(&LinkValues { frames_missed: 7, age_100us: 55, ..LinkValues::default() });
        assert_eq!(made.len(), length(LINK, 0));
        assert_eq!((&made[19..23], &made[25..]), (&[7, 0, 0, 0][..], &5.5_f32.to_le_bytes()[..]));
        let uplink_object = Uplink::seal(Writer::<BaseStation>::claim(), &UplinkValues::default());
        let (drone, why) = (Who::System(7).first(), "why".to_owned());
        let made = uplink(&UplinkChange { drone, uplink: uplink_object, state: State::Refused(why) });
        assert_eq!(made.len(), length(UPLINK, "7".len() + 52 + "refused".len() + "why".len()));
    }

    #[test]
    fn a_hold_and_its_command_have_the_lengths_that_their_schemas_give() {
        let values = HoldValues { output: -0.5, seconds: 9, ..HoldValues::absent(0x0102_0304) };
        let made = hold(&values);
        assert_eq!(made.len(), length(HOLD, 0));
        assert_eq!((&made[..4], &made[38..42]), (&[4, 3, 2, 1][..], &(-0.5_f32).to_le_bytes()[..]));
        assert_eq!(made[50..], [9, 0, 0, 0]);
        for (state, word) in CommandState::ALL.into_iter().zip([1_u16, 2, 3, 4, 1, 1]) {
            let command = HoldCommand::decode(word, if word == 1 { 21.5 } else { 0.0 }).unwrap();
            let told = CommandRecord { drone: "7-2".into(), number: 513, command, state, since_us: 5, at_us: 6 };
            let made = super::command(&told);
            assert_eq!(made.len(), length(COMMAND, "7-2".len() + state.code().len()));
            assert_eq!(read_command(&made), Some(told));
            assert!((0..made.len()).all(|end| read_command(&made[..end]).is_none()));
        }
    }

    #[test]
    fn a_fix_has_the_length_that_its_schema_gives() {
        assert_eq!(fix(1_500_000, [1.0, 2.0, 3.0]).len(), 21 + 3 + 12 * 8 + 1);
        assert_eq!(fix(1_500_000, [1.0, 2.0, 3.0])[4..12], [1, 0, 0, 0, 0x00, 0x65, 0xCD, 0x1D]);
    }
}
