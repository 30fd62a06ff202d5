//! The invariants that hold for every input of every parser. Each fuzz target and the replay of its corpus check one of
//! them. A CRC-32 rejects nearly every mutated input, so each input is checked as it is and with right identifiers and
//! CRCs, which the parser must accept.
use profile::{
    Command, CommandObject, GpsObject, GpsStatus, HoldCommand, HoldObject, HoldStatus, HoldStatusBits, Identifier,
    LinkStatus, LinkStatusBits, Object, PortStatus, PortStatusBits, Profile, Rejection, ReportedPosition,
    ReportedStatus, Uplink, air,
    criticality::{ActiveLoad, BaseStation, Dpr, FlightController, Function, Writer},
    hold::{Answer, Commands, Executed, Intake},
    image::Image,
    map::Map,
    ssi::{
        self, Parsed,
        client::{AGE_UNKNOWN, Verdict},
    },
    uplink::Written,
};

use super::reference;
use super::tape::{self, TransactionData};

/// Panics if a parser's invariant does not hold for an input.
pub(crate) type Invariant = fn(&[u8]);

pub(crate) const ALL: [(&str, Invariant); 12] = [
    ("client", client),
    ("reported_position", reported_position),
    ("gps_object", gps_object),
    ("link_status", link_status),
    ("profile", profile),
    ("air_frame", air_frame),
    ("image", image),
    ("ssi_request", ssi_request),
    ("port_status", port_status),
    ("written", written),
    ("map", map),
    ("hold", hold),
];

pub(crate) fn report(told: &TransactionData<'_>) {
    let TransactionData { began_us: _, config, report } = told;
    if let Some(position) = &report.position {
        assert!(report.age_us <= config.age_limit_us, "an old position is not shown");
        assert!(report.age_us != AGE_UNKNOWN, "nor one whose age cannot be told");
        assert!(position.status.position_valid(), "an invalid position is not shown");
        assert!(position.latitude.abs() <= 90.0 && position.longitude.abs() <= 180.0, "it is on the earth");
        let altitude = position.altitude;
        assert!((-1_000.0..=20_000.0).contains(&altitude) || altitude.is_nan(), "{altitude} m");
        assert_eq!(report.status.map(ReportedStatus::position_valid), Some(true), "the status is of the position");
        let attitude = [position.pitch, position.yaw, position.roll];
        let known = |values: [f32; 3], valid: bool| {
            assert!(values.iter().all(|value| value.is_finite() == valid && value.is_nan() != valid), "{values:?}");
        };
        known(attitude, position.status.attitude_valid());
        known(position.acceleration, position.status.acceleration_valid());
    }
    let old = report.age_us > config.age_limit_us || report.age_us == AGE_UNKNOWN;
    assert!(report.verdict != Verdict::Invalid || report.status.is_some() || old, "without a position the state stays");
    assert!(report.status.is_none() || !old, "an old state is not shown");
    assert!(!report.must_fall_back() || report.verdict != Verdict::Fresh, "what is fresh is shown");
    let hidden = [Verdict::Searching, Verdict::OutOfSequence, Verdict::Invalid, Verdict::Stale];
    assert!(report.must_fall_back() || !hidden.contains(&report.verdict), "{:?} takes it away", report.verdict);
    let image = [Verdict::Fresh, Verdict::Same, Verdict::Empty].contains(&report.verdict);
    assert!(!image && !hidden.contains(&report.verdict) || report.link.is_some(), "an image has Link-Status");
}

pub(crate) fn client(input: &[u8]) {
    let said = tape::play(input, |told| report(&told));
    assert_eq!(said, tape::play(input, |_| {}), "the same tape, the same reports");
}

pub(crate) fn reported_position(input: &[u8]) {
    judge_reported_position(input);
    if input.len() == ReportedPosition::SIZE {
        let mut repaired = input.to_vec();
        reference::repair_frame_crc(&mut repaired);
        judge_reported_position(&repaired);
        reference::repair(&mut repaired, 0);
        assert!(judge_reported_position(&repaired), "put right, it is accepted");
    }
}

pub(crate) fn gps_object(input: &[u8]) {
    for index in 1..=5 {
        judge_gps_object(input, index);
        if input.len() == GpsObject::SIZE {
            let mut repaired = input.to_vec();
            reference::repair_frame_crc(&mut repaired);
            judge_gps_object(&repaired, index);
            reference::repair(&mut repaired, index);
            assert!(judge_gps_object(&repaired, index), "put right, it is accepted");
            assert!(!judge_gps_object(&repaired, index % 5 + 1), "but not in another's place");
        }
    }
}

