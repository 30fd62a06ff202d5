//! Determines whether HORUS's clock differs from the DPR's by more than 2 % over a second.

use std::collections::VecDeque;

use crate::bounds;
use crate::expectation::{Certainty, Delivery};

/// How long, ns, the DPR may take to notice a change of HORUS's clock: two comparisons, each over at most a second and
/// one step.
const NOTICED: u64 = 2 * (bounds::CLOCK_WINDOW + (bounds::MAX_MISSED as u64 + 1) * bounds::CYCLE) + 100_000_000;

/// The samples of about the last second, by which HORUS's clock is compared with the DPR's.
#[derive(Clone, Debug, Default)]
pub(super) struct Clocks {
    /// The timestamp, ms, of each cycle, and the instant, ns, of its sample.
    samples: VecDeque<(u32, u64)>,
    /// The last instant of a cycle, ns, at which HORUS's clock may have differed from the DPR's over the second before.
    disagreed: Option<u64>,
    /// The last instant of a cycle, ns, at which HORUS's clock may have agreed with the DPR's over the second before.
    agreed: u64,
}

impl Clocks {
    /// Returns whether Link-Status must call HORUS's clock implausible after this frame.
    pub(super) fn frame(&mut self, frame: &Delivery) -> Certainty {
        let Some(timestamp) = frame.timestamp else { return self.said(frame.sampled) };
        let second = self.samples.back().is_some_and(|(last, _)| *last == timestamp);
        if second && frame.shown == Certainty::Must {
            return self.said(frame.sampled);
        }
        if frame.shown > Certainty::Never {
            self.samples.push_back((timestamp, frame.sampled));
            self.compare();
        } else if frame.received == Certainty::Must {
            // The clocks are compared only while a sequence is found.
            *self = Self::default();
        }
        if frame.shown < Certainty::Must {
            self.agreed = frame.sampled;
        }
        self.said(frame.sampled)
    }

    fn compare(&mut self) {
        let Some(&(now, at)) = self.samples.back() else { return };
        let full = |sample: Option<&(u32, u64)>| {
            sample.is_some_and(|(_, from)| at.saturating_sub(*from) >= bounds::CLOCK_WINDOW)
        };
        while full(self.samples.get(1)) {
            self.samples.pop_front();
        }
        let Some(&(then, from)) = self.samples.front().filter(|first| full(Some(first))) else {
            self.agreed = at;
            return;
        };
        let passed = at.saturating_sub(from);
        let advance = u64::from(now.wrapping_sub(then)) * 1_000_000;
        let difference = advance.abs_diff(passed);
        let allowed = passed / bounds::CLOCK_SHARE;
        if difference + bounds::SEQUENCE_BAND > allowed {
            self.disagreed = Some(at);
        }
        if difference < allowed + bounds::SEQUENCE_BAND {
            self.agreed = at;
        }
    }

    fn said(&self, now: u64) -> Certainty {
        if self.disagreed.is_none_or(|at| now.saturating_sub(at) > NOTICED) {
            Certainty::Never
        } else if now.saturating_sub(self.agreed) > NOTICED {
            Certainty::Must
        } else {
            Certainty::May
        }
    }
}
