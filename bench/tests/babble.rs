//! Tests peripherals that send too much, or nonsense: receivers to HORUS, and the flight controller to the DPR. They
//! may not delay the cycle, cost a frame or disturb anything else.

use crate::boards;

use bench::boards::{Dpr, Horus};
use bench::faults::{Conduct, Episode, Fault, Faults, Timeline, Turn, Wires};
use bench::world::FlightController;
use bench::world::flight_controller;
use bench::world::ssi::Progress;
use bench_judge::bounds::TICK_TO_COMMAND_JITTER;
use boards::{RAM_TEST, counter};
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use emulator_node::{Downstream, Node, Relay, Threads, Upstream};
use gnss_sim::ubx;
use horus_tx_fw::telemetry::{Line as LineTelemetry, Telemetry as HorusTelemetry};
use profile::image::Image;
use profile::sequence::SEARCH_CYCLES;
use profile::{Identifier, LinkStatus, ReportedPosition};
use st25r3916_model::{Air, AirEvent, AirFaults, Config};

const MS: u64 = 1_000_000;

/// The number of bytes that are generated for each millisecond: more than a line carries at 460 800 baud.
const A_MILLISECOND: usize = 47;

/// Noise that is the same in every run, from a linear congruential generator (Knuth's MMIX).
struct Noise(u64);

impl Noise {
    fn byte(&mut self) -> u8 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 56) as u8
    }
}

#[derive(Clone, Copy, Debug)]
enum Babble {
    Noise,
    /// The line carries beginnings of UBX messages of the greatest length.
    Beginnings,
    /// Whole, unsolicited UBX messages.
    Unasked,
}

#[test]
fn receivers_that_never_stop_talking_do_not_move_a_frame() {
    for babble in [Babble::Noise, Babble::Beginnings, Babble::Unasked] {
        let Some(mut node) = boards::horus() else { return };
        let mut noise = Noise(1);
        let mut starts = vec![];
        while node.now() < starts.first().map_or(RAM_TEST + 100 * MS, |first| first + 485 * MS) {
            for line in 0..3 {
                let bytes: Vec<u8> = match babble {
                    Babble::Noise => (0..A_MILLISECOND).map(|_| noise.byte()).collect(),
                    Babble::Beginnings => {
                        [0xB5, 0x62, 0x01, 0x07, 0xFF, 0xFF].into_iter().cycle().take(A_MILLISECOND).collect()
                    }
                    Babble::Unasked => ubx::frame(0x0A, 0x04, &[noise.byte(); A_MILLISECOND - 8]),
                };
                let now = node.now();
                node.board_mut(|board| board.say(now, line, &bytes));
            }
            let end = node.now() / MS * MS + MS;
            while node.now() < end {
                node.advance(end);
                let emitted = node.board_mut(|board| board.front_end.take_air()).into_iter();
                starts.extend(emitted.filter(|(_, event)| matches!(event, AirEvent::FrameStart(_))).map(|(at, _)| at));
            }
        }
        assert_eq!(starts.len(), 49, "{babble:?}");
        // The firmware alone determines the instant of the transmit command, which has the same phase in every cycle.
        let commands = node.board_mut(|board| board.front_end.take_transmits());
        assert_eq!(commands.len(), 49, "{babble:?}");
        for pair in commands.windows(2) {
            assert!((pair[1] - pair[0]).abs_diff(10 * MS) <= TICK_TO_COMMAND_JITTER, "{babble:?}: {pair:?}");
        }
        // The front end adds its own scatter between the transmit command and the first bit.
        let scatter = TICK_TO_COMMAND_JITTER + Config::default().transmit_scatter_ns;
        for pair in starts.windows(2) {
            assert!((pair[1] - pair[0]).abs_diff(10 * MS) <= scatter, "{babble:?}: {pair:?}");
        }
        let count = |offset| counter(&node, "HORUS_TELEMETRY", offset);
        assert_eq!(count(std::mem::offset_of!(HorusTelemetry, cycle_overruns)), 0, "{babble:?}");
        assert_eq!(count(std::mem::offset_of!(HorusTelemetry, frames_skipped)), 0, "{babble:?}");
        for line_number in 0..3 {
            let line = std::mem::offset_of!(HorusTelemetry, lines) + line_number * size_of::<LineTelemetry>();
            let bytes = count(line + std::mem::offset_of!(LineTelemetry, bytes));
            // HORUS takes all bytes of a UART except the last ones in the ring. On a bus it drops bytes that are old
            // (decision 16).
            let taken = [20_000..=23_500, 0..=0, 0..=0][line_number].clone();
            assert!(taken.contains(&bytes), "{babble:?}, receiver {line_number}: {bytes} bytes taken");
            assert_eq!(count(line + std::mem::offset_of!(LineTelemetry, overruns)), 0, "{babble:?}");
        }
        assert_eq!(node.take_findings(), [], "{babble:?}");
        assert_eq!(node.resets().len(), 0, "{babble:?}");
    }
}

const EPISODE: std::ops::Range<u64> = RAM_TEST + 30 * MS..RAM_TEST + 330 * MS;

struct Controller {
    flight_controller: FlightController,
    wires: Wires,
    turns: Timeline,
    /// The bytes that the flight controller read in its last whole transaction.
    read: Vec<u8>,
    wrong: usize,
    air: Air,
}

impl Controller {
    fn new(conduct: Conduct) -> Self {
        let config = flight_controller::Config::new(3);
        let faults = Faults::none().with(EPISODE.start, EPISODE.end, Fault::FlightController(conduct));
        Self {
            flight_controller: FlightController::new(config),
            wires: Wires::new(config.layout(), 1),
            turns: faults.timeline(false),
            read: vec![],
            wrong: 0,
            air: Air::new(1, AirFaults::default()),
        }
    }
}

