//! The external interrupt controller, RM0090 chapter 12, and SYSCFG's part in it, chapter 9.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `IMR`, `EMR` | `IMR` gates a line's pending bit to the core, 12.3.1 |
//! | `RTSR`, `FTSR` | An edge on the line's pin sets its pending bit, either or both, 12.3.3 |
//! | `SWIER` | A one written to an unmasked line sets its pending bit; it stays set until `PR` is cleared, 12.3.5 |
//! | `PR` | Cleared by writing one, 12.3.6 |
//! | `SYSCFG_EXTICR1` to `4` | Which port's pin each of lines 0 to 15 listens to, 9.2.3 |
//! | Interrupts | Lines 0 to 4 each their own, 5 to 9 and 10 to 15 shared, 16 (PVD), 21 and 22 their own, table 63 |
//!
//! **Left out.** Event mode (`EMR` waking a WFE): no firmware here waits for events of a pin. Edges of lines 16 to 22
//! themselves (PVD, RTC, USB, Ethernet): their sources have no model, so only `SWIER` raises them. `SYSCFG_MEMRMP` and
//! `SYSCFG_PMC` keep what is written and say so.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::{exti::Register, syscfg};

/// How many lines there are, 12.3.
const LINES: u32 = 23;
/// The lines that come from pins.
pub(super) const PIN_LINES: u8 = 16;

/// The lines of each interrupt of the instance, in the order its table lists them: interrupts 2 (tamper, line 21), 6 to
/// 10 (lines 0 to 4), 23 (lines 5 to 9), 40 (lines 10 to 15). PVD, RTC and USB wake-up belong to other instances of the
/// tables.
const INTERRUPTS: [u64; 8] = [1 << 21, 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 0x3E0, 0xFC00];

/// The controller.
#[derive(Debug, Default)]
pub struct Exti {
    pending: u64,
    driven: [bool; INTERRUPTS.len()],
    levels: [Option<Level>; PIN_LINES as usize],
}

impl Exti {
    /// The pin lines that can do anything: a trigger is set for them.
    pub(super) fn listening(registers: &RegisterFile) -> u64 {
        (registers.get(Register::Rtsr) | registers.get(Register::Ftsr)) & 0xFFFF
    }

    /// The level on `line`'s pin now. Answers whether an edge set the line pending.
    pub(super) fn sample(
        &mut self,
        line: u8,
        level: Level,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        let was = self.levels[usize::from(line)].replace(level);
        if was.is_none() || was == Some(level) {
            return false;
        }
        let trigger = if level == Level::High { Register::Rtsr } else { Register::Ftsr };
        if registers.get(trigger) >> line & 1 == 0 {
            return false;
        }
        self.pending |= 1 << line;
        self.refresh(registers, context);
        true
    }

    /// Whether `level` on `line` is news, without taking it.
    pub(super) fn differs(&self, line: u8, level: Level) -> bool {
        self.levels[usize::from(line)] != Some(level)
    }

    fn refresh(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Pr, self.pending);
        let live = self.pending & registers.get(Register::Imr);
        for (position, (lines, driven)) in INTERRUPTS.iter().zip(&mut self.driven).enumerate() {
            let high = live & lines != 0;
            if *driven != high {
                *driven = high;
                context.interrupt(position, Level::from(high));
            }
        }
    }
}

impl Device for Exti {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let every = (1 << LINES) - 1;
        match register {
            Register::Pr => {
                self.pending &= !value;
                let raised = registers.get(Register::Swier);
                registers.set(Register::Swier, raised & !value);
            }
            Register::Swier => self.pending |= value & registers.get(Register::Imr) & every,
            _ => {}
        }
        self.refresh(registers, context);
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

/// The system configuration controller: it keeps the EXTI's routing, which the part reads from its registers.
#[derive(Debug, Default)]
pub struct Syscfg;

impl Syscfg {
    /// The port (0 is A) that `line` listens to, 9.2.3.
    pub(super) fn port_of(line: u8, registers: &RegisterFile) -> usize {
        use syscfg::Register::{Exticr1, Exticr2, Exticr3, Exticr4};
        let register = [Exticr1, Exticr2, Exticr3, Exticr4][usize::from(line / 4)];
        usize::try_from(registers.get(register) >> (4 * (line % 4)) & 0xF).unwrap_or(0)
    }
}

impl Device for Syscfg {
    type Register = syscfg::Register;

    fn write(
        &mut self,
        register: syscfg::Register,
        value: u64,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            syscfg::Register::Memrm if value != 0 => {
                context.tell("MEMRM", "memory remapping (RM0090 9.2.1) is not modelled: flash stays at address zero");
            }
            syscfg::Register::Pmc if value != 0 => {
                context.tell("PMC", "peripheral mode configuration (RM0090 9.2.2) has no effect here");
            }
            _ => {}
        }
    }
}
