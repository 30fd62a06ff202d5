//! A debugger's watchpoints: data accesses at which the caller wants to stop, any number of them.
//!
//! Watchpoints do not use the comparators of the DWT, which belong to the firmware. Like the comparators (ARM ARM
//! C1.8), they detect loads and stores of instructions, and not the stacking of exceptions, vector fetches or DMA. The
//! instruction completes, and then [`Core::run`] returns [`Exit::Watchpoint`].

use crate::{Bus, Core, Cost, Exit, Width};

/// A range of addresses, and the kinds of access to it that stop the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watchpoint {
    /// The first watched byte.
    pub address: u32,
    /// The number of watched bytes, at least 1.
    pub length: u32,
    /// Whether loads count.
    pub reads: bool,
    /// Whether stores count.
    pub writes: bool,
}

impl Watchpoint {
    fn sees(self, address: u32, bytes: u32, write: bool) -> bool {
        let wanted = if write { self.writes } else { self.reads };
        wanted && address.wrapping_sub(self.address) < self.length
            || wanted && self.address.wrapping_sub(address) < bytes
    }
}

/// An access that a watchpoint detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watched {
    /// The watchpoint that detected it.
    pub watchpoint: Watchpoint,
    /// The first address of the access.
    pub address: u32,
    /// Whether the access was a store.
    pub write: bool,
}

/// The caller's watchpoints.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watchpoints {
    list: Vec<Watchpoint>,
    seen: Option<Watched>,
    limit: u64,
}

impl<C: Cost> Core<C> {
    /// Makes [`Core::run`] return after each instruction that makes an access which `watchpoint` describes.
    pub fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        if !self.watchpoints.list.contains(&watchpoint) {
            self.watchpoints.list.push(watchpoint);
        }
        self.system.set_watching(true);
    }

    /// Removes a watchpoint. Returns whether it was set.
    pub fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        let before = self.watchpoints.list.len();
        self.watchpoints.list.retain(|other| *other != watchpoint);
        self.system.set_watching(!self.watchpoints.list.is_empty());
        self.watchpoints.list.len() < before
    }

    /// Takes the access that led to [`Exit::Watchpoint`], the first one if the instruction made several.
    pub fn take_watched(&mut self) -> Option<Watched> {
        self.watchpoints.seen.take()
    }

    pub(crate) fn watch_for_caller(&mut self, address: u32, write: bool, width: Width) {
        let seen = self.watchpoints.list.iter().find(|watchpoint| watchpoint.sees(address, width.bytes(), write));
        if let Some(&watchpoint) = seen
            && self.watchpoints.seen.is_none()
        {
            self.watchpoints.seen = Some(Watched { watchpoint, address, write });
            self.watchpoints.limit = self.limit;
            self.paused = Some(Exit::Watchpoint);
            self.end_burst();
        }
    }

    /// The value of [`Core::limit`] for a load/store multiple under way. A watchpoint lowers the limit so that the run
    /// stops after the instruction, but the lower limit must not cut the instruction short.
    pub(crate) fn limit_of_multiple<B: Bus>(&self, bus: &mut B) -> u64 {
        match self.paused {
            Some(Exit::Watchpoint) if !bus.signals().is_announced() => self.watchpoints.limit,
            _ => self.limit,
        }
    }
}
