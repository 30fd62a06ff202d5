//! Two boards of which one only speaks and the other only hears.
//!
//! Nothing ever comes back to the first board, so what it does depends on itself and on what stands beside it alone. It runs on a
//! thread of its own, ahead of the second board, and sends every message with its instant. The second board enters a millisecond
//! of virtual time only once the first has left it, and hears a message a fixed virtual time ahead, which the listener of a
//! message has to bear. What either does follows from virtual instants alone and never from which thread came first, so a run is
//! a function of its inputs.
//!
//! The caller describes what stands beside the first board in an [`Upstream`] (receivers on its lines), and what stands beside the
//! second in a [`Downstream`] (a flight controller).

use std::collections::VecDeque;
use std::sync::mpsc;

use super::{Node, Wiring};

/// The second board enters time in pieces of this, virtual ns.
const PIECE: u64 = 1_000_000;

/// How far ahead of its instant a message is heard at most, virtual ns.
const HEARD_AHEAD: u64 = 1_000_000;

/// How far past the instant asked for the first board runs, virtual ns: what keeps both threads busy.
const LEAD: u64 = 10_000_000;

/// What stands beside the first board, and takes what leaves it.
pub trait Upstream<A: Wiring>: Send {
    /// What leaves the board.
    type Message: Send;

    /// Takes what left the board up to its present, each with its instant (virtual ns), in order of time.
    fn leave(&mut self, node: &mut Node<A>, sent: &mut Vec<(u64, Self::Message)>);

    /// The next instant an actor beside the board acts on it (virtual ns), `u64::MAX` for never.
    fn next_at(&self) -> u64 {
        u64::MAX
    }

    /// The actor acts, due at `at`. [`Upstream::next_at`] must move on.
    fn act(&mut self, at: u64, node: &mut Node<A>) {
        let _ = (at, node);
    }
}

/// What stands beside the second board, and brings it what left the first.
pub trait Downstream<B: Wiring> {
    /// What left the first board.
    type Message;

    /// `message` left the first board at `at` (virtual ns), which the second may not have reached yet.
    fn hear(&mut self, at: u64, message: Self::Message);

    /// Takes what left the second board. It reaches nobody's board.
    fn leave(&mut self, node: &mut Node<B>) {
        let _ = node;
    }

    /// The next instant an actor beside the board acts on it (virtual ns), `u64::MAX` for never.
    fn next_at(&self) -> u64 {
        u64::MAX
    }

    /// The actor acts, due at `at`. [`Downstream::next_at`] must move on.
    fn act(&mut self, at: u64, node: &mut Node<B>) {
        let _ = (at, node);
    }
}

/// What the first board's thread tells the second's.
#[derive(Debug)]
enum Told<M> {
    Sent(u64, M),
    Reached(u64),
}

/// Two boards and what stands beside each.
#[derive(Debug)]
pub struct Relay<A: Wiring, B: Wiring, U: Upstream<A>, D: Downstream<B, Message = U::Message>> {
    /// The board that speaks.
    pub a: Node<A>,
    /// The board that hears.
    pub b: Node<B>,
    /// What stands beside the first board.
    pub upstream: U,
    /// What stands beside the second board.
    pub downstream: D,
    /// Where the run ends: the first board goes no further.
    end: u64,
    /// What left the first board and was not heard yet.
    on_the_way: VecDeque<(u64, U::Message)>,
    /// The first board has left everything before this instant.
    reached: u64,
}

impl<A: Wiring, B: Wiring, U: Upstream<A>, D: Downstream<B, Message = U::Message>> Relay<A, B, U, D> {
    /// Joins two boards that stand at the same instant, for a run up to `end` (virtual ns).
    #[must_use]
    pub fn new(a: Node<A>, b: Node<B>, upstream: U, downstream: D, end: u64) -> Self {
        Self { a, b, upstream, downstream, end, on_the_way: VecDeque::new(), reached: 0 }
    }

    /// The instant both boards have reached.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.a.now().min(self.b.now())
    }

    /// Runs both boards to `to` (virtual ns, at most the end of the run), or to the first instruction boundary after it. The first
    /// board goes on ahead by some milliseconds.
    pub fn run_until(&mut self, to: u64) {
        let Self { a, b, upstream, downstream, end, on_the_way, reached } = self;
        let to = to.min(*end);
        let ahead = to.saturating_add(LEAD).min(*end);
        let (tell, told) = mpsc::channel();
        std::thread::scope(|threads| {
            threads.spawn(move || lead(a, upstream, ahead, &tell));
            let mut hearing = Hearing { told: &told, on_the_way: &mut *on_the_way, reached: &mut *reached };
            follow(b, downstream, to, *end, &mut hearing);
            while hearing.hear_one() {}
        });
    }
}

/// Runs the first board to `to`.
fn lead<A: Wiring, U: Upstream<A>>(
    node: &mut Node<A>,
    upstream: &mut U,
    to: u64,
    tell: &mpsc::Sender<Told<U::Message>>,
) {
    let mut sent = Vec::new();
    loop {
        if node.board().outgoing() {
            upstream.leave(node, &mut sent);
            for (at, message) in sent.drain(..) {
                // Nobody listens any more only where the other thread panicked, which ends the run.
                tell.send(Told::Sent(at, message)).ok();
            }
        }
        let (now, next) = (node.now(), upstream.next_at());
        if next <= now {
            upstream.act(next, node);
            continue;
        }
        tell.send(Told::Reached(now)).ok();
        if now >= to {
            return;
        }
        node.advance(to.min(next).min((now / PIECE + 1) * PIECE));
    }
}

/// Where the second board's thread hears of the first.
struct Hearing<'a, M> {
    told: &'a mpsc::Receiver<Told<M>>,
    on_the_way: &'a mut VecDeque<(u64, M)>,
    reached: &'a mut u64,
}

impl<M> Hearing<'_, M> {
    /// Waits for the next thing told; `false` once there will be none.
    fn hear_one(&mut self) -> bool {
        match self.told.recv() {
            Ok(Told::Sent(at, message)) => self.on_the_way.push_back((at, message)),
            Ok(Told::Reached(at)) => *self.reached = at,
            Err(mpsc::RecvError) => return false,
        }
        true
    }

    /// Waits until the first board has left everything before `at`.
    fn wait_for(&mut self, at: u64) {
        while *self.reached < at && self.hear_one() {}
    }
}

/// Runs the second board to `to`.
fn follow<B: Wiring, D: Downstream<B>>(
    node: &mut Node<B>,
    downstream: &mut D,
    to: u64,
    end: u64,
    hearing: &mut Hearing<'_, D::Message>,
) {
    loop {
        if node.board().outgoing() {
            downstream.leave(node);
        }
        let (now, next) = (node.now(), downstream.next_at());
        if next <= now {
            downstream.act(next, node);
            continue;
        }
        if now >= to {
            return;
        }
        let piece = (now / PIECE + 1) * PIECE;
        hearing.wait_for((piece + HEARD_AHEAD).min(end));
        while let Some((at, message)) = hearing.on_the_way.pop_front_if(|(at, _)| *at <= now + HEARD_AHEAD) {
            downstream.hear(at, message);
        }
        let unheard = hearing.on_the_way.front().map_or(u64::MAX, |(at, _)| at - HEARD_AHEAD);
        node.advance(to.min(next).min(piece).min(unheard));
    }
}
