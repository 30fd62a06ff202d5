//! The floating-point extension FPv4-SP.
//!
//! | What | ARM ARM (DDI 0403E) | Where |
//! |---|---|---|
//! | Encodings of coprocessors 10 and 11 | A6.4 to A6.7 | `decode` |
//! | Loads, stores and register transfers; FPSCR | A7.7 V*, A2.5.3 | `execute` |
//! | Arithmetic, comparison, conversion, rounding, NaNs, cumulative flags | A2.5 | `arith` |
//! | Instruction timings | TRM table 7-1 and the text below it | [`cycles`] |
//!
//! Left out, and how firmware sees it:
//!
//! - Double-precision arithmetic and FPv5 do not exist in FPv4-SP: the instructions are undefined (UFSR.UNDEFINSTR).
//! - Every case that the manual calls UNPREDICTABLE is undefined too. Examples are a register list past s31, or SP or
//!   PC as the core register of a transfer. Compilers emit none of these.
//! - A `VLDM` or `VSTM` is never abandoned or continued in its middle (ICI). On the pessimistic clock an interrupt
//!   waits for the instruction's end, and for the end of lazy stacking. On the optimistic clock an interrupt waits for
//!   neither, see `Core::cut_short`.
//! - The stall of an instruction that reads the previous instruction's floating-point result is not tracked. It is the
//!   difference between the least and the most cycles that [`cycles`] returns.
//! - The exception outputs of the FPU (FPIXC, FPIDC and others), which a part may wire to an interrupt line, are not
//!   driven. The cumulative flags in FPSCR are exact.

mod arith;
mod decode;
mod execute;
#[cfg(test)]
mod tests;

pub(crate) use decode::decode;

/// The bits of FPSCR that FPv4-SP has: N, Z, C, V, AHP, DN, FZ, RMode, IDC and the five of IEEE 754 (ARM ARM A2.5.3).
pub(crate) const FPSCR_BITS: u32 = 0xF7C0_009F;

/// A decoded instruction. `d`, `n` and `m` number single-precision registers. `t`, `t2` and `base` number core
/// registers.
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
    /// VMOV of an immediate. `imm8` is the encoded value, which ARM ARM A6.4.1 expands.
    VmovImmediate {
        d: u8,
        imm8: u8,
    },
    /// VCMP, or VCMPE if `signals`. For VCMPE a quiet NaN is an invalid operation too.
    Vcmp {
        d: u8,
        m: u8,
        signals: bool,
    },
    VcmpZero {
        d: u8,
        signals: bool,
    },
    /// VCVT to an integer if `toward_zero`, else VCVTR.
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
    /// A conversion from half precision: VCVTT if `top`, else VCVTB.
    VcvtFromHalf {
        d: u8,
        m: u8,
        top: bool,
    },
    /// A conversion to half precision: VCVTT if `top`, else VCVTB.
    VcvtToHalf {
        d: u8,
        m: u8,
        top: bool,
    },
    /// VLDR of one word, or of the two words of a double register.
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
    /// VLDM or VPOP. `imm8` is the step of the base in words, one more than `words` for the deprecated FLDMX.
    Vldm {
        d: u8,
        words: u8,
        base: u8,
        add: bool,
        write_back: bool,
        imm8: u8,
    },
    /// VSTM or VPUSH. `imm8` is the step of the base in words, as in `Vldm`.
    Vstm {
        d: u8,
        words: u8,
        base: u8,
        add: bool,
        write_back: bool,
        imm8: u8,
    },
    /// A move from a core register to `s<n>`.
    VmovFromCore {
        n: u8,
        t: u8,
    },
    VmovToCore {
        n: u8,
        t: u8,
    },
    /// A move from two core registers to `s<m>` and `s<m+1>`.
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
    /// VMRS of FPSCR; `t` = 15 means APSR_nzcv.
    Vmrs {
        t: u8,
    },
    Vmsr {
        t: u8,
    },
}

const _: () = assert!(size_of::<FpOp>() <= 8);

/// The least and the most cycles of an instruction, without wait states: TRM table 7-1.
///
/// The most cycles include the extra cycle of an arithmetic instruction whose result the next instruction reads. The
/// least cycles of VDIV and VSQRT are 1 although the table has 14, because integer instructions execute while the
/// division goes on.
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
