//! The RFID side: runs the ST25R3916's listener, and hands frames on to the commit task.
//!
//! # Design
//!
//! The listener, a state machine ([`st25r3916::Listener`]), decides what to send to the chip. The [`FrontEndPort`]
//! starts SPI transfers by EasyDMA and a timer, and the driver's [`Executor`] connects the two. Three interrupts call
//! [`Reception::serve`]: a transfer has ended, the IRQ pin has risen, the timer has elapsed. The cyclic check-in calls
//! this function too, so that a lost edge of the IRQ pin is made up for.
//!
//! A FIFO read returns a meaningless byte before the data. The port receives that byte just before the place of the
//! data. At the first read of a frame it overwrites the last of the [`LEAD`] bytes. At later reads it overwrites the
//! last byte of the previous read, which the port saves and restores. So a frame's bytes are contiguous without being
//! copied.
//!
//! # Buffers
//!
//! [`Reception::serve`] hands a buffer that holds a frame to the commit task and goes on with a clean buffer. If a
//! frame is not delivered, its buffer is replaced by a clean one as well, so that it never mixes with another frame.
//!
//! # The end of a frame
//!
//! A frame's end is the rising edge of the IRQ pin (I_rxe), whose instant the hardware captures
//! ([`FrontEndPort::irq_edge_us`]). So the instant does not depend on when the processor reads the interrupt.

use rtic_core::Mutex;
use st25r3916::{
    executor::{self, Executor},
    listener::PAYLOAD_OFFSET,
    Fault, Listener, ListenerEvent,
};

use crate::{
    accept::Early,
    telemetry::Telemetry,
    triple::{Filling, Memory, Rotated, Rotation},
};

/// The number of bytes before LEN in a receive buffer. They take the first byte of a read, and align the payload.
pub const LEAD: usize = 3;
const _: () = assert!((LEAD + PAYLOAD_OFFSET).is_multiple_of(4));

/// How long the chip is left alone after a frame, µs; the commit takes 50 µs. The next sync comes at least 0.45 ms
/// after a frame's end (0.30 ms between two frames of a cycle, 0.15 ms of preamble and sync). Until then the rest of
/// the frame is read (0.26 ms at worst, with store-and-forward) and the receiver is re-armed (0.03 ms). Only the
/// read-back of a setting may last longer.
pub const RESUME_AFTER_US: u32 = 80;

/// The hardware that the executor needs, and the receive buffer that is being written.
pub trait FrontEndPort: executor::Port {
    /// The type of a receive buffer.
    type Buffer: Memory;

    /// Returns the value of the µs counter at the last rising edge of the IRQ pin, captured by hardware.
    fn irq_edge_us(&mut self) -> u32;
    /// Exchanges the receive buffer. Called while no transfer runs.
    fn exchange(&mut self, with: impl FnOnce(Filling<Self::Buffer>) -> Filling<Self::Buffer>);
    /// Returns the first `len` bytes of the frame in the receive buffer, beginning with LEN. Called while no read runs,
    /// since a read temporarily overwrites one of these bytes.
    fn arrived(&self, len: usize) -> &[u8];
}

/// The state of the RFID front end, as the RFID task last saw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum FrontEnd {
    /// The front end has not listened since the DPR's start.
    Starting,
    /// The front end is configured and listens.
    Listening {
        /// Whether the front end senses HORUS's field, or has received a frame and has not lost the field since.
        field: bool,
    },
    /// The front end was lost for this reason and is being brought up again. After [`Fault::Silence`] this state lasts
    /// until a frame comes, since only a frame shows that the front end receives.
    Lost(Fault),
}

impl FrontEnd {
    /// Whether the front end senses no field, and has no other fault than silence.
    #[must_use]
    pub const fn senses_no_field(self) -> bool {
        matches!(self, Self::Starting | Self::Listening { field: false } | Self::Lost(Fault::Silence { field: false }))
    }

    /// Whether the front end is out of order. That includes a front end that receives nothing although it senses a
    /// field. Without a field, silence is no fault of the front end.
    #[must_use]
    pub const fn is_out_of_order(self) -> bool {
        // Not covered: only this line, in the compiler's comparison of the state's number, the number behind the last
        // one, which no state has.
        matches!(self, Self::Lost(fault) if !matches!(fault, Fault::Silence { field: false }))
    }

    fn note_field(&mut self, there: bool) {
        // Not covered: a field that is reported in another state: a front end reports its field only while it listens,
        // or after silence.
        if let Self::Listening { field } | Self::Lost(Fault::Silence { field }) = self {
            *field = there;
        }
    }
}

/// What is kept about a received frame besides its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameInfo {
    /// The number of payload bytes.
    pub len: usize,
    /// The value of the µs counter at the frame's end.
    pub ended_us: u32,
    /// The results for the objects that were verified while the frame arrived.
    pub early: Early,
}

impl FrameInfo {
    /// Returns the payload in the receive buffer's `bytes`; empty if the buffer is too short.
    #[must_use]
    pub fn payload<'a>(&self, bytes: &'a [u8]) -> &'a [u8] {
        bytes.get(LEAD + PAYLOAD_OFFSET..LEAD + PAYLOAD_OFFSET + self.len).unwrap_or(&[])
    }
}

