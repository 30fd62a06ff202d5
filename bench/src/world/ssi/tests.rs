//! Unit tests of the state machine that carries out SSI transactions.

use super::mock::{Done, Pins};
use super::*;

const STANDARD: Crystal = Crystal { ppb: 0 };

fn at(bench_ns: u64) -> Start {
    Start { bench_ns, own_ns: 0 }
}

fn run(master: &mut SsiMaster, pins: &mut Pins, end: u64) -> Vec<Progress> {
    let mut told = vec![];
    while master.next_at() <= end {
        assert!(master.next_at() >= pins.now, "due at {} ns, and it is {} ns", master.next_at(), pins.now);
        pins.now = master.next_at();
        told.extend(master.act(pins));
    }
    pins.now = end;
    told
}

#[test]
fn a_transaction_is_clocked_in_runs_of_16_bytes() {
    let mut pins = Pins::showing(&[7, 8, 9]);
    let mut master = SsiMaster::new(STANDARD);
    let order = Order { mosi: vec![1, 2], ..Order::read(20) };
    let over = pins.carry(&mut master, at(5_000), order);
    let first: Vec<u8> = [1, 2].into_iter().chain([0; 14]).collect();
    let bytes = |first, last, mosi| Done::Bytes(first, last, mosi, SpiMode::Mode0);
    let done = [
        Done::Select(5_000),
        bytes(7_000, 22_000, first.clone()),
        bytes(23_000, 26_000, vec![0; 4]),
        Done::Deselect(28_000),
    ];
    assert_eq!(pins.done, done);
    assert_eq!((over.selected_ns, over.deselected_ns, over.bytes), (5_000, 28_000, 20));
    assert_eq!((&over.mosi[..16], &over.miso[..4]), (&first[..], &[7, 8, 9, 0][..]));
    assert_eq!((over.mosi.len(), over.miso.len()), (20, 20));
    assert_eq!(master.free_at(), 38_000, "and the gap");
    assert!(master.is_idle());
    assert_eq!(master.next_at(), u64::MAX);
}

#[test]
fn a_run_ends_with_the_byte_that_raises_an_event() {
    let mut pins = Pins::showing(&[]);
    pins.quiet = 3;
    pins.carry(&mut SsiMaster::new(STANDARD), at(0), Order::read(8));
    let lengths =
        pins.done.iter().filter_map(|done| if let Done::Bytes(_, _, mosi, _) = done { Some(mosi.len()) } else { None });
    assert_eq!(lengths.collect::<Vec<_>>(), [3, 3, 2]);
}

#[test]
fn instants_go_by_the_crystal_from_the_start_on() {
    let crystal = Crystal { ppb: 50_000 };
    // In 4 s a crystal error of 50 ppm adds up to 200 µs. The second-order term of the error is 10 ns.
    assert_eq!(crystal.by_the_bench(4_000_000_000), 4_000_000_000 - 199_990);
    assert_eq!(Crystal { ppb: -50_000 }.by_the_bench(4_000_000_000), 4_000_000_000 + 200_010);
    let mut master = SsiMaster::new(crystal);
    master.begin(Start { bench_ns: 100, own_ns: 4_000_000_000 }, Order::read(1));
    assert_eq!(master.next_at(), 4_000_000_100 - 199_990);
    let long = Order { pace: Pace { byte_ns: 20_000_000, ..Pace::FASTEST }, ..Order::read(2) };
    let mut pins = Pins::showing(&[]);
    let over = pins.carry(&mut SsiMaster::new(crystal), at(0), long);
    // In 40.003 ms an error of 50 ppm adds up to 2 µs.
    assert_eq!(over.deselected_ns, 40_003_000 - 2_000);
}

#[test]
fn each_byte_of_a_run_has_its_last_edge() {
    // The crystal is 2.5 % fast, so each byte ends slightly less than 2, 3, 4 or 5 µs after the start.
    let mut master = SsiMaster::new(Crystal { ppb: 25_000_000 });
    let mut pins = Pins::showing(&[5, 6, 7, 8]);
    master.begin(at(100), Order { mosi: vec![1, 2, 3, 4], ..Order::read(4) });
    let told = run(&mut master, &mut pins, 6_000);
    let Some(Progress::Clocked(run)) = told.last() else { panic!("{told:?}") };
    let edges = [(2_051, 1, 5), (3_027, 2, 6), (4_002, 3, 7), (4_978, 4, 8)];
    assert_eq!(run.bytes().collect::<Vec<_>>(), edges);
}

