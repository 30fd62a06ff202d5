//! The digital-to-analogue converter, RM0090 chapter 14.
//!
//! | Covered | Manual |
//! |---|---|
//! | Both channels: enable bits, data registers in all alignments, single and dual, output registers | 14.3, 14.5 |
//! | The software trigger | 14.3.6 |
//! | The voltages on PA4 and PA5, which the ADCs read | 14.2 |
//!
//! **Left out, each a finding when it is set up:** the triggers of timers and EXTI, DMA, noise and triangle waves. The
//! output register takes the data at once, not after one or three PCLK1 cycles. The output settles at once and reaches
//! both rails, even with its buffer on.

use cortex_m4::Width;
use emulator_part::FindingKind;

use crate::gpio::{lane, merge};

/// The bits of channel 1 in `CR`. Those of channel 2 are 16 bits higher.
const EN: u32 = 1 << 0;
const TEN: u32 = 1 << 2;
const TSEL_SOFTWARE: u32 = 7 << 3;
const WAVE: u32 = 3 << 6;
const DMAEN: u32 = 1 << 12;

/// The reference voltage in microvolts: VREF+ is connected to VDDA.
const REFERENCE_UV: u64 = 3_300_000;

#[derive(Clone, Debug, Default)]
pub(crate) struct Dac {
    cr: u32,
    holding: [u32; 2],
    output: [u32; 2],
}

impl Dac {
    fn control(&self, channel: usize) -> u32 {
        self.cr >> (16 * channel) & 0x3FFF
    }

    /// The voltages of the channels' pins, in microvolts; `None` for a channel that is off.
    pub(crate) fn microvolts(&self) -> [Option<i32>; 2] {
        std::array::from_fn(|channel| {
            let is_on = self.control(channel) & EN != 0;
            is_on.then(|| ((u64::from(self.output[channel]) * REFERENCE_UV + 2047) / 4095) as i32)
        })
    }

    /// Copies the data of each channel without a trigger to the channel's output (RM0090 14.3.4).
    fn follow(&mut self) {
        for channel in 0..2 {
            if self.control(channel) & TEN == 0 {
                self.output[channel] = self.holding[channel];
            }
        }
    }

    pub(crate) fn read(&self, offset: u32, width: Width) -> u32 {
        let [one, two] = self.holding;
        let register = match offset & !3 {
            0x00 => self.cr,
            0x08 => one,
            0x0C => one << 4,
            0x10 => one >> 4,
            0x14 => two,
            0x18 => two << 4,
            0x1C => two >> 4,
            0x20 => two << 16 | one,
            0x24 => two << 20 | one << 4,
            0x28 => two >> 4 << 8 | one >> 4,
            0x2C => self.output[0],
            0x30 => self.output[1],
            _ => 0,
        };
        lane(register, offset, width)
    }

    pub(crate) fn write(
        &mut self,
        offset: u32,
        width: Width,
        value: u32,
        find: &mut impl FnMut(FindingKind, &'static str),
    ) {
        let [one, two] = &mut self.holding;
        let wide = crate::lanes(width, value);
        match offset & !3 {
            0x00 => {
                self.cr = merge(self.cr, offset, width, value) & 0x3FFF_3FFF;
                for channel in 0..2 {
                    let control = self.control(channel);
                    if control & EN == 0 {
                        continue;
                    }
                    if control & TEN != 0 && control & TSEL_SOFTWARE != TSEL_SOFTWARE {
                        find(FindingKind::Unmodelled, "a trigger that is not the software's: nothing triggers");
                    }
                    if control & TEN != 0 && control & WAVE != 0 {
                        find(FindingKind::Unmodelled, "noise and triangle waves: the output is the data register");
                    }
                    if control & DMAEN != 0 {
                        find(FindingKind::Unmodelled, "DMA: nothing is requested");
                    }
                }
            }
            0x04 => {
                for channel in 0..2 {
                    if wide >> channel & 1 != 0 && self.control(channel) & TEN != 0 {
                        self.output[channel] = self.holding[channel];
                    }
                }
            }
            0x08 => *one = wide & 0xFFF,
            0x0C => *one = wide >> 4 & 0xFFF,
            0x10 => *one = (wide & 0xFF) << 4,
            0x14 => *two = wide & 0xFFF,
            0x18 => *two = wide >> 4 & 0xFFF,
            0x1C => *two = (wide & 0xFF) << 4,
            0x20 => (*one, *two) = (wide & 0xFFF, wide >> 16 & 0xFFF),
            0x24 => (*one, *two) = (wide >> 4 & 0xFFF, wide >> 20 & 0xFFF),
            0x28 => (*one, *two) = ((wide & 0xFF) << 4, (wide >> 8 & 0xFF) << 4),
            _ => {}
        }
        self.follow();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(dac: &mut Dac, offset: u32, value: u32) -> Vec<&'static str> {
        let mut found = Vec::new();
        dac.write(offset, Width::Word, value, &mut |_, text| found.push(text));
        found
    }

    #[test]
    fn a_channel_drives_what_its_data_register_says_once_it_is_on() {
        let mut dac = Dac::default();
        write(&mut dac, 0x10, 0x80);
        assert_eq!(dac.microvolts(), [None, None]);
        write(&mut dac, 0x00, EN);
        assert_eq!((dac.read(0x2C, Width::Word), dac.microvolts()), (0x800, [Some(1_650_403), None]));
        write(&mut dac, 0x20, 0x0FFF_0000);
        write(&mut dac, 0x00, EN << 16 | EN);
        assert_eq!(dac.microvolts(), [Some(0), Some(3_300_000)]);
    }

    #[test]
    fn with_the_software_trigger_the_output_waits_for_it() {
        let mut dac = Dac::default();
        assert!(write(&mut dac, 0x00, EN | TEN | TSEL_SOFTWARE).is_empty());
        write(&mut dac, 0x08, 100);
        assert_eq!(dac.read(0x2C, Width::Word), 0);
        write(&mut dac, 0x04, 1);
        assert_eq!(dac.read(0x2C, Width::Word), 100);
    }

    #[test]
    fn a_timers_trigger_and_dma_are_found() {
        let mut dac = Dac::default();
        assert_eq!(write(&mut dac, 0x00, EN | TEN | DMAEN).len(), 2);
    }
}
