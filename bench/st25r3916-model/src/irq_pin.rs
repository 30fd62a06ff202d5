//! The IRQ pin: its level, and the exact instants at which it changed.
//!
//! The bus is modelled byte by byte, the pin is not: reading an interrupt register clears it at the first rising clock
//! edge of the byte that carries its value, and the pin falls there, not at the byte's end. Four recordings of silicon
//! (public repository hydrabus/st25r3916_decoder_dumps_sigrok, 2 ns resolution, 10.5 MHz clock) show the fall 30 to 32
//! ns after that edge and 682 to 684 ns before the byte's last one, in 38 of 38 reads.
//!
//! A byte is handed over at its end, so the chip tells of a fall when it has already happened: [`Chip::take_irq_edges`]
//! gives every change with its own instant, [`Chip::irq_since`] the last one. Which edge of the clock was the first
//! follows from the clock's rate ([`Chip::spi_clock_hz`]): eight periods before the byte's end (SPI mode 1; the last
//! edge is half a period before the end). If the rate is not told, 10 MHz is taken, the part's highest: the pin has
//! then fallen by the instant given, perhaps earlier.
//!
//! | left out | why |
//! |---|---|
//! | [`Chip::irq`] between the first rising edge of such a byte and its end: still | the byte is not known until it |
//! | high | ends |
//! | the pin's rise time, and its delay after an internal event | below 50 ns; part of each event's measured latency |

use std::collections::VecDeque;

use crate::Chip;

/// Changes of the pin that are kept until somebody takes them; older ones are dropped.
const KEPT: usize = 64;
/// Periods of the SPI clock from a byte's first rising edge to its end.
const PERIODS: u64 = 8;
/// The part's highest SPI clock, Hz: assumed where the controller's rate was not told.
const DEFAULT_HZ: u32 = 10_000_000;

/// A change of the IRQ pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IrqEdge {
    /// When, virtual ns. Not before the edge before it, and at most the length of one SPI byte before the call that
    /// caused it.
    pub at_ns: u64,
    /// The level from then on: true is high, an unmasked interrupt is pending.
    pub level: bool,
}

/// The pin and its recent past.
#[derive(Clone, Debug)]
pub(crate) struct IrqPin {
    level: bool,
    since: u64,
    /// When each interrupt bit was last set, ns.
    raised: [u64; 32],
    edges: VecDeque<IrqEdge>,
}

impl IrqPin {
    pub(crate) fn new() -> Self {
        Self { level: false, since: 0, raised: [0; 32], edges: VecDeque::with_capacity(KEPT) }
    }

    /// These bits are newly set at `at`.
    pub(crate) fn raised(&mut self, bits: u32, at: u64) {
        let mut left = bits;
        while left != 0 {
            self.raised[left.trailing_zeros() as usize] = at;
            left &= left - 1;
        }
    }

    /// The pin has this level from `at` on.
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
}

impl Chip {
    /// Level of the IRQ pin at the time last advanced to: high while an unmasked interrupt bit is set.
    pub fn irq(&self) -> bool {
        self.powered && self.pending & !self.mask() != 0
    }

    /// Since when the IRQ pin has had its level, virtual ns. After a read that cleared it, this lies inside the byte
    /// read.
    pub fn irq_since(&self) -> u64 {
        self.pin.since
    }

    /// Every change of the IRQ pin since the last call, in order, each with its exact instant; the last 64 of them. A
    /// pulse shorter than a byte is in it (the pin falls by a read and rises by the next event before the byte ends),
    /// which two looks at [`Chip::irq`] would not show.
    pub fn take_irq_edges(&mut self) -> impl Iterator<Item = IrqEdge> + '_ {
        self.pin.edges.drain(..)
    }

    /// Whether the pin changed since [`Chip::take_irq_edges`] was last called.
    #[must_use]
    pub fn has_irq_edges(&self) -> bool {
        !self.pin.edges.is_empty()
    }

    /// Something that moves the pin has happened now.
    pub(crate) fn irq_changes(&mut self) {
        let level = self.irq();
        self.pin.becomes(level, self.now);
    }

    /// Interrupt bits that a byte ending now has carried away: they were cleared at its first rising clock edge.
    pub(crate) fn irqs_were_read(&mut self, bits: u32) {
        let at = self.first_rising_edge();
        self.pending &= !bits;
        let left = if self.powered { self.pending & !self.mask() } else { 0 };
        let next = (0..32usize).filter(|i| left >> i & 1 != 0).map(|i| self.pin.raised[i]).min();
        match next {
            None => self.pin.becomes(false, at),
            Some(raised) if raised > at => {
                self.pin.becomes(false, at);
                self.pin.becomes(true, raised);
            }
            Some(_) => {}
        }
    }

    /// When the byte that ends now made the pin move, had its reading cleared it.
    fn first_rising_edge(&self) -> u64 {
        let hz = u64::from(if self.spi.hz == 0 { DEFAULT_HZ } else { self.spi.hz });
        let before_end = (PERIODS * 1_000_000_000 / hz).saturating_sub(self.config.irq_fall_ns);
        // A clock that was told wrongly cannot put the byte before the one it follows.
        self.now.saturating_sub(before_end).max(self.spi.last_byte).min(self.now)
    }
}
