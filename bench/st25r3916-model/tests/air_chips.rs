//! Tests the air's faults between two chips, as the listener's controller observes them.

use crate::common;

use common::{BYTE_NS, Pair, Side, exact, nfc_a_poller, payload};
use st25r3916_model::{Air, AirFaults, Config, Kind, Origin};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

fn clean() -> AirFaults {
    AirFaults::default()
}

fn pair(faults: AirFaults) -> Pair {
    Pair::started(exact(), exact(), Air::new(1, faults))
}

fn set(pair: &mut Pair, faults: AirFaults) {
    let Pair { air, listener, now, .. } = pair;
    air.set_faults(*now, faults, &mut |at, event| listener.hear(at, event));
}

fn send(pair: &mut Pair, n: usize, seed: u64) {
    pair.load(&payload(n, seed));
    pair.fire();
}

fn received(pair: &mut Pair) -> ([u8; 4], Vec<u8>) {
    let irqs = pair.irqs(Side::Listener);
    let (n, _) = pair.fifo(Side::Listener);
    let data = pair.read_fifo(Side::Listener, n);
    pair.arm();
    (irqs, data)
}

#[test]
fn the_crc_finds_every_burst_of_up_to_16_bits() {
    let mut pair = pair(AirFaults { burst: 1.0, burst_bits: 16, ..clean() });
    let mut whole = 0;
    for seed in 0..100 {
        send(&mut pair, 100, seed);
        pair.run_for(5 * MS);
        let heard = pair.air.take_heard().remove(0);
        let (irqs, data) = received(&mut pair);
        // The burst may hit LEN.
        if heard.bytes[0] == 101 {
            assert_eq!((irqs, &data), ([0x30, 0, 0x80, 0], &heard.bytes));
            whole += 1;
        } else {
            assert_ne!(irqs[2] & 0x80, 0);
        }
    }
    assert!(whole > 80, "{whole}");
    let counters = pair.air.counters();
    assert_eq!((counters.damaged, counters.delivered, counters.bursts), (100, 0, 100));
}

#[test]
fn a_repeated_frame_is_received_a_second_time_like_the_first() {
    let mut pair = pair(AirFaults { repeated: 1.0, repeat_after_ns: (MS, MS), ..clean() });
    send(&mut pair, 124, 1);
    pair.run_for(3 * MS);
    let first = received(&mut pair);
    assert_eq!(first.0, [0x30, 0, 0, 0]);
    assert!(!pair.listener.irq());
    pair.run_for(6 * MS);
    assert_eq!(received(&mut pair), first);
    pair.run_for(10 * MS);
    let heard = pair.air.take_heard();
    assert_eq!(heard.iter().map(|heard| heard.origin).collect::<Vec<_>>(), [Origin::Poller, Origin::Repeated]);
    assert_eq!(heard[1].started_ns, heard[0].ended_ns + MS);
    assert_eq!((pair.listener.statistics().received, pair.air.counters().delivered), (2, 1));
}

#[test]
fn a_delayed_frame_is_received_when_it_comes_and_not_before() {
    let mut pair = pair(AirFaults { delayed: 1.0, delay_ns: (12 * MS, 12 * MS), ..clean() });
    send(&mut pair, 124, 1);
    let start = pair.now + pair.poller.config().transmit_latency_ns;
    pair.run_to(start + 12 * MS);
    assert_eq!(pair.irqs(Side::Listener), [0; 4]);
    assert!(pair.wait_irq(Side::Listener, MS));
    // Preamble and sync have 64 bits.
    assert_eq!(pair.now, start + 12 * MS + 151_032 + pair.listener.config().nfc_f_latency_ns);
    pair.run_for(5 * MS);
    let (irqs, data) = received(&mut pair);
    assert_eq!((irqs, &data[1..125]), ([0x30, 0, 0, 0], &payload(124, 1)[..]));
}

