//! Templates of instructions that use nothing but registers and flags, ARM ARM A5.2, A5.3.

use crate::template::{Fields, Template};

fn any(_: &Fields) -> bool {
    true
}

/// Whether a modified immediate is defined (ThumbExpandImm). A byte that is repeated must not be zero.
fn modified(f: &Fields) -> bool {
    let i = f.get('i');
    i >> 10 != 0 || i >> 8 == 0 || i & 0xFF != 0
}

/// 16-bit shifts, additions, subtractions, moves, compares, data processing, extensions and reversals.
pub(crate) const NARROW: &[Template] = &[
    ("000 00 iiiii MMM DDD", any),
    ("000 01 iiiii MMM DDD", any),
    ("000 10 iiiii MMM DDD", any),
    ("00011 xx MMM NNN DDD", any),
    ("001 xx DDD iiiiiiii", any),
    ("010000 xxxx MMM DDD", any),
    ("010000 xxxx MMM DDD", any),
    ("010000 xxxx MMM DDD", any),
    ("01000100 D MMMM DDD", any),
    ("01000100 D 1101 DDD", any),
    ("01000100 D 1111 DDD", any),
    ("01000101 N MMMM NNN", |f| f.get('N') > 7 || f.get('M') > 7),
    ("01000101 N 1101 NNN", any),
    ("01000110 D MMMM DDD", any),
    ("01000110 D 1101 DDD", any),
    ("01000110 D 1111 DDD", any),
    ("10100 DDD iiiiiiii", any),
    ("10101 DDD iiiiiiii", any),
    ("10110000 xiiiiiii", any),
    ("10110010 xx MMM DDD", any),
    ("10111010 xx MMM DDD", |f| f.get('x') != 2),
    ("10111111 00000000", any),
];

/// 32-bit data processing with an immediate.
pub(crate) const IMMEDIATE: &[Template] = &[
    ("11110i0 0000s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 00001 NNNN 0iii 1111 iiiiiiii", modified),
    ("11110i0 0001s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 0010s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 0010s 1111 0iii DDDD iiiiiiii", modified),
    ("11110i0 0011s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 0011s 1111 0iii DDDD iiiiiiii", modified),
    ("11110i0 0100s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 01001 NNNN 0iii 1111 iiiiiiii", modified),
    ("11110i0 1000s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 1000s 1101 0iii DDDD iiiiiiii", modified),
    ("11110i0 10001 NNNN 0iii 1111 iiiiiiii", modified),
    ("11110i0 1010s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 1011s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 1101s NNNN 0iii DDDD iiiiiiii", modified),
    ("11110i0 1101s 1101 0iii DDDD iiiiiiii", modified),
    ("11110i0 11011 NNNN 0iii 1111 iiiiiiii", modified),
    ("11110i0 1110s NNNN 0iii DDDD iiiiiiii", modified),
    // ADDW, SUBW, ADR, MOVW and MOVT.
    ("11110i1 00000 NNNN 0iii DDDD iiiiiiii", any),
    ("11110i1 00000 1101 0iii DDDD iiiiiiii", any),
    ("11110i1 00000 1111 0iii DDDD iiiiiiii", any),
    ("11110i1 01010 NNNN 0iii DDDD iiiiiiii", any),
    ("11110i1 01010 1101 0iii DDDD iiiiiiii", any),
    ("11110i1 01010 1111 0iii DDDD iiiiiiii", any),
    ("11110i1 00100 iiii 0iii DDDD iiiiiiii", any),
    ("11110i1 01100 iiii 0iii DDDD iiiiiiii", any),
];

/// 32-bit data processing with a shifted register.
pub(crate) const SHIFTED: &[Template] = &[
    ("1110101 0000s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 00001 NNNN 0iii 1111 iitt MMMM", any),
    ("1110101 0001s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 0010s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 0010s 1111 0iii DDDD iitt MMMM", any),
    ("1110101 0010s 1111 0iii DDDD iitt MMMM", any),
    ("1110101 0011s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 0011s 1111 0iii DDDD iitt MMMM", any),
    ("1110101 0100s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 01001 NNNN 0iii 1111 iitt MMMM", any),
    ("1110101 01100 NNNN 0iii DDDD iit0 MMMM", any),
    ("1110101 1000s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 1000s 1101 0iii DDDD iitt MMMM", any),
    ("1110101 10001 NNNN 0iii 1111 iitt MMMM", any),
    ("1110101 1010s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 1011s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 1101s NNNN 0iii DDDD iitt MMMM", any),
    ("1110101 1101s 1101 0iii DDDD iitt MMMM", any),
    ("1110101 11011 NNNN 0iii 1111 iitt MMMM", any),
    ("1110101 1110s NNNN 0iii DDDD iitt MMMM", any),
    ("11111010 0xxs NNNN 1111 DDDD 0000 MMMM", any),
];

