//! Tests this crate against pymavlink, the library of MAVProxy and of most scripts. Each reads what the other sends,
//! plain and signed, in datagrams, in a stream and over sockets, among other messages and truncated ones. `peer.py` is
//! the program that uses pymavlink.

#[path = "../common/mod.rs"]
mod common;

use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use base_station::carrier::mavlink::standard::COMPONENT;
use base_station::carrier::mavlink::voice::{SYSTEM, State};
use base_station::carrier::mavlink::{Forwarder, Key, Rates, Receiver, Signer, Verifier, Voice, signing, tunnel};
use base_station::intake::Kind;
use base_station::live::{self, Clock, Time, lines};
use base_station::{Bundle, Place, Who};
use common::{Drawn, image, not_run};
use profile::criticality::{Dpr, Writer};
use profile::{PortStatus, PortValues, UplinkStatus};
use serde_json::{Value, json};

const SECOND: u64 = 1_000_000;

const NOW: u64 = 1_790_000_000 * SECOND;

const KEY: &str = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f";

struct Peer {
    child: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
}

impl Peer {
    fn start() -> Option<Self> {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let own = here.join("../target/pymavlink/bin/python").into_os_string();
        let named = std::env::var_os("PYMAVLINK_PYTHON");
        let has_it = |python: &std::ffi::OsString| {
            let mut command = Command::new(python);
            let asked = command.args(["-c", "import pymavlink"]).stderr(Stdio::null()).stdin(Stdio::null()).status();
            asked.is_ok_and(|status| status.success())
        };
        let Some(python) = named.into_iter().chain([own, "python3".into()]).find(has_it) else {
            let how = "python3 -m venv target/pymavlink && target/pymavlink/bin/pip install pymavlink==2.4.50; or say \
                       in PYMAVLINK_PYTHON which Python has it";
            not_run("no Python here has pymavlink", how);
            return None;
        };
        let mut command = Command::new(python);
        command.arg(here.join("tests/pymavlink/peer.py")).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let (to, from) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        Some(Self { child, to, from })
    }

    fn request(&mut self, request: &Value) {
        writeln!(self.to, "{request}").unwrap();
    }

    fn answer(&mut self) -> Value {
        let mut line = String::new();
        self.from.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line:?}"))
    }

    fn ask(&mut self, request: &Value) -> Value {
        self.request(request);
        self.answer()
    }

    /// Returns the messages that pymavlink finds in each piece of one stream. With `signed`, it accepts only those
    /// signed with the key.
    fn parse(&mut self, signed: bool, pieces: &[Vec<u8>]) -> Vec<Vec<Value>> {
        let pieces: Vec<String> = pieces.iter().map(|piece| hex(piece)).collect();
        let mut request = json!({ "do": "parse", "pieces": pieces });
        if signed {
            request["key"] = KEY.into();
            request["timestamp"] = signing::timestamp(NOW).into();
        }
        let answer = self.ask(&request);
        answer.as_array().unwrap().iter().map(|piece| piece.as_array().unwrap().clone()).collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // The process is killed, so that a failed test does not wait until the process ends by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect()
}

fn key() -> Key {
    Key::from_hex(KEY).unwrap()
}

fn forwarder(signed: bool, standard_us: u64) -> Forwarder {
    let forwarder = Forwarder::new(42, 1, Rates { bytes_per_s: 1_000_000, period_us: 0, standard_us });
    if signed { forwarder.signed(Signer::new(key(), 5)) } else { forwarder }
}

fn sent(forwarder: &mut Forwarder, cycles: u32) -> Vec<Vec<u8>> {
    let mut sent = vec![];
    for cycle in 0..cycles {
        forwarder.offer(&Bundle::datagram(&image(70_000 + 10 * cycle)).unwrap());
        let now_us = u64::from(cycle + 1) * SECOND;
        sent.extend(std::iter::from_fn(|| forwarder.poll(now_us, NOW + now_us)));
    }
    sent
}

fn payload(message: &Value) -> (u16, Vec<u8>) {
    let fields = &message["fields"];
    let length = fields["payload_length"].as_u64().unwrap() as usize;
    let all: Vec<u8> = fields["payload"]
        .as_array()
        .unwrap()
        .iter()
        .map(|byte| u8::try_from(byte.as_u64().unwrap()).unwrap())
        .collect();
    (u16::try_from(fields["payload_type"].as_u64().unwrap()).unwrap(), all[..length].to_vec())
}

