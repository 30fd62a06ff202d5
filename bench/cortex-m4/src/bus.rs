//! What the core asks of the part around it.

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

/// What the part drives into the core, and what it wants of [`crate::Core::run`]. The core looks only where something
/// was announced, so everything that changes a signal here announces it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Signals {
    pub(crate) lines: [u64; 4],
    pub(crate) nmi: bool,
    pub(crate) event: bool,
    pub(crate) changed: bool,
    pub(crate) code_changed: bool,
    pub(crate) stop: bool,
    pub(crate) stalled_until: u64,
}

impl Signals {
    /// [`Bus::due`] or the core's clock is another: the core looks again before its next instruction.
    #[inline]
    pub fn announce(&mut self) {
        self.changed = true;
    }

    /// Whether the core has something to look at.
    #[inline]
    #[must_use]
    pub fn is_announced(&self) -> bool {
        self.changed
    }

    /// The levels of the interrupt lines: line n is bit n % 64 of word n / 64.
    #[must_use]
    pub fn lines(&self) -> &[u64; 4] {
        &self.lines
    }

    /// Drives all lines of one word of [`Signals::lines`].
    #[inline]
    pub fn drive_lines(&mut self, word: usize, levels: u64) {
        if std::mem::replace(&mut self.lines[word], levels) != levels {
            self.changed = true;
        }
    }

    /// Drives one interrupt line.
    #[inline]
    pub fn drive_line(&mut self, line: usize, high: bool) {
        let (word, bit) = (line / 64, 1 << (line % 64));
        let others = self.lines[word] & !bit;
        self.drive_lines(word, if high { others | bit } else { others });
    }

    /// The level of the NMI input.
    #[must_use]
    pub fn nmi(&self) -> bool {
        self.nmi
    }

    /// Drives the NMI input.
    pub fn drive_nmi(&mut self, high: bool) {
        if std::mem::replace(&mut self.nmi, high) != high {
            self.changed = true;
        }
    }

    /// An event for `WFE` comes from outside; the core takes it back.
    pub fn raise_event(&mut self) {
        (self.event, self.changed) = (true, true);
    }

    /// Instructions that were decoded no longer are what memory holds (flash was programmed or erased): the core
    /// forgets what it decoded. RAM needs no such notice.
    pub fn forget_code(&mut self) {
        (self.code_changed, self.changed) = (true, true);
    }

    /// Whether the core has code to forget that it has not forgotten yet.
    #[must_use]
    pub fn forgets_code(&self) -> bool {
        self.code_changed
    }

    /// [`crate::Core::run`] returns after the instruction, with [`crate::Exit::Stopped`].
    pub fn stop(&mut self) {
        (self.stop, self.changed) = (true, true);
    }

    /// The core executes nothing before `cycle`, since the bus holds it (a flash controller that works); 0 lets it go.
    #[inline]
    pub fn stall_until(&mut self, cycle: u64) {
        if std::mem::replace(&mut self.stalled_until, cycle) != cycle {
            self.changed = true;
        }
    }

    /// The cycle before which the core executes nothing.
    #[must_use]
    pub fn stalled_until(&self) -> u64 {
        self.stalled_until
    }
}

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

    /// What [`Bus::fetch`] would answer for `address`, and above it for the halfword behind: a shorter way to the same
    /// values. `None` where it is none.
    #[inline(always)]
    fn fetch_both(&self, address: u32) -> Option<u32> {
        let _ = address;
        None
    }

    /// Whether what [`Bus::fetch`] reads at `address` stays the same until [`Signals::forget_code`]: flash. Of RAM,
    /// the core compares each decoded instruction with memory before it executes it.
    fn is_constant(&self, address: u32) -> bool;

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
