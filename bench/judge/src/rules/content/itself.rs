//! Judges what HORUS states about itself in Reported-Position: the reason of its start, its crystal and its memory.
//!
//! | bits | right value |
//! |---|---|
//! | 13-15 | the cause of the last reset in the log, or power-on; any reason for a cause that HORUS cannot report |
//! | 7 | 0 if the external oscillator worked at HORUS's last start, else 1; either if that changed during the start |
//! | 12 | 0 until HORUS's memory or program was disturbed; a first 1 stays 1 until the next start |
//!
//! HORUS is not required to find a fault of its memory, because the log does not state where a bit was hit.

use profile::{ReportedStatus, ResetReason};

use crate::{Board, Cause, Disturbance, What, bounds};

#[derive(Clone, Debug)]
pub(super) struct Itself {
    /// The reason of HORUS's last start; `None` for a cause that HORUS cannot report.
    reason: Option<ResetReason>,
    hit: bool,
    said: bool,
    since: u64,
    crystal: bool,
    /// Whether the oscillator worked at HORUS's last start.
    started_with: bool,
    /// Whether the oscillator failed, or recovered, during HORUS's last start.
    unsure: bool,
}

impl Itself {
    /// Returns the state just after HORUS's supply has come on.
    pub(super) const fn new() -> Self {
        Self {
            reason: Some(ResetReason::PowerOn),
            hit: false,
            said: false,
            since: 0,
            crystal: true,
            started_with: true,
            unsure: false,
        }
    }

    pub(super) fn take(&mut self, at: u64, what: &What) {
        match what {
            What::Power { board: Board::Horus, .. } => *self = Self { reason: Some(ResetReason::PowerOn), ..*self },
            What::Reset { board: Board::Horus, cause, .. } => self.reason = reason(*cause),
            What::Crystal { board: Board::Horus, works } => {
                self.crystal = *works;
                self.unsure |= at < self.since + bounds::START && *works != self.started_with;
                return;
            }
            What::Injected { disturbs, .. } => {
                self.hit |= matches!(
                    disturbs,
                    Disturbance::Memory { board: Board::Horus, .. } | Disturbance::Code { board: Board::Horus }
                );
                return;
            }
            _ => return,
        }
        self.said = false;
        (self.since, self.started_with, self.unsure) = (at, self.crystal, false);
    }

    pub(super) fn keeps_ram(&self) -> bool {
        self.reason != Some(ResetReason::PowerOn)
    }

    /// Returns, in words, what the status states wrongly about the crystal.
    pub(super) fn wrong_crystal(&self, status: ReportedStatus) -> Option<&'static str> {
        match (status.without_crystal(), self.started_with) {
            _ if self.unsure => None,
            (true, true) => Some("HORUS says that it has no crystal, and it had one as it started"),
            (false, false) => Some("HORUS says that it has a crystal, and it had none as it started"),
            _ => None,
        }
    }

    /// Returns, in words, an error in a Reported-Position's status about the last reset or HORUS's memory.
    pub(super) fn wrong(&mut self, status: ReportedStatus) -> Option<String> {
        let told = status.reset_reason();
        if told.is_none() || self.reason.is_some_and(|reason| told != Some(reason)) {
            return Some(format!("the last reset is told as {told:?}, and was {:?}", self.reason));
        }
        let said_before = std::mem::replace(&mut self.said, status.memory_fault());
        match (status.memory_fault(), said_before) {
            (true, _) if !self.hit => Some("a memory fault is told, and there is none".into()),
            (false, true) => Some("a memory fault is told no more".into()),
            _ => None,
        }
    }
}

