//! Tapes: a flight controller's actions and the DPR's answers, which a test plays to the client in Rust and in C.
//!
//! A tape is a row of steps; all numbers are little-endian. The client writes one line for each step, and several for a
//! view of the read objects; `profile/c/tests/tape.c` writes the same lines for the C client. Any bytes are a tape; the
//! tape ends at the first incomplete step.
//!
//! | first byte, modulo 10 | step | what follows it |
//! |---|---|---|
//! | 0 | a new client | u8 receivers, +0x80 with a hold; u16 bytes to read, u32 age limit, u32 silence, µs |
//! | 1 | requests a window | u16 offset, u16 length |
//! | 2 | writes an object | 64 bytes |
//! | 3 | a transaction | u64 began, u64 FRESH, µs; u16 count; that many bytes of MISO, at most 1024 |
//! | 4 | views every object of the last transaction | |
//! | 5 | seals a command and writes it | u32 timestamp, u8: odd for a self-test |
//! | 6 | seals an uplink and writes it | u32 timestamp, u16 status, 52 bytes |
//! | 7 | sends a command to the hold | u8: modulo 4 set-point, lock, unlock, clear the shock; f32 set-point |
//! | 8 | gives that command up | |
//! | 9 | seals an uplink with that command and writes it | u32 timestamp, u16 status, 52 bytes |
//!
//! A client with a hold writes one line more after each transaction and in each view.
use std::fmt::Write as _;

use profile::criticality::{BaseStation, FlightController, Writer};
use profile::hold::{Sender, Sent};
use profile::ssi::Request;
use profile::ssi::client::{Client, Config, HoldReport, HoldTrack, MAX_MAP, MAX_WRITE, Report, Shown, View};
use profile::uplink::Written;
use profile::{
    Command, CommandObject, HoldCommand, HoldStatus, HoldValues, Layout, LinkStatus, LinkValues, Object, PortStatus,
    Rejection, ReportedValues, Uplink, UplinkStatus, UplinkValues, Violation,
};

const MAX_MISO: usize = 1024;

/// The bit that says that the DPR has a hold, in the tape's byte with the number of receivers.
const WITH_HOLD: u8 = 0x80;

/// The instant of FRESH where that line is not wired. It lies in the future, so the client ignores it.
pub(crate) const NO_FRESH: u64 = u64::MAX;

#[derive(Clone, Debug, Default)]
pub(crate) struct Tape(pub(crate) Vec<u8>);

impl Tape {
    fn step(&mut self, kind: u8, parts: &[&[u8]]) {
        self.0.push(kind);
        parts.iter().for_each(|part| self.0.extend_from_slice(part));
    }

    pub(crate) fn config(&mut self, receivers: u8, config: &Config) {
        let Config { layout, read_bytes, age_limit_us, silence_us } = config;
        let receivers = if layout.hold().is_some() { receivers | WITH_HOLD } else { receivers };
        let (age, silence) = (age_limit_us.to_le_bytes(), silence_us.to_le_bytes());
        self.step(0, &[&[receivers], &read_bytes.to_le_bytes(), &age, &silence]);
    }

    pub(crate) fn ask(&mut self, offset: u16, length: u16) {
        self.step(1, &[&offset.to_le_bytes(), &length.to_le_bytes()]);
    }

    pub(crate) fn write(&mut self, object: &[u8; 64]) {
        self.step(2, &[object]);
    }

    pub(crate) fn transaction(&mut self, began_us: u64, fresh_us: u64, miso: &[u8]) {
        let count = u16::try_from(miso.len()).expect("a short transaction").to_le_bytes();
        self.step(3, &[&began_us.to_le_bytes(), &fresh_us.to_le_bytes(), &count, miso]);
    }

    pub(crate) fn view(&mut self) {
        self.step(4, &[]);
    }

    pub(crate) fn command(&mut self, timestamp: u32, which: u8) {
        self.step(5, &[&timestamp.to_le_bytes(), &[which]]);
    }

    pub(crate) fn uplink(&mut self, timestamp: u32, status: u16, payload: &[u8; 52]) {
        self.step(6, &[&timestamp.to_le_bytes(), &status.to_le_bytes(), payload]);
    }

