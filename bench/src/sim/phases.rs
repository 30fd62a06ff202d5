//! Places the flight controller's transactions around a frame's end, in every phase relative to that end.
//!
//! # Design
//!
//! A flight controller's control cycle is not synchronous to HORUS's cycle. In a simple run some coincidences of a
//! transaction with the DPR's work last 100 ns and occur once in minutes. A [`Sweep`] makes each of them occur.
//!
//! In every cycle of HORUS a [`Sweep`] places transactions around the end of a frame, at a phase that advances by a
//! fixed step. The phase counts from the frame's last bit at the antenna, so errors of crystals and the scatter of the
//! front end do not change it.
//!
//! The bench must know a frame's end when the frame begins. It therefore measures the duration of the first frame of
//! each length.
//!
//! A [`Phase`] holds what happened at one phase of the sweep. The judge judges a run with a sweep like any other run.

use std::collections::BTreeMap;

use nrf52840::SpisEvent;
use profile::{Layout, air};

/// The edge of chip select by which a transaction is placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The falling edge of chip select, at which the transaction begins.
    Falls,
    /// The rising edge of chip select, at which the transaction ends.
    Rises,
}

/// A transaction whose instant is relative to a phase of the sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// The edge of chip select that is placed.
    pub edge: Edge,
    /// The time from the phase's instant to the placed edge, ns; negative if the edge comes first.
    pub after_ns: i64,
    /// The number of bytes in the transaction; `None` for the whole image.
    pub bytes: Option<usize>,
}

/// The phases of a sweep and the transactions at each phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sweep {
    /// The index of the frame in its cycle, from 0, around whose end the transactions are placed.
    pub frame: usize,
    /// The first phase, as a time after the frame's last bit, ns.
    pub from_ns: i64,
    /// The upper limit of the phases, as a time after the frame's last bit, ns.
    pub to_ns: i64,
    /// The step from one phase to the next, ns.
    pub step_ns: u64,
    /// Patterns of transactions, each for one cycle and in order of time. Every phase of the sweep uses each pattern
    /// once.
    pub patterns: Vec<Vec<Placement>>,
}

impl Sweep {
    /// The number of HORUS's cycles that the whole sweep takes.
    #[must_use]
    pub fn cycles(&self) -> u64 {
        let width = u64::try_from(self.to_ns - self.from_ns).unwrap_or(0);
        (width / self.step_ns + 1) * self.patterns.len() as u64
    }

    /// The phase, and the index of the pattern, in cycle number `cycle` of the sweep; `None` if the sweep is over.
    fn at(&self, cycle: u64) -> Option<(i64, usize)> {
        let patterns = self.patterns.len() as u64;
        let step = i64::try_from(cycle / patterns * self.step_ns).ok()?;
        let pattern = usize::try_from(cycle % patterns).ok()?;
        (cycle < self.cycles()).then_some((self.from_ns + step, pattern))
    }
}

/// The events at one phase of a sweep.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Phase {
    /// The phase, as a time after the frame's last bit, ns.
    pub phase_ns: i64,
    /// The index, in the sweep, of the pattern of transactions that was placed at this phase.
    pub pattern: usize,
    /// The instant of the frame's last bit, ns.
    pub frame_ended: u64,
    /// The events up to the next phase, each with its time after the frame's last bit, ns. They are sorted by their
    /// kinds.
    pub events: Vec<(i64, PhaseEvent)>,
}

/// An event on the wires, or of the SPIS, at one phase of the sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhaseEvent {
    /// The flight controller's chip select falls.
    Selected,
    /// The flight controller's chip select rises.
    Deselected,
    /// FRESH rises.
    FreshRises,
    /// FRESH falls.
    FreshFalls,
    /// An event of the SPIS's semaphore.
    Spis(SpisEvent),
}

impl Phase {
    /// The time from the frame's last bit until FRESH first rose, ns; `None` if FRESH did not rise.
    #[must_use]
    pub fn fresh_ns(&self) -> Option<i64> {
        self.events.iter().find(|(_, event)| *event == PhaseEvent::FreshRises).map(|(at, _)| *at)
    }

    /// The longest time, ns, from the end of a transaction (rise of chip select) until the firmware released the SSI's
    /// semaphore.
    #[must_use]
    pub fn ready_ns(&self) -> i64 {
        self.longest(PhaseEvent::Deselected, PhaseEvent::Spis(SpisEvent::Ready))
    }

    /// The longest time for which the processor held the SSI's semaphore, ns.
    #[must_use]
    pub fn hold_ns(&self) -> i64 {
        self.longest(PhaseEvent::Spis(SpisEvent::Held), PhaseEvent::Spis(SpisEvent::Released))
    }

    fn longest(&self, begin: PhaseEvent, end: PhaseEvent) -> i64 {
        let (mut since, mut longest) = (None, 0);
        for &(at, event) in &self.events {
            if event == begin {
                since = Some(at);
            } else if event == end
                && let Some(since) = since.take()
            {
                longest = longest.max(at - since);
            }
        }
        longest
    }
}

