//! Models what a correct DPR does with the bytes that the flight controller writes: how a transaction is divided, which
//! violations there are, which timestamps are accepted, and which uplinks are stored (`profile::port_status`,
//! `profile::uplink`, `profile::command`).

use profile::ssi::REQUEST_SIZE;
use profile::{Command, Identifier, PortStatus, PortValues, Uplink, Violation, Violations};

use crate::bounds;
use crate::read::{Asked, is_intact, is_vacant};
use crate::rules::is_later;

/// The number of bytes that the DPR receives: a request, an object, and eight bytes that must be empty.
pub(super) const TAKEN_IN: usize = REQUEST_SIZE + Uplink::SIZE + 8;

/// A writer whose timestamps stepped back is accepted again after this number of consecutive newer timestamps.
const ROW: u8 = 3;

/// Returns whether these MOSI bytes can change Port-Status or the stored uplinks.
pub(super) fn writes(mosi: &[u8]) -> bool {
    let taken_in = &mosi[..mosi.len().min(TAKEN_IN)];
    !is_vacant(taken_in)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Timestamps {
    last: Option<u32>,
    row: Option<(u32, u8)>,
}

impl Timestamps {
    const NONE: Self = Self { last: None, row: None };

    fn accept(&mut self, timestamp: u32) -> bool {
        let newer = |than: u32| is_later(timestamp, than);
        let row = self.row.filter(|(before, _)| newer(*before)).map_or(1, |(_, row)| row + 1);
        if self.last.is_none_or(newer) || row == ROW {
            *self = Self { last: Some(timestamp), row: None };
            return true;
        }
        self.row = Some((timestamp, row));
        false
    }
}

/// The uplink that the DPR has stored for one writer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Unknown,
    Empty,
    /// The stored bytes, and the instant, ns, at which their transaction ended.
    Stored(Vec<u8>, u64),
}

/// A possible state of a correct DPR.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Model {
    uplinks_accepted: u32,
    commands_carried_out: u32,
    last_command: (u32, u32),
    last_refused: Option<bool>,
    violations: Violations,
    /// The stored uplinks of the base station and of the flight controller.
    pub(super) places: [Place; 2],
    /// The timestamps of the base station, of the flight controller and of commands; `None` if not known.
    timestamps: [Option<Timestamps>; 3],
    test: Test,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Test {
    /// No self-test is under way. The flags have the result of the last one.
    Idle { passed: bool, failed: bool },
    /// A self-test began at this instant, ns, and may have ended.
    Begun(u64),
}

impl Test {
    fn told(values: &PortValues) -> Self {
        Self::Idle { passed: values.status.self_test_passed(), failed: values.status.self_test_failed() }
    }

    /// Returns whether Port-Status may have these bits about the self-test in an image made at `at`, ns.
    fn fits(self, values: &PortValues, at: u64) -> bool {
        let status = values.status;
        match self {
            Self::Idle { .. } => !status.self_test_running() && Self::told(values) == self,
            Self::Begun(since) if status.self_test_running() => at < since + bounds::SELF_TEST,
            Self::Begun(_) => status.self_test_passed() != status.self_test_failed(),
        }
    }
}

impl Model {
    pub(super) fn at_start() -> Self {
        Self {
            uplinks_accepted: 0,
            commands_carried_out: 0,
            last_command: (0, 0),
            last_refused: Some(false),
            violations: Violations::new(),
            places: [Place::Empty, Place::Empty],
            timestamps: [Some(Timestamps::NONE); 3],
            test: Test::Idle { passed: false, failed: false },
        }
    }

    /// Returns the state of a DPR of which the judge knows only Port-Status. This Port-Status is from an image made at
    /// `at`, ns.
    pub(super) fn of(values: &PortValues, at: u64) -> Self {
        Self {
            uplinks_accepted: values.uplinks_accepted,
            commands_carried_out: values.commands_carried_out,
            last_command: (values.last_command_timestamp, values.last_command),
            last_refused: Some(values.status.last_refused()),
            violations: values.violations,
            places: [Place::Unknown, Place::Unknown],
            timestamps: [None; 3],
            test: if values.status.self_test_running() { Test::Begun(at) } else { Test::told(values) },
        }
    }

