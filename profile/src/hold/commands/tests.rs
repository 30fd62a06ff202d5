//! Tests the hold's rule for commands at each boundary, and at random under loss, repetition and reordering.
extern crate std;
use std::{vec, vec::Vec};

use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

use super::*;
use crate::criticality::{ActiveLoad, Writer};
use crate::hold::{HoldCommand, HoldObject, Sender, Sent};
use crate::{HoldStatus, HoldValues, UplinkValues};

const NONE: Acknowledged = Acknowledged::new(0, Outcome::Nothing);

fn seeded(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default() }
}

fn payload(number: u16, word: u16, value: f32, reserved: u32) -> [u8; Uplink::PAYLOAD] {
    let command = WireCommand {
        number: U16Le::new(number),
        word: U16Le::new(word),
        value: F32Le::new(value),
        reserved: U32Le::new(reserved),
    };
    let mut payload = [0xA5; Uplink::PAYLOAD];
    payload.split_at_mut(COMMAND_SIZE).0.copy_from_slice(bytemuck::bytes_of(&command));
    payload
}

fn answer<W: WritesUplink>(timestamp: u32, payload: [u8; Uplink::PAYLOAD]) -> Answer {
    let mut answer = Answer::EMPTY;
    let values = UplinkValues { timestamp, payload, ..UplinkValues::default() };
    answer.set_uplink(Writer::<W>::claim(), Uplink::seal(Writer::<W>::claim(), &values));
    answer
}

const LIMIT: f32 = 500.0;

#[derive(Default)]
struct Hold {
    commands: Commands,
    executed: Vec<(Function, HoldCommand)>,
}

impl Hold {
    fn take(&mut self, answer: &Answer, now_ms: u64) -> [Acknowledged; 2] {
        self.commands.take(answer, now_ms, |writer, command| {
            self.executed.push((writer, command));
            match command {
                HoldCommand::SetPoint(celsius) if celsius.is_nan() || celsius > LIMIT => Executed::Refused,
                _ => Executed::Done,
            }
        });
        self.commands.acknowledged()
    }

    fn started() -> Self {
        let mut hold = Self::default();
        assert_eq!(hold.take(&answer::<BaseStation>(1_000, payload(0, 0, 0.0, 0)), 0), [NONE; 2]);
        hold
    }

    fn base(&mut self, timestamp: u32, number: u16, word: u16, now_ms: u64) -> Acknowledged {
        let [acknowledged, other] = self.take(&answer::<BaseStation>(timestamp, payload(number, word, 4.5, 0)), now_ms);
        assert_eq!(other, NONE);
        acknowledged
    }
}

// Shows HOLD-4.
#[test]
fn a_command_is_executed_once_and_the_next_number_again() {
    let mut hold = Hold::started();
    for (n, now_ms) in (1..).zip([100, 200, 900]) {
        assert_eq!(hold.base(1_000 + n, 1, 1, now_ms), Acknowledged::new(1, Outcome::Done));
    }
    assert_eq!(hold.executed, [(Function::BaseStation, HoldCommand::SetPoint(4.5))]);
    assert_eq!(hold.base(1_004, 2, 1, 1_000), Acknowledged::new(2, Outcome::Done));
    assert_eq!(hold.base(1_005, 1, 2, 1_100), Acknowledged::new(2, Outcome::Done), "behind");
    assert_eq!(hold.executed.len(), 2);
}

#[test]
fn a_number_is_new_up_to_32767_ahead_and_wraps() {
    for (number, before, newer) in [
        (1, 0, true),
        (0, 0, false),
        (32_767, 0, true),
        (32_768, 0, false),
        (65_535, 0, false),
        (0, 65_535, true),
        (32_766, 65_535, true),
        (32_767, 65_535, false),
        (65_535, 32_768, true),
        (7, 8, false),
    ] {
        let resumed = [NONE, Acknowledged::new(before, Outcome::Refused)];
        let mut hold = Hold { commands: Commands::resume(resumed), ..Hold::default() };
        assert_eq!(hold.commands.acknowledged(), resumed);
        let take = |hold: &mut Hold, timestamp| {
            hold.take(&answer::<FlightController>(timestamp, payload(number, 2, 0.0, 0)), 0)[1]
        };
        assert_eq!(take(&mut hold, 1), resumed[1], "unknown age");
        let expected = if newer { Acknowledged::new(number, Outcome::Done) } else { resumed[1] };
        assert_eq!(take(&mut hold, 2), expected, "{number} after {before}");
        assert_eq!(hold.executed.len(), usize::from(newer));
    }
}

