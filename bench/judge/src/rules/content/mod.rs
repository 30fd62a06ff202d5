//! Compares what HORUS sends with the bytes that its receivers have sent to it.
//!
//! # How it is judged
//!
//! The judge finds the messages in the bytes of each receiver's line, with the instant at which each message had
//! arrived. Of each kind, a GPS object must show the newest message that had arrived [`bounds::MESSAGE_TAKEN`] before
//! the tick. It may show a message that arrived up to [`bounds::SAMPLED_AFTER_TICK`] after the tick.
//!
//! A GPS object's values and status are compared bit by bit; `track` determines the status bits by the message's age.
//! HORUS may miss a message in three cases: the line was disturbed, the message's bytes came before HORUS's first tick,
//! or they lie within bytes that look like another message.
//!
//! # What is not judged
//!
//! - An object whose timestamp does not continue that of the cycle before is left to rule `cycle`.
//! - Ages are not judged for two seconds after an irregular or missing tick or a jump of the timestamp, because HORUS
//!   counts time in ticks.
//! - While [`Excuse::Content`] holds, what HORUS states about its receivers, its vote and its inputs is not judged.
//! - Reported-Position is not judged in a cycle with a wrong or missing GPS object, nor in the next cycle, because the
//!   vote depends on these objects.
//!
//! HORUS receives no message that states a receiver's dynamic model; `models` judges the model by the settings in the
//! log.
//!
//! A wrong GPS object causes at most one violation because of its values and one because of its status.

mod inputs;
mod itself;
mod models;
#[cfg(test)]
mod tests;
mod track;
mod ubx;
mod vote;

use std::collections::VecDeque;

use profile::{CYCLE_MS, GpsValues, Layout, MAX_RECEIVERS, ReportedValues};

use super::Rule;
use crate::disturbance::Excuse;
use crate::read::{Frame, Placed, State, Values};
use crate::{Board, Context, Disturbances, Event, Figures, Findings, Header, Violation, Voter, What, bounds};
use inputs::Inputs;
use itself::Itself;
use models::Models;
use track::{Age, FOUND_LATE, Held, Track};
use ubx::{Kind, Message, Reader};
use vote::{Ram, Seen, Vote};

/// The status bit that is set while a receiver's last message is at most 250 ms old.
const HEARD: u16 = 1 << 7;
/// The status bit of a receiver that the voter has excluded; `vote` judges this bit.
const EXCLUDED: u16 = 1 << 9;
/// The lowest of the status bits that code the age of the solution.
const AGE_SHIFT: u16 = 10;
/// How long, ns, after an irregular tick the age of a solution is unknown. No solution stays valid for that long.
const UNTIMED: u64 = 2_000_000_000;

#[derive(Clone, Debug)]
struct Line {
    reader: Reader,
    /// The messages that have arrived and that HORUS may not have processed yet.
    arriving: VecDeque<Message>,
    tracks: [Track; 3],
    /// The arrival, ns, of the last message that HORUS has certainly processed.
    heard: Option<u64>,
    /// The latest instant, ns, at which HORUS may have found its last message.
    may_have_heard: Option<u64>,
    solution: Option<u64>,
    /// The valid positions whose bytes are still on the line: the instants, ns, at which they will have arrived.
    solutions: VecDeque<u64>,
    /// The number of bytes that a receiver on a bus has yet to send.
    waiting: u64,
    /// The instant, ns, until which HORUS may drop the bytes that it reads from the receiver.
    doubtful: u64,
    /// Whether HORUS may also drop the first bytes that it reads after the instant in `doubtful`.
    unproven: bool,
}

impl Line {
    fn new() -> Self {
        Self {
            reader: Reader::default(),
            arriving: VecDeque::new(),
            tracks: Kind::ALL.map(Track::new),
            heard: None,
            may_have_heard: None,
            solution: None,
            solutions: VecDeque::new(),
            waiting: 0,
            doubtful: 0,
            unproven: true,
        }
    }

    /// Allows HORUS to drop all bytes that it reads until `until`, ns, and the first bytes that it reads after this
    /// instant.
    fn doubt(&mut self, until: u64) {
        (self.doubtful, self.unproven) = (self.doubtful.max(until), true);
    }

    /// Records that a receiver on a bus has further bytes for HORUS.
    fn offered(&mut self, at: u64, bytes: &[u8]) {
        self.waiting += bytes.len() as u64;
        if self.waiting > bounds::READ_AT_ONCE {
            self.doubt(at + bounds::READ_SETTLED);
        }
    }

