//! Searches for long executions, blocking and demands: runs release images, and observes all processors.

use std::path::{Path, PathBuf};

use bench::faults::{Conduct, Fault, Faults, Kind};
use bench::sim::phases::{Edge, Placement, Sweep};
use bench::sim::{Crystals, Error, Images, Setup, processors};
use bench_judge::Log;
use cortex_m4::Register;
use emulator_node::{AnyNode, Clock, Firmware, Stack, Threads, Usage};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use crate::observe::{Observations, Observer, Span, Watched};
use crate::tasks::{Bounded, Table};

const MS: u64 = 1_000_000;

/// The interval at which the observers take the events of the boards, virtual ns.
const PIECE: u64 = 100 * MS;

/// The number of bytes at the bottom of the stack that may hold guard words (`firmware-common/guards.x`).
const GUARD: u32 = 64;

/// The length of the windows in which the load is measured, virtual ns. The first window, with the boards' start, does
/// not count.
const LOAD_WINDOW: u64 = 500 * MS;

/// The images of a search.
#[derive(Clone, Debug)]
pub struct TimingImages {
    /// The images of HORUS and of the DPR.
    pub link: Images,
    /// The image of the DPR with the port of a hold.
    pub dpr_with_hold: PathBuf,
    /// The image of the hold.
    pub hold: PathBuf,
}

/// A run of a search, with its name and its setup.
#[derive(Clone, Debug)]
pub struct Run {
    /// The run's name.
    pub name: String,
    /// The run's setup.
    pub setup: Setup,
}

impl Run {
    /// The tables of the boards of this run.
    #[must_use]
    pub fn tables(&self) -> Vec<Table> {
        let with_hold = self.setup.hold.is_some();
        let two = [Table::horus(self.setup.gps), Table::dpr(with_hold)];
        two.into_iter().chain(with_hold.then(Table::hold)).collect()
    }
}

/// Returns the run whose worst cycle a chart shows: the link with a hold, without faults.
#[must_use]
pub fn charted(images: &TimingImages, gps: usize, clock: Clock) -> Run {
    let link = Images { dpr: images.dpr_with_hold.clone(), ..images.link.clone() };
    let setup = Setup { clock, writes: true, hold: Some(images.hold.clone()), ..Setup::new(link, gps, 1_500 * MS) };
    Run { name: "chart".to_owned(), setup }
}

/// Returns the runs in which the longest times are searched for, with `gps` receivers on `clock`.
///
/// | what | why |
/// |---|---|
/// | an ordinary run, whose flight controller writes and slips through every phase | usual work in every phase |
/// | a sweep of transactions around each frame's end, in steps of 0.3 µs | the SSI meets the publication |
/// | each group of faults, drawn from a seed, and several together | work that only a fault causes |
/// | a flight controller that toggles chip select, hammers, reads back to back | the SSI as often as it can come |
/// | receivers with 25 solutions a second; receivers as delivered | the most bytes to parse, and to send |
/// | a hold beside the DPR, ordinary and with its faults | the second port, and the hold |
#[must_use]
pub fn runs(images: &TimingImages, gps: usize, clock: Clock) -> Vec<Run> {
    let setup = |seed: u64, length: u64| Setup {
        clock,
        seed,
        threads: Threads::One,
        writes: true,
        crystals: Crystals {
            horus_ppb: 200_000,
            dpr_ppb: -200_000,
            flight_controller_ppb: -1_000_000,
            hold_ppb: 200_000,
        },
        ..Setup::new(images.link.clone(), gps, length * MS)
    };
    let mut runs = vec![];
    let mut add = |name: &str, setup: Setup| runs.push(Run { name: name.to_owned(), setup });
    add("ordinary", setup(1, 3_000));
    for frame in 0..if gps == 5 { 2 } else { 1 } {
        let falls = |after_ns, bytes| Placement { edge: Edge::Falls, after_ns, bytes: Some(bytes) };
        let whole = Placement { edge: Edge::Rises, after_ns: 0, bytes: None };
        let patterns = vec![vec![whole, falls(11_000, 96)], vec![falls(0, 8)]];
        let sweep = Sweep { frame, from_ns: -40_000, to_ns: 140_000, step_ns: 300, patterns };
        let length = (sweep.cycles() + 7) * 10;
        add("sweep", Setup { sweep: Some(sweep), ..setup(2, length) });
    }
    let link = [
        Kind::Air,
        Kind::Gnss,
        Kind::FlightController,
        Kind::Power,
        Kind::Buffers,
        Kind::Inputs,
        Kind::Hang,
        Kind::Chips,
    ];
    for kind in link {
        let length = 4_000;
        let faults = Faults::drawn(&[kind], gps, 3, length * MS);
        add(&format!("faults: {kind}"), Setup { faults, ..setup(3, length) });
    }
    let faults = Faults::drawn(&[Kind::Air, Kind::Gnss, Kind::FlightController, Kind::Inputs], gps, 9, 4_000 * MS);
    add("faults together", Setup { faults, ..setup(9, 4_000) });
    for conduct in [Conduct::Edges(1_000), Conduct::Hammers, Conduct::BackToBack] {
        let faults = Faults::none().with(300 * MS, u64::MAX, Fault::FlightController(conduct));
        add(conduct.name(), Setup { faults, ..setup(4, 1_000) });
    }
    add("25 Hz", Setup { receiver_hz: Some(25), ..setup(5, 3_000) });
    add("as delivered", Setup { factory_settings: true, ..setup(6, 3_000) });
    let with_hold = |setup: Setup| Setup {
        images: Images { dpr: images.dpr_with_hold.clone(), ..images.link.clone() },
        hold: Some(images.hold.clone()),
        ..setup
    };
    add("hold", with_hold(setup(7, 3_000)));
    let faults = Faults::drawn(&[Kind::Hold], gps, 8, 12_000 * MS);
    add("faults: hold", Setup { faults, ..with_hold(setup(8, 12_000)) });
    runs
}

