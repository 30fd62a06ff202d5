//! The logger's critical section, which masks no interrupt while the idle loop logs (feature `log-section`).
//!
//! # Design
//!
//! `defmt-rtt` writes each message within a [critical section](https://docs.rs/critical-section). The usual
//! implementation for one core masks all interrupts, and a message takes 5 to 10 µs, too long for the shortest
//! deadlines. In these firmwares only the idle loop and the start-up code log. They run in thread mode, and no
//! interrupt handler enters a critical section, so two sections never overlap although no interrupt is masked.
//!
//! One case is an exception: a handler that stops the firmware and never returns. If it has interrupted a message
//! ([`is_interrupted`]), [`safe_state`](crate::safe_state) logs no message of its own, since the logger would panic. In
//! handler mode all interrupts are masked as usual.

/// Whether the caller, a handler, has interrupted a message that thread mode was writing. Without the feature
/// `log-section` this is always false, since no interrupt can come while a message is written.
#[must_use]
pub fn is_interrupted() -> bool {
    #[cfg(all(target_os = "none", feature = "log-section"))]
    return imp::WRITING.load(core::sync::atomic::Ordering::Relaxed);
    #[cfg(not(all(target_os = "none", feature = "log-section")))]
    false
}

#[cfg(all(target_os = "none", feature = "log-section"))]
#[allow(unsafe_code)]
mod imp {
    use core::sync::atomic::{AtomicBool, Ordering};

    use cortex_m::{interrupt, peripheral::SCB, register::primask};

    pub(super) static WRITING: AtomicBool = AtomicBool::new(false);

    struct LogSection;

    critical_section::set_impl!(LogSection);

    // SAFETY: two sections never overlap. In thread mode there is one thread, and the only handler that enters a
    // section is that of the safe state, which never returns and writes nothing into a message that is being written
    // (module docs). In handler mode all interrupts are masked.
    unsafe impl critical_section::Impl for LogSection {
        unsafe fn acquire() -> critical_section::RawRestoreState {
            if !in_handler() {
                WRITING.store(true, Ordering::Relaxed);
                return 0;
            }
            let unmask = primask::read().is_active();
            if unmask {
                interrupt::disable();
            }
            u32::from(unmask)
        }

        unsafe fn release(unmask: critical_section::RawRestoreState) {
            if !in_handler() {
                WRITING.store(false, Ordering::Relaxed);
            } else if unmask != 0 {
                // SAFETY: interrupts were not masked when the section began.
                unsafe { interrupt::enable() };
            }
        }
    }

    fn in_handler() -> bool {
        SCB::vect_active() != cortex_m::peripheral::scb::VectActive::ThreadMode
    }
}
