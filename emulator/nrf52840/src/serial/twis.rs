//! TWIS: the two-wire targets TWIS0 and TWIS1 (PS 6.32).
//!
//! | covered | PS |
//! |---|---|
//! | two addresses with CONFIG and MATCH; READ and WRITE, WRITE_SUSPEND and READ_SUSPEND | 6.32 |
//! | PREPARERX, PREPARETX, SUSPEND, RESUME, STOP; RXSTARTED, TXSTARTED, STOPPED, ERROR | 6.32 |
//! | SCL held low after the address until a buffer is prepared, and while suspended | 6.32 |
//! | EasyDMA with MAXCNT, AMOUNT and LIST; ORC past TXD with OVERREAD, a NACK past RXD with OVERFLOW and DNACK | 6.32 |
//! | a stop, and a repeated start | 6.32 |
//!
//! The PS demands SCL and SDA as inputs with drive S0D1 (6.32, *Pin configuration*). Here a target whose input buffer
//! is disconnected does not react to the bus.
//!
//! | left out | why |
//! |---|---|
//! | bits within a byte on the pins | the outside exchanges bytes |
use super::{Buffer, Channel};
use crate::instance::{Block, Cx};
use emulator_part::{I2cAnswer, I2cEvent};

const STOPPED: u32 = 1;
const ERROR: u32 = 9;
const RXSTARTED: u32 = 19;
const TXSTARTED: u32 = 20;
const WRITE: u32 = 25;
const READ: u32 = 26;

const WRITE_SUSPEND: u32 = 13;
const READ_SUSPEND: u32 = 14;

const OVERFLOW: u32 = 1;
const DNACK: u32 = 1 << 2;
const OVERREAD: u32 = 1 << 3;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The controller addressed the target for a write (`false`) or a read. The target has no buffer yet.
    Waiting(bool),
    Receiving,
    Sending,
}

#[derive(Clone, Debug)]
pub(crate) struct Target {
    addresses: [u32; 2],
    config: u32,
    matched: u32,
    errorsrc: u32,
    rx_prepared: bool,
    tx_prepared: bool,
    suspended: bool,
    state: State,
    buffer: Buffer,
}

impl Default for Target {
    fn default() -> Self {
        Self {
            addresses: [0; 2],
            config: 1,
            matched: 0,
            errorsrc: 0,
            rx_prepared: false,
            tx_prepared: false,
            suspended: false,
            state: State::Idle,
            buffer: Buffer::default(),
        }
    }
}

impl Target {
    pub(crate) fn stop(&mut self) {
        (self.rx_prepared, self.tx_prepared, self.suspended, self.state) = (false, false, false, State::Idle);
    }

    pub(crate) fn read(&self, offset: u32) -> u32 {
        match offset {
            0x4D0 => self.errorsrc,
            0x4D4 => self.matched,
            0x588 => self.addresses[0],
            0x58C => self.addresses[1],
            _ => self.config,
        }
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x4D0 => self.errorsrc &= !value,
            0x588 => self.addresses[0] = value & 0x7F,
            0x58C => self.addresses[1] = value & 0x7F,
            0x594 => self.config = value & 0b11,
            _ => {}
        }
    }

    pub(crate) fn task(&mut self, offset: u32, block: &mut Block, rx: &mut Channel, tx: &mut Channel, cx: &mut Cx<'_>) {
        match offset {
            0x014 => {
                self.end(rx, tx);
                self.stop();
                block.raise(STOPPED, cx);
            }
            0x01C => self.suspended = true,
            0x020 => self.suspended = false,
            0x030 => self.rx_prepared = true,
            0x034 => self.tx_prepared = true,
            _ => {}
        }
        self.begin(block, rx, tx, cx);
    }

    /// Begins the transfer with the prepared buffer, and releases SCL.
    fn begin(&mut self, block: &mut Block, rx: &mut Channel, tx: &mut Channel, cx: &mut Cx<'_>) {
        match self.state {
            State::Waiting(false) if self.rx_prepared && !self.suspended => {
                (self.state, self.rx_prepared, self.buffer) = (State::Receiving, false, rx.take());
                rx.amount = 0;
                block.raise(RXSTARTED, cx);
            }
            State::Waiting(true) if self.tx_prepared && !self.suspended => {
                (self.state, self.tx_prepared, self.buffer) = (State::Sending, false, tx.take());
                tx.amount = 0;
                block.raise(TXSTARTED, cx);
            }
            _ => {}
        }
    }

    fn end(&mut self, rx: &mut Channel, tx: &mut Channel) {
        match self.state {
            State::Receiving => rx.amount = self.buffer.done,
            State::Sending => tx.amount = self.buffer.done,
            State::Idle | State::Waiting(_) => {}
        }
        self.state = State::Idle;
    }

    /// Handles an action of the controller. Returns `None` while SCL is held low.
    pub(crate) fn heard(
        &mut self,
        event: I2cEvent,
        orc: u8,
        block: &mut Block,
        [rx, tx]: [&mut Channel; 2],
        cx: &mut Cx<'_>,
    ) -> Option<I2cAnswer> {
        let answer = |acknowledged, data| Some(I2cAnswer { acknowledged, data, stretched_ns: 0 });
        if self.state != State::Idle && self.suspended {
            return None;
        }
        match (event, self.state) {
            (I2cEvent::Start(byte), _) => {
                self.end(rx, tx);
                let address = u32::from(byte >> 1);
                let matches = |&n: &usize| self.config >> n & 1 != 0 && self.addresses[n] == address;
                let Some(n) = (0..2).find(matches) else { return answer(false, 0xFF) };
                let reads = byte & 1 != 0;
                (self.matched, self.state) = (n as u32, State::Waiting(reads));
                block.raise(if reads { READ } else { WRITE }, cx);
                self.suspended = block.short(if reads { READ_SUSPEND } else { WRITE_SUSPEND });
                self.begin(block, rx, tx, cx);
                answer(true, 0xFF)
            }
            (_, State::Idle) => answer(false, 0xFF),
            (I2cEvent::Stop, _) => {
                self.end(rx, tx);
                block.raise(STOPPED, cx);
                answer(false, 0xFF)
            }
            (_, State::Waiting(_)) => None,
            (I2cEvent::Write(byte), State::Receiving) => match self.buffer.next() {
                Some(address) => {
                    cx.dma_write(address, byte);
                    self.buffer.done += 1;
                    rx.amount = self.buffer.done;
                    answer(true, 0xFF)
                }
                None => {
                    self.fail(OVERFLOW | DNACK, block, cx);
                    answer(false, 0xFF)
                }
            },
            (I2cEvent::Read(_), State::Sending) => match self.buffer.next() {
                Some(address) => {
                    let byte = cx.dma_read(address).unwrap_or(orc);
                    self.buffer.done += 1;
                    tx.amount = self.buffer.done;
                    answer(true, byte)
                }
                None => {
                    self.fail(OVERREAD, block, cx);
                    answer(true, orc)
                }
            },
            // The controller's action is against the transfer's direction, so nobody drives SDA.
            (I2cEvent::Write(_) | I2cEvent::Read(_), State::Receiving | State::Sending) => answer(false, 0xFF),
        }
    }

    fn fail(&mut self, why: u32, block: &mut Block, cx: &mut Cx<'_>) {
        self.errorsrc |= why;
        block.raise(ERROR, cx);
    }
}
