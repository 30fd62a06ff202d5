//! The events that a log holds.

use profile::Layout;
use serde::{Deserialize, Serialize};

use crate::{Disturbance, HoldEvent};

/// The settings of a run, which an event log states before its first event.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// The version of the log's format: [`Header::VERSION`].
    pub version: u32,
    /// The number of receivers in the profile: 1, 2, 3 or 5.
    pub gps: usize,
    /// The seed of the run's random numbers.
    pub seed: u64,
    /// The clock that determines how long the cores' instructions take: `fast`, `optimistic` or `pessimistic`.
    pub clock: String,
    /// Whether an active hold is beside the link.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hold: bool,
}

impl Header {
    /// The version of the format that this crate writes and reads.
    pub const VERSION: u32 = 4;

    /// Returns the layout of what the DPR shows in the run.
    ///
    /// # Panics
    ///
    /// Panics if no profile has this number of receivers.
    #[must_use]
    pub fn layout(&self) -> Layout {
        let layout = Layout::for_receivers(self.gps).expect("a profile has 1, 2, 3 or 5 receivers");
        if self.hold { layout.with_hold() } else { layout }
    }

    /// Returns whether the run uses the pessimistic clock, on which each instruction takes the longest time that it may
    /// take on silicon.
    #[must_use]
    pub fn worst_case(&self) -> bool {
        self.clock == "pessimistic"
    }
}

/// One of the two boards of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Board {
    /// HORUS, the sending side.
    Horus,
    /// The DPR, the receiving side.
    Dpr,
}

/// The cause of a restart of a board's microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The board's supply came on.
    PowerOn,
    /// The supply fell below the microcontroller's threshold for a moment.
    BrownOut,
    /// The reset pin was pulled.
    Pin,
    /// The watchdog reset the microcontroller.
    Watchdog,
    /// The microcontroller's core locked up.
    Lockup,
    /// The firmware requested the reset.
    Software,
    /// The microcontroller woke from a sleep mode that ends in a reset.
    Wakeup,
}

/// A string of bytes, stored in a log as two hexadecimal digits each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bytes(pub Vec<u8>);

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Self {
        Self(bytes)
    }
}

impl std::ops::Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

impl Serialize for Bytes {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let digit = |nibble: u8| char::from_digit(u32::from(nibble), 16).unwrap_or('0');
        let digits: String = self.0.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]).collect();
        to.serialize_str(&digits)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        let nibbles: Option<Vec<u8>> =
            text.chars().map(|digit| digit.to_digit(16).and_then(|nibble| u8::try_from(nibble).ok())).collect();
        match nibbles {
            Some(nibbles) if nibbles.len() % 2 == 0 => {
                Ok(Self(nibbles.chunks(2).map(|pair| pair[0] << 4 | pair[1]).collect()))
            }
            _ => Err(serde::de::Error::custom("bytes are two hexadecimal digits each")),
        }
    }
}

/// A change in the buffers of the DPR's SPI peripheral, which determine what a transaction reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SsiEvent {
    /// The processor has taken the buffers from the SPI peripheral. A transaction that begins now reads only 0xFF.
    Held,
    /// The processor has given the buffers back to the SPI peripheral.
    Released,
    /// The SPI peripheral is ready: a transaction that begins now is served.
    Ready,
    /// A transaction has begun that is not served.
    Busy,
}

