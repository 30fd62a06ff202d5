//! What the flight controller makes of the bytes that one transaction brought.

use std::ops::Range;

use profile::image;
use profile::ssi::Request;
use profile::{Layout, LinkStatus, LinkValues, Object, Rejection};

use crate::world::ssi::Transaction;

/// What a transaction amounted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// Everything intact, the image was read whole, and the profile is another than the one forwarded last.
    Fresh,
    /// Everything intact, nothing new: the same profile again, none yet, or a window without one.
    Repeated,
    /// 0xFF throughout: the DPR was busy.
    Busy,
    /// Link-Status or an object is neither intact nor vacant. Nothing of it is used.
    BadCrc,
}

/// What one transaction brought.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The DPR's pin saw chip select fall, ns.
    pub selected_ns: u64,
    /// What it amounted to.
    pub outcome: Outcome,
    /// Which byte of the image came first.
    pub offset: usize,
    /// Link-Status, if it was read and intact.
    pub link: Option<LinkValues>,
    /// Timestamp of the first valid object, ms since HORUS start: that of Reported-Position if it is valid.
    pub timestamp: Option<u32>,
    /// Valid objects of the profile.
    pub valid: usize,
    /// Places of objects that were read and are vacant.
    pub vacant: usize,
    /// The first damaged thing, if any: its offset in the image, and what is wrong with it.
    pub damage: Option<(usize, Rejection)>,
    /// The profile that was forwarded to the base station, if it was: [`Outcome::Fresh`] alone.
    pub forwarded: Option<Vec<u8>>,
}

impl Reading {
    /// What `transaction`, which was to read `window` of the image, brought. `previous` is the timestamp of the profile
    /// that was forwarded last.
    pub(super) fn of(transaction: &Transaction, window: Request, layout: Layout, previous: Option<u32>) -> Self {
        let miso = transaction.miso.as_slice();
        let mut reading = Self {
            selected_ns: transaction.selected_ns,
            outcome: Outcome::Repeated,
            offset: usize::from(window.offset),
            link: None,
            timestamp: None,
            valid: 0,
            vacant: 0,
            damage: None,
            forwarded: None,
        };
        if !miso.is_empty() && miso.iter().all(|byte| *byte == 0xff) {
            reading.outcome = Outcome::Busy;
            return reading;
        }
        // These bytes of the image, if the transaction read all of them.
        let shown = miso.get(..usize::from(window.length)).unwrap_or(miso);
        let read = |place: Range<usize>| {
            let start = place.start.checked_sub(reading.offset)?;
            shown.get(start..start + place.len())
        };
        let link = read(image::LINK_STATUS..image::LINK_STATUS + LinkStatus::SIZE).map(LinkStatus::verify);
        let objects = (0..layout.objects()).filter_map(|index| {
            let place = layout.in_image(index)?;
            Some((place.start, index, read(place)?))
        });
        let objects: Vec<_> = objects.collect();
        match link {
            Some(Ok(link)) => reading.link = Some(link.values()),
            Some(Err(why)) => reading.damage = Some((image::LINK_STATUS, why)),
            None => {}
        }
        for (offset, index, bytes) in objects {
            match Object::verify(index, bytes) {
                Ok(object) => {
                    reading.valid += 1;
                    reading.timestamp.get_or_insert(object.timestamp());
                }
                Err(_) if is_vacant(bytes) => reading.vacant += 1,
                Err(why) => {
                    reading.damage.get_or_insert((offset, why));
                }
            }
        }
        let is_whole = reading.offset == 0 && shown.len() == layout.image_len();
        if reading.damage.is_some() {
            reading.outcome = Outcome::BadCrc;
        } else if is_whole && reading.timestamp.is_some_and(|now| previous != Some(now)) {
            reading.outcome = Outcome::Fresh;
            reading.forwarded = Some(shown[image::REPORTED_POSITION..].to_vec());
        }
        reading
    }
}

/// Whether the place of an object is as a scrub leaves it.
pub(in crate::world) fn is_vacant(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| *byte == 0) || bytes.iter().all(|byte| *byte == 0xff)
}
