//! Tests two chips through the air, driven over SPI as the data sheet specifies.

use crate::common;

use common::{Pair, Side, exact, payload};
use st25r3916_model::{Air, AirFaults, BrokenFrame, Config, Kind, Withheld};

fn clean() -> Air {
    Air::new(1, AirFaults::default())
}

fn pair() -> Pair {
    Pair::started(Config::default(), Config::default(), clean())
}

fn receive(pair: &mut Pair) -> ([u8; 4], Vec<u8>) {
    assert!(pair.wait_irq(Side::Listener, 7_000_000), "I_rxs");
    assert_eq!(pair.irqs(Side::Listener)[0], 0x20);
    assert!(pair.wait_irq(Side::Listener, 7_000_000), "I_rxe");
    let end = pair.irqs(Side::Listener);
    let (n, _) = pair.fifo(Side::Listener);
    let data = pair.read_fifo(Side::Listener, n);
    (end, data)
}

#[test]
fn every_payload_length_crosses_byte_exact_and_nothing_is_reported() {
    let mut pair = pair();
    for n in 1..=254 {
        let sent = payload(n, n as u64);
        pair.load(&sent);
        pair.fire();
        let (end, data) = receive(&mut pair);
        assert_eq!(end, [0x10, 0, 0, 0], "length {n}");
        assert_eq!(data.len(), n + 3, "LEN, payload, CRC-16");
        assert_eq!(usize::from(data[0]), n + 1);
        assert_eq!(data[1..=n], sent);
        pair.arm();
        pair.run_for(100_000);
        assert_eq!(pair.irqs(Side::Poller)[0] & 0x08, 0x08, "I_txe");
    }
    let counters = pair.air.counters();
    assert_eq!((counters.sent, counters.delivered, counters.answers), (254, 254, 0));
    assert_eq!(pair.poller.reports(), []);
    assert_eq!(pair.listener.reports(), []);
    assert_eq!(pair.listener.statistics().received, 254);
}

#[test]
fn air_time_is_that_of_the_data_sheet_at_either_crystal_error() {
    for (n, ppb, expected) in
        [(244, 0, 4_814_159), (254, 0, 5_002_950), (244, 50_000, 4_813_919), (244, -50_000, 4_814_400)]
    {
        let config = Config { crystal_ppb: ppb, ..exact() };
        let mut pair = Pair::started(config, Config::default(), clean());
        pair.load(&payload(n, 3));
        pair.fire();
        let fired = pair.now;
        let (end, data) = receive(&mut pair);
        assert_eq!((end, data.len()), ([0x10, 0, 0, 0], n + 3));
        let last = pair.air.last_frame().expect("a frame has ended");
        assert_eq!(last.end_ns - last.start_ns, expected);
        assert_eq!(last.start_ns - fired, pair.poller.config().transmit_latency_ns);
        assert_eq!((last.bits_per_second, last.data_bits), (424_000, 8 * (n as u32 + 3)));
    }
}

#[test]
fn a_frame_is_read_while_it_arrives() {
    let mut pair = pair();
    let sent = payload(244, 9);
    pair.load(&sent);
    pair.fire();
    assert!(pair.wait_irq(Side::Listener, 1_000_000));
    assert_eq!(pair.irqs(Side::Listener)[0], 0x20);
    let mut data = Vec::new();
    let mut most = 0;
    while data.len() < 247 {
        pair.run_for(200_000);
        let (n, flags) = pair.fifo(Side::Listener);
        assert_eq!(flags, 0);
        most = most.max(n);
        data.extend(pair.read_fifo(Side::Listener, n));
    }
    // In a millisecond 53 bytes arrive.
    assert!((10..=14).contains(&most), "{most} bytes in 200 us");
    assert_eq!(data[1..245], sent);
    assert_eq!(pair.irqs(Side::Listener), [0x10, 0, 0, 0]);
}

