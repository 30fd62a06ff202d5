//! Tests the answerer against the stand-in for the chip.

use st25r3916::{
    Answerer, AnswererEvent, AnswererState, Dropped, Fault, FrameFlags, Input, ListenerConfig, ListenerState,
    SendError, SendState, Step, Transfer, Unanswered, Variant,
};

use crate::stand_in::{Chip, EOF, Happening, MAIN, Miso, RXE, RXS, Rig, TIMER};

const VARIANTS: [Variant; 2] = [Variant::A, Variant::B];
const FRAME: AnswererEvent = AnswererEvent::Frame { len: 64, flags: FrameFlags::empty() };
const ANSWERED: AnswererEvent = AnswererEvent::Answered { confirmed: true };

fn listening(chip: Chip) -> (Rig, Answerer) {
    let mut rig = Rig::new(chip);
    rig.chip.senses_field(true);
    let mut answerer = Answerer::new(ListenerConfig::new());
    assert_eq!((answerer.variant(), answerer.supply_mv()), (None, None));
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::Listening);
    let variant = if rig.chip.identity == 0x2A { Variant::A } else { Variant::B };
    assert_eq!((answerer.variant(), answerer.supply_mv()), (Some(variant), Some(5_008)));
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::FieldOn);
    rig.assert_no_misuse();
    rig.log();
    (rig, answerer)
}

fn next(rig: &mut Rig, answerer: &mut Answerer) -> AnswererEvent {
    rig.run(answerer, Step::Event(AnswererEvent::Listening))
}

fn receive(rig: &mut Rig, answerer: &mut Answerer) {
    let payload: Vec<u8> = (0..64).collect();
    rig.chip.frame(rig.chip.now + 200, &payload);
    assert_eq!(next(rig, answerer), FRAME);
    assert_eq!(rig.buffer[1..=64], payload);
}

/// Prepares an answer with this payload to the frame that was delivered. Returns the event that follows.
fn prepare(rig: &mut Rig, answerer: &mut Answerer, payload: &[u8]) -> AnswererEvent {
    rig.payload = payload.to_vec();
    let step = answerer.answer(payload.len()).expect("a frame was delivered");
    rig.run(answerer, step)
}

fn transmit(rig: &mut Rig, answerer: &mut Answerer) -> AnswererEvent {
    rig.run(answerer, Step::Transfer(Transfer::Short(Answerer::transmit())))
}

fn works_again(rig: &mut Rig, answerer: &mut Answerer) {
    let payload: Vec<u8> = (0..128).map(|byte| byte ^ 0x3C).collect();
    let frame = [0x77; 64];
    for cycle in 1..40 {
        rig.chip.frame(rig.chip.now + cycle * 10_000, &frame);
    }
    for _ in 0..40 {
        if next(rig, answerer) == FRAME && rig.buffer[1..=64] == frame {
            rig.chip.clear_air();
            assert_eq!(prepare(rig, answerer, &payload), AnswererEvent::Loaded);
            assert_eq!(transmit(rig, answerer), ANSWERED);
            assert_eq!(rig.chip.sent.last().map(|(_, sent)| sent), Some(&payload));
            rig.assert_no_misuse();
            return receive(rig, answerer);
        }
    }
    panic!("no frame within 40 events");
}

#[test]
fn bring_up_connects_the_load_modulator_before_the_mode() {
    for (variant, modulation, driver, supply) in
        [(Variant::A, "29 5F", "FB 28 10", None), (Variant::B, "29 2E", "FB 28 90", Some("FB 2E 09"))]
    {
        let mut rig = Rig::new(Chip::new(variant));
        let mut answerer = Answerer::new(ListenerConfig::new());
        assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::Listening);
        let log = rig.log();
        let from = log.iter().position(|entry| entry == "08 5D").expect("no automatic answer");
        let mut settings = vec!["08 5D", modulation, driver];
        settings.extend(supply);
        settings.push(if variant == Variant::A { "26 00 FF" } else { "26 00 00" });
        settings.extend(["2A 13 02", "0A 00 13 2D 00 00 02", "FB 0C 54 00", "16 C7 E7 0F FB", "03 A0 22"]);
        assert_eq!(log[from..from + settings.len()], settings, "{variant:?}");
        assert_eq!(log[log.len() - 5..], ["02 C3", "DB", "D1", "42 00 00 00", "71 00"]);
    }
}

