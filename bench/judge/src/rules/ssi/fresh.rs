//! Judges whether each rise of FRESH is justified, and whether each image that is read was announced.
//!
//! # What FRESH announces
//!
//! After a rise of FRESH, a transaction reads the new image, or 0xFF throughout while the DPR is putting the image in.
//! It never reads an older image (docs/design.md#publication, `dpr_fw::publish`). There are two cases:
//!
//! - Without a transaction under way, FRESH rises before the processor gives the SSI's buffers back. So no image is
//!   readable before FRESH has announced it.
//! - With a transaction under way, FRESH rises at once, although this transaction still reads the previous image.
//!
//! At a rise of FRESH the log may not yet have the bytes of the announced image. The judge takes them from what could
//! be read when FRESH falls, or from the first transaction that begins after the rise. FRESH rises for each
//! publication, also for an image without objects after a missed frame.
//!
//! An image must have been announced before the transaction that reads it began.

use std::collections::VecDeque;

use profile::LinkValues;

use super::latency::Cycles;
use crate::disturbance::{Disturbances, Excuse};
use crate::read::{Reading, State};
use crate::rules::is_later;
use crate::{Findings, Violation};

/// The number of rises of FRESH that are kept: more than usually come within one transaction.
const REMEMBERED: usize = 64;

/// The features by which the judge tells an image from other images.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mark {
    link: Option<LinkValues>,
    /// The timestamp of the objects in the image, ms.
    stamp: Option<u32>,
}

impl Mark {
    /// Returns the features of the image that a transaction read; `None` if too little of it was read.
    fn of(reading: &Reading) -> Option<Self> {
        let mark = Self { link: reading.link.and_then(Result::ok), stamp: reading.timestamp() };
        (mark != Self { link: None, stamp: None }).then_some(mark)
    }

    /// Returns whether this image was made after the image `before`, which follows from the times, the counters and the
    /// ages of the samples. The order of two images with different status is uncertain, because they may follow each
    /// other within a millisecond.
    fn is_newer_than(&self, before: &Self) -> bool {
        let Some((now, then)) = self.link.zip(before.link) else { return self.stamp != before.stamp };
        let counters = |link: LinkValues| {
            let LinkValues { timestamp, frames_received, frames_missed, .. } = link;
            let LinkValues { objects_accepted, objects_rejected, access_violations, .. } = link;
            let violations = u32::from(access_violations);
            [timestamp, frames_received, frames_missed, objects_accepted, objects_rejected, violations]
        };
        let stamps = self.stamp.zip(before.stamp);
        let withdraws = self.stamp.is_none();
        let alike = counters(now) == counters(then) && (self.stamp == before.stamp || withdraws);
        alike && (now.status != then.status || now.age_100us > then.age_100us)
            || stamps.is_some_and(|(now, then)| is_later(now, then))
            || counters(now).into_iter().zip(counters(then)).any(|(now, then)| is_later(now, then))
    }

    /// Returns whether both sets of features may be those of one image; `None` if not known.
    fn is_of(&self, other: &Self) -> Option<bool> {
        let stamps = self.stamp.zip(other.stamp).map(|(a, b)| a == b);
        let times = self.link.zip(other.link).map(|(a, b)| a.timestamp == b.timestamp);
        match (stamps, times) {
            (Some(stamps), Some(times)) => Some(stamps && times),
            (known, None) | (None, known) => known,
        }
    }

    /// Returns whether both sets of features certainly are those of one image. Without Link-Status this is not certain,
    /// because timestamps recur.
    fn is_the_same_as(&self, other: &Self) -> bool {
        let links = self.link.zip(other.link).is_some_and(|(a, b)| a == b);
        self.is_of(other) == Some(true) && links
    }
}

#[derive(Clone, Copy, Debug)]
struct Claim {
    rose: u64,
    /// The features of the announced image; `None` while not known.
    mark: Option<Mark>,
    /// Whether this rise of FRESH was reported as unjustified.
    told: bool,
    /// Whether an unannounced image has been read since this rise of FRESH, and reported.
    unannounced: bool,
}

