//! The real-time clock and the backup registers (RM0090 chapter 26).
//!
//! | Covered | Manual |
//! |---|---|
//! | Calendar in BCD with both prescalers, sub-seconds, 12 and 24 hours, leap years | 26.3.1, 26.3.3 |
//! | Write protection, `INITF` after two RTC clocks, `RSF`, `BYPSHAD`, locked shadow registers | 26.3.5, 26.3.6 |
//! | Alarms A and B with their masks, the wake-up timer with all its clocks, `ADD1H`, `SUB1H` | 26.3.3, 26.3.4 |
//! | Backup registers | 26.6.20 |
//!
//! **Left out, each a finding when it is used:** sub-second alarms, calibration, shift, reference clock, time stamp,
//! tamper, outputs. The shadow registers hold the present calendar, not that of up to two RTC clocks ago. Write
//! protection by PWR_CR.DBP is in the part.
//!
//! `calendar` models date and time, and this module registers and passing time.
//!
//! The calendar is computed from the RTC clocks since the last access. Only an alarm or wake-up with its interrupt
//! enabled is an event.

mod calendar;
#[cfg(test)]
mod tests;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER};

use crate::cx::{Clocks, Cx, Peripheral, Ratio, Wires};
use calendar::bcd;

const BYPSHAD: u32 = 1 << 5;
const FMT: u32 = 1 << 6;
const ALRAE: u32 = 1 << 8;
const WUTE: u32 = 1 << 10;
const ALRAIE: u32 = 1 << 12;
const WUTIE: u32 = 1 << 14;
const ADD1H: u32 = 1 << 16;
const SUB1H: u32 = 1 << 17;
/// The control bits of features that are left out: TSE, REFCKON, DCE, COE and OSEL.
const LEFT_OUT: u32 = 1 << 11 | 1 << 4 | 1 << 7 | 1 << 23 | 3 << 21;

const ALRAWF: u32 = 1 << 0;
const WUTWF: u32 = 1 << 2;
const INITS: u32 = 1 << 4;
const RSF: u32 = 1 << 5;
const INITF: u32 = 1 << 6;
const INIT: u32 = 1 << 7;
const ALRAF: u32 = 1 << 8;
const WUTF: u32 = 1 << 10;

/// The number of RTC clocks that the synchronisation between the clock domains takes.
const AGREE: u64 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Calendar {
    year: u8,
    month: u8,
    day: u8,
    /// The weekday, 1 (Monday) to 7.
    weekday: u8,
    hour: u8,
    minute: u8,
    second: u8,
}

#[derive(Clone, Debug)]
pub(crate) struct Rtc {
    calendar: Calendar,
    phase: u64,
    cr: u32,
    isr: u32,
    prer: u32,
    wutr: u32,
    alarms: [u32; 2],
    alarm_subseconds: [u32; 2],
    calibr: u32,
    tafcr: u32,
    backup: [u32; 20],
    /// The number of key bytes that software has written to WPR in order; two unlock the registers.
    key: u8,
    /// The values of TR and DR that a read has locked until DR is read.
    locked: (Option<u32>, Option<u32>),

    clock: Ratio,
    origin: Cycle,
    counted: u64,
    total: u64,
    /// The value of `total` at which INITF rises. The next two fields are the values at which RSF and WUTWF rise.
    initialises_at: u64,
    agrees_at: u64,
    wakeup_writable_at: u64,
    wakes_at: u64,
    due: Cycle,
}

impl Rtc {
    pub(crate) fn new() -> Self {
        Self {
            calendar: Calendar::FIRST,
            phase: 0,
            cr: 0,
            isr: 0,
            prer: 0x007F_00FF,
            wutr: 0xFFFF,
            alarms: [0; 2],
            alarm_subseconds: [0; 2],
            calibr: 0,
            tafcr: 0,
            backup: [0; 20],
            key: 0,
            locked: (None, None),
            clock: Ratio::STOPPED,
            origin: 0,
            counted: 0,
            total: 0,
            initialises_at: NEVER,
            agrees_at: NEVER,
            wakeup_writable_at: 0,
            wakes_at: NEVER,
            due: NEVER,
        }
    }

