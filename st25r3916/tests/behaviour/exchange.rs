//! Tests the exchange against the stand-in for the chip.

use st25r3916::exchange::{OPENS_US, WINDOW_US};
use st25r3916::{
    Dropped, Exchange, ExchangeEvent, ExchangeState, Fault, FrameFlags, Input, NoAnswer, PollerState, SendError, Step,
    Transfer, Variant,
};

use crate::stand_in::{CRC, Chip, Happening, MAIN, Miso, RXS, Rig};

const VARIANTS: [Variant; 2] = [Variant::A, Variant::B];
const SILENT: ExchangeEvent = ExchangeEvent::NoAnswer(NoAnswer::Silent);
const OVERRUN: ExchangeEvent = ExchangeEvent::NoAnswer(NoAnswer::Dropped(Dropped::Overrun));
/// The air time of a frame of 64 bytes, µs, rounded up: 600 bits.
const FRAME_US: u64 = 1_416;

fn ready(chip: Chip) -> (Rig, Exchange) {
    let mut rig = Rig::new(chip);
    let mut exchange = Exchange::default();
    assert_eq!((exchange.variant(), exchange.supply_mv()), (None, None));
    assert_eq!(rig.run(&mut exchange, Step::Event(SILENT)), ExchangeEvent::Ready);
    let variant = if rig.chip.identity == 0x2A { Variant::A } else { Variant::B };
    assert_eq!((exchange.variant(), exchange.supply_mv()), (Some(variant), Some(5_008)));
    rig.assert_no_misuse();
    rig.log();
    (rig, exchange)
}

fn load(rig: &mut Rig, exchange: &mut Exchange) {
    rig.payload = (0..64).collect();
    let step = exchange.prepare(64).expect("it is ready");
    assert_eq!(rig.run(exchange, step), ExchangeEvent::Prepared);
    assert_eq!(rig.run(exchange, Step::Event(ExchangeEvent::Prepared)), ExchangeEvent::Loaded);
}

/// Sends the loaded frame and returns the result of the exchange. `answer` gets the chip and the time of the frame's
/// end.
fn fire<R>(rig: &mut Rig, exchange: &mut Exchange, answer: impl FnOnce(&mut Chip, u64) -> R) -> ExchangeEvent {
    let end = rig.chip.now + 3 + FRAME_US;
    answer(&mut rig.chip, end);
    rig.run(exchange, Step::Transfer(Transfer::Short(Exchange::transmit())))
}

fn exchange<R>(rig: &mut Rig, machine: &mut Exchange, answer: impl FnOnce(&mut Chip, u64) -> R) -> ExchangeEvent {
    load(rig, machine);
    fire(rig, machine, answer)
}

fn works_again(rig: &mut Rig, machine: &mut Exchange) {
    rig.chip.clear_air();
    assert_eq!(rig.run(machine, Step::Event(SILENT)), ExchangeEvent::Ready);
    let payload: Vec<u8> = (0..128).map(|byte| byte ^ 0xA5).collect();
    let event = exchange(rig, machine, |chip, end| chip.frame(end + 700, &payload));
    assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::empty() });
    assert_eq!(rig.buffer[1..=128], payload);
    assert_eq!(rig.chip.sent.last().map(|(_, frame)| frame.len()), Some(64));
    rig.assert_no_misuse();
}

#[test]
fn bring_up_sets_the_receiver_for_answers_and_masks_it() {
    for (variant, receiver, number) in
        [(Variant::A, "0A 00 13 3D 00 00 28", 20), (Variant::B, "0A 00 13 FD 00 00 28", 24)]
    {
        let mut rig = Rig::new(Chip::new(variant));
        let mut machine = Exchange::new();
        assert_eq!(rig.run(&mut machine, Step::Event(SILENT)), ExchangeEvent::Ready);
        let log = rig.log();
        let from = log.iter().position(|entry| entry == "03 1C 22").expect("the mode is set");
        let settings = &log[from..];
        for entry in [receiver, "FB 0C 54 00", "10 02 9D 00", "16 47 3F FF FB", "07 00"] {
            assert_eq!(settings.iter().filter(|other| *other == entry).count(), 1, "{entry}");
        }
        assert_eq!(settings[settings.len() - 3..], ["02 C8", "D0", "42 00 00 00"], "{variant:?}");
        // Each setting, IO and regulator control included, is written and read back. Three other transfers follow.
        assert_eq!(settings.len(), number + 5, "{variant:?}: {settings:?}");
        assert!(!rig.chip.unmasked);
    }
}

