//! The registers of a Cortex-M4 with FPU in gdb's order.
//!
//! `gdbstub_arch` has no M-profile core. The target description therefore uses three features that gdb recognises by
//! name ("Debugging with GDB", appendix G.5.3, ARM Features):
//!
//! - The feature `org.gnu.gdb.arm.m-profile` has r0 to pc, and xPSR.
//! - The feature `org.gnu.gdb.arm.m-system` has MSP, PSP, and, as in OpenOCD's `src/target/armv7m.c`, the masks and
//!   CONTROL.
//! - The feature `org.gnu.gdb.arm.vfp` has d0 to d15 and FPSCR; gdb derives s0 to s31 from d0 to d15.

use std::num::NonZeroUsize;

use cortex_m4::Register;
use gdbstub::arch::{Arch, RegId, Registers};
use gdbstub_arch::arm::ArmBreakpointKind;

/// The number of 32-bit registers before the first double register: 0 to 15, xPSR, and six system registers.
const FIRST_DOUBLE: usize = 23;
const DOUBLES: usize = 16;
const FPSCR: usize = FIRST_DOUBLE + DOUBLES;

#[derive(Clone, Copy, Debug)]
pub(super) enum CortexM4 {}

impl Arch for CortexM4 {
    type Usize = u32;
    type Registers = CoreRegisters;
    type BreakpointKind = ArmBreakpointKind;
    type RegId = Number;

    fn target_description_xml() -> Option<&'static str> {
        Some(include_str!("target.xml"))
    }
}

/// A register, as an index into gdb's target description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Number(usize);

impl RegId for Number {
    fn from_raw_id(id: usize) -> Option<(Self, Option<NonZeroUsize>)> {
        (id <= FPSCR).then_some((Self(id), NonZeroUsize::new(if is_double(id) { 8 } else { 4 })))
    }

    fn to_raw_id(&self) -> Option<usize> {
        Some(self.0)
    }
}

impl Number {
    pub(super) fn all() -> impl Iterator<Item = Self> {
        (0..=FPSCR).map(Self)
    }

    /// The core registers that make up this register of gdb. A 64-bit register consists of two, the lower half first.
    pub(super) fn of_core(self) -> (Register, Option<Register>) {
        let small = |number: usize| u8::try_from(number).unwrap_or(0);
        let single = match self.0 {
            0..=15 => Register::R(small(self.0)),
            16 => Register::Xpsr,
            17 => Register::Msp,
            18 => Register::Psp,
            19 => Register::Primask,
            20 => Register::Basepri,
            21 => Register::Faultmask,
            22 => Register::Control,
            FPSCR => Register::Fpscr,
            double => {
                let single = 2 * small(double - FIRST_DOUBLE);
                return (Register::S(single), Some(Register::S(single + 1)));
            }
        };
        (single, None)
    }
}

const fn is_double(id: usize) -> bool {
    id >= FIRST_DOUBLE && id < FPSCR
}

/// The values of all registers in gdb's order, one word for a 32-bit register and two words for a 64-bit register.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct CoreRegisters {
    pub(super) words: Vec<u32>,
}

impl Registers for CoreRegisters {
    type ProgramCounter = u32;

    fn pc(&self) -> u32 {
        self.words.get(15).copied().unwrap_or(0)
    }

    fn gdb_serialize(&self, mut write_byte: impl FnMut(Option<u8>)) {
        self.words.iter().flat_map(|word| word.to_le_bytes()).for_each(|byte| write_byte(Some(byte)));
    }

    fn gdb_deserialize(&mut self, bytes: &[u8]) -> Result<(), ()> {
        let (words, rest) = bytes.as_chunks::<4>();
        if words.len() != FPSCR + 1 + DOUBLES || !rest.is_empty() {
            return Err(());
        }
        self.words = words.iter().map(|word| u32::from_le_bytes(*word)).collect();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_description_lists_the_registers_as_they_are_numbered() {
        let text = CortexM4::target_description_xml().unwrap();
        let described: Vec<(&str, usize)> = text
            .lines()
            .filter_map(|line| line.trim().strip_prefix("<reg name=\""))
            .map(|rest| {
                let (name, rest) = rest.split_once('"').unwrap();
                let bits = rest.split_once("bitsize=\"").unwrap().1.split_once('"').unwrap().0;
                (name, bits.parse::<usize>().unwrap() / 8)
            })
            .collect();
        let ours: Vec<(String, usize)> = Number::all()
            .map(|number| {
                let name = match number.of_core() {
                    (Register::R(13), None) => "sp".to_owned(),
                    (Register::R(14), None) => "lr".to_owned(),
                    (Register::R(15), None) => "pc".to_owned(),
                    (Register::R(n), None) => format!("r{n}"),
                    (Register::S(n), Some(_)) => format!("d{}", n / 2),
                    (other, _) => format!("{other:?}").to_lowercase(),
                };
                (name, Number::from_raw_id(number.0).unwrap().1.unwrap().get())
            })
            .collect();
        let ours: Vec<(&str, usize)> = ours.iter().map(|(name, size)| (name.as_str(), *size)).collect();
        assert_eq!(described, ours);
        assert!(Number::from_raw_id(described.len()).is_none());
    }
}