#[test]
fn a_frame_is_answered_by_these_transfers() {
    for variant in VARIANTS {
        let (mut rig, mut answerer) = listening(Chip::new(variant));
        receive(&mut rig, &mut answerer);
        rig.log();
        assert_eq!(answerer.state(), AnswererState::Delivered);
        let payload = [0x5A; 128];
        assert_eq!(prepare(&mut rig, &mut answerer, &payload), AnswererEvent::Loaded);
        assert_eq!(answerer.state(), AnswererState::Sending(SendState::Loaded));
        assert_eq!(transmit(&mut rig, &mut answerer), ANSWERED);
        assert_eq!(rig.chip.sent.last().map(|(_, sent)| &sent[..]), Some(&payload[..]));
        let log = rig.log();
        let lengths: Vec<usize> = log.iter().map(|entry| entry.len().div_ceil(3)).collect();
        // For an answer the driver makes these transfers: clear, length, status and head; then the command, the rest
        // and the status.
        assert_eq!(lengths, [1, 3, 8, 17, 1, 113, 8]);
        assert_eq!((&log[0][..], &log[1][..], &log[4][..]), ("DB", "22 04 00", "C4"));
        receive(&mut rig, &mut answerer);
        // After an answer the FIFO is empty, so the transfers are the status, the unmasking and one setting, without a
        // clear.
        assert_eq!(rig.log()[..2], ["59 00 00 00 00 00 00 00", "D1"]);
        let counters = answerer.counters();
        assert_eq!(
            (counters.answered, counters.unconfirmed, counters.unanswered, counters.listener.frames),
            (1, 0, 0, 2)
        );
        rig.assert_no_misuse();
    }
}

#[test]
fn every_length_of_an_answer_is_sent() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
    for len in 1..=254_usize {
        receive(&mut rig, &mut answerer);
        let payload = vec![len as u8; len];
        assert_eq!(prepare(&mut rig, &mut answerer, &payload), AnswererEvent::Loaded);
        assert_eq!(transmit(&mut rig, &mut answerer), ANSWERED, "{len}");
        assert_eq!(rig.chip.sent.last().map(|(_, sent)| sent), Some(&payload));
    }
    rig.assert_no_misuse();
}

#[test]
fn a_frame_may_stay_unanswered() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::A));
    receive(&mut rig, &mut answerer);
    receive(&mut rig, &mut answerer);
    assert!(rig.chip.sent.is_empty());
    works_again(&mut rig, &mut answerer);
}

#[test]
fn an_answer_is_possible_once_and_only_after_a_frame() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
    assert_eq!(answerer.answer(4), Err(SendError::NotReady));
    receive(&mut rig, &mut answerer);
    assert_eq!(answerer.answer(0), Err(SendError::Length));
    assert_eq!(answerer.answer(255), Err(SendError::Length));
    assert_eq!(prepare(&mut rig, &mut answerer, &[1; 4]), AnswererEvent::Loaded);
    assert_eq!(answerer.answer(4), Err(SendError::NotReady));
    assert_eq!(transmit(&mut rig, &mut answerer), ANSWERED);
    assert_eq!(answerer.answer(4), Err(SendError::NotReady));
    works_again(&mut rig, &mut answerer);
}

#[test]
fn an_answer_whose_instant_has_passed_is_given_up() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
    receive(&mut rig, &mut answerer);
    assert_eq!(prepare(&mut rig, &mut answerer, &[1; 128]), AnswererEvent::Loaded);
    rig.log();
    receive(&mut rig, &mut answerer);
    // The listener clears the FIFO (DB) before it unmasks the receiver (D1), to remove the first bytes of the answer
    // that was given up.
    assert_eq!(rig.log()[..3], ["59 00 00 00 00 00 00 00", "DB", "D1"]);
    assert!(rig.chip.sent.is_empty());
    works_again(&mut rig, &mut answerer);
}

