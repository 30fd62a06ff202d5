//! The receive buffers that wait for a task.

use heapless::Deque;

use super::{keep, put, Clean, Dirty, Filling, InUse, Memory, Outcome, Received, Scrubbable, Scrubbed};

/// Receive buffers: one is written, one is read, one is scrubbed.
pub const RECEIVE_BUFFERS: usize = 3;

/// Receive buffers that stay in use however faulty they are. With two, one is written while the other is read and then
/// scrubbed. If that is not over when the next frame is whole, there is no clean one: the frame is given up in the
/// buffer in which it stands, and what is being read is left alone ([`Rotated::Overrun`]). Until then the commit and
/// scrub tasks have 3.9 ms, the shortest time between the ends of two frames (five receivers), and need less than
/// 0.3 ms.
pub const RECEIVE_LEAST: usize = 2;

/// The waiting buffers of a set of three, of which one is always being written.
#[derive(Debug)]
pub struct Rotation<B, I> {
    clean: Deque<Clean<B>, 2>,
    received: Deque<Received<B, I>, 2>,
    pub(super) dirty: Deque<Dirty<B>, 2>,
    in_use: InUse<{ RECEIVE_BUFFERS as u32 }, { RECEIVE_LEAST as u32 }>,
}

/// What became of a frame at [`Rotation::rotate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotated {
    /// It waits to be read.
    Handed,
    /// No clean buffer was at hand, so the frame was scrubbed away where it stood: the tasks behind are late by a
    /// cycle. With what the scrub found.
    Overrun(Scrubbed),
}

impl<B: Memory, I> Rotation<B, I> {
    /// Scrubs three buffers and starts to write the first that stays in use. Also gives what the scrubs found.
    ///
    /// # Panics
    ///
    /// Never: [`RECEIVE_LEAST`] buffers stay in use.
    pub fn new(buffers: [B; RECEIVE_BUFFERS]) -> (Filling<B>, Self, Scrubbed) {
        let mut rotation =
            Self { clean: Deque::new(), received: Deque::new(), dirty: Deque::new(), in_use: InUse::ALL };
        let mut all = Scrubbed::default();
        let mut first = None;
        for buffer in buffers {
            let (clean, found) = rotation.in_use.admit(Dirty::new(buffer).scrub());
            all += found;
            if let Some(clean) = clean {
                match first {
                    None => first = Some(clean.receive()),
                    Some(_) => put(&mut rotation.clean, clean),
                }
            }
        }
        (first.expect("two buffers stay in use"), rotation, all)
    }

    /// Buffers taken out of use because of stuck bits.
    #[must_use]
    pub fn out_of_use(&self) -> u32 {
        self.in_use.out_of_use()
    }

    /// A frame is whole: its buffer is handed on to be read, and a clean one is taken to be written.
    pub fn rotate(&mut self, filling: Filling<B>, about: I) -> (Filling<B>, Rotated) {
        match self.clean.pop_front() {
            Some(clean) => {
                put(&mut self.received, filling.received(about));
                (clean.receive(), Rotated::Handed)
            }
            None => {
                let (clean, found) = keep(filling.discard().scrub());
                (clean.receive(), Rotated::Overrun(found))
            }
        }
    }

    /// What was written is no whole frame: its buffer waits to be scrubbed, and a clean one is taken to be written. If
    /// no clean one is at hand the same one is scrubbed here; with what that scrub found.
    pub fn replace(&mut self, filling: Filling<B>) -> (Filling<B>, Scrubbed) {
        match self.clean.pop_front() {
            Some(clean) => {
                put(&mut self.dirty, filling.discard());
                (clean.receive(), Scrubbed::default())
            }
            None => {
                let (clean, found) = keep(filling.discard().scrub());
                (clean.receive(), found)
            }
        }
    }

    /// The oldest frame that waits to be read.
    pub fn read(&mut self) -> Option<Received<B, I>> {
        self.received.pop_front()
    }

    /// Reading is over: the buffer waits to be scrubbed.
    pub fn done(&mut self, received: Received<B, I>) {
        put(&mut self.dirty, received.done());
    }
}

impl<B: Memory, I> Scrubbable for Rotation<B, I> {
    type Buffer = B;

    fn take_dirty(&mut self) -> Option<Dirty<B>> {
        self.dirty.pop_front()
    }

    fn scrubbed(&mut self, outcome: Outcome<B>) -> Scrubbed {
        let (clean, found) = self.in_use.admit(outcome);
        if let Some(clean) = clean {
            put(&mut self.clean, clean);
        }
        found
    }
}
