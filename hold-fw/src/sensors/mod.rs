//! The sensors of the hold: temperature and humidity, and three axes of acceleration, on one I2C bus.
//!
//! # Drivers
//!
//! | sensor | driver | why this one |
//! |---|---|---|
//! | SHT4x (Sensirion), 0x44 | `sht4x` | embedded-hal 1, checks the CRC, kept up; its rival `sht4x-ng` refers to it |
//! | LIS3DH or LIS2DH12 (ST), 0x19 | `lis2dh` | embedded-hal 1, FIFO with its level, every register, no dependency |
//!
//! Both accelerometers have the same registers as far as they are used here. The driver `lis2dh12` keeps the registers
//! to itself, so that no setting could be read back, and `lis3dh` reads no more than one sample of the FIFO in a call;
//! both bring a crate with a trait that nothing here needs.
//!
//! # Schedule
//!
//! [`Sensors::serve`] is called in each [beat](crate::timing::BEATS), by a task of the lowest priority, and waits for
//! the bus. One call does at most one of these:
//!
//! | beat | what | time on the bus |
//! |---|---|---|
//! | 1, 3 | read the accelerometer's FIFO, which has 20 samples | 5 ms |
//! | 2, once a second | measure temperature and humidity | 9 ms, most of which is the sensor's conversion |
//! | 0, once a second | verify the accelerometer's settings, or set it up | 2 ms |
//!
//! The first transfer that fails ends the call, and the bus gives up each transfer after a bounded time. So the longest
//! call takes [`LONGEST_MS`], which is shorter than a beat.
//!
//! # Faults
//!
//! A sensor is faulty from a transfer that fails, a wrong CRC or an impossible value until it works again, which is
//! tried every second. The last temperature stands for [`CLIMATE_VALID_BEATS`] meanwhile, so that one damaged transfer
//! does not switch the control off. The vibration is unknown until there is a second of samples again.

pub mod bus;
pub mod vibration;

use embedded_hal::{delay::DelayNs, i2c::I2c};
use lis2dh::{AccelerationData, FifoConfig, FullScale, Lis2dh, Mode, OutputDataRate, Register, Sa0Pad};
use sht4x::{Precision, Sht4x};

use crate::{
    telemetry::Telemetry,
    timing::{BEATS, BEAT_MS, CYCLES_PER_SECOND},
};
use vibration::{Sample, Vibration};

/// The samples of the accelerometer in a second. It then passes vibration up to 200 Hz (LIS3DH data sheet, 3.2.1).
pub const SAMPLES_PER_SECOND: u32 = 400;
/// The length of the accelerometer's FIFO, samples.
const FIFO: usize = 32;
/// The beats for which a temperature is valid after its measurement: 3 s.
pub const CLIMATE_VALID_BEATS: u32 = 3_000 / BEAT_MS;
/// The beats in a second.
const SECOND: u32 = BEATS * CYCLES_PER_SECOND;
/// The longest time of a call of [`Sensors::serve`], ms: a full FIFO takes 33 transfers of 0.25 ms each, the conversion
/// of the climate sensor 9 ms, and a transfer that fails 1.2 ms with the recovery of the bus.
pub const LONGEST_MS: u32 = 12;

const _: () = {
    assert!(LONGEST_MS < BEAT_MS);
    // Two readings in each cycle, and a FIFO that holds what comes in a beat more than between two of them.
    assert!(vibration::READINGS as u32 == 2 * CYCLES_PER_SECOND && BEATS == 4);
    assert!(SAMPLES_PER_SECOND * 3 * BEAT_MS / 1_000 < FIFO as u32);
};

/// The identity of the accelerometers (WHO_AM_I of LIS3DH and LIS2DH12).
const IDENTITY: u8 = 0x33;

