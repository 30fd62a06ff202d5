//! Port-Status and the uplinks that are read back, against what the flight controller has written.
//!
//! What a DPR that does right has made of every transaction is worked out from the log alone ([`model`]). A transaction
//! shows in the second image after its end at the latest, and in none before it; so Port-Status has to be what follows
//! from one of those transactions. Where something is not certain (how long a self-test takes), several states are
//! possible, and what is read afterwards decides.
//!
//! # What is not asked
//!
//! - While the flight controller misuses the SSI, and [`bounds::MISUSE_OVER`] after that: how much of it the DPR took
//!   in depends on its budget and on clocks that bits are sampled with. After that Port-Status is believed once, in a
//!   gap between two objects that are written, and held against what follows.
//! - While a bit of the DPR's buffers is or was hit: what is not intact then is not valid, which is all that is asked.
//! - Of a map that FRESH has not announced in time: that is another violation.

mod model;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::ops::Range;

use profile::criticality::{BaseStation, FlightController};
use profile::{Layout, PortValues, Uplink};

use super::shown::expectation::hits_a_buffer;
use super::shown::publication;
use crate::read::{Reading, is_vacant};
use crate::{Board, Context, Event, Figures, Findings, Header, Violation, What, bounds};
use model::{Model, Place, status_in, writes};

/// Rises of FRESH that are remembered: a transaction may be long.
const REMEMBERED: usize = 64;

/// Objects that were written and may not show yet: more than there can be between two images.
const WRITTEN: usize = 128;

/// An uplink's age is as of the instant at which Port-Status was made, up to so long before its publication, ns.
const MADE_BEFORE: u64 = 4 * bounds::CYCLE;

/// From a transaction's end to the DPR's having judged it, and the crystals, ns.
const JUDGED_AFTER: u64 = 2_000_000;

/// A millisecond, ns.
const MS: u64 = 1_000_000;

