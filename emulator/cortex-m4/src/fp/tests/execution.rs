//! Tests of registers and memory after loads, stores, transfers and faults.

use crate::fp::decode;
use crate::{Access, Bound, Bus, BusError, Config, Core, Fast, Fault, Purpose, Signals, Width};

const RAM: u32 = 0x2000_0000;

#[derive(Clone, Debug)]
struct Ram {
    words: [u32; 64],
    signals: Signals,
}

impl Ram {
    fn index(address: u32) -> Result<usize, BusError> {
        let offset = address.wrapping_sub(RAM);
        if offset < 256 { Ok(offset as usize / 4) } else { Err(BusError) }
    }
}

impl Bus for Ram {
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        Ok(self.words[Self::index(access.address)?])
    }

    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        self.words[Self::index(access.address)?] = value;
        Ok(())
    }

    fn fetch(&mut self, _address: u32) -> Result<u16, BusError> {
        Err(BusError)
    }

    fn is_constant(&self, _address: u32) -> bool {
        false
    }

    fn due(&self) -> u64 {
        u64::MAX
    }

    fn advance(&mut self, _cycle: u64) {}

    fn signals(&mut self) -> &mut Signals {
        &mut self.signals
    }

    fn wait_states(&mut self, _access: &Access, _bound: Bound) -> u32 {
        0
    }

    fn bit_banding(&self) -> bool {
        false
    }
}

fn core() -> Core<Fast> {
    let mut core = Core::new(Config {
        lines: 1,
        priority_bits: 4,
        vector_table: 0,
        systick_calibration: 0,
        systick_reference: 0,
        mpu_regions: 0,
    });
    core.store(&mut ram(), 0xE000_ED88, Width::Word, 0xF << 20, Purpose::Data).expect("CPACR exists");
    core.r = [0; 16];
    for (number, register) in core.s.iter_mut().enumerate() {
        *register = 0x5000 + number as u32;
    }
    core
}

fn ram() -> Ram {
    let mut words = [0; 64];
    for (number, word) in words.iter_mut().enumerate() {
        *word = 0xA000 + number as u32;
    }
    Ram { words, signals: Signals::default() }
}

fn execute(core: &mut Core<Fast>, ram: &mut Ram, word: u32) -> Result<(), Fault> {
    let operation = decode((word >> 16) as u16, word as u16).expect("the encoding exists");
    core.execute_fp(ram, operation)
}

#[test]
fn a_double_load_fills_its_lower_half_from_the_lower_address() {
    let (mut core, mut ram) = (core(), ram());
    core.r[1] = RAM + 16;
    execute(&mut core, &mut ram, 0xED91_3B02).unwrap(); // VLDR d3, [r1, #8]
    assert_eq!(core.s[6..8], [0xA006, 0xA007]);
    execute(&mut core, &mut ram, 0xED11_3A01).unwrap(); // VLDR s6, [r1, #-4]
    assert_eq!(core.s[6..8], [0xA003, 0xA007]);
}

#[test]
fn a_literal_load_counts_from_the_aligned_program_counter() {
    let (mut core, mut ram) = (core(), ram());
    core.r[15] = RAM + 2;
    execute(&mut core, &mut ram, 0xEDDF_1A04).unwrap(); // VLDR s3, [pc, #16]
    assert_eq!(core.s[3], 0xA005);
}

#[test]
fn a_store_writes_one_or_two_words() {
    let (mut core, mut ram) = (core(), ram());
    core.r[1] = RAM + 4;
    execute(&mut core, &mut ram, 0xED41_FA01).unwrap(); // VSTR s31, [r1, #-4]
    execute(&mut core, &mut ram, 0xED81_FB00).unwrap(); // VSTR d15, [r1]
    assert_eq!(ram.words[..4], [0x501F, 0x501E, 0x501F, 0xA003]);
}

