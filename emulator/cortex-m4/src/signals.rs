//! The signals that a part drives into its core.

/// The signals that the part drives into the core, and its requests to [`crate::Core::run`].
///
/// The core checks the signals only after an announcement, so every method that changes a signal announces the change.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Signals {
    lines: [u64; 4],
    nmi: bool,
    event: bool,
    changed: bool,
    /// Whether [`crate::Bus::due`] moved and nothing else changed.
    moved: bool,
    code_changed: bool,
    stop: bool,
    stalled_until: u64,
}

impl Signals {
    /// Announces that [`crate::Bus::due`] or the core's clock changed. The core then checks again before its next
    /// instruction.
    #[inline]
    pub fn announce(&mut self) {
        self.changed = true;
    }

    /// Announces that [`crate::Bus::due`] moved and nothing else changed. This call costs the core less than
    /// [`Signals::announce`].
    #[inline]
    pub fn announce_due(&mut self) {
        self.moved = true;
    }

    /// Whether an announcement waits for the core.
    #[inline]
    #[must_use]
    pub fn is_announced(&self) -> bool {
        self.changed | self.moved
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

    /// Raises an event from outside for `WFE`. The core clears the event when it takes it.
    pub fn raise_event(&mut self) {
        (self.event, self.changed) = (true, true);
    }

    /// Makes the core drop its decoded instructions, after flash was programmed or erased. RAM needs no such call.
    pub fn forget_code(&mut self) {
        (self.code_changed, self.changed) = (true, true);
    }

    /// Whether the core still has to drop its decoded instructions.
    #[must_use]
    pub fn forgets_code(&self) -> bool {
        self.code_changed
    }

    /// Makes [`crate::Core::run`] return [`crate::Exit::Stopped`] after the present instruction.
    pub fn stop(&mut self) {
        (self.stop, self.changed) = (true, true);
    }

    /// Keeps the core from executing anything before `cycle`, as a busy flash controller does. 0 ends the stall.
    #[inline]
    pub fn stall_until(&mut self, cycle: u64) {
        if std::mem::replace(&mut self.stalled_until, cycle) != cycle {
            self.changed = true;
        }
    }

    /// The cycle before which the core must execute nothing.
    #[must_use]
    pub fn stalled_until(&self) -> u64 {
        self.stalled_until
    }

    #[inline]
    pub(crate) fn take_change(&mut self) -> Option<Change> {
        let signals = std::mem::take(&mut self.changed);
        if !std::mem::take(&mut self.moved) && !signals {
            return None;
        }
        let forget_code = std::mem::take(&mut self.code_changed);
        let stop = std::mem::take(&mut self.stop);
        Some(Change { signals, stalled_until: self.stalled_until, forget_code, stop })
    }

    #[inline]
    pub(crate) fn take_event(&mut self) -> bool {
        std::mem::take(&mut self.event)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Change {
    /// Whether more than [`crate::Bus::due`] changed, so that exceptions have to be checked.
    pub(crate) signals: bool,
    pub(crate) stalled_until: u64,
    pub(crate) forget_code: bool,
    pub(crate) stop: bool,
}
