//! Runs that visit the failures of one part after the other, each once and at a time of its own.

use bench::faults::{
    Board, BufferFault, Buffers, ChipFault, Conduct, Fault, Faults, FrontEndFault, HoldBoardFault, HoldFault,
    ImageFault, Kind, PowerFault, ReceiverFault, Rng, Upset,
};

use super::run::{Addresses, Run};

const MS: u64 = 1_000_000;

/// The instant from which a link without faults is up, ns.
const UP: u64 = 1_200 * MS;

/// The time for which a fault lasts, and the pause behind it, ns. A front end is brought up again within the pause.
const TURN: [u64; 2] = [250 * MS, 200 * MS];

/// The time in which a board restarts and is up again, ns.
const RESTART: u64 = 900 * MS;

/// The number of receivers' faults that separate the receivers: each has another fault at any time.
const APART: u64 = 450 * MS;

/// By how much a receiver's time of week jumps, ms. A flight begins at 295,200,000, so that the lag of a receiver
/// behind HORUS's clock exceeds half a week, and after the last jump it is nearly 0.
const TIME_JUMPS: [i32; 3] = [400_000_000, -400_000_000, 305_000_000];

/// How far behind the beginning of the RAM the bit lies that gets stuck, bytes. The test of RAM takes 0.4 s (HORUS) or
/// 1.25 s (the DPR) to get there.
const STUCK_AT: u32 = 4 * 1_000;

/// The time in which HORUS's patrol compares all of flash, and a little more, ns: 16 words in 2.4 ms.
const FLASH_PASS: u64 = 5_000 * MS;

/// The time in which all code in RAM is compared with flash, ns: 6.4 KiB each second.
const CODE_PASS: u64 = 8_500 * MS;

/// The time in which the DPR's patrol finds the bit by itself, ns. Then the flight controller's self-tests find it too.
const WITHOUT_SELF_TEST: u64 = 2_500 * MS;

/// The time from a restart until a bit gets stuck, ns: behind the test at the start.
const BEHIND_START: u64 = 150 * MS;

/// The sizes of the buffers, bytes: of a frame, of an image, of what the flight controller writes.
const SIZES: [(Buffers, u64, u64); 3] =
    [(Buffers::Receive, 3, 260), (Buffers::Image, 4, 588), (Buffers::Written, 3, 80)];

/// Returns the runs beside a hold if `hold`, or else without one.
pub(super) fn runs(gps: usize, seed: u64, addresses: &Addresses, hold: bool) -> Vec<Run> {
    let mut rng = Rng::new(seed);
    let boards: &[Board] = if hold { &[Board::Dpr] } else { &[Board::Horus, Board::Dpr] };
    let mut runs = vec![];
    let mut add = |name: &str, (faults, end): (Faults, u64)| {
        let duration_ns = end + RESTART;
        let name = name.to_owned();
        runs.push(Run { name, faults, duration_ns, factory_settings: false, recordings: vec![], judged: false });
    };
    add("air and chips in turn", Faults::in_turn(Kind::Air, gps, &mut rng, UP, TURN));
    add("flight controller in turn", flight_controller(gps, &mut rng));
    add("registers flip in turn", registers_flip(boards));
    add("many SPI glitches", glitches(boards, seed));
    add("misreads", misreads(boards, hold));
    add("stuck bits of buffers", stuck_buffers());
    add("interrupts without a task", without_task(boards));
    for (nth, board) in [Board::Horus, Board::Dpr].into_iter().enumerate().filter(|(_, board)| boards.contains(board)) {
        let script = faulty_memory(board, addresses, nth);
        add(&format!("faulty memory of {}", bench::faults::name_of(board)), script);
    }
    if !hold {
        add("HORUS's antenna in turn", antenna());
        add("receivers in turn", receivers(gps, seed));
        add("inputs in turn", Faults::in_turn(Kind::Inputs, gps, &mut rng, UP, [200 * MS, 100 * MS]));
        add("power in turn", Faults::in_turn(Kind::Power, gps, &mut rng, UP, [300 * MS, RESTART]));
    }
    runs
}

/// All faults at instants of their own, each with its length, ns; and the end.
fn one_after_the_other(faults: impl IntoIterator<Item = Fault>, from: u64, [length, pause]: [u64; 2]) -> (Faults, u64) {
    let (mut all, mut at) = (Faults::none(), from);
    for fault in faults {
        all = all.with(at, at + length, fault);
        at += length + pause;
    }
    (all, at)
}

/// Adds all episodes of `more` to `faults`.
fn joined(mut faults: Faults, more: &Faults) -> Faults {
    more.episodes().iter().for_each(|episode| faults.add(episode.clone()));
    faults
}

fn flight_controller(gps: usize, rng: &mut Rng) -> (Faults, u64) {
    let (faults, at) = Faults::in_turn(Kind::FlightController, gps, rng, UP, [150 * MS, 50 * MS]);
    let writes = 2_000 * MS;
    (faults.with(at, at + writes, Fault::FlightController(Conduct::WritesEach)), at + writes)
}