#[test]
fn scattered_frames_all_arrive_each_later_by_its_own_amount() {
    let mut pair = pair(AirFaults { scatter_ns: 100 * US, ..clean() });
    let mut later = vec![];
    for seed in 0..50 {
        send(&mut pair, 60, seed);
        let start = pair.now + pair.poller.config().transmit_latency_ns;
        pair.run_for(3 * MS);
        let (irqs, data) = received(&mut pair);
        assert_eq!((irqs, &data[1..61]), ([0x30, 0, 0, 0], &payload(60, seed)[..]));
        later.push(pair.air.take_heard()[0].started_ns - start);
    }
    assert!(later.iter().any(|ns| *ns < 20 * US) && later.iter().any(|ns| *ns > 80 * US), "{later:?}");
    assert!(later.iter().all(|ns| *ns <= 100 * US));
}

#[test]
fn a_field_that_disappears_breaks_the_frame_off() {
    let mut pair = pair(clean());
    send(&mut pair, 244, 1);
    pair.run_for(2 * MS);
    pair.irqs(Side::Listener);
    set(&mut pair, AirFaults { field_off: true, ..clean() });
    pair.run_for(100 * US);
    assert_eq!(pair.irqs(Side::Listener), [0x10, 0x08, 0x90, 0], "I_rxe with errors, I_eof");
    pair.arm();
    pair.run_for(5 * MS);
    send(&mut pair, 20, 2);
    pair.run_for(2 * MS);
    assert_eq!(pair.irqs(Side::Listener), [0; 4]);
    set(&mut pair, clean());
    pair.run_for(100 * US);
    assert_eq!(pair.irqs(Side::Listener), [0, 0x10, 0, 0], "I_eon");
    pair.irqs(Side::Poller);
    send(&mut pair, 20, 3);
    pair.run_for(2 * MS);
    assert_eq!(received(&mut pair).0, [0x30, 0, 0, 0]);
    let counters = pair.air.counters();
    assert_eq!((counters.delivered, counters.damaged, counters.lost), (1, 1, 1));
}

#[test]
fn the_fifo_holds_the_bits_of_a_byte_that_breaks_off() {
    let sent = payload(60, 1);
    for bits in 0..24 {
        let mut pair = pair(clean());
        send(&mut pair, 60, 1);
        let start = pair.now + pair.poller.config().transmit_latency_ns;
        // The field goes off in the middle of a bit, after LEN and nine bytes of payload.
        let came = 64 + 80 + bits;
        pair.run_to(start + (2 * came + 1) * 18_879 / 16);
        set(&mut pair, AirFaults { field_off: true, ..clean() });
        pair.run_for(100 * US);
        assert_eq!(pair.irqs(Side::Listener), [0x30, 0x08, 0x90, 0], "{bits} bits");
        let (level, flags) = pair.fifo(Side::Listener);
        let (bytes, last) = (10 + bits as usize / 8, bits % 8);
        assert_eq!((level, flags), (bytes + usize::from(last != 0), (last as u8) << 1), "{bits} bits");
        let held = pair.read_fifo(Side::Listener, level);
        assert_eq!(held[1..bytes], sent[..bytes - 1], "{bits} bits");
        let of_last = held.get(bytes).copied().unwrap_or(0);
        assert_eq!(of_last, sent[bytes - 1] & !(0xFF >> last), "{bits} bits");
        // The air records whole bytes only.
        assert_eq!(pair.air.take_heard().remove(0).bytes, held[..bytes], "{bits} bits");
    }
}

#[test]
fn a_frame_that_collides_with_a_repetition_is_not_received() {
    let mut pair = pair(AirFaults { repeated: 1.0, repeat_after_ns: (MS, MS), ..clean() });
    send(&mut pair, 60, 1);
    pair.run_for(1_800 * US);
    assert_eq!(received(&mut pair).0, [0x30, 0, 0, 0]);
    set(&mut pair, clean());
    assert!(pair.wait_irq(Side::Listener, 5 * MS), "the repetition");
    assert_eq!(pair.irqs(Side::Listener), [0x20, 0, 0, 0]);
    send(&mut pair, 60, 2);
    pair.run_for(3 * MS);
    assert_eq!(received(&mut pair).0, [0x10, 0, 0x90, 0]);
    let counters = pair.air.counters();
    assert_eq!((counters.delivered, counters.lost, counters.collisions), (1, 1, 1));
    pair.irqs(Side::Poller);
    send(&mut pair, 60, 3);
    pair.run_for(3 * MS);
    assert_eq!(received(&mut pair).0, [0x30, 0, 0, 0]);
}

