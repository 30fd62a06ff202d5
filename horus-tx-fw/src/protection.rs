//! The regions that HORUS's memory protection unit opens ([`firmware_common::mpu`])
//!
//! | addresses | what | access at the start | access of tasks |
//! |---|---|---|---|
//! | 0x0000_0000 | null page, where flash is mirrored | – | – |
//! | 0x0800_0000 to 112 KiB | flash: the program and its budget | read, execute | read, execute |
//! | 0x1000_0000 | CCM RAM, not used | – | – |
//! | 0x2000_0000 to 192 KiB | SRAM: stack, statics, and what is left free | read, write | read, write |
//! | 0x4000_0000 to 0x5FFF_FFFF | peripherals and their bit-band alias | all | those of `board.rs` that tasks use |
//!
//! *Stack*: it grows down from the statics (flip-link) to 0x2000_0000. An overflow violates the memory protection.
//!
//! *Peripherals*: the tasks cannot access what only the start needs: reset and clock control, the flash interface (no
//! task can erase or write flash), power control, and everything that the board does not use. An eighth of a region is
//! 2 KiB and holds two peripherals, so these are open as well: the extensions of I2S2 and I2S3, I2C1, I2C3, UART8, SPI4
//! and SPI6, all without a clock.

use firmware_common::mpu::{Access, Allowed, Memory, Region, Table};

const KIB: u32 = 1024;

/// The flash: 112 KiB of the region's 128 KiB are open, as in `memory.x`.
const FLASH: Region = Region::new("flash", 0x0800_0000, 128 * KIB, Memory::Flash, Allowed::ReadExecute)
    .only([true, true, true, true, true, true, true, false]);

/// The RAM: 192 KiB of the region's 256 KiB are open, SRAM1 to SRAM3 (RM0090, "Memory organization").
const RAM: Region = Region::new("RAM", 0x2000_0000, 256 * KIB, Memory::Ram, Allowed::ReadWrite)
    .only([true, true, true, true, true, true, false, false]);

/// The regions that are open while the firmware starts.
pub const START: Table<3> = Table::new([
    FLASH,
    RAM,
    Region::new("peripherals", 0x4000_0000, 0x2000_0000, Memory::Peripheral, Allowed::ReadWrite),
]);

/// The regions that are open while tasks run.
pub const TASKS: Table<8> = Table::new([
    FLASH,
    RAM,
    // The accessible subregions of this region are TIM2 with TIM3, TIM4 with TIM5, and the IWDG.
    Region::new("timers and watchdog", 0x4000_0000, 16 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, true, false, false, false, false, true, false]),
    // The accessible subregions of this region are USART2, UART5, I2C2 and UART7.
    Region::new("UARTs and I2C2", 0x4000_4000, 16 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, false, true, true, false, false, false, true]),
    // The accessible subregions of this region are SPI1, and SYSCFG with EXTI.
    Region::new("SPI1 and EXTI", 0x4001_0000, 16 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([false, false, false, false, false, false, true, true]),
    Region::new("SPI5", 0x4001_5000, 2 * KIB, Memory::Peripheral, Allowed::ReadWrite),
    // The accessible subregions of this region are the ports A to F.
    Region::new("GPIO ports", 0x4002_0000, 16 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, true, true, false, false, false, false, false]),
    Region::new("DMA controllers", 0x4002_6000, 2 * KIB, Memory::Peripheral, Allowed::ReadWrite),
]);

/// Returns the name of the memory or peripheral area in which `address` lies.
#[must_use]
pub fn area(address: u32) -> &'static str {
    match address {
        0..0x0800_0000 => "null page",
        0x1800_0000..0x2000_0000 => "below the stack",
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
            for shut in [0, 0xFF, 0x07FF_FFFF, 0x0800_0000 + 112 * KIB, 0x1000_0000] {
                assert!(!TASKS.allows(shut, access) && !START.allows(shut, access), "{access:?} {shut:#x}");
            }
        }
        for address in [0x0800_0000, 0x0800_0000 + 112 * KIB - 1] {
            assert!(TASKS.allows(address, Read) && TASKS.allows(address, Execute) && !TASKS.allows(address, Write));
            assert!(START.allows(address, Execute) && !START.allows(address, Write));
        }
    }

    // Shows SAFE-13.
    #[test]
    fn all_ram_is_data_and_none_of_it_can_be_executed() {
        for table in [START.regions(), TASKS.regions()] {
            assert!(table.contains(&RAM));
        }
        for address in [0x2000_0000, 0x2000_0000 + 192 * KIB - 1] {
            assert!(TASKS.allows(address, Read) && TASKS.allows(address, Write) && !TASKS.allows(address, Execute));
        }
        assert!(!TASKS.allows(0x1FFF_FFFC, Write) && !TASKS.allows(0x2000_0000 + 192 * KIB, Read));
    }

    #[test]
    fn tasks_reach_only_the_boards_peripherals_and_their_neighbours() {
        // The addresses of the areas are those of RM0090, table 1.
        let used = [
            0x4000_0000,
            0x4000_0400,
            0x4000_0800,
            0x4000_0C00,
            0x4000_3000,
            0x4000_4400,
            0x4000_5000,
            0x4000_5800,
            0x4000_7800,
            0x4001_3000,
            0x4001_3800,
            0x4001_3C00,
            0x4001_5000,
            0x4002_0000,
            0x4002_0400,
            0x4002_0800,
            0x4002_0C00,
            0x4002_1000,
            0x4002_1400,
            0x4002_6000,
            0x4002_6400,
        ];
        let beside = [0x4000_3400, 0x4000_4000, 0x4000_5400, 0x4000_5C00, 0x4000_7C00, 0x4001_3400, 0x4001_5400];
        for address in (0x4000_0000..0x4008_0000).step_by(0x400) {
            let open = used.contains(&address) || beside.contains(&address);
            assert_eq!(TASKS.allows(address, Write), open, "{address:#x}");
            assert!(START.allows(address, Write) && !START.allows(address, Execute));
        }
        assert!(!TASKS.allows(0x4002_3800, Write), "reset and clock control");
        assert!(!TASKS.allows(0x4002_3C00, Write), "the flash interface");
        let areas = [0, 0x0800_0400, 0x1FFF_FFFC, 0x2000_0000, 0x4002_3800, 0x4000_0024].map(area);
        let named =
            ["null page", "flash", "below the stack", "RAM", "a peripheral that is shut", "timers and watchdog"];
        assert_eq!(areas, named);
        assert!(!TASKS.allows(0x4247_0000, Write), "the bit-band alias");
    }
}
