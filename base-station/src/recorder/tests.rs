use std::cell::RefCell;
use std::rc::Rc;

use profile::{GpsStatus, GpsValues, Profile, ReportedStatus, ReportedValues};

use super::*;
use crate::intake::{Intake, Kind};

const START: u64 = 1_790_000_000_000_000;

#[derive(Clone, Default)]
struct Disk {
    parts: Rc<RefCell<Vec<Vec<u8>>>>,
    free: Rc<RefCell<Option<usize>>>,
}

struct Part {
    disk: Disk,
    number: usize,
}

impl Write for Part {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut free = self.disk.free.borrow_mut();
        let fits = free.map_or(bytes.len(), |free| free.min(bytes.len()));
        if fits == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        *free = free.map(|free| free - fits);
        self.disk.parts.borrow_mut()[self.number].extend(&bytes[..fits]);
        Ok(fits)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Parts for Disk {
    type Part = Part;

    fn make(&mut self, _number: u32) -> io::Result<Part> {
        self.parts.borrow_mut().push(vec![]);
        Ok(Part { disk: self.clone(), number: self.parts.borrow().len() - 1 })
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn profile(timestamp: u32) -> Profile<1> {
    let (latitude, longitude) = (47.497_9, 8.728_9);
    let status = ReportedStatus::new().with_position_valid(true);
    let reported = ReportedValues { status, latitude, longitude, ..ReportedValues::absent(timestamp) };
    let status = GpsStatus::new().with_position_valid(true);
    Profile::seal(&reported, &[GpsValues { status, latitude, longitude, ..GpsValues::absent(timestamp) }])
}

/// Returns the arrival of this number, at 10 Hz. Some arrivals are duplicates, damaged or foreign.
fn arrival(cycle: u32) -> Carried {
    let mut bytes = profile(70_000 + 100 * (cycle - u32::from(cycle % 7 == 1))).as_bytes().to_vec();
    match cycle % 11 {
        3 => bytes[70] ^= 4,
        5 => bytes = b"somebody else".to_vec(),
        _ => {}
    }
    let from = "127.0.0.1:4000".to_owned();
    Carried { at_us: START + 100_000 * u64::from(cycle), kind: Kind::Datagrams, line: 0, from, bytes }
}

fn record(recorder: &mut Recorder<Disk>, cycles: std::ops::Range<u32>) -> Vec<(Carried, Vec<Judged>)> {
    let mut intake = Intake::default();
    let recorded = cycles.map(|cycle| {
        let carried = arrival(cycle);
        let judged = intake.take(&carried);
        recorder.carried(&carried, &judged, &Sample::of(&judged, intake.fleet()));
        for (drone, change) in intake.tick(carried.at_us) {
            recorder.alarm(drone, change);
        }
        recorder.tick(carried.at_us);
        (carried, judged)
    });
    recorded.collect()
}

fn read(bytes: &[u8]) -> (Vec<Record>, Option<String>) {
    let mut reader = Reader::new(bytes);
    let mut records = vec![];
    while let Some(record) = reader.next_record().unwrap() {
        records.push(record);
    }
    (records, reader.torn().map(str::to_owned))
}

fn is_same(read: &Record, (carried, judged): &(Carried, Vec<Judged>)) -> bool {
    let found = judged.iter().map(|judged| Found {
        drone: judged.drone.to_string(),
        place: judged.place,
        verdict: judged.verdict.code().to_owned(),
    });
    read.carried == *carried && read.found.iter().cloned().eq(found)
}

#[test]
fn hold_and_commands_are_in_a_recording_and_read_again() {
    use profile::criticality::{ActiveLoad, Writer};
    use profile::hold::HoldCommand;
    use profile::{HoldStatus, Layout};

    use crate::carrier::mavlink::commander::CommandState;

    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    let mut intake = Intake::default();
    let layout = Layout::for_receivers(1).unwrap().with_hold();
    let told = |state, at_us| {
        let (drone, command) = ("127.0.0.1:4000".to_owned(), HoldCommand::SetPoint(4.5));
        CommandRecord { drone, number: 8, command, state, since_us: START, at_us }
    };
    for tenth in 0..3_u32 {
        let mut bytes = vec![0; layout.map_len()];
        bytes[32..layout.image_len()].copy_from_slice(profile(70_000 + 100 * tenth).as_bytes());
        let hold = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(100 * tenth));
        bytes[layout.hold().unwrap()].copy_from_slice(hold.as_bytes());
        let from = "127.0.0.1:4000".to_owned();
        let carried =
            Carried { at_us: START + 100_000 * u64::from(tenth), kind: Kind::Datagrams, line: 0, from, bytes };
        let judged = intake.take(&carried);
        let samples = Sample::of(&judged, intake.fleet());
        assert!(
            samples.iter().any(|sample| matches!(sample, Sample::Hold(_, values) if values.timestamp == 100 * tenth))
        );
        recorder.carried(&carried, &judged, &samples);
        let state = if tenth == 0 { CommandState::Pending } else { CommandState::Done };
        recorder.command(&told(state, carried.at_us));
    }
    recorder.finish().unwrap();
    let bytes = disk.parts.borrow()[0].clone();
    let topics = ["/drone/127.0.0.1:4000/hold", "/hold-commands"].map(str::as_bytes);
    assert!(topics.iter().all(|topic| bytes.windows(topic.len()).any(|window| window == *topic)));
    let (records, torn) = read(&bytes);
    assert_eq!((records.len(), torn), (3, None));
    let of = |index: usize| records[index].commands.clone();
    assert_eq!(of(0), []);
    assert_eq!(of(1), [told(CommandState::Pending, START)]);
    assert_eq!(of(2), [told(CommandState::Done, START + 100_000)]);
    let mut again = Intake::default();
    let judged: Vec<_> = records.iter().flat_map(|record| crate::export::judge(&mut again, record)).collect();
    let new = |judged: &&Judged| judged.place == Place::Hold && judged.verdict == Verdict::New;
    assert_eq!(judged.iter().filter(new).count(), 3);
}

#[test]
fn judging_a_recording_again_gives_the_recorded_verdicts() {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    let recorded = record(&mut recorder, 0..200);
    recorder.finish().unwrap();
    let parts = disk.parts.borrow();
    let (records, torn) = read(&parts[0]);
    assert_eq!((parts.len(), records.len(), torn), (1, recorded.len(), None));
    let mut intake = Intake::default();
    for (read, recorded) in records.iter().zip(&recorded) {
        assert!(is_same(read, recorded));
        assert_eq!(intake.take(&read.carried), recorded.1);
    }
}

#[test]
fn the_file_is_what_mcap_expects_of_one() {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    let recorded = record(&mut recorder, 0..200);
    recorder.finish().unwrap();
    let parts = disk.parts.borrow();
    let summary = mcap::Summary::read(&parts[0]).unwrap().unwrap();
    let mut topics: Vec<_> = summary.channels.values().map(|channel| channel.topic.clone()).collect();
    topics.sort();
    let of = |place| format!("/drone/127.0.0.1:4000/{place}");
    assert_eq!(topics, ["/alarms".into(), "/carried".into(), of("GPS1"), of("Reported-Position"), of("state")]);
    for channel in summary.channels.values() {
        let schema = channel.schema.as_ref().unwrap();
        assert_eq!((&*channel.message_encoding, &*schema.encoding), ("ros1", "ros1msg"));
    }
    let messages: Vec<_> = mcap::MessageStream::new(&parts[0]).unwrap().map(Result::unwrap).collect();
    let carried = messages.iter().filter(|message| message.channel.topic == "/carried").count();
    assert_eq!(carried, recorded.len());
    assert!(messages.iter().all(|message| message.log_time % 1_000 == 0 && message.log_time >= START * 1_000));
}

#[test]
fn a_file_cut_anywhere_keeps_all_but_the_last_half_second() {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    let mut recorded = vec![];
    let mut intake = Intake::default();
    // Killing the process after an arrival leaves the part of the file that is on the disk at that instant.
    let mut left = vec![];
    for cycle in 0..60 {
        let carried = arrival(cycle);
        let judged = intake.take(&carried);
        recorder.carried(&carried, &judged, &Sample::of(&judged, intake.fleet()));
        recorder.tick(carried.at_us);
        recorded.push((carried, judged));
        left.push(disk.parts.borrow()[0].len());
    }
    let file = disk.parts.borrow()[0].clone();
    for (cycle, length) in left.into_iter().enumerate() {
        let (records, _) = read(&file[..length]);
        assert!(records.len() + 5 > cycle, "{} of {cycle}", records.len());
        assert!(records.iter().zip(&recorded).all(|(read, recorded)| is_same(read, recorded)));
    }
    // After a power loss the file may end anywhere, so it is read at each length.
    let mut before = 0;
    for length in 0..file.len() {
        let (records, _) = read(&file[..length]);
        assert!(records.len() >= before && records.len() <= recorded.len());
        assert!(records.iter().zip(&recorded).all(|(read, recorded)| is_same(read, recorded)), "cut at {length}");
        before = records.len();
    }
    assert!(before >= 50);
}

#[test]
fn a_damaged_byte_in_a_recording_never_yields_false_data() {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    let recorded = record(&mut recorder, 0..60);
    recorder.finish().unwrap();
    let file = disk.parts.borrow()[0].clone();
    for at in (0..file.len()).step_by(7) {
        let mut damaged = file.clone();
        damaged[at] ^= 0x10;
        let (records, _) = read(&damaged);
        for read in &records {
            assert!(recorded.iter().any(|recorded| is_same(read, recorded)), "byte {at}");
        }
    }
}

#[test]
fn a_flipped_bit_costs_its_chunk_alone_and_is_told() {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    let recorded = record(&mut recorder, 0..200);
    recorder.finish().unwrap();
    let file = disk.parts.borrow()[0].clone();
    let starts: Vec<usize> = chunks(&file);
    assert!(starts.len() > 10, "{}", starts.len());
    for start in &starts {
        let mut damaged = file.clone();
        damaged[start + 200] ^= 0x10;
        let mut reader = Reader::new(&damaged[..]);
        let mut records = vec![];
        while let Some(record) = reader.next_record().unwrap() {
            records.push(record);
        }
        assert_eq!((reader.lost().len(), reader.torn()), (1, None), "{start}");
        let missing = recorded.len() - records.len();
        assert!((1..=20).contains(&missing), "{missing} at {start}");
        assert!(records.iter().all(|read| recorded.iter().any(|recorded| is_same(read, recorded))));
    }
}

fn chunks(file: &[u8]) -> Vec<usize> {
    let (mut at, mut found) = (mcap::MAGIC.len(), vec![]);
    while let Some(head) = file.get(at..at + 9).filter(|_| at + 8 < file.len()) {
        if head[0] == mcap::records::op::CHUNK {
            found.push(at);
        }
        at += 9 + u64::from_le_bytes(head[1..9].try_into().unwrap()) as usize;
    }
    found
}

#[test]
fn a_disk_that_stays_full_is_told_without_a_pause() {
    let disk = Disk::default();
    *disk.free.borrow_mut() = Some(6_000);
    let mut recorder = Recorder::new(disk.clone());
    record(&mut recorder, 0..100);
    let since = recorder.trouble().unwrap().since_us;
    for second in 1..20 {
        record(&mut recorder, 100 * second..100 * second + 7);
        assert_eq!(recorder.trouble().map(|trouble| trouble.since_us), Some(since), "{second}");
    }
}

#[test]
fn a_full_disk_is_told_and_ends_nothing() {
    let disk = Disk::default();
    *disk.free.borrow_mut() = Some(6_000);
    let mut recorder = Recorder::new(disk.clone());
    record(&mut recorder, 0..100);
    let trouble = recorder.trouble().unwrap().clone();
    let lost = recorder.lost();
    assert!(lost > 50 && trouble.since_us > START && trouble.since_us < START + 10_000_000, "{lost} {trouble:?}");
    let (before, _) = read(&disk.parts.borrow()[0]);
    assert!(!before.is_empty());

    *disk.free.borrow_mut() = None;
    let recorded = record(&mut recorder, 200..300);
    assert_eq!((recorder.trouble(), recorder.lost()), (None, lost));
    recorder.finish().unwrap();
    let (after, torn) = read(disk.parts.borrow().last().unwrap());
    assert_eq!((after.len(), torn), (recorded.len(), None));
}

#[test]
fn a_part_that_is_large_is_followed_by_another() {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    recorder.part_bytes = 20_000;
    let recorded = record(&mut recorder, 0..500);
    recorder.finish().unwrap();
    let parts = disk.parts.borrow();
    assert!(parts.len() > 3, "{}", parts.len());
    let all: Vec<_> = parts.iter().flat_map(|part| read(part).0).collect();
    assert_eq!(all.len(), recorded.len());
    assert!(parts.iter().all(|part| mcap::Summary::read(part).unwrap().is_some()));
}

#[test]
fn files_are_never_overwritten() {
    let folder = std::env::temp_dir().join(format!("horus-base-recorder-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("flight.mcap");
    assert_eq!(Files::name(&path, 2), folder.join("flight.2.mcap"));
    assert_eq!(Files::name(Path::new("flight"), 1), Path::new("flight.1"));
    for _ in 0..2 {
        let mut recorder = Recorder::new(Files::new(path.clone()));
        let carried = arrival(0);
        let mut intake = Intake::default();
        let judged = intake.take(&carried);
        recorder.carried(&carried, &judged, &Sample::of(&judged, intake.fleet()));
        recorder.finish().unwrap();
    }
    let found: Vec<_> = (0..3).map(|number| Files::name(&path, number).exists()).collect();
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(found, [true, true, false]);
}

fn head(opcode: u8, length: u64) -> Vec<u8> {
    [&[opcode][..], &length.to_le_bytes()].concat()
}

fn unfinished() -> (Vec<u8>, usize) {
    let disk = Disk::default();
    let mut recorder = Recorder::new(disk.clone());
    record(&mut recorder, 0..60);
    std::mem::forget(recorder);
    let file = disk.parts.borrow()[0].clone();
    let (records, torn) = read(&file);
    assert!(records.len() > 50 && torn.is_none());
    (file, records.len())
}

fn read_through(from: impl io::Read) -> (usize, String, usize, u64) {
    let mut reader = Reader::new(from);
    let mut count = 0;
    while reader.next_record().unwrap().is_some() {
        count += 1;
    }
    let told = reader.lost().iter().map(String::as_str).chain(reader.torn()).collect::<Vec<_>>().join("; ");
    (count, told, reader.held(), reader.bytes_read())
}

#[test]
fn a_record_with_a_false_length_takes_no_excessive_memory() {
    use mcap::records::op;
    let (file, records) = unfinished();
    for opcode in [op::CHUNK, op::MESSAGE, op::CHANNEL, op::ATTACHMENT, op::DATA_END, 0x80] {
        for claimed in [1 << 40, u64::MAX, reading::LONGEST + 1, reading::LONGEST, 1 << 20] {
            let damaged = [&file[..], &head(opcode, claimed), &[0; 100]].concat();
            let (count, torn, held, bytes) = read_through(&damaged[..]);
            let told = if claimed > reading::LONGEST { "length exceeds limit" } else { "ended in the middle" };
            assert!(torn.contains(told), "{opcode:#x}, {claimed}: {torn}");
            assert_eq!(count, records);
            assert!(held <= 2 * damaged.len(), "{opcode:#x}, {claimed}: {held} bytes for {}", damaged.len());
            assert!(bytes <= damaged.len() as u64);
        }
    }
    // If an endless input claims a length above the limit, only the head of that record is read.
    let endless = |claimed| io::Read::chain(io::Cursor::new([&file[..], &head(0x80, claimed)].concat()), io::repeat(0));
    let (count, torn, _, bytes) = read_through(endless(1 << 40));
    assert_eq!((count, bytes), (records, (file.len() + 9) as u64));
    assert!(torn.contains("length exceeds limit: `1099511627776`"), "{torn}");
}

#[test]
fn what_is_claimed_within_a_chunk_is_not_believed_either() {
    use mcap::records::op;
    let (file, records) = unfinished();
    let string = |length: u32, text: &[u8]| [&length.to_le_bytes()[..], text].concat();
    let chunk = |compression: Vec<u8>, claimed: u64, inside: &[u8]| {
        let body = [&[0; 24][..], &[0; 4], &compression, &claimed.to_le_bytes(), inside].concat();
        [&file[..], &head(op::CHUNK, body.len() as u64), &body, &head(op::MESSAGE, 0)].concat()
    };
    let whole = |inside: &[u8]| chunk(string(0, b""), inside.len() as u64, inside);
    let channel = [&[9, 0, 1, 0][..], &string(u32::MAX, b"/carried")].concat();
    let channel = [head(op::CHANNEL, channel.len() as u64), channel].concat();
    let inside = "Chunk ended in the middle of a record";
    let cases = [
        (whole(&head(op::MESSAGE, 1 << 40)), inside),
        (whole(&head(op::MESSAGE, u64::MAX)), inside),
        (whole(&head(op::MESSAGE, 9)), inside),
        (whole(&[op::MESSAGE, 1, 0]), inside),
        (whole(&channel), "a channel that is malformed"),
        (whole(&[head(op::MESSAGE, 3), vec![0; 3]].concat()), "a message that is malformed"),
        (chunk(string(0, b""), 1 << 40, &[]), "exceeds space in record"),
        (chunk(string(u32::MAX, b"zstd"), 0, &[]), inside),
        (chunk(string(4, b"zstd"), 0, &[]), "Unsupported compression format `zstd`"),
    ];
    for (damaged, why) in cases {
        let (count, torn, held, _) = read_through(&damaged[..]);
        assert_eq!(count, records, "{torn}");
        assert!(torn.contains(why), "{why}: {torn}");
        assert!(held <= 2 * damaged.len(), "{held} bytes for {}", damaged.len());
    }
    // An attachment that is too short for its own CRC is skipped.
    let foreign = [&file[..], &head(op::ATTACHMENT, 1), &[0]].concat();
    assert_eq!(read_through(&foreign[..]).0, records);
}
