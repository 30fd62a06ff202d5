//! Whether a fault of memory has the consequence that the design demands.
//!
//! A bit of a board's flash that is changed on purpose is one of its firmware's image, which both boards compare with
//! its CRC round the clock (docs/design.md#start-and-supply). HORUS has to stop within [`bounds::HORUS_FLASH_FOUND`]:
//! its field goes off. The DPR has to say so in Link-Status within [`bounds::DPR_FLASH_FOUND`]. A start of the board,
//! or its supply going off, begins that anew, since both compare at their start, too: a board that does not come up has
//! noticed.
//!
//! What a changed bit of RAM or of a register does the outside cannot know: what becomes of it is for the other rules.

use super::Rule;
use crate::disturbance::Memory;
use crate::{Board, Context, Disturbance, Event, Findings, Header, Violation, What, bounds};

/// See the [module](self).
#[derive(Clone, Debug)]
pub struct Integrity {
    /// By when each board has to have noticed that its flash was changed, ns; nothing where it has, where that is told,
    /// or where there is nothing to notice.
    due: [Option<u64>; 2],
}

impl Rule for Integrity {
    fn new(_header: &Header) -> Self {
        Self { due: [None; 2] }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        self.pass(event.at, findings);
        match &event.what {
            What::Injected { disturbs: Disturbance::Memory { board, memory: Memory::Flash }, .. }
                if context.running(*board).powered =>
            {
                let within = match board {
                    Board::Horus => bounds::HORUS_FLASH_FOUND,
                    Board::Dpr => bounds::DPR_FLASH_FOUND,
                };
                self.due[*board as usize].get_or_insert(event.at + within);
            }
            What::Power { board, .. } | What::Reset { board, .. } => self.due[*board as usize] = None,
            What::Field { on: false } => self.due[Board::Horus as usize] = None,
            What::Transaction { .. } => {
                let told = context.reading().and_then(|reading| reading.link.as_ref());
                if told.is_some_and(|link| link.is_ok_and(|values| values.status.flash_fault())) {
                    self.due[Board::Dpr as usize] = None;
                }
            }
            _ => {}
        }
    }
}

impl Integrity {
    fn pass(&mut self, now: u64, findings: &mut Findings) {
        for board in [Board::Horus, Board::Dpr] {
            if let Some(due) = self.due[board as usize].take_if(|due| now > *due) {
                findings.add(Violation::FaultUnnoticed, due, || format!("{board:?}'s flash was changed"));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use profile::{LinkStatus, LinkStatusBits, LinkValues};

    use super::*;
    use crate::testing::{Events, MS, found, header, injected};

    const BOARDS: [(Board, u64); 2] =
        [(Board::Horus, bounds::HORUS_FLASH_FOUND), (Board::Dpr, bounds::DPR_FLASH_FOUND)];

    /// What is found where a bit of `memory` is changed at 5 ns and these events happen, in a run until `end`.
    fn broken(board: Board, memory: Memory, events: Vec<(u64, What)>, end: u64) -> Vec<(Violation, u64, u64)> {
        let mut log = Events::new(3);
        log.add(5, injected(Disturbance::Memory { board, memory }, 5));
        events.into_iter().for_each(|(at, what)| _ = log.add(at, what));
        found(Integrity::new(&header(3)), &log.end(end).log()).0
    }

    fn tells(fault: bool) -> What {
        let status = LinkStatusBits::new().with_flash_fault(fault);
        let values = LinkValues { status, ..LinkValues::default() };
        let miso = LinkStatus::seal(&values).as_bytes().to_vec();
        What::Transaction { selected: 0, mosi: vec![0; 8].into(), miso: miso.into() }
    }

    #[test]
    fn flash_that_was_changed_is_noticed_in_time() {
        for (board, within) in BOARDS {
            let due = 5 + within;
            let noticed = if board == Board::Horus { What::Field { on: false } } else { tells(true) };
            let other = if board == Board::Horus { tells(true) } else { What::Field { on: false } };
            let unnoticed = [(Violation::FaultUnnoticed, 1, due)];
            assert_eq!(broken(board, Memory::Flash, vec![], due), []);
            assert_eq!(broken(board, Memory::Flash, vec![], due + 1), unnoticed);
            assert_eq!(broken(board, Memory::Flash, vec![(due, noticed.clone())], 2 * due), []);
            assert_eq!(broken(board, Memory::Flash, vec![(due + 1, noticed)], 2 * due), unnoticed, "told once");
            for what in [other, tells(false), What::Field { on: true }] {
                assert_eq!(broken(board, Memory::Flash, vec![(MS, what)], due + 1), unnoticed);
            }
        }
    }

    #[test]
    fn a_start_of_the_board_begins_anew_and_other_memory_is_not_asked_for() {
        for (board, within) in BOARDS {
            let reset = |board| What::Reset { board, cause: crate::Cause::Pin, asked: true };
            let off = |board| What::Power { board, on: false };
            let other = BOARDS.map(|(board, _)| board)[1 - board as usize];
            for (what, expected) in [(reset(board), 0), (off(board), 0), (reset(other), 1), (off(other), 1)] {
                assert_eq!(broken(board, Memory::Flash, vec![(MS, what)], 2 * within).len(), expected, "{board:?}");
            }
            let mut off_before = Events::new(3);
            off_before.add(4, off(board)).add(5, injected(Disturbance::Memory { board, memory: Memory::Flash }, 5));
            let unseen = found(Integrity::new(&header(3)), &off_before.end(2 * within).log()).0;
            assert_eq!(unseen, [], "it compares at its start");
            for memory in [Memory::Ram, Memory::Registers, Memory::Images] {
                assert_eq!(broken(board, memory, vec![], 2 * within), []);
            }
            let second = injected(Disturbance::Memory { board, memory: Memory::Flash }, MS);
            assert_eq!(broken(board, Memory::Flash, vec![(MS, second)], within + 6).len(), 1, "the first counts");
        }
    }
}
