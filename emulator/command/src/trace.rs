//! Writes the pins and the handlers of a run to a trace.

use std::collections::BTreeMap;
use std::path::Path;

use emulator_node::{AnyNode, Event};
use emulator_part::{Pad, Pin};
use emulator_trace::{Error, Id, Signal, TaskWatch, Trace, Value, task_signals};

/// The length of the longest UART frame whose bits reach the trace in time, ns: ten bits at 100 baud. The bits are
/// known only at the frame's end.
const LATEST: u64 = 100_000_000;

/// A trace of a microcontroller that runs alone.
pub(crate) struct PartTrace {
    trace: Trace,
    tasks: TaskWatch,
    /// For each pin its signal, the level that the part drives, and the level that is driven from outside.
    pins: BTreeMap<Pin, (Id, Value, Value)>,
}

impl PartTrace {
    /// # Errors
    ///
    /// The errors are those of [`Trace::create`].
    pub(crate) fn create(path: &Path, node: &mut dyn AnyNode) -> Result<Self, Error> {
        let names = node.pins();
        let tasks = TaskWatch::all(node);
        let pin = |pin| Signal { group: vec!["pins"], name: names.name(pin).replace('.', "_"), bits: 1, start: None };
        let signals = names.all().map(pin).chain(task_signals("core", tasks.tasks())).collect();
        let pins = names.all().enumerate().map(|(place, pin)| (pin, (Id(place), None, None))).collect();
        Ok(Self { trace: Trace::create(path, signals)?, tasks, pins })
    }

    pub(crate) fn take(&mut self, event: &Event<'_>) {
        let (at, pin) = match event {
            Event::Pin(edge) => (edge.at, edge.pin),
            Event::Driven(edge) => (edge.at, edge.pin),
            _ => return,
        };
        let Some((id, part, outside)) = self.pins.get_mut(&pin) else { return };
        match event {
            Event::Pin(edge) => *part = (edge.pad != Pad::Floating).then(|| edge.pad.level().into()),
            Event::Driven(edge) => *outside = edge.level.map(u64::from),
            _ => {}
        }
        self.trace.set(at, *id, outside.or(*part));
    }

    /// Reads which interrupt handlers the core has executed since the last call.
    ///
    /// # Errors
    ///
    /// The errors are those of [`Trace::flush_before`].
    pub(crate) fn go_on(&mut self, node: &mut dyn AnyNode) -> Result<(), Error> {
        let (first, count) = (self.pins.len(), self.tasks.tasks().len());
        for (at, signal, value) in self.tasks.take(node) {
            self.trace.set(at, Id(first + signal.place(count)), Some(value));
        }
        self.trace.flush_before(node.now().saturating_sub(LATEST))
    }

    /// # Errors
    ///
    /// The errors are those of [`Trace::finish`].
    pub(crate) fn finish(self) -> Result<(), Error> {
        self.trace.finish()
    }
}
