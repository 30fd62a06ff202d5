//! Judges what Link-Status says about the DPR's own start: the reason, and the time since then.

use profile::{LinkStatusBits, ResetReason};

use crate::{Cause, What, bounds};

/// The reasons of its last start that the DPR may state; `None` if it may state any.
#[derive(Clone, Debug)]
pub(super) struct Reasons(Option<&'static [ResetReason]>);

impl Reasons {
    /// Returns the reasons that the DPR may state after power-on. After a short power-off it may find its RAM intact,
    /// and states a brown-out.
    pub(super) const fn power_on() -> Self {
        Self(Some(&[ResetReason::PowerOn, ResetReason::BrownOutOrOther]))
    }

    /// Returns the reasons that the DPR may state after the start in `event`: any reason for a cause that it cannot
    /// report.
    pub(super) const fn of(event: &What) -> Self {
        let What::Reset { cause, .. } = event else { return Self::power_on() };
        Self(match cause {
            Cause::PowerOn | Cause::BrownOut => return Self::power_on(),
            Cause::Pin => Some(&[ResetReason::Pin]),
            Cause::Watchdog => Some(&[ResetReason::Watchdog]),
            Cause::Lockup => Some(&[ResetReason::Lockup]),
            Cause::Software => Some(&[ResetReason::Software]),
            Cause::Wakeup => None,
        })
    }

    /// Returns, in words, the error in bits 6 and 12 to 14 of Link-Status, which state the reason of the last start.
    pub(super) fn wrong(&self, status: LinkStatusBits) -> Option<String> {
        let told = status.reset_reason();
        let unasked = [ResetReason::Watchdog, ResetReason::Lockup, ResetReason::BrownOutOrOther];
        let reason = told.filter(|told| self.0.is_none_or(|reasons| reasons.contains(told)));
        let right = reason.is_some_and(|reason| unasked.contains(&reason) == status.unasked_reset());
        (!right).then(|| format!("the last reset: {told:?}, status {:#06x}", status.bits()))
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Time {
    /// The instant, ns, at which the first image since the start was published, and how much, ns, this image
    /// understated the time since the start.
    first: Option<(u64, i128)>,
    last_ms: u32,
}

/// The tolerance of the stated time, ns: the DPR reads its clock before FRESH rises, with a resolution of 1 ms.
const RESOLUTION: u64 = 2_000_000;

impl Time {
    /// Returns, in words, the error of the time `told_ms` in an image of a DPR that started at `since`, ns.
    pub(super) fn wrong(&mut self, told_ms: u32, published: u64, since: u64) -> Option<String> {
        let back = told_ms < std::mem::replace(&mut self.last_ms, told_ms);
        let passed = published - since;
        let words = |what: &str| Some(format!("{told_ms} ms, {passed} ns after the start: {what}"));
        let ahead = i128::from(passed) - i128::from(told_ms) * 1_000_000;
        let Some((from, was)) = self.first else {
            self.first = Some((published, ahead));
            let plausible = (0..=i128::from(bounds::START)).contains(&ahead);
            return if plausible { None } else { words("not the time since then") };
        };
        if back {
            return words("back");
        }
        let drift = (published - from) / 1_000_000 * bounds::CRYSTALS_PPM;
        let off = (ahead - was).unsigned_abs();
        if off > u128::from(RESOLUTION + drift) { words("not the time since the image before") } else { None }
    }
}
