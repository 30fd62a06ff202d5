//! Makes the recorded transactions: a flight controller reads a simulated DPR, with one fault after another.
use profile::criticality::{ActiveLoad, BaseStation, Dpr as DprRole, FlightController, Writer};
use profile::hold::{Acknowledged, Outcome};
use profile::image::Image;
use profile::map::{Map, PortArea};
use profile::ssi::client::{Client, Config, MAX_MAP};
use profile::ssi::{self, Parsed, Request};
use profile::uplink::Written;
use profile::{
    Command, CommandObject, GpsValues, HoldStatus, HoldValues, HorusState, Identifier, Layout, LinkStatus,
    LinkStatusBits, LinkValues, Object, PortStatus, PortStatusBits, PortValues, Profile, ReportedValues, Uplink,
    UplinkStatus, UplinkValues, Violation, Violations,
};

use super::support::seeds;
use super::support::tape::{NO_FRESH, Tape};

const LATENCY_US: u64 = 5_300;
const CYCLE_US: u64 = 10_000;
const START_US: u64 = 1_000_000;

#[derive(Clone, Copy, Debug)]
pub(crate) enum Event {
    Good,
    /// The DPR is busy: it sends 0xFF and receives nothing.
    Busy,
    /// One bit of MISO is wrong.
    Flip(usize),
    /// MISO has this value throughout, but the DPR receives what the flight controller sends.
    Line(u8),
    /// The flight controller clocks fewer bytes: only this number.
    Cut(usize),
    /// The first bytes of the answer, as many as this value says, come from the previous image.
    Torn(usize),
    /// The bytes of MISO are shifted by one bit, as after an extra clock edge.
    Slipped,
}

/// Returns HORUS's values in cycle number `n`; `None` if the frame of that cycle is missed.
type Horus = fn(u32) -> Option<ReportedValues>;

pub(crate) struct World<const N: usize> {
    pub(crate) tape: Tape,
    client: Client,
    horus: Horus,
    fresh_is_wired: bool,
    window: Option<Request>,
    port: PortArea,
    hold: Option<HoldStatus>,
    age_100us: u16,
    now_us: u64,
}

impl<const N: usize> World<N> {
    fn new(change: impl FnOnce(&mut Config)) -> Self {
        let layout = Layout::for_receivers(N).expect("a profile");
        let mut config = Config::new(layout);
        change(&mut config);
        let mut tape = Tape::default();
        tape.config(u8::try_from(N).expect("few"), &config);
        Self {
            tape,
            client: Client::new(config).expect("a good configuration"),
            horus: |n| Some(good(10 * n)),
            fresh_is_wired: false,
            window: None,
            port: PortArea::EMPTY,
            hold: None,
            age_100us: 53,
            now_us: START_US + LATENCY_US + 700,
        }
    }

    fn layout(&self) -> Layout {
        self.client.config().layout
    }

    fn map(&self, n: u32) -> Vec<u8> {
        let sent = (self.horus)(n);
        let mut image = Image::<N>::EMPTY;
        if let Some(reported) = sent {
            let same = seeds::gps_values(reported.timestamp);
            let gps = GpsValues {
                latitude: same.latitude + 1.0,
                longitude: same.longitude + 1.0,
                altitude: f64::from(n),
                pitch: same.pitch + 1.0,
                yaw: same.yaw + 1.0,
                roll: same.roll + 1.0,
                acceleration: same.acceleration.map(|axis| axis + 1.0),
                ..same
            };
            let profile = Profile::<N>::seal(&reported, &[gps; N]);
            for index in 0..Profile::<N>::OBJECTS {
                let bytes = &profile.as_bytes()[Profile::<N>::place(index).expect("an object")];
                image.deposit(Object::verify(index, bytes).expect("sealed")).expect("it has a place");
            }
        }
        let status = LinkStatusBits::new().with_link_up(sent.is_some()).with_all_accepted(sent.is_some());
        image.set_link(LinkStatus::seal(&LinkValues {
            timestamp: 7_000 + 10 * n,
            status,
            frames_received: n,
            age_100us: self.age_100us,
            ..seeds::link_values()
        }));
        let mut map = Map::<N>::new(image, self.port).as_bytes().to_vec();
        if self.layout().hold().is_some() {
            map.extend(self.hold.unwrap_or(HoldStatus::EMPTY).as_bytes());
        }
        map
    }

