//! The RFID side: carries out the steps of the ST25R3916's listener machine, driven by interrupts, and hands frames on.
//!
//! # Design
//!
//! The machine ([`st25r3916::Listener`]) decides what to say to the chip; the [`Port`] starts SPI transfers by EasyDMA
//! and a timer; the [`Executor`] stands between them. Three interrupts drive it: transfer ended, IRQ pin risen, timer
//! elapsed. All three call [`Executor::poll`], which asks the port what is the case rather than trusting which
//! interrupt came. So a lost edge of the IRQ pin, an edge that is reported twice (anomaly 155) or an interrupt that
//! comes late does no harm, and the cyclic check-in that pends the task repairs what a lost edge could have left
//! waiting.
//!
//! No task waits: a poll ends when a transfer or the timer runs. Every transfer has a bound as well, [`TRANSFER_US`];
//! one that does not end is reported to the machine as failed, and the machine brings the chip up again.
//!
//! A FIFO read puts a meaningless byte in front of the data, clocked in under the command. The port receives it into
//! the byte before the place where the data go: for the first read that is the last of the [`LEAD`] bytes, for later
//! ones the last byte of the chunk before, which the port keeps and puts back. So frames lie where they are wanted
//! without a copy.
//!
//! # Buffers
//!
//! [`Receiver::serve`] hands a buffer that holds a frame to the commit task and goes on with a clean one. A buffer in
//! which a frame was begun that is not delivered is replaced by a clean one as well: no frame is ever received into a
//! buffer that holds bytes of another.
//!
//! # The end of a frame
//!
//! A frame's end is the rising edge of the IRQ pin (I_rxe), whose instant the hardware captures
//! ([`Port::irq_edge_us`]). It does not depend on when the processor looks, nor on whether the interrupt was read in a
//! status read that the edge caused or in one that a time-out had caused before it.

use rtic_core::Mutex;
use st25r3916::{listener::PAYLOAD_OFFSET, Fault, Input, Listener, ListenerEvent, Short, Step, Transfer};

use crate::{
    accept::Early,
    telemetry::Telemetry,
    triple::{Filling, Memory, Rotated, Rotation},
};

/// Bytes in front of LEN in a receive buffer: room for the byte under the read command, chosen so that the payload is
/// aligned.
pub const LEAD: usize = 3;
const _: () = assert!((LEAD + PAYLOAD_OFFSET).is_multiple_of(4));

/// The longest transfer, µs: 258 bytes at 8 MHz take 258 µs; with margin.
pub const TRANSFER_US: u32 = 1_000;

/// How long the chip is left alone after a frame, µs: the commit takes 50. The next sync is at least 0.45 ms after the
/// end of a frame (0.30 ms between two frames of a cycle, 0.15 ms of preamble and sync), of which reading takes 0.26 ms
/// at worst (store-and-forward) and re-arming 0.03 ms.
pub const RESUME_AFTER_US: u32 = 80;

/// Steps without a transfer or a wait before a poll gives the processor back. The machine needs two.
const STEPS: u32 = 8;
/// How long a machine that exceeds that is left alone, µs.
const PAUSE_US: u32 = 1_000;

/// The hardware that the executor needs, with the receive buffer that is being written.
pub trait Port {
    /// A receive buffer.
    type Buffer: Memory;

    /// Starts this transfer, full duplex, chip select low from first to last bit.
    fn start_short(&mut self, short: &Short);
    /// Starts a FIFO read of `len` bytes to place `offset` of the receive buffer, counted from LEN.
    fn start_read(&mut self, offset: usize, len: usize);
    /// Whether the transfer has ended. If so chip select is high again, and this is not asked again before the next
    /// one.
    fn ended(&mut self) -> bool;
    /// What the transfer that ended has clocked in, without the byte under a read command.
    ///
    /// # Errors
    ///
    /// [`Failed`] if it was shorter than asked for.
    fn response(&self) -> Result<&[u8], Failed>;
    /// Stops a transfer that does not end.
    fn abort(&mut self);
    /// Whether the IRQ pin is high.
    fn irq_is_high(&mut self) -> bool;
    /// The counter, µs, at the last rising edge of the IRQ pin, captured by hardware.
    fn irq_edge_us(&mut self) -> u32;
    /// Starts the timer: `us` µs from now.
    fn start_timer(&mut self, us: u32);
    /// Whether that time is over.
    fn elapsed(&mut self) -> bool;
    /// Exchanges the receive buffer. Called while no transfer runs.
    fn exchange(&mut self, with: impl FnOnce(Filling<Self::Buffer>) -> Filling<Self::Buffer>);
    /// The first `len` bytes of the frame in the receive buffer, beginning with LEN. Called while no read runs, which
    /// would put its own bytes in.
    fn arrived(&self, len: usize) -> &[u8];
}

