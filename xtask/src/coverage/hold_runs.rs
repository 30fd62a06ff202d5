//! The runs whose instructions count for the active hold, each a visit of one failure after the other.
//!
//! | run | what fails |
//! |---|---|
//! | hold: sensors | each sensor is silent, refuses bytes, holds a line, lies, loses its settings; a hot, a cold box |
//! | hold: front end | each failure of the chip, in flight and in the start; flips of its registers; glitches |
//! | hold: tasks | each task is dead, runs although nothing has called it, and executes an undefined instruction |
//! | hold: memory | a cleared register, a stuck bit, a changed guard, a wrong CRC of program or record, a bad stack |
//! | hold: starts | each reason of a reset, a low supply, a dead crystal, a locked debug port |
//!
//! The judge's verdict is not asked for, since several failures meet. Without a hold none of these runs is made.

use bench::faults::hold::Sensor;
use bench::faults::{ChipFault, Fault, Faults, HoldBoardFault, HoldFault, PowerFault, SensorFault};

const MS: u64 = 1_000_000;

/// The vectors of the hold's tasks, and one whose interrupt no task has.
const TASKS: [&str; 8] = [
    "TIMER1",
    "SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0",
    "GPIOTE",
    "TIMER0",
    "SWI0_EGU0",
    "SWI1_EGU1",
    "SWI2_EGU2",
    "POWER_CLOCK",
];

/// The time from one failure of the board to the next: the watchdog resets it after 0.1 s, and it starts.
const BETWEEN: u64 = 350 * MS;

/// The time of a failure of a sensor: each is read once in a second.
const SENSED: u64 = 1_100 * MS;

/// The interrupt controller's register that makes NMI pending by bit 31, and SysTick by bit 26 (ARMv7-M ARM B3.2.4).
const ICSR: u32 = 0xE000_ED04;

/// Application Interrupt and Reset Control, and the value that resets the part (ARMv7-M ARM B3.2.6).
const AIRCR: (u32, u32) = (0xE000_ED0C, 0x05FA_0004);

/// UICR.APPROTECT and FICR.INFO.VARIANT (PS v1.7, 4.5.1.4 and 4.4.1.4).
const APPROTECT: u32 = 0x1000_1208;
const VARIANT: u32 = 0x1000_0104;

/// Registers of peripherals that an upset can clear, and tasks of the timers (PS v1.7, 6.25, 6.31, 6.23, 6.10, 6.30).
const SPIM0_ENABLE: u32 = 0x4000_3500;
const TWIM1_ENABLE: u32 = 0x4000_4500;
const SAADC_ENABLE: u32 = 0x4000_7500;
const SAADC_PSELP: u32 = 0x4000_7510;
const GPIOTE_CONFIG: u32 = 0x4000_6510;
const TIMER0_STOP: u32 = 0x4000_8004;
const TIMER1_STOP: u32 = 0x4000_9004;

/// A list of faults under construction, with the instant of the next one.
struct Script {
    faults: Faults,
    at: u64,
}

impl Script {
    fn new() -> Self {
        Self { faults: Faults::none(), at: 1_000 * MS }
    }

    /// `fault` for `lasts` ns; then `rest` ns without it.
    fn visit(&mut self, fault: HoldFault, lasts: u64, rest: u64) {
        self.add(fault, lasts);
        self.at += lasts + rest;
    }

    /// `fault` from the present instant on, for `lasts` ns.
    fn add(&mut self, fault: HoldFault, lasts: u64) {
        let faults = std::mem::take(&mut self.faults);
        self.faults = faults.with(self.at, self.at + lasts, Fault::Hold(fault));
    }

    fn board(&mut self, fault: HoldBoardFault, lasts: u64, rest: u64) {
        self.visit(HoldFault::Board(fault), lasts, rest);
    }

    /// `fault` for [`BETWEEN`], in which the reset pin starts the hold anew.
    fn board_at_a_start(&mut self, fault: HoldFault) {
        self.add(fault, BETWEEN);
        self.at += MS;
        self.visit(HoldFault::Power(PowerFault::Pin), 0, 2 * BETWEEN);
    }
}