#[test]
fn it_sends_while_the_fifo_is_being_loaded() {
    let mut pair = pair();
    let sent = payload(244, 5);
    pair.load(&sent[..16]);
    pair.spi(Side::Poller, &[0x22, 0x07, 0xA0]);
    pair.fire();
    for part in sent[16..].chunks(19) {
        let mut load = vec![0x80];
        load.extend_from_slice(part);
        pair.spi(Side::Poller, &load);
        pair.run_for(150_000);
    }
    let (end, data) = {
        assert_eq!(pair.irqs(Side::Listener)[0], 0x20);
        assert!(pair.wait_irq(Side::Listener, 7_000_000));
        let end = pair.irqs(Side::Listener);
        let (n, _) = pair.fifo(Side::Listener);
        (end, pair.read_fifo(Side::Listener, n))
    };
    assert_eq!(end, [0x10, 0, 0, 0]);
    assert_eq!(data[1..245], sent);
    let last = pair.air.last_frame().expect("ended");
    assert_eq!(last.end_ns - last.start_ns, 4_814_159);
}

#[test]
fn running_dry_breaks_the_frame_off_and_the_receiver_says_so() {
    for broken in [BrokenFrame::EndsWithError, BrokenFrame::NeverEnds] {
        let listener = Config { broken_frame: broken, ..Config::default() };
        let mut pair = Pair::started(Config::default(), listener, clean());
        pair.load(&payload(100, 5));
        pair.spi(Side::Poller, &[0x22, 0x07, 0xA0]);
        pair.fire();
        pair.run_for(6_000_000);
        assert!(pair.poller.reports().iter().any(|r| r.kind == Kind::TransmitUnderflow));
        assert_eq!(pair.fifo(Side::Poller), (0, 0x20));
        assert_eq!(pair.listener.statistics().broken, 1);
        match broken {
            BrokenFrame::EndsWithError => assert_eq!(pair.irqs(Side::Listener), [0x30, 0, 0x90, 0]),
            BrokenFrame::NeverEnds => assert_eq!(pair.irqs(Side::Listener), [0x20, 0, 0, 0]),
        }
        pair.arm();
        pair.irqs(Side::Poller);
        pair.load(&payload(10, 6));
        pair.fire();
        assert_eq!(receive(&mut pair).0, [0x10, 0, 0, 0]);
    }
}

#[test]
fn the_water_level_of_a_long_frame_sets_its_masked_interrupt() {
    let mut pair = Pair::started(exact(), exact(), clean());
    pair.load(&payload(244, 5));
    pair.fire();
    let start = pair.now + pair.poller.config().transmit_latency_ns;
    // I_wl comes when byte 45 of the payload has left the FIFO, which then holds fewer than 200 bytes.
    pair.run_to(start + (72 + 44 * 8) * 2_360 - 4_000);
    assert_eq!(pair.irqs(Side::Poller)[0], 0);
    pair.run_for(4_000);
    assert!(!pair.poller.irq(), "masked");
    assert_eq!(pair.irqs(Side::Poller)[0], 0x40);
    pair.load(&[]);
}

#[test]
fn an_unarmed_listener_hears_nothing_until_unmasked() {
    let mut pair = pair();
    pair.load(&payload(20, 1));
    pair.fire();
    receive(&mut pair);
    pair.load(&payload(20, 2));
    pair.fire();
    pair.run_for(3_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0, 0, 0]);
    assert_eq!(pair.listener.statistics().missed, 1);
    pair.load(&payload(200, 3));
    pair.fire();
    pair.run_for(1_000_000);
    pair.arm();
    pair.run_for(5_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0, 0, 0]);
    pair.load(&payload(20, 4));
    pair.fire();
    assert_eq!(receive(&mut pair).1[1..21], payload(20, 4));
}

