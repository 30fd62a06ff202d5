//! What either board tells the log: restarts, findings, and what goes wrong there on purpose.

use bench_judge::{Board as Side, Event, What};
use cortex_m4::Cost;
use st25r3916_model::Chip;

use crate::faults::image::Repair;
use crate::faults::power::Powered;
use crate::faults::{Episode, Fault, PowerFault, Turn};
use crate::node::{FindingKind, Node};

/// Events of one board since they were last taken.
#[derive(Clone, Debug)]
pub(super) struct BoardEvents {
    side: Side,
    events: Vec<Event>,
    /// How many of the node's restarts are in the log.
    restarts: usize,
    /// How many of its findings are.
    findings: usize,
    /// What is to be put back at the end of an episode that damaged the image.
    repairs: Vec<(Fault, Repair)>,
}

impl BoardEvents {
    pub(super) fn new(side: Side) -> Self {
        Self { side, events: vec![], restarts: 0, findings: 0, repairs: vec![] }
    }

    /// Something happened at `at` (ns).
    pub(super) fn note(&mut self, at: u64, what: What) {
        self.events.push(Event { at, what });
    }

    /// What the bench does wrong on purpose from `now` (ns) on.
    pub(super) fn injected(&mut self, now: u64, episode: &Episode) {
        let until = episode.until.max(now);
        self.note(now, What::Injected { kind: episode.fault.name(), until });
    }

    /// What is not in the log yet.
    pub(super) fn take(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    /// Restarts that nobody asked for, and findings, since the last look.
    pub(super) fn watch<B: Powered, C: Cost>(&mut self, node: &mut Node<B, C>) {
        self.note_restarts(node, false);
        if !node.board().chip().reports().is_empty() {
            for misuse in node.board_mut(|board| board.front_end().with(Chip::take_reports)) {
                let what = What::Misuse { board: self.side, text: misuse.to_string() };
                self.events.push(Event { at: misuse.first_ns, what });
            }
        }
        for finding in &node.findings()[self.findings..] {
            let board = self.side;
            let what = match finding.kind {
                FindingKind::Late => What::Late { board, text: finding.text.clone() },
                _ => What::Finding { board, text: finding.to_string() },
            };
            self.events.push(Event { at: finding.at, what });
        }
        self.findings = node.findings().len();
    }

    fn note_restarts<B: Powered, C: Cost>(&mut self, node: &Node<B, C>, asked: bool) {
        for reset in &node.resets()[self.restarts..] {
            let what = What::Reset { board: self.side, cause: format!("{:?}", reset.cause), asked };
            self.events.push(Event { at: reset.at, what });
        }
        self.restarts = node.resets().len();
    }

    /// An episode of this board's supply, bits or image begins or ends.
    pub(super) fn turn<B: Powered, C: Cost>(&mut self, node: &mut Node<B, C>, turn: &Turn) {
        let now = node.now();
        // Restarts of before were not asked for.
        self.watch(node);
        match turn {
            Turn::Begins(episode) => {
                self.injected(now, episode);
                match &episode.fault {
                    Fault::Power(_, power) => {
                        if matches!(power, PowerFault::Off(_)) {
                            self.note(now, What::Power { board: self.side, on: false });
                        }
                        power.begin(node);
                    }
                    // Without a supply nothing hangs, and what hangs already has done so for longer.
                    Fault::Hang(_) if node.is_powered() && !node.is_hung() => {
                        node.hang();
                        self.note(now, What::Hung { board: self.side });
                    }
                    Fault::Hang(_) => {}
                    Fault::Chip(_, chip) => node.board_mut(|board| board.front_end().begin_chip_fault(*chip)),
                    Fault::Buffer(buffer) => self.apply(node, now, |node| buffer.begin(node)),
                    Fault::Upset(_, upset) => self.apply(node, now, |node| upset.apply(node)),
                    Fault::Image(_, image) => match image.apply(node) {
                        Ok(repair) => self.repairs.push((episode.fault.clone(), repair)),
                        Err(error) => self.refused(now, &error),
                    },
                    Fault::Air(_)
                    | Fault::Receiver(..)
                    | Fault::Input(..)
                    | Fault::FrontEnd(_)
                    | Fault::FlightController(_)
                    | Fault::Wire(_)
                    | Fault::Base(_) => {}
                }
            }
            Turn::Ends(Episode { fault, .. }) => match fault {
                Fault::Power(_, power) => {
                    if matches!(power, PowerFault::Off(_)) {
                        self.note(now, What::Power { board: self.side, on: true });
                    }
                    power.end(node);
                }
                Fault::Chip(_, chip) => node.board_mut(|board| board.front_end().end_chip_fault(*chip)),
                Fault::Buffer(buffer) => buffer.end(node),
                Fault::Image(..) => {
                    if let Some(place) = self.repairs.iter().position(|(of, _)| of == fault) {
                        let (_, repair) = self.repairs.remove(place);
                        self.apply(node, now, |node| repair.mend(node));
                    }
                }
                _ => {}
            },
        }
        self.note_restarts(node, true);
    }

    fn apply<B: Powered, C: Cost>(
        &mut self,
        node: &mut Node<B, C>,
        now: u64,
        act: impl FnOnce(&mut Node<B, C>) -> Result<(), crate::node::Error>,
    ) {
        if let Err(error) = act(node) {
            self.refused(now, &error);
        }
    }

    /// A fault that cannot be injected must not look like one that was.
    fn refused(&mut self, now: u64, error: &crate::node::Error) {
        let text = format!("a fault could not be injected: {error}");
        self.note(now, What::Finding { board: self.side, text });
    }
}
