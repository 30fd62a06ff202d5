use mavlink::dialects::common::HEARTBEAT_DATA;
use mavlink::{MavlinkVersion, MessageData};
use profile::criticality::{Dpr, FlightController};
use profile::{GpsValues, LinkStatus, LinkValues, PortStatus, PortStatusBits, PortValues, Profile, ReportedValues};

use super::super::inbound::{self, Inbound};
use super::super::{Forwarder, Key, Rates, Receiver, Verifier};
use super::*;
use crate::intake::{Carried, Intake, Kind};

const NOW: u64 = 1_790_000_000_000_000;
const SECOND: u64 = 1_000_000;
const STEP: u64 = 10_000;
const DRONE: &str = "10.0.0.7:14555";

fn key() -> Key {
    Key::new([9; 32])
}

struct Scene {
    now: u64,
    intake: Intake,
    voice: Voice,
    forwarder: Forwarder,
    inbound: Inbound,
    /// The uplink that the model of the DPR has stored, and the instant, µs, until which the DPR shows it.
    stored: Option<(Uplink, u64)>,
    port: PortValues,
    /// The uplinks that were written over the SSI, each with the instant, µs, from which on the DPR shows it.
    writes: Vec<(Uplink, u64)>,
    loss: u64,
    drawn: u64,
}

impl Scene {
    fn new(loss: u64, seed: u64) -> Self {
        let rates = Rates { bytes_per_s: 6_000, ..Rates::default() };
        let mut scene = Self {
            now: NOW,
            intake: Intake::new(Some(Verifier::new(key()))),
            voice: Voice::new(SYSTEM, Some(Signer::new(key(), 254))).with_uplinks(),
            forwarder: Forwarder::new(7, 1, rates).signed(Signer::new(key(), 1)),
            inbound: Inbound::new(7, Verifier::new(key())),
            stored: None,
            port: PortValues::default(),
            writes: vec![],
            loss: 0,
            drawn: seed | 1,
        };
        scene.fly(SECOND);
        scene.loss = loss;
        scene
    }

    fn is_lost(&mut self) -> bool {
        self.drawn ^= self.drawn << 13;
        self.drawn ^= self.drawn >> 7;
        self.drawn ^= self.drawn << 17;
        self.drawn % 100 < self.loss
    }

    fn drone(&self) -> DroneId {
        self.intake.fleet().iter().next().unwrap().0
    }

    fn send(&mut self, payload: u8) -> u32 {
        let drone = self.drone();
        let status = UplinkStatus::from_bits(3);
        self.voice.send(self.now, self.intake.fleet(), drone, status, [payload; Uplink::PAYLOAD]).unwrap()
    }

    fn state(&self) -> State {
        self.voice.sending(self.drone()).unwrap().state.clone()
    }

    fn fly(&mut self, span_us: u64) {
        let end = self.now + span_us;
        while self.now < end {
            self.now += STEP;
            self.step();
        }
    }

    fn step(&mut self) {
        let ms = ((self.now - NOW) / 1_000) as u32 + 50_000;
        for (uplink, at) in std::mem::take(&mut self.writes) {
            if at > self.now {
                self.writes.push((uplink, at));
                continue;
            }
            let newer = |(stored, _): &(Uplink, u64)| uplink.timestamp().wrapping_sub(stored.timestamp()) as i32 > 0;
            let is_stored = self.stored.as_ref().is_none_or(newer);
            self.port.status = PortStatusBits::new().with_last_refused(!is_stored);
            if is_stored {
                self.stored = Some((uplink, self.now + 500_000));
                self.port.uplinks_accepted += 1;
            } else {
                self.port.violations.count(Violation::UplinkNotNewer, 1);
            }
        }
        self.port.timestamp = ms;
        let profile = Profile::<1>::seal(&ReportedValues::absent(ms), &[GpsValues::absent(ms)]);
        let link = LinkStatus::seal(&LinkValues { timestamp: ms, ..LinkValues::default() });
        let image = [link.as_bytes(), profile.as_bytes()].concat();
        self.forwarder.offer(&Bundle::datagram(&image).unwrap());
        if self.inbound.reads_port() {
            let port = PortStatus::seal(Writer::<Dpr>::claim(), &self.port);
            let shown = self.stored.filter(|(_, until)| *until > self.now).map(|(uplink, _)| *uplink.as_bytes());
            let port = [port.as_bytes().as_slice(), &shown.unwrap_or([0; Uplink::SIZE])].concat();
            if self.inbound.read(self.now, &port) {
                self.forwarder.offer(&Bundle::new(Place::PortStatus, 2, &port).unwrap());
            }
        }
        while let Some(bytes) = self.forwarder.poll(self.now, self.now) {
            if !self.is_lost() {
                let (at_us, kind, from) = (self.now, Kind::MavlinkDatagrams, DRONE.into());
                self.intake.take(&Carried { at_us, kind, line: 3, from, bytes });
            }
        }
        for (to, bytes) in self.voice.tick(self.now, self.intake.fleet()) {
            assert_eq!(to, To { line: Some(3), address: Some(DRONE.parse().unwrap()) });
            if !self.is_lost()
                && let Some(uplink) = self.inbound.datagram(self.now, self.now, &bytes)
            {
                self.writes.push((uplink, self.now + 2 * STEP));
            }
        }
    }
}

