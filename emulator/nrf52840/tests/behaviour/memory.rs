//! Tests of NVMC and RNG.
use crate::rig::*;
use cortex_m4::Width;
use emulator_part::FindingKind;
use nrf52840::Settings;

const PAGE: u32 = 0x0000_8000;

#[test]
fn a_word_is_programmed_by_clearing_bits_and_flash_is_busy_meanwhile() {
    let mut rig = Rig::new();
    rig.write(NVMC + 0x504, 1);
    assert!(rig.try_write(PAGE, Width::Word, 0xFFFF_00FF));
    assert_eq!(rig.read(NVMC + 0x400), 0);
    rig.run_for(41 * US);
    assert_eq!(rig.read(NVMC + 0x400), 1);
    assert!(rig.try_write(PAGE, Width::Word, 0x1234_5678));
    assert_eq!(rig.memory(PAGE, 4), 0x1234_0078_u32.to_le_bytes(), "bits only go from 1 to 0");
    rig.assert_clean();
}

#[test]
fn a_page_is_erased_alone() {
    let mut rig = Rig::new();
    rig.write(NVMC + 0x504, 1);
    for address in [PAGE - 4, PAGE, PAGE + 4092, PAGE + 4096] {
        assert!(rig.try_write(address, Width::Word, 0));
        rig.run_for(41 * US);
    }
    rig.write(NVMC + 0x504, 2);
    rig.write(NVMC + 0x508, PAGE);
    assert_eq!(rig.read(NVMC + 0x400), 0);
    assert_eq!(rig.memory(PAGE, 4096), [0xFF; 4096]);
    assert_eq!(rig.memory(PAGE - 4, 4), [0; 4]);
    assert_eq!(rig.memory(PAGE + 4096, 4), [0; 4]);
    rig.run_for(85 * MS);
    assert_eq!(rig.read(NVMC + 0x400), 1);
    rig.assert_clean();
}

#[test]
fn flash_faults_where_it_is_not_enabled_or_not_written_in_words() {
    let mut rig = Rig::new();
    assert!(!rig.try_write(PAGE, Width::Word, 0), "CONFIG is read-only");
    rig.write(NVMC + 0x504, 1);
    assert!(!rig.try_write(PAGE, Width::Byte, 0));
    assert_eq!(rig.memory(PAGE, 4), [0xFF; 4]);
    rig.write(NVMC + 0x508, PAGE);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 3, "an erase without CONFIG.EEN does nothing");
}

#[test]
fn uicr_is_programmed_like_flash_and_everything_erased_at_once() {
    let mut rig = Rig::new();
    rig.write(NVMC + 0x504, 1);
    assert!(rig.try_write(0x1000_1200, Width::Word, 18));
    rig.run_for(41 * US);
    assert!(rig.try_write(0, Width::Word, 0));
    rig.run_for(41 * US);
    rig.write_all(&[(NVMC + 0x504, 2), (NVMC + 0x50C, 1)]);
    assert_eq!(rig.memory(0, 4), [0xFF; 4]);
    rig.assert_clean();
}

fn numbers(seed: u64, n: usize) -> (Vec<u32>, u64) {
    let mut rig = Rig::with(Settings { seed, ..Settings::default() });
    rig.write(RNG, 1);
    let numbers = (0..n)
        .map(|_| {
            rig.run_until_set(RNG + 0x100, 100 * MS);
            rig.write(RNG + 0x100, 0);
            rig.read(RNG + 0x508)
        })
        .collect();
    (numbers, rig.now)
}

#[test]
fn random_numbers_follow_from_the_seed_alone() {
    let (first, at) = numbers(7, 64);
    assert_eq!(numbers(7, 64).0, first);
    assert_ne!(numbers(8, 64).0, first);
    assert_eq!(at, 128 * US + 64 * 30 * US);
}
