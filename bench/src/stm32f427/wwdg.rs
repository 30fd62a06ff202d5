//! The window watchdog, RM0090 chapter 22.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `CR` `WDGA`, `T` | Only a reset clears `WDGA`. `T` counts down each 4096 × 2^`WDGTB` cycles of PCLK1, 22.4 |
//! | End of count | From 0x40 to 0x3F the part restarts, and so it does when a value below 0x40 is written, 22.3 |
//! | `CFR` `W` | Writing `T` while it is above `W` restarts the part, 22.3 |
//! | `CFR` `EWI`, `SR` `EWIF` | At 0x40 `EWIF` is set, and interrupts when `EWI` is, 22.3 |
//!
//! **Left out.** The prescaler runs freely in the part; here it starts with each write of `T`, so a time-out is at the
//! long end of the part's one-tick uncertainty. `DBGMCU` freezing it.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::wwdg::Register;
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};

const WDGA: u64 = 1 << 7;
const COUNT: u64 = 0x7F;
/// Bit 6 of `T`: the part restarts once it is clear.
const ALIVE: u64 = 0x40;
const EWI: u64 = 1 << 9;

/// The watchdog.
#[derive(Debug, Default)]
pub struct Wwdg {
    hz: u64,
    active: bool,
    written_at: u64,
    written: u64,
    early: Option<EventId>,
    end: Option<EventId>,
    interrupt: bool,
}

impl Wwdg {
    fn tick(&self, registers: &RegisterFile) -> u128 {
        let divider = 4096_u128 << (registers.get(Register::Cfr) >> 7 & 3);
        divider * u128::from(NANOS_PER_SECOND) / u128::from(self.hz.max(1))
    }

    fn count(&self, now: u64, registers: &RegisterFile) -> u64 {
        if !self.active || self.hz == 0 {
            return self.written;
        }
        let ticks = u128::from(now.saturating_sub(self.written_at)) / self.tick(registers).max(1);
        self.written.saturating_sub(u64::try_from(ticks).unwrap_or(u64::MAX))
    }

    fn schedule(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        (self.early, self.end) = (None, None);
        if !self.active || self.hz == 0 {
            return;
        }
        let mut after = |ticks: u64| {
            let nanos = u64::try_from(self.tick(registers) * u128::from(ticks)).unwrap_or(u64::MAX);
            context.schedule(VirtualNanos(self.written_at.saturating_add(nanos)))
        };
        let early = self.written.saturating_sub(ALIVE);
        (self.early, self.end) = (Some(after(early)), Some(after(early + 1)));
    }

    fn refresh(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let high = registers.get(Register::Sr) & 1 != 0 && registers.get(Register::Cfr) & EWI != 0;
        if high != self.interrupt {
            self.interrupt = high;
            context.interrupt(0, Level::from(high));
        }
    }

    /// PCLK1, which the part keeps in step with its clock tree.
    pub(super) fn set_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if hz == self.hz {
            return;
        }
        let now = context.now().0;
        self.written = self.count(now, registers);
        self.written_at = now;
        self.hz = hz;
        self.schedule(registers, context);
    }
}

impl Device for Wwdg {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        (register == Register::Cr).then(|| self.count(context.now().0, registers) | if self.active { WDGA } else { 0 })
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        match register {
            Register::Cr => {
                let now = context.now().0;
                let outside = self.active && self.count(now, registers) > registers.get(Register::Cfr) & COUNT;
                self.active |= value & WDGA != 0;
                self.written = value & COUNT;
                self.written_at = now;
                if self.active && (outside || self.written & ALIVE == 0) {
                    context.request_reset();
                }
                self.schedule(registers, context);
            }
            Register::Cfr => self.schedule(registers, context),
            // EWIF is cleared by writing zero and cannot be set by software.
            Register::Sr if value & 1 != 0 => registers.set(Register::Sr, u64::from(self.interrupt)),
            Register::Sr => {}
        }
        self.refresh(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.early == Some(event) {
            registers.set(Register::Sr, 1);
            self.refresh(registers, context);
        } else if self.end == Some(event) {
            context.request_reset();
        }
    }

    fn reset(&mut self) {
        *self = Self { hz: self.hz, ..Self::default() };
    }
}
