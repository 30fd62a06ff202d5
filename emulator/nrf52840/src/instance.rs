//! What every peripheral of the part has in common (PS 6.1, *Peripheral interface*).
//!
//! A peripheral is a block of registers at its ID × 0x1000: tasks below 0x100, events from 0x100 (bit *n* of INTEN is
//! the event at 0x100 + 4 *n*), SHORTS at 0x200, INTEN, INTENSET and INTENCLR at 0x300 to 0x308. [`Block`] holds those,
//! and the interconnect serves them for everyone; an [`Instance`] adds its own tasks and registers.
//!
//! An instance never reaches another. It says what happens ([`Act`]) and the interconnect carries it, in order and at
//! the same instant: an event to the PPI, a level to a pin, a byte to the outside. Memory and the levels of the pins it
//! has at hand ([`Cx`]).
pub(crate) use crate::act::{Act, COMP, GPIO, Id, Outbox, Source};
use crate::clocks::Clocks;
use crate::gpio::Gpio;
use crate::memory::Memory;
use emulator_part::{Cycle, FindingKind};

/// What an instance is handed with every call.
pub(crate) struct Cx<'a> {
    /// The cycle.
    pub(crate) now: Cycle,
    pub(crate) clocks: &'a Clocks,
    pub(crate) memory: &'a mut Memory,
    pub(crate) pins: &'a Gpio,
    pub(crate) out: &'a mut Outbox,
    /// The instance called.
    pub(crate) id: Id,
    pub(crate) name: &'static str,
}

impl Cx<'_> {
    #[inline]
    pub(crate) fn act(&mut self, act: Act) {
        self.out.acts.push_back(act);
    }

    /// PCLK16M ticks by now.
    #[inline]
    pub(crate) fn hf(&self) -> u64 {
        self.clocks.hf.ticks(self.now)
    }

    /// EasyDMA reads a byte; `None`, reported, where it does not reach.
    pub(crate) fn dma_read(&mut self, address: u32) -> Option<u8> {
        let byte = self.memory.dma_read(address);
        if byte.is_none() {
            self.found(FindingKind::Unreachable, "EasyDMA reads outside data RAM, at", address);
        }
        byte
    }

    /// EasyDMA writes a byte; nothing, reported, where it does not reach.
    pub(crate) fn dma_write(&mut self, address: u32, value: u8) {
        if !self.memory.dma_write(address, value) {
            self.found(FindingKind::Unreachable, "EasyDMA writes outside data RAM, at", address);
        }
    }

    fn found(&mut self, kind: FindingKind, what: &'static str, value: u32) {
        self.out.find(self.now, kind, self.name, what, value);
    }

    /// The firmware did what the specification forbids or leaves undefined.
    pub(crate) fn misuse(&mut self, what: &'static str, value: u32) {
        self.found(FindingKind::Misuse, what, value);
    }

    /// The firmware reached something this model does not have.
    pub(crate) fn unmodelled(&mut self, what: &'static str, value: u32) {
        self.found(FindingKind::Unmodelled, what, value);
    }

    /// The firmware did something an anomaly of the silicon spoils.
    pub(crate) fn anomaly(&mut self, what: &'static str, value: u32) {
        self.found(FindingKind::Erratum, what, value);
    }
}

/// The registers every peripheral has: events, interrupt enable, shortcuts.
#[derive(Debug, Default, Clone)]
pub(crate) struct Block {
    pub(crate) events: u32,
    pub(crate) inten: u32,
    pub(crate) shorts: u32,
}

/// Where event `n` of a block is.
pub(crate) const fn event(n: u32) -> u32 {
    0x100 + 4 * n
}

impl Block {
    /// Sets event `n` and tells the PPI.
    #[inline]
    pub(crate) fn raise(&mut self, n: u32, cx: &mut Cx<'_>) {
        self.events |= 1 << n;
        cx.act(Act::Event(address_of(cx.id) + event(n)));
    }

    /// Whether shortcut `bit` is set.
    #[inline]
    pub(crate) fn short(&self, bit: u32) -> bool {
        self.shorts >> bit & 1 != 0
    }
}

/// The first address of an instance on the APB, or of the GPIO ports.
pub(crate) const fn address_of(id: Id) -> u32 {
    if id == GPIO { 0x5000_0000 } else { 0x4000_0000 + ((id as u32) << 12) }
}

/// A peripheral.
pub(crate) trait Instance {
    /// The common registers.
    fn block(&mut self) -> &mut Block;
    /// The common registers, to look at.
    fn block_ref(&self) -> &Block;
    /// Triggers the task at `offset`; `false` where there is none modelled.
    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        let _ = (offset, cx);
        false
    }
    /// What a register of its own reads at `now`, or `None` where it is not modelled.
    fn read(&self, offset: u32, now: Cycle, clocks: &Clocks) -> Option<u32> {
        let _ = (offset, now, clocks);
        None
    }
    /// The core read a register of its own, for those that this changes.
    #[inline]
    fn was_read(&mut self, offset: u32, cx: &mut Cx<'_>) {
        let _ = (offset, cx);
    }
    /// A write to a register of its own; `false` where it is not modelled.
    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        let _ = (offset, value, cx);
        false
    }
    /// SHORTS, INTEN or a clock changed: what it has scheduled may move.
    #[inline]
    fn configured(&mut self, cx: &mut Cx<'_>) {
        let _ = cx;
    }
    /// The next cycle at which something happens inside.
    #[inline]
    fn next(&self) -> Option<Cycle> {
        None
    }
    /// That cycle has come.
    #[inline]
    fn due(&mut self, cx: &mut Cx<'_>) {
        let _ = cx;
    }
    /// Whether EasyDMA is moving something for it.
    #[inline]
    fn moves(&self) -> bool {
        false
    }
    /// The level of its interrupt: any event set and enabled.
    #[inline]
    fn line(&self) -> bool {
        let block = self.block_ref();
        block.events & block.inten != 0
    }
}

/// Writes the two methods of [`Instance`] that hand out a field called `block`.
macro_rules! block {
    () => {
        #[inline]
        fn block(&mut self) -> &mut $crate::instance::Block {
            &mut self.block
        }
        #[inline]
        fn block_ref(&self) -> &$crate::instance::Block {
            &self.block
        }
    };
}
pub(crate) use block;

/// The index in an array of registers of `count`, `stride` bytes apart from `base`, where `offset` is one of them.
#[inline]
pub(crate) fn index(offset: u32, base: u32, stride: u32, count: u32) -> Option<usize> {
    let past = offset.checked_sub(base)?;
    (past.is_multiple_of(stride) && past / stride < count).then_some((past / stride) as usize)
}
