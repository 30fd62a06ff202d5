//! Tests that interrupted code computes the same results as uninterrupted code.

use crate::common;

use common::{Board, CODE, CONFIG, DEVICE, RAM};
use cortex_m4::{Access, Bound, Bus, BusError, Core, Cost, Exit, Fast, Optimistic, Pessimistic, Register, Signals};

/// The program enables interrupt 0, copies 256 bytes sixteen times with LDM, STM, PUSH and POP, mixes them, and sets r7
/// to 99. The handler, [`HANDLER`] bytes from the start, writes to the device and counts at 0x2000_1000.
#[rustfmt::skip]
const PROGRAM: &[u16] = &[
    0x4816, 0x2101, 0x6001, 0xF04F, 0x5800, 0xF8DF, 0x9054, 0x2210, 0x4640, 0x4649, 0x2308, 0xE8B0, 0x5CF0,
    0xB5F0, 0xE8A1, 0x5CF0, 0xE8BD, 0x40F0, 0x406C, 0xBF1C, 0xF108, 0x0804, 0xF1A8, 0x0804, 0x3B01, 0xD1F0,
    0x4648, 0x4649, 0x2340, 0x6804, 0xEA84, 0x14C3, 0xEB04, 0x2474, 0xF840, 0x4B04, 0x3B01, 0xD1F6, 0x4644,
    0x46C8, 0x46A1, 0x3A01, 0xD1DC, 0x2763, 0xE7FE, 0x0000, 0xE100, 0xE000, 0x0800, 0x2000, 0xF04F, 0x4080,
    0x2101, 0x6001, 0x4A03, 0x6813, 0x3301, 0x6013, 0xF3BF, 0x8F4F, 0x4770, 0x0000, 0x1000, 0x2000,
];
const HANDLER: u32 = 0x64;

/// The program allows the FPU and enables both interrupts, interrupt 1 with the lower priority. 64 times it pushes and
/// pops 16 FP registers and pushes 12 core registers; then it writes to the device's byte 8. The handler of interrupt 1
/// ([`LOW`]) pushes and pops the same FP registers. The handler of interrupt 0 ([`HIGH`]) writes to the device at once.
#[rustfmt::skip]
const MULTIPLES: &[u16] = &[
    0x4817, 0xF44F, 0x0170, 0x6001, 0xF3BF, 0x8F4F, 0xF3BF, 0x8F6F, 0x4814, 0xF44F, 0x4100, 0x6001, 0x4813, 0x2103,
    0x6001, 0xEEB7, 0x0A00, 0x2640, 0xF04F, 0x4C80, 0xED2D, 0x8A10, 0xECBD, 0x8A10, 0xE92D, 0x0FFF, 0xB00C, 0x3E01,
    0xD1F6, 0xF8CC, 0x6008, 0xE7FE, 0xED2D, 0x8A10, 0xECBD, 0x8A10, 0xF04F, 0x4080, 0x6040, 0xF3BF, 0x8F4F, 0x4770,
    0xF04F, 0x4080, 0x6000, 0xF3BF, 0x8F4F, 0x4770, 0xED88, 0xE000, 0xE400, 0xE000, 0xE100, 0xE000,
];
const LOW: u32 = 0x40;
const HIGH: u32 = 0x54;

/// A part that raises line 0 every `period` cycles, and line 1 `before` cycles earlier unless `before` is 0. A write to
/// the device lowers the lines.
#[derive(Clone, Debug)]
struct Storm {
    board: Board,
    period: u64,
    before: u64,
    due: u64,
    /// The cycle at which line 0 rose. `latest` is the longest time from a rise until the handler's write, cycles.
    raised: u64,
    latest: u64,
    over: Option<u64>,
}

impl Storm {
    fn new(board: Board, period: u64, before: u64) -> Self {
        Self { board, period, before, due: period, raised: 0, latest: 0, over: None }
    }
}

