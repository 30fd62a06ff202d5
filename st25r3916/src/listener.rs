//! The listener receives NFC-F frames and never answers.
//!
//! # States
//!
//! The names in the diagram are states ([`ListenerState`]), which [`Listener::state`] returns. Words in capitals are
//! events; after an event the machine waits for [`Input::Start`]. A comma separates successive states.
//!
//! ```text
//!        New ◄── FAULT for silence              any state
//!         │ Start                                   │ any other FAULT
//!         ▼                                         ▼
//!     BringingUp ◄── time ── BackingOff ◄── Start ── Faulted
//!         │ CheckingField, LISTENING
//!         ▼
//!      Reported ◄── FIELDON, FIELDOFF ──┐
//!         │ Start                       │
//!         ▼                             │
//!  ┌─► Listening ◄──► ReadingStatus ────┴── nothing for a while ──► CheckingConfiguration ──┐
//!  │                    │ I_rxs                                            CheckingField ◄──┘
//!  │                    ▼                                                        │
//!  │   Receiving ◄──► ReadingStatus, ReadingFifo                                 │
//!  │      ▲             │ FRAME, DROPPED                                         │
//!  │      │             ▼                                                        │
//!  │      │           Delivered                                                  │
//!  │      │             │ Start                                                  │
//!  │      │             ▼                                                        │
//!  │      └── I_rxs ── RearmStatus ◄─────────────────────────────────────────────┘
//!  │                    │
//!  │                    ▼
//!  └── CheckingSetting ◄── RearmUnmask ◄── RearmClear
//! ```
//!
//! The diagram omits two transitions. An error outside a frame leads from ReadingStatus to RearmClear. A second sync
//! within a frame is reported as DROPPED, and Reported then leads back to Receiving.
//!
//! # A frame
//!
//! I_rxs (sync detected) begins a frame, I_rxe ends it, and in between its bytes fill the FIFO, one every 18.9 µs. With
//! [`ReadMode::StoreAndForward`] the machine waits until I_rxe and then reads all bytes but the CRC-16: at 8 MHz 246 µs
//! for a frame of 247 bytes. With [`ReadMode::WhileFilling`] it also reads three times before I_rxe, each time the
//! bytes that have arrived:
//!
//! 1. The first read begins 16 bytes after the sync. These bytes include LEN, which determines the frame's end.
//! 2. The second read begins [`BODY`] bytes before the frame's end, and takes most of the frame.
//! 3. The third read begins [`TAIL`] bytes before the frame's end.
//!
//! So [`TAIL`] - 2 bytes of the payload are left after I_rxe (5 µs at 8 MHz with the command). The CRC-16 may stay in
//! the FIFO unread: the chip has compared it, and re-arming clears the FIFO. The machine never empties the FIFO while
//! the chip fills it: an early read takes one byte less than the level, or takes so long that another byte has come by
//! its end. A late executor finds more bytes, or the end of the frame; the result is the same, only later. A damaged
//! LEN only puts the second read at a wrong instant.
//!
//! # Delivery before re-arming
//!
//! [`ListenerEvent::Frame`] is returned as soon as the last byte is in the buffer. The transfers that re-arm the
//! receiver (status, clear FIFO, unmask receive data: 10 bytes) come after the next [`Input::Start`]. If the next frame
//! has begun by then, the status shows its I_rxs. The machine then does not clear the FIFO (the chip resets it at
//! I_rxs) and receives the frame. It clears only a FIFO that holds bytes, as after a frame, when the next frame is far
//! away. One case cannot be detected: a sync in the few µs between the status read and the clear. If the clear also
//! discards the interrupt (the data sheet contradicts itself), that frame is recognised only by its I_rxe.
//!
//! Clearing the FIFO may also discard the field detector's interrupts, I_eon and I_eof. So the machine reads the field
//! detector's output after a bring-up, and [`ListenerConfig::supervision_us`] after the last interrupt, and reports a
//! change. ST's RFAL reads the same bit before it relies on these interrupts.
//!
//! # Recovery
//!
//! | trouble | reaction |
//! |---|---|
//! | I_rxs without I_rxe | [`Dropped::NoEnd`] 6 ms after I_rxs, re-arm |
//! | I_rxs again without I_rxe | [`Dropped::Overrun`], the new frame is received |
//! | field lost under a frame | [`Dropped::FieldLost`], [`ListenerEvent::FieldOff`], re-arm |
//! | errors without a frame (a start in the middle of one) | re-arm |
//! | no event for [`ListenerConfig::supervision_us`] | configuration checked, field detector read, re-arm |
//! | a register that differs from its setting | [`Fault::Register`] at its read-back, one setting at each re-arming |
//! | no frame for [`SILENCE_US`] | [`Fault::Silence`], bring-up; then after twice that, up to [`SILENCE_LONGEST_US`] |
//! | reset of the chip | [`Fault::Reset`] at the next interrupt or supervision, bring-up |
//! | dead bus, stuck IRQ pin | [`Fault::Bus`], [`Fault::IrqStuck`], bring-up after a back-off |
//!
//! The back-off before a bring-up is 1 ms after the first fault and doubles with each fault up to 64 ms. After silence
//! there is no back-off: the poller may just be off, and the listener could not receive during a back-off.
//!
//! # Settings read back while the chip runs
//!
//! At each re-arming, one of the settings of bring-up is read back, in turn. With a frame every 10 ms each setting is
//! read within 0.12 s; without frames the listener re-arms every 20 ms. The read-back takes at most 8 bytes and is the
//! last transfer before the wait, so that a frame that begins meanwhile is received.

