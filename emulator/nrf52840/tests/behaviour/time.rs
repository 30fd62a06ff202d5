//! Tests of TIMER, RTC, PPI, EGU and WDT.
use crate::rig::*;
use cortex_m4::Signals;
use emulator_part::{Clock, FindingKind, Part, Reset};
use nrf52840::Settings;

/// Sets up a TIMER of 32 bits at 16 MHz with CC[0] = `cc`.
fn timer(base: u32, cc: u32) -> [(u32, u32); 3] {
    [(base + 0x508, 3), (base + 0x510, 0), (base + 0x540, cc)]
}

#[test]
fn a_compare_comes_at_its_tick_and_not_before() {
    let mut rig = Rig::new();
    rig.write_all(&timer(TIMER0, 1_000));
    rig.write(TIMER0, 1);
    assert_eq!(rig.deadline(), 4_000);
    rig.run_to(3_999);
    assert_eq!(rig.read(TIMER0 + 0x140), 0);
    rig.run_to(4_000);
    assert_eq!(rig.read(TIMER0 + 0x140), 1);
    rig.assert_clean();
}

#[test]
fn a_period_of_ten_milliseconds_never_drifts() {
    let mut rig = Rig::new();
    rig.write_all(&timer(TIMER0, 160_000));
    rig.write_all(&[(TIMER0 + 0x200, 1), (TIMER0 + 0x304, 1 << 16), (TIMER0, 1)]);
    for k in 1..=1_000_u64 {
        assert_eq!(rig.run_until_set(TIMER0 + 0x140, 11_000 * MS), k * 10 * MS);
        assert!(rig.line(8));
        rig.write(TIMER0 + 0x140, 0);
        assert!(!rig.line(8));
    }
}

#[test]
fn an_oscillator_that_is_off_moves_the_core_and_its_timers_alike() {
    let mut rig = Rig::with(Settings { hfxo_ppb: 20_000, hfint_ppb: 15_000_000, ..Settings::default() });
    assert_eq!(rig.part.clock(), Clock { hz: 64_000_000, ppb: 15_000_000 });
    rig.write_all(&timer(TIMER0, 16_000));
    rig.write_all(&[(TIMER0, 1), (POWER, 1)]);
    *rig.part.signals() = Signals::default();
    assert_eq!(rig.run_until_set(POWER + 0x100, MS), 360 * US);
    assert!(rig.part.signals().is_announced(), "the new rate is announced");
    assert_eq!(rig.part.clock(), Clock { hz: 64_000_000, ppb: 20_000 });
    assert_eq!(rig.read(POWER + 0x40C), 1 << 16 | 1);
    assert_eq!(rig.run_until_set(TIMER0 + 0x140, 2 * MS), MS, "a timer's tick is four cycles whatever feeds both");
    rig.write(POWER + 0x04, 1);
    assert_eq!(rig.part.clock().ppb, 15_000_000, "HFCLKSTOP goes back to HFINT");
}

#[test]
fn lfclk_keeps_its_own_rate_when_the_core_clock_changes() {
    let mut rig = Rig::with(Settings { hfint_ppb: 15_000_000, ..Settings::default() });
    rig.write(POWER + 0x08, 1);
    rig.run_until_set(POWER + 0x104, 10 * MS);
    let from = rig.now;
    rig.write_all(&[(RTC0 + 0x540, 32_768), (RTC0 + 0x304, 1 << 16), (RTC0, 1)]);
    let at = rig.run_until_set(RTC0 + 0x140, 2_000 * MS);
    assert_eq!(at - from, 64_960_000, "the core is 1.5 % fast, so a second has that many more cycles");
}