impl Bus for Storm {
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        self.board.read(access)
    }

    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        match access.address.wrapping_sub(DEVICE) {
            0 => {
                self.board.signals.drive_line(0, false);
                self.latest = self.latest.max(access.cycle - self.raised);
            }
            4 => self.board.signals.drive_line(1, false),
            8 => self.over = Some(access.cycle),
            _ => {}
        }
        self.board.write(access, value)
    }

    fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
        self.board.fetch(address)
    }

    fn is_constant(&self, address: u32) -> bool {
        self.board.is_constant(address)
    }

    fn due(&self) -> u64 {
        if self.board.signals.lines()[0] & 2 == 0 { self.due - self.before } else { self.due }
    }

    fn advance(&mut self, cycle: u64) {
        if self.before > 0 && self.due - self.before <= cycle {
            self.board.signals.drive_line(1, true);
        }
        while self.due <= cycle {
            self.raised = self.due;
            self.due += self.period;
            self.board.signals.drive_line(0, true);
        }
    }

    fn signals(&mut self) -> &mut Signals {
        self.board.signals()
    }

    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32 {
        self.board.wait_states(access, bound)
    }

    fn bit_banding(&self) -> bool {
        false
    }
}

fn run<C: Cost>(period: u64) -> (Vec<u8>, u32) {
    let mut board = Board::new(PROGRAM);
    board.flash[0x40..0x44].copy_from_slice(&((CODE + HANDLER) | 1).to_le_bytes());
    board.flash[0..4].copy_from_slice(&(RAM + 0x2000).to_le_bytes());
    board.logs = false;
    for (index, byte) in board.ram.iter_mut().take(0x100).enumerate() {
        *byte = (index * 167 + 13) as u8;
    }
    let mut bus = Storm::new(board, period, 0);
    let mut core = Core::<C>::new(CONFIG);
    core.reset(&mut bus);
    for end in 1..1000 {
        assert_eq!(core.run(&mut bus, end * 1000), Exit::Until, "period {period}, pc {:#x}", core.pc());
        if core.register(Register::R(7)) == 99 {
            return (bus.board.ram[..0x1000].to_vec(), bus.board.word(RAM + 0x1000));
        }
    }
    panic!("period {period}: the program does not end");
}

#[test]

fn a_program_that_is_interrupted_anywhere_computes_the_same() {
    let (calm, none) = run::<Fast>(u64::MAX);
    assert_eq!(none, 0);
    for period in 61..160 {
        for (ram, count) in [run::<Fast>(period), run::<Optimistic>(period), run::<Pessimistic>(period)] {
            assert!(count > 10, "period {period}: {count}");
            assert!(ram == calm, "period {period}");
        }
    }
}

/// Returns three figures: the longest time from the rise of line 0 to its handler's write, the number of such writes,
/// and the duration of the program.
fn multiples<C: Cost>(period: u64, before: u64) -> (u64, u64, u64) {
    let mut board = Board::new(MULTIPLES);
    for (vector, handler) in [(0x40, HIGH), (0x44, LOW)] {
        board.flash[vector..vector + 4].copy_from_slice(&((CODE + handler) | 1).to_le_bytes());
    }
    let mut bus = Storm::new(board, period, before);
    let mut core = Core::<C>::new(CONFIG);
    core.reset(&mut bus);
    for end in 1..1000 {
        assert_eq!(core.run(&mut bus, end * 100), Exit::Until, "period {period}, pc {:#x}", core.pc());
        if let Some(over) = bus.over {
            let served = bus.board.writes.iter().filter(|(address, .., at)| *address == DEVICE && *at < over).count();
            return (bus.latest, served as u64, over);
        }
    }
    panic!("period {period}: the program does not end");
}

/// Interrupts may cut short load/store multiples and the lazy saving of the FP state (TRM 3.9.1 and 7.2).
#[test]
fn at_best_no_interrupt_waits_for_a_load_or_store_multiple() {
    let (.., calm) = multiples::<Optimistic>(1_000_000, 0);
    // `entry` is the time from an interrupt to its handler's write, and `left` the time from that write to the end of
    // the return.
    let (entry, left) = (12 + 1, 1 + 1 + 2 + 10);
    for period in 173..300 {
        let (latest, served, over) = multiples::<Optimistic>(period, 0);
        assert!((entry..=entry + 1).contains(&latest), "period {period}: {latest} cycles");
        assert_eq!(over - calm, served * (entry + left), "period {period}: what was cut short passes later");
    }
    assert!(multiples::<Pessimistic>(173, 0).0 > entry + 10);
}

#[test]
fn at_best_no_interrupt_waits_for_lazy_stacking_or_a_return() {
    for before in 1..60 {
        let (latest, served, _) = multiples::<Optimistic>(300, before);
        assert!(latest <= 12 + 1 + 1 && served > 10, "{before} cycles after the lower one: {latest} cycles");
    }
    let latest = (1..60).map(|before| multiples::<Pessimistic>(300, before).0).max();
    assert!(latest > Some(12 + 1 + 30), "{latest:?} cycles");
}
