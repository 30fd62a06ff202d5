//! From the air to the image, without an MCU: the listener's machine and its executor on the chip model, the receive buffers, acceptance and image.
//!
//! Time is virtual and byte-exact on SPI at 8 MHz; what the tasks of the firmware do takes no time here.

use std::{cell::RefCell, collections::VecDeque, rc::Rc};

use dpr_fw::{
    accept::Early,
    commit::{Commit, Committed, Frame, Images},
    link::Health,
    rf::{Executor, Failed, Port, LEAD},
    triple::{Filling, Rotated, Rotation},
    ImageMemory, ReceiveMemory, IMAGE_WORDS, RECEIVE_WORDS,
};
use profile::{air, image::Image, GpsStatus, GpsValues, LinkValues, Profile, ReportedStatus, ReportedValues};
use st25r3916::{
    air_time_ns, command, listener::PAYLOAD_OFFSET, Listener, ListenerConfig, ListenerEvent, ReadMode, Supply,
};
use st25r3916_model::{AirEvent, Chip, Chunk, Config, FrameStart, Technology};

/// One byte at 8 MHz.
const BYTE_NS: u64 = 1_000;
/// One bit at 424 kbit/s: 32 periods of 13.56 MHz.
const BIT_AS: u64 = 2_359_882_005_899;
const CYCLE_NS: u64 = 10_000_000;
/// Bring-up is over and the field has been on for a while.
const FIRST_FRAME_NS: u64 = 30_000_000;

/// A transfer on its way.
#[derive(Default)]
struct Transfer {
    mosi: Vec<u8>,
    miso: Vec<u8>,
    next_ns: u64,
}

/// The chip, its wires and what is on the air.
struct World {
    chip: Chip,
    now: u64,
    air: VecDeque<(u64, AirEvent)>,
    transfer: Option<Transfer>,
    /// SPIM0 does not go on: transfers that are started never end.
    stuck: bool,
}

impl World {
    fn next(&self) -> Option<u64> {
        let byte = self.transfer.as_ref().filter(|transfer| transfer.miso.len() < transfer.mosi.len());
        let byte = byte.filter(|_| !self.stuck).map(|transfer| transfer.next_ns);
        let air = self.air.front().map(|(at, _)| *at);
        [byte, air, self.chip.next_event()].into_iter().flatten().min().map(|at| at.max(self.now))
    }

    fn advance(&mut self, to: u64) {
        self.now = to;
        self.chip.advance(to);
        while let Some((at, event)) = self.air.pop_front_if(|(at, _)| *at <= to) {
            self.chip.hear(at, &event);
        }
        if let Some(transfer) = self.transfer.as_mut().filter(|_| !self.stuck) {
            if transfer.miso.len() < transfer.mosi.len() && transfer.next_ns <= to {
                transfer.miso.push(self.chip.transfer(to, transfer.mosi[transfer.miso.len()]));
                transfer.next_ns = to + BYTE_NS;
                if transfer.miso.len() == transfer.mosi.len() {
                    self.chip.deselect(to);
                }
            }
        }
    }

    /// A frame whose first bit is on the air at `at`.
    fn send(&mut self, at: u64, payload: &[u8], damage: impl FnOnce(&mut [u8])) {
        let mut data = vec![payload.len() as u8 + 1];
        data.extend(payload);
        data.extend(crc16(&data));
        damage(&mut data);
        let bits = 8 * data.len() as u32;
        let start = FrameStart {
            technology: Technology::NfcF,
            bits_per_second: 424_000,
            bit_as: BIT_AS,
            header_bits: 64,
            byte_bits: 8,
            load_modulation: false,
            chunk: Chunk { data, parity_error: false },
        };
        self.air.push_back((at, AirEvent::FrameStart(start)));
        self.air.push_back((at + air_time_ns(payload.len()), AirEvent::FrameEnd { bits }));
    }
}

/// CRC-16 of NFC-F: polynomial 0x1021, initial value 0, most significant bit first.
fn crc16(bytes: &[u8]) -> [u8; 2] {
    let crc = bytes.iter().fold(0_u16, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| if crc >> 15 == 1 { crc << 1 ^ 0x1021 } else { crc << 1 })
    });
    crc.to_be_bytes()
}

type Buffer = ReceiveMemory;

/// The port as the hardware does it: a read lands one byte early, and that byte is put back.
struct SimPort {
    world: Rc<RefCell<World>>,
    buffer: Option<Filling<Buffer>>,
    response: Vec<u8>,
    read: Option<(usize, usize)>,
    timer_ns: u64,
}

