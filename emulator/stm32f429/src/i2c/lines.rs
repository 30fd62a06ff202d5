//! How the I2C reacts to other devices that pull its lines (RM0090 27.3.4 and 27.6.7).

use super::*;

/// The sampling instant in quarters of a bit. SCL is high in the second half of a bit, and the sample is taken in the
/// middle of that half.
const SAMPLED: u64 = 3;

impl I2c {
    /// The levels of SCL and SDA. A pin that is not connected is high.
    pub(super) fn lines(&self, cx: &Cx) -> (bool, bool) {
        let level = |pin| cx.pads.input(Signal::I2c(self.number, pin)).unwrap_or(true);
        (level(I2cPin::Scl), level(I2cPin::Sda))
    }

    pub(super) fn look_at_lines(&mut self, cx: &Cx) {
        if self.lines(cx) != (true, true) {
            self.sr2 |= BUSY;
        }
    }

    /// Whether a byte is on the wires and SCL is in its high phase at `at`.
    fn is_clock_high(&self, at: Cycle) -> bool {
        let in_byte = matches!(self.step, Some((Step::Address(_) | Step::Write(_) | Step::Read, None)));
        in_byte && self.held.is_none() && (at - self.began) % self.bit() * 2 >= self.bit()
    }

    fn sampled_at(&self, number: u64) -> Cycle {
        self.began + number * self.bit() + self.bit() * SAMPLED / 4
    }

    /// Handles that another device pulls SCL low or releases it.
    pub(super) fn clock_changed(&mut self, high: bool, cx: &mut Cx) {
        if self.cr1 & SWRST != 0 {
            return;
        }
        self.look_at_lines(cx);
        if !high {
            if self.step.is_some() && self.due != NEVER {
                self.hold(cx.now);
            }
        } else if self.step.is_some() {
            self.resume(cx);
        }
    }

    /// Continues a step that was held, if no device holds it any more.
    fn resume(&mut self, cx: &mut Cx) {
        let (scl, sda) = self.lines(cx);
        if !scl || !sda && matches!(self.step, Some((Step::Stop, _))) {
            return;
        }
        if let Some(left) = self.held.take() {
            self.due = cx.now + left;
            self.began = cx.now.saturating_sub(self.began);
            self.low_since = self.low_since.map(|_| cx.now);
            self.expect_loss(cx.now);
        }
    }

    /// Handles that another device pulls SDA low or releases it.
    pub(super) fn data_changed(&mut self, high: bool, cx: &mut Cx) {
        if self.cr1 & SWRST != 0 {
            return;
        }
        let (scl, _) = self.lines(cx);
        if self.is_clock_high(cx.now) {
            self.sr1 |= BERR;
        }
        if high {
            self.mark_low(cx.now);
            self.low_since = None;
            let is_master = self.sr2 & MSL != 0;
            if scl && !is_master && self.sr2 & BUSY != 0 {
                // A rise of SDA while SCL is high is a stop condition.
                self.sr2 &= !BUSY;
                self.start_lost |= self.cr1 & START != 0;
            }
            if self.loses {
                self.loses = false;
                self.due = self.began + 9 * self.bit();
            }
            self.resume(cx);
            self.go_on(cx.now, cx);
        } else {
            self.look_at_lines(cx);
            self.low_since = Some(cx.now);
            if self.held.is_none() {
                self.expect_loss(cx.now);
            }
            if matches!(self.step, Some((Step::Stop, _))) && self.held.is_none() {
                self.hold(cx.now);
            }
        }
    }

    /// Suspends the present step: no bit is sampled until the step continues. [`I2c::began`] then holds how long the
    /// step has lasted so far.
    fn hold(&mut self, now: Cycle) {
        self.mark_low(now);
        self.held = Some(self.due.saturating_sub(now));
        self.due = NEVER;
        self.began = now.saturating_sub(self.began);
    }

    /// Records which bits were sampled before `now`, while another device held SDA low.
    pub(super) fn mark_low(&mut self, now: Cycle) {
        let (Some(since), Some(_), None) = (self.low_since, self.step, self.held) else { return };
        for number in 0..9 {
            if (since..now).contains(&self.sampled_at(number)) {
                self.low |= 1 << number;
            }
        }
    }

    /// Finds the bit at which arbitration is lost while another device holds SDA low: the first bit of value 1 that was
    /// not sampled before `now`.
    pub(super) fn expect_loss(&mut self, now: Cycle) {
        if self.low_since.is_none() {
            return;
        }
        let (Some((Step::Address(byte) | Step::Write(byte), None)), None) = (self.step, self.held) else { return };
        let is_one = |number: &u64| byte >> (7 - number) & 1 != 0;
        if let Some(number) = (0..8).filter(is_one).find(|number| self.sampled_at(*number) >= now) {
            self.loses = true;
            self.due = self.sampled_at(number);
        }
    }

    /// Drops the present step, without an event on the wires.
    pub(super) fn abandon(&mut self) {
        self.step = None;
        self.held = None;
        self.loses = false;
        self.is_last = false;
        self.due = NEVER;
    }

    pub(super) fn lose(&mut self) {
        self.abandon();
        self.sr1 = self.sr1 & !(TXE | BTF) | ARLO;
        self.sr2 &= !(MSL | TRA);
        self.cr1 &= !STOP;
        self.goes_on = false;
    }

    /// Begins a step. If another device holds a line, it also holds the step.
    pub(super) fn begun(&mut self, cx: &Cx) {
        let (scl, sda) = self.lines(cx);
        self.low = 0;
        self.loses = false;
        self.low_since = (!sda).then_some(self.began);
        if !scl || !sda && matches!(self.step, Some((Step::Stop, _))) {
            self.hold(self.began);
        } else {
            self.expect_loss(self.began);
        }
    }
}
