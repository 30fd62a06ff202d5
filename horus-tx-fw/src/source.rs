//! What all sources of a receiver's bytes have in common: the ring, the outbox of messages, and the trait
//!
//! # Design
//!
//! A receiver is connected by a UART, by I2C (u-blox calls it DDC) or by SPI; [`Source`] hides the difference. Every
//! source fills a [`Ring`], which the parser reads at its own pace, and takes messages to the receiver from an
//! [`Outbox`], which holds one. Both are made of atomics. So the parser (of low priority) and the source (of higher
//! priority, or a DMA stream) need no lock.

use core::sync::atomic::{AtomicU32, AtomicU8, Ordering};

use crate::ring::Span;

/// The size of each receiver's ring, bytes. The ring holds 11 ms of a UART at 460 800 baud, so half of it lasts for
/// more than the 5 ms that the slowest task between source and parser takes. It also holds twice what I2C and SPI bring
/// in a cycle ([`crate::ddc::MOST`], [`crate::spi::TRANSFER`]).
pub const RING: usize = 512;

const _: () = assert!(RING.is_power_of_two());

/// Decides whether the bytes that are read from a receiver on I2C or SPI are new or have waited.
///
/// A receiver on I2C or SPI keeps its bytes until they are read. A solution's age counts from its arrival. So a
/// solution that waited in the receiver (while its bus was stuck, or HORUS started) would count as new. Therefore all
/// bytes after such a pause are dropped until the receiver has been read empty. On SPI a receiver without data and a
/// line that is stuck high read alike. So the receiver counts as empty when some bytes came and then none; that costs
/// the first message after the pause. On I2C the receiver tells how many bytes wait. A pulse on the line can make that
/// number too small, so two reads in a row must leave none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backlog {
    /// After a pause in reading a receiver, the number of reads in a row that must leave no byte in it.
    proofs: u8,
    /// The number of reads that must still leave the receiver empty. At 0, the bytes that come are new.
    missing: u8,
    ticks: u8,
    /// The number of reads in a row that have left bytes in the receiver.
    behind: u8,
}

impl Backlog {
    /// A receiver's bytes still count as new if at most this number of ticks lies between its last two reads. One read
    /// may fail, or give way to a message.
    pub const TICKS: u8 = 2;
    /// When this many reads in a row have left bytes in the receiver, the bytes that come count as old.
    pub const BEHIND: u8 = 2;

    /// Returns the state before the first read of a receiver. After each pause `proofs` reads in a row must leave no
    /// byte in it.
    #[must_use]
    pub const fn new(proofs: u8) -> Self {
        Self { proofs, missing: proofs, ticks: 0, behind: 0 }
    }

    /// Counts a tick. To be called before the tick's read begins.
    pub fn tick(&mut self) {
        self.ticks = self.ticks.saturating_add(1);
        if self.ticks > Self::TICKS {
            self.missing = self.proofs;
        }
    }

    /// Whether the bytes of the present read are old, and so are to be dropped.
    #[must_use]
    pub const fn is_old(&self) -> bool {
        self.missing > 0
    }

    /// Takes the end of a read, and returns whether to keep its bytes. `is_empty` says that the read left none of the
    /// bytes that waited when it began.
    pub fn read(&mut self, is_empty: bool) -> bool {
        self.ticks = 0;
        self.behind = if is_empty { 0 } else { (self.behind + 1).min(Self::BEHIND) };
        if self.behind == Self::BEHIND || self.is_old() && !is_empty {
            self.missing = self.proofs;
        }
        let keeps = !self.is_old();
        if is_empty {
            self.missing = self.missing.saturating_sub(1);
        }
        keeps
    }
}

/// The longest message that is sent to a receiver, bytes. The longest one of [`crate::configuration`] has 41 bytes.
pub const MESSAGE: usize = 48;

/// The ring of a receiver's bytes. Its one writer is a circular DMA stream ([`Ring::set_written`]) or [`Ring::push`].
#[derive(Debug)]
pub struct Ring {
    bytes: [AtomicU8; RING],
    written: AtomicU32,
    /// The complement of `written`. A flipped bit of either would make old bytes in the ring count as new.
    not_written: AtomicU32,
}

impl Default for Ring {
    fn default() -> Self {
        Self::new()
    }
}

