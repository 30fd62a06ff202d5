//! The buffers of images on their way from the commit task to the SSI.

use super::{keep, Clean, Dirty, Filling, InUse, Memory, Outcome, Received, Scrubbable, Scrubbed, Waiting};

/// The number of buffers of an [`Exchange`]. Whatever the order in which the tasks preempt each other, at most four are
/// in use at once: one is streamed, one waits to be streamed, one is scrubbed, one is filled.
pub const IMAGES: usize = 4;

/// The number of images that stay in use however faulty they are: one is streamed, one waits to be streamed, one is
/// filled. With three the scrub task gets no image, since the commit task might interrupt it and find none to fill. The
/// commit task then scrubs the image that it fills, after it has published
/// ([`Outbox::prepare`](crate::publish::Outbox::prepare)). With two the newest image would have to be withdrawn,
/// although FRESH may have risen for it.
pub const IMAGES_LEAST: usize = 3;

/// The triple buffer between the commit task and the SSI. Only the newest image waits.
#[derive(Debug)]
pub struct Exchange<B> {
    newest: Option<Received<B, ()>>,
    clean: Waiting<Clean<B>, IMAGES>,
    dirty: Waiting<Dirty<B>, IMAGES>,
    in_use: InUse<{ IMAGES as u32 }, { IMAGES_LEAST as u32 }>,
}

/// A buffer that is to be filled.
#[derive(Debug)]
pub enum Blank<B> {
    /// The scrub task has scrubbed the buffer, which is the usual case.
    Clean(Clean<B>),
    /// The scrub task has not scrubbed the buffer, so [`Blank::fill`] does.
    Dirty(Dirty<B>),
}

impl<B: Memory> Blank<B> {
    /// Begins to fill the buffer. Scrubs it first if the scrub task has not, and returns the result of that scrub.
    pub fn fill(self) -> (Filling<B>, Scrubbed) {
        let (clean, found) = match self {
            Self::Clean(clean) => (clean, Scrubbed::default()),
            Self::Dirty(dirty) => keep(dirty.scrub()),
        };
        (clean.receive(), found)
    }
}

impl<B: Memory> Exchange<B> {
    /// Returns an exchange whose buffers hold no image.
    pub fn new(buffers: [B; IMAGES]) -> Self {
        let mut exchange = Self { newest: None, clean: Waiting::NONE, dirty: Waiting::NONE, in_use: InUse::ALL };
        for buffer in buffers {
            exchange.dirty.push(Dirty::new(buffer));
        }
        exchange
    }

    /// Returns the number of buffers taken out of use because of stuck bits.
    #[must_use]
    pub fn out_of_use(&self) -> u32 {
        self.in_use.out_of_use()
    }

    /// Returns a buffer to fill. `None` only if all buffers are streamed, wait to be streamed, or are being scrubbed.
    pub fn begin(&mut self) -> Option<Blank<B>> {
        let clean = self.clean.pop().map(Blank::Clean);
        clean.or_else(|| self.dirty.pop().map(Blank::Dirty))
    }

    /// Makes the image that was filled the newest one.
    pub fn publish(&mut self, filling: Filling<B>) {
        // Not covered: only this line, a full queue, as in `Waiting::push`.
        if let Some(unread) = self.newest.replace(filling.received(())) {
            self.dirty.push(unread.done());
        }
    }

    /// Returns the image to stream next: the newest, or else the one streamed so far. Also returns whether it is newer
    /// than that one.
    pub fn take(&mut self, streamed: Option<Received<B, ()>>) -> (Option<Received<B, ()>>, bool) {
        match (self.newest.take(), streamed) {
            (Some(newest), streamed) => {
                // Not covered: only this line, a full queue, as in `Waiting::push`.
                if let Some(streamed) = streamed {
                    self.dirty.push(streamed.done());
                }
                (Some(newest), true)
            }
            (None, streamed) => (streamed, false),
        }
    }
}

impl<B: Memory> Scrubbable for Exchange<B> {
    type Buffer = B;

    fn take_dirty(&mut self) -> Option<Dirty<B>> {
        if self.in_use.is_least() {
            return None;
        }
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