use crate::bring_up::{BringUp, CONFIGURATION_READ, DISPLAY_READ, IDLE_IRQS, Progress, Role};
use crate::command;
use crate::machine::{Fault, Input, Short, Step, Transfer};
use crate::register as reg;
use crate::status::{STATUS_READ, Status};
use crate::{FRAME_US, Variant};

/// The number of bytes that are still to come when the second read of [`ReadMode::WhileFilling`] begins. The third read
/// begins 24 bytes later, 453 µs on air. The second read, at most 227 bytes, takes 237 µs at 8 MHz with its status. The
/// rest of the 453 µs is the executor's, to verify the received bytes.
pub const BODY: usize = 30;
/// The number of bytes, the CRC-16 included, that are still to come when the third read of [`ReadMode::WhileFilling`]
/// begins. They arrive within 113 µs, and the third read, at most 28 bytes, takes 38 µs at 8 MHz with its status. The
/// rest of the 113 µs covers a caller that starts the read late, and one byte's time, 19 µs, because the frame's length
/// byte gives its end only to a whole byte. If the third read is still under way at the frame's end, the delivery is
/// late.
pub const TAIL: usize = 6;
/// How many bytes must have arrived before the first read of [`ReadMode::WhileFilling`] begins.
const HEAD: u16 = 16;
/// The number of bytes that an early read leaves in the FIFO. The chip still fills the FIFO then, and it must not run
/// dry.
const MARGIN: u16 = 1;
/// A FIFO read of this many bytes takes so long, even at 10 MHz, that another byte arrives meanwhile. A third read of
/// this many bytes leaves no [`MARGIN`] in the FIFO if LEN announces more bytes, because little time is left
/// afterwards.
const REFILLED: u16 = 24;
const _: () =
    assert!((1 + REFILLED as u32) * 800 > 18_879, "ns of the command and the bytes at 10 MHz, and of one on air");
/// The time that a read takes besides its bytes, µs: status and command are 10 bytes of 1 µs at 8 MHz.
const READ_OVERHEAD_US: u16 = 10;
/// The time without a delivered frame after which a listener is brought up again, µs: 50 cycles of 10 ms. The listener
/// adds up its waits, so the true time may be longer.
pub const SILENCE_US: u32 = 500_000;
/// The longest time without a frame before a bring-up for silence, µs. The time doubles with each such bring-up in a
/// row.
pub const SILENCE_LONGEST_US: u32 = SILENCE_US << SILENCE_DOUBLINGS;
const SILENCE_DOUBLINGS: u8 = 4;
/// The time, µs, that is added to the silence for each wait without a frame, and for each frame that begins within
/// another. So a listener that receives no frame detects its silence even if interrupts without a frame keep coming.
const DISTURBED_US: u32 = 1_000;
/// The length of the shortest frame, bytes: LEN, one byte of payload, CRC-16.
const SHORTEST: u16 = 4;
const CRC: u16 = 2;
/// The number of bytes of a frame besides its payload: LEN and CRC-16.
const OVERHEAD: u16 = 3;

/// The time on the air of `bytes` bytes at 424 kbit/s, µs: 8 · 32 / 13.56 MHz = 18.879 µs each.
const fn bytes_us(bytes: u16) -> u16 {
    ((bytes as u32 * 1_208) >> 6) as u16
}

/// The size of the caller's receive buffer, bytes. LEN, at most 255, counts itself and the payload; the CRC-16 follows.
pub const BUFFER: usize = 257;
/// The offset of the payload in the receive buffer; the byte before the payload is LEN.
pub const PAYLOAD_OFFSET: usize = 1;

/// The instants at which a listener reads the frame from the FIFO.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReadMode {
    /// The listener reads the whole frame at once after its end (I_rxe).
    StoreAndForward,
    /// The listener reads while the frame arrives, so that few bytes are left to read when the frame ends. The instants
    /// of reading are computed from the bit rate and LEN.
    #[default]
    WhileFilling,
}

/// The configuration of a listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ListenerConfig {
    /// The instants at which the frame is read from the FIFO.
    pub read_mode: ReadMode,
    /// The interval at which the chip is checked, and its receiver re-armed, while no frame comes, µs.
    pub supervision_us: u32,
}

impl ListenerConfig {
    /// The default reads while the frame arrives and checks the chip after 20 ms without a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { read_mode: ReadMode::WhileFilling, supervision_us: 20_000 }
    }
}

impl Default for ListenerConfig {
    fn default() -> Self {
        Self::new()
    }
}

