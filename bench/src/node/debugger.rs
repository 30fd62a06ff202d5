//! What a debugger sees and changes of a node.

use bench_seam::Part;
use cortex_m4::{Cost, Register};

use super::{Board, Digest, Error, Firmware, Node, memory};

impl<B: Board, C: Cost> Node<B, C> {
    /// The image this node runs.
    #[must_use]
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// Core register `number`: 0 to 15, then xPSR at 16.
    #[must_use]
    pub fn register(&self, number: usize) -> u32 {
        match u8::try_from(number) {
            Ok(number @ 0..=15) => self.core.register(Register::R(number)),
            _ => self.core.register(Register::Xpsr),
        }
    }

    /// Gives core register `number`, 0 to 15, another value, between two instructions.
    pub fn set_register(&mut self, number: usize, value: u32) {
        if let Ok(number @ 0..=15) = u8::try_from(number) {
            self.core.set_register(Register::R(number), value);
        }
    }

    /// The word at `address` as a debugger reads it: memory, or the processor's own registers.
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

    /// Fills `to` from memory at `address`.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`].
    pub fn read(&self, address: u64, to: &mut [u8]) -> Result<(), Error> {
        let length = to.len();
        memory::read(&self.side.part, address, to).then_some(()).ok_or(Error::NotMemory { address, length })
    }

    /// Writes `from` to memory at `address`, flash included, as a debugger does.
    ///
    /// # Errors
    ///
    /// [`Error::NotMemory`].
    pub fn write(&mut self, address: u64, from: &[u8]) -> Result<(), Error> {
        let written = memory::write(&mut self.side.part, address, from);
        let signals = self.side.part.signals();
        signals.code_changed = true;
        signals.changed = true;
        written.then_some(()).ok_or(Error::NotMemory { address, length: from.len() })
    }

    /// Where the firmware's `symbol` is.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`].
    pub fn address_of(&self, symbol: &str) -> Result<u64, Error> {
        self.firmware
            .symbol(symbol)
            .map(|symbol| symbol.address)
            .ok_or_else(|| Error::NoSymbol { firmware: self.firmware.name().to_owned(), symbol: symbol.to_owned() })
    }

    /// Fills `to` from the firmware's static `symbol`.
    ///
    /// # Errors
    ///
    /// [`Error::NoSymbol`] and [`Error::NotMemory`].
    pub fn read_symbol(&self, symbol: &str, to: &mut [u8]) -> Result<(), Error> {
        self.read(self.address_of(symbol)?, to)
    }

    /// A number that differs when anything the firmware could see differs: registers, RAM, time, instructions.
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
