//! The images between their builder and the SSI.

use heapless::Deque;

use super::{keep, put, Clean, Dirty, Filling, InUse, Memory, Outcome, Received, Scrubbable, Scrubbed};

/// Buffers of an [`Exchange`]. Each of four tasks of a buffer can be under way at once, whatever the order in which the
/// firmware's tasks preempt each other: one is streamed, one waits to be streamed, one is scrubbed, one is filled.
pub const IMAGES: usize = 4;

/// Images that stay in use however faulty they are: one is streamed, one waits to be streamed, one is filled. The
/// fourth is what lets the scrub task hold one beside them. With three it gets none: were the commit task to interrupt
/// it, nothing might be left to fill. The commit task then scrubs the one that it fills, off the deadline path
/// ([`Outbox::prepare`](crate::publish::Outbox::prepare)). Two would not do: the newest image would have to be
/// withdrawn, for which FRESH may have risen.
pub const IMAGES_LEAST: usize = 3;

/// The same mechanism between the image's builder and the SSI. Unlike frames, images do not queue: the newest wins.
#[derive(Debug)]
pub struct Exchange<B> {
    newest: Option<Received<B, ()>>,
    clean: Deque<Clean<B>, IMAGES>,
    dirty: Deque<Dirty<B>, IMAGES>,
    in_use: InUse<{ IMAGES as u32 }, { IMAGES_LEAST as u32 }>,
}

/// A buffer to fill, as it was found.
#[derive(Debug)]
pub enum Blank<B> {
    /// The usual case: the scrub task has been there.
    Clean(Clean<B>),
    /// It has not, or gets none any more ([`IMAGES_LEAST`]): [`Blank::fill`] scrubs.
    Dirty(Dirty<B>),
}

impl<B: Memory> Blank<B> {
    /// Begins to fill it, scrubbed in any case; with what a scrub now found.
    pub fn fill(self) -> (Filling<B>, Scrubbed) {
        let (clean, found) = match self {
            Self::Clean(clean) => (clean, Scrubbed::default()),
            Self::Dirty(dirty) => keep(dirty.scrub()),
        };
        (clean.receive(), found)
    }
}

impl<B: Memory> Exchange<B> {
    /// Buffers none of which holds anything.
    pub fn new(buffers: [B; IMAGES]) -> Self {
        let mut exchange = Self { newest: None, clean: Deque::new(), dirty: Deque::new(), in_use: InUse::ALL };
        for buffer in buffers {
            put(&mut exchange.dirty, Dirty::new(buffer));
        }
        exchange
    }

    /// Buffers taken out of use because of stuck bits.
    #[must_use]
    pub fn out_of_use(&self) -> u32 {
        self.in_use.out_of_use()
    }

    /// A buffer to fill. While at most one buffer each is streamed, is scrubbed and is being filled, there is one.
    pub fn begin(&mut self) -> Option<Blank<B>> {
        let clean = self.clean.pop_front().map(Blank::Clean);
        clean.or_else(|| self.dirty.pop_front().map(Blank::Dirty))
    }

    /// What was filled is the newest image from now on.
    pub fn publish(&mut self, filling: Filling<B>) {
        if let Some(unread) = self.newest.replace(filling.received(())) {
            put(&mut self.dirty, unread.done());
        }
    }

    /// The image to stream next, given the one streamed so far: the newest if it is newer. Tells whether it is.
    pub fn take(&mut self, streamed: Option<Received<B, ()>>) -> (Option<Received<B, ()>>, bool) {
        match (self.newest.take(), streamed) {
            (Some(newest), streamed) => {
                if let Some(streamed) = streamed {
                    put(&mut self.dirty, streamed.done());
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
