//! Tests that a log is judged the same in memory and after storage.

use crate::common;

use bench_judge::{
    Board, Bytes, Cause, Disturbance, Event, Header, HoldEvent, Judge, Log, LogError, LogWriter, SsiEvent, What, judge,
};
use common::*;
use proptest::prelude::*;

fn stored(log: &Log) -> Vec<u8> {
    let mut file = vec![];
    log.write(&mut file).unwrap();
    file
}

/// Returns one event of each kind, in order of declaration.
fn one_of_each() -> Vec<What> {
    let text = || "line 1\nline 2 \"\u{e9}\"".to_owned();
    vec![
        What::Power { board: Board::Horus, on: true },
        What::Reset { board: Board::Dpr, cause: Cause::Watchdog, asked: false },
        injected(Disturbance::Air, u64::MAX),
        What::Hung { board: Board::Dpr },
        What::Warned { board: Board::Horus },
        What::Crystal { board: Board::Horus, works: false },
        What::StateInput { input: 1, active: true, inactive: false },
        What::Tick,
        What::Aircraft { latitude: -47_123_456_789, longitude: 8_700_000_001, height: -1 },
        What::Command,
        What::Field { on: false },
        What::Sent { started: 1, bit_rate: 423_750, bytes: vec![0, 0xA5, 0xFF].into(), whole: true },
        What::FieldHeard { on: true },
        What::Heard { started: 0, bytes: Bytes::default(), whole: false },
        What::Answer,
        What::Offered { receiver: 1, bytes: vec![0xB5].into() },
        What::Fed { receiver: 2, byte_ns: 86_806, bytes: vec![0xB5, 0x62].into(), clean: true, since: Some(5) },
        What::Settings { receiver: 1, model: 7, position: true },
        What::Fresh { high: true, offered: Some(vec![1; 276].into()) },
        What::Ssi(SsiEvent::Held),
        What::Selected,
        What::Transaction { selected: 0, mosi: vec![0; 8].into(), miso: vec![0xFF; 96].into() },
        What::Decided { position: Some(10), age_us: None },
        What::Forwarded { profile: vec![9].into() },
        What::Arrived { profile: vec![9].into(), shown: 0xFF },
        What::Station { age_us: Some(5), alarms: vec![text()] },
        What::Finding { board: Board::Horus, fault: true, text: text() },
        What::Misuse { board: Board::Dpr, text: text() },
        What::Late { board: Board::Dpr, text: "3 ns".into() },
        What::Hold(HoldEvent::Lock { locked: true }),
        What::Counter { board: Board::Horus, name: "frames_skipped".into(), value: None },
        What::Load { board: Board::Dpr, per_10_000: 10_000 },
        What::End,
    ]
}

#[test]
fn events_of_one_instant_stand_in_the_order_of_their_declaration() {
    let ranks: Vec<_> = one_of_each().iter().map(What::rank).collect();
    assert_eq!(ranks, (0..33).collect::<Vec<_>>());
    let source = include_str!("../src/event.rs");
    let declared = source.split("pub enum What {").nth(1).unwrap().split("\n}\n").next().unwrap();
    let is_variant = |line: &&str| line.starts_with("    ") && line.as_bytes()[4].is_ascii_uppercase();
    let name = |text: &str| text.trim().split(|letter: char| !letter.is_alphanumeric()).next().unwrap().to_owned();
    let declared: Vec<_> = declared.lines().filter(is_variant).map(name).collect();
    let sampled: Vec<_> = one_of_each().iter().map(|what| name(&format!("{what:?}"))).collect();
    assert_eq!(sampled, declared);
}

#[test]
fn a_stored_log_reads_back_equal() {
    let header = Plan::new(5, 4).header;
    let events = one_of_each().into_iter().zip(5..).map(|(what, at)| Event { at, what }).collect();
    let log = Log { header, events };
    assert_eq!(Log::read(&*stored(&log)).unwrap(), log);
    let log = Plan::new(5, 20).log();
    assert_eq!(Log::read(&*stored(&log)).unwrap(), log);
    let mut file = vec![];
    let mut writer = LogWriter::new(&mut file, &log.header).unwrap();
    log.events.iter().for_each(|event| writer.take(event).unwrap());
    writer.finish().unwrap();
    assert_eq!(file, stored(&log));
    assert_eq!(file.iter().filter(|byte| **byte == b'\n').count(), 1 + log.events.len());
}

