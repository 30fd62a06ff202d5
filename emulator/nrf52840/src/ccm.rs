//! CCM: AES-CCM of Bluetooth Low Energy packets (PS 6.4).
//!
//! | covered | PS |
//! |---|---|
//! | KSGEN, CRYPT, STOP; ENDKSGEN, ENDCRYPT; ENDKSGEN_CRYPT | 6.4 |
//! | the nonce from counter, direction and vector; encryption with a MIC, decryption with MICSTATUS | 6.4 |
//! | 5-bit and 8-bit lengths; the four data rates | 6.4 |
//!
//! The cipher is that of the Bluetooth Core Specification, volume 6, part E, chapter 2.
//!
//! | left out | why |
//! |---|---|
//! | RATEOVERRIDE, and AAR, which shares the block | both make a finding |
//! | the contents of the scratch area | no document defines them |
//! | MAXPACKETSIZE | the register only stores the written value |
//!
//! Assumed: key stream generation takes 50 µs, and a packet takes its time on the air, with its MIC.
use crate::clocks::{Clocks, cycles};
use crate::ecb::encrypt;
use crate::instance::{Act, Block, Cx, Instance, address_of};
use emulator_part::Cycle;

const ENDKSGEN: u32 = 0;
const ENDCRYPT: u32 = 1;
const ENDKSGEN_CRYPT: u32 = 0;

const CCM: u32 = 2;
const AAR: u32 = 3;
const KEY_STREAM: u64 = cycles(50_000);
/// The size of a packet's header, length and one reserved byte, bytes.
const HEADER: u32 = 3;
const MIC: usize = 4;

#[derive(Clone, Debug)]
pub(crate) struct Ccm {
    block: Block,
    enable: u32,
    mode: u32,
    plain: [u32; 6],
    micstatus: u32,
    ready_at: Option<Cycle>,
    done_at: Option<Cycle>,
}

impl Default for Ccm {
    fn default() -> Self {
        Self {
            block: Block::default(),
            enable: 0,
            mode: 1,
            plain: [0, 0, 0, 0, 0xFB, 0],
            micstatus: 0,
            ready_at: None,
            done_at: None,
        }
    }
}

/// The key stream of block `n` (part E, 2.3). Block 0 encrypts the MIC.
fn stream(key: &[u8; 16], nonce: &[u8; 13], n: u16) -> [u8; 16] {
    let mut block = [0; 16];
    block[0] = 0x01;
    block[1..14].copy_from_slice(nonce);
    block[14..].copy_from_slice(&n.to_be_bytes());
    encrypt(key, &block)
}

/// The MIC of a payload before encryption (part E, 2.2).
fn authenticate(key: &[u8; 16], nonce: &[u8; 13], header: u8, clear: &[u8]) -> [u8; MIC] {
    let mut first = [0; 16];
    first[0] = 0x49;
    first[1..14].copy_from_slice(nonce);
    first[15] = clear.len() as u8;
    let mut second = [0; 16];
    // The cipher's additional data is the header byte without the bits that change when a packet is sent again.
    (second[1], second[2]) = (1, header & 0xE3);
    let mut state = encrypt(key, &first);
    let mut chain = |block: &[u8]| {
        state.iter_mut().zip(block).for_each(|(byte, with)| *byte ^= with);
        state = encrypt(key, &state);
    };
    chain(&second);
    clear.chunks(16).for_each(&mut chain);
    [state[0], state[1], state[2], state[3]]
}

/// Encrypts or decrypts a payload, which is the same operation.
fn cipher(key: &[u8; 16], nonce: &[u8; 13], bytes: &mut [u8]) {
    for (n, chunk) in (1..).zip(bytes.chunks_mut(16)) {
        chunk.iter_mut().zip(stream(key, nonce, n)).for_each(|(byte, with)| *byte ^= with);
    }
}

impl Ccm {
    fn input_length(&self, cx: &mut Cx<'_>) -> usize {
        let length = cx.dma_read(self.plain[1].wrapping_add(1)).unwrap_or(0);
        usize::from(if self.mode >> 24 & 1 != 0 { length } else { length & 0x1F })
    }

