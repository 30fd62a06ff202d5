//! Tests the way from the air to the image: the functions that the firmware's tasks call, on a model of the chip. Time
//! is virtual. SPI takes its time byte by byte at 8 MHz. The firmware's tasks take no time.

use std::{cell::RefCell, collections::VecDeque, rc::Rc};

use dpr_fw::{
    accept::Early,
    commit::{Commit, Images},
    intake,
    link::Health,
    rf::{self, Call, FrameInfo, FrontEnd, Reception, LEAD, RESUME_AFTER_US},
    telemetry::Telemetry,
    triple::{self, Filling, Rotation},
    ImageMemory, ReceiveMemory, IMAGE_WORDS, RECEIVE_WORDS,
};
use profile::{
    air, air::air_time_ns, image::Image, GpsStatus, GpsValues, LinkValues, Profile, ReportedStatus, ReportedValues,
};
use rtic_core::Mutex;
use st25r3916::{
    command,
    executor::{Failed, Port},
    listener::TAIL,
    Fault, Listener, ListenerConfig, ReadMode, Short,
};
use st25r3916_model::{AirEvent, Chip, Chunk, Config, FrameStart, Space, Technology};

const BYTE_NS: u64 = 1_000;
/// The time of one bit at 424 kbit/s, in attoseconds: 32 periods of 13.56 MHz.
const BIT_AS: u64 = 2_359_882_005_899;
const CYCLE_NS: u64 = 10_000_000;
/// The first byte of a status read, which reads registers from 0x19 on.
const STATUS_READ: u8 = 0x59;
/// The instant of the first cycle's sample, ns. Before it the bring-up has ended, and the field has been on for a
/// while.
const FIRST_TICK_NS: u64 = 33_000_000;

fn timestamp(cycle: u64) -> u32 {
    10 * (cycle as u32 + 1)
}

#[derive(Default)]
struct Transfer {
    mosi: Vec<u8>,
    miso: Vec<u8>,
    next_ns: u64,
}

struct World {
    chip: Chip,
    now: u64,
    air: VecDeque<(u64, AirEvent)>,
    transfer: Option<Transfer>,
    /// Whether SPIM0 hangs. If so, started transfers never end.
    stuck: bool,
    irq: bool,
    irq_rose_ns: u64,
    rises_in_status_reads: u32,
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
        let was = std::mem::replace(&mut self.irq, self.chip.irq());
        if self.irq && !was {
            self.irq_rose_ns = to;
            let status = |transfer: &Transfer| {
                transfer.mosi.first() == Some(&STATUS_READ) && transfer.miso.len() < transfer.mosi.len()
            };
            self.rises_in_status_reads += u32::from(self.transfer.as_ref().is_some_and(status));
        }
    }

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
        self.air.push_back((at + air_time_ns(payload.len() as u8), AirEvent::FrameEnd { bits }));
    }
}

/// Returns CRC-16 of NFC-F: polynomial 0x1021, initial value 0, most significant bit first.
fn crc16(bytes: &[u8]) -> [u8; 2] {
    let crc = bytes.iter().fold(0_u16, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| if crc >> 15 == 1 { crc << 1 ^ 0x1021 } else { crc << 1 })
    });
    crc.to_be_bytes()
}

type Buffer = ReceiveMemory;

struct Own<'a, T>(&'a mut T);

impl<T> Mutex for Own<'_, T> {
    type T = T;

    fn lock<R>(&mut self, with: impl FnOnce(&mut T) -> R) -> R {
        with(self.0)
    }
}

/// The first byte of a read overwrites the byte before the data, as in hardware, and the port restores that byte.
struct SimPort {
    world: Rc<RefCell<World>>,
    buffer: Option<Filling<Buffer>>,
    response: Vec<u8>,
    read: Option<(usize, usize)>,
    timer_ns: u64,
    always_clean: bool,
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
    fn start_short(&mut self, short: &Short) {
        self.read = None;
        self.start(short.bytes().to_vec());
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        self.read = Some((offset, len));
        let mut mosi = vec![0; len + 1];
        mosi[0] = command::FIFO_READ;
        self.start(mosi);
        true
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

    fn irq_is_high(&mut self) -> bool {
        self.world.borrow().chip.irq()
    }

    fn start_timer(&mut self, us: u32) {
        self.timer_ns = self.world.borrow().now + u64::from(us) * 1_000;
    }

    fn elapsed(&mut self) -> bool {
        self.world.borrow().now >= self.timer_ns
    }
}

impl rf::FrontEndPort for SimPort {
    type Buffer = Buffer;

