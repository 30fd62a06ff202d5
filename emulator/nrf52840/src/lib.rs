//! The nRF52840 without its core as a [`Part`], from the nRF52840 Product Specification v1.7 (here called "PS").
//!
//! | module | covers | PS |
//! |---|---|---|
//! | `clocks` | core clock, PCLK16M and LFCLK, each with its oscillator's error | 5.4 |
//! | `clock_power` | CLOCK, POWER | 5.3, 5.4 |
//! | `memory` | flash, UICR, FICR, RAM | 4.2, 4.4, 4.5 |
//! | `gpio`, `gpiote` | P0, P1 with SENSE, LATCH and DETECT; GPIOTE | 6.9, 6.10 |
//! | `ppi` | PPI with forks, groups and the fixed channels | 6.16 |
//! | `egu`, `timer`, `rtc`, `wdt` | EGU0–5, TIMER0–4, RTC0–2, WDT | 6.8, 6.30, 6.22, 6.36 |
//! | `serial`, `twim`, `twis` | SPIM0–3, SPIS0–2, TWIM0–1, TWIS0–1 with EasyDMA | 6.25, 6.26, 6.31, 6.32 |
//! | `uarte` | UARTE0–1 with EasyDMA, and the legacy UART | 6.33, 6.34 |
//! | `nvmc` | NVMC | 4.3 |
//! | `rng`, `temp`, `ecb`, `ccm` | RNG from a seed; TEMP; ECB; CCM | 6.21, 6.28, 6.7, 6.4 |
//! | `analog` | SAADC; COMP and LPCOMP | 6.23, 6.5, 6.13 |
//! | `pwm`, `qdec` | PWM0–3; QDEC | 6.17, 6.18 |
//!
//! What is left out, and how firmware sees it:
//!
//! | left out | what firmware that uses it sees |
//! |---|---|
//! | RADIO, NFCT, AAR, PDM, MWU, I2S, USBD, QSPI, CryptoCell | reset values; a [`Finding`] at its first use |
//! | ACL, the legacy SPI and TWI | a [`Finding`] |
//! | an offset inside a block at which there is no register | reads return 0, writes do nothing; a [`Finding`] |
//! | an address outside every block | a bus fault, and a [`Finding`] |
//! | current; failures between the lowest voltage, 1.7 V, and the brown-out reset | – |
//!
//! The part is one interconnect (`soc`) with one typed instance per block. A write is carried out with everything that
//! it sets off (event, PPI channel, task, pin, EasyDMA), in order and at the cycle of the write. A PPI channel
//! therefore takes no time (PS 6.16: one PCLK16M cycle).
//!
//! In System OFF cycles are still counted, and [`Signals::stalled_until`] stops the core until the reset that ends
//! System OFF.
//!
//! ```
//! use cortex_m4::{Access, Purpose, Width};
//! use emulator_part::{Open, Part, Pin};
//! use nrf52840::{Nrf52840, Settings};
//!
//! let mut part = Nrf52840::new(Settings::default());
//! let (width, purpose) = (Width::Word, Purpose::Data);
//! let word = |address| Access { address, width, purpose, privileged: true, cycle: 0, pc: 0 };
//! part.write(&word(0x5000_0518), 1 << 13, &mut Open)?; // P0.DIRSET
//! part.write(&word(0x5000_0508), 1 << 13, &mut Open)?; // P0.OUTSET
//! assert!(part.pin(Pin::new(0, 13)));
//! assert!(part.findings().is_empty());
//! # Ok::<(), cortex_m4::BusError>(())
//! ```
#![forbid(unsafe_code)]

mod act;
mod analog;
mod ccm;
mod clock_power;
mod clocks;
mod ecb;
mod egu;
mod gpio;
mod gpiote;
mod instance;
mod memory;
mod nvmc;
mod pin;
mod ppi;
mod pwm;
mod qdec;
mod registers;
mod rng;
mod rtc;
mod serial;
mod soc;
mod temp;
mod timer;
mod uarte;
mod vectors;
mod wdt;

use cortex_m4::{Access, Bound, BusError, Config, Signals, Width};
use emulator_part::{
    Clock, Cycle, Finding, I2cAnswer, I2cEvent, Outside, Part, Pin, Pins, Reset, SpiMode, StuckBit, Supplied, UartFrame,
};
use memory::{FLASH_BYTES, RAM_BASE, RAM_BYTES};
pub use soc::CtrlRequest;
use soc::Soc;

