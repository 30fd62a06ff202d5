//! The bound of what the second port costs.

/// The work that the second port may do in a window of [`Budget::WINDOW_US`].
///
/// On the bench a window takes 60 calls and 500 bytes while the hold keeps to its period, and 101 calls if the chip is
/// brought up in it.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    window_us: u32,
    calls: u32,
    bytes: u32,
    resting: bool,
}

/// What a call of the port's tasks may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The port works.
    Work,
    /// The port works, and this is the first call of a window.
    Begin {
        /// Whether the port has rested up to now.
        rested: bool,
    },
    /// The budget is used up: the port rests from now on.
    Rest,
    /// The port rests.
    Resting,
}

impl Budget {
    /// The length of a window, µs: the hold's period.
    pub const WINDOW_US: u32 = 1_000 * profile::hold::PERIOD_MS;
    /// The most calls in a window for which the port works. Calls of tasks that only check in count, too.
    pub const CALLS: u32 = 150;
    /// The number of bytes on the SPI in a window after which the port rests.
    pub const BYTES: u32 = 1_500;

    /// Returns the budget of a window that begins at `now_us`.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { window_us: now_us, calls: 0, bytes: 0, resting: false }
    }

    /// Takes a call at `now_us` off the budget. At least one call is needed every 71 minutes.
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

    /// Takes bytes that go over the SPI off the budget.
    pub fn carry(&mut self, bytes: u32) {
        self.bytes += bytes;
    }

    /// Returns the calls and the bytes of this window so far.
    #[must_use]
    pub const fn spent(&self) -> (u32, u32) {
        (self.calls, self.bytes)
    }
}
