//! Transfers as the manual has them, and what stands in their way.

use super::*;
use crate::rig::Rig;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const DR: u32 = 0x10;
const SR1: u32 = 0x14;
const SR2: u32 = 0x18;

const YES: I2cAnswer = I2cAnswer { acknowledged: true, data: 0xFF, stretched_ns: 0 };

fn byte(data: u8) -> I2cAnswer {
    I2cAnswer { data, ..YES }
}

/// 100 kHz of 16 MHz: a bit takes 160 cycles.
fn rig(answers: &[I2cAnswer]) -> Rig<I2c> {
    let mut rig = Rig::new(I2c::new(1));
    rig.connect(Signal::I2c(1, I2cPin::Scl), 1, 6);
    rig.connect(Signal::I2c(1, I2cPin::Sda), 1, 7);
    rig.lines.i2c_answers.extend(answers);
    rig.write(CR2, 16);
    rig.write(0x1C, 80);
    rig.write(CR1, PE);
    rig
}

/// A start and the address byte, up to ADDR or AF.
fn address(rig: &mut Rig<I2c>, byte: u32, bits: u32) {
    rig.write(CR1, PE | START | bits);
    rig.run(rig.now + 160);
    assert_eq!(rig.read(SR1) & SB, SB);
    rig.write(DR, byte);
    rig.run(rig.now + 9 * 160);
}

fn events(rig: &Rig<I2c>) -> Vec<I2cEvent> {
    rig.lines.i2c.iter().map(|&(_, event)| event).collect()
}

#[test]
fn a_transmitter_sends_its_bytes_and_holds_the_clock_between_them() {
    let mut rig = rig(&[YES, YES, YES]);
    address(&mut rig, 0xA0, 0);
    assert_eq!(rig.read(SR1), ADDR);
    rig.run(rig.now + 100_000);
    assert_eq!(rig.read(SR2), MSL | BUSY | TRA);
    assert_eq!(rig.read(SR1), TXE);
    rig.write(DR, 1);
    rig.write(DR, 2);
    assert_eq!(rig.read(SR1), 0);
    let first = rig.now + 9 * 160;
    rig.run(first);
    assert_eq!(rig.read(SR1), TXE);
    rig.run(first + 9 * 160);
    assert_eq!(rig.read(SR1), TXE | BTF);
    rig.write(CR1, PE | STOP);
    rig.run(rig.now + 160);
    assert_eq!((rig.read(SR1), rig.read(SR2), rig.read(CR1)), (0, 0, PE));
    assert_eq!(events(&rig), [I2cEvent::Start(0xA0), I2cEvent::Write(1), I2cEvent::Write(2), I2cEvent::Stop]);
    assert_eq!(rig.lines.i2c[1].0, first);
}

#[test]
fn an_address_that_is_not_acknowledged_sets_af_alone() {
    let mut rig = rig(&[]);
    address(&mut rig, 0xA0, 0);
    assert_eq!(rig.read(SR1), AF);
    rig.write(SR1, !AF);
    assert_eq!(rig.read(SR1), 0);
    rig.write(CR1, PE | STOP);
    rig.run(rig.now + 160);
    assert_eq!(rig.read(SR2), 0);
}

#[test]
fn one_byte_is_received_without_acknowledge_and_followed_by_the_stop() {
    let mut rig = rig(&[YES, byte(0x42)]);
    address(&mut rig, 0xA1, ACK);
    rig.write(CR1, PE);
    rig.read(SR1);
    rig.read(SR2);
    rig.write(CR1, PE | STOP);
    rig.run(rig.now + 10 * 160);
    assert_eq!(rig.read(SR1), RXNE);
    assert_eq!(rig.read(DR), 0x42);
    assert_eq!(events(&rig), [I2cEvent::Start(0xA1), I2cEvent::Read(false), I2cEvent::Stop]);
}

#[test]
fn with_pos_the_second_of_two_bytes_is_the_one_not_acknowledged() {
    let mut rig = rig(&[YES, byte(1), byte(2)]);
    address(&mut rig, 0xA1, ACK | POS);
    rig.read(SR1);
    rig.read(SR2);
    rig.write(CR1, PE | POS);
    rig.run(rig.now + 100_000);
    assert_eq!(rig.read(SR1), RXNE | BTF);
    rig.write(CR1, PE | STOP);
    assert_eq!((rig.read(DR), rig.read(DR)), (1, 2));
    rig.run(rig.now + 1000);
    let expected = [I2cEvent::Start(0xA1), I2cEvent::Read(true), I2cEvent::Read(false), I2cEvent::Stop];
    assert_eq!(events(&rig), expected);
}

#[test]
fn a_receiver_that_is_not_read_holds_the_clock_with_two_bytes() {
    let mut rig = rig(&[YES, byte(1), byte(2), byte(3)]);
    address(&mut rig, 0xA1, ACK);
    rig.read(SR1);
    rig.read(SR2);
    rig.run(rig.now + 100_000);
    assert_eq!(rig.lines.i2c.len(), 3);
    assert_eq!(rig.read(DR), 1);
    rig.run(rig.now + 9 * 160);
    assert_eq!(rig.lines.i2c.len(), 4);
    assert_eq!(rig.read(DR), 2);
    assert_eq!(rig.read(DR), 3);
}

#[test]
fn a_stretched_clock_delays_the_flags() {
    let mut rig = rig(&[I2cAnswer { stretched_ns: 10_000, ..YES }]);
    address(&mut rig, 0xA0, 0);
    assert_eq!(rig.read(SR1), 0);
    rig.run(rig.now + 160);
    assert_eq!(rig.read(SR1), ADDR);
}

#[test]
fn without_pe_or_pins_no_start_happens() {
    let mut rig = rig(&[YES]);
    rig.write(CR1, 0);
    rig.write(CR1, START);
    rig.run(100_000);
    assert_eq!(rig.read(SR1), 0);
    rig.pads = crate::cx::Pads::OPEN;
    rig.write(CR1, PE | START);
    rig.run(200_000);
    assert_eq!(rig.read(SR1), 0);
    assert!(rig.found("without both pins"));
}

#[test]
fn a_software_reset_frees_the_bus() {
    let mut rig = rig(&[YES]);
    address(&mut rig, 0xA0, 0);
    rig.write(CR1, SWRST);
    rig.write(CR1, 0);
    assert_eq!((rig.read(SR1), rig.read(SR2), rig.read(0x1C)), (0, 0, 0));
}
