//! The interface of all peripherals (PS 6.1, *Peripheral interface*).
//!
//! A peripheral is a block of registers at its ID × 0x1000: tasks below 0x100, events from 0x100 (bit *n* of INTEN is
//! the event at 0x100 + 4 *n*), SHORTS at 0x200, INTEN, INTENSET and INTENCLR at 0x300 to 0x308. [`Block`] holds these
//! common registers, which the interconnect serves. An [`Instance`] adds its own tasks and registers.
//!
//! An instance never calls another. It reports each effect as an [`Act`]. The interconnect delivers the acts in order
//! and at the same instant: an event to the PPI, a level to a pin, a byte to the outside. The instance accesses memory
//! and pins directly, through its [`Cx`].
pub(crate) use crate::act::{Act, COMP, GPIO, Id, Outbox, Source};
use crate::clocks::Clocks;
use crate::gpio::Gpio;
use crate::memory::Memory;
use emulator_part::{Cycle, FindingKind};

pub(crate) struct Cx<'a> {
    pub(crate) now: Cycle,
    pub(crate) clocks: &'a Clocks,
    pub(crate) memory: &'a mut Memory,
    pub(crate) pins: &'a Gpio,
    pub(crate) out: &'a mut Outbox,
    pub(crate) id: Id,
    pub(crate) name: &'static str,
}

impl Cx<'_> {
    #[inline]
    pub(crate) fn act(&mut self, act: Act) {
        self.out.acts.push_back(act);
    }

    #[inline]
    pub(crate) fn hf(&self) -> u64 {
        self.clocks.hf.ticks(self.now)
    }

    /// Reads a byte by EasyDMA. Reports an address that EasyDMA does not reach, and returns `None`.
    pub(crate) fn dma_read(&mut self, address: u32) -> Option<u8> {
        let byte = self.memory.dma_read(address);
        if byte.is_none() {
            self.found(FindingKind::Unreachable, "EasyDMA reads outside data RAM, at", address);
        }
        byte
    }

    /// Writes a byte by EasyDMA. Reports an address that EasyDMA does not reach.
    pub(crate) fn dma_write(&mut self, address: u32, value: u8) {
        if !self.memory.dma_write(address, value) {
            self.found(FindingKind::Unreachable, "EasyDMA writes outside data RAM, at", address);
        }
    }

    fn found(&mut self, kind: FindingKind, what: &'static str, value: u32) {
        self.out.find(self.now, kind, self.name, what, value);
    }

    /// Reports that the firmware did something forbidden or undefined.
    pub(crate) fn misuse(&mut self, what: &'static str, value: u32) {
        self.found(FindingKind::Misuse, what, value);
    }

    /// Reports that the firmware used something without a model.
    pub(crate) fn unmodelled(&mut self, what: &'static str, value: u32) {
        self.found(FindingKind::Unmodelled, what, value);
    }

    /// Reports that the firmware used something that an anomaly of the silicon keeps from working.
    pub(crate) fn anomaly(&mut self, what: &'static str, value: u32) {
        self.found(FindingKind::Erratum, what, value);
    }
}

#[derive(Debug, Default, Clone)]
pub(crate) struct Block {
    pub(crate) events: u32,
    pub(crate) inten: u32,
    pub(crate) shorts: u32,
}

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

    #[inline]
    pub(crate) fn short(&self, bit: u32) -> bool {
        self.shorts >> bit & 1 != 0
    }
}

pub(crate) const fn address_of(id: Id) -> u32 {
    if id == GPIO { 0x5000_0000 } else { 0x4000_0000 + ((id as u32) << 12) }
}

/// One instance of a peripheral.
pub(crate) trait Instance {
    fn block(&mut self) -> &mut Block;
    fn block_ref(&self) -> &Block;
    /// Triggers the task at `offset`. Returns `false` if no such task is modelled.
    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        let _ = (offset, cx);
        false
    }
    /// Reads one of the instance's own registers. Returns `None` if the register is not modelled.
    fn read(&self, offset: u32, now: Cycle, clocks: &Clocks) -> Option<u32> {
        let _ = (offset, now, clocks);
        None
    }
    /// Tells the instance that the core read a register. Only some registers change when they are read.
    #[inline]
    fn was_read(&mut self, offset: u32, cx: &mut Cx<'_>) {
        let _ = (offset, cx);
    }
    /// Writes one of the instance's own registers. Returns `false` if the register is not modelled.
    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        let _ = (offset, value, cx);
        false
    }
    /// Tells the instance that SHORTS, INTEN or a clock changed, which may move its next event.
    #[inline]
    fn configured(&mut self, cx: &mut Cx<'_>) {
        let _ = cx;
    }
    /// The next cycle at which the instance has an event; `None` if it has none.
    #[inline]
    fn next(&self) -> Option<Cycle> {
        None
    }
    #[inline]
    fn due(&mut self, cx: &mut Cx<'_>) {
        let _ = cx;
    }
    #[inline]
    fn moves(&self) -> bool {
        false
    }
    /// The level of the instance's interrupt, which is high while any event is both set and enabled.
    #[inline]
    fn line(&self) -> bool {
        let block = self.block_ref();
        block.events & block.inten != 0
    }
}

/// Writes the two methods of [`Instance`] that return the field `block`.
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

/// The index of the register at `offset` in an array of `count` registers from `base` on, `stride` bytes apart; `None`
/// outside the array.
#[inline]
pub(crate) fn index(offset: u32, base: u32, stride: u32, count: u32) -> Option<usize> {
    let past = offset.checked_sub(base)?;
    (past.is_multiple_of(stride) && past / stride < count).then_some((past / stride) as usize)
}