#[test]
fn a_sync_already_under_way_is_not_joined() {
    // A frame's sync is its bits 48 to 63.
    for (bits_into, heard) in [(40, true), (50, false), (62, false)] {
        let mut pair = Pair::started(exact(), exact(), clean());
        pair.spi(Side::Listener, &[0xD0]);
        pair.load(&payload(20, 1));
        pair.fire();
        let start = pair.now + pair.poller.config().transmit_latency_ns;
        pair.run_to(start + bits_into * 2_360 - 1_000);
        pair.spi(Side::Listener, &[0xD1]);
        pair.run_for(2_000_000);
        assert_eq!(pair.irqs(Side::Listener)[0] == 0x30, heard, "armed at bit {bits_into}");
    }
}

#[test]
fn a_target_without_field_detector_or_receiver_receives_nothing() {
    for operation in [0xC0, 0x83, 0xC3] {
        let mut pair = pair();
        pair.spi(Side::Listener, &[0x02, operation]);
        pair.run_for(100_000);
        pair.irqs(Side::Listener);
        pair.load(&payload(20, 1));
        pair.fire();
        pair.run_for(2_000_000);
        let expected = if operation == 0xC3 { 0x30 } else { 0 };
        assert_eq!(pair.irqs(Side::Listener)[0], expected, "02 = {operation:02X}");
    }
}

#[test]
fn two_frames_a_third_of_a_millisecond_apart_both_arrive() {
    let mut pair = pair();
    for seed in 0..2 {
        pair.load(&payload(184, seed));
        pair.fire();
        let (end, data) = receive(&mut pair);
        assert_eq!(end, [0x10, 0, 0, 0]);
        assert_eq!(data[1..185], payload(184, seed));
        let ended = pair.air.last_frame().expect("ended").end_ns;
        pair.arm();
        assert!(pair.now - ended < 300_000, "ready {} ns after the end", pair.now - ended);
    }
}

#[test]
fn an_unread_frame_is_lost_to_its_successor_never_appended() {
    let mut pair = pair();
    pair.load(&payload(20, 1));
    pair.fire();
    pair.run_for(1_000_000);
    pair.spi(Side::Listener, &[0xD1]);
    pair.irqs(Side::Listener);
    pair.load(&payload(30, 2));
    pair.fire();
    let (_, data) = receive(&mut pair);
    assert_eq!(data[1..31], payload(30, 2));
    assert_eq!(data.len(), 33);
    assert_eq!(pair.listener.statistics().overwritten, 1);
}

#[test]
fn field_off_and_on_raise_their_interrupts_and_break_a_frame() {
    let mut pair = pair();
    pair.load(&payload(244, 1));
    pair.fire();
    pair.run_for(2_000_000);
    pair.irqs(Side::Listener);
    pair.spi(Side::Poller, &[0x02, 0x80]);
    pair.run_for(100_000);
    let irqs = pair.irqs(Side::Listener);
    assert_eq!(irqs[1], 0x08, "I_eof");
    assert_eq!((irqs[0], irqs[2]), (0x10, 0x90), "the frame ends in errors");
    pair.spi(Side::Poller, &[0x02, 0x88]);
    pair.run_for(100_000);
    assert_eq!(pair.irqs(Side::Listener)[1], 0x10, "I_eon");
    pair.arm();
    pair.load(&payload(50, 7));
    pair.fire();
    assert_eq!(receive(&mut pair).1[1..51], payload(50, 7));
}

#[test]
fn the_link_recovers_after_either_chip_loses_its_supply() {
    let mut pair = pair();
    let now = pair.now;
    pair.listener.power_off(now);
    assert!(!pair.listener.irq());
    pair.run_for(1_000_000);
    let now = pair.now;
    pair.listener.power_on(now);
    assert_eq!(pair.spi(Side::Listener, &[0x7F, 0]), [0, 0x31]);
    pair.start_listener();
    assert!(pair.wait_irq(Side::Listener, 100_000), "the field was there all along");
    assert_eq!(pair.irqs(Side::Listener), [0, 0x10, 0, 0]);
    let now = pair.now;
    pair.poller.power_off(now);
    pair.run_for(50_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0x08, 0, 0]);
    let now = pair.now;
    pair.poller.power_on(now);
    pair.start_poller();
    pair.run_for(50_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0x10, 0, 0]);
    pair.load(&payload(50, 7));
    pair.fire();
    assert_eq!(receive(&mut pair).1[1..51], payload(50, 7));
}

