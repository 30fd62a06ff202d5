//! Unit tests of the flight controller: its reads, and its misuses of the SSI.

use base_station_core::drone::Counts;
use emulator_part::SpiMode;
use profile::criticality::{BaseStation as BaseStationRole, Dpr, Writer};
use profile::image::Image;
use profile::uplink::Written;
use profile::{
    GpsObject, GpsStatus, GpsValues, Identifier, LinkStatus, LinkStatusBits, LinkValues, PortStatus, PortValues,
    Profile, Rejection, ReportedPosition, ReportedStatus, ReportedValues, UplinkValues,
};

use super::super::BaseStation;
use super::super::ssi::mock::{Done, Pins};
use super::*;
use crate::faults::WireFault;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

fn profile(timestamp: u32) -> Profile<3> {
    let position = GpsValues {
        status: GpsStatus::new().with_position_valid(true),
        latitude: 47.4979,
        longitude: 8.7289,
        altitude: 470.0,
        ..GpsValues::absent(timestamp)
    };
    Profile::seal(
        &ReportedValues { latitude: 47.4979, longitude: 8.7289, ..ReportedValues::absent(timestamp) },
        &[position; 3],
    )
}

fn link() -> LinkStatus {
    LinkStatus::seal(&LinkValues {
        timestamp: 77,
        status: LinkStatusBits::new().with_link_up(true),
        objects_accepted: 4,
        objects_rejected: 0,
        frames_received: 1,
        frames_missed: 0,
        age_100us: 60,
        access_violations: 0,
    })
}

fn image_of(profile: &Profile<3>) -> Vec<u8> {
    [link().as_bytes().as_slice(), profile.as_bytes()].concat()
}

struct Rig {
    controller: FlightController,
    pins: Pins,
    wires: Wires,
}

impl Rig {
    fn new(config: Config) -> Self {
        let wires = Wires::new(config.layout(), 1);
        Self { controller: FlightController::new(config), pins: Pins::showing(&[]), wires }
    }

    fn act(&mut self) -> Option<Progress> {
        assert!(self.controller.next_at() >= self.pins.now, "it never acts late");
        self.pins.now = self.controller.next_at();
        self.controller.act(&mut self.pins, &mut self.wires)
    }

    /// Runs one transaction in which the DPR sends `shown` and then zeros. Returns the bytes on MOSI.
    fn transact(&mut self, shown: &[u8]) -> Vec<u8> {
        self.pins.shown = shown.to_vec();
        loop {
            if let Some(Progress::Over(transaction)) = self.act() {
                return transaction.mosi;
            }
        }
    }

    fn run(&mut self, end: u64) -> Vec<Transaction> {
        let mut over = vec![];
        while self.controller.next_at() <= end {
            if let Some(Progress::Over(transaction)) = self.act() {
                over.push(transaction);
            }
        }
        self.pins.now = end;
        over
    }

    fn last(&self) -> &Reading {
        self.controller.last().expect("a transaction is over")
    }

    fn outcome(&self) -> Outcome {
        self.last().outcome
    }
}

fn rig() -> Rig {
    Rig::new(Config::new(3))
}

#[test]
fn a_transaction_keeps_the_timing_that_its_configuration_states() {
    let config = Config { first_ns: MS, ..Config::new(3) };
    let mut rig = Rig::new(config);
    for cycle in 0..3 {
        let start = MS + cycle * 4 * MS;
        assert_eq!(rig.controller.next_at(), start);
        assert_eq!(rig.act(), Some(Progress::Selected(start)));
        for run in 0..18 {
            let Some(Progress::Clocked(bytes)) = rig.act() else { panic!("bytes cross") };
            let last = (run * 16 + 16).min(276);
            let (first_ns, last_ns) = (bytes.edge(0), bytes.edge(bytes.mosi.len() - 1));
            assert_eq!((first_ns, last_ns), (start + (run * 16 + 2) * US, start + (last + 1) * US));
        }
        let Some(Progress::Over(over)) = rig.act() else { panic!("it is over") };
        assert_eq!((over.selected_ns, over.deselected_ns, over.bytes), (start, start + 279 * US, 276));
    }
    assert_eq!(Image::<3>::LEN, config.image_len());
}

