//! Serves the page, which shows the station's state in a browser.
//!
//! **Read-only.** The page can only change the pace of a playback, and send an uplink or a command to a hold if the
//! station was started with these enabled ([`voice`](crate::carrier::mavlink::voice)). A user of the page sees every
//! drone; by default the page can be opened only on this machine.
//!
//! **Pushed.** Server-sent events come at most every [`PUSH`]. Each has a whole state, made when the connection can
//! accept it. So a slow reader gets fewer states, never old ones, and no queue grows. The first state of a connection
//! includes the drone's last ten minutes ([`history`](crate::station::history)), at most 150 kB. A browser allows six
//! connections to one host, so the tabs of a browser share one connection (`stream.js`).
//!
//! **Nothing from elsewhere.** HTML, style and script are in the binary, and the content security policy allows no
//! others. A request's Host must be this machine's name or, if the station listens on another address, an address in
//! numbers. So no foreign page can reach the station through a name that resolves to this machine. Only this page may
//! request changes.

#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::convert::Infallible;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{RawQuery, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use futures_util::stream;
use profile::{Uplink, UplinkStatus};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, sleep};

use super::playback::Player;
use super::{Station, StationData};
use crate::carrier::mavlink::Voice;
use crate::carrier::mavlink::commander;
use crate::carrier::mavlink::voice::NotSent;
use crate::station::state::{self, Playback, With};
use crate::{DroneId, Fleet};

/// The shortest time between two states: about a screen's refresh.
pub const PUSH: Duration = Duration::from_millis(16);

/// The shortest time between two states with the list of all drones.
pub const LIST: Duration = Duration::from_millis(500);

const RETRY: Duration = Duration::from_millis(500);

/// The greatest number of drones that one connection can request. Their states are sent in turn.
pub const MAX_ASKED: usize = 16;

/// The greatest number of browsers that may read states at once; others are refused.
pub const MAX_WATCHERS: usize = 256;

const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; \
                      worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The conditions for the use of a page: the address, and a login if there is one.
#[derive(Clone, Debug)]
pub struct Access {
    local: bool,
    login: Option<String>,
}

impl From<SocketAddr> for Access {
    fn from(address: SocketAddr) -> Self {
        Self { local: address.ip().is_loopback(), login: None }
    }
}

impl Access {
    /// Returns the access of a page that requires the login `user:password`. HTTP's Basic scheme does not encrypt the
    /// login. Encryption needs a proxy with TLS before the page.
    #[must_use]
    pub fn with_login(self, login: &str) -> Self {
        Self { login: Some(format!("Basic {}", BASE64_STANDARD.encode(login))), ..self }
    }

    /// Returns whether the request has the login. The duration of the check does not reveal a partly right login.
    fn admits(&self, headers: &HeaderMap) -> bool {
        let Some(login) = &self.login else { return true };
        let said = text(headers, header::AUTHORIZATION).unwrap_or_default();
        let differences = login.bytes().zip(said.bytes()).fold(0, |all, (one, other)| all | (one ^ other));
        said.len() == login.len() && differences == 0
    }
}

#[derive(Clone)]
struct Page {
    station: Station,
    player: Option<Arc<Player>>,
    watchers: Arc<Semaphore>,
}

/// Returns a station's page for clients with `access`. With a `player`, the page can set the pace of the playback.
/// Uplinks and commands can be sent if the station has them enabled already.
pub fn router(station: Station, player: Option<Arc<Player>>, access: impl Into<Access>) -> Router {
    let page = Page { station, player, watchers: Arc::new(Semaphore::new(MAX_WATCHERS)) };
    let mut router = Router::new()
        .route("/", get(|| file("text/html; charset=utf-8", include_str!("index.html"))))
        .route("/page.css", get(|| file("text/css; charset=utf-8", include_str!("page.css"))))
        .route("/page.js", get(|| file("text/javascript; charset=utf-8", include_str!("page.js"))))
        .route("/hold.js", get(|| file("text/javascript; charset=utf-8", include_str!("hold.js"))))
        .route("/stream.js", get(|| file("text/javascript; charset=utf-8", include_str!("stream.js"))))
        .route("/icon.svg", get(|| file("image/svg+xml", include_str!("icon.svg"))))
        .route("/state", get(state_once))
        .route("/events", get(events));
    if page.player.is_some() {
        router = router.route("/playback", post(playback));
    }
    if page.station.known().voice.as_ref().is_some_and(Voice::sends_uplinks) {
        router = router.route("/uplink", post(uplink));
    }
    if page.station.known().voice.as_ref().is_some_and(Voice::sends_commands) {
        router = router.route("/hold", post(command));
    }
    guarded(router.with_state(page), access)
}

/// Applies `access` and the rules of every page to `router`: other hosts' names are refused, and each answer has the
/// content security policy.
pub fn guarded(router: Router, access: impl Into<Access>) -> Router {
    router.layer(middleware::from_fn_with_state(access.into(), guard))
}

