//! What the idle loop does when nothing else wants to run: which slices of the patrol are due, and what is logged.
//!
//! # Design
//!
//! A slice and a log message each take long enough to delay a slot or a tick, so each begins in the quiet part of a
//! cycle alone ([`timing::quiet`](crate::timing::quiet)). What finds no quiet is not given up: slices are made up for,
//! and a message is tried again by the next call.

use firmware_common::patrol::{Pace, MOST_SLICES};
use st25r3916::Fault;

use crate::{telemetry::Telemetry, RECEIVERS};

/// The slices of the patrol that are due.
#[derive(Clone, Copy, Debug)]
pub struct Slices {
    pace: Pace,
    due: u32,
}

impl Slices {
    /// From `now_us` on: a µs counter that may wrap, here and below.
    #[must_use]
    pub const fn new(now_us: u32) -> Self {
        Self { pace: Pace::new(now_us), due: 0 }
    }

    /// Whether there are any at `now_us`: at most [`MOST_SLICES`], of which those count that found no quiet before.
    pub fn are_due(&mut self, now_us: u32) -> bool {
        self.due = (self.due + self.pace.due(now_us)).min(MOST_SLICES);
        self.due > 0
    }

    /// Whether to do another one now; it counts as done.
    pub fn take(&mut self, is_quiet: impl FnOnce() -> bool) -> bool {
        let takes = self.due > 0 && is_quiet();
        self.due -= u32::from(takes);
        takes
    }
}

/// What is logged. Receivers are numbered from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// A fault of the front end.
    Radio(Fault),
    /// What a receiver has made of its configuration: a [`Standing`](crate::configuration::Standing) as a number.
    Configuration {
        /// The receiver.
        receiver: usize,
        /// The standing.
        standing: u32,
    },
    /// The counts of each second.
    Second,
    /// The counts of a receiver's bus, if they have changed within a second.
    Bus {
        /// The receiver.
        receiver: usize,
        /// Recoveries so far.
        recoveries: u32,
        /// Transactions so far that had not ended by the next tick.
        timed_out: u32,
    },
}

/// What was logged last, so that each change is logged once.
#[derive(Clone, Copy, Debug, Default)]
pub struct Journal {
    fault: Option<Fault>,
    standings: [u32; RECEIVERS],
    second: u32,
    buses: [(u32, u32); RECEIVERS],
}

impl Journal {
    /// Nothing was logged.
    #[must_use]
    pub const fn new() -> Self {
        Self { fault: None, standings: [0; RECEIVERS], second: 0, buses: [(0, 0); RECEIVERS] }
    }

    /// Logs what is new in `telemetry` at `second`, and the fault that `take_fault` gives. `log` tells whether it has
    /// written the message; one that it has not is tried again by the next call, that of a bus once in a second.
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
    fn slices_that_find_no_quiet_are_made_up_for_up_to_a_limit() {
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

    /// What a journal logs in each of some calls, of which those of `busy` find no quiet.
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
