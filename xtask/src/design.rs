//! Tests that docs/design.md states the numbers of the code.
//!
//! `layout::page` writes some tables of the page, and the rest is written by hand. Each test formats constants like the
//! page does, and checks that the page has each text exactly once.

use bench_judge::bounds;
use profile::air::{self, Place};
use profile::sequence;
use profile::ssi::{self, timing};
use profile::{Profile, Uplink, crc, image::Image};

const PAGE: &str = include_str!("../../docs/design.md");

fn states(numbers: &[String]) {
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let page = words(PAGE);
    for number in numbers {
        assert_eq!(page.matches(&words(number)).count(), 1, "docs/design.md does not have once: {number}");
    }
}

fn ms(ns: u64) -> String {
    (ns as f64 / 1e6).to_string()
}

fn us(ns: u64) -> String {
    (ns as f64 / 1e3).to_string()
}

#[test]
fn the_design_states_sizes_and_offsets() {
    let sizes = [Profile::<1>::SIZE, Profile::<2>::SIZE, Profile::<3>::SIZE, Profile::<5>::SIZE];
    let [one, two, three, five] = sizes;
    states(&[
        format!("{one}, {two}, {three} or {five} bytes"),
        format!("begins at {}, and its longitude at {}.", Image::<3>::place(2).expect("GPS2").start, 96 + 60 + 16),
    ]);
}

#[test]
fn the_design_states_both_crcs() {
    states(&[
        format!("| 0x{:08X} | 0x{:08X} |\n| polynomial in Koopman", crc::FRAME.poly, crc::POSITION.poly),
        format!("| 0x{:08X} | 0x{:08X} |\n| register", crc::FRAME.check, crc::POSITION.check),
        format!("| 0x{:08X} | 0x{:08X} |\n\n", crc::FRAME.residue, crc::POSITION.residue),
    ]);
}

#[test]
fn the_design_states_air_times_and_send_slots() {
    fn row<const N: usize>(frame: usize) -> String {
        let payload = Place::of_frame::<N>(frame).expect("a frame").length();
        let air = air::air_time_ns(u8::try_from(payload).expect("a payload")) as f64 / 1e6;
        let slot = air::send_slot_us::<N>(frame).expect("a slot");
        format!("| {payload} | {air:.3} | {slot} |")
    }
    states(&[row::<1>(0), row::<2>(0), row::<3>(0), row::<5>(0), row::<5>(1)]);
    states(&[format!("there are at least {} µs", air::MIN_GAP_US)]);
}

#[test]
fn the_design_states_sequence_and_ssi() {
    states(&[
        format!("{} ms · (1 + missed), with at most {} missed", profile::CYCLE_MS, sequence::MAX_MISSED),
        format!("within {} ms + {} %", f64::from(sequence::TOLERANCE_US) / 1e3, 100 / sequence::TOLERANCE_SHARE),
        format!("{} ms ± {} ms", profile::CYCLE_MS, f64::from(sequence::SEARCH_TOLERANCE_US) / 1e3),
        format!("compared over {} s", sequence::CLOCK_WINDOW_US / 1_000_000),
        format!("at {} MHz at most", timing::MAX_CLOCK_HZ / 1_000_000),
        format!("a request of {} bytes", ssi::REQUEST_SIZE),
        format!("u16 status, {} bytes,", Uplink::PAYLOAD),
        format!("shows it for {} ms", Uplink::EXPIRY_MS),
        format!("grants {} transactions", bounds::SSI_BUDGET),
        format!(
            "{} µs from CSN's fall to the first edge of SCK, {} µs from its last edge to CSN's rise, and {} µs",
            timing::CSN_SETUP_NS / 1_000,
            timing::CSN_HOLD_NS / 1_000,
            timing::GAP_NS / 1_000
        ),
    ]);
}

#[test]
fn the_design_states_the_bounds_of_the_judge() {
    states(&[
        format!("within {} ms of the last one's end", ms(bounds::FRAME_DEADLINE)),
        format!("within {} ms of its publication", ms(bounds::EXPIRY)),
        format!("(shown for {} s)", bounds::RESTART_SHOWN / 1_000_000_000),
        format!("within the last {} ms:", ms(bounds::HEARD)),
        format!("one period of its receiver and {} ms", ms(bounds::VALID_BEYOND_PERIOD)),
        format!("from one period and {} ms on", ms(bounds::STALE_BEYOND_PERIOD)),
        format!("as the receiver keeps it, at most {} s", bounds::LONGEST_PERIOD_MS / 1_000),
        format!("in steps of {} ms (bits 10 to 15); {}: ", ms(bounds::AGE_STEP), bounds::AGE_OLDEST),
        format!("{}: there never was one", bounds::AGE_NEVER),
        format!("from the last one than {} m/s", bounds::FASTEST_MM_S / 1_000),
        format!("of HORUS is {} ms", ms(bounds::CYCLE)),
        format!(
            "peak to peak | {} µs; {} µs on",
            us(bounds::TICK_TO_COMMAND_JITTER),
            us(bounds::TICK_TO_COMMAND_JITTER_PESSIMISTIC)
        ),
        format!("peak to peak | {} µs, of which", us(bounds::TICK_TO_AIR_JITTER)),
        format!("{} ms always and on every clock", ms(bounds::LAST_BIT_TO_READABLE)),
        format!("read after the frame only | {} ms |", ms(bounds::STORE_AND_FORWARD)),
        format!("ready for the next | {} µs |", us(bounds::SSI_READY)),
        format!("load of either processor | {} % |", bounds::LOAD_PER_10_000 / 100),
    ]);
}