#[test]
fn a_transaction_without_a_byte_has_no_clock() {
    let mut pins = Pins::showing(&[]);
    let over = pins.carry(&mut SsiMaster::new(STANDARD), at(0), Order::read(0));
    assert_eq!(pins.done, [Done::Select(0), Done::Deselect(3_000)]);
    assert_eq!((over.bytes, over.miso), (0, vec![]));
}

#[test]
fn a_transaction_that_does_not_let_go_ends_when_it_is_cut() {
    let mut master = SsiMaster::new(STANDARD);
    let mut pins = Pins::showing(&[]);
    master.begin(at(0), Order { lets_go: false, ..Order::read(2) });
    run(&mut master, &mut pins, 1_000_000);
    assert_eq!((master.next_at(), master.free_at()), (u64::MAX, u64::MAX));
    master.cut(1_000_000);
    assert_eq!((master.next_at(), master.free_at()), (1_002_000, 1_012_000));
    let told = run(&mut master, &mut pins, 1_100_000);
    assert!(matches!(&told[..], [Progress::Over(over)] if over.bytes == 2 && over.deselected_ns == 1_002_000));
    assert_eq!(master.free_at(), 1_012_000);
}

#[test]
fn a_transaction_that_is_cut_clocks_its_current_byte_to_the_end() {
    // The bytes take 1 µs each.
    for (cut, bytes, rises) in [(50_500, 50, 53_000), (50_000, 49, 52_000), (1_000, 0, 3_000), (400, 0, 2_400)] {
        let mut master = SsiMaster::new(STANDARD);
        let mut pins = Pins::showing(&[]);
        master.begin(at(0), Order::read(Order::ENDLESS));
        run(&mut master, &mut pins, cut);
        assert_eq!(master.free_at(), u64::MAX);
        master.cut(cut);
        let told = run(&mut master, &mut pins, 1_000_000);
        let Some(Progress::Over(over)) = told.last() else { panic!("cut at {cut}: {told:?}") };
        assert_eq!((over.bytes, over.miso.len(), over.deselected_ns), (bytes, bytes, rises), "cut at {cut}");
        assert_eq!(master.free_at(), rises + 10_000, "cut at {cut}");
    }
}

#[test]
fn a_transaction_that_has_not_begun_is_dropped_when_it_is_cut() {
    let mut master = SsiMaster::new(STANDARD);
    master.begin(at(500), Order::read(4));
    master.cut(400);
    assert!(master.is_idle());
}

#[test]
fn clocks_without_chip_select_reach_the_pins_and_are_no_transaction() {
    let mut master = SsiMaster::new(STANDARD);
    let mut pins = Pins::showing(&[]);
    master.begin(at(0), Order { selects: false, ..Order::read(20) });
    assert_eq!(run(&mut master, &mut pins, 1_000_000), []);
    assert!(master.is_idle());
    assert!(pins.done.iter().all(|done| matches!(done, Done::Bytes(..))), "{:?}", pins.done);
    assert_eq!(pins.take_mosi(), [0; 20]);
}

#[test]
fn a_very_long_transaction_is_counted_whole_and_kept_in_part() {
    let mut pins = Pins::showing(&[1; KEPT + 100]);
    let noise = Filler::Noise(Rng::new(3));
    let over = pins.carry(&mut SsiMaster::new(STANDARD), at(0), Order { filler: noise, ..Order::read(KEPT + 50) });
    assert_eq!((over.bytes, over.mosi.len(), over.miso.len()), (KEPT + 50, KEPT, KEPT));
    let mosi = pins.take_mosi();
    assert_eq!((mosi.len(), &mosi[..KEPT]), (KEPT + 50, &over.mosi[..]));
    let mut noise = Rng::new(3);
    assert!(mosi.iter().all(|byte| *byte == noise.byte()));
}

#[test]
fn the_mode_and_what_mosi_carries_are_as_ordered() {
    let mut pins = Pins::showing(&[]);
    let order = Order { mosi: vec![9], filler: Filler::Byte(0xFF), mode: SpiMode::Mode2, ..Order::read(3) };
    pins.carry(&mut SsiMaster::new(STANDARD), at(0), order);
    assert_eq!(pins.done[1], Done::Bytes(2_000, 4_000, vec![9, 0xFF, 0xFF], SpiMode::Mode2));
}

#[test]
#[should_panic(expected = "a transaction is under way")]
fn one_transaction_is_carried_at_a_time() {
    let mut master = SsiMaster::new(STANDARD);
    master.begin(at(0), Order::read(1));
    master.begin(at(0), Order::read(1));
}
