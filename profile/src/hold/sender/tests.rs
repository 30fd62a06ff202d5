use super::*;
use crate::criticality::{ActiveLoad, BaseStation, FlightController, Writer};
use crate::hold::{Acknowledged, HoldCommand};
use crate::{HoldStatus, HoldValues};

fn object(timestamp: u32, base_station: Acknowledged) -> HoldStatus {
    let acknowledged = [base_station, Acknowledged::new(77, Outcome::Done)];
    HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues { acknowledged, ..HoldValues::absent(timestamp) })
}

fn observe(sender: &mut Sender<BaseStation>, timestamp: u32, number: u16, outcome: Outcome) -> Sent {
    sender.observe(object(timestamp, Acknowledged::new(number, outcome)).as_object());
    sender.sent()
}

fn filled(sender: &Sender<BaseStation>) -> [u8; Uplink::PAYLOAD] {
    let mut payload = [0xA5; Uplink::PAYLOAD];
    sender.fill(&mut payload);
    assert!(payload.iter().skip(12).all(|byte| *byte == 0xA5), "the rest is the writer's");
    payload
}

fn waiting() -> Sender<BaseStation> {
    let mut sender = Sender::default();
    assert_eq!(observe(&mut sender, 1_000, 8, Outcome::Done), Sent::Nothing);
    assert_eq!(sender.send(&HoldCommand::Lock), Some(9));
    assert_eq!(sender.sent(), Sent::Waiting(9));
    sender
}

#[test]
fn without_an_object_of_the_hold_nothing_is_sent() {
    let mut sender = Sender::<BaseStation>::new();
    assert_eq!(sender.send(&HoldCommand::Lock), None);
    sender.give_up();
    assert_eq!(sender.sent(), Sent::Nothing);
    assert!(filled(&sender).iter().take(12).all(|byte| *byte == 0));
}

#[test]
fn a_command_is_in_every_uplink_until_it_is_acknowledged() {
    let mut sender = waiting();
    for timestamp in [1_100, 1_200] {
        assert_eq!(observe(&mut sender, timestamp, 8, Outcome::Done), Sent::Waiting(9));
        assert!(filled(&sender).starts_with(&[9, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0]));
        assert_eq!(sender.send(&HoldCommand::Unlock), None, "one at a time");
    }
    assert_eq!(observe(&mut sender, 1_300, 9, Outcome::Refused), Sent::Answered(9, Outcome::Refused));
    assert!(filled(&sender).starts_with(&[0; 12]));
    assert_eq!(observe(&mut sender, 1_400, 40, Outcome::Done), Sent::Answered(9, Outcome::Refused), "for good");
    assert_eq!(sender.send(&HoldCommand::Unlock), Some(41));
}

#[test]
fn each_writer_reads_its_own_acknowledgement() {
    let mut sender = Sender::<FlightController>::new();
    sender.observe(object(0, Acknowledged::new(8, Outcome::Done)).as_object());
    assert_eq!(sender.send(&HoldCommand::ClearShock), Some(78));
}

#[test]
fn a_number_without_an_outcome_is_no_answer() {
    let mut sender = waiting();
    assert_eq!(observe(&mut sender, 1_100, 9, Outcome::Nothing), Sent::Waiting(9));
    let mut bytes = *object(1_200, Acknowledged::new(9, Outcome::Done)).as_bytes();
    if let Some(code) = bytes.get_mut(46) {
        *code = 5;
    }
    sender.observe(bytemuck::cast_ref(&bytes));
    assert_eq!(sender.sent(), Sent::Waiting(9), "a reserved code");
}

#[test]
fn a_command_is_lost_if_a_later_one_is_acknowledged() {
    let mut sender = waiting();
    assert_eq!(observe(&mut sender, 1_100, 10, Outcome::Done), Sent::Lost(9));
    assert!(filled(&sender).starts_with(&[0; 12]));
}

#[test]
fn a_command_is_lost_if_the_hold_restarts() {
    for (timestamp, lost) in [
        (1_000, false),
        (999, true),
        (0, true),
        (1_000 + (1 << 31) - 1, false),
        (1_000 + (1 << 31), false),
        (1_001 + (1 << 31), true),
    ] {
        let mut sender = waiting();
        let sent = if lost { Sent::Lost(9) } else { Sent::Waiting(9) };
        assert_eq!(observe(&mut sender, timestamp, 8, Outcome::Done), sent, "{timestamp}");
    }
    let mut sender = waiting();
    assert_eq!(observe(&mut sender, 0, 0, Outcome::Nothing), Sent::Lost(9));
    assert_eq!(sender.send(&HoldCommand::Lock), Some(10), "a number is not used again");
}

#[test]
fn a_command_that_was_given_up_can_still_be_answered() {
    let mut sender = waiting();
    sender.give_up();
    assert_eq!(sender.sent(), Sent::Lost(9));
    assert_eq!(observe(&mut sender, 1_100, 8, Outcome::Done), Sent::Lost(9));
    assert_eq!(observe(&mut sender, 1_200, 9, Outcome::Done), Sent::Answered(9, Outcome::Done));
    sender.give_up();
    assert_eq!(sender.sent(), Sent::Answered(9, Outcome::Done));
}

#[test]
fn the_command_after_a_lost_one_has_another_number() {
    let mut sender = waiting();
    sender.give_up();
    assert_eq!(sender.send(&HoldCommand::Unlock), Some(10));
    assert_eq!(observe(&mut sender, 1_100, 9, Outcome::Done), Sent::Waiting(10));
    assert_eq!(observe(&mut sender, 1_200, 10, Outcome::Done), Sent::Answered(10, Outcome::Done));
}

#[test]
fn numbers_wrap() {
    let mut sender = Sender::<BaseStation>::new();
    observe(&mut sender, 0, u16::MAX, Outcome::Done);
    assert_eq!(sender.send(&HoldCommand::Lock), Some(0));
    assert_eq!(observe(&mut sender, 100, 0, Outcome::Done), Sent::Answered(0, Outcome::Done));
}
