//! The record of the active exception, for traces that show interrupts and tasks over time.
//!
//! | Question | Where the answer is |
//! |---|---|
//! | which exception is active now (IPSR, ARM ARM B1.4.2) | [`Core::active_exception`] |
//! | how often the active exception changed | [`Core::exception_changes`] |
//! | at which cycle each change was, and to what | [`Core::watch_exceptions`], then [`Core::take_exceptions`] |
//!
//! One call of [`Core::run`] may include an entry and a return, which its caller would miss; the record has both. While
//! nothing is recorded, a change costs one increment, and an instruction without a change costs nothing.

use crate::{Core, Cost};

/// The greatest number of changes that the record keeps until they are taken. Far fewer changes occur in a millisecond.
const MOST_CHANGES: usize = 4096;

/// The changes of the active exception.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    /// The number of changes since the core was made.
    changes: u64,
    /// Whether changes are recorded.
    on: bool,
    /// The cycle of each change and the exception that was active from then on, oldest first.
    record: Vec<(u64, u16)>,
}

impl Watch {
    /// The number of recorded changes.
    #[inline]
    pub(crate) const fn recorded(&self) -> usize {
        self.record.len()
    }

    /// Completes the record after the run loop has executed instructions up to `cycle`; `before` changes were recorded
    /// when the loop began. A change ends a burst, so there is at most one new change. Its cycle can be recorded only
    /// now, since the cycles of the instruction that made it (`BX LR`, `SVC`) are counted after its execution.
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
    /// The number of the active exception (IPSR): 0 in thread mode, 1 to 15 for the system's exceptions, 16 + n for
    /// interrupt n.
    #[must_use]
    pub const fn active_exception(&self) -> u16 {
        self.ipsr
    }

    /// The number of changes of the active exception since the core was made. It changes at each entry, at each return,
    /// and once where one handler follows another by tail-chaining. The count goes on through resets, and also while
    /// changes are not recorded.
    #[must_use]
    pub const fn exception_changes(&self) -> u64 {
        self.watch.changes
    }

    /// Begins or ends the recording of changes of the active exception. It drops the changes that were not taken.
    pub fn watch_exceptions(&mut self, on: bool) {
        self.watch.on = on;
        self.watch.record = Vec::new();
    }

    /// Takes the changes since the last call, oldest first. Each has the cycle at which the first instruction of the
    /// new handler (or of the code returned to) can begin, and the number of the exception that is active from then on,
    /// as [`Core::active_exception`] gives it. The list is empty if changes are not recorded.
    ///
    /// The record keeps the first 4096 changes. If a caller gets fewer changes than [`Core::exception_changes`] grew
    /// by, the latest ones were lost.
    pub fn take_exceptions(&mut self) -> Vec<(u64, u16)> {
        std::mem::take(&mut self.watch.record)
    }

    /// Records that the active exception changed, or that a handler was entered anew, at the present cycle.
    #[inline]
    pub(crate) fn exception_changed(&mut self) {
        self.watch.changes += 1;
        if self.watch.on && self.watch.record.len() < MOST_CHANGES {
            self.watch.record.push((self.cycle, self.ipsr));
        }
    }

    /// Records a change of IPSR that was neither an entry nor a return; `before` is its former value.
    pub(crate) fn exception_changed_from(&mut self, before: u16) {
        if self.ipsr != before {
            self.exception_changed();
        }
    }
}
