//! Which exception is active, told to whoever runs the core: for traces that show interrupts and tasks over time.
//!
//! | Question | Answer |
//! |---|---|
//! | which exception is active now (IPSR, ARM ARM B1.4.2) | [`Core::active_exception`] |
//! | how often the active exception changed | [`Core::exception_changes`] |
//! | at which cycle each change was, and to what | [`Core::watch_exceptions`], then [`Core::take_exceptions`] |
//!
//! [`Core::run`] may pass an entry and a return between two looks of its caller; the record keeps both. Without a watch
//! a change costs one increment, and an instruction that changes nothing costs nothing.

use crate::{Core, Cost};

/// Most changes that the record keeps until they are taken. A caller that takes them every millisecond stays far below.
const MOST_CHANGES: usize = 4096;

/// The changes of the active exception.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    /// Changes since the core was made.
    changes: u64,
    /// Changes are recorded.
    on: bool,
    /// The cycle of each change and what was active from then on, oldest first.
    record: Vec<(u64, u16)>,
}

impl Watch {
    /// How many changes are recorded.
    #[inline]
    pub(crate) const fn recorded(&self) -> usize {
        self.record.len()
    }

    /// The run loop has executed instructions up to `cycle`, with `before` changes recorded when it began. A change
    /// ends what the loop executes in one piece, so there is at most one, and it is complete only now: the cycles of
    /// the instruction that made it (`BX LR`, `SVC`) are counted after it has been executed.
    #[inline]
    pub(crate) fn complete(&mut self, before: usize, cycle: u64) {
        if self.record.len() > before
            && let Some(last) = self.record.last_mut()
        {
            last.0 = cycle;
        }
    }
}

impl<C: Cost> Core<C> {
    /// The number of the exception that is active: IPSR, 0 in thread mode, 1 to 15 for the system's exceptions, 16 + n
    /// for interrupt n.
    #[must_use]
    pub const fn active_exception(&self) -> u16 {
        self.ipsr
    }

    /// How often the active exception has changed since the core was made: at each entry, at each return, and once
    /// where one handler follows another by tail-chaining. It goes on through resets. It counts whether changes are
    /// watched or not.
    #[must_use]
    pub const fn exception_changes(&self) -> u64 {
        self.watch.changes
    }

    /// Begins or ends the record of changes of the active exception. What was recorded and not taken is gone.
    pub fn watch_exceptions(&mut self, on: bool) {
        self.watch.on = on;
        self.watch.record = Vec::new();
    }

    /// The changes since they were last taken, oldest first: the cycle at which the first instruction of the new
    /// handler (or of the code returned to) can begin, and the number of the exception that is active from then on, as
    /// [`Core::active_exception`] has it. Empty where changes are not watched.
    ///
    /// The first 4096 changes are kept. Who takes fewer than [`Core::exception_changes`] grew by has lost the latest.
    pub fn take_exceptions(&mut self) -> Vec<(u64, u16)> {
        std::mem::take(&mut self.watch.record)
    }

    /// The active exception changed, or a handler was entered anew, at the present cycle.
    #[inline]
    pub(crate) fn exception_changed(&mut self) {
        self.watch.changes += 1;
        if self.watch.on && self.watch.record.len() < MOST_CHANGES {
            self.watch.record.push((self.cycle, self.ipsr));
        }
    }

    /// The same where something else than an entry or a return may have written IPSR: `before` is what it held.
    pub(crate) fn exception_changed_from(&mut self, before: u16) {
        if self.ipsr != before {
            self.exception_changed();
        }
    }
}
