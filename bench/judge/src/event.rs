//! What a log holds.

use serde::{Deserialize, Serialize};

use crate::Disturbance;

/// What a run is known by before anything happens.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Of this format: [`Header::VERSION`].
    pub version: u32,
    /// Receivers in the profile: 1, 2, 3 or 5.
    pub gps: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// What the cores' time costs: `fast`, `optimistic` or `pessimistic`.
    pub clock: String,
}

impl Header {
    /// The format that this crate writes and reads.
    pub const VERSION: u32 = 3;

    /// Whether the cores' time is the longest that silicon may take.
    #[must_use]
    pub fn worst_case(&self) -> bool {
        self.clock == "pessimistic"
    }
}

/// One of the two boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Board {
    /// The sending side.
    Horus,
    /// The receiving side.
    Dpr,
}

/// What restarts a board's microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The supply came on.
    PowerOn,
    /// The supply fell below the part's threshold for a moment.
    BrownOut,
    /// The reset pin.
    Pin,
    /// A watchdog.
    Watchdog,
    /// The core locked up.
    Lockup,
    /// The firmware.
    Software,
    /// The part woke from a sleep that ends so.
    Wakeup,
}

/// Bytes; in a stored log two hexadecimal digits each.
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

/// What the DPR's SPI peripheral shows of its buffers, which decide what a transaction meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SsiEvent {
    /// The processor has taken the buffers: a transaction that begins now reads 0xFF throughout.
    Held,
    /// The processor has given the buffers back.
    Released,
    /// A transaction that begins now is served.
    Ready,
    /// A transaction has begun that is not served.
    Busy,
}

