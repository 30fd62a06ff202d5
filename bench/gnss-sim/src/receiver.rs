//! A u-blox receiver as a source of bytes.
//!
//! # Design
//!
//! A receiver is an iterator of [`Burst`]s in order of time. It calculates a burst only when it is asked for it, from
//! the state before that burst. So a run of any length needs no memory. A burst starts only when the one before has
//! left the line, at the receiver's bit rate.
//!
//! A generated receiver starts as if HORUS had configured it before; [`Receiver::with_factory_settings`] returns one
//! that HORUS has yet to configure. A message to the receiver ([`Receiver::hear`]) may change its output; the next
//! burst is then calculated again.
//!
//! # The errors of a generated receiver
//!
//! - The receiver calculates solutions for epochs that are multiples of its period in GPS time. Reset occurs at a
//!   random instant of GPS time, so epochs are not aligned with the 10 ms cycle of HORUS.
//! - The receiver's clock drifts. Steps of 1 ms keep it within ±0.5 ms of GPS time, as in u-blox receivers. A solution
//!   is for the instant at which this clock shows the epoch.
//! - The position has a wandering bias (first-order Gauss-Markov) and white noise. Velocity, attitude and acceleration
//!   have white noise. Attitude and acceleration also have a constant error from the mounting.
//! - A solution leaves the receiver 40 to 80 ms after its epoch, depending on the receiver's model, and with jitter.
//!
//! Receivers of an odd number have inertial sensors and send NAV-ATT and ESF-INS; the others only send NAV-PVT.

use std::sync::Arc;

use chrono::{Datelike, TimeDelta, Timelike};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, Uniform};

use crate::config::{Abilities, Configuration, Output, Port};
use crate::flight::{Flight, State};
use crate::log::{Log, RecordedPosition};
use crate::nmea;
use crate::ubx::{EsfIns, Frame, NavAtt, NavPvt, WEEK_MS};

/// The default bit rate of a receiver's UART, bit/s.
pub const BIT_RATE: u32 = 460_800;

/// The number of bits of a byte on the line: a start bit, eight data bits and a stop bit.
const BITS_PER_BYTE: u64 = 10;

/// The GPS week of simulated flights, which began on 22 June 2025.
const WEEK: i64 = 2_372;
/// The GPS time of week at which reset occurs, rounded down to a second, ms: Wednesday, 10:00.
const START_OF_RUN_MS: u64 = (3 * 24 + 10) * 3_600_000;
/// The seconds by which GPS time is ahead of UTC since 2017 (IERS Bulletin C 52).
const LEAP_SECONDS: i64 = 18;
/// The height of the ellipsoid above mean sea level near Winterthur, m (EGM96).
const GEOID: f64 = 47.5;
/// The time constant of the wandering bias of the position, s.
const BIAS_TIME: f64 = 60.0;

/// The bytes that a receiver sends without a gap between them, and the instant of the first one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Burst {
    /// The instant at which the start bit of the first byte begins, ns after reset.
    pub at_ns: u64,
    /// The bytes of the burst; empty if the receiver is configured to send no message with this solution.
    pub bytes: Vec<u8>,
}

/// The model of a generated receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// The navigation period, ms, which divides the week.
    pub period_ms: u32,
    /// The mean time from an epoch to the first byte of the epoch's solution, ms.
    pub delay_ms: f64,
    /// The standard deviation of a solution's delay, ms. The deviation is limited to three times this value.
    pub delay_jitter_ms: f64,
    /// Whether the receiver sends NAV-ATT.
    pub attitude: bool,
    /// Whether the receiver sends ESF-INS.
    pub inertial: bool,
    /// The standard deviations of the wandering bias and of the white noise on each horizontal axis, m.
    pub horizontal_m: (f64, f64),
    /// The standard deviations of the wandering bias and of the white noise on the vertical axis, m.
    pub vertical_m: (f64, f64),
}

