//! The HORUS side of the link: all that its firmware does, except for access to registers
//!
//! # Design
//!
//! Every 10 ms a hardware timer ticks. At the tick, the instant of the *sample*, what the receivers have sent is copied
//! into the objects of a [`profile::Profile`], stamped with the tick's time and sealed with both CRCs. DMA loads it
//! into an ST25R3916 poller's FIFO, and it is sent at a fixed instant after the tick (paper, section 2.3). HORUS writes
//! and never listens, so no frame is sent again: a frame that is not ready in its slot is skipped and counted (paper,
//! section 2: operations that take constant time and either succeed or do not).
//!
//! This library holds every decision between the receivers and the air as plain Rust that the host tests:
//!
//! | module | what it decides |
//! |---|---|
//! | [`receiver`] | how bytes of one GNSS receiver become its latest solution, and how old each part of it may get |
//! | [`cycle`] | how solutions become the objects of one tick, with their timestamps and status bits |
//! | [`transmitter`] | what the poller's state machine does and when, and to which slot a loaded frame belongs |
//! | [`source`] | what UART, I2C and SPI have in common: rings, messages to a receiver, the trait |
//! | [`ddc`], [`spi`] | the order of events of a receiver on I2C and of one on SPI, their bounds and recoveries |
//! | [`configuration`] | what is sent to a receiver and when, and what follows from its answers |
//! | [`ring`] | how many bytes a circular DMA transfer has delivered, and whether it has overwritten unread bytes |
//! | [`timing`] | the slots of a cycle, each with its derivation, checked at compile time |
//! | [`clock`] | whether to run on the external clock or, without it, on the internal oscillator |
//! | [`flow`] | the order and the least times of the cycle's tasks |
//! | [`exclusions`] | which receivers stay excluded over a reset |
//! | [`integrity`] | what follows from a change of memory, and when it is found |
//! | [`idle`] | when memory is verified, and what is logged when |
//! | [`protection`] | the regions that the memory protection unit opens |
//! | [`reset`] | why the processor started |
//! | [`task`] | which tasks have to check in before the watchdog is fed |
//! | [`telemetry`] | the counters that a debugger, or the bench, reads from RAM |
//!
//! This library has no `unsafe` code. The firmware itself is a table of interrupt tasks (`main.rs`), a table of pins,
//! DMA streams, vectors and clocks (`board.rs`), and the registers (`hw/`, which alone has `unsafe` code).
#![no_std]
#![forbid(unsafe_code)]

pub mod clock;
pub mod configuration;
pub mod cycle;
pub mod ddc;
pub mod exclusions;
pub mod flow;
pub mod idle;
pub mod integrity;
pub mod protection;
pub mod receiver;
pub mod reset;
pub mod ring;
pub mod source;
pub mod spi;
pub mod state_inputs;
pub mod supply;
pub mod task;
pub mod telemetry;
pub mod timing;
pub mod transmitter;

/// The number of GNSS receivers that are fitted, by the cargo feature `gps-1`, `gps-2` (1oo2), `gps-3` (2oo3) or
/// `gps-5` (3oo5).
pub const RECEIVERS: usize = {
    let chosen = cfg!(feature = "gps-1") as usize
        + cfg!(feature = "gps-2") as usize
        + cfg!(feature = "gps-3") as usize
        + cfg!(feature = "gps-5") as usize;
    assert!(chosen == 1, "choose exactly one of the features gps-1, gps-2, gps-3, gps-5");
    if cfg!(feature = "gps-1") {
        1
    } else if cfg!(feature = "gps-2") {
        2
    } else if cfg!(feature = "gps-3") {
        3
    } else {
        5
    }
};

/// The number of air frames per cycle: 1, or 2 with five receivers.
pub const FRAMES: usize = profile::air::frames(RECEIVERS);
