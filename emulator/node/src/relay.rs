//! Two boards of which one only speaks and the other only hears.
//!
//! Nothing ever comes back to the first board, so what it does depends on itself and on what stands beside it alone. It
//! may run on a thread of its own, ahead of the second board, and sends every message with its instant. The second
//! board enters a millisecond of virtual time only once the first has left it, and hears a message a fixed virtual time
//! ahead, which the listener of a message has to bear. What either does follows from virtual instants alone and never
//! from which thread came first, so a run is a function of its inputs.
//!
//! The caller describes what stands beside the first board in an [`Upstream`] (receivers on its lines), and what stands
//! beside the second in a [`Downstream`] (a flight controller).

use std::collections::VecDeque;
use std::sync::mpsc;

use cortex_m4::{Cost, Fast};

use super::{Board, Node};

/// The boards enter time in pieces of this, virtual ns.
const PIECE: u64 = 1_000_000;

/// How far ahead of its instant a message is heard at most, virtual ns.
const HEARD_AHEAD: u64 = 1_000_000;

/// How many pieces the first board may be ahead on its own thread: enough that neither waits for the other's bursts of
/// work, few enough that what waits stays small.
const LEAD: usize = 50;

/// What stands beside the first board, and takes what leaves it.
pub trait Upstream<A: Board, C: Cost = Fast>: Send {
    /// What leaves the board.
    type Message: Send;

    /// What is told of the board beside its messages: its log, a trace.
    type Notes: Send;

    /// Takes what left the board up to its present, each with its instant (virtual ns), in order of time.
    fn leave(&mut self, node: &mut Node<A, C>, sent: &mut Vec<(u64, Self::Message)>);

    /// What is to be told of the board since the last call; called at least once a millisecond of virtual time.
    fn notes(&mut self, node: &mut Node<A, C>) -> Self::Notes;

    /// The next instant an actor beside the board acts on it (virtual ns), `u64::MAX` for never.
    fn next_at(&self) -> u64 {
        u64::MAX
    }

    /// The actor acts, due at `at`. [`Upstream::next_at`] must move on.
    fn act(&mut self, at: u64, node: &mut Node<A, C>) {
        let _ = (at, node);
    }
}

/// What stands beside the second board, and brings it what left the first.
pub trait Downstream<B: Board, C: Cost = Fast> {
    /// What left the first board.
    type Message;

    /// What is told of the first board beside its messages.
    type Notes;

    /// `message` left the first board at `at` (virtual ns), which the second may not have reached yet.
    fn hear(&mut self, at: u64, message: Self::Message, node: &mut Node<B, C>);

    /// `notes` were made of the first board, which may be far ahead.
    fn noted(&mut self, notes: Self::Notes);

    /// Takes what left the second board. It reaches nobody's board.
    fn leave(&mut self, node: &mut Node<B, C>) {
        let _ = node;
    }

    /// The next instant an actor beside the board acts on it (virtual ns), `u64::MAX` for never.
    fn next_at(&self) -> u64 {
        u64::MAX
    }

    /// The actor acts, due at `at`. [`Downstream::next_at`] must move on.
    fn act(&mut self, at: u64, node: &mut Node<B, C>) {
        let _ = (at, node);
    }
}

/// On how many threads a [`Relay`] runs. What comes of it is the same, byte for byte.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// The caller's alone.
    One,
    /// One for each board.
    #[default]
    Two,
}

/// What the first board tells the second of a piece of time.
#[derive(Debug)]
struct Told<M, N> {
    sent: Vec<(u64, M)>,
    notes: N,
    /// The board has left everything before this instant.
    reached: u64,
    /// It has reached the end of the run.
    ended: bool,
}

/// Two boards and what stands beside each. Between two runs nothing is on its way, so a clone is a whole bench.
#[derive(Clone, Debug)]
pub struct Relay<A: Board, B: Board, U, D, C: Cost = Fast> {
    /// The board that speaks.
    pub a: Node<A, C>,
    /// The board that hears.
    pub b: Node<B, C>,
    /// What stands beside the first board.
    pub upstream: U,
    /// What stands beside the second board.
    pub downstream: D,
}

