//! One GNSS receiver: turns its bytes into its latest solution
//!
//! # Design
//!
//! HORUS uses three UBX messages of a receiver: NAV-PVT (position and fix), NAV-ATT (attitude) and ESF-INS
//! (accelerations). The [`ublox`] crate finds and checks them in the byte stream; all other bytes are skipped and
//! counted. Answers to configuration messages are kept for [`crate::configuration`]. The latest message of each kind is
//! converted once, on arrival, so that the 10 ms cycle only copies.
//!
//! **To the last bit.** A latitude is `raw / 1e7`, one division of two exactly represented numbers, so it is the
//! float64 nearest to the value that the receiver sent. A product with `1e-7`, which is itself rounded, would not be.
//!
//! **Plausible.** A position is valid only if its stated accuracy is good enough and its values are in range, as the
//! voter requires ([`horus_voter::Stated::is_plausible`]).
//!
//! **Age.** A value is *valid* until it is older than one period of its message and [`VALID_SLACK_MS`], and *stale*
//! from one period and [`STALE_SLACK_MS`] on (docs/design.md#validity). The age counts from the moment at which the
//! message's last byte was parsed, some tens of ms after the value's epoch. A message that repeats the time of week of
//! the previous one renews nothing: the values of a receiver that has frozen age like those of a silent one.
//!
//! **Period.** Each kind of message has its own period, learned from the steps of the receiver's time of week and
//! accepted from 20 ms to 1 s. A slower receiver counts as one of 1 s, so that no receiver keeps a position valid for
//! more than 1.15 s after its last message. A shorter step is accepted at once. A longer period is accepted only when
//! [`LONGER_STEPS`] steps in a row were longer, and then the shortest of these. So lost messages do not lengthen the
//! period, and a step that is too short by chance is corrected.
//!
//! **Bounded work.** One call takes at most [`BYTES_PER_CALL`] bytes and reads [`BUFFER`] bytes beyond these.
//!
//! **A damaged length** makes the parser wait for bytes that never come, although it may hold good messages already.
//! After [`GAP_MS`] of silence the parser is given 0xFF until it drops the damaged message. (Zeros would not do: six
//! zeros after two sync bytes are a whole message with the right checksum. A length of 0xFF bytes is longer than any.)

use core::f64::consts::PI;

use horus_voter::{Fix, Stated, WEEK_MS};
use ublox::{proto27::PacketRef, proto27::Proto27, FixedBuffer, Parser, ParserError, UbxPacket};

use profile::{FixType, ABSENT_F32, ABSENT_F64};

use crate::configuration::{Answer, VALSET};

/// The longest UBX message that can be taken in, bytes: NAV-PVT has 100, and satellite lists are not needed.
pub const BUFFER: usize = 256;
/// The most bytes that one call of [`Receiver::receive`] takes.
pub const BYTES_PER_CALL: usize = 64;
/// How long a receiver counts as heard after an intact message, ms (docs/design.md#status-words, bit 7).
pub const HEARD_MS: u32 = 250;

/// The longest period of a kind of message that is accepted, ms (docs/design.md#validity). It is u-blox's default, so
/// it is also assumed until the second message of the kind.
pub const LONGEST_PERIOD_MS: u32 = 1_000;
/// The shortest period that is accepted, ms: 50 Hz, twice the rate of the fastest receivers.
const SHORTEST_PERIOD_MS: u32 = 20;
/// How many steps of the time of week in a row must be longer than the period before the period grows.
pub const LONGER_STEPS: u32 = 4;
/// The time, ms, by which a solution's age may exceed its period while the solution is valid (docs/design.md#validity).
pub const VALID_SLACK_MS: u32 = 150;
/// The time, ms, by which a solution's age has to exceed its period for the solution to be stale
/// (docs/design.md#validity).
pub const STALE_SLACK_MS: u32 = 50;
/// A time stamp of this age, ms, is dropped, long before the clock's wrap could make it look recent.
const FORGOTTEN_MS: u32 = 60_000;

/// How long a line must be silent before a message that has begun counts as over, ms. A receiver sends a message
/// without a pause, and a byte takes 22 µs.
pub const GAP_MS: u32 = 50;

/// The number of bytes of a UBX message besides its payload: two sync, class, identifier, two length, two checksum.
const UBX_OVERHEAD: usize = 8;

