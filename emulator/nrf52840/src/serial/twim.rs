//! TWIM: the two-wire controllers TWIM0 and TWIM1 (PS 6.31).
//!
//! | covered | PS |
//! |---|---|
//! | STARTTX, STARTRX, STOP, SUSPEND, RESUME; TXSTARTED, RXSTARTED, LASTTX, LASTRX, STOPPED, SUSPENDED, ERROR | 6.31 |
//! | LASTTX_STARTRX, LASTTX_SUSPEND, LASTTX_STOP, LASTRX_STARTTX, LASTRX_STOP | 6.31 |
//! | EasyDMA with MAXCNT, AMOUNT and LIST; ANACK and DNACK | 6.31 |
//! | each byte on the bus at its own end, with clock stretching by the bus | 6.31 |
//!
//! The PS demands SCL and SDA as inputs with drive S0D1 (6.31, *Pin configuration*). The pull-ups are outside the part.
//!
//! | left out | why |
//! |---|---|
//! | OVERRUN | EasyDMA is always fast enough |
//! | LASTRX_SUSPEND | a finding when it is set |
//! | arbitration with another controller | a TWIM does not support it |
//!
//! Assumed: a byte takes nine bits of FREQUENCY, and a start and a stop one bit each.
use super::{Buffer, Channel};
use crate::clocks::CYCLES_PER_TICK;
use crate::instance::{Act, Block, Cx, address_of};
use emulator_part::{Cycle, I2cAnswer, I2cEvent};

const STOPPED: u32 = 1;
const ERROR: u32 = 9;
const SUSPENDED: u32 = 18;
const RXSTARTED: u32 = 19;
const TXSTARTED: u32 = 20;
const LASTRX: u32 = 23;
const LASTTX: u32 = 24;

const LASTTX_STARTRX: u32 = 7;
const LASTTX_SUSPEND: u32 = 8;
const LASTTX_STOP: u32 = 9;
const LASTRX_STARTTX: u32 = 10;
const LASTRX_SUSPEND: u32 = 11;
const LASTRX_STOP: u32 = 12;

const ANACK: u32 = 1 << 1;
const DNACK: u32 = 1 << 2;

/// The present action on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Idle,
    /// The address, `true` for a read.
    Address(bool),
    Write,
    Read,
    Stop,
    /// A transfer ended without a stop. The TWIM holds SCL.
    Held,
}

#[derive(Clone, Debug)]
pub(crate) struct TwoWire {
    address: u32,
    errorsrc: u32,
    step: Step,
    tx: Buffer,
    rx: Buffer,
    due: Option<Cycle>,
    suspended: bool,
    stopping: bool,
    bit: u64,
}

impl Default for TwoWire {
    fn default() -> Self {
        Self {
            address: 0,
            errorsrc: 0,
            step: Step::Idle,
            tx: Buffer::default(),
            rx: Buffer::default(),
            due: None,
            suspended: false,
            stopping: false,
            bit: 0,
        }
    }
}

impl TwoWire {
    pub(crate) fn stop(&mut self) {
        (self.step, self.due, self.suspended, self.stopping) = (Step::Idle, None, false, false);
    }

    pub(crate) fn next(&self) -> Option<Cycle> {
        self.due
    }

    pub(crate) fn read(&self, offset: u32) -> u32 {
        if offset == 0x588 { self.address } else { self.errorsrc }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) {
        if offset == 0x588 {
            self.address = value & 0x7F;
        } else {
            self.errorsrc &= !value;
        }
    }

    fn arm(&mut self, bits: u64, cx: &Cx<'_>) {
        self.due = (!self.suspended).then_some(cx.now + bits * self.bit);
    }

    pub(crate) fn task(
        &mut self,
        offset: u32,
        frequency: u32,
        block: &mut Block,
        rx: &mut Channel,
        tx: &mut Channel,
        cx: &mut Cx<'_>,
    ) {
        match offset {
            0x000 | 0x008 => {
                // FREQUENCY has values for 100, 250 and 400 kbit/s. Anomaly 219 adds one for 390 kbit/s, which keeps
                // the low time of fast mode.
                let ticks = match frequency {
                    0x0198_0000 => 160,
                    0x0400_0000 => 64,
                    0x0620_0000 => 41,
                    0x0640_0000 => 40,
                    _ => {
                        cx.misuse("a FREQUENCY that TWIM does not have", frequency);
                        return;
                    }
                };
                if !matches!(self.step, Step::Idle | Step::Held) {
                    cx.misuse("STARTTX or STARTRX during a transfer", offset);
                    return;
                }
                self.bit = ticks * CYCLES_PER_TICK;
                self.stopping = false;
                let reads = offset == 0;
                if reads {
                    self.rx = rx.take();
                    block.raise(RXSTARTED, cx);
                } else {
                    self.tx = tx.take();
                    block.raise(TXSTARTED, cx);
                }
                self.step = Step::Address(reads);
                self.arm(10, cx);
            }
            0x014 => match self.step {
                Step::Idle => block.raise(STOPPED, cx),
                Step::Held => self.set_out_stop(cx),
                _ => self.stopping = true,
            },
            0x01C => {
                self.suspended = true;
                block.raise(SUSPENDED, cx);
            }
            0x020 if self.suspended => {
                self.suspended = false;
                if !matches!(self.step, Step::Idle | Step::Held) && self.due.is_none() {
                    self.arm(9, cx);
                }
            }
            _ => {}
        }
    }

