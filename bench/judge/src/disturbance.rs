//! The disturbances that the bench makes on purpose, and the violations that the judge excuses because of them.
//!
//! A [`Disturbance`] states what the bench disturbs. The log states when the disturbance begins and when its cause goes
//! away ([`crate::What::Injected`]). `Disturbance::takes` is the table of what each disturbance excuses ([`Excuse`]),
//! and for how long. The rules ask [`Disturbances`] which excuses hold at present.
//!
//! An effect that a firmware keeps until its next start (a counter, a flag) is excused until that start. Any other
//! effect is excused for a bounded time after the cause has gone, or until the disturbed board starts.
//!
//! # Where to add a disturbance
//!
//! A new disturbance needs its variant, a line in `Disturbance::takes`, and a test of the rule that it concerns.

use serde::{Deserialize, Serialize};

use crate::{Board, Event, What, bounds};

/// What the bench disturbs on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Disturbance {
    /// The air between the antennas. The log's frame and field events show the effect.
    Air,
    /// A receiver, its line or its bus.
    Receiver {
        /// The receiver's number, from 0.
        receiver: usize,
    },
    /// A pair of pins from which HORUS reads one of its inputs.
    Input {
        /// The number of the input: 0 the relay, 1 the motor cut, 2 the emergency measure.
        input: usize,
    },
    /// The radio field of HORUS's front end, which is not what HORUS commanded.
    Emission,
    /// A board's front end, or a line between the front end and the microcontroller.
    FrontEnd {
        /// The board whose front end is disturbed.
        board: Board,
        /// What is wrong with the front end.
        harm: Harm,
    },
    /// A flight controller that does not read as docs/design.md#ssi requires.
    FlightController {
        /// How the flight controller misbehaves.
        conduct: Conduct,
    },
    /// A wire whose far end receives something else than its near end sends.
    Wire {
        /// The wire that is disturbed.
        wire: Wire,
    },
    /// A base station that states wrongly what it shows.
    BaseStation,
    /// A board's supply, which is off.
    Supply {
        /// The board whose supply is off.
        board: Board,
    },
    /// A restart of a board.
    Restart {
        /// The board that restarts.
        board: Board,
    },
    /// A hang of a board.
    Hang {
        /// The board that hangs.
        board: Board,
    },
    /// A task that checks in for the watchdog, and whose interrupt the bench switches off until the next start.
    DeadTask {
        /// The board whose task is dead.
        board: Board,
        /// The number of the dead task among the tasks that check in.
        task: u8,
    },
    /// A task without work runs once although nothing has called it. This disturbance excuses nothing.
    Spurious {
        /// The board whose task runs.
        board: Board,
    },
    /// The oscillators of a board's microcontroller, which are off by more than before.
    Drift {
        /// The board whose oscillators drift.
        board: Board,
    },
    /// A bit of a board's memory or registers.
    Memory {
        /// The board whose memory is hit.
        board: Board,
        /// Which memory is hit.
        memory: Memory,
    },
    /// The active hold, or the air between it and the DPR's second front end. Nothing of HORUS's link is excused by it.
    Hold {
        /// What of the hold is disturbed.
        part: HoldPart,
    },
    /// Crosstalk between the two pairs of antennas: a frame of HORUS or of the hold also arrives at the other pair.
    Crosstalk,
    /// Instructions or variables of a board's firmware, which the bench changes so that the firmware does something
    /// wrong.
    Code {
        /// The board whose firmware is changed.
        board: Board,
    },
}

/// The part of the active hold that a disturbance concerns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HoldPart {
    /// The hold's supply, reset or core.
    Board,
    /// The air between hold and DPR, and other transmitters in that air.
    Air,
    /// The hold's sensors and their bus.
    Sensors,
}

/// What is wrong with a front end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Harm {
    /// The board's front end does not answer, and the firmware can tell: every bit that is read is the same, or the
    /// interrupt line stays high.
    Silent,
    /// The front end answers its board, but does not report what happens on the air.
    Deaf,
    /// Bits flip on the lines to the front end.
    Noisy,
}

