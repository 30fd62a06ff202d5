//! PWM: four channels from sequences in RAM (PS 6.17).
//!
//! | covered | PS |
//! |---|---|
//! | SEQSTART, NEXTSTEP, STOP; STOPPED, SEQSTARTED, SEQEND, PWMPERIODEND, LOOPSDONE, and the shortcuts | 6.17 |
//! | up and up-and-down counting, PRESCALER, COUNTERTOP | 6.17 |
//! | the four loads of DECODER, REFRESH, ENDDELAY, LOOP; EasyDMA reads a step as its period begins | 6.17 |
//! | the polarity bit; each edge at its own tick on the pins of PSEL.OUT | 6.17 |
//!
//! The PS demands that the pins are outputs (6.17, *Pin configuration*). A pin that is no output is not driven, which
//! is a finding. After the end of a sequence, its last step goes on until STOP (PS 6.17).
//!
//! Left out: COUNTERTOP, MODE and PRESCALER take effect only when a period begins.
use crate::clocks::{CYCLES_PER_TICK, Clocks};
use crate::instance::{Act, Block, Cx, Instance, address_of, index};
use crate::pin::Pin;
use emulator_part::Cycle;

const STOPPED: u32 = 1;
const SEQSTARTED: u32 = 2;
const SEQEND: u32 = 4;
const PWMPERIODEND: u32 = 6;
const LOOPSDONE: u32 = 7;

#[derive(Clone, Copy, Debug)]
struct Play {
    sequence: usize,
    at: u32,
    /// The number of periods that remain before the next step of the sequence.
    periods: u32,
    over: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Pwm {
    block: Block,
    enable: u32,
    mode: u32,
    countertop: u32,
    prescaler: u32,
    decoder: u32,
    loops: u32,
    sequences: [[u32; 4]; 2],
    psel: [u32; 4],
    play: Option<Play>,
    loops_left: u32,
    stopping: bool,
    step: bool,
    compare: [u16; 4],
    levels: [bool; 4],
    began: Cycle,
    count: u64,
    top: u64,
    running: bool,
    next: Option<Cycle>,
}

impl Default for Pwm {
    fn default() -> Self {
        Self {
            block: Block::default(),
            enable: 0,
            mode: 0,
            countertop: 0x3FF,
            prescaler: 0,
            decoder: 0,
            loops: 0,
            sequences: [[0, 0, 1, 0]; 2],
            psel: [u32::MAX; 4],
            play: None,
            loops_left: 0,
            stopping: false,
            step: false,
            compare: [0; 4],
            levels: [false; 4],
            began: 0,
            count: CYCLES_PER_TICK,
            top: 0x3FF,
            running: false,
            next: None,
        }
    }
}

impl Pwm {
    fn up_and_down(&self) -> bool {
        self.mode & 1 != 0
    }

    fn period(&self) -> u64 {
        self.top * self.count * if self.up_and_down() { 2 } else { 1 }
    }

    fn start(&mut self, sequence: usize, cx: &mut Cx<'_>) {
        if self.enable & 1 == 0 {
            cx.misuse("SEQSTART while it is not enabled", 0);
            return;
        }
        self.loops_left = self.loops;
        self.stopping = false;
        self.begin(sequence, cx);
        if !self.running {
            self.running = true;
            self.period_begins(cx.now, cx);
        }
    }

    fn begin(&mut self, sequence: usize, cx: &mut Cx<'_>) {
        let [at, count, ..] = self.sequences[sequence];
        self.play = Some(Play { sequence, at, periods: 0, over: count == 0 });
        self.block.raise(SEQSTARTED + sequence as u32, cx);
    }

    fn load(&mut self, cx: &mut Cx<'_>) {
        let Some(mut play) = self.play else { return };
        let [from, count, refresh, delay] = self.sequences[play.sequence];
        let values = [1, 2, 4, 4][self.decoder as usize & 3];
        let mut loaded = [0; 4];
        for value in &mut loaded[..values] {
            let low = cx.dma_read(play.at).unwrap_or(0);
            let high = cx.dma_read(play.at.wrapping_add(1)).unwrap_or(0);
            *value = u16::from_le_bytes([low, high]);
            play.at = play.at.wrapping_add(2);
        }
        let [a, b, c, d] = loaded;
        match self.decoder & 3 {
            0 => self.compare = [a; 4],
            1 => self.compare = [a, a, b, b],
            2 => self.compare = loaded,
            _ => {
                self.compare = [a, b, c, a];
                self.top = u64::from(d & 0x7FFF).max(1);
            }
        }
        play.periods = refresh & 0x00FF_FFFF;
        if play.at.wrapping_sub(from) >= 2 * count {
            play.over = true;
            play.periods += delay & 0x00FF_FFFF;
        }
        let over = play.over.then_some(play.sequence);
        self.play = Some(play);
        if let Some(sequence) = over {
            self.block.raise(SEQEND + sequence as u32, cx);
            if self.block.short(sequence as u32) {
                self.stopping = true;
            }
        }
    }

