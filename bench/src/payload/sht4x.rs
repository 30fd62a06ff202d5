//! Sensirion's SHT4x on I2C: temperature and relative humidity.
//!
//! | rule | SHT4x data sheet, version 6 |
//! |---|---|
//! | address 0x44; a command is one byte; unknown bytes are not acknowledged | 4.1, 4.5 |
//! | a measurement takes 8.3, 4.5 or 1.6 ms at most | table 4 |
//! | no answer to a header while it measures or resets, and to a read header without data | 4.4 |
//! | six bytes: temperature, CRC, humidity, CRC; most significant byte first | 4.5 |
//! | CRC-8: polynomial 0x31, initial value 0xFF | 4.4, table 7 |
//! | T = -45 °C + 175 °C S/65535, RH = -6 % + 125 % S/65535 | 4.6 |
//! | ready 1 ms after its supply, a soft reset or a general call reset | table 4, 4.7 |
//! | repeatability 0.04, 0.07, 0.1 °C and 0.08, 0.15, 0.25 %, each three standard deviations | tables 1, 2 |
//!
//! The model leaves out the heater and the sensor's own time constant. The heater's commands are reported as misuse.
//! The sensor's time constant is shorter than the box's.

use emulator_part::{I2cAnswer, I2cEvent};

use super::{Air, normal};
use crate::faults::Rng;

/// The address with the direction bit clear.
const ADDRESS: u8 = 0x44 << 1;
/// The time from power-on or reset until the sensor answers, ns.
const STARTS: u64 = 1_000_000;

/// Returns the longest time of a measurement, ns, and three standard deviations of temperature (°C) and humidity (%).
const fn measurement(command: u8) -> Option<(u64, f64, f64)> {
    match command {
        0xFD => Some((8_300_000, 0.04, 0.08)),
        0xF6 => Some((4_500_000, 0.07, 0.15)),
        0xE0 => Some((1_600_000, 0.1, 0.25)),
        _ => None,
    }
}

/// The state of the I2C transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The sensor was addressed for a write and waits for the command.
    Command,
    /// The controller addressed the general call.
    GeneralCall,
    /// The sensor was addressed for a read. The number is the index of the next byte to send.
    Read(usize),
}

/// The sensor.
#[derive(Clone, Debug)]
pub struct Sht4x {
    state: State,
    rng: Rng,
    serial: u32,
    /// The instant, ns, until which the sensor does not answer.
    ready_at: u64,
    /// The bytes of a result that the controller has yet to read.
    data: Option<[u8; 6]>,
    misuse: Option<String>,
}

impl Sht4x {
    /// Returns a sensor whose supply came on at 0 ns. `seed` determines its serial number and its noise.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let serial = rng.word() as u32;
        Self { state: State::Idle, rng, serial, ready_at: STARTS, data: None, misuse: None }
    }

    /// Takes what the controller did against the data sheet since the last call.
    pub fn take_misuse(&mut self) -> Option<String> {
        self.misuse.take()
    }

    /// Restarts the sensor, because its supply came on at `at` (ns).
    pub fn power_on(&mut self, at: u64) {
        (self.state, self.data, self.ready_at) = (State::Idle, None, at + STARTS);
    }

    /// Answers `event` of the controller, which ended at `at` (ns). The sensor measures `air`.
    pub fn act(&mut self, at: u64, event: I2cEvent, air: impl FnOnce() -> Air) -> I2cAnswer {
        let yes = I2cAnswer { acknowledged: true, ..I2cAnswer::NOBODY };
        match event {
            I2cEvent::Start(address) => {
                self.close();
                if at < self.ready_at {
                    return I2cAnswer::NOBODY;
                }
                self.state = match address {
                    0 => State::GeneralCall,
                    ADDRESS => State::Command,
                    _ if address == ADDRESS | 1 && self.data.is_some() => State::Read(0),
                    _ => return I2cAnswer::NOBODY,
                };
                yes
            }
            I2cEvent::Write(byte) => match std::mem::replace(&mut self.state, State::Idle) {
                State::Command if self.obey(at, byte, air) => yes,
                State::GeneralCall if byte == 0x06 => {
                    self.power_on(at);
                    yes
                }
                _ => I2cAnswer::NOBODY,
            },
            I2cEvent::Read(acknowledged) => {
                let (State::Read(next), Some(data)) = (self.state, self.data) else { return I2cAnswer::NOBODY };
                self.state = State::Read(if acknowledged { next + 1 } else { data.len() });
                I2cAnswer { data: data.get(next).copied().unwrap_or(0xFF), ..yes }
            }
            I2cEvent::Stop => {
                self.close();
                I2cAnswer::NOBODY
            }
        }
    }

    /// Ends a transfer. A result that the controller has read is discarded.
    fn close(&mut self) {
        if let State::Read(_) = std::mem::replace(&mut self.state, State::Idle) {
            self.data = None;
        }
    }

    /// Carries out `command`. Returns whether the sensor has such a command.
    fn obey(&mut self, at: u64, command: u8, air: impl FnOnce() -> Air) -> bool {
        match command {
            0x89 => {
                let [a, b, c, d] = self.serial.to_be_bytes();
                self.data = Some(words([a, b], [c, d]));
            }
            0x94 => self.power_on(at),
            0x39 | 0x32 | 0x2F | 0x24 | 0x1E | 0x15 => {
                self.misuse = Some(format!("SHT4x: command {command:#04X} heats, which is not modelled"));
                return false;
            }
            _ => {
                let Some((takes, celsius, percent)) = measurement(command) else {
                    self.misuse = Some(format!("SHT4x: command {command:#04X} is unknown"));
                    return false;
                };
                let air = air();
                let temperature = air.temperature + celsius / 3.0 * normal(&mut self.rng);
                let humidity = air.humidity + percent / 3.0 * normal(&mut self.rng);
                let scale = |share: f64| ((share * 65_535.0).round().clamp(0.0, 65_535.0) as u16).to_be_bytes();
                self.data = Some(words(scale((temperature + 45.0) / 175.0), scale((humidity + 6.0) / 125.0)));
                self.ready_at = at + takes;
            }
        }
        true
    }
}