impl Claim {
    fn new(rose: u64) -> Self {
        Self { rose, mark: None, told: false, unannounced: false }
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Claims {
    claims: VecDeque<Claim>,
    /// The bytes that FRESH announced last, if they are an unsound image; empty if not.
    condemned: Vec<u8>,
    /// The newest timestamp that a transaction has read, ms.
    newest: Option<u32>,
}

impl Claims {
    /// Records a rise of FRESH. `excused` states whether the DPR had a reason to refuse transactions.
    pub(super) fn rise(
        &mut self,
        rose: u64,
        offered: Option<&Reading>,
        excused: bool,
        cycles: &mut Cycles,
        disturbances: &Disturbances,
        findings: &mut Findings,
    ) {
        if self.claims.len() == REMEMBERED {
            self.claims.pop_front();
        }
        self.condemned.clear();
        self.claims.push_back(Claim::new(rose));
        match offered {
            Some(offered) => self.offer(offered, cycles, disturbances, findings),
            None if excused => {}
            None => findings.add(Violation::FreshUnreadable, rose, || {
                "a transaction would have met the DPR busy, for no reason".into()
            }),
        }
    }

    pub(super) fn fall(
        &mut self,
        offered: Option<&Reading>,
        cycles: &mut Cycles,
        disturbances: &Disturbances,
        findings: &mut Findings,
    ) {
        let open = self.claims.back().is_some_and(|claim| claim.mark.is_none()) && self.condemned.is_empty();
        if let Some(offered) = offered.filter(|_| open) {
            self.offer(offered, cycles, disturbances, findings);
        }
    }

    /// Judges the image `offered`, which a transaction would read after the last rise of FRESH.
    fn offer(&mut self, offered: &Reading, cycles: &mut Cycles, disturbances: &Disturbances, findings: &mut Findings) {
        let Some((claim, before)) = self.claims.make_contiguous().split_last_mut() else { return };
        let unsound = offered.objects.iter().any(|object| matches!(object.state, State::Unsound(_)));
        if offered.silent || unsound || matches!(offered.link, Some(Err(_))) {
            self.condemned.clone_from(&offered.miso);
            findings.add(Violation::FreshUnreadable, claim.rose, || "what was offered is unsound".into());
            return;
        }
        claim.mark = Mark::of(offered);
        let Some(mark) = claim.mark else { return };
        // A transaction may have read the image before a late rise of FRESH announced it.
        let previous = before.last().filter(|before| !before.unannounced).and_then(|before| before.mark);
        let replaces = |previous| disturbances.excuse(Excuse::UnsoundImage, claim.rose) && mark == previous;
        if previous.is_some_and(|previous| !mark.is_newer_than(&previous) && !replaces(previous)) {
            claim.told = true;
            findings.add(Violation::FreshNotNew, claim.rose, || "the image of before was offered".into());
        } else if let Some(stamp) = mark.stamp {
            cycles.readable(stamp, claim.rose, findings);
        }
    }

    pub(super) fn has_condemned(&self, miso: &[u8]) -> bool {
        !miso.is_empty() && self.condemned.starts_with(miso)
    }

    /// Returns whether Link-Status and the objects belong to two different announced images.
    pub(super) fn is_spliced(&self, reading: &Reading) -> bool {
        let Some(Mark { link: Some(link), stamp: Some(stamp) }) = Mark::of(reading) else { return false };
        let marks = || self.claims.iter().filter_map(|claim| claim.mark);
        let with_objects = || marks().filter(|mark| mark.stamp == Some(stamp)).filter_map(|mark| mark.link);
        with_objects().next().is_some()
            && with_objects().all(|other| other != link)
            && marks().any(|mark| mark.stamp != Some(stamp) && mark.link == Some(link))
    }

    pub(super) fn transaction(
        &mut self,
        reading: &Reading,
        cycles: &mut Cycles,
        disturbances: &Disturbances,
        findings: &mut Findings,
    ) {
        let Some(mark) = Mark::of(reading) else { return };
        let selected = reading.selected;
        // If a transaction reads objects that are older than objects read earlier, another rule reports it.
        let regressed = self.newest.zip(mark.stamp).is_some_and(|(newest, stamp)| is_later(newest, stamp));
        let announced = self.claims.partition_point(|claim| claim.rose <= selected);
        if announced == 0 && self.claims.len() == REMEMBERED {
            // The transaction was so long that the record no longer has the rises of FRESH before it.
            return;
        }
        let older = |claim: &Claim| claim.mark.is_some_and(|older| older.is_the_same_as(&mark));
        let mut before = self.claims.range(..announced.saturating_sub(1)).rev();
        let is_last = before.next().is_some_and(older);
        let stale = is_last || before.any(older);
        let Some(claim) = announced.checked_sub(1).and_then(|last| self.claims.get_mut(last)) else {
            missing(selected, mark, cycles, findings);
            self.claims.push_front(Claim { mark: Some(mark), unannounced: true, ..Claim::new(selected) });
            self.newest = mark.stamp.or(self.newest);
            return;
        };
        let replaces = is_last && claim.mark.is_none() && disturbances.excuse(Excuse::UnsoundImage, claim.rose);
        match claim.mark {
            Some(expected) if expected.is_of(&mark) != Some(false) => {}
            _ if stale && !replaces => {
                if !regressed && !std::mem::replace(&mut claim.told, true) {
                    findings.add(Violation::FreshNotNew, claim.rose, || {
                        format!("an older image was read at {selected} ns")
                    });
                }
                return;
            }
            None => {
                claim.mark = Some(mark);
                if let Some(stamp) = mark.stamp {
                    cycles.readable(stamp, claim.rose, findings);
                }
            }
            Some(_) => {
                // The unannounced image counts as announced from now on, so that it is reported only once.
                (claim.mark, claim.unannounced) = (Some(mark), true);
                if regressed {
                    return;
                }
                missing(selected, mark, cycles, findings);
            }
        }
        self.newest = mark.stamp.or(self.newest);
    }
}

/// Reports an image that was read and that FRESH had not announced.
fn missing(selected: u64, mark: Mark, cycles: &mut Cycles, findings: &mut Findings) {
    if !mark.stamp.is_some_and(|stamp| cycles.unannounced(stamp)) {
        findings.add(Violation::FreshMissing, selected, || "FRESH had not announced it".into());
    }
}

#[cfg(test)]
mod tests {
    use profile::LinkStatusBits;

    use super::*;

    #[test]
    fn an_image_without_objects_is_newer_than_the_one_it_withdraws() {
        let status = LinkStatusBits::new().with_link_up(true);
        let link = LinkValues { timestamp: 772, status, age_100us: 49, ..LinkValues::default() };
        let shown = Mark { link: Some(link), stamp: Some(770) };
        let without = |link| Mark { link: Some(link), stamp: None };
        assert!(without(LinkValues { age_100us: 51, ..link }).is_newer_than(&shown));
        assert!(without(LinkValues { status: LinkStatusBits::new(), ..link }).is_newer_than(&shown));
        assert!(!without(link).is_newer_than(&shown), "nothing tells that it was made later");
        assert!(!without(LinkValues { age_100us: 48, ..link }).is_newer_than(&shown));
        assert!(!shown.is_newer_than(&without(LinkValues { age_100us: 48, ..link })), "objects do not come back");
        let other = Mark { stamp: Some(760), ..without(LinkValues { age_100us: 51, ..link }) };
        assert!(!other.is_newer_than(&shown), "nor do those of an older cycle");
    }

    #[test]
    fn an_image_that_counts_more_access_violations_is_newer() {
        let of = |access_violations| Mark {
            link: Some(LinkValues { timestamp: 12, access_violations, ..LinkValues::default() }),
            stamp: None,
        };
        assert!(of(1).is_newer_than(&of(0)));
        assert!(!of(0).is_newer_than(&of(1)));
    }

    #[test]
    fn a_timestamp_alone_does_not_identify_an_image_across_a_restart() {
        let link = LinkValues { timestamp: 1342, ..LinkValues::default() };
        let whole = Mark { link: Some(link), stamp: Some(90) };
        let objects = Mark { link: None, ..whole };
        let later = Mark { link: Some(LinkValues { frames_received: 1, ..link }), ..whole };
        for (one, other, same) in
            [(whole, whole, true), (whole, later, false), (whole, objects, false), (objects, objects, false)]
        {
            assert_eq!(one.is_the_same_as(&other), same, "{one:?} {other:?}");
        }
        // Two sets of features may belong to one image unless their times or their timestamps differ.
        let times = Mark { link: Some(link), stamp: None };
        let again = Mark { link: Some(LinkValues { timestamp: 1343, ..link }), ..whole };
        let next = Mark { stamp: Some(100), ..whole };
        for (other, of) in [
            (whole, Some(true)),
            (later, Some(true)),
            (objects, Some(true)),
            (times, Some(true)),
            (again, Some(false)),
            (next, Some(false)),
            (Mark { link: None, ..next }, Some(false)),
            (Mark { stamp: None, ..again }, Some(false)),
        ] {
            assert_eq!(whole.is_of(&other), of, "{other:?}");
        }
        assert_eq!(objects.is_of(&times), None, "nothing is known of both");
    }
}
