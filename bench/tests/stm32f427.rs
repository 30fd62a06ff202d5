//! The models this crate adds to the STM32F427, and those of rigless the HORUS firmware's timing rests on.

mod thumb;

use bench::engine::{Bare, FindingKind, Firmware, Node};
use bench::stm32f427::{EXTI3_INTERRUPT, Oscillators, PinId, Stm32f427Part, TIM2_INTERRUPT};
use rigless::device::ResetCause;
use thumb::{COUNTER, EXTI, FLASH, GPIOD, HANDLER, MAIN, RCC, TIM2, Thumb, firmware};

const MS: u64 = 1_000_000;
const APB1ENR: u32 = RCC + 0x40;
const APB2ENR: u32 = RCC + 0x44;

fn run(firmware: &Firmware, lines: &[u16], to: u64) -> Node<Bare<Stm32f427Part>> {
    let mut node = Node::new(Bare(Stm32f427Part::new(Oscillators::default())), firmware).unwrap();
    for &line in lines {
        node.watch_line(line);
    }
    node.advance(to);
    assert_eq!(node.take_findings(), []);
    node
}

fn rises(node: &mut Node<Bare<Stm32f427Part>>, line: u16) -> Vec<u64> {
    node.take_edges().iter().filter(|edge| edge.line == line && edge.high).map(|edge| edge.at).collect()
}

fn periods(instants: &[u64]) -> Vec<u64> {
    instants.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

#[test]
fn a_compare_match_comes_at_its_place_after_the_update() {
    let mut main = Thumb::at(MAIN);
    main.store(APB1ENR, 1).store(TIM2 + 0x2C, 159_999).store(TIM2 + 0x34, 4_800).store(TIM2 + 0x0C, 3);
    main.enable(28).store(TIM2, 1).idle();
    let mut hit = Thumb::at(HANDLER);
    hit.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    let mut node = run(&firmware("compare", &main, &[(28, &hit)]), &[TIM2_INTERRUPT], 52 * MS);
    let rises = rises(&mut node, TIM2_INTERRUPT);
    assert_eq!(rises.len(), 11);
    for (nth, period) in periods(&rises).into_iter().enumerate() {
        // A match is 300 us after the update before it, the next update 9.7 ms after that.
        assert_eq!(period, if nth % 2 == 0 { 9_700_000 } else { 300_000 });
    }
}

#[test]
fn a_basic_timer_interrupts_at_its_rate() {
    const TIM6: u32 = 0x4000_1000;
    let mut main = Thumb::at(MAIN);
    main.store(APB1ENR, 1 << 4).store(TIM6 + 0x28, 15).store(TIM6 + 0x2C, 999).store(TIM6 + 0x14, 1);
    main.store(TIM6 + 0x10, 0).store(TIM6 + 0x0C, 1).enable(54).store(TIM6, 1).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM6 + 0x10, 0).count(COUNTER).ret();
    let mut node = run(&firmware("basic timer", &main, &[(54, &tick)]), &[54], 101 * MS / 2);
    let rises = rises(&mut node, 54);
    assert_eq!(rises.len(), 50);
    assert!(periods(&rises).iter().all(|&period| period == MS));
    assert_eq!(node.word(u64::from(COUNTER)), Some(50));
}

#[test]
fn a_simple_timer_flags_its_compare_channels_and_its_update() {
    const TIM9: u32 = 0x4001_4000;
    let mut main = Thumb::at(MAIN);
    main.store(APB2ENR, 1 << 16).store(TIM9 + 0x2C, 15_999).store(TIM9 + 0x34, 4_000).store(TIM9 + 0x38, 8_000);
    main.store(TIM9 + 0x0C, 7).enable(24).store(TIM9, 1).idle();
    let mut hit = Thumb::at(HANDLER);
    hit.store(TIM9 + 0x10, 0).count(COUNTER).ret();
    let mut node = run(&firmware("simple timer", &main, &[(24, &hit)]), &[24], 10 * MS + MS / 10);
    let rises = rises(&mut node, 24);
    assert_eq!(rises.len(), 30);
    for (nth, period) in periods(&rises).into_iter().enumerate() {
        assert_eq!(period, [250_000, 500_000, 250_000][nth % 3]);
    }
}

#[test]
fn a_basic_timer_that_is_polled_ends_the_poll_at_its_instant() {
    const TIM7: u32 = 0x4000_1400;
    let mut main = Thumb::at(MAIN);
    main.store(APB1ENR, 1 << 5).store(TIM7 + 0x2C, 31_999).store(TIM7, 1 << 3 | 1);
    main.wait_for(TIM7 + 0x10, 0).count(COUNTER).idle();
    let mut node = run(&firmware("one pulse", &main, &[]), &[], 5 * MS);
    assert_eq!(node.word(u64::from(COUNTER)), Some(1));
    // 32 000 cycles at 16 MHz, and some thirty instructions around them, 94 ns each.
    let awake = node.usage().awake;
    assert!((2_000_000..2_003_000).contains(&awake), "{awake} ns awake");
}

