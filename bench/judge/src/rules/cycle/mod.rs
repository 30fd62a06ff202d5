//! Judges ticks, transmit commands, frames, their timestamps and their timing.
//!
//! # What is required
//!
//! From each start of HORUS (power-on or reset) to the next, ticks come every 10 ms, the first within
//! [`bounds::START`]. Each tick is followed by the frames of its cycle, in their order, before the next tick. A frame
//! belongs to the last tick before its first bit, and begins within [`bounds::COMMAND_TO_AIR`] after its transmit
//! command. The frames consist of whole, valid objects. The objects' timestamps advance by 10 ms for each tick since
//! the start.
//!
//! # One cause, one violation
//!
//! - A restart may cut off a transmit command or a frame, and it switches the field off. Neither is reported. If ticks
//!   and frames are missing for at most [`bounds::WATCHDOG_LONGEST`] before a reset that was not asked for, HORUS was
//!   hung, and only the reset is reported.
//! - A frame that is reported for another reason also counts as sent, so that it is not reported as missing too. This
//!   holds for a command without its frame, a frame without a command, a broken frame and an extra frame.
//! - If the field drops, no frame is required until the end of the cycle in which the field comes back. HORUS may
//!   switch the field off within [`bounds::FIELD_RECOVERY`] after a lost frame, to bring its front end up again. Then
//!   only the lost frame is reported.
//! - While [`Excuse::Sending`] holds, missing frames, broken frames, frames of a wrong length, commands without frames
//!   and a dropped field are not reported. What HORUS sends is still judged.
//! - From the instant at which the bench stops HORUS's core until HORUS's next start, no ticks, commands and frames are
//!   required. A frame begun or commanded before may break off or not come, and the field may go off. What HORUS sends
//!   is still judged, and so are the ticks of HORUS's timer. What was missing before the hang is reported, since the
//!   watchdog's reset is not.
//! - No frames are required of a cycle whose next tick comes late. The timestamps may count a missing or irregular tick
//!   or leave it out, but all later timestamps must do the same.
//! - A frame that begins more than a cycle after the last tick belongs to a missing or late tick. The tick is reported,
//!   and not an extra frame.
//! - Cycles with a violation do not count for the jitter. If several of tick, command and air scatter too much, only
//!   the first in this order is reported, because the others follow from it.
//! - If only the timestamp of Reported-Position is wrong in a frame with GPS objects, [`content`](super::content)
//!   reports that.

mod jitter;
#[cfg(test)]
mod tests;

use profile::{CYCLE_MS, Layout};

use super::{Rule, ms};
use crate::disturbance::{Disturbances, Excuse};
use crate::read::{Frame, State};
use crate::{Board, Context, Event, Figures, Findings, Header, Violation, What, bounds};
use jitter::{Jitter, Series, Worst};

/// The time, ns, after a reset in which chip select may rise because of the reset: some cycles of HORUS's 144 MHz
/// clock.
const LETS_GO: u64 = 100;

#[derive(Clone, Copy, Debug)]
struct Command {
    at: u64,
    /// Whether the frame that was commanded may be missing. This is so if the field was off or HORUS hung.
    cut_off: bool,
}

/// The possible numbers of a tick, counted from HORUS's start. After a missing or irregular tick more than one number
/// is possible.
#[derive(Clone, Copy, Debug, Default)]
struct Number {
    least: u64,
    most: u64,
}

impl Number {
    /// Returns whether a tick with one of these numbers can have this timestamp (ms), and drops the numbers that
    /// cannot.
    fn is_stamped(&mut self, timestamp: u32) -> bool {
        // The number of the tick and the timestamp wrap together, after 2^32 ms.
        let least = (self.least * u64::from(CYCLE_MS)) as u32;
        let ahead = timestamp.wrapping_sub(least);
        let steps = u64::from(ahead / CYCLE_MS);
        let stamped = ahead.is_multiple_of(CYCLE_MS) && steps <= self.most - self.least;
        if stamped {
            *self = Self { least: self.least + steps, most: self.least + steps };
        }
        stamped
    }
}