    /// Returns whether Port-Status may have these values in an image made at the instant `at`, ns.
    pub(super) fn fits(&self, values: &PortValues, at: u64) -> bool {
        self.uplinks_accepted == values.uplinks_accepted
            && self.commands_carried_out == values.commands_carried_out
            && self.last_command == (values.last_command_timestamp, values.last_command)
            && self.last_refused.is_none_or(|refused| refused == values.status.last_refused())
            && self.violations == values.violations
            && self.test.fits(values, at)
    }

    /// Updates the state with a Port-Status that was read. If Port-Status does not report a self-test as running, the
    /// self-test has ended.
    pub(super) fn told(&mut self, values: &PortValues) {
        if !values.status.self_test_running() {
            self.test = Test::told(values);
        }
    }

    /// Returns the possible states after a transaction that ended at `at`, ns.
    pub(super) fn after(&self, mosi: &[u8], at: u64, map_len: usize) -> Vec<Self> {
        let taken_in = &mosi[..mosi.len().min(TAKEN_IN)];
        let (request, behind) = taken_in.split_at(taken_in.len().min(REQUEST_SIZE));
        let (object, beyond) = behind.split_at(behind.len().min(Uplink::SIZE));
        let mut next = self.clone();
        match Asked::of(request, map_len) {
            Asked::Nothing | Asked::Window { .. } => {}
            Asked::Outside => next.violations.count(Violation::WindowOutside, 1),
            Asked::Damaged => next.violations.count(Violation::RequestDamaged, 1),
            Asked::Short => next.violations.count(Violation::TooShort, 1),
        }
        let mut states = if is_vacant(object) { vec![next] } else { next.written(object, at) };
        if !is_vacant(beyond) {
            states.iter_mut().for_each(|state| state.violations.count(Violation::TooLong, 1));
        }
        states
    }

    /// Returns the possible states after this uplink or command, which is not [vacant](is_vacant).
    fn written(self, object: &[u8], at: u64) -> Vec<Self> {
        if object.len() < Uplink::SIZE {
            return vec![self.refused(Violation::TooShort)];
        }
        if !is_intact(object) {
            return vec![self.refused(Violation::UplinkDamaged)];
        }
        let word = |place: usize| [0, 1, 2, 3].map(|byte| object[place + byte]);
        let timestamp = u32::from_le_bytes(word(0));
        let writer = match Identifier(u16::from_le_bytes([object[4], object[5]])) {
            Identifier::UPLINK_BASE_STATION => 0,
            Identifier::UPLINK_FLIGHT_CONTROLLER => 1,
            Identifier::COMMAND => {
                let is_zero = object[12..Uplink::SIZE - 4].iter().all(|byte| *byte == 0);
                let known = Command::ALL.into_iter().find(|known| known.word().to_le_bytes() == word(8) && is_zero);
                let Some(command) = known else { return vec![self.refused(Violation::CommandUnknown)] };
                return self.in_time(2, timestamp, |state| state.commanded(command, timestamp, at));
            }
            _ => return vec![self.refused(Violation::UplinkIdentifier)],
        };
        self.in_time(writer, timestamp, |mut state| {
            state.uplinks_accepted = state.uplinks_accepted.wrapping_add(1);
            state.last_refused = Some(false);
            state.places[writer] = Place::Stored(object.to_vec(), at);
            vec![state]
        })
    }

    /// Returns the states of `then` if the timestamp is newer than the last one, and the state after a refusal if it is
    /// not. If the last timestamp is not known, all of these states are possible.
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

    /// Returns the states after a valid command with a newer timestamp.
    fn commanded(self, command: Command, timestamp: u32, at: u64) -> Vec<Self> {
        let done = |mut state: Self| {
            state.commands_carried_out = state.commands_carried_out.wrapping_add(1);
            state.last_command = (timestamp, command.word());
            state.last_refused = Some(false);
            state
        };
        match (command, self.test) {
            (Command::ClearCounters, _) => {
                let cleared =
                    Self { violations: Violations::new(), uplinks_accepted: 0, commands_carried_out: 0, ..self };
                vec![done(cleared)]
            }
            (_, Test::Idle { .. }) => vec![done(Self { test: Test::Begun(at), ..self })],
            (_, Test::Begun(_)) => {
                let refused = self.clone().refused(Violation::CommandBusy);
                vec![done(Self { test: Test::Begun(at), ..self }), refused]
            }
        }
    }
}

/// Decodes Port-Status if all of it was read.
pub(super) fn status_in(place: Option<&[u8]>) -> Option<Result<PortValues, profile::Rejection>> {
    place.map(|bytes| PortStatus::verify(bytes).map(PortStatus::values))
}
