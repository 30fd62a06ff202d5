//! What the firmware counts about itself, for a debugger or the bench to read from RAM by symbol.

use core::sync::atomic::{AtomicU32, Ordering};

macro_rules! telemetry {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// The static `DPR_TELEMETRY` in the image: 32-bit counters in this order, all zero at start. Each has one writer; totals wrap.
        #[derive(Debug, Default)]
        #[repr(C)]
        pub struct Telemetry {
            $($(#[$doc])* pub $name: Counter,)*
        }

        impl Telemetry {
            /// All zero.
            #[must_use]
            pub const fn new() -> Self {
                Self { $($name: Counter::new(),)* }
            }

            /// Names of the counters, in their order in memory.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name),)*];
        }
    };
}

telemetry! {
    /// Frames of a right length.
    frames_received,
    /// Frames whose deadline passed.
    frames_missed,
    /// Objects accepted.
    objects_accepted,
    /// Objects rejected, each by itself.
    objects_rejected,
    /// Frames rejected outright.
    wrong_length,
    /// Frames for which the front end reported a CRC-16, framing or FIFO error; they are judged like any other.
    chip_crc_flags,
    /// Buffers scrubbed, receive buffers and images.
    scrubs,
    /// Stuck bits found by scrubs.
    scrub_faults,
    /// Faults of the RFID front end, and frames that began but were not delivered.
    rf_faults,
    /// Times the front end was brought up again after a fault.
    rf_recoveries,
    /// Frames lost because commit and scrub were late by a cycle.
    overruns,
    /// SSI transactions that were granted.
    ssi_transactions,
    /// Requests that were refused, and times the transaction budget was used up.
    access_violations,
    /// Images published.
    publications,
    /// Images that became readable for the next SSI transaction.
    images_readable,
    /// Longest SSI interrupt, processor cycles.
    ssi_worst_cycles,
    /// Longest commit, frame or deadline, processor cycles, with what preempted it.
    commit_worst_cycles,
    /// From the front end's report of the last frame's end to its publication, µs. (The cycle counter stands still while the processor sleeps.)
    rxe_to_publish_us,
    /// The longest of those, µs.
    rxe_to_publish_worst_us,
}

/// One counter.
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct Counter(AtomicU32);

impl Counter {
    const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// The number.
    pub fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    /// Counts `amount` more.
    pub fn add(&self, amount: u32) {
        self.0.fetch_add(amount, Ordering::Relaxed);
    }

    /// Sets the number.
    pub fn set(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }

    /// Keeps the larger one.
    pub fn at_least(&self, value: u32) {
        self.0.fetch_max(value, Ordering::Relaxed);
    }
}

const _: () = assert!(size_of::<Telemetry>() == 4 * Telemetry::NAMES.len());
