//! The outcome of a campaign, or of a part of it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};

use super::bound::clopper_pearson;
use super::class::Class;
use super::scope::Scope;
use super::trial::Trial;

/// A part of a campaign: every `of`-th trial, from the `part`-th on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Shard {
    /// The number of the part, 1 to `of`.
    pub part: u64,
    /// The number of parts.
    pub of: u64,
}

impl Shard {
    /// The whole campaign.
    pub const WHOLE: Self = Self { part: 1, of: 1 };

    /// Whether the trial `number` belongs to this part.
    #[must_use]
    pub const fn has(self, number: u64) -> bool {
        number % self.of == self.part % self.of
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(part, of)| Some((part.parse().ok()?, of.parse().ok()?)));
        match parts {
            Some((part, of)) if (1..=of).contains(&part) => Ok(Self { part, of }),
            _ => Err("expected I/K, the I-th of K parts, such as 2/8".to_owned()),
        }
    }
}

/// What became of the faults of one row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// The number of trials without an injected fault; no other counter includes them.
    pub void: u64,
    /// The number of masked faults.
    pub masked: u64,
    /// The number of recovered faults.
    pub recovered: u64,
    /// The number of faults that left the flight controller without a position, as its client reported.
    pub stopped: u64,
    /// The number of dangerous faults.
    pub dangerous: u64,
    /// The number of faults, other than upsets, for which the judge found a violation that misleads nobody.
    pub broken: u64,
    /// The number of cycles of HORUS in all trials of the row.
    pub cycles: u64,
    /// The number of the flight controller's transactions.
    pub readings: u64,
}

impl Counts {
    /// The number of injected faults.
    #[must_use]
    pub const fn injected(&self) -> u64 {
        self.masked + self.recovered + self.stopped + self.dangerous
    }

    fn add(&mut self, other: &Self) {
        self.void += other.void;
        self.masked += other.masked;
        self.recovered += other.recovered;
        self.stopped += other.stopped;
        self.dangerous += other.dangerous;
        self.broken += other.broken;
        self.cycles += other.cycles;
        self.readings += other.readings;
    }
}

/// The outcome of a campaign, or of some of its parts. It has no times and no number of threads, so two runs of the
/// same campaign are equal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally {
    /// The command line's options that determine the trials.
    pub scope: String,
    /// The least number of cycles of the whole campaign.
    pub cycles: u64,
    /// The parts that have been run.
    pub parts: BTreeSet<Shard>,
    /// What became of the faults of each row.
    pub rows: BTreeMap<String, Counts>,
    /// A description of each trial with a dangerous fault, or with a violation after a fault that is no upset, by the
    /// trial's number.
    pub found: BTreeMap<u64, String>,
}

/// The reason why two outcomes cannot be joined.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// They are of different campaigns.
    #[error("they are parts of different campaigns: {0}, and {1}")]
    Different(String, String),
    /// Both have the same part.
    #[error("both have part {} of {}", .0.part, .0.of)]
    Twice(Shard),
    /// The campaigns were divided into different numbers of parts.
    #[error("one campaign was cut into {0} parts, the other into {1}")]
    Cut(u64, u64),
}

impl Tally {
    pub(super) fn of(scope: &Scope, cycles: u64, shard: Shard, trials: &[Trial]) -> Self {
        let parts = BTreeSet::from([shard]);
        let mut tally = Self { scope: scope.to_string(), cycles, parts, rows: BTreeMap::new(), found: BTreeMap::new() };
        trials.iter().for_each(|trial| tally.take(trial));
        tally
    }

    fn take(&mut self, trial: &Trial) {
        let counts = self.rows.entry(trial.row.clone()).or_default();
        counts.cycles += trial.cycles;
        counts.readings += trial.readings;
        let is_broken = !trial.is_upset && !trial.violations.is_empty() && trial.class != Class::Dangerous;
        counts.broken += u64::from(is_broken);
        let count = match trial.class {
            _ if !trial.injected => &mut counts.void,
            Class::Masked => &mut counts.masked,
            Class::Recovered => &mut counts.recovered,
            Class::Stopped => &mut counts.stopped,
            Class::Dangerous => &mut counts.dangerous,
        };
        *count += 1;
        if trial.class == Class::Dangerous || is_broken {
            self.found.insert(trial.number, trial.to_string());
        }
    }

    /// Joins the outcome of other parts of the campaign to this outcome.
    ///
    /// # Errors
    ///
    /// [`MergeError`] if `other` belongs to another campaign, or if both have the same part.
    pub fn merge(&mut self, other: Self) -> Result<(), MergeError> {
        if (&self.scope, self.cycles) != (&other.scope, other.cycles) {
            let words = |tally: &Self| format!("--cycles {} {}", tally.cycles, tally.scope);
            return Err(MergeError::Different(words(self), words(&other)));
        }
        if let (Some(one), Some(another)) = (self.parts.first(), other.parts.first())
            && one.of != another.of
        {
            return Err(MergeError::Cut(one.of, another.of));
        }
        if let Some(twice) = self.parts.intersection(&other.parts).next() {
            return Err(MergeError::Twice(*twice));
        }
        self.parts.extend(other.parts);
        for (row, counts) in &other.rows {
            self.rows.entry(row.clone()).or_default().add(counts);
        }
        self.found.extend(other.found);
        if self.parts.first().is_some_and(|first| first.of == self.parts.len() as u64) {
            self.parts = BTreeSet::from([Shard::WHOLE]);
        }
        Ok(())
    }

