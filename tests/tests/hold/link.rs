//! Measures the time of the link's calls in a cycle, with a port that only records the requested transfers.

use core::hint::black_box;

use hold_fw::{
    exchange::{FrontEndPort, Link, Ticket},
    telemetry::Telemetry,
};
use on_target_tests::{
    chip::{Chip, Status},
    cycles::{bounds, Cycles, Taken},
};
use profile::{
    hold::{Answer, HoldObject},
    HoldCommand,
};
use st25r3916::{
    executor::{Failed, Port},
    Short,
};

use super::state::{commanded, READINGS};

/// The address byte with which the driver's status read begins.
const STATUS_READ: u8 = 0x59;
/// The bits of the main interrupts: end of transmission, sync detected, and end of a frame.
const TXE: u8 = 0x08;
const RXS: u8 = 0x20;
const RXE: u8 = 0x10;
const ANSWERED: u8 = Answer::SIZE as u8 + 3;

struct Wires {
    started: Option<Short>,
    loads: u32,
    response: ([u8; Short::MAX], usize),
    /// What a read of the FIFO brings: LEN, then the answer.
    fifo: [u8; Answer::SIZE + 1],
    read: Option<(usize, usize)>,
    ticket: Option<Ticket>,
}

impl Port for Wires {
    fn start_short(&mut self, short: &Short) {
        self.read = None;
        self.started = Some(*short);
    }
    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        black_box((offset, len));
        self.loads += 1;
        self.read = None;
        self.response.1 = 0;
        true
    }
    fn start_read(&mut self, offset: usize, len: usize) -> bool {
        self.read = Some((offset, len));
        true
    }
    fn ended(&mut self) -> bool {
        true
    }
    fn response(&self) -> Result<&[u8], Failed> {
        match self.read {
            Some((offset, len)) => self.fifo.get(offset..offset + len).ok_or(Failed),
            None => Ok(&self.response.0[..self.response.1]),
        }
    }
    fn abort(&mut self) {
        self.started = None;
    }
    fn irq_is_high(&mut self) -> bool {
        true
    }
    fn start_timer(&mut self, us: u32) {
        black_box(us);
    }
    fn elapsed(&mut self) -> bool {
        true
    }
}

impl FrontEndPort for Wires {
    fn deposit(&mut self, frame: &[u8; HoldObject::SIZE]) {
        black_box(frame);
    }
    fn arm(&mut self, ticket: Ticket) {
        self.ticket = Some(ticket);
    }
    fn disarm(&mut self) -> bool {
        self.ticket.take().is_some()
    }
    fn answer(&self, len: usize) -> &[u8] {
        self.fifo.get(1..=len).unwrap_or(&[])
    }
}

/// Makes the chip carry out the transfer that was started, if any. A status read returns the next of `interrupts`.
fn respond(link: &mut Link<'_, Wires>, chip: &mut Chip, interrupts: &mut impl Iterator<Item = (u8, u8)>) {
    let wires = link.port();
    if let Some(short) = wires.started.take() {
        if short.bytes()[0] == STATUS_READ {
            let (main, count) = interrupts.next().unwrap_or((0, 0));
            chip.set_status(Status { main, count, ..Status::default() });
        }
        wires.response = (chip.respond(short.bytes()), short.bytes().len());
    }
}

/// Times `Link::offer`, each `Link::poll` and `Ticket::is_due` in cycles in which both writers send a command. Also
/// adds up all that the tasks of a cycle do.
pub(crate) fn exchange(cycles: &Cycles) {
    let telemetry = Telemetry::new();
    let (mut hold, answer) = commanded(HoldCommand::SetPoint(30.0), &telemetry);
    let mut fifo = [Answer::SIZE as u8 + 1; Answer::SIZE + 1];
    fifo[1..].copy_from_slice(answer.as_bytes());
    let wires = Wires { started: None, loads: 0, response: ([0; 8], 0), fifo, read: None, ticket: None };
    let mut link = Link::start(&telemetry, wires);
    let mut chip = Chip::new();
    for _ in 0..200 {
        respond(&mut link, &mut chip, &mut core::iter::empty());
        link.poll();
    }
    defmt::assert!(link.take_fault().is_none());

    let [mut offers, mut polls, mut due, mut whole] = [Taken::NONE; 4];
    for tick in 4..10 {
        let (mut readings, supply) = READINGS[1];
        let (filled, (status, _)) = cycles.timed(|| hold.cycle(black_box(tick), &mut readings, supply));
        let offered = cycles.of(|| link.offer(black_box(tick), &status));
        let mut sum = filled + offered;
        let mut longest = 0;
        let mut interrupts = [(TXE, 0), (RXS, 0), (RXE, ANSWERED)].into_iter();
        let mut answered = false;
        for _ in 0..60 {
            if let Some(ticket) = link.port().ticket.take() {
                let (took, fires) = cycles.timed(|| Ticket::is_due(black_box(ticket.word()), black_box(4 * tick)));
                defmt::assert!(fires);
                due.note(took);
                sum += took;
            }
            respond(&mut link, &mut chip, &mut interrupts);
            let (took, brought) = cycles.timed(|| link.poll());
            sum += took;
            longest = longest.max(took);
            if let Some(answer) = link.take_answer().filter(|_| brought) {
                sum += cycles.of(|| hold.command(&answer, tick, &telemetry));
                answered = true;
            }
            if answered && link.port().started.is_none() && link.port().read.is_none() {
                break;
            }
        }
        defmt::assert!(answered, "cycle {=u32}: no answer", tick);
        // The first cycle is not timed, so that the flash cache holds the code for all others.
        if tick > 4 {
            offers.note(offered);
            polls.note(longest);
            whole.note(sum);
        }
    }
    defmt::assert!(link.take_fault().is_none());
    defmt::assert_eq!(telemetry.answers.get(), 6);
    offers.assert("Link::offer", bounds(300, 350, 950, 8));
    polls.assert("Link::poll, any of a cycle", bounds(1_300, 1_250, 3_700, u32::MAX));
    due.assert("Ticket::is_due", bounds(45, 35, 100, 8));
    whole.assert("all tasks of a cycle, without registers and sensors", bounds(10_000, 11_000, 30_000, u32::MAX));
}
