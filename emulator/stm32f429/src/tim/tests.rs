//! Tests of the timers against the manual's figures.

use super::*;
use crate::rig::Rig;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SMCR: u32 = 0x08;
const DIER: u32 = 0x0C;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CCER: u32 = 0x20;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const ARR: u32 = 0x2C;
const RCR: u32 = 0x30;
const CCR1: u32 = 0x34;
const CCR2: u32 = 0x38;
const BDTR: u32 = 0x44;
const DCR: u32 = 0x48;
const DMAR: u32 = 0x4C;

fn rig(number: u8) -> Rig<Tim> {
    Rig::new(Tim::new(number))
}

/// Returns the cycles up to `to` at which the interrupt output is high, each with the enabled flags that were set. All
/// flags are cleared each time. The flag of an unused channel rises too, because its compare value is zero.
fn interrupts(rig: &mut Rig<Tim>, to: Cycle) -> Vec<(Cycle, u32)> {
    let mut seen = Vec::new();
    while rig.instance.due() <= to {
        let at = rig.instance.due();
        rig.run(at);
        if rig.instance.irq() != 0 {
            let flags = rig.read(SR);
            seen.push((at, flags & rig.read(DIER) & 0xFF));
            rig.write(SR, !flags);
        }
    }
    rig.run(to);
    seen
}

#[test]
fn both_outputs_of_a_pair_are_off_during_the_dead_time() {
    let mut rig = rig(1);
    rig.write(ARR, 99);
    rig.write(CCR1, 50);
    rig.write(CCMR1, 6 << 4);
    rig.write(CCER, 5);
    // DTG is 10 steps of two timer clocks (CKD), which are 20 cycles.
    rig.write(BDTR, MOE | 10);
    rig.write(EGR, 1);
    rig.out.outputs.clear();
    rig.write(CR1, 1 << 8 | CEN);
    rig.run(240);
    let edge = |&(at, signal, level)| (at, signal, level == Some(true));
    let edges: Vec<_> = rig.out.outputs.iter().map(edge).collect();
    let (main, complement) = (Signal::Tim(1, TimPin::Ch1), Signal::Tim(1, TimPin::Ch1N));
    let period = |at| {
        let first = [(at, main, false), (at + 20, complement, true)];
        [first, [(at + 50, complement, false), (at + 70, main, true)]].concat()
    };
    assert_eq!(edges[edges.len() - 8..], [period(51), period(151)].concat());
}

#[test]
fn a_pulse_that_is_shorter_than_the_dead_time_never_leaves() {
    let mut rig = rig(1);
    rig.write(ARR, 99);
    rig.write(CCR1, 5);
    rig.write(CCMR1, 6 << 4);
    rig.write(CCER, 5);
    rig.write(BDTR, MOE | 10);
    rig.write(EGR, 1);
    rig.write(CR1, CEN);
    rig.run(150);
    rig.out.outputs.clear();
    rig.run(1000);
    assert!(rig.out.outputs.iter().all(|&(_, signal, _)| signal == Signal::Tim(1, TimPin::Ch1N)));
    assert!(!rig.out.outputs.is_empty());
}

#[test]
fn the_counter_starts_one_clock_after_it_is_enabled() {
    let mut rig = rig(2);
    rig.write(ARR, 9);
    rig.run(100);
    rig.write(CR1, CEN);
    for (at, count) in [(100, 0), (101, 0), (102, 1), (110, 9), (111, 0), (112, 1), (1_000_000_111, 0)] {
        rig.run(at);
        assert_eq!(rig.read(CNT), count, "{at}");
    }
    assert_eq!(rig.instance.due(), NEVER, "nothing can be seen, so nothing is an event");
    assert_eq!(rig.read(SR) & UIF, UIF);
}

#[test]
fn updates_and_compares_interrupt_at_their_own_cycles() {
    let mut rig = rig(2);
    rig.change_clocks(|clocks| clocks.tim1 = 2);
    rig.write(ARR, 99);
    rig.write(CCR1, 10);
    rig.write(CCR2, 40);
    rig.write(DIER, 1 | 2 | 4);
    rig.write(CR1, CEN | URS);
    let seen = interrupts(&mut rig, 2 + 400);
    assert_eq!(seen, [(22, 2), (82, 4), (202, 1), (222, 2), (282, 4), (402, 1)]);
}

#[test]
fn the_prescaler_takes_its_value_at_an_update() {
    let mut rig = rig(5);
    rig.write(PSC, 71);
    rig.write(CR1, URS);
    rig.write(EGR, 1);
    assert_eq!(rig.read(SR), 0, "URS keeps the flag of a software update away");
    rig.write(ARR, 9);
    rig.write(DIER, 1);
    rig.write(CR1, CEN | URS | OPM);
    assert_eq!(interrupts(&mut rig, 10_000), [(1 + 720, 1)]);
    assert_eq!(rig.read(CR1) & CEN, 0, "one pulse");
    assert_eq!(rig.read(CNT), 0);
}

