//! Judges whether a fault has the consequence that the design requires (docs/design.md#start-and-supply).
//!
//! | fault | consequence | within |
//! |---|---|---|
//! | a bit of HORUS's flash changes | HORUS stops: its field goes off | [`bounds::HORUS_FLASH_FOUND`] |
//! | a bit of the DPR's flash changes | Link-Status reports a flash fault | [`bounds::DPR_FLASH_FOUND`] |
//! | a bit of a buffer of the DPR is stuck | Link-Status reports a RAM fault | [`bounds::SCRUBBED_CYCLES`] |
//! | HORUS has to stop ([`What::Warned`]) | its field goes off | [`bounds::SAFE_STATE`] |
//! | the DPR has to stop | transactions read 0xFF | [`bounds::SAFE_STATE`] |
//!
//! Both boards check their flash and their supply at the start, and a board with a fault does not start. After a board
//! has started or lost its supply, the judge therefore requires nothing more for an earlier fault. A stuck bit must be
//! reported only while new cycles are shown, because only then does the DPR use its buffers in turn.
//!
//! Nothing is required after a bit changes elsewhere in RAM or in a register, because the change may have no effect.

use super::Rule;
use crate::disturbance::{Excuse, Memory};
use crate::read::Reading;
use crate::{Board, Context, Disturbance, Event, Findings, Header, Violation, What, bounds};

#[derive(Clone, Copy, Debug)]
struct Stuck {
    /// The instant, ns, until which the bit is stuck.
    until: u64,
    /// The timestamp of the cycle that was last counted, ms.
    shown: Option<u32>,
    /// The number of new cycles that were read since the bit became stuck.
    cycles: u32,
}

/// The rule that judges whether a board reacts to a fault of its memory or supply; see the [module](self).
#[derive(Clone, Debug)]
pub struct Integrity {
    /// The instant, ns, by which each board has to react to a change of its flash; `None` if no reaction is due.
    flash_due: [Option<u64>; 2],
    /// The instant, ns, by which each board has to react to a falling supply; `None` if no reaction is due.
    supply_due: [Option<u64>; 2],
    /// The stuck bit that Link-Status still has to report.
    stuck: Option<Stuck>,
    field: bool,
}

impl Rule for Integrity {
    fn new(_header: &Header) -> Self {
        Self { flash_due: [None; 2], supply_due: [None; 2], stuck: None, field: false }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        self.pass(at, findings);
        match &event.what {
            What::Injected { disturbs: Disturbance::Memory { board, memory }, until, .. }
                if context.running(*board).powered =>
            {
                match (board, memory) {
                    (_, Memory::Flash) => {
                        let within = [bounds::HORUS_FLASH_FOUND, bounds::DPR_FLASH_FOUND][*board as usize];
                        self.flash_due[*board as usize].get_or_insert(at + within);
                    }
                    (Board::Dpr, Memory::Receive | Memory::Images) if *until > at => {
                        self.stuck = Some(Stuck { until: *until, shown: None, cycles: 0 });
                    }
                    _ => {}
                }
            }
            // A front end with a fault may fail to switch its field off on command.
            What::Warned { board }
                if *board == Board::Dpr || self.field && !context.disturbances().excuse(Excuse::Sending, at) =>
            {
                let ready = context.running(*board).since + bounds::START;
                self.supply_due[*board as usize] = Some(at.max(ready) + bounds::SAFE_STATE);
            }
            What::Power { board, .. } | What::Reset { board, .. } => {
                self.flash_due[*board as usize] = None;
                self.supply_due[*board as usize] = None;
                if *board == Board::Dpr {
                    self.stuck = None;
                }
            }
            What::Field { on } => {
                self.field = *on;
                if !on {
                    self.flash_due[Board::Horus as usize] = None;
                    self.supply_due[Board::Horus as usize] = None;
                }
            }
            What::Transaction { .. } => {
                if let Some(reading) = context.reading() {
                    self.read(reading, context.disturbances().excuse(Excuse::Service, reading.selected), findings);
                }
            }
            _ => {}
        }
    }
}