/// The rate of the core clock in Hz, for a source without error.
pub const CORE_HZ: u64 = 64_000_000;

/// The settings that differ from board to board and from run to run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// The error of the 32 MHz crystal, in parts per billion (ppb). It affects the core clock, TIMER, SPIM and UARTE.
    pub hfxo_ppb: i64,
    /// The error of the internal oscillator HFINT, in ppb (PS 5.4: ±1.5 % typical). It is used until HFXO has started.
    pub hfint_ppb: i64,
    /// The error of the 32.768 kHz crystal, in ppb.
    pub lfxo_ppb: i64,
    /// The error of the RC oscillator, in ppb (PS 5.4: ±2 % uncalibrated; the default is 0).
    pub lfrc_ppb: i64,
    /// The time from HFCLKSTART to HFCLKSTARTED, in ns of a core clock without error; `None` if the 32 MHz crystal
    /// never starts.
    pub hfxo_startup_ns: Option<u64>,
    /// The time from LFCLKSTART to LFCLKSTARTED with the crystal, in ns of a core clock without error (PS 5.4: 0.25 s
    /// typical).
    pub lfxo_startup_ns: u64,
    /// The seed of the RNG.
    pub seed: u64,
    /// The value of FICR.DEVICEID.
    pub device_id: u64,
    /// The value of FICR.DEVICEADDR, 48 bits.
    pub device_address: u64,
    /// FICR.INFO.VARIANT in ASCII: the last two letters of the package variant, and the build code. Build codes Fxx and
    /// later have hardened access port protection.
    pub build_code: [u8; 4],
    /// The temperature that TEMP measures, in quarters of a degree Celsius.
    pub temperature_quarters: i32,
    /// The supply voltage in microvolts.
    pub supply_microvolts: i32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            hfxo_ppb: 0,
            hfint_ppb: 15_000_000,
            lfxo_ppb: 0,
            lfrc_ppb: 0,
            hfxo_startup_ns: Some(360_000),
            lfxo_startup_ns: 250_000_000,
            seed: 0,
            device_id: 0x0123_4567_89AB_CDEF,
            device_address: 0x00C0_FFEE_1234,
            build_code: *b"AAF0",
            temperature_quarters: 25 * 4,
            supply_microvolts: 3_000_000,
        }
    }
}

/// The pins of the part that are wired to an outside SPI controller, for an SPIS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SpisWires {
    /// The pin of the clock, SCK.
    pub sck: Pin,
    /// The pin of the controller's output, MOSI.
    pub mosi: Pin,
    /// The pin of the controller's input, MISO.
    pub miso: Pin,
    /// The pin of the chip select, active low.
    pub csn: Pin,
}

/// A change of an SPIS's semaphore or of its transaction (PS 6.26).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpisEvent {
    /// The CPU took the semaphore. Until it releases the semaphore, the SPIS answers no select.
    Held,
    /// The CPU released the semaphore.
    Released,
    /// The semaphore is free and no transaction is under way, so the SPIS answers the next select.
    Ready,
    /// CSN fell while the CPU held the semaphore. The transaction reads DEF, and its data is dropped.
    Busy,
    /// A granted transaction ended.
    End {
        /// The number of received bytes, RXD.AMOUNT.
        rx: u32,
        /// The number of sent bytes, TXD.AMOUNT.
        tx: u32,
    },
}

/// One reset by the watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WatchdogReset {
    /// The cycle of the reset.
    pub at: Cycle,
}

/// The nRF52840 without its core.
#[derive(Clone, Debug)]
pub struct Nrf52840 {
    soc: Soc,
}