#[derive(Clone, Copy, Debug)]
struct Tick {
    at: u64,
    number: Number,
    /// Whether the cycle has a violation.
    blamed: bool,
    /// Whether the cycle's frames may be missing. This is so if the field was off or HORUS hung.
    cut_off: bool,
    /// For each frame of the cycle, the instants, ns, of its command and of its first preamble bit.
    frames: [Option<(u64, u64)>; 2],
    /// The number of frames with a violation, which `frames` does not contain.
    others: usize,
}

impl Tick {
    fn sent(&self) -> usize {
        self.frames.iter().flatten().count()
    }
}

#[derive(Clone, Copy, Debug)]
enum Missing {
    Tick { after: Option<u64> },
    Frames { of: u64, sent: usize, wanted: usize },
}

#[derive(Clone, Debug)]
struct Run {
    since: u64,
    powered: bool,
    hung: bool,
    before: Option<Tick>,
    tick: Option<Tick>,
    /// Whether the next tick is overdue and recorded as missing.
    tick_missing: bool,
    /// The transmit commands whose frames have not ended.
    commands: Vec<Command>,
    field: bool,
    /// Whether the carrier has dropped and is still off.
    dropped: bool,
    /// The instant, ns, at which the carrier last came back.
    back: Option<u64>,
    /// The instant, ns, at which a frame was last lost.
    lost: Option<u64>,
    /// The instant, ns, at which the first frame of the last cycle began; `None` if that cycle had a violation.
    led: Option<u64>,
    jitter: Jitter,
    /// The frames and ticks that are missing since the last frame, each with its instant. They are reported only when
    /// it is certain that HORUS has not hung.
    missing: Vec<(u64, Missing)>,
}

impl Run {
    fn new(since: u64, powered: bool) -> Self {
        Self {
            since,
            powered,
            hung: false,
            before: None,
            tick: None,
            tick_missing: false,
            commands: vec![],
            field: false,
            dropped: false,
            back: None,
            lost: None,
            led: None,
            jitter: Jitter::default(),
            missing: vec![],
        }
    }

    /// Returns the tick to which a command or frame begun at the instant `began` belongs: the last or the last but one.
    fn tick_of(&mut self, began: u64) -> Option<&mut Tick> {
        self.tick.iter_mut().chain(&mut self.before).find(|tick| began >= tick.at)
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    frames_sent: u64,
    bit_rate: u64,
    air_time_ns: u64,
    period: Series,
    command: Series,
    air: Series,
}

/// The rule that judges ticks, transmit commands and frames; see the [module](self).
#[derive(Clone, Debug)]
pub struct Cycle {
    layout: Layout,
    run: Run,
    worst: Worst,
    measured: Measured,
}

impl Rule for Cycle {
    fn new(header: &Header) -> Self {
        Self {
            layout: Layout::for_receivers(header.gps).expect("a profile has 1, 2, 3 or 5 receivers"),
            run: Run::new(0, true),
            worst: Worst::default(),
            measured: Measured::default(),
        }
    }

    fn take(&mut self, event: &Event, context: &Context, findings: &mut Findings) {
        let disturbances = context.disturbances();
        self.pass(event.at, disturbances, findings);
        match &event.what {
            What::Power { board: Board::Horus, on } => self.restart(event.at, *on, true, context, findings),
            What::Reset { board: Board::Horus, asked, .. } => {
                let powered = context.running(Board::Horus).powered;
                self.restart(event.at, powered, *asked, context, findings);
            }
            What::Injected { disturbs, .. } if disturbs.may_take(Excuse::Sending) => {
                if let Some(tick) = &mut self.run.tick {
                    tick.cut_off = true;
                }
            }
            _ if !self.run.powered => {}
            What::Hung { board: Board::Horus } => {
                self.tell_missing(findings);
                self.run.hung = true;
                self.cut_off(event.at);
            }
            What::Tick => self.tick(event.at, disturbances, findings),
            // A reset makes chip select rise, which is not the end of a transmit command.
            What::Command if event.at < self.run.since + LETS_GO => {}
            What::Command => {
                let cut_off = self.run.dropped || self.run.hung;
                self.run.commands.push(Command { at: event.at, cut_off });
            }
            What::Field { on } => self.field(event.at, *on, disturbances, findings),
            What::Sent { started, bit_rate, whole, .. } => {
                if *whole {
                    self.measured.frames_sent += 1;
                    self.measured.bit_rate = u64::from(*bit_rate);
                    self.measured.air_time_ns = self.measured.air_time_ns.max(event.at - started);
                }
                // A frame from before HORUS's last start is not judged.
                if let Some(frame) = context.frame()
                    && *started >= self.run.since + bounds::COMMAND_TO_AIR
                {
                    self.sent(event.at, *started, *whole, frame, disturbances, findings);
                }
            }
            _ => {}
        }
    }

