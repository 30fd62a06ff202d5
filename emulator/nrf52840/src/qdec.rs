//! QDEC: the quadrature decoder (PS 6.18).
//!
//! | covered | PS |
//! |---|---|
//! | START, STOP, READCLRACC, RDCLRACC, RDCLRDBL; SAMPLERDY, REPORTRDY, ACCOF, DBLRDY, STOPPED; the shortcuts | 6.18 |
//! | SAMPLEPER, REPORTPER; ACC and ACCDBL with their limits | 6.18 |
//!
//! | left out | why |
//! |---|---|
//! | the debounce filter | pins do not bounce here; DBFEN stores the written value |
//! | the LED | its pin is not driven |
use crate::clocks::{Clocks, cycles};
use crate::instance::{Act, Block, Cx, Instance, address_of};
use crate::pin::Pin;
use emulator_part::Cycle;

const SAMPLERDY: u32 = 0;
const REPORTRDY: u32 = 1;
const ACCOF: u32 = 2;
const DBLRDY: u32 = 3;
const STOPPED: u32 = 4;

/// The shortest sample period, 128 µs, in cycles.
const PERIOD: u64 = cycles(128_000);
const ACC_LIMIT: i32 = 1023;
const DOUBLE_LIMIT: u32 = 15;

#[derive(Clone, Debug)]
pub(crate) struct Qdec {
    block: Block,
    enable: u32,
    period: u32,
    report: u32,
    psel: [u32; 3],
    plain: [u32; 3],
    sample: i32,
    acc: i32,
    acc_read: i32,
    double: u32,
    double_read: u32,
    state: u32,
    samples: u32,
    next: Option<Cycle>,
}

impl Default for Qdec {
    fn default() -> Self {
        Self {
            block: Block::default(),
            enable: 0,
            period: 0,
            report: 0,
            psel: [u32::MAX; 3],
            plain: [0, 0, 0x10],
            sample: 0,
            acc: 0,
            acc_read: 0,
            double: 0,
            double_read: 0,
            state: 0,
            samples: 0,
            next: None,
        }
    }
}

impl Qdec {
    /// The phases: A in bit 1, B in bit 0.
    fn phases(&self, cx: &Cx<'_>) -> u32 {
        let level = |n: usize| u32::from(Pin::selected(self.psel[n]).is_some_and(|pin| cx.pins.input(pin)));
        level(1) << 1 | level(2)
    }

    fn read_acc(&mut self) {
        self.acc_read = std::mem::take(&mut self.acc);
    }

    fn read_double(&mut self) {
        self.double_read = std::mem::take(&mut self.double);
    }

    fn arm(&mut self, cx: &Cx<'_>) {
        self.next = Some(cx.now + (PERIOD << self.period.min(10)));
    }

    fn shortcuts(&mut self, event: u32, cx: &mut Cx<'_>) {
        let tasks: &[(u32, u32)] = match event {
            SAMPLERDY => &[(1, 0x004), (6, 0x008)],
            REPORTRDY => &[(0, 0x008), (2, 0x00C), (3, 0x004)],
            DBLRDY => &[(4, 0x010), (5, 0x004)],
            _ => &[],
        };
        let base = address_of(cx.id);
        for &(short, task) in tasks {
            if self.block.short(short) {
                cx.act(Act::Task(base + task));
            }
        }
    }

    fn say(&mut self, event: u32, cx: &mut Cx<'_>) {
        self.block.raise(event, cx);
        self.shortcuts(event, cx);
    }
}

impl Instance for Qdec {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 if self.enable & 1 == 0 => cx.misuse("START while it is not enabled", 0),
            0x000 => {
                (self.state, self.samples) = (self.phases(cx), 0);
                self.arm(cx);
            }
            0x004 => {
                self.next = None;
                self.block.raise(STOPPED, cx);
            }
            0x008 => {
                self.read_acc();
                self.read_double();
            }
            0x00C => self.read_acc(),
            0x010 => self.read_double(),
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x500 => self.enable,
            0x504 => self.plain[0],
            0x508 => self.period,
            0x50C => self.sample.cast_unsigned(),
            0x510 => self.report,
            0x514 => self.acc.cast_unsigned(),
            0x518 => self.acc_read.cast_unsigned(),
            0x51C..=0x524 => self.psel[(offset as usize - 0x51C) / 4],
            0x528 => self.plain[1],
            0x540 => self.plain[2],
            0x544 => self.double,
            0x548 => self.double_read,
            _ => return None,
        })
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        match offset {
            0x500 => {
                self.enable = value & 1;
                if self.enable == 0 {
                    self.next = None;
                }
            }
            0x504 => self.plain[0] = value & 1,
            0x508 => self.period = value & 0xF,
            0x510 => self.report = value & 0xF,
            0x51C..=0x524 => self.psel[(offset as usize - 0x51C) / 4] = value,
            0x528 => self.plain[1] = value & 1,
            0x540 => self.plain[2] = value & 0x1FF,
            _ => return false,
        }
        true
    }

    fn next(&self) -> Option<Cycle> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        self.arm(cx);
        let (was, now) = (self.state, self.phases(cx));
        self.state = now;
        // In forward rotation the phases are 00, 10, 11, 01 (PS 6.18: A leads B).
        const PLACE: [i32; 4] = [0, 3, 1, 2];
        self.sample = match (PLACE[now as usize] - PLACE[was as usize]).rem_euclid(4) {
            0 => 0,
            1 => 1,
            3 => -1,
            _ => 2,
        };
        if self.sample == 2 {
            self.double = (self.double + 1).min(DOUBLE_LIMIT);
        } else if (self.acc + self.sample).abs() > ACC_LIMIT + i32::from(self.acc + self.sample < 0) {
            self.block.raise(ACCOF, cx);
        } else {
            self.acc += self.sample;
        }
        self.say(SAMPLERDY, cx);
        self.samples += 1;
        let every = [10, 40, 80, 120, 160, 200, 240, 280, 1][self.report.min(8) as usize];
        if self.samples >= every {
            self.samples = 0;
            if self.acc != 0 {
                self.say(REPORTRDY, cx);
            }
            if self.double != 0 {
                self.say(DBLRDY, cx);
            }
        }
    }
}
