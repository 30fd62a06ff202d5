//! What can differ between two boards that carry the chip.

/// Which of the two parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// ST25R3916, identity 0x2A.
    St25r3916,
    /// ST25R3916B, identity 0x31.
    St25r3916b,
}

/// A chip and what surrounds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The part.
    pub variant: Variant,
    /// Whether DB (clear FIFO) clears the interrupt registers too.
    pub db_clears_irqs: bool,
    /// Whether C4/C5 raise I_txe when the receiver is off (rx_en = 0).
    pub txe_with_rx_off: bool,
    /// Supply voltage, mV.
    pub vdd_mv: u16,
    /// Time from `en` to a stable oscillator, ns.
    pub oscillator_startup_ns: u64,
    /// Error of the 27.12 MHz crystal, parts per billion, positive is fast.
    pub crystal_ppb: i64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            variant: Variant::St25r3916b,
            db_clears_irqs: true,
            txe_with_rx_off: true,
            vdd_mv: 3300,
            oscillator_startup_ns: 700_000,
            crystal_ppb: 0,
        }
    }
}
