//! A test part: flash at 0, RAM at 0x2000_0000, and a device that logs its accesses.
#![allow(dead_code, reason = "each test program uses a part of it")]

use std::collections::BTreeSet;

use cortex_m4::{Access, Bound, Bus, BusError, Config, Core, Cost, Exit, Fast, Register, Signals, Width};

pub(crate) const DEVICE: u32 = 0x4000_0000;
pub(crate) const RAM: u32 = 0x2000_0000;
pub(crate) const CODE: u32 = 0x100;

#[derive(Clone, Debug)]
pub(crate) struct Board {
    pub(crate) flash: Vec<u8>,
    pub(crate) ram: Vec<u8>,
    /// Each read of the device (address, bytes, cycle). `writes` has each write (address, bytes, value, cycle).
    pub(crate) reads: Vec<(u32, u32, u64)>,
    pub(crate) writes: Vec<(u32, u32, u32, u64)>,
    pub(crate) answer: u32,
    pub(crate) logs: bool,
    pub(crate) signals: Signals,
    pub(crate) due: u64,
    pub(crate) advanced: Vec<u64>,
    pub(crate) waits: u32,
    pub(crate) fetches: Vec<u32>,
    pub(crate) bit_banding: bool,
    /// Whether the board can watch pages of RAM for writes.
    pub(crate) watches: bool,
    pub(crate) watched: BTreeSet<u32>,
    pub(crate) rewritten: u64,
    pub(crate) stop_at: Option<u32>,
}

impl Board {
    pub(crate) fn new(code: &[u16]) -> Self {
        let mut flash = vec![0; 0x1000];
        flash[0..4].copy_from_slice(&(RAM + 0x1000).to_le_bytes());
        flash[4..8].copy_from_slice(&(CODE | 1).to_le_bytes());
        for (index, half) in code.iter().enumerate() {
            let at = CODE as usize + 2 * index;
            flash[at..at + 2].copy_from_slice(&half.to_le_bytes());
        }
        Self {
            flash,
            ram: vec![0; 0x2000],
            reads: Vec::new(),
            writes: Vec::new(),
            answer: 0,
            logs: true,
            signals: Signals::default(),
            due: u64::MAX,
            advanced: Vec::new(),
            waits: 0,
            fetches: Vec::new(),
            bit_banding: false,
            watches: true,
            watched: BTreeSet::new(),
            rewritten: 0,
            stop_at: None,
        }
    }

    pub(crate) fn word(&self, address: u32) -> u32 {
        let at = (address - RAM) as usize;
        u32::from_le_bytes(self.ram[at..at + 4].try_into().unwrap())
    }

    pub(crate) fn set_word(&mut self, address: u32, value: u32) {
        let at = (address - RAM) as usize;
        self.ram[at..at + 4].copy_from_slice(&value.to_le_bytes());
        self.rewritten += u64::from(self.watched.remove(&(address >> 10)));
    }

    #[inline]
    fn memory(&mut self, address: u32, bytes: u32) -> Option<&mut [u8]> {
        let (memory, base) = if address < RAM { (&mut self.flash, 0) } else { (&mut self.ram, RAM) };
        let at = (address - base) as usize;
        memory.get_mut(at..at + bytes as usize)
    }
}

impl Bus for Board {
    #[inline]
    fn read(&mut self, access: &Access) -> Result<u32, BusError> {
        if access.address & 0xFFFF_F000 == DEVICE {
            if self.logs {
                self.reads.push((access.address, access.width.bytes(), access.cycle));
            }
            if self.stop_at == Some(access.address) {
                self.signals.stop();
            }
            return Ok(self.answer);
        }
        let bytes = self.memory(access.address, access.width.bytes()).ok_or(BusError)?;
        Ok(match *bytes {
            [a] => u32::from(a),
            [a, b] => u32::from(u16::from_le_bytes([a, b])),
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
            _ => return Err(BusError),
        })
    }