#[test]
fn bytes_are_stored_as_two_hexadecimal_digits_each() {
    let what = What::Heard { started: 7, bytes: vec![0x00, 0x0F, 0xA5, 0xFF].into(), whole: true };
    let mut log = Plan::new(5, 3).log();
    log.events = vec![Event { at: 9, what }];
    let file = String::from_utf8(stored(&log)).unwrap();
    let line = r#"{"at":9,"what":{"heard":{"started":7,"bytes":"000fa5ff","whole":true}}}"#;
    assert_eq!(file.lines().nth(1), Some(line));
    let read = |bytes: &str| Log::read(file.replace("\"000fa5ff\"", bytes).as_bytes());
    assert_eq!(read("\"000FA5Ff\"").unwrap(), log);
    for wrong in ["\"0\"", "\"000\"", "\"0g\"", "\"0x12\"", "\" 12\"", "\"\u{ff11}0\""] {
        let LogError::Line { line: 2, source } = read(wrong).unwrap_err() else { panic!("{wrong} is in line 2") };
        assert!(source.to_string().starts_with("bytes are two hexadecimal digits each"), "{wrong}: {source}");
    }
    assert!(matches!(read("[0,15]"), Err(LogError::Line { line: 2, .. })));
}

fn error(lines: &[&str]) -> LogError {
    Log::read(lines.join("\n").as_bytes()).unwrap_err()
}

const HEADER: &str = r#"{"version":4,"gps":3,"seed":7,"clock":"fast"}"#;
const TICK: &str = r#"{"at":10,"what":"tick"}"#;

