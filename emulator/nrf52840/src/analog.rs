//! SAADC (PS 6.23), and COMP and LPCOMP, which share a block (PS 6.5, 6.13).
//!
//! | covered | PS |
//! |---|---|
//! | SAADC: START, SAMPLE, STOP, CALIBRATEOFFSET with their events; limits; EasyDMA of 16-bit results | 6.23 |
//! | SAADC: single-ended and differential, gain, reference, resolution, acquisition time, oversampling, burst | 6.23 |
//! | SAADC: the internal timer of SAMPLERATE | 6.23 |
//! | COMP, LPCOMP: START, STOP, SAMPLE, READY, UP, DOWN, CROSS, RESULT, and their shortcuts | 6.5, 6.13 |
//!
//! | left out | why |
//! |---|---|
//! | the resistor ladder, noise, offset and settling of the SAADC | the model reads the exact voltage |
//! | the instant of each channel in a scan | all channels are converted and reported at the scan's end |
//! | hysteresis of COMP and LPCOMP, current source, LPCOMP as a wake-up from System OFF | a finding where it is set |
//!
//! A running comparator compares its input every [`LOOK`] cycles. The part compares all the time.
use crate::clocks::{Clocks, cycles};
use crate::instance::{Act, Block, Cx, Instance, index};
use crate::pin::Pin;
use emulator_part::Cycle;

/// The pin of AIN0 to AIN7 (PS 7.1): P0.02 to P0.05 and P0.28 to P0.31.
fn analog_input(n: u32) -> Option<Pin> {
    match n {
        0..=3 => Some(Pin::of(0, 2 + n)),
        4..=7 => Some(Pin::of(0, 24 + n)),
        _ => None,
    }
}

const STARTED: u32 = 0;
const END: u32 = 1;
const DONE: u32 = 2;
const RESULTDONE: u32 = 3;
const CALIBRATEDONE: u32 = 4;
const STOPPED: u32 = 5;
const LIMITH: u32 = 6;

/// The cycles of a conversion after acquisition (PS 6.23: tCONV, 2 µs at most).
const CONVERSION: u64 = cycles(2_000);
const CALIBRATION: u64 = cycles(100_000);

type Channel = [u32; 4];

#[derive(Clone, Debug)]
pub(crate) struct Saadc {
    block: Block,
    supply: i32,
    enable: u32,
    channels: [Channel; 8],
    resolution: u32,
    oversample: u32,
    samplerate: u32,
    result: [u32; 3],
    /// The address for the next result, and the number of results that still fit; `None` while no buffer is started.
    buffer: Option<(u32, u32)>,
    /// The number of samples taken for an oversampled result, and the sum of these samples.
    taken: (u32, i64),
    converts_at: Option<Cycle>,
    calibrated_at: Option<Cycle>,
    timed: bool,
}

impl Saadc {
    pub(crate) fn new(supply_microvolts: i32) -> Self {
        Self {
            block: Block::default(),
            supply: supply_microvolts,
            enable: 0,
            channels: [[0, 0, 0x0002_0000, 0x7FFF_8000]; 8],
            resolution: 1,
            oversample: 0,
            samplerate: 0,
            result: [0; 3],
            buffer: None,
            taken: (0, 0),
            converts_at: None,
            calibrated_at: None,
            timed: false,
        }
    }

    fn sample(&mut self, cx: &mut Cx<'_>) {
        if self.enable & 1 == 0 || self.buffer.is_none() {
            cx.misuse("SAMPLE without ENABLE or START; ENABLE", self.enable);
            return;
        }
        if self.converts_at.is_some() {
            cx.misuse("SAMPLE while a conversion is under way", 0);
            return;
        }
        let mut time = 0;
        for [positive, _, config, _] in self.channels {
            if positive & 0x1F == 0 {
                continue;
            }
            let acquisition = [3_000, 5_000, 10_000, 15_000, 20_000, 40_000, 40_000, 40_000][config as usize >> 16 & 7];
            let turns = if config >> 24 & 1 != 0 { 1 << self.oversample } else { 1 };
            time += (cycles(acquisition) + CONVERSION) * turns;
        }
        if time == 0 {
            cx.misuse("SAMPLE with no channel connected", 0);
            return;
        }
        self.converts_at = Some(cx.now + time);
    }