async fn file(kind: &'static str, text: &'static str) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, kind)], text)
}

async fn guard(State(access): State<Access>, request: Request, next: Next) -> Response {
    let foreign = !request.method().is_safe() && !is_own_page(request.headers());
    if foreign || !is_served_as(access.local, request.headers()) {
        return (StatusCode::FORBIDDEN, "this page is served by another name, or to another page").into_response();
    }
    let mut response = match access.admits(request.headers()) {
        true => next.run(request).await,
        false => (StatusCode::UNAUTHORIZED, [(header::WWW_AUTHENTICATE, "Basic realm=\"HORUS\"")]).into_response(),
    };
    let fixed = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    for (name, value) in fixed {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

fn text(headers: &HeaderMap, name: impl header::AsHeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or_default())
}

/// Returns whether the request's Host is safe: this machine's own name or, unless `local`, an address in numbers. A
/// foreign page can make other names resolve to this machine.
fn is_served_as(local: bool, headers: &HeaderMap) -> bool {
    let host = text(headers, header::HOST).unwrap_or_default();
    let name = host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit()));
    let name = name.map_or(host, |(name, _)| name);
    let address = || name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>().is_ok();
    matches!(name, "localhost" | "127.0.0.1" | "[::1]") || (!local && address())
}

/// Returns whether a request for a change comes from this page, or from no browser. Browsers state which site made the
/// request.
fn is_own_page(headers: &HeaderMap) -> bool {
    let host = text(headers, header::HOST).unwrap_or_default();
    let own = |origin: &str| origin.split_once("://").is_some_and(|(_, of)| of == host);
    text(headers, header::ORIGIN).is_none_or(own)
        && text(headers, "sec-fetch-site").is_none_or(|site| matches!(site, "same-origin" | "none"))
}

fn parts(query: Option<&str>) -> impl Iterator<Item = (Cow<'_, str>, Cow<'_, str>)> {
    form_urlencoded::parse(query.unwrap_or_default().as_bytes())
}

fn value<'a>(query: Option<&'a str>, name: &str) -> Option<Cow<'a, str>> {
    parts(query).find_map(|(is, value)| (is == name).then_some(value))
}

fn json(page: &Page, drone: Option<&str>, asked: &str, with: With) -> String {
    let playback = page.player.as_ref().map(|player| {
        let (first_us, last_us) = player.span_us();
        let seconds = |us: u64| us.saturating_sub(first_us) as f64 / 1e6;
        // The number of changes is read before the instant, so every change in that number has already had its effect
        // on the instant.
        let changes = player.changes();
        let now_us = player.now_us();
        Playback { speed: player.speed(), at_s: seconds(now_us), length_s: seconds(last_us), changes, now_us }
    });
    let known = page.station.known();
    let state = state::state(&known, page.station.dropped(), playback, drone, asked, with);
    drop(known);
    serde_json::to_string(&state).unwrap_or_default()
}

async fn state_once(State(page): State<Page>, RawQuery(query): RawQuery) -> impl IntoResponse {
    let drone = value(query.as_deref(), "drone");
    let with = With { list: true, history: false };
    let state = json(&page, drone.as_deref(), drone.as_deref().unwrap_or_default(), with);
    ([(header::CONTENT_TYPE, "application/json")], state)
}

async fn events(State(page): State<Page>, RawQuery(query): RawQuery) -> Response {
    let Ok(permit) = Arc::clone(&page.watchers).try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, [(header::RETRY_AFTER, "5")], "too many watch already")
            .into_response();
    };
    let changes = page.station.changes();
    let drones = all_asked(query.as_deref());
    let round = Round { drones, next: 0, listed: None, with: With { list: true, history: true } };
    let states = stream::unfold((page, changes, round, permit), |(page, mut changes, mut round, permit)| async move {
        if round.next == 0 {
            if round.listed.is_some() {
                sleep(PUSH).await;
                changes.changed().await.ok()?;
            }
            changes.mark_unchanged();
            let list = round.listed.is_none_or(|listed| listed.elapsed() >= LIST);
            round.with = With { list, history: round.listed.is_none() };
            if list {
                round.listed = Some(Instant::now());
            }
        }
        let Round { drones, next, with, .. } = &mut round;
        let Asked { name, shown } = &mut drones[*next];
        // Once a connection has shown a drone, it keeps showing that drone, even if another drone appears.
        if shown.is_none() {
            *shown = page.station.known().intake.fleet().iter().next().map(|(id, _)| id.to_string());
        }
        let state = json(&page, shown.as_deref(), name, *with);
        *next = (*next + 1) % drones.len();
        let event = Ok::<_, Infallible>(Event::default().retry(RETRY).data(state));
        let permit: OwnedSemaphorePermit = permit;
        Some((event, (page, changes, round, permit)))
    });
    Sse::new(states).into_response()
}

struct Round {
    drones: Vec<Asked>,
    next: usize,
    listed: Option<Instant>,
    with: With,
}

