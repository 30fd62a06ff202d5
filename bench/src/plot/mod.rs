//! A run's flight as a picture: the true position, the positions of each receiver and of HORUS, the excluded receivers,
//! and the time that each cycle took to become readable.

mod draw;

use bench_judge::read::{Frame, Placed, State, Values};
use bench_judge::{Event, What};
use gnss_sim::{Flight, Geodetic, TangentPlane};
use profile::{GpsValues, Layout, MAX_RECEIVERS, ReportedValues};

/// The longest time from a frame's end to the rise of FRESH for its cycle, ns.
const READABLE_WITHIN: u64 = 5_000_000;

/// A position relative to the picture's origin: metres north, east and up.
type Place = [f64; 3];

#[derive(Clone, Debug, Default)]
struct Cycle {
    tick: u64,
    ended: u64,
    /// The positions of the cycle's objects, Reported-Position first; `None` for a position that is not valid.
    positions: [Option<Geodetic>; 1 + MAX_RECEIVERS],
    excluded: u8,
    latency: Option<u64>,
}

/// The data from which a run's picture is drawn.
#[derive(Clone, Debug)]
pub struct History {
    layout: Layout,
    ticks: [Option<u64>; 2],
    cycles: Vec<Cycle>,
    title: String,
}

impl History {
    /// Returns an empty history. `title` is the heading of the picture.
    #[must_use]
    pub fn new(layout: Layout, title: String) -> Self {
        Self { layout, ticks: [None; 2], cycles: vec![], title }
    }

    /// Takes the next event of the log.
    pub fn take(&mut self, event: &Event) {
        match &event.what {
            What::Tick => self.ticks = [Some(event.at), self.ticks[0]],
            What::Sent { started, bytes, whole: true, .. } => {
                let Some(tick) = self.ticks.into_iter().flatten().find(|tick| tick <= started) else { return };
                if self.cycles.last().is_none_or(|cycle| cycle.tick != tick) {
                    self.cycles.push(Cycle { tick, ..Cycle::default() });
                }
                let Some(cycle) = self.cycles.last_mut() else { return };
                cycle.ended = event.at;
                for object in Frame::of(self.layout, bytes, true).objects {
                    cycle.object(&object);
                }
            }
            What::Fresh { high: true, .. } => {
                let cycle = self.cycles.iter_mut().rev().find(|cycle| cycle.ended <= event.at);
                if let Some(cycle) = cycle
                    && event.at - cycle.ended < READABLE_WITHIN
                {
                    cycle.latency.get_or_insert(event.at - cycle.tick);
                }
            }
            _ => {}
        }
    }

    /// Draws the picture as an SVG document. `flight` has the aircraft's true positions; it is `None` if a recording
    /// was played.
    ///
    /// # Errors
    ///
    /// An error of the drawing library; none is expected, because the library draws into a string.
    pub fn svg(&self, flight: Option<&Flight>) -> Result<String, Box<dyn std::error::Error>> {
        let position = |cycle: &Cycle| cycle.positions.iter().flatten().next().copied();
        let origin = flight
            .map(|flight| flight.state(0.0).position)
            .or_else(|| self.cycles.iter().find_map(position))
            .unwrap_or(Geodetic { latitude: 0.0, longitude: 0.0, height: 0.0 });
        let plane = TangentPlane::new(origin);
        let place = |position: Geodetic| {
            let [north, east, _] = plane.to_ned(position);
            [north, east, position.height]
        };
        let cycles = self.cycles.iter().map(|cycle| {
            let seconds = cycle.tick as f64 / 1e9;
            draw::Drawn {
                seconds,
                truth: flight.map(|flight| place(flight.state(seconds).position)),
                said: cycle.positions.map(|position| position.map(place)),
                excluded: cycle.excluded,
                latency_ms: cycle.latency.map(|ns| ns as f64 / 1e6),
            }
        });
        draw::svg(&self.title, self.layout.receivers(), &cycles.collect::<Vec<_>>())
    }
}

