//! Tests how the DPR handles cycles that do not continue the sequence (docs/design.md#sequence). Some are repeated,
//! reordered or too early; others come from a HORUS that has restarted or whose clock is wrong.
//!
//! The frames of these tests are intact in every bit. Only their timestamps and instants may be wrong.

use crate::{boards, reader};

use bench::boards::Dpr;
use boards::{RAM_TEST, counter};
use dpr_fw::telemetry::Telemetry;
use emulator_node::{FromOutside, Node, Relay, Threads};
use profile::sequence::SEARCH_CYCLES;
use reader::{Antenna, MS, RECEIVERS, Reader, Sent, US, View, field_on, frame_ns, payload, send, views};
use stm32f429::Oscillators;

/// The instant at which the test's first frame begins, ns. The DPR has long started by then.
const FIRST: u64 = 60 * MS;

const OBJECTS: u32 = 4;

/// The longest time, ns, for which an object may be readable after the last bit of its frame.
const STALE: u64 = 30 * MS;

fn dpr() -> Option<Node<Dpr>> {
    let mut node = boards::dpr()?;
    field_on(&mut node);
    while node.now() < RAM_TEST {
        node.advance(RAM_TEST);
    }
    Some(node)
}

fn count(node: &Node<Dpr>, offset: usize) -> u32 {
    counter(node, "DPR_TELEMETRY", offset)
}

/// Returns the longest time, ns, from the last bit of a frame in `sent` to a reading of its data as valid.
fn oldest(views: &[View], sent: &[(u64, u32)]) -> u64 {
    let shown = views.iter().flat_map(|view| view.valid.iter().map(|timestamp| (view.at, *timestamp)));
    let ages = shown.map(|(at, timestamp)| {
        let first = sent.iter().find(|(ended, ms)| *ms == timestamp && *ended <= at);
        at - first.unwrap_or_else(|| panic!("{timestamp} ms was read at {at} ns, and never sent")).0
    });
    ages.max().unwrap_or(0)
}

#[test]
fn timestamps_20_10_20_10_and_so_on_show_nothing() {
    let Some(mut node) = dpr() else { return };
    for cycle in 0..60 {
        send(&mut node, FIRST + cycle * 10 * MS, &payload(if cycle % 2 == 0 { 20 } else { 10 }));
    }
    let views = views(&mut node, FIRST + 600 * MS);
    assert!(views.len() >= 200, "{}", views.len());
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, frames_received)), 60);
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, objects_accepted)), 0);
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, objects_rejected)), 60 * OBJECTS);
    let intact = views.iter().filter_map(|view| view.link);
    assert!(intact.clone().count() + 5 >= views.len(), "it is read throughout");
    assert!(intact.clone().all(|link| link.status.out_of_sequence() && !link.status.link_up()));
    assert!(intact.clone().next_back().is_some_and(|link| link.status.horus_restarted()));
    for view in &views {
        assert_eq!(view.valid, [0; 0], "at {} us", view.at / US);
    }
}

/// Returns for each frame in `sent` the instant of its last bit and its timestamp.
fn ends(sent: &[(u64, u32)]) -> Vec<(u64, u32)> {
    sent.iter().map(|(at, timestamp)| (at + frame_ns(), *timestamp)).collect()
}

#[test]
fn frames_that_follow_each_other_too_early_are_noticed_and_not_shown() {
    let Some(mut node) = dpr() else { return };
    // After ten correct cycles, frames come every millisecond with timestamps in steps of 10 ms.
    let mut at = FIRST;
    let mut sent = vec![];
    for cycle in 0..40 {
        send(&mut node, at, &payload(100 + 10 * cycle));
        sent.push((at, 100 + 10 * cycle));
        at += if cycle < 10 { 10 * MS } else { frame_ns() + MS };
    }
    let views = views(&mut node, at);
    // The eleventh frame comes 10 ms after the tenth, so it is the last that may be shown.
    let early = ends(&sent)[11].0;
    let newest = views.iter().flat_map(|view| &view.valid).max();
    assert_eq!(newest, Some(&200));
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, frames_received)), 40);
    let shown = 11 - u32::from(SEARCH_CYCLES);
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, objects_accepted)), shown * OBJECTS);
    let after: Vec<_> = views.iter().filter(|view| view.at > early + 150 * US).collect();
    assert!(after.len() >= 50, "{}", after.len());
    let told = after.iter().filter(|view| view.link.is_some()).count();
    assert!(told + 2 >= after.len(), "{told} of {} told it", after.len());
    for view in after {
        assert_eq!(view.valid, [0; 0], "at {} us", view.at / US);
        assert!(view.link.is_none_or(|link| link.status.out_of_sequence()), "at {} us: {view:?}", view.at / US);
    }
}

