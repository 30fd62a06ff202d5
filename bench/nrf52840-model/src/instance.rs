//! What every peripheral of the part has in common (PS 6.1, *Peripheral interface*).
//!
//! A peripheral is a block of registers at its ID × 0x1000: tasks below 0x100, events from 0x100 (bit *n* of INTEN is
//! the event at 0x100 + 4 *n*), SHORTS at 0x200, INTEN, INTENSET and INTENCLR at 0x300 to 0x308. [`Block`] holds those,
//! and the interconnect serves them for everyone; an [`Instance`] adds its own tasks and registers.
//!
//! An instance never reaches another. It says what happens ([`Act`]) and the interconnect carries it, in order and at
//! the same instant: an event to the PPI, a byte to memory, a level to a pin.
use crate::clocks::Clocks;
use crate::{Finding, FindingKind, Pin, SpisEvent};
use std::collections::VecDeque;
use std::fmt::Debug;

/// A peripheral ID, which is also the number of its interrupt where it has one (PS 6.1).
pub(crate) type Id = usize;

/// What a peripheral makes happen beyond its own registers.
#[derive(Debug)]
pub(crate) enum Act {
    /// The event register at this address was set: the PPI hears it.
    Event(u32),
    /// The task register at this address is triggered.
    Task(u32),
    /// EasyDMA or the flash controller reads `bytes` (1 or 4) for `id`, answered through [`Instance::answer`].
    Read { id: Id, token: u32, address: u32, bytes: u8 },
    /// EasyDMA writes one byte.
    Write { address: u32, value: u8 },
    /// The flash controller puts a word into its array.
    Program { address: u32, value: u32 },
    /// The flash controller erases part of its array.
    Erase { from: u32, bytes: u32 },
    /// A peripheral takes a pin over and drives it (`Some`), or gives it back to GPIO (`None`).
    Hold { pin: Pin, level: Option<bool> },
    /// A pad changed its level.
    Pad { pin: Pin, level: bool },
    /// A pad is driven now, or no longer.
    Driven { pin: Pin },
    /// A channel of GPIOTE starts to watch its pin.
    Sample { channel: usize },
    /// The DETECT signal rose (PS 6.9).
    Detect,
    /// A controller of the serial block `id` clocks one byte out, as it travels on the wire.
    Exchange { id: Id, mosi: u8 },
    /// A byte left the UARTE `id`.
    Sent { id: Id, byte: u8 },
    /// An SPIS let the outside see something of its semaphore.
    Spis { id: Id, event: SpisEvent },
    /// The clock controller changed a source.
    Clock(Source),
    /// The watchdog wants LFCLK to run.
    DemandLfclk,
    /// The part restarts.
    Reset(Restart),
}

/// A change of a clock's source, and the error it has from here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// HFINT.
    HighInternal,
    /// HFXO.
    HighCrystal,
    /// LFCLK from the RC oscillator.
    LowRc,
    /// LFCLK from the crystal.
    LowCrystal,
    /// LFCLK synthesised from HFCLK.
    LowSynthesised,
    /// No LFCLK.
    LowStopped,
}

/// Why the part restarts itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Restart {
    Watchdog,
    Lockup,
}

/// What the instances hand to the interconnect.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    pub(crate) acts: VecDeque<Act>,
    pub(crate) findings: Vec<Finding>,
}

impl Outbox {
    /// Notes `what` of `instance` at `at`; the same again only counts.
    pub(crate) fn find(&mut self, at: u64, kind: FindingKind, instance: &'static str, what: &'static str, value: u32) {
        if let Some(found) = self.findings.iter_mut().find(|f| f.instance == instance && f.what == what) {
            found.count += 1;
        } else {
            self.findings.push(Finding { at, kind, instance, what, value, count: 1 });
        }
    }
}

/// What an instance is handed with every call.
pub(crate) struct Cx<'a> {
    /// The instant, in ns.
    pub(crate) now: u64,
    pub(crate) clocks: &'a Clocks,
    pub(crate) out: &'a mut Outbox,
    /// The instance called.
    pub(crate) id: Id,
    pub(crate) name: &'static str,
}

