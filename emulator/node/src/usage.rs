//! How long a core was awake, and the changes of its interrupt lines.

use cortex_m4::Cost;

use super::{Board, Node};

/// A change of the level of a watched interrupt line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineEdge {
    /// The instant at which the model changed the line, in virtual nanoseconds.
    pub at: u64,
    /// The number of the line, as the vector table numbers interrupts.
    pub line: u16,
    /// Whether the line rose.
    pub high: bool,
}

/// The times for which a core was awake and for which it was observed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// The virtual nanoseconds in which the core executed instructions.
    pub awake: u64,
    /// The virtual nanoseconds in all, awake or asleep.
    pub total: u64,
}

impl Usage {
    /// The processor load, 0 to 1.
    #[must_use]
    pub fn load(self) -> f64 {
        if self.total == 0 { 0.0 } else { self.awake as f64 / self.total as f64 }
    }

    /// The usage since `before`.
    #[must_use]
    pub fn since(self, before: Self) -> Self {
        Self { awake: self.awake - before.awake, total: self.total - before.total }
    }
}

impl<B: Board, C: Cost> Node<B, C> {
    /// Records every change of the interrupt line `line` from now on, for [`Node::take_edges`].
    pub fn watch_line(&mut self, line: u16) {
        if self.side.watched.iter().all(|&(watched, _)| watched != line) {
            self.side.watched.push((line, false));
        }
    }

    /// Takes the changes of watched lines since the last call, in order.
    pub fn take_edges(&mut self) -> Vec<LineEdge> {
        std::mem::take(&mut self.side.edges)
    }

    /// How long the core was awake since power-on, and the whole time since then.
    #[must_use]
    pub fn usage(&self) -> Usage {
        let (ns, cycles) = self.side.awake;
        let since = (self.core.cycle() - self.core.idle()).saturating_sub(cycles);
        Usage { awake: ns + self.side.scaled(since), total: self.now() }
    }

    /// The number of instructions that the core executed since power-on.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.core.retired()
    }
}
