//! The critical section that the logger uses: it masks nothing while the idle loop logs.
//!
//! Chosen by the feature `log-section`.
//!
//! # Design
//!
//! `defmt-rtt` writes each message within a [critical section](https://docs.rs/critical-section). The usual
//! implementation for one core masks all interrupts, and a message of a few numbers takes 5 to 10 µs: any deadline of
//! that order is missed whenever a message happens to be written. Here only the idle loop and the start-up code log.
//! They run in thread mode, and no interrupt handler enters a critical section, so two never overlap even though none
//! is masked.
//!
//! A handler that panics is the exception. It never returns, and if it interrupted a message that was being written,
//! the logger notices that (its `TAKEN` flag) and panics again, and [`safe_state`](crate::safe_state) then does without
//! a message. In handler mode all interrupts are masked as usual, so that no second handler comes in between.

#[cfg(all(target_os = "none", feature = "log-section"))]
#[allow(unsafe_code)]
mod imp {
    use cortex_m::{interrupt, peripheral::SCB, register::primask};

    struct LogSection;

    critical_section::set_impl!(LogSection);

    // SAFETY: two sections never overlap. In thread mode there is one thread, and handlers enter no section but that of
    // a panic, which never returns and refuses to write into a message that is being written (module docs). In handler
    // mode all interrupts are masked.
    unsafe impl critical_section::Impl for LogSection {
        unsafe fn acquire() -> critical_section::RawRestoreState {
            let unmask = primask::read().is_active() && in_handler();
            if unmask {
                interrupt::disable();
            }
            u32::from(unmask)
        }

        unsafe fn release(unmask: critical_section::RawRestoreState) {
            if unmask != 0 {
                // SAFETY: they were not masked when the section began.
                unsafe { interrupt::enable() };
            }
        }
    }

    /// Whether the processor handles an exception or interrupt.
    fn in_handler() -> bool {
        SCB::vect_active() != cortex_m::peripheral::scb::VectActive::ThreadMode
    }
}
