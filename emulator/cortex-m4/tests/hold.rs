//! Tests of watchpoints and single steps, which must not change a run's results.

use crate::common;

use common::{Board, CODE, CONFIG, RAM, Rig};
use cortex_m4::{Core, Cost, Exit, Fast, Optimistic, Pessimistic, Register, Watched, Watchpoint};

/// The code is: str r1, [r0]; ldr r2, [r0]; strb r1, [r0, #5]; stmia r3!, {r1, r2}; b .
const ACCESSES: &[u16] = &[0x6001, 0x6802, 0x7141, 0xC306, 0xE7FE];

fn watchpoint(address: u32, length: u32, reads: bool, writes: bool) -> Watchpoint {
    Watchpoint { address, length, reads, writes }
}

/// Returns the program counter, the address of the access, and whether it was a write, for each stop at the watchpoint.
fn stops<C: Cost>(watchpoint: Watchpoint) -> Vec<(u32, u32, bool)> {
    let mut rig = Rig::<C>::with_clock(ACCESSES);
    rig.set(0, RAM + 0x40).set(1, 7).set(3, RAM + 0x80);
    rig.core.set_watchpoint(watchpoint);
    let mut seen = vec![];
    while rig.core.run(&mut rig.board, 100) == Exit::Watchpoint {
        let Watched { address, write, watchpoint: which } = rig.core.take_watched().unwrap();
        assert_eq!(which, watchpoint);
        seen.push((rig.core.pc() - CODE, address - RAM, write));
    }
    assert_eq!(rig.core.take_watched(), None);
    seen
}

#[test]
fn a_watchpoint_stops_behind_each_instruction_that_accesses_its_bytes() {
    let writes = |address, length| stops::<Fast>(watchpoint(RAM + address, length, false, true));
    assert_eq!(writes(0x40, 4), [(2, 0x40, true)]);
    // In each case the watchpoint covers a byte of a wider store, or the store is within a wider watchpoint.
    assert_eq!(writes(0x43, 1), [(2, 0x40, true)]);
    assert_eq!(writes(0x44, 4), [(6, 0x45, true)]);
    assert_eq!(writes(0x45, 1), [(6, 0x45, true)]);
    assert_eq!(writes(0x46, 8), []);
    // In each case the watchpoint covers the second store of an stmia.
    assert_eq!(writes(0x84, 4), [(8, 0x84, true)]);
    assert_eq!(writes(0x80, 8), [(8, 0x80, true)]);
    assert_eq!(stops::<Fast>(watchpoint(RAM + 0x40, 4, true, false)), [(4, 0x40, false)]);
    let both = watchpoint(RAM + 0x40, 4, true, true);
    assert_eq!(stops::<Fast>(both), [(2, 0x40, true), (4, 0x40, false)]);
    assert_eq!(stops::<Pessimistic>(both), stops::<Fast>(both));
}

#[test]
fn a_watchpoint_that_is_taken_back_stops_nothing() {
    let mut rig = Rig::new(ACCESSES);
    rig.set(0, RAM + 0x40).set(3, RAM + 0x80);
    let watched = watchpoint(RAM + 0x40, 4, true, true);
    rig.core.set_watchpoint(watched);
    assert!(rig.core.clear_watchpoint(watched));
    assert!(!rig.core.clear_watchpoint(watched));
    assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Until);
}

#[test]
fn watchpoints_stay_through_a_reset_and_a_power_on() {
    for power_on in [false, true] {
        let mut rig = Rig::new(ACCESSES);
        rig.core.set_watchpoint(watchpoint(RAM + 0x40, 4, false, true));
        if power_on {
            rig.core.power_on(&mut rig.board);
        } else {
            rig.core.reset(&mut rig.board);
        }
        rig.set(0, RAM + 0x40).set(3, RAM + 0x80);
        assert_eq!(rig.core.run(&mut rig.board, 100), Exit::Watchpoint, "power on {power_on}");
    }
}

