//! The interconnect: it finds blocks by address and delivers the effects of one block to others.
//!
//! | module | covered | PS |
//! |---|---|---|
//! | `map` | peripheral IDs, bases and interrupts | 4.2 |
//! | `instances` | the modelled blocks, and the call of an instance by its ID | 4.2 |
//! | `access` | tasks (write 1, read 0), events (write 0 clears, 1 sets), SHORTS, INTEN | 6.1 |
//! | `acts` | the queue of effects, in order; PPI; EasyDMA to data RAM, byte by byte | 4.6, 6.16 |
//! | `outside` | levels, bytes and frames that cross the pins | 6.10, 6.25, 6.26, 6.31, 6.32, 6.34 |
//! | `power` | clock sources, System OFF, and what each kind of reset keeps | 5.3, 5.4 |
//!
//! | left out | why |
//! |---|---|
//! | the one PCLK16M cycle that a PPI channel takes | nothing needs such a resolution; the order of effects is kept |
//! | loss of a RAM section's contents by RAM\[n\].POWER while the part is on | these registers only store values |
//!
//! Every effect is an [`Act`] in one queue. If an event triggers, through PPI, the task that raises it again, the part
//! repeats the two for ever, once per clock cycle. Here the loop is cut after a number of turns, which is a finding.

#[macro_use]
mod instances;

mod access;
mod acts;
mod ctrl_ap;
mod map;
mod outside;
mod power;
#[cfg(test)]
mod tests;

use crate::clocks::{Clocks, Lfclk, Pclk16m};
use crate::gpio::Gpio;
use crate::gpiote::Gpiote;
use crate::instance::{Act, COMP, Cx, GPIO, Id, Instance, Outbox, Source, address_of};
use crate::memory::{FLASH_BYTES, Memory, RAM_BASE, RAM_BYTES, identification};
use crate::memory::{Place, place};
use crate::pin::Pin;
use crate::serial::Serial;
use crate::{Settings, SpisEvent, SpisWires, WatchdogReset};
use cortex_m4::{Access, BusError, Purpose, Signals, Width};
pub use ctrl_ap::CtrlRequest;
use emulator_part::{
    Cycle, FindingKind, I2cAnswer, I2cEvent, NEVER, Outside, Reset, SpiFrame, SpiMode, Supplied, UartFrame,
};
use instances::*;
use map::*;

pub(crate) const INTERRUPT_LINES: u16 = 48;

const BY_LPCOMP: &str = "LPCOMP";

#[derive(Clone, Debug)]
pub(crate) struct Soc {
    pub(crate) settings: Settings,
    pub(crate) memory: Memory,
    clocks: Clocks,
    lf_synthesised: bool,
    pub(crate) gpio: Gpio,
    parts: Parts,
    pub(crate) out: Outbox,
    /// The latest cycle at which anything has happened in the part.
    pub(crate) now: Cycle,
    pub(crate) signals: Signals,
    /// The instances that were called, as bits. Their interrupt lines and the cycles of their next events must still be
    /// updated.
    touched: u64,
    /// The instances, as bits, that have an event due at some time.
    scheduled: u64,
    nexts: [Cycle; 64],
    /// The earliest cycle at which an event is due.
    pub(crate) next: Cycle,
    pub(crate) moving: u64,
    met_dma: Cycle,
    pub(crate) spis_events: Vec<(Cycle, usize, SpisEvent)>,
    /// For each [`SpisEvent::Ready`], its cycle and the data that a transaction would read.
    pub(crate) spis_offers: Vec<(Cycle, Vec<u8>)>,
    pub(crate) watchdog_resets: Vec<WatchdogReset>,
    pub(crate) spis_wires: Option<SpisWires>,
    restarting: Option<Reset>,
    /// Whether the part waits for its restart. If so, nothing happens in it.
    halted: bool,
    off: bool,
    held: bool,
    pub(crate) access: ctrl_ap::Access,
}

impl Soc {
    pub(crate) fn new(settings: Settings) -> Self {
        let mut soc = Self {
            memory: Memory::new(&settings),
            clocks: Clocks { hf: Pclk16m, hf_ppb: settings.hfint_ppb, lf: None },
            lf_synthesised: false,
            gpio: Gpio::default(),
            parts: Parts::new(&settings),
            out: Outbox::default(),
            now: 0,
            signals: Signals::default(),
            touched: INSTANCES,
            scheduled: 0,
            nexts: [NEVER; 64],
            next: NEVER,
            moving: 0,
            met_dma: 0,
            spis_events: Vec::new(),
            spis_offers: Vec::new(),
            watchdog_resets: Vec::new(),
            spis_wires: None,
            restarting: None,
            halted: false,
            off: false,
            held: false,
            access: ctrl_ap::Access::default(),
            settings,
        };
        soc.look_at_touched();
        soc
    }

    pub(crate) fn hf_ppb(&self) -> i64 {
        self.clocks.hf_ppb
    }

    pub(crate) fn take_reset(&mut self) -> Option<Reset> {
        self.restarting.take()
    }

    fn find(&mut self, kind: FindingKind, place: &'static str, what: &'static str, value: u32) {
        self.out.find(self.now, kind, place, what, value);
    }
}
