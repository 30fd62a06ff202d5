//! Reads the sensors of the hold: temperature and humidity, and acceleration along three axes, on one I2C bus.
//!
//! # Drivers
//!
//! | sensor, bus address | driver | reason for this driver |
//! |---|---|---|
//! | SHT4x (Sensirion), 0x44 | `sht4x` | embedded-hal 1, checks the CRC, maintained |
//! | LIS3DH or LIS2DH12 (ST), 0x19 | `lis2dh` | embedded-hal 1, FIFO with its level, access to every register |
//!
//! Both accelerometers have the same registers, as far as this firmware uses them. The driver `lis2dh12` gives no
//! access to the registers, so settings could not be read back. The driver `lis3dh` reads only one sample of the FIFO
//! in a call.
//!
//! # Schedule
//!
//! A timer raises a beat every 25 ms, four in a cycle ([`timing`](crate::timing)). At each beat a task of the lowest
//! priority calls [`Sensors::serve`], which waits for the bus. Its work depends on the beat's number in the cycle:
//!
//! | beat | work | time on the bus |
//! |---|---|---|
//! | 1, 3 | read the 20 new samples in the accelerometer's FIFO | 5 ms |
//! | 2, once a second | measure temperature and humidity | 9 ms, most of it the sensor's conversion |
//! | 0, once a second | verify the accelerometer's settings, or set it up | 2 ms |
//!
//! The first failed transfer ends the call, and each transfer has a time limit. So a call takes [`LONGEST_MS`] at most,
//! which is shorter than a beat.
//!
//! # Faults
//!
//! A sensor is faulty after a failed transfer, a wrong CRC or an impossible value, until it works again. Once a second
//! the hold tries whether it does. The last temperature stays valid for [`CLIMATE_VALID_BEATS`], so that one damaged
//! transfer does not switch the control off. The vibration is unknown until there are samples of a full second again.

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

/// The accelerometer's samples in a second. At this rate it passes vibration up to 200 Hz (LIS3DH data sheet, 3.2.1).
pub const SAMPLES_PER_SECOND: u32 = 400;
const FIFO: usize = 32;
/// The number of beats for which a temperature is valid after its measurement: 3 s.
pub const CLIMATE_VALID_BEATS: u32 = 3_000 / BEAT_MS;
const SECOND: u32 = BEATS * CYCLES_PER_SECOND;
/// The longest time of a call of [`Sensors::serve`], ms. A full FIFO takes 33 transfers of 0.25 ms each, and a
/// measurement of the climate sensor 9 ms. A failed transfer adds 1.2 ms, with the recovery of the bus.
pub const LONGEST_MS: u32 = 12;

const _: () = {
    assert!(LONGEST_MS < BEAT_MS);
    // The FIFO is read twice in a cycle. It must hold the samples from one reading to the next, and those of one more
    // beat.
    assert!(vibration::READINGS as u32 == 2 * CYCLES_PER_SECOND && BEATS == 4);
    assert!(SAMPLES_PER_SECOND * 3 * BEAT_MS / 1_000 < FIFO as u32);
};

/// The value of WHO_AM_I of LIS3DH and LIS2DH12.
const IDENTITY: u8 = 0x33;

/// The accelerometer's settings that are read back: 400 Hz with all axes on; a range of 8 g with 10 bits; the FIFO on;
/// the FIFO as a stream. 12 bits are not used, because then the sensor passes only 44 Hz, a ninth of its rate.
const SETTINGS: [(Register, u8); 4] =
    [(Register::CtrlReg1, 0x77), (Register::CtrlReg4, 0x20), (Register::CtrlReg5, 0x40), (Register::FifoCtrlReg, 0x80)];

/// The temperatures, °C, that the climate sensor can measure (SHT4x data sheet, table 4). Any other is an error.
const POSSIBLE: core::ops::RangeInclusive<f32> = -40.0..=125.0;

/// The error of a sensor: a failed transfer, a wrong CRC or an impossible value.
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

/// The latest values of the sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// The temperature, °C, and the relative humidity, %; `None` if there is no valid measurement.
    pub climate: Option<[f32; 2]>,
    /// The vibration along x, y and z, m/s²; `None` without samples of a full second.
    pub vibration: Option<[f32; 3]>,
    /// The greatest shock since the readings were last taken, m/s²; `None` if no shock could be measured.
    pub shock: Option<f32>,
    /// Whether a sensor is faulty.
    pub fault: bool,
}

/// The driver of the climate sensor and the accelerometer, with their bus and a delay.
#[derive(Debug)]
pub struct Sensors<B, D> {
    bus: B,
    delay: D,
    climate: Option<[f32; 2]>,
    /// The number of the beat in which temperature and humidity were last measured.
    measured: u32,
    climate_faulty: bool,
    vibration: Vibration,
    accelerometer: Accelerometer,
    /// Whether the FIFO was empty at its last reading.
    empty: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Accelerometer {
    /// The accelerometer was not accessed since the start.
    New,
    /// The accelerometer is set up and samples.
    Works,
    /// The accelerometer has failed and must be set up again.
    Faulty,
}

impl<B: I2c, D: DelayNs> Sensors<B, D> {
    /// Returns the driver without accessing the sensors.
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

    /// Does the work of beat number `beat`. This number counts from the start and wraps.
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

    /// Writes the latest values into `readings`, but keeps a greater shock that is there already.
    pub fn report(&mut self, readings: &mut Readings) {
        let shock = self.vibration.take_greatest();
        *readings = Readings {
            climate: self.climate,
            vibration: self.vibration.rms(),
            shock: match (readings.shock, shock) {
                // Not covered: the result of `max` for a NaN, which no shock is.
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
        // The sensor's formula may exceed 0 % and 100 %. The data sheet says to limit the result (4.6).
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
        // The registers may hold settings of an earlier start: filters, interrupts, byte order, self-test. They are
        // cleared.
        for register in [Register::CtrlReg2, Register::CtrlReg3, Register::CtrlReg4, Register::CtrlReg5] {
            sensor.write_register(register, 0)?;
        }
        sensor.write_register(Register::CtrlReg1, 0x07)?;
        sensor.set_mode(Mode::Normal)?;
        sensor.set_full_scale(FullScale::Fs8g)?;
        // The mode of the FIFO may only change through bypass, which also empties the FIFO.
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
        // Not covered: a full FIFO, which takes 80 ms without a reading: by then the accelerometer counts as failed,
        // and is set up anew.
        let count = if level.full { FIFO } else { usize::from(level.sample_count).min(FIFO) };
        let data = &mut data[..count];
        sensor.read_data(data)?;
        // Two empty readings in a row mean that the sensor was reset. A single one may occur after the set-up.
        if core::mem::replace(&mut self.empty, count == 0) && count == 0 {
            return Err(Faulty);
        }
        let mut samples = [Sample::default(); FIFO];
        for (sample, data) in samples.iter_mut().zip(&*data) {
            let left_aligned = [data.x, data.y, data.z];
            // A sample's 10 bits are left-aligned in 16, so its lowest six bits are 0. Other values come from a stuck
            // line.
            if left_aligned.iter().any(|value| value & 0x3F != 0) {
                return Err(Faulty);
            }
            *sample = left_aligned.map(|value| value >> 6);
        }
        let samples = &samples[..count];
        // Samples of 50 ms that are all exactly 0 come from a fault, since gravity and noise are always there.
        if count > 0 && samples.iter().all(|sample| *sample == [0; 3]) {
            return Err(Faulty);
        }
        telemetry.vibration_samples.add(count as u32);
        self.vibration.take(samples);
        Ok(())
    }
}
