//! A test that the models survive any writes and any input from outside.
use crate::rig::*;
use cortex_m4::Width;
use emulator_part::{Part, Pin, SpiMode, UartFrame};

const MODELLED: [u32; 32] = [
    0x00, 0x02, 0x02, 0x03, 0x04, 0x06, 0x07, 0x07, 0x08, 0x1A, 0x0B, 0x11, 0x0C, 0x0D, 0x0E, 0x10, 0x12, 0x13, 0x14,
    0x1C, 0x1C, 0x21, 0x1E, 0x1F, 0x23, 0x24, 0x28, 0x2F, 0x03, 0x04, 0x23, 0x2D,
];

struct Numbers(u64);

impl Numbers {
    fn next(&mut self, below: u32) -> u32 {
        self.0 = self.0.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
        ((self.0 >> 33) % u64::from(below)) as u32
    }
}

#[test]
fn random_writes_and_inputs_never_panic_and_repeat_in_a_clone() {
    for seed in 0..200 {
        let mut numbers = Numbers(seed);
        let mut rig = Rig::new();
        let pick = |_| MODELLED[numbers.next(MODELLED.len() as u32) as usize];
        let blocks: Vec<u32> = (0..3).map(pick).map(|id| 0x4000_0000 + id * 0x1000).chain([P0]).collect();
        for _ in 0..1_500 {
            let block = blocks[numbers.next(blocks.len() as u32) as usize];
            let offset = match numbers.next(4) {
                0 => numbers.next(12) * 4,
                1 => 0x500 + numbers.next(40) * 4,
                2 => [0x200, 0x304, 0x308][numbers.next(3) as usize],
                _ => numbers.next(0x400) * 4,
            };
            let value = match numbers.next(6) {
                0 => 1,
                1 => numbers.next(16),
                2 => RAM + numbers.next(0x1000),
                3 => 1 << numbers.next(32),
                4 => u32::MAX,
                _ => numbers.next(u32::MAX),
            };
            rig.try_write(block + offset, Width::Word, value);
            rig.try_read(block + offset, Width::Word);
            let pin = Pin::new(0, numbers.next(32) as u8);
            match numbers.next(6) {
                0 => rig.drive(pin, numbers.next(2) == 1),
                1 => {
                    let frame = UartFrame::eight_n_one(numbers.next(256) as u8, 1 + numbers.next(2_000_000));
                    rig.part.receive(rig.now, pin, frame, &mut rig.world);
                }
                2 => rig.select(pin),
                3 => {
                    rig.part.spis_clock(rig.now, 0x55, SpiMode::Mode2, &mut rig.world);
                }
                _ => {}
            }
            for _ in 0..numbers.next(8) {
                let due = rig.deadline();
                if due < rig.now + 1_000 * MS {
                    rig.run_to(due.max(rig.now));
                }
            }
            rig.run_for(u64::from(numbers.next(200)));
        }
        let mut copy = rig.clone();
        for rig in [&mut rig, &mut copy] {
            for _ in 0..100 {
                let due = rig.deadline();
                if due != u64::MAX {
                    rig.run_to(due);
                }
            }
        }
        assert_eq!((rig.now, &rig.world.pins), (copy.now, &copy.world.pins), "seed {seed}");
        assert_eq!(rig.part.findings(), copy.part.findings(), "seed {seed}");
    }
}
