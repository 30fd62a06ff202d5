//! CAN1, the basic extended CAN controller, in loopback (RM0090 chapter 32).
//!
//! | Covered | Manual |
//! |---|---|
//! | Initialization, normal and sleep mode with their request and acknowledge bits | 32.4 |
//! | Transmission: three mailboxes, priority by identifier or by request, abort | 32.7.1 |
//! | Loopback: a frame takes the exact time of its bits, including stuff bits; acceptance filters | 32.5.2, 32.7.4 |
//! | Both receive FIFOs with overrun and lock | 32.7.3 |
//! | Interrupts of transmission and of both FIFOs | 32.8 |
//!
//! **Left out.** There is no bus: outside loopback a frame is never sent, which is a finding. Errors and the status
//! interrupt never come. The controller leaves initialization mode as soon as RX is high, not after eleven bits. A
//! received frame is available at the end of its end-of-frame field, not one bit before. Time stamps (`TTCM`) are 0.

mod message;
#[cfg(test)]
mod tests;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER};

use crate::cx::{CanPin, Clocks, Cx, Peripheral, Signal, Wires};

const INRQ: u32 = 1 << 0;
const SLEEP: u32 = 1 << 1;
const TXFP: u32 = 1 << 2;
const RFLM: u32 = 1 << 3;
const RESET: u32 = 1 << 15;

const LBKM: u32 = 1 << 30;

/// Bits of a mailbox's identifier register.
const TXRQ: u32 = 1 << 0;
const RTR: u32 = 1 << 1;
const IDE: u32 = 1 << 2;

/// Bits of each mailbox's byte in TSR.
const RQCP: u32 = 1 << 0;
const TXOK: u32 = 1 << 1;
const ABRQ: u32 = 1 << 7;

const FULL: u32 = 1 << 3;
const FOVR: u32 = 1 << 4;
const RFOM: u32 = 1 << 5;

/// The number of bits at the end of a frame that are never stuffed: the delimiter of the CRC, acknowledge with its
/// delimiter, and end of frame.
const TAIL_BITS: u64 = 10;
/// The number of bits between two frames.
const INTERMISSION_BITS: u64 = 3;

/// A transmit or receive mailbox: identifier, length (with time stamp and filter number) and data.
#[derive(Clone, Copy, Debug, Default)]
struct Mailbox {
    identifier: u32,
    length: u32,
    data: [u32; 2],
}

#[derive(Clone, Debug, Default)]
struct Fifo {
    messages: [Mailbox; 3],
    pending: u8,
    flags: u32,
}

#[derive(Clone, Debug)]
pub(crate) struct Can {
    mcr: u32,
    /// The bits INAK and SLAK.
    in_init: bool,
    asleep: bool,
    tsr: u32,
    ier: u32,
    btr: u32,
    mailboxes: [Mailbox; 3],
    /// The order in which transmission of the mailboxes was requested.
    order: [u64; 3],
    requests: u64,
    /// The mailbox that is being sent, with the cycle at which its frame ends.
    sending: Option<(usize, Cycle)>,
    free_at: Cycle,
    fifos: [Fifo; 2],
    fmr: u32,
    list: u32,
    wide: u32,
    to_fifo: u32,
    active: u32,
    filters: [[u32; 2]; 28],
    due: Cycle,
}

impl Can {
    pub(crate) fn new() -> Self {
        Self {
            mcr: 0x0001_0000 | SLEEP,
            in_init: false,
            asleep: true,
            tsr: 0,
            ier: 0,
            btr: 0x0123_0000,
            mailboxes: [Mailbox::default(); 3],
            order: [0; 3],
            requests: 0,
            sending: None,
            free_at: 0,
            fifos: [Fifo::default(), Fifo::default()],
            fmr: 0x2A1C_0E01,
            list: 0,
            wide: 0,
            to_fifo: 0,
            active: 0,
            filters: [[0; 2]; 28],
            due: NEVER,
        }
    }

    fn bit(&self, cx: &Cx) -> u64 {
        let quanta = 3 + (self.btr >> 16 & 0xF) + (self.btr >> 20 & 7);
        u64::from(quanta * ((self.btr & 0x3FF) + 1)) * u64::from(cx.clocks.pclk1)
    }

    /// Whether RX is recessive. In loopback the pin is ignored (RM0090 32.5.2). A pin that is not connected is high.
    fn hears_recessive(&self, cx: &Cx) -> bool {
        self.btr & LBKM != 0 || cx.pads.input(Signal::Can(1, CanPin::Rx)).unwrap_or(true)
    }

    /// Enters the mode that software has requested (RM0090 32.4), but not before the present frame has been sent.
    fn follow_requests(&mut self, cx: &Cx) {
        if self.sending.is_some() {
            return;
        }
        let recessive = self.hears_recessive(cx);
        match (self.mcr & INRQ != 0, self.mcr & SLEEP != 0) {
            (true, false) => (self.in_init, self.asleep) = (true, false),
            (false, sleeps) => {
                self.asleep = sleeps;
                self.in_init &= !recessive;
            }
            (true, true) => {}
        }
    }

