//! The nRF52840 as a rigless [`Mcu`], from the nRF52840 Product Specification v1.7 ("PS" in what follows).
//!
//! | module | covers | PS |
//! |---|---|---|
//! | `clocks` | PCLK16M and LFCLK as exact functions of virtual time, each with its crystal's error | 5.4 |
//! | `clock_power` | CLOCK, POWER | 5.3, 5.4 |
//! | `gpio`, `gpiote` | P0, P1 with SENSE, LATCH and DETECT; GPIOTE | 6.9, 6.10 |
//! | `ppi` | PPI with forks, groups and the fixed channels | 6.16 |
//! | `egu`, `timer`, `rtc`, `wdt` | EGU0–5, TIMER0–4, RTC0–2, WDT | 6.8, 6.30, 6.22, 6.36 |
//! | `serial` | SPIM0–3 and SPIS0–2 with EasyDMA | 6.25, 6.26 |
//! | `uarte` | UARTE0–1 with EasyDMA | 6.34 |
//! | `nvmc`, `ficr` | NVMC with flash and UICR as memory; FICR | 4.3, 4.4, 4.5 |
//! | `rng`, `temp` | RNG from a seed; TEMP | 6.21, 6.28 |
//!
//! What is left out, and how it shows:
//!
//! | left out | what a firmware that uses it sees |
//! |---|---|
//! | RADIO, NFCT, SAADC, ECB, CCM, AAR, QDEC, COMP, LPCOMP, PWM | registers only; each in `Session::unimplemented` |
//! | PDM, MWU, ACL, I2S, USBD, QSPI, CryptoCell | likewise |
//! | the legacy UART, SPI and TWI, and TWIM and TWIS | a [`Finding`] |
//! | an offset inside a block that no register covers | reads 0, drops the write; listed in `Session::undefined` |
//! | an address no block covers | refused by the bus; the engine makes it a precise bus fault |
//! | current, voltage, brown-out | – |
//!
//! Inside, the part is one interconnect (`soc`) with one typed instance per block. A write to any block is carried out
//! with everything it sets off – event, PPI channel, task, pin, EasyDMA – in the order it happens and at the instant of
//! the write, which is what PPI's zero CPU latency means (PS 6.16: one PCLK16M cycle, here none).
//!
//! rigless puts models on slots of a bus; the interconnect sits on the PPI's slot, which therefore carries every
//! interrupt of the part, and the other blocks hand their accesses to it.
#![forbid(unsafe_code)]

mod clock_power;
mod clocks;
mod egu;
mod ficr;
mod gpio;
mod gpiote;
mod instance;
mod nvmc;
mod ppi;
mod registers;
mod rng;
mod rtc;
mod serial;
mod soc;
mod temp;
mod timer;
mod uarte;
mod wdt;

use rigless::chip::spi::Peer;
use rigless::cpu::armv7m::{self as cpu, Dwt};
use rigless::device::{ErasedDevice, ResetCause};
use rigless::emulator::{Alias, CoreSpec, Memory};
use rigless::machine::armv7m;
use rigless::mcu::Mcu;
use rigless::soc::{Bus, Cpu, Endian, EraseBlocks, Region};
use rigless::time::VirtualNanos;
use soc::Soc;
use std::any::Any;
use std::num::{NonZeroU32, NonZeroU64};

/// Flash: 1 MiB in 256 pages of 4 KiB (PS 4.3).
pub const FLASH_BYTES: u64 = 1 << 20;
/// Data RAM: 256 KiB from 0x2000_0000, which is all that EasyDMA reaches (PS 4.6).
pub const RAM_BYTES: u64 = 256 << 10;
/// Where data RAM starts.
pub const RAM_BASE: u64 = 0x2000_0000;
/// Where the same RAM answers as code RAM (PS 4.2).
pub const CODE_RAM_BASE: u64 = 0x0080_0000;
/// The core clock, in Hz.
pub const CORE_HZ: u64 = 64_000_000;
/// Interrupt lines of the NVIC.
pub const INTERRUPT_LINES: u16 = 48;

