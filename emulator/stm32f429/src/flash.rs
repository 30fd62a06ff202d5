//! The flash memory and its interface, RM0090 chapter 3.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `ACR` | `LATENCY`; the cache and prefetch bits influence the wait states |
//! | Too few wait states for HCLK, table 11 (2.7 to 3.6 V) | Flash reads as garbage: [`FlashControl::is_readable`] |
//! | Too few wait states for the supply, table 11 (below 2.7 V) | Reads have flipped bits: [`FlashControl::read`] |
//! | `KEYR`, `OPTKEYR` | The unlock sequences; a wrong key locks until the next reset and is a bus error |
//! | Programming, 3.6 | `PSIZE` sets the width; bits can only be cleared; `PGSERR`, `PGPERR`, `PGAERR`, `WRPERR` |
//! | Erasing, 3.6 | Sectors, one bank or both banks, with the data sheet's times |
//! | Reading a bank that programs or erases | The bus waits until the bank has finished, 3.5.2 |
//! | `OPTCR`, `OPTCR1` | `OPTSTRT` programs the option bytes, loaded by a reset; write protection, `BOR_LEV` work |
//!
//! **Left out.** Read protection, PCROP and booting from bank 2 have no effect, and setting them makes a finding. The
//! caches never hold stale data. A reset does not interrupt an erase or a program.

use cortex_m4::{Bound, Width};
use emulator_part::{Cycle, FindingKind, Flash, NEVER};

use crate::cx::{Effects, Note};
use crate::gpio::{lane, merge};

/// The first address of flash.
pub(crate) const BASE: u32 = 0x0800_0000;
/// The size of all flash, and of one of its two banks: RM0090 table 6.
pub(crate) const SIZE: u32 = 2 << 20;
const BANK: u32 = 1 << 20;

const PG: u32 = 1 << 0;
const SER: u32 = 1 << 1;
const MER: u32 = 1 << 2;
const MER1: u32 = 1 << 15;
const STRT: u32 = 1 << 16;
const EOPIE: u32 = 1 << 24;
const ERRIE: u32 = 1 << 25;
const LOCK: u32 = 1 << 31;

const EOP: u32 = 1 << 0;
const OPERR: u32 = 1 << 1;
const WRPERR: u32 = 1 << 4;
const PGAERR: u32 = 1 << 5;
const PGPERR: u32 = 1 << 6;
const PGSERR: u32 = 1 << 7;
const BSY: u32 = 1 << 16;

const OPTLOCK: u32 = 1 << 0;
const OPTSTRT: u32 = 1 << 1;

/// The time to program one unit of data, of any width, in nanoseconds (DS9405, flash memory programming: 16 µs
/// typical).
const PROGRAM_NS: u64 = 16_000;

const PREFETCH: u32 = 1 << 8;
const INSTRUCTION_CACHE: u32 = 1 << 9;
const DATA_CACHE: u32 = 1 << 10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Key {
    None,
    First,
    /// A wrong key was written. The register stays locked until the next reset.
    Failed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Done,
    Changed,
    BusError,
}

#[derive(Clone, Debug)]
pub(crate) struct FlashControl {
    pub(crate) memory: Flash,
    acr: u32,
    cr: u32,
    sr: u32,
    key: Key,
    option_key: Key,
    optcr: u32,
    optcr1: u32,
    busy_until: [Cycle; 2],
    readable: bool,
    /// The number of wait states that the supply requires beyond those that are set.
    missing: u32,
    /// The seed that decides which reads are wrong.
    noise: u64,
    reads: u64,
    programmed: bool,
    /// The 128-bit line of the last instruction fetch. Wait states are counted from this line.
    line: u32,
}

impl FlashControl {
    pub(crate) fn new() -> Self {
        Self::with(Flash::new(SIZE as usize))
    }

