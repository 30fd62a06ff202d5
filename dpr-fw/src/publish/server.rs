//! The SSI task's side of the hand-over: what a transaction gets.

use core::ops::Range;

use rtic_core::Mutex;

use super::{mailbox::Taken, ImageBuffer, Mailbox};
use crate::{
    port::areas::HandedOver,
    ssi::{Asked, Budget, Windows},
    telemetry::Telemetry,
    triple::Received,
};

/// What the SSI task finds when it is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Events<'a> {
    /// Whether the semaphore is the processor's.
    pub ours: bool,
    /// The bytes that the ended transaction clocked in, as far as they fit; `None` if no transaction has ended.
    pub received: Option<&'a [u8]>,
    /// Whether the ended transaction clocked out more than its window had.
    pub over_read: bool,
    /// Whether the ended transaction clocked in more than fits.
    pub overflow: bool,
}

/// What the SSI task needs from the SSI.
pub trait Ssi {
    /// An image buffer.
    type Buffer: ImageBuffer;

    /// Returns what has happened since the last call, and clears it. `ours` must be read before the end of a
    /// transaction is: if one ends in between, this call returns its end and the next one its buffers, never the other
    /// way round. If a transaction has ended, the peripheral's events do not call the task until the pause is over that
    /// [`Ssi::pass_on`] begins.
    fn take_events(&mut self) -> Events<'_>;
    /// Takes what the ended transaction brought for the port task, with what it asked for. Called before the next
    /// release.
    fn hand_over(&mut self, asked: Asked) -> HandedOver;
    /// Passes what was taken on to the port task, and calls it, and begins the pause of
    /// [`PAUSE_US`](crate::ssi::PAUSE_US) anew. Called after the next release, if there is one, since the flight
    /// controller waits for that.
    fn pass_on(&mut self);
    /// Whether the image's time is over. Called only while the semaphore is the processor's.
    fn is_expired(&mut self) -> bool;
    /// Exchanges the image. Called only while the semaphore is the processor's.
    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<Self::Buffer, ()>>) -> (Option<Received<Self::Buffer, ()>>, R),
    ) -> R;
    /// Points the peripheral to `window` of the image; returns false if there is no image.
    fn load(&mut self, window: Range<usize>) -> bool;
    /// Raises FRESH, from which the image's time begins anew.
    fn announce(&mut self);
    /// Gives the semaphore to the SPIS, so that the next transaction shows what was loaded.
    fn release(&mut self);
}

/// The state of the SSI task, for an image of `LEN` bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Server<const LEN: usize> {
    windows: Windows<LEN>,
    budget: Budget,
}

impl<const LEN: usize> Server<LEN> {
    /// The state in which the next transaction shows the whole image.
    #[must_use]
    pub const fn new() -> Self {
        Self { windows: Windows::new(), budget: Budget::new() }
    }

    /// Serves a call of the task: a transaction has ended, or the semaphore has come because there is a newer image or
    /// because time is over, or the task is to check in.
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
        // The flight controller may select again, so counting can wait until now.
        if let Some(Ended { spent, handed_over }) = ended {
            ssi.pass_on();
            telemetry.ssi_transactions.add_alone(1);
            telemetry.ssi_over_reads.add_alone(u32::from(over_read));
            telemetry.ssi_overflows.add_alone(u32::from(overflow));
            telemetry.ssi_budgets_spent.add_alone(u32::from(spent));
            telemetry.ssi_objects_dropped.add_alone(u32::from(handed_over == HandedOver::Dropped));
        }
    }

    /// Offers the newest image to the next transaction, if there is one that may be read. The semaphore must be the
    /// processor's.
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

/// The outcome of a transaction that has ended.
struct Ended {
    /// Whether it was the last transaction that is granted between two images.
    spent: bool,
    handed_over: HandedOver,
}
