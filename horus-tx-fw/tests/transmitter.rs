//! Tests the transmitter on the model of the chip: every slot of a cycle in virtual time, byte by byte on the SPI.

use horus_tx_fw::{
    cycle::Cycle,
    receiver::Solution,
    telemetry::Telemetry,
    timing::{payload, timestamp, SLOT_US},
    transmitter::{self, Slot, Ticket, Transmitter},
    FRAMES, RECEIVERS,
};
use std::ops::Range;

use profile::{air, Object, Profile};
use st25r3916::{
    executor::{Failed, Port},
    poller::{rest_within_us, HEAD},
    PollerConfig, Short,
};
use st25r3916_model::{AirEvent, Chip, Config, Space};

const BYTE_NS: u64 = 889;
/// The time of a transfer's start and end, ns: an interrupt and its handler.
const OVERHEAD_NS: u64 = 2_000;
const CYCLE_NS: u64 = 10_000_000;

struct Transfer {
    out: Vec<u8>,
    into: Vec<u8>,
    keep: bool,
    next_at: u64,
}

/// The hardware of the model, as the interrupts access it: chip, SPI, one-shot timer and ticket.
struct Bench {
    now: u64,
    chip: Chip,
    transfer: Option<Transfer>,
    response: Vec<u8>,
    timer: u64,
    ticket: Ticket,
    profile: Vec<u8>,
    frame: Range<usize>,
    hang: bool,
    aborted: u32,
    rest_late_ns: u64,
}

impl Bench {
    fn new(config: Config) -> Self {
        Self {
            now: 0,
            chip: Chip::new(Config { transmit_scatter_ns: 0, ..config }),
            transfer: None,
            response: Vec::new(),
            timer: 0,
            ticket: Ticket::NONE,
            profile: Vec::new(),
            frame: 0..0,
            hang: false,
            aborted: 0,
            rest_late_ns: 0,
        }
    }

    fn begin(&mut self, out: Vec<u8>, keep: bool) {
        assert!(self.transfer.is_none(), "one transfer at a time");
        assert!(self.ticket == Ticket::NONE, "the SPI is the slot's while a ticket is out");
        self.chip.select(self.now);
        self.transfer = Some(Transfer { out, into: Vec::new(), keep, next_at: self.now + OVERHEAD_NS / 2 + BYTE_NS });
    }
}

impl Port for Bench {
    fn start_short(&mut self, short: &Short) {
        self.begin(short.bytes().to_vec(), true);
    }
    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let mut out = vec![0x80];
        out.extend(&self.profile[self.frame.clone()][offset..offset + len]);
        self.begin(out, false);
        if let (Some(transfer), true) = (&mut self.transfer, len > HEAD) {
            transfer.next_at += self.rest_late_ns;
        }
        true
    }
    fn ended(&mut self) -> bool {
        let now = self.now;
        let is_over = |transfer: &mut Transfer| transfer.into.len() == transfer.out.len() && transfer.next_at <= now;
        let Some(transfer) = self.transfer.take_if(is_over).filter(|_| !self.hang) else { return false };
        self.chip.deselect(now);
        self.response = if transfer.keep { transfer.into } else { Vec::new() };
        true
    }
    fn response(&self) -> Result<&[u8], Failed> {
        Ok(&self.response)
    }
    fn abort(&mut self) {
        self.transfer = None;
        self.hang = false;
        self.aborted += 1;
        self.chip.deselect(self.now);
    }
    fn irq_is_high(&mut self) -> bool {
        self.chip.irq()
    }
    fn start_timer(&mut self, us: u32) {
        self.timer = self.now + u64::from(us) * 1_000;
    }
    fn elapsed(&mut self) -> bool {
        self.now >= self.timer
    }
}

impl transmitter::FrontEndPort for Bench {
    fn deposit(&mut self, profile: &Profile<RECEIVERS>) {
        assert!(self.transfer.as_ref().is_none_or(|transfer| transfer.keep), "the bytes under a load do not change");
        self.profile = profile.as_bytes().to_vec();
    }
    fn point_at(&mut self, frame: Range<usize>) {
        self.frame = frame;
    }
    fn arm(&mut self, ticket: Ticket) {
        assert!(self.transfer.is_none());
        self.ticket = ticket;
    }
    fn disarm(&mut self) -> bool {
        std::mem::replace(&mut self.ticket, Ticket::NONE) != Ticket::NONE
    }
}

