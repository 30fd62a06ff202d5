//! Tests the functions that the hold's tasks call, without an MCU, on a model of the front end's chip.
//!
//! Time is virtual. A byte on the SPI takes 1 µs (8 MHz). The hold's tasks take no time, but wait while HORUS's tasks
//! run.

use std::{cell::RefCell, collections::VecDeque, ops::Range, rc::Rc};

use dpr_fw::{
    hold::{AnswerPort, Budget, HoldTelemetry, Responder, Shared, ANSWER_US},
    rf::{FrontEndPort, LEAD},
    triple::{Filling, Rotation},
    ReceiveMemory, RECEIVE_WORDS,
};
use profile::{
    air::air_time_ns,
    criticality::{ActiveLoad, BaseStation, FlightController, Writer},
    hold::{Answer, ANSWER_WINDOW_US},
    HoldStatus, HoldValues, ReportedPosition, ReportedValues, Uplink, UplinkStatus, UplinkValues,
};
use rtic_core::Mutex;
use st25r3916::{
    command,
    executor::{Failed, Port},
    Answerer, Short,
};
use st25r3916_model::{nfc_f, AirEvent, Chip, Chunk, Config, FrameStart, Technology};

const US: u64 = 1_000;
const MS: u64 = 1_000 * US;
const BYTE_NS: u64 = US;
/// The time of one bit at 424 kbit/s, which is 32 periods of 13.56 MHz, in attoseconds.
const BIT_AS: u64 = 2_359_882_005_899;
/// The time between two calls that make the tasks check in, ns.
const CHECK_IN: u64 = 10 * MS;
/// The time from which on the chip receives frames, ns.
const READY: u64 = 60 * MS;
/// The time from the last clock of the transmit command to the answer's first bit, ns.
const LATENCY: u64 = 3_650;

/// An SPI transfer in progress, or one that begins at `start`.
struct Transfer {
    mosi: Vec<u8>,
    miso: Vec<u8>,
    start: u64,
}

impl Transfer {
    fn next(&self) -> Option<u64> {
        let done = self.miso.len() as u64;
        (self.miso.len() < self.mosi.len()).then(|| self.start + (done + 1) * BYTE_NS)
    }
}

struct World {
    chip: Chip,
    now: u64,
    air: VecDeque<(u64, AirEvent)>,
    transfer: Option<Transfer>,
    /// Whether SPI transfers hang: they do not end and cannot be stopped.
    stuck: bool,
    irq: bool,
    irq_rose: u64,
    /// The time of each answer's first bit, and the answer's payload.
    answers: Vec<(u64, Vec<u8>)>,
}

impl World {
    fn advance(&mut self, to: u64) {
        self.now = to;
        self.chip.advance(to);
        while let Some((at, event)) = self.air.pop_front_if(|(at, _)| *at <= to) {
            self.chip.hear(at, &event);
        }
        if let Some(transfer) = self.transfer.as_mut().filter(|transfer| transfer.next().is_some_and(|at| at <= to)) {
            transfer.miso.push(self.chip.transfer(to, transfer.mosi[transfer.miso.len()]));
            if transfer.next().is_none() {
                self.chip.deselect(to);
            }
        }
        if self.chip.irq() && !std::mem::replace(&mut self.irq, self.chip.irq()) {
            self.irq_rose = to;
        }
        self.irq = self.chip.irq();
        for (at, event) in self.chip.take_air() {
            match event {
                AirEvent::FrameStart(start) => {
                    assert!(start.load_modulation, "the chip makes no field of its own");
                    self.answers.push((at, start.chunk.data));
                }
                AirEvent::Bytes(chunk) => self.answers.last_mut().expect("an answer has begun").1.extend(chunk.data),
                _ => {}
            }
        }
    }

    /// Sends a frame whose first bit is on the air at time `at`. Returns the time of the frame's last bit.
    fn send(&mut self, at: u64, payload: &[u8]) -> u64 {
        let mut data = vec![payload.len() as u8 + 1];
        data.extend(payload);
        data.extend(nfc_f(&data));
        let bits = 8 * data.len() as u32;
        let end = at + air_time_ns(payload.len() as u8);
        let start = FrameStart {
            technology: Technology::NfcF,
            bits_per_second: 424_000,
            bit_as: BIT_AS,
            header_bits: 64,
            byte_bits: 8,
            load_modulation: false,
            chunk: Chunk { data, parity_error: false },
        };
        self.air.extend([(at, AirEvent::FrameStart(start)), (end, AirEvent::FrameEnd { bits })]);
        end
    }
}