/// Returns two words of an answer, each with its CRC.
fn words(first: [u8; 2], second: [u8; 2]) -> [u8; 6] {
    let [a, b] = first;
    let [c, d] = second;
    [a, b, crc(first), c, d, crc(second)]
}

/// Whether `bytes` are the six bytes of a measurement, each word with its CRC.
pub(super) fn is_measurement(bytes: &[u8]) -> bool {
    let is_right = |word: &[u8]| crc([word[0], word[1]]) == word[2];
    bytes.len() == 6 && bytes.chunks(3).all(is_right)
}

fn crc(bytes: [u8; 2]) -> u8 {
    bytes.into_iter().fold(0xFF, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x31 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn air() -> Air {
        Air { temperature: 25.0, humidity: 50.0 }
    }

    fn command(sensor: &mut Sht4x, at: u64, byte: u8) -> bool {
        sensor.act(at, I2cEvent::Start(0x88), air).acknowledged
            && sensor.act(at, I2cEvent::Write(byte), air).acknowledged
            && !sensor.act(at, I2cEvent::Stop, air).acknowledged
    }

    fn read(sensor: &mut Sht4x, at: u64) -> Option<Vec<u8>> {
        let addressed = sensor.act(at, I2cEvent::Start(0x89), air).acknowledged;
        let bytes = (0..6).map(|n| sensor.act(at, I2cEvent::Read(n < 5), air).data).collect();
        sensor.act(at, I2cEvent::Stop, air);
        addressed.then_some(bytes)
    }

    fn flipped(bytes: &[u8], bit: usize) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        bytes
    }

    #[test]
    fn the_crc_is_the_one_of_the_data_sheet() {
        assert_eq!(crc([0xBE, 0xEF]), 0x92);
    }

    #[test]
    fn a_measurement_is_read_once_and_only_when_it_is_over() {
        let mut sensor = Sht4x::new(1);
        assert!(!command(&mut sensor, MS - 1, 0xFD), "the sensor starts");
        for (byte, takes) in [(0xFD, 8_300_000), (0xF6, 4_500_000), (0xE0, 1_600_000)] {
            let at = sensor.ready_at + 10 * MS;
            assert!(command(&mut sensor, at, byte));
            assert_eq!(read(&mut sensor, at + takes - 1), None);
            let data = read(&mut sensor, at + takes).expect("it is over");
            let raw = |at: usize| f64::from(u16::from_be_bytes([data[at], data[at + 1]])) / 65_535.0;
            assert_eq!((data[2], data[5]), (crc([data[0], data[1]]), crc([data[3], data[4]])));
            assert!(is_measurement(&data) && !is_measurement(&data[..3]));
            assert!((0..48).all(|bit| !is_measurement(&flipped(&data, bit))));
            assert!((-45.0 + 175.0 * raw(0) - 25.0).abs() < 0.2, "{data:?}");
            assert!((-6.0 + 125.0 * raw(3) - 50.0).abs() < 0.5, "{data:?}");
            assert_eq!(read(&mut sensor, at + 20 * MS), None, "the data were read");
        }
    }

    #[test]
    fn serial_number_and_soft_reset_answer() {
        let mut sensor = Sht4x::new(7);
        assert!(command(&mut sensor, 2 * MS, 0x89));
        let data = read(&mut sensor, 2 * MS).expect("at once");
        assert_eq!([data[0], data[1], data[3], data[4]], sensor.serial.to_be_bytes());
        assert!(command(&mut sensor, 3 * MS, 0x94));
        assert!(!command(&mut sensor, 4 * MS - 1, 0x89), "it resets");
        assert!(command(&mut sensor, 4 * MS, 0x89));
    }

    #[test]
    fn an_unknown_command_and_another_address_are_not_acknowledged() {
        let mut sensor = Sht4x::new(7);
        assert!(!command(&mut sensor, 2 * MS, 0x24), "heater");
        assert!(!command(&mut sensor, 2 * MS, 0x00));
        assert_eq!(sensor.take_misuse().as_deref(), Some("SHT4x: command 0x00 is unknown"));
        assert!(!sensor.act(2 * MS, I2cEvent::Start(0x8A), air).acknowledged);
        assert!(!sensor.act(2 * MS, I2cEvent::Write(0xFD), air).acknowledged);
    }
}