/// 32-bit bit fields, extension, reversal and counting; MSR and MRS of the flags.
pub(crate) const FIELDS: &[Template] = &[
    ("1111001101 00 NNNN 0iii DDDD ii0wwwww", |f| f.get('i') + f.get('w') <= 31),
    ("1111001111 00 NNNN 0iii DDDD ii0wwwww", |f| f.get('i') + f.get('w') <= 31),
    ("1111001101 10 NNNN 0iii DDDD ii0wwwww", |f| f.get('i') <= f.get('w')),
    ("1111001101 10 1111 0iii DDDD ii0wwwww", |f| f.get('i') <= f.get('w')),
    ("11111010 0xxx NNNN 1111 DDDD 10rr MMMM", |f| f.get('x') < 6),
    ("11111010 0xxx 1111 1111 DDDD 10rr MMMM", |f| f.get('x') < 6),
    ("111110101001 MMMM 1111 DDDD 10xx NNNN", |f| f.get('M') == f.get('N')),
    ("111110101011 MMMM 1111 DDDD 1000 NNNN", |f| f.get('M') == f.get('N')),
    ("111100111110 1111 1000 DDDD 00000000", any),
    ("111100111000 NNNN 1000 xx00 00000000", |f| f.get('x') != 0),
];

/// 32-bit saturation, parallel addition and subtraction, and SEL.
pub(crate) const PARALLEL: &[Template] = &[
    ("1111001100 t0 NNNN 0iii DDDD ii0wwwww", |f| f.get('t') == 0 || f.get('i') != 0),
    ("1111001110 t0 NNNN 0iii DDDD ii0wwwww", |f| f.get('t') == 0 || f.get('i') != 0),
    ("1111001100 10 NNNN 0000 DDDD 0000wwww", any),
    ("1111001110 10 NNNN 0000 DDDD 0000wwww", any),
    ("111110101xxx NNNN 1111 DDDD 0upp MMMM", |f| matches!(f.get('x'), 0 | 1 | 2 | 4 | 5 | 6) && f.get('p') < 3),
    ("111110101xxx NNNN 1111 DDDD 0upp MMMM", |f| matches!(f.get('x'), 0 | 1 | 2 | 4 | 5 | 6) && f.get('p') < 3),
    ("111110101xxx NNNN 1111 DDDD 0upp MMMM", |f| matches!(f.get('x'), 0 | 1 | 2 | 4 | 5 | 6) && f.get('p') < 3),
    ("111110101000 NNNN 1111 DDDD 10xx MMMM", any),
    ("111110101010 NNNN 1111 DDDD 1000 MMMM", any),
];

/// 32-bit multiplication and division.
pub(crate) const MULTIPLY: &[Template] = &[
    ("111110110000 NNNN AAAA DDDD 0000 MMMM", any),
    ("111110110000 NNNN 1111 DDDD 0000 MMMM", any),
    ("111110110000 NNNN AAAA DDDD 0001 MMMM", any),
    ("111110110001 NNNN AAAA DDDD 00xx MMMM", any),
    ("111110110001 NNNN 1111 DDDD 00xx MMMM", any),
    ("111110110010 NNNN AAAA DDDD 000x MMMM", any),
    ("111110110010 NNNN 1111 DDDD 000x MMMM", any),
    ("111110110011 NNNN AAAA DDDD 000x MMMM", any),
    ("111110110011 NNNN 1111 DDDD 000x MMMM", any),
    ("111110110100 NNNN AAAA DDDD 000x MMMM", any),
    ("111110110100 NNNN 1111 DDDD 000x MMMM", any),
    ("111110110101 NNNN AAAA DDDD 000x MMMM", any),
    ("111110110101 NNNN 1111 DDDD 000x MMMM", any),
    ("111110110110 NNNN AAAA DDDD 000x MMMM", any),
    ("111110110111 NNNN AAAA DDDD 0000 MMMM", any),
    ("111110110111 NNNN 1111 DDDD 0000 MMMM", any),
    ("111110111000 NNNN LLLL HHHH 0000 MMMM", two),
    ("111110111010 NNNN LLLL HHHH 0000 MMMM", two),
    ("111110111100 NNNN LLLL HHHH 0000 MMMM", two),
    ("111110111100 NNNN LLLL HHHH 10xx MMMM", two),
    ("111110111100 NNNN LLLL HHHH 110x MMMM", two),
    ("111110111101 NNNN LLLL HHHH 110x MMMM", two),
    ("111110111110 NNNN LLLL HHHH 0000 MMMM", two),
    ("111110111110 NNNN LLLL HHHH 0110 MMMM", two),
    ("111110111001 NNNN 1111 DDDD 1111 MMMM", any),
    ("111110111011 NNNN 1111 DDDD 1111 MMMM", any),
];

