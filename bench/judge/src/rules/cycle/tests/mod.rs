mod field;
mod frames;
mod hang;
mod jitter;
mod restarts;
mod ticks;

use super::*;
use crate::testing::{COMMAND, Events, FIRST_TICK, LATENCY, MS, found, header};

const CYCLE: u64 = bounds::CYCLE;
const CYCLES: u64 = 20;

fn tick(number: u64) -> u64 {
    FIRST_TICK + (number - 1) * CYCLE
}

fn broken(events: &Events) -> Vec<(Violation, u64, u64)> {
    found(Cycle::new(&header(events.gps)), &events.log()).0
}

fn changed(gps: usize, change: impl FnOnce(&mut Events)) -> Vec<(Violation, u64, u64)> {
    let mut events = Events::flawless(gps, CYCLES);
    change(&mut events);
    broken(&events)
}

fn of(number: u64) -> impl Fn(&Event) -> bool {
    move |event| event.at >= tick(number) && event.at < tick(number + 1)
}

fn is_tick(event: &Event) -> bool {
    matches!(event.what, What::Tick)
}

fn is_command(event: &Event) -> bool {
    matches!(event.what, What::Command)
}

fn is_sent(event: &Event) -> bool {
    matches!(event.what, What::Sent { .. })
}

fn shift(events: &mut Events, by: i64, which: impl Fn(&Event) -> bool) {
    for event in events.events.iter_mut().filter(|event| which(event)) {
        event.at = event.at.checked_add_signed(by).unwrap();
        if let What::Sent { started, .. } = &mut event.what {
            *started = started.checked_add_signed(by).unwrap();
        }
    }
}

fn payload(events: &mut Events, number: u64, change: impl Fn(&mut Vec<u8>)) {
    let mut cycle = events.events.iter_mut().filter(|event| of(number)(event) && is_sent(event)).peekable();
    assert!(cycle.peek().is_some());
    for event in cycle {
        if let What::Sent { bytes, .. } = &mut event.what {
            let crc = bytes.0.len() - 2;
            let mut payload = bytes.0[1..crc].to_vec();
            change(&mut payload);
            bytes.0.splice(1..crc, payload);
        }
    }
}

fn end(gps: usize, number: u64) -> u64 {
    let events = Events::flawless(gps, number);
    events.events.iter().filter(|event| is_sent(event)).map(|event| event.at).max().unwrap()
}

/// Returns a payload for three receivers, with these timestamps of Reported-Position and of each GPS object.
fn stamped(stamps: [u32; 4]) -> Vec<u8> {
    let [reported, gps @ ..] = stamps;
    let gps = gps.map(crate::testing::silent_gps);
    crate::testing::objects(&crate::testing::silent_reported(reported), &gps).concat()
}
