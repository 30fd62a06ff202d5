//! Tests both release programs with internal faults: a task does nothing, hangs, or executes an undefined instruction.
//! For this the program in memory is changed while the core runs.
//!
//! Each board must enter its safe state. Its watchdog must restart it, and after the repair it must work again.

use crate::{boards, reader};

use bench::boards::{Dpr, Horus};
use bench::faults::Upset;
use bench::faults::image::{ImageFault, Repair};
use bench::world::ssi::{Crystal, Order, Progress, SsiMaster, Start};
use emulator_node::{Board, Downstream, FindingKind, Node, Relay, Threads, Upstream};
use emulator_part::Reset;
use profile::image::Image;
use profile::{GpsObject, Identifier, LinkStatus, ReportedPosition};
use reader::transact;
use st25r3916_model::{Air, AirEvent, AirFaults};

const US: u64 = 1_000;
const MS: u64 = 1_000_000;

/// HORUS's watchdog takes 100 ms at 32 kHz, but its oscillator may run at 17 kHz (DS9405 table 42).
const BITE: u64 = 200 * MS;

const STARTS: u64 = boards::RAM_TEST + 55 * MS;

const DAMAGES: [(Damage, &str); 2] = [(ImageFault::Dead, "dead"), (ImageFault::Hung, "hung")];

type Damage = fn(String) -> ImageFault;

fn break_task<B: Board>(node: &mut Node<B>, vector: &str, damage: Damage) -> Repair {
    damage(vector.to_owned()).apply(node).unwrap()
}

