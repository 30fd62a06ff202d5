//! Compares the register table with a recording of a real ST25R3916, where the recording is available.

use std::path::Path;
use std::{env, fs};

use st25r3916::Variant;
use st25r3916::register as reg;

use crate::stand_in::Chip;

/// Returns the byte that follows `head` on MISO in the recording's first line that contains `head`.
fn answered(recording: &str, head: &str) -> u8 {
    let line = recording.lines().find(|line| line.contains(&format!(" {head} 00 | "))).expect("the register was read");
    let last = line.split_whitespace().last().expect("a byte");
    u8::from_str_radix(last, 16).expect("a hexadecimal byte")
}

/// Returns the public recording of every register of a real ST25R3916. `None` if it is not available; on a build server
/// (`CI` set) the test fails then.
fn recording() -> Option<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data/st25r3916-silicon/Read_All_Registers_SpaceA_B.txt");
    let recording = fs::read_to_string(&path).ok();
    assert!(recording.is_some() || env::var_os("CI").is_none(), "no recording of an ST25R3916 at {}", path.display());
    if recording.is_none() {
        println!("not run: no recording of an ST25R3916 at {}", path.display());
    }
    recording
}

#[test]
fn the_register_table_agrees_with_what_real_silicon_answered() {
    let Some(recording) = recording() else { return };
    let read = |register: u8| answered(&recording, &format!("{:02x}", 0x40 | register));
    assert_eq!(read(reg::IDENTITY) & reg::IDENTITY_TYPE, reg::IDENTITY_A);
    assert_eq!(read(reg::TRANSMIT_DRIVER), reg::TRANSMIT_DRIVER_12_PERCENT_A);
    assert_eq!(read(reg::IO_CONFIGURATION_1), reg::IO_1_NO_CLOCK);
    assert_eq!(read(reg::IO_CONFIGURATION_2), reg::IO_2_MISO | reg::IO_2_ANTENNA_TUNING);
    assert_eq!(read(reg::REGULATOR_CONTROL), reg::REGULATOR_ADJUSTED_MEASURE_VDD);
    // The recorded chip has its oscillator on (`en`) and its transmitter off (`tx_en`).
    assert_eq!(read(reg::OPERATION_CONTROL) & (reg::OP_EN | reg::OP_TX_EN), reg::OP_EN);
    let display = read(reg::AUXILIARY_DISPLAY) & (reg::DISPLAY_OSC_OK | reg::DISPLAY_TX_ON);
    assert_eq!(display, reg::DISPLAY_OSC_OK);
}

#[test]
fn a_recorded_chip_resets_to_the_receive_chain_of_the_stand_in() {
    let Some(recording) = recording() else { return };
    let read = |register: u8| answered(&recording, &format!("{:02x}", 0x40 | register));
    let read_b = |register: u8| answered(&recording, &format!("fb {:02x}", 0x40 | register));
    let mut reset = Chip::new(Variant::A);
    reset.transfer(&[0xC1]);
    for register in [reg::AUXILIARY, reg::RECEIVER_1, reg::RECEIVER_2, reg::RECEIVER_3, reg::RECEIVER_4] {
        assert_eq!(read(register), reset.a[usize::from(register)], "{register:02x}");
    }
    for register in [reg::B_CORRELATOR, reg::B_CORRELATOR + 1] {
        assert_eq!(read_b(register), reset.b[usize::from(register)], "B {register:02x}");
    }
    assert_ne!(read(reg::RECEIVER_1), reg::RECEIVER_1_NFC_F);
    assert_ne!(read(reg::RECEIVER_3), reg::RECEIVER_3_NFC_F);
    assert_ne!([read_b(reg::B_CORRELATOR), read_b(reg::B_CORRELATOR + 1)], reg::CORRELATOR_NFC_F);
}