    /// Carries out a system reset. The calendar goes on.
    pub(crate) fn system_reset(&mut self) {
        self.isr &= !(INIT | INITF | RSF);
        self.initialises_at = NEVER;
        self.agrees_at = self.total + AGREE;
        self.locked = (None, None);
    }

    fn second_clocks(&self) -> u64 {
        (u64::from(self.prer >> 16 & 0x7F) + 1) * (u64::from(self.prer & 0x7FFF) + 1)
    }

    fn is_initialising(&self) -> bool {
        self.isr & INITF != 0
    }

    fn wakeup_period(&self) -> u64 {
        let reload = u64::from(self.wutr) + 1;
        match self.cr & 7 {
            select @ 0..=3 => (16 >> select) * reload,
            4 | 5 => self.second_clocks() * reload,
            _ => self.second_clocks() * (reload + 0x1_0000),
        }
    }

    fn sync(&mut self, now: Cycle) {
        let ticks = self.clock.ticks(now.saturating_sub(self.origin)).saturating_sub(self.counted);
        self.counted += ticks;
        self.total += ticks;
        if self.total >= self.initialises_at {
            self.initialises_at = NEVER;
            // The calendar stops at this RTC clock, and later clocks do not count.
            self.isr |= INITF;
        } else if !self.is_initialising() {
            self.phase += ticks;
            let second = self.second_clocks();
            while self.phase >= second {
                self.phase -= second;
                self.calendar.next_second();
                self.check_alarms();
            }
        }
        if self.total >= self.agrees_at {
            self.agrees_at = NEVER;
            self.isr |= RSF;
        }
        if self.total >= self.wakes_at {
            self.isr |= WUTF;
            let period = self.wakeup_period();
            self.wakes_at += ((self.total - self.wakes_at) / period + 1) * period;
        }
    }

    fn check_alarms(&mut self) {
        let time = self.calendar.time(self.cr & FMT != 0);
        for (index, alarm) in self.alarms.into_iter().enumerate() {
            if self.cr & ALRAE << index == 0 {
                continue;
            }
            let mut matches = true;
            for (masked, bits) in [(7, 0x7F), (15, 0x7F00), (23, 0x007F_0000)] {
                matches &= alarm >> masked & 1 != 0 || (alarm ^ time) & bits == 0;
            }
            if alarm >> 31 & 1 == 0 {
                let day = alarm >> 24 & 0x3F;
                matches &= if alarm >> 30 & 1 != 0 {
                    day & 0xF == u32::from(self.calendar.weekday)
                } else {
                    day == bcd(self.calendar.day)
                };
            }
            if matches {
                self.isr |= ALRAF << index;
            }
        }
    }

    fn plan(&mut self) {
        let mut ticks = u64::MAX;
        for index in 0..2 {
            let wanted = (ALRAE | ALRAIE) << index;
            if self.cr & wanted == wanted && self.isr & ALRAF << index == 0 && !self.is_initialising() {
                ticks = self.second_clocks().saturating_sub(self.phase).max(1);
            }
        }
        if self.cr & (WUTE | WUTIE) == WUTE | WUTIE && self.isr & WUTF == 0 {
            ticks = ticks.min(self.wakes_at.saturating_sub(self.total).max(1));
        }
        self.due = if ticks == u64::MAX {
            NEVER
        } else {
            self.clock.cycles(self.counted.saturating_add(ticks)).saturating_add(self.origin)
        };
    }

    fn status(&self) -> u32 {
        let mut status = self.isr;
        for index in 0..2 {
            if self.cr & ALRAE << index == 0 || self.is_initialising() {
                status |= ALRAWF << index;
            }
        }
        if self.cr & WUTE == 0 && self.total >= self.wakeup_writable_at {
            status |= WUTWF;
        }
        if self.calendar.year != 0 {
            status |= INITS;
        }
        status
    }

