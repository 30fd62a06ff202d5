//! Tests of the part by a board's register accesses, without a core.

use crate::rig;

use cortex_m4::{Access, Bound, BusError, Purpose, Signals, Width};
use emulator_part::{FindingKind, Pad, Part, Pin, Reset, SpiMode, UartFrame};
use rig::*;
use stm32f429::Oscillators;

#[test]
fn a_board_comes_up_at_144_mhz_without_a_finding() {
    let mut rig = Rig::board();
    assert_eq!(rig.part.clock().hz, 144_000_000);
    assert!(rig.part.findings().is_empty(), "{:?}", rig.part.findings());
    assert_eq!(rig.part.fetch(0x0800_0000), Ok(0xFFFF));
    assert!(rig.now > 200 * 16, "the PLL takes its time to lock");
    let csr = rig.read(RCC + 0x74);
    assert_eq!(csr & 0xFE00_0000, 0x0E00_0000, "power-on, brown-out, pin");
    rig.write(RCC + 0x74, csr | 1 << 24);
    assert_eq!(rig.read(RCC + 0x74) & 0xFE00_0000, 0);
}

#[test]
fn too_few_wait_states_make_flash_unreadable() {
    let mut rig = Rig::board();
    *rig.part.signals() = Signals::default();
    rig.write(FLASH, 3 | 0x700);
    assert_eq!(rig.part.fetch(0x0800_0000), Ok(0xDEFF));
    assert!(rig.part.signals().forgets_code());
    assert!(rig.found(FindingKind::Misuse, "too few wait states"));
    rig.write(FLASH, 4 | 0x700);
    assert_eq!(rig.part.fetch(0x0800_0000), Ok(0xFFFF));
}

#[test]
fn the_short_way_to_wait_states_tells_what_the_long_way_tells() {
    let mut rig = Rig::board();
    let mut waited = 0;
    for (acr, dma) in [(4, 0), (4 | 0x700, 0), (4 | 0x700, 1)] {
        rig.write(FLASH, acr);
        rig.set(RCC + 0x30, 1 << 22);
        rig.write(DMA2 + 0x14, 1);
        rig.write(DMA2 + 0x10, dma);
        let (mut long, mut short) = (rig.part.clone(), rig.part.clone());
        for (address, fetch) in [(0, true), (4, true), (16, true), (16, false), (20, true), (24, true)] {
            for (address, bound) in [0x0800_0000, 0x2000_0000]
                .into_iter()
                .flat_map(|base| [(base + address, Bound::Best), (base + address, Bound::Worst)])
            {
                let (width, purpose) = (Width::Word, if fetch { Purpose::Fetch } else { Purpose::Data });
                let access = Access { address, width, purpose, privileged: true, cycle: 0, pc: 0 };
                let waits = long.wait_states(&access, bound);
                assert_eq!(short.memory_waits(address, fetch, 0, bound), Some(waits), "ACR {acr:#x}, {access:x?}");
                waited += u32::from(waits == 4) + u32::from(waits == 1 && address >= 0x2000_0000);
            }
        }
    }
    assert!(waited > 10, "{waited}");
    assert_eq!(rig.part.memory_waits(RCC, false, 0, Bound::Worst), None);
}

#[test]
fn a_switch_to_hse_waits_until_its_source_is_there() {
    let mut rig = Rig::new(Oscillators { hse_hz: None, ..Oscillators::default() });
    rig.set(RCC, 1 << 16);
    rig.step(16_000_000);
    assert_eq!(rig.read(RCC) & 1 << 17, 0);
    rig.write(RCC + 8, 1);
    assert_eq!(rig.read(RCC + 8) & 0xC, 0);
    rig.part.restore_hse(rig.now, &mut rig.bench);
    rig.step(16_000_000);
    assert_eq!(rig.read(RCC + 8) & 0xC, 4);
}

#[test]
fn the_security_system_answers_an_hse_failure_with_hsi_and_nmi() {
    let mut rig = Rig::board();
    rig.part.fail_hse(rig.now, &mut rig.bench);
    assert_eq!(rig.part.clock().hz, 16_000_000);
    assert!(rig.part.signals().nmi());
    assert_eq!(rig.read(RCC) & (1 << 24 | 1 << 16), 0, "PLL and HSE are off");
    rig.write(RCC + 0xC, 1 << 23);
    assert!(!rig.part.signals().nmi());
    assert!(!rig.part.has_hse());
}

