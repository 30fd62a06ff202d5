//! What a run is judged by: instants seen from outside, and what follows from them.
//!
//! The ledger knows nothing of either firmware's inside. It is told what a logic analyser on the wires would see: the
//! 10 ms timer's ticks, frames on the air with their bytes, the FRESH pin, and what the flight controller got. From
//! that come the latencies and most violations:
//!
//! - *Truth* is what HORUS put on the air. An object that the flight controller takes for valid and that was never sent
//!   is a violation, however it came about.
//! - *Readable* is the rising edge of FRESH. It is a claim, and each transaction that begins after it checks the claim:
//!   it must bring that publication's data or newer.

use std::collections::BTreeMap;

use profile::{CYCLE_MS, Identifier, Layout, Object};

use crate::report::{Max, Quantiles, Span};

/// Bounds from the design's timing table, ns.
pub mod bounds {
    /// HORUS tick to transmit command (chip select rising after it), peak to peak: what the firmware answers for.
    pub const TICK_TO_COMMAND_JITTER: u64 = 100;
    /// The same on the pessimistic clock, where an interrupt may meet the longest instruction.
    pub const TICK_TO_COMMAND_JITTER_PESSIMISTIC: u64 = 1_000;
    /// HORUS tick to first bit on air, peak to peak: the front end itself scatters by up to 2.3 µs.
    pub const TICK_TO_AIR_JITTER: u64 = 3_000;
    /// The cycle's period may differ from cycle to cycle by what the send jitter allows.
    pub const PERIOD_WIDTH: u64 = 2 * TICK_TO_AIR_JITTER;
    /// Last bit to image readable, with a listener that reads its FIFO while it fills.
    pub const LAST_BIT_TO_READABLE: u64 = 100_000;
    /// End of an SSI transaction to ready for the next; the DPR may put a new image in for no longer either.
    pub const SSI_READY: u64 = 10_000;
    /// A sample is readable before its successor is taken.
    pub const SAMPLE_TO_READABLE: u64 = 10_000_000;
}

/// Violations of one kind are told once, with how many there were.
#[derive(Clone, Debug, Default)]
pub struct Violations(BTreeMap<&'static str, (String, u64)>);

impl Violations {
    /// Notes one; `first` is kept for the first of its kind alone.
    pub fn add(&mut self, kind: &'static str, first: impl FnOnce() -> String) {
        self.0.entry(kind).and_modify(|(_, count)| *count += 1).or_insert_with(|| (first(), 1));
    }

    /// How many there were of each kind.
    #[must_use]
    pub fn counts(&self) -> BTreeMap<&'static str, u64> {
        self.0.iter().map(|(kind, (_, count))| (*kind, *count)).collect()
    }

    /// In words, in a fixed order.
    #[must_use]
    pub fn into_words(self) -> Vec<String> {
        self.0
            .into_iter()
            .map(|(kind, (first, count))| match count {
                1 => format!("{kind}: {first}"),
                _ => format!("{kind}: {first} (and {} more)", count - 1),
            })
            .collect()
    }
}

/// One frame on the air.
#[derive(Clone, Copy, Debug)]
struct Frame {
    started: u64,
    /// When its last bit had passed; `None` while it is on the air.
    ended: Option<u64>,
    /// The timestamp of its first object, ms.
    timestamp: Option<u32>,
    /// Whether it is the first frame of its cycle.
    leads: bool,
}

/// A transaction of the flight controller, as far as the ledger cares.
#[derive(Clone, Debug)]
pub struct Seen {
    /// When chip select fell.
    pub selected: u64,
    /// The valid objects it brought: identifier, timestamp, bytes.
    pub objects: Vec<(Identifier, u32, Vec<u8>)>,
}

