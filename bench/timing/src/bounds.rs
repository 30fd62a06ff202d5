//! Calculates the bound of each task's response time from the stated arrivals and the observed execution times.

use serde::Serialize;

use crate::analysis::{self, Interference};
use crate::search::BoardSeen;
use crate::tasks::{Bounded, Stated, Table};

/// The highest allowed load of a processor (docs/design.md#timing).
pub const MOST_LOAD: f64 = 0.1;

/// The smallest part of a stack that must stay unused in all runs of a search.
pub const STACK_ROOM: f64 = 0.25;

/// A task's figures, times in ns.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TaskFigures {
    /// The task's name.
    pub task: &'static str,
    /// The task's interrupt vector.
    pub vector: &'static str,
    /// The task's priority in the firmware, 1 for the least urgent.
    pub priority: u8,
    /// The greatest number of releases in `within_ns`, each at least `apart_ns` after the one before.
    pub releases: u64,
    /// The window of the stated arrivals.
    pub within_ns: u64,
    /// The shortest time between two releases, as stated.
    pub apart_ns: u64,
    /// The source of the stated arrivals.
    pub arrivals_from: &'static str,
    /// The number of observed jobs.
    pub jobs: u64,
    /// The longest observed execution of the task, with the longest exception entry and return.
    pub execution_ns: u64,
    /// The longest time for which less urgent code masks the task's priority.
    pub blocking_ns: u64,
    /// The time that more urgent tasks, and those of the same priority, add to the bound; `None` without a bound.
    pub interference_ns: Option<u64>,
    /// The longest observed response time.
    pub seen_ns: u64,
    /// The bound of the task's response time; `None` if there is none up to twice the deadline.
    pub bound_ns: Option<u64>,
    /// The task's deadline.
    pub deadline_ns: u64,
    /// The source of the deadline.
    pub deadline_from: &'static str,
    /// The task's requirements that are not met, in words.
    pub faults: Vec<String>,
}

/// A board's figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BoardFigures {
    /// The board's name.
    pub board: &'static str,
    /// The tasks, the most urgent first.
    pub tasks: Vec<TaskFigures>,
    /// The highest load of the processor in half a second, 0 to 1.
    pub load: f64,
    /// The bytes of the stack that were used.
    pub stack_used: usize,
    /// The bytes of the stack.
    pub stack: usize,
    /// The board's requirements that are not met, in words.
    pub faults: Vec<String>,
}

impl BoardFigures {
    /// All unmet requirements of the board and its tasks, in words.
    pub fn all_faults(&self) -> impl Iterator<Item = String> {
        let of_board = self.faults.iter().map(|fault| format!("{}: {fault}", self.board));
        let of_task = |task: &TaskFigures| {
            let of = format!("{}, {}", self.board, task.task);
            task.faults.iter().map(move |fault| format!("{of}: {fault}")).collect::<Vec<_>>()
        };
        of_board.chain(self.tasks.iter().flat_map(of_task))
    }
}

/// Returns the figures of a board with these tasks, from the observations of a search.
#[must_use]
pub fn figures(table: &Table, seen: &BoardSeen) -> BoardFigures {
    // A task's bound depends on the bounds of tasks that are as urgent or more, so the calculation is repeated until
    // nothing changes.
    let round = |known: &[TaskFigures]| (0..table.tasks.len()).map(|at| task(table, seen, at, known)).collect();
    let mut tasks: Vec<TaskFigures> = round(&[]);
    for _ in 0..table.tasks.len() {
        let next: Vec<TaskFigures> = round(&tasks);
        if next == tasks {
            break;
        }
        tasks = next;
    }
    let mut faults = vec![];
    // docs/design.md#timing bounds the load of only two boards.
    if seen.load > MOST_LOAD && table.is_of_the_link {
        faults.push(format!("a load of {:.1} %, above {:.0} %", 100.0 * seen.load, 100.0 * MOST_LOAD));
    }
    let (used, size) = seen.stack;
    let free = 1.0 - used as f64 / size.max(1) as f64;
    if free < STACK_ROOM {
        faults.push(format!("{used} of {size} bytes of stack were used: less than a quarter is left"));
    }
    BoardFigures { board: table.board, tasks, load: seen.load, stack_used: used, stack: size, faults }
}