/// The time of an event, on a millisecond clock that wraps. A stamp always holds a time, and its methods have no
/// branch, so that a tick's work takes equally long whether the event ever happened or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    at: u32,
    happened: bool,
}

impl Stamp {
    /// Whether the event happened at most `limit` ms (below 2^31) before `now`. An event after `now` counts too, since
    /// a message may arrive between a tick and its cycle.
    #[must_use]
    pub const fn within(self, now: u32, limit: u32) -> bool {
        self.happened & (now.wrapping_sub(self.at) as i32 <= limit as i32)
    }

    fn set(&mut self, now: u32) {
        *self = Self { at: now, happened: true };
    }

    fn expire(&mut self, now: u32) {
        // Not covered: a time stamp that is older than a minute: no run lasts so long. The tests of this file have it.
        if !self.within(now, FORGOTTEN_MS) {
            *self = Self::default();
        }
    }
}

/// The arrival of the last message of one kind with a new time of week, and the period of that kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    arrived: Stamp,
    time_of_week_ms: Option<u32>,
    /// The time from the last message's time of week to its arrival, ms, modulo a week.
    lag_ms: u32,
    period_ms: u32,
    /// The number of steps of the time of week in a row that were longer than the period.
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
    /// Returns the learned period of the messages of this kind, ms, at most [`LONGEST_PERIOD_MS`].
    #[must_use]
    pub const fn period_ms(&self) -> u32 {
        self.period_ms
    }

    /// Whether the last message of this kind is young enough at `now`, ms, not to be stale.
    #[must_use]
    pub fn is_fresh(&self, now: u32) -> bool {
        self.arrived.within(now, self.period_ms + STALE_SLACK_MS - 1)
    }

    /// Whether the last message of this kind is young enough to be valid at `now`, ms.
    #[must_use]
    pub fn is_current(&self, now: u32) -> bool {
        self.arrived.within(now, self.period_ms + VALID_SLACK_MS)
    }

    /// Returns the time from the arrival of the last message to `now`, ms. It is below 0 for a message that arrived
    /// after `now`, and `i32::MAX` if there was no message.
    #[must_use]
    pub fn since_arrival_ms(&self, now: u32) -> i32 {
        if self.arrived.happened {
            now.wrapping_sub(self.arrived.at) as i32
        } else {
            i32::MAX
        }
    }

    /// Whether any message of this kind has ever arrived.
    #[must_use]
    pub const fn has_arrived(&self) -> bool {
        self.time_of_week_ms.is_some()
    }

    /// Returns the age, ms, of the last message of this kind at `now`, for
    /// [`GpsStatus::solution_age_ms`](profile::GpsStatus::solution_age_ms). It is 0 if the message arrived after `now`,
    /// and `i32::MAX` after more than `FORGOTTEN_MS` or if there was no message.
    #[must_use]
    pub fn age_ms(&self, now: u32) -> u32 {
        self.since_arrival_ms(now).max(0) as u32
    }

    /// Returns the time from the last message's time of week to its arrival by HORUS's clock, ms, modulo a week. When
    /// that clock wraps, after 49 days, the returned time jumps once.
    #[must_use]
    pub const fn lag_ms(&self) -> u32 {
        self.lag_ms
    }

    fn arrive(&mut self, time_of_week_ms: u32, now: u32) {
        if self.time_of_week_ms == Some(time_of_week_ms) {
            return;
        }
        if let Some(previous) = self.time_of_week_ms {
            let step_ms = (time_of_week_ms % WEEK_MS + WEEK_MS - previous % WEEK_MS) % WEEK_MS;
            // A time of week that steps back, after a restart of the receiver, says nothing about the receiver's
            // period.
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

/// The position, from NAV-PVT.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// The arrival of the last NAV-PVT message, and the period of these messages.
    pub pace: Pace,
    /// The kind of the fix; `None` before the first message, and for a code that UBX reserves.
    pub fix: Option<FixType>,
    /// Whether latitude and longitude can be used: the receiver says so (`gnssFixOK`, not `invalidLlh`, and a 2D, 3D or
    /// combined fix), and its values are plausible. Dead reckoning without satellites does not count, since its error
    /// grows without a stated bound.
    pub valid: bool,
    /// The latitude, degrees, WGS-84.
    pub latitude: f64,
    /// The longitude, degrees, WGS-84.
    pub longitude: f64,
    /// The altitude, m above the WGS-84 ellipsoid. It is NaN for a 2D fix, because the receiver has then assumed the
    /// altitude.
    pub altitude: f64,
    /// The velocity, m/s north, east, down.
    pub velocity: [f64; 3],
    /// The standard deviation of the horizontal position, m.
    pub horizontal_accuracy: f64,
    /// The standard deviation of the altitude, m.
    pub vertical_accuracy: f64,
    /// The position in the form that the voter takes.
    pub voted: Fix,
}

/// The attitude, from NAV-ATT. An angle that the receiver does not give is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// The arrival of the last NAV-ATT message, and the period of these messages.
    pub pace: Pace,
    /// Whether all three angles are given.
    pub valid: bool,
    /// The pitch, rad, nose up positive.
    pub pitch: f32,
    /// The yaw, rad from true north, clockwise.
    pub yaw: f32,
    /// The roll, rad, right side down positive.
    pub roll: f32,
}

