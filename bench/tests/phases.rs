//! Places the flight controller's transactions in every phase relative to a frame's end, in steps of 100 ns. With an
//! ordinary control cycle, minutes may pass before some of these coincidences occur.
//!
//! The transactions around a publication have two patterns. In the first, a transaction of the whole image ends at the
//! phase, and one of 96 bytes follows at once. In the second, a transaction of 96 bytes begins at the phase after a
//! silence.
//!
//! The boards' crystals are wrong by 200 ppm in opposite directions, and each phase is counted from its own frame.

use crate::boards;

use bench::sim::phases::{Edge, Phase, Placement, Sweep};
use bench::sim::{Crystals, Images, Setup, run};
use boards::image;
use emulator_node::Clock;
use profile::sequence::SEARCH_CYCLES;
use profile::ssi::timing;

const US: i64 = 1_000;

/// The first phase, ns after a frame's last bit. The publication comes at 60 to 100 µs, and the scrub of the buffer at
/// 240 µs.
const FIRST: i64 = -60 * US;
const LAST: i64 = 240 * US;

/// The last phase in runs with one or five receivers, ns after a frame's last bit. These runs leave out the later
/// scrub, because it is the same with any number of receivers.
const LAST_OF_PUBLICATION: i64 = 120 * US;

/// The time between two transactions, ns, which is 1 µs longer than the DPR needs to be ready.
const GAP: i64 = timing::GAP_NS as i64 + US;

fn falls(after_ns: i64, bytes: usize) -> Placement {
    Placement { edge: Edge::Falls, after_ns, bytes: Some(bytes) }
}

/// Runs a sweep, prints its longest times, and asserts that there is no violation.
fn holds(gps: usize, sweep: Sweep, clock: Clock, (horus_ppb, dpr_ppb): (i64, i64)) {
    let (Some(horus), Some(dpr)) = (image(gps, "horus-tx-fw.elf"), image(gps, "dpr-fw.elf")) else { return };
    let cycles = sweep.cycles();
    // The sweep begins with the second frame. A slower clock may delay that frame by four cycles.
    let setup = Setup {
        crystals: Crystals { horus_ppb, dpr_ppb, flight_controller_ppb: 0, hold_ppb: 0 },
        sweep: Some(sweep.clone()),
        clock,
        ..Setup::new(Images { horus, dpr }, gps, (cycles + 7) * 10_000_000)
    };
    let outcome = run(&setup, &mut ()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(outcome.phases.len() as u64, cycles, "every phase was swept");
    let worst = |time: fn(&Phase) -> i64| {
        let phase = outcome.phases.iter().max_by_key(|phase| time(phase)).expect("a phase");
        (time(phase), phase.phase_ns, phase.pattern)
    };
    println!("{gps} receivers, frame {}: (worst, ns; phase, ns after the last bit; pattern)", sweep.frame + 1);
    println!("  last bit to FRESH  {:?}", worst(|phase| phase.fresh_ns().unwrap_or(0)));
    println!("  SSI ready          {:?}", worst(Phase::ready_ns));
    println!("  SSI held           {:?}", worst(Phase::hold_ns));
    for broken in &outcome.verdict.violations {
        let phase = outcome.phases.iter().rev().find(|phase| phase.frame_ended <= broken.first_at + 1_000_000);
        if let Some(phase) = phase {
            println!("  {broken}: pattern {} at {} ns: {:?}", phase.pattern, phase.phase_ns, phase.events);
        }
    }
    assert_eq!(outcome.report.violations, [""; 0], "{gps} receivers");
    let searched = u64::from(SEARCH_CYCLES) * (gps as u64 + 1);
    assert_eq!((outcome.report.ssi.bad_crc, outcome.report.dpr.objects_rejected), (0, searched), "{gps} receivers");
}

/// Places transactions around the publication of a cycle's frame `frame` (from 0), in phases up to `last`.
fn around_a_publication(gps: usize, frame: usize, last: i64, clock: Clock, crystals: (i64, i64)) {
    let whole = Placement { edge: Edge::Rises, after_ns: 0, bytes: None };
    // The last transaction reads the published image.
    let witness = falls(700 * US, 96);
    let patterns = vec![vec![whole, falls(GAP, 96), witness], vec![falls(0, 96), witness]];
    holds(gps, Sweep { frame, from_ns: FIRST, to_ns: last, step_ns: 100, patterns }, clock, crystals);
}

#[test]
fn a_publication_with_one_receiver_may_meet_a_transaction_in_any_phase() {
    around_a_publication(1, 0, LAST_OF_PUBLICATION, Clock::Fast, (-200_000, 200_000));
}

#[test]
fn a_publication_with_three_receivers_may_meet_a_transaction_in_any_phase() {
    around_a_publication(3, 0, LAST, Clock::Fast, (200_000, -200_000));
}

#[test]
fn publications_on_the_pessimistic_clock_may_meet_transactions_in_any_phase() {
    around_a_publication(3, 0, LAST + 60 * US, Clock::Pessimistic, (-200_000, 200_000));
}

#[test]
fn a_publication_with_five_receivers_may_meet_a_transaction_in_any_phase() {
    around_a_publication(5, 1, LAST_OF_PUBLICATION, Clock::Fast, (200_000, -200_000));
}

/// Once a second the DPR's idle task has additional work. It begins this work at its next event, the end of the pause
/// after a transaction. A second transaction that ends 109 to 127 µs after the first therefore comes during this work.
///
/// The DPR's second begins 400 µs later in HORUS's cycle each time, so a run of 25 s has the work at many distances
/// from a frame.
#[test]
fn what_the_dpr_does_once_a_second_holds_no_transaction_up() {
    let pairs = |gap: i64| {
        let pair = |at: i64| [falls(at, 8), falls(at + i64::from(timing::SPACING_NS) + gap, 8)];
        (0..7).flat_map(|place| pair(place * 650 * US)).collect()
    };
    // The number of patterns is prime, so that successive seconds use different ones.
    let patterns = (0..19).map(|pattern| pairs(pattern * US)).collect();
    let sweep = Sweep { frame: 0, from_ns: 300 * US, to_ns: 313_100, step_ns: 100, patterns };
    holds(3, sweep, Clock::Fast, (200_000, -200_000));
}