fn expected(image: &[u8]) -> Vec<(u16, Vec<u8>)> {
    let gps =
        |first: u8, from: usize, to: usize| (tunnel::payload_type(Place::Gps(first)).unwrap(), image[from..to].into());
    let link = (tunnel::payload_type(Place::LinkStatus).unwrap(), image[..96].to_vec());
    vec![link, gps(1, 96, 216), gps(3, 216, 276)]
}

#[test]
fn pymavlink_reads_what_is_sent_here_plain_and_signed() {
    let Some(mut peer) = Peer::start() else { return };
    for signed in [false, true] {
        let frames = sent(&mut forwarder(signed, SECOND), 20);
        let read: Vec<Value> = peer.parse(signed, &frames).into_iter().flatten().collect();
        assert_eq!(read.len(), frames.len(), "each is one message");
        assert!(read.iter().all(|message| message["system"] == 42 && message["signed"] == signed));
        let (ours, standard): (Vec<_>, Vec<_>) = read.iter().partition(|message| message["name"] == "TUNNEL");
        let tunnels: Vec<_> = ours.iter().map(|message| payload(message)).collect();
        let all: Vec<_> = (0..20).flat_map(|cycle| expected(&image(70_000 + 10 * cycle))).collect();
        assert_eq!(tunnels, all);
        assert!(ours.iter().all(|message| message["component"] == 1));
        for (nth, messages) in standard.chunks(3).enumerate() {
            let names: Vec<_> = messages.iter().map(|message| message["name"].as_str().unwrap()).collect();
            assert_eq!(names, ["HEARTBEAT", "GPS_RAW_INT", "ATTITUDE"]);
            assert!(messages.iter().all(|message| message["component"] == COMPONENT));
            let [heartbeat, raw, attitude] = [0, 1, 2].map(|index: usize| &messages[index]["fields"]);
            let time = 70_000 + 10 * nth as u64;
            assert_eq!((&heartbeat["type"], &heartbeat["system_status"]), (&json!(18), &json!(4)), "active");
            let latitude = ((47.497_9 + (time % 60_000) as f64 * 1e-8) * 1e7_f64).round() as i64;
            assert_eq!((&raw["lat"], &raw["lon"]), (&json!(latitude), &json!(87_289_000)));
            assert_eq!((&raw["time_usec"], &raw["fix_type"]), (&json!(time * 1_000), &json!(3)));
            assert!((attitude["yaw"].as_f64().unwrap() - 1.25).abs() < 1e-6);
        }
        assert_eq!(standard.len(), 60);
    }
    // If signatures are required, pymavlink must refuse unsigned messages, those signed with another key, and repeated
    // ones.
    let refused = |peer: &mut Peer, frames: &[Vec<u8>]| peer.parse(true, frames).iter().flatten().count();
    assert_eq!(refused(&mut peer, &sent(&mut forwarder(false, 0), 3)), 0);
    let other = Signer::new(Key::new([7; 32]), 5);
    assert_eq!(refused(&mut peer, &sent(&mut forwarder(false, 0).signed(other), 3)), 0);
    let frames = sent(&mut forwarder(true, 0), 1);
    assert_eq!(refused(&mut peer, &[frames.clone(), frames].concat()), 3);
}

