//! Tests of each encoding, as the GNU assembler emits it, and of encodings that must not decode.

use crate::fp::{FpOp, cycles, decode};

fn decoded(word: u32) -> Option<FpOp> {
    decode((word >> 16) as u16, word as u16)
}

#[test]
fn each_instruction_decodes_to_its_operation_and_registers() {
    let table: &[(u32, FpOp)] = &[
        (0xEE71_0A2F, FpOp::Vadd { d: 1, n: 2, m: 31 }),
        (0xEE38_FAC0, FpOp::Vsub { d: 30, n: 17, m: 0 }),
        (0xEE62_1A22, FpOp::Vmul { d: 3, n: 4, m: 5 }),
        (0xEE62_1A62, FpOp::Vnmul { d: 3, n: 4, m: 5 }),
        (0xEE42_1A22, FpOp::Vmla { d: 3, n: 4, m: 5 }),
        (0xEE42_1A62, FpOp::Vmls { d: 3, n: 4, m: 5 }),
        (0xEE52_1A62, FpOp::Vnmla { d: 3, n: 4, m: 5 }),
        (0xEE52_1A22, FpOp::Vnmls { d: 3, n: 4, m: 5 }),
        (0xEEE2_1A22, FpOp::Vfma { d: 3, n: 4, m: 5 }),
        (0xEEE2_1A62, FpOp::Vfms { d: 3, n: 4, m: 5 }),
        (0xEED2_1A62, FpOp::Vfnma { d: 3, n: 4, m: 5 }),
        (0xEED2_1A22, FpOp::Vfnms { d: 3, n: 4, m: 5 }),
        (0xEE83_3A84, FpOp::Vdiv { d: 6, n: 7, m: 8 }),
        (0xEEF1_4AC5, FpOp::Vsqrt { d: 9, m: 10 }),
        (0xEEF0_4AC5, FpOp::Vabs { d: 9, m: 10 }),
        (0xEEF1_4A45, FpOp::Vneg { d: 9, m: 10 }),
        (0xEEF0_4A45, FpOp::Vmov { d: 9, m: 10 }),
        (0xEEF7_FA00, FpOp::VmovImmediate { d: 31, imm8: 0x70 }),
        (0xEEBC_0A00, FpOp::VmovImmediate { d: 0, imm8: 0xC0 }),
        (0xEEB3_0A0F, FpOp::VmovImmediate { d: 0, imm8: 0x3F }),
        (0xEEF4_0A41, FpOp::Vcmp { d: 1, m: 2, signals: false }),
        (0xEEF4_0AC1, FpOp::Vcmp { d: 1, m: 2, signals: true }),
        (0xEEF5_0A40, FpOp::VcmpZero { d: 1, signals: false }),
        (0xEEF5_0AC0, FpOp::VcmpZero { d: 1, signals: true }),
        (0xEEFD_0AC1, FpOp::VcvtToInteger { d: 1, m: 2, unsigned: false, toward_zero: true }),
        (0xEEFC_0AC1, FpOp::VcvtToInteger { d: 1, m: 2, unsigned: true, toward_zero: true }),
        (0xEEFD_0A41, FpOp::VcvtToInteger { d: 1, m: 2, unsigned: false, toward_zero: false }),
        (0xEEFC_0A41, FpOp::VcvtToInteger { d: 1, m: 2, unsigned: true, toward_zero: false }),
        (0xEEF8_0AC1, FpOp::VcvtFromInteger { d: 1, m: 2, unsigned: false }),
        (0xEEF8_0A41, FpOp::VcvtFromInteger { d: 1, m: 2, unsigned: true }),
        (0xEEFE_0A66, FpOp::VcvtToFixed { d: 1, unsigned: false, size: 16, fraction_bits: 3 }),
        (0xEEFF_0A40, FpOp::VcvtToFixed { d: 1, unsigned: true, size: 16, fraction_bits: 16 }),
        (0xEEFE_0AEF, FpOp::VcvtToFixed { d: 1, unsigned: false, size: 32, fraction_bits: 1 }),
        (0xEEFF_0AC0, FpOp::VcvtToFixed { d: 1, unsigned: true, size: 32, fraction_bits: 32 }),
        (0xEEFA_0A66, FpOp::VcvtFromFixed { d: 1, unsigned: false, size: 16, fraction_bits: 3 }),
        (0xEEFB_0A48, FpOp::VcvtFromFixed { d: 1, unsigned: true, size: 16, fraction_bits: 0 }),
        (0xEEFA_0AE0, FpOp::VcvtFromFixed { d: 1, unsigned: false, size: 32, fraction_bits: 31 }),
        (0xEEFB_0ACC, FpOp::VcvtFromFixed { d: 1, unsigned: true, size: 32, fraction_bits: 8 }),
        (0xEEF2_0A41, FpOp::VcvtFromHalf { d: 1, m: 2, top: false }),
        (0xEEF2_0AC1, FpOp::VcvtFromHalf { d: 1, m: 2, top: true }),
        (0xEEF3_0A41, FpOp::VcvtToHalf { d: 1, m: 2, top: false }),
        (0xEEF3_0AC1, FpOp::VcvtToHalf { d: 1, m: 2, top: true }),
        (0xEDD1_1A02, FpOp::Vldr { d: 3, words: 1, base: 1, add: true, imm8: 2 }),
        (0xED1D_3BFF, FpOp::Vldr { d: 6, words: 2, base: 13, add: false, imm8: 255 }),
        (0xEDDF_1A04, FpOp::Vldr { d: 3, words: 1, base: 15, add: true, imm8: 4 }),
        (0xED41_FA01, FpOp::Vstr { d: 31, words: 1, base: 1, add: false, imm8: 1 }),
        (0xED81_FB00, FpOp::Vstr { d: 30, words: 2, base: 1, add: true, imm8: 0 }),
        (0xECD2_2A05, FpOp::Vldm { d: 5, words: 5, base: 2, add: true, write_back: false, imm8: 5 }),
        (0xECB2_1B06, FpOp::Vldm { d: 2, words: 6, base: 2, add: true, write_back: true, imm8: 6 }),
        (0xED72_FA01, FpOp::Vldm { d: 31, words: 1, base: 2, add: false, write_back: true, imm8: 1 }),
        (0xECBD_8A10, FpOp::Vldm { d: 16, words: 16, base: 13, add: true, write_back: true, imm8: 16 }),
        (0xECBD_8B10, FpOp::Vldm { d: 16, words: 16, base: 13, add: true, write_back: true, imm8: 16 }),
        (0xECB3_0B05, FpOp::Vldm { d: 0, words: 4, base: 3, add: true, write_back: true, imm8: 5 }),
        (0xECC2_2A05, FpOp::Vstm { d: 5, words: 5, base: 2, add: true, write_back: false, imm8: 5 }),
        (0xECA2_0B20, FpOp::Vstm { d: 0, words: 32, base: 2, add: true, write_back: true, imm8: 32 }),
        (0xED22_0A02, FpOp::Vstm { d: 0, words: 2, base: 2, add: false, write_back: true, imm8: 2 }),
        (0xED2D_8B02, FpOp::Vstm { d: 16, words: 2, base: 13, add: false, write_back: true, imm8: 2 }),
        (0xED6D_0A01, FpOp::Vstm { d: 1, words: 1, base: 13, add: false, write_back: true, imm8: 1 }),
        (0xEE08_4A90, FpOp::VmovFromCore { n: 17, t: 4 }),
        (0xEE18_4A90, FpOp::VmovToCore { n: 17, t: 4 }),
        (0xEE05_6B10, FpOp::VmovFromCore { n: 10, t: 6 }),
        (0xEE25_6B10, FpOp::VmovFromCore { n: 11, t: 6 }),
        (0xEE35_6B10, FpOp::VmovToCore { n: 11, t: 6 }),
        (0xEE15_6B10, FpOp::VmovToCore { n: 10, t: 6 }),
        (0xEC46_5A31, FpOp::VmovFromCorePair { m: 3, t: 5, t2: 6 }),
        (0xEC56_5A31, FpOp::VmovToCorePair { m: 3, t: 5, t2: 6 }),
        (0xEC45_5B17, FpOp::VmovFromCorePair { m: 14, t: 5, t2: 5 }),
        (0xEC5E_5B17, FpOp::VmovToCorePair { m: 14, t: 5, t2: 14 }),
        (0xEEF1_3A10, FpOp::Vmrs { t: 3 }),
        (0xEEF1_FA10, FpOp::Vmrs { t: 15 }),
        (0xEEE1_CA10, FpOp::Vmsr { t: 12 }),
    ];
    for &(word, operation) in table {
        assert_eq!(decoded(word), Some(operation), "{word:08x}");
    }
}