impl Model {
    /// The models of HORUS's first to fifth receiver.
    pub const FITTED: [Self; 5] = [
        Self {
            period_ms: 100,
            delay_ms: 48.0,
            delay_jitter_ms: 1.5,
            attitude: true,
            inertial: true,
            horizontal_m: (0.8, 0.10),
            vertical_m: (1.4, 0.20),
        },
        Self {
            period_ms: 125,
            delay_ms: 61.0,
            delay_jitter_ms: 2.5,
            attitude: false,
            inertial: false,
            horizontal_m: (1.1, 0.15),
            vertical_m: (1.9, 0.30),
        },
        Self {
            period_ms: 200,
            delay_ms: 74.0,
            delay_jitter_ms: 2.0,
            attitude: true,
            inertial: true,
            horizontal_m: (1.0, 0.12),
            vertical_m: (1.7, 0.25),
        },
        Self {
            period_ms: 40,
            delay_ms: 42.0,
            delay_jitter_ms: 0.6,
            attitude: false,
            inertial: false,
            horizontal_m: (1.3, 0.20),
            vertical_m: (2.2, 0.35),
        },
        Self {
            period_ms: 100,
            delay_ms: 55.0,
            delay_jitter_ms: 2.0,
            attitude: true,
            inertial: true,
            horizontal_m: (0.9, 0.12),
            vertical_m: (1.5, 0.22),
        },
    ];

    /// The model of receiver number `index`, from 1. The sixth is like the first, and so on.
    #[must_use]
    pub fn fitted(index: usize) -> Self {
        Self::FITTED[index.wrapping_sub(1) % Self::FITTED.len()]
    }
}

/// A receiver, as an iterator of its bursts in order of time. A clone with the same inputs yields the same bursts.
#[derive(Debug, Clone)]
pub struct Receiver {
    source: Source,
    bit_rate: u32,
    idle_ns: u64,
    due: Option<Burst>,
}

#[derive(Debug, Clone)]
enum Source {
    Generated(Box<Generated>),
    Recorded { log: Arc<Log>, next: usize },
}

impl Receiver {
    /// Returns receiver number `index` (from 1), which observes `flight` with errors drawn from `seed`.
    #[must_use]
    pub fn generated(index: usize, seed: u64, flight: Arc<Flight>) -> Self {
        Self::with_model(Model::fitted(index), index, seed, flight)
    }

    /// Returns a generated receiver ([`Self::generated`]) of the given model.
    #[must_use]
    pub fn with_model(model: Model, index: usize, seed: u64, flight: Arc<Flight>) -> Self {
        Self::from_source(Source::Generated(Box::new(Generated::new(model, index, seed, flight))))
    }

    /// Connects the receiver by `port`, and returns it. Only the settings of the connected port have an effect.
    #[must_use]
    pub fn connected_by(mut self, port: Port) -> Self {
        self.rebuild(|generated| generated.port = port);
        self
    }

    /// Returns the receiver with its factory settings: 38 400 bit/s, NMEA only, one solution a second.
    #[must_use]
    pub fn with_factory_settings(mut self) -> Self {
        self.restart(0, true);
        self
    }

    /// Makes the receiver compute a solution every `period_ms` milliseconds and refuse any other period, and returns
    /// it.
    ///
    /// # Panics
    ///
    /// Panics if the period is 0.
    #[must_use]
    pub fn with_fixed_period(mut self, period_ms: u32) -> Self {
        assert!(period_ms > 0, "a solution takes time");
        self.rebuild(|generated| {
            generated.model.period_ms = period_ms;
            generated.fixed_period = true;
        });
        self
    }

    fn rebuild(&mut self, change: impl FnOnce(&mut Generated)) {
        if let Source::Generated(generated) = &mut self.source {
            change(generated);
            generated.configure_anew();
            generated.follow_configuration(0);
            self.bit_rate = generated.output.bit_rate;
        }
    }