#[test]
fn every_object_that_pymavlink_sends_is_received_plain_and_signed() {
    let Some(mut peer) = Peer::start() else { return };
    for signed in [false, true] {
        let objects: Vec<_> = (0..20).flat_map(|cycle| expected(&image(70_000 + 10 * cycle))).collect();
        let given: Vec<_> = objects.iter().map(|(kind, from)| json!({ "type": kind, "bytes": hex(from) })).collect();
        let mut request = json!({ "do": "send", "objects": given });
        if signed {
            request["key"] = KEY.into();
            request["timestamp"] = signing::timestamp(NOW).into();
        }
        let answer = peer.ask(&request);
        let frames: Vec<(bool, Vec<u8>)> = answer
            .as_array()
            .unwrap()
            .iter()
            .map(|frame| (frame["name"] == "ours", bytes(frame["bytes"].as_str().unwrap())))
            .collect();
        assert_eq!(frames.len(), objects.len() * 9);
        let verifier = || signed.then(|| Verifier::new(key()));
        let unpack = |received: &[base_station::carrier::mavlink::Received]| -> Vec<Vec<u8>> {
            assert!(received.iter().all(|received| (received.system, received.component) == (42, 1)));
            received.iter().map(|received| received.bundle().unwrap().bytes().to_vec()).collect()
        };
        let all: Vec<Vec<u8>> = objects.iter().map(|(_, bytes)| bytes.clone()).collect();

        let mut receiver = Receiver::new(verifier());
        let mut received = vec![];
        for (nth, (ours, frame)) in frames.iter().enumerate() {
            let arrived = receiver.datagram(NOW, frame);
            assert_eq!(arrived.len(), usize::from(*ours));
            received.extend(arrived);
            assert_eq!(receiver.datagram(NOW, &frame[..nth % frame.len()]), [], "cut off");
        }
        assert!(unpack(&received) == all, "{} of {}", received.len(), all.len());
        assert_eq!(receiver.counts().tunnels, objects.len() as u64);
        let other = receiver.counts().foreign + receiver.counts().malformed;
        assert_eq!(other, objects.len() as u64 * 7, "MAVLink 1 is not looked at");

        let mut drawn = Drawn(1);
        let mut line = vec![];
        for (nth, (_, frame)) in frames.iter().enumerate() {
            if nth % 5 == 0 {
                line.extend((0..drawn.below(40)).map(|_| drawn.next() as u8));
            }
            if nth % 11 == 0 {
                line.extend(&frame[..drawn.below(frame.len() as u64) as usize]);
            }
            line.extend(frame);
        }
        line.extend([0; 600]);
        let mut receiver = Receiver::new(verifier());
        let (mut received, mut rest) = (vec![], &line[..]);
        while !rest.is_empty() {
            let (now, later) = rest.split_at(rest.len().min(1 + drawn.below(300) as usize));
            received.extend(receiver.stream(NOW, now));
            rest = later;
        }
        assert!(unpack(&received) == all, "{} of {}", received.len(), all.len());

        if signed {
            let mut receiver = Receiver::new(Some(Verifier::new(Key::new([7; 32]))));
            assert!(frames.iter().all(|(_, frame)| receiver.datagram(NOW, frame).is_empty()));
            assert_eq!(receiver.counts().unsigned, objects.len() as u64);
        }
    }
}

#[test]
fn every_object_pymavlink_reads_from_a_damaged_stream_is_read_here_too() {
    let Some(mut peer) = Peer::start() else { return };
    let frames = sent(&mut forwarder(false, SECOND), 200);
    let mut drawn = Drawn(2);
    let mut line = vec![];
    for frame in &frames {
        match drawn.below(6) {
            0 => {
                let mut frame = frame.clone();
                let bit = drawn.below(frame.len() as u64 * 8) as usize;
                frame[bit / 8] ^= 1 << (bit % 8);
                line.extend(frame);
            }
            1 => line.extend(&frame[..drawn.below(frame.len() as u64) as usize]),
            2 => {
                line.extend((0..drawn.below(60)).map(|_| drawn.next() as u8));
                line.extend(frame);
            }
            3 => {}
            _ => line.extend(frame),
        }
    }
    line.extend([0; 600]);
    let here: Vec<Vec<u8>> = Receiver::default()
        .stream(NOW, &line)
        .iter()
        .map(|received| received.bundle().unwrap().bytes().to_vec())
        .collect();
    let read = peer.parse(false, &[line]);
    let there: Vec<Vec<u8>> =
        read.iter().flatten().filter(|message| message["name"] == "TUNNEL").map(|message| payload(message).1).collect();
    // pymavlink takes damaged bytes for a message, and loses the messages that begin within those bytes.
    let mut rest = here.iter();
    assert!(there.iter().all(|object| rest.any(|other| other == object)), "in order, each is among those read here");
    assert!(there.len() > 100 && here.len() >= there.len(), "{} there, {} here", there.len(), here.len());
}