/// The settings of the accelerometer that are read back: 400 Hz with all axes on; a range of 8 g with 10 bits; the FIFO
/// on; the FIFO as a stream. With 12 bits the sensor passes only a ninth of its rate, 44 Hz, and not half of it.
const SETTINGS: [(Register, u8); 4] =
    [(Register::CtrlReg1, 0x77), (Register::CtrlReg4, 0x20), (Register::CtrlReg5, 0x40), (Register::FifoCtrlReg, 0x80)];

/// The temperatures, °C, that the climate sensor can measure; it is wrong about any other (SHT4x data sheet, table 4).
const POSSIBLE: core::ops::RangeInclusive<f32> = -40.0..=125.0;

/// A failure of a sensor: a transfer that failed, a wrong CRC, an impossible value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Faulty;

impl<E> From<lis2dh::Error<E>> for Faulty {
    fn from(_: lis2dh::Error<E>) -> Self {
        Self
    }
}

impl<E> From<sht4x::Error<E>> for Faulty {
    fn from(_: sht4x::Error<E>) -> Self {
        Self
    }
}

/// What the sensors say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// The temperature, °C, and the relative humidity, %, if they are valid.
    pub climate: Option<[f32; 2]>,
    /// The vibration along x, y, z, m/s², if it is known.
    pub vibration: Option<[f32; 3]>,
    /// The greatest shock since the readings were taken last, m/s², if one could be measured.
    pub shock: Option<f32>,
    /// Whether a sensor is faulty.
    pub fault: bool,
}

/// The sensors, with the bus and a delay.
#[derive(Debug)]
pub struct Sensors<B, D> {
    bus: B,
    delay: D,
    climate: Option<[f32; 2]>,
    /// The beat in which the climate was measured last.
    measured: u32,
    climate_faulty: bool,
    vibration: Vibration,
    accelerometer: Accelerometer,
    /// Whether the last reading found no sample.
    empty: bool,
}

/// The state of the accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Accelerometer {
    /// It was not accessed since the start.
    New,
    /// It is set up and samples.
    Works,
    /// It has failed, and is set up anew.
    Faulty,
}

impl<B: I2c, D: DelayNs> Sensors<B, D> {
    /// Returns the sensors, which have not been accessed yet.
    pub fn new(bus: B, delay: D) -> Self {
        Self {
            bus,
            delay,
            climate: None,
            measured: 0,
            climate_faulty: false,
            vibration: Vibration::new(),
            accelerometer: Accelerometer::New,
            empty: false,
        }
    }

    /// Does the work of `beat`, which counts from the start on and wraps.
    pub fn serve(&mut self, beat: u32, telemetry: &Telemetry) {
        match (beat % BEATS, beat % SECOND) {
            (1 | 3, _) if self.accelerometer == Accelerometer::Works => {
                let read = self.read_samples(telemetry);
                self.note_accelerometer(read, telemetry);
            }
            (0, 0) => {
                let works = self.accelerometer == Accelerometer::Works;
                let set = if works { self.verify() } else { self.set_up() };
                self.note_accelerometer(set, telemetry);
            }
            (2, 2) => {
                telemetry.climate_readings.add(1);
                let measured = self.measure();
                self.climate_faulty = measured.is_err();
                telemetry.climate_faults.add(u32::from(self.climate_faulty));
                if let Ok(climate) = measured {
                    (self.climate, self.measured) = (Some(climate), beat);
                }
            }
            _ => {}
        }
        if beat.wrapping_sub(self.measured) > CLIMATE_VALID_BEATS {
            self.climate = None;
        }
    }

    /// Puts what the sensors say into `readings`; the greatest shock there stays if it is greater.
    pub fn report(&mut self, readings: &mut Readings) {
        let shock = self.vibration.take_greatest();
        *readings = Readings {
            climate: self.climate,
            vibration: self.vibration.rms(),
            shock: match (readings.shock, shock) {
                (Some(before), Some(now)) => Some(before.max(now)),
                (before, now) => before.or(now),
            },
            fault: self.climate_faulty || self.accelerometer == Accelerometer::Faulty,
        };
    }

