//! Faults of a GNSS receiver or its line.
//!
//! [`LineFaults`] lies between a receiver and HORUS's UART pin: it takes the receiver's bursts of messages and returns
//! what appears on the line instead.
//!
//! | fault | what is on the line |
//! |---|---|
//! | `Silent` | nothing |
//! | `Babbles`, `Beginnings`, `Unasked` | bytes without a pause, without the receiver's own messages |
//! | `Frozen`, `Jumps`, `NoFix`, `BadChecksums` | the receiver's messages, with other contents |
//! | `Offset`, `Drifts`, `FrozenPosition`, `Understates`, `Absurd` | NAV-PVT with another position or accuracy |
//! | `Flat`, `Turned`, `Pushed` | a 2D fix in NAV-PVT, another heading in NAV-ATT, another acceleration in ESF-INS |
//! | `TimeJumps`, `OtherLength` | the receiver's messages with another time or another length |
//! | `Restarts` | nothing, then messages of a receiver with neither time nor position |
//! | `LosesSettings` | the messages of the factory settings, until HORUS configures the receiver: `gnss_sim` |
//! | `ForgetsModel` | the receiver's messages, with another dynamic model than the airborne one |
//! | `LateBursts` | the receiver's messages, later |
//! | `WrongBaud`, `Noise`, `FramingErrors` | the receiver's messages, damaged frame by frame |
//! | `Break` | a low level |
//! | `Bus` | see [`bus`]: the board applies it |
//!
//! The bytes of a receiver on I2C or SPI wait in the receiver until HORUS reads them. A UART's fault applies only to
//! receivers on a UART, and a bus's fault only to receivers on that bus ([`ReceiverFault::fits`]).

pub mod bus;
mod messages;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use emulator_part::UartFrame;
use gnss_sim::ubx;
use horus_tx_fw::timing::GNSS_BAUD;

use super::Rng;
pub use bus::BusFault;
use gnss_sim::Port;
use messages::{
    each_message, flattened, last_itow, last_position, move_by, pushed, set_fields, set_itow, turned,
    with_bad_checksums, without_fix,
};

/// A fault of one receiver, or of its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiverFault {
    /// The receiver sends nothing.
    Silent,
    /// The receiver sends random bytes without a pause.
    Babbles,
    /// The receiver sends only beginnings of UBX messages of the greatest length, without a pause.
    Beginnings,
    /// The receiver sends whole UBX messages that HORUS has not requested, without a pause.
    Unasked,
    /// The receiver sends new data, but the time of week stays that of its last message before the fault.
    Frozen,
    /// The receiver sends at this bit rate, bit/s.
    WrongBaud(u32),
    /// The receiver's line is held low.
    Break,
    /// Bits on the receiver's line are inverted: one in [`NOISE_ONE_IN`] of the data and stop bits.
    Noise,
    /// Stop bits on the receiver's line are low: one in [`FRAMING_ONE_IN`].
    FramingErrors,
    /// The receiver is silent in the first half of the episode. In the second half it has no fix, and its time of week
    /// begins at 0.
    Restarts,
    /// The receiver's position is wrong: it lies farther north by a distance.
    Jumps {
        /// The distance, m.
        metres: u32,
    },
    /// The receiver's position has a constant error.
    Offset {
        /// The error to the north, m.
        north: i32,
        /// The error to the east, m.
        east: i32,
        /// The error upwards, m.
        up: i32,
    },
    /// The receiver's position moves north at this speed, but its stated velocity does not, as with slow spoofing.
    Drifts {
        /// The speed, mm/s.
        mm_s: u32,
    },
    /// The receiver's position stays the same, while its time and its velocity continue.
    FrozenPosition,
    /// The receiver's fix is a 2D fix.
    Flat,
    /// The receiver's heading is turned by an angle.
    Turned {
        /// The angle clockwise, degrees.
        degrees: u16,
    },
    /// The receiver's acceleration has a constant error.
    Pushed {
        /// The error of the forward acceleration, cm/s².
        cm_s2: i32,
    },
    /// The receiver states the accuracy [`UNDERSTATED_MM`], although the error of its position is larger.
    Understates,
    /// A field of the receiver's NAV-PVT messages has an impossible value.
    Absurd(Absurd),
    /// The receiver's time of week is ahead by this much, ms; negative values are behind.
    TimeJumps(i32),
    /// The payloads of the receiver's messages are longer by this many bytes; a negative number makes them shorter.
    OtherLength(i8),
    /// The receiver has no fix: its messages mark its position as invalid.
    NoFix,
    /// Every burst of the receiver's messages comes later by this much, ns.
    LateBursts(u64),
    /// The checksum of every message of the receiver is wrong.
    BadChecksums,
    /// The receiver has its factory settings (NMEA, 1 Hz, 38 400 bit/s) until HORUS configures it.
    LosesSettings,
    /// The receiver loses its configured dynamic model. HORUS cannot detect this.
    ForgetsModel,
    /// The receiver's bus has a fault.
    Bus(BusFault),
}

