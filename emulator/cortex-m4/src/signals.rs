//! What a part drives into its core.

/// What the part drives into the core, and what it wants of [`crate::Core::run`].
///
/// The core looks only where something was announced, so every method here that changes a signal announces it, and no
/// signal can be reached in another way.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Signals {
    lines: [u64; 4],
    nmi: bool,
    event: bool,
    changed: bool,
    code_changed: bool,
    stop: bool,
    stalled_until: u64,
}

impl Signals {
    /// [`crate::Bus::due`] or the core's clock is another: the core looks again before its next instruction.
    #[inline]
    pub fn announce(&mut self) {
        self.changed = true;
    }

    /// Whether the core has something to look at.
    #[inline]
    #[must_use]
    pub fn is_announced(&self) -> bool {
        self.changed
    }

    /// The levels of the interrupt lines: line n is bit n % 64 of word n / 64.
    #[must_use]
    pub fn lines(&self) -> &[u64; 4] {
        &self.lines
    }

    /// Drives all lines of one word of [`Signals::lines`].
    #[inline]
    pub fn drive_lines(&mut self, word: usize, levels: u64) {
        if std::mem::replace(&mut self.lines[word], levels) != levels {
            self.changed = true;
        }
    }

    /// Drives one interrupt line.
    #[inline]
    pub fn drive_line(&mut self, line: usize, high: bool) {
        let (word, bit) = (line / 64, 1 << (line % 64));
        let others = self.lines[word] & !bit;
        self.drive_lines(word, if high { others | bit } else { others });
    }

    /// The level of the NMI input.
    #[must_use]
    pub fn nmi(&self) -> bool {
        self.nmi
    }

    /// Drives the NMI input.
    pub fn drive_nmi(&mut self, high: bool) {
        if std::mem::replace(&mut self.nmi, high) != high {
            self.changed = true;
        }
    }

    /// An event for `WFE` comes from outside; the core takes it back.
    pub fn raise_event(&mut self) {
        (self.event, self.changed) = (true, true);
    }

    /// Instructions that were decoded no longer are what memory holds (flash was programmed or erased): the core
    /// forgets what it decoded. RAM needs no such notice.
    pub fn forget_code(&mut self) {
        (self.code_changed, self.changed) = (true, true);
    }

    /// Whether the core has code to forget that it has not forgotten yet.
    #[must_use]
    pub fn forgets_code(&self) -> bool {
        self.code_changed
    }

    /// [`crate::Core::run`] returns after the instruction, with [`crate::Exit::Stopped`].
    pub fn stop(&mut self) {
        (self.stop, self.changed) = (true, true);
    }

    /// The core executes nothing before `cycle`, since the bus holds it (a flash controller that works); 0 lets it go.
    #[inline]
    pub fn stall_until(&mut self, cycle: u64) {
        if std::mem::replace(&mut self.stalled_until, cycle) != cycle {
            self.changed = true;
        }
    }

    /// The cycle before which the core executes nothing.
    #[must_use]
    pub fn stalled_until(&self) -> u64 {
        self.stalled_until
    }

    /// What was announced since the core last asked: the core has looked then.
    #[inline]
    pub(crate) fn take_change(&mut self) -> Option<Change> {
        if !std::mem::take(&mut self.changed) {
            return None;
        }
        let forget_code = std::mem::take(&mut self.code_changed);
        Some(Change { stalled_until: self.stalled_until, forget_code, stop: std::mem::take(&mut self.stop) })
    }

    /// Whether an event for `WFE` came since the core last asked.
    #[inline]
    pub(crate) fn take_event(&mut self) -> bool {
        std::mem::take(&mut self.event)
    }
}

/// What the core has to act on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    /// The core executes nothing before this cycle.
    pub(crate) stalled_until: u64,
    /// What was decoded is no longer what memory holds.
    pub(crate) forget_code: bool,
    /// [`crate::Core::run`] returns.
    pub(crate) stop: bool,
}