struct Asked {
    name: String,
    shown: Option<String>,
}

fn all_asked(query: Option<&str>) -> Vec<Asked> {
    let mut names: Vec<String> = vec![];
    for (_, name) in parts(query).filter(|(is, _)| is == "drone") {
        if !names.iter().any(|known| *known == name) && names.len() < MAX_ASKED {
            names.push(name.into_owned());
        }
    }
    if names.is_empty() {
        names.push(String::new());
    }
    let asked = |name: String| Asked { shown: (!name.is_empty()).then(|| name.clone()), name };
    names.into_iter().map(asked).collect()
}

/// Sets the pace (`speed=2`) or the instant (`at=SECONDS` from the start) of a playback. Returns the number of changes
/// so far. States with at least this number include the change.
async fn playback(State(page): State<Page>, RawQuery(query): RawQuery) -> Response {
    let (Some(player), Some(query)) = (&page.player, query) else { return StatusCode::BAD_REQUEST.into_response() };
    if query.is_empty() {
        return StatusCode::BAD_REQUEST.into_response();
    }
    for (name, value) in parts(Some(&query)) {
        match (&*name, value.parse::<f64>()) {
            ("speed", Ok(speed)) if speed.is_finite() => player.set_speed(speed),
            ("at", Ok(seconds)) if seconds.is_finite() => {
                let (first_us, _) = player.span_us();
                player.jump(first_us.saturating_add((seconds.max(0.0) * 1e6) as u64));
            }
            _ => return StatusCode::BAD_REQUEST.into_response(),
        }
    }
    player.changes().to_string().into_response()
}

/// Sends an uplink: `drone=ID`, `payload=` up to 104 hexadecimal digits, padded with zeros, and `status=` a number, 0
/// by default. Returns the uplink's timestamp, which identifies the uplink in the states.
async fn uplink(State(page): State<Page>, RawQuery(query): RawQuery) -> Response {
    let query = query.unwrap_or_default();
    let value = |name: &str| query.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='));
    let status = value("status").map_or(Some(0), |status| status.parse().ok());
    let (Some(drone), Some(payload), Some(status)) = (value("drone"), value("payload").and_then(payload), status)
    else {
        let words = "wanted: drone=ID&payload=HEX, at most 104 hexadecimal digits, and status=0 to 65535";
        return (StatusCode::BAD_REQUEST, words).into_response();
    };
    answer(speak(&page, drone, |voice, now_us, fleet, id| {
        voice.send(now_us, fleet, id, UplinkStatus::from_bits(status), payload)
    }))
}

/// Sends a command to a hold: `drone=ID` and `command=` `set-point`, `lock`, `unlock` or `clear-shock`; a set-point
/// also has `value=`, °C. Returns the command's number.
async fn command(State(page): State<Page>, RawQuery(query): RawQuery) -> Response {
    let value = |name: &str| value(query.as_deref(), name);
    let number = value("value").map(|value| value.parse::<f32>());
    let named = value("command").zip(number.transpose().ok());
    let named = named.and_then(|(name, value)| commander::command(&name, value.filter(|value| value.is_finite())));
    let (Some(drone), Some(command)) = (value("drone"), named) else {
        let words = "wanted: drone=ID&command=lock, unlock, clear-shock or set-point&value=CELSIUS";
        return (StatusCode::BAD_REQUEST, words).into_response();
    };
    answer(speak(&page, &drone, |voice, now_us, fleet, id| {
        voice.command(now_us, fleet, id, command).map(|record| u32::from(record.number))
    }))
}

fn speak<T>(
    page: &Page,
    drone: &str,
    say: impl FnOnce(&mut Voice, u64, &Fleet, DroneId) -> Result<T, NotSent>,
) -> Result<T, NotSent> {
    let mut known = page.station.known();
    let StationData { intake, voice, now_us, .. } = &mut *known;
    let id = intake.fleet().iter().map(|(id, _)| id).find(|id| id.to_string() == drone);
    let voice = voice.as_mut().ok_or(NotSent::NotAllowed)?;
    say(voice, *now_us, intake.fleet(), id.ok_or(NotSent::UnknownDrone)?)
}

fn answer(sent: Result<u32, NotSent>) -> Response {
    match sent {
        Ok(number) => (StatusCode::ACCEPTED, number.to_string()).into_response(),
        Err(why) => (StatusCode::CONFLICT, why.to_string()).into_response(),
    }
}

fn payload(digits: &str) -> Option<[u8; Uplink::PAYLOAD]> {
    let mut payload = [0; Uplink::PAYLOAD];
    let pairs = digits.as_bytes().chunks(2);
    if digits.is_empty() || pairs.len() > payload.len() {
        return None;
    }
    for (byte, pair) in payload.iter_mut().zip(pairs) {
        let [high, low] = pair else { return None };
        let digit = |digit: u8| char::from(digit).to_digit(16);
        *byte = u8::try_from(digit(*high)? << 4 | digit(*low)?).ok()?;
    }
    Some(payload)
}
