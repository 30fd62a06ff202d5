//! The DPR's microcontroller as a [`Part`]: the crate `nrf52840-model` with the engine's clock.

use std::num::NonZeroU64;

use nrf52840_model::{CORE_HZ, FindingKind as ModelFinding, Nrf52840};
use rigless::emulator::CoreSpec;
use rigless::time::VirtualNanos;

use super::{FindingKind, Part, Rate, Supply};

impl Part for Nrf52840 {
    const NAME: &'static str = "nRF52840";

    fn core(&self) -> CoreSpec {
        self.core_spec(NonZeroU64::new(CORE_HZ).expect("not zero"))
    }

    /// 64 MHz from either source (PS 5.4); the internal oscillator's error is left out, as the cycle counter leaves it
    /// out.
    fn rate(&self) -> Rate {
        Rate { hz: CORE_HZ, ppb: self.settings().hfxo_ppb }
    }

    /// RESETREAS tells power-on and brown-out apart from the rest, and not from each other (PS 5.3).
    fn supply_failed(&mut self, _how: Supply) {
        Nrf52840::supply_failed(self);
    }

    fn locked_up(&mut self, at: u64) {
        self.lockup(VirtualNanos(at));
    }

    fn finding_count(&self) -> usize {
        Nrf52840::findings(self).len()
    }

    fn findings(&self) -> Vec<(FindingKind, u64, String)> {
        let found = Nrf52840::findings(self).iter();
        found
            .map(|finding| {
                let kind = match finding.kind {
                    ModelFinding::Unmodelled => FindingKind::Unmodelled,
                    ModelFinding::Misuse | ModelFinding::Anomaly => FindingKind::Misuse,
                };
                (kind, finding.at, format!("{}: {} ({:#x})", finding.instance, finding.what, finding.value))
            })
            .collect()
    }
}
