//! Tests that injected faults take effect on the release programs, and that the boards work again afterwards. Meanwhile
//! the judge checks what each board must do.

use crate::boards;

use bench::boards::Powered;
use bench::boards::{Dpr, Horus};
use bench::faults::image::{ImageFault, poke};
use bench::faults::{Kind, OnLine};
use bench::faults::{LineFaults, PowerFault, ReceiverFault, Rng, Targets, Upset};
use boards::{RAM_TEST, counter};
use emulator_node::{Board, Error, Node};
use emulator_part::Reset;
use gnss_sim::ubx::NavPvt;
use horus_tx_fw::telemetry::{Line, Telemetry};
use st25r3916_model::AirEvent;

const MS: u64 = 1_000_000;

/// HORUS's counters of the line of one receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    bytes: u32,
    errors: u32,
    messages: u32,
    damaged: u32,
}

impl Counts {
    fn of(node: &Node<Horus>, receiver: usize) -> Self {
        let line = std::mem::offset_of!(Telemetry, lines) + receiver * size_of::<Line>();
        let count = |offset| counter(node, "HORUS_TELEMETRY", line + offset);
        Self {
            bytes: count(std::mem::offset_of!(Line, bytes)),
            errors: count(std::mem::offset_of!(Line, uart_errors)),
            messages: count(std::mem::offset_of!(Line, messages)),
            damaged: count(std::mem::offset_of!(Line, damaged)),
        }
    }

    fn since(self, before: Self) -> Self {
        Self {
            bytes: self.bytes - before.bytes,
            errors: self.errors - before.errors,
            messages: self.messages - before.messages,
            damaged: self.damaged - before.damaged,
        }
    }
}

/// A HORUS whose three receivers send 100 bytes every 20 ms, the first one with faults.
#[derive(Clone)]
struct Fed {
    node: Node<Horus>,
    faults: LineFaults,
    at: u64,
}

impl Fed {
    fn new() -> Option<Self> {
        Some(Self { node: boards::horus()?, faults: LineFaults::new(1), at: 30 * MS })
    }

    fn run_to(&mut self, end: u64) {
        while self.node.now() < end {
            self.node.advance(self.at.min(self.faults.next_at()).min(end));
            self.node.board_mut(|board| board.front_end.take_air());
            let now = self.node.now();
            let mut on_lines = self.faults.take(now);
            if now >= self.at {
                let itow_ms = u32::try_from(self.at / MS).unwrap();
                let pvt = NavPvt {
                    itow_ms,
                    valid: 7,
                    fix_type: 3,
                    flags: NavPvt::FLAG_FIX_OK,
                    horizontal_accuracy_mm: 1_200,
                    vertical_accuracy_mm: 2_000,
                    ..NavPvt::default()
                };
                for receiver in 0..3 {
                    on_lines.extend(self.faults.burst(self.at, receiver, &pvt.encode()));
                }
                self.at += 20 * MS;
            }
            for OnLine { at_ns, receiver, frames, .. } in on_lines {
                let bytes: Vec<u8> = frames.iter().map(|frame| frame.data as u8).collect();
                self.node.board_mut(|board| {
                    board.receivers.offer(at_ns, receiver, &bytes);
                    board.receivers.send(at_ns, receiver, frames);
                });
            }
        }
    }

    fn counts(&self) -> [Counts; 3] {
        [0, 1, 2].map(|receiver| Counts::of(&self.node, receiver))
    }

    fn counts_to(&mut self, end: u64) -> [Counts; 3] {
        let before = self.counts();
        self.run_to(end);
        let after = self.counts();
        [0, 1, 2].map(|receiver: usize| after[receiver].since(before[receiver]))
    }
}

/// The number of bytes that HORUS counts on a busy line in 200 ms: 46 080 bytes a second, less those in half of the
/// DMA's ring.
const WITHOUT_A_PAUSE: std::ops::RangeInclusive<u32> = 8_900..=9_500;

/// A check of HORUS's counters for the faulty line after 200 ms. A healthy receiver sends ten messages in this time.
type Arrived = fn(Counts) -> bool;

