//! The register map: which registers exist, their writable bits and reset values, and how far they are modelled.
//!
//! | covered | DS13541 |
//! |---|---|
//! | spaces A and B, addresses, writable bits, reset values | 4.5 Registers, tables of spaces A and B |
//!
//! | left out | why |
//! |---|---|
//! | effects of analog registers on the radio (0B–0E, 26–2B, | the air is digital; they are stored and read back; |
//! | B0B–B0D, B0F, B28–B2A, B2E–B38), except in the next column's modules | `receive_chain`, `modulation`, `field`, |
//! | | `supply` |
//! | stream mode, EMD suppression, wake-up by amplitude or phase, | the link uses none; a write of another value |
//! | PPON2, capacitive sensor | than reset is reported |
//!
//! The reset values have three sources. Those of registers 03, 0B, 0C, 0D, 0F, 15, 28, B0B, B0C, B15 and B29 come from
//! a recording of silicon after a bring-up that does not write them. Those of 26, 27, 29–2B and B2A come from public
//! drivers. All others are 0. B28 connects the load modulator after reset, which is the cautious assumption for a
//! listener that must not answer.

use crate::Variant;
use crate::report::Space;

/// The register addresses; a name with `B_` is in space B.
pub(crate) mod reg {
    pub(crate) const IO2: usize = 0x01;
    pub(crate) const OPERATION: usize = 0x02;
    pub(crate) const MODE: usize = 0x03;
    pub(crate) const BIT_RATE: usize = 0x04;
    pub(crate) const ISO14443A: usize = 0x05;
    pub(crate) const PREAMBLE: usize = 0x07;
    pub(crate) const PASSIVE_TARGET: usize = 0x08;
    pub(crate) const AUX: usize = 0x0A;
    pub(crate) const RX_CONF1: usize = 0x0B;
    pub(crate) const RX_CONF3: usize = 0x0D;
    pub(crate) const RX_CONF4: usize = 0x0E;
    pub(crate) const MASK_RECEIVE: usize = 0x0F;
    pub(crate) const NO_RESPONSE: usize = 0x10;
    pub(crate) const TIMERS: usize = 0x12;
    pub(crate) const GENERAL_PURPOSE: usize = 0x13;
    pub(crate) const MASK: usize = 0x16;
    pub(crate) const IRQ: usize = 0x1A;
    pub(crate) const TRANSMIT_LENGTH: usize = 0x22;
    pub(crate) const RATE_DETECTED: usize = 0x24;
    pub(crate) const AD_RESULT: usize = 0x25;
    pub(crate) const TUNE_A: usize = 0x26;
    pub(crate) const TUNE_B: usize = 0x27;
    pub(crate) const TX_DRIVER: usize = 0x28;
    pub(crate) const PT_MOD: usize = 0x29;
    pub(crate) const FIELD_ON_THRESHOLD: usize = 0x2A;
    pub(crate) const FIELD_OFF_THRESHOLD: usize = 0x2B;
    pub(crate) const REGULATOR: usize = 0x2C;
    pub(crate) const RSSI: usize = 0x2D;
    pub(crate) const GAIN: usize = 0x2E;
    pub(crate) const WAKE_UP: usize = 0x32;
    pub(crate) const B_CORR1: usize = 0x0C;
    pub(crate) const B_CORR2: usize = 0x0D;
    pub(crate) const B_GUARD: usize = 0x15;
    pub(crate) const B_AUX_MOD: usize = 0x28;
    pub(crate) const B_DRIVER_TIMING: usize = 0x2B;
    pub(crate) const B_AWS1: usize = 0x2E;
    pub(crate) const B_REGULATOR: usize = 0x2C;
    pub(crate) const B_RC_CALIBRATION: usize = 0x39;
}

/// Bits of the operation control register, 02.
pub(crate) const EN: u8 = 0x80;
pub(crate) const RX_EN: u8 = 0x40;
pub(crate) const TX_EN: u8 = 0x08;
pub(crate) const EN_FD: u8 = 0x03;
/// targ: the chip is a target.
pub(crate) const TARGET: u8 = 0x80;

/// How far a register is modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// The value is stored. Its function is modelled, or is analog and has no effect in the model.
    Stored,
    /// The register shows a result or a status, and writes have no effect.
    ReadOnly,
    /// The value is stored, but the digital function is not modelled. A write of a new value is a finding.
    Unmodelled,
    /// The variant does not have the register.
    Absent,
}

pub(crate) const RESET_A: [u8; 64] = {
    let mut r = [0u8; 64];
    r[0x03] = 0x08;
    r[0x0B] = 0x08;
    r[0x0C] = 0x2D;
    r[0x0D] = 0xD8;
    r[0x0F] = 0x0C;
    r[0x15] = 0x80;
    r[0x26] = 0x80;
    r[0x27] = 0x80;
    r[0x28] = 0x70;
    r[0x29] = 0x60;
    r[0x2A] = 0x13;
    r[0x2B] = 0x02;
    r
};

pub(crate) const RESET_B: [u8; 64] = {
    let mut r = [0u8; 64];
    r[0x0B] = 0x0C;
    r[0x0C] = 0x93;
    r[0x15] = 0x33;
    r[0x28] = 0x10;
    r[0x29] = 0x7C;
    r[0x2A] = 0x80;
    r
};

pub(crate) fn reset(space: Space, address: u8) -> u8 {
    let i = usize::from(address & 0x3F);
    match space {
        Space::A => RESET_A[i],
        Space::B => RESET_B[i],
        Space::Test => 0,
    }
}