#[test]
fn a_fast_crystal_gets_there_early_and_a_slow_one_late() {
    let at_cycle_1000 = |crystal_ppb| {
        let mut rig = Rig::new(Config { first_ns: 0, crystal_ppb, ..Config::new(1) });
        for _ in 0..1_000 {
            rig.transact(&[]);
        }
        rig.controller.next_at()
    };
    assert_eq!(at_cycle_1000(0), 4_000_000_000);
    // In 4 s a crystal error of 50 ppm adds up to 200 µs. The second-order term of the error is 10 ns.
    assert_eq!(at_cycle_1000(50_000), 4_000_000_000 - 199_990);
    assert_eq!(at_cycle_1000(-50_000), 4_000_000_000 + 200_010);
}

#[test]
fn a_control_cycle_that_just_holds_a_transaction_is_never_skipped() {
    for crystal_ppb in [-123_457, 1, 77_777] {
        let longest = Config::new(3).transaction_ns(276) + 10 * US;
        let mut rig = Rig::new(Config { cycle_ns: longest, crystal_ppb, ..Config::new(3) });
        let over = rig.run(1_000 * MS);
        for pair in over.windows(2) {
            let cycle = pair[1].selected_ns - pair[0].selected_ns;
            assert!(cycle.abs_diff(longest) <= 37, "{crystal_ppb}: {cycle}");
        }
    }
}

#[test]
fn placed_transactions_begin_at_their_instants() {
    let mut rig = Rig::new(Config { schedule: Schedule::Placed, ..Config::new(3) });
    assert_eq!(rig.controller.next_at(), u64::MAX);
    rig.controller.place(Placed { at_ns: 7 * MS, bytes: 96 });
    rig.controller.place(Placed { at_ns: 7 * MS + 99 * US + 10 * US, bytes: 1 });
    let over = rig.run(100 * MS);
    let placed: Vec<_> = over.iter().map(|over| (over.selected_ns, over.bytes)).collect();
    assert_eq!(placed, [(7 * MS, 96), (7 * MS + 109 * US, 1)]);
    assert_eq!(rig.controller.next_at(), u64::MAX);
}

#[test]
#[should_panic(expected = "none before 7109000 ns")]
fn a_transaction_cannot_be_placed_into_the_gap_after_another() {
    let mut rig = Rig::new(Config { schedule: Schedule::Placed, ..Config::new(3) });
    rig.controller.place(Placed { at_ns: 7 * MS, bytes: 96 });
    rig.controller.place(Placed { at_ns: 7 * MS + 108 * US, bytes: 1 });
}

#[test]
fn a_profile_is_forwarded_once_and_unchanged() {
    let mut rig = rig();
    let mut line = Vec::new();
    for (timestamp, is_new) in [(10, true), (10, false), (10, false), (20, true), (20, false), (50, true)] {
        rig.transact(&image_of(&profile(timestamp)));
        line.extend(rig.controller.take_downlink());
        let forwarded = is_new.then(|| profile(timestamp).as_bytes().to_vec());
        assert_eq!(rig.last().forwarded, forwarded);
    }
    let stats = rig.controller.stats();
    assert_eq!((stats.transactions, stats.fresh, stats.repeated, stats.busy, stats.bad_crc), (6, 3, 3, 0, 0));
    assert_eq!(stats.forwarded, 3);
    assert_eq!(rig.last().link, Some(link().values()));

    let mut deframer = stream::Deframer::new(Profile::<3>::SIZE);
    let frames: Vec<_> = line.iter().filter_map(|byte| deframer.push(*byte)).collect();
    let sent: Vec<_> = [10, 20, 50].iter().map(|t| Ok(profile(*t).as_bytes().to_vec())).collect();
    assert_eq!(frames, sent);
}

