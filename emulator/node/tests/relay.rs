//! Compares a relay on two threads with the same boards in lock-step on one.

use crate::{player, thumb};

use std::collections::VecDeque;
use std::sync::Mutex;

use emulator_node::{Between, Downstream, FindingKind, Leader, Lookahead, Node, Pair, Relay, Sent, Threads, Upstream};
use player::{IN, Player};
use thumb::{COUNTER, EXTI, GPIOD, HANDLER, MAIN, TIM2, Thumb, firmware};

const MS: u64 = 1_000_000;
/// Returns a board that pulses PD14 every 0.7 ms. This period does not divide the relay's pieces of time.
fn beacon() -> Node<Player> {
    let mut main = Thumb::at(MAIN);
    main.store(thumb::RCC + 0x30, 1 << 3).store(GPIOD, 1 << 28).tim2_every(11_200).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).store(GPIOD + 0x18, 1 << 14).store(GPIOD + 0x18, 1 << 30).count(COUNTER).ret();
    Player::with(&firmware("beacon", &main, &[(28, &tick)]))
}

/// Returns a board that counts the rising edges of PA3 and answers each on PD14. The wire of PD14 leads nowhere.
fn counter() -> Node<Player> {
    let mut main = Thumb::at(MAIN);
    main.exti3_on_pa3().store(GPIOD, 1 << 28).idle();
    let mut hit = Thumb::at(HANDLER);
    hit.store(EXTI + 0x14, 1 << 3).count(COUNTER).store(GPIOD + 0x18, 1 << 14).store(GPIOD + 0x18, 1 << 30).ret();
    Player::with(&firmware("counter", &main, &[(9, &hit)]))
}

/// The surroundings of the first board, which send the edges of its pin.
#[derive(Clone, Debug, Default)]
struct Speaker {
    notes: u64,
}

impl Upstream<Player> for Speaker {
    type Message = bool;
    type Notes = u64;

    fn leave(&mut self, node: &mut Node<Player>, sent: &mut Vec<(u64, bool)>) {
        sent.extend(node.board_mut(Player::take_edges));
    }

    fn notes(&mut self, _node: &mut Node<Player>) -> u64 {
        self.notes += 1;
        self.notes
    }
}

/// The surroundings of the second board, which drive its pin with the edges that they receive.
#[derive(Clone, Debug, Default)]
struct Listener {
    coming: VecDeque<(u64, bool)>,
    arrived: Vec<(u64, bool)>,
    notes: u64,
}

impl Downstream<Player> for Listener {
    type Message = bool;
    type Notes = u64;

    fn hear(&mut self, at: u64, high: bool, _node: &mut Node<Player>) {
        self.coming.push_back((at, high));
    }

    fn noted(&mut self, notes: u64) {
        assert_eq!(notes, self.notes + 1, "notes come in order");
        self.notes = notes;
    }

    fn leave(&mut self, node: &mut Node<Player>) {
        node.board_mut(Player::take_edges);
    }

    fn next_at(&self) -> u64 {
        self.coming.front().map_or(u64::MAX, |&(at, _)| at)
    }

    fn act(&mut self, at: u64, node: &mut Node<Player>) {
        let (_, high) = self.coming.pop_front().unwrap();
        self.arrived.push((at, high));
        node.drive(IN, Some(high));
    }
}

fn relay() -> Relay<Player, Player, Speaker, Listener> {
    Relay { a: beacon(), b: counter(), upstream: Speaker::default(), downstream: Listener::default() }
}

#[derive(Debug, Default)]
struct Wire {
    arrived: Vec<(u64, bool)>,
}

impl Between<Player, Player> for Wire {
    type ToA = ();
    type ToB = bool;

    fn lookahead(&self) -> Lookahead {
        Lookahead { a_to_b: 0, b_to_a: Lookahead::NEVER }
    }

    fn leave_a(&mut self, node: &mut Node<Player>, to_b: &mut Sent<bool>) {
        for (at, high) in node.board_mut(Player::take_edges) {
            to_b.send(at, high);
        }
    }

    fn leave_b(&mut self, node: &mut Node<Player>, _to_a: &mut Sent<()>) {
        node.board_mut(Player::take_edges);
    }

    fn arrive_b(&mut self, at: u64, high: bool, node: &mut Node<Player>) {
        self.arrived.push((at, high));
        node.drive(IN, Some(high));
    }
}

fn count(node: &mut Node<Player>) -> u32 {
    node.word(u64::from(COUNTER)).unwrap()
}