    pub(crate) fn send(&mut self, which: u8, set_point: f32) {
        self.step(7, &[&[which], &set_point.to_le_bytes()]);
    }

    pub(crate) fn give_up(&mut self) {
        self.step(8, &[]);
    }

    pub(crate) fn commanding(&mut self, timestamp: u32, status: u16, payload: &[u8; 52]) {
        self.step(9, &[&timestamp.to_le_bytes(), &status.to_le_bytes(), payload]);
    }
}

struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count).unwrap_or((&[], &[]));
        self.0 = rest;
        (taken.len() == count).then_some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N).and_then(|bytes| bytes.try_into().ok())
    }
}

fn code<T>(result: Result<T, Rejection>) -> u8 {
    match result {
        Ok(_) => 0,
        Err(Rejection::Length) => 2,
        Err(Rejection::Crc) => 3,
        Err(Rejection::PositionCrc) => 4,
        Err(Rejection::Identifier) => 5,
        Err(Rejection::Window) => 6,
        Err(Rejection::Command) => 7,
        Err(_) => unreachable!("a rejection without a number"),
    }
}

/// Returns the C client's number for the state of an object that was read, and the object if it is intact.
fn shown<T>(shown: Option<Shown<T>>) -> (u8, Option<T>) {
    match shown {
        None => (code::<()>(Err(Rejection::Length)), None),
        Some(Shown::Intact(object)) => (0, Some(object)),
        Some(Shown::Vacant) => (1, None),
        Some(Shown::Damaged(why)) => (code::<()>(Err(why)), None),
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn sample(timestamp: u32, status: u16, position: [f64; 3], attitude: [f32; 3], acceleration: [f32; 3]) -> String {
    let mut text = format!(" t={timestamp} s={status:04x}");
    position.iter().for_each(|value| write!(text, " {:016x}", value.to_bits()).expect("written"));
    attitude.iter().chain(&acceleration).for_each(|value| write!(text, " {:08x}", value.to_bits()).expect("written"));
    text
}

fn reported(values: &ReportedValues) -> String {
    let ReportedValues { timestamp, status, latitude, longitude, altitude, pitch, yaw, roll, acceleration } = *values;
    sample(timestamp, status.bits(), [latitude, longitude, altitude], [pitch, yaw, roll], acceleration)
}

fn link(values: &LinkValues) -> String {
    format!(
        " t={} s={:04x} {} {} {} {} {} {}",
        values.timestamp,
        values.status.bits(),
        values.objects_accepted,
        values.objects_rejected,
        values.frames_received,
        values.frames_missed,
        values.age_100us,
        values.access_violations
    )
}

fn report(said: &Report) -> String {
    let mut text = format!("end {} age={}", said.verdict as u8, said.age_us);
    if let Some(status) = &said.status {
        text += &format!(" status {:04x}", status.bits());
    }
    if let Some(position) = &said.position {
        text += &format!(" position{}", reported(position));
    }
    if let Some(values) = &said.link {
        text += &format!(" link{}", link(values));
    }
    text
}

fn hold(values: &HoldValues) -> String {
    let HoldValues { temperature, humidity, set_point, vibration: [x, y, z], greatest_shock, supply, output, .. } =
        *values;
    let mut text = format!(" t={} s={:04x}", values.timestamp, values.status.bits());
    for value in [temperature, humidity, set_point, x, y, z, greatest_shock, supply, output] {
        text += &format!(" {:08x}", value.to_bits());
    }
    values.acknowledged.iter().for_each(|one| text += &format!(" {}:{}", one.number(), one.code()));
    text + &format!(" {}", values.seconds)
}

fn hold_report(said: &HoldReport, sent: Sent) -> String {
    let (sent, number, outcome) = match sent {
        Sent::Nothing => (0, 0, 0),
        Sent::Waiting(number) => (1, number, 0),
        Sent::Answered(number, outcome) => (2, number, outcome.code()),
        Sent::Lost(number) => (3, number, 0),
    };
    let values = said.values.as_ref().map_or(String::new(), hold);
    format!("hold {} age={}{values} sent {sent} {number} {outcome}\n", said.shown as u8, said.age_us)
}

fn view(view: &View<'_>, has_hold: bool) -> String {
    let (result, object) = shown(view.link());
    let mut text = format!("link {result}{}\n", object.map(LinkStatus::values).as_ref().map_or(String::new(), link));
    for index in 0..=6 {
        let (result, object) = shown(view.object(index));
        let values = object.map_or(String::new(), |object| match object {
            Object::Reported(object) => reported(&object.values()),
            Object::Gps(object) => {
                let v = object.values();
                let (position, attitude) = ([v.latitude, v.longitude, v.altitude], [v.pitch, v.yaw, v.roll]);
                sample(v.timestamp, v.status.bits(), position, attitude, v.acceleration)
                    + &v.status.solution_age_ms().map_or(" never".to_owned(), |ms| format!(" {ms} ms"))
            }
        });
        text += &format!("object {index} {result}{values}\n");
    }
    let (result, object) = shown(view.port_status());
    text += &format!("port {result}");
    if let Some(v) = object.map(PortStatus::values) {
        text += &format!(
            " t={} s={:04x} {} {} {} {:08x} {} {}",
            v.timestamp,
            v.status.bits(),
            v.uplinks_accepted,
            v.commands_carried_out,
            v.last_command_timestamp,
            v.last_command,
            v.base_station_age_ms,
            v.flight_controller_age_ms
        );
        Violation::ALL.iter().for_each(|kind| text += &format!(" {}", v.violations.of(*kind)));
        text += &format!(
            " {} {} {} {} {}",
            v.integrity_faults, v.flash_passes, v.stuck_bits, v.buffers_out_of_use, v.last_stop
        );
    }
    text += "\n";
    for uplink in [view.uplink::<BaseStation>(), view.uplink::<FlightController>()] {
        let (result, object) = shown(uplink);
        let values = object
            .map(Uplink::values)
            .map_or(String::new(), |v| format!(" t={} s={:04x} {}", v.timestamp, v.status.bits(), hex(&v.payload)));
        text += &format!("uplink {result}{values}\n");
    }
    if has_hold {
        let (result, object) = shown(view.hold());
        text += &format!("hold {result}{}\n", object.map(HoldStatus::values).as_ref().map_or(String::new(), hold));
    }
    text
}

#[derive(Default)]
struct Hold {
    track: HoldTrack,
    sender: Sender<FlightController>,
}

pub(crate) struct TransactionData<'a> {
    pub(crate) began_us: u64,
    pub(crate) config: Config,
    pub(crate) report: &'a Report,
}

/// Plays a tape to the Rust client, and returns the client's output. `told` is called with each transaction.
pub(crate) fn play(tape: &[u8], mut told: impl FnMut(TransactionData<'_>)) -> String {
    let mut rest = Rest(tape);
    let mut client = Client::new(Config::new(Layout::for_receivers(3).expect("three receivers"))).expect("a client");
    let mut hold = Hold::default();
    let mut miso: &[u8] = &[];
    let mut text = String::new();
    while let Some([kind]) = rest.array() {
        let said = match kind % 10 {
            0 => rest.array::<11>().map(|[receivers, b0, b1, a0, a1, a2, a3, s0, s1, s2, s3]| {
                let layout = Layout::for_receivers((receivers & !WITH_HOLD).into()).ok_or(Rejection::Window);
                let made = layout.and_then(|layout| {
                    Client::new(Config {
                        layout: if receivers & WITH_HOLD == 0 { layout } else { layout.with_hold() },
                        read_bytes: u16::from_le_bytes([b0, b1]),
                        age_limit_us: u32::from_le_bytes([a0, a1, a2, a3]),
                        silence_us: u32::from_le_bytes([s0, s1, s2, s3]),
                    })
                });
                let result = code(made.as_ref().map_err(|why| *why));
                if let Ok(made) = made {
                    (client, hold, miso) = (made, Hold::default(), &[]);
                }
                format!("config {result}\n")
            }),
            1 => rest.array().map(|[o0, o1, l0, l1]| {
                let window = Request { offset: u16::from_le_bytes([o0, o1]), length: u16::from_le_bytes([l0, l1]) };
                format!("ask {}\n", code(client.ask(window)))
            }),
            2 => rest.take(64).map(|bytes| {
                let written = Written::verify(bytes);
                if let Ok(written) = written {
                    client.write(written);
                }
                format!("write {}\n", code(written))
            }),
            3 => transaction(&mut rest, &mut client, &mut hold, &mut miso, &mut told),
            4 => Some(view(&client.view(miso), client.config().layout.hold().is_some())),
            5 => rest.array().map(|[t0, t1, t2, t3, which]| {
                let command = if which % 2 == 0 { Command::ClearCounters } else { Command::SelfTest };
                let timestamp = u32::from_le_bytes([t0, t1, t2, t3]);
                let object = CommandObject::seal(Writer::<FlightController>::claim(), timestamp, command);
                client.write(Written::Command(command, &object));
                format!("command 0 {}\n", hex(object.as_bytes()))
            }),
            7 => rest.array().map(|[which, v0, v1, v2, v3]| {
                let command = match which % 4 {
                    0 => HoldCommand::SetPoint(f32::from_le_bytes([v0, v1, v2, v3])),
                    1 => HoldCommand::Lock,
                    2 => HoldCommand::Unlock,
                    _ => HoldCommand::ClearShock,
                };
                hold.sender.send(&command).map_or("send none\n".to_owned(), |number| format!("send {number}\n"))
            }),
            8 => {
                hold.sender.give_up();
                Some("give up\n".to_owned())
            }
            kind => rest.array::<58>().map(|bytes| {
                let ([t0, t1, t2, t3, s0, s1], payload) = bytes.split_first_chunk().expect("58 bytes");
                let mut values = UplinkValues {
                    timestamp: u32::from_le_bytes([*t0, *t1, *t2, *t3]),
                    status: UplinkStatus::from_bits(u16::from_le_bytes([*s0, *s1])),
                    payload: payload.try_into().expect("52 bytes"),
                };
                if kind == 9 {
                    hold.sender.fill(&mut values.payload);
                }
                let object = Uplink::seal(Writer::<FlightController>::claim(), &values);
                client.write(Written::FlightController(&object));
                format!("own 0 {}\n", hex(object.as_bytes()))
            }),
        };
        text += &said.unwrap_or_default();
    }
    text
}

fn transaction<'a>(
    rest: &mut Rest<'a>,
    client: &mut Client,
    hold: &mut Hold,
    miso: &mut &'a [u8],
    told: &mut impl FnMut(TransactionData<'_>),
) -> Option<String> {
    *miso = &[];
    let head = rest.array::<18>()?;
    let number = |at: usize| u64::from_le_bytes(head[at..at + 8].try_into().expect("eight bytes"));
    let (began_us, fresh_us) = (number(0), number(8));
    let count = usize::from(u16::from_le_bytes([head[16], head[17]]));
    let brought = rest.take(count);
    let mut mosi = [0xA5; MAX_MAP];
    assert_eq!(client.begin(&mut mosi[..7]), Err(Rejection::Length), "a buffer that is too short changes nothing");
    let bytes = client.begin(&mut mosi).expect("room for the longest transaction");
    let Some(brought) = brought.filter(|brought| brought.len() <= MAX_MISO) else {
        rest.0 = &[];
        return None;
    };
    assert!(mosi[bytes.min(MAX_WRITE)..bytes].iter().all(|byte| *byte == 0), "nothing is driven behind an object");
    let said = client.end(brought, began_us, Some(fresh_us));
    *miso = brought;
    told(TransactionData { began_us, config: *client.config(), report: &said });
    let mut text = format!("begin {bytes} {}\n{}\n", hex(&mosi[..bytes.min(MAX_WRITE)]), report(&said));
    if client.config().layout.hold().is_some() {
        let view = client.view(brought);
        if let Some(Shown::Intact(status)) = view.hold() {
            hold.sender.observe(status.as_object());
        }
        text += &hold_report(&hold.track.read(&view, began_us), hold.sender.sent());
    }
    Some(text)
}
