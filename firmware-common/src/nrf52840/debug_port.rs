//! Keeps the debug port open after a reset, where the part's UICR allows that.
//!
//! # Design
//!
//! The nRF52840 can lock its debug port (access port protection, PS v1.7 and later, "Debug and trace"). Parts up to
//! build code Dxx are open unless UICR.APPROTECT locks them. Parts of build code Fxx and later (Nordic's revision 3)
//! lock the debug port at every power-on, pin reset, brown-out and watchdog reset. They open it only if both of these
//! values are set:
//!
//! | what | value | who writes it |
//! |---|---|---|
//! | UICR.APPROTECT, 0x1000_1208 | 0x5A, HwDisabled | the flashing tool, once: `cargo xtask flash dpr` |
//! | APPROTECT.DISABLE, 0x4000_0558 | 0x5A, SwDisable | the firmware, after every reset |
//!
//! Without the write of APPROTECT.DISABLE no debugger could connect after the next power-on.
//!
//! [`open`] does the same as Nordic's own start-up code (NordicSemiconductor/nrfx, `system_nrf52_approtect.h`,
//! `nrf52_handle_approtect`): on a part of revision 3, UICR.APPROTECT decides. If another value in that register locks
//! a board on purpose, the board stays locked. The firmware never writes UICR, which is non-volatile memory.
//!
//! # How a part is recognised
//!
//! FICR.INFO.VARIANT holds in ASCII the last two letters of the package variant and the two characters of the build
//! code, for example 0x4141_4630 for AAF0. Build codes from F on count as locked by default, as in embassy-rs/embassy
//! (`embassy-nrf/src/chips/nrf52840.rs`, `APPROTECT_MIN_BUILD_CODE`). Nordic's code reads two words of FICR that the
//! product specification does not describe (nrfx, `nrf52_erratas.h`, `nrf52_configuration_249`).

/// The value of UICR.APPROTECT, bits 7..0, by which the hardware allows an open debug port (HwDisabled).
pub const HW_DISABLED: u32 = 0x5A;

/// The value of APPROTECT.DISABLE by which the software opens the debug port (SwDisable).
pub const SW_DISABLE: u32 = 0x5A;

/// The first character of the lowest build code of parts that start with a locked debug port.
const FIRST_LOCKED: u8 = b'F';

/// The registers that control access to the debug port.
pub trait Registers {
    /// Reads FICR.INFO.VARIANT, 0x1000_0104.
    fn variant(&self) -> u32;

    /// Reads UICR.APPROTECT, 0x1000_1208.
    fn uicr_approtect(&self) -> u32;

    /// Writes [`SW_DISABLE`] to APPROTECT.DISABLE, 0x4000_0558. Never called on older parts, which lack this register.
    fn disable_protection(&mut self);
}

/// The state of the debug port after a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DebugPort {
    /// The hardware alone decides by UICR.APPROTECT, since this older part has no APPROTECT.DISABLE.
    ByHardware,
    /// The firmware has to open the debug port, and UICR.APPROTECT allows that.
    ToBeOpened,
    /// The debug port is locked, and UICR.APPROTECT does not allow the firmware to open it.
    Locked,
}

impl DebugPort {
    /// Returns the state of the debug port for these values of FICR.INFO.VARIANT and UICR.APPROTECT.
    #[must_use]
    pub const fn of(variant: u32, uicr_approtect: u32) -> Self {
        let [_, build_code, ..] = variant.to_le_bytes();
        if build_code < FIRST_LOCKED {
            Self::ByHardware
        } else if uicr_approtect & 0xFF == HW_DISABLED {
            Self::ToBeOpened
        } else {
            Self::Locked
        }
    }
}

/// Opens the debug port if the part needs that and UICR allows it. Call it first after every reset, so that a debugger
/// can connect even if the firmware stops early.
pub fn open(registers: &mut impl Registers) -> DebugPort {
    let port = DebugPort::of(registers.variant(), registers.uicr_approtect());
    if port == DebugPort::ToBeOpened {
        registers.disable_protection();
    }
    port
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Part {
        variant: u32,
        uicr: u32,
        written: u32,
    }

    impl Registers for Part {
        fn variant(&self) -> u32 {
            self.variant
        }

        fn uicr_approtect(&self) -> u32 {
            self.uicr
        }

        fn disable_protection(&mut self) {
            self.written += 1;
        }
    }

    fn opened(variant: &[u8; 4], uicr: u32) -> (DebugPort, u32) {
        let mut part = Part { variant: u32::from_be_bytes(*variant), uicr, written: 0 };
        (open(&mut part), part.written)
    }

    #[test]
    fn a_part_of_revision_3_is_opened_once_uicr_says_so() {
        for variant in [b"AAF0", b"AAFA", b"BAF0", b"AAG0", b"\xFF\xFF\xFF\xFF"] {
            assert_eq!(opened(variant, 0x5A), (DebugPort::ToBeOpened, 1), "{variant:?}");
            assert_eq!(opened(variant, 0xFFFF_FF5A), (DebugPort::ToBeOpened, 1), "{variant:?}");
        }
    }

    #[test]
    fn a_revision_3_part_stays_locked_unless_uicr_opens_it() {
        for uicr in [0xFFFF_FFFF, 0, 0xFFFF_FF00, 0x5A00, 0x5B, 0xA5] {
            assert_eq!(opened(b"AAF0", uicr), (DebugPort::Locked, 0), "{uicr:#x}");
        }
    }

    #[test]
    fn on_an_older_part_the_debug_port_is_left_to_the_hardware() {
        for variant in [b"AAAA", b"BAAA", b"AACA", b"AAC0", b"AAD0", b"AAD1", b"AAE0"] {
            for uicr in [0xFFFF_FFFF, 0, 0x5A] {
                assert_eq!(opened(variant, uicr), (DebugPort::ByHardware, 0), "{variant:?} {uicr:#x}");
            }
        }
    }
}
