//! Tests that no machine panics or stops, whatever an executor or a chip does, and that it works again with a working
//! chip.

use proptest::collection::vec;
use proptest::prelude::*;
use st25r3916::listener::BUFFER;
use st25r3916::poller::HEAD;
use st25r3916::{
    Input, Listener, ListenerConfig, ListenerEvent, Poller, PollerConfig, PollerEvent, ReadMode, ReceiverMode, Step,
    Transfer, Variant,
};

use crate::stand_in::{Chip, Miso, Rig};

/// One input of an executor.
#[derive(Clone, Debug)]
enum Said {
    Start,
    Done(Vec<u8>),
    /// An answer of the requested length, made of these bytes.
    Answer([u8; 8]),
    Irq,
    Timeout,
    Failed,
    Send(usize),
}

/// Bytes of a real chip, more often than at random.
fn byte() -> impl Strategy<Value = u8> {
    prop_oneof![
        any::<u8>(),
        Just(0x00),
        Just(0xFF),
        Just(0x80),
        Just(0x20),
        Just(0x10),
        Just(0x30),
        Just(0x2A),
        Just(0x31)
    ]
}

fn said() -> impl Strategy<Value = Said> {
    prop_oneof![
        3 => Just(Said::Start),
        1 => vec(byte(), 0..12).prop_map(Said::Done),
        8 => prop::array::uniform8(byte()).prop_map(Said::Answer),
        3 => Just(Said::Irq),
        3 => Just(Said::Timeout),
        1 => Just(Said::Failed),
        1 => (0..300_usize).prop_map(Said::Send),
    ]
}

fn variant() -> impl Strategy<Value = Variant> {
    prop_oneof![Just(Variant::A), Just(Variant::B)]
}

fn listener_config() -> impl Strategy<Value = ListenerConfig> {
    prop_oneof![Just(ReadMode::StoreAndForward), Just(ReadMode::WhileFilling)]
        .prop_map(|read_mode| ListenerConfig { read_mode, ..ListenerConfig::new() })
}

fn poller_config() -> impl Strategy<Value = PollerConfig> {
    (prop_oneof![Just(ReceiverMode::Off), Just(ReceiverMode::OnMasked)], any::<bool>(), any::<bool>())
        .prop_map(|(receiver, check_left_over, check_field)| PollerConfig { receiver, check_left_over, check_field })
}

/// Checks that a step is within the documented limits.
fn check<E>(step: &Step<E>) {
    match *step {
        Step::Transfer(Transfer::Short(short)) => assert!((1..=8).contains(&short.bytes().len())),
        Step::Transfer(Transfer::Load { offset, len }) => {
            assert!((offset == 0 || offset == HEAD) && len >= 1 && offset + len <= 254);
        }
        Step::Transfer(Transfer::Read { offset, len }) => assert!(len >= 1 && offset + len <= BUFFER),
        Step::Wait { us } | Step::Delay { us } => assert!((1..=100_000).contains(&us)),
        Step::Event(_) => {}
    }
}

/// An answer to `step` of the right length that repeats `bytes`.
fn answer<E>(step: &Step<E>, bytes: [u8; 8]) -> Vec<u8> {
    let len = match *step {
        Step::Transfer(Transfer::Short(short)) => short.bytes().len(),
        Step::Transfer(Transfer::Read { len, .. }) => len,
        _ => 0,
    };
    bytes.iter().copied().cycle().take(len).collect()
}

/// Feeds the inputs and returns the outstanding step.
fn feed_listener(machine: &mut Listener, said: &[Said]) -> Step<ListenerEvent> {
    let mut step = machine.step(Input::Start);
    for input in said {
        check(&step);
        step = match input {
            Said::Start | Said::Send(_) => machine.step(Input::Start),
            Said::Done(bytes) => machine.step(Input::Done(bytes)),
            Said::Answer(bytes) => machine.step(Input::Done(&answer(&step, *bytes))),
            Said::Irq => machine.step(Input::Irq),
            Said::Timeout => machine.step(Input::Timeout),
            Said::Failed => machine.step(Input::Failed),
        };
    }
    check(&step);
    step
}

fn feed_poller(machine: &mut Poller, said: &[Said]) -> Step<PollerEvent> {
    let mut step = machine.step(Input::Start);
    for input in said {
        check(&step);
        step = match input {
            Said::Start => machine.step(Input::Start),
            Said::Send(len) => machine.prepare(*len).unwrap_or(step),
            Said::Done(bytes) => machine.step(Input::Done(bytes)),
            Said::Answer(bytes) => machine.step(Input::Done(&answer(&step, *bytes))),
            Said::Irq => machine.step(Input::Irq),
            Said::Timeout => machine.step(Input::Timeout),
            Said::Failed => machine.step(Input::Failed),
        };
    }
    check(&step);
    step
}

