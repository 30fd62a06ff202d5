//! ADC1 to ADC3 with their common registers (RM0090 chapter 13).
//!
//! | Covered | Manual |
//! |---|---|
//! | Regular group: single, scan, continuous and discontinuous mode; triggers by rising edges | 13.3.4, 13.3.10, 13.6 |
//! | Sampling time, resolution, alignment, prescaler: a conversion takes its exact cycles | 13.5, 13.7, 13.4 |
//! | `EOC` of a conversion or of the sequence, `OVR`, DMA requests with `DDS`, analogue watchdog | 13.8, 13.3.7 |
//! | Temperature sensor, VREFINT and VBAT at 25 °C and 3.3 V, the values of the factory's calibration | 13.10, 13.11 |
//!
//! `converter` models one converter, and this module the common registers.
//!
//! **Left out, each a finding when it is used:** the injected group, the multi-ADC modes, triggers by falling edges.
//! The stabilisation time after `ADON` is not checked. The voltage of a channel is read at the end of its sampling
//! time, without noise.

mod converter;
#[cfg(test)]
mod tests;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, NEVER, Pin};

use crate::cx::{Clocks, Cx, Peripheral, Trigger, Wires};

const AWD: u32 = 1 << 0;
const EOC: u32 = 1 << 1;
const STRT: u32 = 1 << 4;
const OVR: u32 = 1 << 5;

const ADON: u32 = 1 << 0;
const CONT: u32 = 1 << 1;
const DMA: u32 = 1 << 8;
const DDS: u32 = 1 << 9;
const EOCS: u32 = 1 << 10;
const ALIGN: u32 = 1 << 11;
const SWSTART: u32 = 1 << 30;

const SCAN: u32 = 1 << 8;
const AWDSGL: u32 = 1 << 9;
const DISCEN: u32 = 1 << 11;
const AWDEN: u32 = 1 << 23;

const VBATE: u32 = 1 << 22;
const TSVREFE: u32 = 1 << 23;

/// The analogue reference and supply voltage, in microvolts.
const VDDA_UV: i64 = 3_300_000;
/// The voltage of the internal reference, in microvolts (data sheet: 1.21 V).
const VREFINT_UV: i64 = 1_210_000;
/// The voltage of the temperature sensor at 25 °C, in microvolts (data sheet: 0.76 V and 2.5 mV/°C).
const SENSOR_UV: i64 = 760_000;

const fn raw(microvolts: i64) -> u16 {
    let code = (microvolts * 4095 + VDDA_UV / 2) / VDDA_UV;
    if code < 0 {
        0
    } else if code > 4095 {
        4095
    } else {
        code as u16
    }
}

/// The factory's calibration values in system memory, from 0x1FFF_7A2A on: VREFIN_CAL (30 °C), TS_CAL1 (30 °C), TS_CAL2
/// (110 °C).
pub(crate) const CALIBRATION: [u16; 3] = [raw(VREFINT_UV), raw(SENSOR_UV + 5 * 2_500), raw(SENSOR_UV + 85 * 2_500)];

#[derive(Clone, Copy, Debug)]
struct Conversion {
    place: u8,
    channel: u8,
    ends: Cycle,
    sampled_at: Cycle,
}

#[derive(Clone, Debug, Default)]
struct Converter {
    sr: u32,
    cr1: u32,
    cr2: u32,
    smpr: [u32; 2],
    jofr: [u32; 4],
    high: u32,
    low: u32,
    sqr: [u32; 3],
    jsqr: u32,
    data: u32,
    running: Option<Conversion>,
    /// The index of the conversion with which the next trigger begins, in discontinuous mode.
    next_place: u8,
    request: bool,
    /// Whether the last transfer of the DMA is over (DDS = 0).
    dma_ended: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Adc {
    converters: [Converter; 3],
    ccr: u32,
    due: Cycle,
}

fn pin(index: usize, channel: u8) -> Option<Pin> {
    const A: u8 = 0;
    const B: u8 = 1;
    const C: u8 = 2;
    const F: u8 = 5;
    Some(match (channel, index) {
        (0..=3, _) => Pin::new(A, channel),
        (10..=13, _) => Pin::new(C, channel - 10),
        // ADC3 has channels 4 to 9, 14 and 15 on PF6 to PF10, PF3, PF4 and PF5.
        (4..=8, 2) => Pin::new(F, channel + 2),
        (9, 2) => Pin::new(F, 3),
        (14..=15, 2) => Pin::new(F, channel - 10),
        (4..=7, _) => Pin::new(A, channel),
        (8 | 9, _) => Pin::new(B, channel - 8),
        (14..=15, _) => Pin::new(C, channel - 10),
        _ => return None,
    })
}

fn is_selected(trigger: Trigger, select: u32) -> bool {
    let (timer, channel) = match select {
        0..=2 => (1, select as u8 + 1),
        3..=5 => (2, select as u8 - 1),
        6 => (2, 0),
        7 => (3, 1),
        8 => (3, 0),
        9 => (4, 4),
        10..=12 => (5, select as u8 - 9),
        13 => (8, 1),
        14 => (8, 0),
        _ => return trigger == Trigger::Exti(11),
    };
    match trigger {
        Trigger::Trgo(number) => number == timer && channel == 0,
        Trigger::Compare(number, of) => number == timer && channel == of,
        Trigger::Exti(_) | Trigger::ClockFailure => false,
    }
}

impl Adc {
    pub(crate) fn new() -> Self {
        Self { converters: std::array::from_fn(|_| Converter::new()), ccr: 0, due: NEVER }
    }