    fn read(&mut self, event: Event) {
        let mut mosi = [0; MAX_MAP];
        let bytes = self.client.begin(&mut mosi).expect("room");
        let cycle = (self.now_us - START_US - LATENCY_US) / CYCLE_US;
        let published_us = START_US + LATENCY_US + cycle * CYCLE_US;
        let cycle = u32::try_from(cycle).expect("a short recording");
        let window = self.window.map_or(0..self.layout().map_len(), Request::window);
        let show = |map: Vec<u8>| {
            let mut shown = map[window.clone()].to_vec();
            shown.resize(bytes, 0xFF);
            shown
        };
        let mut miso = show(self.map(cycle));
        match event {
            Event::Good => {}
            Event::Busy => miso.fill(0xFF),
            Event::Flip(bit) => miso[bit / 8] ^= 0x80 >> (bit % 8),
            Event::Line(level) => miso.fill(level),
            Event::Cut(length) => miso.truncate(length),
            Event::Torn(length) => miso[..length].copy_from_slice(&show(self.map(cycle - 1))[..length]),
            Event::Slipped => {
                let next: Vec<_> = miso.iter().skip(1).copied().chain([0]).collect();
                miso.iter_mut().zip(next).for_each(|(byte, next)| *byte = *byte << 1 | next >> 7);
            }
        }
        if !matches!(event, Event::Busy) {
            let request = mosi[..8].try_into().expect("eight bytes");
            self.window = match ssi::parse(&request, self.layout().map_len()) {
                Ok(Parsed::Window(window)) => Some(window),
                _ => None,
            };
        }
        let fresh_us = if self.fresh_is_wired { published_us } else { NO_FRESH };
        self.tape.transaction(self.now_us, fresh_us, &miso);
        self.client.end(&miso, self.now_us, Some(fresh_us));
        self.now_us += 4_000;
    }

    fn good(&mut self, times: usize) {
        (0..times).for_each(|_| self.read(Event::Good));
    }

    fn ask(&mut self, offset: usize, length: usize) {
        let window = Request { offset: offset.try_into().expect("small"), length: length.try_into().expect("small") };
        self.tape.ask(window.offset, window.length);
        let _ = self.client.ask(window);
    }

    fn command(&mut self, timestamp: u32) {
        self.tape.commanding(timestamp, 0x00C0, &[0x3C; 52]);
        let values = UplinkValues { timestamp, ..UplinkValues::default() };
        self.client.write(Written::FlightController(&Uplink::seal(Writer::<FlightController>::claim(), &values)));
    }

    fn write(&mut self, object: &[u8; 64]) {
        self.tape.write(object);
        if let Ok(written) = Written::verify(object) {
            self.client.write(written);
        }
    }
}

fn good(timestamp: u32) -> ReportedValues {
    seeds::reported_values(timestamp)
}

fn port(fresh: bool) -> PortArea {
    let mut violations = Violations::new();
    Violation::ALL.into_iter().zip(3..).for_each(|(kind, times)| violations.count(kind, times));
    let values = PortValues {
        timestamp: 7_123,
        status: PortStatusBits::new().with_base_station_fresh(fresh).with_self_test_passed(true),
        uplinks_accepted: 17,
        commands_carried_out: 4,
        last_command_timestamp: 6_999,
        last_command: Command::SelfTest.word(),
        base_station_age_ms: 120,
        flight_controller_age_ms: u16::MAX,
        violations,
        integrity_faults: 1,
        flash_passes: 88,
        stuck_bits: 2,
        buffers_out_of_use: 5,
        last_stop: 0x0102_0304,
    };
    let mut area = PortArea::EMPTY;
    area.set_status(Writer::<DprRole>::claim(), PortStatus::seal(Writer::<DprRole>::claim(), &values));
    if fresh {
        let values = UplinkValues {
            timestamp: 6_400,
            status: UplinkStatus::from_bits(0x8001),
            payload: [0x5A; Uplink::PAYLOAD],
        };
        area.set_uplink(Writer::<BaseStation>::claim(), Uplink::seal(Writer::<BaseStation>::claim(), &values));
        area.set_uplink(
            Writer::<FlightController>::claim(),
            Uplink::seal(Writer::<FlightController>::claim(), &values),
        );
    }
    area
}

