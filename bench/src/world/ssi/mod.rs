//! The synchronous serial interface on the flight controller's side (docs/design.md#ssi).
//!
//! [`SsiPort`] has the actions of a flight controller on the DPR's pins. [`SsiMaster`] carries out an [`Order`] with
//! them: chip select falls, the set-up time passes, the bytes are clocked without a gap, the hold time passes, and chip
//! select rises. The instants follow the flight controller's own [`Crystal`]. Every SSI transaction of the bench is
//! carried out in this way, also those of misuses and tests.
//!
//! Up to 16 bytes are transferred to the DPR's model together, at the instant of the last one. EasyDMA therefore
//! accesses the DPR's memory up to 16 µs late. Events are in time, because a group of bytes ends with a byte that
//! raises an event ([`SsiPort::quiet`]).
//!
//! An action on a pin takes effect at the DPR's next instruction boundary. This does not delay later actions. The
//! instants in a [`Transaction`] are those at the pin.

use cortex_m4::Cost;
use emulator_part::SpiMode;
use profile::ssi::timing;

use crate::boards::{Dpr, SSI};
use crate::faults::Rng;
use emulator_node::Node;

/// The most bytes that are transferred to the DPR's model together.
const RUN: usize = 16;

/// The greatest number of bytes of a transaction that are kept. Further bytes are only counted.
pub const KEPT: usize = 16_384;

/// The actions of a flight controller on the pins of the DPR's SSI.
pub trait SsiPort {
    /// The instant that the DPR has reached, ns.
    fn now(&self) -> u64;

    /// Makes chip select fall now.
    fn select(&mut self);

    /// Clocks the bytes of `mosi` without a gap and returns the bytes on MISO, which reads ones while the DPR does not
    /// drive it. The last edge of the first byte was at `first`, that of the last byte at `last` (ns).
    fn exchange(&mut self, first: u64, last: u64, mosi: &[u8], mode: SpiMode) -> Vec<u8>;

    /// Makes chip select rise now.
    fn deselect(&mut self);

    /// Returns how many bytes can be clocked before the DPR's SPIS raises an event; `usize::MAX` if it raises none.
    fn quiet(&self) -> usize;
}

impl<C: Cost> SsiPort for Node<Dpr, C> {
    fn now(&self) -> u64 {
        Node::now(self)
    }

    fn select(&mut self) {
        self.input(|part, view, at| part.spis_select(at, SSI.csn, view));
    }

    fn exchange(&mut self, first: u64, last: u64, mosi: &[u8], mode: SpiMode) -> Vec<u8> {
        let (first, last) = (self.cycle_at(first), self.cycle_at(last));
        let gaps = mosi.len().saturating_sub(1).max(1) as u64;
        let mut miso = vec![0xFF; mosi.len()];
        self.input(|part, view, _| {
            part.spis_exchange(first, ((last - first) << 16) / gaps, mode, mosi, &mut miso, view);
        });
        miso
    }

    fn deselect(&mut self) {
        self.input(|part, view, at| part.spis_deselect(at, SSI.csn, view));
    }

    fn quiet(&self) -> usize {
        self.part().spis_quiet()
    }
}

/// The clock of a flight controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Crystal {
    /// The crystal's error, parts per billion; positive values are fast.
    pub ppb: i64,
}

impl Crystal {
    /// Converts a duration of `own_ns` by this clock to the bench's time, ns.
    ///
    /// # Panics
    ///
    /// Panics if the crystal stands still (an error of -100 %).
    #[must_use]
    pub const fn by_the_bench(self, own_ns: u64) -> u64 {
        const BILLION: u64 = 1_000_000_000;
        let rate = BILLION.checked_add_signed(self.ppb).expect("a crystal that swings");
        // The duration is divided in two, so that each product fits into 64 bits.
        own_ns / rate * BILLION + (own_ns % rate * BILLION + rate / 2) / rate
    }

    /// Converts a duration of `bench_ns` in the bench's time to this clock, ns.
    #[must_use]
    pub const fn own_ns(self, bench_ns: u64) -> u64 {
        const BILLION: i64 = 1_000_000_000;
        let drift = bench_ns as i64 / BILLION * self.ppb + bench_ns as i64 % BILLION * self.ppb / BILLION;
        bench_ns.saturating_add_signed(drift)
    }
}

