//! Keeps the state of one drone: the newest of each of its objects, their ages, and the alarms.
//!
//! **Each object is judged separately.** CRCs and identifier determine whether an object is intact ([`Place::judge`]).
//! An intact object is shown if it is newer than the displayed object of its kind. So if two messages arrive in the
//! wrong order, objects of the older message have no effect, except those of kinds that the newer message lacks.
//!
//! **A HORUS that has restarted** counts from 0 again, so its objects are older than the displayed ones. They are
//! accepted after three cycles in a row that each advance, once the displayed sender is quiet. By these timestamps,
//! HORUS must not have been running for longer than nothing newer has come: a HORUS from which data came two seconds
//! ago cannot have been running for an hour since its restart. Then the displayed data are dropped. A single repeated,
//! delayed, reordered or inserted message is never taken for a restart. Three delayed messages in a row may be taken
//! for one in HORUS's first [`RESTART_SLACK_US`](order::RESTART_SLACK_US); the next newer message corrects this. Other
//! messages belong to another sender ([`order`], [`fleet`](crate::fleet)).
//!
//! The data of a restarted HORUS may arrive only when it has been running for longer than it had before the restart.
//! Its timestamps then continue the earlier ones, and only a changed reason of HORUS's last reset reveals the restart.
//!
//! Link-Status and Port-Status have the DPR's clock and are judged in the same way. The base station's uplink has the
//! clock of the station that sent it, so no timestamps can be compared: the last uplink is always kept, and only its
//! sender can evaluate it ([`uplink`](Drone::uplink)). An uplink is not a sign of life of the drone.
//!
//! **Everything that is kept can be shown.** Impossible values, and values that their status does not mark as valid,
//! are removed first ([`profile::range`]).
//!
//! **Alarms** follow from the kept data and the time; [`Drone::tick`] returns their changes. The bits of Link-Status
//! are alarms as well.
//!
//! **The active hold** is judged and kept separately ([`hold`]). Nothing else here depends on it.

pub mod hold;
pub mod order;
pub mod words;

use profile::ssi::client::Shown;
use profile::{
    GpsValues, HorusState, LinkStatus, LinkValues, MAX_RECEIVERS, Object, PortStatus, PortValues, Rejection,
    ReportedStatus, ReportedValues, ResetReason, Uplink,
};

use crate::age::Ages;
use crate::alarm::{Alarms, Board};
use crate::{Alarm, Bundle, Change, Intact, Place, Raised};
use hold::HoldState;
use order::{Order, Step};

/// The age from which on a position is stale, µs. The page must report a stale position at an age of half a second. The
/// time from this age to half a second is for receiving and drawing the state.
pub const STALE_US: u64 = 400_000;

/// The age from which on the data of a receiver or of the link are old, µs. It is long because receivers take turns on
/// a slow radio.
pub const OLD_US: u64 = 1_000_000;

/// The time without intact data after which the drone counts as silent, µs.
pub const SILENT_US: u64 = 1_000_000;

/// The time for which a single event causes an alarm, µs.
pub const RECENT_US: u64 = 10_000_000;

/// Duplicates of a sample are counted if they come later than this time after the sample's first arrival, µs. If more
/// than [`FROZEN_REPEATS`] come, HORUS's timestamp is frozen.
pub const FROZEN_US: u64 = 300_000;

/// The greatest number of late duplicates of one sample that causes no alarm. A duplicate is late if it comes more than
/// [`FROZEN_US`] after the sample's first arrival.
pub const FROZEN_REPEATS: u32 = 2;

/// The verdict on an object that arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// The object is intact and newer than the displayed one, and is shown now.
    New,
    /// The object is intact and displayed already.
    Duplicate,
    /// The object is intact and older than the displayed one.
    Older,
    /// The object is intact, but is not shown, since its timestamp does not continue the earlier ones.
    OutOfSequence,
    /// There is no object: the bytes at its place are 0x00 or 0xFF throughout, because the DPR did not accept an
    /// object.
    Vacant,
    /// The object is not intact, or is of another kind than expected.
    Rejected(Rejection),
}

impl Verdict {
    /// Returns whether the object is intact and of the expected kind.
    #[must_use]
    pub const fn is_intact(self) -> bool {
        matches!(self, Self::New | Self::Duplicate | Self::Older | Self::OutOfSequence)
    }