    /// Processes a byte that arrives at `at_ns` (ns after reset), `None` for an unreadable byte. Returns the answer to
    /// a completed message, which is sent at the bit rate that the message may just have set.
    pub fn hear(&mut self, at_ns: u64, byte: Option<u8>) -> Option<Vec<u8>> {
        let Source::Generated(generated) = &mut self.source else { return None };
        let answer = generated.configuration.hear(byte)?;
        self.reconfigured(at_ns);
        Some(answer)
    }

    /// Restarts the receiver at `at_ns` (ns after reset) without its unsaved and, with `factory`, its saved settings.
    pub fn restart(&mut self, at_ns: u64, factory: bool) {
        if let Source::Generated(generated) = &mut self.source {
            generated.configuration.restart(factory);
            self.reconfigured(at_ns);
        }
    }

    /// Makes the receiver lose its unsaved dynamic model and no other setting.
    pub fn forget_dynamic_model(&mut self) {
        if let Source::Generated(generated) = &mut self.source {
            generated.configuration.forget_dynamic_model();
        }
    }

    /// The dynamic model in the numbering of CFG-NAVSPG-DYNMODEL; `None` for a recorded receiver.
    #[must_use]
    pub fn dynamic_model(&self) -> Option<u8> {
        match &self.source {
            Source::Generated(generated) => Some(generated.configuration.dynamic_model()),
            Source::Recorded { .. } => None,
        }
    }

    /// Calculates the next burst again if the configuration has changed at `at_ns` (ns after reset).
    fn reconfigured(&mut self, at_ns: u64) {
        let Source::Generated(generated) = &mut self.source else { return };
        if generated.configuration.output() == generated.output {
            return;
        }
        if self.due.take().is_some()
            && let Some(before) = generated.before.take()
        {
            let configuration = generated.configuration.clone();
            **generated = *before;
            generated.configuration = configuration;
        }
        generated.follow_configuration(at_ns);
        self.bit_rate = generated.output.bit_rate;
    }

    /// The output that is configured; `None` for a recorded receiver.
    #[must_use]
    pub fn output(&self) -> Option<Output> {
        match &self.source {
            Source::Generated(generated) => Some(generated.output),
            Source::Recorded { .. } => None,
        }
    }

    /// The instant of the receiver's next burst, ns after reset; `None` if there is none.
    pub fn next_at(&mut self) -> Option<u64> {
        if self.due.is_none() {
            let mut burst = match &mut self.source {
                Source::Generated(generated) => {
                    generated.before = None;
                    generated.before = Some(generated.clone());
                    generated.next()
                }
                Source::Recorded { log, next } => {
                    let (at_ns, bytes) = log.burst(*next)?;
                    *next += 1;
                    Burst { at_ns, bytes: bytes.to_vec() }
                }
            };
            burst.at_ns = burst.at_ns.max(self.idle_ns);
            self.due = Some(burst);
        }
        self.due.as_ref().map(|burst| burst.at_ns)
    }

    /// Returns a receiver that plays `log`.
    #[must_use]
    pub fn recorded(log: Arc<Log>) -> Self {
        Self::from_source(Source::Recorded { log, next: 0 })
    }

    fn from_source(source: Source) -> Self {
        Self { source, bit_rate: BIT_RATE, idle_ns: 0, due: None }
    }

    /// Returns the receiver with another bit rate (8N1).
    ///
    /// # Panics
    ///
    /// Panics if the rate is zero.
    #[must_use]
    pub fn at_bit_rate(mut self, bits_per_second: u32) -> Self {
        assert!(bits_per_second > 0, "a UART has a bit rate");
        self.bit_rate = bits_per_second;
        self
    }

    /// The bit rate on the line, bit/s.
    #[must_use]
    pub fn bit_rate(&self) -> u32 {
        self.bit_rate
    }

    /// The instant, ns after reset, at which the last byte of the last valid position in `burst` has been sent; `None`
    /// if the burst has no valid position.
    #[must_use]
    pub fn last_solution_ns(&self, burst: &Burst) -> Option<u64> {
        let mut last = None;
        let mut at = 0;
        while let Some(rest) = burst.bytes.get(at..).filter(|rest| !rest.is_empty()) {
            at += match Frame::at_start_of(rest) {
                Some(frame) => {
                    let end = at + frame.wire_len();
                    if RecordedPosition::from_frame(&frame).is_some() {
                        last = Some(burst.at_ns + self.line_time_ns(end));
                    }
                    frame.wire_len()
                }
                None => 1,
            };
        }
        last
    }

