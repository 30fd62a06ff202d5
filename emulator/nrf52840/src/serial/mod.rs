//! The shared serial blocks: SPIM0–3, SPIS0–2 and their relatives (PS 6.25, 6.26).
//!
//! SPIM, SPIS, TWIM, TWIS and the legacy peripherals with the same number are one block with one set of registers.
//! ENABLE selects one of them.
//!
//! | module | covers | PS |
//! |---|---|---|
//! | this one | the registers that all these peripherals share, the buffers of EasyDMA | 4.6 |
//! | `spim` | the SPI controller | 6.25 |
//! | `spis` | the SPI target with its semaphore | 6.26 |
//! | `twim`, `twis` | TWIM, TWIS | 6.31, 6.32 |
//!
//! The PS demands SCK, MOSI and CSN of SPIM as outputs and MISO as an input (6.25, *Pin configuration*), and all pins
//! of SPIS as inputs (6.26). In this model a pin that is no output carries no signal, and an input without its buffer
//! reads 0. Both are findings.
//!
//! | left out | why |
//! |---|---|
//! | legacy SPI and TWI | a finding when enabled |
//! | IFTIMING, DCX, STALLSTAT | they only store values: nothing stalls, and no display is wired to SPIM3 |
//! | bits within a byte on the pins | the outside exchanges bytes |
//! | EasyDMA outside data RAM | the part may fault (PS 4.6); here it is a finding: TXD reads ORC, RXD is dropped |

mod spim;
mod spis;
mod twim;
mod twis;

use crate::clocks::{CYCLES_PER_TICK, Clocks, cycles};
use crate::instance::{Act, Block, Cx, Instance, address_of};
use crate::pin::Pin;
use crate::{SpisEvent, SpisWires};
use emulator_part::{Cycle, I2cAnswer, I2cEvent, SpiMode};
use twim::TwoWire;
use twis::Target;

const STOPPED: u32 = 1;
const ENDRX: u32 = 4;
const SPIM_END: u32 = 6;
const ENDTX: u32 = 8;
const STARTED: u32 = 19;
const SPIS_END: u32 = 1;
const ACQUIRED: u32 = 10;

const END_START: u32 = 17;
const END_ACQUIRE: u32 = 2;

const SPIM: u32 = 7;
const SPIS: u32 = 2;
const TWIM: u32 = 6;
const TWIS: u32 = 9;

/// MAXCNT has 16 bits in every instance of this part.
const MAXCNT_MASK: u32 = 0xFFFF;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Semaphore {
    Free = 0,
    Cpu = 1,
    Spis = 2,
    CpuPending = 3,
}

#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Channel {
    ptr: u32,
    maxcnt: u32,
    pub(crate) amount: u32,
    list: u32,
}

impl Channel {
    fn read(&self, offset: u32) -> u32 {
        [self.ptr, self.maxcnt, self.amount, self.list][offset as usize / 4]
    }

    fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x0 => self.ptr = value,
            0x4 => self.maxcnt = value & MAXCNT_MASK,
            0xC => self.list = value & 0b111,
            _ => {}
        }
    }

    /// Takes the prepared buffer for a transfer. In list mode the pointer moves on to the next buffer.
    pub(crate) fn take(&mut self) -> Buffer {
        let buffer = Buffer { at: self.ptr, len: self.maxcnt, done: 0 };
        if self.list & 0b111 == 1 {
            self.ptr = self.ptr.wrapping_add(self.maxcnt);
        }
        buffer
    }
}

#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Buffer {
    at: u32,
    pub(crate) len: u32,
    pub(crate) done: u32,
}

impl Buffer {
    #[inline]
    pub(crate) fn next(&self) -> Option<u32> {
        (self.done < self.len).then(|| self.at.wrapping_add(self.done))
    }
}

#[inline]
fn receive(rx: &mut Buffer, byte: u8, cx: &mut Cx<'_>) -> bool {
    let Some(address) = rx.next() else {
        return false;
    };
    cx.dma_write(address, byte);
    rx.done += 1;
    true
}