/// How a flight controller misbehaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Conduct {
    /// The flight controller makes no transaction.
    Silent,
    /// The flight controller makes transactions that docs/design.md#ssi forbids, or that do not end.
    Misuse,
}

/// A wire, or a path that is disturbed like a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Wire {
    /// The wire FRESH, from the DPR to the flight controller.
    Fresh,
    /// The wire TICK, which HORUS's timer drives.
    Tick,
    /// The pins of HORUS's inputs. HORUS reads other levels than the log states.
    Inputs,
    /// The SSI's MISO line.
    Miso,
    /// The connection from the listener's front end to its antenna.
    Antenna,
    /// The radio from the flight controller to the base station.
    Radio,
    /// The GNSS signals. All receivers compute a wrong position and cannot tell.
    Sky,
    /// Everything that belongs to the hold: the connections of hold and DPR to the air between them, the log's
    /// statements about both, and the hold's program.
    Hold,
    /// The path within the flight controller from its client's verdict to the position that it flies by.
    Client,
}

/// The memory of a board that a disturbance hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Memory {
    /// The buffers into which the DPR receives frames, or HORUS what its receivers send.
    Receive,
    /// The buffers from which the SSI reads the DPR's images.
    Images,
    /// Any address of the board's RAM.
    Ram,
    /// The board's flash.
    Flash,
    /// A register of the board's core.
    Registers,
    /// A register of a peripheral of the board's microcontroller.
    Peripherals,
}

/// Something that would be a violation, and that the judge does not report while a disturbance excuses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Excuse {
    /// A transmit command may have no frame, a frame may be missing, break off or have another length, and HORUS's
    /// field may drop.
    Sending,
    /// HORUS may send objects, or lengths of frames, that are damaged.
    Damage,
    /// The time between HORUS's ticks may change.
    Rate,
    /// HORUS's firmware may use its front end against the data sheet, because it cannot read from the front end.
    HorusFrontEndUse,
    /// The DPR's firmware may use its front end against the data sheet, because it cannot read from the front end.
    DprFrontEndUse,
    /// HORUS may fail to read the bytes that a receiver on a bus offers: the disturbed receiver, or any if none is
    /// named.
    Polling,
    /// HORUS may fail to take what any of its receivers sends.
    Ears,
    /// HORUS may fail to use what it reads from the disturbed receiver, which is on a bus.
    Taking,
    /// The disturbed receiver, or any if none is named, may have other settings than HORUS needs.
    Settings,
    /// The disturbed receiver may state a wrong position or none, and may be excluded for that.
    Position,
    /// HORUS may report receivers, vote and inputs otherwise than they are.
    Content,
    /// The DPR may fail to receive or process a frame that reaches its antenna. It may show any cycle that it received.
    Hearing,
    /// The DPR may withdraw an image before any transaction has read it.
    Withdrawal,
    /// An image, or the rest of the map after the image, may be unsound. An image with the same content may replace it.
    UnsoundImage,
    /// A frame may become readable late after its last bit.
    Latency,
    /// The DPR may be unable to read a frame's length during the frame, and may then read most of the frame after its
    /// last bit.
    Length,
    /// The flight controller may make no transaction.
    Transactions,
    /// The DPR may fail to serve the flight controller over the SSI, and the bytes may change in both directions.
    Service,
    /// Link-Status may report a RAM fault.
    RamFault,
    /// Link-Status may state wrongly whether there is a field.
    NoField,
    /// Link-Status may report a flash fault.
    FlashFault,
    /// The counters that Link-Status has kept since the DPR's start may be wrong.
    LinkCounters,
    /// A self-test of the DPR may fail.
    SelfTest,
    /// HORUS's fault counters may be above zero.
    HorusComplaints,
    /// The DPR's fault counters may be above zero.
    DprComplaints,
}

/// The end of an excuse, after which the judge reports the excused violation again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// The excuse ends this many ns after the cause has gone, or earlier at the disturbed board's next start.
    After(u64),
    /// The excuse ends at the first start of this board after the cause has gone.
    Start(Board),
}

use End::{After, Start};

