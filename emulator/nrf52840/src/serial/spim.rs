//! SPIM: the SPI controller (PS 6.25).
//!
//! | covered, SPIM | PS 6.25 |
//! |---|---|
//! | START, STOP, SUSPEND, RESUME; STARTED, STOPPED, ENDRX, ENDTX, END; END_START | |
//! | EasyDMA with MAXCNT, AMOUNT and LIST, its pointers taken at START | 6.25, 4.6 |
//! | FREQUENCY to 8 MHz (SPIM3: 32 MHz), CONFIG mode and bit order, ORC | |
//! | each byte crosses at its last edge on the pins of PSEL, and the received byte is in RAM at that instant | |
//! | CSN of SPIM3 with CSNPOL | |
//!
//! A transaction begins [`START_LATENCY`] after START (PS 6.25, tSPIM,START).

use super::*;

/// The PCLK16M ticks from START to the first edge of SCK: 1 µs.
const START_LATENCY: u64 = 16;

impl Serial {
    pub(crate) fn wires(&self) -> Wires {
        let pin = |n: usize| Pin::selected(self.psel[n]);
        Wires { sck: pin(0), mosi: pin(1), miso: pin(2), mode: mode(self.config) }
    }

    /// The PCLK16M ticks of a byte; `None` if FREQUENCY is invalid.
    pub(super) fn byte_ticks(&self) -> Option<u64> {
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

    /// Reverses the order of a byte's bits if needed, so that the first bit on the wire is the highest.
    pub(super) fn on_the_wire(&self, byte: u8) -> u8 {
        if self.config & 1 == 0 { byte } else { byte.reverse_bits() }
    }

    pub(super) fn start(&mut self, cx: &mut Cx<'_>) {
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

    fn chip_select(&mut self, active: bool, cx: &mut Cx<'_>) {
        if let Some(pin) = Pin::selected(self.psel[3]) {
            let level = active == (self.csnpol & 1 != 0);
            self.drive_select(pin, Some(level), cx);
        }
    }

    pub(super) fn drive_select(&self, pin: Pin, level: Option<bool>, cx: &mut Cx<'_>) {
        if level.is_some() && !cx.pins.is_output(pin) {
            cx.misuse("CSN of SPIM is no output, pin", pin.index() as u32);
            return;
        }
        cx.act(Act::Hold { pin, level });
    }

    pub(super) fn next_byte(&mut self, cx: &mut Cx<'_>) {
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

    /// Ends a transfer. ENDRX and ENDTX come even if it was stopped early (PS 6.25).
    fn end(&mut self, stopped: bool, cx: &mut Cx<'_>) {
        let Some(transfer) = self.transfer.take() else {
            return;
        };
        (self.rxd.amount, self.txd.amount) = (transfer.rx.done, transfer.tx.done);
        for (buffer, event) in [(transfer.tx, ENDTX), (transfer.rx, ENDRX)] {
            // A buffer that is full has raised its event at its last byte. Any other buffer raises its event now.
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

    /// Completes the present byte. `miso` is the byte that came back.
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
}