#[test]
fn an_exchange_is_these_transfers() {
    for variant in VARIANTS {
        let (mut rig, mut machine) = ready(Chip::new(variant));
        let payload = [0x5A; 128];
        let event = exchange(&mut rig, &mut machine, |chip, end| chip.frame(end + 700, &payload));
        assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::empty() });
        assert_eq!(machine.state(), ExchangeState::Over);
        let log = rig.log();
        let lengths: Vec<usize> = log.iter().map(|entry| entry.len().div_ceil(3)).collect();
        // For an exchange the driver makes these transfers: clear, length, status and head; the command, the rest and
        // the status; the unmasking, two reads of the status, LEN and payload, the masking, the gain and the status.
        assert_eq!(lengths, [1, 3, 8, 17, 1, 49, 8, 1, 8, 8, 130, 1, 1, 8]);
        assert_eq!([&log[4], &log[7], &log[11], &log[12]], ["C4", "D1", "D0", "D5"]);
        assert_eq!(rig.buffer[..=128], [&[129][..], &payload].concat());
        assert_eq!(rig.run(&mut machine, Step::Event(SILENT)), ExchangeEvent::Ready);
        rig.assert_no_misuse();
    }
}

#[test]
fn the_receiver_is_open_only_within_the_window() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::B));
    load(&mut rig, &mut machine);
    assert!(!rig.chip.unmasked);
    let mut step = Step::Transfer(Transfer::Short(Exchange::transmit()));
    let end = rig.chip.now + 3 + FRAME_US;
    let mut open = vec![];
    loop {
        let given = rig.carry_out(step);
        step = machine.step(rig.input(given));
        open.push((rig.chip.now, rig.chip.unmasked));
        if let Step::Event(event) = step {
            assert_eq!(event, SILENT);
            break;
        }
    }
    let (opened, _) = *open.iter().find(|(_, open)| *open).expect("it opens");
    let (closed, _) = *open.iter().rfind(|(_, open)| *open).expect("it closes");
    assert!((end + 189..end + 250).contains(&opened), "{opened}, {end}");
    assert!((end + 3_150..end + 3_250).contains(&closed), "{closed}, {end}");
    assert!(!rig.chip.unmasked);
    works_again(&mut rig, &mut machine);
}

#[test]
fn silence_ends_the_exchange_with_and_without_its_interrupt() {
    for no_response_ends in [true, false] {
        let (mut rig, mut machine) = ready(Chip { no_response_ends, ..Chip::new(Variant::A) });
        load(&mut rig, &mut machine);
        let end = rig.chip.now + 3 + FRAME_US;
        assert_eq!(fire(&mut rig, &mut machine, |_, _| {}), SILENT);
        let after = rig.chip.now - end;
        assert!((u64::from(WINDOW_US) + 150..u64::from(WINDOW_US) + 350).contains(&after), "{after} us");
        assert_eq!(machine.counters().silent, 1);
        works_again(&mut rig, &mut machine);
    }
}

#[test]
fn only_an_answer_within_the_window_is_received() {
    for (sync, heard) in [(3_140, true), (3_400, false)] {
        let (mut rig, mut machine) = ready(Chip::new(Variant::B));
        let event = exchange(&mut rig, &mut machine, |chip, end| chip.frame(end + sync, &[7; 128]));
        assert_eq!(event != SILENT, heard, "{sync} us: {event:?}");
        works_again(&mut rig, &mut machine);
    }
}

#[test]
fn an_answer_that_begins_while_the_window_closes_is_late() {
    let mut late = 0;
    for sync in 3_150..3_220 {
        let (mut rig, mut machine) = ready(Chip::new(Variant::B));
        let event = exchange(&mut rig, &mut machine, |chip, end| chip.frame(end + sync, &[7; 128]));
        late += u32::from(event == ExchangeEvent::NoAnswer(NoAnswer::Late));
        assert!(matches!(event, SILENT | ExchangeEvent::Answer { .. } | ExchangeEvent::NoAnswer(NoAnswer::Late)));
        let counters = machine.counters();
        assert_eq!(counters.answers + counters.silent + counters.dropped, 1);
        works_again(&mut rig, &mut machine);
    }
    assert!(late > 0);
}

