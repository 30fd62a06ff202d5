//! Tests of FPv4-SP.
//!
//! | Module | What it compares with |
//! |---|---|
//! | `arithmetic` | Host arithmetic in `f32` and `f64`, and the manual's text in tables of edge cases |
//! | `encodings` | What the GNU assembler emits for each instruction |
//! | `execution` | Registers and memory after each kind of load, store and transfer |

mod arithmetic;
mod encodings;
mod execution;
