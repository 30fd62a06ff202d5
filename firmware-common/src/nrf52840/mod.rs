//! What the firmwares for the nRF52840 have in common beside that for any part: its start, its clock, its supply.
//!
//! | file | what |
//! |---|---|
//! | `start_up.rs` | the first instructions: reset reasons and watchdog |
//! | [`reset`] | why the part last started |
//! | [`debug_port`] | whether the debug port stays open |
//! | [`crystal`] | the wait for the 32 MHz crystal |
//! | `registers.rs` | the registers of these, and the µs counter; with the feature `nrf52840` |

pub mod crystal;
pub mod debug_port;
#[cfg(all(target_os = "none", feature = "nrf52840"))]
mod registers;
pub mod reset;
mod start_up;

#[cfg(all(target_os = "none", feature = "nrf52840"))]
pub use registers::{
    now_us, open_debug_port, reset_reason, start_counter, start_crystal, watch_supply, COUNTER_PRESCALER, NOW_CAPTURE,
    POWER_FAIL_MV,
};
