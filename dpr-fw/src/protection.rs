//! The regions that the DPR's memory protection unit opens ([`firmware_common::mpu`]).
//!
//! | addresses | content | access before the tasks start | access of tasks |
//! |---|---|---|---|
//! | 0x0000_0000, 256 B | vector table, in the null page | – | – |
//! | 0x0000_0100 to 96 KiB | flash: the program and the rest of its budget | read, execute | read, execute |
//! | 0x0080_0000, 64 KiB | RAM that holds code, at its code addresses | read, execute | read, execute |
//! | 0x2000_0000, 64 KiB | the same RAM at its data addresses | – | – |
//! | 0x2001_0000 to 256 KiB | RAM: stack, statics and free memory | read, write | read, write |
//! | 0x4000_0000, 0x5000_0000 | peripherals | all | those of `board.rs` that tasks use |
//!
//! *Null page*: this page is shut, so an access through a null pointer is a fault. The processor fetches vectors
//! without the memory protection unit, and so does the code that verifies flash (`firmware_common::memory::load_shut`).
//!
//! *Stack*: it grows down from the statics (flip-link) to 0x2001_0000. An overflow violates the memory protection.
//!
//! *Code in RAM* is copied before the memory protection unit is switched on. Afterwards only a fault of the memory can
//! change it, which the comparison with flash finds ([`integrity`](crate::integrity)).
//!
//! *Peripherals*: the tasks cannot access the flash controller (so no task erases or writes flash), the PPI (so no task
//! undoes the expiry of the image), clock and power, and all peripherals that the board does not use.
//!
//! The smallest unit that can be shut is an eighth of a region. In most regions this is 4 KiB, one peripheral. In the
//! region of the watchdog and TIMER3 it is 8 KiB, two peripherals, because the unit has no region left. So RTC1 and
//! TIMER4 are open too. Without the feature `hold` nothing starts them, and none of their interrupts or PPI channels is
//! enabled.
//!
//! With the feature `hold`, TIMER4, SPIM2 and EGU3 serve the second port. SPIM2 needs a region of its own, so two other
//! regions become one with eighths of 8 KiB. That also opens UARTE0, NFCT, SAADC, RTC0 and EGU2 for every task. Nothing
//! uses them, and none of their interrupts or PPI channels is enabled. A task with a fault could start UARTE0, NFCT or
//! SAADC all the same, and their DMA is not checked by the unit (docs/safety/fmea.md).

use firmware_common::mpu::{Access, Allowed, Memory, Region, Table};

const KIB: u32 = 1024;

/// The flash: 96 KiB of the region's 128 KiB are open, as in `memory.x`.
const FLASH: Region = Region::new("flash", 0, 128 * KIB, Memory::Flash, Allowed::ReadExecute)
    .only([true, true, true, true, true, true, false, false]);

/// The address at which the null page ends.
pub const NULL_PAGE_END: u32 = 256;

/// The page that is shut against null pointers. It has the vectors of 16 exceptions and 48 interrupts (PS v1.7, 4.2.4).
const NULL_PAGE: Region = Region::new("null page", 0, NULL_PAGE_END, Memory::Flash, Allowed::Nothing);

/// The RAM: all of its 256 KiB except the first 64 KiB, which hold code, are open.
const RAM: Region = Region::new("RAM", 0x2000_0000, 256 * KIB, Memory::Ram, Allowed::ReadWrite)
    .only([false, false, true, true, true, true, true, true]);

/// The RAM that holds code, at its addresses in the code region (PS v1.7, chapter 4.2.3).
const CODE_RAM: Region = Region::new("code in RAM", 0x0080_0000, 64 * KIB, Memory::Ram, Allowed::ReadExecute);

/// The regions that are open while the firmware starts.
pub const START: Table<5> = Table::new([
    FLASH,
    NULL_PAGE,
    RAM,
    CODE_RAM,
    Region::new("peripherals", 0x4000_0000, 0x2000_0000, Memory::Peripheral, Allowed::ReadWrite),
]);