/// Returns the runs, each with its name, its faults and its end, ns.
pub(super) fn hold_runs() -> Vec<(&'static str, Faults, u64)> {
    let scripts = [
        ("sensors", sensors()),
        ("front end", front_end()),
        ("tasks", tasks()),
        ("memory", memory()),
        ("starts", starts()),
    ];
    scripts.into_iter().map(|(name, script)| (name, script.faults, script.at + BETWEEN)).collect()
}

fn sensors() -> Script {
    let mut script = Script::new();
    script.at += SENSED;
    for sensor in [Sensor::Climate, Sensor::Vibration] {
        script.visit(HoldFault::Silent(sensor), SENSED, 0);
        script.visit(HoldFault::Lies(sensor, 1), SENSED, 0);
        script.visit(HoldFault::Sensors(SensorFault::Refuses(sensor)), SENSED, 0);
        script.visit(HoldFault::Sensors(SensorFault::HoldsScl(sensor)), SENSED, 0);
    }
    // The recovery of the bus has nine clocks.
    for clocks in [4, 9, 40] {
        script.visit(HoldFault::Sensors(SensorFault::HoldsSda(clocks)), SENSED, 0);
    }
    // A temperature is kept for some seconds after its sensor has failed, and then is gone.
    script.visit(HoldFault::BusStuck, 6 * SENSED, 2 * SENSED);
    for fault in [SensorFault::Numb, SensorFault::Restart, SensorFault::Shaken] {
        script.visit(HoldFault::Sensors(fault), SENSED, SENSED);
    }
    // The samples are read after one pause, the set-up at a start takes some forty addresses.
    for nth in 0..4 {
        script.visit(HoldFault::Sensors(SensorFault::Deaf(nth)), SENSED, SENSED);
    }
    for nth in 0..48 {
        script.add(HoldFault::Sensors(SensorFault::Deaf(nth)), 100 * MS);
        script.visit(HoldFault::Power(PowerFault::Pin), 0, 100 * MS);
    }
    for celsius in [130, 60, -20, 20] {
        script.visit(HoldFault::Sensors(SensorFault::Celsius(celsius)), 2 * SENSED, 0);
    }
    script
}

fn front_end() -> Script {
    let mut script = Script::new();
    for fault in ChipFault::ALL {
        let fault = HoldFault::Board(HoldBoardFault::Chip(fault));
        script.visit(fault, BETWEEN, BETWEEN);
        script.board_at_a_start(fault);
    }
    // The chip fails, and works again, at each step of the start.
    for fault in [ChipFault::ReadsOnes, ChipFault::ReadsZeros, ChipFault::IrqHigh, ChipFault::NoInterrupts] {
        for step in 0..32 {
            script.visit(HoldFault::Power(PowerFault::Pin), 0, 15 * MS + step * 1_300_000);
            script.board(HoldBoardFault::Chip(fault), 3 * MS, 40 * MS);
        }
    }
    script.visit(HoldFault::Power(PowerFault::FrontEndOff), BETWEEN, BETWEEN);
    script.board(HoldBoardFault::Chip(ChipFault::Glitches(1)), 4_000 * MS, BETWEEN);
    // The number of bits has no divisor in common with the step, so the flips are spread over all registers.
    for place in 0..40 {
        script.board(HoldBoardFault::Flip(place * 37), 0, 60 * MS);
    }
    script
}