/// The accelerations, from ESF-INS. An acceleration that the receiver does not give is NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Acceleration {
    /// The arrival of the last ESF-INS message, and the period of these messages.
    pub pace: Pace,
    /// Whether all three axes are given.
    pub valid: bool,
    /// The accelerations, m/s², in the vehicle frame front-right-down, with gravity removed ("compensated").
    pub axes: [f32; 3],
}

/// The latest values that one receiver has sent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solution {
    /// The instant at which the receiver's last intact message arrived.
    pub last_heard: Stamp,
    /// The latest position, from NAV-PVT.
    pub position: Position,
    /// The latest attitude, from NAV-ATT.
    pub attitude: Attitude,
    /// The latest accelerations, from ESF-INS.
    pub acceleration: Acceleration,
}

/// The counts of what a receiver's line has carried so far. All counts wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// The number of bytes that were taken in from this receiver's line.
    pub bytes: u32,
    /// Intact UBX messages of any kind.
    pub messages: u32,
    /// UBX messages with a wrong checksum.
    pub damaged: u32,
    /// UBX messages that are too long for the buffer, or have a field that their kind does not have.
    pub unusable: u32,
    useful: u32,
}

impl Counts {
    /// Returns the number of bytes that belonged to no useful message: NMEA, UBX of other kinds, noise, damage. The
    /// bytes of an unfinished message count until the message is complete.
    #[must_use]
    pub const fn skipped(&self) -> u32 {
        self.bytes.wrapping_sub(self.useful)
    }
}

/// One receiver's line: its parser, its latest values and its counts.
pub struct Receiver {
    parser: Parser<FixedBuffer<BUFFER>, Proto27>,
    solution: Solution,
    counts: Counts,
    spoke: Stamp,
    answer: Option<Answer>,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// Returns a receiver from which no byte has arrived.
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

    /// Takes up to [`BYTES_PER_CALL`] of `bytes`, which arrived by `now` (ms, wraps), and returns how many it took. The
    /// caller must ask [`Receiver::is_due`] every few ms and, if the answer is true, call this method even without
    /// bytes. Only a call detects a silent line and drops old time stamps.
    pub fn receive(&mut self, bytes: &[u8], now: u32) -> usize {
        let (bytes, _) = bytes.split_at(bytes.len().min(BYTES_PER_CALL));
        self.solution.expire(now);
        if !bytes.is_empty() {
            self.spoke.set(now);
            self.counts.bytes = self.counts.bytes.wrapping_add(bytes.len() as u32);
            self.parse(bytes, now);
        // Not covered: only this line, bytes in the buffer before the line has spoken: only bytes that have come fill
        // it.
        } else if !self.parser.is_buffer_empty() && !self.spoke.within(now, GAP_MS) {
            // Not covered: bytes in the buffer before the line has spoken, as above.
            let then = if self.spoke.happened { self.spoke.at } else { now };
            self.parse(&[0xFF; BYTES_PER_CALL], then);
        }
        bytes.len()
    }

    /// Whether [`Receiver::receive`] has work at `now` (ms, wraps) although no byte has come: a message whose rest does
    /// not come, or a time stamp to drop.
    #[must_use]
    pub fn is_due(&self, now: u32) -> bool {
        // Not covered: bytes in the buffer before the line has spoken, as above.
        !self.parser.is_buffer_empty() && !self.spoke.within(now, GAP_MS) || self.solution.has_expired(now)
    }

