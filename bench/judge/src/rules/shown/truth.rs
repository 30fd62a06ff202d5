//! What HORUS put on the air.

use std::collections::VecDeque;

use crate::read::Placed;
use crate::{Board, Context, Event, What, bounds};

/// So many frames are remembered: ten seconds, or five with two frames a cycle. An image cannot be that old unless
/// it has expired for long.
const REMEMBERED: usize = 1_000;

/// So many ticks are remembered: a frame ends before the next tick but one.
const TICKS: usize = 4;

/// A frame that HORUS sent.
#[derive(Clone, Debug)]
pub struct SentFrame {
    /// Its place among all frames that were sent: the order of age, also across a restart of HORUS.
    pub serial: u64,
    /// Which start of HORUS sent it.
    horus_start: u64,
    /// Its first preamble bit, ns.
    pub started: u64,
    /// The tick that it belongs to, ns, if the TICK pin showed one.
    pub tick: Option<u64>,
    /// Number in the profile and bytes of its valid objects.
    objects: Vec<(usize, Vec<u8>)>,
}

/// The last frames that HORUS sent.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    frames: VecDeque<SentFrame>,
    ticks: VecDeque<u64>,
    serial: u64,
}

impl Truth {
    /// Takes the next event.
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
                // Of the start of HORUS before the last nothing can be shown any more.
                while self.frames.len() > REMEMBERED
                    || self.frames.front().is_some_and(|frame| frame.horus_start + 1 < horus_start)
                {
                    self.frames.pop_front();
                }
            }
            _ => {}
        }
    }

    /// The last frame begun by `before` (ns) that carried object number `index` with these bytes.
    #[must_use]
    pub fn find(&self, index: usize, bytes: &[u8], before: u64) -> Option<&SentFrame> {
        let carried = |frame: &&SentFrame| {
            frame.started <= before && frame.objects.iter().any(|(number, sent)| *number == index && sent == bytes)
        };
        self.frames.iter().rev().find(carried)
    }
}