impl Ring {
    /// Returns a ring into which no byte was written.
    #[must_use]
    pub const fn new() -> Self {
        let (written, not_written) = (AtomicU32::new(0), AtomicU32::new(!0));
        Self { bytes: [const { AtomicU8::new(0) }; RING], written, not_written }
    }

    /// Returns the memory to which a DMA stream is to write its [`RING`] bytes.
    #[must_use]
    pub fn memory(&self) -> &[AtomicU8; RING] {
        &self.bytes
    }

    /// Publishes how many bytes a DMA stream has written since the start (wraps).
    pub fn set_written(&self, written: u32) {
        // Not covered: a ring beyond the receivers, as in `hw/buffers.rs`.
        self.written.store(written, Ordering::Release);
        self.not_written.store(!written, Ordering::Release);
    }

    /// Appends bytes to the ring and publishes them.
    pub fn push(&self, bytes: impl IntoIterator<Item = u8>) {
        let before = self.written.load(Ordering::Relaxed);
        let mut written = before;
        for byte in bytes {
            self.bytes[written as usize % RING].store(byte, Ordering::Relaxed);
            written = written.wrapping_add(1);
        }
        // Both numbers move on by the same, so that a bit that has flipped in either stays known.
        let not_written = self.not_written.load(Ordering::Relaxed).wrapping_sub(written.wrapping_sub(before));
        self.written.store(written, Ordering::Release);
        self.not_written.store(not_written, Ordering::Release);
    }

    /// Returns the number of bytes that were written since the start; it wraps. `None` if a bit of it has flipped.
    #[must_use]
    pub fn written(&self) -> Option<u32> {
        unchanged(|| self.written.load(Ordering::Acquire), || self.not_written.load(Ordering::Acquire))
    }

    /// Returns the address of the numbers of bytes.
    #[must_use]
    pub fn address(&self) -> u32 {
        (&raw const self.written).addr() as u32
    }

    /// Copies the bytes of `span` into `into`, as far as they fit, and returns them.
    pub fn copy_out<'a>(&self, span: Span, into: &'a mut [u8]) -> &'a [u8] {
        let len = span.len.min(into.len());
        let (into, _) = into.split_at_mut(len);
        for (to, from) in into.iter_mut().zip(self.bytes.iter().skip(span.start)) {
            *to = from.load(Ordering::Relaxed);
        }
        into
    }
}

/// Returns the number that `number` reads, `None` unless `complement` reads its complement. Both reads are repeated if
/// the number has moved on meanwhile.
fn unchanged(number: impl Fn() -> u32, mut complement: impl FnMut() -> u32) -> Option<u32> {
    loop {
        let first = number();
        let is_sound = complement() == !first;
        // The source may have interrupted this function between both reads.
        if is_sound || number() == first {
            return is_sound.then_some(first);
        }
    }
}

/// The rate at which a UART sends a message. I2C and SPI ignore it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// The rate at which HORUS also receives, [`crate::timing::GNSS_BAUD`].
    Usual,
    /// The rate of a receiver with factory settings, [`crate::timing::FACTORY_BAUD`], at which HORUS cannot receive.
    Factory,
}

/// A message from HORUS to a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message {
    bytes: [u8; MESSAGE],
    len: usize,
    rate: Rate,
}

impl Message {
    /// Makes a message of `bytes`, which is cut after [`MESSAGE`] bytes.
    #[must_use]
    pub fn new(bytes: &[u8], rate: Rate) -> Self {
        let len = bytes.len().min(MESSAGE);
        let mut message = Self { bytes: [0; MESSAGE], len, rate };
        message.bytes[..len].copy_from_slice(&bytes[..len]);
        message
    }

    /// Returns the bytes of the message.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }

    /// Returns the rate at which a UART is to send the message.
    #[must_use]
    pub const fn rate(&self) -> Rate {
        self.rate
    }
}

/// A place for one message on its way from the parser's task to the task of the sources.
#[derive(Debug)]
pub struct Outbox {
    bytes: [AtomicU8; MESSAGE],
    /// The length of the waiting message, with the bit [`FACTORY`] if it goes out at the factory's rate; 0 if no
    /// message waits.
    state: AtomicU32,
}

