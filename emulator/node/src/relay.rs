//! Two boards, one of which only sends and the other only receives.
//!
//! Nothing passes back to the first board, so it may run on its own thread, ahead of the second board. The second board
//! begins a millisecond of virtual time only after the first has completed it. The second board learns of a message a
//! fixed virtual time ahead of the message's instant. The [`Downstream`] must allow for this. A run depends only on
//! virtual instants, and never on the order of threads.
//!
//! The caller describes what is beside the first board in an [`Upstream`] (receivers on its lines), and what is beside
//! the second in a [`Downstream`] (a flight controller).

use std::collections::VecDeque;
use std::sync::{Mutex, mpsc};

use cortex_m4::{Cost, Fast};

use super::{Board, Node};

/// The length, virtual ns, of the pieces of time in which each board runs.
const PIECE: u64 = 1_000_000;

/// The longest time, virtual ns, by which a message is passed on ahead of its instant.
const HEARD_AHEAD: u64 = 1_000_000;

/// The number of pieces that the first board, on its own thread, may be ahead. It is large enough that neither thread
/// waits when the other is slow for a moment, and small enough that little data is stored.
const LEAD: usize = 50;

/// The surroundings of the first board, from which messages leave.
pub trait Upstream<A: Board, C: Cost = Fast>: Send {
    /// A message that leaves the board.
    type Message: Send;

    /// Other reports about the board, such as its log or a trace.
    type Notes: Send;

    /// Adds what left the board to `sent`, each message with its instant (virtual ns), in order of time.
    fn leave(&mut self, node: &mut Node<A, C>, sent: &mut Vec<(u64, Self::Message)>);

    /// Takes the other reports since the last call. It is called at least once in a millisecond of virtual time.
    fn notes(&mut self, node: &mut Node<A, C>) -> Self::Notes;

    /// The next instant (virtual ns) at which an actor beside the board acts on it, `u64::MAX` for never.
    fn next_at(&self) -> u64 {
        u64::MAX
    }

    /// Lets the actor act at `at`. [`Upstream::next_at`] must return a later instant afterwards.
    fn act(&mut self, at: u64, node: &mut Node<A, C>) {
        let _ = (at, node);
    }
}

/// The surroundings of the second board, at which messages arrive.
pub trait Downstream<B: Board, C: Cost = Fast> {
    /// A message that left the first board.
    type Message;

    /// Other reports about the first board.
    type Notes;

    /// Receives `message`, which left the first board at `at` (virtual ns). The second board may not have reached `at`
    /// yet.
    fn hear(&mut self, at: u64, message: Self::Message, node: &mut Node<B, C>);

    /// Receives the other reports about the first board, which may be far ahead.
    fn noted(&mut self, notes: Self::Notes);

    /// Takes what left the second board.
    fn leave(&mut self, node: &mut Node<B, C>) {
        let _ = node;
    }

    /// The next instant (virtual ns) at which an actor beside the board acts on the board, `u64::MAX` for never.
    fn next_at(&self) -> u64 {
        u64::MAX
    }

    /// Lets the actor act at `at`. [`Downstream::next_at`] must return a later instant afterwards.
    fn act(&mut self, at: u64, node: &mut Node<B, C>) {
        let _ = (at, node);
    }
}

/// The number of threads of a [`Relay`]. It does not change the results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// The caller's thread only.
    One,
    /// One thread for each board.
    #[default]
    Two,
}

/// The report of the first board about one piece of time.
#[derive(Clone, Debug)]
struct Interval<M, N> {
    sent: Vec<(u64, M)>,
    notes: N,
    /// The instant before which the board has sent all its messages.
    reached: u64,
}

/// Two boards and their surroundings. Between two runs no message is on the way, so a clone is complete.
#[derive(Clone, Debug)]
pub struct Relay<A: Board, B: Board, U, D, C: Cost = Fast> {
    /// The board that sends.
    pub a: Node<A, C>,
    /// The board that receives.
    pub b: Node<B, C>,
    /// What is beside the first board.
    pub upstream: U,
    /// What is beside the second board.
    pub downstream: D,
}

