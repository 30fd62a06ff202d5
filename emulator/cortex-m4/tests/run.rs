//! Tests of the run loop: time, stops, breakpoints, code that changes, sleep, wait states.

use crate::common;

use common::{CODE, DEVICE, RAM, Rig};
use cortex_m4::{Cost, Exit, Fast, Optimistic, Pessimistic, Register};

/// The code is: movs r0, #10; loop: subs r0, #1; bne loop; b .
const COUNT: &[u16] = &[0x200A, 0x3801, 0xD1FD, 0xE7FE];

#[test]
fn a_loop_counts_down_and_costs_a_cycle_for_each_halfword() {
    let mut rig = Rig::new(COUNT);
    assert_eq!(rig.core.run(&mut rig.board, 21), Exit::Until);
    assert_eq!((rig.r(0), rig.core.cycle(), rig.core.pc()), (0, 21, CODE + 6));
    assert_eq!(rig.core.retired(), 21);
}

#[test]
fn the_bounds_count_the_refills_of_branches() {
    let mut best = Rig::<Optimistic>::with_clock(COUNT);
    let mut worst = Rig::<Pessimistic>::with_clock(COUNT);
    best.steps(21);
    worst.steps(21);
    // The instructions are a movs, 10 subs, and 10 bne of which 9 are taken.
    assert_eq!((best.core.cycle(), worst.core.cycle()), (21 + 9, 21 + 27));
}

#[test]
fn each_word_of_code_is_fetched_once_and_waits_add_up() {
    // The code is: nop; nop; nop.w; nop.
    let mut rig = Rig::<Optimistic>::with_clock(&[0xBF00, 0xBF00, 0xF3AF, 0x8000, 0xBF00]);
    rig.board.waits = 2;
    rig.steps(4);
    assert_eq!(rig.board.fetches, [CODE, CODE + 4, CODE + 8]);
    assert_eq!(rig.core.cycle(), 4 + 6);
}

#[test]
fn the_bus_is_advanced_when_it_is_due() {
    let mut rig = Rig::new(COUNT);
    rig.board.due = 7;
    assert_eq!(rig.core.run(&mut rig.board, 15), Exit::Until);
    assert_eq!(rig.board.advanced, [7]);
}

/// The code is: cpsie i; wfi; b to the wfi.
const SLEEP: &[u16] = &[0xB662, 0xBF30, 0xE7FD];

#[test]
fn a_core_that_hangs_executes_nothing_until_it_is_reset() {
    let mut rig = Rig::new(COUNT);
    rig.core.run(&mut rig.board, 7);
    rig.core.hang();
    let (pc, retired) = (rig.core.pc(), rig.core.retired());
    rig.board.due = 50;
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
    assert_eq!((rig.core.pc(), rig.core.retired(), rig.core.cycle()), (pc, retired, 100));
    assert_eq!((rig.board.advanced.as_slice(), rig.core.idle(), rig.core.is_hung()), (&[50][..], 93, true));
    assert_eq!(rig.core.run_one(&mut rig.board, 120), Exit::Until);
    assert_eq!(rig.core.step(&mut rig.board), Exit::Until);
    assert_eq!((rig.core.pc(), rig.core.retired()), (pc, retired));
    let cycle = rig.core.cycle();
    rig.core.reset(&mut rig.board);
    assert!(!rig.core.is_hung());
    rig.core.run(&mut rig.board, cycle + 7);
    assert_eq!((rig.core.pc(), rig.core.retired()), (pc, 2 * retired), "it begins anew");
}

#[test]
fn a_core_that_hangs_takes_no_interrupt_and_no_nmi() {
    for (code, asleep) in [(COUNT, false), (SLEEP, true)] {
        for nmi in [false, true] {
            let run = |hung: bool| {
                let mut rig = Rig::new(code);
                // The handler is: b .
                let handler = CODE + 0x100;
                rig.board.flash[handler as usize..][..2].copy_from_slice(&[0xFE, 0xE7]);
                for vector in [0x08, 0x40] {
                    rig.board.flash[vector..vector + 4].copy_from_slice(&(handler | 1).to_le_bytes());
                }
                rig.core.debug_write(&mut rig.board, 0xE000_E100, 1).unwrap();
                rig.core.run(&mut rig.board, 7);
                assert_eq!(rig.core.is_asleep(), asleep);
                if hung {
                    rig.core.hang();
                }
                let retired = rig.core.retired();
                rig.board.signals.drive_nmi(nmi);
                rig.board.signals.drive_line(0, !nmi);
                rig.core.run(&mut rig.board, 40);
                let pending = rig.core.debug_read(&mut rig.board, 0xE000_ED04).unwrap();
                (rig.core.exception_changes() > 0, rig.core.retired() > retired, rig.core.is_asleep(), pending)
            };
            let (entered, executed, slept, _) = run(false);
            assert!(entered && executed && !slept, "{asleep} {nmi}");
            let (entered, executed, slept, pending) = run(true);
            assert_eq!((entered, executed, slept), (false, false, asleep), "{nmi}");
            assert_ne!(pending & if nmi { 1 << 31 } else { 1 << 22 }, 0, "what came is pending: {pending:#x}");
        }
    }
}

