//! UARTE: the UART with EasyDMA (PS 6.34), and the legacy UART, which shares its registers (6.33).
//!
//! `transmitter` models TXD and CTS, `receiver` models RXD and RTS, `line` the wire, and this module the registers.
//!
//! | covered | PS |
//! |---|---|
//! | STARTTX, STOPTX; TXSTARTED, TXDRDY, ENDTX, TXSTOPPED | 6.34 |
//! | STARTRX, STOPRX, FLUSHRX; RXSTARTED, RXDRDY, ENDRX, RXTO; ENDRX_STARTRX, ENDRX_STOPRX | 6.34 |
//! | the 6-byte FIFO that bridges two buffers, and OVERRUN past it | 6.34 |
//! | BAUDRATE, parity and stop bits, with their timing on the wire | 6.34 |
//! | flow control: CTS delays the next byte, RTS shows that there is room; events CTS and NCTS | 6.34 |
//! | FRAMING, PARITY and BREAK, from the levels at the receiver's own sample instants | 6.34 |
//! | the legacy UART: RXD, TXD, RXDRDY, TXDRDY, ERROR, SUSPEND | 6.33 |
//!
//! The receiver waits for a falling edge, samples each bit in its middle by its own BAUDRATE up to the stop bit, and
//! then waits for the next falling edge. A frame of another rate is received as the bits at these instants. The PS does
//! not say how often a bit is sampled; one sample is assumed. Also assumed: a byte with a framing or parity error is
//! received.
//!
//! The PS demands RXD and CTS as inputs, TXD and RTS as outputs (6.34, *Pin configuration*). Here a TXD that is no
//! output sends nothing, which is a finding. An RXD without its input buffer receives nothing.
//!
//! | left out | why |
//! |---|---|
//! | the check of the start bit's middle, and bytes that begin before STARTRX | there is no noise here |

mod line;
mod receiver;
mod transmitter;

use crate::clocks::{CYCLES_PER_TICK, Clocks};
use crate::instance::{Act, Block, Cx, Instance};
use crate::pin::Pin;
use emulator_part::{Cycle, UartFrame, UartParity};
use std::collections::VecDeque;

const CTS: u32 = 0;
const NCTS: u32 = 1;
const RXDRDY: u32 = 2;
const ENDRX: u32 = 4;
const TXDRDY: u32 = 7;
const ENDTX: u32 = 8;
const ERROR: u32 = 9;
const RXTO: u32 = 17;
const RXSTARTED: u32 = 19;
const TXSTARTED: u32 = 20;
const TXSTOPPED: u32 = 22;
const ENDRX_STARTRX: u32 = 5;
const ENDRX_STOPRX: u32 = 6;

const OVERRUN: u32 = 1;
const PARITY: u32 = 1 << 1;
const FRAMING: u32 = 1 << 2;
const BREAK: u32 = 1 << 3;

const ENABLED: u32 = 8;
const LEGACY: u32 = 4;
/// The number of bytes that the receiver can hold without a buffer.
const FIFO: usize = 6;
/// The free room of the FIFO, in bytes, at which RTS goes high. RTS is low only while more is free (PS 6.34).
const ROOM: usize = 4;
/// The time from STOPRX to RXTO, in byte times. In this time the far end may finish its byte.
const RX_TIMEOUT_BYTES: u64 = 4;
/// The longest bit that can be received, one second, in picoseconds.
const LONGEST_BIT_PS: u64 = 1_000_000_000_000;
/// The picoseconds of a core cycle without error.
const CYCLE_PS: u64 = 15_625;

#[derive(Debug, Default, Clone, Copy)]
struct Buffer {
    at: u32,
    len: u32,
    done: u32,
}

#[derive(Debug, Default, Clone)]
struct Line {
    frames: VecDeque<(Cycle, UartFrame)>,
}

