//! The registers of a timer (RM0090 17.4, 18.4, 19.4, 20.4), and DMA bursts.

use super::*;

impl Tim {
    pub(super) fn read_register(&mut self, offset: u32, cx: &mut Cx) -> u32 {
        let channels = self.kind.channels;
        match offset {
            0x00 => {
                let down = self.down && (self.centre() || matches!(self.slave_mode(), 1..=3));
                self.cr1 | if down { DIR } else { 0 }
            }
            0x04 => self.cr2,
            0x08 if self.kind.slave => self.smcr,
            0x0C => self.dier,
            0x10 => self.sr,
            0x14 => 0,
            0x18 if channels > 0 => self.ccmr[0],
            0x1C if channels > 2 => self.ccmr[1],
            0x20 if channels > 0 => self.ccer,
            0x24 => self.cnt,
            0x28 => self.psc,
            0x2C => self.arr,
            0x30 if self.kind.advanced => self.rcr,
            0x34..=0x40 if (offset - 0x34) / 4 < u32::from(channels) => {
                let channel = ((offset - 0x34) / 4) as usize;
                if self.is_input(channel) {
                    self.sr &= !(2 << channel);
                    self.ccr_now[channel]
                } else {
                    self.ccr[channel]
                }
            }
            0x44 if self.kind.advanced => self.bdtr,
            0x48 if channels > 2 => self.dcr,
            0x4C if channels > 2 => {
                let register = self.burst_register();
                if register == 0x4C { 0 } else { self.read_register(register, cx) }
            }
            0x50 if matches!(self.kind.number, 2 | 5 | 11) => self.or,
            _ => {
                cx.find(FindingKind::Undefined, "a timer register that this timer has not");
                0
            }
        }
    }

    fn burst_register(&mut self) -> u32 {
        let register = 4 * ((self.dcr & 0x1F) + self.burst_next);
        self.burst_next = if self.burst_next >= self.dcr >> 8 & 0x1F { 0 } else { self.burst_next + 1 };
        register
    }

    pub(super) fn write_register(&mut self, offset: u32, value: u32, cx: &mut Cx) {
        let channels = self.kind.channels;
        match offset {
            0x00 => self.write_cr1(value, cx),
            0x04 => {
                if self.kind.advanced && value & 5 != 0 {
                    cx.find(FindingKind::Unmodelled, "preloaded channel control and commutation (CR2.CCPC, CCUS)");
                }
                self.cr2 = value & 0x7FFF;
                self.trigger_enable();
                self.follow();
            }
            0x08 if self.kind.slave => {
                self.smcr = value & 0xFFFF;
                if self.slave_mode() == 5 && self.trigger_source() < 4 {
                    cx.find(FindingKind::Unmodelled, "gated mode on another timer's trigger: the gate stays closed");
                }
                self.gate = match self.trigger_source() {
                    5 => self.line(0) != (self.ccer & 2 != 0),
                    6 => self.line(1) != (self.ccer & 0x20 != 0),
                    7 => self.inputs[INPUT_ETR] != (self.smcr & ETP != 0),
                    _ => false,
                };
            }
            0x0C => {
                self.dier = value & 0x7FFF;
                // Clearing a request's enable bit cancels the request.
                self.requests &= self.dier >> 8 & 0x1F | self.dier >> 9 & DMA_TRIGGER;
            }
            // Written zeros clear flags.
            0x10 => self.sr &= value,
            0x14 => self.generate(value, cx),
            0x18 if channels > 0 => self.write_modes(0, value, cx),
            0x1C if channels > 2 => self.write_modes(1, value, cx),
            0x20 if channels > 0 => self.ccer = value & ((1 << (4 * u32::from(channels))) - 1),
            0x24 => {
                self.cnt = value & self.kind.largest;
                self.follow();
            }
            0x28 => self.psc = value & 0xFFFF,
            0x2C => {
                self.arr = value & self.kind.largest;
                if self.cr1 & ARPE == 0 {
                    self.arr_now = self.arr;
                }
            }
            0x30 if self.kind.advanced => self.rcr = value & 0xFF,
            0x34..=0x40 if (offset - 0x34) / 4 < u32::from(channels) => {
                let channel = ((offset - 0x34) / 4) as usize;
                // A capturing channel's register is read-only.
                if !self.is_input(channel) {
                    self.ccr[channel] = value & self.kind.largest;
                    if self.mode_byte(channel) & 8 == 0 {
                        self.ccr_now[channel] = self.ccr[channel];
                        self.follow();
                    }
                }
            }
            0x44 if self.kind.advanced => {
                if value & 0x300 != 0 {
                    cx.find(FindingKind::Unmodelled, "BDTR.LOCK: nothing is locked");
                }
                self.bdtr = value & 0xFFFF;
                self.check_break();
            }
            0x48 if channels > 2 => self.dcr = value & 0x1F1F,
            0x4C if channels > 2 => {
                let register = self.burst_register();
                if register < 0x48 {
                    self.write_register(register, value, cx);
                }
            }
            0x50 if matches!(self.kind.number, 2 | 5 | 11) => {
                if value != 0 {
                    cx.find(FindingKind::Unmodelled, "the option register: inputs stay on their pins");
                }
                self.or = value & 0xFFFF;
            }
            _ => cx.find(FindingKind::Undefined, "a timer register that this timer has not"),
        }
    }