/// Bits of every register of the front ends flip, several a cycle of read-backs.
fn registers_flip(boards: &[Board]) -> (Faults, u64) {
    const FLIPS: u64 = 130;
    const APART: u64 = 5;
    let flips = (0..FLIPS).flat_map(|nth| boards.iter().map(move |board| Fault::Flip(*board, nth * APART)));
    one_after_the_other(flips, UP, [30 * MS, 10 * MS])
}

fn glitches(boards: &[Board], seed: u64) -> (Faults, u64) {
    let end = UP + 6_000 * MS;
    let glitches = boards.iter().map(|board| Fault::Chip(*board, ChipFault::Glitches(seed)));
    (glitches.fold(Faults::none(), |faults, fault| faults.with(UP, end, fault)), end)
}

/// The front ends answer each read of the registers that are checked with another value.
fn misreads(boards: &[Board], hold: bool) -> (Faults, u64) {
    // The first byte of a read, the place of a byte behind it and the bits that are inverted: a chip of another type; a
    // supply beyond its limits; operation control (reset or not), mode and bit rate; the mask of interrupts (reset or
    // not), interrupts, errors and the level of the FIFO; no carrier; main and timer interrupts.
    const READS: [(u8, u8, u8); 17] = [
        (0x7F, 1, 0xF8),
        (0x65, 1, 0x80),
        (0x65, 1, 0x3F),
        (0x42, 1, 0x80),
        (0x42, 1, 0x04),
        (0x42, 2, 0x01),
        (0x42, 3, 0x01),
        (0x59, 1, 0xFF),
        (0x59, 1, 0x01),
        (0x59, 2, 0x08),
        (0x59, 4, 0x30),
        (0x59, 6, 0x05),
        (0x59, 7, 0xC0),
        (0x59, 7, 0x30),
        (0x71, 1, 0xFF),
        (0x5A, 1, 0x80),
        (0x5A, 2, 0x80),
    ];
    let (mut faults, mut at) = (Faults::none(), UP);
    for (first, place, flips) in READS {
        // Several of these registers are read only while a chip is brought up, which a transfer that fails causes.
        let fault = ChipFault::Misreads { first, place, flips };
        for (lasts, fault) in [(45 * MS, ChipFault::ReadsZeros), (150 * MS, fault)] {
            let of_boards = boards.iter().map(|board| Fault::Chip(*board, fault));
            let of_hold = [HoldFault::Board(HoldBoardFault::Chip(fault)), HoldFault::Port(fault)];
            for failure in of_boards.chain(of_hold.into_iter().filter(|_| hold).map(Fault::Hold)) {
                faults = faults.with(at, at + lasts, failure);
            }
        }
        at += 270 * MS;
    }
    (faults, at)
}

/// A bit is stuck in each buffer in turn, then in the same place at a start, and bits of the images flip.
fn stuck_buffers() -> (Faults, u64) {
    let (mut faults, mut at) = (Faults::none(), UP);
    let stick = |faults: Faults, at: u64, fault: BufferFault| faults.with(at, at + 80 * MS, Fault::Buffer(fault));
    for (buffers, count, size) in SIZES {
        for nth in 0..count {
            for value in [true, false] {
                let word = 8 * (nth * size + 20) + 3;
                faults = stick(faults, at, BufferFault::Stuck(buffers, value, word));
                at += 100 * MS;
            }
        }
        let word = 8 * 21;
        faults = faults.with(at, at + RESTART, Fault::Buffer(BufferFault::Stuck(buffers, true, word)));
        faults = faults.with(at + MS, at + MS, Fault::Power(Board::Dpr, PowerFault::Pin));
        at += RESTART + 2 * MS;
    }
    // Which of the images the flight controller reads at the time is left to chance: there are four.
    for nth in 0..300 {
        faults = faults.with(at, at, Fault::Buffer(BufferFault::Flips(Buffers::Image, 8 * (nth * 19) + nth % 8)));
        at += 7 * MS;
    }
    (faults, at)
}

/// An interrupt that no task has becomes enabled and pending.
fn without_task(boards: &[Board]) -> (Faults, u64) {
    // ISER0 and ISPR0 (ARMv7-M ARM B3.4.3). RTC_WKUP of the STM32F429 (RM0090, table 62), RNG of the nRF52840 (PS v1.7,
    // 4.2.3).
    let number = |board: &Board| if *board == Board::Horus { 3 } else { 13 };
    let flips = boards.iter().flat_map(|board| {
        let flip = |address| Fault::Upset(*board, Upset::Peripheral { address, bit: number(board) });
        [flip(0xE000_E100), flip(0xE000_E200)]
    });
    one_after_the_other(flips, UP, [0, MS])
}