pub(crate) fn link_status(input: &[u8]) {
    judge_link_status(input);
    if input.len() == LinkStatus::SIZE {
        let mut repaired = input.to_vec();
        reference::repair_frame_crc(&mut repaired);
        judge_link_status(&repaired);
        repaired[4..6].copy_from_slice(&0x4400_u16.to_le_bytes());
        reference::repair_frame_crc(&mut repaired);
        assert!(judge_link_status(&repaired), "put right, it is accepted");
    }
}

pub(crate) fn profile(input: &[u8]) {
    profile_of::<1>(input);
    profile_of::<2>(input);
    profile_of::<3>(input);
    profile_of::<5>(input);
}

pub(crate) fn air_frame(input: &[u8]) {
    air_frame_of::<1>(input);
    air_frame_of::<2>(input);
    air_frame_of::<3>(input);
    air_frame_of::<5>(input);
}

pub(crate) fn image(input: &[u8]) {
    image_of::<1>(input);
    image_of::<2>(input);
    image_of::<3>(input);
    image_of::<5>(input);
}

pub(crate) fn ssi_request(input: &[u8]) {
    let Some(request) = input.first_chunk() else { return };
    let mut repaired = *request;
    reference::repair_frame_crc(&mut repaired);
    for map_len in [0, 1, 348, 408, 468, 588, 0xFFFF, 0x1_FFFE, usize::MAX] {
        judge_ssi_request(request, map_len);
        judge_ssi_request(&repaired, map_len);
    }
}

pub(crate) fn port_status(input: &[u8]) {
    judge_port_status(input);
    if input.len() == PortStatus::SIZE {
        let mut repaired = input.to_vec();
        repaired[4..6].copy_from_slice(&0x4401_u16.to_le_bytes());
        reference::repair_frame_crc(&mut repaired);
        assert!(judge_port_status(&repaired), "put right, it is accepted");
    }
}

pub(crate) fn written(input: &[u8]) {
    judge_written(input);
    if input.len() == Uplink::SIZE {
        for identifier in [0x4200_u16, 0x4300, 0x4301] {
            let mut repaired = input.to_vec();
            repaired[4..6].copy_from_slice(&identifier.to_le_bytes());
            reference::repair_frame_crc(&mut repaired);
            assert!(judge_written(&repaired) || identifier == 0x4301, "put right, an uplink is accepted");
            for word in [*b"CLRC", *b"TEST"] {
                repaired[8..12].copy_from_slice(&word);
                repaired[12..60].fill(0);
                reference::repair_frame_crc(&mut repaired);
                assert!(judge_written(&repaired), "put right, it is accepted");
            }
        }
    }
}

pub(crate) fn map(input: &[u8]) {
    map_of::<1>(input);
    map_of::<2>(input);
    map_of::<3>(input);
    map_of::<5>(input);
}

fn judge_reported_position(bytes: &[u8]) -> bool {
    let judged = ReportedPosition::verify(bytes);
    assert_eq!(judged.err(), reference::object_of_profile(bytes, 0));
    let Ok(object) = judged else { return false };
    assert_eq!(object.as_bytes(), bytes);
    assert_eq!(Object::verify(0, bytes), Ok(Object::Reported(object)));
    let again = ReportedPosition::seal(&object.values());
    seals_the_same(again.as_bytes(), bytes, ReportedStatus::USED);
    assert_eq!(ReportedPosition::verify(&with_a_flipped_bit(bytes)), Err(Rejection::Crc));
    true
}

fn judge_gps_object(bytes: &[u8], index: usize) -> bool {
    let identifier = Identifier::gps(index);
    let judged = GpsObject::verify(bytes, identifier);
    assert_eq!(judged.err(), reference::object_of_profile(bytes, index));
    let Ok(object) = judged else { return false };
    assert_eq!(object.as_bytes(), bytes);
    assert_eq!(Object::verify(index, bytes), Ok(Object::Gps(object)));
    let again = GpsObject::seal(identifier, &object.values());
    seals_the_same(again.as_bytes(), bytes, GpsStatus::USED);
    assert_eq!(GpsObject::verify(&with_a_flipped_bit(bytes), identifier), Err(Rejection::Crc));
    true
}