impl Cx<'_> {
    pub(crate) fn act(&mut self, act: Act) {
        self.out.acts.push_back(act);
    }

    /// PCLK16M ticks by now.
    pub(crate) fn hf(&self) -> u64 {
        self.clocks.hf.ticks(self.now)
    }

    /// The firmware did what the specification forbids or leaves undefined.
    pub(crate) fn misuse(&mut self, what: &'static str, value: u32) {
        self.out.find(self.now, FindingKind::Misuse, self.name, what, value);
    }

    /// The firmware reached something this model does not have.
    pub(crate) fn unmodelled(&mut self, what: &'static str, value: u32) {
        self.out.find(self.now, FindingKind::Unmodelled, self.name, what, value);
    }

    /// The firmware did something an anomaly of the silicon spoils.
    pub(crate) fn anomaly(&mut self, what: &'static str, value: u32) {
        self.out.find(self.now, FindingKind::Anomaly, self.name, what, value);
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
    pub(crate) fn raise(&mut self, n: u32, cx: &mut Cx<'_>) {
        self.events |= 1 << n;
        cx.act(Act::Event(address_of(cx.id) + event(n)));
    }

    /// Whether shortcut `bit` is set.
    pub(crate) fn short(&self, bit: u32) -> bool {
        self.shorts >> bit & 1 != 0
    }
}

/// The first address of an instance on the APB, or of the GPIO ports.
pub(crate) const fn address_of(id: Id) -> u32 {
    if id == crate::soc::GPIO { 0x5000_0000 } else { 0x4000_0000 + ((id as u32) << 12) }
}

/// A peripheral.
pub(crate) trait Instance: Debug + Send {
    /// The common registers.
    fn block(&mut self) -> &mut Block;
    /// The common registers, to look at.
    fn block_ref(&self) -> &Block;
    /// Triggers the task at `offset`; `false` where there is none modelled.
    fn task(&mut self, offset: u32, cx: &mut Cx<'_>) -> bool {
        let _ = (offset, cx);
        false
    }
    /// What a register of its own reads at `now`, or `None` where it is not modelled. No register modelled here changes
    /// when it is read.
    fn read(&self, offset: u32, now: u64, clocks: &Clocks) -> Option<u32> {
        let _ = (offset, now, clocks);
        None
    }
    /// A write to a register of its own; `false` where it is not modelled.
    fn write(&mut self, offset: u32, value: u32, cx: &mut Cx<'_>) -> bool {
        let _ = (offset, value, cx);
        false
    }
    /// SHORTS, INTEN or a clock changed: what it has scheduled may move.
    fn configured(&mut self, cx: &mut Cx<'_>) {
        let _ = cx;
    }
    /// The next instant, in ns, at which something happens inside.
    fn next(&self) -> Option<u64> {
        None
    }
    /// That instant has come.
    fn due(&mut self, cx: &mut Cx<'_>) {
        let _ = cx;
    }
    /// Memory answered a read.
    fn answer(&mut self, token: u32, value: u32, cx: &mut Cx<'_>) {
        let _ = (token, value, cx);
    }
    /// The level of its interrupt: any event set and enabled.
    fn line(&self) -> bool {
        let block = self.block_ref();
        block.events & block.inten != 0
    }
}

/// Writes the two methods of [`Instance`] that hand out a field called `block`.
macro_rules! block {
    () => {
        fn block(&mut self) -> &mut $crate::instance::Block {
            &mut self.block
        }
        fn block_ref(&self) -> &$crate::instance::Block {
            &self.block
        }
    };
}
pub(crate) use block;

/// The index in an array of registers of `count`, `stride` bytes apart from `base`, where `offset` is one of them.
pub(crate) fn index(offset: u32, base: u32, stride: u32, count: u32) -> Option<usize> {
    let past = offset.checked_sub(base)?;
    (past.is_multiple_of(stride) && past / stride < count).then_some((past / stride) as usize)
}