/// The chip's flags about a frame. No flag rejects a frame by itself: the payload has its own checks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameFlags(u8);

impl FrameFlags {
    /// I_crc: the frame's CRC-16 is wrong, or the interrupt of a good frame was read late.
    pub const CRC: Self = Self(0x01);
    /// I_par, I_err1 or I_err2: parity or framing error.
    pub const FRAMING: Self = Self(0x02);
    /// The FIFO ran over.
    pub const OVERFLOW: Self = Self(0x04);
    /// The FIFO was read beyond its content.
    pub const UNDERFLOW: Self = Self(0x08);
    /// LEN differs from the number of bytes received.
    pub const LENGTH: Self = Self(0x10);
    /// The last byte was incomplete, and was left out of the frame.
    pub const PARTIAL: Self = Self(0x20);

    /// No flag at all.
    #[must_use]
    pub const fn empty() -> Self {
        Self(0)
    }

    /// Whether the chip found no error.
    #[must_use]
    pub const fn is_clean(self) -> bool {
        self.0 == 0
    }

    /// Whether every flag of `other` is set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether any flag of `other` is set.
    #[must_use]
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// The flags that are in at least one of both sets.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        // Not covered: only this line, flags that cannot be set at a frame's beginning, since no byte has come; and in
        // the copy for an exchange, framing errors of an answer, and a status in the middle of one, which is read in
        // one piece.
        Self(self.0 | other.0)
    }

    /// The bits of the flags, for a log or a counter.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.0
    }
}

/// The reason why a frame that began is not delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Dropped {
    /// I_rxs came, but no I_rxe within [`crate::FRAME_US`].
    NoEnd,
    /// The field went off during the frame.
    FieldLost,
    /// The frame is too short to hold LEN, one payload byte and the CRC-16.
    Runt,
    /// The frame is longer than LEN can express.
    TooLong,
    /// Another frame began before this frame was read.
    Overrun,
}

/// A listener's event. On any event the caller may exchange the frame buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ListenerEvent {
    /// The chip is configured, checked and listening.
    Listening,
    /// A frame is in the buffer: `buffer[1..1 + len]` is its payload. [`Input::Start`] re-arms the chip.
    Frame {
        /// The payload's length in bytes, 1..=254, from the number of whole bytes received.
        len: usize,
        /// The chip's flags about the frame.
        flags: FrameFlags,
    },
    /// A frame began but is not delivered.
    Dropped(Dropped),
    /// The poller's field has come on.
    FieldOn,
    /// The poller's field has gone off.
    FieldOff,
    /// The chip has failed. [`Input::Start`] brings it up again.
    Fault(Fault),
}

/// The counts of what has happened since the listener was made; each count wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ListenerCounters {
    /// Delivered frames, with or without flags.
    pub frames: u32,
    /// Delivered frames with [`FrameFlags::CRC`].
    pub crc: u32,
    /// Delivered frames with [`FrameFlags::FRAMING`] or [`FrameFlags::PARTIAL`].
    pub framing: u32,
    /// Delivered frames with [`FrameFlags::OVERFLOW`] or [`FrameFlags::UNDERFLOW`].
    pub flow: u32,
    /// Delivered frames with [`FrameFlags::LENGTH`].
    pub length: u32,
    /// Frames that were dropped because of [`Dropped::NoEnd`].
    pub no_end: u32,
    /// Frames that were dropped for any other reason of [`Dropped`].
    pub dropped: u32,
    /// How often the field went off.
    pub field_losses: u32,
    /// Faults reported.
    pub faults: u32,
    /// Bring-ups that succeeded.
    pub bring_ups: u32,
}

impl ListenerCounters {
    const fn frame(&mut self, flags: FrameFlags) {
        count(&mut self.frames);
        count_if(&mut self.crc, flags.intersects(FrameFlags::CRC));
        count_if(&mut self.framing, flags.intersects(FrameFlags::FRAMING.union(FrameFlags::PARTIAL)));
        count_if(&mut self.flow, flags.intersects(FrameFlags::OVERFLOW.union(FrameFlags::UNDERFLOW)));
        count_if(&mut self.length, flags.intersects(FrameFlags::LENGTH));
    }
}

/// A listener's state; the module's documentation has the diagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ListenerState {
    /// The chip needs a bring-up, which the next step begins. Either no bring-up was made yet, or silence was reported.
    New,
    /// A fault was reported, and the chip needs a bring-up.
    Faulted,
    /// The listener waits before the next bring-up.
    BackingOff,
    /// The chip is being brought up.
    BringingUp,
    /// An event was reported; the receiver is armed, or a frame is being received.
    Reported,
    /// The end of a frame, delivered or dropped, was reported; the receiver needs re-arming.
    Delivered,
    /// Re-arming: the status is being read.
    RearmStatus,
    /// Re-arming: the FIFO is being cleared.
    RearmClear,
    /// Re-arming: the receiver is being unmasked.
    RearmUnmask,
    /// The listener waits for a frame.
    Listening,
    /// The listener waits for the remaining bytes of a frame.
    Receiving,
    /// The status is being read, within or outside a frame.
    ReadingStatus {
        /// Whether the wait before this status read timed out.
        late: bool,
    },
    /// The receiver is re-armed, and one of the settings of bring-up is being read back.
    CheckingSetting,
    /// Operation control, mode and bit rate are being read after a wait without an event.
    CheckingConfiguration,
    /// The field detector's output is being read after a bring-up, or after a wait without an event.
    CheckingField {
        /// Whether this read follows a wait without an event, so that the receiver is re-armed afterwards.
        idle: bool,
    },
    /// Bytes of a frame are being read.
    ReadingFifo {
        /// The number of bytes that are read.
        count: u16,
        /// Whether the frame has ended, so that this read takes its last bytes.
        end: bool,
    },
}

