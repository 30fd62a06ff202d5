//! Pins as the part numbers them.
use emulator_part as part;

/// A pin: P0.00 to P0.31 are 0 to 31, P1.00 to P1.15 are 32 to 47, as PSEL numbers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Pin(u8);

impl Pin {
    /// The pin that a PSEL register selects; `None` if it is disconnected or does not exist.
    #[inline]
    pub(crate) fn selected(psel: u32) -> Option<Self> {
        let pin = (psel & 0x3F) as u8;
        (psel & 1 << 31 == 0 && pin < 48).then_some(Self(pin))
    }

    /// Returns the part's pin for a pin of the bench; `None` if the part does not have such a pin.
    pub(crate) fn outside(pin: part::Pin) -> Option<Self> {
        let exists = matches!((pin.port, pin.number), (0, 0..=31) | (1, 0..=15));
        exists.then_some(Self(pin.port << 5 | pin.number))
    }

    #[inline]
    pub(crate) const fn named(self) -> part::Pin {
        part::Pin::new(self.0 >> 5, self.0 & 31)
    }

    /// The port (0 or 1) and the pin's number in the port.
    #[inline]
    pub(crate) const fn place(self) -> (usize, u32) {
        ((self.0 >> 5) as usize, self.0 as u32 & 31)
    }

    #[inline]
    pub(crate) const fn index(self) -> usize {
        self.0 as usize
    }

    #[inline]
    pub(crate) const fn of(port: usize, n: u32) -> Self {
        Self((port as u8) << 5 | n as u8)
    }
}
