//! Register polling, skipped where skipping is exact.
//!
//! Firmware that waits for a flag reads one register again and again. Each read is a call into the models, which made
//! such a wait 0.1 times real time. Between two events of the models nothing the loop can see changes, so its
//! iterations are counted and not run. That is exact only if an iteration leaves everything as it found it, and this
//! module proves it for every loop it skips:
//!
//! 1. One register is read with the same answer, the same number of instructions apart, [`STREAK`] times.
//! 2. The register is not one whose read takes something out of a model (data registers).
//! 3. Stepped one instruction at a time, an iteration comes back with every core register the same (core, flags, FPU).
//! 4. None of the instructions on its path stores, waits, raises an exception or reads the processor's own timers
//!    ([`is_harmless`]). Anything not known to be harmless is not.

/// Equal reads before a loop is looked at.
pub(crate) const STREAK: u32 = 4;
/// The longest iteration looked at, in instructions.
pub(crate) const LONGEST: u64 = 32;
/// How many registers [`rigless::emulator::Processor::gdb_register`] numbers on a Cortex-M4F: core, xPSR, FPU and
/// special.
pub(crate) const REGISTERS: std::ops::RangeInclusive<usize> = 0..=39;

/// The firmware's last accesses, as far as they are one read made again and again.
#[derive(Debug, Default)]
pub(crate) struct PollWatch {
    last: Option<(u64, u64, u64)>,
    at: u64,
    /// Instructions from one read to the next.
    pub(crate) gap: u64,
    /// How many times in a row.
    pub(crate) streak: u32,
}

impl PollWatch {
    /// A read of `address` answering `value`, by the instruction at `pc`, with `count` retired.
    pub(crate) fn read(&mut self, pc: u64, address: u64, value: u64, count: u64) {
        let this = Some((pc, address, value));
        let gap = count - self.at;
        let same = this == self.last && gap == self.gap && gap <= LONGEST;
        self.streak = if same { self.streak + 1 } else { 0 };
        (self.last, self.at, self.gap) = (this, count, gap);
    }

    /// An access that is not such a read.
    pub(crate) fn other(&mut self, count: u64) {
        *self = Self { at: count, ..Self::default() };
    }

    pub(crate) fn address(&self) -> Option<u64> {
        self.last.map(|(_, address, _)| address)
    }
}

/// Registers whose read takes something out of the peripheral, by name in the register tables.
pub(crate) fn is_consumed_by_reading(register: &str) -> bool {
    ["DR", "RDR", "RXD", "FIFO", "VALUE"].contains(&register)
}

/// The processor's own peripherals, whose timers run while nothing else changes.
fn is_private(address: u32) -> bool {
    address >> 24 == 0xE0
}

/// A value an exception return branches to.
fn is_exception_return(target: u32) -> bool {
    target >= 0xF000_0000
}

