//! The register file: the values that reads return, and the effects of writes.
//!
//! | covered | DS13541 |
//! |---|---|
//! | interrupt registers (1A to 1D), FIFO status (1E, 1F), timer and rate display (24), | 4.5 Registers |
//! | auxiliary display (31), identity (3F) | |
//! | operation control (02), mode (03), bit rate (04), I/O configuration (01), tuning, masks (16 to 19) | as above |
//! | an injected fault that flips a bit of a register, whose new value then takes effect | none, it is a fault |
//!
//! | left out | why |
//! |---|---|
//! | response field (03, nfc_ar), no_rx_par, nfc_f0, antcl (05) | the link uses none; set bits are reported |
//! | test registers | test register 04 is stored for the bring-up, the others are reported |

use super::Chip;
use crate::config::Variant;
use crate::registers::{self, Class, EN_FD, RX_EN, TARGET, reg};
use crate::report::{Kind, Space};
use crate::schedule::Due;
use crate::supply;

impl Chip {
    /// Returns the value of a register without the side effects of a read.
    pub fn peek(&self, space: Space, address: u8) -> u8 {
        let core = &self.core;
        let stored = core.registers().get(space, address);
        if space != Space::A {
            return stored;
        }
        let i = usize::from(address & 0x3F);
        match i {
            0x1A..=0x1D => core.interrupts().pending().to_le_bytes()[i - reg::IRQ],
            0x1E => (self.fifo_level() & 0xFF) as u8,
            0x1F => {
                let level = self.fifo_level();
                (((level >> 8) & 0x03) << 6) as u8
                    | u8::from(self.fifo.underflow) << 5
                    | u8::from(self.fifo.overflow) << 4
                    | self.fifo.last_bits << 1
            }
            reg::RATE_DETECTED => {
                stored & 0x30
                    | u8::from(core.running(Due::GeneralPurpose)) << 2
                    | u8::from(core.running(Due::NoResponse)) << 1
                    | u8::from(core.running(Due::MaskReceive))
            }
            0x31 => self.auxiliary_display(),
            0x3F => match core.config().variant {
                Variant::St25r3916 => 0x2A,
                Variant::St25r3916b => 0x31,
            },
            _ => stored,
        }
    }

    fn auxiliary_display(&self) -> u8 {
        let Self { core, field, receiver, .. } = self;
        // With en_fd = 3 (automatic), a recording of silicon shows peer detection (en_peer) while the chip's own field
        // is off. While that field is on, automatic means collision avoidance.
        let (peer, avoidance) = match core.a(reg::OPERATION) & EN_FD {
            1 => (false, true),
            2 => (true, false),
            3 => (!field.own(), field.own()),
            _ => (false, false),
        };
        let rx_on = core.oscillator()
            && core.operates(RX_EN)
            && !receiver.masked()
            && (core.target() || field.own())
            && !core.running(Due::MaskReceive);
        u8::from(field.detected()) << 6
            | u8::from(field.own()) << 5
            | u8::from(core.oscillator()) << 4
            | u8::from(rx_on) << 3
            | u8::from(receiver.busy()) << 2
            | u8::from(peer) << 1
            | u8::from(avoidance)
    }

    pub(super) fn register_exists(&mut self, space: Space, address: u8) {
        if registers::class(self.core.config().variant, space, address) == Class::Absent {
            self.core.note(Kind::NoSuchRegister(space, address));
        }
    }

    pub(super) fn write_register(&mut self, space: Space, address: u8, value: u8) {
        let core = &mut self.core;
        match registers::class(core.config().variant, space, address) {
            Class::Absent => return core.note(Kind::NoSuchRegister(space, address)),
            Class::ReadOnly => return core.note(Kind::ReadOnlyWritten(space, address)),
            Class::Unmodelled => {
                if value != registers::reset(space, address) {
                    core.note(Kind::UnmodelledRegister(space, address));
                }
            }
            Class::Stored => {}
        }
        let value = value & registers::writable(space, address);
        let unmodelled = registers::unmodelled_bits(space, address, value);
        if unmodelled != 0 {
            core.note(Kind::UnmodelledBits(space, address, unmodelled));
        }
        match (space, usize::from(address & 0x3F)) {
            (Space::A, reg::MODE) if !core.oscillator() => return core.note(Kind::ModeWithoutOscillator),
            (Space::A, i @ (reg::MODE | reg::BIT_RATE)) => self.changes_in_frame(i, value),
            (Space::A, reg::OPERATION) if value & 0x04 != 0 => {
                core.note(Kind::UnmodelledRegister(space, address));
            }
            _ => {}
        }
        self.store(space, address, value);
        if space == Space::A && matches!(usize::from(address), reg::TUNE_A | reg::TUNE_B) {
            supply::tuning_suits(&mut self.core, &self.field);
        }
    }

    /// Returns the bits of a register that the chip stores, which [`Chip::flip`] can flip.
    pub fn flippable(&self, space: Space, address: u8) -> u8 {
        registers::flippable(self.core.config().variant, space, address)
    }

    /// Flips one bit of a register now. Nothing happens if the chip does not store the bit or has no supply.
    pub fn flip(&mut self, space: Space, address: u8, bit: u8) {
        let bits = 1 << (bit & 7) & self.flippable(space, address);
        if bits == 0 || !self.core.powered() {
            return;
        }
        match (space, usize::from(address)) {
            (Space::A, i @ reg::IRQ..=0x1D) => self.core.flip_interrupts(u32::from(bits) << (8 * (i - reg::IRQ))),
            _ => self.store(space, address, self.core.registers().get(space, address) ^ bits),
        }
    }

    fn store(&mut self, space: Space, address: u8, value: u8) {
        match (space, usize::from(address & 0x3F)) {
            (Space::A, reg::MODE) => self.mode_becomes(value),
            (Space::A, reg::BIT_RATE) => self.bit_rate_becomes(value),
            (_, i) => {
                self.core.registers_mut().set(space, address, value);
                match (space, i) {
                    (Space::A, reg::OPERATION) => self.operation_changed(),
                    (Space::A, reg::FIELD_ON_THRESHOLD | reg::FIELD_OFF_THRESHOLD) => self.field.look(&mut self.core),
                    (Space::A, 0x16..=0x19) => self.core.pin_follows(),
                    _ => {}
                }
            }
        }
    }

    fn mode_becomes(&mut self, value: u8) {
        let entered = value & TARGET != 0 && !self.core.target();
        self.core.set_a(reg::MODE, value);
        self.let_go();
        if entered || !self.core.target() {
            self.receiver.mask_idle(&self.core);
        }
    }

    fn bit_rate_becomes(&mut self, value: u8) {
        let receives = (value ^ self.core.a(reg::BIT_RATE)) & 0x03 != 0;
        self.core.set_a(reg::BIT_RATE, value);
        if receives {
            self.let_go();
        }
    }

    fn changes_in_frame(&mut self, i: usize, value: u8) {
        let on_its_way = self.transmitter.busy() || self.receiver.busy();
        if on_its_way && self.core.a(i) != value {
            self.core.note(Kind::ChangedInFrame(i as u8));
        }
    }
}