/// Runs to the board's next restart, and returns its instant. Calls `look` after each step.
fn until_restart<B: Board>(node: &mut Node<B>, within: u64, mut look: impl FnMut(&mut Node<B>)) -> u64 {
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

fn logged<B: Board>(node: &mut Node<B>) -> String {
    node.take_log().iter().map(|line| format!("{line}\n")).collect()
}

fn faulted<B: Board>(node: &mut Node<B>) -> bool {
    node.take_findings().iter().any(|finding| finding.kind == FindingKind::HardFault)
}

struct Transmitter {
    node: Node<Horus>,
    air: Vec<(u64, AirEvent)>,
}

fn transmitter() -> Option<Transmitter> {
    Some(Transmitter { node: boards::horus()?, air: vec![] })
}

impl Transmitter {
    fn run_for(&mut self, ns: u64) {
        let end = self.node.now() + ns;
        while self.node.now() < end {
            self.node.advance(end);
            self.air.extend(self.node.board_mut(|board| board.front_end.take_air()));
        }
    }

    fn frames(&self, from: u64) -> usize {
        self.air.iter().filter(|(at, event)| *at >= from && matches!(event, AirEvent::FrameStart(_))).count()
    }

    fn field_off(&self, from: u64) -> Option<u64> {
        self.air.iter().find(|(at, event)| *at >= from && matches!(event, AirEvent::FieldOff)).map(|(at, _)| *at)
    }

    fn until_restart(&mut self) -> u64 {
        let Self { node, air } = self;
        until_restart(node, BITE, |node| air.extend(node.board_mut(|board| board.front_end.take_air())))
    }
}

const HORUS_TASKS: [(&str, &str); 4] =
    [("TIM2", "slot"), ("CAN1_TX", "rf_slot"), ("CAN1_RX0", "cycle"), ("CAN1_RX1", "parse")];

#[test]
fn horus_restarts_when_a_task_dies_or_hangs_and_sends_again() {
    for (vector, task) in HORUS_TASKS {
        for (damage, name) in DAMAGES {
            let Some(mut horus) = transmitter() else { return };
            horus.run_for(STARTS);
            assert_eq!(horus.frames(0), 5, "{task}");
            let repair = break_task(&mut horus.node, vector, damage);
            let restarted = horus.until_restart();
            let causes: Vec<Reset> = horus.node.resets().iter().map(|reset| reset.cause).collect();
            assert_eq!(causes, [Reset::Watchdog("IWDG")], "{task} {name}");
            repair.mend(&mut horus.node).unwrap();
            horus.run_for(STARTS);
            assert!(horus.frames(restarted) >= 4, "{task} {name}: {} frames", horus.frames(restarted));
            assert_eq!(horus.node.resets().len(), 1, "{task} {name}");
            let log = logged(&mut horus.node);
            assert!(log.contains("1 watchdog resets"), "{task} {name}: {log}");
        }
    }
}

#[test]
fn a_fault_in_a_horus_task_switches_the_field_off_at_once() {
    for (vector, task) in HORUS_TASKS {
        let Some(mut horus) = transmitter() else { return };
        horus.run_for(STARTS);
        let (broken, repair) = (horus.node.now(), break_task(&mut horus.node, vector, ImageFault::Faulting));
        let restarted = horus.until_restart();
        // Each of these tasks runs in every cycle, and so does its fault.
        let off = horus.field_off(broken).unwrap_or_else(|| panic!("{task}: the field stayed on"));
        assert!(off <= broken + 11 * MS, "{task}: {off}");
        assert!(restarted > off);
        assert_eq!(horus.frames(off), 0, "{task}: frames after the field was off");
        assert!(faulted(&mut horus.node), "{task}");
        let log = logged(&mut horus.node);
        assert!(log.contains("usage fault, undefined instruction"), "{task}: {log}");
        repair.mend(&mut horus.node).unwrap();
        horus.run_for(STARTS);
        assert!(horus.frames(restarted) >= 4, "{task}: {} frames", horus.frames(restarted));
    }
}

fn link_status(node: &mut Node<Dpr>) -> LinkStatus {
    let read = transact(node, LinkStatus::SIZE, 0);
    *LinkStatus::verify(&read).unwrap_or_else(|rejection| panic!("{rejection} in {read:02x?}"))
}

/// The DPR's tasks that run without frames, each as its vector and its name. `commit` is left out because `deadline`
/// does its work then.
const DPR_TASKS: [(&str, &str); 4] = [
    ("SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1", "ssi_end"),
    ("GPIOTE", "rf_irq"),
    ("TIMER1", "deadline"),
    ("SWI1_EGU1", "scrub"),
];

#[test]
fn the_dpr_restarts_when_a_task_dies_or_hangs_and_says_so() {
    for (vector, task) in DPR_TASKS {
        for (damage, name) in DAMAGES {
            let Some(mut dpr) = boards::dpr() else { return };
            dpr.advance(50 * MS);
            assert!(!link_status(&mut dpr).status().unasked_reset(), "{task}");
            let repair = break_task(&mut dpr, vector, damage);
            until_restart(&mut dpr, BITE, |_| {});
            assert_eq!(dpr.part().watchdog_resets().len(), 1, "{task} {name}");
            repair.mend(&mut dpr).unwrap();
            dpr.advance(dpr.now() + 50 * MS);
            assert!(link_status(&mut dpr).status().unasked_reset(), "{task} {name}");
            assert_eq!(dpr.resets().len(), 1, "{task} {name}");
        }
    }
}

// Shows SAFE-15.
#[test]
fn a_fault_in_a_dpr_task_leaves_nothing_readable_until_the_restart() {
    for (vector, task) in DPR_TASKS {
        let Some(mut dpr) = boards::dpr() else { return };
        dpr.advance(50 * MS);
        let repair = break_task(&mut dpr, vector, ImageFault::Faulting);
        // The task `deadline` runs every 12.5 ms and calls the damaged one.
        dpr.advance(dpr.now() + 15 * MS);
        assert!(faulted(&mut dpr), "{task}");
        let read = transact(&mut dpr, LinkStatus::SIZE, 0);
        assert!(read.iter().all(|&byte| byte == 0xFF), "{task}: {read:02x?}");
        let log = logged(&mut dpr);
        assert!(log.contains("usage fault, undefined instruction"), "{task}: {log}");
        until_restart(&mut dpr, BITE, |_| {});
        repair.mend(&mut dpr).unwrap();
        dpr.advance(dpr.now() + 50 * MS);
        assert!(link_status(&mut dpr).status().unasked_reset(), "{task}");
    }
}

/// The longest time from a frame's end for which its objects may be read as valid, ns.
const STALE: u64 = 30 * MS;

/// A flight controller that reads the image all the time, and the air to the DPR.
struct Reader {
    master: SsiMaster,
    transactions: usize,
    /// The instant of each transaction, and the timestamps of the valid objects that it read.
    read: Vec<(u64, Vec<u32>)>,
    air: Air,
    frame: Vec<u8>,
    sent: std::collections::BTreeMap<u32, u64>,
    /// Whether the air loses all frames while the task is damaged. A task that runs only without frames needs this.
    loses: bool,
    lost: bool,
    broken: Option<(u64, Repair)>,
    repaired: bool,
}

const FIRST_READ: u64 = 20 * MS;

const PAUSES: [u64; 3] = [US * 700, US * 2_150, US * 3_600];

impl Reader {
    fn new(loses: bool) -> Self {
        let mut reader = Self {
            loses,
            lost: false,
            master: SsiMaster::new(Crystal::default()),
            transactions: 0,
            read: vec![],
            air: Air::new(1, AirFaults::default()),
            frame: vec![],
            sent: std::collections::BTreeMap::new(),
            broken: None,
            repaired: false,
        };
        reader.read_at(FIRST_READ);
        reader
    }

    fn read_at(&mut self, at: u64) {
        self.master.begin(Start { bench_ns: at, own_ns: 0 }, Order::read(Image::<3>::LEN));
    }

    fn valid(image: &[u8]) -> Vec<u32> {
        let objects = &image[LinkStatus::SIZE..];
        let (reported, gps) = objects.split_at(ReportedPosition::SIZE);
        let reported = ReportedPosition::verify(reported).ok().map(ReportedPosition::timestamp);
        let gps = gps.as_chunks::<{ GpsObject::SIZE }>().0.iter().zip(1..).filter_map(|(bytes, nth)| {
            GpsObject::verify(bytes, Identifier(0x4800 + nth)).ok().map(GpsObject::timestamp)
        });
        reported.into_iter().chain(gps).collect()
    }

    fn oldest(&self) -> (u64, u64) {
        let timestamps = self.read.iter().flat_map(|(at, valid)| valid.iter().map(move |ms| (*at, *ms)));
        let ages = timestamps.map(|(at, ms)| {
            let ended = self.sent.get(&ms).unwrap_or_else(|| panic!("{ms} ms was never sent"));
            (at, at - ended)
        });
        ages.max_by_key(|(_, age)| *age).expect("something was read")
    }

    fn valid_reads(&self, from: u64) -> usize {
        self.read.iter().filter(|(at, valid)| *at >= from && !valid.is_empty()).count()
    }
}

impl Downstream<Dpr> for Reader {
    type Message = AirEvent;
    type Notes = ();

    fn hear(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr>) {
        match &event {
            AirEvent::FrameStart(start) => self.frame.clone_from(&start.chunk.data),
            AirEvent::Bytes(chunk) => self.frame.extend(&chunk.data),
            AirEvent::FrameEnd { .. } => {
                let timestamp = self.frame[1..5].try_into().unwrap();
                self.sent.insert(u32::from_le_bytes(timestamp), at);
            }
            AirEvent::FieldOn | AirEvent::FieldOff => {}
        }
        if matches!(event, AirEvent::FrameStart(_)) {
            self.lost = self.loses && self.broken.is_some() && !self.repaired;
        }
        if self.lost && !matches!(event, AirEvent::FieldOn | AirEvent::FieldOff) {
            return;
        }
        let air = &mut self.air;
        node.board_mut(|board| air.from_poller(at, event, &mut |at, event| board.front_end.hear(at, event)));
    }

    fn noted(&mut self, (): ()) {}

    fn leave(&mut self, node: &mut Node<Dpr>) {
        node.board_mut(|board| board.front_end.take_air());
    }

    fn next_at(&self) -> u64 {
        self.master.next_at()
    }

    fn act(&mut self, _at: u64, node: &mut Node<Dpr>) {
        if let Some(Progress::Over(transaction)) = self.master.act(node) {
            self.read.push((transaction.selected_ns, Self::valid(&transaction.miso)));
            self.read_at(self.master.free_at() + PAUSES[self.transactions % PAUSES.len()]);
            self.transactions += 1;
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

/// All tasks of the DPR, each as its vector and its name. `idle` has no vector.
const EVERY_DPR_TASK: [(&str, &str); 8] = [
    ("SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1", "ssi_end"),
    ("SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0", "rf_spi"),
    ("GPIOTE", "rf_irq"),
    ("TIMER0", "rf_timer"),
    ("SWI0_EGU0", "commit"),
    ("TIMER1", "deadline"),
    ("SWI1_EGU1", "scrub"),
    ("", "idle"),
];

const ON_LOSS: [&str; 2] = ["rf_timer", "deadline"];

/// Makes a task hang; `idle` hangs at the instruction at which it sleeps.
fn hang(node: &mut Node<Dpr>, vector: &str) -> Option<Repair> {
    if !vector.is_empty() {
        return Some(break_task(node, vector, ImageFault::Hung));
    }
    let address = node.is_asleep().then(|| u64::from(node.register(15)))?;
    let name = node.firmware().name_of(address).unwrap_or_default();
    assert!(name.contains("idle"), "the core sleeps in {name}");
    Some(ImageFault::Stopped(u32::try_from(address).unwrap()).apply(node).unwrap())
}

/// Hangs a task of the DPR at `breaks_at` while the flight controller reads. The damage is repaired after the restart,
/// but a firmware that finds it first restarts once more.
fn hung(vector: &str, task: &str, breaks_at: u64) -> Option<Reader> {
    let (Some(a), Some(b)) = (boards::horus(), boards::dpr()) else { return None };
    let mut relay = Relay { a, b, upstream: Antenna, downstream: Reader::new(ON_LOSS.contains(&task)) };
    let ended = relay.run(700 * MS, 250 * US, Threads::Two, |at, node, reader| {
        match (&reader.broken, reader.repaired) {
            (None, _) if at >= breaks_at => {
                reader.broken = hang(node, vector).map(|repair| (at, repair));
            }
            (Some((_, repair)), false) if !node.resets().is_empty() => {
                repair.mend(node).unwrap();
                reader.repaired = true;
            }
            (Some((broken, _)), true) if reader.valid_reads(broken + 100 * MS) >= 5 => return Err(()),
            _ => {}
        }
        Ok(())
    });
    let (dpr, reader) = (relay.b, relay.downstream);
    let &(broken, _) = reader.broken.as_ref().unwrap_or_else(|| panic!("{task} was not broken"));
    assert!(reader.valid_reads(0) - reader.valid_reads(broken) >= 10, "{task}: it worked before");
    assert!(reader.repaired, "{task}: the watchdog did not restart the DPR");
    assert!((1..=2).contains(&dpr.resets().len()), "{task}: {} restarts", dpr.resets().len());
    assert_eq!(ended, Err(()), "{task}: nothing valid after the repair");
    Some(reader)
}

#[test]
fn no_dpr_task_that_hangs_leaves_old_data_readable_as_valid() {
    let mut stale = vec![];
    for (nth, (vector, task)) in EVERY_DPR_TASK.into_iter().enumerate() {
        // The damage begins in another phase of HORUS's cycle for each task.
        let Some(reader) = hung(vector, task, 110 * MS + nth as u64 * 1_250 * US) else { return };
        let (at, age) = reader.oldest();
        println!("{task} hung: the oldest data read as valid were {} us old", age / US);
        if age > STALE {
            stale.push(format!("{task}: at {} us valid, {} us after its frame's last bit", at / US, age / US));
        }
    }
    assert!(stale.is_empty(), "{stale:#?}");
}

fn unused_vector(table: u64, interrupt: u64) -> u64 {
    table + 4 * (16 + interrupt)
}

fn flip<B: Board>(node: &mut Node<B>, address: u64) {
    let address = u32::try_from(address).unwrap();
    Upset::Flash { address, bit: 3 }.apply(node).unwrap();
}

#[test]
fn horus_emits_no_field_while_a_bit_of_its_flash_is_wrong() {
    let Some(mut horus) = transmitter() else { return };
    // The flipped bit is in the vector of interrupt 0, that of the window watchdog, which is never used.
    let address = unused_vector(0x0800_0000, 0);
    flip(&mut horus.node, address);
    horus.run_for(500 * MS);
    assert!(!horus.air.iter().any(|(_, event)| matches!(event, AirEvent::FieldOn)), "the field went on");
    let causes: Vec<Reset> = horus.node.resets().iter().map(|reset| reset.cause).collect();
    assert!(causes.len() >= 2, "{causes:?}");
    assert!(causes.iter().all(|cause| *cause == Reset::Watchdog("IWDG")), "{causes:?}");
    let log = logged(&mut horus.node);
    assert!(log.contains("flash"), "{log}");
    flip(&mut horus.node, address);
    let restarted = horus.until_restart();
    horus.run_for(STARTS);
    assert!(horus.frames(restarted) >= 4, "{} frames", horus.frames(restarted));
}

#[test]
fn the_dpr_shows_nothing_while_a_bit_of_its_flash_is_wrong() {
    let Some(mut dpr) = boards::dpr() else { return };
    // Interrupt 1, the radio's, is unused.
    let address = unused_vector(0, 1);
    flip(&mut dpr, address);
    while dpr.now() < 500 * MS {
        dpr.advance(dpr.now() + 7 * MS);
        let read = transact(&mut dpr, LinkStatus::SIZE, 0);
        assert!(read.iter().all(|&byte| byte == 0xFF), "at {} us: {read:02x?}", dpr.now() / US);
    }
    let bites = dpr.part().watchdog_resets().len();
    assert!(bites >= 2, "{bites} watchdog resets");
    assert_eq!(dpr.resets().len(), bites, "and no other");
    let log = logged(&mut dpr);
    assert!(log.contains("flash"), "{log}");
    // The bit flips back when the firmware has found it and waits for the watchdog.
    until_restart(&mut dpr, BITE, |_| {});
    dpr.advance(dpr.now() + 50 * MS);
    flip(&mut dpr, address);
    until_restart(&mut dpr, BITE, |_| {});
    dpr.advance(dpr.now() + 50 * MS);
    assert!(link_status(&mut dpr).status().unasked_reset());
}

#[test]
fn a_test_without_its_images_fails_only_where_ci_runs() {
    let words = "not run: there is no image (build it)".to_owned();
    assert_eq!(boards::verdict(true, "there is no image", "build it"), Err(words.clone()));
    assert_eq!(boards::verdict(false, "there is no image", "build it"), Ok(words));
}
