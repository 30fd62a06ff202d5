//! The counters of a firmware's telemetry.
//!
//! Each firmware exports one `repr(C)` structure of counters under a symbol, by which a debugger or the bench reads it
//! from RAM. The firmware's work does not depend on the counters.

use core::sync::atomic::{AtomicU32, Ordering};

/// One 32-bit counter or high-water mark. Totals wrap. Each counter has one writer, so no update is lost.
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct Counter(AtomicU32);

impl Counter {
    /// Returns a counter that starts at `value`.
    #[must_use]
    pub const fn starting_at(value: u32) -> Self {
        Self(AtomicU32::new(value))
    }

    /// Returns a counter that starts at 0.
    #[must_use]
    pub const fn new() -> Self {
        Self::starting_at(0)
    }

    /// Returns the value of the counter.
    #[must_use]
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    /// Adds `amount`, wrapping.
    pub fn add(&self, amount: u32) {
        // Not covered: a second try of the exclusive access, for which an interrupt would have to come between its two
        // instructions; and the copies for events that no run has, at whose own lines the reason stands.
        self.0.fetch_add(amount, Ordering::Relaxed);
    }

    /// Adds `amount`, wrapping, without an exclusive access. Only for a counter that no other task changes.
    pub fn add_alone(&self, amount: u32) {
        self.0.store(self.0.load(Ordering::Relaxed).wrapping_add(amount), Ordering::Relaxed);
    }

    /// Sets the counter to `value`.
    pub fn set(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Sets the counter to `value` if `value` is larger.
    pub fn record_max(&self, value: u32) {
        // Not covered: a second try of the exclusive access, as in `add`; and a value below the greatest, where all
        // values are the same.
        self.0.fetch_max(value, Ordering::Relaxed);
    }

    /// Sets the counter to `value` if `value` is smaller.
    pub fn record_min(&self, value: u32) {
        // Not covered: a second try of the exclusive access, as in `add`.
        self.0.fetch_min(value, Ordering::Relaxed);
    }
}

/// Makes a structure of counters, all zero at start, and the list of their names.
#[macro_export]
macro_rules! counters {
    ($(#[$doc_of:meta])* pub struct $of:ident { $($(#[$doc:meta])* $name:ident,)* }) => {
        $(#[$doc_of])*
        #[derive(Debug, Default)]
        #[repr(C)]
        pub struct $of {
            $($(#[$doc])* pub $name: $crate::counter::Counter,)*
        }

        impl $of {
            /// The names of the counters, in their order in memory.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name),)*];

            /// Returns counters that are all zero.
            #[must_use]
            pub const fn new() -> Self {
                Self { $($name: $crate::counter::Counter::new(),)* }
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_add_and_wrap_and_marks_keep_the_extreme() {
        let total = Counter::starting_at(u32::MAX);
        total.add(3);
        assert_eq!(total.get(), 2);
        total.set(9);
        total.record_max(7);
        assert_eq!(total.get(), 9);
        total.record_max(11);
        assert_eq!(total.get(), 11);
        total.record_min(12);
        assert_eq!(total.get(), 11);
        total.record_min(4);
        assert_eq!(total.get(), 4);
        assert_eq!(Counter::new().get(), 0);
    }
}
