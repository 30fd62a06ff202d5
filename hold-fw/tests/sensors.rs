//! Tests the sensors' driver on a bus with simulated sensors, whose faults the tests set.

use std::{cell::RefCell, rc::Rc};

use embedded_hal::{
    delay::DelayNs,
    i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation},
};
use hold_fw::{
    sensors::{Readings, Sensors, CLIMATE_VALID_BEATS},
    telemetry::Telemetry,
    timing::{BEATS, CYCLES_PER_SECOND},
};
use proptest::prelude::*;

const SECOND: u32 = BEATS * CYCLES_PER_SECOND;
/// The number of samples in a beat of 25 ms at 400 Hz.
const PER_BEAT: usize = 10;

/// The model of both sensors, as far as the driver uses them: the accelerometer's registers and FIFO, the climate
/// sensor's result.
#[derive(Default)]
struct Board {
    registers: Vec<u8>,
    fifo: Vec<[u8; 6]>,
    /// The sample that the model of the accelerometer takes at present, left-aligned.
    sample: [i16; 3],
    measured: [u16; 2],
    measuring: bool,
    refuses: std::ops::Range<u32>,
    transfers: u32,
    accelerometer_absent: bool,
    accelerometer_dead: bool,
    /// The inverted bits in the six bytes that the climate sensor sends.
    damage: [u8; 6],
}

impl Board {
    fn new() -> Self {
        let mut registers = vec![0; 0x40];
        (registers[0x0F], registers[0x20]) = (0x33, 0x07);
        // The result means 25 °C and 50 %.
        let measured = [26_214, 29_360];
        Self { registers, sample: [0, 0, 62 << 6], measured, ..Self::default() }
    }

    fn samples(&self) -> bool {
        !self.accelerometer_dead
            && self.registers[0x20] >> 4 == 7
            && self.registers[0x24] & 0x40 != 0
            && self.registers[0x2E] >> 6 == 2
    }

    fn beat(&mut self) {
        if self.samples() {
            let [x, y, z] = self.sample.map(i16::to_le_bytes);
            self.fifo.resize((self.fifo.len() + PER_BEAT).min(32), [x[0], x[1], y[0], y[1], z[0], z[1]]);
        }
    }

    fn accelerometer(&mut self, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        match operations {
            [Operation::Write([register, value])] => {
                self.registers[usize::from(*register)] = *value;
                if (*register, *value) == (0x2E, 0) {
                    self.fifo.clear();
                }
            }
            [Operation::Write([0xA8]), Operation::Read(sample)] => sample.copy_from_slice(&self.fifo.remove(0)),
            [Operation::Write([0x2F]), Operation::Read([level])] => {
                *level = self.fifo.len().min(31) as u8 | u8::from(self.fifo.len() == 32) << 6;
            }
            [Operation::Write([register]), Operation::Read([value])] => {
                *value = self.registers[usize::from(*register)];
            }
            other => panic!("{other:?}"),
        }
        Ok(())
    }

    fn climate(&mut self, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        match operations {
            [Operation::Write([0xFD])] => self.measuring = true,
            [Operation::Read(bytes)] if std::mem::take(&mut self.measuring) => {
                let [t, h] = self.measured.map(u16::to_be_bytes);
                let sent = [t[0], t[1], crc(t), h[0], h[1], crc(h)];
                for (byte, (sent, damage)) in bytes.iter_mut().zip(sent.into_iter().zip(self.damage)) {
                    *byte = sent ^ damage;
                }
            }
            [Operation::Read(_)] => return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)),
            other => panic!("{other:?}"),
        }
        Ok(())
    }
}

fn crc(bytes: [u8; 2]) -> u8 {
    let bit = |crc: u8| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x31 };
    bytes.into_iter().fold(0xFF, |crc, byte| (0..8).fold(crc ^ byte, |crc, _| bit(crc)))
}

#[derive(Clone)]
struct Bus(Rc<RefCell<Board>>);

impl ErrorType for Bus {
    type Error = ErrorKind;
}

