//! The timers TIM1 to TIM14 (RM0090 chapters 17 to 20).
//!
//! | Covered | Manual |
//! |---|---|
//! | Up, down and centre-aligned counting, 16 and 32 bits, `PSC`, `ARR`, `RCR` with their preload | 17.3.1 to 17.3.3 |
//! | `UG`, `UDIS`, `URS`, `OPM`; the count begins one timer clock after `CEN` | 17.3.2, 17.3.4 |
//! | Compare: flags, output modes 0 to 7, `CCxE`, `CCxP`, `CCxNE`, `CCxNP`, `MOE` | 17.3.8 to 17.3.11 |
//! | Capture: source, edge, prescaler, over-capture | 17.3.5, 17.3.6 |
//! | Encoder, reset, gated, trigger, external clocks 1 and 2; triggers between timers | 17.3.16, 17.3.20 |
//! | Break input: flag, `MOE` cleared, `AOE` | 17.3.12 |
//! | Dead time (`DTG`, `CKD`) after each edge of a reference whose channel has both outputs enabled | 17.3.11 |
//! | DMA requests of update, channels and trigger; bursts through `DCR` and `DMAR` | 17.4.19 |
//!
//! **Left out, each a finding when it is set up:** the commutation event (`CCPC`, `COMG`), the external clear of a
//! reference (`OCxCE`), the option registers, the gated mode on another timer's trigger, `LOCK`. No dead time passes
//! before the outputs take their idle levels.
//! The input filters are taken as off.
//!
//! # Time
//!
//! The counter is not stepped: its value follows from the timer clock cycles since it was last looked at. Only what
//! something can see (an interrupt, a DMA request, a pin, another timer) is an event at its own cycle; flags that are
//! merely polled are brought up to date when they are read. A compare flag rises in the timer clock cycle in which the
//! counter takes the compare value. A compare value written equal to the counter matches when the counter next takes
//! it.

use bench_seam::{Cycle, FindingKind, NEVER};
use cortex_m4::Width;

use crate::cx::{Clocks, Cx, Peripheral, Signal, TimPin, Trigger, Wires};

const CEN: u32 = 1 << 0;
const UDIS: u32 = 1 << 1;
const URS: u32 = 1 << 2;
const OPM: u32 = 1 << 3;
const DIR: u32 = 1 << 4;
const ARPE: u32 = 1 << 7;
/// CR2.CCDS: channels ask the DMA at the update.
const CCDS: u32 = 1 << 3;
/// CR2.TI1S: the exclusive or of three pins is the first input.
const TI1S: u32 = 1 << 7;
const UIF: u32 = 1 << 0;
const TIF: u32 = 1 << 6;
const BIF: u32 = 1 << 7;
const UDE: u32 = 1 << 8;
const TDE: u32 = 1 << 14;
const MOE: u32 = 1 << 15;
const AOE: u32 = 1 << 14;
const BKP: u32 = 1 << 13;
const BKE: u32 = 1 << 12;
/// SMCR.ECE: the external trigger input clocks the counter.
const ECE: u32 = 1 << 14;
/// SMCR.ETP: the external trigger is inverted.
const ETP: u32 = 1 << 15;

/// Interrupt outputs of TIM1 and TIM8, see [`Peripheral::irq`]; the other timers have one line.
const IRQ_BREAK: u32 = 1 << 0;
const IRQ_UPDATE: u32 = 1 << 1;
const IRQ_TRIGGER: u32 = 1 << 2;
const IRQ_CHANNELS: u32 = 1 << 3;

/// DMA requests, see [`Peripheral::dma`]; channel n's is bit n (1 to 4).
const DMA_UPDATE: u32 = 1 << 0;
const DMA_TRIGGER: u32 = 1 << 5;

/// Index of the external trigger among a timer's inputs; 0 to 3 are channels 1 to 4.
const INPUT_ETR: usize = 4;
/// Index of the break input.
const INPUT_BREAK: usize = 5;

/// The outputs as signals, in the order of [`Outputs`]' bits.
const OUTPUT_PINS: [TimPin; 7] =
    [TimPin::Ch1, TimPin::Ch2, TimPin::Ch3, TimPin::Ch4, TimPin::Ch1N, TimPin::Ch2N, TimPin::Ch3N];

/// What one of the fourteen timers has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kind {
    /// 1 to 14.
    number: u8,
    channels: u8,
    /// The largest count: 16 or 32 ones.
    largest: u32,
    /// TIM1 and TIM8: repetition, break, complementary outputs.
    advanced: bool,
    /// Counts down and centre-aligned.
    downward: bool,
    /// Slave mode controller.
    slave: bool,
}

impl Kind {
    const fn of(number: u8) -> Self {
        let (channels, largest) = match number {
            2 | 5 => (4, u32::MAX),
            1 | 3 | 4 | 8 => (4, 0xFFFF),
            9 | 12 => (2, 0xFFFF),
            6 | 7 => (0, 0xFFFF),
            _ => (1, 0xFFFF),
        };
        Self {
            number,
            channels,
            largest,
            advanced: matches!(number, 1 | 8),
            downward: matches!(number, 1..=5 | 8),
            slave: matches!(number, 1..=5 | 8 | 9 | 12),
        }
    }
}

/// The timers whose trigger outputs are a timer's ITR0 to ITR3 (RM0090 tables 93, 97, 100 and 101). TIM10, TIM11, TIM13
/// and TIM14 give the level of their channel.
const fn internal_triggers(number: u8) -> Option<[u8; 4]> {
    Some(match number {
        1 => [5, 2, 3, 4],
        8 => [1, 2, 4, 5],
        2 => [1, 8, 3, 4],
        3 => [1, 2, 5, 4],
        4 => [1, 2, 3, 8],
        5 => [2, 3, 4, 8],
        9 => [2, 3, 10, 11],
        12 => [4, 5, 13, 14],
        _ => return None,
    })
}

/// What drives the outputs of a timer: bits 0 to 3 are channels 1 to 4, bits 4 to 6 the complementary outputs of
/// channels 1 to 3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Outputs {
    /// The outputs that are driven.
    driven: u8,
    /// Their levels.
    levels: u8,
}

/// One timer.
#[derive(Clone, Debug)]
pub(crate) struct Tim {
    /// How often the update flag was raised.
    pub(crate) updates: u64,
    kind: Kind,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    bdtr: u32,
    dcr: u32,
    or: u32,
    /// What was written; the values in force are below.
    psc: u32,
    arr: u32,
    rcr: u32,
    ccr: [u32; 4],
    psc_now: u32,
    arr_now: u32,
    ccr_now: [u32; 4],
    /// Overflows left before the next update.
    repeat: u32,