#[test]
fn an_hse_failure_without_the_security_system_stops_the_core_clock() {
    let mut rig = Rig::board();
    // Software cannot clear CSSON, so the test goes on with a new part.
    let mut fresh = Rig::new(Oscillators::default());
    std::mem::swap(&mut rig, &mut fresh);
    rig.write(RCC, 0x83 | 1 << 18);
    rig.write(RCC, 0x83 | 1 << 18 | 1 << 16);
    rig.wait(RCC, 1 << 17);
    rig.write(RCC + 8, 1);
    assert_eq!(rig.part.clock().hz, 8_000_000);
    rig.part.fail_hse(rig.now, &mut rig.bench);
    assert_eq!(rig.part.clock().hz, 0);
    rig.part.restore_hse(rig.now, &mut rig.bench);
    assert_eq!(rig.part.clock().hz, 8_000_000);
}

#[test]
fn spi_frames_travel_by_dma_with_the_pins_of_the_board() {
    let mut rig = Rig::board();
    rig.spi_up();
    for (nth, byte) in [0x12_u32, 0x34, 0x56].into_iter().enumerate() {
        rig.try_write(0x2000_1000 + nth as u32, Width::Byte, byte).expect("RAM");
    }
    // Stream 0, channel 3, receives: it advances the memory address and has the transfer complete interrupt.
    rig.write(SPI1 + 4, 1);
    rig.write(DMA2 + 0x14, 3);
    rig.write(DMA2 + 0x18, SPI1 + 0xC);
    rig.write(DMA2 + 0x1C, 0x2000_2000);
    rig.write(DMA2 + 0x10, 3 << 25 | 3 << 16 | 1 << 10 | 1 << 4 | 1);
    // Stream 3, channel 3, sends.
    rig.write(DMA2 + 0x5C, 3);
    rig.write(DMA2 + 0x60, SPI1 + 0xC);
    rig.write(DMA2 + 0x64, 0x2000_1000);
    rig.write(DMA2 + 0x58, 3 << 25 | 2 << 16 | 1 << 10 | 1 << 6 | 1);
    rig.write(SPI1 + 4, 3);
    let begun = rig.now;
    assert!(!rig.line(56));
    rig.step(1000);
    assert!(rig.line(56), "stream 0 is complete");
    let frames = &rig.bench.frames;
    assert_eq!(frames.iter().map(|frame| frame.data).collect::<Vec<_>>(), [0x12, 0x34, 0x56]);
    let pin = |number| Some(Pin::new(0, number));
    assert_eq!((frames[0].sck[0], frames[0].mosi[0], frames[0].miso), (pin(5), pin(7), pin(6)));
    assert_eq!((frames[0].mode, frames[0].bits), (SpiMode::Mode1, 8));
    // At 9 MHz a byte takes 128 core cycles. Bytes follow without a gap.
    assert_eq!(frames[2].ends - frames[0].ends, 256);
    assert!(frames[0].begins >= begun && frames[0].begins < begun + 16);
    assert_eq!(rig.part.memory(0x2000_2000, 3), Some(&[0xED, 0xCB, 0xA9][..]));
    assert_eq!(rig.read(DMA2 + 0x10) & 1, 0, "EN clears at the end");
    assert_eq!(rig.read(DMA2) & 0x3F, 0x30, "half and complete");
    rig.write(DMA2 + 8, 0x3D);
    assert!(!rig.line(56));
    assert!(rig.part.findings().is_empty(), "{:?}", rig.part.findings());
}

#[test]
fn a_gnss_receivers_bytes_go_round_a_ring() {
    let mut rig = Rig::board();
    // PD6 is USART2_RX (AF7), pulled up.
    rig.write(GPIOD + 0x0C, 1 << 12);
    rig.write(GPIOD + 0x20, 7 << 24);
    rig.write(GPIOD, 2 << 12);
    // DMA1 stream 5, channel 4, receives in circular mode, with half and complete interrupts.
    rig.write(DMA1 + 0x8C, 4);
    rig.write(DMA1 + 0x90, USART2 + 4);
    rig.write(DMA1 + 0x94, 0x2000_3000);
    rig.write(DMA1 + 0x88, 4 << 25 | 3 << 16 | 1 << 10 | 1 << 8 | 1 << 4 | 1 << 3 | 1);
    rig.write(USART2 + 8, 78);
    rig.write(USART2 + 0x14, 1 << 6 | 1);
    rig.write(USART2 + 0xC, 1 << 13 | 1 << 2 | 1 << 4);
    for byte in *b"abcde" {
        let frame = UartFrame::eight_n_one(byte, 460_800);
        rig.part.receive(rig.now, Pin::new(3, 6), frame, &mut rig.bench);
        rig.step(144_000_000 / 46_080);
    }
    assert_eq!(rig.part.memory(0x2000_3000, 4), Some(&b"ebcd"[..]));
    assert_eq!(rig.read(DMA1 + 0x8C), 3);
    assert!(rig.line(16), "half and complete");
    rig.step(144_000_000 / 46_080 * 2);
    assert!(rig.line(38), "the line is idle");
    assert!(rig.part.findings().is_empty(), "{:?}", rig.part.findings());
}