impl<A: Board, B: Board, U, D, C: Cost> Relay<A, B, U, D, C>
where
    U: Upstream<A, C>,
    D: Downstream<B, C, Message = U::Message, Notes = U::Notes>,
{
    /// Runs both boards to `end` (virtual ns), or to the first instruction boundary after it. `each` is called after
    /// every `step` of virtual time and at the end, with the instant, the second board and its surroundings. The
    /// results do not depend on `threads` or on where runs end. Boards with breakpoints need [`Relay::run_course`],
    /// since a halt would end this run with messages under way.
    ///
    /// # Errors
    ///
    /// Returns the error of `each`. Such an error ends the run.
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
                            let ended = told.reached >= end;
                            if tell.send(told).is_err() || ended {
                                return;
                            }
                        }
                    });
                    // When this function returns, it drops the receiver of the channel. This ends the other thread.
                    follow(b, downstream, end, step, move || told.recv().ok(), each)
                })
            }
        }
    }

    /// Runs the second board to `end` (virtual ns), as [`Relay::run`] does, behind `leader` in place of the first
    /// board, which stands still. `heard` is the number of the leader's reports that this relay has heard: 0 where the
    /// leader was made, and what the last call left afterwards.
    ///
    /// # Errors
    ///
    /// Returns the error of `each`. Such an error ends the run.
    ///
    /// # Panics
    ///
    /// Panics unless `end` is a multiple of a millisecond. The leader's reports end there, whatever relay is behind it.
    pub fn run_behind<E>(
        &mut self,
        leader: &Mutex<Leader<A, U, C>>,
        heard: &mut usize,
        (end, step): (u64, u64),
        each: impl FnMut(u64, &mut Node<B, C>, &mut D) -> Result<(), E>,
    ) -> Result<(), E>
    where
        U::Message: Clone,
        U::Notes: Clone,
    {
        assert!(end.is_multiple_of(PIECE), "a run behind a leader ends at a multiple of a millisecond");
        let tell = || {
            let told = leader.lock().expect("no relay behind the leader has panicked").report(*heard)?;
            *heard += 1;
            Some(told)
        };
        follow(&mut self.b, &mut self.downstream, end, step, tell, each)
    }

    /// Runs both boards along `course`, on the caller's thread, to the end of its next step or to the halt of a board
    /// by its debugger ([`Node::halted`]). After a halt both boards stand still, and the next call continues when the
    /// halted board has been resumed. Halts do not change the results.
    pub fn run_course(&mut self, course: &mut Course<U::Message>) -> Way {
        let Self { a, b, upstream, downstream } = self;
        let Course { lead, follower, end, step } = course;
        follower.step(b, downstream, *end, *step, &mut || lead.piece(a, upstream, *end))
    }
}

/// The first board of a [`Relay`] with its surroundings, which runs once for all clones of that relay whose first
/// boards would do the same ([`Relay::run_behind`]).
#[derive(Debug)]
pub struct Leader<A: Board, U: Upstream<A, C>, C: Cost = Fast> {
    node: Node<A, C>,
    upstream: U,
    lead: Lead<U::Message>,
    told: Vec<Interval<U::Message, U::Notes>>,
}

impl<A: Board, U: Upstream<A, C>, C: Cost> Leader<A, U, C> {
    /// Makes a leader of the first board of a relay and what is beside it.
    #[must_use]
    pub fn new(node: Node<A, C>, upstream: U) -> Self {
        Self { node, upstream, lead: Lead { sent: Vec::new(), to: None }, told: vec![] }
    }

    /// Returns the report `index` of the board, and runs the board that far if no relay has heard it yet. Returns
    /// `None` if the board's debugger halted it.
    fn report(&mut self, index: usize) -> Option<Interval<U::Message, U::Notes>>
    where
        U::Message: Clone,
        U::Notes: Clone,
    {
        while self.told.len() <= index {
            self.told.push(self.lead.piece(&mut self.node, &mut self.upstream, u64::MAX)?);
        }
        self.told.get(index).cloned()
    }
}

/// The progress of a [`Relay`], with the messages on the way. It can be interrupted at any instant.
#[derive(Clone, Debug)]
pub struct Course<M> {
    lead: Lead<M>,
    follower: Follower<M>,
    end: u64,
    step: u64,
}

