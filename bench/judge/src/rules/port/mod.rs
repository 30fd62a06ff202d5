//! Compares Port-Status, and the uplinks that are read back, with what the flight controller has written.
//!
//! After each transaction the judge determines which states a correct DPR can have (`model`). The first image published
//! after a transaction may show the transaction's effect, and the second must.
//!
//! # What is not required
//!
//! - While [`Excuse::Service`] holds, this rule requires nothing, because it is unknown which of the written bytes the
//!   DPR received. Afterwards the judge takes a plausible Port-Status as the reference for all later ones.
//! - While [`Excuse::UnsoundImage`] holds, a damaged Port-Status or uplink is only required to be invalid.
//! - Port-Status is not judged in a map that FRESH has not announced in time, because another rule reports that map.

mod health;
mod model;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::ops::Range;

use profile::criticality::{BaseStation, FlightController};
use profile::{Layout, PortValues, Uplink};

use super::Rule;
use super::shown::publication;
use crate::disturbance::Excuse;
use crate::read::{Reading, is_vacant};
use crate::{Board, Context, Disturbances, Event, Findings, Header, Violation, What, bounds};
use health::HealthFields;
use model::{Model, Place, status_in, writes};

/// The number of rises of FRESH that are kept for a transaction that has not ended.
const REMEMBERED: usize = 64;

/// The number of written objects that are kept: more than can be written between two images.
const WRITTEN: usize = 128;

/// The longest time, ns, from the making of a Port-Status to its publication.
const MADE_BEFORE: u64 = 4 * bounds::CYCLE;

/// The longest time, ns, from the end of a transaction until the DPR has judged the object in it.
const JUDGED_AFTER: u64 = 2_000_000;

const MS: u64 = 1_000_000;

/// The possible states of a correct DPR after a transaction.
#[derive(Clone, Debug)]
struct Entry {
    at: u64,
    mosi: Vec<u8>,
    models: Vec<Model>,
}

/// The rule that judges Port-Status and the uplinks; see the [module](self).
#[derive(Clone, Debug)]
pub struct PortRule {
    layout: Layout,
    publication: u64,
    /// The possible states after each transaction, the oldest first. The list is empty exactly while the state is not
    /// known.
    entries: VecDeque<Entry>,
    fresh: VecDeque<u64>,
    /// The end, ns, of the last transaction that may have changed a counter of Port-Status.
    written: u64,
    /// The values of Port-Status when it was last read, and the number of transactions since that reading.
    known: (PortValues, u32),
    /// The values with which later ones are compared: the access violations in Link-Status and in Port-Status, and the
    /// timestamp of the last command. `None` if not known.
    counted: Option<(u32, u32, u32)>,
    health: HealthFields,
    /// Whether Port-Status has reported that the last self-test failed.
    failed: bool,
}