fn judge_link_status(bytes: &[u8]) -> bool {
    let judged = LinkStatus::verify(bytes);
    assert_eq!(judged.err(), reference::object(bytes, 32, 0x4400));
    let Ok(object) = judged else { return false };
    assert_eq!(object.as_bytes(), bytes);
    let again = LinkStatus::seal(&object.values());
    seals_the_same(again.as_bytes(), bytes, LinkStatusBits::USED);
    assert_eq!(LinkStatus::verify(&with_a_flipped_bit(bytes)), Err(Rejection::Crc));
    true
}

/// Checks that an accepted object's values, sealed again, give the object's bytes except undefined status bits.
fn seals_the_same(again: &[u8], bytes: &[u8], used: u16) {
    let mut expected = bytes.to_vec();
    expected[6] &= used.to_le_bytes()[0];
    expected[7] &= used.to_le_bytes()[1];
    reference::repair_frame_crc(&mut expected);
    assert_eq!(again, expected);
}

/// Returns `bytes` with one bit inverted. The value of `bytes` determines which.
fn with_a_flipped_bit(bytes: &[u8]) -> Vec<u8> {
    let chosen = bytes.iter().fold(0_usize, |sum, byte| sum * 31 % 65_521 + usize::from(*byte));
    reference::flipped(bytes, [chosen % (8 * bytes.len())])
}

fn profile_of<const N: usize>(input: &[u8]) {
    let judged = Profile::<N>::read(input);
    assert_eq!(judged.is_ok(), input.len() == 64 + 60 * N);
    let Ok(reading) = judged else {
        assert_eq!(judged, Err(Rejection::Length));
        return;
    };
    let mut accepted = 0;
    for (index, place) in reference::places(N).into_iter().enumerate() {
        let expected = reference::object_of_profile(&input[place.clone()], index);
        let (found, bytes) = match index {
            0 => (reading.reported.err(), reading.reported.ok().map(|it| &it.as_bytes()[..])),
            _ => {
                let gps = reading.gps[index - 1];
                (gps.err(), gps.ok().map(|it| &it.as_bytes()[..]))
            }
        };
        assert_eq!(found, expected);
        assert!(bytes.is_none_or(|bytes| bytes == &input[place]));
        accepted += usize::from(expected.is_none());
    }
    assert_eq!(reading.accepted(), accepted);
    assert_eq!(reading.complete(), accepted == N + 1);
}

fn air_frame_of<const N: usize>(input: &[u8]) {
    let frame = reference::frames(N).iter().position(|(.., length)| *length == input.len());
    let Some(frame) = frame else {
        assert_eq!(air::place::<N>(input), Err(Rejection::Length));
        assert!(air::objects::<N>(input).is_err());
        return;
    };
    let (first, count, length) = reference::frames(N)[frame];
    let place = air::place::<N>(input).expect("a frame of this length exists");
    assert_eq!((place.first(), place.count(), place.length()), (first, count, length));

    let objects: Vec<_> = air::objects::<N>(input).expect("as above").collect();
    assert!(objects.iter().map(|(index, _)| *index).eq(first..first + count));
    assert_eq!(objects.iter().flat_map(|(_, bytes)| *bytes).copied().collect::<Vec<_>>(), input);

    let mut image = Image::<N>::EMPTY;
    for (index, bytes) in &objects {
        let judged = Object::verify(*index, bytes);
        assert_eq!(judged.err(), reference::object_of_profile(bytes, *index));
        let place = Image::<N>::place(*index).expect("the frame belongs to this profile");
        match judged {
            Ok(object) => {
                image.deposit(object).expect("it has a place");
                assert_eq!(&image.as_bytes()[place], *bytes);
            }
            Err(_) => assert!(image.as_bytes()[place].iter().all(|byte| *byte == 0)),
        }
    }

    // Once their CRCs are right, all objects are accepted, and the profile in the image gives the same frame again.
    let mut payload = input.to_vec();
    for index in first..first + count {
        let object = reference::places(N)[index].clone();
        let start = object.start - place.offset();
        reference::repair(&mut payload[start..start + object.len()], index);
    }
    for (index, bytes) in air::objects::<N>(&payload).expect("same length") {
        let object = Object::verify(index, bytes).expect("put right, it is accepted");
        image.deposit(object).expect("it has a place");
    }
    assert_eq!(air::split(image.profile()).nth(frame), Some(&payload[..]));
}

fn image_of<const N: usize>(input: &[u8]) {
    let judged = Image::<N>::read(input);
    assert_eq!(judged.is_ok(), input.len() == 96 + 60 * N);
    let Ok(reading) = judged else {
        assert_eq!(judged, Err(Rejection::Length));
        return;
    };
    assert_eq!(reading.link, LinkStatus::verify(&input[..32]));
    assert_eq!(Ok(reading.profile), Profile::<N>::read(&input[32..]));
    link_status(&input[..32]);
    profile_of::<N>(&input[32..]);
}