#[test]
fn its_client_shows_a_position_from_the_fourth_cycle_on() {
    let mut rig = Rig::new(Config { cycle_ns: 10 * MS, ..Config::new(3) });
    let shown: Vec<_> = (1..=5)
        .map(|cycle| {
            let mut valid = *profile(10 * cycle).reported();
            let status = ReportedStatus::new().with_position_valid(true);
            valid = ReportedPosition::seal(&ReportedValues { status, ..valid.values() });
            let mut image = image_of(&profile(10 * cycle));
            image[32..96].copy_from_slice(valid.as_bytes());
            rig.transact(&image);
            rig.last().report
        })
        .collect();
    let positions: Vec<_> = shown.iter().map(|report| report.position.map(|position| position.timestamp)).collect();
    assert_eq!(positions, [None, None, None, Some(40), Some(50)]);
    // Link-Status states 6.1 ms, and the DPR may have kept the image for up to 25 ms.
    assert_eq!(shown[4].age_us, 31_100);
    let ages: Vec<_> = (0..8)
        .map(|_| {
            rig.transact(&[0xFF; 276]);
            let report = rig.last().report;
            report.position.map(|_| report.age_us)
        })
        .collect();
    assert_eq!(ages[5..], [Some(91_100), None, None], "100 ms are the limit");
}

#[test]
fn a_busy_dpr_is_told_from_a_damaged_image() {
    let mut rig = rig();
    rig.transact(&[0xff; 276]);
    assert_eq!(rig.outcome(), Outcome::Busy);
    rig.transact(&[]);
    assert_eq!(rig.outcome(), Outcome::BadCrc);
    let image = image_of(&profile(10));
    for bit in 0..image.len() * 8 {
        let mut damaged = image.clone();
        damaged[bit / 8] ^= 0x80 >> (bit % 8);
        rig.transact(&damaged);
        assert_eq!(rig.outcome(), Outcome::BadCrc, "bit {bit}");
    }
    assert!(rig.controller.take_downlink().is_empty(), "nothing damaged is forwarded");
    rig.transact(&image);
    assert_eq!(rig.outcome(), Outcome::Fresh);
    let stats = rig.controller.stats();
    assert_eq!((stats.busy, stats.bad_crc, stats.fresh), (1, 1 + 276 * 8, 1));
}

#[test]
fn damage_is_reported_where_it_is() {
    let mut rig = rig();
    let mut image = image_of(&profile(10));
    image[96 + 60 + 30] ^= 1;
    rig.transact(&image);
    let last = rig.last();
    assert_eq!(last.damage, Some((156, Rejection::Crc)));
    assert_eq!((last.valid, last.timestamp), (3, Some(10)));
}

#[test]
fn an_image_without_a_profile_counts_as_repeated_and_not_as_damaged() {
    let mut rig = rig();
    rig.transact(&image_of(&Profile::<3>::EMPTY));
    assert_eq!(rig.outcome(), Outcome::Repeated);
    for fill in [0x00, 0xff] {
        let timestamp = 10 + u32::from(fill == 0xff) * 10;
        let mut image = image_of(&profile(timestamp));
        image[216..276].fill(fill);
        rig.transact(&image);
        let last = rig.last();
        assert_eq!((last.outcome, last.valid, last.vacant), (Outcome::Fresh, 3, 1));
        assert_eq!(last.forwarded.as_deref(), Some(&image[32..]), "it is forwarded as it was read");
    }
}

#[test]
fn a_valid_object_in_anothers_place_is_damage() {
    let mut rig = rig();
    let mut image = image_of(&profile(10));
    image.copy_within(96..156, 156);
    rig.transact(&image);
    assert_eq!((rig.outcome(), rig.last().damage), (Outcome::BadCrc, Some((156, Rejection::Identifier))));
}