#[test]
fn a_field_that_goes_before_the_answer_ends_it() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::A));
    receive(&mut rig, &mut answerer);
    rig.chip.irqs[TIMER] |= EOF;
    rig.chip.senses_field(false);
    assert_eq!(prepare(&mut rig, &mut answerer, &[1; 128]), AnswererEvent::Unanswered(Unanswered::FieldLost));
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::FieldOff);
    assert_eq!(answerer.counters().unanswered, 1);
    assert!(rig.chip.sent.is_empty());
    rig.chip.field(true);
    works_again(&mut rig, &mut answerer);
}

#[test]
fn a_frame_that_begins_before_the_answer_is_received_instead() {
    for ended in [false, true] {
        let (mut rig, mut answerer) =
            listening(Chip { end_masks_receiver: false, db_clears_irqs: false, ..Chip::new(Variant::B) });
        receive(&mut rig, &mut answerer);
        if ended {
            rig.chip.irqs[MAIN] |= RXS | RXE;
        } else {
            rig.chip.frame(rig.chip.now + 6, &[9; 64]);
        }
        let event = prepare(&mut rig, &mut answerer, &[1; 128]);
        assert_eq!(event, AnswererEvent::Unanswered(Unanswered::Overtaken), "{ended}");
        if !ended {
            assert_eq!(next(&mut rig, &mut answerer), FRAME);
            assert_eq!(rig.buffer[1..=64], [9; 64]);
        }
        assert!(rig.chip.sent.is_empty());
        works_again(&mut rig, &mut answerer);
    }
}

#[test]
fn a_late_executor_finds_the_next_frame_behind_its_answer() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
    receive(&mut rig, &mut answerer);
    assert_eq!(prepare(&mut rig, &mut answerer, &[1; 16]), AnswererEvent::Loaded);
    // The 216 bits of the answer take 509 µs. Afterwards the model of the chip opens its receiver by itself.
    let end = rig.chip.now + 3 + 509;
    rig.chip.frame(end + 300, &[9; 64]);
    rig.chip.at(end + 200, Happening::Unmask);
    rig.lateness = 700;
    assert_eq!(transmit(&mut rig, &mut answerer), ANSWERED);
    rig.lateness = 0;
    assert_eq!(next(&mut rig, &mut answerer), FRAME);
    assert_eq!(rig.buffer[1..=64], [9; 64]);
    works_again(&mut rig, &mut answerer);
}

#[test]
fn a_chip_that_transmits_nothing_twice_is_brought_up_again() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
    for (bring_ups, state) in [(1, AnswererState::Lost), (1, AnswererState::Listening)] {
        receive(&mut rig, &mut answerer);
        assert_eq!(prepare(&mut rig, &mut answerer, &[1; 128]), AnswererEvent::Loaded);
        rig.chip.transmits = false;
        assert_eq!(transmit(&mut rig, &mut answerer), AnswererEvent::Fault(Fault::NoTransmitEnd));
        rig.chip.transmits = true;
        assert_eq!((answerer.state(), answerer.counters().listener.bring_ups), (state, bring_ups));
        if state == AnswererState::Lost {
            rig.log();
            rig.chip.frame(rig.chip.now + 200, &[4; 64]);
            assert_eq!(next(&mut rig, &mut answerer), FRAME);
            assert_eq!(rig.log()[..4], ["C2", "59 00 00 00 00 00 00 00", "DB", "D1"]);
        }
    }
    assert_eq!(answerer.listener_state(), ListenerState::Faulted);
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::Listening);
    assert_eq!((answerer.counters().listener.bring_ups, answerer.counters().unanswered), (2, 2));
    works_again(&mut rig, &mut answerer);
}

#[test]
fn an_answer_between_two_lost_ones_spares_the_bring_up() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::A));
    for transmits in [false, true, false, true] {
        receive(&mut rig, &mut answerer);
        assert_eq!(prepare(&mut rig, &mut answerer, &[1; 128]), AnswererEvent::Loaded);
        rig.chip.transmits = transmits;
        let event = transmit(&mut rig, &mut answerer);
        assert_eq!(event == ANSWERED, transmits);
    }
    assert_eq!(answerer.counters().listener.bring_ups, 1);
}