#[test]
fn a_push_and_a_pop_restore_registers_and_stack_pointer() {
    let (mut core, mut ram) = (core(), ram());
    core.r[13] = RAM + 64;
    let before = core.s;
    execute(&mut core, &mut ram, 0xED2D_8B10).unwrap(); // VPUSH {d8-d15}
    assert_eq!(core.r[13], RAM);
    assert_eq!(ram.words[..16], before[16..]);
    core.s = [0; 32];
    execute(&mut core, &mut ram, 0xECBD_8A10).unwrap(); // VPOP {s16-s31}
    assert_eq!(core.r[13], RAM + 64);
    assert_eq!(core.s[16..], before[16..]);
    assert_eq!(core.s[..16], [0; 16]);
}

#[test]
fn a_load_multiple_without_write_back_leaves_its_base() {
    let (mut core, mut ram) = (core(), ram());
    core.r[2] = RAM + 8;
    execute(&mut core, &mut ram, 0xECD2_2A05).unwrap(); // VLDMIA r2, {s5-s9}
    assert_eq!(core.s[4..11], [0x5004, 0xA002, 0xA003, 0xA004, 0xA005, 0xA006, 0x500A]);
    assert_eq!(core.r[2], RAM + 8);
}

#[test]
fn fldmiax_with_an_odd_count_moves_its_base_one_word_more() {
    let (mut core, mut ram) = (core(), ram());
    core.r[3] = RAM;
    execute(&mut core, &mut ram, 0xECB3_0B05).unwrap(); // FLDMIAX r3!, {d0-d1}
    assert_eq!(core.s[..5], [0xA000, 0xA001, 0xA002, 0xA003, 0x5004]);
    assert_eq!(core.r[3], RAM + 20);
}

#[test]
fn an_unaligned_address_is_a_fault_before_any_access() {
    for word in [0xEDD1_1A02, 0xED91_3B02, 0xEDC1_1A02, 0xECB1_1A02, 0xECA1_1A02, 0xED21_1A02] {
        for offset in 1..4 {
            let (mut core, mut ram) = (core(), ram());
            core.r[1] = RAM + 64 + offset;
            let (registers, floats, words) = (core.r, core.s, ram.words);
            assert_eq!(execute(&mut core, &mut ram, word), Err(Fault::Unaligned), "{word:08x}");
            assert_eq!((core.r, core.s, ram.words), (registers, floats, words));
        }
    }
}

#[test]
fn a_bus_fault_within_a_multiple_transfer_keeps_the_base_register() {
    for word in [0xECB1_1A04, 0xECA1_1A04] {
        let (mut core, mut ram) = (core(), ram());
        core.r[1] = RAM + 248; // the first two words answer, the third does not
        assert_eq!(execute(&mut core, &mut ram, word), Err(Fault::BusData(RAM + 256)));
        assert_eq!(core.r[1], RAM + 248);
    }
}

#[test]
fn a_bus_fault_of_a_double_load_changes_no_register() {
    let (mut core, mut ram) = (core(), ram());
    core.r[1] = RAM + 252;
    let before = core.s;
    assert_eq!(execute(&mut core, &mut ram, 0xED91_3B00), Err(Fault::BusData(RAM + 256)));
    assert_eq!(core.s, before);
}

#[test]
fn transfers_move_bits_unchanged() {
    let (mut core, mut ram) = (core(), ram());
    (core.r[4], core.r[5], core.r[6]) = (0x7F80_0001, 5, 6);
    execute(&mut core, &mut ram, 0xEE08_4A90).unwrap(); // VMOV s17, r4
    assert_eq!(core.s[17], 0x7F80_0001);
    execute(&mut core, &mut ram, 0xEE25_6B10).unwrap(); // VMOV.32 d5[1], r6
    assert_eq!(core.s[10..12], [0x500A, 6]);
    execute(&mut core, &mut ram, 0xEC46_5A31).unwrap(); // VMOV s3, s4, r5, r6
    assert_eq!(core.s[3..5], [5, 6]);
    execute(&mut core, &mut ram, 0xEC5E_5B17).unwrap(); // VMOV r5, lr, d7
    assert_eq!((core.r[5], core.r[14]), (0x500E, 0x500F));
    execute(&mut core, &mut ram, 0xEEF1_4A45).unwrap(); // VNEG s9, s10 sets no flag
    assert_eq!((core.s[9], core.fpscr), (0x8000_500A, 0));
}