/// Returns a core whose interrupt 0 becomes pending in thread code that has an IT block, an stmia and a loop.
fn interrupted<C: Cost>() -> Rig<C> {
    // The code is: str r4, [r3] (ISER0); str r1, [r0] (ISPR0, pending); movs r5, #3; loop: subs r5, #1; ite ne; addne
    // r6, #1; moveq r6, #0; stmia r7!, {r1, r4}; cmp r5, #0; bne loop; b .
    let thread = [0x601C, 0x6001, 0x2503, 0x3D01, 0xBF14, 0x3601, 0x2600, 0xC712, 0x2D00, 0xD1F8, 0xE7FE];
    let mut board = Board::new(&thread);
    let handler = CODE + 0x80;
    board.flash[64..68].copy_from_slice(&(handler | 1).to_le_bytes());
    // The handler's code is: str r1, [sp, #0x40]; bx lr.
    for (nth, half) in [0x9110_u16, 0x4770].into_iter().enumerate() {
        let at = handler as usize + 2 * nth;
        board.flash[at..at + 2].copy_from_slice(&half.to_le_bytes());
    }
    let mut core = Core::new(CONFIG);
    core.reset(&mut board);
    let mut rig = Rig { core, board };
    rig.set(0, 0xE000_E200).set(1, 1).set(3, 0xE000_E100).set(4, 1).set(7, RAM + 0x100).set(13, RAM + 0x800);
    rig.board.waits = u32::from(C::BOUND.is_some());
    rig
}

fn state<C: Cost>(rig: &Rig<C>) -> (Vec<u32>, Vec<u8>, [u64; 4], Vec<u32>) {
    let registers = (0..16).map(Register::R).chain([Register::Xpsr]).map(|register| rig.core.register(register));
    let counts =
        [rig.core.cycle(), rig.core.retired(), rig.core.exception_changes(), u64::from(rig.core.active_exception())];
    (registers.collect(), rig.board.ram.clone(), counts, rig.board.fetches.clone())
}

fn one_at_a_time_is_the_same_run<C: Cost>() {
    let mut whole = interrupted::<C>();
    whole.core.run(&mut whole.board, 200);
    let mut single = interrupted::<C>();
    let mut handled = false;
    while single.core.cycle() < 200 {
        let (executed, changes) = (single.core.retired(), single.core.exception_changes());
        assert_eq!(single.core.run_one(&mut single.board, 200), Exit::Until);
        let (executed, changes) = (single.core.retired() - executed, single.core.exception_changes() - changes);
        // Each call executes at most one instruction or one exception entry.
        assert!(executed <= 1 && changes <= 1, "{executed} instructions, {changes} changes");
        if executed == 0 && changes == 1 {
            assert_eq!((single.core.active_exception(), single.core.pc()), (16, CODE + 0x80));
            handled = true;
        }
    }
    assert!(handled);
    assert_eq!(state(&single), state(&whole), "{}", C::NAME);
    let mut stopped = interrupted::<C>();
    (0..11).for_each(|nth| stopped.core.set_breakpoint(CODE + 2 * nth));
    let mut stops = 0;
    while stopped.core.run(&mut stopped.board, 200) == Exit::Breakpoint {
        stops += 1;
    }
    assert!(stops > 10);
    assert_eq!(state(&stopped), state(&whole), "{}", C::NAME);
    let mut watched = interrupted::<C>();
    watched.core.set_watchpoint(watchpoint(RAM, 0x1000, true, true));
    let mut stops = 0;
    while watched.core.run(&mut watched.board, 200) == Exit::Watchpoint {
        watched.core.take_watched().unwrap();
        stops += 1;
    }
    assert_eq!(stops, 4, "three times stmia, once the handler's str");
    assert_eq!(state(&watched), state(&whole), "{}", C::NAME);
}

#[test]
fn stepping_and_stopping_leave_a_run_unchanged() {
    one_at_a_time_is_the_same_run::<Fast>();
    one_at_a_time_is_the_same_run::<Optimistic>();
    one_at_a_time_is_the_same_run::<Pessimistic>();
}
