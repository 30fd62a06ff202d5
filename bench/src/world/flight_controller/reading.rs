//! Evaluates the bytes that one transaction brought to the flight controller.

use profile::image;
use profile::ssi::client::{Report, Shown, View};
use profile::{Layout, LinkValues, Rejection};

/// The result of a transaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// The transaction read the whole image, no object is damaged, and the profile is not the one forwarded last.
    Fresh,
    /// No object that was read is damaged, but there is no profile, or only the one that was forwarded last.
    Repeated,
    /// Every byte is 0xFF: the DPR was busy.
    Busy,
    /// Link-Status or an object is neither intact nor vacant. The flight controller then uses nothing of the image.
    BadCrc,
}

/// The evaluation of one transaction.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// The instant at which chip select fell at the DPR's pin, ns.
    pub selected_ns: u64,
    /// The result.
    pub outcome: Outcome,
    /// The offset in the image of the first byte that was read.
    pub offset: usize,
    /// Link-Status, if it was read and intact.
    pub link: Option<LinkValues>,
    /// The timestamp of the first valid object, ms since HORUS's start. Reported-Position comes first.
    pub timestamp: Option<u32>,
    /// The number of valid objects of the profile.
    pub valid: usize,
    /// The number of objects that were read and are vacant.
    pub vacant: usize,
    /// The first damaged object: its offset in the image, and the kind of damage.
    pub damage: Option<(usize, Rejection)>,
    /// The profile that was forwarded to the base station; `None` unless the outcome is [`Outcome::Fresh`].
    pub forwarded: Option<Vec<u8>>,
    /// The client's report: whether there is a position to fly by, and the position's age.
    pub report: Report,
}

impl Reading {
    /// Evaluates a transaction with the contents `view`. `previous` is the timestamp of the last forwarded profile.
    pub(super) fn of(selected_ns: u64, view: &View<'_>, layout: Layout, report: Report, previous: Option<u32>) -> Self {
        let mut reading = Self {
            selected_ns,
            outcome: Outcome::Repeated,
            offset: usize::from(view.window().offset),
            link: None,
            timestamp: None,
            valid: 0,
            vacant: 0,
            damage: None,
            forwarded: None,
            report,
        };
        if !view.bytes().is_empty() && view.is_busy() {
            reading.outcome = Outcome::Busy;
            return reading;
        }
        match view.link() {
            Some(Shown::Intact(link)) => reading.link = Some(link.values()),
            Some(Shown::Damaged(why)) => reading.damage = Some((image::LINK_STATUS, why)),
            // A vacant Link-Status counts as damaged, because every image has one.
            Some(Shown::Vacant) => reading.damage = Some((image::LINK_STATUS, Rejection::Crc)),
            None => {}
        }
        for index in 0..layout.objects() {
            match view.object(index) {
                Some(Shown::Intact(object)) => {
                    reading.valid += 1;
                    reading.timestamp.get_or_insert(object.timestamp());
                }
                Some(Shown::Vacant) => reading.vacant += 1,
                Some(Shown::Damaged(why)) => {
                    let place = layout.in_image(index).expect("it is in the view");
                    reading.damage.get_or_insert((place.start, why));
                }
                None => {}
            }
        }
        let whole = view.find(image::REPORTED_POSITION..layout.image_len());
        if reading.damage.is_some() {
            reading.outcome = Outcome::BadCrc;
        } else if reading.timestamp.is_some_and(|now| previous != Some(now))
            && let Some(profile) = whole
            && reading.offset == 0
        {
            reading.outcome = Outcome::Fresh;
            reading.forwarded = Some(profile.to_vec());
        }
        reading
    }
}
