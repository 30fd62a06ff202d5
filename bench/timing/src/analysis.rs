//! Response times of tasks with fixed priorities, from execution times and arrivals: pure functions.
//!
//! The response time of a task is the time from its release to its end. Its bound is the least fixed point of `w = B +
//! C + interference(w)` (M. Joseph, P. Pandya, *Finding response times in a real-time system*, The Computer Journal 29
//! (5), 1986). C is the task's execution time, and B the longest time for which a less urgent task keeps it from
//! running. The interference is what more urgent tasks can demand in a window of the length w. Tasks of the same
//! priority count as more urgent, since any of them may be served first. A task that may be released again before it
//! has ended is looked at job by job until the processor is idle (J. P. Lehoczky, *Fixed priority scheduling of
//! periodic task sets with arbitrary deadlines*, RTSS 1990).
//!
//! All times are in one unit, here ns.

/// An upper bound of a task's releases: at most `most` in any window of the length `within`, and each at least `apart`
/// after the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrivals {
    /// The greatest number of releases in a window, at least 1.
    pub most: u64,
    /// The length of the window, above 0.
    pub within: u64,
    /// The shortest time between two releases, above 0.
    pub apart: u64,
}

impl Arrivals {
    /// Returns the arrivals of a task whose releases are at least `period` apart.
    #[must_use]
    pub const fn every(period: u64) -> Self {
        Self { most: 1, within: period, apart: period }
    }

    /// Returns the greatest number of releases in a half-open window of this length.
    #[must_use]
    pub const fn count(self, window: u64) -> u64 {
        let (whole, rest) = (window / self.within, window % self.within);
        let burst = rest.div_ceil(self.apart);
        whole * self.most + if burst < self.most { burst } else { self.most }
    }

    /// Returns the earliest time of release `number` (from 0), counted from the first release.
    const fn earliest(self, number: u64) -> u64 {
        let (whole, rest) = (number / self.most, number % self.most);
        whole * self.within + rest * self.apart
    }
}

/// The greatest execution time that a group of tasks demands in any window of a length, as a staircase.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Curve {
    /// The width of a step, above 0.
    pub step: u64,
    /// For each step, the execution time that a window up to the end of this step demands. The values never fall.
    pub demands: Vec<u64>,
}

impl Curve {
    /// Returns the greatest demand in a window of this length; `None` beyond the last step.
    #[must_use]
    pub fn demand(&self, window: u64) -> Option<u64> {
        if window == 0 {
            return Some(0);
        }
        self.demands.get(usize::try_from((window - 1) / self.step).ok()?).copied()
    }
}

/// What delays a task, besides its own execution and blocking by less urgent code.
#[derive(Clone, Copy, Debug)]
pub enum Interference<'a> {
    /// Another task, with its arrivals and its execution time. Its releases may be late by up to `jitter`.
    Task {
        /// The arrivals without jitter.
        arrivals: Arrivals,
        /// How late a release may come.
        jitter: u64,
        /// The execution time of a job.
        cost: u64,
    },
    /// A group of tasks, with its demand in a window. `jitter` extends the window.
    Curve {
        /// The demand.
        curve: &'a Curve,
        /// The extension of the window.
        jitter: u64,
    },
}

impl Interference<'_> {
    fn demand(&self, window: u64) -> Option<u64> {
        match *self {
            Self::Task { arrivals, jitter, cost } => arrivals.count(window.saturating_add(jitter)).checked_mul(cost),
            Self::Curve { curve, jitter } => curve.demand(window.checked_add(jitter)?),
        }
    }
}

