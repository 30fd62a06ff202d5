//! The registers behind the firmware
//!
//! # Design
//!
//! The HAL sets up clocks and the watchdog. What is here is below its types: DMA streams that run for ever or are
//! started and finished in different tasks, a timer whose period must not be rounded, and pins that are set up from a
//! table. Which pin, stream, vector and clock is whose is in `board.rs`.
//!
//! | module | what it holds |
//! |---|---|
//! | [`clock`] | the choice of the oscillator, and what happens when it fails |
//! | [`cycle_timer`] | TIM2: ticks, slots, and the command that fires a frame |
//! | [`radio`] | the front end: SPI1, chip select, IRQ pin, TIM5; the field off |
//! | [`gnss`] | the receivers' sources |
//! | [`buffers`] | what comes from the receivers and goes to them |
//! | [`uart`], [`ddc`], [`spi`] | a receiver on a UART, on I2C, on SPI |
//! | [`steps`] | one-shot timers of those |
//! | [`dma`] | DMA streams |
//! | [`gpio`] | pins |
//! | [`state_inputs`] | the pairs of pins that tell HORUS's state |
//! | [`registers`] | addresses of register blocks that a task may own |
//! | [`supply`] | the brown-out level, and what happens when the supply falls |
//! | [`reset`] | the reason of the last reset, how many the watchdog has made, who is excluded over them |
//! | `start_up` | the first instructions: reset flags and watchdog |
//!
//! `main.rs` denies `unsafe` code; each file in this folder allows it for itself, and says in its heading what for. All
//! of them access register blocks through shared references: such a block is always there, and every access is
//! volatile.
//!
//! # Errata (ES0206 rev 24, STM32F42x and F43x) that concern all of it; each module lists its own
//!
//! - 2.2.6: a write to the watchdog may be buffered whatever the MPU says, if APB has no prescaler. Here: APB1 has one.
//! - 2.8.3, 2.8.4: PVU, RVU not cleared when APB is too slow. Here: APB1 runs at 36 MHz; nothing waits for them.
//! - Cortex-M4 776924: VDIV/VSQRT may be wrong if interrupted by a very short handler. Here: every handler does more
//!   than the 14 cycles it names.
//! - Cortex-M4 838869: a store right before exception return may return to the wrong vector. Here: [`settle`] (DSB)
//!   ends every handler.
//!
//! `unsafe` here: the symbol under which the telemetry is found.
#![allow(unsafe_code)]
// RTIC's generated resource types are public, and so must be what they hold.
#![allow(unreachable_pub)]

use core::ops::Range;

use cortex_m::asm;
use firmware_common::{memory, patrol::ram::APART};
use horus_tx_fw::{protection, telemetry::Telemetry};

use crate::board;

pub mod buffers;
pub mod clock;
pub mod cycle_timer;
mod ddc;
mod dma;
pub mod gnss;
mod gpio;
pub mod radio;
mod registers;
pub mod reset;
mod spi;
mod start_up;
pub mod state_inputs;
mod steps;
pub mod supply;
mod uart;

firmware_common::install_safe_state!(safe_state, protection::area, board::task_of);

/// What the debugger or the bench reads.
#[no_mangle]
pub static HORUS_TELEMETRY: Telemetry = Telemetry::new();

/// Makes sure that what a handler has written has arrived before it returns: a flag that is still set at the interrupt
/// controller would call it again, and erratum 838869.
pub fn settle() {
    asm::dsb();
}

/// RAM that not the processor alone reads and writes: what DMA reaches, and the telemetry.
pub fn shared_memory() -> [Range<u32>; APART - 2] {
    let [rings, outboxes] = buffers::memory();
    let [spi_in, spi_out] = spi::memory();
    let [frame, short_out, short_in, discard] = radio::memory();
    let telemetry = memory::span(&HORUS_TELEMETRY);
    [telemetry, rings, outboxes, ddc::memory(), spi_in, spi_out, frame, short_out, short_in, discard]
}

/// Puts the board into its safe state: the RF field is off. All interrupts must be masked, for ever.
pub fn safe_state() {
    radio::field_off();
}