#[test]
fn what_fpv4_sp_does_not_define_does_not_decode() {
    let table: &[(u32, &str)] = &[
        (0xEE71_0B2F, "VADD.F64"),
        (0xEEB0_0B41, "VMOV.F64 register"),
        (0xEEB7_0B00, "VMOV.F64 immediate"),
        (0xEEB7_0BC1, "VCVT.F32.F64"),
        (0xEEB7_0AC1, "VCVT.F64.F32"),
        (0xEEB6_0A41, "VRINTR of FPv5"),
        (0xFE00_0A00, "VSEL of FPv5"),
        (0xFE80_0A00, "VMAXNM of FPv5"),
        (0xEE83_3AC4, "VDIV with its operation bit set"),
        (0xEEF5_0A41, "VCMP with zero and a register"),
        (0xEEF7_0A80, "VMOV immediate with bit 7 set"),
        (0xEEFE_0A68, "VCVT to 16-bit fixed point with -1 fraction bits"),
        (0xEC02_0A05, "load or store multiple, neither incrementing nor decrementing"),
        (0xEC22_0A05, "the same with write-back"),
        (0xEDA2_0A05, "increment before"),
        (0xECD2_2A00, "VLDM of no register"),
        (0xECB2_FA03, "VLDM past s31"),
        (0xECB2_0B22, "VLDM of 17 double registers"),
        (0xECF2_0B02, "VLDM of d16"),
        (0xECBF_0A01, "VLDM with write-back to PC"),
        (0xED8F_0A01, "VSTR relative to PC"),
        (0xEDD1_1B02, "VLDR of d17"),
        (0xEE08_DA90, "VMOV from SP"),
        (0xEE18_FA90, "VMOV to PC"),
        (0xEE45_6B10, "VMOV of 8 bits of a double register"),
        (0xEE05_6B30, "VMOV of 16 bits of a double register"),
        (0xEC56_5A3F, "VMOV of s31 and s32"),
        (0xEC55_5A31, "VMOV of two registers to one"),
        (0xEEF0_3A10, "VMRS of FPSID"),
        (0xEEF7_3A10, "VMRS of MVFR0"),
        (0xEEE8_3A10, "VMSR of FPEXC"),
        (0xEEE1_FA10, "VMSR from PC"),
        (0xEEF1_DA10, "VMRS to SP"),
        (0xEE71_092F, "another coprocessor"),
    ];
    for &(word, name) in table {
        assert_eq!(decoded(word), None, "{word:08x}, {name}");
    }
}

