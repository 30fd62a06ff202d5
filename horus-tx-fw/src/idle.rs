//! The work of the idle loop while no task runs: slices of memory checks, and the log.
//!
//! # Design
//!
//! A slice of memory checks or a log message could delay a slot or a tick. So each begins only in the quiet part of a
//! cycle ([`timing::quiet`](crate::timing::quiet)). Work that finds no quiet part waits for that of the next cycle.

use firmware_common::patrol::{Pace, MOST_SLICES};
use st25r3916::Fault;

use crate::{telemetry::Telemetry, RECEIVERS};

/// Counts the slices of memory checks that are due.
#[derive(Clone, Copy, Debug)]
pub struct Slices {
    pace: Pace,
    due: u32,
}

impl Slices {
    /// Returns the count at the start, with no slice due. `now_us`, here and below, is the value of a µs counter that
    /// may wrap.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { pace: Pace::new(now_us), due: 0 }
    }

    /// Whether slices of memory checks are due at `now_us`. At most [`MOST_SLICES`] are due at once; slices that found
    /// no quiet part of an earlier cycle count among them.
    pub fn are_due(&mut self, now_us: u32) -> bool {
        self.due = (self.due + self.pace.due(now_us)).min(MOST_SLICES);
        self.due > 0
    }

    /// Whether to do another slice of memory checks now. If so, the slice counts as done.
    pub fn take(&mut self, is_quiet: impl FnOnce() -> bool) -> bool {
        let takes = self.due > 0 && is_quiet();
        self.due -= u32::from(takes);
        takes
    }
}

/// A message for the log. Receivers are numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// A fault of the front end.
    Radio(Fault),
    /// A receiver's response to its configuration: a [`Standing`](crate::configuration::Standing) as a number.
    Configuration {
        /// The number of the receiver.
        receiver: usize,
        /// The standing as a number.
        standing: u32,
    },
    /// The counts that are logged once a second.
    Second,
    /// The counts of the bus of a receiver. They are logged when they have changed, once a second at most.
    Bus {
        /// The number of the receiver.
        receiver: usize,
        /// The recoveries of the bus so far.
        recoveries: u32,
        /// The number of transactions so far that had not ended by the next tick.
        timed_out: u32,
    },
}

/// The messages that were logged last. A message is logged again only when it has changed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Journal {
    fault: Option<Fault>,
    standings: [u32; RECEIVERS],
    second: u32,
    buses: [(u32, u32); RECEIVERS],
}

impl Journal {
    /// Returns a journal in which no message was logged.
    #[must_use]
    pub const fn new() -> Self {
        Self { fault: None, standings: [0; RECEIVERS], second: 0, buses: [(0, 0); RECEIVERS] }
    }

    /// Logs what is new in `telemetry` at `second`, and the fault that `take_fault` returns. `log` returns whether it
    /// wrote the message. If it did not, the next call tries again; the message of a bus is tried once a second.
    pub fn write(
        &mut self,
        take_fault: impl FnOnce() -> Option<Fault>,
        second: u32,
        telemetry: &Telemetry,
        mut log: impl FnMut(Message) -> bool,
    ) {
        self.fault = self.fault.or_else(take_fault).filter(|fault| !log(Message::Radio(*fault)));
        let sources = || telemetry.sources.iter().enumerate();
        for ((receiver, source), last) in sources().zip(&mut self.standings) {
            let standing = source.configuration.get();
            if *last != standing && log(Message::Configuration { receiver, standing }) {
                *last = standing;
            }
        }
        if self.second == second {
            return;
        }
        if log(Message::Second) {
            self.second = second;
        }
        for ((receiver, source), last) in sources().zip(&mut self.buses) {
            let (recoveries, timed_out) = (source.recoveries.get(), source.timed_out.get());
            if *last != (recoveries, timed_out) && log(Message::Bus { receiver, recoveries, timed_out }) {
                *last = (recoveries, timed_out);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::{vec, vec::Vec};

    use super::*;

    #[test]
    fn missed_slices_are_made_up_for_up_to_a_limit() {
        let mut slices = Slices::new(0);
        assert!(!slices.are_due(2_499) && !slices.take(|| panic!("nothing is due")));
        assert!(slices.are_due(5_000) && !slices.take(|| false));
        assert!(slices.are_due(5_001), "they wait");
        assert_eq!((0..5).map(|_| slices.take(|| true)).collect::<Vec<_>>(), [true, true, false, false, false]);
        for step in 1..40 {
            slices.are_due(5_000 + 2_500 * step);
        }
        assert_eq!((0..40).filter(|_| slices.take(|| true)).count(), MOST_SLICES as usize);
    }

    fn logged(calls: &[(Option<Fault>, u32)], busy: &[usize], telemetry: &Telemetry) -> Vec<Vec<Message>> {
        let mut journal = Journal::new();
        let call = |(number, (fault, second)): (usize, &(Option<Fault>, u32))| {
            let mut written = vec![];
            journal.write(
                || *fault,
                *second,
                telemetry,
                |message| {
                    let is_quiet = !busy.contains(&number);
                    written.extend(is_quiet.then_some(message));
                    is_quiet
                },
            );
            written
        };
        calls.iter().enumerate().map(call).collect()
    }

    #[test]
    fn each_change_is_logged_once_and_the_counts_in_each_second() {
        let telemetry = Telemetry::new();
        telemetry.sources[0].configuration.set(2);
        telemetry.sources[0].timed_out.set(7);
        let written = logged(&[(None, 0), (None, 0), (None, 1), (None, 1), (None, 2)], &[], &telemetry);
        let configuration = Message::Configuration { receiver: 0, standing: 2 };
        let bus = Message::Bus { receiver: 0, recoveries: 0, timed_out: 7 };
        assert_eq!(written, [vec![configuration], vec![], vec![Message::Second, bus], vec![], vec![Message::Second]]);
    }

    #[test]
    fn what_finds_no_quiet_is_logged_by_the_next_call() {
        let telemetry = Telemetry::new();
        telemetry.sources[0].configuration.set(1);
        telemetry.sources[0].recoveries.set(3);
        let fault = Fault::Silence { field: true };
        let written = logged(&[(Some(fault), 1), (None, 1), (None, 1)], &[0], &telemetry);
        let all = vec![
            Message::Radio(fault),
            Message::Configuration { receiver: 0, standing: 1 },
            Message::Second,
            Message::Bus { receiver: 0, recoveries: 3, timed_out: 0 },
        ];
        assert_eq!(written, [vec![], all, vec![]]);
    }

    #[test]
    fn a_fault_that_waits_is_logged_before_another_is_taken() {
        let (first, second) = (Fault::Silence { field: true }, Fault::Silence { field: false });
        let written = logged(&[(Some(first), 0), (Some(second), 0), (None, 0)], &[0], &Telemetry::new());
        assert_eq!(written, [vec![], vec![Message::Radio(first)], vec![]]);
    }
}