#[test]
fn a_refused_or_unknown_command_is_acknowledged_as_such_once() {
    let mut hold = Hold::started();
    let mut take = |timestamp, payload| hold.take(&answer::<BaseStation>(timestamp, payload), 0)[0];
    let refused = Acknowledged::new(1, Outcome::Refused);
    assert_eq!(take(1_001, payload(1, 1, 501.0, 0)), refused);
    assert_eq!(take(1_002, payload(1, 1, 4.5, 0)), refused, "its number is used");
    for (number, word, reserved) in [(2, 5, 0), (3, u16::MAX, 0), (4, 1, 1), (5, 2, 0x8000_0000)] {
        let unknown = Acknowledged::new(number, Outcome::Unknown);
        assert_eq!(take(1_001 + u32::from(number), payload(number, word, 4.5, reserved)), unknown);
        assert_eq!(take(1_001 + u32::from(number), payload(number, 2, 4.5, 0)), unknown, "its number is used");
    }
    assert_eq!(take(1_010, payload(6, 1, f32::NAN, 0)), Acknowledged::new(6, Outcome::Refused));
    assert_eq!(hold.executed.len(), 2, "those that were refused");
}

#[test]
fn an_uplink_without_a_command_uses_no_number() {
    let mut hold = Hold::started();
    for (word, reserved) in [(0, 0), (0, 7)] {
        let before = answer::<BaseStation>(1_001, payload(1, word, 4.5, reserved));
        assert_eq!(hold.take(&before, 100), [NONE; 2]);
    }
    assert_eq!(hold.base(1_002, 1, 3, 200), Acknowledged::new(1, Outcome::Done));
    assert_eq!(hold.executed, [(Function::BaseStation, HoldCommand::Unlock)]);
}

// Shows HOLD-6.
#[test]
fn the_first_uplink_waits_for_a_later_timestamp_of_its_writer() {
    let mut hold = Hold::default();
    assert_eq!(hold.base(50, 1, 2, 0), NONE);
    assert_eq!(hold.base(50, 1, 2, 100), NONE, "the same timestamp proves nothing");
    let other = answer::<FlightController>(51, payload(0, 0, 0.0, 0));
    assert_eq!(hold.take(&other, 150), [NONE; 2], "nor does the other writer's");
    assert_eq!(hold.base(51, 1, 2, 200), Acknowledged::new(1, Outcome::Done));
}

// Shows HOLD-5.
#[test]
fn a_timestamp_is_too_old_after_more_than_1000_ms() {
    for (mut hold, timestamp, at_limit) in
        [(Hold::started(), 1_001, Acknowledged::new(1, Outcome::Done)), (Hold::default(), 1_001, NONE)]
    {
        assert_eq!(hold.base(timestamp, 0, 0, 500), NONE);
        assert_eq!(hold.base(timestamp, 1, 2, 1_500), at_limit);
        assert_eq!(hold.base(timestamp, 2, 2, 1_501), Acknowledged::new(2, Outcome::TooOld));
        assert_eq!(hold.base(timestamp + 1, 2, 2, 1_600), Acknowledged::new(2, Outcome::TooOld), "its number is used");
        assert_eq!(hold.base(timestamp + 2, 3, 2, 1_700), Acknowledged::new(3, Outcome::Done));
    }
}

#[test]
fn an_uplink_that_comes_back_after_a_silence_is_too_old() {
    let mut hold = Hold::started();
    assert_eq!(hold.base(1_001, 0, 0, 100), NONE);
    assert_eq!(hold.take(&Answer::EMPTY, 600), [NONE; 2]);
    assert_eq!(hold.base(1_001, 1, 2, 60_000), Acknowledged::new(1, Outcome::TooOld));
}

#[test]
fn an_unknown_word_that_is_too_old_is_acknowledged_as_too_old() {
    let mut hold = Hold::started();
    assert_eq!(hold.base(1_000, 1, 99, 2_000), Acknowledged::new(1, Outcome::TooOld));
}

#[test]
fn after_an_earlier_timestamp_a_command_waits_for_a_later_one() {
    for (timestamp, is_later) in
        [(999, false), (1_001, true), (1_000 + (1 << 31), false), (1_000 + (1 << 31) - 1, true), (0, false)]
    {
        let mut hold = Hold::started();
        let expected = if is_later { Acknowledged::new(1, Outcome::Done) } else { NONE };
        assert_eq!(hold.base(timestamp, 1, 2, 100), expected, "{timestamp}");
        assert_eq!(hold.base(timestamp + 1, 1, 2, 200), Acknowledged::new(1, Outcome::Done));
        assert_eq!(hold.executed.len(), 1);
    }
}

#[test]
fn a_hold_whose_clock_is_set_back_does_not_panic() {
    let mut hold = Hold::started();
    assert_eq!(hold.base(1_001, 0, 0, 50_000), NONE);
    assert_eq!(hold.base(1_001, 1, 2, 10), Acknowledged::new(1, Outcome::Done));
}

