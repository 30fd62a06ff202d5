//! SPIM and SPIS: the shared serial blocks, SPIM0–3 and SPIS0–2 (PS 6.25, 6.26).
//!
//! SPIM*n*, SPIS*n*, TWIM*n* and the rest of one number are one block with one set of registers; ENABLE says which of
//! them it is. TWIM is in [`crate::twim`], TWIS in [`crate::twis`].
//!
//! | covered, SPIM | PS 6.25 |
//! |---|---|
//! | START, STOP, SUSPEND, RESUME; STARTED, STOPPED, ENDRX, ENDTX, END; END_START | |
//! | EasyDMA with MAXCNT, AMOUNT and LIST, its pointers taken at START | 6.25, 4.6 |
//! | FREQUENCY to 8 MHz (SPIM3: 32 MHz), CONFIG mode and bit order, ORC | |
//! | each byte crosses at its own last edge, on the pins of PSEL; its reception is in RAM at that instant | |
//! | CSN driven by SPIM3 with CSNPOL | |
//!
//! | covered, SPIS | PS 6.26 |
//! |---|---|
//! | the semaphore with its four states, arbitrated when CSN falls | 6.26 |
//! | ACQUIRE at once where it is free or the CPU's; at the end of the transaction where it is not | |
//! | END and ACQUIRED raised together with END_ACQUIRE | |
//! | DEF through a transaction that was not granted, ORC and OVERREAD past TXD, OVERFLOW past RXD, ENDRX | |
//! | reported: CSN to SCK under 1 µs, bytes faster than 8 MHz, another mode than the controller's | 6.26 |
//!
//! The PS wants SCK, MOSI and CSN of SPIM as outputs and MISO as an input (6.25, *Pin configuration*), and all four
//! pins of SPIS as inputs (6.26): "to ensure correct behavior". Here an output pin of SPIM that GPIO does not have as
//! one carries nothing, and an input whose buffer is disconnected reads 0; both are reported.
//!
//! A controller that clocks an SPIS in another mode than its own (assumed, the PS has nothing on it): where both
//! sample on the same edge (modes 0 and 3, 1 and 2), what it sends arrives as it was, and what it reads comes one bit
//! late, because the first edge finds nothing shifted out yet. Where they sample on opposite edges, both come one bit
//! late. The bit before the first is 0.
//!
//! | left out | why |
//! |---|---|
//! | legacy SPI and TWI | reported when enabled |
//! | IFTIMING, DCX, STALLSTAT | registers only: nothing here stalls, and no display hangs on SPIM3 |
//! | bits within a byte on the pins | the outside exchanges bytes |
//! | EasyDMA outside data RAM | the part may fault (PS 4.6); here TXD reads ORC, RXD is dropped: reported |
//!
//! A transaction starts [`START_LATENCY`] after START (PS 6.25, tSPIM,START).
use crate::clocks::{CYCLES_PER_TICK, Clocks, cycles};
use crate::instance::{Act, Block, Cx, Instance, address_of};
use crate::pin::Pin;
use crate::twim::TwoWire;
use crate::twis::Target;
use crate::{SpisEvent, SsiWires};
use bench_seam::{Cycle, I2cAnswer, I2cEvent, SpiMode};

/// Events by number.
const STOPPED: u32 = 1;
const ENDRX: u32 = 4;
const SPIM_END: u32 = 6;
const ENDTX: u32 = 8;
const STARTED: u32 = 19;
const SPIS_END: u32 = 1;
const ACQUIRED: u32 = 10;

/// Shortcuts.
const END_START: u32 = 17;
const END_ACQUIRE: u32 = 2;

/// ENABLE.
const SPIM: u32 = 7;
const SPIS: u32 = 2;
const TWIM: u32 = 6;
const TWIS: u32 = 9;

/// From START to the first edge of SCK, in PCLK16M ticks: 1 µs.
const START_LATENCY: u64 = 16;

