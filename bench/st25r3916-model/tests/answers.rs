//! Tests answers by load modulation and their path to the poller. The chips are driven over SPI as public drivers do.

use crate::common;

use common::{Pair, Side, bits_ns_424, exact, payload};
use st25r3916_model::{Air, AirEvent, AirFaults, AnswerFaults, AnswerPath, Config, ForeignCard, Kind, Space, Variant};

/// The guard time of NFC-F between a frame and its answer, ns: 2672 carrier cycles.
const GUARD_NS: u64 = 197_050;
const NRE: u8 = 0x40;

fn clean() -> Air {
    Air::new(1, AirFaults::default())
}

/// Returns a poller with its receiver on, and a listener that may answer and has the settings of ST's table.
fn answering(poller: Config, listener: Config) -> Pair {
    let mut pair = Pair::started(poller, Config { answers: true, ..listener }, clean());
    let is_b = pair.listener.config().variant == Variant::St25r3916b;
    pair.spi(Side::Listener, &[0x29, if is_b { 0x2E } else { 0x5F }]);
    pair.spi(Side::Listener, &[0xFB, 0x28, if is_b { 0x90 } else { 0x10 }]);
    if is_b {
        pair.spi(Side::Listener, &[0xFB, 0x2E, 0x09]);
    }
    let [a, b] = pair.listener.config().tuning[1];
    pair.spi(Side::Listener, &[0x26, a, b]);
    pair.spi(Side::Listener, &[0x16, 0xC7]);
    pair.receive_nfc_f(Side::Poller);
    pair.spi(Side::Poller, &[0x16, 0x47, 0x3F]);
    // The no-response timer gets 669 steps of 64 carrier cycles, and the mask-receive timer 40.
    pair.spi(Side::Poller, &[0x10, 0x02, 0x9D, 0x00]);
    pair.spi(Side::Poller, &[0x0F, 0x28]);
    pair.spi(Side::Poller, &[0x02, 0xC8]);
    pair
}

fn exact_pair() -> Pair {
    answering(exact(), exact())
}

/// Sends a frame of 64 bytes to the listener, which reads it. Returns the instant of the frame's end.
fn ask(pair: &mut Pair) -> u64 {
    pair.load(&payload(64, 1));
    pair.fire();
    loop {
        assert!(pair.wait_irq(Side::Listener, 3_000_000), "I_rxs, I_rxe");
        if pair.irqs(Side::Listener)[0] & 0x10 != 0 {
            break;
        }
    }
    let (n, _) = pair.fifo(Side::Listener);
    pair.read_fifo(Side::Listener, n);
    assert_eq!(pair.irqs(Side::Poller)[0], 0x08, "I_txe");
    pair.air.last_frame().expect("it has ended").end_ns
}

fn load_answer(pair: &mut Pair, payload: &[u8]) {
    let [high, low] = ((payload.len() as u16) << 3).to_be_bytes();
    pair.spi(Side::Listener, &[0xDB]);
    pair.spi(Side::Listener, &[0x22, high, low]);
    pair.spi(Side::Listener, &[&[0x80], payload].concat());
}

fn answer(pair: &mut Pair, end_ns: u64, after_ns: u64, payload: &[u8]) {
    load_answer(pair, payload);
    let latency = pair.listener.config().transmit_latency_ns;
    pair.run_to((end_ns + after_ns - latency - common::BYTE_NS).max(pair.now));
    pair.spi(Side::Listener, &[0xC4]);
}

fn found(pair: &Pair, side: Side, kind: Kind) -> u64 {
    let chip = if side == Side::Poller { &pair.poller } else { &pair.listener };
    chip.reports().iter().find(|report| report.kind == kind).map_or(0, |report| report.count)
}