impl Cycle {
    fn object(&mut self, object: &Placed) {
        let State::Valid { values, .. } = &object.state else { return };
        let (valid, latitude, longitude, height, excluded) = match values {
            Values::Reported(ReportedValues { status, latitude, longitude, altitude, .. }) => {
                (status.position_valid(), *latitude, *longitude, *altitude, false)
            }
            Values::Gps(GpsValues { status, latitude, longitude, altitude, .. }) => {
                (status.position_valid(), *latitude, *longitude, *altitude, status.excluded())
            }
        };
        if excluded {
            self.excluded |= 1 << (object.index - 1);
        }
        if let Some(place) = self.positions.get_mut(object.index).filter(|_| valid) {
            *place = Some(Geodetic { latitude, longitude, height });
        }
    }
}

#[cfg(test)]
mod tests {
    use profile::{GpsObject, GpsStatus, Identifier, ReportedPosition, ReportedStatus};

    use super::*;

    const MS: u64 = 1_000_000;

    fn sent(tick: u64, latitude: f64, excluded: bool) -> Event {
        let reported = ReportedValues {
            status: ReportedStatus::new().with_position_valid(true),
            latitude,
            longitude: 8.0,
            altitude: 500.0,
            ..ReportedValues::absent(10)
        };
        let gps = GpsValues {
            status: GpsStatus::new().with_position_valid(true).with_excluded(excluded),
            latitude,
            longitude: 8.0,
            altitude: 500.0,
            ..GpsValues::absent(10)
        };
        let reported = ReportedPosition::seal(&reported);
        let gps = GpsObject::seal(Identifier::gps(1), &gps);
        let bytes = [&[125], reported.as_bytes().as_slice(), gps.as_bytes().as_slice(), &[0, 0]].concat();
        let what = What::Sent { started: tick + 100_000, bit_rate: 424_000, bytes: bytes.into(), whole: true };
        Event { at: tick + 3 * MS, what }
    }

    fn history(events: &[Event]) -> History {
        let mut history = History::new(Layout::for_receivers(1).expect("one"), "A <flight> & more".to_owned());
        events.iter().for_each(|event| history.take(event));
        history
    }

    fn tick(at: u64) -> Event {
        Event { at, what: What::Tick }
    }

    fn fresh(at: u64) -> Event {
        Event { at, what: What::Fresh { high: true, offered: None } }
    }

    #[test]
    fn a_cycle_has_the_positions_sent_in_it_and_its_latency() {
        let events = [
            fresh(MS),
            tick(10 * MS),
            sent(10 * MS, 47.0, false),
            fresh(13 * MS + 70_000),
            fresh(14 * MS),
            tick(20 * MS),
            sent(20 * MS, 47.1, true),
            tick(30 * MS),
            fresh(31 * MS),
        ];
        let history = history(&events);
        let latencies: Vec<_> = history.cycles.iter().map(|cycle| (cycle.tick, cycle.latency)).collect();
        assert_eq!(latencies, [(10 * MS, Some(3 * MS + 70_000)), (20 * MS, None)], "the last one is too late");
        assert_eq!(history.cycles[1].excluded, 1);
        assert_eq!(history.cycles[0].positions[1].map(|position| position.latitude), Some(47.0));
        assert_eq!(history.cycles[0].positions[2], None);
    }

    #[test]
    fn the_picture_is_complete_even_for_a_run_without_a_cycle() {
        let events: Vec<Event> = (1..20_u64)
            .flat_map(|number| {
                let at = number * 10 * MS;
                [tick(at), sent(at, 47.0 + number as f64 * 1e-6, number > 9), fresh(at + 3 * MS + 70_000)]
            })
            .collect();
        let flight = Flight::new(1, 1.0);
        for (history, flight) in [
            (history(&events), Some(&flight)),
            (history(&events), None),
            (history(&[]), None),
            (history(&[]), Some(&flight)),
        ] {
            let svg = history.svg(flight).expect("drawn");
            assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
            for words in ["Ground track", "Height", "Sample to readable", "A &lt;flight&gt; &amp; more"] {
                assert!(svg.contains(words), "{words}");
            }
        }
        let shaded = |history: &History| history.svg(None).expect("drawn").matches("opacity=\"0.2\"").count();
        assert_eq!(shaded(&history(&events[..24])), 0, "nobody was excluded");
        assert!(shaded(&history(&events)) > 0, "GPS1 was");
    }
}
