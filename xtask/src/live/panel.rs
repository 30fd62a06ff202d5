//! The panel, with which a user injects faults into the running flight and sees both boards' logs.
//!
//! The panel is at a separate address, and affects the base station only through the faults. It passes them to the
//! bench between two steps of the run ([`Observer::faults`](bench::sim::Observer::faults)), as tests do. The judge is
//! told of them too.
//!
//! **Duration.** A fault lasts for a number of seconds of flight, or until the user ends it. It is a chain of episodes
//! of [`LINK_NS`], each of which begins before the last one ends. So each episode has an end, from which the judge
//! checks the link's recovery. A supply that is switched off has one fixed end instead, because two such episodes would
//! not join without a gap.
//!
//! **Hangs.** A firmware starts its watchdog a few microseconds after its own start; a board that hung before that
//! would hang for ever. So the hang of a board that has just been restarted from the panel, or hangs already, is
//! delayed until its watchdog certainly runs. A board without a supply is not made to hang.
//!
//! **Access.** Any page in a browser on this machine can send requests to the panel. So a change is refused unless the
//! browser names the panel's own page as its origin (`Origin`, or `Sec-Fetch-Site` if there is none), and requests to
//! another name of this machine are refused altogether ([`page::guarded`]).

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::Router;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use base_station::live::page;
use base_station::live::server::Server;
use bench::faults::plan::{FIRST_AT, HANG_LENGTH, LAST_BEFORE_END, WATCHDOG_STARTS};
use bench::faults::{AirFaults, Board, Fault, Faults, PowerFault, ReceiverFault, name_of};
use bench::sim::AHEAD_NS;
use serde_json::{Value, json};

const LINK_NS: u64 = 1_000_000_000;

/// How long before an episode's end the next episode of a fault begins, virtual ns: two steps of the run.
const RENEW_NS: u64 = 2 * super::PIECE;

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
    /// The instant at which the fault ends, virtual ns; `u64::MAX` while the user has not ended it.
    until: u64,
    /// The end of the last episode of the fault that was passed to the bench, virtual ns.
    told: u64,
}

#[derive(Clone, Debug)]
struct Line {
    at_ns: u64,
    board: String,
    text: String,
}

#[derive(Debug, Default)]
struct Inner {
    receivers: usize,
    end_ns: u64,
    now_ns: u64,
    over: bool,
    /// The requested faults, which begin after the present step of the run, with their durations, ns.
    asked: Vec<(Thing, u64)>,
    broken: Vec<Broken>,
    /// For each of HORUS and the DPR, the instant from which on its watchdog certainly runs, virtual ns.
    watched: [u64; 2],
    log: VecDeque<Line>,
    forgotten: u64,
    unstamped: Vec<(String, String)>,
}

impl Inner {
    const fn last_ns(&self) -> u64 {
        self.end_ns.saturating_sub(LAST_BEFORE_END)
    }