/// The frame that is being received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    plan: Plan,
    /// The number of bytes of the frame in the caller's buffer.
    got: u16,
    /// The number of bytes of the whole frame, LEN + 2, once LEN is known.
    total: Option<u16>,
    /// The time waited since I_rxs, µs, a lower bound of the time passed. All times in this structure are at most
    /// [`FRAME_US`], or just above it.
    waited_us: u16,
    waiting_us: u16,
    /// The time of the last read, with its status, at 8 MHz, µs. On a slower bus the next read comes later.
    read_us: u16,
    flags: FrameFlags,
    /// The number of bytes of the CRC-16 that stay unread. It is known once the frame has ended.
    unread: u16,
}

/// The purpose of the next time-out within a frame: one of the three early reads, or the limit for the frame's end. A
/// purpose is never followed by an earlier one, so a frame costs at most three reads before its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plan {
    Head,
    Body,
    Tail,
    End,
}

/// The state machine of a listener.
#[derive(Clone, Debug)]
pub struct Listener {
    config: ListenerConfig,
    bring_up: BringUp,
    state: ListenerState,
    frame: Option<Frame>,
    /// The interrupts I_eon and I_eof that came and are not reported yet.
    field_irqs: u8,
    field_on: bool,
    idle_irqs: u8,
    /// The number of [`Fault::Silence`]s in a row.
    silences: u8,
    /// The time waited since the last delivered frame or since bring-up, µs; a lower bound of the time passed.
    silent_us: u32,
    counters: ListenerCounters,
    /// The flags of the last delivered frame. The next step counts them. Counting at once would delay the delivery.
    uncounted: Option<FrameFlags>,
}

impl Listener {
    /// Returns a listener that has not accessed its chip yet. The first [`Input::Start`] begins bring-up.
    #[must_use]
    pub const fn new(config: ListenerConfig) -> Self {
        Self::with_role(Role::Listener, config)
    }

    pub(crate) const fn with_role(role: Role, config: ListenerConfig) -> Self {
        Self {
            config,
            bring_up: BringUp::new(role),
            state: ListenerState::New,
            frame: None,
            field_irqs: 0,
            field_on: false,
            idle_irqs: 0,
            silences: 0,
            silent_us: 0,
            counters: ListenerCounters {
                frames: 0,
                crc: 0,
                framing: 0,
                flow: 0,
                length: 0,
                no_end: 0,
                dropped: 0,
                field_losses: 0,
                faults: 0,
                bring_ups: 0,
            },
            uncounted: None,
        }
    }

    /// The chip's type, as the last bring-up read it; `None` before that.
    #[must_use]
    pub const fn variant(&self) -> Option<Variant> {
        self.bring_up.variant()
    }

    /// The chip's supply voltage (VDD) as the last bring-up measured it, mV, in steps of 23.4 mV, within
    /// [`crate::SUPPLY_MIN_MV`]..=[`crate::SUPPLY_MAX_MV`].
    #[must_use]
    pub const fn supply_mv(&self) -> Option<u16> {
        self.bring_up.supply_mv()
    }

    /// The listener's state.
    #[must_use]
    pub const fn state(&self) -> ListenerState {
        self.state
    }

    /// The counts of what has happened since the listener was made.
    #[must_use]
    pub const fn counters(&self) -> ListenerCounters {
        let mut counters = self.counters;
        if let Some(flags) = self.uncounted {
            counters.frame(flags);
        }
        counters
    }

