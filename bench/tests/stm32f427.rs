//! The models this crate adds to the STM32F427, and those of rigless the HORUS firmware's timing rests on.

mod thumb;

use bench::engine::{Bare, FindingKind, Firmware, FromOutside, Node};
use bench::stm32f427::{EXTI3_INTERRUPT, Oscillators, PinId, Stm32f427Part, TIM2_INTERRUPT};
use rigless::device::ResetCause;
use rigless::mcu::Mcu;
use rigless::soc::stm32f427::generated::rcc::Register;
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

// ---- oscillators

const CIR: u32 = RCC + 0x0C;
const HSEON: u32 = 1 << 16;
const HSEBYP: u32 = 1 << 18;
const CSSON: u32 = 1 << 19;
const PLLON: u32 = 1 << 24;
/// 8 MHz / 4 * 144 / 2 = 144 MHz from HSE; PLLSRC is bit 22.
const PLL_144_FROM_HSE: u32 = 4 | 144 << 6 | 7 << 24 | 1 << 22;
/// What the core leaves where it has come to, and what its NMI's handler leaves.
const NMIS: u32 = COUNTER + 4;

/// Words of a node as a debugger reads them.
fn read<const N: usize>(node: &mut Node<Bare<Stm32f427Part>>, addresses: [u32; N]) -> [u32; N] {
    addresses.map(|address| node.word(u64::from(address)).unwrap())
}

fn register(node: &Node<Bare<Stm32f427Part>>, offset: u64) -> u64 {
    let register = [(0x00, Register::Cr), (0x08, Register::Cfgr), (0x0C, Register::Cir), (0x74, Register::Csr)];
    let (_, register) = register.into_iter().find(|(at, _)| *at == offset).unwrap();
    let bus = node.board().0.bus();
    bus.slots()[bus.slot_of("RCC").unwrap()].registers().get(register)
}

/// HSE and the PLL on it, as far as they start; then the PLL is asked for as the system clock, with TIM2 at 1 kHz of 16
/// MHz and the watchdog running. `extra` goes into CR with HSEON.
fn on_the_pll(extra: u32) -> Thumb {
    let mut main = Thumb::at(MAIN);
    main.store(RCC, 0x83 | HSEBYP | HSEON | extra).wait_for(RCC, 17);
    main.store(RCC + 0x04, PLL_144_FROM_HSE).store(RCC, 0x83 | HSEBYP | HSEON | PLLON | extra).wait_for(RCC, 25);
    main.store(0x4002_3C00, 4).store(RCC + 0x08, 2 | 5 << 10 | 4 << 13).wait_for(RCC + 0x08, 3);
    main
}

/// Counts NMIs, and clears the clock security system's flag where `clears`.
fn nmi_handler(clears: bool) -> Thumb {
    let mut nmi = Thumb::at(HANDLER);
    nmi.count(NMIS);
    if clears {
        nmi.store(CIR, 1 << 23);
    }
    nmi.ret();
    nmi
}

/// `main` with `nmi` in the vector table.
fn with_nmi(main: &Thumb, nmi: &Thumb, handlers: &[(u32, &Thumb)]) -> Firmware {
    let image = firmware("clock security", main, handlers);
    let mut segments = image.segments().to_vec();
    segments[0].1[8..12].copy_from_slice(&(HANDLER | 1).to_le_bytes());
    segments.push((u64::from(HANDLER), nmi.bytes()));
    Firmware::raw("clock security", segments)
}

fn node_with(oscillators: Oscillators, firmware: &Firmware) -> Node<Bare<Stm32f427Part>> {
    Node::new(Bare(Stm32f427Part::new(oscillators)), firmware).unwrap()
}