#[test]
fn a_stream_into_the_cores_own_ram_fails() {
    let mut rig = Rig::board();
    rig.spi_up();
    rig.write(SPI1 + 4, 1);
    rig.write(DMA2 + 0x14, 1);
    rig.write(DMA2 + 0x18, SPI1 + 0xC);
    rig.write(DMA2 + 0x1C, 0x1000_0000);
    rig.write(DMA2 + 0x10, 3 << 25 | 1 << 2 | 1);
    rig.write(SPI1 + 0xC, 0x55);
    rig.step(1000);
    assert_eq!(rig.read(DMA2) & 8, 8, "transfer error");
    assert!(rig.line(56));
    assert!(rig.found(FindingKind::Unreachable, "memory port"));
}

#[test]
fn a_stream_with_another_channel_gets_no_requests() {
    let mut rig = Rig::board();
    rig.spi_up();
    rig.write(SPI1 + 4, 1);
    rig.write(DMA2 + 0x14, 1);
    rig.write(DMA2 + 0x18, SPI1 + 0xC);
    rig.write(DMA2 + 0x1C, 0x2000_2000);
    rig.write(DMA2 + 0x10, 4 << 25 | 1);
    rig.write(SPI1 + 0xC, 0x55);
    rig.step(1000);
    assert_eq!(rig.read(DMA2 + 0x14), 1);
    assert_eq!(rig.read(SPI1 + 8) & 1, 1, "RXNE");
}

#[test]
fn a_stream_neither_starts_with_flags_nor_changes_while_running() {
    let mut rig = Rig::board();
    rig.write(DMA2 + 0x14, 4);
    rig.write(DMA2 + 0x18, SPI1 + 0xC);
    rig.write(DMA2 + 0x1C, 0x2000_2000);
    rig.write(DMA2 + 0x10, 3 << 25 | 1);
    rig.write(DMA2 + 0x14, 9);
    assert_eq!(rig.read(DMA2 + 0x14), 4);
    rig.write(DMA2 + 0x10, 3 << 25);
    assert_eq!(rig.read(DMA2) & 0x3F, 0x20, "switching off says complete");
    rig.write(DMA2 + 0x10, 3 << 25 | 1);
    assert_eq!(rig.read(DMA2 + 0x10) & 1, 0);
    rig.write(DMA2 + 8, 0x3D);
    rig.write(DMA2 + 0x10, 3 << 25 | 1);
    assert_eq!(rig.read(DMA2 + 0x10) & 1, 1);
}

#[test]
fn a_stream_starts_again_with_its_half_transfer_flag_set() {
    let mut rig = Rig::board();
    rig.write(0x2000_1000, 0x1122_3344);
    rig.write(DMA2 + 0x14, 4);
    rig.write(DMA2 + 0x18, 0x2000_1000);
    rig.write(DMA2 + 0x1C, 0x2000_2000);
    rig.write(DMA2 + 0x24, 7);
    rig.write(DMA2 + 0x10, 1 << 10 | 1 << 9 | 2 << 6 | 1);
    assert_eq!(rig.read(DMA2) & 0x3F, 0x30, "half and complete");
    rig.write(DMA2 + 8, 0x20);
    rig.write(0x2000_1000, 0x5566_7788);
    rig.write(DMA2 + 0x14, 4);
    rig.write(DMA2 + 0x10, 1 << 10 | 1 << 9 | 2 << 6 | 1);
    assert_eq!(rig.read(0x2000_2000), 0x5566_7788);
    assert!(rig.part.findings().is_empty(), "{:?}", rig.part.findings());
}

#[test]
fn memory_moves_to_memory_through_the_fifo_with_another_width() {
    let mut rig = Rig::board();
    for nth in 0..8 {
        rig.write(0x2000_1000 + 4 * nth, 0x0302_0100 + 0x0404_0404 * nth);
    }
    rig.write(DMA2 + 0x14, 32);
    rig.write(DMA2 + 0x18, 0x2000_1000);
    rig.write(DMA2 + 0x1C, 0x2000_2000);
    rig.write(DMA2 + 0x24, 7);
    rig.write(DMA2 + 0x10, 2 << 6 | 1 << 9 | 1 << 10 | 2 << 13 | 1 << 4 | 1);
    assert!(rig.line(56));
    let expected: Vec<u8> = (0..32).collect();
    assert_eq!(rig.part.memory(0x2000_2000, 32), Some(&expected[..]));
}

