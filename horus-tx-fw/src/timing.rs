//! The 10 ms cycle in timer ticks
//!
//! # Design
//!
//! One 32-bit timer (TIM2) counts the cycle at 72 MHz, twice the APB1 clock (RM0090, "Reset and clock control": the
//! timer clock is 2 × PCLK1 when APB1 is divided). Its update event is the tick, at which the sample is taken; its
//! compare channels are the *slots* at which a loaded frame is fired. A slot is a constant, so the time from the tick
//! to the first preamble bit is constant too. The DPR's missed-frame monitor relies on that.
//!
//! ```text
//! tick k                     slot 0                              slot 1 (five receivers)         tick k+1
//!   |-- fill, seal, load head --|== frame 0 on air ==|-- gap, head --|== frame 1 on air ==|  ...  |
//!                               |-- load rest --|                    |-- load rest --|
//! ```
//!
//! The slots come as early as the worst case of the work before them allows, since they add to the latency from sample
//! to image (docs/design.md#timing: at most 0.12 ms). Before a slot only the frame's first bytes
//! ([`st25r3916::poller::HEAD`]) have to be in the FIFO; the rest follows while the chip sends preamble and sync.

use profile::air::{self, Place};
use st25r3916::poller::{self, HEAD};

use crate::{clock, FRAMES, RECEIVERS};

/// The core clock, Hz. 144 MHz divides into the timer's 72 MHz, the SPI's 9 MHz and whole µs, without over-drive.
pub const CORE_HZ: u32 = 144_000_000;
/// The APB1 clock, Hz (limit 45 MHz, DS9405).
pub const APB1_HZ: u32 = 36_000_000;
/// The APB2 clock, Hz (limit 90 MHz, DS9405).
pub const APB2_HZ: u32 = 72_000_000;
/// The clock of TIM2 and TIM5, Hz.
pub const TIMER_HZ: u32 = 2 * APB1_HZ;
/// The SPI clock, Hz: APB2 / 8. The ST25R3916 allows 10 MHz (DS13541, SPI interface).
pub const SPI_HZ: u32 = APB2_HZ / 8;
/// The baud rate of every GNSS receiver on a UART, 8N1.
pub const GNSS_BAUD: u32 = 460_800;
/// The baud rate of a receiver with factory settings (u-blox, generation 9), 8N1.
pub const FACTORY_BAUD: u32 = 38_400;
/// The SPI clock of a GNSS receiver, Hz: APB2 / 128. A byte takes 14.2 µs and needs at least 8 µs ([`crate::spi`]).
pub const GNSS_SPI_HZ: u32 = APB2_HZ / 128;
/// The shortest time for which SCL is low, ns: 2 µs (u-blox, NEO-M9N and ZED-F9T data sheets, I2C specifications; I2C
/// itself requires only 1.3 µs).
pub const GNSS_I2C_LOW_NS: u32 = 2_000;

/// The number of timer ticks in a µs.
pub const TICKS_PER_US: u32 = TIMER_HZ / 1_000_000;
/// The number of timer ticks in a µs of the front end's waits. It is chosen for the internal oscillator, which is up to
/// 4.5 % fast (DS9405), because a wait that ended early would cut a frame off.
pub const INTERNAL_TICKS_PER_US: u32 = TICKS_PER_US + TICKS_PER_US.div_ceil(20);
/// The number of timer ticks in a cycle: 720 000, exactly 10 ms.
pub const PERIOD_TICKS: u32 = TIMER_HZ / 1_000 * profile::CYCLE_MS;
/// How long the pin TICK is high before each tick, timer ticks: 10 µs, long enough for any logic analyser.
pub const TICK_PULSE_TICKS: u32 = 10 * TICKS_PER_US;

/// The gap between the frames of one cycle, µs, from the end of one to the start of the next. The design requires 300
/// µs, in which the receiver empties its FIFO. Another 20 µs allow for the poller's latency from the command to the
/// first bit, for which the data sheet gives no bound.
pub const GAP_US: u32 = 320;

