//! Determines from when on the judge must require all functions of an active hold: from then on no disturbance affects
//! the hold, its air or the DPR any more.

use crate::disturbance::HoldPart;
use crate::{Board, Disturbance, Event, What};

const MS: u64 = 1_000_000;

/// The time in which a hold has recovered from a disturbance of its board or sensors, ns: 100 ms of the watchdog, a
/// start, four exchanges, and a second for a new measurement.
const HOLD_SETTLED: u64 = 2_500 * MS;
/// The time in which the exchange has recovered from a disturbance of the air or of the DPR, ns: a reset of the DPR by
/// its watchdog, its start, and an exchange.
const SETTLED: u64 = 300 * MS;

/// The instants, ns, until which disturbances may affect the hold, its air or the DPR. Disturbances of HORUS do not
/// count, because nothing of HORUS reaches the hold.
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
                self.dpr = self.dpr.max(event.at.saturating_add(SETTLED));
            }
            _ => {}
        }
    }

    fn disturbed(&mut self, disturbs: Disturbance, until: u64) {
        use Disturbance as D;
        let (end, settled) = match disturbs {
            D::Hold { part: HoldPart::Board } => (&mut self.board, HOLD_SETTLED),
            D::Hold { part: HoldPart::Sensors } => (&mut self.sensors, HOLD_SETTLED),
            D::Hold { part: HoldPart::Air } | D::Crosstalk => (&mut self.air, SETTLED),
            D::FrontEnd { board: Board::Dpr, .. }
            | D::Supply { board: Board::Dpr }
            | D::Restart { board: Board::Dpr }
            | D::Hang { board: Board::Dpr }
            | D::DeadTask { board: Board::Dpr, .. }
            | D::Memory { board: Board::Dpr, .. }
            | D::Code { board: Board::Dpr }
            | D::FlightController { .. } => (&mut self.dpr, SETTLED),
            D::Air
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

    /// The instant, ns, from which the values in Hold-Status must agree with the payload.
    #[must_use]
    pub fn measures(&self) -> u64 {
        self.sends().max(self.sensors)
    }
}