#[test]
fn a_frame_that_breaks_off_within_its_sync_is_not_received() {
    for (bits_in, seen) in [(20, false), (63, false), (70, true)] {
        let mut pair = pair(clean());
        send(&mut pair, 60, 1);
        let start = pair.now + pair.poller.config().transmit_latency_ns;
        pair.run_to(start + bits_in * 2_360 - BYTE_NS);
        // The command Stop (C2) breaks the frame off, but leaves the field on.
        pair.spi(Side::Poller, &[0xC2]);
        pair.run_for(MS);
        let irqs = pair.irqs(Side::Listener);
        assert_eq!(irqs, if seen { [0x30, 0, 0x90, 0] } else { [0; 4] }, "stopped at bit {bits_in}");
        assert_eq!(pair.listener.statistics().missed, u64::from(!seen));
    }
}

#[test]
fn a_frame_whose_fifo_runs_dry_is_not_delivered() {
    let mut pair = pair(clean());
    pair.load(&payload(100, 5));
    pair.spi(Side::Poller, &[0x22, 0x07, 0xA0]);
    pair.fire();
    pair.run_for(6 * MS);
    assert_ne!(pair.poller.reports().iter().find(|report| report.kind == Kind::TransmitUnderflow), None);
    let counters = pair.air.counters();
    assert_eq!((counters.sent, counters.delivered, counters.damaged), (1, 0, 1));
    let (sent, heard) = (pair.air.take_sent().remove(0), pair.air.take_heard().remove(0));
    assert!(!sent.whole && !heard.whole);
    assert_eq!((sent.bytes.len(), &sent.bytes[1..]), (101, &payload(100, 5)[..]));
    assert_eq!(heard.bytes, sent.bytes);
}

#[test]
fn an_nfc_a_frame_is_delivered_unless_its_fifo_runs_dry() {
    // The FIFO has all three bytes of the frame, or one byte too few. The last command sends a short frame without the
    // FIFO.
    for (loaded, command, delivered) in [(3, 0xC4, true), (2, 0xC4, false), (0, 0xC6, true)] {
        let mut pair = nfc_a_poller(Config::default());
        pair.spi(Side::Poller, &[0xDB]);
        pair.spi(Side::Poller, &[0x22, 0x00, 0x18]);
        pair.spi(Side::Poller, &[&[0x80], &payload(loaded, 1)[..]].concat());
        pair.spi(Side::Poller, &[command]);
        pair.run_for(2 * MS);
        let counters = pair.air.counters();
        assert_eq!((counters.sent, counters.delivered), (1, u64::from(delivered)), "{loaded} bytes");
        assert_eq!(pair.air.take_sent()[0].whole, delivered);
    }
}

#[test]
fn a_listener_behind_the_airs_time_still_receives_its_frames() {
    let faults = AirFaults { repeated: 1.0, repeat_after_ns: (2 * MS, 2 * MS), ..clean() };
    let mut pair = pair(faults);
    send(&mut pair, 60, 1);
    pair.listener.take_irq_edges().for_each(drop);
    let Pair { poller, listener, air, now } = &mut pair;
    let mut ahead = *now;
    let mut rises = vec![];
    for step in 0..10_000 {
        if step % 1_000 == 0 {
            ahead += MS;
            while let Some(at) = [poller.next_event(), air.next_event()].into_iter().flatten().min() {
                if at > ahead {
                    break;
                }
                poller.advance(at);
                for (at, event) in poller.take_air() {
                    air.from_poller(at, event, &mut |at, event| listener.hear(at, event));
                }
                air.advance(at, &mut |at, event| listener.hear(at, event));
            }
        }
        *now += US;
        listener.advance(*now);
        rises.extend(listener.take_irq_edges().filter(|edge| edge.level).map(|edge| edge.at_ns));
    }
    let heard = air.take_heard();
    assert_eq!(heard.len(), 2);
    assert_eq!(rises.len(), 1, "nobody reads the interrupts: one edge");
    assert_eq!(rises[0], heard[0].started_ns + 151_032 + listener.config().nfc_f_latency_ns);
    assert_eq!((listener.statistics().received, listener.statistics().missed), (1, 1), "not armed for the second");
}