    /// The sum of all rows.
    #[must_use]
    pub fn sum(&self) -> Counts {
        let mut sum = Counts::default();
        self.rows.values().for_each(|counts| sum.add(counts));
        sum
    }

    /// Returns each reason why the campaign's outcome is worthless, as a sentence.
    #[must_use]
    pub fn flaws(&self) -> Vec<String> {
        let mut flaws = vec![];
        if self.rows.is_empty() {
            flaws.push("no fault was tried".to_owned());
        }
        for (row, counts) in &self.rows {
            if counts.injected() == 0 {
                flaws.push(format!("no fault of {row} was injected"));
            }
            if counts.readings == 0 {
                flaws.push(format!("the flight controller read nothing beside faults of {row}"));
            }
        }
        flaws
    }

    /// Whether the campaign has no flaw, no dangerous fault and, except for upsets, no violation.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.found.is_empty() && self.flaws().is_empty()
    }

    /// The outcome as a table in Markdown, with the rate of dangerous faults and its confidence interval.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = "| fault | injected | masked | recovered | stopped | dangerous | rate of dangerous, 95 % |\n\
                        |---|---|---|---|---|---|---|\n"
            .to_owned();
        let sum = ("all".to_owned(), self.sum());
        for (row, counts) in self.rows.iter().chain(std::iter::once((&sum.0, &sum.1))) {
            let Counts { masked, recovered, stopped, dangerous, .. } = counts;
            let injected = counts.injected();
            let rate = rate(*dangerous, injected);
            text += &format!("| {row} | {injected} | {masked} | {recovered} | {stopped} | {dangerous} | {rate} |\n");
        }
        text
    }
}