impl<A: Board, B: Board, U, D, C: Cost> Relay<A, B, U, D, C>
where
    U: Upstream<A, C>,
    D: Downstream<B, C, Message = U::Message, Notes = U::Notes>,
{
    /// Runs both boards to `end` (virtual ns), or to the first instruction boundary after it. Whenever the second board
    /// has come another `step` of virtual time, and at the end, `each` is called with the instant, it and its
    /// surroundings. What comes of it does not depend on where runs end and `threads`. A board with breakpoints is run
    /// by [`Relay::run_course`] instead: halted, it would end this run with messages on their way.
    ///
    /// # Errors
    ///
    /// What `each` answers, which ends the run.
    pub fn run<E>(
        &mut self,
        end: u64,
        step: u64,
        threads: Threads,
        each: impl FnMut(u64, &mut Node<B, C>, &mut D) -> Result<(), E>,
    ) -> Result<(), E> {
        let Self { a, b, upstream, downstream } = self;
        let mut lead = Lead { sent: Vec::new(), to: None };
        match threads {
            Threads::One => follow(b, downstream, end, step, || lead.piece(a, upstream, end), each),
            Threads::Two => {
                let (tell, told) = mpsc::sync_channel(LEAD);
                std::thread::scope(|threads| {
                    threads.spawn(move || {
                        while let Some(told) = lead.piece(a, upstream, end) {
                            let ended = told.ended;
                            if tell.send(told).is_err() || ended {
                                return;
                            }
                        }
                    });
                    // The receiver is dropped when this returns, which ends the other thread.
                    follow(b, downstream, end, step, move || told.recv().ok(), each)
                })
            }
        }
    }

    /// Runs both boards on along `course`, on the caller's thread, to the end of its next step or to where a board's
    /// debugger halts it ([`Node::halted`]). Both boards then stand still, and go on by the next call once the halted
    /// one is resumed. What comes of it is what [`Relay::run`] makes of the same boards without debuggers.
    pub fn run_course(&mut self, course: &mut Course<U::Message>) -> Way {
        let Self { a, b, upstream, downstream } = self;
        let Course { lead, follower, end, step } = course;
        follower.step(b, downstream, *end, *step, || lead.piece(a, upstream, *end))
    }
}

/// A [`Relay`]'s way through time that can be interrupted anywhere: what is on its way between the boards.
#[derive(Clone, Debug)]
pub struct Course<M> {
    lead: Lead<M>,
    follower: Follower<M>,
    end: u64,
    step: u64,
}

impl<M> Course<M> {
    /// From `from` to `end` in steps of `step`, all virtual ns.
    #[must_use]
    pub fn new(from: u64, end: u64, step: u64) -> Self {
        Self { lead: Lead { sent: Vec::new(), to: None }, follower: Follower::new(from), end, step }
    }

    /// Whether its end is reached.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.follower.at >= self.end
    }
}

/// How far a relay came, see [`Relay::run_course`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The second board reached the end of a step, this instant (virtual ns).
    Reached(u64),
    /// A board is halted.
    Halted,
}

/// The first board's way through time.
#[derive(Clone, Debug)]
struct Lead<M> {
    sent: Vec<(u64, M)>,
    /// The end of the piece that it is in.
    to: Option<u64>,
}

impl<M> Lead<M> {
    /// Runs the first board through its next piece of time; `None` where its debugger halted it in it.
    fn piece<A: Board, C: Cost, U: Upstream<A, C, Message = M>>(
        &mut self,
        node: &mut Node<A, C>,
        upstream: &mut U,
        end: u64,
    ) -> Option<Told<M, U::Notes>> {
        let to = *self.to.get_or_insert(((node.now() / PIECE + 1) * PIECE).min(end));
        loop {
            if node.halted().is_some() {
                return None;
            }
            if node.board().outgoing() {
                upstream.leave(node, &mut self.sent);
            }
            let (now, next) = (node.now(), upstream.next_at());
            if next <= now {
                node.note_late(next, "an actor");
                upstream.act(next, node);
            } else if now >= to {
                self.to = None;
                let sent = std::mem::take(&mut self.sent);
                return Some(Told { sent, notes: upstream.notes(node), reached: now, ended: now >= end });
            } else {
                node.advance(to.min(next));
            }
        }
    }
}

