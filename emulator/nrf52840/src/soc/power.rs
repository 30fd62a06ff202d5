//! Clock sources, sleep, System OFF, and what each kind of reset keeps (PS 5.3, 5.4).

use super::*;

/// The value of RAM bytes that were not retained through System OFF.
const LOST: u8 = 0xA5;

impl Soc {
    /// Changes the source of a clock. Instances that use the clock move their next events.
    pub(super) fn switch(&mut self, source: Source) {
        let Settings { hfxo_ppb, hfint_ppb, lfxo_ppb, lfrc_ppb, .. } = self.settings;
        match source {
            Source::HighInternal => self.feed_hf(hfint_ppb),
            Source::HighCrystal => self.feed_hf(hfxo_ppb),
            Source::LowRc => self.feed_lf(lfrc_ppb, false),
            Source::LowCrystal => self.feed_lf(lfxo_ppb, false),
            Source::LowSynthesised => self.feed_lf(self.clocks.hf_ppb, true),
            // A running watchdog keeps LFCLK running.
            Source::LowStopped if self.parts.wdt.running() => {
                self.feed_lf(lfrc_ppb, false);
                self.parts.clock_power.keep_lfclk();
            }
            Source::LowStopped => self.clocks.lf = None,
        }
        for id in ids(INSTANCES) {
            call!(self, id, instance, cx => instance.configured(cx));
        }
    }

    fn feed_hf(&mut self, ppb: i64) {
        if self.clocks.hf_ppb == ppb {
            return;
        }
        self.clocks.hf_ppb = ppb;
        self.signals.announce();
        if let Some(lf) = &mut self.clocks.lf {
            let lf_ppb = if self.lf_synthesised { ppb } else { lf.ppb() };
            lf.retune(self.now, lf_ppb, ppb);
        }
    }

    fn feed_lf(&mut self, ppb: i64, synthesised: bool) {
        self.lf_synthesised = synthesised;
        match &mut self.clocks.lf {
            Some(lf) => lf.retune(self.now, ppb, self.clocks.hf_ppb),
            stopped => *stopped = Some(Lfclk::new(ppb, self.clocks.hf_ppb, self.now)),
        }
    }