/// Sends frames every 10 ms until one is received whole, at most 30 of them (back-off and bring-up take about ten).
fn listens_again(rig: &mut Rig, machine: &mut Listener, mut step: Step<ListenerEvent>) -> bool {
    let payload: Vec<u8> = (0..244).map(|index| index as u8 ^ 0x5A).collect();
    let start = rig.chip.now;
    rig.chip.clear_air();
    for cycle in 1..=30 {
        rig.chip.frame(start + cycle * 10_000, &payload);
    }
    for _ in 0..5_000 {
        let given = rig.carry_out(step);
        step = machine.step(rig.input(given));
        check(&step);
        let whole = Step::Event(ListenerEvent::Frame { len: 244, flags: st25r3916::FrameFlags::empty() });
        // An earlier frame may still be in the FIFO, which is not the expected one.
        if step == whole && rig.buffer[1..=244] == payload {
            return true;
        }
        if rig.chip.now > start + 310_000 {
            return false;
        }
    }
    panic!("5000 steps within {} µs", rig.chip.now - start);
}

fn sends_again(rig: &mut Rig, machine: &mut Poller, mut step: Step<PollerEvent>) -> bool {
    rig.payload = vec![0xA5; 254];
    for _ in 0..400 {
        let given = match step {
            // An earlier frame may be loaded; it is given up.
            Step::Event(PollerEvent::Ready) => {
                if rig.load(machine, 254) != PollerEvent::Loaded {
                    return false;
                }
                let transmit = Step::Transfer(Transfer::Short(Poller::transmit()));
                return rig.poller(machine, transmit) == PollerEvent::Sent { confirmed: true }
                    && rig.chip.sent.last().is_some_and(|(_, frame)| *frame == rig.payload);
            }
            other => rig.carry_out(other),
        };
        step = machine.step(rig.input(given));
        check(&step);
    }
    false
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 256,
        failure_persistence: None,
        rng_seed: prop::test_runner::RngSeed::Fixed(3916),
        ..ProptestConfig::default()
    })]

    #[test]
    fn a_listener_takes_anything_and_listens_again(
        config in listener_config(),
        variant in variant(),
        said in vec(said(), 0..300),
    ) {
        let mut machine = Listener::new(config);
        let step = feed_listener(&mut machine, &said);
        let mut rig = Rig::new(Chip::new(variant));
        prop_assert!(listens_again(&mut rig, &mut machine, step));
    }

    #[test]
    fn a_poller_takes_anything_and_sends_again(
        config in poller_config(),
        variant in variant(),
        said in vec(said(), 0..300),
    ) {
        let mut machine = Poller::new(config);
        let step = feed_poller(&mut machine, &said);
        let mut rig = Rig::new(Chip::new(variant));
        prop_assert!(sends_again(&mut rig, &mut machine, step));
    }

    #[test]
    fn a_listener_on_a_noisy_bus_listens_again(
        config in listener_config(),
        variant in variant(),
        noise in vec((any::<u16>(), byte()), 1..400),
    ) {
        let mut rig = Rig::new(Chip::new(variant));
        let payload = [0x11; 244];
        for cycle in 1..=20 {
            rig.chip.frame(cycle * 10_000, &payload);
        }
        let mut machine = Listener::new(config);
        let mut step = machine.step(Input::Start);
        for (place, value) in noise {
            let given = rig.carry_out(step);
            // About one answer in eight has a byte that the chip did not send.
            let mut garbled = match rig.input(given) {
                Input::Done(bytes) => bytes.to_vec(),
                _ => Vec::new(),
            };
            step = match given {
                crate::stand_in::Given::Done if !garbled.is_empty() && place % 8 == 0 => {
                    let index = usize::from(place / 8) % garbled.len();
                    garbled[index] = value;
                    machine.step(Input::Done(&garbled))
                }
                _ => machine.step(rig.input(given)),
            };
            check(&step);
        }
        prop_assert!(listens_again(&mut rig, &mut machine, step));
    }

    #[test]
    fn a_chip_that_comes_and_goes_is_found_again(
        config in listener_config(),
        variant in variant(),
        outages in vec((1_000_u64..60_000, any::<bool>(), any::<bool>()), 1..12),
    ) {
        let mut rig = Rig::new(Chip::new(variant));
        let mut machine = Listener::new(config);
        let mut step = machine.step(Input::Start);
        for (us, high, reset) in outages {
            for miso in [if high { Miso::StuckHigh } else { Miso::StuckLow }, Miso::Driven] {
                rig.chip.miso = miso;
                if reset {
                    rig.chip.at(rig.chip.now, crate::stand_in::Happening::PowerUpReset);
                }
                let until = rig.chip.now + us;
                let mut steps = 0;
                while rig.chip.now < until {
                    let given = rig.carry_out(step);
                    step = machine.step(rig.input(given));
                    check(&step);
                    steps += 1;
                    prop_assert!(steps < 2_000, "a busy loop");
                }
            }
        }
        prop_assert!(listens_again(&mut rig, &mut machine, step));
    }
}
