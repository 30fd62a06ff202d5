//! Compares Link-Status with the signals on the wires and the frames on the air.
//!
//! Link-Status must be right for the instant at which its image was published, the last rise of FRESH before chip
//! select fell. The [expectation](crate::expectation) determines which frames the DPR had received by then, and allows
//! either value where this is uncertain.
//!
//! The judge keeps a `Snapshot` of the possible values of Link-Status after each frame, and an image has to agree with
//! one of them. If a frame ended shortly before FRESH rose, the image may lack it.
//!
//! # What each violation compares
//!
//! | violation | Link-Status is compared with |
//! |---|---|
//! | `LinkAge`, `LinkAgeOver` | the age of the last accepted Reported-Position, counted from its tick on pin TICK |
//! | `LinkCounters` | the frames at the antenna: counters lie within what is certain, and advance as they must |
//! | `LinkFlags`, `LinkFlagsOver` | the frames at the antenna, the DPR's last start, and the injected faults |
//! | `LinkTime` | the time since the DPR's start |
//!
//! `LinkAgeOver` and `LinkFlagsOver` are of a Link-Status by which the link looks worse than it is. They mislead nobody
//! to use what is old or wrong; the DPR tells so much when it has lost a frame that reached its antenna.
//!
//! If FRESH has not announced an image as rule `ssi` requires, the image is not compared. If objects are missing in the
//! image (rule `shown`), bits 0 and 1 of the status may fit the image or the frames at the antenna.
//!
//! While [`Excuse::Hearing`] holds, only the time, the reason of the last reset and the report of a front end that does
//! not answer are judged. That report must come within [`bounds::FRONT_END_TOLD`]. While [`Excuse::LinkCounters`]
//! holds, counters are compared only with those of the previous image.

mod clocks;
mod counters;
mod start;
#[cfg(test)]
mod tests;

use std::cmp::Ordering;
use std::collections::VecDeque;

use clocks::Clocks;
use counters::{Baseline, Counters};
use profile::{Layout, LinkStatusBits, LinkValues};
use start::{Reasons, Time};

use super::Rule;
use super::shown::publication;
use crate::disturbance::{Disturbances, Excuse};
use crate::expectation::{Certainty, Delivery};
use crate::read::{Reading, State};
use crate::{Board, Context, Event, Findings, Header, Violation, What, bounds};

/// The number of frames and of rises of FRESH that are kept for a transaction that has not ended.
const REMEMBERED: usize = 64;

/// The tolerance of the age that Link-Status states, ns: the DPR's clock, its detection of a frame's end, and HORUS's
/// front end (2.3 µs).
const INSTANTS: u64 = 30_000;

const AGE_UNIT: u64 = 100_000;

/// The tolerance, ns, of the second in which Link-Status reports a restart of HORUS: the time of a commit and the
/// errors of the crystals.
const RESTART_BAND: u64 = 2_000_000;

/// A Reported-Position that the DPR accepted, or may have accepted.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// The instant, ns, at which the sample was taken.
    at: u64,
    /// How much, ns, the DPR may understate the sample's age: the delay on the air, which the DPR cannot detect.
    delay: u64,
    /// How much, ns, the DPR may overstate the sample's age. If it missed the instant of a frame's end, it assumes the
    /// longest time.
    unsure: u64,
}

impl Sample {
    /// Returns a sample that stands for this sample, for the newer sample `other`, and for all possible samples between
    /// them.
    fn or(self, other: Self) -> Self {
        let newest = self.delay.max(other.at.saturating_sub(self.at) + other.delay);
        Self { at: self.at, delay: newest, unsure: self.unsure.max(other.unsure) }
    }
}

#[derive(Clone, Debug)]
struct Snapshot {
    frame: Option<Delivery>,
    counters: Counters,
    /// The samples that the DPR may have accepted last; one of them it has.
    samples: Vec<Sample>,
    /// Whether it is possible that the DPR has accepted no sample.
    none: bool,
    /// The objects of the cycle that the DPR must have accepted; bit n is object n.
    must: u8,
    /// The objects of the cycle that the DPR may have accepted; bit n is object n.
    may: u8,
    /// Two instants, ns. The DPR must hold the sequence until the first, and may hold it until the second.
    held: (u64, u64),
    frozen: Certainty,
    /// Two instants, ns: the last at which the DPR certainly detected a restart of HORUS, and the last at which it may
    /// have detected one.
    restarted: [Option<u64>; 2],
    implausible: Certainty,
}

