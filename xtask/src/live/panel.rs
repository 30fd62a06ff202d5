//! The panel, with which a user injects faults into the running flight and sees both boards' logs ([`bench::panel`]).
//!
//! The panel is at a separate address, and affects the base station only through the faults.
//!
//! **Access.** A page in a browser on this machine may send requests to any address on it. So the panel accepts a
//! change only if the browser names the panel's own page as its origin (`Origin`, or else `Sec-Fetch-Site`). It refuses
//! all requests to another name of this machine ([`page::guarded`]).

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
use bench::faults::Faults;
use bench::panel::{self, Refused};
use serde::Serialize;

#[derive(Clone, Debug, Default)]
pub(super) struct Panel {
    inner: Arc<Mutex<panel::Panel>>,
}

impl Panel {
    fn inner(&self) -> MutexGuard<'_, panel::Panel> {
        // A poisoned lock is ignored, because no change is left incomplete by a panic.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn serve(&self, address: SocketAddr, page: SocketAddr) -> io::Result<Server> {
        let panel = self.clone();
        Server::of(address, |address| router(panel, address, page))
    }

    pub(super) fn begin(&self, receivers: usize, end_ns: u64) {
        *self.inner() = panel::Panel::new(receivers, end_ns);
    }

    pub(super) fn log(&self, board: &str, line: &str) {
        self.inner().log(board, line);
    }

    pub(super) fn progress(&self, now_ns: u64) {
        self.inner().progress(now_ns);
    }

    pub(super) fn faults(&self, now_ns: u64) -> Faults {
        self.inner().faults(now_ns)
    }

    pub(super) fn is_over(&self) -> bool {
        self.inner().is_over()
    }

    #[cfg(test)]
    pub(super) fn press(&self, button: usize, ns: Option<u64>) {
        self.inner().press(button, ns);
    }

    #[cfg(test)]
    pub(super) fn end(&self) {
        self.inner().end();
    }
}

fn router(panel: Panel, address: SocketAddr, page: SocketAddr) -> Router {
    let index = include_str!("panel/index.html").replace("PAGE", &page.to_string());
    let file = |kind: &'static str, text: String| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    let router = Router::new()
        .route("/", file("text/html; charset=utf-8", index))
        .route("/panel.css", file("text/css; charset=utf-8", include_str!("panel/panel.css").to_owned()))
        .route("/panel.js", file("text/javascript; charset=utf-8", include_str!("panel/panel.js").to_owned()))
        .route("/things", get(async |State(panel): State<Panel>| json(&panel.inner().buttons())))
        .route("/state", get(state))
        .route("/break", post(break_thing))
        .route("/well", post(all_well));
    page::guarded(router.with_state(panel), address)
}

fn json(value: &impl Serialize) -> Response {
    let text = serde_json::to_string(value).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
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

/// Answers `POST /break?what=CODE&seconds=N`: begins a fault. Without seconds the fault lasts until the user ends it.
async fn break_thing(State(panel): State<Panel>, headers: HeaderMap, RawQuery(query): RawQuery) -> Response {
    if !is_from_here(&headers) {
        return (StatusCode::FORBIDDEN, "this is for the panel's own page").into_response();
    }
    let code = asked(query.as_deref(), "what").unwrap_or_default();
    let seconds = asked(query.as_deref(), "seconds").map(|seconds| seconds.parse().unwrap_or(f64::NAN));
    match panel.inner().ask(code, seconds) {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(why @ Refused::Ending) => (StatusCode::CONFLICT, why.to_string()).into_response(),
        Err(why) => (StatusCode::BAD_REQUEST, why.to_string()).into_response(),
    }
}

/// Answers `POST /well`: ends all faults or, with `?what=CODE`, one fault.
async fn all_well(State(panel): State<Panel>, headers: HeaderMap, RawQuery(query): RawQuery) -> Response {
    if !is_from_here(&headers) {
        return (StatusCode::FORBIDDEN, "this is for the panel's own page").into_response();
    }
    panel.inner().well(asked(query.as_deref(), "what"));
    StatusCode::NO_CONTENT.into_response()
}