/// A transfer that the hardware did not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed;

/// State of the RFID front end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum FrontEnd {
    /// It has never listened yet.
    Starting,
    /// It is configured and listens.
    Listening,
    /// It was lost, for that reason, and is being brought up again.
    Lost(Fault),
}

/// What is known of a frame beside its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameInfo {
    /// Payload bytes.
    pub len: usize,
    /// The counter, µs, at its end.
    pub ended_us: u32,
    /// What of it was verified while it arrived.
    pub early: Early,
}

impl FrameInfo {
    /// The payload in the receive buffer's `bytes`; empty if the buffer is too short for it.
    #[must_use]
    pub fn payload<'a>(&self, bytes: &'a [u8]) -> &'a [u8] {
        bytes.get(LEAD + PAYLOAD_OFFSET..LEAD + PAYLOAD_OFFSET + self.len).unwrap_or(&[])
    }
}

/// Whom the RFID tasks have to call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Call {
    /// Nobody.
    None,
    /// The commit task: most of a frame is there, time to prepare the image for it.
    Prepare,
    /// The commit task and the scrub task: a buffer was handed on, to be read or to be scrubbed.
    Handed,
}

/// What the RFID tasks do.
#[derive(Debug)]
pub struct Receiver<P> {
    executor: Executor<P>,
    early: Early,
}

impl<P: Port> Receiver<P> {
    /// Makes the first step of the front end's bring-up.
    pub fn start(listener: Listener, port: P) -> Self {
        let mut executor = Executor::new(listener, port);
        // A bring-up begins with a transfer, never with an event.
        let event = executor.resume();
        debug_assert!(event.is_none(), "{event:?}");
        Self { executor, early: Early::default() }
    }

    /// Carries the driver on as far as it goes, for a profile of `N` receivers. A frame goes into `rotation`, and the
    /// driver on with a clean buffer. While a frame arrives, the objects that are complete are verified here, so that
    /// this is not left for after its last bit. Tells whom to call.
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
                    *state = FrontEnd::Listening;
                }),
                ListenerEvent::Fault(fault) => {
                    telemetry.rf_faults.add(1);
                    front_end.lock(|state| *state = FrontEnd::Lost(fault));
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
                ListenerEvent::FieldOn | ListenerEvent::FieldOff => {}
            }
            if matches!(happened, ListenerEvent::Frame { .. }) {
                executor.resume_later();
                return Call::Handed;
            }
            event = executor.resume();
        }
        if let Some(arrived) = executor.take_arrived() {
            let before = early.done();
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

    /// The port, for a test to look at.
    pub fn port(&mut self) -> &mut P {
        self.executor.port()
    }
}

/// A frame was begun in the receive buffer that will not be delivered: goes on with a clean one.
fn replace_buffer<P: Port>(
    executor: &mut Executor<P>,
    rotation: &mut impl Mutex<T = Rotation<P::Buffer, FrameInfo>>,
    telemetry: &Telemetry,
) {
    executor.port().exchange(|begun| {
        let (next, found) = rotation.lock(|rotation| rotation.replace(begun));
        telemetry.scrubbed(found);
        next
    });
}

/// What the executor waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waiting {
    /// The end of a transfer.
    Transfer,
    /// The IRQ pin or the timer, whichever comes first.
    IrqOrTime,
    /// The timer.
    Time,
    /// The timer, after a frame.
    Later,
    /// The owner has been given an event and has not resumed yet.
    Owner,
}

