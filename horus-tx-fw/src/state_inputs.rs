//! HORUS's state, from the inputs of its safety function
//!
//! # Design
//!
//! Three inputs tell whether the relay has switched to the redundant flight controller, whether the motors are cut, and
//! whether the emergency measure has fired. Each input is a pair of pins with opposite levels, one high while the input
//! is active, the other while it is not. Equal levels (a broken wire, a short) are a contradiction (decision 18).
//!
//! [`StateInputs::sample`] is called once per cycle. A pair's value is accepted when [`SAMPLES_TO_TAKE`] samples in a
//! row agree. A pair without an accepted value for [`SAMPLES_UNSETTLED`] samples is a contradiction.

use profile::HorusState;

/// The number of inputs from which HORUS derives its state.
pub const INPUTS: usize = 3;

/// The number of samples in a row that must agree before their value is accepted: 20 ms from first to last.
pub const SAMPLES_TO_TAKE: u8 = 3;

/// The number of samples without [`SAMPLES_TO_TAKE`] equal ones in a row that make a contradiction: 100 ms.
pub const SAMPLES_UNSETTLED: u8 = 10;

/// The levels of a pair's two pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels {
    /// The pin that is high while the input is active.
    pub active: bool,
    /// The pin that is high while the input is not active.
    pub inactive: bool,
}

/// The value that a pair's levels mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Says {
    /// The input is not active.
    Inactive,
    /// The input is active.
    Active,
    /// The pair contradicts itself.
    Contradiction,
}

impl From<Levels> for Says {
    fn from(levels: Levels) -> Self {
        match (levels.active, levels.inactive) {
            (false, true) => Self::Inactive,
            (true, false) => Self::Active,
            (true, true) | (false, false) => Self::Contradiction,
        }
    }
}

/// One input with its pair of pins, and the rules that suppress short changes of its levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Pair {
    /// The value of the pair that was accepted last; `None` until the pair has settled for the first time.
    taken: Option<Says>,
    last: Option<Says>,
    /// The number of samples in a row that have had the same value, at most [`SAMPLES_TO_TAKE`].
    same: u8,
    /// The number of samples since a value was last accepted, at most [`SAMPLES_UNSETTLED`].
    unsettled: u8,
}

impl Pair {
    fn sample(&mut self, says: Says) {
        self.same = if self.last == Some(says) { self.same + 1 } else { 1 }.min(SAMPLES_TO_TAKE);
        self.last = Some(says);
        if self.same == SAMPLES_TO_TAKE {
            self.taken = Some(says);
            self.unsettled = 0;
        } else {
            self.unsettled = (self.unsettled + 1).min(SAMPLES_UNSETTLED);
            if self.unsettled == SAMPLES_UNSETTLED {
                self.taken = Some(Says::Contradiction);
            }
        }
    }
}

/// All inputs, the least severe first: relay, motor cut, emergency measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StateInputs {
    pairs: [Pair; INPUTS],
}

/// The state of HORUS that each active input means, in the order of the inputs.
const STATES: [HorusState; INPUTS] =
    [HorusState::SwitchedToRedundant, HorusState::MotorsCut, HorusState::EmergencyFired];

impl StateInputs {
    /// Returns the state before the first sample, in which no input has settled yet.
    #[must_use]
    pub const fn new() -> Self {
        const UNKNOWN: Pair = Pair { taken: None, last: None, same: 0, unsettled: 0 };
        Self { pairs: [UNKNOWN; INPUTS] }
    }

    /// Takes one sample of the levels of all inputs. To be called once in each cycle.
    pub fn sample(&mut self, levels: [Levels; INPUTS]) {
        for (pair, levels) in self.pairs.iter_mut().zip(levels) {
            pair.sample(levels.into());
        }
    }

