//! The record of the active exception, for traces that show interrupts and tasks over time.
//!
//! | Question | Where the answer is |
//! |---|---|
//! | which exception is active now (IPSR, ARM ARM B1.4.2) | [`Core::active_exception`] |
//! | how often the active exception changed | [`Core::exception_changes`] |
//! | at which cycle each change was, and to what | [`Core::watch_exceptions`], then [`Core::take_exceptions`] |
//!
//! One call of [`Core::run`] may include an entry and a return, which its caller would miss. The record has both. While
//! nothing is recorded, a change costs one increment.

use crate::{Core, Cost};

const MOST_CHANGES: usize = 4096;

#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    changes: u64,
    on: bool,
    /// The cycle of each change and the exception that was active from then on, oldest first.
    record: Vec<(u64, u16)>,
}

impl Watch {
    #[inline]
    pub(crate) const fn recorded(&self) -> usize {
        self.record.len()
    }

    /// Completes the record after a burst up to `cycle`. `before` is the number of changes that were recorded before
    /// the burst. A change ends a burst, so at most one is new. Its cycle is known only now, because an instruction's
    /// cycles are counted after its execution.
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

    #[inline]
    pub(crate) fn exception_changed(&mut self) {
        self.watch.changes += 1;
        if self.watch.on && self.watch.record.len() < MOST_CHANGES {
            self.watch.record.push((self.cycle, self.ipsr));
        }
    }

    /// Records a change of IPSR that came from neither an entry nor a return. `before` is the value that IPSR had.
    pub(crate) fn exception_changed_from(&mut self, before: u16) {
        if self.ipsr != before {
            self.exception_changed();
        }
    }
}