    fn exchange(&mut self, with: impl FnOnce(Filling<Buffer>) -> Filling<Buffer>) {
        self.buffer = self.buffer.take().map(with);
        self.always_clean &= self.buffer.as_ref().is_some_and(|buffer| buffer.peek() == &[0; RECEIVE_WORDS]);
    }

    fn arrived(&self, len: usize) -> &[u8] {
        let reading = self.world.borrow().transfer.is_some() && self.read.is_some();
        assert!(len == 0 || !reading, "the buffer is looked at while the DMA writes into it");
        let bytes: &[u8] = bytemuck::cast_slice(self.buffer.as_ref().expect("the buffer is here").peek().as_slice());
        &bytes[LEAD..LEAD + len]
    }

    fn irq_edge_us(&mut self) -> u32 {
        (self.world.borrow().irq_rose_ns / 1_000) as u32
    }
}

struct Album {
    filling: ImageMemory,
    published: Vec<(u64, ImageMemory)>,
    now: u64,
}

impl Images for Album {
    fn filling(&mut self) -> &mut ImageMemory {
        &mut self.filling
    }
    fn place_port<const M: usize>(&mut self) {}
    fn publish(&mut self) {
        self.published.push((self.now, self.filling));
        self.filling = [0; IMAGE_WORDS];
    }
}

struct Dpr<const N: usize> {
    world: Rc<RefCell<World>>,
    receiver: Reception<SimPort>,
    rotation: Rotation<Buffer, FrameInfo>,
    front_end: FrontEnd,
    front_ends: Vec<FrontEnd>,
    commit: Commit<N>,
    album: Album,
    telemetry: Telemetry,
    /// Whether the commit task is kept from running, so that frames wait.
    commit_waits: bool,
}

impl<const N: usize> Dpr<N> {
    fn new(read_mode: ReadMode) -> Self {
        let world = World {
            chip: Chip::new(Config { vdd_mv: 5_000, unsuited_chain_receives: false, ..Config::default() }),
            now: 0,
            air: VecDeque::from([(20_000_000, AirEvent::FieldOn)]),
            transfer: None,
            stuck: false,
            irq: false,
            irq_rose_ns: 0,
            rises_in_status_reads: 0,
        };
        let world = Rc::new(RefCell::new(world));
        let buffers = [(); 3].map(|()| [0xA5A5_A5A5; RECEIVE_WORDS]);
        let (buffer, rotation, _) = Rotation::new(buffers);
        let port = SimPort {
            world: world.clone(),
            buffer: Some(buffer),
            response: Vec::new(),
            read: None,
            timer_ns: 0,
            always_clean: true,
        };
        let config = ListenerConfig { read_mode, ..ListenerConfig::new() };
        let mut dpr = Self {
            world,
            receiver: Reception::start(Listener::new(config), port),
            rotation,
            front_end: FrontEnd::Starting,
            front_ends: vec![],
            commit: Commit::new(),
            album: Album { filling: [0; IMAGE_WORDS], published: Vec::new(), now: 0 },
            telemetry: Telemetry::new(),
            commit_waits: false,
        };
        dpr.commit.begin(0, &Health::default(), &mut dpr.album);
        dpr.run_to(FIRST_TICK_NS);
        let shown = dpr.album.published.iter().any(|(_, image)| image[8..].iter().any(|&word| word != 0));
        assert!(!shown && dpr.link().frames_missed == 0, "nothing has been sent yet");
        dpr.album.published.clear();
        dpr
    }

    fn send(&mut self, at: u64, payload: &[u8]) {
        self.world.borrow_mut().send(at, payload, |_| ());
    }