/// Sends a further frame between frames 20 and 21, a copy of the frame `back` cycles before frame 21.
fn inserted(back: u32) -> Option<()> {
    let mut node = dpr()?;
    let stamp = |cycle: u32| 500 + 10 * cycle;
    let mut sent = vec![];
    for cycle in 0..40 {
        sent.push((FIRST + u64::from(cycle) * 10 * MS, stamp(cycle)));
    }
    let insert = (FIRST + 200 * MS + frame_ns() + 200 * US, stamp(21 - back));
    sent.insert(21, insert);
    for (at, timestamp) in &sent {
        send(&mut node, *at, &payload(*timestamp));
    }
    let views = views(&mut node, FIRST + 400 * MS);
    let inserted_end = insert.0 + frame_ns();
    // Frame 21 comes too early, 5 ms after the inserted one. Frames 22 to 24 find the sequence again.
    let found = ends(&sent)[25].0;
    let during: Vec<_> = views.iter().filter(|view| (inserted_end + 150 * US..found).contains(&view.at)).collect();
    assert!(during.len() >= 10, "{back} back: {}", during.len());
    for view in during {
        assert_eq!(view.valid, [0; 0], "{back} back: at {} us", view.at / US);
        assert!(view.link.is_none_or(|link| link.status.out_of_sequence()), "{back} back: at {} us", view.at / US);
    }
    let newest: Vec<u32> = views.iter().filter_map(|view| view.valid.first().copied()).collect();
    assert!(newest.is_sorted(), "{back} back: {newest:?}");
    let first_again = newest.iter().find(|timestamp| **timestamp > stamp(20));
    assert_eq!(first_again, Some(&stamp(24)), "{back} back");
    let age = oldest(&views, &ends(&sent));
    assert!(age <= STALE, "{back} back: {age} ns");
    // The first three frames, the inserted one, and frames 21 to 23 are not shown.
    let accepted = count(&node, std::mem::offset_of!(Telemetry, objects_accepted));
    assert_eq!(accepted, (41 - 3 - 4) * OBJECTS, "{back} back");
    Some(())
}

#[test]
fn a_repeated_frame_that_is_inserted_once_is_never_shown_as_new() {
    for back in [1, 2, 9] {
        if inserted(back).is_none() {
            return;
        }
    }
}

#[test]
fn a_repeated_frame_in_its_successors_place_is_not_shown() {
    let Some(mut node) = dpr() else { return };
    let mut sent = vec![];
    for cycle in 0..30 {
        // Frames 15 to 17 repeat frame 14.
        let stamp = 500 + 10 * if (15..18).contains(&cycle) { 14 } else { cycle };
        sent.push((FIRST + u64::from(cycle) * 10 * MS, stamp));
    }
    for (at, timestamp) in &sent {
        send(&mut node, *at, &payload(*timestamp));
    }
    let views = views(&mut node, FIRST + 300 * MS);
    let (repeated, found) = (ends(&sent)[15].0, ends(&sent)[21].0);
    let during: Vec<_> = views.iter().filter(|view| (repeated + 150 * US..found).contains(&view.at)).collect();
    assert!(during.len() >= 15);
    assert!(during.iter().all(|view| view.valid.is_empty()));
    let frozen = during.iter().filter(|view| view.link.is_some_and(|link| link.status.horus_frozen()));
    assert!(frozen.count() >= 8);
    let age = oldest(&views, &ends(&sent));
    assert!(age <= STALE, "{age} ns");
    // Frame 18 comes 10 ms after frame 14, which is too early for a step of four cycles. Frames 19 to 21 find the
    // sequence again.
    let newest: Vec<u32> = views.iter().filter_map(|view| view.valid.first().copied()).collect();
    assert_eq!(newest.iter().find(|timestamp| **timestamp > 640), Some(&(500 + 210)));
}

/// Returns the sample's age at its frame's last bit, µs: the send slot and the air time, which are constants of the
/// profile.
const AGE_AT_END: u32 = match profile::air::age_at_end_us::<RECEIVERS>(0) {
    Some(age) => age,
    None => panic!("a frame of the cycle"),
};

fn both(oscillators: Oscillators) -> Option<Relay<bench::boards::Horus, Dpr, Antenna, Reader>> {
    let (a, b) = (boards::horus_on(oscillators)?, boards::dpr()?);
    Some(Relay { a, b, upstream: Antenna::default(), downstream: Reader::new() })
}

fn go<A, B, U, D>(relay: &mut Relay<A, B, U, D>, to: u64)
where
    A: emulator_node::Board,
    B: emulator_node::Board,
    U: emulator_node::Upstream<A>,
    D: emulator_node::Downstream<B, Message = U::Message, Notes = U::Notes>,
    Relay<A, B, U, D>: Sized,
    Node<A>: Send,
{
    relay.run(to, 10 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).expect("nothing ends it before");
}

#[test]
fn link_status_has_the_age_of_the_sample_at_publication() {
    let Some(mut relay) = both(Oscillators::default()) else { return };
    go(&mut relay, 200 * MS);
    let fresh = relay.downstream.views.iter().filter_map(|view| view.link).filter(|link| link.status.all_accepted());
    let ages: Vec<u32> = fresh.map(|link| u32::from(link.age_100us) * 100).collect();
    assert!(ages.len() >= 50, "{}", ages.len());
    // The publication comes up to 100 µs after the last bit, and Link-Status rounds the age down to 100 µs.
    for age in ages {
        assert!((AGE_AT_END - 99..=AGE_AT_END + 100).contains(&age), "{age} us");
    }
}

