//! Flips every bit in the registers of both front ends, each bit once.
//!
//! Each bit is flipped on a copy of a bench whose link is up. The copy runs on for [`FOR_NS`]. The outcome has the time
//! without valid and new data, and the reports of Link-Status in that time. One bench has chips ST25R3916, another has
//! ST25R3916B.

use std::collections::BTreeMap;
use std::fmt;

use bench_judge::{Event, What};
use cortex_m4::{Cost, Fast, Optimistic, Pessimistic};
use profile::{LinkStatus, LinkStatusBits, Object};
use st25r3916_model::Config;

use super::{Bench, Error, Setup, on_the_link};
use crate::danger::is_dangerous;
use crate::faults::chip::FLIP_MENDED;
use crate::faults::{Board, Fault, Faults, RegisterBit, name_of};
use emulator_node::{Clock, Threads};

/// The longest time from a flip of a register's bit until the flight controller reads valid data again, ns.
pub const VALID_AGAIN: u64 = 1_500_000_000;
const WARM: u64 = 600_000_000;
/// The time for which each copy runs after its flip, ns. It is long enough to show a link that recovers and fails
/// again.
pub const FOR_NS: u64 = 2_000_000_000;
/// The longest time, ns, from one reading of new data to the next in a link without faults, with a margin.
const GAP: u64 = 35_000_000;

/// The outcome of a flip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flip {
    /// The type of the front end's chip: `ST25R3916` or `ST25R3916B`.
    pub part: &'static str,
    /// The board of the front end whose bit is flipped.
    pub board: Board,
    /// The flipped bit.
    pub bit: RegisterBit,
    /// The time from the flip until valid and new data were read again without a further gap, ns; `None` if they were
    /// still missing at the end.
    pub back_after: Option<u64>,
    /// The number of readings without valid and new data, by the report in Link-Status: link down, faulty front end,
    /// neither.
    pub said: [u32; 3],
    /// The violations, as text, in which invalid data were shown as valid.
    pub dangerous: Vec<String>,
}

impl Flip {
    /// Whether valid data were read again within [`VALID_AGAIN`] and no invalid data were shown as valid.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.back_after.is_some_and(|after| after <= VALID_AGAIN) && self.dangerous.is_empty()
    }

    /// Whether valid and new data were missing although no reading reported a cause.
    #[must_use]
    pub fn unsaid(&self) -> bool {
        self.back_after != Some(0) && self.said[..2] == [0, 0]
    }
}

impl fmt::Display for Flip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { part, board, bit: RegisterBit { in_space_b, address, bit }, back_after, said, dangerous } = self;
        let space = if *in_space_b { "B" } else { " " };
        let back = back_after.map_or("never".to_owned(), |ns| format!("{:.0} ms", ns as f64 / 1e6));
        write!(f, "{part:<10} {:<5} {space}{address:02X}.{bit}: back after {back}", name_of(*board))?;
        write!(f, "; link down {}, front end fault {}, neither {}", said[0], said[1], said[2])?;
        dangerous.iter().try_for_each(|words| write!(f, "; {words}"))
    }
}

/// The outcomes of all flips.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Flips(pub Vec<Flip>);

impl fmt::Display for Flips {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut groups: BTreeMap<(&str, &str), Vec<&Flip>> = BTreeMap::new();
        for flip in &self.0 {
            groups.entry((flip.part, name_of(flip.board))).or_default().push(flip);
        }
        writeln!(
            f,
            "{:<10} {:<5} {:>5} {:>10} {:>11} {:>10} {:>13} {:>9}",
            "part", "board", "bits", "no effect", "back again", "at worst", "said as fault", "not back"
        )?;
        for ((part, board), flips) in groups {
            let count = |of: &dyn Fn(&Flip) -> bool| flips.iter().filter(|flip| of(flip)).count();
            let worst = flips.iter().filter_map(|flip| flip.back_after).max().unwrap_or(0);
            writeln!(
                f,
                "{part:<10} {board:<5} {:>5} {:>10} {:>11} {:>7.0} ms {:>13} {:>9}",
                flips.len(),
                count(&|flip| flip.back_after == Some(0)),
                count(&|flip| flip.holds() && flip.back_after != Some(0)),
                worst as f64 / 1e6,
                count(&|flip| flip.said[1] > 0),
                count(&|flip| !flip.holds()),
            )?;
        }
        let told = self.0.iter().filter(|flip| flip.back_after != Some(0) || !flip.holds());
        told.into_iter().try_for_each(|flip| writeln!(f, "{flip}"))
    }
}

