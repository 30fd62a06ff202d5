//! The record of the active exception, for traces that show interrupts and tasks over time.
//!
//! | Question | Where the answer is |
//! |---|---|
//! | which exception is active now (IPSR, ARM ARM B1.4.2) | [`Core::active_exception`] |
//! | how often the active exception changed | [`Core::exception_changes`] |
//! | at which cycle each change was, and to what | [`Core::watch_exceptions`], then [`Core::take_exceptions`] |
//! | when exceptions became pending and priorities were masked | [`Core::watch_schedule`], [`Core::take_schedule`] |
//!
//! One call of [`Core::run`] may include an entry and a return, which its caller would miss. The record has both. While
//! nothing is recorded, a change costs one increment.

use crate::system::nvic::{IDLE_PRIORITY, Set};
use crate::{Core, Cost};

const MOST_CHANGES: usize = 4096;

/// An event that decides which exception runs, and when. A response-time analysis starts from such events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheduled {
    /// This exception became pending while it was enabled, or was enabled while it was pending.
    Pending(u16),
    /// The core begins to enter an exception; the next [`Scheduled::Active`] says which.
    Entry,
    /// The first instruction of this exception's handler, or of the code returned to (0 for thread mode), can begin.
    Active(u16),
    /// The handler of the active exception has ended, and the core begins to return from it.
    Exit,
    /// PRIMASK, BASEPRI or FAULTMASK changed: exceptions of this priority and of less urgent ones, which have higher
    /// numbers, are held back from now on. The value is 256 if no exception is held back.
    Masked(i16),
    /// The core was reset.
    Reset,
}

#[derive(Clone, Debug)]
struct Schedule {
    events: Vec<(u64, Scheduled)>,
    /// The enabled exceptions that were pending when the core last checked for exceptions.
    pending: Set,
    mask: i16,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    changes: u64,
    on: bool,
    /// The cycle of each change and the exception that was active from then on, oldest first.
    record: Vec<(u64, u16)>,
    schedule: Option<Box<Schedule>>,
}

impl Watch {
    #[inline]
    pub(crate) fn recorded(&self) -> (usize, usize) {
        (self.record.len(), self.schedule.as_ref().map_or(0, |schedule| schedule.events.len()))
    }

    /// Completes the record after a burst up to `cycle`. `before` is the number of changes that were recorded before
    /// the burst. A change ends a burst, so at most one change is new. The cycle of the new change is known only now,
    /// because an instruction's cycles are counted after its execution.
    #[inline]
    pub(crate) fn complete(&mut self, (before, scheduled): (usize, usize), cycle: u64) {
        if self.record.len() > before
            && let Some(last) = self.record.last_mut()
        {
            last.0 = cycle;
        }
        if let Some(schedule) = &mut self.schedule
            && schedule.events.len() > scheduled
            && let Some((at, Scheduled::Active(_))) = schedule.events.last_mut()
        {
            *at = cycle;
        }
    }
}

impl<C: Cost> Core<C> {
    /// The number of the active exception (IPSR): 0 in thread mode, 1 to 15 for the system's exceptions, 16 + n for
    /// interrupt n.
    #[must_use]
    pub const fn active_exception(&self) -> u16 {
        self.ipsr
    }

    /// The number of changes of the active exception since the core was made: one for each entry, each return, and each
    /// tail-chain. Resets do not clear it, and it also counts while nothing is recorded.
    #[must_use]
    pub const fn exception_changes(&self) -> u64 {
        self.watch.changes
    }

    /// Begins or ends the recording of changes of the active exception. Changes that were not taken are dropped.
    pub fn watch_exceptions(&mut self, on: bool) {
        self.watch.on = on;
        self.watch.record = Vec::new();
    }

    /// Takes the recorded changes since the last call, oldest first. Each has the cycle at which the first instruction
    /// of the new handler (or of the code returned to) can begin, and the exception from then on, as
    /// [`Core::active_exception`] gives it.
    ///
    /// The record keeps the first 4096 changes. If [`Core::exception_changes`] grew by more, the latest ones were lost.
    pub fn take_exceptions(&mut self) -> Vec<(u64, u16)> {
        std::mem::take(&mut self.watch.record)
    }

    /// Begins or ends the recording of the events that decide which exception runs. Recorded events that were not taken
    /// are dropped. Their number has no limit, so the caller must take them. On the fast clock, which counts no cycles
    /// within a burst, changes of the mask have the cycle at which the burst began.
    pub fn watch_schedule(&mut self, on: bool) {
        let schedule = || Schedule { events: vec![], pending: [0; 4], mask: IDLE_PRIORITY };
        self.watch.schedule = on.then(|| Box::new(schedule()));
        self.note_mask();
        self.note_pending();
    }

    /// Takes the recorded events since the last call with their cycles, oldest first. An exception counts as pending
    /// from the first instruction boundary at which the core sees it.
    pub fn take_schedule(&mut self) -> Vec<(u64, Scheduled)> {
        self.watch.schedule.as_mut().map(|schedule| std::mem::take(&mut schedule.events)).unwrap_or_default()
    }

    #[inline]
    pub(crate) fn note_scheduled(&mut self, event: Scheduled) {
        if let Some(schedule) = &mut self.watch.schedule {
            match event {
                // An exception that becomes pending again while it is active is a new event.
                Scheduled::Active(number) => schedule.pending[usize::from(number >> 6) & 3] &= !(1 << (number & 63)),
                Scheduled::Reset => (schedule.pending, schedule.mask) = ([0; 4], IDLE_PRIORITY),
                _ => {}
            }
            schedule.events.push((self.cycle, event));
        }
    }

    #[inline]
    pub(crate) fn note_pending(&mut self) {
        let Some(schedule) = &mut self.watch.schedule else { return };
        let nvic = &self.system.nvic;
        for word in 0..4 {
            let pending = nvic.pending[word] & nvic.enabled[word];
            let mut new = pending & !schedule.pending[word];
            schedule.pending[word] = pending;
            while new != 0 {
                let number = (word as u16) << 6 | new.trailing_zeros() as u16;
                new &= new - 1;
                schedule.events.push((self.cycle, Scheduled::Pending(number)));
            }
        }
    }

    pub(crate) fn note_mask(&mut self) {
        if self.watch.schedule.is_none() {
            return;
        }
        let mask = self.mask_priority(true);
        if let Some(schedule) = &mut self.watch.schedule
            && std::mem::replace(&mut schedule.mask, mask) != mask
        {
            schedule.events.push((self.cycle, Scheduled::Masked(mask)));
        }
    }

    #[inline]
    pub(crate) fn exception_changed(&mut self) {
        self.watch.changes += 1;
        self.note_scheduled(Scheduled::Active(self.ipsr));
        if self.watch.on && self.watch.record.len() < MOST_CHANGES {
            self.watch.record.push((self.cycle, self.ipsr));
        }
    }

    /// Records a change of IPSR outside an entry or a return. `before` is the earlier value.
    pub(crate) fn exception_changed_from(&mut self, before: u16) {
        if self.ipsr != before {
            self.exception_changed();
        }
    }
}
