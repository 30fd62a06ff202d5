//! The surroundings of the active hold: the payload box that it keeps, and the sensors on its I2C bus. Each is written
//! from its data sheet.
//!
//! | file | what |
//! |---|---|
//! | `climate` | temperature and humidity of the box, with heater and cooler |
//! | `vibration` | rotors, shocks, gravity |
//! | `sht4x` | the sensor of temperature and humidity |
//! | `lis3dh` | the accelerometer |

mod climate;
mod lis3dh;
mod sht4x;
mod vibration;

use emulator_part::{I2cAnswer, I2cEvent};

use crate::faults::hold::Sensor;
use crate::faults::{Rng, SensorFault};
pub use climate::{Air, Climate};
pub use lis3dh::Lis3dh;
pub use sht4x::Sht4x;
pub use vibration::{GRAVITY, Shock, Vibration};

/// Returns a number from a normal distribution with standard deviation 1, as the sum of twelve uniform ones.
fn normal(rng: &mut Rng) -> f64 {
    (0..12).map(|_| rng.below(1 << 32) as f64 / f64::from(u32::MAX)).sum::<f64>() - 6.0
}

/// The payload: its box, its vibration and the sensors.
#[derive(Clone, Debug)]
pub struct Payload {
    /// The climate in the payload box.
    pub climate: Climate,
    /// The vibration.
    pub vibration: Vibration,
    sht4x: Sht4x,
    /// The bytes that the climate sensor has sent in the present transfer, and when it last sent a whole measurement,
    /// ns.
    sent: Vec<u8>,
    measured: Option<u64>,
    lis3dh: Lis3dh,
    /// The sensor that does not answer. The next field is the sensor that sends random bytes.
    silent: Option<Sensor>,
    lies: Option<(Sensor, Rng)>,
    /// Whether SDA is held low.
    stuck: bool,
    /// The number of clocks until a sensor releases SDA, and the last level of SCL.
    clocks: u8,
    scl: bool,
    /// The sensor that acknowledges no byte but its address.
    refuses: Option<Sensor>,
    /// The sensor that holds SCL low once it is addressed, and whether it does.
    stretches: Option<Sensor>,
    stretched: bool,
    /// Whether the accelerometer measures nothing.
    numb: bool,
}

/// The time, ns, for which a sensor stretches the clock that holds SCL low: longer than anyone waits.
const FOR_EVER: u64 = 1_000_000_000;

