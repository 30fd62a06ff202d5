//! Two boards in lock-step.
//!
//! Two boards run on one thread by conservative parallel simulation: a board never runs past the first instant at which
//! the other board could reach it. That instant is the other board's next possible action plus the [`Lookahead`], the
//! least time to cross. A board's next possible action is its next event while it sleeps, and the present while it is
//! awake. Actors beside a board (a flight controller, a receiver) act at their own instants.
//!
//! The caller describes in a [`Between`] what leaves a board, when it arrives, and which actors are beside each board.
//! At one instant, messages come before actors, in the order in which they were sent.

use std::collections::BTreeMap;

use cortex_m4::{Cost, Fast};

use super::{Board, Node};

/// The least times of a crossing from one board to the other, in virtual nanoseconds.
///
/// At least one of the two times must not be zero. [`Lookahead::NEVER`] is for a direction in which nothing ever
/// passes. If a controller on one board reads an answer of the other within one transfer, the time must be less than a
/// byte on the bus takes: 1 µs at 8 MHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lookahead {
    /// The least time from the first board to the second.
    pub a_to_b: u64,
    /// The least time from the second board to the first.
    pub b_to_a: u64,
}

impl Lookahead {
    /// The value for a direction in which nothing ever passes.
    pub const NEVER: u64 = u64::MAX;
}

/// The longest time by which one board may run ahead of the other, in virtual nanoseconds. It limits the number of
/// undelivered messages.
const MOST_LEAD: u64 = 1_000_000;

/// The messages on the way, each with the instant at which it arrives.
#[derive(Debug)]
pub struct Sent<M> {
    queue: BTreeMap<(u64, u64), M>,
    count: u64,
}

impl<M> Default for Sent<M> {
    fn default() -> Self {
        Self { queue: BTreeMap::new(), count: 0 }
    }
}

impl<M> Sent<M> {
    /// Sends `message` to arrive at `at` (virtual ns), after all earlier messages for that instant.
    pub fn send(&mut self, at: u64, message: M) {
        self.queue.insert((at, self.count), message);
        self.count += 1;
    }

    fn next(&self) -> u64 {
        self.queue.first_key_value().map_or(u64::MAX, |(&(at, _), _)| at)
    }

    fn take_due(&mut self, now: u64) -> Option<(u64, M)> {
        if self.next() > now {
            return None;
        }
        self.queue.pop_first().map(|((at, _), message)| (at, message))
    }
}

/// What passes between two boards, and the actors beside each board.
pub trait Between<A: Board, B: Board, C: Cost = Fast> {
    /// The messages to the first board.
    type ToA;
    /// The messages to the second board.
    type ToB;

    /// The least times of a crossing.
    fn lookahead(&self) -> Lookahead;

    /// Takes what left the first board, and sends it to the second, each message with the instant of its arrival.
    fn leave_a(&mut self, node: &mut Node<A, C>, to_b: &mut Sent<Self::ToB>) {
        let _ = (node, to_b);
    }

    /// Takes what left the second board, and sends it to the first, each message with the instant of its arrival.
    fn leave_b(&mut self, node: &mut Node<B, C>, to_a: &mut Sent<Self::ToA>) {
        let _ = (node, to_a);
    }

    /// Delivers `message`, which is due at `at`, to the first board, which has reached that instant. Implementations
    /// use [`Node::input`].
    fn arrive_a(&mut self, at: u64, message: Self::ToA, node: &mut Node<A, C>) {
        let _ = (at, message, node);
    }

    /// Delivers `message`, which is due at `at`, to the second board, which has reached that instant.
    fn arrive_b(&mut self, at: u64, message: Self::ToB, node: &mut Node<B, C>) {
        let _ = (at, message, node);
    }

    /// The next instant at which an actor beside the first board acts on it.
    fn next_at_a(&self) -> Option<u64> {
        None
    }

    /// The next instant at which an actor beside the second board acts on it.
    fn next_at_b(&self) -> Option<u64> {
        None
    }

    /// Lets the actor beside the first board act at `at`. [`Between::next_at_a`] must return a later instant
    /// afterwards.
    fn act_at_a(&mut self, at: u64, node: &mut Node<A, C>) {
        let _ = (at, node);
    }

    /// Lets the actor beside the second board act at `at`. [`Between::next_at_b`] must return a later instant
    /// afterwards.
    fn act_at_b(&mut self, at: u64, node: &mut Node<B, C>) {
        let _ = (at, node);
    }
}

