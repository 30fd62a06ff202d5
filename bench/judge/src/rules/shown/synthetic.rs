//! Makes a log in which HORUS, the air and the DPR follow the design, to test the rules `shown` and `link_status`.
//!
//! The DPR is a small model. It uses `profile::sequence`, which the judge does not use.

use std::collections::BTreeMap;

use profile::sequence::{Judgement, Sequence};
use profile::{
    GpsValues, Layout, LinkStatus, LinkStatusBits, LinkValues, Object, Profile, ReportedStatus, ReportedValues,
    ResetReason, air,
};

use crate::expectation::age_at_end;
use crate::testing::in_order;
use crate::{Board, Event, Header, Log, SsiEvent, Verdict, Violation, What, judge};

pub(crate) const US: u64 = 1_000;
pub(crate) const MS: u64 = 1_000_000;

#[derive(Clone, Debug)]
pub(crate) enum Air {
    Lost,
    /// The air damages these objects of the frame.
    Hit(Vec<usize>),
    /// The frame arrives late by this time, ns.
    Delayed(u64),
    /// The frame arrives a second time after this time, ns.
    Repeated(u64),
    Cut,
}

#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub(crate) at: u64,
    pub(crate) link: LinkValues,
    /// The bytes of each object; zeros for an object that the image lacks.
    pub(crate) places: Vec<Vec<u8>>,
    /// The instant, ns, until which the image can be read.
    pub(crate) expires: u64,
}