#[test]
fn cycles_are_those_of_the_technical_reference_manual() {
    let table: &[(u32, (u8, u8))] = &[
        (0xEE71_0A2F, (1, 2)),   // VADD
        (0xEE42_1A22, (3, 4)),   // VMLA
        (0xEEE2_1A22, (3, 4)),   // VFMA
        (0xEE83_3A84, (1, 15)),  // VDIV
        (0xEEF4_0A41, (1, 1)),   // VCMP
        (0xEDD1_1A02, (2, 2)),   // VLDR.32
        (0xED1D_3BFF, (3, 3)),   // VLDR.64
        (0xECBD_8A10, (17, 17)), // VPOP of 16 single registers
        (0xECBD_8B10, (17, 17)), // VPOP of 8 double registers
        (0xEC46_5A31, (2, 2)),   // VMOV of a pair
        (0xEEF1_FA10, (1, 1)),   // VMRS
    ];
    for &(word, expected) in table {
        assert_eq!(cycles(decoded(word).unwrap()), expected, "{word:08x}");
    }
}

#[test]
fn no_encoding_reaches_past_the_last_register() {
    for first in 0xEC00..=0xEFFF_u16 {
        for low in 0..0x2000_u16 {
            let second = (low & 0x1E00) << 3 | 0x0A00 | low & 0x01FF;
            let last = match decode(first, second) {
                Some(FpOp::Vldr { d, words, .. } | FpOp::Vstr { d, words, .. }) => d + words - 1,
                Some(FpOp::Vldm { d, words, base, .. } | FpOp::Vstm { d, words, base, .. }) => {
                    assert!(words > 0 && base < 15, "{first:04x} {second:04x}");
                    d + words - 1
                }
                Some(FpOp::VmovFromCorePair { m, .. } | FpOp::VmovToCorePair { m, .. }) => m + 1,
                Some(FpOp::VmovFromCore { n, .. } | FpOp::VmovToCore { n, .. }) => n,
                Some(FpOp::Vadd { d, n, m } | FpOp::Vfnms { d, n, m }) => d.max(n).max(m),
                Some(
                    FpOp::VcvtToFixed { d, size, fraction_bits, .. }
                    | FpOp::VcvtFromFixed { d, size, fraction_bits, .. },
                ) => {
                    assert!(fraction_bits <= size, "{first:04x} {second:04x}");
                    d
                }
                _ => 0,
            };
            assert!(last < 32, "{first:04x} {second:04x}");
        }
    }
}