    /// Records that HORUS reads `bytes` bytes of a receiver on a bus from the instant `at` to `end`, ns. The bytes have
    /// waited since the instant `since`, ns. Returns whether HORUS must use the bytes (`Some(true)`), may use them
    /// (`Some(false)`), or must not use them (`None`).
    fn read(&mut self, (at, end): (u64, u64), bytes: u64, since: u64, clean: bool) -> Option<bool> {
        self.waiting = self.waiting.saturating_sub(bytes);
        let news = clean && end <= since + bounds::NEWS;
        let sure = news && at >= self.doubtful && !std::mem::replace(&mut self.unproven, !news);
        if !news {
            self.doubt(end + bounds::READ_SETTLED);
        }
        (at <= since + bounds::TOO_OLD).then_some(sure)
    }

    fn fed(&mut self, at: u64, byte_ns: u64, bytes: &[u8], clean: bool) {
        let Self { reader, arriving, solutions, .. } = self;
        reader.feed(at, byte_ns, bytes, clean, |message| {
            let valid = message
                .said
                .is_some_and(|(kind, _, said)| said.status & Kind::Position.valid() != 0 && kind == Kind::Position);
            if valid && clean {
                solutions.push_back(message.arrived);
            }
            arriving.push_back(message);
        });
    }

    /// Records that HORUS may lose what has arrived since the instant `since`.
    fn may_lose(&mut self, since: u64) {
        let arrived = self.arriving.iter_mut().filter(|message| message.arrived > since);
        arrived.for_each(|message| message.sure = false);
    }

    fn pass(&mut self, now: u64) {
        while let Some(arrived) = self.solutions.pop_front_if(|arrived| *arrived <= now) {
            self.solution = Some(arrived);
        }
    }

    /// Discards the messages that HORUS lost by its restart at the instant `at`.
    fn forget(&mut self, at: u64) {
        self.arriving.retain(|message| message.arrived > at);
        self.tracks.iter_mut().for_each(Track::clear);
        self.heard = None;
        self.may_have_heard = None;
        self.unproven = true;
    }

    /// Returns whether the receiver may have sent two messages of one kind in one cycle. If so, GPS objects show only
    /// the second.
    fn hurried(&self, tick: u64) -> bool {
        let by = tick + bounds::SAMPLED_AFTER_TICK;
        let newest = |kind: Kind| {
            let of_kind = |message: &&Message| message.said.is_some_and(|(its, ..)| its == kind);
            self.arriving.iter().filter(of_kind).filter(|message| message.arrived <= by).count()
                + usize::from(self.tracks[kind as usize].newest() + 3 * bounds::CYCLE > tick)
        };
        Kind::ALL.into_iter().any(|kind| newest(kind) > 1)
    }

    /// Returns whether HORUS may have received, by `at`, a position that is not in the GPS objects of `tick`.
    fn heard_since(&self, tick: u64, at: u64) -> bool {
        let positions = self.arriving.iter().filter(|message| message.said.is_some_and(|it| it.0 == Kind::Position));
        positions.into_iter().any(|message| message.arrived <= at && message.arrived + bounds::MESSAGE_TAKEN > tick)
            || self.tracks[Kind::Position as usize].newest() + bounds::MESSAGE_TAKEN > tick
    }

    /// Determines for each message that had arrived by `by` whether HORUS has certainly processed it. A message that
    /// began before `first_tick` is uncertain.
    fn settle(&mut self, by: u64, first_tick: Option<u64>) {
        while let Some(message) = self.arriving.pop_front_if(|message| message.arrived <= by) {
            let Message { begun, arrived, sure, said } = message;
            self.may_have_heard = self.may_have_heard.max(Some(if sure { arrived } else { arrived + FOUND_LATE }));
            let Some((kind, time_of_week, said)) = said else { continue };
            let track = &mut self.tracks[kind as usize];
            if sure && first_tick.is_some_and(|first| begun >= first) {
                self.heard = Some(arrived);
                track.taken(time_of_week, said, arrived);
            } else {
                track.doubted(time_of_week, said, arrived);
            }
        }
    }

