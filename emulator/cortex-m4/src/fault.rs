//! The faults that an instruction can take, ARM ARM B1.5.14.

/// The reason for which an instruction did not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// An undefined instruction: UFSR.UNDEFINSTR.
    Undefined,
    /// An invalid state, UFSR.INVSTATE: EPSR.T is clear, or the IT state does not allow the instruction.
    InvalidState,
    /// An illegal EXC_RETURN or exception frame: UFSR.INVPC.
    InvalidPc,
    /// An access to a coprocessor that is absent or not enabled: UFSR.NOCP.
    NoCoprocessor,
    /// An unaligned access that is not allowed: UFSR.UNALIGNED.
    Unaligned,
    /// A division by zero: UFSR.DIVBYZERO.
    DivideByZero,
    /// A bus fault of a data access, with its address: BFSR.PRECISERR.
    BusData(u32),
    /// A bus fault of an instruction fetch: BFSR.IBUSERR.
    BusInstruction,
    /// A bus fault of stacking at exception entry: BFSR.STKERR.
    BusStacking,
    /// A bus fault of unstacking at exception return: BFSR.UNSTKERR.
    BusUnstacking,
    /// A bus fault of lazy preservation of the FP state: BFSR.LSPERR.
    BusLazy,
    /// An MPU violation by a data access, with its address: MMFSR.DACCVIOL.
    MemData(u32),
    /// An MPU violation by an instruction fetch: MMFSR.IACCVIOL.
    MemInstruction,
    /// An MPU violation by stacking at exception entry: MMFSR.MSTKERR.
    MemStacking,
    /// An MPU violation by unstacking at exception return: MMFSR.MUNSTKERR.
    MemUnstacking,
    /// An MPU violation by lazy preservation of the FP state: MMFSR.MLSPERR.
    MemLazy,
    /// A failed read of the vector table: HFSR.VECTTBL.
    VectorRead,
    /// A `BKPT` without a debugger: HFSR.DEBUGEVT, or DebugMonitor where it is enabled.
    Breakpoint,
}