const LINES: [(ReceiverFault, Arrived); 14] = [
    (ReceiverFault::Silent, |seen| seen == Counts::default()),
    (ReceiverFault::Babbles, |seen| WITHOUT_A_PAUSE.contains(&seen.bytes) && seen.errors == 0 && seen.messages == 0),
    (ReceiverFault::Beginnings, |seen| WITHOUT_A_PAUSE.contains(&seen.bytes) && seen.errors == 0 && seen.messages == 0),
    (ReceiverFault::Unasked, |seen| WITHOUT_A_PAUSE.contains(&seen.bytes) && seen.errors == 0 && seen.damaged == 0),
    (ReceiverFault::Frozen, |seen| seen.messages == 10 && seen.damaged == 0),
    (ReceiverFault::WrongBaud(38_400), |seen| seen.messages == 0 && seen.errors > 100),
    // HORUS receives a break as one character without a stop bit.
    (ReceiverFault::Break, |seen| seen.messages == 0 && (1..=2).contains(&seen.errors) && seen.bytes <= 2),
    (ReceiverFault::Noise, |seen| seen.messages < 8 && seen.damaged > 0 && (1..=6).contains(&seen.errors)),
    (ReceiverFault::FramingErrors, |seen| (30..=100).contains(&seen.errors)),
    (ReceiverFault::Restarts, |seen| seen.messages == 5 && seen.bytes == 500),
    (ReceiverFault::Jumps { metres: 1_000 }, |seen| seen.messages == 10),
    (ReceiverFault::NoFix, |seen| seen.messages == 10),
    (ReceiverFault::LateBursts(60 * MS), |seen| seen.messages == 7 && seen.damaged == 0),
    (ReceiverFault::BadChecksums, |seen| seen.messages == 0 && seen.damaged == 10 && seen.errors == 0),
];