fn answered(pair: &mut Pair) -> bool {
    let end = ask(pair);
    let sent = payload(128, 9);
    answer(pair, end, 700_000, &sent);
    pair.run_for(4_000_000);
    let irqs = pair.irqs(Side::Poller);
    let (n, _) = pair.fifo(Side::Poller);
    let heard = pair.read_fifo(Side::Poller, n);
    pair.irqs(Side::Listener);
    pair.arm();
    pair.spi(Side::Poller, &[0xDB]);
    let whole = heard.len() == 131 && heard[1..129] == sent[..];
    assert!(!whole || irqs == [0x30, 0, 0, 0], "{irqs:02X?}");
    whole
}

#[test]
fn both_parts_hear_each_others_answers_and_nothing_is_found() {
    let strict =
        |config: Config| Config { unsuited_chain_receives: false, unsuited_modulation_reaches: false, ..config };
    for poller in [Config::default(), Config::st25r3916()] {
        for listener in [Config::default(), Config::st25r3916()] {
            let mut pair = answering(strict(poller.clone()), strict(listener));
            for _ in 0..3 {
                assert!(answered(&mut pair));
            }
            assert_eq!((pair.poller.reports(), pair.listener.reports()), (&[][..], &[][..]));
            assert_eq!(pair.air.counters().answers, 3);
        }
    }
}

#[test]
fn an_answer_begins_after_its_command_and_takes_its_air_time() {
    let mut pair = exact_pair();
    ask(&mut pair);
    pair.run_for(500_000);
    load_answer(&mut pair, &payload(128, 2));
    pair.spi(Side::Listener, &[0xC4]);
    let start = pair.now + pair.listener.config().transmit_latency_ns;
    assert!(pair.wait_irq(Side::Poller, 1_000_000));
    assert_eq!(pair.now, start + bits_ns_424(64) + pair.poller.config().nfc_f_latency_ns, "I_rxs at the sync");
    assert_eq!(pair.irqs(Side::Poller)[0], 0x20);
    assert!(pair.wait_irq(Side::Listener, 4_000_000));
    assert_eq!(pair.now, start + bits_ns_424(64 + 8 * 131), "I_txe with the last bit");
    assert_eq!(pair.irqs(Side::Listener), [0x08, 0, 0, 0]);
    assert!(pair.wait_irq(Side::Poller, 1_000_000));
    assert_eq!(pair.irqs(Side::Poller), [0x10, 0, 0, 0]);
    // The chip adds LEN and CRC-16 to the payload in the FIFO.
    let heard = pair.read_fifo(Side::Poller, 131);
    assert_eq!((heard[0], &heard[1..129]), (129, &payload(128, 2)[..]));
}

#[test]
fn an_answer_stops_the_no_response_timer() {
    let mut pair = exact_pair();
    let end = ask(&mut pair);
    assert!(pair.wait_irq(Side::Poller, 5_000_000));
    // The no-response timer is set to 669 * 64 cycles of 13.56 MHz.
    assert_eq!(pair.now - end, 3_157_522 + pair.poller.config().no_response_extra_ns);
    assert_eq!(pair.irqs(Side::Poller), [0, NRE, 0, 0]);
    pair.arm();
    let end = ask(&mut pair);
    answer(&mut pair, end, 2_900_000, &payload(128, 2));
    pair.run_for(6_000_000);
    assert_eq!(pair.irqs(Side::Poller), [0x30, 0, 0, 0]);
}

#[test]
fn an_answer_that_begins_under_the_mask_timer_is_not_received() {
    // The mask-receive timer of 188.8 µs must end before the answer's sync, 113.3 µs after the answer's beginning.
    for (after, heard) in [(50_000, false), (120_000, true), (GUARD_NS - 2_000, true), (GUARD_NS + 2_000, true)] {
        let mut pair = exact_pair();
        pair.load(&payload(4, 1));
        pair.fire();
        while pair.air.last_frame().is_none() {
            pair.run_for(1_000);
        }
        let end = pair.air.last_frame().expect("it has ended").end_ns;
        pair.run_for(6_000);
        pair.irqs(Side::Listener);
        pair.irqs(Side::Poller);
        load_answer(&mut pair, &payload(8, 2));
        let latency = pair.listener.config().transmit_latency_ns;
        pair.run_to(end + after - latency - common::BYTE_NS);
        pair.spi(Side::Listener, &[0xC4]);
        pair.run_for(2_000_000);
        assert_eq!(pair.irqs(Side::Poller)[0] == 0x30, heard, "{after}");
        let early = pair.listener.reports().iter().any(|report| matches!(report.kind, Kind::AnswerTooEarly(_)));
        assert_eq!(early, after < GUARD_NS, "{after}");
    }
}