fn tasks() -> Script {
    let mut script = Script::new();
    for vector in TASKS {
        script.board(HoldBoardFault::Dead(vector), 0, BETWEEN);
        script.board(HoldBoardFault::Spurious(vector), 0, BETWEEN);
        script.board(HoldBoardFault::Faulting(vector), 60 * MS, BETWEEN);
    }
    // NMI, and an exception that no task has, in the idle loop and beside a fault's handler that faults itself.
    for bit in [31, 26] {
        script.board(HoldBoardFault::Poke(ICSR, 1 << bit), 0, BETWEEN);
    }
    script.add(HoldFault::Board(HoldBoardFault::Faulting("HardFault")), 60 * MS);
    script.board(HoldBoardFault::Faulting("TIMER1"), 60 * MS, BETWEEN);
    // The idle loop has its stack where no memory is, and executes from RAM.
    for (register, value) in [(13, 0x1FFF_FF00), (13, 0x2004_0100), (15, 0x2000_1000), (15, 0x9000_0000)] {
        script.board(HoldBoardFault::Core(register, value), 0, BETWEEN);
    }
    script
}

fn memory() -> Script {
    let mut script = Script::new();
    for register in [SPIM0_ENABLE, TWIM1_ENABLE, SAADC_ENABLE, SAADC_PSELP, GPIOTE_CONFIG] {
        script.board(HoldBoardFault::Poke(register, 0), 0, BETWEEN);
        script.visit(HoldFault::Power(PowerFault::Pin), 0, BETWEEN);
    }
    for task in [TIMER0_STOP, TIMER1_STOP] {
        script.board(HoldBoardFault::Poke(task, 1), 0, 2 * BETWEEN);
    }
    // The patrol needs some seconds for all of the memory.
    let found = 5_500 * MS;
    // The test at the start handles each word of a block of 32 bytes by instructions of its own.
    let words = (0..8).map(|word| ("__rtic_internal_local_init_radio", 32 + 4 * word));
    for (variable, offset) in words.chain([("hw::KEPT", 0), ("hw::KEPT", 4)]) {
        for value in [false, true] {
            script.add(HoldFault::Board(HoldBoardFault::Stuck(variable, offset, value)), 60 * MS);
            script.visit(HoldFault::Power(PowerFault::Pin), 0, 120 * MS);
        }
    }
    script.board(HoldBoardFault::Stuck("hw::KEPT", 0, true), found, 0);
    script.board(HoldBoardFault::Word("__guard_bss", 0, 0), 0, found);
    script.board(HoldBoardFault::Word("__guard_end", 0, 0), 0, BETWEEN);
    script.board(HoldBoardFault::Word("__program_crc", 0, 0), found, BETWEEN);
    script.board_at_a_start(HoldFault::Board(HoldBoardFault::Word("__program_crc", 0, 0)));
    // The newer record, or the older one, is worthless at a start.
    for offset in [0, 24, 0, 24] {
        script.at += 1_500 * MS;
        script.board_at_a_start(HoldFault::Board(HoldBoardFault::Word("hw::KEPT", offset, 0)));
    }
    script
}

fn starts() -> Script {
    let mut script = Script::new();
    for _ in 0..6 {
        script.visit(HoldFault::Power(PowerFault::Pin), 0, 1_200 * MS);
    }
    for fault in [PowerFault::BrownOut, PowerFault::Watchdog, PowerFault::Off(1)] {
        script.visit(HoldFault::Power(fault), 50 * MS, BETWEEN);
    }
    script.board(HoldBoardFault::Poke(AIRCR.0, AIRCR.1), 0, BETWEEN);
    for microvolts in [3_600_000, 2_880_000, 2_620_000, 1_650_000] {
        script.board(HoldBoardFault::Supply(microvolts), BETWEEN, BETWEEN);
    }
    script.board_at_a_start(HoldFault::Board(HoldBoardFault::Supply(2_620_000)));
    script.board_at_a_start(HoldFault::Power(PowerFault::CrystalDead));
    for (address, value) in [(APPROTECT, 0xFFFF_FF00), (VARIANT, 0x4141_4141)] {
        script.board_at_a_start(HoldFault::Board(HoldBoardFault::Poke(address, value)));
    }
    script
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_run_of_the_hold_ends_after_its_last_fault() {
        for (name, faults, end) in hold_runs() {
            let last = faults.episodes().iter().map(|episode| episode.until).max().expect(name);
            assert!(last < end && end < 60_000 * MS, "{name}: {last}, {end}");
        }
    }
}