impl Image {
    pub(crate) fn timestamp(&self) -> Option<u32> {
        let objects = self.places.iter().enumerate();
        objects.filter_map(|(index, bytes)| Some(Object::verify(index, bytes).ok()?.timestamp())).next()
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Run {
    pub(crate) n: usize,
    pub(crate) cycles: u32,
    /// The effect of the air on each frame, by the cycle's number (from 1) and the frame's number in the cycle (from
    /// 0).
    pub(crate) hits: BTreeMap<(u32, usize), Air>,
    /// The cycles before which HORUS restarts. At each restart HORUS's timestamps begin anew, and its ticks move.
    pub(crate) horus_starts: Vec<u32>,
    /// The cycles that have the same timestamp as the cycle before.
    pub(crate) frozen: Vec<u32>,
    /// The length of HORUS's cycle, ns.
    pub(crate) period: u64,
    /// The restart of the DPR: its instant (ns), its cause, and the reason that the DPR states.
    pub(crate) dpr_start: Option<(u64, crate::Cause, ResetReason)>,
    pub(crate) extra: Vec<Event>,
    /// The length of the flight controller's control cycle, ns.
    pub(crate) control: u64,
    /// The number of bytes that each transaction reads.
    pub(crate) length: usize,
    /// The instant, ns, at which the only transaction begins; `None` if there is one in each control cycle.
    pub(crate) only: Option<u64>,
    pub(crate) clock: &'static str,
}

impl Run {
    pub(crate) fn new(n: usize) -> Self {
        Self {
            n,
            cycles: 40,
            hits: BTreeMap::new(),
            horus_starts: vec![],
            frozen: vec![],
            period: 10 * MS,
            dpr_start: None,
            extra: vec![],
            control: 2 * MS,
            length: Layout::for_receivers(n).unwrap().image_len(),
            only: None,
            clock: "fast",
        }
    }

    pub(crate) fn hit(mut self, cycle: u32, frame: usize, air: Air) -> Self {
        self.hits.insert((cycle, frame), air);
        self
    }

    /// Applies an effect of the air to all frames of these cycles.
    pub(crate) fn hit_all(mut self, cycles: impl IntoIterator<Item = u32>, air: &Air) -> Self {
        for cycle in cycles {
            for frame in 0..air::frames(self.n) {
                self.hits.insert((cycle, frame), air.clone());
            }
        }
        self
    }

    pub(crate) fn layout(&self) -> Layout {
        Layout::for_receivers(self.n).unwrap()
    }

    pub(crate) fn tick(&self, cycle: u32) -> u64 {
        let starts = self.horus_starts.iter().filter(|start| **start <= cycle).count() as u64;
        20 * MS + u64::from(cycle) * self.period + starts * 63_700 * US
    }

    /// Returns the instant, ns, at which HORUS's last frame of the cycle ends.
    pub(crate) fn end(&self, cycle: u32) -> u64 {
        self.tick(cycle) + age_at_end(self.layout(), air::frames(self.n) - 1) + 3 * US
    }

    pub(crate) fn timestamp(&self, cycle: u32) -> u32 {
        let start = self.horus_starts.iter().filter(|start| **start <= cycle).max().copied().unwrap_or(1);
        let frozen = self.frozen.iter().filter(|frozen| (start..=cycle).contains(frozen)).count() as u32;
        10 * (cycle + 1 - start - frozen)
    }

    pub(crate) fn profile(&self, cycle: u32) -> Vec<u8> {
        let timestamp = self.timestamp(cycle);
        let start = self.horus_starts.iter().filter(|start| **start <= cycle).count();
        let reported = ReportedValues {
            status: ReportedStatus::new().with_position_valid(true),
            latitude: start as f64,
            ..ReportedValues::absent(timestamp)
        };
        let gps = GpsValues { latitude: start as f64, ..GpsValues::absent(timestamp) };
        match self.n {
            1 => Profile::<1>::seal(&reported, &[gps; 1]).as_bytes().to_vec(),
            3 => Profile::<3>::seal(&reported, &[gps; 3]).as_bytes().to_vec(),
            _ => Profile::<5>::seal(&reported, &[gps; 5]).as_bytes().to_vec(),
        }
    }

    fn frames(&self, events: &mut Vec<Event>) -> Vec<(u64, Vec<u8>, bool)> {
        let mut heard = vec![];
        for cycle in 1..=self.cycles {
            let tick = self.tick(cycle);
            events.push(Event { at: tick, what: What::Tick });
            if self.horus_starts.contains(&cycle) {
                let what = What::Reset { board: Board::Horus, cause: crate::Cause::Pin, asked: true };
                events.push(Event { at: tick - 50 * MS, what });
            }
            let profile = self.profile(cycle);
            for number in 0..air::frames(self.n) {
                let place = self.layout().frame(number).unwrap();
                let payload = &profile[place.offset()..place.offset() + place.length()];
                let ended = tick + age_at_end(self.layout(), number) + 3 * US;
                let took = air::air_time_ns(payload.len() as u8);
                let frame = |payload: &[u8]| [&[payload.len() as u8 + 1], payload, &[0, 0]].concat();
                let sent =
                    What::Sent { started: ended - took, bit_rate: 424_000, bytes: frame(payload).into(), whole: true };
                events.push(Event { at: ended, what: sent });
                let mut hear = |at: u64, payload: &[u8], whole: bool| {
                    let started = at - air::air_time_ns(payload.len() as u8);
                    let bytes = frame(payload);
                    heard.push((at, payload.to_vec(), whole));
                    events.push(Event { at, what: What::Heard { started, bytes: bytes.into(), whole } });
                };
                match self.hits.get(&(cycle, number)) {
                    None => hear(ended, payload, true),
                    Some(Air::Lost) => {}
                    Some(Air::Delayed(by)) => hear(ended + by, payload, true),
                    Some(Air::Repeated(by)) => {
                        hear(ended, payload, true);
                        hear(ended + by, payload, true);
                    }
                    Some(Air::Cut) => hear(ended - took / 2, &payload[..payload.len() / 2], false),
                    Some(Air::Hit(objects)) => {
                        let mut hit = payload.to_vec();
                        for index in
                            objects.iter().filter(|it| (place.first()..place.first() + place.count()).contains(it))
                        {
                            hit[self.layout().in_profile(*index).unwrap().start - place.offset() + 20] ^= 0x10;
                        }
                        hear(ended, &hit, true);
                    }
                }
            }
        }
        heard.sort_by_key(|(at, ..)| *at);
        heard
    }

    /// Returns the run's log. `edit` changes the images that the DPR published.
    pub(crate) fn log(&self, edit: impl Fn(&mut Vec<Image>)) -> Log {
        self.edited(&edit)
    }

    // This function is not generic, so that it is compiled once and not for each closure.
    fn edited(&self, edit: &dyn Fn(&mut Vec<Image>)) -> Log {
        let mut events = self.extra.clone();
        events.push(Event { at: 2 * MS, what: What::FieldHeard { on: true } });
        let heard = self.frames(&mut events);
        let end = self.tick(self.cycles + 1) + 300 * MS;
        let mut images = vec![];
        let restart = self.dpr_start.map_or(u64::MAX, |(at, ..)| at);
        Dpr::new(self.layout(), 0, ResetReason::PowerOn).run(&heard, restart.min(end), &mut images);
        if let Some((at, cause, reason)) = self.dpr_start {
            images.iter_mut().for_each(|image| image.expires = image.expires.min(at - 1));
            let what = What::Reset { board: Board::Dpr, cause, asked: true };
            events.push(Event { at, what });
            Dpr::new(self.layout(), at, reason).run(&heard, end, &mut images);
        }
        edit(&mut images);
        for image in &images {
            events.push(Event { at: image.at, what: What::Fresh { high: true, offered: None } });
            events.push(Event { at: image.at + 20 * US, what: What::Fresh { high: false, offered: None } });
        }
        let cycles = (8 * MS..end - MS).step_by(self.control as usize);
        for selected in cycles.filter(|_| self.only.is_none()).chain(self.only) {
            let image = images.iter().rev().find(|image| image.at <= selected);
            let image = image.filter(|image| selected <= image.expires);
            let image = image.map(|it| [LinkStatus::seal(&it.link).as_bytes(), it.places.concat().as_slice()].concat());
            let mut miso = image.unwrap_or_else(|| vec![0xFF; self.layout().image_len()]);
            miso.truncate(self.length);
            let what = What::Transaction { selected, mosi: vec![0; miso.len()].into(), miso: miso.into() };
            events.push(Event { at: selected, what: What::Selected });
            events.push(Event { at: selected + 300 * US, what });
            events.push(Event { at: selected + 304 * US, what: What::Ssi(SsiEvent::Ready) });
        }
        events.push(Event { at: end, what: What::End });
        in_order(&mut events);
        let header = Header { version: Header::VERSION, gps: self.n, seed: 1, clock: self.clock.into(), hold: false };
        Log { header, events }
    }

    pub(crate) fn verdict(&self, edit: impl Fn(&mut Vec<Image>)) -> Verdict {
        judge(&self.log(edit))
    }

    pub(crate) fn broken(&self, edit: impl Fn(&mut Vec<Image>)) -> Vec<Violation> {
        kinds(&self.verdict(edit))
    }

    pub(crate) fn assert_flawless(&self) -> Verdict {
        let verdict = self.verdict(|_| {});
        let words: Vec<String> =
            verdict.violations.iter().filter(|it| OWN.contains(&it.violation)).map(ToString::to_string).collect();
        assert_eq!(words, [""; 0], "{} receivers, {:?}", self.n, self.hits);
        verdict
    }
}

const OWN: [Violation; 13] = [
    Violation::Vacant,
    Violation::NotShown,
    Violation::ShownNeverSent,
    Violation::ShownOutOfSequence,
    Violation::ShownStale,
    Violation::ShownExpired,
    Violation::Regression,
    Violation::LinkAge,
    Violation::LinkAgeOver,
    Violation::LinkCounters,
    Violation::LinkFlags,
    Violation::LinkFlagsOver,
    Violation::LinkTime,
];

/// Returns the violations of the rules `shown` and `link_status`. The log lacks events that the other rules need.
pub(crate) fn kinds(verdict: &Verdict) -> Vec<Violation> {
    verdict.kinds().filter(|kind| OWN.contains(kind)).collect()
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Due {
    Any,
    Second,
    First,
    Cycle,
}

/// A model of the DPR that follows the design. Its clock counts µs from its start.
#[derive(Clone, Debug)]
struct Dpr {
    layout: Layout,
    since: u64,
    reason: ResetReason,
    sequence: Sequence,
    /// The sequence that the last published image stated.
    told: Sequence,
    /// The frames of the current cycle that have arrived, as bits.
    seen: u8,
    in_sequence: bool,
    frozen: bool,
    restarted: Option<u64>,
    reported: Option<u64>,
    counts: [u32; 4],
    /// The last frame that arrived: the instant of its sample, ns, and its number in the cycle.
    last: Option<(u64, usize)>,
    counted: u32,
    due: Due,
    deadline: u64,
    open: Option<u64>,
    places: Vec<Vec<u8>>,
}

impl Dpr {
    fn new(layout: Layout, since: u64, reason: ResetReason) -> Self {
        Self {
            layout,
            since,
            reason,
            sequence: Sequence::new(),
            told: Sequence::new(),
            seen: 0,
            in_sequence: false,
            frozen: false,
            restarted: None,
            reported: None,
            counts: [0; 4],
            last: None,
            counted: 0,
            due: Due::Any,
            deadline: since + 5 * MS,
            open: None,
            places: Self::empty(layout),
        }
    }

    fn empty(layout: Layout) -> Vec<Vec<u8>> {
        (0..layout.objects()).map(|index| vec![0; layout.in_image(index).unwrap().len()]).collect()
    }

    fn us(&self, at: u64) -> u64 {
        (at - self.since) / US
    }

    /// Runs the DPR until `end` with these frames at its antenna. The DPR receives none in the 30 ms of its start.
    fn run(mut self, heard: &[(u64, Vec<u8>, bool)], end: u64, images: &mut Vec<Image>) {
        let listens = self.since + 30 * MS..end;
        for (at, payload, _) in heard.iter().filter(|(at, ..)| listens.contains(at)) {
            while self.deadline <= *at {
                self.lapse(images);
            }
            self.frame(*at, payload, images);
        }
        while self.deadline < end {
            self.lapse(images);
        }
    }

    fn lapse(&mut self, images: &mut Vec<Image>) {
        let at = self.deadline;
        let frames = self.layout.frames() as u32;
        let (missed, silent, due, next) = match self.due {
            Due::Any => (0, true, Due::Any, 10 * MS),
            Due::Second => (1, false, Due::First, 5_500 * US),
            Due::First => (1, true, Due::Cycle, 10 * MS),
            Due::Cycle => (frames, true, Due::Cycle, 10 * MS),
        };
        self.counts[3] += missed;
        self.counted += missed;
        self.due = due;
        self.deadline += next;
        if silent {
            self.places = Self::empty(self.layout);
        }
        self.publish(at + 20 * US, at + 50 * US, images);
    }

    fn frame(&mut self, at: u64, payload: &[u8], images: &mut Vec<Image>) {
        let Ok(objects) = self.layout.objects_of(payload) else { return };
        let timestamp = |index, bytes| Some(Object::verify(index, bytes).ok()?.timestamp());
        let objects: Vec<(usize, &[u8], Option<u32>)> =
            objects.map(|(index, bytes)| (index, bytes, timestamp(index, bytes))).collect();
        let number = usize::from(objects[0].0 > 0);
        let sampled = self.us(at) - age_at_end(self.layout, number) / US;
        let timestamp = objects.iter().find_map(|(.., timestamp)| *timestamp);
        let frames = self.layout.frames();
        if let Some((last, before)) = self.last {
            let apart = sampled.saturating_sub(last) + 5_000;
            let slots = apart / 10_000 * frames as u64 + number as u64;
            self.counts[3] += slots.saturating_sub(before as u64 + 1).saturating_sub(self.counted.into()) as u32;
        }
        self.last = Some((sampled, number));
        self.counted = 0;
        let complete = number + 1 == frames;
        self.due = if complete { Due::Cycle } else { Due::Second };
        self.deadline = at + if complete { 12_500 * US } else { 7_000 * US };
        let same_sample = |one: u64| one.abs_diff(sampled) <= 2_500;
        let mut next = false;
        let mut judged = None;
        if let Some(timestamp) = timestamp {
            let last = self.sequence.last();
            let same = last.is_some_and(|last| last.timestamp == timestamp && same_sample(last.sampled_us));
            if same && self.seen & 1 << number == 0 {
                self.seen |= 1 << number;
            } else {
                judged = Some(self.sequence.judge(timestamp, sampled));
                self.seen = 1 << number;
                next = true;
            }
        }
        let shown = self.places.iter().any(|place| place.iter().any(|byte| *byte != 0));
        if let Some(open) = self.open
            && (number == 0 || !same_sample(open) || next && shown)
        {
            self.publish(at + 40 * US, at + 45 * US, images);
        }
        self.told = self.sequence;
        if let Some(judgement) = judged {
            self.in_sequence = judgement.is_in_sequence();
            self.frozen = judgement == Judgement::Frozen;
            if judgement == Judgement::Restarted {
                self.restarted = Some(self.us(at) + 40);
            }
        }
        self.counts[2] += 1;
        for (index, bytes, own) in objects {
            let accepted = self.in_sequence && own.is_some() && own == timestamp;
            self.counts[usize::from(!accepted)] += 1;
            if accepted {
                self.places[index] = bytes.to_vec();
                if index == 0 {
                    self.reported = Some(sampled);
                }
            }
        }
        if complete {
            self.publish(at + 40 * US, at + 70 * US, images);
        } else {
            self.open = Some(sampled);
        }
    }

    fn publish(&mut self, sealed: u64, at: u64, images: &mut Vec<Image>) {
        let now = self.us(sealed);
        let held = self.told.is_held(now);
        let valid = |(index, bytes): (usize, &Vec<u8>)| Object::verify(index, bytes).is_ok();
        let shown = self.places.iter().enumerate().filter(|(index, bytes)| valid((*index, bytes))).count();
        let age = self.reported.map_or(u32::MAX, |reported| (now - reported) as u32);
        let [objects_accepted, objects_rejected, frames_received, frames_missed] = self.counts;
        let link = LinkValues {
            timestamp: (now / 1000) as u32,
            status: LinkStatusBits::new()
                .with_link_up(shown > 0)
                .with_all_accepted(shown == self.layout.objects())
                .with_horus_frozen(self.frozen)
                .with_horus_restarted(self.restarted.is_some_and(|at| now - at < 1_000_000))
                .with_out_of_sequence(!held)
                .with_horus_clock_implausible(held && self.told.is_clock_implausible())
                .with_reset_reason(self.reason),
            objects_accepted,
            objects_rejected,
            frames_received,
            frames_missed,
            age_100us: LinkValues::age(age),
            access_violations: 0,
        };
        let places = std::mem::replace(&mut self.places, Self::empty(self.layout));
        images.push(Image { at, link, places, expires: at + 25 * MS });
        self.open = None;
    }
}