#[test]
fn a_crystal_that_is_absent_never_gets_ready_and_nothing_locks_to_it() {
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x04, PLL_144_FROM_HSE).store(RCC, 0x83 | HSEON | PLLON | CSSON).store(RCC + 0x08, 1);
    main.tim2_every(16_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    let absent = Oscillators { hse_hz: None, ..Oscillators::default() };
    let mut node = node_with(absent, &firmware("no crystal", &main, &[(28, &tick)]));
    node.advance(100 * MS);
    let control = register(&node, 0x00);
    assert_eq!(control & u64::from(HSEON | PLLON), u64::from(HSEON | PLLON), "asked for");
    assert_eq!(control >> 17 & 1, 0, "HSERDY");
    assert_eq!(control >> 25 & 1, 0, "PLLRDY");
    assert_eq!(register(&node, 0x08) >> 2 & 3, 0, "still on HSI");
    assert_eq!(register(&node, 0x0C) & 1 << 7, 0, "a detector that never had a clock reports no failure");
    assert!(node.word(u64::from(COUNTER)).unwrap().abs_diff(99) <= 1, "16 MHz throughout");
    // Plugged in, it starts by itself, and what waited for it goes on.
    node.input(|board, at| board.0.restore_hse(at));
    node.advance(101 * MS);
    assert_eq!(register(&node, 0x00) >> 17 & 1, 1, "HSERDY");
    assert_eq!(register(&node, 0x08) >> 2 & 3, 1, "on HSE");
    assert_eq!(node.take_findings(), []);
}

#[test]
fn the_clock_security_system_switches_a_failed_crystal_to_hsi_and_interrupts() {
    let mut main = on_the_pll(CSSON);
    // The timer's clock is twice PCLK1, 72 MHz, and 16 MHz / 2 from HSI: PPRE1 divides by four.
    main.tim2_every(72_000).idle();
    let mut tick = Thumb::at(HANDLER + 0x100);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    let mut node = node_with(Oscillators::default(), &with_nmi(&main, &nmi_handler(true), &[(28, &tick)]));
    node.advance(50 * MS);
    assert_eq!(register(&node, 0x08) >> 2 & 3, 2, "on the PLL");
    let [before, none] = read(&mut node, [COUNTER, NMIS]);
    assert!(before.abs_diff(49) <= 1, "{before}");
    assert_eq!(none, 0);
    node.input(|board, at| board.0.fail_hse(at));
    node.advance(140 * MS);
    assert_eq!(register(&node, 0x08) & 0xF, 0, "on HSI");
    let control = register(&node, 0x00);
    assert_eq!(control & u64::from(HSEON | PLLON), 0, "HSE and the PLL are off");
    assert_eq!(control & 3, 3, "HSI runs");
    let [after, nmis] = read(&mut node, [COUNTER, NMIS]);
    assert_eq!(nmis, 1, "once: its handler cleared the flag");
    // 72 000 counts at 8 MHz are 9 ms.
    assert!((after - before).abs_diff(10) <= 1, "{after} after {before}");
    assert_eq!(register(&node, 0x0C) & 1 << 7, 0);
    assert_eq!(node.take_findings(), []);
}

#[test]
fn the_clock_securitys_interrupt_comes_again_until_its_flag_is_cleared() {
    let mut main = on_the_pll(CSSON);
    main.idle();
    let mut node = node_with(Oscillators::default(), &with_nmi(&main, &nmi_handler(false), &[]));
    node.advance(10 * MS);
    node.input(|board, at| board.0.fail_hse(at));
    node.advance(11 * MS);
    let [nmis] = read(&mut node, [NMIS]);
    // Some ten instructions of 94 ns each in a millisecond.
    assert!(nmis > 300, "{nmis} NMIs");
    assert_ne!(register(&node, 0x0C) & 1 << 7, 0, "CSSF");
}

