//! The interconnect: which block is where, and what carries the effect of one to another.
//!
//! | covered | PS |
//! |---|---|
//! | peripheral IDs, bases and interrupts | 4.2 |
//! | tasks (write 1, read 0), events (write 0 clears, 1 sets), SHORTS, INTEN | 6.1 |
//! | EasyDMA to data RAM, byte by byte | 4.6 |
//! | what each source of reset leaves as it was | 5.3 |
//!
//! | left out | why |
//! |---|---|
//! | stalls between the core and EasyDMA on one RAM block | the core retires instructions at a fixed rate |
//! | the one PCLK16M cycle that a PPI channel takes | below the resolution anything here is asked for; order is kept |
//! | RAM[n].POWER taking a section's contents | the registers are there; memory belongs to the engine |
//!
//! Everything that happens is an [`Act`] in one queue, carried out in order. An event that triggers, through PPI, the
//! task that raises it again never ends on the part, one turn per clock cycle; here it is cut after [`LOOP_LIMIT`]
//! turns and reported.
use crate::clock_power::ClockPower;
use crate::clocks::{Clocks, LFCLK, Oscillator, PCLK16M};
use crate::egu::Egu;
use crate::ficr::Ficr;
use crate::gpio::Gpio;
use crate::gpiote::Gpiote;
use crate::instance::{Act, Cx, Id, Instance, Outbox, Restart, Source, address_of};
use crate::nvmc::Nvmc;
use crate::ppi::Ppi;
use crate::registers as r;
use crate::rng::Rng;
use crate::rtc::Rtc;
use crate::serial::Serial;
use crate::temp::Temp;
use crate::timer::Timer;
use crate::uarte::Uarte;
use crate::wdt::Wdt;
use crate::{FindingKind, Pin, PinChange, RAM_BASE, RAM_BYTES, Settings, SpiBus, SpisEvent, UartByte, WatchdogReset};
use rigless::chip::Timeline;
use rigless::chip::spi::Peer;
use rigless::device::{DeviceContext, ErasedDevice, Level, RegisterFile, RequestChange, ResetCause};
use rigless::emulator::Memory;
use rigless::soc::{Peripheral, RegisterSpec, Width};
use rigless::time::{EventId, VirtualNanos};

/// P0 and P1, which have no ID of their own.
pub(crate) const GPIO: Id = 0x30;
/// FICR.
pub(crate) const FICR: Id = 0x31;
/// PPI, and with it the interconnect.
const PPI: Id = 0x1F;
const NVMC: Id = 0x1E;
const GPIOTE: Id = 0x06;
const WDT: Id = 0x10;

/// An instant that never comes.
const NEVER: u64 = u64::MAX;

/// Acts that one access or one instant may set off before something must be going round in circles.
const LOOP_LIMIT: u32 = 100_000;

/// One block of the part.
#[derive(Debug)]
pub(crate) struct BlockSpec {
    pub(crate) id: Id,
    pub(crate) peripheral: Peripheral,
    pub(crate) modelled: bool,
}

const fn at(id: Id, name: &'static str, registers: &'static [RegisterSpec], modelled: bool) -> BlockSpec {
    BlockSpec {
        id,
        peripheral: Peripheral { name, base: address_of(id) as u64, size: 0x1000, interrupts: &[], registers },
        modelled,
    }
}

/// Every line of the part, by number: the interconnect drives them all.
static LINES: [u16; crate::INTERRUPT_LINES as usize] = {
    let mut lines = [0; crate::INTERRUPT_LINES as usize];
    let mut n = 0;
    while n < lines.len() {
        lines[n] = n as u16;
        n += 1;
    }
    lines
};

