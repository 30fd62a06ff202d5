//! Tests the commit and SSI tasks on a model of the SPIS's semaphore, with interruptions at every hardware access.

use std::{cell::RefCell, collections::VecDeque, ops::Range, rc::Rc};

use profile::{
    criticality::{Dpr, Writer},
    map::Map,
    ssi::{encode, Request},
    PortStatus, PortValues, Violation,
};
use proptest::prelude::*;
use rtic_core::Mutex;

use super::*;
use crate::{
    commit::Images,
    hold::Area,
    port::areas::HandedOver,
    ssi::Asked,
    telemetry::Telemetry,
    triple::{Filling, Received, IMAGES},
    IMAGE_WORDS,
};

const LEN: usize = 156;

/// The owner of the SPIS's buffers (PS v1.7, 6.26, SEMSTAT).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Semaphore {
    Free,
    Cpu,
    Spis,
    CpuPending,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Happening {
    Nothing,
    /// The flight controller selects the DPR, unless the DPR is selected already.
    Select,
    /// The flight controller deselects the DPR, and the transaction ends.
    Deselect,
    /// Both compares of the expiry timer come, one after the other.
    Expire,
    ExpireAgain,
    PauseEnd,
}

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
    /// Whether the pause masks END and ACQUIRED, so that they do not call the SSI task.
    paused: bool,
    /// The number of the image that the last release gave to the SPIS.
    loaded: Option<u32>,
    /// The answer that the transaction in progress reads; `None` between transactions.
    selected: Option<Read>,
    /// The bytes that will have come in when the present transaction ends.
    mosi: Vec<u8>,
    /// The number of the newest image for which FRESH has risen.
    announced: u32,
    compares: [bool; 2],
    reads: Vec<Read>,
    masked: bool,
    in_ssi_task: bool,
    happenings: VecDeque<Happening>,
    newest_published: u32,
}

type Buffer = ImageMemory;

/// The hardware, the mailbox and the SSI task of the model. Any task can reach them.
#[derive(Clone)]
struct Board {
    world: Rc<RefCell<World>>,
    mailbox: Rc<RefCell<Mailbox<Buffer>>>,
    task: Rc<RefCell<Option<(Server<LEN>, SsiModel)>>>,
    telemetry: Rc<Telemetry>,
}

struct SsiModel {
    world: Rc<RefCell<World>>,
    image: Option<Received<Buffer, ()>>,
    received: Vec<u8>,
    asked: Vec<Asked>,
    passed_on: usize,
    handed_over: HandedOver,
    /// The board, so that events can happen before and after each access of the SSI task.
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
                    // In hardware, the event END triggers ACQUIRE at this moment, so the processor gets the semaphore.
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
            Happening::PauseEnd => self.paused = self.paused && self.in_ssi_task,
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
            paused: false,
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
        let port = SsiModel {
            world: world.clone(),
            image: None,
            received: vec![],
            asked: vec![],
            passed_on: 0,
            handed_over: HandedOver::Waits,
            board: None,
        };
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

    /// Makes the next event happen in hardware, and then runs the SSI task if it is called.
    fn point(&self) {
        let next = self.world.borrow_mut().happenings.pop_front();
        self.world.borrow_mut().happen(next.unwrap_or(Happening::Nothing));
        self.interrupt();
    }

