//! What the firmwares for the nRF52840 have in common beside that for any part: its start, its clock, its supply.
//!
//! | file | what |
//! |---|---|
//! | `start_up.rs` | the first instructions: reset reasons and watchdog |
//! | [`reset`] | why the part last started |
//! | [`debug_port`] | whether the debug port stays open |
//! | [`crystal`] | the wait for the 32 MHz crystal |
//! | `registers.rs` | the registers of these, and the µs counter; with the feature `nrf52840` |

/// Reads and clears an event register, and waits until the write is through the bus bridge, so that the event does not
/// call its interrupt again (PS v1.7, 6.1.8).
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
