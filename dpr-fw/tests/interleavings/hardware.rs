//! The hardware besides the processor, as plain data: RAM as DMA sees it, SPIS, expiry timer, FRESH, SSI and air.
//! Section numbers are those of the nRF52840 product specification v1.7.

use super::{
    board::Task,
    explorer::{broken, holds},
    Bounds, Mutation, HALF_BYTES, LEN,
};
use profile::ssi::{encode, Request};

/// The number of receive buffers, which come first in RAM, before the images.
pub(crate) const RECEIVE: usize = dpr_fw::triple::RECEIVE_BUFFERS;
pub(crate) const BUFFERS: usize = RECEIVE + dpr_fw::triple::IMAGES;

/// The owner of the SPIS's buffers (PS v1.7, 6.26, SEMSTAT).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Semaphore {
    Free,
    Cpu,
    Spis,
    CpuPending,
}

/// The bytes of an image that a transaction shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Window {
    Whole,
    UpperHalf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Transaction {
    buffer: usize,
    window: Window,
    /// The generation that FRESH had announced last when the transaction began.
    generation: u8,
    /// How many halves of the transaction's bytes EasyDMA has carried so far.
    carried: u8,
    asks: Window,
}

/// The events outside of the processor, each of which can happen at any instant at which it is enabled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    Select,
    /// EasyDMA carries the next half of the transaction's bytes, out and in.
    Carry,
    /// The flight controller deselects the DPR, which raises the event END.
    Deselect,
    /// The shortcut from END takes effect and triggers the task ACQUIRE.
    Shortcut,
    /// The expiry timer's first compare comes, and triggers ACQUIRE through PPI.
    Expire,
    /// The expiry timer's second compare comes and triggers ACQUIRE again.
    ExpireAgain,
    PauseEnd,
    /// EasyDMA writes the next half of a frame into the receive buffer.
    Arrive,
    FrameEnd,
    /// The frame that is arriving is lost and will not be delivered.
    FrameLost,
    Deadline,
    /// A store that no fence has held back reaches the RAM.
    Store,
    /// A bit of this buffer gets stuck.
    Stick(usize),
}

impl Step {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Select => "* the flight controller selects",
            Self::Carry => "* EasyDMA carries half a transaction",
            Self::Deselect => "* the flight controller deselects: END",
            Self::Shortcut => "* shortcut END to ACQUIRE: ACQUIRED",
            Self::Expire => "* first compare: ACQUIRE",
            Self::ExpireAgain => "* second compare: ACQUIRE",
            Self::PauseEnd => "* the compare that ends the pause",
            Self::Arrive => "* half a frame arrives",
            Self::FrameEnd => "* the frame has ended",
            Self::FrameLost => "* the frame is lost",
            Self::Deadline => "* the deadline passes",
            Self::Store => "* a delayed store reaches the RAM",
            Self::Stick(_) => "* a bit gets stuck",
        }
    }
}

/// The state of all hardware outside of the processor on which the future depends.
#[derive(Clone, Debug, Hash)]
pub(crate) struct Hardware {
    /// RAM as DMA sees it: the two halves of each buffer. All words of a half hold the same value.
    pub(crate) ram: [[u32; 2]; BUFFERS],
    /// For each buffer, a store to its upper half that the compiler still holds back.
    pub(crate) held_back: [Option<u32>; BUFFERS],
    pub(crate) stuck: Option<usize>,
    pub(crate) found: Option<usize>,
    pub(crate) semaphore: Semaphore,
    pub(crate) end: bool,
    pub(crate) acquired: bool,
    /// Whether END has come, but its shortcut to ACQUIRE has not taken effect yet.
    pub(crate) ending: bool,
    /// Whether the pause masks END and ACQUIRED, so that they do not call the SSI task.
    pub(crate) masked: bool,
    /// Whether the compare that ends the pause is still to come.
    pub(crate) pause_runs: bool,
    pub(crate) pause_over: bool,
    pub(crate) pause_begins: bool,
    /// The buffer and the window that TXD points to.
    pub(crate) txd: Option<(usize, Window)>,
    /// The bytes that the SPIS has written into the SSI task's memory.
    pub(crate) rxd: [u8; 8],
    pub(crate) amount: usize,
    pub(crate) transaction: Option<Transaction>,
    /// The window that the last granted transaction requested.
    asked: Window,
    /// The number of compares since the expiry timer was cleared; `None` before the timer's first start.
    pub(crate) expired: Option<u8>,
    pub(crate) compare: bool,
    /// Whether the expiry timer was just cleared, and its compare event is still to be cleared.
    pub(crate) just_cleared: bool,
    /// Whether the expiry timer's first compare came during a run of the SSI task that has not ended.
    pub(crate) expired_in_task: bool,
    pub(crate) published: u8,
    pub(crate) announced: u8,
    pub(crate) receiving: usize,
    pub(crate) arrived: u8,
    pub(crate) frame: u8,
    left: Left,
}