fn two(f: &Fields) -> bool {
    f.get('L') != f.get('H')
}

/// FPv4-SP arithmetic and moves between s registers.
pub(crate) const FP_ARITHMETIC: &[Template] = &[
    // VMLA, VMLS, VNMLA, VNMLS, VMUL, VNMUL, VADD, VSUB, VDIV, VFNMA, VFNMS, VFMA and VFMS.
    ("111011100 d00 nnnn dddd 1010 n o m 0 mmmm", any),
    ("111011100 d01 nnnn dddd 1010 n o m 0 mmmm", any),
    ("111011100 d10 nnnn dddd 1010 n o m 0 mmmm", any),
    ("111011100 d11 nnnn dddd 1010 n o m 0 mmmm", any),
    ("111011101 d00 nnnn dddd 1010 n 0 m 0 mmmm", any),
    ("111011101 d01 nnnn dddd 1010 n o m 0 mmmm", any),
    ("111011101 d10 nnnn dddd 1010 n o m 0 mmmm", any),
    ("111011101 d00 nnnn dddd 1010 n 0 m 0 mmmm", any),
    // VMOV of an immediate and of a register, VABS, VNEG and VSQRT.
    ("111011101 d11 iiii dddd 1010 0000 iiii", any),
    ("111011101 d11 000x dddd 1010 x1 m 0 mmmm", any),
    ("111011101 d11 000x dddd 1010 x1 m 0 mmmm", any),
    ("111011101 d11 0001 dddd 1010 11 m 0 mmmm", any),
];

/// FPv4-SP comparison and conversion.
pub(crate) const FP_CONVERT: &[Template] = &[
    // VCVTB, VCVTT, and VCMP and VCMPE with a register and with zero.
    ("111011101 d11 001x dddd 1010 t1 m 0 mmmm", any),
    ("111011101 d11 001x dddd 1010 t1 m 0 mmmm", any),
    ("111011101 d11 0100 dddd 1010 e1 m 0 mmmm", any),
    ("111011101 d11 0101 dddd 1010 e1 0 0 0000", any),
    // VCVT with integers, VCVTR, and VCVT with fixed point of 16 and 32 bits.
    ("111011101 d11 1000 dddd 1010 x1 m 0 mmmm", any),
    ("111011101 d11 110x dddd 1010 r1 m 0 mmmm", any),
    ("111011101 d11 110x dddd 1010 r1 m 0 mmmm", any),
    ("111011101 d11 1o1u dddd 1010 01 i 0 iiii", |f| fraction(f, 16)),
    ("111011101 d11 1o1u dddd 1010 11 i 0 iiii", |f| fraction(f, 32)),
    // VMRS copies the flags to APSR.
    ("111011101111 0001 1111 1010 0001 0000", any),
];

/// Whether the number of fraction bits, `size` minus imm4:i, is not negative. The field has i as its first bit, and
/// imm4 behind it.
fn fraction(f: &Fields, size: u32) -> bool {
    let i = f.get('i');
    ((i & 0xF) << 1 | i >> 4) <= size
}

/// FPv4-SP moves between core registers and s registers, and accesses to FPSCR.
pub(crate) const FP_MOVE: &[Template] = &[
    ("11101110000 o nnnn TTTT 1010 n 0010000", any),
    ("11101110000 o nnnn TTTT 1010 n 0010000", any),
    ("11101110 00x0 nnnn TTTT 1011 0 0010000", any),
    ("11101110 00x1 nnnn TTTT 1011 0 0010000", any),
    ("111011000101 HHHH LLLL 1010 00 m 1 mmmm", |f| f.get('m') != 0x1F && f.get('H') != f.get('L')),
    ("111011000100 HHHH LLLL 1010 00 m 1 mmmm", |f| f.get('m') != 0x1F),
    ("111011000101 HHHH LLLL 1011 0001 mmmm", |f| f.get('H') != f.get('L')),
    ("111011000100 HHHH LLLL 1011 0001 mmmm", any),
    ("111011101111 0001 TTTT 1010 0001 0000", any),
    ("111011101110 0001 TTTT 1010 0001 0000", any),
];
