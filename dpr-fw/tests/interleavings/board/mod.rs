//! The firmware's tasks on the model of the hardware, with RTIC's priorities: a task that becomes ready runs to its end
//! at once, unless a lock masks it or a task of the same or a higher priority runs.
//!
//! The tasks call the library as `main.rs` does, and the ports make the same register accesses as `hw/ssi.rs`, in the
//! same order. Before each access and each critical section is a *point*. At a point, events of the hardware may happen
//! any number of times, and tasks that become ready run.

mod buffer;
mod port;
mod tasks;

use std::{
    cell::{Cell, RefCell},
    fmt,
    rc::Rc,
};

use dpr_fw::{
    publish::{Mailbox, Server},
    telemetry::Telemetry,
    triple::{scrub_waiting, Filling, Received, Rotation},
};
use rtic_core::Mutex;

use super::{
    explorer::{digest, digest_shown, holds, Explorer},
    hardware::{Hardware, Semaphore, Step, BUFFERS, RECEIVE},
    Bounds, LEN,
};
use buffer::Buffer;
use port::SsiModel;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Task {
    Idle = 0,
    Scrub = 2,
    Commit = 3,
    Receive = 4,
    Ssi = 5,
}

/// The priority ceilings of the locks on the mailbox and on the rotation. A ceiling is the highest priority among the
/// tasks that share the resource.
const ROTATION_CEILING: u8 = Task::Receive as u8;
const MAILBOX_CEILING: u8 = Task::Ssi as u8;

/// The indices of the digests of five pieces of state, each of which a task may hold.
const MAILBOX: usize = 0;
const ROTATION: usize = 1;
const SSI: usize = 2;
const RECEIVING: usize = 3;
const FILLING: usize = 4;

/// A task that runs or is interrupted. Its local variables follow from the state in which it began, from how far it has
/// run, and from what it has seen of shared state. So a digest of these three stands for the variables.
struct Frame {
    task: Task,
    seen: u64,
    /// Whether the task has scrubbed a buffer since it last held a lock.
    scrubbed: bool,
}

#[derive(Clone, Copy, Debug, Default, Hash)]
struct Called {
    ssi: bool,
    receive: Option<bool>,
    commit: bool,
    scrub: bool,
}

struct Board {
    explorer: Rc<Explorer>,
    bounds: Bounds,
    hw: RefCell<Hardware>,
    called: Cell<Called>,
    /// The priority up to which BASEPRI masks interrupts.
    mask: Cell<u8>,
    frames: RefCell<Vec<Frame>>,
    rotation: RefCell<Option<Rotation<Buffer, u8>>>,
    mailbox: RefCell<Option<Mailbox<Buffer>>>,
    ssi: RefCell<Option<(Server<LEN>, SsiModel)>>,
    receiving: RefCell<Option<Filling<Buffer>>>,
    filling: RefCell<Option<Filling<Buffer>>>,
    telemetry: Telemetry,
    /// The digests of the five pieces of state, kept here because a state cannot be read while a task holds it.
    digests: Cell<[u64; 5]>,
    /// The frames that were handed on to the commit task and not read yet.
    handed: RefCell<Vec<u8>>,
    generation: Cell<u8>,
    /// With [`Mutation::RotationOrder`] the task reads the newer of two frames first. This is the older frame, which it
    /// reads afterwards.
    put_by: RefCell<Option<Received<Buffer, u8>>>,
}

/// The board for one run of the search. Its buffers refer to the board, so they are taken out when the run ends.
pub(crate) struct OneRun(At);

impl Drop for OneRun {
    fn drop(&mut self) {
        let board = &*self.0 .0;
        board.rotation.take();
        board.mailbox.take();
        board.ssi.take();
        board.receiving.take();
        board.filling.take();
        board.put_by.take();
    }
}

impl OneRun {
    pub(crate) fn new(explorer: Rc<Explorer>, bounds: Bounds) -> Self {
        Self(At::new(explorer, bounds))
    }

    pub(crate) fn run(&self) {
        self.0.run();
    }
}

/// A reference to the board, which also locks the mailbox.
#[derive(Clone)]
struct At(Rc<Board>);

/// A reference to the board that locks the rotation of the receive buffers.
struct RotationOf(At);