/// The executor: machine and port.
#[derive(Debug)]
pub struct Executor<P> {
    listener: Listener,
    port: P,
    waiting: Waiting,
    /// Where the read that runs ends in the frame, if one runs.
    reading_to: Option<usize>,
    /// How many bytes of the frame the read that has just ended has completed, if one has.
    arrived: Option<usize>,
}

impl<P: Port> Executor<P> {
    /// Nothing has happened yet; [`Executor::resume`] begins the bring-up.
    pub fn new(listener: Listener, port: P) -> Self {
        Self { listener, port, waiting: Waiting::Owner, reading_to: None, arrived: None }
    }

    /// The port, to swap its buffer while an event is in hand.
    pub fn port(&mut self) -> &mut P {
        &mut self.port
    }

    /// How many bytes of the frame that is being received are in the buffer, LEN included: once for each read, when it
    /// has ended. `None` while more are read, since the buffer must not be looked at then.
    pub fn take_arrived(&mut self) -> Option<usize> {
        self.arrived.take().filter(|_| self.reading_to.is_none())
    }

    /// Takes note of what has happened and goes on as far as possible; with an event if there is one, after which
    /// [`Executor::resume`] or [`Executor::resume_later`] has to be called.
    pub fn poll(&mut self) -> Option<ListenerEvent> {
        let step = match self.waiting {
            Waiting::Transfer if self.port.ended() => {
                self.arrived = self.reading_to.take();
                let input = self.port.response().map_or(Input::Failed, Input::Done);
                self.listener.step(input)
            }
            Waiting::Transfer if self.port.elapsed() => {
                self.port.abort();
                self.listener.step(Input::Failed)
            }
            Waiting::IrqOrTime if self.port.irq_is_high() => self.listener.step(Input::Irq),
            Waiting::IrqOrTime | Waiting::Time if self.port.elapsed() => self.listener.step(Input::Timeout),
            Waiting::Later if self.port.elapsed() => self.listener.step(Input::Start),
            Waiting::Later | Waiting::Transfer | Waiting::IrqOrTime | Waiting::Time | Waiting::Owner => return None,
        };
        self.carry_out(step)
    }

    /// Goes on after an event.
    pub fn resume(&mut self) -> Option<ListenerEvent> {
        let step = self.listener.step(Input::Start);
        self.carry_out(step)
    }

    /// Goes on after a frame, but only [`RESUME_AFTER_US`] later, so that the transfers that re-arm the chip do not
    /// interrupt the commit of the frame.
    pub fn resume_later(&mut self) {
        self.wait(Waiting::Later, RESUME_AFTER_US);
    }

    fn carry_out(&mut self, mut step: Step<ListenerEvent>) -> Option<ListenerEvent> {
        for _ in 0..STEPS {
            match step {
                Step::Transfer(Transfer::Short(short)) => {
                    // The transfer first: its bound can be set while it runs.
                    self.port.start_short(&short);
                    self.wait(Waiting::Transfer, TRANSFER_US);
                    return None;
                }
                Step::Transfer(Transfer::Read { offset, len }) => {
                    self.port.start_read(offset, len);
                    self.wait(Waiting::Transfer, TRANSFER_US);
                    self.reading_to = Some(offset + len);
                    return None;
                }
                // A listener sends nothing.
                Step::Transfer(Transfer::Load { .. }) => step = self.listener.step(Input::Failed),
                Step::Wait { us } => {
                    self.wait(Waiting::IrqOrTime, us);
                    // The pin is a level: it may be high already, or again, and then no edge comes.
                    if !self.port.irq_is_high() {
                        return None;
                    }
                    step = self.listener.step(Input::Irq);
                }
                Step::Delay { us } => {
                    self.wait(Waiting::Time, us);
                    return None;
                }
                Step::Event(event) => {
                    self.waiting = Waiting::Owner;
                    self.reading_to = None;
                    self.arrived = None;
                    return Some(event);
                }
            }
        }
        self.wait(Waiting::Time, PAUSE_US);
        None
    }

    fn wait(&mut self, waiting: Waiting, us: u32) {
        self.waiting = waiting;
        self.port.start_timer(us);
    }
}