#[test]
fn a_crystal_that_fails_unwatched_stops_the_core_until_the_watchdog_restarts_it_on_hsi() {
    let mut main = on_the_pll(0);
    main.count(COUNTER).store(0x4000_3000, 0xCCCC); // 512 ms
    let again = main.here();
    main.count(COUNTER).branch(again);
    let mut node = node_with(Oscillators::default(), &firmware("unwatched", &main, &[]));
    node.advance(10 * MS);
    let [ran] = read(&mut node, [COUNTER]);
    assert!(ran > 1_000);
    node.input(|board, at| board.0.fail_hse(at));
    node.advance(60 * MS);
    assert_eq!(node.now(), 60 * MS, "time goes on");
    let [stood] = read(&mut node, [COUNTER]);
    assert!(stood <= ran + 1, "{stood} after {ran}");
    assert_eq!(register(&node, 0x0C) & 1 << 7, 0, "nobody watched");
    assert!(node.usage().awake < 11 * MS);
    node.advance(600 * MS);
    let causes: Vec<_> = node.resets().map(|reset| reset.cause).collect();
    assert_eq!(causes, [ResetCause::Model("IWDG")], "the watchdog has an oscillator of its own");
    assert_eq!(register(&node, 0x00) >> 16 & 3, 1, "HSE is asked for again and does not come");
}

#[test]
fn an_hsi_that_is_off_moves_everything_that_is_clocked_from_it() {
    // 1 % either way, the range at 25 degrees; TIM2 at 1 kHz of 16 MHz, TIM6 beside it from this module.
    const TIM6: u32 = 0x4000_1000;
    for ppb in [-10_000_000, 0, 10_000_000] {
        let mut main = Thumb::at(MAIN);
        main.store(APB1ENR, 1 | 1 << 4).store(TIM2 + 0x2C, 15_999).store(TIM2 + 0x0C, 1).enable(28);
        main.store(TIM6 + 0x2C, 15_999).store(TIM6 + 0x0C, 1).enable(54).store(TIM2, 1).store(TIM6, 1);
        let again = main.here();
        main.count(COUNTER).branch(again);
        let (mut first, mut second) = (Thumb::at(HANDLER), Thumb::at(HANDLER + 0x100));
        first.store(TIM2 + 0x10, 0).ret();
        second.store(TIM6 + 0x10, 0).ret();
        let oscillators = Oscillators { hsi_ppb: ppb, ..Oscillators::default() };
        let mut node = node_with(oscillators, &firmware("hsi", &main, &[(28, &first), (54, &second)]));
        node.watch_line(TIM2_INTERRUPT);
        node.watch_line(54);
        node.advance(100 * MS);
        let edges = node.take_edges();
        let wanted = 1_000_000_000_000_000 / u64::try_from(1_000_000_000 + ppb).unwrap();
        for line in [TIM2_INTERRUPT, 54] {
            let instants: Vec<u64> =
                edges.iter().filter(|edge| edge.line == line && edge.high).map(|edge| edge.at).collect();
            assert!(instants.len() > 90);
            for period in periods(&instants) {
                assert!(period.abs_diff(wanted) <= 1, "line {line}, {ppb} ppb: {period} ns");
            }
        }
        // 1.5 cycles an instruction.
        let ran = node.instructions();
        let expected = 16_000_000 / 10 * 2 / 3;
        let expected = expected * u64::try_from(1_000_000_000 + ppb).unwrap() / 1_000_000_000;
        assert!(ran.abs_diff(expected) <= 2, "{ppb} ppb: {ran} instructions");
        assert_eq!(node.take_findings(), []);
    }
}

// ---- resets