impl At {
    fn new(explorer: Rc<Explorer>, bounds: Bounds) -> Self {
        let at = Self(Rc::new(Board {
            explorer,
            bounds,
            hw: RefCell::new(Hardware::new(&bounds)),
            called: Cell::default(),
            mask: Cell::new(u8::MAX),
            frames: RefCell::new(vec![]),
            rotation: RefCell::default(),
            mailbox: RefCell::default(),
            ssi: RefCell::default(),
            receiving: RefCell::default(),
            filling: RefCell::default(),
            telemetry: Telemetry::new(),
            digests: Cell::default(),
            handed: RefCell::default(),
            generation: Cell::new(0),
            put_by: RefCell::default(),
        }));
        let buffer = |place| Buffer::new(place, at.clone());
        let (filling, rotation, _) = Rotation::new(std::array::from_fn(buffer));
        let mailbox = Mailbox::new(std::array::from_fn(|image| buffer(RECEIVE + image)));
        *at.0.receiving.borrow_mut() = Some(filling);
        *at.0.rotation.borrow_mut() = Some(rotation);
        *at.0.mailbox.borrow_mut() = Some(mailbox);
        *at.0.ssi.borrow_mut() = Some((Server::new(), SsiModel::new(at.clone())));
        scrub_waiting(at.clone());
        at.0.mask.set(0);
        at
    }

    fn run(&self) {
        self.call(|called| called.commit = self.0.bounds.publishes);
        loop {
            self.interrupts();
            self.point("idle");
            let called = self.0.called.get();
            let hw = self.0.hw.borrow();
            let waits = called.ssi || called.receive.is_some() || called.commit || called.scrub;
            let comes = match &*hw {
                hw if hw.ending => Some(Step::Shortcut),
                hw if hw.pause_runs => Some(Step::PauseEnd),
                _ => None,
            };
            drop(hw);
            match comes {
                Some(step) => self.happen(step),
                None if waits => {}
                None => break,
            }
        }
        self.at_rest();
    }

    /// Checks, when no task is ready, that no frame, pause, faulty buffer or newest image was left behind.
    fn at_rest(&self) {
        let hw = self.0.hw.borrow();
        holds(!hw.masked, "a pause has no end");
        holds(self.0.handed.borrow().is_empty(), "a frame that was handed on is never read");
        let out_of_use = self.0.telemetry.buffers_out_of_use.get();
        let found = u32::from(hw.found.is_some());
        holds(out_of_use == found, "a buffer with a stuck bit stays in use");
        if hw.transaction.is_some() || hw.published == 0 {
            return;
        }
        if hw.expired == Some(0) {
            holds(hw.announced == hw.published, "FRESH never tells of the newest image");
            holds(hw.semaphore == Semaphore::Free, "the newest image is not readable");
            let (image, _) = hw.txd.expect("the semaphore was released");
            let newest = [u32::from(hw.published); 2];
            holds(hw.ram[image] == newest || hw.held_back[image].is_some(), "what is readable is not the newest image");
        }
    }

    fn call(&self, with: impl FnOnce(&mut Called)) {
        let mut called = self.0.called.get();
        with(&mut called);
        self.0.called.set(called);
    }

    /// Records that the running task has seen the value `what` of the shared state.
    fn see(&self, what: impl std::hash::Hash) {
        if let Some(frame) = self.0.frames.borrow_mut().last_mut() {
            frame.seen = self.0.explorer.remember(|| digest((frame.seen, what)));
        }
    }

    /// Records that the next steps of the running task depend on `what`, and on nothing else that the task has seen.
    fn forget_all_but(&self, what: impl std::hash::Hash) {
        if let Some(frame) = self.0.frames.borrow_mut().last_mut() {
            frame.seen = self.0.explorer.remember(|| digest(what));
        }
    }

    fn state(&self) -> u64 {
        let board = &*self.0;
        let frames: Vec<_> =
            board.frames.borrow().iter().map(|frame| (frame.task, frame.seen, frame.scrubbed)).collect();
        digest((
            &*board.hw.borrow(),
            (board.called.get(), board.mask.get(), board.digests.get()),
            (frames, &*board.handed.borrow(), board.generation.get()),
        ))
    }

    /// Records that the running task locks a resource. What the scrub task saw before the lock no longer matters: it
    /// gives its buffer back now, and no other code holds the buffer that it takes next.
    fn see_resource(&self, index: usize) {
        let shared = self.0.digests.get()[index];
        if let Some(frame) = self.0.frames.borrow_mut().last_mut() {
            frame.seen = match frame.task {
                Task::Scrub => {
                    let scrubbed = std::mem::take(&mut frame.scrubbed);
                    self.0.explorer.remember(|| digest((index, scrubbed)))
                }
                _ => self.0.explorer.remember(|| digest((frame.seen, shared))),
            };
        }
    }

    fn redigest<T: fmt::Debug>(&self, index: usize, of: &T) {
        let mut digests = self.0.digests.get();
        digests[index] = self.0.explorer.remember(|| digest_shown(of));
        self.0.digests.set(digests);
    }

    fn is_active(&self, task: Task) -> bool {
        self.0.frames.borrow().iter().any(|frame| frame.task == task)
    }