impl I2c for Bus {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        let mut board = self.0.borrow_mut();
        board.transfers += 1;
        if board.refuses.contains(&board.transfers) {
            return Err(ErrorKind::Bus);
        }
        match address {
            0x19 if !board.accelerometer_absent => board.accelerometer(operations),
            0x44 => board.climate(operations),
            _ => Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)),
        }
    }
}

struct Delay;

impl DelayNs for Delay {
    fn delay_ns(&mut self, _: u32) {}
}

struct World {
    board: Rc<RefCell<Board>>,
    sensors: Sensors<Bus, Delay>,
    telemetry: Telemetry,
    beat: u32,
    readings: Readings,
}

impl World {
    fn new() -> Self {
        let board = Rc::new(RefCell::new(Board::new()));
        let sensors = Sensors::new(Bus(board.clone()), Delay);
        Self { board, sensors, telemetry: Telemetry::new(), beat: 0, readings: Readings::default() }
    }

    fn beats(&mut self, beats: u32) -> Readings {
        for _ in 0..beats {
            self.board.borrow_mut().beat();
            self.sensors.serve(self.beat, &self.telemetry);
            self.sensors.report(&mut self.readings);
            self.beat += 1;
        }
        self.readings
    }

    /// Returns a world in which two seconds have passed, so that all values are known.
    fn working() -> Self {
        let mut world = Self::new();
        let readings = world.beats(2 * SECOND);
        assert!(readings.climate.is_some() && readings.vibration.is_some() && !readings.fault, "{readings:?}");
        world
    }
}

#[test]
fn both_sensors_are_set_up_and_their_values_are_known() {
    let mut world = World::new();
    assert!(!world.beats(0).fault, "nothing is wrong before the first access");
    let readings = world.beats(SECOND + 2);
    let [celsius, percent] = readings.climate.unwrap();
    assert!((celsius - 25.0).abs() < 0.01 && (percent - 50.0).abs() < 0.01, "{celsius} {percent}");
    assert_eq!((readings.vibration, readings.fault), (Some([0.0; 3]), false));
    assert!(world.telemetry.vibration_samples.get() > 380);
    assert_eq!((world.telemetry.climate_faults.get(), world.telemetry.vibration_faults.get()), (0, 0));
}

#[test]
fn an_absent_accelerometer_is_a_fault_until_it_comes() {
    let mut world = World::working();
    world.board.borrow_mut().accelerometer_absent = true;
    let readings = world.beats(2);
    assert_eq!((readings.fault, readings.vibration), (true, None));
    let before = world.board.borrow().transfers;
    assert!(world.beats(3 * SECOND).climate.is_some(), "the other sensor works on");
    assert!(world.board.borrow().transfers - before < 10, "it is tried once a second");
    *world.board.borrow_mut() = Board::new();
    assert!(!world.beats(SECOND).fault);
    assert!(world.beats(SECOND).vibration.is_some());
}

#[test]
fn an_accelerometer_that_was_reset_or_changed_is_set_up_anew() {
    for register in [0x20, 0x23, 0x24, 0x2E] {
        let mut world = World::working();
        let fresh = Board::new().registers[register];
        world.board.borrow_mut().registers[register] = fresh;
        let noticed = (0..2 * SECOND).any(|_| world.beats(1).fault);
        assert!(noticed, "{register:#x}");
        let readings = world.beats(3 * SECOND);
        assert_eq!((readings.fault, readings.vibration), (false, Some([0.0; 3])), "{register:#x}");
    }
}

#[test]
fn a_temperature_stands_for_three_seconds_and_then_is_unknown() {
    let mut world = World::working();
    world.board.borrow_mut().damage = [0x40, 0, 0, 0, 0, 0];
    let known = (0..5 * SECOND).take_while(|_| world.beats(1).climate.is_some()).count() as u32;
    // The validity of the last temperature is counted from beat 42, when it was measured; the sensor fails from beat 80
    // on.
    assert_eq!(known + 2 * SECOND - (SECOND + 2) - 1, CLIMATE_VALID_BEATS);
    assert!(world.readings.fault && world.telemetry.climate_faults.get() >= 2);
    world.board.borrow_mut().damage = [0; 6];
    let readings = world.beats(SECOND);
    assert!(readings.climate.is_some() && !readings.fault);
}

