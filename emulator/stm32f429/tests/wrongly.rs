//! Tests that wrong settings do not work and are reported. The real part would not report them.

use crate::rig;

use cortex_m4::{BusError, Width};
use emulator_part::{FindingKind, Pad, Part, Pin, Reset, UartFrame};
use rig::*;
use stm32f429::Oscillators;

const GPIOB: u32 = 0x4002_0400;
const TIM5: u32 = 0x4000_0C00;

#[test]
fn a_pll_out_of_its_limits_never_locks() {
    // The three settings are a PLLM of 1, a VCO at 433 MHz, and a VCO input of 0.5 MHz.
    for config in [1 | 50 << 6, 8 | 433 << 6, 16 | 400 << 6] {
        let mut rig = Rig::new(Oscillators::default());
        rig.write(RCC + 4, config | 4 << 24 | 1 << 22);
        rig.write(RCC, 0x83 | 1 << 18);
        rig.write(RCC, 0x83 | 1 << 18 | 1 << 16);
        rig.step(1000);
        rig.set(RCC, 1 << 24);
        rig.step(16_000_000);
        assert_eq!(rig.read(RCC) & 1 << 25, 0, "{config:#x}");
        assert!(rig.found(FindingKind::Misuse, "never locks"));
    }
}

#[test]
fn a_pll_configuration_that_is_written_while_the_pll_is_on_stays() {
    let mut rig = Rig::board();
    let old = rig.read(RCC + 4);
    rig.write(RCC + 4, old ^ 1 << 6);
    assert_eq!(rig.read(RCC + 4), old);
    assert!(rig.found(FindingKind::Misuse, "it stays"));
}

#[test]
fn what_clocks_the_system_cannot_be_switched_off() {
    let mut rig = Rig::board();
    rig.write(RCC, 0x80);
    let cr = rig.read(RCC);
    assert_eq!(cr & (1 << 24 | 1 << 16), 1 << 24 | 1 << 16);
    assert_eq!(cr & 3, 0, "HSI may go");
    assert_eq!(rig.part.clock().hz, 144_000_000);
}

#[test]
fn an_apb_clock_over_its_limit_is_found() {
    let mut rig = Rig::board();
    assert!(!rig.found(FindingKind::Misuse, "PCLK1"));
    rig.write(RCC + 8, 4 << 10 | 4 << 13 | 2);
    assert!(rig.found(FindingKind::Misuse, "PCLK1 is faster"));
}

#[test]
fn a_timers_clock_is_twice_its_divided_bus() {
    let mut rig = Rig::board();
    rig.set(RCC + 0x40, 1 << 3);
    rig.write(TIM5, 1);
    let (from, at) = (rig.read(TIM5 + 0x24), rig.now);
    rig.step(1_000_000);
    let (to, end) = (rig.read(TIM5 + 0x24), rig.now);
    assert!((u64::from(to - from)).abs_diff((end - at) / 2) <= 1, "72 MHz of 144 MHz");
}

#[test]
fn a_pin_without_its_function_carries_no_spi() {
    let mut rig = Rig::board();
    let moder = rig.read(GPIOA);
    rig.write(GPIOA, moder & !0xFC00 | 0xA800);
    rig.write(SPI1, 1 | 1 << 2 | 2 << 3 | 3 << 8 | 1 << 6);
    rig.write(SPI1 + 0xC, 0x55);
    rig.step(1000);
    assert!(rig.bench.frames.iter().all(|frame| frame.sck[0].is_none() && frame.mosi[0].is_none()));
}

#[test]
fn a_function_that_a_pin_does_not_have_is_found() {
    let mut rig = Rig::board();
    let afr = rig.read(GPIOA + 0x20);
    rig.write(GPIOA + 0x20, afr | 8 << 20);
    let moder = rig.read(GPIOA);
    rig.write(GPIOA, moder & !0xC00 | 0x800);
    assert!(rig.found(FindingKind::Misuse, "no such alternate function"));
}

#[test]
fn a_receiver_whose_pin_is_not_connected_hears_nothing() {
    let mut rig = Rig::board();
    rig.write(USART2 + 8, 78);
    rig.write(USART2 + 0xC, 1 << 13 | 1 << 2);
    let frame = UartFrame::eight_n_one(0x41, 460_800);
    rig.part.receive(rig.now, Pin::new(3, 6), frame, &mut rig.bench);
    rig.step(10_000);
    assert_eq!(rig.read(USART2) & 1 << 5, 0);
}

#[test]
fn a_high_open_drain_lets_go_and_the_outside_decides() {
    let mut rig = Rig::board();
    let pin = Pin::new(1, 8);
    rig.write(GPIOB + 4, 1 << 8);
    rig.write(GPIOB + 0x18, 1 << 8);
    let moder = rig.read(GPIOB);
    rig.write(GPIOB, moder | 1 << 16);
    assert_eq!(rig.part.pad(pin), Pad::Floating);
    rig.part.drive(rig.now, pin, Some(true), &mut rig.bench);
    assert_eq!(rig.read(GPIOB + 0x10) & 1 << 8, 1 << 8);
    rig.write(GPIOB + 0x18, 1 << 24);
    assert_eq!(rig.read(GPIOB + 0x10) & 1 << 8, 0);
}

