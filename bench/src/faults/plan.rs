//! Faults drawn from a seed.
//!
//! Each kind of fault has random numbers of its own, so that a new kind leaves the episodes of the others unchanged.
//! The faults of a kind are drawn in rounds: a round has each fault once, in a random order.

use std::fmt;
use std::str::FromStr;

use super::{
    Absurd, AirFaults, Board, BufferFault, Buffers, BusFault, ChipFault, Conduct, Episode, Fault, Faults, HoldFault,
    InputFault, PowerFault, ReceiverFault, Rng, chip::FLIP_MENDED, is_step, power::sag_length, state_inputs::INPUTS,
    tasks_of,
};
use gnss_sim::Port;

/// No episode begins before this instant, ns, so that both boards start undisturbed.
pub const FIRST_AT: u64 = 300_000_000;

/// The time, ns, between the end of the last episode and the end of the run. In this time the recovery is observed.
pub const LAST_BEFORE_END: u64 = 600_000_000;

/// The shortest and longest time from one episode's end to the beginning of the next of the same kind, ns.
pub const GAP: (u64, u64) = (100_000_000, 900_000_000);

const BOARDS: [Board; 2] = [Board::Horus, Board::Dpr];

const MS: u64 = 1_000_000;

/// The shortest and longest duration of an episode, ns.
pub const LENGTH: (u64, u64) = (20_000_000, 400_000_000);

/// The duration, ns, of a fault of the hold. The hold exchanges frames once every 100 ms.
pub const HOLD_LENGTH: (u64, u64) = (200_000_000, 2_000_000_000);

/// The shortest and the longest time, ns, of every fourth gap between two faults of the hold. In this gap the hold
/// recovers, and the judge requires all of its functions.
pub const HOLD_GAP: (u64, u64) = (3_500_000_000, 5_500_000_000);

/// The time, ns, from one episode of a hostile sender to the next. This time is longer than a frame, so that frames of
/// two episodes do not overlap.
pub const HOSTILE_GAP: (u64, u64) = (30_000_000, 60_000_000);

/// The duration of a receiver's drift, ns: at its end the receiver's position is wrong by a few tens of metres.
pub const DRIFT_LENGTH: (u64, u64) = (1_000_000_000, 3_000_000_000);

/// The shortest and the longest duration of a receiver's wrong position, ns. The voter holds a jump of all receivers
/// back for a time within this range.
pub const JUMP_LENGTH: (u64, u64) = (20_000_000, 2_500_000_000);

/// The longest time, ns, between the failures of two boards that both lose their supply, restart or hang in one
/// episode.
pub const BETWEEN_BOARDS: u64 = 20_000_000;

/// The time reserved for a hang and the board's restart, ns. HORUS has the slowest watchdog, with 190 ms.
pub const HANG_LENGTH: (u64, u64) = (300_000_000, 400_000_000);

/// The time reserved for a dead task and the board's restart, ns. The watchdog may be fed once more after the task's
/// death.
pub const DEAD_TASK_LENGTH: (u64, u64) = (320_000_000, 420_000_000);

/// The time reserved for a hang during a board's start, ns. HORUS's watchdog takes up to 964 ms until its first feed.
pub const START_HANG_LENGTH: (u64, u64) = (1_100_000_000, 1_200_000_000);

/// No hang is drawn within this time after a board's start, ns, because the watchdog may not run yet
/// (docs/design.md#start-and-supply).
pub const WATCHDOG_STARTS: u64 = 2_000;

/// The longest time, ns, from a board's reset until a hang that is drawn into its start.
pub const STARTS: u64 = 20_000_000;

/// The bit error rate of drawn bit errors on the air: about one frame in five has an error.
pub const BIT_ERROR: f64 = 1e-4;

/// The largest error that a drift adds to the error of an oscillator, parts per billion.
pub const MAX_DRIFT: u64 = 200_000;

/// The number of different sags of each board's supply in a round.
const SAGS: usize = 3;

