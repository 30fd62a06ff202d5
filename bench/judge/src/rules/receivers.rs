//! Judges whether HORUS reads the bytes that its receivers offer, and whether it sets the receivers to send positions.
//!
//! HORUS must read the bytes that a receiver on a bus offers ([`What::Offered`], [`What::Fed`]). It need not read while
//! it has no supply, starts or hangs, nor while [`Excuse::Polling`] holds for the receiver. Bytes that a receiver
//! offers while it is being read count as read. A receiver that is not read is reported once for each
//! [`bounds::READ_WITHIN`].
//!
//! HORUS must set a simulated receiver to send positions if it sends none, as its settings in the log say
//! ([`What::Settings`]). HORUS has [`bounds::SETTINGS_TOLD`] for this from its start, or from when the receiver ceased
//! to send them. While [`Excuse::Settings`] holds for the receiver, this is not required. A violation is reported once.

use super::Rule;
use crate::disturbance::Excuse;
use crate::{Board, Context, Event, Findings, Header, Violation, What, bounds};

/// The rule that judges whether HORUS reads its receivers and sets them to send positions; see the [module](self).
#[derive(Clone, Debug)]
pub struct Receivers {
    /// For each receiver, the instant, ns, since which it has offered bytes without being read.
    waiting: Vec<Option<u64>>,
    /// For each receiver, the instant, ns, at which the last byte was read from it.
    read_until: Vec<u64>,
    /// For each receiver, the instant, ns, since which it has sent no positions. `None` if it sends them, or once that
    /// was reported.
    unset: Vec<Option<u64>>,
}

impl Rule for Receivers {
    fn new(header: &Header) -> Self {
        Self { waiting: vec![None; header.gps], read_until: vec![0; header.gps], unset: vec![None; header.gps] }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        self.pass(at, context, findings);
        match &event.what {
            What::Power { board: Board::Horus, .. }
            | What::Reset { board: Board::Horus, .. }
            | What::Hung { board: Board::Horus } => self.waiting.fill(None),
            What::Injected { .. } => {
                let excused = |receiver| context.disturbances().excuse_of(receiver, Excuse::Polling, at);
                let waiting = self.waiting.iter_mut().enumerate();
                waiting.filter(|(receiver, _)| excused(*receiver)).for_each(|(_, waiting)| *waiting = None);
            }
            What::Offered { receiver, .. } => {
                let horus = context.running(Board::Horus);
                let runs = horus.powered && horus.hung.is_none() && at >= horus.since + bounds::START;
                if let Some(waiting) = self.waiting.get_mut(*receiver)
                    && runs
                    && at >= self.read_until[*receiver]
                    && !context.disturbances().excuse_of(*receiver, Excuse::Polling, at)
                {
                    waiting.get_or_insert(at);
                }
            }
            What::Settings { receiver, position, .. } => {
                if let Some(unset) = self.unset.get_mut(*receiver) {
                    *unset = (!position).then_some(unset.unwrap_or(at));
                }
            }
            What::Fed { receiver, byte_ns, bytes, .. } => {
                if let Some(waiting) = self.waiting.get_mut(*receiver) {
                    *waiting = None;
                    self.read_until[*receiver] = at + byte_ns * bytes.len() as u64;
                }
            }
            _ => {}
        }
    }
}