    fn with(memory: Flash) -> Self {
        Self {
            memory,
            acr: 0,
            cr: LOCK,
            sr: 0,
            key: Key::None,
            option_key: Key::None,
            optcr: 0x0FFF_AAED,
            optcr1: 0x0FFF_0000,
            busy_until: [0; 2],
            readable: true,
            missing: 0,
            noise: 0,
            reads: 0,
            programmed: false,
            line: u32::MAX,
        }
    }

    /// Carries out a system reset. `options` is OPTCR in the option bytes.
    pub(crate) fn reset(&mut self, options: u32) {
        let memory = std::mem::replace(&mut self.memory, Flash::new(0));
        let optcr1 = self.optcr1;
        *self = Self { memory, optcr: options | OPTLOCK, optcr1, ..Self::with(Flash::new(0)) };
    }

    /// Takes the new value of OPTCR if one has just been programmed.
    pub(crate) fn take_options(&mut self) -> Option<u32> {
        std::mem::take(&mut self.programmed).then_some(self.optcr & !(OPTLOCK | OPTSTRT))
    }

    /// The field `BOR_LEV`, from 0 for level 3 to 3 for off.
    pub(crate) fn brown_out_level(&self) -> u32 {
        self.optcr >> 2 & 3
    }

    pub(crate) fn set_noise(&mut self, seed: u64) {
        self.noise = seed;
    }