    #[inline]
    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError> {
        if access.address & 0xFFFF_F000 == DEVICE {
            if self.logs {
                self.writes.push((access.address, access.width.bytes(), value, access.cycle));
            }
            if self.stop_at == Some(access.address) {
                self.signals.stop();
            }
            return Ok(());
        }
        if access.address < RAM {
            return Err(BusError);
        }
        let bytes = self.memory(access.address, access.width.bytes()).ok_or(BusError)?;
        let width = bytes.len();
        bytes.copy_from_slice(&value.to_le_bytes()[..width]);
        self.rewritten += u64::from(self.watched.remove(&(access.address >> 10)));
        Ok(())
    }

    #[inline]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        let at = address.wrapping_sub(RAM) as usize;
        let bytes = self.ram.get(at..at.checked_add(width.bytes() as usize)?)?;
        at.is_multiple_of(bytes.len()).then(|| bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte)))
    }

    #[inline]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        if self.watched.contains(&(address >> 10)) {
            return false;
        }
        let (at, bytes) = (address.wrapping_sub(RAM) as usize, width.bytes() as usize);
        let Some(to) = self.ram.get_mut(at..at.saturating_add(bytes)).filter(|_| at.is_multiple_of(bytes)) else {
            return false;
        };
        to.copy_from_slice(&value.to_le_bytes()[..bytes]);
        true
    }

    fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
        match self.memory(address, 2) {
            Some(&mut [a, b]) => Ok(u16::from_le_bytes([a, b])),
            _ => Err(BusError),
        }
    }

    fn watch_code(&mut self, address: u32) -> bool {
        let watches = self.watches && address >= RAM;
        if watches {
            self.watched.insert(address >> 10);
        }
        watches
    }

    fn is_watched(&self, address: u32) -> bool {
        self.watched.contains(&(address >> 10))
    }

    #[inline]
    fn rewritten(&self) -> u64 {
        self.rewritten
    }

    fn is_constant(&self, address: u32) -> bool {
        address < RAM
    }

    #[inline]
    fn due(&self) -> u64 {
        self.due
    }

    fn advance(&mut self, cycle: u64) {
        self.advanced.push(cycle);
        self.due = u64::MAX;
    }

    #[inline]
    fn signals(&mut self) -> &mut Signals {
        &mut self.signals
    }

    fn wait_states(&mut self, access: &Access, _bound: Bound) -> u32 {
        if self.logs && access.purpose == cortex_m4::Purpose::Fetch {
            self.fetches.push(access.address);
        }
        self.waits
    }

    fn bit_banding(&self) -> bool {
        self.bit_banding
    }
}

pub(crate) const CONFIG: Config = Config {
    lines: 16,
    priority_bits: 4,
    vector_table: 0,
    systick_calibration: 0,
    systick_reference: 0,
    mpu_regions: 8,
};

#[derive(Clone, Debug)]
pub(crate) struct Rig<C: Cost> {
    pub(crate) core: Core<C>,
    pub(crate) board: Board,
}

impl Rig<Fast> {
    /// Makes a core after reset, on the fast clock, with `code` next.
    pub(crate) fn new(code: &[u16]) -> Self {
        Self::with_clock(code)
    }
}

impl<C: Cost> Rig<C> {
    pub(crate) fn with_clock(code: &[u16]) -> Self {
        let mut board = Board::new(code);
        let mut core = Core::new(CONFIG);
        core.reset(&mut board);
        Self { core, board }
    }

    pub(crate) fn r(&self, n: u8) -> u32 {
        self.core.register(Register::R(n))
    }

    pub(crate) fn set(&mut self, n: u8, value: u32) -> &mut Self {
        self.core.set_register(Register::R(n), value);
        self
    }

    /// The flags N, Z, C and V as a binary number.
    pub(crate) fn nzcv(&self) -> u32 {
        self.core.register(Register::Xpsr) >> 28
    }

    pub(crate) fn set_nzcv(&mut self, flags: u32) -> &mut Self {
        let rest = self.core.register(Register::Xpsr) & 0x0FFF_FFFF;
        self.core.set_register(Register::Xpsr, rest | flags << 28);
        self
    }

    pub(crate) fn steps(&mut self, count: usize) -> &mut Self {
        for _ in 0..count {
            assert_eq!(self.core.step(&mut self.board), Exit::Until);
        }
        self
    }
}