/// Instants of a run.
#[derive(Clone, Debug)]
pub struct Ledger {
    layout: Layout,
    ticks: Vec<u64>,
    /// When HORUS had given its front end a transmit command.
    commands: Vec<u64>,
    frames: Vec<Frame>,
    /// Every object sent, by timestamp and identifier, of the last cycles.
    sent: BTreeMap<(u32, u16), Vec<u8>>,
    fresh: Vec<u64>,
    /// How many of `fresh` some transaction has confirmed, and the timestamp it brought.
    readable: Vec<(u64, u32)>,
    newest: Option<u32>,
    /// When chip select rose, and how long after it the DPR was ready.
    ready: Vec<(u64, u64)>,
    /// The DPR has been ready for a transaction at least once.
    started: bool,
    deselected: Option<u64>,
    /// Since when the DPR answers no transaction.
    held: Option<u64>,
    /// How long the longest hold was, and since when.
    longest_hold: (u64, u64),
    /// The last transaction met the DPR busy.
    was_busy: bool,
    /// What was broken so far.
    pub violations: Violations,
}

/// Objects of how many cycles are kept as truth: far more than an image can be old.
const REMEMBERED_CYCLES: u32 = 100;

impl Ledger {
    /// An empty ledger for a link with profiles of this layout.
    #[must_use]
    pub fn new(layout: Layout) -> Self {
        Self {
            layout,
            ticks: vec![],
            commands: vec![],
            frames: vec![],
            sent: BTreeMap::new(),
            fresh: vec![],
            readable: vec![],
            newest: None,
            ready: vec![],
            started: false,
            deselected: None,
            held: None,
            longest_hold: (0, 0),
            was_busy: false,
            violations: Violations::default(),
        }
    }

    /// The 10 ms timer ticked.
    pub fn tick(&mut self, at: u64) {
        self.ticks.push(at);
    }

    /// HORUS has given its front end a transmit command: chip select rose. Told in order of time, before the frame
    /// begins.
    pub fn commanded(&mut self, at: u64) {
        self.commands.push(at);
    }

    /// The first preamble bit of a frame is on the air.
    pub fn frame_started(&mut self, at: u64) {
        self.frames.push(Frame { started: at, ended: None, timestamp: None, leads: true });
    }

    /// A frame's last bit has passed; its payload as it was sent.
    pub fn frame_ended(&mut self, at: u64, payload: &[u8]) {
        let mut objects = vec![];
        match self.layout.objects_of(payload) {
            Ok(parts) => {
                for (index, bytes) in parts {
                    match Object::verify(index, bytes) {
                        Ok(object) => objects.push((object.timestamp(), object.identifier().0, bytes.to_vec())),
                        Err(why) => self.violations.add("HORUS sent an object that is not valid", || {
                            format!("object {index} at {}: {why}", ms(at))
                        }),
                    }
                }
            }
            Err(_) => {
                let length = payload.len();
                self.violations
                    .add("HORUS sent something that is not whole objects", || format!("{length} bytes at {}", ms(at)));
            }
        }
        let Some(frame) = self.frames.last_mut() else { return };
        frame.ended = Some(at);
        if let Some(&(timestamp, identifier, _)) = objects.first() {
            frame.timestamp = Some(timestamp);
            frame.leads = Identifier(identifier) == Identifier::REPORTED_POSITION;
            while let Some((&(oldest, id), _)) = self.sent.first_key_value() {
                // Timestamps wrap after 49 days; a run is at most a day.
                if timestamp.saturating_sub(oldest) <= REMEMBERED_CYCLES * CYCLE_MS {
                    break;
                }
                self.sent.remove(&(oldest, id));
            }
        }
        self.sent.extend(objects.into_iter().map(|(timestamp, id, bytes)| ((timestamp, id), bytes)));
    }

    /// FRESH rose: the DPR says that a new image is what the next transaction gets.
    pub fn fresh(&mut self, at: u64) {
        self.fresh.push(at);
    }

    /// The flight controller's chip select rose. Until the DPR has started it need not be ready for anything.
    pub fn deselected(&mut self, at: u64) {
        if !self.started {
            return;
        }
        if let Some(ended) = self.deselected.replace(at) {
            self.violations.add("SSI not ready in time", || {
                format!("the transaction that ended at {} was not followed by readiness", ms(ended))
            });
        }
    }

    /// The DPR's processor takes the SSI's buffers: a transaction that begins now meets it busy.
    pub fn held(&mut self, at: u64) {
        self.held = Some(at);
    }

    /// The DPR's processor gives the SSI's buffers back.
    pub fn released(&mut self, at: u64) {
        if let Some(held) = self.held.take() {
            self.longest_hold = self.longest_hold.max((at - held, held));
        }
    }