    /// Returns the messages from which the position in a GPS object of `tick` may come. Also returns whether the
    /// position certainly stays valid until the next tick.
    fn held(&self, tick: u64, values: &GpsValues) -> (Vec<Held>, bool) {
        let mut track = self.tracks[Kind::Position as usize].clone();
        for message in self.arriving.iter().take_while(|message| message.arrived <= tick + bounds::SAMPLED_AFTER_TICK) {
            if let Some((Kind::Position, time_of_week, said)) = message.said {
                track.arriving(time_of_week, said, message.arrived);
            }
        }
        let numbers = numbers(Kind::Position, values);
        (track.held(tick, numbers).collect(), track.lasts(tick, numbers))
    }

    /// Returns, in words, the errors in the content and in the status of a GPS object of `tick`.
    fn faults(
        &self,
        tick: u64,
        timed: bool,
        status: u16,
        values: &GpsValues,
    ) -> (Option<&'static str>, Option<&'static str>) {
        let (mut content, mut wrong_status) = (None, None);
        let arriving =
            || self.arriving.iter().take_while(|message| message.arrived <= tick + bounds::SAMPLED_AFTER_TICK);
        for (kind, name) in Kind::ALL.into_iter().zip(["position", "attitude", "acceleration"]) {
            let values = numbers(kind, values);
            let settled = &self.tracks[kind as usize];
            let mut new = arriving()
                .filter_map(|message| Some((message.arrived, message.said?)))
                .filter(|(_, (its, ..))| *its == kind)
                .peekable();
            let agreement = if new.peek().is_none() {
                settled.agreement(tick, timed, status, values)
            } else {
                let mut track = settled.clone();
                new.for_each(|(arrived, (_, time_of_week, said))| track.arriving(time_of_week, said, arrived));
                track.agreement(tick, timed, status, values)
            };
            let shown_as_told = if status & kind.valid() == 0 { values == [kind.absent(); 3] } else { agreement.raw };
            if agreement.both {
                continue;
            }
            if agreement.values || !agreement.status && shown_as_told {
                wrong_status = wrong_status.or(Some(name));
            } else {
                content = content.or(Some(name));
            }
        }
        let now = arriving().next().is_some();
        let age = |at: u64| Age::at(tick, (at, at)).within(bounds::HEARD, bounds::HEARD);
        let may_be_heard = now || self.may_have_heard.is_some_and(|at| !timed || age(at)[0]);
        let may_be_silent = self.heard.is_none_or(|at| !timed || age(at)[1]);
        if (status & HEARD != 0 && !may_be_heard) || (status & HEARD == 0 && !may_be_silent) {
            wrong_status = wrong_status.or(Some("heard"));
        }
        let mut position = self.tracks[Kind::Position as usize].clone();
        for message in arriving() {
            if let Some((Kind::Position, time_of_week, said)) = message.said {
                position.arriving(time_of_week, said, message.arrived);
            }
        }
        if !position.may_tell_age(tick, timed, u64::from(status >> AGE_SHIFT)) {
            wrong_status = wrong_status.or(Some("age of the solution"));
        }
        (content, wrong_status)
    }
}