impl Receivers {
    /// Reports the receivers that should have been read, or set to send positions, by `now`.
    fn pass(&mut self, now: u64, context: &Context, findings: &mut Findings) {
        for (number, waiting) in (1..).zip(&mut self.waiting) {
            if let Some(since) = waiting.take_if(|since| now > *since + bounds::READ_WITHIN) {
                findings.add(Violation::NotRead, since + bounds::READ_WITHIN, || {
                    format!("GPS{number} for {} ns", bounds::READ_WITHIN)
                });
            }
        }
        let horus = context.running(Board::Horus);
        if !horus.powered || horus.hung.is_some() {
            return;
        }
        for (receiver, unset) in self.unset.iter_mut().enumerate() {
            let due = |since: u64| since.max(horus.since) + bounds::SETTINGS_TOLD;
            let excused = context.disturbances().excuse_of(receiver, Excuse::Settings, now);
            if let Some(since) = unset.take_if(|since| now > due(*since) && !excused) {
                findings
                    .add(Violation::NotConfigured, due(since), || format!("GPS{} puts no positions out", receiver + 1));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Disturbance;
    use crate::testing::{Events, MS, found, header, injected};

    const FROM: u64 = bounds::START;
    const DUE: u64 = FROM + bounds::READ_WITHIN;

    fn offered() -> What {
        What::Offered { receiver: 1, bytes: vec![1].into() }
    }

    fn fed(receiver: usize) -> What {
        What::Fed { receiver, byte_ns: 1, bytes: vec![1].into(), clean: false, since: Some(0) }
    }

    fn broken(at: u64, events: Vec<(u64, What)>, end: u64) -> Vec<(Violation, u64, u64)> {
        let mut log = Events::new(3);
        log.add(at, offered());
        events.into_iter().for_each(|(at, what)| _ = log.add(at, what));
        found(Receivers::new(&header(3)), &log.end(end).log()).0
    }

    const NOT_READ: (Violation, u64, u64) = (Violation::NotRead, 1, DUE);

    #[test]
    fn what_a_receiver_offers_is_read_within_a_second() {
        assert_eq!(broken(FROM, vec![], DUE), []);
        assert_eq!(broken(FROM, vec![], DUE + 1), [NOT_READ]);
        assert_eq!(broken(FROM, vec![(DUE, fed(1))], DUE + 1), []);
        assert_eq!(broken(FROM, vec![(DUE, fed(0))], DUE + 1), [NOT_READ], "another one's");
        assert_eq!(broken(FROM, vec![(DUE - 1, offered())], DUE + 1), [NOT_READ], "the first counts");
        assert_eq!(broken(FROM, vec![(FROM - 1, fed(1))], DUE + 1), [NOT_READ], "read before");
        assert_eq!(broken(FROM, vec![(FROM, fed(1)), (FROM, offered())], DUE + 1), []);
        let long = What::Fed { receiver: 1, byte_ns: 1_000, bytes: vec![1; 10].into(), clean: false, since: Some(0) };
        for (after, expected) in [(9_999, 0), (10_000, 1)] {
            let during = vec![(FROM, long.clone()), (FROM + after, offered())];
            assert_eq!(broken(FROM, during, DUE + after + 1).len(), expected, "{after}");
        }
        let again = vec![(DUE + 1, offered())];
        assert_eq!(broken(FROM, again, DUE + bounds::READ_WITHIN + 2), [(Violation::NotRead, 2, DUE)]);
    }

    #[test]
    fn a_horus_that_starts_hangs_or_has_no_supply_reads_nothing() {
        assert_eq!(broken(FROM - 1, vec![], DUE + 1), []);
        let reset = What::Reset { board: Board::Horus, cause: crate::Cause::Pin, asked: true };
        let of_dpr = What::Reset { board: Board::Dpr, cause: crate::Cause::Pin, asked: true };
        let off = What::Power { board: Board::Horus, on: false };
        let hung = What::Hung { board: Board::Horus };
        for (what, expected) in
            [(reset, vec![]), (off.clone(), vec![]), (hung.clone(), vec![]), (of_dpr, vec![NOT_READ])]
        {
            assert_eq!(broken(FROM, vec![(FROM + MS, what.clone())], DUE + 1), expected, "{what:?}");
        }
        for what in [off, hung] {
            let events = vec![(FROM - MS, what.clone()), (FROM, offered())];
            assert_eq!(broken(0, events, DUE + 1), [], "{what:?}");
        }
    }

    #[test]
    fn a_disturbed_receiver_is_read_within_a_second_of_its_disturbance() {
        let disturbed = || injected(Disturbance::Receiver { receiver: 1 }, FROM + MS);
        assert_eq!(broken(FROM, vec![(FROM + 1, disturbed())], DUE + 1), []);
        let over = FROM + MS + bounds::READ_WITHIN;
        let later = |at| broken(at, vec![(FROM + 1, disturbed())], over + bounds::READ_WITHIN + 1).len();
        assert_eq!((later(over - 1), later(over)), (0, 1));
        let another = Disturbance::Receiver { receiver: 0 };
        for other in [Disturbance::Air, another] {
            assert_eq!(broken(FROM, vec![(FROM + 1, injected(other, FROM + MS))], DUE + 1), [NOT_READ], "{other:?}");
        }
    }

    fn unset(events: Vec<(u64, What)>, end: u64) -> Vec<(Violation, u64, u64)> {
        let mut log = Events::new(3);
        events.into_iter().for_each(|(at, what)| _ = log.add(at, what));
        found(Receivers::new(&header(3)), &log.end(end).log()).0
    }

    fn settings(position: bool) -> What {
        What::Settings { receiver: 1, model: 7, position }
    }

    const TOLD: u64 = bounds::SETTINGS_TOLD;

    #[test]
    fn a_receiver_that_puts_no_positions_out_is_set_within_a_time() {
        let told = |due| vec![(Violation::NotConfigured, 1, due)];
        let from = |at| vec![(at, settings(false))];
        assert_eq!(unset(from(5), TOLD + 5), []);
        assert_eq!(unset(from(5), TOLD + 6), told(TOLD + 5));
        assert_eq!(
            unset([from(5), from(9)].concat(), 3 * TOLD),
            told(TOLD + 5),
            "the first counts, and it is told once"
        );
        let set = vec![(5, settings(false)), (TOLD + 5, settings(true))];
        assert_eq!(unset(set.clone(), 3 * TOLD), []);
        let again = [set, vec![(2 * TOLD, settings(false))]].concat();
        assert_eq!(unset(again, 3 * TOLD + 1), told(3 * TOLD));
    }

    #[test]
    fn a_restart_or_a_receivers_own_fault_postpones_its_settings() {
        let with = |at: u64, what: What, end: u64| unset(vec![(5, settings(false)), (at, what)], end).len();
        let reset = || What::Reset { board: Board::Horus, cause: crate::Cause::Pin, asked: true };
        assert_eq!((with(9, reset(), TOLD + 9), with(9, reset(), TOLD + 10)), (0, 1));
        for what in [What::Power { board: Board::Horus, on: false }, What::Hung { board: Board::Horus }] {
            assert_eq!(with(9, what, 3 * TOLD), 0, "nobody can");
        }
        let broken = |receiver| injected(Disturbance::Receiver { receiver }, MS);
        assert_eq!((with(9, broken(1), MS + TOLD - 1), with(9, broken(1), MS + TOLD)), (0, 1));
        assert_eq!(with(9, broken(0), TOLD + 6), 1, "another one's");
    }
}