    /// Whether the transaction that began at `selected` met the DPR busy: one may, while a new image is put in; its
    /// successor must not. Until the DPR has started each does.
    pub fn busy(&mut self, selected: u64, busy: bool) {
        let busy = busy && self.started;
        if std::mem::replace(&mut self.was_busy, busy) && busy {
            self.violations.add("two transactions in a row met the DPR busy", || ms(selected));
        }
    }

    /// The DPR can serve a transaction.
    pub fn ready(&mut self, at: u64) {
        self.started = true;
        if let Some(ended) = self.deselected.take() {
            self.ready.push((ended, at - ended));
        }
    }

    /// The flight controller has read a transaction to its end.
    pub fn transaction(&mut self, seen: &Seen) {
        let at = ms(seen.selected);
        for (identifier, timestamp, bytes) in &seen.objects {
            if self.sent.get(&(*timestamp, identifier.0)) != Some(bytes) {
                self.violations.add("an invalid object shown as valid", || {
                    format!("{:#06x} stamped {timestamp} ms, read at {at}, was never sent", identifier.0)
                });
            }
        }
        let Some(&(_, timestamp, _)) = seen.objects.iter().find(|(id, ..)| *id == Identifier::REPORTED_POSITION) else {
            return;
        };
        if self.newest.is_some_and(|newest| timestamp < newest) {
            self.violations.add("old data shown after new", || format!("{timestamp} ms read at {at}"));
        }
        self.newest = self.newest.max(Some(timestamp));
        // The last publication announced before this transaction began is the one it must bring.
        let announced = self.fresh.partition_point(|rose| *rose < seen.selected);
        let Some(&rose) = announced.checked_sub(1).and_then(|last| self.fresh.get(last)) else {
            self.violations.add("an image readable without FRESH", || format!("{timestamp} ms read at {at}"));
            return;
        };
        match self.readable.last() {
            Some(&(before, confirmed)) if before == rose => {
                if confirmed != timestamp {
                    self.violations.add("an image changed without FRESH", || {
                        format!("from {confirmed} ms to {timestamp} ms, read at {at}")
                    });
                }
            }
            Some(&(_, confirmed)) if timestamp <= confirmed => {
                self.violations.add("FRESH without a fresh image", || {
                    format!("at {}, and {timestamp} ms was read at {at}", ms(rose))
                });
            }
            _ => self.readable.push((rose, timestamp)),
        }
    }

    /// The instant of the tick that stamps objects with `timestamp`: the k-th tick stamps 10·k ms.
    fn sampled(&self, timestamp: u32) -> Option<u64> {
        let index = usize::try_from(timestamp / CYCLE_MS).ok()?.checked_sub(1)?;
        self.ticks.get(index).copied()
    }

    /// Frames begun so far.
    #[must_use]
    pub fn frames_sent(&self) -> u64 {
        self.frames.len() as u64
    }

    /// When frames begin each cycle: those that lead one.
    fn leads(&self) -> impl Iterator<Item = &Frame> {
        // Of a frame that is still on the air at the end of the run it is not known whether it leads.
        self.frames.iter().filter(|frame| frame.leads && frame.ended.is_some())
    }

    /// Between the first frames of two cycles in a row.
    #[must_use]
    pub fn period(&self) -> Span {
        let started: Vec<u64> = self.leads().map(|frame| frame.started).collect();
        Span::of(started.windows(2).map(|pair| pair[1] - pair[0]))
    }

    /// From the tick to the transmit command of the cycle's first frame: the last command before that frame was on the
    /// air.
    #[must_use]
    pub fn tick_to_command(&self) -> Span {
        Span::of(self.leads().filter_map(|frame| {
            let tick = self.sampled(frame.timestamp?)?;
            let commanded = self.commands.partition_point(|at| *at <= frame.started).checked_sub(1)?;
            self.commands.get(commanded)?.checked_sub(tick)
        }))
    }

    /// From the tick to the first preamble bit of the cycle's first frame.
    #[must_use]
    pub fn tick_to_air(&self) -> Span {
        Span::of(self.leads().filter_map(|frame| Some(frame.started - self.sampled(frame.timestamp?)?)))
    }