/// Two boards with nothing between them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Nothing;

impl<A: Board, B: Board, C: Cost> Between<A, B, C> for Nothing {
    type ToA = ();
    type ToB = ();

    fn lookahead(&self) -> Lookahead {
        Lookahead { a_to_b: Lookahead::NEVER, b_to_a: Lookahead::NEVER }
    }
}

/// Two boards in lock-step, and what passes between them.
#[derive(Debug)]
pub struct Pair<A: Board, B: Board, L: Between<A, B, C>, C: Cost = Fast> {
    /// The first board.
    pub a: Node<A, C>,
    /// The second board.
    pub b: Node<B, C>,
    /// What passes between the two boards.
    pub between: L,
    to_a: Sent<L::ToA>,
    to_b: Sent<L::ToB>,
}

impl<A: Board, B: Board, L: Between<A, B, C>, C: Cost> Pair<A, B, L, C> {
    /// Joins two boards that have reached the same instant.
    ///
    /// # Panics
    ///
    /// Panics if both lookaheads are zero, since no board could then advance.
    #[must_use]
    pub fn new(a: Node<A, C>, b: Node<B, C>, between: L) -> Self {
        let lookahead = between.lookahead();
        assert!(lookahead.a_to_b > 0 || lookahead.b_to_a > 0, "one direction has to take time");
        Self { a, b, between, to_a: Sent::default(), to_b: Sent::default() }
    }

    /// The instant that both boards have reached.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.a.now().min(self.b.now())
    }

    /// Runs both boards to `end` (virtual ns), or to the first instruction boundary after it.
    pub fn run_until(&mut self, end: u64) {
        let lookahead = self.between.lookahead();
        self.leave_a();
        self.leave_b();
        loop {
            self.serve_a();
            self.serve_b();
            let (a, b) = (self.a.now(), self.b.now());
            if a >= end && b >= end {
                return;
            }
            let bound_a = self.first_act_b().saturating_add(lookahead.b_to_a).min(b.saturating_add(MOST_LEAD));
            let bound_a = bound_a.min(end).min(self.to_a.next()).min(next(self.between.next_at_a()));
            if a < bound_a {
                self.a.advance(bound_a);
                self.leave_a();
            }
            let bound_b =
                self.first_act_a().saturating_add(lookahead.a_to_b).min(self.a.now().saturating_add(MOST_LEAD));
            let bound_b = bound_b.min(end).min(self.to_b.next()).min(next(self.between.next_at_b()));
            if b < bound_b {
                self.b.advance(bound_b);
                self.leave_b();
            }
        }
    }

    fn first_act_a(&self) -> u64 {
        let outside = self.to_a.next().min(next(self.between.next_at_a())).max(self.a.now());
        self.a.earliest().min(outside)
    }

    fn first_act_b(&self) -> u64 {
        let outside = self.to_b.next().min(next(self.between.next_at_b())).max(self.b.now());
        self.b.earliest().min(outside)
    }

    fn leave_a(&mut self) {
        if self.a.board().outgoing() {
            self.between.leave_a(&mut self.a, &mut self.to_b);
        }
    }

    fn leave_b(&mut self) {
        if self.b.board().outgoing() {
            self.between.leave_b(&mut self.b, &mut self.to_a);
        }
    }

    fn serve_a(&mut self) {
        loop {
            let now = self.a.now();
            if let Some((at, message)) = self.to_a.take_due(now) {
                self.a.note_late(at, "a message");
                self.between.arrive_a(at, message, &mut self.a);
            } else if let Some(at) = self.between.next_at_a().filter(|&at| at <= now) {
                self.a.note_late(at, "an actor");
                self.between.act_at_a(at, &mut self.a);
            } else {
                return;
            }
            self.leave_a();
        }
    }

    fn serve_b(&mut self) {
        loop {
            let now = self.b.now();
            if let Some((at, message)) = self.to_b.take_due(now) {
                self.b.note_late(at, "a message");
                self.between.arrive_b(at, message, &mut self.b);
            } else if let Some(at) = self.between.next_at_b().filter(|&at| at <= now) {
                self.b.note_late(at, "an actor");
                self.between.act_at_b(at, &mut self.b);
            } else {
                return;
            }
            self.leave_b();
        }
    }
}

fn next(instant: Option<u64>) -> u64 {
    instant.unwrap_or(u64::MAX)
}
