//! Tests that a recorded log is played as it was recorded, or refused with a reason.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gnss_sim::log::{FIRST_BURST_NS, GAP_MAX_MS, PERIOD_WITHOUT_TIME_MS};
use gnss_sim::ubx::{self, NavAtt, NavPvt, WEEK_MS};
use gnss_sim::{Log, LogError, Receiver};

const GNTXT: &[u8] = b"$GNTXT,01,01,02,u-blox AG - www.u-blox.com*4E\r\n";

fn pvt(itow_ms: u32, longitude_1e7: i32) -> NavPvt {
    NavPvt {
        itow_ms,
        fix_type: 3,
        flags: NavPvt::FLAG_FIX_OK,
        longitude_1e7,
        latitude_1e7: 474_979_000,
        height_mm: 470_001,
        ..NavPvt::default()
    }
}

fn log(pieces: &[&[u8]]) -> Result<Log, LogError> {
    Log::from_bytes("made.ubx", pieces.concat())
}

/// Returns for each burst its time after the first burst, ms, and its length, bytes.
fn schedule(log: &Log) -> Vec<(u64, usize)> {
    log.bursts().map(|(at, bytes)| ((at - FIRST_BURST_NS) / 1_000_000, bytes.len())).collect()
}

#[test]
fn each_epoch_is_a_burst_and_nothing_is_left_out() {
    let att = NavAtt { itow_ms: 5_000, ..NavAtt::default() }.encode();
    let log = log(&[
        b"\x00\xffnoise before",
        GNTXT,
        &att,
        &pvt(5_000, 1).encode(),
        GNTXT,
        &pvt(5_100, 2).encode(),
        &pvt(5_350, 3).encode(),
        b"\xb5\x62cut off",
    ])
    .expect("it holds positions");
    assert_eq!(schedule(&log), [(0, 14 + GNTXT.len() + 40 + 100 + GNTXT.len()), (100, 100), (350, 109)]);
    assert_eq!(log.bursts().flat_map(|(_, bytes)| bytes.to_vec()).collect::<Vec<_>>(), log.bytes());
    let counts = log.counts();
    assert_eq!((counts.ubx, counts.nav_pvt, counts.nmea, counts.rtcm), (4, 3, 2, 0));
    assert_eq!((counts.unknown_bytes, counts.bytes), (14 + 9, log.bytes().len()));
}

#[test]
fn a_log_is_scheduled_despite_gaps_and_time_that_stands_still() {
    let log = log(&[
        &pvt(WEEK_MS - 200, 1).encode(),
        &pvt(0, 2).encode(),
        &pvt(3_600_000, 3).encode(),
        &pvt(3_600_000, 4).encode(),
        &pvt(1_000, 5).encode(),
        &NavAtt { itow_ms: 500, ..NavAtt::default() }.encode(),
        &pvt(1_200, 6).encode(),
    ])
    .expect("it holds positions");
    let (cap, nominal) = (u64::from(GAP_MAX_MS), u64::from(PERIOD_WITHOUT_TIME_MS));
    let last = 200 + cap + 2 * nominal;
    assert_eq!(
        schedule(&log),
        [(0, 100), (200, 100), (200 + cap, 100), (last - nominal, 100), (last, 140), (last + 200, 100)]
    );
    assert_eq!(log.duration_ns(), FIRST_BURST_NS + (last + 200) * 1_000_000);
}

#[test]
fn an_epoch_whose_pvt_comes_after_other_messages_is_one_epoch() {
    let att = |itow_ms| NavAtt { itow_ms, ..NavAtt::default() }.encode();
    let log =
        log(&[&att(1_000), &pvt(1_000, 1).encode(), &att(2_000), &pvt(2_000, 2).encode()]).expect("it holds positions");
    assert_eq!(schedule(&log), [(0, 140), (1_000, 140)]);
}

