//! When the active hold, its air and the DPR are free of disturbances, so that each must do its whole work.

use crate::disturbance::{Conduct, HoldPart, Memory};
use crate::{Board, Disturbance, Event, What, bounds};

const MS: u64 = 1_000_000;

/// The time after a disturbance of the hold's board after which the hold sends in each period, ns: a watchdog's 104 ms,
/// a start, and four exchanges.
const HOLD_SENDS: u64 = 800 * MS;
/// The time after a disturbance of the hold's board or sensors after which its values are right, ns: as above, a second
/// until the sensors were read again, and a second of samples.
const HOLD_MEASURES: u64 = 2_500 * MS;
/// The time after a disturbance of the air after which each frame and each answer arrives, ns: frames are delayed by up
/// to 120 ms, and a port that rests goes on in the next 100 ms.
const AIR_SETTLED: u64 = 300 * MS;
/// The time after a start of the DPR after which its second front end receives, ns.
const STARTED: u64 = bounds::START + bounds::ARMED;
/// The time after a hang of the DPR, or the death of one of its tasks, until its start, ns. The start has its own event.
const WATCHDOG: u64 = bounds::DPR_WATCHDOG_LONGEST + bounds::CHECKED_IN[Board::Dpr as usize];

/// The instants, ns, before which the hold, its air or the DPR may be disturbed. What disturbs HORUS, its air, or the
/// DPR's front end and receive buffers for HORUS does not count: the hold has a front end and buffers of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Calm {
    board: u64,
    air: u64,
    sensors: u64,
    dpr: u64,
}

impl Calm {
    /// Processes the next event of the log.
    pub fn take(&mut self, event: &Event) {
        match &event.what {
            What::Injected { disturbs, until, .. } => self.disturbed(*disturbs, event.at.max(*until)),
            What::Reset { board: Board::Dpr, .. } | What::Power { board: Board::Dpr, .. } => {
                self.dpr = self.dpr.max(event.at.saturating_add(STARTED));
            }
            _ => {}
        }
    }

    fn disturbed(&mut self, disturbs: Disturbance, until: u64) {
        use Disturbance as D;
        if disturbs == (D::Hold { part: HoldPart::Board }) {
            self.sensors = self.sensors.max(until.saturating_add(HOLD_MEASURES));
        }
        let (end, settled) = match disturbs {
            D::Hold { part: HoldPart::Board } => (&mut self.board, HOLD_SENDS),
            D::Hold { part: HoldPart::Sensors } => (&mut self.sensors, HOLD_MEASURES),
            D::Hold { part: HoldPart::Air } | D::Crosstalk => (&mut self.air, AIR_SETTLED),
            D::Supply { board: Board::Dpr } | D::Restart { board: Board::Dpr } => (&mut self.dpr, STARTED),
            D::Hang { board: Board::Dpr } | D::DeadTask { board: Board::Dpr, .. } => (&mut self.dpr, WATCHDOG),
            D::Memory { board: Board::Dpr, memory: Memory::Receive } => return,
            D::Memory { board: Board::Dpr, memory: Memory::Images } => (&mut self.dpr, bounds::BUFFER_REPLACED),
            D::Memory { board: Board::Dpr, .. } | D::Code { board: Board::Dpr } => (&mut self.dpr, WATCHDOG + STARTED),
            D::FlightController { conduct: Conduct::Misuse } => (&mut self.dpr, bounds::MISUSE_OVER),
            D::FlightController { conduct: Conduct::Silent }
            | D::Air
            | D::Receiver { .. }
            | D::Input { .. }
            | D::Emission
            | D::FrontEnd { .. }
            | D::Wire { .. }
            | D::BaseStation
            | D::Supply { .. }
            | D::Restart { .. }
            | D::Hang { .. }
            | D::DeadTask { .. }
            | D::Spurious { .. }
            | D::Drift { .. }
            | D::Memory { .. }
            | D::Code { .. } => return,
        };
        *end = (*end).max(until.saturating_add(settled));
    }

    /// The instant, ns, from which the hold must send in each period and must not restart.
    #[must_use]
    pub fn sends(&self) -> u64 {
        self.board.max(self.air)
    }

    /// The instant, ns, from which the DPR must show and answer each frame of the hold.
    #[must_use]
    pub fn exchanges(&self) -> u64 {
        self.sends().max(self.dpr)
    }

    /// The instant, ns, from which Hold-Status must agree with the payload.
    #[must_use]
    pub fn measures(&self) -> u64 {
        self.sends().max(self.sensors)
    }
}