#[test]
fn an_access_that_wants_to_stop_ends_the_run_after_its_instruction() {
    // The code is: ldr r1, [r0]; movs r2, #1.
    let mut rig = Rig::new(&[0x6801, 0x2201, 0xE7FE]);
    rig.board.stop_at = Some(DEVICE);
    rig.board.answer = 5;
    rig.set(0, DEVICE);
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Stopped);
    assert_eq!((rig.r(1), rig.core.pc(), rig.core.cycle()), (5, CODE + 2, 1));
    assert_eq!(rig.board.reads, [(DEVICE, 4, 0)]);
}

#[test]
fn a_breakpoint_stops_before_its_instruction_which_runs_next() {
    let mut rig = Rig::new(COUNT);
    rig.core.set_breakpoint(CODE + 2);
    for left in [10, 9, 8] {
        assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Breakpoint);
        assert_eq!((rig.r(0), rig.core.pc()), (left, CODE + 2));
    }
    assert_eq!(rig.core.retired(), 5);
    rig.core.clear_breakpoint(CODE + 2);
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
    assert_eq!(rig.core.pc(), CODE + 6);
}

#[test]
fn a_semihosting_call_is_answered_by_the_caller() {
    // The code is: movs r0, #5; bkpt 0xAB; adds r0, #1; b .
    let mut rig = Rig::new(&[0x2005, 0xBEAB, 0x3001, 0xE7FE]);
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::HostCall);
    assert_eq!((rig.core.host_call().0, rig.core.pc()), (5, CODE + 2));
    rig.core.finish_host_call(Some(40));
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
    assert_eq!((rig.r(0), rig.core.pc()), (41, CODE + 6));
}

/// Returns two cores. Each has code at byte 0x200 of its RAM, and branches to that code by r4. The first core's board
/// can watch RAM for writes, the second's cannot.
fn in_ram(code: &[u16]) -> [Rig<Fast>; 2] {
    [true, false].map(|watches| {
        let mut rig = Rig::new(&[0x4720]);
        rig.board.watches = watches;
        for (index, half) in code.iter().enumerate() {
            rig.board.ram[0x200 + 2 * index..][..2].copy_from_slice(&half.to_le_bytes());
        }
        rig.set(4, RAM + 0x201);
        rig
    })
}

#[test]
fn code_in_ram_is_executed_as_memory_holds_it_now() {
    // The code is: movs r0, #1; strh r1, [r2]; bx r3 (back to the start). r1 holds the encoding of movs r0, #2.
    for mut rig in in_ram(&[0x2001, 0x8011, 0x4718]) {
        rig.set(1, 0x2002).set(2, RAM + 0x200).set(3, RAM + 0x201);
        assert_eq!(rig.core.run(&mut rig.board, 4), Exit::Until);
        assert_eq!(rig.r(0), 1);
        assert_eq!(rig.core.run(&mut rig.board, 5), Exit::Until);
        assert_eq!(rig.r(0), 2);
    }
}

#[test]
fn a_loop_in_ram_that_rewrites_itself_executes_as_rewritten() {
    // The code is: loop: movw r0, #1; add r5, r0; adds r1, #1; strh r1, [r2]; adds r6, #1; cmp r6, #8; bne loop; b .
    for mut rig in in_ram(&[0xF240, 0x0001, 0x4405, 0x3101, 0x8011, 0x3601, 0x2E08, 0xD1F7, 0xE7FE]) {
        rig.set(1, 1).set(2, RAM + 0x202).set(5, 0).set(6, 0);
        assert_eq!(rig.core.run(&mut rig.board, 200), Exit::Until);
        assert_eq!((rig.r(5), rig.r(6)), ((1..=8).sum(), 8));
        rig.board.set_word(RAM + 0x200, 0x0064_F240);
        rig.board.set_word(RAM + 0x204, 0x3101_1A2D);
        rig.set(15, RAM + 0x200).set(5, 1000).set(6, 7);
        assert_eq!(rig.core.run(&mut rig.board, 240), Exit::Until);
        assert_eq!(rig.r(5), 900, "subs r5, r5, r0");
    }
}

