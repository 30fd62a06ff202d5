//! A test that the part survives whatever software writes: no panic, and no event that stays due for ever.

use crate::rig;

use cortex_m4::Width;
use emulator_part::{Part, Pin, Reset, UartFrame};
use rig::*;

/// The random generator xorshift64*, so that a failure's seed gives the same sequence everywhere.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
    }

    fn below(&mut self, limit: u32) -> u32 {
        self.next() % limit
    }
}

/// The blocks of registers to write to. DMA and timers, which have the most state, are listed several times.
#[rustfmt::skip]
const BLOCKS: [u32; 40] = [
    0x4000_0000, 0x4000_0400, 0x4000_0C00, 0x4000_1000, 0x4000_1800, 0x4000_1C00, 0x4000_2800, 0x4000_2C00, 0x4000_3000,
    0x4000_3800, 0x4000_3C00, 0x4000_4400, 0x4000_4C00, 0x4000_5400, 0x4000_5C00, 0x4000_7000, 0x4001_0000, 0x4001_0400,
    0x4001_1000, 0x4001_1400, 0x4001_2000, 0x4001_2100, 0x4001_2300, 0x4001_3000, 0x4001_3400, 0x4001_3800, 0x4001_3C00,
    0x4001_4000, 0x4002_0000, 0x4002_0400, 0x4002_0C00, 0x4002_3000, 0x4002_3C00, 0x4002_6000, 0x4002_6080, 0x4002_6400,
    0x4002_6480, 0x4002_6410, 0x4002_6010, 0x5006_0800,
];

fn run(seed: u64, accesses: u32) {
    let mut random = Random(seed);
    let mut rig = Rig::board();
    let open = |rig: &mut Rig| {
        for bus in [0x30, 0x34, 0x40, 0x44] {
            rig.write(RCC + bus, u32::MAX);
        }
        rig.set(PWR, 1 << 8);
    };
    open(&mut rig);
    for _ in 0..accesses {
        let block = BLOCKS[random.below(BLOCKS.len() as u32) as usize];
        let width = [Width::Byte, Width::Half, Width::Word, Width::Word, Width::Word][random.below(5) as usize];
        let address = block + (random.below(0x80) & !(width.bytes() - 1));
        match random.below(16) {
            0..=8 => {
                let value = match random.below(4) {
                    0 => random.next(),
                    1 => 1 << random.below(32),
                    2 => random.below(256),
                    // Each of these values is an address for a DMA stream: RAM, or a register of a peripheral.
                    _ => [0x2000_0000, 0x4001_300C, 0x4000_4404, 0x4002_6410, 0x4002_3C04][random.below(5) as usize],
                };
                let _ = rig.try_write(address, width, value);
            }
            9..=11 => {
                let _ = rig.try_read(address, width);
            }
            12 => {
                let pin = Pin::new(random.below(9) as u8, random.below(16) as u8);
                let level = [None, Some(false), Some(true)][random.below(3) as usize];
                rig.part.drive(rig.now, pin, level, &mut rig.bench);
            }
            13 => {
                let pin = Pin::new(random.below(5) as u8, random.below(16) as u8);
                let frame = UartFrame::eight_n_one(random.next() as u8, 9600 + random.below(1_000_000));
                rig.part.receive(rig.now, pin, frame, &mut rig.bench);
            }
            14 => {
                // With some settings of the clock tree the test would be slow, so it writes only these.
                let value = [2, 5 << 10 | 4 << 13 | 2, 7 << 10 | 2, 0x80 | 2, 0][random.below(5) as usize];
                rig.write(RCC + 8, value);
            }
            _ => rig.step(u64::from(random.below(20_000))),
        }
        assert!(rig.part.due() >= rig.now, "seed {seed}");
        if let Some(cause) = rig.part.take_reset() {
            rig.part.reset(rig.now, cause, &mut rig.bench);
            open(&mut rig);
        }
        rig.bench.pins.clear();
        rig.bench.frames.clear();
    }
    rig.part.reset(rig.now, Reset::PowerOn, &mut rig.bench);
    assert_eq!(rig.part.clock().hz, 16_000_000);
    rig.step(1_000_000);
    assert_eq!(rig.part.signals().lines(), &[0; 4]);
}

#[test]
fn the_part_survives_whatever_software_writes() {
    for seed in 1..=40 {
        run(seed * 0x9E37_79B9, 5_000);
    }
}