    /// From the sample to the image that holds it being readable.
    #[must_use]
    pub fn sample_to_readable(&self) -> Quantiles {
        Quantiles::of(self.readable.iter().filter_map(|&(rose, timestamp)| Some(rose - self.sampled(timestamp)?)))
    }

    /// From the cycle's last bit on the air to the same.
    #[must_use]
    pub fn last_bit_to_readable(&self) -> Max {
        Max::of(self.readable_after().map(|(took, _)| took))
    }

    /// How long each cycle's last bit took to be readable, and when FRESH rose.
    fn readable_after(&self) -> impl Iterator<Item = (u64, u64)> {
        let mut last_bits = BTreeMap::new();
        for frame in &self.frames {
            if let (Some(timestamp), Some(ended)) = (frame.timestamp, frame.ended) {
                last_bits.insert(timestamp, ended);
            }
        }
        self.readable
            .iter()
            .filter_map(move |(rose, timestamp)| Some((rose.checked_sub(*last_bits.get(timestamp)?)?, *rose)))
    }

    /// From chip select rising to the DPR being able to serve the next transaction.
    #[must_use]
    pub fn ready_after(&self) -> Max {
        Max::of(self.ready.iter().map(|(_, took)| *took))
    }

    /// Holds the whole run against the design's timing table, at its end (`end`, ns). From tick to command may vary by
    /// `command_jitter` (ns), which depends on the cores' clock.
    pub fn judge(&mut self, end: u64, command_jitter: u64) {
        let (period, command, air) = (self.period(), self.tick_to_command(), self.tick_to_air());
        let (commands, frames) = (self.commands.len(), self.frames.len());
        // The run may end between a command and the first bit of its frame.
        if commands != frames && commands != frames + 1 {
            self.violations.add("frames and transmit commands do not correspond", || {
                format!("{commands} commands and {frames} frames")
            });
        }
        let sample = self.sample_to_readable();
        let last_bit = self.readable_after().max().unwrap_or_default();
        let ready = self.ready.iter().map(|(at, took)| (*took, *at)).max().unwrap_or_default();
        let hold = self.longest_hold.max(self.held.map_or((0, 0), |held| (end.saturating_sub(held), held)));
        let mut bound = |kind, value: u64, bound: u64| {
            if value > bound {
                self.violations.add(kind, || format!("{value} ns, the bound is {bound} ns"));
            }
        };
        bound("the period is not constant", period.width(), bounds::PERIOD_WIDTH);
        bound("the time from tick to command is not constant", command.width(), command_jitter);
        bound("the time from tick to air is not constant", air.width(), bounds::TICK_TO_AIR_JITTER);
        bound("a sample was readable too late", sample.max, bounds::SAMPLE_TO_READABLE);
        // The worst of each with its instant, so that it can be looked at in a trace.
        let mut bound_at = |kind, (value, at): (u64, u64), bound: u64| {
            if value > bound {
                self.violations.add(kind, || format!("{value} ns at {}, the bound is {bound} ns", ms(at)));
            }
        };
        bound_at("a frame was readable too late after its last bit", last_bit, bounds::LAST_BIT_TO_READABLE);
        bound_at("SSI not ready in time", ready, bounds::SSI_READY);
        bound_at("the SSI was held back too long", hold, bounds::SSI_READY);
        if !self.started {
            self.violations.add("the DPR never got ready for a transaction", || format!("in {}", ms(end)));
        }
        self.judge_cycles(end);
    }

    /// Once the link runs, every tick has its frames.
    fn judge_cycles(&mut self, end: u64) {
        let Some(first) = self.frames.first().map(|frame| frame.started) else {
            self.violations.add("HORUS sent nothing", || format!("in {}", ms(end)));
            return;
        };
        let mut cycles: BTreeMap<u32, usize> = BTreeMap::new();
        for frame in &self.frames {
            // The run may end while a frame is on the air.
            if let Some(timestamp) = frame.timestamp {
                *cycles.entry(timestamp).or_default() += 1;
            }
        }
        let complete = self.ticks.partition_point(|tick| tick + bounds::SAMPLE_TO_READABLE <= end);
        for (index, tick) in self.ticks.iter().enumerate().take(complete).filter(|(_, tick)| **tick >= first) {
            let timestamp = u32::try_from(index + 1).unwrap_or(u32::MAX).saturating_mul(CYCLE_MS);
            let sent = cycles.get(&timestamp).copied().unwrap_or(0);
            let wanted = self.layout.frames();
            if sent != wanted {
                self.violations.add("a missed deadline", || {
                    format!("{sent} of {wanted} frames sent in the cycle of {}", ms(*tick))
                });
            }
        }
    }
}

