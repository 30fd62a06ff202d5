//! The floating-point extension FPv4-SP.
//!
//! | What | ARM ARM (DDI 0403E) | Where |
//! |---|---|---|
//! | Encodings of coprocessors 10 and 11 | A6.4 to A6.7 | `decode` |
//! | Loads, stores and register transfers; FPSCR | A7.7 V*, A2.5.3 | `execute` |
//! | Arithmetic, comparison, conversion, rounding, NaNs, cumulative flags | A2.5 | `arith` |
//! | Instruction timings | TRM table 7-1 and the text below it | [`cycles`] |
//!
//! Left out, and how that shows:
//!
//! - Double-precision arithmetic and FPv5 do not exist in FPv4-SP: the instructions are undefined (UFSR.UNDEFINSTR).
//! - What the manual calls UNPREDICTABLE (a should-be-zero bit that is one, a register list past s31, a double register
//!   past d15, SP or PC as the core register of a transfer) is taken as undefined too: compilers emit none of it, and a
//!   fault is seen where a guessed result is not.
//! - A `VLDM` or `VSTM` is never abandoned or continued in its middle (ICI): on the pessimistic clock an interrupt
//!   waits for its end, as for that of lazy stacking. On the optimistic one neither delays it: see
//!   `Core::cut_short`.
//! - The stall between a floating-point result and the next instruction that reads it is not tracked instruction by
//!   instruction: it is the difference between the least and the most that [`cycles`] tells.
//! - The exception outputs of the FPU (FPIXC, FPIDC and the others), which a part may wire to an interrupt line, are
//!   not driven: that interrupt never becomes pending. The cumulative flags in FPSCR are exact.

mod arith;
mod decode;
mod execute;
#[cfg(test)]
mod tests;

pub(crate) use decode::decode;

/// The bits of FPSCR that FPv4-SP has: N, Z, C, V, AHP, DN, FZ, RMode, IDC and the five of IEEE 754 (A2.5.3). Whatever
/// writes FPSCR, a return from an exception too, keeps only these.
pub(crate) const FPSCR_BITS: u32 = 0xF7C0_009F;

/// A decoded instruction. `d`, `n` and `m` number single-precision registers, `t`, `t2` and `base` core registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FpOp {
    Vadd {
        d: u8,
        n: u8,
        m: u8,
    },
    Vsub {
        d: u8,
        n: u8,
        m: u8,
    },
    Vmul {
        d: u8,
        n: u8,
        m: u8,
    },
    Vnmul {
        d: u8,
        n: u8,
        m: u8,
    },
    Vmla {
        d: u8,
        n: u8,
        m: u8,
    },
    Vmls {
        d: u8,
        n: u8,
        m: u8,
    },
    Vnmla {
        d: u8,
        n: u8,
        m: u8,
    },
    Vnmls {
        d: u8,
        n: u8,
        m: u8,
    },
    Vfma {
        d: u8,
        n: u8,
        m: u8,
    },
    Vfms {
        d: u8,
        n: u8,
        m: u8,
    },
    Vfnma {
        d: u8,
        n: u8,
        m: u8,
    },
    Vfnms {
        d: u8,
        n: u8,
        m: u8,
    },
    Vdiv {
        d: u8,
        n: u8,
        m: u8,
    },
    Vsqrt {
        d: u8,
        m: u8,
    },
    Vabs {
        d: u8,
        m: u8,
    },
    Vneg {
        d: u8,
        m: u8,
    },
    Vmov {
        d: u8,
        m: u8,
    },
    /// `imm8` as encoded; A6.4.1 expands it.
    VmovImmediate {
        d: u8,
        imm8: u8,
    },
    /// `signals`: VCMPE, a quiet NaN is an invalid operation too.
    Vcmp {
        d: u8,
        m: u8,
        signals: bool,
    },
    VcmpZero {
        d: u8,
        signals: bool,
    },
    /// VCVT to an integer, or VCVTR where it does not round `toward_zero`.
    VcvtToInteger {
        d: u8,
        m: u8,
        unsigned: bool,
        toward_zero: bool,
    },
    VcvtFromInteger {
        d: u8,
        m: u8,
        unsigned: bool,
    },
    VcvtToFixed {
        d: u8,
        unsigned: bool,
        size: u8,
        fraction_bits: u8,
    },
    VcvtFromFixed {
        d: u8,
        unsigned: bool,
        size: u8,
        fraction_bits: u8,
    },
    /// VCVTB and VCVTT (`top`) from half precision.
    VcvtFromHalf {
        d: u8,
        m: u8,
        top: bool,
    },
    /// VCVTB and VCVTT (`top`) to half precision.
    VcvtToHalf {
        d: u8,
        m: u8,
        top: bool,
    },
    /// VLDR of one word, or of the two of a double register.
    Vldr {
        d: u8,
        words: u8,
        base: u8,
        add: bool,
        imm8: u8,
    },
    Vstr {
        d: u8,
        words: u8,
        base: u8,
        add: bool,
        imm8: u8,
    },
    /// VLDM, VPOP. `imm8` is the step of the base in words, one more than `words` for the deprecated FLDMX.
    Vldm {
        d: u8,
        words: u8,
        base: u8,
        add: bool,
        write_back: bool,
        imm8: u8,
    },
    /// VSTM, VPUSH; `imm8` as of `Vldm`.
    Vstm {
        d: u8,
        words: u8,
        base: u8,
        add: bool,
        write_back: bool,
        imm8: u8,
    },
    /// Core register to `s<n>`, also to one half of a double register.
    VmovFromCore {
        n: u8,
        t: u8,
    },
    VmovToCore {
        n: u8,
        t: u8,
    },
    /// Two core registers to `s<m>` and `s<m+1>`, also to a double register.
    VmovFromCorePair {
        m: u8,
        t: u8,
        t2: u8,
    },
    VmovToCorePair {
        m: u8,
        t: u8,
        t2: u8,
    },
    /// VMRS of FPSCR; `t` 15 is APSR_nzcv.
    Vmrs {
        t: u8,
    },
    Vmsr {
        t: u8,
    },
}

