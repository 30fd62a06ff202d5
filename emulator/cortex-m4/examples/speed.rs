//! Measures how many million instructions per second the core executes on each clock. The core is connected to memory
//! and one device.
//!
//! Run it with `cargo run --release --example speed -p cortex-m4`. The programs are endless loops:
//!
//! - compute: a shift-register generator fills 256 bytes of RAM, a bitwise CRC (with an IT block) is computed over
//!   these bytes, and a subroutine multiplies and accumulates 64 words.
//! - polling: the program reads a status register until a bit is set. It then exchanges data with the device and stores
//!   the result.

#[path = "../tests/common/mod.rs"]
mod common;

use std::time::Instant;

use common::Rig;
use cortex_m4::{Cost, Exit, Fast, Optimistic, Pessimistic};

#[rustfmt::skip]
const COMPUTE: &[u16] = &[
    0xF04F, 0x5000, 0x4F20, 0x2100, 0x2200, 0xEA87, 0x3747, 0xEA87, 0x4757, 0xEA87, 0x1747, 0x5487, 0x3201,
    0xF5B2, 0x7F80, 0xD1F4, 0xF04F, 0x33FF, 0x2200, 0x5C84, 0x4063, 0x2508, 0x085B, 0xBF28, 0xF083, 0x436D,
    0x3D01, 0xD1F9, 0x3201, 0xF5B2, 0x7F80, 0xD1F2, 0xF000, 0xF80C, 0xF8C0, 0x3100, 0x3101, 0xE7DD, 0x0000,
    0x0000, 0x0000, 0x0000, 0x0000, 0x0000, 0x0000, 0x0000, 0xB570, 0x2440, 0xF500, 0x7500, 0x682E, 0xFB06,
    0x7603, 0xF845, 0x6B04, 0xFBA6, 0xC603, 0xEB03, 0x13FC, 0xF3C3, 0x06C7, 0x2E80, 0xD800, 0x3303, 0x3C01,
    0xD1EF, 0xBD70, 0x0000, 0x5678, 0x1234
];

#[rustfmt::skip]
const POLLING: &[u16] = &[
    0xF04F, 0x4080, 0xF04F, 0x5300, 0x2600, 0x2100, 0x6882, 0x0794, 0xD5FC, 0x60C1, 0x68C5, 0x545D, 0x3101,
    0x2964, 0xD1F6, 0x3601, 0xE7F3
];

fn measure<C: Cost>(name: &str, code: &[u16]) {
    let mut rig = Rig::<C>::with_clock(code);
    rig.board.answer = 2;
    rig.board.logs = false;
    let begin = Instant::now();
    let mut end = 0;
    while begin.elapsed().as_millis() < 500 {
        end += 1_000_000;
        assert_eq!(rig.core.run(&mut rig.board, end), Exit::Until);
    }
    let seconds = begin.elapsed().as_secs_f64();
    let millions = rig.core.retired() as f64 / 1e6;
    let per_instruction = rig.core.cycle() as f64 / rig.core.retired() as f64;
    println!("{name:8} {:11} {:6.0} M/s, {per_instruction:.2} cycles an instruction", C::NAME, millions / seconds);
}

fn main() {
    for (name, code) in [("compute", COMPUTE), ("polling", POLLING)] {
        measure::<Fast>(name, code);
        measure::<Optimistic>(name, code);
        measure::<Pessimistic>(name, code);
    }
    let rig = Rig::new(COMPUTE);
    let begin = Instant::now();
    let copies: Vec<_> = (0..1000).map(|_| rig.core.clone()).collect();
    println!("a copy of the core takes {:.2} µs", begin.elapsed().as_secs_f64() * 1e6 / copies.len() as f64);
}
