//! From what the receivers said to the objects of one tick
//!
//! # Design
//!
//! [`Cycle::fill`] is called once per tick, and does the same work whatever the receivers have said: every
//! object is written and sealed in full, the same bytes pass through the same CRCs, and a value that is
//! not valid is replaced by the NaN of the design by selection, not by skipping. There is no early return.
//!
//! Reported-Position is GPS1's values: no voter compares the receivers yet, and the status says so. It claims one
//! receiver that agrees (GPS1 with itself) or none, and is *degraded* whenever that is fewer than are fitted. Its
//! validity is GPS1's at every tick: a receiver that falls silent takes Reported-Position's validity along, one period
//! and 150 ms after its last message (see [`receiver`](crate::receiver)). HORUS is *starting* until GPS1 has had its
//! first valid position, and *monitoring* from then on.

use profile::{
    GpsStatus, GpsValues, HorusState, Profile, ReportedStatus, ReportedValues, ABSENT_F32, ABSENT_F64, CYCLE_MS,
};

use crate::{
    clock::Source,
    receiver::{Solution, HEARD_MS},
};

/// The time of tick `tick`, ms since the start: every tick is 10 ms after the one before it. The
/// milliseconds and the ticks wrap together, so the step is 10 there as well.
#[must_use]
pub const fn timestamp(tick: u32) -> u32 {
    tick.wrapping_mul(CYCLE_MS)
}

/// What is remembered from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cycle {
    /// GPS1 has had a valid position since the start.
    located: bool,
    clock: Source,
}

impl Cycle {
    /// The first cycle of a HORUS that runs on the external clock.
    #[must_use]
    pub const fn new() -> Self {
        Self::on(Source::External)
    }

    /// The first cycle of a HORUS that runs on `clock`, which Reported-Position's status tells.
    #[must_use]
    pub const fn on(clock: Source) -> Self {
        Self { located: false, clock }
    }

    /// The sealed profile of tick `tick`, from what each receiver has said until then.
    pub fn fill<const N: usize>(&mut self, tick: u32, solutions: &[Solution; N]) -> Profile<N> {
        let now = timestamp(tick);
        let mut gps = [GpsValues::absent(now); N];
        for (values, solution) in gps.iter_mut().zip(solutions) {
            *values = gps_values(solution, now);
        }
        // A profile has at least one receiver.
        let first = &gps[0];
        self.located |= first.status.position_valid();
        Profile::seal(&self.reported_values(first, N), &gps)
    }

    /// Reported-Position as GPS1 alone has it.
    fn reported_values(&self, first: &GpsValues, receivers: usize) -> ReportedValues {
        let valid = first.status.position_valid();
        let agreeing = u8::from(valid);
        ReportedValues {
            timestamp: first.timestamp,
            status: ReportedStatus::new()
                .with_receivers_agreeing(agreeing)
                .with_position_valid(valid)
                .with_attitude_valid(first.status.attitude_valid())
                .with_acceleration_valid(first.status.acceleration_valid())
                .with_degraded(usize::from(agreeing) < receivers)
                .with_without_crystal(self.clock == Source::Internal)
                .with_state(if self.located { HorusState::Monitoring } else { HorusState::Starting }),
            latitude: first.latitude,
            longitude: first.longitude,
            altitude: first.altitude,
            pitch: first.pitch,
            yaw: first.yaw,
            roll: first.roll,
            acceleration: first.acceleration,
        }
    }
}

/// `value` if it is to be shown, else the NaN of the design.
fn shown_f64(shown: bool, value: f64) -> f64 {
    if shown {
        value
    } else {
        ABSENT_F64
    }
}

fn shown_f32(shown: bool, value: f32) -> f32 {
    if shown {
        value
    } else {
        ABSENT_F32
    }
}

/// One receiver's object at `now` ms.
fn gps_values(solution: &Solution, now: u32) -> GpsValues {
    let Solution { heard, position, attitude, acceleration } = solution;
    let current = position.pace.is_current(now);
    let located = position.valid & current;
    let oriented = attitude.pace.is_current(now);
    let moved = acceleration.pace.is_current(now);

    let mut status = GpsStatus::new()
        .with_position_valid(located)
        .with_attitude_valid(attitude.valid & oriented)
        .with_acceleration_valid(acceleration.valid & moved)
        .with_heard(heard.within(now, HEARD_MS))
        .with_stale(!position.pace.is_fresh(now));
    if let (Some(fix), true) = (position.fix, current) {
        status = status.with_fix_type(fix);
    }
    GpsValues {
        timestamp: now,
        status,
        latitude: shown_f64(located, position.latitude),
        longitude: shown_f64(located, position.longitude),
        altitude: shown_f64(located, position.altitude),
        pitch: shown_f32(oriented, attitude.pitch),
        yaw: shown_f32(oriented, attitude.yaw),
        roll: shown_f32(oriented, attitude.roll),
        acceleration: acceleration.axes.map(|axis| shown_f32(moved, axis)),
    }
}
