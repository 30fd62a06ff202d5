//! One GNSS receiver: its bytes, and what they amount to
//!
//! # Design
//!
//! A receiver sends three UBX messages that matter here: NAV-PVT (position and fix), NAV-ATT (attitude)
//! and ESF-INS (accelerations). The [`ublox`] crate finds and checks them in the byte stream; NMEA
//! sentences, damaged messages and messages of other kinds on the same line are passed over and counted.
//! Answers to configuration messages are kept for [`crate::configuration`].
//! What is kept is the latest of each, converted once, on arrival, so that the 10 ms cycle only copies.
//!
//! **To the last bit.** A latitude is `raw / 1e7`, one division of two exactly represented numbers, so
//! it is the float64 nearest to what the receiver said. Multiplying by `1e-7`, itself rounded, is not.
//!
//! **Plausible.** A position is only valid with a stated accuracy that is good enough, and with values in range: what
//! the voter asks of a candidate ([`horus_voter::Stated::is_plausible`]).
//!
//! **Age.** A value is worth something only for a while. It is *valid* until it is older than one period of its message
//! and [`VALID_SLACK_MS`], and *stale* from one period and [`STALE_SLACK_MS`] on (docs/design.md#validity). The age
//! counts from the arrival of the message, that is from the moment at which its last byte was parsed. The epoch for
//! which it holds is some tens of milliseconds older, by what the receiver takes to compute and to send. A message that
//! repeats the time of week of the one before renews nothing: a receiver that has frozen ages like a silent one.
//!
//! **Period.** Each kind of message has its own period. It is learned from the steps of the receiver's time of week and
//! believed to be 20 ms to 1 s; a slower receiver counts as one of 1 s, so that no receiver, whatever it sends, keeps a
//! position valid for more than 1.15 s after its last message. A shorter step is believed at once, a longer one only
//! when [`LONGER_STEPS`] in a row were longer, and then the shortest of those: so messages that are lost now and then
//! do not lengthen the period, and one step that is too short by chance (as at a receiver's first fix) is forgotten.
//!
//! **Bounded work.** One call takes at most [`BYTES_PER_CALL`] bytes, and the parser looks at no more than
//! [`BUFFER`] bytes of an unfinished message beyond them.
//!
//! **A false start ends with the line's silence.** A damaged length makes the parser wait for bytes that never
//! come, with good messages among those it already has. After [`GAP_MS`] of silence it is given 0xFF until it
//! gives them up, so that they are found now and not with the next epoch. (Zeros would not do: after the two bytes of
//! sync, six of them are a whole message, with the right checksum. A length of 0xFF is longer than any message.)

use core::f64::consts::PI;

use horus_voter::{Fix, Stated, WEEK_MS};
use ublox::{proto27::PacketRef, proto27::Proto27, FixedBuffer, Parser, ParserError, UbxPacket};

use profile::{FixType, ABSENT_F32, ABSENT_F64};

use crate::configuration::{Answer, VALSET};

/// The longest UBX message that can be taken in, bytes. NAV-PVT has 100; satellite lists are longer
/// and not needed.
pub const BUFFER: usize = 256;
/// The most bytes one call of [`Receiver::receive`] takes.
pub const BYTES_PER_CALL: usize = 64;
/// A receiver counts as heard this long after an intact message, ms (docs/design.md#status-words, bit 7).
pub const HEARD_MS: u32 = 250;

/// The longest period that is believed, ms (docs/design.md#validity), and the one a message kind has before its second
/// message: u-blox' default rate.
pub const LONGEST_PERIOD_MS: u32 = 1_000;
/// The shortest period that is believed, ms: 50 Hz, twice what the fastest receivers do.
const SHORTEST_PERIOD_MS: u32 = 20;
/// So many steps of the time of week in a row have to be longer than the period before it becomes longer.
pub const LONGER_STEPS: u32 = 4;
/// A solution is valid until it is older than its period and this, ms (docs/design.md#validity).
pub const VALID_SLACK_MS: u32 = 150;
/// A solution is stale as soon as it is as old as its period and this, ms (docs/design.md#validity).
pub const STALE_SLACK_MS: u32 = 50;
/// Older than this, ms, a stamp is forgotten, long before the clock's wrap could make it look young.
const FORGOTTEN_MS: u32 = 60_000;