/// A field of NAV-PVT with an impossible value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Absurd {
    /// The latitude is 91 degrees north.
    Latitude,
    /// The longitude is 181 degrees east.
    Longitude,
    /// The height is 2147 km above the ellipsoid.
    Height,
    /// The speed is 2147 km/s to the south.
    Speed,
    /// The accuracy is 0, which no receiver has.
    NoAccuracy,
    /// The accuracy is 4295 km, the greatest value that the field can hold. It makes the position useless.
    HugeAccuracy,
}

impl Absurd {
    /// All fields with impossible values.
    pub const ALL: [Self; 6] =
        [Self::Latitude, Self::Longitude, Self::Height, Self::Speed, Self::NoAccuracy, Self::HugeAccuracy];

    const fn name(self) -> &'static str {
        match self {
            Self::Latitude => "latitude beyond the pole",
            Self::Longitude => "longitude beyond 180 degrees",
            Self::Height => "height beyond the atmosphere",
            Self::Speed => "speed beyond any",
            Self::NoAccuracy => "accuracy of 0",
            Self::HugeAccuracy => "accuracy beyond any",
        }
    }

    fn fields(self) -> Vec<(usize, u32)> {
        match self {
            Self::Latitude => vec![(messages::LATITUDE, 910_000_000)],
            Self::Longitude => vec![(messages::LONGITUDE, 1_810_000_000)],
            Self::Height => vec![(messages::HEIGHT, i32::MAX.cast_unsigned())],
            Self::Speed => vec![(messages::VELOCITY_NORTH, i32::MIN.cast_unsigned())],
            Self::NoAccuracy => messages::ACCURACIES.map(|at| (at, 0)).into(),
            Self::HugeAccuracy => messages::ACCURACIES.map(|at| (at, u32::MAX)).into(),
        }
    }
}

/// The accuracy that [`ReceiverFault::Understates`] reports, mm.
pub const UNDERSTATED_MM: u32 = 10;

/// [`ReceiverFault::Noise`] inverts one bit in this many. About one NAV-PVT message in six arrives undamaged.
pub const NOISE_ONE_IN: u64 = 500;

/// [`ReceiverFault::FramingErrors`] makes one stop bit in this many low.
pub const FRAMING_ONE_IN: u64 = 16;

/// The longest silence in the first half of [`ReceiverFault::Restarts`], ns.
pub const LONGEST_SILENCE: u64 = 1_000_000_000;

/// The longest time for which a line is held low by one frame, ns.
const LONGEST_BREAK: u64 = 3_600_000_000_000;

/// The number of UART frames that are generated together: those of a millisecond, and a multiple of the length of
/// [`BEGINNING`].
const CHUNK: usize = 48;

/// The beginning of a NAV-PVT message with the greatest length in its length field.
const BEGINNING: [u8; 6] = [0xB5, 0x62, 0x01, 0x07, 0xFF, 0xFF];

impl ReceiverFault {
    /// Returns the fault's name in the event log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::Babbles => "babbles",
            Self::Beginnings => "sends beginnings of messages",
            Self::Unasked => "sends messages nobody asked for",
            Self::Frozen => "repeats a time of week",
            Self::WrongBaud(_) => "sends at another bit rate",
            Self::Break => "line held low",
            Self::Noise => "line with bit errors",
            Self::FramingErrors => "line with framing errors",
            Self::Restarts => "restarts",
            Self::Jumps { .. } => "jumps",
            Self::Offset { north: 0, east: 0, .. } => "is off in height",
            Self::Offset { .. } => "is off",
            Self::Drifts { .. } => "drifts away",
            Self::FrozenPosition => "repeats a position",
            Self::Flat => "has a 2D fix",
            Self::Turned { .. } => "is off in heading",
            Self::Pushed { .. } => "is off in acceleration",
            Self::Understates => "understates its accuracy",
            Self::Absurd(field) => field.name(),
            Self::TimeJumps(0..) => "is ahead of its time of week",
            Self::TimeJumps(_) => "is behind its time of week",
            Self::OtherLength(0..) => "sends messages that are too long",
            Self::OtherLength(_) => "sends messages that are too short",
            Self::NoFix => "without a fix",
            Self::LateBursts(_) => "sends late",
            Self::BadChecksums => "sends wrong checksums",
            Self::LosesSettings => "loses its settings",
            Self::ForgetsModel => "forgets its dynamic model",
            Self::Bus(fault) => fault.name(),
        }
    }

    /// Whether a receiver with this interface can have the fault.
    #[must_use]
    pub fn fits(self, interface: Port) -> bool {
        match self {
            Self::WrongBaud(_) | Self::Break | Self::Noise | Self::FramingErrors => interface == Port::Uart1,
            Self::Bus(fault) => interface == fault.interface(),
            _ => true,
        }
    }

    /// Whether the fault keeps the line busy without a pause while it lasts.
    #[must_use]
    pub const fn is_endless(self) -> bool {
        matches!(self, Self::Babbles | Self::Beginnings | Self::Unasked)
    }
}