    fn parse(&mut self, bytes: &[u8], arrived: u32) {
        // Not covered: only this line, a call without bytes, which `receive` does not make, and a buffer that does not
        // begin with a sync: between two calls the parser leaves only the beginning of a message in it.
        let mut messages = self.parser.consume_ubx(bytes);
        // Not covered: only this line, states that the parser's buffer never has here: between two calls it holds the
        // beginning of one message, from its first byte on, and no message fills it. And an error of `match_packet`, as
        // below.
        while let Some(message) = messages.next() {
            // Not covered: only this line, in the path behind an error of the parser's `match_packet`, which returns
            // none: a payload of a length that its message cannot have makes it an unknown message.
            match message {
                // Zeros after a sync are a message of class 0 without payload, whose checksum is zero. A line that
                // falls low, or has another baud rate, brings such messages. UBX has no class 0, so they are not
                // counted as messages.
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

    /// Returns the latest values that the receiver has sent.
    #[must_use]
    pub const fn solution(&self) -> &Solution {
        &self.solution
    }

    /// Returns the receiver's answer to a configuration message, if one has come since the last call.
    pub fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// Returns the counts of the receiver's line.
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

    fn has_expired(&self, now: u32) -> bool {
        let stamps =
            [self.last_heard, self.position.pace.arrived, self.attitude.pace.arrived, self.acceleration.pace.arrived];
        // Not covered: a time stamp that is older than a minute, as above.
        stamps.iter().any(|stamp| stamp.happened && !stamp.within(now, FORGOTTEN_MS))
    }

    /// Takes the useful values of a UBX message. Returns the message's length if it had useful values, otherwise 0.
    fn take(&mut self, message: &UbxPacket<'_>, now: u32) -> usize {
        // If another crate enables more protocol versions, the parser has more variants. Only version 27 is handled
        // here.
        #[allow(unreachable_patterns)]
        match message {
            UbxPacket::Proto27(PacketRef::NavPvt(pvt)) => {
                let position = &mut self.position;
                position.pace.arrive(pvt.itow(), now);
                position.fix = FixType::from_ubx(pvt.fix_type_raw());
                let stated = Stated {
                    latitude_e7: pvt.latitude_raw(),
                    longitude_e7: pvt.longitude_raw(),
                    // Not covered: only this line, to which the debug information leads an instruction of the parser's
                    // buffer that has no line of its own: it would drop all bytes of a full buffer.
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

/// The length of UBX-ACK-ACK and -NAK, bytes. The payload is class and identifier of the message that is answered.
const ANSWER_LEN: usize = 2 + UBX_OVERHEAD;

fn answer_of(message: &UbxPacket<'_>) -> Option<Answer> {
    #[allow(unreachable_patterns)]
    match message {
        // Not covered: only this line, in the path behind an error of `match_packet`, as in `parse`.
        UbxPacket::Proto27(PacketRef::AckAck(ack)) if (ack.class(), ack.msg_id()) == VALSET => Some(Answer::Taken),
        UbxPacket::Proto27(PacketRef::AckNak(nak)) if (nak.class(), nak.msg_id()) == VALSET => Some(Answer::Refused),
        _ => None,
    }
}

/// NAV-PVT `flags` bit 0: the fix is within the receiver's accuracy masks.
const GNSS_FIX_OK: u8 = 0x01;
/// NAV-PVT `flags3` bit 0: longitude, latitude and height are invalid.
const INVALID_LLH: u8 = 0x01;
/// ESF-INS `bitfield0` bits 11 to 13: the acceleration along an axis is valid.
const X_ACCEL_VALID: u32 = 1 << 11;
const Y_ACCEL_VALID: u32 = 1 << 12;
const Z_ACCEL_VALID: u32 = 1 << 13;

/// Returns an angle of NAV-ATT in rad; NaN if its accuracy is zero, which means that the angle is not available.
fn angle(e5_degrees: i32, accuracy: u32) -> f32 {
    if accuracy == 0 {
        ABSENT_F32
    } else {
        (f64::from(e5_degrees) * (PI / 180.0 / 1e5)) as f32
    }
}

/// Returns an acceleration of ESF-INS (1e-2 m/s²) in m/s²; NaN if it is not flagged valid.
fn axis(centimetres: i32, valid: u32) -> f32 {
    if valid == 0 {
        ABSENT_F32
    } else {
        (f64::from(centimetres) / 1e2) as f32
    }
}
