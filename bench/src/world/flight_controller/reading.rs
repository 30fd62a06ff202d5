//! What the flight controller makes of the bytes that one transaction brought.

use profile::image;
use profile::ssi::client::{Report, Shown, View};
use profile::{Layout, LinkValues, Rejection};

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
    /// What the client says: whether there is a position to fly by, and how old it is.
    pub report: Report,
}

impl Reading {
    /// What a transaction brought that began at `selected_ns`: `view` shows it, and the client's report is `report`.
    /// `previous` is the timestamp of the profile that was forwarded last.
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
            // Each image has Link-Status.
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
