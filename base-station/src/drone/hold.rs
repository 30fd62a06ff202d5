//! Judges and keeps Hold-Status, the object of the [active hold](profile::hold), beside HORUS's objects.
//!
//! This module uses the flight controller's client ([`HoldTrack`]), which decides whether there is a Hold-Status at
//! all, with the same limit as on the drone. Before that, [`order`](super::order) leaves out what a radio delayed,
//! repeated or reordered.
//!
//! **Nothing of HORUS depends on it.** A Hold-Status is no sign of life of the drone and changes no alarm, whether it
//! is intact or damaged. What the hold reports is a [notice](HoldState::notices).

use profile::ssi::Request;
use profile::ssi::client::{HoldShown, HoldTrack, Shown, View};
use profile::{HoldStatus, HoldValues, Layout, ResetReason};

use super::order::{Order, Step};
use super::{Held, OLD_US, Verdict};
use crate::age::Ages;
use crate::{Intact, Place};

/// Whether the last Hold-Status of a drone counts as its present one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Presence {
    /// No intact Hold-Status has ever arrived.
    Never,
    /// The last Hold-Status has stayed the same for more than [300 ms](profile::hold::EXPIRY_MS), or came more than
    /// [`OLD_US`] late, or the DPR says that there is no Hold-Status any more.
    Expired,
    /// The last Hold-Status is the present one.
    Valid,
}

impl Presence {
    /// Returns the name for programs.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::Never => "never",
            Self::Expired => "expired",
            Self::Valid => "valid",
        }
    }
}

/// The Hold-Status of one drone. See the [module](self).
#[derive(Clone, Debug, Default)]
pub struct HoldState {
    order: Order,
    ages: Ages,
    track: HoldTrack,
    last: Option<(HoldStatus, Held<HoldValues>)>,
    restarts: u64,
    damaged: u64,
    strange: u64,
}

impl HoldState {
    /// Judges bytes that arrived at `at_us`, µs, as Hold-Status, and keeps it if it is accepted.
    pub(super) fn take(&mut self, at_us: u64, bytes: &[u8]) -> Verdict {
        let verdict = match Place::Hold.judge(bytes) {
            Shown::Intact(Intact::Hold(object)) => self.judge(at_us, object),
            Shown::Vacant => Verdict::Vacant,
            Shown::Damaged(why) => Verdict::Rejected(why),
            Shown::Intact(_) => Verdict::Rejected(profile::Rejection::Identifier),
        };
        self.damaged += u64::from(matches!(verdict, Verdict::Rejected(_)));
        self.strange += u64::from(verdict == Verdict::OutOfSequence);
        if matches!(verdict, Verdict::New | Verdict::Duplicate | Verdict::Vacant) {
            self.track.read(&view(bytes), at_us);
        }
        verdict
    }

    fn judge(&mut self, at_us: u64, object: &HoldStatus) -> Verdict {
        let timestamp = object.timestamp();
        match self.order.judge(timestamp, at_us, false, self.ages.early_us(timestamp, at_us, true)) {
            Step::Newest { .. } => {}
            Step::Restarted => {
                self.ages = Ages::default();
                self.restarts += 1;
            }
            Step::Same if self.last.is_some_and(|(last, _)| last == *object) => return Verdict::Duplicate,
            Step::Older => return Verdict::Older,
            Step::Same | Step::Search | Step::Stranger => return Verdict::OutOfSequence,
        }
        let late_us = self.ages.take(timestamp, at_us, true);
        let (values, arrived_us, crc) = (object.values(), at_us, 0);
        let held = Held { values, timestamp, arrived_us, late_us, repeats: 0, crc, implausible: false };
        self.last = Some((*object, held));
        Verdict::New
    }

    /// Returns true if an intact Hold-Status that arrived at `at_us` continues the earlier ones or may be late.
    pub(super) fn fits(&self, at_us: u64, timestamp: u32) -> bool {
        self.order.fits(timestamp, at_us, false, self.ages.early_us(timestamp, at_us, true))
    }

    /// Returns whether the last Hold-Status is the present one at `now_us`.
    #[must_use]
    pub fn presence(&self, now_us: u64) -> Presence {
        let Some((_, held)) = &self.last else { return Presence::Never };
        // An empty transaction at `now_us` makes the track check the age of the last Hold-Status. The transaction goes
        // to a copy, so that the track itself stays the same.
        let shown = self.track.clone().read(&view(&[]), now_us).shown;
        let is_valid = shown == HoldShown::Valid && held.age_us(now_us) <= OLD_US;
        if is_valid { Presence::Valid } else { Presence::Expired }
    }

    /// Returns the values of the newest Hold-Status, present or not.
    #[must_use]
    pub fn held(&self) -> Option<&Held<HoldValues>> {
        self.last.as_ref().map(|(_, held)| held)
    }

