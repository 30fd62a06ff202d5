//! Judges the DPR's own health in Port-Status: clock, passes over the flash, faults found, reason of the last safe
//! state.
//!
//! | field | right value |
//! |---|---|
//! | timestamp | that of Link-Status, or up to [`bounds::PORT_BEFORE_LINK_MS`] earlier, and never decreasing |
//! | passes over the flash | never decreasing; the number for which there was time, or fewer if the SSI was misused |
//! | integrity faults, stuck bits, buffers out of use | 0 unless [`Excuse::RamFault`] holds, and never decreasing |
//! | bit 6 | set while buffers are out of use |
//! | reason of the last safe state | 0 after power-on; the same value between two starts |
//!
//! Any reason of a safe state is right after a reset, because the log does not show whether there was a safe state.

use profile::PortValues;

use crate::bounds;
use crate::disturbance::{Disturbances, Excuse};
use crate::read::Reading;

#[derive(Clone, Debug)]
pub(super) struct HealthFields {
    since: u64,
    /// Whether the DPR may have been in its safe state before its last start.
    stopped: bool,
    /// Whether the flight controller has used more of the DPR's processor time than its share.
    slow: bool,
    last: Option<PortValues>,
}

impl HealthFields {
    /// Returns the state after power-on of the DPR at the instant `at`, ns.
    pub(super) const fn powered(at: u64) -> Self {
        Self { since: at, stopped: false, slow: false, last: None }
    }

    /// Returns the state after the DPR has restarted, or has lost its supply, at the instant `at`, ns.
    pub(super) const fn again(at: u64) -> Self {
        Self { stopped: true, ..Self::powered(at) }
    }

    pub(super) fn slowed(&mut self) {
        self.slow = true;
    }

    /// Returns, in words, the error in the health fields of an image published at `published`, ns.
    pub(super) fn wrong(
        &mut self,
        values: &PortValues,
        reading: &Reading,
        published: u64,
        disturbances: &Disturbances,
    ) -> Option<String> {
        // In the first millisecond after a start Port-Status has no values yet, and its timestamp is zero.
        let last = self.last.replace(*values).filter(|last| last.timestamp > 0).unwrap_or(*values);
        let of_ram = disturbances.excuse(Excuse::RamFault, published);
        let found = |values: &PortValues| [values.integrity_faults, values.stuck_bits, values.buffers_out_of_use];
        let back = |was: u32, is: u32| is.wrapping_sub(was) > u32::MAX / 2;
        let passed = published.saturating_sub(self.since);
        let [fewest, most] = [bounds::FLASH_PASS_LONGEST, bounds::FLASH_PASS_SHORTEST].map(|pass| passed / pass);
        let passes = u64::from(values.flash_passes);
        let early = match &reading.link {
            Some(Ok(link)) => link.timestamp.wrapping_sub(values.timestamp) > bounds::PORT_BEFORE_LINK_MS,
            _ => false,
        };
        let stop = values.last_stop;
        let coded = stop == 0 || self.stopped && bounds::STOP_CAUSES.contains(&(stop >> 24));
        let wrong = if early || back(last.timestamp, values.timestamp) {
            "its time"
        } else if passes > most || passes < fewest && !self.slow || values.flash_passes < last.flash_passes {
            "passes over the flash"
        } else if !of_ram && found(values) != [0; 3] {
            "faults of memory that nothing has caused"
        } else if found(values).into_iter().zip(found(&last)).any(|(is, was)| is < was) {
            "faults of memory that are counted no more"
        } else if values.status.buffers_out_of_use() != (values.buffers_out_of_use > 0) {
            "whether buffers are out of use"
        } else if !coded || stop != last.last_stop {
            "the reason of the last safe state"
        } else {
            return None;
        };
        Some(format!("{wrong}: {values:?}"))
    }
}

#[cfg(test)]
mod tests {
    use profile::{Layout, LinkStatus, LinkValues, PortStatusBits};

    use super::*;
    use crate::Event;
    use crate::testing::{RECEIVE_BIT, injected};

    /// The health fields of a flawless DPR, 1 s after its start.
    const RIGHT: PortValues = {
        let values = sound();
        PortValues { timestamp: 990, ..values }
    };
    const AT: u64 = 1_000_000_000;

    const fn sound() -> PortValues {
        PortValues {
            timestamp: 0,
            status: PortStatusBits::from_bits(0),
            uplinks_accepted: 0,
            commands_carried_out: 0,
            last_command_timestamp: 0,
            last_command: 0,
            base_station_age_ms: 0,
            flight_controller_age_ms: 0,
            violations: profile::Violations::new(),
            integrity_faults: 0,
            flash_passes: 0,
            stuck_bits: 0,
            buffers_out_of_use: 0,
            last_stop: 0,
        }
    }