/// Returns, as bits, the three numbers of a GPS object that come from a message of this kind.
fn numbers(kind: Kind, values: &GpsValues) -> [u64; 3] {
    match kind {
        Kind::Position => [values.latitude, values.longitude, values.altitude].map(f64::to_bits),
        Kind::Attitude => [values.pitch, values.yaw, values.roll].map(|value| u64::from(value.to_bits())),
        Kind::Acceleration => values.acceleration.map(|value| u64::from(value.to_bits())),
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Ticks {
    since: u64,
    count: u64,
    first: Option<u64>,
    last: Option<u64>,
    before: Option<u64>,
    untimed: u64,
    /// How far, ms, HORUS's timestamps are ahead of a count of 10 ms for each tick.
    ahead: u32,
}

/// The objects of one cycle, and their violations.
#[derive(Clone, Debug, Default)]
struct Sent {
    tick: u64,
    reported: Option<ReportedValues>,
    gps: [Option<Seen>; MAX_RECEIVERS],
    blamed: bool,
    /// Whether the cycle's timestamps fail to continue those of the cycle before.
    misstamped: bool,
}

/// The rule that compares what HORUS sends with what its receivers sent; see the [module](self).
#[derive(Clone, Debug)]
pub struct Content {
    layout: Layout,
    lines: Vec<Line>,
    ticks: Ticks,
    sent: Sent,
    inputs: Inputs,
    itself: Itself,
    models: Models,
    vote: Vote,
    voter: Voter,
    /// Whether a disturbance may have changed HORUS's vote since HORUS's last start.
    unjudged: bool,
}

impl Rule for Content {
    fn new(header: &Header) -> Self {
        Self {
            layout: Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers"),
            lines: vec![Line::new(); header.gps],
            ticks: Ticks::default(),
            sent: Sent::default(),
            inputs: Inputs::new(),
            itself: Itself::new(),
            models: Models::new(header.gps),
            vote: Vote::new(header.gps),
            voter: Voter { agree: (0..=header.gps as u64).map(|agree| (agree, 0)).collect(), ..Voter::default() },
            unjudged: false,
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let at = event.at;
        self.itself.take(at, &event.what);
        self.models.take(at, &event.what);
        match &event.what {
            What::Power { board: Board::Horus, .. } | What::Reset { board: Board::Horus, .. } => {
                let unjudged = std::mem::take(&mut self.unjudged);
                let ram = match event.what {
                    What::Power { .. } => Ram::MayBeKept,
                    _ if !self.itself.keeps_ram() => Ram::Lost,
                    _ if unjudged => Ram::MayBeKept,
                    _ => Ram::Kept,
                };
                let since = self.vote.last_tick;
                let heard = (0..).zip(&self.lines).filter(|(_, line)| line.heard_since(since, at));
                let heard = heard.fold(0, |set, (receiver, _)| set | 1 << receiver);
                self.vote.restart(ram, self.ticks.count, heard);
                self.ticks = Ticks { since: at, ..Ticks::default() };
                self.lines.iter_mut().for_each(|line| line.forget(at));
                self.inputs.forget();
                (0..self.lines.len()).for_each(|receiver| self.voter.excluded(receiver, at, false, None));
            }
            What::Tick => {
                let ticks = &mut self.ticks;
                let is_irregular =
                    ticks.last.is_some_and(|last| (at - last).abs_diff(bounds::CYCLE) > bounds::TICK_TOLERANCE);
                if is_irregular {
                    ticks.untimed = at + UNTIMED;
                }
                self.inputs.tick(at, is_irregular);
                ticks.count += 1;
                ticks.first.get_or_insert(at);
                ticks.before = ticks.last.replace(at);
            }
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Content) => self.unjudged = true,
            What::StateInput { input, active, inactive } => self.inputs.levels(at, *input, *active, *inactive),
            What::Offered { receiver, bytes } => {
                if let Some(line) = self.lines.get_mut(*receiver) {
                    line.offered(at, bytes);
                }
            }
            What::Fed { receiver, byte_ns, bytes, clean, since } => {
                let Some(line) = self.lines.get_mut(*receiver) else { return };
                line.pass(at);
                // Messages older than four cycles cannot affect a later frame, which ends less than two cycles after
                // its tick.
                line.settle(at.saturating_sub(4 * bounds::CYCLE), self.ticks.first);
                let disturbances = context.disturbances();
                let clean = *clean && !disturbances.excuse(Excuse::Ears, at);
                let taken = match since {
                    None => Some(clean),
                    Some(since) => {
                        let excused = disturbances.excuse_of(*receiver, Excuse::Taking, at);
                        let end = at + byte_ns * bytes.len() as u64;
                        line.read((at, end), bytes.len() as u64, *since, clean && !excused)
                    }
                };
                if let Some(sure) = taken {
                    line.fed(at, *byte_ns, bytes, sure);
                }
            }
            // What a receiver has sent may still wait for the parser.
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Ears) => {
                self.lines.iter_mut().for_each(|line| line.may_lose(at.saturating_sub(bounds::MESSAGE_TAKEN)));
            }
            What::Sent { started, whole: true, .. } => {
                if let Some(frame) = context.frame()
                    && *started >= self.ticks.since + bounds::COMMAND_TO_AIR
                    && !context.disturbances().excuse(Excuse::Content, at)
                {
                    self.sent(at, *started, frame, context.disturbances(), findings);
                }
            }
            _ => {}
        }
    }

    fn finish(&mut self, context: &Context, _findings: &mut Findings, figures: &mut Figures) {
        figures.voter = self.voter.clone();
        figures.last_solution_ns = self
            .lines
            .iter_mut()
            .map(|line| {
                line.pass(context.now());
                line.solution
            })
            .collect();
    }
}

impl Content {
    fn sent(&mut self, at: u64, started: u64, frame: &Frame, disturbances: &Disturbances, findings: &mut Findings) {
        let Ticks { count, first, last, before, untimed, .. } = self.ticks;
        let (tick, number) = match (last, before) {
            (Some(last), _) if started >= last => (last, count),
            (_, Some(before)) if started >= before => (before, count - 1),
            _ => return,
        };
        if self.sent.tick != tick {
            self.sent = Sent { tick, ..Sent::default() };
        }
        let Self { lines, ticks, sent, layout, inputs, itself, models, vote, voter, .. } = self;
        let stamp = (number * u64::from(CYCLE_MS)) as u32;
        let gps = || frame.objects.iter().filter(|object| object.index > 0);
        let mut ahead = gps().filter_map(Placed::timestamp).map(|timestamp| timestamp.wrapping_sub(stamp));
        if let Some(other) = ahead.find(|ahead| *ahead != ticks.ahead) {
            ticks.ahead = other;
            ticks.untimed = at + UNTIMED;
            sent.misstamped = true;
        }
        if sent.misstamped {
            return;
        }
        for object in &frame.objects {
            match &object.state {
                State::Valid { values: Values::Reported(values), .. } => {
                    voter.reported(values.status);
                    // A profile shows the state that HORUS sampled at the tick before.
                    if last == Some(tick)
                        && let Some(what) = inputs.wrong(values.status.state())
                    {
                        findings.add(Violation::StateWrong, at, || format!("{what}, at {:.6} ms", at as f64 / 1e6));
                    }
                    if let Some(what) = itself.wrong_crystal(values.status) {
                        findings.add(Violation::CrystalWrong, at, || format!("{what}, at {:.6} ms", at as f64 / 1e6));
                    }
                    if let Some(what) = itself.wrong(values.status) {
                        findings.add(Violation::ReportedWrong, at, || format!("{what}, at {:.6} ms", at as f64 / 1e6));
                    }
                    sent.reported = Some(*values);
                }
                State::Valid { values: Values::Gps(values), .. } => {
                    let Some(line) = lines.get_mut(object.index - 1) else { continue };
                    if values.status.position_valid()
                        && let Some(model) = models.wrong(object.index - 1, at, ticks.since, disturbances)
                    {
                        let name = || format!("GPS{} navigates by model {model}", object.index);
                        findings.add(Violation::NotAirborne, at, name);
                    }
                    line.settle(tick.saturating_sub(bounds::MESSAGE_TAKEN), first);
                    let (held, lasts) = if tick >= untimed { line.held(tick, values) } else { (vec![], false) };
                    let hurried = line.hurried(tick);
                    sent.gps[object.index - 1] = Some(Seen { values: *values, held, lasts, hurried });
                    let status = u16::from_le_bytes([object.bytes[6], object.bytes[7]]) & !EXCLUDED;
                    let (content, wrong_status) = line.faults(tick, tick >= untimed, status, values);
                    let words = |what: &str| format!("GPS{} at {:.6} ms: {what}", object.index, at as f64 / 1e6);
                    if let Some(what) = content {
                        findings.add(Violation::ContentWrong, at, || words(what));
                        sent.blamed = true;
                    }
                    if let Some(what) = wrong_status {
                        findings.add(Violation::StatusWrong, at, || words(&format!("{what}, status {status:#06x}")));
                        sent.blamed = true;
                    }
                }
                _ => {}
            }
        }
        let complete = sent.gps.iter().flatten().count() == layout.receivers();
        let Some(reported) = sent.reported.filter(|_| complete && !sent.blamed) else { return };
        let stamp = stamp.wrapping_add(ticks.ahead);
        let seen: Vec<Seen> = sent.gps.iter().flatten().cloned().collect();
        let judged = vote.cycle(tick, number, inputs.is_known(), &reported, &seen);
        for (receiver, (seen, away)) in seen.iter().zip(judged.away).enumerate() {
            voter.excluded(receiver, tick, seen.values.status.excluded(), away);
        }
        let wrong = if reported.timestamp == stamp {
            judged.wrong
        } else {
            let what = format!("it is stamped {} ms, the GPS objects {stamp} ms", reported.timestamp);
            Some((Violation::ReportedWrong, what))
        };
        if let Some((violation, what)) = wrong {
            findings.add(violation, at, || format!("{what}, at {:.6} ms", at as f64 / 1e6));
        }
    }
}
