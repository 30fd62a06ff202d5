//! TEMP: the die temperature (PS 6.28).
//!
//! Covered: START, STOP, DATARDY 36 µs after START, TEMP in quarter degrees, and the calibration registers as storage.
//! Left out: the effect of the calibration. The temperature is a setting.
use crate::clocks::{Clocks, cycles};
use crate::instance::{Block, Cx, Instance, index};

/// The cycles from START to DATARDY (PS 6.28, tTEMP: 36 µs).
const MEASUREMENT: u64 = cycles(36_000);
/// The reset values of A0 to A5, B0 to B5 and T0 to T4.
const CALIBRATION: [u32; 17] = [
    0x326, 0x348, 0x3AA, 0x40E, 0x4BD, 0x5A3, 0x3FEF, 0x3FBE, 0x3FBE, 0x12, 0x124, 0x27C, 0xE2, 0x00, 0x19, 0x3C, 0x50,
];

#[derive(Clone, Debug)]
pub(crate) struct Temp {
    block: Block,
    quarters: i32,
    measured: u32,
    calibration: [u32; CALIBRATION.len()],
    next: Option<u64>,
}

impl Temp {
    pub(crate) fn new(quarters: i32) -> Self {
        Self { block: Block::default(), quarters, measured: 0, calibration: CALIBRATION, next: None }
    }
}

fn calibration(offset: u32) -> Option<usize> {
    index(offset, 0x520, 4, 6)
        .or_else(|| index(offset, 0x540, 4, 6).map(|n| 6 + n))
        .or_else(|| index(offset, 0x560, 4, 5).map(|n| 12 + n))
}

impl Instance for Temp {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 => self.next = Some(cx.now + MEASUREMENT),
            0x004 => self.next = None,
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: u64, _: &Clocks) -> Option<u32> {
        if offset == 0x508 { Some(self.measured) } else { calibration(offset).map(|n| self.calibration[n]) }
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        if let Some(n) = calibration(offset) {
            self.calibration[n] = value;
        }
        offset == 0x508 || calibration(offset).is_some()
    }

    fn next(&self) -> Option<u64> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        self.next = None;
        self.measured = self.quarters.cast_unsigned();
        self.block.raise(0, cx);
    }
}
