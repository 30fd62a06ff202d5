//! The panel, with which a user injects faults into a running flight and sees the boards' logs.
//!
//! A run passes the panel's faults to the bench between two steps ([`Observer::faults`](crate::sim::Observer)), and the
//! event log has them for the judge. Other crates connect the panel with its user.
//!
//! **Duration.** A fault lasts for a number of seconds of flight, or until the user ends it. The panel makes a chain of
//! overlapping episodes of a second, so that the judge knows an end after which the link must recover. Only a
//! switched-off supply has one episode with a fixed end.
//!
//! **Hangs.** A board that hangs before its firmware has started the watchdog would hang for ever. The panel therefore
//! delays a hang until the board's watchdog certainly runs. A board without supply cannot hang.

use std::collections::VecDeque;
use std::fmt;

use serde::Serialize;

use crate::faults::plan::{FIRST_AT, HANG_LENGTH, LAST_BEFORE_END, WATCHDOG_STARTS};
use crate::faults::{AirFaults, Board, Fault, Faults, PowerFault, ReceiverFault, name_of};
use crate::sim::AHEAD_NS;

/// The length of a step of the run, virtual ns. The panel's faults are added between two steps.
pub const PIECE_NS: u64 = 100_000_000;

const LINK_NS: u64 = 1_000_000_000;

/// The overlap of two successive episodes of a fault, virtual ns: two steps of the run.
const RENEW_NS: u64 = 2 * PIECE_NS;

const LONGEST: f64 = 600.0;

const LINES: usize = 1_000;

const LOST: f64 = 0.4;

/// The bit error rate on the air. A frame has about 2000 bits, so about one in three survives.
const BIT_ERROR: f64 = 5e-4;

const NOISE: u64 = 1;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Thing {
    Silent(usize),
    /// A receiver, from 0, finds no position, as if it were jammed.
    Jammed(usize),
    Frames,
    Bits,
    /// HORUS's carrier does not reach the DPR.
    Field,
    Off(Board),
    Reset(Board),
    /// A board hangs, and its watchdog restarts it.
    Hang(Board),
}

impl Thing {
    fn all(receivers: usize) -> Vec<Self> {
        let boards = [Board::Horus, Board::Dpr];
        let mut all: Vec<Self> = (0..receivers).flat_map(|of| [Self::Silent(of), Self::Jammed(of)]).collect();
        all.extend([Self::Frames, Self::Bits, Self::Field]);
        all.extend(boards.into_iter().flat_map(|board| [Self::Off(board), Self::Reset(board), Self::Hang(board)]));
        all
    }

    fn code(self) -> String {
        match self {
            Self::Silent(of) => format!("silent-{}", of + 1),
            Self::Jammed(of) => format!("jammed-{}", of + 1),
            Self::Frames => "frames".into(),
            Self::Bits => "bits".into(),
            Self::Field => "field".into(),
            Self::Off(board) => format!("off-{}", name_of(board)),
            Self::Reset(board) => format!("reset-{}", name_of(board)),
            Self::Hang(board) => format!("hang-{}", name_of(board)),
        }
    }

    const fn how(self) -> How {
        match self {
            Self::Reset(_) | Self::Hang(_) => How::Once,
            Self::Off(_) => How::ForSeconds,
            _ => How::Lasting,
        }
    }
}

