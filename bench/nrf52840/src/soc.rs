//! The interconnect: which block is where, and what carries the effect of one to another.
//!
//! | covered | PS |
//! |---|---|
//! | peripheral IDs, bases and interrupts | 4.2 |
//! | tasks (write 1, read 0), events (write 0 clears, 1 sets), SHORTS, INTEN | 6.1 |
//! | EasyDMA to data RAM, byte by byte | 4.6 |
//! | what each source of reset leaves as it was | 5.3 |
//! | System OFF | 5.3 |
//!
//! | left out | why |
//! |---|---|
//! | the one PCLK16M cycle that a PPI channel takes | below the resolution anything here is asked for; order is kept |
//! | RAM\[n\].POWER taking a section's contents while the part is on | registers only |
//!
//! Everything that happens is an [`Act`] in one queue, carried out in order. An event that triggers, through PPI, the
//! task that raises it again never ends on the part, one turn per clock cycle; here it is cut after [`LOOP_LIMIT`]
//! turns and reported.
use crate::analog::{Comparator, Saadc};
use crate::ccm::Ccm;
use crate::clock_power::ClockPower;
use crate::clocks::{Clocks, Lfclk, Pclk16m};
use crate::ecb::Ecb;
use crate::egu::Egu;
use crate::gpio::Gpio;
use crate::gpiote::Gpiote;
use crate::instance::{Act, Cx, Id, Instance, Outbox, Source, address_of};
use crate::memory::{FLASH_BYTES, Memory, RAM_BASE, RAM_BYTES, identification};
use crate::memory::{Place, place};
use crate::nvmc::Nvmc;
use crate::pin::Pin;
use crate::ppi::Ppi;
use crate::pwm::Pwm;
use crate::qdec::Qdec;
use crate::registers as r;
use crate::registers::Register;
use crate::rng::Rng;
use crate::rtc::Rtc;
use crate::serial::Serial;
use crate::temp::Temp;
use crate::timer::Timer;
use crate::uarte::Uarte;
use crate::wdt::Wdt;
use crate::{Settings, SpisEvent, SsiWires, WatchdogReset};
use bench_seam::{Cycle, FindingKind, I2cAnswer, I2cEvent, NEVER, Outside, Reset, SpiFrame, SpiMode, UartFrame};
use cortex_m4::{Access, BusError, Purpose, Signals, Width};

/// P0 and P1, which have no ID of their own.
pub(crate) const GPIO: Id = 0x30;
const PPI: Id = 0x1F;
const NVMC: Id = 0x1E;
const GPIOTE: Id = 0x06;
const SAADC: Id = 0x07;
const WDT: Id = 0x10;
pub(crate) const COMP: Id = 0x13;
const CLOCK_POWER: Id = 0x00;
/// Interrupt lines of the NVIC.
pub(crate) const INTERRUPT_LINES: u16 = 48;

/// Acts that one access or one instant may set off before something must be going round in circles.
const LOOP_LIMIT: u32 = 100_000;

/// What ended System OFF where it was not a pin's DETECT.
const BY_LPCOMP: &str = "LPCOMP";

/// What RAM holds that was not retained through System OFF.
const LOST: u8 = 0xA5;

/// One block of the part.
#[derive(Debug)]
struct BlockSpec {
    id: Id,
    name: &'static str,
    registers: &'static [Register],
    modelled: bool,
}

const fn at(id: Id, name: &'static str, registers: &'static [Register], modelled: bool) -> BlockSpec {
    BlockSpec { id, name, registers, modelled }
}

/// Every block, by address (PS 4.2, *Instantiation*).
static BLOCKS: [BlockSpec; 44] = [
    at(0x00, "CLOCK/POWER", r::CLOCK_POWER, true),
    at(0x01, "RADIO", r::RADIO, false),
    at(0x02, "UARTE0", r::UART, true),
    at(0x03, "SPIM0/SPIS0", r::SERIAL, true),
    at(0x04, "SPIM1/SPIS1", r::SERIAL, true),
    at(0x05, "NFCT", r::NFCT, false),
    at(0x06, "GPIOTE", r::GPIOTE, true),
    at(0x07, "SAADC", r::SAADC, true),
    at(0x08, "TIMER0", r::TIMER, true),
    at(0x09, "TIMER1", r::TIMER, true),
    at(0x0A, "TIMER2", r::TIMER, true),
    at(0x0B, "RTC0", r::RTC, true),
    at(0x0C, "TEMP", r::TEMP, true),
    at(0x0D, "RNG", r::RNG, true),
    at(0x0E, "ECB", r::ECB, true),
    at(0x0F, "CCM/AAR", r::CCM_AAR, true),
    at(0x10, "WDT", r::WDT, true),
    at(0x11, "RTC1", r::RTC, true),
    at(0x12, "QDEC", r::QDEC, true),
    at(0x13, "COMP/LPCOMP", r::COMP_LPCOMP, true),
    at(0x14, "EGU0", r::EGU, true),
    at(0x15, "EGU1", r::EGU, true),
    at(0x16, "EGU2", r::EGU, true),
    at(0x17, "EGU3", r::EGU, true),
    at(0x18, "EGU4", r::EGU, true),
    at(0x19, "EGU5", r::EGU, true),
    at(0x1A, "TIMER3", r::TIMER_WIDE, true),
    at(0x1B, "TIMER4", r::TIMER_WIDE, true),
    at(0x1C, "PWM0", r::PWM, true),
    at(0x1D, "PDM", r::PDM, false),
    at(0x1E, "NVMC", r::NVMC_ACL, true),
    at(0x1F, "PPI", r::PPI, true),
    at(0x20, "MWU", r::MWU, false),
    at(0x21, "PWM1", r::PWM, true),
    at(0x22, "PWM2", r::PWM, true),
    at(0x23, "SPIM2/SPIS2", r::SERIAL, true),
    at(0x24, "RTC2", r::RTC, true),
    at(0x25, "I2S", r::I2S, false),
    at(0x27, "USBD", r::USBD, false),
    at(0x28, "UARTE1", r::UART, true),
    at(0x29, "QSPI", r::QSPI, false),
    at(0x2D, "PWM3", r::PWM, true),
    at(0x2F, "SPIM3", r::SPIM3, true),
    at(GPIO, "GPIO", r::GPIO, true),
];

