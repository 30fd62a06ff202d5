//! The hardware beside the processor, as plain data: RAM as DMA sees it, SPIS, expiry timer, FRESH, and the two wires
//! from outside (SSI and air). Numbers of sections are of the nRF52840 product specification v1.7.

use super::{
    board::Task,
    explorer::{broken, holds},
    Bounds, Mutation, HALF_BYTES, LEN,
};
use profile::ssi::{encode, Request};

/// Receive buffers have the first places in RAM, images the following.
pub(crate) const RECEIVE: usize = dpr_fw::triple::RECEIVE_BUFFERS;
/// Buffers in RAM.
pub(crate) const BUFFERS: usize = RECEIVE + dpr_fw::triple::IMAGES;

/// Whose the SPIS's buffers are (6.26, SEMSTAT).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Semaphore {
    Free,
    Cpu,
    Spis,
    CpuPending,
}

/// What a transaction shows of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Window {
    Whole,
    UpperHalf,
}

/// The transaction under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Transaction {
    buffer: usize,
    window: Window,
    /// The generation that FRESH had told of last when it began.
    generation: u8,
    /// How much of it EasyDMA has carried, in halves.
    carried: u8,
    /// What it asks for.
    asks: Window,
}

/// What can happen beside the processor, at any instant at which it is enabled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// The flight controller selects.
    Select,
    /// EasyDMA carries the next half of the bytes, out and in.
    Carry,
    /// The flight controller deselects: END.
    Deselect,
    /// The shortcut from END to ACQUIRE.
    Shortcut,
    /// The expiry timer's first compare, through PPI to ACQUIRE.
    Expire,
    /// Its second.
    ExpireAgain,
    /// The compare that ends the pause.
    PauseEnd,
    /// EasyDMA writes the next half of a frame into the receive buffer.
    Arrive,
    /// The frame has ended.
    FrameEnd,
    /// The frame is not delivered.
    FrameLost,
    /// The deadline of the next frame.
    Deadline,
    /// A store that no fence has held back reaches the RAM.
    Store,
    /// A bit of that buffer gets stuck.
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

/// Everything beside the processor that the future depends on.
#[derive(Clone, Debug, Hash)]
pub(crate) struct Hardware {
    /// RAM as DMA sees it: the two halves of each buffer. Every word of a half holds the same.
    pub(crate) ram: [[u32; 2]; BUFFERS],
    /// A store to the upper half that the compiler has not put out yet.
    pub(crate) held_back: [Option<u32>; BUFFERS],
    pub(crate) stuck: Option<usize>,
    /// The buffer in which the scrub task has found a stuck bit.
    pub(crate) found: Option<usize>,
    pub(crate) semaphore: Semaphore,
    pub(crate) end: bool,
    pub(crate) acquired: bool,
    /// END was, the shortcut comes.
    pub(crate) ending: bool,
    /// END and ACQUIRED do not call the SSI task.
    pub(crate) masked: bool,
    /// The compare that ends the pause is ahead of the timer, and its COMPARE event.
    pub(crate) pause_runs: bool,
    pub(crate) pause_over: bool,
    /// The SSI task is about to begin the pause.
    pub(crate) pause_begins: bool,
    /// TXD: the buffer and the window.
    pub(crate) txd: Option<(usize, Window)>,
    /// What the SPIS has written into the SSI task's memory, and how much.
    pub(crate) rxd: [u8; 8],
    pub(crate) amount: usize,
    pub(crate) transaction: Option<Transaction>,
    /// The window that the last granted transaction has asked for.
    asked: Window,
    /// Compares of the expiry timer since it was cleared; `None` before its first start.
    pub(crate) expired: Option<u8>,
    /// COMPARE event of the first.
    pub(crate) compare: bool,
    /// The timer was cleared, and its event comes to be.
    pub(crate) just_cleared: bool,
    /// The first compare came while the SSI task ran, and that has not ended.
    pub(crate) expired_in_task: bool,
    /// The newest generation published, and the newest that FRESH has told of.
    pub(crate) published: u8,
    pub(crate) announced: u8,
    /// The receive buffer that is written, and how much of a frame is there, in halves.
    pub(crate) receiving: usize,
    pub(crate) arrived: u8,
    /// The number of the frame that arrives or comes next.
    pub(crate) frame: u8,
    left: Left,
}

/// What may still happen.
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
            // What was in RAM at start is of no generation.
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

    /// Calls `with` with each step that is enabled, where only a task above `level` would run at once. What merely
    /// calls a task is enabled where that task would run: called earlier, it would wait until then.
    pub(crate) fn steps(&self, level: u8, receiver_runs: bool, bounds: &Bounds, mut with: impl FnMut(Step)) {
        // One that meets the semaphore in other hands reads DEF throughout and changes nothing, however long it lasts
        // (6.26.1): it is left out.
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
            // 25 ms after it was cleared: what follows the clearing at once is over.
            Some(0) if self.left.expiries > 0 && !self.just_cleared => with(Step::Expire),
            // 20 µs after the first: the SSI task that ran at the first has ended.
            Some(1) if !self.expired_in_task => with(Step::ExpireAgain),
            _ => {}
        }
        // While the SSI task runs it matters only whether it comes before that begins the pause anew.
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

    /// Carries out a step that concerns nothing but the hardware.
    pub(crate) fn happen(&mut self, step: Step, mutation: Mutation, in_ssi_task: bool) {
        match step {
            Step::Select => self.select(),
            Step::Carry => self.carry(),
            Step::Deselect => {
                let Some(transaction) = self.transaction.take() else { return };
                // A request that was cut off asks for nothing.
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

    /// The task ACQUIRE (6.26.2).
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

    /// The tasks CLEAR and START of the expiry timer.
    pub(crate) fn clear_timer(&mut self) {
        self.expired = Some(0);
        self.just_cleared = true;
    }

    /// The task RELEASE.
    pub(crate) fn release(&mut self) {
        holds(self.semaphore == Semaphore::Cpu, "the semaphore is released by who does not have it");
        self.semaphore = Semaphore::Free;
    }

    fn select(&mut self) {
        self.left.transactions -= 1;
        // The flight controller asks for the one window and for the other in turn.
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
