//! Configures each receiver so that it sends the messages that HORUS needs
//!
//! # Design
//!
//! HORUS sends four messages and gets an answer to each (UBX-CFG-VALSET, answered by UBX-ACK-ACK or UBX-ACK-NAK):
//!
//! | step | message | if the receiver refuses it | if the receiver does not answer |
//! |---|---|---|---|
//! | basic | UBX on, NMEA off, NAV-PVT with every solution, the period | the receiver is used as it is | likewise |
//! | model | the dynamic model [`DYNAMIC_MODEL`] | the receiver keeps its own, which the telemetry tells | likewise |
//! | attitude | NAV-ATT with every solution | the receiver has no inertial sensors, which is normal | likewise |
//! | inertial | ESF-INS with every solution | likewise | likewise |
//!
//! **Dynamic model.** A receiver's filter assumes how its carrier moves. The factory setting is a portable device or a
//! car: low accelerations, and no position above 15 or 50 m/s vertically. In a hard manoeuvre all receivers would lag
//! or drop out alike, which no vote detects. So HORUS sets an airborne model, which gives no 2D fixes. u-blox has
//! three: less than 1 g, less than 2 g ("recommended for typical airborne environments"), and less than 4 g ("only
//! recommended for extremely dynamic environments"). Each step lets more noise into the position. A rotorcraft that
//! banks by 45° accelerates by 1 g, by 60° by 1.7 g. So HORUS takes the model of less than 2 g, which is also PX4's
//! default. The model has a message of its own, since a receiver that refuses one key refuses the whole message.
//!
//! The settings go into the receiver's RAM, which loses them without a supply. After a receiver was silent, HORUS
//! therefore repeats the messages until one is answered.
//!
//! **UART.** A receiver with factory settings uses 38 400 baud. HORUS sends its first message at the usual rate and
//! waits for an intact UBX message. If none has come for [`LISTEN_MS`], HORUS sets the receiver's baud rate by a
//! message at the factory's rate, and then sends the first message at the usual rate again. HORUS never sends at
//! another rate to a receiver that talks: u-blox's receivers close their input for up to a second after 100 framing
//! errors ("More than 100 frame errors, UART RX was disabled").
//!
//! **Bounds.** HORUS waits [`ANSWER_MS`] for each answer at most. To a receiver that talks and does not answer, HORUS
//! sends nothing more after [`ATTEMPTS`] messages, until the receiver has been silent.
//!
//! ```text
//!            answer           answer or 3 x none           the same             the same
//! basic ───────────────> model ───────────────────> attitude ──────────> inertial ──────────> done
//!  │ ^ │ nothing heard                                                                         │
//!  │ │ └───────────────> baud (UART)                                                           │
//!  │ └───── 200 ms ────────┘   <────────────────────────── silent ─────────────────────────────┘
//!  └── 3 x none, but it talks ──> done
//! ```
//!
//! # Sources
//!
//! - Sources of the keys: semuconsulting/pyubx2 (`ubxtypes_configdb.py`), aortner/ubloxcfg and the `ublox` crate
//!   (`cfg_val.rs`), which agree. The crate lacks NAV-ATT's keys, and has no way to leave the thousand other keys out
//!   of flash. So the few keys that HORUS needs are written here.
//! - Sources of the dynamic models: u-blox, *ZED-F9R integration manual* (UBX-20039643), "Dynamic platform", tables of
//!   the models and of their limits; key and values: *M10 interface description* (UBX-21035062), CFG-NAVSPG-DYNMODEL,
//!   and pyubx2; PX4's `GPS_UBX_DYNMODEL`. Open: the integration manual says that the ZED-F9R's sensor fusion is
//!   optimised for cars, scooters and lawn mowers only, but not whether it works, with NAV-ATT and ESF-INS, under an
//!   airborne model.
//! - Source of the form of the message, and of the rule that one unknown key refuses the whole message: u-blox, *F9
//!   interface descriptions*, UBX-CFG-VALSET.

use crate::{
    source::{Message, Rate, MESSAGE},
    timing,
};

