//! The commit task's side: what it hands over, and how it tells of it.

use core::borrow;

use profile::{
    criticality::{Dpr, Writer},
    map::{self, PortArea},
};
use rtic_core::Mutex;

use super::ImageBuffer;
use crate::{
    commit::Images,
    telemetry::Telemetry,
    triple::{Dirty, Exchange, Filling, Memory, Outcome, Received, Scrubbable, Scrubbed, IMAGES},
    ImageMemory,
};

/// What the commit task and the SSI task hand over.
#[derive(Debug)]
pub struct Mailbox<B> {
    exchange: Exchange<B>,
    /// FRESH has risen for the newest image already.
    announced: bool,
}

impl<B: Memory> Mailbox<B> {
    /// No image has been published.
    pub fn new(buffers: [B; IMAGES]) -> Self {
        Self { exchange: Exchange::new(buffers), announced: false }
    }

    /// The image to stream next, given the one streamed so far.
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
        self.exchange.scrubbed(outcome)
    }
}

/// What the SSI task took out of the mailbox.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Taken {
    /// The image is newer than the one streamed before.
    pub(super) newer: bool,
    /// FRESH has risen for it already.
    pub(super) announced: bool,
}

/// What the commit task needs of the SSI.
pub trait Doorbell {
    /// Asks for the semaphore, and calls the SSI task. Tells whether a transaction is under way, whose end has to come
    /// first.
    fn request(&mut self) -> bool;
    /// FRESH rises, and the image's time begins anew.
    fn announce(&mut self);
}

/// Where the commit task puts images: into the mailbox, which is told to the SSI.
#[derive(Debug)]
pub struct Outbox<'a, M, B, D> {
    /// The mailbox that it shares with the SSI task.
    pub mailbox: M,
    /// The image being filled, if one is.
    pub filling: &'a mut Option<Filling<B>>,
    /// The SSI.
    pub doorbell: D,
    /// What the port task has ready.
    pub port: &'a PortArea,
    /// Where scrubs and publications are counted.
    pub telemetry: &'a Telemetry,
}

impl<M: Mutex<T = Mailbox<B>>, B: ImageBuffer, D: Doorbell> Outbox<'_, M, B, D> {
    /// Takes the buffer for the next image, and scrubs it if the scrub task has not: to be called when what was due has
    /// been published, so that neither stands between a frame and its image.
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
        borrow::BorrowMut::borrow_mut(filling.memory())
    }

    fn place_port<const N: usize>(&mut self) {
        let port = self.port.as_bytes();
        let image: &mut [u8] = bytemuck::cast_slice_mut(self.filling());
        if let Some(place) = map::port_area_mut::<_, N>(Writer::<Dpr>::claim(), image) {
            *place = *port;
        }
    }

    fn publish(&mut self) {
        let Self { mailbox, filling, doorbell, telemetry, .. } = self;
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