#[test]
fn the_transaction_after_a_request_reads_its_window() {
    let mut rig = rig();
    let window = Request { offset: 32, length: 64 };
    rig.controller.request(window);
    let image = image_of(&profile(10));
    let mosi = rig.transact(&image);
    assert_eq!(mosi.len(), 276);
    let request = mosi.first_chunk().expect("eight bytes");
    assert_eq!(ssi::parse(request, 276), Ok(ssi::Parsed::Window(window)));
    assert!(mosi[8..].iter().all(|byte| *byte == 0));

    let mosi = rig.transact(&image[32..]);
    assert_eq!(mosi, [0; 64], "it asks for nothing");
    let last = rig.last();
    assert_eq!((last.offset, last.valid, last.timestamp), (32, 1, Some(10)));
    assert_eq!((last.outcome, last.link), (Outcome::Repeated, None));
    assert_eq!(rig.transact(&image).len(), 276, "and is back at the whole image");
}

#[test]
fn a_short_window_leaves_room_for_the_next_request() {
    let mut rig = rig();
    rig.controller.request(Request { offset: 32, length: 4 });
    rig.controller.request(Request { offset: 36, length: 2 });
    let image = image_of(&profile(10));
    rig.transact(&image);
    let mosi = rig.transact(&image[32..36]);
    let request = mosi.first_chunk().expect("eight bytes");
    assert_eq!(ssi::parse(request, 276), Ok(ssi::Parsed::Window(Request { offset: 36, length: 2 })));
    assert_eq!(rig.outcome(), Outcome::Repeated);
}

#[test]
fn a_request_that_met_a_busy_dpr_is_made_again() {
    let mut rig = rig();
    rig.controller.request(Request { offset: 96, length: 60 });
    let asking = rig.transact(&[0xff; 276]);
    let again = rig.transact(&image_of(&profile(10)));
    assert_eq!(asking, again);
    assert_eq!(rig.transact(profile(10).gps()[0].as_bytes()).len(), 60);
    assert_eq!(rig.last().valid, 1);
}

#[test]
fn a_window_that_met_a_busy_dpr_is_read_next() {
    let mut rig = rig();
    let image = image_of(&profile(10));
    rig.controller.request(Request { offset: 96, length: 60 });
    rig.transact(&image);
    // The busy DPR does not receive the second request, so the next transaction reads the window of the first.
    rig.controller.request(Request { offset: 216, length: 60 });
    let asking = rig.transact(&[0xff; 60]);
    assert_eq!(rig.outcome(), Outcome::Busy);
    assert_eq!(rig.transact(&image[96..156]), asking);
    assert_eq!((rig.last().offset, rig.last().valid), (96, 1));
    rig.transact(&image[216..]);
    assert_eq!((rig.last().offset, rig.last().valid), (216, 1));
    assert_eq!(rig.transact(&image).len(), 276, "and is back at the whole image");
}

#[test]
fn an_uplink_from_the_radio_takes_the_place_of_a_generated_one() {
    let config = Config { writes: true, relays: true, first_ns: 0, cycle_ns: 5 * MS, ..Config::new(3) };
    let mut rig = Rig::new(config);
    let image = image_of(&profile(10));
    let values = UplinkValues { timestamp: 9, payload: [3; 52], ..UplinkValues::default() };
    let uplink = Uplink::seal(Writer::<BaseStationRole>::claim(), &values);
    let port = PortStatus::seal(Writer::<Dpr>::claim(), &PortValues { timestamp: 70, ..PortValues::default() });
    let map = [&image[..], port.as_bytes(), uplink.as_bytes(), &[0; 64]].concat();
    let mut written = vec![];
    for cycle in 0..40 {
        if cycle == 10 {
            // The flight controller's own uplink is due in cycle 10 too.
            rig.controller.write(Written::BaseStation(&uplink));
        }
        let mosi = rig.transact(if uplinks::reads_map(cycle) { &map } else { &image });
        if let Ok(written_now) = Written::verify(&mosi[ssi::REQUEST_SIZE..ssi::REQUEST_SIZE + Uplink::SIZE]) {
            written.push((cycle, matches!(written_now, Written::BaseStation(_))));
        }
    }
    assert_eq!(written, [(10, true), (30, false)], "cycle, and whether it is the base station's");
    let ports = rig.controller.take_ports();
    assert_eq!(ports.len(), 4, "each tenth cycle");
    assert!(ports.iter().all(|(_, port)| port[..64] == *port_bytes(&map) && port[64..] == *uplink.as_bytes()));
    let mut damaged = map;
    damaged[280] ^= 1;
    for cycle in 40..50 {
        rig.transact(if uplinks::reads_map(cycle) { &damaged } else { &image });
    }
    assert_eq!(rig.controller.take_ports(), []);
}