    /// Returns the verdict's name for programs.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::New => "new",
            Self::Duplicate => "duplicate",
            Self::Older => "older",
            Self::OutOfSequence => "out-of-sequence",
            Self::Vacant => "vacant",
            Self::Rejected(Rejection::Length) => "length",
            Self::Rejected(Rejection::Crc) => "crc",
            Self::Rejected(Rejection::PositionCrc) => "position-crc",
            Self::Rejected(Rejection::Identifier) => "identifier",
            Self::Rejected(_) => "rejected",
        }
    }
}

/// The newest object of one kind, with the times of its arrivals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held<T> {
    /// The values of the object.
    pub values: T,
    /// The timestamp of the object by its sender's clock, ms.
    pub timestamp: u32,
    /// The instant at which the object first arrived, µs.
    pub arrived_us: u64,
    /// The delay of the object beyond the shortest delay, µs ([`age`](crate::age)).
    pub late_us: u64,
    repeats: u32,
    crc: u32,
    implausible: bool,
}

impl<T> Held<T> {
    /// Returns a lower bound of the object's age at `now_us`, µs: the shortest delay is not included.
    #[must_use]
    pub fn age_us(&self, now_us: u64) -> u64 {
        now_us.saturating_sub(self.arrived_us).saturating_add(self.late_us)
    }

    fn repeated(&mut self, at_us: u64) {
        if at_us.saturating_sub(self.arrived_us) > FROZEN_US {
            self.repeats = self.repeats.saturating_add(1);
        }
    }
}

/// Totals of a drone's messages and objects since the drone was first received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// The number of messages with objects of this drone.
    pub messages: u64,
    /// The number of objects that were newer than the displayed ones, and so were shown.
    pub new: u64,
    /// The number of intact objects that were displayed already.
    pub duplicate: u64,
    /// The number of intact objects that were older than the displayed one.
    pub older: u64,
    /// The number of intact objects whose timestamp did not continue the earlier ones.
    pub out_of_sequence: u64,
    /// The number of objects that were missing, because the DPR had not accepted them.
    pub vacant: u64,
    /// The number of objects with a wrong frame or position CRC.
    pub bad_crc: u64,
    /// The number of intact objects of another kind or length than expected.
    pub misplaced: u64,
    /// The number of messages with intact objects from different cycles.
    pub mixed: u64,
    /// The number of cycles of HORUS that did not arrive, or arrived after a newer one.
    pub missed: u64,
    /// The number of times that HORUS restarted.
    pub restarts: u64,
}

/// The data, ages and alarms of one drone. See the [module](self).
#[derive(Clone, Debug)]
pub struct Drone {
    horus: Order,
    dpr: Order,
    port: Order,
    ages: Ages,
    dpr_ages: Ages,
    reported: Option<Held<ReportedValues>>,
    gps: [Option<Held<GpsValues>>; MAX_RECEIVERS],
    link: Option<Held<LinkValues>>,
    port_status: Option<Held<PortValues>>,
    uplink: Option<Uplink>,
    /// The state of the active hold; `None` if the drone forwards nothing of a hold.
    hold: Option<Box<HoldState>>,
    receivers: usize,
    counts: Counts,
    board: Board,
    /// The instant, µs, at which an intact object last arrived. Before the first one, it is the instant from which on
    /// the drone is awaited.
    heard_us: u64,
    restarted_us: Option<u64>,
    damaged_us: Option<u64>,
    strange_us: Option<u64>,
    rival_us: Option<u64>,
    stranger: bool,
}

impl Drone {
    /// Returns a drone without data. The drone is awaited since `now_us`.
    #[must_use]
    pub fn new(now_us: u64) -> Self {
        Self {
            horus: Order::default(),
            dpr: Order::default(),
            port: Order::default(),
            ages: Ages::default(),
            dpr_ages: Ages::default(),
            reported: None,
            gps: [None; MAX_RECEIVERS],
            link: None,
            port_status: None,
            uplink: None,
            hold: None,
            receivers: 0,
            counts: Counts::default(),
            board: Board::default(),
            heard_us: now_us,
            restarted_us: None,
            damaged_us: None,
            strange_us: None,
            rival_us: None,
            stranger: false,
        }
    }

