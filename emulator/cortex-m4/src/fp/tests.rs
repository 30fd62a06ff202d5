//! Tests of FPv4-SP.
//!
//! | Module | What it compares the results with |
//! |---|---|
//! | `arithmetic` | Host arithmetic in `f32` and `f64`, on random operands |
//! | `edges` | The manual's text, in tables of edge cases |
//! | `encodings` | What the GNU assembler emits for each instruction |
//! | `execution` | The expected registers and memory after each kind of load, store and transfer |

mod arithmetic;
mod edges;
mod encodings;
mod execution;

use super::arith::RMODE_SHIFT;

const TO_PLUS: u32 = 1 << RMODE_SHIFT;
const TO_MINUS: u32 = 2 << RMODE_SHIFT;

const ONE: u32 = 0x3F80_0000;
const INFINITY: u32 = 0x7F80_0000;
const MAXIMUM: u32 = 0x7F7F_FFFF;
const LEAST_NORMAL: u32 = 0x0080_0000;
const QUIET: u32 = 0xFFC1_2345;
const SIGNALLING: u32 = 0x7F81_2345;