#[derive(Clone, Copy, Debug, Hash)]
struct Left {
    frames: u8,
    deadlines: u8,
    transactions: u8,
    expiries: u8,
    sticks: u8,
}

impl Hardware {
    pub(crate) fn new(bounds: &Bounds) -> Self {
        Self {
            // The model's RAM begins with a value that stands for no generation.
            ram: [[0xEE; 2]; BUFFERS],
            held_back: [None; BUFFERS],
            stuck: None,
            found: None,
            semaphore: Semaphore::Cpu,
            end: false,
            acquired: false,
            ending: false,
            masked: false,
            pause_runs: false,
            pause_over: false,
            pause_begins: false,
            txd: None,
            rxd: [0; 8],
            amount: 0,
            transaction: None,
            asked: Window::Whole,
            expired: None,
            compare: false,
            just_cleared: false,
            expired_in_task: false,
            published: 0,
            announced: 0,
            receiving: 0,
            arrived: 0,
            frame: 1,
            left: Left {
                frames: bounds.frames,
                deadlines: bounds.deadlines,
                transactions: bounds.transactions,
                expiries: bounds.expiries,
                sticks: bounds.sticks,
            },
        }
    }

    /// Calls `with` for each event that can happen while a task of priority `level` runs. An event that only calls a
    /// task is left out while that task could not run at once, because it would have no effect before.
    pub(crate) fn steps(&self, level: u8, receiver_runs: bool, bounds: &Bounds, mut with: impl FnMut(Step)) {
        // A transaction that begins while the processor has the semaphore reads DEF throughout and changes no state (PS
        // v1.7, 6.26.1). So the search leaves it out.
        if self.transaction.is_none() && self.semaphore == Semaphore::Free && self.left.transactions > 0 {
            with(Step::Select);
        }
        if let Some(Transaction { carried, .. }) = self.transaction {
            if carried < 2 {
                with(Step::Carry);
            }
            with(Step::Deselect);
        }
        if self.ending {
            with(Step::Shortcut);
        }
        match self.expired {
            // The expiry timer's first compare comes 25 ms after the timer was cleared, so never right after it.
            Some(0) if self.left.expiries > 0 && !self.just_cleared => with(Step::Expire),
            // The expiry timer's second compare comes 20 µs after its first. An SSI task that ran at the first compare
            // has ended by then.
            Some(1) if !self.expired_in_task => with(Step::ExpireAgain),
            _ => {}
        }
        // The compare that ends a pause matters during the SSI task only if it comes before the task begins a new
        // pause.
        if self.pause_runs && (level < Task::Ssi as u8 || self.pause_begins) {
            with(Step::PauseEnd);
        }
        if !receiver_runs && (self.left.frames > 0 || self.arrived > 0) {
            if self.arrived < 2 {
                with(Step::Arrive);
            } else if level < Task::Receive as u8 {
                with(Step::FrameEnd);
            }
            if self.arrived > 0 && level < Task::Receive as u8 {
                with(Step::FrameLost);
            }
        }
        if self.left.deadlines > 0 && level < Task::Commit as u8 {
            with(Step::Deadline);
        }
        if bounds.mutation == Mutation::NoFenceBeforeRelease && self.held_back.iter().any(Option::is_some) {
            with(Step::Store);
        }
        if self.left.sticks > 0 {
            (bounds.stick_from..BUFFERS).for_each(|buffer| with(Step::Stick(buffer)));
        }
    }

