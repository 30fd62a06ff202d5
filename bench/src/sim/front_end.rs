//! The ST25R3916 on a board: the chip's model on the SPI bus of a rigless part.
//!
//! The chip hangs on the part's bus as a [`rigless::chip::spi::Peer`], and the board, the air and the trace reach it
//! too, so it is shared. Only one thread reaches a chip at a time, its board's or, between two steps of the run, the
//! caller's: the lock is never waited for, and handing the board over orders the rest.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};

use rigless::chip::{Timeline, spi};
use rigless::snapshot::Store;
use st25r3916_model::Chip;

/// Transmit with CRC, the command that sends a frame (DS13541, Direct commands).
const TRANSMIT: u8 = 0xC4;

/// A byte that crossed between the part and the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crossing {
    /// Chip select fell (`true`) or rose.
    Select(bool),
    /// Controller to chip, chip to controller; the eighth clock ended at the crossing's instant.
    Byte(u8, u8),
    /// The interrupt output rose (`true`) or fell. It falls inside the byte that clears it, which is noted at its end.
    Irq(bool),
}

#[derive(Debug)]
struct Shared {
    chip: Chip,
    /// The chip was last called at this instant.
    now: u64,
    /// What crossed, while somebody wants to know.
    crossings: Option<Vec<(u64, Crossing)>>,
    /// The first byte since chip select fell.
    first_byte: Option<u8>,
    /// When chip select rose after a transmit command.
    transmits: Vec<u64>,
}

/// The chip, and beside it what the scheduler asks after every access and at every stop: asking takes no lock.
#[derive(Debug)]
struct Place {
    shared: Mutex<Shared>,
    /// Up to here the board has looked at the chip; the chip itself hears of it when it is next called.
    reached: AtomicU64,
    next: AtomicU64,
    irq: AtomicBool,
    air: AtomicBool,
}

/// A handle on the chip; clones are the same chip.
#[derive(Clone, Debug)]
pub struct FrontEnd(Arc<Place>);

impl FrontEnd {
    /// A chip, powered from the start of the run. `watched` keeps what crosses the bus for
    /// [`FrontEnd::take_crossings`].
    #[must_use]
    pub fn new(chip: Chip, watched: bool) -> Self {
        let front_end = Self(Arc::new(Place {
            shared: Mutex::new(Shared {
                chip,
                now: 0,
                crossings: watched.then(Vec::new),
                first_byte: None,
                transmits: vec![],
            }),
            reached: AtomicU64::new(0),
            next: AtomicU64::new(u64::MAX),
            irq: AtomicBool::new(false),
            air: AtomicBool::new(false),
        }));
        front_end.call(|_| {});
        front_end
    }

    fn call<T>(&self, act: impl FnOnce(&mut Shared) -> T) -> T {
        let place = &*self.0;
        // A panic in another holder ends the run anyway.
        let mut shared = place.shared.lock().unwrap_or_else(PoisonError::into_inner);
        shared.now = shared.now.max(place.reached.load(Relaxed));
        let now = shared.now;
        shared.chip.advance(now);
        let answer = act(&mut shared);
        // The pin falls inside the byte that clears it, so an edge may lie before this call's instant.
        let edges: Vec<_> = shared.chip.take_irq_edges().collect();
        for edge in edges {
            shared.note(edge.at_ns, Crossing::Irq(edge.level));
        }
        let irq = shared.chip.irq();
        place.next.store(shared.chip.next_event().unwrap_or(u64::MAX), Relaxed);
        place.irq.store(irq, Relaxed);
        place.air.store(shared.chip.has_air(), Relaxed);
        answer
    }

    /// Looks at or acts on the chip.
    pub fn with<T>(&self, act: impl FnOnce(&mut Chip) -> T) -> T {
        self.call(|shared| act(&mut shared.chip))
    }

    /// Lets the chip act up to `at` (ns) and answers the level of its interrupt output there.
    #[must_use]
    pub fn irq_at(&self, at: u64) -> bool {
        self.0.reached.fetch_max(at, Relaxed);
        if at >= self.0.next.load(Relaxed) {
            self.call(|_| {});
        }
        self.0.irq.load(Relaxed)
    }

    /// Whether the chip has emitted something that was not taken.
    #[must_use]
    pub fn has_air(&self) -> bool {
        self.0.air.load(Relaxed)
    }

    /// When the chip next acts by itself, ns.
    #[must_use]
    pub fn next_event(&self) -> u64 {
        self.0.next.load(Relaxed)
    }

    /// The transmit commands since the last call: each the instant chip select rose after its byte, ns. The chip acts
    /// on a command from there on, so this is the last instant that the firmware answers for.
    #[must_use]
    pub fn take_transmits(&self) -> Vec<u64> {
        self.call(|shared| std::mem::take(&mut shared.transmits))
    }

    /// What crossed the bus since the last call; nothing unless watched.
    #[must_use]
    pub fn take_crossings(&self) -> Vec<(u64, Crossing)> {
        self.call(|shared| shared.crossings.as_mut().map(std::mem::take).unwrap_or_default())
    }
}

impl Shared {
    /// Something crosses at `at`.
    fn note(&mut self, at: u64, crossing: Crossing) {
        self.now = self.now.max(at);
        match crossing {
            Crossing::Select(true) => self.first_byte = None,
            Crossing::Select(false) if self.first_byte == Some(TRANSMIT) => self.transmits.push(at),
            Crossing::Byte(mosi, _) => {
                self.first_byte.get_or_insert(mosi);
            }
            Crossing::Select(false) | Crossing::Irq(_) => {}
        }
        if let Some(crossings) = &mut self.crossings {
            crossings.push((at, crossing));
        }
    }
}

/// A run starts from its images and seed alone; there are no snapshots.
impl Store for FrontEnd {}

impl spi::Peer for FrontEnd {
    fn transfer(&mut self, mosi: u32, _bits: u8, context: &mut Timeline<'_, '_>) -> u32 {
        let at = context.now().0;
        // The chip's word is a byte, whatever the controller's frame format.
        let mosi = (mosi & 0xFF) as u8;
        self.call(|shared| {
            let miso = shared.chip.transfer(at, mosi);
            shared.note(at, Crossing::Byte(mosi, miso));
            u32::from(miso)
        })
    }

    fn select(&mut self, context: &mut Timeline<'_, '_>) {
        let at = context.now().0;
        self.call(|shared| {
            shared.chip.select(at);
            shared.note(at, Crossing::Select(true));
        });
    }

    fn deselect(&mut self, context: &mut Timeline<'_, '_>) {
        let at = context.now().0;
        self.call(|shared| {
            shared.chip.deselect(at);
            shared.note(at, Crossing::Select(false));
        });
    }
}
