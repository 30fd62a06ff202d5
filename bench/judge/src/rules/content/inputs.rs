//! Judges whether the state that HORUS reports agrees with the pins from which HORUS reads it.
//!
//! This module is written from decision 18. HORUS has three inputs, each a pair of pins that HORUS samples once per
//! cycle, within [`bounds::SAMPLED_AFTER_TICK`] after the tick. HORUS accepts a reading after three equal samples in a
//! row, and a contradiction after ten samples without three equal ones in a row.
//!
//! In the next cycle, Reported-Position shows the state that follows from the accepted readings. The most severe input
//! that is not inactive determines this state.
//!
//! If the pins of an input change while HORUS may sample them, the judge allows every outcome. After an irregular tick
//! the number of samples is unknown, so the judge requires nothing until later samples determine the reading.

use std::collections::VecDeque;

use profile::HorusState;

use crate::bounds;

/// The number of inputs: relay, motor cut, emergency measure.
const INPUTS: usize = 3;
/// The number of samples that can determine a reading: HORUS waits for at most ten samples, and compares three in a
/// row.
const SAMPLES: usize = 12;
/// The greatest number of uncertain samples that are judged; more would have too many outcomes.
const MOST_UNSURE: usize = 6;

/// The reading of a pair of pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Says {
    Inactive,
    Active,
    Contradiction,
}

#[derive(Clone, Debug)]
struct Pair {
    now: Says,
    /// The readings of the input's pins since the last tick. The first is that at the tick; each later one has the
    /// instant, ns, at which it began.
    since_tick: Vec<(u64, Says)>,
    /// For each of the last [`SAMPLES`] samples of the input's pins, the readings that it may have had.
    samples: VecDeque<Vec<Says>>,
}

#[derive(Clone, Debug)]
pub(super) struct Inputs {
    pairs: [Pair; INPUTS],
    tick: Option<u64>,
    /// Whether `samples` contains every sample since HORUS's start.
    from_start: bool,
}

impl Inputs {
    /// Returns the state in which every input is inactive.
    pub(super) fn new() -> Self {
        let pair = |_| Pair { now: Says::Inactive, since_tick: vec![], samples: VecDeque::new() };
        Self { pairs: std::array::from_fn(pair), tick: None, from_start: true }
    }

    /// Records the levels of an input's pins from the instant `at` on, ns. The pin `active` is high while the input is
    /// active, and the pin `inactive` while it is inactive.
    pub(super) fn levels(&mut self, at: u64, input: usize, active: bool, inactive: bool) {
        let Some(pair) = self.pairs.get_mut(input) else { return };
        pair.now = match (active, inactive) {
            (false, true) => Says::Inactive,
            (true, false) => Says::Active,
            _ => Says::Contradiction,
        };
        pair.since_tick.push((at, pair.now));
    }

    pub(super) fn forget(&mut self) {
        for pair in &mut self.pairs {
            pair.since_tick.clear();
            pair.samples.clear();
        }
        (self.tick, self.from_start) = (None, true);
    }

    /// Records a tick of HORUS. The tick is `irregular` if it is not the first and does not come one cycle after the
    /// tick before.
    pub(super) fn tick(&mut self, at: u64, irregular: bool) {
        for pair in &mut self.pairs {
            if irregular {
                pair.samples.clear();
            } else if let Some(tick) = self.tick {
                let sampled = pair.since_tick.iter().filter(|(from, _)| *from <= tick + bounds::SAMPLED_AFTER_TICK);
                let mut says: Vec<Says> = vec![];
                for (_, one) in sampled {
                    if !says.contains(one) {
                        says.push(*one);
                    }
                }
                pair.samples.push_back(says);
                if pair.samples.len() > SAMPLES {
                    pair.samples.pop_front();
                }
            }
            pair.since_tick = vec![(at, pair.now)];
        }
        self.from_start &= !irregular;
        self.tick = Some(at);
    }

    /// Returns whether HORUS has certainly accepted a reading of each input. Only then must HORUS report `Monitoring`
    /// once it has a position.
    pub(super) fn is_known(&self) -> bool {
        self.pairs.iter().all(|pair| pair.taken(self.from_start).is_some_and(|taken| !taken.contains(&None)))
    }

