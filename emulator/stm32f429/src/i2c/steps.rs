//! The steps of a transfer (start, address, data byte, stop): when each begins and ends, and which flags it sets
//! (RM0090 27.3.3).

use super::*;

impl I2c {
    pub(super) fn bit(&self) -> u64 {
        let count = u64::from(self.ccr & 0xFFF).max(1);
        let periods = match self.ccr & (FAST | DUTY) {
            bits if bits & FAST == 0 => 2 * count,
            FAST => 3 * count,
            _ => 25 * count,
        };
        periods * u64::from(self.pclk)
    }

    pub(super) fn begin(&mut self, step: Step, from: Cycle, cx: &Cx) {
        let bits = match step {
            Step::Start | Step::Stop => 1,
            _ => 9,
        };
        self.step = Some((step, None));
        self.began = from;
        self.due = from + bits * self.bit();
        self.begun(cx);
    }

    pub(super) fn go_on(&mut self, from: Cycle, cx: &mut Cx) {
        if self.step.is_some() || self.cr1 & PE == 0 {
            return;
        }
        let is_master = self.sr2 & MSL != 0;
        // Until software has cleared SB and ADDR, SCL stays low.
        if self.sr1 & (SB | ADDR) != 0 {
            if self.sr1 & SB != 0 && self.cr1 & STOP != 0 {
                self.begin(Step::Stop, from, cx);
            }
            return;
        }
        if is_master && self.cr1 & STOP != 0 {
            self.begin(Step::Stop, from, cx);
        } else if self.cr1 & START != 0 && (is_master || self.sr2 & BUSY == 0) {
            let Some((scl, sda)) = self.pins(cx) else {
                cx.find(FindingKind::Misuse, "a start without both pins connected: the bus is never free");
                return;
            };
            if !cx.pads.is_open_drain(scl) || !cx.pads.is_open_drain(sda) {
                cx.find(
                    FindingKind::Misuse,
                    "a start with a pin that is no open drain: peripherals cannot pull it low",
                );
            }
            if self.start_lost {
                return;
            }
            self.begin(Step::Start, from, cx);
        } else if is_master && self.sr1 & AF == 0 {
            if self.sr2 & TRA != 0 {
                if self.sr1 & TXE == 0 && self.goes_on {
                    self.sr1 |= TXE;
                    self.begin(Step::Write(self.data), from, cx);
                }
            } else if self.goes_on && self.sr1 & BTF == 0 {
                self.begin(Step::Read, from, cx);
            }
        }
    }

    fn pins(&self, cx: &Cx) -> Option<(emulator_part::Pin, emulator_part::Pin)> {
        let scl = cx.pins(Signal::I2c(self.number, I2cPin::Scl))[0]?;
        let sda = cx.pins(Signal::I2c(self.number, I2cPin::Sda))[0]?;
        Some((scl, sda))
    }

    fn acknowledges(&self) -> bool {
        !self.is_last && if self.cr1 & POS != 0 { self.held_ack } else { self.cr1 & ACK != 0 }
    }

    pub(super) fn finish<W: Wires>(&mut self, cx: &mut Cx, wires: &mut W) {
        let at = self.due;
        if self.loses {
            self.lose();
            return;
        }
        self.mark_low(at);
        let Some((step, answered)) = self.step.take() else { return };
        self.due = NEVER;
        let event = match step {
            Step::Start => None,
            Step::Address(byte) => Some(I2cEvent::Start(byte)),
            Step::Write(byte) => Some(I2cEvent::Write(byte)),
            Step::Read => Some(I2cEvent::Read(self.acknowledges())),
            Step::Stop => Some(I2cEvent::Stop),
        };
        let answer = match (answered, event, self.pins(cx)) {
            (Some(answer), _, _) => answer,
            (None, Some(event), Some((scl, sda))) => {
                let answer = wires.i2c(at, scl, sda, event);
                if answer.stretched_ns != 0 {
                    self.step = Some((step, Some(answer)));
                    self.due = at + cx.clocks.cycles_of_ps(answer.stretched_ns.saturating_mul(1000)).max(1);
                    return;
                }
                answer
            }
            _ => I2cAnswer::NOBODY,
        };
        let (_, sda) = self.lines(cx);
        if step == Step::Start && !sda {
            // Another device holds SDA low, so no start condition can be made.
            self.lose();
            return;
        }
        self.done(step, answer);
        self.go_on(at, cx);
    }

    fn done(&mut self, step: Step, mut answer: I2cAnswer) {
        // Another device that holds the ninth bit low gives an acknowledge.
        answer.acknowledged |= self.low & 1 << 8 != 0;
        let zeros = (0..8).fold(0_u8, |zeros, bit| zeros << 1 | u8::from(self.low >> bit & 1 != 0));
        answer.data &= !zeros;
        match step {
            Step::Start => {
                self.cr1 &= !START;
                self.sr1 = self.sr1 & !(TXE | BTF) | SB;
                self.sr2 = self.sr2 & !TRA | MSL | BUSY;
                self.status_read = false;
                self.goes_on = false;
                self.is_last = false;
            }
            Step::Address(byte) => {
                if answer.acknowledged {
                    self.sr1 |= ADDR;
                    if byte & 1 == 0 {
                        self.sr2 |= TRA;
                    }
                    self.held_ack = self.cr1 & ACK != 0;
                } else {
                    self.sr1 |= AF;
                }
                self.status_read = false;
            }
            Step::Write(_) => {
                if !answer.acknowledged {
                    self.sr1 |= AF;
                } else if self.sr1 & TXE != 0 {
                    self.sr1 |= BTF;
                }
            }
            Step::Read => {
                self.goes_on = self.acknowledges();
                self.is_last = false;
                self.held_ack = self.cr1 & ACK != 0;
                if self.sr1 & RXNE != 0 {
                    self.shifted = answer.data;
                    self.sr1 |= BTF;
                } else {
                    self.data = answer.data;
                    self.sr1 |= RXNE;
                }
            }
            Step::Stop => {
                self.cr1 &= !STOP;
                self.sr1 &= !(TXE | SB);
                if self.sr2 & TRA != 0 {
                    self.sr1 &= !BTF;
                }
                self.sr2 &= !(MSL | BUSY | TRA);
                self.goes_on = false;
            }
        }
    }
}