fn restarting(n: u32) -> Option<ReportedValues> {
    Some(good(if n < 20 { 50_000 + 10 * n } else { 10 * (n - 20) }))
}

/// Returns HORUS's values. From cycle 8 on, the position is invalid, each time in another way.
fn invalid(n: u32) -> Option<ReportedValues> {
    let all = good(10 * n);
    let status = all.status;
    Some(match n {
        8 => ReportedValues { status: status.with_position_valid(false), ..all },
        10 => ReportedValues { latitude: f64::NAN, ..all },
        11 => ReportedValues { longitude: f64::INFINITY, ..all },
        12 => ReportedValues { latitude: 90.000_000_000_000_01, ..all },
        13 => ReportedValues { latitude: -90.0, longitude: 180.0, ..all },
        14 => ReportedValues { longitude: -180.000_000_000_000_03, ..all },
        15 => ReportedValues { altitude: f64::NEG_INFINITY, ..all },
        16 => ReportedValues { pitch: f32::NAN, ..all },
        17 => ReportedValues { yaw: f32::INFINITY, ..all },
        18 => ReportedValues { status: status.with_attitude_valid(false), ..all },
        19 => ReportedValues { acceleration: [0.0, f32::NAN, 0.0], ..all },
        20 => ReportedValues { status: status.with_acceleration_valid(false), ..all },
        21 => ReportedValues { roll: f32::NEG_INFINITY, acceleration: [0.0, 0.0, f32::INFINITY], ..all },
        22 => ReportedValues { latitude: -0.0, longitude: f64::from_bits(1), ..all },
        23 => ReportedValues::absent(10 * n),
        24 => ReportedValues { altitude: 20_000.0, ..all },
        25 => ReportedValues { altitude: 20_000.000_000_000_004, ..all },
        26 => ReportedValues { altitude: -1_000.0, ..all },
        27 => ReportedValues { altitude: -1_000.000_000_000_000_2, ..all },
        28 => ReportedValues { altitude: f64::NAN, ..all },
        29 => ReportedValues { status: status.with_state(HorusState::EmergencyFired), latitude: 1e300, ..all },
        30..33 => {
            ReportedValues { status: status.with_position_valid(false).with_state(HorusState::EmergencyFired), ..all }
        }
        _ => all,
    })
}

fn started<const N: usize>(change: impl FnOnce(&mut World<N>)) -> World<N> {
    let mut world = World::new(|_| {});
    change(&mut world);
    world.good(9);
    world
}

fn events(events: &[Event]) -> Tape {
    let mut world = started::<3>(|_| {});
    for event in events {
        world.read(*event);
        world.good(2);
    }
    world.tape
}

fn sequence(horus: Horus, readings: usize) -> Tape {
    let mut world = started::<3>(|world| world.horus = horus);
    world.good(readings);
    world.tape
}

fn windows<const N: usize>() -> Tape {
    let mut world = started::<N>(|world| world.port = port(true));
    let layout = Layout::for_receivers(N).expect("a profile");
    let mut places: Vec<_> = (1..=N).filter_map(|index| layout.in_image(index)).collect();
    places.extend([layout.port_status(), layout.uplink::<BaseStation>(), layout.uplink::<FlightController>()]);
    places.extend([0..layout.map_len(), 0..95, 4..100, layout.image_len()..layout.map_len()]);
    for place in places {
        world.ask(place.start, place.len());
        world.good(1);
        world.tape.view();
        world.good(1);
        world.tape.view();
    }
    world.ask(layout.map_len(), 1);
    world.ask(0, 0);
    world.good(1);
    world.tape
}

