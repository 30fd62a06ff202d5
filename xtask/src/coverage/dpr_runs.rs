//! Runs in which a front end of the DPR fails at each transfer, and in which frames meet what the driver does.
//!
//! | run | what fails |
//! |---|---|
//! | listener: wrong bytes | one byte after the other that the DPR reads from the chip has only ones, or only zeros; |
//! | | each step of a bring-up; frames that begin while the driver checks a silent chip |
//! | listener: other chip | the older chip, which resolves contradictions of its data sheet otherwise: a listener |
//! | | receives frames without a command, a broken frame never ends, and clearing the FIFO keeps interrupts |
//! | listener: second port | the chip to which the hold speaks, as in the first run and by each of its own failures |
//! | dpr: memory | each word of the receive buffers has a stuck bit, each word of the task that receives a flipped |
//! | | one; then the program no longer fits its CRC |
//!
//! The judge's verdict is not asked for, since several failures meet.

use bench::faults::{
    AirFaults, Board, BufferFault, Buffers, ChipFault, Conduct, Fault, Faults, FrontEndFault, HoldFault, ImageFault,
    PowerFault, Upset, tasks_of,
};
use bench::sim::{BrokenFrame, FrontEndConfig, on_the_link};

use super::run::Addresses;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// Frames that come at equal distances on the bench.
#[derive(Clone, Copy)]
struct Frames {
    /// The end of one of the first frames, ns.
    end: u64,
    /// The time from one to the next, ns.
    apart: u64,
}

/// HORUS's frames in a profile of three receivers. HORUS's crystal is fast.
const HORUS: Frames = Frames { end: 333_948_000, apart: 9_999_914 };

/// The hold's frames.
const HOLD: Frames = Frames { end: 436_670_500, apart: 99_998_500 };

/// The number of frames of HORUS after which a front end works again.
const RECOVERY: u64 = 4;

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

/// A list of faults under construction.
struct Script {
    faults: Faults,
    frames: Frames,
    /// The number of the frame that the next fault refers to.
    frame: u64,
    /// Makes a fault of the chip that receives the frames.
    chip: fn(ChipFault) -> Fault,
}

impl Script {
    fn of_horus() -> Self {
        Self { faults: Faults::none(), frames: HORUS, frame: 0, chip: |fault| Fault::Chip(Board::Dpr, fault) }
    }

    fn of_hold() -> Self {
        Self { faults: Faults::none(), frames: HOLD, frame: 0, chip: |fault| Fault::Hold(HoldFault::Port(fault)) }
    }

    /// The end of the present frame, ns.
    fn end(&self) -> u64 {
        self.frames.end + self.frame * self.frames.apart
    }

    /// `fault` from `after` ns behind the present frame's end on, for `lasts` ns.
    fn add(&mut self, fault: Fault, after: i64, lasts: u64) {
        let at = self.end().saturating_add_signed(after);
        let faults = std::mem::take(&mut self.faults);
        self.faults = faults.with(at, at + lasts, fault);
    }

    fn chip(&mut self, fault: ChipFault, after: i64, lasts: u64) {
        self.add((self.chip)(fault), after, lasts);
    }

    fn air(&mut self, faults: AirFaults, after: i64, lasts: u64) {
        self.add(Fault::Air(faults), after, lasts);
    }

    /// A bit of the images flips in each of `count` cycles.
    fn image_flips(&mut self, count: u64) {
        for nth in 0..count {
            let flip = BufferFault::Flips(Buffers::Image, 8 * (nth * 37) + nth % 8);
            self.add(Fault::Buffer(flip), 3 * MS as i64, 0);
            self.frame += 1;
        }
    }

    /// `fault` from the first frame on to the present one.
    fn throughout(&mut self, fault: HoldFault) {
        let faults = std::mem::take(&mut self.faults);
        self.faults = faults.with(self.frames.end, self.end(), Fault::Hold(fault));
    }

    /// What the driver reads is wrong for `step` µs, at each `step` from `from` to `to` µs behind a frame's end.
    fn wrong_bytes(&mut self, [from, to, step]: [i64; 3], recovery: u64) {
        for at in (from..to).step_by(step as usize) {
            for fault in [ChipFault::ReadsOnes, ChipFault::ReadsZeros] {
                self.chip(fault, at * US as i64, step as u64 * US);
                self.frame += recovery;
            }
        }
    }

