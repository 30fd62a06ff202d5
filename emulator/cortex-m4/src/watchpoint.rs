//! A debugger's watchpoints: data accesses at which the caller wants to stop, any number of them.
//!
//! Watchpoints are independent of the comparators of the DWT, which belong to the firmware and to whoever writes the
//! DWT's registers. Like the comparators (ARM ARM C1.8), watchpoints detect the loads and stores of instructions. They
//! do not detect the stacking and unstacking of exceptions, vector fetches, or accesses of other bus controllers (DMA).
//! The instruction completes, and [`Core::run`] then returns [`Exit::Watchpoint`] before anything else happens.

use crate::{Bus, Core, Cost, Exit, Width};

/// A range of addresses, with the kinds of access to it at which to stop.
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
    /// Whether an access of `bytes` bytes at `address` touches one of the watched bytes and is of a kind that counts.
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
    /// The first access that a watchpoint detected since the last call of [`Core::take_watched`].
    seen: Option<Watched>,
    /// The value of `Core::limit` before the watchpoint lowered it to stop the run after this instruction.
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

    /// Takes the access that led to [`Exit::Watchpoint`]. If the instruction made several such accesses, it is the
    /// first.
    pub fn take_watched(&mut self) -> Option<Watched> {
        self.watchpoints.seen.take()
    }

    /// Checks a data access against the caller's watchpoints.
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

    /// The value of [`Core::limit`] that holds for a load/store multiple under way. A watchpoint stops the run after
    /// the instruction, and must not interrupt the instruction in the middle, which would cost time. A change that an
    /// access announced meanwhile may interrupt it.
    pub(crate) fn limit_of_multiple<B: Bus>(&self, bus: &mut B) -> u64 {
        match self.paused {
            Some(Exit::Watchpoint) if !bus.signals().is_announced() => self.watchpoints.limit,
            _ => self.limit,
        }
    }
}
