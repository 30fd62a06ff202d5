//! Two boards of which one only speaks and the other only hears.
//!
//! Nothing ever comes back to the first board, so what it does depends on itself and on what stands beside it alone. It
//! runs on a thread of its own, ahead of the second board, and sends every message with its instant. The second board
//! enters a millisecond of virtual time only once the first has left it, and hears a message a fixed virtual time
//! ahead, which the listener of a message has to bear. What either does follows from virtual instants alone and never
//! from which thread came first, so a run is a function of its inputs.
//!
//! The first board may be far ahead: the translation of a piece of firmware that is reached for the first time holds
//! its board up for milliseconds of real time, at other instants on each board, and the lead keeps the other one busy
//! meanwhile.
//!
//! The caller describes what stands beside the first board in an [`Upstream`] (receivers on its lines), and what stands
//! beside the second in a [`Downstream`] (a flight controller).

use std::collections::VecDeque;
use std::sync::mpsc;

use super::{Node, Wiring};

/// The boards enter time in pieces of this, virtual ns.
const PIECE: u64 = 1_000_000;

/// How far ahead of its instant a message is heard at most, virtual ns.
const HEARD_AHEAD: u64 = 1_000_000;

/// How many pieces the first board may be ahead: half a second.
const LEAD: usize = 500;

/// What stands beside the first board, and takes what leaves it.
pub trait Upstream<A: Wiring>: Send {
    /// What leaves the board.
    type Message: Send;

    /// What is told of the board beside its messages: its log, a trace.
    type Notes: Send;

    /// Takes what left the board up to its present, each with its instant (virtual ns), in order of time.
    fn leave(&mut self, node: &mut Node<A>, sent: &mut Vec<(u64, Self::Message)>);

    /// What is to be told of the board since the last call; called at least once a millisecond of virtual time.
    fn notes(&mut self, node: &mut Node<A>) -> Self::Notes;

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

    /// What is told of the first board beside its messages.
    type Notes;

    /// `message` left the first board at `at` (virtual ns), which the second may not have reached yet.
    fn hear(&mut self, at: u64, message: Self::Message);

    /// `notes` were made of the first board, which may be far ahead.
    fn noted(&mut self, notes: Self::Notes);

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

/// What the first board's thread tells the second's of a piece of time.
#[derive(Debug)]
struct Told<M, N> {
    sent: Vec<(u64, M)>,
    notes: N,
    /// The board has left everything before this instant.
    reached: u64,
}

/// Two boards and what stands beside each.
#[derive(Debug)]
pub struct Relay<A: Wiring, B: Wiring, U, D> {
    /// The board that speaks.
    pub a: Node<A>,
    /// The board that hears.
    pub b: Node<B>,
    /// What stands beside the first board.
    pub upstream: U,
    /// What stands beside the second board.
    pub downstream: D,
}

impl<A: Wiring, B: Wiring, U, D> Relay<A, B, U, D>
where
    U: Upstream<A>,
    D: Downstream<B, Message = U::Message, Notes = U::Notes>,
{
    /// Runs both boards to `end` (virtual ns), or to the first instruction boundary after it. Whenever the second board
    /// has come another `step` of virtual time, and at the end, `each` is called with the instant, it and its
    /// surroundings.
    ///
    /// # Errors
    ///
    /// What `each` answers, which ends the run.
    pub fn run<E>(
        &mut self,
        end: u64,
        step: u64,
        mut each: impl FnMut(u64, &mut Node<B>, &mut D) -> Result<(), E>,
    ) -> Result<(), E> {
        let Self { a, b, upstream, downstream } = self;
        let (tell, told) = mpsc::sync_channel(LEAD);
        std::thread::scope(|threads| {
            threads.spawn(move || lead(a, upstream, end, &tell));
            let mut hearing = Hearing { told, on_the_way: VecDeque::new(), reached: 0 };
            let mut to = b.now();
            while to < end {
                to = (to + step).min(end);
                follow(b, downstream, to, end, &mut hearing);
                if to == end {
                    // What the first board said after the last that the second had to wait for.
                    while hearing.hear_one(downstream) {}
                }
                each(to, b, downstream)?;
            }
            Ok(())
        })
    }
}

/// Runs the first board to `end`, or until nobody listens any more.
fn lead<A: Wiring, U: Upstream<A>>(
    node: &mut Node<A>,
    upstream: &mut U,
    end: u64,
    tell: &mpsc::SyncSender<Told<U::Message, U::Notes>>,
) {
    let mut sent = Vec::new();
    let mut piece = (node.now() / PIECE + 1) * PIECE;
    loop {
        if node.board().outgoing() {
            upstream.leave(node, &mut sent);
        }
        let (now, next) = (node.now(), upstream.next_at());
        if next <= now {
            upstream.act(next, node);
            continue;
        }
        if now >= piece.min(end) {
            let told = Told { sent: std::mem::take(&mut sent), notes: upstream.notes(node), reached: now };
            if tell.send(told).is_err() || now >= end {
                return;
            }
            piece = (now / PIECE + 1) * PIECE;
        }
        node.advance(end.min(next).min(piece));
    }
}

/// Where the second board's thread hears of the first.
struct Hearing<M, N> {
    told: mpsc::Receiver<Told<M, N>>,
    on_the_way: VecDeque<(u64, M)>,
    reached: u64,
}

impl<M, N> Hearing<M, N> {
    /// Waits for the next thing told; `false` once there will be none.
    fn hear_one<B: Wiring>(&mut self, downstream: &mut impl Downstream<B, Message = M, Notes = N>) -> bool {
        let Ok(Told { sent, notes, reached }) = self.told.recv() else { return false };
        self.on_the_way.extend(sent);
        self.reached = reached;
        downstream.noted(notes);
        true
    }
}

/// Runs the second board to `to`.
fn follow<B: Wiring, D: Downstream<B>>(
    node: &mut Node<B>,
    downstream: &mut D,
    to: u64,
    end: u64,
    hearing: &mut Hearing<D::Message, D::Notes>,
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
        let left = (piece + HEARD_AHEAD).min(end);
        while hearing.reached < left && hearing.hear_one(downstream) {}
        while let Some((at, message)) = hearing.on_the_way.pop_front_if(|(at, _)| *at <= now + HEARD_AHEAD) {
            downstream.hear(at, message);
        }
        let unheard = hearing.on_the_way.front().map_or(u64::MAX, |(at, _)| at - HEARD_AHEAD);
        node.advance(to.min(next).min(piece).min(unheard));
    }
}
