//! Writes and judges the event log of a run.
//!
//! Boards and world deliver their events in pieces, and HORUS runs ahead of the DPR. Each event is therefore held back
//! here until no earlier one can come, and is then judged and stored. The order of the log depends on the events alone,
//! never on which thread delivered them first.

use std::sync::Arc;

use bench_judge::{Event, Findings, Header, Judge, Log, Verdict, What};
use gnss_sim::Flight;

#[derive(Clone, Debug)]
pub(super) struct Recorder {
    header: Header,
    waiting: Vec<Event>,
    /// All events before this instant, ns, are in the log.
    released: u64,
    judge: Judge,
    /// The aircraft's true flight, whose positions go into the log; `None` if a recording is played.
    flight: Option<Arc<Flight>>,
    /// The events released since the last call of [`Recorder::take_kept`]; `None` if the caller does not want the log.
    kept: Option<Vec<Event>>,
}

impl Recorder {
    /// Returns an empty log. With `keep`, it keeps released events for [`Recorder::take_kept`].
    pub(super) fn new(header: Header, flight: Option<Arc<Flight>>, keep: bool) -> Self {
        let judge = Judge::new(&header);
        Self { header, waiting: vec![], released: 0, judge, flight, kept: keep.then(Vec::new) }
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    /// Records an event at `at` (ns).
    ///
    /// # Panics
    ///
    /// Panics if later events have already been judged, because the judge needs the events in order.
    pub(super) fn note(&mut self, at: u64, what: What) {
        assert!(at >= self.released, "{what:?} at {at} ns is told when the log has come to {} ns", self.released);
        self.waiting.push(Event { at, what });
    }

    pub(super) fn extend(&mut self, events: impl IntoIterator<Item = Event>) {
        for Event { at, what } in events {
            self.note(at, what);
        }
    }

    /// Judges the events before `before` (ns). No earlier event may come later.
    pub(super) fn release(&mut self, before: u64) {
        if before <= self.released {
            return;
        }
        self.released = before;
        // The sort is stable: events of the same instant and rank keep the order in which they came.
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

    pub(super) fn keep(&mut self) {
        self.kept.get_or_insert_default();
    }

    pub(super) fn take_kept(&mut self) -> Vec<Event> {
        self.kept.as_mut().map(std::mem::take).unwrap_or_default()
    }

    pub(super) fn findings(&self) -> &Findings {
        self.judge.findings()
    }

    /// Ends the run at `end` (ns), and returns the verdict and the rest of the log. Later events are dropped.
    pub(super) fn finish(mut self, end: u64) -> (Verdict, Log) {
        self.waiting.retain(|event| event.at <= end);
        self.note(end.max(self.released), What::End);
        self.release(u64::MAX);
        let log = Log { header: self.header, events: self.kept.unwrap_or_default() };
        (self.judge.finish(), log)
    }
}

fn aircraft(flight: &Flight, at: u64) -> Event {
    let place = flight.state(at as f64 / 1e9).position;
    let billionths = |degrees: f64| (degrees * 1e9).round() as i64;
    let (latitude, longitude) = (billionths(place.latitude), billionths(place.longitude));
    Event { at, what: What::Aircraft { latitude, longitude, height: (place.height * 1e3).round() as i64 } }
}