#[test]
fn a_listener_without_load_modulation_stays_mute() {
    // HORUS link's listener has these settings. The driver's resistance never changes, so the listener does not
    // modulate.
    let mut pair = exact_pair();
    pair.spi(Side::Listener, &[0x29, 0xFF]);
    pair.spi(Side::Listener, &[0xFB, 0x28, 0x00]);
    assert!(!answered(&mut pair));
    assert_eq!(pair.air.counters().answers, 0);
    assert_eq!(pair.listener.statistics().sent, 1, "its transmitter ran");
    for (space, address, value) in [(Space::A, 0x29, 0xFF), (Space::B, 0x28, 0x00)] {
        assert!(found(&pair, Side::Listener, Kind::Modulation { space, address, value }) > 0, "{address:02X}");
    }
    assert_eq!(found(&pair, Side::Listener, Kind::LoadModulation), 0, "it is meant to answer");
}

#[test]
fn an_answer_of_a_listener_that_may_not_answer_is_a_finding() {
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.spi(Side::Listener, &[0x29, 0x2E]);
    pair.spi(Side::Listener, &[0xFB, 0x28, 0x90]);
    pair.spi(Side::Listener, &[0xFB, 0x2E, 0x09]);
    pair.load(&payload(64, 1));
    pair.fire();
    pair.run_for(3_000_000);
    load_answer(&mut pair, &payload(4, 1));
    pair.spi(Side::Listener, &[0xC4]);
    pair.run_for(1_000_000);
    assert_eq!(found(&pair, Side::Listener, Kind::LoadModulation), 1);
    assert_eq!(pair.air.counters().answers, 1);
}

#[test]
fn settings_that_cannot_answer_are_found_and_not_heard() {
    let b = Variant::St25r3916b;
    let a = Variant::St25r3916;
    type Written = (Space, u8, u8);
    let cases: [(Variant, &[u8], Written); 9] = [
        (a, &[0x29, 0x55], (Space::A, 0x29, 0x55)),
        (a, &[0x29, 0xF5], (Space::A, 0x29, 0xF5)),
        // This write selects an external modulator, which the board does not have.
        (a, &[0xFB, 0x28, 0x20], (Space::B, 0x28, 0x20)),
        (b, &[0x29, 0xEE], (Space::A, 0x29, 0xEE)),
        (b, &[0xFB, 0x28, 0xA0], (Space::B, 0x28, 0xA0)),
        // This write selects regulator-shaped modulation, which is not allowed in card mode.
        (b, &[0xFB, 0x28, 0x94], (Space::B, 0x28, 0x94)),
        // The writes of B28 and of 01 lead to undocumented combinations of dis_reg_am and act_amsink.
        (b, &[0xFB, 0x28, 0x10], (Space::B, 0x28, 0x10)),
        (b, &[0x01, 0x3D], (Space::B, 0x28, 0x90)),
        (b, &[0xFB, 0x2E, 0x01], (Space::B, 0x2E, 0x01)),
    ];
    for (variant, write, (space, address, value)) in cases {
        for reaches in [true, false] {
            let config = if variant == b { exact() } else { Config { transmit_scatter_ns: 0, ..Config::st25r3916() } };
            let listener = Config { unsuited_modulation_reaches: reaches, ..config };
            let mut pair = answering(exact(), listener);
            assert!(answered(&mut pair), "as it is set up");
            pair.spi(Side::Listener, write);
            assert_eq!(answered(&mut pair), reaches, "{write:02X?}");
            assert_eq!(found(&pair, Side::Listener, Kind::Modulation { space, address, value }), 1, "{write:02X?}");
        }
    }
}

