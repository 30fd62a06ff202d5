//! What instructions and exceptions cost, in core cycles.
//!
//! The two bounds follow the table of the Cortex-M4 TRM, "Instruction set summary" (100166 3.3.1, table 3-1), its table
//! of DSP instructions (table 3-2) and its notes on load/store timings (3.3.3). P is the cost of refilling the
//! pipeline: "1 to 3 depending on the alignment and width of the target instruction, and whether the processor manages
//! to speculate the address early". N is the number of registers.
//!
//! | instruction | table | least | most |
//! |---|---|---|---|
//! | data processing, extend, bit field, saturate, CLZ, REV | 1 | 1 | 1 |
//! | MUL, all of the DSP table | 1 | 1 | 1 |
//! | MLA, MLS | 2 in the first revisions of the TRM, 1 in the later | 1 | 2 |
//! | long multiplications | 1 | 1 | 1 |
//! | SDIV, UDIV | 2 to 12, "early termination" | 2 | 12 |
//! | B, BL, BX, BLX, MOV PC, ADD PC | 1 + P | 2 | 4 |
//! | `B<cc>`, CBZ, CBNZ | 1 or 1 + P | 1, taken 2 | 1, taken 4 |
//! | TBB, TBH | 2 + P | 3 | 5 |
//! | loads of one register | 2; 1 where it is pipelined with a neighbour (3.3.3) | 1 | 2 |
//! | loads of PC | 2 + P | 2 + 1 | 2 + 3 |
//! | stores of one register | 2; "STR is always one cycle" with an immediate offset (3.3.3) | 1 | 2 |
//! | LDRD, STRD | 1 + N, N = 2 | 3 | 3 |
//! | LDM, STM, PUSH, POP | 1 + N | 1 + N | 1 + N |
//! | LDM, POP with PC | 1 + N + P | 2 + N | 4 + N |
//! | LDREX, STREX and their byte and half forms | 2 | 2 | 2 |
//! | CLREX, SEV, NOP | 1 | 1 | 1 |
//! | WFI, WFE | 1 + W, the sleep | 1 | 1 |
//! | IT | 1; 0 where it is folded into a 16-bit instruction before it | 0 | 1 |
//! | an instruction that is skipped in an IT block | not in the table: it passes the pipeline | 1 | 1 |
//! | CPS, MRS, MSR | 1 or 2 | 1 | 2 |
//! | ISB, DSB, DMB | 1 + B; B is not stated: taken as 0 to 3, a refill, after the stores have been waited for | 1 | 4 |
//! | SVC, BKPT | not stated: the cost of the exception, and | 1 | 1 |
//! | floating point | TRM table 7-1 | [`crate::fp`] | [`crate::fp`] |
//!
//! Left out: on silicon an interrupt may abandon a division. Here the division completes first, which takes up to 12
//! cycles. The bounds hold for each instruction by itself; no silicon takes the most cycles for all instructions.

use std::fmt::Debug;

use crate::Bound;
use crate::fp;
use crate::op::Do;

/// A clock of the core: the cycles that each instruction and exception costs. It is a type parameter of the core, so
/// that the fast clock computes only what it needs.
pub trait Cost: Copy + Clone + Debug + Default + Send + Sync + 'static {
    /// The clock's name, as it is given on a command line.
    const NAME: &'static str;

    /// The bound by which the bus's wait states are counted; `None` if this clock counts no wait states.
    const BOUND: Option<Bound>;

    /// P of the TRM's table: the cycles that refilling the pipeline adds to a taken branch.
    const REFILL: u64;

    /// The cycles of an exception entry with a basic frame: 12 from the request to the handler's first instruction,
    /// without wait states (TRM 3.9.1).
    const EXCEPTION_ENTRY: u64;
    /// The cycles of an exception return with a basic frame: 10 where the instruction returned to is fetched in
    /// parallel (TRM 3.9.1). The worst case is taken to be that of an entry.
    const EXCEPTION_RETURN: u64;
    /// The cycles from one handler to the next without unstacking and stacking: 6 (TRM 3.9.1).
    const TAIL_CHAIN: u64;
    /// The extra cycles of an entry in whose middle an exception of higher priority arrives, since the core fetches
    /// another vector. The TRM has no figure. At best the stacking hides the fetch; at worst the fetch takes the time
    /// of a tail-chain.
    const LATE_ARRIVAL: u64;
    /// The extra cycles of stacking s0 to s15 and FPSCR in an entry, without lazy preservation. The entry then takes 29
    /// cycles in place of 12 (TRM 3.9.1).
    const FP_STACKING: u64;
    /// The extra cycles of unstacking s0 to s15 and FPSCR. The return then takes 27 cycles in place of 10 (TRM 3.9.1).
    const FP_UNSTACKING: u64;
    /// The cycles of stacking s0 to s15 and FPSCR when the handler's first FP instruction triggers lazy preservation.
    /// They are taken to be 17, as in an entry.
    const LAZY_STACKING: u64;
}