#[test]
fn an_answer_without_an_end_is_given_up() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::B));
    load(&mut rig, &mut machine);
    let end = rig.chip.now + 3 + FRAME_US;
    let event = fire(&mut rig, &mut machine, |chip, end| chip.raw_frame(end + 700, &[129; 40], None));
    assert_eq!(event, ExchangeEvent::NoAnswer(NoAnswer::Dropped(Dropped::NoEnd)));
    assert!((700 + 6_000..700 + 6_100).contains(&(rig.chip.now - end)), "{}", rig.chip.now - end);
    assert_eq!(machine.counters().dropped, 1);
    works_again(&mut rig, &mut machine);
}

#[test]
fn a_short_and_a_long_answer_are_dropped() {
    for (bytes, why) in [(3, Dropped::Runt), (258, Dropped::TooLong)] {
        let (mut rig, mut machine) = ready(Chip::new(Variant::A));
        let event = exchange(&mut rig, &mut machine, |chip, end| {
            chip.raw_frame(end + 700, &vec![9; bytes], Some(0));
        });
        assert_eq!(event, ExchangeEvent::NoAnswer(NoAnswer::Dropped(why)));
        works_again(&mut rig, &mut machine);
    }
}

#[test]
fn a_damaged_answer_is_delivered_with_its_flags() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::B));
    let mut bytes = vec![129; 131];
    let event = exchange(&mut rig, &mut machine, |chip, end| chip.raw_frame(end + 700, &bytes, Some(CRC)));
    assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::CRC });
    assert_eq!(machine.counters().flagged, 1);
    assert_eq!(rig.run(&mut machine, Step::Event(SILENT)), ExchangeEvent::Ready);
    bytes[0] = 130;
    let event = exchange(&mut rig, &mut machine, |chip, end| chip.raw_frame(end + 700, &bytes, Some(0)));
    assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::LENGTH });
    works_again(&mut rig, &mut machine);
}

#[test]
fn a_second_answer_is_never_mixed_with_the_first() {
    let (mut whole, mut overrun) = (0, 0);
    for gap in (10..2_900).step_by(7) {
        let (mut rig, mut machine) = ready(Chip { end_masks_receiver: false, ..Chip::new(Variant::B) });
        let event = exchange(&mut rig, &mut machine, |chip, end| {
            chip.frame(end + 400, &[1; 128]);
            chip.at(end + 400 + gap, Happening::Sync);
            chip.at(end + 400 + gap + 19, Happening::Byte(129));
        });
        match event {
            ExchangeEvent::Answer { len, flags } => {
                assert_eq!((len, flags), (128, FrameFlags::empty()), "{gap}");
                assert_eq!(rig.buffer[1..=128], [1; 128], "{gap}");
                whole += 1;
            }
            // A second answer that begins while the status is read at the end of the first makes the first answer seem
            // too short.
            event => {
                assert!([OVERRUN, ExchangeEvent::NoAnswer(NoAnswer::Dropped(Dropped::Runt))].contains(&event), "{gap}");
                overrun += u32::from(event == OVERRUN);
            }
        }
        // A sync that comes while the driver reads an answer empties the FIFO. The stand-in counts a read from an empty
        // FIFO as misuse.
        rig.chip.misuse.clear();
        works_again(&mut rig, &mut machine);
    }
    assert!(whole > 10 && overrun > 300, "{whole} {overrun}");
}

#[test]
fn a_late_executor_finds_the_answer_begun_or_over_and_receives_it() {
    for lateness in [100, 400, 900, 2_000, 3_500] {
        for variant in VARIANTS {
            // The model of the chip opens its receiver at the transmit command, although the driver has masked it.
            let (mut rig, mut machine) = ready(Chip::new(variant));
            load(&mut rig, &mut machine);
            rig.chip.unmasked = true;
            rig.lateness = lateness;
            let event = fire(&mut rig, &mut machine, |chip, end| chip.frame(end + 312, &[3; 128]));
            assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::empty() }, "{lateness}");
            rig.lateness = 0;
            works_again(&mut rig, &mut machine);
        }
    }
}

#[test]
fn an_executor_that_opens_too_late_misses_the_answer_and_goes_on() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::A));
    rig.lateness = 600;
    let event = exchange(&mut rig, &mut machine, |chip, end| chip.frame(end + 312, &[3; 128]));
    assert_eq!(event, SILENT);
    rig.lateness = 0;
    works_again(&mut rig, &mut machine);
}