    fn crypt(&mut self, cx: &mut Cx<'_>) {
        let [config, input, output, ..] = self.plain;
        let mut take = |at: u32, n: usize| -> Vec<u8> {
            (0..n as u32).map(|n| cx.dma_read(at.wrapping_add(n)).unwrap_or(0)).collect()
        };
        // The data structure has the key, 39 bits of counter, three ignored bytes, the direction, and the vector.
        let settings = take(config, 33);
        let mut key = [0; 16];
        key.copy_from_slice(&settings[..16]);
        let mut nonce = [0; 13];
        nonce[..5].copy_from_slice(&settings[16..21]);
        nonce[4] = nonce[4] & 0x7F | settings[24] << 7;
        nonce[5..].copy_from_slice(&settings[25..33]);
        let head = take(input, HEADER as usize);
        let length = self.input_length(cx);
        let mut bytes: Vec<u8> =
            (0..length as u32).map(|n| cx.dma_read(input.wrapping_add(HEADER + n)).unwrap_or(0)).collect();
        let decrypts = self.mode & 1 != 0;
        self.micstatus = 0;
        let mut mask = stream(&key, &nonce, 0);
        if decrypts && length > MIC {
            let sent = bytes.split_off(length - MIC);
            cipher(&key, &nonce, &mut bytes);
            let mic = authenticate(&key, &nonce, head[0], &bytes);
            mask.iter_mut().zip(mic).for_each(|(byte, with)| *byte ^= with);
            self.micstatus = u32::from(mask[..MIC] == sent);
        } else if !decrypts && length > 0 {
            let mic = authenticate(&key, &nonce, head[0], &bytes);
            mask.iter_mut().zip(mic).for_each(|(byte, with)| *byte ^= with);
            cipher(&key, &nonce, &mut bytes);
            bytes.extend_from_slice(&mask[..MIC]);
        }
        let mut put = |n: u32, byte: u8| cx.dma_write(output.wrapping_add(n), byte);
        put(0, head[0]);
        put(1, bytes.len() as u8);
        put(2, head[2]);
        for (n, &byte) in (HEADER..).zip(&bytes) {
            put(n, byte);
        }
    }
}

impl Instance for Ccm {
    crate::instance::block!();

    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        if self.enable != CCM && offset != 0x008 {
            cx.misuse("a task while CCM is not enabled; ENABLE", self.enable);
            return true;
        }
        match offset {
            0x000 => self.ready_at = Some(cx.now + KEY_STREAM),
            0x004 => {
                // A byte takes 8, 4, 64 or 16 µs at 1 Mbit/s, 2 Mbit/s, 125 kbit/s or 500 kbit/s.
                let byte = [8, 4, 64, 16][(self.mode >> 16 & 3) as usize];
                // The length of an encrypted packet includes its MIC.
                let mic = if self.mode & 1 == 0 { MIC } else { 0 };
                let bytes = self.input_length(cx) + HEADER as usize + mic;
                self.done_at = Some(cx.now + cycles(1_000) * byte * bytes as u64);
            }
            0x008 => (self.ready_at, self.done_at) = (None, None),
            _ => return false,
        }
        true
    }

    fn read(&self, offset: u32, _: Cycle, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x400 => self.micstatus,
            0x500 => self.enable,
            0x504 => self.mode,
            0x508..=0x51C => self.plain[(offset as usize - 0x508) / 4],
            _ => return None,
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x500 => {
                self.enable = value & 3;
                if self.enable == AAR {
                    cx.unmodelled("AAR enabled; ENABLE", value);
                }
                if self.enable != CCM {
                    (self.ready_at, self.done_at) = (None, None);
                }
            }
            0x504 => self.mode = value & 0x0103_0001,
            0x508..=0x51C => self.plain[(offset as usize - 0x508) / 4] = value,
            _ => return false,
        }
        true
    }

    fn next(&self) -> Option<Cycle> {
        [self.ready_at, self.done_at].into_iter().flatten().min()
    }

    fn due(&mut self, cx: &mut Cx<'_>) {
        let now = cx.now;
        if self.ready_at.take_if(|at| *at <= now).is_some() {
            self.block.raise(ENDKSGEN, cx);
            if self.block.short(ENDKSGEN_CRYPT) {
                let crypt = address_of(cx.id) + 0x004;
                cx.act(Act::Task(crypt));
            }
        }
        if self.done_at.take_if(|at| *at <= now).is_some() {
            self.crypt(cx);
            self.block.raise(ENDCRYPT, cx);
        }
    }

    fn moves(&self) -> bool {
        self.done_at.is_some()
    }
}