impl Integrity {
    /// Judges the supply and the buffers by a transaction. If `excused`, bytes may have changed on the wire, so a DPR
    /// in its safe state need not read as 0xFF throughout.
    fn read(&mut self, reading: &Reading, excused: bool, findings: &mut Findings) {
        let due = &mut self.supply_due[Board::Dpr as usize];
        if !excused && !reading.silent && due.take_if(|due| reading.selected > *due).is_some() {
            findings.add(Violation::FaultUnnoticed, reading.selected, || {
                "Dpr must be in its safe state, and it is read".to_owned()
            });
        }
        let Some(Ok(link)) = &reading.link else { return };
        if link.status.flash_fault() {
            self.flash_due[Board::Dpr as usize] = None;
        }
        if link.status.ram_fault() {
            self.stuck = None;
        }
        let Some(stuck) = &mut self.stuck else { return };
        let shown = reading.timestamp();
        if shown.is_some() && stuck.shown != shown {
            stuck.shown = shown;
            stuck.cycles += 1;
        }
        if stuck.cycles > bounds::SCRUBBED_CYCLES {
            findings.add(Violation::FaultUnnoticed, reading.selected, || "a bit of a buffer is stuck".to_owned());
            self.stuck = None;
        }
    }

    /// Reports each board that should have reacted to a fault before `now`; a fault is reported once.
    fn pass(&mut self, now: u64, findings: &mut Findings) {
        for board in [Board::Horus, Board::Dpr] {
            if let Some(due) = self.flash_due[board as usize].take_if(|due| now > *due) {
                findings.add(Violation::FaultUnnoticed, due, || format!("{board:?}'s flash was changed"));
            }
        }
        if let Some(due) = self.supply_due[Board::Horus as usize].take_if(|due| now > *due) {
            findings.add(Violation::FaultUnnoticed, due, || {
                "Horus must be in its safe state, and its field is on".to_owned()
            });
        }
        self.stuck.take_if(|stuck| now > stuck.until);
    }
}

#[cfg(test)]
mod tests {
    use profile::{LinkStatus, LinkStatusBits, LinkValues};

    use super::*;
    use crate::testing::{
        Events, HORUS_FRONT_END, IMAGE_BIT, MISUSE, MS, RECEIVE_BIT, found, header, injected, objects, silent_gps,
        silent_reported,
    };

    const BOARDS: [(Board, u64); 2] =
        [(Board::Horus, bounds::HORUS_FLASH_FOUND), (Board::Dpr, bounds::DPR_FLASH_FOUND)];

    fn found_in(events: Vec<(u64, What)>, end: u64) -> Vec<(Violation, u64, u64)> {
        let mut log = Events::new(3);
        events.into_iter().for_each(|(at, what)| _ = log.add(at, what));
        found(Integrity::new(&header(3)), &log.end(end).log()).0
    }

    fn broken(board: Board, memory: Memory, mut events: Vec<(u64, What)>, end: u64) -> Vec<(Violation, u64, u64)> {
        events.push((5, injected(Disturbance::Memory { board, memory }, 5)));
        found_in(events, end)
    }

    fn transaction(selected: u64, miso: Vec<u8>) -> What {
        What::Transaction { selected, mosi: vec![0; 8].into(), miso: miso.into() }
    }

    fn tells(fault: bool) -> What {
        let status = LinkStatusBits::new().with_flash_fault(fault);
        transaction(0, LinkStatus::seal(&LinkValues { status, ..LinkValues::default() }).as_bytes().to_vec())
    }

    fn shows(timestamp: u32, fault: bool) -> What {
        let status = LinkStatusBits::new().with_ram_fault(fault);
        let mut miso = LinkStatus::seal(&LinkValues { status, ..LinkValues::default() }).as_bytes().to_vec();
        miso.extend(objects(&silent_reported(timestamp), &[silent_gps(timestamp); 3]).concat());
        transaction(u64::from(timestamp) * MS, miso)
    }

