//! Derives from the changes of the active exception when each task of a board is active and when the core sleeps.

use cortex_m4::Cost;

use super::signals::{Board, Task, TaskSignal};
use super::{Mark, vectors};
use emulator_node::{self as node, Node};

/// A watch on the tasks of a board, which can be cloned with the board.
#[derive(Clone, Debug)]
pub struct TaskWatch {
    board: Board,
    tasks: Vec<Task>,
    /// The active exceptions with their priorities, in the order in which they began. The last one runs.
    entered: Vec<(u16, i16)>,
    asleep: bool,
}

impl TaskWatch {
    /// Watches the tasks in `table` (name, vector) whose vector leads to the program's function of that name.
    #[must_use]
    pub fn new<B: node::Board, C: Cost>(
        board: Board,
        node: &mut Node<B, C>,
        table: &[(&'static str, &'static str)],
    ) -> Self {
        node.watch_tasks(true);
        let tasks = table
            .iter()
            .filter_map(|&(name, vector)| {
                let exception = vectors::exception(board, vector)?;
                node.exceptions_of(vector).contains(&exception).then_some(Task { name, vector, exception })
            })
            .collect();
        Self { board, tasks, entered: vec![], asleep: false }
    }

    /// The tasks that are watched, in the order of the firmware's table.
    #[must_use]
    pub fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// Takes the changes since the last call, which must be at most 4096 changes of the active exception ago.
    pub fn take<B: node::Board, C: Cost>(&mut self, node: &mut Node<B, C>) -> Vec<Mark> {
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

    fn changes(&mut self, at: u64, active: u16, priority: i16, marks: &mut Vec<Mark>) {
        if let Some(place) = self.entered.iter().position(|&(entered, _)| entered == active) {
            // The core returned to an exception that was active before, or entered it again by tail-chaining.
            self.leave(at, place + 1, marks);
        } else {
            // A less urgent exception cannot preempt, so it follows by tail-chaining (ARMv7-M ARM B1.5.12).
            while self.entered.last().is_some_and(|&(_, last)| last <= priority) {
                self.leave(at, self.entered.len() - 1, marks);
            }
            if active != 0 {
                self.entered.push((active, priority));
                marks.push(self.mark(at, self.signal(active), 1));
            }
        }
        marks.push(self.mark(at, TaskSignal::Running, u64::from(active)));
        self.idle(at, marks);
    }

    /// Records the end of all active exceptions after the first `stay`.
    fn leave(&mut self, at: u64, stay: usize, marks: &mut Vec<Mark>) {
        for (ended, _) in self.entered.split_off(stay) {
            let signal = self.signal(ended);
            // Exceptions outside the list of tasks share one signal, which ends when the last of them ends.
            if self.entered.iter().all(|&(entered, _)| self.signal(entered) != signal) {
                marks.push(self.mark(at, signal, 0));
            }
        }
    }

    fn sleeps(&mut self, at: u64, asleep: bool, marks: &mut Vec<Mark>) {
        self.asleep = asleep;
        marks.push(self.mark(at, TaskSignal::Asleep, u64::from(asleep)));
        self.idle(at, marks);
    }

    fn idle(&self, at: u64, marks: &mut Vec<Mark>) {
        let idle = self.entered.is_empty() && !self.asleep;
        marks.push(self.mark(at, TaskSignal::Idle, u64::from(idle)));
    }

    fn signal(&self, exception: u16) -> TaskSignal {
        let place = self.tasks.iter().position(|task| task.exception == exception);
        place.map_or(TaskSignal::Other, TaskSignal::Entered)
    }

    fn mark(&self, at: u64, signal: TaskSignal, value: u64) -> Mark {
        Mark::Task(at, self.board, signal, value)
    }
}