/// The regions that are open while tasks run.
pub const TASKS: Table<8> = Table::new([
    FLASH,
    NULL_PAGE,
    RAM,
    CODE_RAM,
    #[cfg(feature = "hold")]
    // The five open eighths, of 8 KiB each, are those of SPIM0, SPIS1, GPIOTE, TIMER0 with TIMER1, and TIMER2.
    Region::new("timers", 0x4000_0000, 64 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([false, true, true, true, true, true, false, false]),
    #[cfg(feature = "hold")]
    // The open eighth is that of SPIM2.
    Region::new("second front end", 0x4002_0000, 32 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([false, false, false, true, false, false, false, false]),
    #[cfg(not(feature = "hold"))]
    // The three open eighths are those of SPIM0, SPIS1 and GPIOTE.
    Region::new("serial interfaces and GPIOTE", 0x4000_0000, 32 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([false, false, false, true, true, false, true, false]),
    #[cfg(not(feature = "hold"))]
    // The three open eighths are those of TIMER0 to TIMER2.
    Region::new("timers", 0x4000_8000, 32 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, true, true, false, false, false, false, false]),
    // The accessible subregions, of 8 KiB each, hold WDT and RTC1, and TIMER3 and TIMER4. With the feature `hold`, the
    // subregion with EGU2 and EGU3 is accessible as well.
    Region::new("watchdog and pause", 0x4001_0000, 64 * KIB, Memory::Peripheral, Allowed::ReadWrite).only([
        true,
        false,
        false,
        cfg!(feature = "hold"),
        false,
        true,
        false,
        false,
    ]),
    Region::new("GPIO ports", 0x5000_0000, 4 * KIB, Memory::Peripheral, Allowed::ReadWrite),
]);

/// Returns the name of the memory or peripheral area in which `address` lies.
#[must_use]
pub fn area(address: u32) -> &'static str {
    match address {
        0x2000_0000..0x2001_0000 => "below the stack",
        0x4000_0000..0x6000_0000 if !TASKS.allows(address, Access::Write) => "a peripheral that is shut",
        _ => TASKS.name_of(address),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::mpu::Access::{Execute, Read, Write};

    // Shows SAFE-13.
    #[test]
    fn the_null_page_is_shut_and_the_program_is_not_writable() {
        for access in [Read, Write, Execute] {
            assert!(!TASKS.allows(0, access) && !TASKS.allows(255, access), "{access:?}");
            assert!(!TASKS.allows(96 * KIB, access), "{access:?} behind the image's budget");
        }
        for address in [256, 96 * KIB - 1] {
            assert!(TASKS.allows(address, Read) && TASKS.allows(address, Execute) && !TASKS.allows(address, Write));
        }
        assert_eq!((area(4), area(0x400)), ("null page", "flash"));
    }

    // Shows SAFE-13.
    #[test]
    fn all_ram_except_that_of_the_code_is_data_and_never_executed() {
        for address in [0x2001_0000, 0x2003_FFFF] {
            assert!(TASKS.allows(address, Read) && TASKS.allows(address, Write) && !TASKS.allows(address, Execute));
        }
        for access in [Read, Write, Execute] {
            for below_or_above in [0x1FFF_FFFF, 0x2000_0000, 0x2000_FFFF, 0x2004_0000] {
                assert!(!TASKS.allows(below_or_above, access), "{access:?} {below_or_above:#x}");
            }
        }
        assert_eq!(area(0x2000_FFFC), "below the stack");
        assert_eq!((area(0x2001_0000), area(0x0080_0000)), ("RAM", "code in RAM"));
        assert!(TASKS.allows(0x0080_0000, Execute) && TASKS.allows(0x0080_FFFF, Read));
        assert!(!TASKS.allows(0x0080_0000, Write) && !TASKS.allows(0x0081_0000, Execute));
    }

    #[test]
    fn tasks_reach_only_the_boards_peripherals_and_two_neighbours() {
        let of_the_board = [0x3000, 0x4000, 0x6000, 0x8000, 0x9000, 0xA000, 0x1_0000, 0x1_A000];
        // RTC1 and TIMER4 are open, because each shares an eighth of a region with a peripheral of the board. With the
        // feature `hold`, TIMER4, SPIM2 and EGU3 are the board's, and UARTE0, NFCT, SAADC, RTC0 and EGU2 are open
        // beside them.
        let beside: &[u32] = if cfg!(feature = "hold") {
            &[0x1_1000, 0x1_B000, 0x2_3000, 0x1_7000, 0x2000, 0x5000, 0x7000, 0xB000, 0x1_6000]
        } else {
            &[0x1_1000, 0x1_B000]
        };
        for offset in (0..0x3_0000).step_by(0x1000) {
            let address = 0x4000_0000 + offset;
            let open = of_the_board.contains(&offset) || beside.contains(&offset);
            assert_eq!(TASKS.allows(address, Write), open, "{address:#x}");
            assert!(START.allows(address, Write) && !START.allows(address, Execute));
        }
        // The tasks may write the outputs of both GPIO ports, P0.OUT and P1.OUT.
        assert!(TASKS.allows(0x5000_0504, Write) && TASKS.allows(0x5000_0804, Write));
        assert_eq!((area(0x4001_E504), area(0x4000_A540)), ("a peripheral that is shut", "timers"));
        assert!(!TASKS.allows(0x5000_1000, Write) && !TASKS.allows(0x4001_E504, Write), "the flash controller");
    }

    #[test]
    fn while_it_starts_memory_is_protected_as_later() {
        for address in [0, 0x100, 0x0080_0000, 0x1000_0000, 0x2000_0000, 0x2001_0000, 0x2004_0000] {
            for access in [Read, Write, Execute] {
                assert_eq!(START.allows(address, access), TASKS.allows(address, access), "{access:?} {address:#x}");
            }
        }
    }
}