    /// Takes one input and returns the next step.
    pub fn step(&mut self, input: Input<'_>) -> Step<ListenerEvent> {
        // Not covered: a transfer that has failed: none does on the bench, as in the executor.
        if matches!(input, Input::Failed) {
            return self.fault(Fault::Bus);
        }
        // Not covered: only this line, inputs that a state does not wait for, which the executor never gives.
        match (self.state, input) {
            // A bring-up is due in these states.
            (ListenerState::New, _) | (ListenerState::BackingOff, Input::Timeout) => {
                self.state = ListenerState::BringingUp;
                let progress = self.bring_up.begin();
                // Not covered: the ends of a bring-up at its beginning, in this copy of `progress`: it begins with a
                // transfer.
                self.progress(progress)
            }
            (ListenerState::Faulted | ListenerState::BackingOff, _) => {
                self.state = ListenerState::BackingOff;
                Step::Delay { us: self.bring_up.back_off_us() }
            }
            (ListenerState::BringingUp, input) => {
                // Not covered: only this line, the faults of other roles and of other lengths, which the compiler has
                // put together here.
                let progress = self.bring_up.step(input);
                self.progress(progress)
            }
            (ListenerState::Reported, _) => self.resume(),
            (ListenerState::Delivered, _) => {
                self.counters = self.counters();
                self.uncounted = None;
                self.short(ListenerState::RearmStatus, STATUS_READ)
            }

            // Not covered: only this line, in the path behind a level beyond the size of the FIFO, as on a line that is
            // stuck high: the line would have to get stuck within the 0.1 ms since the last status.
            (ListenerState::RearmStatus, Input::Done(response)) => match Status::parse(response) {
                Ok(status) => self.rearm(status),
                Err(fault) => self.fault(fault),
            },
            (ListenerState::RearmClear, Input::Done(_)) => {
                self.short(ListenerState::RearmUnmask, command::UNMASK_RECEIVE_DATA)
            }
            (ListenerState::RearmUnmask, Input::Done(_)) => {
                self.short(ListenerState::CheckingSetting, self.bring_up.read_next())
            }
            (ListenerState::CheckingSetting, Input::Done(response)) => match self.bring_up.check_next(response) {
                // Not covered: only this line, a response of another length: each is as long as its transfer.
                Ok(()) => self.resume(),
                Err(fault) => self.fault(fault),
            },

            (ListenerState::Listening | ListenerState::Receiving, Input::Irq) => {
                self.short(ListenerState::ReadingStatus { late: false }, STATUS_READ)
            }
            (ListenerState::Listening | ListenerState::Receiving, Input::Timeout) => {
                self.short(ListenerState::ReadingStatus { late: true }, STATUS_READ)
            }
            (ListenerState::ReadingStatus { late }, Input::Done(response)) => match Status::parse(response) {
                Ok(status) => self.status(status, late),
                Err(fault) => self.fault(fault),
            },
            (ListenerState::ReadingFifo { count, end }, Input::Done(bytes)) => {
                // Not covered: only this line, no byte: each read of the FIFO has at least one.
                self.fifo(count, end, bytes.first().copied())
            }
            (ListenerState::CheckingConfiguration, Input::Done(response)) => {
                match self.bring_up.role().check_configuration(response) {
                    Ok(()) => self.short(ListenerState::CheckingField { idle: true }, DISPLAY_READ),
                    Err(fault) => self.fault(fault),
                }
            }
            (ListenerState::CheckingField { idle }, Input::Done(response)) => {
                // Not covered: only this line, a response of another length: each is as long as its transfer.
                if let [_, display] = response {
                    let (there, irq) =
                        if display & reg::DISPLAY_FIELD == 0 { (false, reg::IRQ_EOF) } else { (true, reg::IRQ_EON) };
                    self.field_irqs = if there == self.field_on { 0 } else { irq };
                }
                // A frame may have begun since the last status read, so the status is read again before re-arming.
                if idle {
                    self.short(ListenerState::RearmStatus, STATUS_READ)
                } else {
                    self.event(ListenerState::Reported, ListenerEvent::Listening)
                }
            }
            _ => self.fault(Fault::Executor),
        }
        // Not covered: only this line, the return from arms above that no run takes.
    }

    fn short(&mut self, state: ListenerState, short: Short) -> Step<ListenerEvent> {
        // Not covered: only this line, in the path behind a response of another length, where the compiler has put the
        // fault for it.
        self.state = state;
        Step::Transfer(Transfer::Short(short))
    }

    fn event(&mut self, state: ListenerState, event: ListenerEvent) -> Step<ListenerEvent> {
        self.state = state;
        Step::Event(event)
    }

    pub(crate) fn fault(&mut self, fault: Fault) -> Step<ListenerEvent> {
        self.frame = None;
        self.field_irqs = 0;
        self.silent_us = 0;
        count(&mut self.counters.faults);
        // Not covered: only this line, the other kind of fault: in `wait` each fault is silence, in each other copy of
        // this function none is.
        let state = if let Fault::Silence { .. } = fault {
            // Silence leads to a bring-up without a back-off. Instead, `silences` doubles the time to the next report
            // of silence.
            ListenerState::New
        } else {
            self.field_on = false;
            self.bring_up.failed();
            ListenerState::Faulted
        };
        // Not covered: the copies for faults of the executor and of the bus, which no run has, as `step` says.
        self.event(state, ListenerEvent::Fault(fault))
    }

    fn progress(&mut self, progress: Progress) -> Step<ListenerEvent> {
        match progress {
            Progress::Transfer(short) => Step::Transfer(Transfer::Short(short)),
            Progress::Wait(us) => Step::Wait { us },
            Progress::Failed(fault) => self.fault(fault),
            Progress::Finished => {
                self.idle_irqs = 0;
                count(&mut self.counters.bring_ups);
                self.short(ListenerState::CheckingField { idle: false }, DISPLAY_READ)
            }
        }
    }