/// SPIS: from CSN to the first edge of SCK (tSPIS,SUCSN), and the shortest byte, 8 bits at 8 MHz, in cycles.
const CSN_SETUP: u64 = cycles(1_000);
const SHORTEST_BYTE: u64 = cycles(1_000);
/// How much earlier than that is not told, in cycles: clocks differ by their crystals' errors, and instants are
/// rounded to a cycle.
const SLACK: u64 = cycles(100);

/// MAXCNT is 16 bits wide in every instance of the part.
const MAXCNT_MASK: u32 = 0xFFFF;

/// Who has the semaphore, as SEMSTAT reads it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Semaphore {
    Free = 0,
    Cpu = 1,
    Spis = 2,
    CpuPending = 3,
}

/// One EasyDMA channel.
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

    /// The buffer as it is when a transfer takes it, and where the next one starts with LIST.
    pub(crate) fn take(&mut self) -> Buffer {
        let buffer = Buffer { at: self.ptr, len: self.maxcnt, done: 0 };
        if self.list & 0b111 == 1 {
            self.ptr = self.ptr.wrapping_add(self.maxcnt);
        }
        buffer
    }
}

/// A buffer a transfer works through.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Buffer {
    at: u32,
    pub(crate) len: u32,
    pub(crate) done: u32,
}

impl Buffer {
    /// The address of the next byte, while there is one.
    #[inline]
    pub(crate) fn next(&self) -> Option<u32> {
        (self.done < self.len).then(|| self.at.wrapping_add(self.done))
    }
}

/// Puts `byte` where `rx` wants it; `false` past its end.
#[inline]
fn receive(rx: &mut Buffer, byte: u8, cx: &mut Cx<'_>) -> bool {
    let Some(address) = rx.next() else {
        return false;
    };
    cx.dma_write(address, byte);
    rx.done += 1;
    true
}

/// The next byte of `tx`; `None` where EasyDMA gets none.
#[inline]
fn fetch(tx: &Buffer, cx: &mut Cx<'_>) -> Option<u8> {
    tx.next().and_then(|address| cx.dma_read(address))
}

/// Where a controller's lines are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wires {
    pub(crate) sck: Option<Pin>,
    pub(crate) mosi: Option<Pin>,
    pub(crate) miso: Option<Pin>,
    pub(crate) mode: SpiMode,
}

/// Polarity and phase as CONFIG has them: CPHA in bit 1, CPOL in bit 2.
#[inline]
pub(crate) const fn mode(config: u32) -> SpiMode {
    match config >> 1 & 3 {
        0 => SpiMode::Mode0,
        1 => SpiMode::Mode1,
        2 => SpiMode::Mode2,
        _ => SpiMode::Mode3,
    }
}

/// How what crosses between two ends in their modes is shifted: what the peripheral hears, what it says.
const fn late(one: SpiMode, other: SpiMode) -> (bool, bool) {
    use SpiMode::{Mode0, Mode1, Mode2, Mode3};
    match (one, other) {
        (Mode0, Mode0) | (Mode1, Mode1) | (Mode2, Mode2) | (Mode3, Mode3) => (false, false),
        (Mode0, Mode3) | (Mode3, Mode0) | (Mode1, Mode2) | (Mode2, Mode1) => (false, true),
        _ => (true, true),
    }
}

/// A transfer of the controller.
#[derive(Debug, Clone, Copy)]
struct Transfer {
    tx: Buffer,
    rx: Buffer,
    /// The byte on its way, and the tick at which its last edge is.
    byte: u8,
    ends: u64,
    stopping: bool,
}

/// A transaction of the peripheral.
#[derive(Debug, Clone, Copy)]
struct Transaction {
    granted: bool,
    tx: Buffer,
    rx: Buffer,
    /// What EasyDMA has ready for the next byte.
    ready: Option<u8>,
    /// CSN's fall and the last byte's end.
    since: Cycle,
    last: Option<Cycle>,
    /// The last byte each way, for a controller in another mode.
    heard: u8,
    said: u8,
}