/// The observations of one board.
#[derive(Clone, Debug, Default)]
pub struct BoardSeen {
    /// The observations of the board's tasks.
    pub observations: Observations,
    /// The highest load of the processor in half a second, 0 to 1.
    pub load: f64,
    /// The number of used bytes of the stack, and its size, bytes.
    pub stack: (usize, usize),
    /// The priority that the firmware has given to each task's exception.
    pub priorities: Vec<i16>,
    /// The number of each task's exception.
    pub exceptions: Vec<u16>,
    /// The pieces of all running code, if they were kept.
    pub spans: Vec<Span>,
}

impl BoardSeen {
    /// Adds the observations of another run of the same board.
    pub fn merge(&mut self, other: Self) {
        self.observations.merge(other.observations);
        self.load = self.load.max(other.load);
        self.stack = (self.stack.0.max(other.stack.0), self.stack.1.max(other.stack.1));
        (self.priorities, self.exceptions) = (other.priorities, other.exceptions);
    }
}

/// The table of a board's tasks, and the observations of these tasks.
pub type SeenTable = (Table, BoardSeen);

/// Makes all `runs`, on all cores. Returns each board's table with the observations, and the violations.
///
/// # Errors
///
/// An ELF file cannot be loaded.
pub fn search(runs: Vec<Run>) -> Result<(Vec<SeenTable>, Vec<String>), Error> {
    let shown: Vec<(Run, Shown)> = runs
        .into_par_iter()
        .map(|run| {
            let shown = observe(&run.setup, &run.tables(), false)?;
            Ok((run, shown))
        })
        .collect::<Result<_, Error>>()?;
    let mut boards: Vec<SeenTable> = vec![];
    let mut violations = vec![];
    for (run, shown) in shown {
        violations.extend(shown.violations.into_iter().map(|violation| format!("{}: {violation}", run.name)));
        for (table, seen) in run.tables().into_iter().zip(shown.boards) {
            match boards.iter_mut().find(|(of, _)| of.board == table.board) {
                Some((_, all)) => all.merge(seen),
                None => boards.push((table, seen)),
            }
        }
    }
    Ok((boards, violations))
}

struct Watch {
    observer: Observer,
    stack: Option<Stack>,
    seen: BoardSeen,
    usage: Usage,
    resets: u64,
}

