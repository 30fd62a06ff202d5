//! Classes of test cases, and how a case of each class is made.

use crate::{
    flow,
    image::{Case, WINDOW},
    integer, memory,
    random::Random,
    template::{Template, instance},
};

/// A class of cases, by the instructions that they exercise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// 16-bit instructions on registers.
    Narrow,
    /// 32-bit data processing with immediates.
    Immediate,
    /// 32-bit data processing with shifted registers.
    Shifted,
    /// Bit fields, extension, reversal, counting, and MSR and MRS of the flags.
    Fields,
    /// Saturation and parallel arithmetic.
    Parallel,
    /// Multiplication and division.
    Multiply,
    /// IT blocks.
    It,
    /// Branches.
    Branch,
    /// Loads and stores of one register.
    Single,
    /// Loads and stores of several registers.
    Multiple,
    /// Exclusive accesses.
    Exclusive,
    /// Bit-band accesses.
    BitBand,
    /// Instructions that fault, and SVC.
    Fault,
    /// FP arithmetic.
    FpArithmetic,
    /// FP comparison and conversion.
    FpConvert,
    /// FP moves.
    FpMove,
    /// FP loads and stores.
    FpMemory,
    /// Interrupts that make each other pending, with priorities, groups, masks, tail-chaining, lazy FP state and IT
    /// blocks.
    Interrupt,
}

impl Class {
    /// Every class.
    pub const ALL: [Self; 18] = [
        Self::Narrow,
        Self::Immediate,
        Self::Shifted,
        Self::Fields,
        Self::Parallel,
        Self::Multiply,
        Self::It,
        Self::Branch,
        Self::Single,
        Self::Multiple,
        Self::Exclusive,
        Self::BitBand,
        Self::Fault,
        Self::FpArithmetic,
        Self::FpConvert,
        Self::FpMove,
        Self::FpMemory,
        Self::Interrupt,
    ];

    /// The name of the class on a command line and in a recording.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Narrow => "narrow",
            Self::Immediate => "immediate",
            Self::Shifted => "shifted",
            Self::Fields => "fields",
            Self::Parallel => "parallel",
            Self::Multiply => "multiply",
            Self::It => "it",
            Self::Branch => "branch",
            Self::Single => "single",
            Self::Multiple => "multiple",
            Self::Exclusive => "exclusive",
            Self::BitBand => "bit-band",
            Self::Fault => "fault",
            Self::FpArithmetic => "fp-arithmetic",
            Self::FpConvert => "fp-convert",
            Self::FpMove => "fp-move",
            Self::FpMemory => "fp-memory",
            Self::Interrupt => "interrupt",
        }
    }

    /// The class with the given name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }

    /// Makes case `number` of this class, to be executed at `address`. The same seed gives the same case.
    #[must_use]
    pub fn case(self, seed: u64, number: u64, address: u32) -> Case {
        let mut random = Random::new(seed, (self as u64) << 40 | number);
        let random = &mut random;
        let mut case = Case { sp: WINDOW + 64, apsr: random.bits() & 0xF80F_0000, ccr: 0x200, ..Case::default() };
        for register in case.r.iter_mut().chain([&mut case.lr]) {
            *register = random.word();
        }
        for word in &mut case.window {
            *word = random.word();
        }
        let floating =
            matches!(self, Self::FpArithmetic | Self::FpConvert | Self::FpMove | Self::FpMemory | Self::Interrupt);
        if floating {
            for s in &mut case.s {
                *s = random.float();
            }
            // AHP, DN, FZ and the rounding mode are random. In some cases the flags are random too.
            case.fpscr = random.bits() & random.pick(&[0x00C0_0000, 0x07C0_0000, 0x03C0_0000, 0xF7C0_009F]);
            for register in case.r.iter_mut().take(6) {
                *register = random.float();
            }
        }
        match self {
            Self::Narrow => from(integer::NARROW, &mut case, random),
            Self::Immediate => from(integer::IMMEDIATE, &mut case, random),
            Self::Shifted => from(integer::SHIFTED, &mut case, random),
            Self::Fields => from(integer::FIELDS, &mut case, random),
            Self::Parallel => from(integer::PARALLEL, &mut case, random),
            Self::Multiply => from(integer::MULTIPLY, &mut case, random),
            Self::It => {
                flow::it_block(&mut case, random);
                if random.once_in(2) {
                    flow::it_block(&mut case, random);
                }
            }
            Self::Branch => flow::branch(&mut case, address, random),
            Self::Single => memory::append(&mut case, memory::Kind::Single, random),
            Self::Multiple => memory::append(&mut case, memory::Kind::Multiple, random),
            Self::Exclusive => memory::append(&mut case, memory::Kind::Exclusive, random),
            Self::BitBand => memory::append(&mut case, memory::Kind::BitBand, random),
            Self::Fault => flow::fault(&mut case, random),
            Self::FpArithmetic => from(integer::FP_ARITHMETIC, &mut case, random),
            Self::FpConvert => from(integer::FP_CONVERT, &mut case, random),
            Self::FpMove => from(integer::FP_MOVE, &mut case, random),
            Self::FpMemory => memory::append(&mut case, memory::Kind::Floating, random),
            Self::Interrupt => flow::interrupt(&mut case, random),
        }
        case
    }
}

/// Appends one to eight random instructions from `table`.
fn from(table: &[Template], case: &mut Case, random: &mut Random) {
    // The instructions use only a few registers, so that they often use each other's results.
    let mut registers: Vec<u32> = (0..13).chain([14]).collect();
    random.shuffle(&mut registers);
    registers.truncate(7);
    // Each template needs at least one low register and one high register.
    registers.extend([random.below(8), 8 + random.below(5)]);
    for _ in 0..1 + random.below(8) {
        instance(&random.pick(table), random, &registers).append(&mut case.code);
    }
}
