//! The decoder, which makes an [`Op`] of one or two halfwords.
//!
//! | ARM ARM | where |
//! |---|---|
//! | A5.2, 16-bit instructions | `narrow` |
//! | A5.3, 32-bit instructions, without those below | `wide` |
//! | A5.3.5 to A5.3.10, A5.3.19: loads and stores | `transfer` |
//! | A5.3.18, coprocessors 10 and 11 | [`crate::fp`] |
//!
//! The decoder treats every UNPREDICTABLE case of the ARM ARM as undefined, so that it faults. Examples are a stack
//! pointer or program counter where the encoding does not allow one, write-back into a loaded register, and a branch in
//! an IT block before the block's last instruction. The one exception is CMP of two low registers in its form for high
//! ones, which LLVM emits. Coprocessors other than 10 and 11 take the fault for an absent coprocessor (UFSR.NOCP).

mod narrow;
mod transfer;
mod wide;

use crate::Fault;
use crate::cost;
use crate::op::{Block, Do, Op};

pub(crate) const fn is_wide(first: u16) -> bool {
    first >= 0xE800
}

pub(crate) fn narrow(address: u32, halfword: u16) -> Op {
    let what = narrow::decode(address, halfword);
    if matches!(what, Do::HostCall) {
        return place(what);
    }
    op(what, 2, narrow::block(halfword, what))
}

pub(crate) fn wide(address: u32, first: u16, second: u16) -> Op {
    let what = wide::decode(address, first, second);
    op(what, 4, block(what))
}

pub(crate) fn fault(fault: Fault) -> Op {
    op(Do::Fault(fault), 2, Block::Same)
}

/// Makes an [`Op`] for a breakpoint, a semihosting call or an instruction that is not decoded yet. It has size 0 and
/// cost 0, so that neither the program counter nor time moves.
pub(crate) const fn place(what: Do) -> Op {
    Op { what, size: 0, least: 0, most: 0, block: Block::Same }
}

fn op(what: Do, size: u8, block: Block) -> Op {
    let (least, most) = cost::cycles(what);
    Op { what, size, least, most, block }
}

/// How the operation `what` behaves in an IT block. 16-bit data processing is handled by `narrow::block`.
fn block(what: Do) -> Block {
    match what {
        Do::BEq { .. }
        | Do::BNe { .. }
        | Do::BCs { .. }
        | Do::BCc { .. }
        | Do::BHi { .. }
        | Do::BLs { .. }
        | Do::BGe { .. }
        | Do::BLt { .. }
        | Do::BGt { .. }
        | Do::BLe { .. }
        | Do::BCond { .. }
        | Do::Cbz { .. }
        | Do::Cbnz { .. }
        | Do::It { .. }
        | Do::Cps { .. } => Block::Never,
        Do::B { .. }
        | Do::Bl { .. }
        | Do::Bx { .. }
        | Do::Blx { .. }
        | Do::TableBranch { .. }
        | Do::MovToPc { .. }
        | Do::AddToPc { .. }
        | Do::LdrLiteral { t: 15, .. }
        | Do::Load { t: 15, .. }
        | Do::LoadReg { t: 15, .. }
        | Do::LoadLiteral { t: 15, .. } => Block::Last,
        Do::Ldm { list, .. } if list & 0x8000 != 0 => Block::Last,
        _ => Block::Same,
    }
}

/// A branch on a condition (ARM ARM A7.3), but not on the condition "always".
fn branch_if(condition: u8, target: u32) -> Do {
    match condition {
        0 => Do::BEq { target },
        1 => Do::BNe { target },
        2 => Do::BCs { target },
        3 => Do::BCc { target },
        8 => Do::BHi { target },
        9 => Do::BLs { target },
        10 => Do::BGe { target },
        11 => Do::BLt { target },
        12 => Do::BGt { target },
        13 => Do::BLe { target },
        _ => Do::BCond { condition, target },
    }
}

const UNDEFINED: Do = Do::Fault(Fault::Undefined);

/// Whether register `n` is the stack pointer or the program counter, which most 32-bit encodings do not allow.
const fn bad(n: u8) -> bool {
    n == 13 || n == 15
}

fn field(value: u16, low: u32, bits: u32) -> u8 {
    ((value >> low) & ((1 << bits) - 1)) as u8
}