#[test]
fn an_immediate_expands_as_the_manual_says() {
    for (word, value) in [(0xEEB7_0A00_u32, 1.0_f32), (0xEEBC_0A00, -0.125), (0xEEB3_0A0F, 31.0), (0xEEB0_0A00, 2.0)] {
        let (mut core, mut ram) = (core(), ram());
        execute(&mut core, &mut ram, word).unwrap();
        assert_eq!(f32::from_bits(core.s[0]).to_bits(), value.to_bits());
    }
}

#[test]
fn fpscr_keeps_only_its_existing_bits_and_passes_flags_to_apsr() {
    let (mut core, mut ram) = (core(), ram());
    core.r[12] = 0xFFFF_FFFF;
    execute(&mut core, &mut ram, 0xEEE1_CA10).unwrap(); // VMSR fpscr, r12
    execute(&mut core, &mut ram, 0xEEF1_3A10).unwrap(); // VMRS r3, fpscr
    assert_eq!(core.r[3], 0xF7C0_009F);
    core.fpscr = 0xA000_0000;
    execute(&mut core, &mut ram, 0xEEF1_FA10).unwrap(); // VMRS APSR_nzcv, fpscr
    assert_eq!(core.flags.nzcv(), 0b1010);
    assert_eq!(core.r[15], 0);
}

#[test]
fn each_multiply_and_accumulate_has_its_signs_and_its_roundings() {
    // The exact square (1 + 2^-12)^2 is 1 + 2^-11 + 2^-24. A chained operation rounds the product first and so loses
    // the last term.
    let factor = 1.0 + 2.0_f32.powi(-12);
    let lost = 2.0_f32.powi(-24);
    let product = 1.0 + 2.0_f32.powi(-11);
    let table: [(u32, f32); 10] = [
        (0xEE42_1A22, product - 1.0),        // VMLA with s3 = -1
        (0xEE42_1A62, -1.0 - product),       // VMLS
        (0xEE52_1A62, 1.0 - product),        // VNMLA
        (0xEE52_1A22, 1.0 + product),        // VNMLS
        (0xEEE2_1A22, product - 1.0 + lost), // VFMA
        (0xEEE2_1A62, -1.0 - product),       // VFMS
        (0xEED2_1A62, 1.0 - product - lost), // VFNMA
        (0xEED2_1A22, 1.0 + product),        // VFNMS
        (0xEE62_1A22, product),              // VMUL
        (0xEE62_1A62, -product),             // VNMUL
    ];
    for (word, expected) in table {
        let (mut core, mut ram) = (core(), ram());
        core.s[3] = (-1.0_f32).to_bits();
        core.s[4] = factor.to_bits();
        core.s[5] = factor.to_bits();
        execute(&mut core, &mut ram, word).unwrap();
        assert_eq!(f32::from_bits(core.s[3]), expected, "{word:08x}");
    }
}

#[test]
fn a_conversion_to_half_precision_writes_one_half_of_its_register() {
    let (mut core, mut ram) = (core(), ram());
    core.s[2] = 1.0_f32.to_bits();
    core.s[1] = 0x1234_5678;
    execute(&mut core, &mut ram, 0xEEF3_0AC1).unwrap(); // VCVTT.F16.F32 s1, s2
    assert_eq!(core.s[1], 0x3C00_5678);
    execute(&mut core, &mut ram, 0xEEF3_0A41).unwrap(); // VCVTB.F16.F32 s1, s2
    assert_eq!(core.s[1], 0x3C00_3C00);
    core.s[2] = 0xC000_3C00;
    execute(&mut core, &mut ram, 0xEEF2_0AC1).unwrap(); // VCVTT.F32.F16 s1, s2
    assert_eq!(f32::from_bits(core.s[1]), -2.0);
}
