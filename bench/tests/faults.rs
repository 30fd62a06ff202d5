//! What the two release images do when something inside them breaks: a task that dies, hangs or faults. What breaks is the image in
//! flash, as a debugger would change it under the running core; nothing else of a board is touched.
//!
//! Each image must come into its safe state by itself, be restarted by its watchdog, and work again once the damage is gone.

mod boards;

use bench::engine::{FindingKind, Node, Wiring};
use bench::sim::boards::{Dpr, Horus, SSI_CSN};
use bench::sim::front_end::FrontEnd;
use profile::LinkStatus;
use rigless::device::ResetCause;
use rigless::time::VirtualNanos;
use st25r3916_model::AirEvent;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// The longest a watchdog may take from the last sign of life to its bite: the independent watchdog's 100 ms at the nominal rate of
/// an oscillator that runs at 17 kHz instead of 32 at worst (DS9405 table 42); the nRF52840's takes 100 ms.
const BITE: u64 = 200 * MS;

/// What a task's first instruction becomes.
#[derive(Clone, Copy, Debug)]
enum Damage {
    /// `BX LR`: the task returns without having done anything, its interrupt not even acknowledged.
    Dead,
    /// `B .`: the task never ends.
    Hung,
    /// `UDF #0`: the task faults.
    Faulting,
}

impl Damage {
    fn instruction(self) -> [u8; 2] {
        match self {
            Self::Dead => 0x4770_u16,
            Self::Hung => 0xE7FE,
            Self::Faulting => 0xDE00,
        }
        .to_le_bytes()
    }
}

/// Puts `damage` where `task` begins, and answers what repairs it.
fn break_task<B: Wiring>(node: &mut Node<B>, task: &str, damage: Damage) -> (u64, [u8; 2]) {
    let address = node.address_of(task).unwrap() & !1;
    let mut was = [0; 2];
    node.read(address, &mut was).unwrap();
    node.write(address, &damage.instruction()).unwrap();
    (address, was)
}

/// Runs to the board's next restart, and answers when it was. `look` is called whenever something left the board.
fn until_restart<B: Wiring>(node: &mut Node<B>, within: u64, mut look: impl FnMut(&mut Node<B>)) -> u64 {
    let end = node.now() + within;
    while node.now() < end {
        let restarted = node.advance_to_restart(end);
        look(node);
        if restarted {
            return node.now();
        }
    }
    panic!("no restart within {} ms", within / MS);
}

fn logged<B: Wiring>(node: &mut Node<B>) -> String {
    node.take_log().iter().map(|line| format!("{line}\n")).collect()
}

fn faulted<B: Wiring>(node: &mut Node<B>) -> bool {
    node.take_findings().iter().any(|finding| finding.kind == FindingKind::HardFault)
}

// ---- HORUS

struct Transmitter {
    node: Node<Horus>,
    chip: FrontEnd,
    air: Vec<(u64, AirEvent)>,
}

/// The HORUS board, without a receiver that sends.
fn transmitter() -> Option<Transmitter> {
    let (node, chip, _) = boards::horus()?;
    Some(Transmitter { node, chip, air: vec![] })
}

impl Transmitter {
    fn run_for(&mut self, ns: u64) {
        let end = self.node.now() + ns;
        while self.node.now() < end {
            self.node.advance(end);
            self.chip.with(|chip| self.air.extend(chip.take_air()));
        }
    }

    /// Frames that began in `from..`.
    fn frames(&self, from: u64) -> usize {
        self.air.iter().filter(|(at, event)| *at >= from && matches!(event, AirEvent::FrameStart(_))).count()
    }

    fn field_off(&self, from: u64) -> Option<u64> {
        self.air.iter().find(|(at, event)| *at >= from && matches!(event, AirEvent::FieldOff)).map(|(at, _)| *at)
    }

    fn until_restart(&mut self) -> u64 {
        let Self { node, chip, air } = self;
        until_restart(node, BITE, |_| chip.with(|chip| air.extend(chip.take_air())))
    }
}

/// The tasks that have to check in, and the one that makes them run.
const HORUS_TASKS: [(&str, &str); 4] =
    [("TIM2", "slot"), ("CAN1_TX", "rf_slot"), ("CAN1_RX0", "cycle"), ("CAN1_RX1", "parse")];

#[test]
fn horus_restarts_when_a_task_dies_or_hangs_and_sends_again() {
    for (vector, task) in HORUS_TASKS {
        for damage in [Damage::Dead, Damage::Hung] {
            let Some(mut horus) = transmitter() else { return };
            horus.run_for(55 * MS);
            assert_eq!(horus.frames(0), 5, "{task}");
            let (address, was) = break_task(&mut horus.node, vector, damage);
            let restarted = horus.until_restart();
            let causes: Vec<ResetCause> = horus.node.resets().map(|reset| reset.cause).collect();
            assert_eq!(causes, [ResetCause::Model("IWDG")], "{task} {damage:?}");
            horus.node.write(address, &was).unwrap();
            horus.run_for(55 * MS);
            assert!(horus.frames(restarted) >= 4, "{task} {damage:?}: {} frames", horus.frames(restarted));
            assert_eq!(horus.node.resets().len(), 1, "{task} {damage:?}");
            let log = logged(&mut horus.node);
            assert!(log.contains("1 watchdog resets"), "{task} {damage:?}: {log}");
        }
    }
}

