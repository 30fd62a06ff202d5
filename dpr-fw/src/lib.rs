//! The firmware of the DPR: receives NFC-F frames, and lets a flight controller read their objects over SSI.
//!
//! # Design
//!
//! This library has all of the firmware's logic and runs on a host as well, where it is tested. The binary beside it is
//! an RTIC application. Only the binary's module `hw` accesses registers. The table lists the library's modules and the
//! RTIC tasks that use them (*start*: the code before the first task).
//!
//! | module | what it does | used by |
//! |---|---|---|
//! | [`rf`] | runs the ST25R3916's listener machine, passes frames on | RFID tasks |
//! | [`triple`] | the states of receive buffers and images: written, read, scrubbed | RFID, commit, SSI, scrub |
//! | [`intake`] | handles the frames that wait, then checks the deadline | commit |
//! | [`accept`] | verifies each object of a frame, and the sequence of its cycle | commit |
//! | [`commit`] | copies accepted objects into an empty image, and publishes the image | commit |
//! | [`integrity`] | verifies the published image again; the consequence of a memory fault | idle |
//! | [`link`] | Link-Status, counters, ages, and the deadline that detects a missed frame | commit |
//! | [`protection`] | the regions that the memory protection unit opens | start |
//! | [`publish`] | passes images to the SSI; FRESH and expiry | commit, SSI tasks |
//! | [`ssi`] | the request of the flight controller, and the limit on its transactions | SSI tasks |
//! | [`port`] | what the flight controller wrote: uplinks, commands; Port-Status | port |
//! | [`hold`] | the second port: the hold's frames and the answers to them (feature `hold`) | hold tasks |
//! | [`task`] | the tasks that must check in before the watchdog is fed | every task |
//! | [`telemetry`] | the counters that a debugger or the bench reads from RAM | every task |
//! The cost of a cycle does not depend on the data: every object is verified, and is copied under a
//! mask that clears an object that is not accepted.
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

/// The length of a receive buffer, words: [`rf::LEAD`] bytes, then LEN, payload and CRC-16 of the longest NFC-F frame.
pub const RECEIVE_WORDS: usize = (rf::LEAD + st25r3916::listener::BUFFER).div_ceil(4);
/// The number of words of an image buffer. It has room for the map for five receivers, which is the longest. The DPR
/// with a hold has room only for its own profile's map, because a scrub would otherwise take half as long again.
pub const IMAGE_WORDS: usize = if cfg!(all(feature = "hold", target_os = "none")) {
    MAP_BYTES.div_ceil(4)
} else {
    (profile::map::Map::<5>::LEN + hold::SHOWN).div_ceil(4)
};
/// The number of bytes of the map that the flight controller can read, with the hold's object if there is a hold.
pub const MAP_BYTES: usize = profile::map::Map::<RECEIVERS>::LEN + hold::SHOWN;

/// The memory of one receive buffer.
pub type ReceiveMemory = [u32; RECEIVE_WORDS];
/// The memory of one image buffer.
pub type ImageMemory = [u32; IMAGE_WORDS];
