//! The transmitter: buffers, CTS, the legacy TXD (PS 6.33, 6.34).

use super::*;

impl Uarte {
    pub(super) fn fetch(&mut self, cx: &mut Cx<'_>) {
        let Some(tx) = self.tx else { return };
        self.byte = cx.dma_read(tx.at.wrapping_add(tx.done)).unwrap_or(0);
        self.arm_tx(cx);
    }

    pub(super) fn arm_tx(&mut self, cx: &Cx<'_>) {
        self.tx_held = self.clear_to_send().is_some_and(|pin| cx.pins.input(pin));
        if self.tx_held {
            self.tx_next = None;
            return;
        }
        self.tx_next = Some(cx.clocks.hf.instant(self.tx_from + self.ticks(self.tx_sent + 1)));
    }

    /// Returns the pin of CTS (active low) if flow control uses it.
    pub(crate) fn clear_to_send(&self) -> Option<Pin> {
        let controls = self.config & 1 != 0 && matches!(self.enable, ENABLED | LEGACY);
        controls.then(|| Pin::selected(self.psel[2])).flatten()
    }

    /// Handles a change of CTS. A byte that CTS has delayed begins now.
    pub(crate) fn clear_to_send_moved(&mut self, level: bool, cx: &mut Cx<'_>) {
        self.block.raise(if level { NCTS } else { CTS }, cx);
        if !level && self.tx_held {
            (self.tx_from, self.tx_sent) = (cx.hf(), 0);
            self.arm_tx(cx);
        }
    }

    pub(super) fn sent(&mut self, cx: &mut Cx<'_>) {
        let bit_ps = (62_500 << 32) / u64::from(self.baudrate.max(1));
        let frame = UartFrame {
            data: u16::from(self.byte),
            bits: 8,
            parity: if self.has_parity() { UartParity::Even } else { UartParity::None },
            stop_halves: 2 + 2 * (self.config >> 4 & 1) as u8,
            bit_ps: (u128::from(bit_ps) * u128::from(period(cx.clocks)) / u128::from(CYCLE_PS << 16)) as u64,
        };
        match Pin::selected(self.psel[1]) {
            Some(pin) if cx.pins.is_output(pin) => cx.act(Act::Sent { pin, frame }),
            _ => cx.misuse("TXD is no output and carries nothing; PSEL.TXD", self.psel[1]),
        }
        self.block.raise(TXDRDY, cx);
    }

    pub(super) fn stop_tx(&mut self, cx: &mut Cx<'_>) {
        (self.tx_next, self.tx_stopping, self.tx_held) = (None, false, false);
        if let Some(tx) = self.tx.take() {
            self.txd[2] = tx.done;
            self.block.raise(ENDTX, cx);
        }
        self.block.raise(TXSTOPPED, cx);
    }

    pub(super) fn legacy_send(&mut self, byte: u8, cx: &mut Cx<'_>) {
        if !self.legacy_tx {
            cx.misuse("TXD written before STARTTX", u32::from(byte));
        } else if self.tx_next.is_none() && !self.tx_held {
            self.byte = byte;
            (self.tx_from, self.tx_sent) = (cx.hf(), 0);
            self.arm_tx(cx);
        } else if self.legacy_waiting.replace(byte).is_some() {
            cx.misuse("TXD written while a byte waits, which is lost", u32::from(byte));
        }
    }
}