    /// Two failures, the second of which meets each step of the bring-up after the first.
    fn broken_bring_up(&mut self, faults: &[ChipFault], recovery: u64) {
        for &fault in faults {
            for step in 0..20 {
                self.chip(ChipFault::ReadsOnes, 0, MS);
                self.chip(fault, 2 * MS as i64 + step * 800 * US as i64, 850 * US);
                self.frame += recovery;
            }
        }
    }
}

/// Returns the runs, each with its name, its faults and its end, ns.
pub(super) fn dpr_runs(addresses: &Addresses, hold: bool) -> Vec<(&'static str, Faults, u64)> {
    let mut scripts = vec![
        ("listener: wrong bytes", wrong_bytes()),
        (OTHER_CHIP, frames_that_meet()),
        ("dpr: memory", memory(addresses)),
    ];
    if hold {
        // What the hold and the second port exchange breaks off, or meets its own repetition.
        scripts[0].1.throughout(HoldFault::Answers(AirFaults { truncated: 1.0, ..AirFaults::default() }));
        let repeat_after_ns = (0, 4 * MS);
        let again = AirFaults { repeated: 1.0, repeat_after_ns, ..AirFaults::default() };
        scripts[1].1.throughout(HoldFault::Frames(again));
        scripts.push(("listener: second port", second_port()));
    }
    let run = |(name, script): (_, Script)| {
        let end = script.end() + 300 * MS;
        (name, script.faults, end)
    };
    scripts.into_iter().map(run).collect()
}

fn wrong_bytes() -> Script {
    let mut script = Script::of_horus();
    // The last read while a frame arrives, the frame's end, and the re-arming.
    for window in [[-120, -70, 1], [3, 25, 1], [25, 105, 5], [105, 170, 3], [170, 260, 5]] {
        script.wrong_bytes(window, RECOVERY);
    }
    let lost = AirFaults { lost: 1.0, ..AirFaults::default() };
    // The check of the configuration after two cycles without a frame.
    for at in (20_130..20_230).step_by(6) {
        for fault in [ChipFault::ReadsOnes, ChipFault::ReadsZeros] {
            script.air(lost, MS as i64, 20 * MS);
            script.chip(fault, at * US as i64, 6 * US);
            script.frame += 2 + RECOVERY;
        }
    }
    let all = [ChipFault::ReadsOnes, ChipFault::ReadsZeros, ChipFault::IrqHigh, ChipFault::NoInterrupts];
    script.broken_bring_up(&all, 2 * RECOVERY);
    // The number of bytes is 0 in the status before the first read of a frame.
    for at in -4_345..-4_300 {
        script.chip(ChipFault::ReadsZeros, at * US as i64, US);
        script.frame += RECOVERY;
    }
    // The sync of a frame is noticed late, so the first read takes more bytes: 19 µs each.
    for late in 0..50 {
        script.chip(ChipFault::IrqLow, -4_700 * US as i64, (60 + 19 * late) * US);
        script.frame += 2;
    }
    failures_without_a_frame(&mut script);
    // Every object of a frame is damaged.
    script.air(AirFaults { bit_error: 5e-3, ..AirFaults::default() }, MS as i64, 30 * HORUS.apart);
    script.frame += 30 + RECOVERY;
    // Silence without a field.
    script.air(AirFaults { field_off: true, ..AirFaults::default() }, MS as i64, 70 * HORUS.apart);
    script.frame += 70 + RECOVERY;
    // What the status shows after a time without interrupts: a frame that broke off, and a field that went on and off.
    let field_off = AirFaults { field_off: true, ..AirFaults::default() };
    for step in 0..6 {
        script.chip(ChipFault::IrqLow, 4 * MS as i64, 24 * MS);
        script.air(field_off, 7 * MS as i64 + step * 3 * US as i64, 30 * MS);
        script.frame += 2 * RECOVERY;
    }
    for step in 0..4 {
        script.air(field_off, 0, 60 * MS + step * 3 * MS);
        script.chip(ChipFault::IrqLow, (59 + 3 * step as i64) * MS as i64, 4 * MS);
        script.air(field_off, (62 + 3 * step as i64) * MS as i64, 60 * MS);
        script.frame += 5 * RECOVERY;
    }
    for step in 0..25 {
        let late = 14_700 * US + step * 8 * US;
        let delayed = AirFaults { delayed: 1.0, delay_ns: (late, late), ..AirFaults::default() };
        script.air(delayed, MS as i64, 7 * MS);
        script.air(lost, 8 * MS as i64, 10 * MS);
        script.frame += RECOVERY;
    }
    script
}