/// A line silent for this long, ms, has ended whatever message it had begun: a receiver sends a message in
/// one go, and a byte takes 22 µs.
pub const GAP_MS: u32 = 50;

/// Bytes of a UBX message around its payload: two sync, class, identifier, two length, two checksum.
const UBX_OVERHEAD: usize = 8;

/// When something last happened, on a millisecond clock that wraps. A tick asks this of every receiver and has to take
/// as long whether it ever happened or not, so there is an instant in any case, and nothing branches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    at: u32,
    happened: bool,
}

impl Stamp {
    /// Whether it happened at most `limit` ms (below 2^31) before `now`, or after it: a message may
    /// arrive between a tick and the moment its cycle looks.
    #[must_use]
    pub const fn within(self, now: u32, limit: u32) -> bool {
        self.happened & (now.wrapping_sub(self.at) as i32 <= limit as i32)
    }

    fn set(&mut self, now: u32) {
        *self = Self { at: now, happened: true };
    }

    fn expire(&mut self, now: u32) {
        if !self.within(now, FORGOTTEN_MS) {
            *self = Self::default();
        }
    }
}

/// When a kind of message last brought something new, and how often it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    arrived: Stamp,
    time_of_week_ms: Option<u32>,
    /// From the last message's time of week to its arrival, ms, modulo a week.
    lag_ms: u32,
    period_ms: u32,
    /// How many steps in a row were longer than the period, and the shortest of them.
    longer_steps: u32,
    shortest_longer_ms: u32,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            arrived: Stamp::default(),
            time_of_week_ms: None,
            lag_ms: 0,
            period_ms: LONGEST_PERIOD_MS,
            longer_steps: 0,
            shortest_longer_ms: LONGEST_PERIOD_MS,
        }
    }
}

impl Pace {
    /// The message's period as it was learned, ms, at most [`LONGEST_PERIOD_MS`].
    #[must_use]
    pub const fn period_ms(&self) -> u32 {
        self.period_ms
    }

    /// Whether the last message is as young as its period allows: not yet stale at `now`, ms.
    #[must_use]
    pub fn is_fresh(&self, now: u32) -> bool {
        self.arrived.within(now, self.period_ms + STALE_SLACK_MS - 1)
    }

    /// Whether the last message is young enough to be valid at `now`, ms.
    #[must_use]
    pub fn is_current(&self, now: u32) -> bool {
        self.arrived.within(now, self.period_ms + VALID_SLACK_MS)
    }

    /// From the arrival of the last message to `now`, ms: below 0 for one that came since, and the longest there is
    /// without any.
    #[must_use]
    pub fn since_arrival_ms(&self, now: u32) -> i32 {
        if self.arrived.happened {
            now.wrapping_sub(self.arrived.at) as i32
        } else {
            i32::MAX
        }
    }

    /// Whether this kind of message has ever said anything.
    #[must_use]
    pub const fn has_arrived(&self) -> bool {
        self.time_of_week_ms.is_some()
    }

    /// The age at `now` (ms) of what this kind of message has said last, ms, as
    /// [`GpsStatus::solution_age_ms`](profile::GpsStatus::solution_age_ms) tells it: 0 if it came since, and the
    /// longest there is after more than `FORGOTTEN_MS`, or if it has never said anything.
    #[must_use]
    pub fn age_ms(&self, now: u32) -> u32 {
        self.since_arrival_ms(now).max(0) as u32
    }

    /// From the last message's time of week to its arrival, by the clock that began with HORUS, ms, modulo a week.
    /// Where that clock wraps, after 49 days, this steps once.
    #[must_use]
    pub const fn lag_ms(&self) -> u32 {
        self.lag_ms
    }