#[test]
fn an_antenna_out_of_tune_does_not_answer() {
    let mut pair = answering(exact(), Config { unsuited_modulation_reaches: false, ..exact() });
    assert!(answered(&mut pair));
    let end = ask(&mut pair);
    pair.spi(Side::Listener, &[0x26, 0x80, 0x80]);
    answer(&mut pair, end, 700_000, &payload(128, 9));
    pair.run_for(4_000_000);
    assert_eq!(pair.irqs(Side::Poller), [0, NRE, 0, 0]);
}

#[test]
fn a_poller_that_does_not_listen_hears_no_answer() {
    // Each write prevents the poller's reception in another way.
    for write in [&[0x02u8, 0x88][..], &[0xD0], &[0x04, 0x21], &[0x0B, 0x08]] {
        let mut pair = answering(Config { unsuited_chain_receives: false, ..exact() }, exact());
        let end = ask(&mut pair);
        pair.spi(Side::Poller, write);
        answer(&mut pair, end, 700_000, &payload(128, 9));
        pair.run_for(4_000_000);
        assert_eq!(pair.irqs(Side::Poller)[0], 0, "{write:02X?}");
        assert_eq!((pair.air.counters().answers, pair.poller.statistics().received), (1, 0), "{write:02X?}");
    }
}

#[test]
fn horus_poller_never_hears_an_answer() {
    let mut pair = answering(exact(), exact());
    pair.spi(Side::Poller, &[0x02, 0x88]);
    for _ in 0..3 {
        assert!(!answered(&mut pair));
    }
    assert_eq!((pair.poller.statistics().received, pair.poller.statistics().missed), (0, 3));
}

#[test]
fn an_answer_without_a_field_or_without_a_frame_is_found() {
    let mut pair = exact_pair();
    load_answer(&mut pair, &payload(4, 1));
    pair.spi(Side::Listener, &[0xC4]);
    pair.run_for(1_000_000);
    assert_eq!(found(&pair, Side::Listener, Kind::AnswerUnasked), 1);
    pair.irqs(Side::Listener);
    pair.irqs(Side::Poller);
    pair.arm();
    let end = ask(&mut pair);
    answer(&mut pair, end, 700_000, &payload(4, 1));
    pair.run_for(1_000_000);
    assert_eq!(found(&pair, Side::Listener, Kind::AnswerUnasked), 1);
    load_answer(&mut pair, &payload(4, 1));
    pair.spi(Side::Listener, &[0xC4]);
    pair.run_for(1_000_000);
    assert_eq!(found(&pair, Side::Listener, Kind::AnswerUnasked), 2);
    pair.spi(Side::Poller, &[0x02, 0xC0]);
    pair.run_for(100_000);
    load_answer(&mut pair, &payload(4, 1));
    pair.spi(Side::Listener, &[0xC4]);
    assert_eq!(found(&pair, Side::Listener, Kind::TransmitWithoutField), 1);
    assert!(!pair.listener.is_transmitting());
}

#[test]
fn an_answer_that_runs_dry_breaks_off() {
    let mut pair = exact_pair();
    let end = ask(&mut pair);
    load_answer(&mut pair, &payload(40, 1));
    pair.spi(Side::Listener, &[0x22, 0x04, 0x00]);
    pair.run_to(end + 700_000);
    pair.spi(Side::Listener, &[0xC4]);
    pair.run_for(4_000_000);
    assert_eq!(found(&pair, Side::Listener, Kind::TransmitUnderflow), 1);
    assert_eq!(pair.irqs(Side::Poller), [0x30, 0, 0x90, 0]);
}

