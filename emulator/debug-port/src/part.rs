//! What a microcontroller adds to the debug port of its core.

use emulator_part::{Part, Reset};
use nrf52840::{CtrlRequest, Nrf52840};
use stm32f429::Stm32f429;

use emulator_node::{Bare, Board};

/// The effect that a write to one of the microcontroller's own access ports has on the microcontroller's reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PinReset {
    /// The reset is unchanged.
    Unchanged,
    /// The microcontroller is held in reset.
    Hold,
    /// The microcontroller starts by a soft reset.
    Release,
}

/// A microcontroller with a debug port.
pub trait Debugged: Part {
    /// The memory that the microcontroller keeps without supply, flash first: address and size of each range.
    const KEPT: &'static [(u32, usize)];

    /// Whether a debugger can access the microcontroller's AHB-AP.
    fn is_open(&self) -> bool {
        true
    }

    /// Whether a reset pin is configured.
    fn has_reset_pin(&self) -> bool {
        true
    }

    /// Whether a reset for this cause also resets the debug registers. ARMv7-M ARM C1.6.5 promises it for power-on
    /// only.
    fn resets_debug(cause: Reset) -> bool {
        matches!(cause, Reset::PowerOn | Reset::BrownOut)
    }

    /// Reads a register of an access port other than the AHB-AP.
    fn read_port(&self, ap: u8, register: u8) -> u32 {
        let _ = (ap, register);
        0
    }

    /// Writes a register of an access port other than the AHB-AP at clock cycle `at`.
    fn write_port(&mut self, ap: u8, register: u8, value: u32, at: u64) -> PinReset {
        let _ = (ap, register, value, at);
        PinReset::Unchanged
    }

    /// Advances the microcontroller to its clock cycle `at` with a debugger connected.
    fn port_advances(&mut self, at: u64) {
        let _ = at;
    }
}

impl Debugged for Nrf52840 {
    const KEPT: &'static [(u32, usize)] = &[(0, 1 << 20), (0x1000_1000, 4096)];

    fn is_open(&self) -> bool {
        self.access_port_open()
    }

    /// UICR.PSELRESET selects a reset pin if both of its words are equal and not "disconnected" (PS 4.5, 5.3.7).
    fn has_reset_pin(&self) -> bool {
        let words = self.memory(0x1000_1200, 8).unwrap_or_default();
        words.len() == 8 && words[..4] == words[4..] && words[3] & 0x80 == 0
    }

    /// Only a soft reset and the reset by a lock-up keep the nRF52840's debug registers (PS 5.3.7.8, "Debug").
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
    /// An STM32F429 keeps its flash and the option bytes of the first bank (RM0090 3.9).
    const KEPT: &'static [(u32, usize)] = &[(0x0800_0000, 2 << 20), (0x1FFF_C000, 16)];
}

/// A board that can run alone at its debug port, without the boards and chips that it is usually connected to.
pub trait Alone: Board {
    /// Discards the signals that the board sends.
    fn forget_outgoing(&mut self) {}
}

impl<P: Part> Alone for Bare<P> {}

/// Restores the memory that a microcontroller keeps without supply. Returns `None` if `kept` has fewer or more bytes
/// than all of [`Debugged::KEPT`]; some of the memory may then have been restored.
pub fn restore<P: Debugged + Part>(part: &mut P, kept: &[u8]) -> Option<()> {
    let mut rest = kept;
    for &(address, size) in P::KEPT {
        let (bytes, behind) = rest.split_at_checked(size)?;
        part.memory_mut(address, size)?.copy_from_slice(bytes);
        rest = behind;
    }
    rest.is_empty().then_some(())
}
