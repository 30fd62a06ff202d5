//! The calendar in BCD: seconds to years, leap years, 12 and 24 hours (RM0090 26.3.1, 26.6.1, 26.6.2).

use super::*;

pub(super) fn bcd(number: u8) -> u32 {
    u32::from(number / 10) << 4 | u32::from(number % 10)
}

fn binary(bcd: u32) -> u8 {
    ((bcd >> 4) * 10 + (bcd & 0xF)) as u8
}

impl Calendar {
    pub(super) const FIRST: Self = Self { year: 0, month: 1, day: 1, weekday: 1, hour: 0, minute: 0, second: 0 };

    fn month_days(&self) -> u8 {
        match self.month {
            2 => 28 + u8::from(self.year.is_multiple_of(4)),
            4 | 6 | 9 | 11 => 30,
            _ => 31,
        }
    }

    pub(super) fn next_second(&mut self) {
        self.second += 1;
        if self.second < 60 {
            return;
        }
        self.second = 0;
        self.minute += 1;
        if self.minute < 60 {
            return;
        }
        self.minute = 0;
        self.hour += 1;
        if self.hour < 24 {
            return;
        }
        self.hour = 0;
        self.weekday = self.weekday % 7 + 1;
        self.day += 1;
        if self.day <= self.month_days() {
            return;
        }
        self.day = 1;
        self.month += 1;
        if self.month <= 12 {
            return;
        }
        self.month = 1;
        self.year = (self.year + 1) % 100;
    }

    pub(super) fn time(&self, twelve: bool) -> u32 {
        let (hour, pm) = if twelve { ((self.hour + 11) % 12 + 1, self.hour >= 12) } else { (self.hour, false) };
        u32::from(pm) << 22 | bcd(hour) << 16 | bcd(self.minute) << 8 | bcd(self.second)
    }

    pub(super) fn date(&self) -> u32 {
        bcd(self.year) << 16 | u32::from(self.weekday) << 13 | bcd(self.month) << 8 | bcd(self.day)
    }

    pub(super) fn set_time(&mut self, time: u32, twelve: bool) {
        let hour = binary(time >> 16 & 0x3F);
        self.hour = if twelve { hour % 12 + if time >> 22 & 1 != 0 { 12 } else { 0 } } else { hour };
        self.minute = binary(time >> 8 & 0x7F);
        self.second = binary(time & 0x7F);
    }

    pub(super) fn set_date(&mut self, date: u32) {
        self.year = binary(date >> 16 & 0xFF);
        self.weekday = (date >> 13 & 7) as u8;
        self.month = binary(date >> 8 & 0x1F);
        self.day = binary(date & 0x3F);
    }
}
