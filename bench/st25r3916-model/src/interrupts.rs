//! Interrupts: the pending bits, and the IRQ pin with the exact instants of its changes.
//!
//! A read of an interrupt register clears it and lets the pin fall. Both happen at the first rising clock edge of the
//! byte with its value. Four recordings of silicon (public repository hydrabus/st25r3916_decoder_dumps_sigrok, 2 ns
//! resolution, 10.5 MHz clock) have 38 such reads. In each of them the pin falls 30 to 32 ns after that edge, and 682
//! to 684 ns before the byte's last edge.
//!
//! The model receives a byte only at the byte's end, so it reports a fall of the pin afterwards.
//! [`Chip::take_irq_edges`](crate::Chip::take_irq_edges) gives every change with its exact instant, and
//! [`Chip::irq_since`](crate::Chip::irq_since) the instant of the last one.
//!
//! | left out | why |
//! |---|---|
//! | [`Chip::irq`](crate::Chip::irq) within such a byte: high until the byte's end | the byte is not known |
//! | the pin's rise time, and its delay after an internal event | below 50 ns; part of each event's measured latency |

use std::collections::VecDeque;

/// The interrupt bits as one word: register 1A is the lowest byte, 1D the highest.
pub(crate) mod irq {
    pub(crate) const OSC: u32 = 0x80;
    pub(crate) const WL: u32 = 0x40;
    pub(crate) const RXS: u32 = 0x20;
    pub(crate) const RXE: u32 = 0x10;
    pub(crate) const TXE: u32 = 0x08;
    pub(crate) const DCT: u32 = 0x80 << 8;
    pub(crate) const NRE: u32 = 0x40 << 8;
    pub(crate) const GPE: u32 = 0x20 << 8;
    pub(crate) const EON: u32 = 0x10 << 8;
    pub(crate) const EOF: u32 = 0x08 << 8;
    pub(crate) const CAC: u32 = 0x04 << 8;
    pub(crate) const CAT: u32 = 0x02 << 8;
    pub(crate) const NFCT: u32 = 0x01 << 8;
    pub(crate) const CRC: u32 = 0x80 << 16;
    pub(crate) const PAR: u32 = 0x40 << 16;
    pub(crate) const ERR1: u32 = 0x10 << 16;
    pub(crate) const WT: u32 = 0x08 << 16;
    pub(crate) const APON: u32 = 0x20 << 24;
    pub(crate) const RXE_PTA: u32 = 0x10 << 24;
    pub(crate) const WU_F: u32 = 0x08 << 24;
}

/// The interrupts that a fault of the chip prevents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Withheld {
    /// No interrupt is prevented; the chip is sound.
    #[default]
    None,
    /// The interrupts at the end of a received (I_rxe) or sent (I_txe) frame are prevented.
    FrameEnds,
    /// All interrupts are prevented.
    All,
}

impl Withheld {
    pub(crate) const fn bits(self) -> u32 {
        match self {
            Self::None => 0,
            Self::FrameEnds => irq::RXE | irq::TXE,
            Self::All => u32::MAX,
        }
    }
}

/// The largest number of IRQ changes that are kept; older ones are dropped.
const KEPT: usize = 64;

/// A change of the IRQ pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IrqEdge {
    /// The instant of the change, virtual ns. It may be before the call that caused the change by up to one SPI byte.
    pub at_ns: u64,
    /// The level after the change. High (`true`) means that an unmasked interrupt is pending.
    pub level: bool,
}

/// The pending interrupt bits and the IRQ pin. In its functions, `enabled` has the bits that may drive the pin.
#[derive(Clone, Debug)]
pub(crate) struct Interrupts {
    pending: u32,
    level: bool,
    since: u64,
    raised: [u64; 32],
    edges: VecDeque<IrqEdge>,
    told: Option<bool>,
}

impl Interrupts {
    pub(crate) fn new() -> Self {
        let edges = VecDeque::with_capacity(KEPT);
        Self { pending: 0, level: false, since: 0, raised: [0; 32], edges, told: None }
    }

    pub(crate) fn pending(&self) -> u32 {
        self.pending
    }

    pub(crate) fn raise(&mut self, bits: u32, enabled: u32, at: u64) {
        let mut left = bits & !self.pending;
        while left != 0 {
            self.raised[left.trailing_zeros() as usize] = at;
            left &= left - 1;
        }
        self.pending |= bits;
        self.follows(enabled, at);
    }

    /// Clears all interrupt bits. The caller must update the IRQ pin.
    pub(crate) fn clear(&mut self) {
        self.pending = 0;
    }

    pub(crate) fn flip(&mut self, bits: u32, enabled: u32, at: u64) {
        let cleared = bits & self.pending;
        self.pending &= !cleared;
        self.raise(bits & !cleared, enabled, at);
    }

    pub(crate) fn follows(&mut self, enabled: u32, at: u64) {
        self.becomes(self.pending & enabled != 0, at);
    }

    /// Clears `bits`, which the controller read at `at`. The instant may be slightly in the past.
    pub(crate) fn were_read(&mut self, bits: u32, enabled: u32, at: u64) {
        self.pending &= !bits;
        let left = self.pending & enabled;
        let next = (0..32usize).filter(|i| left >> i & 1 != 0).map(|i| self.raised[i]).min();
        match next {
            None => self.becomes(false, at),
            Some(raised) if raised > at => {
                self.becomes(false, at);
                self.becomes(true, raised);
            }
            Some(_) => {}
        }
    }

    fn becomes(&mut self, level: bool, at: u64) {
        if level == self.level {
            return;
        }
        let at_ns = at.max(self.since);
        self.level = level;
        self.since = at_ns;
        if self.edges.len() == KEPT {
            self.edges.pop_front();
        }
        self.edges.push_back(IrqEdge { at_ns, level });
    }

    pub(crate) fn since(&self) -> u64 {
        self.since
    }

    pub(crate) fn take_edges(&mut self) -> impl Iterator<Item = IrqEdge> + '_ {
        self.edges.drain(..)
    }

    pub(crate) fn has_edges(&self) -> bool {
        !self.edges.is_empty()
    }

    /// Returns the level of the IRQ pin if it differs from the one that the last call returned.
    pub(crate) fn take_change(&mut self) -> Option<bool> {
        let level = self.level;
        (self.told.replace(level) != Some(level)).then_some(level)
    }
}