/// One block.
#[derive(Clone, Debug)]
pub(crate) struct Serial {
    block: Block,
    /// SPIM0–2 share with SPIS and end at 8 MHz; SPIM3 stands alone and reaches 32.
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
    /// IFTIMING.RXDELAY, IFTIMING.CSNDUR, PSELDCX, DCXCNT, STALLSTAT.
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

    // ---- SPIM

    pub(crate) fn wires(&self) -> Wires {
        let pin = |n: usize| Pin::selected(self.psel[n]);
        Wires { sck: pin(0), mosi: pin(1), miso: pin(2), mode: mode(self.config) }
    }

    /// PCLK16M ticks of one byte, or `None` for a FREQUENCY that is none.
    fn byte_ticks(&self) -> Option<u64> {
        Some(match self.frequency {
            0x0200_0000 => 1024,
            0x0400_0000 => 512,
            0x0800_0000 => 256,
            0x1000_0000 => 128,
            0x2000_0000 => 64,
            0x4000_0000 => 32,
            0x8000_0000 => 16,
            0x0A00_0000 if !self.shared => 8,
            0x1400_0000 if !self.shared => 4,
            _ => return None,
        })
    }

    /// A byte in the order it travels, most significant bit first.
    fn on_the_wire(&self, byte: u8) -> u8 {
        if self.config & 1 == 0 { byte } else { byte.reverse_bits() }
    }

    fn start(&mut self, cx: &mut Cx<'_>) {
        if self.enable != SPIM {
            cx.misuse("START while SPIM is not enabled; ENABLE", self.enable);
            return;
        }
        if self.transfer.is_some() {
            cx.misuse("START during a transfer", 0);
            return;
        }
        if self.byte_ticks().is_none() {
            cx.misuse("a FREQUENCY that this instance does not have", self.frequency);
            return;
        }
        if !self.shared {
            cx.anomaly("anomaly 198: SPIM3 may send wrong data while the CPU uses the same RAM block", 0);
            self.chip_select(true, cx);
        }
        self.transfer = Some(Transfer {
            tx: self.txd.take(),
            rx: self.rxd.take(),
            byte: 0,
            ends: cx.hf() + START_LATENCY,
            stopping: false,
        });
        if self.suspended {
            cx.misuse("START after SUSPEND: nothing moves until RESUME", 0);
        }
        self.block.raise(STARTED, cx);
        self.next_byte(cx);
    }

    /// The pin SPIM3 selects its chip with, where it has one.
    fn chip_select(&mut self, active: bool, cx: &mut Cx<'_>) {
        if let Some(pin) = Pin::selected(self.psel[3]) {
            let level = active == (self.csnpol & 1 != 0);
            self.drive_select(pin, Some(level), cx);
        }
    }

    fn drive_select(&self, pin: Pin, level: Option<bool>, cx: &mut Cx<'_>) {
        if level.is_some() && !cx.pins.is_output(pin) {
            cx.misuse("CSN of SPIM is no output, pin", pin.index() as u32);
            return;
        }
        cx.act(Act::Hold { pin, level });
    }

    /// Sets out the next byte from the end of the last, or ends the transfer.
    fn next_byte(&mut self, cx: &mut Cx<'_>) {
        self.next = None;
        let Some(transfer) = &mut self.transfer else {
            return;
        };
        let over = transfer.tx.next().is_none() && transfer.rx.next().is_none();
        if over || transfer.stopping {
            self.end(!over, cx);
        } else if !self.suspended {
            transfer.byte = fetch(&transfer.tx, cx).unwrap_or(self.orc as u8);
            self.arm(cx);
        }
    }

    fn arm(&mut self, cx: &Cx<'_>) {
        self.next = match (self.transfer, self.byte_ticks()) {
            (Some(transfer), Some(ticks)) => Some(cx.clocks.hf.instant(transfer.ends + ticks)),
            _ => None,
        };
    }