/// Returns a rate in per cent with its interval at 95 %.
fn rate(seen: u64, tried: u64) -> String {
    let (low, high) = clopper_pearson(seen, tried);
    let per_cent = |rate: f64| format!("{:.3}", 100.0 * rate);
    let upper = per_cent(high);
    if seen == 0 {
        return format!("0 %, at most {upper} %");
    }
    format!("{} % ({} to {upper} %)", per_cent(seen as f64 / tried as f64), per_cent(low))
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sum = self.sum();
        let parts: Vec<String> = self.parts.iter().map(|Shard { part, of }| format!("{part}/{of}")).collect();
        let (cycles, readings, void, broken) = (sum.cycles, sum.readings, sum.void, sum.broken);
        writeln!(f, "{}", self.table())?;
        writeln!(
            f,
            "parts {}: {cycles} cycles, {readings} readings; {void} faults that found nothing to disturb; {broken} \
             broken rules that mislead nobody",
            parts.join(" ")
        )?;
        for (number, words) in &self.found {
            writeln!(f, "{words}\n    cargo xtask campaign {} --trial {number}", self.scope)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use emulator_node::Clock;

    use super::*;
    use crate::faults::Kind;

    fn scope() -> Scope {
        Scope { kinds: vec![Kind::Air, Kind::Ram], seed: 7, gps: 3, clock: Clock::Fast, bit_error: 1e-4, seconds: 20 }
    }

    fn trial(number: u64, class: Class) -> Trial {
        let is_upset = number.is_multiple_of(2);
        Trial {
            number,
            row: if is_upset { "ram dpr" } else { "air" }.to_owned(),
            is_upset,
            at: 1_500_000,
            fault: "a fault".to_owned(),
            cycles: 40,
            readings: 100,
            injected: true,
            class,
            violations: if class == Class::Dangerous { vec!["old data shown after new".to_owned()] } else { vec![] },
        }
    }

    fn classes(number: u64) -> Class {
        Class::ALL[(number / 2 % 4) as usize]
    }

    fn tally(shard: Shard) -> Tally {
        let trials: Vec<Trial> =
            (1..=24).filter(|number| shard.has(*number)).map(|number| trial(number, classes(number))).collect();
        Tally::of(&scope(), 900, shard, &trials)
    }

    #[test]
    fn merged_parts_equal_the_whole_in_any_order() {
        let part = |part| tally(Shard { part, of: 3 });
        for order in [[1, 2, 3], [3, 1, 2]] {
            let mut merged = part(order[0]);
            merged.merge(part(order[1])).unwrap();
            assert_ne!(merged, tally(Shard::WHOLE));
            merged.merge(part(order[2])).unwrap();
            assert_eq!(merged, tally(Shard::WHOLE));
        }
    }

    #[test]
    fn parts_of_other_campaigns_and_parts_twice_are_refused() {
        let part = |part, of| tally(Shard { part, of });
        let merge = |one: Tally, other| one.clone().merge(other);
        assert!(matches!(merge(part(1, 2), part(1, 2)), Err(MergeError::Twice(Shard { part: 1, of: 2 }))));
        assert!(matches!(merge(part(1, 2), part(2, 3)), Err(MergeError::Cut(2, 3))));
        let other = Tally { cycles: 901, ..part(2, 2) };
        assert!(matches!(merge(part(1, 2), other), Err(MergeError::Different(..))));
        let other = Tally::of(&Scope { seed: 8, ..scope() }, 900, Shard { part: 2, of: 2 }, &[]);
        assert!(matches!(merge(part(1, 2), other), Err(MergeError::Different(..))));
    }

    #[test]
    fn every_class_is_counted_in_its_row() {
        let tally = tally(Shard::WHOLE);
        let expected = Counts {
            masked: 3,
            recovered: 3,
            stopped: 3,
            dangerous: 3,
            cycles: 480,
            readings: 1_200,
            ..Counts::default()
        };
        assert_eq!(tally.rows["air"], expected);
        assert_eq!(tally.rows["ram dpr"], expected);
        assert_eq!((tally.sum().injected(), tally.sum().cycles, tally.sum().readings), (24, 960, 2_400));
        assert_eq!(tally.found.len(), 6);
    }

    #[test]
    fn a_fault_that_was_not_injected_is_void_and_not_masked() {
        let trials = [Trial { injected: false, ..trial(1, Class::Masked) }];
        let tally = Tally::of(&scope(), 40, Shard::WHOLE, &trials);
        assert_eq!(tally.rows["air"].void, 1);
        assert_eq!(tally.sum().injected(), 0);
        assert_eq!(tally.flaws(), ["no fault of air was injected"]);
        assert!(!tally.is_clean());
    }

    #[test]
    fn merged_parts_sum_up_void_faults_and_broken_rules() {
        let broken = |number| Trial { violations: vec!["no frame".to_owned()], ..trial(number, Class::Recovered) };
        let void = |number| Trial { injected: false, ..trial(number, Class::Masked) };
        let part = |part, trials: &[Trial]| Tally::of(&scope(), 40, Shard { part, of: 2 }, trials);
        let mut merged = part(1, &[broken(1), void(3)]);
        merged.merge(part(2, &[broken(5), broken(7), void(9), void(11), void(2)])).unwrap();
        let counts = |row: &str| (merged.rows[row].broken, merged.rows[row].void);
        assert_eq!((counts("air"), counts("ram dpr")), ((3, 3), (0, 1)));
        assert_eq!((merged.sum().broken, merged.sum().void), (3, 4));
    }

    #[test]
    fn a_campaign_in_which_nothing_was_read_or_tried_fails() {
        let trials = [Trial { readings: 0, ..trial(1, Class::Masked) }];
        let flaws = Tally::of(&scope(), 40, Shard::WHOLE, &trials).flaws();
        assert_eq!(flaws, ["the flight controller read nothing beside faults of air"]);
        assert_eq!(Tally::of(&scope(), 0, Shard::WHOLE, &[]).flaws(), ["no fault was tried"]);
    }

    #[test]
    fn a_broken_rule_is_found_except_beside_an_upset() {
        let broken = |number| Trial { violations: vec!["no frame".to_owned()], ..trial(number, Class::Recovered) };
        let tally = Tally::of(&scope(), 40, Shard::WHOLE, &[broken(1), broken(2), trial(3, Class::Stopped)]);
        assert_eq!(tally.found.keys().copied().collect::<Vec<_>>(), [1]);
        assert_eq!((tally.rows["air"].broken, tally.rows["ram dpr"].broken), (1, 0));
        assert!(!tally.is_clean());
        assert!(Tally::of(&scope(), 40, Shard::WHOLE, &[broken(2)]).is_clean());
    }

    #[test]
    fn a_dangerous_trial_prints_the_command_that_repeats_it() {
        let text = Tally::of(&scope(), 40, Shard::WHOLE, &[trial(6, Class::Dangerous)]).to_string();
        let repeat = "cargo xtask campaign --seed 7 --gps 3 --clock fast --seconds 20 --kinds air,ram \
                      --bit-error-rate 0.0001 --trial 6";
        assert!(text.contains(repeat), "{text}");
        assert!(
            text.contains("trial 6, ram dpr, at 1.500000 ms: a fault: dangerous: old data shown after new"),
            "{text}"
        );
        assert!(text.contains("| ram dpr | 1 | 0 | 0 | 0 | 1 | 100.000 % (2.500 to 100.000 %) |"), "{text}");
    }

    #[test]
    fn parts_have_every_trial_once() {
        for of in 1..5 {
            for number in 1..=20 {
                assert_eq!((1..=of).filter(|part| Shard { part: *part, of }.has(number)).count(), 1);
            }
        }
        assert_eq!("2/8".parse(), Ok(Shard { part: 2, of: 8 }));
        for wrong in ["0/2", "3/2", "1", "1/", "a/b", "1/0"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }
}