fn busy_while_asking() -> Tape {
    let mut world = started::<3>(|world| world.port = port(false));
    world.ask(96, 60);
    world.write(Uplink::seal(Writer::<BaseStation>::claim(), &UplinkValues::default()).as_bytes());
    for event in [Event::Busy, Event::Busy, Event::Good, Event::Busy, Event::Busy, Event::Good, Event::Good] {
        world.read(event);
        world.tape.view();
    }
    world.ask(0, 96);
    world.read(Event::Busy);
    world.ask(276, 64);
    world.good(3);
    world.ask(96, 60);
    world.read(Event::Flip(5));
    world.read(Event::Flip(99));
    world.tape.view();
    world.good(2);
    world.tape
}

fn writing() -> Tape {
    let mut world = started::<3>(|_| {});
    let values = UplinkValues { timestamp: 1, payload: [1; Uplink::PAYLOAD], ..UplinkValues::default() };
    let sealed = Uplink::seal(Writer::<BaseStation>::claim(), &values);
    world.write(sealed.as_bytes());
    world.good(2);
    let command = CommandObject::seal(Writer::<FlightController>::claim(), 2, Command::ClearCounters);
    world.write(command.as_bytes());
    world.read(Event::Busy);
    world.write(sealed.as_bytes());
    world.good(2);
    // The client must refuse to send an object that the DPR would refuse.
    let mut damaged = *command.as_bytes();
    damaged[20] ^= 1;
    world.write(&damaged);
    let reseal = |mut object: [u8; 64]| {
        super::support::reference::repair_frame_crc(&mut object);
        object
    };
    world.write(&reseal(damaged));
    let mut unknown = *command.as_bytes();
    unknown[8] ^= 1;
    world.write(&reseal(unknown));
    let mut position = *sealed.as_bytes();
    position[4..6].copy_from_slice(&Identifier::REPORTED_POSITION.0.to_le_bytes());
    world.write(&reseal(position));
    world.good(2);
    for which in 0..2 {
        world.tape.command(3 + u32::from(which), which);
        let command = Command::ALL[usize::from(which)];
        let object = CommandObject::seal(Writer::<FlightController>::claim(), 3 + u32::from(which), command);
        world.client.write(Written::Command(command, &object));
        world.good(1);
    }
    let values = UplinkValues { timestamp: 9, status: UplinkStatus::from_bits(0xBEEF), payload: [9; Uplink::PAYLOAD] };
    world.tape.uplink(9, 0xBEEF, &[9; 52]);
    world.client.write(Written::FlightController(&Uplink::seal(Writer::<FlightController>::claim(), &values)));
    world.good(2);
    world.tape
}

fn stale() -> Tape {
    let mut world = started::<3>(|_| {});
    for age_100us in [900, 940, 1_000, u16::MAX, 53] {
        world.age_100us = age_100us;
        world.good(3);
    }
    (0..32).for_each(|_| world.read(Event::Busy));
    world.good(12);
    world.horus = |_| Some(good(700));
    world.good(30);
    world.tape
}

fn silent() -> Tape {
    let mut world = World::<3>::new(|config| config.silence_us = 20_000);
    (0..8).for_each(|_| world.read(Event::Line(0x00)));
    (0..3).for_each(|_| world.read(Event::Busy));
    world.good(10);
    (0..8).for_each(|_| world.read(Event::Line(0xFF)));
    world.good(2);
    world.tape
}

fn clocks() -> Tape {
    let mut world = started::<3>(|world| world.fresh_is_wired = true);
    world.good(4);
    // The flight controller pauses twice. The sequence continues after the pause of 200 ms, but not after that of 300
    // ms.
    world.now_us += 200_000;
    world.good(3);
    world.now_us += 300_000;
    world.good(12);
    world.now_us -= 400_000;
    world.good(2);
    world.now_us += 400_000;
    world.good(12);
    world.tape
}

fn windows_and_silence() -> Tape {
    let mut world = started::<3>(|world| world.port = port(true));
    let layout = Layout::for_receivers(3).expect("a profile");
    let mut places: Vec<_> = (0..=3).filter_map(|index| layout.in_image(index)).collect();
    places.extend([layout.port_status(), layout.uplink::<BaseStation>(), layout.uplink::<FlightController>()]);
    places.extend([0..32, 33..95]);
    for place in places {
        for _ in 0..10 {
            world.ask(place.start, place.len());
            world.good(1);
        }
        world.read(Event::Busy);
        world.good(2);
    }
    world.tape
}

