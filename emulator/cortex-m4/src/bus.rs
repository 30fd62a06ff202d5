//! The interface between the core and the part around it.

use crate::Signals;

/// The number of bytes that an access moves.
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

/// The purpose of an access. The bus matrix of a part distinguishes these purposes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The core fetches an instruction (over the I-Code bus below 0x2000_0000, else over the system bus).
    Fetch,
    /// An instruction loads or stores data.
    Data,
    /// An instruction loads data relative to the program counter, over the D-Code bus.
    Literal,
    /// The core fetches an exception vector.
    Vector,
    /// Exception entry or return writes or reads a register on the stack.
    Stack,
    /// A debugger reads or writes. Such an access has none of the side effects of a real access.
    Debugger,
    /// The AHB-AP of the debug port reads or writes. This is a real access with all its side effects, but no
    /// instruction makes it.
    AccessPort,
}

/// One access of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    /// The first address of the access. It is aligned to the width, because the core splits unaligned accesses.
    pub address: u32,
    /// The number of bytes.
    pub width: Width,
    /// The purpose of the access.
    pub purpose: Purpose,
    /// Whether the core is privileged.
    pub privileged: bool,
    /// The core's cycle at which the access takes place.
    pub cycle: u64,
    /// The address of the instruction that makes the access.
    pub pc: u32,
}

/// The error of an access that the part does not answer or refuses. The core takes a precise bus fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusError;

/// Which wait states of the bus a clock counts: the least or the most. See [`crate::Cost`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The least wait states: every cache hits, and no other bus controller delays the access.
    Best,
    /// The most wait states: every cache misses, and every other active bus controller delays the access.
    Worst,
}

/// The part around a core: memory, peripherals and interrupt lines. Dispatch is static: [`crate::Core::run`] is
/// compiled for each implementation.
pub trait Bus {
    /// Reads from memory or a peripheral. The core answers accesses to its own space, 0xE000_0000 to 0xE00F_FFFF, by
    /// itself. The exception is the part's share of the external private peripheral bus, 0xE004_2000 to 0xE00F_EFFF,
    /// where the STM32 has its DBGMCU.
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] where nothing answers.
    fn read(&mut self, access: &Access) -> Result<u32, BusError>;

    /// Writes the low `access.width` bytes of `value`.
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] where nothing answers, or where the part refuses the write.
    fn write(&mut self, access: &Access, value: u32) -> Result<(), BusError>;

    /// Returns the value that [`Bus::read`] would return, if the access is aligned and goes to memory that answers at
    /// once. Returns `None` for every other access. This way is faster than [`Bus::read`].
    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        let _ = (address, width);
        None
    }

    /// Writes as [`Bus::write`] does and returns `true`, if the access is aligned and goes to memory that takes the
    /// value at once. Returns `false` for every other access. This way is faster than [`Bus::write`].
    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        let _ = (address, width, value);
        false
    }

    /// Reads the halfword at `address` for the decoder. The read has no side effect and takes no time.
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] where nothing can be executed.
    fn fetch(&mut self, address: u32) -> Result<u16, BusError>;

    /// Whether the memory at `address`, such as flash, stays the same until [`Signals::forget_code`] is called.
    fn is_constant(&self, address: u32) -> bool;

    /// Begins to watch the page of 1 KiB that has `address` for writes. Returns whether the part can watch the page. If
    /// it cannot, the core compares each decoded instruction with [`Bus::fetch`] before executing it.
    fn watch_code(&mut self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// Whether the page that has `address` is watched and has not been written since the watch began.
    fn is_watched(&self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// The number of watched pages that have been written so far, by any bus controller. A write ends the watch of its
    /// page.
    #[inline(always)]
    fn rewritten(&self) -> u64 {
        0
    }

    /// The next cycle at which something happens outside the core, `u64::MAX` for never.
    fn due(&self) -> u64;

    /// Carries out, in order, every event outside the core that is due at or before `cycle`.
    fn advance(&mut self, cycle: u64);

    /// Tells the part that the core fell asleep (`asleep`) or woke at `cycle`; `deep` is SCR.SLEEPDEEP.
    fn sleeps(&mut self, cycle: u64, asleep: bool, deep: bool) {
        let _ = (cycle, asleep, deep);
    }

    /// The signals that the part drives into the core now.
    fn signals(&mut self) -> &mut Signals;

    /// The wait states that an access adds to the core's own cycles. The core asks for them only where its cost has a
    /// [`Bound`].
    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32;

    /// Returns the wait states that [`Bus::wait_states`] would return for an access to memory at `cycle`, and has the
    /// same effects. With `fetch` the core fetches the word at `address`, else it reads or writes data there. Returns
    /// `None`, without an effect, if the address alone does not determine the wait states. This way is faster than
    /// [`Bus::wait_states`].
    #[inline(always)]
    fn memory_waits(&mut self, address: u32, fetch: bool, cycle: u64, bound: Bound) -> Option<u32> {
        let _ = (address, fetch, cycle, bound);
        None
    }

    /// Whether the part has bit-band aliases (PM0214 and TRM, bit-banding): 0x2200_0000 and 0x4200_0000 reach single
    /// bits from 0x2000_0000 and 0x4000_0000 on.
    fn bit_banding(&self) -> bool;
}