    /// Judges a message's objects, which arrived at `at_us`, and keeps the accepted ones. Returns the verdicts in the
    /// order of the objects.
    pub fn take_bundle(&mut self, at_us: u64, bundle: &Bundle<'_>) -> Vec<Verdict> {
        self.counts.messages += 1;
        self.stranger = false;
        let mut cycle = None;
        let mut mixed = false;
        let verdicts = bundle.objects().map(|(place, bytes)| {
            if let (Shown::Intact(object), Place::Reported | Place::Gps(_)) = (place.judge(bytes), place) {
                mixed |= *cycle.get_or_insert(object.timestamp()) != object.timestamp();
            }
            self.take(place, at_us, bytes)
        });
        let verdicts = verdicts.collect();
        self.counts.mixed += u64::from(mixed);
        verdicts
    }

    /// Judges bytes that arrived at `at_us`, µs, as an object of the kind `place`, and keeps it if it is accepted.
    pub fn take(&mut self, place: Place, at_us: u64, bytes: &[u8]) -> Verdict {
        if place == Place::Hold {
            return self.hold.get_or_insert_default().take(at_us, bytes);
        }
        let verdict = match place.judge(bytes) {
            Shown::Vacant => Verdict::Vacant,
            Shown::Damaged(why) => Verdict::Rejected(why),
            Shown::Intact(object) => {
                let crc = bytes.last_chunk().map_or(0, |crc| u32::from_be_bytes(*crc));
                let verdict = match object {
                    Intact::LinkStatus(link) => self.take_link(at_us, link, crc),
                    Intact::Object(object) => self.take_object(place, at_us, object, crc),
                    Intact::PortStatus(port) => self.take_port(at_us, port, crc),
                    Intact::Uplink(uplink) => match self.uplink.replace(*uplink) == Some(*uplink) {
                        true => Verdict::Duplicate,
                        false => Verdict::New,
                    },
                    Intact::Hold(_) => Verdict::Rejected(Rejection::Identifier),
                };
                // A drone shows a sign of life only by an accepted object. The base station's own uplink does not
                // count.
                if verdict != Verdict::OutOfSequence && place != Place::Uplink {
                    self.heard_us = self.heard_us.max(at_us);
                }
                verdict
            }
        };
        let Counts { new, duplicate, older, out_of_sequence, vacant, bad_crc, misplaced, .. } = &mut self.counts;
        *match verdict {
            Verdict::New => new,
            Verdict::Duplicate => duplicate,
            Verdict::Older => older,
            Verdict::OutOfSequence => out_of_sequence,
            Verdict::Vacant => vacant,
            Verdict::Rejected(Rejection::Crc | Rejection::PositionCrc) => bad_crc,
            Verdict::Rejected(_) => misplaced,
        } += 1;
        match verdict {
            Verdict::OutOfSequence => self.strange_us = Some(at_us),
            Verdict::Rejected(_) => self.damaged_us = Some(at_us),
            _ => {}
        }
        verdict
    }

    fn take_link(&mut self, at_us: u64, link: &LinkStatus, crc: u32) -> Verdict {
        let timestamp = link.timestamp();
        match self.dpr.judge(timestamp, at_us, false, self.dpr_ages.early_us(timestamp, at_us, true)) {
            Step::Newest { .. } => {}
            Step::Restarted => {
                self.dpr_ages = Ages::default();
                self.port = Order::default();
                self.port_status = None;
                self.uplink = None;
            }
            Step::Same => return self.repeated(self.link.as_ref().map(|held| held.crc), at_us, crc),
            Step::Older => return Verdict::Older,
            Step::Search | Step::Stranger => return Verdict::OutOfSequence,
        }
        let late_us = self.dpr_ages.take(timestamp, at_us, true);
        let values = link.values();
        let (arrived_us, repeats, implausible) = (at_us, 0, false);
        self.link = Some(Held { values, timestamp, arrived_us, late_us, repeats, crc, implausible });
        Verdict::New
    }

