//! What a part adds to the debug port of its core, and what its resets do to it.

use emulator_part::{Part, Reset};
use nrf52840::{CtrlRequest, Nrf52840};
use stm32f429::Stm32f429;

use crate::boards::{Dpr, Horus};
use emulator_node::{Bare, Board};

/// What a write to one of the part's own access ports did to the part's reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PinReset {
    /// The reset is unchanged.
    Unchanged,
    /// The part is held in reset.
    Hold,
    /// The part starts, by a soft reset.
    Release,
}

/// A part with a debug port.
pub trait Debugged: Part {
    /// The memory that the part keeps without its supply, flash first: address and size of each range.
    const KEPT: &'static [(u32, usize)];

    /// Whether a debugger reaches the part's AHB-AP.
    fn is_open(&self) -> bool {
        true
    }

    /// Whether the part has a reset pin in its present configuration.
    fn has_reset_pin(&self) -> bool {
        true
    }

    /// Whether a reset for this cause also resets the core's debug registers. ARMv7-M C1.6.5 promises that only of a
    /// power-on reset.
    fn resets_debug(cause: Reset) -> bool {
        matches!(cause, Reset::PowerOn | Reset::BrownOut)
    }

    /// Reads a register of an access port beside the AHB-AP.
    fn read_port(&self, ap: u8, register: u8) -> u32 {
        let _ = (ap, register);
        0
    }

    /// Writes a register of an access port beside the AHB-AP at the part's cycle `at`.
    fn write_port(&mut self, ap: u8, register: u8, value: u32, at: u64) -> PinReset {
        let _ = (ap, register, value, at);
        PinReset::Unchanged
    }

    /// Advances the part to its cycle `at` with a debugger connected.
    fn port_advances(&mut self, at: u64) {
        let _ = at;
    }
}

impl Debugged for Nrf52840 {
    const KEPT: &'static [(u32, usize)] = &[(0, 1 << 20), (0x1000_1000, 4096)];

    fn is_open(&self) -> bool {
        self.access_port_open()
    }

    /// Whether UICR.PSELRESET selects a reset pin: both of its words must agree and be connected (PS 4.5, 5.3.7).
    fn has_reset_pin(&self) -> bool {
        let words = self.memory(0x1000_1200, 8).unwrap_or_default();
        words.len() == 8 && words[..4] == words[4..] && words[3] & 0x80 == 0
    }

    /// Every reset of the nRF52840 resets the debug registers, except a soft reset and the reset by a lock-up (PS
    /// 5.3.7.8, *Reset behavior*: "Debug").
    fn resets_debug(cause: Reset) -> bool {
        !matches!(cause, Reset::Software | Reset::Lockup)
    }

    /// The nRF52840's access port 1 is CTRL-AP (PS 4.8.1).
    fn read_port(&self, ap: u8, register: u8) -> u32 {
        if ap == 1 { self.ctrl_ap_read(register) } else { 0 }
    }

    fn write_port(&mut self, ap: u8, register: u8, value: u32, at: u64) -> PinReset {
        if ap != 1 {
            return PinReset::Unchanged;
        }
        match self.ctrl_ap_write(register, value, at) {
            CtrlRequest::Nothing => PinReset::Unchanged,
            CtrlRequest::HoldReset => PinReset::Hold,
            CtrlRequest::ReleaseReset => PinReset::Release,
        }
    }

    fn port_advances(&mut self, at: u64) {
        self.ctrl_ap_advance(at);
    }
}

impl Debugged for Stm32f429 {
    /// The memory that an STM32F429 keeps: its flash, and the option bytes of the first bank (RM0090 3.9).
    const KEPT: &'static [(u32, usize)] = &[(0x0800_0000, 2 << 20), (0x1FFF_C000, 16)];
}

/// A board whose debug port works without any other board of the link.
pub trait Alone: Board {
    /// Discards the signals that leave the board.
    fn forget_outgoing(&mut self) {}
}

impl<P: Part> Alone for Bare<P> {}

impl Alone for Dpr {
    fn forget_outgoing(&mut self) {
        drop(self.front_end.take_air());
    }
}

impl Alone for Horus {
    fn forget_outgoing(&mut self) {
        drop(self.front_end.take_air());
        drop(self.receivers.take_sent());
    }
}