/// The length of a core cycle in units of 2⁻¹⁶ ps.
fn period(clocks: &Clocks) -> u64 {
    (CYCLE_PS << 16) * 1_000_000_000 / 1_000_000_000_u64.wrapping_add_signed(clocks.hf_ppb)
}

#[derive(Clone, Debug)]
pub(crate) struct Uarte {
    block: Block,
    enable: u32,
    psel: [u32; 4],
    baudrate: u32,
    config: u32,
    errorsrc: u32,
    rxd: [u32; 3],
    txd: [u32; 3],
    tx: Option<Buffer>,
    byte: u8,
    tx_from: u64,
    tx_sent: u64,
    tx_stopping: bool,
    tx_next: Option<Cycle>,
    tx_held: bool,
    /// The pins RTS and TXD that are driven, with their levels between frames.
    driven: [Option<(Pin, bool)>; 2],
    rx: Option<Buffer>,
    rx_on: bool,
    rx_since: Cycle,
    rx_timeout: Option<Cycle>,
    fifo: VecDeque<u8>,
    line: Line,
    /// The present byte's start edge, and the sample of its stop bit, both in cycles.
    receiving: Option<(Cycle, Cycle)>,
    legacy_tx: bool,
    legacy_waiting: Option<u8>,
}

impl Default for Uarte {
    fn default() -> Self {
        Self {
            block: Block::default(),
            enable: 0,
            psel: [u32::MAX; 4],
            baudrate: 0x0400_0000,
            config: 0,
            errorsrc: 0,
            rxd: [0; 3],
            txd: [0; 3],
            tx: None,
            byte: 0,
            tx_from: 0,
            tx_sent: 0,
            tx_stopping: false,
            tx_next: None,
            tx_held: false,
            driven: [None; 2],
            rx: None,
            rx_on: false,
            rx_since: 0,
            rx_timeout: None,
            fifo: VecDeque::new(),
            line: Line::default(),
            receiving: None,
            legacy_tx: false,
            legacy_waiting: None,
        }
    }
}

impl Uarte {
    fn has_parity(&self) -> bool {
        self.config >> 1 & 0b111 == 0b111
    }

    /// The PCLK16M ticks of `bytes` bytes. BAUDRATE is in units of 2^-32 of PCLK16M.
    fn ticks(&self, bytes: u64) -> u64 {
        let stop = 1 + u64::from(self.config >> 4 & 1);
        let bits = bytes * (9 + u64::from(self.has_parity()) + stop);
        (bits << 32) / u64::from(self.baudrate.max(1))
    }

    fn half_bits(&self, halves: u64) -> u64 {
        (halves << 31) * CYCLES_PER_TICK / u64::from(self.baudrate.max(1))
    }

    fn stop(&mut self) {
        (self.tx, self.tx_next, self.rx, self.rx_on, self.rx_timeout) = (None, None, None, false, None);
        (self.legacy_tx, self.legacy_waiting, self.receiving) = (false, None, None);
        self.tx_held = false;
        self.fifo.clear();
        self.line.frames.clear();
    }
}