    fn finish(&mut self, context: &Context, findings: &mut Findings, figures: &mut Figures) {
        self.pass(context.now(), context.disturbances(), findings);
        self.tell_missing(findings);
        self.conclude(context);
        self.worst.tell(findings);
        figures.frames_sent = self.measured.frames_sent;
        figures.bit_rate = self.measured.bit_rate;
        figures.air_time_ns = self.measured.air_time_ns;
        figures.period_ns = self.measured.period.span();
        figures.tick_to_command_ns = self.measured.command.span();
        figures.tick_to_air_ns = self.measured.air.span();
    }
}

impl Cycle {
    /// Records as missing what should have come before `now`.
    fn pass(&mut self, now: u64, disturbances: &Disturbances, findings: &mut Findings) {
        let run = &mut self.run;
        if !run.powered {
            return;
        }
        let due = run.tick.map_or(run.since + bounds::START, |tick| tick.at + bounds::TICK_MISSING);
        if now > due && !run.tick_missing && !run.hung {
            run.tick_missing = true;
            run.missing.push((due, Missing::Tick { after: run.tick.map(|tick| tick.at) }));
        }
        while let Some(&command) = self.run.commands.first()
            && now > command.at + bounds::COMMAND_TO_END
        {
            self.run.commands.remove(0);
            self.without_frame(command, disturbances, findings);
        }
        while let Some(&(at, missing)) = self.run.missing.first()
            && now > at + bounds::WATCHDOG_LONGEST
        {
            self.run.missing.remove(0);
            tell(at, missing, findings);
        }
    }

    fn restart(&mut self, at: u64, powered: bool, asked: bool, context: &Context, findings: &mut Findings) {
        if asked {
            self.tell_missing(findings);
        }
        self.conclude(context);
        self.run = Run::new(at, powered);
    }

    fn tell_missing(&mut self, findings: &mut Findings) {
        for (at, missing) in self.run.missing.drain(..) {
            tell(at, missing, findings);
        }
    }

    fn without_frame(&mut self, command: Command, disturbances: &Disturbances, findings: &mut Findings) {
        if !command.cut_off && !disturbances.excuse(Excuse::Sending, command.at) {
            findings.add(Violation::CommandWithoutFrame, command.at, || format!("the one given at {}", ms(command.at)));
            self.run.lost = self.run.lost.max(Some(command.at));
            if let Some(tick) = self.run.tick_of(command.at) {
                tick.blamed = true;
            }
        }
    }

    fn tick(&mut self, at: u64, disturbances: &Disturbances, findings: &mut Findings) {
        let (number, regular) = match self.run.tick {
            None => (Number { least: 1, most: 1 }, true),
            Some(Tick { at: before, number: Number { least, most }, .. }) => {
                let interval = at - before;
                if std::mem::take(&mut self.run.tick_missing) {
                    let passed = (interval + bounds::CYCLE / 2) / bounds::CYCLE;
                    (Number { least: least + 1, most: most + passed }, false)
                } else if interval.abs_diff(bounds::CYCLE) > bounds::TICK_TOLERANCE {
                    findings.add(Violation::TickIrregular, at, || {
                        format!("{interval} ns from the one before, at {}", ms(at))
                    });
                    (Number { least, most: most + 1 }, false)
                } else {
                    if !disturbances.excuse(Excuse::Rate, at) {
                        self.run.jitter.ticks.push(interval, at);
                    }
                    (Number { least: least + 1, most: most + 1 }, true)
                }
            }
        };
        self.close(at, regular);
        let run = &mut self.run;
        run.tick_missing = false;
        let before = std::mem::replace(&mut run.before, run.tick);
        self.measure(before);
        let run = &mut self.run;
        run.tick = Some(Tick {
            at,
            number,
            blamed: !regular,
            cut_off: run.hung
                || run.dropped
                || run.back.is_some_and(|back| at < back + bounds::FIELD_READY)
                || disturbances.excuse(Excuse::Sending, at),
            frames: [None; 2],
            others: 0,
        });
    }

