//! Makes logs for the tests of the rules. A test starts with a flawless run and makes a change that the rule has to
//! find.

use profile::{GpsValues, Identifier, Layout, ReportedValues};

use crate::disturbance::{Conduct, Harm, Memory};
use crate::rules::Rule;
use crate::{
    Board, Broken, Bytes, Cause, Context, Disturbance, Event, Figures, Findings, Header, Log, Violation, What, bounds,
};

/// A millisecond, in ns.
pub(crate) const MS: u64 = 1_000_000;
/// The instant, ns, of the first tick.
pub(crate) const FIRST_TICK: u64 = 20 * MS;
/// The times from a tick to the transmit commands of the cycle's first and second frame, ns.
pub(crate) const COMMAND: [u64; 2] = [100_000, 4_130_000];
/// The time from a transmit command to the first bit of its frame, ns.
pub(crate) const LATENCY: u64 = 3_650;
/// The time that a byte takes on a receiver's line, ns.
pub(crate) const BYTE_NS: u64 = 21_702;

/// Returns the layout of the profile for this number of receivers.
pub(crate) fn layout(gps: usize) -> Layout {
    Layout::for_receivers(gps).unwrap()
}

/// Returns a header for this number of receivers.
pub(crate) fn header(gps: usize) -> Header {
    Header { version: Header::VERSION, gps, seed: 1, clock: "fast".to_owned(), hold: false }
}

/// The events of a run. They are sorted only when the log is made, so they can be added in any order.
#[derive(Clone, Debug)]
pub(crate) struct Events {
    /// The number of receivers.
    pub(crate) gps: usize,
    /// The events, in any order.
    pub(crate) events: Vec<Event>,
}

impl Events {
    /// Returns a run without events.
    pub(crate) fn new(gps: usize) -> Self {
        Self { gps, events: vec![] }
    }

    /// Returns a run in which HORUS sends `cycles` cycles and no receiver has sent anything. The field is on before the
    /// first tick, and the run ends before the tick after the last one.
    pub(crate) fn flawless(gps: usize, cycles: u64) -> Self {
        let mut events = Self::new(gps);
        events.field(8 * MS, true);
        events.cycles(FIRST_TICK, cycles);
        events.end(FIRST_TICK + cycles * bounds::CYCLE - MS);
        events
    }

    /// Adds an event to the run.
    pub(crate) fn add(&mut self, at: u64, what: What) -> &mut Self {
        self.events.push(Event { at, what });
        self
    }

    /// Moves the end of the run to the instant `at`, and removes later events.
    pub(crate) fn end(&mut self, at: u64) -> &mut Self {
        self.events.retain(|event| event.at <= at && event.what != What::End);
        self.add(at, What::End)
    }

    /// Switches HORUS's carrier on or off.
    pub(crate) fn field(&mut self, at: u64, on: bool) -> &mut Self {
        self.add(at, What::Field { on })
    }

    /// Adds a restart of a board to the run.
    pub(crate) fn reset(&mut self, at: u64, board: Board, asked: bool) -> &mut Self {
        self.add(at, What::Reset { board, cause: Cause::PowerOn, asked })
    }

    /// Adds `cycles` cycles, of which the tick at `first` is the first after a start of HORUS.
    pub(crate) fn cycles(&mut self, first: u64, cycles: u64) -> &mut Self {
        for number in 1..=cycles {
            self.cycle(first + (number - 1) * bounds::CYCLE, number as u32 * 10);
        }
        self
    }

    /// Adds a tick and the frames of its cycle, whose objects are stamped `timestamp` (ms).
    pub(crate) fn cycle(&mut self, tick: u64, timestamp: u32) -> &mut Self {
        self.cycle_of(tick, &silent_reported(timestamp), &vec![silent_gps(timestamp); self.gps])
    }

    /// Adds a tick and the frames of its cycle, whose objects have these values.
    pub(crate) fn cycle_of(&mut self, tick: u64, reported: &ReportedValues, gps: &[GpsValues]) -> &mut Self {
        self.add(tick, What::Tick);
        let objects = objects(reported, gps);
        for (number, after) in COMMAND.into_iter().enumerate().take(layout(self.gps).frames()) {
            let place = layout(self.gps).frame(number).unwrap();
            let payload = objects[place.first()..place.first() + place.count()].concat();
            self.add(tick + after, What::Command);
            self.frame(tick + after + LATENCY, &payload);
        }
        self
    }