/// Every block, by address (PS 4.2, *Instantiation*).
pub(crate) static BLOCKS: [BlockSpec; 46] = [
    at(0x00, "CLOCK/POWER", r::CLOCK_POWER, true),
    at(0x01, "RADIO", r::RADIO, false),
    at(0x02, "UARTE0", r::UART, true),
    at(0x03, "SPIM0/SPIS0", r::SERIAL, true),
    at(0x04, "SPIM1/SPIS1", r::SERIAL, true),
    at(0x05, "NFCT", r::NFCT, false),
    at(0x06, "GPIOTE", r::GPIOTE, true),
    at(0x07, "SAADC", r::SAADC, false),
    at(0x08, "TIMER0", r::TIMER, true),
    at(0x09, "TIMER1", r::TIMER, true),
    at(0x0A, "TIMER2", r::TIMER, true),
    at(0x0B, "RTC0", r::RTC, true),
    at(0x0C, "TEMP", r::TEMP, true),
    at(0x0D, "RNG", r::RNG, true),
    at(0x0E, "ECB", r::ECB, false),
    at(0x0F, "CCM/AAR", r::CCM_AAR, false),
    at(0x10, "WDT", r::WDT, true),
    at(0x11, "RTC1", r::RTC, true),
    at(0x12, "QDEC", r::QDEC, false),
    at(0x13, "COMP/LPCOMP", r::COMP_LPCOMP, false),
    at(0x14, "EGU0", r::EGU, true),
    at(0x15, "EGU1", r::EGU, true),
    at(0x16, "EGU2", r::EGU, true),
    at(0x17, "EGU3", r::EGU, true),
    at(0x18, "EGU4", r::EGU, true),
    at(0x19, "EGU5", r::EGU, true),
    at(0x1A, "TIMER3", r::TIMER_WIDE, true),
    at(0x1B, "TIMER4", r::TIMER_WIDE, true),
    at(0x1C, "PWM0", r::PWM, false),
    at(0x1D, "PDM", r::PDM, false),
    at(0x1E, "NVMC", r::NVMC_ACL, true),
    BlockSpec {
        id: PPI,
        peripheral: Peripheral {
            name: "PPI",
            base: address_of(PPI) as u64,
            size: 0x1000,
            interrupts: &LINES,
            registers: r::PPI,
        },
        modelled: true,
    },
    at(0x20, "MWU", r::MWU, false),
    at(0x21, "PWM1", r::PWM, false),
    at(0x22, "PWM2", r::PWM, false),
    at(0x23, "SPIM2/SPIS2", r::SERIAL, true),
    at(0x24, "RTC2", r::RTC, true),
    at(0x25, "I2S", r::I2S, false),
    at(0x27, "USBD", r::USBD, false),
    at(0x28, "UARTE1", r::UART, true),
    at(0x29, "QSPI", r::QSPI, false),
    at(0x2D, "PWM3", r::PWM, false),
    at(0x2F, "SPIM3", r::SPIM3, true),
    at(GPIO, "GPIO", r::GPIO, true),
    BlockSpec {
        id: FICR,
        peripheral: Peripheral { name: "FICR", base: 0x1000_0000, size: 0x1000, interrupts: &[], registers: r::FICR },
        modelled: true,
    },
    BlockSpec {
        id: 0x32,
        peripheral: Peripheral {
            name: "CRYPTOCELL",
            base: 0x5002_A000,
            size: 0x2000,
            interrupts: &[],
            registers: r::CRYPTOCELL,
        },
        modelled: false,
    },
];

/// Where in [`BLOCKS`] each ID is.
const PLACES: [usize; 64] = {
    let mut places = [usize::MAX; 64];
    let mut n = 0;
    while n < BLOCKS.len() {
        places[BLOCKS[n].id] = n;
        n += 1;
    }
    places
};

/// The block of a peripheral ID.
fn spec(id: Id) -> &'static BlockSpec {
    &BLOCKS[PLACES[id]]
}

/// A chip on a bus.
#[derive(Debug)]
struct Place {
    bus: SpiBus,
    peer: Box<dyn Peer>,
    selected: bool,
}

/// Everything inside the part but memory and the core.
#[derive(Debug)]
pub(crate) struct Soc {
    pub(crate) settings: Settings,
    clocks: Clocks,
    pub(crate) gpio: Gpio,
    parts: Parts,
    pub(crate) out: Outbox,
    /// The instant of the call.
    pub(crate) now: u64,
    /// The block the bus calls.
    pub(crate) called: Id,
    /// Writes that other slots received, for the interconnect to carry out.
    inbox: Vec<(Id, u32, u32)>,
    lines: u64,
    /// Instances called since their interrupt lines and next instants were last looked at.
    touched: u64,
    /// The next instant of each instance by ID as last looked at, [`NEVER`] for none.
    nexts: [u64; 64],
    /// The least of them.
    next: u64,
    /// The earliest instant the bus was asked to come back at.
    scheduled: Option<u64>,
    chips: Vec<Place>,
    pub(crate) pin_changes: Vec<PinChange>,
    pub(crate) spis_events: Vec<(u64, usize, SpisEvent)>,
    pub(crate) uart_sent: Vec<UartByte>,
    pub(crate) watchdog_resets: Vec<WatchdogReset>,
    restarting: Option<Restart>,
    /// The next restart is the supply's doing.
    pub(crate) supply_failed: bool,
}