impl SimPort {
    fn start(&mut self, mosi: Vec<u8>) {
        let mut world = self.world.borrow_mut();
        let now = world.now;
        world.chip.select(now);
        world.transfer = Some(Transfer { mosi, miso: Vec::new(), next_ns: now + BYTE_NS });
    }
}

impl Port for SimPort {
    fn start_short(&mut self, bytes: &[u8]) {
        self.read = None;
        self.start(bytes.to_vec());
    }

    fn start_read(&mut self, offset: usize, len: usize) {
        self.read = Some((offset, len));
        let mut mosi = vec![0; len + 1];
        mosi[0] = command::FIFO_READ;
        self.start(mosi);
    }

    fn ended(&mut self) -> bool {
        let mut world = self.world.borrow_mut();
        let Some(transfer) = world.transfer.take_if(|transfer| transfer.miso.len() == transfer.mosi.len()) else {
            return false;
        };
        self.response = transfer.miso;
        if let Some((offset, len)) = self.read {
            let words = self.buffer.as_mut().expect("the buffer is here").memory();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(words.as_mut_slice());
            let place = LEAD + offset - 1;
            let kept = bytes[place];
            bytes[place..=place + len].copy_from_slice(&self.response);
            bytes[place] = kept;
            self.response.remove(0);
        }
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        Ok(&self.response)
    }

    fn abort(&mut self) {
        let mut world = self.world.borrow_mut();
        world.transfer = None;
        world.stuck = false;
        let now = world.now;
        world.chip.deselect(now);
    }

    fn irq(&mut self) -> bool {
        self.world.borrow().chip.irq()
    }

    fn start_timer(&mut self, micros: u32) {
        self.timer_ns = self.world.borrow().now + u64::from(micros) * 1_000;
    }

    fn elapsed(&mut self) -> bool {
        self.world.borrow().now >= self.timer_ns
    }

    fn now_us(&mut self) -> u32 {
        (self.world.borrow().now / 1_000) as u32
    }
}

/// Images as they are published, and when.
struct Album {
    filling: ImageMemory,
    published: Vec<(u64, ImageMemory)>,
    now: u64,
}

impl Images for Album {
    fn filling(&mut self) -> &mut ImageMemory {
        &mut self.filling
    }
    fn publish(&mut self) {
        self.published.push((self.now, self.filling));
        self.filling = [0; IMAGE_WORDS];
    }
}

/// The DPR for `N` receivers.
struct Dpr<const N: usize> {
    world: Rc<RefCell<World>>,
    executor: Executor<SimPort>,
    rotation: Rotation<Buffer, (usize, u32, Early)>,
    early: Early,
    verified_early: u32,
    commit: Commit<N>,
    album: Album,
    events: Vec<ListenerEvent>,
    stuck_bits: u32,
}

impl<const N: usize> Dpr<N> {
    fn new(read_mode: ReadMode) -> Self {
        let world = World {
            chip: Chip::new(Config { vdd_mv: 5_000, ..Config::default() }),
            now: 0,
            air: VecDeque::from([(20_000_000, AirEvent::FieldOn)]),
            transfer: None,
            stuck: false,
        };
        let world = Rc::new(RefCell::new(world));
        let buffers = [(); 3].map(|()| [0xA5A5_A5A5; RECEIVE_WORDS]);
        let (buffer, rotation, _) = Rotation::new(buffers);
        let port =
            SimPort { world: world.clone(), buffer: Some(buffer), response: Vec::new(), read: None, timer_ns: 0 };
        let config = ListenerConfig { supply: Supply::Volts5, read_mode, ..ListenerConfig::new() };
        let mut executor = Executor::new(Listener::new(config), port);
        assert_eq!(executor.resume(), None);
        Self {
            world,
            executor,
            rotation,
            early: Early::default(),
            verified_early: 0,
            commit: Commit::new(),
            album: Album { filling: [0; IMAGE_WORDS], published: Vec::new(), now: 0 },
            events: Vec::new(),
            stuck_bits: 0,
        }
    }

    fn send(&mut self, at: u64, payload: &[u8]) {
        self.world.borrow_mut().send(at, payload, |_| ());
    }