/// Whether the Thumb instruction `first` (and `second`, where it is a wide one) changes nothing but core registers and
/// reads nothing of the processor's own peripherals. Encodings as in the ARMv7-M Architecture Reference Manual, chapter
/// A5.
pub(crate) fn is_harmless(first: u16, second: u16, register: impl Fn(usize) -> u32) -> bool {
    let low = |shift: u16| usize::from(first >> shift & 7);
    let readable = |address: u32| !is_private(address);
    match first {
        // Shifts, additions, comparisons, moves, data processing, high registers: A5.2.1 to A5.2.3.
        0x0000..=0x46FF => true,
        // BX and BLX.
        0x4700..=0x47FF => !is_exception_return(register(usize::from(first >> 3 & 0xF))),
        // LDR (literal).
        0x4800..=0x4FFF => true,
        // Loads with a register offset; the stores come first.
        0x5600..=0x5FFF => readable(register(low(3)).wrapping_add(register(low(6)))),
        // LDR, LDRB, LDRH (immediate).
        0x6800..=0x6FFF | 0x7800..=0x7FFF | 0x8800..=0x8FFF => readable(register(low(3))),
        // LDR (SP), ADR, ADD (SP).
        0x9800..=0xAFFF => true,
        // ADD and SUB (SP), CBZ and CBNZ, extensions, REV, POP without PC.
        0xB000..=0xB3FF | 0xB900..=0xB9FF | 0xBA00..=0xBBFF | 0xBC00..=0xBCFF => true,
        // NOP, YIELD and IT.
        0xBF00 | 0xBF10 => true,
        0xBF01..=0xBFFF => first & 0xF != 0,
        // LDM.
        0xC800..=0xCFFF => readable(register(low(8))),
        // Conditional and unconditional branches; UDF and SVC are beyond the first range.
        0xD000..=0xDDFF | 0xE000..=0xE7FF => true,
        // Data processing, shifted register.
        0xEA00..=0xEBFF => true,
        0xF000..=0xF7FF if second < 0x8000 => true,
        0xF000..=0xF7FF => {
            let branch =
                matches!(second & 0xD000, 0x9000 | 0xD000) || (second & 0xD000 == 0x8000 && (first >> 6 & 0xF) < 0xE);
            let barrier = first == 0xF3BF && matches!(second & 0xFFF0, 0x8F40 | 0x8F50 | 0x8F60);
            branch || barrier
        }
        // Single loads: bit 4 tells them from stores.
        0xF800..=0xF9FF => {
            let base = usize::from(first & 0xF);
            let loads = first & 0x10 != 0 && second >> 12 != 0xF;
            let by_register = first & 0x80 == 0 && second & 0x800 == 0;
            let offset =
                if by_register && base != 15 { register(usize::from(second & 0xF)) << (second >> 4 & 3) } else { 0 };
            loads && (base == 15 || readable(register(base).wrapping_add(offset)))
        }
        // Data processing, register; multiplication.
        0xFA00..=0xFBFF => true,
        _ => false,
    }
}

/// Whether `first` is the first half of a 32-bit instruction, A5.1.
pub(crate) fn is_wide(first: u16) -> bool {
    first >> 11 >= 0b11101
}

#[cfg(test)]
mod tests {
    use super::*;

    fn harmless(first: u16, second: u16) -> bool {
        is_harmless(first, second, |number| if number == 6 { 0xE000_E018 } else { 0x4001_3000 })
    }

    #[test]
    fn a_status_polling_loop_is_harmless() {
        // ldr r1, [r0, #8]; lsls r1, r1, #30; bpl.n
        for first in [0x6881, 0x0789, 0xD5FC] {
            assert!(harmless(first, 0), "{first:#06x}");
        }
        // ldr.w r1, [r0, #0x800]; tst.w r1, #2; beq.w
        for (first, second) in [(0xF8D0, 0x1800), (0xF011, 0x0F02), (0xF43F, 0xAFFA)] {
            assert!(harmless(first, second), "{first:#06x} {second:#06x}");
        }
    }

    #[test]
    fn what_stores_waits_or_traps_is_not() {
        // str, strb, strh, push, stm, str (register), str (SP), wfi, wfe, sev, svc, bkpt, cpsid, pop {pc}
        for first in [
            0x6081, 0x7001, 0x8001, 0xB510, 0xC003, 0x5001, 0x9000, 0xBF30, 0xBF20, 0xBF40, 0xDF00, 0xBEAB, 0xB672,
            0xBD10,
        ] {
            assert!(!harmless(first, 0), "{first:#06x}");
        }
        // str.w, strd, strex, vstr, msr, wfi.w
        for (first, second) in
            [(0xF8C0, 0x1800), (0xE9C0, 0x1200), (0xE840, 0x1200), (0xED80, 0x0A00), (0xF381, 0x8810), (0xF3AF, 0x8003)]
        {
            assert!(!harmless(first, second), "{first:#06x} {second:#06x}");
        }
    }

    #[test]
    fn reading_the_processors_own_timers_is_not() {
        // ldr r1, [r6, #0] with r6 in the system control space
        assert!(!harmless(0x6831, 0));
        assert!(!harmless(0xF8D6, 0x1000));
    }

    #[test]
    fn another_access_breaks_the_streak() {
        let mut watch = PollWatch::default();
        for count in 1..=5 {
            watch.read(0x100, 0x4001_3008, 2, count * 3);
        }
        assert!(watch.streak >= 3);
        watch.other(16);
        watch.read(0x100, 0x4001_3008, 2, 18);
        assert_eq!(watch.streak, 0);
    }
}
