//! What a DPR that does right makes of what the flight controller writes: parts, kinds of violation, timestamps, places
//! (`profile::port_status`, `profile::uplink`, `profile::command`).

use profile::ssi::{self, REQUEST_SIZE};
use profile::uplink::Written;
use profile::{Command, PortStatus, PortValues, Uplink, Violation, Violations};

use crate::bounds;

/// What the DPR takes in of a transaction: a request, an object, and as many bytes behind it as tell that something is
/// driven there.
pub(super) const TAKEN_IN: usize = REQUEST_SIZE + Uplink::SIZE + 8;

/// After a restart a writer is believed with its third timestamp in a row.
const ROW: u8 = 3;

/// Whether all of a part is what an idle line brings.
fn is_idle(part: &[u8]) -> bool {
    [0x00, 0xFF].iter().any(|idle| part.iter().all(|byte| byte == idle))
}

/// Whether a transaction with this MOSI can change anything that Port-Status or an uplink's place shows.
pub(super) fn writes(mosi: &[u8]) -> bool {
    let taken_in = &mosi[..mosi.len().min(TAKEN_IN)];
    !is_idle(taken_in)
}

/// What is known of one writer's timestamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Timestamps {
    last: Option<u32>,
    row: Option<(u32, u8)>,
}

impl Timestamps {
    const NONE: Self = Self { last: None, row: None };

    fn accept(&mut self, timestamp: u32) -> bool {
        let newer = |than: u32| (1..1 << 31).contains(&timestamp.wrapping_sub(than));
        let row = self.row.filter(|(before, _)| newer(*before)).map_or(1, |(_, row)| row + 1);
        if self.last.is_none_or(newer) || row == ROW {
            *self = Self { last: Some(timestamp), row: None };
            return true;
        }
        self.row = Some((timestamp, row));
        false
    }
}

/// What stands in a writer's place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Nobody knows.
    Unknown,
    /// Nothing was stored.
    Empty,
    /// These bytes, of a transaction that ended at this instant, ns.
    Stored(Vec<u8>, u64),
}

/// A state that a DPR which does right can be in.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Model {
    uplinks_accepted: u32,
    commands_carried_out: u32,
    last_command: (u32, u32),
    last_refused: Option<bool>,
    violations: Violations,
    /// Of the base station, of the flight controller.
    pub(super) places: [Place; 2],
    /// Of the base station, of the flight controller, of commands; nothing where nobody knows.
    timestamps: [Option<Timestamps>; 3],
    /// Until when a self-test that was begun may not be over, ns.
    testing: Option<u64>,
}

impl Model {
    /// At the DPR's start.
    pub(super) fn at_start() -> Self {
        Self {
            uplinks_accepted: 0,
            commands_carried_out: 0,
            last_command: (0, 0),
            last_refused: Some(false),
            violations: Violations::new(),
            places: [Place::Empty, Place::Empty],
            timestamps: [Some(Timestamps::NONE); 3],
            testing: None,
        }
    }

    /// A DPR of which nothing is known but what it says itself, in an image of `at`, ns.
    pub(super) fn of(values: &PortValues, at: u64) -> Self {
        Self {
            uplinks_accepted: values.uplinks_accepted,
            commands_carried_out: values.commands_carried_out,
            last_command: (values.last_command_timestamp, values.last_command),
            last_refused: Some(values.status.last_refused()),
            violations: values.violations,
            places: [Place::Unknown, Place::Unknown],
            timestamps: [None; 3],
            testing: Some(at + bounds::SELF_TEST),
        }
    }

    /// Whether Port-Status may say this in an image of `at`, ns.
    pub(super) fn fits(&self, values: &PortValues, at: u64) -> bool {
        self.uplinks_accepted == values.uplinks_accepted
            && self.commands_carried_out == values.commands_carried_out
            && self.last_command == (values.last_command_timestamp, values.last_command)
            && self.last_refused.is_none_or(|refused| refused == values.status.last_refused())
            && self.violations == values.violations
            && (self.may_test(at) || !values.status.self_test_running())
    }