struct SimPort {
    world: Rc<RefCell<World>>,
    buffer: Option<Filling<ReceiveMemory>>,
    read: Option<(usize, usize)>,
    response: Vec<u8>,
    timer: u64,
    answer: Vec<u8>,
    armed: Option<u64>,
    resting: bool,
    broken: bool,
    carried: u32,
}

impl SimPort {
    fn start(&mut self, mosi: Vec<u8>, start: u64) {
        self.carried += mosi.len() as u32;
        let mut world = self.world.borrow_mut();
        let now = world.now;
        world.chip.select(now);
        world.transfer = Some(Transfer { mosi, miso: vec![], start });
    }

    fn now(&self) -> u64 {
        self.world.borrow().now
    }
}

impl Port for SimPort {
    fn start_short(&mut self, short: &Short) {
        if self.armed.is_none() {
            self.read = None;
            self.start(short.bytes().to_vec(), self.now());
        }
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        self.read = None;
        let mut mosi = vec![command::FIFO_LOAD];
        mosi.extend(&self.answer[offset..offset + len]);
        self.start(mosi, self.now());
        true
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        self.read = Some((offset, len));
        let mut mosi = vec![0; len + 1];
        mosi[0] = command::FIFO_READ;
        self.start(mosi, self.now());
        true
    }

    fn ended(&mut self) -> bool {
        let mut world = self.world.borrow_mut();
        if world.stuck {
            return false;
        }
        let Some(transfer) = world.transfer.take_if(|transfer| transfer.next().is_none()) else { return false };
        self.armed = None;
        self.response = transfer.miso;
        if let Some((offset, len)) = self.read {
            self.response.remove(0);
            let words = self.buffer.as_mut().expect("the buffer is here").memory();
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(words.as_mut_slice());
            bytes[LEAD + offset..LEAD + offset + len].copy_from_slice(&self.response);
        } else if transfer.mosi[0] == command::FIFO_LOAD {
            self.response.clear();
        }
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        Ok(&self.response)
    }

    fn abort(&mut self) {
        self.broken = self.world.borrow().stuck;
        let mut world = self.world.borrow_mut();
        let now = world.now;
        world.transfer = None;
        world.chip.deselect(now);
        self.armed = None;
    }

    fn irq_is_high(&mut self) -> bool {
        self.world.borrow().irq
    }

    fn start_timer(&mut self, us: u32) {
        let from = self.armed.map_or(self.now(), |armed| armed.max(self.now()));
        self.timer = from + u64::from(us) * US;
    }

    fn elapsed(&mut self) -> bool {
        self.now() >= self.timer
    }
}

impl FrontEndPort for SimPort {
    type Buffer = ReceiveMemory;

    fn irq_edge_us(&mut self) -> u32 {
        (self.world.borrow().irq_rose / US) as u32
    }

    fn exchange(&mut self, with: impl FnOnce(Filling<ReceiveMemory>) -> Filling<ReceiveMemory>) {
        assert!(!self.broken, "the buffer may still be written");
        assert!(self.world.borrow().transfer.is_none(), "the buffer is being written");
        self.buffer = self.buffer.take().map(with);
        let clean = self.buffer.as_ref().is_some_and(|buffer| buffer.peek() == &[0; RECEIVE_WORDS]);
        assert!(clean, "a frame is received over old data");
    }

    fn arrived(&self, _len: usize) -> &[u8] {
        unreachable!("no frame of the hold is looked at while it arrives")
    }
}

impl AnswerPort for SimPort {
    fn now_us(&mut self) -> u32 {
        (self.now() / US) as u32
    }

    fn put(&mut self, answer: &Answer) {
        self.answer = answer.as_bytes().to_vec();
    }

    fn arm(&mut self, at_us: u32) -> bool {
        let at = u64::from(at_us) * US;
        if at <= self.now() {
            return false;
        }
        self.read = None;
        self.start(Answerer::transmit().bytes().to_vec(), at);
        self.armed = Some(at);
        true
    }