/// What differs from board to board and from run to run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Error of the 32 MHz crystal, in parts per billion: core clock, TIMER, SPIM and UARTE.
    pub hfxo_ppb: i64,
    /// Error of the internal oscillator that stands in until HFXO has started, in ppb (PS 5.4: ±1.5 % typical). It
    /// scales the peripherals only: the core keeps the crystal's rate throughout.
    pub hfint_ppb: i64,
    /// Error of the 32.768 kHz crystal, in ppb.
    pub lfxo_ppb: i64,
    /// Error of the RC oscillator, in ppb (PS 5.4: ±2 % uncalibrated; the default is 0).
    pub lfrc_ppb: i64,
    /// From HFCLKSTART to HFCLKSTARTED, in ns.
    pub hfxo_startup_ns: u64,
    /// From LFCLKSTART to LFCLKSTARTED with the crystal, in ns (PS 5.4: 0.25 s typical).
    pub lfxo_startup_ns: u64,
    /// What RNG's numbers follow from.
    pub seed: u64,
    /// FICR.DEVICEID.
    pub device_id: u64,
    /// FICR.DEVICEADDR, 48 bits.
    pub device_address: u64,
    /// FICR.INFO.VARIANT: the last two letters of the package variant and the build code, in ASCII. It decides whether
    /// the part has hardened access port protection, which build codes Fxx and later have.
    pub build_code: [u8; 4],
    /// What TEMP measures, in quarter degrees Celsius.
    pub temperature_quarters: i32,
    /// The mode in which the controller on the SSI clocks (CPOL, CPHA): an SPIS configured otherwise is a finding.
    pub ssi_mode: SpiMode,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            hfxo_ppb: 0,
            hfint_ppb: 15_000_000,
            lfxo_ppb: 0,
            lfrc_ppb: 0,
            hfxo_startup_ns: 360_000,
            lfxo_startup_ns: 250_000_000,
            seed: 0,
            device_id: 0x0123_4567_89AB_CDEF,
            device_address: 0x00C0_FFEE_1234,
            build_code: *b"AAF0",
            temperature_quarters: 25 * 4,
            ssi_mode: SpiMode::Mode0,
        }
    }
}

/// A pin: P0.00 to P0.31 are 0 to 31, P1.00 to P1.15 are 32 to 47, as PSEL numbers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pin(u8);

impl Pin {
    /// P0.`n`, 0 to 31.
    #[must_use]
    pub const fn p0(n: u8) -> Self {
        assert!(n < 32, "P0 has 32 pins");
        Self(n)
    }

    /// P1.`n`, 0 to 15.
    #[must_use]
    pub const fn p1(n: u8) -> Self {
        assert!(n < 16, "P1 has 16 pins");
        Self(32 + n)
    }

    /// The pin a PSEL register names, or `None` where it is disconnected or names none.
    pub(crate) fn selected(psel: u32) -> Option<Self> {
        let pin = (psel & 0x3F) as u8;
        (psel & 1 << 31 == 0 && pin < 48).then_some(Self(pin))
    }

    /// The port, 0 or 1, and the pin in it.
    pub(crate) const fn place(self) -> (usize, u32) {
        ((self.0 >> 5) as usize, self.0 as u32 & 31)
    }

    pub(crate) const fn index(self) -> usize {
        self.0 as usize
    }

    pub(crate) const fn of(port: usize, n: u32) -> Self {
        Self((port as u8) << 5 | n as u8)
    }
}

impl std::fmt::Display for Pin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (port, n) = self.place();
        write!(f, "P{port}.{n:02}")
    }
}

/// Clock polarity and phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpiMode {
    /// Idle low, sampled on the first edge.
    Mode0,
    /// Idle low, sampled on the second edge.
    Mode1,
    /// Idle high, sampled on the first edge.
    Mode2,
    /// Idle high, sampled on the second edge.
    Mode3,
}

impl SpiMode {
    /// As SPIM and SPIS hold it in CONFIG: CPHA in bit 1, CPOL in bit 2.
    pub(crate) const fn bits(self) -> u32 {
        match self {
            Self::Mode0 => 0,
            Self::Mode1 => 0b010,
            Self::Mode2 => 0b100,
            Self::Mode3 => 0b110,
        }
    }
}

/// The wires of a chip on a bus that the part controls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SpiBus {
    /// Clock.
    pub sck: Pin,
    /// Controller out.
    pub mosi: Pin,
    /// Controller in.
    pub miso: Pin,
    /// Chip select, active low, with a pull-up on the board: a pin nobody drives selects nothing.
    pub cs: Pin,
    /// The mode the chip wants. Clocked in another, it is a finding; the bytes cross all the same.
    pub mode: SpiMode,
}