    /// Core cycles of a timer clock cycle.
    div: u64,
    /// The timer clock cycle up to which the counter below is right.
    tick: u64,
    /// Clocks since the last count.
    prescale: u32,
    cnt: u32,
    down: bool,
    /// The reference of each channel, OCxREF.
    reference: [bool; 4],
    /// Levels of the inputs: channels 1 to 4, ETR, break.
    inputs: [bool; 6],
    /// The trigger input is high (gated mode).
    gate: bool,
    /// Edges seen by the input prescalers, and by the one of ETR.
    edges: [u8; 5],
    requests: u32,
    /// Transfers left of a DMA burst, and the next register of one.
    burst_left: u32,
    burst_next: u32,
    /// Rising edges of the trigger output, and its level in the modes that are levels, not told yet.
    trigger_pulses: u8,
    trigger_level: bool,
    /// What was told last.
    told: Outputs,
    told_references: u8,
    told_level: bool,
    /// When the dead time of each complementary pair ends, `NEVER` where none runs; and the references it last saw.
    dead_until: [Cycle; 3],
    dead_references: u8,
    due: Cycle,
}

impl Tim {
    /// TIM`number`.
    pub(crate) fn new(number: u8) -> Self {
        let kind = Kind::of(number);
        Self {
            updates: 0,
            kind,
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            bdtr: 0,
            dcr: 0,
            or: 0,
            psc: 0,
            arr: kind.largest,
            rcr: 0,
            ccr: [0; 4],
            psc_now: 0,
            arr_now: kind.largest,
            ccr_now: [0; 4],
            repeat: 0,
            div: 1,
            tick: 0,
            prescale: 0,
            cnt: 0,
            down: false,
            reference: [false; 4],
            inputs: [false; 6],
            gate: false,
            edges: [0; 5],
            requests: 0,
            burst_left: 0,
            burst_next: 0,
            trigger_pulses: 0,
            trigger_level: false,
            told: Outputs::default(),
            told_references: 0,
            told_level: false,
            dead_until: [NEVER; 3],
            dead_references: 0,
            due: NEVER,
        }
    }

    fn centre(&self) -> bool {
        self.kind.downward && self.cr1 & 0x60 != 0
    }

    fn slave_mode(&self) -> u32 {
        if self.kind.slave { self.smcr & 7 } else { 0 }
    }

    fn trigger_source(&self) -> u32 {
        self.smcr >> 4 & 7
    }

    /// Whether the internal clock moves the counter.
    fn counting(&self) -> bool {
        self.cr1 & CEN != 0
            && self.smcr & ECE == 0
            && match self.slave_mode() {
                0 | 4 | 6 => true,
                5 => self.gate,
                _ => false,
            }
    }

    fn channels(&self) -> usize {
        usize::from(self.kind.channels)
    }

    /// The eight bits of CCMRx that belong to a channel.
    fn mode_byte(&self, channel: usize) -> u32 {
        self.ccmr[channel / 2] >> (8 * (channel % 2)) & 0xFF
    }

    fn is_input(&self, channel: usize) -> bool {
        self.mode_byte(channel) & 3 != 0
    }

    fn enabled(&self, channel: usize) -> bool {
        self.ccer >> (4 * channel) & 1 != 0
    }

    fn any_output(&self, channel: usize) -> bool {
        !self.is_input(channel) && self.ccer >> (4 * channel) & 5 != 0
    }

    // The counter --------------------------------------------------------------------------------------------------

    /// Counts from here to the next one at which something happens: a compare match, an end of the range. `None` if
    /// the counter stands still.
    fn to_next(&self) -> Option<u64> {
        let mut least = self.to_end()?;
        for channel in 0..self.channels() {
            if !self.is_input(channel)
                && let Some(counts) = self.to_match(channel)
            {
                least = least.min(counts);
            }
        }
        Some(least)
    }

    /// Counts to the end of the range, where the counter wraps or turns.
    fn to_end(&self) -> Option<u64> {
        let (cnt, arr) = (u64::from(self.cnt), u64::from(self.arr_now));
        if arr == 0 {
            return None;
        }
        Some(if self.down {
            if self.centre() { cnt.max(1) } else { cnt + 1 }
        } else if cnt > arr || (self.centre() && cnt == arr) {
            u64::from(self.kind.largest) - cnt + 1
        } else if self.centre() {
            arr - cnt
        } else {
            arr - cnt + 1
        })
    }

    /// Counts to a channel's match before that end.
    fn to_match(&self, channel: usize) -> Option<u64> {
        let (cnt, at) = (self.cnt, self.ccr_now[channel]);
        if self.down { cnt.checked_sub(at) } else { at.checked_sub(cnt) }.filter(|&d| d != 0).map(u64::from)
    }

    /// Moves the counter by `counts`, at most up to [`Tim::to_next`], and does what happens there.
    fn count(&mut self, counts: u64) {
        let Some(end) = self.to_end() else { return };
        if counts < end {
            self.cnt = if self.down { self.cnt - counts as u32 } else { self.cnt + counts as u32 };
            self.arrive();
            return;
        }
        // An end of the range.
        let beyond = !self.down && self.cnt > self.arr_now;
        if self.centre() {
            if self.down {
                self.cnt = 0;
                self.down = false;
            } else if beyond || self.cnt == self.arr_now {
                self.cnt = 0;
                self.arrive();
                return;
            } else {
                self.cnt = self.arr_now;
                self.down = true;
            }
            // The match at the turning point is seen in either direction.
            self.arrive();
            self.overflow();
        } else if self.down {
            self.overflow();
            self.cnt = self.arr_now;
            self.arrive();
        } else {
            self.cnt = 0;
            if beyond {
                // The counter had passed ARR: it wrapped at its largest value, and met ARR nowhere.
                self.arrive();
                return;
            }
            self.overflow();
            self.arrive();
        }
    }

