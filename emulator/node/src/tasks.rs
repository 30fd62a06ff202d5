//! The tasks of a firmware over time: when each handler runs, and when the core sleeps.

use cortex_m4::{Cost, Register, Scheduled, Width};
use emulator_part::Part;

use super::{Board, Node, memory};

/// The number of exceptions (ARMv7-M ARM table B1-4): 16 of the system, and at most 240 interrupts on a Cortex-M4.
const EXCEPTIONS: u16 = 16 + 240;

/// The address of the interrupt clear-enable registers, with a bit for each interrupt (ARMv7-M ARM B3.4.5).
const ICER: u32 = 0xE000_E180;
const ISPR: u32 = 0xE000_E200;
const ICSR: u32 = 0xE000_ED04;

/// The addresses of the priority registers of interrupts and of system handlers from number 4 on, with a byte for each
/// (ARMv7-M ARM B3.4.9, B3.2.10).
const IPR: u32 = 0xE000_E400;
const SHPR: u32 = 0xE000_ED18;

impl<B: Board, C: Cost> Node<B, C> {
    /// Starts or ends the record of active exceptions and of sleep. The record's first entry is the present state.
    pub fn watch_tasks(&mut self, on: bool) {
        self.core.watch_exceptions(on);
        let now = self.now();
        self.tasks = on.then(|| vec![(now, self.core.active_exception())]);
        self.side.sleeps = on.then(|| vec![(now, self.core.is_asleep())]);
    }

    /// Takes the changes of the active exception since the last call: the instant (virtual ns) and the exception from
    /// then on, 0 for thread mode, 16 + n for interrupt n. Empty if tasks are not watched.
    pub fn take_tasks(&mut self) -> Vec<(u64, u16)> {
        self.note_tasks();
        self.tasks.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Takes the instants (virtual ns) since the last call at which the core fell asleep (`true`) and woke (`false`).
    /// Empty if tasks are not watched.
    pub fn take_sleeps(&mut self) -> Vec<(u64, bool)> {
        self.side.sleeps.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Begins or ends the record of the events that decide which exception runs.
    pub fn watch_schedule(&mut self, on: bool) {
        self.core.watch_schedule(on);
        self.schedule = on.then(Vec::new);
    }

    /// Takes the events since the last call that decide which exception runs, each with its instant (virtual ns), in
    /// order. Empty if they are not recorded.
    pub fn take_schedule(&mut self) -> Vec<(u64, Scheduled)> {
        self.note_tasks();
        self.schedule.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The numbers of the exceptions whose handler is the function `handler`. There are several if the compiler has
    /// merged functions with the same code. There are none for the default handler, or if no vector leads to the
    /// function.
    #[must_use]
    pub fn exceptions_of(&self, handler: &str) -> Vec<u16> {
        let Some(address) = self.firmware.symbol(handler).map(|symbol| symbol.address & !1) else { return vec![] };
        if self.traps.default_handler.contains(&address) {
            return vec![];
        }
        let table = u64::from(self.side.part.core().vector_table);
        let entry = |number: u16| memory::value(&self.side.part, table + 4 * u64::from(number), 4);
        (1..EXCEPTIONS).filter(|&number| entry(number) == Some(address | 1)).collect()
    }

    /// Whether the vector of exception `number` leads to a handler other than the default one.
    #[must_use]
    pub fn has_handler(&self, number: u16) -> bool {
        let table = u64::from(self.side.part.core().vector_table);
        let entry = memory::value(&self.side.part, table + 4 * u64::from(number), 4).unwrap_or(0);
        entry & 1 != 0 && entry != u64::from(u32::MAX) && !self.traps.default_handler.contains(&(entry & !1))
    }

    /// The present priority of exception `number`. A lower number is more urgent: -3 to 255, and 256 for thread mode.
    #[must_use]
    pub fn exception_priority(&mut self, number: u16) -> i16 {
        let number = u32::from(number);
        let register = match number {
            0 => return 256,
            1..=3 => return i16::try_from(number).unwrap_or(0) - 4,
            4..=15 => SHPR + number - 4,
            _ => IPR + number - 16,
        };
        let word = self.word(u64::from(register & !3)).unwrap_or(0);
        i16::from(word.to_le_bytes()[(register & 3) as usize])
    }

    /// Switches interrupt `line` off in the interrupt controller, until the firmware switches it on again. Does nothing
    /// if the line is not on, as without a supply or while the firmware starts. Returns whether the line was on.
    ///
    /// # Panics
    ///
    /// Panics if the core has no interrupt controller.
    pub fn switch_interrupt_off(&mut self, line: u16) -> bool {
        let (register, bit) = (ICER + 4 * u32::from(line / 32), 1 << (line % 32));
        let words = "an interrupt controller";
        // A clear-enable register reads as 1 for each line that is on (ARMv7-M ARM B3.4.5).
        let was_on = self.is_powered() && self.access_port_read(register, Width::Word).expect(words) & bit != 0;
        if was_on {
            self.access_port_write(register, Width::Word, bit).expect(words);
        }
        was_on
    }

    /// Whether an interrupt would begin at once: the core handles no exception, no enabled exception is pending, and
    /// PRIMASK is 0.
    ///
    /// # Panics
    ///
    /// Panics if the core has no interrupt controller.
    pub fn is_ready_for_interrupts(&mut self) -> bool {
        // The mask covers ICSR's VECTPENDING and VECTACTIVE (ARMv7-M ARM B3.2.4). These fields leave out an interrupt
        // that is not enabled.
        const HANDLING: u32 = 0x001F_F1FF;
        let icsr = self.access_port_read(ICSR, Width::Word).expect("an interrupt controller");
        self.is_powered() && icsr & HANDLING == 0 && self.core.register(Register::Primask) == 0
    }

    /// Makes interrupt `line` pending, although nothing has raised it. Does nothing if the line is not on, as without a
    /// supply or while the firmware starts, or if it is pending already. Returns whether it was made pending.
    ///
    /// # Panics
    ///
    /// Panics if the core has no interrupt controller.
    pub fn raise_interrupt(&mut self, line: u16) -> bool {
        let (word, bit) = (4 * u32::from(line / 32), 1 << (line % 32));
        let words = "an interrupt controller";
        // Either register reads as 1 for a line that is on, or pending (ARMv7-M ARM B3.4.5, B3.4.6).
        let raised = self.is_powered()
            && self.access_port_read(ICER + word, Width::Word).expect(words) & bit != 0
            && self.access_port_read(ISPR + word, Width::Word).expect(words) & bit == 0;
        if raised {
            self.access_port_write(ISPR + word, Width::Word, bit).expect(words);
        }
        raised
    }

    /// Records that the supply went off or came on. A core without supply counts as asleep.
    pub(super) fn note_power(&mut self) {
        let at = self.now();
        if let Some(sleeps) = &mut self.side.sleeps {
            sleeps.push((at, !self.powered));
        }
    }

    /// Moves what the core has recorded about exceptions into the node. This must be done before the core's clock
    /// changes, because cycles are converted into instants by the present clock.
    pub(super) fn note_tasks(&mut self) {
        let side = &self.side;
        if let Some(schedule) = &mut self.schedule {
            schedule.extend(self.core.take_schedule().into_iter().map(|(cycle, event)| (side.ns(cycle), event)));
        }
        if let Some(tasks) = &mut self.tasks {
            tasks.extend(self.core.take_exceptions().into_iter().map(|(cycle, active)| (side.ns(cycle), active)));
        }
    }
}