/// Something that happened in a run. If several events have one instant, the log has them in the order of the variants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A board's supply goes on or off.
    Power {
        /// The board whose supply changes.
        board: Board,
        /// Whether the supply goes on.
        on: bool,
    },
    /// A board's microcontroller restarts.
    Reset {
        /// The board that restarts.
        board: Board,
        /// The cause of the reset.
        cause: Cause,
        /// Whether the bench reset the board on purpose, by the reset pin or the supply.
        asked: bool,
    },
    /// The bench disturbs something on purpose. A change of a board's supply or reset pin has its own event.
    Injected {
        /// The kind of fault, in words for the reader of the log.
        kind: String,
        /// What the fault disturbs.
        disturbs: Disturbance,
        /// The instant, ns, at which the fault's cause goes away. It is the event's own instant for a fault without a
        /// duration.
        until: u64,
    },
    /// A board hangs: the bench has stopped its core, or the board has been warned of a falling supply and need not do
    /// anything more. The hang ends when the board starts or loses its supply.
    Hung {
        /// The board that hangs.
        board: Board,
    },
    /// A board has to enter its safe state: its microcontroller has warned its firmware of a falling supply, or a task
    /// of its cycle ran although nothing had called it.
    Warned {
        /// The board that was warned.
        board: Board,
    },
    /// A board's external oscillator fails, or works again. It works when the run begins.
    Crystal {
        /// The board whose oscillator changes.
        board: Board,
        /// Whether the oscillator works.
        works: bool,
    },
    /// The levels of a pair of pins from which HORUS reads one of its inputs change.
    StateInput {
        /// The number of the input: 0 the relay, 1 the motor cut, 2 the emergency measure.
        input: usize,
        /// The level of the pin that is high while the input is active.
        active: bool,
        /// The level of the pin that is high while the input is inactive.
        inactive: bool,
    },
    /// HORUS's TICK pin rose: its 10 ms timer began the next cycle.
    Tick,
    /// The true position of the simulated aircraft at a tick. A run that plays a recording has no such event.
    Aircraft {
        /// The latitude in 1e-9 degrees, north positive.
        latitude: i64,
        /// The longitude in 1e-9 degrees, east positive.
        longitude: i64,
        /// The height above the ellipsoid, mm.
        height: i64,
    },
    /// Chip select of HORUS's front end rose after a transmit command was written to the front end.
    Command,
    /// HORUS's front end switched its carrier.
    Field {
        /// Whether the carrier is on.
        on: bool,
    },
    /// A frame of HORUS's front end has ended on the air: the event's instant is the end of the frame's last bit.
    Sent {
        /// The instant, ns, at which the frame's first preamble bit began.
        started: u64,
        /// The nominal bit rate of the frame, bit/s.
        bit_rate: u32,
        /// The bytes of the frame: LEN, payload and CRC-16.
        bytes: Bytes,
        /// Whether all bytes that LEN announced were sent.
        whole: bool,
    },
    /// A carrier begins or ends at the DPR's antenna.
    FieldHeard {
        /// Whether there is a carrier.
        on: bool,
    },
    /// A frame has ended at the DPR's antenna: the event's instant is the end of the frame's last bit. A frame lost on
    /// the air has no such event.
    Heard {
        /// The instant, ns, at which the frame's first preamble bit began.
        started: u64,
        /// The bytes of the frame as they arrived: LEN, payload and CRC-16.
        bytes: Bytes,
        /// Whether all bytes that LEN announced arrived.
        whole: bool,
    },
    /// The DPR's front end began to send, although a listener must never answer.
    Answer,
    /// A receiver on a bus has bytes to send. They wait in the receiver until HORUS reads them.
    Offered {
        /// The receiver's number, from 0.
        receiver: usize,
        /// The bytes that wait in the receiver.
        bytes: Bytes,
    },
    /// A receiver began to put bytes on its line, without a gap between them.
    Fed {
        /// The receiver's number, from 0.
        receiver: usize,
        /// The time that each byte takes on the line, ns.
        byte_ns: u64,
        /// The bytes that cross the line.
        bytes: Bytes,
        /// Whether the bytes arrive as the receiver sent them. On a UART this needs the right bit rate and a line
        /// without noise or break. On a bus the transaction must carry the bytes unchanged and end properly.
        clean: bool,
        /// The instant, ns, since which these bytes have waited in a receiver on a bus; `None` for a UART.
        #[serde(default)]
        since: Option<u64>,
    },
    /// A simulated receiver has these settings from now on.
    Settings {
        /// The receiver's number, from 0.
        receiver: usize,
        /// The dynamic model by which the receiver navigates, as u-blox' CFG-NAVSPG-DYNMODEL counts them.
        model: u8,
        /// Whether the receiver sends NAV-PVT, the message from which HORUS takes positions.
        position: bool,
    },
    /// The DPR's FRESH pin rose or fell.
    Fresh {
        /// Whether the pin rose.
        high: bool,
        /// The bytes that a transaction would read as soon as the DPR is ready after FRESH rose. `None` if FRESH fell,
        /// or if a transaction began before the DPR was ready.
        offered: Option<Bytes>,
    },
    /// The state of the buffers of the DPR's SPI peripheral changed.
    Ssi(SsiEvent),
    /// The flight controller's chip select fell.
    Selected,
    /// The flight controller's chip select rose: a transaction is over.
    Transaction {
        /// The instant, ns, at which the DPR's pin detected the fall of chip select at the transaction's start.
        selected: u64,
        /// The bytes that the flight controller sent in the transaction.
        mosi: Bytes,
        /// The bytes that the flight controller read in the transaction.
        miso: Bytes,
    },
    /// The verdict of the flight controller's client on the transaction that ended at this instant.
    Decided {
        /// The timestamp of the position to fly by, ms; `None` if there is none.
        position: Option<u32>,
        /// The age, µs, of the last sample when the transaction began; `None` if the client does not know the age.
        age_us: Option<u32>,
    },
    /// The flight controller forwarded a profile to the base station without changing it.
    Forwarded {
        /// The objects of the image without Link-Status.
        profile: Bytes,
    },
    /// The base station received a profile.
    Arrived {
        /// The bytes of the profile as it arrived.
        profile: Bytes,
        /// The objects that the base station shows as valid: bit 0 is Reported-Position, bit n is GPSn.
        shown: u8,
    },
    /// The base station's statement about the drone. It is logged from time to time, and whenever the alarms change.
    Station {
        /// The age of the Reported-Position that the base station shows, µs; `None` if it shows none.
        age_us: Option<u64>,
        /// The alarms that hold, by the names that programs use for them.
        alarms: Vec<String>,
    },
    /// A microcontroller or a peripheral found an access or a state that its manual forbids.
    Finding {
        /// The board on which the finding was made.
        board: Board,
        /// Whether the board's core has met a fault or locked up, after which the board can only restart.
        fault: bool,
        /// The finding in words.
        text: String,
    },
    /// A front end was used against its data sheet.
    Misuse {
        /// The board whose front end was misused.
        board: Board,
        /// The misuse in words.
        text: String,
    },
    /// The bench acted on a board too late, so the run is not exact.
    Late {
        /// The board on which the bench acted late.
        board: Board,
        /// The delay in words.
        text: String,
    },
    /// Something that the active hold did, or that was done to it.
    Hold(HoldEvent),
    /// The value of a counter of a firmware at the end of the run. The bench reads it from RAM, as a debug probe does.
    Counter {
        /// The board whose firmware keeps the counter.
        board: Board,
        /// The counter's name.
        name: String,
        /// The counter's value; `None` if the program has no such counter.
        value: Option<u32>,
    },
    /// The share of the run's time, in ten thousandths, in which a board's core was awake.
    Load {
        /// The board whose core it is.
        board: Board,
        /// The share of the time in ten thousandths; 10 000 means that the core was always awake.
        per_10_000: u32,
    },
    /// The run is over.
    End,
}