    /// Reads flash. With fewer wait states than the supply needs, one bit of some reads is wrong. No manual says how
    /// many reads: the seed decides between one in 4 and one in 65536, and each missing wait state doubles their
    /// number.
    pub(crate) fn read(&mut self, offset: u32, width: Width) -> Option<u32> {
        let value = self.memory.read(offset, width)?;
        if self.missing == 0 {
            return Some(value);
        }
        self.reads = self.reads.wrapping_add(1);
        // SplitMix64
        let mut word = self.noise.wrapping_add(self.reads.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        word = (word ^ word >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        word = (word ^ word >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        word ^= word >> 31;
        let rare = (3 + self.noise % 15).saturating_sub(u64::from(self.missing));
        let hit = word & ((1 << rare) - 1) == 0;
        Some(if hit { value ^ 1 << ((word >> 32) as u32 % (8 * width.bytes())) } else { value })
    }

    /// Whether two reads of the same word always return the same value.
    pub(crate) fn is_certain(&self) -> bool {
        self.missing == 0
    }

    /// Whether hardware starts the independent watchdog (option bit `WDG_SW` is 0).
    pub(crate) fn starts_watchdog(&self) -> bool {
        self.optcr & 1 << 5 == 0
    }

    fn latency(&self) -> u32 {
        self.acr & 0xF
    }

    /// Whether reads are correct. With fewer wait states than RM0090 table 11 requires, a read may return any value.
    /// Here every halfword then reads as `UDF #255` (0xDEFF), so that firmware stops at once in a fault and a lockup.
    pub(crate) fn is_readable(&self) -> bool {
        self.readable
    }

    #[inline]
    pub(crate) fn is_quiet(&self) -> bool {
        self.readable && self.missing == 0 && self.sr & BSY == 0
    }

    pub(crate) const GARBAGE: u32 = 0xDEFF_DEFF;

    /// Checks the wait states after a change of HCLK, of the latency or of the supply. Returns whether the code as the
    /// core reads it has changed.
    pub(crate) fn check(
        &mut self,
        hclk_hz: u64,
        microvolts: u32,
        now: Cycle,
        pc: Option<u32>,
        out: &mut Effects,
    ) -> bool {
        // RM0090 table 11: the highest HCLK without a wait state, which is also the increase for each wait state.
        let mhz = match microvolts {
            2_700_000.. => 30,
            2_400_000.. => 24,
            2_100_000.. => 22,
            _ => 20,
        };
        let at_supply = hclk_hz.div_ceil(mhz * 1_000_000).saturating_sub(1) as u32;
        let certain = self.missing == 0;
        let needed = hclk_hz.div_ceil(30_000_000).saturating_sub(1);
        let readable = u64::from(self.latency()) >= needed;
        if !readable {
            out.notes.push(Note {
                kind: FindingKind::Misuse,
                at: now,
                pc,
                place: "FLASH",
                text: "too few wait states for HCLK: flash cannot be read; wait states needed",
                value: Some(needed as u32),
            });
        }
        self.missing = if readable { at_supply.saturating_sub(self.latency()) } else { 0 };
        std::mem::replace(&mut self.readable, readable) != readable || certain != (self.missing == 0)
    }

    pub(crate) fn irq(&self) -> bool {
        self.sr & EOP != 0 && self.cr & EOPIE != 0 || self.sr & OPERR != 0 && self.cr & ERRIE != 0
    }

    pub(crate) fn due(&self) -> Cycle {
        if self.sr & BSY != 0 { self.busy_until[0].max(self.busy_until[1]) } else { NEVER }
    }

    pub(crate) fn advance(&mut self, now: Cycle) {
        if self.due() <= now {
            self.sr &= !BSY;
            if self.cr & EOPIE != 0 {
                self.sr |= EOP;
            }
            self.cr &= !STRT;
        }
    }

    /// Converts the end of the present operation to the new clock.
    pub(crate) fn clocks_changed(&mut self, now: Cycle, old_hz: u64, new_hz: u64) {
        for until in &mut self.busy_until {
            if *until > now {
                *until = now + (u128::from(*until - now) * u128::from(new_hz) / u128::from(old_hz.max(1))) as u64 + 1;
            }
        }
    }

    /// The cycle until which a read of `offset` has to wait, 0 if it need not.
    #[inline]
    pub(crate) fn busy(&self, offset: u32, now: Cycle) -> Cycle {
        if self.sr & BSY == 0 {
            return 0;
        }
        let until = self.busy_until[(offset / BANK) as usize & 1];
        if until > now { until } else { 0 }
    }

    pub(crate) fn read_register(&self, offset: u32, width: Width) -> u32 {
        let register = match offset >> 2 {
            0 => self.acr,
            3 => self.sr,
            4 => self.cr,
            5 => self.optcr,
            6 => self.optcr1,
            _ => 0,
        };
        lane(register, offset, width)
    }

    #[expect(clippy::too_many_arguments, reason = "one access with everything it depends on")]
    pub(crate) fn write_register(
        &mut self,
        offset: u32,
        width: Width,
        value: u32,
        now: Cycle,
        pc: Option<u32>,
        hz: u64,
        out: &mut Effects,
    ) -> Outcome {
        let mut find = |kind, text| {
            out.notes.push(Note { kind, at: now, pc, place: "FLASH", text, value: None });
        };
        match offset >> 2 {
            0 => {
                let new = merge(self.acr, offset, width, value) & 0x1F0F;
                // The bits ICRST and DCRST are two above ICEN and DCEN. A cache must be off to be reset (RM0090 3.9.1).
                if new >> 2 & new & (INSTRUCTION_CACHE | DATA_CACHE) != 0 {
                    find(FindingKind::Misuse, "a cache is reset while it is on: that does nothing");
                }
                self.acr = new;
                self.line = u32::MAX;
            }
            1 => {
                let key = value;
                match (self.key, key) {
                    (Key::None, 0x4567_0123) if self.cr & LOCK != 0 => self.key = Key::First,
                    (Key::First, 0xCDEF_89AB) => {
                        self.key = Key::None;
                        self.cr &= !LOCK;
                    }
                    _ => {
                        self.key = Key::Failed;
                        self.cr |= LOCK;
                        find(FindingKind::Misuse, "a wrong key: the control register is locked until the next reset");
                        return Outcome::BusError;
                    }
                }
            }
            2 => match (self.option_key, value) {
                (Key::None, 0x0819_2A3B) if self.optcr & OPTLOCK != 0 => self.option_key = Key::First,
                (Key::First, 0x4C5D_6E7F) => {
                    self.option_key = Key::None;
                    self.optcr &= !OPTLOCK;
                }
                _ => {
                    self.option_key = Key::Failed;
                    self.optcr |= OPTLOCK;
                    find(FindingKind::Misuse, "a wrong option key: OPTCR is locked until the next reset");
                    return Outcome::BusError;
                }
            },
            3 => self.sr &= !(merge(0, offset, width, value) & 0x1F3),
            4 => {
                if self.cr & LOCK != 0 {
                    find(FindingKind::Misuse, "CR is written while it is locked: it stays");
                    return Outcome::Done;
                }
                if self.sr & BSY != 0 {
                    find(FindingKind::Misuse, "CR is written during an operation: it stays");
                    return Outcome::Done;
                }
                self.cr = merge(self.cr, offset, width, value) & 0x8301_83FF;
                if self.cr & STRT != 0 {
                    return self.erase(now, pc, hz, out);
                }
            }
            5 | 6 if self.optcr & OPTLOCK != 0 => {
                find(FindingKind::Misuse, "an option register is written while it is locked: it stays");
            }
            5 => {
                let new = merge(self.optcr, offset, width, value) & 0x8FFF_FFFF;
                if new >> 8 & 0xFF != 0xAA {
                    find(FindingKind::Unmodelled, "read protection has no effect here");
                }
                if new & (1 << 4 | 1 << 30 | 1 << 31) != self.optcr & (1 << 4 | 1 << 30 | 1 << 31) {
                    find(FindingKind::Unmodelled, "BFB2, DB1M and SPRMOD have no effect here");
                }
                self.optcr = new & !OPTSTRT;
                if new & OPTSTRT != 0 {
                    self.programmed = true;
                    self.begin(3, now, hz, PROGRAM_NS);
                }
            }
            6 => self.optcr1 = merge(self.optcr1, offset, width, value) & 0x0FFF_0000,
            _ => {}
        }
        Outcome::Done
    }

    fn begin(&mut self, mask: u32, now: Cycle, hz: u64, ns: u64) {
        let until = now + (ns * (hz / 1000) / 1_000_000).max(1);
        for (bank, busy) in self.busy_until.iter_mut().enumerate() {
            if mask >> bank & 1 != 0 {
                *busy = until;
            }
        }
        self.sr |= BSY;
    }

    fn fail(&mut self, flag: u32) {
        self.sr |= flag;
        if self.cr & ERRIE != 0 {
            self.sr |= OPERR;
        }
    }

    fn is_protected(&self, bank: u32, sector: u32) -> bool {
        let bits = if bank == 0 { self.optcr } else { self.optcr1 };
        bits >> (16 + sector) & 1 == 0
    }

    fn erase(&mut self, now: Cycle, pc: Option<u32>, hz: u64, out: &mut Effects) -> Outcome {
        // Times for 8, 16 and 32 bits in parallel (DS9405). 64 bits need VPP, which no board here has.
        let psize = (self.cr >> 8 & 3) as usize;
        let mut find = |kind, text| out.notes.push(Note { kind, at: now, pc, place: "FLASH", text, value: None });
        if psize == 3 {
            find(FindingKind::Misuse, "PSIZE is 64 bits, which needs a voltage on VPP: nothing is erased");
            self.fail(PGPERR);
            self.cr &= !STRT;
            return Outcome::Done;
        }
        if self.cr & SER != 0 {
            let number = self.cr >> 3 & 0x1F;
            let (bank, sector) = (number >> 4, number & 0xF);
            if sector > 11 || self.is_protected(bank, sector) {
                self.fail(WRPERR);
                self.cr &= !STRT;
                return Outcome::Done;
            }
            let (offset, size) = sector_range(bank, sector);
            let ms = match size >> 10 {
                16 => [400, 300, 250],
                64 => [1200, 700, 550],
                _ => [2000, 1300, 1000],
            };
            self.memory.bytes_mut()[offset as usize..(offset + size) as usize].fill(0xFF);
            self.begin(1 << bank, now, hz, ms[psize] * 1_000_000);
            return Outcome::Changed;
        }
        let banks = u32::from(self.cr & MER != 0) | u32::from(self.cr & MER1 != 0) << 1;
        if banks == 0 {
            find(FindingKind::Misuse, "STRT without SER, MER or MER1: nothing is erased");
            self.cr &= !STRT;
            return Outcome::Done;
        }
        if (0..2).any(|bank| banks >> bank & 1 != 0 && (0..12).any(|sector| self.is_protected(bank, sector))) {
            self.fail(WRPERR);
            self.cr &= !STRT;
            return Outcome::Done;
        }
        for bank in 0..2 {
            if banks >> bank & 1 != 0 {
                self.memory.bytes_mut()[(bank * BANK) as usize..((bank + 1) * BANK) as usize].fill(0xFF);
            }
        }
        self.begin(banks, now, hz, [16_000, 11_000, 8_000][psize] * 1_000_000);
        Outcome::Changed
    }

    /// Returns the error flag and the reason for a store that programs nothing; `None` for a store that programs.
    fn refusal(&self, offset: u32, width: Width) -> Option<(u32, &'static str)> {
        let (bank, sector) = sector_of(offset);
        if self.cr & (LOCK | PG) != PG || self.cr & (SER | MER | MER1) != 0 {
            Some((PGSERR, "a store into flash without CR.PG alone and unlocked (PGSERR) does nothing, at"))
        } else if 1 << (self.cr >> 8 & 3) != width.bytes() {
            Some((PGPERR, "a store into flash of another width than PSIZE (PGPERR) does nothing, at"))
        } else if offset & 15 > 16 - width.bytes() {
            Some((PGAERR, "a store into flash across a line of 128 bits (PGAERR) does nothing, at"))
        } else if self.is_protected(bank, sector) {
            Some((WRPERR, "a store into a write-protected sector of flash (WRPERR) does nothing, at"))
        } else {
            None
        }
    }

    /// Carries out a store into flash, with HCLK at `hz`. If the store programs nothing, returns why.
    pub(crate) fn store(
        &mut self,
        offset: u32,
        width: Width,
        value: u32,
        now: Cycle,
        hz: u64,
    ) -> Result<(), &'static str> {
        if let Some((flag, text)) = self.refusal(offset, width) {
            self.fail(flag);
            return Err(text);
        }
        let (bank, _) = sector_of(offset);
        let bytes = value.to_le_bytes();
        let at = offset as usize;
        let memory = &mut self.memory.bytes_mut()[at..at + width.bytes() as usize];
        for (to, byte) in memory.iter_mut().zip(bytes) {
            *to &= byte;
        }
        self.begin(1 << bank, now, hz, PROGRAM_NS);
        Ok(())
    }

    /// The wait states of a read: none if prefetch or a cache has the data, else the latency. At worst each line of 128
    /// bits is fetched again (RM0090 3.5.2).
    #[inline(always)]
    pub(crate) fn wait_states(&mut self, address: u32, fetch: bool, bound: Bound) -> u32 {
        let cached = if fetch { self.acr & (PREFETCH | INSTRUCTION_CACHE) } else { self.acr & DATA_CACHE } != 0;
        match bound {
            Bound::Best if cached => 0,
            _ if fetch => {
                let line = address >> 4;
                if std::mem::replace(&mut self.line, line) == line { 0 } else { self.latency() }
            }
            _ => {
                // The array has only one read port, so a data access replaces the line of instructions.
                self.line = u32::MAX;
                self.latency()
            }
        }
    }
}

/// The offset and the size of a sector (0 to 11) of a bank: four of 16 KiB, one of 64 KiB, seven of 128 KiB (RM0090
/// table 6).
fn sector_range(bank: u32, sector: u32) -> (u32, u32) {
    const KIB: u32 = 1 << 10;
    let (offset, size) = match sector {
        0..=3 => (sector * 16 * KIB, 16 * KIB),
        4 => (64 * KIB, 64 * KIB),
        _ => ((sector - 4) * 128 * KIB, 128 * KIB),
    };
    (bank * BANK + offset, size)
}

fn sector_of(offset: u32) -> (u32, u32) {
    let (bank, within) = ((offset / BANK) & 1, (offset % BANK) >> 10);
    let sector = match within {
        0..64 => within / 16,
        64..128 => 4,
        _ => 4 + within / 128,
    };
    (bank, sector)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MHZ: u64 = 1_000_000;

    /// Returns flash full of zeros with these wait states, HCLK, supply and noise seed.
    fn flash(latency: u32, hz: u64, microvolts: u32, noise: u64) -> FlashControl {
        let mut flash = FlashControl::new();
        flash.memory.bytes_mut()[..4096].fill(0);
        (flash.acr, flash.noise) = (latency, noise);
        flash.check(hz, microvolts, 0, None, &mut Effects::default());
        flash
    }

    fn wrong(mut flash: FlashControl) -> Vec<(u32, u32)> {
        let read = (0..100_000_u32).map(|nth| (nth, flash.read(nth % 1024 * 4, Width::Word).unwrap()));
        read.filter(|(_, word)| *word != 0).collect()
    }

    /// Table 11 of RM0090 gives the MHz for each wait state: 30, 24, 22 and 20, from 2.7, 2.4, 2.1 and 1.8 V on.
    #[test]
    fn four_wait_states_at_144_mhz_need_2700_mv() {
        assert_eq!(flash(4, 144 * MHZ, 2_700_000, 0).missing, 0);
        for (microvolts, missing) in [(2_699_999, 1), (2_400_000, 1), (2_399_999, 2), (2_100_000, 2), (2_099_999, 3)] {
            assert_eq!(flash(4, 144 * MHZ, microvolts, 0).missing, missing, "{microvolts}");
        }
        assert_eq!(flash(0, 16 * MHZ, 1_800_000, 0).missing, 0, "the clock of the start");
    }

    #[test]
    fn a_missing_wait_state_flips_single_bits_by_the_seed() {
        for noise in 0..15 {
            let found = wrong(flash(4, 144 * MHZ, 2_500_000, noise));
            assert!(!found.is_empty() || noise > 12, "{noise}");
            assert!(found.iter().all(|(_, word)| word.is_power_of_two()));
            assert_eq!(found, wrong(flash(4, 144 * MHZ, 2_500_000, noise)));
            assert!(noise > 10 || found != wrong(flash(4, 144 * MHZ, 2_500_000, noise + 15)), "{noise}");
            assert!(wrong(flash(4, 144 * MHZ, 2_700_000, noise)).is_empty());
        }
        let lower = wrong(flash(4, 144 * MHZ, 1_900_000, 3)).len();
        assert!(lower > wrong(flash(4, 144 * MHZ, 2_500_000, 3)).len());
        let unsure = flash(4, 144 * MHZ, 2_500_000, 0);
        assert!(!unsure.is_quiet() && !unsure.is_certain() && unsure.is_readable());
    }

    #[test]
    fn a_reset_loads_only_options_that_were_programmed() {
        let mut flash = FlashControl::new();
        let write = |flash: &mut FlashControl, offset, value| {
            flash.write_register(offset, Width::Word, value, 0, None, 16 * MHZ, &mut Effects::default());
        };
        write(&mut flash, 8, 0x0819_2A3B);
        write(&mut flash, 8, 0x4C5D_6E7F);
        write(&mut flash, 0x14, 0x0FFF_AAE0);
        assert_eq!((flash.brown_out_level(), flash.take_options()), (0, None));
        write(&mut flash, 0x14, 0x0FFF_AAE2);
        assert_eq!(flash.take_options(), Some(0x0FFF_AAE0));
        flash.reset(0x0FFF_AAEC);
        assert_eq!((flash.brown_out_level(), flash.optcr), (3, 0x0FFF_AAED));
    }
}