    /// Ends the present cycle at the next tick, `now`. `in_time` says whether that tick came in time.
    fn close(&mut self, now: u64, in_time: bool) {
        let run = &mut self.run;
        let Some(tick) = &mut run.tick else { return };
        // A frame is logged only at its end, so the last frame of the cycle may still be on the air.
        let under_way = run.commands.iter().filter(|command| command.at >= tick.at).count();
        let (sent, wanted) = (tick.sent(), self.layout.frames());
        if in_time && !tick.cut_off && sent + tick.others + under_way < wanted {
            run.missing.push((now, Missing::Frames { of: tick.at, sent, wanted }));
            run.lost = run.lost.max(Some(tick.at));
            tick.blamed = true;
        }
    }

    /// Adds a cycle's times to the series of the jitter, if all are known and the cycle has no violation.
    fn measure(&mut self, tick: Option<Tick>) {
        let (run, measured) = (&mut self.run, &mut self.measured);
        let led = run.led.take();
        let Some(tick) = tick.filter(|tick| !tick.blamed && !tick.cut_off) else { return };
        for (number, frame) in tick.frames.into_iter().enumerate() {
            let Some((command, started)) = frame else { continue };
            let (to_command, to_air) = (command - tick.at, started - tick.at);
            run.jitter.command[number].push(to_command, command);
            run.jitter.air[number].push(to_air, started);
            if number == 0 {
                measured.command.push(to_command, command);
                measured.air.push(to_air, started);
                if let Some(led) = led {
                    measured.period.push(started - led, started);
                }
                run.led = Some(started);
            }
        }
    }

    fn conclude(&mut self, context: &Context) {
        let (before, tick) = (self.run.before, self.run.tick);
        self.measure(before);
        self.measure(tick);
        self.worst.start_over(&self.run.jitter, self.layout, context);
    }

    fn field(&mut self, at: u64, on: bool, disturbances: &Disturbances, findings: &mut Findings) {
        let run = &mut self.run;
        if on {
            if std::mem::take(&mut run.dropped) {
                run.back = Some(at);
            }
            run.field = true;
            return;
        }
        if !std::mem::take(&mut run.field) {
            return;
        }
        run.dropped = true;
        let waited_in_vain = run.commands.iter().any(|command| !command.cut_off && at > whole_by(command));
        self.cut_off(at);
        let run = &self.run;
        let gone = disturbances.excuse(Excuse::Sending, at) || run.hung;
        if !gone && !waited_in_vain && run.lost.is_none_or(|lost| at > lost + bounds::FIELD_RECOVERY) {
            findings.add(Violation::FieldDropped, at, || format!("at {}", ms(at)));
        }
    }

    /// Records that a restart or a loss of the field at the instant `at` may cut off the commands and frames under way.
    fn cut_off(&mut self, at: u64) {
        if let Some(tick) = &mut self.run.tick {
            tick.cut_off = true;
        }
        for command in self.run.commands.iter_mut().filter(|command| at <= whole_by(command)) {
            command.cut_off = true;
        }
    }