#[test]
fn a_poller_that_sends_or_is_switched_off_drops_the_answer() {
    for off in [&[0x02u8, 0x80][..], &[0xC2], &[0xC4]] {
        let mut pair = exact_pair();
        let end = ask(&mut pair);
        answer(&mut pair, end, 700_000, &payload(128, 9));
        pair.run_for(1_000_000);
        assert_eq!(pair.irqs(Side::Poller)[0], 0x20);
        pair.spi(Side::Poller, off);
        pair.run_for(4_000_000);
        assert_eq!(pair.irqs(Side::Poller)[0] & 0x10, 0, "{off:02X?}");
        assert_eq!(pair.poller.statistics().received, 0);
    }
}

#[test]
fn the_switches_decide_whether_transmission_and_unmasking_change_the_receiver() {
    for transmit_unmasks in [false, true] {
        let mut pair = answering(Config { transmit_unmasks, ..exact() }, exact());
        pair.spi(Side::Poller, &[0xD0]);
        assert_eq!(answered(&mut pair), transmit_unmasks);
    }
    for unmask_clears_fifo in [false, true] {
        let mut pair = answering(Config { unmask_clears_fifo, ..exact() }, exact());
        pair.load(&payload(16, 1));
        pair.spi(Side::Poller, &[0xD1]);
        assert_eq!(pair.fifo(Side::Poller).0, if unmask_clears_fifo { 0 } else { 16 });
    }
}

struct Back {
    path: AnswerPath,
    heard: Vec<(u64, AirEvent)>,
}

impl Back {
    fn new(faults: AnswerFaults) -> Self {
        let mut back = Self { path: AnswerPath::new(5, faults), heard: vec![] };
        back.poller(0, &AirEvent::FieldOn);
        back
    }

    fn poller(&mut self, at: u64, event: &AirEvent) {
        let heard = &mut self.heard;
        self.path.from_poller(at, event, &mut |at, event| heard.push((at, event.clone())));
    }

    fn listener(&mut self, at: u64, event: AirEvent) {
        let heard = &mut self.heard;
        self.path.from_listener(at, event, &mut |at, event| heard.push((at, event.clone())));
    }

    fn run_to(&mut self, to: u64) {
        let heard = &mut self.heard;
        while let Some(at) = self.path.next_event().filter(|at| *at <= to) {
            self.path.advance(at, &mut |at, event| heard.push((at, event.clone())));
        }
        self.path.advance(to, &mut |at, event| heard.push((at, event.clone())));
    }

    fn answer(&mut self, at: u64) -> u64 {
        let bytes = common::antenna::frame(8, 3);
        let mut start = common::antenna::start(st25r3916_model::Technology::NfcF, &bytes);
        start.load_modulation = true;
        self.listener(at, AirEvent::FrameStart(start));
        let end = at + bits_ns_424(64 + 8 * 11);
        self.run_to(end - 1);
        self.listener(end, AirEvent::FrameEnd { bits: 88 });
        end
    }

    fn frames(&self) -> (Vec<u64>, Vec<u32>) {
        let starts = self.heard.iter().filter(|(_, event)| matches!(event, AirEvent::FrameStart(_))).map(|(at, _)| *at);
        let ends = self.heard.iter().filter_map(|(_, event)| match event {
            AirEvent::FrameEnd { bits } => Some(*bits),
            _ => None,
        });
        (starts.collect(), ends.collect())
    }
}

fn foreign_at(after: u64) -> AnswerFaults {
    let foreign = ForeignCard { answers: 1.0, after_ns: (after, after), payload: 8 };
    AnswerFaults { foreign, ..AnswerFaults::default() }
}