fn port_bytes(map: &[u8]) -> &[u8] {
    &map[276..340]
}

#[test]
fn every_size_of_profile_reaches_the_base_station() {
    for receivers in [1, 2, 3, 5] {
        let mut rig = Rig::new(Config::new(receivers));
        let mut base = BaseStation::new(receivers);
        for timestamp in [10, 20] {
            let reported = profile(timestamp);
            let mut image = [link().as_bytes().as_slice(), reported.reported().as_bytes()].concat();
            for identifier in &Identifier::GPS[..receivers] {
                image.extend(GpsObject::seal(*identifier, &GpsValues::absent(timestamp)).as_bytes());
            }
            rig.transact(&image);
            base.receive(0, &rig.controller.take_downlink());
        }
        let counts = base.drone().counts();
        let expected = Counts { messages: 2, new: 2 + 2 * receivers as u64, ..Counts::default() };
        assert_eq!(counts, expected, "{receivers}");
    }
}

#[test]
fn it_sees_and_forwards_what_the_wires_made_of_miso() {
    let mut rig = rig();
    let image = image_of(&profile(10));
    rig.wires.begin(WireFault::MisoBit { byte: 40, bit: 0 });
    rig.transact(&image);
    assert_eq!((rig.outcome(), rig.last().damage), (Outcome::BadCrc, Some((32, Rejection::Crc))));
    rig.wires.end(WireFault::MisoBit { byte: 40, bit: 0 });
    rig.wires.begin(WireFault::MisoVacant { object: 3 });
    rig.transact(&image);
    let mut vacant = image[32..].to_vec();
    vacant[184..].fill(0);
    assert_eq!(rig.last().forwarded, Some(vacant));
    rig.controller.request(Request { offset: 216, length: 60 });
    rig.transact(&image);
    rig.transact(&image[216..]);
    assert_eq!((rig.last().offset, rig.last().vacant), (216, 1));
}

fn misused(conduct: Conduct, image: &[u8]) -> (Vec<Transaction>, Vec<Transaction>, Rig) {
    let mut rig = rig();
    rig.pins.shown = image.to_vec();
    let mut over = rig.run(10 * MS - 1);
    rig.controller.set_conduct(10 * MS, Some(conduct));
    over.extend(rig.run(50 * MS - 1));
    rig.controller.set_conduct(50 * MS, None);
    over.extend(rig.run(80 * MS));
    let meanwhile = over.iter().filter(|over| (10 * MS..50 * MS).contains(&over.selected_ns)).cloned().collect();
    (meanwhile, over, rig)
}