/// Something that happened. Of several at one instant, the order here is the order in the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A board's supply goes on or off.
    Power {
        /// Which.
        board: Board,
        /// On.
        on: bool,
    },
    /// A board's microcontroller restarts.
    Reset {
        /// Which.
        board: Board,
        /// Why.
        cause: Cause,
        /// The bench did it on purpose: the pin, the supply.
        asked: bool,
    },
    /// The bench does something wrong on purpose; what it does to a board's supply or reset pin is told beside it.
    Injected {
        /// The kind of fault in words, as the faults' list calls it: for whoever reads or counts it. No rule does.
        kind: String,
        /// What it disturbs.
        disturbs: Disturbance,
        /// When its cause goes away, ns; the event's instant for what has no duration.
        until: u64,
    },
    /// A board hangs, because the bench has its core execute nothing more and take no interrupt from now on, or because
    /// its part has warned it of a supply that falls, after which its firmware has to do nothing more either. What ends
    /// it is the board's next start, or its supply going off.
    Hung {
        /// Which.
        board: Board,
    },
    /// A board's part has warned its running firmware of a falling supply: the board has to enter its safe state.
    Warned {
        /// Which.
        board: Board,
    },
    /// A board's external oscillator fails, or works again. It works before the first of these.
    Crystal {
        /// Whose.
        board: Board,
        /// It works.
        works: bool,
    },
    /// The levels of a pair of pins that tells HORUS's state are others; before the first of these no input is active.
    StateInput {
        /// 0 the relay, 1 the motor cut, 2 the emergency measure.
        input: usize,
        /// The pin that is high while the input is active.
        active: bool,
        /// The pin that is high while it is not.
        inactive: bool,
    },
    /// HORUS's TICK pin rose: its 10 ms timer began the next cycle.
    Tick,
    /// Where the simulated aircraft is at the tick of this instant. In a run that plays a recording nobody knows that.
    Aircraft {
        /// 1e-9 degrees north.
        latitude: i64,
        /// 1e-9 degrees east.
        longitude: i64,
        /// Above the ellipsoid, mm.
        height: i64,
    },
    /// Chip select of HORUS's front end rose after the byte of a transmit command.
    Command,
    /// HORUS's front end switched its carrier.
    Field {
        /// On.
        on: bool,
    },
    /// A frame of HORUS's front end has ended on the air; the instant is the end of its last bit.
    Sent {
        /// Its first preamble bit, ns.
        started: u64,
        /// Nominal bit rate, bit/s.
        bit_rate: u32,
        /// LEN, payload, CRC-16.
        bytes: Bytes,
        /// All bytes that were announced were sent.
        whole: bool,
    },
    /// The DPR's antenna sees a carrier, or none any more.
    FieldHeard {
        /// It sees one.
        on: bool,
    },
    /// A frame has ended at the DPR's antenna; the instant is the end of its last bit. A frame that was lost on the air
    /// is not heard.
    Heard {
        /// Its first preamble bit, ns.
        started: u64,
        /// LEN, payload, CRC-16 as they arrived.
        bytes: Bytes,
        /// All bytes that were announced arrived.
        whole: bool,
    },
    /// The DPR's front end began to send: an answer.
    Answer,
    /// A receiver on a bus has something to say: it waits there until HORUS reads it.
    Offered {
        /// Which, from 0.
        receiver: usize,
        /// The bytes.
        bytes: Bytes,
    },
    /// A receiver began to put bytes on its line, without a gap between them.
    Fed {
        /// Which, from 0.
        receiver: usize,
        /// What one byte takes, ns: the n-th byte has crossed the line n + 1 times this after the event's instant.
        byte_ns: u64,
        /// The bytes.
        bytes: Bytes,
        /// The line carried them so that a UART reads every one of them as it is: no noise, break, or other rate; on a
        /// bus, as the receiver said them, in a transaction that was ended as it should be.
        clean: bool,
        /// On a bus, since when they had waited in the receiver, ns; nothing on a UART, where nothing waits.
        #[serde(default)]
        since: Option<u64>,
    },
    /// A simulated receiver is set so from now on; before the first of these of a receiver nothing is known of that.
    Settings {
        /// Which, from 0.
        receiver: usize,
        /// By which dynamic model it navigates, as u-blox' CFG-NAVSPG-DYNMODEL counts them.
        model: u8,
        /// It puts out the message that HORUS takes positions from, NAV-PVT.
        position: bool,
    },
    /// The DPR's FRESH pin rose or fell.
    Fresh {
        /// It rose.
        high: bool,
        /// Where it rose: what a transaction would have read that began when the DPR's SPI peripheral was first ready
        /// for one; nothing if one was under way, or began before that.
        offered: Option<Bytes>,
    },
    /// The DPR's SPI peripheral took or gave its buffers.
    Ssi(SsiEvent),
    /// The flight controller's chip select fell.
    Selected,
    /// The flight controller's chip select rose: a transaction is over.
    Transaction {
        /// When chip select fell, ns, by the instant at which the DPR's pin saw it.
        selected: u64,
        /// What the flight controller sent.
        mosi: Bytes,
        /// What it read.
        miso: Bytes,
    },
    /// What the flight controller's client says after the transaction that ended at this instant.
    Decided {
        /// The timestamp of the position to fly by, ms; nothing if there is none.
        position: Option<u32>,
        /// How old the sample is that was read last, when the transaction began, µs; nothing if that is not known.
        age_us: Option<u32>,
    },
    /// The flight controller forwarded a profile to the base station, untouched.
    Forwarded {
        /// The profile: the objects of the image, without Link-Status.
        profile: Bytes,
    },
    /// The base station took a profile.
    Arrived {
        /// The profile as it arrived.
        profile: Bytes,
        /// Which of its objects the base station shows as valid: bit 0 Reported-Position, bit n GPSn.
        shown: u8,
    },
    /// What the base station says of the drone at this instant: from time to time, and whenever its alarms change.
    Station {
        /// How old the Reported-Position is that it shows, µs; nothing if it shows none.
        age_us: Option<u64>,
        /// The alarms that hold, by the names that programs know them by.
        alarms: Vec<String>,
    },
    /// A part found an access that silicon does not answer, or a state that its manual forbids.
    Finding {
        /// On which board.
        board: Board,
        /// Its core has met a fault or locked up: the board does nothing but restart from now on.
        fault: bool,
        /// In words.
        text: String,
    },
    /// A front end was used against its data sheet.
    Misuse {
        /// On which board.
        board: Board,
        /// In words.
        text: String,
    },
    /// The bench acted on a board later than it was due, so the run is not exact.
    Late {
        /// On which board.
        board: Board,
        /// In words.
        text: String,
    },
    /// At the end of the run: a counter that the firmware keeps, read from RAM as a debug probe reads it.
    Counter {
        /// Whose.
        board: Board,
        /// Its name.
        name: String,
        /// Its value; nothing if the image has no such counter.
        value: Option<u32>,
    },
    /// At the end of the run: in which part of the time the core was awake, in ten thousandths.
    Load {
        /// Whose.
        board: Board,
        /// 10 000 is always.
        per_10_000: u32,
    },
    /// The run is over.
    End,
}

/// Something that happened, and when.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Virtual ns since the run began.
    pub at: u64,
    /// What.
    pub what: What,
}

impl What {
    /// Where it stands among events of one instant.
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
            Self::Counter { .. } => 29,
            Self::Load { .. } => 30,
            Self::End => 31,
        }
    }
}
