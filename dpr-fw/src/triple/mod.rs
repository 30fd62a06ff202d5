//! The modified triple buffer (paper, section 2.2 and Figure 6).
//!
//! # Design
//!
//! There are three receive buffers: the RFID side writes one, one is read into the image, one is scrubbed. The roles
//! rotate at each frame, so that *old data can never be read as new*. The compiler enforces these ways between states:
//!
//! ```text
//!            Clean::receive            Filling::received             Received::done
//!   Clean ───────────────────▶ Filling ─────────────────▶ Received ──────────────────▶ Dirty
//!     ▲                          │                                                      ▲ │
//!     │                          └───────────────── Filling::discard ──────────────────┘ │
//!     └──────────────────────────────── Dirty::scrub ────────────────────────────────────┘
//! ```
//!
//! Each state is a type that owns the buffer, and no state can be cloned. So a frame is only received into a buffer of
//! which every bit was just scrubbed, only a received frame can be read, and it can be read only once.
//!
//! [`Rotation`] holds the buffers that wait for a task. Its operations are short enough for a critical section.
//!
//! # Scrub
//!
//! The paper fills with 0x00 or 0xFF. This firmware fills with both in turn and reads the buffer back each time, so a
//! scrub also finds stuck bits. A scrub ends with 0x00, which no CRC with initial value 0xFFFFFFFF accepts.
//!
//! # Buffers out of use
//!
//! A buffer in which the scrub task finds a stuck bit ([`Faulty`]) is taken out of use until the next start, and
//! dropped, so that no code can use it any more. [`RECEIVE_LEAST`] receive buffers and [`IMAGES_LEAST`] images stay in
//! use even if they are faulty: an object that a stuck bit changes is rejected by its CRC. In either case Link-Status
//! shows the fault, and the buffers out of use are counted
//! ([`Telemetry::buffers_out_of_use`](crate::telemetry::Telemetry::buffers_out_of_use)).
//!
//! A task that has to scrub a buffer itself, because no clean one is left, uses the buffer even if it is faulty.
//!
//! # Flipped bits
//!
//! A buffer is a reference, and a bit of its address may flip in RAM. So each state also holds the complement of the
//! address, and compares both before the memory is written, read or scrubbed. If they differ, the DPR stops.
//!
//! # Every order
//!
//! `tests/interleavings` runs these types in every order of the tasks, DMA and a bit that gets stuck
//! (`docs/decisions/0012-exhaustive-interleavings.md`).

mod exchange;
mod rotation;
#[cfg(test)]
mod tests;
mod types;

use rtic_core::Mutex;

pub use exchange::{Blank, Exchange, IMAGES, IMAGES_LEAST};
pub use rotation::{Rotated, Rotation, RECEIVE_BUFFERS, RECEIVE_LEAST};
pub use types::{Clean, Dirty, Faulty, Filling, Memory, Received, Scrubbed};

/// The result of a scrub.
pub type Outcome<B> = Result<Clean<B>, Faulty<B>>;

/// A set of buffers, of which some wait for a scrub.
pub trait Scrubbable {
    /// The type of the buffers in the set.
    type Buffer: Memory;

    /// Returns the buffer that has waited longest to be scrubbed.
    fn take_dirty(&mut self) -> Option<Dirty<Self::Buffer>>;
    /// Takes back a buffer after its scrub, unless the buffer has to be taken out of use. Returns the result of the
    /// scrub.
    fn scrubbed(&mut self, outcome: Outcome<Self::Buffer>) -> Scrubbed;
}

/// Scrubs every buffer that waits. The lock on `buffers` is held only while a buffer is taken or put back.
pub fn scrub_waiting<S: Scrubbable>(mut buffers: impl Mutex<T = S>) -> Scrubbed {
    let mut all = Scrubbed::default();
    // Not covered: only this line, on the path on which `Exchange::take_dirty` gives no buffer because the least number
    // is in use: there the compiler asks once more whether it gave one.
    while let Some(dirty) = buffers.lock(Scrubbable::take_dirty) {
        let outcome = dirty.scrub();
        all += buffers.lock(|buffers| buffers.scrubbed(outcome));
    }
    all
}

/// The number of buffers in use out of `OF`. At least `LEAST` of them stay in use, however faulty they are.
#[derive(Debug)]
pub(crate) struct InUse<const OF: u32, const LEAST: u32>(u32);

impl<const OF: u32, const LEAST: u32> InUse<OF, LEAST> {
    pub(crate) const ALL: Self = Self(OF);

    fn out_of_use(&self) -> u32 {
        OF - self.0
    }

    fn is_least(&self) -> bool {
        self.0 <= LEAST
    }

    /// Counts a scrub, and returns its result with the buffer. A faulty buffer is not returned if more than `LEAST` are
    /// in use.
    pub(crate) fn admit<B>(&mut self, outcome: Outcome<B>) -> (Option<Clean<B>>, Scrubbed) {
        match outcome {
            Err(faulty) if !self.is_least() => {
                self.0 -= 1;
                (None, Scrubbed { buffers: 1, stuck_bits: faulty.stuck_bits(), out_of_use: 1 })
            }
            outcome => {
                let (clean, found) = keep(outcome);
                (Some(clean), found)
            }
        }
    }
}

/// Returns the scrubbed buffer even if it is faulty, for a task that has no other buffer left.
pub(crate) fn keep<B>(outcome: Outcome<B>) -> (Clean<B>, Scrubbed) {
    // Not covered: only this line, a faulty buffer that must stay in use, in the copies that meet none: at the start it
    // would be the second faulty buffer of its kind, and later `Exchange` gives none to the scrub when the least number
    // is in use.
    match outcome {
        Ok(clean) => (clean, Scrubbed { buffers: 1, ..Scrubbed::default() }),
        Err(faulty) => {
            let stuck_bits = faulty.stuck_bits();
            (faulty.keep(), Scrubbed { buffers: 1, stuck_bits, out_of_use: 0 })
        }
    }
}

/// The buffers that wait for a task, first the one that has waited longest. There is no index that a flipped bit could
/// move: a place is empty if the address in it is 0.
#[derive(Debug)]
struct Waiting<T, const N: usize>([Option<T>; N]);

impl<T, const N: usize> Waiting<T, N> {
    const NONE: Self = Self([const { None }; N]);

    /// Adds a buffer behind those that wait.
    ///
    /// # Panics
    ///
    /// Every place is taken. This cannot happen without a flipped bit, because each queue has room for all buffers that
    /// can be in it.
    fn push(&mut self, item: T) {
        // Not covered: only this line, the later places of a queue in which fewer buffers ever wait than it has places:
        // one buffer is always written and one is read.
        let place = self.0.iter_mut().find(|place| place.is_none());
        // Not covered: a full queue: each queue has room for all buffers that can be in it, so only a flipped bit fills
        // it.
        *place.expect("each buffer has a place") = Some(item);
    }

    fn pop(&mut self) -> Option<T> {
        let first = self.0.first_mut()?.take();
        for place in 1..N {
            // Not covered: only this line, a second buffer that waits, in the queues that never have one (see `push`).
            if self.0[place].is_some() {
                // Not covered: only this line, a second buffer that waits, as above.
                self.0[place - 1] = self.0[place].take();
            }
        }
        first
    }
}
