//! Limits how much processor time the second port may use.

/// The calls and SPI bytes that the second port has used in the present window of [`Budget::WINDOW_US`].
///
/// On the bench, the second port takes 60 calls and 500 SPI bytes in a window while the hold keeps to its period. In a
/// window with a bring-up of its chip, the second port takes 101 calls.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    window_us: u32,
    calls: u32,
    bytes: u32,
    resting: bool,
}

/// What a task of the second port may do when it is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The second port may work as usual.
    Work,
    /// The second port may work, and this is the first call of a window.
    Begin {
        /// Whether the second port was resting before this call.
        rested: bool,
    },
    /// The second port stops, because the budget is used up at this call.
    Rest,
    /// The second port does nothing, because the budget is used up and the window is not over.
    Resting,
}

impl Budget {
    /// The length of a budget's window, µs: the hold's period.
    pub const WINDOW_US: u32 = 1_000 * profile::hold::PERIOD_MS;
    /// The most calls of the second port's tasks in a window. A call that only makes a task check in counts too.
    pub const CALLS: u32 = 150;
    /// When the second port has used this number of SPI bytes in a window, it does no more work in that window.
    pub const BYTES: u32 = 1_500;

    /// The calls and SPI bytes that must be left when an answer begins: more than sending one takes. An answer whose
    /// bytes the second port does not load breaks off.
    pub const ANSWER: (u32, u32) = (40, 300);

    /// Returns the budget of a window that begins at `now_us`.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { window_us: now_us, calls: 0, bytes: 0, resting: false }
    }

    /// Takes a call at `now_us` off the budget. Calls must be less than 71 minutes apart, because `now_us` wraps.
    pub fn call(&mut self, now_us: u32) -> Turn {
        if now_us.wrapping_sub(self.window_us) >= Self::WINDOW_US {
            let rested = self.resting;
            *self = Self { calls: 1, ..Self::new(now_us) };
            return Turn::Begin { rested };
        }
        if self.resting {
            return Turn::Resting;
        }
        if self.calls >= Self::CALLS || self.bytes >= Self::BYTES {
            self.resting = true;
            return Turn::Rest;
        }
        self.calls += 1;
        Turn::Work
    }

    /// Takes `bytes` SPI bytes off the budget.
    pub fn carry(&mut self, bytes: u32) {
        self.bytes += bytes;
    }

    /// Whether enough is left of this window's budget for an answer.
    #[must_use]
    pub const fn has_answer(&self) -> bool {
        self.calls + Self::ANSWER.0 <= Self::CALLS && self.bytes + Self::ANSWER.1 <= Self::BYTES
    }

    /// Returns the calls and the SPI bytes that were used in this window.
    #[must_use]
    pub const fn spent(&self) -> (u32, u32) {
        (self.calls, self.bytes)
    }
}