/// UART frames that follow one another on a receiver's line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OnLine {
    /// The instant, ns, at which the first frame's start bit begins if the line is free. On a busy line the frames
    /// begin later.
    pub at_ns: u64,
    /// The receiver's index, from 0.
    pub receiver: usize,
    /// The UART frames, which follow one another without a gap.
    pub frames: Vec<UartFrame>,
    /// Whether every frame is well-formed at the receiver's bit rate, so that HORUS reads [`OnLine::bytes`].
    pub clean: bool,
}

impl OnLine {
    fn clean(at_ns: u64, receiver: usize, bytes: &[u8]) -> Self {
        let frames = bytes.iter().map(|&byte| UartFrame::eight_n_one(byte, GNSS_BAUD)).collect();
        Self { at_ns, receiver, frames, clean: true }
    }

    /// The byte of each well-formed frame at the receiver's bit rate; `None` for every other frame.
    pub fn bytes(&self) -> impl Iterator<Item = Option<u8>> + '_ {
        self.frames.iter().map(|frame| {
            let byte = frame.data as u8;
            (*frame == UartFrame::eight_n_one(byte, GNSS_BAUD)).then_some(byte)
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Active {
    fault: ReceiverFault,
    at: u64,
    until: u64,
    /// The instant, ns, of the next bytes that the faulty receiver sends outside its bursts.
    next: u64,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Line {
    /// The present faults. Only the last of them has an effect.
    faults: Vec<Active>,
    last_itow: Option<u32>,
    /// The position in the receiver's last burst without a fault: longitude, latitude and height, in the units of
    /// NAV-PVT.
    last_position: Option<[i32; 3]>,
    /// Delayed bursts, in order of time.
    waiting: VecDeque<OnLine>,
}

impl Line {
    fn next_at(&self) -> u64 {
        let waiting = self.waiting.front().map_or(u64::MAX, |on_line| on_line.at_ns);
        self.faults.last().map_or(u64::MAX, |active| active.next).min(waiting)
    }
}

/// The faults of all receivers and their lines.
#[derive(Clone, Debug)]
pub struct LineFaults {
    rng: Rng,
    lines: Vec<Line>,
}

impl LineFaults {
    /// Returns the lines without faults. `seed` determines all random values.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self { rng: Rng::new(seed), lines: vec![] }
    }

    fn line(&mut self, receiver: usize) -> &mut Line {
        if self.lines.len() <= receiver {
            self.lines.resize_with(receiver + 1, Line::default);
        }
        &mut self.lines[receiver]
    }

    /// Begins `fault` at `at`, until `until` (ns; `u64::MAX` for never). It replaces the effect of the receiver's
    /// earlier faults.
    pub fn begin(&mut self, at: u64, until: u64, receiver: usize, fault: ReceiverFault) {
        let line = self.line(receiver);
        if fault == ReceiverFault::Break {
            let frames = vec![low_for(until.saturating_sub(at))];
            line.waiting.push_back(OnLine { at_ns: at, receiver, frames, clean: false });
        }
        let next = if fault.is_endless() { at } else { u64::MAX };
        line.faults.push(Active { fault, at, until, next });
    }

    /// Ends `fault`. Bursts that the fault has delayed are still sent.
    pub fn end(&mut self, receiver: usize, fault: ReceiverFault) {
        let faults = &mut self.line(receiver).faults;
        if let Some(index) = faults.iter().position(|active| active.fault == fault) {
            faults.remove(index);
        }
    }

    /// Returns what is on the line when the receiver begins to send `bytes` at `at` (ns). [`LineFaults::take`] returns
    /// a delayed burst later.
    pub fn burst(&mut self, at: u64, receiver: usize, bytes: &[u8]) -> Vec<OnLine> {
        let line = self.line(receiver);
        let Some(active) = line.faults.last().copied() else {
            line.last_itow = last_itow(bytes).or(line.last_itow);
            line.last_position = last_position(bytes).or(line.last_position);
            let on_line = OnLine::clean(at, receiver, bytes);
            return self.in_order(on_line);
        };
        let clean = match active.fault {
            ReceiverFault::Silent
            | ReceiverFault::Babbles
            | ReceiverFault::Beginnings
            | ReceiverFault::Unasked
            | ReceiverFault::Break => return vec![],
            ReceiverFault::Frozen => {
                let frozen = *line.last_itow.get_or_insert(last_itow(bytes).unwrap_or(0));
                each_message(bytes, |class, id, payload| set_itow(class, id, payload, frozen))
            }
            ReceiverFault::Restarts => {
                let searches = active.at + ((active.until - active.at) / 2).min(LONGEST_SILENCE);
                if at < searches {
                    return vec![];
                }
                let itow = u32::try_from((at - searches) / 1_000_000).unwrap_or(u32::MAX) % ubx::WEEK_MS;
                each_message(bytes, |class, id, payload| {
                    set_itow(class, id, payload, itow);
                    without_fix(class, id, payload, true);
                })
            }
            ReceiverFault::Jumps { metres } => {
                each_message(bytes, |class, id, payload| move_by(class, id, payload, [i64::from(metres) * 1_000, 0, 0]))
            }
            ReceiverFault::Offset { north, east, up } => {
                let by = [north, east, up].map(|metres| i64::from(metres) * 1_000);
                each_message(bytes, |class, id, payload| move_by(class, id, payload, by))
            }
            ReceiverFault::Drifts { mm_s } => {
                let ms = i64::try_from(at.saturating_sub(active.at) / 1_000_000).unwrap_or(i64::MAX);
                let north = (ms / 10).saturating_mul(mm_s.into()) / 100;
                each_message(bytes, |class, id, payload| move_by(class, id, payload, [north, 0, 0]))
            }
            ReceiverFault::FrozenPosition => {
                let Some(frozen) = line.last_position.or(last_position(bytes)) else {
                    let on_line = OnLine::clean(at, receiver, bytes);
                    return self.in_order(on_line);
                };
                line.last_position = Some(frozen);
                let [longitude, latitude, height] = frozen.map(i32::cast_unsigned);
                let fields =
                    [(messages::LONGITUDE, longitude), (messages::LATITUDE, latitude), (messages::HEIGHT, height)];
                each_message(bytes, |class, id, payload| set_fields(class, id, payload, &fields))
            }
            ReceiverFault::Flat => each_message(bytes, |class, id, payload| flattened(class, id, payload)),
            ReceiverFault::Turned { degrees } => {
                each_message(bytes, |class, id, payload| turned(class, id, payload, degrees))
            }
            ReceiverFault::Pushed { cm_s2 } => {
                each_message(bytes, |class, id, payload| pushed(class, id, payload, cm_s2))
            }
            ReceiverFault::Understates => {
                let fields = messages::ACCURACIES.map(|at| (at, UNDERSTATED_MM));
                each_message(bytes, |class, id, payload| set_fields(class, id, payload, &fields))
            }
            ReceiverFault::Absurd(field) => {
                each_message(bytes, |class, id, payload| set_fields(class, id, payload, &field.fields()))
            }
            ReceiverFault::TimeJumps(ms) => {
                let itow = i64::from(last_itow(bytes).unwrap_or(0)) + i64::from(ms);
                let itow = u32::try_from(itow.rem_euclid(ubx::WEEK_MS.into())).unwrap_or(0);
                each_message(bytes, |class, id, payload| set_itow(class, id, payload, itow))
            }
            ReceiverFault::OtherLength(more) => each_message(bytes, |_, _, payload| {
                payload.resize(payload.len().saturating_add_signed(more.into()), 0);
            }),
            ReceiverFault::NoFix => each_message(bytes, |class, id, payload| without_fix(class, id, payload, false)),
            ReceiverFault::BadChecksums => with_bad_checksums(bytes),
            ReceiverFault::LosesSettings | ReceiverFault::ForgetsModel | ReceiverFault::Bus(_) => bytes.to_vec(),
            ReceiverFault::LateBursts(ns) => {
                let mut late = OnLine::clean(at.saturating_add(ns), receiver, bytes);
                late.at_ns = late.at_ns.max(line.waiting.back().map_or(0, |before| before.at_ns));
                line.waiting.push_back(late);
                return vec![];
            }
            ReceiverFault::WrongBaud(baud) => {
                let frames = bytes.iter().map(|&byte| UartFrame::eight_n_one(byte, baud.max(1))).collect();
                return self.in_order(OnLine { at_ns: at, receiver, frames, clean: baud == GNSS_BAUD });
            }
            ReceiverFault::Noise => {
                let frames = bytes.iter().map(|&byte| self.noisy(byte)).collect();
                return self.in_order(damaged(at, receiver, frames));
            }
            ReceiverFault::FramingErrors => {
                let mut frame = |&byte: &u8| with_stop(byte, !self.rng.one_in(FRAMING_ONE_IN));
                let frames = bytes.iter().map(&mut frame).collect();
                return self.in_order(damaged(at, receiver, frames));
            }
        };
        self.in_order(OnLine::clean(at, receiver, &clean))
    }

    fn in_order(&mut self, mut on_line: OnLine) -> Vec<OnLine> {
        let line = self.line(on_line.receiver);
        let Some(before) = line.waiting.back() else { return vec![on_line] };
        on_line.at_ns = on_line.at_ns.max(before.at_ns);
        line.waiting.push_back(on_line);
        vec![]
    }

    /// Returns the UART frame of `byte` after [`ReceiverFault::Noise`].
    fn noisy(&mut self, byte: u8) -> UartFrame {
        let flips = (0..9).fold(0_u16, |flips, bit| flips | u16::from(self.rng.one_in(NOISE_ONE_IN)) << bit);
        with_stop(byte ^ flips as u8, flips >> 8 == 0)
    }

    /// The instant at which the next delayed or unsolicited burst begins, ns; `u64::MAX` if there is none.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        self.lines.iter().map(Line::next_at).min().unwrap_or(u64::MAX)
    }

    /// Takes the delayed and unsolicited bursts that begin at `now` (ns) or earlier.
    pub fn take(&mut self, now: u64) -> Vec<OnLine> {
        let mut taken = vec![];
        for (receiver, line) in self.lines.iter_mut().enumerate() {
            while let Some(on_line) = line.waiting.pop_front_if(|on_line| on_line.at_ns <= now) {
                taken.push(on_line);
            }
            let Some(active) = line.faults.last_mut().filter(|active| active.next <= now) else { continue };
            let bytes: Vec<u8> = match active.fault {
                ReceiverFault::Babbles => (0..CHUNK).map(|_| self.rng.byte()).collect(),
                ReceiverFault::Beginnings => BEGINNING.into_iter().cycle().take(CHUNK).collect(),
                // The receiver sends MON-VER, the answer to a poll of its version, although nobody has polled it.
                _ => ubx::frame(0x0A, 0x04, &[self.rng.byte(); CHUNK - ubx::OVERHEAD]),
            };
            let on_line = OnLine::clean(now, receiver, &bytes);
            // The next group of frames begins at the end of this one, so that the line is always busy.
            active.next = now + on_line.frames.iter().map(UartFrame::ns).sum::<u64>();
            taken.push(on_line);
        }
        taken
    }
}

fn damaged(at_ns: u64, receiver: usize, frames: Vec<UartFrame>) -> OnLine {
    let mut on_line = OnLine { at_ns, receiver, frames, clean: false };
    let clean = on_line.bytes().all(|byte| byte.is_some());
    on_line.clean = clean;
    on_line
}

/// Returns the UART frame of `byte`. A low stop bit is sent as a ninth data bit.
const fn with_stop(byte: u8, high: bool) -> UartFrame {
    let frame = UartFrame::eight_n_one(byte, GNSS_BAUD);
    if high { frame } else { UartFrame { bits: 9, ..frame } }
}

/// Returns a frame that holds the line low for `ns`, or for one character if that is longer. The line is high in the
/// last twentieth of the time.
fn low_for(ns: u64) -> UartFrame {
    let character = UartFrame::eight_n_one(0, GNSS_BAUD);
    let ns = ns.clamp(character.ns(), LONGEST_BREAK);
    // The frame has ten low bits, and half a bit that is high.
    UartFrame { bits: 9, stop_halves: 1, bit_ps: ns * 2_000 / 21, ..character }
}
