//! From the finished image to the flight controller: the hand-over to the SSI.
//!
//! # Design
//!
//! Two tasks meet here. The commit task fills an image and publishes it into the [`Mailbox`] ([`Outbox`]). The SSI
//! task, of higher priority, takes the newest image out of the mailbox and lets the peripheral stream it ([`Server`]).
//! The peripheral's semaphore says whose the stream's buffer is: the processor's, or the SPIS's from one *release* to
//! the end of the next transaction, when hardware gives it back to the processor (shortcut END to ACQUIRE).
//!
//! **FRESH** rises when a new image is what the next transaction gets, or 0xFF throughout if that transaction begins
//! while the image is being put in; never an older image:
//!
//! - While no transaction is under way, the commit task asks for the semaphore, and the SSI task that this calls takes
//!   the new image, raises FRESH, and releases, in this order. A transaction that begins before the release reads 0xFF.
//! - While a transaction is under way, what the next one gets is settled already: the SSI task runs between the two and
//!   takes the newest image. So the commit task raises FRESH itself. The SSI task is masked from the question whether
//!   a transaction is under way until FRESH has risen, so nothing is released in between.
//!
//! **Expiry.** FRESH restarts a timer in hardware. If it is not restarted in time, the timer takes the semaphore away
//! from the SPIS without the processor's help (a compare, through PPI, to the task ACQUIRE), and every transaction that
//! begins later reads 0xFF. The SSI task releases an image that it has released before only while that time is not
//! over. The time can run out between that question and the release; therefore the timer has a second compare,
//! [`EXPIRY_AGAIN_US`] after the first, which is longer than the SSI task can take from the one to the other.
//!
//! **Bounds.** How often the SSI task runs is bounded by what it grants ([`Budget`]). It waits for the commit task only
//! while that holds the mailbox, which is for a few pointers to be moved.

use core::{borrow, ops::Range};

use rtic_core::Mutex;

use crate::{
    commit::Images,
    ssi::{Asked, Budget, Windows},
    telemetry::Telemetry,
    triple::{Clean, Dirty, Exchange, Filling, Memory, Received, Scrubbable, IMAGES},
    ImageMemory,
};

/// From its publication on, an image that is not replaced is readable for that long, µs.
pub const EXPIRY_US: u32 = 25_000;

/// The second compare stands this much after the first, µs: longer than the SSI task takes from its look at the first
/// to its release, which is below 10 µs since no task preempts it.
pub const EXPIRY_AGAIN_US: u32 = 20;

/// A buffer for an image.
pub trait ImageBuffer: Memory + borrow::BorrowMut<ImageMemory> {}
impl<B: Memory + borrow::BorrowMut<ImageMemory>> ImageBuffer for B {}

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
    fn take(&mut self, streamed: Option<Received<B, ()>>) -> (Option<Received<B, ()>>, Taken) {
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

    fn cleaned(&mut self, clean: Clean<B>) {
        self.exchange.cleaned(clean);
    }
}

/// What the SSI task took out of the mailbox.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Taken {
    /// The image is newer than the one streamed before.
    newer: bool,
    /// FRESH has risen for it already.
    announced: bool,
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
    /// Where scrubs and publications are counted.
    pub telemetry: &'a Telemetry,
}

impl<M: Mutex<T = Mailbox<B>>, B: ImageBuffer, D: Doorbell> Images for Outbox<'_, M, B, D> {
    fn filling(&mut self) -> &mut ImageMemory {
        let Self { mailbox, filling, telemetry, .. } = self;
        let filling = filling.get_or_insert_with(|| {
            let blank = mailbox.lock(|mailbox| mailbox.exchange.begin()).expect("of four images one is free");
            let (filling, found) = blank.fill();
            telemetry.scrub_faults.add(found.stuck_bits);
            filling
        });
        borrow::BorrowMut::borrow_mut(filling.memory())
    }

    fn publish(&mut self) {
        let Self { mailbox, filling, doorbell, telemetry } = self;
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

/// What the SSI task finds when it is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Events<'a> {
    /// The semaphore is the processor's.
    pub ours: bool,
    /// What the transaction that has ended clocked in, as far as it fits; `None` if none has ended.
    pub received: Option<&'a [u8]>,
    /// It clocked more out than its window had.
    pub over_read: bool,
    /// It clocked more in than fits.
    pub overflow: bool,
}

/// What the SSI task needs of the SSI.
pub trait Ssi {
    /// An image buffer.
    type Buffer: ImageBuffer;