#[test]
fn an_uplink_is_written_once_and_shown_as_written_whatever_is_lost() {
    for seed in 1..100 {
        let mut scene = Scene::new(40, seed * 0x9E37_79B9);
        for payload in 1..4 {
            let timestamp = scene.send(payload);
            assert_eq!(scene.state(), State::Sent);
            scene.fly(GIVES_UP_US + SECOND);
            assert_eq!(scene.state(), State::Written, "seed {seed}");
            let values = scene.stored.unwrap().0.values();
            assert_eq!((values.timestamp, values.payload[51], values.status.bits()), (timestamp, payload, 3));
            assert_eq!(scene.port.uplinks_accepted, u32::from(payload), "seed {seed}");
        }
    }
}

#[test]
fn without_loss_it_is_sent_once_or_twice_and_then_no_more() {
    let mut scene = Scene::new(0, 1);
    scene.send(1);
    scene.fly(10 * SECOND);
    let drone = scene.drone();
    let sending = scene.voice.sending(drone).unwrap();
    assert!(sending.times <= 2 && sending.at_us - sending.since_us < 300_000, "{sending:?}");
    assert_eq!((scene.inbound.counts().written, scene.port.violations.total()), (1, 0));
}

#[test]
fn what_the_dpr_does_not_store_is_refused_and_why_is_said() {
    for loss in [0, 30] {
        let mut scene = Scene::new(loss, 77);
        // The DPR has stored an uplink of another station, whose clock is ahead.
        let values = UplinkValues { timestamp: (NOW / 1_000) as u32 + 3_600_000, ..UplinkValues::default() };
        scene.stored = Some((Uplink::seal(Writer::<BaseStation>::claim(), &values), scene.now));
        scene.send(1);
        scene.fly(ANSWERS_US);
        assert_eq!(scene.state(), State::Sent, "an answer to an earlier one may be under way");
        scene.fly(GIVES_UP_US);
        assert_eq!(scene.state(), State::Refused("it is not newer than the one that the DPR had".into()));
    }
}

#[test]
fn an_uplink_that_nobody_answers_is_said_to_be_unanswered() {
    let mut scene = Scene::new(0, 1);
    scene.loss = 100;
    scene.send(1);
    scene.fly(GIVES_UP_US);
    assert_eq!(scene.state(), State::Sent);
    scene.fly(SECOND);
    let sending = scene.voice.sending(scene.drone()).unwrap().clone();
    assert_eq!((sending.state, sending.times), (State::Unanswered, 20));
    assert!(scene.voice.tick(scene.now + SECOND, scene.intake.fleet()).is_empty());
}

// Shows GND-9.
#[test]
fn who_may_not_sends_no_uplink() {
    let mut scene = Scene::new(0, 1);
    let (drone, fleet, status) = (scene.drone(), scene.intake.fleet(), UplinkStatus::default());
    let try_by = |voice: &mut Voice, drone| voice.send(NOW, fleet, drone, status, [0; 52]).map(|_| ());
    let mut silent = Voice::new(SYSTEM, Some(Signer::new(key(), 1)));
    assert_eq!(try_by(&mut silent, drone), Err(NotSent::NotAllowed));
    let mut unsigned = Voice::new(SYSTEM, None).with_uplinks();
    assert_eq!((try_by(&mut unsigned, drone), unsigned.sends_uplinks()), (Err(NotSent::NotAllowed), false));
    assert_eq!(try_by(&mut scene.voice, Who::System(8).first()), Err(NotSent::UnknownDrone));
    assert!(unsigned.tick(NOW + SECOND, fleet).is_empty() && silent.tick(NOW + SECOND, fleet).is_empty());
    let mut plain = Intake::default();
    let bytes = Profile::<1>::seal(&ReportedValues::absent(10), &[GpsValues::absent(10)]).as_bytes().to_vec();
    plain.take(&Carried { at_us: NOW, kind: Kind::Datagrams, line: 0, from: DRONE.into(), bytes });
    let drone = plain.fleet().iter().next().unwrap().0;
    let sent = scene.voice.send(NOW, plain.fleet(), drone, status, [0; 52]);
    assert_eq!(sent, Err(NotSent::NoWay));
}

fn message(signer: &mut Signer, system: u8, object: &[u8; Uplink::SIZE]) -> Vec<u8> {
    let mut voice = Voice::new(SYSTEM, Some(signer.clone()));
    let bytes = voice.uplink(NOW, system, object).unwrap();
    *signer = voice.signer.unwrap();
    bytes
}

