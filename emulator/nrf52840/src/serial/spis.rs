//! SPIS: the SPI target (PS 6.26).
//!
//! | covered, SPIS | PS 6.26 |
//! |---|---|
//! | the semaphore with its four states, arbitrated when CSN falls | 6.26 |
//! | ACQUIRE at once if the semaphore is free or the CPU's, otherwise at the end of the transaction | |
//! | END and ACQUIRED raised together with END_ACQUIRE | |
//! | DEF in a transaction that was not granted; ORC and OVERREAD past TXD; OVERFLOW past RXD; ENDRX | |
//! | a CSN pulse without a clock: END with AMOUNT 0 if it was granted, nothing if it was not | 6.26.3 |
//! | reported as findings: CSN to SCK under 1 µs, bytes faster than 8 MHz, another mode than the controller's | 6.26 |
//!
//! The PS states no minimum number of clocks: the peripheral takes the semaphore when CSN falls, and a granted
//! transaction is complete when CSN rises. The PS does not say whether silicon misses a CSN that is low for less than
//! about 0.1 µs. Here every edge counts, which is the worse case for the processor.
//!
//! The PS does not say what happens if the controller uses another SPI mode than the SPIS. Assumed: if both sample on
//! the same edge (modes 0 and 3, 1 and 2), the SPIS receives correctly, and its own data comes one bit late, since
//! nothing is shifted out at the first edge. If they sample on opposite edges, the data of both comes one bit late. The
//! bit before the first is 0.

use super::*;
use crate::memory::Memory;

/// The least number of cycles from CSN to the first edge of SCK (tSPIS,SUCSN).
const CSN_SETUP: u64 = cycles(1_000);
const SHORTEST_BYTE: u64 = cycles(1_000);
/// A limit may be missed by this number of cycles without a finding. Clocks have errors, and instants are rounded to a
/// cycle.
const SLACK: u64 = cycles(100);

/// Returns two values for the SPI modes of controller and target: whether the data that the target receives come one
/// bit late, and whether the data that it sends do.
const fn late(one: SpiMode, other: SpiMode) -> (bool, bool) {
    use SpiMode::{Mode0, Mode1, Mode2, Mode3};
    match (one, other) {
        (Mode0, Mode0) | (Mode1, Mode1) | (Mode2, Mode2) | (Mode3, Mode3) => (false, false),
        (Mode0, Mode3) | (Mode3, Mode0) | (Mode1, Mode2) | (Mode2, Mode1) => (false, true),
        _ => (true, true),
    }
}

impl Serial {
    pub(crate) fn csn(&self) -> Option<Pin> {
        (self.enable == SPIS).then(|| Pin::selected(self.psel[3])).flatten()
    }

    pub(crate) fn selected(&self) -> bool {
        self.transaction.is_some()
    }

    /// Returns the number of bytes that may be clocked before the SPIS raises an event. ENDRX is raised at the last
    /// byte of RXD.
    pub(crate) fn quiet(&self) -> usize {
        match &self.transaction {
            Some(transaction) if transaction.granted && transaction.rx.next().is_some() => {
                (transaction.rx.len - transaction.rx.done) as usize
            }
            _ => usize::MAX,
        }
    }

    /// Returns the bytes that a transaction would read if it began now, up to the end of the buffer.
    pub(crate) fn offers(&self, memory: &Memory) -> Vec<u8> {
        memory.slice(self.txd.ptr, self.txd.maxcnt as usize).unwrap_or_default().to_vec()
    }

    fn say(&self, event: SpisEvent, cx: &mut Cx<'_>) {
        let id = cx.id;
        cx.act(Act::Spis { id, event });
    }

    /// The pins SCK, MOSI, MISO and CSN of an SPIS. Its PSEL registers have another order than an SPIM's: SCK, MISO,
    /// MOSI, CSN (PS 6.25.6 and 6.26.6, *Registers*).
    fn spis_pins(&self) -> [Option<Pin>; 4] {
        let [sck, miso, mosi, csn] = self.psel.map(Pin::selected);
        [sck, mosi, miso, csn]
    }

    /// Handles an edge of CSN. Its fall arbitrates the semaphore, and its rise ends the transaction.
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

    /// Clocks one byte from the controller on `wires`, which is in the mode `controller`. Returns the byte on MISO;
    /// `None` if this block does not drive it.
    pub(crate) fn clock(&mut self, wires: &SpisWires, mosi: u8, controller: SpiMode, cx: &mut Cx<'_>) -> Option<u8> {
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
            // The byte is past the end of TXD, or at an address that EasyDMA does not reach.
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

    pub(super) fn acquire(&mut self, cx: &mut Cx<'_>) {
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

    pub(super) fn release(&mut self, cx: &mut Cx<'_>) {
        match self.semaphore {
            Semaphore::Cpu => {
                self.semaphore = Semaphore::Free;
                self.say(SpisEvent::Released, cx);
                if self.transaction.is_none() {
                    self.say(SpisEvent::Ready, cx);
                }
            }
            // Releasing the semaphore cancels a pending acquire.
            Semaphore::CpuPending => self.semaphore = Semaphore::Spis,
            Semaphore::Free | Semaphore::Spis => {}
        }
    }

    /// Reports a write to a register of transfers, if the CPU does not hold the semaphore.
    pub(super) fn guard(&self, offset: u32, cx: &mut Cx<'_>) {
        if self.enable == SPIS && !matches!(self.semaphore, Semaphore::Cpu) {
            cx.misuse("a buffer register written without the semaphore, at offset", offset);
        }
    }
}