/// Returns the bits of a register that a fault can flip: all bits of stored registers and of interrupt registers.
pub(crate) fn flippable(variant: Variant, space: Space, address: u8) -> u8 {
    match class(variant, space, address) {
        Class::Stored | Class::Unmodelled => writable(space, address),
        Class::ReadOnly if space == Space::A && (0x1A..=0x1D).contains(&address) => writable(space, address - 4),
        Class::ReadOnly | Class::Absent => 0,
    }
}

/// Returns the bits that exist in a register. The others read 0.
pub(crate) fn writable(space: Space, address: u8) -> u8 {
    match (space, address) {
        // Bit 1 of register 01 is reserved, and bit 0 is slow_up (ST25R3916) or act_amsink (B).
        (Space::A, 0x01) => 0xFD,
        (Space::A, 0x04) => 0x33,
        // Bit 2 of register 19 is reserved: in the recording of silicon the firmware writes FF and reads FB back.
        (Space::A, 0x19) => 0xFB,
        (Space::A, 0x12) => 0xEF,
        _ => 0xFF,
    }
}

/// Returns the bits of `value` that are not modelled; a write that sets them is a finding.
pub(crate) fn unmodelled_bits(space: Space, address: u8, value: u8) -> u8 {
    match (space, address) {
        // Bits 0 and 1 of register 03 are nfc_ar, which lets the chip switch a response field on by itself.
        (Space::A, 0x03) => value & 0x03,
        // Bits 0, 5 and 6 of register 05 are antcl, nfc_f0 and no_rx_par.
        (Space::A, 0x05) => value & 0x61,
        // In register 12 the model covers gptc values 1 and 2, and neither nrt_nfc nor nrt_emv.
        (Space::A, 0x12) => value & 0x06 | if value >> 5 > 2 { value & 0xE0 } else { 0 },
        _ => 0,
    }
}

/// Returns how far a register is modelled for `variant`.
pub(crate) fn class(variant: Variant, space: Space, address: u8) -> Class {
    match space {
        Space::A => match address {
            0x1A..=0x21 | 0x24 | 0x25 | 0x2D | 0x2E | 0x31 | 0x35 | 0x36 | 0x39 | 0x3A | 0x3F => Class::ReadOnly,
            0x30 | 0x3D | 0x3E if variant == Variant::St25r3916 => Class::ReadOnly,
            0x2F | 0x3B | 0x3C if variant == Variant::St25r3916 => Class::Unmodelled,
            0x2F | 0x30 | 0x3B..=0x3E => Class::Absent,
            0x06 | 0x09 | 0x15 | 0x33 | 0x34 | 0x37 | 0x38 => Class::Unmodelled,
            _ => Class::Stored,
        },
        Space::B => match address {
            0x05 | 0x06 => Class::Unmodelled,
            0x0B..=0x0D | 0x0F | 0x15 | 0x28..=0x2A | 0x30..=0x33 => Class::Stored,
            0x2B | 0x2C => Class::ReadOnly,
            0x39 if variant == Variant::St25r3916b => Class::ReadOnly,
            0x2E | 0x2F | 0x34..=0x38 if variant == Variant::St25r3916b => Class::Stored,
            _ => Class::Absent,
        },
        // Test register 04 switches the overheat protection off. The bring-up of the ST25R3916 writes it.
        Space::Test => match address {
            0x04 => Class::Stored,
            _ => Class::Unmodelled,
        },
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Registers {
    a: [u8; 64],
    b: [u8; 64],
    test: [u8; 64],
    target_memory: [u8; TARGET_MEMORY],
}

/// The size of the passive target memory in bytes: 15 for NFC-A, 21 for NFC-F and 12 for TSN.
const TARGET_MEMORY: usize = 48;

impl Registers {
    pub(crate) fn new() -> Self {
        Self { a: RESET_A, b: RESET_B, test: [0; 64], target_memory: [0; TARGET_MEMORY] }
    }

    /// Gives every register its reset value, but keeps the passive target memory.
    pub(crate) fn reset(&mut self) {
        *self = Self { target_memory: self.target_memory, ..Self::new() };
    }

    pub(crate) fn get(&self, space: Space, address: u8) -> u8 {
        let i = usize::from(address & 0x3F);
        match space {
            Space::A => self.a[i],
            Space::B => self.b[i],
            Space::Test => self.test[i],
        }
    }

    /// Stores a value in a register, even in bits that are not writable.
    pub(crate) fn set(&mut self, space: Space, address: u8, value: u8) {
        let i = usize::from(address & 0x3F);
        match space {
            Space::A => self.a[i] = value,
            Space::B => self.b[i] = value,
            Space::Test => self.test[i] = value,
        }
    }

    pub(crate) fn a(&self, i: usize) -> u8 {
        self.a[i]
    }

    /// Returns two registers of space A as one number: `i` is the higher byte, `i + 1` the lower one.
    pub(crate) fn a16(&self, i: usize) -> u16 {
        u16::from_be_bytes([self.a[i], self.a[i + 1]])
    }

    pub(crate) fn b(&self, i: usize) -> u8 {
        self.b[i]
    }

    /// Returns the interrupt bits that the mask registers (16 to 19) keep from driving the IRQ pin.
    pub(crate) fn interrupt_mask(&self) -> u32 {
        u32::from_le_bytes([self.a[reg::MASK], self.a[reg::MASK + 1], self.a[reg::MASK + 2], self.a[reg::MASK + 3]])
    }

    pub(crate) fn target_memory(&self) -> &[u8; TARGET_MEMORY] {
        &self.target_memory
    }

    /// Loads byte `i` of the passive target memory; a byte beyond its end is ignored.
    pub(crate) fn load_target_memory(&mut self, i: u8, value: u8) {
        if let Some(cell) = self.target_memory.get_mut(usize::from(i)) {
            *cell = value;
        }
    }
}
