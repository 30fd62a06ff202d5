//! The event log of a run, as it is written and judged.
//!
//! Boards and world tell of their events in pieces, the HORUS side ahead of the DPR's, so events wait here until
//! nothing can come before them any more. Then they are judged in order of time and, where somebody wants to keep the
//! log, handed on. The order depends on instants and on what happened alone, never on which thread came first.

use std::sync::Arc;

use bench_judge::{Event, Findings, Header, Judge, Log, Verdict, What};
use gnss_sim::Flight;

/// Events on their way into the log.
#[derive(Clone, Debug)]
pub(super) struct Recorder {
    header: Header,
    waiting: Vec<Event>,
    /// Everything before this instant is in the log.
    released: u64,
    judge: Judge,
    /// Where the aircraft is, unless a recording is played: the log gets that at each tick.
    flight: Option<Arc<Flight>>,
    /// What was released since it was last taken, where the log is kept.
    kept: Option<Vec<Event>>,
}

impl Recorder {
    /// An empty log. `keep` hands released events on through [`Recorder::take_kept`].
    pub(super) fn new(header: Header, flight: Option<Arc<Flight>>, keep: bool) -> Self {
        let judge = Judge::new(&header);
        Self { header, waiting: vec![], released: 0, judge, flight, kept: keep.then(Vec::new) }
    }

    /// What the run is known by.
    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    /// Something happened at `at` (ns).
    ///
    /// # Panics
    ///
    /// If the log already holds later events: the bench would have judged a run that was not the one that ran.
    pub(super) fn note(&mut self, at: u64, what: What) {
        assert!(at >= self.released, "{what:?} at {at} ns is told when the log has come to {} ns", self.released);
        self.waiting.push(Event { at, what });
    }

    /// Several things happened.
    pub(super) fn extend(&mut self, events: impl IntoIterator<Item = Event>) {
        for Event { at, what } in events {
            self.note(at, what);
        }
    }

    /// Nothing that is still to be told happened before `before` (ns): what did is judged.
    pub(super) fn release(&mut self, before: u64) {
        if before <= self.released {
            return;
        }
        self.released = before;
        // Stable: of one instant and one rank, what was told first comes first.
        self.waiting.sort_by_key(|event| (event.at, event.what.rank()));
        let later = self.waiting.split_off(self.waiting.partition_point(|event| event.at < before));
        for event in std::mem::replace(&mut self.waiting, later) {
            let aircraft =
                self.flight.as_ref().filter(|_| event.what == What::Tick).map(|flight| aircraft(flight, event.at));
            for event in std::iter::once(event).chain(aircraft) {
                self.judge.take(&event);
                if let Some(kept) = &mut self.kept {
                    kept.push(event);
                }
            }
        }
    }

    /// Keeps what is released from now on.
    pub(super) fn keep(&mut self) {
        self.kept.get_or_insert_default();
    }

    /// What was released since the last call, where the log is kept.
    pub(super) fn take_kept(&mut self) -> Vec<Event> {
        self.kept.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// What was broken so far.
    pub(super) fn findings(&self) -> &Findings {
        self.judge.findings()
    }

    /// The run is over at `end` (ns): what came of it, and what was kept of the log since it was last taken. What
    /// happened after `end`, since a board stops at its first instruction boundary after it, is not part of the run.
    pub(super) fn finish(mut self, end: u64) -> (Verdict, Log) {
        self.waiting.retain(|event| event.at <= end);
        self.note(end.max(self.released), What::End);
        self.release(u64::MAX);
        let log = Log { header: self.header, events: self.kept.unwrap_or_default() };
        (self.judge.finish(), log)
    }
}

/// Where the aircraft is at a tick at `at`, ns.
fn aircraft(flight: &Flight, at: u64) -> Event {
    let place = flight.state(at as f64 / 1e9).position;
    let billionths = |degrees: f64| (degrees * 1e9).round() as i64;
    let (latitude, longitude) = (billionths(place.latitude), billionths(place.longitude));
    Event { at, what: What::Aircraft { latitude, longitude, height: (place.height * 1e3).round() as i64 } }
}