const FACTORY: u32 = 1 << 31;

impl Default for Outbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Outbox {
    /// Returns an outbox in which no message waits.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [const { AtomicU8::new(0) }; MESSAGE], state: AtomicU32::new(0) }
    }

    /// Puts a message in, and returns whether there was room for it. Only one task may call this method.
    pub fn put(&self, message: &Message) -> bool {
        // Not covered: no room: the next message is made 0.2 s after one that gets no answer, and after the answer to
        // any other. By then the source has taken it.
        if self.state.load(Ordering::Acquire) != 0 {
            return false;
        }
        // Not covered: a message that fills the outbox: none of the five configuration messages does.
        for (to, from) in self.bytes.iter().zip(message.bytes()) {
            to.store(*from, Ordering::Relaxed);
        }
        let rate = if message.rate == Rate::Factory { FACTORY } else { 0 };
        self.state.store(message.len as u32 | rate, Ordering::Release);
        true
    }

    /// Returns the message that waits, which stays in the outbox until [`Outbox::clear`].
    #[must_use]
    pub fn peek(&self) -> Option<Message> {
        let state = self.state.load(Ordering::Acquire);
        if state == 0 {
            return None;
        }
        let mut bytes = [0; MESSAGE];
        for (to, from) in bytes.iter_mut().zip(&self.bytes) {
            *to = from.load(Ordering::Relaxed);
        }
        // Not covered: the rate of the factory on I2C and SPI: only UARTs get a message with it.
        let rate = if state & FACTORY != 0 { Rate::Factory } else { Rate::Usual };
        // Not covered: a length above the outbox, which only a flipped bit of the state brings.
        Some(Message { bytes, len: ((state & !FACTORY) as usize).min(MESSAGE), rate })
    }

    /// Removes the message that waits. Only one task may peek and clear.
    pub fn clear(&self) {
        // Not covered: an outbox that stays full because the source is busy, as in the sources' own `transmit`.
        self.state.store(0, Ordering::Release);
    }
}

/// The hardware of a source that an interrupt comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vector {
    /// The interrupt of the peripheral itself: an event, a byte, an idle line or an error.
    Peripheral,
    /// The interrupt of one of the source's DMA streams.
    Stream,
    /// The interrupt of the source's timer.
    Timer,
}

/// The error of a source that still has to send the previous message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;

/// A source of a receiver's bytes. All calls come from tasks of one priority, and none of them waits.
pub trait Source {
    /// Serves the tick: starts the transfer that is due, and ends as failed a transfer that should have ended by now.
    fn poll(&mut self);

    /// Serves one of the source's interrupts.
    fn interrupt(&mut self, vector: Vector);

    /// Sends a message, now or in the next cycle.
    ///
    /// # Errors
    ///
    /// [`Busy`] while the previous message is being sent. The caller should try again at the next tick.
    fn transmit(&mut self, message: &Message) -> Result<(), Busy>;
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::ring::Reader;
    use std::vec::Vec;

    // Shows REC-13.
    #[test]
    fn a_receiver_is_believed_once_it_was_read_empty_often_enough() {
        let mut backlog = Backlog::new(1);
        assert!(backlog.is_old());
        assert!(!backlog.read(false) && !backlog.read(true), "never read before");
        assert!(!backlog.is_old() && backlog.read(true) && backlog.read(false) && backlog.read(true));
        let mut backlog = Backlog::new(2);
        assert!(!backlog.read(true) && !backlog.read(false) && !backlog.read(true), "not in a row");
        assert!(!backlog.read(true) && backlog.read(true));
    }

    #[test]
    fn two_ticks_may_pass_without_a_read_and_not_three() {
        for (ticks, kept) in [(1, true), (2, true), (3, false), (200, false)] {
            let mut backlog = Backlog::new(1);
            backlog.read(true);
            (0..ticks).for_each(|_| backlog.tick());
            assert_eq!(backlog.read(true), kept, "{ticks}");
            backlog.tick();
            assert!(backlog.read(true), "and empty since");
        }
    }

    #[test]
    fn one_read_may_leave_something_behind_and_not_two() {
        let mut backlog = Backlog::new(1);
        backlog.read(true);
        assert!(backlog.read(false) && !backlog.read(false) && !backlog.read(false) && !backlog.read(true));
        assert!(backlog.read(true));
    }