#[test]
fn on_two_threads_both_boards_do_what_they_do_on_one() {
    let mut pair = Pair::new(beacon(), counter(), Wire::default());
    pair.run_until(100 * MS);
    let mut relay = relay();
    relay.run(100 * MS, 10 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
    assert_eq!(count(&mut relay.a), 142);
    assert_eq!(count(&mut relay.b), 142);
    assert_eq!(relay.downstream.arrived, pair.between.arrived);
    assert_eq!((relay.a.digest(), relay.b.digest()), (pair.a.digest(), pair.b.digest()));
    assert_eq!((relay.a.take_findings(), relay.b.take_findings()), (vec![], vec![]));
}

#[test]
fn two_relays_behind_one_leader_hear_what_each_hears_of_its_own() {
    let each = |_, _: &mut Node<Player>, _: &mut Listener| Ok::<_, ()>(());
    let mut own = relay();
    own.run(33 * MS + 123_456, 10 * MS, Threads::One, each).unwrap();
    let leader = Mutex::new(Leader::new(own.a.clone(), own.upstream.clone()));
    let mut behind = [own.clone(), own.clone()].map(|relay| (relay, 0));
    own.run(100 * MS, 10 * MS, Threads::One, each).unwrap();
    // Each is ahead of the other once.
    for (index, end) in [(0, 60), (1, 100), (0, 100)] {
        let (relay, heard) = &mut behind[index];
        relay.run_behind(&leader, heard, (end * MS, 10 * MS), each).unwrap();
    }
    for (relay, heard) in &mut behind {
        assert_eq!(*heard, 67, "a report for each millisecond");
        assert_eq!(relay.downstream.arrived, own.downstream.arrived);
        assert_eq!(relay.downstream.notes, own.downstream.notes);
        assert_eq!(relay.b.digest(), own.b.digest());
        assert!(count(&mut relay.a) < count(&mut own.a), "its own first board stands still");
    }
}

#[test]
fn the_caller_receives_every_step_and_all_notes_up_to_it() {
    let mut relay = relay();
    let mut steps = vec![];
    relay
        .run(25 * MS, 10 * MS, Threads::Two, |at, node, listener| {
            assert!(node.now() >= at);
            assert!(listener.notes >= at / MS, "{} notes at {at}", listener.notes);
            steps.push(at);
            Ok::<_, ()>(())
        })
        .unwrap();
    assert_eq!(steps, [10 * MS, 20 * MS, 25 * MS]);
    assert_eq!(relay.downstream.notes, relay.upstream.notes);
    assert!(relay.upstream.notes >= 25);
}

/// Ten seconds are far more than the first board may be ahead. Its thread must stop although nobody takes its messages
/// any more.
#[test]
fn an_error_of_the_caller_ends_the_run_on_both_threads() {
    let mut relay = relay();
    let ended =
        relay.run(10_000 * MS, 10 * MS, Threads::Two, |at, _, _| if at < 30 * MS { Ok(()) } else { Err("enough") });
    assert_eq!(ended, Err("enough"));
    assert!((30 * MS..31 * MS).contains(&relay.b.now()), "{}", relay.b.now());
    assert!(relay.a.now() < 1_000 * MS, "{}", relay.a.now());
}

/// An actor beside the first board that acts at `acts_at`, but states this instant too late by `late_by`.
#[derive(Debug)]
struct Tardy {
    acts_at: u64,
    late_by: u64,
    tells: bool,
}

impl Upstream<Player> for Tardy {
    type Message = bool;
    type Notes = ();

    fn leave(&mut self, node: &mut Node<Player>, _sent: &mut Vec<(u64, bool)>) {
        node.board_mut(Player::take_edges);
    }

    fn notes(&mut self, node: &mut Node<Player>) {
        // The actor states its instant only here, after that instant has passed.
        if self.acts_at == u64::MAX && node.now() >= 5 * MS {
            self.acts_at = node.now() - self.late_by;
        }
    }

    fn next_at(&self) -> u64 {
        if self.tells { u64::MAX } else { self.acts_at }
    }

    fn act(&mut self, _at: u64, node: &mut Node<Player>) {
        self.tells = true;
        node.drive(IN, Some(true));
    }
}

#[derive(Debug, Default)]
struct Deaf;

impl Downstream<Player> for Deaf {
    type Message = bool;
    type Notes = ();

    fn hear(&mut self, _at: u64, _high: bool, _node: &mut Node<Player>) {}

    fn noted(&mut self, (): ()) {}

    fn leave(&mut self, node: &mut Node<Player>) {
        node.board_mut(Player::take_edges);
    }
}

fn kinds(node: &mut Node<Player>) -> Vec<FindingKind> {
    node.take_findings().iter().map(|finding| finding.kind).collect()
}

#[test]
fn a_late_action_beside_the_first_board_is_a_finding() {
    for (late_by, expected) in [(0, vec![]), (1_000, vec![FindingKind::Late])] {
        let upstream = Tardy { acts_at: u64::MAX, late_by, tells: false };
        let mut relay = Relay { a: beacon(), b: counter(), upstream, downstream: Deaf };
        relay.run(10 * MS, 10 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
        assert!(relay.upstream.tells, "it acted");
        assert_eq!(kinds(&mut relay.a), expected, "{late_by} ns late");
        assert_eq!(kinds(&mut relay.b), []);
    }
}

#[test]
fn a_late_action_beside_the_second_board_is_a_finding() {
    for (late_by, expected) in [(0, vec![]), (1_000, vec![FindingKind::Late])] {
        let mut relay = relay();
        relay
            .run(10 * MS, 5 * MS, Threads::Two, |at, _, listener| {
                if at == 5 * MS {
                    listener.coming.push_front((at - late_by, true));
                }
                Ok::<_, ()>(())
            })
            .unwrap();
        assert_eq!(kinds(&mut relay.b), expected, "{late_by} ns late");
        assert_eq!(kinds(&mut relay.a), []);
    }
}

/// Surroundings that send edges with instants that the second board has already passed.
#[derive(Debug, Default)]
struct Backdated(u64);

impl Upstream<Player> for Backdated {
    type Message = bool;
    type Notes = ();

    fn leave(&mut self, node: &mut Node<Player>, sent: &mut Vec<(u64, bool)>) {
        sent.extend(node.board_mut(Player::take_edges).into_iter().map(|(at, high)| (at.saturating_sub(self.0), high)));
    }

    fn notes(&mut self, _node: &mut Node<Player>) {}
}

#[test]
fn a_message_that_is_heard_after_its_instant_is_a_finding() {
    for (back, late) in [(0, false), (3 * MS, true)] {
        let mut relay = Relay { a: beacon(), b: counter(), upstream: Backdated(back), downstream: Deaf };
        relay.run(10 * MS, 10 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
        let kinds = kinds(&mut relay.b);
        assert_eq!(!kinds.is_empty(), late, "{kinds:?}");
        assert!(kinds.iter().all(|kind| *kind == FindingKind::Late), "{kinds:?}");
    }
}