    /// The voltage at the input that a PSEL register selects, in microvolts.
    fn volts(&self, psel: u32, input: &impl Fn(Pin) -> i32) -> i64 {
        i64::from(match psel & 0x1F {
            0 => 0,
            9 => self.supply,
            // VDDHDIV5 is a fifth of VDDH, which in this model equals VDD.
            0xD => self.supply / 5,
            n => analog_input(n - 1).map_or(0, input),
        })
    }

    pub(crate) fn convert(&mut self, input: impl Fn(Pin) -> i32, cx: &mut Cx<'_>) {
        let bits = 8 + 2 * self.resolution.min(3);
        for (n, [positive, negative, config, limit]) in (0_u32..).zip(self.channels) {
            if positive & 0x1F == 0 {
                continue;
            }
            let differential = config >> 20 & 1 != 0;
            let mut volts = self.volts(positive, &input);
            if differential {
                volts -= self.volts(negative, &input);
            }
            let reference = if config >> 12 & 1 != 0 { i64::from(self.supply) / 4 } else { 600_000 };
            let (gain, part) =
                [(1, 6), (1, 5), (1, 4), (1, 3), (1, 2), (1, 1), (2, 1), (4, 1)][config as usize >> 8 & 7];
            let full = 1_i64 << (bits - u32::from(differential));
            let exact = (volts * gain * full).div_euclid((reference * part).max(1));
            let value = exact.clamp(if differential { -full } else { 0 }, full - 1);
            self.block.raise(DONE, cx);
            let burst = config >> 24 & 1 != 0;
            if self.oversample != 0 && !burst {
                self.taken = (self.taken.0 + 1, self.taken.1 + value);
                if self.taken.0 < 1 << self.oversample {
                    continue;
                }
                let sum = std::mem::take(&mut self.taken).1;
                self.report(n, sum >> self.oversample, limit, cx);
            } else {
                self.report(n, value, limit, cx);
            }
        }
    }

    fn report(&mut self, channel: u32, value: i64, limit: u32, cx: &mut Cx<'_>) {
        self.block.raise(RESULTDONE, cx);
        if value > i64::from((limit >> 16) as i16) {
            self.block.raise(LIMITH + 2 * channel, cx);
        }
        if value < i64::from(limit as i16) {
            self.block.raise(LIMITH + 1 + 2 * channel, cx);
        }
        let Some((address, left)) = self.buffer else {
            return;
        };
        for (n, byte) in (0..).zip((value as i16).to_le_bytes()) {
            cx.dma_write(address.wrapping_add(n), byte);
        }
        self.result[2] += 1;
        self.buffer = (left > 1).then_some((address.wrapping_add(2), left - 1));
        if self.buffer.is_none() {
            self.block.raise(END, cx);
        }
    }
}