/// How long HORUS waits for an answer, ms. u-blox's receivers answer a configuration message within a second.
pub const ANSWER_MS: u32 = 1_000;
/// How often a configuration message is sent to a receiver that talks but does not answer.
pub const ATTEMPTS: u8 = 3;
/// How long HORUS waits for an intact message on a UART before it tries the factory's rate, ms. This is longer than any
/// period that HORUS requests, and longer than a receiver takes to answer while it computes.
pub const LISTEN_MS: u32 = 500;
/// The pause after the message that sets the baud rate, ms. Sending the message takes 5.2 ms, and then the receiver
/// changes its rate.
pub const BAUD_MS: u32 = 200;
/// The time after which a configured receiver counts as silent, ms. It is longer than two of the longest requested
/// period.
pub const SILENT_MS: u32 = 500;
/// The time after which an unconfigured receiver counts as silent, ms. It is longer than the longest accepted period.
pub const SILENT_AS_IT_IS_MS: u32 = 1_500;

/// The dynamic model that HORUS sets in a receiver: airborne with less than 2 g.
pub const DYNAMIC_MODEL: u8 = 7;

/// The interface of the receiver to which HORUS is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interface {
    /// UART1 of the receiver.
    Uart,
    /// I2C, which u-blox calls DDC.
    Ddc,
    /// SPI.
    Spi,
}

/// A receiver's response to the basic message and to the message of the dynamic model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Standing {
    /// There was no intact message since the receiver was last silent, or HORUS awaits the answer to the basic message.
    #[default]
    NotYet = 0,
    /// The receiver has acknowledged the basic message, and has not refused the dynamic model.
    Taken = 1,
    /// The receiver has refused its configuration, and is used as it is.
    Refused = 2,
    /// The receiver talks but did not answer, and is used as it is.
    Unanswered = 3,
    /// The receiver has acknowledged the basic message, but has refused the dynamic model and keeps its former one.
    OtherModel = 4,
}

/// Returns in words a [`Standing`] that telemetry holds as a number.
#[must_use]
pub const fn name(standing: u32) -> &'static str {
    match standing {
        0 => "not configured yet",
        1 => "configured",
        2 => "refuses its configuration: used as it is",
        4 => "configured, but keeps its own dynamic model",
        _ => "does not answer: used as it is",
    }
}

/// A receiver's answer to UBX-CFG-VALSET.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// UBX-ACK-ACK: the receiver has taken the message.
    Taken,
    /// UBX-ACK-NAK: the receiver has refused the message.
    Refused,
}

/// The class and the identifier of UBX-CFG-VALSET.
pub const VALSET: (u8, u8) = (0x06, 0x8A);

const RAM: u8 = 1;

/// The keys of the configuration. Bits 28 to 30 of a key give the length of its value.
mod key {
    use super::Interface;

    pub(super) const RATE_MEAS: u32 = 0x3021_0001;
    pub(super) const RATE_NAV: u32 = 0x3021_0002;
    pub(super) const UART1_BAUDRATE: u32 = 0x4052_0001;
    pub(super) const NAVSPG_DYNMODEL: u32 = 0x2011_0021;

    /// Returns the key CFG-UART1OUTPROT-UBX, CFG-I2COUTPROT-UBX or CFG-SPIOUTPROT-UBX.
    pub(super) const fn out_ubx(interface: Interface) -> u32 {
        match interface {
            Interface::Uart => 0x1074_0001,
            Interface::Ddc => 0x1072_0001,
            Interface::Spi => 0x107A_0001,
        }
    }

    pub(super) const fn out_nmea(interface: Interface) -> u32 {
        out_ubx(interface) + 1
    }

    /// Returns a key of CFG-MSGOUT for an interface, given the key for I2C. The keys follow each other in the order
    /// I2C, UART1, UART2, USB, SPI.
    const fn msgout(i2c: u32, interface: Interface) -> u32 {
        match interface {
            Interface::Ddc => i2c,
            Interface::Uart => i2c + 1,
            Interface::Spi => i2c + 4,
        }
    }

    pub(super) const fn nav_pvt(interface: Interface) -> u32 {
        msgout(0x2091_0006, interface)
    }

    pub(super) const fn nav_att(interface: Interface) -> u32 {
        msgout(0x2091_001F, interface)
    }

