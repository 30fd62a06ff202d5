//! Makes logs for the tests of the rules. A test starts from a flawless run and changes it.

use profile::{GpsValues, Identifier, Layout, ReportedValues};

use crate::disturbance::{Conduct, Harm, Memory};
use crate::rules::Rule;
use crate::{
    Board, Broken, Bytes, Cause, Context, Disturbance, Event, Figures, Findings, Header, Log, Violation, What, bounds,
};

pub(crate) const MS: u64 = 1_000_000;
pub(crate) const FIRST_TICK: u64 = 20 * MS;
/// The times from a tick to the transmit commands of the cycle's first and second frame, ns.
pub(crate) const COMMAND: [u64; 2] = [100_000, 4_130_000];
pub(crate) const LATENCY: u64 = 3_650;
pub(crate) const BYTE_NS: u64 = 21_702;

pub(crate) fn layout(gps: usize) -> Layout {
    Layout::for_receivers(gps).unwrap()
}

pub(crate) fn header(gps: usize) -> Header {
    Header { version: Header::VERSION, gps, seed: 1, clock: "fast".to_owned(), hold: false }
}

#[derive(Clone, Debug)]
pub(crate) struct Events {
    pub(crate) gps: usize,
    pub(crate) hold: bool,
    pub(crate) events: Vec<Event>,
}

impl Events {
    pub(crate) fn new(gps: usize) -> Self {
        Self { gps, hold: false, events: vec![] }
    }

    /// Returns a run of `cycles` cycles in which no receiver sends anything. The field is on before the first tick.
    pub(crate) fn flawless(gps: usize, cycles: u64) -> Self {
        let mut events = Self::new(gps);
        events.field(8 * MS, true);
        events.cycles(FIRST_TICK, cycles);
        events.end(FIRST_TICK + cycles * bounds::CYCLE - MS);
        events
    }

    pub(crate) fn add(&mut self, at: u64, what: What) -> &mut Self {
        self.events.push(Event { at, what });
        self
    }

    pub(crate) fn end(&mut self, at: u64) -> &mut Self {
        self.events.retain(|event| event.at <= at && event.what != What::End);
        self.add(at, What::End)
    }

    pub(crate) fn field(&mut self, at: u64, on: bool) -> &mut Self {
        self.add(at, What::Field { on })
    }

    pub(crate) fn reset(&mut self, at: u64, board: Board, asked: bool) -> &mut Self {
        self.add(at, What::Reset { board, cause: Cause::PowerOn, asked })
    }

    /// Adds `cycles` cycles after a start of HORUS. The first begins at the tick `first`, ns.
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

    pub(crate) fn frame(&mut self, started: u64, payload: &[u8]) -> &mut Self {
        let took = profile::air::air_time_ns(payload.len() as u8);
        let mut bytes = vec![payload.len() as u8 + 1];
        bytes.extend(payload);
        bytes.extend([0, 0]);
        self.add(started + took, What::Sent { started, bit_rate: 424_000, bytes: Bytes(bytes), whole: true })
    }

    pub(crate) fn fed(&mut self, at: u64, receiver: usize, bytes: Vec<u8>) -> &mut Self {
        self.add(at, What::Fed { receiver, byte_ns: BYTE_NS, bytes: Bytes(bytes), clean: true, since: None })
    }

    pub(crate) fn without(&mut self, mut which: impl FnMut(&Event) -> bool) -> &mut Self {
        self.events.retain(|event| !which(event));
        self
    }

    pub(crate) fn log(&self) -> Log {
        let mut events = self.events.clone();
        in_order(&mut events);
        Log { header: Header { hold: self.hold, ..header(self.gps) }, events }
    }
}

/// Brings events into the order in which a log has them.
pub(crate) fn in_order(events: &mut [Event]) {
    events.sort_by_key(|event| (event.at, event.what.rank()));
}

pub(crate) fn silent_reported(timestamp: u32) -> ReportedValues {
    let absent = ReportedValues::absent(timestamp);
    ReportedValues { status: absent.status.with_degraded(true), ..absent }
}

pub(crate) fn silent_gps(timestamp: u32) -> GpsValues {
    let absent = GpsValues::absent(timestamp);
    GpsValues { status: absent.status.with_stale(true), ..absent }
}

pub(crate) fn objects(reported: &ReportedValues, gps: &[GpsValues]) -> Vec<Vec<u8>> {
    let mut objects = vec![profile::ReportedPosition::seal(reported).as_bytes().to_vec()];
    objects.extend(
        (1..)
            .zip(gps)
            .map(|(index, values)| profile::GpsObject::seal(Identifier::gps(index), values).as_bytes().to_vec()),
    );
    objects
}

pub(crate) fn broken(mut rule: impl Rule, log: &Log) -> (Vec<Broken>, Figures) {
    let (mut context, mut findings, mut figures) = (Context::new(&log.header), Findings::default(), Figures::default());
    for event in &log.events {
        context.take(event);
        rule.take(event, &context, &mut findings);
    }
    rule.finish(&context, &mut findings, &mut figures);
    (findings.into_broken(), figures)
}

pub(crate) fn found(rule: impl Rule, log: &Log) -> (Vec<(Violation, u64, u64)>, Figures) {
    let (broken, figures) = broken(rule, log);
    (broken.into_iter().map(|broken| (broken.violation, broken.count, broken.first_at)).collect(), figures)
}

pub(crate) const DPR_FRONT_END: Disturbance = Disturbance::FrontEnd { board: Board::Dpr, harm: Harm::Silent };
pub(crate) const HORUS_FRONT_END: Disturbance = Disturbance::FrontEnd { board: Board::Horus, harm: Harm::Silent };
pub(crate) const MISUSE: Disturbance = Disturbance::FlightController { conduct: Conduct::Misuse };
pub(crate) const RECEIVE_BIT: Disturbance = Disturbance::Memory { board: Board::Dpr, memory: Memory::Receive };
pub(crate) const IMAGE_BIT: Disturbance = Disturbance::Memory { board: Board::Dpr, memory: Memory::Images };

pub(crate) fn injected(disturbs: Disturbance, until: u64) -> What {
    What::Injected { kind: format!("{disturbs:?}"), disturbs, until }
}
