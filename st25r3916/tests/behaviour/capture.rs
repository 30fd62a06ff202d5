//! What a real ST25R3916 answered, where its recording is at hand, against the register table.

use std::fs;
use std::path::Path;

use st25r3916::register as reg;

/// The byte that follows `head` on MISO in the recording's first line with it.
fn answered(recording: &str, head: &str) -> u8 {
    let line = recording.lines().find(|line| line.contains(&format!(" {head} 00 | "))).expect("the register was read");
    let last = line.split_whitespace().last().expect("a byte");
    u8::from_str_radix(last, 16).expect("a hexadecimal byte")
}

#[test]
fn the_register_table_agrees_with_what_real_silicon_answered() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data/st25r3916-silicon/Read_All_Registers_SpaceA_B.txt");
    let Ok(recording) = fs::read_to_string(&path) else {
        println!("skipped: no recording of an ST25R3916 at hand");
        return;
    };
    let read = |register: u8| answered(&recording, &format!("{:02x}", 0x40 | register));
    assert_eq!(read(reg::IDENTITY) & reg::IDENTITY_TYPE, reg::IDENTITY_A);
    assert_eq!(read(reg::TRANSMIT_DRIVER), reg::TRANSMIT_DRIVER_12_PERCENT_A);
    assert_eq!(read(reg::IO_CONFIGURATION_1), reg::IO_1_NO_CLOCK);
    // Recorded with `en` set and `tx_en` clear.
    assert_eq!(read(reg::OPERATION_CONTROL) & (reg::OP_EN | reg::OP_TX_EN), reg::OP_EN);
    let display = read(reg::AUXILIARY_DISPLAY) & (reg::DISPLAY_OSC_OK | reg::DISPLAY_TX_ON);
    assert_eq!(display, reg::DISPLAY_OSC_OK);
}