#[test]
fn each_cause_of_a_reset_sets_its_own_flags_and_only_rmvf_or_the_supply_clears_them() {
    const BOR: u64 = 1 << 25;
    const PIN: u64 = 1 << 26;
    const POR: u64 = 1 << 27;
    const SFT: u64 = 1 << 28;
    const IWDG: u64 = 1 << 29;
    const FLAGS: u64 = 0xFE00_0000;
    // The watchdog as it comes: 512 ms.
    let mut main = Thumb::at(MAIN);
    main.store(0x4000_3000, 0xCCCC).idle();
    let mut node = node_with(Oscillators::default(), &firmware("flags", &main, &[]));
    let flags = |node: &Node<Bare<Stm32f427Part>>| register(node, 0x74) & FLAGS;
    assert_eq!(flags(&node), POR | PIN | BOR, "power-on: all three");
    node.restart(FromOutside::BrownOut);
    assert_eq!(flags(&node), PIN | BOR, "a brown-out is no power-on, and clears the rest");
    node.advance(MS);
    node.restart(FromOutside::Pin);
    assert_eq!(flags(&node), PIN | BOR, "they stand");
    node.advance(600 * MS);
    assert_eq!(flags(&node), PIN | BOR | IWDG, "and the watchdog's joins them");
    node.restart(FromOutside::PowerOn(1));
    assert_eq!(flags(&node), POR | PIN | BOR);
    let causes: Vec<_> = node.resets().map(|reset| reset.cause).collect();
    let wanted = [ResetCause::PowerOn, ResetCause::Pin, ResetCause::Model("IWDG"), ResetCause::PowerOn];
    assert_eq!(causes, wanted);

    // A firmware that keeps the flags it found, clears them, keeps what is left, and restarts itself once.
    let mut main = Thumb::at(MAIN);
    main.mov(0, RCC + 0x74).ldr(1, 0, 0).mov(0, COUNTER).str(1, 0, 0).store(RCC + 0x74, 1 << 24);
    main.mov(0, RCC + 0x74).ldr(1, 0, 0).mov(0, NMIS).str(1, 0, 0);
    main.mov(0, COUNTER).ldr(1, 0, 0).test(1, 28);
    let here = main.here();
    // Past the request: this branch, and a `store` of four wide moves and one narrow instruction.
    main.branch_if(thumb::If::CarrySet, here + 2 + 18).store(0xE000_ED0C, 0x05FA_0004).idle();
    let mut node = node_with(Oscillators::default(), &firmware("soft", &main, &[]));
    node.advance(MS);
    let [before, after] = read(&mut node, [COUNTER, NMIS]).map(|word| u64::from(word) & FLAGS);
    assert_eq!((before, after), (SFT | PIN, 0), "a software reset's flag, after RMVF cleared those of power-on");
    assert_eq!(node.resets().len(), 1);
}

#[test]
fn ram_keeps_its_contents_through_a_pin_reset_and_a_brown_out_and_comes_up_with_noise_at_power_on() {
    let mut main = Thumb::at(MAIN);
    main.idle();
    let mut node = node_with(Oscillators::default(), &firmware("ram", &main, &[]));
    let place = u64::from(COUNTER) + 0x100;
    node.write(place, &0x1234_5678_u32.to_le_bytes()).unwrap();
    for why in [FromOutside::Pin, FromOutside::BrownOut] {
        node.restart(why);
        node.advance(node.now() + MS);
        assert_eq!(node.word(place), Some(0x1234_5678), "{why:?}");
    }
    let mut came_up = vec![];
    for seed in [7, 7, 8] {
        node.restart(FromOutside::PowerOn(seed));
        came_up.push(node.word(place));
        node.advance(node.now() + MS);
    }
    assert_eq!(came_up[0], came_up[1], "the seed's");
    assert_ne!(came_up[0], came_up[2]);
    assert_ne!(came_up[0], Some(0x1234_5678));
    assert_eq!(node.take_findings(), []);
}

#[test]
fn a_core_that_locked_up_stays_so_until_the_watchdog_restarts_it() {
    let mut main = Thumb::at(MAIN);
    main.store(0x4000_3000, 0xCCCC).count(COUNTER);
    let again = main.here();
    main.branch(again);
    let mut node = node_with(Oscillators::default(), &firmware("lock-up", &main, &[]));
    node.advance(10 * MS);
    let before = node.word(u64::from(COUNTER));
    node.lock_up();
    node.advance(400 * MS);
    assert_eq!(node.resets().len(), 0);
    assert!(node.usage().awake < 11 * MS, "it ran nothing");
    node.advance(600 * MS);
    assert_eq!(node.resets().map(|reset| reset.cause).collect::<Vec<_>>(), [ResetCause::Model("IWDG")]);
    assert_eq!(node.word(u64::from(COUNTER)), before.map(|count| count + 1), "started again");
    assert!(node.take_findings().iter().all(|finding| finding.kind == FindingKind::Lockup));
}
