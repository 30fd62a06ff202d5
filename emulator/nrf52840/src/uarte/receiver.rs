//! The receiver: sampling, FIFO, errors; and the levels of RTS and TXD (PS 6.33, 6.34).

use super::*;

impl Uarte {
    /// Drives RTS (active low), which depends on the room in the FIFO, and TXD, which is high between frames.
    pub(super) fn drive_pins(&mut self, cx: &mut Cx<'_>) {
        let enabled = matches!(self.enable, ENABLED | LEGACY);
        let controls = enabled && self.config & 1 != 0;
        let ready = self.rx_on && self.rx_timeout.is_none() && self.fifo.len() + ROOM < FIFO;
        for (nth, (active, level)) in [(controls, !ready), (enabled, true)].into_iter().enumerate() {
            let pin = Pin::selected(self.psel[nth]).filter(|&pin| active && cx.pins.is_output(pin));
            let drives = pin.map(|pin| (pin, level));
            let was = std::mem::replace(&mut self.driven[nth], drives);
            if drives == was {
                continue;
            }
            if let Some((was, _)) = was.filter(|&(was, _)| Some(was) != pin) {
                cx.act(Act::Hold { pin: was, level: None });
            }
            if let Some(pin) = pin {
                cx.act(Act::Hold { pin, level: Some(level) });
            }
        }
    }

    pub(super) fn receiver_on(&mut self, cx: &Cx<'_>) {
        if !self.rx_on {
            self.rx_since = cx.now;
        }
        (self.rx_on, self.rx_timeout) = (true, None);
    }

    pub(super) fn start_rx(&mut self, cx: &mut Cx<'_>) {
        self.rx = Some(Buffer { at: self.rxd[0], len: self.rxd[1], done: 0 });
        self.receiver_on(cx);
        self.block.raise(RXSTARTED, cx);
        self.drain(cx);
    }

    pub(super) fn stop_rx(&mut self, cx: &Cx<'_>) {
        if self.rx_on {
            self.rx_timeout = Some(cx.clocks.hf.instant(cx.hf() + self.ticks(RX_TIMEOUT_BYTES)));
        }
    }

    pub(super) fn drain(&mut self, cx: &mut Cx<'_>) {
        while let Some(rx) = &mut self.rx {
            if rx.done >= rx.len {
                self.end_rx(cx);
                return;
            }
            let Some(byte) = self.fifo.pop_front() else { return };
            let address = rx.at.wrapping_add(rx.done);
            rx.done += 1;
            cx.dma_write(address, byte);
        }
    }

    pub(super) fn end_rx(&mut self, cx: &mut Cx<'_>) {
        let Some(rx) = self.finish_rx(cx) else { return };
        if self.block.short(ENDRX_STARTRX) && rx.len != 0 {
            self.start_rx(cx);
        }
        if self.block.short(ENDRX_STOPRX) {
            self.stop_rx(cx);
        }
    }

    pub(super) fn finish_rx(&mut self, cx: &mut Cx<'_>) -> Option<Buffer> {
        let rx = self.rx.take()?;
        self.rxd[2] = rx.done;
        self.block.raise(ENDRX, cx);
        Some(rx)
    }

    pub(crate) fn listens_to(&self, pin: Pin) -> bool {
        matches!(self.enable, ENABLED | LEGACY) && Pin::selected(self.psel[3]) == Some(pin)
    }

    pub(crate) fn receive(&mut self, begins: Cycle, mut frame: UartFrame, cx: &mut Cx<'_>) {
        frame.bit_ps = frame.bit_ps.clamp(1, LONGEST_BIT_PS);
        let connected = Pin::selected(self.psel[3]).is_some_and(|pin| cx.pins.is_connected(pin));
        if !self.rx_on || !connected {
            return;
        }
        self.line.frames.push_back((begins, frame));
        self.wait_for_edge(self.rx_since.max(begins), cx);
        self.sample(cx);
    }

    /// Waits for the next falling edge from `from` on, if no byte is being received.
    fn wait_for_edge(&mut self, from: Cycle, cx: &Cx<'_>) {
        if self.receiving.is_none() {
            let bits = 9 + u64::from(self.has_parity());
            let edge = self.line.falling_edge(from, period(cx.clocks));
            self.receiving = edge.map(|edge| (edge, edge + self.half_bits(2 * bits + 1)));
        }
    }

    pub(super) fn sample(&mut self, cx: &mut Cx<'_>) {
        while let Some((start, stop)) = self.receiving.take_if(|(_, stop)| *stop <= cx.now) {
            let period = period(cx.clocks);
            let bit = |k: u64| self.line.level(start + self.half_bits(2 * k + 1), period);
            let byte = (0..8).fold(0_u8, |byte, k| byte | u8::from(bit(k + 1)) << k);
            let odd = byte.count_ones() % 2 == 1;
            let mut error = 0;
            if self.has_parity() && bit(9) != odd {
                error |= PARITY;
            }
            if !self.line.level(stop, period) {
                error |= FRAMING;
                if byte == 0 && !(self.has_parity() && bit(9)) {
                    error |= BREAK;
                }
            }
            if error != 0 {
                self.errorsrc |= error;
                self.block.raise(ERROR, cx);
            }
            self.received(byte, cx);
            self.wait_for_edge(stop, cx);
            if self.receiving.is_none() {
                self.line.forget(cx.now);
            }
        }
    }

    fn received(&mut self, byte: u8, cx: &mut Cx<'_>) {
        if self.fifo.len() == FIFO {
            self.errorsrc |= OVERRUN;
            self.block.raise(ERROR, cx);
            return;
        }
        self.fifo.push_back(byte);
        if self.enable == LEGACY {
            // RXDRDY means that RXD has a byte. If another byte follows the one that was read, RXDRDY comes again.
            if self.fifo.len() == 1 {
                self.block.raise(RXDRDY, cx);
            }
            return;
        }
        self.block.raise(RXDRDY, cx);
        self.drain(cx);
    }
}