    fn faults(&mut self, now: u64) -> Faults {
        let (at, last) = ((now + AHEAD_NS).max(FIRST_AT), self.last_ns());
        let mut faults = Faults::none();
        // Faults that restart a board are handled first. A hang of the same board is then delayed until its watchdog
        // runs.
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
        // Among several episodes on the air only the last has effect, so each episode has all faults of the air that
        // are present.
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

    fn state(&self, from: u64) -> Value {
        let seconds = |ns: u64| ns as f64 / 1e9;
        let broken = self.broken.iter().map(|broken| {
            let until = if broken.until == u64::MAX { Value::Null } else { seconds(broken.until).into() };
            json!({ "code": broken.thing.code(), "words": broken.thing.to_string(), "until_s": until })
        });
        let skipped = from.saturating_sub(self.forgotten);
        let lines = self.log.iter().skip(usize::try_from(skipped).unwrap_or(usize::MAX));
        let lines = lines.map(|line| json!([seconds(line.at_ns), line.board, line.text]));
        json!({
            "now_s": seconds(self.now_ns),
            "over": self.over,
            "broken": broken.collect::<Vec<_>>(),
            "lines": lines.collect::<Vec<_>>(),
            "next": self.forgotten + self.log.len() as u64,
        })
    }

    fn things(&self) -> Value {
        let thing =
            |thing: Thing| json!({ "code": thing.code(), "words": thing.to_string(), "how": thing.how().code() });
        Thing::all(self.receivers).into_iter().map(thing).collect()
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Panel {
    inner: Arc<Mutex<Inner>>,
}

impl Panel {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        // A poisoned lock is ignored: a thread that panicked while it held the lock has left no partial change behind.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn serve(&self, address: SocketAddr, page: SocketAddr) -> io::Result<Server> {
        let panel = self.clone();
        Server::of(address, |address| router(panel, address, page))
    }

    pub(super) fn begin(&self, receivers: usize, end_ns: u64) {
        *self.inner() = Inner { receivers, end_ns, ..Inner::default() };
    }

    pub(super) fn log(&self, board: &str, line: &str) {
        self.inner().unstamped.push((board.to_owned(), line.to_owned()));
    }

    pub(super) fn progress(&self, now_ns: u64) {
        let mut inner = self.inner();
        inner.now_ns = now_ns;
        for (board, text) in std::mem::take(&mut inner.unstamped) {
            inner.log.push_back(Line { at_ns: now_ns, board, text });
        }
        while inner.log.len() > LINES {
            inner.log.pop_front();
            inner.forgotten += 1;
        }
    }

    pub(super) fn faults(&self, now_ns: u64) -> Faults {
        self.inner().faults(now_ns)
    }

    pub(super) fn is_over(&self) -> bool {
        self.inner().over
    }

    /// Presses the button of this index, for a fault of `ns` nanoseconds. Without `ns`, the fault lasts until the user
    /// ends it, if it can, and otherwise for [`LINK_NS`].
    #[cfg(test)]
    pub(super) fn press(&self, button: usize, ns: Option<u64>) {
        let mut inner = self.inner();
        let all = Thing::all(inner.receivers);
        let thing = all[button % all.len()];
        let ns = ns.or((thing.how() == How::Lasting).then_some(u64::MAX)).unwrap_or(LINK_NS);
        inner.asked.push((thing, ns));
    }

    #[cfg(test)]
    pub(super) fn end(&self) {
        self.inner().over = true;
    }
}

fn router(panel: Panel, address: SocketAddr, page: SocketAddr) -> Router {
    let index = include_str!("panel/index.html").replace("PAGE", &page.to_string());
    let file = |kind: &'static str, text: String| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    let router = Router::new()
        .route("/", file("text/html; charset=utf-8", index))
        .route("/panel.css", file("text/css; charset=utf-8", include_str!("panel/panel.css").to_owned()))
        .route("/panel.js", file("text/javascript; charset=utf-8", include_str!("panel/panel.js").to_owned()))
        .route("/things", get(async |State(panel): State<Panel>| json(&panel.inner().things())))
        .route("/state", get(state))
        .route("/break", post(break_thing))
        .route("/well", post(all_well));
    page::guarded(router.with_state(panel), address)
}

fn json(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

fn asked<'a>(query: Option<&'a str>, name: &str) -> Option<&'a str> {
    query?.split('&').filter_map(|part| part.split_once('=')).find(|(other, _)| *other == name).map(|(_, value)| value)
}

async fn state(State(panel): State<Panel>, RawQuery(query): RawQuery) -> Response {
    let from = asked(query.as_deref(), "from").and_then(|from| from.parse().ok()).unwrap_or(0);
    json(&panel.inner().state(from))
}

fn is_from_here(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    match (text(header::ORIGIN), text(header::HOST)) {
        (Some(origin), Some(host)) => origin.strip_prefix("http://") == Some(host),
        (None, _) => headers.get("sec-fetch-site").is_some_and(|site| site == "same-origin"),
        _ => false,
    }
}

/// Answers `POST /break?what=CODE&seconds=N`: begins a fault. Without seconds it lasts until the user ends it.
async fn break_thing(State(panel): State<Panel>, headers: HeaderMap, RawQuery(query): RawQuery) -> Response {
    if !is_from_here(&headers) {
        return (StatusCode::FORBIDDEN, "this is for the panel's own page").into_response();
    }
    let mut inner = panel.inner();
    let code = asked(query.as_deref(), "what").unwrap_or_default();
    let Some(thing) = Thing::all(inner.receivers).into_iter().find(|thing| thing.code() == code) else {
        return (StatusCode::BAD_REQUEST, "there is no such thing to break").into_response();
    };
    let seconds = asked(query.as_deref(), "seconds").map(str::parse::<f64>);
    let ns = match (seconds, thing.how()) {
        (_, How::Once) => 0,
        (Some(Ok(seconds)), _) if (0.1..=LONGEST).contains(&seconds) => (seconds * 1e9) as u64,
        (None, How::Lasting) => u64::MAX,
        _ => return (StatusCode::BAD_REQUEST, "for 0.1 to 600 seconds of flight").into_response(),
    };
    if inner.now_ns + LINK_NS >= inner.last_ns() {
        return (StatusCode::CONFLICT, "too little of the flight is left").into_response();
    }
    inner.asked.push((thing, ns));
    StatusCode::NO_CONTENT.into_response()
}

/// Answers `POST /well`: ends all faults or, with `?what=CODE`, one fault.
async fn all_well(State(panel): State<Panel>, headers: HeaderMap, RawQuery(query): RawQuery) -> Response {
    if !is_from_here(&headers) {
        return (StatusCode::FORBIDDEN, "this is for the panel's own page").into_response();
    }
    let code = asked(query.as_deref(), "what");
    let is_meant = |thing: Thing| code.is_none_or(|code| thing.code() == code);
    let mut inner = panel.inner();
    inner.asked.retain(|(thing, _)| !is_meant(*thing));
    let lasting = |broken: &&mut Broken| is_meant(broken.thing) && broken.thing.how() == How::Lasting;
    inner.broken.iter_mut().filter(lasting).for_each(|broken| broken.until = broken.told);
    StatusCode::NO_CONTENT.into_response()
}
