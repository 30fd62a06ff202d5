//! The state that several rules need: how long each board has been running, what the bench disturbs, and the decoded
//! event.

use profile::Layout;

use crate::expectation::{Delivery, Expectation};
use crate::read::{Frame, Reading, Window};
use crate::truth::Truth;
use crate::{Board, Disturbance, Disturbances, Event, Header, What};

/// The state of a board since its last start, as the log's events show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Running {
    /// Whether the board has a supply.
    pub powered: bool,
    /// The instant, ns, at which the board last started: the power-on, or the end of a reset.
    pub since: u64,
    /// The number of the board's starts so far.
    pub starts: u64,
    /// The instant, ns, since which the board hangs because the bench stopped its core; `None` if it does not hang.
    pub hung: Option<u64>,
    /// The instant, ns, since which one of the board's tasks is dead; `None` if no task is dead.
    pub dead: Option<u64>,
    /// Whether the board hung, or had a dead task, before its last start.
    pub ended_hang: bool,
}

impl Running {
    fn ends_hang(&mut self) {
        self.ended_hang = self.hung.take().is_some() | self.dead.take().is_some();
    }
}

#[derive(Clone, Debug)]
struct Air {
    truth: Truth,
    expectation: Expectation,
    delivery: Option<Delivery>,
}

/// The state of the run after the event that is being judged.
#[derive(Clone, Debug)]
pub struct Context {
    layout: Layout,
    worst_case: bool,
    now: u64,
    horus: Running,
    dpr: Running,
    disturbances: Disturbances,
    ended: bool,
    window: Window,
    frame: Option<Frame>,
    reading: Option<Reading>,
    /// The record of HORUS's frames, and what a correct DPR does with them; `None` only while [`Context::take`] runs.
    air: Option<Box<Air>>,
}

impl Context {
    /// Returns the state of a run at power-on of both boards.
    ///
    /// # Panics
    ///
    /// Panics if no profile has the header's number of receivers.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        let running = Running { powered: true, since: 0, starts: 1, hung: None, dead: None, ended_hang: false };
        let layout = header.layout();
        let air = Air { truth: Truth::default(), expectation: Expectation::new(layout), delivery: None };
        Self {
            layout,
            worst_case: header.worst_case(),
            now: 0,
            horus: running,
            dpr: running,
            disturbances: Disturbances::default(),
            ended: false,
            window: Window::default(),
            frame: None,
            reading: None,
            air: Some(Box::new(air)),
        }
    }

    /// Processes the next event of the log.
    pub fn take(&mut self, event: &Event) {
        self.now = event.at;
        self.frame = None;
        self.reading = None;
        self.disturbances.take(event);
        match &event.what {
            What::Power { board, on } => {
                let running = self.running_mut(*board);
                running.powered = *on;
                running.since = event.at;
                running.starts += u64::from(*on);
                running.ends_hang();
                self.forget_window(*board);
            }
            What::Reset { board, .. } => {
                let running = self.running_mut(*board);
                running.since = event.at;
                running.starts += 1;
                running.ends_hang();
                self.forget_window(*board);
            }
            What::Hung { board } => {
                let running = self.running_mut(*board);
                if running.powered {
                    running.hung.get_or_insert(event.at);
                }
            }
            What::Injected { disturbs: Disturbance::DeadTask { board, .. }, .. } => {
                let running = self.running_mut(*board);
                if running.powered {
                    running.dead.get_or_insert(event.at);
                }
            }
            What::Sent { bytes, whole, .. } | What::Heard { bytes, whole, .. } => {
                self.frame = Some(Frame::of(self.layout, bytes, *whole));
            }
            What::Transaction { selected, mosi, miso } => {
                let reading = Reading::of(self.layout, *selected, event.at, self.window.offset(), miso);
                self.window.transaction(self.layout, mosi, reading.silent);
                self.reading = Some(reading);
            }
            What::End => self.ended = true,
            _ => {}
        }
        if let Some(mut air) = self.air.take() {
            air.truth.take(event, self);
            air.delivery = air.expectation.take(event, self);
            self.air = Some(air);
        }
    }

    fn air(&self) -> &Air {
        self.air.as_ref().expect("it is away while an event is taken alone")
    }

    /// Returns the record of what HORUS put on the air.
    ///
    /// # Panics
    ///
    /// Panics if this is called within [`Context::take`].
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.air().truth
    }

    /// Returns what a correct DPR must do, or may do, with the frames that reached its antenna.
    ///
    /// # Panics
    ///
    /// Panics if this is called within [`Context::take`].
    #[must_use]
    pub fn expectation(&self) -> &Expectation {
        &self.air().expectation
    }

    /// Returns the frame that has just reached the DPR's antenna, if the current event brings one.
    ///
    /// # Panics
    ///
    /// Panics if this is called within [`Context::take`].
    #[must_use]
    pub fn delivery(&self) -> Option<&Delivery> {
        self.air().delivery.as_ref()
    }

    /// Resets the window after a start of the DPR, which has lost the flight controller's last request.
    fn forget_window(&mut self, board: Board) {
        if board == Board::Dpr {
            self.window = Window::default();
        }
    }

    fn running_mut(&mut self, board: Board) -> &mut Running {
        match board {
            Board::Horus => &mut self.horus,
            Board::Dpr => &mut self.dpr,
        }
    }

    /// Returns the state of a board since its last start.
    #[must_use]
    pub fn running(&self, board: Board) -> Running {
        match board {
            Board::Horus => self.horus,
            Board::Dpr => self.dpr,
        }
    }

    /// Returns what the bench disturbs on purpose, and what is excused because of it.
    #[must_use]
    pub fn disturbances(&self) -> &Disturbances {
        &self.disturbances
    }

    /// Returns the instant of the last event of the log, ns.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Returns the layout of the profile, which depends on the number of receivers.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Returns whether the run uses the pessimistic clock, on which each instruction takes its longest time on silicon.
    #[must_use]
    pub fn worst_case(&self) -> bool {
        self.worst_case
    }

    /// Returns the frame of the current event, if that is [`What::Sent`] or [`What::Heard`].
    #[must_use]
    pub fn frame(&self) -> Option<&Frame> {
        self.frame.as_ref()
    }

    /// Returns the transaction of the current event, if that is [`What::Transaction`].
    #[must_use]
    pub fn reading(&self) -> Option<&Reading> {
        self.reading.as_ref()
    }

    /// Returns the range of the map that the next transaction reads.
    #[must_use]
    pub fn window(&self) -> Window {
        self.window
    }

    /// Returns whether the run is over.
    #[must_use]
    pub fn ended(&self) -> bool {
        self.ended
    }
}