    /// Lets virtual time pass, each interrupt at its instant.
    fn run_to(&mut self, to: u64) {
        loop {
            let timer = self.executor.port().timer_ns;
            let world = self.world.borrow().next();
            let now = self.world.borrow().now;
            let next = world.into_iter().chain((timer > now).then_some(timer)).min();
            let next = next.filter(|next| *next <= to).unwrap_or(to);
            self.world.borrow_mut().advance(next);
            self.serve();
            let done = self.world.borrow().next().is_none_or(|event| event > to) && self.executor.port().timer_ns > to;
            if next == to && done {
                return;
            }
        }
    }

    /// What the RFID, commit and scrub tasks do.
    fn serve(&mut self) {
        let mut event = self.executor.poll();
        while let Some(happened) = event {
            self.events.push(happened);
            if let ListenerEvent::Frame { len, .. } = happened {
                let about = (len, self.executor.irq_us(), self.early);
                let port = self.executor.port();
                let (next, rotated) = self.rotation.rotate(port.buffer.take().expect("the buffer is here"), about);
                assert_eq!(rotated, Rotated::Handed);
                port.buffer = Some(next);
            }
            event = if matches!(happened, ListenerEvent::Frame { .. }) {
                self.executor.rest();
                None
            } else {
                self.executor.resume()
            };
        }
        if let Some(arrived) = self.executor.arrived() {
            let buffer = self.executor.port().buffer.as_ref().expect("the buffer is here");
            let bytes: &[u8] = bytemuck::cast_slice(buffer.peek().as_slice());
            let before = self.early;
            self.early.follow::<N>(&bytes[LEAD..LEAD + arrived]);
            self.verified_early += u32::from(arrived > 0 && self.early != before);
        }
        self.album.now = self.world.borrow().now;
        let now_us = (self.album.now / 1_000) as u32;
        while let Some(received) = self.rotation.read() {
            let (len, ended_us, early) = *received.about();
            let bytes: &[u8] = bytemuck::cast_slice(received.memory().as_slice());
            let payload = &bytes[LEAD + PAYLOAD_OFFSET..][..len];
            let frame = Frame { payload, ended_us, early };
            let _: Result<Committed, _> = self.commit.frame(frame, now_us, &Health::default(), &mut self.album);
            self.rotation.done(received);
        }
        while let Some(spent) = self.rotation.dirty() {
            let (clean, found) = spent.scrub();
            self.stuck_bits += found.stuck_bits;
            self.rotation.cleaned(clean);
        }
    }

    fn profile(&self, image: usize) -> &[u8] {
        let bytes: &[u8] = bytemuck::cast_slice(&self.album.published[image].1);
        &bytes[32..Image::<N>::LEN]
    }

    fn link(&self) -> LinkValues {
        let bytes: &[u8] = bytemuck::cast_slice(&self.album.published.last().expect("published").1);
        profile::LinkStatus::verify(&bytes[..32]).expect("Link-Status is intact").values()
    }
}

/// A profile whose values tell its timestamp.
fn profile_at<const N: usize>(timestamp: u32) -> Profile<N> {
    let (latitude, longitude, altitude) =
        (47.0 + f64::from(timestamp) * 1e-7, 8.0 - f64::from(timestamp) * 1e-7, 431.5);
    let reported = ReportedValues {
        timestamp,
        status: ReportedStatus::new().with_position_valid(true),
        latitude,
        longitude,
        altitude,
        pitch: 0.01,
        yaw: 1.0,
        roll: -0.02,
        acceleration: [0.1, 0.2, 0.3],
    };
    let gps = GpsValues {
        timestamp,
        status: GpsStatus::new().with_position_valid(true),
        latitude,
        longitude,
        altitude,
        pitch: 0.01,
        yaw: 1.0,
        roll: -0.02,
        acceleration: [0.1, 0.2, 0.3],
    };
    Profile::seal(&reported, &[gps; N])
}

/// 20 cycles; every profile has to be published, byte for byte, within `bound_ns` of the last bit.
fn every_profile_arrives<const N: usize>(read_mode: ReadMode, bound_ns: u64) {
    let mut dpr = Dpr::<N>::new(read_mode);
    let mut ends = Vec::new();
    for cycle in 0..20 {
        let sent = profile_at::<N>(10 * (cycle + 1));
        let mut at = FIRST_FRAME_NS + CYCLE_NS * u64::from(cycle);
        for payload in air::split(&sent) {
            dpr.send(at, payload);
            at += air_time_ns(payload.len()) + 300_000;
        }
        ends.push(at - 300_000);
    }
    dpr.run_to(FIRST_FRAME_NS + CYCLE_NS * 20);
    assert_eq!(dpr.album.published.len(), 20, "{:?}", dpr.events);
    for (image, end) in ends.into_iter().enumerate() {
        assert_eq!(dpr.profile(image), profile_at::<N>(10 * (image as u32 + 1)).as_bytes());
        let latency = dpr.album.published[image].0 - end;
        assert!(latency <= bound_ns, "image {image}: {latency} ns after the last bit");
    }
    let link = dpr.link();
    assert_eq!((link.objects_rejected, link.frames_missed), (0, 0));
    assert_eq!(link.objects_accepted, 20 * (N as u32 + 1));
    assert_eq!(dpr.stuck_bits, 0);
    assert_eq!(dpr.world.borrow().chip.reports(), []);
}

