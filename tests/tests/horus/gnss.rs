//! Measures the time of the work from the receivers' bytes to a sealed profile.

use core::hint::black_box;

use horus_tx_fw::{
    cycle::Cycle,
    receiver::{Acceleration, Attitude, Position, Receiver, Solution, BYTES_PER_CALL},
    RECEIVERS,
};
use on_target_tests::cycles::{bounds, Cycles, Taken};

fn solution(valid: bool, value: f64) -> Solution {
    let single = value as f32;
    Solution {
        position: Position { valid, latitude: value, longitude: value, altitude: value, ..Position::default() },
        attitude: Attitude { valid, pitch: single, yaw: single, roll: single, ..Attitude::default() },
        acceleration: Acceleration { valid, axes: [single; 3], ..Acceleration::default() },
        ..Solution::default()
    }
}

/// Returns the solution of a receiver from which an intact NAV-PVT message has come at `now` ms, with a fix at
/// `latitude` (1e-7 degrees).
fn located(now: u32, latitude: i32, velocity: [i32; 3]) -> Solution {
    let mut receiver = Receiver::new();
    let message = nav_pvt(latitude, velocity);
    for bytes in message.chunks(BYTES_PER_CALL) {
        receiver.receive(bytes, now);
    }
    defmt::assert!(receiver.solution().position.valid);
    *receiver.solution()
}

/// Returns the NAV-PVT message of a 3D fix with accuracies of 1.5 m and 2.5 m. Every field without a parameter is zero.
fn nav_pvt(latitude: i32, velocity: [i32; 3]) -> [u8; 100] {
    let mut message = [0; 100];
    message[..6].copy_from_slice(&[0xB5, 0x62, 0x01, 0x07, 92, 0]);
    message[6 + 20] = 3; // fix type
    message[6 + 21] = 1; // gnssFixOK
    message[6 + 28..6 + 32].copy_from_slice(&latitude.to_le_bytes());
    message[6 + 40..6 + 44].copy_from_slice(&1_500_u32.to_le_bytes()); // hAcc
    message[6 + 44..6 + 48].copy_from_slice(&2_500_u32.to_le_bytes()); // vAcc
    for (at, axis) in (6 + 48..).step_by(4).zip(velocity) {
        message[at..at + 4].copy_from_slice(&axis.to_le_bytes());
    }
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in &message[2..98] {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    message[98..].copy_from_slice(&[a, b]);
    message
}

pub(crate) fn fill(cycles: &Cycles) {
    let values = [0.0, -0.0, 47.4979, f64::MIN_POSITIVE / 2.0, f64::MAX, f64::INFINITY, f64::NAN];
    let winterthur = located(1_230, 474_987_654, [12_000, -9_000, 1_500]);
    let beside = located(1_200, 474_987_754, [12_100, -9_050, 1_400]);
    let far = located(1_210, 474_000_000, [-200_000, 0, 0]);
    let pole = located(1_100, 899_999_990, [150_000, 1, -3]);
    let located = located(1_230, 0, [0; 3]);
    let mut inputs = [(123, [Solution::default(); RECEIVERS]); 24];
    for (place, value) in values.into_iter().enumerate() {
        inputs[place].1 = [solution(true, value); RECEIVERS];
        inputs[values.len() + place].1 = [solution(false, value); RECEIVERS];
    }
    inputs[15] = (123, [located; RECEIVERS]);
    inputs[16] = (124, [located, Solution::default(), located]);
    inputs[17] = (u32::MAX, [located; RECEIVERS]);
    inputs[18] = (123, [winterthur; RECEIVERS]);
    inputs[19] = (123, [winterthur, beside, winterthur]);
    inputs[20] = (124, [far, beside, winterthur]);
    inputs[21] = (124, [far, pole, winterthur]);
    inputs[22] = (124, [pole; RECEIVERS]);
    inputs[23] = (123, [Solution::default(), winterthur, beside]);
    let taken = cycles.over_prepared(
        &inputs,
        |(tick, solutions)| {
            let mut cycle = Cycle::new();
            cycle.vote(*tick, solutions);
            cycle
        },
        |(tick, solutions), cycle| cycle.fill(black_box(*tick), black_box(solutions)),
    );
    // Until its send slot HORUS has 24 µs for the tick and 14 µs for each object (`timing`), 9504 cycles together.
    taken.assert("Cycle::fill", bounds(4_800, 3_800, 9_504, 16));
    // The vote is timed twice: with an earlier result to compare with, and without one.
    let begun = |tick: u32, solutions: &[Solution; RECEIVERS]| {
        let mut cycle = Cycle::new();
        cycle.vote(tick.wrapping_sub(2), &[winterthur; RECEIVERS]);
        cycle.vote(tick.wrapping_sub(1), solutions);
        cycle
    };
    let taken = cycles.over_prepared(
        &inputs,
        |(tick, solutions)| if tick % 2 == 0 { Cycle::new() } else { begun(*tick, solutions) },
        |(tick, solutions), cycle| cycle.vote(black_box(*tick), black_box(solutions)),
    );
    // The vote runs after the frame was offered to the transmitter. Its only deadline is the next tick.
    taken.assert("Cycle::vote", bounds(10_000, 10_000, 16_000, u32::MAX));
}

/// Times `Receiver::receive` for the bytes of one call. The time is bounded but not constant, because a complete
/// message is converted and a false start is searched again. The call has a lower priority than all work with a
/// deadline.
pub(crate) fn receive(cycles: &Cycles) {
    let message = nav_pvt(474_987_654, [12_000, -9_000, 1_500]);
    let mut damaged = message;
    damaged[99] ^= 1;
    let mut false_start = [0xB5; 100];
    false_start[1..6].copy_from_slice(&[0x62, 0x01, 0x07, 240, 0]);
    let mut starts = [0x62; 100];
    starts.iter_mut().step_by(2).for_each(|byte| *byte = 0xB5);
    let mut taken = Taken::NONE;
    for stream in [message, damaged, false_start, starts, [0; 100], [0xFF; 100], [0xB5; 100], [b'$'; 100]] {
        let mut receiver = Receiver::new();
        let mut now = 0;
        for turn in 0..8 {
            for bytes in stream.chunks(BYTES_PER_CALL) {
                now += 10;
                taken.note(cycles.of(|| receiver.receive(black_box(bytes), now)));
            }
            // Before every second call the line is silent for a while, so that the receiver discards a false start.
            now += 100 * (turn % 2);
            taken.note(cycles.of(|| receiver.receive(&[], now)));
        }
    }
    taken.assert("Receiver::receive, one call", bounds(15_000, 12_000, 25_000, u32::MAX));
}
