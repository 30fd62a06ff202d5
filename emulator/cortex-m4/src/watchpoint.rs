//! Data accesses that whoever runs the core wants to stop at, as many as it likes: a debugger's watchpoints.
//!
//! They stand beside the comparators of the DWT, which belong to the firmware and to whoever writes its registers. Like
//! those (ARM ARM C1.8), they see the loads and stores of instructions, and neither what exception entry and return
//! move, nor vector fetches, nor what other bus controllers (DMA) do. The instruction completes; [`Core::run`] comes
//! back behind it with [`Exit::Watchpoint`] before anything else happens.

use crate::{Bus, Core, Cost, Exit, Width};

/// Addresses to stop at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watchpoint {
    /// The first byte.
    pub address: u32,
    /// How many bytes, at least 1.
    pub length: u32,
    /// Loads count.
    pub reads: bool,
    /// Stores count.
    pub writes: bool,
}

impl Watchpoint {
    /// Whether an access of `bytes` at `address` touches one of the watched bytes.
    fn sees(self, address: u32, bytes: u32, write: bool) -> bool {
        let wanted = if write { self.writes } else { self.reads };
        wanted && address.wrapping_sub(self.address) < self.length
            || wanted && self.address.wrapping_sub(address) < bytes
    }
}

/// An access that a watchpoint saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watched {
    /// The watchpoint.
    pub watchpoint: Watchpoint,
    /// Where the access began.
    pub address: u32,
    /// It was a store.
    pub write: bool,
}

/// The caller's watchpoints.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watchpoints {
    list: Vec<Watchpoint>,
    /// The first access that one of them saw since it was last taken.
    seen: Option<Watched>,
    /// What `Core::limit` was before it asked to come back behind this instruction.
    limit: u64,
}

impl<C: Cost> Core<C> {
    /// Stops [`Core::run`] behind each instruction that accesses these addresses so.
    pub fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        if !self.watchpoints.list.contains(&watchpoint) {
            self.watchpoints.list.push(watchpoint);
        }
        self.system.set_watching(true);
    }

    /// Takes a watchpoint back. Answers whether it was there.
    pub fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        let before = self.watchpoints.list.len();
        self.watchpoints.list.retain(|other| *other != watchpoint);
        self.system.set_watching(!self.watchpoints.list.is_empty());
        self.watchpoints.list.len() < before
    }

    /// After [`Exit::Watchpoint`]: the access. Of an instruction that made several, the first that counts.
    pub fn take_watched(&mut self) -> Option<Watched> {
        self.watchpoints.seen.take()
    }

    /// A data access took place while something is watched.
    pub(crate) fn watch_for_caller(&mut self, address: u32, write: bool, width: Width) {
        let seen = self.watchpoints.list.iter().find(|watchpoint| watchpoint.sees(address, width.bytes(), write));
        if let Some(&watchpoint) = seen
            && self.watchpoints.seen.is_none()
        {
            self.watchpoints.seen = Some(Watched { watchpoint, address, write });
            self.watchpoints.limit = self.limit;
            self.paused = Some(Exit::Watchpoint);
            self.limit = 0;
        }
    }

    /// [`Core::limit`] as it is to a load/store multiple under way: a watchpoint stops behind the instruction and must
    /// not leave it in the middle, which would take time. What an access set off meanwhile does.
    pub(crate) fn limit_of_multiple<B: Bus>(&self, bus: &mut B) -> u64 {
        match self.paused {
            Some(Exit::Watchpoint) if !bus.signals().is_announced() => self.watchpoints.limit,
            _ => self.limit,
        }
    }
}