    /// Notes a message of `time_of_week_ms` that arrived at `now`, ms.
    fn arrive(&mut self, time_of_week_ms: u32, now: u32) {
        if self.time_of_week_ms == Some(time_of_week_ms) {
            return;
        }
        if let Some(previous) = self.time_of_week_ms {
            let step_ms = (time_of_week_ms % WEEK_MS + WEEK_MS - previous % WEEK_MS) % WEEK_MS;
            // A step back, after the receiver was restarted, tells nothing of its period.
            if (SHORTEST_PERIOD_MS..WEEK_MS / 2).contains(&step_ms) {
                self.learn(step_ms.min(LONGEST_PERIOD_MS));
            }
        }
        self.time_of_week_ms = Some(time_of_week_ms);
        self.lag_ms = (now % WEEK_MS + WEEK_MS - time_of_week_ms % WEEK_MS) % WEEK_MS;
        self.arrived.set(now);
    }

    fn learn(&mut self, step_ms: u32) {
        if step_ms <= self.period_ms {
            self.period_ms = step_ms;
        } else {
            self.longer_steps += 1;
            self.shortest_longer_ms = self.shortest_longer_ms.min(step_ms);
            if self.longer_steps < LONGER_STEPS {
                return;
            }
            self.period_ms = self.shortest_longer_ms;
        }
        self.longer_steps = 0;
        self.shortest_longer_ms = LONGEST_PERIOD_MS;
    }
}

/// Position, from NAV-PVT.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// When it arrived, and how often it does.
    pub pace: Pace,
    /// What kind of fix; `None` for a code that UBX reserves, or before the first message.
    pub fix: Option<FixType>,
    /// Whether the receiver vouches for latitude and longitude: `gnssFixOK`, not `invalidLlh`, and a 2D, 3D or combined
    /// fix. Dead reckoning without satellites is none: its error grows without a bound that the receiver would state.
    /// And whether what it states is plausible.
    pub valid: bool,
    /// Degrees, WGS-84.
    pub latitude: f64,
    /// Degrees, WGS-84.
    pub longitude: f64,
    /// m above the WGS-84 ellipsoid; NaN for a 2D fix, which rests on an assumed altitude.
    pub altitude: f64,
    /// m/s north, east, down.
    pub velocity: [f64; 3],
    /// Standard deviation of the horizontal position, m.
    pub horizontal_accuracy: f64,
    /// Standard deviation of the altitude, m.
    pub vertical_accuracy: f64,
    /// What the voter makes of all that.
    pub voted: Fix,
}

/// Attitude, from NAV-ATT. An angle that the receiver does not give is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// When it arrived, and how often it does.
    pub pace: Pace,
    /// Whether all three angles are given.
    pub valid: bool,
    /// rad, nose up positive.
    pub pitch: f32,
    /// rad from true north, clockwise.
    pub yaw: f32,
    /// rad, right side down positive.
    pub roll: f32,
}

/// Accelerations, from ESF-INS. One that the receiver does not give is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Acceleration {
    /// When it arrived, and how often it does.
    pub pace: Pace,
    /// Whether all three axes are given.
    pub valid: bool,
    /// m/s², vehicle frame front-right-down, gravity removed ("compensated").
    pub axes: [f32; 3],
}

/// The latest that one receiver has said.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solution {
    /// When it last said anything intact.
    pub last_heard: Stamp,
    /// From NAV-PVT.
    pub position: Position,
    /// From NAV-ATT.
    pub attitude: Attitude,
    /// From ESF-INS.
    pub acceleration: Acceleration,
}

/// What a line has carried so far. All counts wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes taken in.
    pub bytes: u32,
    /// Intact UBX messages of any kind.
    pub messages: u32,
    /// UBX messages with a wrong checksum.
    pub damaged: u32,
    /// UBX messages too long for the buffer, or with a field that their kind does not have.
    pub unusable: u32,
    useful: u32,
}

impl Counts {
    /// Bytes that belonged to no message of use: NMEA, UBX of other kinds, noise, damage. An unfinished
    /// message counts here until it is complete.
    #[must_use]
    pub const fn skipped(&self) -> u32 {
        self.bytes.wrapping_sub(self.useful)
    }
}

/// One receiver's line.
pub struct Receiver {
    parser: Parser<FixedBuffer<BUFFER>, Proto27>,
    solution: Solution,
    counts: Counts,
    /// When the last bytes came.
    spoke: Stamp,
    answer: Option<Answer>,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// A receiver that has not been heard.
    #[must_use]
    pub fn new() -> Self {
        Self {
            parser: Parser::with_fixed_buffer(),
            solution: Solution::default(),
            counts: Counts::default(),
            spoke: Stamp::default(),
            answer: None,
        }
    }