/// Returns the figures of the task `at`. `known` has the figures of all tasks from the previous round.
fn task(table: &Table, seen: &BoardSeen, at: usize, known: &[TaskFigures]) -> TaskFigures {
    let stated = &table.tasks[at];
    let shown = &seen.observations.tasks[at];
    let execution = execution(table, seen, at);
    let blocking = blocking(table, seen, at);
    let fixed_phases = stated.group.on_itself() == Bounded::Measured;
    let mut interference = vec![];
    if fixed_phases {
        interference.push(Interference::Curve { curve: &shown.own, jitter: 0 });
    }
    for (other, its) in table.tasks.iter().enumerate() {
        let is_delay = other != at && its.priority <= stated.priority && its.vector != stated.vector;
        let bounded = if its.group == stated.group { its.group.on_itself() } else { its.group.on_others() };
        if is_delay && bounded == Bounded::Stated {
            // If the tasks have fixed phases, releases count from this task's release. An earlier job of the other task
            // may then still be unfinished.
            let jitter = if fixed_phases { response_of(its, known.get(other)) } else { 0 };
            interference.push(Interference::Task {
                arrivals: its.arrivals,
                jitter,
                cost: self::execution(table, seen, other),
            });
        }
    }
    for ((group, priority), curve) in &seen.observations.groups {
        if *group != stated.group as usize && *priority == stated.priority {
            let members = table
                .tasks
                .iter()
                .enumerate()
                .filter(|(_, its)| its.group as usize == *group && its.priority <= stated.priority);
            let longest = members.map(|(other, its)| response_of(its, known.get(other))).max().unwrap_or(0);
            interference.push(Interference::Curve { curve, jitter: if fixed_phases { longest } else { 0 } });
        }
    }
    let own = (!fixed_phases).then_some(stated.arrivals);
    let bound = analysis::response(execution, blocking, own, &interference, 2 * stated.deadline);
    let mut figures = TaskFigures {
        task: stated.name,
        vector: stated.vector,
        priority: stated.level,
        releases: stated.arrivals.most,
        within_ns: stated.arrivals.within,
        apart_ns: stated.arrivals.apart,
        arrivals_from: stated.source,
        jobs: shown.jobs,
        execution_ns: execution,
        blocking_ns: blocking,
        interference_ns: bound.map(|bound| bound.saturating_sub(execution + blocking)),
        seen_ns: shown.response,
        bound_ns: bound,
        deadline_ns: stated.deadline,
        deadline_from: stated.why,
        faults: vec![],
    };
    figures.faults = faults(stated, seen, at, &figures);
    figures
}

fn response_of(stated: &Stated, figures: Option<&TaskFigures>) -> u64 {
    figures.and_then(|figures| figures.bound_ns).unwrap_or(2 * stated.deadline)
}

/// Returns the longest observed execution, with exception entry and return. If a task has two rows, the jobs of the
/// second may do the work of the first too.
fn execution(table: &Table, seen: &BoardSeen, task: usize) -> u64 {
    let stated = &table.tasks[task];
    let is_first = |it: &&Stated| it.vector == stated.vector && it.together.is_none();
    let first = table.tasks.iter().position(|it| stated.together.is_some() && is_first(&it));
    let body = |task: usize| seen.observations.tasks[task].body;
    let all = body(task) + first.map_or(0, body);
    if body(task) == 0 { 0 } else { all + seen.observations.entry + seen.observations.exit }
}

fn blocking(table: &Table, seen: &BoardSeen, at: usize) -> u64 {
    let stated = &table.tasks[at];
    let masks = seen.observations.masked.iter().filter(|((owner, priority, all), _)| {
        let is_less_urgent = owner.is_none_or(|owner| table.tasks[owner].priority > stated.priority);
        *priority == stated.priority && is_less_urgent && !(stated.in_quiet && owner.is_none() && *all)
    });
    masks.map(|(_, longest)| *longest).max().unwrap_or(0)
}

fn faults(stated: &Stated, seen: &BoardSeen, at: usize, figures: &TaskFigures) -> Vec<String> {
    let shown = &seen.observations.tasks[at];
    let mut faults = vec![];
    if shown.jobs == 0 {
        return vec!["it never ran in the search, so its execution time is not known".to_owned()];
    }
    if seen.priorities[at] != stated.priority {
        faults.push(format!("its priority is {}, and not {} as stated", seen.priorities[at], stated.priority));
    }
    let Some(bound) = figures.bound_ns else {
        faults.push(format!("there is no bound up to {} µs", 2 * stated.deadline / 1_000));
        return faults;
    };
    if bound > stated.deadline {
        faults.push(format!("the bound {:.1} µs is above the deadline {:.1} µs", us(bound), us(stated.deadline)));
    }
    if shown.response > bound {
        faults.push(format!(
            "a response of {:.1} µs was seen, above the bound {:.1} µs",
            us(shown.response),
            us(bound)
        ));
    }
    if shown.most > stated.arrivals.most || shown.apart > 0 && shown.apart < stated.arrivals.apart {
        faults.push(format!(
            "released {} times in {:.1} µs and {:.1} µs apart, more than stated ({}, {:.1} µs)",
            shown.most,
            us(stated.arrivals.within),
            us(shown.apart),
            stated.arrivals.most,
            us(stated.arrivals.apart)
        ));
    }
    // An interrupt waits for the end of an instruction, which may take some twenty cycles with wait states.
    if shown.blocked > figures.blocking_ns + 500 {
        faults.push(format!(
            "it was held back for {:.1} µs, above the blocking {:.1} µs",
            us(shown.blocked),
            us(figures.blocking_ns)
        ));
    }
    faults
}

/// A time in µs.
#[must_use]
pub fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