/// Returns which frame after the restart (from 1) was the first that was read as valid. Data of the last frame before
/// the restart do not count.
fn first_shown(reader: &Reader, restarted: u64) -> usize {
    let (before, since): (Vec<&Sent>, Vec<&Sent>) = reader.sent.iter().partition(|frame| frame.started < restarted);
    let last = before.last().expect("it sent before");
    let is_last = |view: &View| view.valid[0] == last.timestamp() && view.at <= last.ended + STALE;
    let mut after = reader.views.iter().filter(|view| view.at > restarted && !view.valid.is_empty());
    let shown = after.find(|view| view.at >= last.ended && !is_last(view)).expect("it is shown again");
    let nth = since.iter().position(|frame| frame.timestamp() == shown.valid[0]);
    1 + nth.unwrap_or_else(|| panic!("{shown:?} was not sent since the restart"))
}

#[test]
fn a_restarted_horus_is_shown_from_its_fourth_frame_on() {
    for why in [FromOutside::Pin, FromOutside::BrownOut, FromOutside::PowerOn(7)] {
        let Some(mut relay) = both(Oscillators::default()) else { return };
        go(&mut relay, 208 * MS);
        let restarted = relay.a.now();
        relay.a.restart(why);
        go(&mut relay, 400 * MS);
        let reader = &relay.downstream;
        let nth = first_shown(reader, restarted);
        let silence = reader.sent.iter().find(|frame| frame.started > restarted).unwrap().started - restarted;
        println!("{why:?}: first frame {} us after the restart, frame {nth} is the first shown", silence / US);
        // Frame 4 is shown, because it is the third that fits frame 1.
        assert_eq!(nth, 1 + usize::from(SEARCH_CYCLES), "{why:?}");
        let told = reader.views.iter().filter(|view| view.at > restarted).filter_map(|view| view.link);
        assert!(told.clone().any(|link| link.status.horus_restarted()), "{why:?}");
        let last = told.clone().next_back().unwrap();
        assert!(last.status.link_up() && !last.status.out_of_sequence(), "{why:?}: {last:?}");
    }
}

#[test]
fn after_a_watchdog_restart_horus_is_shown_from_its_fourth_frame_on() {
    let Some(mut relay) = both(Oscillators::default()) else { return };
    go(&mut relay, 207 * MS);
    // HORUS's task that parses messages never ends.
    let task = relay.a.address_of("CAN1_RX1").unwrap() & !1;
    let mut was = [0; 2];
    relay.a.read(task, &mut was).unwrap();
    relay.a.write(task, &0xE7FE_u16.to_le_bytes()).unwrap();
    let mut now = 210 * MS;
    while relay.a.resets().is_empty() {
        assert!(now < 450 * MS, "the watchdog did not bite");
        go(&mut relay, now);
        now += 5 * MS;
    }
    // A firmware that finds the damage during its start has to be reset once more.
    relay.a.write(task, &was).unwrap();
    go(&mut relay, now + 400 * MS);
    let restarted = relay.a.resets().last().unwrap().at;
    let nth = first_shown(&relay.downstream, restarted);
    println!("watchdog: {} restarts, frame {nth} is the first shown", relay.a.resets().len());
    assert_eq!(nth, 1 + usize::from(SEARCH_CYCLES));
}

#[test]
fn a_horus_clock_off_by_3_percent_is_reported_within_2600_ms() {
    for ppb in [30_000_000, -30_000_000] {
        let Some(mut relay) = both(Oscillators { hse_ppb: ppb, ..Oscillators::default() }) else { return };
        go(&mut relay, 2_800 * MS);
        let reader = &relay.downstream;
        let first = reader.sent[0].started;
        let implausible = |view: &&View| view.link.is_some_and(|link| link.status.horus_clock_implausible());
        let told = reader.views.iter().find(implausible).unwrap_or_else(|| panic!("{ppb} ppb: it is never told")).at;
        println!("{ppb} ppb: told {} us after the first frame began", (told - first) / US);
        assert!(told - first <= 2_600 * MS, "{ppb} ppb: {told}");
        let after: Vec<&View> = reader.views.iter().filter(|view| view.at > told).collect();
        assert!(after.len() >= 50, "{ppb} ppb");
        let shown = after.iter().filter(|view| !view.valid.is_empty()).count();
        assert!(shown * 10 >= after.len() * 9, "{ppb} ppb: {shown} of {} valid", after.len());
        assert!(after.iter().all(|view| view.link.is_none() || implausible(view)), "{ppb} ppb");
        let accepted = count(&relay.b, std::mem::offset_of!(Telemetry, objects_accepted)) as usize;
        let received = count(&relay.b, std::mem::offset_of!(Telemetry, frames_received)) as usize;
        assert_eq!(accepted, (received - usize::from(SEARCH_CYCLES)) * 4, "{ppb} ppb");
    }
}