impl Instance for Saadc {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 => {
                if self.enable & 1 == 0 {
                    cx.misuse("START while it is not enabled", 0);
                    return true;
                }
                self.result[2] = 0;
                self.buffer = (self.result[1] != 0).then_some((self.result[0], self.result[1]));
                self.block.raise(STARTED, cx);
            }
            0x004 => {
                self.timed = self.samplerate >> 12 & 1 != 0;
                self.sample(cx);
            }
            0x008 => {
                (self.buffer, self.converts_at, self.timed) = (None, None, false);
                self.block.raise(STOPPED, cx);
            }
            0x00C => self.calibrated_at = Some(cx.now + CALIBRATION),
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x400 => u32::from(self.converts_at.is_some()),
            0x500 => self.enable,
            0x5F0 => self.resolution,
            0x5F4 => self.oversample,
            0x5F8 => self.samplerate,
            0x62C..=0x634 => self.result[(offset as usize - 0x62C) / 4],
            _ => {
                let n = index(offset, 0x510, 4, 32)?;
                self.channels[n / 4][n % 4]
            }
        })
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        match offset {
            0x400 | 0x634 => {}
            0x500 => self.enable = value & 1,
            0x5F0 => self.resolution = value & 7,
            0x5F4 => self.oversample = value & 0xF,
            0x5F8 => self.samplerate = value & 0x17FF,
            0x62C => self.result[0] = value,
            0x630 => self.result[1] = value & 0x7FFF,
            _ => {
                let Some(n) = index(offset, 0x510, 4, 32) else {
                    return false;
                };
                self.channels[n / 4][n % 4] = value;
            }
        }
        true
    }

    fn next(&self) -> Option<Cycle> {
        [self.converts_at, self.calibrated_at].into_iter().flatten().min()
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        let now = cx.now;
        if self.calibrated_at.take_if(|at| *at <= now).is_some() {
            self.block.raise(CALIBRATEDONE, cx);
        }
        if self.converts_at.take_if(|at| *at <= now).is_some() {
            cx.act(Act::Convert);
            if self.timed && self.buffer.is_some() {
                // CC gives the period in cycles of 16 MHz. The period is at least one conversion.
                let period = u64::from(self.samplerate & 0x7FF) * crate::clocks::CYCLES_PER_TICK;
                self.converts_at = Some(now + period.max(CONVERSION));
            }
        }
    }

    fn moves(&self) -> bool {
        self.converts_at.is_some()
    }
}

/// The cycles between two comparisons: 10 µs.
const LOOK: u64 = cycles(10_000);
/// The cycles from START to READY (PS 6.5: tINT_REF.START, 50 µs typical; PS 6.13: 140 µs).
const COMP_START: u64 = cycles(50_000);
const LPCOMP_START: u64 = cycles(140_000);

/// The hysteresis in microvolts, between the two thresholds (PS 6.5: VDIFFHYST, 30 mV; PS 6.13: HYST, 50 mV).
const COMP_HYSTERESIS: i64 = 30_000;
const LPCOMP_HYSTERESIS: i64 = 50_000;

const READY: u32 = 0;
const DOWN: u32 = 1;
const UP: u32 = 2;
const CROSS: u32 = 3;

#[derive(Clone, Debug)]
pub(crate) struct Comparator {
    block: Block,
    supply: i32,
    enable: u32,
    plain: [(u32, u32); 8],
    result: u32,
    above: bool,
    ready_at: Option<Cycle>,
    look_at: Option<Cycle>,
}

impl Comparator {
    pub(crate) fn new(supply_microvolts: i32) -> Self {
        Self {
            block: Block::default(),
            supply: supply_microvolts,
            enable: 0,
            plain: [(0x504, 0), (0x508, 4), (0x50C, 0), (0x520, 0), (0x530, 0), (0x534, 0), (0x538, 0), (0x53C, 0)],
            result: 0,
            above: false,
            ready_at: None,
            look_at: None,
        }
    }

    fn plain(&self, offset: u32) -> u32 {
        self.plain.iter().find(|(at, _)| *at == offset).map_or(0, |(_, value)| *value)
    }