    /// Takes up to [`BYTES_PER_CALL`] of `bytes`, which arrived by `now` (ms, wraps), and gives how many.
    /// To be called every few milliseconds, with or without bytes: that is also when a silent line is
    /// noticed and old stamps are forgotten.
    pub fn receive(&mut self, bytes: &[u8], now: u32) -> usize {
        let (bytes, _) = bytes.split_at(bytes.len().min(BYTES_PER_CALL));
        self.solution.expire(now);
        if !bytes.is_empty() {
            self.spoke.set(now);
            self.counts.bytes = self.counts.bytes.wrapping_add(bytes.len() as u32);
            self.parse(bytes, now);
        } else if !self.parser.is_buffer_empty() && !self.spoke.within(now, GAP_MS) {
            let then = if self.spoke.happened { self.spoke.at } else { now };
            self.parse(&[0xFF; BYTES_PER_CALL], then);
        }
        bytes.len()
    }

    fn parse(&mut self, bytes: &[u8], arrived: u32) {
        let mut messages = self.parser.consume_ubx(bytes);
        while let Some(message) = messages.next() {
            match message {
                // Zeros behind a sync are a message of class 0 without a payload, whose checksum is zero: a line that
                // falls low there, or carries another rate, brings one. UBX has no class 0.
                Ok(UbxPacket::Proto27(PacketRef::Unknown(unknown))) if unknown.class == 0 => {
                    self.counts.damaged = self.counts.damaged.wrapping_add(1);
                }
                Ok(message) => {
                    self.counts.messages = self.counts.messages.wrapping_add(1);
                    self.solution.last_heard.set(arrived);
                    let answer = answer_of(&message);
                    let used = if answer.is_some() { ANSWER_LEN } else { self.solution.take(&message, arrived) };
                    self.answer = answer.or(self.answer);
                    self.counts.useful = self.counts.useful.wrapping_add(used as u32);
                }
                Err(ParserError::InvalidChecksum { .. }) => {
                    self.counts.damaged = self.counts.damaged.wrapping_add(1);
                }
                Err(_) => self.counts.unusable = self.counts.unusable.wrapping_add(1),
            }
        }
    }

    /// The latest that it has said.
    #[must_use]
    pub const fn solution(&self) -> &Solution {
        &self.solution
    }

    /// Its answer to a configuration message, if one has come since the last call.
    pub fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// What its line has carried.
    #[must_use]
    pub const fn counts(&self) -> &Counts {
        &self.counts
    }
}

impl Solution {
    fn expire(&mut self, now: u32) {
        self.last_heard.expire(now);
        self.position.pace.arrived.expire(now);
        self.attitude.pace.arrived.expire(now);
        self.acceleration.pace.arrived.expire(now);
    }

