//! What every rule has to know: since when each board runs, and what the bench does wrong on purpose.

use profile::Layout;

use crate::expectation::{Delivery, Expectation};
use crate::read::{Frame, Reading, Window};
use crate::truth::Truth;
use crate::{Board, Disturbance, Disturbances, Event, Header, What};

/// Since when a board runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Running {
    /// It has a supply.
    pub powered: bool,
    /// When it last started: power-on, or the end of a reset, ns.
    pub since: u64,
    /// How often it has started.
    pub starts: u64,
    /// Since when it hangs by the bench's hand, ns, until its next start; `None` if it does not.
    pub hung: Option<u64>,
    /// Since when one of its tasks is dead, ns, until its next start; `None` if none is.
    pub dead: Option<u64>,
    /// Its last start ended such a hang, or the death of a task.
    pub ended_hang: bool,
}

impl Running {
    /// It starts, or loses its supply.
    fn ends_hang(&mut self) {
        self.ended_hang = self.hung.take().is_some() | self.dead.take().is_some();
    }
}

/// What HORUS put on the air, and what of it the DPR must or may make of what reached its antenna.
#[derive(Clone, Debug)]
struct Air {
    truth: Truth,
    expectation: Expectation,
    /// Of the event that is being judged.
    delivery: Option<Delivery>,
}

/// The state of the run at the event that is being judged, that event included.
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
    /// Always there but while it takes an event, which it looks at in this context.
    air: Option<Box<Air>>,
}

impl Context {
    /// At power-on of both boards.
    ///
    /// # Panics
    ///
    /// If there is no profile for the header's number of receivers.
    #[must_use]
    pub fn new(header: &Header) -> Self {
        let running = Running { powered: true, since: 0, starts: 1, hung: None, dead: None, ended_hang: false };
        let layout = Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers");
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

    /// Takes the next event.
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
                // Without a supply nothing hangs.
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

    /// What HORUS put on the air.
    ///
    /// # Panics
    ///
    /// Within [`Context::take`].
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.air().truth
    }

    /// What the DPR must or may make of what has reached its antenna.
    ///
    /// # Panics
    ///
    /// Within [`Context::take`].
    #[must_use]
    pub fn expectation(&self) -> &Expectation {
        &self.air().expectation
    }

    /// The frame of the event that is being judged, if it has reached the DPR's antenna.
    ///
    /// # Panics
    ///
    /// Within [`Context::take`].
    #[must_use]
    pub fn delivery(&self) -> Option<&Delivery> {
        self.air().delivery.as_ref()
    }

    /// A DPR that starts anew has heard of no window.
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

    /// Since when a board runs.
    #[must_use]
    pub fn running(&self, board: Board) -> Running {
        match board {
            Board::Horus => self.horus,
            Board::Dpr => self.dpr,
        }
    }

    /// What the bench disturbs on purpose, and what is excused because of it.
    #[must_use]
    pub fn disturbances(&self) -> &Disturbances {
        &self.disturbances
    }

    /// The instant of the last event, ns.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.now
    }

    /// The profile's layout.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Whether the cores' time is the longest that silicon may take.
    #[must_use]
    pub fn worst_case(&self) -> bool {
        self.worst_case
    }

    /// The frame of the event that is being judged, if it is [`What::Sent`] or [`What::Heard`].
    #[must_use]
    pub fn frame(&self) -> Option<&Frame> {
        self.frame.as_ref()
    }

    /// The transaction of the event that is being judged, if it is [`What::Transaction`].
    #[must_use]
    pub fn reading(&self) -> Option<&Reading> {
        self.reading.as_ref()
    }

    /// Which part of the image the next transaction shows.
    #[must_use]
    pub fn window(&self) -> Window {
        self.window
    }

    /// Whether the run is over.
    #[must_use]
    pub fn ended(&self) -> bool {
        self.ended
    }
}
