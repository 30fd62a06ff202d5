//! The frames that HORUS put on the air.

use std::collections::VecDeque;

use crate::read::Placed;
use crate::{Board, Context, Event, What, bounds};

/// The time, ns, for which frames of an earlier start of HORUS are kept, because a transaction may still show them.
pub const KEPT: u64 = 2_000_000_000;

/// The number of frames that are kept: those of the last ten seconds, or of five seconds with two frames a cycle.
const REMEMBERED: usize = 1_000;

/// The number of ticks that are kept: a frame ends at most two ticks after its own.
const TICKS: usize = 4;

/// A frame that HORUS sent.
#[derive(Clone, Debug)]
pub struct SentFrame {
    /// The frame's number among all frames of the run, across restarts of HORUS.
    pub serial: u64,
    /// The number of HORUS's starts when the frame was sent.
    horus_start: u64,
    /// The instant, ns, at which the frame's first preamble bit began.
    pub started: u64,
    /// The instant, ns, of the tick to which the frame belongs; `None` if there was none on the TICK pin.
    pub tick: Option<u64>,
    /// The number of each valid object in the profile, and its bytes.
    objects: Vec<(usize, Vec<u8>)>,
}

/// The frames that HORUS sent last.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    frames: VecDeque<SentFrame>,
    ticks: VecDeque<u64>,
    serial: u64,
}

impl Truth {
    /// Adds the next event of the log to the record.
    pub fn take(&mut self, event: &Event, context: &Context) {
        match &event.what {
            What::Tick => {
                self.ticks.push_back(event.at);
                if self.ticks.len() > TICKS {
                    self.ticks.pop_front();
                }
            }
            What::Sent { started, .. } => {
                let Some(frame) = context.frame() else { return };
                let horus_start = context.running(Board::Horus).starts;
                let near = |tick: &u64| *tick <= *started && started - tick < bounds::CYCLE;
                let valid = |placed: &&Placed| placed.timestamp().is_some();
                self.serial += 1;
                self.frames.push_back(SentFrame {
                    serial: self.serial,
                    horus_start,
                    started: *started,
                    tick: self.ticks.iter().rev().copied().find(near),
                    objects: frame.objects.iter().filter(valid).map(|it| (it.index, it.bytes.clone())).collect(),
                });
                // Frames of earlier starts of HORUS are dropped when no transaction can show them any more.
                let gone = |frame: &SentFrame| frame.horus_start + 1 < horus_start && event.at - frame.started > KEPT;
                while self.frames.len() > REMEMBERED || self.frames.front().is_some_and(gone) {
                    self.frames.pop_front();
                }
            }
            _ => {}
        }
    }