impl Disturbance {
    /// Returns each excuse that follows from the disturbance, and when that excuse ends.
    #[rustfmt::skip]
    const fn takes(self) -> &'static [(Excuse, End)] {
        use Board::{Dpr, Horus};
        const RECOVERY: End = After(bounds::FRONT_END_RECOVERY);
        const REPLACED: End = After(bounds::BUFFER_REPLACED);
        // A self-test reports a changed bit only at its end.
        const TESTED: End = After(bounds::SELF_TEST);
        const HORUS_DEAD: End = After(bounds::FIRST_WATCHDOG_LONGEST + bounds::CHECKED_IN[Horus as usize]);
        const DPR_DEAD: End = After(bounds::DPR_WATCHDOG_LONGEST + bounds::CHECKED_IN[Dpr as usize]);
        match self {
            Self::FrontEnd { board: Horus, harm: Harm::Noisy } => &[
                (Excuse::Sending, RECOVERY),
                (Excuse::Damage, After(bounds::CYCLE)),
                (Excuse::HorusFrontEndUse, RECOVERY),
                (Excuse::HorusComplaints, Start(Horus)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::FrontEnd { board: Horus, .. } => &[
                (Excuse::Sending, RECOVERY),
                (Excuse::HorusFrontEndUse, RECOVERY),
                (Excuse::HorusComplaints, Start(Horus)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::FrontEnd { board: Dpr, .. } => &[
                (Excuse::Hearing, RECOVERY),
                (Excuse::Latency, After(1)),
                (Excuse::DprFrontEndUse, RECOVERY),
                (Excuse::NoField, After(bounds::FRONT_END_RECOVERY + bounds::FIELD_TOLD)),
                (Excuse::LinkCounters, Start(Dpr)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            // At HORUS's antenna a frame of the hold may mask a frame of HORUS.
            Self::Crosstalk => &[
                (Excuse::Hearing, RECOVERY),
                (Excuse::LinkCounters, Start(Dpr)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Hold { .. } => &[],
            Self::Supply { board: Horus } => &[
                (Excuse::HorusFrontEndUse, RECOVERY),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Supply { board: Dpr } => &[(Excuse::DprFrontEndUse, RECOVERY)],
            Self::FlightController { conduct: Conduct::Silent } => &[(Excuse::Transactions, After(0))],
            Self::FlightController { conduct: Conduct::Misuse } => &[
                (Excuse::Service, After(bounds::MISUSE_OVER)),
                (Excuse::Transactions, After(0)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            // The DPR counts frames that are cut off, lost or damaged as faults.
            Self::Air | Self::Emission | Self::Restart { board: Horus } => &[(Excuse::DprComplaints, Start(Dpr))],
            Self::Hang { board: Horus } => &[
                (Excuse::HorusComplaints, Start(Horus)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Hang { board: Dpr } => &[(Excuse::DprComplaints, Start(Dpr))],
            Self::DeadTask { board: Horus, .. } => &[
                (Excuse::Sending, HORUS_DEAD),
                (Excuse::HorusFrontEndUse, HORUS_DEAD),
                (Excuse::Polling, HORUS_DEAD),
                (Excuse::Content, HORUS_DEAD),
                (Excuse::HorusComplaints, Start(Horus)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::DeadTask { board: Dpr, .. } => &[
                (Excuse::Hearing, DPR_DEAD),
                (Excuse::Withdrawal, After(0)),
                (Excuse::Latency, DPR_DEAD),
                (Excuse::Service, DPR_DEAD),
                (Excuse::DprFrontEndUse, DPR_DEAD),
                (Excuse::NoField, Start(Dpr)),
                (Excuse::LinkCounters, Start(Dpr)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Receiver { .. } => &[
                (Excuse::Polling, After(bounds::READ_WITHIN)),
                (Excuse::Taking, After(bounds::READ_SETTLED)),
                (Excuse::Settings, After(bounds::SETTINGS_TOLD)),
                (Excuse::Position, After(bounds::POSITION_SETTLED)),
                (Excuse::HorusComplaints, Start(Horus)),
            ],
            Self::Memory { board: Dpr, memory: Memory::Receive } => &[
                (Excuse::Hearing, REPLACED),
                (Excuse::Length, REPLACED),
                (Excuse::UnsoundImage, REPLACED),
                (Excuse::RamFault, Start(Dpr)),
                (Excuse::SelfTest, TESTED),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Memory { board: Dpr, memory: Memory::Images } => &[
                (Excuse::Hearing, REPLACED),
                (Excuse::Withdrawal, After(0)),
                (Excuse::UnsoundImage, REPLACED),
                (Excuse::RamFault, Start(Dpr)),
                (Excuse::SelfTest, TESTED),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Memory { board: Dpr, memory: Memory::Ram } => &[
                (Excuse::RamFault, Start(Dpr)),
                (Excuse::SelfTest, TESTED),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Memory { board: Dpr, memory: Memory::Flash } => &[
                (Excuse::FlashFault, Start(Dpr)),
                (Excuse::SelfTest, Start(Dpr)),
                (Excuse::DprComplaints, Start(Dpr)),
            ],
            Self::Memory { board: Dpr, memory: Memory::Registers | Memory::Peripherals } => {
                &[(Excuse::DprComplaints, Start(Dpr))]
            }
            Self::Memory { board: Horus, memory: Memory::Receive } => &[
                (Excuse::Ears, After(bounds::CYCLE)),
                (Excuse::HorusComplaints, Start(Horus)),
            ],
            Self::Memory { board: Horus, memory: Memory::Peripherals } => &[
                (Excuse::Ears, Start(Horus)),
                (Excuse::HorusComplaints, Start(Horus)),
            ],
            Self::Memory { board: Horus, .. } => &[(Excuse::HorusComplaints, Start(Horus))],
            Self::Drift { board: Horus } => &[(Excuse::Rate, After(bounds::CYCLE))],
            // The faults that a firmware counts because its code was changed are not excused.
            Self::Code { board: Dpr } => &[(Excuse::SelfTest, Start(Dpr))],
            Self::Code { board: Horus }
            | Self::Restart { board: Dpr }
            | Self::Spurious { .. }
            | Self::Drift { board: Dpr }
            | Self::Input { .. }
            | Self::Wire { .. }
            | Self::BaseStation => &[],
        }
    }

    /// Returns whether this excuse follows from the disturbance.
    #[must_use]
    pub fn may_take(self, excuse: Excuse) -> bool {
        self.takes().iter().any(|(own, _)| *own == excuse)
    }

    /// Returns whether a front end may have to be brought up again after the disturbance. The link then has
    /// [`bounds::BRING_UP_CYCLES`] to recover.
    #[must_use]
    pub const fn brings_up(self) -> bool {
        matches!(self, Self::FrontEnd { .. } | Self::Supply { .. } | Self::Restart { .. } | Self::DeadTask { .. })
    }

    /// Returns the board that is disturbed.
    const fn board(self) -> Option<Board> {
        match self {
            Self::FrontEnd { board, .. }
            | Self::Supply { board }
            | Self::Restart { board }
            | Self::Hang { board }
            | Self::DeadTask { board, .. }
            | Self::Spurious { board }
            | Self::Drift { board }
            | Self::Memory { board, .. }
            | Self::Code { board } => Some(board),
            Self::Air
            | Self::Receiver { .. }
            | Self::Input { .. }
            | Self::Emission
            | Self::FlightController { .. }
            | Self::Wire { .. }
            | Self::BaseStation
            | Self::Hold { .. }
            | Self::Crosstalk => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Valid {
    excuse: Excuse,
    /// The receiver that the excuse concerns; `None` for an excuse that concerns no receiver, or all of them.
    receiver: Option<usize>,
    /// The board whose next start ends the excuse; `None` if no start ends it.
    board: Option<Board>,
    until: u64,
    /// The instant, ns, at which the excuse ends at the latest.
    over: u64,
}

const EXCUSES: usize = Excuse::DprComplaints as usize + 1;

/// The violations that the judge excuses at present; see the [module](self).
#[derive(Clone, Debug, Default)]
pub struct Disturbances {
    valid: Vec<Valid>,
    /// For each kind of excuse, the instant, ns, until which the judge excuses it.
    over: [u64; EXCUSES],
    /// The beginning and the end, ns, of the last period in which the DPR's front end did not answer.
    silent: (u64, u64),
}

impl Disturbances {
    pub(crate) fn take(&mut self, event: &Event) {
        let at = event.at;
        match &event.what {
            What::Injected { disturbs, until, .. } => self.begin(at, *disturbs, at.max(*until)),
            What::Power { board, .. } => self.start(*board, at),
            What::Reset { board, .. } => {
                self.start(*board, at);
                // The reset may have interrupted a transfer, which the front end may report as misuse.
                let excuse = front_end_use(*board);
                self.add(
                    at,
                    Valid {
                        excuse,
                        receiver: None,
                        board: None,
                        until: at,
                        over: at.saturating_add(bounds::CUT_SHORT),
                    },
                );
            }
            _ => {}
        }
    }

    fn begin(&mut self, at: u64, disturbs: Disturbance, until: u64) {
        for (excuse, end) in disturbs.takes() {
            let (board, over) = match end {
                After(ns) => (disturbs.board(), until.saturating_add(*ns)),
                Start(board) => (Some(*board), u64::MAX),
            };
            let receiver = match disturbs {
                Disturbance::Receiver { receiver } => Some(receiver),
                _ => None,
            };
            self.add(at, Valid { excuse: *excuse, receiver, board, until, over });
        }
        if let Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Silent } = disturbs {
            self.silent = (at, until);
        }
    }

    fn add(&mut self, now: u64, valid: Valid) {
        self.valid.retain(|valid| now < valid.over);
        self.valid.push(valid);
        let over = &mut self.over[valid.excuse as usize];
        *over = (*over).max(valid.over);
    }

    /// Ends the excuses that end when this board starts or loses its supply.
    fn start(&mut self, board: Board, now: u64) {
        self.valid.retain(|valid| valid.board != Some(board) || now < valid.until);
        self.over = self.over.map(|over| over.min(now));
        for valid in &self.valid {
            let over = &mut self.over[valid.excuse as usize];
            *over = (*over).max(valid.over);
        }
    }

    /// Returns whether this excuse holds at `at`, ns.
    #[must_use]
    pub fn excuse(&self, excuse: Excuse, at: u64) -> bool {
        at < self.until(excuse)
    }

    /// Returns the instant, ns, until which this excuse holds; the instant is past if the excuse does not hold.
    #[must_use]
    pub fn until(&self, excuse: Excuse) -> u64 {
        self.over[excuse as usize]
    }

    /// Returns whether this excuse holds for the receiver with this number (from 0) at the instant `at`, ns.
    #[must_use]
    pub fn excuse_of(&self, receiver: usize, excuse: Excuse, at: u64) -> bool {
        let concerns = |valid: &&Valid| valid.excuse == excuse && valid.receiver.is_none_or(|of| of == receiver);
        self.excuse(excuse, at) && self.valid.iter().filter(concerns).any(|valid| at < valid.over)
    }

    /// Returns the beginning and the end, ns, of the last period in which the DPR's front end did not answer.
    #[must_use]
    pub fn silent_front_end(&self) -> (u64, u64) {
        self.silent
    }
}

/// Returns the excuse that allows a board's fault counters to be above zero.
#[must_use]
pub const fn complaints(board: Board) -> Excuse {
    match board {
        Board::Horus => Excuse::HorusComplaints,
        Board::Dpr => Excuse::DprComplaints,
    }
}

/// Returns the excuse that allows the use of a board's front end against its data sheet.
#[must_use]
pub const fn front_end_use(board: Board) -> Excuse {
    match board {
        Board::Horus => Excuse::HorusFrontEndUse,
        Board::Dpr => Excuse::DprFrontEndUse,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{DPR_FRONT_END, HORUS_FRONT_END, IMAGE_BIT, MISUSE, MS, RECEIVE_BIT, injected};

    const BEGINS: u64 = 1_000 * MS;
    const ENDS: u64 = 1_300 * MS;
    const EXCUSES: [Excuse; 25] = [
        Excuse::Taking,
        Excuse::Settings,
        Excuse::Position,
        Excuse::NoField,
        Excuse::Polling,
        Excuse::Content,
        Excuse::Sending,
        Excuse::HorusFrontEndUse,
        Excuse::DprFrontEndUse,
        Excuse::Hearing,
        Excuse::Withdrawal,
        Excuse::UnsoundImage,
        Excuse::Latency,
        Excuse::Length,
        Excuse::Damage,
        Excuse::Rate,
        Excuse::Ears,
        Excuse::Transactions,
        Excuse::Service,
        Excuse::RamFault,
        Excuse::FlashFault,
        Excuse::LinkCounters,
        Excuse::SelfTest,
        Excuse::HorusComplaints,
        Excuse::DprComplaints,
    ];

    fn of(memory: Memory) -> Disturbance {
        Disturbance::Memory { board: Board::Dpr, memory }
    }

    fn after(events: &[(u64, What)]) -> Disturbances {
        let mut disturbances = Disturbances::default();
        events.iter().for_each(|(at, what)| disturbances.take(&Event { at: *at, what: what.clone() }));
        disturbances
    }

    fn reset(board: Board) -> What {
        What::Reset { board, cause: crate::Cause::Pin, asked: true }
    }

    /// Returns each excuse that holds, and how long after the end of the cause it holds, ns; `None` means until a
    /// start.
    fn excused(disturbances: &Disturbances) -> Vec<(Excuse, Option<u64>)> {
        let until = |excuse| disturbances.until(excuse);
        let valid = EXCUSES.into_iter().filter(|excuse| until(*excuse) > 0);
        valid.map(|excuse| (excuse, (until(excuse) < u64::MAX).then(|| until(excuse) - ENDS))).collect()
    }

    #[test]
    fn each_disturbance_excuses_what_is_said_of_it_and_for_so_long() {
        use Excuse::*;
        let (recovery, replaced) = (Some(bounds::FRONT_END_RECOVERY), Some(bounds::BUFFER_REPLACED));
        let horus = Board::Horus;
        let tested = Some(bounds::SELF_TEST);
        let horus_dead = Some(bounds::FIRST_WATCHDOG_LONGEST + bounds::CHECKED_IN[Board::Horus as usize]);
        let dpr_dead = Some(bounds::DPR_WATCHDOG_LONGEST + bounds::CHECKED_IN[Board::Dpr as usize]);
        for (disturbs, expected) in [
            (
                HORUS_FRONT_END,
                vec![(Sending, recovery), (HorusFrontEndUse, recovery), (HorusComplaints, None), (DprComplaints, None)],
            ),
            (
                DPR_FRONT_END,
                vec![
                    (NoField, Some(bounds::FRONT_END_RECOVERY + bounds::FIELD_TOLD)),
                    (DprFrontEndUse, recovery),
                    (Hearing, recovery),
                    (Latency, Some(1)),
                    (LinkCounters, None),
                    (DprComplaints, None),
                ],
            ),
            (Disturbance::Supply { board: horus }, vec![(HorusFrontEndUse, recovery), (DprComplaints, None)]),
            (Disturbance::Supply { board: Board::Dpr }, vec![(DprFrontEndUse, recovery)]),
            (MISUSE, vec![(Transactions, Some(0)), (Service, Some(bounds::MISUSE_OVER)), (DprComplaints, None)]),
            (Disturbance::FlightController { conduct: Conduct::Silent }, vec![(Transactions, Some(0))]),
            (
                RECEIVE_BIT,
                vec![
                    (Hearing, replaced),
                    (UnsoundImage, replaced),
                    (Length, replaced),
                    (RamFault, None),
                    (SelfTest, tested),
                    (DprComplaints, None),
                ],
            ),
            (
                IMAGE_BIT,
                vec![
                    (Hearing, replaced),
                    (Withdrawal, Some(0)),
                    (UnsoundImage, replaced),
                    (RamFault, None),
                    (SelfTest, tested),
                    (DprComplaints, None),
                ],
            ),
            (of(Memory::Ram), vec![(RamFault, None), (SelfTest, tested), (DprComplaints, None)]),
            (of(Memory::Flash), vec![(FlashFault, None), (SelfTest, None), (DprComplaints, None)]),
            (of(Memory::Registers), vec![(DprComplaints, None)]),
            (Disturbance::Memory { board: horus, memory: Memory::Ram }, vec![(HorusComplaints, None)]),
            (
                Disturbance::Memory { board: horus, memory: Memory::Receive },
                vec![(Ears, Some(bounds::CYCLE)), (HorusComplaints, None)],
            ),
            (
                Disturbance::Memory { board: horus, memory: Memory::Peripherals },
                vec![(Ears, None), (HorusComplaints, None)],
            ),
            (Disturbance::Drift { board: horus }, vec![(Rate, Some(bounds::CYCLE))]),
            (Disturbance::Drift { board: Board::Dpr }, vec![]),
            (
                Disturbance::FrontEnd { board: horus, harm: Harm::Noisy },
                vec![
                    (Sending, recovery),
                    (HorusFrontEndUse, recovery),
                    (Damage, Some(bounds::CYCLE)),
                    (HorusComplaints, None),
                    (DprComplaints, None),
                ],
            ),
            (Disturbance::Air, vec![(DprComplaints, None)]),
            (Disturbance::Emission, vec![(DprComplaints, None)]),
            (
                Disturbance::Receiver { receiver: 0 },
                vec![
                    (Taking, Some(bounds::READ_SETTLED)),
                    (Settings, Some(bounds::SETTINGS_TOLD)),
                    (Position, Some(bounds::POSITION_SETTLED)),
                    (Polling, Some(bounds::READ_WITHIN)),
                    (HorusComplaints, None),
                ],
            ),
            (Disturbance::Restart { board: horus }, vec![(DprComplaints, None)]),
            (Disturbance::Hang { board: horus }, vec![(HorusComplaints, None), (DprComplaints, None)]),
            (Disturbance::Hang { board: Board::Dpr }, vec![(DprComplaints, None)]),
            (
                Disturbance::DeadTask { board: horus, task: 0 },
                vec![
                    (Polling, horus_dead),
                    (Content, horus_dead),
                    (Sending, horus_dead),
                    (HorusFrontEndUse, horus_dead),
                    (HorusComplaints, None),
                    (DprComplaints, None),
                ],
            ),
            (
                Disturbance::DeadTask { board: Board::Dpr, task: 1 },
                vec![
                    (NoField, None),
                    (DprFrontEndUse, dpr_dead),
                    (Hearing, dpr_dead),
                    (Withdrawal, Some(0)),
                    (Latency, dpr_dead),
                    (Service, dpr_dead),
                    (LinkCounters, None),
                    (DprComplaints, None),
                ],
            ),
            (Disturbance::Code { board: Board::Dpr }, vec![(SelfTest, None)]),
            (Disturbance::Code { board: horus }, vec![]),
            (Disturbance::Restart { board: Board::Dpr }, vec![]),
            (Disturbance::Spurious { board: Board::Dpr }, vec![]),
            (Disturbance::Input { input: 1 }, vec![]),
            (Disturbance::Wire { wire: Wire::Miso }, vec![]),
            (Disturbance::BaseStation, vec![]),
        ] {
            let disturbances = after(&[(BEGINS, injected(disturbs, ENDS))]);
            assert_eq!(excused(&disturbances), expected, "{disturbs:?}");
            for excuse in EXCUSES {
                let taken = expected.iter().any(|(own, _)| *own == excuse);
                assert_eq!(disturbs.may_take(excuse), taken, "{disturbs:?} {excuse:?}");
                let until = disturbances.until(excuse);
                assert!(until == 0 || disturbances.excuse(excuse, until - 1) && !disturbances.excuse(excuse, until));
            }
        }
    }

    #[test]
    fn a_start_of_the_disturbed_board_ends_what_is_excused() {
        let excused = |at: u64, board| {
            let disturbances = after(&[(BEGINS, injected(DPR_FRONT_END, ENDS)), (at, reset(board))]);
            [Excuse::Hearing, Excuse::LinkCounters].map(|excuse| disturbances.excuse(excuse, at + 1))
        };
        assert_eq!(excused(ENDS, Board::Dpr), [false; 2]);
        assert_eq!(excused(ENDS - 1, Board::Dpr), [true; 2], "its cause is still there");
        assert_eq!(excused(ENDS, Board::Horus), [true; 2]);
        let of_horus = |board| {
            let events = [(BEGINS, injected(HORUS_FRONT_END, ENDS)), (ENDS, reset(board))];
            [Excuse::Sending, Excuse::DprComplaints].map(|excuse| after(&events).excuse(excuse, ENDS + 1))
        };
        assert_eq!(of_horus(Board::Horus), [false, true]);
        assert_eq!(of_horus(Board::Dpr), [true, false]);
        let off = What::Power { board: Board::Dpr, on: false };
        let disturbances = after(&[(BEGINS, injected(RECEIVE_BIT, BEGINS)), (ENDS, off)]);
        assert!(!disturbances.excuse(Excuse::RamFault, ENDS));
        // Misuse of the SSI disturbs no board. Therefore no start of a board ends its excuses.
        let disturbances = after(&[(BEGINS, injected(MISUSE, ENDS)), (ENDS, reset(Board::Dpr))]);
        assert!(disturbances.excuse(Excuse::Service, ENDS));
    }

    #[test]
    fn each_of_two_disturbances_that_overlap_excuses_as_it_would_alone() {
        let longer = [(BEGINS, injected(RECEIVE_BIT, ENDS)), (BEGINS + 1, injected(IMAGE_BIT, BEGINS + 2))];
        assert_eq!(after(&longer).until(Excuse::UnsoundImage), ENDS + bounds::BUFFER_REPLACED);
        let both = [
            (BEGINS, injected(DPR_FRONT_END, BEGINS + 1)),
            (BEGINS, injected(IMAGE_BIT, ENDS)),
            (BEGINS + 1, reset(Board::Dpr)),
        ];
        assert_eq!(after(&both).until(Excuse::Hearing), ENDS + bounds::BUFFER_REPLACED);
        assert_eq!(after(&both).until(Excuse::LinkCounters), BEGINS + 1, "the start");
    }

    #[test]
    fn a_start_forgets_nothing_of_what_was_excused_before_it() {
        let silent = Disturbance::FlightController { conduct: Conduct::Silent };
        // An excuse that has ended stays stored until the next disturbance begins.
        let over = [(BEGINS, injected(silent, ENDS)), (ENDS, injected(Disturbance::Air, ENDS))];
        for board in [Board::Horus, Board::Dpr] {
            let start = [over[0].clone(), over[1].clone(), (ENDS + 1, reset(board))];
            assert_eq!(after(&start).until(Excuse::Transactions), ENDS, "{board:?}");
        }
    }

    #[test]
    fn a_reset_may_cut_off_an_access_to_its_front_end() {
        let disturbances = after(&[(BEGINS, reset(Board::Dpr))]);
        assert_eq!(disturbances.until(Excuse::DprFrontEndUse), BEGINS + bounds::CUT_SHORT);
        assert_eq!(disturbances.until(Excuse::HorusFrontEndUse), 0);
    }

    #[test]
    fn what_never_goes_away_is_excused_for_ever() {
        let disturbances = after(&[(BEGINS, injected(MISUSE, u64::MAX)), (ENDS, reset(Board::Dpr))]);
        assert_eq!(disturbances.until(Excuse::Service), u64::MAX);
    }

    #[test]
    fn only_a_silent_front_end_has_to_be_told() {
        let deaf = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Deaf };
        for (disturbs, told) in [(DPR_FRONT_END, true), (deaf, false), (HORUS_FRONT_END, false)] {
            let silent = after(&[(BEGINS, injected(disturbs, ENDS))]).silent_front_end();
            assert_eq!(silent, if told { (BEGINS, ENDS) } else { (0, 0) }, "{disturbs:?}");
        }
    }

    #[test]
    fn a_receivers_disturbance_excuses_only_what_that_receiver_reports() {
        let events = [Disturbance::Receiver { receiver: 0 }, HORUS_FRONT_END].map(|it| (BEGINS, injected(it, ENDS)));
        let disturbances = after(&events);
        let excused = |receiver| disturbances.excuse_of(receiver, Excuse::Position, BEGINS + 1);
        assert_eq!((excused(0), excused(1)), (true, false));
        assert!(!disturbances.excuse_of(0, Excuse::Hearing, BEGINS + 1));
    }
}