    fn write_cr1(&mut self, value: u32, cx: &mut Cx) {
        let mut value = value & 0x3FF;
        if !self.kind.downward {
            value &= !(DIR | 0x60);
        }
        if self.kind.channels == 0 {
            value &= 0x8F;
        }
        let before = self.cr1;
        if before & CEN != 0 && (before & 0x60 == 0) != (value & 0x60 == 0) {
            cx.find(FindingKind::Misuse, "edge-aligned and centre-aligned mode changed while the counter is on");
        }
        self.cr1 = value;
        // DIR is read-only in centre-aligned and encoder mode.
        if value & 0x60 == 0 {
            if !matches!(self.slave_mode(), 1..=3) {
                self.down = value & DIR != 0;
            }
        } else {
            self.cr1 &= !DIR;
        }
        if value & ARPE == 0 {
            self.arr_now = self.arr;
        }
        if value & CEN != 0 && before & CEN == 0 {
            self.cr1 &= !CEN;
            self.start(cx.now);
        } else {
            self.trigger_enable();
        }
    }

    fn write_modes(&mut self, half: usize, value: u32, cx: &mut Cx) {
        let mut value = value & 0xFFFF;
        if self.kind.channels == 1 {
            value &= 0xFF;
        }
        self.ccmr[half] = value;
        for channel in [2 * half, 2 * half + 1] {
            let mode = self.mode_byte(channel);
            if mode & 3 == 0 {
                if mode & 0x80 != 0 {
                    cx.find(FindingKind::Unmodelled, "the external clear of a reference (OCxCE)");
                }
                if mode & 8 == 0 {
                    self.ccr_now[channel] = self.ccr[channel];
                }
            } else if mode & 0xC == 0 {
                self.edges[channel] = 0;
            }
        }
        self.follow();
    }

    fn generate(&mut self, value: u32, cx: &mut Cx) {
        if value & 1 != 0 {
            self.restart();
        }
        for channel in 0..self.channels() {
            if value >> (1 + channel) & 1 != 0 {
                if self.is_input(channel) {
                    self.capture(channel);
                } else {
                    self.compare_event(channel);
                }
            }
        }
        if value & 0x20 != 0 && self.kind.advanced {
            cx.find(FindingKind::Unmodelled, "the commutation event (EGR.COMG)");
        }
        if value & 0x40 != 0 && self.kind.slave {
            self.sr |= TIF;
            if self.dier & TDE != 0 {
                self.request(DMA_TRIGGER);
            }
        }
        if value & 0x80 != 0 && self.kind.advanced {
            self.bdtr &= !MOE;
            self.sr |= BIF;
        }
    }
}
