//! How long it takes from the end of a cause until the flight controller reads what HORUS sends after it.

use crate::{Event, What, bounds};

/// Nothing is measured of a cause whose end is nearer to the end of the run than this, ns.
const TAIL: u64 = 500_000_000;

/// See the [module](self).
#[derive(Clone, Debug, Default)]
pub(super) struct Recovery {
    /// The end of the last cause, ns, if nothing that was sent after it has been read yet.
    since: Option<u64>,
    /// Whether a board has no supply: its cause has no end yet.
    off: [bool; 2],
    /// Ends of causes of the last [`TAIL`], and how many cycles each took.
    recent: Vec<(u64, u64)>,
    longest: Option<u64>,
}

impl Recovery {
    /// Takes the next event.
    pub(super) fn take(&mut self, event: &Event) {
        self.settle(event.at);
        match &event.what {
            // What never goes away is no cause that anything could recover from.
            What::Injected { until, .. } if *until < u64::MAX => self.cause((*until).max(event.at)),
            What::Reset { .. } => self.cause(event.at),
            // The run begins with the power-on of both boards: that is no cause.
            What::Power { board, on } if event.at > 0 => {
                self.off[*board as usize] = !on;
                self.cause(event.at);
            }
            _ => {}
        }
    }

    /// Of causes that overlap, or follow each other before the link has recovered, the last end counts.
    fn cause(&mut self, end: u64) {
        self.since = Some(self.since.map_or(end, |since| since.max(end)));
    }

    /// A transaction that began at `selected` showed an object of a frame that was `started` then, ns.
    pub(super) fn shown(&mut self, started: u64, selected: u64) {
        if self.off.contains(&true) {
            return;
        }
        if let Some(since) = self.since.take_if(|since| started > *since) {
            self.recent.push((since, cycles(since, selected)));
        }
    }

    /// Causes that the run has left far enough behind count.
    fn settle(&mut self, now: u64) {
        let longest = &mut self.longest;
        self.recent.retain(|(since, cycles)| {
            let counts = now >= since.saturating_add(TAIL);
            if counts {
                *longest = (*longest).max(Some(*cycles));
            }
            !counts
        });
    }

    /// The most cycles of 10 ms begun from a cause's end on. What had not recovered by `end` has taken all the time
    /// until then.
    pub(super) fn finish(&mut self, end: u64) -> Option<u64> {
        if let Some(since) = self.since.take().filter(|_| !self.off.contains(&true)) {
            self.recent.push((since, cycles(since, end)));
        }
        self.settle(end);
        self.longest
    }
}

/// Cycles begun in `from..to`: at least one.
fn cycles(from: u64, to: u64) -> u64 {
    to.saturating_sub(from).div_ceil(bounds::CYCLE).max(1)
}