#[test]
fn a_frame_without_its_transmit_interrupt_is_followed_by_its_window() {
    let (mut rig, mut machine) = ready(Chip { transmit_ends: false, ..Chip::new(Variant::B) });
    let event = exchange(&mut rig, &mut machine, |chip, end| chip.frame(end + 700, &[3; 128]));
    assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::empty() });
    assert_eq!((machine.counters().poller.sent, machine.counters().poller.unconfirmed), (1, 1));
    works_again(&mut rig, &mut machine);
}

#[test]
fn faults_within_the_window_are_told_and_recovered_from() {
    for at in 3..12 {
        for (fault, break_it) in [
            (Fault::Bus, (|rig: &mut Rig| rig.chip.miso = Miso::StuckHigh) as fn(&mut Rig)),
            (Fault::Reset, |rig: &mut Rig| rig.chip.at(rig.chip.now, Happening::PowerUpReset)),
        ] {
            let (mut rig, mut machine) = ready(Chip::new(Variant::B));
            load(&mut rig, &mut machine);
            let end = rig.chip.now + 3 + FRAME_US;
            rig.chip.frame(end + 700, &[3; 128]);
            let mut step = Step::Transfer(Transfer::Short(Exchange::transmit()));
            let mut steps = 0;
            let event = loop {
                if steps == at {
                    break_it(&mut rig);
                }
                let given = rig.carry_out(step);
                step = machine.step(rig.input(given));
                steps += 1;
                if let Step::Event(event) = step {
                    break event;
                }
            };
            assert_eq!(event, ExchangeEvent::Fault(fault), "step {at}");
            assert_eq!((machine.state(), machine.poller_state()), (ExchangeState::Polling, PollerState::Faulted));
            rig.chip.miso = Miso::Driven;
            // The driver reads an answer after the stand-in's oscillator has stopped. The stand-in counts this read as
            // misuse.
            rig.chip.misuse.clear();
            works_again(&mut rig, &mut machine);
        }
    }
}

#[test]
fn a_failed_transfer_and_a_wrong_input_are_faults() {
    for (input, fault) in [(Input::Failed, Fault::Bus), (Input::Start, Fault::Executor)] {
        for at in 3..12 {
            let (mut rig, mut machine) = ready(Chip::new(Variant::A));
            load(&mut rig, &mut machine);
            rig.chip.frame(rig.chip.now + 3 + FRAME_US + 700, &[3; 128]);
            let mut step = Step::Transfer(Transfer::Short(Exchange::transmit()));
            for _ in 0..at {
                let given = rig.carry_out(step);
                step = machine.step(rig.input(given));
                assert!(!matches!(step, Step::Event(_)));
            }
            assert_eq!(machine.step(input), Step::Event(ExchangeEvent::Fault(fault)), "step {at}");
            works_again(&mut rig, &mut machine);
        }
    }
}

#[test]
fn a_pin_that_stays_high_without_a_cause_is_a_fault() {
    for (within, answers) in [(ExchangeState::Awaiting, false), (ExchangeState::Receiving, true)] {
        let (mut rig, mut machine) = ready(Chip::new(Variant::B));
        load(&mut rig, &mut machine);
        let end = rig.chip.now + 3 + FRAME_US;
        if answers {
            rig.chip.at(end + 700, Happening::Sync);
        }
        let mut step = Step::Transfer(Transfer::Short(Exchange::transmit()));
        let event = loop {
            rig.chip.pin_stuck |= machine.state() == within;
            let given = rig.carry_out(step);
            step = machine.step(rig.input(given));
            if let Step::Event(event) = step {
                break event;
            }
        };
        assert_eq!(event, ExchangeEvent::Fault(Fault::IrqStuck));
        assert!(rig.chip.now < end + 1_000);
        rig.chip.pin_stuck = false;
        works_again(&mut rig, &mut machine);
    }
}

#[test]
fn a_single_interrupt_without_a_cause_is_borne() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::B));
    let event = exchange(&mut rig, &mut machine, |chip, end| {
        for at in [400, 500, 600, 1_000, 1_100, 1_200, 1_300] {
            chip.at(end + at, Happening::Irq(MAIN, 0x08));
        }
        chip.frame(end + 700, &[3; 128]);
    });
    assert_eq!(event, ExchangeEvent::Answer { len: 128, flags: FrameFlags::empty() });
    works_again(&mut rig, &mut machine);
}