/// The time allowed to fill and seal a profile, µs: 10 µs to enter and hand over, and 14 µs an object. An object takes
/// 6 µs on the bench's fast clock, and 13 µs on its pessimistic clock.
const FILL_US: u32 = 10 + 14 * (1 + RECEIVERS as u32);

/// The time allowed for starting the load of a frame's head, and for the interrupt at the end of that load, µs.
const LOAD_START_US: u32 = 10;

/// The time allowed between two frames of a cycle besides the loads, µs: status of the first frame's end, checks of the
/// chip, clear, length, status (27 bytes in six transfers, 27 µs at 9 MHz), and seven interrupts.
const BETWEEN_FRAMES_US: u32 = 120;

/// The longest time from a frame's slot until the load of the frame's rest begins, µs: the time of one interrupt. All
/// interrupts of the same or a higher priority take a few µs at most.
const REST_STARTS_US: u32 = 40;

/// Returns the length of frame `frame`'s payload, bytes.
///
/// # Panics
/// Panics if the frame does not exist; for a constant argument, the build fails.
#[must_use]
pub const fn payload(frame: usize) -> usize {
    match Place::of_frame::<RECEIVERS>(frame) {
        Some(place) => place.length(),
        None => panic!("no such frame in a cycle"),
    }
}

/// Returns the air time of frame `frame`, µs, rounded up.
#[must_use]
pub const fn air_us(frame: usize) -> u32 {
    air::air_time_ns(payload(frame) as u8).div_ceil(1_000) as u32
}

/// Returns the time to load `bytes` of a payload into the FIFO, with the command before them, µs, rounded up.
const fn load_us(bytes: usize) -> u32 {
    ((bytes as u64 + 1) * 8 * 1_000_000).div_ceil(SPI_HZ as u64) as u32
}

const fn round_up_10(us: u32) -> u32 {
    us.div_ceil(10) * 10
}

/// The instant at which each frame of a cycle is fired, µs after the tick. The profile states these times
/// ([`profile::air::send_slot_us`]), since the DPR computes a sample's age from them.
pub const SLOT_US: [u32; FRAMES] = {
    let mut slots = [0; FRAMES];
    let mut frame = 0;
    while frame < FRAMES {
        slots[frame] = match air::send_slot_us::<RECEIVERS>(frame) {
            Some(slot) => slot,
            None => panic!("the profile names no slot for a frame of this cycle"),
        };
        frame += 1;
    }
    slots
};

/// Returns the earliest time at which frame `frame` can be fired, µs after the tick: when the profile is sealed and the
/// first frame's head is loaded; for a second frame, when the first frame and the gap are over.
const fn earliest_slot_us(frame: usize) -> u32 {
    round_up_10(match frame {
        0 => FILL_US + LOAD_START_US + load_us(HEAD),
        _ => SLOT_US[frame - 1] + air_us(frame - 1) + GAP_US,
    })
}

// The profile's slots are the earliest possible ones: the work before each slot just fits.
// Shows TIME-4.
const _: () = {
    let mut frame = 0;
    while frame < FRAMES {
        assert!(SLOT_US[frame] == earliest_slot_us(frame), "the profile's slots are not those of the work before them");
        frame += 1;
    }
};

/// The times of [`SLOT_US`] in timer ticks: the values of the compare channels.
pub const SLOT_TICKS: [u32; FRAMES] = {
    let mut ticks = [0; FRAMES];
    let mut frame = 0;
    while frame < FRAMES {
        ticks[frame] = SLOT_US[frame] * TICKS_PER_US;
        frame += 1;
    }
    ticks
};

/// The time after the tick, µs, from which the FIFO has the whole last frame of the cycle. Until the frame's end a log
/// message may then mask interrupts for a few µs without moving a slot.
pub const QUIET_FROM_US: u32 = SLOT_US[FRAMES - 1] + REST_STARTS_US + load_us(payload(FRAMES - 1) - HEAD) + 20;
/// The time after the tick until which a log message may begin, µs. A message that begins by then ends long before the
/// next tick.
pub const QUIET_UNTIL_US: u32 = 1_000 * profile::CYCLE_MS - 200;

/// The watchdog's time, ms at the nominal 32 kHz of its oscillator (LSI).
pub const WATCHDOG_MS: u32 = 100;

