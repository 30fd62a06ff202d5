//! The debugger's side of the part: access port protection and the control access port, CTRL-AP (PS 4.8).
//!
//! | covered | PS |
//! |---|---|
//! | CTRL-AP: RESET, ERASEALL, ERASEALLSTATUS, APPROTECTSTATUS, IDR | 4.8.1 |
//! | ERASEALL of flash, UICR and RAM; the AHB-AP is then open until UICR is next read, at a reset | 4.8.1, 4.8.2 |
//! | UICR.APPROTECT, read at a reset by power, brown-out, pin, watchdog or wake-up | 4.8.2, 5.3.7.8 |
//! | APPROTECT.DISABLE and FORCEPROTECT, on build codes Fxx and later | 4.8.2 |
//!
//! | left out | why |
//! |---|---|
//! | any answer but zeros of a locked part's AHB-AP | none is documented; to tools, AP 0 is no memory AP |
//! | an ERASEALL that is interrupted | a watchdog reset in it (anomaly 176) leaves everything as it was, and locked |
//!
//! A soft reset, by AIRCR or CTRL-AP's RESET, does not reset the debug components (PS 5.3.7.8, *Reset behavior*). The
//! AHB-AP then stays open or locked. Nordic says the same (devzone.nordicsemi.com, "nRF52840 locked with APPROTECT"):
//! there must be no *hard* reset between ERASEALL and the first image. To tools, a locked part's AHB-AP is no memory AP
//! (ferrous-systems/embedded-trainings-2020, issue 188).
use emulator_part::{Cycle, NEVER, Reset};

use super::Soc;
use crate::clocks::cycles;
use crate::memory::{FLASH_BYTES, PAGE, UICR_BASE};

const UICR_APPROTECT: u32 = UICR_BASE + 0x208;
/// HwDisabled, the value that opens the hardware's half of the protection. Parts before build code Fxx need the erased
/// value.
const HW_DISABLED: u8 = 0x5A;
const ERASED: u8 = 0xFF;

/// The cycles of ERASEALL: the specification's maximum (PS 4.3), as in the NVMC.
const ERASE_ALL: u64 = cycles(169_000_000);

/// The IDR of CTRL-AP: Nordic's JEP106 number 0x144 in bank 2, no class (PS 4.8.1).
const IDR: u32 = 0x0288_0000;

/// What a write to CTRL-AP requests of the owner of part and core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CtrlRequest {
    /// The write requests nothing.
    Nothing,
    /// A soft reset begins, and holds the part until it is released.
    HoldReset,
    /// The soft reset has ended, and the part starts.
    ReleaseReset,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Access {
    /// Whether UICR.APPROTECT was open when the part last read it, at a reset.
    hardware_open: bool,
    /// Whether the debug port stays open, whatever the registers say, until UICR is read again.
    stays_open: bool,
    reset_held: bool,
    erases_until: Option<Cycle>,
}

impl Soc {
    /// Reads UICR.APPROTECT, as the part does at a reset of the debug components.
    fn take_up_protection(&mut self) {
        let value = self.memory.slice(UICR_APPROTECT, 1).map_or(ERASED, |bytes| bytes[0]);
        let hardened = self.settings.build_code[2] >= b'F';
        self.access.hardware_open = value == if hardened { HW_DISABLED } else { ERASED };
        self.access.stays_open = self.access.hardware_open && !hardened;
    }

    /// Updates the protection at a restart, before the registers are reset.
    pub(crate) fn protection_restarts(&mut self, cause: Reset) {
        self.abandon_erase();
        match cause {
            Reset::Software | Reset::Lockup => self.access.stays_open = self.access_port_open(),
            _ => self.take_up_protection(),
        }
    }

    pub(crate) fn access_port_open(&self) -> bool {
        self.access.stays_open || self.access.hardware_open && self.debug_port_enabled()
    }

    fn abandon_erase(&mut self) {
        self.access.erases_until = None;
    }

    /// Completes ERASEALL if its time is over.
    pub(crate) fn ctrl_ap_advance(&mut self, now: Cycle) {
        if self.access.erases_until.is_none_or(|until| now < until) {
            return;
        }
        self.abandon_erase();
        self.memory.erase(0, FLASH_BYTES);
        self.memory.erase(UICR_BASE, PAGE);
        self.memory.ram.bytes_mut().fill(0);
        self.access.stays_open = true;
        self.signals.stall_until(0);
        self.signals.forget_code();
    }

    pub(crate) fn ctrl_ap_read(&self, register: u8) -> u32 {
        match register {
            0x00 => u32::from(self.access.reset_held),
            0x08 => u32::from(self.access.erases_until.is_some()),
            0x0C => u32::from(self.access_port_open()),
            0xFC => IDR,
            _ => 0,
        }
    }

    pub(crate) fn ctrl_ap_write(&mut self, register: u8, value: u32, now: Cycle) -> CtrlRequest {
        let on = value & 1 == 1;
        match register {
            0x00 if on != self.access.reset_held => {
                self.access.reset_held = on;
                if on { CtrlRequest::HoldReset } else { CtrlRequest::ReleaseReset }
            }
            0x04 if on && self.access.erases_until.is_none() => {
                self.access.erases_until = Some(now + ERASE_ALL);
                self.signals.stall_until(NEVER);
                CtrlRequest::Nothing
            }
            _ => CtrlRequest::Nothing,
        }
    }
}