    /// Returns what has happened since the last call, and clears it. `ours` must be asked for before the end of a
    /// transaction is: if one ends in between, its end is told now and its buffers next time, never the other way
    /// round.
    fn take_events(&mut self) -> Events<'_>;
    /// Whether the image's time is over. Asked for only while the semaphore is the processor's.
    fn is_expired(&mut self) -> bool;
    /// Exchanges the image; called only while the semaphore is the processor's.
    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<Self::Buffer, ()>>) -> (Option<Received<Self::Buffer, ()>>, R),
    ) -> R;
    /// Points the peripheral to `window` of the image; `false` if there is no image.
    fn load(&mut self, window: Range<usize>) -> bool;
    /// FRESH rises, and the image's time begins anew.
    fn announce(&mut self);
    /// Gives the semaphore to the SPIS: the next transaction shows what was loaded.
    fn release(&mut self);
}

/// What the SSI task remembers, for an image of `LEN` bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Server<const LEN: usize> {
    windows: Windows<LEN>,
    budget: Budget,
}

impl<const LEN: usize> Server<LEN> {
    /// The next transaction shows the whole image.
    #[must_use]
    pub const fn new() -> Self {
        Self { windows: Windows::new(), budget: Budget::new() }
    }

    /// A transaction has ended, or the semaphore has come because there is a newer image or because time is over, or
    /// the task was called to check in.
    pub fn serve<S: Ssi>(
        &mut self,
        ssi: &mut S,
        mut mailbox: impl Mutex<T = Mailbox<S::Buffer>>,
        telemetry: &Telemetry,
    ) {
        let events = ssi.take_events();
        if let Some(mosi) = events.received {
            let refused = self.windows.transaction(mosi) == Asked::Violation;
            let spent = self.budget.spend();
            telemetry.ssi_transactions.add(1);
            telemetry.access_violations.add(u32::from(refused) + u32::from(spent));
            telemetry.ssi_over_reads.add(u32::from(events.over_read));
            telemetry.ssi_overflows.add(u32::from(events.overflow));
        }
        if !events.ours {
            return;
        }
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
        telemetry.images_readable.add(u32::from(newer));
        ssi.release();
    }
}

#[cfg(test)]
mod tests {
    //! Both tasks against a model of the SPIS's semaphore, interrupted by the flight controller, by the timer and by
    //! the SSI task at every access to hardware.

    use std::{cell::RefCell, collections::VecDeque, rc::Rc};

    use super::*;
    use crate::{commit::Images, IMAGE_WORDS};
    use profile::ssi::{encode, Request};
    use proptest::prelude::*;

    const LEN: usize = 156;

    /// Whose the buffers are (PS v1.7, 6.26, SEMSTAT).
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Semaphore {
        Free,
        Cpu,
        Spis,
        CpuPending,
    }