/// Reads the next byte of `tx`. Returns `None` if EasyDMA reads nothing.
#[inline]
fn fetch(tx: &Buffer, cx: &mut Cx<'_>) -> Option<u8> {
    tx.next().and_then(|address| cx.dma_read(address))
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Wires {
    pub(crate) sck: Option<Pin>,
    pub(crate) mosi: Option<Pin>,
    pub(crate) miso: Option<Pin>,
    pub(crate) mode: SpiMode,
}

/// The SPI mode from CONFIG's CPHA (bit 1) and CPOL (bit 2).
#[inline]
pub(crate) const fn mode(config: u32) -> SpiMode {
    match config >> 1 & 3 {
        0 => SpiMode::Mode0,
        1 => SpiMode::Mode1,
        2 => SpiMode::Mode2,
        _ => SpiMode::Mode3,
    }
}

#[derive(Debug, Clone, Copy)]
struct Transfer {
    tx: Buffer,
    rx: Buffer,
    /// The byte that is being exchanged. It begins at the PCLK16M tick `ends`, at which the byte before it ended.
    byte: u8,
    ends: u64,
    stopping: bool,
}

#[derive(Debug, Clone, Copy)]
struct Transaction {
    granted: bool,
    tx: Buffer,
    rx: Buffer,
    /// The byte that will be sent next.
    ready: Option<u8>,
    /// The cycle at which CSN fell for the present transaction.
    since: Cycle,
    last: Option<Cycle>,
    /// The last byte that the target received. `said` is the last byte that it sent. Both matter for a controller in
    /// another SPI mode.
    heard: u8,
    said: u8,
}

#[derive(Clone, Debug)]
pub(crate) struct Serial {
    block: Block,
    /// Whether the block also has an SPIS and reaches only 8 MHz, as SPIM0–2 do. SPIM3 has a block of its own and
    /// reaches 32 MHz.
    shared: bool,
    enable: u32,
    psel: [u32; 4],
    frequency: u32,
    rxd: Channel,
    txd: Channel,
    config: u32,
    def: u32,
    orc: u32,
    csnpol: u32,
    plain: [u32; 5],
    transfer: Option<Transfer>,
    suspended: bool,
    next: Option<Cycle>,
    semaphore: Semaphore,
    status: u32,
    transaction: Option<Transaction>,
    two_wire: TwoWire,
    target: Target,
}

impl Serial {
    pub(crate) fn new(shared: bool) -> Self {
        Self {
            block: Block::default(),
            shared,
            enable: 0,
            psel: [u32::MAX; 4],
            frequency: 0x0400_0000,
            rxd: Channel::default(),
            txd: Channel::default(),
            config: 0,
            def: 0,
            orc: 0,
            csnpol: 0,
            plain: [2, 2, u32::MAX, 0, 0],
            transfer: None,
            suspended: false,
            next: None,
            semaphore: Semaphore::Cpu,
            status: 0,
            transaction: None,
            two_wire: TwoWire::default(),
            target: Target::default(),
        }
    }
}

impl Instance for Serial {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 | 0x008 | 0x01C | 0x020 if self.enable == TWIM && self.shared => self.two_wire_task(offset, cx),
            0x014 | 0x01C | 0x020 | 0x030 | 0x034 if self.enable == TWIS => {
                let (rx, tx) = (&mut self.rxd, &mut self.txd);
                self.target.task(offset, &mut self.block, rx, tx, cx);
            }
            0x030 | 0x034 if self.shared => {
                cx.misuse("PREPARERX or PREPARETX while TWIS is not enabled; ENABLE", self.enable);
            }
            0x010 => self.start(cx),
            0x014 => match &mut self.transfer {
                Some(transfer) => {
                    transfer.stopping = true;
                    if self.suspended {
                        self.suspended = false;
                        self.next_byte(cx);
                    }
                }
                None if self.enable == TWIM => self.two_wire_task(offset, cx),
                None if self.enable == SPIM => self.block.raise(STOPPED, cx),
                None => {}
            },
            // A suspension lasts until RESUME, even between transfers.
            0x01C => self.suspended = self.enable == SPIM,
            0x020 => {
                if self.suspended {
                    self.suspended = false;
                    if self.next.is_none() {
                        let tick = cx.hf();
                        if let Some(transfer) = &mut self.transfer {
                            transfer.ends = tick;
                        }
                        self.next_byte(cx);
                    }
                }
            }
            0x024 | 0x028 if self.shared => {
                if self.enable != SPIS {
                    cx.misuse("ACQUIRE or RELEASE while SPIS is not enabled; ENABLE", self.enable);
                } else if offset == 0x024 {
                    self.acquire(cx);
                } else {
                    self.release(cx);
                }
            }
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x400 if self.enable == SPIS => self.semaphore as u32,
            0x400 => self.plain[4],
            0x440 => self.status,
            0x500 => self.enable,
            0x508..=0x514 => self.psel[(offset as usize - 0x508) / 4],
            0x524 => self.frequency,
            0x534..=0x540 => self.rxd.read(offset - 0x534),
            0x544..=0x550 => self.txd.read(offset - 0x544),
            0x554 => self.config,
            0x55C => self.def,
            0x560 => self.plain[0],
            0x564 => self.plain[1],
            0x568 => self.csnpol,
            0x56C => self.plain[2],
            0x570 => self.plain[3],
            0x5C0 => self.orc,
            0x4C4 if self.shared => self.two_wire.read(offset),
            0x4D0 | 0x4D4 | 0x588 | 0x58C | 0x594 if self.shared => self.target.read(offset),
            _ => return None,
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        if matches!(offset, 0x508..=0x514 | 0x554) && self.enable != 0 && (self.transfer.is_some() || self.selected()) {
            cx.misuse("pins or mode written during a transfer, at offset", offset);
        }
        match offset {
            // Writes of STALLSTAT and SEMSTAT do nothing: the bus never stalls, and SEMSTAT is read-only.
            0x400 => {}
            0x440 => self.status &= !value,
            0x500 => {
                let enable = value & 0xF;
                match enable {
                    0 | SPIM => {}
                    SPIS | TWIM | TWIS if self.shared => {}
                    1 | 5 if self.shared => cx.unmodelled("legacy SPI or TWI enabled; ENABLE", value),
                    _ => cx.misuse("an ENABLE that no instance has", value),
                }
                if enable != self.enable {
                    if self.transfer.is_some() {
                        cx.misuse("disabled during a transfer", value);
                    }
                    (self.transfer, self.transaction, self.next) = (None, None, None);
                    self.suspended = false;
                    self.two_wire.stop();
                    self.target.stop();
                    // When an SPIS is enabled, the CPU holds its semaphore (SEMSTAT's reset value).
                    self.semaphore = Semaphore::Cpu;
                    if let Some(pin) = Pin::selected(self.psel[3]).filter(|_| !self.shared) {
                        // SPIM3's chip select is inactive between transfers, and returns to GPIO when SPIM3 is
                        // disabled.
                        let level = (enable == SPIM).then_some(self.csnpol & 1 == 0);
                        self.drive_select(pin, level, cx);
                    }
                }
                self.enable = enable;
            }
            0x508..=0x514 => self.psel[(offset as usize - 0x508) / 4] = value,
            0x524 => self.frequency = value,
            0x534..=0x540 => {
                self.guard(offset, cx);
                self.rxd.write(offset - 0x534, value);
            }
            0x544..=0x550 => {
                self.guard(offset, cx);
                self.txd.write(offset - 0x544, value);
            }
            0x554 => self.config = value & 0b111,
            0x55C => self.def = value & 0xFF,
            0x560 => self.plain[0] = value & 0b111,
            0x564 => self.plain[1] = value & 0xFF,
            0x568 => self.csnpol = value & 1,
            0x56C => self.plain[2] = value,
            0x570 => self.plain[3] = value & 0xF,
            0x5C0 => self.orc = value & 0xFF,
            0x4C4 if self.shared => self.two_wire.write(offset, value),
            0x588 if self.shared => {
                self.two_wire.write(offset, value);
                self.target.write(offset, value);
            }
            0x4D0 | 0x4D4 | 0x58C | 0x594 if self.shared => self.target.write(offset, value),
            _ => return false,
        }
        true
    }

    fn next(&self) -> Option<Cycle> {
        if self.enable == TWIM { self.two_wire.next() } else { self.next }
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        if self.enable == TWIM {
            self.two_wire.due(cx);
            return;
        }
        let Some(ends) = self.next.take() else {
            return;
        };
        if let Some(transfer) = self.transfer {
            let (id, mosi) = (cx.id, self.on_the_wire(transfer.byte));
            let begins = ends.saturating_sub(self.byte_ticks().unwrap_or(0) * CYCLES_PER_TICK);
            cx.act(Act::Exchange { id, mosi, begins });
        }
    }

    fn moves(&self) -> bool {
        self.transfer.is_some() || self.transaction.is_some()
    }
}

