//! Makes the objects of one tick from the receivers' messages
//!
//! # Design
//!
//! [`Cycle::fill`] is called once per tick, and does the same work whatever the receivers have sent: every object is
//! written and sealed, and a value that is not valid is replaced by the design's NaN with a selection, not a branch.
//!
//! [`Cycle::vote`] is called in the cycle before its tick, because a vote takes longer than the time between tick and
//! slot. A vote uses what the receivers have sent until 10 ms before the tick, and extrapolates to the tick. It also
//! seals Reported-Position. A vote for another tick is not sent.
//!
//! Reported-Position is what a majority of the receivers states ([`horus_voter`]): their position, extrapolated to the
//! tick, and their number. It is *degraded* while fewer receivers agree than are fitted, or while there is no altitude.
//! A receiver that falls silent stops taking part one period and 150 ms after its last message (see
//! [`receiver`](crate::receiver)). The object of an outvoted receiver says *excluded*. HORUS is *starting* until the
//! first result, *monitoring* while there is a result, and in the state *position lost* when there is none any more.
//! The inputs of its safety function may tell another state instead ([`state_inputs`](crate::state_inputs)).
//!
//! Every Reported-Position also states HORUS's clock, the reason of its last reset ([`Start`]), and whether a fault of
//! its memory was found ([`Cycle::found_memory_fault`]).

use core::{borrow::Borrow, hint::select_unpredictable};

use horus_voter::{Input, Verdict, Voter};
use profile::{
    GpsObject, GpsStatus, GpsValues, Identifier, Profile, ReportedPosition, ReportedStatus, ReportedValues,
    ResetReason, ABSENT_F32, ABSENT_F64,
};

use crate::{
    clock::Source,
    receiver::{Solution, HEARD_MS},
    state_inputs::{Levels, StateInputs, INPUTS},
    timing::timestamp,
};

/// HORUS's findings at its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// The clock that HORUS runs on.
    pub clock: Source,
    /// The reason why the processor started.
    pub reason: ResetReason,
    /// The receivers that were excluded before the start, in the form of [`Verdict::excluded`]
    /// ([`exclusions`](crate::exclusions) keeps them over a reset).
    pub excluded: u8,
}

/// The state that the votes of `N` receivers keep from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cycle<const N: usize> {
    /// Whether a vote has had a result since the start.
    was_located: bool,
    start: Start,
    memory_fault: bool,
    inputs: StateInputs,
    voter: Voter<N>,
    verdict: Verdict,
    voted: Option<(u32, ReportedPosition)>,
}

impl<const N: usize> Cycle<N> {
    /// Returns the state of a HORUS that starts after power-on and runs on the external clock.
    #[must_use]
    pub const fn new() -> Self {
        Self::after(Start { clock: Source::External, reason: ResetReason::PowerOn, excluded: 0 })
    }

    /// Returns the state of a HORUS that begins with the findings `start`. Reported-Position's status states these
    /// findings.
    #[must_use]
    pub const fn after(start: Start) -> Self {
        let voter = Voter::excluding(start.excluded);
        Self {
            was_located: false,
            start,
            memory_fault: false,
            inputs: StateInputs::new(),
            voter,
            verdict: Verdict { excluded: voter.excluded(), ..Verdict::NONE },
            voted: None,
        }
    }

    /// Records a fault of HORUS's memory, which the status of every later Reported-Position tells.
    pub fn found_memory_fault(&mut self) {
        self.memory_fault = true;
    }

    /// Returns the receivers that are excluded from the next vote on, one bit for each.
    #[must_use]
    pub const fn excluded(&self) -> u8 {
        self.voter.excluded()
    }

    /// Stores the levels of the pins that report relay, motor cut and emergency measure. To be called once in a cycle,
    /// before the vote.
    pub fn sample(&mut self, levels: [Levels; INPUTS]) {
        self.inputs.sample(levels);
    }

    /// Votes for tick `tick` on what each receiver has sent until now, and seals Reported-Position.
    pub fn vote<S: Borrow<Solution>>(&mut self, tick: u32, solutions: &[S; N]) {
        let now = timestamp(tick);
        let mut inputs = [Input::default(); N];
        for (input, solution) in inputs.iter_mut().zip(solutions) {
            *input = input_of(solution.borrow(), now);
        }
        self.verdict = self.voter.vote(&inputs, now);
        self.was_located |= self.verdict.position.is_some();
        self.voted = Some((tick, ReportedPosition::seal(&self.reported_values(&self.verdict, now))));
    }

