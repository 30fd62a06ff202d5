//! The log events of either board: restarts, findings, and injected faults.

use bench_judge::{Board as Side, Cause, Event, What};
use cortex_m4::Cost;
use emulator_part::Reset;
use st25r3916_model::Chip;

use crate::boards::{Powered, supply};
use crate::faults::PowerFault;
use crate::faults::image::Repair;
use crate::faults::{Episode, Fault, Turn, interrupt_of, is_step};
use emulator_node::{FindingKind, FromOutside, Node};

pub(super) fn injected(now: u64, episode: &Episode) -> What {
    let Episode { until, fault, .. } = episode;
    What::Injected { kind: fault.name(), disturbs: fault.disturbs(), until: (*until).max(now) }
}

/// The cause that the log names for a restart of a part.
pub(super) const fn cause(reset: Reset) -> Cause {
    match reset {
        Reset::PowerOn => Cause::PowerOn,
        Reset::BrownOut => Cause::BrownOut,
        Reset::Pin => Cause::Pin,
        Reset::Watchdog(_) => Cause::Watchdog,
        Reset::Lockup => Cause::Lockup,
        Reset::Software => Cause::Software,
        Reset::Wakeup(_) => Cause::Wakeup,
    }
}

fn no_task(board: Side, task: u8) -> What {
    What::Finding { board, fault: false, text: format!("a fault could not be injected: there is no task {task}") }
}

#[derive(Clone, Debug)]
pub(super) struct BoardEvents {
    side: Side,
    events: Vec<Event>,
    restarts: usize,
    /// Whether the supply supervisor has warned the firmware of a falling supply since the last start. The firmware
    /// must then stop.
    warned: bool,
    /// Whether the board last started without the crystal that its firmware needs.
    without_crystal: bool,
    findings: usize,
    /// For each fault of the program, the original contents of memory, which are restored at the fault's end.
    repairs: Vec<(Fault, Repair)>,
}

impl BoardEvents {
    pub(super) fn new(side: Side) -> Self {
        Self { side, events: vec![], restarts: 0, warned: false, without_crystal: false, findings: 0, repairs: vec![] }
    }

    pub(super) fn note(&mut self, at: u64, what: What) {
        self.events.push(Event { at, what });
    }

    pub(super) fn injected(&mut self, now: u64, episode: &Episode) {
        self.note(now, injected(now, episode));
    }