    fn link(timestamp: u32) -> Reading {
        let values = LinkValues { timestamp, ..LinkValues::default() };
        Reading::of(Layout::for_receivers(1).unwrap(), AT, AT, 0, LinkStatus::seal(&values).as_bytes())
    }

    fn is_right(health: &mut HealthFields, values: PortValues, at: u64) -> bool {
        health.wrong(&values, &link(1_000), at, &Disturbances::default()).is_none()
    }

    fn once(values: PortValues) -> bool {
        is_right(&mut HealthFields::powered(0), values, AT)
    }

    #[test]
    fn port_status_is_stamped_at_or_just_before_link_status() {
        let earliest = 1_000 - bounds::PORT_BEFORE_LINK_MS;
        for (timestamp, right) in [(1_000, true), (1_001, false), (earliest, true), (earliest - 1, false)] {
            assert_eq!(once(PortValues { timestamp, ..RIGHT }), right, "{timestamp}");
        }
        let mut health = HealthFields::powered(0);
        assert!(is_right(&mut health, RIGHT, AT));
        assert!(!is_right(&mut health, PortValues { timestamp: 989, ..RIGHT }, AT));
    }

    #[test]
    fn passes_over_the_flash_are_as_many_as_there_was_time_for() {
        let passes =
            |flash_passes, at| is_right(&mut HealthFields::powered(0), PortValues { flash_passes, ..RIGHT }, at);
        let (longest, shortest) = (bounds::FLASH_PASS_LONGEST, bounds::FLASH_PASS_SHORTEST);
        assert_eq!((passes(0, longest - 1), passes(0, longest), passes(1, longest)), (true, false, true));
        assert_eq!((passes(3, 3 * shortest), passes(3, 3 * shortest - 1)), (true, false));
        let mut slow = HealthFields::powered(0);
        slow.slowed();
        assert!(is_right(&mut slow, RIGHT, 9 * longest), "the flight controller took the time");
        let mut health = HealthFields::powered(0);
        assert!(is_right(&mut health, PortValues { flash_passes: 2, ..RIGHT }, AT));
        assert!(!is_right(&mut health, PortValues { flash_passes: 1, ..RIGHT }, AT));
    }

    #[test]
    fn faults_of_memory_have_a_cause_and_are_not_forgotten() {
        let bits = PortStatusBits::new().with_buffers_out_of_use(true);
        let found = [
            PortValues { integrity_faults: 1, ..RIGHT },
            PortValues { stuck_bits: 1, ..RIGHT },
            PortValues { buffers_out_of_use: 1, status: bits, ..RIGHT },
        ];
        let mut hit = Disturbances::default();
        hit.take(&Event { at: 5, what: injected(RECEIVE_BIT, 5) });
        for values in found {
            assert!(!once(values), "{values:?}");
            let mut health = HealthFields::powered(0);
            let mut right = |values| health.wrong(&values, &link(1_000), AT, &hit).is_none();
            assert!(right(values) && right(values) && !right(RIGHT), "{values:?}");
        }
        let right = |values| HealthFields::powered(0).wrong(&values, &link(1_000), AT, &hit).is_none();
        assert!(!right(PortValues { buffers_out_of_use: 1, ..RIGHT }), "bit 6 says otherwise");
        assert!(!right(PortValues { status: bits, ..RIGHT }));
    }

    #[test]
    fn a_safe_states_cause_appears_only_after_a_restart_and_stays() {
        let stops = |mut health: HealthFields, last_stop| is_right(&mut health, PortValues { last_stop, ..RIGHT }, AT);
        for (cause, right) in [(0, true), (1, true), (15, true), (16, false), (255, false)] {
            assert_eq!(stops(HealthFields::again(0), cause << 24), right, "{cause}");
            assert_eq!(stops(HealthFields::powered(0), cause << 24), cause == 0, "{cause}");
        }
        assert!(!stops(HealthFields::again(0), 7), "no cause");
        let mut health = HealthFields::again(0);
        assert!(is_right(&mut health, PortValues { last_stop: 1 << 24, ..RIGHT }, AT));
        assert!(!is_right(&mut health, PortValues { last_stop: 2 << 24, ..RIGHT }, AT));
        // The first Port-Status after a start does not yet state the reason of the last safe state.
        let mut health = HealthFields::again(0);
        let mut right = |values, ms| health.wrong(&values, &link(ms), AT, &Disturbances::default()).is_none();
        assert!(right(PortValues { timestamp: 0, ..RIGHT }, 10));
        assert!(right(PortValues { last_stop: 1 << 24, ..RIGHT }, 1_000));
    }
}