struct Sent {
    at: u64,
    payload: Vec<u8>,
}

/// Runs `cycles` ticks and returns the frames that were on the air. `before` is called before the profile of each tick
/// is offered. It returns how late the offer is, ns after the tick.
fn run(cycles: u32, telemetry: &Telemetry, before: impl FnMut(u32, &mut Bench) -> u64) -> (Vec<Sent>, Bench) {
    run_on(Config::default(), cycles, telemetry, before)
}

fn run_on(
    config: Config,
    cycles: u32,
    telemetry: &Telemetry,
    mut before: impl FnMut(u32, &mut Bench) -> u64,
) -> (Vec<Sent>, Bench) {
    let mut transmitter = Transmitter::start(PollerConfig::new(), telemetry, Bench::new(config));
    let cycle = Cycle::new();
    let mut sent: Vec<Sent> = Vec::new();
    // The queue holds the slots and the offer of the present tick, each with its instant.
    let mut due: Vec<(u64, Option<usize>)> = Vec::new();
    let mut tick = 0;
    let mut next_tick = CYCLE_NS;
    let mut irq = false;
    while tick < cycles || transmitter.port().now < u64::from(cycles) * CYCLE_NS + CYCLE_NS - 1 {
        let bench = transmitter.port();
        let transfer = bench.transfer.as_ref().filter(|_| !bench.hang).map_or(u64::MAX, |transfer| transfer.next_at);
        let at = [
            transfer,
            Some(bench.timer).filter(|timer| *timer > bench.now).unwrap_or(u64::MAX),
            next_tick,
            due.first().map_or(u64::MAX, |(at, _)| *at),
            bench.chip.next_event().unwrap_or(u64::MAX),
        ]
        .into_iter()
        .min()
        .expect("five instants");
        bench.now = at;
        bench.chip.advance(at);
        if next_tick == at {
            tick += 1;
            next_tick += CYCLE_NS;
            let late = before(tick, bench);
            due = SLOT_US.iter().enumerate().map(|(frame, us)| (at + u64::from(*us) * 1_000, Some(frame))).collect();
            due.push((at + late, None));
            due.sort_unstable();
        } else if due.first().is_some_and(|(when, _)| *when == at) {
            match due.remove(0) {
                (_, Some(frame)) => {
                    let fired = bench.ticket.due(tick, frame).map(|command| {
                        bench.ticket = Ticket::NONE;
                        bench.chip.select(at);
                        let response = bench.chip.transfer(at + BYTE_NS, command);
                        bench.chip.deselect(at + BYTE_NS);
                        response
                    });
                    if fired.is_none() {
                        telemetry.frames_skipped.add(1);
                    }
                    transmitter.slot(Slot { frame, fired });
                }
                (_, None) => {
                    let profile = cycle.fill(tick, &[Solution::default(); RECEIVERS]);
                    transmitter.offer(tick, &profile);
                }
            }
        } else if transfer == at {
            let transfer = bench.transfer.as_mut().expect("it is due");
            if transfer.into.len() < transfer.out.len() {
                let byte = transfer.out[transfer.into.len()];
                transfer.into.push(bench.chip.transfer(at, byte));
                transfer.next_at =
                    at + if transfer.into.len() < transfer.out.len() { BYTE_NS } else { OVERHEAD_NS / 2 };
            } else {
                transmitter.poll();
            }
        } else if bench.timer == at {
            transmitter.poll();
        }
        let bench = transmitter.port();
        let rises = bench.chip.irq() && !irq;
        if rises {
            transmitter.poll();
        }
        let bench = transmitter.port();
        irq = bench.chip.irq();
        for (at, event) in bench.chip.take_air().collect::<Vec<_>>() {
            match event {
                AirEvent::FrameStart(start) => sent.push(Sent { at, payload: start.chunk.data }),
                AirEvent::Bytes(chunk) => sent.last_mut().expect("it has started").payload.extend(chunk.data),
                AirEvent::FrameEnd { bits } => {
                    let frame = sent.last_mut().expect("it has started");
                    assert!(frame.payload.len() * 8 >= bits as usize);
                    frame.payload.truncate(bits as usize / 8);
                    let end = frame.payload.len().saturating_sub(2).max(1);
                    frame.payload = frame.payload[1..end].to_vec();
                }
                AirEvent::FieldOn | AirEvent::FieldOff => {}
            }
        }
    }
    let bench = std::mem::replace(transmitter.port(), Bench::new(Config::default()));
    (sent, bench)
}