#[test]
fn what_is_no_log_is_told_with_its_line() {
    let log = Log::read(format!("{HEADER}\n{TICK}\n{TICK}").as_bytes()).unwrap();
    assert_eq!((log.header.gps, log.events.len()), (3, 2));
    assert!(matches!(error(&[]), LogError::Empty));
    assert_eq!(error(&[]).to_string(), "the log is empty");
    for (lines, at) in [
        (&[TICK][..], 1),
        (&[HEADER, HEADER], 2),
        (&[HEADER, TICK, ""], 3),
        (&[HEADER, TICK, "{"], 3),
        (&[HEADER, TICK, r#"{"at":11,"what":"tock"}"#], 3),
        (&[HEADER, r#"{"at":-1,"what":"tick"}"#], 2),
    ] {
        // An empty line is an error, except at the end of the file.
        let lines = [lines, &[TICK]].concat();
        let error = error(&lines);
        assert!(matches!(error, LogError::Line { line, .. } if line == at), "{lines:?}: {error}");
        assert_eq!(error.to_string(), format!("line {at}"));
        assert!(std::error::Error::source(&error).is_some());
    }
    let newer = HEADER.replace("\"version\":4", "\"version\":5");
    assert!(matches!(error(&[&newer, TICK]), LogError::Version { found: 5 }));
    assert_eq!(error(&[&newer]).to_string(), "the log has format 5, and this version reads format 4");
    let backwards = [HEADER, TICK, TICK, r#"{"at":9,"what":"tick"}"#];
    assert!(matches!(error(&backwards), LogError::Order { line: 4, at: 9, before: 10 }));
    assert_eq!(error(&backwards).to_string(), "line 4: an event at 9 ns after one at 10 ns");
}

#[test]
fn a_log_of_a_hold_in_an_earlier_format_is_refused() {
    let header = r#"{"version":3,"gps":3,"seed":7,"clock":"fast","hold":true}"#;
    let heats = r#"{"at":5,"what":{"hold":{"payload":{"heater":1,"cooler":0,"temperature":9,"humidity":9}}}}"#;
    let disturbed = r#"{"at":5,"what":{"injected":{"kind":"hangs","disturbs":"hold","until":9}}}"#;
    for event in [heats, disturbed] {
        let error = error(&[header, event, TICK]);
        assert_eq!(error.to_string(), "the log has format 3, and this version reads format 4");
    }
}

#[test]
fn a_log_that_is_cut_off_is_read_up_to_there() {
    let log = Plan::new(1, 4).log();
    let whole = stored(&log);
    assert!(Log::read(&*whole).unwrap().is_whole());
    let header = whole.iter().position(|byte| *byte == b'\n').unwrap() + 1;
    for end in header..whole.len() - 1 {
        let cut = Log::read(&whole[..end]).unwrap();
        let lines = whole[..end].iter().filter(|byte| **byte == b'\n').count() - 1;
        assert!([lines, lines + 1].contains(&cut.events.len()), "{end}");
        assert_eq!(cut.events, log.events[..cut.events.len()], "{end}");
        assert_eq!(cut.is_whole(), cut.events.len() == log.events.len(), "{end}");
    }
}

struct Broken;

impl std::io::Read for Broken {
    fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
        Err(std::io::Error::other("the disk is gone"))
    }
}

impl std::io::Write for Broken {
    fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
        Err(std::io::Error::other("the disk is full"))
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Err(std::io::Error::other("the disk is full"))
    }
}

#[test]
fn what_the_file_says_is_passed_on() {
    let error = Log::read(std::io::BufReader::new(Broken)).unwrap_err();
    assert!(matches!(error, LogError::Io(_)));
    assert_eq!(error.to_string(), "the disk is gone");
    // A read error in the middle of the file is reported too.
    let begun = std::io::Read::chain(HEADER.as_bytes(), std::io::Read::chain(&b"\n"[..], Broken));
    assert!(matches!(Log::read(std::io::BufReader::new(begun)), Err(LogError::Io(_))));
    let log = Plan::new(1, 4).log();
    assert_eq!(log.write(Broken).unwrap_err().to_string(), "the disk is full");
    // The writer is buffered, so it may report a full disk only when the log is flushed.
    let mut room = [0; 1 << 20];
    let buffered = std::io::BufWriter::with_capacity(1 << 20, Broken);
    assert!(log.write(buffered).is_err());
    assert!(log.write(&mut room[..]).is_ok());
}

fn spoilt() -> Log {
    let mut log = Plan::new(3, 60).log();
    let places = repeats(&log);
    miso(&mut log, places[20])[100] ^= 1;
    miso(&mut log, places[30])[96..120].fill(0);
    let (from, late) = (log.events[places[40]].at, log.events[places[10]].at);
    blind(&mut log, from, from + 30_000_000);
    insert(&mut log, late, What::Answer);
    insert(&mut log, late + 500_000, What::Fresh { high: true, offered: None });
    let arrived = log.events.iter().position(|event| matches!(event.what, What::Arrived { .. })).unwrap();
    log.events.remove(arrived);
    log
}

#[test]
fn judging_is_a_function_of_the_log_alone() {
    let log = spoilt();
    let verdict = judge(&log);
    assert!(verdict.violations.len() >= 6, "{:?}", verdict.violations);
    assert!(verdict.figures.sample_to_readable.is_some());
    assert_eq!(judge(&log), verdict);
    assert_eq!(judge(&Log::read(&*stored(&log)).unwrap()), verdict);
    let mut judge = Judge::new(&log.header);
    for event in &log.events {
        judge.take(event);
    }
    // The end of a run adds violations that cannot be found earlier.
    let counts: Vec<_> = judge.findings().counts().collect();
    let verdict_of_events = judge.clone().finish();
    for (violation, count) in counts {
        let broken = verdict.violations.iter().find(|broken| broken.violation == violation).unwrap();
        assert!(broken.count >= count);
        assert_eq!(judge.findings().count(violation), count);
    }
    assert_eq!(verdict_of_events, verdict);
}

#[test]
fn a_violation_is_told_once_with_its_count_and_its_first_instant() {
    let mut log = Plan::new(3, 30).log();
    insert(&mut log, 100_000_000, What::Answer);
    let told = |log: &Log| judge(log).violations[0].to_string();
    assert_eq!(told(&log), "the listener answered: the DPR's front end sent, at 100.000000 ms");
    insert(&mut log, 110_000_000, What::Answer);
    insert(&mut log, 110_000_000, What::Answer);
    assert_eq!(told(&log), "the listener answered: the DPR's front end sent, at 100.000000 ms (and 2 more)");
}

#[test]
fn the_clock_of_the_header_says_whether_time_is_at_its_worst() {
    for (clock, worst) in [("fast", false), ("optimistic", false), ("pessimistic", true)] {
        let header = Header { clock: clock.into(), ..Plan::new(3, 1).header };
        assert_eq!(header.worst_case(), worst);
    }
}

fn what() -> impl Strategy<Value = What> {
    let bytes = || prop::collection::vec(any::<u8>(), 0..40).prop_map(Bytes::from);
    let image = prop_oneof![
        Just(Plan::new(1, 1).image(70_000_000, Some(10), profile::LinkValues::default())),
        Just(vec![0xFF; 156]),
        prop::collection::vec(any::<u8>(), 150..160),
    ];
    let frame = prop_oneof![Just(frame(&profile(1, 10))), Just(frame(&profile(1, 20)))];
    let board = || prop_oneof![Just(Board::Horus), Just(Board::Dpr)];
    let disturbance = prop::sample::select(vec![DPR_FRONT_END, HORUS_FRONT_END, MISUSE, RECEIVE_BIT, IMAGE_BIT]);
    let ssi = prop_oneof![Just(SsiEvent::Held), Just(SsiEvent::Released), Just(SsiEvent::Ready), Just(SsiEvent::Busy)];
    prop_oneof![
        2 => (board(), any::<bool>()).prop_map(|(board, on)| What::Power { board, on }),
        1 => (board(), any::<bool>()).prop_map(|(board, asked)| What::Reset { board, cause: Cause::Lockup, asked }),
        1 => (".*", disturbance, any::<u64>())
            .prop_map(|(kind, disturbs, until)| What::Injected { kind, disturbs, until }),
        2 => Just(What::Tick),
        2 => (any::<u32>(), frame.clone(), any::<bool>()).prop_map(|(bit_rate, bytes, whole)| What::Sent {
            started: 0,
            bit_rate,
            bytes: bytes.into(),
            whole
        }),
        2 => (frame, any::<bool>()).prop_map(|(bytes, whole)| What::Heard { started: 0, bytes: bytes.into(), whole }),
        4 => (any::<bool>(), prop::option::of(image.clone())).prop_map(|(high, image)| What::Fresh {
            high,
            offered: image.map(Bytes::from)
        }),
        8 => ssi.prop_map(What::Ssi),
        4 => Just(What::Selected),
        6 => (bytes(), image).prop_map(|(mosi, miso)| What::Transaction { selected: 0, mosi, miso: miso.into() }),
        2 => bytes().prop_map(|profile| What::Forwarded { profile }),
        2 => (bytes(), any::<u8>()).prop_map(|(profile, shown)| What::Arrived { profile, shown }),
        1 => (board(), any::<bool>(), ".*").prop_map(|(board, fault, text)| What::Finding { board, fault, text }),
        1 => (board(), "[a-z]*", any::<Option<u32>>())
            .prop_map(|(board, name, value)| What::Counter { board, name, value }),
    ]
}

proptest! {
    #[test]
    fn any_log_reads_back_equal_and_has_one_verdict(
        steps in prop::collection::vec((0..20_000_000_u64, what()), 0..60),
    ) {
        let mut at = 0;
        let header = Header { version: Header::VERSION, gps: 1, seed: 0, clock: "fast".into(), hold: false };
        let mut events = vec![];
        for (step, mut what) in steps {
            at += step;
            if let What::Transaction { selected, .. } = &mut what {
                *selected = at.saturating_sub(160_000);
            }
            events.push(Event { at, what });
        }
        events.push(Event { at: at + 1, what: What::End });
        let log = Log { header, events };
        let read = Log::read(&*stored(&log)).unwrap();
        prop_assert_eq!(&read, &log);
        prop_assert_eq!(judge(&read), judge(&log));
    }
}

#[test]
fn the_example_log_has_no_violation_until_it_is_damaged() {
    let text = include_str!("../example.log");
    let log = Log::read(text.as_bytes()).unwrap();
    let verdict = judge(&log);
    assert_eq!(verdict.violations, []);
    assert!(verdict.figures.sample_to_readable.is_some());
    let events = log.events.iter().filter(|event| event.what != What::Tick).cloned().collect();
    assert_ne!(judge(&Log { header: log.header.clone(), events }).violations, []);
}