#[test]
fn code_that_keeps_writing_to_its_own_page_executes_as_rewritten() {
    // The code is: loop: movw r0, #0; adds r1, #1; strh r1, [r2]; adds r5, r5, r0; b loop. r1 holds the second halfword
    // of movw.
    for mut rig in in_ram(&[0xF240, 0x0000, 0x3101, 0x8011, 0x182D, 0xE7F9]) {
        rig.set(1, 0).set(2, RAM + 0x202).set(5, 0);
        assert_eq!(rig.core.run(&mut rig.board, 1 + 6 * 200), Exit::Until);
        // A halfword below 256 is movw's immediate. So each turn adds the number that the turn before has written
        // there.
        assert_eq!((rig.r(1), rig.r(5)), (200, (0..200).sum()));
    }
}

#[test]
fn a_page_rewritten_too_often_is_watched_again_after_a_reset() {
    // The code is the one of the test before; its page is at RAM.
    let [mut rig, _] = in_ram(&[0xF240, 0x0000, 0x3101, 0x8011, 0x182D, 0xE7F9]);
    rig.set(1, 0).set(2, RAM + 0x202).set(5, 0);
    assert_eq!(rig.core.run(&mut rig.board, 1 + 6 * 200), Exit::Until);
    assert!(!rig.board.watched.contains(&(RAM >> 10)));
    rig.core.reset(&mut rig.board);
    rig.set(1, 0).set(2, RAM + 0x602).set(4, RAM + 0x201).set(5, 0);
    let cycle = rig.core.cycle();
    assert_eq!(rig.core.run(&mut rig.board, cycle + 100), Exit::Until);
    assert!(rig.board.watched.contains(&(RAM >> 10)));
}

#[test]
fn an_instruction_across_two_ram_pages_executes_as_rewritten() {
    for mut rig in in_ram(&[0xBF00]) {
        // The code from 0x3FC on is: nop; movw r0, #1 across 0x400; bx r3 (back to the nop).
        rig.board.set_word(RAM + 0x3FC, 0xF240_BF00);
        rig.board.set_word(RAM + 0x400, 0x4718_0001);
        rig.set(4, RAM + 0x3FD).set(3, RAM + 0x3FD);
        assert_eq!(rig.core.run(&mut rig.board, 20), Exit::Until);
        assert_eq!(rig.r(0), 1);
        rig.board.set_word(RAM + 0x400, 0x4718_0002);
        assert_eq!(rig.core.run(&mut rig.board, 40), Exit::Until);
        assert_eq!(rig.r(0), 2);
    }
}

#[test]
fn a_breakpoint_in_ram_is_met_in_a_loop_that_ran_before() {
    // The code is: loop: adds r0, #1; adds r1, #1; b loop.
    for mut rig in in_ram(&[0x3001, 0x3101, 0xE7FC]) {
        rig.set(0, 0).set(1, 0);
        assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
        rig.core.set_breakpoint(RAM + 0x202);
        assert_eq!(rig.core.run(&mut rig.board, 200), Exit::Breakpoint);
        assert_eq!((rig.core.pc(), rig.r(0)), (RAM + 0x202, rig.r(1) + 1));
        rig.core.clear_breakpoint(RAM + 0x202);
        assert_eq!(rig.core.run(&mut rig.board, 200), Exit::Until);
    }
}

#[test]
fn flash_that_was_programmed_is_decoded_anew() {
    let mut rig = Rig::new(&[0x2001, 0xE7FD]);
    rig.core.run(&mut rig.board, 10);
    assert_eq!(rig.r(0), 1);
    rig.board.flash[CODE as usize] = 7;
    rig.board.signals.forget_code();
    rig.core.run(&mut rig.board, 20);
    assert_eq!(rig.r(0), 7);
}

#[test]
fn a_stalled_core_executes_nothing_and_is_not_idle() {
    let mut rig = Rig::new(COUNT);
    rig.board.signals.stall_until(50);
    assert_eq!(rig.core.run(&mut rig.board, 40), Exit::Until);
    assert_eq!((rig.core.cycle(), rig.core.retired(), rig.core.idle()), (40, 0, 0));
    assert_eq!(rig.core.run(&mut rig.board, 60), Exit::Until);
    assert_eq!(rig.core.retired(), 10);
}