    /// A point of a task at which any event of the hardware may happen, any number of times.
    fn point(&self, name: &'static str) {
        if self.0.mask.get() == u8::MAX {
            return;
        }
        self.see(name);
        loop {
            let mut steps = [None; 16 + BUFFERS];
            let mut of = 1;
            let receiver_runs = self.is_active(Task::Receive) || self.0.called.get().receive.is_some();
            self.0.hw.borrow().steps(self.level(), receiver_runs, &self.0.bounds, |step| {
                steps[of] = Some(step);
                of += 1;
            });
            let taken = self.0.explorer.choose(of, || self.state());
            let Some(step) = steps[taken] else { break };
            self.happen(step);
        }
        self.0.explorer.note(name);
    }

    fn happen(&self, step: Step) {
        self.0.explorer.note(step.name());
        self.0.hw.borrow_mut().happen(step, self.0.bounds.mutation, self.is_active(Task::Ssi));
        match step {
            Step::FrameEnd => self.call(|called| called.receive = Some(true)),
            Step::FrameLost => self.call(|called| called.receive = Some(false)),
            Step::Deadline => self.call(|called| called.commit = true),
            _ => {}
        }
        self.interrupts();
    }

    /// Returns the priority above which a called task runs at once.
    fn level(&self) -> u8 {
        let running = self.0.frames.borrow().last().map_or(Task::Idle, |frame| frame.task);
        self.0.mask.get().max(running as u8)
    }

    fn interrupts(&self) {
        loop {
            let level = self.level();
            let called = self.0.called.get();
            let hw = self.0.hw.borrow();
            let by_event = (hw.end || hw.acquired) && !hw.masked;
            let (pause_runs, pause_over) = (hw.pause_runs, hw.pause_over);
            drop(hw);
            if (called.ssi || by_event) && level < Task::Ssi as u8 {
                holds(called.ssi || !pause_runs, "the end of a transaction calls the task within the pause");
                self.call(|called| called.ssi = false);
                self.enter(Task::Ssi, Self::ssi_end);
            } else if pause_over && level < Task::Ssi as u8 {
                // The task `ssi_pause` has the priority of `ssi_end`, and comes after it in the table of vectors. Both
                // accesses of `ssi_pause` make one step, because an event between them has the same effect as before
                // the first.
                self.0.explorer.note("ssi_pause: END and ACQUIRED are not masked");
                let mut hw = self.0.hw.borrow_mut();
                (hw.pause_over, hw.masked) = (false, false);
            } else if let (Some(whole), true) = (called.receive, level < Task::Receive as u8) {
                self.call(|called| called.receive = None);
                self.enter(Task::Receive, |at| at.receive(whole));
            } else if called.commit && level < Task::Commit as u8 {
                self.call(|called| called.commit = false);
                self.enter(Task::Commit, Self::commit);
            } else if called.scrub && level < Task::Scrub as u8 {
                self.call(|called| called.scrub = false);
                self.enter(Task::Scrub, Self::scrub);
            } else {
                return;
            }
        }
    }

    fn enter(&self, task: Task, run: impl FnOnce(&Self)) {
        let name = match task {
            Task::Ssi => "> ssi_end",
            Task::Receive => "> receive",
            Task::Commit => "> commit",
            Task::Scrub | Task::Idle => "> scrub",
        };
        self.0.explorer.note(name);
        self.0.frames.borrow_mut().push(Frame { task, seen: 0, scrubbed: false });
        run(self);
        self.0.frames.borrow_mut().pop();
        self.0.explorer.note("<");
    }

    fn lock<T: fmt::Debug, R>(
        &self,
        index: usize,
        ceiling: u8,
        of: &RefCell<Option<T>>,
        with: impl FnOnce(&mut T) -> R,
    ) -> R {
        self.point("lock");
        let before = self.0.mask.get();
        self.0.mask.set(before.max(ceiling));
        self.see_resource(index);
        let result = with(of.borrow_mut().as_mut().expect("it is there until the end"));
        self.redigest(index, &*of.borrow());
        self.0.mask.set(before);
        self.interrupts();
        result
    }
}

impl fmt::Debug for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the board")
    }
}

impl Mutex for At {
    type T = Mailbox<Buffer>;

    fn lock<R>(&mut self, with: impl FnOnce(&mut Mailbox<Buffer>) -> R) -> R {
        At::lock(self, MAILBOX, MAILBOX_CEILING, &self.0.mailbox, with)
    }
}

impl Mutex for RotationOf {
    type T = Rotation<Buffer, u8>;

    fn lock<R>(&mut self, with: impl FnOnce(&mut Rotation<Buffer, u8>) -> R) -> R {
        self.0.lock(ROTATION, ROTATION_CEILING, &self.0 .0.rotation, with)
    }
}