/// The tasks that the RFID task has to call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Call {
    /// No task has to be called.
    None,
    /// The commit task has to be called to prepare an image, because most of a frame has arrived.
    Prepare,
    /// The commit task and the scrub task have to be called, because a buffer was passed on.
    Handed,
}

/// The state of the RFID tasks.
#[derive(Debug)]
pub struct Reception<P> {
    executor: Executor<Listener, P>,
    early: Early,
}

impl<P: FrontEndPort> Reception<P> {
    /// Starts to bring up the front end, and returns the state of the RFID tasks.
    pub fn start(listener: Listener, port: P) -> Self {
        let mut executor = Executor::new(listener, port);
        // A bring-up begins with a transfer, so the first step of the executor gives no event.
        let event = executor.resume();
        debug_assert!(event.is_none(), "{event:?}");
        Self { executor, early: Early::default() }
    }

    /// Serves an interrupt, for a profile of `N` receivers. A received frame goes into `rotation`, and the driver goes
    /// on with a clean buffer. While a frame arrives, its complete objects are verified. Returns which tasks to call.
    pub fn serve<const N: usize>(
        &mut self,
        mut rotation: impl Mutex<T = Rotation<P::Buffer, FrameInfo>>,
        mut front_end: impl Mutex<T = FrontEnd>,
        telemetry: &Telemetry,
    ) -> Call {
        let Self { executor, early } = self;
        let mut handed = false;
        let mut event = executor.poll();
        while let Some(happened) = event {
            match happened {
                ListenerEvent::Frame { len, flags } => {
                    // A front end that is already within a field when it begins to listen may not report that field.
                    front_end.lock(|state| *state = FrontEnd::Listening { field: true });
                    telemetry.chip_crc_flags.add(u32::from(!flags.is_clean()));
                    let info =
                        FrameInfo { len, ended_us: executor.port().irq_edge_us(), early: core::mem::take(early) };
                    executor.port().exchange(|filled| {
                        let (next, rotated) = rotation.lock(|rotation| rotation.rotate(filled, info));
                        if let Rotated::Overrun(found) = rotated {
                            telemetry.overruns.add(1);
                            telemetry.scrubbed(found);
                        }
                        next
                    });
                    handed = true;
                }
                ListenerEvent::Listening => front_end.lock(|state| {
                    telemetry.rf_recoveries.add(u32::from(*state != FrontEnd::Starting));
                    if !matches!(state, FrontEnd::Lost(Fault::Silence { .. })) {
                        *state = FrontEnd::Listening { field: false };
                    }
                }),
                ListenerEvent::Fault(fault) => {
                    match fault {
                        // Silence does not count as a fault of the front end, because HORUS may be switched off.
                        Fault::Silence { .. } => telemetry.rf_silences.add(1),
                        _ => telemetry.rf_faults.add(1),
                    }
                    if let Fault::Register { address, expected, found } = fault {
                        telemetry.rf_register.set(u32::from_be_bytes([0, address, expected, found]));
                    }
                    // Not covered: only this line, what follows the copy of the locked section for another priority,
                    // which never runs (`xtask/src/coverage/twins.rs`).
                    front_end.lock(|state| *state = FrontEnd::Lost(fault));
                    // Not covered: only this line, what follows the copy that never runs, as above.
                    replace_buffer(executor, &mut rotation, telemetry);
                    *early = Early::default();
                    handed = true;
                }
                ListenerEvent::Dropped(_) => {
                    telemetry.rf_faults.add(1);
                    replace_buffer(executor, &mut rotation, telemetry);
                    *early = Early::default();
                    handed = true;
                }
                ListenerEvent::FieldOn => front_end.lock(|state| state.note_field(true)),
                ListenerEvent::FieldOff => {
                    telemetry.field_losses.add(1);
                    front_end.lock(|state| state.note_field(false));
                }
            }
            if matches!(happened, ListenerEvent::Frame { .. }) {
                executor.resume_later(RESUME_AFTER_US);
                return Call::Handed;
            }
            event = executor.resume();
        }
        if let Some(arrived) = executor.take_arrived() {
            let before = early.done();
            // Not covered: only this line, a number of bytes that is 0 or exceeds the buffer: `take_arrived` returns no
            // 0, and the port has started no read beyond its buffer.
            early.follow::<N>(executor.port().arrived(arrived));
            if early.done() > before && !handed {
                return Call::Prepare;
            }
        }
        if handed {
            Call::Handed
        } else {
            Call::None
        }
    }

    /// Verifies what is kept of the objects that have arrived of the present frame. Returns whether there is any, which
    /// is so when most of the frame has arrived.
    pub fn verify_early(&mut self) -> bool {
        let begun = self.early.done() > 0;
        if begun {
            self.early.verify();
        }
        begun
    }

    /// Returns the port, for tests.
    pub fn port(&mut self) -> &mut P {
        self.executor.port()
    }
}

/// Gives up the frame that is being received: its buffer is replaced by a clean one.
fn replace_buffer<P: FrontEndPort>(
    executor: &mut Executor<Listener, P>,
    rotation: &mut impl Mutex<T = Rotation<P::Buffer, FrameInfo>>,
    telemetry: &Telemetry,
) {
    executor.port().exchange(|begun| {
        let (next, found) = rotation.lock(|rotation| rotation.replace(begun));
        telemetry.scrubbed(found);
        next
    });
}
