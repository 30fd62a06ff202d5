//! Keeps what a firmware has done until a line of the script expects it.

use std::collections::{BTreeMap, VecDeque};

use emulator_node::{AnyRun, Event};
use emulator_part::{Pin, Pins};

use super::line::{Deed, quoted};
use crate::output::milliseconds;

#[derive(Default)]
struct Sent {
    bytes: Vec<u8>,
    /// The instant of each byte that the firmware sent, ns.
    at: Vec<u64>,
    /// The number of sent bytes that were already searched for the text of the script's present line.
    searched: usize,
}

#[derive(Default)]
pub(super) struct Heard {
    lines: VecDeque<(u64, String)>,
    sent: BTreeMap<Pin, Sent>,
    /// For each watched pin its level, and its edges: each with the instant (ns), and the level from then on.
    pins: BTreeMap<Pin, (bool, VecDeque<(u64, bool)>)>,
    restarts: VecDeque<u64>,
}

/// The greatest number of unexpected bytes that a message shows.
const SHOWN_BYTES: usize = 80;
const SHOWN_LINES: usize = 3;

impl Heard {
    pub(super) fn watch(&mut self, run: &mut dyn AnyRun, pin: Pin) {
        run.watch(pin);
        self.pins.entry(pin).or_insert_with(|| (run.node().pin(pin), VecDeque::new()));
    }

    /// Begins a line of the script. If the line expects a text, the search for it starts from the first byte again.
    pub(super) fn begin_line(&mut self) {
        self.sent.values_mut().for_each(|sent| sent.searched = 0);
    }

    pub(super) fn forget_edges(&mut self) {
        self.pins.values_mut().for_each(|(_, edges)| edges.clear());
    }

    pub(super) fn take(&mut self, event: &Event<'_>) {
        match event {
            Event::Line(line) => self.lines.push_back((line.at, line.text.clone())),
            Event::Byte(sent) => {
                let to = self.sent.entry(sent.pin).or_default();
                to.bytes.push(sent.byte);
                to.at.push(sent.at);
            }
            Event::Pin(edge) => {
                if let Some((level, edges)) = self.pins.get_mut(&edge.pin)
                    && std::mem::replace(level, edge.pad.level()) != edge.pad.level()
                {
                    edges.push_back((edge.at, *level));
                }
            }
            Event::Reset(reset) => self.restarts.push_back(reset.at),
            Event::Driven(_) | Event::Finding(_) => {}
        }
    }

    /// Returns the instant (ns) at which the firmware carried out the action `deed`; `None` if it has not. Later
    /// searches begin after that instant.
    pub(super) fn find(&mut self, deed: &Deed, run: &mut dyn AnyRun) -> Option<u64> {
        match deed {
            Deed::Edge(pin, level) => {
                let (_, edges) = self.pins.get_mut(pin)?;
                let place = edges.iter().position(|(_, to)| to == level)?;
                edges.drain(..=place).next_back().map(|(at, _)| at)
            }
            Deed::Sent(pin, text) => {
                let sent = self.sent.get_mut(pin)?;
                let from = sent.searched.saturating_sub(text.len() - 1);
                sent.searched = sent.bytes.len();
                let place = sent.bytes.get(from..)?.windows(text.len()).position(|bytes| bytes == text)?;
                let end = from + place + text.len();
                sent.searched = 0;
                sent.bytes.drain(..end);
                sent.at.drain(..end).next_back()
            }
            Deed::Logged(text) => {
                let place = self.lines.iter().position(|(_, line)| line.contains(text.as_str()))?;
                self.lines.drain(..=place).next_back().map(|(at, _)| at)
            }
            Deed::Exit(status) => (run.node().exit_status()? == *status).then(|| run.node().now()),
            Deed::Restart => self.restarts.pop_front(),
        }
    }

    /// Returns, for a message, what the firmware did in place of `deed`.
    pub(super) fn came(&self, deed: &Deed, run: &mut dyn AnyRun) -> String {
        match deed {
            Deed::Edge(pin, _) => {
                let name = run.node().pins().name(*pin);
                let edge = self.pins.get(pin).and_then(|(_, edges)| edges.back());
                match edge {
                    Some((at, true)) => format!("{name} only rose, at {:.6} ms", milliseconds(*at)),
                    Some((at, false)) => format!("{name} only fell, at {:.6} ms", milliseconds(*at)),
                    None => format!("{name} stayed {}", if run.node().pin(*pin) { "high" } else { "low" }),
                }
            }
            Deed::Sent(pin, _) => match self.sent.get(pin).map_or(&[][..], |sent| &sent.bytes) {
                [] => "nothing came".to_owned(),
                bytes => {
                    let from = bytes.len().saturating_sub(SHOWN_BYTES);
                    format!("{}{} came", if from > 0 { "at the end " } else { "" }, quoted(&bytes[from..]))
                }
            },
            Deed::Logged(_) if self.lines.is_empty() => "nothing came".to_owned(),
            Deed::Logged(_) => {
                let from = self.lines.len().saturating_sub(SHOWN_LINES);
                let lines: Vec<_> = self.lines.range(from..).map(|(_, line)| quoted(line.as_bytes())).collect();
                format!("{}{} came", if from > 0 { "at the end " } else { "" }, lines.join(", "))
            }
            Deed::Exit(_) | Deed::Restart => "it did not come".to_owned(),
        }
    }

    /// Returns, for a message, why the firmware does nothing more, or what it is doing.
    pub(super) fn end(&self, now: u64, doing: &str) -> String {
        format!("at {:.6} ms {doing}", milliseconds(now))
    }
}

impl Deed {
    /// Returns the action in words that can follow "expected".
    pub(super) fn shown(&self, pins: &Pins) -> String {
        match self {
            Self::Edge(pin, true) => format!("{} to rise", pins.name(*pin)),
            Self::Edge(pin, false) => format!("{} to fall", pins.name(*pin)),
            Self::Sent(pin, text) => format!("{} from {}", quoted(text), pins.name(*pin)),
            Self::Logged(text) => format!("{} in the log", quoted(text.as_bytes())),
            Self::Exit(status) => format!("exit status {status}"),
            Self::Restart => "a restart".to_owned(),
        }
    }
}
