//! Observes a processor by the events that determine which exception runs. Measures execution times, response times,
//! masked sections and demands.

use std::collections::{BTreeMap, VecDeque};

use cortex_m4::Scheduled;

use crate::analysis::Curve;

/// The priority number of code outside exceptions, the least urgent.
const THREAD: i16 = 256;

/// The number of steps of each measured demand curve.
const STEPS: u64 = 256;

/// A task that is observed.
#[derive(Clone, Debug)]
pub struct Watched {
    /// The number of the task's exception.
    pub exception: u16,
    /// The priority of the task's exception; a lower number is more urgent.
    pub priority: i16,
    /// The number of the task's group: all tasks that follow from one chain of causes.
    pub group: usize,
    /// The length, ns, of the windows in which releases of the task are counted.
    pub within: u64,
    /// The longest window, ns, in which the demand of the task's group is measured, from a release of the task on.
    pub horizon: u64,
    /// Whether the task is a step of a driver that has only one transfer or wait at a time. If so, transfers and waits
    /// that begin after the task's end cannot delay the task.
    pub is_step: bool,
    /// Whether the task is called at the end of each transfer or wait of a driver that has only one at a time.
    pub is_stepped: bool,
    /// An exception that tells a job of this task from a job of another task with the same vector. It became pending
    /// together with the task's own exception.
    pub together: Option<u16>,
}

/// The observations of a task. Times are in ns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// The number of jobs that ended.
    pub jobs: u64,
    /// The longest execution time of the handler, without preemption, exception entry and return.
    pub body: u64,
    /// The longest time from a release to the handler's end.
    pub response: u64,
    /// The greatest number of releases of the task in a window of [`Watched::within`].
    pub most: u64,
    /// The shortest time between two releases; 0 with fewer than two.
    pub apart: u64,
    /// The longest time for which the released task did not run although no more urgent code ran.
    pub blocked: u64,
    /// The greatest demand of those tasks of the group that can delay this task. The demand is measured in windows that
    /// begin with a release of this task.
    pub own: Curve,
}

/// A kind of masked section: the task that masks (by its index, `None` for other code), the masked priority, and
/// whether PRIMASK masks it.
pub type Masking = (Option<usize>, i16, bool);

/// The observations of a board.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Observations {
    /// The observations of each task, in the order of [`Observer::new`].
    pub tasks: Vec<Seen>,
    /// The longest exception entry.
    pub entry: u64,
    /// The longest exception return.
    pub exit: u64,
    /// The longest section of each kind, without preemption, ns.
    pub masked: BTreeMap<Masking, u64>,
    /// The greatest demand, in any window, of a group's tasks that have at least a priority. The key has the group and
    /// the priority.
    pub groups: BTreeMap<(usize, i16), Curve>,
}

impl Observations {
    /// Adds the observations of another run of the same tasks.
    ///
    /// # Panics
    ///
    /// Panics if the other run has another number of tasks.
    pub fn merge(&mut self, other: Self) {
        if self.tasks.is_empty() {
            *self = other;
            return;
        }
        assert_eq!(self.tasks.len(), other.tasks.len(), "both runs have the same tasks");
        for (mine, its) in self.tasks.iter_mut().zip(other.tasks) {
            mine.jobs += its.jobs;
            mine.body = mine.body.max(its.body);
            mine.response = mine.response.max(its.response);
            mine.blocked = mine.blocked.max(its.blocked);
            mine.most = mine.most.max(its.most);
            mine.apart =
                if mine.apart == 0 || its.apart == 0 { mine.apart.max(its.apart) } else { mine.apart.min(its.apart) };
            raise(&mut mine.own, &its.own);
        }
        self.entry = self.entry.max(other.entry);
        self.exit = self.exit.max(other.exit);
        for (which, longest) in other.masked {
            let mine = self.masked.entry(which).or_default();
            *mine = longest.max(*mine);
        }
        for (which, curve) in other.groups {
            raise(self.groups.entry(which).or_default(), &curve);
        }
    }
}

fn raise(mine: &mut Curve, its: &Curve) {
    if mine.demands.is_empty() {
        mine.clone_from(its);
        return;
    }
    for (mine, its) in mine.demands.iter_mut().zip(&its.demands) {
        *mine = (*mine).max(*its);
    }
}

