//! The decoded form of an instruction.
//!
//! | field | what it holds |
//! |---|---|
//! | [`Op::what`] | the operation with its operands; addresses relative to the program counter are already absolute |
//! | [`Op::size`] | 2 or 4 bytes |
//! | [`Op::least`], [`Op::most`] | core cycles at the two bounds, see [`crate::cost`] |
//! | [`Op::block`] | how the instruction behaves in an IT block |
//!
//! An `Op` has sixteen bytes, so that four share a cache line of the host.

use crate::Fault;
use crate::fp::FpOp;

/// The behaviour of an instruction in an IT block (ARM ARM A7.3.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Block {
    /// The instruction behaves in an IT block as it does outside.
    Same,
    /// In an IT block the instruction leaves the flags as they are; outside a block it sets them. This holds for 16-bit
    /// data processing.
    KeepsFlags,
    /// The instruction may only be the last one of an IT block, as branches may.
    Last,
    /// The instruction is not allowed in an IT block and is undefined there.
    Never,
}

/// A decoded instruction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Op {
    pub(crate) what: Do,
    pub(crate) size: u8,
    pub(crate) least: u8,
    pub(crate) most: u8,
    pub(crate) block: Block,
}

const _: () = assert!(size_of::<Op>() <= 16);

impl Block {
    /// Whether the instruction is allowed in an IT block in which EPSR.IT is `it`.
    pub(crate) const fn allows(self, it: u8) -> bool {
        match self {
            Self::Same | Self::KeepsFlags => true,
            Self::Last => it & 0xF == 8,
            Self::Never => false,
        }
    }
}

impl Op {
    /// Whether this does not depend on the condition of an IT block. Breakpoints and semihosting calls are not
    /// instructions; BKPT and fetch faults come in any case.
    pub(crate) const fn is_unconditional(&self) -> bool {
        matches!(self.what, Do::Breakpoint | Do::HostCall | Do::Bkpt)
            || matches!(self.what, Do::Fault(Fault::BusInstruction | Fault::MemInstruction))
    }

    /// Whether an interrupt need not wait for the end of this load/store multiple (TRM 3.9.1). It must wait for one
    /// that loads PC, which may be an exception return.
    pub(crate) const fn is_multiple(&self) -> bool {
        match self.what {
            Do::Ldm { list, .. } => list >> 15 == 0,
            Do::Stm { .. } | Do::Fp(FpOp::Vldm { .. } | FpOp::Vstm { .. }) => true,
            _ => false,
        }
    }
}

/// Data-processing operations that take any operand of ARM ARM A5.3.1 and A5.3.11.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Alu {
    And,
    Bic,
    Orr,
    Orn,
    Eor,
    Add,
    Adc,
    Sbc,
    Sub,
    Rsb,
    Mov,
    Mvn,
    Tst,
    Teq,
    Cmn,
    Cmp,
}

/// Shifts by a constant or by a register (ARM ARM A7.4). LSR and ASR by the encoded amount 0 are decoded as shifts by
/// 32, and ROR by 0 as `Rrx`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shift {
    Lsl,
    Lsr,
    Asr,
    Ror,
    Rrx,
}

/// How a logical operation with a modified immediate changes the carry flag (ARM ARM A5.3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Carry {
    Same,
    Clear,
    Set,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Byte,
    Half,
    Word,
    SignedByte,
    SignedHalf,
}

/// How a load or store forms its address, and whether it writes the base register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Index {
    /// The access is at base plus offset. Nothing is written back.
    Offset,
    /// The access is at base plus offset, and this address is written back.
    Pre,
    /// The access is at the base. Base plus offset is written back afterwards.
    Post,
    /// The access is at base plus offset and unprivileged.
    Unprivileged,
}

/// The extensions, ARM ARM A7.7, SXTB and its family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extend {
    SignedByte,
    SignedHalf,
    SignedBytes,
    UnsignedByte,
    UnsignedHalf,
    UnsignedBytes,
}

/// How a parallel addition or subtraction pairs the lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lanes {
    Add16,
    Exchange16AddSub,
    Exchange16SubAdd,
    Sub16,
    Add8,
    Sub8,
}