    /// Handles the status that is read at re-arming: a frame that has already begun is received, not cleared.
    fn rearm(&mut self, status: Status) -> Step<ListenerEvent> {
        self.note_field(status);
        // The status may have the beginning of a frame already, if the frame met the re-arming.
        if status.is_set(reg::IRQ_RXS) {
            // Not covered: the end of a frame that begins at the re-arming: the status before was read too recently for
            // a frame to begin and end behind it. And at a beginning the FIFO is empty, so no byte is incomplete.
            self.status_begins(status)
        } else if status.is_quiet() && status.count == 0 && !status.flow_error() {
            // The FIFO is empty and is not cleared. A clear could discard the I_rxs of a frame that begins just now.
            self.short(ListenerState::RearmUnmask, command::UNMASK_RECEIVE_DATA)
        } else {
            self.short(ListenerState::RearmClear, command::CLEAR_FIFO)
        }
    }

    /// Reports changes of the field that are not reported yet, or waits if there are none.
    fn resume(&mut self) -> Step<ListenerEvent> {
        // Not covered: only this line, a frame under way, in the copy behind a re-arming: a frame is under way only
        // behind an event, for which the compiler has made another copy.
        if self.frame.is_none() {
            let first = if self.field_on { reg::IRQ_EOF } else { reg::IRQ_EON };
            let due = if self.field_irqs & first != 0 { first } else { self.field_irqs };
            self.field_irqs &= !due;
            // Not covered: only this line, a change of the field, in the copy behind an event: it would be a second one
            // that the same status shows.
            if due != 0 {
                self.field_on = due == reg::IRQ_EON;
                if self.field_on {
                    return self.event(ListenerState::Reported, ListenerEvent::FieldOn);
                }
                count(&mut self.counters.field_losses);
                return self.event(ListenerState::Reported, ListenerEvent::FieldOff);
            }
        }
        self.wait()
    }

    fn wait(&mut self) -> Step<ListenerEvent> {
        // Not covered: only this line, the greatest number of doublings, which 7.5 s of silence reach.
        if self.silent_us >= SILENCE_US << self.silences.min(SILENCE_DOUBLINGS) {
            self.silences = self.silences.saturating_add(1);
            return self.fault(Fault::Silence { field: self.field_on });
        }
        let (state, us) = match &mut self.frame {
            None => {
                self.silent_us += DISTURBED_US;
                (ListenerState::Listening, self.config.supervision_us)
            }
            Some(frame) => {
                // Not covered: only this line, the paths of `Frame::next_wait_us` that are explained there.
                frame.waiting_us = frame.next_wait_us();
                (ListenerState::Receiving, u32::from(frame.waiting_us))
            }
        };
        self.state = state;
        Step::Wait { us }
    }

    /// Evaluates a status that was read after a frame was delivered. Returns whether another frame has begun. The next
    /// [`Input::Start`] receives that frame, unless it has ended already.
    pub(crate) fn overtaken(&mut self, status: Status) -> bool {
        self.note_field(status);
        let (begun, over) = (status.is_set(reg::IRQ_RXS), status.is_set(reg::IRQ_RXE));
        if begun && !over {
            self.begin_frame(status);
            self.state = ListenerState::Reported;
        }
        begun || over
    }

    fn note_field(&mut self, status: Status) {
        self.field_irqs |= status.timer & (reg::IRQ_EON | reg::IRQ_EOF);
    }

    fn status(&mut self, status: Status, late: bool) -> Step<ListenerEvent> {
        self.note_field(status);
        let idle = match self.frame {
            None => status.is_quiet(),
            Some(_) => !status.is_set(reg::IRQ_RXS | reg::IRQ_RXE),
        };
        if idle && !late {
            self.idle_irqs += 1;
            if self.idle_irqs >= IDLE_IRQS {
                return self.fault(Fault::IrqStuck);
            }
        } else {
            self.idle_irqs = 0;
        }
        match &mut self.frame {
            // Not covered: only this line, in the path of a frame that is too long, as in `Frame::ends`.
            Some(_) => self.status_in_frame(status, late),
            // Not covered: only this line, which the compiler asks twice, once for quiet statuses and once for others,
            // so that each copy has one outcome.
            None if status.is_set(reg::IRQ_RXS | reg::IRQ_RXE) => self.status_begins(status),
            // Not covered: only this line, which the compiler asks twice: a quiet status has no error, and without a
            // frame an error raises the interrupt at once, so that a late status has none.
            None if status.error != 0 => self.short(ListenerState::RearmClear, command::CLEAR_FIFO),
            None if late => {
                // Not covered: the limit of the sum, since a bring-up for silence begins it anew after 8 s at most.
                self.silent_us = self.silent_us.saturating_add(self.config.supervision_us);
                self.short(ListenerState::CheckingConfiguration, CONFIGURATION_READ)
            }
            None => self.resume(),
        }
    }

