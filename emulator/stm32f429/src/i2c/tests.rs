//! Tests of transfers, also with other devices that disturb them.

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

/// Returns an I2C at 100 kHz from 16 MHz, so a bit takes 160 cycles.
fn rig(answers: &[I2cAnswer]) -> Rig<I2c> {
    let mut rig = Rig::new(I2c::new(1));
    rig.connect(Signal::I2c(1, I2cPin::Scl), 1, 6);
    rig.connect(Signal::I2c(1, I2cPin::Sda), 1, 7);
    rig.pads.levels[1] = 0xC0;
    rig.pads.open_drain[1] = 0xC0;
    rig.lines.i2c_answers.extend(answers);
    rig.write(CR2, 16);
    rig.write(0x1C, 80);
    rig.write(CR1, PE);
    rig
}

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

/// Addresses a device for reading and clears ADDR. Afterwards bytes come in.
fn reading(rig: &mut Rig<I2c>) {
    address(rig, 0xA1, ACK);
    rig.read(SR1);
    rig.read(SR2);
}

fn line(rig: &mut Rig<I2c>, pin: I2cPin, high: bool) {
    let bit = if pin == I2cPin::Scl { 0x40 } else { 0x80 };
    rig.pads.levels[1] = rig.pads.levels[1] & !bit | if high { bit } else { 0 };
    rig.input(Signal::I2c(1, pin), high);
}

fn pulse(rig: &mut Rig<I2c>, pin: I2cPin, cycles: u64) {
    line(rig, pin, false);
    rig.run(rig.now + cycles);
    line(rig, pin, true);
}

#[test]
fn with_last_the_final_dma_byte_is_not_acknowledged() {
    let mut rig = rig(&[YES, byte(1), byte(2), byte(3)]);
    rig.write(CR2, 16 | DMAEN | LAST);
    reading(&mut rig);
    for left in [2, 1, 0] {
        rig.run(rig.now + 9 * 160);
        assert_eq!(rig.instance.dma(), 1);
        rig.read(DR);
        rig.call(|i2c, cx| i2c.dma_served(0, left, cx));
    }
    rig.run(rig.now + 100_000);
    let reads = [I2cEvent::Read(true), I2cEvent::Read(true), I2cEvent::Read(false)];
    assert_eq!(events(&rig)[1..], reads);
}

#[test]
fn without_last_the_final_dma_byte_is_acknowledged_and_reading_continues() {
    let mut rig = rig(&[YES, byte(1), byte(2), byte(3), byte(4)]);
    rig.write(CR2, 16 | DMAEN);
    reading(&mut rig);
    for left in [1, 0] {
        rig.run(rig.now + 9 * 160);
        rig.read(DR);
        rig.call(|i2c, cx| i2c.dma_served(0, left, cx));
    }
    rig.run(rig.now + 100_000);
    assert_eq!(events(&rig)[1..], [I2cEvent::Read(true); 4]);
    assert_eq!(rig.read(SR1), RXNE | BTF);
}

#[test]
fn a_held_bus_is_busy_and_a_start_waits_indefinitely() {
    for pin in [I2cPin::Scl, I2cPin::Sda] {
        let mut rig = rig(&[YES]);
        line(&mut rig, pin, false);
        assert_eq!(rig.read(SR2), BUSY);
        rig.write(CR1, PE | START);
        rig.run(rig.now + 1_000_000);
        assert_eq!((rig.read(SR1), rig.read(SR2), rig.read(CR1)), (0, BUSY, PE | START), "{pin:?}");
        assert!(rig.lines.i2c.is_empty());
    }
}

#[test]
fn busy_ends_with_a_stop_and_not_with_a_released_clock() {
    let mut rig = rig(&[YES]);
    pulse(&mut rig, I2cPin::Sda, 1_000);
    assert_eq!(rig.read(SR2), 0, "SDA that rises while SCL is high is a stop");
    pulse(&mut rig, I2cPin::Scl, 1_000);
    assert_eq!(rig.read(SR2), BUSY);
    rig.write(CR1, 0);
    assert_eq!(rig.read(SR2), BUSY, "BUSY is kept up without PE");
    rig.write(CR1, SWRST);
    rig.write(CR1, 0);
    assert_eq!(rig.read(SR2), 0);
    line(&mut rig, I2cPin::Scl, false);
    rig.write(CR1, SWRST);
    assert_eq!(rig.read(SR2), 0);
    rig.write(CR1, 0);
    assert_eq!(rig.read(SR2), BUSY, "the line is still low");
}

#[test]
fn nothing_is_written_into_an_i2c_that_is_held_in_reset() {
    let mut rig = rig(&[]);
    rig.write(CR1, SWRST);
    rig.write(CR2, 16);
    assert_eq!(rig.read(CR2), 0);
    assert!(rig.found("while CR1.SWRST is set"));
    rig.write(CR1, 0);
    rig.write(CR2, 16);
    assert_eq!(rig.read(CR2), 16);
}

#[test]
fn a_start_during_a_stray_stop_needs_a_software_reset() {
    let mut rig = rig(&[YES]);
    line(&mut rig, I2cPin::Sda, false);
    rig.write(CR1, PE | START);
    line(&mut rig, I2cPin::Sda, true);
    rig.run(rig.now + 1_000_000);
    assert_eq!((rig.read(SR1), rig.read(SR2)), (0, 0));
    rig.write(CR1, SWRST);
    rig.write(CR1, 0);
    rig.write(CR2, 16);
    rig.write(0x1C, 80);
    rig.write(CR1, PE | START);
    rig.run(rig.now + 160);
    assert_eq!(rig.read(SR1), SB);
}

