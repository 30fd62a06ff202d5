//! NVMC: programming and erasing flash and UICR (PS 4.3).
//!
//! | covered | PS |
//! |---|---|
//! | CONFIG.WEN; word writes that only clear bits; READY and READYNEXT, low while an operation lasts | 4.3 |
//! | ERASEPAGE and its older names, ERASEALL, ERASEUICR, partial page erase | 4.3 |
//! | a write without WEN, or narrower than a word, which is a bus fault | 4.3 |
//! | the core stalls while flash is busy, if it executes from flash | 4.3 |
//!
//! | left out | why |
//! |---|---|
//! | stalling code in RAM that reads flash during an operation | it reads the new data; a second write is reported |
//! | the limits of two writes to a word, and of erase cycles | no firmware here comes near |
//! | the counts of ICACHECNF | IHIT and IMISS read 0, and that is a finding |
//! | ACL | use of its registers is a finding |
//!
//! Operations take the specification's maximum times (PS 4.3): 41 µs for a word, 85 ms for a page, 169 ms for an erase
//! of everything.
use crate::clocks::{Clocks, cycles};
use crate::instance::{Act, Block, Cx, Instance};
use crate::memory::{FLASH_BYTES, PAGE, UICR_BASE};

const WRITE: u64 = cycles(41_000);
const ERASE_PAGE: u64 = cycles(85_000_000);
const ERASE_ALL: u64 = cycles(169_000_000);

const WRITE_ENABLED: u32 = 1;
const ERASE_ENABLED: u32 = 2;

#[derive(Clone, Debug, Default)]
pub(crate) struct Nvmc {
    block: Block,
    config: u32,
    cache: u32,
    partial_ms: u32,
    /// The page that is being erased in parts, and the cycles for which it has been erased so far.
    partial: Option<(u32, u64)>,
    busy_until: u64,
}

impl Nvmc {
    pub(crate) fn is_cached(&self) -> bool {
        self.cache & 1 != 0
    }

    /// Carries out a store into flash or UICR. `false` is a bus fault.
    pub(crate) fn store(&mut self, address: u32, word: bool, value: u32, cx: &mut Cx<'_>) -> bool {
        if self.config & 3 != WRITE_ENABLED {
            cx.misuse("a write to flash without CONFIG.WEN, at", address);
            return false;
        }
        if !word || !address.is_multiple_of(4) {
            cx.misuse("a write to flash that is no aligned word, at", address);
            return false;
        }
        self.occupy(WRITE, cx);
        cx.memory.program(address, value);
        true
    }

    /// Keeps flash busy for `time` further cycles. A core that executes from flash is stalled meanwhile.
    fn occupy(&mut self, time: u64, cx: &mut Cx<'_>) {
        if cx.now < self.busy_until {
            cx.misuse("begun while flash is still busy, cycles", (self.busy_until - cx.now) as u32);
        }
        self.busy_until = self.busy_until.max(cx.now) + time;
        if cx.out.pc.is_none_or(|pc| pc < FLASH_BYTES) {
            cx.act(Act::Stall(self.busy_until));
        }
    }

    fn erase_page(&mut self, address: u32, time: u64, cx: &mut Cx<'_>) {
        if !address.is_multiple_of(PAGE) || address >= FLASH_BYTES {
            cx.misuse("an erase of what is no page of flash, at", address);
            return;
        }
        self.occupy(time, cx);
        cx.memory.erase(address, PAGE);
    }
}

impl Instance for Nvmc {
    crate::instance::block!();

    fn read(&self, offset: u32, now: u64, _: &Clocks) -> Option<u32> {
        Some(match offset {
            0x400 | 0x408 => u32::from(now >= self.busy_until),
            0x504 => self.config,
            0x508..=0x518 => 0,
            0x51C => {
                if self.partial_ms == 0 {
                    10
                } else {
                    self.partial_ms
                }
            }
            0x540 => self.cache,
            _ => return None,
        })
    }

    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        match offset {
            0x400 | 0x408 => {}
            0x504 => self.config = value & 3,
            0x508..=0x518 => {
                if self.config & 3 != ERASE_ENABLED {
                    cx.misuse("an erase without CONFIG.EEN, which does nothing; offset", offset);
                    return true;
                }
                match offset {
                    0x508 | 0x510 => self.erase_page(value, ERASE_PAGE, cx),
                    0x50C if value & 1 != 0 => {
                        self.occupy(ERASE_ALL, cx);
                        cx.memory.erase(0, FLASH_BYTES);
                        cx.memory.erase(UICR_BASE, PAGE);
                    }
                    0x514 if value & 1 != 0 => {
                        self.occupy(ERASE_PAGE, cx);
                        cx.memory.erase(UICR_BASE, PAGE);
                    }
                    // A page is erased as soon as its partial erases together take the time of a whole erase.
                    0x518 => {
                        let ms = if self.partial_ms == 0 { 10 } else { self.partial_ms };
                        let part = cycles(u64::from(ms) * 1_000_000);
                        let had = self.partial.filter(|(page, _)| *page == value).map_or(0, |(_, had)| had);
                        self.partial = (had + part < ERASE_PAGE).then_some((value, had + part));
                        if self.partial.is_some() {
                            self.occupy(part, cx);
                        } else {
                            self.erase_page(value, part, cx);
                        }
                    }
                    _ => {}
                }
            }
            0x51C => self.partial_ms = value & 0x7F,
            0x540 => self.cache = value & 0x101,
            _ => return false,
        }
        true
    }
}