impl fmt::Display for Thing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let board = |board: &Board| match board {
            Board::Horus => "HORUS",
            Board::Dpr => "the DPR",
        };
        match self {
            Self::Silent(of) => write!(f, "GPS{} says nothing", of + 1),
            Self::Jammed(of) => write!(f, "GPS{} is jammed: it finds no position", of + 1),
            Self::Frames => write!(f, "{:.0} % of the frames on the air are lost", LOST * 100.0),
            Self::Bits => write!(f, "one bit in {:.0} on the air is wrong", 1.0 / BIT_ERROR),
            Self::Field => write!(f, "the field between the boards is cut"),
            Self::Off(of) => write!(f, "{} has no supply", board(of)),
            Self::Reset(of) => write!(f, "{} is restarted by its reset pin", board(of)),
            Self::Hang(of) => write!(f, "{} hangs until its watchdog restarts it", board(of)),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum How {
    Once,
    ForSeconds,
    Lasting,
}

impl How {
    const fn code(self) -> &'static str {
        match self {
            Self::Once => "once",
            Self::ForSeconds => "seconds",
            Self::Lasting => "lasting",
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Broken {
    thing: Thing,
    /// The instant at which the fault ends, virtual ns; `u64::MAX` until the user has ended it.
    until: u64,
    /// The end of the last episode that the bench has received for this fault, virtual ns.
    told: u64,
}

#[derive(Clone, Debug)]
struct Line {
    at_ns: u64,
    board: String,
    text: String,
}

/// A fault that lasts.
#[derive(Debug, Serialize)]
pub struct Lasting {
    /// The code of the fault in requests to the panel.
    pub code: String,
    /// The fault in words.
    pub words: String,
    /// The end of the fault, s of flight; `None` until the user ends it.
    pub until_s: Option<f64>,
}

/// What the panel shows.
#[derive(Debug, Serialize)]
pub struct State<'a> {
    /// The instant, s of flight.
    pub now_s: f64,
    /// Whether the user has ended the run.
    pub over: bool,
    /// The present faults.
    pub broken: Vec<Lasting>,
    /// Lines of the boards' logs: the instant (s of flight), the board, the text.
    pub lines: Vec<(f64, &'a str, &'a str)>,
    /// The number of the next line.
    pub next: u64,
}

/// Something that can be broken.
#[derive(Debug, Serialize)]
pub struct Button {
    /// The code of the fault in requests to the panel.
    pub code: String,
    /// The fault in words.
    pub words: String,
    /// How long the fault lasts: `once`, for `seconds`, or `lasting` until the user ends it.
    pub how: &'static str,
}

/// Why a fault cannot begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// There is no fault of this code.
    #[error("there is no such thing to break")]
    Unknown,
    /// The fault cannot last so long.
    #[error("for 0.1 to 600 seconds of flight")]
    Length,
    /// The run ends too early for the link to recover.
    #[error("too little of the flight is left")]
    Ending,
}

/// The faults that a user has asked for, and the last lines of the boards' logs.
#[derive(Debug, Default)]
pub struct Panel {
    receivers: usize,
    end_ns: u64,
    now_ns: u64,
    over: bool,
    /// The requested faults and their durations, ns. They begin after the present step of the run.
    asked: Vec<(Thing, u64)>,
    broken: Vec<Broken>,
    /// The instants from which on HORUS's and the DPR's watchdogs certainly run, virtual ns.
    watched: [u64; 2],
    log: VecDeque<Line>,
    forgotten: u64,
    unstamped: Vec<(String, String)>,
}

impl Panel {
    /// Returns the panel of a run with this number of receivers that ends at `end_ns` (virtual ns).
    #[must_use]
    pub fn new(receivers: usize, end_ns: u64) -> Self {
        Self { receivers, end_ns, ..Self::default() }
    }

    /// Takes a line of a board's log.
    pub fn log(&mut self, board: &str, line: &str) {
        self.unstamped.push((board.to_owned(), line.to_owned()));
    }

    /// Tells the panel that the run has reached `now_ns` (virtual ns).
    pub fn progress(&mut self, now_ns: u64) {
        self.now_ns = now_ns;
        for (board, text) in std::mem::take(&mut self.unstamped) {
            self.log.push_back(Line { at_ns: now_ns, board, text });
        }
        while self.log.len() > LINES {
            self.log.pop_front();
            self.forgotten += 1;
        }
    }

    /// Whether the user has ended the run.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        self.over
    }

    /// Ends the run.
    pub const fn end(&mut self) {
        self.over = true;
    }

    const fn last_ns(&self) -> u64 {
        self.end_ns.saturating_sub(LAST_BEFORE_END)
    }

    /// Returns the faults to add to a run whose boards have reached `now` (virtual ns).
    pub fn faults(&mut self, now: u64) -> Faults {
        let (at, last) = ((now + AHEAD_NS).max(FIRST_AT), self.last_ns());
        let mut faults = Faults::none();
        // Restarts of a board are handled before its hangs, because a restart may delay a hang.
        let mut asked = std::mem::take(&mut self.asked);
        asked.sort_by_key(|(thing, _)| matches!(thing, Thing::Hang(_)));
        for (thing, ns) in asked {
            if at >= last {
                continue;
            }
            let until = at.saturating_add(ns);
            match (thing, thing.how()) {
                (Thing::Reset(board), _) => {
                    faults = faults.with(at, at, Fault::Power(board, PowerFault::Pin));
                    self.watched[board as usize] = at + WATCHDOG_STARTS;
                }
                (Thing::Hang(board), _) => {
                    let is_off = |broken: &Broken| broken.thing == Thing::Off(board) && broken.until > at;
                    let off = self.broken.iter().any(is_off);
                    let at = at.max(self.watched[board as usize]);
                    if at < last && !off {
                        faults = faults.with(at, at, Fault::Hang(board));
                        self.watched[board as usize] = at + HANG_LENGTH.0;
                    }
                }
                (Thing::Off(board), _) => {
                    let until = until.min(last);
                    if !self.broken.iter().any(|broken| broken.thing == thing) {
                        faults = faults.with(at, until, Fault::Power(board, PowerFault::Off(NOISE)));
                        self.broken.push(Broken { thing, until, told: until });
                        self.watched[board as usize] = until + WATCHDOG_STARTS;
                    }
                }
                _ => match self.broken.iter_mut().find(|broken| broken.thing == thing) {
                    Some(broken) => broken.until = until,
                    None => self.broken.push(Broken { thing, until, told: 0 }),
                },
            }
        }
        // Only the last episode of the air has an effect, so each episode contains all present faults of the air.
        let air = AirFaults {
            lost: if self.lasts(Thing::Frames, now) { LOST } else { 0.0 },
            bit_error: if self.lasts(Thing::Bits, now) { BIT_ERROR } else { 0.0 },
            field_off: self.lasts(Thing::Field, now),
            ..AirFaults::default()
        };
        for broken in &mut self.broken {
            let until = broken.until.min(at + LINK_NS).min(last);
            if broken.thing.how() != How::Lasting || until <= broken.told.max(at) || broken.told > now + RENEW_NS {
                continue;
            }
            let fault = match broken.thing {
                Thing::Silent(of) => Fault::Receiver(of, ReceiverFault::Silent),
                Thing::Jammed(of) => Fault::Receiver(of, ReceiverFault::NoFix),
                _ => Fault::Air(air),
            };
            faults = faults.with(at, until, fault);
            broken.told = until;
        }
        self.broken.retain(|broken| broken.told > now);
        faults
    }

    fn lasts(&self, thing: Thing, now: u64) -> bool {
        self.broken.iter().any(|broken| broken.thing == thing && broken.until > now)
    }

    /// Returns what the panel shows, with the lines of the logs from number `from` on.
    #[must_use]
    pub fn state(&self, from: u64) -> State<'_> {
        let seconds = |ns: u64| ns as f64 / 1e9;
        let broken = self.broken.iter().map(|broken| Lasting {
            code: broken.thing.code(),
            words: broken.thing.to_string(),
            until_s: (broken.until != u64::MAX).then(|| seconds(broken.until)),
        });
        let skipped = from.saturating_sub(self.forgotten);
        let lines = self.log.iter().skip(usize::try_from(skipped).unwrap_or(usize::MAX));
        State {
            now_s: seconds(self.now_ns),
            over: self.over,
            broken: broken.collect(),
            lines: lines.map(|line| (seconds(line.at_ns), &*line.board, &*line.text)).collect(),
            next: self.forgotten + self.log.len() as u64,
        }
    }

    /// Returns everything that can be broken.
    #[must_use]
    pub fn buttons(&self) -> Vec<Button> {
        let button = |thing: Thing| Button { code: thing.code(), words: thing.to_string(), how: thing.how().code() };
        Thing::all(self.receivers).into_iter().map(button).collect()
    }

    /// Begins the fault of this code. It lasts for this number of seconds of flight; without a number, until the user
    /// ends it.
    ///
    /// # Errors
    ///
    /// Returns why the fault cannot begin.
    pub fn ask(&mut self, code: &str, seconds: Option<f64>) -> Result<(), Refused> {
        let mut all = Thing::all(self.receivers).into_iter();
        let thing = all.find(|thing| thing.code() == code).ok_or(Refused::Unknown)?;
        let ns = match (seconds, thing.how()) {
            (_, How::Once) => 0,
            (Some(seconds), _) if (0.1..=LONGEST).contains(&seconds) => (seconds * 1e9) as u64,
            (None, How::Lasting) => u64::MAX,
            _ => return Err(Refused::Length),
        };
        if self.now_ns + LINK_NS >= self.last_ns() {
            return Err(Refused::Ending);
        }
        self.asked.push((thing, ns));
        Ok(())
    }

    /// Presses the button of this index, for a fault of `ns` nanoseconds. Without `ns` the fault lasts until the user
    /// ends it, or for a second if the user cannot end it.
    pub fn press(&mut self, button: usize, ns: Option<u64>) {
        let all = Thing::all(self.receivers);
        let thing = all[button % all.len()];
        let ns = ns.or((thing.how() == How::Lasting).then_some(u64::MAX)).unwrap_or(LINK_NS);
        self.asked.push((thing, ns));
    }

    /// Ends all faults or, with a code, the fault of that code.
    pub fn well(&mut self, code: Option<&str>) {
        let is_meant = |thing: Thing| code.is_none_or(|code| thing.code() == code);
        self.asked.retain(|(thing, _)| !is_meant(*thing));
        let lasting = |broken: &&mut Broken| is_meant(broken.thing) && broken.thing.how() == How::Lasting;
        self.broken.iter_mut().filter(lasting).for_each(|broken| broken.until = broken.told);
    }
}