#[test]
fn the_way_back_passes_answers_and_no_carrier() {
    let mut back = Back::new(AnswerFaults::default());
    back.poller(10, &AirEvent::FrameEnd { bits: 8 });
    back.answer(1_000_000);
    back.poller(5_000_000, &AirEvent::FieldOff);
    back.poller(6_000_000, &AirEvent::FieldOn);
    back.path.set_faults(
        7_000_000,
        AnswerFaults { way: AirFaults { field_off: true, ..AirFaults::default() }, ..AnswerFaults::default() },
        &mut |_, _| panic!("no event"),
    );
    assert_eq!(back.frames(), (vec![1_000_000], vec![88]));
    assert_eq!(back.heard.len(), 2);
    assert_eq!(back.path.take_heard().len(), 1);
}

#[test]
fn a_carrier_that_goes_off_breaks_every_answer_off() {
    let mut back = Back::new(foreign_at(3_000_000));
    let bytes = common::antenna::frame(8, 3);
    let start = common::antenna::start(st25r3916_model::Technology::NfcF, &bytes);
    back.poller(0, &AirEvent::FrameEnd { bits: 8 });
    back.listener(1_000_000, AirEvent::FrameStart(start));
    back.poller(1_000_000 + bits_ns_424(64 + 20), &AirEvent::FieldOff);
    back.listener(1_000_000 + bits_ns_424(64 + 88), AirEvent::FrameEnd { bits: 88 });
    back.poller(2_000_000, &AirEvent::FieldOn);
    back.run_to(9_000_000);
    assert_eq!(back.frames(), (vec![1_000_000], vec![20]));
    assert_eq!(back.path.counters().damaged, 1);
    assert_eq!(back.path.foreign_answers(), 0);
}

#[test]
fn a_foreign_card_answers_a_frame_with_one_of_its_own() {
    let mut back = Back::new(foreign_at(400_000));
    assert_eq!(back.path.next_event(), None);
    back.poller(1_000_000, &AirEvent::FrameEnd { bits: 8 });
    assert_eq!(back.path.next_event(), Some(1_400_000));
    back.run_to(1_400_000);
    assert_eq!(back.path.next_event(), Some(1_400_000 + bits_ns_424(64 + 88)));
    back.run_to(5_000_000);
    assert_eq!((back.frames(), back.path.next_event()), ((vec![1_400_000], vec![88]), None));
    let heard = back.path.take_heard().pop().expect("one");
    assert_eq!((heard.bytes[0], heard.bytes.len(), heard.whole), (9, 11, true));
    let (body, crc) = heard.bytes.split_at(9);
    assert_eq!(st25r3916_model::nfc_f(body), crc);
}

#[test]
fn answers_that_meet_are_both_lost_or_broken_off() {
    let mut back = Back::new(foreign_at(400_000));
    back.poller(0, &AirEvent::FrameEnd { bits: 8 });
    back.answer(400_000 + bits_ns_424(64 + 16));
    back.run_to(5_000_000);
    assert_eq!(back.frames(), (vec![400_000], vec![16]));
    assert_eq!((back.path.collisions(), back.path.counters().damaged, back.path.counters().delivered), (1, 1, 0));

    let mut back = Back::new(foreign_at(400_000 + bits_ns_424(64 + 24)));
    back.poller(0, &AirEvent::FrameEnd { bits: 8 });
    back.answer(400_000);
    back.run_to(5_000_000);
    assert_eq!(back.frames(), (vec![400_000], vec![24]));
    assert_eq!((back.path.collisions(), back.path.foreign_answers()), (1, 1));
    back.answer(6_000_000);
    assert_eq!(back.frames(), (vec![400_000, 6_000_000], vec![24, 88]));
}

#[test]
fn a_foreign_card_has_one_answer_at_a_time() {
    let mut back = Back::new(foreign_at(400_000));
    back.poller(0, &AirEvent::FrameEnd { bits: 8 });
    back.poller(100_000, &AirEvent::FrameEnd { bits: 8 });
    back.run_to(600_000);
    back.poller(600_000, &AirEvent::FrameEnd { bits: 8 });
    back.run_to(5_000_000);
    assert_eq!(back.frames(), (vec![500_000, 1_000_000], vec![88, 88]));
}