    fn take_port(&mut self, at_us: u64, port: &PortStatus, crc: u32) -> Verdict {
        let timestamp = port.timestamp();
        let early_us = self.dpr_ages.early_us(timestamp, at_us, true);
        match self.port.judge(timestamp, at_us, false, early_us) {
            Step::Newest { .. } | Step::Restarted => {}
            Step::Same => return self.repeated(self.port_status.as_ref().map(|held| held.crc), at_us, crc),
            Step::Older => return Verdict::Older,
            Step::Search | Step::Stranger => return Verdict::OutOfSequence,
        }
        let (arrived_us, repeats, implausible) = (at_us, 0, false);
        let late_us = early_us.min(0).unsigned_abs();
        let values = port.values();
        self.port_status = Some(Held { values, timestamp, arrived_us, late_us, repeats, crc, implausible });
        Verdict::New
    }

    /// Judges an object that has the same timestamp as the displayed one. Their frame CRCs, `crc` and `own`, are
    /// compared.
    fn repeated(&mut self, own: Option<u32>, at_us: u64, crc: u32) -> Verdict {
        if own == Some(crc) {
            return Verdict::Duplicate;
        }
        // A sender never seals two contents with the same timestamp, so there must be two senders.
        self.rival_us = Some(at_us);
        Verdict::OutOfSequence
    }

    fn take_object(&mut self, place: Place, at_us: u64, object: Object<'_>, crc: u32) -> Verdict {
        let timestamp = object.timestamp();
        let receiver = match place {
            Place::Gps(receiver) => usize::from(receiver).checked_sub(1),
            Place::Reported | Place::LinkStatus | Place::PortStatus | Place::Uplink | Place::Hold => None,
        };
        let own = match receiver {
            None => self.reported.as_ref().map(|held| (held.timestamp, held.crc)),
            Some(receiver) => self.gps.get(receiver).and_then(Option::as_ref).map(|held| (held.timestamp, held.crc)),
        };
        let (own, own_crc) = (own.map(|(timestamp, _)| timestamp), own.map(|(_, crc)| crc));
        let newer_than_own = || profile::freshness(own, timestamp).is_fresh();
        let crystal = self.has_crystal();
        let reset = |status: ReportedStatus| status.reset_reason();
        let had_another_reset = match object {
            Object::Reported(sent) => {
                self.reported.is_some_and(|held| reset(held.values.status) != reset(sent.status()))
            }
            Object::Gps(_) => false,
        };
        match self.horus.judge(timestamp, at_us, true, self.ages.early_us(timestamp, at_us, crystal)) {
            Step::Newest { .. } | Step::Same | Step::Older if had_another_reset && newer_than_own() => {
                self.restart(at_us);
            }
            Step::Newest { missed } => self.counts.missed += u64::from(missed),
            Step::Restarted => self.restart(at_us),
            Step::Same | Step::Older if newer_than_own() => {}
            Step::Same | Step::Older if own == Some(timestamp) => {
                match receiver {
                    None => self.reported.iter_mut().for_each(|held| held.repeated(at_us)),
                    Some(receiver) => self.gps[receiver].iter_mut().for_each(|held| held.repeated(at_us)),
                }
                return self.repeated(own_crc, at_us, crc);
            }
            Step::Same | Step::Older => return Verdict::Older,
            Step::Search => return Verdict::OutOfSequence,
            Step::Stranger => {
                self.stranger = true;
                return Verdict::OutOfSequence;
            }
        }
        let late_us = self.ages.take(timestamp, at_us, crystal);
        let arrived_us = at_us;
        match (object, receiver) {
            (Object::Reported(object), _) => {
                let sent = object.values();
                let values = sent.checked();
                let implausible = sent.status.position_valid() && !values.status.position_valid();
                self.reported = Some(Held { values, timestamp, arrived_us, late_us, repeats: 0, crc, implausible });
            }
            (Object::Gps(object), Some(receiver)) => {
                let sent = object.values();
                let values = sent.checked();
                let implausible = sent.status.position_valid() && !values.status.position_valid();
                self.receivers = self.receivers.max(receiver + 1);
                let held = Held { values, timestamp, arrived_us, late_us, repeats: 0, crc, implausible };
                self.gps[receiver] = Some(held);
            }
            // Only bytes at the place of a GPS object are judged to be a GPS object, so this case cannot occur.
            (Object::Gps(_), None) => {}
        }
        Verdict::New
    }