    fn clock(&self, cx: &Cx) -> u64 {
        u64::from(cx.clocks.pclk2) * (2 + 2 * u64::from(self.ccr >> 16 & 3))
    }

    fn plan(&mut self) {
        let ends = |converter: &Converter| converter.running.map_or(NEVER, |running| running.ends);
        self.due = self.converters.iter().map(ends).min().unwrap_or(NEVER);
    }

    fn convert<W: Wires>(&self, index: usize, conversion: Conversion, cx: &mut Cx, wires: &W) -> u32 {
        let microvolts = match (conversion.channel, index) {
            (17, 0) if self.ccr & TSVREFE != 0 => VREFINT_UV,
            (18, 0) if self.ccr & VBATE != 0 => VDDA_UV / 4,
            (18, 0) if self.ccr & TSVREFE != 0 => SENSOR_UV,
            (16..=18, _) => 0,
            (channel, _) => match pin(index, channel) {
                // The DAC drives PA4 and PA5 while its channels are on.
                Some(Pin { port: 0, number: number @ (4 | 5) }) if cx.pads.dac[usize::from(number - 4)].is_some() => {
                    i64::from(cx.pads.dac[usize::from(number - 4)].unwrap_or(0))
                }
                Some(pin) => i64::from(wires.microvolts(conversion.sampled_at, pin)),
                None => {
                    cx.find_value(FindingKind::Misuse, "a channel that does not exist", u32::from(channel));
                    0
                }
            },
        };
        u32::from(raw(microvolts))
    }

    fn write_control(&mut self, index: usize, value: u32, cx: &mut Cx) {
        let clock = self.clock(cx);
        let converter = &mut self.converters[index];
        if value & 0x0030_0000 != 0 || value & 1 << 22 != 0 {
            cx.find(FindingKind::Unmodelled, "the injected group");
        }
        if value >> 28 & 3 == 2 {
            cx.find(FindingKind::Unmodelled, "a conversion triggered by a falling edge");
        }
        converter.cr2 = value & 0x3F7F_0F03;
        if value & ADON == 0 {
            converter.running = None;
            converter.sr &= !STRT;
        }
        if value & DMA == 0 {
            converter.request = false;
            converter.dma_ended = false;
        }
        if value & SWSTART != 0 {
            if value & ADON == 0 {
                cx.find(FindingKind::Misuse, "a conversion started while the ADC is off");
            }
            if cx.clocks.hclk_hz > 36_000_000 * clock {
                cx.find(FindingKind::Misuse, "the ADC clock is above 36 MHz");
            }
            converter.start(cx.now, clock);
        }
    }

