//! The regions that the hold's memory protection unit opens ([`firmware_common::mpu`]).
//!
//! | addresses | content | access before the tasks start | access of tasks |
//! |---|---|---|---|
//! | 0x0000_0000, 256 B | vector table; shut, so that an access through a null pointer is a fault | – | – |
//! | 0x0000_0100 to 64 KiB | flash: the program and the rest of its budget | read, execute | read, execute |
//! | 0x2000_0000, 256 KiB | RAM: stack, statics and free memory | read, write | read, write |
//! | 0x4000_0000, 0x5000_0000 | peripherals | all | those of `board.rs` that tasks use |
//!
//! The stack grows down from the statics (flip-link) to the start of RAM. Below is no memory, so an overflow of the
//! stack is a fault. Tasks cannot access what only the start needs: clock and power, the flash controller, and all
//! peripherals that the board does not use. RTC1 and PDM are open although no task uses them: each shares an eighth of
//! its region (the smallest unit that can be shut) with the watchdog or PWM0.

use firmware_common::mpu::{Access, Allowed, Memory, Region, Table};

const KIB: u32 = 1024;

const FLASH: Region = Region::new("flash", 0, 64 * KIB, Memory::Flash, Allowed::ReadExecute);

/// The address at which the null page ends.
pub const NULL_PAGE_END: u32 = 256;

/// The page that is shut against null pointers. It has the vectors of 16 exceptions and 48 interrupts (PS v1.7, 4.2.4).
const NULL_PAGE: Region = Region::new("null page", 0, NULL_PAGE_END, Memory::Flash, Allowed::Nothing);

const RAM: Region = Region::new("RAM", 0x2000_0000, 256 * KIB, Memory::Ram, Allowed::ReadWrite);

/// The regions that are open while the firmware starts.
pub const START: Table<4> = Table::new([
    FLASH,
    NULL_PAGE,
    RAM,
    Region::new("peripherals", 0x4000_0000, 0x2000_0000, Memory::Peripheral, Allowed::ReadWrite),
]);

/// The regions that are open while tasks run.
pub const TASKS: Table<7> = Table::new([
    FLASH,
    NULL_PAGE,
    RAM,
    // The four open eighths are those of SPIM0, TWIM1, GPIOTE and SAADC.
    Region::new("serial interfaces, GPIOTE, SAADC", 0x4000_0000, 32 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([false, false, false, true, true, false, true, true]),
    // The two open eighths are those of TIMER0 and TIMER1.
    Region::new("timers", 0x4000_8000, 32 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, true, false, false, false, false, false, false]),
    // The two open eighths, of 8 KiB each, are that of WDT and RTC1 and that of PWM0 and PDM.
    Region::new("watchdog and PWM", 0x4001_0000, 64 * KIB, Memory::Peripheral, Allowed::ReadWrite)
        .only([true, false, false, false, false, false, true, false]),
    Region::new("GPIO ports", 0x5000_0000, 4 * KIB, Memory::Peripheral, Allowed::ReadWrite),
]);

/// Returns the name of the memory or peripheral area in which `address` lies.
#[must_use]
pub fn area(address: u32) -> &'static str {
    match address {
        0x1FFF_0000..0x2000_0000 => "below the stack",
        0x4000_0000..0x6000_0000 if !TASKS.allows(address, Access::Write) => "a peripheral that is shut",
        _ => TASKS.name_of(address),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_common::mpu::Access::{Execute, Read, Write};

    #[test]
    fn the_program_is_not_writable_and_ram_is_never_executed() {
        for access in [Read, Write, Execute] {
            for shut in [0, 255, 64 * KIB, 0x1FFF_FFFF, 0x2004_0000] {
                assert!(!TASKS.allows(shut, access), "{access:?} {shut:#x}");
            }
        }
        for address in [256, 64 * KIB - 1] {
            assert!(TASKS.allows(address, Read) && TASKS.allows(address, Execute) && !TASKS.allows(address, Write));
        }
        for address in [0x2000_0000, 0x2003_FFFF] {
            assert!(TASKS.allows(address, Read) && TASKS.allows(address, Write) && !TASKS.allows(address, Execute));
        }
        assert_eq!([4, 0x400, 0x2000_0000, 0x1FFF_FFFC].map(area), ["null page", "flash", "RAM", "below the stack"]);
    }

    #[test]
    fn tasks_reach_only_the_boards_peripherals_and_two_neighbours() {
        let of_the_board = [0x3000, 0x4000, 0x6000, 0x7000, 0x8000, 0x9000, 0x1_0000, 0x1_C000];
        // RTC1 and PDM share an eighth of the region with a peripheral of the board, so they are open.
        let beside = [0x1_1000, 0x1_D000];
        for offset in (0..0x3_0000).step_by(0x1000) {
            let address = 0x4000_0000 + offset;
            let open = of_the_board.contains(&offset) || beside.contains(&offset);
            assert_eq!(TASKS.allows(address, Write), open, "{address:#x}");
            assert!(START.allows(address, Write) && !START.allows(address, Execute));
        }
        assert!(TASKS.allows(0x5000_0504, Write) && TASKS.allows(0x5000_0804, Write), "P0.OUT and P1.OUT");
        assert_eq!(area(0x4001_E504), "a peripheral that is shut");
    }

    #[test]
    fn while_it_starts_memory_is_protected_as_later() {
        for address in [0, 0x100, 64 * KIB, 0x1000_0000, 0x2000_0000, 0x2003_FFFF, 0x2004_0000] {
            for access in [Read, Write, Execute] {
                assert_eq!(START.allows(address, access), TASKS.allows(address, access), "{access:?} {address:#x}");
            }
        }
    }
}