/// A bit of a guard word of `board`, which is number `nth`, flips, and one of the last word of code in RAM, if there is
/// any: it is a table's, without which the firmware runs. HORUS's program no longer fits its CRC, as the DPR's does not
/// in [`super::dpr_runs`]. Then a bit of RAM gets stuck behind a start, and is stuck at the next start. The flight
/// controller is silent at first, since each self-test lets the DPR's patrol begin anew.
fn faulty_memory(board: Board, addresses: &Addresses, nth: usize) -> (Faults, u64) {
    let Addresses { crcs, ram, guards, hot, .. } = addresses;
    let (crc, ram, guard, hot) = (crcs[nth], ram[nth], guards[nth], hot[nth]);
    let pin = Fault::Power(board, PowerFault::Pin);
    let (mut faults, mut at) = (Faults::none(), UP);
    let code = (hot != 0).then_some((hot.saturating_sub(4), CODE_PASS));
    for (address, found) in [Some((guard, RESTART)), code].into_iter().flatten() {
        faults = faults.with(at, at, Fault::Upset(board, Upset::Ram { address, bit: 4 }));
        at += found + RESTART;
    }
    if board == Board::Horus {
        let wrong = ImageFault::Patch { address: crc, bytes: vec![0; 4], sealed: false };
        faults = faults.with(at, at + FLASH_PASS, Fault::Image(board, wrong));
        at += FLASH_PASS + RESTART;
    }
    let sticks = at + BEHIND_START;
    let again = at + 4_500 * MS;
    let stuck = Upset::Stuck { address: ram + STUCK_AT, bit: 5, value: true };
    if board == Board::Dpr {
        faults = faults.with(at, at + WITHOUT_SELF_TEST, Fault::FlightController(Conduct::Silent));
    }
    faults = faults.with(at, at, pin.clone()).with(sticks, sticks, Fault::Upset(board, stuck));
    (faults.with(again, again, pin), again + RESTART)
}

fn antenna() -> (Faults, u64) {
    let each = [
        FrontEndFault::NoCarrier,
        FrontEndFault::Mute,
        FrontEndFault::BreaksOff,
        FrontEndFault::Shortened,
        FrontEndFault::FrameAgain(2 * MS),
        FrontEndFault::CommandAgain(2 * MS),
        FrontEndFault::Scatters(3 * MS),
        FrontEndFault::SelectLate(20_000),
    ];
    let (faults, at) = one_after_the_other(each.map(Fault::FrontEnd), UP, TURN);
    // The carrier fails and returns in every part of a cycle: 10 ms have no common divisor with the period but 1 ms.
    let fails = std::iter::repeat_n(Fault::FrontEnd(FrontEndFault::NoCarrier), 60);
    let (more, end) = one_after_the_other(fails, at, [6_300_000, 16_900_000]);
    (joined(faults, &more), end)
}

/// Every fault of a receiver, with other faults on the others at the same time.
fn receivers(gps: usize, seed: u64) -> (Faults, u64) {
    let (mut faults, mut end) = (Faults::none(), 0);
    for nth in 0..gps as u64 {
        let mut rng = Rng::new(seed + nth);
        let (more, until) = Faults::in_turn(Kind::Gnss, gps, &mut rng, UP + nth * APART, [300 * MS, 50 * MS]);
        faults = joined(faults, &more);
        end = end.max(until);
    }
    // Each receiver is silent until its values are too old, and then its time of week jumps. At the last of its jumps
    // the first receiver has no position, so that its lag is compared with one that is smaller by half a week.
    for receiver in 0..gps {
        let jumps = TIME_JUMPS.map(ReceiverFault::TimeJumps);
        let each = std::iter::once(ReceiverFault::Silent).chain(jumps);
        let each = each.map(|fault| Fault::Receiver(receiver, fault));
        let (more, until) = one_after_the_other(each, end, [1_200 * MS, 300 * MS]);
        (faults, end) = (joined(faults, &more), until);
        if receiver != 0 {
            faults = faults.with(end - 900 * MS, end - 300 * MS, Fault::Receiver(0, ReceiverFault::NoFix));
        }
    }
    (faults, end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_script_has_faults_that_end_before_its_run() {
        for hold in [false, true] {
            let runs = runs(3, 1, &Addresses::EXAMPLE, hold);
            assert!(runs.len() >= 6);
            for run in runs {
                let last = run.faults.episodes().iter().map(|episode| episode.until).max().unwrap();
                assert!((UP..run.duration_ns).contains(&last), "{}", run.name);
            }
        }
    }

    #[test]
    fn beside_a_hold_no_fault_is_horus_s_alone() {
        let boards = |hold: bool| {
            let runs = runs(3, 1, &Addresses::EXAMPLE, hold);
            runs.iter().filter(|run| run.name.contains("horus") || run.name.contains("HORUS")).count()
        };
        assert_eq!((boards(true), boards(false)), (0, 2));
    }
}