    /// Returns the newest Hold-Status, present or not.
    #[must_use]
    pub fn object(&self) -> Option<&HoldStatus> {
        self.last.as_ref().map(|(object, _)| object)
    }

    /// Returns the number of times that the hold has restarted.
    #[must_use]
    pub const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Returns the number of Hold-Status objects that did not continue the earlier ones, as after a restart of the
    /// hold.
    #[must_use]
    pub const fn strange(&self) -> u64 {
        self.strange
    }

    /// Returns the number of times that the place of Hold-Status held an object that was damaged or of another kind.
    #[must_use]
    pub const fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Returns, as text, what the newest Hold-Status reports that a user should know. None of these notices is an
    /// alarm.
    pub fn notices(&self) -> impl Iterator<Item = &'static str> {
        let status = self.held().map(|held| held.values.status);
        let notices = status.map(|status| {
            [
                (status.safe_state(), "the hold is in its safe state: its output is off"),
                (status.sensor_fault(), "a sensor of the hold has a fault"),
                (status.memory_fault(), "the hold has found a fault of its memory"),
                (!status.values_valid(), "the hold's values are not valid"),
                (status.values_valid() && !status.within_limits(), "the values are outside of the hold's limits"),
                (status.reset_reason().is_some_and(ResetReason::is_unasked), "the hold was reset by a fault"),
            ]
        });
        notices.into_iter().flatten().filter(|(holds, _)| *holds).map(|(_, words)| words)
    }
}

/// Returns a view of `bytes`, as if a transaction had read them from the hold's place in the map.
fn view(bytes: &[u8]) -> View<'_> {
    let [.., layout] = Layout::ALL.map(Layout::with_hold);
    let offset = layout.hold().and_then(|place| u16::try_from(place.start).ok()).unwrap_or_default();
    View::new(layout, Request { offset, length: u16::try_from(bytes.len()).unwrap_or(u16::MAX) }, bytes)
}

#[cfg(test)]
mod tests {
    use profile::criticality::{ActiveLoad, Writer};
    use profile::{HoldStatusBits, LinkStatus, LinkValues, ReportedPosition, ReportedValues};

    use super::*;
    use crate::{Bundle, Drone, Fleet, Source, Who};

    const START: u64 = 1_000_000_000;

