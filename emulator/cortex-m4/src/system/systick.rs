//! SysTick, ARM ARM B3.3.
//!
//! | Covered | ARM ARM |
//! |---|---|
//! | CSR, RVR, CVR, CALIB | B3.3.3 to B3.3.6 |
//! | both clocks, the exact cycle of each wrap | B3.3.1 |
//!
//! SysTick counts on while the core sleeps, since it counts FCLK, which sleep does not stop (TRM 4.1, "power
//! management"). A part that stops FCLK in deep sleep also stops the core's cycle count. SysTick stands still while the
//! core is halted for debug (B3.3.1).
//!
//! The counter's value is not stored for each cycle: it is calculated from the last cycle at which it was known.

const ENABLE: u32 = 1;
const TICKINT: u32 = 1 << 1;
const CLKSOURCE: u32 = 1 << 2;

#[derive(Clone, Debug)]
pub(crate) struct SysTick {
    control: u32,
    reload: u32,
    /// Returns the value of CVR at the cycle `at`.
    value: u32,
    at: u64,
    counted: bool,
    paused: bool,
    reference: u32,
    calibration: u32,
}

impl SysTick {
    pub(crate) fn new(calibration: u32, reference: u32) -> Self {
        Self { control: 0, reload: 0, value: 0, at: 0, counted: false, paused: false, reference, calibration }
    }

    /// The core cycles in one tick. Without a reference clock, CLKSOURCE reads as one (ARM ARM B3.3.3).
    fn step(&self) -> u64 {
        if self.control & CLKSOURCE != 0 || self.reference == 0 { 1 } else { u64::from(self.reference) }
    }

    /// Moves `at` to the last tick at or before `cycle`. The reference clock has its ticks at multiples of its period.
    fn align(&mut self, cycle: u64) {
        self.at = cycle - cycle % self.step();
    }

    fn counting(&self) -> bool {
        self.control & ENABLE != 0 && !self.paused
    }

    /// Counts up to `cycle`. Returns whether the counter has reached zero while TICKINT is set.
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
        // A counter that was cleared reloads first. Only a count from one to zero raises the exception.
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

    /// Stops the counter while the core is halted for debug. The caller has advanced the counter to `cycle`.
    pub(crate) fn pause(&mut self, cycle: u64, paused: bool) {
        if self.paused && !paused {
            self.align(cycle);
        }
        self.paused = paused;
    }

    /// Reads the register at offset 0x0, 0x4, 0x8 or 0xC. The caller has advanced the counter. A debugger's read does
    /// not clear COUNTFLAG.
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

    /// Writes the register at offset 0x0, 0x4 or 0x8 at `cycle`. The caller has advanced the counter.
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
                // Any write clears the counter and COUNTFLAG without raising the exception (ARM ARM B3.3.5).
                self.value = 0;
                self.counted = false;
                self.align(cycle);
            }
            _ => {}
        }
    }
}
