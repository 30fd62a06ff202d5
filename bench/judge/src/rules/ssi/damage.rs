//! What a place holds that is neither an intact object nor vacant.
//!
//! A transaction that ran into a change of its image brought bytes of several: each byte of the place is then one that
//! HORUS sent there in some cycle, or what a scrub fills with, and no single cycle explains all of them. A place that
//! differs from what was sent by one bit is taken for damaged, although another cycle may have that byte, too.

use std::collections::VecDeque;

use profile::{Layout, LinkStatus, Object, Rejection};

use super::latency::Cycles;
use crate::read::{Placed, Reading, State};
use crate::{Findings, Violation};

/// Link-Statuses that are kept: more than there are images in the DPR.
const REMEMBERED: usize = 16;

/// What a scrub fills with.
const FILLS: [u8; 2] = [0x00, 0xFF];

/// See the [module](self).
#[derive(Clone, Debug, Default)]
pub(super) struct Damage {
    links: VecDeque<[u8; LinkStatus::SIZE]>,
}

impl Damage {
    /// Keeps the Link-Status of what was read or offered, if it is intact.
    pub(super) fn remember(&mut self, reading: &Reading) {
        // Link-Status stands at the image's start.
        let Some((Some(Ok(_)), link)) = Some(reading.link).zip(reading.miso.first_chunk()) else { return };
        if self.links.contains(link) {
            return;
        }
        if self.links.len() == REMEMBERED {
            self.links.pop_front();
        }
        self.links.push_back(*link);
    }

    /// Whether anything is wrong with what was read, and notes it; `spliced` if Link-Status and the objects are of two
    /// images.
    pub(super) fn find(
        &self,
        reading: &Reading,
        spliced: bool,
        cycles: &Cycles,
        layout: Layout,
        findings: &mut Findings,
    ) -> bool {
        let at = reading.selected;
        let unsound = || {
            reading.objects.iter().filter_map(|object| match object.state {
                State::Unsound(rejection) => Some((object, rejection)),
                _ => None,
            })
        };
        let link = reading.link.and_then(Result::err).zip(reading.miso.get(..LinkStatus::SIZE));
        let mixed =
            reading.objects.iter().filter_map(Placed::timestamp).any(|stamp| Some(stamp) != reading.timestamp());
        let torn = mixed
            || spliced
            || unsound().any(|(object, _)| is_torn(&object.bytes, cycles.objects(layout, object.index)))
            || link.is_some_and(|(_, bytes)| is_torn(bytes, self.links.iter().map(<[u8; _]>::as_slice)));
        if torn {
            findings.add(Violation::Torn, at, || "what was read is of several images".into());
            return true;
        }
        let misplaced = unsound().find(|(object, rejection)| is_misplaced(object, *rejection, reading, layout));
        if let Some((object, _)) = misplaced {
            findings.add(Violation::Misplaced, at, || format!("in the place of object {}", object.index));
            return true;
        }
        if let Some((Rejection::Identifier, _)) = link {
            findings.add(Violation::Misplaced, at, || "in the place of Link-Status".into());
            return true;
        }
        if let Some((rejection, _)) = link {
            findings.add(Violation::Damaged, at, || format!("Link-Status: {rejection}"));
            return true;
        }
        let Some((object, rejection)) = unsound().next() else { return false };
        findings.add(Violation::Damaged, at, || format!("object {}: {rejection}", object.index));
        true
    }
}

/// Whether `bytes` are put together of several of `sources` and what a scrub fills with.
fn is_torn<'a>(bytes: &[u8], sources: impl Iterator<Item = &'a [u8]> + Clone) -> bool {
    let differing = |source: &[u8]| -> u32 { bytes.iter().zip(source).map(|(a, b)| (a ^ b).count_ones()).sum() };
    let explained =
        |(at, byte): (usize, &u8)| FILLS.contains(byte) || sources.clone().any(|source| source.get(at) == Some(byte));
    bytes.iter().enumerate().all(explained) && sources.clone().all(|source| differing(source) > 1)
}

/// Whether an intact object of another place stands in that of `object`.
fn is_misplaced(object: &Placed, rejection: Rejection, reading: &Reading, layout: Layout) -> bool {
    if rejection == Rejection::Identifier {
        return true;
    }
    let start = layout.in_image(object.index).and_then(|place| place.start.checked_sub(reading.offset));
    let from = start.and_then(|start| reading.miso.get(start..)).unwrap_or_default();
    let intact = |other: usize| {
        let length = layout.in_image(other).map_or(0, |place| place.len());
        from.get(..length).is_some_and(|bytes| Object::verify(other, bytes).is_ok())
    };
    (0..layout.objects()).any(intact)
        || from.get(..LinkStatus::SIZE).is_some_and(|bytes| LinkStatus::verify(bytes).is_ok())
}