#[test]
fn without_preload_a_reload_below_the_counter_lets_it_overflow() {
    let mut rig = rig(3);
    rig.write(CR1, CEN);
    rig.run(101);
    rig.write(ARR, 50);
    rig.run(0xFFFF + 1);
    assert_eq!(rig.read(CNT), 0xFFFF);
    rig.run(0xFFFF + 2);
    assert_eq!(rig.read(CNT), 0);
}

#[test]
fn a_preloaded_reload_value_waits_for_the_update() {
    let mut rig = rig(3);
    rig.write(ARR, 99);
    rig.write(EGR, 1);
    rig.write(CR1, CEN | ARPE);
    rig.run(51);
    rig.write(ARR, 9);
    rig.run(100);
    assert_eq!(rig.read(CNT), 99);
    rig.run(101 + 10);
    assert_eq!(rig.read(CNT), 0);
    rig.run(101 + 19);
    assert_eq!(rig.read(CNT), 9);
}

#[test]
fn counting_down_wraps_from_zero_to_the_reload_value() {
    let mut rig = rig(4);
    rig.write(ARR, 9);
    rig.write(CR1, DIR);
    rig.write(EGR, 1);
    rig.write(SR, 0);
    rig.write(DIER, 1);
    rig.write(CR1, DIR | CEN);
    assert_eq!(rig.read(CNT), 9);
    assert_eq!(interrupts(&mut rig, 22), [(11, 1), (21, 1)]);
    assert_eq!(rig.read(CNT), 8);
}

#[test]
fn centre_aligned_the_counter_turns_at_both_ends() {
    let mut rig = rig(4);
    rig.write(ARR, 4);
    rig.write(EGR, 1);
    rig.write(SR, 0);
    rig.write(DIER, 1);
    rig.write(CR1, CEN | 0x60);
    let mut counts = Vec::new();
    for at in 1..=10 {
        rig.run(at);
        counts.push(rig.read(CNT));
    }
    assert_eq!(counts, [0, 1, 2, 3, 4, 3, 2, 1, 0, 1]);
    assert_eq!(rig.read(SR) & UIF, UIF);
    rig.write(SR, 0);
    assert_eq!(interrupts(&mut rig, 20), [(13, 1), (17, 1)]);
}

#[test]
fn the_repetition_counter_leaves_updates_out() {
    let mut rig = rig(1);
    rig.write(ARR, 9);
    rig.write(RCR, 2);
    rig.write(EGR, 1);
    rig.write(SR, 0);
    rig.write(DIER, 1);
    rig.write(CR1, CEN);
    let seen = interrupts(&mut rig, 61);
    assert_eq!(seen.iter().map(|&(at, _)| at).collect::<Vec<_>>(), [31, 61]);
}

#[test]
fn pwm_drives_its_pin_while_the_counter_is_below_compare() {
    let mut rig = rig(3);
    rig.write(ARR, 9);
    rig.write(CCR1, 3);
    rig.write(CCMR1, 6 << 4);
    rig.write(CCER, 1);
    rig.write(CR1, CEN);
    rig.run(25);
    let pin = Signal::Tim(3, TimPin::Ch1);
    let levels: Vec<_> = rig.out.outputs.iter().map(|&(at, signal, level)| (at, signal == pin, level)).collect();
    let expected = [(0, true), (4, false), (11, true), (14, false), (21, true), (24, false)];
    assert_eq!(levels, expected.map(|(at, level)| (at, true, Some(level))));
}

#[test]
fn an_advanced_timer_drives_nothing_without_its_main_output_enable() {
    let mut rig = rig(1);
    rig.write(ARR, 9);
    rig.write(CCR1, 3);
    rig.write(CCMR1, 6 << 4);
    rig.write(CCER, 5);
    rig.write(CR1, CEN);
    rig.run(100);
    assert!(rig.out.outputs.is_empty());
    rig.write(BDTR, MOE);
    let driven: Vec<_> = rig.out.outputs.iter().map(|&(_, signal, level)| (signal, level)).collect();
    // The outputs are enabled while the counter is at 9.
    let pins = [(TimPin::Ch1, false), (TimPin::Ch1N, true)];
    assert_eq!(driven, pins.map(|(pin, level)| (Signal::Tim(1, pin), Some(level))));
}

#[test]
fn a_toggling_output_keeps_its_phase_however_long_nothing_looks() {
    let mut rig = rig(3);
    rig.write(ARR, 9);
    rig.write(CCR1, 3);
    rig.write(CCMR1, 3 << 4);
    rig.write(CR1, CEN);
    let mut stepped = rig.clone();
    rig.run(1_000_005);
    for at in (0..=1_000_005).step_by(5) {
        stepped.run(at);
        stepped.read(CNT);
    }
    rig.read(CNT);
    assert_eq!(rig.instance.reference, stepped.instance.reference);
    assert_eq!(rig.instance.cnt, stepped.instance.cnt);
}