/// The clock that is fastest to emulate. It counts one cycle for each halfword of code and nothing for taken branches,
/// exceptions and wait states. Compiled code then takes about 1.4 cycles per instruction, which is between the other
/// two clocks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fast;

/// The least cycles of the TRM's tables: every branch is predicted, every load is pipelined, and there are no wait
/// states.
#[derive(Clone, Copy, Debug, Default)]
pub struct Optimistic;

/// The most cycles of the TRM's tables, with every wait state and every contention of the bus.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pessimistic;

impl Cost for Fast {
    const NAME: &'static str = "fast";
    const BOUND: Option<Bound> = None;
    const REFILL: u64 = 0;
    const EXCEPTION_ENTRY: u64 = 0;
    const EXCEPTION_RETURN: u64 = 0;
    const TAIL_CHAIN: u64 = 0;
    const LATE_ARRIVAL: u64 = 0;
    const FP_STACKING: u64 = 0;
    const FP_UNSTACKING: u64 = 0;
    const LAZY_STACKING: u64 = 0;
}

impl Cost for Optimistic {
    const NAME: &'static str = "optimistic";
    const BOUND: Option<Bound> = Some(Bound::Best);
    const REFILL: u64 = 1;
    const EXCEPTION_ENTRY: u64 = 12;
    const EXCEPTION_RETURN: u64 = 10;
    const TAIL_CHAIN: u64 = 6;
    const LATE_ARRIVAL: u64 = 0;
    const FP_STACKING: u64 = 17;
    const FP_UNSTACKING: u64 = 17;
    const LAZY_STACKING: u64 = 17;
}

impl Cost for Pessimistic {
    const NAME: &'static str = "pessimistic";
    const BOUND: Option<Bound> = Some(Bound::Worst);
    const REFILL: u64 = 3;
    const EXCEPTION_ENTRY: u64 = 12;
    const EXCEPTION_RETURN: u64 = 12;
    const TAIL_CHAIN: u64 = 6;
    const LATE_ARRIVAL: u64 = 6;
    const FP_STACKING: u64 = 17;
    const FP_UNSTACKING: u64 = 17;
    const LAZY_STACKING: u64 = 17;
}

/// The least and the most cycles of an instruction, without wait states and without [`Cost::REFILL`].
pub(crate) fn cycles(what: Do) -> (u8, u8) {
    match what {
        Do::Mla { .. } | Do::Mls { .. } => (1, 2),
        Do::Sdiv { .. } | Do::Udiv { .. } => (2, 12),
        Do::TableBranch { .. } => (2, 2),
        Do::LdrLiteral { t: 15, .. }
        | Do::LoadLiteral { t: 15, .. }
        | Do::Load { t: 15, .. }
        | Do::LoadReg { t: 15, .. } => (2, 2),
        Do::LdrImm { .. }
        | Do::LdrbImm { .. }
        | Do::LdrhImm { .. }
        | Do::StrImm { .. }
        | Do::StrbImm { .. }
        | Do::StrhImm { .. }
        | Do::LdrReg { .. }
        | Do::LdrbReg { .. }
        | Do::StrReg { .. }
        | Do::StrbReg { .. }
        | Do::LdrLiteral { .. }
        | Do::LoadLiteral { .. }
        | Do::Load { .. }
        | Do::LoadReg { .. }
        | Do::Store { .. }
        | Do::StoreReg { .. } => (1, 2),
        Do::Ldrd { .. } | Do::Strd { .. } => (3, 3),
        Do::Ldrex { .. } | Do::Strex { .. } => (2, 2),
        Do::Ldm { list, .. } | Do::Stm { list, .. } => {
            let count = list.count_ones() as u8;
            (1 + count, 1 + count)
        }
        Do::It { .. } => (0, 1),
        Do::Cps { .. } | Do::Mrs { .. } | Do::Msr { .. } => (1, 2),
        Do::Barrier => (1, 4),
        Do::Fp(op) => fp::cycles(op),
        _ => (1, 1),
    }
}
