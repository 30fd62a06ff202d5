//! Derives signals from the changes of the active exception: when each task of a board is active, and when the core
//! sleeps.

use std::fmt;

use emulator_node::AnyNode;

use super::Signal;

/// A task of a firmware.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Task {
    /// The task's name in the firmware's sources; empty if it is not known.
    pub name: &'static str,
    /// The task's interrupt vector, as the microcontroller's manual names it.
    pub vector: &'static str,
    /// The exception number of the task: 16 + n for interrupt n.
    pub exception: u16,
}

impl fmt::Display for Task {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}{}{}", self.name, if self.name.is_empty() { "" } else { "_" }, self.vector)
    }
}

/// One of a board's signals about its tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskSignal {
    /// The task with this index in the board's list is active: it runs, or a more urgent task preempts it.
    Entered(usize),
    /// An exception outside the list of tasks is active.
    Other,
    /// No exception is active and the core is awake: thread mode.
    Idle,
    /// The core sleeps, or has no supply.
    Asleep,
    /// The number of the exception whose handler runs: 0 for thread mode, 16 + n for interrupt n.
    Running,
}

impl TaskSignal {
    /// Returns the signal's index in the list that [`task_signals`] makes of `tasks` tasks.
    #[must_use]
    pub const fn place(self, tasks: usize) -> usize {
        match self {
            Self::Entered(task) => task,
            Self::Other => tasks,
            Self::Idle => tasks + 1,
            Self::Asleep => tasks + 2,
            Self::Running => tasks + 3,
        }
    }
}

/// Returns the signals of `tasks`, in the group `tasks` of `board`. The names of signals that belong to no task begin
/// with the board's name.
#[must_use]
pub fn task_signals(board: &'static str, tasks: &[Task]) -> Vec<Signal> {
    let named = tasks.iter().map(|task| (task.to_string(), 1));
    let rest = [("other", 1), ("idle", 1), ("asleep", 1), ("running", 9)];
    let rest = rest.map(|(name, bits)| (format!("{board}_{name}"), bits));
    let signal = |(name, bits)| Signal { group: vec![board, "tasks"], name, bits, start: Some(0) };
    named.chain(rest).map(signal).collect()
}

/// A change of a signal about tasks: the instant (ns), the signal, its value from then on.
pub type TaskChange = (u64, TaskSignal, u64);

/// The exceptions of the system that have a vector (ARMv7-M ARM table B1-4), by the names of CMSIS.
const SYSTEM: [(u16, &str); 9] = [
    (2, "NMI"),
    (3, "HardFault"),
    (4, "MemManage"),
    (5, "BusFault"),
    (6, "UsageFault"),
    (11, "SVCall"),
    (12, "DebugMonitor"),
    (14, "PendSV"),
    (15, "SysTick"),
];

/// A watch on the tasks of a board. It can be cloned with the board.
#[derive(Clone, Debug)]
pub struct TaskWatch {
    tasks: Vec<Task>,
    /// The active exceptions with their priorities, in the order in which they became active. The last one runs.
    entered: Vec<(u16, i16)>,
    asleep: bool,
}

impl TaskWatch {
    /// Watches each task in `table` (name, vector) for which the program has a function with the vector's name, if the
    /// vector leads to that function.
    #[must_use]
    pub fn new(node: &mut dyn AnyNode, table: &[(&'static str, &'static str)]) -> Self {
        node.watch_tasks(true);
        let tasks = table
            .iter()
            .filter_map(|&(name, vector)| {
                let exception = node.exception(vector)?;
                node.exceptions_of(vector).contains(&exception).then_some(Task { name, vector, exception })
            })
            .collect();
        Self { tasks, entered: vec![], asleep: false }
    }

    /// Watches every exception with a handler of its own.
    #[must_use]
    pub fn all(node: &mut dyn AnyNode) -> Self {
        node.watch_tasks(true);
        let interrupts = (16..).zip(node.interrupts()).map(|(exception, name)| (exception, *name));
        let named = SYSTEM.into_iter().chain(interrupts);
        let tasks = named
            .filter(|&(exception, vector)| !vector.is_empty() && node.has_handler(exception))
            .map(|(exception, vector)| Task { name: "", vector, exception })
            .collect();
        Self { tasks, entered: vec![], asleep: false }
    }

    /// The tasks that are watched, in the order of the firmware's table.
    #[must_use]
    pub fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// Takes the changes since the last call. Since then at most 4096 changes of the active exception may have
    /// happened.
    pub fn take(&mut self, node: &mut dyn AnyNode) -> Vec<TaskChange> {
        let mut marks = vec![];
        let mut sleeps = node.take_sleeps().into_iter().peekable();
        for (at, active) in node.take_tasks() {
            while let Some((at, asleep)) = sleeps.next_if(|(slept, _)| *slept <= at) {
                self.sleeps(at, asleep, &mut marks);
            }
            let priority = node.exception_priority(active);
            self.changes(at, active, priority, &mut marks);
        }
        for (at, asleep) in sleeps {
            self.sleeps(at, asleep, &mut marks);
        }
        marks
    }

    fn changes(&mut self, at: u64, active: u16, priority: i16, marks: &mut Vec<TaskChange>) {
        if let Some(place) = self.entered.iter().position(|&(entered, _)| entered == active) {
            // The core has returned to an exception that was active before, or has entered it again by tail-chaining.
            self.leave(at, place + 1, marks);
        } else {
            // A less urgent exception cannot preempt, so it follows by tail-chaining (ARMv7-M ARM B1.5.12).
            while self.entered.last().is_some_and(|&(_, last)| last <= priority) {
                self.leave(at, self.entered.len() - 1, marks);
            }
            if active != 0 {
                self.entered.push((active, priority));
                marks.push((at, self.signal(active), 1));
            }
        }
        marks.push((at, TaskSignal::Running, u64::from(active)));
        self.idle(at, marks);
    }

    fn leave(&mut self, at: u64, stay: usize, marks: &mut Vec<TaskChange>) {
        for (ended, _) in self.entered.split_off(stay) {
            let signal = self.signal(ended);
            // All exceptions outside the list of tasks share one signal. It ends when the last of them ends.
            if self.entered.iter().all(|&(entered, _)| self.signal(entered) != signal) {
                marks.push((at, signal, 0));
            }
        }
    }

    fn sleeps(&mut self, at: u64, asleep: bool, marks: &mut Vec<TaskChange>) {
        self.asleep = asleep;
        marks.push((at, TaskSignal::Asleep, u64::from(asleep)));
        self.idle(at, marks);
    }

    fn idle(&self, at: u64, marks: &mut Vec<TaskChange>) {
        let idle = self.entered.is_empty() && !self.asleep;
        marks.push((at, TaskSignal::Idle, u64::from(idle)));
    }

    fn signal(&self, exception: u16) -> TaskSignal {
        let place = self.tasks.iter().position(|task| task.exception == exception);
        place.map_or(TaskSignal::Other, TaskSignal::Entered)
    }
}
