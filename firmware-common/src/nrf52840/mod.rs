//! Code that both firmwares for the nRF52840 need: start, clock, supply.
//!
//! | file | content |
//! |---|---|
//! | `start_up.rs` | the first instructions: reset reasons and watchdog |
//! | [`reset`] | the reason of the last reset |
//! | [`debug_port`] | keeps the debug port open |
//! | [`crystal`] | the wait for the 32 MHz crystal |
//! | `registers.rs` | the register accesses of these files, and the µs counter (feature `nrf52840`) |

/// Reads and clears an event register. Then waits until the write has reached the peripheral, so that the event does
/// not raise its interrupt again (PS v1.7, 6.1.8).
#[macro_export]
macro_rules! take_event {
    ($event:expr) => {{
        let event = &$event;
        let set = event.read().bits() != 0;
        if set {
            event.reset();
            let _ = event.read();
        }
        set
    }};
}

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
