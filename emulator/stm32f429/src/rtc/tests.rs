//! Tests of the calendar's carries, the write protection, alarms and the wake-up timer.

use super::*;
use crate::rig::Rig;

const TR: u32 = 0x00;
const DR: u32 = 0x04;
const CR: u32 = 0x08;
const ISR: u32 = 0x0C;
const WPR: u32 = 0x24;
const SSR: u32 = 0x28;
const SECOND: Cycle = 16_000_000;

/// Returns an RTC on LSE at 32 768 Hz whose registers are unlocked.
fn rig() -> Rig<Rtc> {
    let mut rig = Rig::new(Rtc::new());
    rig.change_clocks(|clocks| clocks.rtc = Ratio::new(16_000_000, 32_768));
    rig.write(WPR, 0xCA);
    rig.write(WPR, 0x53);
    rig
}

fn set(rig: &mut Rig<Rtc>, time: u32, date: u32) {
    rig.write(ISR, INIT);
    rig.run(rig.now + 1000);
    assert_eq!(rig.read(ISR) & INITF, INITF);
    rig.write(TR, time);
    rig.write(DR, date);
    rig.write(ISR, 0);
}

#[test]
fn the_calendar_goes_over_the_end_of_february_in_a_leap_year() {
    let mut rig = rig();
    set(&mut rig, 0x23_59_58, 0x24_42_28);
    rig.run(rig.now + 2 * SECOND + 100_000);
    assert_eq!((rig.read(TR), rig.read(DR)), (0, 0x24_62_29));
    rig.run(rig.now + 86_400 * SECOND);
    assert_eq!((rig.read(TR), rig.read(DR)), (0, 0x24_83_01));
    assert_eq!(rig.read(ISR) & INITS, INITS);
}

#[test]
fn a_read_of_the_sub_seconds_holds_time_and_date() {
    let mut rig = rig();
    set(&mut rig, 0x12_00_00, 0x24_21_01);
    rig.run(rig.now + SECOND - 100_000);
    assert_eq!(rig.read(SSR), 1);
    rig.run(rig.now + SECOND);
    assert_eq!(rig.read(TR), 0x12_00_00);
    rig.read(DR);
    assert_eq!(rig.read(TR), 0x12_00_01);
}

#[test]
fn without_the_key_nothing_but_the_backup_registers_can_be_written() {
    let mut rig = rig();
    rig.write(WPR, 0);
    rig.write(ISR, INIT);
    rig.run(10_000);
    assert_eq!(rig.read(ISR) & (INIT | INITF), 0);
    rig.write(CR, FMT);
    assert_eq!(rig.read(CR), 0);
    assert!(rig.found("write-protected"));
    rig.write(0x50, 0xDEAD_BEEF);
    rig.instance.system_reset();
    assert_eq!(rig.read(0x50), 0xDEAD_BEEF);
}

#[test]
fn outside_initialisation_mode_the_calendar_cannot_be_set() {
    let mut rig = rig();
    rig.write(TR, 0x12_00_00);
    assert_eq!(rig.read(TR), 0);
    assert!(rig.found("outside initialisation mode"));
}

#[test]
fn without_a_clock_initialisation_mode_is_never_entered() {
    let mut rig = Rig::new(Rtc::new());
    rig.write(WPR, 0xCA);
    rig.write(WPR, 0x53);
    rig.write(ISR, INIT);
    rig.run(SECOND);
    assert_eq!(rig.read(ISR) & INITF, 0);
}

#[test]
fn an_alarm_interrupts_in_the_second_that_it_is_set_to() {
    let mut rig = rig();
    set(&mut rig, 0x12_00_00, 0x24_21_01);
    let start = rig.now;
    // The alarm matches any date, hour and minute, in second 05.
    rig.write(0x1C, 1 << 31 | 1 << 23 | 1 << 15 | 0x05);
    rig.write(CR, ALRAE | ALRAIE);
    rig.run(start + 5 * SECOND - 1000);
    assert_eq!(rig.instance.irq(), 0);
    rig.run(start + 5 * SECOND);
    assert_eq!(rig.instance.irq(), 1);
    rig.write(ISR, !ALRAF & !INIT);
    assert_eq!(rig.instance.irq(), 0);
    rig.run(start + 65 * SECOND);
    assert_eq!(rig.instance.irq(), 1);
}

#[test]
fn the_wake_up_timer_comes_after_its_clocks_and_again() {
    let mut rig = rig();
    rig.write(CR, 0);
    // The wake-up timer counts RTCCLK / 16, which is 2048 Hz.
    rig.write(0x14, 2047);
    rig.write(CR, WUTE | WUTIE);
    rig.run(SECOND - 1000);
    assert_eq!(rig.instance.irq(), 0);
    rig.run(SECOND + 1000);
    assert_eq!(rig.instance.irq(), 4);
    rig.write(ISR, !WUTF & !INIT);
    rig.run(2 * SECOND - 1000);
    assert_eq!(rig.instance.irq(), 0);
    rig.run(2 * SECOND + 1000);
    assert_eq!(rig.instance.irq(), 4);
}