impl Downstream<Dpr> for Controller {
    type Message = AirEvent;
    type Notes = ();

    fn hear(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr>) {
        let air = &mut self.air;
        node.board_mut(|board| air.from_poller(at, event, &mut |at, event| board.front_end.hear(at, event)));
    }

    fn noted(&mut self, (): ()) {}

    fn leave(&mut self, node: &mut Node<Dpr>) {
        let answers = node.board_mut(|board| board.front_end.take_air().len());
        assert_eq!(answers, 0, "the listener never answers");
    }

    fn next_at(&self) -> u64 {
        self.turns.next_at().min(self.flight_controller.next_at())
    }

    fn act(&mut self, at: u64, node: &mut Node<Dpr>) {
        match self.turns.take(at) {
            Some(Turn::Begins(Episode { fault: Fault::FlightController(conduct), .. })) => {
                self.flight_controller.set_conduct(at, Some(conduct));
            }
            Some(_) => self.flight_controller.set_conduct(at, None),
            None => {
                if let Some(Progress::Over(transaction)) = self.flight_controller.act(node, &mut self.wires) {
                    if EPISODE.contains(&transaction.selected_ns) && EPISODE.contains(&transaction.deselected_ns) {
                        self.wrong += 1;
                    } else if transaction.bytes == Image::<3>::LEN {
                        self.read = transaction.miso;
                    }
                }
            }
        }
    }
}

struct Antenna;

impl Upstream<Horus> for Antenna {
    type Message = AirEvent;
    type Notes = ();

    fn leave(&mut self, node: &mut Node<Horus>, sent: &mut Vec<(u64, AirEvent)>) {
        node.board_mut(|board| sent.extend(board.front_end.take_air()));
    }

    fn notes(&mut self, _node: &mut Node<Horus>) {}
}

#[test]
fn a_flight_controller_that_misuses_the_ssi_costs_no_frame() {
    for conduct in Conduct::ALL {
        let (Some(a), Some(b)) = (boards::horus(), boards::dpr()) else { return };
        let mut relay = Relay { a, b, upstream: Antenna, downstream: Controller::new(conduct) };
        relay.run(EPISODE.start - 5 * MS, 400 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
        let started = relay.b.usage();
        relay.run(EPISODE.end + 70 * MS, 400 * MS, Threads::Two, |_, _, _| Ok::<_, ()>(())).unwrap();
        let Relay { b: mut dpr, downstream, .. } = relay;
        let usage = dpr.usage();
        let load = (usage.awake - started.awake) as f64 / (usage.total - started.total) as f64;
        let count = |dpr: &Node<Dpr>, offset| counter(dpr, "DPR_TELEMETRY", offset);
        let wrong = downstream.wrong;
        let violations = count(&dpr, std::mem::offset_of!(DprTelemetry, access_violations));
        println!("{}: {wrong} transactions, load {load:.4}, {violations} access violations", conduct.name());
        assert_eq!(count(&dpr, std::mem::offset_of!(DprTelemetry, frames_received)), 39, "{conduct:?}");
        // The DPR does not show the first cycles, which find the sequence.
        let shown = 39 - u32::from(SEARCH_CYCLES);
        assert_eq!(count(&dpr, std::mem::offset_of!(DprTelemetry, objects_accepted)), shown * 4, "{conduct:?}");
        for (name, offset) in [
            ("missed", std::mem::offset_of!(DprTelemetry, frames_missed)),
            ("overruns", std::mem::offset_of!(DprTelemetry, overruns)),
            ("front end faults", std::mem::offset_of!(DprTelemetry, rf_faults)),
            ("scrub faults", std::mem::offset_of!(DprTelemetry, scrub_faults)),
        ] {
            assert_eq!(count(&dpr, offset), 0, "{conduct:?}: {name}");
        }
        let images = u32::try_from((EPISODE.end - EPISODE.start) / (10 * MS)).unwrap();
        let expected = match conduct {
            // Each transaction has a wrong request and a wrong object.
            Conduct::RunsAway => 3..=3,
            Conduct::RandomBytes => 225..=225,
            Conduct::Lies => 75..=90,
            // Only the first uplink object is new.
            Conduct::ReplaysUplink => 74..=74,
            // An image for which too many transactions are made counts as one violation.
            Conduct::Hammers | Conduct::ZeroBytes | Conduct::TogglesCsn | Conduct::BackToBack => images..=images + 1,
            // Zeros request nothing, and bytes behind a request are allowed.
            _ => 0..=0,
        };
        assert!(expected.contains(&violations), "{conduct:?}: {violations} violations");
        assert_eq!(dpr.resets().len(), 0, "{conduct:?}");
        // The bench reports the flight controller's wrong SPI mode as a finding, although the DPR is not at fault.
        let findings = dpr.take_findings();
        assert_eq!(!findings.is_empty(), matches!(conduct, Conduct::OtherMode(_)), "{conduct:?}: {findings:?}");
        assert!(load < 0.1, "{conduct:?}: load {load}");
        let read = &downstream.read;
        assert_eq!(read.len(), Image::<3>::LEN, "{conduct:?}");
        let link = LinkStatus::verify(&read[..LinkStatus::SIZE]).unwrap().values();
        assert!(link.status.link_up(), "{conduct:?}");
        let reported = ReportedPosition::verify(&read[LinkStatus::SIZE..][..ReportedPosition::SIZE]).unwrap();
        assert_eq!(reported.identifier(), Identifier::REPORTED_POSITION);
        assert!(reported.timestamp() >= 380, "{conduct:?}: {} ms", reported.timestamp());
    }
}