/// Flips each bit of both chips' registers that `takes` selects by its index. Calls `each` with every outcome.
///
/// # Errors
///
/// The errors are those of [`super::run`].
pub fn flips(
    setup: &Setup,
    mut takes: impl FnMut(usize, RegisterBit) -> bool,
    mut each: impl FnMut(&Flip),
) -> Result<Flips, Error> {
    let mut all = vec![];
    for (part, config) in [("ST25R3916B", Config::default()), ("ST25R3916", Config::st25r3916())] {
        let setup = Setup {
            front_ends: on_the_link(config),
            faults: Faults::none(),
            duration_ns: WARM + FOR_NS,
            trace: None,
            log: None,
            plot: None,
            ..setup.clone()
        };
        match setup.clock {
            Clock::Fast => of_part(part, Bench::<Fast>::new(&setup)?, &mut all, &mut takes, &mut each),
            Clock::Optimistic => of_part(part, Bench::<Optimistic>::new(&setup)?, &mut all, &mut takes, &mut each),
            Clock::Pessimistic => of_part(part, Bench::<Pessimistic>::new(&setup)?, &mut all, &mut takes, &mut each),
        }
    }
    Ok(Flips(all))
}

fn of_part<C: Cost>(
    part: &'static str,
    mut bench: Bench<C>,
    all: &mut Vec<Flip>,
    takes: &mut impl FnMut(usize, RegisterBit) -> bool,
    each: &mut impl FnMut(&Flip),
) {
    bench.run_to(WARM, Threads::Two);
    for board in [Board::Horus, Board::Dpr] {
        let chip = match board {
            Board::Horus => bench.horus().board().front_end.chip(),
            Board::Dpr => bench.dpr().board().front_end.chip(),
        };
        for (place, bit) in RegisterBit::all_of(chip).into_iter().enumerate() {
            if !takes(place, bit) {
                continue;
            }
            let mut copy = bench.clone();
            // The flips have different phases in the cycle, so that some coincide with a frame.
            let at = bench.now() + 1_000_000 + place as u64 * 7_310_000 % 10_000_000;
            copy.add_faults(&Faults::none().with(at, at + FLIP_MENDED, Fault::Flip(board, place as u64)));
            copy.keep_log();
            copy.run_to(at + FOR_NS, Threads::Two);
            let finished = copy.finish(at + FOR_NS);
            let (back_after, said) = read(&finished.log.events, at, at + FOR_NS);
            let invalid = finished.verdict.violations.iter().filter(|broken| is_dangerous(broken.violation));
            let dangerous = invalid.map(|broken| broken.violation.words().to_owned()).collect();
            let flip = Flip { part, board, bit, back_after, said, dangerous };
            each(&flip);
            all.push(flip);
        }
    }
}

/// Returns two results. The first is the time, ns, from `at` until valid and new data were read without a further gap.
/// The second is the number of readings before that, by the report in Link-Status: link down, faulty front end,
/// neither.
fn read(events: &[Event], at: u64, end: u64) -> (Option<u64>, [u32; 3]) {
    let mut status: Vec<(u64, LinkStatusBits)> = vec![];
    // `last` is the instant of the latest new data. `back` is the time from the flip to the end of the last gap.
    let (mut last, mut back) = (at, Some(0));
    let mut newest = None;
    for event in events {
        let What::Transaction { selected, miso, .. } = &event.what else { continue };
        if *selected < at {
            continue;
        }
        let Some(Ok(link)) = miso.0.get(..32).map(LinkStatus::verify) else { continue };
        status.push((*selected, link.values().status));
        let Some(Ok(object)) = miso.0.get(32..96).map(|bytes| Object::verify(0, bytes)) else { continue };
        let Object::Reported(reported) = object else { continue };
        let valid = reported.values().status.position_valid() && link.values().status.link_up();
        if !valid || newest == Some(object.timestamp()) {
            continue;
        }
        newest = Some(object.timestamp());
        if selected - last > GAP {
            back = Some(selected - at);
        }
        last = *selected;
    }
    if end - last > GAP {
        back = None;
    }
    let until = back.map_or(end, |after| at + after);
    let mut said = [0; 3];
    for (_, bits) in status.iter().filter(|(selected, _)| *selected < until) {
        said[0] += u32::from(!bits.link_up());
        said[1] += u32::from(bits.front_end_fault());
        said[2] += u32::from(bits.link_up() && !bits.front_end_fault());
    }
    (back, said)
}
