//! The panel: breaks things in the running flight, and shows both boards' logs.
//!
//! # Design
//!
//! It is on the bench's side of the wire, at an address of its own. Nothing that it does reaches the base station but
//! by way of what breaks: the bench is told to break a thing as tests tell it, between two pieces of the run
//! ([`Observer::faults`](bench::sim::Observer::faults)), and the judge learns of it as of every other fault.
//!
//! **How long.** For so many seconds of flight, or until somebody says so. Either is a chain of episodes of
//! [`LINK_NS`], each of which begins before the one before ends, so that the judge always knows an end and holds the
//! link to recover from it; the report counts each. What is to be well again is so within one episode. A supply that is
//! off comes back when it was said to: two of its episodes would not join without a gap.
//!
//! **Hangs.** A firmware starts its watchdog a few milliseconds after its own start; a board that hung before that
//! would hang for ever. So where a board has just been restarted from the panel, or hangs already, its hang is delayed
//! until the watchdog runs again. A board without a supply is not made to hang.
//!
//! **Who may.** It is a server on this machine, which any page in a browser here can send requests to. So what changes
//! anything is refused unless the browser says that it comes from this very page (`Origin`, or `Sec-Fetch-Site` where
//! there is none), and requests by another name of this machine are refused altogether ([`page::guarded`]).
//!
//! | left out | why |
//! |---|---|
//! | what `--faults` can draw beyond this | whoever wants one of them among forty buttons would not find it |

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

/// An episode of a chain lasts so long, virtual ns.
const LINK_NS: u64 = 1_000_000_000;

/// It is followed by the next when no more than this is left of it, virtual ns: two pieces of the run.
const RENEW_NS: u64 = 2 * super::PIECE;

/// Something can be broken for so long at most, s of flight.
const LONGEST: f64 = 600.0;

/// So many lines of the logs are kept.
const LINES: usize = 1_000;

/// Of frames on the air, so many are lost.
const LOST: f64 = 0.4;

/// Of bits on the air, so many are wrong: a frame has about 2000, so of three frames one is whole.
const BIT_ERROR: f64 = 5e-4;

/// RAM that comes up after a supply was off has noise that follows from this.
const NOISE: u64 = 1;

/// A thing that can be broken.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Thing {
    /// A receiver, from 0, says nothing.
    Silent(usize),
    /// A receiver, from 0, finds no position.
    Jammed(usize),
    /// Frames on the air are lost.
    Frames,
    /// Bits on the air are wrong.
    Bits,
    /// HORUS's carrier does not reach the DPR.
    Field,
    /// A board has no supply.
    Off(Board),
    /// A board's reset pin is pulled.
    Reset(Board),
    /// A board hangs, and its watchdog restarts it.
    Hang(Board),
}

impl Thing {
    /// All that can be broken in a flight with so many receivers.
    fn all(receivers: usize) -> Vec<Self> {
        let boards = [Board::Horus, Board::Dpr];
        let mut all: Vec<Self> = (0..receivers).flat_map(|of| [Self::Silent(of), Self::Jammed(of)]).collect();
        all.extend([Self::Frames, Self::Bits, Self::Field]);
        all.extend(boards.into_iter().flat_map(|board| [Self::Off(board), Self::Reset(board), Self::Hang(board)]));
        all
    }

    /// A name for programs.
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

    /// How long it can be broken.
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

/// How long a thing can be broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum How {
    /// For a moment.
    Once,
    /// For seconds of flight.
    ForSeconds,
    /// For seconds of flight, or until somebody says so.
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

/// A thing that is broken.
#[derive(Clone, Copy, Debug)]
struct Broken {
    thing: Thing,
    /// Until when it is to be, virtual ns; `u64::MAX` until somebody says so.
    until: u64,
    /// Until when the bench knows it to be, virtual ns.
    told: u64,
}

/// A line of a board's log.
#[derive(Clone, Debug)]
struct Line {
    at_ns: u64,
    board: String,
    text: String,
}

/// What everybody here looks at.
#[derive(Debug, Default)]
struct Inner {
    receivers: usize,
    /// When the run ends, virtual ns.
    end_ns: u64,
    now_ns: u64,
    over: bool,
    /// What is to be broken from the end of this piece of the run on, and for how many ns.
    asked: Vec<(Thing, u64)>,
    broken: Vec<Broken>,
    /// From when on HORUS's, and the DPR's, watchdog runs for certain, virtual ns.
    watched: [u64; 2],
    log: VecDeque<Line>,
    /// Lines that were forgotten.
    forgotten: u64,
    /// Lines of which the instant is not known yet.
    unstamped: Vec<(String, String)>,
}

impl Inner {
    /// Nothing may be broken from this instant on, so that the run ends in peace, virtual ns.
    const fn last_ns(&self) -> u64 {
        self.end_ns.saturating_sub(LAST_BEFORE_END)
    }

