//! The carriers: the chip's own field, the external field detector, and RF collision avoidance.
//!
//! | covered | DS13541 |
//! |---|---|
//! | external field detector, own field, NFC initial field on (C8) with its guard time | External field detector, 4.4 |
//! | | NFC field on |
//! | the detector's thresholds for peer detection (2A, 2B bits 6:4) against the | the same sections; steps: |
//! | field's voltage | \[1\] |
//!
//! | left out | why |
//! |---|---|
//! | response field on (C9) | the link does not use it; it is reported |
//! | the step of the NFC field-on guard time (B15) | recorded for 0 only (75.9 µs); 75.5 µs per step is assumed |
//! | whether collision avoidance (C8) ends when it | not documented; it ends, with I_cac, when the detector sees |
//! | sees a field or when its time is up | a field at any instant of the window |
//!
//! \[1\] The field detector's thresholds, in either register, are 75, 105, 150, 205, 290, 400, 560 and 800 mV:
//! stm32duino/ST25R3916 `src/st25r3916_com.h`.

use crate::core::Core;
use crate::event::AirEvent;
use crate::interrupts::irq;
use crate::registers::{EN, EN_FD, TX_EN, reg};
use crate::report::Kind;
use crate::schedule::Due;

/// The values, mV, of either threshold of the field detector (registers 2A and 2B, bits 6:4).
const THRESHOLDS_MV: [u16; 8] = [75, 105, 150, 205, 290, 400, 560, 800];

#[derive(Clone, Debug, Default)]
pub(crate) struct Field {
    own: bool,
    outside: bool,
    detected: bool,
}

impl Field {
    pub(crate) fn own(&self) -> bool {
        self.own
    }

    pub(crate) fn outside(&self) -> bool {
        self.outside
    }

    pub(crate) fn detected(&self) -> bool {
        self.detected
    }

    /// Whether the oscillator and the transmitter are on. If so, the chip's carrier must be on, too.
    pub(crate) fn wanted(core: &Core) -> bool {
        core.powered() && core.oscillator() && core.operates(EN | TX_EN)
    }

    pub(crate) fn switch(&mut self, core: &mut Core, on: bool) {
        self.own = on;
        if on {
            core.emit(AirEvent::FieldOn);
        } else {
            core.cancel(Due::Apon);
            core.cancel(Due::Guard);
            core.emit(AirEvent::FieldOff);
        }
    }

    pub(crate) fn outside_is(&mut self, core: &mut Core, on: bool) {
        self.outside = on;
        self.look(core);
    }

    pub(crate) fn forget(&mut self) {
        self.detected = false;
    }

    fn sees(&self, core: &Core) -> bool {
        let threshold = |i: usize| THRESHOLDS_MV[usize::from(core.a(i) >> 4 & 7)];
        let needed =
            if self.detected { threshold(reg::FIELD_OFF_THRESHOLD) } else { threshold(reg::FIELD_ON_THRESHOLD) };
        // While the chip's own field is on, the detector cannot detect another field.
        core.powered()
            && self.outside
            && core.config().field_mv >= needed
            && !self.own
            && core.a(reg::OPERATION) & EN_FD != 0
    }

    /// Reports a finding if the threshold that ends the detection of a field is not below the one that begins it.
    pub(crate) fn has_hysteresis(core: &mut Core) {
        let (on, off) = (core.a(reg::FIELD_ON_THRESHOLD), core.a(reg::FIELD_OFF_THRESHOLD));
        if core.a(reg::OPERATION) & EN_FD != 0 && on >> 4 & 7 <= off >> 4 & 7 {
            core.note(Kind::FieldWithoutHysteresis(on, off));
        }
    }

    /// Starts the field detector's delay if the field differs from the detector's output, and otherwise cancels it.
    pub(crate) fn look(&mut self, core: &mut Core) {
        if self.sees(core) == self.detected {
            core.cancel(Due::FieldDetect);
        } else if !core.running(Due::FieldDetect) {
            let delay = core.config().field_detect_ns;
            core.plan_in(Due::FieldDetect, delay);
        }
    }

    pub(crate) fn detect(&mut self, core: &mut Core) {
        let sees = self.sees(core);
        if sees != self.detected {
            self.detected = sees;
            core.raise(if sees { irq::EON } else { irq::EOF });
            if sees && core.running(Due::FieldOn) {
                avoided(core);
            }
        }
    }

    /// Carries out NFC initial field on (C8) if no foreign field is detected within 4096 + n · 512 carrier cycles.
    pub(crate) fn initial_on(&self, core: &mut Core) {
        if core.a(reg::OPERATION) & EN_FD == 0 {
            core.note(Kind::CollisionAvoidanceBlind);
        }
        if self.detected {
            return avoided(core);
        }
        let n = u64::from(core.a(reg::AUX) & 0x03);
        let window = core.clock().cycles(4096 + n * 512);
        core.plan_in(Due::FieldOn, window);
    }
}

fn avoided(core: &mut Core) {
    core.cancel(Due::FieldOn);
    core.raise(irq::CAC);
}

/// Plans the interrupts after collision avoidance has switched the field on: I_apon, and I_cat at the end of the guard
/// time.
pub(crate) fn start_guard(core: &mut Core) {
    let apon = core.config().field_on_latency_ns;
    core.plan_in(Due::Apon, apon);
    let steps = 1 + u64::from(core.registers().b(reg::B_GUARD));
    let guard = core.clock().cycles(steps * 1024) + core.config().guard_extra_ns;
    core.plan_in(Due::Guard, guard);
}