/// A piece of code that ran without interruption: its exception (0 outside exceptions), and its beginning and end, ns.
pub type Span = (u16, u64, u64);

#[derive(Clone, Copy, Debug)]
struct Job {
    serial: u64,
    task: usize,
    released: u64,
    ended: u64,
    cost: u64,
}

/// A release of a task. The demand after this release is not measured yet.
#[derive(Clone, Debug)]
struct Release {
    at: u64,
    ended: u64,
    task: usize,
    /// The unfinished jobs at the release: their serial numbers and the time that each had run.
    consumed: Vec<(u64, u64)>,
}

/// The longest time, ns, between two exceptions that become pending together.
const TOGETHER: u64 = 2_000;

/// Code that was begun and has not ended.
#[derive(Clone, Debug)]
struct Context {
    serial: u64,
    exception: u16,
    task: Option<usize>,
    priority: i16,
    released: Option<(u64, Vec<(u64, u64)>)>,
    entry: u64,
    /// The time that this code has run.
    own: u64,
    /// For each masked priority, the running time of this code at the beginning of the section, and whether PRIMASK
    /// masked it.
    masked: Vec<(i16, u64, bool)>,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Runs,
    Enters(u64),
    Leaves(u64),
}

/// Observes one processor.
#[derive(Clone, Debug)]
pub struct Observer {
    tasks: Vec<Watched>,
    /// The priorities of the tasks, each once.
    priorities: Vec<i16>,
    group_horizon: u64,
    contexts: Vec<Context>,
    /// The pending exceptions, each with the instant (ns) at which it became pending. Each also has the jobs that were
    /// unfinished at that instant, and their running times.
    pending: BTreeMap<u16, (u64, Vec<(u64, u64)>)>,
    /// The instant, ns, at which each exception last became pending.
    pended: BTreeMap<u16, u64>,
    jobs: u64,
    /// The instant, ns, at which another exception last began or continued to run.
    changed: u64,
    phase: Phase,
    /// The instant of the last event.
    last: u64,
    /// Whether a task has run since the last reset. If so, the firmware has started.
    started: bool,
    resets: u64,
    /// The finished jobs that a demand may still include, in order of their ends.
    ended: VecDeque<Job>,
    /// The releases after which the demand is not measured yet.
    open: VecDeque<Release>,
    releases: Vec<VecDeque<u64>>,
    seen: Observations,
    spans: Option<Vec<Span>>,
}

impl Observer {
    /// Returns an observer of a processor at its reset. The demand of the groups in `chains` is measured in windows up
    /// to `group_horizon`, ns. With `spans` all pieces of the running code are kept.
    #[must_use]
    pub fn new(tasks: Vec<Watched>, chains: &[usize], group_horizon: u64, spans: bool) -> Self {
        let mut priorities: Vec<i16> = tasks.iter().map(|task| task.priority).collect();
        priorities.sort_unstable();
        priorities.dedup();
        let curve = |horizon: u64| Curve { step: horizon.div_ceil(STEPS), demands: vec![0; STEPS as usize] };
        let mut seen = Observations::default();
        for task in &tasks {
            seen.tasks.push(Seen { own: curve(task.horizon), ..Seen::default() });
            for &priority in priorities.iter().filter(|_| chains.contains(&task.group)) {
                seen.groups.entry((task.group, priority)).or_insert_with(|| Curve {
                    step: group_horizon.div_ceil(4 * STEPS),
                    demands: vec![0; 4 * STEPS as usize],
                });
            }
        }
        let releases = vec![VecDeque::new(); tasks.len()];
        Self {
            tasks,
            priorities,
            group_horizon,
            contexts: vec![Self::thread()],
            pending: BTreeMap::new(),
            pended: BTreeMap::new(),
            jobs: 0,
            changed: 0,
            phase: Phase::Runs,
            last: 0,
            started: false,
            resets: 0,
            ended: VecDeque::new(),
            open: VecDeque::new(),
            releases,
            seen,
            spans: spans.then(Vec::new),
        }
    }

    fn thread() -> Context {
        Context {
            serial: 0,
            exception: 0,
            task: None,
            priority: THREAD,
            released: None,
            entry: 0,
            own: 0,
            masked: vec![],
        }
    }

