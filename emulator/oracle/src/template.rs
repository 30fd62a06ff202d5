//! Encodings of instructions as bit patterns, and random instances of such patterns.
//!
//! A pattern has 16 or 32 characters, each `0`, `1` or a letter; blanks do not count. The bits with the same letter are
//! one field, most significant bit first. A capital letter stands for a core register (3 or 4 bits), any other letter
//! for a number.

use crate::random::Random;

#[derive(Clone, Debug)]
pub(crate) struct Fields {
    value: [u32; 128],
}

impl Fields {
    #[must_use]
    pub(crate) fn get(&self, name: char) -> u32 {
        self.value[name as usize]
    }
}

/// A pattern, and a function that tells which instances are defined (not "UNPREDICTABLE" or "SEE" in the ARM ARM).
pub(crate) type Template = (&'static str, fn(&Fields) -> bool);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Instruction {
    Narrow(u16),
    /// A 32-bit instruction, with its first halfword in the upper bits.
    Wide(u32),
}

impl Instruction {
    pub(crate) fn append(self, code: &mut Vec<u16>) {
        match self {
            Self::Narrow(half) => code.push(half),
            Self::Wide(bits) => code.extend([(bits >> 16) as u16, bits as u16]),
        }
    }
}

pub(crate) fn instance(template: &Template, random: &mut Random, registers: &[u32]) -> Instruction {
    let (pattern, rule) = template;
    loop {
        let mut width = [0; 128];
        for letter in pattern.bytes().filter(u8::is_ascii_alphabetic) {
            width[letter as usize] += 1;
        }
        let mut fields = Fields { value: [0; 128] };
        for letter in (b'A'..=b'z').filter(|&l| width[l as usize] > 0) {
            let bits = width[letter as usize];
            fields.value[letter as usize] = if letter.is_ascii_uppercase() {
                loop {
                    let register = random.pick(registers);
                    if register >> bits == 0 {
                        break register;
                    }
                }
            } else {
                random.bits() >> (32 - bits)
            };
        }
        if !rule(&fields) {
            continue;
        }
        let (mut word, mut count) = (0_u32, 0);
        for letter in pattern.bytes().filter(|&b| b != b' ') {
            let bit = if letter.is_ascii_alphabetic() {
                width[letter as usize] -= 1;
                (fields.value[letter as usize] >> width[letter as usize]) & 1
            } else {
                u32::from(letter - b'0')
            };
            word = word << 1 | bit;
            count += 1;
        }
        return match count {
            16 => Instruction::Narrow(word as u16),
            32 => Instruction::Wide(word),
            other => panic!("{pattern}: {other} bits"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_in_pieces_is_filled_from_its_most_significant_bit() {
        let mut random = Random::new(1, 1);
        let template: Template = ("01000100 D 0001 DDD", |f| f.get('D') == 9);
        assert_eq!(instance(&template, &mut random, &[9, 1]), Instruction::Narrow(0x4489));
    }
}