    pub(crate) fn sleeps<O: Outside>(&mut self, at: Cycle, asleep: bool, outside: &mut O) {
        self.come(at, outside);
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << CLOCK_POWER | 1 << WDT;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: CLOCK_POWER, name: "CLOCK/POWER" };
        parts.clock_power.sleeps(asleep, &mut cx);
        parts.wdt.sleeps(asleep, &mut cx);
        self.carry(outside);
    }

    /// Changes the supply. A brown-out reset comes below 1.57 V, and a restart above 1.62 V, as late as PS 5.3.8 allows
    /// (V_BOR in System ON). Below 1.7 V the part is not specified; the model works there as at higher voltages. The
    /// power-fail comparator reacts too.
    pub(crate) fn supply<O: Outside>(&mut self, at: Cycle, microvolts: u32, outside: &mut O) -> Supplied {
        let before = self.held;
        self.held = microvolts < if before { 1_620_000 } else { 1_570_000 };
        self.come(at, outside);
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << CLOCK_POWER;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: CLOCK_POWER, name: "CLOCK/POWER" };
        parts.clock_power.supply(microvolts, &mut cx);
        self.carry(outside);
        match (before, self.held) {
            (_, true) => Supplied::HeldInReset,
            // RESETREAS does not distinguish a brown-out from a power-on.
            (true, false) => Supplied::Restarts(Reset::BrownOut),
            (false, false) => Supplied::Enough,
        }
    }

    pub(crate) fn take_supply_warning(&mut self) -> bool {
        std::mem::take(&mut self.parts.clock_power.warned)
    }

    pub(crate) fn halts<O: Outside>(&mut self, at: Cycle, halted: bool, outside: &mut O) {
        self.come(at, outside);
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << WDT;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: WDT, name: "WDT" };
        parts.wdt.halts(halted, &mut cx);
        self.carry(outside);
    }

    /// Restarts the part (PS 5.3, *Reset behavior*). State that the cause does not reset is kept. The outside continues
    /// to drive its pins.
    pub(crate) fn restart<O: Outside>(&mut self, at: Cycle, cause: Reset, outside: &mut O) {
        self.now = self.now.max(at);
        self.out.pc = None;
        self.protection_restarts(cause);
        let mut parts = Parts::new(&self.settings);
        // RESETREAS accumulates until it is cleared (PS 5.3). Power-on and brown-out set it to 0.
        let reason = match cause {
            Reset::PowerOn | Reset::BrownOut => None,
            Reset::Pin => Some(1),
            Reset::Watchdog(_) => Some(1 << 1),
            Reset::Software => Some(1 << 2),
            Reset::Lockup => Some(1 << 3),
            Reset::Wakeup(BY_LPCOMP) => Some(1 << 17),
            Reset::Wakeup(_) => Some(1 << 16),
        };
        // Software, lock-up and wake-up keep the retained registers. Software and lock-up also keep the watchdog.
        let keeps_watchdog = matches!(cause, Reset::Software | Reset::Lockup);
        let wakes = matches!(cause, Reset::Wakeup(_));
        if let Some(reason) = reason {
            parts.clock_power.restarted(&self.parts.clock_power, reason, keeps_watchdog || wakes);
        }
        if wakes {
            self.lose_ram();
        }
        parts.rng.keep(&self.parts.rng);
        parts.clock_power.keep_supply(&self.parts.clock_power);
        self.feed_hf(self.settings.hfint_ppb);
        if keeps_watchdog && self.parts.wdt.running() {
            std::mem::swap(&mut parts.wdt, &mut self.parts.wdt);
            parts.clock_power.keep_lfclk();
            if self.clocks.lf.is_some() {
                self.feed_lf(self.settings.lfrc_ppb, false);
            }
        } else {
            self.clocks.lf = None;
        }
        self.parts = parts;
        self.out.acts.clear();
        (self.restarting, self.halted, self.off) = (None, false, false);
        self.signals.stall_until(0);
        self.signals.announce();
        let Self { gpio, out, now, .. } = self;
        if wakes {
            // GPIO keeps its configuration through System OFF and the reset that ends it.
            gpio.let_go(*now, out);
        } else {
            gpio.restart(*now, out);
        }
        for id in ids(INSTANCES) {
            call!(self, id, instance, cx => instance.configured(cx));
        }
        self.next = NEVER;
        self.nexts = [NEVER; 64];
        self.scheduled = 0;
        self.touched = INSTANCES;
        self.carry(outside);
    }

    /// Overwrites RAM that System OFF did not retain. RAM0 to RAM7 have two sections of 4 KiB each, RAM8 six of 32 KiB
    /// (PS 4.2, *RAM*; 5.3, RAM\[n\].POWER).
    fn lose_ram(&mut self) {
        let sections = (0..16).map(|n| (n / 2, n % 2, n * 0x1000, 0x1000));
        let large = (0..6).map(|n| (8, n, 0x1_0000 + n * 0x8000, 0x8000));
        for (block, section, from, size) in sections.chain(large) {
            if !self.parts.clock_power.retains(block, section) {
                self.memory.ram.bytes_mut()[from..from + size].fill(LOST);
            }
        }
    }

    pub(crate) fn drift<O: Outside>(&mut self, at: Cycle, ppb: i64, outside: &mut O) {
        self.come(at, outside);
        self.settings.hfxo_ppb += ppb;
        self.settings.lfxo_ppb += ppb;
        if self.parts.clock_power.is_hfxo_stable() {
            self.switch(Source::HighCrystal);
        }
        if self.parts.clock_power.is_on_lfxo() {
            self.switch(Source::LowCrystal);
        }
        self.carry(outside);
    }

    pub(crate) fn set_hfxo_startup(&mut self, startup_ns: Option<u64>) {
        self.settings.hfxo_startup_ns = startup_ns;
        self.parts.clock_power.set_hfxo_startup(startup_ns);
    }

    pub(crate) fn has_hfxo(&self) -> bool {
        self.settings.hfxo_startup_ns.is_some() || self.parts.clock_power.is_hfxo_stable()
    }

    pub(crate) fn reset_reason(&self) -> u32 {
        self.parts.clock_power.reset_reason
    }

    pub(crate) fn debug_port_enabled(&self) -> bool {
        self.parts.clock_power.debug_port_enabled()
    }
}