    /// The counter has a new value: matches, and the references that follow it.
    fn arrive(&mut self) {
        let centre = self.cr1 >> 5 & 3;
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            if self.cnt == self.ccr_now[channel] {
                let flagged = match centre {
                    1 if self.kind.downward => self.down,
                    2 if self.kind.downward => !self.down,
                    _ => true,
                };
                if flagged {
                    self.compare_event(channel);
                }
                match self.mode_byte(channel) >> 4 & 7 {
                    1 => self.reference[channel] = true,
                    2 => self.reference[channel] = false,
                    3 => self.reference[channel] = !self.reference[channel],
                    _ => {}
                }
            }
        }
        self.follow();
    }

    /// References of the forced and PWM modes.
    fn follow(&mut self) {
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            let at = self.ccr_now[channel];
            let active = if self.down { self.cnt <= at } else { self.cnt < at };
            let old = self.reference[channel];
            let new = match self.mode_byte(channel) >> 4 & 7 {
                4 => false,
                5 => true,
                6 => active,
                7 => !active,
                _ => old,
            };
            self.reference[channel] = new;
        }
        let mms = self.cr2 >> 4 & 7;
        if mms >= 4 {
            self.trigger_level = self.reference[(mms - 4) as usize];
        }
    }

    fn compare_event(&mut self, channel: usize) {
        self.sr |= 2 << channel;
        if self.dier >> (9 + channel) & 1 != 0 && self.cr2 & CCDS == 0 {
            self.request(2 << channel);
        }
        if channel == 0 && self.cr2 >> 4 & 7 == 3 {
            self.trigger_pulses = 1;
        }
    }

    fn request(&mut self, line: u32) {
        self.requests |= line;
        self.burst_left = self.dcr >> 8 & 0x1F;
        self.burst_next = 0;
    }

    /// The counter wrapped or turned.
    fn overflow(&mut self) {
        for channel in 0..self.channels() {
            // A compare value that is never reached raises its flag here (TIMx_SR, CC1IF).
            if !self.is_input(channel) && self.ccr_now[channel] > self.arr_now {
                self.compare_event(channel);
            }
        }
        if self.kind.advanced {
            if self.repeat != 0 {
                self.repeat -= 1;
                return;
            }
            self.repeat = self.rcr;
        }
        if self.cr1 & UDIS != 0 {
            return;
        }
        self.update(true);
        if self.cr1 & OPM != 0 {
            self.cr1 &= !CEN;
            self.trigger_enable();
        }
    }

    /// The update event.
    fn update(&mut self, flagged: bool) {
        self.psc_now = self.psc;
        self.arr_now = self.arr;
        self.ccr_now = self.ccr_kept();
        if flagged {
            self.sr |= UIF;
            self.updates += 1;
            if self.dier & UDE != 0 {
                self.request(DMA_UPDATE);
            }
        }
        if self.cr2 & CCDS != 0 {
            for channel in 0..self.channels() {
                if self.dier >> (9 + channel) & 1 != 0 {
                    self.request(2 << channel);
                }
            }
        }
        if self.cr2 >> 4 & 7 == 2 {
            self.trigger_pulses = 1;
        }
        if self.kind.advanced && self.bdtr & AOE != 0 && !self.broken() {
            self.bdtr |= MOE;
        }
    }

    /// The compare values after an update: of a channel that captures, what it captured.
    fn ccr_kept(&self) -> [u32; 4] {
        std::array::from_fn(|channel| if self.is_input(channel) { self.ccr_now[channel] } else { self.ccr[channel] })
    }

    /// The counter starts again: EGR.UG, or a trigger in reset mode.
    fn restart(&mut self) {
        self.down = self.cr1 & DIR != 0 && !self.centre() && self.kind.downward;
        self.prescale = 0;
        self.repeat = self.rcr;
        if self.cr1 & UDIS == 0 {
            self.update(self.cr1 & URS == 0);
        }
        if self.cr2 >> 4 & 7 == 0 {
            self.trigger_pulses = 1;
        }
        self.cnt = if self.down { self.arr_now } else { 0 };
        self.follow();
    }

    /// Brings the counter up to `now`.
    fn sync(&mut self, now: Cycle) {
        let tick = self.ticks(now);
        if tick <= self.tick {
            return;
        }
        if !self.counting() {
            self.tick = tick;
            return;
        }
        let mut clocks = tick - self.tick + u64::from(self.prescale);
        self.tick = tick;
        // Ends of the range since here, to leave out whole periods once everything that repeats has happened.
        let mut ends = 0;
        loop {
            let step = u64::from(self.psc_now) + 1;
            let counts = if step == 1 { clocks } else { clocks / step };
            let Some(next) = self.to_next() else {
                self.prescale = if step == 1 { 0 } else { (clocks % step) as u32 };
                return;
            };
            if counts < next {
                if counts != 0 {
                    self.count(counts);
                }
                self.prescale = (clocks - counts * step) as u32;
                return;
            }
            clocks -= next * step;
            let at_end = self.to_end() == Some(next);
            self.count(next);
            if self.cr1 & CEN == 0 {
                self.prescale = 0;
                return;
            }
            if at_end {
                ends += 1;
                // A channel may toggle, so the flags and levels come again after two rounds of the repetition counter.
                let rounds = 2 * (u64::from(self.rcr) + 1);
                if ends > 2 * rounds {
                    let arr = u64::from(self.arr_now);
                    let whole = rounds * if self.centre() { 2 * arr } else { arr + 1 };
                    clocks %= whole * (u64::from(self.psc_now) + 1);
                    ends = 0;
                }
            }
        }
    }

    fn ticks(&self, now: Cycle) -> u64 {
        if self.div == 1 { now } else { now / self.div }
    }

    /// Works out when something happens next that can be seen.
    fn plan(&mut self) {
        self.plan_counter();
        for end in self.dead_until {
            self.due = self.due.min(end);
        }
    }

    fn plan_counter(&mut self) {
        self.due = NEVER;
        if !self.counting() {
            return;
        }
        let Some(end) = self.to_end() else { return };
        let mut counts = u64::MAX;
        let mms = self.cr2 >> 4 & 7;
        if (self.dier & 1 != 0 && self.sr & UIF == 0)
            || self.dier & UDE != 0
            || mms == 2
            || self.cr2 & CCDS != 0 && self.dier & 0x1E00 != 0
        {
            counts = end;
        }
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            let seen = (self.dier >> (1 + channel) & 1 != 0 && self.sr >> (1 + channel) & 1 == 0)
                || self.dier >> (9 + channel) & 1 != 0
                || self.any_output(channel)
                || mms >= 3;
            if seen {
                counts = counts.min(self.to_match(channel).filter(|&to| to < end).unwrap_or(end));
            }
        }
        if counts == u64::MAX {
            return;
        }
        let step = u64::from(self.psc_now) + 1;
        let clocks = (counts * step).saturating_sub(u64::from(self.prescale)).max(1);
        self.due = (self.tick + clocks).saturating_mul(self.div);
    }

    // Inputs and triggers ------------------------------------------------------------------------------------------

    /// The level of channel input `channel` after the exclusive or of TI1.
    fn line(&self, channel: usize) -> bool {
        if channel == 0 && self.cr2 & TI1S != 0 {
            self.inputs[0] ^ self.inputs[1] ^ self.inputs[2]
        } else {
            self.inputs[channel]
        }
    }

    /// Whether the change of a line to `level` is an edge that a channel with this polarity sees.
    fn is_edge(&self, channel: usize, level: bool) -> bool {
        match self.ccer >> (4 * channel) & 0xA {
            0 => level,
            2 => !level,
            0xA => true,
            _ => false,
        }
    }

    /// An input changed, see [`INPUT_ETR`].
    fn input_changed(&mut self, input: usize, level: bool, cx: &mut Cx) {
        if self.inputs[input] == level {
            return;
        }
        self.sync(cx.now);
        let before = self.line(0);
        self.inputs[input] = level;
        match input {
            INPUT_ETR => self.external(level, cx.now),
            INPUT_BREAK => self.check_break(),
            _ => {
                for line in 0..self.channels() {
                    if (line == 0 && self.line(0) != before) || (line != 0 && line == input) {
                        self.line_changed(line, cx.now);
                    }
                }
            }
        }
        self.follow();
        self.finish(cx);
    }

    fn line_changed(&mut self, line: usize, now: Cycle) {
        let level = self.line(line);
        for channel in [line, line ^ 1] {
            if channel >= self.channels() {
                continue;
            }
            let selected = match self.mode_byte(channel) & 3 {
                1 => channel == line,
                2 => channel != line,
                _ => false,
            };
            if selected && self.enabled(channel) && self.is_edge(channel, level) {
                self.prescaled_capture(channel);
            }
        }
        match self.slave_mode() {
            1..=3 if line < 2 => self.encoder(line),
            _ => {}
        }
        match (self.trigger_source(), line) {
            (4, 0) => {
                self.trigger_edge(true, now);
                self.trigger_edge(false, now);
            }
            (5, 0) | (6, 1) => {
                let inverted = self.ccer >> (4 * line) & 2 != 0;
                self.trigger_edge(level != inverted, now);
            }
            _ => {}
        }
    }

    fn prescaled_capture(&mut self, channel: usize) {
        self.edges[channel] += 1;
        if self.edges[channel] >= 1 << (self.mode_byte(channel) >> 2 & 3) {
            self.edges[channel] = 0;
            self.capture(channel);
        }
    }

    fn capture(&mut self, channel: usize) {
        if self.sr >> (1 + channel) & 1 != 0 {
            self.sr |= 1 << (9 + channel);
        }
        self.ccr_now[channel] = self.cnt;
        self.sr |= 2 << channel;
        if self.dier >> (9 + channel) & 1 != 0 && self.cr2 & CCDS == 0 {
            self.request(2 << channel);
        }
        if channel == 0 && self.cr2 >> 4 & 7 == 3 {
            self.trigger_pulses = 1;
        }
    }

    /// One line of the encoder changed (table 98 "Counting direction versus encoder signals").
    fn encoder(&mut self, line: usize) {
        if self.cr1 & CEN == 0 {
            return;
        }
        let counted = match self.slave_mode() {
            1 => line == 1,
            2 => line == 0,
            _ => true,
        };
        if !counted {
            return;
        }
        let inverted = |channel: usize| self.ccer >> (4 * channel) & 2 != 0;
        let level = self.line(line) != inverted(line);
        let other = self.line(line ^ 1) != inverted(line ^ 1);
        let up = if line == 0 { level != other } else { level == other };
        self.down = !up;
        self.cr1 = self.cr1 & !DIR | if up { 0 } else { DIR };
        self.pulse();
    }

    /// One clock from outside: through the prescaler.
    fn pulse(&mut self) {
        if self.cr1 & CEN == 0 {
            return;
        }
        self.prescale += 1;
        if self.prescale > self.psc_now {
            self.prescale = 0;
            self.count(1);
        }
    }

    /// The external trigger pin: polarity, prescaler, external clock mode 2.
    fn external(&mut self, level: bool, now: Cycle) {
        let level = level != (self.smcr & ETP != 0);
        if level {
            self.edges[4] += 1;
            if self.edges[4] < 1 << (self.smcr >> 12 & 3) {
                return;
            }
            self.edges[4] = 0;
        }
        if self.smcr & ECE != 0 && level {
            self.pulse();
        }
        if self.trigger_source() == 7 {
            self.trigger_edge(level, now);
        }
    }

    /// The trigger input went to `level`.
    fn trigger_edge(&mut self, level: bool, now: Cycle) {
        if !self.kind.slave {
            return;
        }
        self.sync(now);
        let rising = level && !self.gate;
        let changed = level != self.gate;
        self.gate = level;
        let mode = self.slave_mode();
        if mode != 0 && (rising || (mode == 5 && changed)) {
            self.sr |= TIF;
            if self.dier & TDE != 0 {
                self.request(DMA_TRIGGER);
            }
        }
        if rising {
            for channel in 0..self.channels() {
                if self.mode_byte(channel) & 3 == 3 && self.enabled(channel) {
                    self.prescaled_capture(channel);
                }
            }
            match mode {
                4 => self.restart(),
                6 => {
                    self.start(now);
                }
                7 => self.pulse(),
                _ => {}
            }
        }
        if mode == 5 {
            self.tick = self.ticks(now);
        }
    }

    fn trigger_enable(&mut self) {
        if self.cr2 >> 4 & 7 == 1 {
            self.trigger_level = self.cr1 & CEN != 0;
        }
    }

    fn start(&mut self, now: Cycle) {
        if self.cr1 & CEN == 0 {
            self.cr1 |= CEN;
            // CNT_EN follows CEN by one timer clock (17.3.4).
            // The prescaler's counter goes on where it stood.
            self.tick = self.ticks(now) + 1;
            self.trigger_enable();
        }
    }

    // Break and outputs --------------------------------------------------------------------------------------------

    fn broken(&self) -> bool {
        self.bdtr & BKE != 0 && self.inputs[INPUT_BREAK] == (self.bdtr & BKP != 0)
    }

    fn check_break(&mut self) {
        if self.kind.advanced && self.broken() {
            self.bdtr &= !MOE;
            self.sr |= BIF;
        }
    }

    /// The dead time in core cycles, 17.4.18: DTG in steps of the clock that CKD divides.
    fn dead_time(&self) -> u64 {
        let dtg = u64::from(self.bdtr & 0xFF);
        let steps = match dtg >> 5 {
            0..=3 => dtg,
            4 | 5 => (64 + (dtg & 0x3F)) * 2,
            6 => (32 + (dtg & 0x1F)) * 8,
            _ => (32 + (dtg & 0x1F)) * 16,
        };
        (steps << (self.cr1 >> 8 & 3).min(2)) * self.div
    }

    /// An edge of a reference switches off the output that was on at once, and holds back the other one.
    fn follow_dead_time(&mut self, now: Cycle) {
        let time = self.dead_time();
        for channel in 0..3 {
            let end = &mut self.dead_until[channel];
            if *end <= now {
                *end = NEVER;
            }
            let (reference, bit) = (self.reference[channel], 1 << channel);
            let is_pair = self.ccer >> (4 * channel) & 5 == 5 && self.bdtr & MOE != 0;
            if reference != (self.dead_references & bit != 0) && is_pair && time > 0 {
                *end = now + time;
            } else if !is_pair {
                *end = NEVER;
            }
            self.dead_references = self.dead_references & !bit | u8::from(reference) << channel;
        }
    }

    /// What the timer drives now.
    fn outputs(&self) -> Outputs {
        let mut out = Outputs::default();
        if self.kind.channels == 0 || self.ccer & 0x5555 == 0 {
            return out;
        }
        let idle = self.kind.advanced && self.bdtr & MOE == 0;
        for channel in 0..self.channels() {
            if self.is_input(channel) {
                continue;
            }
            let bits = self.ccer >> (4 * channel);
            let reference = self.reference[channel];
            let dead = channel < 3 && self.dead_until[channel] != NEVER;
            if bits & 1 != 0 {
                let active = reference && !dead;
                let level = if idle { self.cr2 >> (8 + 2 * channel) & 1 != 0 } else { active != (bits & 2 != 0) };
                // With MOE off the output is driven only where OSSI keeps it.
                if !idle || self.bdtr & 1 << 10 != 0 {
                    out.driven |= 1 << channel;
                    out.levels |= u8::from(level) << channel;
                }
            }
            if self.kind.advanced && channel < 3 && bits & 4 != 0 {
                // Alone it carries the reference, beside its channel the complement (table 95).
                let source = if bits & 1 != 0 { !reference } else { reference };
                let active = source && !dead;
                let level = if idle { self.cr2 >> (9 + 2 * channel) & 1 != 0 } else { active != (bits & 8 != 0) };
                if !idle || self.bdtr & 1 << 10 != 0 {
                    out.driven |= 16 << channel;
                    out.levels |= u8::from(level) << (4 + channel);
                }
            }
        }
        out
    }

    /// Tells what changed on the outputs and the trigger output, and plans the next event.
    fn finish(&mut self, cx: &mut Cx) {
        if self.kind.advanced {
            self.follow_dead_time(cx.now);
        }
        let out = self.outputs();
        if out != self.told {
            let changed = (out.driven ^ self.told.driven) | (out.levels ^ self.told.levels);
            for (index, pin) in OUTPUT_PINS.into_iter().enumerate() {
                if changed >> index & 1 != 0 {
                    let level = (out.driven >> index & 1 != 0).then_some(out.levels >> index & 1 != 0);
                    cx.output(Signal::Tim(self.kind.number, pin), level);
                }
            }
            self.told = out;
        }
        if self.kind.channels != 0 {
            let mut references = 0;
            for channel in 0..self.channels() {
                references |= u8::from(self.reference[channel] && self.enabled(channel)) << channel;
            }
            let rising = references & !self.told_references;
            self.told_references = references;
            for channel in 0..4 {
                if rising >> channel & 1 != 0 {
                    cx.trigger(Trigger::Compare(self.kind.number, channel + 1));
                }
            }
        }
        if self.trigger_pulses != 0 || (self.trigger_level && !self.told_level) {
            cx.trigger(Trigger::Trgo(self.kind.number));
        }
        self.trigger_pulses = 0;
        self.told_level = self.trigger_level;
        self.plan();
    }

    // Registers ----------------------------------------------------------------------------------------------------

    fn read_register(&mut self, offset: u32, cx: &mut Cx) -> u32 {
        let channels = self.kind.channels;
        match offset {
            0x00 => {
                let down = self.down && (self.centre() || matches!(self.slave_mode(), 1..=3));
                self.cr1 | if down { DIR } else { 0 }
            }
            0x04 => self.cr2,
            0x08 if self.kind.slave => self.smcr,
            0x0C => self.dier,
            0x10 => self.sr,
            0x14 => 0,
            0x18 if channels > 0 => self.ccmr[0],
            0x1C if channels > 2 => self.ccmr[1],
            0x20 if channels > 0 => self.ccer,
            0x24 => self.cnt,
            0x28 => self.psc,
            0x2C => self.arr,
            0x30 if self.kind.advanced => self.rcr,
            0x34..=0x40 if (offset - 0x34) / 4 < u32::from(channels) => {
                let channel = ((offset - 0x34) / 4) as usize;
                if self.is_input(channel) {
                    self.sr &= !(2 << channel);
                    self.ccr_now[channel]
                } else {
                    self.ccr[channel]
                }
            }
            0x44 if self.kind.advanced => self.bdtr,
            0x48 if channels > 2 => self.dcr,
            0x4C if channels > 2 => {
                let register = self.burst_register();
                if register == 0x4C { 0 } else { self.read_register(register, cx) }
            }
            0x50 if matches!(self.kind.number, 2 | 5 | 11) => self.or,
            _ => {
                cx.find(FindingKind::Undefined, "a timer register that this timer has not");
                0
            }
        }
    }

    /// The register that an access to DMAR reaches.
    fn burst_register(&mut self) -> u32 {
        let register = 4 * ((self.dcr & 0x1F) + self.burst_next);
        self.burst_next = if self.burst_next >= self.dcr >> 8 & 0x1F { 0 } else { self.burst_next + 1 };
        register
    }

    fn write_register(&mut self, offset: u32, value: u32, cx: &mut Cx) {
        let channels = self.kind.channels;
        match offset {
            0x00 => self.write_cr1(value, cx),
            0x04 => {
                if self.kind.advanced && value & 5 != 0 {
                    cx.find(FindingKind::Unmodelled, "preloaded channel control and commutation (CR2.CCPC, CCUS)");
                }
                self.cr2 = value & 0x7FFF;
                self.trigger_enable();
                self.follow();
            }
            0x08 if self.kind.slave => {
                self.smcr = value & 0xFFFF;
                if self.slave_mode() == 5 && self.trigger_source() < 4 {
                    cx.find(FindingKind::Unmodelled, "gated mode on another timer's trigger: the gate stays closed");
                }
                self.gate = match self.trigger_source() {
                    5 => self.line(0) != (self.ccer & 2 != 0),
                    6 => self.line(1) != (self.ccer & 0x20 != 0),
                    7 => self.inputs[INPUT_ETR] != (self.smcr & ETP != 0),
                    _ => false,
                };
            }
            0x0C => {
                self.dier = value & 0x7FFF;
                // A request whose enable is taken away is gone.
                self.requests &= self.dier >> 8 & 0x1F | self.dier >> 9 & DMA_TRIGGER;
            }
            // Written zeros clear, ones leave as it is.
            0x10 => self.sr &= value,
            0x14 => self.generate(value, cx),
            0x18 if channels > 0 => self.write_modes(0, value, cx),
            0x1C if channels > 2 => self.write_modes(1, value, cx),
            0x20 if channels > 0 => self.ccer = value & ((1 << (4 * u32::from(channels))) - 1),
            0x24 => {
                self.cnt = value & self.kind.largest;
                self.follow();
            }
            0x28 => self.psc = value & 0xFFFF,
            0x2C => {
                self.arr = value & self.kind.largest;
                if self.cr1 & ARPE == 0 {
                    self.arr_now = self.arr;
                }
            }
            0x30 if self.kind.advanced => self.rcr = value & 0xFF,
            0x34..=0x40 if (offset - 0x34) / 4 < u32::from(channels) => {
                let channel = ((offset - 0x34) / 4) as usize;
                // A channel that captures has a read-only register.
                if !self.is_input(channel) {
                    self.ccr[channel] = value & self.kind.largest;
                    if self.mode_byte(channel) & 8 == 0 {
                        self.ccr_now[channel] = self.ccr[channel];
                        self.follow();
                    }
                }
            }
            0x44 if self.kind.advanced => {
                if value & 0x300 != 0 {
                    cx.find(FindingKind::Unmodelled, "BDTR.LOCK: nothing is locked");
                }
                self.bdtr = value & 0xFFFF;
                self.check_break();
            }
            0x48 if channels > 2 => self.dcr = value & 0x1F1F,
            0x4C if channels > 2 => {
                let register = self.burst_register();
                if register < 0x48 {
                    self.write_register(register, value, cx);
                }
            }
            0x50 if matches!(self.kind.number, 2 | 5 | 11) => {
                if value != 0 {
                    cx.find(FindingKind::Unmodelled, "the option register: inputs stay on their pins");
                }
                self.or = value & 0xFFFF;
            }
            _ => cx.find(FindingKind::Undefined, "a timer register that this timer has not"),
        }
    }

    fn write_cr1(&mut self, value: u32, cx: &mut Cx) {
        let mut value = value & 0x3FF;
        if !self.kind.downward {
            value &= !(DIR | 0x60);
        }
        if self.kind.channels == 0 {
            value &= 0x8F;
        }
        let before = self.cr1;
        if before & CEN != 0 && (before & 0x60 == 0) != (value & 0x60 == 0) {
            cx.find(FindingKind::Misuse, "edge-aligned and centre-aligned mode changed while the counter is on");
        }
        self.cr1 = value;
        // DIR is read-only in centre-aligned and encoder mode.
        if value & 0x60 == 0 {
            if !matches!(self.slave_mode(), 1..=3) {
                self.down = value & DIR != 0;
            }
        } else {
            self.cr1 &= !DIR;
        }
        if value & ARPE == 0 {
            self.arr_now = self.arr;
        }
        if value & CEN != 0 && before & CEN == 0 {
            self.cr1 &= !CEN;
            self.start(cx.now);
        } else {
            self.trigger_enable();
        }
    }

    fn write_modes(&mut self, half: usize, value: u32, cx: &mut Cx) {
        let mut value = value & 0xFFFF;
        if self.kind.channels == 1 {
            value &= 0xFF;
        }
        self.ccmr[half] = value;
        for channel in [2 * half, 2 * half + 1] {
            let mode = self.mode_byte(channel);
            if mode & 3 == 0 {
                if mode & 0x80 != 0 {
                    cx.find(FindingKind::Unmodelled, "the external clear of a reference (OCxCE)");
                }
                if mode & 8 == 0 {
                    self.ccr_now[channel] = self.ccr[channel];
                }
            } else if mode & 0xC == 0 {
                self.edges[channel] = 0;
            }
        }
        self.follow();
    }

    fn generate(&mut self, value: u32, cx: &mut Cx) {
        if value & 1 != 0 {
            self.restart();
        }
        for channel in 0..self.channels() {
            if value >> (1 + channel) & 1 != 0 {
                if self.is_input(channel) {
                    self.capture(channel);
                } else {
                    self.compare_event(channel);
                }
            }
        }
        if value & 0x20 != 0 && self.kind.advanced {
            cx.find(FindingKind::Unmodelled, "the commutation event (EGR.COMG)");
        }
        if value & 0x40 != 0 && self.kind.slave {
            self.sr |= TIF;
            if self.dier & TDE != 0 {
                self.request(DMA_TRIGGER);
            }
        }
        if value & 0x80 != 0 && self.kind.advanced {
            self.bdtr &= !MOE;
            self.sr |= BIF;
        }
    }
}

