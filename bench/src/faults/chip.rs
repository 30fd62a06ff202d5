//! Faults of a front-end chip, or of a line between it and its board.
//!
//! [`crate::boards::front_end::FrontEnd`] applies these faults. A fault leaves the chip's state as it is, and the rest
//! of the chip works.

use bench_judge::disturbance::Harm;
use st25r3916_model::{Chip, Space, Withheld};

use super::Rng;

/// A fault of either board's front end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipFault {
    /// The chip's interrupt line stays low, while its interrupt bits can be read.
    IrqLow,
    /// The chip's interrupt line stays high, even after the interrupt bits are read.
    IrqHigh,
    /// The chip's interrupt logic hangs, so no interrupt bit is set.
    NoInterrupts,
    /// The chip never reports the end of a frame: the listener sets I_rxs without I_rxe, the poller sets no I_txe.
    NoFrameEnds,
    /// Every bit that the board reads from the chip is 1.
    ReadsOnes,
    /// Every bit that the board reads from the chip is 0.
    ReadsZeros,
    /// A bit flips in one of [`GLITCH_EVERY`] bytes on average, on the way to the chip or from it. The number is the
    /// seed.
    Glitches(u64),
    /// Each transfer that begins with a certain byte reads another value in one of its bytes. Faults that are drawn are
    /// never this one.
    Misreads {
        /// The first byte of these transfers: a command.
        first: u8,
        /// The place of the byte in the transfer; the first byte has place 0.
        place: u8,
        /// The bits that are inverted.
        flips: u8,
    },
}

/// The average number of bytes on the SPI for each glitch. The boards exchange about 260 bytes with a front end in a
/// cycle, so about one cycle in four has one.
pub const GLITCH_EVERY: u64 = 1024;

impl ChipFault {
    /// All faults of a front end's chip except glitches and misread bytes of the SPI.
    pub const ALL: [Self; 6] =
        [Self::IrqLow, Self::IrqHigh, Self::NoInterrupts, Self::NoFrameEnds, Self::ReadsOnes, Self::ReadsZeros];

    /// Returns the fault's name in the event log. There the board and the words "front end" come before it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::IrqLow => "interrupt line low",
            Self::IrqHigh => "interrupt line high",
            Self::NoInterrupts => "without interrupts",
            Self::NoFrameEnds => "without frame ends",
            Self::ReadsOnes => "reads ones",
            Self::ReadsZeros => "reads zeros",
            Self::Glitches(_) => "SPI glitches",
            Self::Misreads { .. } => "misreads",
        }
    }

    /// The effect that the board can observe. A line that stays low, or a missing interrupt, looks like an idle chip.
    #[must_use]
    pub const fn harm(self) -> Harm {
        match self {
            Self::IrqHigh | Self::ReadsOnes | Self::ReadsZeros => Harm::Silent,
            Self::IrqLow | Self::NoInterrupts | Self::NoFrameEnds => Harm::Deaf,
            Self::Glitches(_) => Harm::Noisy,
            Self::Misreads { .. } => Harm::Silent,
        }
    }
}

/// The time, ns, within which the board must report a flipped bit of a register, if the flip has an effect.
pub const FLIP_MENDED: u64 = 1_350_000_000;

/// A bit of a register of a front end's chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RegisterBit {
    /// Whether the register is in register space B of the chip.
    pub in_space_b: bool,
    /// The register's address.
    pub address: u8,
    /// The bit's number, 0 to 7.
    pub bit: u8,
}

impl RegisterBit {
    /// Every bit that `chip` stores in register spaces A and B, in order of the addresses.
    #[must_use]
    pub fn all_of(chip: &Chip) -> Vec<Self> {
        let addresses = [false, true].into_iter().flat_map(|in_space_b| (0..64).map(move |it| (in_space_b, it)));
        let bits = addresses.flat_map(|(in_space_b, address)| {
            let there = chip.flippable(if in_space_b { Space::B } else { Space::A }, address);
            let bits = (0..8).filter(move |bit| there >> bit & 1 != 0);
            bits.map(move |bit| Self { in_space_b, address, bit })
        });
        bits.collect()
    }

    /// Flips this bit of `chip`.
    pub fn flip(self, chip: &mut Chip) {
        chip.flip(if self.in_space_b { Space::B } else { Space::A }, self.address, self.bit);
    }
}

/// The present faults of one front end.
#[derive(Clone, Debug, Default)]
pub struct ChipFaults {
    present: Vec<ChipFault>,
    glitches: Option<Rng>,
    /// The first byte of the present transfer to the chip, and the number of bytes so far.
    transfer: (u8, u8),
}

impl ChipFaults {
    /// Begins `fault`.
    pub fn begin(&mut self, fault: ChipFault) {
        self.present.push(fault);
        if let ChipFault::Glitches(seed) = fault {
            self.glitches = Some(Rng::new(seed));
        }
    }

    /// Ends `fault`.
    pub fn end(&mut self, fault: ChipFault) {
        if let Some(place) = self.present.iter().position(|other| *other == fault) {
            self.present.remove(place);
        }
        if let ChipFault::Glitches(_) = fault {
            self.glitches = None;
        }
    }

    fn last<T>(&self, of: impl Fn(ChipFault) -> Option<T>) -> Option<T> {
        self.present.iter().rev().find_map(|fault| of(*fault))
    }