/// A level that an output of the part took.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PinChange {
    /// When, in ns.
    pub at: u64,
    /// Which.
    pub pin: Pin,
    /// High or low.
    pub level: bool,
}

/// What an SPIS shows of its semaphore (PS 6.26).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpisEvent {
    /// The CPU took the semaphore: a select is not answered until it releases it.
    Held,
    /// The CPU gave the semaphore back.
    Released,
    /// The semaphore is free and no transaction is under way any more: the next select is answered.
    Ready,
    /// CSN fell while the CPU held the semaphore: this transaction reads DEF throughout and is dropped.
    Busy,
    /// A granted transaction ended with this many bytes received and sent.
    End {
        /// RXD.AMOUNT.
        rx: u32,
        /// TXD.AMOUNT.
        tx: u32,
    },
}

/// What kind of thing a [`Finding`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FindingKind {
    /// The firmware reached something this model does not have: what happened next is not what the part does.
    Unmodelled,
    /// Firmware or board did what the specification forbids or leaves undefined.
    Misuse,
    /// Something that an anomaly of the silicon spoils was used.
    Anomaly,
}

/// Something a run should answer for: listed once, with how often it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Finding {
    /// The first time, in ns.
    pub at: u64,
    /// Of what kind.
    pub kind: FindingKind,
    /// Where.
    pub instance: &'static str,
    /// What.
    pub what: &'static str,
    /// The first value that goes with it: what was written, an address, an offset.
    pub value: u32,
    /// How often.
    pub count: u32,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { at, kind, instance, what, value, count } = self;
        let (s, ns) = (at / 1_000_000_000, at % 1_000_000_000);
        write!(f, "{s}.{ns:09} s {kind:?} {instance}: {what} ({value:#x}), {count} times")
    }
}

/// A byte that left a UARTE.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UartByte {
    /// When its stop bit ended, in ns.
    pub at: u64,
    /// Which UARTE, 0 or 1.
    pub uarte: usize,
    /// The byte.
    pub byte: u8,
}

/// One watchdog reset, which a run may want to see apart from the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WatchdogReset {
    /// When, in ns.
    pub at: u64,
}

const PAGES: EraseBlocks =
    EraseBlocks { size: NonZeroU64::new(4096).expect("not zero"), count: NonZeroU32::new(256).expect("not zero") };

/// Flash and UICR are written through the NVMC only; FICR is a block of read-only registers.
static MEMORY: [Region; 3] = [
    Region::flash("flash", 0, FLASH_BYTES).erased_in(&[PAGES]).erased_to(0xFF).programmed_by("NVMC"),
    Region::flash("uicr", 0x1000_1000, 0x1000).erased_to(0xFF).programmed_by("NVMC"),
    Region::ram("ram", RAM_BASE, RAM_BYTES),
];

/// The part.
#[derive(Debug)]
pub struct Nrf52840 {
    bus: Bus,
    soc: Soc,
    /// The cycle counter, at the core clock with the crystal's error.
    pub dwt: Dwt,
    /// The block each slot is, `None` for one without a model of its own.
    slots: Vec<Field>,
    hub: usize,
}

#[derive(Debug, Clone, Copy)]
enum Field {
    Block(instance::Id),
    Dwt,
    None,
}

