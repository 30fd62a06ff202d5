//! Tests HORUS's release program without the board's external clock. The clock is absent from the start (as on a NUCLEO
//! whose ST-LINK has no power) or fails later.

use crate::{boards, reader};

use bench::boards::Horus;
use boards::{RAM_TEST, counter};
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use emulator_node::{Node, Relay, Threads};
use emulator_part::Reset;
use firmware_common::last_stop::Cause;
use horus_tx_fw::telemetry::Telemetry as HorusTelemetry;
use profile::sequence::SEARCH_CYCLES;
use profile::{LinkStatusBits, Object, ReportedPosition};
use reader::{Antenna, MS, Reader, US};
use st25r3916_model::AirEvent;
use stm32f429::Oscillators;

const FIELD_OFF: u64 = 100 * US;

/// HORUS's watchdog takes 100 ms at 32 kHz, but its oscillator may run at 17 kHz (DS9405 table 42).
const BITE: u64 = 200 * MS;

#[test]
fn the_dpr_accepts_what_horus_sends_without_a_crystal() {
    for hsi_ppb in [0, 10_000_000, -10_000_000] {
        let oscillators = Oscillators { hse_hz: None, hsi_ppb, ..Oscillators::default() };
        let (Some(a), Some(b)) = (boards::horus_on(oscillators), boards::dpr()) else { return };
        let mut relay = Relay { a, b, upstream: Antenna::default(), downstream: Reader::new() };
        // The DPR compares HORUS's clock with its own over windows of about a second. The run is longer than two of
        // these windows.
        relay.run(2_300 * MS, 100 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
        let Relay { a: horus, b: dpr, upstream, downstream: reader } = relay;
        assert!(!horus.part().has_hse());
        assert_eq!(counter(&horus, "HORUS_TELEMETRY", std::mem::offset_of!(HorusTelemetry, without_crystal)), 1);
        assert_eq!(horus.resets().len(), 0, "{hsi_ppb} ppb");

        let cycle = u64::try_from(10_000_000 * 1_000_000_000_i64 / (1_000_000_000 + hsi_ppb)).unwrap();
        assert!(reader.sent.len() >= 220, "{hsi_ppb} ppb: {} frames", reader.sent.len());
        for pair in reader.sent.windows(2) {
            let took = pair[1].started - pair[0].started;
            assert!(took.abs_diff(cycle) <= 3_000, "{hsi_ppb} ppb: {took} ns");
            assert_eq!(pair[1].timestamp() - pair[0].timestamp(), 10);
        }
        for frame in &reader.sent {
            let position = ReportedPosition::verify(&frame.payload[..ReportedPosition::SIZE]).unwrap();
            assert!(position.values().status.without_crystal(), "{hsi_ppb} ppb: {} ms", position.timestamp());
        }
        let after = |tick: u64| upstream.transmits.iter().find(|at| **at > tick).map(|at| at - tick);
        let delays: Vec<u64> = upstream.ticks.iter().filter_map(|tick| after(*tick)).collect();
        let (least, most) = (*delays.iter().min().unwrap(), *delays.iter().max().unwrap());
        println!("HSI {hsi_ppb} ppb: tick to command {least} to {most} ns, {} ns peak to peak", most - least);
        assert!(delays.len() >= 220);
        assert!(most - least <= bench_judge::bounds::TICK_TO_COMMAND_JITTER, "{hsi_ppb} ppb");

        let count = |offset| counter(&dpr, "DPR_TELEMETRY", offset);
        let received = count(std::mem::offset_of!(DprTelemetry, frames_received));
        let accepted = count(std::mem::offset_of!(DprTelemetry, objects_accepted));
        assert!(usize::try_from(received).unwrap() + 1 >= reader.sent.len(), "{hsi_ppb} ppb: {received}");
        assert_eq!(accepted, (received - u32::from(SEARCH_CYCLES)) * 4, "{hsi_ppb} ppb");
        assert_eq!(count(std::mem::offset_of!(DprTelemetry, frames_missed)), 0, "{hsi_ppb} ppb");
        let told = reader.views.iter().filter_map(|view| view.link);
        assert!(told.clone().count() >= 900, "{hsi_ppb} ppb");
        assert!(told.clone().all(|link| !link.status.horus_clock_implausible()), "{hsi_ppb} ppb");
        let shown: Vec<_> = reader.views.iter().filter_map(|view| view.reported).collect();
        assert!(shown.len() >= 800 && shown.iter().all(|status| status.without_crystal()), "{}", shown.len());
    }
}

#[test]
fn a_pll_that_never_locks_is_named_after_the_watchdogs_restart() {
    // HSE has a frequency that puts the PLL out of its range.
    let oscillators = Oscillators { hse_hz: Some(25_000_000), ..Oscillators::default() };
    let Some(mut horus) = boards::horus_on(oscillators) else { return };
    let mut restarts = 0;
    while horus.now() < 500 * MS {
        if horus.advance_to_restart(500 * MS) {
            restarts += 1;
            let started = horus.now();
            while horus.now() < started + 20 * MS {
                horus.advance(started + 20 * MS);
            }
            let stop = counter(&horus, "HORUS_TELEMETRY", std::mem::offset_of!(HorusTelemetry, last_stop));
            assert_eq!(stop >> 24, Cause::ClockStart as u32, "{stop:#x}");
        }
    }
    assert!((2..=5).contains(&restarts), "{restarts}");
}

fn verdict(hsi_ppb: i64) -> Option<(bool, bool)> {
    let oscillators = Oscillators { hse_hz: None, hsi_ppb, ..Oscillators::default() };
    let (a, b) = (boards::horus_on(oscillators)?, boards::dpr()?);
    let mut relay = Relay { a, b, upstream: Antenna::default(), downstream: Reader::new() };
    relay.run(3_500 * MS, 100 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
    let settled = relay.downstream.views.iter().filter(|view| view.at > 2_500 * MS);
    let told: Vec<_> = settled.filter_map(|view| Some((view.link?.status, !view.valid.is_empty()))).collect();
    assert!(told.len() >= 300, "{hsi_ppb} ppb: {}", told.len());
    let all = |of: fn(&(LinkStatusBits, bool)) -> bool| {
        let count = told.iter().filter(|it| of(it)).count();
        assert!(count == 0 || count == told.len(), "{hsi_ppb} ppb: {count} of {}", told.len());
        count > 0
    };
    assert_eq!(all(|(status, _)| status.out_of_sequence()), !all(|(_, shown)| *shown), "{hsi_ppb} ppb");
    Some((all(|(_, shown)| *shown), all(|(status, _)| status.horus_clock_implausible())))
}

/// The DPR accepts cycles of 10 ms ± 0.5 ms when it searches for the sequence. It reports a clock as implausible from
/// an error of 2 % on.
#[test]
fn the_dpr_judges_horus_without_a_crystal_by_its_error() {
    for (percent, expected) in [
        (1, (true, false)),
        (-1, (true, false)),
        (3, (true, true)),
        (-3, (true, true)),
        (5, (true, true)),
        (-5, (false, false)),
        (8, (false, false)),
        (-8, (false, false)),
    ] {
        let Some(verdict) = verdict(percent * 10_000_000) else { return };
        println!("{percent} %: shown {}, implausible {}", verdict.0, verdict.1);
        assert_eq!(verdict, expected, "{percent} %");
    }
}

struct Transmitter {
    node: Node<Horus>,
    air: Vec<(u64, AirEvent)>,
}

impl Transmitter {
    fn new() -> Option<Self> {
        Some(Self { node: boards::horus()?, air: vec![] })
    }

    fn run_to(&mut self, end: u64) -> bool {
        while self.node.now() < end {
            let restarted = self.node.advance_to_restart(end);
            self.air.extend(self.node.board_mut(|board| board.front_end.take_air()));
            if restarted {
                return true;
            }
        }
        false
    }

    fn field_off(&self, from: u64) -> Option<u64> {
        self.air.iter().find(|(at, event)| *at >= from && matches!(event, AirEvent::FieldOff)).map(|(at, _)| *at)
    }

    /// Returns the instant of each frame from `from` on, and whether it reports that HORUS runs without a crystal.
    fn frames(&self, from: u64) -> Vec<(u64, bool)> {
        let mut frames = vec![];
        let (mut started, mut bytes) = (0, vec![]);
        for (at, event) in &self.air {
            match event {
                AirEvent::FrameStart(start) => (started, bytes) = (*at, start.chunk.data.clone()),
                AirEvent::Bytes(chunk) => bytes.extend(&chunk.data),
                AirEvent::FrameEnd { .. } if started >= from => {
                    let position = Object::verify(0, &bytes[1..][..ReportedPosition::SIZE]).unwrap();
                    let position = ReportedPosition::verify(position.as_bytes()).unwrap();
                    frames.push((started, position.values().status.without_crystal()));
                }
                _ => {}
            }
        }
        frames
    }
}

/// The clock fails while a profile is sealed, while it is loaded, while it is on the air, and after that.
#[test]
fn a_clock_that_fails_switches_the_field_off_at_once() {
    let mut worst = 0;
    for phase in [20 * US, 90 * US, 250 * US, 2_000 * US, 7_000 * US] {
        let Some(mut horus) = Transmitter::new() else { return };
        horus.run_to(RAM_TEST + 60 * MS);
        let tick = *horus.node.board_mut(Horus::take_ticks).last().unwrap();
        assert!(!horus.run_to(tick + 10 * MS + phase));
        assert!(horus.frames(0).len() >= 4);
        assert!(horus.frames(0).iter().all(|(_, without)| !without));
        horus.node.input(|part, view, at| part.fail_hse(at, view));
        let failed = horus.node.now();
        assert!(horus.run_to(failed + BITE), "{phase}: no restart");
        let restarted = horus.node.now();
        let off = horus.field_off(failed).unwrap_or_else(|| panic!("{phase}: the field stayed on"));
        worst = worst.max(off - failed);
        assert!(off - failed <= FIELD_OFF, "{phase}: {} ns", off - failed);
        assert_eq!(horus.frames(failed), [], "{phase}: nothing is sent any more");
        let causes: Vec<Reset> = horus.node.resets().iter().map(|reset| reset.cause).collect();
        assert_eq!(causes, [Reset::Watchdog("IWDG")], "{phase}");
        let log: String = horus.node.take_log().iter().map(|line| format!("{line}\n")).collect();
        assert!(log.contains("the external clock has failed"), "{phase}: {log}");

        assert!(!horus.run_to(restarted + 300 * MS), "{phase}: restarted again");
        let again = horus.frames(restarted);
        println!(
            "{phase} ns: field off after {} ns, first frame {} us after the restart, which came {} ms after",
            off - failed,
            (again[0].0 - restarted) / US,
            (restarted - failed) / MS
        );
        assert!(again.len() >= 20, "{phase}: {} frames", again.len());
        assert!(again.iter().all(|(_, without)| *without), "{phase}");
        for pair in again.windows(2) {
            assert!((pair[1].0 - pair[0].0).abs_diff(10 * MS) <= 3_000, "{phase}: {pair:?}");
        }

        // HORUS uses the external clock only from its next start on.
        horus.node.input(|part, view, at| part.restore_hse(at, view));
        let restored = horus.node.now();
        assert!(!horus.run_to(restored + 50 * MS), "{phase}");
        assert!(horus.frames(restored).iter().all(|(_, without)| *without), "{phase}");
        horus.node.restart(emulator_node::FromOutside::Pin);
        let started = horus.node.now();
        horus.run_to(started + 80 * MS);
        let with = horus.frames(started);
        assert!(with.len() >= 4 && with.iter().all(|(_, without)| !without), "{phase}: {with:?}");
    }
    println!("field off at most {worst} ns after the clock's failure");
}
