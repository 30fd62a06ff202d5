//! UARTE: the UART with EasyDMA (PS 6.34).
//!
//! | covered | PS |
//! |---|---|
//! | STARTTX, STOPTX; TXSTARTED, TXDRDY, ENDTX, TXSTOPPED | 6.34 |
//! | STARTRX, STOPRX, FLUSHRX; RXSTARTED, RXDRDY, ENDRX, RXTO; ENDRX_STARTRX, ENDRX_STOPRX | 6.34 |
//! | the 6-byte FIFO that bridges two buffers, and OVERRUN past it | 6.34 |
//! | BAUDRATE, parity and stop bits in the length of a byte | 6.34 |
//!
//! | left out | why |
//! |---|---|
//! | flow control | nothing here drives RTS or CTS: reported when enabled |
//! | parity, framing and break errors | a byte from outside is a good byte |
//! | the legacy UART | reported when enabled |
use crate::clocks::Clocks;
use crate::instance::{Act, Block, Cx, Instance};
use crate::soc::in_data_ram;
use std::collections::VecDeque;

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

const ENABLED: u32 = 8;
/// Bytes the receiver holds when no buffer waits.
const FIFO: usize = 6;
/// Byte times from STOPRX to RXTO, in which the far end may finish what it had begun.
const RX_TIMEOUT_BYTES: u64 = 4;

#[derive(Debug, Default, Clone, Copy)]
struct Buffer {
    at: u32,
    len: u32,
    done: u32,
}

/// One instance.
#[derive(Debug)]
pub(crate) struct Uarte {
    block: Block,
    enable: u32,
    psel: [u32; 4],
    baudrate: u32,
    config: u32,
    errorsrc: u32,
    /// PTR, MAXCNT, AMOUNT of RXD and TXD.
    rxd: [u32; 3],
    txd: [u32; 3],
    tx: Option<Buffer>,
    /// The byte on its way, the tick its transmission began at, and whether the transmitter was told to stop.
    byte: u8,
    tx_from: u64,
    tx_sent: u64,
    tx_stopping: bool,
    tx_next: Option<u64>,
    rx: Option<Buffer>,
    rx_on: bool,
    rx_timeout: Option<u64>,
    fifo: VecDeque<u8>,
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
            rx: None,
            rx_on: false,
            rx_timeout: None,
            fifo: VecDeque::new(),
        }
    }
}

impl Uarte {
    /// PCLK16M ticks that `bytes` bytes take: BAUDRATE is the rate in 2^-32 of PCLK16M.
    fn ticks(&self, bytes: u64) -> u64 {
        let parity = u64::from(self.config >> 1 & 0b111 == 0b111);
        let stop = 1 + u64::from(self.config >> 4 & 1);
        let bits = bytes * (9 + parity + stop);
        ((u128::from(bits) << 32) / u128::from(self.baudrate.max(1))) as u64
    }

    fn fetch(&mut self, cx: &mut Cx<'_>) {
        let Some(tx) = self.tx else { return };
        let address = tx.at.wrapping_add(tx.done);
        if in_data_ram(address) {
            let id = cx.id;
            cx.act(Act::Read { id, token: 0, address, bytes: 1 });
        } else {
            self.byte = 0;
            cx.misuse("EasyDMA reads outside data RAM, at", address);
        }
        self.tx_next = Some(cx.clocks.hf.instant(self.tx_from + self.ticks(self.tx_sent + 1)));
    }

    fn start_rx(&mut self, cx: &mut Cx<'_>) {
        self.rx = Some(Buffer { at: self.rxd[0], len: self.rxd[1], done: 0 });
        (self.rx_on, self.rx_timeout) = (true, None);
        self.block.raise(RXSTARTED, cx);
        self.drain(cx);
    }

    fn stop_rx(&mut self, cx: &Cx<'_>) {
        if self.rx_on {
            self.rx_timeout = Some(cx.clocks.hf.instant(cx.hf() + self.ticks(RX_TIMEOUT_BYTES)));
        }
    }

    /// From the FIFO into the buffer, as far as both go.
    fn drain(&mut self, cx: &mut Cx<'_>) {
        while let Some(rx) = &mut self.rx {
            if rx.done >= rx.len {
                self.end_rx(cx);
                return;
            }
            let Some(byte) = self.fifo.pop_front() else { return };
            let address = rx.at.wrapping_add(rx.done);
            rx.done += 1;
            if in_data_ram(address) {
                cx.act(Act::Write { address, value: byte });
            } else {
                cx.misuse("EasyDMA writes outside data RAM, at", address);
            }
        }
    }