/// Each failure nine times in a row, without a frame: the driver counts seven.
fn failures_without_a_frame(script: &mut Script) {
    const TIMES: u64 = 9;
    // A bit of the register of the mode, which is checked without frames, and one of a setting.
    let flips = [26, 60].map(|place| (Fault::Flip(Board::Dpr, place), 0));
    let reset = Fault::Power(Board::Dpr, PowerFault::FrontEndOff);
    let irq = (script.chip)(ChipFault::IrqHigh);
    // A setting is read back once in 0.25 s, the back-off takes up to 64 ms.
    for ((fault, lasts), each) in flips.into_iter().chain([(reset, MS), (irq, MS)]).zip([12, 32, 12, 12]) {
        let lost = AirFaults { lost: 1.0, ..AirFaults::default() };
        script.air(lost, MS as i64, TIMES * each * script.frames.apart);
        for _ in 0..TIMES {
            script.frame += each;
            script.add(fault.clone(), 0, lasts);
        }
        script.frame += 3 * RECOVERY;
    }
}

fn frames_that_meet() -> Script {
    let mut script = Script::of_horus();
    script.air(AirFaults { truncated: 1.0, ..AirFaults::default() }, MS as i64, 60 * HORUS.apart);
    script.frame += 60 + RECOVERY;
    for step in 0..24 {
        script.air(AirFaults { field_off: true, ..AirFaults::default() }, step * 430 * US as i64, MS);
        script.frame += RECOVERY;
    }
    // A second frame begins while the driver still waits for the first one's end.
    let again = |after| Fault::FrontEnd(FrontEndFault::FrameAgain(after));
    script.add(again(200 * US), MS as i64, 100 * HORUS.apart);
    script.chip(ChipFault::NoFrameEnds, MS as i64, 20 * HORUS.apart);
    script.frame += 20 + RECOVERY;
    for step in 0..16 {
        script.chip(ChipFault::IrqLow, -5 * MS as i64 + step * 400 * US as i64, 9 * MS);
        script.frame += RECOVERY;
    }
    // A frame begins just when the driver gives up the frame before.
    script.frame += RECOVERY + 12;
    for step in 0..60 {
        script.add(again(1_100 * US + step * 4 * US), MS as i64, 10 * MS);
        script.chip(ChipFault::NoFrameEnds, MS as i64, 20 * MS);
        script.frame += RECOVERY;
    }
    script
}

fn second_port() -> Script {
    let mut script = Script::of_hold();
    for fault in ChipFault::ALL {
        script.chip(fault, MS as i64, 250 * MS);
        script.frame += 5;
    }
    script.broken_bring_up(&[ChipFault::ReadsZeros, ChipFault::NoInterrupts], 1);
    // A bit is stuck in each buffer at a start, and then in flight: the first is taken out of use.
    for (nth, starts) in [(0, true), (1, true), (2, true), (0, false), (1, false), (2, false)] {
        if !starts && nth == 0 {
            // All buffers are in use again.
            script.add(Fault::Power(Board::Dpr, PowerFault::Pin), 0, 0);
            script.frame += 3;
        }
        let stuck = BufferFault::Stuck(Buffers::HoldReceive, true, 8 * (nth * 4 * WORDS + 20));
        script.add(Fault::Buffer(stuck), 0, 290 * MS);
        if starts {
            script.add(Fault::Power(Board::Dpr, PowerFault::Pin), MS as i64, 0);
        }
        script.frame += 3;
    }
    // A frame's end and the answer's preparation, the answer's end and the re-arming.
    for window in [[3, 243, 6], [4_635, 4_755, 6]] {
        script.wrong_bytes(window, 1);
    }
    script
}