#[test]
fn profiles_of_any_number_of_receivers_arrive_while_the_fifo_fills() {
    // Of 0.1 ms: 40 µs for SPI and the chip, the rest for the processor.
    every_profile_arrives::<1>(ReadMode::WhileFilling, 40_000);
    every_profile_arrives::<2>(ReadMode::WhileFilling, 40_000);
    every_profile_arrives::<3>(ReadMode::WhileFilling, 40_000);
    every_profile_arrives::<5>(ReadMode::WhileFilling, 40_000);
}

#[test]
fn profiles_arrive_by_store_and_forward() {
    // 247 bytes and the command take 0.248 ms of SPI.
    every_profile_arrives::<3>(ReadMode::StoreAndForward, 280_000);
    every_profile_arrives::<5>(ReadMode::StoreAndForward, 280_000);
}

#[test]
fn a_damaged_byte_costs_its_object_and_is_seen_by_the_chip_too() {
    let mut dpr = Dpr::<3>::new(ReadMode::WhileFilling);
    let sent = profile_at::<3>(10);
    // Byte 70 of the payload lies in GPS1.
    dpr.world.borrow_mut().send(FIRST_FRAME_NS, sent.as_bytes(), |data| data[1 + 70] ^= 0x10);
    dpr.run_to(FIRST_FRAME_NS + CYCLE_NS);
    let mut expected = sent.as_bytes().to_vec();
    expected[64..124].fill(0);
    assert_eq!(dpr.profile(0), expected);
    let link = dpr.link();
    assert_eq!((link.objects_accepted, link.objects_rejected), (3, 1));
    assert!(link.status.link_up() && !link.status.all_accepted());
    let flagged = |event: &&ListenerEvent| matches!(event, ListenerEvent::Frame { flags, .. } if !flags.is_clean());
    assert_eq!(dpr.events.iter().filter(flagged).count(), 1);
}

#[test]
fn a_transfer_that_never_ends_costs_a_bring_up_and_no_more() {
    let mut dpr = Dpr::<1>::new(ReadMode::WhileFilling);
    dpr.send(FIRST_FRAME_NS, profile_at::<1>(10).as_bytes());
    dpr.run_to(FIRST_FRAME_NS + CYCLE_NS);
    assert_eq!(dpr.album.published.len(), 1);
    dpr.world.borrow_mut().stuck = true;
    dpr.send(FIRST_FRAME_NS + CYCLE_NS, profile_at::<1>(20).as_bytes());
    dpr.run_to(FIRST_FRAME_NS + 9 * CYCLE_NS);
    assert_eq!(dpr.album.published.len(), 1);
    let faults = dpr.events.iter().filter(|event| matches!(event, ListenerEvent::Fault(_))).count();
    assert_eq!(faults, 1, "{:?}", dpr.events);
    dpr.send(FIRST_FRAME_NS + 9 * CYCLE_NS, profile_at::<1>(100).as_bytes());
    dpr.run_to(FIRST_FRAME_NS + 10 * CYCLE_NS);
    assert_eq!(dpr.profile(1), profile_at::<1>(100).as_bytes());
}

#[test]
fn a_lost_field_and_its_return_need_no_help() {
    let mut dpr = Dpr::<1>::new(ReadMode::WhileFilling);
    dpr.world.borrow_mut().air.push_back((FIRST_FRAME_NS, AirEvent::FieldOff));
    dpr.world.borrow_mut().air.push_back((FIRST_FRAME_NS + CYCLE_NS, AirEvent::FieldOn));
    dpr.send(FIRST_FRAME_NS + 2 * CYCLE_NS, profile_at::<1>(10).as_bytes());
    dpr.run_to(FIRST_FRAME_NS + 3 * CYCLE_NS);
    assert_eq!(dpr.profile(0), profile_at::<1>(10).as_bytes());
    assert!(dpr.events.contains(&ListenerEvent::FieldOff));
}
