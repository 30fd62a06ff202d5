//! The faults an instruction can take, ARM ARM B1.5.14.

/// Why an instruction did not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// UFSR.UNDEFINSTR.
    Undefined,
    /// UFSR.INVSTATE: EPSR.T clear, or an IT state that the instruction does not allow.
    InvalidState,
    /// UFSR.INVPC: an illegal EXC_RETURN or exception frame.
    InvalidPc,
    /// UFSR.NOCP: a coprocessor that is absent or not enabled.
    NoCoprocessor,
    /// UFSR.UNALIGNED.
    Unaligned,
    /// UFSR.DIVBYZERO.
    DivideByZero,
    /// BFSR.PRECISERR, with the address.
    BusData(u32),
    /// BFSR.IBUSERR.
    BusInstruction,
    /// BFSR.STKERR: stacking at exception entry.
    BusStacking,
    /// BFSR.UNSTKERR: unstacking at exception return.
    BusUnstacking,
    /// BFSR.LSPERR: lazy preservation of the FP state.
    BusLazy,
    /// MMFSR.DACCVIOL, with the address.
    MemData(u32),
    /// MMFSR.IACCVIOL.
    MemInstruction,
    /// MMFSR.MSTKERR.
    MemStacking,
    /// MMFSR.MUNSTKERR.
    MemUnstacking,
    /// MMFSR.MLSPERR.
    MemLazy,
    /// HFSR.VECTTBL.
    VectorRead,
    /// `BKPT` with no debugger: HFSR.DEBUGEVT, or DebugMonitor where it is enabled.
    Breakpoint,
}