#[test]
fn wfi_lets_time_pass_to_the_end_asked_for() {
    let mut rig = Rig::new(&[0xBF30, 0x2001]);
    rig.board.due = 70;
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
    assert!(rig.core.is_asleep());
    assert_eq!((rig.core.cycle(), rig.core.idle(), rig.core.retired()), (100, 99, 1));
    assert_eq!(rig.board.advanced, [70]);
}

#[test]
fn what_is_no_instruction_ends_in_a_lockup_without_a_handler() {
    let codes: [&[u16]; 6] = [
        // The cases are: udf #0; a branch within an IT block; cbz within one; mcr of an absent coprocessor; ldrd at an
        // odd address; bx to an even address.
        &[0xDE00],
        &[0xBF04, 0xE000, 0xBF00],
        &[0xBF08, 0xB100],
        &[0xEE00, 0x0110],
        &[0xE9D1, 0x0200],
        &[0x4708],
    ];
    for code in codes {
        let mut rig = Rig::new(code);
        rig.set(1, 0x202).set_nzcv(4);
        assert_eq!(rig.core.run(&mut rig.board, 1000), Exit::Lockup, "{code:04X?}");
        let at = rig.core.cycle();
        assert_eq!(rig.core.run(&mut rig.board, 2000), Exit::Until);
        assert_eq!((rig.core.cycle(), rig.core.idle()), (2000, 2000 - at));
    }
}

/// The code is: CPSID f; CCR = r3; r0 = the word at r1, where nothing answers; r6 = CFSR; r7 = BFAR; a store to r1; B .
const PROBE: &[u16] = &[0xB671, 0x6013, 0x6808, 0x6826, 0x682F, 0x6008, 0xE7FE];

/// With BFHFNMIGN, handlers of priority -1 and -2 ignore the exception of a data bus fault, but its status is set (ARM
/// ARM B3.2.8, B3.2.15).
#[test]
fn firmware_that_probes_an_address_under_faultmask_reads_that_nothing_answered() {
    fn probes<C: Cost>() {
        let mut rig = Rig::<C>::with_clock(PROBE);
        rig.set(0, 5).set(1, 0x7000_0000).set(2, 0xE000_ED14).set(3, 1 << 9 | 1 << 8);
        rig.set(4, 0xE000_ED28).set(5, 0xE000_ED38);
        assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
        assert_eq!((rig.r(0), rig.r(6), rig.r(7)), (0, 1 << 15 | 1 << 9, 0x7000_0000), "{}", C::NAME);
        assert_eq!((rig.core.pc(), rig.core.locked_up(), rig.core.active_exception()), (CODE + 12, false, 0));
        let mut rig = Rig::<C>::with_clock(PROBE);
        rig.set(1, 0x7000_0000).set(2, 0xE000_ED14).set(3, 1 << 9);
        assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Lockup, "{}", C::NAME);
    }
    probes::<Fast>();
    probes::<Optimistic>();
    probes::<Pessimistic>();
}

#[test]
fn a_load_multiple_is_left_where_something_is_due_and_continued() {
    // The code is: ldm r0, {r1-r4}; b .
    let mut rig = Rig::<Pessimistic>::with_clock(&[0xBF00, 0xBF00, 0xE890, 0x001E, 0xE7FE]);
    rig.core.skip_to(100);
    for index in 0..4 {
        rig.board.set_word(RAM + 4 * index, index + 1);
    }
    rig.set(0, RAM);
    rig.board.due = 104;
    assert_eq!(rig.core.run(&mut rig.board, 110), Exit::Until);
    assert_eq!(rig.board.advanced, [104]);
    assert_eq!([1, 2, 3, 4].map(|n| rig.r(n)), [1, 2, 3, 4]);
}

#[test]
fn registers_are_the_callers_to_change() {
    let mut rig = Rig::new(COUNT);
    rig.core.set_register(Register::Psp, 0x2000_0803);
    assert_eq!(rig.core.register(Register::Psp), 0x2000_0800);
    rig.core.set_register(Register::Control, 2);
    assert_eq!(rig.r(13), 0x2000_0800);
    assert_eq!(rig.core.register(Register::Msp), RAM + 0x1000);
    rig.core.set_register(Register::S(31), 7);
    assert_eq!(rig.core.register(Register::S(31)), 7);
}