impl Rule for PortRule {
    fn new(header: &Header) -> Self {
        let mut port = Self {
            layout: header.layout(),
            publication: publication(header.worst_case()),
            entries: VecDeque::new(),
            fresh: VecDeque::new(),
            written: 0,
            known: (PortValues::default(), 0),
            counted: None,
            health: HealthFields::powered(0),
            failed: false,
        };
        port.start(0, true);
        port
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        match &event.what {
            What::Power { board: Board::Dpr, .. } | What::Reset { board: Board::Dpr, .. } => {
                self.health = HealthFields::again(event.at);
                self.start(event.at, !context.disturbances().excuse(Excuse::Service, event.at));
            }
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Service) => {
                self.entries.clear();
                self.health.slowed();
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
}

impl PortRule {
    /// Resets the state at a start of the DPR. `known` says whether the judge can tell what the DPR receives from now
    /// on.
    fn start(&mut self, at: u64, known: bool) {
        self.entries.clear();
        self.fresh.clear();
        self.known = (PortValues::default(), 0);
        self.counted = Some((0, 0, 0));
        self.failed = false;
        if known {
            self.entries.push_back(Entry { at, mosi: vec![], models: vec![Model::at_start()] });
        }
    }

    fn transaction(&mut self, reading: &Reading, mosi: &[u8], context: &Context, findings: &mut Findings) {
        self.known.1 = self.known.1.saturating_add(1);
        if context.disturbances().excuse(Excuse::Service, reading.selected) {
            self.written = reading.deselected;
        }
        let dpr = context.running(Board::Dpr);
        if reading.silent || !dpr.powered || reading.selected < dpr.since {
            return;
        }
        self.read(reading, context.disturbances(), findings);
        if writes(mosi) {
            self.written = reading.deselected;
            self.write(mosi, reading.deselected);
        }
    }

    fn write(&mut self, mosi: &[u8], at: u64) {
        let Some(last) = self.entries.back() else { return };
        let models = step(&last.models, mosi, at, self.layout.map_len());
        self.entries.push_back(Entry { at, mosi: mosi.to_vec(), models });
        if self.entries.len() > WRITTEN {
            self.entries.pop_front();
        }
    }

    fn read(&mut self, reading: &Reading, disturbances: &Disturbances, findings: &mut Findings) {
        let within = |place: Range<usize>| {
            let start = place.start.checked_sub(reading.offset)?;
            reading.miso.get(start..start + place.len())
        };
        let Some(status) = status_in(within(self.layout.port_status())) else { return };
        let selected = reading.selected;
        let before = self.fresh.partition_point(|rose| *rose <= selected);
        let rise = |back: usize| before.checked_sub(back).and_then(|place| self.fresh.get(place)).copied();
        let (Some(published), previous) = (rise(1), rise(2)) else { return };
        let announced = selected <= published + bounds::FRAME_DEADLINE + self.publication;
        if !announced || disturbances.excuse(Excuse::Service, selected) {
            return;
        }
        let values = match status {
            Ok(values) => values,
            Err(_) if disturbances.excuse(Excuse::UnsoundImage, selected) => return,
            Err(rejection) => {
                let vacant = within(self.layout.port_status()).is_some_and(is_vacant);
                let violation = if vacant { Violation::PortStatusWrong } else { Violation::Damaged };
                findings.add(violation, selected, || format!("Port-Status: {rejection}"));
                return;
            }
        };
        if let Some(words) = self.health.wrong(&values, reading, published, disturbances) {
            findings.add(Violation::PortStatusWrong, selected, || words);
        }
        let failed = values.status.self_test_failed();
        let newly = !std::mem::replace(&mut self.failed, failed);
        if failed && newly && !disturbances.excuse(Excuse::SelfTest, published) {
            findings.add(Violation::PortStatusWrong, selected, || "a self-test failed, and nothing is damaged".into());
        }
        if self.entries.is_empty() {
            // If no written object is pending, Port-Status must show the effect of all written objects. An image that
            // only replaces an unsound one need not show it.
            let shows = previous.is_some_and(|previous| self.written < previous);
            if shows && !disturbances.excuse(Excuse::UnsoundImage, selected) {
                let (before, transactions) = self.known;
                if !may_follow(&before, &values, transactions) {
                    findings.add(Violation::PortStatusWrong, selected, || {
                        format!("{values:?} after {before:?} and {transactions} transactions")
                    });
                }
                self.known = (values, 0);
                let models = vec![Model::of(&values, published)];
                self.entries.push_back(Entry { at: self.written, mosi: vec![], models });
            }
            return;
        }
        // The last two rises of FRESH bound what Port-Status may show: at least the objects written before the earlier
        // rise, at most those written before the later one.
        let last = self.entries.partition_point(|entry| entry.at <= published).saturating_sub(1);
        let first = previous.map_or(0, |previous| self.entries.partition_point(|entry| entry.at < previous));
        let first = first.saturating_sub(1).min(last);
        let fits = |place: &usize| self.entries[*place].models.iter().any(|model| model.fits(&values, published));
        let fitting = (first..=last).find(fits);
        let Some(place) = fitting else {
            findings.add(Violation::PortStatusWrong, selected, || {
                let expected = self.entries[last].models.first();
                format!("{values:?} instead of {expected:?}")
            });
            // The judge continues from this wrong Port-Status, so that it reports each error once.
            self.entries.clear();
            self.counted = None;
            self.known = (values, 0);
            return;
        };
        self.known = (values, 0);
        let uplinks = [self.layout.uplink::<BaseStation>(), self.layout.uplink::<FlightController>()].map(within);
        self.uplinks(place..=last, &values, uplinks, (published, selected), disturbances, findings);
        if first == last {
            self.decided(last, &values, published);
            if let Some(Ok(link)) = &reading.link {
                self.counted(link.access_violations, &values, selected, findings);
            }
        }
    }

    /// Judges the number of access violations in Link-Status. This number and the counts in Port-Status must grow
    /// equally, unless a command clears the counts.
    fn counted(&mut self, link: u16, values: &PortValues, selected: u64, findings: &mut Findings) {
        let now = (u32::from(link), values.violations.total(), values.last_command_timestamp);
        let Some(before) = &mut self.counted else { return };
        let (link_before, total_before, command_before) = std::mem::replace(before, now);
        let (link, total, command) = now;
        let grew_alike = link == u32::from(u16::MAX) || link + total_before == total + link_before;
        if link < total.min(u32::from(u16::MAX)) || command == command_before && !grew_alike {
            findings.add(Violation::LinkCounters, selected, || {
                format!("{link} access violations after {link_before}, and Port-Status {total} after {total_before}")
            });
        }
    }

    /// Records that Port-Status includes the objects written up to entry `place`, because it fits no other state.
    fn decided(&mut self, place: usize, values: &PortValues, published: u64) {
        self.entries[place].models.retain(|model| model.fits(values, published));
        self.entries[place].models.iter_mut().for_each(|model| model.told(values));
        self.entries.drain(..place);
        for next in 1..self.entries.len() {
            let entry = &self.entries[next];
            let models = step(&self.entries[next - 1].models, &entry.mosi, entry.at, self.layout.map_len());
            self.entries[next].models = models;
        }
    }

    /// Compares the bytes, status bits and ages of both uplinks in the image with what was written.
    fn uplinks(
        &self,
        places: std::ops::RangeInclusive<usize>,
        values: &PortValues,
        read: [Option<&[u8]>; 2],
        (published, selected): (u64, u64),
        disturbances: &Disturbances,
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
                .filter(|model| model.fits(values, published))
                .any(|model| shows(&model.places[writer], told, read, published));
            let hit = disturbances.excuse(Excuse::UnsoundImage, selected);
            if !fits && !hit {
                // A damaged uplink is no violation by itself, because its reader detects the damage by the CRC.
                let damaged = read.is_some_and(|read| !is_vacant(read) && !is_intact(writer, read));
                let fits_but_for_bytes = || {
                    let mut models = places.clone().flat_map(|place| &self.entries[place].models);
                    models.any(|model| shows(&model.places[writer], told, None, published))
                };
                let violation =
                    if damaged && fits_but_for_bytes() { Violation::Damaged } else { Violation::UplinkWrong };
                findings.add(violation, selected, || {
                    let name = ["the base station's", "the flight controller's"][writer];
                    format!("{name}, fresh {}, {} ms old", told.0, told.1)
                });
            }
        }
    }
}

/// Returns whether this number of unknown transactions can change Port-Status from `before` to `now`. A transaction
/// adds at most two to the counter of transactions beyond the budget, and at most one to each other counter. The first
/// Port-Status may lack the effects of up to two times [`bounds::SSI_BUDGET`] earlier transactions.
fn may_follow(before: &PortValues, now: &PortValues, transactions: u32) -> bool {
    let most = transactions.saturating_add(2 * bounds::SSI_BUDGET);
    let last_command = |values: &PortValues| (values.last_command_timestamp, values.last_command);
    // If the last command differs although no further one was counted, that command has cleared the counters.
    let carried_out = now.commands_carried_out > 0
        && (now.commands_carried_out != before.commands_carried_out || last_command(now) != last_command(before));
    // The counters may fall if a command was carried out, because it may have cleared them.
    let within = |was: u32, is: u32, most: u32| (carried_out || is >= was) && is <= was.saturating_add(most);
    let kinds = profile::Violation::ALL.into_iter().all(|kind| {
        let times = if kind == profile::Violation::TooMany { 2 } else { 1 };
        let [was, is] = [before, now].map(|values| u32::from(values.violations.of(kind)));
        within(was, is, times * most)
    });
    kinds
        && within(before.uplinks_accepted, now.uplinks_accepted, most)
        && now.commands_carried_out <= before.commands_carried_out.saturating_add(most)
        && (carried_out || last_command(now) == last_command(before))
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

fn is_intact(writer: usize, read: &[u8]) -> bool {
    match writer {
        0 => Uplink::verify::<BaseStation>(read).is_ok(),
        _ => Uplink::verify::<FlightController>(read).is_ok(),
    }
}

/// Returns whether Port-Status may state this status bit and age (ms) of an uplink. If the uplink was `read`, its bytes
/// are compared too.
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
    // The status bit that calls an uplink fresh follows from the stated age.
    age_fits && bytes_fit && fresh == (told < expiry)
}