/// A kind of fault that `--faults` can draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// The air, and the front ends on either side of it.
    Air,
    /// The GNSS receivers and their lines.
    Gnss,
    /// The flight controller.
    FlightController,
    /// Supply and reset of either board.
    Power,
    /// Bits of RAM.
    Ram,
    /// Bits of flash.
    Flash,
    /// Bits of core registers.
    Registers,
    /// Bits that flip or are stuck during the run, in the DPR's receive and image buffers.
    Buffers,
    /// The state inputs of HORUS.
    Inputs,
    /// Boards that hang, dead tasks, and tasks that run although nothing has called them.
    Hang,
    /// Bits that flip during the run, in the registers of either front end's chip.
    Chips,
    /// The active hold, its sensors, and the air between hold and DPR.
    Hold,
    /// Bit errors on the air, at the rate [`BIT_ERROR`].
    Bits,
    /// Glitches on the SPI between either board and its front end.
    Spi,
    /// Oscillators that drift.
    Drift,
    /// Bits of the registers of a microcontroller's peripherals.
    Peripherals,
    /// Something hostile in the place of the active hold, nearly all the time.
    Hostile,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 17] = [
        Self::Air,
        Self::Gnss,
        Self::FlightController,
        Self::Power,
        Self::Ram,
        Self::Flash,
        Self::Registers,
        Self::Buffers,
        Self::Inputs,
        Self::Hang,
        Self::Chips,
        Self::Hold,
        Self::Bits,
        Self::Spi,
        Self::Drift,
        Self::Peripherals,
        Self::Hostile,
    ];

    /// Returns the kind's name in `--faults`.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Air => "air",
            Self::Gnss => "gnss",
            Self::FlightController => "fc",
            Self::Power => "power",
            Self::Ram => "ram",
            Self::Flash => "flash",
            Self::Registers => "registers",
            Self::Buffers => "buffers",
            Self::Inputs => "inputs",
            Self::Hang => "hang",
            Self::Chips => "chips",
            Self::Hold => "hold",
            Self::Bits => "bits",
            Self::Spi => "spi",
            Self::Drift => "drift",
            Self::Peripherals => "peripherals",
            Self::Hostile => "hostile",
        }
    }

    /// Whether the kind is an upset, which a campaign tries on a copy of the bench instead of in a run.
    #[must_use]
    pub const fn is_upset(self) -> bool {
        matches!(self, Self::Ram | Self::Flash | Self::Registers | Self::Peripherals)
    }

    /// Whether the kind acts on an active hold, so that it does nothing on a bench without one.
    #[must_use]
    pub const fn needs_hold(self) -> bool {
        matches!(self, Self::Hold | Self::Hostile)
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// The error for a word that is the name of no kind of fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no kind of fault: give one or several of {words}", words = Kind::ALL.map(Kind::word).join(", "))]
pub struct UnknownKind(pub String);

impl FromStr for Kind {
    type Err = UnknownKind;

    fn from_str(word: &str) -> Result<Self, UnknownKind> {
        let found = Self::ALL.into_iter().find(|kind| kind.word() == word.trim());
        found.ok_or_else(|| UnknownKind(word.to_owned()))
    }
}

/// Faults that occur together, each with its delay (ns) after the first.
type Draw = Vec<(u64, Fault)>;

impl Faults {
    /// Returns faults of `kinds` for a run of `duration_ns` with `gps` receivers, drawn from `seed`, without upsets.
    ///
    /// A kind has at most one episode at a time, unless faults occur together.
    #[must_use]
    pub fn drawn(kinds: &[Kind], gps: usize, seed: u64, duration_ns: u64) -> Self {
        let mut faults = Self::none();
        let last = duration_ns.saturating_sub(LAST_BEFORE_END);
        for kind in Kind::ALL.into_iter().filter(|kind| kinds.contains(kind)) {
            let mut rng = Rng::stream(seed, kind as u64);
            let mut round: Vec<Draw> = vec![];
            let mut free_at = FIRST_AT;
            let mut gap = (0, GAP.1);
            loop {
                if round.is_empty() {
                    round = all_of(kind, gps, &mut rng);
                    rng.shuffle(&mut round);
                }
                let Some(draw) = round.pop() else { break };
                let begins = free_at + rng.between(gap.0, gap.1);
                gap = match kind {
                    Kind::Hold if round.len().is_multiple_of(4) => HOLD_GAP,
                    Kind::Hostile => HOSTILE_GAP,
                    _ => GAP,
                };
                let (least, most) = length(&draw);
                let length = rng.between(least, most);
                let after = draw.iter().map(|(after, _)| *after).max().unwrap_or(0);
                free_at = begins + after + length;
                if free_at > last {
                    break;
                }
                for (after, fault) in draw {
                    let at = begins + after;
                    let until = if lasts(&fault) { at + length } else { at };
                    faults.episodes.push(Episode { at, until, fault });
                }
            }
        }
        // The list is sorted once, at the end, because a run of a day has tens of thousands of episodes of each kind.
        faults.episodes.sort_by_key(|episode| episode.at);
        faults.without_hangs_in_starts();
        faults
    }
}

impl Faults {
    /// Returns one drawn fault of `kind`, or several that occur together, for a link with `gps` receivers. The first
    /// begins at `at` (ns). Returns no fault for a kind that is not drawn into runs.
    #[must_use]
    pub fn one(kind: Kind, gps: usize, rng: &mut Rng, at: u64) -> Self {
        let mut draws = all_of(kind, gps, rng);
        let mut faults = Self::none();
        if draws.is_empty() {
            return faults;
        }
        let draw = draws.swap_remove(rng.below(draws.len() as u64) as usize);
        let (least, most) = length(&draw);
        let length = rng.between(least, most);
        for (after, fault) in draw {
            let begins = at + after;
            faults.add(Episode { at: begins, until: if lasts(&fault) { begins + length } else { begins }, fault });
        }
        faults
    }

    /// Returns every fault of `kind` for a link with `gps` receivers, one after the other, the first at `at` (ns). Each
    /// lasts for `length` ns, with a pause of `pause` ns behind it. Also returns the end of the last pause, ns. `rng`
    /// draws what a fault leaves open. What occurs once, such as a restart, takes no more than the pause.
    #[must_use]
    pub fn in_turn(kind: Kind, gps: usize, rng: &mut Rng, at: u64, [length, pause]: [u64; 2]) -> (Self, u64) {
        let (mut faults, mut at) = (Self::none(), at);
        for draw in all_of(kind, gps, rng) {
            let mut end = at;
            for (after, fault) in draw {
                let begins = at + after;
                let until = if lasts(&fault) { begins + length } else { begins };
                end = end.max(until);
                faults.add(Episode { at: begins, until, fault });
            }
            at = end + pause;
        }
        (faults, at)
    }

    /// Removes each hang that begins before the watchdog of a restarted board runs, because nothing would end the hang.
    fn without_hangs_in_starts(&mut self) {
        for board in BOARDS {
            let of_power = |it: &&Episode| starts(&it.fault, board);
            let mut starts: Vec<u64> = self.episodes.iter().filter(of_power).map(|it| it.until).collect();
            starts.sort_unstable();
            let is_unwatched = |at: u64| {
                let before = starts.partition_point(|start| *start <= at);
                before.checked_sub(1).is_some_and(|last| at < starts[last] + WATCHDOG_STARTS)
            };
            self.episodes.retain(|it| it.fault != Fault::Hang(board) || !is_unwatched(it.at));
        }
    }
}

fn starts(fault: &Fault, board: Board) -> bool {
    match fault {
        Fault::Power(_, PowerFault::FrontEndOff | PowerFault::CrystalDead) => false,
        Fault::Power(of, _) => *of == board,
        _ => false,
    }
}

fn lasts(fault: &Fault) -> bool {
    match fault {
        Fault::Power(_, fault) => fault.lasts(),
        Fault::Buffer(fault) => fault.lasts(),
        Fault::Hang(_) | Fault::DeadTask(..) | Fault::Spurious(..) | Fault::Hold(HoldFault::Hang) => false,
        Fault::Hold(HoldFault::Power(fault)) => fault.lasts(),
        _ => true,
    }
}

/// Returns the shortest and the longest duration of these faults, ns.
fn length(draw: &Draw) -> (u64, u64) {
    match draw[..] {
        [(_, Fault::Power(..)), (_, Fault::Hang(_))] => START_HANG_LENGTH,
        [(_, ref fault), ..] => length_of(fault),
        [] => LENGTH,
    }
}

fn length_of(fault: &Fault) -> (u64, u64) {
    match fault {
        Fault::Receiver(_, ReceiverFault::Drifts { .. }) => DRIFT_LENGTH,
        Fault::Receiver(_, ReceiverFault::Jumps { .. }) => JUMP_LENGTH,
        Fault::Hang(_) | Fault::Hold(HoldFault::Hang) => HANG_LENGTH,
        Fault::Hold(_) => HOLD_LENGTH,
        Fault::DeadTask(..) | Fault::Spurious(..) => DEAD_TASK_LENGTH,
        Fault::Flip(..) => (FLIP_MENDED, FLIP_MENDED),
        Fault::Power(_, PowerFault::Sag(seed)) => (sag_length(*seed), sag_length(*seed)),
        _ => LENGTH,
    }
}

/// Returns each fault of `kind` once.
fn all_of(kind: Kind, gps: usize, rng: &mut Rng) -> Vec<Draw> {
    match kind {
        Kind::Air => {
            let air = air().into_iter().map(|faults| vec![(0, Fault::Air(faults))]);
            air.chain(front_ends().map(|fault| vec![(0, fault)])).collect()
        }
        Kind::Gnss if gps == 0 => vec![],
        Kind::Gnss => {
            let mut one = |fault: ReceiverFault| {
                let fitting: Vec<usize> = (0..gps).filter(|receiver| fault.fits(Port::OF[*receiver])).collect();
                let drawn = rng.below(fitting.len().max(1) as u64) as usize;
                fitting.get(drawn).map(|receiver| vec![(0, Fault::Receiver(*receiver, fault))])
            };
            let mut draws: Vec<Draw> = receivers().into_iter().filter_map(&mut one).collect();
            draws.extend(receivers_together(gps, rng));
            draws
        }
        Kind::FlightController => {
            Conduct::ALL.into_iter().map(|conduct| vec![(0, Fault::FlightController(conduct))]).collect()
        }
        Kind::Power => power(rng),
        Kind::Buffers => buffers(rng),
        Kind::Inputs => inputs().map(|(input, fault)| vec![(0, Fault::Input(input, fault))]).collect(),
        Kind::Hang => hangs(rng),
        Kind::Chips => BOARDS.map(|board| vec![(0, Fault::Flip(board, rng.word()))]).into(),
        Kind::Hold => HoldFault::all(rng).into_iter().map(|fault| vec![(0, Fault::Hold(fault))]).collect(),
        Kind::Bits => vec![vec![(0, Fault::Air(AirFaults { bit_error: BIT_ERROR, ..AirFaults::default() }))]],
        Kind::Spi => BOARDS.map(|board| vec![(0, Fault::Chip(board, ChipFault::Glitches(rng.word())))]).into(),
        Kind::Drift => drifts(rng),
        Kind::Hostile => HoldFault::hostile(rng).map(|fault| vec![(0, Fault::Hold(fault))]).collect(),
        Kind::Ram | Kind::Flash | Kind::Registers | Kind::Peripherals => vec![],
    }
}

/// Returns faults of the air that have an effect in an episode of average length.
fn air() -> Vec<AirFaults> {
    let none = AirFaults::default();
    vec![
        // At this bit error rate one frame in three arrives whole.
        AirFaults { bit_error: 5e-4, ..none },
        AirFaults { lost: 0.4, ..none },
        // If every frame is lost, the DPR receives the same as from a HORUS that sends only its carrier.
        AirFaults { lost: 1.0, ..none },
        // If the frames are frozen, the DPR receives the same as from a HORUS whose data do not change.
        AirFaults { frozen: true, ..none },
        AirFaults { truncated: 0.4, ..none },
        // An object's CRC detects every burst of up to 32 bits. These bursts are twice as long.
        AirFaults { burst: 0.4, burst_bits: 64, ..none },
        AirFaults { repeated: 0.4, repeat_after_ns: (100_000, 12 * MS), ..none },
        // A frame is delayed by a fraction of a cycle, or by up to several cycles.
        AirFaults { delayed: 0.4, delay_ns: (MS, 45 * MS), ..none },
        AirFaults { field_off: true, ..none },
        AirFaults { scatter_ns: 3 * MS, ..none },
    ]
}

fn front_ends() -> impl Iterator<Item = Fault> {
    let of = |board| ChipFault::ALL.into_iter().map(move |fault| Fault::Chip(board, fault));
    [Board::Horus, Board::Dpr].into_iter().flat_map(of)
}

fn receivers() -> Vec<ReceiverFault> {
    let absurd = Absurd::ALL.map(ReceiverFault::Absurd);
    let mut faults = vec![
        ReceiverFault::Silent,
        ReceiverFault::Babbles,
        ReceiverFault::Beginnings,
        ReceiverFault::Unasked,
        ReceiverFault::Frozen,
        // A u-blox receiver that has lost its configuration uses this bit rate.
        ReceiverFault::WrongBaud(38_400),
        ReceiverFault::Break,
        ReceiverFault::Noise,
        ReceiverFault::FramingErrors,
        ReceiverFault::Restarts,
        ReceiverFault::Jumps { metres: 1_000 },
        ReceiverFault::NoFix,
        ReceiverFault::LateBursts(60_000_000),
        ReceiverFault::BadChecksums,
        // Receivers agree up to 30 m horizontally and 50 m vertically. These offsets exceed that.
        ReceiverFault::Offset { north: 40, east: -30, up: 0 },
        ReceiverFault::Offset { north: 0, east: 0, up: 120 },
        ReceiverFault::Drifts { mm_s: 20_000 },
        ReceiverFault::FrozenPosition,
        ReceiverFault::Flat,
        // Receivers agree up to 10 degrees and 2 m/s². These errors exceed that.
        ReceiverFault::Turned { degrees: 180 },
        ReceiverFault::Pushed { cm_s2: 500 },
        ReceiverFault::Understates,
        ReceiverFault::TimeJumps(5_000),
        ReceiverFault::TimeJumps(-5_000),
        // Before protocol version 15 a NAV-PVT message was 8 bytes shorter.
        ReceiverFault::OtherLength(-8),
        ReceiverFault::OtherLength(4),
        ReceiverFault::LosesSettings,
    ];
    faults.extend(absurd);
    faults.extend(BusFault::ALL.map(ReceiverFault::Bus));
    faults
}

/// Returns faults of several receivers: all have the same wrong position, all have the same wrong height, or only one
/// measures a height, which is wrong.
fn receivers_together(gps: usize, rng: &mut Rng) -> [Draw; 3] {
    let high = ReceiverFault::Offset { north: 0, east: 0, up: 500 };
    let lone = rng.below(gps as u64) as usize;
    let all = |of: &dyn Fn(usize) -> ReceiverFault| {
        (0..gps).map(|receiver| (0, Fault::Receiver(receiver, of(receiver)))).collect()
    };
    [
        all(&|_| ReceiverFault::Jumps { metres: 1_000 }),
        all(&|_| high),
        all(&|receiver| if receiver == lone { high } else { ReceiverFault::Flat }),
    ]
}

fn inputs() -> impl Iterator<Item = (usize, InputFault)> {
    (0..INPUTS).flat_map(|input| InputFault::ALL.map(|fault| (input, fault)))
}

/// Returns the faults of the DPR's buffers: for each kind of buffer, one flip per buffer, and one bit stuck at zero and
/// at one.
fn buffers(rng: &mut Rng) -> Vec<Draw> {
    let mut draws = vec![];
    for (buffers, count) in [(Buffers::Receive, 3), (Buffers::Image, 4)] {
        for _ in 0..count {
            draws.push(vec![(0, Fault::Buffer(BufferFault::Flips(buffers, rng.word())))]);
        }
        for value in [false, true] {
            draws.push(vec![(0, Fault::Buffer(BufferFault::Stuck(buffers, value, rng.word())))]);
        }
    }
    draws
}

/// The faults that restart a board at once.
const RESTARTS: [PowerFault; 3] = [PowerFault::Pin, PowerFault::BrownOut, PowerFault::Watchdog];

/// Returns every fault of either board's supply and reset, sags, and faults of both boards together in either order.
fn power(rng: &mut Rng) -> Vec<Draw> {
    let restart = Fault::Power(Board::Dpr, RESTARTS[rng.below(RESTARTS.len() as u64) as usize]);
    let dead = Fault::Power(Board::Dpr, PowerFault::CrystalDead);
    let mut draws = vec![vec![(0, dead), (rng.between(0, LENGTH.0), restart)]];
    for board in BOARDS {
        for fault in [PowerFault::Off(rng.word()), PowerFault::FrontEndOff].into_iter().chain(RESTARTS) {
            draws.push(vec![(0, Fault::Power(board, fault))]);
        }
    }
    for board in BOARDS {
        for _ in 0..SAGS {
            draws.push(vec![(0, Fault::Power(board, PowerFault::Sag(rng.word())))]);
        }
    }
    for [first, second] in [[Board::Horus, Board::Dpr], [Board::Dpr, Board::Horus]] {
        let after = rng.between(0, BETWEEN_BOARDS);
        let mut off = |board| Fault::Power(board, PowerFault::Off(rng.word()));
        draws.push(vec![(0, off(first)), (after, off(second))]);
        let after = rng.between(0, BETWEEN_BOARDS);
        let mut restart = |board| Fault::Power(board, RESTARTS[rng.below(RESTARTS.len() as u64) as usize]);
        draws.push(vec![(0, restart(first)), (after, restart(second))]);
    }
    draws
}

/// Returns drifts of HORUS's oscillators, of the DPR's, and of both.
fn drifts(rng: &mut Rng) -> Vec<Draw> {
    let mut drift = |board| (0, Fault::Drift(board, rng.between(0, 2 * MAX_DRIFT) as i64 - MAX_DRIFT as i64));
    vec![vec![drift(Board::Horus)], vec![drift(Board::Dpr)], BOARDS.map(drift).into()]
}

/// Returns hangs of each board, of both boards, and of each during its start, and faults of the boards' tasks.
fn hangs(rng: &mut Rng) -> Vec<Draw> {
    let mut draws: Vec<Draw> = BOARDS.map(|board| vec![(0, Fault::Hang(board))]).into();
    for [first, second] in [[Board::Horus, Board::Dpr], [Board::Dpr, Board::Horus]] {
        draws.push(vec![(0, Fault::Hang(first)), (rng.between(0, BETWEEN_BOARDS), Fault::Hang(second))]);
    }
    for board in BOARDS {
        let restart = RESTARTS[rng.below(RESTARTS.len() as u64) as usize];
        // Half of the hangs in a start begin within 10 µs of the reset.
        let latest = if rng.below(2) == 0 { 10_000 } else { STARTS };
        let hangs = rng.between(WATCHDOG_STARTS, latest);
        draws.push(vec![(0, Fault::Power(board, restart)), (hangs, Fault::Hang(board))]);
        let task = rng.below(tasks_of(board).len() as u64);
        draws.push(vec![(0, Fault::DeadTask(board, task as u8))]);
        // One of the two tasks is a step of the board's cycle.
        let tasks = || 0..tasks_of(board).len() as u8;
        let steps: Vec<u8> = tasks().filter(|task| is_step(board, *task)).collect();
        for among in [steps, tasks().collect()] {
            let task = among[rng.below(among.len() as u64) as usize];
            draws.push(vec![(0, Fault::Spurious(board, task))]);
        }
    }
    draws
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use bench_judge::{Calm, Event, What};

    use super::*;

    const MINUTE: u64 = 60_000_000_000;

    fn of(kind: Kind) -> Vec<Episode> {
        Faults::drawn(&[kind], 3, 5, MINUTE).episodes().to_vec()
    }

    #[test]
    fn every_word_is_read_as_its_kind() {
        for kind in Kind::ALL {
            assert_eq!(kind.word().parse(), Ok(kind));
            assert_eq!(format!(" {kind} ").parse(), Ok(kind));
        }
    }

    #[test]
    fn another_word_is_refused_with_the_words_there_are() {
        let error = "radio".parse::<Kind>().unwrap_err().to_string();
        assert_eq!(
            error,
            "\"radio\" is no kind of fault: give one or several of air, gnss, fc, power, ram, flash, registers, \
             buffers, inputs, hang, chips, hold, bits, spi, drift, peripherals, hostile"
        );
    }

    #[test]
    fn the_same_seed_draws_the_same_episodes_and_another_seed_others() {
        let drawn = |seed| Faults::drawn(&Kind::ALL, 3, seed, MINUTE);
        assert_eq!(drawn(5), drawn(5));
        assert_ne!(drawn(5), drawn(6));
    }

    #[test]
    fn a_kind_more_leaves_the_episodes_of_the_others_as_they_were() {
        let all = Faults::drawn(&Kind::ALL, 3, 5, MINUTE);
        let alone = of(Kind::Gnss);
        let among: Vec<Episode> =
            all.episodes().iter().filter(|episode| matches!(episode.fault, Fault::Receiver(..))).cloned().collect();
        assert_eq!(alone, among);
    }

    #[test]
    fn the_order_in_which_kinds_are_named_does_not_matter() {
        let drawn = |kinds| Faults::drawn(kinds, 3, 5, MINUTE);
        assert_eq!(drawn(&[Kind::Air, Kind::Power]), drawn(&[Kind::Power, Kind::Air, Kind::Power]));
    }

    #[test]
    fn drawn_episodes_keep_their_order_bounds_and_lengths() {
        for seed in 0..20 {
            let faults = Faults::drawn(&Kind::ALL, 3, seed, MINUTE);
            assert!(faults.episodes().is_sorted_by_key(|episode| episode.at));
            for episode in faults.episodes() {
                assert!(episode.at >= FIRST_AT, "{episode:?}");
                assert!(episode.until <= MINUTE - LAST_BEFORE_END, "{episode:?}");
                if lasts(&episode.fault) {
                    let length = episode.until - episode.at;
                    assert!(
                        (length_of(&episode.fault).0..=length_of(&episode.fault).1).contains(&length),
                        "{episode:?}"
                    );
                } else {
                    assert_eq!(episode.until, episode.at, "{episode:?}");
                }
            }
        }
    }

    #[test]
    fn episodes_of_one_kind_do_not_overlap_but_for_what_fails_together() {
        for kind in Kind::ALL {
            for pair in of(kind).windows(2) {
                let both = are_receivers_together(pair)
                    || match (&pair[0].fault, &pair[1].fault) {
                        (Fault::Power(_, PowerFault::CrystalDead), Fault::Power(Board::Dpr, _)) => true,
                        (Fault::Power(one, _), Fault::Power(other, _)) => one != other,
                        (Fault::Hang(one), Fault::Hang(other)) => one != other,
                        (Fault::Drift(one, _), Fault::Drift(other, _)) => one != other,
                        (Fault::Power(one, _), Fault::Hang(other)) => one == other,
                        _ => false,
                    } && pair[1].at - pair[0].at <= BETWEEN_BOARDS;
                let gap = if kind == Kind::Hostile { HOSTILE_GAP.0 } else { GAP.0 };
                assert!(both || pair[1].at >= pair[0].until + gap, "{pair:?}");
            }
        }
    }

    /// Returns for how many per cent of ten drawn minutes the judge requires each of three things: that the hold sends,
    /// that the DPR shows and answers, and that Hold-Status agrees with the payload.
    fn judged(kinds: &[Kind], seed: u64) -> [u64; 3] {
        const STEP: u64 = 10_000_000;
        let (mut calm, mut judged) = (Calm::default(), [0; 3]);
        let faults = Faults::drawn(kinds, 3, seed, 10 * MINUTE);
        let mut episodes = faults.episodes().iter().peekable();
        for at in (0..10 * MINUTE).step_by(STEP as usize) {
            while let Some(Episode { at, until, fault }) = episodes.next_if(|episode| episode.at <= at) {
                let (kind, disturbs) = (fault.name(), fault.disturbs());
                calm.take(&Event { at: *at, what: What::Injected { kind, disturbs, until: *until } });
            }
            for (count, from) in judged.iter_mut().zip([calm.sends(), calm.exchanges(), calm.measures()]) {
                *count += u64::from(at >= from);
            }
        }
        judged.map(|count| 100 * count * STEP / (10 * MINUTE))
    }

    #[test]
    fn the_duties_of_the_hold_are_judged_in_a_drawn_run() {
        for seed in 1..4 {
            // These two kinds are left out, so that there is time in which the hold and the DPR are undisturbed.
            let most: Vec<Kind> =
                Kind::ALL.into_iter().filter(|kind| !matches!(kind, Kind::Hostile | Kind::Spi)).collect();
            let (alone, all) = (judged(&[Kind::Hold], seed), judged(&most, seed));
            let is_at_least =
                |shares: [u64; 3], least: [u64; 3]| shares.iter().zip(least).all(|(it, least)| *it >= least);
            assert!(is_at_least(alone, [40, 40, 25]), "{alone:?}");
            assert!(is_at_least(all, [40, 2, 25]), "{all:?}");
        }
    }

    fn are_receivers_together(pair: &[Episode]) -> bool {
        let both = |fault: fn(&Episode) -> u64| fault(&pair[0]) == fault(&pair[1]);
        let of = |episode: &Episode| match episode.fault {
            Fault::Receiver(receiver, _) => Some(receiver),
            _ => None,
        };
        of(&pair[0]) < of(&pair[1]) && of(&pair[0]).is_some() && both(|it| it.at) && both(|it| it.until)
    }

    #[test]
    fn a_minute_has_jumps_of_all_and_wrong_heights_beside_2d_fixes() {
        let mut together: Vec<Vec<ReceiverFault>> = vec![];
        for episodes in of(Kind::Gnss).chunk_by(|one, other| are_receivers_together(&[one.clone(), other.clone()])) {
            let faults = episodes.iter().filter_map(|episode| match episode.fault {
                Fault::Receiver(_, fault) => Some(fault),
                _ => None,
            });
            together.push(faults.collect());
        }
        let high = ReceiverFault::Offset { north: 0, east: 0, up: 500 };
        for all in [ReceiverFault::Jumps { metres: 1_000 }, high] {
            assert!(together.contains(&vec![all; 3]), "{all:?}");
        }
        let beside_flat = |faults: &Vec<ReceiverFault>| {
            let count = |of| faults.iter().filter(|fault| **fault == of).count();
            (count(high), count(ReceiverFault::Flat)) == (1, 2)
        };
        assert!(together.iter().any(beside_flat));
    }

    #[test]
    fn gaps_are_half_a_second_on_average() {
        let episodes = of(Kind::Gnss);
        let apart = episodes.windows(2).filter(|pair| !are_receivers_together(pair));
        let gaps: Vec<u64> = apart.map(|pair| pair[1].at - pair[0].until).collect();
        let mean = gaps.iter().sum::<u64>() / gaps.len() as u64;
        assert!((450_000_000..=550_000_000).contains(&mean), "{mean}");
    }

    #[test]
    fn a_minute_has_every_fault_of_every_kind_that_is_drawn() {
        let names = |kind| of(kind).iter().map(|episode| episode.fault.name()).collect::<BTreeSet<_>>();
        let faults: BTreeSet<_> = of(Kind::Gnss)
            .into_iter()
            .filter_map(|episode| match episode.fault {
                Fault::Receiver(_, fault) => Some(fault.name()),
                _ => None,
            })
            .collect();
        assert_eq!(faults.len(), receivers().len());
        let shows = |wanted: AirFaults| of(Kind::Air).iter().any(|episode| episode.fault == Fault::Air(wanted));
        assert!(air().into_iter().all(shows));
        let drawn = |wanted: Fault| of(Kind::Air).iter().any(|episode| episode.fault == wanted);
        assert!(front_ends().all(drawn));
        assert_eq!(
            names(Kind::FlightController).len(),
            Conduct::ALL.map(Conduct::name).into_iter().collect::<BTreeSet<_>>().len()
        );
        assert_eq!(
            of(Kind::Inputs).iter().map(|episode| format!("{:?}", episode.fault)).collect::<BTreeSet<_>>().len(),
            INPUTS * InputFault::ALL.len()
        );
        for board in ["horus", "dpr"] {
            for name in ["off", "reset pin", "brown-out", "watchdog", "sag", "front end off"] {
                assert!(names(Kind::Power).contains(&format!("power {board} {name}")), "{board} {name}");
            }
        }
        assert!(names(Kind::Power).contains("power dpr crystal dead"));
        for name in ["receive bit flips", "receive bit stuck", "image bit flips", "image bit stuck"] {
            assert!(names(Kind::Buffers).contains(&format!("buffer dpr {name}")), "{name}");
        }
        for board in BOARDS {
            let episodes = of(Kind::Hang);
            let started = |pair: &&[Episode]| starts(&pair[0].fault, board) && pair[1].fault == Fault::Hang(board);
            let after: Vec<u64> = episodes.windows(2).filter(started).map(|pair| pair[1].at - pair[0].at).collect();
            assert!(after.iter().all(|after| (WATCHDOG_STARTS..=STARTS).contains(after)), "{after:?}");
            assert!(after.iter().any(|after| *after <= 10_000) && after.iter().any(|after| *after > 10_000));
        }
        let flips = BOARDS.map(|board| format!("{} front end register flips", super::super::name_of(board)));
        assert_eq!(names(Kind::Chips), BTreeSet::from(flips));
        assert_eq!(names(Kind::Hostile).len(), 5);
        for kind in [Kind::Ram, Kind::Flash, Kind::Registers] {
            assert!(of(kind).is_empty());
        }
    }

    #[test]
    fn a_minute_of_drawn_hangs_has_each_board_alone_and_both_together() {
        let episodes = of(Kind::Hang);
        let together = |pair: &[Episode]| pair[1].at - pair[0].at <= BETWEEN_BOARDS && pair[0].fault != pair[1].fault;
        let firsts: Vec<&Fault> =
            episodes.windows(2).filter(|pair| together(pair)).map(|pair| &pair[0].fault).collect();
        for board in BOARDS {
            let fault = Fault::Hang(board);
            assert!(firsts.contains(&&fault), "{board:?} first");
            let alone = |at: u64| episodes.iter().filter(|other| other.at.abs_diff(at) <= BETWEEN_BOARDS).count() == 1;
            assert!(episodes.iter().any(|episode| episode.fault == fault && alone(episode.at)), "{board:?} alone");
        }
        let hangs: Vec<_> = episodes.iter().filter(|it| matches!(it.fault, Fault::Hang(_))).cloned().collect();
        for pair in hangs.windows(2).filter(|pair| !together(pair)) {
            assert!(pair[1].at - pair[0].at >= HANG_LENGTH.0 + GAP.0, "{pair:?}");
        }
    }

    #[test]
    fn a_board_that_starts_does_not_hang_before_its_watchdog_runs() {
        let hang = |at, board| Episode { at, until: at, fault: Fault::Hang(board) };
        let left = |power: PowerFault, hang: Episode| {
            let mut faults = Faults::none().with(500, 900, Fault::Power(Board::Dpr, power));
            faults.add(hang);
            faults.without_hangs_in_starts();
            faults.episodes.len() == 2
        };
        for power in [PowerFault::Off(1), PowerFault::Pin, PowerFault::BrownOut, PowerFault::Watchdog] {
            assert!(left(power, hang(899, Board::Dpr)), "{power:?}");
            assert!(!left(power, hang(900, Board::Dpr)), "{power:?}");
            assert!(!left(power, hang(899 + WATCHDOG_STARTS, Board::Dpr)), "{power:?}");
            assert!(left(power, hang(900 + WATCHDOG_STARTS, Board::Dpr)), "{power:?}");
            assert!(left(power, hang(900, Board::Horus)), "{power:?}");
        }
        assert!(left(PowerFault::FrontEndOff, hang(900, Board::Dpr)));
        assert!(left(PowerFault::CrystalDead, hang(900, Board::Dpr)));
        // The last start of the board before a hang decides whether that hang stays.
        let mut faults = Faults::none();
        for at in [100, 2 * WATCHDOG_STARTS, 9 * WATCHDOG_STARTS] {
            faults.add(Episode { at, until: at, fault: Fault::Power(Board::Dpr, PowerFault::Pin) });
        }
        faults.add(hang(3 * WATCHDOG_STARTS - 1, Board::Dpr));
        faults.add(hang(3 * WATCHDOG_STARTS, Board::Dpr));
        faults.without_hangs_in_starts();
        assert_eq!(faults.episodes.len(), 4);
    }

    #[test]
    fn ten_minutes_have_every_task_of_both_boards_dead_each_alone() {
        let episodes = Faults::drawn(&[Kind::Hang], 3, 5, 10 * MINUTE).episodes;
        let mut dead = BTreeSet::new();
        for pair in episodes.windows(2) {
            if let Fault::DeadTask(board, task) = pair[0].fault {
                assert!(pair[1].at - pair[0].at >= DEAD_TASK_LENGTH.0 + GAP.0, "{pair:?}");
                dead.insert(Fault::DeadTask(board, task).name());
            }
        }
        assert_eq!(dead.len(), BOARDS.into_iter().map(|board| tasks_of(board).len()).sum::<usize>(), "{dead:?}");
    }

    /// The seed of a kind's draws contains the kind's number. Published figures depend on these numbers.
    #[test]
    fn the_kinds_keep_the_numbers_that_their_draws_are_seeded_by() {
        let numbers = Kind::ALL.map(|kind| kind as u64);
        assert_eq!(numbers, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]);
        assert_eq!(Kind::ALL[9..12], [Kind::Hang, Kind::Chips, Kind::Hold]);
        assert_eq!(Kind::ALL[12..], [Kind::Bits, Kind::Spi, Kind::Drift, Kind::Peripherals, Kind::Hostile]);
    }

    #[test]
    fn a_minute_has_both_supplies_failing_together_in_either_order() {
        let episodes = of(Kind::Power);
        let together = |first: Board| {
            episodes.windows(2).any(|pair| {
                let of_first = matches!(pair[0].fault, Fault::Power(board, PowerFault::Off(_)) if board == first);
                let of_second = matches!(pair[1].fault, Fault::Power(board, PowerFault::Off(_)) if board != first);
                of_first && of_second && pair[1].at < pair[0].until && pair[1].until >= pair[0].until
            })
        };
        assert!(together(Board::Horus));
        assert!(together(Board::Dpr));
    }

    #[test]
    fn receivers_that_are_not_there_have_no_faults() {
        assert_eq!(Faults::drawn(&[Kind::Gnss], 0, 5, MINUTE), Faults::none());
        let hit: BTreeSet<usize> = of(Kind::Gnss)
            .into_iter()
            .filter_map(|episode| if let Fault::Receiver(receiver, _) = episode.fault { Some(receiver) } else { None })
            .collect();
        assert_eq!(hit.into_iter().collect::<Vec<_>>(), [0, 1, 2]);
    }

    #[test]
    fn faults_in_turn_are_all_of_a_kind_once() {
        let (faults, end) = Faults::in_turn(Kind::Inputs, 3, &mut Rng::new(1), 1_000, [20, 10]);
        let all = all_of(Kind::Inputs, 3, &mut Rng::new(1)).len();
        assert!(all > 1);
        assert_eq!((faults.episodes().len(), end), (all, 1_000 + 30 * all as u64));
        assert!(faults.episodes().windows(2).all(|pair| pair[1].at == pair[0].until + 10));
    }

    #[test]
    fn a_run_too_short_for_an_episode_has_none() {
        let faults = Faults::drawn(&Kind::ALL, 3, 5, FIRST_AT + LAST_BEFORE_END);
        assert_eq!(faults, Faults::none());
    }

    #[test]
    fn the_supplies_of_two_episodes_come_up_with_other_noise() {
        let seeds: Vec<u64> = of(Kind::Power)
            .into_iter()
            .filter_map(|episode| match episode.fault {
                Fault::Power(_, PowerFault::Off(seed)) => Some(seed),
                _ => None,
            })
            .collect();
        assert_eq!(seeds.iter().collect::<BTreeSet<_>>().len(), seeds.len());
    }
}