    pub(super) fn take(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    pub(super) fn watch<B: Powered, C: Cost>(&mut self, node: &mut Node<B, C>) {
        self.note_restarts(node, false);
        self.note_warning(node);
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
                kind => {
                    let fault = matches!(kind, FindingKind::HardFault | FindingKind::Lockup);
                    What::Finding { board, fault, text: finding.to_string() }
                }
            };
            self.events.push(Event { at: finding.at, what });
        }
        self.findings = node.findings().len();
    }

    fn note_restarts<B: Powered, C: Cost>(&mut self, node: &Node<B, C>, asked: bool) {
        for reset in &node.resets()[self.restarts..] {
            let what = What::Reset { board: self.side, cause: cause(reset.cause), asked };
            self.events.push(Event { at: reset.at, what });
            self.warned = false;
            self.without_crystal = B::cannot_start(node.part());
            if self.without_crystal {
                self.events.push(Event { at: reset.at, what: What::Hung { board: self.side } });
            }
        }
        self.restarts = node.resets().len();
    }

    /// Records a hang if the firmware must stop because of a falling supply. The judge treats the stop as a hang.
    fn note_warning<B: Powered, C: Cost>(&mut self, node: &mut Node<B, C>) {
        if node.take_supply_warning() && node.is_powered() && !std::mem::replace(&mut self.warned, true) {
            self.note(node.now(), What::Hung { board: self.side });
            if !node.is_hung() {
                self.note(node.now(), What::Warned { board: self.side });
            }
        }
    }

    /// Begins, changes or ends an episode of a fault of this board: supply, core, front-end chip, memory or program.
    pub(super) fn turn<B: Powered, C: Cost>(&mut self, node: &mut Node<B, C>, turn: &Turn) {
        let now = node.now();
        // Earlier restarts are recorded first, because this episode did not cause them.
        self.watch(node);
        let powered = node.is_powered();
        match turn {
            Turn::Begins(episode) => {
                if let Fault::DeadTask(_, task) = episode.fault {
                    match interrupt_of(self.side, task) {
                        Some(line) if node.switch_interrupt_off(line) => self.injected(now, episode),
                        // The firmware has not enabled the task's interrupt yet. An interrupt that is switched off now
                        // would be enabled during the start, so the task would not be dead.
                        Some(_) => {}
                        None => self.note(now, no_task(self.side, task)),
                    }
                    return;
                }
                if let Fault::Spurious(_, task) = episode.fault {
                    match interrupt_of(self.side, task) {
                        // The interrupt is raised only if the task then begins at once. Otherwise a later call of the
                        // task could hide this additional run.
                        Some(line)
                            if node.is_ready_for_interrupts() && !node.is_hung() && node.raise_interrupt(line) =>
                        {
                            self.injected(now, episode);
                            // The board has to enter its safe state.
                            if is_step(self.side, task) {
                                self.note(now, What::Hung { board: self.side });
                                self.note(now, What::Warned { board: self.side });
                            }
                        }
                        Some(_) => {}
                        None => self.note(now, no_task(self.side, task)),
                    }
                    return;
                }
                self.injected(now, episode);
                match &episode.fault {
                    Fault::Power(_, power) => {
                        power.begin(node);
                        self.note_crystal(now, *power, false);
                    }
                    // A board that has no supply, or already hangs, cannot begin to hang.
                    Fault::Hang(_) if node.is_powered() && !node.is_hung() => {
                        node.hang();
                        self.note(now, What::Hung { board: self.side });
                    }
                    Fault::Hang(_) => {}
                    Fault::Chip(_, chip) => node.board_mut(|board| board.front_end().begin_chip_fault(*chip)),
                    Fault::Flip(_, place) => node.board_mut(|board| board.front_end().flip(now, *place)),
                    Fault::Buffer(buffer) => self.apply(node, now, |node| buffer.begin(node)),
                    Fault::Drift(_, ppb) => B::drift(node, *ppb),
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
                    | Fault::DeadTask(..)
                    | Fault::Spurious(..)
                    | Fault::Hold(_)
                    | Fault::Base(_) => {}
                }
            }
            Turn::Supply { microvolts, seed } => supply(node, *microvolts, *seed),
            Turn::Ends(Episode { fault, .. }) => match fault {
                Fault::Power(_, power) => {
                    power.end(node);
                    self.note_crystal(now, *power, true);
                    // The firmware waits for its crystal. It must not go on when the crystal works again, so the board
                    // is reset.
                    if matches!(power, PowerFault::CrystalDead) && self.without_crystal {
                        node.restart(FromOutside::Pin);
                    }
                }
                Fault::Chip(_, chip) => node.board_mut(|board| board.front_end().end_chip_fault(*chip)),
                Fault::Drift(_, ppb) => B::drift(node, -ppb),
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
        if node.is_powered() != powered {
            self.note(now, What::Power { board: self.side, on: !powered });
        }
        self.note_restarts(node, true);
        self.note_warning(node);
    }

    fn note_crystal(&mut self, now: u64, fault: PowerFault, works: bool) {
        if fault == PowerFault::CrystalDead {
            self.note(now, What::Crystal { board: self.side, works });
        }
    }

    fn apply<B: Powered, C: Cost>(
        &mut self,
        node: &mut Node<B, C>,
        now: u64,
        act: impl FnOnce(&mut Node<B, C>) -> Result<(), emulator_node::Error>,
    ) {
        if let Err(error) = act(node) {
            self.refused(now, &error);
        }
    }

    fn refused(&mut self, now: u64, error: &emulator_node::Error) {
        let text = format!("a fault could not be injected: {error}");
        self.note(now, What::Finding { board: self.side, fault: false, text });
    }
}