impl Snapshot {
    fn ended(&self) -> u64 {
        self.frame.as_ref().map_or(0, |frame| frame.ended)
    }

    /// Records that the DPR accepted this sample, certainly if `must`, else possibly.
    fn accept(&mut self, sample: Sample, must: bool) {
        if must {
            self.samples.clear();
            self.none = false;
        }
        self.samples.push(sample);
        // The oldest two samples are merged into one, which stands for all samples from the first to the second.
        while let [oldest, second, ..] = self.samples[..]
            && self.samples.len() > REMEMBERED
        {
            self.samples.splice(..2, [oldest.or(second)]);
        }
    }
}

/// The rule that judges Link-Status; see the [module](self).
#[derive(Clone, Debug)]
pub struct LinkStatus {
    layout: Layout,
    publication: u64,
    clocks: Clocks,
    /// The snapshot after each frame and after the DPR's start, the oldest first.
    snapshots: VecDeque<Snapshot>,
    fresh: VecDeque<u64>,
    baseline: Option<Baseline>,
    time: Time,
    reasons: Reasons,
    /// Whether there is a field at the DPR's antenna, and since which instant, ns.
    field: (bool, u64),
    /// The bytes of the last judged transaction; the same bytes are not judged twice.
    last: Vec<u8>,
    /// The bytes that FRESH announced last.
    offered: Vec<u8>,
}

impl Rule for LinkStatus {
    fn new(header: &Header) -> Self {
        let layout = header.layout();
        Self {
            layout,
            publication: publication(header.worst_case()),
            clocks: Clocks::default(),
            snapshots: VecDeque::from([Self::at_start(layout)]),
            fresh: VecDeque::new(),
            baseline: None,
            time: Time::default(),
            reasons: Reasons::power_on(),
            field: (false, 0),
            last: vec![],
            offered: vec![],
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        match &event.what {
            What::Power { board: Board::Dpr, .. } | What::Reset { board: Board::Dpr, .. } => {
                self.reasons = Reasons::of(&event.what);
                self.snapshots = VecDeque::from([Self::at_start(self.layout)]);
                self.clocks = Clocks::default();
                self.fresh.clear();
                self.baseline = None;
                self.time = Time::default();
                self.last.clear();
                self.offered.clear();
            }
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Hearing) => self.may_have_missed(event.at),
            What::FieldHeard { on } if *on != self.field.0 => self.field = (*on, event.at),
            What::Fresh { high: true, offered } => {
                // FRESH has risen a second time for the same image, which is no publication. Rule `ssi` reports this
                // rise.
                let offered = offered.as_ref().map_or(&[][..], |bytes| &bytes.0);
                if context.window().offset() == 0 && !offered.is_empty() && offered == self.offered {
                    return;
                }
                self.offered = offered.to_vec();
                remember(&mut self.fresh, event.at);
            }
            What::Transaction { .. } => {
                if let Some(reading) = context.reading() {
                    self.read(reading, context, findings);
                }
            }
            _ => {}
        }
        if let Some(delivery) = context.delivery() {
            let blind = context.disturbances().excuse(Excuse::Hearing, delivery.started);
            self.heard(delivery.clone(), if blind { bounds::FRAME_DEADLINE } else { 0 }, context);
        }
    }
}

impl LinkStatus {
    fn at_start(layout: Layout) -> Snapshot {
        Snapshot {
            frame: None,
            counters: Counters::new(layout),
            samples: vec![],
            none: true,
            must: 0,
            may: 0,
            held: (0, 0),
            frozen: Certainty::Never,
            restarted: [None; 2],
            implausible: Certainty::Never,
        }
    }

    /// Records that the DPR may fail to receive from `at` on. A frame that ended just before may be lost too.
    fn may_have_missed(&mut self, at: u64) {
        let mut newest = self.snapshots.iter_mut().rev();
        let (Some(last), Some(before)) = (newest.next(), newest.next()) else { return };
        if at < last.ended() + bounds::LAST_BIT_TO_READABLE {
            // Unless the DPR certainly accepted a newer sample, `last` has the earlier ones already.
            let has = |old: &Sample| last.samples.iter().any(|kept| kept.at == old.at);
            if !before.samples.last().is_some_and(has) {
                last.samples.splice(..0, before.samples.iter().copied());
            }
            last.none |= before.none;
        }
    }