/// Returns the reason that HORUS must state for a restart; `None` for a cause that HORUS cannot report.
const fn reason(cause: Cause) -> Option<ResetReason> {
    Some(match cause {
        Cause::PowerOn => ResetReason::PowerOn,
        Cause::BrownOut => ResetReason::BrownOutOrOther,
        Cause::Watchdog => ResetReason::Watchdog,
        Cause::Software => ResetReason::Software,
        Cause::Pin => ResetReason::Pin,
        Cause::Lockup | Cause::Wakeup => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disturbance::Memory;
    use crate::testing::{HORUS_FRONT_END, injected};

    fn told(reason: ResetReason, memory_fault: bool) -> ReportedStatus {
        ReportedStatus::new().with_reset_reason(reason).with_memory_fault(memory_fault)
    }

    fn after(cause: Cause) -> Itself {
        let mut itself = Itself::new();
        itself.take(0, &What::Reset { board: Board::Horus, cause, asked: false });
        itself
    }

    #[test]
    fn the_last_reset_is_the_one_of_the_log() {
        const ALL: [ResetReason; 5] = [
            ResetReason::PowerOn,
            ResetReason::Pin,
            ResetReason::Watchdog,
            ResetReason::Software,
            ResetReason::BrownOutOrOther,
        ];
        let right = |itself: &Itself| ALL.map(|reason| itself.clone().wrong(told(reason, false)).is_none());
        assert_eq!(right(&Itself::new()), [true, false, false, false, false]);
        for (cause, right_one) in
            [(Cause::PowerOn, 0), (Cause::Pin, 1), (Cause::Watchdog, 2), (Cause::Software, 3), (Cause::BrownOut, 4)]
        {
            assert_eq!(right(&after(cause)), [0, 1, 2, 3, 4].map(|one| one == right_one), "{cause:?}");
            assert_eq!(after(cause).keeps_ram(), cause != Cause::PowerOn);
        }
        assert_eq!(right(&after(Cause::Lockup)), [true; 5], "the part does not restart for that");
        assert!(after(Cause::Lockup).wrong(ReportedStatus::from_bits(6 << 13)).is_some(), "a reserved code");
        let mut itself = after(Cause::Pin);
        itself.take(0, &What::Reset { board: Board::Dpr, cause: Cause::Software, asked: false });
        assert_eq!(right(&itself), [false, true, false, false, false]);
        itself.take(0, &What::Power { board: Board::Horus, on: true });
        assert_eq!(right(&itself), [true, false, false, false, false]);
    }

    #[test]
    fn a_memory_fault_is_told_until_the_next_start() {
        let good = |itself: &mut Itself, fault| itself.wrong(told(ResetReason::PowerOn, fault)).is_none();
        let mut itself = Itself::new();
        assert!(good(&mut itself, false) && !good(&mut itself, true));
        for other in [
            Disturbance::Supply { board: Board::Horus },
            Disturbance::Hang { board: Board::Horus },
            HORUS_FRONT_END,
            Disturbance::Code { board: Board::Dpr },
            Disturbance::Receiver { receiver: 0 },
        ] {
            let mut itself = Itself::new();
            itself.take(0, &injected(other, 0));
            assert!(!good(&mut itself, true), "{other:?}");
        }
        let board = Board::Horus;
        for kind in [Disturbance::Memory { board, memory: Memory::Ram }, Disturbance::Code { board }] {
            let mut itself = Itself::new();
            itself.take(0, &injected(kind, 0));
            assert!(good(&mut itself, false) && good(&mut itself, true) && good(&mut itself, true), "{kind:?}");
            assert!(!good(&mut itself, false), "it is told no more");
            good(&mut itself, true);
            itself.take(0, &What::Reset { board: Board::Horus, cause: Cause::PowerOn, asked: true });
            assert!(good(&mut itself, false), "{kind:?}");
        }
    }

    #[test]
    fn whether_horus_has_a_crystal_is_how_it_last_started() {
        let crystal = |works| What::Crystal { board: Board::Horus, works };
        let reset = || What::Reset { board: Board::Horus, cause: Cause::Pin, asked: true };
        let started = bounds::START;
        // Returns whether HORUS may report after these events that it has a crystal, and whether it may report that it
        // has none.
        let allowed = |events: Vec<(u64, What)>| {
            let mut itself = Itself::new();
            events.iter().for_each(|(at, what)| itself.take(*at, what));
            [false, true]
                .map(|without| itself.wrong_crystal(ReportedStatus::new().with_without_crystal(without)).is_none())
        };
        let (with, without, either) = ([true, false], [false, true], [true, true]);
        assert_eq!(allowed(vec![]), with);
        assert_eq!(allowed(vec![(started, crystal(false))]), with, "it goes on, or restarts");
        assert_eq!(allowed(vec![(started - 1, crystal(false))]), either);
        assert_eq!(allowed(vec![(started, crystal(false)), (started + 1, reset())]), without);
        let back = |at| vec![(started, crystal(false)), (started + 1, reset()), (at, crystal(true))];
        assert_eq!(allowed(back(2 * started + 1)), without, "until its next start");
        assert_eq!(allowed(back(2 * started)), either);
        assert_eq!(allowed([back(2 * started), vec![(3 * started, reset())]].concat()), with);
        let of_dpr = What::Crystal { board: Board::Dpr, works: false };
        assert_eq!(allowed(vec![(5, of_dpr), (6, reset())]), with);
    }
}