    /// Takes events in order of time.
    pub fn take(&mut self, events: Vec<(u64, Scheduled)>) {
        for (at, event) in events {
            self.event(at, event);
        }
        self.measure(false);
    }

    /// Whether a task has run since the last reset.
    #[must_use]
    pub const fn has_started(&self) -> bool {
        self.started
    }

    /// The number of resets so far.
    #[must_use]
    pub const fn resets(&self) -> u64 {
        self.resets
    }

    /// Ends the observation.
    #[must_use]
    pub fn finish(mut self) -> (Observations, Vec<Span>) {
        self.measure(true);
        (self.seen, self.spans.unwrap_or_default())
    }

    fn event(&mut self, at: u64, event: Scheduled) {
        // Near a change of the clock, a board may count some cycles by either clock, so an instant may seem to step
        // back.
        let at = at.max(self.last);
        if matches!(self.phase, Phase::Runs) {
            let last = std::mem::replace(&mut self.last, at);
            if let Some(context) = self.contexts.last_mut() {
                context.own += at - last;
                if at > last
                    && let Some(spans) = &mut self.spans
                {
                    match spans.last_mut() {
                        Some((exception, _, end)) if *exception == context.exception && *end == last => *end = at,
                        _ => spans.push((context.exception, last, at)),
                    }
                }
            }
        }
        self.last = at;
        match event {
            Scheduled::Pending(exception) => {
                let consumed = self.contexts.iter().map(|it| (it.serial, it.entry + it.own)).collect();
                self.pending.insert(exception, (at, consumed));
                self.pended.insert(exception, at);
            }
            Scheduled::Entry => self.phase = Phase::Enters(at),
            Scheduled::Exit => self.phase = Phase::Leaves(at),
            Scheduled::Active(exception) => self.activate(at, exception),
            Scheduled::Masked(mask) => self.mask(mask),
            Scheduled::Reset => {
                self.contexts = vec![Self::thread()];
                self.pending.clear();
                self.pended.clear();
                self.changed = at;
                self.phase = Phase::Runs;
                self.started = false;
                self.resets += 1;
                self.measure(true);
                self.ended.clear();
                self.open.clear();
                self.releases.iter_mut().for_each(VecDeque::clear);
            }
        }
    }

    fn activate(&mut self, at: u64, exception: u16) {
        match std::mem::replace(&mut self.phase, Phase::Runs) {
            Phase::Enters(since) => {
                self.seen.entry = self.seen.entry.max(at - since);
                self.begin(exception, at - since, at);
            }
            Phase::Leaves(since) => {
                if let Some(context) = self.contexts.pop() {
                    self.seen.exit = self.seen.exit.max(at - since);
                    self.end(context, since, at - since);
                }
                if self.contexts.last().is_none_or(|context| context.exception != exception) {
                    self.begin(exception, 0, at);
                }
            }
            Phase::Runs => {}
        }
    }

    fn begin(&mut self, exception: u16, entry: u64, at: u64) {
        // Exceptions that became pending during the start of the firmware do not count.
        if !self.started {
            self.pending.clear();
        }
        let released = self.pending.remove(&exception);
        let is_of = |task: &&Watched| {
            let companion = |other| self.pended.get(&other).copied();
            let together = |other| {
                released.as_ref().is_some_and(|(at, _)| companion(other).is_some_and(|it| it.abs_diff(*at) <= TOGETHER))
            };
            task.exception == exception && task.together.is_none_or(together)
        };
        // If two tasks have the same vector, the one that a second exception identifies comes later in the table. So
        // the search begins at the end.
        let task = self.tasks.iter().rposition(|task| is_of(&task));
        self.started |= task.is_some();
        let priority = task.map_or(-1, |task| self.tasks[task].priority);
        if let (Some(task), Some((released, _)), Some(below)) = (task, &released, self.contexts.last())
            && *released >= self.changed
            && below.priority > priority
        {
            let seen = &mut self.seen.tasks[task];
            seen.blocked = seen.blocked.max((at - entry).saturating_sub(*released));
        }
        self.jobs += 1;
        let serial = self.jobs;
        self.contexts.push(Context { serial, exception, task, priority, released, entry, own: 0, masked: vec![] });
        self.changed = at;
    }

