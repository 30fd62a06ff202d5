//! Places the flight controller's transactions in every phase relative to a frame's end, in steps of 100 ns, because an
//! ordinary control cycle reaches some coincidences once in minutes.
//!
//! Each phase around a publication has two patterns of transactions. In the first, the transaction of a whole image
//! ends at the phase, and 96 bytes are read right after it. In the second, 96 bytes are read at the phase, after a long
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

/// The first phase, ns from a frame's last bit. After that bit, the publication comes at 60 to 100 µs, and the scrub at
/// 240 µs.
const FIRST: i64 = -60 * US;
const LAST: i64 = 240 * US;

/// The last phase with one or five receivers, ns from a frame's last bit. It covers only the publication: the scrub
/// after it does not depend on the number of receivers.
const LAST_OF_PUBLICATION: i64 = 120 * US;

/// The time between two transactions, ns, which is 1 µs longer than the DPR needs to be ready.
const GAP: i64 = timing::GAP_NS as i64 + US;

fn falls(after_ns: i64, bytes: usize) -> Placement {
    Placement { edge: Edge::Falls, after_ns, bytes: Some(bytes) }
}

/// Runs the transactions of `sweep`, and prints the longest times. Asserts that no coincidence leads to a violation.
fn holds(gps: usize, sweep: Sweep, clock: Clock, (horus_ppb, dpr_ppb): (i64, i64)) {
    let (Some(horus), Some(dpr)) = (image(gps, "horus-tx-fw.elf"), image(gps, "dpr-fw.elf")) else { return };
    let cycles = sweep.cycles();
    // The sweep begins with the second frame, which on a slower clock comes up to four cycles later.
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
    // Only the objects of the cycles with which the DPR finds the sequence are rejected.
    let searched = u64::from(SEARCH_CYCLES) * (gps as u64 + 1);
    assert_eq!((outcome.report.ssi.bad_crc, outcome.report.dpr.objects_rejected), (0, searched), "{gps} receivers");
}

/// Places transactions in every phase around the publication of frame `frame` of the cycle (from 0), up to the phase
/// `last`.
fn around_a_publication(gps: usize, frame: usize, last: i64, clock: Clock, crystals: (i64, i64)) {
    let whole = Placement { edge: Edge::Rises, after_ns: 0, bytes: None };
    // The last transaction comes 0.7 ms after the phase, and reads the image that was published.
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

/// On the pessimistic clock all work takes the longest time that silicon may take.
#[test]
fn publications_on_the_pessimistic_clock_may_meet_transactions_in_any_phase() {
    around_a_publication(3, 0, LAST + 60 * US, Clock::Pessimistic, (-200_000, 200_000));
}

#[test]
fn a_publication_with_five_receivers_may_meet_a_transaction_in_any_phase() {
    around_a_publication(5, 1, LAST_OF_PUBLICATION, Clock::Fast, (200_000, -200_000));
}

/// Once a second the DPR's idle task has more work, which it begins when an event wakes it. Between two frames this
/// event is the end of the pause after a transaction, 96 to 106 µs after that transaction. A second transaction that
/// ends 109 to 127 µs after the first therefore coincides with the work.
///
/// The DPR's second moves relative to HORUS's cycle by 400 µs each time, so a run of 25 s covers many distances of the
/// work from a frame.
#[test]
fn what_the_dpr_does_once_a_second_holds_no_transaction_up() {
    let pairs = |gap: i64| {
        let pair = |at: i64| [falls(at, 8), falls(at + i64::from(timing::SPACING_NS) + gap, 8)];
        (0..7).flat_map(|place| pair(place * 650 * US)).collect()
    };
    // The patterns are tried in turn, one in each of the 100 cycles of a second. Their number is prime, so successive
    // seconds use different patterns.
    let patterns = (0..19).map(|pattern| pairs(pattern * US)).collect();
    let sweep = Sweep { frame: 0, from_ns: 300 * US, to_ns: 313_100, step_ns: 100, patterns };
    holds(3, sweep, Clock::Fast, (200_000, -200_000));
}