    /// Whether the last vote was for tick `tick`, or there was no vote yet. The vote before a tick has to be for that
    /// tick.
    #[must_use]
    pub fn has_voted_for(&self, tick: u32) -> bool {
        // Not covered: a vote for another tick: only a flipped bit of the count of ticks leaves a vote out, and few
        // upsets hit it.
        self.voted.is_none_or(|(of, _)| of == tick)
    }

    /// Returns the last vote.
    #[must_use]
    pub const fn verdict(&self) -> &Verdict {
        &self.verdict
    }

    /// Returns the sealed profile of tick `tick`: the receivers' latest messages, and that tick's vote.
    pub fn fill<S: Borrow<Solution>>(&self, tick: u32, solutions: &[S; N]) -> Profile<N> {
        let now = timestamp(tick);
        // Not covered: only this line, no vote for this tick: the step that votes for it runs before this one, or HORUS
        // stops because of the order of its steps.
        let reported = match self.voted {
            Some((of, reported)) if of == tick => reported,
            // Not covered: no vote for this tick, as above.
            _ => ReportedPosition::seal(&self.reported_values(&Verdict::NONE, now)),
        };
        let mut receiver = 0;
        let gps = solutions.each_ref().map(|solution| {
            let excluded = self.verdict.is_excluded(receiver);
            receiver += 1;
            GpsObject::seal(Identifier::gps(receiver), &gps_values(solution.borrow(), excluded, now))
        });
        Profile::new(reported, gps)
    }

    fn reported_values(&self, verdict: &Verdict, now: u32) -> ReportedValues {
        let Verdict { position, attitude, acceleration, .. } = verdict;
        let agreeing = verdict.agreeing();
        let altitude = position.and_then(|position| position.altitude);
        let [pitch, yaw, roll] = attitude.unwrap_or([ABSENT_F32; 3]);
        ReportedValues {
            timestamp: now,
            status: ReportedStatus::new()
                .with_receivers_agreeing(agreeing)
                .with_position_valid(position.is_some())
                .with_attitude_valid(attitude.is_some())
                .with_acceleration_valid(acceleration.is_some())
                .with_degraded((usize::from(agreeing) < N) | altitude.is_none())
                .with_without_crystal(self.start.clock == Source::Internal)
                .with_state(self.inputs.state(self.was_located, position.is_some()))
                .with_memory_fault(self.memory_fault)
                .with_reset_reason(self.start.reason),
            latitude: position.map_or(ABSENT_F64, |position| position.latitude),
            longitude: position.map_or(ABSENT_F64, |position| position.longitude),
            altitude: altitude.unwrap_or(ABSENT_F64),
            pitch,
            yaw,
            roll,
            acceleration: acceleration.unwrap_or([ABSENT_F32; 3]),
        }
    }
}

fn input_of(solution: &Solution, now: u32) -> Input {
    let Solution { position, attitude, acceleration, .. } = solution;
    Input {
        valid: position.valid & position.pace.is_current(now),
        fix: position.voted,
        since_arrival_ms: position.pace.since_arrival_ms(now),
        lag_ms: position.pace.lag_ms(),
        attitude: (attitude.valid & attitude.pace.is_current(now)).then_some([
            attitude.pitch,
            attitude.yaw,
            attitude.roll,
        ]),
        acceleration: (acceleration.valid & acceleration.pace.is_current(now)).then_some(acceleration.axes),
    }
}

/// Returns `value` if `shown` is true. Otherwise returns the NaN that stands for a value that is not valid.
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

fn gps_values(solution: &Solution, excluded: bool, now: u32) -> GpsValues {
    let Solution { last_heard, position, attitude, acceleration } = solution;
    let current = position.pace.is_current(now);
    let located = position.valid & current;
    let oriented = attitude.pace.is_current(now);
    let moved = acceleration.pace.is_current(now);

    let mut status = GpsStatus::new()
        .with_position_valid(located)
        .with_attitude_valid(attitude.valid & oriented)
        .with_acceleration_valid(acceleration.valid & moved)
        .with_heard(last_heard.within(now, HEARD_MS))
        .with_stale(!position.pace.is_fresh(now))
        .with_excluded(excluded);
    // Both values are computed, whichever is used. A branch would make the time depend on whether the receiver has sent
    // a message.
    status = select_unpredictable(
        position.pace.has_arrived(),
        status.with_solution_age_ms(Some(position.pace.age_ms(now))),
        status.with_solution_age_ms(None),
    );
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