    /// The thresholds of a rising and of a falling input, in microvolts.
    fn thresholds(&self, input: &impl Fn(Pin) -> i32) -> (i64, i64) {
        let (supply, select) = (i64::from(self.supply), self.plain(0x508) & 0xF);
        let external = || analog_input(self.plain(0x50C) & 7).map_or(0, |pin| i64::from(input(pin)));
        if self.enable == 1 {
            // LPCOMP's references: eighths or odd sixteenths of the supply, or an external reference.
            let threshold = match select {
                0..=6 => supply * (i64::from(select) + 1) / 8,
                7 => external(),
                n => supply * (2 * i64::from(n - 8) + 1) / 16,
            };
            let half = if self.plain(0x538) & 1 != 0 { LPCOMP_HYSTERESIS / 2 } else { 0 };
            return (threshold + half, threshold - half);
        }
        let reference = match select {
            0 => 1_200_000,
            1 => 1_800_000,
            2 => 2_400_000,
            4 => supply,
            _ => external(),
        };
        if self.plain(0x534) >> 8 & 1 != 0 {
            // In differential mode the threshold is the reference itself. In single-ended mode TH.UP and TH.DOWN set
            // the hysteresis.
            let half = if self.plain(0x538) & 1 != 0 { COMP_HYSTERESIS / 2 } else { 0 };
            return (reference + half, reference - half);
        }
        let threshold = |field: u32| reference * (i64::from(field & 0x3F) + 1) / 64;
        (threshold(self.plain(0x530) >> 8), threshold(self.plain(0x530)))
    }

    pub(crate) fn look(&mut self, input: impl Fn(Pin) -> i32, cx: &mut Cx<'_>) {
        let volts = analog_input(self.plain(0x504) & 7).map_or(0, |pin| i64::from(input(pin)));
        let (up, down) = self.thresholds(&input);
        let was = self.above;
        self.above = if was { volts >= down } else { volts > up };
        if self.ready_at.take_if(|at| *at <= cx.now).is_some() {
            self.block.raise(READY, cx);
            self.stop_by(0, 1, cx);
        } else if was != self.above {
            let (event, stops) = if self.above { (UP, 3) } else { (DOWN, 2) };
            self.block.raise(event, cx);
            self.block.raise(CROSS, cx);
            if self.block.short(stops) || self.block.short(4) {
                self.look_at = None;
            }
        }
    }

    /// Whether the comparator works in System OFF: LPCOMP does, COMP does not (PS 5.3).
    pub(crate) fn looks_in_system_off(&self) -> bool {
        self.enable == 1 && self.look_at.is_some()
    }

    /// Whether the event at `address` raises ANADETECT, which ends System OFF (PS 6.13).
    pub(crate) fn detects_by(&self, address: u32) -> bool {
        let event = match self.plain(0x520) & 3 {
            0 => CROSS,
            1 => UP,
            _ => DOWN,
        };
        address == crate::instance::address_of(crate::instance::COMP) + crate::instance::event(event)
    }

    fn stop_by(&mut self, sample: u32, stop: u32, _: &Cx<'_>) {
        if self.block.short(sample) {
            self.result = u32::from(self.above);
        }
        if self.block.short(stop) {
            self.look_at = None;
        }
    }
}

impl Instance for Comparator {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 => {
                let start = match self.enable {
                    1 => LPCOMP_START,
                    2 => COMP_START,
                    _ => {
                        cx.misuse("START while neither COMP nor LPCOMP is enabled; ENABLE", self.enable);
                        return true;
                    }
                };
                if self.plain(0x53C) != 0 {
                    cx.unmodelled("the current source; ISOURCE", self.plain(0x53C));
                }
                self.above = false;
                self.ready_at = Some(cx.now + start);
                self.look_at = self.ready_at;
            }
            0x004 => (self.ready_at, self.look_at) = (None, None),
            0x008 => self.result = u32::from(self.above),
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        match offset {
            0x400 => Some(self.result),
            0x500 => Some(self.enable),
            _ => self.plain.iter().find(|(at, _)| *at == offset).map(|(_, value)| *value),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        if offset == 0x500 {
            self.enable = value & 3;
            if self.enable == 0 {
                (self.ready_at, self.look_at) = (None, None);
            }
        }
        match self.plain.iter_mut().find(|(at, _)| *at == offset) {
            Some((_, plain)) => *plain = value,
            None => return matches!(offset, 0x400 | 0x500),
        }
        true
    }

    fn next(&self) -> Option<Cycle> {
        self.look_at
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        self.look_at = Some(cx.now + LOOK);
        cx.act(Act::Compare);
    }
}