impl Instance for Uarte {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        if !matches!(self.enable, ENABLED | LEGACY) && matches!(offset, 0x000 | 0x008) {
            cx.misuse("started while it is not enabled; ENABLE", self.enable);
            return true;
        }
        let legacy = self.enable == LEGACY;
        match offset {
            0x000 if legacy => self.receiver_on(cx),
            0x008 if legacy => self.legacy_tx = true,
            0x00C | 0x01C if legacy => {
                (self.legacy_tx, self.legacy_waiting) = (false, None);
                if offset == 0x01C {
                    self.stop_rx(cx);
                }
            }
            0x000 => self.start_rx(cx),
            0x004 => self.stop_rx(cx),
            0x008 => {
                if self.tx.is_some() {
                    cx.misuse("STARTTX during a transmission", 0);
                    return true;
                }
                self.block.raise(TXSTARTED, cx);
                (self.tx_from, self.tx_sent) = (cx.hf(), 0);
                self.tx = Some(Buffer { at: self.txd[0], len: self.txd[1], done: 0 });
                if self.txd[1] == 0 {
                    self.tx = None;
                    self.txd[2] = 0;
                    self.block.raise(ENDTX, cx);
                } else {
                    self.fetch(cx);
                }
            }
            0x00C => {
                if self.tx.is_some() && !self.tx_held {
                    self.tx_stopping = true;
                } else {
                    self.stop_tx(cx);
                }
            }
            0x02C => {
                self.rx = Some(Buffer { at: self.rxd[0], len: self.rxd[1], done: 0 });
                self.drain(cx);
                self.end_rx(cx);
            }
            _ => return false,
        }
        self.drive_pins(cx);
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x480 => self.errorsrc,
            0x500 => self.enable,
            0x508..=0x514 => self.psel[(offset as usize - 0x508) / 4],
            0x518 => self.fifo.front().map_or(0, |&byte| u32::from(byte)),
            0x51C => 0,
            0x524 => self.baudrate,
            0x534..=0x53C => self.rxd[(offset as usize - 0x534) / 4],
            0x544..=0x54C => self.txd[(offset as usize - 0x544) / 4],
            0x56C => self.config,
            _ => return None,
        })
    }

    fn was_read(&mut self, offset: u32, cx: &mut Cx<'_>) {
        if offset == 0x518 && self.enable == LEGACY && self.fifo.pop_front().is_some() && !self.fifo.is_empty() {
            self.block.raise(RXDRDY, cx);
        }
        self.drive_pins(cx);
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x480 => self.errorsrc &= !value,
            0x500 => {
                let enable = value & 0xF;
                if enable != self.enable {
                    self.stop();
                }
                self.enable = enable;
            }
            0x508..=0x514 => self.psel[(offset as usize - 0x508) / 4] = value,
            0x518 => {}
            0x51C => self.legacy_send(value as u8, cx),
            0x524 => self.baudrate = value,
            0x534 | 0x538 => {
                self.rxd[(offset as usize - 0x534) / 4] = if offset == 0x538 { value & 0xFFFF } else { value }
            }
            0x544 | 0x548 => {
                self.txd[(offset as usize - 0x544) / 4] = if offset == 0x548 { value & 0xFFFF } else { value }
            }
            0x53C | 0x54C => {}
            0x56C => {
                self.config = value & 0x1F;
            }
            _ => return false,
        }
        self.drive_pins(cx);
        true
    }

    fn next(&self) -> Option<Cycle> {
        let sampled = self.receiving.map(|(_, stop)| stop);
        [self.tx_next, self.rx_timeout, sampled].into_iter().flatten().min()
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        let now = cx.now;
        if self.tx_next.take_if(|at| *at <= now).is_some() {
            self.tx_sent += 1;
            self.sent(cx);
            if let Some(tx) = &mut self.tx {
                tx.done += 1;
                let (over, done) = (tx.done == tx.len, tx.done);
                if over {
                    self.tx = None;
                    self.txd[2] = done;
                    self.block.raise(ENDTX, cx);
                }
                if self.tx_stopping {
                    self.stop_tx(cx);
                } else if !over {
                    self.fetch(cx);
                }
            } else if let Some(byte) = self.legacy_waiting.take() {
                self.byte = byte;
                self.arm_tx(cx);
            }
        }
        self.sample(cx);
        if self.rx_timeout.take_if(|at| *at <= now).is_some() {
            self.rx_on = false;
            if self.rx.is_some() {
                // The receiver is stopped first, so that no shortcut restarts it.
                self.finish_rx(cx);
            }
            self.block.raise(RXTO, cx);
        }
        self.drive_pins(cx);
    }

    fn moves(&self) -> bool {
        self.tx.is_some() || self.rx.is_some()
    }
}
