//! How far Reported-Position is from where the aircraft was: what the judge cannot know, since the flight is no part of
//! the event log.

use std::sync::Arc;

use bench_judge::{Event, What};
use gnss_sim::{Flight, Geodetic, TangentPlane};
use profile::ReportedPosition;

/// Holds each Reported-Position that HORUS sends against the flight, at the tick that it was made for.
#[derive(Clone, Debug)]
pub(super) struct Truth {
    flight: Arc<Flight>,
    /// HORUS's last tick, and the one before it, ns.
    ticks: [Option<u64>; 2],
    worst_m: Option<f64>,
}

impl Truth {
    pub(super) fn new(flight: Arc<Flight>) -> Self {
        Self { flight, ticks: [None; 2], worst_m: None }
    }

    /// Takes the next event.
    pub(super) fn take(&mut self, event: &Event) {
        match &event.what {
            What::Tick => self.ticks = [Some(event.at), self.ticks[0]],
            What::Sent { started, bytes, whole: true, .. } => {
                let Some(tick) = self.ticks.into_iter().flatten().find(|tick| tick <= started) else { return };
                // LEN, then Reported-Position, in the first frame of a cycle.
                let object =
                    bytes.get(1..=ReportedPosition::SIZE).and_then(|bytes| ReportedPosition::verify(bytes).ok());
                let Some(values) = object.map(ReportedPosition::values) else { return };
                if values.status.position_valid() {
                    let was = self.flight.state(tick as f64 / 1e9).position;
                    let error = along_ground_m(was, values.latitude, values.longitude);
                    self.worst_m = Some(self.worst_m.map_or(error, |worst| worst.max(error)));
                }
            }
            _ => {}
        }
    }

    /// The worst error along the ground, m; nothing if there was never a position.
    pub(super) fn worst_m(&self) -> Option<f64> {
        self.worst_m
    }
}

fn along_ground_m(was: Geodetic, latitude: f64, longitude: f64) -> f64 {
    let [north, east, _] = TangentPlane::new(was).to_ned(Geodetic { latitude, longitude, height: was.height });
    north.hypot(east)
}

#[cfg(test)]
mod tests {
    use profile::{ReportedStatus, ReportedValues};

    use super::*;

    fn sent(started: u64, latitude: f64, longitude: f64, valid: bool) -> Event {
        let status = ReportedStatus::new().with_position_valid(valid);
        let values = ReportedValues { status, latitude, longitude, ..ReportedValues::absent(10) };
        let bytes = [&[65], ReportedPosition::seal(&values).as_bytes().as_slice(), &[0, 0]].concat();
        Event { at: started + 1, what: What::Sent { started, bit_rate: 424_000, bytes: bytes.into(), whole: true } }
    }

    #[test]
    fn the_worst_error_is_that_against_the_tick_before_the_frame() {
        let flight = Arc::new(Flight::new(1, 10.0));
        let mut truth = Truth::new(flight.clone());
        let tick = |seconds: u64| Event { at: seconds * 1_000_000_000, what: What::Tick };
        let at = |seconds: f64| flight.state(seconds).position;
        assert_eq!(truth.worst_m(), None);
        truth.take(&sent(0, 0.0, 0.0, true));
        assert_eq!(truth.worst_m(), None, "there was no tick");
        truth.take(&tick(4));
        truth.take(&sent(4_000_000_001, 0.0, 0.0, false));
        assert_eq!(truth.worst_m(), None, "there was no position");
        truth.take(&sent(4_000_000_001, at(4.0).latitude, at(4.0).longitude, true));
        assert!(truth.worst_m().is_some_and(|worst| worst < 1e-3));
        truth.take(&tick(5));
        // A frame of the tick before.
        truth.take(&sent(4_900_000_000, at(4.0).latitude + 2.0 / 111_200.0, at(4.0).longitude, true));
        assert!(truth.worst_m().is_some_and(|worst| (worst - 2.0).abs() < 0.01), "{truth:?}");
        truth.take(&sent(5_000_000_001, at(5.0).latitude, at(5.0).longitude, true));
        assert!(truth.worst_m().is_some_and(|worst| (worst - 2.0).abs() < 0.01));
    }
}
