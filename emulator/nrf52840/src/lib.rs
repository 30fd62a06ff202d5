//! The nRF52840 without its core as a [`Part`], from the nRF52840 Product Specification v1.7 ("PS" in what follows).
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
//! What is left out, and how it shows:
//!
//! | left out | what a firmware that uses it sees |
//! |---|---|
//! | RADIO, NFCT, AAR, PDM, MWU, I2S, USBD, QSPI, CryptoCell | reset values; a [`Finding`] at its first use |
//! | ACL, the legacy SPI and TWI | a [`Finding`] |
//! | an offset inside a block that no register covers | reads 0, drops the write; a [`Finding`] |
//! | an address no block covers | a bus fault, and a [`Finding`] |
//! | current; anything that goes wrong between the lowest voltage, 1.7 V, and the brown-out reset | – |
//!
//! Inside, the part is one interconnect (`soc`) with one typed instance per block. A write to any block is carried out
//! with everything it sets off – event, PPI channel, task, pin, EasyDMA – in the order it happens and at the cycle of
//! the write, which is what PPI's zero CPU latency means (PS 6.16: one PCLK16M cycle, here none).
//!
//! In System OFF the core's cycles go on being counted, and [`Signals::stalled_until`] holds the core until the reset
//! that ends it.
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
mod wdt;

use cortex_m4::{Access, Bound, BusError, Config, Signals, Width};
use emulator_part::{
    Clock, Cycle, Finding, I2cAnswer, I2cEvent, Outside, Part, Pin, Reset, SpiMode, StuckBit, Supplied, UartFrame,
};
use memory::{FLASH_BYTES, RAM_BASE, RAM_BYTES};
pub use soc::CtrlRequest;
use soc::Soc;

/// The core clock, in Hz, where its source is exact.
pub const CORE_HZ: u64 = 64_000_000;

/// What differs from board to board and from run to run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Error of the 32 MHz crystal, in parts per billion: core clock, TIMER, SPIM and UARTE.
    pub hfxo_ppb: i64,
    /// Error of the internal oscillator that stands in until HFXO has started, in ppb (PS 5.4: ±1.5 % typical).
    pub hfint_ppb: i64,
    /// Error of the 32.768 kHz crystal, in ppb.
    pub lfxo_ppb: i64,
    /// Error of the RC oscillator, in ppb (PS 5.4: ±2 % uncalibrated; the default is 0).
    pub lfrc_ppb: i64,
    /// From HFCLKSTART to HFCLKSTARTED, in ns of a core clock without error; `None` where the crystal never starts.
    pub hfxo_startup_ns: Option<u64>,
    /// From LFCLKSTART to LFCLKSTARTED with the crystal, in ns of a core clock without error (PS 5.4: 0.25 s typical).
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
    /// The supply, which an SAADC and a comparator can measure, in microvolts.
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

/// The part's pins that a controller outside is wired to, for an SPIS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SsiWires {
    /// Clock.
    pub sck: Pin,
    /// Controller out.
    pub mosi: Pin,
    /// Controller in.
    pub miso: Pin,
    /// Chip select, active low.
    pub csn: Pin,
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

/// One watchdog reset, which a run may want to see apart from the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WatchdogReset {
    /// When.
    pub at: Cycle,
}

/// The part.
#[derive(Clone, Debug)]
pub struct Nrf52840 {
    soc: Soc,
}