    fn end(&mut self, context: Context, ended: u64, exit: u64) {
        self.changed = ended + exit;
        let Some(task) = context.task else { return };
        let seen = &mut self.seen.tasks[task];
        seen.jobs += 1;
        seen.body = seen.body.max(context.own);
        let Some((released, consumed)) = context.released else { return };
        seen.response = seen.response.max(ended - released);
        let cost = context.entry + context.own + exit;
        self.ended.push_back(Job { serial: context.serial, task, released, ended, cost });
        self.open.push_back(Release { at: released, ended, task, consumed });
        let releases = &mut self.releases[task];
        if let Some(&before) = releases.back() {
            let apart = released - before;
            seen.apart = if seen.apart == 0 { apart } else { seen.apart.min(apart) };
        }
        releases.push_back(released);
        let within = self.tasks[task].within;
        while releases.front().is_some_and(|first| released - first >= within) {
            releases.pop_front();
        }
        seen.most = seen.most.max(releases.len() as u64);
    }

    fn mask(&mut self, mask: i16) {
        let Self { contexts, priorities, seen, .. } = self;
        let Some(context) = contexts.last_mut() else { return };
        for &priority in priorities.iter().filter(|priority| **priority < context.priority) {
            let begun = context.masked.iter().position(|(masked, ..)| *masked == priority);
            match (priority >= mask, begun) {
                (true, None) => context.masked.push((priority, context.own, mask <= 0)),
                (false, Some(place)) => {
                    let (_, since, all) = context.masked.swap_remove(place);
                    // Masked sections during the start of the firmware are not counted, because they delay no task.
                    if self.started {
                        let longest = seen.masked.entry((context.task, priority, all)).or_default();
                        *longest = (context.own - since).max(*longest);
                    }
                }
                _ => {}
            }
        }
    }

    /// Measures the demand after each release that is old enough, or with `all` after each release.
    fn measure(&mut self, all: bool) {
        let wait = 2 * self.group_horizon;
        while let Some(release) = self.open.pop_front_if(|release| all || release.at + wait <= self.last) {
            self.measure_own(&release);
            self.measure_group(&release);
        }
        let oldest = self.open.front().map_or(self.last, |release| release.at);
        while self.ended.front().is_some_and(|job| job.ended + wait < oldest) {
            self.ended.pop_front();
        }
    }

    fn measure_own(&mut self, release: &Release) {
        let Watched { group, priority, horizon, exception, is_step, .. } = self.tasks[release.task];
        let relevant = self.ended.iter().filter(|job| {
            let other = &self.tasks[job.task];
            other.group == group
                && other.priority <= priority
                && job.ended > release.at
                && job.released < release.at + horizon
                && !(is_step && other.is_stepped && job.released >= release.ended)
                // A later job of the same task comes after this one and does not delay it.
                && (other.exception != exception || job.released < release.at)
        });
        let left = |job: &Job| {
            let consumed = release.consumed.iter().find(|(serial, _)| *serial == job.serial).map_or(0, |(_, it)| *it);
            (job.released.saturating_sub(release.at), job.cost.saturating_sub(consumed))
        };
        let demands = relevant.map(left).collect();
        accumulate(&mut self.seen.tasks[release.task].own, demands);
    }

    fn measure_group(&mut self, release: &Release) {
        let Watched { group, priority, .. } = self.tasks[release.task];
        let window = release.at..release.at + self.group_horizon;
        for at in 0..self.priorities.len() {
            let least = self.priorities[at];
            if let Some(curve) = self.seen.groups.get_mut(&(group, least)).filter(|_| priority <= least) {
                let relevant = self.ended.iter().filter(|job| {
                    let other = &self.tasks[job.task];
                    other.group == group && other.priority <= least && window.contains(&job.released)
                });
                accumulate(curve, relevant.map(|job| (job.released - release.at, job.cost)).collect());
            }
        }
    }
}

/// Raises `curve` to the demand of these jobs, each with its time after the beginning of the window and its cost.
fn accumulate(curve: &mut Curve, mut demands: Vec<(u64, u64)>) {
    demands.sort_unstable();
    let (mut next, mut total) = (demands.into_iter().peekable(), 0);
    for (number, most) in (1..).zip(&mut curve.demands) {
        while let Some((_, cost)) = next.next_if(|(offset, _)| *offset < number * curve.step) {
            total += cost;
        }
        *most = (*most).max(total);
    }
}