impl Nrf52840 {
    /// Makes a part that has just been powered, with erased flash and UICR and open pins.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { soc: Soc::new(settings) }
    }

    /// The settings with which the part was made.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.soc.settings
    }

    /// Wires an outside SPI controller to these pins. An SPIS exchanges bytes over those of them that its PSEL
    /// registers select.
    pub fn wire_spis(&mut self, wires: SpisWires) {
        self.soc.spis_wires = Some(wires);
    }

    /// Makes an SPI controller pull the chip select `csn` low. At this edge the SPIS arbitrates its semaphore for the
    /// whole transaction. A pin that nobody has driven is high.
    pub fn spis_select<O: Outside>(&mut self, at: Cycle, csn: Pin, outside: &mut O) {
        if let Some(pin) = pin::Pin::outside(csn) {
            self.soc.spis_select(at, pin, outside);
        }
    }

    /// Makes an SPI controller clock one byte into the selected SPIS, in `mode`, and returns the byte from the SPIS.
    /// `at` is the byte's last edge, at which `mosi` is complete. The SPIS loaded its byte at the end of the previous
    /// byte. Returns `None` if no selected SPIS drives MISO.
    pub fn spis_clock<O: Outside>(&mut self, at: Cycle, mosi: u8, mode: SpiMode, outside: &mut O) -> Option<u8> {
        self.soc.spis_clock(at, mosi, mode, outside)
    }

    /// The number of bytes that an SPI controller may clock before the selected SPIS raises an event; `usize::MAX` for
    /// no limit.
    #[must_use]
    pub fn spis_quiet(&self) -> usize {
        self.soc.spis_quiet()
    }

    /// Clocks several bytes as [`Nrf52840::spis_clock`] does, after the last of them has ended. The first byte ended at
    /// `first`. The bytes are `byte_time` apart, in units of 2⁻¹⁶ cycles. Memory is used in its present state. More
    /// bytes than [`Nrf52840::spis_quiet`] would make an event late. Returns `false`, with 0xFF in `miso`, if no
    /// selected SPIS drove MISO.
    pub fn spis_exchange<O: Outside>(
        &mut self,
        first: Cycle,
        byte_time: u64,
        mode: SpiMode,
        mosi: &[u8],
        miso: &mut [u8],
        outside: &mut O,
    ) -> bool {
        self.soc.spis_exchange(first, byte_time, mode, mosi, miso, outside)
    }

    /// Makes an SPI controller raise the chip select `csn`. This ends the transaction.
    pub fn spis_deselect<O: Outside>(&mut self, at: Cycle, csn: Pin, outside: &mut O) {
        self.drive(at, csn, Some(true), outside);
    }

    /// Takes the SPIS events since the last call: cycle, instance (0 to 2), event.
    pub fn take_spis_events(&mut self) -> Vec<(Cycle, usize, SpisEvent)> {
        std::mem::take(&mut self.soc.spis_events)
    }

    /// Takes each [`SpisEvent::Ready`] since the last call: its cycle, and the contents of the TXD buffer at that
    /// cycle.
    pub fn take_spis_offers(&mut self) -> Vec<(Cycle, Vec<u8>)> {
        std::mem::take(&mut self.soc.spis_offers)
    }

    /// Makes an outside I2C controller act on the bus of `scl` and `sda`; the action ended at `at`. Returns `None`
    /// while the TWIS on these pins holds SCL low: the controller must repeat the action later. A bus without a TWIS
    /// answers like an empty one.
    pub fn two_wire<O: Outside>(
        &mut self,
        at: Cycle,
        scl: Pin,
        sda: Pin,
        event: I2cEvent,
        outside: &mut O,
    ) -> Option<I2cAnswer> {
        match (pin::Pin::outside(scl), pin::Pin::outside(sda)) {
            (Some(scl), Some(sda)) => self.soc.two_wire(at, [scl, sda], event, outside),
            _ => Some(I2cAnswer::NOBODY),
        }
    }

    /// Whether a debugger that attaches now finds the debug port open, on a part with hardened access port protection
    /// (nRF52840 revision 3 on). `uicr_approtect` is UICR.APPROTECT as the part read it at the last reset. The port is
    /// open if UICR.APPROTECT and APPROTECT.DISABLE both hold 0x5A and nothing was written to APPROTECT.FORCEPROTECT
    /// (PS 4.8, *Access port protection*). Every reset closes the software's half, APPROTECT.DISABLE, and erased flash
    /// reads 0xFFFF_FFFF. A part whose firmware writes neither register is therefore locked.
    #[must_use]
    pub fn debug_port_open(&self, uicr_approtect: u32) -> bool {
        uicr_approtect & 0xFF == 0x5A && self.soc.debug_port_enabled()
    }

    /// Whether an attached debugger can access memory and core through the AHB-AP now (PS 4.8). That depends on UICR at
    /// the last reset at which the part read UICR, and on what firmware and CTRL-AP have done since.
    #[must_use]
    pub fn access_port_open(&self) -> bool {
        self.soc.access_port_open()
    }

    /// Reads the CTRL-AP register at this address, 0 if there is none.
    #[must_use]
    pub fn ctrl_ap_read(&self, register: u8) -> u32 {
        self.soc.ctrl_ap_read(register)
    }

    /// Writes a register of CTRL-AP at `at`.
    pub fn ctrl_ap_write(&mut self, register: u8, value: u32, at: Cycle) -> CtrlRequest {
        self.soc.ctrl_ap_write(register, value, at)
    }

    /// Advances CTRL-AP to `to`, so that an erase ends when its time is over. Call it as time passes, while a debugger
    /// is attached.
    pub fn ctrl_ap_advance(&mut self, to: Cycle) {
        self.soc.ctrl_ap_advance(to);
    }

    /// Sets the start-up time of the 32 MHz crystal, in ns, from its next start on. With `None` it never starts. A
    /// running crystal goes on.
    pub fn set_hfxo_startup(&mut self, startup_ns: Option<u64>) {
        self.soc.set_hfxo_startup(startup_ns);
    }

    /// Makes both crystals faster by `ppb` parts per billion from `at` on; slower if it is negative.
    pub fn drift<O: Outside>(&mut self, at: Cycle, ppb: i64, outside: &mut O) {
        self.soc.drift(at, ppb, outside);
    }

    /// Whether the 32 MHz crystal runs or could start.
    #[must_use]
    pub fn has_hfxo(&self) -> bool {
        self.soc.has_hfxo()
    }

    /// RESETREAS, as the firmware left it.
    #[must_use]
    pub fn reset_reason(&self) -> u32 {
        self.soc.reset_reason()
    }

    /// All watchdog resets of this run.
    #[must_use]
    pub fn watchdog_resets(&self) -> &[WatchdogReset] {
        &self.soc.watchdog_resets
    }
}