    fn send(&mut self, cx: &mut Cx) {
        self.due = self.sending.map_or(NEVER, |(_, ends)| ends);
        if self.sending.is_some() || self.in_init || self.asleep {
            return;
        }
        let waits = (0..3).filter(|&nth| self.mailboxes[nth].identifier & TXRQ != 0);
        let next = if self.mcr & TXFP != 0 {
            waits.min_by_key(|&nth| self.order[nth])
        } else {
            // A lower identifier has a higher priority. A standard identifier precedes an extended one with the same
            // first bits.
            waits.min_by_key(|&nth| {
                let identifier = self.mailboxes[nth].identifier;
                let tail = if identifier & IDE != 0 { 1 << 18 | identifier >> 3 & 0x3_FFFF } else { 0 };
                (identifier >> 21, tail, nth)
            })
        };
        let Some(next) = next else { return };
        if self.btr & LBKM == 0 {
            cx.find(FindingKind::Unmodelled, "a frame outside loopback mode: there is no bus, it is never sent");
            return;
        }
        let ends = cx.now.max(self.free_at) + (self.mailboxes[next].stuffed_bits() + TAIL_BITS) * self.bit(cx);
        self.sending = Some((next, ends));
        self.due = ends;
    }

    /// The FIFO and the number of the filter that accepts `message` (RM0090 32.7.4).
    fn accept(&self, message: &Mailbox) -> Option<(usize, u32)> {
        if self.fmr & 1 != 0 {
            return None;
        }
        let (wide, narrow) = message.compared();
        let mut numbers = [0_u32; 2];
        let mut best = None;
        for bank in 0..(self.fmr >> 8 & 0x3F).min(28) as usize {
            let has = |register: u32| register >> bank & 1 != 0;
            let (fifo, is_wide, is_list) = (usize::from(has(self.to_fifo)), has(self.wide), has(self.list));
            let [one, two] = self.filters[bank];
            let matches = match (is_wide, is_list) {
                (true, false) => [(wide ^ one) & two & !1 == 0, false, false, false],
                (true, true) => [wide == one & !1, wide == two & !1, false, false],
                (false, false) => {
                    let masked = |filter: u32| (narrow ^ filter) & filter >> 16 & 0xFFFF == 0;
                    [masked(one), masked(two), false, false]
                }
                (false, true) => [one & 0xFFFF, one >> 16, two & 0xFFFF, two >> 16].map(|filter| filter == narrow),
            };
            let first = numbers[fifo];
            numbers[fifo] += if is_wide { 1 } else { 2 } << u32::from(is_list);
            if !has(self.active) {
                continue;
            }
            if let Some(nth) = matches.iter().position(|&matches| matches) {
                let key = (!is_wide, !is_list, first + nth as u32);
                if best.is_none_or(|(known, _)| key < known) {
                    best = Some((key, fifo));
                }
            }
        }
        best.map(|((_, _, number), fifo)| (fifo, number))
    }

    fn status(&self, cx: &Cx) -> u32 {
        let recessive = self.hears_recessive(cx);
        let sending = u32::from(self.sending.is_some());
        let levels = if recessive { 0xC00 } else { 0 };
        u32::from(self.in_init) | u32::from(self.asleep) << 1 | sending << 8 | levels
    }

    fn transmit_status(&self) -> u32 {
        let empty = |nth: usize| self.mailboxes[nth].identifier & TXRQ == 0;
        let empties = (0..3).map(|nth| u32::from(empty(nth)) << (26 + nth)).sum::<u32>();
        // CODE is the number of the next empty mailbox. If no mailbox is empty, CODE is the number of the mailbox that
        // would be sent last.
        let code = (0..3)
            .find(|&nth| empty(nth))
            .unwrap_or_else(|| (0..3).max_by_key(|&nth| (self.mailboxes[nth].identifier >> 3, nth)).unwrap_or(0));
        self.tsr | empties | (code as u32) << 24
    }

    fn write_mailbox(&mut self, nth: usize, register: u32, value: u32, cx: &mut Cx) {
        let mailbox = &mut self.mailboxes[nth];
        if mailbox.identifier & TXRQ != 0 {
            cx.find(FindingKind::Misuse, "a mailbox is written while its frame waits: it stays");
            return;
        }
        match register {
            0 => {
                mailbox.identifier = value;
                if value & TXRQ != 0 {
                    self.tsr &= !(0xF << (8 * nth));
                    self.requests += 1;
                    self.order[nth] = self.requests;
                    self.send(cx);
                }
            }
            1 => mailbox.length = value & 0x10F,
            2 => mailbox.data[0] = value,
            _ => mailbox.data[1] = value,
        }
    }
}

