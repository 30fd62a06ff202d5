//! Compares the objects that the base station shows with those that the flight controller forwarded.
//!
//! When a transaction reads a profile complete and intact, the flight controller has to forward this profile at once,
//! unless it has already forwarded that cycle. While [`Excuse::Service`] holds, it need not forward profiles.
//!
//! # One cause, one violation
//!
//! - If bytes change on the way to the base station, only [`Violation::BaseChanged`] is reported, and not also a
//!   missing profile.
//! - If the base station shows objects of several cycles as one profile, only [`Violation::BaseMixed`] is reported. If
//!   the flight controller already read this mixture from the DPR, another rule reports that transaction.
//! - In a profile that mixes cycles, the base station may leave objects out, and none is reported as missing.

use std::collections::VecDeque;

use profile::{Layout, Object};

use super::Rule;
use crate::disturbance::Excuse;
use crate::{Context, Event, Figures, Findings, Header, Violation, What, bounds};

/// The number of profiles that are kept between flight controller and base station. Each is forwarded at once, so a few
/// are enough.
const READ: usize = 4;

/// The rule that compares what the base station shows with what was forwarded; see the [module](self).
#[derive(Clone, Debug)]
pub struct Base {
    read: VecDeque<Vec<u8>>,
    /// The profiles on their way, each with the instant, ns, at which it was forwarded.
    outstanding: VecDeque<(u64, Vec<u8>)>,
    /// The instants, ns, of the arrivals of profiles that the flight controller had not forwarded.
    strange: VecDeque<u64>,
    /// The instant, ns, and the timestamp, ms, of the profile that has to be forwarded at once.
    owed: Option<(u64, u32)>,
    /// The timestamp of the profile that was forwarded last, ms.
    forwarded: Option<u32>,
}

impl Rule for Base {
    fn new(_header: &Header) -> Self {
        Self {
            read: VecDeque::new(),
            outstanding: VecDeque::new(),
            strange: VecDeque::new(),
            owed: None,
            forwarded: None,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        self.expire(at.checked_sub(bounds::DOWNLINK), findings);
        self.owes(at, findings);
        match &event.what {
            What::Transaction { .. } => {
                let Some(reading) = context.reading().filter(|reading| !reading.silent) else { return };
                let layout = context.layout();
                let start = (layout.image_len() - layout.profile_len()).checked_sub(reading.offset);
                let profile = start.and_then(|start| reading.miso.get(start..start + layout.profile_len()));
                if let Some(profile) = profile {
                    let excused = context.disturbances().excuse(Excuse::Service, reading.selected);
                    let link = matches!(reading.link, Some(Ok(_)));
                    let new = reading.timestamp().filter(|now| link && !excused && self.forwarded != Some(*now));
                    self.owed = new.filter(|_| reading.is_sound()).map(|now| (at, now));
                    let mut kept = match self.read.len() {
                        READ => self.read.pop_front().unwrap_or_default(),
                        _ => vec![],
                    };
                    kept.clear();
                    kept.extend_from_slice(profile);
                    self.read.push_back(kept);
                }
            }
            What::Forwarded { profile } => {
                if !self.read.iter().any(|read| **read == **profile) {
                    findings
                        .add(Violation::BaseChanged, at, || "what was forwarded is not what a transaction read".into());
                }
                self.owed = None;
                self.forwarded = timestamp(context.layout(), profile);
                self.outstanding.push_back((at, profile.to_vec()));
            }
            What::Arrived { profile, shown } => self.arrived(at, profile, *shown, context.layout(), findings),
            _ => {}
        }
    }

    fn finish(&mut self, context: &Context, findings: &mut Findings, _figures: &mut Figures) {
        self.expire(Some(context.now() + 1), findings);
        self.owes(context.now() + 1, findings);
    }
}

impl Base {
    fn owes(&mut self, now: u64, findings: &mut Findings) {
        if let Some((at, timestamp)) = self.owed.take_if(|(at, _)| *at < now) {
            self.forwarded = Some(timestamp);
            findings.add(Violation::NotForwarded, at, || format!("that of {timestamp} ms"));
        }
    }

    fn arrived(&mut self, at: u64, profile: &[u8], shown: u8, layout: Layout, findings: &mut Findings) {
        let mut valid = 0_u8;
        let mut stamps = [None; 8];
        for (index, stamp) in stamps.iter_mut().enumerate().take(layout.objects()) {
            let bytes = layout.in_profile(index).and_then(|place| profile.get(place)).unwrap_or_default();
            *stamp = Object::verify(index, bytes).ok().map(Object::timestamp);
            valid |= u8::from(stamp.is_some()) << index;
        }
        let mixes = |of: u8| {
            let mut of = stamps.iter().enumerate().filter(|(index, _)| of >> index & 1 == 1).filter_map(|(_, at)| *at);
            of.next().is_some_and(|first| of.any(|other| other != first))
        };
        match self.outstanding.iter().position(|(_, forwarded)| **forwarded == *profile) {
            Some(arrived) => {
                self.outstanding.remove(arrived);
            }
            None => {
                self.strange.push_back(at);
                let (violation, words) = match mixes(shown) {
                    true => (Violation::BaseMixed, "and it was not forwarded so"),
                    false => (Violation::BaseChanged, "it arrived, and was not forwarded"),
                };
                findings.add(violation, at, || words.into());
            }
        }
        let (invalid, hidden) = (shown & !valid, valid & !shown);
        if invalid != 0 {
            findings.add(Violation::BaseInvalid, at, || format!("object {}", invalid.trailing_zeros()));
        }
        if hidden != 0 && !mixes(valid) {
            findings.add(Violation::BaseHidden, at, || format!("object {}", hidden.trailing_zeros()));
        }
    }

    /// Reports each profile that was forwarded before `until` and has not arrived, not even with changed bytes.
    fn expire(&mut self, until: Option<u64>, findings: &mut Findings) {
        let Some(until) = until else { return };
        while let Some((at, _)) = self.outstanding.pop_front_if(|(at, _)| *at < until) {
            while self.strange.pop_front_if(|strange| *strange < at).is_some() {}
            if self.strange.pop_front().is_none() {
                findings.add(Violation::BaseMissed, at, || "it did not arrive".into());
            }
        }
        while self.strange.pop_front_if(|strange| *strange < until).is_some() {}
    }
}

fn timestamp(layout: Layout, profile: &[u8]) -> Option<u32> {
    let stamp = |index| {
        let bytes = layout.in_profile(index).and_then(|place| profile.get(place))?;
        Object::verify(index, bytes).ok().map(Object::timestamp)
    };
    (0..layout.objects()).find_map(stamp)
}