#[test]
fn misconduct_ends_on_time_and_the_normal_cycle_resumes() {
    for conduct in Conduct::ALL {
        let (_, all, rig) = misused(conduct, &image_of(&profile(10)));
        let sane = |over: &&Transaction| !(10 * MS..50 * MS).contains(&over.selected_ns);
        let at: Vec<u64> = all.iter().filter(sane).map(|over| over.selected_ns / MS).collect();
        assert_eq!(at, [4, 8, 52, 56, 60, 64, 68, 72, 76, 80][..9], "{conduct:?}");
        assert!(all.iter().filter(sane).all(|over| over.bytes == 276 && over.mosi == [0; 276]), "{conduct:?}");
        let levels = rig.pins.done.iter().filter(|done| !matches!(done, Done::Bytes(..)));
        let selects = levels.clone().step_by(2).all(|done| matches!(done, Done::Select(_)));
        let lets_go = levels.skip(1).step_by(2).all(|done| matches!(done, Done::Deselect(_)));
        assert!(selects && lets_go, "{conduct:?}: chip select falls and rises in turn");
        let late = all.iter().filter(|over| (50 * MS..52 * MS).contains(&over.deselected_ns));
        assert!(late.clone().count() <= 1, "{conduct:?}");
        assert!(late.into_iter().all(|over| over.deselected_ns <= 50 * MS + 3 * US), "{conduct:?}");
        let stats = rig.controller.stats();
        assert_eq!(stats.transactions, all.len() as u64, "{conduct:?}");
        assert_eq!(stats.transactions, stats.fresh + stats.repeated + stats.busy + stats.bad_crc, "{conduct:?}");
    }
}

#[test]
fn each_conduct_keeps_the_rate_that_it_states() {
    let image = image_of(&profile(10));
    // A row has the number of transactions that begin in 40 ms, and the bytes in each.
    for (conduct, count, bytes) in [
        (Conduct::Hammers, 8_000, 1),
        (Conduct::ZeroBytes, 3_077, 0),
        (Conduct::Hangs, 1, 0),
        (Conduct::RunsAway, 1, 39_998),
        (Conduct::TenThousand, 4, 10_000),
        (Conduct::TogglesCsn, 20_000, 0),
        (Conduct::ClocksWithoutCsn, 0, 0),
        (Conduct::BackToBack, 139, 276),
        (Conduct::OtherMode(SpiMode::Mode1), 10, 276),
        (Conduct::OtherMode(SpiMode::Mode2), 10, 276),
        (Conduct::OtherMode(SpiMode::Mode3), 10, 276),
        (Conduct::RandomBytes, 10, 276),
        (Conduct::Lies, 10, 96),
        (Conduct::ReplaysUplink, 10, 276),
        (Conduct::Silent, 0, 0),
        (Conduct::Edges(50_000), 800, 0),
        (Conduct::Every { period_ns: 200_000, bytes: 96 }, 200, 96),
        // The transaction takes 1 µs for set-up, 1 µs for its byte, 2 µs for hold, and a gap of 0.3 µs.
        (Conduct::Every { period_ns: 1_000, bytes: 1 }, 9_302, 1),
    ] {
        let (meanwhile, _, rig) = misused(conduct, &image);
        assert!(meanwhile.len().abs_diff(count) <= 1, "{conduct:?}: {} transactions", meanwhile.len());
        for over in &meanwhile[..meanwhile.len().saturating_sub(1)] {
            assert_eq!(over.bytes, bytes, "{conduct:?}");
        }
        assert!(meanwhile.last().is_none_or(|last| last.bytes.abs_diff(bytes) <= 1 || count > 1), "{conduct:?}");
        let past: usize =
            rig.pins.done.iter().map(|done| if let Done::Bytes(_, _, mosi, _) = done { mosi.len() } else { 0 }).sum();
        if conduct == Conduct::ClocksWithoutCsn {
            assert!((past - 9 * 276).abs_diff(40_000) <= 4, "{past} bytes past the DPR");
        }
    }
}

#[test]
fn a_transaction_under_way_comes_to_its_end_before_it_goes_wrong() {
    let mut rig = rig();
    rig.run(4 * MS + 100 * US);
    rig.controller.set_conduct(4 * MS + 100 * US, Some(Conduct::Hammers));
    let over = rig.run(4 * MS + 300 * US);
    assert_eq!((over[0].bytes, over[0].deselected_ns), (276, 4 * MS + 279 * US));
    assert_eq!((over[1].bytes, over[1].selected_ns), (1, 4 * MS + 289 * US));
}

