//! Determines what is wrong with an object's bytes that are neither an intact object nor empty.
//!
//! If the image changes during a transaction, the transaction reads bytes of several images. Each byte of the object is
//! then one that HORUS sent in some cycle, or a fill byte of a scrub, but no single cycle explains all of them. An
//! object that differs in only one bit from what was sent counts as damaged.

use std::collections::VecDeque;

use profile::{Layout, LinkStatus, Object, Rejection};

use super::latency::Cycles;
use crate::read::{Placed, Reading, State};
use crate::{Findings, Violation};

/// The number of Link-Status objects that are kept: more than the DPR has images.
const REMEMBERED: usize = 16;

const FILLS: [u8; 2] = [0x00, 0xFF];

/// The Link-Status objects of earlier images, for comparison.
#[derive(Clone, Debug, Default)]
pub(super) struct Damage {
    links: VecDeque<[u8; LinkStatus::SIZE]>,
}

impl Damage {
    /// Keeps the Link-Status of a transaction, or of an image that FRESH announced, if it is intact.
    pub(super) fn remember(&mut self, reading: &Reading) {
        let Some((Some(Ok(_)), link)) = Some(reading.link).zip(reading.miso.first_chunk()) else { return };
        if self.links.contains(link) {
            return;
        }
        if self.links.len() == REMEMBERED {
            self.links.pop_front();
        }
        self.links.push_back(*link);
    }

    /// Reports the error in the bytes of a transaction, and returns whether there is one. `spliced` means that
    /// Link-Status and the objects come from two images.
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

/// Returns whether `bytes` consist of bytes of several `sources` and fill bytes of a scrub.
fn is_torn<'a>(bytes: &[u8], sources: impl Iterator<Item = &'a [u8]> + Clone) -> bool {
    let differing = |source: &[u8]| -> u32 { bytes.iter().zip(source).map(|(a, b)| (a ^ b).count_ones()).sum() };
    let explained =
        |(at, byte): (usize, &u8)| FILLS.contains(byte) || sources.clone().any(|source| source.get(at) == Some(byte));
    bytes.iter().enumerate().all(explained) && sources.clone().all(|source| differing(source) > 1)
}

/// Returns whether the bytes at `object`'s offset are another intact object.
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