    /// Begins a frame. If the status shows I_rxe without I_rxs, the frame is over already, and its I_rxs was cleared.
    fn status_begins(&mut self, status: Status) -> Step<ListenerEvent> {
        // A frame proves that there is a field, even without a report by I_eon, for example if the field was on at the
        // start.
        self.field_on = true;
        self.begin_frame(status);
        if status.is_set(reg::IRQ_RXE) { self.frame_ends(status) } else { self.wait() }
    }

    fn begin_frame(&mut self, status: Status) {
        // Not covered: only this line, the other read mode: each port has its own, and the compiler keeps the code for
        // both.
        self.frame.insert(Frame::new(self.config.read_mode)).note(status);
    }

    fn status_in_frame(&mut self, status: Status, late: bool) -> Step<ListenerEvent> {
        let Some(frame) = &mut self.frame else {
            return self.fault(Fault::Executor);
        };
        if status.is_set(reg::IRQ_RXS) {
            // The chip resets the FIFO at each I_rxs, so the unread bytes of the first frame are lost. If I_rxe came as
            // well, it is unknown which of the two frames has ended.
            if status.is_set(reg::IRQ_RXE) {
                return self.lose(Dropped::Overrun);
            }
            self.silent_us += DISTURBED_US;
            self.begin_frame(status);
            count(&mut self.counters.dropped);
            return self.event(ListenerState::Reported, ListenerEvent::Dropped(Dropped::Overrun));
        }
        frame.note(status);
        if status.is_set(reg::IRQ_RXE) {
            return self.frame_ends(status);
        }
        if status.timer & reg::IRQ_EOF != 0 {
            return self.lose(Dropped::FieldLost);
        }
        if !late {
            return self.wait();
        }
        frame.waited_us = frame.waited_us.saturating_add(frame.waiting_us);
        if frame.plan == Plan::End {
            return self.lose(Dropped::NoEnd);
        }
        let got = frame.got;
        // Not covered: only this line, a frame of which all bytes have come: it ends before the wait for its last read
        // does.
        let more_comes = frame.total.is_some_and(|total| total > got + status.count + MARGIN);
        let refilled = frame.plan == Plan::Tail && status.count >= REFILLED && more_comes;
        let margin = if refilled { 0 } else { MARGIN };
        frame.advance();
        if status.count <= margin {
            self.wait()
            // Not covered: only this line, too many bytes, as in `Frame::ends`.
        } else if is_too_long(got + status.count - margin) {
            // Not covered: too many bytes, as in `Frame::ends`.
            self.lose(Dropped::TooLong)
        } else {
            self.read(got, status.count - margin, false)
        }
    }

    /// Ends the frame: reads its remaining bytes without the CRC-16, which the chip has compared already.
    fn frame_ends(&mut self, status: Status) -> Step<ListenerEvent> {
        // Not covered: no frame: this is called only in states with one, so only a flipped bit takes it away.
        let Some(frame) = &mut self.frame else {
            return self.fault(Fault::Executor);
        };
        // Not covered: only this line, the path of a frame that is too long, as in `Frame::ends`.
        match frame.ends(status) {
            Err(why) => self.lose(why),
            Ok(0) => self.deliver(),
            Ok(left) => {
                let got = frame.got;
                self.read(got, left, true)
            }
        }
        // Not covered: only this line, the return for a state without a frame, as above.
    }

    fn read(&mut self, got: u16, count: u16, end: bool) -> Step<ListenerEvent> {
        self.state = ListenerState::ReadingFifo { count, end };
        Step::Transfer(Transfer::Read { offset: usize::from(got), len: usize::from(count) })
    }

    fn fifo(&mut self, count: u16, end: bool, first: Option<u8>) -> Step<ListenerEvent> {
        // Not covered: no frame, as above.
        let Some(frame) = &mut self.frame else {
            return self.fault(Fault::Executor);
        };
        frame.was_read(count, first);
        if end { self.deliver() } else { self.wait() }
        // Not covered: only this line, the return for a state without a frame, as above.
    }

    fn deliver(&mut self) -> Step<ListenerEvent> {
        let Some(frame) = &self.frame else {
            return self.fault(Fault::Executor);
        };
        let (len, flags) = frame.delivered();
        self.frame = None;
        self.bring_up.works();
        (self.silences, self.silent_us) = (0, 0);
        self.uncounted = Some(flags);
        self.event(ListenerState::Delivered, ListenerEvent::Frame { len, flags })
    }

    fn lose(&mut self, why: Dropped) -> Step<ListenerEvent> {
        if let Some(frame) = self.frame.take() {
            // Not covered: the limit of the sum, as in `status`.
            self.silent_us = self.silent_us.saturating_add(u32::from(frame.waited_us));
        }
        count(match why {
            Dropped::NoEnd => &mut self.counters.no_end,
            _ => &mut self.counters.dropped,
        });
        self.event(ListenerState::Delivered, ListenerEvent::Dropped(why))
    }
}

impl Frame {
    pub(crate) const fn new(mode: ReadMode) -> Self {
        Self {
            plan: match mode {
                ReadMode::StoreAndForward => Plan::End,
                ReadMode::WhileFilling => Plan::Head,
            },
            got: 0,
            total: None,
            waited_us: 0,
            waiting_us: 0,
            read_us: 0,
            flags: FrameFlags::empty(),
            unread: 0,
        }
    }

