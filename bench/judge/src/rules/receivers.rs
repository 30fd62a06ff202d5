//! Whether HORUS reads what its receivers have to say.
//!
//! What a receiver on a bus says it keeps until it is read: [`What::Offered`] tells when it has something, and
//! [`What::Fed`] what of it crossed the bus. While HORUS has no supply, starts or hangs, and while [`Excuse::Polling`]
//! holds, nothing is asked: what is offered then is asked for from the next offer on. What comes to be offered while
//! something is read belongs to that, and so does its first byte. A receiver that is not read is told once for each
//! [`bounds::READ_WITHIN`].

use crate::disturbance::Excuse;
use crate::{Board, Context, Event, Figures, Findings, Header, Violation, What, bounds};

/// See the [module](self).
#[derive(Clone, Debug)]
pub struct Receivers {
    /// Since when each receiver has had something to say of which nothing was read, ns.
    waiting: Vec<Option<u64>>,
    /// When the last byte that was read of each had crossed the bus, ns.
    read_until: Vec<u64>,
}

impl Receivers {
    /// Nothing has happened yet.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        Self { waiting: vec![None; header.gps], read_until: vec![0; header.gps] }
    }

    /// Takes the next event.
    pub fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        self.pass(at, findings);
        match &event.what {
            What::Power { board: Board::Horus, .. }
            | What::Reset { board: Board::Horus, .. }
            | What::Hung { board: Board::Horus } => self.waiting.fill(None),
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Polling) => self.waiting.fill(None),
            What::Offered { receiver, .. } => {
                let horus = context.running(Board::Horus);
                let runs = horus.powered && horus.hung.is_none() && at >= horus.since + bounds::START;
                if let Some(waiting) = self.waiting.get_mut(*receiver)
                    && runs
                    && at >= self.read_until[*receiver]
                    && !context.disturbances().excuse(Excuse::Polling, at)
                {
                    waiting.get_or_insert(at);
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

    /// It is `now`: what has waited for too long by then is told.
    fn pass(&mut self, now: u64, findings: &mut Findings) {
        for (number, waiting) in (1..).zip(&mut self.waiting) {
            if let Some(since) = waiting.take_if(|since| now > *since + bounds::READ_WITHIN) {
                findings.add(Violation::NotRead, since + bounds::READ_WITHIN, || {
                    format!("GPS{number} for {} ns", bounds::READ_WITHIN)
                });
            }
        }
    }

    /// The run is over.
    pub fn finish(&mut self, context: &Context, findings: &mut Findings, _figures: &mut Figures) {
        self.pass(context.now(), findings);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Disturbance;
    use crate::testing::{Events, MS, found, header, injected};

    /// The first instant at which anything is asked for.
    const FROM: u64 = bounds::START;
    const DUE: u64 = FROM + bounds::READ_WITHIN;

    fn offered() -> What {
        What::Offered { receiver: 1, bytes: vec![1].into() }
    }

    fn fed(receiver: usize) -> What {
        What::Fed { receiver, byte_ns: 1, bytes: vec![1].into(), clean: false, old: true }
    }

    /// What is found where GPS2 offers something at `at` and these events happen, in a run until `end`.
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
        // Offered in the middle of what is read, which ends 1 ns after it began, and behind that.
        assert_eq!(broken(FROM, vec![(FROM - 1, fed(1))], DUE + 1), [NOT_READ], "read before");
        assert_eq!(broken(FROM, vec![(FROM, fed(1)), (FROM, offered())], DUE + 1), []);
        // Told again for what is offered after that.
        let again = vec![(DUE + 1, offered())];
        assert_eq!(broken(FROM, again, DUE + bounds::READ_WITHIN + 2), [(Violation::NotRead, 2, DUE)]);
    }

    #[test]
    fn a_horus_that_starts_hangs_or_has_no_supply_reads_nothing() {
        assert_eq!(broken(FROM - 1, vec![], DUE + 1), []);
        let reset = What::Reset { board: Board::Horus, cause: "a test".into(), asked: true };
        let of_dpr = What::Reset { board: Board::Dpr, cause: "a test".into(), asked: true };
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
        let other = injected(Disturbance::Air, FROM + MS);
        assert_eq!(broken(FROM, vec![(FROM + 1, other)], DUE + 1), [NOT_READ]);
    }
}
