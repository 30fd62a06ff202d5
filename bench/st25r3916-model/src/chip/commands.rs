//! The chip's direct commands.
//!
//! | covered | DS13541 |
//! |---|---|
//! | Set default (C0, C1), Stop (C2), transmit (C4–C7), initial field on (C8), mask and unmask (D0, | 4.4 Direct |
//! | D1), measurements (D3, D8, D9, DF), reset gain (D5), regulators (D6), clear RSSI and FIFO (DA, | commands |
//! | DB), timers (E0–E3, E8), RC calibration (EA) |  |
//!
//! | left out | why |
//! |---|---|
//! | response field on (C9), AM state (D2), transparent mode (DC), capacitive sensor (DD, | the link uses none; each |
//! | DE), PPON2 timer (E4), NFC-A target states (CD, CE) | is reported |

use super::Chip;
use crate::config::Variant;
use crate::field::Field;
use crate::outgoing::Outgoing;
use crate::registers::reg;
use crate::report::{Kind, Space};
use crate::schedule::Due;
use crate::{supply, timers};

impl Chip {
    pub(super) fn command(&mut self, code: u8) {
        let needs_oscillator = matches!(code, 0xC4..=0xC9 | 0xD0..=0xDA | 0xDC..=0xDF | 0xE0 | 0xE2 | 0xE3 | 0xEA);
        if needs_oscillator && !self.core.oscillator() {
            return self.core.note(Kind::CommandWithoutOscillator(code));
        }
        let core = &mut self.core;
        match code {
            0xC0 | 0xC1 => self.set_default(),
            0xC2 | 0xC3 => self.stop_all(),
            0xC4..=0xC7 => self.transmit(code),
            0xC8 => self.field.initial_on(core),
            0xD0 => {
                self.let_go();
                self.receiver.mask();
            }
            0xD1 => {
                if core.config().unmask_clears_fifo && !self.receiver.busy() {
                    self.transmitter.disturb(core);
                    self.fifo.clear();
                }
                self.receiver.unmask(core.now());
                if timers::masking_receive(core) {
                    self.receiver.mask_timer_ends(core.now());
                    core.cancel(Due::MaskReceive);
                }
                self.check_silence();
                if self.core.target() {
                    Field::has_hysteresis(&mut self.core);
                }
                supply::tuning_suits(&mut self.core, &self.field);
            }
            0xD3 | 0xD9 => {
                core.note(Kind::ConstantMeasurement(code));
                let config = self.config();
                self.measure(reg::AD_RESULT, if code == 0xD3 { config.amplitude } else { config.phase });
            }
            0xDF => self.measure(reg::AD_RESULT, supply::measured(&self.core)),
            0xD5 => core.set_a(reg::GAIN, 0),
            0xD6 => {
                supply::suits(core);
                // With reg_s (register 2C, bit 7) set, the firmware chooses the regulated voltage, and the display
                // register shows it.
                let regulator = core.a(reg::REGULATOR);
                let shown =
                    if regulator & 0x80 != 0 { (regulator & 0x78) << 1 } else { core.config().regulator_display };
                self.result(Space::B, reg::B_REGULATOR, shown, self.config().adjust_regulators_ns);
            }
            0xD8 => {
                let (shown, ns) = (core.config().driver_timing_display, core.config().measurement_ns);
                self.result(Space::B, reg::B_DRIVER_TIMING, shown, ns);
            }
            0xDA => core.set_a(reg::RSSI, 0),
            0xDB => self.clear_fifo(),
            0xE0 => timers::start_general_purpose(core),
            0xE1 => timers::start_wake_up(core),
            0xE2 => timers::start_mask_receive(core),
            0xE3 => timers::start_no_response(core),
            0xE8 => core.cancel(Due::NoResponse),
            0xEA if core.config().variant == Variant::St25r3916b => {
                let (shown, ns) = (core.config().rc_calibration_display, core.config().rc_calibration_ns);
                self.result(Space::B, reg::B_RC_CALIBRATION, shown, ns);
            }
            _ => core.note(Kind::UnmodelledCommand(code)),
        }
    }

    /// Starts the transmission of command `code`: C4 with CRC, C5 without CRC, C6 a REQA, C7 a WUPA.
    fn transmit(&mut self, code: u8) {
        let core = &mut self.core;
        let frame = match code {
            0xC4 => Outgoing::described(core, true),
            0xC5 => Outgoing::described(core, false),
            0xC6 => Outgoing::short(core, 0x26),
            _ => Outgoing::short(core, 0x52),
        };
        if let Some(frame) = frame {
            self.send(frame);
        }
    }

    fn clear_fifo(&mut self) {
        self.settle();
        let Self { core, fifo, transmitter, receiver, .. } = self;
        transmitter.disturb(core);
        fifo.clear();
        core.cancel(Due::TxLevel);
        receiver.plan_level(core, fifo);
        if core.config().db_clears_irqs {
            core.clear_interrupts();
        }
    }

    fn stop_all(&mut self) {
        self.break_off();
        self.let_go();
        self.receiver.mask_idle(&self.core);
        self.fifo.clear();
        if self.config().stop_clears_irqs {
            self.core.clear_interrupts();
        }
        self.measuring = None;
        for due in [
            Due::FieldOn,
            Due::Apon,
            Due::Guard,
            Due::CommandDone,
            Due::MaskReceive,
            Due::NoResponse,
            Due::GeneralPurpose,
            Due::WakeUp,
            Due::Answer,
        ] {
            self.core.cancel(due);
        }
    }

    fn result(&mut self, space: Space, i: usize, value: u8, ns: u64) {
        self.measuring = Some((space, i as u8, value));
        self.core.plan_in(Due::CommandDone, ns);
    }

    fn measure(&mut self, i: usize, value: u8) {
        self.result(Space::A, i, value, self.config().measurement_ns);
    }

    /// Reports a target that is armed while it could answer without its controller.
    fn check_silence(&mut self) {
        // The bits d_ac_ap2p, d_212_424_1r and d_106_ac_a disable automatic answers.
        let silent = self.core.a(reg::PASSIVE_TARGET) & 0x0D == 0x0D;
        if self.core.target() && !silent && self.core.load_modulator() {
            self.core.note(Kind::AutomaticAnswersEnabled);
        }
    }
}