/// The beginning of a transaction: a time by the flight controller's clock after an instant in the bench's time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Start {
    /// The instant in the bench's time to which [`Self::own_ns`] is added, ns.
    pub bench_ns: u64,
    /// The time by the flight controller's clock that is added to [`Self::bench_ns`], ns.
    pub own_ns: u64,
}

impl Start {
    /// Returns the instant in the bench's time, ns, that is `own_ns` by `crystal` later than this one.
    #[must_use]
    pub const fn and(self, own_ns: u64, crystal: Crystal) -> u64 {
        self.bench_ns + crystal.by_the_bench(self.own_ns + own_ns)
    }
}

/// The times within a transaction, by the flight controller's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pace {
    /// The time from the fall of chip select to the first clock edge, ns; at least [`timing::CSN_SETUP_NS`].
    pub setup_ns: u64,
    /// The duration of a byte on the wire, 8 bits, ns.
    pub byte_ns: u64,
    /// The time from the last clock edge to the rise of chip select, ns; at least [`timing::CSN_HOLD_NS`].
    pub hold_ns: u64,
    /// The shortest time from a rise of chip select to its next fall, ns; at least [`timing::GAP_NS`].
    pub gap_ns: u64,
}

impl Pace {
    /// The fastest times that [`timing`] allows.
    pub const FASTEST: Self = Self {
        setup_ns: timing::CSN_SETUP_NS as u64,
        byte_ns: 8 * 1_000_000_000 / timing::MAX_CLOCK_HZ as u64,
        hold_ns: timing::CSN_HOLD_NS as u64,
        gap_ns: timing::GAP_NS as u64,
    };

    /// The time from the fall of chip select to its rise in a transaction of `bytes` bytes, ns.
    #[must_use]
    pub const fn transaction_ns(&self, bytes: usize) -> u64 {
        self.setup_ns + bytes as u64 * self.byte_ns + self.hold_ns
    }
}

/// The bytes on MOSI after the given ones.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Filler {
    /// This byte is repeated.
    Byte(u8),
    /// The bytes are noise.
    Noise(Rng),
}

/// A transaction that an [`SsiMaster`] is to carry out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    /// Whether chip select falls at the beginning. Otherwise the bytes are clocked while the DPR is not selected.
    pub selects: bool,
    /// Whether chip select rises after the last byte. Otherwise the DPR stays selected until [`SsiMaster::cut`] is
    /// called.
    pub lets_go: bool,
    /// The number of bytes that are clocked. [`Order::ENDLESS`] clocks until [`SsiMaster::cut`] is called.
    pub bytes: usize,
    /// The first bytes on MOSI.
    pub mosi: Vec<u8>,
    /// The bytes on MOSI after `mosi`.
    pub filler: Filler,
    /// Clock polarity and phase.
    pub mode: SpiMode,
    /// The pace of the transaction.
    pub pace: Pace,
}

impl Order {
    /// The number of bytes of a transaction that only [`SsiMaster::cut`] ends.
    pub const ENDLESS: usize = usize::MAX;

    /// Returns a transaction of `bytes` bytes without a request, as fast as docs/design.md#ssi allows.
    #[must_use]
    pub const fn read(bytes: usize) -> Self {
        Self {
            selects: true,
            lets_go: true,
            bytes,
            mosi: vec![],
            filler: Filler::Byte(0),
            mode: SpiMode::Mode0,
            pace: Pace::FASTEST,
        }
    }

    /// Returns the byte at `index` on MOSI. It must be called once for each byte, in order.
    fn mosi(&mut self, index: usize) -> u8 {
        match (self.mosi.get(index), &mut self.filler) {
            (Some(byte), _) => *byte,
            (None, Filler::Byte(byte)) => *byte,
            (None, Filler::Noise(noise)) => noise.byte(),
        }
    }
}