    /// Records a frame that has reached the antenna. `unsure`, ns, is the DPR's possible error about the frame's end.
    fn heard(&mut self, frame: Delivery, unsure: u64, context: &Context) {
        let Some(last) = self.snapshots.back() else { return };
        let mut next = last.clone();
        next.counters.frame(&frame);
        let of = |fate: Certainty| {
            let objects = frame.objects.iter().filter(|(.., own)| *own >= fate);
            objects.fold(0, |mask, (index, ..)| mask | 1_u8 << index)
        };
        let (must, may) = (of(Certainty::Must), of(Certainty::May));
        let completes = last.frame.as_ref().is_some_and(|first| frame.completes(first));
        (next.must, next.may) = if completes { (last.must | must, last.may | may) } else { (must, may) };
        if may & 1 == 1 {
            let sent = frame.objects.iter().find(|(index, ..)| *index == 0);
            let sent = sent.and_then(|(index, bytes, _)| context.truth().find(*index, bytes, frame.started));
            let tick = sent.and_then(|sent| Some((sent.tick?, frame.started - sent.started)));
            let (at, delay) = tick.unwrap_or((frame.sampled, 0));
            next.accept(Sample { at, delay, unsure }, must & 1 == 1);
        }
        next.held = context.expectation().held_until();
        next.frozen = context.expectation().frozen();
        for (at, least) in next.restarted.iter_mut().zip([Certainty::Must, Certainty::May]) {
            if frame.restarted >= least {
                *at = Some(frame.ended);
            }
        }
        next.implausible = self.clocks.frame(&frame);
        next.frame = Some(frame);
        remember(&mut self.snapshots, next);
    }

    fn read(&mut self, reading: &Reading, context: &Context, findings: &mut Findings) {
        let since = context.running(Board::Dpr).since;
        let Some(Ok(values)) = &reading.link else { return };
        let before = |rose: &&u64| **rose <= reading.selected;
        let Some(&published) = self.fresh.iter().rev().find(before) else { return };
        // FRESH must rise at least once per deadline. If its last rise is longer ago, no rise announced this image, and
        // rule `ssi` reports that.
        if reading.selected > published + bounds::FRAME_DEADLINE + self.publication {
            return;
        }
        let disturbances = context.disturbances();
        tells_of_a_silent_front_end(values.status, published, context, reading.selected, findings);
        if self.last == reading.miso {
            return;
        }
        let candidates = if disturbances.excuse(Excuse::Hearing, published) {
            None
        } else {
            let Some(candidates) = self.candidates(reading, published) else { return };
            Some(candidates)
        };
        self.last.clone_from(&reading.miso);
        // An image that replaces an unsound one repeats the time of the unsound one, so its time is not judged.
        let mut of_the_start = None;
        if !disturbances.excuse(Excuse::UnsoundImage, published) {
            if let Some(words) = self.time.wrong(values.timestamp, published, since) {
                findings.add(Violation::LinkTime, reading.selected, || words);
            }
            of_the_start = self.reasons.wrong(values.status);
        }
        if let Some(words) = of_the_start.clone() {
            findings.add(Violation::LinkFlags, reading.selected, || words);
        }
        let Some(candidates) = candidates else { return };
        if !self.counters_fit(values, published, &candidates, disturbances) {
            findings.add(Violation::LinkCounters, reading.selected, || {
                let LinkValues { objects_accepted, objects_rejected, frames_received, frames_missed, .. } = values;
                format!(
                    "accepted {objects_accepted}, rejected {objects_rejected}, received {frames_received}, missed \
                     {frames_missed}"
                )
            });
        }
        let mut of_candidates = candidates.iter().filter_map(|index| self.snapshots.get(*index));
        let mut ages = of_candidates.clone().map(|snapshot| compare_age(values.age_100us, snapshot, published));
        if ages.clone().all(Ordering::is_ne) {
            let over = ages.all(Ordering::is_gt) && !candidates.is_empty();
            let violation = if over { Violation::LinkAgeOver } else { Violation::LinkAge };
            findings.add(violation, reading.selected, || format!("{} · 100 µs", values.age_100us));
        }
        let no_field = self.no_field(published, since, disturbances);
        let flags = |snapshot| self.wrong_flags(snapshot, values.status, reading, published, context, no_field);
        // If no snapshot fits, the report states what contradicts the last snapshot, which includes every frame. The
        // link looks worse than it is only if it does so beside each snapshot.
        let wrong = of_candidates.try_fold((Violation::LinkFlagsOver, String::new()), |(so_far, _), snapshot| {
            let (violation, words) = flags(snapshot)?;
            Some((so_far.min(violation), words))
        });
        if let Some((violation, words)) = wrong.filter(|_| of_the_start.is_none()) {
            findings.add(violation, reading.selected, || words);
        }
    }

