//! The 512-byte FIFO (DS13541, FIFO): one ring for both directions, with sticky underflow and overflow flags.

pub(crate) const CAPACITY: usize = 512;

#[derive(Clone, Debug)]
pub(crate) struct Fifo {
    ring: [u8; CAPACITY],
    head: usize,
    len: usize,
    /// The underflow flag, fifo_unf (register 1F, bit 5).
    pub(crate) underflow: bool,
    /// The overflow flag, fifo_ovr (register 1F, bit 4).
    pub(crate) overflow: bool,
    /// The number of bits in an incomplete last byte, or 0: fifo_lb (register 1F, bits 3:1).
    pub(crate) last_bits: u8,
}

impl Fifo {
    pub(crate) fn new() -> Self {
        Self { ring: [0; CAPACITY], head: 0, len: 0, underflow: false, overflow: false, last_bits: 0 }
    }

    pub(crate) fn clear(&mut self) {
        self.head = 0;
        self.len = 0;
        self.clear_flags();
    }

    pub(crate) fn clear_flags(&mut self) {
        self.underflow = false;
        self.overflow = false;
        self.last_bits = 0;
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    pub(crate) fn peek(&self, i: usize) -> Option<u8> {
        (i < self.len).then(|| self.ring[(self.head + i) % CAPACITY])
    }

    pub(crate) fn front(&self, n: usize) -> Vec<u8> {
        (0..n.min(self.len)).filter_map(|i| self.peek(i)).collect()
    }

    /// Appends a byte. Returns false and sets the overflow flag if the FIFO is full.
    pub(crate) fn push(&mut self, byte: u8) -> bool {
        if self.len == CAPACITY {
            self.overflow = true;
            return false;
        }
        self.ring[(self.head + self.len) % CAPACITY] = byte;
        self.len += 1;
        true
    }

    pub(crate) fn drop_front(&mut self, n: usize) {
        let n = n.min(self.len);
        self.head = (self.head + n) % CAPACITY;
        self.len -= n;
    }
}
