//! The transmitter: the data register, the shift register, idle frames (RM0090 30.3.2).

use super::*;

impl Usart {
    pub(super) fn frame_cycles(&self) -> u64 {
        (self.bit * (2 * (1 + u64::from(self.data_bits())) + u64::from(self.stop_halves()))) / 2
    }

    pub(super) fn send_next(&mut self, from: Cycle) {
        if self.sending.is_some() || self.sr & TXE != 0 || !self.is_on(TE) {
            return;
        }
        self.sr |= TXE;
        self.sr &= !TC;
        let ends = from + self.frame_cycles();
        self.sending = Some(Sending { data: Some(self.tdr), ends });
        if self.cr3 & HDSEL != 0 && self.is_on(RE) {
            // In half-duplex mode the receiver also gets the frame that is sent.
            let levels = self.levels(self.tdr);
            self.waves.push_back(Wave { begins: from, ends, bit: self.bit << FRACTION, levels });
            self.find_start();
        }
    }

    fn with_parity(&self, data: u16) -> u16 {
        let bits = self.data_bits();
        let mask = (1_u16 << bits) - 1;
        if self.cr1 & PCE == 0 {
            return data & mask;
        }
        let data = data & (mask >> 1);
        let odd = data.count_ones() & 1 != 0;
        data | u16::from(odd != (self.cr1 & PS != 0)) << (bits - 1)
    }

    fn levels(&self, data: u16) -> u32 {
        u32::MAX << (1 + self.data_bits()) | u32::from(self.with_parity(data)) << 1
    }

    pub(super) fn finish_sending<W: Wires>(&mut self, sent: Sending, cx: &mut Cx, wires: &mut W) {
        let Some(data) = sent.data else { return };
        if self.bit_ps == 0 {
            self.bit_ps = cx.clocks.ps(self.bit);
        }
        let parity = match self.cr1 & (PCE | PS) {
            PCE => UartParity::Even,
            bits if bits & PCE != 0 => UartParity::Odd,
            _ => UartParity::None,
        };
        let bits = self.data_bits() as u8 - u8::from(parity != UartParity::None);
        let frame = UartFrame {
            data: data & ((1 << bits) - 1),
            bits,
            parity,
            stop_halves: self.stop_halves(),
            bit_ps: self.bit_ps,
        };
        for pin in cx.pins(Signal::Uart(self.number, UartPin::Tx)).into_iter().flatten() {
            wires.uart(sent.ends, pin, &frame);
        }
    }
}