    fn advance(&mut self, cx: &mut Cx<'_>) {
        let by_task = self.decoder >> 8 & 1 != 0;
        let Some(play) = &mut self.play else { return };
        let first = play.at == self.sequences[play.sequence][0];
        if by_task && !first {
            if !std::mem::take(&mut self.step) {
                return;
            }
        } else if !first && play.periods > 0 {
            play.periods -= 1;
            return;
        }
        if !play.over {
            self.load(cx);
            return;
        }
        let sequence = play.sequence;
        self.play = None;
        if self.loops_left == 0 {
            return;
        }
        if sequence == 0 {
            self.begin(1, cx);
            self.load(cx);
            return;
        }
        self.loops_left -= 1;
        if self.loops_left > 0 {
            self.begin(0, cx);
            self.load(cx);
            return;
        }
        self.block.raise(LOOPSDONE, cx);
        let base = address_of(cx.id);
        for (short, task) in [(2, 0x008), (3, 0x00C), (4, 0x004)] {
            if self.block.short(short) {
                cx.act(Act::Task(base + task));
            }
        }
    }

    fn period_begins(&mut self, at: Cycle, cx: &mut Cx<'_>) {
        self.began = at;
        self.count = CYCLES_PER_TICK << (self.prescaler & 7);
        if self.decoder & 3 != 3 {
            self.top = u64::from(self.countertop).max(1);
        }
        self.advance(cx);
        self.set_pins(cx);
        self.arm(cx);
    }

    /// Returns the counts of a period at which a channel's pin has its edges. In up-and-down counting there are two.
    fn edges(&self, channel: usize) -> [u64; 2] {
        let compare = u64::from(self.compare[channel] & 0x7FFF).min(self.top);
        if self.up_and_down() { [compare, 2 * self.top - compare] } else { [compare, self.top] }
    }

    /// Sets the pins' present levels. With polarity 0 a pin begins low and rises at the compare value; with polarity 1
    /// it begins high and falls.
    fn set_pins(&mut self, cx: &mut Cx<'_>) {
        let count = (cx.now - self.began) / self.count;
        for channel in 0..4 {
            let Some(pin) = Pin::selected(self.psel[channel]) else { continue };
            let [first, second] = self.edges(channel);
            let within = (first..second).contains(&count);
            let level = within != (self.compare[channel] >> 15 != 0);
            if !cx.pins.is_output(pin) {
                cx.misuse("OUT of PWM is no output, pin", pin.index() as u32);
                continue;
            }
            self.levels[channel] = level;
            cx.act(Act::Hold { pin, level: Some(level) });
        }
    }

    fn arm(&mut self, cx: &Cx<'_>) {
        let end = self.began + self.period();
        let edges = (0..4).filter(|&n| Pin::selected(self.psel[n]).is_some()).flat_map(|n| self.edges(n));
        let next = edges.map(|edge| self.began + edge * self.count).filter(|&at| at > cx.now).min();
        self.next = Some(next.unwrap_or(end).min(end));
    }

    fn let_go(&mut self, cx: &mut Cx<'_>) {
        for pin in self.psel.into_iter().filter_map(Pin::selected) {
            cx.act(Act::Hold { pin, level: None });
        }
    }

    fn stop(&mut self, cx: &mut Cx<'_>) {
        (self.running, self.play, self.next, self.stopping) = (false, None, None, false);
        self.block.raise(STOPPED, cx);
    }
}

impl Instance for Pwm {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x004 if self.running => self.stopping = true,
            0x004 => self.block.raise(STOPPED, cx),
            0x008 => self.start(0, cx),
            0x00C => self.start(1, cx),
            0x010 => self.step = true,
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x500 => self.enable,
            0x504 => self.mode,
            0x508 => self.countertop,
            0x50C => self.prescaler,
            0x510 => self.decoder,
            0x514 => self.loops,
            0x520..0x530 => self.sequences[0][(offset as usize - 0x520) / 4],
            0x540..0x550 => self.sequences[1][(offset as usize - 0x540) / 4],
            _ => self.psel[index(offset, 0x560, 4, 4)?],
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x500 => {
                self.enable = value & 1;
                if self.enable == 0 {
                    (self.running, self.play, self.next) = (false, None, None);
                    self.let_go(cx);
                }
            }
            0x504 => self.mode = value & 1,
            0x508 => self.countertop = value & 0x7FFF,
            0x50C => self.prescaler = value & 7,
            0x510 => self.decoder = value & 0x103,
            0x514 => self.loops = value & 0xFFFF,
            0x520..0x530 | 0x540..0x550 => {
                let field = offset as usize / 4 % 4;
                // The registers' widths are PTR 32 bits, CNT 15, REFRESH and ENDDELAY 24.
                let mask = [u32::MAX, 0x7FFF, 0x00FF_FFFF, 0x00FF_FFFF][field];
                self.sequences[usize::from(offset >= 0x540)][field] = value & mask;
            }
            _ => match index(offset, 0x560, 4, 4) {
                Some(n) => self.psel[n] = value,
                None => return false,
            },
        }
        true
    }

    fn next(&self) -> Option<Cycle> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        if cx.now < self.began + self.period() {
            self.set_pins(cx);
            self.arm(cx);
            return;
        }
        self.block.raise(PWMPERIODEND, cx);
        if self.stopping {
            self.stop(cx);
        } else {
            self.period_begins(cx.now, cx);
        }
    }

    fn moves(&self) -> bool {
        self.play.is_some()
    }
}