/// The instances but GPIO, which everyone's pins go through.
#[derive(Debug)]
struct Parts {
    clock_power: ClockPower,
    uarte: [Uarte; 2],
    serial: [Serial; 4],
    gpiote: Gpiote,
    timer: [Timer; 5],
    rtc: [Rtc; 3],
    temp: Temp,
    rng: Rng,
    wdt: Wdt,
    egu: [Egu; 6],
    nvmc: Nvmc,
    ppi: Ppi,
    ficr: Ficr,
}

impl Parts {
    fn new(settings: &Settings) -> Self {
        Self {
            clock_power: ClockPower::new(settings),
            uarte: Default::default(),
            serial: [Serial::new(true), Serial::new(true), Serial::new(true), Serial::new(false)],
            gpiote: Gpiote::default(),
            timer: [Timer::new(4), Timer::new(4), Timer::new(4), Timer::new(6), Timer::new(6)],
            rtc: [Rtc::new(3), Rtc::new(4), Rtc::new(4)],
            temp: Temp::new(settings.temperature_quarters),
            rng: Rng::new(settings.seed),
            wdt: Wdt::default(),
            egu: Default::default(),
            nvmc: Nvmc::default(),
            ppi: Ppi::default(),
            ficr: Ficr::new(settings),
        }
    }

    fn get(&mut self, id: Id) -> Option<&mut dyn Instance> {
        Some(match id {
            0x00 => &mut self.clock_power,
            0x02 => &mut self.uarte[0],
            0x28 => &mut self.uarte[1],
            0x03 | 0x04 => &mut self.serial[id - 0x03],
            0x23 => &mut self.serial[2],
            0x2F => &mut self.serial[3],
            GPIOTE => &mut self.gpiote,
            0x08..=0x0A => &mut self.timer[id - 0x08],
            0x1A | 0x1B => &mut self.timer[id - 0x1A + 3],
            0x0B => &mut self.rtc[0],
            0x11 => &mut self.rtc[1],
            0x24 => &mut self.rtc[2],
            0x0C => &mut self.temp,
            0x0D => &mut self.rng,
            WDT => &mut self.wdt,
            0x14..=0x19 => &mut self.egu[id - 0x14],
            NVMC => &mut self.nvmc,
            PPI => &mut self.ppi,
            FICR => &mut self.ficr,
            _ => return None,
        })
    }

    fn get_ref(&self, id: Id) -> Option<&dyn Instance> {
        Some(match id {
            0x00 => &self.clock_power,
            0x02 => &self.uarte[0],
            0x28 => &self.uarte[1],
            0x03 | 0x04 => &self.serial[id - 0x03],
            0x23 => &self.serial[2],
            0x2F => &self.serial[3],
            GPIOTE => &self.gpiote,
            0x08..=0x0A => &self.timer[id - 0x08],
            0x1A | 0x1B => &self.timer[id - 0x1A + 3],
            0x0B => &self.rtc[0],
            0x11 => &self.rtc[1],
            0x24 => &self.rtc[2],
            0x0C => &self.temp,
            0x0D => &self.rng,
            WDT => &self.wdt,
            0x14..=0x19 => &self.egu[id - 0x14],
            NVMC => &self.nvmc,
            PPI => &self.ppi,
            FICR => &self.ficr,
            _ => return None,
        })
    }
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
fn ids(mut set: u64) -> impl Iterator<Item = Id> {
    std::iter::from_fn(move || {
        let id = set.trailing_zeros() as Id;
        (set != 0).then(|| {
            set &= set - 1;
            id
        })
    })
}

/// The SPIS a serial block is: 0 to 2.
fn spis_number(id: Id) -> usize {
    match id {
        0x03 => 0,
        0x04 => 1,
        _ => 2,
    }
}

impl Soc {
    pub(crate) fn new(settings: Settings) -> Self {
        Self {
            clocks: Clocks { hf: Oscillator::new(PCLK16M, settings.hfint_ppb, 0), lf: None },
            gpio: Gpio::default(),
            parts: Parts::new(&settings),
            out: Outbox::default(),
            now: 0,
            called: PPI,
            inbox: Vec::new(),
            lines: 0,
            touched: INSTANCES,
            nexts: [NEVER; 64],
            next: NEVER,
            scheduled: None,
            chips: Vec::new(),
            pin_changes: Vec::new(),
            spis_events: Vec::new(),
            uart_sent: Vec::new(),
            watchdog_resets: Vec::new(),
            restarting: None,
            supply_failed: false,
            settings,
        }
    }