#[test]
fn damaged_messages_neither_count_nor_tell_the_time() {
    let mut damaged = pvt(9_000, 2).encode();
    damaged[30] ^= 0x10;
    let mut headless = pvt(9_500, 3).encode();
    headless[1] = 0x77;
    // A frame announces more bytes than follow. It must not hide the next message.
    let announced = [0xb5, 0x62, 0x01, 0x07, 0xff, 0xff];
    let log = log(&[&pvt(1_000, 1).encode(), &damaged, &headless, &announced, &pvt(1_100, 4).encode()])
        .expect("it holds positions");
    assert_eq!(log.positions().iter().map(|p| p.longitude_1e7).collect::<Vec<_>>(), [1, 4]);
    assert_eq!(schedule(&log), [(0, 306), (100, 100)]);
    assert_eq!(log.counts().unknown_bytes, 206);
}

#[test]
fn rtcm_and_nmea_are_counted_as_such_and_not_searched_for_ubx() {
    // This RTCM message of type 1005 is the example in RTCM 10403.3.
    let rtcm = [
        0xd3, 0x00, 0x13, 0x3e, 0xd7, 0xd3, 0x02, 0x02, 0x98, 0x0e, 0xde, 0xef, 0x34, 0xb4, 0xbd, 0x62, 0xac, 0x09,
        0x41, 0x98, 0x6f, 0x33, 0x36, 0x0b, 0x98,
    ];
    let broken = b"$GNTXT,01,01,02,u-blox AG - www.u-blox.com*4F\r\n";
    let log = log(&[&rtcm, broken, &pvt(1_000, 1).encode(), &rtcm, GNTXT]).expect("it holds positions");
    let counts = log.counts();
    assert_eq!((counts.rtcm, counts.nmea, counts.ubx, counts.unknown_bytes), (2, 1, 1, broken.len()));
}

#[test]
fn only_fixes_that_a_receiver_vouches_for_are_positions() {
    let without = |change: fn(&mut NavPvt)| {
        let mut message = pvt(2_000, 2);
        change(&mut message);
        message.encode()
    };
    let log = log(&[
        &pvt(1_000, 1).encode(),
        &without(|m| m.fix_type = 0),
        &without(|m| m.fix_type = 5),
        &without(|m| m.flags = 0),
        &without(|m| m.flags3 = NavPvt::FLAG3_INVALID_LLH),
        // NAV-PVT has 84 bytes in protocol version 14 and earlier.
        &ubx::frame(0x01, 0x07, &pvt(3_000, 3).encode()[6..90]),
        &pvt(4_000, 4).encode(),
    ])
    .expect("it holds positions");
    assert_eq!(log.positions().iter().map(|p| p.longitude_1e7).collect::<Vec<_>>(), [1, 4]);
    assert_eq!(log.counts().nav_pvt, 7);
}

#[test]
fn a_position_is_the_float_nearest_to_its_decimal_number() {
    // For this longitude, dividing by 1e7 and multiplying by 1e-7 give numbers that differ in the last bit.
    let log = log(&[&pvt(1_000, -22_402_964).encode()]).expect("it holds a position");
    let position = log.positions()[0];
    assert_eq!(position.longitude().to_bits(), (-2.240_296_4_f64).to_bits());
    assert_eq!(position.latitude().to_bits(), 47.4979_f64.to_bits());
    assert_eq!(position.altitude().to_bits(), 470.001_f64.to_bits());
    let differs = (0..1_000).any(|raw| f64::from(raw) * 1e-7 != f64::from(raw) / 1e7);
    assert!(differs, "else there would be nothing to define");
}

#[test]
fn logs_that_cannot_be_played_say_why() {
    let text = |result: Result<Log, LogError>| result.expect_err("refused").to_string();
    let missing = text(Log::open("no/such/file.ubx"));
    assert!(missing.starts_with("no/such/file.ubx: cannot be read; "), "{missing}");
    let folder = text(Log::open(env!("CARGO_MANIFEST_DIR")));
    assert!(folder.contains("cannot be read"), "{folder}");
    let empty = text(log(&[]));
    assert!(empty.starts_with("made.ubx: is empty"), "{empty}");
    let unfixed = NavPvt { itow_ms: 1_000, ..NavPvt::default() }.encode();
    let none = text(log(&[&unfixed, GNTXT, GNTXT, b"xyz"]));
    assert!(
        none.starts_with(
            "made.ubx: holds no position: among its 197 bytes are 1 whole UBX messages (1 NAV-PVT, none with a valid \
             fix), 2 NMEA sentences, "
        ),
        "{none}"
    );
    assert!(none.contains("3 bytes that belong to none") && none.contains("enable"), "{none}");
    assert!(matches!(log(&[b"\xb5"]), Err(LogError::NoPosition { .. })));
}