impl Peripheral for Can {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        self.peek(offset & !3, cx) >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        let value = crate::lanes(width, value);
        match offset & !3 {
            0x00 if value & RESET != 0 => *self = Self::new(),
            0x00 => {
                self.mcr = value & 0x0001_00FF;
                self.follow_requests(cx);
                self.send(cx);
                cx.output(Signal::Can(1, CanPin::Tx), Some(true));
            }
            0x08 => {
                for nth in 0..3 {
                    let byte = value >> (8 * nth) & 0xFF;
                    if byte & RQCP != 0 {
                        self.tsr &= !(0xF << (8 * nth));
                    }
                    let waits = self.mailboxes[nth].identifier & TXRQ != 0;
                    if byte & ABRQ != 0 && waits && self.sending.is_none_or(|(sent, _)| sent != nth) {
                        self.mailboxes[nth].identifier &= !TXRQ;
                        self.tsr |= RQCP << (8 * nth);
                    }
                }
            }
            0x0C => self.fifos[0].write(value),
            0x10 => self.fifos[1].write(value),
            0x14 => self.ier = value & 0x0003_8F7F,
            0x1C if self.in_init => self.btr = value & 0xC37F_03FF,
            0x1C => cx.find(FindingKind::Misuse, "BTR is written outside initialization mode: it stays"),
            register @ 0x180..0x1B0 => {
                self.write_mailbox((register as usize - 0x180) / 16, register / 4 % 4, value, cx);
            }
            0x200 => self.fmr = value & 0x3F01 | 0x2A1C_0000,
            0x204 => self.list = value & 0x0FFF_FFFF,
            0x20C => self.wide = value & 0x0FFF_FFFF,
            0x214 => self.to_fifo = value & 0x0FFF_FFFF,
            0x21C => self.active = value & 0x0FFF_FFFF,
            register @ 0x240..0x320 => {
                self.filters[(register as usize - 0x240) / 8][register as usize / 4 % 2] = value;
            }
            _ => {}
        }
    }

    fn peek(&self, offset: u32, cx: &mut Cx) -> u32 {
        let of = |mailbox: &Mailbox, register: u32| match register {
            0 => mailbox.identifier,
            1 => mailbox.length,
            2 => mailbox.data[0],
            _ => mailbox.data[1],
        };
        match offset {
            0x00 => self.mcr,
            0x04 => self.status(cx),
            0x08 => self.transmit_status(),
            0x0C | 0x10 => {
                let fifo = &self.fifos[(offset as usize - 0x0C) / 4];
                u32::from(fifo.pending) | fifo.flags
            }
            0x14 => self.ier,
            0x1C => self.btr,
            0x180..0x1B0 => of(&self.mailboxes[(offset as usize - 0x180) / 16], offset / 4 % 4),
            0x1B0..0x1D0 => of(&self.fifos[(offset as usize - 0x1B0) / 16].messages[0], offset / 4 % 4),
            0x200 => self.fmr,
            0x204 => self.list,
            0x20C => self.wide,
            0x214 => self.to_fifo,
            0x21C => self.active,
            0x240..0x320 => self.filters[(offset as usize - 0x240) / 8][offset as usize / 4 % 2],
            _ => 0,
        }
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, _: &mut W) {
        let Some((nth, ends)) = self.sending.filter(|&(_, ends)| ends <= cx.now) else { return };
        self.sending = None;
        self.free_at = ends + INTERMISSION_BITS * self.bit(cx);
        self.mailboxes[nth].identifier &= !TXRQ;
        self.tsr |= (RQCP | TXOK) << (8 * nth);
        let mut message = self.mailboxes[nth];
        if let Some((fifo, number)) = self.accept(&message) {
            message.length = message.length & 0xF | number << 8;
            self.fifos[fifo].push(message, self.mcr & RFLM != 0);
        }
        self.follow_requests(cx);
        self.send(cx);
    }

    fn irq(&self) -> u32 {
        let sent = self.ier & 1 != 0 && self.tsr & (RQCP | RQCP << 8 | RQCP << 16) != 0;
        let received = |nth: usize| u32::from(self.fifos[nth].wants(self.ier >> (1 + 3 * nth)));
        u32::from(sent) | received(0) << 1 | received(1) << 2
    }

    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx) {
        if let Some((_, ends)) = &mut self.sending {
            let left = ends.saturating_sub(cx.now);
            *ends = cx.now + left * u64::from(cx.clocks.pclk1) / u64::from(old.pclk1.max(1));
            self.due = *ends;
        }
    }

    fn reset(&mut self) {
        *self = Self::new();
    }

    fn input(&mut self, _: Signal, _: bool, cx: &mut Cx) {
        self.follow_requests(cx);
        self.send(cx);
    }
}