#[test]
fn every_receiver_fault_affects_its_own_receiver_alone_and_ends() {
    let Some(mut healthy) = Fed::new() else { return };
    healthy.run_to(105 * MS);
    let ten = Counts { bytes: 1_000, messages: 10, ..Counts::default() };
    assert_eq!(healthy.clone().counts_to(305 * MS), [ten; 3]);
    let mut wrong = vec![];
    for (fault, arrived) in LINES {
        let mut fed = healthy.clone();
        fed.faults.begin(105 * MS, 305 * MS, 0, fault);
        let [first, others @ ..] = fed.counts_to(305 * MS);
        fed.faults.end(0, fault);
        // The counting begins 100 ms after the fault, when all delayed bytes have arrived.
        fed.run_to(405 * MS);
        let after = fed.counts_to(605 * MS);
        if !arrived(first) || others != [ten; 2] || after != [ten; 3] {
            wrong.push(format!("{fault:?}: {first:?}, others {others:?}, afterwards {after:?}"));
        }
        assert_eq!(fed.node.take_findings(), [], "{fault:?}");
        assert_eq!(fed.node.resets().len(), 0, "{fault:?}");
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

fn emitted<B: Powered>(node: &mut Node<B>, ns: u64) -> Vec<AirEvent> {
    let end = node.now() + ns;
    let mut events = vec![];
    while node.now() < end {
        node.advance(end);
        let taken = node.board_mut(|board| board.front_end().take_air());
        events.extend(taken.into_iter().map(|(_, event)| event));
    }
    events
}

fn frames(events: &[AirEvent]) -> usize {
    events.iter().filter(|event| matches!(event, AirEvent::FrameStart(_))).count()
}

const STARTS: u64 = RAM_TEST + 55 * MS;

/// Runs HORUS until a frame is on the air.
fn into_a_frame(node: &mut Node<Horus>) {
    assert!(frames(&emitted(node, STARTS)) >= 4);
    assert!((0..10).any(|_| frames(&emitted(node, MS)) > 0), "a frame in each cycle");
}

fn breaks_off(events: &[AirEvent]) -> bool {
    // A whole frame of three receivers has 1976 bits.
    matches!(events, [AirEvent::FrameEnd { bits: 0..1_976 }, AirEvent::FieldOff])
}

fn causes<B: Board>(node: &Node<B>) -> Vec<Reset> {
    node.resets().iter().map(|reset| reset.cause).collect()
}

#[test]
fn horus_without_supply_is_off_the_air_until_it_starts_again() {
    let Some(mut node) = boards::horus() else { return };
    into_a_frame(&mut node);
    PowerFault::Off(1).begin(&mut node);
    assert!(!node.is_powered());
    let without = emitted(&mut node, 100 * MS);
    assert!(breaks_off(&without), "{without:?}");
    assert!(causes(&node).is_empty());
    PowerFault::Off(1).end(&mut node);
    assert_eq!(causes(&node), [Reset::PowerOn]);
    assert!(frames(&emitted(&mut node, STARTS)) >= 4);
    assert_eq!(node.resets().len(), 1);
}

#[test]
fn the_dpr_without_supply_has_no_front_end_until_it_starts_again() {
    let Some(mut node) = boards::dpr() else { return };
    node.advance(50 * MS);
    assert!(node.board().front_end.chip().is_powered());
    PowerFault::Off(1).begin(&mut node);
    assert!(!node.is_powered() && !node.board().front_end.chip().is_powered());
    node.advance(150 * MS);
    PowerFault::Off(1).end(&mut node);
    assert!(node.is_powered() && node.board().front_end.chip().is_powered());
    node.advance(200 * MS);
    assert_eq!(causes(&node), [Reset::PowerOn]);
}

#[test]
fn ram_comes_up_with_noise_that_follows_from_the_seed() {
    let Some(node) = boards::dpr() else { return };
    let ram_after = |seed| {
        let mut node = node.clone();
        node.advance(20 * MS);
        PowerFault::Off(seed).begin(&mut node);
        node.advance(40 * MS);
        PowerFault::Off(seed).end(&mut node);
        let mut ram = [0; 64];
        node.read(0x2000_0100, &mut ram).unwrap();
        ram
    };
    assert_eq!(ram_after(1), ram_after(1));
    assert_ne!(ram_after(1), ram_after(2));
}

#[test]
fn a_pin_reset_and_a_brown_out_keep_ram_and_field() {
    for (fault, cause) in [(PowerFault::Pin, Reset::Pin), (PowerFault::BrownOut, Reset::BrownOut)] {
        let Some(mut node) = boards::horus() else { return };
        emitted(&mut node, 55 * MS);
        // The firmware does not use this address below its stack.
        node.write(0x2000_0010, b"kept").unwrap();
        fault.begin(&mut node);
        assert_eq!(causes(&node), [cause]);
        assert!(node.board().front_end.chip().field_on(), "{fault:?}");
        let mut ram = [0; 4];
        node.read(0x2000_0010, &mut ram).unwrap();
        assert_eq!(&ram, b"kept", "{fault:?}");
        fault.end(&mut node);
        assert!(frames(&emitted(&mut node, 75 * MS)) >= 4, "{fault:?}");
        assert_eq!(node.resets().len(), 1, "{fault:?}");
    }
}

#[test]
fn horus_finds_its_front_end_again_after_that_was_without_supply() {
    let Some(mut node) = boards::horus() else { return };
    into_a_frame(&mut node);
    PowerFault::FrontEndOff.begin(&mut node);
    let without = emitted(&mut node, 100 * MS);
    assert!(breaks_off(&without), "{without:?}");
    PowerFault::FrontEndOff.end(&mut node);
    assert!(frames(&emitted(&mut node, 500 * MS)) >= 10);
    assert_eq!(node.resets().len(), 0);
    assert!(counter(&node, "HORUS_TELEMETRY", std::mem::offset_of!(Telemetry, rf_faults)) > 0);
}

#[test]
fn a_front_end_stays_off_without_supply_when_its_fault_ends() {
    let Some(mut node) = boards::dpr() else { return };
    node.advance(20 * MS);
    PowerFault::FrontEndOff.begin(&mut node);
    PowerFault::Off(1).begin(&mut node);
    PowerFault::FrontEndOff.end(&mut node);
    assert!(!node.board().front_end.chip().is_powered());
    PowerFault::Off(1).end(&mut node);
    assert!(node.board().front_end.chip().is_powered());
}

#[test]
fn a_variable_is_overwritten_by_its_symbol_and_mended() {
    let Some(mut node) = boards::horus() else { return };
    node.advance(55 * MS);
    let offset = std::mem::offset_of!(Telemetry, frames_skipped);
    let was = counter(&node, "HORUS_TELEMETRY", offset);
    let repair = poke(&mut node, "HORUS_TELEMETRY", u32::try_from(offset).unwrap(), &[0xD2, 0x02, 0x96, 0x49]).unwrap();
    assert_eq!(counter(&node, "HORUS_TELEMETRY", offset), 1_234_567_890);
    repair.mend(&mut node).unwrap();
    assert_eq!(counter(&node, "HORUS_TELEMETRY", offset), was);
}

#[test]
fn a_symbol_that_the_image_lacks_is_refused_by_its_name() {
    let Some(mut node) = boards::horus() else { return };
    let refused = |fault: ImageFault, node: &mut Node<Horus>| match fault.apply(node) {
        Err(Error::NoSymbol { symbol, .. }) => symbol,
        other => panic!("{other:?}"),
    };
    let poke = ImageFault::Poke { symbol: "NO_SUCH".into(), offset: 0, bytes: vec![0] };
    assert_eq!(refused(poke, &mut node), "NO_SUCH");
    assert_eq!(refused(ImageFault::Hung("no_task".into()), &mut node), "no_task");
}

#[test]
fn only_a_sealed_patch_passes_the_firmwares_check_of_its_flash() {
    let Some(node) = boards::horus() else { return };
    // The patch changes the vector of the window watchdog, which the processor never fetches.
    let patch = |sealed| ImageFault::Patch { address: 0x0800_0040, bytes: vec![0xAA; 4], sealed };
    let mut sealed = node.clone();
    let repair = patch(true).apply(&mut sealed).unwrap();
    assert!(frames(&emitted(&mut sealed, STARTS)) >= 4);
    assert_eq!(sealed.resets().len(), 0);
    let mut open = node.clone();
    let _ = patch(false).apply(&mut open).unwrap();
    assert_eq!(frames(&emitted(&mut open, 300 * MS)), 0);
    assert!(!open.resets().is_empty());
    repair.mend(&mut sealed).unwrap();
    let flash = |node: &Node<Horus>| {
        let mut flash = vec![0; 112 << 10];
        node.read(0x0800_0000, &mut flash).unwrap();
        flash
    };
    assert!(flash(&sealed) == flash(&node));
}

fn targets_of<B: Powered>(mut node: Node<B>, flash: u32) {
    emitted(&mut node, 50 * MS);
    let targets = Targets::of(&node).unwrap();
    let ram: u32 = targets.ram.iter().map(|range| range.end - range.start).sum();
    assert!((2_000..32_768).contains(&ram), "{targets:x?}");
    assert!(targets.ram.iter().all(|range| (0x2000_0000..=0x2001_8000).contains(&range.end)), "{targets:x?}");
    assert!(targets.ram.iter().any(|range| range.start == node.register(13)), "the stack in use: {targets:x?}");
    let [image] = &targets.flash[..] else { panic!("{targets:x?}") };
    assert!(image.start == flash && image.end > flash + 20_000, "{targets:x?}");
    let mut rng = Rng::new(1);
    for kind in [Kind::Ram, Kind::Flash, Kind::Registers] {
        for _ in 0..50 {
            let upset = Upset::drawn(kind, &mut rng, &targets).unwrap();
            let mut copy = node.clone();
            upset.apply(&mut copy).unwrap();
            if kind != Kind::Flash {
                assert_ne!(copy.digest(), node.digest(), "{upset}");
            }
            upset.apply(&mut copy).unwrap();
            assert_eq!(copy.digest(), node.digest(), "{upset}");
        }
    }
}

#[test]
fn upsets_are_drawn_from_what_each_image_uses() {
    let (Some(horus), Some(dpr)) = (boards::horus(), boards::dpr()) else { return };
    targets_of::<Horus>(horus, 0x0800_0000);
    targets_of::<Dpr>(dpr, 0);
}