#[test]
fn a_receiver_plays_the_log_without_overlap_on_its_line() {
    // 10 kB every 100 ms are more than a line of 460 800 bit/s can carry, so bursts queue in order.
    let big = ubx::frame(0x0a, 0x04, &[0x55; 10_000]);
    let log = log(&[&pvt(1_000, 1).encode(), &big, &pvt(1_100, 2).encode(), &big, &pvt(2_000, 3).encode()])
        .expect("it holds positions");
    let receiver = Receiver::recorded(Arc::new(log.clone()));
    let bursts: Vec<_> = receiver.clone().collect();
    assert_eq!(bursts.iter().flat_map(|b| b.bytes.clone()).collect::<Vec<_>>(), log.bytes());
    let line = receiver.line_time_ns(10_108);
    assert_eq!(line, 219_357_639);
    assert_eq!(bursts.iter().map(|b| b.at_ns - FIRST_BURST_NS).collect::<Vec<_>>(), [0, line, 1_000_000_000]);
}

/// The path of a recording beside the workspace; `None` if the file does not exist.
fn recording(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/ubx").join(name);
    if !path.exists() {
        println!("skipped: {name} is not beside the workspace");
        return None;
    }
    Some(path)
}

#[test]
fn a_real_recording_plays_second_by_second() {
    let Some(path) = recording("pygpsdata-MIXED.log") else { return };
    let log = Log::open(path).expect("it holds positions");
    let counts = log.counts();
    assert_eq!((counts.bytes, counts.nav_pvt, counts.nmea, counts.unknown_bytes), (37_456, 39, 8, 0));
    assert_eq!(log.positions().len(), 39);
    let first = log.positions()[0];
    assert_eq!((first.longitude_1e7, first.latitude_1e7, first.height_mm), (-22_402_964, 534_506_691, 75_699));
    let seconds: Vec<_> = schedule(&log).into_iter().map(|(ms, _)| ms).collect();
    assert_eq!(seconds, (0..39).map(|second| second * 1_000).collect::<Vec<_>>());
    let played: Vec<_> = Receiver::recorded(Arc::new(log.clone())).flat_map(|burst| burst.bytes).collect();
    assert_eq!(played, log.bytes());

    // The crate `ublox` must find the same positions in the log.
    let mut parser = ublox::ParserBuilder::new().with_protocol::<ublox::proto27::Proto27>().with_vec_buffer();
    let mut found = parser.consume_ubx(log.bytes());
    let mut theirs = Vec::new();
    while let Some(message) = found.next() {
        if let Ok(ublox::UbxPacket::Proto27(ublox::proto27::PacketRef::NavPvt(pvt))) = message {
            theirs.push((pvt.itow(), pvt.longitude_raw(), pvt.latitude_raw()));
        }
    }
    let ours: Vec<_> = log.positions().iter().map(|p| (p.itow_ms, p.longitude_1e7, p.latitude_1e7)).collect();
    assert_eq!(ours, theirs);
}

#[test]
fn a_damaged_recording_is_played_only_if_it_holds_a_position() {
    if let Some(path) = recording("pygpsdata-BADCK2.log") {
        let log = Log::open(path).expect("it holds a position");
        assert_eq!((log.positions().len(), log.counts().ubx), (1, 25));
        assert_eq!(log.bursts().len(), 1, "all its messages are of one epoch");
    }
    if let Some(path) = recording("pygpsdata-BADHDR.log") {
        let Err(LogError::NoPosition { counts, .. }) = Log::open(path) else {
            panic!("its only NAV-PVT has a damaged header");
        };
        assert_eq!((counts.ubx, counts.nav_pvt, counts.nmea, counts.unknown_bytes), (2, 0, 0, 100));
    }
}
