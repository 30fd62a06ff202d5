//! By which dynamic model the receivers navigate whose positions HORUS shows.
//!
//! The receivers themselves tell ([`What::Navigates`]). A receiver whose position HORUS shows as valid has to navigate
//! by [`bounds::DYNAMIC_MODEL`] from [`bounds::MODEL_TOLD`] on after the last of these: HORUS's start, the change to
//! another model, the end of a fault of this receiver or its line. It is told once for each change. A receiver that
//! tells nothing, as a recorded one does, is not asked.

use crate::{Disturbance, Event, What, bounds};

#[derive(Clone, Debug, Default)]
struct Model {
    /// The one by which it navigates, and since when, ns; nothing where it is right or not known.
    other: Option<(u8, u64)>,
    /// Until when it, or its line, was broken on purpose, ns.
    broken: u64,
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Models(Vec<Model>);

impl Models {
    /// Nothing is known of so many receivers.
    pub(super) fn new(receivers: usize) -> Self {
        Self(vec![Model::default(); receivers])
    }

    /// Takes the next event.
    pub(super) fn take(&mut self, event: &Event) {
        match &event.what {
            What::Navigates { receiver, model } => {
                let Some(known) = self.0.get_mut(*receiver) else { return };
                known.other = (*model != bounds::DYNAMIC_MODEL).then_some((*model, event.at));
            }
            What::Injected { disturbs: Disturbance::Receiver { receiver }, until, .. } => {
                if let Some(model) = self.0.get_mut(*receiver) {
                    model.broken = model.broken.max(*until);
                }
            }
            _ => {}
        }
    }

    /// The other model by which a receiver (from 0) navigates at `at`, ns, and should have been told better by a HORUS
    /// that runs since `since`; once.
    pub(super) fn wrong(&mut self, receiver: usize, at: u64, since: u64) -> Option<u8> {
        let model = self.0.get_mut(receiver)?;
        let (other, from) = model.other?;
        let due = from.max(since).max(model.broken).saturating_add(bounds::MODEL_TOLD);
        (at > due).then(|| {
            model.other = None;
            other
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::injected;

    fn models(events: &[(u64, What)]) -> Models {
        let mut models = Models::new(2);
        events.iter().for_each(|(at, what)| models.take(&Event { at: *at, what: what.clone() }));
        models
    }

    fn navigates(receiver: usize, model: u8) -> What {
        What::Navigates { receiver, model }
    }

    #[test]
    fn a_receiver_has_to_navigate_as_airborne_within_a_time() {
        let late = bounds::MODEL_TOLD;
        let told = |events: &[(u64, What)], at, since| models(events).wrong(1, at, since);
        assert_eq!(told(&[], late * 9, 0), None, "it says nothing");
        let car = [(5, navigates(1, 4))];
        assert_eq!((told(&car, late + 5, 0), told(&car, late + 6, 0)), (None, Some(4)));
        assert_eq!((told(&car, late + 7, 7), told(&car, late + 8, 7)), (None, Some(4)), "from HORUS's start on");
        for airborne in [6, 8] {
            assert_eq!(told(&[(5, navigates(1, airborne))], late * 2, 0), Some(airborne), "another of them");
        }
        assert_eq!(told(&[(5, navigates(0, 4))], late * 2, 0), None, "the other receiver's");
        assert_eq!(told(&[(5, navigates(1, 4)), (6, navigates(1, 7))], late * 2, 0), None);
    }

    #[test]
    fn a_fault_of_the_receiver_excuses_it_for_that_time() {
        let late = bounds::MODEL_TOLD;
        let fault = |receiver| injected(Disturbance::Receiver { receiver }, 100);
        let told = |of, at| models(&[(5, navigates(1, 0)), (6, fault(of))]).wrong(1, at, 0);
        assert_eq!((told(1, late + 100), told(1, late + 101)), (None, Some(0)));
        assert_eq!(told(0, late + 50), Some(0));
    }

    #[test]
    fn each_change_is_told_once() {
        let mut models = models(&[(0, navigates(1, 0))]);
        let at = bounds::MODEL_TOLD * 2;
        assert_eq!([models.wrong(1, at, 0), models.wrong(1, at, 0)], [Some(0), None]);
        models.take(&Event { at, what: navigates(1, 4) });
        assert_eq!(models.wrong(1, 2 * at, 0), Some(4));
    }
}