    #[test]
    fn pushed_bytes_are_read_once_and_in_order_across_the_rings_end() {
        let (ring, mut reader) = (Ring::new(), Reader::new());
        let mut expected = 0_u8;
        for round in 0..40_u32 {
            let count = 1 + round * 37 % 256;
            let first = ring.written().unwrap() as u8;
            ring.push((0..count).map(|step| first.wrapping_add(step as u8)));
            let mut seen = Vec::new();
            while reader.waiting(ring.written().unwrap()) > 0 {
                let mut bytes = [0; 64];
                let span = reader.take(ring.written().unwrap(), RING, 64);
                seen.extend_from_slice(ring.copy_out(span, &mut bytes));
            }
            assert_eq!(seen.len(), count as usize);
            for byte in seen {
                assert_eq!(byte, expected);
                expected = expected.wrapping_add(1);
            }
        }
        assert_eq!(reader.lost(), 0);
    }

    #[test]
    fn bytes_of_a_dma_stream_are_read_once_its_position_is_set() {
        let ring = Ring::new();
        let mut reader = Reader::new();
        ring.memory().iter().zip(1..).take(3).for_each(|(byte, value)| byte.store(value, Ordering::Relaxed));
        assert_eq!(ring.written(), Some(0));
        ring.set_written(3);
        assert_eq!(ring.written(), Some(3));
        let mut into = [0; RING];
        let span = reader.take(ring.written().unwrap(), RING, RING);
        assert_eq!(ring.copy_out(span, &mut into), [1, 2, 3]);
    }

    // Shows SAFE-17.
    #[test]
    fn a_flipped_bit_of_the_number_of_bytes_stays_known() {
        for bit in 0..64 {
            let ring = Ring::new();
            ring.push([1, 2, 3]);
            let number = if bit < 32 { &ring.written } else { &ring.not_written };
            number.fetch_xor(1 << (bit % 32), Ordering::Relaxed);
            assert_eq!(ring.written(), None, "bit {bit}");
            ring.push([4]);
            assert_eq!(ring.written(), None, "bit {bit}");
            // A DMA stream's source keeps the number itself.
            ring.set_written(4);
            assert_eq!(ring.written(), Some(4), "bit {bit}");
        }
    }

    #[test]
    fn bytes_that_come_between_both_reads_are_no_flipped_bit() {
        let number = |flip: u32| {
            let ring = Ring::new();
            ring.not_written.fetch_xor(flip, Ordering::Relaxed);
            let mut bytes = 1..=3;
            let complement = || {
                ring.push(bytes.next());
                ring.not_written.load(Ordering::Relaxed)
            };
            unchanged(|| ring.written.load(Ordering::Relaxed), complement)
        };
        assert_eq!((number(0), number(1 << 5)), (Some(3), None));
    }

    #[test]
    fn a_ring_tells_the_address_of_its_number_of_bytes() {
        let ring = Ring::new();
        assert_eq!(ring.address(), (&raw const ring.written).addr() as u32);
    }

    #[test]
    fn an_outbox_holds_one_message_until_it_is_cleared() {
        let outbox = Outbox::new();
        assert_eq!(outbox.peek(), None);
        let first = Message::new(&[1, 2, 3], Rate::Factory);
        assert!(outbox.put(&first));
        assert!(!outbox.put(&Message::new(&[9], Rate::Usual)), "there is no room for a second one");
        for _ in 0..2 {
            let waiting = outbox.peek().expect("it waits");
            assert_eq!((waiting.bytes(), waiting.rate()), (&[1, 2, 3][..], Rate::Factory));
        }
        outbox.clear();
        assert_eq!(outbox.peek(), None);
        assert!(outbox.put(&Message::new(&[9], Rate::Usual)));
        assert_eq!(
            outbox.peek().map(|message| (message.bytes().to_vec(), message.rate())),
            Some((Vec::from([9]), Rate::Usual))
        );
    }

    #[test]
    fn a_message_that_is_too_long_is_cut_and_never_overruns() {
        let message = Message::new(&[7; MESSAGE + 1], Rate::Usual);
        assert_eq!(message.bytes(), [7; MESSAGE]);
    }
}
