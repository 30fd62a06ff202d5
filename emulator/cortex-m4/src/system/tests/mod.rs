//! Tests of exceptions and of the system control space. They call the functions that the run loop calls, and execute no
//! instructions.

mod debug;
mod entry;
mod faults;
mod floating_point;
mod interrupts;
mod mpu;
mod registers;
mod systick;

use super::nvic::contains;
use crate::{Access, Bound, Bus, BusError, Config, Core, Cost, Fast, Fault, Purpose, Signals, Width};

pub(super) const RAM: u32 = 0x2000_0000;
pub(super) const TOP: u32 = RAM + 0x8000;
pub(super) const PROCESS_TOP: u32 = RAM + 0x4000;
/// The base address of the handlers: that of exception n is at HANDLERS + 16 * n.
pub(super) const HANDLERS: u32 = 0x1000;
pub(super) const START: u32 = 0x2000;

pub(super) const ICSR: u32 = 0xE000_ED04;
pub(super) const VTOR: u32 = 0xE000_ED08;
pub(super) const AIRCR: u32 = 0xE000_ED0C;
pub(super) const SCR: u32 = 0xE000_ED10;
pub(super) const CCR: u32 = 0xE000_ED14;
pub(super) const SHPR1: u32 = 0xE000_ED18;
pub(super) const SHPR2: u32 = 0xE000_ED1C;
pub(super) const SHPR3: u32 = 0xE000_ED20;
pub(super) const SHCSR: u32 = 0xE000_ED24;
pub(super) const CFSR: u32 = 0xE000_ED28;
pub(super) const HFSR: u32 = 0xE000_ED2C;
pub(super) const DFSR: u32 = 0xE000_ED30;
pub(super) const MMFAR: u32 = 0xE000_ED34;
pub(super) const BFAR: u32 = 0xE000_ED38;
pub(super) const CPACR: u32 = 0xE000_ED88;
pub(super) const ISER: u32 = 0xE000_E100;
pub(super) const ISPR: u32 = 0xE000_E200;
pub(super) const ICPR: u32 = 0xE000_E280;
pub(super) const IABR: u32 = 0xE000_E300;
pub(super) const IPR: u32 = 0xE000_E400;
pub(super) const STIR: u32 = 0xE000_EF00;
pub(super) const FPCCR: u32 = 0xE000_EF34;

/// A board with 64 KiB of flash at 0, and 32 KiB of RAM.
#[derive(Clone, Debug)]
pub(super) struct Board {
    pub(super) flash: Vec<u8>,
    pub(super) ram: Vec<u8>,
    pub(super) signals: Signals,
    pub(super) later: Option<(u64, u16)>,
}

impl Board {
    pub(super) fn new() -> Self {
        let mut board =
            Self { flash: vec![0; 0x1_0000], ram: vec![0; 0x8000], signals: Signals::default(), later: None };
        board.vector(0, TOP);
        board.vector(1, START | 1);
        for number in 2..256 {
            board.vector(number, handler(number) | 1);
        }
        board
    }

    pub(super) fn vector(&mut self, number: u32, value: u32) {
        self.flash[4 * number as usize..][..4].copy_from_slice(&value.to_le_bytes());
    }

    pub(super) fn word(&self, address: u32) -> u32 {
        u32::from_le_bytes(self.ram[(address - RAM) as usize..][..4].try_into().unwrap())
    }

    pub(super) fn set_word(&mut self, address: u32, value: u32) {
        self.ram[(address - RAM) as usize..][..4].copy_from_slice(&value.to_le_bytes());
    }

    pub(super) fn line(&mut self, line: u16, level: bool) {
        self.signals.drive_line(usize::from(line), level);
    }

    fn memory(&mut self, address: u32) -> Option<&mut [u8]> {
        if address < RAM {
            self.flash.get_mut(address as usize..address as usize + 4)
        } else {
            let at = (address - RAM) as usize;
            self.ram.get_mut(at..at + 4)
        }
    }
}

pub(super) fn handler(number: u32) -> u32 {
    HANDLERS + 16 * number
}

impl Bus for Board {
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        let memory = self.memory(access.address).ok_or(BusError)?;
        Ok(u32::from_le_bytes((&*memory).try_into().unwrap()))
    }

    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        if access.address < RAM {
            return Err(BusError);
        }
        self.memory(access.address).ok_or(BusError)?.copy_from_slice(&value.to_le_bytes());
        Ok(())
    }

    fn fetch(&mut self, _: u32) -> Result<u16, BusError> {
        Ok(0xBF00)
    }

    fn is_constant(&self, _: u32) -> bool {
        true
    }

    fn due(&self) -> u64 {
        self.later.map_or(u64::MAX, |(cycle, _)| cycle)
    }

    fn advance(&mut self, cycle: u64) {
        if let Some((due, line)) = self.later
            && due <= cycle
        {
            self.later = None;
            self.line(line, true);
        }
    }

    fn signals(&mut self) -> &mut Signals {
        &mut self.signals
    }

    fn wait_states(&mut self, _: &Access, _: Bound) -> u32 {
        0
    }

    fn bit_banding(&self) -> bool {
        false
    }
}

pub(super) const CONFIG: Config = Config {
    lines: 90,
    priority_bits: 4,
    vector_table: 0,
    systick_calibration: 0x4000_493E,
    systick_reference: 8,
    mpu_regions: 8,
};

pub(super) fn machine_of<C: Cost>() -> (Core<C>, Board) {
    let mut board = Board::new();
    let mut core = Core::new(CONFIG);
    core.power_on(&mut board);
    core.attention = false;
    (core, board)
}

pub(super) fn machine() -> (Core<Fast>, Board) {
    machine_of()
}

pub(super) fn access<C: Cost>(core: &Core<C>, address: u32, width: Width) -> Access {
    let privileged = core.is_privileged();
    Access { address, width, purpose: Purpose::Data, privileged, cycle: core.cycle, pc: core.r[15] }
}

pub(super) fn read<C: Cost>(core: &mut Core<C>, board: &mut Board, address: u32) -> u32 {
    let access = access(core, address, Width::Word);
    core.system_read(board, &access).unwrap()
}

pub(super) fn write<C: Cost>(core: &mut Core<C>, board: &mut Board, address: u32, value: u32) {
    try_write(core, board, address, value).unwrap();
}

pub(super) fn try_write<C: Cost>(core: &mut Core<C>, board: &mut Board, at: u32, value: u32) -> Result<(), Fault> {
    let access = access(core, at, Width::Word);
    core.system_write(board, &access, value)
}

pub(super) fn enable<C: Cost>(core: &mut Core<C>, board: &mut Board, line: u32, priority: u32) {
    let byte = Access { width: Width::Byte, ..access(core, IPR + line, Width::Byte) };
    core.system_write(board, &byte, priority).unwrap();
    write(core, board, ISER + 4 * (line / 32), 1 << (line % 32));
}

pub(super) fn pend<C: Cost>(core: &mut Core<C>, board: &mut Board, line: u32) {
    write(core, board, ISPR + 4 * (line / 32), 1 << (line % 32));
}

pub(super) fn look<C: Cost>(core: &mut Core<C>, board: &mut Board) -> bool {
    core.look_at_exceptions(board)
}

/// Does what `BX lr` does at the end of a handler.
pub(super) fn leave<C: Cost>(core: &mut Core<C>, board: &mut Board) {
    let value = core.r[14];
    core.exception_return(board, value);
}