    /// What happens beside the processor.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Happening {
        Nothing,
        /// The flight controller selects, unless it has already.
        Select,
        /// It lets go, and the transaction ends.
        Deselect,
        /// The image's time runs out: both compares, one after the other.
        Expire,
        ExpireAgain,
    }

    /// What a transaction read.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Read {
        Busy,
        Image(u32),
    }

    struct World {
        semaphore: Semaphore,
        end: bool,
        acquired: bool,
        pended: bool,
        /// The image that a release gave to the SPIS.
        loaded: Option<u32>,
        /// The transaction under way.
        selected: Option<Read>,
        /// What it will have clocked in.
        mosi: Vec<u8>,
        /// The newest image for which FRESH has risen.
        announced: u32,
        compares: [bool; 2],
        reads: Vec<Read>,
        masked: bool,
        in_ssi_task: bool,
        happenings: VecDeque<Happening>,
        newest_published: u32,
    }

    type Buffer = ImageMemory;

    /// The board: hardware, mailbox and the SSI task, for whoever interrupts whom.
    #[derive(Clone)]
    struct Board {
        world: Rc<RefCell<World>>,
        mailbox: Rc<RefCell<Mailbox<Buffer>>>,
        task: Rc<RefCell<Option<(Server<LEN>, Port)>>>,
        telemetry: Rc<Telemetry>,
    }

    struct Port {
        world: Rc<RefCell<World>>,
        image: Option<Received<Buffer, ()>>,
        received: Vec<u8>,
        /// To let something happen before and after each access.
        board: Option<Board>,
    }

    impl World {
        fn acquire(&mut self) {
            match self.semaphore {
                Semaphore::Free => {
                    self.semaphore = Semaphore::Cpu;
                    self.acquired = true;
                }
                Semaphore::Spis => self.semaphore = Semaphore::CpuPending,
                Semaphore::Cpu | Semaphore::CpuPending => {}
            }
        }

        fn happen(&mut self, what: Happening) {
            match what {
                Happening::Nothing => {}
                Happening::Select if self.selected.is_none() => {
                    self.selected = Some(match (self.semaphore, self.loaded) {
                        (Semaphore::Free, Some(image)) => {
                            self.semaphore = Semaphore::Spis;
                            Read::Image(image)
                        }
                        _ => Read::Busy,
                    });
                    let read = self.selected.expect("just selected");
                    if let Read::Image(image) = read {
                        assert_eq!(image, self.announced, "what is read is what FRESH has told of");
                        assert!(!self.compares[1], "an expired image is read");
                    }
                    self.reads.push(read);
                }
                Happening::Select => {}
                Happening::Deselect => {
                    if let Some(Read::Image(_)) = self.selected.take() {
                        // The shortcut from END to ACQUIRE.
                        self.end = true;
                        self.semaphore = Semaphore::Cpu;
                        self.acquired = true;
                    }
                }
                Happening::Expire => {
                    self.compares[0] = true;
                    self.acquire();
                }
                Happening::ExpireAgain if self.compares[0] && !self.in_ssi_task => {
                    self.compares[1] = true;
                    self.acquire();
                }
                Happening::ExpireAgain => {}
            }
        }
    }

    impl Board {
        fn new() -> Self {
            let world = Rc::new(RefCell::new(World {
                semaphore: Semaphore::Cpu,
                end: false,
                acquired: false,
                pended: false,
                loaded: None,
                selected: None,
                mosi: vec![0; 8],
                announced: 0,
                compares: [false; 2],
                reads: vec![],
                masked: false,
                in_ssi_task: false,
                happenings: VecDeque::new(),
                newest_published: 0,
            }));
            let port = Port { world: world.clone(), image: None, received: vec![], board: None };
            let board = Self {
                world,
                mailbox: Rc::new(RefCell::new(Mailbox::new([[0xA5A5_A5A5; IMAGE_WORDS]; IMAGES]))),
                task: Rc::new(RefCell::new(Some((Server::new(), port)))),
                telemetry: Rc::new(Telemetry::new()),
            };
            let at = board.clone();
            board.task.borrow_mut().as_mut().expect("not running").1.board = Some(at);
            board
        }

        /// Something may happen in hardware, and then the SSI task may interrupt.
        fn point(&self) {
            let next = self.world.borrow_mut().happenings.pop_front();
            self.world.borrow_mut().happen(next.unwrap_or(Happening::Nothing));
            self.interrupt();
        }

        fn interrupt(&self) {
            loop {
                {
                    let mut world = self.world.borrow_mut();
                    let called = world.end || world.acquired || world.pended;
                    if world.masked || world.in_ssi_task || !called {
                        return;
                    }
                    world.pended = false;
                    world.in_ssi_task = true;
                }
                let mut task = self.task.borrow_mut().take().expect("the task does not interrupt itself");
                task.0.serve(&mut task.1, self.clone(), &self.telemetry);
                *self.task.borrow_mut() = Some(task);
                self.world.borrow_mut().in_ssi_task = false;
            }
        }

        fn publish(&self, generation: u32, filling: &mut Option<Filling<Buffer>>) {
            let mut outbox =
                Outbox { mailbox: self.clone(), filling, doorbell: self.clone(), telemetry: &self.telemetry };
            assert_eq!(outbox.filling(), &[0; IMAGE_WORDS], "filled over old data");
            self.point();
            outbox.filling().fill(generation);
            self.point();
            self.world.borrow_mut().newest_published = generation;
            outbox.publish();
            self.point();
        }

        /// How many images were scrubbed, and the stuck bits found.
        fn scrub(&self) -> (u32, u32) {
            crate::triple::scrub_waiting(self.clone())
        }

        /// The flight controller reads a whole transaction while nothing else happens.
        fn read(&self, mosi: &[u8]) -> Read {
            self.world.borrow_mut().mosi = mosi.to_vec();
            for what in [Happening::Select, Happening::Deselect] {
                self.world.borrow_mut().happen(what);
                self.interrupt();
            }
            *self.world.borrow().reads.last().expect("a transaction was read")
        }
    }

    impl Mutex for Board {
        type T = Mailbox<Buffer>;

        fn lock<R>(&mut self, with: impl FnOnce(&mut Mailbox<Buffer>) -> R) -> R {
            let before = std::mem::replace(&mut self.world.borrow_mut().masked, true);
            let result = with(&mut self.mailbox.borrow_mut());
            self.world.borrow_mut().masked = before;
            self.interrupt();
            result
        }
    }

    impl Doorbell for Board {
        fn request(&mut self) -> bool {
            self.point();
            let under_way = {
                let mut world = self.world.borrow_mut();
                world.acquire();
                world.pended = true;
                matches!(world.semaphore, Semaphore::Spis | Semaphore::CpuPending)
            };
            self.point();
            under_way
        }

        fn announce(&mut self) {
            self.point();
            {
                let mut world = self.world.borrow_mut();
                world.announced = world.newest_published;
                world.compares = [false; 2];
            }
            self.point();
        }
    }

    impl Port {
        fn point(&self) {
            self.board.as_ref().expect("on the board").point();
        }
    }

    impl Ssi for Port {
        type Buffer = Buffer;

        fn take_events(&mut self) -> Events<'_> {
            self.point();
            let ours = {
                let mut world = self.world.borrow_mut();
                world.acquired = false;
                world.semaphore == Semaphore::Cpu
            };
            self.point();
            let mut world = self.world.borrow_mut();
            let ended = std::mem::take(&mut world.end);
            self.received.clone_from(&world.mosi);
            Events { ours, received: ended.then_some(&self.received), over_read: false, overflow: ended }
        }

        fn is_expired(&mut self) -> bool {
            self.point();
            let expired = self.world.borrow().compares[0];
            self.point();
            expired
        }

        fn exchange<R>(
            &mut self,
            with: impl FnOnce(Option<Received<Buffer, ()>>) -> (Option<Received<Buffer, ()>>, R),
        ) -> R {
            assert_eq!(self.world.borrow().semaphore, Semaphore::Cpu, "the image is being streamed");
            let (image, result) = with(self.image.take());
            self.image = image;
            result
        }

        fn load(&mut self, window: Range<usize>) -> bool {
            assert!(window.end <= LEN);
            let Some(image) = &self.image else { return false };
            let generation = image.memory()[0];
            assert_eq!(image.memory(), &[generation; IMAGE_WORDS], "torn");
            self.world.borrow_mut().loaded = Some(generation);
            true
        }

        fn announce(&mut self) {
            // While the SSI task runs, no newer image can be published than the one that it has taken.
            self.board.clone().expect("on the board").announce();
        }

        fn release(&mut self) {
            self.point();
            let mut world = self.world.borrow_mut();
            assert_eq!(world.semaphore, Semaphore::Cpu);
            world.semaphore = Semaphore::Free;
            drop(world);
            self.point();
        }
    }

    fn happening() -> impl Strategy<Value = Happening> {
        prop_oneof![
            3 => Just(Happening::Nothing),
            4 => Just(Happening::Select),
            4 => Just(Happening::Deselect),
            1 => Just(Happening::Expire),
            1 => Just(Happening::ExpireAgain),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4_000))]
        /// Whatever meets what: a transaction reads the image that FRESH has told of last, whole and in time, or 0xFF;
        /// and once nothing happens any more, the newest image.
        #[test]
        fn a_transaction_reads_the_announced_image_or_nothing(
            happenings in prop::collection::vec(happening(), 0..60), scrubs in prop::collection::vec(any::<bool>(), 6),
        ) {
            let board = Board::new();
            board.world.borrow_mut().happenings = happenings.into();
            let mut filling = None;
            for (generation, scrub) in (1..).zip(scrubs) {
                board.publish(generation, &mut filling);
                if scrub {
                    board.scrub();
                }
            }
            board.world.borrow_mut().happenings.clear();
            board.world.borrow_mut().happen(Happening::Deselect);
            board.interrupt();
            board.scrub();
            board.publish(7, &mut filling);
            prop_assert_eq!(board.read(&[0; 8]), Read::Image(7));
            prop_assert_eq!(board.world.borrow().announced, 7);
            prop_assert_eq!(board.telemetry.scrub_faults.get(), 0);
        }
    }

    #[test]
    fn fresh_rises_before_the_image_is_released() {
        // The flight controller selects at each access in turn: it never reads the new image before FRESH has risen.
        let mut busy = 0;
        for at in 0..20 {
            let board = Board::new();
            let mut filling = None;
            board.publish(1, &mut filling);
            let mut happenings = vec![Happening::Nothing; at];
            happenings.push(Happening::Select);
            board.world.borrow_mut().happenings = happenings.into();
            board.publish(2, &mut filling);
            busy += usize::from(board.world.borrow().reads.contains(&Read::Busy));
        }
        assert!(busy > 0, "some transaction met the image being put in");
    }

    #[test]
    fn an_image_that_is_published_during_a_transaction_is_announced_at_once_and_read_next() {
        let board = Board::new();
        let mut filling = None;
        board.publish(1, &mut filling);
        board.world.borrow_mut().happen(Happening::Select);
        board.publish(2, &mut filling);
        assert_eq!(board.world.borrow().announced, 2);
        board.publish(3, &mut filling);
        assert_eq!(board.world.borrow().announced, 3);
        board.world.borrow_mut().happen(Happening::Deselect);
        board.interrupt();
        assert_eq!(board.read(&[0; 8]), Read::Image(3));
        assert_eq!(board.telemetry.images_readable.get(), 2, "the second one was never put in");
        assert_eq!(board.telemetry.publications.get(), 3);
    }

    #[test]
    fn images_that_nobody_streams_any_more_are_scrubbed_by_the_scrub_task() {
        let board = Board::new();
        assert_eq!(board.scrub(), (IMAGES as u32, 0), "at the start nothing is known of any of them");
        let mut filling = None;
        for generation in 1..=9 {
            board.publish(generation, &mut filling);
            assert_eq!(board.read(&[0; 8]), Read::Image(generation));
            assert_eq!(board.scrub(), (u32::from(generation > 1), 0), "the one before generation {generation}");
        }
    }

    #[test]
    fn an_expired_image_is_not_released_again_and_a_newer_one_is() {
        let board = Board::new();
        let mut filling = None;
        board.publish(1, &mut filling);
        assert_eq!(board.read(&[0; 8]), Read::Image(1));
        board.world.borrow_mut().happen(Happening::Expire);
        board.interrupt();
        assert_eq!(board.telemetry.images_expired.get(), 1);
        assert_eq!(board.read(&[0; 8]), Read::Busy);
        board.publish(2, &mut filling);
        assert_eq!(board.read(&[0; 8]), Read::Image(2));
    }

    #[test]
    fn time_that_runs_out_during_a_transaction_ends_the_image_with_it() {
        let board = Board::new();
        let mut filling = None;
        board.publish(1, &mut filling);
        board.world.borrow_mut().happen(Happening::Select);
        board.world.borrow_mut().happen(Happening::Expire);
        board.world.borrow_mut().happen(Happening::Deselect);
        board.interrupt();
        assert_eq!(board.read(&[0; 8]), Read::Busy);
    }

    #[test]
    fn an_image_that_expires_during_the_transaction_in_which_it_was_announced_is_never_released() {
        let board = Board::new();
        let mut filling = None;
        board.publish(1, &mut filling);
        board.world.borrow_mut().happen(Happening::Select);
        board.publish(2, &mut filling);
        board.world.borrow_mut().happen(Happening::Expire);
        board.world.borrow_mut().happen(Happening::Deselect);
        board.interrupt();
        assert_eq!(board.read(&[0; 8]), Read::Busy);
        board.publish(3, &mut filling);
        assert_eq!(board.read(&[0; 8]), Read::Image(3));
    }

    #[test]
    fn the_same_image_is_released_again_until_the_budget_is_spent_and_the_next_brings_a_new_budget() {
        let board = Board::new();
        let mut filling = None;
        for generation in 1..=2 {
            board.publish(generation, &mut filling);
            for _ in 0..crate::ssi::BUDGET {
                assert_eq!(board.read(&[0; 8]), Read::Image(generation));
            }
            assert_eq!(board.read(&[0; 8]), Read::Busy);
            assert_eq!(board.telemetry.access_violations.get(), generation);
        }
        assert_eq!(board.telemetry.ssi_transactions.get(), 2 * crate::ssi::BUDGET);
        assert_eq!(board.telemetry.ssi_overflows.get(), 2 * crate::ssi::BUDGET);
        assert_eq!(board.telemetry.ssi_over_reads.get(), 0);
    }

    #[test]
    fn a_refused_request_is_counted_and_an_undriven_line_is_not() {
        let board = Board::new();
        board.publish(1, &mut None);
        board.read(&[0xFF; 8]);
        board.read(&encode(Request { offset: 96, length: 60 }));
        assert_eq!(board.telemetry.access_violations.get(), 0);
        board.read(&encode(Request { offset: 96, length: 61 }));
        board.read(&[1, 2, 3]);
        assert_eq!(board.telemetry.access_violations.get(), 2);
    }

    #[test]
    fn before_the_first_image_there_is_nothing_to_read() {
        let board = Board::new();
        board.world.borrow_mut().pended = true;
        board.interrupt();
        assert_eq!(board.read(&[0; 8]), Read::Busy);
    }
}
