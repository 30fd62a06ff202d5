//! Measures the time of a slice of the patrol, over flash and RAM of this suite.

use firmware_common::patrol::{ram::APART, Layout, PartMemory, Patrol};
use hold_fw::integrity;
use on_target_tests::cycles::{bounds, Cycles, Taken};

/// The memory of this suite that stands for the firmware's: as many words as some passes need, and the guard words.
static mut RAM: [u32; 64] = [0; 64];

pub(crate) fn slices(cycles: &Cycles) {
    let ram = &raw const RAM as u32;
    let guards = [0, 2, 4, 6, 8].map(|word| ram + 4 * word);
    let layout = Layout {
        program: 0..4 * 256,
        shut_end: 0,
        code: 0..0,
        code_load: 0,
        guards,
        used: ram + 4 * 16..ram + 4 * 64,
        apart: [const { 0..0 }; APART],
    };
    let mut memory = PartMemory::take();
    let mut patrol = Patrol::new(layout, integrity::RATE, &mut memory);
    let (mut taken, mut passes) = (Taken::NONE, [0; 2]);
    for number in 0..100 {
        let (took, slice) = cycles.timed(|| patrol.slice(&mut memory));
        defmt::assert!(slice.guard.is_none() && slice.ram.is_none() && slice.code.is_none());
        passes[0] += u32::from(slice.flash.is_some());
        passes[1] += u32::from(slice.ram_pass.is_some());
        if number > 0 {
            taken.note(took);
        }
    }
    defmt::assert!(passes[0] >= 5 && passes[1] >= 5, "{}", passes);
    taken.assert("Patrol::slice", bounds(1_500, 1_200, 4_400, u32::MAX));
}