    fn read_common(&self, offset: u32) -> u32 {
        match offset {
            0x300 => {
                let of = |index: usize| self.converters[index].sr & 0x3F;
                of(0) | of(1) << 8 | of(2) << 16
            }
            0x304 => self.ccr,
            _ => 0,
        }
    }
}

impl Peripheral for Adc {
    fn read(&mut self, offset: u32, _: Width, cx: &mut Cx) -> u32 {
        let value = self.peek(offset, cx);
        let register = offset & 0xFC;
        if offset < 0x300 && register == 0x4C {
            self.converters[(offset >> 8) as usize].sr &= !EOC;
        } else if offset < 0x300 && register > 0x4C {
            cx.find_value(FindingKind::Undefined, "no register at offset", offset);
        }
        value >> (8 * (offset & 3))
    }

    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx) {
        let value = crate::lanes(width, value);
        if offset >= 0x300 {
            if offset & !3 == 0x304 {
                if value & 0x1F != 0 {
                    cx.find(FindingKind::Unmodelled, "the multi-ADC modes (CCR.MULTI): each ADC goes by itself");
                }
                self.ccr = value & 0x00C3_EF1F;
            }
            return;
        }
        let index = (offset >> 8) as usize;
        let converter = &mut self.converters[index];
        match offset & 0xFC {
            0x00 => {
                converter.sr &= value;
            }
            0x04 => converter.cr1 = value & 0x07C0_FFFF,
            0x08 => self.write_control(index, value, cx),
            0x0C => converter.smpr[0] = value & 0x07FF_FFFF,
            0x10 => converter.smpr[1] = value & 0x3FFF_FFFF,
            register @ 0x14..=0x20 => converter.jofr[((register - 0x14) / 4) as usize] = value & 0xFFF,
            0x24 => converter.high = value & 0xFFF,
            0x28 => converter.low = value & 0xFFF,
            0x2C => converter.sqr[0] = value & 0x00FF_FFFF,
            0x30 => converter.sqr[1] = value & 0x3FFF_FFFF,
            0x34 => converter.sqr[2] = value & 0x3FFF_FFFF,
            0x38 => converter.jsqr = value & 0x003F_FFFF,
            0x3C..=0x4C => {}
            _ => cx.find_value(FindingKind::Undefined, "no register at offset", offset),
        }
        self.plan();
    }

    fn peek(&self, offset: u32, _: &mut Cx) -> u32 {
        if offset >= 0x300 {
            return self.read_common(offset & !3);
        }
        let converter = &self.converters[(offset >> 8) as usize];
        match offset & 0xFC {
            0x00 => converter.sr,
            0x04 => converter.cr1,
            0x08 => converter.cr2,
            0x0C => converter.smpr[0],
            0x10 => converter.smpr[1],
            register @ 0x14..=0x20 => converter.jofr[((register - 0x14) / 4) as usize],
            0x24 => converter.high,
            0x28 => converter.low,
            register @ 0x2C..=0x34 => converter.sqr[((register - 0x2C) / 4) as usize],
            0x38 => converter.jsqr,
            0x4C => converter.data,
            _ => 0,
        }
    }

    fn due(&self) -> Cycle {
        self.due
    }

    fn advance<W: Wires>(&mut self, cx: &mut Cx, wires: &mut W) {
        let clock = self.clock(cx);
        while self.due <= cx.now {
            for index in 0..3 {
                let Some(running) = self.converters[index].running.filter(|running| running.ends <= self.due) else {
                    continue;
                };
                let code = self.convert(index, running, cx, wires);
                self.converters[index].running = None;
                self.converters[index].finish(running, code, clock);
            }
            self.plan();
        }
    }

    fn irq(&self) -> u32 {
        let wants = |converter: &Converter| {
            let pairs = [(1 << 5, EOC), (1 << 6, AWD), (1 << 26, OVR)];
            pairs.iter().any(|&(enable, flag)| converter.cr1 & enable != 0 && converter.sr & flag != 0)
        };
        u32::from(self.converters.iter().any(wants))
    }

    fn dma(&self) -> u32 {
        (0..3).map(|index| u32::from(self.converters[index].request) << index).sum()
    }

    fn dma_served(&mut self, bit: u8, left: u32, _: &mut Cx) {
        if let Some(converter) = self.converters.get_mut(usize::from(bit)) {
            converter.request = false;
            converter.dma_ended = left == 0 && converter.cr2 & DDS == 0;
        }
    }

    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx) {
        for converter in &mut self.converters {
            if let Some(running) = &mut converter.running {
                let left = running.ends.saturating_sub(cx.now);
                running.ends = cx.now + left * u64::from(cx.clocks.pclk2) / u64::from(old.pclk2.max(1));
                running.sampled_at = running.sampled_at.min(running.ends);
            }
        }
        self.plan();
    }

    fn reset(&mut self) {
        *self = Self::new();
    }

    fn trigger(&mut self, trigger: Trigger, cx: &mut Cx) {
        let clock = self.clock(cx);
        for converter in &mut self.converters {
            let edges = converter.cr2 >> 28 & 3;
            if matches!(edges, 1 | 3) && is_selected(trigger, converter.cr2 >> 24 & 0xF) {
                converter.start(cx.now, clock);
            }
        }
        self.plan();
    }
}
