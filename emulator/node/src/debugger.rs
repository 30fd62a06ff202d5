//! How a debugger inspects and changes a node.

use cortex_m4::{Cost, Register};
use emulator_part::{Part, Pin};

use super::{Board, Digest, Error, Firmware, Node, memory};

impl<B: Board, C: Cost> Node<B, C> {
    /// The firmware image that this node runs.
    #[must_use]
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// The value of core register `number`: 0 to 15, and 16 for xPSR.
    #[must_use]
    pub fn register(&self, number: usize) -> u32 {
        match u8::try_from(number) {
            Ok(number @ 0..=15) => self.core.register(Register::R(number)),
            _ => self.core.register(Register::Xpsr),
        }
    }

    /// Changes core register `number`, 0 to 15.
    pub fn set_register(&mut self, number: usize, value: u32) {
        if let Ok(number @ 0..=15) = u8::try_from(number) {
            self.core.set_register(Register::R(number), value);
        }
    }

    /// The value of any register of the core.
    #[must_use]
    pub fn core_register(&self, register: Register) -> u32 {
        self.core.register(register)
    }

    /// Changes any register of the core.
    pub fn set_core_register(&mut self, register: Register, value: u32) {
        self.core.set_register(register, value);
    }

    /// The level of `pin` now, whoever drives the pin. A floating pin is low.
    #[must_use]
    pub fn pin(&self, pin: Pin) -> bool {
        self.side.part.pin(pin)
    }

    /// Fills `to` from `address` on, up to the first byte at which nothing answers. Returns the number of bytes read.
    /// Memory is read directly. A word of a peripheral or of the core's own space is read on a copy of core and board,
    /// so the read has no side effects.
    #[must_use]
    #[inline(never)]
    pub fn peek(&self, address: u32, to: &mut [u8]) -> usize {
        if memory::read(&self.side.part, u64::from(address), to) {
            return to.len();
        }
        let mut filled = 0;
        while filled < to.len() {
            let Some(at) = u32::try_from(filled).ok().and_then(|filled| address.checked_add(filled)) else { break };
            let offset = (at & 3) as usize;
            let length = (4 - offset).min(to.len() - filled);
            let bytes = &mut to[filled..filled + length];
            if !memory::read(&self.side.part, u64::from(at), bytes) {
                let (mut core, mut side) = (self.core.clone(), self.side.clone());
                let Ok(word) = core.debug_read(&mut side, at & !3) else { break };
                bytes.copy_from_slice(&word.to_le_bytes()[offset..offset + length]);
            }
            filled += length;
        }
        filled
    }

    /// Writes `from` at `address` as a debugger does: to memory, flash included, or to whole words of peripherals and
    /// of the core's own space. A write of a peripheral has all its effects.
    ///
    /// # Errors
    ///
    /// Returns [`Error::NotMemory`] where nothing takes the write, or for a part of a word that is not memory.
    #[inline(never)]
    pub fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), Error> {
        let refused = Error::NotMemory { address: u64::from(address), length: from.len() };
        if self.write(u64::from(address), from).is_ok() {
            return Ok(());
        }
        let (words, rest) = from.as_chunks::<4>();
        if address & 3 != 0 || !rest.is_empty() {
            return Err(refused);
        }
        for (word, at) in words.iter().zip((address..).step_by(4)) {
            if self.core.debug_write(&mut self.side, at, u32::from_le_bytes(*word)).is_err() {
                return Err(refused);
            }
        }
        self.side.part.signals().announce();
        self.side.stirred = true;
        Ok(())
    }

    /// The word at `address` as a debugger reads it, from memory or from the processor's own registers.
    #[must_use]
    pub fn word(&mut self, address: u64) -> Option<u32> {
        if let Some(word) = memory::value(&self.side.part, address, 4) {
            return u32::try_from(word).ok();
        }
        let address = u32::try_from(address).ok()?;
        if !(0xE000_0000..0xE010_0000).contains(&address) {
            return None;
        }
        self.core.debug_read(&mut self.side, address).ok()
    }

    /// Reads the word at `address`, a multiple of 4, from memory, a peripheral or the core's own space. A read of a
    /// peripheral has all its effects. `None` where nothing answers.
    pub fn read_word(&mut self, address: u32) -> Option<u32> {
        self.core.debug_read(&mut self.side, address).ok()
    }

    /// Fills `to` from memory at `address`.
    ///
    /// # Errors
    ///
    /// Returns [`Error::NotMemory`] where a byte is not memory.
    pub fn read(&self, address: u64, to: &mut [u8]) -> Result<(), Error> {
        let length = to.len();
        memory::read(&self.side.part, address, to).then_some(()).ok_or(Error::NotMemory { address, length })
    }

    /// Writes `from` to memory at `address`, flash included, as a debugger does.
    ///
    /// # Errors
    ///
    /// Returns [`Error::NotMemory`] where a byte is not memory.
    pub fn write(&mut self, address: u64, from: &[u8]) -> Result<(), Error> {
        let written = memory::write(&mut self.side.part, address, from);
        let signals = self.side.part.signals();
        signals.forget_code();
        written.then_some(()).ok_or(Error::NotMemory { address, length: from.len() })
    }

    /// The address of the firmware's symbol `symbol`.
    ///
    /// # Errors
    ///
    /// Returns [`Error::NoSymbol`] where the image has no such symbol.
    pub fn address_of(&self, symbol: &str) -> Result<u64, Error> {
        self.firmware
            .symbol(symbol)
            .map(|symbol| symbol.address)
            .ok_or_else(|| Error::NoSymbol { firmware: self.firmware.name().to_owned(), symbol: symbol.to_owned() })
    }

    /// Fills `to` from the firmware's static variable `symbol`.
    ///
    /// # Errors
    ///
    /// Returns [`Error::NoSymbol`] where the image has no such symbol, and [`Error::NotMemory`] where a byte is not
    /// memory.
    pub fn read_symbol(&self, symbol: &str, to: &mut [u8]) -> Result<(), Error> {
        self.read(self.address_of(symbol)?, to)
    }

    /// Returns a digest of everything that the firmware could observe: registers, RAM, time, instructions.
    #[must_use]
    pub fn digest(&self) -> u64 {
        let mut digest = Digest::new();
        let named = [Register::Xpsr, Register::Msp, Register::Psp, Register::Control, Register::Faultmask];
        let more = [Register::Basepri, Register::Primask, Register::Fpscr];
        let all = (0..16).map(Register::R).chain((0..32).map(Register::S)).chain(named).chain(more);
        for register in all {
            digest.word(u64::from(self.core.register(register)));
        }
        digest.word(self.core.cycle());
        digest.word(self.now());
        digest.word(self.instructions());
        for (start, size) in B::Part::RAM {
            digest.bytes(self.side.part.memory(*start, *size).unwrap_or_default());
        }
        digest.finish()
    }
}
