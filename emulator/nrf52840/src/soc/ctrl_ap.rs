//! What a debugger meets: access port protection and the control access port, CTRL-AP (PS 4.8).
//!
//! | covered | PS |
//! |---|---|
//! | CTRL-AP: RESET, ERASEALL, ERASEALLSTATUS, APPROTECTSTATUS, IDR | 4.8.1 |
//! | ERASEALL: flash, UICR and RAM; access to the AHB-AP until the next reset that takes UICR up | 4.8.1, 4.8.2 |
//! | UICR.APPROTECT, taken up at a reset by power, brown-out, pin, watchdog or wake-up | 4.8.2, 5.3.7.8 |
//! | APPROTECT.DISABLE and FORCEPROTECT, on build codes Fxx and later | 4.8.2 |
//!
//! | left out | why |
//! |---|---|
//! | the AHB-AP of a locked part showing more than zeros | none documented; tools meet an AP 0 that is no memory AP |
//! | ERASEALL ended half way | a watchdog that bites meanwhile (anomaly 176) leaves all as it was, and locked |
//!
//! A soft reset, by AIRCR or by RESET here, does not reset the debug components (PS 5.3.7.8, *Reset behavior*), and
//! leaves the port as it was, open or locked: so say Nordic's answers
//! (devzone.nordicsemi.com, "nRF52840 locked with APPROTECT": no *hard* reset between ERASEALL and the first image).
//! A locked part's AHB-AP is no memory AP to the tools that meet it
//! (ferrous-systems/embedded-trainings-2020, issue 188).
use emulator_part::{Cycle, NEVER, Reset};

use super::Soc;
use crate::clocks::cycles;
use crate::memory::{FLASH_BYTES, PAGE, UICR_BASE};

/// UICR.APPROTECT.
const UICR_APPROTECT: u32 = UICR_BASE + 0x208;
/// What it holds when the hardware's half is open: HwDisabled, and erased on parts before build code Fxx.
const HW_DISABLED: u8 = 0x5A;
const ERASED: u8 = 0xFF;

/// The specification's maximum for everything (PS 4.3), as the NVMC takes.
const ERASE_ALL: u64 = cycles(169_000_000);

/// CTRL-AP's identification: Nordic's JEP106 number 0x144 in bank 2, no class (PS 4.8.1).
const IDR: u32 = 0x0288_0000;

/// What a write to CTRL-AP asks of whoever holds part and core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CtrlRequest {
    /// Nothing.
    Nothing,
    /// A soft reset begins, and the part stays in it.
    HoldReset,
    /// It ends: the part starts.
    ReleaseReset,
}

/// The state of both.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Access {
    /// UICR.APPROTECT as it was taken up.
    hardware_open: bool,
    /// It stands open since, whatever the registers say, until UICR is taken up again.
    stays_open: bool,
    /// CTRL-AP's RESET.
    reset_held: bool,
    /// Until when ERASEALL takes.
    erases_until: Option<Cycle>,
}

impl Soc {
    /// UICR counts from here on: at a reset that resets the debug components.
    fn take_up_protection(&mut self) {
        let value = self.memory.slice(UICR_APPROTECT, 1).map_or(ERASED, |bytes| bytes[0]);
        let hardened = self.settings.build_code[2] >= b'F';
        self.access.hardware_open = value == if hardened { HW_DISABLED } else { ERASED };
        self.access.stays_open = self.access.hardware_open && !hardened;
    }

    /// Before the registers of a restart for `cause` are new.
    pub(crate) fn protection_restarts(&mut self, cause: Reset) {
        self.abandon_erase();
        match cause {
            Reset::Software | Reset::Lockup => self.access.stays_open = self.access_port_open(),
            _ => self.take_up_protection(),
        }
    }

    /// Whether a debugger reaches the AHB-AP.
    pub(crate) fn access_port_open(&self) -> bool {
        self.access.stays_open || self.access.hardware_open && self.debug_port_enabled()
    }

    fn abandon_erase(&mut self) {
        self.access.erases_until = None;
    }

    /// ERASEALL ends where its time has come.
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
                // The core gets nothing out of memory that is being erased.
                self.signals.stall_until(NEVER);
                CtrlRequest::Nothing
            }
            _ => CtrlRequest::Nothing,
        }
    }
}
