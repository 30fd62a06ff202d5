//! Tests of the registers of the system control block: identification, keys, privileges, and absent registers.

use super::*;

#[test]
fn identification_registers_are_those_of_a_cortex_m4_with_fpu() {
    let (mut core, mut board) = machine();
    for (address, value) in [
        (0xE000_ED00, 0x410F_C241),
        (0xE000_ED40, 0x30),
        (0xE000_ED44, 0x200),
        (0xE000_ED48, 0x0010_0000),
        (0xE000_ED50, 0x0010_0030),
        (0xE000_ED60, 0x0114_1110),
        (0xE000_ED68, 0x2123_2231),
        (0xE000_EF40, 0x1011_0021),
        (0xE000_EF44, 0x1100_0011),
        (0xE000_ED90, 0x800),
        (0xE00F_F000, 0xFFF0_F003),
        (0xE000_EFF0, 0x0D),
        (0xE000_EFE0, 0x0C),
    ] {
        assert_eq!(read(&mut core, &mut board, address), value, "{address:#x}");
    }
    assert!(core.take_unmodelled().is_empty());
}

#[test]
fn aircr_needs_its_key() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, AIRCR, 0x1234_0704);
    assert_eq!(read(&mut core, &mut board, AIRCR), 0xFA05_0000);
    assert!(!core.take_reset_request());
    write(&mut core, &mut board, AIRCR, 0x05FA_0504);
    assert_eq!(read(&mut core, &mut board, AIRCR), 0xFA05_0500);
    assert!(core.take_reset_request());
    assert!(!core.take_reset_request());
}

#[test]
fn the_vector_reset_is_the_debuggers() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, AIRCR, 0x05FA_0001);
    assert!(!core.take_reset_request());
}

#[test]
fn ccr_keeps_the_bits_it_has_and_starts_with_stkalign() {
    let (mut core, mut board) = machine();
    assert_eq!(read(&mut core, &mut board, CCR), 0x200);
    write(&mut core, &mut board, CCR, u32::MAX);
    assert_eq!(read(&mut core, &mut board, CCR), 0x31B);
}

#[test]
fn priorities_of_system_handlers_that_do_not_exist_read_zero() {
    let (mut core, mut board) = machine();
    for address in [SHPR1, SHPR2, SHPR3] {
        write(&mut core, &mut board, address, u32::MAX);
    }
    assert_eq!(read(&mut core, &mut board, SHPR1), 0x00F0_F0F0);
    assert_eq!(read(&mut core, &mut board, SHPR2), 0xF000_0000);
    assert_eq!(read(&mut core, &mut board, SHPR3), 0xF0F0_00F0);
}

#[test]
fn unprivileged_code_takes_a_bus_fault_from_everything_but_the_itm() {
    let (mut core, mut board) = machine();
    core.msr(20, 0, 1);
    for address in [ICSR, ISER, 0xE000_E010, 0xE000_1000, 0xE00F_F000] {
        let access = access(&core, address, Width::Word);
        assert_eq!(core.system_read(&mut board, &access), Err(Fault::BusData(address)));
        assert_eq!(core.system_write(&mut board, &access, 0), Err(Fault::BusData(address)));
    }
    assert_eq!(read(&mut core, &mut board, 0xE000_0000), 1);
    write(&mut core, &mut board, 0xE000_0000, 0x41);
}

#[test]
fn start_up_code_finds_the_trace_units() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, 0xE000_EDFC, 1 << 24);
    assert_eq!(read(&mut core, &mut board, 0xE000_EDFC), 1 << 24);
    write(&mut core, &mut board, 0xE000_0E80, 1);
    assert_eq!(read(&mut core, &mut board, 0xE000_0E80), 0, "locked");
    write(&mut core, &mut board, 0xE000_0FB0, 0xC5AC_CE55);
    write(&mut core, &mut board, 0xE000_0E80, 1);
    assert_eq!(read(&mut core, &mut board, 0xE000_0E80), 1);
    write(&mut core, &mut board, 0xE000_1FB0, 0xC5AC_CE55);
    write(&mut core, &mut board, 0xE004_0010, 99);
    assert_eq!(read(&mut core, &mut board, 0xE004_0010), 99);
    let byte = access(&core, 0xE000_0004, Width::Byte);
    core.system_write(&mut board, &byte, 0x55).unwrap();
    assert!(core.take_unmodelled().is_empty());
}

#[test]
fn an_unmodelled_register_is_reported_once_and_reads_zero() {
    let (mut core, mut board) = machine();
    core.cycle = 77;
    assert_eq!(read(&mut core, &mut board, 0xE000_3000), 0);
    write(&mut core, &mut board, 0xE000_3000, 1);
    write(&mut core, &mut board, 0xE000_EFA0, 1);
    let narrow = access(&core, ISER, Width::Byte);
    core.system_write(&mut board, &narrow, 1).unwrap();
    assert_eq!(read(&mut core, &mut board, ISER), 0, "too narrow: ignored");
    let list = [(0xE000_3000, START, 77), (0xE000_EFA0, START, 77), (ISER, START, 77)];
    assert_eq!(core.take_unmodelled(), list);
    read(&mut core, &mut board, 0xE000_3000);
    assert!(core.take_unmodelled().is_empty());
}

#[test]
fn a_system_reset_clears_the_nvic_but_not_the_cycle_counter() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, 0xE000_EDFC, 1 << 24);
    write(&mut core, &mut board, 0xE000_1000, 1);
    enable(&mut core, &mut board, 0, 0x80);
    core.cycle += 500;
    core.reset(&mut board);
    assert_eq!(read(&mut core, &mut board, ISER), 0);
    assert_eq!(read(&mut core, &mut board, 0xE000_1004), 500);
    core.power_on(&mut board);
    assert_eq!(read(&mut core, &mut board, 0xE000_1004), 0);
    assert_eq!(core.cycle, 500);
}