#[test]
fn each_writer_has_its_own_numbers_and_the_base_station_is_first() {
    let mut hold = Hold::default();
    let both = |timestamp, number| {
        let mut both = answer::<FlightController>(timestamp, payload(number, 3, 0.0, 0));
        let values = UplinkValues { timestamp, payload: payload(number, 2, 0.0, 0), ..UplinkValues::default() };
        let base_station = Writer::<BaseStation>::claim();
        both.set_uplink(base_station, Uplink::seal(base_station, &values));
        both
    };
    hold.take(&both(1, 0), 0);
    assert_eq!(hold.take(&both(2, 1), 100), [Acknowledged::new(1, Outcome::Done); 2]);
    let order = [(Function::BaseStation, HoldCommand::Lock), (Function::FlightController, HoldCommand::Unlock)];
    assert_eq!(hold.executed, order);
}

#[test]
fn a_damaged_or_misplaced_uplink_changes_nothing() {
    let mut hold = Hold::started();
    let good = *answer::<BaseStation>(1_001, payload(1, 2, 0.0, 0)).as_bytes();
    for bit in 0..8 * 64 {
        let mut damaged = good;
        if let Some(byte) = damaged.get_mut(bit / 8) {
            *byte ^= 1 << (bit % 8);
        }
        assert_eq!(hold.take(Answer::read(&damaged).expect("128 bytes"), 100), [NONE; 2]);
    }
    let (first, second) = good.split_at(64);
    let exchanged = [second, first].concat();
    assert_eq!(hold.take(Answer::read(&exchanged).expect("128 bytes"), 100), [NONE; 2]);
    assert_eq!(hold.take(&Answer::EMPTY, 100), [NONE; 2]);
    assert!(hold.executed.is_empty());
    assert_eq!(hold.take(Answer::read(&good).expect("128 bytes"), 100)[0], Acknowledged::new(1, Outcome::Done));
}

#[derive(Clone, Copy, Debug)]
struct Period {
    /// The age of the uplink in the hold's answer: the number of newer uplinks of its writer; `None` if the answer is
    /// lost.
    uplink: Option<usize>,
    /// The age of the hold's object that the writer reads: the number of newer objects; `None` if the writer reads
    /// none.
    object: Option<usize>,
    writes: bool,
    gives_up: bool,
    restarts: bool,
}

fn periods() -> impl Strategy<Value = Vec<Period>> {
    let past = || prop_oneof![3 => Just(None), 4 => Just(Some(0)), 2 => (0_usize..12).prop_map(Some)];
    let chance = prop::bool::weighted;
    let period = (past(), past(), chance(0.7), chance(0.05), chance(0.03))
        .prop_map(|(uplink, object, writes, gives_up, restarts)| Period { uplink, object, writes, gives_up, restarts });
    prop::collection::vec(period, 1..120)
}

struct Flight {
    hold: Hold,
    started: u32,
    sender: Sender<BaseStation>,
    uplinks: Vec<Answer>,
    objects: Vec<HoldStatus>,
    sent: Vec<(u16, HoldCommand)>,
    answered: Vec<(u16, Outcome)>,
}

impl Flight {
    fn new(first: u16) -> Self {
        let resumed = [Acknowledged::new(first, Outcome::Done), NONE];
        Self {
            hold: Hold { commands: Commands::resume(resumed), ..Hold::default() },
            started: 0,
            sender: Sender::new(),
            uplinks: vec![Answer::EMPTY],
            objects: vec![],
            sent: vec![],
            answered: vec![],
        }
    }