    /// Returns the last frame that began at `before`, ns, or earlier and carried object `index` with these bytes.
    #[must_use]
    pub fn find(&self, index: usize, bytes: &[u8], before: u64) -> Option<&SentFrame> {
        let carried = |frame: &&SentFrame| {
            frame.started <= before && frame.objects.iter().any(|(number, sent)| *number == index && sent == bytes)
        };
        self.frames.iter().rev().find(carried)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bytes;
    use crate::testing::{self, MS};

    const FRAME: u64 = 5 * MS;

    struct Rig {
        context: Context,
        truth: Truth,
    }

    impl Rig {
        fn new() -> Self {
            Self { context: Context::new(&testing::header(1)), truth: Truth::default() }
        }

        fn take(&mut self, at: u64, what: What) {
            let event = Event { at, what };
            self.context.take(&event);
            self.truth.take(&event, &self.context);
        }

        fn tick(&mut self, at: u64) {
            self.take(at, What::Tick);
        }

        fn horus_restarts(&mut self, at: u64) {
            self.take(at, What::Reset { board: Board::Horus, cause: crate::Cause::Pin, asked: true });
        }

        fn send(&mut self, started: u64, timestamp: u32, intact: bool) {
            let mut payload = objects(timestamp).concat();
            *payload.last_mut().unwrap() ^= u8::from(!intact);
            let bytes = [&[payload.len() as u8 + 1], &payload[..], &[0, 0]].concat();
            self.take(started + FRAME, What::Sent { started, bit_rate: 424_000, bytes: Bytes(bytes), whole: true });
        }

        fn found(&self, index: usize, timestamp: u32, before: u64) -> Option<(u64, Option<u64>)> {
            let frame = self.truth.find(index, &objects(timestamp)[index], before)?;
            Some((frame.serial, frame.tick))
        }
    }

    fn objects(timestamp: u32) -> Vec<Vec<u8>> {
        testing::objects(&testing::silent_reported(timestamp), &[testing::silent_gps(timestamp)])
    }

    fn tick_of(started: u64, ticks: &[u64]) -> Option<u64> {
        let mut rig = Rig::new();
        ticks.iter().for_each(|at| rig.tick(*at));
        rig.send(started, 10, true);
        let (_, tick) = rig.found(0, 10, u64::MAX).unwrap();
        tick
    }

    #[test]
    fn a_frame_belongs_to_the_tick_less_than_a_cycle_before_it() {
        let tick = 50 * MS;
        assert_eq!(tick_of(tick - 1, &[tick]), None);
        for after in [0, 1, bounds::CYCLE - 1] {
            assert_eq!(tick_of(tick + after, &[tick]), Some(tick), "{after} ns");
        }
        for after in [bounds::CYCLE, bounds::CYCLE + 1, 4 * bounds::CYCLE] {
            assert_eq!(tick_of(tick + after, &[tick]), None, "{after} ns");
        }
        assert_eq!(tick_of(tick + MS, &[tick, tick + 2 * MS]), Some(tick));
        assert_eq!(tick_of(tick + 3 * MS, &[tick, tick + 2 * MS]), Some(tick + 2 * MS));
    }

    #[test]
    fn four_ticks_are_remembered() {
        let later = |count| (0..=count).map(|number| 50 * MS + number * 2 * MS).collect::<Vec<u64>>();
        assert_eq!(tick_of(51 * MS, &later(3)), Some(50 * MS));
        assert_eq!(tick_of(51 * MS, &later(4)), None);
    }

    #[test]
    fn the_last_frame_is_found_that_carried_the_object_by_then() {
        let mut rig = Rig::new();
        rig.tick(50 * MS);
        rig.send(50 * MS, 10, true);
        rig.tick(60 * MS);
        rig.send(60 * MS, 20, true);
        rig.tick(70 * MS);
        rig.send(70 * MS, 10, true);
        assert_eq!(rig.found(0, 10, u64::MAX), Some((3, Some(70 * MS))));
        assert_eq!(rig.found(0, 10, 70 * MS), Some((3, Some(70 * MS))));
        assert_eq!(rig.found(1, 10, 70 * MS - 1), Some((1, Some(50 * MS))));
        assert_eq!(rig.found(1, 20, 70 * MS - 1), Some((2, Some(60 * MS))));
        assert_eq!(rig.found(0, 10, 50 * MS - 1), None);
        assert_eq!(rig.found(0, 30, u64::MAX), None);
        assert!(rig.truth.find(1, &objects(10)[0], u64::MAX).is_none());
        assert!(rig.truth.find(0, &objects(10)[0][1..], u64::MAX).is_none());
    }

    #[test]
    fn an_object_that_is_not_intact_is_none_that_horus_sent() {
        let mut rig = Rig::new();
        rig.send(50 * MS, 10, false);
        assert_eq!(rig.found(0, 10, u64::MAX), Some((1, None)));
        let mut damaged = objects(10).pop().unwrap();
        *damaged.last_mut().unwrap() ^= 1;
        assert_eq!(rig.found(1, 10, u64::MAX), None);
        assert!(rig.truth.find(1, &damaged, u64::MAX).is_none());
    }

    #[test]
    fn a_thousand_frames_are_remembered() {
        let mut rig = Rig::new();
        for number in 1..=1_000 {
            rig.send(u64::from(number) * 10 * MS, number * 10, true);
        }
        assert_eq!(rig.found(0, 10, u64::MAX), Some((1, None)));
        rig.send(10_010 * MS, 10_010, true);
        assert_eq!(rig.found(0, 10, u64::MAX), None);
        assert_eq!(rig.found(0, 20, u64::MAX), Some((2, None)));
        assert_eq!(rig.truth.frames.len(), 1_000);
    }

    #[test]
    fn frames_are_forgotten_after_the_second_start_after_theirs_and_two_seconds() {
        let mut rig = Rig::new();
        rig.send(10 * MS, 10, true);
        rig.send(20 * MS, 20, true);
        rig.horus_restarts(30 * MS);
        rig.send(40 * MS, 30, true);
        assert_eq!(rig.found(0, 10, u64::MAX), Some((1, None)));
        rig.horus_restarts(50 * MS);
        assert_eq!(rig.found(0, 20, u64::MAX), Some((2, None)));
        rig.send(60 * MS, 40, true);
        rig.send(10 * MS + KEPT - FRAME, 50, true);
        assert_eq!(rig.found(0, 10, u64::MAX), Some((1, None)));
        rig.send(10 * MS + KEPT - FRAME + 1, 60, true);
        assert_eq!(rig.found(0, 10, u64::MAX), None);
        assert_eq!(rig.found(0, 20, u64::MAX), Some((2, None)));
        rig.send(9_000 * MS, 70, true);
        assert_eq!(rig.found(0, 20, u64::MAX), None);
        assert_eq!([30, 40].map(|timestamp| rig.found(0, timestamp, u64::MAX).map(|it| it.0)), [Some(3), Some(4)]);
    }
}