/// Where the CryptoCell is, of which nothing is modelled.
const CRYPTOCELL: std::ops::Range<u32> = 0x5002_A000..0x5002_C000;

/// Registers that the workarounds of anomalies 166, 171 and 187 of USBD write, and no table lists.
const USBD_TEST: std::ops::Range<u32> = 0x4006_E000..0x4006_F000;

/// Blocks past those with an ID, of which nothing is modelled.
fn unmodelled_at(address: u32) -> Option<(&'static str, u32)> {
    match address {
        _ if CRYPTOCELL.contains(&address) => Some(("CRYPTOCELL", address - CRYPTOCELL.start)),
        _ if USBD_TEST.contains(&address) => Some(("USBD", address)),
        _ => None,
    }
}

/// Where in [`BLOCKS`] each ID is.
static PLACES: [u8; 64] = {
    let mut places = [u8::MAX; 64];
    let mut n = 0;
    while n < BLOCKS.len() {
        places[BLOCKS[n].id] = n as u8;
        n += 1;
    }
    places
};

/// The name of each ID.
static NAMES: [&str; 64] = {
    let mut names = ["?"; 64];
    let mut n = 0;
    while n < BLOCKS.len() {
        names[BLOCKS[n].id] = BLOCKS[n].name;
        n += 1;
    }
    names
};

/// A bit for each word of each block that holds a register; and for each that is writable.
static REGISTERS: [[[u64; 16]; 2]; BLOCKS.len()] = {
    let mut maps = [[[0; 16]; 2]; BLOCKS.len()];
    let mut block = 0;
    while block < BLOCKS.len() {
        let registers = BLOCKS[block].registers;
        let mut n = 0;
        while n < registers.len() {
            let word = registers[n].offset as usize / 4;
            maps[block][0][word / 64] |= 1 << (word % 64);
            if registers[n].writable {
                maps[block][1][word / 64] |= 1 << (word % 64);
            }
            n += 1;
        }
        block += 1;
    }
    maps
};

/// The block of a peripheral ID.
#[inline]
fn spec(id: Id) -> Option<(usize, &'static BlockSpec)> {
    let n = usize::from(PLACES[id]);
    BLOCKS.get(n).map(|block| (n, block))
}

#[inline]
fn name_of(id: Id) -> &'static str {
    NAMES[id & 63]
}

/// The block an address is in.
#[inline]
fn block_at(address: u32) -> Option<(Id, usize, &'static BlockSpec)> {
    let id = match address {
        0x4000_0000..0x4003_0000 => (address >> 12 & 0x3F) as Id,
        0x5000_0000..0x5000_1000 => GPIO,
        _ => return None,
    };
    spec(id).map(|(n, block)| (id, n, block))
}

/// Everything inside the part but the core.
#[derive(Clone, Debug)]
pub(crate) struct Soc {
    pub(crate) settings: Settings,
    pub(crate) memory: Memory,
    clocks: Clocks,
    /// LFCLK comes from HFCLK.
    lf_synthesised: bool,
    pub(crate) gpio: Gpio,
    parts: Parts,
    pub(crate) out: Outbox,
    /// The latest cycle that anything happened at.
    pub(crate) now: Cycle,
    pub(crate) signals: Signals,
    /// Instances called since their interrupt lines and next cycles were last looked at.
    touched: u64,
    /// Instances that have a next cycle, and which: [`NEVER`] for none.
    scheduled: u64,
    nexts: [Cycle; 64],
    /// The least of them.
    pub(crate) next: Cycle,
    /// Instances that EasyDMA works for.
    pub(crate) moving: u64,
    pub(crate) spis_events: Vec<(Cycle, usize, SpisEvent)>,
    pub(crate) watchdog_resets: Vec<WatchdogReset>,
    pub(crate) ssi: Option<SsiWires>,
    restarting: Option<Reset>,
    /// The part waits for its restart, or is in System OFF: nothing happens in it.
    halted: bool,
    off: bool,
}

/// The instances but GPIO, which everyone's pins go through.
#[derive(Clone, Debug)]
struct Parts {
    clock_power: ClockPower,
    uarte: [Uarte; 2],
    serial: [Serial; 4],
    gpiote: Gpiote,
    saadc: Saadc,
    timer: [Timer; 5],
    rtc: [Rtc; 3],
    temp: Temp,
    rng: Rng,
    ecb: Ecb,
    ccm: Ccm,
    wdt: Wdt,
    qdec: Qdec,
    comparator: Comparator,
    egu: [Egu; 6],
    pwm: [Pwm; 4],
    nvmc: Nvmc,
    ppi: Ppi,
}

impl Parts {
    fn new(settings: &Settings) -> Self {
        Self {
            clock_power: ClockPower::new(settings),
            uarte: Default::default(),
            serial: [Serial::new(true), Serial::new(true), Serial::new(true), Serial::new(false)],
            gpiote: Gpiote::default(),
            saadc: Saadc::new(settings.supply_microvolts),
            timer: [Timer::new(4), Timer::new(4), Timer::new(4), Timer::new(6), Timer::new(6)],
            rtc: [Rtc::new(3), Rtc::new(4), Rtc::new(4)],
            temp: Temp::new(settings.temperature_quarters),
            rng: Rng::new(settings.seed),
            ecb: Ecb::default(),
            ccm: Ccm::default(),
            wdt: Wdt::default(),
            qdec: Qdec::default(),
            comparator: Comparator::new(settings.supply_microvolts),
            egu: Default::default(),
            pwm: Default::default(),
            nvmc: Nvmc::default(),
            ppi: Ppi::default(),
        }
    }
}