fn limits() -> Tape {
    let mut world = World::<3>::new(|config| (config.age_limit_us, config.silence_us) = (17_400, 12_000));
    world.good(10);
    for more_us in [0, 1] {
        world.read(Event::Good);
        world.now_us += more_us;
        world.read(Event::Busy);
        world.read(Event::Busy);
        world.read(Event::Busy);
        world.now_us += 4_000 - more_us;
        world.good(4);
    }
    let (map, next) = (world.map(30), world.map(31));
    for shown in [&map, &map, &next] {
        world.tape.transaction(world.now_us, NO_FRESH, &shown[..96]);
    }
    for n in 32..40 {
        world.now_us += CYCLE_US;
        let map = world.map(n);
        world.tape.transaction(world.now_us, START_US, &map[..96]);
    }
    world.tape
}

/// Records intact objects at another object's offset, and positions with a wrong position CRC under a right frame CRC.
fn misplaced() -> Tape {
    let mut world = World::<3>::new(|config| config.read_bytes = 468);
    world.port = port(true);
    world.good(9);
    let repair = super::support::reference::repair_frame_crc;
    for (object, at) in
        [(0..32, 4), (32..96, 5), (32..96, 10), (96..156, 4), (276..340, 4), (340..404, 5), (404..468, 5)]
    {
        let mut map = world.map(12);
        map[object.start + at] ^= 0x01;
        repair(&mut map[object]);
        world.tape.transaction(world.now_us, NO_FRESH, &map);
        world.tape.view();
        world.now_us += 4_000;
    }
    world.tape
}

fn edges() -> Tape {
    let mut world = started::<1>(|_| {});
    world.now_us = u64::MAX - 40_000;
    let map = world.map(3);
    for (began, fresh) in [(0, 0), (u64::MAX, 0), (u64::MAX, u64::MAX), (1, u64::MAX), (u64::MAX - 1, 5)] {
        world.tape.transaction(began, fresh, &map[..96]);
    }
    for length in [0, 1, 31, 32, 95, 97, 348, 400, 1_024] {
        let mut miso = map.clone();
        miso.resize(length, 0xFF);
        world.tape.transaction(START_US, NO_FRESH, &miso);
        world.tape.view();
    }
    for (receivers, read_bytes) in [(0, 96), (4, 96), (6, 96), (255, 96), (3, 95), (3, 469), (3, 468), (5, 588)] {
        let config = Config { read_bytes, ..*world.client.config() };
        world.tape.config(receivers, &config);
        world.tape.view();
        world.tape.transaction(START_US, NO_FRESH, &map[..96]);
    }
    world.tape
}