impl Serial {
    fn two_wire_task(&mut self, offset: u32, cx: &mut Cx<'_>) {
        let (rx, tx) = (&mut self.rxd, &mut self.txd);
        self.two_wire.task(offset, self.frequency, &mut self.block, rx, tx, cx);
    }

    pub(crate) fn is_target_on(&self, scl: Pin, sda: Pin) -> bool {
        self.enable == TWIS && self.two_wire_pins() == [Some(scl), Some(sda)]
    }

    /// Handles an action of a controller on a TWIS's bus. Returns `None` while the TWIS holds SCL low.
    pub(crate) fn target_heard(&mut self, event: I2cEvent, cx: &mut Cx<'_>) -> Option<I2cAnswer> {
        let channels = [&mut self.rxd, &mut self.txd];
        self.target.heard(event, self.orc as u8, &mut self.block, channels, cx)
    }

    pub(crate) fn two_wire_pins(&self) -> [Option<Pin>; 2] {
        [Pin::selected(self.psel[0]), Pin::selected(self.psel[1])]
    }

    pub(crate) fn two_wire_answer(&mut self, answer: I2cAnswer, cx: &mut Cx<'_>) {
        let (rx, tx) = (&mut self.rxd, &mut self.txd);
        self.two_wire.answer(answer, &mut self.block, rx, tx, cx);
    }
}
