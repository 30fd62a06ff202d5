//! The commit task's side of the hand-over of images.

use core::borrow;

use profile::criticality::{Dpr, Writer};
use rtic_core::Mutex;

use super::ImageBuffer;
use crate::{
    commit::Images,
    hold::Area,
    telemetry::Telemetry,
    triple::{Dirty, Exchange, Filling, Memory, Outcome, Received, Scrubbable, Scrubbed, IMAGES},
    ImageMemory,
};

/// The images that the commit task hands over to the SSI task.
#[derive(Debug)]
pub struct Mailbox<B> {
    exchange: Exchange<B>,
    /// Whether FRESH has already risen for the newest image.
    announced: bool,
}

impl<B: Memory> Mailbox<B> {
    /// Returns a mailbox in which no image has been published.
    pub fn new(buffers: [B; IMAGES]) -> Self {
        Self { exchange: Exchange::new(buffers), announced: false }
    }

    /// Returns the image to stream next. `streamed` is the image that was streamed so far.
    pub(crate) fn take(&mut self, streamed: Option<Received<B, ()>>) -> (Option<Received<B, ()>>, Taken) {
        let (image, newer) = self.exchange.take(streamed);
        let announced = core::mem::take(&mut self.announced);
        (image, Taken { newer, announced })
    }
}

impl<B: Memory> Scrubbable for Mailbox<B> {
    type Buffer = B;

    fn take_dirty(&mut self) -> Option<Dirty<B>> {
        self.exchange.take_dirty()
    }

    fn scrubbed(&mut self, outcome: Outcome<B>) -> Scrubbed {
        // Not covered: only this line, a faulty buffer that stays in use: as `triple::keep` explains, `Exchange` gives
        // none to the scrub then.
        self.exchange.scrubbed(outcome)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Taken {
    /// Whether this image is newer than the image that was streamed before.
    pub(super) newer: bool,
    pub(super) announced: bool,
}

/// The operations on the SSI's hardware that the commit task needs.
pub trait Doorbell {
    /// Requests the semaphore, and calls the SSI task. Returns whether a transaction is in progress and keeps the
    /// semaphore.
    fn request(&mut self) -> bool;
    /// Raises FRESH, which also restarts the time until the image expires.
    fn announce(&mut self);
}

/// The commit task's way to publish an image.
#[derive(Debug)]
pub struct Outbox<'a, M, B, D> {
    /// The mailbox, which the commit task shares with the SSI task.
    pub mailbox: M,
    /// The image that is being filled, if there is one.
    pub filling: &'a mut Option<Filling<B>>,
    /// The hardware of the SSI, to which a published image is announced.
    pub doorbell: D,
    /// Port-Status and the uplinks, as the port task has prepared them for the next image.
    pub port: &'a Area,
    /// The counters of scrubs and publications.
    pub telemetry: &'a Telemetry,
}

impl<M: Mutex<T = Mailbox<B>>, B: ImageBuffer, D: Doorbell> Outbox<'_, M, B, D> {
    /// Takes the buffer for the next image, and scrubs it if necessary. This is done early, so that it does not delay
    /// the image.
    pub fn prepare(&mut self) {
        let _ = self.filling();
    }
}

impl<M: Mutex<T = Mailbox<B>>, B: ImageBuffer, D: Doorbell> Images for Outbox<'_, M, B, D> {
    fn filling(&mut self) -> &mut ImageMemory {
        let Self { mailbox, filling, telemetry, .. } = self;
        let filling = filling.get_or_insert_with(|| {
            let blank =
                mailbox.lock(|mailbox| mailbox.exchange.begin()).expect("one image is free (IMAGES, IMAGES_LEAST)");
            let (filling, found) = blank.fill();
            telemetry.scrubbed(found);
            filling
        });
        borrow::BorrowMut::borrow_mut(filling.verified())
    }

    fn place_port<const N: usize>(&mut self) {
        let port = self.port;
        port.place::<N>(Writer::<Dpr>::claim(), bytemuck::cast_slice_mut(self.filling()));
    }

    fn publish(&mut self) {
        let Self { mailbox, filling, doorbell, telemetry, .. } = self;
        // Not covered: only this line, nothing to publish: `filling` has always put an image there before.
        if let Some(filled) = filling.take() {
            mailbox.lock(|mailbox| {
                mailbox.exchange.publish(filled);
                mailbox.announced = doorbell.request();
                if mailbox.announced {
                    doorbell.announce();
                }
            });
            telemetry.publications.add(1);
        }
    }
}