#[test]
fn one_conduct_may_follow_another_at_once() {
    let mut rig = rig();
    rig.controller.set_conduct(MS, Some(Conduct::Hangs));
    assert_eq!(rig.run(3 * MS), []);
    rig.controller.set_conduct(3 * MS, Some(Conduct::BackToBack));
    let over = rig.run(4 * MS);
    assert_eq!((over[0].selected_ns, over[0].deselected_ns), (MS, 3 * MS + 2 * US));
    assert_eq!((over[1].selected_ns, over[1].bytes), (3 * MS + 12 * US, 276));
}

#[test]
fn placed_transactions_that_fall_into_an_episode_do_not_take_place() {
    let mut rig = Rig::new(Config { schedule: Schedule::Placed, ..Config::new(3) });
    for at_ns in [5 * MS, 15 * MS, 25 * MS] {
        rig.controller.place(Placed { at_ns, bytes: 10 });
    }
    rig.controller.set_conduct(8 * MS, Some(Conduct::Silent));
    rig.run(20 * MS);
    rig.controller.set_conduct(20 * MS, None);
    let over: Vec<u64> = rig.run(30 * MS).iter().map(|over| over.selected_ns).collect();
    assert_eq!(over, [25 * MS]);
}

#[test]
fn a_flight_controller_that_lies_makes_only_invalid_requests() {
    let mut misconduct = Misconduct::new(Conduct::Lies, Config::new(3), 5);
    let mut kinds = [0; 3];
    for _ in 0..300 {
        let mut mosi = misconduct.order().mosi;
        mosi.resize(96, 0);
        match ssi::parse(mosi.first_chunk().unwrap(), 276) {
            Ok(asked) => panic!("{asked:?} of {mosi:02x?}"),
            Err(Rejection::Window) => kinds[0] += 1,
            Err(_) if mosi[8..].iter().all(|byte| *byte == 0) => kinds[1] += 1,
            Err(_) => kinds[2] += 1,
        }
    }
    assert!(kinds.iter().all(|count| *count > 30), "{kinds:?}");
}

#[test]
fn random_bytes_follow_from_the_seed_and_the_episode() {
    let noise = |seed| {
        let mut rig = Rig::new(Config { seed, ..Config::new(3) });
        rig.controller.set_conduct(0, Some(Conduct::RandomBytes));
        let first = rig.transact(&[]);
        rig.controller.set_conduct(5 * MS, None);
        rig.controller.set_conduct(5 * MS, Some(Conduct::RandomBytes));
        [first, rig.transact(&[]), rig.transact(&[])]
    };
    let [first, second, third] = noise(1);
    assert_eq!(noise(1), [first.clone(), second.clone(), third.clone()]);
    assert!(first != second && second != third && first != third);
    assert_ne!(noise(2)[0], first);
}

#[test]
fn an_object_is_written_for_each_reason_to_refuse_one() {
    let mut writes = Misconduct::new(Conduct::WritesEach, Config::new(3), 1);
    let objects = (0..200).filter_map(|_| writes.order().mosi.get(8..72).map(<[u8]>::to_vec));
    let (accepted, refused): (Vec<_>, Vec<_>) =
        objects.map(|object| Written::verify(&object).map(|_| ())).partition(Result::is_ok);
    for rejection in [Rejection::Crc, Rejection::Identifier, Rejection::Command] {
        assert!(refused.contains(&Err(rejection)), "{rejection:?}");
    }
    assert!(accepted.len() > 50);
}

#[test]
fn the_uplink_object_that_is_replayed_is_intact_and_asks_for_nothing() {
    let mosi = Misconduct::new(Conduct::ReplaysUplink, Config::new(3), 1).order().mosi;
    assert_eq!(ssi::parse(mosi.first_chunk().unwrap(), 276), Ok(ssi::Parsed::Nothing));
    assert_eq!(mosi.len(), 72);
    assert!(profile::crc::frame_intact(&mosi[8..]));
    assert_eq!(mosi[12..14], Identifier::UPLINK_FLIGHT_CONTROLLER.0.to_le_bytes());
}