    /// Returns, in words, why HORUS's state cannot be `state`.
    pub(super) fn wrong(&self, state: Option<HorusState>) -> Option<String> {
        let mut taken = [const { vec![] }; INPUTS];
        for (pair, taken) in self.pairs.iter().zip(&mut taken) {
            *taken = pair.taken(self.from_start)?;
        }
        let mut allowed = vec![];
        for relay in &taken[0] {
            for motors in &taken[1] {
                for emergency in &taken[2] {
                    allowed.extend(shown([*emergency, *motors, *relay]));
                }
            }
        }
        let right = state.is_some_and(|state| allowed.contains(&state));
        (!right).then(|| format!("HORUS's state is {state:?}, and its inputs say {taken:?}"))
    }
}

/// Returns the states that HORUS may report for these accepted readings. The first input is the most severe.
fn shown(taken: [Option<Says>; INPUTS]) -> Vec<HorusState> {
    let active = [HorusState::EmergencyFired, HorusState::MotorsCut, HorusState::SwitchedToRedundant];
    for (taken, active) in taken.into_iter().zip(active) {
        match taken {
            Some(Says::Active) => return vec![active],
            Some(Says::Contradiction) => return vec![HorusState::InputsContradict],
            Some(Says::Inactive) | None => {}
        }
    }
    if taken.contains(&None) {
        return vec![HorusState::Starting];
    }
    // `Starting`, `Monitoring` and `PositionLost` depend on the voted position, not on an input.
    vec![HorusState::Starting, HorusState::Monitoring, HorusState::PositionLost]
}

