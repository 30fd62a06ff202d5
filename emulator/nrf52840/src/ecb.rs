//! ECB: AES-128 of one block (PS 6.7).
//!
//! | covered | PS |
//! |---|---|
//! | STARTECB, STOPECB, ENDECB, ERRORECB, ECBDATAPTR with key, clear text and cipher text | 6.7 |
//! | 7.2 µs a block | 6.7 |
//!
//! Left out: the priority of CCM over ECB.
use crate::clocks::{Clocks, cycles};
use crate::instance::{Block, Cx, Instance};
use emulator_part::Cycle;

const ENDECB: u32 = 0;
const ERRORECB: u32 = 1;
const BLOCK_TIME: u64 = cycles(7_200);

#[derive(Clone, Debug, Default)]
pub(crate) struct Ecb {
    block: Block,
    pointer: u32,
    next: Option<Cycle>,
}

impl Instance for Ecb {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x000 => self.next = Some(self.next.unwrap_or(cx.now + BLOCK_TIME)),
            0x004 => {
                if self.next.take().is_some() {
                    self.block.raise(ERRORECB, cx);
                }
            }
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        (offset == 0x504).then_some(self.pointer)
    }

    fn write(&mut self, offset: u32, value: u32, _: &mut Cx<'_>) -> bool {
        self.pointer = value;
        offset == 0x504
    }

    fn next(&self) -> Option<Cycle> {
        self.next
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        self.next = None;
        let mut take = |from: u32| {
            let mut bytes = [0; 16];
            for (n, byte) in (0..).zip(&mut bytes) {
                *byte = cx.dma_read(self.pointer.wrapping_add(from + n)).unwrap_or(0);
            }
            bytes
        };
        let (key, clear) = (take(0), take(16));
        for (n, byte) in (32..).zip(encrypt(&key, &clear)) {
            cx.dma_write(self.pointer.wrapping_add(n), byte);
        }
        self.block.raise(ENDECB, cx);
    }

    fn moves(&self) -> bool {
        self.next.is_some()
    }
}

/// Multiplies by x in the finite field of AES (FIPS 197, 4.2.1).
const fn double(byte: u8) -> u8 {
    byte << 1 ^ if byte & 0x80 != 0 { 0x1B } else { 0 }
}

/// The S-box (FIPS 197, 5.1.1), computed from powers of 3 and of its inverse.
const SBOX: [u8; 256] = {
    let mut sbox = [0; 256];
    let (mut power, mut inverse) = (1_u8, 1_u8);
    loop {
        power ^= double(power);
        inverse ^= inverse << 1;
        inverse ^= inverse << 2;
        inverse ^= inverse << 4;
        if inverse & 0x80 != 0 {
            inverse ^= 0x09;
        }
        let i = inverse;
        let mixed = i ^ i.rotate_left(1) ^ i.rotate_left(2) ^ i.rotate_left(3) ^ i.rotate_left(4);
        sbox[power as usize] = mixed ^ 0x63;
        if power == 1 {
            break;
        }
    }
    sbox[0] = 0x63;
    sbox
};

/// Encrypts one block with AES-128 (FIPS 197).
pub(crate) fn encrypt(key: &[u8; 16], clear: &[u8; 16]) -> [u8; 16] {
    let mut round_key = *key;
    let mut state = *clear;
    let mut constant = 1;
    let add = |state: &mut [u8; 16], key: &[u8; 16]| state.iter_mut().zip(key).for_each(|(byte, key)| *byte ^= key);
    add(&mut state, &round_key);
    for round in 1..=10 {
        for n in 0..4 {
            let last = SBOX[usize::from(round_key[12 + (n + 1) % 4])];
            round_key[n] ^= last ^ if n == 0 { constant } else { 0 };
        }
        for n in 4..16 {
            round_key[n] ^= round_key[n - 4];
        }
        constant = double(constant);
        let mut shifted = [0; 16];
        for (n, byte) in shifted.iter_mut().enumerate() {
            *byte = SBOX[usize::from(state[(n + n % 4 * 4) % 16])];
        }
        state = shifted;
        if round < 10 {
            for column in state.as_chunks_mut::<4>().0 {
                let [a, b, c, d] = [column[0], column[1], column[2], column[3]];
                let all = a ^ b ^ c ^ d;
                for (byte, (this, next)) in column.iter_mut().zip([(a, b), (b, c), (c, d), (d, a)]) {
                    *byte = this ^ all ^ double(this ^ next);
                }
            }
        }
        add(&mut state, &round_key);
    }
    state
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_example_of_fips_197_comes_out() {
        let key = std::array::from_fn(|n| n as u8);
        let clear = std::array::from_fn(|n| n as u8 * 0x11);
        let wanted = 0x69C4_E0D8_6A7B_0430_D8CD_B780_70B4_C55A_u128.to_be_bytes();
        assert_eq!(super::encrypt(&key, &clear), wanted);
    }
}