    /// The time that `bytes` bytes take on the line, ns, rounded up.
    #[must_use]
    pub fn line_time_ns(&self, bytes: usize) -> u64 {
        (bytes as u64 * BITS_PER_BYTE * 1_000_000_000).div_ceil(u64::from(self.bit_rate))
    }
}

impl Iterator for Receiver {
    type Item = Burst;

    fn next(&mut self) -> Option<Burst> {
        self.next_at()?;
        let burst = self.due.take()?;
        self.idle_ns = burst.at_ns + self.line_time_ns(burst.bytes.len());
        Some(burst)
    }
}

#[derive(Debug, Clone)]
struct Generated {
    model: Model,
    port: Port,
    fixed_period: bool,
    configuration: Configuration,
    output: Output,
    solutions: u32,
    /// The state of a receiver before its next burst. It is kept so that the burst can be calculated again.
    before: Option<Box<Generated>>,
    flight: Arc<Flight>,
    noise: ChaCha8Rng,
    reset_ns: u64,
    /// The number of the next epoch, from the start of the week.
    epoch: u64,
    /// How far the receiver's clock is ahead of GPS time at reset, ns; at most ±0.5 ms.
    clock_ns: f64,
    /// The drift of the receiver's clock, parts per billion.
    clock_ppb: f64,
    /// The wandering bias of the position to north, east and down, m.
    bias: [f64; 3],
    /// The constant errors of roll, pitch and heading, from the mounting, rad.
    mounting: [f64; 3],
    /// The constant error of the accelerations, m/s².
    offset: [f64; 3],
    satellites: u8,
}

impl Generated {
    fn new(model: Model, index: usize, seed: u64, flight: Arc<Flight>) -> Self {
        // ChaCha stream 0 draws the values that all receivers share. Each receiver draws its noise from a stream of its
        // own.
        let mut shared = ChaCha8Rng::seed_from_u64(seed);
        shared.set_stream(0);
        let mut noise = ChaCha8Rng::seed_from_u64(seed);
        noise.set_stream(index as u64 + 1);

        let reset_ns = START_OF_RUN_MS * 1_000_000 + uniform(&mut shared, 0.0, 1e9) as u64;
        let clock_ns = uniform(&mut noise, -0.5e6, 0.5e6);
        let clock_ppb = uniform(&mut noise, -500.0, 500.0);
        let mut three = |deviation: f64| [(); 3].map(|()| deviation * normal(&mut noise));
        let (horizontal, vertical) = (model.horizontal_m.0, model.vertical_m.0);
        let [north, east, down] = three(1.0);
        let mounting = three(0.3_f64.to_radians());
        let offset = three(0.02);
        let satellites = 12 + uniform(&mut noise, 0.0, 7.0) as u8;
        let configuration = configuration(&model, Port::Uart1, false);
        let output = configuration.output();
        let mut generated = Self {
            model,
            port: Port::Uart1,
            fixed_period: false,
            configuration,
            output,
            solutions: 0,
            before: None,
            flight,
            noise,
            reset_ns,
            epoch: 0,
            clock_ns,
            clock_ppb,
            bias: [horizontal * north, horizontal * east, vertical * down],
            mounting,
            offset,
            satellites,
        };
        generated.follow_configuration(0);
        generated
    }

    fn configure_anew(&mut self) {
        self.configuration = configuration(&self.model, self.port, self.fixed_period);
    }

    /// Derives the output from the configuration for the time from `at_ns` (ns after reset) on.
    fn follow_configuration(&mut self, at_ns: u64) {
        self.output = self.configuration.output();
        // The receiver's clock may be wrong by up to 1 ms. One more millisecond therefore makes the next epoch later
        // than `at_ns`.
        let period_ns = u64::from(self.output.period_ms) * 1_000_000;
        self.epoch = (self.reset_ns + at_ns + 1_000_000).div_ceil(period_ns);
    }