impl Pair {
    /// Returns the readings that HORUS may have accepted. An entry is `None` if HORUS may have accepted no reading yet.
    /// Returns `None` if the possible readings are not known.
    fn taken(&self, from_start: bool) -> Option<Vec<Option<Says>>> {
        if self.samples.iter().filter(|says| says.len() > 1).count() > MOST_UNSURE {
            return None;
        }
        let mut sequences: Vec<Vec<Says>> = vec![vec![]];
        for says in &self.samples {
            sequences = sequences
                .iter()
                .flat_map(|sequence| says.iter().map(move |one| [sequence.as_slice(), &[*one]].concat()))
                .collect();
        }
        let mut taken = vec![];
        for sequence in sequences {
            let three = sequence.windows(3).rposition(|three| three.iter().all(|one| *one == three[0]));
            let one = match three {
                Some(at) => Some(sequence[at]),
                None if from_start && sequence.len() < 10 => None,
                None if !from_start && sequence.len() < SAMPLES => return None,
                _ => Some(Says::Contradiction),
            };
            if !taken.contains(&one) {
                taken.push(one);
            }
        }
        Some(taken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use HorusState::{EmergencyFired, InputsContradict, Monitoring, MotorsCut, Starting, SwitchedToRedundant};

    const MS: u64 = 1_000_000;
    const ALL: [HorusState; 8] = [
        Starting,
        Monitoring,
        HorusState::OutsideRange,
        SwitchedToRedundant,
        MotorsCut,
        EmergencyFired,
        InputsContradict,
        HorusState::PositionLost,
    ];

    fn allowed(input: usize, levels: &[(f64, bool, bool)], ticks: u64) -> Vec<Vec<HorusState>> {
        let mut state = Inputs::new();
        let mut levels = levels.iter().peekable();
        let mut after = |tick: u64| {
            while let Some((at, active, inactive)) = levels.next_if(|(at, ..)| *at < (tick / MS) as f64) {
                state.levels((at * 1e6) as u64, input, *active, *inactive);
            }
            state.tick(tick, false);
            ALL.into_iter().filter(|one| state.wrong(Some(*one)).is_none()).collect()
        };
        (0..ticks).map(|number| after(100 * MS + number * bounds::CYCLE)).collect()
    }

    const SOUND: [HorusState; 3] = [Starting, Monitoring, HorusState::PositionLost];

    #[test]
    fn horus_is_starting_until_it_has_three_samples_of_its_inputs() {
        assert_eq!(allowed(0, &[], 5), [vec![Starting], vec![Starting], vec![Starting], SOUND.into(), SOUND.into()]);
        let mut state = Inputs::new();
        let known = (0..5).map(|number| {
            state.tick(number * bounds::CYCLE, false);
            state.is_known()
        });
        assert_eq!(known.collect::<Vec<_>>(), [false, false, false, true, true]);
        assert!(state.wrong(None).is_some(), "a state without a meaning");
    }

    #[test]
    fn an_active_input_shows_three_samples_later() {
        for (input, of) in [(0, SwitchedToRedundant), (1, MotorsCut), (2, EmergencyFired)] {
            let shown = allowed(input, &[(145.0, true, false)], 10);
            assert_eq!(shown[7], SOUND);
            assert_eq!(shown[8..], [[of], [of]]);
            // The pins change after the tick and before the end of the sampling, so the sample may have either level.
            let shown = allowed(input, &[(150.1, true, false)], 10);
            assert_eq!(shown[7], SOUND);
            assert_eq!(shown[8], [Starting, Monitoring, of, HorusState::PositionLost]);
            assert_eq!(shown[9], [of]);
        }
    }

    #[test]
    fn a_contradiction_shows_as_one_and_what_is_short_does_not() {
        assert_eq!(allowed(1, &[(145.0, true, true)], 9)[8], [InputsContradict]);
        assert_eq!(allowed(1, &[(145.0, false, false)], 9)[8], [InputsContradict]);
        let short = allowed(1, &[(145.0, true, false), (165.0, false, true)], 20);
        assert!(short[3..].iter().all(|shown| *shown == SOUND), "{short:?}");
    }

    #[test]
    fn a_pair_that_does_not_settle_is_a_contradiction_after_ten_samples() {
        let chatter: Vec<(f64, bool, bool)> =
            (0..20).map(|n| (95.0 + 10.0 * f64::from(n), n % 2 == 0, n % 2 != 0)).collect();
        let shown = allowed(1, &chatter, 15);
        assert_eq!(shown[9], [Starting]);
        assert_eq!(shown[10..14], [[InputsContradict], [InputsContradict], [InputsContradict], [InputsContradict]]);
    }

    #[test]
    fn a_settled_pair_that_chatters_is_a_contradiction_after_ten_samples() {
        // The input is inactive at ticks 0 to 4. From tick 5 on no three samples in a row are equal.
        let chatter: Vec<(f64, bool, bool)> =
            (0..12).map(|n| (145.0 + 20.0 * f64::from(n), n % 2 == 0, n % 2 != 0)).collect();
        let shown = allowed(1, &chatter, 17);
        assert_eq!(shown[14], SOUND, "nine samples after");
        assert_eq!(shown[15..], [[InputsContradict], [InputsContradict]]);
    }

    #[test]
    fn a_pair_with_too_many_possible_samples_is_not_judged() {
        // From tick 5 on the input's pins may change before or after each sample. Six such samples have 64 outcomes;
        // seven are too many to judge.
        let changes = |count: u32| -> Vec<(f64, bool, bool)> {
            (0..count).map(|n| (150.2 + 10.0 * f64::from(n), n % 2 == 0, n % 2 != 0)).collect()
        };
        assert!(allowed(1, &changes(6), 12)[11].len() < ALL.len());
        assert_eq!(allowed(1, &changes(7), 13)[12], ALL);
    }

    #[test]
    fn after_an_irregular_tick_nothing_is_asked_until_the_pair_has_settled() {
        let mut state = Inputs::new();
        for number in 0..5 {
            state.tick(number * bounds::CYCLE, false);
        }
        state.tick(47 * MS, true);
        for number in 0..4 {
            assert_eq!(state.wrong(Some(MotorsCut)).is_none(), number < 3, "{number}");
            state.tick((57 + 10 * number) * MS, false);
        }
        state.forget();
        state.tick(200 * MS, false);
        assert!(state.wrong(Some(Starting)).is_none() && state.wrong(Some(Monitoring)).is_some());
    }

    #[test]
    fn a_chattering_pair_contradicts_twelve_samples_after_an_irregular_tick() {
        let mut state = Inputs::new();
        state.tick(0, true);
        for number in 1..=12_u64 {
            assert!(state.wrong(Some(MotorsCut)).is_none(), "{number}: nothing is asked yet");
            state.levels(number * bounds::CYCLE - MS, 1, number % 2 == 0, number % 2 != 0);
            state.tick(number * bounds::CYCLE, false);
            state.levels(number * bounds::CYCLE, 1, number % 2 == 0, number % 2 != 0);
        }
        state.tick(13 * bounds::CYCLE, false);
        assert!(state.wrong(Some(InputsContradict)).is_none() && state.wrong(Some(MotorsCut)).is_some());
    }

    #[test]
    fn the_most_severe_input_that_is_not_inactive_is_shown() {
        let [i, a, c] = [Says::Inactive, Says::Active, Says::Contradiction].map(Some);
        assert_eq!(shown([a, c, c]), [EmergencyFired]);
        assert_eq!(shown([i, a, c]), [MotorsCut]);
        assert_eq!(shown([i, i, a]), [SwitchedToRedundant]);
        assert_eq!(shown([c, a, a]), [InputsContradict]);
        assert_eq!(shown([None, i, a]), [SwitchedToRedundant]);
        assert_eq!(shown([None, i, i]), [Starting]);
        assert_eq!(shown([i, i, i]), SOUND);
    }
}