    fn interrupt(&self) {
        loop {
            {
                let mut world = self.world.borrow_mut();
                let called = (world.end || world.acquired) && !world.paused || world.pended;
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
        let mut outbox = Outbox {
            mailbox: self.clone(),
            filling,
            doorbell: self.clone(),
            port: &Area::EMPTY,
            telemetry: &self.telemetry,
        };
        assert_eq!(outbox.filling(), &[0; IMAGE_WORDS], "filled over old data");
        self.point();
        outbox.filling().fill(generation);
        self.point();
        self.world.borrow_mut().newest_published = generation;
        outbox.publish();
        self.point();
    }

    fn scrub(&self) -> u32 {
        let found = crate::triple::scrub_waiting(self.clone());
        assert_eq!((found.stuck_bits, found.out_of_use), (0, 0));
        found.buffers
    }

    /// Makes a whole transaction and the pause after it, without any other event.
    fn read(&self, mosi: &[u8]) -> Read {
        self.world.borrow_mut().mosi = mosi.to_vec();
        for what in [Happening::Select, Happening::Deselect, Happening::PauseEnd] {
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

impl SsiModel {
    fn point(&self) {
        self.board.as_ref().expect("on the board").point();
    }
}

impl Ssi for SsiModel {
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
        world.paused |= ended;
        self.received.clone_from(&world.mosi);
        Events { ours, received: ended.then_some(&self.received), over_read: false, overflow: ended }
    }

    fn hand_over(&mut self, asked: Asked) -> HandedOver {
        self.asked.push(asked);
        self.handed_over
    }

    fn pass_on(&mut self) {
        self.passed_on += 1;
        assert_eq!(self.passed_on, self.asked.len(), "each transaction once, and after it was taken");
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
        // The image that the SSI task has taken is the newest, since no image can be published while the SSI task runs.
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
        2 => Just(Happening::PauseEnd),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]
    /// Draws longer runs than `tests/interleavings` explores. Each transaction must read 0xFF, or the image that FRESH
    /// announced last, whole and in time. After the last event a transaction must read the newest image.
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
        for what in [Happening::Deselect, Happening::PauseEnd] {
            board.world.borrow_mut().happen(what);
            board.interrupt();
        }
        board.scrub();
        board.publish(7, &mut filling);
        prop_assert_eq!(board.read(&[0; 8]), Read::Image(7));
        prop_assert_eq!(board.world.borrow().announced, 7);
        prop_assert_eq!(board.telemetry.scrub_faults.get(), 0);
    }
}

#[test]
fn fresh_rises_before_the_image_is_released() {
    // The flight controller selects the DPR at a different access in each turn. It must never read the new image before
    // FRESH has risen.
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
fn an_image_published_during_a_transaction_is_read_next() {
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
    assert_eq!(board.scrub(), IMAGES as u32, "at the start nothing is known of any of them");
    let mut filling = None;
    for generation in 1..=9 {
        board.publish(generation, &mut filling);
        assert_eq!(board.read(&[0; 8]), Read::Image(generation));
        assert_eq!(board.scrub(), u32::from(generation > 1), "the one before generation {generation}");
    }
}

#[test]
fn the_next_image_is_scrubbed_before_its_frame_comes() {
    let board = Board::new();
    let mut filling = None;
    board.publish(1, &mut filling);
    let mut outbox = Outbox {
        mailbox: board.clone(),
        filling: &mut filling,
        doorbell: board.clone(),
        port: &Area::EMPTY,
        telemetry: &board.telemetry,
    };
    outbox.prepare();
    let scrubbed = board.telemetry.scrubs.get();
    assert_eq!(scrubbed, 2, "the scrub task has not run: the first image and the prepared one were scrubbed here");
    assert_eq!(outbox.filling(), &[0; IMAGE_WORDS]);
    assert_eq!(board.telemetry.scrubs.get(), scrubbed, "nothing is left to do when the frame comes");
    assert_eq!(board.scrub(), 2, "of four, one is streamed and one is to be filled");
}

// Shows IMG-5.
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
fn an_image_announced_and_expired_within_a_transaction_is_never_read() {
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

// Shows WAY-3.
#[test]
fn an_image_is_read_until_its_budget_of_transactions_is_spent() {
    let board = Board::new();
    let mut filling = None;
    for generation in 1..=2 {
        board.publish(generation, &mut filling);
        for _ in 0..crate::ssi::BUDGET {
            assert_eq!(board.read(&[0; 8]), Read::Image(generation));
        }
        assert_eq!(board.read(&[0; 8]), Read::Busy);
        assert_eq!(board.telemetry.ssi_budgets_spent.get(), generation);
    }
    assert_eq!(board.telemetry.ssi_transactions.get(), 2 * crate::ssi::BUDGET);
    assert_eq!(board.telemetry.ssi_overflows.get(), 2 * crate::ssi::BUDGET);
    assert_eq!(board.telemetry.ssi_over_reads.get(), 0);
}

#[test]
fn a_transaction_that_ends_within_the_pause_is_served_after_it() {
    for publishes in [false, true] {
        let board = Board::new();
        let mut filling = None;
        board.publish(1, &mut filling);
        let happens = |what| {
            board.world.borrow_mut().happen(what);
            board.interrupt();
            (board.telemetry.ssi_transactions.get(), board.world.borrow().reads.last().copied())
        };
        for what in [Happening::Select, Happening::Deselect] {
            happens(what);
        }
        assert_eq!(happens(Happening::Select), (1, Some(Read::Image(1))), "it is granted");
        assert_eq!(happens(Happening::Deselect).0, 1, "its end waits");
        assert_eq!(happens(Happening::Select), (1, Some(Read::Busy)), "meanwhile nothing is granted");
        happens(Happening::Deselect);
        let newest = if publishes {
            board.publish(2, &mut filling);
            2
        } else {
            happens(Happening::PauseEnd);
            1
        };
        assert_eq!(happens(Happening::Select), (2, Some(Read::Image(newest))));
    }
}

#[test]
fn what_a_transaction_asked_for_is_handed_over_with_what_it_brought() {
    let board = Board::new();
    board.publish(1, &mut None);
    board.read(&[0xFF; 8]);
    board.read(&encode(Request { offset: 96, length: 60 }));
    board.read(&encode(Request { offset: 96, length: 61 }));
    board.read(&[1, 2, 3]);
    let task = board.task.borrow();
    let (_, port) = task.as_ref().expect("not running");
    let outside = Asked::Refused(Violation::WindowOutside);
    assert_eq!(port.asked, [Asked::Nothing, Asked::Window, outside, Asked::Short]);
    assert_eq!(board.telemetry.ssi_objects_dropped.get(), 0);
}

#[test]
fn only_a_dropped_object_that_is_not_idle_is_counted() {
    for (handed_over, count) in
        [(HandedOver::Waits, 0), (HandedOver::Empty, 0), (HandedOver::Dropped, 1), (HandedOver::DroppedIdle, 0)]
    {
        let board = Board::new();
        board.task.borrow_mut().as_mut().expect("not running").1.handed_over = handed_over;
        board.publish(1, &mut None);
        board.read(&[0; 8]);
        assert_eq!(board.telemetry.ssi_objects_dropped.get(), count, "{handed_over:?}");
    }
}

#[test]
fn port_status_and_uplinks_lie_behind_the_image_in_the_buffer() {
    let board = Board::new();
    let mut area = Area::EMPTY;
    let values = PortValues { timestamp: 77, ..PortValues::default() };
    area.port.set_status(Writer::<Dpr>::claim(), PortStatus::seal(Writer::<Dpr>::claim(), &values));
    let mut filling = None;
    let mut outbox = Outbox {
        mailbox: board.clone(),
        filling: &mut filling,
        doorbell: board.clone(),
        port: &area,
        telemetry: &board.telemetry,
    };
    outbox.place_port::<3>();
    let map: &[u8] = bytemuck::cast_slice(outbox.filling());
    let reading = Map::<3>::read(&map[..Map::<3>::LEN]).expect("the length is right");
    assert_eq!(reading.port.status.expect("Port-Status is intact").values(), values);
    assert!(map[..276].iter().chain(&map[468..]).all(|&byte| byte == 0));
}

#[test]
fn before_the_first_image_there_is_nothing_to_read() {
    let board = Board::new();
    board.world.borrow_mut().pended = true;
    board.interrupt();
    assert_eq!(board.read(&[0; 8]), Read::Busy);
}
