//! RNG: random bytes from a seed (PS 6.21).
//!
//! | covered | PS |
//! |---|---|
//! | START, STOP, VALRDY, VALUE, VALRDY_STOP, DERCEN | 6.21 |
//! | 128 µs to start; 30 µs a byte, 120 µs with bias correction | 6.21 |
//!
//! Left out: true randomness. The bytes come from SplitMix64, so that a seed gives the same run. A reset does not
//! restart the sequence, since the part's noise would not repeat either.
use crate::clocks::{Clocks, cycles};
use crate::instance::{Block, Cx, Instance};

const STARTUP: u64 = cycles(128_000);
const RAW: u64 = cycles(30_000);
const CORRECTED: u64 = cycles(120_000);

#[derive(Clone, Debug)]
pub(crate) struct Rng {
    block: Block,
    state: u64,
    value: u8,
    corrected: bool,
    next: Option<u64>,
}

impl Rng {
    pub(crate) fn new(seed: u64) -> Self {
        Self { block: Block::default(), state: seed, value: 0, corrected: false, next: None }
    }

    /// Continues the random sequence that was under way before a reset.
    pub(crate) fn keep(&mut self, before: &Self) {
        self.state = before.state;
    }

    fn byte_time(&self) -> u64 {
        if self.corrected { CORRECTED } else { RAW }
    }

    fn draw(&mut self) -> u8 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ z >> 31) as u8
    }
}

impl Instance for Rng {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 => self.next = Some(self.next.unwrap_or(cx.now + STARTUP + self.byte_time())),
            0x004 => self.next = None,
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        match offset {
            0x504 => Some(u32::from(self.corrected)),
            0x508 => Some(u32::from(self.value)),
            _ => None,
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        match offset {
            0x504 => self.corrected = value & 1 != 0,
            0x508 => {}
            _ => return false,
        }
        true
    }

    fn next(&self) -> Option<u64> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        self.value = self.draw();
        self.next = (!self.block.short(0)).then_some(cx.now + self.byte_time());
        self.block.raise(0, cx);
    }
}