/// Returns the bound of the response time of a task with the execution time `cost`, which less urgent code blocks for
/// up to `blocking`. `own` has the arrivals of a task that may be released before it has ended. Without a bound up to
/// `limit`, the result is `None`.
#[must_use]
pub fn response(
    cost: u64,
    blocking: u64,
    own: Option<Arrivals>,
    interference: &[Interference<'_>],
    limit: u64,
) -> Option<u64> {
    if own.is_some_and(|own| overloads(own, cost, interference)) {
        return None;
    }
    let mut worst = 0;
    for job in 0.. {
        let released = own.map_or(0, |own| own.earliest(job));
        let work = blocking.checked_add(cost.checked_mul(job + 1)?)?;
        let ended = fixed_point(work, interference, limit.checked_add(released)?)?;
        worst = worst.max(ended.saturating_sub(released));
        if own.is_none_or(|own| ended <= own.earliest(job + 1)) {
            break;
        }
    }
    Some(worst)
}

fn fixed_point(work: u64, interference: &[Interference<'_>], limit: u64) -> Option<u64> {
    let mut window = work;
    while window <= limit {
        let demands = interference.iter().map(|it| it.demand(window)).sum::<Option<u64>>()?;
        let next = work.checked_add(demands)?;
        if next == window {
            return Some(window);
        }
        window = next;
    }
    None
}

/// Returns whether these tasks demand more than the whole processor. If so, there is no bound.
fn overloads(own: Arrivals, cost: u64, interference: &[Interference<'_>]) -> bool {
    let share = |arrivals: Arrivals, cost: u64| (arrivals.most * cost) as f64 / arrivals.within as f64;
    let others = interference.iter().map(|it| match *it {
        Interference::Task { arrivals, cost, .. } => share(arrivals, cost),
        Interference::Curve { .. } => 0.0,
    });
    share(own, cost) + others.sum::<f64>() > 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn task(period: u64, cost: u64) -> Interference<'static> {
        Interference::Task { arrivals: Arrivals::every(period), jitter: 0, cost }
    }

    /// A. Burns, A. Wellings, *Real-Time Systems and Programming Languages*, chapter "Scheduling", response-time
    /// analysis: three tasks (period, execution) = (7, 3), (12, 3), (20, 5) respond within 3, 6 and 20.
    #[test]
    fn burns_and_wellings_three_tasks_respond_within_3_6_and_20() {
        let tasks = [(7, 3), (12, 3), (20, 5)];
        let found: Vec<_> = (0..3)
            .map(|at| {
                let above: Vec<_> = tasks[..at].iter().map(|&(period, cost)| task(period, cost)).collect();
                response(tasks[at].1, 0, Some(Arrivals::every(tasks[at].0)), &above, 1_000)
            })
            .collect();
        assert_eq!(found, [Some(3), Some(6), Some(20)]);
    }

    /// The same book's task set A: (50, 12), (40, 10), (30, 10), of which the first, least urgent, misses its deadline.
    #[test]
    fn an_unschedulable_set_has_a_bound_above_its_deadline_or_none() {
        let above = [task(30, 10), task(40, 10)];
        assert_eq!(response(12, 0, None, &above, 50), None);
        assert_eq!(response(12, 0, None, &above, 60), Some(52));
    }

    /// J. P. Lehoczky, RTSS 1990: tasks (70, 26) and (100, 62). The jobs of the second take 114, 102, 116, 104, 118,
    /// 106 and 94, so its first job is not its worst.
    #[test]
    fn lehoczkys_second_task_responds_worst_in_its_fifth_job() {
        assert_eq!(response(62, 0, Some(Arrivals::every(100)), &[task(70, 26)], 1_000), Some(118));
        assert_eq!(response(62, 0, None, &[task(70, 26)], 1_000), Some(114));
    }

    #[test]
    fn a_period_shorter_than_its_execution_has_no_bound() {
        assert_eq!(response(10, 0, Some(Arrivals::every(9)), &[], u64::MAX / 4), None);
        assert_eq!(response(1, 0, None, &[task(9, 10)], 1_000_000), None);
        assert_eq!(response(10, 0, Some(Arrivals::every(10)), &[], 1_000), Some(10));
    }

    #[test]
    fn blocking_and_jitter_delay_a_task() {
        assert_eq!(response(3, 4, None, &[task(20, 5)], 100), Some(12));
        let late = Interference::Task { arrivals: Arrivals::every(20), jitter: 12, cost: 5 };
        assert_eq!(response(3, 4, None, &[late], 100), Some(17));
    }

    #[test]
    fn a_burst_counts_by_its_gap_and_then_by_its_window() {
        let burst = Arrivals { most: 3, within: 100, apart: 10 };
        let counts = [0, 1, 10, 11, 21, 31, 100, 101, 111, 200].map(|window| burst.count(window));
        assert_eq!(counts, [0, 1, 1, 2, 3, 3, 3, 4, 5, 6]);
        assert_eq!([0, 1, 2, 3, 4].map(|number| burst.earliest(number)), [0, 10, 20, 100, 110]);
    }

    #[test]
    fn beyond_its_last_step_a_curve_gives_no_bound() {
        let curve = Curve { step: 10, demands: vec![4, 4, 9] };
        assert_eq!(
            [0, 1, 10, 11, 30].map(|window| curve.demand(window)),
            [Some(0), Some(4), Some(4), Some(4), Some(9)]
        );
        assert_eq!(curve.demand(31), None);
        let with = |cost| response(cost, 0, None, &[Interference::Curve { curve: &curve, jitter: 0 }], 1_000);
        assert_eq!((with(5), with(17), with(30)), (Some(9), Some(26), None));
    }
}