    /// Sends the frames of cycle number `cycle`, from 0, in their slots. Returns the instant, ns, of the last bit.
    fn send_cycle(&mut self, cycle: u64) -> u64 {
        let sent = profile_at::<N>(timestamp(cycle));
        let tick = FIRST_TICK_NS + CYCLE_NS * cycle;
        let mut end = 0;
        for (frame, payload) in air::split(&sent).enumerate() {
            let at = tick + 1_000 * u64::from(air::send_slot_us::<N>(frame).expect("a frame of the cycle"));
            self.send(at, payload);
            end = at + air_time_ns(payload.len() as u8);
        }
        end
    }

    /// Returns a running link in sequence: cycles 0 to 3 have come, and an image shows the objects of cycle 3.
    fn in_sequence(read_mode: ReadMode) -> Self {
        let mut dpr = Self::new(read_mode);
        for cycle in 0..4 {
            dpr.send_cycle(cycle);
        }
        dpr.run_to(FIRST_TICK_NS + CYCLE_NS * 4);
        assert_eq!(dpr.published(), 4);
        assert_eq!(dpr.profile(3), profile_at::<N>(timestamp(3)).as_bytes());
        dpr
    }

    fn published(&self) -> usize {
        self.album.published.len()
    }

    fn run_to(&mut self, to: u64) {
        loop {
            let timer = self.receiver.port().timer_ns;
            let world = self.world.borrow().next();
            let now = self.world.borrow().now;
            let deadline = u64::from(self.commit.deadline_us()) * 1_000;
            let timers = [timer, deadline].into_iter().filter(|timer| *timer > now);
            let next = world.into_iter().chain(timers).min();
            let next = next.filter(|next| *next <= to).unwrap_or(to);
            self.world.borrow_mut().advance(next);
            self.serve();
            let done = self.world.borrow().next().is_none_or(|event| event > to) && self.receiver.port().timer_ns > to;
            if next == to && done {
                return;
            }
        }
    }

