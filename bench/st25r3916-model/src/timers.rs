//! The chip's timers: mask-receive, no-response, general purpose, wake-up.
//!
//! | covered | DS13541 |
//! |---|---|
//! | the four timers (E0 to E3, E8), their steps, and the triggers of the general purpose timer | Timers, 4.5 |
//! | | registers 0F–14, 32 |
//!
//! | left out | why |
//! |---|---|
//! | wake-up mode (`wu`), PPON2 timer (E4) | the link uses neither; each is reported |
//! | general purpose timer in NFC active mode (12, gptc = 3), nrt_emv and nrt_nfc (12) | the link uses none; the bits |
//! | | are kept, and reported when set |

use crate::core::Core;
use crate::interrupts::irq;
use crate::registers::reg;
use crate::schedule::Due;

/// The triggers of the general purpose timer (12, gptc).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Trigger {
    EndOfReception = 1,
    StartOfReception = 2,
}

pub(crate) fn start_no_response(core: &mut Core) {
    let n = u64::from(core.registers().a16(reg::NO_RESPONSE));
    if n == 0 {
        return;
    }
    let step = if core.a(reg::TIMERS) & 0x01 != 0 { 4096 } else { 64 };
    let ns = core.clock().cycles(n * step) + core.config().no_response_extra_ns;
    core.plan_in(Due::NoResponse, ns);
}

pub(crate) fn start_mask_receive(core: &mut Core) {
    let step = if core.a(reg::TIMERS) & 0x08 != 0 { 512 } else { 64 };
    let ns = core.clock().cycles(u64::from(core.a(reg::MASK_RECEIVE)) * step);
    core.plan_in(Due::MaskReceive, ns);
}

pub(crate) fn masking_receive(core: &Core) -> bool {
    core.running(Due::MaskReceive)
}

pub(crate) fn start_general_purpose(core: &mut Core) {
    let n = u64::from(core.registers().a16(reg::GENERAL_PURPOSE));
    let ns = core.clock().cycles(n * 8);
    core.plan_in(Due::GeneralPurpose, ns);
}

/// Starts the general purpose timer, if `trigger` is the trigger that register 12 selects.
pub(crate) fn general_purpose_trigger(core: &mut Core, trigger: Trigger) {
    if core.a(reg::TIMERS) >> 5 == trigger as u8 {
        start_general_purpose(core);
    }
}

pub(crate) fn start_wake_up(core: &mut Core) {
    let w = core.a(reg::WAKE_UP);
    // wur selects steps of 10 ms (1) or 100 ms (0), and wut selects 1 to 8 such steps. The RC oscillator is assumed to
    // be exact.
    let step = if w & 0x80 != 0 { 10_000_000 } else { 100_000_000 };
    core.plan_in(Due::WakeUp, step * (1 + u64::from((w >> 4) & 0x07)));
}

/// Ends the wake-up timer, which raises an interrupt if wto (register 32, bit 3) is set. The measurement at wake-up is
/// not modelled.
pub(crate) fn wake_up(core: &mut Core) {
    if core.a(reg::WAKE_UP) & 0x08 != 0 {
        core.raise(irq::WT);
    }
}
