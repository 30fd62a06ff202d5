//! The SSI task's side of the hand-over of images.

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
    /// Whether the processor owns the buffers, that is, has the semaphore.
    pub ours: bool,
    /// The bytes that came in during the ended transaction, as far as they fit; `None` if no transaction has ended.
    pub received: Option<&'a [u8]>,
    /// Whether more bytes were clocked out during the ended transaction than its window has.
    pub over_read: bool,
    /// Whether more bytes came in during the ended transaction than the receive area holds.
    pub overflow: bool,
}

/// The operations on the SSI's hardware that the SSI task needs.
pub trait Ssi {
    /// The type of an image buffer.
    type Buffer: ImageBuffer;

    /// Returns the events since the last call, and clears them. Must read the semaphore before the end of a
    /// transaction: if a transaction ends between the two reads, the next call returns the semaphore. After an end, the
    /// peripheral's events do not call the task until the pause that [`Ssi::pass_on`] begins is over.
    fn take_events(&mut self) -> Events<'_>;
    /// Takes the bytes and the request of the ended transaction for the port task. Called before the next release of
    /// the buffers.
    fn hand_over(&mut self, asked: Asked) -> HandedOver;
    /// Passes the bytes on to the port task, calls that task, and begins a new pause of
    /// [`PAUSE_US`](crate::ssi::PAUSE_US). Called after the next release, because the flight controller waits for that
    /// release.
    fn pass_on(&mut self);
    /// Whether the image that is streamed has expired. Called only while the processor has the semaphore.
    fn is_expired(&mut self) -> bool;
    /// Exchanges the image that is streamed. Called only while the processor has the semaphore.
    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<Self::Buffer, ()>>) -> (Option<Received<Self::Buffer, ()>>, R),
    ) -> R;
    /// Lets the peripheral stream the bytes `window` of the image. Returns false if there is no image.
    fn load(&mut self, window: Range<usize>) -> bool;
    /// Raises FRESH, which also restarts the time until the image expires.
    fn announce(&mut self);
    /// Gives the semaphore to the SPIS, so that the next transaction gets the loaded window.
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

    /// Serves a call of the SSI task: an ended transaction, a newer image, an expired image, or only a check-in.
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
            // Not covered: only this line, a transaction without received bytes: the port always gives a slice, which
            // may be empty.
            .map(|mosi| self.windows.transaction(mosi))
            .map(|asked| Ended { spent: self.budget.spend(), handed_over: ssi.hand_over(asked) });
        // Not covered: only this line, a call without the semaphore: the end of a transaction gives it to the processor
        // (END_ACQUIRE), and so does a request, which comes before any other call.
        if ours {
            self.offer(ssi, &mut mailbox, telemetry);
        }
        // The flight controller waits for the release, so the counters are updated after it.
        if let Some(Ended { spent, handed_over }) = ended {
            ssi.pass_on();
            telemetry.ssi_transactions.add_alone(1);
            telemetry.ssi_over_reads.add_alone(u32::from(over_read));
            telemetry.ssi_overflows.add_alone(u32::from(overflow));
            telemetry.ssi_budgets_spent.add_alone(u32::from(spent));
            telemetry.ssi_objects_dropped.add_alone(u32::from(handed_over == HandedOver::Dropped));
        }
    }

    /// Offers the newest image to the next transaction, unless it has expired. The processor must have the semaphore.
    fn offer<S: Ssi>(&mut self, ssi: &mut S, mailbox: &mut impl Mutex<T = Mailbox<S::Buffer>>, telemetry: &Telemetry) {
        let Taken { newer, announced } = mailbox.lock(|mailbox| ssi.exchange(|streamed| mailbox.take(streamed)));
        // Not covered: only this line, what follows the copy of the locked section for another priority, which never
        // runs (`xtask/src/coverage/twins.rs`).
        if newer {
            // Not covered: only this line, what follows the copy that never runs, as above.
            self.budget = Budget::new();
        }
        // An image may expire during a transaction, after it was announced and before the transaction ended.
        let announce = newer && !announced;
        // Not covered: only this line, what follows the copy that never runs, as above.
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

struct Ended {
    spent: bool,
    handed_over: HandedOver,
}
