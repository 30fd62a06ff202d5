//! SysTick, ARM ARM B3.3.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | CSR, RVR, CVR, CALIB | B3.3.3 to B3.3.6 |
//! | both clocks, the exact cycle of each wrap | B3.3.1 |
//!
//! It goes on counting while the core sleeps: it is clocked by FCLK, which the core's sleep does not stop (TRM 4.1,
//! "power management"). A part that stops FCLK in a deep sleep stops the core's cycle count with it. It stands still
//! while the core is halted for debug (B3.3.1).
//!
//! The counter is not stepped: its value is worked out from the cycle at which it was last known.

const ENABLE: u32 = 1;
const TICKINT: u32 = 1 << 1;
const CLKSOURCE: u32 = 1 << 2;

#[derive(Clone, Debug)]
pub(crate) struct SysTick {
    /// CSR bits 2:0.
    control: u32,
    reload: u32,
    /// CVR at cycle `at`.
    value: u32,
    at: u64,
    /// CSR.COUNTFLAG.
    counted: bool,
    paused: bool,
    /// Core cycles of a tick of the reference clock, 0 for none.
    reference: u32,
    calibration: u32,
}

impl SysTick {
    pub(crate) fn new(calibration: u32, reference: u32) -> Self {
        Self { control: 0, reload: 0, value: 0, at: 0, counted: false, paused: false, reference, calibration }
    }

    /// Core cycles of a tick. Without a reference clock, CLKSOURCE reads as one (B3.3.3).
    fn step(&self) -> u64 {
        if self.control & CLKSOURCE != 0 || self.reference == 0 { 1 } else { u64::from(self.reference) }
    }

    /// Sets `at` to the last tick at or before `cycle`: the reference runs freely, its ticks are at multiples.
    fn align(&mut self, cycle: u64) {
        self.at = cycle - cycle % self.step();
    }

    fn counting(&self) -> bool {
        self.control & ENABLE != 0 && !self.paused
    }

    /// Counts up to `cycle`. Answers whether the counter reached zero and its exception is enabled.
    pub(crate) fn advance(&mut self, cycle: u64) -> bool {
        if !self.counting() || cycle <= self.at {
            return false;
        }
        let step = self.step();
        let mut ticks = cycle - self.at;
        if step != 1 {
            ticks /= step;
        }
        self.at += ticks * step;
        if ticks < u64::from(self.value) {
            self.value -= ticks as u32;
            return false;
        }
        // a counter that was cleared reloads with its next tick, and counts as reaching zero only from one
        let mut reached = self.value != 0;
        ticks -= u64::from(self.value);
        self.value = 0;
        if ticks != 0 && self.reload != 0 {
            let period = u64::from(self.reload) + 1;
            reached |= ticks >= period;
            let rest = ticks % period;
            self.value = if rest == 0 { 0 } else { (period - rest) as u32 };
        }
        self.counted |= reached;
        reached && self.control & TICKINT != 0
    }

    /// The cycle at which the exception becomes pending next.
    pub(crate) fn due(&self) -> u64 {
        if !self.counting() || self.control & TICKINT == 0 {
            return u64::MAX;
        }
        match (self.value, self.reload) {
            (0, 0) => u64::MAX,
            (0, reload) => self.at + (u64::from(reload) + 1) * self.step(),
            (value, _) => self.at + u64::from(value) * self.step(),
        }
    }

    /// The core is halted for debug, or no longer. The counter was advanced to `cycle` before.
    pub(crate) fn pause(&mut self, cycle: u64, paused: bool) {
        if self.paused && !paused {
            self.align(cycle);
        }
        self.paused = paused;
    }

    /// Reads at offset 0x0, 0x4, 0x8 or 0xC; the counter was advanced before. A debugger's read clears nothing.
    pub(crate) fn read(&mut self, offset: u32, debugger: bool) -> u32 {
        match offset {
            0x0 => {
                let counted = self.counted;
                self.counted &= debugger;
                let fixed = if self.reference == 0 { CLKSOURCE } else { 0 };
                self.control | fixed | u32::from(counted) << 16
            }
            0x4 => self.reload,
            0x8 => self.value,
            _ => self.calibration,
        }
    }

    /// Writes at offset 0x0, 0x4 or 0x8 at `cycle`; the counter was advanced before.
    pub(crate) fn write(&mut self, offset: u32, value: u32, cycle: u64) {
        match offset {
            0x0 => {
                let step = self.step();
                let was = self.counting();
                self.control = value & (ENABLE | TICKINT | CLKSOURCE);
                if !was || step != self.step() {
                    self.align(cycle);
                }
            }
            0x4 => self.reload = value & 0x00FF_FFFF,
            0x8 => {
                // any write clears the counter and COUNTFLAG, without an exception (B3.3.5)
                self.value = 0;
                self.counted = false;
                self.align(cycle);
            }
            _ => {}
        }
    }
}
