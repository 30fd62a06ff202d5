//! Receive areas: buffers that carry the bytes that a transaction brought from the SSI task to the port task.
//!
//! # Design
//!
//! Three areas rotate as the receive buffers of the RFID side do, with the same types ([`triple`](crate::triple)): one
//! is lent to the peripheral, one waits or is being judged, one is clean. An area is scrubbed between two transactions,
//! so the bytes of one are never taken for those of another.
//!
//! The SSI task has the highest priority, and a flight controller waits for it. So it moves areas through two queues
//! that need no lock, gets the next area before a transaction ends, uses the queues only when the flight controller no
//! longer waits, and never scrubs. If no clean area is left, because two transactions wait to be judged, the new
//! transaction is dropped and its area is zeroed and lent again. A flight controller that writes faster than the port
//! task runs loses what it writes, and delays no task.

use heapless::spsc::{Consumer, Producer, Queue};

use super::IDLE;
use crate::{
    ssi::{Asked, ReceiveArea},
    triple::{keep, Clean, Dirty, Filling, InUse, Memory, Received, Scrubbed},
};

/// The number of receive areas: one is lent to the peripheral, one is judged, one is clean.
pub const AREAS: usize = 3;
/// The number of areas that stay in use, however faulty they are: one is lent to the peripheral while the other is
/// judged.
pub const AREAS_LEAST: usize = 2;

/// What is known of a transaction besides its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transaction {
    /// The transaction's request.
    pub asked: Asked,
    /// The number of bytes that came in, at most [`RECEIVE_BYTES`](crate::ssi::RECEIVE_BYTES).
    pub bytes: usize,
}

/// A receive area with the bytes that a transaction brought.
pub type Brought<B> = Received<B, Transaction>;

/// The queues between the SSI task and the port task.
#[derive(Debug)]
pub struct Areas<B> {
    // A queue of the crate heapless holds one item less than its length.
    brought: Queue<Brought<B>, AREAS>,
    clean: Queue<Clean<B>, AREAS>,
}

impl<B> Default for Areas<B> {
    fn default() -> Self {
        Self::new()
    }
}

impl<B> Areas<B> {
    /// Returns queues that hold no area.
    #[must_use]
    pub const fn new() -> Self {
        Self { brought: Queue::new(), clean: Queue::new() }
    }
}

impl<B: Memory> Areas<B> {
    /// Scrubs the areas. Returns the first area to receive into, both ends of the queues, and the scrubs' result.
    pub fn split(&mut self, areas: [B; AREAS]) -> (Filling<B>, SsiEnd<'_, B>, PortEnd<'_, B>, Scrubbed) {
        let mut found = Scrubbed::default();
        let [first, rest @ ..] = areas.map(|area| {
            let (clean, of_area) = keep(Dirty::new(area).scrub());
            found += of_area;
            clean
        });
        let (to_port, brought) = self.brought.split();
        let (mut to_ssi, clean) = self.clean.split();
        for area in rest {
            put(&mut to_ssi, area);
        }
        (
            first.receive(),
            SsiEnd { brought: to_port, clean, next: None, waits: None },
            PortEnd { brought, clean: to_ssi, in_use: InUse::ALL },
            found,
        )
    }
}

/// The SSI task's end of the queues.
pub struct SsiEnd<'q, B> {
    brought: Producer<'q, Brought<B>>,
    clean: Consumer<'q, Clean<B>>,
    /// The area for the next transaction, if a clean one was in the queue.
    next: Option<Clean<B>>,
    /// The area with the last transaction's bytes, which is still to be passed on to the port task.
    waits: Option<Brought<B>>,
}

/// What happens to a transaction in [`SsiEnd::hand_over`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandedOver {
    /// The transaction waits for the port task, which the caller has to call.
    Waits,
    /// The transaction brought no byte.
    Empty,
    /// The transaction was dropped with the object that it brought, since two other transactions wait already.
    Dropped,
    /// The transaction was dropped, since two other transactions wait already. It brought no object, since the line was
    /// idle.
    DroppedIdle,
}

impl<B: Memory + core::borrow::BorrowMut<ReceiveArea>> SsiEnd<'_, B> {
    /// Takes the area that an ended transaction has filled, and returns the area for the next transaction.
    /// [`SsiEnd::pass_on`] must be called before the next call.
    pub fn hand_over(&mut self, mut area: Filling<B>, transaction: Transaction) -> (Filling<B>, HandedOver) {
        if transaction.bytes == 0 {
            return (area, HandedOver::Empty);
        }
        if let Some(clean) = self.next.take().or_else(|| self.clean.dequeue()) {
            self.waits = Some(area.received(transaction));
            return (clean.receive(), HandedOver::Waits);
        }
        let memory: &mut ReceiveArea = area.memory().borrow_mut();
        // The fourth word of an area holds the object's identifier and status.
        let idle = transaction.bytes < HEADER_END || IDLE.contains(&memory[HEADER_END / 4 - 1]);
        memory.fill(0);
        (area, if idle { HandedOver::DroppedIdle } else { HandedOver::Dropped })
    }

    /// Passes the last transaction's area on, and gets the next area ready. Returns whether to call the port task.
    pub fn pass_on(&mut self) -> bool {
        if self.next.is_none() {
            self.next = self.clean.dequeue();
        }
        let Some(waits) = self.waits.take() else { return false };
        put(&mut self.brought, waits);
        true
    }
}

/// The offset, bytes, in an area at which the object's timestamp, identifier and status end.
const HEADER_END: usize = profile::ssi::REQUEST_SIZE + 8;

/// The port task's end of the queues.
pub struct PortEnd<'q, B> {
    brought: Consumer<'q, Brought<B>>,
    clean: Producer<'q, Clean<B>>,
    in_use: InUse<{ AREAS as u32 }, { AREAS_LEAST as u32 }>,
}

impl<B: Memory> PortEnd<'_, B> {
    /// Returns the transaction that has waited longest.
    pub fn take(&mut self) -> Option<Brought<B>> {
        self.brought.dequeue()
    }

    /// Scrubs the area of a judged transaction, which then waits for the SSI task unless it is taken out of use.
    pub fn done(&mut self, brought: Brought<B>) -> Scrubbed {
        let (clean, found) = self.in_use.admit(brought.done().scrub());
        if let Some(clean) = clean {
            put(&mut self.clean, clean);
        }
        found
    }
}

/// Puts an area into a queue with room for two. The queue never overflows, since one of the three areas is always lent.
fn put<T>(queue: &mut Producer<'_, T>, area: T) {
    assert!(queue.enqueue(area).is_ok(), "three areas, of which one is lent");
}
