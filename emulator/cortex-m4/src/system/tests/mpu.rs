//! Tests of the MPU and the default memory map.

use super::*;

const CTRL: u32 = 0xE000_ED94;
const RNR: u32 = 0xE000_ED98;
const RBAR: u32 = 0xE000_ED9C;
const RASR: u32 = 0xE000_EDA0;

/// Configures region `number` with 2^(`size` + 1) bytes at `base` and the access permission `ap`. `extra` has further
/// bits of RASR.
fn region(core: &mut Core<Fast>, board: &mut Board, number: u32, base: u32, size: u32, ap: u32, extra: u32) {
    write(core, board, RBAR, base | 1 << 4 | number);
    write(core, board, RASR, ap << 24 | size << 1 | 1 | extra);
}

#[test]
fn code_runs_only_where_the_default_map_allows_it() {
    let (mut core, _) = machine();
    for address in [0, 0x1FFF_FFFF, 0x2000_0000, 0x6000_0000, 0x8000_0000, 0x9FFF_FFFF] {
        assert!(core.mpu_fetch(address), "{address:#x}");
    }
    for address in [0x4000_0000, 0x5FFF_FFFF, 0xA000_0000, 0xDFFF_FFFF, 0xE000_0000, 0xFFFF_FFFF] {
        assert!(!core.mpu_fetch(address), "{address:#x}");
    }
}

#[test]
fn without_a_region_only_privileged_code_with_privdefena_gets_through() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CTRL, 1);
    assert!(!core.mpu_data(RAM, false, true));
    assert!(core.mpu_data(0xE000_E010, true, true), "the private peripheral bus is exempt");
    write(&mut core, &mut board, CTRL, 5);
    assert!(core.mpu_data(RAM, true, true) && !core.mpu_data(RAM, false, false));
    assert!(core.mpu_fetch(RAM) && !core.mpu_fetch(0x4000_0000));
}

#[test]
fn access_permissions_are_those_of_the_table() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CTRL, 1);
    // Each row has AP and four rights: privileged read and write, and unprivileged read and write.
    for (ap, expected) in [
        (0, [false, false, false, false]),
        (1, [true, true, false, false]),
        (2, [true, true, true, false]),
        (3, [true, true, true, true]),
        (5, [true, false, false, false]),
        (6, [true, false, true, false]),
        (7, [true, false, true, false]),
    ] {
        region(&mut core, &mut board, 0, RAM, 9, ap, 0);
        let allowed = [(false, true), (true, true), (false, false), (true, false)]
            .map(|(write, privileged)| core.mpu_data(RAM + 4, write, privileged));
        assert_eq!(allowed, expected, "AP {ap}");
    }
}

#[test]
fn a_region_ends_where_its_size_says_and_subregions_can_be_off() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CTRL, 1);
    region(&mut core, &mut board, 0, RAM, 7, 3, 1 << (8 + 2));
    // The region has 256 bytes, which are eighths of 32 bytes. The third eighth is off.
    let open = [0x00, 0x3F, 0x40, 0x5F, 0x60].map(|offset| core.mpu_data(RAM + offset, true, false));
    assert_eq!(open, [true, true, false, false, true]);
    assert!(core.mpu_data(RAM + 0xFF, true, false));
    assert!(!core.mpu_data(RAM + 0x100, true, false));
    region(&mut core, &mut board, 0, 0, 31, 3, 0);
    assert!(core.mpu_data(0xDFFF_FFFF, true, false));
}

#[test]
fn where_regions_overlap_the_highest_number_decides() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CTRL, 1);
    region(&mut core, &mut board, 2, RAM, 11, 3, 0);
    region(&mut core, &mut board, 5, RAM, 4, 6, 0);
    assert!(!core.mpu_data(RAM + 31, true, true) && core.mpu_data(RAM + 32, true, true));
    region(&mut core, &mut board, 1, RAM, 4, 3, 0);
    assert!(!core.mpu_data(RAM, true, true));
}

#[test]
fn execute_never_and_no_read_permission_stop_fetches() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CTRL, 1);
    region(&mut core, &mut board, 0, 0, 15, 6, 0);
    assert!(core.mpu_fetch(0x100));
    region(&mut core, &mut board, 0, 0, 15, 6, 1 << 28);
    assert!(!core.mpu_fetch(0x100));
    region(&mut core, &mut board, 0, 0x4000_0000, 15, 3, 0);
    assert!(core.mpu_fetch(0x4000_0000), "a region can make peripheral space executable");
}

#[test]
fn in_hard_fault_the_mpu_is_off_unless_hfnmiena() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, CTRL, 1);
    core.cps(true, false, true);
    assert!(core.mpu_data(RAM, true, true));
    write(&mut core, &mut board, CTRL, 3);
    assert!(!core.mpu_data(RAM, true, true));
}

#[test]
fn the_aliases_write_several_regions_at_once() {
    let (mut core, mut board) = machine();
    for (index, base) in [0x2000_0000u32, 0x3000_0000, 0x4000_0000, 0x5000_0000].into_iter().enumerate() {
        let offset = 8 * index as u32;
        write(&mut core, &mut board, RBAR + offset, base | 1 << 4 | index as u32);
        write(&mut core, &mut board, RASR + offset, 0x0300_0013);
    }
    write(&mut core, &mut board, RNR, 2);
    assert_eq!((read(&mut core, &mut board, RBAR), read(&mut core, &mut board, RASR)), (0x4000_0002, 0x0300_0013));
}

#[test]
fn a_stack_that_the_mpu_refuses_raises_a_memory_stacking_fault() {
    let (mut core, mut board) = machine();
    write(&mut core, &mut board, SHCSR, 1 << 16);
    enable(&mut core, &mut board, 0, 0x80);
    pend(&mut core, &mut board, 0);
    write(&mut core, &mut board, CTRL, 5);
    core.msr(20, 0, 1);
    look(&mut core, &mut board);
    assert_eq!((core.ipsr, core.system.scb.cfsr), (4, 1 << 4), "stacked with the rights of the interrupted code");
}

#[test]
fn a_part_without_an_mpu_has_only_its_default_map() {
    let mut board = Board::new();
    let mut core = Core::<Fast>::new(Config { mpu_regions: 0, ..CONFIG });
    core.power_on(&mut board);
    write(&mut core, &mut board, CTRL, 1);
    assert_eq!((read(&mut core, &mut board, 0xE000_ED90), read(&mut core, &mut board, CTRL)), (0, 0));
    assert!(core.mpu_data(RAM, true, false));
}
