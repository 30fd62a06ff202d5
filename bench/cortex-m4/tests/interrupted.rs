//! Interrupts between and within instructions: whatever is interrupted computes the same.

mod common;

use common::{Board, CODE, CONFIG, DEVICE, RAM};
use cortex_m4::{Access, Bound, Bus, BusError, Core, Cost, Exit, Fast, Optimistic, Pessimistic, Register, Signals};

/// Enables interrupt 0; sixteen times copies 256 bytes with LDM and STM, with PUSH, POP and an IT block between, and
/// mixes them; then r7 is 99. The handler, [`HANDLER`] bytes in, writes to the device and counts at 0x2000_1000.
#[rustfmt::skip]
const PROGRAM: &[u16] = &[
    0x4816, 0x2101, 0x6001, 0xF04F, 0x5800, 0xF8DF, 0x9054, 0x2210, 0x4640, 0x4649, 0x2308, 0xE8B0, 0x5CF0,
    0xB5F0, 0xE8A1, 0x5CF0, 0xE8BD, 0x40F0, 0x406C, 0xBF1C, 0xF108, 0x0804, 0xF1A8, 0x0804, 0x3B01, 0xD1F0,
    0x4648, 0x4649, 0x2340, 0x6804, 0xEA84, 0x14C3, 0xEB04, 0x2474, 0xF840, 0x4B04, 0x3B01, 0xD1F6, 0x4644,
    0x46C8, 0x46A1, 0x3A01, 0xD1DC, 0x2763, 0xE7FE, 0x0000, 0xE100, 0xE000, 0x0800, 0x2000, 0xF04F, 0x4080,
    0x2101, 0x6001, 0x4A03, 0x6813, 0x3301, 0x6013, 0xF3BF, 0x8F4F, 0x4770, 0x0000, 0x1000, 0x2000,
];
const HANDLER: u32 = 0x64;

/// Raises line 0 every `period` cycles; a write to the device takes it back.
#[derive(Clone, Debug)]
struct Storm {
    board: Board,
    period: u64,
    due: u64,
}

impl Bus for Storm {
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        self.board.read(access)
    }

    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        if access.address == DEVICE {
            self.board.signals.drive_line(0, false);
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
        self.due
    }

    fn advance(&mut self, cycle: u64) {
        while self.due <= cycle {
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

/// What is left in RAM, and how often the handler ran.
fn run<C: Cost>(period: u64) -> (Vec<u8>, u32) {
    let mut board = Board::new(PROGRAM);
    board.flash[0x40..0x44].copy_from_slice(&((CODE + HANDLER) | 1).to_le_bytes());
    board.flash[0..4].copy_from_slice(&(RAM + 0x2000).to_le_bytes());
    board.logs = false;
    for (index, byte) in board.ram.iter_mut().take(0x100).enumerate() {
        *byte = (index * 167 + 13) as u8;
    }
    let mut bus = Storm { board, period, due: period };
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
