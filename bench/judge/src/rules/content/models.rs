//! Judges whether each receiver that gives HORUS a valid position navigates by the right dynamic model.
//!
//! HORUS must set a receiver to [`bounds::DYNAMIC_MODEL`] if it shows the receiver's position as valid. It has
//! [`bounds::SETTINGS_TOLD`] for this from its start or from the last change of the model, and longer while
//! [`Excuse::Settings`] holds.
//!
//! Each receiver states its dynamic model in the log ([`What::Settings`]). A receiver that states none, such as a
//! recorded one, is not judged.

use crate::disturbance::Excuse;
use crate::{Disturbances, What, bounds};

#[derive(Clone, Debug)]
pub(super) struct Models {
    /// The model of each receiver; `None` if the receiver has not stated one.
    known: Vec<Option<u8>>,
    /// The instant, ns, since which each receiver has had a wrong model; `None` if its model is right, or once
    /// reported.
    other: Vec<Option<u64>>,
}

impl Models {
    pub(super) fn new(receivers: usize) -> Self {
        Self { known: vec![None; receivers], other: vec![None; receivers] }
    }

    pub(super) fn take(&mut self, at: u64, what: &What) {
        if let What::Settings { receiver, model, .. } = what
            && let Some(known) = self.known.get_mut(*receiver)
            && known.replace(*model) != Some(*model)
        {
            self.other[*receiver] = (*model != bounds::DYNAMIC_MODEL).then_some(at);
        }
    }

    /// Returns a receiver's (from 0) wrong model if HORUS, started at `since`, should have corrected it by `at`, ns.
    /// Each change is returned once.
    pub(super) fn wrong(&mut self, receiver: usize, at: u64, since: u64, disturbances: &Disturbances) -> Option<u8> {
        let other = self.other.get_mut(receiver)?;
        let due = (*other)?.max(since) + bounds::SETTINGS_TOLD;
        let told = at > due && !disturbances.excuse_of(receiver, Excuse::Settings, at);
        told.then(|| *other = None)?;
        self.known[receiver]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::injected;
    use crate::{Disturbance, Event};

    const LATE: u64 = bounds::SETTINGS_TOLD;

    /// Returns the wrong model of GPS2 that is reported at `at`, if HORUS has been running since `since`.
    fn told(events: &[(u64, What)], at: u64, since: u64) -> Option<u8> {
        let (mut models, mut disturbances) = (Models::new(2), Disturbances::default());
        for (at, what) in events {
            models.take(*at, what);
            disturbances.take(&Event { at: *at, what: what.clone() });
        }
        models.wrong(1, at, since, &disturbances)
    }

    fn navigates(receiver: usize, model: u8) -> What {
        What::Settings { receiver, model, position: true }
    }

    #[test]
    fn a_receiver_has_to_navigate_as_airborne_within_a_time() {
        assert_eq!(told(&[], LATE * 9, 0), None, "it says nothing");
        let car = [(5, navigates(1, 4))];
        assert_eq!((told(&car, LATE + 5, 0), told(&car, LATE + 6, 0)), (None, Some(4)));
        assert_eq!((told(&car, LATE + 7, 7), told(&car, LATE + 8, 7)), (None, Some(4)), "from HORUS's start on");
        for airborne in [6, 8] {
            assert_eq!(told(&[(5, navigates(1, airborne))], LATE * 2, 0), Some(airborne), "another of them");
        }
        assert_eq!(told(&[(5, navigates(0, 4))], LATE * 2, 0), None, "the other receiver's");
        assert_eq!(told(&[(5, navigates(1, 4)), (6, navigates(1, 7))], LATE * 2, 0), None);
        let silent = What::Settings { receiver: 1, model: 4, position: false };
        assert_eq!(told(&[(5, navigates(1, 4)), (6, silent)], LATE + 6, 0), Some(4), "another setting");
    }

    #[test]
    fn a_fault_of_the_receiver_excuses_it_for_that_time() {
        let told =
            |receiver, at| told(&[(5, navigates(1, 0)), (6, injected(Disturbance::Receiver { receiver }, 100))], at, 0);
        assert_eq!((told(1, LATE + 99), told(1, LATE + 100)), (None, Some(0)));
        assert_eq!(told(0, LATE + 50), Some(0));
    }

    #[test]
    fn each_change_is_told_once() {
        let (mut models, disturbances) = (Models::new(2), Disturbances::default());
        models.take(0, &navigates(1, 0));
        let told = |models: &mut Models, at| models.wrong(1, at, 0, &disturbances);
        assert_eq!([told(&mut models, LATE * 2), told(&mut models, LATE * 2)], [Some(0), None]);
        models.take(LATE * 2, &navigates(1, 4));
        assert_eq!(told(&mut models, LATE * 4), Some(4));
    }
}