#[test]
fn impossible_temperatures_are_faults_and_humidity_is_cut() {
    for (word, possible) in
        [(0, false), (1_800, false), (2_000, true), (63_600, true), (64_000, false), (65_535, false)]
    {
        let mut world = World::new();
        world.board.borrow_mut().measured = [word, 0];
        let readings = world.beats(SECOND);
        assert_eq!((readings.climate.is_some(), readings.fault), (possible, !possible), "{word}");
        assert!(readings.climate.is_none_or(|[_, percent]| percent == 0.0));
    }
}

#[test]
fn samples_that_cannot_be_are_faults() {
    for sample in [[-1, -1, -1], [0, 0, 1], [0, 32, 62 << 6], [0, 0, 0]] {
        let mut world = World::working();
        world.board.borrow_mut().sample = sample;
        world.board.borrow_mut().fifo.clear();
        let readings = world.beats(2);
        assert_eq!((readings.fault, readings.vibration), (true, None), "{sample:?}");
    }
}

#[test]
fn an_accelerometer_that_samples_nothing_is_a_fault_within_two_readings() {
    let mut world = World::working();
    world.board.borrow_mut().accelerometer_dead = true;
    assert!(!world.beats(2).fault, "the FIFO still has samples");
    assert!(world.beats(2 * BEATS).fault);
}

#[test]
fn another_chip_at_the_address_is_not_taken_for_the_accelerometer() {
    let mut world = World::new();
    world.board.borrow_mut().registers[0x0F] = 0x44;
    let readings = world.beats(3 * SECOND);
    assert_eq!((readings.fault, readings.vibration), (true, None));
    assert_eq!(world.telemetry.vibration_faults.get(), 3);
}

#[test]
fn samples_from_before_the_set_up_do_not_count() {
    let mut world = World::new();
    world.board.borrow_mut().fifo = vec![[0; 6]; 32];
    world.beats(2);
    assert_eq!((world.telemetry.vibration_samples.get(), world.readings.fault), (PER_BEAT as u32, false));
}

#[test]
fn a_full_fifo_is_read_whole_and_counted_as_an_overrun() {
    let mut world = World::working();
    (0..4).for_each(|_| world.board.borrow_mut().beat());
    let before = world.telemetry.vibration_samples.get();
    world.beats(2);
    assert_eq!(world.telemetry.vibration_samples.get() - before, 32);
    assert_eq!((world.telemetry.vibration_overruns.get(), world.readings.fault), (1, false));
}

#[test]
fn a_shock_in_one_sample_is_reported_once_it_was_read() {
    let mut world = World::working();
    world.readings.shock = None;
    world.board.borrow_mut().sample = [100 << 6, 0, 62 << 6];
    world.beats(1);
    world.board.borrow_mut().sample = [0, 0, 62 << 6];
    let shock = world.beats(SECOND).shock.unwrap();
    assert!((shock - 100.0 * 0.016 * 9.80665).abs() < 0.01, "{shock}");
}

proptest! {
    #[test]
    fn from_any_failed_transfers_the_sensors_come_back(
        fails in prop::collection::vec((0_u32..700, 1_u32..60), 1..6)
    ) {
        let mut world = World::new();
        for (after, count) in fails {
            let now = world.board.borrow().transfers;
            world.board.borrow_mut().refuses = now + after..now + after + count;
            while world.board.borrow().transfers < now + after + count {
                let before = world.board.borrow().transfers;
                let readings = world.beats(1);
                let board = world.board.borrow();
                // In each beat the first failed transfer must end the work.
                let failed = (before + 1..=board.transfers).filter(|number| board.refuses.contains(number)).count();
                prop_assert!(failed <= 1);
                prop_assert!(failed == 0 || readings.fault);
            }
        }
        let readings = world.beats(3 * SECOND);
        prop_assert!(readings.climate.is_some() && readings.vibration == Some([0.0; 3]) && !readings.fault);
    }
}