    /// The transfer is over, or was stopped. Stopped early, ENDRX and ENDTX come all the same (PS 6.25).
    fn end(&mut self, stopped: bool, cx: &mut Cx<'_>) {
        let Some(transfer) = self.transfer.take() else {
            return;
        };
        (self.rxd.amount, self.txd.amount) = (transfer.rx.done, transfer.tx.done);
        for (buffer, event) in [(transfer.tx, ENDTX), (transfer.rx, ENDRX)] {
            // A buffer that was full said so as its last byte crossed; an empty one has its end here.
            if buffer.done < buffer.len || buffer.len == 0 {
                self.block.raise(event, cx);
            }
        }
        if !self.shared {
            self.chip_select(false, cx);
        }
        if stopped || transfer.stopping {
            self.block.raise(STOPPED, cx);
        }
        if !stopped {
            self.block.raise(SPIM_END, cx);
            if self.block.short(END_START) && !transfer.stopping {
                let start = address_of(cx.id) + 0x010;
                cx.act(Act::Task(start));
            }
        }
    }

    /// The byte under way has crossed, and `miso` came back.
    pub(crate) fn exchanged(&mut self, miso: u8, cx: &mut Cx<'_>) {
        let byte = self.on_the_wire(miso);
        let ticks = self.byte_ticks().unwrap_or(0);
        let Some(transfer) = &mut self.transfer else {
            return;
        };
        transfer.ends += ticks;
        let sent = transfer.tx.next().is_some();
        transfer.tx.done += u32::from(sent);
        let received = receive(&mut transfer.rx, byte, cx);
        let (tx, rx) = (transfer.tx, transfer.rx);
        if sent && tx.next().is_none() {
            self.block.raise(ENDTX, cx);
        }
        if received && rx.next().is_none() {
            self.block.raise(ENDRX, cx);
        }
        self.next_byte(cx);
    }

    // ---- SPIS

    /// The pin that selects this block as a peripheral, where it is one.
    pub(crate) fn csn(&self) -> Option<Pin> {
        (self.enable == SPIS).then(|| Pin::selected(self.psel[3])).flatten()
    }

    pub(crate) fn selected(&self) -> bool {
        self.transaction.is_some()
    }

    /// How many bytes may be clocked before an event: ENDRX comes with the last that RXD takes.
    pub(crate) fn quiet(&self) -> usize {
        match &self.transaction {
            Some(transaction) if transaction.granted && transaction.rx.next().is_some() => {
                (transaction.rx.len - transaction.rx.done) as usize
            }
            _ => usize::MAX,
        }
    }

    fn say(&self, event: SpisEvent, cx: &mut Cx<'_>) {
        let id = cx.id;
        cx.act(Act::Spis { id, event });
    }

    /// SCK, MOSI, MISO, CSN of an SPIS, whose selectors stand in another order than an SPIM's: SCK, MISO, MOSI, CSN (PS
    /// 6.25.6 and 6.26.6, *Registers*).
    fn spis_pins(&self) -> [Option<Pin>; 4] {
        let [sck, miso, mosi, csn] = self.psel.map(Pin::selected);
        [sck, mosi, miso, csn]
    }

    /// CSN moved: the semaphore is arbitrated when it falls, and given back when it rises.
    pub(crate) fn csn_moved(&mut self, level: bool, cx: &mut Cx<'_>) {
        if level {
            self.finish(cx);
            return;
        }
        if self.transaction.is_some() {
            return;
        }
        let pins = cx.pins;
        let [sck, mosi, _, csn] = self.spis_pins();
        for pin in [sck, mosi, csn].into_iter().flatten() {
            if !pins.is_connected(pin) {
                cx.misuse("SCK, MOSI or CSN of SPIS is no connected input, pin", pin.index() as u32);
            }
        }
        if self.csn().is_none_or(|csn| !pins.is_connected(csn)) {
            return;
        }
        let granted = self.semaphore == Semaphore::Free;
        let mut transaction = Transaction {
            granted,
            tx: Buffer::default(),
            rx: Buffer::default(),
            ready: None,
            since: cx.now,
            last: None,
            heard: 0,
            said: 0,
        };
        if granted {
            self.semaphore = Semaphore::Spis;
            (transaction.tx, transaction.rx) = (self.txd.take(), self.rxd.take());
        } else {
            self.say(SpisEvent::Busy, cx);
        }
        self.transaction = Some(transaction);
        self.fetch_ready(cx);
    }

