//! Tests of TIM2_CH3 in PWM mode 1 on PB10 (AF1), at the 72 MHz of the firmware's cycle timer (RM0090 18.3.9). The part
//! reports every edge at its own cycle, even if nobody calls it for 35 ms.

use crate::rig;

use emulator_part::{Cycle, Pad, Part, Pin};
use rig::*;

const GPIOB: u32 = 0x4002_0400;
const TIM2: u32 = 0x4000_0000;
const CR1: u32 = TIM2;
const DIER: u32 = TIM2 + 0x0C;
const SR: u32 = TIM2 + 0x10;
const EGR: u32 = TIM2 + 0x14;
const CCMR2: u32 = TIM2 + 0x1C;
const CCER: u32 = TIM2 + 0x20;
const CNT: u32 = TIM2 + 0x24;
const PSC: u32 = TIM2 + 0x28;
const ARR: u32 = TIM2 + 0x2C;
const CCR3: u32 = TIM2 + 0x3C;

const PB10: Pin = Pin::new(1, 10);
/// The core cycles of a tick of the timer: 144 MHz / 72 MHz.
const CYCLES_PER_TICK: Cycle = 2;
/// The timer's period, 10 ms, in core cycles.
const PERIOD: Cycle = 720_000 * CYCLES_PER_TICK;

/// Sets TIM2 up on PB10 with a period of 10 ms, so that the pin is high while CNT < `compare`. The counter is not
/// enabled yet.
fn ready(prescaler: u32, compare: u32) -> Rig {
    let mut rig = Rig::board();
    rig.set(RCC + 0x40, 1);
    rig.write(PSC, prescaler - 1);
    rig.write(ARR, 720_000 / prescaler - 1);
    rig.write(CCR3, compare);
    // OC3M = 6 is PWM mode 1. With OC3PE the compare value takes effect at the update.
    rig.write(CCMR2, 6 << 4 | 1 << 3);
    rig.write(CCER, 1 << 8);
    rig.write(EGR, 1);
    rig.write(SR, 0);
    rig.write(GPIOB + 0x24, 1 << 8);
    rig.set(GPIOB, 2 << 20);
    rig
}

/// Enables the counter. Returns the cycle at which CNT becomes 0: one timer clock after CEN (RM0090 17.3.4).
fn start(rig: &mut Rig) -> Cycle {
    rig.bench.pins.clear();
    rig.write(CR1, 1 << 7 | 1);
    (rig.now / CYCLES_PER_TICK + 1) * CYCLES_PER_TICK
}

fn edges(rig: &Rig) -> Vec<(Cycle, bool)> {
    let edge = |&(at, pin, pad): &(Cycle, Pin, Pad)| match (pin, pad) {
        (PB10, Pad::Driven(level)) => (at, level),
        other => panic!("{other:?} at {at}"),
    };
    rig.bench.pins.iter().map(edge).collect()
}

#[test]
fn pb10_is_high_while_the_counter_is_below_the_compare_value() {
    let mut rig = ready(1, 7_200);
    assert_eq!(rig.part.pad(PB10), Pad::Driven(true), "CNT is 0");
    let zero = start(&mut rig);
    rig.step(PERIOD * 7 / 2);
    let fall = zero + 7_200 * CYCLES_PER_TICK;
    let mut expected = vec![(fall, false)];
    for period in 1..=3 {
        expected.extend([(zero + period * PERIOD, true), (fall + period * PERIOD, false)]);
    }
    assert_eq!(edges(&rig), expected);
    assert!(rig.part.findings().is_empty(), "{:?}", rig.part.findings());
}

#[test]
fn the_edges_are_what_the_part_has_due_when_nothing_else_happens() {
    let mut rig = ready(1, 7_200);
    let zero = start(&mut rig);
    for edge in [7_200 * CYCLES_PER_TICK, PERIOD, PERIOD + 7_200 * CYCLES_PER_TICK, 2 * PERIOD] {
        assert_eq!(rig.part.due(), zero + edge);
        let due = rig.part.due();
        rig.part.advance(due, &mut rig.bench);
    }
    assert_eq!(edges(&rig).len(), 4);
}

#[test]
fn the_counter_reads_0_from_the_cycle_of_the_rising_edge_on() {
    let mut rig = ready(1, 7_200);
    let zero = start(&mut rig);
    let count_at = |at: Cycle| {
        let mut copy = Rig { part: rig.part.clone(), bench: Bench::default(), now: at - 2 };
        copy.read(CNT)
    };
    assert_eq!(count_at(zero + PERIOD - 1), 719_999);
    assert_eq!(count_at(zero + PERIOD), 0);
    assert_eq!(count_at(zero + 7_200 * CYCLES_PER_TICK - 1), 7_199);
    assert_eq!(count_at(zero + 7_200 * CYCLES_PER_TICK), 7_200);
}

#[test]
fn with_the_prescaler_the_edges_are_exact_to_the_timers_clock() {
    let mut rig = ready(72, 100);
    let zero = start(&mut rig);
    rig.step(PERIOD * 3 / 2);
    let high = 100 * 72 * CYCLES_PER_TICK;
    assert_eq!(edges(&rig), [(zero + high, false), (zero + PERIOD, true), (zero + PERIOD + high, false)]);
}

#[test]
fn a_new_compare_value_counts_from_the_next_update_on() {
    let mut rig = ready(1, 7_200);
    let zero = start(&mut rig);
    rig.step(1000);
    rig.write(CCR3, 14_400);
    rig.step(PERIOD * 3 / 2);
    let [short, long] = [7_200, 14_400].map(|ticks| ticks * CYCLES_PER_TICK);
    assert_eq!(edges(&rig), [(zero + short, false), (zero + PERIOD, true), (zero + PERIOD + long, false)]);
}

#[test]
fn the_update_interrupt_rises_at_the_cycle_of_the_rising_edge() {
    let mut rig = ready(1, 7_200);
    rig.write(DIER, 1);
    let zero = start(&mut rig);
    rig.part.advance(zero + PERIOD - 1, &mut rig.bench);
    rig.now = zero + PERIOD - 1;
    assert!(!rig.line(28), "TIM2");
    rig.step(1);
    assert!(rig.line(28));
    assert_eq!(edges(&rig).last(), Some(&(zero + PERIOD, true)));
}

#[test]
fn pb10_stays_low_at_compare_0_and_high_above_the_period() {
    for (compare, level) in [(0, false), (720_000, true)] {
        let mut rig = ready(1, compare);
        start(&mut rig);
        rig.step(PERIOD * 7 / 2);
        assert_eq!((edges(&rig), rig.part.pad(PB10)), (vec![], Pad::Driven(level)), "{compare}");
    }
}