    pub(crate) fn happen(&mut self, step: Step, mutation: Mutation, in_ssi_task: bool) {
        match step {
            Step::Select => self.select(),
            Step::Carry => self.carry(),
            Step::Deselect => {
                let Some(transaction) = self.transaction.take() else { return };
                // A transaction that ended before its request was complete requests no window.
                self.asked = if transaction.carried == 2 { transaction.asks } else { Window::Whole };
                self.amount = 4 * usize::from(transaction.carried);
                self.end = true;
                self.ending = true;
            }
            Step::Shortcut => {
                self.ending = false;
                self.semaphore = Semaphore::Cpu;
                self.acquired = true;
            }
            Step::Expire => {
                self.left.expiries -= 1;
                self.expired = Some(1);
                self.compare = true;
                self.expired_in_task = in_ssi_task;
                self.acquire();
            }
            Step::ExpireAgain => {
                self.expired = Some(2);
                if mutation != Mutation::NoSecondCompare {
                    self.acquire();
                }
            }
            Step::PauseEnd => (self.pause_runs, self.pause_over) = (false, true),
            Step::Arrive => {
                if self.arrived == 0 {
                    self.left.frames -= 1;
                    holds(self.ram[self.receiving] == [0; 2], "a frame is received over old data");
                    holds(self.found != Some(self.receiving), "a frame is received into a buffer out of use");
                }
                self.ram[self.receiving][usize::from(self.arrived)] = u32::from(self.frame);
                self.arrived += 1;
            }
            Step::Store => {
                for (half, held_back) in self.ram.iter_mut().zip(&mut self.held_back) {
                    half[1] = held_back.take().unwrap_or(half[1]);
                }
            }
            Step::Stick(buffer) => {
                self.left.sticks -= 1;
                self.stuck = Some(buffer);
            }
            Step::Deadline => self.left.deadlines -= 1,
            Step::FrameEnd | Step::FrameLost => {}
        }
    }

    pub(crate) fn acquire(&mut self) {
        match self.semaphore {
            Semaphore::Free => {
                self.semaphore = Semaphore::Cpu;
                self.acquired = true;
            }
            Semaphore::Spis => self.semaphore = Semaphore::CpuPending,
            Semaphore::Cpu | Semaphore::CpuPending => {}
        }
    }

    pub(crate) fn clear_timer(&mut self) {
        self.expired = Some(0);
        self.just_cleared = true;
    }

    pub(crate) fn release(&mut self) {
        holds(self.semaphore == Semaphore::Cpu, "the semaphore is released by who does not have it");
        self.semaphore = Semaphore::Free;
    }

    fn select(&mut self) {
        self.left.transactions -= 1;
        // The flight controller requests its two windows in turn: the whole map and the upper half.
        let asks = if self.asked == Window::Whole { Window::UpperHalf } else { Window::Whole };
        let Some((buffer, window)) = self.txd else { broken("the SPIS is given no image") };
        self.semaphore = Semaphore::Spis;
        holds(self.expired.is_some_and(|compares| compares < 2), "an expired image is readable");
        holds(window == self.asked, "a transaction shows another window than the one before it asked for");
        self.transaction = Some(Transaction { buffer, window, generation: self.announced, carried: 0, asks });
    }

    fn carry(&mut self) {
        let Some(Transaction { buffer, window, generation, carried, asks }) = &mut self.transaction else { return };
        let half = match *window {
            Window::Whole => usize::from(*carried),
            Window::UpperHalf => 1,
        };
        match u8::try_from(self.ram[*buffer][half]) {
            Ok(read) if read == *generation => {}
            Ok(0) => broken("a transaction reads bytes that are not written"),
            Ok(read) if read < *generation => broken("a transaction reads an older image than FRESH has told of"),
            Ok(read) if read <= self.published => broken("a transaction reads an image that FRESH has not told of"),
            _ => broken("a transaction reads scrubbed bytes, or others that are of no image"),
        }
        let mosi = match asks {
            Window::Whole => [0; 8],
            Window::UpperHalf => {
                let [offset, length] = [HALF_BYTES, LEN - HALF_BYTES].map(|bytes| bytes.try_into().expect("16 bits"));
                encode(Request { offset, length })
            }
        };
        let bytes = 4 * usize::from(*carried)..4 * usize::from(*carried) + 4;
        self.rxd[bytes.clone()].copy_from_slice(&mosi[bytes]);
        *carried += 1;
    }
}
