//! The steps of HORUS's cycle, whose order and times the firmware checks ([`firmware_common::flow`]).
//!
//! | step | begins after | its time after the slot or tick before |
//! |---|---|---|
//! | slot of the first frame | the tick | from the tick to the slot |
//! | task `rf_slot` | the slot | – |
//! | task `vote` | `rf_slot`, and `cycle` of the same cycle | – |
//! | task `gnss_tick` | `vote` | – |
//! | slot of the second frame (five receivers) | the first slot | from the first slot to the second |
//! | task `rf_slot` for it | that slot | – |
//! | tick | `gnss_tick`, and the last `rf_slot` | from the last slot to the tick |
//! | task `cycle` | the tick | – |
//!
//! The first slot comes first in the table, because the cycle timer starts at 0 and reaches that slot before the first
//! tick. It is served when the start is over; the times count from the first tick. Ticks and slots come from the cycle
//! timer, TIM2; SysTick measures the times between them. Events of receivers and of the front end call all other tasks,
//! at any rate. Such a task asks its hardware what has happened, and does nothing if nothing has.

use firmware_common::flow::{self, Rule};

use crate::{task::Task, timing, FRAMES};

/// A step of the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The slot of the cycle's first frame.
    Slot,
    /// The task `rf_slot` after the first slot.
    RfSlot,
    /// The task `vote`.
    Vote,
    /// The task `gnss_tick`.
    GnssTick,
    /// The slot of the cycle's second frame.
    SecondSlot,
    /// The task `rf_slot` after the second slot.
    SecondRfSlot,
    /// The tick.
    Tick,
    /// The task `cycle`.
    Cycle,
}

impl Step {
    /// Returns the slot of frame `frame`, counted from 0.
    #[must_use]
    pub const fn slot(frame: usize) -> Self {
        if frame == 0 {
            Self::Slot
        } else {
            Self::SecondSlot
        }
    }

    /// Returns the task `rf_slot` after the slot of frame `frame`, counted from 0.
    #[must_use]
    pub const fn rf_slot(frame: usize) -> Self {
        if frame == 0 {
            Self::RfSlot
        } else {
            Self::SecondRfSlot
        }
    }
}

/// How early a slot or tick may be served, µs. TIM2 and SysTick have one clock, but the times count from the first
/// tick, which may itself be served some tens of cycles late.
pub const EARLY_US: u32 = 2;

/// How late a slot or tick may be served, µs. No lock masks the timer's interrupt, no other one has its priority, and
/// log messages keep away from slots and ticks.
pub const LATE_US: u32 = 20;

const fn counts(us: u32) -> u32 {
    (us * COUNTS_PER_US) << UNUSED_BITS
}

/// Returns the time between two instants of the cycle timer, in counts of [`counter`].
const fn time(from_ticks: u32, to_ticks: u32) -> Option<u32> {
    Some(counts((to_ticks - from_ticks) / timing::TICKS_PER_US))
}

/// The counts of SysTick in a µs: its reference is HCLK / 8 (RM0090, "SysTick calibration value register").
pub const COUNTS_PER_US: u32 = timing::CORE_HZ / 8 / 1_000_000;

/// SysTick counts with 24 bits, so it wraps after 0.93 s.
const UNUSED_BITS: u32 = 8;

/// The largest value of SysTick, from which it counts down.
pub const COUNTER_TOP: u32 = u32::MAX >> UNUSED_BITS;

/// Returns a counter for [`flow::Flow`] that counts up and wraps at 2^32, from the value of SysTick.
#[inline(always)]
#[must_use]
pub const fn counter(systick: u32) -> u32 {
    (COUNTER_TOP.wrapping_sub(systick)) << UNUSED_BITS
}

const LAST_SLOT: u32 = timing::SLOT_TICKS[FRAMES - 1];

impl flow::Step for Step {
    const TABLE: &'static [Rule] = &[
        Rule { after: &[Self::Tick as usize], time: time(0, timing::SLOT_TICKS[0]) },
        Rule { after: &[Self::Slot as usize], time: None },
        Rule { after: &[Self::RfSlot as usize, Self::Cycle as usize], time: None },
        Rule { after: &[Self::Vote as usize], time: None },
        Rule { after: &[Self::Slot as usize], time: time(timing::SLOT_TICKS[0], LAST_SLOT) },
        Rule { after: &[Self::SecondSlot as usize], time: None },
        Rule {
            after: &[Self::GnssTick as usize, Self::rf_slot(FRAMES - 1) as usize],
            time: time(LAST_SLOT, timing::PERIOD_TICKS),
        },
        Rule { after: &[Self::Tick as usize], time: None },
    ];

    const EARLY: u32 = counts(EARLY_US);
    const LATE: u32 = counts(LATE_US);

    #[inline(always)]
    fn index(self) -> usize {
        self as usize
    }
}

impl Task {
    /// Whether the task is a step of the cycle. If so, HORUS stops when the task runs out of turn.
    #[must_use]
    pub const fn is_step(self) -> bool {
        matches!(self, Self::slot | Self::rf_slot | Self::cycle | Self::vote | Self::gnss_tick)
    }
}