#[derive(Clone, Debug)]
pub(super) struct Sweeping {
    sweep: Sweep,
    cycle: u64,
    /// The LEN byte of the frames around whose ends the transactions are placed.
    target: u8,
    durations: BTreeMap<u8, u64>,
    phases: Vec<Phase>,
}

impl Sweeping {
    /// Returns the beginning of `sweep` on a link with `receivers` receivers.
    ///
    /// # Panics
    ///
    /// Panics if a cycle of this link has no frame with the index [`Sweep::frame`].
    pub(super) fn new(sweep: Sweep, receivers: usize) -> Self {
        let frame = Layout::for_receivers(receivers).and_then(|layout| layout.frame(sweep.frame));
        let payload = frame.expect("a frame of the link's cycles").length();
        let target = u8::try_from(payload + air::LEN_BYTES).expect("LEN is one byte and counts itself");
        Self { sweep, cycle: 0, target, durations: BTreeMap::new(), phases: vec![] }
    }

    pub(super) fn frame_took(&mut self, len: u8, took: u64) {
        self.durations.insert(len, took);
    }

    /// Returns the transactions around the end of a frame that began at `at`. Each has its placed edge, the instant of
    /// that edge (ns), and the number of bytes.
    pub(super) fn frame_started(&mut self, at: u64, len: u8) -> Vec<(Edge, u64, Option<usize>)> {
        let Some(&took) = self.durations.get(&len).filter(|_| len == self.target) else { return vec![] };
        let Some((phase_ns, pattern)) = self.sweep.at(self.cycle) else { return vec![] };
        self.cycle += 1;
        let frame_ended = at + took;
        self.phases.push(Phase { phase_ns, pattern, frame_ended, ..Phase::default() });
        let placed = self.sweep.patterns[pattern].iter().map(|placement| {
            let instant = frame_ended.saturating_add_signed(phase_ns + placement.after_ns);
            (placement.edge, instant, placement.bytes)
        });
        placed.collect()
    }

    pub(super) fn phase(&mut self) -> Option<&mut Phase> {
        self.phases.last_mut()
    }

    pub(super) fn into_phases(self) -> Vec<Phase> {
        self.phases
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_phase_tells_its_worst_times() {
        let mut phase = Phase::default();
        assert_eq!((phase.fresh_ns(), phase.ready_ns(), phase.hold_ns()), (None, 0, 0));
        let (held, released, ready) = (
            PhaseEvent::Spis(SpisEvent::Held),
            PhaseEvent::Spis(SpisEvent::Released),
            PhaseEvent::Spis(SpisEvent::Ready),
        );
        phase.events = vec![
            (-90, PhaseEvent::Selected),
            (-50, PhaseEvent::Deselected),
            (-48, held),
            (-10, released),
            (-5, ready),
            (7, PhaseEvent::FreshRises),
            (10, PhaseEvent::Deselected),
            (10, held),
            (12, released),
            (12, ready),
            (99, PhaseEvent::FreshRises),
        ];
        assert_eq!((phase.fresh_ns(), phase.ready_ns(), phase.hold_ns()), (Some(7), 45, 38));
    }

    #[test]
    fn a_sweep_takes_every_phase_with_every_pattern_and_then_no_more() {
        let whole = Placement { edge: Edge::Rises, after_ns: 0, bytes: None };
        let short = Placement { edge: Edge::Falls, after_ns: 12_000, bytes: Some(96) };
        let sweep =
            Sweep { frame: 0, from_ns: -200, to_ns: 0, step_ns: 100, patterns: vec![vec![whole, short], vec![short]] };
        assert_eq!(sweep.cycles(), 6);
        let mut sweeping = Sweeping::new(sweep, 1);
        assert_eq!(sweeping.frame_started(0, 125), [], "how long such a frame takes is not known yet");
        sweeping.frame_took(125, 2_500_000);
        assert_eq!(sweeping.frame_started(10_000_000, 185), [], "another frame");
        for cycle in 0..8 {
            let start = 20_000_000 + cycle * 10_000_000;
            let end = start + 2_500_000;
            let placed = sweeping.frame_started(start, 125);
            let phase = end - 200 + cycle / 2 * 100;
            match cycle {
                0 | 2 | 4 => {
                    assert_eq!(placed, [(Edge::Rises, phase, None), (Edge::Falls, phase + 12_000, Some(96))]);
                }
                1 | 3 | 5 => assert_eq!(placed, [(Edge::Falls, phase + 12_000, Some(96))]),
                _ => assert_eq!(placed, []),
            }
        }
        let phases: Vec<_> = sweeping.into_phases().iter().map(|phase| (phase.phase_ns, phase.pattern)).collect();
        assert_eq!(phases, [(-200, 0), (-200, 1), (-100, 0), (-100, 1), (0, 0), (0, 1)]);
    }
}