fn judge_ssi_request(bytes: &[u8; 8], map_len: usize) {
    let offset = usize::from(u16::from_le_bytes([bytes[0], bytes[1]]));
    let length = usize::from(u16::from_le_bytes([bytes[2], bytes[3]]));
    let intact = bytes[4..] == reference::crc(reference::FRAME, &bytes[..4]).to_be_bytes();
    let nothing = [[0x00; 8], [0xFF; 8]].contains(bytes);
    match ssi::parse(bytes, map_len) {
        Ok(Parsed::Nothing) => assert!(nothing),
        Ok(Parsed::Window(request)) => {
            assert!(intact && length > 0 && offset + length <= map_len);
            assert_eq!(request.window(), offset..offset + length);
            assert_eq!(&ssi::encode(request), bytes);
        }
        Err(Rejection::Crc) => assert!(!intact && !nothing),
        Err(Rejection::Window) => {
            assert!(intact && !nothing && (length == 0 || offset + length > map_len));
        }
        Err(other) => panic!("a request is never rejected for {other:?}"),
    }
}

fn judge_port_status(bytes: &[u8]) -> bool {
    let judged = PortStatus::verify(bytes);
    assert_eq!(judged.err(), reference::object(bytes, 64, 0x4401));
    let Ok(object) = judged else { return false };
    assert_eq!(object.as_bytes(), bytes);
    let again = PortStatus::seal(Writer::<Dpr>::claim(), &object.values());
    seals_the_same(again.as_bytes(), bytes, PortStatusBits::USED);
    assert_eq!(PortStatus::verify(&with_a_flipped_bit(bytes)), Err(Rejection::Crc));
    true
}

fn judge_written(bytes: &[u8]) -> bool {
    let expected = match [0x4200, 0x4300, 0x4301].map(|identifier| reference::object(bytes, 64, identifier)) {
        [_, _, None] if bytes[12..60].iter().any(|&byte| byte != 0) => Some(Rejection::Command),
        [_, _, None] if ![b"CLRC", b"TEST"].contains(&bytes[8..12].first_chunk().expect("four")) => {
            Some(Rejection::Command)
        }
        judged if judged.contains(&None) => None,
        [first, ..] => first,
    };
    let judged = Written::verify(bytes);
    assert_eq!(judged.err(), expected);
    let [base, own] = [Uplink::verify::<BaseStation>(bytes), Uplink::verify::<FlightController>(bytes)];
    assert_eq!(base.err(), reference::object(bytes, 64, 0x4200));
    assert_eq!(own.err(), reference::object(bytes, 64, 0x4300));
    let again = match judged {
        Ok(Written::BaseStation(object)) => Uplink::seal(Writer::<BaseStation>::claim(), &object.values()),
        Ok(Written::FlightController(object)) => Uplink::seal(Writer::<FlightController>::claim(), &object.values()),
        Ok(Written::Command(command, object)) => {
            assert_eq!(CommandObject::verify(bytes), Ok(object));
            assert_eq!((object.as_bytes().as_slice(), object.command()), (bytes, Some(command)));
            let sealed = CommandObject::seal(Writer::<FlightController>::claim(), object.timestamp(), command);
            seals_the_same(sealed.as_bytes(), bytes, 0);
            assert_eq!(Command::from_word(object.values().word), Some(command));
            return true;
        }
        Err(_) => return false,
    };
    assert_eq!(again.as_bytes(), bytes);
    assert_eq!(Written::verify(&with_a_flipped_bit(bytes)).err(), Some(Rejection::Crc));
    true
}

fn map_of<const N: usize>(input: &[u8]) {
    let judged = Map::<N>::read(input);
    assert_eq!(judged.is_ok(), input.len() == 96 + 60 * N + 192);
    let Ok(reading) = judged else {
        assert_eq!(judged, Err(Rejection::Length));
        return;
    };
    let (image_bytes, port) = input.split_at(96 + 60 * N);
    assert_eq!(Ok(reading.image), Image::<N>::read(image_bytes));
    assert_eq!(reading.port.status, PortStatus::verify(&port[..64]));
    assert_eq!(reading.port.base_station.err(), reference::object(&port[64..128], 64, 0x4200));
    assert_eq!(reading.port.flight_controller.err(), reference::object(&port[128..], 64, 0x4300));
    image(image_bytes);
    port_status(&port[..64]);
    written(&port[64..128]);
    written(&port[128..]);
}

