//! Simulates the hold's link and a listener that answers, byte by byte on each SPI. Each has a model of its chip; a
//! model of the air connects them. All times are virtual.

use hold_fw::{
    exchange::{FrontEndPort, Link, Ticket},
    telemetry::Telemetry,
    timing::{BEATS, BEAT_MS, SLOT_US},
};
use profile::{
    hold::{Answer, HoldObject, PERIOD_MS},
    HoldStatus,
};
use st25r3916::{
    command,
    executor::{Executor, Failed, Port},
    Answerer, AnswererEvent, Exchange, ListenerConfig, Short, Step, Transfer,
};
use st25r3916_model::{Air, AirFaults, AnswerFaults, AnswerPath, Chip, Config, SentFrame};

/// The time of one byte at 8 MHz, and the time of the interrupts around a transfer, both in ns.
const BYTE_NS: u64 = 1_000;
const OVERHEAD_NS: u64 = 2_000;
const BEAT_NS: u64 = BEAT_MS as u64 * 1_000_000;
pub(crate) const PERIOD_NS: u64 = PERIOD_MS as u64 * 1_000_000;
/// The time from the end of the hold's frame to the listener's transmit command, ns.
const ANSWER_AFTER_NS: u64 = 700_000;

struct Running {
    out: Vec<u8>,
    into: Vec<u8>,
    next_at: u64,
}

pub(crate) struct Side {
    now: u64,
    pub(crate) chip: Chip,
    running: Option<Running>,
    /// The bytes that came in during the last transfer. The first `skip` of them are not part of the response that the
    /// driver gets.
    response: Vec<u8>,
    skip: usize,
    timer: u64,
    irq: bool,
    ticket: u32,
    payload: Vec<u8>,
    /// The length byte and the payload of the frame that was read last.
    received: Vec<u8>,
    /// How many transfers are still carried out before a transfer that never ends. `hangs` says whether that endless
    /// transfer has begun.
    pub(crate) hang_in: Option<u32>,
    hangs: bool,
    pub(crate) aborted: u32,
}

impl Side {
    fn new(config: Config) -> Self {
        Self {
            now: 0,
            chip: Chip::new(config),
            running: None,
            response: vec![],
            skip: 0,
            timer: u64::MAX,
            irq: false,
            ticket: 0,
            payload: vec![],
            received: vec![],
            hang_in: None,
            hangs: false,
            aborted: 0,
        }
    }

    fn begin(&mut self, out: Vec<u8>, skip: usize) {
        assert!(self.running.is_none() && self.ticket == 0, "one transfer at a time, and none while a ticket is out");
        self.skip = skip;
        self.select(out, OVERHEAD_NS / 2);
    }

    fn select(&mut self, out: Vec<u8>, after: u64) {
        self.hangs = self.hang_in == Some(0);
        self.hang_in = self.hang_in.and_then(|left| left.checked_sub(1));
        self.chip.select(self.now);
        self.running = Some(Running { out, into: vec![], next_at: self.now + after + BYTE_NS });
    }

    fn next_event(&self) -> u64 {
        let transfer = self.running.as_ref().filter(|_| !self.hangs).map_or(u64::MAX, |running| running.next_at);
        let timer = if self.timer > self.now { self.timer } else { u64::MAX };
        transfer.min(timer).min(self.chip.next_event().unwrap_or(u64::MAX))
    }

    /// Advances the time to `at`, ns. Returns whether an interrupt occurs: at the end of a transfer or delay, or by an
    /// edge of IRQ.
    fn advance(&mut self, at: u64) -> bool {
        let timer = self.timer > self.now && self.timer <= at;
        self.now = at;
        self.chip.advance(at);
        let mut ended = false;
        if let Some(running) = self.running.as_mut().filter(|running| running.next_at <= at && !self.hangs) {
            ended = running.into.len() == running.out.len();
            if !ended {
                running.into.push(self.chip.transfer(at, running.out[running.into.len()]));
                let whole = running.into.len() == running.out.len();
                running.next_at = at + if whole { OVERHEAD_NS / 2 } else { BYTE_NS };
            }
        }
        let rises = self.chip.irq() && !self.irq;
        self.irq = self.chip.irq();
        timer || ended || rises
    }
}

impl Port for Side {
    fn start_short(&mut self, short: &Short) {
        self.begin(short.bytes().to_vec(), 0);
    }
    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let out = [&[command::FIFO_LOAD], &self.payload[offset..offset + len]].concat();
        let all = out.len();
        self.begin(out, all);
        true
    }
    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        self.received.resize(offset + len, 0);
        self.begin([vec![command::FIFO_READ], vec![0; len]].concat(), 1);
        true
    }
    fn ended(&mut self) -> bool {
        let now = self.now;
        let is_over = |running: &mut Running| running.into.len() == running.out.len() && running.next_at <= now;
        let Some(running) = self.running.take_if(is_over) else { return false };
        self.chip.deselect(now);
        self.response = running.into;
        if running.out[0] == command::FIFO_READ {
            let from = self.received.len() - (self.response.len() - 1);
            self.received[from..].copy_from_slice(&self.response[1..]);
        }
        true
    }
    fn response(&self) -> Result<&[u8], Failed> {
        Ok(&self.response[self.skip..])
    }
    fn abort(&mut self) {
        self.running = None;
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

impl FrontEndPort for Side {
    fn deposit(&mut self, frame: &[u8; HoldObject::SIZE]) {
        let loads = |running: &Running| running.out[0] == command::FIFO_LOAD;
        assert!(!self.running.as_ref().is_some_and(loads), "the bytes under a load do not change");
        self.payload = frame.to_vec();
    }
    fn arm(&mut self, ticket: Ticket) {
        assert!(self.running.is_none());
        self.ticket = ticket.word();
    }
    fn disarm(&mut self) -> bool {
        std::mem::take(&mut self.ticket) != 0
    }
    fn answer(&self, len: usize) -> &[u8] {
        self.received.get(1..1 + len).unwrap_or(&[])
    }
}

pub(crate) struct World<'a> {
    pub(crate) link: Link<'a, Side>,
    listener: Executor<Answerer, Side>,
    pub(crate) air: Air,
    pub(crate) path: AnswerPath,
    now: u64,
    tick: u32,
    /// The number of beats so far, and the time at which the timer matches the slot's compare value in the present
    /// beat.
    beat: u32,
    slot_at: u64,
    offer_at: u64,
    fire_at: u64,
    /// The answer of the listener, or `None` if the listener does not answer.
    pub(crate) answer: Option<Vec<u8>>,
    pub(crate) heard: Vec<HoldStatus>,
    pub(crate) answers: Vec<Answer>,
    pub(crate) late_ns: u64,
    telemetry: &'a Telemetry,
    /// The time at which the link is replaced by one that brings up a chip without a history.
    pub(crate) restart_at: u64,
}