    fn fetch_ready(&mut self, cx: &mut Cx<'_>) {
        if let Some(transaction) = &mut self.transaction {
            transaction.ready = fetch(&transaction.tx, cx);
        }
    }

    /// The controller at the far end of `wires` clocked one byte in `controller`'s mode: what its MISO carried
    /// meanwhile, `None` where this block does not drive it.
    pub(crate) fn clock(&mut self, wires: &SsiWires, mosi: u8, controller: SpiMode, cx: &mut Cx<'_>) -> Option<u8> {
        let [sck, mosi_pin, miso, _] = self.spis_pins();
        let is = |pin: Option<Pin>, wire| pin.is_some_and(|pin| pin.named() == wire);
        let drives = is(miso, wires.miso);
        let pins = cx.pins;
        if !is(sck, wires.sck) || !sck.is_some_and(|pin| pins.is_connected(pin)) {
            cx.misuse("the controller's SCK does not reach this SPIS; PSEL.SCK", self.psel[0]);
            return drives.then_some(0);
        }
        let mosi = if is(mosi_pin, wires.mosi) {
            mosi * u8::from(mosi_pin.is_some_and(|pin| pins.is_connected(pin)))
        } else {
            0xFF * u8::from(mosi_pin.is_some_and(|pin| pins.input(pin)))
        };
        let (mut mosi, own) = (mosi, mode(self.config));
        if own != controller {
            cx.misuse("the controller clocks in another SPI mode; CONFIG", self.config);
        }
        let (hears_late, says_late) = late(own, controller);
        if let Some(transaction) = self.transaction.as_mut().filter(|_| hears_late) {
            let last = std::mem::replace(&mut transaction.heard, mosi);
            mosi = mosi >> 1 | last << 7;
        }
        let mut miso = self.exchange(mosi, cx);
        if let Some(transaction) = self.transaction.as_mut().filter(|_| says_late) {
            let last = std::mem::replace(&mut transaction.said, miso);
            miso = miso >> 1 | last << 7;
        }
        drives.then_some(miso)
    }

    /// A byte crosses, as it travels.
    fn exchange(&mut self, mosi: u8, cx: &mut Cx<'_>) -> u8 {
        let heard = self.on_the_wire(mosi);
        let Some(transaction) = &mut self.transaction else {
            return 0xFF;
        };
        let earliest = transaction.last.unwrap_or(transaction.since + CSN_SETUP) + SHORTEST_BYTE;
        if cx.now + SLACK < earliest {
            let what = if transaction.last.is_none() {
                "the controller clocks less than 1 us after CSN, early by ns"
            } else {
                "the controller clocks faster than 8 MHz, early by ns"
            };
            cx.misuse(what, (earliest - cx.now) as u32);
        }
        transaction.last = Some(cx.now);
        if !transaction.granted {
            let def = self.def as u8;
            return self.on_the_wire(def);
        }
        let said = match (transaction.tx.next(), transaction.ready) {
            (Some(_), Some(byte)) => {
                transaction.tx.done += 1;
                byte
            }
            // Past the end of TXD, or from where EasyDMA does not reach.
            (left, _) => {
                transaction.tx.done += u32::from(left.is_some());
                if left.is_none() {
                    self.status |= 1;
                }
                self.orc as u8
            }
        };
        if receive(&mut transaction.rx, heard, cx) {
            if transaction.rx.next().is_none() {
                self.block.raise(ENDRX, cx);
            }
        } else {
            self.status |= 1 << 1;
        }
        self.fetch_ready(cx);
        self.on_the_wire(said)
    }