    /// Judges a frame that began after HORUS's last start.
    fn sent(
        &mut self,
        at: u64,
        started: u64,
        whole: bool,
        frame: &Frame,
        disturbances: &Disturbances,
        findings: &mut Findings,
    ) {
        let command = self.command_of(started, disturbances, findings);
        let run = &mut self.run;
        if !whole && !run.field {
            // HORUS's field went off while the frame was on the air.
            return;
        }
        run.field |= whole;
        let others = |run: &mut Run| {
            if let Some(tick) = run.tick_of(started) {
                tick.others += 1;
                tick.blamed = true;
            }
        };
        if !whole && (run.hung || disturbances.excuse(Excuse::Sending, at)) {
            return others(run);
        }
        if !whole {
            findings.add(Violation::BrokenOff, at, || format!("after {} bytes, at {}", frame.payload.len(), ms(at)));
            run.lost = Some(at);
            return others(run);
        }
        self.tell_missing(findings);
        let run = &mut self.run;
        let Some(command) = command else {
            findings.add(Violation::FrameWithoutCommand, at, || format!("the one that began at {}", ms(started)));
            return others(run);
        };
        if frame.number.is_none() && disturbances.excuse(Excuse::Sending, at) {
            // The front end's register with the frame's length may hold a wrong value.
            return others(run);
        }
        let Some(number) = frame.number.or(disturbances.excuse(Excuse::Damage, at).then_some(0)) else {
            let length = frame.payload.len();
            findings
                .add(Violation::SentNotWhole, at, || format!("{length} bytes, in the frame that ended at {}", ms(at)));
            return others(run);
        };
        if disturbances.excuse(Excuse::Damage, at) {
            return others(run);
        }
        match run.tick_of(started) {
            Some(tick) if started > tick.at + bounds::CYCLE - bounds::TICK_TOLERANCE => {
                let Number { least, most } = tick.number;
                let mut number = Number { least, most: most + (started - tick.at) / bounds::CYCLE };
                objects_are_right(at, frame, &mut number, findings);
            }
            Some(tick) if tick.frames.iter().skip(number).all(Option::is_none) => {
                tick.frames[number] = Some((command, started));
                tick.blamed |= !objects_are_right(at, frame, &mut tick.number, findings);
            }
            tick => {
                let of =
                    tick.map_or("before the first tick".to_owned(), |tick| format!("of the cycle of {}", ms(tick.at)));
                findings.add(Violation::ExtraFrame, at, || format!("frame {} {of}, at {}", number + 1, ms(at)));
                others(run);
            }
        }
    }

    /// Returns the instant of the command that started the frame begun at `started`. Reports earlier commands without a
    /// frame.
    fn command_of(&mut self, started: u64, disturbances: &Disturbances, findings: &mut Findings) -> Option<u64> {
        let given = self.run.commands.iter().take_while(|command| command.at <= started).count();
        let mut own = None;
        for number in (0..given).rev() {
            let command = self.run.commands.remove(number);
            if number + 1 == given && started - command.at <= bounds::COMMAND_TO_AIR {
                own = Some(command.at);
            } else {
                self.without_frame(command, disturbances, findings);
            }
        }
        own
    }
}

/// Returns the instant, ns, by which the frame of a command must have ended.
const fn whole_by(command: &Command) -> u64 {
    command.at + bounds::COMMAND_TO_AIR + bounds::FRAME_LONGEST
}

fn objects_are_right(at: u64, frame: &Frame, number: &mut Number, findings: &mut Findings) -> bool {
    let mut right = true;
    for object in &frame.objects {
        let why = match &object.state {
            State::Valid { .. } => continue,
            State::Vacant => "nothing in its place".to_owned(),
            State::Unsound(rejection) => rejection.to_string(),
        };
        right = false;
        findings.add(Violation::SentInvalid, at, || format!("object {} at {}: {why}", object.index, ms(at)));
    }
    // The loop ends with Reported-Position. If a GPS object with a timestamp came before it, rule `content` judges the
    // timestamp of Reported-Position.
    let mut against = false;
    for object in frame.objects.iter().rev() {
        let Some(timestamp) = object.timestamp().filter(|_| object.index > 0 || !against) else { continue };
        against = true;
        if !number.is_stamped(timestamp) {
            let expected = number.least * u64::from(CYCLE_MS);
            findings.add(Violation::TimestampWrong, at, || {
                format!("object {} is stamped {timestamp} ms instead of {expected} ms, at {}", object.index, ms(at))
            });
            return false;
        }
    }
    right
}

fn tell(at: u64, missing: Missing, findings: &mut Findings) {
    match missing {
        Missing::Tick { after } => findings.add(Violation::NoTick, at, || match after {
            Some(tick) => format!("after the one at {}", ms(tick)),
            None => format!("from the start until {}", ms(at)),
        }),
        Missing::Frames { of, sent, wanted } => {
            findings.add(Violation::NoFrame, at, || format!("{sent} of {wanted} in the cycle of {}", ms(of)));
        }
    }
}