/// Runs the second board to `end`, or to where its debugger or the first board's halts.
fn follow<B: Board, C: Cost, D: Downstream<B, C>, E>(
    node: &mut Node<B, C>,
    downstream: &mut D,
    end: u64,
    step: u64,
    mut tell: impl FnMut() -> Option<Told<D::Message, D::Notes>>,
    mut each: impl FnMut(u64, &mut Node<B, C>, &mut D) -> Result<(), E>,
) -> Result<(), E> {
    // Steps lie on one grid wherever runs end, also where a board has gone on to the end of an instruction.
    let mut follower = Follower::new(node.now() / step * step);
    while follower.at < end {
        let Way::Reached(at) = follower.step(node, downstream, end, step, &mut tell) else { break };
        each(at, node, downstream)?;
    }
    Ok(())
}

/// The second board's way through time.
#[derive(Clone, Debug)]
struct Follower<M> {
    /// What left the first board and is not heard yet.
    on_the_way: VecDeque<(u64, M)>,
    /// How far the first board is known to have come, and whether it has ended.
    reached: u64,
    ended: bool,
    /// The end of the last step that is complete.
    at: u64,
}

impl<M> Follower<M> {
    fn new(at: u64) -> Self {
        Self { on_the_way: VecDeque::new(), reached: 0, ended: false, at }
    }

    /// Runs the second board to the end of its next step. `tell` answers what the first board says next, or `None`
    /// where that is halted; the step then goes on with the next call, as it does where the second board is halted.
    fn step<B: Board, C: Cost, D: Downstream<B, C, Message = M>>(
        &mut self,
        node: &mut Node<B, C>,
        downstream: &mut D,
        end: u64,
        step: u64,
        mut tell: impl FnMut() -> Option<Told<M, D::Notes>>,
    ) -> Way {
        let to = (self.at + step).min(end);
        loop {
            if node.halted().is_some() {
                return Way::Halted;
            }
            if node.board().outgoing() {
                downstream.leave(node);
            }
            let (now, next) = (node.now(), downstream.next_at());
            if next <= now {
                node.note_late(next, "an actor");
                downstream.act(next, node);
                continue;
            }
            if now >= to {
                break;
            }
            let piece = (now / PIECE + 1) * PIECE;
            let left = (piece + HEARD_AHEAD).min(end);
            while self.reached < left && !self.ended {
                let Some(told) = tell() else { return Way::Halted };
                self.hear(told, downstream);
            }
            while let Some((at, message)) = self.on_the_way.pop_front_if(|(at, _)| *at <= now + HEARD_AHEAD) {
                node.note_late(at, "a message");
                downstream.hear(at, message, node);
            }
            let unheard = self.on_the_way.front().map_or(u64::MAX, |(at, _)| at - HEARD_AHEAD);
            // What was heard may have brought something that is due before what was.
            let next = downstream.next_at();
            node.advance(to.min(next).min(piece).min(unheard));
        }
        if to == end {
            // What the first board said after the last that the second had to wait for, and what comes after the end.
            while !self.ended {
                let Some(told) = tell() else { return Way::Halted };
                self.hear(told, downstream);
            }
            for (at, message) in self.on_the_way.drain(..) {
                node.note_late(at, "a message");
                downstream.hear(at, message, node);
            }
        }
        self.at = to;
        Way::Reached(to)
    }

    /// The first board says this.
    fn hear<B: Board, C: Cost, D: Downstream<B, C, Message = M>>(
        &mut self,
        told: Told<M, D::Notes>,
        downstream: &mut D,
    ) {
        self.on_the_way.extend(told.sent);
        downstream.noted(told.notes);
        (self.reached, self.ended) = (told.reached, told.ended);
    }
}