/// Evaluates `$call` with the instance that `$id` is, each with its own type; `None` for an ID that is not modelled.
macro_rules! instance {
    ($parts:expr, $id:expr, $instance:ident => $call:expr) => {{
        macro_rules! on {
            ($field:expr) => {{
                let $instance = &mut $field;
                Some($call)
            }};
        }
        match $id {
            0x00 => on!($parts.clock_power),
            0x02 => on!($parts.uarte[0]),
            0x28 => on!($parts.uarte[1]),
            0x03 | 0x04 => on!($parts.serial[$id - 0x03]),
            0x23 => on!($parts.serial[2]),
            0x2F => on!($parts.serial[3]),
            0x06 => on!($parts.gpiote),
            0x07 => on!($parts.saadc),
            0x08..=0x0A => on!($parts.timer[$id - 0x08]),
            0x1A | 0x1B => on!($parts.timer[$id - 0x1A + 3]),
            0x0B => on!($parts.rtc[0]),
            0x11 => on!($parts.rtc[1]),
            0x24 => on!($parts.rtc[2]),
            0x0C => on!($parts.temp),
            0x0D => on!($parts.rng),
            0x0E => on!($parts.ecb),
            0x0F => on!($parts.ccm),
            0x10 => on!($parts.wdt),
            0x12 => on!($parts.qdec),
            0x13 => on!($parts.comparator),
            0x14..=0x19 => on!($parts.egu[$id - 0x14]),
            0x1C => on!($parts.pwm[0]),
            0x21 | 0x22 => on!($parts.pwm[$id - 0x20]),
            0x2D => on!($parts.pwm[3]),
            0x1E => on!($parts.nvmc),
            0x1F => on!($parts.ppi),
            _ => None,
        }
    }};
}

/// Calls an instance with what it may reach.
macro_rules! call {
    ($soc:expr, $id:expr, $instance:ident, $cx:ident => $call:expr) => {{
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = &mut *$soc;
        *touched |= 1 << $id;
        let $cx = &mut Cx { now: *now, clocks, memory, pins: gpio, out, id: $id, name: name_of($id) };
        instance!(parts, $id, $instance => $call)
    }};
}

/// The IDs that [`Parts`] holds.
const INSTANCES: u64 = {
    let mut set = 0;
    let mut n = 0;
    while n < BLOCKS.len() {
        if BLOCKS[n].modelled && BLOCKS[n].id != GPIO {
            set |= 1 << BLOCKS[n].id;
        }
        n += 1;
    }
    set
};

/// The set bits of `set`, lowest first.
#[inline]
fn ids(mut set: u64) -> impl Iterator<Item = Id> {
    std::iter::from_fn(move || {
        let id = set.trailing_zeros() as Id;
        (set != 0).then(|| {
            set &= set - 1;
            id
        })
    })
}

/// The serial blocks that may be an SPIS.
const SPIS_IDS: [Id; 3] = [0x03, 0x04, 0x23];

/// The UARTEs.
const UARTE_IDS: [Id; 2] = [0x02, 0x28];