    fn reset(board: Board) -> What {
        What::Reset { board, cause: crate::Cause::Pin, asked: true }
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
    fn a_restart_ends_the_duty_to_report_a_changed_flash_bit() {
        for (board, within) in BOARDS {
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

    #[test]
    fn a_bit_that_is_stuck_is_told_once_every_buffer_was_scrubbed() {
        let cycles = bounds::SCRUBBED_CYCLES;
        let shown = |count: u32, fault| -> Vec<(u64, What)> {
            (1..=count).map(|n| (u64::from(10 * n) * MS + 1, shows(10 * n, fault && n == count))).collect()
        };
        let until = |count: u32| u64::from(10 * count) * MS + 1;
        let stuck = |disturbs, until, events: Vec<(u64, What)>| {
            found_in([(5, injected(disturbs, until))].into_iter().chain(events).collect(), 1_000 * MS)
        };
        let untold = [(Violation::FaultUnnoticed, 1, u64::from(10 * (cycles + 1)) * MS)];
        for disturbs in [RECEIVE_BIT, IMAGE_BIT] {
            assert_eq!(stuck(disturbs, u64::MAX, shown(cycles, false)), []);
            assert_eq!(stuck(disturbs, u64::MAX, shown(2 * cycles, false)), untold, "told once");
            assert_eq!(stuck(disturbs, u64::MAX, shown(cycles + 1, true)), []);
            assert_eq!(stuck(disturbs, until(cycles + 1), shown(cycles + 1, false)), untold);
            assert_eq!(stuck(disturbs, until(cycles + 1) - 1, shown(cycles + 1, false)), [], "it is stuck no more");
            assert_eq!(stuck(disturbs, 5, shown(2 * cycles, false)), [], "it flipped");
            let flips = [(6, injected(RECEIVE_BIT, 6))].into_iter().chain(shown(2 * cycles, false)).collect();
            assert_eq!(stuck(disturbs, u64::MAX, flips), untold, "another bit flips beside it");
            let same = (1..100).map(|n| (n * MS, shows(10, false))).collect();
            assert_eq!(stuck(disturbs, u64::MAX, same), [], "one cycle, read often");
            for (board, expected) in [(Board::Dpr, vec![]), (Board::Horus, untold.to_vec())] {
                let restarted = shown(cycles + 1, false).into_iter().chain([(6, reset(board))]).collect();
                assert_eq!(stuck(disturbs, u64::MAX, restarted), expected);
            }
        }
    }

    #[test]
    fn a_horus_whose_supply_falls_switches_its_field_off_in_time() {
        const WARNED: u64 = 500 * MS;
        let (board, due) = (Board::Horus, WARNED + bounds::SAFE_STATE);
        let after = |what: Vec<(u64, What)>| {
            let before = [(MS, What::Field { on: true }), (WARNED, What::Warned { board })];
            found_in(before.into_iter().chain(what).collect(), 900 * MS)
        };
        let off = || What::Field { on: false };
        let late = [(Violation::FaultUnnoticed, 1, due)];
        assert_eq!(after(vec![]), late);
        assert_eq!(after(vec![(due, off())]), []);
        assert_eq!(after(vec![(due + 1, off())]), late);
        assert_eq!(after(vec![(due, reset(board))]), []);
        assert_eq!(after(vec![(due, reset(Board::Dpr))]), late);
        assert_eq!(after(vec![(WARNED - 1, off())]), [], "there is no field");
        assert_eq!(after(vec![(WARNED - 1, injected(HORUS_FRONT_END, WARNED))]), [], "its front end is out of order");
        // A board that starts with a falling supply checks the supply at the end of its start.
        let due = WARNED - MS + bounds::START + bounds::SAFE_STATE;
        let starting = |switched: u64| after(vec![(WARNED - MS, reset(board)), (switched, off())]);
        assert_eq!(starting(due), []);
        assert_eq!(starting(due + 1), [(Violation::FaultUnnoticed, 1, due)]);
    }

    #[test]
    fn a_dpr_whose_supply_falls_is_read_as_silent() {
        const WARNED: u64 = 500 * MS;
        let (board, due) = (Board::Dpr, WARNED + bounds::SAFE_STATE);
        let read = |selected, miso: u8, before: Option<What>| {
            let events = [(WARNED, What::Warned { board }), (selected + MS, transaction(selected, vec![miso; 300]))];
            found_in(events.into_iter().chain(before.map(|what| (WARNED + 1, what))).collect(), 900 * MS)
        };
        assert_eq!(read(due, 0, None), []);
        assert_eq!(read(due + 1, 0, None), [(Violation::FaultUnnoticed, 1, due + 1)]);
        assert_eq!(read(due + 1, 0xFF, None), []);
        assert_eq!(read(due + 1, 0, Some(reset(board))), []);
        assert_eq!(read(due + 1, 0, Some(reset(Board::Horus))).len(), 1);
        assert_eq!(read(due + 1, 0, Some(injected(MISUSE, 600 * MS))), [], "nobody knows what was read");
    }
}
