//! Measures the time of the transmitter's calls in a cycle, with a port that only records the requested transfers.

use core::{hint::black_box, ops::Range};

use horus_tx_fw::{
    telemetry::Telemetry,
    transmitter::{self, Slot, Ticket, Transmitter},
    RECEIVERS,
};
use on_target_tests::{
    chip::{Chip, Status},
    cycles::{bounds, Cycles, Taken},
    profile_suite as suite,
};
use profile::{GpsValues, Profile, ReportedValues};
use st25r3916::{
    executor::{Failed, Port},
    PollerConfig, Short,
};

/// The address byte with which the driver's status read begins.
const STATUS_READ: u8 = 0x59;
/// The bit I_txe, end of transmission, of the main interrupts.
const TXE: u8 = 0x08;

#[derive(Clone, Copy)]
enum Started {
    Short([u8; Short::MAX], usize),
    Load,
}

struct Wires {
    started: Option<Started>,
    response: ([u8; Short::MAX], usize),
    /// Whether the next read of the interrupt pin finds it high. Later reads find it low.
    irq: bool,
    ticket: Ticket,
    loads: u32,
}

impl Port for Wires {
    fn start_short(&mut self, short: &Short) {
        self.started = Some(Started::Short(*short.padded(), short.bytes().len()));
    }
    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        black_box((offset, len));
        self.loads += 1;
        self.started = Some(Started::Load);
        true
    }
    fn ended(&mut self) -> bool {
        true
    }
    fn response(&self) -> Result<&[u8], Failed> {
        Ok(&self.response.0[..self.response.1])
    }
    fn abort(&mut self) {
        self.started = None;
    }
    fn irq_is_high(&mut self) -> bool {
        core::mem::take(&mut self.irq)
    }
    fn start_timer(&mut self, us: u32) {
        black_box(us);
    }
    fn elapsed(&mut self) -> bool {
        true
    }
}

impl transmitter::FrontEndPort for Wires {
    fn deposit(&mut self, profile: &Profile<RECEIVERS>) {
        black_box(profile);
    }
    fn point_at(&mut self, frame: Range<usize>) {
        black_box(frame);
    }
    fn arm(&mut self, ticket: Ticket) {
        self.ticket = ticket;
    }
    fn disarm(&mut self) -> bool {
        core::mem::replace(&mut self.ticket, Ticket::NONE) != Ticket::NONE
    }
}

/// Answers the transfers that were started, until the transmitter waits only for an offer. `main` has the main
/// interrupts that the first status read returns.
fn settle(transmitter: &mut Transmitter<'_, Wires>, chip: &mut Chip, mut main: u8) {
    for _ in 0..200 {
        let wires = transmitter.port();
        match wires.started.take() {
            Some(Started::Short(bytes, len)) => {
                if bytes[0] == STATUS_READ {
                    chip.set_status(Status { main: core::mem::take(&mut main), ..Status::default() });
                }
                wires.response = (chip.respond(&bytes[..len]), len);
            }
            Some(Started::Load) => wires.response.1 = 0,
            // If no transfer was started, the transmitter waits for an interrupt or an offer. The interrupt then comes
            // at once.
            None => wires.irq = true,
        }
        transmitter.poll();
        let wires = transmitter.port();
        if wires.started.is_none() && wires.irq {
            wires.irq = false;
            return;
        }
    }
    defmt::panic!("the transmitter does not settle");
}

/// Times `Transmitter::offer`, `poll` and `slot`, and `Ticket::due`, over profiles whose bytes all differ.
pub(crate) fn cycle(cycles: &Cycles) {
    let telemetry = Telemetry::new();
    let wires = Wires { started: None, response: ([0; 8], 0), irq: false, ticket: Ticket::NONE, loads: 0 };
    let mut transmitter = Transmitter::start(PollerConfig::new(), &telemetry, wires);
    let mut chip = Chip::new();
    settle(&mut transmitter, &mut chip, 0);
    defmt::assert!(transmitter.take_fault().is_none());

    let [mut offer, mut loaded, mut slot, mut skipped, mut due] = [Taken::NONE; 5];
    let absent = (ReportedValues::absent(0), [GpsValues::absent(0); RECEIVERS]);
    for (tick, (reported, gps)) in
        [absent, suite::inputs(10), suite::inputs(1230), suite::inputs(u32::MAX), absent].into_iter().enumerate()
    {
        let tick = tick as u32 + 1;
        let profile = Profile::<RECEIVERS>::seal(&reported, &gps);
        // The first cycle only fills the flash cache with the code, and is not timed.
        let timed = tick > 1;
        let note = |taken: &mut Taken, took| {
            if timed {
                taken.note(took);
            }
        };
        let (took, taken) = cycles.timed(|| transmitter.offer(black_box(tick), black_box(&profile)));
        defmt::assert!(taken);
        note(&mut offer, took);
        defmt::assert!(matches!(transmitter.port().started.take(), Some(Started::Load)));
        transmitter.port().response.1 = 0;
        note(&mut loaded, cycles.of(|| transmitter.poll()));
        let ticket = transmitter.port().ticket;
        defmt::assert!(ticket != Ticket::NONE);
        for (ticket, tick, frame, right) in [
            (ticket, tick, 0, true),
            (ticket, tick + 1, 0, false),
            (ticket, tick, 1, false),
            (Ticket::NONE, tick, 0, false),
            (Ticket::from_word(u32::MAX), tick, 0, false),
        ] {
            let (took, command) = cycles.timed(|| black_box(ticket).due(black_box(tick), black_box(frame)));
            defmt::assert_eq!(command.is_some(), right);
            note(&mut due, took);
        }
        transmitter.port().ticket = Ticket::NONE;
        note(&mut slot, cycles.of(|| transmitter.slot(black_box(Slot { frame: 0, fired: Some(0) }))));
        defmt::assert_eq!(transmitter.port().loads, 2 * tick);
        settle(&mut transmitter, &mut chip, TXE);
        note(&mut skipped, cycles.of(|| transmitter.slot(black_box(Slot { frame: 0, fired: None }))));
        defmt::assert!(transmitter.take_fault().is_none());
        defmt::assert_eq!(telemetry.frames_sent.get(), tick);
    }
    offer.assert("Transmitter::offer", bounds(250, 250, 550, 8));
    loaded.assert("Transmitter::poll, head loaded", bounds(270, 290, 640, 8));
    slot.assert("Transmitter::slot, fired", bounds(220, 250, 520, 8));
    // Like `poll`, `slot` also asks the port for interrupts, since an edge may have been lost.
    skipped.assert("Transmitter::slot, nothing fired", bounds(90, 105, 240, 8));
    due.assert("Ticket::due", bounds(65, 50, 110, 32));
}