impl<M> Course<M> {
    /// Makes a course from `from` to `end` in steps of `step`, in virtual ns.
    #[must_use]
    pub fn new(from: u64, end: u64, step: u64) -> Self {
        Self { lead: Lead { sent: Vec::new(), to: None }, follower: Follower::new(from), end, step }
    }

    /// Whether the course has reached its end.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.follower.at >= self.end
    }
}

/// Why a call of [`Relay::run_course`] has returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The second board has reached the end of a step, at this instant (virtual ns).
    Reached(u64),
    /// A board is halted.
    Halted,
}

#[derive(Clone, Debug)]
struct Lead<M> {
    sent: Vec<(u64, M)>,
    /// The end of the piece that the board is running; `None` between two pieces.
    to: Option<u64>,
}

impl<M> Lead<M> {
    /// Runs the first board through its next piece. Returns `None` if its debugger halted it.
    fn piece<A: Board, C: Cost, U: Upstream<A, C, Message = M>>(
        &mut self,
        node: &mut Node<A, C>,
        upstream: &mut U,
        end: u64,
    ) -> Option<Interval<M, U::Notes>> {
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
                return Some(Interval { sent, notes: upstream.notes(node), reached: now });
            } else {
                node.advance(to.min(next));
            }
        }
    }
}

/// Runs the second board to `end`, or to the halt of a board by its debugger.
fn follow<B: Board, C: Cost, D: Downstream<B, C>, E>(
    node: &mut Node<B, C>,
    downstream: &mut D,
    end: u64,
    step: u64,
    mut tell: impl FnMut() -> Option<Interval<D::Message, D::Notes>>,
    mut each: impl FnMut(u64, &mut Node<B, C>, &mut D) -> Result<(), E>,
) -> Result<(), E> {
    // Steps end at multiples of `step`, even if a board has passed such an end by a part of an instruction.
    let mut follower = Follower::new(node.now() / step * step);
    while follower.at < end {
        let Way::Reached(at) = follower.step(node, downstream, end, step, &mut tell) else { break };
        each(at, node, downstream)?;
    }
    Ok(())
}

#[derive(Clone, Debug)]
struct Follower<M> {
    on_the_way: VecDeque<(u64, M)>,
    /// The instant up to which the first board's reports have been received.
    reached: u64,
    at: u64,
}

impl<M> Follower<M> {
    fn new(at: u64) -> Self {
        Self { on_the_way: VecDeque::new(), reached: 0, at }
    }

    /// Runs the second board to the end of its next step. `tell` returns the next report of the first board, or `None`
    /// if that board is halted. After a halt the next call continues the step.
    #[inline(never)]
    fn step<B: Board, C: Cost, D: Downstream<B, C, Message = M>>(
        &mut self,
        node: &mut Node<B, C>,
        downstream: &mut D,
        end: u64,
        step: u64,
        tell: &mut dyn FnMut() -> Option<Interval<M, D::Notes>>,
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
            while self.reached < left {
                let Some(told) = tell() else { return Way::Halted };
                self.hear(told, downstream);
            }
            while let Some((at, message)) = self.on_the_way.pop_front_if(|(at, _)| *at <= now + HEARD_AHEAD) {
                node.note_late(at, "a message");
                downstream.hear(at, message, node);
            }
            let unheard = self.on_the_way.front().map_or(u64::MAX, |(at, _)| at - HEARD_AHEAD);
            // The actor's next instant is read again, because a delivered message may have moved it.
            let next = downstream.next_at();
            node.advance(to.min(next).min(piece).min(unheard));
        }
        if to == end {
            // At the end of the step all remaining reports are taken, and messages for later instants are delivered.
            while self.reached < end {
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

    fn hear<B: Board, C: Cost, D: Downstream<B, C, Message = M>>(
        &mut self,
        told: Interval<M, D::Notes>,
        downstream: &mut D,
    ) {
        self.on_the_way.extend(told.sent);
        downstream.noted(told.notes);
        self.reached = told.reached;
    }
}