/// [`WATCHDOG_MS`] in periods of LSI over its prescaler, 4.
const WATCHDOG_COUNTS: u32 = WATCHDOG_MS * 32 / 4;

/// The value of the watchdog's reload register. The watchdog resets one count after it has reached 0 (RM0090 21.3).
pub const WATCHDOG_RELOAD: u32 = WATCHDOG_COUNTS - 1;

/// The time from the reset until the watchdog is first fed, ms at the nominal 32 kHz. Until then, the watchdog counts
/// from the reset value of its reload register (RM0090 21.3.1). With LSI at 17 to 47 kHz this time is 348 to 964 ms.
pub const FIRST_WATCHDOG_MS: u32 = 4_096 * 4 / 32;

/// The watchdog's shortest time, ms: it is 68 to 190 ms, since LSI runs at 17 to 47 kHz (DS9405).
pub const WATCHDOG_SHORTEST_MS: u32 = WATCHDOG_MS * 32 / 47;

/// How long the watchdog's reload value takes to reach the watchdog's clock domain, cycles of the internal oscillator.
/// It takes up to 5 periods of LSI (RM0090 "IWDG", status register) and LSI's start-up time, 40 µs (DS9405): 0.33 ms at
/// 17 kHz, with margin 0.5 ms. A watchdog that is not fed after that keeps [`FIRST_WATCHDOG_MS`].
pub const WATCHDOG_UPDATE_CYCLES: u32 = clock::INTERNAL_HZ / 2_000;

/// The longest time of the comparison of a program that fills its flash with its CRC, ms, at [`CORE_HZ`]: about 14
/// cycles a byte, and 20 when each read of the CRC's table waits for the flash. A program of 45 KB takes 4.4 to 6.3 ms;
/// on the internal oscillator's 16 MHz it would take 46 ms.
pub const PROGRAM_CHECK_MAX_MS: u32 = (crate::integrity::FLASH_BYTES * 20).div_ceil(CORE_HZ / 1_000);

// The waits of the start (a missing external clock, then the comparison of the program) take at most two thirds of the
// watchdog's shortest time. The PLL's lock time, 0.3 ms, and the rest of the start are negligible.
const _: () = assert!(3 * (clock::START_MAX_MS + PROGRAM_CHECK_MAX_MS) <= 2 * WATCHDOG_SHORTEST_MS);

/// Whether a log message may begin when the cycle timer reads `count`.
#[must_use]
pub const fn quiet(count: u32) -> bool {
    count >= QUIET_FROM_US * TICKS_PER_US && count < QUIET_UNTIL_US * TICKS_PER_US
}

/// Returns the time of tick `tick`, ms since the start. The milliseconds and the ticks wrap together.
#[must_use]
pub const fn timestamp(tick: u32) -> u32 {
    tick.wrapping_mul(profile::CYCLE_MS)
}

/// Returns the milliseconds since the first tick's cycle began (wraps), from values read in this order: the number of
/// ticks served, the timer's count, whether a tick is due (its update flag), the number of ticks served again.
///
/// If the two numbers of ticks differ, a tick was served between the two reads. If the count is then high, it was read
/// before that tick, and the result is the tick's first moment. If a tick is due but not served yet, it counts if the
/// count is low, because such a count was read after the tick. This holds while the tick's interrupt is delayed by less
/// than half a cycle. Without these rules the time would step back by a cycle whenever the counter wraps just before it
/// is read.
#[must_use]
pub const fn now_ms(before: u32, count: u32, due: bool, after: u32) -> u32 {
    let wrapped = count < PERIOD_TICKS / 2;
    let served = before != after;
    let tick = if due && wrapped && !served { before.wrapping_add(1) } else { after };
    let within = if served && !wrapped { 0 } else { count / (TIMER_HZ / 1_000) };
    timestamp(tick).wrapping_add(within)
}