impl Nrf52840 {
    /// A part that has just been powered, with erased flash and UICR and nothing on its pins.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { soc: Soc::new(settings) }
    }

    /// What the part was made with.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.soc.settings
    }

    /// A controller outside is wired to these pins: an SPIS exchanges bytes with it over those of them that its PSEL
    /// registers select.
    pub fn wire_ssi(&mut self, wires: SsiWires) {
        self.soc.ssi = Some(wires);
    }

    /// The SSI's controller pulls the chip select `csn` low. The SPIS on that pin arbitrates its semaphore here, at the
    /// falling edge, and for the whole transaction. A pin that nobody has driven yet rests high, as the pull-up of a
    /// chip select has it.
    pub fn ssi_select<O: Outside>(&mut self, at: Cycle, csn: Pin, outside: &mut O) {
        if let Some(pin) = pin::Pin::outside(csn) {
            self.soc.ssi_select(at, pin, outside);
        }
    }

    /// The SSI's controller clocks one byte into the selected SPIS, in `mode`, and gets one back. `at` is the byte's
    /// last edge, at which `mosi` is complete; what MISO carried was loaded at the end of the byte before. `None` where
    /// no selected SPIS drives MISO.
    pub fn ssi_clock<O: Outside>(&mut self, at: Cycle, mosi: u8, mode: SpiMode, outside: &mut O) -> Option<u8> {
        self.soc.ssi_clock(at, mosi, mode, outside)
    }

    /// How many bytes the SSI's controller may clock before the selected SPIS raises an event; `usize::MAX` for any
    /// number.
    #[must_use]
    pub fn ssi_quiet(&self) -> usize {
        self.soc.ssi_quiet()
    }

    /// As [`Nrf52840::ssi_clock`] for bytes that were clocked one after the other, called when the last of them has
    /// ended: the first ended at `first`, and each next `byte_time` 2⁻¹⁶ cycles later. Memory is as it is now. No more
    /// than [`Nrf52840::ssi_quiet`] of them, or an event comes late. `false` where no selected SPIS drove MISO: `miso`
    /// then holds 0xFF.
    pub fn ssi_exchange<O: Outside>(
        &mut self,
        first: Cycle,
        byte_time: u64,
        mode: SpiMode,
        mosi: &[u8],
        miso: &mut [u8],
        outside: &mut O,
    ) -> bool {
        self.soc.ssi_exchange(first, byte_time, mode, mosi, miso, outside)
    }

    /// The SSI's controller lets the chip select `csn` rise: the transaction ends.
    pub fn ssi_deselect<O: Outside>(&mut self, at: Cycle, csn: Pin, outside: &mut O) {
        self.drive(at, csn, Some(true), outside);
    }

    /// What the SPIS instances showed since this was last asked: when, which (0 to 2), what.
    pub fn take_spis_events(&mut self) -> Vec<(Cycle, usize, SpisEvent)> {
        std::mem::take(&mut self.soc.spis_events)
    }

    /// For each [`SpisEvent::Ready`] since this was last asked: when, and what the TXD buffer held, which is what a
    /// transaction that began then would have read.
    pub fn take_spis_offers(&mut self) -> Vec<(Cycle, Vec<u8>)> {
        std::mem::take(&mut self.soc.spis_offers)
    }

    /// An I2C controller outside acts on the bus of `scl` and `sda`; what it did ended at `at`. `None` while the TWIS
    /// on these pins holds SCL low: the controller waits, and does the same again later. A bus without a TWIS answers
    /// as an empty one.
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

    /// What a debugger that comes now finds on a part with hardened access port protection (nRF52840 revision 3 on),
    /// given the word of UICR.APPROTECT as it was at the last reset, when the part takes it up: the debug port is open
    /// while UICR.APPROTECT and APPROTECT.DISABLE both say 0x5A and nothing was written to APPROTECT.FORCEPROTECT (PS
    /// 4.8, *Access port protection*). Erased flash reads 0xFFFF_FFFF there, and every reset closes the software's
    /// half, so a firmware that writes neither is locked.
    #[must_use]
    pub fn debug_port_open(&self, uicr_approtect: u32) -> bool {
        uicr_approtect & 0xFF == 0x5A && self.soc.debug_port_enabled()
    }

    /// Whether a debugger that is there now reaches memory and core through the AHB-AP: access port protection, as
    /// UICR, the firmware and CTRL-AP have made it since the last reset that took UICR up (PS 4.8).
    #[must_use]
    pub fn access_port_open(&self) -> bool {
        self.soc.access_port_open()
    }

    /// A register of CTRL-AP, by its address. The word of one that is not there is 0.
    #[must_use]
    pub fn ctrl_ap_read(&self, register: u8) -> u32 {
        self.soc.ctrl_ap_read(register)
    }

    /// Writes a register of CTRL-AP at `at`.
    pub fn ctrl_ap_write(&mut self, register: u8, value: u32, at: Cycle) -> CtrlRequest {
        self.soc.ctrl_ap_write(register, value, at)
    }

    /// CTRL-AP goes on to `to`: what it was told to erase is erased when its time has come. To be called as time
    /// passes, whenever a debugger is there.
    pub fn ctrl_ap_advance(&mut self, to: Cycle) {
        self.soc.ctrl_ap_advance(to);
    }

    /// From now on the 32 MHz crystal takes so long to start, ns; `None`: it never starts. One that runs goes on.
    pub fn set_hfxo_startup(&mut self, startup_ns: Option<u64>) {
        self.soc.set_hfxo_startup(startup_ns);
    }

    /// Whether the 32 MHz crystal would start, or runs.
    #[must_use]
    pub fn has_hfxo(&self) -> bool {
        self.soc.has_hfxo()
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
}

impl Part for Nrf52840 {
    const NAME: &'static str = "nRF52840";

    const RAM: &'static [(u32, usize)] = &[(0x2000_0000, 256 << 10)];
    const RESETS_ON_LOCKUP: bool = true;

    fn core(&self) -> Config {
        Config {
            lines: soc::INTERRUPT_LINES,
            priority_bits: 3,
            vector_table: 0,
            // No reference clock, and no calibration value (PS 4.1: SysTick counts the core clock).
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
        // A copy, so that an access to RAM is never put together in the host's memory.
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
        // Flash is from address 0 on, and nothing holds a read of it.
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

    /// From the PS: flash takes 2 wait states without the instruction cache and 3 on a miss of it, RAM none (4.1,
    /// *Electrical specification*, W_FLASH, W_FLASHCACHE, W_RAM). Assumed: one cycle where EasyDMA may be at the same
    /// RAM; 1 to 6 cycles through the bridge to the peripheral bus; none to 1 to GPIO, which is on the AHB.
    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32 {
        match bound {
            Bound::Best => u32::from((0x4000_0000..0x5000_0000).contains(&access.address)),
            Bound::Worst => self.soc.worst_wait_states(access),
        }
    }

    fn clock(&self) -> Clock {
        Clock { hz: CORE_HZ, ppb: self.soc.hf_ppb() }
    }

    /// As PS 5.3, *Reset behavior*, has it. What is to survive a power-on is the caller's to say: memory is left alone,
    /// but for RAM that was not retained through System OFF, which reads 0xA5 throughout after [`Reset::Wakeup`].
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