    fn step(&mut self, n: u32, period: Period) {
        if period.restarts {
            self.hold.commands = Commands::resume(self.hold.commands.acknowledged());
            self.started = n;
        }
        let now_ms = 100 * (n - self.started);
        if period.writes {
            let mut values = UplinkValues { timestamp: 7_000 + 90 * n, ..UplinkValues::default() };
            self.sender.fill(&mut values.payload);
            self.uplinks.push(answer::<BaseStation>(values.timestamp, values.payload));
        }
        if let Some(answer) = period.uplink.and_then(|ago| self.uplinks.iter().rev().nth(ago)) {
            self.hold.take(answer, now_ms.into());
        }
        let values = HoldValues { acknowledged: self.hold.commands.acknowledged(), ..HoldValues::absent(now_ms) };
        self.objects.push(HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values));
        if let Some(object) = period.object.and_then(|ago| self.objects.iter().rev().nth(ago)) {
            self.sender.observe(object.as_object());
            if let Sent::Answered(number, outcome) = self.sender.sent()
                && self.answered.last() != Some(&(number, outcome))
            {
                self.answered.push((number, outcome));
            }
        }
        if period.gives_up {
            self.sender.give_up();
        }
        let count = u16::try_from(self.sent.len()).expect("few");
        let command = HoldCommand::SetPoint(f32::from(if count.is_multiple_of(3) { 1_000 + count } else { count }));
        if let Some(number) = self.sender.send(&command) {
            self.sent.push((number, command));
        }
    }

    /// Checks that each command was executed at most once and in order, and that its acknowledgement says what was
    /// done.
    fn check(&self) {
        let executed: Vec<_> = self.hold.executed.iter().map(|(_, command)| *command).collect();
        let mut sent = self.sent.iter();
        for command in &executed {
            assert!(sent.any(|(_, sent)| sent == command), "what was executed was sent, once, and in this order");
        }
        for (number, outcome) in &self.answered {
            let (_, command) = self.sent.iter().find(|(sent, _)| sent == number).expect("it was sent");
            let refused = matches!(command, HoldCommand::SetPoint(celsius) if *celsius > LIMIT);
            match outcome {
                Outcome::Done => assert!(executed.contains(command) && !refused),
                Outcome::Refused => assert!(executed.contains(command) && refused),
                Outcome::TooOld => assert!(!executed.contains(command)),
                Outcome::Nothing | Outcome::Unknown => panic!("{number} is {outcome:?}"),
            }
        }
    }
}

proptest! {
    #![proptest_config(seeded(1024))]

    #[test]
    fn any_uplinks_execute_only_numbers_that_rise(
        uplinks in prop::collection::vec((0_u32..40, 0_u16..12, 0_u16..6, 0_u64..400), 1..200), first: u16,
    ) {
        let resumed = [Acknowledged::new(first, Outcome::Done), NONE];
        let mut hold = Hold { commands: Commands::resume(resumed), ..Hold::default() };
        let (mut now_ms, mut last, mut executed) = (0, first, 0);
        for (timestamp, number, word, later_ms) in uplinks {
            now_ms += later_ms;
            let number = number.wrapping_add(first);
            let [acknowledged, _] = hold.take(&answer::<BaseStation>(timestamp, payload(number, word, 1.0, 0)), now_ms);
            if acknowledged.number() != last {
                prop_assert_eq!(acknowledged.number(), number);
                prop_assert!(is_newer(number, last) && word != 0);
                let done = acknowledged.outcome() == Some(Outcome::Done);
                prop_assert_eq!(hold.executed.len(), executed + usize::from(done));
            } else {
                prop_assert_eq!(hold.executed.len(), executed);
            }
            (last, executed) = (acknowledged.number(), hold.executed.len());
        }
        prop_assert!(executed < 12);
    }

    // Shows HOLD-4.
    #[test]
    fn a_command_is_executed_at_most_once_whatever_the_link_does(periods in periods(), first: u16) {
        let mut flight = Flight::new(first);
        for (n, period) in (0..).zip(periods) {
            flight.step(n, period);
        }
        flight.check();
    }

    #[test]
    fn a_command_is_answered_once_the_link_works_again(periods in periods(), first: u16) {
        let mut flight = Flight::new(first);
        let mut n = 0;
        for period in periods {
            flight.step(n, period);
            n += 1;
        }
        let (before, answered) = (flight.sent.len(), flight.answered.len());
        for _ in 0..4 {
            flight.step(n, Period { uplink: Some(0), object: Some(0), writes: true, gives_up: false, restarts: false });
            n += 1;
        }
        prop_assert!(flight.answered.len() > answered && flight.sent.len() > before, "{:?}", flight.sender);
        flight.check();
    }
}

#[test]
fn commands_are_these_bytes_and_read_back() {
    let bytes = |command: HoldCommand| bytemuck::cast::<_, [u8; 12]>(WireCommand::new(0x0201, &command));
    assert_eq!(bytes(HoldCommand::SetPoint(4.5)), [1, 2, 1, 0, 0, 0, 0x90, 0x40, 0, 0, 0, 0]);
    assert_eq!(bytes(HoldCommand::Lock), [1, 2, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bytes(HoldCommand::Unlock), [1, 2, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bytes(HoldCommand::ClearShock), [1, 2, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    for command in [HoldCommand::SetPoint(-1.5), HoldCommand::Lock, HoldCommand::Unlock, HoldCommand::ClearShock] {
        let (word, value) = command.encode();
        assert_eq!(HoldCommand::decode(word, value), Some(command));
    }
    for unknown in [0, 5, 6, u16::MAX] {
        assert_eq!(HoldCommand::decode(unknown, 0.0), None);
    }
    assert_eq!((COMMAND_SIZE, HoldObject::SIZE), (12, 64));
}