#[test]
fn a_locked_pin_keeps_its_configuration_until_a_reset() {
    let mut rig = Rig::board();
    for value in [1 << 16 | 1 << 8, 1 << 8, 1 << 16 | 1 << 8] {
        rig.write(GPIOB + 0x1C, value);
    }
    assert_eq!(rig.read(GPIOB + 0x1C), 1 << 16 | 1 << 8);
    let moder = rig.read(GPIOB);
    rig.write(GPIOB, moder | 1 << 16 | 1 << 18);
    assert_eq!(rig.read(GPIOB), moder | 1 << 18);
    rig.part.reset(rig.now, Reset::Pin, &mut rig.bench);
    rig.set(RCC + 0x30, 2);
    rig.write(GPIOB, 1 << 16);
    assert_eq!(rig.read(GPIOB), 1 << 16);
}

#[test]
fn after_a_reset_the_debug_pins_are_theirs_and_all_others_inputs() {
    let mut rig = Rig::board();
    rig.write(GPIOD, u32::MAX);
    rig.part.reset(rig.now, Reset::Software, &mut rig.bench);
    rig.set(RCC + 0x30, 0x7FF);
    assert_eq!(rig.read(GPIOA), 0xA800_0000);
    assert_eq!(rig.read(GPIOB), 0x0000_0280);
    assert_eq!(rig.read(GPIOD), 0);
    assert_eq!(rig.part.pad(Pin::new(0, 13)), Pad::Pulled(true), "SWDIO");
    assert_eq!(rig.part.pad(Pin::new(0, 14)), Pad::Pulled(false), "SWCLK");
    assert_eq!(rig.part.pad(Pin::new(1, 4)), Pad::Pulled(true), "NJTRST");
}

#[test]
fn a_software_interrupt_of_a_masked_line_does_nothing() {
    let mut rig = Rig::board();
    rig.write(EXTI + 0x10, 1 << 7);
    assert_eq!(rig.read(EXTI + 0x14), 0);
    rig.write(EXTI + 0x10, 0);
    rig.write(EXTI, 1 << 6);
    rig.write(EXTI + 0x10, 1 << 6);
    assert!(rig.line(23));
    rig.write(EXTI + 0x14, 1 << 6);
    assert!(!rig.line(23));
    assert_eq!(rig.read(EXTI + 0x10) & 1 << 6, 0);
}

#[test]
fn an_edge_that_syscfg_routes_from_another_port_does_not_count() {
    let mut rig = Rig::board();
    rig.write(SYSCFG + 8, 3 << 12);
    rig.write(EXTI + 8, 1 << 3);
    rig.write(EXTI, 1 << 3);
    rig.part.drive(rig.now, Pin::new(0, 3), Some(true), &mut rig.bench);
    assert!(!rig.line(9));
    rig.part.drive(rig.now, Pin::new(3, 3), Some(true), &mut rig.bench);
    assert!(rig.line(9));
}

#[test]
fn the_watchdogs_registers_stay_without_their_key() {
    let mut rig = Rig::board();
    rig.write(IWDG + 8, 5);
    rig.step(1_000_000);
    assert_eq!(rig.read(IWDG + 8), 0xFFF);
    assert!(rig.found(FindingKind::Misuse, "without the key"));
}

#[test]
fn a_reset_of_a_peripheral_clears_its_registers_and_frees_its_pins() {
    let mut rig = Rig::board();
    rig.spi_up();
    rig.set(RCC + 0x24, 1 << 12);
    assert_eq!(rig.read(SPI1), 0, "held in reset");
    rig.write(RCC + 0x24, 0);
    assert_eq!(rig.read(SPI1), 0);
    assert_eq!(rig.part.pad(Pin::new(0, 5)), Pad::Floating);
}

#[test]
fn the_backup_domain_needs_dbp_and_survives_a_pin_reset() {
    let mut rig = Rig::board();
    rig.write(RCC + 0x70, 1);
    assert_eq!(rig.read(RCC + 0x70), 0);
    rig.set(PWR, 1 << 8);
    rig.write(RCC + 0x70, 2 << 8 | 1 << 15);
    rig.part.reset(rig.now, Reset::Pin, &mut rig.bench);
    assert_eq!(rig.read(RCC + 0x70), 2 << 8 | 1 << 15);
    rig.part.reset(rig.now, Reset::PowerOn, &mut rig.bench);
    assert_eq!(rig.read(RCC + 0x70), 0);
}

#[test]
fn address_zero_is_what_syscfg_maps_there() {
    let mut rig = Rig::board();
    rig.part.memory_mut(0x0800_0000, 4).expect("flash").copy_from_slice(&[1, 2, 3, 4]);
    rig.write(0x2000_0000, 0x1122_3344);
    assert_eq!(rig.read(0), 0x0403_0201);
    rig.write(SYSCFG, 3);
    assert_eq!(rig.read(0), 0x1122_3344);
    assert!(rig.part.signals().forgets_code());
}