/// What may be the case after a transaction.
#[derive(Clone, Debug)]
struct Entry {
    /// When it ended, ns.
    at: u64,
    mosi: Vec<u8>,
    models: Vec<Model>,
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub struct Port {
    layout: Layout,
    publication: u64,
    /// The oldest first; never empty while the DPR's state is known, and empty otherwise.
    entries: VecDeque<Entry>,
    fresh: VecDeque<u64>,
    /// Until when the flight controller misuses the SSI, ns.
    misused: u64,
    /// Until when an image may hold a bit that was hit, ns.
    hit: u64,
    /// Memory was damaged on purpose: a self-test may fail.
    damaged: bool,
    /// When the last object was written that was not idle, ns.
    written: u64,
}

impl Port {
    /// Nothing has happened yet.
    ///
    /// # Panics
    ///
    /// If there is no profile for the header's number of receivers.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        let mut port = Self {
            layout: Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers"),
            publication: publication(header.worst_case()),
            entries: VecDeque::new(),
            fresh: VecDeque::new(),
            misused: 0,
            hit: 0,
            damaged: false,
            written: 0,
        };
        port.start(0);
        port
    }

    /// The DPR starts: it has taken nothing in.
    fn start(&mut self, at: u64) {
        self.entries.clear();
        self.fresh.clear();
        if at >= self.misused {
            self.entries.push_back(Entry { at, mosi: vec![], models: vec![Model::at_start()] });
        }
    }

    /// Takes the next event.
    pub fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        match &event.what {
            What::Power { board: Board::Dpr, .. } | What::Reset { board: Board::Dpr, .. } => self.start(event.at),
            What::Injected { kind, until } => {
                if kind.starts_with("flight controller") {
                    self.misused = self.misused.max(until.saturating_add(bounds::MISUSE_OVER));
                    self.entries.clear();
                } else if hits_a_buffer(kind) {
                    self.hit = self.hit.max(until.saturating_add(bounds::BUFFER_REPLACED));
                }
                self.damaged |= ["buffer", "ram", "flash", "image"].iter().any(|memory| kind.starts_with(memory));
            }
            What::Fresh { high: true, .. } => {
                self.fresh.push_back(event.at);
                if self.fresh.len() > REMEMBERED {
                    self.fresh.pop_front();
                }
            }
            What::Transaction { mosi, .. } => {
                if let Some(reading) = context.reading() {
                    self.transaction(reading, mosi, context, findings);
                }
            }
            _ => {}
        }
    }

    fn transaction(&mut self, reading: &Reading, mosi: &[u8], context: &Context, findings: &mut Findings) {
        let dpr = context.running(Board::Dpr);
        if reading.silent || !dpr.powered || reading.selected < dpr.since {
            return;
        }
        self.read(reading, findings);
        if writes(mosi) {
            self.written = reading.deselected;
            self.write(mosi, reading.deselected);
        }
    }

    /// What the DPR has taken in.
    fn write(&mut self, mosi: &[u8], at: u64) {
        let Some(last) = self.entries.back() else { return };
        let models = step(&last.models, mosi, at, self.layout.map_len());
        self.entries.push_back(Entry { at, mosi: mosi.to_vec(), models });
        if self.entries.len() > WRITTEN {
            self.entries.pop_front();
        }
    }

    fn read(&mut self, reading: &Reading, findings: &mut Findings) {
        let within = |place: Range<usize>| {
            let start = place.start.checked_sub(reading.offset)?;
            reading.miso.get(start..start + place.len())
        };
        let Some(status) = status_in(within(self.layout.port_status())) else { return };
        let selected = reading.selected;
        let before = self.fresh.partition_point(|rose| *rose <= selected);
        let rise = |back: usize| before.checked_sub(back).and_then(|place| self.fresh.get(place)).copied();
        let (Some(published), previous) = (rise(1), rise(2)) else { return };
        if selected > published + bounds::FRAME_DEADLINE + self.publication || selected < self.misused {
            return;
        }
        let values = match status {
            Ok(values) => values,
            Err(_) if selected < self.hit => return,
            Err(rejection) => {
                let vacant = within(self.layout.port_status()).is_some_and(is_vacant);
                let violation = if vacant { Violation::PortStatusWrong } else { Violation::Damaged };
                findings.add(violation, selected, || format!("Port-Status: {rejection}"));
                return;
            }
        };
        if values.status.self_test_failed() && !self.damaged {
            findings.add(Violation::PortStatusWrong, selected, || "a self-test failed, and nothing is damaged".into());
        }
        if self.entries.is_empty() {
            // In a gap: what was written last shows by now.
            if previous.is_some_and(|previous| self.written < previous) {
                self.entries.push_back(Entry { at: self.written, mosi: vec![], models: vec![Model::of(&values)] });
            }
            return;
        }
        // What was written before the rise of FRESH before the last shows; what was written before the last may.
        let last = self.entries.partition_point(|entry| entry.at <= published).saturating_sub(1);
        let first = previous.map_or(0, |previous| self.entries.partition_point(|entry| entry.at < previous));
        let first = first.saturating_sub(1).min(last);
        let fitting = (first..=last).find(|&place| self.entries[place].models.iter().any(|model| model.fits(&values)));
        let Some(place) = fitting else {
            findings.add(Violation::PortStatusWrong, selected, || {
                let expected = self.entries[last].models.first();
                format!("{values:?} instead of {expected:?}")
            });
            // It is told once, and from here on what the DPR says is what there is.
            self.entries.clear();
            return;
        };
        let uplinks = [self.layout.uplink::<BaseStation>(), self.layout.uplink::<FlightController>()].map(within);
        self.uplinks(place..=last, &values, uplinks, (published, selected), findings);
        if first == last {
            self.decided(last, &values);
        }
    }

    /// What was written up to entry number `place` shows, and Port-Status says this: nothing else is possible.
    fn decided(&mut self, place: usize, values: &PortValues) {
        self.entries[place].models.retain(|model| model.fits(values));
        self.entries.drain(..place);
        for next in 1..self.entries.len() {
            let entry = &self.entries[next];
            let models = step(&self.entries[next - 1].models, &entry.mosi, entry.at, self.layout.map_len());
            self.entries[next].models = models;
        }
    }

    /// Holds both uplinks' places, their bits and their ages against what was written.
    fn uplinks(
        &self,
        places: std::ops::RangeInclusive<usize>,
        values: &PortValues,
        read: [Option<&[u8]>; 2],
        (published, selected): (u64, u64),
        findings: &mut Findings,
    ) {
        let told = [
            (values.status.base_station_fresh(), values.base_station_age_ms),
            (values.status.flight_controller_fresh(), values.flight_controller_age_ms),
        ];
        for (writer, (told, read)) in told.into_iter().zip(read).enumerate() {
            let mut models = places.clone().flat_map(|place| &self.entries[place].models);
            let fits = models
                .by_ref()
                .filter(|model| model.fits(values))
                .any(|model| shows(&model.places[writer], told, read, published));
            let hit = selected < self.hit;
            if !fits && !hit {
                findings.add(Violation::UplinkWrong, selected, || {
                    let name = ["the base station's", "the flight controller's"][writer];
                    format!("{name}, fresh {}, {} ms old", told.0, told.1)
                });
            }
        }
    }

    /// The run is over.
    pub fn finish(&mut self, _context: &Context, _findings: &mut Findings, _figures: &mut Figures) {}
}

fn step(models: &[Model], mosi: &[u8], at: u64, map_len: usize) -> Vec<Model> {
    let mut next: Vec<Model> = vec![];
    for model in models.iter().flat_map(|model| model.after(mosi, at, map_len)) {
        if !next.contains(&model) {
            next.push(model);
        }
    }
    next
}

/// Whether a writer's bit, age (ms) and, if it was read, place may be so in an image of `published`, ns.
fn shows(place: &Place, (fresh, age_ms): (bool, u16), read: Option<&[u8]>, published: u64) -> bool {
    let (stored, at) = match place {
        Place::Unknown => return true,
        Place::Empty => return !fresh && age_ms == u16::MAX && read.is_none_or(is_vacant),
        Place::Stored(stored, at) => (stored, *at),
    };
    let most = published.saturating_sub(at).div_ceil(MS) + 1;
    let least = published.saturating_sub(at + MADE_BEFORE + JUDGED_AFTER) / MS;
    let expiry = u64::from(Uplink::EXPIRY_MS);
    let told = u64::from(age_ms);
    let age_fits = (least..=most).contains(&told) || age_ms == u16::MAX && most >= u64::from(u16::MAX);
    let bytes_fit = read.is_none_or(|read| if fresh { read == &stored[..] } else { is_vacant(read) });
    // The bit follows from the age, so that it is not set or clear at another time than the age allows.
    age_fits && bytes_fit && fresh == (told < expiry)
}
