//! Runs in which the DPR's front end fails at each transfer, and in which frames meet what the driver does.
//!
//! | run | what fails |
//! |---|---|
//! | listener: wrong bytes | one byte after the other that the DPR reads from the chip has only ones, or only zeros |
//! | listener: broken bring-up | the chip fails at each step of a bring-up |
//! | listener: late frames | a frame begins while the driver checks a chip that has been silent |
//! | listener: other chip | the older chip, which resolves contradictions of its data sheet in the other way: a listener |
//! | | receives frames without a command, a broken frame never ends, and clearing the FIFO keeps interrupts |
//!
//! The judge's verdict is not asked for, since several failures meet.

use bench::faults::{AirFaults, Board, ChipFault, Fault, Faults, FrontEndFault};
use bench::sim::{BrokenFrame, FrontEndConfig, on_the_link};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// The end of a frame of HORUS in the bench's runs of three receivers, ns, and the time to the next one: HORUS's crystal
/// is fast. A run of another profile meets other bytes.
const FRAME_ENDS: u64 = 33_951_000;
const CYCLE: u64 = 9_999_914;

/// The first frame that a script counts from.
const FIRST: u64 = 120;

/// The name of the run with the older chip.
pub(super) const OTHER_CHIP: &str = "listener: other chip";

/// The chip that [`OTHER_CHIP`] has.
pub(super) fn other_chip() -> FrontEndConfig {
    on_the_link(FrontEndConfig {
        db_clears_irqs: false,
        target_rearms_by_command: false,
        broken_frame: BrokenFrame::NeverEnds,
        ..FrontEndConfig::st25r3916()
    })
}

/// A list of faults under construction, with the number of the frame that the next one refers to.
struct Script {
    faults: Faults,
    frame: u64,
}

impl Script {
    fn new() -> Self {
        Self { faults: Faults::none(), frame: FIRST }
    }

    /// `fault` from `after` ns behind the present frame's end on, for `lasts` ns.
    fn add(&mut self, fault: Fault, after: i64, lasts: u64) {
        let at = (FRAME_ENDS + self.frame * CYCLE).saturating_add_signed(after);
        let faults = std::mem::take(&mut self.faults);
        self.faults = faults.with(at, at + lasts, fault);
    }
}

/// Returns the runs, each with its name, its faults and its end, ns.
pub(super) fn listener_runs() -> Vec<(String, Faults, u64)> {
    let wrong = WINDOWS.map(|[from, to]| (format!("listener: wrong bytes from {from} µs on"), wrong_bytes(from, to)));
    let others = [
        ("listener: broken bring-up", broken_bring_up()),
        ("listener: late frames", late_frames()),
        (OTHER_CHIP, frames_that_meet()),
    ];
    let others = others.map(|(name, script)| (name.to_owned(), script));
    let all = wrong.into_iter().chain(others);
    all.map(|(name, script)| (name, script.faults, (script.frame + 100) * CYCLE)).collect()
}

fn chip(fault: ChipFault) -> Fault {
    Fault::Chip(Board::Dpr, fault)
}

/// The front end is brought up again within six cycles.
const RECOVERY: u64 = 6;

/// When the driver reads, each from the first instant to the last, µs from a frame's end on: the status at the sync,
/// what has arrived of the frame, the frame's end, the re-arming, and, without a frame, the configuration.
const WINDOWS: [[i64; 2]; 6] = [[-4_665, -4_640], [-580, -560], [-120, -70], [3, 45], [105, 170], [20_130, 20_230]];

fn wrong_bytes(from: i64, to: i64) -> Script {
    let mut script = Script::new();
    for at in from..to {
        for fault in [ChipFault::ReadsOnes, ChipFault::ReadsZeros] {
            if at > 10_000 {
                let lost = AirFaults { lost: 1.0, ..AirFaults::default() };
                script.add(Fault::Air(lost), MS as i64, 25 * MS);
            }
            script.add(chip(fault), at * US as i64, US);
            script.frame += RECOVERY;
        }
    }
    script
}

fn broken_bring_up() -> Script {
    let mut script = Script::new();
    for fault in [ChipFault::ReadsOnes, ChipFault::ReadsZeros, ChipFault::IrqHigh, ChipFault::NoInterrupts] {
        for step in 0..40 {
            script.add(chip(ChipFault::ReadsOnes), 0, MS);
            script.add(chip(fault), 2 * MS as i64 + step * 400 * US as i64, 450 * US);
            script.frame += 2 * RECOVERY;
        }
    }
    script
}

fn late_frames() -> Script {
    let mut script = Script::new();
    let air = |faults| Fault::Air(faults);
    for step in 0..50 {
        let late = 14_700 * US + step * 4 * US;
        let delayed = AirFaults { delayed: 1.0, delay_ns: (late, late), ..AirFaults::default() };
        script.add(air(delayed), MS as i64, 7 * MS);
        script.add(air(AirFaults { lost: 1.0, ..AirFaults::default() }), 8 * MS as i64, 10 * MS);
        script.frame += RECOVERY;
    }
    script
}

fn frames_that_meet() -> Script {
    let mut script = Script::new();
    let again = Fault::FrontEnd(FrontEndFault::FrameAgain(200 * US));
    let air = |faults| Fault::Air(faults);
    script.add(air(AirFaults { truncated: 1.0, ..AirFaults::default() }), MS as i64, 150 * CYCLE);
    script.frame += 150 + RECOVERY;
    for step in 0..24 {
        script.add(air(AirFaults { field_off: true, ..AirFaults::default() }), step * 430 * US as i64, MS);
        script.frame += RECOVERY;
    }
    // The second frame begins while the driver still waits for the first one's end.
    script.add(again.clone(), MS as i64, 150 * CYCLE);
    script.add(chip(ChipFault::NoFrameEnds), MS as i64, 40 * CYCLE);
    script.frame += 40 + RECOVERY;
    for step in 0..16 {
        script.add(chip(ChipFault::IrqLow), -5 * MS as i64 + step * 400 * US as i64, 9 * MS);
        script.frame += RECOVERY;
    }
    // A frame begins just when the driver gives up the frame before.
    for step in 0..60 {
        let again = Fault::FrontEnd(FrontEndFault::FrameAgain(1_100 * US + step * 4 * US));
        script.add(again, MS as i64, 10 * MS);
        script.add(chip(ChipFault::NoFrameEnds), MS as i64, 20 * MS);
        script.frame += RECOVERY;
    }
    script
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_run_of_the_listener_ends_after_its_last_fault() {
        for (name, faults, end) in listener_runs() {
            let last = faults.episodes().iter().map(|episode| episode.until).max().expect(&name);
            assert!(last < end && end < 60_000 * MS, "{name}: {last}, {end}");
        }
    }
}