impl Watch {
    fn new(node: &mut dyn AnyNode, bottom: Option<u32>, table: &Table, spans: bool) -> Self {
        node.watch_schedule(true);
        let exception = |vector| node.exception(vector).unwrap_or(u16::MAX);
        let exceptions: Vec<u16> = table.tasks.iter().map(|task| exception(task.vector)).collect();
        let tasks = table.tasks.iter().zip(&exceptions).map(|(task, &number)| Watched {
            exception: number,
            priority: task.priority,
            group: task.group as usize,
            within: task.arrivals.within,
            horizon: 2 * task.deadline,
            is_step: task.is_step,
            is_stepped: task.is_step && !task.name.ends_with("_irq") && !task.name.ends_with("_slot"),
            together: task.together.map(exception),
        });
        let measured = table.tasks.iter().filter(|task| task.group.on_others() == Bounded::Measured);
        let chains: Vec<usize> = measured.map(|task| task.group as usize).collect();
        let observer = Observer::new(tasks.collect(), &chains, table.horizon, spans);
        let stack = node.stack().map(|stack| match bottom {
            Some(bottom) => Stack { bottom: bottom.max(stack.bottom).min(stack.top), ..stack },
            None => stack,
        });
        let seen = BoardSeen { exceptions, ..BoardSeen::default() };
        Self { observer, stack, seen, usage: node.usage(), resets: 0 }
    }

    fn take(&mut self, node: &mut dyn AnyNode, reached: u64) {
        self.observer.take(node.take_schedule());
        // The stack is measured only after the start, because the memory test of the start clears the whole stack, and
        // not while interrupts are masked: the patrol then has its patterns in words that no task has used.
        let is_masked = node.core_register(Register::Primask) & 1 != 0;
        if let Some(stack) = self.stack.filter(|_| self.observer.has_started() && !is_masked) {
            let used = node.stack_touched(stack, GUARD);
            self.seen.stack = (self.seen.stack.0.max(used), stack.size());
        }
        if reached.is_multiple_of(LOAD_WINDOW) {
            let usage = node.usage();
            let load = usage.since(std::mem::replace(&mut self.usage, usage)).load();
            // A start occupies the processor for about 50 ms.
            if std::mem::replace(&mut self.resets, self.observer.resets()) == self.observer.resets()
                && reached > LOAD_WINDOW
            {
                self.seen.load = self.seen.load.max(load);
            }
        }
    }

    fn finish(self) -> BoardSeen {
        let (observations, spans) = self.observer.finish();
        BoardSeen { observations, spans, ..self.seen }
    }
}

/// The outcome of one run: the observations of each board, the violations, and with `spans` the event log.
#[derive(Clone, Debug)]
pub struct Shown {
    /// The observations of HORUS, of the DPR, and of a hold if there is one.
    pub boards: Vec<BoardSeen>,
    /// The violations that the judge found.
    pub violations: Vec<String>,
    /// The event log.
    pub log: Option<Log>,
}

/// Runs `setup` on its clock and observes the boards by these tables. With `spans` the event log and all pieces of the
/// running code are kept.
///
/// # Errors
///
/// An ELF file cannot be loaded.
pub fn observe(setup: &Setup, tables: &[Table], spans: bool) -> Result<Shown, Error> {
    let images = [&setup.images.horus, &setup.images.dpr].into_iter().chain(&setup.hold);
    let bottoms = images.map(|image| bottom(image)).collect::<Result<Vec<_>, Error>>()?;
    let mut watches: Vec<Watch> = vec![];
    let mut boards = vec![];
    let finished = processors::watch(setup, PIECE, spans, &mut |reached, nodes| {
        if reached == 0 {
            let all = nodes.into_iter().zip(&bottoms).zip(tables);
            watches = all.map(|((node, bottom), table)| Watch::new(node, *bottom, table, spans)).collect();
            return;
        }
        let ends = reached == setup.duration_ns;
        for (watch, node) in watches.iter_mut().zip(nodes) {
            watch.take(node, reached);
            if ends {
                watch.seen.priorities =
                    watch.seen.exceptions.iter().map(|&exception| node.exception_priority(exception)).collect();
            }
        }
    })?;
    boards.extend(watches.into_iter().map(Watch::finish));
    let violations = finished.verdict.violations.iter().map(ToString::to_string).collect();
    Ok(Shown { boards, violations, log: spans.then_some(finished.log) })
}

/// Returns the address of the beginning of the RAM with the stack, by the firmware's linker script.
fn bottom(image: &Path) -> Result<Option<u32>, Error> {
    let start = Firmware::read(image)?.symbol("__ram_start");
    Ok(start.and_then(|start| u32::try_from(start.address).ok()))
}
