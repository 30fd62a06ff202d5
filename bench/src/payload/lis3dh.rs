//! ST's accelerometer LIS3DH or LIS2DH12 on I2C. Both have the same registers, as far as the model goes.
//!
//! | rule | LIS3DH data sheet (DocID17530), LIS2DH12 data sheet (DocID025056) |
//! |---|---|
//! | address 0x19 with SA0 high; the first byte written is the register, its bit 7 counts it up | 6.1.1 (6.1.1) |
//! | identity 0x33 in register 0x0F; the values after the supply | 7, 8 (7, 8) |
//! | the registers are loaded within 5 ms of the supply, and again by BOOT | AN3308, boot status |
//! | data rates of CTRL_REG1; 8, 10 or 12 bits by LPen and HR, left-justified two's complement | 8.8, 3.2.1 |
//! | mg per digit: 16, 4, 1 at ±2 g; twice, four and twelve times that at ±4, ±8, ±16 g | 2.1, 3.2.1 |
//! | bandwidth: a ninth of the data rate with HR, half of it otherwise | 3.2.1 |
//! | the first sample one period after power-down, seven with HR | 3.2.1 |
//! | BDU: a pair of bytes stays whole; STATUS_REG: new data, overrun | 8.11, 8.14 |
//! | FIFO of 32 samples: bypass, FIFO, stream; FIFO_SRC_REG; a read goes from 0x2D on at 0x28 | 8.18, 8.19, AN3308 |
//! | scatter of the data rate ±10 %, here at most ±5 % | assumed: a drawn share |
//!
//! | left out, and reported as misuse when it is used | |
//! |---|---|
//! | high-pass filter, self-test, big-endian data, stream-to-FIFO, interrupts on the pins, SPI, ADC | |
//!
//! The model leaves out the auxiliary converter and the temperature sensor, which read 0.

use emulator_part::{I2cAnswer, I2cEvent};

use super::normal;
use super::vibration::{GRAVITY, Vibration};
use crate::faults::Rng;

/// The sensor's I2C address, with the direction bit clear.
const ADDRESS: u8 = 0x19 << 1;
/// The time that the sensor takes to load its registers after the supply came on, or on BOOT, ns.
const BOOTS: u64 = 5_000_000;
/// The number of samples that the FIFO holds.
const DEPTH: u64 = 32;

const WHO_AM_I: u8 = 0x0F;
const CTRL_REG0: u8 = 0x1E;
const CTRL_REG1: u8 = 0x20;
const CTRL_REG2: u8 = 0x21;
const CTRL_REG3: u8 = 0x22;
const CTRL_REG4: u8 = 0x23;
const CTRL_REG5: u8 = 0x24;
const CTRL_REG6: u8 = 0x25;
const STATUS_REG: u8 = 0x27;
const OUT: std::ops::RangeInclusive<u8> = 0x28..=0x2D;
const FIFO_CTRL_REG: u8 = 0x2E;
const FIFO_SRC_REG: u8 = 0x2F;

/// Noise density, m/s² per √Hz: 220 µg/√Hz at ±2 g in high-resolution mode (LIS3DH data sheet, table 4).
const NOISE: f64 = 220e-6 * GRAVITY;

/// The state of the I2C transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The sensor was addressed for a write and waits for the address of a register.
    Address,
    Write,
    Read,
}

/// The sampling with the present settings.
#[derive(Clone, Copy, Debug)]
struct Sampling {
    /// The instant of sample 0, ns.
    first: u64,
    /// The time from one sample to the next, ns.
    period: u64,
    /// The bandwidth of the samples up to the -3 dB point, Hz.
    bandwidth: f64,
}

/// The accelerometer.
#[derive(Clone, Debug)]
pub struct Lis3dh {
    state: State,
    registers: [u8; 0x40],
    /// The register of the next byte.
    register: u8,
    /// Whether the register number counts up after each byte.
    counts_up: bool,
    rng: Rng,
    /// The error of the data rate, parts per million.
    rate_ppm: i64,
    /// The instant, ns, until which the sensor does not answer.
    ready_at: u64,
    /// The present sampling; `None` in power-down.
    sampling: Option<Sampling>,
    /// The number of all samples taken up to the instant at which the FIFO was last empty.
    fifo_from: u64,
    /// The number of samples that were read from the FIFO since it was last empty.
    taken: u64,
    /// For each axis, the number of the last sample of which bytes were read, plus one.
    seen: [u64; 3],
    /// For each axis, the sample of which one byte was read. BDU keeps that sample unchanged until its second byte is
    /// read.
    kept: [Option<[u8; 2]>; 3],
    sample_byte: Option<bool>,
    misuse: Option<String>,
}