    /// Returns the indices of the snapshots that an image may show; `None` if another rule reports the image.
    fn candidates(&self, reading: &Reading, published: u64) -> Option<Vec<usize>> {
        let newest = |of: &dyn Fn(&Snapshot) -> bool| self.snapshots.iter().rposition(of);
        let last = newest(&|it| it.ended() <= published)?;
        let settled = newest(&|it| it.ended() + self.publication <= published);
        let mut first = settled.unwrap_or(0);
        if reading.timestamp().is_some() {
            let shown =
                newest(&|it| it.ended() <= published && it.frame.as_ref().is_some_and(|it| shows(reading, it)))?;
            let frame_of = |index: usize| self.snapshots.get(index).and_then(|snapshot| snapshot.frame.as_ref());
            let same_cycle = frame_of(last).zip(frame_of(shown)).is_some_and(|(last, shown)| last.completes(shown));
            // An image that shows an older cycle than FRESH announced is reported by another rule.
            if shown < first || shown < last && self.is_cause(last) && !same_cycle {
                return None;
            }
            first = shown;
        }
        if self.is_cause(last) {
            first = last;
        }
        Some((first..=last).collect())
    }

    /// Returns whether only the frame of snapshot `index` can have caused an image published just after the frame. The
    /// frame is then the last of its cycle, and no deadline passed at about the same instant.
    fn is_cause(&self, index: usize) -> bool {
        let frame_of = |index: usize| self.snapshots.get(index).and_then(|snapshot| snapshot.frame.as_ref());
        let Some(frame) = frame_of(index) else { return false };
        let is_last = |frame: &Delivery| frame.number + 1 == self.layout.frames();
        let Some(before) = index.checked_sub(1).and_then(frame_of) else { return false };
        let (deadline, belongs) = if is_last(before) {
            (bounds::FRAME_DEADLINE, true)
        } else {
            // If two frames are of different cycles, the first frame's image is published before the second frame is
            // processed.
            (bounds::SECOND_FRAME, frame.completes(before) && frame.shown == before.shown)
        };
        let in_time = frame.ended + bounds::SEQUENCE_BAND < before.ended + deadline;
        frame.received == Certainty::Must && is_last(frame) && belongs && in_time
    }

    fn counters_fit(
        &mut self,
        values: &LinkValues,
        published: u64,
        candidates: &[usize],
        disturbances: &Disturbances,
    ) -> bool {
        let Self { snapshots, baseline, publication, .. } = self;
        let broken = disturbances.excuse(Excuse::LinkCounters, published);
        let mut fits = false;
        for (place, index) in candidates.iter().enumerate() {
            let Some(counters) = snapshots.get(*index).map(|snapshot| &snapshot.counters) else { continue };
            let next = candidates.get(place + 1).and_then(|next| Some(&snapshots.get(*next)?.counters));
            let absolute = broken || counters.add_up(values) && counters.fit(values, published, *publication, next);
            let relative = |before: &Baseline| counters.follow(before, values, published, *publication, next);
            fits |= absolute && baseline.as_ref().is_none_or(relative);
        }
        if let [only] = candidates
            && let Some(snapshot) = snapshots.get(*only)
            && let Some(next) = snapshot.counters.baseline(values, published)
        {
            *baseline = Some(next);
        }
        fits
    }