    fn next(&mut self) -> Burst {
        let period_ms = u64::from(self.output.period_ms);
        let epoch_ms = self.epoch * period_ms;
        self.epoch += 1;
        let nominal_ns = epoch_ms * 1_000_000 - self.reset_ns;
        let clock_ns = self.clock_error_ns(nominal_ns);
        // A receiver whose clock is ahead measures early.
        let measured_ns = nominal_ns as f64 - clock_ns;
        let truth = self.flight.state(measured_ns / 1e9);
        let seen = self.observe(&truth);

        // The jitter is limited to three standard deviations, so that solutions stay in order.
        let jitter = normal(&mut self.noise).clamp(-3.0, 3.0) * self.model.delay_jitter_ms;
        let sent_ns = measured_ns + (self.model.delay_ms + jitter) * 1e6;
        let bytes = self.messages(epoch_ms, clock_ns, &seen);
        self.solutions = self.solutions.wrapping_add(1);
        Burst { at_ns: libm::round(sent_ns) as u64, bytes }
    }

    /// The error of the receiver's clock, ns, which drifts and is stepped by 1 ms when it leaves ±0.5 ms.
    fn clock_error_ns(&self, since_reset_ns: u64) -> f64 {
        let free = self.clock_ns + self.clock_ppb * since_reset_ns as f64 / 1e9;
        free - 1e6 * libm::round(free / 1e6)
    }

    fn observe(&mut self, truth: &State) -> State {
        let mut normal = || normal(&mut self.noise);
        let keep = libm::exp(-f64::from(self.output.period_ms) / 1e3 / BIAS_TIME);
        let fresh = libm::sqrt(1.0 - keep * keep);
        let (horizontal, vertical) = (self.model.horizontal_m, self.model.vertical_m);
        let mut ned = truth.ned;
        for ((metres, bias), (wander, white)) in
            ned.iter_mut().zip(&mut self.bias).zip([horizontal, horizontal, vertical])
        {
            *bias = keep * *bias + fresh * wander * normal();
            *metres += *bias + white * normal();
        }
        State {
            position: self.flight.plane().to_geodetic(ned),
            ned,
            velocity: truth.velocity.map(|v| v + 0.04 * normal()),
            roll: truth.roll + self.mounting[0] + 0.2_f64.to_radians() * normal(),
            pitch: truth.pitch + self.mounting[1] + 0.2_f64.to_radians() * normal(),
            yaw: truth.yaw + self.mounting[2] + 0.4_f64.to_radians() * normal(),
            acceleration: [0, 1, 2].map(|i| truth.acceleration[i] + self.offset[i] + 0.03 * normal()),
            rates: truth.rates.map(|rate| rate + 0.05_f64.to_radians() * normal()),
        }
    }

    /// Encodes those messages of a solution that the receiver is configured to send.
    fn messages(&self, epoch_ms: u64, clock_ns: f64, seen: &State) -> Vec<u8> {
        let itow_ms = u32::try_from(epoch_ms % u64::from(WEEK_MS)).expect("a week is shorter than 2^32 ms");
        let pvt = self.nav_pvt(epoch_ms, itow_ms, clock_ns, seen);
        let due = |every: u32| every != 0 && self.solutions.is_multiple_of(every);
        let mut bytes = if self.output.nmea { nmea::sentences(&pvt) } else { vec![] };
        if due(self.output.position) {
            bytes.extend(pvt.encode());
        }
        if due(self.output.attitude) {
            let heading = seen.yaw.to_degrees();
            let att = NavAtt {
                itow_ms,
                roll_1e5: rounded(seen.roll.to_degrees() * 1e5),
                pitch_1e5: rounded(seen.pitch.to_degrees() * 1e5),
                heading_1e5: heading_1e5(heading),
                accuracy_1e5: [40_000, 40_000, 60_000],
            };
            bytes.extend(att.encode());
        }
        if due(self.output.inertial) {
            let ins = EsfIns {
                itow_ms,
                rates_1e3: seen.rates.map(|rate| rounded(rate.to_degrees() * 1e3)),
                accelerations_1e2: seen.acceleration.map(|a| rounded(a * 1e2)),
            };
            bytes.extend(ins.encode());
        }
        bytes
    }