/// Something that happened in a run, with its instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// The instant of the event, in virtual ns since the run began.
    pub at: u64,
    /// What happened.
    pub what: What,
}

impl What {
    /// Returns the number by which events of one instant are sorted.
    #[must_use]
    pub fn rank(&self) -> u8 {
        match self {
            Self::Power { .. } => 0,
            Self::Reset { .. } => 1,
            Self::Injected { .. } => 2,
            Self::Hung { .. } => 3,
            Self::Warned { .. } => 4,
            Self::Crystal { .. } => 5,
            Self::StateInput { .. } => 6,
            Self::Tick => 7,
            Self::Aircraft { .. } => 8,
            Self::Command => 9,
            Self::Field { .. } => 10,
            Self::Sent { .. } => 11,
            Self::FieldHeard { .. } => 12,
            Self::Heard { .. } => 13,
            Self::Answer => 14,
            Self::Offered { .. } => 15,
            Self::Fed { .. } => 16,
            Self::Settings { .. } => 17,
            Self::Fresh { .. } => 18,
            Self::Ssi(_) => 19,
            Self::Selected => 20,
            Self::Transaction { .. } => 21,
            Self::Decided { .. } => 22,
            Self::Forwarded { .. } => 23,
            Self::Arrived { .. } => 24,
            Self::Station { .. } => 25,
            Self::Finding { .. } => 26,
            Self::Misuse { .. } => 27,
            Self::Late { .. } => 28,
            Self::Hold(_) => 29,
            Self::Counter { .. } => 30,
            Self::Load { .. } => 31,
            Self::End => 32,
        }
    }
}