    fn end_rx(&mut self, cx: &mut Cx<'_>) {
        let Some(rx) = self.finish_rx(cx) else { return };
        if self.block.short(ENDRX_STARTRX) && rx.len != 0 {
            self.start_rx(cx);
        }
        if self.block.short(ENDRX_STOPRX) {
            self.stop_rx(cx);
        }
    }

    /// Hands the buffer over.
    fn finish_rx(&mut self, cx: &mut Cx<'_>) -> Option<Buffer> {
        let rx = self.rx.take()?;
        self.rxd[2] = rx.done;
        self.block.raise(ENDRX, cx);
        Some(rx)
    }

    /// A byte arrived.
    pub(crate) fn receive(&mut self, byte: u8, cx: &mut Cx<'_>) {
        if self.enable != ENABLED || !self.rx_on {
            return;
        }
        if self.fifo.len() == FIFO {
            self.errorsrc |= 1;
            self.block.raise(ERROR, cx);
            return;
        }
        self.fifo.push_back(byte);
        self.block.raise(RXDRDY, cx);
        self.drain(cx);
    }

    fn stop_tx(&mut self, cx: &mut Cx<'_>) {
        (self.tx_next, self.tx_stopping) = (None, false);
        if let Some(tx) = self.tx.take() {
            self.txd[2] = tx.done;
            self.block.raise(ENDTX, cx);
        }
        self.block.raise(TXSTOPPED, cx);
    }
}

impl Instance for Uarte {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        if self.enable != ENABLED && matches!(offset, 0x000 | 0x008) {
            cx.misuse("started while it is not enabled; ENABLE", self.enable);
            return true;
        }
        match offset {
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
                if self.tx.is_some() {
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
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x480 => self.errorsrc,
            0x500 => self.enable,
            0x508..=0x514 => self.psel[(offset as usize - 0x508) / 4],
            0x524 => self.baudrate,
            0x534..=0x53C => self.rxd[(offset as usize - 0x534) / 4],
            0x544..=0x54C => self.txd[(offset as usize - 0x544) / 4],
            0x56C => self.config,
            _ => return None,
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x480 => self.errorsrc &= !value,
            0x500 => {
                let enable = value & 0xF;
                if enable == 4 {
                    cx.unmodelled("legacy UART enabled", value);
                }
                if enable != ENABLED {
                    (self.tx, self.tx_next, self.rx, self.rx_on, self.rx_timeout) = (None, None, None, false, None);
                    self.fifo.clear();
                }
                self.enable = enable;
            }
            0x508..=0x514 => self.psel[(offset as usize - 0x508) / 4] = value,
            0x524 => self.baudrate = value,
            0x534 | 0x538 => {
                self.rxd[(offset as usize - 0x534) / 4] = if offset == 0x538 { value & 0xFFFF } else { value }
            }
            0x544 | 0x548 => {
                self.txd[(offset as usize - 0x544) / 4] = if offset == 0x548 { value & 0xFFFF } else { value }
            }
            0x53C | 0x54C => {}
            0x56C => {
                if value & 1 != 0 {
                    cx.unmodelled("hardware flow control: CTS is taken as always asserted", value);
                }
                self.config = value & 0x1F;
            }
            _ => return false,
        }
        true
    }

    fn configured(&mut self, cx: &mut Cx<'_>) {
        if self.tx_next.is_some() {
            self.tx_next = Some(cx.clocks.hf.instant(self.tx_from + self.ticks(self.tx_sent + 1)));
        }
    }

    fn next(&self) -> Option<u64> {
        [self.tx_next, self.rx_timeout].into_iter().flatten().min()
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        let now = cx.now;
        if self.tx_next.take_if(|at| *at <= now).is_some()
            && let Some(tx) = &mut self.tx
        {
            tx.done += 1;
            self.tx_sent += 1;
            let (id, byte, over, done) = (cx.id, self.byte, tx.done == tx.len, tx.done);
            cx.act(Act::Sent { id, byte });
            self.block.raise(TXDRDY, cx);
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
        }
        if self.rx_timeout.take_if(|at| *at <= now).is_some() {
            self.rx_on = false;
            if self.rx.is_some() {
                // Its shortcuts do not start again what was told to stop.
                self.finish_rx(cx);
            }
            self.block.raise(RXTO, cx);
        }
    }

    fn answer(&mut self, _: u32, value: u32, _: &mut Cx<'_>) {
        self.byte = value as u8;
    }
}