impl Lis3dh {
    /// Returns a sensor whose supply came on at 0 ns. `seed` determines its noise and the error of its data rate.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let rate_ppm = rng.below(100_001) as i64 - 50_000;
        let mut sensor = Self {
            state: State::Idle,
            registers: [0; 0x40],
            register: 0,
            counts_up: false,
            rng,
            rate_ppm,
            ready_at: 0,
            sampling: None,
            fifo_from: 0,
            taken: 0,
            seen: [0; 3],
            kept: [None; 3],
            sample_byte: None,
            misuse: None,
        };
        sensor.power_on(0);
        sensor
    }

    /// Takes what the controller did against the data sheet since the last call.
    pub fn take_misuse(&mut self) -> Option<String> {
        self.misuse.take()
    }

    /// Restarts the sensor, because its supply came on at `at` (ns).
    pub fn power_on(&mut self, at: u64) {
        self.registers = [0; 0x40];
        for (register, value) in [(WHO_AM_I, 0x33), (CTRL_REG0, 0x10), (CTRL_REG1, 0x07)] {
            self.registers[usize::from(register)] = value;
        }
        self.ready_at = at + BOOTS;
        (self.state, self.sampling, self.kept) = (State::Idle, None, [None; 3]);
        (self.fifo_from, self.taken, self.seen) = (0, 0, [0; 3]);
    }

    /// Whether the byte that was read last is the high or the low one of a sample; `None` if it is neither.
    pub(super) fn sample_byte(&self) -> Option<bool> {
        self.sample_byte
    }

    fn value(&self, register: u8) -> u8 {
        self.registers.get(usize::from(register)).copied().unwrap_or(0)
    }

    fn note(&mut self, text: String) {
        self.misuse.get_or_insert(text);
    }

    /// Answers the controller's `event`, which ended at `at` (ns). The sensor measures `vibration`.
    pub fn act(&mut self, at: u64, event: I2cEvent, vibration: &Vibration) -> I2cAnswer {
        let yes = I2cAnswer { acknowledged: true, ..I2cAnswer::NOBODY };
        match event {
            I2cEvent::Start(address) if address & !1 == ADDRESS && at >= self.ready_at => {
                self.state = if address & 1 == 0 { State::Address } else { State::Read };
                yes
            }
            I2cEvent::Start(_) | I2cEvent::Stop => {
                self.state = State::Idle;
                I2cAnswer::NOBODY
            }
            I2cEvent::Write(byte) => match self.state {
                State::Address => {
                    (self.register, self.counts_up) = (byte & 0x7F, byte & 0x80 != 0);
                    self.state = State::Write;
                    yes
                }
                State::Write => {
                    self.store(at, self.register, byte);
                    self.count_up();
                    yes
                }
                State::Idle | State::Read => I2cAnswer::NOBODY,
            },
            I2cEvent::Read(acknowledged) => {
                if self.state != State::Read {
                    return I2cAnswer::NOBODY;
                }
                let is_high = !self.register.is_multiple_of(2);
                self.sample_byte = OUT.contains(&self.register).then_some(is_high);
                let data = self.load(at, self.register, vibration);
                self.count_up();
                if !acknowledged {
                    self.state = State::Idle;
                }
                I2cAnswer { data, ..yes }
            }
        }
    }

    fn count_up(&mut self) {
        if self.counts_up {
            let wraps = self.register == *OUT.end() && self.has_fifo();
            self.register = if wraps { *OUT.start() } else { (self.register + 1) & 0x7F };
        }
    }

    fn store(&mut self, at: u64, register: u8, value: u8) {
        let bits = |bits: u8| value & bits != 0;
        let odd = match register {
            CTRL_REG0 => value & 0x7F != 0x10,
            CTRL_REG1 => value >> 4 > 9,
            CTRL_REG2 => bits(0x0F),
            CTRL_REG3 => value != 0,
            CTRL_REG4 => bits(0x47),
            CTRL_REG5 => bits(0x3F),
            CTRL_REG6 => bits(0xFA),
            0x1F | 0x26 | 0x30 | 0x32..=0x34 | 0x36..=0x38 | 0x3A..=0x3F => false,
            FIFO_CTRL_REG => value >> 6 == 3,
            _ => {
                return self
                    .note(format!("LIS3DH: register {register:#04X} was written, which is reserved or read only"));
            }
        };
        if odd {
            self.note(format!("LIS3DH: {value:#04X} in register {register:#04X} is not modelled"));
        }
        self.registers[usize::from(register)] = value;
        match register {
            CTRL_REG1 | CTRL_REG4 => self.plan(at),
            CTRL_REG5 | FIFO_CTRL_REG => {
                if self.value(FIFO_CTRL_REG) >> 6 == 0 || register == CTRL_REG5 {
                    (self.fifo_from, self.taken) = (self.samples(at), 0);
                }
                if register == CTRL_REG5 && bits(0x80) {
                    // BOOT reloads the calibration, but leaves the control registers as they are.
                    self.ready_at = at + BOOTS;
                    self.registers[usize::from(register)] &= 0x7F;
                }
            }
            _ => {}
        }
    }

    fn plan(&mut self, at: u64) {
        let low_power = self.value(CTRL_REG1) & 0x08 != 0;
        let high_resolution = self.value(CTRL_REG4) & 0x08 != 0;
        if low_power && high_resolution {
            self.note("LIS3DH: LPen and HR are both set".to_owned());
        }
        let hertz = match self.value(CTRL_REG1) >> 4 {
            1 => 1,
            2 => 10,
            3 => 25,
            4 => 50,
            5 => 100,
            6 => 200,
            7 => 400,
            8 if low_power => 1_620,
            9 if low_power => 5_376,
            9 => 1_344,
            _ => 0,
        };
        self.sampling = (hertz > 0).then(|| {
            let period = (1_000_000_000_000_000 / (hertz * (1_000_000 + self.rate_ppm))).unsigned_abs();
            let first = at + if high_resolution { 7 } else { 1 } * period;
            Sampling { first, period, bandwidth: hertz as f64 / if high_resolution { 9.0 } else { 2.0 } }
        });
        (self.fifo_from, self.taken, self.seen, self.kept) = (0, 0, [0; 3], [None; 3]);
    }

    fn samples(&self, at: u64) -> u64 {
        self.sampling.map_or(0, |it| at.checked_sub(it.first).map_or(0, |since| since / it.period + 1))
    }

    fn has_fifo(&self) -> bool {
        self.value(CTRL_REG5) & 0x40 != 0 && self.value(FIFO_CTRL_REG) >> 6 != 0
    }

    /// Returns the number of the oldest sample in the FIFO, and the number that follows the newest sample's.
    fn fifo(&self, at: u64) -> (u64, u64) {
        let (oldest, end) = (self.fifo_from + self.taken, self.samples(at));
        if self.value(FIFO_CTRL_REG) >> 6 == 1 {
            // In FIFO mode a full FIFO takes no more samples. Only bypass mode empties it.
            (oldest, end.min(self.fifo_from + DEPTH))
        } else {
            (oldest.max(end.saturating_sub(DEPTH)), end)
        }
    }

    /// Reads `register` at `at` (ns).
    fn load(&mut self, at: u64, register: u8, vibration: &Vibration) -> u8 {
        match register {
            STATUS_REG => {
                let samples = self.samples(at);
                let mut status = 0;
                for (axis, seen) in self.seen.into_iter().enumerate() {
                    status |= u8::from(samples > seen) << axis | u8::from(samples > seen + 1) << (axis + 4);
                }
                status | u8::from(status & 0x07 == 0x07) << 3 | u8::from(status & 0x70 == 0x70) << 7
            }
            FIFO_SRC_REG => {
                if !self.has_fifo() {
                    return 0x20;
                }
                let (oldest, end) = self.fifo(at);
                let unread = end - oldest;
                let watermark = u64::from(self.value(FIFO_CTRL_REG) & 0x1F);
                u8::from(unread > watermark) << 7
                    | u8::from(unread == DEPTH) << 6
                    | u8::from(unread == 0) << 5
                    | unread.min(0x1F) as u8
            }
            _ if OUT.contains(&register) => self.output(at, usize::from(register - *OUT.start()), vibration),
            _ => self.value(register),
        }
    }

    fn output(&mut self, at: u64, place: usize, vibration: &Vibration) -> u8 {
        let (axis, high) = (place / 2, place % 2);
        if self.has_fifo() {
            let (oldest, end) = self.fifo(at);
            // A read of an empty FIFO repeats its last sample.
            let number = if oldest < end { oldest } else { end.saturating_sub(1) };
            let byte = self.sample(number, axis, vibration)[high];
            if place == 5 && oldest < end {
                self.taken = oldest + 1 - self.fifo_from;
            }
            return byte;
        }
        let samples = self.samples(at);
        let keeps = self.value(CTRL_REG4) & 0x80 != 0;
        let value = match self.kept[axis].filter(|_| keeps) {
            Some(value) => value,
            None => self.sample(samples.saturating_sub(1), axis, vibration),
        };
        // With BDU set, a sample stays the same between the reads of its two bytes.
        self.kept[axis] = if self.kept[axis].is_none() { Some(value) } else { None };
        if high == 1 {
            self.seen[axis] = samples;
        }
        value[high]
    }

    /// Returns the two bytes of sample `number` along `axis`, low byte first.
    fn sample(&self, number: u64, axis: usize, vibration: &Vibration) -> [u8; 2] {
        let Some(Sampling { first, period, bandwidth }) = self.sampling else { return [0; 2] };
        if self.value(CTRL_REG1) >> axis & 1 == 0 {
            return [0; 2];
        }
        let at = first + number * period;
        let mut rng = Rng::stream(self.rng.clone().word(), number * 3 + axis as u64);
        let true_value = vibration.acceleration(at, bandwidth)[axis] + NOISE * bandwidth.sqrt() * normal(&mut rng);
        let range = usize::from(self.value(CTRL_REG4) >> 4 & 3);
        let bits = if self.value(CTRL_REG1) & 0x08 != 0 {
            8
        } else if self.value(CTRL_REG4) & 0x08 != 0 {
            12
        } else {
            10
        };
        let mg_per_digit = [1, 2, 4, 12][range] << (12 - bits);
        let most = f64::from(1 << (bits - 1));
        let digits = (true_value / GRAVITY * 1_000.0 / f64::from(mg_per_digit)).round().clamp(-most, most - 1.0);
        ((digits as i16) << (16 - bits)).to_le_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const S: u64 = 1_000 * MS;

    fn write(sensor: &mut Lis3dh, at: u64, register: u8, values: &[u8]) {
        let vibration = Vibration::new(1);
        assert!(sensor.act(at, I2cEvent::Start(0x32), &vibration).acknowledged);
        assert!(sensor.act(at, I2cEvent::Write(register), &vibration).acknowledged);
        values.iter().for_each(|value| assert!(sensor.act(at, I2cEvent::Write(*value), &vibration).acknowledged));
        sensor.act(at, I2cEvent::Stop, &vibration);
    }

    fn read(sensor: &mut Lis3dh, at: u64, register: u8, count: usize) -> Vec<u8> {
        let vibration = Vibration::new(1);
        sensor.act(at, I2cEvent::Start(0x32), &vibration);
        sensor.act(at, I2cEvent::Write(register), &vibration);
        assert!(sensor.act(at, I2cEvent::Start(0x33), &vibration).acknowledged);
        let bytes = (0..count).map(|n| sensor.act(at, I2cEvent::Read(n + 1 < count), &vibration).data).collect();
        sensor.act(at, I2cEvent::Stop, &vibration);
        bytes
    }

    fn set_up(rate: u8, mode: u8) -> Lis3dh {
        let mut sensor = Lis3dh::new(4);
        write(&mut sensor, 10 * MS, CTRL_REG4, &[mode]);
        write(&mut sensor, 10 * MS, CTRL_REG1, &[rate]);
        sensor
    }

    #[test]
    fn the_identity_is_read_5_ms_after_the_supply() {
        let mut sensor = Lis3dh::new(1);
        let vibration = Vibration::new(1);
        assert!(!sensor.act(5 * MS - 1, I2cEvent::Start(0x32), &vibration).acknowledged);
        assert_eq!(read(&mut sensor, 5 * MS, WHO_AM_I, 1), [0x33]);
        assert_eq!(read(&mut sensor, 5 * MS, CTRL_REG0 | 0x80, 3), [0x10, 0x00, 0x07]);
        assert_eq!(read(&mut sensor, 5 * MS, CTRL_REG1, 2), [0x07, 0x07], "bit 7 is clear: the same register");
        assert!(!sensor.act(5 * MS, I2cEvent::Start(0x30), &vibration).acknowledged, "SA0 is high");
    }

    #[test]
    fn gravity_is_along_z_in_every_mode_and_range() {
        for (rate, mode, shift, unit) in
            [(0x57, 0x88, 4, 1), (0x57, 0xA8, 4, 4), (0x57, 0x80, 6, 4), (0x5F, 0xB0, 8, 192)]
        {
            let mut sensor = set_up(rate, mode);
            let mut sum = 0.0;
            for n in 0..100 {
                let bytes = read(&mut sensor, S + n * 10 * MS, 0x2C | 0x80, 2);
                let value = i16::from_le_bytes([bytes[0], bytes[1]]);
                assert_eq!(value & ((1 << shift) - 1), 0, "left-justified");
                sum += f64::from((value >> shift) * unit);
            }
            assert!((sum / 100.0 - 1_000.0).abs() < 100.0, "{rate:02X} {mode:02X}: {sum}");
        }
    }

    #[test]
    fn bdu_keeps_a_sample_whole_between_its_two_bytes() {
        let mut kept = set_up(0x57, 0x88);
        let low = read(&mut kept, S, 0x28, 1)[0];
        let high = read(&mut kept, S + 500 * MS, 0x29, 1)[0];
        let mut at_once = set_up(0x57, 0x88);
        assert_eq!([low, high], read(&mut at_once, S, 0x28 | 0x80, 2)[..]);
        assert_ne!(read(&mut kept, S + 500 * MS, 0x28 | 0x80, 2), [low, high]);
    }

    #[test]
    fn status_tells_new_data_until_they_are_read() {
        let mut sensor = set_up(0x57, 0x00);
        assert_eq!(read(&mut sensor, 11 * MS, STATUS_REG, 1), [0x00]);
        assert_eq!(read(&mut sensor, 22 * MS, STATUS_REG, 1), [0x0F]);
        assert_eq!(read(&mut sensor, 50 * MS, STATUS_REG, 1), [0xFF]);
        read(&mut sensor, 50 * MS, 0x28 | 0x80, 6);
        assert_eq!(read(&mut sensor, 50 * MS, STATUS_REG, 1), [0x00]);
    }

    #[test]
    fn the_fifo_gives_every_sample_once_and_counts_them() {
        let mut sensor = set_up(0x57, 0x88);
        write(&mut sensor, 200 * MS, CTRL_REG5, &[0x40]);
        write(&mut sensor, 200 * MS, FIFO_CTRL_REG, &[0x00]);
        write(&mut sensor, 200 * MS, FIFO_CTRL_REG, &[0x8A]);
        assert_eq!(read(&mut sensor, 201 * MS, FIFO_SRC_REG, 1), [0x20]);
        let unread = read(&mut sensor, 400 * MS, FIFO_SRC_REG, 1)[0];
        assert!((0x80 | 18..0x80 | 23).contains(&unread), "{unread:02X}");
        let count = usize::from(unread & 0x1F);
        let mut whole = sensor.clone();
        let burst = read(&mut whole, 400 * MS, 0x28 | 0x80, 6 * count);
        assert_eq!(read(&mut whole, 400 * MS, FIFO_SRC_REG, 1), [0x20]);
        let single: Vec<u8> = (0..count).flat_map(|_| read(&mut sensor, 400 * MS, 0x28 | 0x80, 6)).collect();
        assert_eq!(burst, single);
        assert_eq!(read(&mut sensor, 2 * S, FIFO_SRC_REG, 1), [0xDF], "full");
    }

    #[test]
    fn fifo_mode_keeps_the_first_samples_and_stream_the_last() {
        let fill = |mode: u8| {
            let mut sensor = set_up(0x57, 0x88);
            write(&mut sensor, 200 * MS, CTRL_REG5, &[0x40]);
            write(&mut sensor, 200 * MS, FIFO_CTRL_REG, &[mode]);
            [S, 2 * S].map(|at| read(&mut sensor.clone(), at, 0x28 | 0x80, 6 * 32))
        };
        let [early, late] = fill(0x40);
        assert_eq!(early, late);
        let [early, late] = fill(0x80);
        assert_ne!(early, late);
    }

    #[test]
    fn what_is_not_modelled_is_reported() {
        for (register, value) in [(CTRL_REG2, 0x08), (CTRL_REG4, 0x40), (0x10, 0), (WHO_AM_I, 0), (FIFO_CTRL_REG, 0xC0)]
        {
            let mut sensor = Lis3dh::new(1);
            write(&mut sensor, 10 * MS, register, &[value]);
            assert!(sensor.take_misuse().is_some(), "{register:02X}");
        }
        assert_eq!(set_up(0x77, 0x88).take_misuse(), None);
    }
}
