//! What the page asks for.

use base_station::station::state::With;
use bench::sim::Programs;
use emulator_node::Firmware;
use serde::{Deserialize, Serialize};

use crate::flight::{Flight, Wanted};

/// A request in JSON. All numbers are whole, because the defmt decoder turns on serde_json's arbitrary precision, with
/// which tagged enumerations cannot have other numbers.
#[derive(Debug, Deserialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Request {
    /// Begins a flight. The answer has the settings of the flight ([`Wanted`]).
    Begin {
        /// The settings of the flight in the address of the page.
        flight: Wanted,
        /// The present time, ms since 1970.
        unix_ms: u64,
    },
    /// Runs the flight for 10 ms. The answer is a [`Stepped`](crate::flight::Stepped).
    Step,
    /// Requests the state of the base station's page.
    State {
        /// The drone that the page shows; empty for the first one.
        drone: String,
        /// Whether the answer must contain the list of all drones.
        list: bool,
        /// Whether the answer must contain the history of the last minutes.
        history: bool,
        /// The time since the flight's end, ms.
        after_ms: u64,
    },
    /// Asks for the panel: a path and a query that the panel of `cargo xtask live` has. The answer is an [`Answer`].
    Panel {
        /// The path and the query.
        path: String,
    },
    /// Requests the wires of the last 100 ms, which the answer has as bytes.
    Wires,
}

/// The panel's answer, with the status code of a server.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub struct Answer {
    /// The status, as in HTTP.
    pub status: u16,
    /// The answer in JSON, or the reason why there is none.
    pub body: String,
}

/// The firmwares, and the flight that uses them.
#[derive(Default)]
pub struct Bench {
    firmwares: [Option<Firmware>; 3],
    flight: Option<Flight>,
}

impl Bench {
    /// Takes the firmware of a board: 0 HORUS, 1 the DPR, 2 the hold.
    ///
    /// # Errors
    ///
    /// [`String`] that states why the bytes are no firmware.
    pub fn load(&mut self, board: u32, bytes: &[u8]) -> Result<Vec<u8>, String> {
        let place = usize::try_from(board).ok().and_then(|board| self.firmwares.get_mut(board));
        *place.ok_or("no such board")? = Some(Firmware::unpack(bytes).map_err(|error| error.to_string())?);
        Ok(vec![])
    }

    /// Answers a [`Request`].
    ///
    /// # Errors
    ///
    /// [`String`] that states why there is no answer.
    pub fn ask(&mut self, request: &[u8]) -> Result<Vec<u8>, String> {
        let request = serde_json::from_slice(request).map_err(|error| format!("a request that is none: {error}"))?;
        if let Request::Begin { flight, unix_ms } = request {
            let [horus, dpr, hold] = &self.firmwares;
            let (Some(horus), Some(dpr)) = (horus.clone(), dpr.clone()) else {
                return Err("the firmwares come first".into());
            };
            let programs = Programs { horus, dpr, hold: hold.clone() };
            let begun = Flight::begin(&flight, &programs, unix_ms.saturating_mul(1_000))?;
            let told = json(begun.wanted());
            self.flight = Some(begun);
            return told;
        }
        let flight = self.flight.as_mut().ok_or("no flight has begun")?;
        match request {
            Request::Begin { .. } => Err("a flight begins once".into()),
            Request::Step => json(&flight.step()?),
            Request::State { drone, list, history, after_ms } => {
                let drone = Some(drone).filter(|drone| !drone.is_empty());
                json(&flight.state(drone.as_deref(), With { list, history }, after_ms.saturating_mul(1_000)))
            }
            Request::Panel { path } => json(&panel(flight, &path)),
            Request::Wires => Ok(flight.wires()),
        }
    }
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, String> {
    serde_json::to_vec(value).map_err(|error| error.to_string())
}

fn panel(flight: &mut Flight, path: &str) -> Answer {
    let (path, query) = path.split_once('?').unwrap_or((path, ""));
    let value = |name: &str| query.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='));
    let panel = flight.panel();
    let told = match path {
        "/things" => json(&panel.buttons()),
        "/state" => json(&panel.state(value("from").and_then(|from| from.parse().ok()).unwrap_or(0))),
        "/break" => {
            let seconds = value("seconds").map(|seconds| seconds.parse().unwrap_or(f64::NAN));
            match panel.ask(value("what").unwrap_or_default(), seconds) {
                Ok(()) => return Answer { status: 204, body: String::new() },
                Err(why) => return Answer { status: 400, body: why.to_string() },
            }
        }
        "/well" => {
            panel.well(value("what"));
            return Answer { status: 204, body: String::new() };
        }
        _ => return Answer { status: 404, body: format!("the panel has no {path}") },
    };
    match told {
        Ok(bytes) => Answer { status: 200, body: String::from_utf8_lossy(&bytes).into_owned() },
        Err(body) => Answer { status: 500, body },
    }
}