#[test]
fn an_answer_without_its_transmit_interrupt_counts_as_sent() {
    let (mut rig, mut answerer) = listening(Chip { transmit_ends: false, ..Chip::new(Variant::B) });
    receive(&mut rig, &mut answerer);
    assert_eq!(prepare(&mut rig, &mut answerer, &[1; 128]), AnswererEvent::Loaded);
    assert_eq!(transmit(&mut rig, &mut answerer), AnswererEvent::Answered { confirmed: false });
    assert_eq!(answerer.counters().unconfirmed, 1);
    receive(&mut rig, &mut answerer);
}

#[test]
fn a_fault_during_an_answer_leads_to_a_bring_up() {
    for at in 0..8 {
        for (fault, break_it) in [
            (Fault::Bus, (|rig: &mut Rig| rig.chip.miso = Miso::StuckHigh) as fn(&mut Rig)),
            (Fault::Reset, |rig: &mut Rig| rig.chip.at(rig.chip.now, Happening::PowerUpReset)),
        ] {
            let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
            receive(&mut rig, &mut answerer);
            rig.payload = vec![1; 128];
            let mut step = answerer.answer(128).expect("a frame was delivered");
            let mut steps = 0;
            let event = loop {
                if steps == at {
                    break_it(&mut rig);
                }
                let given = rig.carry_out(step);
                step = answerer.step(rig.input(given));
                steps += 1;
                step = match step {
                    Step::Event(AnswererEvent::Loaded) => Step::Transfer(Transfer::Short(Answerer::transmit())),
                    Step::Event(event) => break event,
                    step => step,
                };
            };
            assert_eq!(event, AnswererEvent::Fault(fault), "step {at}");
            rig.chip.miso = Miso::Driven;
            rig.chip.misuse.clear();
            works_again(&mut rig, &mut answerer);
        }
    }
}

#[test]
fn a_failed_transfer_and_a_wrong_input_are_faults() {
    for at in 0..8 {
        let (mut rig, mut answerer) = listening(Chip::new(Variant::A));
        receive(&mut rig, &mut answerer);
        rig.payload = vec![1; 128];
        let mut step = answerer.answer(128).expect("a frame was delivered");
        for _ in 0..at {
            let given = rig.carry_out(step);
            step = answerer.step(rig.input(given));
            if step == Step::Event(AnswererEvent::Loaded) {
                step = Step::Transfer(Transfer::Short(Answerer::transmit()));
            }
        }
        let mut other = answerer.clone();
        assert_eq!(answerer.step(Input::Failed), Step::Event(AnswererEvent::Fault(Fault::Bus)), "step {at}");
        if !matches!(other.state(), AnswererState::Sending(SendState::Loaded)) {
            assert_eq!(other.step(Input::Start), Step::Event(AnswererEvent::Fault(Fault::Executor)), "step {at}");
        }
        works_again(&mut rig, &mut answerer);
    }
}

#[test]
fn what_a_listener_reports_is_passed_on() {
    let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
    rig.chip.raw_frame(rig.chip.now + 200, &[1, 2, 3], Some(0));
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::Dropped(Dropped::Runt));
    assert_eq!(answerer.answer(4), Err(SendError::NotReady), "a dropped frame is not answered");
    rig.chip.at(rig.chip.now + 500, Happening::Irq(TIMER, EOF));
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::FieldOff);
    rig.chip.field(true);
    assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::FieldOn);
    for _ in 0..2 {
        assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::Fault(Fault::Silence { field: true }));
        assert_eq!(next(&mut rig, &mut answerer), AnswererEvent::Listening);
    }
    works_again(&mut rig, &mut answerer);
}

#[test]
fn the_way_to_the_command_is_the_same_whatever_is_answered() {
    let mut ways = vec![];
    for fill in [0x00, 0xFF, 0x5A] {
        let (mut rig, mut answerer) = listening(Chip::new(Variant::B));
        receive(&mut rig, &mut answerer);
        rig.log();
        let begun = rig.chip.now;
        assert_eq!(prepare(&mut rig, &mut answerer, &[fill; 128]), AnswererEvent::Loaded);
        ways.push((rig.chip.now - begun, rig.log().len()));
    }
    assert_eq!(ways, [ways[0]; 3]);
}