    pub(crate) fn attach(&mut self, bus: SpiBus, peer: Box<dyn Peer>) -> usize {
        self.chips.push(Place { bus, peer, selected: false });
        self.chips.len() - 1
    }

    pub(crate) fn peer(&self, index: usize) -> Option<&dyn Peer> {
        self.chips.get(index).map(|place| &*place.peer)
    }

    pub(crate) fn peer_mut(&mut self, index: usize) -> Option<&mut dyn Peer> {
        self.chips.get_mut(index).map(|place| &mut *place.peer)
    }

    /// Calls instance `id` with what it may reach.
    fn with<T>(&mut self, id: Id, call: impl FnOnce(&mut dyn Instance, &mut Cx<'_>) -> T) -> Option<T> {
        let Self { parts, clocks, out, now, touched, .. } = self;
        let instance = parts.get(id)?;
        *touched |= 1 << id;
        let mut cx = Cx { now: *now, clocks, out, id, name: spec(id).peripheral.name };
        Some(call(instance, &mut cx))
    }

    /// Something outside drives a pin or lets go of it.
    pub(crate) fn outside(&mut self, pin: Pin, level: Option<bool>) {
        self.gpio.outside(pin, level, self.now, &mut self.out);
    }

    /// The SSI's controller pulls its select low, which rested high before.
    pub(crate) fn ssi_select(&mut self, csn: Pin) {
        if !self.gpio.is_driven_from_outside(csn) {
            self.outside(csn, Some(true));
        }
        self.outside(csn, Some(false));
    }

    /// The SSI's controller clocks a byte.
    pub(crate) fn ssi_clock(&mut self, mosi: u8) -> Option<u8> {
        let id = [0x03, 0x04, 0x23].into_iter().find(|&id| self.parts.serial[spis_number(id)].selected())?;
        let Self { parts, clocks, out, now, touched, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: *now, clocks, out, id, name: spec(id).peripheral.name };
        Some(parts.serial[spis_number(id)].clock(mosi, &mut cx))
    }

    pub(crate) fn reset_reason(&self) -> u32 {
        self.parts.clock_power.reset_reason
    }

    /// Whether the software's half of the access port protection stands open.
    pub(crate) fn debug_port_enabled(&self) -> bool {
        self.parts.clock_power.debug_port_enabled()
    }

    pub(crate) fn ssi_quiet(&self) -> usize {
        let selected = [0x03, 0x04, 0x23].into_iter().map(|id| &self.parts.serial[spis_number(id)]);
        selected.filter(|serial| serial.selected()).map(Serial::quiet).min().unwrap_or(usize::MAX)
    }

    /// Carries out what EasyDMA is waiting for; the rest goes on waiting.
    pub(crate) fn serve(&mut self, memory: &mut dyn Memory) {
        for _ in 0..self.out.acts.len() {
            let Some(act) = self.out.acts.pop_front() else { return };
            let served = match act {
                Act::Read { id, token, address, bytes: 1 } => memory.read(u64::from(address), Width::W8).map(|value| {
                    self.with(id, |instance, cx| instance.answer(token, value as u32, cx));
                }),
                Act::Write { address, value } => memory.write(u64::from(address), Width::W8, u64::from(value)),
                other => {
                    self.out.acts.push_back(other);
                    Ok(())
                }
            };
            if served.is_err() {
                self.out.find(self.now, FindingKind::Misuse, "EasyDMA", MEMORY_REFUSED, 0);
            }
        }
    }

    pub(crate) fn uart_receive(&mut self, uarte: usize, byte: u8) {
        let id = [0x02, 0x28][uarte];
        let Self { parts, clocks, out, now, touched, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: *now, clocks, out, id, name: spec(id).peripheral.name };
        parts.uarte[uarte].receive(byte, &mut cx);
    }

    /// A write that the bus found a register for.
    fn write_register(&mut self, id: Id, offset: u32, value: u32) {
        if id == GPIO {
            let Self { gpio, out, now, .. } = self;
            gpio.write(offset, value, *now, out);
            return;
        }
        let known = self.with(id, |instance, cx| match offset {
            _ if id == FICR => instance.write(offset, value, cx),
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
        if known != Some(true) {
            self.report_unmodelled(id, offset, "a write to a register that is not modelled, at offset");
        }
    }

    fn read_register(&mut self, id: Id, offset: u32) -> u32 {
        if let Some(value) = self.look(id, offset, self.now) {
            return value;
        }
        self.report_unmodelled(id, offset, "a read of a register that is not modelled, at offset");
        0
    }

    /// What a register reads at `now`.
    fn look(&self, id: Id, offset: u32, now: u64) -> Option<u32> {
        if id == GPIO {
            return self.gpio.read(offset);
        }
        let instance = self.parts.get_ref(id)?;
        let block = instance.block_ref();
        match offset {
            _ if id == FICR => instance.read(offset, now, &self.clocks),
            0x000..0x100 => Some(0),
            0x100..0x180 => Some(block.events >> ((offset - 0x100) / 4) & 1),
            0x200 => Some(block.shorts),
            0x300 | 0x304 | 0x308 => Some(block.inten),
            _ => instance.read(offset, now, &self.clocks),
        }
    }

    fn report_unmodelled(&mut self, id: Id, offset: u32, what: &'static str) {
        self.out.find(self.now, FindingKind::Unmodelled, spec(id).peripheral.name, what, offset);
    }

    /// Carries everything out that is waiting, drives the interrupt lines that moved, and asks to be called again when
    /// the next thing happens.
    pub(crate) fn carry(&mut self, context: &mut DeviceContext<'_>) {
        self.drain(context);
        self.look_at_touched();
        for id in ids(std::mem::take(&mut self.touched)) {
            let high = self.parts.get_ref(id).is_some_and(Instance::line);
            if id < usize::from(crate::INTERRUPT_LINES) && (self.lines >> id & 1 != 0) != high {
                self.lines ^= 1 << id;
                context.interrupt(id, Level::from(high));
            }
        }
        self.schedule(context);
    }

    /// Carries out what is waiting, in order.
    fn drain(&mut self, context: &mut DeviceContext<'_>) {
        let mut turns = 0;
        while let Some(act) = self.out.acts.pop_front() {
            turns += 1;
            if turns > LOOP_LIMIT {
                let what = "an event triggers itself without end; cut";
                self.out.find(self.now, FindingKind::Misuse, "PPI", what, LOOP_LIMIT);
                self.out.acts.clear();
                return;
            }
            self.perform(act, context);
        }
    }

    fn schedule(&mut self, context: &mut DeviceContext<'_>) {
        let next = self.next;
        if next != NEVER && self.scheduled.is_none_or(|at| next < at || at <= self.now) {
            self.scheduled = Some(next);
            context.schedule(VirtualNanos(next));
        }
    }

    /// Takes up the next instants of the instances called since last asked: no other's can have moved.
    fn look_at_touched(&mut self) {
        let mut least_moved = false;
        for id in ids(self.touched) {
            let next = self.parts.get_ref(id).and_then(Instance::next).unwrap_or(NEVER);
            let was = std::mem::replace(&mut self.nexts[id], next);
            least_moved |= was == self.next && next > was;
            self.next = self.next.min(next);
        }
        if least_moved {
            self.next = self.nexts.into_iter().min().unwrap_or(NEVER);
        }
    }

    fn perform(&mut self, act: Act, context: &mut DeviceContext<'_>) {
        match act {
            Act::Event(address) => {
                for task in self.parts.ppi.tasks_of(address) {
                    self.out.acts.push_back(Act::Task(task));
                }
            }
            Act::Task(address) => {
                let (id, offset) = ((address >> 12 & 0x3F) as Id, address & 0xFFF);
                let on_the_bus = address >> 18 == 0x4000_0000 >> 18;
                let done = on_the_bus
                    && offset < 0x100
                    && self.with(id, |instance, cx| instance.task(offset, cx)) == Some(true);
                if !done {
                    self.out.find(
                        self.now,
                        FindingKind::Unmodelled,
                        "PPI",
                        "a channel triggers a task that is not modelled or none at all, at",
                        address,
                    );
                }
            }
            Act::Read { id, token, address, bytes } => {
                let width = if bytes == 4 { Width::W32 } else { Width::W8 };
                context.read_from(u64::from(address), width, (id as u64) << 32 | u64::from(token));
            }
            Act::Write { address, value } => {
                context.write_to(u64::from(address), Width::W8, u64::from(value), WRITTEN);
            }
            Act::Program { address, value } => {
                context.program(u64::from(address), Width::W32, u64::from(value), WRITTEN);
            }
            Act::Erase { from, bytes } => {
                for address in (from..from + bytes).step_by(8) {
                    context.program(u64::from(address), Width::W64, u64::MAX, WRITTEN);
                }
            }
            Act::Hold { pin, level } => self.gpio.hold(pin, level, self.now, &mut self.out),
            Act::Pad { pin, level } => self.pad(pin, level, context),
            Act::Driven { pin } => self.select_chips(pin, context),
            Act::Sample { channel } => {
                let Self { parts, gpio, .. } = self;
                parts.gpiote.sample(channel, |pin| gpio.level(pin));
            }
            Act::Detect => {
                self.with_gpiote(Gpiote::port);
            }
            Act::Exchange { id, mosi } => self.exchange(id, mosi, context),
            Act::Sent { id, byte } => {
                self.uart_sent.push(UartByte { at: self.now, uarte: usize::from(id == 0x28), byte });
            }
            Act::Spis { id, event } => self.spis_events.push((self.now, spis_number(id), event)),
            Act::Clock(source) => self.switch(source),
            Act::DemandLfclk => {
                let Self { parts, clocks, out, now, touched, .. } = self;
                *touched |= 1;
                let mut cx = Cx { now: *now, clocks, out, id: 0, name: "CLOCK/POWER" };
                parts.clock_power.demand_lfclk(&mut cx);
            }
            Act::Reset(why) => {
                if why == Restart::Watchdog {
                    self.watchdog_resets.push(WatchdogReset { at: self.now });
                }
                self.restarting = Some(why);
                context.request_reset();
            }
        }
    }

    fn with_gpiote(&mut self, call: impl FnOnce(&mut Gpiote, &mut Cx<'_>)) {
        let Self { parts, clocks, out, now, touched, .. } = self;
        *touched |= 1 << GPIOTE;
        let mut cx = Cx { now: *now, clocks, out, id: GPIOTE, name: "GPIOTE" };
        call(&mut parts.gpiote, &mut cx);
    }

    /// A pad moved: whoever looks at it hears.
    fn pad(&mut self, pin: Pin, level: bool, context: &mut DeviceContext<'_>) {
        if !self.gpio.is_driven_from_outside(pin) {
            self.pin_changes.push(PinChange { at: self.now, pin, level });
        }
        self.with_gpiote(|gpiote, cx| gpiote.pad(pin, level, cx));
        for id in [0x03, 0x04, 0x23] {
            let number = spis_number(id);
            if self.parts.serial[number].csn() == Some(pin) {
                let mode = self.settings.ssi_mode;
                let Self { parts, clocks, out, now, touched, .. } = self;
                *touched |= 1 << id;
                let mut cx = Cx { now: *now, clocks, out, id, name: spec(id).peripheral.name };
                parts.serial[number].csn_moved(level, mode, &mut cx);
            }
        }
        self.select_chips(pin, context);
    }

    /// The chips whose select is `pin` hear whether it selects them: driven and low.
    fn select_chips(&mut self, pin: Pin, context: &mut DeviceContext<'_>) {
        let selected = self.gpio.is_driven(pin) && !self.gpio.level(pin);
        for place in self.chips.iter_mut().filter(|place| place.bus.cs == pin) {
            if selected != place.selected {
                place.selected = selected;
                let mut timeline = Timeline::new(context);
                if selected {
                    place.peer.select(&mut timeline);
                } else {
                    place.peer.deselect(&mut timeline);
                }
            }
        }
    }

    /// A byte crosses between a controller and the chips its clock reaches.
    fn exchange(&mut self, id: Id, mosi: u8, context: &mut DeviceContext<'_>) {
        let number = [0x03, 0x04, 0x23, 0x2F].iter().position(|&had| had == id).expect("a serial block");
        let wires = self.parts.serial[number].wires();
        let name = spec(id).peripheral.name;
        let mut miso = None;
        for place in &mut self.chips {
            if !place.selected || wires.sck != Some(place.bus.sck) {
                continue;
            }
            if wires.mode != place.bus.mode.bits() {
                self.out.find(
                    self.now,
                    FindingKind::Misuse,
                    name,
                    "a chip is clocked in another SPI mode than it wants",
                    wires.mode,
                );
            }
            let heard = if wires.mosi == Some(place.bus.mosi) {
                mosi
            } else {
                0xFF * u8::from(self.gpio.level(place.bus.mosi))
            };
            let said = place.peer.transfer(u32::from(heard), 8, &mut Timeline::new(context)) as u8;
            if wires.miso == Some(place.bus.miso) {
                if miso.is_some() {
                    self.out.find(self.now, FindingKind::Misuse, name, "two chips drive MISO at once", u32::from(said));
                }
                miso = Some(miso.unwrap_or(0xFF) & said);
            }
        }
        // Nobody drives MISO: it reads as its pad does.
        let floating = wires.miso.is_some_and(|pin| self.gpio.level(pin));
        let miso = miso.unwrap_or(0xFF * u8::from(floating));
        let Self { parts, clocks, out, now, touched, .. } = self;
        *touched |= 1 << id;
        let mut cx = Cx { now: *now, clocks, out, id, name };
        parts.serial[number].exchanged(miso, &mut cx);
    }

    /// A clock's source changed: whoever counts on it moves what it has scheduled.
    fn switch(&mut self, source: Source) {
        let Settings { hfxo_ppb, hfint_ppb, lfxo_ppb, lfrc_ppb, .. } = self.settings;
        let now = self.now;
        let mut low = |ppb: i64| match &mut self.clocks.lf {
            Some(running) => running.retune(now, ppb),
            stopped => *stopped = Some(Oscillator::new(LFCLK, ppb, now)),
        };
        match source {
            Source::HighInternal => self.clocks.hf.retune(now, hfint_ppb),
            Source::HighCrystal => self.clocks.hf.retune(now, hfxo_ppb),
            Source::LowRc => low(lfrc_ppb),
            Source::LowCrystal => low(lfxo_ppb),
            Source::LowSynthesised => low(hfxo_ppb),
            // The watchdog does not let LFCLK go.
            Source::LowStopped if self.parts.wdt.running() => {
                low(lfrc_ppb);
                self.parts.clock_power.keep_lfclk();
            }
            Source::LowStopped => self.clocks.lf = None,
        }
        for id in ids(INSTANCES) {
            self.with(id, |instance, cx| instance.configured(cx));
        }
    }

    /// Everything due by now.
    fn fire(&mut self, context: &mut DeviceContext<'_>) {
        // One that something else called since may have become due: it is asked itself, below.
        let asked = |soc: &Self, id: Id| soc.nexts[id] <= soc.now || soc.touched >> id & 1 != 0;
        for id in ids(INSTANCES) {
            if asked(self, id) && self.parts.get_ref(id).and_then(Instance::next).is_some_and(|at| at <= self.now) {
                self.with(id, |instance, cx| instance.due(cx));
                // Before the next instance: two that are due at one instant happen one after the other.
                self.drain(context);
            }
        }
    }

    /// The part restarts (PS 5.3). Pins driven from outside, the chips, and what the cause leaves alone stay.
    pub(crate) fn restart(&mut self, cause: ResetCause, context: &mut DeviceContext<'_>) {
        self.now = context.now().0;
        let why = self.restarting.take();
        let supply_failed = std::mem::take(&mut self.supply_failed);
        let mut parts = Parts::new(&self.settings);
        // RESETREAS accumulates until it is cleared (PS 5.3); power-on starts it at 0.
        let reason = match (cause, why) {
            _ if supply_failed => None,
            (ResetCause::PowerOn, _) => None,
            (ResetCause::Pin, _) => Some(1),
            (_, Some(Restart::Watchdog)) => Some(1 << 1),
            (_, Some(Restart::Lockup)) => Some(1 << 3),
            (_, None) => Some(1 << 2),
        };
        // Soft reset and lockup leave the watchdog running and the retained registers as they were (PS 5.3).
        let gentle = matches!(reason, Some(r) if r & 0b1100 != 0);
        if let Some(reason) = reason {
            parts.clock_power.restarted(&self.parts.clock_power, reason, gentle);
        }
        self.clocks.hf.retune(self.now, self.settings.hfint_ppb);
        parts.rng.keep(&self.parts.rng);
        if gentle && self.parts.wdt.running() {
            std::mem::swap(&mut parts.wdt, &mut self.parts.wdt);
            parts.clock_power.keep_lfclk();
            if let Some(lf) = &mut self.clocks.lf {
                lf.retune(self.now, self.settings.lfrc_ppb);
            }
        } else {
            self.clocks.lf = None;
        }
        self.parts = parts;
        self.out.acts.clear();
        self.inbox.clear();
        self.lines = 0;
        self.touched = INSTANCES;
        self.scheduled = None;
        let Self { gpio, out, now, .. } = self;
        gpio.restart(*now, out);
        for id in ids(INSTANCES) {
            self.with(id, |instance, cx| instance.configured(cx));
        }
        for place in &mut self.chips {
            place.peer.restarted(&mut Timeline::new(context));
        }
        self.carry(context);
    }
}

/// What a refused access of EasyDMA is reported as.
const MEMORY_REFUSED: &str = "memory refused an access of EasyDMA";

/// The token of an access whose answer nobody waits for.
const WRITTEN: u64 = u64::MAX;

impl ErasedDevice for Soc {
    fn layout(&self) -> &'static [RegisterSpec] {
        spec(self.called).peripheral.registers
    }

    fn read(&mut self, row: usize, _: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Option<u64> {
        self.now = context.now().0;
        let id = self.called;
        let offset = self.layout()[row].offset;
        Some(u64::from(self.read_register(id, offset)))
    }

    fn peek(&self, row: usize, _: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        Some(u64::from(self.look(self.called, self.layout()[row].offset, now.0).unwrap_or(0)))
    }

    fn write(&mut self, row: usize, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.now = context.now().0;
        let id = self.called;
        let offset = self.layout()[row].offset;
        if context.access_width().is_some_and(|width| width != Width::W32) {
            self.out.find(
                self.now,
                FindingKind::Misuse,
                spec(id).peripheral.name,
                "a write narrower than a word, at offset",
                offset,
            );
        }
        if id == PPI {
            self.write_register(id, offset, value as u32);
            self.carry(context);
        } else if id == NVMC {
            // Only the flash controller's own slot may program flash, and nothing of it reaches another block.
            self.write_register(id, offset, value as u32);
            self.drain(context);
        } else {
            self.inbox.push((id, offset, value as u32));
            context.request(0, Level::High);
        }
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        _: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        self.now = context.now().0;
        let Self { parts, clocks, out, now, touched, .. } = self;
        *touched |= 1 << NVMC;
        let mut cx = Cx { now: *now, clocks, out, id: NVMC, name: "NVMC" };
        if !parts.nvmc.store(address as u32, width == Width::W32, value as u32, &mut cx) {
            context.bus_error();
        }
        self.drain(context);
        true
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.now = context.now().0;
        if self.scheduled.is_some_and(|at| at <= self.now) {
            self.scheduled = None;
        }
        self.fire(context);
        for place in &mut self.chips {
            place.peer.on_event(event, &mut Timeline::new(context));
        }
        self.carry(context);
    }

    fn on_request(&mut self, _: RequestChange, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.now = context.now().0;
        for (id, offset, value) in std::mem::take(&mut self.inbox) {
            self.write_register(id, offset, value);
        }
        self.carry(context);
    }

    fn on_clock(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn poll(&mut self, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn reset(&mut self) {}

    fn on_access(&mut self, token: u64, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if token == WRITTEN {
            return;
        }
        self.now = context.now().0;
        self.with((token >> 32) as Id, |instance, cx| instance.answer(token as u32, value as u32, cx));
        if self.called == NVMC {
            self.drain(context);
        } else {
            self.carry(context);
        }
    }

    fn on_refused(&mut self, token: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.now = context.now().0;
        let name = if token == WRITTEN { "EasyDMA" } else { spec((token >> 32) as Id).peripheral.name };
        self.out.find(self.now, FindingKind::Misuse, name, MEMORY_REFUSED, token as u32);
    }
}

/// Whether EasyDMA reaches `address` (PS 4.6: data RAM only).
pub(crate) fn in_data_ram(address: u32) -> bool {
    (RAM_BASE..RAM_BASE + RAM_BYTES).contains(&u64::from(address))
}