    pub(super) const fn esf_ins(interface: Interface) -> u32 {
        msgout(0x2091_0114, interface)
    }
}

fn valset(items: &[(u32, u32)], rate: Rate) -> Message {
    let mut bytes = [0; MESSAGE];
    let mut len = 0;
    let mut put = |some: &[u8]| {
        if let Some(room) = bytes.get_mut(len..len + some.len()) {
            room.copy_from_slice(some);
        }
        len += some.len();
    };
    // Two zero bytes stand for the message's length, which is filled in below. Then come version 0, the layers and two
    // reserved bytes.
    put(&[0xB5, 0x62, VALSET.0, VALSET.1, 0, 0, 0, RAM, 0, 0]);
    for (key, value) in items {
        put(&key.to_le_bytes());
        let size = match key >> 28 & 0b111 {
            1 | 2 => 1,
            3 => 2,
            _ => 4,
        };
        put(&value.to_le_bytes()[..size]);
    }
    let end = len.min(MESSAGE - 2);
    bytes[4] = (end - 6) as u8;
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in &bytes[2..end] {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    bytes[end] = a;
    bytes[end + 1] = b;
    Message::new(&bytes[..end + 2], rate)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Baud,
    Basic,
    Model,
    Attitude,
    Inertial,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Due(Step),
    Awaiting(Step, u32),
    Done,
}

/// The state of one receiver's configuration.
#[derive(Clone, Debug)]
pub struct Configuration {
    interface: Interface,
    period_ms: u16,
    state: State,
    /// The number of messages in a row that the receiver has left without an answer.
    unanswered: u8,
    standing: Standing,
    messages: u32,
    last_heard: Option<u32>,
}

impl Configuration {
    /// Returns the configuration of a receiver on `interface` that is to give a solution every `period_ms` ms.
    #[must_use]
    pub const fn new(interface: Interface, period_ms: u16) -> Self {
        Self {
            interface,
            period_ms,
            state: State::Due(Step::Basic),
            unanswered: 0,
            standing: Standing::NotYet,
            messages: 0,
            last_heard: None,
        }
    }

    /// Returns how the receiver has responded to its configuration.
    #[must_use]
    pub const fn standing(&self) -> Standing {
        self.standing
    }

    /// Returns the configuration message to send to the receiver now, if any. To be called every cycle, at `now` (ms,
    /// wraps). The arguments are also the number of intact UBX messages that the receiver has sent (wraps), and its
    /// answer since the last call.
    pub fn poll(&mut self, now: u32, messages: u32, answer: Option<Answer>) -> Option<Message> {
        if messages != self.messages {
            self.messages = messages;
            self.last_heard = Some(now);
        } else if self.silent_for(now) > SILENT_AS_IT_IS_MS {
            // The time of the last message is dropped after a long silence. Otherwise the clock's wrap could make it
            // look recent.
            self.last_heard = None;
        }
        match self.state {
            State::Awaiting(step, sent) => self.await_answer(step, sent, now, answer),
            State::Done => {
                let limit = match self.standing {
                    Standing::Taken | Standing::OtherModel => SILENT_MS,
                    _ => SILENT_AS_IT_IS_MS,
                };
                if self.silent_for(now) > limit {
                    self.standing = Standing::NotYet;
                    self.go_to(Step::Basic);
                }
            }
            State::Due(_) => {}
        }
        let State::Due(step) = self.state else { return None };
        self.state = State::Awaiting(step, now);
        Some(self.message(step))
    }

    fn silent_for(&self, now: u32) -> u32 {
        self.last_heard.map_or(u32::MAX, |at| now.wrapping_sub(at))
    }

    fn await_answer(&mut self, step: Step, sent: u32, now: u32, answer: Option<Answer>) {
        let passed = now.wrapping_sub(sent);
        // The receiver counts as silent if no intact message has come since the configuration message was sent.
        let is_silent = self.silent_for(now) >= passed;
        match (step, answer) {
            (Step::Baud, Some(_)) => self.go_to(Step::Basic),
            (Step::Baud, None) if passed >= BAUD_MS => self.go_to(Step::Basic),
            (Step::Basic, Some(answer)) => {
                self.standing = match answer {
                    Answer::Taken => Standing::Taken,
                    Answer::Refused => Standing::Refused,
                };
                self.go_to(Step::Model);
            }
            (Step::Model, Some(Answer::Taken)) => self.go_to(Step::Attitude),
            (Step::Model, Some(Answer::Refused)) => self.keeps_its_model(),
            (Step::Attitude, Some(_)) => self.go_to(Step::Inertial),
            (Step::Inertial, Some(_)) => self.state = State::Done,
            (Step::Basic, None) if is_silent && self.interface == Interface::Uart && passed >= LISTEN_MS => {
                self.go_to(Step::Baud);
            }
            (Step::Basic, None) if is_silent && passed >= ANSWER_MS => self.go_to(Step::Basic),
            (_, None) if passed >= ANSWER_MS => self.repeat(step),
            _ => {}
        }
    }

    fn repeat(&mut self, step: Step) {
        self.unanswered += 1;
        if self.unanswered < ATTEMPTS {
            self.state = State::Due(step);
            return;
        }
        match step {
            Step::Baud | Step::Inertial => self.state = State::Done,
            Step::Basic => {
                self.standing = Standing::Unanswered;
                self.state = State::Done;
            }
            Step::Model => self.keeps_its_model(),
            Step::Attitude => self.go_to(Step::Inertial),
        }
    }

    fn keeps_its_model(&mut self) {
        if self.standing == Standing::Taken {
            self.standing = Standing::OtherModel;
        }
        self.go_to(Step::Attitude);
    }

    fn go_to(&mut self, step: Step) {
        self.unanswered = 0;
        self.state = State::Due(step);
    }

    fn message(&self, step: Step) -> Message {
        let interface = self.interface;
        match step {
            Step::Baud => valset(&[(key::UART1_BAUDRATE, timing::GNSS_BAUD)], Rate::Factory),
            Step::Basic => valset(
                &[
                    (key::out_ubx(interface), 1),
                    (key::out_nmea(interface), 0),
                    (key::nav_pvt(interface), 1),
                    (key::RATE_MEAS, u32::from(self.period_ms)),
                    (key::RATE_NAV, 1),
                ],
                Rate::Usual,
            ),
            Step::Model => valset(&[(key::NAVSPG_DYNMODEL, u32::from(DYNAMIC_MODEL))], Rate::Usual),
            Step::Attitude => valset(&[(key::nav_att(interface), 1)], Rate::Usual),
            Step::Inertial => valset(&[(key::esf_ins(interface), 1)], Rate::Usual),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::{vec, vec::Vec};
    use ublox::{
        cfg_val::CfgVal::{self, *},
        packets::{
            cfg_nav5::NavDynamicModel,
            cfg_val::{CfgLayerSet, CfgValSetBuilder},
        },
    };

    const NOW: u32 = u32::MAX - 1_000;

    /// A receiver and the code that configures it, in steps of 10 ms around the wrap of HORUS's clock.
    struct Talk {
        configuration: Configuration,
        now: u32,
        messages: u32,
        sent: Vec<(u32, Message)>,
    }

    impl Talk {
        fn new(interface: Interface) -> Self {
            Self { configuration: Configuration::new(interface, 125), now: NOW, messages: 0, sent: Vec::new() }
        }

        fn step(&mut self, heard: bool, answer: Option<Answer>) -> Option<Message> {
            self.now = self.now.wrapping_add(10);
            self.messages = self.messages.wrapping_add(u32::from(heard || answer.is_some()));
            let message = self.configuration.poll(self.now, self.messages, answer);
            if let Some(message) = message {
                self.sent.push((self.now.wrapping_sub(NOW), message));
            }
            message
        }

        fn pass(&mut self, ms: u32, talks: bool) {
            for step in 0..ms / 10 {
                self.step(talks && step % 10 == 9, None);
            }
        }

        /// Gives `answer` to each message of HORUS until none comes for 400 ms. Returns the number of messages
        /// answered.
        fn answer_all(&mut self, mut answer: impl FnMut(usize) -> Answer) -> usize {
            let mut answered = 0;
            let mut quiet = 0;
            while quiet < 40 {
                match self.step(false, None) {
                    Some(_) => {
                        self.step(true, None);
                        self.step(false, Some(answer(answered)));
                        // HORUS may send the next configuration message as soon as it gets an answer.
                        while self.sent.len() > answered + 1 && quiet == 0 && answered < 3 {
                            answered += 1;
                            self.step(false, Some(answer(answered)));
                        }
                        answered += 1;
                    }
                    None => quiet += 1,
                }
            }
            answered
        }
    }

    fn keys(message: &Message) -> Vec<u32> {
        let mut keys = Vec::new();
        let mut rest = &message.bytes()[10..message.bytes().len() - 2];
        while let Some((key, after)) = rest.split_first_chunk::<4>() {
            let key = u32::from_le_bytes(*key);
            keys.push(key);
            rest = &after[[0, 1, 1, 2, 4][(key >> 28) as usize]..];
        }
        keys
    }

    fn built(values: &[CfgVal]) -> Vec<u8> {
        let mut bytes = Vec::new();
        CfgValSetBuilder { version: 0, layers: CfgLayerSet::RAM, reserved1: 0, cfg_data: values }.extend_to(&mut bytes);
        bytes
    }

    #[test]
    fn the_messages_are_those_that_the_ublox_crate_builds() {
        let of = |interface| Configuration::new(interface, 200);
        let cases = [
            (
                Interface::Uart,
                vec![
                    Uart1OutProtUbx(true),
                    Uart1OutProtNmea(false),
                    MsgOutUbxNavPvtUart1(1),
                    RateMeas(200),
                    RateNav(1),
                ],
                vec![MsgOutUbxEsfInsUart1(1)],
            ),
            (
                Interface::Ddc,
                vec![I2cOutProtUbx(true), I2cOutProtNmea(false), MsgOutUbxNavPvtI2c(1), RateMeas(200), RateNav(1)],
                vec![MsgOutUbxEsfInsI2c(1)],
            ),
            (
                Interface::Spi,
                vec![SpiOutProtUbx(true), SpiOutProtNmea(false), MsgOutUbxNavPvtSpi(1), RateMeas(200), RateNav(1)],
                vec![MsgOutUbxEsfInsSpi(1)],
            ),
        ];
        for (interface, basic, inertial) in cases {
            assert_eq!(of(interface).message(Step::Basic).bytes(), built(&basic));
            assert_eq!(of(interface).message(Step::Inertial).bytes(), built(&inertial));
        }
        let baud = of(Interface::Uart).message(Step::Baud);
        assert_eq!(baud.bytes(), built(&[Uart1Baudrate(460_800)]));
        assert_eq!(baud.rate(), Rate::Factory);
        let model = of(Interface::Spi).message(Step::Model);
        assert_eq!(model.bytes(), built(&[NavSpgDynModel(NavDynamicModel::AirborneWithLess2gAcceleration)]));
        // The crate `ublox` does not have NAV-ATT's keys, so they are compared with numbers.
        let attitude =
            [Interface::Ddc, Interface::Uart, Interface::Spi].map(|it| keys(&of(it).message(Step::Attitude)));
        assert_eq!(attitude, [[0x2091_001F], [0x2091_0020], [0x2091_0023]]);
    }

    #[test]
    fn each_message_is_sent_once_to_a_receiver_that_takes_them() {
        for interface in [Interface::Uart, Interface::Ddc, Interface::Spi] {
            let mut talk = Talk::new(interface);
            assert!(talk.step(false, None).is_some());
            for _ in 0..3 {
                assert!(talk.step(false, Some(Answer::Taken)).is_some());
            }
            assert!(talk.step(false, Some(Answer::Taken)).is_none());
            talk.pass(60_000, true);
            assert_eq!(talk.sent.len(), 4);
            assert_eq!(talk.configuration.standing(), Standing::Taken);
        }
    }

    #[test]
    fn each_receiver_is_told_the_airborne_model_of_less_than_2_g() {
        for interface in [Interface::Uart, Interface::Ddc, Interface::Spi] {
            let mut talk = Talk::new(interface);
            talk.answer_all(|_| Answer::Taken);
            let models = talk.sent.iter().filter(|(_, message)| keys(message) == [0x2011_0021]);
            let models: Vec<u8> = models.map(|(_, message)| message.bytes()[14]).collect();
            assert_eq!(models, [7]);
        }
    }

    #[test]
    fn one_that_keeps_its_own_model_is_told_and_otherwise_configured() {
        let mut talk = Talk::new(Interface::Ddc);
        assert_eq!(talk.answer_all(|index| if index == 1 { Answer::Refused } else { Answer::Taken }), 4);
        assert_eq!(talk.configuration.standing(), Standing::OtherModel);
        // A receiver that refused the dynamic model counts as silent after the same time as one that took every
        // message.
        talk.step(true, None);
        talk.pass(SILENT_MS + 20, false);
        assert_eq!((talk.sent.len(), talk.configuration.standing()), (5, Standing::NotYet));

        let mut talk = Talk::new(Interface::Ddc);
        talk.step(false, None);
        talk.step(false, Some(Answer::Taken));
        talk.pass(10_000, true);
        assert_eq!(talk.configuration.standing(), Standing::OtherModel);
    }

    #[test]
    fn a_receiver_without_inertial_sensors_is_configured_all_the_same() {
        let mut talk = Talk::new(Interface::Spi);
        let answered = talk.answer_all(|index| if index < 2 { Answer::Taken } else { Answer::Refused });
        assert_eq!((answered, talk.sent.len()), (4, 4));
        assert_eq!(talk.configuration.standing(), Standing::Taken);
    }

    #[test]
    fn one_that_refuses_is_used_as_it_is_and_not_asked_again() {
        let mut talk = Talk::new(Interface::Ddc);
        assert_eq!(talk.answer_all(|_| Answer::Refused), 4);
        talk.pass(60_000, true);
        assert_eq!((talk.sent.len(), talk.configuration.standing()), (4, Standing::Refused));
    }

    #[test]
    fn a_receiver_that_sends_but_never_answers_is_asked_three_times() {
        for interface in [Interface::Uart, Interface::Ddc, Interface::Spi] {
            let mut talk = Talk::new(interface);
            talk.pass(60_000, true);
            assert_eq!(talk.sent.len(), usize::from(ATTEMPTS));
            assert!(talk.sent.iter().all(|(_, message)| message.rate() == Rate::Usual));
            assert_eq!(talk.configuration.standing(), Standing::Unanswered);
        }
    }

    #[test]
    fn one_that_is_not_there_is_asked_until_it_comes() {
        let mut talk = Talk::new(Interface::Spi);
        talk.pass(60_000, false);
        assert_eq!(talk.sent.len(), 60);
        assert_eq!(talk.configuration.standing(), Standing::NotYet);
        assert_eq!(talk.answer_all(|_| Answer::Taken), 4);
        assert_eq!(talk.configuration.standing(), Standing::Taken);
    }

    #[test]
    fn a_silent_uart_is_tried_at_both_baud_rates_in_turn() {
        let mut talk = Talk::new(Interface::Uart);
        talk.pass(3_000, false);
        let rates: Vec<Rate> = talk.sent.iter().map(|(_, message)| message.rate()).collect();
        assert_eq!(rates[..4], [Rate::Usual, Rate::Factory, Rate::Usual, Rate::Factory]);
        assert_eq!(keys(&talk.sent[1].1), [0x4052_0001]);
        let times: Vec<u32> = talk.sent.iter().map(|(at, _)| *at).collect();
        assert_eq!(times[..4], [10, 10 + LISTEN_MS, 10 + LISTEN_MS + BAUD_MS, 10 + 2 * LISTEN_MS + BAUD_MS]);
    }

    #[test]
    fn after_silence_everything_is_sent_again_and_not_sooner() {
        let mut talk = Talk::new(Interface::Ddc);
        assert_eq!(talk.answer_all(|_| Answer::Taken), 4);
        talk.pass(90, false);
        assert_eq!(talk.sent.len(), 4);
        talk.step(true, None);
        talk.pass(SILENT_MS, false);
        assert_eq!((talk.sent.len(), talk.configuration.standing()), (4, Standing::Taken));
        talk.pass(20, false);
        assert_eq!((talk.sent.len(), talk.configuration.standing()), (5, Standing::NotYet));
        assert_eq!(keys(&talk.sent[4].1), keys(&talk.sent[0].1));
    }

    #[test]
    fn an_unconfigured_receiver_may_be_silent_for_a_limited_time() {
        let mut configuration = Configuration::new(Interface::Spi, 125);
        let mut last = NOW;
        for heard in 1..=60 {
            last = NOW.wrapping_add(100 * heard);
            configuration.poll(last, heard, None);
        }
        assert_eq!(configuration.standing(), Standing::Unanswered);
        assert!(configuration.poll(last.wrapping_add(SILENT_AS_IT_IS_MS), 60, None).is_none());
        assert_eq!(configuration.standing(), Standing::Unanswered);
        assert!(configuration.poll(last.wrapping_add(SILENT_AS_IT_IS_MS + 1), 60, None).is_some());
        assert_eq!(configuration.standing(), Standing::NotYet);
    }

    #[test]
    fn a_silent_receiver_still_counts_as_silent_when_the_clock_wraps() {
        let mut configuration = Configuration::new(Interface::Spi, 125);
        configuration.poll(NOW, 1, None);
        configuration.poll(NOW.wrapping_add(SILENT_AS_IT_IS_MS + 1), 1, None);
        // The clock wraps, and again shows the time of the receiver's last message.
        for waited in 0..10 {
            configuration.poll(NOW.wrapping_add(waited * ANSWER_MS), 1, None);
        }
        assert_eq!(configuration.standing(), Standing::NotYet, "it is asked on, not used as it is");
    }

    #[test]
    fn an_answer_to_the_bit_rate_ends_the_wait_for_it() {
        let mut configuration = Configuration::new(Interface::Uart, 125);
        assert!(configuration.poll(NOW, 0, None).is_some());
        let at = NOW.wrapping_add(LISTEN_MS);
        assert_eq!(keys(&configuration.poll(at, 0, None).unwrap()), [0x4052_0001]);
        assert!(configuration.poll(at.wrapping_add(1), 0, None).is_none());
        let basic = configuration.poll(at.wrapping_add(2), 1, Some(Answer::Taken)).unwrap();
        assert_eq!(keys(&basic)[0], 0x1074_0001);
        assert_eq!(configuration.standing(), Standing::NotYet);
    }

    #[test]
    fn each_standing_has_words_of_its_own() {
        let words = [Standing::NotYet, Standing::Taken, Standing::Refused, Standing::Unanswered, Standing::OtherModel]
            .map(|it| name(it as u32));
        let says = [
            ("not", "yet"),
            ("configured", "configured"),
            ("refuses", "as it is"),
            ("does not answer", "as it is"),
            ("configured", "its own dynamic model"),
        ];
        for (words, (first, then)) in words.into_iter().zip(says) {
            assert!(words.starts_with(first) && words.ends_with(then), "{words}");
        }
    }

    proptest! {
        #[test]
        fn configuration_messages_are_bounded_whatever_a_receiver_does(
            interface in prop_oneof![Just(Interface::Uart), Just(Interface::Ddc), Just(Interface::Spi)],
            steps in proptest::collection::vec((any::<bool>(), proptest::option::of(any::<bool>())), 1..2_000),
        ) {
            let mut talk = Talk::new(interface);
            let mut answers = 0;
            let mut heard_at = None;
            for (heard, answer) in steps {
                let answer = answer.map(|taken| if taken { Answer::Taken } else { Answer::Refused });
                answers += usize::from(answer.is_some());
                if heard || answer.is_some() {
                    heard_at = Some(talk.now.wrapping_add(10));
                }
                if let Some(message) = talk.step(heard, answer) {
                    prop_assert!(message.bytes().len() <= MESSAGE);
                    let recently = heard_at.is_some_and(|at| talk.now.wrapping_sub(at) < LISTEN_MS);
                    prop_assert!(!recently || message.rate() == Rate::Usual);
                    prop_assert!(interface == Interface::Uart || message.rate() == Rate::Usual);
                }
            }
            // HORUS sends one message for each answer, and without answers at most one in 200 ms.
            prop_assert!(talk.sent.len() <= 1 + answers + (talk.now.wrapping_sub(NOW) / BAUD_MS) as usize);
        }
    }
}
