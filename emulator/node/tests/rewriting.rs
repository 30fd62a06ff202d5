//! Tests of firmware that rewrites code in flash and in RAM, as a boot loader does. The core must execute what was
//! written last, and a busy flash must stall it.

use crate::thumb;

use cortex_m4::Fast;
use emulator_node::{Bare, Clock, Connected, Firmware, Limits, Node, Target};
use nrf52840::{Nrf52840, Settings};
use thumb::{COUNTER, MAIN, Thumb, firmware, firmware_at};

const MS: u64 = 1_000_000;

const IN_RAM: u32 = 0x2000_1000;

const fn function(value: u32) -> u32 {
    0x4770_2000 | value
}

fn call(main: &mut Thumb, at: u32, to: u32) {
    main.mov(2, at | 1).raw(&[0x4790]).mov(1, to).str(0, 1, 0);
}

const CLOCKS: [Clock; 3] = [Clock::Fast, Clock::Optimistic, Clock::Pessimistic];

/// Returns what both functions returned within `ms` on each clock.
fn returned(target: Target, image: &Firmware, ms: u64) -> [[u32; 2]; 3] {
    CLOCKS.map(|clock| {
        let limits = Limits { virtual_time: ms * MS, ..Limits::default() };
        let mut run = target.start(clock, image, Connected::default(), limits).unwrap();
        while !run.is_over() {
            run.go(&mut |_| {});
        }
        let values = [COUNTER, COUNTER + 4].map(|at| {
            let mut word = [0; 4];
            assert_eq!(run.node().peek(at, &mut word), 4);
            u32::from_le_bytes(word)
        });
        let outcome = run.finish();
        // An instruction that has begun is finished.
        assert_eq!(outcome.virtual_time / 1_000, ms * 1_000);
        assert_eq!(outcome.findings, []);
        values
    })
}

mod nrf {
    use super::*;

    const NVMC_CONFIG: u32 = 0x4001_E504;
    const NVMC_ERASEPAGE: u32 = 0x4001_E508;
    const PAGE: u32 = 0x1000;

    /// Writes a function into flash, calls it, erases its page, writes another function, and calls that.
    fn image() -> Firmware {
        let mut main = Thumb::at(0x400);
        main.store(NVMC_CONFIG, 1).store(PAGE, function(1));
        call(&mut main, PAGE, COUNTER);
        main.store(NVMC_CONFIG, 2).store(NVMC_ERASEPAGE, PAGE).store(NVMC_CONFIG, 1).store(PAGE, function(2));
        call(&mut main, PAGE, COUNTER + 4);
        main.idle();
        firmware_at(0, "rewrites its flash", &main, &[])
    }

    fn after(ms: u64) -> [[u32; 2]; 3] {
        returned(Target::Nrf52840, &image(), ms)
    }

    #[test]
    fn a_function_written_anew_in_flash_is_the_one_executed() {
        assert_eq!(after(90), [[1, 2]; 3]);
    }

    /// An erase takes 85 ms (PS 4.3, t_ERASEPAGE) by an internal oscillator that is up to 1.5 % fast.
    #[test]
    fn the_core_stands_still_while_its_flash_is_erased() {
        assert_eq!(after(83), [[1, 0]; 3]);
    }

    /// The crystal becomes the core's clock 0.36 ms after its start, which is during the erase.
    #[test]
    fn an_oscillator_that_starts_meanwhile_does_not_cut_an_erase_short() {
        let mut main = Thumb::at(0x400);
        main.store(0x4000_0000, 1).store(NVMC_CONFIG, 2).store(NVMC_ERASEPAGE, PAGE).store(COUNTER, 1).idle();
        let image = firmware_at(0, "erases beside a start of the crystal", &main, &[]);
        let part = Nrf52840::new(Settings { hfint_ppb: 15_000_000, ..Settings::default() });
        let mut node: Node<Bare<Nrf52840>, Fast> = Node::new(part, Bare::new(), &image).unwrap();
        for (ms, erased) in [(80, 0), (90, 1)] {
            node.advance(ms * MS);
            assert_eq!(node.take_findings(), []);
            assert_eq!(node.word(u64::from(COUNTER)), Some(erased), "after {ms} ms");
        }
    }

    #[test]
    fn a_function_written_anew_in_ram_is_the_one_executed() {
        let image = in_ram(0x400, |main| firmware_at(0, "rewrites its RAM", main, &[]));
        assert_eq!(returned(Target::Nrf52840, &image, 1), [[1, 2]; 3]);
    }
}

mod stm32 {
    use super::*;

    const KEYR: u32 = 0x4002_3C04;
    const SR: u32 = 0x4002_3C0C;
    const CR: u32 = 0x4002_3C10;
    const SECTOR_1: u32 = 0x0800_4000;
    const WORDS: u32 = 2 << 8;

    fn settle(main: &mut Thumb) {
        main.mov(0, SR);
        let again = main.here();
        main.ldr(1, 0, 0).test(1, 16).branch_if(thumb::If::CarrySet, again);
    }

    /// Writes a function into flash, calls it, erases its sector, writes another function, and calls that (RM0090 3.6).
    fn image() -> Firmware {
        let mut main = Thumb::at(MAIN);
        main.store(KEYR, 0x4567_0123).store(KEYR, 0xCDEF_89AB);
        main.store(CR, WORDS | 1).store(SECTOR_1, function(1));
        settle(&mut main);
        call(&mut main, SECTOR_1, COUNTER);
        main.store(CR, WORDS | 1 << 3 | 1 << 1).store(CR, 1 << 16 | WORDS | 1 << 3 | 1 << 1);
        settle(&mut main);
        main.store(CR, WORDS | 1).store(SECTOR_1, function(2));
        settle(&mut main);
        call(&mut main, SECTOR_1, COUNTER + 4);
        main.idle();
        firmware("rewrites its flash", &main, &[])
    }

    fn after(ms: u64) -> [[u32; 2]; 3] {
        returned(Target::Stm32f429, &image(), ms)
    }

    #[test]
    fn a_function_written_anew_in_flash_is_the_one_executed() {
        assert_eq!(after(600), [[1, 2]; 3]);
    }

    /// Erasing a sector of 16 KiB takes 250 ms (DS9405, flash memory programming).
    #[test]
    fn the_core_stands_still_while_its_flash_is_erased() {
        assert_eq!(after(249), [[1, 0]; 3]);
    }

    #[test]
    fn a_function_written_anew_in_ram_is_the_one_executed() {
        let image = in_ram(MAIN, |main| firmware("rewrites its RAM", main, &[]));
        assert_eq!(returned(Target::Stm32f429, &image, 1), [[1, 2]; 3]);
    }
}

/// Writes a function into RAM, calls it, writes another in its place, and calls that.
fn in_ram(base: u32, image: impl Fn(&Thumb) -> Firmware) -> Firmware {
    let mut main = Thumb::at(base);
    for (value, to) in [(1, COUNTER), (2, COUNTER + 4)] {
        // DSB and ISB follow the store, so that the core fetches the new instructions (ARM ARM A3.7.3).
        main.store(IN_RAM, function(value)).raw(&[0xF3BF, 0x8F4F, 0xF3BF, 0x8F6F]);
        call(&mut main, IN_RAM, to);
    }
    main.idle();
    image(&main)
}
