//! The receive buffers, while they wait for a task.

use super::{keep, Clean, Dirty, Filling, InUse, Memory, Outcome, Received, Scrubbable, Scrubbed, Waiting};

/// The number of receive buffers: one is written, one is read, one is scrubbed.
pub const RECEIVE_BUFFERS: usize = 3;

/// The number of receive buffers that stay in use however faulty they are: one is written while the other is read and
/// then scrubbed. If a frame ends before the other buffer is scrubbed, that frame is lost, and the buffer that is being
/// read is left alone ([`Rotated::Overrun`]). Commit and scrub have 3.9 ms for their work, the shortest time between
/// the ends of two frames (five receivers), and need less than 0.3 ms.
pub const RECEIVE_LEAST: usize = 2;

/// The receive buffers that wait for a task. One buffer of the three is always being written.
#[derive(Debug)]
pub struct Rotation<B, I> {
    clean: Waiting<Clean<B>, 2>,
    received: Waiting<Received<B, I>, 2>,
    pub(super) dirty: Waiting<Dirty<B>, 2>,
    in_use: InUse<{ RECEIVE_BUFFERS as u32 }, { RECEIVE_LEAST as u32 }>,
}

/// The result of [`Rotation::rotate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rotated {
    /// The frame waits to be read.
    Handed,
    /// The frame was scrubbed away, because no clean buffer was left. The value is the result of that scrub.
    Overrun(Scrubbed),
}

impl<B: Memory, I> Rotation<B, I> {
    /// Scrubs all buffers. Returns the buffer to write first, the set of the others, and the result of the scrubs.
    ///
    /// # Panics
    ///
    /// Cannot panic, since [`RECEIVE_LEAST`] buffers always stay in use.
    pub fn new(buffers: [B; RECEIVE_BUFFERS]) -> (Filling<B>, Self, Scrubbed) {
        let mut rotation =
            Self { clean: Waiting::NONE, received: Waiting::NONE, dirty: Waiting::NONE, in_use: InUse::ALL };
        let mut all = Scrubbed::default();
        let mut first = None;
        for buffer in buffers {
            let (clean, found) = rotation.in_use.admit(Dirty::new(buffer).scrub());
            all += found;
            if let Some(clean) = clean {
                // Not covered: only this line, a third buffer as the first good one: `InUse` takes one buffer at most
                // out of use, so the first or the second buffer is the one to write.
                match first {
                    None => first = Some(clean.receive()),
                    Some(_) => rotation.clean.push(clean),
                }
            }
        }
        (first.expect("two buffers stay in use"), rotation, all)
    }

    /// Returns the number of buffers taken out of use because of stuck bits.
    #[must_use]
    pub fn out_of_use(&self) -> u32 {
        self.in_use.out_of_use()
    }

    /// Hands the buffer of a whole frame on to be read, and returns a clean buffer to be written.
    pub fn rotate(&mut self, filling: Filling<B>, about: I) -> (Filling<B>, Rotated) {
        // Not covered: only this line, no clean buffer in the copy for the second port: the hold sends each 100 ms, and
        // by then its last frame is read and its buffer scrubbed.
        match self.clean.pop() {
            Some(clean) => {
                self.received.push(filling.received(about));
                (clean.receive(), Rotated::Handed)
            }
            None => {
                // Not covered: only this line, no clean buffer in the copy for the second port, as above.
                let (clean, found) = keep(filling.discard().scrub());
                // Not covered: only this line, no clean buffer in the copy for the second port, as above.
                (clean.receive(), Rotated::Overrun(found))
            }
        }
    }

    /// Queues the buffer of an incomplete frame for a scrub, and returns a clean buffer to be written. If none is left,
    /// scrubs the given buffer at once and also returns the result of that scrub.
    pub fn replace(&mut self, filling: Filling<B>) -> (Filling<B>, Scrubbed) {
        // Not covered: only this line, no clean buffer: a frame would have to be given up just when the other two
        // buffers wait to be read and to be scrubbed.
        match self.clean.pop() {
            Some(clean) => {
                self.dirty.push(filling.discard());
                (clean.receive(), Scrubbed::default())
            }
            None => {
                // Not covered: only this line, no clean buffer, as above.
                let (clean, found) = keep(filling.discard().scrub());
                (clean.receive(), found)
            }
        }
    }

    /// Returns the frame that has waited longest to be read.
    pub fn read(&mut self) -> Option<Received<B, I>> {
        self.received.pop()
    }

    /// Ends the reading of a frame: its buffer now waits to be scrubbed.
    pub fn done(&mut self, received: Received<B, I>) {
        self.dirty.push(received.done());
    }
}

impl<B: Memory, I> Scrubbable for Rotation<B, I> {
    type Buffer = B;

    fn take_dirty(&mut self) -> Option<Dirty<B>> {
        // Not covered: only this line, a second buffer that waits, as in `Waiting::pop`.
        self.dirty.pop()
    }

    fn scrubbed(&mut self, outcome: Outcome<B>) -> Scrubbed {
        let (clean, found) = self.in_use.admit(outcome);
        if let Some(clean) = clean {
            self.clean.push(clean);
        }
        found
    }
}
