//! The flash patch and breakpoint unit, ARM ARM C1.11.
//!
//! The unit has CTRL, REMAP, COMP0 to COMP7 and instruction breakpoints. It does no remapping: a comparator with
//! REPLACE 0 is reported as unmodelled and does nothing, like the two literal comparators.

/// The numbers in CTRL: six instruction and two literal comparators, TRM 8.3.
const NUMBERS: u32 = 0x260;

#[derive(Clone, Debug, Default)]
pub(crate) struct Fpb {
    enabled: bool,
    remap: u32,
    comparators: [u32; 8],
}

impl Fpb {
    pub(crate) fn breakpoints(&self) -> impl Iterator<Item = u32> + '_ {
        self.comparators[..6].iter().filter(|&&comparator| self.enabled && comparator & 1 != 0).flat_map(
            |&comparator| {
                let address = comparator & 0x1FFF_FFFC;
                let replace = comparator >> 30;
                [(replace & 1 != 0).then_some(address), (replace & 2 != 0).then_some(address + 2)].into_iter().flatten()
            },
        )
    }

    pub(crate) fn remaps(&self) -> bool {
        self.enabled
            && self
                .comparators
                .iter()
                .enumerate()
                .any(|(index, &comparator)| comparator & 1 != 0 && (index >= 6 || comparator >> 30 == 0))
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0x00 => NUMBERS | u32::from(self.enabled),
            0x04 => 1 << 29 | self.remap,
            0x08..=0x24 => self.comparators[(offset / 4 - 2) as usize],
            0xFB0 | 0xFB4 => 0,
            _ => return None,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32) -> bool {
        match offset {
            0x00 => {
                // A write without the KEY bit is ignored.
                if value & 2 != 0 {
                    self.enabled = value & 1 != 0;
                }
            }
            0x04 => self.remap = value & 0x1FFF_FFE0,
            0x08..=0x24 => self.comparators[(offset / 4 - 2) as usize] = value & 0xDFFF_FFFD,
            0xFB0 => {}
            _ => return false,
        }
        true
    }
}