pub(crate) fn hold(input: &[u8]) {
    judge_hold_object(input);
    if input.len() == HoldObject::SIZE {
        for identifier in [0x4100_u16, 0x41FF] {
            let mut repaired = input.to_vec();
            repaired[4..6].copy_from_slice(&identifier.to_le_bytes());
            reference::repair_frame_crc(&mut repaired);
            assert!(judge_hold_object(&repaired), "put right, it is accepted");
        }
    }
    let mut commands = Commands::new();
    let mut now_ms = 0;
    // The input consists of steps of 129 bytes: the time since the last step, and an answer. If the lowest bit of the
    // time is set, the answer's uplinks get right identifiers and CRCs.
    for step in input.as_chunks::<{ 1 + Answer::SIZE }>().0 {
        now_ms += u64::from(step[0] >> 1) * 16;
        let mut bytes = step[1..].to_vec();
        if step[0] & 1 == 1 {
            for (uplink, identifier) in bytes.as_chunks_mut::<64>().0.iter_mut().zip([0x4200_u16, 0x4300]) {
                uplink[4..6].copy_from_slice(&identifier.to_le_bytes());
                reference::repair_frame_crc(uplink);
            }
        }
        judge_answer(&mut commands, &bytes, now_ms);
    }
}

fn judge_hold_object(bytes: &[u8]) -> bool {
    let judged = HoldObject::verify(bytes);
    let identifier = bytes.get(4..6).map_or(0, |bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
    let expected = if identifier >> 8 == 0x41 { identifier } else { 0x4100 };
    assert_eq!(judged.err(), reference::object(bytes, 64, expected));
    assert_eq!(HoldStatus::verify(bytes).err(), reference::object(bytes, 64, 0x4100));
    let mut intake = Intake::new();
    assert_eq!(intake.receive(bytes, 0), judged);
    assert_eq!(intake.is_shown(0), judged.is_ok());
    let Ok(object) = judged else { return false };
    assert_eq!(intake.receive(bytes, 1), Err(Rejection::Repeated));
    let writer = Writer::<ActiveLoad>::claim();
    assert_eq!(HoldObject::seal(writer, object.identifier(), &object.values()).as_bytes(), bytes);
    if let Ok(status) = HoldStatus::verify(bytes) {
        let mut expected = bytes.to_vec();
        expected[56..60].fill(0);
        seals_the_same(HoldStatus::seal(writer, &status.values()).as_bytes(), &expected, HoldStatusBits::USED);
    }
    true
}

fn judge_answer(commands: &mut Commands, bytes: &[u8], now_ms: u64) {
    let before = commands.acknowledged();
    let mut executed = [false; 2];
    commands.take(Answer::read(bytes).expect("128 bytes"), now_ms, |writer, command: HoldCommand| {
        let index = match writer {
            Function::BaseStation => 0,
            Function::FlightController => 1,
            other => panic!("{other} commands nothing"),
        };
        assert!(!std::mem::replace(&mut executed[index], true), "once in an answer");
        let payload = &bytes[64 * index + 8..64 * index + 60];
        let word = u16::from_le_bytes([payload[2], payload[3]]);
        assert!(matches!(
            (word, command),
            (1, HoldCommand::SetPoint(_))
                | (2, HoldCommand::Lock)
                | (3, HoldCommand::Unlock)
                | (4, HoldCommand::ClearShock)
        ));
        assert_eq!(payload[8..12], [0; 4]);
        if word == 3 { Executed::Refused } else { Executed::Done }
    });
    for (index, (before, after)) in before.into_iter().zip(commands.acknowledged()).enumerate() {
        let uplink = &bytes[64 * index..64 * index + 64];
        let ahead = after.number().wrapping_sub(before.number());
        assert_eq!(ahead == 0, before == after, "an acknowledgement has a number of its own");
        assert!(ahead < 0x8000 && (!executed[index] || ahead > 0));
        if ahead > 0 {
            assert_eq!(reference::object(uplink, 64, [0x4200, 0x4300][index]), None);
            assert_eq!(uplink[8..10], after.number().to_le_bytes());
            let (word, code) = (u16::from_le_bytes([uplink[10], uplink[11]]), after.code());
            assert_eq!((word != 0, executed[index]), (true, code == 1 || code == 2));
            assert!(code != 2 || word == 3);
        }
    }
}