    fn park(&mut self) {}

    fn rest(&mut self) {
        self.resting = true;
    }

    fn wake(&mut self) {
        self.resting = false;
    }

    fn take_carried(&mut self) -> u32 {
        std::mem::take(&mut self.carried)
    }

    fn is_broken(&self) -> bool {
        self.broken
    }
}

struct Own<'a>(&'a mut Shared);

impl Mutex for Own<'_> {
    type T = Shared;

    fn lock<R>(&mut self, with: impl FnOnce(&mut Shared) -> R) -> R {
        with(self.0)
    }
}

struct Dpr {
    world: Rc<RefCell<World>>,
    responder: Responder<SimPort>,
    shared: Shared,
    telemetry: HoldTelemetry,
    next_check_in: u64,
    /// The periods in which HORUS's tasks run, so that the hold's tasks wait.
    busy: Vec<Range<u64>>,
    called: bool,
    /// The time between two edges of a faulty IRQ line, each of which calls a task; `None` for a good line.
    babble: Option<u64>,
    calls: u32,
}

impl Dpr {
    fn new() -> Self {
        let world = Rc::new(RefCell::new(World {
            chip: Chip::new(Config { vdd_mv: 5_000, answers: true, transmit_scatter_ns: 0, ..Config::default() }),
            now: 0,
            air: VecDeque::from([(40 * MS, AirEvent::FieldOn)]),
            transfer: None,
            stuck: false,
            irq: false,
            irq_rose: 0,
            answers: vec![],
        }));
        let (buffer, rotation, _) = Rotation::new([[0xA5A5_A5A5; RECEIVE_WORDS]; 3]);
        let port = SimPort {
            world: world.clone(),
            buffer: Some(buffer),
            read: None,
            response: vec![],
            timer: u64::MAX,
            answer: vec![],
            armed: None,
            resting: false,
            broken: false,
            carried: 0,
        };
        let mut dpr = Self {
            world,
            responder: Responder::start(port, rotation, 0),
            shared: Shared::new(),
            telemetry: HoldTelemetry::new(),
            next_check_in: CHECK_IN,
            busy: vec![],
            called: false,
            babble: None,
            calls: 0,
        };
        dpr.run_to(READY);
        assert_eq!(dpr.telemetry.bring_ups.get(), 1);
        dpr
    }

    fn serve(&mut self) {
        self.calls += 1;
        let world = self.world.clone();
        let now_us = || (world.borrow().now / US) as u32;
        self.responder.serve(Own(&mut self.shared), now_us, &self.telemetry);
    }

    fn run_to(&mut self, end: u64) {
        loop {
            let (now, next) = {
                let world = self.world.borrow();
                let transfer = world.transfer.as_ref().filter(|_| !world.stuck).and_then(Transfer::next);
                let air = world.air.front().map(|(at, _)| *at);
                let babble = self.babble.map(|every| (world.now / every + 1) * every);
                let busy = self.busy.first().map(|busy| busy.end);
                let next = [transfer, air, world.chip.next_event(), babble, busy, Some(self.next_check_in)];
                (world.now, next.into_iter().flatten().min().expect("there is a next call").max(world.now))
            };
            let timer = Some(self.responder.port().timer).filter(|at| *at > now);
            let next = timer.map_or(next, |at| at.min(next)).min(end);
            let was_high = self.world.borrow().irq;
            self.world.borrow_mut().advance(next);
            let world = self.world.borrow();
            let ended = !world.stuck && world.transfer.as_ref().is_some_and(|transfer| transfer.next().is_none());
            let by_front_end = ended
                || world.irq && !was_high
                || self.responder.port().timer == next
                || self.babble.is_some_and(|every| next.is_multiple_of(every));
            drop(world);
            self.called |= by_front_end && !self.responder.port().resting;
            self.busy.retain(|busy| busy.end > next);
            let waits = self.busy.first().is_some_and(|busy| busy.contains(&next));
            if next >= self.next_check_in {
                self.next_check_in += CHECK_IN;
                self.called = true;
            }
            if self.called && !waits {
                self.called = false;
                self.serve();
            }
            if next >= end {
                return;
            }
        }
    }

