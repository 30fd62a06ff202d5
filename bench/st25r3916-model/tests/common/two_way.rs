//! Two drivers, each on its own chip with an SPI of 8 MHz, and the paths of frames and answers between the chips.

use st25r3916::executor::{Executor, Failed, Machine, Port};
use st25r3916::{
    Answerer, AnswererEvent, Exchange, ExchangeEvent, Input, ListenerConfig, Short, command, listener::BUFFER,
};
use st25r3916_model::{Air, AirFaults, AnswerFaults, AnswerPath, Chip, Config};

use super::{BYTE_NS, Side};

/// The processor's time from an interrupt to the next transfer, ns.
const CODE_NS: u64 = 5_000;

/// The purpose of a transfer, which determines what happens to the bytes on MISO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    Short,
    Load,
    Read(usize),
}

pub(crate) struct Wires {
    now: u64,
    mosi: Vec<u8>,
    miso: Vec<u8>,
    purpose: Purpose,
    /// The instant at which the next byte of a transfer ends, ns; `None` without a transfer.
    next_ns: Option<u64>,
    irq: bool,
    timer_ns: u64,
    pub(crate) payload: Vec<u8>,
    pub(crate) buffer: [u8; BUFFER],
}

impl Wires {
    fn new() -> Self {
        Self {
            now: 0,
            mosi: vec![],
            miso: vec![],
            purpose: Purpose::Short,
            next_ns: None,
            irq: false,
            timer_ns: 0,
            payload: vec![],
            buffer: [0; BUFFER],
        }
    }

    fn start(&mut self, mosi: Vec<u8>, purpose: Purpose, after_ns: u64) {
        (self.mosi, self.miso, self.purpose) = (mosi, vec![], purpose);
        self.next_ns = Some(self.now + after_ns + BYTE_NS);
    }

    fn clock(&mut self, chip: &mut Chip) {
        let Some(at) = self.next_ns.filter(|at| *at <= self.now) else { return };
        if self.miso.is_empty() {
            chip.select(at);
        }
        self.miso.push(chip.transfer(at, self.mosi[self.miso.len()]));
        self.next_ns = Some(at + BYTE_NS);
        if self.miso.len() == self.mosi.len() {
            chip.deselect(at);
            self.next_ns = None;
            if let Purpose::Read(offset) = self.purpose {
                self.buffer[offset..offset + self.miso.len() - 1].copy_from_slice(&self.miso[1..]);
            }
        }
    }
}

impl Port for Wires {
    fn start_short(&mut self, short: &Short) {
        self.start(short.bytes().to_vec(), Purpose::Short, CODE_NS);
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let mosi = [&[command::FIFO_LOAD], &self.payload[offset..offset + len]].concat();
        self.start(mosi, Purpose::Load, CODE_NS);
        true
    }

    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        let mut mosi = vec![0; len + 1];
        mosi[0] = command::FIFO_READ;
        self.start(mosi, Purpose::Read(offset), CODE_NS);
        true
    }

    fn ended(&mut self) -> bool {
        self.next_ns.is_none()
    }

    fn response(&self) -> Result<&[u8], Failed> {
        Ok(match self.purpose {
            Purpose::Short => &self.miso,
            Purpose::Load => &[],
            Purpose::Read(_) => &self.miso[1..],
        })
    }

    fn abort(&mut self) {
        self.next_ns = None;
    }

    fn irq_is_high(&mut self) -> bool {
        self.irq
    }

    fn start_timer(&mut self, us: u32) {
        self.timer_ns = self.now + u64::from(us) * 1_000;
    }

    fn elapsed(&mut self) -> bool {
        self.now >= self.timer_ns
    }
}

pub(crate) struct Node<M: Machine, E> {
    pub(crate) executor: Executor<M, Wires>,
    fire_at: Option<u64>,
    firing: bool,
    rose_ns: u64,
    pub(crate) events: Vec<(u64, E)>,
}

impl<M: Machine<Event = E>, E: Copy> Node<M, E> {
    fn new(machine: M) -> Self {
        Self {
            executor: Executor::new(machine, Wires::new()),
            fire_at: None,
            firing: false,
            rose_ns: 0,
            events: vec![],
        }
    }

    fn next(&mut self) -> u64 {
        let fire = self.fire_at.unwrap_or(u64::MAX);
        let port = self.executor.port();
        let timer = if port.timer_ns > port.now { port.timer_ns } else { u64::MAX };
        port.next_ns.unwrap_or(u64::MAX).min(fire).min(timer)
    }

    fn advance(&mut self, now: u64, chip: &mut Chip) -> Option<E> {
        let irq = chip.irq();
        let port = self.executor.port();
        if irq && !port.irq {
            self.rose_ns = now;
        }
        (port.now, port.irq) = (now, irq);
        port.clock(chip);
        if self.fire_at.take_if(|at| *at <= now).is_some() {
            let transmit = Exchange::transmit();
            self.executor.port().start(transmit.bytes().to_vec(), Purpose::Short, 0);
            self.firing = true;
        }
        if self.firing {
            if self.executor.port().next_ns.is_some() {
                return None;
            }
            self.firing = false;
            return self.executor.go_on(|machine| machine.step(Input::Done(&[0])));
        }
        self.executor.poll()
    }
}

/// A hold (poller) and a DPR (listener), each with driver and chip, and the paths between them.
pub(crate) struct World {
    pub(crate) chips: [Chip; 2],
    pub(crate) air: Air,
    pub(crate) back: AnswerPath,
    pub(crate) hold: Node<Exchange, ExchangeEvent>,
    pub(crate) port: Node<Answerer, AnswererEvent>,
    pub(crate) now: u64,
    /// The time from the end of a received frame (I_rxe) to the DPR's transmit command for the answer, ns.
    pub(crate) answers_after_ns: u64,
    pub(crate) answer: Vec<u8>,
    /// The payloads that the DPR received.
    pub(crate) frames: Vec<Vec<u8>>,
    pub(crate) answers: Vec<Vec<u8>>,
}

