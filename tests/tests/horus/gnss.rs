//! From bytes of the receivers to a sealed profile.

use core::hint::black_box;

use horus_tx_fw::{
    cycle::Cycle,
    receiver::{Acceleration, Attitude, Position, Receiver, Solution, BYTES_PER_CALL},
    RECEIVERS,
};
use on_target_tests::cycles::{bounds, Cycles, Taken};

/// A solution whose every value is `value`, valid or not.
fn solution(valid: bool, value: f64) -> Solution {
    let single = value as f32;
    Solution {
        position: Position { valid, latitude: value, longitude: value, altitude: value, ..Position::default() },
        attitude: Attitude { valid, pitch: single, yaw: single, roll: single, ..Attitude::default() },
        acceleration: Acceleration { valid, axes: [single; 3], ..Acceleration::default() },
        ..Solution::default()
    }
}

/// A receiver that has sent an intact NAV-PVT of a fix, at `now` ms.
fn located(now: u32) -> Solution {
    let mut receiver = Receiver::new();
    let message = nav_pvt();
    for bytes in message.chunks(BYTES_PER_CALL) {
        receiver.receive(bytes, now);
    }
    defmt::assert!(receiver.solution().position.valid);
    *receiver.solution()
}

/// NAV-PVT of a 3D fix, everything else zero.
fn nav_pvt() -> [u8; 100] {
    let mut message = [0; 100];
    message[..6].copy_from_slice(&[0xB5, 0x62, 0x01, 0x07, 92, 0]);
    message[6 + 20] = 3; // fix type
    message[6 + 21] = 1; // gnssFixOK
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in &message[2..98] {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    message[98..].copy_from_slice(&[a, b]);
    message
}

/// `Cycle::fill`, whatever the receivers have said.
pub(crate) fn fill(cycles: &Cycles) {
    let values = [0.0, -0.0, 47.4979, f64::MIN_POSITIVE / 2.0, f64::MAX, f64::INFINITY, f64::NAN];
    let located = located(1_230);
    let mut inputs = [(123, [Solution::default(); RECEIVERS]); 18];
    for (place, value) in values.into_iter().enumerate() {
        inputs[place].1 = [solution(true, value); RECEIVERS];
        inputs[values.len() + place].1 = [solution(false, value); RECEIVERS];
    }
    inputs[15] = (123, [located; RECEIVERS]);
    inputs[16] = (124, [located, Solution::default(), located]);
    inputs[17] = (u32::MAX, [located; RECEIVERS]);
    let taken = cycles.over_prepared(
        &inputs,
        |_| Cycle::new(),
        |(tick, solutions), cycle| cycle.fill(black_box(*tick), black_box(solutions)),
    );
    // The slot leaves 24 µs of the tick and 14 µs an object (`timing`): 9504 cycles.
    taken.assert("Cycle::fill", bounds(4_800, 3_800, 9_504, 16));
}

/// `Receiver::receive` of one call's bytes: bounded, not constant, since a message that is complete is converted and a
/// false start is looked through again. It runs below everything that has a deadline.
pub(crate) fn receive(cycles: &Cycles) {
    let message = nav_pvt();
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
            // A silence now and then, after which a false start is given up.
            now += 100 * (turn % 2);
            taken.note(cycles.of(|| receiver.receive(&[], now)));
        }
    }
    taken.assert("Receiver::receive, one call", bounds(15_000, 12_000, 25_000, u32::MAX));
}
