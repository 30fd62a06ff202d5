//! What HORUS says of itself in Reported-Position: why it last started, and whether its memory has a fault.
//!
//! | bits | right |
//! |---|---|
//! | 13-15 | the reset that the log has, power-on before any; any where its words name none |
//! | 12 | 0 until something was done to HORUS's memory or image; from its first 1 on it stays 1 until the next start |
//!
//! Whether a fault of memory is found at all, and when, is no matter of this rule: HORUS looks at its memory in passes,
//! and the log does not say where a bit was hit.

use profile::{ReportedStatus, ResetReason};

use crate::{Board, Disturbance, What};

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Itself {
    /// Why HORUS last started, if the log's words say that.
    reason: Option<ResetReason>,
    /// Its memory was hit on purpose.
    hit: bool,
    /// It has said since its start that its memory has a fault.
    said: bool,
}

impl Itself {
    /// Its supply has come on.
    pub(super) const fn new() -> Self {
        Self { reason: Some(ResetReason::PowerOn), hit: false, said: false }
    }

    /// Takes the next event.
    pub(super) fn take(&mut self, what: &What) {
        match what {
            What::Power { board: Board::Horus, .. } => *self = Self { reason: Some(ResetReason::PowerOn), ..*self },
            What::Reset { board: Board::Horus, cause, .. } => self.reason = reason(cause),
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
    }

    /// Whether what RAM held before the last start is still there.
    pub(super) fn keeps_ram(&self) -> bool {
        self.reason != Some(ResetReason::PowerOn)
    }

    /// What of a Reported-Position's status is wrong, in words.
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

/// The reason for which a part has restarted, from the words of the log.
fn reason(cause: &str) -> Option<ResetReason> {
    let cause = cause.to_lowercase();
    let named = [
        ("poweron", ResetReason::PowerOn),
        ("brown", ResetReason::BrownOutOrOther),
        ("watchdog", ResetReason::Watchdog),
        ("software", ResetReason::Software),
        ("pin", ResetReason::Pin),
    ];
    named.into_iter().find(|(word, _)| cause.contains(word)).map(|(_, reason)| reason)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disturbance::Memory;
    use crate::testing::{HORUS_FRONT_END, injected};

    fn told(reason: ResetReason, memory_fault: bool) -> ReportedStatus {
        ReportedStatus::new().with_reset_reason(reason).with_memory_fault(memory_fault)
    }

    fn after(cause: &str) -> Itself {
        let mut itself = Itself::new();
        itself.take(&What::Reset { board: Board::Horus, cause: cause.into(), asked: false });
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
            [("PowerOn", 0), ("Pin", 1), ("Watchdog(\"IWDG\")", 2), ("Software", 3), ("BrownOut", 4)]
        {
            assert_eq!(right(&after(cause)), [0, 1, 2, 3, 4].map(|one| one == right_one), "{cause}");
            assert_eq!(after(cause).keeps_ram(), cause != "PowerOn");
        }
        assert_eq!(right(&after("a test")), [true; 5], "its words name none");
        assert!(after("a test").wrong(ReportedStatus::from_bits(6 << 13)).is_some(), "a reserved code");
        let mut itself = after("Pin");
        itself.take(&What::Reset { board: Board::Dpr, cause: "Software".into(), asked: false });
        assert_eq!(right(&itself), [false, true, false, false, false]);
        itself.take(&What::Power { board: Board::Horus, on: true });
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
            itself.take(&injected(other, 0));
            assert!(!good(&mut itself, true), "{other:?}");
        }
        let board = Board::Horus;
        for kind in [Disturbance::Memory { board, memory: Memory::Ram }, Disturbance::Code { board }] {
            let mut itself = Itself::new();
            itself.take(&injected(kind, 0));
            assert!(good(&mut itself, false) && good(&mut itself, true) && good(&mut itself, true), "{kind:?}");
            assert!(!good(&mut itself, false), "it is told no more");
            good(&mut itself, true);
            itself.take(&What::Reset { board: Board::Horus, cause: "PowerOn".into(), asked: true });
            assert!(good(&mut itself, false), "{kind:?}");
        }
    }
}