/// The figures as a text for a terminal.
#[must_use]
pub fn text(boards: &[BoardFigures]) -> String {
    let mut text = String::new();
    for board in boards {
        text += &format!(
            "{}: load at most {:.1} %, stack {} of {} bytes\n  {:<24} {:>4} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8} \
             {:>9}\n",
            board.board,
            100.0 * board.load,
            board.stack_used,
            board.stack,
            "task, times in µs",
            "prio",
            "jobs",
            "longest",
            "blocked",
            "delayed",
            "bound",
            "seen",
            "deadline"
        );
        for task in &board.tasks {
            let or_none = |time: Option<u64>| time.map_or("none".to_owned(), |time| format!("{:.1}", us(time)));
            text += &format!(
                "  {:<24} {:>4} {:>6} {:>8.1} {:>8.1} {:>8} {:>8} {:>8.1} {:>9.1}\n",
                task.task,
                task.priority,
                task.jobs,
                us(task.execution_ns),
                us(task.blocking_ns),
                or_none(task.interference_ns),
                or_none(task.bound_ns),
                us(task.seen_ns),
                us(task.deadline_ns)
            );
        }
    }
    text
}

/// The figures as a table of a page.
#[must_use]
pub fn page(boards: &[BoardFigures]) -> String {
    let mut text = String::new();
    for board in boards {
        text += &format!(
            "**{}**: load at most {:.1} %, stack {} of {} bytes used\n\n\
             | task | priority | longest | blocked | delayed | bound | seen | deadline, and why | releases at most, \
             and why |\n\
             |---|---|---|---|---|---|---|---|---|\n",
            board.board,
            100.0 * board.load,
            board.stack_used,
            board.stack
        );
        for task in &board.tasks {
            let or_none = |time: Option<u64>| time.map_or("none".to_owned(), |time| format!("{:.1}", us(time)));
            text += &format!(
                "| {} | {} | {:.1} | {:.1} | {} | {} | {:.1} | {}: {} | {} in {}, {} apart: {} |\n",
                task.task,
                task.priority,
                us(task.execution_ns),
                us(task.blocking_ns),
                or_none(task.interference_ns),
                or_none(task.bound_ns),
                us(task.seen_ns),
                us(task.deadline_ns),
                task.deadline_from,
                task.releases,
                us(task.within_ns),
                us(task.apart_ns),
                task.arrivals_from
            );
        }
        text += "\n";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::Curve;
    use crate::observe::{Observations, Seen};

    /// Returns observations of the hold's tasks in which each ran for 10 µs alone.
    fn seen(table: &Table) -> BoardSeen {
        let own = Curve { step: 1_000_000, demands: vec![0; 100] };
        let task = Seen { jobs: 1, body: 10_000, response: 10_000, most: 1, own, ..Seen::default() };
        let observations = Observations { tasks: vec![task; table.tasks.len()], ..Observations::default() };
        let priorities = table.tasks.iter().map(|task| task.priority).collect();
        BoardSeen { observations, priorities, stack: (10, 100), ..BoardSeen::default() }
    }

    #[test]
    fn a_task_that_never_ran_is_a_fault() {
        let table = Table::hold();
        let mut seen = seen(&table);
        assert_eq!(figures(&table, &seen).all_faults().collect::<Vec<_>>(), [""; 0]);
        seen.observations.tasks[5] = Seen { own: seen.observations.tasks[5].own.clone(), ..Seen::default() };
        let faults: Vec<_> = figures(&table, &seen).all_faults().collect();
        assert!(matches!(&faults[..], [fault] if fault.starts_with("hold, answer: it never ran")), "{faults:?}");
    }

    #[test]
    fn each_thing_that_does_not_hold_is_a_fault() {
        let table = Table::hold();
        type Break = fn(&mut BoardSeen);
        let breaks: [(&str, Break); 7] = [
            ("above the deadline", |seen| seen.observations.tasks[0].body = 11_000),
            ("above the bound", |seen| seen.observations.tasks[0].response = 10_001),
            ("more than stated", |seen| seen.observations.tasks[0].most = 3),
            ("more than stated", |seen| seen.observations.tasks[0].apart = 1),
            ("above the blocking", |seen| seen.observations.tasks[0].blocked = 600),
            ("its priority is", |seen| seen.priorities[0] = 1),
            ("less than a quarter", |seen| seen.stack = (76, 100)),
        ];
        for (word, damage) in breaks {
            let mut seen = seen(&table);
            damage(&mut seen);
            let faults: Vec<_> = figures(&table, &seen).all_faults().collect();
            assert!(matches!(&faults[..], [fault] if fault.contains(word)), "{word}: {faults:?}");
        }
    }

    #[test]
    fn only_masks_of_less_urgent_code_block_a_task() {
        let table = Table::hold();
        let mut seen = seen(&table);
        let slot = table.tasks[0].priority;
        seen.observations.masked.insert((Some(0), slot, false), 90_000);
        seen.observations.masked.insert((None, table.tasks[1].priority, false), 80_000);
        assert_eq!(figures(&table, &seen).tasks[0].blocking_ns, 0);
        seen.observations.masked.insert((Some(6), slot, false), 5_000);
        assert_eq!(figures(&table, &seen).tasks[0].blocking_ns, 5_000);
    }
}