#[test]
fn a_compare_due_with_a_task_or_write_is_not_lost() {
    let writes = [
        ("CAPTURE", TIMER0 + 0x44, 1),
        ("CLEAR", TIMER0 + 0x0C, 1),
        ("STOP", TIMER0 + 0x04, 1),
        ("SHUTDOWN", TIMER0 + 0x10, 1),
        ("CC", TIMER0 + 0x540, 99),
        ("another CC", TIMER0 + 0x544, 99),
        ("INTENSET", TIMER0 + 0x304, 1 << 17),
    ];
    for (what, address, value) in writes {
        for late in [0, 1, 3] {
            let mut rig = Rig::new();
            rig.write_all(&timer(TIMER0, 320));
            rig.write_all(&[(PPI + 0x510, TIMER0 + 0x140), (PPI + 0x514, EGU0), (PPI + 0x504, 1), (TIMER0, 1)]);
            // The event is due at 20 µs. The core's write comes then or a few cycles later, before the models are
            // advanced to the event.
            rig.now = 20 * US + late;
            rig.write(address, value);
            assert_eq!(rig.read(TIMER0 + 0x140), 1, "{what}, {late} cycles late");
            assert_eq!(rig.read(EGU0 + 0x100), 1, "{what}, {late} cycles late: through PPI");
            rig.write(TIMER0 + 0x140, 0);
            rig.run_for(US);
            assert_eq!(rig.read(TIMER0 + 0x140), 0, "{what}: once only");
            rig.assert_clean();
        }
    }
}

#[test]
fn a_compare_due_with_a_capture_through_ppi_is_not_lost() {
    let mut rig = Rig::new();
    // Both timers reach their compare values at one instant. The first one's event captures the second timer, which the
    // model handles later.
    rig.write_all(&timer(TIMER0, 320));
    rig.write_all(&timer(TIMER1, 320));
    rig.write_all(&[(PPI + 0x510, TIMER0 + 0x140), (PPI + 0x514, TIMER1 + 0x44), (PPI + 0x504, 1)]);
    rig.write_all(&[(TIMER0, 1), (TIMER1, 1)]);
    rig.run_to(21 * US);
    assert_eq!(rig.read(TIMER1 + 0x140), 1);
    assert_eq!(rig.read(TIMER1 + 0x544), 320);
    rig.assert_clean();
}

#[test]
fn an_overdue_compare_and_its_shortcut_act_at_their_own_tick() {
    let mut rig = Rig::new();
    rig.write_all(&timer(TIMER0, 16));
    rig.write_all(&[(TIMER0 + 0x200, 1), (TIMER0, 1)]); // COMPARE[0] to CLEAR
    rig.now = 10 * US + 16;
    rig.write(TIMER0 + 0x44, 1);
    assert_eq!(rig.read(TIMER0 + 0x544), 4, "cleared ten times, each at its tick");
    assert_eq!(rig.read(TIMER0 + 0x140), 1);
}

#[test]
fn an_rtc_compare_due_with_a_write_is_not_lost() {
    let mut rig = Rig::new();
    start_lfclk(&mut rig);
    rig.write_all(&[(RTC0 + 0x540, 4), (RTC0 + 0x304, 1 << 16), (RTC0, 1)]);
    rig.now = lf_tick(4);
    rig.write(RTC0 + 0x544, 1_000);
    assert_eq!(rig.read(RTC0 + 0x140), 1);
}

#[test]
fn a_prescaler_keeps_its_phase_while_registers_are_written() {
    let mut rig = Rig::new();
    rig.write_all(&[(TIMER0 + 0x508, 3), (TIMER0 + 0x510, 4), (TIMER0 + 0x540, 1_000), (TIMER0, 1)]);
    for step in 0..900 {
        rig.run_to(step * 66);
        rig.write(TIMER0 + 0x544, 5_000 + step as u32);
    }
    assert_eq!(rig.run_until_set(TIMER0 + 0x140, 2 * MS), MS);
}

#[test]
fn bit_modes_wrap_and_match_again_after_a_whole_turn() {
    for (bitmode, turn) in [(1, 1 << 8), (0, 1 << 16), (2, 1 << 24)] {
        let mut rig = Rig::new();
        rig.write_all(&[(TIMER0 + 0x508, bitmode), (TIMER0 + 0x510, 0), (TIMER0 + 0x540, 100), (TIMER0, 1)]);
        let first = rig.run_until_set(TIMER0 + 0x140, 2_000 * MS);
        rig.write(TIMER0 + 0x140, 0);
        let second = rig.run_until_set(TIMER0 + 0x140, 2_000 * MS);
        assert_eq!(first, 400, "bit mode {bitmode}");
        assert_eq!((second - first) / 4, turn, "bit mode {bitmode}");
    }
}