    /// Returns the level of the chip's interrupt line with the present faults, in place of `level`.
    #[must_use]
    pub fn irq(&self, level: bool) -> bool {
        let stuck = self.last(|fault| match fault {
            ChipFault::IrqLow => Some(false),
            ChipFault::IrqHigh => Some(true),
            _ => None,
        });
        stuck.unwrap_or(level)
    }

    /// Begins a transfer: the chip is selected.
    pub fn select(&mut self) {
        self.transfer = (0, 0);
    }

    /// Takes the next byte of the transfer to the chip. Returns the bits that are inverted in the byte from it.
    pub fn misread(&mut self, to_chip: u8) -> u32 {
        let (begins, at) = self.transfer;
        let begins = if at == 0 { to_chip } else { begins };
        self.transfer = (begins, at.saturating_add(1));
        let flips = self.last(|fault| match fault {
            ChipFault::Misreads { first, place, flips } if (first, place) == (begins, at) => Some(flips),
            _ => None,
        });
        flips.unwrap_or(0).into()
    }

    /// Returns the bits that a glitch inverts in the next byte to the chip and in the byte from it.
    pub fn glitch(&mut self) -> [u32; 2] {
        let Some(rng) = self.glitches.as_mut() else { return [0, 0] };
        if !rng.one_in(GLITCH_EVERY) {
            return [0, 0];
        }
        let bit = 1 << rng.below(8);
        if rng.one_in(2) { [bit, 0] } else { [0, bit] }
    }

    /// The byte that the board reads while the chip drives `answer`; `None` if nothing drives the line.
    #[must_use]
    pub fn miso(&self, answer: Option<u32>) -> Option<u32> {
        let stuck = self.last(|fault| match fault {
            ChipFault::ReadsOnes => Some(u32::MAX),
            ChipFault::ReadsZeros => Some(0),
            _ => None,
        });
        stuck.or(answer)
    }

    /// Returns the interrupts that the present faults prevent.
    #[must_use]
    pub fn withheld(&self) -> Withheld {
        let withheld = |fault| match fault {
            ChipFault::NoInterrupts => Some(Withheld::All),
            ChipFault::NoFrameEnds => Some(Withheld::FrameEnds),
            _ => None,
        };
        self.last(withheld).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use st25r3916_model::Config;

    use super::*;

    #[test]
    fn the_bits_that_can_flip_are_those_that_a_chip_keeps() {
        for config in [Config::default(), Config::st25r3916()] {
            let mut chip = Chip::new(config);
            let bits = RegisterBit::all_of(&chip);
            assert!(bits.is_sorted() && (450..700).contains(&bits.len()), "{}", bits.len());
            for bit in bits {
                let space = if bit.in_space_b { Space::B } else { Space::A };
                let before = chip.peek(space, bit.address);
                bit.flip(&mut chip);
                assert_eq!(chip.peek(space, bit.address), before ^ 1 << bit.bit, "{bit:02x?}");
                bit.flip(&mut chip);
            }
        }
    }

    #[test]
    fn each_fault_breaks_what_its_name_says_and_nothing_else() {
        for fault in ChipFault::ALL {
            let mut faults = ChipFaults::default();
            faults.begin(fault);
            let irq = match fault {
                ChipFault::IrqLow => [false, false],
                ChipFault::IrqHigh => [true, true],
                _ => [false, true],
            };
            assert_eq!([faults.irq(false), faults.irq(true)], irq, "{fault:?}");
            let miso = match fault {
                ChipFault::ReadsOnes => [Some(u32::MAX); 2],
                ChipFault::ReadsZeros => [Some(0); 2],
                _ => [None, Some(0x5A)],
            };
            assert_eq!([faults.miso(None), faults.miso(Some(0x5A))], miso, "{fault:?}");
            let withheld = match fault {
                ChipFault::NoInterrupts => Withheld::All,
                ChipFault::NoFrameEnds => Withheld::FrameEnds,
                _ => Withheld::None,
            };
            assert_eq!(faults.withheld(), withheld, "{fault:?}");
            faults.end(fault);
            assert_eq!((faults.irq(true), faults.miso(None), faults.withheld()), (true, None, Withheld::None));
        }
    }

    #[test]
    fn a_misread_byte_is_one_of_its_transfer_alone() {
        let mut faults = ChipFaults::default();
        faults.begin(ChipFault::Misreads { first: 0x7F, place: 1, flips: 0x28 });
        let mut flips = |bytes: [u8; 3]| {
            faults.select();
            bytes.map(|byte| faults.misread(byte))
        };
        assert_eq!(flips([0x7F, 0, 0]), [0, 0x28, 0]);
        assert_eq!(flips([0x42, 0x7F, 0]), [0; 3]);
    }

    #[test]
    fn the_later_of_two_faults_on_one_line_prevails_until_it_ends() {
        let mut faults = ChipFaults::default();
        faults.begin(ChipFault::ReadsOnes);
        faults.begin(ChipFault::ReadsZeros);
        assert_eq!(faults.miso(Some(1)), Some(0));
        faults.end(ChipFault::ReadsZeros);
        assert_eq!(faults.miso(Some(1)), Some(u32::MAX));
    }
}