/// The words of a receive buffer.
const WORDS: u64 = 65;

fn memory(addresses: &Addresses) -> Script {
    let mut script = Script::of_horus();
    // The flight controller asks for self-tests, which find the wrong CRC.
    let wrong = ImageFault::Patch { address: addresses.crcs[1], bytes: vec![0; 4], sealed: false };
    script.add(Fault::Image(Board::Dpr, wrong), 0, 900 * HORUS.apart);
    script.add(Fault::FlightController(Conduct::WritesEach), 0, 940 * HORUS.apart);
    script.frame += 950;
    // An image expires in a transaction, while the tasks that publish are dead. The watchdog restarts the DPR.
    for step in 0..3 {
        script.add(Fault::FlightController(Conduct::TenThousand), 0, 40 * HORUS.apart);
        for (task, (name, _)) in (0..).zip(tasks_of(Board::Dpr)) {
            if ["commit", "deadline"].contains(name) {
                script.add(Fault::DeadTask(Board::Dpr, task), (20 + step * 3) * MS as i64, 0);
            }
        }
        script.frame += 70;
    }
    // Images are damaged while no receive buffer is.
    script.image_flips(30);
    // A bit is stuck in each other buffer at a start than in the first.
    for (buffers, nth, size) in
        [(Buffers::Receive, 1, 260), (Buffers::Receive, 2, 260), (Buffers::Written, 1, 80), (Buffers::Written, 2, 80)]
    {
        let stuck = BufferFault::Stuck(buffers, true, 8 * (nth * size + 21));
        script.add(Fault::Buffer(stuck), 0, 20 * HORUS.apart);
        script.add(Fault::Power(Board::Dpr, PowerFault::Pin), MS as i64, 0);
        script.frame += 30;
    }
    // Short transactions, more than the port task can take.
    script.add(Fault::FlightController(Conduct::Every { bytes: 9, period_ns: 98 * US }), 0, 30 * HORUS.apart);
    script.frame += 40;
    script.image_flips(60);
    // The first buffer with a stuck bit is taken out of use, and the others stay.
    for word in [0].into_iter().chain((0..WORDS).map(|word| WORDS + word)) {
        let bit = 8 * 4 * word + word % 32;
        script.add(Fault::Buffer(BufferFault::Stuck(Buffers::Receive, true, bit)), 0, 3 * HORUS.apart);
        script.frame += 3;
    }
    // The front end fails while a stuck bit is known.
    script.chip(ChipFault::ReadsOnes, 0, 20 * MS);
    script.frame += 2 * RECOVERY;
    // A flip within a frame, behind its first read. The watchdog restarts the DPR if it stops.
    let [from, to] = addresses.receiver;
    for address in (from..to).step_by(4).rev() {
        script.add(Fault::Upset(Board::Dpr, Upset::Ram { address, bit: 1 }), -3 * MS as i64, 0);
        script.frame += RECOVERY;
    }
    // The clocks differ by more than a crystal can, over more than a window of their comparison.
    script.add(Fault::Drift(Board::Horus, 25_000_000), 100 * HORUS.apart as i64, 250 * HORUS.apart);
    script.frame += 400;
    // Short transactions while the port task is dead, until no area is clean. The watchdog restarts the DPR.
    script.add(Fault::FlightController(Conduct::Every { bytes: 9, period_ns: 98 * US }), 0, 30 * HORUS.apart);
    for (task, (name, _)) in (0..).zip(tasks_of(Board::Dpr)) {
        if *name == "port" {
            script.add(Fault::DeadTask(Board::Dpr, task), 10 * MS as i64, 0);
        }
    }
    script.frame += 70;
    script
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_run_of_the_dpr_ends_after_its_last_fault() {
        for (name, faults, end) in dpr_runs(&Addresses::EXAMPLE, true) {
            let last = faults.episodes().iter().map(|episode| episode.until).max().expect(name);
            assert!(last < end && end < 60_000 * MS, "{name}: {last}, {end}");
        }
    }
}
