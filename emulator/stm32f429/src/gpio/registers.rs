//! The registers of a port (RM0090 8.4): what each stores, and the lock sequence (8.3.6).

use super::*;

impl Gpio {
    pub(crate) fn read(&self, port: usize, offset: u32, width: Width) -> u32 {
        let p = &self.ports[port];
        let register = match offset >> 2 {
            0 => p.moder,
            1 => p.otyper,
            2 => p.ospeedr,
            3 => p.pupdr,
            4 => u32::from(p.levels() & !p.analog),
            5 => u32::from(p.odr),
            // BSRR is write-only and reads as 0, RM0090 8.4.7.
            7 => u32::from(p.lock) | u32::from(p.locked) << 16,
            8 => p.afr[0],
            9 => p.afr[1],
            _ => 0,
        };
        lane(register, offset, width)
    }

    #[expect(clippy::too_many_arguments, reason = "one access with everything it depends on")]
    pub(crate) fn write(
        &mut self,
        port: usize,
        offset: u32,
        width: Width,
        value: u32,
        now: Cycle,
        pc: Option<u32>,
        out: &mut Effects,
    ) {
        let p = &mut self.ports[port];
        let locked = if p.locked { p.lock } else { 0 };
        let locked_fields = |locked: u16| -> u32 {
            let mut mask = 0;
            for pin in 0..16 {
                if locked >> pin & 1 != 0 {
                    mask |= 3 << (2 * pin);
                }
            }
            mask
        };
        let keep = |old: u32, mask: u32| old & mask | merge(old, offset, width, value) & !mask;
        match offset >> 2 {
            0 => p.moder = keep(p.moder, locked_fields(locked)),
            1 => p.otyper = keep(p.otyper, u32::from(locked)) & 0xFFFF,
            2 => p.ospeedr = keep(p.ospeedr, locked_fields(locked)),
            3 => p.pupdr = keep(p.pupdr, locked_fields(locked)),
            5 => {
                p.odr = merge(u32::from(p.odr), offset, width, value) as u16;
                self.settle(port, now, pc, out);
                return;
            }
            6 => {
                // Zeros in BSRR do nothing. Setting wins over clearing (RM0090 8.4.7).
                let bits = merge(0, offset, width, value);
                p.odr = p.odr & !((bits >> 16) as u16) | bits as u16;
                self.settle(port, now, pc, out);
                return;
            }
            7 => {
                let bits = merge(0, offset, width, value);
                Self::lock(p, bits, width == Width::Word);
                return;
            }
            nth @ (8 | 9) => {
                let nth = (nth - 8) as usize;
                let mut mask = 0;
                for pin in 0..8 {
                    if locked >> (8 * nth + pin) & 1 != 0 {
                        mask |= 0xF << (4 * pin);
                    }
                }
                p.afr[nth] = keep(p.afr[nth], mask);
            }
            _ => return,
        }
        self.configure(port);
        self.settle(port, now, pc, out);
        self.look(port, now, pc, out);
    }

    /// Handles a step of the lock sequence (RM0090 8.3.6): bit 16 is written as 1, 0, 1 with the same pins, and then
    /// read. Anything else aborts the sequence.
    fn lock(p: &mut Port, bits: u32, word: bool) {
        if p.locked {
            return;
        }
        let (pins, key) = (bits as u16, bits >> 16 & 1 != 0);
        p.lock_step = match (p.lock_step, key) {
            _ if !word => 0,
            (1, false) if pins == p.lock => 2,
            (2, true) if pins == p.lock => 3,
            (_, true) => 1,
            _ => 0,
        };
        p.lock = pins;
        p.locked = p.lock_step == 3;
    }
}