#[test]
fn bit_errors_are_found_by_the_crc_and_counted_by_the_air() {
    let mut pair = Pair::started(
        Config::default(),
        Config::default(),
        Air::new(7, AirFaults { bit_error: 2e-4, ..AirFaults::default() }),
    );
    let (mut good, mut bad, mut none) = (0, 0, 0);
    for i in 0..300 {
        let sent = payload(244, i);
        pair.load(&sent);
        pair.fire();
        pair.run_for(5_500_000);
        let irqs = pair.irqs(Side::Listener);
        let (n, _) = pair.fifo(Side::Listener);
        let data = pair.read_fifo(Side::Listener, n);
        match irqs {
            [0x30, 0, 0, 0] => {
                assert_eq!(data[1..245], sent);
                good += 1;
            }
            [0, 0, 0, 0] => none += 1,
            [0x30, 0, flags, 0] => {
                assert_ne!(flags & 0x80, 0);
                bad += 1;
            }
            other => panic!("{other:02X?}"),
        }
        pair.arm();
    }
    let c = pair.air.counters();
    assert_eq!((c.sent, c.delivered, c.damaged, c.lost), (300, good, bad, none));
    assert!(good > 150 && bad > 50 && c.bit_errors > 90, "{c:?}");
}

#[test]
fn the_same_seed_loses_and_truncates_the_same_frames() {
    let run = |seed| {
        let faults = AirFaults { lost: 0.2, truncated: 0.3, ..AirFaults::default() };
        let mut pair = Pair::started(Config::default(), Config::default(), Air::new(seed, faults));
        let mut log = Vec::new();
        for i in 0..60 {
            pair.load(&payload(124, i));
            pair.fire();
            pair.run_for(3_500_000);
            log.push(pair.irqs(Side::Listener));
            pair.arm();
        }
        (log, pair.air.counters())
    };
    let (log, counters) = run(11);
    assert_eq!((log.clone(), counters), run(11));
    assert_ne!(log, run(12).0);
    assert_eq!(counters.delivered + counters.damaged + counters.lost, 60);
    assert!(counters.lost > 5 && counters.damaged > 8, "{counters:?}");
    let whole = log.iter().filter(|i| **i == [0x30, 0, 0, 0]).count() as u64;
    assert_eq!(whole, counters.delivered);
}

#[test]
fn a_listener_that_is_let_answers_and_the_air_counts_it() {
    let request = [0x00, 0xFF, 0xFF, 0x00, 0x00];
    for silenced in [false, true] {
        let mut pair = pair();
        if !silenced {
            pair.spi(Side::Listener, &[0x08, 0x50]);
            pair.spi(Side::Listener, &[0xFB, 0x28, 0x10]);
            pair.arm();
            assert!(pair.listener.reports().iter().any(|r| r.kind == Kind::AutomaticAnswersEnabled));
        }
        pair.load(&request);
        pair.fire();
        pair.run_for(6_000_000);
        assert_eq!(pair.air.counters().answers, u64::from(!silenced));
        let irqs = pair.irqs(Side::Listener);
        assert_eq!(irqs, if silenced { [0x30, 0, 0, 0] } else { [0x28, 0, 0, 0x18] });
    }
}

#[test]
fn bit_rate_detection_finds_424_and_a_fixed_rate_ignores_another() {
    let mut pair = pair();
    pair.spi(Side::Listener, &[0x03, 0xE8]);
    pair.arm();
    pair.load(&payload(20, 1));
    pair.fire();
    pair.run_for(1_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0x30, 0x01, 0, 0]);
    assert_eq!(pair.spi(Side::Listener, &[0x64, 0])[1] & 0x30, 0x20);
    // A listener at a fixed rate of 212 kbit/s does not receive a frame at 424 kbit/s.
    pair.spi(Side::Listener, &[0x03, 0xA0, 0x11]);
    pair.arm();
    pair.load(&payload(20, 2));
    pair.fire();
    pair.run_for(1_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0, 0, 0]);
    pair.spi(Side::Poller, &[0x04, 0x11]);
    pair.load(&payload(20, 3));
    pair.fire();
    assert_eq!(receive(&mut pair).1[1..21], payload(20, 3));
}

