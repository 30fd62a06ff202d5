//! What the core asks of the part around it.

use crate::Signals;

/// How many bytes an access moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// One byte.
    Byte = 1,
    /// Two bytes.
    Half = 2,
    /// Four bytes.
    Word = 4,
}

impl Width {
    /// The number of bytes.
    #[must_use]
    pub const fn bytes(self) -> u32 {
        self as u32
    }
}

/// What an access is for, as the bus matrix tells them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// An instruction is fetched (I-Code below 0x2000_0000, else the system bus).
    Fetch,
    /// A load or store of an instruction.
    Data,
    /// A load relative to the program counter (D-Code).
    Literal,
    /// A vector is fetched.
    Vector,
    /// Exception entry or return moves a register.
    Stack,
    /// A debugger reads or writes; nothing may change that only a real access changes.
    Debugger,
    /// The AHB-AP of the debug port reads or writes: a real access with all that it sets off, made by no instruction.
    AccessPort,
}

/// One access of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// The address. Aligned to the width: the core splits accesses that are not.
    pub address: u32,
    /// How many bytes.
    pub width: Width,
    /// What for.
    pub purpose: Purpose,
    /// Whether the core is privileged.
    pub privileged: bool,
    /// The core's cycle at which it takes place.
    pub cycle: u64,
    /// The address of the instruction that makes it.
    pub pc: u32,
}

/// The part did not answer, or refused: the core takes a precise bus fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusError;

/// At which end of what is possible a bus reckons its wait states, see [`crate::Cost`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Every cache hits and no other controller is in the way.
    Best,
    /// Every cache misses and every other controller that is active is in the way.
    Worst,
}

/// The part around a core: memory, peripherals, interrupt lines. Static dispatch: [`crate::Core::run`] is compiled for
/// it.
pub trait Bus {
    /// Reads. The core's own space, 0xE000_0000 to 0xE00F_FFFF, never gets here, but for the part's share of the
    /// external private peripheral bus, 0xE004_2000 to 0xE00F_EFFF, where the STM32 has its DBGMCU.
    ///
    /// # Errors
    ///
    /// [`BusError`] where nothing answers.
    fn read(&mut self, access: &Access) -> Result<u32, BusError>;

    /// Writes the low `access.width` bytes of `value`.
    ///
    /// # Errors
    ///
    /// [`BusError`] where nothing answers or what is there refuses.
    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError>;

    /// What [`Bus::read`] would answer, where that is memory which answers at once and reading it has no effect on
    /// anything: a shorter way to the same value. `None` where it is not, and for any access that is not aligned.
    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        let _ = (address, width);
        None
    }

    /// Does what [`Bus::write`] would do, where that is memory which takes it at once and writing it has no other
    /// effect, and answers `true`: a shorter way to the same end. Else, and for any access that is not aligned,
    /// `false`.
    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        let _ = (address, width, value);
        false
    }

    /// The halfword at `address` for the decoder. Has no effect and takes no time.
    ///
    /// # Errors
    ///
    /// [`BusError`] where nothing can be executed.
    fn fetch(&mut self, address: u32) -> Result<u16, BusError>;

    /// Whether what [`Bus::fetch`] reads at `address` stays the same until [`Signals::forget_code`]: flash.
    fn is_constant(&self, address: u32) -> bool;

    /// From now on the page of 1 KiB that has `address`, of memory that can be written, is watched for writes. Answers
    /// whether the part does that. Of memory for which it does not, the core compares each decoded instruction with
    /// what [`Bus::fetch`] reads, before it executes it.
    fn watch_code(&mut self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// Whether the page that has `address` is watched and nothing in it was written since.
    fn is_watched(&self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// How many pages that were watched have been written so far, whoever wrote them: their watch has ended.
    #[inline(always)]
    fn rewritten(&self) -> u64 {
        0
    }

    /// The next cycle at which something happens outside the core, `u64::MAX` for never.
    fn due(&self) -> u64;

    /// Carries out, in order, everything outside the core that is due up to and at `cycle`. Afterwards [`Bus::due`] is
    /// later than `cycle`.
    fn advance(&mut self, cycle: u64);

    /// The core went to sleep (`true`; `deep` is SCR.SLEEPDEEP) or woke, at `cycle`.
    fn sleeps(&mut self, cycle: u64, asleep: bool, deep: bool) {
        let _ = (cycle, asleep, deep);
    }

    /// What the part drives into the core now.
    fn signals(&mut self) -> &mut Signals;

    /// Wait states of an access beyond the core's own cycles, asked only where the cost has a [`Bound`].
    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32;

    /// A peripheral bit-band alias (PM0214, TRM: bit-banding) is present: 0x2200_0000 and 0x4200_0000 reach single
    /// bits of 0x2000_0000 and 0x4000_0000.
    fn bit_banding(&self) -> bool;
}
