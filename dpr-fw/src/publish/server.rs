//! The SSI task's side of the hand-over of images: what a transaction gets.

use core::ops::Range;

use rtic_core::Mutex;

use super::{mailbox::Taken, ImageBuffer, Mailbox};
use crate::{
    port::areas::HandedOver,
    ssi::{Asked, Budget, Windows},
    telemetry::Telemetry,
    triple::Received,
};

/// The events on the SSI since the SSI task was last called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Events<'a> {
    /// Whether the processor has the semaphore.
    pub ours: bool,
    /// The bytes that the ended transaction clocked in, as far as they fit; `None` if no transaction has ended.
    pub received: Option<&'a [u8]>,
    /// Whether the ended transaction clocked out more than its window had.
    pub over_read: bool,
    /// Whether the ended transaction clocked in more bytes than the receive area has.
    pub overflow: bool,
}

/// The hardware operations of the SSI that its task needs.
pub trait Ssi {
    /// An image buffer.
    type Buffer: ImageBuffer;

    /// Returns what has happened since the last call, and clears it. `ours` must be read before the end of a
    /// transaction is: if a transaction ends between the two reads, this call returns its end and the next call its
    /// buffers, never the other way round. After a transaction has ended, the peripheral's events do not call the task
    /// until the pause that [`Ssi::pass_on`] begins is over.
    fn take_events(&mut self) -> Events<'_>;
    /// Takes the bytes that the ended transaction brought for the port task, with what the transaction asked for.
    /// Called before the next release.
    fn hand_over(&mut self, asked: Asked) -> HandedOver;
    /// Passes the bytes of the ended transaction on to the port task, calls that task, and begins the pause of
    /// [`PAUSE_US`](crate::ssi::PAUSE_US) anew. Called after the next release, if there is one, since the flight
    /// controller waits for that.
    fn pass_on(&mut self);
    /// Whether the image that is streamed has expired. Called only while the processor has the semaphore.
    fn is_expired(&mut self) -> bool;
    /// Exchanges the image that is streamed. Called only while the processor has the semaphore.
    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<Self::Buffer, ()>>) -> (Option<Received<Self::Buffer, ()>>, R),
    ) -> R;
    /// Points the peripheral to the bytes `window` of the image; returns false if there is no image.
    fn load(&mut self, window: Range<usize>) -> bool;
    /// Raises FRESH, which also restarts the time until the image expires.
    fn announce(&mut self);
    /// Gives the semaphore to the SPIS, so that the next transaction gets the window that was loaded.
    fn release(&mut self);
}

/// The state of the SSI task, for an image of `LEN` bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Server<const LEN: usize> {
    windows: Windows<LEN>,
    budget: Budget,
}

impl<const LEN: usize> Server<LEN> {
    /// Returns the state in which the next transaction shows the whole image.
    #[must_use]
    pub const fn new() -> Self {
        Self { windows: Windows::new(), budget: Budget::new() }
    }

    /// Serves a call of the task: a transaction has ended, the semaphore has come because there is a newer image or
    /// because an image has expired, or the task is called only to check in.
    pub fn serve<S: Ssi>(
        &mut self,
        ssi: &mut S,
        mut mailbox: impl Mutex<T = Mailbox<S::Buffer>>,
        telemetry: &Telemetry,
    ) {
        let events = ssi.take_events();
        let (ours, over_read, overflow) = (events.ours, events.over_read, events.overflow);
        let ended = events
            .received
            .map(|mosi| self.windows.transaction(mosi))
            .map(|asked| Ended { spent: self.budget.spend(), handed_over: ssi.hand_over(asked) });
        if ours {
            self.offer(ssi, &mut mailbox, telemetry);
        }
        // The release is done, so the flight controller may select again, and the counters can be updated now.
        if let Some(Ended { spent, handed_over }) = ended {
            ssi.pass_on();
            telemetry.ssi_transactions.add_alone(1);
            telemetry.ssi_over_reads.add_alone(u32::from(over_read));
            telemetry.ssi_overflows.add_alone(u32::from(overflow));
            telemetry.ssi_budgets_spent.add_alone(u32::from(spent));
            telemetry.ssi_objects_dropped.add_alone(u32::from(handed_over == HandedOver::Dropped));
        }
    }

    /// Offers the newest image to the next transaction, if there is one that may be read. The processor must have the
    /// semaphore.
    fn offer<S: Ssi>(&mut self, ssi: &mut S, mailbox: &mut impl Mutex<T = Mailbox<S::Buffer>>, telemetry: &Telemetry) {
        let Taken { newer, announced } = mailbox.lock(|mailbox| ssi.exchange(|streamed| mailbox.take(streamed)));
        if newer {
            self.budget = Budget::new();
        }
        // An image that was announced during a transaction may have expired before that transaction ended.
        let announce = newer && !announced;
        if !announce && ssi.is_expired() {
            telemetry.images_expired.add(1);
            return;
        }
        if !self.budget.is_left() || !ssi.load(self.windows.window()) {
            return;
        }
        if announce {
            ssi.announce();
        }
        ssi.release();
        telemetry.images_readable.add_alone(u32::from(newer));
    }
}

/// The SSI task's findings about a transaction that has ended.
struct Ended {
    /// Whether the transaction was the last one that is granted between two images.
    spent: bool,
    handed_over: HandedOver,
}