/// A finished transaction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Transaction {
    /// The instant at which chip select fell at the DPR's pin, ns.
    pub selected_ns: u64,
    /// The instant at which chip select rose at the DPR's pin, ns.
    pub deselected_ns: u64,
    /// The number of bytes that were clocked.
    pub bytes: usize,
    /// The first [`KEPT`] bytes on MOSI.
    pub mosi: Vec<u8>,
    /// The first [`KEPT`] bytes on MISO.
    pub miso: Vec<u8>,
}

/// A group of bytes that were transferred together without a gap.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// The instant of the first byte's last clock edge, ns.
    first: Start,
    crystal: Crystal,
    byte_ns: u64,
    /// The bytes on MOSI.
    pub mosi: Vec<u8>,
    /// The bytes on MISO at the DPR's pin.
    pub miso: Vec<u8>,
}

impl Run {
    /// The instant of the last clock edge of the byte at `index`, ns.
    #[must_use]
    pub const fn edge(&self, index: usize) -> u64 {
        self.first.and(index as u64 * self.byte_ns, self.crystal)
    }

    /// Returns the bytes in order, each with the instant of its last clock edge (ns), the byte on MOSI, and the byte on
    /// MISO.
    pub fn bytes(&self) -> impl Iterator<Item = (u64, u8, u8)> {
        let crossed = self.mosi.iter().zip(&self.miso).enumerate();
        crossed.map(|(index, (mosi, miso))| (self.edge(index), *mosi, *miso))
    }
}

/// The result of an action of an [`SsiMaster`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Chip select fell at the DPR's pin, at this instant (ns).
    Selected(u64),
    /// These bytes were transferred.
    Clocked(Run),
    /// Chip select rose and ended this transaction.
    Over(Transaction),
}

#[derive(Clone, Debug)]
struct UnderWay {
    order: Order,
    start: Start,
    /// The instant at which chip select fell at the DPR's pin, ns; `None` before the fall.
    selected_ns: Option<u64>,
    done: usize,
    /// The number of bytes in the group that is being clocked.
    run: usize,
    /// The instant, ns, at which chip select rises, if the transaction is cut short.
    released: Option<u64>,
    mosi: Vec<u8>,
    miso: Vec<u8>,
}

/// Carries out transactions on the SSI, one after the other. The [module](self) describes how.
#[derive(Clone, Debug)]
pub struct SsiMaster {
    crystal: Crystal,
    under_way: Option<UnderWay>,
    free_ns: u64,
}

impl SsiMaster {
    /// Returns an [`SsiMaster`] without a transaction; its times follow `crystal`.
    #[must_use]
    pub const fn new(crystal: Crystal) -> Self {
        Self { crystal, under_way: None, free_ns: 0 }
    }

    /// Whether no transaction is under way or is due to begin.
    #[must_use]
    pub const fn is_idle(&self) -> bool {
        self.under_way.is_none()
    }

    /// Whether the next action is a transfer of bytes.
    #[must_use]
    pub fn is_clocking(&self) -> bool {
        self.under_way.as_ref().is_some_and(|it| it.run > 0)
    }

    /// Returns the earliest instant, ns, at which another transaction may begin; `u64::MAX` if the present one has no
    /// end.
    #[must_use]
    pub fn free_at(&self) -> u64 {
        let Some(it) = &self.under_way else { return self.free_ns };
        match it.released {
            Some(at) => at + self.crystal.by_the_bench(it.order.pace.gap_ns),
            None if it.order.bytes == Order::ENDLESS || !it.order.lets_go => u64::MAX,
            None => it.start.and(it.order.pace.transaction_ns(it.order.bytes) + it.order.pace.gap_ns, self.crystal),
        }
    }

    /// Orders a transaction that begins at `start`.
    ///
    /// # Panics
    ///
    /// Panics if a transaction is under way.
    pub fn begin(&mut self, start: Start, order: Order) {
        assert!(self.is_idle(), "a transaction is under way");
        let (mosi, miso) = (vec![], vec![]);
        self.under_way =
            Some(UnderWay { order, start, selected_ns: None, done: 0, run: 0, released: None, mosi, miso });
    }

