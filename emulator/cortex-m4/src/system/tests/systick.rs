//! Tests of SysTick.

use super::*;

const CSR: u32 = 0xE000_E010;
const RVR: u32 = 0xE000_E014;
const CVR: u32 = 0xE000_E018;

fn running(reload: u32, control: u32) -> (Core<Fast>, Board) {
    let (mut core, mut board) = machine();
    core.cycle = 1003;
    write(&mut core, &mut board, RVR, reload);
    write(&mut core, &mut board, CVR, 0);
    write(&mut core, &mut board, CSR, control);
    (core, board)
}

#[test]
fn it_is_pending_at_the_exact_cycle_every_reload_plus_one() {
    let (mut core, mut board) = running(99, 7);
    assert_eq!(core.system_due(), 1103);
    core.cycle = 1102;
    core.system_advance();
    assert!(!look(&mut core, &mut board));
    core.cycle = 1103;
    core.system_advance();
    assert!(core.attention);
    assert_eq!(core.system_due(), 1203);
    assert!(look(&mut core, &mut board));
    assert_eq!(core.ipsr, 15);
}

#[test]
fn the_value_is_exact_at_every_cycle() {
    let (mut core, mut board) = running(9, 5);
    assert_eq!(core.system_due(), u64::MAX, "without its exception nothing is due");
    let values: Vec<u32> = (0..22)
        .map(|cycle| {
            core.cycle = 1003 + cycle;
            read(&mut core, &mut board, CVR)
        })
        .collect();
    assert_eq!(values, [0, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 9]);
}

#[test]
fn countflag_clears_on_read_but_not_on_a_debuggers() {
    let (mut core, mut board) = running(9, 5);
    core.cycle += 1000;
    assert_eq!(core.debug_read(&mut board, CSR), Ok(0x1_0005));
    assert_eq!(read(&mut core, &mut board, CSR), 0x1_0005);
    assert_eq!(read(&mut core, &mut board, CSR), 5);
}

#[test]
fn a_write_of_the_value_clears_it_and_countflag_without_an_exception() {
    let (mut core, mut board) = running(9, 7);
    core.cycle += 15;
    core.system_advance();
    write(&mut core, &mut board, ICSR, 1 << 25);
    write(&mut core, &mut board, CVR, 0xFFFF);
    assert_eq!((read(&mut core, &mut board, CVR), read(&mut core, &mut board, CSR)), (0, 7));
    assert_eq!(core.system_due(), core.cycle + 10);
    assert!(!look(&mut core, &mut board));
}

#[test]
fn the_reference_ticks_every_so_many_cycles() {
    let (mut core, mut board) = running(9, 3);
    assert_eq!(core.system_due(), 1000 + 80, "the reference runs freely");
    core.cycle = 1008;
    assert_eq!(read(&mut core, &mut board, CVR), 9);
    core.cycle = 1015;
    assert_eq!(read(&mut core, &mut board, CVR), 9);
    core.cycle = 1016;
    assert_eq!(read(&mut core, &mut board, CVR), 8);
}

#[test]
fn without_a_reference_the_processor_clock_is_counted() {
    let mut board = Board::new();
    let mut core = Core::<Fast>::new(Config { systick_reference: 0, ..CONFIG });
    core.power_on(&mut board);
    write(&mut core, &mut board, RVR, 9);
    write(&mut core, &mut board, CSR, 3);
    assert_eq!((read(&mut core, &mut board, CSR), core.system_due()), (7, 10));
}

#[test]
fn a_reload_of_zero_stops_it_at_zero() {
    let (mut core, mut board) = running(9, 7);
    core.cycle += 5;
    write(&mut core, &mut board, RVR, 0);
    assert_eq!(core.system_due(), 1013);
    core.cycle = 1013;
    core.system_advance();
    assert_eq!(core.system_due(), u64::MAX);
    core.cycle = 2000;
    assert_eq!(read(&mut core, &mut board, CVR), 0);
}

#[test]
fn a_stopped_counter_holds_its_value_and_goes_on_from_it() {
    let (mut core, mut board) = running(99, 5);
    core.cycle += 40;
    write(&mut core, &mut board, CSR, 4);
    core.cycle += 1000;
    assert_eq!(read(&mut core, &mut board, CVR), 60);
    write(&mut core, &mut board, CSR, 5);
    core.cycle += 10;
    assert_eq!(read(&mut core, &mut board, CVR), 50);
    assert_eq!(read(&mut core, &mut board, 0xE000_E01C), CONFIG.systick_calibration);
}

#[test]
fn it_counts_in_sleep_and_wakes_the_core() {
    let (mut core, mut board) = running(99, 7);
    core.waiting = Some(false);
    core.cycle += 100;
    core.system_advance();
    assert!(look(&mut core, &mut board));
    assert_eq!((core.waiting, core.ipsr), (None, 15));
}