#[test]
fn initial_field_on_waits_for_silence_and_yields_to_a_foreign_field() {
    let mut pair = Pair::new(Config::default(), Config::default(), clean());
    pair.start(Side::Poller);
    pair.start(Side::Listener);
    for side in [Side::Poller, Side::Listener] {
        pair.spi(side, &[0x02, 0x83]);
    }
    pair.spi(Side::Poller, &[0xFB, 0x15, 0x00]);
    pair.spi(Side::Poller, &[0xC8]);
    let fired = pair.now;
    assert!(pair.wait_irq(Side::Poller, 1_000_000));
    // Collision avoidance takes 4096 carrier cycles.
    assert_eq!(pair.now - fired, 302_065 + pair.poller.config().field_on_latency_ns);
    assert_eq!(pair.irqs(Side::Poller), [0, 0, 0, 0x20]);
    assert!(pair.wait_irq(Side::Poller, 1_000_000));
    assert_eq!(pair.irqs(Side::Poller), [0, 0x02, 0, 0]);
    assert!(pair.poller.field_on());
    pair.irqs(Side::Listener);
    pair.spi(Side::Listener, &[0xC8]);
    pair.run_for(1_000_000);
    assert_eq!(pair.irqs(Side::Listener), [0, 0x04, 0, 0], "I_cac");
    assert!(!pair.listener.field_on());
}

#[test]
fn lock_step_with_a_microsecond_of_skew_changes_nothing() {
    let mut pair = pair();
    let base = pair.now;
    pair.load(&payload(244, 1));
    let mut now = pair.now;
    pair.poller.select(now);
    pair.poller.transfer(now + 1_000, 0xC4);
    pair.poller.deselect(now + 1_000);
    while now < base + 8_000_000 {
        now += 1_000;
        pair.listener.advance(now + 1_000);
        pair.poller.advance(now);
        pair.air.carry(&mut pair.poller, &mut pair.listener);
    }
    pair.now = now + 1_000;
    assert_eq!(pair.irqs(Side::Listener), [0x30, 0, 0, 0]);
    assert_eq!(pair.read_fifo(Side::Listener, 247)[1..245], payload(244, 1));
}

#[test]
fn withheld_interrupts_are_not_raised_although_the_frame_arrives() {
    let mut pair = pair();
    pair.run_for(1_000_000);
    pair.irqs(Side::Listener);
    pair.irqs(Side::Poller);
    let frame = |pair: &mut Pair| {
        pair.load(&payload(20, 1));
        pair.fire();
        pair.run_for(1_000_000);
        let seen = (pair.irqs(Side::Listener)[0], pair.irqs(Side::Poller)[0] & 0x08);
        let (n, _) = pair.fifo(Side::Listener);
        pair.read_fifo(Side::Listener, n);
        pair.arm();
        pair.run_for(100_000);
        (seen, n)
    };
    for (withheld, seen) in [(Withheld::FrameEnds, (0x20, 0)), (Withheld::All, (0, 0)), (Withheld::None, (0x30, 0x08))]
    {
        pair.listener.withhold(withheld);
        pair.poller.withhold(withheld);
        assert_eq!(frame(&mut pair), (seen, 23), "{withheld:?}");
    }
}

#[test]
fn reports_that_were_taken_are_reported_again_when_they_occur_again() {
    let mut chip = st25r3916_model::Chip::new(Config::default());
    for at in [1_000, 2_000] {
        chip.select(at);
        chip.select(at);
        chip.deselect(at);
        let reports = chip.take_reports();
        assert_eq!((reports.len(), reports[0].kind, reports[0].first_ns), (1, Kind::SelectedTwice, at));
        assert!(chip.reports().is_empty());
    }
}