#[test]
fn an_edge_captures_the_counter_and_a_second_one_is_over_capture() {
    let mut rig = rig(5);
    rig.write(CCMR1, 1);
    rig.write(CCER, 1);
    rig.write(DIER, 2);
    rig.write(CR1, CEN);
    let pin = Signal::Tim(5, TimPin::Ch1);
    rig.run(101);
    rig.input(pin, true);
    rig.run(111);
    rig.input(pin, false);
    assert_eq!(rig.instance.irq(), 1);
    rig.run(201);
    rig.input(pin, true);
    assert_eq!(rig.read(SR) & 0x202, 0x202);
    assert_eq!(rig.read(CCR1), 200);
    assert_eq!(rig.read(SR) & 2, 0, "reading the capture clears its flag");
}

#[test]
fn an_encoder_counts_up_and_down_by_all_edges_of_both_lines() {
    let mut rig = rig(4);
    rig.write(CCMR1, 0x0101);
    rig.write(SMCR, 3);
    rig.write(CR1, CEN);
    let lines = [(TimPin::Ch1, true), (TimPin::Ch2, true), (TimPin::Ch1, false), (TimPin::Ch2, false)];
    for (pin, level) in lines {
        rig.input(Signal::Tim(4, pin), level);
    }
    assert_eq!(rig.read(CNT), 4);
    assert_eq!(rig.read(CR1) & DIR, 0);
    for (pin, level) in [(TimPin::Ch2, true), (TimPin::Ch1, true)] {
        rig.input(Signal::Tim(4, pin), level);
    }
    assert_eq!(rig.read(CNT), 2);
    assert_eq!(rig.read(CR1) & DIR, DIR);
}

#[test]
fn a_timer_tells_its_update_and_another_counts_it() {
    let mut master = rig(3);
    master.write(ARR, 9);
    master.write(CR2, 2 << 4);
    master.write(CR1, CEN);
    master.run(35);
    assert_eq!(master.out.triggers, [Trigger::Trgo(3); 3]);

    let mut slave = rig(2);
    slave.write(SMCR, 2 << 4 | 7);
    slave.write(CR1, CEN);
    for _ in 0..3 {
        slave.call(|timer, cx| timer.trigger(Trigger::Trgo(3), cx));
    }
    slave.call(|timer, cx| timer.trigger(Trigger::Trgo(4), cx));
    slave.run(1000);
    assert_eq!(slave.read(CNT), 3);
}

#[test]
fn an_update_request_stays_until_the_dma_has_served_its_burst() {
    let mut rig = rig(3);
    rig.write(ARR, 9);
    rig.write(DIER, UDE);
    rig.write(DCR, 1 << 8 | 13);
    rig.write(CR1, CEN);
    rig.run(11);
    for value in [7, 8] {
        assert_eq!(rig.instance.dma(), DMA_UPDATE);
        rig.write(DMAR, value);
        rig.call(|timer, cx| timer.dma_served(0, 7, cx));
    }
    assert_eq!(rig.instance.dma(), 0);
    assert_eq!((rig.read(CCR1), rig.read(CCR2)), (7, 8));
}

fn state(rig: &mut Rig<Tim>) -> (u32, u32, [bool; 4], u32, u32, u32) {
    let status = rig.read(SR);
    let timer = &rig.instance;
    (timer.cnt, status, timer.reference, timer.prescale, timer.repeat, timer.cr1)
}

proptest::proptest! {
    #[test]
    fn a_timer_read_once_equals_one_read_at_every_clock(
        number in 1_u8..=8,
        control in 0_u32..0x80,
        prescaler in 0_u32..4,
        reload in 0_u32..12,
        repetition in 0_u32..3,
        compares in proptest::array::uniform4(0_u32..14),
        modes in proptest::array::uniform4(0_u32..8),
        later in (0_u32..4, 0_u32..12, 0_u64..60),
        to in 0_u64..3000,
    ) {
        let mut rig = rig(number);
        let channels = u32::from(rig.instance.kind.channels);
        rig.write(PSC, prescaler);
        rig.write(ARR, reload);
        if channels > 0 {
            for (index, (compare, mode)) in compares.into_iter().zip(modes).enumerate() {
                rig.write(CCR1 + 4 * index as u32, compare);
                let half = CCMR1 + 4 * (index as u32 / 2);
                let other = rig.read(half);
                rig.write(half, other | (mode << 4 | 8) << (8 * (index % 2)));
            }
        }
        if matches!(number, 1 | 8) {
            rig.write(RCR, repetition);
        }
        rig.write(EGR, 1);
        rig.write(SR, 0);
        rig.write(CR1, control & 0x7E | CEN);
        rig.run(later.2);
        // PSC and ARR are preloaded, so they may wait for an update.
        rig.write(PSC, later.0);
        rig.write(ARR, later.1);
        let mut stepped = rig.clone();
        rig.run(later.2 + to);
        for at in later.2..=later.2 + to {
            stepped.run(at);
            stepped.read(CNT);
        }
        proptest::prop_assert_eq!(state(&mut rig), state(&mut stepped));
    }
}