fn hold() -> Tape {
    let mut world = World::<3>::new(|config| {
        config.layout = config.layout.with_hold();
        config.read_bytes = 532;
    });
    world.port = port(true);
    world.good(3);
    let object = |timestamp, number, outcome| {
        let acknowledged = [Acknowledged::new(7, Outcome::Refused), Acknowledged::new(number, outcome)];
        Some(HoldStatus::seal(
            Writer::<ActiveLoad>::claim(),
            &HoldValues { acknowledged, ..seeds::hold_values(timestamp) },
        ))
    };
    world.tape.send(0, 4.5);
    world.hold = object(1_000, 40, Outcome::Done);
    world.good(2);
    world.tape.view();
    world.tape.send(0, -2.5);
    world.tape.send(1, 0.0);
    world.command(5);
    world.good(2);
    world.hold = object(1_100, 41, Outcome::Refused);
    world.read(Event::Busy);
    world.read(Event::Flip(8 * 500 + 3));
    world.tape.view();
    world.good(2);
    world.command(6);
    for (n, (outcome, timestamp)) in
        (0..).zip([(Outcome::Done, 1_200), (Outcome::Unknown, 1_300), (Outcome::TooOld, 1_400)])
    {
        world.tape.send(n + 1, 8.0);
        world.command(7 + u32::from(n));
        world.good(1);
        world.hold = object(timestamp, 42 + u16::from(n), outcome);
        world.good(1);
    }
    world.tape.send(4, f32::NAN);
    world.hold = object(1_500, 50, Outcome::Done);
    world.good(1);
    world.tape.send(1, 0.0);
    world.tape.give_up();
    world.command(11);
    world.tape.send(2, 0.0);
    world.good(1);
    world.tape.give_up();
    world.hold = object(1_600, 52, Outcome::Done);
    world.good(1);
    world.tape.send(3, 0.0);
    world.hold = object(0, 0, Outcome::Nothing);
    world.good(1);
    world.now_us += 290_000;
    world.good(4);
    world.hold = None;
    world.good(1);
    world.tape.view();
    world.hold = object(100, 0, Outcome::Nothing);
    world.good(1);
    for identifier in [Identifier(0x4101), Identifier::REPORTED_POSITION] {
        let mut bytes = *object(200, 0, Outcome::Nothing).expect("one").as_bytes();
        bytes[4..6].copy_from_slice(&identifier.0.to_le_bytes());
        super::support::reference::repair_frame_crc(&mut bytes);
        let map = [&world.map(12)[..468], &bytes].concat();
        world.tape.transaction(world.now_us, NO_FRESH, &map);
        world.tape.view();
    }
    world.hold = object(300, 0, Outcome::Nothing);
    world.ask(468, 64);
    world.good(2);
    world.ask(468, 65);
    world.now_us -= 20_000;
    world.good(1);
    world.tape
}

pub(crate) fn all() -> Vec<(&'static str, Tape)> {
    use Event::{Busy, Cut, Flip, Good, Line, Slipped, Torn};
    let whole = {
        let mut world = World::<3>::new(|config| config.read_bytes = 468);
        world.port = port(true);
        world.good(12);
        world.tape.view();
        world.read(Flip(8 * 200 + 3));
        world.tape.view();
        world.tape
    };
    let five = {
        let mut world = World::<5>::new(|config| config.age_limit_us = 12_000);
        world.good(14);
        world.tape
    };
    let wrapped: Horus = |n| Some(good((u32::MAX - 95).wrapping_add(10 * n)));
    vec![
        ("good", sequence(|n| Some(good(10 * n)), 10)),
        ("busy", events(&[Busy, Busy, Good])),
        ("torn", events(&[Torn(1), Torn(16), Torn(31), Torn(33), Torn(64), Torn(95)])),
        (
            "damaged",
            events(&[Flip(0), Flip(38), Flip(255), Flip(256), Flip(500), Flip(767), Slipped, Line(0xA5), Cut(95)]),
        ),
        ("stale", stale()),
        ("silent", silent()),
        ("missed", sequence(|n| (n % 5 != 2).then(|| good(10 * n)), 30)),
        ("restarted", sequence(restarting, 60)),
        ("timestamps_that_wrap", sequence(wrapped, 30)),
        ("timestamps_that_jump", sequence(|n| Some(good(10 * n + 30 * (n / 15))), 70)),
        ("timestamps_that_are_irregular", sequence(|n| Some(good(10 * n + n / 15)), 70)),
        ("timestamps_that_swing", sequence(|n| Some(good(500 + 10 * (n % 2))), 30)),
        ("a_clock_that_is_slow", sequence(|n| Some(good(10 * (n - n / 8))), 60)),
        ("a_clock_that_is_fast", sequence(|n| Some(good(10 * (n + n / 4))), 60)),
        ("invalid", sequence(invalid, 55)),
        ("windows_of_1", windows::<1>()),
        ("windows_of_2", windows::<2>()),
        ("windows_of_3", windows::<3>()),
        ("windows_of_5", windows::<5>()),
        ("busy_while_asking", busy_while_asking()),
        ("writing", writing()),
        ("whole_map", whole),
        ("a_limit_of_12_ms", five),
        ("clocks", clocks()),
        ("windows_and_silence", windows_and_silence()),
        ("limits", limits()),
        ("misplaced", misplaced()),
        ("hold", hold()),
        ("edges", edges()),
    ]
}