    /// Sends a frame now and waits until the end of its answer. Returns the time of the frame's last bit.
    fn send(&mut self, payload: &[u8]) -> u64 {
        let now = self.world.borrow().now;
        let end = self.world.borrow_mut().send(now + 10 * US, payload);
        self.run_to(end + 8 * MS);
        end
    }

    fn now(&self) -> u64 {
        self.world.borrow().now
    }

    fn answers(&self) -> Vec<(u64, Vec<u8>)> {
        std::mem::take(&mut self.world.borrow_mut().answers)
    }

    /// Asserts that the next frame is answered at the right time, and that the answer has no uplink.
    fn is_answered(&mut self, timestamp: u32) {
        let end = self.send(object(timestamp).as_bytes());
        let answers = self.answers();
        assert_eq!(answers.len(), 1);
        assert_eq!(payload(&answers[0]), [0; Answer::SIZE]);
        is_at_its_instant(&answers[0], end);
    }
}

fn object(timestamp: u32) -> HoldStatus {
    HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(timestamp))
}

fn payload((_, data): &(u64, Vec<u8>)) -> &[u8] {
    let (frame, crc) = data.split_at(data.len() - 2);
    assert_eq!((crc, usize::from(frame[0])), (&nfc_f(frame)[..], frame.len()));
    &frame[1..]
}

/// Asserts that an answer begins the right time after the frame that ended at `end`. The tolerance covers two bits
/// until the chip reports the frame's end, and the port's counter, which counts whole microseconds.
fn is_at_its_instant((at, _): &(u64, Vec<u8>), end: u64) {
    let command = at - LATENCY - BYTE_NS;
    let after = command - end - u64::from(ANSWER_US) * US;
    assert!((3_700..=4_800).contains(&after), "{after} ns");
    assert!(at - end <= u64::from(ANSWER_WINDOW_US) * US);
}

#[test]
fn an_accepted_frame_is_answered_with_both_uplinks() {
    let mut dpr = Dpr::new();
    let values = UplinkValues { timestamp: 9, status: UplinkStatus::from_bits(3), payload: [0x42; Uplink::PAYLOAD] };
    let base_station = Uplink::seal(Writer::<BaseStation>::claim(), &values);
    let flight_controller = Uplink::seal(Writer::<FlightController>::claim(), &values);
    dpr.shared.keep::<BaseStation>(&base_station, Some(dpr.now() / US));
    dpr.shared.keep::<FlightController>(&flight_controller, Some(dpr.now() / US));
    let end = dpr.send(object(100).as_bytes());
    let answers = dpr.answers();
    assert_eq!(payload(&answers[0]), [*base_station.as_bytes(), *flight_controller.as_bytes()].as_flattened());
    is_at_its_instant(&answers[0], end);
    assert_eq!((answers.len(), dpr.telemetry.answers.get(), dpr.telemetry.accepted.get()), (1, 1, 1));
    assert_eq!(dpr.world.borrow().chip.reports(), []);
}

#[test]
fn a_frame_is_read_after_its_end_in_few_calls() {
    let mut dpr = Dpr::new();
    let before = dpr.calls;
    dpr.is_answered(100);
    // The driver reads the frame only after its end, which takes fewer calls than reading it while it arrives.
    assert!(dpr.calls - before <= 25, "{} calls", dpr.calls - before);
}

#[test]
fn a_frame_that_is_given_up_leaves_a_clean_buffer() {
    let mut dpr = Dpr::new();
    let first = |dpr: &mut Dpr, word| {
        let buffer = dpr.responder.port().buffer.as_mut().expect("the buffer is here");
        std::mem::replace(&mut buffer.memory()[0], word)
    };
    // The receive buffer holds a word of a frame that was read only in part.
    first(&mut dpr, 0x5A5A_5A5A);
    let scrubs = dpr.telemetry.scrubs.get();
    dpr.send(&[]);
    assert_eq!(dpr.telemetry.scrubs.get() - scrubs, 1);
    assert_eq!((dpr.telemetry.frames.get(), dpr.telemetry.faults.get()), (0, 1), "too short for a frame");
    assert_eq!(first(&mut dpr, 0), 0);
    dpr.is_answered(200);
}