fn is_whole(frame: &Sent) -> bool {
    let objects = air::objects::<RECEIVERS>(&frame.payload);
    objects.is_ok_and(|mut objects| objects.all(|(index, bytes)| Object::verify(index, bytes).is_ok()))
}

/// Asserts that every object of `frame` is intact and belongs to the frame's cycle. Returns the cycle, and the frame's
/// number in it.
fn check(frame: &Sent) -> (u32, usize) {
    let tick = (frame.at / CYCLE_NS) as u32;
    let place = air::place::<RECEIVERS>(&frame.payload).expect("a length that a frame has");
    for (index, bytes) in air::objects::<RECEIVERS>(&frame.payload).expect("whole objects") {
        let object = Object::verify(index, bytes).unwrap_or_else(|rejection| panic!("{rejection:?} in cycle {tick}"));
        assert_eq!(object.timestamp(), timestamp(tick), "no frame is older than its cycle");
    }
    (tick, usize::from(place.first() > 0))
}

const PUNCTUAL: u64 = 50_000;

#[test]
fn every_cycle_after_bring_up_sends_its_own_profile_at_its_slots() {
    let telemetry = Telemetry::new();
    let (sent, bench) = run(50, &telemetry, |_, _| PUNCTUAL);
    let mut expected = Vec::new();
    for tick in 1..=50 {
        expected.extend((0..FRAMES).map(|frame| (tick, frame)));
    }
    // The front end's bring-up takes 6 ms, so the first cycle may or may not find the chip ready.
    let places: Vec<_> = sent.iter().map(check).collect();
    assert!(expected.ends_with(&places) && places.len() >= 49 * FRAMES, "{places:?}");
    let offsets: Vec<u64> = sent
        .iter()
        .zip(&places)
        .map(|(frame, (_, place))| frame.at % CYCLE_NS - u64::from(SLOT_US[*place]) * 1_000)
        .collect();
    assert!(offsets.iter().all(|offset| *offset == offsets[0]), "slot to air is a constant: {offsets:?}");
    assert_eq!(telemetry.frames_sent.get() as usize, sent.len());
    assert_eq!(telemetry.rf_faults.get(), 0);
    assert_eq!(telemetry.frames_skipped.get() as usize + sent.len(), 50 * FRAMES);
    assert!(bench.chip.reports().is_empty(), "{:?}", bench.chip.reports());
    for (frame, (_, place)) in sent.iter().zip(places) {
        assert_eq!(frame.payload.len(), payload(place));
    }
    for pair in sent.windows(2) {
        let end = pair[0].at + air::air_time_ns(pair[0].payload.len() as u8);
        assert!(pair[1].at >= end + 300_000, "the receiver has its 0.30 ms between any two frames");
    }
}

#[test]
fn a_profile_offered_too_late_for_its_slot_is_never_sent() {
    let telemetry = Telemetry::new();
    // The profile is offered so late that its slot passes while the frame's head is being loaded.
    let late = u64::from(SLOT_US[0]) * 1_000 - HEAD as u64 * BYTE_NS / 2;
    let (sent, _) = run(40, &telemetry, |tick, _| if tick == 20 || tick == 30 { late } else { PUNCTUAL });
    let places: Vec<_> = sent.iter().map(check).collect();
    for tick in 3..=40 {
        let first = tick != 20 && tick != 30;
        assert_eq!(places.contains(&(tick, 0)), first, "cycle {tick}");
        if FRAMES == 2 {
            assert!(places.contains(&(tick, 1)), "the other frame of cycle {tick} is in time");
        }
    }
    assert_eq!(telemetry.rf_faults.get(), 0, "being late is no fault of the chip's");
}