#[test]
fn the_window_watchdog_restarts_a_part_that_does_not_refresh_it() {
    const WWDG: u32 = 0x4000_2C00;
    let mut main = Thumb::at(MAIN);
    main.count(COUNTER).mov(0, RCC + 0x74).ldr(1, 0, 0).mov(0, COUNTER).str(1, 0, 4);
    main.store(APB1ENR, 1 << 11).store(WWDG, 0xFF).idle();
    let mut node = run(&firmware("window watchdog", &main, &[]), &[], 100 * MS);
    // 64 counts of 4096 cycles at 16 MHz are 16.384 ms.
    let resets: Vec<_> = node.resets().collect();
    assert_eq!(resets.len(), 6);
    assert!(resets.iter().all(|reset| reset.cause == ResetCause::Model("WWDG")));
    let first = resets[0].at;
    assert!((16_384_000..16_386_000).contains(&first), "{first}");
    assert_eq!(node.word(u64::from(COUNTER)), Some(7));
    // RCC_CSR says why: WWDGRSTF, and neither SFTRSTF nor IWDGRSTF.
    assert_eq!(node.word(u64::from(COUNTER + 4)).map(|flags| flags >> 28 & 7), Some(4));
}

#[test]
fn refreshing_the_window_watchdog_too_early_restarts_the_part() {
    const WWDG: u32 = 0x4000_2C00;
    let mut main = Thumb::at(MAIN);
    main.store(APB1ENR, 1 << 11).store(WWDG + 0x04, 0x50).store(WWDG, 0xFF).store(WWDG, 0xFF).idle();
    let node = run(&firmware("early", &main, &[]), &[], MS / 100);
    assert!(node.resets().len() > 1);
}

#[test]
fn the_independent_watchdog_restarts_a_part_that_hangs() {
    const IWDG: u32 = 0x4000_3000;
    let mut main = Thumb::at(MAIN);
    main.count(COUNTER).store(IWDG, 0xCCCC);
    let here = main.here();
    main.branch(here);
    let node = run(&firmware("hang", &main, &[]), &[], 1_200 * MS);
    let resets: Vec<_> = node.resets().collect();
    // 4096 counts of 4 cycles at 32 kHz are 512 ms, on top of the oscillator's start.
    assert_eq!(resets.len(), 2);
    assert!(resets.iter().all(|reset| reset.cause == ResetCause::Model("IWDG")));
    assert!((512 * MS..514 * MS).contains(&resets[0].at), "{}", resets[0].at);
}

#[test]
fn a_dma_controller_does_not_reach_core_coupled_memory() {
    const DMA2: u32 = 0x4002_6400;
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x30, 1 << 22 | 1 << 20).store(DMA2 + 0x18, FLASH).store(DMA2 + 0x1C, 0x1000_0000);
    main.store(DMA2 + 0x14, 4).store(DMA2 + 0x10, 2 << 6 | 1).idle();
    let mut node = Node::new(Bare(Stm32f427Part::new(Oscillators::default())), &firmware("ccm", &main, &[])).unwrap();
    node.advance(MS);
    let findings = node.take_findings();
    assert!(findings.iter().any(|finding| finding.kind == FindingKind::Unreachable), "{findings:?}");
}

const PA3: PinId = PinId::new('A', 3);
const PD14: PinId = PinId::new('D', 14);

#[test]
fn an_edge_reaches_the_core_at_its_instant_and_only_the_chosen_one() {
    let mut main = Thumb::at(MAIN);
    main.exti3_on_pa3().idle();
    let mut hit = Thumb::at(HANDLER);
    hit.store(EXTI + 0x14, 1 << 3).count(COUNTER).ret();
    let mut node = run(&firmware("edge", &main, &[(9, &hit)]), &[EXTI3_INTERRUPT], MS);
    for (at, high) in [(1_000_123, true), (1_010_000, false), (1_020_457, true)] {
        node.advance(at);
        assert_eq!(node.now(), at);
        node.input(|board, at| board.0.drive_pin(at, PA3, high));
    }
    node.advance(2 * MS);
    assert_eq!(rises(&mut node, EXTI3_INTERRUPT), [1_000_123, 1_020_457]);
    assert_eq!(node.word(u64::from(COUNTER)), Some(2));
}

#[test]
fn software_raises_an_exti_line_and_clears_it() {
    let mut main = Thumb::at(MAIN);
    main.exti3_on_pa3().store(EXTI + 0x10, 1 << 3).idle();
    let mut hit = Thumb::at(HANDLER);
    hit.store(EXTI + 0x14, 1 << 3).count(COUNTER).ret();
    let mut node = run(&firmware("software edge", &main, &[(9, &hit)]), &[], MS);
    assert_eq!(node.word(u64::from(COUNTER)), Some(1));
}

#[test]
fn what_drives_a_pin_still_drives_it_after_a_reset() {
    const WWDG: u32 = 0x4000_2C00;
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x30, 1 | 1 << 3).store(GPIOD, 1 << 28).store(GPIOD + 0x18, 1 << 14);
    main.store(APB1ENR, 1 << 11).store(WWDG, 0xFF).idle();
    let mut part = Stm32f427Part::new(Oscillators::default());
    part.drive_pin(0, PA3, true);
    part.watch_pin(PD14);
    let mut node = Node::new(Bare(part), &firmware("pins", &main, &[])).unwrap();
    node.advance(20 * MS);
    assert_eq!(node.resets().len(), 1);
    assert!(node.board().0.pin(PA3));
    // The firmware's own output falls with the reset and rises again.
    let levels: Vec<bool> = node.board_mut().0.take_edges().iter().map(|edge| edge.high).collect();
    assert_eq!(levels, [true, false, true]);
}