#[test]
fn a_fault_in_horus_switches_the_field_off_at_once_and_the_watchdog_brings_it_back() {
    for (vector, task) in HORUS_TASKS {
        let Some(mut horus) = transmitter() else { return };
        horus.run_for(55 * MS);
        let (broken, (address, was)) = (horus.node.now(), break_task(&mut horus.node, vector, Damage::Faulting));
        let restarted = horus.until_restart();
        // Each of them runs in every cycle.
        let off = horus.field_off(broken).unwrap_or_else(|| panic!("{task}: the field stayed on"));
        assert!(off <= broken + 11 * MS, "{task}: {off}");
        assert!(restarted > off);
        assert_eq!(horus.frames(off), 0, "{task}: frames after the field was off");
        assert!(faulted(&mut horus.node), "{task}");
        let log = logged(&mut horus.node);
        assert!(log.contains("hard fault at"), "{task}: {log}");
        horus.node.write(address, &was).unwrap();
        horus.run_for(55 * MS);
        assert!(horus.frames(restarted) >= 4, "{task}: {} frames", horus.frames(restarted));
    }
}

// ---- DPR

/// What one transaction of `bytes` bytes reads from the DPR.
fn read_image(node: &mut Node<Dpr>, bytes: usize) -> Vec<u8> {
    fn pass(node: &mut Node<Dpr>, ns: u64) {
        node.advance(node.now() + ns);
    }
    node.input(|board, now| board.part_mut().ssi_select(VirtualNanos(now), SSI_CSN));
    pass(node, 5 * US);
    let read = (0..bytes)
        .map(|_| {
            pass(node, US + 100);
            node.input(|board, now| board.part_mut().ssi_clock(VirtualNanos(now), 0)).unwrap_or(0xFF)
        })
        .collect();
    pass(node, 2 * US);
    node.input(|board, now| board.part_mut().ssi_deselect(VirtualNanos(now), SSI_CSN));
    pass(node, 20 * US);
    read
}

fn link_status(node: &mut Node<Dpr>) -> LinkStatus {
    let read = read_image(node, LinkStatus::SIZE);
    *LinkStatus::verify(&read).unwrap_or_else(|rejection| panic!("{rejection} in {read:02x?}"))
}

/// The tasks that run without a frame: all but `commit`, whose place `deadline` takes.
const DPR_TASKS: [(&str, &str); 4] = [
    ("SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1", "ssi_end"),
    ("GPIOTE", "rf_irq"),
    ("TIMER1", "deadline"),
    ("SWI1_EGU1", "scrub"),
];

#[test]
fn the_dpr_restarts_when_a_task_dies_or_hangs_and_says_so() {
    for (vector, task) in DPR_TASKS {
        for damage in [Damage::Dead, Damage::Hung] {
            let Some((mut dpr, _)) = boards::dpr() else { return };
            dpr.advance(50 * MS);
            assert!(!link_status(&mut dpr).status().unasked_reset(), "{task}");
            let (address, was) = break_task(&mut dpr, vector, damage);
            until_restart(&mut dpr, BITE, |_| {});
            assert_eq!(dpr.board().part().watchdog_resets().len(), 1, "{task} {damage:?}");
            dpr.write(address, &was).unwrap();
            dpr.advance(dpr.now() + 50 * MS);
            assert!(link_status(&mut dpr).status().unasked_reset(), "{task} {damage:?}");
            assert_eq!(dpr.resets().len(), 1, "{task} {damage:?}");
        }
    }
}

#[test]
fn a_fault_in_the_dpr_leaves_nothing_to_be_read_until_the_watchdog_has_restarted_it() {
    for (vector, task) in DPR_TASKS {
        let Some((mut dpr, _)) = boards::dpr() else { return };
        dpr.advance(50 * MS);
        let (address, was) = break_task(&mut dpr, vector, Damage::Faulting);
        // The deadline monitor comes round every 12.5 ms and makes each of them run.
        dpr.advance(dpr.now() + 15 * MS);
        assert!(faulted(&mut dpr), "{task}");
        let read = read_image(&mut dpr, LinkStatus::SIZE);
        assert!(read.iter().all(|&byte| byte == 0xFF), "{task}: {read:02x?}");
        let log = logged(&mut dpr);
        assert!(log.contains("hard fault at"), "{task}: {log}");
        until_restart(&mut dpr, BITE, |_| {});
        dpr.write(address, &was).unwrap();
        dpr.advance(dpr.now() + 50 * MS);
        assert!(link_status(&mut dpr).status().unasked_reset(), "{task}");
    }
}