pub(crate) fn configs(hold: Config, port: Config) -> [Config; 2] {
    [Config { seed: 1, ..hold }, Config { seed: 2, answers: true, ..port }]
}

impl World {
    pub(crate) fn new(configs: [Config; 2]) -> Self {
        Self {
            chips: configs.map(Chip::new),
            air: Air::new(3, AirFaults::default()),
            back: AnswerPath::new(4, AnswerFaults::default()),
            hold: Node::new(Exchange::new()),
            port: Node::new(Answerer::new(ListenerConfig::new())),
            now: 0,
            answers_after_ns: 700_000,
            answer: vec![0x3C; 128],
            frames: vec![],
            answers: vec![],
        }
    }

    pub(crate) fn started(configs: [Config; 2]) -> Self {
        let mut world = Self::new(configs);
        assert!(world.hold.executor.resume().is_none() && world.port.executor.resume().is_none());
        world.run_to(40_000_000);
        assert!(world.hold.executor.machine().is_ready(), "{:?}", world.hold.events);
        assert!(world.port.events.iter().any(|(_, event)| *event == AnswererEvent::FieldOn), "{:?}", world.port.events);
        world
    }

    pub(crate) fn chip(&mut self, side: Side) -> &mut Chip {
        &mut self.chips[usize::from(side == Side::Listener)]
    }

    fn carry(&mut self) {
        let [poller, listener] = &mut self.chips;
        self.back.carry(&mut self.air, poller, listener);
    }

    pub(crate) fn run_to(&mut self, to: u64) {
        loop {
            self.carry();
            let chips = self.chips.iter().filter_map(Chip::next_event);
            let air = [self.air.next_event(), self.back.next_event()];
            let next = chips.chain(air.into_iter().flatten()).min().unwrap_or(u64::MAX);
            self.now = next.min(self.hold.next()).min(self.port.next()).clamp(self.now, to);
            for chip in &mut self.chips {
                chip.advance(self.now);
            }
            self.carry();
            let acted = self.turn();
            if self.now == to && !acted && self.chips.iter().all(|chip| chip.next_event().is_none_or(|at| at > to)) {
                return;
            }
        }
    }

    fn turn(&mut self) -> bool {
        let mut acted = false;
        while let Some(event) = self.hold.advance(self.now, &mut self.chips[0]) {
            acted = true;
            self.hold_has(event);
        }
        while let Some(event) = self.port.advance(self.now, &mut self.chips[1]) {
            acted = true;
            self.port_has(event);
        }
        acted
    }

    fn hold_has(&mut self, event: ExchangeEvent) {
        self.hold.events.push((self.now, event));
        let next = match event {
            ExchangeEvent::Ready => None,
            ExchangeEvent::Loaded => {
                self.hold.fire_at = Some(self.now + 50_000);
                None
            }
            ExchangeEvent::Answer { len, .. } => {
                self.answers.push(self.hold.executor.port().buffer[1..=len].to_vec());
                self.hold.executor.resume()
            }
            ExchangeEvent::Prepared | ExchangeEvent::NoAnswer(_) | ExchangeEvent::Fault(_) => {
                self.hold.executor.resume()
            }
        };
        if let Some(event) = next {
            self.hold_has(event);
        }
    }

    fn port_has(&mut self, event: AnswererEvent) {
        self.port.events.push((self.now, event));
        let next = match event {
            AnswererEvent::Frame { len, .. } => {
                self.frames.push(self.port.executor.port().buffer[1..=len].to_vec());
                let answer = self.answer.clone();
                let len = answer.len();
                self.port.executor.port().payload = answer;
                self.port.executor.go_on(|machine| match machine.answer(len) {
                    Ok(step) => step,
                    Err(_) => machine.step(Input::Start),
                })
            }
            AnswererEvent::Loaded => {
                self.port.fire_at = Some((self.port.rose_ns + self.answers_after_ns).max(self.now + 1));
                None
            }
            _ => self.port.executor.resume(),
        };
        if let Some(event) = next {
            self.port_has(event);
        }
    }

    pub(crate) fn begin(&mut self, payload: &[u8]) {
        self.hold.events.clear();
        self.hold.executor.port().payload = payload.to_vec();
        let event = self.hold.executor.go_on(|machine| match machine.prepare(payload.len()) {
            Ok(step) => step,
            Err(_) => machine.step(Input::Start),
        });
        if let Some(event) = event {
            self.hold_has(event);
        }
    }

    /// Runs one cycle of 100 ms. Returns the event that ends the exchange, and the time from the transmit command to
    /// that event, ns.
    pub(crate) fn cycle(&mut self, payload: &[u8]) -> Option<(ExchangeEvent, u64)> {
        let start = self.now;
        self.begin(payload);
        self.run_to(start + 100_000_000);
        let loaded = self.hold.events.iter().find(|(_, event)| *event == ExchangeEvent::Loaded)?.0;
        let over = |event: &ExchangeEvent| !matches!(event, ExchangeEvent::Prepared | ExchangeEvent::Loaded);
        let (at, event) = *self.hold.events.iter().find(|(_, event)| over(event))?;
        Some((event, at - loaded - 50_000))
    }

    pub(crate) fn findings(&self) -> Vec<String> {
        self.chips.iter().flat_map(|chip| chip.reports().iter().map(ToString::to_string)).collect()
    }
}