    /// What begins after `now`, virtual ns.
    fn faults(&mut self, now: u64) -> Faults {
        let (at, last) = ((now + AHEAD_NS).max(FIRST_AT), self.last_ns());
        let mut faults = Faults::none();
        // What restarts a board comes before what has it hang.
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
        // What is wrong with the air is one thing: of several episodes the one that began last counts.
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

    /// What the page shows: with the log's lines from number `from` on.
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

    /// What can be broken, in words.
    fn things(&self) -> Value {
        let thing =
            |thing: Thing| json!({ "code": thing.code(), "words": thing.to_string(), "how": thing.how().code() });
        Thing::all(self.receivers).into_iter().map(thing).collect()
    }
}

/// The panel of a run. See the [module](self).
#[derive(Clone, Debug, Default)]
pub(super) struct Panel {
    inner: Arc<Mutex<Inner>>,
}

impl Panel {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        // Whoever panicked while looking has changed nothing by halves.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Serves the panel at `address`; `page` is where the base station's page is.
    pub(super) fn serve(&self, address: SocketAddr, page: SocketAddr) -> io::Result<Server> {
        let panel = self.clone();
        Server::of(address, |address| router(panel, address, page))
    }

    /// A run of so many receivers begins that ends at `end_ns`.
    pub(super) fn begin(&self, receivers: usize, end_ns: u64) {
        *self.inner() = Inner { receivers, end_ns, ..Inner::default() };
    }

    /// A board logged a line.
    pub(super) fn log(&self, board: &str, line: &str) {
        self.inner().unstamped.push((board.to_owned(), line.to_owned()));
    }

    /// The run has come this far, virtual ns: so has what was logged.
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

    /// What begins after `now_ns`, at the end of a piece of the run.
    pub(super) fn faults(&self, now_ns: u64) -> Faults {
        self.inner().faults(now_ns)
    }

    /// Whether the run is to end.
    pub(super) fn is_over(&self) -> bool {
        self.inner().over
    }

    /// Breaks things as somebody does who presses one button after the other, so many of them together as there are.
    #[cfg(test)]
    pub(super) fn press(&self, button: usize, ns: Option<u64>) {
        let mut inner = self.inner();
        let all = Thing::all(inner.receivers);
        let thing = all[button % all.len()];
        let ns = ns.or((thing.how() == How::Lasting).then_some(u64::MAX)).unwrap_or(LINK_NS);
        inner.asked.push((thing, ns));
    }

    /// The run is to end.
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

/// The value of `name` in a query.
fn asked<'a>(query: Option<&'a str>, name: &str) -> Option<&'a str> {
    query?.split('&').filter_map(|part| part.split_once('=')).find(|(other, _)| *other == name).map(|(_, value)| value)
}

async fn state(State(panel): State<Panel>, RawQuery(query): RawQuery) -> Response {
    let from = asked(query.as_deref(), "from").and_then(|from| from.parse().ok()).unwrap_or(0);
    json(&panel.inner().state(from))
}

/// Whether a request comes from a page of this very server, as far as the browser says.
fn is_from_here(headers: &HeaderMap) -> bool {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    match (text(header::ORIGIN), text(header::HOST)) {
        (Some(origin), Some(host)) => origin.strip_prefix("http://") == Some(host),
        (None, _) => headers.get("sec-fetch-site").is_some_and(|site| site == "same-origin"),
        _ => false,
    }
}

/// `POST /break?what=CODE&seconds=N`; without seconds until somebody says so.
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

/// `POST /well`: nothing is broken any more; with `?what=CODE`, that is not.
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
