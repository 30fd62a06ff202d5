//! The bound of what the second port costs.

/// The work that the second port may do in a window of [`Budget::WINDOW_US`].
///
/// A hold that keeps to its period needs about 40 calls and 400 bytes in a window, supervision of the idle chip
/// included, and a bring-up of the chip 100 calls.
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
    /// The window is over: the port, which has rested, works again.
    Wake,
    /// The budget is used up: the port rests from now on.
    Rest,
    /// The port rests.
    Resting,
}

impl Budget {
    /// The length of a window, µs: the hold's period.
    pub const WINDOW_US: u32 = 1_000 * profile::hold::PERIOD_MS;
    /// The most calls in a window for which the port works. Calls of tasks that only check in count, too.
    pub const CALLS: u32 = 300;
    /// The number of bytes on the SPI in a window after which the port rests.
    pub const BYTES: u32 = 3_000;

    /// Returns the budget of a window that begins at `now_us`.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { window_us: now_us, calls: 0, bytes: 0, resting: false }
    }

    /// Takes a call at `now_us` off the budget. At least one call is needed every 71 minutes.
    pub fn call(&mut self, now_us: u32) -> Turn {
        let woken = now_us.wrapping_sub(self.window_us) >= Self::WINDOW_US && {
            let rested = self.resting;
            *self = Self::new(now_us);
            rested
        };
        if self.resting {
            return Turn::Resting;
        }
        self.calls += 1;
        if self.calls > Self::CALLS || self.bytes > Self::BYTES {
            self.resting = true;
            return Turn::Rest;
        }
        if woken {
            Turn::Wake
        } else {
            Turn::Work
        }
    }

    /// Takes bytes that go over the SPI off the budget.
    pub fn carry(&mut self, bytes: u32) {
        self.bytes += bytes;
    }
}