#[test]
fn stop_holds_the_count_and_start_goes_on_from_it() {
    let mut rig = Rig::new();
    rig.write_all(&timer(TIMER3, u32::MAX));
    rig.write(TIMER3, 1);
    rig.run_to(10 * US);
    rig.write(TIMER3 + 0x04, 1);
    rig.run_to(50 * US);
    rig.write(TIMER3 + 0x54, 1); // CAPTURE[5]
    assert_eq!(rig.read(TIMER3 + 0x554), 160);
    rig.write(TIMER3, 1);
    rig.run_to(60 * US);
    rig.write(TIMER3 + 0x54, 1);
    assert_eq!(rig.read(TIMER3 + 0x554), 320);
    rig.write(TIMER3 + 0x0C, 1);
    rig.write(TIMER3 + 0x54, 1);
    assert_eq!(rig.read(TIMER3 + 0x554), 0);
}

#[test]
fn a_counter_counts_tasks_and_stops_on_its_shortcut() {
    let mut rig = Rig::new();
    rig.write_all(&[(TIMER0 + 0x504, 1), (TIMER0 + 0x540, 3), (TIMER0 + 0x200, 1 << 8), (TIMER0, 1)]);
    for _ in 0..5 {
        rig.write(TIMER0 + 0x08, 1);
        rig.run_for(US);
    }
    rig.write(TIMER0 + 0x44, 1);
    assert_eq!(rig.read(TIMER0 + 0x544), 3, "COMPARE[0] stopped it at 3");
    assert_eq!(rig.read(TIMER0 + 0x140), 1);
}

#[test]
fn a_chain_of_timer_ppi_fork_and_egu_happens_in_one_instant() {
    let mut rig = Rig::new();
    rig.write_all(&timer(TIMER0, 320));
    rig.write_all(&timer(TIMER1, u32::MAX));
    rig.write_all(&[
        (PPI + 0x510, TIMER0 + 0x140),
        (PPI + 0x514, TIMER1 + 0x44), // CAPTURE[1]
        (PPI + 0x910, EGU0 + 0x0C),   // TRIGGER[3]
        (PPI + 0x518, EGU0 + 0x10C),
        (PPI + 0x51C, TIMER1 + 0x48), // CAPTURE[2]
        (PPI + 0x504, 0b11),
        (EGU0 + 0x304, 1 << 3),
        (TIMER1, 1),
    ]);
    rig.run_to(10 * US);
    rig.write(TIMER0, 1);
    rig.run_to(30 * US);
    assert_eq!((rig.read(TIMER1 + 0x544), rig.read(TIMER1 + 0x548)), (480, 480));
    assert!(rig.line(20), "EGU0 interrupts");
    assert_eq!(rig.lines(), 1);
    rig.write(EGU0 + 0x10C, 0);
    assert_eq!(rig.lines(), 0);
    rig.assert_clean();
}

#[test]
fn a_disabled_channel_carries_nothing_and_groups_switch_channels_by_task() {
    let mut rig = Rig::new();
    rig.write_all(&[
        (PPI + 0x510, EGU0 + 0x100),
        (PPI + 0x514, EGU0 + 0x04),
        (PPI + 0x800, 1), // group 0 is channel 0
    ]);
    rig.write(EGU0, 1);
    assert_eq!(rig.read(EGU0 + 0x104), 0);
    rig.write(PPI, 1); // CHG[0].EN
    assert_eq!(rig.read(PPI + 0x500), 1);
    rig.write(EGU0, 1);
    assert_eq!(rig.read(EGU0 + 0x104), 1);
    rig.write(PPI + 0x04, 1); // CHG[0].DIS
    assert_eq!(rig.read(PPI + 0x500), 0);
    rig.write_all(&[(PPI + 0x504, 1 << 31), (PPI + 0x508, 1 << 31)]);
    assert_eq!(rig.read(PPI + 0x500), 0, "fixed channels are enabled and disabled the same way");
}