    fn nav_pvt(&self, epoch_ms: u64, itow_ms: u32, clock_ns: f64, seen: &State) -> NavPvt {
        let ms = i64::try_from(epoch_ms).expect("the run is shorter than 292 million years");
        // GPS time began on 6 January 1980.
        let utc = chrono::NaiveDate::from_ymd_opt(1980, 1, 6)
            .and_then(|day| day.and_hms_opt(0, 0, 0))
            .map(|origin| {
                origin + TimeDelta::weeks(WEEK) + TimeDelta::milliseconds(ms) - TimeDelta::seconds(LEAP_SECONDS)
            })
            .expect("the sixth of January 1980 is a date");
        let [north, east, down] = seen.velocity;
        let ground_speed = libm::hypot(north, east);
        let millimetres = |metres: f64| rounded(metres * 1e3);
        let accuracy = |(bias, white): (f64, f64), axes: f64| {
            millimetres(libm::sqrt(axes) * libm::hypot(bias, white)).unsigned_abs()
        };
        NavPvt {
            itow_ms,
            year: u16::try_from(utc.year()).expect("the year has four digits"),
            month: utc.month() as u8,
            day: utc.day() as u8,
            hour: utc.hour() as u8,
            minute: utc.minute() as u8,
            second: utc.second() as u8,
            valid: 0b0111,
            time_accuracy_ns: 25,
            nano: utc.nanosecond() as i32 - rounded(clock_ns),
            fix_type: if self.model.inertial { 4 } else { 3 },
            flags: NavPvt::FLAG_FIX_OK | if self.model.attitude { NavPvt::FLAG_HEADING_OF_VEHICLE } else { 0 },
            flags2: 0b1110_0000,
            satellites: self.satellites,
            longitude_1e7: rounded(seen.position.longitude * 1e7),
            latitude_1e7: rounded(seen.position.latitude * 1e7),
            height_mm: millimetres(seen.position.height),
            height_msl_mm: millimetres(seen.position.height - GEOID),
            horizontal_accuracy_mm: accuracy(self.model.horizontal_m, 2.0),
            vertical_accuracy_mm: accuracy(self.model.vertical_m, 1.0),
            velocity_mm_s: [north, east, down].map(millimetres),
            ground_speed_mm_s: millimetres(ground_speed),
            heading_of_motion_1e5: heading_1e5(libm::atan2(east, north).to_degrees()),
            speed_accuracy_mm_s: 70,
            heading_accuracy_1e5: 60_000,
            pdop_1e2: 130,
            flags3: 0,
            heading_of_vehicle_1e5: heading_1e5(if self.model.attitude {
                seen.yaw.to_degrees()
            } else {
                libm::atan2(east, north).to_degrees()
            }),
        }
    }
}

/// The configuration of a receiver of this model after HORUS has configured it.
fn configuration(model: &Model, port: Port, fixed_period: bool) -> Configuration {
    let abilities = Abilities { attitude: model.attitude, inertial: model.inertial, fixed_period };
    Configuration::new(port, abilities, model.period_ms).configured(model.period_ms, BIT_RATE)
}

fn rounded(value: f64) -> i32 {
    libm::round(value) as i32
}

/// Converts a heading of −360 ..= 360 degrees to the UBX field, 0 ..= 360 × 1e5.
fn heading_1e5(degrees: f64) -> i32 {
    rounded(if degrees < 0.0 { degrees + 360.0 } else { degrees } * 1e5)
}

fn uniform(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    Uniform::new(low, high).expect("the bounds of every draw are finite and ordered").sample(rng)
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}