    fn set_out_stop(&mut self, cx: &Cx<'_>) {
        self.step = Step::Stop;
        self.suspended = false;
        self.arm(1, cx);
    }

    pub(crate) fn due(&mut self, cx: &mut Cx<'_>) {
        self.due = None;
        let event = match self.step {
            Step::Idle | Step::Held => return,
            Step::Address(reads) => I2cEvent::Start((self.address as u8) << 1 | u8::from(reads)),
            Step::Write => match self.tx.next().and_then(|address| cx.dma_read(address)) {
                Some(byte) => I2cEvent::Write(byte),
                None => I2cEvent::Write(0xFF),
            },
            Step::Read => I2cEvent::Read(self.rx.done + 1 < self.rx.len),
            Step::Stop => I2cEvent::Stop,
        };
        let id = cx.id;
        cx.act(Act::TwoWire { id, event });
    }

    pub(crate) fn answer(
        &mut self,
        answer: I2cAnswer,
        block: &mut Block,
        rx: &mut Channel,
        tx: &mut Channel,
        cx: &mut Cx<'_>,
    ) {
        let stretched = crate::clocks::cycles(answer.stretched_ns);
        let refused = |two_wire: &mut Self, source: u32, block: &mut Block, cx: &mut Cx<'_>| {
            two_wire.errorsrc |= source;
            two_wire.step = Step::Held;
            block.raise(ERROR, cx);
            if two_wire.stopping {
                two_wire.set_out_stop(cx);
            }
        };
        match self.step {
            Step::Idle | Step::Held => {}
            Step::Address(_) if !answer.acknowledged => refused(self, ANACK, block, cx),
            Step::Address(reads) => {
                self.step = if reads { Step::Read } else { Step::Write };
                self.go_on(stretched, block, rx, tx, cx);
            }
            Step::Write => {
                self.tx.done += 1;
                tx.amount = self.tx.done;
                if answer.acknowledged {
                    self.go_on(stretched, block, rx, tx, cx);
                } else {
                    refused(self, DNACK, block, cx);
                }
            }
            Step::Read => {
                if let Some(address) = self.rx.next() {
                    cx.dma_write(address, answer.data);
                    self.rx.done += 1;
                }
                rx.amount = self.rx.done;
                self.go_on(stretched, block, rx, tx, cx);
            }
            Step::Stop => {
                self.step = Step::Idle;
                self.stopping = false;
                block.raise(STOPPED, cx);
            }
        }
    }

    /// Begins the next byte, or ends the transfer. LASTTX and LASTRX come as the last byte begins (PS 6.31).
    fn go_on(&mut self, late: u64, block: &mut Block, rx: &mut Channel, tx: &mut Channel, cx: &mut Cx<'_>) {
        let writes = self.step == Step::Write;
        let buffer = if writes { self.tx } else { self.rx };
        if self.stopping {
            self.set_out_stop(cx);
            return;
        }
        if buffer.done >= buffer.len {
            if writes {
                tx.amount = buffer.done;
            } else {
                rx.amount = buffer.done;
            }
            self.step = Step::Held;
            let base = address_of(cx.id);
            let task = |cx: &mut Cx<'_>, offset| cx.act(Act::Task(base + offset));
            if writes && block.short(LASTTX_STARTRX) {
                task(cx, 0x000);
            } else if writes && block.short(LASTTX_SUSPEND) {
                task(cx, 0x01C);
            } else if !writes && block.short(LASTRX_STARTTX) {
                task(cx, 0x008);
            } else if !writes && block.short(LASTRX_SUSPEND) {
                cx.unmodelled("LASTRX_SUSPEND; SHORTS", block.shorts);
            }
            if block.short(if writes { LASTTX_STOP } else { LASTRX_STOP }) {
                self.set_out_stop(cx);
            }
            return;
        }
        self.arm(9, cx);
        if let Some(due) = &mut self.due {
            *due += late;
        }
        if buffer.done + 1 == buffer.len {
            block.raise(if writes { LASTTX } else { LASTRX }, cx);
        }
    }
}