    fn wrong_flags(
        &self,
        snapshot: &Snapshot,
        status: LinkStatusBits,
        reading: &Reading,
        published: u64,
        context: &Context,
        no_field: Certainty,
    ) -> Option<(Violation, String)> {
        let disturbances = context.disturbances();
        let sealed = published - bounds::SEALED_BEFORE_FRESH.min(published);
        let expected = self.objects_expected(snapshot, published);
        let (must, may) = snapshot.held;
        let held = match published {
            _ if published <= must => Certainty::Must,
            _ if sealed > may => Certainty::Never,
            _ => Certainty::May,
        };
        let shown_for = |at: Option<u64>, band: i64| {
            let shown = bounds::RESTART_SHOWN.saturating_add_signed(band);
            at.is_some_and(|at| published.saturating_sub(at) < shown)
        };
        let band = i64::try_from(RESTART_BAND).unwrap_or(i64::MAX);
        let restarted = match snapshot.restarted {
            [sure, _] if shown_for(sure, -band) => Certainty::Must,
            [_, perhaps] if shown_for(perhaps, band) => Certainty::May,
            _ => Certainty::Never,
        };
        let implausible = if held == Certainty::Never { held } else { snapshot.implausible.min(held) };
        let fault = |excuse| match disturbances.excuse(excuse, published) {
            true => Certainty::May,
            false => Certainty::Never,
        };
        // After a long silence the DPR cannot tell whether the sender is silent or its own front end fails.
        let front_end = if context.expectation().is_silent(published) { Certainty::May } else { Certainty::Never };
        // Each claim of the status: its words; whether it says that the link is well, and not that something fails;
        // what the status says; what the image shows; what is true.
        let claims = [
            ("the link up", true, status.link_up(), self.objects_shown(reading, false), expected[0]),
            ("all accepted", true, status.all_accepted(), self.objects_shown(reading, true), expected[1]),
            ("HORUS frozen", false, status.horus_frozen(), None, snapshot.frozen),
            ("HORUS restarted", false, status.horus_restarted(), None, restarted),
            ("a RAM fault", false, status.ram_fault(), None, fault(Excuse::RamFault)),
            ("a front end fault", false, status.front_end_fault(), None, front_end),
            ("in sequence", true, !status.out_of_sequence(), None, held),
            ("HORUS's clock implausible", false, status.horus_clock_implausible(), None, implausible),
            ("a flash fault", false, status.flash_fault(), None, fault(Excuse::FlashFault)),
            ("no field", false, status.no_field(), None, no_field),
        ];
        let is_wrong = |(_, _, said, shown, truth): &&(&str, bool, bool, Option<bool>, Certainty)| {
            let against = |truth: bool| truth != *said;
            let truth = match truth {
                Certainty::Must => against(true),
                Certainty::Never => against(false),
                Certainty::May => false,
            };
            truth && shown.is_none_or(against)
        };
        // The link looks better than it is if what is well is claimed wrongly, or if a fault is denied wrongly.
        let better = claims.iter().find(|claim| is_wrong(claim) && claim.1 == claim.2);
        let (violation, (words, ..)) = match better {
            Some(claim) => (Violation::LinkFlags, claim),
            None => (Violation::LinkFlagsOver, claims.iter().find(is_wrong)?),
        };
        Some((violation, format!("{words}: status {:#06x}", status.bits())))
    }

    /// Returns whether an image must report that there is no field. A front end that starts in a field detects the
    /// field only with the first frame, and a disturbed front end may not detect it at all.
    fn no_field(&self, published: u64, dpr_since: u64, disturbances: &Disturbances) -> Certainty {
        let (on, since) = self.field;
        let from = since.max(dpr_since + bounds::START);
        let heard_in_it = |it: &Snapshot| {
            it.frame.as_ref().is_some_and(|frame| frame.received == Certainty::Must && frame.started > since)
        };
        match published {
            _ if published < from + bounds::FIELD_TOLD => Certainty::May,
            _ if disturbances.excuse(Excuse::NoField, published) => Certainty::May,
            _ if !on => Certainty::Must,
            _ if self.snapshots.iter().any(heard_in_it) => Certainty::Never,
            _ => Certainty::May,
        }
    }