impl Nrf52840 {
    /// A part that has just been powered, with an erased UICR and nothing on its pins.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let cpu = Cpu::new("cortex-m4", true, INTERRUPT_LINES, Endian::Little);
        let blocks = soc::BLOCKS.iter().map(|block| block.peripheral).chain([cpu::PERIPHERAL]);
        let bus = Bus::builder(cpu, &MEMORY, blocks)
            .reads_requests("PPI")
            .undefined_reads_zero()
            .build()
            .expect("the part's own description holds");
        let slots = bus
            .slots()
            .iter()
            .map(|slot| {
                let name = slot.peripheral().name;
                if name == cpu::DWT {
                    return Field::Dwt;
                }
                match soc::BLOCKS.iter().find(|block| block.peripheral.name == name) {
                    Some(block) if block.modelled => Field::Block(block.id),
                    _ => Field::None,
                }
            })
            .collect();
        let hub = bus.slot("PPI").expect("a block of the part");
        let core_hz = CORE_HZ.saturating_add_signed((CORE_HZ as i64) * settings.hfxo_ppb / 1_000_000_000);
        Self { bus, soc: Soc::new(settings), dwt: Dwt::with_clock(core_hz), slots, hub }
    }

    /// What the part was made with.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.soc.settings
    }

    /// The core of this part for rigless: Cortex-M4F at 64 MHz, 48 lines, 3 priority bits, 8 MPU regions, vector table
    /// at 0, retiring `instructions_per_second` (64 million is one instruction a cycle).
    #[must_use]
    pub fn core_spec(&self, instructions_per_second: NonZeroU64) -> CoreSpec {
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: NonZeroU64::new(CORE_HZ).expect("not zero"),
            interrupt_lines: NonZeroU32::new(u32::from(INTERRUPT_LINES)).expect("not zero"),
            priority_bits: 3,
            refclk_divider: NonZeroU32::new(1).expect("not zero"),
            instructions_per_second,
            boot: "flash",
        };
        let mut config = armv7m::Config::new(core, &cpu::windows(&self.bus));
        config.fpu = armv7m::Fpu::FpV4Sp;
        config.mpu_regions = armv7m::MpuRegions::Eight;
        config.vector_table = Some(0); // flash answers at zero by itself
        let mut spec = config.spec();
        spec.aliases.push(Alias { region: "ram", at: CODE_RAM_BASE });
        spec
    }

    /// Runs `call` on the interconnect at `at`, and everything it sets off.
    fn drive<T>(&mut self, at: VirtualNanos, call: impl FnOnce(&mut Soc) -> T) -> T {
        let (_, mut context) = self.bus.drive(at, self.hub);
        self.soc.now = at.0;
        let out = call(&mut self.soc);
        self.soc.carry(&mut context);
        out
    }

    /// Hangs `peer` on `bus` and returns its index. More than one chip may share a bus; two selected at once answer
    /// with the AND of both, and that is a finding.
    pub fn attach_spi(&mut self, bus: SpiBus, peer: Box<dyn Peer>) -> usize {
        self.soc.attach(bus, peer)
    }

    /// The chip at `index`, if it is a `T`.
    #[must_use]
    pub fn chip<T: Peer>(&self, index: usize) -> Option<&T> {
        let peer: &dyn Any = self.soc.peer(index)?;
        peer.downcast_ref()
    }

    /// The chip at `index`, if it is a `T`.
    pub fn chip_mut<T: Peer>(&mut self, index: usize) -> Option<&mut T> {
        let peer: &mut dyn Any = self.soc.peer_mut(index)?;
        peer.downcast_mut()
    }

    /// Something outside drives `pin` to `level` from `at` on. IN, SENSE, GPIOTE and an SPIS whose CSN this is see it
    /// at that instant. What it sets off settles when the session resumes, as with every input.
    pub fn drive_pin(&mut self, at: VirtualNanos, pin: Pin, level: bool) {
        self.drive(at, |soc| soc.outside(pin, Some(level)));
    }

    /// What drove `pin` from outside lets go of it at `at`.
    pub fn release_pin(&mut self, at: VirtualNanos, pin: Pin) {
        self.drive(at, |soc| soc.outside(pin, None));
    }

    /// The level of the pad: what drives it, or else its pull resistor, or else low.
    #[must_use]
    pub fn pin(&self, pin: Pin) -> bool {
        self.soc.gpio.level(pin)
    }

    /// The levels that outputs took since this was last asked, in order.
    pub fn take_pin_changes(&mut self) -> Vec<PinChange> {
        std::mem::take(&mut self.soc.pin_changes)
    }

    /// The SSI's controller pulls the chip select `csn` low. The SPIS on that pin arbitrates its semaphore here, at the
    /// falling edge, and for the whole transaction. A pin that nobody has driven yet rests high, as the pull-up of a
    /// chip select has it. Let the session resume before the first [`Nrf52840::ssi_clock`].
    pub fn ssi_select(&mut self, at: VirtualNanos, csn: Pin) {
        self.drive(at, |soc| soc.ssi_select(csn));
    }

    /// The SSI's controller clocks one byte into the selected SPIS and gets one back. `at` is the byte's last edge, at
    /// which `mosi` is complete; what MISO carried was loaded at the end of the byte before. Let the session resume
    /// after each byte, because EasyDMA fetches the next one there. `None` where no SPIS is selected: MISO floats.
    pub fn ssi_clock(&mut self, at: VirtualNanos, mosi: u8) -> Option<u8> {
        self.drive(at, |soc| soc.ssi_clock(mosi))
    }

    /// How many bytes the SSI's controller may clock before the selected SPIS raises an event; `usize::MAX` for any
    /// number.
    #[must_use]
    pub fn ssi_quiet(&self) -> usize {
        self.soc.ssi_quiet()
    }

    /// As [`Nrf52840::ssi_clock`], with EasyDMA served from `memory` at once, so that bytes that were clocked one after
    /// the other can be exchanged together after the last of them: each with its own instant, and memory as it is now.
    /// No more than [`Nrf52840::ssi_quiet`] of them, or an event comes late.
    pub fn ssi_exchange(&mut self, at: VirtualNanos, mosi: u8, memory: &mut dyn Memory) -> Option<u8> {
        self.drive(at, |soc| {
            let miso = soc.ssi_clock(mosi);
            soc.serve(memory);
            miso
        })
    }

    /// The SSI's controller lets the chip select `csn` rise: the transaction ends.
    pub fn ssi_deselect(&mut self, at: VirtualNanos, csn: Pin) {
        self.drive(at, |soc| soc.outside(csn, Some(true)));
    }

    /// What the SPIS instances showed since this was last asked: when (in ns), which (0 to 2), what.
    pub fn take_spis_events(&mut self) -> Vec<(u64, usize, SpisEvent)> {
        std::mem::take(&mut self.soc.spis_events)
    }

    /// A byte arrives at the RXD pin of UARTE `uarte` (0 or 1), its stop bit ending at `at`.
    pub fn uart_receive(&mut self, at: VirtualNanos, uarte: usize, byte: u8) {
        self.drive(at, |soc| soc.uart_receive(uarte, byte));
    }

    /// The bytes that left a UARTE since this was last asked.
    pub fn take_uart_sent(&mut self) -> Vec<UartByte> {
        std::mem::take(&mut self.soc.uart_sent)
    }

    /// The core locked up: the part resets with RESETREAS.LOCKUP (PS 5.3).
    pub fn lockup(&mut self, at: VirtualNanos) {
        self.drive(at, |soc| soc.out.acts.push_back(instance::Act::Reset(instance::Restart::Lockup)));
    }

    /// The supply failed: the restart that comes next is a power-on or brown-out reset, whoever asks for it. Both leave
    /// nothing in RESETREAS (PS 5.3) and put every register back; what RAM holds afterwards is the engine's to say.
    pub fn supply_failed(&mut self) {
        self.soc.supply_failed = true;
    }

    /// What a debugger that comes now finds on a part with hardened access port protection (nRF52840 revision 3 on),
    /// given the word of UICR.APPROTECT as it was at the last reset, when the part takes it up: the debug port is open
    /// while UICR.APPROTECT and APPROTECT.DISABLE both say 0x5A and nothing was written to APPROTECT.FORCEPROTECT (PS
    /// 4.8, *Access port protection*). Erased flash reads 0xFFFF_FFFF there, and every reset closes the software's
    /// half, so a firmware that writes neither is locked.
    #[must_use]
    pub fn debug_port_open(&self, uicr_approtect: u32) -> bool {
        uicr_approtect & 0xFF == 0x5A && self.soc.debug_port_enabled()
    }

    /// RESETREAS, as the firmware has left it.
    #[must_use]
    pub fn reset_reason(&self) -> u32 {
        self.soc.reset_reason()
    }

    /// Every watchdog reset of this run.
    #[must_use]
    pub fn watchdog_resets(&self) -> &[WatchdogReset] {
        &self.soc.watchdog_resets
    }

    /// Everything the run should answer for, in the order it first came.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        &self.soc.out.findings
    }
}

impl Mcu for Nrf52840 {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.bus.reset();
        rigless::device::Device::reset(&mut self.dwt);
        let (_, mut context) = self.bus.drive(at, self.hub);
        self.soc.restart(cause, &mut context);
    }

    fn poll(&mut self, _now: VirtualNanos) {}

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let model: Option<&mut dyn ErasedDevice> = match self.slots.get(slot) {
            Some(&Field::Block(id)) => {
                self.soc.called = id;
                Some(&mut self.soc)
            }
            Some(Field::Dwt) => Some(&mut self.dwt),
            Some(Field::None) | None => None,
        };
        (&mut self.bus, model)
    }
}