#[test]
fn a_rising_edge_on_pa3_is_interrupt_9_until_it_is_cleared() {
    let mut rig = Rig::board();
    rig.write(GPIOA + 0xC, 0x6400_0000 | 2 << 6);
    rig.write(SYSCFG + 8, 0);
    rig.write(EXTI + 8, 1 << 3);
    rig.write(EXTI, 1 << 3);
    rig.part.drive(rig.now, Pin::new(0, 3), Some(true), &mut rig.bench);
    assert!(rig.line(9));
    assert_eq!(rig.read(GPIOA + 0x10) & 8, 8);
    rig.write(EXTI + 0x14, 1 << 3);
    assert!(!rig.line(9));
    rig.part.drive(rig.now, Pin::new(0, 3), Some(false), &mut rig.bench);
    assert!(!rig.line(9), "a falling edge does not count");
    rig.part.drive(rig.now, Pin::new(0, 3), None, &mut rig.bench);
    assert!(!rig.part.pin(Pin::new(0, 3)), "pulled down");
}

#[test]
fn an_output_is_told_once_for_each_change() {
    let mut rig = Rig::board();
    rig.bench.pins.clear();
    rig.write(GPIOD + 0x18, 1 << 14);
    rig.write(GPIOD, 1 << 28);
    rig.write(GPIOD + 0x18, 1 << 14);
    rig.write(GPIOD + 0x18, 1 << 30);
    let pads: Vec<_> = rig.bench.pins.iter().map(|&(_, pin, pad)| (pin, pad)).collect();
    let pin = Pin::new(3, 14);
    assert_eq!(pads, [(pin, Pad::Driven(true)), (pin, Pad::Driven(false))]);
}

#[test]
fn what_has_no_clock_reads_zero_and_keeps_nothing() {
    let mut rig = Rig::new(Oscillators::default());
    rig.write(SPI1, 4);
    assert_eq!(rig.read(SPI1), 0);
    assert!(rig.found(FindingKind::Refused, "without its clock"));
    assert_eq!(rig.try_read(0x4000_2400, Width::Word), Err(BusError));
    assert!(rig.found(FindingKind::Unmapped, "nothing"));
}

#[test]
fn the_independent_watchdog_restarts_the_part_unless_it_is_fed() {
    let mut rig = Rig::board();
    // The watchdog counts 800 ticks of 32 kHz / 4, which are 100 ms.
    rig.write(IWDG, 0x5555);
    rig.write(IWDG + 4, 0);
    rig.write(IWDG + 8, 799);
    rig.write(IWDG, 0xCCCC);
    rig.step(rig.ms(1));
    rig.write(IWDG, 0xAAAA);
    for _ in 0..10 {
        rig.step(rig.ms(50));
        rig.write(IWDG, 0xAAAA);
        assert_eq!(rig.part.take_reset(), None);
    }
    rig.step(rig.ms(99));
    assert_eq!(rig.part.take_reset(), None);
    rig.step(rig.ms(2));
    assert_eq!(rig.part.take_reset(), Some(Reset::Watchdog("IWDG")));
    rig.part.reset(rig.now, Reset::Watchdog("IWDG"), &mut rig.bench);
    assert_eq!(rig.part.clock().hz, 16_000_000);
    assert_eq!(rig.read(RCC + 0x74) & 0xFE00_0000, 0x2E00_0000, "flags gather until RMVF");
}

#[test]
fn the_window_watchdog_restarts_the_part_when_it_is_fed_too_early() {
    let mut rig = Rig::board();
    rig.write(WWDG + 4, 0x60);
    rig.write(WWDG, 0xFF);
    rig.write(WWDG, 0xFF);
    assert_eq!(rig.part.take_reset(), Some(Reset::Watchdog("WWDG")));
}

#[test]
fn the_unique_id_and_the_size_of_flash_are_where_software_looks() {
    let mut rig = Rig::board();
    assert_ne!(rig.read(stm32f429::UNIQUE_ID), u32::MAX);
    assert_eq!(rig.try_read(stm32f429::FLASH_SIZE, Width::Half), Ok(2048));
}