#[test]
fn a_frame_is_whole_if_its_rest_is_loaded_in_time() {
    let within_ns = u64::from(rest_within_us(9_000_000).expect("the SPI is the faster one")) * 1_000;
    // The driver allows for no delay from the command to the frame's first bit, although the model has a few µs.
    for (late_ns, dry) in [(within_ns - OVERHEAD_NS, false), (within_ns + 20_000, true)] {
        let telemetry = Telemetry::new();
        let (sent, bench) = run(40, &telemetry, |tick, bench| {
            bench.rest_late_ns = if tick == 20 { late_ns } else { 0 };
            PUNCTUAL
        });
        let whole = |tick: u32| sent.iter().any(|frame| (frame.at / CYCLE_NS) as u32 == tick && is_whole(frame));
        assert_eq!((whole(20), telemetry.fifo_errors.get() > 0), (!dry, dry), "{late_ns} ns late");
        assert!(whole(19) && (22..=40).all(whole), "only the frame that ran dry is lost");
        assert!((u32::from(dry)..=FRAMES as u32 * u32::from(dry)).contains(&telemetry.rf_recoveries.get()));
        assert!(!dry || !bench.chip.reports().is_empty(), "the model has seen it too");
    }
}

#[test]
fn a_chip_that_loses_its_supply_sends_again_once_it_is_back() {
    let telemetry = Telemetry::new();
    let (sent, _) = run(80, &telemetry, |tick, bench| {
        match tick {
            20 => bench.chip.power_off(bench.now),
            25 => bench.chip.power_on(bench.now),
            _ => {}
        }
        PUNCTUAL
    });
    let places: Vec<_> = sent.iter().filter(|frame| !frame.payload.is_empty()).map(check).collect();
    assert!((20..25).all(|tick| !places.iter().any(|place| place.0 == tick)));
    // Before the next bring-up of the chip the driver waits up to 64 ms, and the bring-up takes 6 ms.
    for tick in 34..=80 {
        assert!(places.contains(&(tick, 0)), "cycle {tick}");
    }
    assert!(telemetry.rf_faults.get() > 0);
    assert_eq!(telemetry.rf_recoveries.get(), 1);
    assert_eq!(telemetry.frames_sent.get() as usize, places.len());
}

#[test]
fn a_transfer_that_never_ends_is_given_up_after_a_millisecond() {
    let telemetry = Telemetry::new();
    let (sent, bench) = run(60, &telemetry, |tick, bench| {
        bench.hang |= tick == 20;
        PUNCTUAL
    });
    assert_eq!(bench.aborted, 1);
    let places: Vec<_> = sent.iter().map(check).collect();
    assert!(places.contains(&(19, 0)) && !places.contains(&(20, 0)));
    for tick in 25..=60 {
        assert!(places.contains(&(tick, 0)), "cycle {tick}");
    }
    assert_eq!(telemetry.rf_recoveries.get(), 1);
}

#[test]
fn a_cycle_that_offers_nothing_sends_nothing() {
    let telemetry = Telemetry::new();
    // The profile is offered after every slot of its cycle, as if the task `cycle` had hung.
    let (sent, _) = run(30, &telemetry, |tick, _| if tick == 20 { 9_999_000 } else { PUNCTUAL });
    let places: Vec<_> = sent.iter().map(check).collect();
    assert!(!places.iter().any(|place| place.0 == 20));
    assert!(places.contains(&(19, 0)) && places.contains(&(22, 0)));
}

#[test]
fn a_chip_that_never_raises_i_txe_misses_no_slot() {
    let telemetry = Telemetry::new();
    let config = Config { txe_with_rx_off: false, ..Config::default() };
    let (sent, bench) = run_on(config, 50, &telemetry, |_, _| PUNCTUAL);
    let places: Vec<_> = sent.iter().map(check).collect();
    for tick in 3..=50 {
        assert!((0..FRAMES).all(|frame| places.contains(&(tick, frame))), "cycle {tick}: {places:?}");
    }
    let counts = [&telemetry.frames_sent, &telemetry.frames_unconfirmed, &telemetry.rf_faults]
        .map(firmware_common::counter::Counter::get);
    assert_eq!(counts, [sent.len() as u32, sent.len() as u32, 0]);
    assert!(bench.chip.reports().is_empty(), "{:?}", bench.chip.reports());
}

#[test]
fn a_register_that_loses_a_bit_is_named_and_set_again() {
    let telemetry = Telemetry::new();
    let (sent, _) = run(80, &telemetry, |tick, bench| {
        if tick == 20 {
            bench.chip.flip(Space::A, 0x28, 6);
        }
        PUNCTUAL
    });
    let places: Vec<_> = sent.iter().map(check).collect();
    assert!((36..=80).all(|tick| places.contains(&(tick, 0))), "{places:?}");
    assert_eq!((telemetry.rf_faults.get(), telemetry.rf_recoveries.get()), (1, 1));
    assert_eq!(telemetry.rf_register.get(), 0x0028_4000);
}
