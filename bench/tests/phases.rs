//! Places the flight controller's transactions in every phase relative to the end of a frame, in steps of 100 ns.
//! Coincidences that an ordinary control cycle reaches once in minutes therefore all occur.
//!
//! Around the publication of an image each phase is tested with two patterns: a whole image whose transaction ends at
//! that phase, with 96 bytes right after it, and 96 bytes that begin at that phase after a long silence. The crystals
//! of the boards are wrong by 200 ppm in opposite directions; the phases do not depend on the crystals.

use crate::boards;

use bench::sim::phases::{Edge, Phase, Placement, Sweep};
use bench::sim::{Crystals, Images, Setup, run};
use boards::image;
use emulator_node::Clock;
use profile::sequence::SEARCH_CYCLES;
use profile::ssi::timing;

const US: i64 = 1_000;

/// The first phase, ns from a frame's last bit. The publication comes 60 to 100 us after that bit, and the work that
/// follows it (the scrub of three buffers) ends 240 us after that bit.
const FIRST: i64 = -60 * US;
const LAST: i64 = 240 * US;

/// The last phase with one or five receivers, ns from a frame's last bit; the sweep covers only the publication.
/// Transactions still end in every phase up to 230 us, because one more in each cycle ends 100 or 110 us later, and
/// they begin in every phase up to 131 us. The scrub that follows is the same code for any number of receivers and
/// differs only in its length.
const LAST_OF_PUBLICATION: i64 = 120 * US;

/// The time from the end of a transaction to the beginning of the next, ns: 1 us more than the time within which the
/// DPR promises to be ready.
const GAP: i64 = timing::GAP_NS as i64 + US;

fn falls(after_ns: i64, bytes: usize) -> Placement {
    Placement { edge: Edge::Falls, after_ns, bytes: Some(bytes) }
}

/// Runs the transactions of `sweep` and prints the longest times. No coincidence may lead to a violation.
fn holds(gps: usize, sweep: Sweep, clock: Clock, (horus_ppb, dpr_ppb): (i64, i64)) {
    let (Some(horus), Some(dpr)) = (image(gps, "horus-tx-fw.elf"), image(gps, "dpr-fw.elf")) else { return };
    let cycles = sweep.cycles();
    // The sweep begins with the second frame. On a slower clock that frame comes up to four cycles later, so the run is
    // longer.
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
    // The first violation of each kind is printed with the events around it.
    for broken in &outcome.verdict.violations {
        let phase = outcome.phases.iter().rev().find(|phase| phase.frame_ended <= broken.first_at + 1_000_000);
        if let Some(phase) = phase {
            println!("  {broken}: pattern {} at {} ns: {:?}", phase.pattern, phase.phase_ns, phase.events);
        }
    }
    assert_eq!(outcome.report.violations, [""; 0], "{gps} receivers");
    // All objects of the cycles with which the DPR finds the sequence are rejected, and no others.
    let searched = u64::from(SEARCH_CYCLES) * (gps as u64 + 1);
    assert_eq!((outcome.report.ssi.bad_crc, outcome.report.dpr.objects_rejected), (0, searched), "{gps} receivers");
}

/// Sweeps transactions around the publication that frame number `frame` of the cycle, from 0, leads to, in every phase
/// from [`FIRST`] to `last`.
fn around_a_publication(gps: usize, frame: usize, last: i64, clock: Clock, crystals: (i64, i64)) {
    let whole = Placement { edge: Edge::Rises, after_ns: 0, bytes: None };
    // A further transaction comes 0.7 ms after the phase's instant, so it certainly reads the published image.
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

/// On the pessimistic clock everything takes the longest that silicon may take, so the work that the scrub triggers
/// also comes later.
#[test]
fn publications_on_the_pessimistic_clock_may_meet_transactions_in_any_phase() {
    around_a_publication(3, 0, LAST + 60 * US, Clock::Pessimistic, (-200_000, 200_000));
}

#[test]
fn a_publication_with_five_receivers_may_meet_a_transaction_in_any_phase() {
    around_a_publication(5, 1, LAST_OF_PUBLICATION, Clock::Fast, (200_000, -200_000));
}

/// The DPR's idle task wakes at every event and does the work that is due once a second. In the silence between two
/// frames it is woken by the end of the pause after a transaction, 96 to 106 us after the transaction's end. Another
/// transaction that ends 109 to 127 us after the first, which is as early as possible, coincides with that work. The
/// DPR's whole seconds move by 400 us a second relative to HORUS's cycle. In 25 s, therefore, the work of half of the
/// seconds falls into that silence, each time at another distance from a frame.
#[test]
fn what_the_dpr_does_once_a_second_holds_no_transaction_up() {
    let pairs = |gap: i64| {
        let pair = |at: i64| [falls(at, 8), falls(at + i64::from(timing::SPACING_NS) + gap, 8)];
        (0..7).flat_map(|place| pair(place * 650 * US)).collect()
    };
    // The number of patterns is a prime, so a different pattern is used in each second, which is 100 cycles after the
    // one before.
    let patterns = (0..19).map(|pattern| pairs(pattern * US)).collect();
    let sweep = Sweep { frame: 0, from_ns: 300 * US, to_ns: 313_100, step_ns: 100, patterns };
    holds(3, sweep, Clock::Fast, (200_000, -200_000));
}