    /// Returns whether the image shows any object or, if `all`, every object; `None` if too few bytes were read.
    fn objects_shown(&self, reading: &Reading, all: bool) -> Option<bool> {
        let valid = |state: &State| matches!(state, State::Valid { .. });
        let any = reading.objects.iter().any(|placed| valid(&placed.state));
        let missing = reading.objects.iter().any(|placed| placed.state == State::Vacant);
        let whole = reading.objects.len() == self.layout.objects();
        match all {
            false if any => Some(true),
            true if missing => Some(false),
            _ if whole => Some(all),
            _ => None,
        }
    }

    /// Returns whether an image of this snapshot must show any object, and whether it must show all.
    fn objects_expected(&self, snapshot: &Snapshot, published: u64) -> [Certainty; 2] {
        let Some(frame) = &snapshot.frame else { return [Certainty::Never; 2] };
        let after = published.saturating_sub(frame.ended);
        if after > bounds::FRAME_DEADLINE + self.publication {
            return [Certainty::Never; 2];
        }
        let band = bounds::SEQUENCE_BAND;
        let waits = frame.number + 1 < self.layout.frames();
        // Close to a deadline, or while the DPR waits for a second frame, the readable image may be that of the
        // previous cycle.
        if after + band > bounds::FRAME_DEADLINE || waits && after < bounds::SECOND_FRAME + band {
            return [Certainty::May; 2];
        }
        let whole = u8::MAX >> (8 - self.layout.objects());
        let of = |holds: &dyn Fn(u8) -> bool| match (holds(snapshot.must), holds(snapshot.may)) {
            (true, _) => Certainty::Must,
            (false, true) => Certainty::May,
            (false, false) => Certainty::Never,
        };
        [of(&|mask| mask != 0), of(&|mask| mask == whole)]
    }
}

/// Appends `newest` to `queue`, of which the last [`REMEMBERED`] are kept.
fn remember<T>(queue: &mut VecDeque<T>, newest: T) {
    queue.push_back(newest);
    if queue.len() > REMEMBERED {
        queue.pop_front();
    }
}

/// Judges whether an image published at `published` reports that the front end does not answer.
fn tells_of_a_silent_front_end(
    status: LinkStatusBits,
    published: u64,
    context: &Context,
    selected: u64,
    findings: &mut Findings,
) {
    let (from, until) = context.disturbances().silent_front_end();
    let dpr = context.running(Board::Dpr);
    let from = from.max(dpr.since + bounds::START) + bounds::FRONT_END_TOLD;
    // A dead task may be the task that would detect the silent front end.
    let until = until.min(dpr.dead.unwrap_or(u64::MAX));
    let told = status.front_end_fault() && !status.link_up() && !status.all_accepted();
    if (from..until).contains(&published) && !told {
        findings.add(Violation::LinkFlags, selected, || {
            format!("a front end that does not answer: status {:#06x}", status.bits())
        });
    }
}

/// Returns whether a transaction shows an object of this frame.
fn shows(reading: &Reading, frame: &Delivery) -> bool {
    let mut objects = frame.objects.iter().filter(|(.., fate)| *fate > Certainty::Never);
    objects.any(|(index, bytes, _)| reading.objects.iter().any(|it| it.index == *index && it.bytes == *bytes))
}

/// Compares the age `told` by Link-Status, in 0.1 ms, in an image published at `published`, with the ages that it may
/// state: equal to one of them, greater than all, or less than one of them.
fn compare_age(told: u16, snapshot: &Snapshot, published: u64) -> Ordering {
    let units = |ns: u64| u16::try_from(ns / AGE_UNIT).unwrap_or(u16::MAX);
    let compare = |sample: &Sample| {
        let age = published.saturating_sub(sample.at);
        let crystals = age / 1_000_000 * bounds::CRYSTALS_PPM;
        let least = age.saturating_sub(bounds::SEALED_BEFORE_FRESH + INSTANTS + crystals + sample.delay);
        match told {
            _ if told < units(least) => Ordering::Less,
            _ if told > units(age + INSTANTS + crystals + sample.unsure) => Ordering::Greater,
            _ => Ordering::Equal,
        }
    };
    let mut ages = snapshot.samples.iter().map(compare);
    if snapshot.none && told == u16::MAX || ages.clone().any(Ordering::is_eq) {
        Ordering::Equal
    } else if !snapshot.samples.is_empty() && ages.all(Ordering::is_gt) {
        Ordering::Greater
    } else {
        Ordering::Less
    }
}
