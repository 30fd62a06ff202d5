//! The block at each address, and each block's registers (PS 4.2, *Instantiation*).

use super::*;
use crate::registers as r;
use crate::registers::Register;

pub(super) const PPI: Id = 0x1F;
pub(super) const NVMC: Id = 0x1E;
pub(super) const GPIOTE: Id = 0x06;
pub(super) const SAADC: Id = 0x07;
pub(super) const WDT: Id = 0x10;
pub(super) const CLOCK_POWER: Id = 0x00;

#[derive(Debug)]
pub(super) struct BlockSpec {
    pub(super) id: Id,
    pub(super) name: &'static str,
    pub(super) registers: &'static [Register],
    pub(super) modelled: bool,
}

const fn at(id: Id, name: &'static str, registers: &'static [Register], modelled: bool) -> BlockSpec {
    BlockSpec { id, name, registers, modelled }
}

pub(super) static BLOCKS: [BlockSpec; 44] = [
    at(0x00, "CLOCK/POWER", r::CLOCK_POWER, true),
    at(0x01, "RADIO", r::RADIO, false),
    at(0x02, "UARTE0", r::UART, true),
    at(0x03, "SPIM0/SPIS0", r::SERIAL, true),
    at(0x04, "SPIM1/SPIS1", r::SERIAL, true),
    at(0x05, "NFCT", r::NFCT, false),
    at(0x06, "GPIOTE", r::GPIOTE, true),
    at(0x07, "SAADC", r::SAADC, true),
    at(0x08, "TIMER0", r::TIMER, true),
    at(0x09, "TIMER1", r::TIMER, true),
    at(0x0A, "TIMER2", r::TIMER, true),
    at(0x0B, "RTC0", r::RTC, true),
    at(0x0C, "TEMP", r::TEMP, true),
    at(0x0D, "RNG", r::RNG, true),
    at(0x0E, "ECB", r::ECB, true),
    at(0x0F, "CCM/AAR", r::CCM_AAR, true),
    at(0x10, "WDT", r::WDT, true),
    at(0x11, "RTC1", r::RTC, true),
    at(0x12, "QDEC", r::QDEC, true),
    at(0x13, "COMP/LPCOMP", r::COMP_LPCOMP, true),
    at(0x14, "EGU0", r::EGU, true),
    at(0x15, "EGU1", r::EGU, true),
    at(0x16, "EGU2", r::EGU, true),
    at(0x17, "EGU3", r::EGU, true),
    at(0x18, "EGU4", r::EGU, true),
    at(0x19, "EGU5", r::EGU, true),
    at(0x1A, "TIMER3", r::TIMER_WIDE, true),
    at(0x1B, "TIMER4", r::TIMER_WIDE, true),
    at(0x1C, "PWM0", r::PWM, true),
    at(0x1D, "PDM", r::PDM, false),
    at(0x1E, "NVMC", r::NVMC_ACL, true),
    at(0x1F, "PPI", r::PPI, true),
    at(0x20, "MWU", r::MWU, false),
    at(0x21, "PWM1", r::PWM, true),
    at(0x22, "PWM2", r::PWM, true),
    at(0x23, "SPIM2/SPIS2", r::SERIAL, true),
    at(0x24, "RTC2", r::RTC, true),
    at(0x25, "I2S", r::I2S, false),
    at(0x27, "USBD", r::USBD, false),
    at(0x28, "UARTE1", r::UART, true),
    at(0x29, "QSPI", r::QSPI, false),
    at(0x2D, "PWM3", r::PWM, true),
    at(0x2F, "SPIM3", r::SPIM3, true),
    at(GPIO, "GPIO", r::GPIO, true),
];

const CRYPTOCELL: std::ops::Range<u32> = 0x5002_A000..0x5002_C000;

/// Registers that no table lists. The workarounds of USBD's anomalies 166, 171 and 187 write them.
const USBD_TEST: std::ops::Range<u32> = 0x4006_E000..0x4006_F000;

/// Finds a block that has neither an ID nor a model.
pub(super) fn unmodelled_at(address: u32) -> Option<(&'static str, u32)> {
    match address {
        _ if CRYPTOCELL.contains(&address) => Some(("CRYPTOCELL", address - CRYPTOCELL.start)),
        _ if USBD_TEST.contains(&address) => Some(("USBD", address)),
        _ => None,
    }
}

/// The index in [`BLOCKS`] of the block with each ID.
static PLACES: [u8; 64] = {
    let mut places = [u8::MAX; 64];
    let mut n = 0;
    while n < BLOCKS.len() {
        places[BLOCKS[n].id] = n as u8;
        n += 1;
    }
    places
};

static NAMES: [&str; 64] = {
    let mut names = ["?"; 64];
    let mut n = 0;
    while n < BLOCKS.len() {
        names[BLOCKS[n].id] = BLOCKS[n].name;
        n += 1;
    }
    names
};

/// For each block, two maps with one bit for each word: the words that hold a register, and the words that are
/// writable.
pub(super) static REGISTERS: [[[u64; 16]; 2]; BLOCKS.len()] = {
    let mut maps = [[[0; 16]; 2]; BLOCKS.len()];
    let mut block = 0;
    while block < BLOCKS.len() {
        let registers = BLOCKS[block].registers;
        let mut n = 0;
        while n < registers.len() {
            let word = registers[n].offset as usize / 4;
            maps[block][0][word / 64] |= 1 << (word % 64);
            if registers[n].writable {
                maps[block][1][word / 64] |= 1 << (word % 64);
            }
            n += 1;
        }
        block += 1;
    }
    maps
};

#[inline]
pub(super) fn spec(id: Id) -> Option<(usize, &'static BlockSpec)> {
    let n = usize::from(PLACES[id]);
    BLOCKS.get(n).map(|block| (n, block))
}

#[inline]
pub(super) fn name_of(id: Id) -> &'static str {
    NAMES[id & 63]
}

#[inline]
pub(super) fn block_at(address: u32) -> Option<(Id, usize, &'static BlockSpec)> {
    let id = match address {
        0x4000_0000..0x4003_0000 => (address >> 12 & 0x3F) as Id,
        0x5000_0000..0x5000_1000 => GPIO,
        _ => return None,
    };
    spec(id).map(|(n, block)| (id, n, block))
}

/// Returns the name of a register that has no model, in a block that has one.
pub(super) fn register_name(block: &BlockSpec, offset: u32) -> &'static str {
    block.registers.iter().find(|register| register.offset == offset).map_or("?", |register| register.name)
}

const _: () = assert!(address_of(PPI) == 0x4001_F000 && RAM_BASE + RAM_BYTES == 0x2004_0000 && COMP == 0x13);