    /// Returns HORUS's state: that of the most severe input that is active or a contradiction. If all inputs are
    /// inactive, the voted position decides: monitoring if there is one (`is_located`), position lost if there was one
    /// before (`was_located`), otherwise starting. The state is also starting until each input has settled for the
    /// first time.
    #[must_use]
    pub fn state(&self, was_located: bool, is_located: bool) -> HorusState {
        let is_known = self.pairs.iter().all(|pair| pair.taken.is_some());
        let mut state = match (is_known, is_located, was_located) {
            (true, true, _) => HorusState::Monitoring,
            (true, false, true) => HorusState::PositionLost,
            _ => HorusState::Starting,
        };
        for (pair, active) in self.pairs.iter().zip(STATES) {
            match pair.taken {
                Some(Says::Active) => state = active,
                Some(Says::Contradiction) => state = HorusState::InputsContradict,
                Some(Says::Inactive) | None => {}
            }
        }
        state
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use proptest::prelude::*;
    use HorusState::{
        EmergencyFired, InputsContradict, Monitoring, MotorsCut, PositionLost, Starting, SwitchedToRedundant,
    };
    use Says::{Active, Contradiction, Inactive};

    fn levels(says: Says) -> Levels {
        let (active, inactive) = match says {
            Inactive => (false, true),
            Active => (true, false),
            Contradiction => (true, true),
        };
        Levels { active, inactive }
    }

    fn of_motor_cut(samples: &[Says]) -> Vec<HorusState> {
        let mut inputs = StateInputs::new();
        let step = |says: &Says| {
            inputs.sample([Inactive, *says, Inactive].map(levels));
            inputs.state(true, true)
        };
        samples.iter().map(step).collect()
    }

    fn settled(says: [Says; INPUTS]) -> StateInputs {
        let mut inputs = StateInputs::new();
        (0..SAMPLES_TO_TAKE).for_each(|_| inputs.sample(says.map(levels)));
        inputs
    }

    #[test]
    fn a_pair_says_what_its_levels_say() {
        let says = |active, inactive| Says::from(Levels { active, inactive });
        assert_eq!(says(false, true), Inactive);
        assert_eq!(says(true, false), Active);
        assert_eq!(says(true, true), Contradiction, "not connected: both pull-ups");
        assert_eq!(says(false, false), Contradiction);
    }

    // Shows STA-1.
    #[test]
    fn what_three_samples_in_a_row_say_is_taken() {
        let [i, a, c] = [Inactive, Active, Contradiction];
        assert_eq!(of_motor_cut(&[i, i, i]), [Starting, Starting, Monitoring]);
        assert_eq!(of_motor_cut(&[a, a, a]), [Starting, Starting, MotorsCut]);
        assert_eq!(
            of_motor_cut(&[i, i, i, a, a, i, a, a, a])[3..],
            [Monitoring, Monitoring, Monitoring, Monitoring, Monitoring, MotorsCut]
        );
        assert_eq!(of_motor_cut(&[i, i, i, c, c, c])[2..], [Monitoring, Monitoring, Monitoring, InputsContradict]);
        assert_eq!(of_motor_cut(&[a, a, a, c, i, i, i])[2..], [MotorsCut, MotorsCut, MotorsCut, MotorsCut, Monitoring]);
    }

    #[test]
    fn a_pair_that_does_not_settle_is_a_contradiction_after_ten_samples() {
        let [i, a] = [Inactive, Active];
        // The input's value changes with every sample from the start.
        let chatter = [i, a, i, a, i, a, i, a, i, a];
        assert_eq!(of_motor_cut(&chatter)[8..], [Starting, InputsContradict]);
        // After the input has settled, at most two samples in a row agree until the end.
        let samples: Vec<Says> = [i, i, i].into_iter().chain([a, a, i, i, a, a, i, i, a, a, i, i, i]).collect();
        let states = of_motor_cut(&samples);
        assert_eq!(states[11], Monitoring, "the ninth");
        assert_eq!(states[12..], [InputsContradict, InputsContradict, InputsContradict, Monitoring]);
    }

    #[test]
    fn the_most_severe_input_that_is_not_inactive_decides() {
        let [i, a, c] = [Inactive, Active, Contradiction];
        for (says, state) in [
            ([i, i, i], Monitoring),
            ([a, i, i], SwitchedToRedundant),
            ([i, a, i], MotorsCut),
            ([i, i, a], EmergencyFired),
            ([a, a, i], MotorsCut),
            ([a, a, a], EmergencyFired),
            ([c, i, i], InputsContradict),
            ([c, a, i], MotorsCut),
            ([a, c, i], InputsContradict),
            ([c, c, a], EmergencyFired),
            ([a, a, c], InputsContradict),
        ] {
            assert_eq!(settled(says).state(true, true), state, "{says:?}");
            for (was_located, unlocated) in [(false, Starting), (true, PositionLost)] {
                let unlocated = if state == Monitoring { unlocated } else { state };
                assert_eq!(settled(says).state(was_located, false), unlocated, "{says:?}");
            }
        }
    }

    #[test]
    fn the_state_is_starting_until_each_pair_of_inputs_has_settled() {
        assert_eq!(StateInputs::new().state(true, true), Starting);
        assert_eq!(StateInputs::new().state(true, false), Starting);
        let mut inputs = StateInputs::new();
        for _ in 0..2 {
            inputs.sample([Active, Inactive, Inactive].map(levels));
        }
        inputs.sample([Active, Inactive, Active].map(levels));
        assert_eq!(inputs.state(true, true), SwitchedToRedundant, "the emergency measure's pair has not settled");
        let mut inputs = StateInputs::new();
        for _ in 0..2 {
            inputs.sample([Inactive; INPUTS].map(levels));
        }
        inputs.sample([Inactive, Inactive, Active].map(levels));
        assert_eq!(inputs.state(true, true), Starting);
    }

    fn says() -> impl Strategy<Value = Says> {
        prop_oneof![Just(Inactive), Just(Active), Just(Contradiction)]
    }

    proptest! {
        #[test]
        fn a_pair_follows_the_rule(samples in proptest::collection::vec(says(), 1..60)) {
            let mut pair = Pair::default();
            for (index, one) in samples.iter().enumerate() {
                pair.sample(*one);
                let so_far = &samples[..=index];
                let settled = so_far.windows(3).rposition(|three| three.iter().all(|one| *one == three[0]));
                let expected = match settled {
                    Some(at) if index - (at + 2) < 10 => Some(so_far[at]),
                    None if index + 1 < 10 => None,
                    _ => Some(Contradiction),
                };
                prop_assert_eq!(pair.taken, expected);
            }
        }
    }
}