const _: () = assert!(size_of::<FpOp>() <= 8);

/// The cycles of an instruction, at least and at most, without wait states: TRM table 7-1.
///
/// The most includes the cycle that an arithmetic instruction or a conversion takes longer if the next instruction
/// reads its result. The least of VDIV and VSQRT is 1, since integer instructions that follow are carried out while the
/// division goes on; their figure in the table is 14.
pub(crate) fn cycles(op: FpOp) -> (u8, u8) {
    match op {
        FpOp::Vadd { .. }
        | FpOp::Vsub { .. }
        | FpOp::Vmul { .. }
        | FpOp::Vnmul { .. }
        | FpOp::VcvtToInteger { .. }
        | FpOp::VcvtFromInteger { .. }
        | FpOp::VcvtToFixed { .. }
        | FpOp::VcvtFromFixed { .. }
        | FpOp::VcvtFromHalf { .. }
        | FpOp::VcvtToHalf { .. } => (1, 2),
        FpOp::Vmla { .. }
        | FpOp::Vmls { .. }
        | FpOp::Vnmla { .. }
        | FpOp::Vnmls { .. }
        | FpOp::Vfma { .. }
        | FpOp::Vfms { .. }
        | FpOp::Vfnma { .. }
        | FpOp::Vfnms { .. } => (3, 4),
        FpOp::Vdiv { .. } | FpOp::Vsqrt { .. } => (1, 15),
        FpOp::Vabs { .. }
        | FpOp::Vneg { .. }
        | FpOp::Vmov { .. }
        | FpOp::VmovImmediate { .. }
        | FpOp::Vcmp { .. }
        | FpOp::VcmpZero { .. }
        | FpOp::VmovFromCore { .. }
        | FpOp::VmovToCore { .. }
        | FpOp::Vmrs { .. }
        | FpOp::Vmsr { .. } => (1, 1),
        FpOp::VmovFromCorePair { .. } | FpOp::VmovToCorePair { .. } => (2, 2),
        FpOp::Vldr { words, .. } | FpOp::Vstr { words, .. } | FpOp::Vldm { words, .. } | FpOp::Vstm { words, .. } => {
            (1 + words, 1 + words)
        }
    }
}
