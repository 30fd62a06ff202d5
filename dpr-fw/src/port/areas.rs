//! Receive areas: what a transaction brought in, on its way from the SSI task to the port task.
//!
//! # Design
//!
//! Three areas rotate as the receive buffers of the RFID side do, with the same types ([`triple`](crate::triple)): one
//! is lent to the peripheral, one waits or is being judged, one is clean. An area is scrubbed between two transactions,
//! so what one brought can never be read as brought by another; besides, no more is read of an area than the peripheral
//! says has come in.
//!
//! The SSI task has the highest priority, and a flight controller waits for it. So it moves an area by two queues that
//! need no lock, has the next area at hand before a transaction ends, uses the queues when the flight controller waits
//! no more, and never scrubs. If no clean area is at hand, because two transactions wait to be judged, the one
//! that has just ended is dropped and its area is wiped and lent again: a flight controller that writes faster than the
//! port task runs loses what it writes, and delays nobody.

use heapless::spsc::{Consumer, Producer, Queue};

use super::IDLE;
use crate::{
    ssi::{Asked, ReceiveArea},
    triple::{keep, Clean, Dirty, Filling, InUse, Memory, Received, Scrubbed},
};

/// Receive areas: one is lent to the peripheral, one is judged, one is clean.
pub const AREAS: usize = 3;
/// So many stay in use, however faulty they are: one is lent while the other is judged.
pub const AREAS_LEAST: usize = 2;

/// What is known of a transaction besides the bytes that it brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transaction {
    /// What it asked for.
    pub asked: Asked,
    /// Bytes that came in, at most [`RECEIVE_BYTES`](crate::ssi::RECEIVE_BYTES).
    pub bytes: usize,
}

/// An area that holds what a transaction brought.
pub type Brought<B> = Received<B, Transaction>;

/// The queues between the two tasks.
#[derive(Debug)]
pub struct Areas<B> {
    // A queue of heapless holds one less than its length.
    brought: Queue<Brought<B>, AREAS>,
    clean: Queue<Clean<B>, AREAS>,
}

impl<B> Default for Areas<B> {
    fn default() -> Self {
        Self::new()
    }
}

impl<B> Areas<B> {
    /// No area.
    #[must_use]
    pub const fn new() -> Self {
        Self { brought: Queue::new(), clean: Queue::new() }
    }
}

impl<B: Memory> Areas<B> {
    /// Scrubs the areas and gives the ends of the queues: the area to receive into first, the SSI task's end, the port
    /// task's end, and what the scrubs found.
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

/// The SSI task's end.
pub struct SsiEnd<'q, B> {
    brought: Producer<'q, Brought<B>>,
    clean: Consumer<'q, Clean<B>>,
    /// The area for the next transaction.
    next: Option<Clean<B>>,
    /// What is to be passed on.
    waits: Option<Brought<B>>,
}

/// What became of a transaction at [`SsiEnd::hand_over`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandedOver {
    /// It waits for the port task, which has to be called.
    Waits,
    /// It brought no byte.
    Empty,
    /// Two transactions wait already: it was dropped, and so was the object that it brought.
    Dropped,
    /// Two transactions wait already: it was dropped, but its object was idle by its identifier and status.
    DroppedIdle,
}

impl<B: Memory + core::borrow::BorrowMut<ReceiveArea>> SsiEnd<'_, B> {
    /// A transaction is over, and what it brought is in `area`. Gives the area for the next one. [`SsiEnd::pass_on`]
    /// comes before the next call.
    pub fn hand_over(&mut self, mut area: Filling<B>, transaction: Transaction) -> (Filling<B>, HandedOver) {
        if transaction.bytes == 0 {
            return (area, HandedOver::Empty);
        }
        if let Some(clean) = self.next.take().or_else(|| self.clean.dequeue()) {
            self.waits = Some(area.received(transaction));
            return (clean.receive(), HandedOver::Waits);
        }
        let memory: &mut ReceiveArea = area.memory().borrow_mut();
        // The object's identifier and status are the area's fourth word.
        let idle = transaction.bytes < HEADER_END || IDLE.contains(&memory[HEADER_END / 4 - 1]);
        memory.fill(0);
        (area, if idle { HandedOver::DroppedIdle } else { HandedOver::Dropped })
    }

    /// Passes on what was handed over, and gets the next area ready. Tells whether the port task has to be called.
    pub fn pass_on(&mut self) -> bool {
        if self.next.is_none() {
            self.next = self.clean.dequeue();
        }
        let Some(waits) = self.waits.take() else { return false };
        put(&mut self.brought, waits);
        true
    }
}

/// Where the object's timestamp, identifier and status end in an area.
const HEADER_END: usize = profile::ssi::REQUEST_SIZE + 8;

/// The port task's end.
pub struct PortEnd<'q, B> {
    brought: Consumer<'q, Brought<B>>,
    clean: Producer<'q, Clean<B>>,
    in_use: InUse<{ AREAS as u32 }, { AREAS_LEAST as u32 }>,
}

impl<B: Memory> PortEnd<'_, B> {
    /// The transaction that has waited longest.
    pub fn take(&mut self) -> Option<Brought<B>> {
        self.brought.dequeue()
    }

    /// It has been judged: its area is scrubbed, and waits for the SSI task unless it is taken out of use. Tells what
    /// came of the scrub.
    pub fn done(&mut self, brought: Brought<B>) -> Scrubbed {
        let (clean, found) = self.in_use.admit(brought.done().scrub());
        if let Some(clean) = clean {
            put(&mut self.clean, clean);
        }
        found
    }
}

/// There are three areas, of which one is always lent to the peripheral, so no queue ever holds more than two.
fn put<T>(queue: &mut Producer<'_, T>, area: T) {
    assert!(queue.enqueue(area).is_ok(), "three areas, of which one is lent");
}