#[test]
fn the_cores_own_ram_is_data_alone() {
    let mut rig = Rig::board();
    rig.write(0x1000_0000, 5);
    assert_eq!(rig.read(0x1000_0000), 5);
    assert_eq!(rig.part.fetch(0x1000_0000), Err(BusError));
    assert_eq!(rig.try_read(0x1001_0000, Width::Word), Err(BusError));
}

#[test]
fn dma1_does_not_reach_apb2() {
    let mut rig = Rig::board();
    rig.set(RCC + 0x40, 1 << 3);
    // The request TIM5_UP is on stream 6, channel 6. Its transfers read SPI1, which is on APB2.
    rig.write(DMA1 + 0x10 + 6 * 0x18 + 4, 1);
    rig.write(DMA1 + 0x10 + 6 * 0x18 + 8, SPI1 + 0xC);
    rig.write(DMA1 + 0x10 + 6 * 0x18 + 12, 0x2000_0000);
    rig.write(DMA1 + 0x10 + 6 * 0x18, 6 << 25 | 1 << 2 | 1);
    rig.write(TIM5 + 0xC, 1 << 8);
    rig.write(TIM5 + 0x14, 1);
    rig.step(10);
    assert!(rig.found(FindingKind::Unreachable, "peripheral port"));
    assert!(rig.line(17));
}

#[test]
fn a_double_buffer_changes_sides_at_each_lap() {
    let mut rig = Rig::board();
    rig.set(RCC + 0x40, 1 << 3);
    let stream = DMA1 + 0x10 + 6 * 0x18;
    rig.write(stream + 4, 2);
    rig.write(stream + 8, TIM5 + 0x2C);
    rig.write(stream + 12, 0x2000_0000);
    rig.write(stream + 16, 0x2000_0100);
    rig.write(0x2000_0000, 10);
    rig.write(0x2000_0004, 11);
    rig.write(0x2000_0100, 12);
    rig.write(0x2000_0104, 13);
    rig.write(stream, 6 << 25 | 1 << 18 | 2 << 13 | 2 << 11 | 1 << 10 | 1 << 6 | 1);
    rig.write(TIM5 + 0xC, 1 << 8);
    let mut loads = Vec::new();
    for _ in 0..5 {
        rig.write(TIM5 + 0x14, 1);
        rig.step(10);
        loads.push(rig.read(TIM5 + 0x2C));
    }
    assert_eq!(loads, [10, 11, 12, 13, 10]);
    assert_eq!(rig.read(stream) >> 19 & 1, 0);
}

#[test]
fn a_deep_sleep_is_found_since_it_is_an_ordinary_one_here() {
    let mut rig = Rig::board();
    rig.part.sleeps(rig.now, true, true, &mut rig.bench);
    assert!(rig.found(FindingKind::Unmodelled, "stop and standby"));
    assert_eq!(rig.part.take_reset(), None);
}

#[test]
fn a_lasting_dma_request_occupies_its_own_controller_alone() {
    let mut rig = Rig::board();
    rig.spi_up();
    // The request SPI1_TX is on stream 3, channel 3. The transfers write CRCPR in place of DR, so TXE stays set.
    let stream = DMA2 + 0x10 + 3 * 0x18;
    rig.write(stream + 4, 60_000);
    rig.write(stream + 8, SPI1 + 0x10);
    rig.write(stream + 12, 0x2000_0000);
    rig.write(stream, 3 << 25 | 1 << 6 | 1);
    rig.write(SPI1 + 4, 2);
    // TIM5_UP is also the request of the other DMA controller's stream 6, channel 6.
    rig.set(RCC + 0x40, 1 << 3);
    let other = DMA1 + 0x10 + 6 * 0x18;
    rig.write(other + 4, 1);
    rig.write(other + 8, TIM5 + 0x2C);
    rig.write(other + 12, 0x2000_0000);
    rig.write(other, 6 << 25 | 2 << 13 | 2 << 11 | 1 << 6 | 1);
    rig.write(TIM5 + 0xC, 1 << 8);
    let before = rig.read(stream + 4);
    rig.write(TIM5 + 0x14, 1);
    rig.step(8_000);
    assert_eq!(rig.read(other + 4), 0, "served meanwhile");
    // The transfers take eight cycles each, in runs of 64.
    let moved = before - rig.read(stream + 4);
    assert!((900..=1_200).contains(&moved), "{moved} items in 8000 cycles");
}

#[test]
fn a_clock_output_that_is_connected_to_its_pin_is_found() {
    let mut rig = Rig::board();
    let cfgr = rig.read(RCC + 8);
    rig.write(RCC + 8, cfgr | 2 << 21);
    assert!(!rig.found(FindingKind::Unmodelled, "clock output"));
    let moder = rig.read(GPIOA);
    rig.write(GPIOA, moder | 2 << 16);
    rig.write(RCC + 8, cfgr);
    assert!(rig.found(FindingKind::Unmodelled, "MCO 0x1"));
}