impl Peripheral for Tim {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        self.sync(cx.now);
        self.read_register(offset & !3, cx) >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        self.sync(cx.now);
        self.write_register(offset & !3, crate::lanes(width, value), cx);
        self.finish(cx);
    }

    fn peek(&self, offset: u32, cx: &mut Cx) -> u32 {
        let mut copy = self.clone();
        copy.sync(cx.now);
        match offset & !3 {
            0x4C => 0,
            offset => copy.read_register(offset, cx),
        }
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, _: &mut W) {
        self.sync(cx.now);
        self.finish(cx);
    }

    fn irq(&self) -> u32 {
        let on = self.sr & self.dier & 0xFF;
        if on == 0 || !self.kind.advanced {
            return u32::from(on != 0);
        }
        let mut lines = 0;
        for (flags, line) in [(UIF, IRQ_UPDATE), (0x1E, IRQ_CHANNELS), (0x60, IRQ_TRIGGER), (BIF, IRQ_BREAK)] {
            if on & flags != 0 {
                lines |= line;
            }
        }
        lines
    }

    fn dma(&self) -> u32 {
        self.requests
    }

    fn dma_served(&mut self, bit: u8, _: bool, _: &mut Cx) {
        if self.burst_left == 0 {
            self.requests &= !(1 << bit);
        } else {
            self.burst_left -= 1;
        }
    }

    fn clocks_changed(&mut self, _: &Clocks, cx: &mut Cx) {
        self.sync(cx.now);
        // A counter that has just been enabled is a clock ahead.
        let ahead = self.tick - self.ticks(cx.now);
        self.div = u64::from(if matches!(self.kind.number, 1 | 8..=11) { cx.clocks.tim2 } else { cx.clocks.tim1 });
        self.tick = self.ticks(cx.now) + ahead;
        self.plan();
    }

    fn reset(&mut self) {
        let (inputs, div, updates) = (self.inputs, self.div, self.updates);
        *self = Self { inputs, div, updates, ..Self::new(self.kind.number) };
    }

    fn input(&mut self, signal: Signal, level: bool, cx: &mut Cx) {
        let Signal::Tim(_, pin) = signal else { return };
        let input = match pin {
            TimPin::Ch1 => 0,
            TimPin::Ch2 => 1,
            TimPin::Ch3 => 2,
            TimPin::Ch4 => 3,
            TimPin::Etr => INPUT_ETR,
            TimPin::Bkin => INPUT_BREAK,
            TimPin::Ch1N | TimPin::Ch2N | TimPin::Ch3N => return,
        };
        self.input_changed(input, level, cx);
    }

    fn trigger(&mut self, trigger: Trigger, cx: &mut Cx) {
        if trigger == Trigger::ClockFailure {
            // BKE lets the break pin and the clock security system through (17.4.18).
            if self.kind.advanced && self.bdtr & BKE != 0 {
                self.sync(cx.now);
                self.bdtr &= !MOE;
                self.sr |= BIF;
                self.finish(cx);
            }
            return;
        }
        let source = self.trigger_source() as usize;
        let Some(masters) = internal_triggers(self.kind.number).filter(|_| source < 4) else { return };
        let used = match trigger {
            Trigger::Trgo(number) => number == masters[source] && number < 10,
            Trigger::Compare(number, 1) => number == masters[source] && number >= 10,
            _ => false,
        };
        if used && self.slave_mode() != 5 {
            self.sync(cx.now);
            self.trigger_edge(true, cx.now);
            self.trigger_edge(false, cx.now);
            self.finish(cx);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    const CR1: u32 = 0x00;
    const CR2: u32 = 0x04;
    const SMCR: u32 = 0x08;
    const DIER: u32 = 0x0C;
    const SR: u32 = 0x10;
    const EGR: u32 = 0x14;
    const CCMR1: u32 = 0x18;
    const CCER: u32 = 0x20;
    const CNT: u32 = 0x24;
    const PSC: u32 = 0x28;
    const ARR: u32 = 0x2C;
    const RCR: u32 = 0x30;
    const CCR1: u32 = 0x34;
    const CCR2: u32 = 0x38;
    const BDTR: u32 = 0x44;
    const DCR: u32 = 0x48;
    const DMAR: u32 = 0x4C;

    fn rig(number: u8) -> Rig<Tim> {
        Rig::new(Tim::new(number))
    }

    /// The cycles up to `to` at which the interrupt output was found high, and the enabled flags; all are cleared each
    /// time. (A channel that is left alone matches zero, so its flag rises too.)
    fn interrupts(rig: &mut Rig<Tim>, to: Cycle) -> Vec<(Cycle, u32)> {
        let mut seen = Vec::new();
        while rig.instance.due() <= to {
            let at = rig.instance.due();
            rig.run(at);
            if rig.instance.irq() != 0 {
                let flags = rig.read(SR);
                seen.push((at, flags & rig.read(DIER) & 0xFF));
                rig.write(SR, !flags);
            }
        }
        rig.run(to);
        seen
    }

    #[test]
    fn between_the_outputs_of_a_pair_both_are_off_for_the_dead_time() {
        let mut rig = rig(1);
        rig.write(ARR, 99);
        rig.write(CCR1, 50);
        rig.write(CCMR1, 6 << 4);
        rig.write(CCER, 5);
        // DTG 10, at twice the timer's clock (CKD): 20 cycles.
        rig.write(BDTR, MOE | 10);
        rig.write(EGR, 1);
        rig.out.outputs.clear();
        rig.write(CR1, 1 << 8 | CEN);
        rig.run(240);
        let edge = |&(at, signal, level)| (at, signal, level == Some(true));
        let edges: Vec<_> = rig.out.outputs.iter().map(edge).collect();
        let (main, complement) = (Signal::Tim(1, TimPin::Ch1), Signal::Tim(1, TimPin::Ch1N));
        let period = |at| {
            let first = [(at, main, false), (at + 20, complement, true)];
            [first, [(at + 50, complement, false), (at + 70, main, true)]].concat()
        };
        assert_eq!(edges[edges.len() - 8..], [period(51), period(151)].concat());
    }

    #[test]
    fn a_pulse_that_is_shorter_than_the_dead_time_never_leaves() {
        let mut rig = rig(1);
        rig.write(ARR, 99);
        rig.write(CCR1, 5);
        rig.write(CCMR1, 6 << 4);
        rig.write(CCER, 5);
        rig.write(BDTR, MOE | 10);
        rig.write(EGR, 1);
        rig.write(CR1, CEN);
        rig.run(150);
        rig.out.outputs.clear();
        rig.run(1000);
        assert!(rig.out.outputs.iter().all(|&(_, signal, _)| signal == Signal::Tim(1, TimPin::Ch1N)));
        assert!(!rig.out.outputs.is_empty());
    }

    #[test]
    fn the_counter_follows_from_the_time_and_starts_a_clock_after_it_is_enabled() {
        let mut rig = rig(2);
        rig.write(ARR, 9);
        rig.run(100);
        rig.write(CR1, CEN);
        for (at, count) in [(100, 0), (101, 0), (102, 1), (110, 9), (111, 0), (112, 1), (1_000_000_111, 0)] {
            rig.run(at);
            assert_eq!(rig.read(CNT), count, "{at}");
        }
        assert_eq!(rig.instance.due(), NEVER, "nothing can be seen, so nothing is an event");
        assert_eq!(rig.read(SR) & UIF, UIF);
    }

    #[test]
    fn updates_and_compares_interrupt_at_their_own_cycles() {
        let mut rig = rig(2);
        rig.change_clocks(|clocks| clocks.tim1 = 2);
        rig.write(ARR, 99);
        rig.write(CCR1, 10);
        rig.write(CCR2, 40);
        rig.write(DIER, 1 | 2 | 4);
        rig.write(CR1, CEN | URS);
        let seen = interrupts(&mut rig, 2 + 400);
        assert_eq!(seen, [(22, 2), (82, 4), (202, 1), (222, 2), (282, 4), (402, 1)]);
    }

    #[test]
    fn the_prescaler_takes_its_value_at_an_update() {
        let mut rig = rig(5);
        rig.write(PSC, 71);
        rig.write(CR1, URS);
        rig.write(EGR, 1);
        assert_eq!(rig.read(SR), 0, "URS keeps the flag of a software update away");
        rig.write(ARR, 9);
        rig.write(DIER, 1);
        rig.write(CR1, CEN | URS | OPM);
        assert_eq!(interrupts(&mut rig, 10_000), [(1 + 720, 1)]);
        assert_eq!(rig.read(CR1) & CEN, 0, "one pulse");
        assert_eq!(rig.read(CNT), 0);
    }

    #[test]
    fn without_preload_a_reload_value_below_the_counter_lets_it_run_to_its_end() {
        let mut rig = rig(3);
        rig.write(CR1, CEN);
        rig.run(101);
        rig.write(ARR, 50);
        rig.run(0xFFFF + 1);
        assert_eq!(rig.read(CNT), 0xFFFF);
        rig.run(0xFFFF + 2);
        assert_eq!(rig.read(CNT), 0);
    }

    #[test]
    fn a_preloaded_reload_value_waits_for_the_update() {
        let mut rig = rig(3);
        rig.write(ARR, 99);
        rig.write(EGR, 1);
        rig.write(CR1, CEN | ARPE);
        rig.run(51);
        rig.write(ARR, 9);
        rig.run(100);
        assert_eq!(rig.read(CNT), 99);
        rig.run(101 + 10);
        assert_eq!(rig.read(CNT), 0);
        rig.run(101 + 19);
        assert_eq!(rig.read(CNT), 9);
    }

    #[test]
    fn counting_down_wraps_from_zero_to_the_reload_value() {
        let mut rig = rig(4);
        rig.write(ARR, 9);
        rig.write(CR1, DIR);
        rig.write(EGR, 1);
        rig.write(SR, 0);
        rig.write(DIER, 1);
        rig.write(CR1, DIR | CEN);
        assert_eq!(rig.read(CNT), 9);
        assert_eq!(interrupts(&mut rig, 22), [(11, 1), (21, 1)]);
        assert_eq!(rig.read(CNT), 8);
    }

    #[test]
    fn centre_aligned_the_counter_turns_at_both_ends() {
        let mut rig = rig(4);
        rig.write(ARR, 4);
        rig.write(EGR, 1);
        rig.write(SR, 0);
        rig.write(DIER, 1);
        rig.write(CR1, CEN | 0x60);
        let mut counts = Vec::new();
        for at in 1..=10 {
            rig.run(at);
            counts.push(rig.read(CNT));
        }
        assert_eq!(counts, [0, 1, 2, 3, 4, 3, 2, 1, 0, 1]);
        assert_eq!(rig.read(SR) & UIF, UIF);
        rig.write(SR, 0);
        assert_eq!(interrupts(&mut rig, 20), [(13, 1), (17, 1)]);
    }

    #[test]
    fn the_repetition_counter_leaves_updates_out() {
        let mut rig = rig(1);
        rig.write(ARR, 9);
        rig.write(RCR, 2);
        rig.write(EGR, 1);
        rig.write(SR, 0);
        rig.write(DIER, 1);
        rig.write(CR1, CEN);
        let seen = interrupts(&mut rig, 61);
        assert_eq!(seen.iter().map(|&(at, _)| at).collect::<Vec<_>>(), [31, 61]);
    }

    #[test]
    fn pulse_width_modulation_drives_its_pin_while_the_counter_is_below_the_compare_value() {
        let mut rig = rig(3);
        rig.write(ARR, 9);
        rig.write(CCR1, 3);
        rig.write(CCMR1, 6 << 4);
        rig.write(CCER, 1);
        rig.write(CR1, CEN);
        rig.run(25);
        let pin = Signal::Tim(3, TimPin::Ch1);
        let levels: Vec<_> = rig.out.outputs.iter().map(|&(at, signal, level)| (at, signal == pin, level)).collect();
        let expected = [(0, true), (4, false), (11, true), (14, false), (21, true), (24, false)];
        assert_eq!(levels, expected.map(|(at, level)| (at, true, Some(level))));
    }

    #[test]
    fn an_advanced_timer_drives_nothing_without_its_main_output_enable() {
        let mut rig = rig(1);
        rig.write(ARR, 9);
        rig.write(CCR1, 3);
        rig.write(CCMR1, 6 << 4);
        rig.write(CCER, 5);
        rig.write(CR1, CEN);
        rig.run(100);
        assert!(rig.out.outputs.is_empty());
        rig.write(BDTR, MOE);
        let driven: Vec<_> = rig.out.outputs.iter().map(|&(_, signal, level)| (signal, level)).collect();
        // 99 counts on: 9.
        let pins = [(TimPin::Ch1, false), (TimPin::Ch1N, true)];
        assert_eq!(driven, pins.map(|(pin, level)| (Signal::Tim(1, pin), Some(level))));
    }

    #[test]
    fn a_toggling_output_keeps_its_phase_however_long_nothing_looks() {
        let mut rig = rig(3);
        rig.write(ARR, 9);
        rig.write(CCR1, 3);
        rig.write(CCMR1, 3 << 4);
        rig.write(CR1, CEN);
        let mut stepped = rig.clone();
        rig.run(1_000_005);
        for at in (0..=1_000_005).step_by(5) {
            stepped.run(at);
            stepped.read(CNT);
        }
        rig.read(CNT);
        assert_eq!(rig.instance.reference, stepped.instance.reference);
        assert_eq!(rig.instance.cnt, stepped.instance.cnt);
    }

    #[test]
    fn an_edge_captures_the_counter_and_a_second_one_is_over_capture() {
        let mut rig = rig(5);
        rig.write(CCMR1, 1);
        rig.write(CCER, 1);
        rig.write(DIER, 2);
        rig.write(CR1, CEN);
        let pin = Signal::Tim(5, TimPin::Ch1);
        rig.run(101);
        rig.input(pin, true);
        rig.run(111);
        rig.input(pin, false);
        assert_eq!(rig.instance.irq(), 1);
        rig.run(201);
        rig.input(pin, true);
        assert_eq!(rig.read(SR) & 0x202, 0x202);
        assert_eq!(rig.read(CCR1), 200);
        assert_eq!(rig.read(SR) & 2, 0, "reading the capture clears its flag");
    }

    #[test]
    fn an_encoder_counts_up_and_down_by_all_edges_of_both_lines() {
        let mut rig = rig(4);
        rig.write(CCMR1, 0x0101);
        rig.write(SMCR, 3);
        rig.write(CR1, CEN);
        let lines = [(TimPin::Ch1, true), (TimPin::Ch2, true), (TimPin::Ch1, false), (TimPin::Ch2, false)];
        for (pin, level) in lines {
            rig.input(Signal::Tim(4, pin), level);
        }
        assert_eq!(rig.read(CNT), 4);
        assert_eq!(rig.read(CR1) & DIR, 0);
        for (pin, level) in [(TimPin::Ch2, true), (TimPin::Ch1, true)] {
            rig.input(Signal::Tim(4, pin), level);
        }
        assert_eq!(rig.read(CNT), 2);
        assert_eq!(rig.read(CR1) & DIR, DIR);
    }

    #[test]
    fn a_timer_tells_its_update_and_another_counts_it() {
        let mut master = rig(3);
        master.write(ARR, 9);
        master.write(CR2, 2 << 4);
        master.write(CR1, CEN);
        master.run(35);
        assert_eq!(master.out.triggers, [Trigger::Trgo(3); 3]);

        let mut slave = rig(2);
        // ITR2 of TIM2 is TIM3.
        slave.write(SMCR, 2 << 4 | 7);
        slave.write(CR1, CEN);
        for _ in 0..3 {
            slave.call(|timer, cx| timer.trigger(Trigger::Trgo(3), cx));
        }
        slave.call(|timer, cx| timer.trigger(Trigger::Trgo(4), cx));
        slave.run(1000);
        assert_eq!(slave.read(CNT), 3);
    }

    #[test]
    fn an_update_request_stays_until_the_dma_has_served_it_and_a_burst_as_often_as_it_is_long() {
        let mut rig = rig(3);
        rig.write(ARR, 9);
        rig.write(DIER, UDE);
        rig.write(DCR, 1 << 8 | 13);
        rig.write(CR1, CEN);
        rig.run(11);
        for value in [7, 8] {
            assert_eq!(rig.instance.dma(), DMA_UPDATE);
            rig.write(DMAR, value);
            rig.call(|timer, cx| timer.dma_served(0, false, cx));
        }
        assert_eq!(rig.instance.dma(), 0);
        assert_eq!((rig.read(CCR1), rig.read(CCR2)), (7, 8));
    }

    /// What of a timer follows from the time.
    fn state(rig: &mut Rig<Tim>) -> (u32, u32, [bool; 4], u32, u32, u32) {
        let status = rig.read(SR);
        let timer = &rig.instance;
        (timer.cnt, status, timer.reference, timer.prescale, timer.repeat, timer.cr1)
    }

    proptest::proptest! {
        #[test]
        fn a_timer_that_is_looked_at_once_is_where_one_is_that_is_looked_at_every_clock(
            number in 1_u8..=8,
            control in 0_u32..0x80,
            prescaler in 0_u32..4,
            reload in 0_u32..12,
            repetition in 0_u32..3,
            compares in proptest::array::uniform4(0_u32..14),
            modes in proptest::array::uniform4(0_u32..8),
            later in (0_u32..4, 0_u32..12, 0_u64..60),
            to in 0_u64..3000,
        ) {
            let mut rig = rig(number);
            let channels = u32::from(rig.instance.kind.channels);
            rig.write(PSC, prescaler);
            rig.write(ARR, reload);
            if channels > 0 {
                for (index, (compare, mode)) in compares.into_iter().zip(modes).enumerate() {
                    rig.write(CCR1 + 4 * index as u32, compare);
                    let half = CCMR1 + 4 * (index as u32 / 2);
                    let other = rig.read(half);
                    rig.write(half, other | (mode << 4 | 8) << (8 * (index % 2)));
                }
            }
            if matches!(number, 1 | 8) {
                rig.write(RCR, repetition);
            }
            rig.write(EGR, 1);
            rig.write(SR, 0);
            rig.write(CR1, control & 0x7E | CEN);
            rig.run(later.2);
            // The preload of these may wait for an update.
            rig.write(PSC, later.0);
            rig.write(ARR, later.1);
            let mut stepped = rig.clone();
            rig.run(later.2 + to);
            for at in later.2..=later.2 + to {
                stepped.run(at);
                stepped.read(CNT);
            }
            proptest::prop_assert_eq!(state(&mut rig), state(&mut stepped));
        }
    }
}