    /// CSN rose.
    fn finish(&mut self, cx: &mut Cx<'_>) {
        let Some(transaction) = self.transaction.take() else {
            return;
        };
        if !transaction.granted {
            if self.semaphore == Semaphore::Free {
                self.say(SpisEvent::Ready, cx);
            }
            return;
        }
        let pending = self.semaphore == Semaphore::CpuPending;
        self.semaphore = Semaphore::Free;
        (self.rxd.amount, self.txd.amount) = (transaction.rx.done, transaction.tx.done);
        self.block.raise(SPIS_END, cx);
        self.say(SpisEvent::End { rx: self.rxd.amount, tx: self.txd.amount }, cx);
        if pending || self.block.short(END_ACQUIRE) {
            self.acquire(cx);
        } else {
            self.say(SpisEvent::Ready, cx);
        }
    }

    fn acquire(&mut self, cx: &mut Cx<'_>) {
        match self.semaphore {
            Semaphore::Free => {
                self.semaphore = Semaphore::Cpu;
                self.say(SpisEvent::Held, cx);
                self.block.raise(ACQUIRED, cx);
            }
            Semaphore::Cpu => self.block.raise(ACQUIRED, cx),
            Semaphore::Spis => self.semaphore = Semaphore::CpuPending,
            Semaphore::CpuPending => {}
        }
    }

    fn release(&mut self, cx: &mut Cx<'_>) {
        match self.semaphore {
            Semaphore::Cpu => {
                self.semaphore = Semaphore::Free;
                self.say(SpisEvent::Released, cx);
                if self.transaction.is_none() {
                    self.say(SpisEvent::Ready, cx);
                }
            }
            // A pending acquire is taken back.
            Semaphore::CpuPending => self.semaphore = Semaphore::Spis,
            Semaphore::Free | Semaphore::Spis => {}
        }
    }

    /// Writes to what the SPIS transfers with are safe only while the CPU has the semaphore.
    fn guard(&self, offset: u32, cx: &mut Cx<'_>) {
        if self.enable == SPIS && !matches!(self.semaphore, Semaphore::Cpu) {
            cx.misuse("a buffer register written without the semaphore, at offset", offset);
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
            // It stands until RESUME, also between transfers.
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
            // Stalls never happen; SEMSTAT is read-only.
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
                    // Enabled anew, an SPIS is the CPU's (SEMSTAT's reset value).
                    self.semaphore = Semaphore::Cpu;
                    if let Some(pin) = Pin::selected(self.psel[3]).filter(|_| !self.shared) {
                        // SPIM3's select rests inactive while it is enabled, and is given back with it.
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

    /// The last edge of the byte under way.
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

    /// Whether the block is a TWIS on these pins.
    pub(crate) fn is_target_on(&self, scl: Pin, sda: Pin) -> bool {
        self.enable == TWIS && self.two_wire_pins() == [Some(scl), Some(sda)]
    }

    /// A controller acts on the bus that a TWIS hears. `None` while it holds SCL low.
    pub(crate) fn target_heard(&mut self, event: I2cEvent, cx: &mut Cx<'_>) -> Option<I2cAnswer> {
        let channels = [&mut self.rxd, &mut self.txd];
        self.target.heard(event, self.orc as u8, &mut self.block, channels, cx)
    }

    /// The pins of a TWIM or TWIS: PSEL.SCL and PSEL.SDA.
    pub(crate) fn two_wire_pins(&self) -> [Option<Pin>; 2] {
        [Pin::selected(self.psel[0]), Pin::selected(self.psel[1])]
    }

    /// The bus answered what a TWIM did.
    pub(crate) fn two_wire_answer(&mut self, answer: I2cAnswer, cx: &mut Cx<'_>) {
        let (rx, tx) = (&mut self.rxd, &mut self.txd);
        self.two_wire.answer(answer, &mut self.block, rx, tx, cx);
    }
}