impl<'a> World<'a> {
    pub(crate) fn new(telemetry: &'a Telemetry, hold: Config, faults: AnswerFaults) -> Self {
        let exact = Config { transmit_scatter_ns: 0, ..hold };
        let mut listener = Executor::new(
            Answerer::new(ListenerConfig::new()),
            Side::new(Config { answers: true, ..Config::default() }),
        );
        assert!(listener.resume().is_none());
        Self {
            link: Link::start(telemetry, Side::new(exact)),
            listener,
            air: Air::new(1, AirFaults::default()),
            path: AnswerPath::new(2, faults),
            now: 0,
            tick: 0,
            beat: 0,
            slot_at: u64::MAX,
            offer_at: u64::MAX,
            fire_at: u64::MAX,
            answer: Some(Answer::EMPTY.as_bytes().to_vec()),
            heard: vec![],
            answers: vec![],
            late_ns: 50_000,
            telemetry,
            restart_at: u64::MAX,
        }
    }

    pub(crate) fn tick(&self) -> u32 {
        self.tick
    }

    /// Runs `cycles` cycles and returns the frames that were sent. `status` gives the Hold-Status of a tick.
    pub(crate) fn run(&mut self, cycles: u32, mut status: impl FnMut(u32) -> HoldStatus) -> Vec<SentFrame> {
        let last = self.tick + cycles;
        let end = (u64::from(last) + 1) * PERIOD_NS;
        while self.now < end {
            let tick_at = (u64::from(self.tick) + 1) * PERIOD_NS;
            let chips = self.link.port().next_event().min(self.listener.port().next_event());
            let air = self.air.next_event().unwrap_or(u64::MAX).min(self.path.next_event().unwrap_or(u64::MAX));
            let own = tick_at.min(self.slot_at).min(self.offer_at).min(self.fire_at).min(self.restart_at);
            let at = chips.min(air).min(own).max(self.now);
            self.now = at;
            let polls = (self.link.port().advance(at), self.listener.port().advance(at));
            if at == self.restart_at {
                self.restart_at = u64::MAX;
                let mut side = Side::new(Config { transmit_scatter_ns: 0, ..Config::default() });
                side.advance(at);
                self.link = Link::start(self.telemetry, side);
            }
            if at == tick_at {
                if self.tick == last {
                    break;
                }
                self.tick += 1;
                self.beat = self.tick * BEATS;
                self.slot_at = at + u64::from(SLOT_US) * 1_000;
                self.offer_at = at + self.late_ns;
            }
            if at == self.slot_at {
                let is_armed = Ticket::is_due(self.link.port().ticket, self.beat);
                self.beat += 1;
                // The timer clears itself at each beat, so it matches the slot's compare value once in every beat.
                self.slot_at = if self.beat.is_multiple_of(BEATS) { u64::MAX } else { at + BEAT_NS };
                let side = self.link.port();
                if is_armed {
                    side.ticket = 0;
                    side.skip = 1;
                    side.select(Exchange::transmit().bytes().to_vec(), 0);
                }
            }
            if at == self.offer_at {
                self.offer_at = u64::MAX;
                self.link.offer(self.tick, &status(self.tick));
            }
            if polls.0 && self.link.poll() {
                self.answers.extend(self.link.take_answer());
            }
            self.carry();
            if at == self.fire_at {
                self.fire_at = u64::MAX;
                let event = self.listener.go_on(|_| Step::Transfer(Transfer::Short(Answerer::transmit())));
                self.serve(event);
            } else if polls.1 {
                let event = self.listener.poll();
                self.serve(event);
            }
            self.carry();
        }
        self.air.take_sent()
    }

    fn carry(&mut self) {
        self.path.carry(&mut self.air, &mut self.link.port().chip, &mut self.listener.port().chip);
    }

    fn serve(&mut self, mut event: Option<AnswererEvent>) {
        while let Some(happened) = event {
            event = match happened {
                AnswererEvent::Frame { len, .. } => {
                    let bytes = self.listener.port().answer(len).to_vec();
                    self.heard.extend(HoldStatus::verify(&bytes).copied());
                    match self.answer.clone() {
                        Some(answer) => {
                            let len = answer.len();
                            self.listener.port().payload = answer;
                            self.listener.go_on(|answerer| answerer.answer(len).expect("a frame was delivered"))
                        }
                        None => self.listener.resume(),
                    }
                }
                AnswererEvent::Loaded => {
                    let end = self.air.last_frame().map_or(self.now, |frame| frame.end_ns);
                    self.fire_at = (end + ANSWER_AFTER_NS).max(self.now + 1);
                    return;
                }
                _ => self.listener.resume(),
            };
        }
    }
}