    pub(crate) fn note(&mut self, status: Status) {
        let flag = |set: bool, flag: FrameFlags| if set { flag } else { FrameFlags::empty() };
        let ended = status.is_set(reg::IRQ_RXE);
        self.flags = self
            .flags
            .union(flag(status.error & reg::IRQ_CRC != 0, FrameFlags::CRC))
            .union(flag(status.error & reg::IRQ_FRAMING != 0, FrameFlags::FRAMING))
            .union(flag(status.fifo & reg::FIFO_OVERFLOW != 0, FrameFlags::OVERFLOW))
            .union(flag(status.fifo & reg::FIFO_UNDERFLOW != 0, FrameFlags::UNDERFLOW))
            // While the frame still arrives, an incomplete last byte is normal.
            .union(flag(ended && status.fifo & reg::FIFO_LAST_BITS != 0, FrameFlags::PARTIAL));
    }

    /// Ends the frame. Returns the number of bytes that are still to be read, from [`Frame::got`] on.
    ///
    /// # Errors
    /// The reason why the frame that has ended is not delivered.
    pub(crate) fn ends(&mut self, status: Status) -> Result<u16, Dropped> {
        // The FIFO's level counts a byte within which the frame broke off, but this byte is not part of the frame. An
        // early read may have taken it already.
        let mut count = status.count;
        if self.flags.contains(FrameFlags::PARTIAL) {
            // Not covered: only this line, no byte in the FIFO, although the last one is incomplete, as below.
            match count.checked_sub(1) {
                Some(whole) => count = whole,
                // Not covered: an incomplete byte that an early read has taken: the model of the chip puts it into the
                // FIFO only with I_rxe, behind the early reads. No document says when silicon does.
                None => self.got = self.got.saturating_sub(1),
            }
        }
        self.unread = count.min(CRC);
        if self.got + count < SHORTEST {
            Err(Dropped::Runt)
            // Not covered: only this line, in the copy for an exchange: LEN announces no more bytes than the buffer
            // has, so only a level of the FIFO that is read wrong just at the end of an answer is higher.
        } else if is_too_long(self.got + count) {
            Err(Dropped::TooLong)
        } else {
            Ok(count - self.unread)
        }
    }

    /// Records a read of `count` bytes of the frame. `first` is the first of these bytes.
    pub(crate) fn was_read(&mut self, count: u16, first: Option<u8>) {
        // Not covered: in the copy for an exchange, a second read, and one without a byte: an answer is read in one
        // piece.
        if self.got == 0 {
            self.total = first.map(|len| u16::from(len) + 2);
        }
        self.got += count;
        self.read_us = count + READ_OVERHEAD_US;
    }

    /// The payload's length of a complete frame, and the frame's flags.
    pub(crate) fn delivered(&self) -> (usize, FrameFlags) {
        let received = self.got + self.unread;
        // Not covered: a LEN that is not known: a frame that is delivered has at least one read, of which LEN is the
        // first byte.
        let flags = if self.total == Some(received) { self.flags } else { self.flags.union(FrameFlags::LENGTH) };
        (usize::from(received.saturating_sub(OVERHEAD)), flags)
    }

    fn advance(&mut self) {
        self.plan = match self.plan {
            Plan::Head => Plan::Body,
            Plan::Body => Plan::Tail,
            Plan::Tail | Plan::End => Plan::End,
        };
    }

    /// Returns the time of the next wait, µs. The wait ends when the bytes of the next early read should have arrived,
    /// counted from the last read and less its duration. Without a further early read it ends when the longest frame
    /// would have ended.
    fn next_wait_us(&mut self) -> u16 {
        let left_us = (FRAME_US as u16).saturating_sub(self.waited_us).max(1);
        loop {
            // Not covered: only this line, in the turns that the compiler has unrolled, the plans that a turn cannot
            // have, since each plan follows the one before.
            let to_come = match self.plan {
                Plan::Head => return bytes_us(HEAD),
                Plan::Body => BODY as u16,
                Plan::Tail => TAIL as u16,
                Plan::End => return left_us,
            };
            // The number of the frame's bytes that had arrived when the status before the last read was evaluated.
            let arrived = self.got + MARGIN;
            if let Some(total) = self.total
                // Not covered: only this line, in the unrolled turn of the last read, no bytes to come: a frame reaches
                // this plan with bytes to come.
                && total > arrived + to_come
            {
                // Not covered: only this line, the least time: the bytes to come take longer than the read before them.
                return bytes_us(total - to_come - arrived).saturating_sub(self.read_us).clamp(1, left_us);
            }
            // Not covered: the plans in the turns that the compiler has unrolled, as above.
            self.advance();
        }
    }
}

const fn is_too_long(bytes: u16) -> bool {
    bytes as usize > BUFFER
}

const fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}

const fn count_if(counter: &mut u32, condition: bool) {
    *counter = counter.wrapping_add(condition as u32);
}