#[test]
fn an_event_that_triggers_itself_is_cut_and_reported() {
    let mut rig = Rig::new();
    rig.write_all(&[(PPI + 0x510, EGU0 + 0x100), (PPI + 0x514, EGU0), (PPI + 0x504, 1), (EGU0, 1)]);
    let found = rig.findings(FindingKind::Misuse);
    assert_eq!((found.len(), found[0].place), (1, "PPI"));
}

#[test]
fn a_channel_to_a_task_of_the_radio_is_reported() {
    let mut rig = Rig::new();
    rig.write_all(&[(PPI + 0x510, EGU0 + 0x100), (PPI + 0x514, 0x4000_1000), (PPI + 0x504, 1), (EGU0, 1)]);
    let found = rig.findings(FindingKind::Unmodelled);
    assert_eq!(found.len(), 1);
    assert!(found[0].text.ends_with("0x40001000"), "{found:?}");
}

fn start_lfclk(rig: &mut Rig) {
    rig.write(POWER + 0x08, 1);
    rig.run_until_set(POWER + 0x104, 10 * MS);
}

/// Returns the cycle of LFCLK tick `n`. LFCLK started at 600 µs.
fn lf_tick(n: u64) -> u64 {
    600 * US + (n * 64_000_000).div_ceil(32_768)
}

#[test]
fn an_rtc_compares_ticks_and_overflows_on_lfclk() {
    let mut rig = Rig::new();
    start_lfclk(&mut rig);
    rig.write_all(&[(RTC0 + 0x508, 7), (RTC0 + 0x540, 4), (RTC0 + 0x304, 1 << 16), (RTC0, 1)]);
    assert_eq!(rig.run_until_set(RTC0 + 0x140, 100 * MS), lf_tick(32));
    assert!(rig.line(11));
    assert_eq!(rig.read(RTC0 + 0x504), 4);
    assert_eq!(rig.read(RTC0 + 0x100), 0, "TICK is not enabled");
    rig.write(RTC0 + 0x344, 0b11); // TICK and OVRFLW to the PPI
    assert_eq!(rig.run_until_set(RTC0 + 0x100, 100 * MS), lf_tick(40));
    rig.write(RTC0 + 0x348, 1);
    rig.write(RTC0 + 0x0C, 1); // TRIGOVRFLW
    assert_eq!(rig.read(RTC0 + 0x504), 0x00FF_FFF0);
    assert_eq!(rig.run_until_set(RTC0 + 0x104, 1_000 * MS), lf_tick(40 + 16 * 8));
    assert_eq!(rig.read(RTC0 + 0x504), 0);
    rig.assert_clean();
}