#[test]
fn the_answer_keeps_its_instant_whenever_horus_has_work() {
    let mut dpr = Dpr::new();
    for (timestamp, from_us) in (0_u64..3_600).step_by(150).enumerate() {
        // HORUS's tasks run for 0.4 ms at any time around the frame's end, longer than they ever do in the DPR.
        let from = dpr.now() + MS + from_us * US;
        dpr.busy.push(from..from + 400 * US);
        dpr.is_answered(timestamp as u32);
        dpr.run_to(dpr.now() + 90 * MS);
    }
    assert_eq!(dpr.telemetry.faults.get() + dpr.telemetry.answers_missed.get(), 0);
}

#[test]
fn an_answer_that_is_not_ready_in_time_is_given_up() {
    let mut dpr = Dpr::new();
    let from = dpr.now() + MS;
    dpr.busy.push(from..from + 3 * MS);
    dpr.send(object(100).as_bytes());
    assert_eq!(dpr.answers(), []);
    assert_eq!((dpr.telemetry.accepted.get(), dpr.telemetry.answers_missed.get()), (1, 1));
    dpr.is_answered(200);
}

#[test]
fn frames_that_are_no_new_object_of_a_hold_get_no_answer() {
    let mut dpr = Dpr::new();
    dpr.is_answered(100);
    let horus = *ReportedPosition::seal(&ReportedValues::absent(200)).as_bytes();
    let mut damaged = *object(200).as_bytes();
    damaged[30] ^= 1;
    for frame in [&horus[..], &damaged, object(100).as_bytes(), &[0; 64], &[1], &[0xA5; 254]] {
        dpr.send(frame);
        assert_eq!(dpr.answers(), []);
    }
    assert_eq!((dpr.telemetry.frames.get(), dpr.telemetry.rejected.get()), (7, 6));
    dpr.is_answered(200);
}

#[test]
fn frames_at_every_opportunity_are_served_within_the_budget() {
    let mut dpr = Dpr::new();
    let begin = dpr.now();
    let mut at = begin;
    for number in 0..1_500_u32 {
        let payload = object(number);
        let len = if number % 3 == 0 { 64 } else { 1 + number as usize % 60 };
        at = dpr.world.borrow_mut().send(at + 20 * US, &payload.as_bytes()[..len]);
    }
    let before = dpr.calls;
    dpr.run_to(at);
    let windows = ((at - begin) / MS) as u32 * 1_000 / Budget::WINDOW_US + 1;
    // Calls that only make the tasks check in are not bounded by the budget.
    let most = windows * (Budget::CALLS + 1) + ((at - begin) / CHECK_IN) as u32;
    assert!(windows > 5 && dpr.calls - before <= most, "{} calls in {windows} windows", dpr.calls - before);
    assert!(dpr.telemetry.rests.get() + 1 >= windows && dpr.telemetry.calls_most.get() <= Budget::CALLS);
    // The call that uses the budget up may begin one more transfer, of a whole frame at most.
    assert!(dpr.telemetry.bytes_most.get() < Budget::BYTES + 258);
    dpr.answers();
    dpr.run_to(at + 200 * MS);
    dpr.is_answered(1_000_000);
}

#[test]
fn a_babbling_irq_line_is_served_within_the_budget() {
    let mut dpr = Dpr::new();
    dpr.babble = Some(3 * US);
    let before = dpr.calls;
    dpr.run_to(READY + 500 * MS);
    assert!(dpr.calls - before <= 6 * (Budget::CALLS + 1) + 50, "{} calls", dpr.calls - before);
    dpr.babble = None;
    dpr.run_to(READY + 700 * MS);
    dpr.is_answered(100);
}

#[test]
fn an_spi_that_does_not_stop_ends_the_port_and_nothing_else() {
    let mut dpr = Dpr::new();
    dpr.is_answered(100);
    dpr.world.borrow_mut().stuck = true;
    dpr.run_to(READY + 200 * MS);
    assert_eq!((dpr.telemetry.out_of_use.get(), dpr.responder.port().resting), (1, true));
    let before = dpr.calls;
    dpr.world.borrow_mut().stuck = false;
    dpr.run_to(READY + 400 * MS);
    assert_eq!(dpr.calls - before, 20, "only the calls to check in are left");
    dpr.send(object(200).as_bytes());
    assert_eq!((dpr.telemetry.frames.get(), dpr.answers()), (1, vec![]));
}