/// An instant for a person.
pub(crate) fn ms(at: u64) -> String {
    format!("{:.6} ms", at as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use profile::{GpsValues, Profile, ReportedValues};

    const AIR: u64 = 4_000_000;

    fn layout() -> Layout {
        Layout::for_receivers(1).unwrap()
    }

    fn payload(timestamp: u32) -> Vec<u8> {
        Profile::<1>::seal(&ReportedValues::absent(timestamp), &[GpsValues::absent(timestamp)]).as_bytes().to_vec()
    }

    fn seen(selected: u64, bytes: &[u8]) -> Seen {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        Seen {
            selected,
            objects: vec![
                (Identifier::REPORTED_POSITION, word(0), bytes[..64].to_vec()),
                (Identifier::gps(1), word(64), bytes[64..].to_vec()),
            ],
        }
    }

    /// Ten flawless cycles.
    fn run() -> Ledger {
        let mut ledger = Ledger::new(layout());
        for cycle in 1..=10 {
            let tick = cycle * 10_000_000;
            let bytes = payload(cycle as u32 * 10);
            ledger.tick(tick);
            ledger.commanded(tick + 297_000);
            ledger.frame_started(tick + 300_000);
            ledger.frame_ended(tick + 300_000 + AIR, &bytes);
            ledger.fresh(tick + 300_000 + AIR + 100_000);
            ledger.transaction(&seen(tick + 5_000_000, &bytes));
            ledger.deselected(tick + 5_300_000);
            ledger.ready(tick + 5_304_000);
        }
        ledger
    }

    #[test]
    fn a_flawless_run_has_its_figures_and_no_violation() {
        let mut ledger = run();
        ledger.judge(111_000_000, bounds::TICK_TO_COMMAND_JITTER);
        assert_eq!(ledger.period(), Span { min: 10_000_000, max: 10_000_000 });
        assert_eq!(ledger.tick_to_command(), Span { min: 297_000, max: 297_000 });
        assert_eq!(ledger.tick_to_air(), Span { min: 300_000, max: 300_000 });
        assert_eq!(ledger.sample_to_readable().p999, 4_400_000);
        assert_eq!(ledger.last_bit_to_readable().max, 100_000);
        assert_eq!(ledger.ready_after().max, 4_000);
        assert_eq!(ledger.violations.into_words(), [""; 0]);
    }

    #[test]
    fn an_object_that_was_never_sent_is_a_violation() {
        let mut ledger = run();
        let mut bytes = payload(100);
        bytes[70] ^= 1;
        ledger.transaction(&seen(109_000_000, &bytes));
        assert!(ledger.violations.into_words()[0].starts_with("an invalid object shown as valid"));
    }

    #[test]
    fn old_data_after_new_is_a_violation() {
        let mut ledger = run();
        ledger.transaction(&seen(109_000_000, &payload(50)));
        assert!(ledger.violations.into_words().iter().any(|words| words.starts_with("old data shown after new")));
    }

    #[test]
    fn an_announcement_that_the_next_transaction_does_not_bear_out_is_a_violation() {
        let mut ledger = run();
        ledger.fresh(108_000_000);
        ledger.transaction(&seen(109_000_000, &payload(100)));
        assert!(ledger.violations.into_words()[0].starts_with("FRESH without a fresh image"));
    }

    #[test]
    fn jitter_and_a_skipped_cycle_are_violations() {
        let mut ledger = run();
        ledger.tick(110_000_000);
        ledger.tick(120_000_000);
        let bytes = payload(120);
        ledger.commanded(120_297_101);
        ledger.frame_started(120_303_001);
        ledger.frame_ended(124_303_001, &bytes);
        ledger.judge(131_000_000, bounds::TICK_TO_COMMAND_JITTER);
        let words = ledger.violations.into_words();
        for kind in [
            "a missed deadline: 0 of 1 frames",
            "the period is not constant",
            "the time from tick to command is not constant: 101 ns, the bound is 100 ns",
            "the time from tick to air is not constant",
        ] {
            assert!(words.iter().any(|violation| violation.starts_with(kind)), "{kind}: {words:?}");
        }
    }

    #[test]
    fn the_front_ends_own_scatter_is_in_the_time_to_air_and_not_in_the_time_to_command() {
        let mut ledger = Ledger::new(layout());
        for cycle in 1..=10 {
            let tick = cycle * 10_000_000;
            let start = tick + 300_000 + cycle % 2 * 2_300;
            ledger.tick(tick);
            ledger.commanded(tick + 297_000 + cycle % 3);
            ledger.frame_started(start);
            ledger.frame_ended(start + AIR, &payload(cycle as u32 * 10));
        }
        ledger.ready(111_000_000);
        ledger.judge(111_000_000, bounds::TICK_TO_COMMAND_JITTER);
        assert_eq!((ledger.tick_to_command().width(), ledger.tick_to_air().width()), (2, 2_300));
        assert_eq!(ledger.violations.into_words(), [""; 0]);
    }

    #[test]
    fn until_the_dpr_has_started_nothing_is_asked_of_it_and_one_that_never_starts_is_a_violation() {
        let mut ledger = Ledger::new(layout());
        ledger.deselected(1_000_000);
        ledger.busy(900_000, true);
        ledger.deselected(5_000_000);
        ledger.busy(4_900_000, true);
        assert_eq!(ledger.violations.clone().into_words(), [""; 0]);
        ledger.judge(6_000_000, bounds::TICK_TO_COMMAND_JITTER);
        let words = ledger.violations.into_words();
        assert!(words.iter().any(|word| word.starts_with("the DPR never got ready for a transaction")), "{words:?}");
    }

    #[test]
    fn a_frame_that_no_command_began_is_a_violation() {
        let mut ledger = run();
        ledger.commands.remove(4);
        ledger.judge(111_000_000, bounds::TICK_TO_COMMAND_JITTER);
        assert_eq!(
            ledger.violations.clone().into_words()[0],
            "frames and transmit commands do not correspond: 9 commands and 10 frames"
        );
    }

    #[test]
    fn a_transaction_after_which_the_ssi_never_got_ready_is_a_violation() {
        let mut ledger = run();
        ledger.deselected(108_000_000);
        assert_eq!(ledger.violations.clone().into_words(), [""; 0]);
        ledger.deselected(109_000_000);
        assert!(
            ledger.violations.into_words()[0].starts_with("SSI not ready in time: the transaction that ended at 108")
        );
    }

    #[test]
    fn one_busy_transaction_is_none_and_two_in_a_row_are_a_violation() {
        let mut ledger = run();
        for busy in [true, false, true, false] {
            ledger.busy(108_000_000, busy);
        }
        assert_eq!(ledger.violations.clone().into_words(), [""; 0]);
        ledger.busy(108_000_000, true);
        ledger.busy(109_000_000, true);
        assert_eq!(ledger.violations.into_words(), ["two transactions in a row met the DPR busy: 109.000000 ms"]);
    }

    #[test]
    fn an_ssi_that_is_held_back_is_a_violation() {
        let mut ledger = run();
        ledger.held(108_000_000);
        ledger.released(108_010_000);
        ledger.judge(111_000_000, bounds::TICK_TO_COMMAND_JITTER);
        assert_eq!(ledger.violations.clone().into_words(), [""; 0]);
        // A board stops at its first instruction boundary after the end.
        ledger.held(111_000_020);
        ledger.judge(111_000_000, bounds::TICK_TO_COMMAND_JITTER);
        assert_eq!(ledger.violations.clone().into_words(), [""; 0]);
        ledger.held(109_000_000);
        ledger.judge(111_000_000, bounds::TICK_TO_COMMAND_JITTER);
        assert!(ledger.violations.into_words()[0].starts_with("the SSI was held back too long: 2000000 ns"));
    }

    #[test]
    fn repeated_violations_of_a_kind_are_counted() {
        let mut violations = Violations::default();
        for index in 0..3 {
            violations.add("kind", || format!("number {index}"));
        }
        assert_eq!(violations.into_words(), ["kind: number 0 (and 2 more)"]);
    }
}