#[test]
fn a_flight_controller_writes_what_is_signed_for_it_and_intact_once() {
    let object = *Uplink::seal(Writer::<BaseStation>::claim(), &UplinkValues::default()).as_bytes();
    let (mut signer, mut other) = (Signer::new(key(), 254), Signer::new(Key::new([1; 32]), 254));
    let mut inbound = Inbound::new(7, Verifier::new(key()));
    let mut written = |bytes: &[u8]| inbound.datagram(NOW, NOW, bytes).is_some();
    assert!(!written(&message(&mut other, 7, &object)), "another key");
    assert!(!written(&message(&mut signer, 8, &object)), "another system");
    assert!(!written(&message(&mut signer, 0, &object)), "everybody");
    for bit in 0..8 * Uplink::SIZE {
        let mut damaged = object;
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(!written(&message(&mut signer, 7, &damaged)), "bit {bit}");
    }
    let own = Uplink::seal(Writer::<FlightController>::claim(), &UplinkValues::default());
    assert!(!written(&message(&mut signer, 7, own.as_bytes())), "the flight controller's");
    let good = message(&mut signer, 7, &object);
    assert!(written(&good));
    assert!(!written(&good), "recorded and sent again");
    let counts = inbound.counts();
    assert_eq!((counts.written, counts.repeated), (1, 0));
    assert_eq!((inbound.received().unsigned, counts.foreign), (2, 2 + 512 + 1));
    let mut inbound = Inbound::new(7, Verifier::new(key()));
    let (first, rest) = good.split_at(30);
    assert_eq!((inbound.stream(NOW, NOW, first), inbound.reads_port()), (None, false));
    assert!(inbound.stream(NOW, NOW, rest).is_some() && inbound.reads_port());
}

#[test]
fn each_uplink_is_answered_once_after_the_dpr_could_store_it() {
    let mut inbound = Inbound::new(7, Verifier::new(key()));
    let object = *Uplink::seal(Writer::<BaseStation>::claim(), &UplinkValues::default()).as_bytes();
    let mut signer = Signer::new(key(), 254);
    let mut bring = |inbound: &mut Inbound, now| inbound.datagram(now, NOW, &message(&mut signer, 7, &object));
    let [none, shown] = [[0; 128], std::array::from_fn(|at| if at < 64 { 0 } else { object[at - 64] })];
    assert!(!inbound.read(0, &shown), "nothing was asked");
    assert!(bring(&mut inbound, 1_000).is_some());
    assert!(!inbound.read(2_000, &none) && !inbound.read(inbound::SHOWN_AFTER_US + 999, &none));
    assert!(inbound.read(inbound::SHOWN_AFTER_US + 1_000, &none), "it is not stored, and that is the answer");
    assert!(!inbound.read(90_000, &none) && !inbound.reads_port());
    assert!(bring(&mut inbound, 100_000).is_some(), "it is written again");
    assert!(inbound.read(101_000, &shown), "at once");
    assert!(bring(&mut inbound, 200_000).is_none(), "it is stored already");
    assert!(inbound.read(201_000, &none), "and was shown, if it is not any more");
    assert!(!inbound.read(300_000, &shown));
    assert_eq!(inbound.counts(), inbound::Counts { written: 2, repeated: 1, foreign: 0 });
}

#[test]
fn a_heartbeat_goes_each_second_to_every_received_peer() {
    let told: SocketAddr = "192.0.2.1:14550".parse().unwrap();
    let mut voice = Voice::new(SYSTEM, None).with_heartbeat(vec![told]);
    let fleet = Fleet::default();
    let to = |voice: &mut Voice, at: u64| voice.tick(NOW + at, &fleet);
    let first = to(&mut voice, 0);
    let everywhere = [To { line: None, address: None }, To { line: None, address: Some(told) }];
    assert_eq!(first.iter().map(|(to, _)| *to).collect::<Vec<_>>(), everywhere);
    assert!(to(&mut voice, HEARTBEAT_US - 1).is_empty());
    let mut receiver = Receiver::default();
    receiver.datagram(NOW, &first[0].1);
    assert_eq!(receiver.counts().foreign, 1, "an intact message that is none of ours");
    let raw = &first[0].1;
    assert_eq!((raw[0], raw[5], raw[6]), (0xFD, SYSTEM, COMPONENT), "MAVLink 2");
    let beat = HEARTBEAT_DATA::deser(MavlinkVersion::V2, &raw[10..19]).unwrap();
    assert_eq!(
        (beat.mavtype, beat.autopilot),
        (MavType::MAV_TYPE_ONBOARD_CONTROLLER, MavAutopilot::MAV_AUTOPILOT_INVALID)
    );
    for port in 0..200 {
        voice.heard(2, SocketAddr::from(([10, 0, 0, 1], 2_000 + port)), NOW + SECOND);
    }
    voice.heard(2, told, NOW + SECOND);
    let heard = to(&mut voice, SECOND);
    assert_eq!(heard.len(), 2 + MAX_HEARERS);
    assert!(heard[2..].iter().all(|(to, _)| to.line == Some(2)));
    assert_eq!(to(&mut voice, SECOND + HEARD_US).len(), 2 + MAX_HEARERS);
    assert_eq!(to(&mut voice, 2 * SECOND + HEARD_US).len(), 2);
    let mut silent = Voice::new(SYSTEM, None);
    silent.heard(2, told, NOW);
    assert!(to(&mut silent, 60 * SECOND).is_empty());
}