/// The number of a serial block.
#[inline]
fn serial_number(id: Id) -> usize {
    match id {
        0x03 => 0,
        0x04 => 1,
        0x23 => 2,
        _ => 3,
    }
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
            spis_events: Vec::new(),
            watchdog_resets: Vec::new(),
            ssi: None,
            restarting: None,
            halted: false,
            off: false,
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

    // ---- The core's accesses

    #[inline(never)]
    pub(crate) fn read<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError> {
        if let Some(place) = place(access.address) {
            let read = match place {
                Place::Flash(offset) => self.memory.flash.read(offset, access.width),
                Place::Ram(offset) => self.memory.ram.read(offset, access.width),
                Place::Ficr(offset) => self.memory.ficr.read(offset, access.width),
                Place::Uicr(offset) => self.memory.uicr.read(offset, access.width),
            };
            return read.ok_or(BusError);
        }
        self.take_up(access, outside);
        let word = access.address & !3;
        let value = self.read_word(word, access, outside).ok_or(BusError)?;
        Ok(match access.width {
            Width::Word => value,
            Width::Half => value >> (8 * (access.address & 2)) & 0xFFFF,
            Width::Byte => value >> (8 * (access.address & 3)) & 0xFF,
        })
    }

    #[inline(never)]
    pub(crate) fn write<O: Outside>(&mut self, access: &Access, value: u32, outside: &mut O) -> Result<(), BusError> {
        let address = access.address;
        if let Some(place) = place(address) {
            return match place {
                Place::Ram(offset) => self.memory.ram.write(offset, access.width, value).then_some(()).ok_or(BusError),
                Place::Ficr(offset) => {
                    self.take_up(access, outside);
                    self.find(FindingKind::Misuse, "FICR", "a write to read-only memory, at offset", offset);
                    Ok(())
                }
                Place::Flash(_) | Place::Uicr(_) => {
                    self.take_up(access, outside);
                    let word = access.width == Width::Word;
                    let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                    *touched |= 1 << NVMC;
                    let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: NVMC, name: "NVMC" };
                    let stored = parts.nvmc.store(address, word, value, &mut cx);
                    self.carry(outside);
                    stored.then_some(()).ok_or(BusError)
                }
            };
        }
        self.take_up(access, outside);
        let Some((id, n, block)) = block_at(address) else {
            if let Some((name, offset)) = unmodelled_at(address) {
                self.find(FindingKind::Unmodelled, name, NOT_MODELLED, offset);
                return Ok(());
            }
            self.find(FindingKind::Unmapped, "bus", "a write where the part has nothing, at", address);
            return Err(BusError);
        };
        let offset = address & 0xFFC;
        let (word, bit) = (offset as usize / 256, 1 << (offset / 4 % 64));
        let [present, writable] = &REGISTERS[n];
        if present[word] & bit == 0 {
            self.find(FindingKind::Undefined, block.name, "a write where no register is, at offset", offset);
        } else if !block.modelled {
            self.find(FindingKind::Unmodelled, block.name, NOT_MODELLED, offset);
        } else {
            if access.width != Width::Word {
                self.find(FindingKind::Misuse, block.name, "a write narrower than a word, at offset", offset);
            }
            if writable[word] & bit == 0 {
                self.find(FindingKind::Misuse, block.name, "a write to a read-only register, at offset", offset);
            } else {
                self.write_register(id, offset, value);
            }
        }
        self.carry(outside);
        Ok(())
    }

    /// Time and place of an access.
    #[inline]
    fn take_up<O: Outside>(&mut self, access: &Access, outside: &mut O) {
        if access.purpose == Purpose::Debugger {
            return;
        }
        if access.cycle >= self.next {
            self.advance(access.cycle, outside);
        }
        self.now = self.now.max(access.cycle);
        self.out.pc = Some(access.pc);
    }

    fn find(&mut self, kind: FindingKind, place: &'static str, what: &'static str, value: u32) {
        self.out.find(self.now, kind, place, what, value);
    }

    fn read_word<O: Outside>(&mut self, address: u32, access: &Access, outside: &mut O) -> Option<u32> {
        let real = access.purpose != Purpose::Debugger;
        let Some((id, n, block)) = block_at(address) else {
            if let Some((name, offset)) = unmodelled_at(address) {
                if real {
                    self.find(FindingKind::Unmodelled, name, NOT_MODELLED, offset);
                }
                return Some(0);
            }
            let identification = identification(address, &self.settings);
            if identification.is_none() && real {
                self.find(FindingKind::Unmapped, "bus", "a read where the part has nothing, at", address);
            }
            return identification;
        };
        let offset = address & 0xFFC;
        if REGISTERS[n][0][offset as usize / 256] >> (offset / 4 % 64) & 1 == 0 {
            if real {
                self.find(FindingKind::Undefined, block.name, "a read where no register is, at offset", offset);
            }
            return Some(0);
        }
        if !block.modelled {
            if real {
                self.find(FindingKind::Unmodelled, block.name, NOT_MODELLED, offset);
            }
            return Some(block.registers.iter().find(|register| register.offset == offset).map_or(0, |r| r.reset));
        }
        if id == GPIO {
            return Some(self.gpio.read(offset).unwrap_or(0));
        }
        let Self { parts, clocks, now, .. } = self;
        let read = instance!(parts, id, instance => {
            let block = instance.block_ref();
            match offset {
                0x000..0x100 => Some(0),
                0x100..0x180 => Some(block.events >> ((offset - 0x100) / 4) & 1),
                0x200 => Some(block.shorts),
                0x300 | 0x304 | 0x308 => Some(block.inten),
                _ => instance.read(offset, *now, clocks),
            }
        });
        // Only the legacy UART has a register that reading changes.
        if real && matches!((id, offset), (0x02 | 0x28, 0x518)) {
            call!(self, id, instance, cx => instance.was_read(offset, cx));
            self.carry(outside);
        }
        let Some(value) = read.flatten() else {
            if real {
                let name = register_name(block, offset);
                self.find(FindingKind::Unmodelled, block.name, name, offset);
            }
            return Some(0);
        };
        Some(value)
    }

    /// A write that there is a register for.
    fn write_register(&mut self, id: Id, offset: u32, value: u32) {
        if id == GPIO {
            let Self { gpio, out, now, .. } = self;
            gpio.write(offset, value, *now, out);
            return;
        }
        let known = call!(self, id, instance, cx => match offset {
            0x000..0x100 => value & 1 == 0 || instance.task(offset, cx),
            0x100..0x180 => {
                let bit = 1 << ((offset - 0x100) / 4);
                let block = instance.block();
                block.events = if value & 1 == 0 { block.events & !bit } else { block.events | bit };
                true
            }
            0x200 | 0x300 | 0x304 | 0x308 => {
                let block = instance.block();
                match offset {
                    0x200 => block.shorts = value,
                    0x300 => block.inten = value,
                    0x304 => block.inten |= value,
                    _ => block.inten &= !value,
                }
                instance.configured(cx);
                true
            }
            _ => instance.write(offset, value, cx),
        });
        if known != Some(true)
            && let Some((_, block)) = spec(id)
        {
            self.find(FindingKind::Unmodelled, block.name, register_name(block, offset), offset);
        }
    }

    // ---- Time

    /// Everything due up to and at `to` happens, in order.
    pub(crate) fn advance<O: Outside>(&mut self, to: Cycle, outside: &mut O) {
        while self.next <= to {
            self.now = self.now.max(self.next);
            self.out.pc = None;
            self.fire(outside);
            self.carry(outside);
        }
        self.now = self.now.max(to);
    }

    /// Everything due by now, by ID where more than one is.
    fn fire<O: Outside>(&mut self, outside: &mut O) {
        // In System OFF only LPCOMP is there.
        let there = if self.off { 1 << COMP } else { u64::MAX };
        let mut later = u64::MAX;
        loop {
            // One that something else called since may have become due as well.
            let left = (self.scheduled | self.touched) & later & there;
            if left == 0 {
                return;
            }
            let id = left.trailing_zeros() as Id;
            later = u64::MAX << id << 1;
            if self.nexts[id] > self.now && self.touched >> id & 1 == 0 {
                continue;
            }
            let Self { parts, now, .. } = self;
            let due = instance!(parts, id, instance => instance.next().is_some_and(|at| at <= *now));
            if due == Some(true) {
                call!(self, id, instance, cx => instance.due(cx));
                // Before the next instance: two that are due at one instant happen one after the other.
                self.drain(outside);
            }
        }
    }

    /// Carries everything out that is waiting, and takes up what moved.
    pub(crate) fn carry<O: Outside>(&mut self, outside: &mut O) {
        self.drain(outside);
        self.look_at_touched();
        if self.memory.code_changed {
            self.memory.code_changed = false;
            self.signals.code_changed = true;
        }
    }

    /// Carries out what is waiting, in order.
    #[inline]
    fn drain<O: Outside>(&mut self, outside: &mut O) {
        let mut turns = 0;
        while let Some(act) = self.out.acts.pop_front() {
            turns += 1;
            if turns > LOOP_LIMIT {
                self.find(FindingKind::Misuse, "PPI", "an event triggers itself without end; cut", LOOP_LIMIT);
                self.out.acts.clear();
                return;
            }
            self.perform(act, outside);
        }
    }

    /// Takes up the interrupt lines and the next cycles of the instances called since last asked: no other's can have
    /// moved.
    fn look_at_touched(&mut self) {
        if self.touched == 0 {
            return;
        }
        let (was_next, mut least_moved) = (self.next, false);
        for id in ids(std::mem::take(&mut self.touched) & INSTANCES) {
            let parts = &mut self.parts;
            let state = instance!(parts, id, instance => (instance.line(), instance.next(), instance.moves()));
            let Some((high, next, moves)) = state else { continue };
            let next = next.unwrap_or(NEVER);
            let was = std::mem::replace(&mut self.nexts[id], next);
            least_moved |= was == self.next && next > was;
            self.next = self.next.min(next);
            let bit = 1 << id;
            self.scheduled = if next == NEVER { self.scheduled & !bit } else { self.scheduled | bit };
            self.moving = if moves { self.moving | bit } else { self.moving & !bit };
            if id < usize::from(INTERRUPT_LINES) && (self.signals.lines[0] & bit != 0) != high {
                self.signals.lines[0] ^= bit;
                self.signals.changed = true;
            }
        }
        if least_moved {
            self.next = ids(self.scheduled).map(|id| self.nexts[id]).min().unwrap_or(NEVER);
        }
        if self.halted {
            let looks = self.off && self.restarting.is_none() && self.parts.comparator.looks_in_system_off();
            self.next = if looks { self.nexts[COMP] } else { NEVER };
        }
        if self.next != was_next {
            self.signals.changed = true;
        }
    }

    fn perform<O: Outside>(&mut self, act: Act, outside: &mut O) {
        match act {
            Act::Event(address) if self.off => {
                if self.parts.comparator.detects_by(address) {
                    self.request(Reset::Wakeup(BY_LPCOMP));
                }
            }
            Act::Event(address) => self.parts.ppi.route(address, &mut self.out.acts),
            Act::Task(address) => {
                let (id, offset) = ((address >> 12 & 0x3F) as Id, address & 0xFFF);
                let on_the_bus = address >> 18 == 0x4000_0000 >> 18;
                let done = on_the_bus
                    && offset < 0x100
                    && call!(self, id, instance, cx => instance.task(offset, cx)) == Some(true);
                if !done {
                    let what = "a channel triggers a task that is not modelled or none at all, at";
                    self.find(FindingKind::Unmodelled, "PPI", what, address);
                }
            }
            Act::Exchange { id, mosi, begins } => self.exchange(id, mosi, begins, outside),
            Act::Hold { pin, level } => self.gpio.hold(pin, level, self.now, &mut self.out),
            Act::Level { pin, level } => self.level(pin, level),
            Act::Pad { pin, pad } => outside.pin(self.now, pin.named(), pad),
            Act::Sample { channel } => {
                let Self { parts, gpio, .. } = self;
                parts.gpiote.sample(channel, |pin| gpio.input(pin));
            }
            Act::Detect if self.off => self.request(Reset::Wakeup("System OFF")),
            Act::Detect => self.with_gpiote(Gpiote::port),
            Act::TwoWire { id, event } => {
                let number = serial_number(id);
                let [scl, sda] = self.parts.serial[number].two_wire_pins();
                let wired = |pin: Option<Pin>| pin.filter(|&pin| self.gpio.is_connected(pin));
                let answer = match (wired(scl), wired(sda)) {
                    (Some(scl), Some(sda)) => outside.i2c(self.now, scl.named(), sda.named(), event),
                    _ => {
                        self.find(
                            FindingKind::Misuse,
                            name_of(id),
                            "SCL or SDA is no connected input, block",
                            id as u32,
                        );
                        I2cAnswer::NOBODY
                    }
                };
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.serial[number].two_wire_answer(answer, &mut cx);
            }
            Act::Sent { pin, frame } => outside.uart(self.now, pin.named(), &frame),
            Act::Convert => {
                let now = self.now;
                let volts = |pin: Pin| outside.microvolts(now, pin.named());
                let Soc { parts, clocks, out, touched, memory, gpio, .. } = self;
                *touched |= 1 << SAADC;
                let mut cx = Cx { now, clocks, memory, pins: gpio, out, id: SAADC, name: "SAADC" };
                parts.saadc.convert(volts, &mut cx);
            }
            Act::Compare => {
                let now = self.now;
                let volts = |pin: Pin| outside.microvolts(now, pin.named());
                let Soc { parts, clocks, out, touched, memory, gpio, .. } = self;
                *touched |= 1 << COMP;
                let mut cx = Cx { now, clocks, memory, pins: gpio, out, id: COMP, name: "COMP/LPCOMP" };
                parts.comparator.look(volts, &mut cx);
            }
            Act::Spis { id, event } => self.spis_events.push((self.now, serial_number(id), event)),
            Act::Clock(source) => self.switch(source),
            Act::DemandLfclk => {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << CLOCK_POWER;
                let name = "CLOCK/POWER";
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: CLOCK_POWER, name };
                parts.clock_power.demand_lfclk(&mut cx);
            }
            Act::Restart => {
                self.watchdog_resets.push(WatchdogReset { at: self.now });
                self.request(Reset::Watchdog("WDT"));
            }
            Act::Off => {
                self.off = true;
                self.halted = true;
                self.touched |= 1;
                self.signals.stalled_until = NEVER;
                self.signals.changed = true;
                if self.gpio.detects() {
                    self.request(Reset::Wakeup("System OFF"));
                }
            }
            Act::Stall(until) => self.signals.stalled_until = self.signals.stalled_until.max(until),
        }
    }

    /// The part wants to restart: nothing more happens in it until it does.
    fn request(&mut self, cause: Reset) {
        self.restarting = Some(cause);
        self.halted = true;
        self.touched |= 1;
        self.signals.changed = true;
        self.signals.stop = true;
    }

    // ---- Pins

    fn with_gpiote(&mut self, call: impl FnOnce(&mut Gpiote, &mut Cx<'_>)) {
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << GPIOTE;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: GPIOTE, name: "GPIOTE" };
        call(&mut parts.gpiote, &mut cx);
    }

    /// Something outside drives a pin or lets go of it.
    pub(crate) fn drive<O: Outside>(&mut self, at: Cycle, pin: Pin, level: Option<bool>, outside: &mut O) {
        self.come(at, outside);
        // The core's last access may lie a few cycles past the edge, in an instruction that began before it: what the
        // edge sets off in hardware happens at the edge all the same.
        let reached = std::mem::replace(&mut self.now, at);
        self.gpio.outside(pin, level, at, &mut self.out);
        self.carry(outside);
        self.now = self.now.max(reached);
    }

    /// Something comes from outside at `at`.
    fn come<O: Outside>(&mut self, at: Cycle, outside: &mut O) {
        self.advance(at, outside);
        self.out.pc = None;
    }

    /// A pad moved: whoever looks at it hears. In System OFF nobody does but SENSE.
    fn level(&mut self, pin: Pin, level: bool) {
        if self.halted {
            return;
        }
        if self.parts.gpiote.watches(pin) && self.gpio.is_connected(pin) {
            self.with_gpiote(|gpiote, cx| gpiote.pad(pin, level, cx));
        }
        for (number, id) in UARTE_IDS.into_iter().enumerate() {
            if self.parts.uarte[number].clear_to_send() == Some(pin) {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.uarte[number].clear_to_send_moved(level, &mut cx);
            }
        }
        for (number, id) in SPIS_IDS.into_iter().enumerate() {
            if self.parts.serial[number].csn() == Some(pin) {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.serial[number].csn_moved(level, &mut cx);
            }
        }
    }

    /// A byte has crossed between a controller and what hangs on its pins.
    fn exchange<O: Outside>(&mut self, id: Id, mosi: u8, begins: Cycle, outside: &mut O) {
        let number = serial_number(id);
        let wires = self.parts.serial[number].wires();
        let gpio = &self.gpio;
        let output = |pin: Option<Pin>| pin.filter(|&pin| gpio.is_output(pin));
        let (sck, mosi_pin) = (output(wires.sck), output(wires.mosi));
        let frame = SpiFrame {
            sck: [sck.map(Pin::named), None],
            mosi: [mosi_pin.map(Pin::named), None],
            miso: wires.miso.map(Pin::named),
            mode: wires.mode,
            bits: 8,
            data: u32::from(mosi),
            begins,
            ends: self.now,
        };
        let answer = outside.spi(&frame);
        let miso = match wires.miso {
            Some(pin) if self.gpio.is_connected(pin) => match answer {
                Some(bits) if !self.gpio.is_output(pin) => bits as u8,
                // Nobody else drives MISO: it reads as its pad does.
                _ => 0xFF * u8::from(self.gpio.level(pin)),
            },
            _ => 0,
        };
        for (wanted, has) in [(wires.sck, sck), (wires.mosi, mosi_pin)] {
            if wanted != has {
                let what = "SCK or MOSI of SPIM is no output and carries nothing, pin";
                self.find(FindingKind::Misuse, name_of(id), what, wanted.map_or(0, |pin| pin.index() as u32));
            }
        }
        if let Some(pin) = wires.miso
            && (!self.gpio.is_connected(pin) || self.gpio.is_output(pin))
        {
            let what = "MISO of SPIM is no connected input, pin";
            self.find(FindingKind::Misuse, name_of(id), what, pin.index() as u32);
        }
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
        parts.serial[number].exchanged(miso, &mut cx);
    }

    // ---- The SSI

    pub(crate) fn ssi_select<O: Outside>(&mut self, at: Cycle, csn: Pin, outside: &mut O) {
        if !self.gpio.is_driven_from_outside(csn) {
            self.drive(at, csn, Some(true), outside);
        }
        self.drive(at, csn, Some(false), outside);
    }

    /// The SSI's controller clocked a byte that ended at `at`. What it sets off is still to be carried out.
    fn ssi_byte(&mut self, at: Cycle, mosi: u8, mode: SpiMode) -> Option<u8> {
        let wires = self.ssi?;
        let selected = |number: &usize| {
            let serial = &self.parts.serial[*number];
            serial.selected() && serial.csn().is_some_and(|csn| csn.named() == wires.csn)
        };
        let number = (0..SPIS_IDS.len()).find(selected)?;
        let id = SPIS_IDS[number];
        let Soc { parts, clocks, out, touched, memory, gpio, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: at, clocks, memory, pins: gpio, out, id, name: name_of(id) };
        parts.serial[number].clock(&wires, mosi, mode, &mut cx)
    }

    pub(crate) fn ssi_clock<O: Outside>(&mut self, at: Cycle, mosi: u8, mode: SpiMode, outside: &mut O) -> Option<u8> {
        self.come(at, outside);
        let miso = self.ssi_byte(self.now, mosi, mode);
        self.carry(outside);
        miso
    }

    /// Several bytes, the first of which ended at `first`, each `time` 2⁻¹⁶ cycles after the one before.
    pub(crate) fn ssi_exchange<O: Outside>(
        &mut self,
        first: Cycle,
        time: u64,
        mode: SpiMode,
        mosi: &[u8],
        miso: &mut [u8],
        outside: &mut O,
    ) -> bool {
        let later = time.saturating_mul(mosi.len().saturating_sub(1) as u64) >> 16;
        self.come(first + later, outside);
        let mut driven = true;
        let mut past = 0;
        for (&sent, got) in mosi.iter().zip(miso) {
            let answer = self.ssi_byte(first + (past >> 16), sent, mode);
            driven &= answer.is_some();
            *got = answer.unwrap_or(0xFF);
            past += time;
        }
        self.carry(outside);
        driven
    }

    pub(crate) fn ssi_quiet(&self) -> usize {
        let selected = self.parts.serial[..3].iter().filter(|serial| serial.selected());
        selected.map(Serial::quiet).min().unwrap_or(usize::MAX)
    }

    // ---- The controller outside of a TWIS

    pub(crate) fn two_wire<O: Outside>(
        &mut self,
        at: Cycle,
        [scl, sda]: [Pin; 2],
        event: I2cEvent,
        outside: &mut O,
    ) -> Option<I2cAnswer> {
        self.come(at, outside);
        let mut answer = Some(I2cAnswer::NOBODY);
        let is_target = |number: &usize| self.parts.serial[*number].is_target_on(scl, sda);
        let connected = self.gpio.is_connected(scl) && self.gpio.is_connected(sda);
        if let Some(number) = (0..SPIS_IDS.len()).find(is_target) {
            let id = SPIS_IDS[number];
            let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
            *touched |= 1 << id;
            let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
            if connected {
                answer = parts.serial[number].target_heard(event, &mut cx);
            } else {
                cx.misuse("SCL or SDA of TWIS is no connected input; PSEL.SCL", scl.index() as u32);
            }
        }
        self.carry(outside);
        answer
    }

    // ---- UART

    pub(crate) fn uart_receive<O: Outside>(&mut self, begins: Cycle, pin: Pin, frame: UartFrame, outside: &mut O) {
        self.come(begins, outside);
        for (n, id) in UARTE_IDS.into_iter().enumerate() {
            if self.parts.uarte[n].listens_to(pin) {
                let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id, name: name_of(id) };
                parts.uarte[n].receive(begins, frame, &mut cx);
            }
        }
        self.carry(outside);
    }

    // ---- Clocks, sleep, reset

    /// A clock's source changed: whoever counts on it moves what it has scheduled.
    fn switch(&mut self, source: Source) {
        let Settings { hfxo_ppb, hfint_ppb, lfxo_ppb, lfrc_ppb, .. } = self.settings;
        match source {
            Source::HighInternal => self.feed_hf(hfint_ppb),
            Source::HighCrystal => self.feed_hf(hfxo_ppb),
            Source::LowRc => self.feed_lf(lfrc_ppb, false),
            Source::LowCrystal => self.feed_lf(lfxo_ppb, false),
            Source::LowSynthesised => self.feed_lf(self.clocks.hf_ppb, true),
            // The watchdog does not let LFCLK go.
            Source::LowStopped if self.parts.wdt.running() => {
                self.feed_lf(lfrc_ppb, false);
                self.parts.clock_power.keep_lfclk();
            }
            Source::LowStopped => self.clocks.lf = None,
        }
        for id in ids(INSTANCES) {
            call!(self, id, instance, cx => instance.configured(cx));
        }
    }

    fn feed_hf(&mut self, ppb: i64) {
        if self.clocks.hf_ppb == ppb {
            return;
        }
        self.clocks.hf_ppb = ppb;
        self.signals.changed = true;
        if let Some(lf) = &mut self.clocks.lf {
            let lf_ppb = if self.lf_synthesised { ppb } else { lf.ppb() };
            lf.retune(self.now, lf_ppb, ppb);
        }
    }

    fn feed_lf(&mut self, ppb: i64, synthesised: bool) {
        self.lf_synthesised = synthesised;
        match &mut self.clocks.lf {
            Some(lf) => lf.retune(self.now, ppb, self.clocks.hf_ppb),
            stopped => *stopped = Some(Lfclk::new(ppb, self.clocks.hf_ppb, self.now)),
        }
    }

    pub(crate) fn sleeps<O: Outside>(&mut self, at: Cycle, asleep: bool, outside: &mut O) {
        self.come(at, outside);
        let Soc { parts, clocks, out, now, touched, memory, gpio, .. } = self;
        *touched |= 1 << CLOCK_POWER | 1 << WDT;
        let mut cx = Cx { now: *now, clocks, memory, pins: gpio, out, id: CLOCK_POWER, name: "CLOCK/POWER" };
        parts.clock_power.sleeps(asleep, &mut cx);
        parts.wdt.sleeps(asleep, &mut cx);
        self.carry(outside);
    }

    /// The part restarts (PS 5.3, *Reset behavior*). Pins driven from outside and what the cause leaves alone stay.
    pub(crate) fn restart<O: Outside>(&mut self, at: Cycle, cause: Reset, outside: &mut O) {
        self.now = self.now.max(at);
        self.out.pc = None;
        let mut parts = Parts::new(&self.settings);
        // RESETREAS accumulates until it is cleared (PS 5.3); power-on and brown-out start it at 0.
        let reason = match cause {
            Reset::PowerOn | Reset::BrownOut => None,
            Reset::Pin => Some(1),
            Reset::Watchdog(_) => Some(1 << 1),
            Reset::Software => Some(1 << 2),
            Reset::Lockup => Some(1 << 3),
            Reset::Wakeup(BY_LPCOMP) => Some(1 << 17),
            Reset::Wakeup(_) => Some(1 << 16),
        };
        // These leave the retained registers as they were; all but the wake-up the watchdog as well.
        let keeps_watchdog = matches!(cause, Reset::Software | Reset::Lockup);
        let wakes = matches!(cause, Reset::Wakeup(_));
        if let Some(reason) = reason {
            parts.clock_power.restarted(&self.parts.clock_power, reason, keeps_watchdog || wakes);
        }
        if wakes {
            self.lose_ram();
        }
        parts.rng.keep(&self.parts.rng);
        self.feed_hf(self.settings.hfint_ppb);
        if keeps_watchdog && self.parts.wdt.running() {
            std::mem::swap(&mut parts.wdt, &mut self.parts.wdt);
            parts.clock_power.keep_lfclk();
            if self.clocks.lf.is_some() {
                self.feed_lf(self.settings.lfrc_ppb, false);
            }
        } else {
            self.clocks.lf = None;
        }
        self.parts = parts;
        self.out.acts.clear();
        (self.restarting, self.halted, self.off) = (None, false, false);
        self.signals.stalled_until = 0;
        self.signals.changed = true;
        let Self { gpio, out, now, .. } = self;
        if wakes {
            // GPIO keeps its configuration through System OFF and the reset that ends it.
            gpio.let_go(*now, out);
        } else {
            gpio.restart(*now, out);
        }
        for id in ids(INSTANCES) {
            call!(self, id, instance, cx => instance.configured(cx));
        }
        self.next = NEVER;
        self.nexts = [NEVER; 64];
        self.scheduled = 0;
        self.touched = INSTANCES;
        self.carry(outside);
    }

    /// RAM that System OFF did not retain: sections of 4 KiB, two in each of RAM0 to RAM7, and six of 32 KiB in RAM8
    /// (PS 4.2, *RAM*; 5.3, RAM\[n\].POWER).
    fn lose_ram(&mut self) {
        let sections = (0..16).map(|n| (n / 2, n % 2, n * 0x1000, 0x1000));
        let large = (0..6).map(|n| (8, n, 0x1_0000 + n * 0x8000, 0x8000));
        for (block, section, from, size) in sections.chain(large) {
            if !self.parts.clock_power.retains(block, section) {
                self.memory.ram.bytes_mut()[from..from + size].fill(LOST);
            }
        }
    }

    pub(crate) fn reset_reason(&self) -> u32 {
        self.parts.clock_power.reset_reason
    }

    /// Whether the software's half of the access port protection stands open.
    pub(crate) fn debug_port_enabled(&self) -> bool {
        self.parts.clock_power.debug_port_enabled()
    }

    // ---- What accesses cost

    pub(crate) fn worst_wait_states(&self, access: &Access) -> u32 {
        let contention = u32::from(self.moving != 0);
        match access.address {
            0..FLASH_BYTES if self.parts.nvmc.is_cached() => 3,
            0..FLASH_BYTES => 2,
            0x0080_0000..0x0084_0000 | 0x2000_0000..0x2004_0000 => contention,
            0x4000_0000..0x5000_0000 => 6,
            _ => 1,
        }
    }
}