    /// Whether a self-test may be under way at `at`, ns.
    fn may_test(&self, at: u64) -> bool {
        self.testing.is_some_and(|until| at < until)
    }

    /// The states that a transaction which ended at `at` (ns) may lead to, for a map of so many bytes.
    pub(super) fn after(&self, mosi: &[u8], at: u64, map_len: usize) -> Vec<Self> {
        let taken_in = &mosi[..mosi.len().min(TAKEN_IN)];
        let (request, behind) = taken_in.split_at(taken_in.len().min(REQUEST_SIZE));
        let (object, beyond) = behind.split_at(behind.len().min(Uplink::SIZE));
        let mut next = self.clone();
        match request.first_chunk::<REQUEST_SIZE>() {
            Some(request) => {
                if let Err(rejection) = ssi::parse(request, map_len) {
                    next.violations.count(Violation::of_request(rejection), 1);
                }
            }
            None if is_idle(request) => {}
            None => next.violations.count(Violation::TooShort, 1),
        }
        let mut states = if is_idle(object) { vec![next] } else { next.written(object, at) };
        if !is_idle(beyond) {
            states.iter_mut().for_each(|state| state.violations.count(Violation::TooLong, 1));
        }
        states
    }

    /// An object has come in that is not idle.
    fn written(self, object: &[u8], at: u64) -> Vec<Self> {
        match Written::verify(object) {
            Err(rejection) => vec![self.refused(Violation::of_object(rejection))],
            Ok(Written::BaseStation(uplink)) => self.uplink(0, uplink, at),
            Ok(Written::FlightController(uplink)) => self.uplink(1, uplink, at),
            Ok(Written::Command(command, object)) => self.in_time(2, object.timestamp(), |state| {
                let timestamp = object.timestamp();
                let busy = command == Command::SelfTest && state.may_test(at);
                let refused = busy.then(|| state.clone().refused(Violation::CommandBusy));
                std::iter::once(state.carried_out(command, timestamp, at)).chain(refused).collect()
            }),
        }
    }

    fn uplink(self, writer: usize, uplink: &Uplink, at: u64) -> Vec<Self> {
        self.in_time(writer, uplink.timestamp(), |mut state| {
            state.uplinks_accepted = state.uplinks_accepted.wrapping_add(1);
            state.last_refused = Some(false);
            state.places[writer] = Place::Stored(uplink.as_bytes().to_vec(), at);
            vec![state]
        })
    }

    /// Where the timestamp is newer than those before it, `then`; both where nobody knows.
    fn in_time(mut self, series: usize, timestamp: u32, then: impl Fn(Self) -> Vec<Self>) -> Vec<Self> {
        let Some(mut known) = self.timestamps[series] else {
            let refused = self.clone().refused(Violation::UplinkNotNewer);
            self.timestamps[series] = Some(Timestamps { last: Some(timestamp), row: None });
            let mut states = then(self);
            states.push(refused);
            return states;
        };
        let newer = known.accept(timestamp);
        self.timestamps[series] = Some(known);
        if newer { then(self) } else { vec![self.refused(Violation::UplinkNotNewer)] }
    }

    fn refused(mut self, violation: Violation) -> Self {
        self.violations.count(violation, 1);
        self.last_refused = Some(true);
        self
    }

    fn carried_out(mut self, command: Command, timestamp: u32, at: u64) -> Self {
        match command {
            Command::ClearCounters => {
                self.violations = Violations::new();
                self.uplinks_accepted = 0;
                self.commands_carried_out = 0;
            }
            _ => self.testing = Some(at + bounds::SELF_TEST),
        }
        self.commands_carried_out = self.commands_carried_out.wrapping_add(1);
        self.last_command = (timestamp, command.word());
        self.last_refused = Some(false);
        self
    }
}

/// Port-Status in the map that was read from byte `offset` on, if all of it was: intact, or why not.
pub(super) fn status_in(place: Option<&[u8]>) -> Option<Result<PortValues, profile::Rejection>> {
    place.map(|bytes| PortStatus::verify(bytes).map(PortStatus::values))
}