#[test]
fn a_clock_that_somebody_holds_delays_the_byte_by_as_long() {
    let mut rig = rig(&[YES]);
    rig.write(CR1, PE | START);
    rig.run(rig.now + 160);
    rig.read(SR1);
    rig.write(DR, 0xA0);
    let ends = rig.now + 9 * 160;
    rig.run(rig.now + 500);
    pulse(&mut rig, I2cPin::Scl, 12_345);
    rig.run(ends + 12_344);
    assert_eq!(rig.read(SR1), 0);
    rig.run(ends + 12_345);
    assert_eq!(rig.read(SR1), ADDR);
}

#[test]
fn only_a_software_reset_ends_a_transfer_whose_clock_is_held() {
    let mut rig = rig(&[YES, byte(1)]);
    reading(&mut rig);
    rig.run(rig.now + 700);
    line(&mut rig, I2cPin::Scl, false);
    rig.write(CR1, PE | STOP);
    rig.run(rig.now + 10_000_000);
    assert_eq!((rig.read(SR1), rig.read(SR2), rig.read(CR1)), (0, MSL | BUSY, PE | STOP));
    assert_eq!(events(&rig).len(), 1);
    rig.write(CR1, SWRST);
    rig.write(CR1, 0);
    assert_eq!(rig.read(SR2), BUSY);
    assert_eq!(rig.instance.due(), NEVER);
}

#[test]
fn a_step_that_begins_while_the_clock_is_held_waits_for_it() {
    let mut rig = rig(&[YES, byte(7)]);
    address(&mut rig, 0xA1, ACK);
    line(&mut rig, I2cPin::Scl, false);
    rig.read(SR1);
    rig.read(SR2);
    rig.run(rig.now + 100_000);
    line(&mut rig, I2cPin::Scl, true);
    rig.run(rig.now + 9 * 160 - 1);
    assert_eq!(rig.read(SR1), 0);
    rig.run(rig.now + 1);
    assert_eq!((rig.read(SR1) & RXNE, rig.read(DR)), (RXNE, 7));
}

#[test]
fn a_one_pulled_to_zero_loses_arbitration_at_that_bit() {
    let mut rig = rig(&[YES, YES]);
    rig.write(CR2, 16 | ITERREN);
    address(&mut rig, 0xA0, 0);
    rig.read(SR1);
    rig.read(SR2);
    // The byte is 0001 0000. Its fourth bit is the first one that is 1, and is sampled after three quarters of the
    // bit's time.
    rig.write(DR, 0x10);
    let began = rig.now;
    rig.run(began + 200);
    line(&mut rig, I2cPin::Sda, false);
    rig.run(began + 3 * 160 + 119);
    assert_eq!(rig.read(SR1) & (ARLO | BERR), 0, "zeros are right");
    rig.run(began + 3 * 160 + 120);
    assert_eq!((rig.read(SR1), rig.read(SR2)), (ARLO, BUSY));
    assert_eq!(rig.instance.irq(), 2);
    assert_eq!(events(&rig), [I2cEvent::Start(0xA0)], "the byte has not come to its end");
    rig.write(SR1, !ARLO);
    assert_eq!(rig.read(SR1), 0);
}

#[test]
fn an_sda_pulse_is_a_bus_error_only_while_scl_is_high() {
    for (after, berr) in [(2 * 160 + 10, 0), (2 * 160 + 90, BERR)] {
        let mut rig = rig(&[YES, YES]);
        address(&mut rig, 0xA0, 0);
        rig.read(SR1);
        rig.read(SR2);
        rig.write(DR, 0xFF);
        let began = rig.now;
        rig.run(began + after);
        pulse(&mut rig, I2cPin::Sda, 20);
        rig.run(began + 9 * 160);
        assert_eq!(rig.read(SR1), TXE | BTF | berr, "the transfer goes on");
        assert_eq!(events(&rig)[1..], [I2cEvent::Write(0xFF)]);
    }
}

#[test]
fn a_zero_that_somebody_makes_is_read_as_one() {
    let mut rig = rig(&[YES, byte(0xFF)]);
    reading(&mut rig);
    rig.run(rig.now + 160 + 20);
    pulse(&mut rig, I2cPin::Sda, 2 * 160);
    rig.run(rig.now + 8 * 160);
    assert_eq!(rig.read(DR), 0b1001_1111);
}

#[test]
fn a_stop_waits_for_sda() {
    let mut rig = rig(&[YES, byte(0)]);
    reading(&mut rig);
    rig.run(rig.now + 100);
    line(&mut rig, I2cPin::Sda, false);
    rig.write(CR1, PE | STOP);
    rig.run(rig.now + 1_000_000);
    assert_eq!(rig.read(CR1), PE | STOP);
    assert_eq!(rig.read(SR2) & BUSY, BUSY);
    line(&mut rig, I2cPin::Sda, true);
    rig.run(rig.now + 1_000);
    assert_eq!((rig.read(CR1), rig.read(SR2)), (PE, 0));
}

#[test]
fn an_i2c_that_is_disabled_in_a_transfer_leaves_the_bus_busy() {
    let mut rig = rig(&[YES]);
    address(&mut rig, 0xA0, 0);
    rig.write(CR1, 0);
    assert_eq!(rig.read(SR2), BUSY);
}

#[test]
fn a_pin_that_is_no_open_drain_is_found() {
    let mut rig = rig(&[YES]);
    rig.pads.open_drain[1] = 0x40;
    rig.write(CR1, PE | START);
    assert!(rig.found("no open drain"));
}