/// What is said of a block that is not modelled.
const NOT_MODELLED: &str = "is not modelled, first used at offset";

/// What is said of a register that is not modelled in a block that is.
fn register_name(block: &BlockSpec, offset: u32) -> &'static str {
    block.registers.iter().find(|register| register.offset == offset).map_or("?", |register| register.name)
}

const _: () = assert!(address_of(PPI) == 0x4001_F000 && RAM_BASE + RAM_BYTES == 0x2004_0000 && COMP == 0x13);

#[cfg(test)]
mod tests {
    use super::*;
    use bench_seam::Open;

    #[test]
    fn every_register_modelled_reads_its_reset_value_first() {
        // Registers that only an instance that is not modelled has; and some whose reset value no core can read: HFCLK
        // runs when it does, and flash is ready.
        const OTHERS: [&str; 9] =
            ["HFCLKSTAT", "READYNEXT", "SPI.", "TWI.", "TWIS.", "ACL.", "IHIT", "IMISS", "UNUSED"];
        let mut soc = Soc::new(Settings::default());
        let (mut checked, mut others) = (0, vec![]);
        for block in BLOCKS.iter().filter(|block| block.modelled) {
            for register in block.registers {
                if OTHERS.iter().any(|other| register.name.contains(other)) {
                    continue;
                }
                let address = address_of(block.id) + register.offset;
                let (width, purpose) = (Width::Word, Purpose::Data);
                let access = Access { address, width, purpose, privileged: true, cycle: 0, pc: 0 };
                let reads = soc.read(&access, &mut Open).expect("a register");
                if reads != register.reset {
                    let (block, name, reset) = (block.name, register.name, register.reset);
                    others.push(format!("{block}.{name} reads {reads:#x}, not {reset:#x}"));
                }
                checked += 1;
            }
        }
        assert!(others.is_empty(), "{others:#?}");
        assert!(checked > 800, "{checked} registers");
        // The description gives RTC0 a fourth compare register, which the part has in RTC1 and RTC2 only.
        let unmodelled: Vec<_> = soc.out.findings.iter().map(|found| (found.place, &*found.text)).collect();
        assert_eq!(unmodelled, [("RTC0", "CC[3] 0x54c")]);
    }
}