    fn restart(&mut self, at_us: u64) {
        self.counts.restarts += 1;
        self.restarted_us = Some(at_us);
        self.ages = Ages::default();
        self.reported = None;
        self.gps = [None; MAX_RECEIVERS];
    }

    fn has_crystal(&self) -> bool {
        self.reported.as_ref().is_none_or(|held| !held.values.status.without_crystal())
    }

    /// Returns whether a message's objects, which arrived at `at_us`, may belong to this drone. They must continue its
    /// data, or be late. Only the profile's first object is examined, or the DPR's objects if there is no profile.
    #[must_use]
    pub fn fits(&self, at_us: u64, bundle: &Bundle<'_>) -> bool {
        let mut fits = true;
        for (place, bytes) in bundle.objects() {
            match place.judge(bytes) {
                Shown::Intact(Intact::LinkStatus(link)) => {
                    let early_us = self.dpr_ages.early_us(link.timestamp(), at_us, true);
                    fits = self.dpr.fits(link.timestamp(), at_us, false, early_us);
                }
                Shown::Intact(Intact::Object(object)) => {
                    let early_us = self.ages.early_us(object.timestamp(), at_us, self.has_crystal());
                    return self.horus.fits(object.timestamp(), at_us, true, early_us);
                }
                Shown::Intact(Intact::PortStatus(port)) => {
                    let early_us = self.dpr_ages.early_us(port.timestamp(), at_us, true);
                    fits = self.port.fits(port.timestamp(), at_us, false, early_us);
                }
                Shown::Intact(Intact::Hold(object)) => {
                    fits = self.hold.as_ref().is_none_or(|hold| hold.fits(at_us, object.timestamp()));
                }
                _ => {}
            }
        }
        fits
    }

    /// Returns whether the last object came from another sender with this drone's id ([`Step::Stranger`]).
    #[must_use]
    pub const fn met_stranger(&self) -> bool {
        self.stranger
    }

    /// Records that another sender used this drone's id at `at_us`.
    pub const fn note_rival(&mut self, at_us: u64) {
        self.rival_us = Some(at_us);
    }

    /// Returns the instant of HORUS's start, by its newest sample, µs of the caller's clock.
    #[must_use]
    pub fn started_us(&self) -> Option<i64> {
        let held = self.reported.as_ref()?;
        let taken_us = held.arrived_us.saturating_sub(held.late_us);
        Some(taken_us.cast_signed().saturating_sub(i64::from(held.timestamp) * 1_000))
    }

    /// Updates the alarms to `now_us`. Returns the alarms that began or ended.
    pub fn tick(&mut self, now_us: u64) -> Vec<Change> {
        let alarms = self.alarms_at(now_us);
        self.board.set(now_us, alarms)
    }

    /// Returns the alarms that held at the last [`tick`](Self::tick), the gravest first.
    pub fn raised(&self) -> impl Iterator<Item = Raised> {
        self.board.raised()
    }