impl Part for Nrf52840 {
    const NAME: &'static str = "nRF52840";
    const PINS: Pins = Pins { ports: &[("P0.", 32), ("P1.", 16)], digits: 2 };
    const INTERRUPTS: &'static [&'static str] = &vectors::NAMES;

    const RAM: &'static [(u32, usize)] = &[(0x2000_0000, 256 << 10)];
    const RESETS_ON_LOCKUP: bool = true;

    fn core(&self) -> Config {
        Config {
            lines: soc::INTERRUPT_LINES,
            priority_bits: 3,
            vector_table: 0,
            // SysTick counts the core clock, and has neither a reference clock nor a calibration value (PS 4.1).
            systick_calibration: 1 << 31,
            systick_reference: 0,
            mpu_regions: 8,
        }
    }

    #[inline(always)]
    fn read<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError> {
        let ram = access.address.wrapping_sub(RAM_BASE);
        if ram < RAM_BYTES {
            return self.soc.memory.ram.read(ram, access.width).ok_or(BusError);
        }
        // Passing a copy keeps the compiler from storing the access in memory each time RAM is accessed.
        self.soc.read(&{ *access }, outside)
    }

    #[inline(always)]
    fn write<O: Outside>(&mut self, access: &Access, value: u32, outside: &mut O) -> Result<(), BusError> {
        let ram = access.address.wrapping_sub(RAM_BASE);
        if ram < RAM_BYTES {
            return self.soc.memory.ram.write(ram, access.width, value).then_some(()).ok_or(BusError);
        }
        self.soc.write(&{ *access }, value, outside)
    }

    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        let memory = &self.soc.memory;
        let ram = memory.ram.read_aligned(address.wrapping_sub(RAM_BASE), width);
        // Flash begins at address 0 and is read without waiting.
        ram.or_else(|| memory.flash.read_aligned(address, width))
    }

    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        self.soc.memory.ram.write_aligned(address.wrapping_sub(RAM_BASE), width, value)
    }

    #[inline]
    fn fetch(&mut self, address: u32) -> Result<u16, BusError> {
        let memory = &self.soc.memory;
        let half = Width::Half;
        let read = match memory::place(address) {
            Some(memory::Place::Flash(offset)) => memory.flash.read(offset, half),
            Some(memory::Place::Ram(offset)) => memory.ram.read(offset, half),
            Some(memory::Place::Ficr(_) | memory::Place::Uicr(_)) | None => None,
        };
        read.map(|half| half as u16).ok_or(BusError)
    }

    #[inline]
    fn is_constant(&self, address: u32) -> bool {
        address < FLASH_BYTES
    }

    fn watch_code(&mut self, address: u32) -> bool {
        matches!(memory::place(address), Some(memory::Place::Ram(offset)) if self.soc.memory.ram.watch(offset))
    }

    fn is_watched(&self, address: u32) -> bool {
        matches!(memory::place(address), Some(memory::Place::Ram(offset)) if self.soc.memory.ram.is_watched(offset))
    }

    #[inline(always)]
    fn rewritten(&self) -> u64 {
        self.soc.memory.ram.rewritten()
    }

    #[inline]
    fn due(&self) -> Cycle {
        self.soc.next
    }

    #[inline]
    fn advance<O: Outside>(&mut self, to: Cycle, outside: &mut O) {
        self.soc.advance(to, outside);
    }

    #[inline]
    fn signals(&mut self) -> &mut Signals {
        &mut self.soc.signals
    }

    #[inline(always)]
    fn memory_waits(&mut self, address: u32, _fetch: bool, cycle: Cycle, bound: Bound) -> Option<u32> {
        match bound {
            Bound::Best => (address < 0x4000_0000).then_some(0),
            Bound::Worst if address < FLASH_BYTES => Some(self.soc.flash_waits()),
            Bound::Worst if matches!(memory::place(address), Some(memory::Place::Ram(_))) => {
                Some(self.soc.contention(address, cycle))
            }
            Bound::Worst => None,
        }
    }

    /// The wait states of an access. From the PS (4.1, *Electrical specification*, W_FLASH, W_FLASHCACHE, W_RAM): flash
    /// takes 2 without the instruction cache and 3 on a cache miss, and RAM takes none. Assumed: 1 if EasyDMA may
    /// access the same RAM, 1 to 6 through the bridge to the peripheral bus, and 0 to 1 to GPIO, which is on the AHB.
    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32 {
        match bound {
            Bound::Best => u32::from((0x4000_0000..0x5000_0000).contains(&access.address)),
            Bound::Worst => self.soc.worst_wait_states(access),
        }
    }

    fn clock(&self) -> Clock {
        Clock { hz: CORE_HZ, ppb: self.soc.hf_ppb() }
    }

    /// Resets the part (PS 5.3, *Reset behavior*). The caller decides which memory survives a power-on. RAM that was
    /// not retained through System OFF reads 0xA5 after [`Reset::Wakeup`].
    fn reset<O: Outside>(&mut self, at: Cycle, cause: Reset, outside: &mut O) {
        self.soc.restart(at, cause, outside);
    }

    #[inline]
    fn take_reset(&mut self) -> Option<Reset> {
        self.soc.take_reset()
    }

    fn supply<O: Outside>(&mut self, at: Cycle, microvolts: u32, _seed: u64, outside: &mut O) -> Supplied {
        self.soc.supply(at, microvolts, outside)
    }

    fn take_supply_warning(&mut self) -> bool {
        self.soc.take_supply_warning()
    }

    fn sleeps<O: Outside>(&mut self, at: Cycle, asleep: bool, _deep: bool, outside: &mut O) {
        self.soc.sleeps(at, asleep, outside);
    }

    fn halts<O: Outside>(&mut self, at: Cycle, halted: bool, outside: &mut O) {
        self.soc.halts(at, halted, outside);
    }

    fn drive<O: Outside>(&mut self, at: Cycle, pin: Pin, level: Option<bool>, outside: &mut O) {
        if let Some(pin) = pin::Pin::outside(pin) {
            self.soc.drive(at, pin, level, outside);
        }
    }

    fn pin(&self, pin: Pin) -> bool {
        pin::Pin::outside(pin).is_some_and(|pin| self.soc.gpio.level(pin))
    }

    fn receive<O: Outside>(&mut self, begins: Cycle, pin: Pin, frame: UartFrame, outside: &mut O) {
        if let Some(pin) = pin::Pin::outside(pin) {
            self.soc.uart_receive(begins, pin, frame, outside);
        }
    }

    fn memory(&self, address: u32, size: usize) -> Option<&[u8]> {
        self.soc.memory.slice(address, size)
    }

    fn stick(&mut self, stuck: Option<StuckBit>) -> bool {
        let ram = |stuck: StuckBit| StuckBit { address: stuck.address.wrapping_sub(RAM_BASE), ..stuck };
        let stuck = stuck.map(ram);
        let there = stuck.is_none_or(|stuck| stuck.address < RAM_BYTES);
        self.soc.memory.ram.stick(stuck.filter(|_| there));
        there
    }

    fn memory_mut(&mut self, address: u32, size: usize) -> Option<&mut [u8]> {
        if address < FLASH_BYTES {
            self.soc.signals.forget_code();
        }
        self.soc.memory.slice_mut(address, size)
    }

    fn findings(&self) -> &[Finding] {
        &self.soc.out.findings
    }
}