    fn serve(&mut self) {
        let Self { world, receiver, rotation, front_end, front_ends, commit, album, telemetry, commit_waits } = self;
        let called = receiver.serve::<N>(Own(rotation), Own(front_end), telemetry) != Call::None;
        let now_us = || (world.borrow().now / 1_000) as u32;
        if !*commit_waits && (called || now_us() >= commit.deadline_us()) {
            album.now = world.borrow().now;
            intake::take_in(commit, Own(rotation), now_us, &Health::default(), album, telemetry);
            telemetry.scrubbed(triple::scrub_waiting(Own(rotation)));
        }
        if front_ends.last() != Some(front_end) {
            front_ends.push(*front_end);
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

/// Sends 20 cycles. Once the sequence is found, every profile must be shown byte for byte and published within
/// `bound_ns` of its last bit.
fn every_profile_arrives<const N: usize>(read_mode: ReadMode, bound_ns: u64) {
    let mut dpr = Dpr::<N>::new(read_mode);
    let ends: Vec<_> = (0..20).map(|cycle| dpr.send_cycle(cycle)).collect();
    dpr.run_to(FIRST_TICK_NS + CYCLE_NS * 20);
    assert_eq!(dpr.published(), 20, "{:?}", dpr.front_ends);
    for (image, end) in ends.into_iter().enumerate() {
        if image < 3 {
            assert!(dpr.profile(image).iter().all(|&byte| byte == 0), "the sequence is searched for");
        } else {
            assert_eq!(dpr.profile(image), profile_at::<N>(timestamp(image as u64)).as_bytes());
        }
        let latency = dpr.album.published[image].0 - end;
        assert!(latency <= bound_ns, "image {image}: {latency} ns after the last bit");
    }
    let link = dpr.link();
    let objects = N as u32 + 1;
    assert_eq!((link.objects_rejected, link.frames_missed), (3 * objects, 0));
    assert_eq!(link.objects_accepted, 17 * objects);
    assert_eq!((dpr.telemetry.scrub_faults.get(), dpr.telemetry.rf_recoveries.get()), (0, 0));
    assert_eq!(dpr.telemetry.rxe_to_publish_us.get(), dpr.telemetry.rxe_to_publish_worst_us.get());
    assert!(dpr.receiver.port().always_clean);
    assert_eq!(dpr.world.borrow().chip.reports(), []);
}

#[test]
fn profiles_of_any_number_of_receivers_arrive_while_the_fifo_fills() {
    // The design allows 0.1 ms from the last bit to the image. SPI and chip get 40 µs of them, the processor the rest.
    every_profile_arrives::<1>(ReadMode::WhileFilling, 40_000);
    every_profile_arrives::<2>(ReadMode::WhileFilling, 40_000);
    every_profile_arrives::<3>(ReadMode::WhileFilling, 40_000);
    every_profile_arrives::<5>(ReadMode::WhileFilling, 40_000);
}

#[test]
fn profiles_arrive_by_store_and_forward() {
    // With store-and-forward, reading a frame's 247 bytes over the SPI takes 0.248 ms with the command.
    every_profile_arrives::<3>(ReadMode::StoreAndForward, 280_000);
    every_profile_arrives::<5>(ReadMode::StoreAndForward, 280_000);
}

#[test]
fn no_transfer_reaches_the_chip_for_its_rest_time_after_a_frame() {
    let mut dpr = Dpr::<3>::in_sequence(ReadMode::WhileFilling);
    let end = dpr.send_cycle(4);
    dpr.run_to(end);
    while dpr.published() == 4 {
        let now = dpr.world.borrow().now;
        dpr.run_to(now + 1_000);
    }
    let (frame_ns, _) = dpr.album.published[4];
    let rest_ns = u64::from(RESUME_AFTER_US) * 1_000;
    for later_ns in (1_000..rest_ns).step_by(1_000) {
        // Each step calls the RFID task once more, like a check-in or an IRQ edge that is reported twice.
        dpr.run_to(frame_ns + later_ns);
        assert!(dpr.world.borrow().transfer.is_none(), "{later_ns} ns after the frame");
    }
    dpr.run_to(frame_ns + rest_ns);
    assert!(dpr.world.borrow().transfer.is_some(), "then it is armed again");
}

#[test]
fn a_receive_buffer_just_holds_the_longest_frame() {
    // In the buffer the bytes that align the payload come first, then LEN, payload and CRC-16.
    let longest = LEAD + 1 + air::MAX_PAYLOAD + 2;
    assert!((longest..longest + 4).contains(&(4 * RECEIVE_WORDS)));
}

/// Returns for each frame of a cycle the objects that were verified before the frame's last byte had arrived.
fn verified_early<const N: usize>(read_mode: ReadMode) -> Vec<Early> {
    let mut dpr = Dpr::<N>::in_sequence(read_mode);
    dpr.commit_waits = true;
    let end = dpr.send_cycle(4);
    dpr.run_to(end + 1_000_000);
    std::iter::from_fn(|| dpr.rotation.read()).map(|received| received.about().early).collect()
}

/// Returns for each frame of a cycle the objects that can be verified without the frame's last `missing` bytes.
fn early_without<const N: usize>(missing: usize) -> Vec<Early> {
    let sent = profile_at::<N>(timestamp(4));
    let early = air::split(&sent).map(|payload| {
        let arrived = [&[payload.len() as u8 + 1], payload].concat();
        let mut early = Early::default();
        early.follow::<N>(&arrived[..arrived.len() - missing]);
        early
    });
    early.collect()
}

#[test]
fn all_but_a_frames_last_bytes_are_verified_while_it_arrives() {
    // The bytes that arrive after the third read has begun, the CRC-16 included, are read only at the frame's end.
    assert_eq!(verified_early::<1>(ReadMode::WhileFilling), early_without::<1>(TAIL - 2));
    assert_eq!(verified_early::<3>(ReadMode::WhileFilling), early_without::<3>(TAIL - 2));
    assert_eq!(verified_early::<5>(ReadMode::WhileFilling), early_without::<5>(TAIL - 2));
    let nothing = verified_early::<3>(ReadMode::StoreAndForward);
    assert_eq!(nothing, [Early::default()]);
}

#[test]
fn objects_are_verified_early_only_while_their_frame_arrives() {
    let mut dpr = Dpr::<3>::in_sequence(ReadMode::WhileFilling);
    assert!(!dpr.receiver.verify_early());
    let end = dpr.send_cycle(4);
    dpr.run_to(end - 20_000);
    assert!(dpr.receiver.verify_early());
    dpr.run_to(end + 1_000_000);
    assert!(!dpr.receiver.verify_early());
}

#[test]
fn the_age_at_publication_is_the_samples() {
    for read_mode in [ReadMode::WhileFilling, ReadMode::StoreAndForward] {
        let dpr = Dpr::<3>::in_sequence(read_mode);
        let (published, _) = dpr.album.published[3];
        let sampled = FIRST_TICK_NS + 3 * CYCLE_NS;
        let age_100us = (published - sampled) / 100_000;
        assert!(u64::from(dpr.link().age_100us).abs_diff(age_100us) <= 1, "{} of {age_100us}", dpr.link().age_100us);
    }
}

#[test]
fn a_damaged_byte_costs_only_the_object_it_lies_in() {
    let mut dpr = Dpr::<3>::in_sequence(ReadMode::WhileFilling);
    let sent = profile_at::<3>(timestamp(4));
    // The damaged byte, byte 70 of the payload, lies in GPS1.
    let at = FIRST_TICK_NS + 4 * CYCLE_NS + 300_000;
    dpr.world.borrow_mut().send(at, sent.as_bytes(), |data| data[1 + 70] ^= 0x10);
    dpr.run_to(at + CYCLE_NS);
    let mut expected = sent.as_bytes().to_vec();
    expected[64..124].fill(0);
    assert_eq!(dpr.profile(4), expected);
    let link = dpr.link();
    assert_eq!((link.objects_accepted, link.objects_rejected), (4 + 3, 3 * 4 + 1));
    assert!(link.status.link_up() && !link.status.all_accepted());
    assert_eq!(dpr.telemetry.chip_crc_flags.get(), 1);
}

#[test]
fn a_frame_of_another_length_is_counted_and_the_next_is_shown() {
    let mut dpr = Dpr::<3>::in_sequence(ReadMode::WhileFilling);
    let tick = FIRST_TICK_NS + 4 * CYCLE_NS;
    dpr.send(tick + 300_000, &profile_at::<2>(timestamp(4)).as_bytes()[..100]);
    dpr.send_cycle(5);
    dpr.run_to(tick + 2 * CYCLE_NS);
    assert_eq!(dpr.telemetry.wrong_length.get(), 1);
    assert_eq!(dpr.profile(dpr.published() - 1), profile_at::<3>(timestamp(5)).as_bytes());
    assert!(dpr.receiver.port().always_clean);
}

#[derive(Clone, Copy, Debug)]
enum Lost {
    /// The field goes off during the frame.
    WithTheField,
    /// The SPI transfer that reads the frame's bytes never ends.
    WithTheSpi,
}

#[test]
fn a_buffer_with_a_lost_frame_is_scrubbed_before_the_next_one() {
    for lost in [Lost::WithTheField, Lost::WithTheSpi] {
        let mut dpr = Dpr::<3>::in_sequence(ReadMode::WhileFilling);
        let tick = FIRST_TICK_NS + 4 * CYCLE_NS;
        dpr.send_cycle(4);
        if let Lost::WithTheField = lost {
            let mut world = dpr.world.borrow_mut();
            let end = world.air.pop_back().expect("the frame's end");
            world.air.push_back((tick + 4_800_000, AirEvent::FieldOff));
            world.air.push_back(end);
            world.air.push_back((tick + 5_500_000, AirEvent::FieldOn));
        }
        // Before the fault the listener has read some bytes of the frame into the buffer.
        dpr.run_to(tick + 4_750_000);
        let buffer_is_clean = |dpr: &mut Dpr<3>| {
            dpr.receiver.port().buffer.as_ref().is_some_and(|buffer| buffer.peek() == &[0; RECEIVE_WORDS])
        };
        assert!(!buffer_is_clean(&mut dpr), "{lost:?}: the frame has been read in part");
        dpr.world.borrow_mut().stuck = matches!(lost, Lost::WithTheSpi);
        dpr.run_to(tick + 2 * CYCLE_NS);
        // If the field is lost during a frame, the receiver may also report the end of a shorter frame.
        assert_eq!(dpr.telemetry.rf_faults.get() + dpr.telemetry.wrong_length.get(), 1, "{lost:?}");
        assert!(buffer_is_clean(&mut dpr), "{lost:?}: what is received into next is a scrubbed buffer");
        assert_eq!(dpr.profile(dpr.published() - 1), [0; Profile::<3>::SIZE], "{lost:?}");
        dpr.send_cycle(6);
        dpr.run_to(tick + 3 * CYCLE_NS);
        assert_eq!(dpr.profile(dpr.published() - 1), profile_at::<3>(timestamp(6)).as_bytes(), "{lost:?}");
        assert!(dpr.receiver.port().always_clean, "{lost:?}");
    }
}

#[test]
fn a_transfer_that_never_ends_costs_a_bring_up_and_no_more() {
    let mut dpr = Dpr::<1>::in_sequence(ReadMode::WhileFilling);
    let tick = FIRST_TICK_NS + 4 * CYCLE_NS;
    dpr.world.borrow_mut().stuck = true;
    dpr.send_cycle(4);
    dpr.run_to(tick + 6 * CYCLE_NS);
    let lost = dpr.front_ends.iter().filter(|state| matches!(state, FrontEnd::Lost(_))).count();
    assert_eq!((lost, dpr.telemetry.rf_recoveries.get()), (1, 1), "{:?}", dpr.front_ends);
    assert_eq!(dpr.front_ends.last(), Some(&FrontEnd::Listening { field: true }));
    let before = dpr.published();
    for cycle in 10..14 {
        dpr.send_cycle(cycle);
    }
    dpr.run_to(FIRST_TICK_NS + 14 * CYCLE_NS);
    assert_eq!(dpr.published(), before + 4);
    assert_eq!(dpr.profile(before + 3), profile_at::<1>(timestamp(13)).as_bytes());
    assert!(dpr.receiver.port().always_clean);
}

#[test]
fn a_lost_field_and_its_return_need_no_help() {
    let mut dpr = Dpr::<1>::new(ReadMode::WhileFilling);
    dpr.world.borrow_mut().air.push_back((FIRST_TICK_NS, AirEvent::FieldOff));
    dpr.world.borrow_mut().air.push_back((FIRST_TICK_NS + CYCLE_NS, AirEvent::FieldOn));
    for cycle in 2..6 {
        dpr.send_cycle(cycle);
    }
    dpr.run_to(FIRST_TICK_NS + 6 * CYCLE_NS);
    assert_eq!(dpr.profile(dpr.published() - 1), profile_at::<1>(timestamp(5)).as_bytes());
    assert_eq!(dpr.telemetry.rf_faults.get(), 0);
    assert_eq!(dpr.telemetry.field_losses.get(), 1);
    assert_eq!(dpr.front_ends.last(), Some(&FrontEnd::Listening { field: true }));
}

#[test]
fn a_missing_field_is_told_from_air_that_loses_frames() {
    for field in [false, true] {
        let mut dpr = Dpr::<1>::in_sequence(ReadMode::WhileFilling);
        let tick = FIRST_TICK_NS + 4 * CYCLE_NS;
        assert_eq!(dpr.front_ends.last(), Some(&FrontEnd::Listening { field: true }));
        if !field {
            dpr.world.borrow_mut().air.push_back((tick, AirEvent::FieldOff));
        }
        dpr.run_to(tick + 3 * CYCLE_NS);
        let last = dpr.front_ends.last().copied();
        assert_eq!(last, Some(FrontEnd::Listening { field }));
        assert_eq!(last.map(FrontEnd::senses_no_field), Some(!field));
    }
    assert!(FrontEnd::Starting.senses_no_field() && !FrontEnd::Lost(Fault::Bus).senses_no_field());
}

#[test]
fn a_frame_that_ends_during_a_status_read_keeps_its_instant() {
    // A damaged LEN moves the listener's status reads by whole bytes. A wrong bit rate moves the frame's end relative
    // to these reads. So with some combinations a status read finds that the frame has ended.
    let mut met = 0;
    for (more, slow) in (4..=12).flat_map(|more| (0..10).map(move |slow| (more, slow))) {
        let mut dpr = Dpr::<1>::in_sequence(ReadMode::WhileFilling);
        let sent = profile_at::<1>(timestamp(4));
        let slot_us = air::send_slot_us::<1>(0).expect("the first frame");
        let at = FIRST_TICK_NS + 4 * CYCLE_NS + 1_000 * u64::from(slot_us);
        dpr.world.borrow_mut().send(at, sent.as_bytes(), |data| data[0] += more);
        {
            // The frame's bit rate is wrong by some tenths of a percent. Each tenth shifts the frame's end by 2.5 µs.
            let longer = |span: u64| span + span / 1_000 * slow;
            let mut world = dpr.world.borrow_mut();
            for (instant, event) in &mut world.air {
                match event {
                    AirEvent::FrameStart(start) => start.bit_as = longer(start.bit_as),
                    _ => *instant = at + longer(*instant - at),
                }
            }
        }
        let met_before = dpr.world.borrow().rises_in_status_reads;
        dpr.run_to(at + 5_000_000);
        met += dpr.world.borrow().rises_in_status_reads - met_before;
        assert_eq!(dpr.profile(4), sent.as_bytes(), "LEN + {more}, {slow}");
        // The reported age counts from the frame's end. If it counted from the sync, it would be 2.4 ms greater.
        let (published, _) = dpr.album.published[4];
        let age_100us = (published - (FIRST_TICK_NS + 4 * CYCLE_NS)) / 100_000;
        assert!(u64::from(dpr.link().age_100us).abs_diff(age_100us) <= 1, "LEN + {more}, {slow}: {:?}", dpr.link());
    }
    assert!(met > 0, "no status read met the end of a frame");
}

#[test]
fn a_register_that_loses_a_bit_is_reported_before_a_bring_up() {
    let mut dpr = Dpr::<3>::in_sequence(ReadMode::WhileFilling);
    dpr.world.borrow_mut().chip.flip(Space::B, 0x0C, 6);
    for cycle in 4..40 {
        dpr.send_cycle(cycle);
    }
    dpr.run_to(FIRST_TICK_NS + CYCLE_NS * 40);
    let fault = Fault::Register { address: 0x4C, expected: 0x54, found: 0x14 };
    assert!(dpr.front_ends.contains(&FrontEnd::Lost(fault)), "{:?}", dpr.front_ends);
    assert!(FrontEnd::Lost(fault).is_out_of_order());
    assert_eq!(dpr.telemetry.rf_register.get(), 0x004C_5414);
    assert_eq!(dpr.front_end, FrontEnd::Listening { field: true });
    assert_eq!(dpr.profile(dpr.published() - 1), profile_at::<3>(timestamp(39)).as_bytes());
}

#[test]
fn a_front_end_that_hears_nothing_says_so_until_a_frame_comes() {
    for field in [true, false] {
        let mut dpr = Dpr::<1>::in_sequence(ReadMode::WhileFilling);
        let silent_from = FIRST_TICK_NS + 4 * CYCLE_NS;
        if !field {
            dpr.world.borrow_mut().air.push_back((silent_from, AirEvent::FieldOff));
        }
        dpr.run_to(silent_from + 450_000_000);
        assert_eq!((dpr.front_end, dpr.telemetry.rf_silences.get()), (FrontEnd::Listening { field }, 0));
        // After 0.5 s of silence the front end is brought up anew, and again after another second. It counts as lost
        // until it receives a frame.
        dpr.run_to(silent_from + 600_000_000);
        let silence = FrontEnd::Lost(Fault::Silence { field });
        assert_eq!((dpr.front_end, dpr.telemetry.rf_silences.get()), (silence, 1), "field: {field}");
        assert_eq!((silence.is_out_of_order(), silence.senses_no_field()), (field, !field));
        dpr.run_to(silent_from + 1_700_000_000);
        assert_eq!((dpr.front_end, dpr.telemetry.rf_silences.get()), (silence, 2), "field: {field}");
        dpr.world.borrow_mut().air.push_back((silent_from + 1_700_000_000, AirEvent::FieldOn));
        for cycle in 180..184 {
            dpr.send_cycle(cycle);
        }
        dpr.run_to(FIRST_TICK_NS + 185 * CYCLE_NS);
        assert_eq!((dpr.front_end, dpr.telemetry.rf_silences.get()), (FrontEnd::Listening { field: true }, 2));
        assert_eq!(dpr.telemetry.rf_faults.get(), 0);
    }
}