// All clocks follow from each other by exact division, so a cycle is exactly 10 ms.
// Shows TIME-1.
const _: () = assert!(TIMER_HZ.is_multiple_of(1_000_000) && PERIOD_TICKS == 720_000);
const _: () = assert!(CORE_HZ == 4 * APB1_HZ && CORE_HZ == 2 * APB2_HZ && SPI_HZ <= 10_000_000);
// The air times follow from DS13541 and from the design. If either changes, this assertion fails.
const _: () = assert!(air::air_time_ns(244) == 4_814_159 && air::air_time_ns(254) == 5_002_950);
// Between the last frame's end and the next cycle's first frame, the receiver has the whole gap to empty its FIFO.
const _: () = assert!(SLOT_US[FRAMES - 1] + air_us(FRAMES - 1) + GAP_US <= 1_000 * profile::CYCLE_MS + SLOT_US[0]);
// The last frame and the gap end before the next tick, so a cycle's load never meets the previous cycle's frame.
const _: () = assert!(SLOT_US[FRAMES - 1] + air_us(FRAMES - 1) + GAP_US <= 1_000 * profile::CYCLE_MS);
// The head of the second frame can be loaded in the gap after the first frame.
const _: () = assert!(FRAMES == 1 || BETWEEN_FRAMES_US + LOAD_START_US + load_us(HEAD) <= GAP_US);
// The FIFO never runs dry: the load of a frame's rest begins before the head has been sent, and is faster than the air.
const _: () = match poller::rest_within_us(SPI_HZ) {
    Some(within_us) => assert!(REST_STARTS_US <= within_us),
    None => panic!("the SPI is slower than the air"),
};
// The send slot is at most 0.12 ms after the tick (docs/design.md#timing).
const _: () = assert!(SLOT_US[0] <= 120);
const _: () = assert!(QUIET_FROM_US < QUIET_UNTIL_US);

#[cfg(test)]
mod tests {
    use super::*;

    // Shows TIME-4.
    #[test]
    fn every_slot_is_that_of_the_profile() {
        for (frame, slot) in SLOT_US.into_iter().enumerate() {
            assert_eq!(Some(slot), air::send_slot_us::<RECEIVERS>(frame));
            assert_eq!(air::age_at_end_us::<RECEIVERS>(frame), Some(slot + air_us(frame)));
        }
        assert!(SLOT_US[0] >= FILL_US + LOAD_START_US + load_us(HEAD));
        assert_eq!(air::send_slot_us::<RECEIVERS>(FRAMES), None);
    }

    /// Returns the number of ticks served, the counter and the update flag at `instant`, if each tick is served `late`
    /// counts after it.
    fn at(instant: u32, late: u32) -> (u32, u32, bool) {
        let (cycle, count) = (instant / PERIOD_TICKS, instant % PERIOD_TICKS);
        let served = if cycle > 0 && count < late { cycle - 1 } else { cycle };
        (served, count, served != cycle)
    }

    #[test]
    fn the_time_never_steps_back_however_late_a_tick_is_served() {
        for late in [1, 2, 5, 40, 1_000, PERIOD_TICKS / 2 - 100] {
            for apart in [1, 3, 20] {
                let mut last = 0;
                for cycle in 1..4 {
                    let wraps = cycle * PERIOD_TICKS;
                    let around = [wraps - 100..wraps + 100, wraps + late - 50.min(late)..wraps + late + 100];
                    for begins in around.into_iter().flatten() {
                        let [(before, ..), (_, count, _), (.., due), (after, ..)] =
                            [0, 1, 2, 3].map(|read| at(begins + read * apart, late));
                        let now = now_ms(before, count, due, after);
                        assert!(now >= last, "{late} {apart} {begins}: {now} after {last} ms");
                        assert!(now.abs_diff(begins / (TIMER_HZ / 1_000)) <= 1, "{late} {apart} {begins}: {now} ms");
                        last = now;
                    }
                }
            }
        }
        assert_eq!(now_ms(u32::MAX, 5, true, u32::MAX), 0, "it wraps with the ticks");
    }

    #[test]
    fn logging_is_allowed_only_between_the_last_slot_and_the_next_tick() {
        assert!(!quiet(0));
        assert!(!quiet(SLOT_TICKS[FRAMES - 1]));
        assert!(quiet(SLOT_TICKS[FRAMES - 1] + 400 * TICKS_PER_US));
        assert!(!quiet(PERIOD_TICKS - 1));
    }
}
