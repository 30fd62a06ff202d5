//! The registers behind the firmware
//!
//! # Design
//!
//! The HAL sets up clocks and the watchdog. This folder has what the HAL's types do not offer: DMA streams that run for
//! ever or that another task finishes, a timer whose period must not be rounded, and pins that are set up from a table.
//!
//! | module | what it holds |
//! |---|---|
//! | [`clock`] | the choice of the oscillator, and what happens when the oscillator fails |
//! | [`cycle_timer`] | TIM2: ticks, slots, and the command that fires a frame |
//! | [`radio`] | the front end: SPI1, chip select, IRQ pin, TIM5; switching the field off |
//! | [`gnss`] | the sources of the receivers' bytes |
//! | [`buffers`] | the bytes from the receivers and the messages to them |
//! | [`uart`], [`ddc`], [`spi`] | a receiver on a UART, on I2C, on SPI |
//! | [`steps`] | the one-shot timers of I2C and SPI |
//! | [`dma`] | DMA streams |
//! | [`gpio`] | pins |
//! | [`state_inputs`] | the pairs of pins that tell HORUS's state |
//! | [`registers`] | addresses of register blocks that a task may own |
//! | [`supply`] | the brown-out level, and what happens when the supply falls |
//! | [`reset`] | the reason of the last reset, the number of resets by the watchdog, the receivers that stay excluded |
//! | `start_up` | the first instructions: reset flags and watchdog |
//!
//! Each file in this folder with `unsafe` code says in its heading why. All of these files access register blocks
//! through shared references: a register block is always there, and every access is volatile.
//!
//! # Errata (ES0206 rev 24, STM32F42x and F43x) that concern all of these files; each module lists its own
//!
//! - ES0206 2.2.6: a write to the watchdog may be buffered whatever the MPU says, if APB has no prescaler. But APB1 has
//!   one.
//! - ES0206 2.8.3, 2.8.4: PVU and RVU are not cleared if APB is too slow. But APB1 has 36 MHz, and no code waits for
//!   them.
//! - Cortex-M4 erratum 776924: VDIV/VSQRT may give a wrong result if interrupted by a very short handler. Workaround:
//!   every handler takes more than the 14 cycles that the erratum names.
//! - Cortex-M4 erratum 838869: a store right before exception return may make the processor return to the wrong vector.
//!   Workaround: [`settle`] (DSB) ends every handler.
//!
//! `unsafe` is used here for the symbol under which the telemetry is found.
#![allow(unsafe_code)]
// RTIC generates public types for its resources, so the types in those resources must be public too.
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

/// The counters that a debugger or the bench reads.
#[no_mangle]
pub static HORUS_TELEMETRY: Telemetry = Telemetry::new();

/// Waits until a handler's writes have arrived before the handler returns. Otherwise a flag that is still set would
/// call the handler again, and erratum 838869 requires the wait, too.
pub fn settle() {
    asm::dsb();
}

/// Returns the RAM that other hardware than the processor accesses: the memory that DMA reaches, and the telemetry.
pub fn shared_memory() -> [Range<u32>; APART - 2] {
    let [rings, outboxes] = buffers::memory();
    let [spi_in, spi_out] = spi::memory();
    let [frame, short_out, short_in, discard] = radio::memory();
    let telemetry = memory::span(&HORUS_TELEMETRY);
    [telemetry, rings, outboxes, ddc::memory(), spi_in, spi_out, frame, short_out, short_in, discard]
}

/// Puts the board into its safe state: the RF field is off. All interrupts must be masked for good.
pub fn safe_state() {
    radio::field_off();
}