#[test]
fn a_frame_is_prepared_only_between_exchanges() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::A));
    assert_eq!(machine.prepare(0), Err(SendError::Length));
    assert_eq!(machine.prepare(255), Err(SendError::Length));
    assert!(machine.is_ready());
    load(&mut rig, &mut machine);
    assert!(!machine.is_ready());
    assert_eq!(machine.prepare(64), Err(SendError::NotReady));
    assert_eq!(rig.run(&mut machine, Step::Event(ExchangeEvent::Loaded)), ExchangeEvent::Ready);
    assert!(machine.is_ready() && rig.chip.sent.is_empty());
    load(&mut rig, &mut machine);
    assert_eq!(fire(&mut rig, &mut machine, |_, _| {}), SILENT);
    assert!(!machine.is_ready());
    assert_eq!(machine.prepare(64), Err(SendError::NotReady));
    works_again(&mut rig, &mut machine);
}

#[test]
fn an_answer_before_the_receiver_opens_is_not_received() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::B));
    let event = exchange(&mut rig, &mut machine, |chip, end| chip.frame(end + u64::from(OPENS_US), &[3; 128]));
    assert_eq!(event, SILENT);
    works_again(&mut rig, &mut machine);
}

#[test]
fn signals_outside_the_window_do_not_touch_the_frame() {
    let (mut rig, mut machine) = ready(Chip::new(Variant::B));
    // Another device's answer comes while a frame is being loaded, and another one between two exchanges.
    rig.chip.at(rig.chip.now + 20, Happening::Sync);
    load(&mut rig, &mut machine);
    rig.chip.at(rig.chip.now, Happening::Sync);
    assert_eq!(fire(&mut rig, &mut machine, |_, _| {}), SILENT);
    assert_eq!(rig.chip.sent.last().map(|(_, frame)| frame.clone()), Some((0..64).collect()));
    assert_eq!(rig.chip.irqs[MAIN] & RXS, 0);
    works_again(&mut rig, &mut machine);
}

#[test]
fn settings_are_read_back_in_turn_after_each_exchange() {
    for variant in VARIANTS {
        let (rig, machine) = ready(Chip::new(variant));
        for (space, address) in rig.chip.written() {
            let (mut rig, mut machine) = (rig.clone(), machine.clone());
            rig.chip.flip(space, address, 0);
            let told = (0..16).any(|_| {
                load_and_fire(&mut rig, &mut machine)
                    || matches!(
                        rig.run(&mut machine, Step::Event(SILENT)),
                        ExchangeEvent::Fault(Fault::Register { .. } | Fault::Reset)
                    )
            });
            assert!(told, "{variant:?}: {space} {address:02X}");
        }
    }
}

/// Sends a frame. Returns whether the exchange reports that a register differs from its setting.
fn load_and_fire(rig: &mut Rig, machine: &mut Exchange) -> bool {
    rig.payload = vec![1; 64];
    let step = machine.prepare(64).expect("it is ready");
    let mut event = rig.run(machine, step);
    if event == ExchangeEvent::Prepared {
        event = rig.run(machine, Step::Event(event));
    }
    if event == ExchangeEvent::Loaded {
        event = rig.run(machine, Step::Transfer(Transfer::Short(Exchange::transmit())));
    }
    matches!(event, ExchangeEvent::Fault(Fault::Register { .. } | Fault::Reset))
}

#[test]
fn the_steps_to_the_transmit_command_are_always_the_same() {
    // The test compares the bytes up to the transmit command after silence, after a good answer, after a damaged
    // answer, and after an endless one.
    let mut ways = vec![];
    for kind in 0..4 {
        let (mut rig, mut machine) = ready(Chip::new(Variant::B));
        exchange(&mut rig, &mut machine, |chip, end| match kind {
            0 => 0,
            1 => chip.frame(end + 700, &[kind; 128]),
            2 => chip.raw_frame(end + 700, &[kind; 77], Some(CRC)),
            _ => chip.raw_frame(end + 700, &[kind; 40], None),
        });
        rig.chip.clear_air();
        assert_eq!(rig.run(&mut machine, Step::Event(SILENT)), ExchangeEvent::Ready);
        rig.log();
        let begun = rig.chip.now;
        load(&mut rig, &mut machine);
        ways.push((rig.chip.now - begun, rig.log()));
    }
    assert!(ways.iter().all(|way| *way == ways[0]), "{ways:?}");
}
