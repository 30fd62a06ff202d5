//! The surroundings of the active hold: the payload box that it keeps, and the sensors on its I2C bus. Each sensor's
//! model is written from the sensor's data sheet.
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
    /// The sensor that does not answer on the bus.
    silent: Option<Sensor>,
    lies: Option<(Sensor, Rng)>,
    /// Whether SDA is held low.
    stuck: bool,
    /// The number of clocks until a sensor releases SDA, and the last level of SCL.
    clocks: u8,
    scl: bool,
    /// The sensor that acknowledges no byte but its address.
    refuses: Option<Sensor>,
    /// The number of the address that nobody acknowledges, and of the next one, and the instant of the last event, ns.
    deaf: Option<u8>,
    nth: u8,
    last: u64,
    /// The sensor that holds SCL low once it is addressed, and whether it does.
    stretches: Option<Sensor>,
    stretched: bool,
    /// Whether the accelerometer measures nothing, and the samples of one that is shaken.
    numb: bool,
    shaken: Option<Rng>,
}

/// The time, ns, for which a sensor stretches the clock that holds SCL low: longer than anyone waits.
const FOR_EVER: u64 = 1_000_000_000;

/// The shortest pause of the bus, ns, after which [`SensorFault::Deaf`] counts anew. A measurement takes longer.
const PAUSE: u64 = 5_000_000;

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
            deaf: None,
            nth: 0,
            last: 0,
            stretches: None,
            stretched: false,
            numb: false,
            shaken: None,
        }
    }

    /// Makes this sensor not answer from now on; `None` ends the fault.
    pub fn silence(&mut self, sensor: Option<Sensor>) {
        self.silent = sensor;
    }

    /// Makes a sensor send random bytes from now on; the number determines the bytes. `None` ends the fault.
    pub fn make_lie(&mut self, sensor: Option<(Sensor, u64)>) {
        self.lies = sensor.map(|(sensor, seed)| (sensor, Rng::new(seed)));
    }

    /// Pulls SDA low from now on, or releases it.
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
            SensorFault::Deaf(nth) => self.deaf = begins.then_some(nth),
            SensorFault::HoldsScl(sensor) => {
                self.stretches = begins.then_some(sensor);
                self.stretched &= begins;
            }
            SensorFault::HoldsSda(clocks) => self.clocks = if begins { clocks } else { 0 },
            SensorFault::Numb => self.numb = begins,
            SensorFault::Shaken => self.shaken = begins.then(|| Rng::new(1)),
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
        if at >= self.last + PAUSE {
            self.nth = 0;
        }
        self.last = at;
        let is_start = matches!(event, I2cEvent::Start(_));
        let unheard = is_start && self.deaf == Some(self.nth);
        self.nth = self.nth.saturating_add(u8::from(is_start));
        if unheard {
            return I2cAnswer::NOBODY;
        }
        let Self { climate, vibration, sht4x, lis3dh, silent, lies, refuses, numb, shaken, .. } = self;
        let sample_byte =
            |sensor: Sensor, lis3dh: &Lis3dh| lis3dh.sample_byte().filter(|_| sensor == Sensor::Vibration);
        let answers = [
            (Sensor::Climate, sht4x.act(at, event, || climate.air(at))),
            (Sensor::Vibration, lis3dh.act(at, event, vibration)),
        ];
        let answer = answers.into_iter().find(|(sensor, answer)| answer.acknowledged && *silent != Some(*sensor));
        let heard = match (answer, lies) {
            (Some((sensor, _)), _) if matches!(event, I2cEvent::Write(_)) && *refuses == Some(sensor) => {
                I2cAnswer::NOBODY
            }
            (Some((sensor, answer)), _) if *numb && sample_byte(sensor, lis3dh).is_some() => {
                I2cAnswer { data: 0, ..answer }
            }
            (Some((sensor, answer)), _) if shaken.is_some() && sample_byte(sensor, lis3dh).is_some() => {
                let random = shaken.as_mut().map_or(0, Rng::byte);
                // The lower six bits of the low byte are 0 with 10 bits a sample.
                let data = if sample_byte(sensor, lis3dh) == Some(true) { random } else { random & 0xC0 };
                I2cAnswer { data, ..answer }
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    /// The accelerometer's address for a write.
    const VIBRATION: I2cEvent = I2cEvent::Start(0x19 << 1);
    /// The bytes of its identity's register.
    const IDENTITY: I2cEvent = I2cEvent::Write(0x0F);

    fn payload(fault: SensorFault) -> Payload {
        let mut payload = Payload::new(1);
        payload.turn(10 * MS, fault, true);
        payload
    }

    fn acknowledged<const N: usize>(payload: &mut Payload, at: u64, events: [I2cEvent; N]) -> [bool; N] {
        events.map(|event| payload.i2c(at, event).acknowledged)
    }

    #[test]
    fn a_sensor_that_refuses_bytes_acknowledges_its_address_only() {
        let mut payload = payload(SensorFault::Refuses(Sensor::Vibration));
        assert_eq!(acknowledged(&mut payload, 20 * MS, [VIBRATION, IDENTITY]), [true, false]);
        payload.turn(30 * MS, SensorFault::Refuses(Sensor::Vibration), false);
        assert_eq!(acknowledged(&mut payload, 40 * MS, [VIBRATION, IDENTITY]), [true, true]);
    }

    #[test]
    fn the_deaf_address_is_counted_from_a_pause_of_the_bus() {
        let mut payload = payload(SensorFault::Deaf(1));
        for at in [20 * MS, 30 * MS] {
            assert_eq!(acknowledged(&mut payload, at, [VIBRATION, VIBRATION, VIBRATION]), [true, false, true]);
        }
    }

    #[test]
    fn a_sensor_holds_scl_from_its_address_until_the_fault_ends() {
        let mut payload = payload(SensorFault::HoldsScl(Sensor::Vibration));
        assert_eq!(payload.holds(), [false, false]);
        assert_eq!(payload.i2c(20 * MS, VIBRATION).stretched_ns, FOR_EVER);
        assert_eq!(payload.holds(), [true, false]);
        payload.turn(30 * MS, SensorFault::HoldsScl(Sensor::Vibration), false);
        assert_eq!(payload.holds(), [false, false]);
    }

    #[test]
    fn sda_is_released_after_its_clocks_and_reads_as_zeros_before() {
        let mut payload = payload(SensorFault::HoldsSda(3));
        assert!(!payload.i2c(20 * MS, VIBRATION).acknowledged, "no start without a high SDA");
        let read = payload.i2c(20 * MS, I2cEvent::Read(true));
        assert_eq!((read.acknowledged, read.data), (true, 0));
        for clock in 0..3 {
            assert_eq!(payload.holds(), [false, true], "{clock}");
            payload.clock(false);
            payload.clock(true);
        }
        assert_eq!(payload.holds(), [false, false]);
        assert_eq!(acknowledged(&mut payload, 20 * MS, [VIBRATION, IDENTITY]), [true, true]);
    }

    #[test]
    fn sensors_that_restart_have_lost_their_settings() {
        let mut payload = Payload::new(1);
        let setting = |payload: &mut Payload, at: u64, more: &[I2cEvent]| {
            more.iter().for_each(|event| _ = payload.i2c(at, *event));
            acknowledged(payload, at, [VIBRATION, I2cEvent::Write(0x20), I2cEvent::Start(0x19 << 1 | 1)]);
            payload.i2c(at, I2cEvent::Read(false)).data
        };
        let store = [VIBRATION, I2cEvent::Write(0x20), I2cEvent::Write(0x77), I2cEvent::Stop];
        assert_eq!(setting(&mut payload, 10 * MS, &store), 0x77);
        payload.turn(20 * MS, SensorFault::Restart, true);
        assert_eq!(setting(&mut payload, 30 * MS, &[]), 0x07);
    }

    #[test]
    fn a_numb_accelerometer_still_tells_its_identity() {
        let mut payload = payload(SensorFault::Numb);
        let mut read = |register: u8| {
            acknowledged(&mut payload, 20 * MS, [VIBRATION, I2cEvent::Write(register), I2cEvent::Start(0x19 << 1 | 1)]);
            payload.i2c(20 * MS, I2cEvent::Read(false)).data
        };
        assert_eq!([read(0x0F), read(0x28), read(0x2D)], [0x33, 0, 0]);
    }
}
