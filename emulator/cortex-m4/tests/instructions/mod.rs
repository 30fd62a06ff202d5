//! Tests of integer instructions: each encoding is compared with the state that it leaves.
//!
//! | module | instructions | ARM ARM |
//! |---|---|---|
//! | `data_processing` | shifts, sums, immediates, moves, bit fields | A4.4 |
//! | `multiply` | multiplication and division | A4.4 |
//! | `dsp` | saturation, extension and packing, parallel sums | A4.4 |
//! | `memory` | loads, stores, exclusive accesses; bit-banding | A4.6, A4.7 |
//! | `branches` | branches, IT blocks | A4.3, A7.3 |
//!
//! Each case has the assembly, its halfwords, the number of instructions to execute, and registers and NZCV before and
//! after. RAM holds 0x80, 0x81 and so on from 0x2000_0100 on. The code begins at 0x100.

mod branches;
use crate::common;
mod data_processing;
mod dsp;
mod memory;
mod multiply;

use common::Rig;

struct Case {
    name: &'static str,
    code: &'static [u16],
    steps: usize,
    before: &'static [(u8, u32)],
    nzcv: Option<u32>,
    after: &'static [(u8, u32)],
    left: Option<u32>,
}

fn check(cases: &[Case]) {
    for case in cases {
        let mut rig = Rig::new(case.code);
        for offset in 0..16 {
            rig.board.ram[0x100 + usize::from(offset)] = 0x80 + offset;
        }
        for &(n, value) in case.before {
            rig.set(n, value);
        }
        rig.set_nzcv(case.nzcv.unwrap_or(0));
        rig.steps(case.steps);
        for &(n, value) in case.after {
            assert_eq!(rig.r(n), value, "{}: r{n} is {:#x}, not {value:#x}", case.name, rig.r(n));
        }
        if let Some(left) = case.left {
            assert_eq!(rig.nzcv(), left, "{}: NZCV", case.name);
        }
    }
}