    /// Returns the alarms that hold at `now_us`.
    #[must_use]
    pub fn alarms_at(&self, now_us: u64) -> Alarms {
        let within = |what: Option<u64>, span_us: u64| what.is_some_and(|at| now_us.saturating_sub(at) <= span_us);
        let link = self.link.as_ref().map(|held| held.values.status).unwrap_or_default();
        let reported = self.reported.as_ref();
        let status = reported.map(|held| held.values.status).unwrap_or_default();
        let is_in = |state| status.state() == Some(state);
        let stale = reported.is_none_or(|held| held.age_us(now_us) > STALE_US);
        let silent = now_us.saturating_sub(self.heard_us) > SILENT_US;
        // Once a drone is silent, all its data are old, so there are no further alarms for old data.
        let old = |age_us: u64| age_us > OLD_US && !silent;
        let mut gps = self.gps.iter().flatten();
        let implausible = reported.is_some_and(|held| held.implausible);
        let frozen = reported.is_some_and(|held| held.repeats > FROZEN_REPEATS);
        let clock = link.horus_clock_implausible() || self.ages.is_clock_implausible();
        Alarms::none()
            .with(Alarm::EmergencyFired, is_in(HorusState::EmergencyFired))
            .with(Alarm::MotorsCut, is_in(HorusState::MotorsCut))
            .with(Alarm::SwitchedToRedundant, is_in(HorusState::SwitchedToRedundant))
            .with(Alarm::OutsideRange, is_in(HorusState::OutsideRange))
            .with(Alarm::InputsContradict, is_in(HorusState::InputsContradict))
            .with(Alarm::UnknownState, reported.is_some() && status.state().is_none())
            .with(Alarm::TwoSenders, within(self.rival_us, RECENT_US))
            .with(Alarm::PositionLost, is_in(HorusState::PositionLost))
            .with(Alarm::HorusMemoryFault, status.memory_fault())
            .with(Alarm::Silent, silent)
            .with(Alarm::Stale, stale)
            .with(Alarm::LinkDown, self.link.is_some() && !link.link_up())
            .with(Alarm::NoField, link.no_field())
            .with(Alarm::Frozen, frozen || link.horus_frozen())
            .with(Alarm::OutOfSequence, link.out_of_sequence() || within(self.strange_us, SILENT_US))
            .with(Alarm::Implausible, implausible)
            .with(Alarm::NoAgreement, reported.is_some() && !status.position_valid() && !implausible)
            .with(Alarm::ClockImplausible, clock)
            .with(Alarm::RamFault, link.ram_fault())
            .with(Alarm::FlashFault, link.flash_fault())
            .with(Alarm::FrontEndFault, link.front_end_fault())
            .with(Alarm::ReceiversOld, gps.clone().any(|held| old(held.age_us(now_us))))
            .with(Alarm::LinkStatusOld, self.link.as_ref().is_some_and(|held| old(held.age_us(now_us))))
            .with(Alarm::ReceiverImplausible, gps.any(|held| held.implausible))
            .with(Alarm::Restarted, link.horus_restarted() || within(self.restarted_us, RECENT_US))
            .with(Alarm::HorusUnaskedReset, status.reset_reason().is_some_and(ResetReason::is_unasked))
            .with(Alarm::UnaskedReset, link.unasked_reset())
            .with(Alarm::Degraded, status.degraded())
            .with(Alarm::NoCrystal, status.without_crystal())
            .with(Alarm::Damaged, within(self.damaged_us, RECENT_US))
    }

    /// Returns the newest Reported-Position.
    #[must_use]
    pub const fn reported(&self) -> Option<&Held<ReportedValues>> {
        self.reported.as_ref()
    }

    /// Returns the newest object of receiver `receiver`, counted from 1.
    #[must_use]
    pub fn gps(&self, receiver: usize) -> Option<&Held<GpsValues>> {
        self.gps.get(receiver.checked_sub(1)?)?.as_ref()
    }

    /// Returns the newest Link-Status.
    #[must_use]
    pub const fn link(&self) -> Option<&Held<LinkValues>> {
        self.link.as_ref()
    }

    /// Returns the newest Port-Status, which a drone forwards as the answer to an uplink.
    #[must_use]
    pub const fn port_status(&self) -> Option<&Held<PortValues>> {
        self.port_status.as_ref()
    }

    /// Returns the last uplink of the base station that the DPR showed. If it equals an uplink that was sent, the DPR
    /// has stored that uplink at some time.
    #[must_use]
    pub const fn uplink(&self) -> Option<&Uplink> {
        self.uplink.as_ref()
    }

    /// Returns what is known of the active hold; `None` if the drone has forwarded nothing of a hold.
    #[must_use]
    pub fn hold(&self) -> Option<&HoldState> {
        self.hold.as_deref()
    }

    /// Returns the highest number of a receiver of which an intact object arrived, 1 to 5; 0 if none did.
    #[must_use]
    pub const fn receivers(&self) -> usize {
        self.receivers
    }

    /// Returns HORUS's newest time, ms since its start.
    #[must_use]
    pub fn timestamp(&self) -> Option<u32> {
        self.horus.newest()
    }

    /// Returns the instant at which an intact object last arrived, µs.
    #[must_use]
    pub const fn heard_us(&self) -> u64 {
        self.heard_us
    }

    /// Returns the totals of the drone's messages and objects.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        self.counts
    }
}

#[cfg(test)]
mod tests;