    /// Takes what is of use in a message, and gives the message's length if anything was, else 0.
    fn take(&mut self, message: &UbxPacket<'_>, now: u32) -> usize {
        // More protocol versions exist when another crate of the build asks the parser for them; this
        // one parses version 27 alone.
        #[allow(unreachable_patterns)]
        match message {
            UbxPacket::Proto27(PacketRef::NavPvt(pvt)) => {
                let position = &mut self.position;
                position.pace.arrive(pvt.itow(), now);
                position.fix = FixType::from_ubx(pvt.fix_type_raw());
                let stated = Stated {
                    latitude_e7: pvt.latitude_raw(),
                    longitude_e7: pvt.longitude_raw(),
                    altitude_mm: match position.fix {
                        Some(FixType::Fix2D) => None,
                        _ => Some(pvt.height_above_ellipsoid_raw()),
                    },
                    velocity_mm_s: [pvt.vel_north_raw(), pvt.vel_east_raw(), pvt.vel_down_raw()],
                    horizontal_accuracy_mm: pvt.horizontal_accuracy_raw(),
                    vertical_accuracy_mm: pvt.vertical_accuracy_raw(),
                };
                position.voted = Fix::new(&stated);
                position.valid = pvt.flags_raw() & GNSS_FIX_OK != 0
                    && pvt.flags3_raw() & INVALID_LLH == 0
                    && matches!(position.fix, Some(FixType::Fix2D | FixType::Fix3D | FixType::GnssDeadReckoning))
                    && position.voted.is_plausible();
                position.latitude = f64::from(stated.latitude_e7) / 1e7;
                position.longitude = f64::from(stated.longitude_e7) / 1e7;
                position.altitude = stated.altitude_mm.map_or(ABSENT_F64, |mm| f64::from(mm) / 1e3);
                position.velocity = stated.velocity_mm_s.map(|mm_s| f64::from(mm_s) / 1e3);
                position.horizontal_accuracy = f64::from(stated.horizontal_accuracy_mm) / 1e3;
                position.vertical_accuracy = f64::from(stated.vertical_accuracy_mm) / 1e3;
                pvt.payload_len() + UBX_OVERHEAD
            }
            UbxPacket::Proto27(PacketRef::NavAtt(att)) => {
                let attitude = &mut self.attitude;
                attitude.pace.arrive(att.itow(), now);
                attitude.roll = angle(att.vehicle_roll_raw(), att.vehicle_roll_accuracy_raw());
                attitude.pitch = angle(att.vehicle_pitch_raw(), att.vehicle_pitch_accuracy_raw());
                attitude.yaw = angle(att.vehicle_heading_raw(), att.vehicle_heading_accuracy_raw());
                attitude.valid = !(attitude.roll.is_nan() | attitude.pitch.is_nan() | attitude.yaw.is_nan());
                att.payload_len() + UBX_OVERHEAD
            }
            UbxPacket::Proto27(PacketRef::EsfIns(ins)) => {
                let acceleration = &mut self.acceleration;
                acceleration.pace.arrive(ins.itow(), now);
                let given = ins.bitfield_raw();
                acceleration.axes = [
                    axis(ins.x_acceleration_raw(), given & X_ACCEL_VALID),
                    axis(ins.y_acceleration_raw(), given & Y_ACCEL_VALID),
                    axis(ins.z_acceleration_raw(), given & Z_ACCEL_VALID),
                ];
                acceleration.valid = !acceleration.axes.iter().any(|axis| axis.is_nan());
                ins.payload_len() + UBX_OVERHEAD
            }
            _ => 0,
        }
    }
}

/// UBX-ACK-ACK and -NAK: class and identifier of what is answered.
const ANSWER_LEN: usize = 2 + UBX_OVERHEAD;

/// The answer to a configuration message, if this is one.
fn answer_of(message: &UbxPacket<'_>) -> Option<Answer> {
    #[allow(unreachable_patterns)]
    match message {
        UbxPacket::Proto27(PacketRef::AckAck(ack)) if (ack.class(), ack.msg_id()) == VALSET => Some(Answer::Taken),
        UbxPacket::Proto27(PacketRef::AckNak(nak)) if (nak.class(), nak.msg_id()) == VALSET => Some(Answer::Refused),
        _ => None,
    }
}

/// NAV-PVT `flags` bit 0: within the receiver's accuracy masks.
const GNSS_FIX_OK: u8 = 0x01;
/// NAV-PVT `flags3` bit 0: longitude, latitude and height are invalid.
const INVALID_LLH: u8 = 0x01;
/// ESF-INS `bitfield0` bits 11 to 13.
const X_ACCEL_VALID: u32 = 1 << 11;
const Y_ACCEL_VALID: u32 = 1 << 12;
const Z_ACCEL_VALID: u32 = 1 << 13;

/// An angle of NAV-ATT in rad; NaN if its accuracy is null, which says that it is not available.
fn angle(e5_degrees: i32, accuracy: u32) -> f32 {
    if accuracy == 0 {
        ABSENT_F32
    } else {
        (f64::from(e5_degrees) * (PI / 180.0 / 1e5)) as f32
    }
}

/// An acceleration of ESF-INS (1e-2 m/s²) in m/s²; NaN if it is not flagged valid.
fn axis(centimetres: i32, valid: u32) -> f32 {
    if valid == 0 {
        ABSENT_F32
    } else {
        (f64::from(centimetres) / 1e2) as f32
    }
}