    /// The instant of the next action, ns; `u64::MAX` if there is none.
    #[must_use]
    pub fn next_at(&self) -> u64 {
        let Some(it) = &self.under_way else { return u64::MAX };
        let Order { pace, bytes, lets_go, .. } = &it.order;
        match it {
            UnderWay { selected_ns: None, .. } => it.start.and(0, self.crystal),
            UnderWay { run, done, .. } if *run > 0 => self.clocked(it, done + run),
            UnderWay { released: Some(at), .. } => *at,
            _ if *lets_go => it.start.and(pace.transaction_ns(*bytes), self.crystal),
            _ => u64::MAX,
        }
    }

    /// Carries out the due action, and returns its result. Clocks without chip select belong to no transaction and are
    /// not returned.
    ///
    /// # Panics
    ///
    /// Panics if no transaction is under way.
    pub fn act(&mut self, port: &mut impl SsiPort) -> Option<Progress> {
        let mut it = self.under_way.take().expect("a transaction is under way");
        if it.selected_ns.is_none() {
            let now = port.now();
            if it.order.selects {
                port.select();
            }
            it.selected_ns = Some(now);
            let told = it.order.selects.then_some(Progress::Selected(now));
            self.under_way = Some(planned(it, port));
            return told;
        }
        if it.run > 0 {
            let run = self.exchange(&mut it, port);
            let told = it.order.selects.then_some(Progress::Clocked(run));
            self.under_way = Some(planned(it, port));
            return told;
        }
        self.under_way = Some(it);
        self.free_ns = self.free_at();
        let it = self.under_way.take()?;
        if !it.order.selects {
            return None;
        }
        let deselected_ns = port.now();
        port.deselect();
        Some(Progress::Over(Transaction {
            selected_ns: it.selected_ns?,
            deselected_ns,
            bytes: it.done,
            mosi: it.mosi,
            miso: it.miso,
        }))
    }

    /// Ends the transaction after the byte that is under way at `at` (ns) and the hold time. A transaction that has not
    /// begun is dropped.
    pub fn cut(&mut self, at: u64) {
        let Some(mut it) = self.under_way.take().filter(|it| it.selected_ns.is_some()) else { return };
        let end = it.done + it.run;
        let bytes = (it.done..end).find(|done| self.clocked(&it, *done) >= at).unwrap_or(end);
        it.run = bytes - it.done;
        it.order.bytes = bytes;
        let hold = self.crystal.by_the_bench(it.order.pace.hold_ns);
        // If no byte has been clocked, the transaction is still in its set-up time.
        let last = if bytes == 0 { at } else { self.clocked(&it, bytes).max(at) };
        it.released = Some(last + hold);
        self.under_way = Some(it);
    }

    /// Returns the instant, ns, of the last clock edge of byte number `bytes`, counted from 1.
    fn clocked(&self, it: &UnderWay, bytes: usize) -> u64 {
        it.start.and(it.order.pace.setup_ns + bytes as u64 * it.order.pace.byte_ns, self.crystal)
    }

    fn exchange(&self, it: &mut UnderWay, port: &mut impl SsiPort) -> Run {
        let count = std::mem::take(&mut it.run);
        let pace = it.order.pace;
        let own_ns = it.start.own_ns + pace.setup_ns + (it.done as u64 + 1) * pace.byte_ns;
        let first = Start { own_ns, ..it.start };
        let (first_ns, last_ns) = (first.and(0, self.crystal), self.clocked(it, it.done + count));
        let mosi: Vec<u8> = (it.done..it.done + count).map(|index| it.order.mosi(index)).collect();
        let miso = port.exchange(first_ns, last_ns, &mosi, it.order.mode);
        it.done += count;
        let kept = count.min(KEPT - it.mosi.len());
        it.mosi.extend(&mosi[..kept]);
        it.miso.extend(&miso[..kept]);
        Run { first, crystal: self.crystal, byte_ns: pace.byte_ns, mosi, miso }
    }
}

/// Sets the number of bytes that are transferred together next.
fn planned(mut it: UnderWay, port: &impl SsiPort) -> UnderWay {
    it.run = (it.order.bytes - it.done).min(RUN).min(port.quiet().max(1));
    it
}

#[cfg(test)]
pub(super) mod mock;
#[cfg(test)]
mod tests;