#[test]
fn pymavlink_and_a_station_hear_each_other_over_udp() {
    let Some(mut peer) = Peer::start() else { return };
    let port = peer.ask(&json!({ "do": "listen" })).as_u64().unwrap();
    let frames = sent(&mut forwarder(false, SECOND), 5);
    peer.request(&json!({ "do": "hear", "count": frames.len() }));
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for frame in &frames {
        socket.send_to(frame, format!("127.0.0.1:{port}")).unwrap();
    }
    let heard = peer.answer();
    let tunnels = heard.as_array().unwrap().iter().filter(|message| message["name"] == "TUNNEL");
    let expected_of = |cycles: u32| (0..cycles).flat_map(|cycle| expected(&image(70_000 + 10 * cycle)));
    assert_eq!(tunnels.map(payload).collect::<Vec<_>>(), expected_of(5).collect::<Vec<_>>());

    let clock = Clock::begin();
    let (inlet, station, ended) = live::start(None, None, Time::Clock(clock.clone()), |_, _| {});
    let bound = lines::udp("127.0.0.1:0".parse().unwrap(), Kind::MavlinkDatagrams, 0, clock, inlet.clone()).unwrap();
    let objects: Vec<_> = expected_of(5).map(|(kind, from)| json!({ "type": kind, "bytes": hex(&from) })).collect();
    assert_eq!(peer.ask(&json!({ "do": "forward", "port": bound.port(), "objects": objects })), json!(15));
    let shown = || {
        let known = station.known();
        let drone = known.intake.fleet().iter().next();
        drone.map(|(id, drone)| (id.to_string(), drone.timestamp(), drone.counts().new))
    };
    // Reported-Position comes before the GPS objects of its cycle. So the test waits until all objects have come.
    let began = Instant::now();
    while shown() != Some(("42".into(), Some(70_040), 5 * 5)) {
        assert!(began.elapsed() < Duration::from_secs(20), "arrived is {:?}", shown());
        std::thread::sleep(Duration::from_millis(5));
    }
    inlet.close();
    ended.join().unwrap().unwrap();
}

#[test]
fn an_autopilot_sends_to_a_station_once_it_receives_its_heartbeat() {
    let Some(mut peer) = Peer::start() else { return };
    let port = peer.ask(&json!({ "do": "autopilot", "key": KEY })).as_u64().unwrap();
    let clock = Clock::begin();
    let verifier = Some(Verifier::new(key()));
    let (inlet, station, ended) = live::start(verifier, None, Time::Clock(clock.clone()), |_, _| {});
    let local = "127.0.0.1:0".parse().unwrap();
    lines::udp(local, Kind::MavlinkDatagrams, 0, clock.clone(), inlet.clone()).unwrap();
    let objects: Vec<_> =
        expected(&image(70_000)).into_iter().map(|(kind, from)| json!({ "type": kind, "bytes": hex(&from) })).collect();
    let is_active = |seconds: f64| json!({ "do": "is_active", "seconds": seconds, "objects": objects });

    // pymavlink does not know a station that only listens, and so sends nothing to it.
    assert_eq!(peer.ask(&is_active(1.5)), Value::Null);
    assert_eq!(station.known().intake.fleet().iter().len(), 0);

    let to = format!("127.0.0.1:{port}").parse().unwrap();
    let voice = Voice::new(SYSTEM, Some(Signer::new(key(), 254)));
    station.speak(voice.with_heartbeat(vec![to]).with_uplinks());
    let heard = peer.ask(&is_active(20.0));
    let who = (&heard["system"], &heard["signed"], &heard["version"], &heard["fields"]["type"]);
    assert_eq!(who, (&json!(SYSTEM), &json!(true), &json!(2), &json!(18)), "{heard}");
    let wait = |what: &str, is_so: &dyn Fn(&live::StationData) -> bool| {
        let began = Instant::now();
        while !is_so(&station.known()) {
            assert!(began.elapsed() < Duration::from_secs(20), "never {what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    let drone = Who::System(42).first();
    wait("heard", &|known| known.intake.fleet().get(drone).is_some_and(|drone| drone.counts().new == 5));

    let (status, payload) = (UplinkStatus::from_bits(0x1234), std::array::from_fn(|at| at as u8));
    let sent = {
        let mut known = station.known();
        let live::StationData { voice, intake, .. } = &mut *known;
        voice.as_mut().unwrap().send(clock.now_us(), intake.fleet(), drone, status, payload).unwrap()
    };
    let answer = PortStatus::seal(Writer::<Dpr>::claim(), &PortValues { timestamp: 70_100, ..PortValues::default() });
    let taken = peer.ask(&json!({ "do": "uplink", "port": hex(answer.as_bytes()) }));
    let fields = &taken["fields"];
    assert_eq!((&taken["system"], &taken["signed"]), (&json!(SYSTEM), &json!(true)), "{taken}");
    let (kind, length) = (&fields["payload_type"], &fields["payload_length"]);
    assert_eq!((kind, length, &fields["target_system"]), (&json!(0xC200), &json!(64), &json!(42)), "{taken}");
    wait("written", &|known| {
        let sending = known.voice.as_ref().and_then(|voice| voice.sending(drone));
        sending.is_some_and(|sending| sending.state == State::Written && sending.uplink.timestamp() == sent)
    });
    inlet.close();
    ended.join().unwrap().unwrap();
}