    fn note_accelerometer(&mut self, result: Result<(), Faulty>, telemetry: &Telemetry) {
        self.accelerometer = match result {
            Ok(()) => Accelerometer::Works,
            Err(Faulty) => {
                telemetry.vibration_faults.add(1);
                self.vibration.clear();
                Accelerometer::Faulty
            }
        };
    }

    fn measure(&mut self) -> Result<[f32; 2], Faulty> {
        let measured = Sht4x::new(&mut self.bus).measure(Precision::High, &mut self.delay)?;
        let celsius = measured.temperature_milli_celsius() as f32 / 1_000.0;
        let percent = measured.humidity_milli_percent() as f32 / 1_000.0;
        // The sensor's formula goes beyond what a relative humidity can be, and the sheet says to cut it (4.6).
        POSSIBLE.contains(&celsius).then_some([celsius, percent.clamp(0.0, 100.0)]).ok_or(Faulty)
    }

    fn lis2dh(&mut self) -> Lis2dh<&mut B> {
        Lis2dh::new(&mut self.bus, Sa0Pad::High)
    }

    fn set_up(&mut self) -> Result<(), Faulty> {
        let mut sensor = self.lis2dh();
        if sensor.get_device_id()? != IDENTITY {
            return Err(Faulty);
        }
        // Settings of an earlier start that are not set below are cleared: filters, interrupts, byte order, self-test.
        for register in [Register::CtrlReg2, Register::CtrlReg3, Register::CtrlReg4, Register::CtrlReg5] {
            sensor.write_register(register, 0)?;
        }
        sensor.write_register(Register::CtrlReg1, 0x07)?;
        sensor.set_mode(Mode::Normal)?;
        sensor.set_full_scale(FullScale::Fs8g)?;
        // The way to another mode leads through bypass, which empties the FIFO.
        sensor.configure_fifo(FifoConfig::Bypass)?;
        sensor.configure_fifo(FifoConfig::Stream { watermark: 0 })?;
        sensor.set_output_data_rate(OutputDataRate::Hz400)?;
        self.empty = false;
        self.verify()
    }

    fn verify(&mut self) -> Result<(), Faulty> {
        let mut sensor = self.lis2dh();
        for (register, value) in SETTINGS {
            if sensor.read_register(register)? != value {
                return Err(Faulty);
            }
        }
        Ok(())
    }

    fn read_samples(&mut self, telemetry: &Telemetry) -> Result<(), Faulty> {
        let mut data = [AccelerationData::default(); FIFO];
        let mut sensor = self.lis2dh();
        let level = sensor.read_fifo_status()?;
        telemetry.vibration_overruns.add(u32::from(level.full));
        let count = if level.full { FIFO } else { usize::from(level.sample_count).min(FIFO) };
        let data = &mut data[..count];
        sensor.read_data(data)?;
        // A sensor that was reset measures nothing. The first reading after the set-up may come before a sample.
        if core::mem::replace(&mut self.empty, count == 0) && count == 0 {
            return Err(Faulty);
        }
        let mut samples = [Sample::default(); FIFO];
        for (sample, data) in samples.iter_mut().zip(&*data) {
            let left_aligned = [data.x, data.y, data.z];
            // The lowest six of 16 bits are 0 with a resolution of 10 bits, and are not on a line that is stuck.
            if left_aligned.iter().any(|value| value & 0x3F != 0) {
                return Err(Faulty);
            }
            *sample = left_aligned.map(|value| value >> 6);
        }
        let samples = &samples[..count];
        // Gravity and noise leave no axis exactly at 0 for 50 ms, and not all three.
        if count > 0 && samples.iter().all(|sample| *sample == [0; 3]) {
            return Err(Faulty);
        }
        telemetry.vibration_samples.add(count as u32);
        self.vibration.take(samples);
        Ok(())
    }
}