    fn object(ms: u32) -> [u8; 64] {
        let values = HoldValues { temperature: ms as f32 / 1e3, ..HoldValues::absent(ms) };
        *HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values).as_bytes()
    }

    fn at(ms: u32) -> u64 {
        START + 1_000 * u64::from(ms)
    }

    fn heard(until_ms: u32) -> HoldState {
        let mut hold = HoldState::default();
        for ms in (60_000..=until_ms).step_by(100) {
            assert_eq!(hold.take(at(ms), &object(ms)), Verdict::New, "{ms}");
        }
        hold
    }

    #[test]
    fn it_is_never_there_then_valid_for_300_ms_and_then_expired() {
        assert_eq!(HoldState::default().presence(u64::MAX), Presence::Never);
        let mut hold = heard(61_000);
        let presence = |hold: &HoldState, us| hold.presence(at(61_000) + us);
        assert_eq!([300_000, 300_001].map(|us| presence(&hold, us)), [Presence::Valid, Presence::Expired]);
        assert_eq!(hold.held().unwrap().age_us(at(61_300)), 300_000);
        assert_eq!(hold.take(at(61_050), &object(61_000)), Verdict::Duplicate);
        assert_eq!(presence(&hold, 300_001), Presence::Expired, "the same again does not prolong it");
        assert_eq!(hold.take(at(61_400), &object(61_400)), Verdict::New);
        assert_eq!(presence(&hold, 400_000), Presence::Valid);
    }

    #[test]
    fn a_vacant_place_expires_it_at_once_and_damage_does_not() {
        for (bytes, presence) in [(vec![0; 64], Presence::Expired), (vec![0xFF; 64], Presence::Valid)] {
            let mut hold = heard(61_000);
            assert_eq!(hold.take(at(61_010), &bytes), Verdict::Vacant);
            assert_eq!(hold.presence(at(61_010)), presence, "0xFF is a DPR that was busy");
        }
        let mut hold = heard(61_000);
        let mut damaged = object(61_100);
        damaged[10] ^= 1;
        assert_eq!(hold.take(at(61_100), &damaged), Verdict::Rejected(profile::Rejection::Crc));
        let horus = *ReportedPosition::seal(&ReportedValues::absent(10)).as_bytes();
        assert_eq!(hold.take(at(61_100), &horus), Verdict::Rejected(profile::Rejection::Identifier));
        assert_eq!((hold.presence(at(61_100)), hold.damaged()), (Presence::Valid, 2));
    }

    #[test]
    fn what_a_radio_delays_or_inserts_is_not_shown() {
        let mut hold = heard(62_000);
        assert_eq!(hold.take(at(62_010), &object(61_500)), Verdict::Older);
        assert_eq!(hold.take(at(62_010), &object(900_000)), Verdict::OutOfSequence);
        let other = HoldValues { humidity: 1.0, ..HoldValues::absent(62_000) };
        let other = *HoldStatus::seal(Writer::<ActiveLoad>::claim(), &other).as_bytes();
        assert_eq!(hold.take(at(62_010), &other), Verdict::OutOfSequence, "another content with its timestamp");
        assert_eq!(hold.held().unwrap().timestamp, 62_000);
        // The radio delayed this object by two seconds.
        assert_eq!(hold.take(at(64_100), &object(62_100)), Verdict::New);
        assert_eq!((hold.presence(at(64_100)), hold.held().unwrap().late_us), (Presence::Expired, 1_999_440));
    }

    #[test]
    fn a_hold_that_restarted_is_believed_after_three_objects() {
        let mut hold = heard(62_000);
        let verdicts = [100, 200, 300].map(|ms| hold.take(at(62_200 + ms), &object(ms)));
        assert_eq!(verdicts, [Verdict::OutOfSequence, Verdict::OutOfSequence, Verdict::New]);
        assert_eq!((hold.restarts(), hold.presence(at(62_600))), (1, Presence::Valid));
    }

    #[test]
    fn its_faults_are_notices() {
        let mut hold = heard(60_000);
        let told = |hold: &HoldState| hold.notices().collect::<Vec<_>>();
        assert_eq!(told(&hold), ["the hold's values are not valid"]);
        let status = HoldStatusBits::new().with_values_valid(true).with_sensor_fault(true);
        let status = status.with_reset_reason(ResetReason::Watchdog);
        let values = HoldValues { status, ..HoldValues::absent(60_100) };
        hold.take(at(60_100), HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values).as_bytes());
        let words = ["a sensor of the hold has a fault", "the values are outside of the hold's limits"];
        assert_eq!(told(&hold), [words[0], words[1], "the hold was reset by a fault"]);
    }

    #[test]
    fn nothing_of_it_changes_what_is_shown_of_horus() {
        let link = *LinkStatus::seal(&LinkValues::default()).as_bytes();
        let reported = *ReportedPosition::seal(&ReportedValues::absent(70_000)).as_bytes();
        let heard = || {
            let mut drone = Drone::new(at(0));
            drone.take(Place::LinkStatus, at(0), &link);
            drone.take(Place::Reported, at(0), &reported);
            drone
        };
        let (mut with, mut without) = (heard(), heard());
        let mut damaged = object(7);
        damaged[20] ^= 1;
        let faults = HoldStatusBits::from_bits(0x01FC);
        let faulty = HoldValues { status: faults, ..HoldValues::absent(400) };
        let faulty = *HoldStatus::seal(Writer::<ActiveLoad>::claim(), &faulty).as_bytes();
        for (ms, bytes) in [(100, object(100)), (200, damaged), (300, [0; 64]), (400, faulty), (900, object(3))] {
            with.take(Place::Hold, at(ms), &bytes);
        }
        assert_eq!(with.hold().unwrap().damaged(), 1);
        for ms in (0..3_000).step_by(10) {
            assert_eq!(with.alarms_at(at(ms)), without.alarms_at(at(ms)), "{ms}");
            assert_eq!(with.tick(at(ms)), without.tick(at(ms)), "{ms}");
        }
        assert_eq!((with.counts(), with.heard_us()), (without.counts(), without.heard_us()));
        let shown = |drone: &Drone| format!("{:?}", drone.reported());
        assert_eq!(shown(&with), shown(&without));
    }

    #[test]
    fn it_makes_no_drone_and_no_rival() {
        let mut fleet = Fleet::default();
        let (who, source) = (Who::System(7), Source::default());
        let bytes = object(100);
        let hold = Bundle::new(Place::Hold, 1, &bytes).unwrap();
        assert_eq!(fleet.take(who, source, at(0), &hold), (who.first(), vec![]));
        assert_eq!(fleet.iter().len(), 0);
        let link = *LinkStatus::seal(&LinkValues::default()).as_bytes();
        fleet.take(who, source, at(0), &Bundle::new(Place::LinkStatus, 1, &link).unwrap());
        let elsewhere = Source { component: 9, ..source };
        assert_eq!(fleet.take(who, elsewhere, at(10), &hold).1, []);
        assert_eq!(fleet.take(who, source, at(10), &hold).1, [Verdict::New]);
        let (_, drone) = fleet.iter().next().unwrap();
        assert_eq!(drone.hold().unwrap().held().unwrap().timestamp, 100);
        assert!(!drone.alarms_at(at(10)).has(crate::Alarm::TwoSenders));
    }
}