    fn subseconds(&self) -> u32 {
        let before = self.phase / (u64::from(self.prer >> 16 & 0x7F) + 1);
        (self.prer & 0x7FFF).wrapping_sub(before as u32) & 0xFFFF
    }

    fn value(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => self.calendar.time(self.cr & FMT != 0),
            0x04 => self.calendar.date(),
            0x08 => self.cr,
            0x0C => self.status(),
            0x10 => self.prer,
            0x14 => self.wutr,
            0x18 => self.calibr,
            0x1C | 0x20 => self.alarms[((offset - 0x1C) / 4) as usize],
            0x28 => self.subseconds(),
            0x24 | 0x2C..=0x3C => 0,
            0x40 => self.tafcr,
            0x44 | 0x48 => self.alarm_subseconds[((offset - 0x44) / 4) as usize],
            0x50..=0x9C => self.backup[((offset - 0x50) / 4) as usize],
            _ => return None,
        })
    }

    fn write_status(&mut self, value: u32, is_open: bool) {
        // Writing zero clears flags, even of write-protected registers.
        self.isr &= value | !0x3F00;
        if !is_open {
            return;
        }
        if value & RSF == 0 {
            self.isr &= !RSF;
            self.agrees_at = self.total + AGREE;
        }
        if value & INIT != 0 && self.isr & INIT == 0 {
            self.isr |= INIT;
            self.initialises_at = self.total + AGREE;
        } else if value & INIT == 0 && self.isr & INIT != 0 {
            if self.is_initialising() {
                // The new calendar begins with a whole second.
                self.phase = 0;
                self.isr &= !RSF;
                self.agrees_at = self.total + 2 * AGREE;
            }
            self.isr &= !(INIT | INITF);
            self.initialises_at = NEVER;
        }
    }

    fn write_control(&mut self, value: u32, cx: &mut Cx) {
        if value & LEFT_OUT != 0 {
            cx.find(FindingKind::Unmodelled, "time stamp, reference clock, coarse calibration or output (RTC_CR)");
        }
        let before = self.cr;
        let mut value = value & 0x00FC_FFFF;
        if self.status() & WUTWF == 0 {
            value = value & !7 | before & 7;
        }
        if !self.is_initialising() && (before ^ value) & FMT != 0 {
            value ^= FMT;
        }
        self.cr = value;
        if value & WUTE != 0 && before & WUTE == 0 {
            // If the wake-up timer uses the calendar's clock, it counts the calendar's seconds.
            let from = if value & 4 != 0 { self.total - self.phase.min(self.total) } else { self.total };
            self.wakes_at = from + self.wakeup_period();
        } else if value & WUTE == 0 {
            self.wakes_at = NEVER;
            if before & WUTE != 0 {
                self.wakeup_writable_at = self.total + AGREE;
            }
        }
    }

    fn write_open(&mut self, offset: u32, value: u32, cx: &mut Cx) {
        match offset {
            0x00 | 0x04 | 0x10 if !self.is_initialising() => {
                cx.find(FindingKind::Misuse, "calendar or prescaler written outside initialisation mode");
            }
            0x00 => self.calendar.set_time(value, self.cr & FMT != 0),
            0x04 => self.calendar.set_date(value),
            0x08 => {
                let hour = self.calendar.hour;
                if value & ADD1H != 0 {
                    self.calendar.hour = (hour + 1) % 24;
                } else if value & SUB1H != 0 {
                    self.calendar.hour = (hour + 23) % 24;
                }
                self.write_control(value, cx);
            }
            0x10 => self.prer = value & 0x007F_7FFF,
            0x14 if self.status() & WUTWF != 0 => self.wutr = value & 0xFFFF,
            0x1C | 0x20 | 0x44 | 0x48 => {
                let index = (offset >> 2 & 1 ^ 1) as usize;
                if self.status() & ALRAWF << index == 0 {
                    cx.find(FindingKind::Misuse, "an alarm written while it is enabled");
                } else if offset < 0x44 {
                    self.alarms[index] = value;
                } else {
                    if value & 0x0F00_0000 != 0 {
                        cx.find(FindingKind::Unmodelled, "a sub-second alarm: it comes at the second");
                    }
                    self.alarm_subseconds[index] = value & 0x0F00_7FFF;
                }
            }
            0x14 => cx.find(FindingKind::Misuse, "WUTR written while WUTWF is 0"),
            0x18 | 0x2C | 0x3C if value != 0 => {
                cx.find(FindingKind::Unmodelled, "calibration or shift: the calendar goes on as before");
            }
            _ => {}
        }
    }
}

