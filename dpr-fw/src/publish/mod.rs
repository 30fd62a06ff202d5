//! Hands a finished image over from the commit task to the SSI, from which the flight controller reads it.
//!
//! # Design
//!
//! The commit task fills an image and publishes it into the [`Mailbox`] ([`Outbox`]). The SSI task, of higher priority,
//! takes the newest image out of the mailbox and lets the peripheral stream it ([`Server`]). The peripheral's semaphore
//! says who owns the buffer of the stream: the processor, or, from a *release* to the end of the next transaction, the
//! SPIS. At that end hardware returns the buffer to the processor (shortcut END to ACQUIRE).
//!
//! **FRESH** rises when the next transaction gets a new image. If that transaction begins while the SSI task exchanges
//! the image, it reads 0xFF throughout. It never gets an older image, for these reasons:
//!
//! - While no transaction is under way, the commit task asks for the semaphore and calls the SSI task. The SSI task
//!   takes the new image, raises FRESH, then releases. A transaction that begins before the release reads 0xFF.
//! - While a transaction is under way, the SSI task takes the newest image before the next one, so the commit task
//!   raises FRESH itself. It masks the SSI task from the check for a transaction until FRESH has risen.
//!
//! **Expiry.** FRESH restarts a timer in hardware. If the timer is not restarted in time, it takes the semaphore from
//! the SPIS without the processor's help (a compare, through PPI to the task ACQUIRE). Every later transaction then
//! reads 0xFF. The SSI task releases an image again only if the image's time is not over. That time can end between
//! check and release. Therefore the timer has a second compare, [`EXPIRY_AGAIN_US`] after the first.
//!
//! **Every order.** `tests/interleavings` runs these types in every order of both tasks, the scrub, DMA, the flight
//! controller and the timer (`docs/decisions/0012-exhaustive-interleavings.md`).
//!
//! **Bounds.** The number of transactions that are granted, and the pause after each ([`ssi`](crate::ssi)), bound how
//! often the SSI task runs. The SSI task waits for the commit task only while the commit task holds the mailbox, which
//! takes as long as moving a few pointers.

mod mailbox;
mod server;
#[cfg(test)]
mod tests;

use core::borrow;

use crate::{triple::Memory, ImageMemory};

pub use mailbox::{Doorbell, Mailbox, Outbox};
pub use server::{Events, Server, Ssi};

/// How long an image can be read after its publication if no other replaces it, µs.
pub const EXPIRY_US: u32 = 25_000;

/// The time from the expiry timer's first compare to its second, µs. The SSI task takes less than 10 µs from the check
/// of the first compare to the release, so it has released the image before the second.
pub const EXPIRY_AGAIN_US: u32 = 20;

/// A buffer for an image.
pub trait ImageBuffer: Memory + borrow::BorrowMut<ImageMemory> {}
impl<B: Memory + borrow::BorrowMut<ImageMemory>> ImageBuffer for B {}