impl Payload {
    /// Returns a payload whose properties are drawn from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let of = |stream: u64| Rng::stream(seed, stream).word();
        Self {
            climate: Climate::new(of(0x481)),
            vibration: Vibration::new(of(0x482)),
            sht4x: Sht4x::new(of(0x483)),
            sent: vec![],
            measured: None,
            lis3dh: Lis3dh::new(of(0x484)),
            silent: None,
            lies: None,
            stuck: false,
            clocks: 0,
            scl: true,
            refuses: None,
            stretches: None,
            stretched: false,
            numb: false,
        }
    }

    /// Makes this sensor not answer from now on; `None` ends the fault.
    pub fn silence(&mut self, sensor: Option<Sensor>) {
        self.silent = sensor;
    }

    /// Makes this sensor send random bytes from now on, of which the number is the seed; `None` ends the fault.
    pub fn make_lie(&mut self, sensor: Option<(Sensor, u64)>) {
        self.lies = sensor.map(|(sensor, seed)| (sensor, Rng::new(seed)));
    }

    /// Holds SDA low from now on, or releases it.
    pub fn hold_sda(&mut self, low: bool) {
        self.stuck = low;
    }

    /// Whether SCL and SDA are held low.
    #[must_use]
    pub fn holds(&self) -> [bool; 2] {
        [self.stretched, self.stuck || self.clocks > 0]
    }

    /// Begins (`begins`) or ends a fault of the sensors at `at` (ns).
    pub fn turn(&mut self, at: u64, fault: SensorFault, begins: bool) {
        match fault {
            SensorFault::Refuses(sensor) => self.refuses = begins.then_some(sensor),
            SensorFault::HoldsScl(sensor) => {
                self.stretches = begins.then_some(sensor);
                self.stretched &= begins;
            }
            SensorFault::HoldsSda(clocks) => self.clocks = if begins { clocks } else { 0 },
            SensorFault::Numb => self.numb = begins,
            SensorFault::Restart if begins => self.power_on(at),
            SensorFault::Celsius(celsius) if begins => self.climate.warm_to(at, celsius.into()),
            SensorFault::Restart | SensorFault::Celsius(_) => {}
        }
    }

    /// The controller has released SCL or driven it low by hand. A sensor in the middle of a byte shifts on at each
    /// rise, and releases SDA when the byte has ended (UM10204, 3.1.16).
    pub fn clock(&mut self, high: bool) {
        if high && !self.scl {
            self.clocks = self.clocks.saturating_sub(1);
        }
        self.scl = high;
    }

    /// Answers `event` of the I2C controller, which ended at `at` (ns).
    pub fn i2c(&mut self, at: u64, event: I2cEvent) -> I2cAnswer {
        if self.stuck || self.clocks > 0 {
            // A low SDA is an acknowledgement and a zero, but a start needs a high one (UM10204, 3.1.4 to 3.1.6).
            let acknowledged = matches!(event, I2cEvent::Write(_) | I2cEvent::Read(_));
            return I2cAnswer { acknowledged, data: 0, ..I2cAnswer::NOBODY };
        }
        let Self { climate, vibration, sht4x, lis3dh, silent, lies, refuses, numb, .. } = self;
        let answers = [
            (Sensor::Climate, sht4x.act(at, event, || climate.air(at))),
            (Sensor::Vibration, lis3dh.act(at, event, vibration)),
        ];
        let answer = answers.into_iter().find(|(sensor, answer)| answer.acknowledged && *silent != Some(*sensor));
        let heard = match (answer, lies) {
            (Some((sensor, _)), _) if matches!(event, I2cEvent::Write(_)) && *refuses == Some(sensor) => {
                I2cAnswer::NOBODY
            }
            (Some((Sensor::Vibration, answer)), _) if *numb && lis3dh.sends_data() => I2cAnswer { data: 0, ..answer },
            (Some((sensor, answer)), Some((lying, rng))) if sensor == *lying => {
                I2cAnswer { data: rng.byte(), ..answer }
            }
            (Some((_, answer)), _) => answer,
            (None, _) => I2cAnswer::NOBODY,
        };
        match (event, answer) {
            (I2cEvent::Read(_), Some((Sensor::Climate, _))) => {
                self.sent.push(heard.data);
                if sht4x::is_measurement(&self.sent) {
                    self.measured = Some(at);
                }
            }
            _ => self.sent.clear(),
        }
        // A target may hold SCL low after any byte until it is ready for the next one (UM10204, 3.1.9).
        let stretches = answer.is_some_and(|(sensor, _)| self.stretches == Some(sensor));
        self.stretched |= stretches;
        I2cAnswer { stretched_ns: if stretches { FOR_EVER } else { heard.stretched_ns }, ..heard }
    }

    /// The instant, ns, at which the climate sensor last sent a whole measurement with the right CRCs.
    #[must_use]
    pub fn measured(&self) -> Option<u64> {
        self.measured
    }

    /// Restarts the sensors, because their supply came on at `at` (ns).
    pub fn power_on(&mut self, at: u64) {
        self.sht4x.power_on(at);
        self.lis3dh.power_on(at);
    }

    /// Takes what the controller did against the sensors' data sheets since the last call.
    pub fn take_misuses(&mut self) -> impl Iterator<Item = String> {
        [self.sht4x.take_misuse(), self.lis3dh.take_misuse()].into_iter().flatten()
    }
}
