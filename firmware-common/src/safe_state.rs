//! What a panic, a fault or an interrupt without a task does on either board.
//!
//! Interrupts are masked, the board enters its own safe state (HORUS switches the field off, the DPR stops answering
//! the flight controller), the reason is logged once, and nothing feeds the watchdog any more, which resets the part.
//!
//! A firmware installs all handlers with [`install_safe_state!`](crate::install_safe_state).

#[cfg(target_os = "none")]
use core::sync::atomic::{compiler_fence, AtomicBool, Ordering};

/// The reason has been logged, or is being logged: a fault inside the logger must not log again.
#[cfg(target_os = "none")]
static LOGGED: AtomicBool = AtomicBool::new(false);

/// Masks all interrupts, calls `enter`, then `log` unless a reason was logged already, and waits for the watchdog.
#[cfg(target_os = "none")]
pub fn enter(enter: fn(), log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    enter();
    if !LOGGED.swap(true, Ordering::Relaxed) {
        log();
    }
    loop {
        compiler_fence(Ordering::SeqCst);
    }
}

/// Installs the handlers of panics, of failed `defmt` assertions, of HardFault and of every exception or interrupt
/// without a handler of its own. `$enter` is the `fn()` that puts the board into its safe state with all interrupts
/// masked; it must not panic and must not wait without a bound.
#[macro_export]
macro_rules! install_safe_state {
    ($enter:path) => {
        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
            $crate::safe_state::enter($enter, || defmt::error!("{}", defmt::Display2Format(info)))
        }

        /// `defmt::panic!` and its kin have logged the reason themselves.
        #[defmt::panic_handler]
        fn defmt_panic() -> ! {
            $crate::safe_state::enter($enter, || {})
        }

        // SAFETY: nothing of what was interrupted is used again, since the handler does not return.
        #[cortex_m_rt::exception]
        unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
            $crate::safe_state::enter($enter, || {
                defmt::error!("hard fault at {=u32:#010x}, called from {=u32:#010x}", frame.pc(), frame.lr())
            })
        }

        // SAFETY: as for `HardFault`.
        #[cortex_m_rt::exception]
        unsafe fn DefaultHandler(number: i16) -> ! {
            $crate::safe_state::enter($enter, || defmt::error!("interrupt {=i16} has no task", number))
        }
    };
}
