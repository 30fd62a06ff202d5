//! An assembler of the few Thumb encodings that the guest's own code needs (ARM ARM A7.7).

#[derive(Clone, Debug)]
pub(crate) struct Code {
    pub(crate) base: u32,
    pub(crate) halves: Vec<u16>,
}

impl Code {
    #[must_use]
    pub(crate) fn at(base: u32) -> Self {
        Self { base, halves: Vec::new() }
    }

    #[must_use]
    pub(crate) fn here(&self) -> u32 {
        self.base + 2 * self.halves.len() as u32
    }

    pub(crate) fn narrow(&mut self, bits: u32) -> &mut Self {
        self.halves.push(bits as u16);
        self
    }

    /// Appends a 32-bit instruction, whose first halfword is in the upper bits of `bits`.
    pub(crate) fn wide(&mut self, bits: u32) -> &mut Self {
        self.halves.extend([(bits >> 16) as u16, bits as u16]);
        self
    }

    /// Appends MOVW and MOVT.
    pub(crate) fn constant(&mut self, register: u32, value: u32) -> &mut Self {
        for (op, half) in [(0xF240_0000, value & 0xFFFF), (0xF2C0_0000, value >> 16)] {
            let (i, imm4) = ((half >> 11) & 1, half >> 12);
            self.wide(op | i << 26 | imm4 << 16 | ((half >> 8) & 7) << 12 | register << 8 | half & 0xFF);
        }
        self
    }

    /// Appends LDR.W `register`, [`base`, #`offset`].
    pub(crate) fn load(&mut self, register: u32, base: u32, offset: u32) -> &mut Self {
        self.wide(0xF8D0_0000 | base << 16 | register << 12 | offset)
    }

    /// Appends STR.W `register`, [`base`, #`offset`].
    pub(crate) fn store(&mut self, register: u32, base: u32, offset: u32) -> &mut Self {
        self.wide(0xF8C0_0000 | base << 16 | register << 12 | offset)
    }

    /// Appends B.W to an address up to 16 MiB away.
    pub(crate) fn branch(&mut self, target: u32) -> &mut Self {
        let offset = target.wrapping_sub(self.here() + 4);
        self.wide(branch_wide(offset) | 0x9000)
    }

    /// Appends a semihosting call.
    pub(crate) fn host_call(&mut self) -> &mut Self {
        self.narrow(0xBEAB)
    }
}

/// The offset bits of B.W (encoding T4) and BL.
#[must_use]
pub(crate) fn branch_wide(offset: u32) -> u32 {
    let sign = (offset >> 24) & 1;
    let j1 = (!((offset >> 23) & 1 ^ sign)) & 1;
    let j2 = (!((offset >> 22) & 1 ^ sign)) & 1;
    0xF000_0000 | sign << 26 | ((offset >> 12) & 0x3FF) << 16 | j1 << 13 | j2 << 11 | (offset >> 1) & 0x7FF
}