impl Peripheral for Rtc {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        self.sync(cx.now);
        let register = offset & !3;
        let Some(mut value) = self.value(register) else {
            cx.find_value(FindingKind::Undefined, "no register at offset", offset);
            return 0;
        };
        if self.cr & BYPSHAD == 0 {
            // A read of the sub-seconds locks time and date, and a read of the time locks the date. Reading the date
            // ends the lock.
            match register {
                0x28 if self.locked == (None, None) => self.locked = (self.value(0x00), self.value(0x04)),
                0x00 => {
                    value = self.locked.0.take().unwrap_or(value);
                    if self.locked.1.is_none() {
                        self.locked.1 = self.value(0x04);
                    }
                }
                0x04 => {
                    value = self.locked.1.unwrap_or(value);
                    self.locked = (None, None);
                }
                _ => {}
            }
        }
        value >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        self.sync(cx.now);
        let value = crate::lanes(width, value);
        let is_open = self.key == 2;
        match offset & !3 {
            0x24 => {
                self.key = match (self.key, value & 0xFF) {
                    (0, 0xCA) => 1,
                    (1, 0x53) => 2,
                    _ => 0,
                }
            }
            0x0C => self.write_status(value, is_open),
            0x40 => {
                if value != 0 {
                    cx.find(FindingKind::Unmodelled, "tamper and time stamp inputs");
                }
                self.tafcr = value & 0x0007_FFFF;
            }
            register @ 0x50..=0x9C => self.backup[((register - 0x50) / 4) as usize] = value,
            register if register > 0x9C || register == 0x4C => {
                cx.find_value(FindingKind::Undefined, "no register at offset", offset);
            }
            _ if !is_open => cx.find_value(FindingKind::Misuse, "written while write-protected: offset", offset),
            register => self.write_open(register, value, cx),
        }
        self.plan();
    }

    fn peek(&self, offset: u32, cx: &mut Cx) -> u32 {
        let mut copy = self.clone();
        copy.sync(cx.now);
        copy.value(offset & !3).unwrap_or(0)
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, _: &mut W) {
        self.sync(cx.now);
        self.plan();
    }

    fn irq(&self) -> u32 {
        let alarm = (0..2).any(|index| self.cr & ALRAIE << index != 0 && self.isr & ALRAF << index != 0);
        let wakeup = self.cr & WUTIE != 0 && self.isr & WUTF != 0;
        u32::from(alarm) | u32::from(wakeup) << 2
    }

    fn clocks_changed(&mut self, _: &Clocks, cx: &mut Cx) {
        if cx.clocks.rtc != self.clock {
            self.sync(cx.now);
            self.clock = cx.clocks.rtc;
            self.origin = cx.now;
            self.counted = 0;
            if self.isr & RSF == 0 && self.agrees_at == NEVER {
                self.agrees_at = self.total + AGREE;
            }
            self.plan();
        }
    }

    fn reset(&mut self) {
        *self = Self { clock: self.clock, origin: self.origin, counted: self.counted, ..Self::new() };
    }
}
