//! The firmware of the DPR: NFC-F frames come in, and an active dual-ported RAM is read over SSI.
//!
//! # Design
//!
//! This library has all the firmware's logic; it needs no MCU, and the host tests it. The binary beside it is an RTIC
//! table of tasks, and only the binary's module `hw` accesses registers. The modules of the library:
//!
//! | module | what it does | where it runs |
//! |---|---|---|
//! | [`rf`] | carries out the steps of the ST25R3916's listener machine, hands frames on | RFID interrupts |
//! | [`triple`] | receive buffers and images: written, read, scrubbed | handed from task to task |
//! | [`intake`] | takes in the frames that wait, then checks the deadline | commit |
//! | [`accept`] | verifies the objects of a frame, each by itself, and the sequence of its cycle | commit |
//! | [`commit`] | deposits accepted objects in an image built from scratch, decides when it is published | commit |
//! | [`integrity`] | re-verifies the published image; what follows from a change of memory | idle |
//! | [`link`] | Link-Status, counters, ages, and the deadline that notices a missed frame | commit |
//! | [`protection`] | the regions that the memory protection unit opens | start |
//! | [`publish`] | hands images to the SSI, FRESH, expiry | commit, SSI interrupt |
//! | [`ssi`] | what the flight controller asked for, and how many transactions it gets | SSI interrupt |
//! | [`port`] | what the flight controller wrote: uplinks, commands, Port-Status | port |
//! | [`hold`] | the second port: the hold's frames and the answers to them (feature `hold`) | hold interrupts |
//! | [`task`] | the tasks that have to check in, so that the watchdog may be fed | every task |
//! | [`telemetry`] | the counters that a debugger, or the bench, reads from RAM | every task |
//!
//! Constant time: the cost of a cycle does not depend on what the data say. Every object is verified, and copied under
//! a mask whatever the verdict is, and no loop ends early.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod accept;
pub mod commit;
pub mod hold;
pub mod intake;
pub mod integrity;
pub mod link;
pub mod port;
pub mod protection;
pub mod publish;
pub mod rf;
pub mod ssi;
pub mod task;
pub mod telemetry;
pub mod triple;

#[cfg(any(
    all(feature = "gps-1", any(feature = "gps-2", feature = "gps-3", feature = "gps-5")),
    all(feature = "gps-2", any(feature = "gps-3", feature = "gps-5")),
    all(feature = "gps-3", feature = "gps-5"),
))]
compile_error!(
    "choose one of the features gps-1, gps-2, gps-3, gps-5: without the default gps-3 it is --no-default-features \
     --features gps-N"
);
#[cfg(not(any(feature = "gps-1", feature = "gps-2", feature = "gps-3", feature = "gps-5")))]
compile_error!("choose one of the features gps-1, gps-2, gps-3, gps-5");

/// The number of GNSS receivers in the profile, chosen by the feature `gps-N`.
pub const RECEIVERS: usize = if cfg!(feature = "gps-1") {
    1
} else if cfg!(feature = "gps-2") {
    2
} else if cfg!(feature = "gps-5") {
    5
} else {
    3
};

/// The words of a receive buffer: [`rf::LEAD`] bytes, then LEN, payload and CRC-16 of the longest NFC-F frame.
pub const RECEIVE_WORDS: usize = (rf::LEAD + st25r3916::listener::BUFFER).div_ceil(4);
/// The number of words of an image buffer: it holds the map for five receivers, which is the longest. With a hold it
/// holds the profile's own on the target, where a scrub of the longest would take half as long again.
pub const IMAGE_WORDS: usize = if cfg!(all(feature = "hold", target_os = "none")) {
    MAP_BYTES.div_ceil(4)
} else {
    (profile::map::Map::<5>::LEN + hold::SHOWN).div_ceil(4)
};
/// The number of bytes of the map that the flight controller can read: with the hold's place if there is a hold.
pub const MAP_BYTES: usize = profile::map::Map::<RECEIVERS>::LEN + hold::SHOWN;

/// The memory of one air frame.
pub type ReceiveMemory = [u32; RECEIVE_WORDS];
/// The memory of one image.
pub type ImageMemory = [u32; IMAGE_WORDS];