/// How the result of a lane is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lane {
    Signed,
    SignedSaturating,
    SignedHalving,
    Unsigned,
    UnsignedSaturating,
    UnsignedHalving,
}

/// The saturating additions and subtractions: QADD and its family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Saturating {
    Add,
    DoubleAdd,
    Sub,
    DoubleSub,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unary {
    Rev,
    Rev16,
    Revsh,
    Rbit,
    Clz,
}

/// Long multiplications, ARM ARM A5.3.17.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Long {
    Smull,
    Umull,
    Smlal,
    Umlal,
    Umaal,
}

/// An operation. `d` is the destination, `n` and `m` are operands, `a` is an addend, and `t` is a register to load or
/// store.
// Each variant stays on one line, because rustfmt would give each field a line.
#[rustfmt::skip]
#[derive(Clone, Copy, Debug)]
pub(crate) enum Do {
    // Data processing with the operands that compilers use most.
    MovImm { d: u8, imm: u32 },
    MovsImm { d: u8, imm: u32 },
    MovReg { d: u8, m: u8 },
    AddImm { d: u8, n: u8, imm: u32 },
    AddsImm { d: u8, n: u8, imm: u32 },
    SubImm { d: u8, n: u8, imm: u32 },
    SubsImm { d: u8, n: u8, imm: u32 },
    CmpImm { n: u8, imm: u32 },
    AddReg { d: u8, n: u8, m: u8 },
    AddsReg { d: u8, n: u8, m: u8 },
    SubReg { d: u8, n: u8, m: u8 },
    SubsReg { d: u8, n: u8, m: u8 },
    CmpReg { n: u8, m: u8 },
    AndReg { d: u8, n: u8, m: u8 },
    AndsReg { d: u8, n: u8, m: u8 },
    OrrReg { d: u8, n: u8, m: u8 },
    OrrsReg { d: u8, n: u8, m: u8 },
    EorReg { d: u8, n: u8, m: u8 },
    EorsReg { d: u8, n: u8, m: u8 },
    AndImm { d: u8, n: u8, imm: u32 },
    AddLsl { d: u8, n: u8, m: u8, amount: u8 },
    LslImm { d: u8, m: u8, amount: u8 },
    LslsImm { d: u8, m: u8, amount: u8 },
    LsrImm { d: u8, m: u8, amount: u8 },
    LsrsImm { d: u8, m: u8, amount: u8 },
    // All other data processing.
    AluImm { alu: Alu, s: bool, d: u8, n: u8, carry: Carry, imm: u32 },
    AluShift { alu: Alu, s: bool, d: u8, n: u8, m: u8, shift: Shift, amount: u8 },
    ShiftReg { shift: Shift, s: bool, d: u8, n: u8, m: u8 },
    MovToPc { m: u8 },
    AddToPc { m: u8 },
    Movt { d: u8, imm: u16 },
    Bfi { d: u8, n: u8, lsb: u8, mask: u32 },
    Bfc { d: u8, mask: u32 },
    Sbfx { d: u8, n: u8, left: u8, right: u8 },
    Ubfx { d: u8, n: u8, lsb: u8, mask: u32 },
    Ssat { d: u8, n: u8, to: u8, shift: Shift, amount: u8 },
    Usat { d: u8, n: u8, to: u8, shift: Shift, amount: u8 },
    Ssat16 { d: u8, n: u8, to: u8 },
    Usat16 { d: u8, n: u8, to: u8 },
    Uxtb { d: u8, m: u8 },
    Uxth { d: u8, m: u8 },
    Extend { kind: Extend, d: u8, n: u8, m: u8, rotation: u8 },
    Pkhbt { d: u8, n: u8, m: u8, amount: u8 },
    Pkhtb { d: u8, n: u8, m: u8, amount: u8 },
    Unary { kind: Unary, d: u8, m: u8 },
    Sel { d: u8, n: u8, m: u8 },
    Parallel { lanes: Lanes, lane: Lane, d: u8, n: u8, m: u8 },
    Saturating { kind: Saturating, d: u8, n: u8, m: u8 },
    // Multiplication and division. An `a` of 15 adds nothing.
    Mul { d: u8, n: u8, m: u8 },
    Muls { d: u8, n: u8, m: u8 },
    Mla { d: u8, n: u8, m: u8, a: u8 },
    Mls { d: u8, n: u8, m: u8, a: u8 },
    SmlaHalf { d: u8, n: u8, m: u8, a: u8, n_top: bool, m_top: bool },
    SmlaWide { d: u8, n: u8, m: u8, a: u8, m_top: bool },
    SmlaDual { d: u8, n: u8, m: u8, a: u8, subtract: bool, exchange: bool },
    SmmlaTop { d: u8, n: u8, m: u8, a: u8, subtract: bool, round: bool },
    Usada8 { d: u8, n: u8, m: u8, a: u8 },
    LongMultiply { kind: Long, low: u8, high: u8, n: u8, m: u8 },
    SmlalHalf { low: u8, high: u8, n: u8, m: u8, n_top: bool, m_top: bool },
    SmlalDual { low: u8, high: u8, n: u8, m: u8, subtract: bool, exchange: bool },
    Sdiv { d: u8, n: u8, m: u8 },
    Udiv { d: u8, n: u8, m: u8 },
    // Loads and stores.
    LdrImm { t: u8, n: u8, imm: u32 },
    LdrbImm { t: u8, n: u8, imm: u32 },
    LdrhImm { t: u8, n: u8, imm: u32 },
    StrImm { t: u8, n: u8, imm: u32 },
    StrbImm { t: u8, n: u8, imm: u32 },
    StrhImm { t: u8, n: u8, imm: u32 },
    LdrReg { t: u8, n: u8, m: u8, amount: u8 },
    LdrbReg { t: u8, n: u8, m: u8, amount: u8 },
    StrReg { t: u8, n: u8, m: u8, amount: u8 },
    StrbReg { t: u8, n: u8, m: u8, amount: u8 },
    LdrLiteral { t: u8, address: u32 },
    LoadLiteral { format: Format, t: u8, address: u32 },
    Load { format: Format, index: Index, t: u8, n: u8, imm: u32 },
    LoadReg { format: Format, t: u8, n: u8, m: u8, amount: u8 },
    Store { format: Format, index: Index, t: u8, n: u8, imm: u32 },
    StoreReg { format: Format, t: u8, n: u8, m: u8, amount: u8 },
    /// A load of two words. If `n` is 15, this is the literal form, whose base is the instruction's address plus 4,
    /// word-aligned.
    Ldrd { index: Index, t: u8, t2: u8, n: u8, imm: u32 },
    Strd { index: Index, t: u8, t2: u8, n: u8, imm: u32 },
    Ldrex { format: Format, t: u8, n: u8, imm: u16 },
    Strex { format: Format, d: u8, t: u8, n: u8, imm: u16 },
    Clrex,
    /// A load multiple: LDMDB if `down`, else LDMIA.
    Ldm { n: u8, list: u16, write_back: bool, down: bool },
    Stm { n: u8, list: u16, write_back: bool, down: bool },
    // Branches.
    B { target: u32 },
    BEq { target: u32 },
    BNe { target: u32 },
    BCs { target: u32 },
    BCc { target: u32 },
    BHi { target: u32 },
    BLs { target: u32 },
    BGe { target: u32 },
    BLt { target: u32 },
    BGt { target: u32 },
    BLe { target: u32 },
    /// A branch on N or V alone.
    BCond { condition: u8, target: u32 },
    Bl { target: u32 },
    Bx { m: u8 },
    Blx { m: u8 },
    Cbz { n: u8, target: u32 },
    Cbnz { n: u8, target: u32 },
    TableBranch { n: u8, m: u8, half: bool },
    It { state: u8 },
    Nop,
    Barrier,
    Wfe,
    Wfi,
    Sev,
    Svc,
    Bkpt,
    Msr { n: u8, mask: u8, sysm: u8 },
    Mrs { d: u8, sysm: u8 },
    Cps { disable: bool, primask: bool, faultmask: bool },
    Fp(FpOp),
    /// The core takes this fault instead of executing the instruction.
    Fault(Fault),
    // Placeholders, which are not instructions.
    /// The instruction is not decoded yet.
    Unknown,
    /// The caller has a breakpoint at this address.
    Breakpoint,
    /// `BKPT 0xAB`, a semihosting call, see [`crate::Core::finish_host_call`].
    HostCall,
}