#[test]
fn an_rtc_compare_set_to_the_next_count_is_missed_and_reported() {
    let mut rig = Rig::new();
    start_lfclk(&mut rig);
    rig.write_all(&[(RTC0 + 0x304, 1 << 16 | 1 << 17), (RTC0, 1), (RTC0 + 0x544, 3), (RTC0 + 0x540, 1)]);
    rig.run_until_set(RTC0 + 0x144, 100 * MS);
    assert_eq!(rig.read(RTC0 + 0x140), 0);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

#[test]
fn an_rtc_counts_nothing_without_lfclk() {
    let mut rig = Rig::new();
    rig.write(RTC0, 1);
    rig.run_to(50 * MS);
    assert_eq!(rig.read(RTC0 + 0x504), 0);
    assert_eq!(rig.findings(FindingKind::Misuse).len(), 1);
}

fn start_watchdog(rig: &mut Rig) {
    start_lfclk(rig);
    rig.write_all(&[(WDT + 0x504, 99), (WDT + 0x508, 0b11), (WDT + 0x50C, 1), (WDT, 1)]);
    assert_eq!(rig.read(WDT + 0x400), 1);
}

#[test]
fn a_watchdog_fed_by_every_request_never_bites() {
    let mut rig = Rig::new();
    start_watchdog(&mut rig);
    for _ in 0..100 {
        rig.run_for(MS);
        rig.write(WDT + 0x600, 0x6E52_4635);
        assert_eq!(rig.read(WDT + 0x404), 0b10, "RR[1] is still to come");
        rig.run_for(MS);
        rig.write(WDT + 0x604, 0x6E52_4635);
        assert_eq!(rig.read(WDT + 0x404), 0b11, "reloaded");
    }
    assert_eq!(rig.restarts(), 0);
    rig.assert_clean();
}

#[test]
fn a_watchdog_fed_by_one_of_two_requests_resets_the_part() {
    let mut rig = Rig::new();
    start_watchdog(&mut rig);
    rig.write(POWER + 0x51C, 0x55);
    while rig.restarts() == 0 {
        rig.write(WDT + 0x600, 0x6E52_4635);
        rig.run_for(MS);
        assert!(rig.now < 10 * MS, "100 ticks are 3.05 ms");
    }
    assert_eq!(rig.part.watchdog_resets()[0].at, lf_tick(100), "at once: its interrupt is not enabled");
    assert_eq!(rig.read(POWER + 0x400), 1 << 1, "RESETREAS.DOG");
    assert_eq!(rig.read(WDT + 0x400), 0, "it has to be started again");
    assert_eq!(rig.read(POWER + 0x51C), 0, "a watchdog reset clears the retained registers");
    assert_eq!(rig.deadline(), u64::MAX, "nothing of the time before is pending");
    rig.write(POWER + 0x400, 1 << 1);
    assert_eq!(rig.read(POWER + 0x400), 0);
}

#[test]
fn the_timeout_interrupt_comes_two_ticks_before_the_reset() {
    let mut rig = Rig::new();
    start_watchdog(&mut rig);
    rig.write(WDT + 0x304, 1);
    assert_eq!(rig.run_until_set(WDT + 0x100, 10 * MS), lf_tick(100));
    assert!(rig.line(16));
    // The watchdog has run out, so its reloads come too late.
    rig.write_all(&[(WDT + 0x600, 0x6E52_4635), (WDT + 0x604, 0x6E52_4635)]);
    rig.run_to(10 * MS);
    assert_eq!(rig.part.watchdog_resets()[0].at, lf_tick(102));
}

#[test]
fn a_running_watchdog_cannot_be_reconfigured_and_outlives_a_soft_reset() {
    let mut rig = Rig::new();
    start_watchdog(&mut rig);
    rig.write(WDT + 0x504, 100_000);
    assert_eq!(rig.read(WDT + 0x504), 99);
    rig.write(POWER + 0x51C, 0xA7);
    rig.run_for(MS);
    rig.reset(Reset::Software);
    assert_eq!(rig.read(POWER + 0x400), 1 << 2, "RESETREAS.SREQ");
    assert_eq!(rig.read(POWER + 0x51C), 0xA7, "GPREGRET is retained");
    assert_eq!(rig.read(WDT + 0x400), 1);
    rig.run_to(10 * MS);
    assert_eq!(rig.part.watchdog_resets()[0].at, lf_tick(100), "the reset did not feed it");
    assert_eq!(rig.read(POWER + 0x400), 1 << 2 | 1 << 1, "RESETREAS accumulates");
}

#[test]
fn the_watchdog_starts_lfclk_by_itself() {
    let mut rig = Rig::new();
    rig.write_all(&[(WDT + 0x504, 32), (WDT, 1)]);
    rig.write(POWER + 0x0C, 1); // the watchdog keeps LFCLK despite LFCLKSTOP
    rig.run_to(10 * MS);
    assert_eq!(rig.part.watchdog_resets()[0].at, (33 * 64_000_000_u64).div_ceil(32_768));
}