#[test]
fn flash_is_erased_and_programmed_by_its_interface_alone() {
    let mut rig = Rig::board();
    rig.part.memory_mut(0x0810_0000, 4).expect("flash").copy_from_slice(&[1, 2, 3, 4]);
    rig.write(0x0810_0000, 0);
    assert_eq!(rig.read(FLASH + 0xC) & 0x80, 0x80, "PGSERR: it is locked");
    rig.write(FLASH + 0xC, 0xF0);
    rig.write(FLASH + 4, 0x4567_0123);
    rig.write(FLASH + 4, 0xCDEF_89AB);
    // The erase is of sector 12, with 32 bits in parallel.
    rig.write(FLASH + 0x10, 1 << 1 | 16 << 3 | 2 << 8);
    rig.write(FLASH + 0x10, 1 << 1 | 16 << 3 | 2 << 8 | 1 << 16);
    assert_eq!(rig.read(FLASH + 0xC) & 1 << 16, 1 << 16, "busy");
    let begun = rig.now;
    let _ = rig.read(0x0810_0000);
    assert!(rig.part.signals().stalled_until() > begun + rig.ms(240), "a read of that bank waits");
    rig.step(rig.ms(251));
    assert_eq!(rig.read(FLASH + 0xC) & 1 << 16, 0);
    assert_eq!(rig.read(0x0810_0000), u32::MAX);
    rig.write(FLASH + 0x10, 1 | 2 << 8);
    rig.write(0x0810_0000, 0x1234_5678);
    rig.step(rig.ms(1));
    assert_eq!(rig.read(0x0810_0000), 0x1234_5678);
    rig.try_write(0x0810_0004, Width::Byte, 0).expect("flash takes it");
    assert_eq!(rig.read(FLASH + 0xC) & 0x40, 0x40, "PGPERR: PSIZE is 32 bits");
}

/// RM0090 3.9.1, ICRST and DCRST.
#[test]
fn a_cache_may_be_reset_while_off_whatever_the_others_state() {
    const LATENCY: u32 = 5;
    let faulty = |acr: u32| {
        let mut rig = Rig::board();
        rig.write(FLASH, LATENCY | acr);
        rig.found(FindingKind::Misuse, "a cache is reset while it is on")
    };
    let (instruction, data) = (1 << 9, 1 << 10);
    assert!(!faulty(instruction << 2 | data) && !faulty(data << 2 | instruction) && !faulty((instruction | data) << 2));
    assert!(faulty(instruction << 2 | instruction) && faulty(data << 2 | data));
    assert!(faulty((instruction | data) << 2 | data));
}

#[test]
fn a_store_into_flash_that_programs_nothing_is_a_finding() {
    let mut rig = Rig::board();
    rig.write(0x0810_0000, 0);
    assert!(rig.found(FindingKind::Misuse, "PGSERR) does nothing, at 0x8100000"), "{:?}", rig.part.findings());
    rig.write(FLASH + 4, 0x4567_0123);
    rig.write(FLASH + 4, 0xCDEF_89AB);
    rig.write(FLASH + 0x10, 1 | 2 << 8);
    rig.write(0x0810_0000, 0x1234_5678);
    rig.step(rig.ms(1));
    assert_eq!((rig.part.findings().len(), rig.read(0x0810_0000)), (1, 0x1234_5678));
    rig.try_write(0x0810_0004, Width::Byte, 0).expect("flash takes it");
    assert!(rig.found(FindingKind::Misuse, "PGPERR"), "{:?}", rig.part.findings());
}

#[test]
fn a_wrong_flash_key_locks_the_flash_until_reset() {
    let mut rig = Rig::board();
    assert_eq!(rig.try_write(FLASH + 4, Width::Word, 1), Err(BusError));
    assert_eq!(rig.try_write(FLASH + 4, Width::Word, 0x4567_0123), Err(BusError));
    rig.part.reset(rig.now, Reset::Pin, &mut rig.bench);
    assert_eq!(rig.try_write(FLASH + 4, Width::Word, 0x4567_0123), Ok(()));
}

#[test]
fn a_clone_does_what_the_original_does() {
    let mut rig = Rig::board();
    rig.spi_up();
    rig.write(SPI1 + 0xC, 0x55);
    let mut copy = Rig { part: rig.part.clone(), bench: Bench::default(), now: rig.now };
    rig.step(1000);
    copy.step(1000);
    assert_eq!(rig.bench.frames, copy.bench.frames);
    assert_eq!(rig.read(SPI1 + 0xC), copy.read(SPI1 + 0xC));
}