    /// Adds a frame with this payload.
    pub(crate) fn frame(&mut self, started: u64, payload: &[u8]) -> &mut Self {
        let took = profile::air::air_time_ns(payload.len() as u8);
        let mut bytes = vec![payload.len() as u8 + 1];
        bytes.extend(payload);
        bytes.extend([0, 0]);
        self.add(started + took, What::Sent { started, bit_rate: 424_000, bytes: Bytes(bytes), whole: true })
    }

    /// Adds bytes that a receiver puts on its line.
    pub(crate) fn fed(&mut self, at: u64, receiver: usize, bytes: Vec<u8>) -> &mut Self {
        self.add(at, What::Fed { receiver, byte_ns: BYTE_NS, bytes: Bytes(bytes), clean: true, since: None })
    }

    /// Removes the events for which `which` holds.
    pub(crate) fn without(&mut self, mut which: impl FnMut(&Event) -> bool) -> &mut Self {
        self.events.retain(|event| !which(event));
        self
    }

    /// Returns the log, with the events in order.
    pub(crate) fn log(&self) -> Log {
        let mut events = self.events.clone();
        events.sort_by_key(|event| (event.at, event.what.rank()));
        Log { header: header(self.gps), events }
    }
}

/// Returns the values that Reported-Position has before any receiver has sent anything.
pub(crate) fn silent_reported(timestamp: u32) -> ReportedValues {
    let absent = ReportedValues::absent(timestamp);
    ReportedValues { status: absent.status.with_degraded(true), ..absent }
}

/// Returns the values of a GPS object whose receiver has not sent anything.
pub(crate) fn silent_gps(timestamp: u32) -> GpsValues {
    let absent = GpsValues::absent(timestamp);
    GpsValues { status: absent.status.with_stale(true), ..absent }
}

/// Returns the bytes of a profile's objects.
pub(crate) fn objects(reported: &ReportedValues, gps: &[GpsValues]) -> Vec<Vec<u8>> {
    let mut objects = vec![profile::ReportedPosition::seal(reported).as_bytes().to_vec()];
    objects.extend(
        (1..)
            .zip(gps)
            .map(|(index, values)| profile::GpsObject::seal(Identifier::gps(index), values).as_bytes().to_vec()),
    );
    objects
}

/// Returns the violations that one rule finds in a log, and its figures.
pub(crate) fn broken(mut rule: impl Rule, log: &Log) -> (Vec<Broken>, Figures) {
    let (mut context, mut findings, mut figures) = (Context::new(&log.header), Findings::default(), Figures::default());
    for event in &log.events {
        context.take(event);
        rule.take(event, &context, &mut findings);
    }
    rule.finish(&context, &mut findings, &mut figures);
    (findings.into_broken(), figures)
}

/// Returns the violations that one rule finds in a log, and the rule's figures. For each violation this states how
/// often it occurred, and the instant, ns, at which it first occurred.
pub(crate) fn found(rule: impl Rule, log: &Log) -> (Vec<(Violation, u64, u64)>, Figures) {
    let (broken, figures) = broken(rule, log);
    (broken.into_iter().map(|broken| (broken.violation, broken.count, broken.first_at)).collect(), figures)
}

/// The disturbance by which the DPR's front end does not answer.
pub(crate) const DPR_FRONT_END: Disturbance = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Silent };
/// The disturbance by which HORUS's front end does not answer.
pub(crate) const HORUS_FRONT_END: Disturbance = Disturbance::FrontEnd { board: Board::Horus, harm: Harm::Silent };
/// The disturbance by which the flight controller makes transactions that it must not make.
pub(crate) const MISUSE: Disturbance = Disturbance::FlightController { conduct: Conduct::Misuse };
/// The disturbance of a bit of a buffer into which frames are received.
pub(crate) const RECEIVE_BIT: Disturbance = Disturbance::Memory { board: Board::Dpr, memory: Memory::Receive };
/// The disturbance of a bit of an image.
pub(crate) const IMAGE_BIT: Disturbance = Disturbance::Memory { board: Board::Dpr, memory: Memory::Images };

/// Returns the event that states that the bench disturbs this until `until`, ns.
pub(crate) fn injected(disturbs: Disturbance, until: u64) -> What {
    What::Injected { kind: format!("{disturbs:?}"), disturbs, until }
}
