//! The STM32F429ZI without its core, as a [`emulator_part::Part`].
//!
//! Section and table numbers are of RM0090. "Data sheet" is DS9405, and "errata" is ES0206.
//!
//! | covered | module |
//! |---|---|
//! | address map, memories, DMA transfers, interrupt lines, resets, events | this one |
//! | RCC, PWR, FLASH, GPIO and alternate functions | `rcc`, `pwr`, `flash`, `gpio`, `alternate` |
//! | power-on, brown-out, voltage detector | `supply` |
//! | SYSCFG, EXTI, DMA1 and DMA2, IWDG and WWDG | `syscfg`, `exti`, `dma`, `watchdog` |
//! | SPI, USART and UART, I2C, TIM1 to TIM14, RTC, RNG, ADC, DAC, CRC | a module each |
//! | CAN1 in loopback | `can` |
//!
//! | left out | effect |
//! |---|---|
//! | CAN2, SDIO, SAI, LTDC, Ethernet, DMA2D, USB, DCMI, FMC, I2S extensions | each use is a finding; they read 0 |
//! | what DBGMCU stops while a debugger holds the core | nothing stops; DBGMCU's registers keep the written values |
//! | stop and standby mode | a finding when a deep sleep begins, which is then an ordinary sleep |
//! | the bus matrix's arbitration, except in [`Part::wait_states`] | DMA transfers take no time |
//! | BOOT0 | it is low: the part boots from flash |
//!
//! ```
//! use cortex_m4::{Access, Purpose, Width};
//! use emulator_part::{Open, Part, Pin};
//! use stm32f429::{Oscillators, Stm32f429};
//!
//! let mut part = Stm32f429::new(Oscillators::default());
//! let (width, purpose) = (Width::Word, Purpose::Data);
//! let word = |address| Access { address, width, purpose, privileged: true, cycle: 0, pc: 0 };
//! part.write(&word(0x4002_3830), 1, &mut Open)?; // RCC_AHB1ENR: GPIOA
//! part.write(&word(0x4002_0000), 0xA800_0000 | 1 << 10, &mut Open)?; // GPIOA_MODER: PA5 is an output
//! part.write(&word(0x4002_0018), 1 << 5, &mut Open)?; // GPIOA_BSRR
//! assert!(part.pin(Pin::new(0, 5)));
//! assert!(part.findings().is_empty());
//! # Ok::<(), cortex_m4::BusError>(())
//! ```
#![forbid(unsafe_code)]

mod adc;
mod alternate;
mod can;
mod crc;
mod cx;
mod dac;
mod dbgmcu;
mod dma;
mod exti;
mod flash;
mod gpio;
mod i2c;
mod id;
mod pwr;
mod rcc;
#[cfg(test)]
mod rig;
mod rng;
mod rtc;
mod spi;
mod supply;
mod syscfg;
mod tim;
mod usart;
mod vectors;
mod watchdog;

use std::collections::BTreeMap;

use cortex_m4::{Access, Bound, BusError, Config, Purpose, Signals, Width};
use emulator_part::{
    Clock, Cycle, Finding, FindingKind, NEVER, Outside, Pad, Part, Pin, Pins, Ram, Reset, StuckBit, Supplied, UartFrame,
};

use adc::Adc;
use can::Can;
use crc::Crc;
use cx::{Clocks, Cx, Effects, Note, Outward, Peripheral, Signal, Trigger, UartPin};
use dac::Dac;
use dbgmcu::Dbgmcu;
use dma::{Direction, Dma, Turn};
use exti::Exti;
use flash::{FlashControl, Outcome};
use gpio::Gpio;
use i2c::I2c;
use pwr::Pwr;
use rcc::Rcc;
use rng::Rng;
use rtc::Rtc;
use spi::Spi;
use supply::Supervisors;
use syscfg::Syscfg;
use tim::Tim;
use usart::Usart;
use watchdog::{Iwdg, Wwdg};

/// Returns a pin by its port's letter and its number, as in `pin('D', 14)`.
///
/// # Panics
///
/// Panics on a port past K or a pin past 15.
#[must_use]
pub const fn pin(port: char, number: u8) -> Pin {
    assert!(port >= 'A' && port <= 'K' && number < 16, "a pin of the part");
    Pin::new(port as u8 - b'A', number)
}

/// The number of TIM2's interrupt, RM0090 table 63.
pub const TIM2_INTERRUPT: u16 = 28;
/// The number of the interrupt of EXTI line 3, RM0090 table 63.
pub const EXTI3_INTERRUPT: u16 = 9;
/// The number of interrupt lines, RM0090 table 63.
pub const INTERRUPTS: u16 = 91;

/// The address of the unique device ID, RM0090 39.1.
pub const UNIQUE_ID: u32 = 0x1FFF_7A10;
/// The address of the flash size, a halfword in KiB, RM0090 39.2.
pub const FLASH_SIZE: u32 = 0x1FFF_7A22;

/// The first address of SRAM1, SRAM2 and SRAM3, which are contiguous, RM0090 2.3.1.
const SRAM_BASE: u32 = 0x2000_0000;
const SRAM_SIZE: u32 = 192 << 10;
const SRAM1_SIZE: u32 = 112 << 10;
/// The first address of the core-coupled memory, which no DMA controller reaches, RM0090 2.3.1.
const CCM_BASE: u32 = 0x1000_0000;
const CCM_SIZE: u32 = 64 << 10;
const CCM_GATE: rcc::Gate = rcc::Gate { bus: 0, bit: 20 };
/// The first address of backup SRAM, RM0090 5.1.2.
const BACKUP_BASE: u32 = 0x4002_4000;
const BACKUP_SIZE: u32 = 4 << 10;
/// The first address of system memory, OTP and factory values. The option bytes are in the second half (RM0090 table
/// 6).
const FACTORY_BASE: u32 = 0x1FFF_0000;
const FACTORY_SIZE: u32 = 0x1_0000;
/// The option bytes of bank 1 (RM0090 3.9): read protection and user options. The write protection is 8 bytes further.
const OPTION_BYTES: u32 = 0x1FFF_C000;

/// The word that an APB peripheral gets for a narrow write: the value in all lanes (RM0090 2.1.6).
pub(crate) fn lanes(width: Width, value: u32) -> u32 {
    match width {
        Width::Byte => (value & 0xFF) * 0x0101_0101,
        Width::Half => (value & 0xFFFF) * 0x0001_0001,
        Width::Word => value,
    }
}

/// The oscillators that clock the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Oscillators {
    /// The nominal rate of the clock on OSC_IN, in hertz; `None` if nothing drives OSC_IN, as on a NUCLEO whose ST-LINK
    /// has no power.
    pub hse_hz: Option<u64>,
    /// How much faster the clock on OSC_IN is, in parts per billion.
    pub hse_ppb: i64,
    /// How much faster the internal 16 MHz oscillator (HSI) is, in parts per billion: ±1 % trimmed and at 25 °C, -8 %
    /// to +4.5 % from -40 °C to 105 °C (data sheet, table of the HSI oscillator's characteristics).
    pub hsi_ppb: i64,
    /// The rate in hertz of the internal low-speed oscillator, which clocks the independent watchdog: 17 to 47 kHz, 32
    /// kHz typical (data sheet, table of the LSI oscillator's characteristics).
    pub lsi_hz: u64,
}

impl Default for Oscillators {
    /// The oscillators of the NUCLEO board, with 8 MHz from the ST-LINK.
    fn default() -> Self {
        Self { hse_hz: Some(8_000_000), hse_ppb: 0, hsi_ppb: 0, lsi_hz: 32_000 }
    }
}

/// The key of a finding. Two findings with the same key count as one. The words are compared by their address.
type NoteKey = (FindingKind, &'static str, &'static str, Option<u32>);

/// The STM32F429ZI without its core.
#[derive(Clone, Debug)]
pub struct Stm32f429 {
    signals: Signals,
    now: Cycle,

    flash: FlashControl,
    factory: emulator_part::Flash,
    sram: Ram,
    ccm: Ram,
    backup: Ram,

    rcc: Rcc,
    clocks: Clocks,
    pwr: Pwr,
    supply: Supervisors,
    syscfg: Syscfg,
    exti: Exti,
    dbgmcu: Dbgmcu,
    gpio: Gpio,
    dma: [Dma; 2],
    iwdg: Iwdg,
    wwdg: Wwdg,
    spi: [Spi; 6],
    usart: [Usart; 8],
    i2c: [I2c; 3],
    tim: [Tim; 14],
    rtc: Rtc,
    rng: Rng,
    adc: Adc,
    crc: Crc,
    can: Can,
    dac: Dac,

    due: [Cycle; GROUPS * 8],
    group_due: [Cycle; GROUPS],
    next: Cycle,
    /// The instances, as bits, whose outputs must be checked after a call.
    dirty: u64,
    /// The DMA requests of each instance.
    requests: [u8; id::SCHEDULED],
    dma_pauses_until: [Cycle; 2],
    listened: [u8; id::SCHEDULED],
    hungry: u64,
    listening: [u8; 2],
    /// For each SPI, the two streams that exchange its bytes, if there are such streams.
    pairs: [Option<frames::Pair>; 6],
    /// The interrupt lines of TIM9 to TIM14, which share lines with TIM1 and TIM8. `own` has all other lines.
    shared: [u64; 4],
    own: [u64; 4],
    out: Effects,
    known: BTreeMap<NoteKey, usize>,
    findings: Vec<Finding>,
    reset_wanted: Option<Reset>,
}

const GROUPS: usize = id::SCHEDULED.div_ceil(8);

const MOST_FINDINGS: usize = 200;

/// The maximum number of DMA transfers at one cycle. A request may never end, for example that of a circular stream to
/// a register whose access does not clear the request. After this number of transfers the stream's controller pauses
/// for [`TRANSFER_CYCLES`] per transfer.
const MOST_TRANSFERS: u32 = 64;

/// The cycles of one DMA transfer if a request never ends. AN4031 ("DMA latency") counts a few cycles for arbitration
/// and an access on either port. The exact number depends on the bus matrix, which has no model.
const TRANSFER_CYCLES: Cycle = 8;

/// The maximum number of rounds of internal triggers at one cycle. Timers that trigger one another in a ring would
/// never end here, so the ring is cut with a finding.
const MOST_TRIGGERS: u32 = 64;

/// A bus master other than the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Master {
    /// The peripheral port of a DMA controller; 0 is DMA1.
    DmaPeripheral(u8),
    DmaMemory(u8),
}

macro_rules! with {
    ($self:ident, $id:expr, $p:ident => $body:expr) => {
        match $id {
            id::SPI..id::USART => {
                let $p = &mut $self.spi[usize::from($id - id::SPI)];
                $body
            }
            id::USART..id::I2C => {
                let $p = &mut $self.usart[usize::from($id - id::USART)];
                $body
            }
            id::I2C..id::TIM => {
                let $p = &mut $self.i2c[usize::from($id - id::I2C)];
                $body
            }
            id::TIM..id::RTC => {
                let $p = &mut $self.tim[usize::from($id - id::TIM)];
                $body
            }
            id::RTC => {
                let $p = &mut $self.rtc;
                $body
            }
            id::RNG => {
                let $p = &mut $self.rng;
                $body
            }
            id::ADC => {
                let $p = &mut $self.adc;
                $body
            }
            id::CRC => {
                let $p = &mut $self.crc;
                $body
            }
            _ => {
                let $p = &mut $self.can;
                $body
            }
        }
    };
}

macro_rules! cx {
    ($self:ident, $id:expr, $now:expr, $pc:expr) => {
        &mut Cx {
            now: $now,
            clocks: &$self.clocks,
            pads: &$self.gpio.pads,
            out: &mut $self.out,
            pc: $pc,
            name: id::NAMES[usize::from($id)],
        }
    };
}

// The modules below use the macros defined above.
mod bus;
mod frames;
mod part;
mod reactions;
mod transfers;

impl Stm32f429 {
    /// Makes the part on a 3.3 V rail, just powered on, with open pins and erased flash.
    #[must_use]
    pub fn new(oscillators: Oscillators) -> Self {
        let mut factory = emulator_part::Flash::new(FACTORY_SIZE as usize);
        let put = |bytes: &mut [u8], address: u32, values: &[u8]| {
            let at = (address - FACTORY_BASE) as usize;
            bytes[at..at + values.len()].copy_from_slice(values);
        };
        let bytes = factory.bytes_mut();
        // The default unique ID has coordinates, wafer, and lot in ASCII (RM0090 39.1).
        put(bytes, UNIQUE_ID, &[0x2A, 0x00, 0x31, 0x00, 0x0D, b'H', b'O', b'R', b'U', b'S', b'0', b'1']);
        put(bytes, FLASH_SIZE, &2048_u16.to_le_bytes());
        // The factory values are VREFINT, and the temperature sensor at 30 °C and at 110 °C, for 3.3 V (data sheet).
        for (nth, value) in adc::CALIBRATION.into_iter().enumerate() {
            put(bytes, 0x1FFF_7A2A + 2 * nth as u32, &value.to_le_bytes());
        }
        // The part is delivered with these option bytes: 0x0FFF_AAED without the lock bits (RM0090 3.9.10).
        put(bytes, OPTION_BYTES, &[0xEC, 0xAA]);
        put(bytes, OPTION_BYTES + 8, &[0xFF, 0x0F]);
        let mut part = Self {
            signals: Signals::default(),
            now: 0,
            flash: FlashControl::new(),
            factory,
            sram: Ram::new(SRAM_SIZE as usize),
            ccm: Ram::new(CCM_SIZE as usize),
            backup: Ram::new(BACKUP_SIZE as usize),
            rcc: Rcc::new(oscillators),
            clocks: Clocks::AFTER_RESET,
            pwr: Pwr::new(),
            supply: Supervisors::new(),
            syscfg: Syscfg::default(),
            dbgmcu: Dbgmcu::default(),
            exti: Exti::default(),
            gpio: Gpio::new(),
            dma: [Dma::new(0), Dma::new(1)],
            iwdg: Iwdg::new(),
            wwdg: Wwdg::new(),
            spi: std::array::from_fn(|nth| Spi::new(nth as u8 + 1)),
            usart: std::array::from_fn(|nth| Usart::new(nth as u8 + 1)),
            i2c: std::array::from_fn(|nth| I2c::new(nth as u8 + 1)),
            tim: std::array::from_fn(|nth| Tim::new(nth as u8 + 1)),
            rtc: Rtc::new(),
            rng: Rng::new(),
            adc: Adc::new(),
            crc: Crc::new(),
            can: Can::new(),
            dac: Dac::default(),
            due: [NEVER; GROUPS * 8],
            group_due: [NEVER; GROUPS],
            next: NEVER,
            dirty: 0,
            requests: [0; id::SCHEDULED],
            dma_pauses_until: [0; 2],
            listened: [0; id::SCHEDULED],
            hungry: 0,
            listening: [0; 2],
            pairs: [None; 6],
            shared: [0; 4],
            own: [0; 4],
            out: Effects::default(),
            known: BTreeMap::new(),
            findings: Vec::new(),
            reset_wanted: None,
        };
        part.clocks = part.rcc.clocks;
        part.rcc.clocks_changed = false;
        part.gpio.settle_all(0, &mut part.out);
        part.refresh_all();
        part
    }

    /// Changes the part's 96-bit unique device ID, RM0090 39.1.
    pub fn set_unique_id(&mut self, id: [u8; 12]) {
        let at = (UNIQUE_ID - FACTORY_BASE) as usize;
        self.factory.bytes_mut()[at..at + id.len()].copy_from_slice(&id);
    }

    /// Puts brown-out level 3 (2.7 V) into the option bytes, as `cargo xtask flash horus` does. The level applies from
    /// the next reset on.
    #[must_use]
    pub fn with_brown_out_level_3(mut self) -> Self {
        self.factory.bytes_mut()[(OPTION_BYTES - FACTORY_BASE) as usize] &= !(3 << 2);
        self
    }

    /// Seeds the random number generator. Parts with different seeds give different numbers.
    pub fn seed_random(&mut self, seed: u64) {
        self.rng.seed(seed);
    }

    /// Stops the oscillator on OSC_IN at `at`. With `CSSON` set, the hardware switches to HSI and raises the NMI.
    /// Without it, everything that the oscillator clocked stands still, including the core (RM0090 7.2.7). Does nothing
    /// if the oscillator does not run.
    pub fn fail_hse<O: Outside>(&mut self, at: Cycle, outside: &mut O) {
        self.advance(at, outside);
        self.rcc.fail_hse(at, self.pwr.supply(), &mut self.out);
        if std::mem::take(&mut self.rcc.failure) {
            self.out.triggers.push(Trigger::ClockFailure);
        }
        self.after_rcc(at, None, outside);
        self.settle(at, outside);
    }

    /// Makes the oscillator on OSC_IN faster by `ppb` parts per billion from `at` on; slower if it is negative.
    pub fn drift_hse<O: Outside>(&mut self, at: Cycle, ppb: i64, outside: &mut O) {
        self.advance(at, outside);
        self.rcc.drift_hse(at, ppb, self.pwr.supply(), &mut self.out);
        self.after_rcc(at, None, outside);
        self.settle(at, outside);
    }

    /// Starts the oscillator on OSC_IN at `at`, even if it was absent from the start. `HSERDY` then rises; the hardware
    /// switches nothing back by itself.
    pub fn restore_hse<O: Outside>(&mut self, at: Cycle, outside: &mut O) {
        self.advance(at, outside);
        self.rcc.restore_hse(at, self.pwr.supply(), &mut self.out);
        self.after_rcc(at, None, outside);
        self.settle(at, outside);
    }

    /// Makes I2C`number` report a bus error at `at` without a cause (ES0206 2.9.6).
    pub fn spurious_bus_error<O: Outside>(&mut self, number: u8, at: Cycle, outside: &mut O) {
        self.advance(at, outside);
        self.i2c[usize::from(number - 1)].spurious_bus_error();
        self.dirty |= 1 << id::i2c(number);
        self.settle(at, outside);
    }

    /// Whether OSC_IN carries a clock.
    #[must_use]
    pub fn has_hse(&self) -> bool {
        self.rcc.has_hse()
    }

    /// The state in which the part holds `pin` now.
    #[must_use]
    pub fn pad(&self, pin: Pin) -> Pad {
        self.gpio.pad(pin)
    }

    /// The voltage in microvolts to which channel `number` of the DAC (1 on PA4, 2 on PA5) drives its pin; `None` if
    /// the channel is off.
    #[must_use]
    pub fn dac_microvolts(&self, number: usize) -> Option<i32> {
        self.gpio.pads.dac[number - 1]
    }

    fn note(&mut self, note: Note) {
        let key = (note.kind, note.place, note.text, note.value);
        if let Some(&index) = self.known.get(&key) {
            let finding = &mut self.findings[index];
            finding.count = finding.count.saturating_add(1);
        } else if self.findings.len() < MOST_FINDINGS {
            self.known.insert(key, self.findings.len());
            let text = match note.value {
                Some(value) => format!("{} {value:#x}", note.text),
                None => note.text.to_owned(),
            };
            let Note { kind, at, pc, place, .. } = note;
            self.findings.push(Finding { kind, at, pc, place, text, count: 1 });
        }
    }

    fn find(&mut self, kind: FindingKind, pc: Option<u32>, place: &'static str, text: &'static str, value: u32) {
        self.note(Note { kind, at: self.now, pc, place, text, value: Some(value) });
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Memory {
    Flash,
    Sram,
    Ccm,
    Factory,
    Backup,
}

fn name(number: u8) -> &'static str {
    id::NAMES[usize::from(number)]
}

fn instance_of(signal: Signal) -> Option<u8> {
    match signal {
        Signal::Spi(n, _) => Some(id::spi(n)),
        Signal::Uart(n, _) => Some(id::usart(n)),
        Signal::I2c(n, _) => Some(id::i2c(n)),
        Signal::Tim(n, _) => Some(id::tim(n)),
        Signal::RtcReference => Some(id::RTC),
        Signal::Can(..) => Some(id::CAN1),
        Signal::Mco(_) => None,
    }
}

fn signals_of(number: u8) -> std::ops::Range<usize> {
    let (first, count) = match number {
        id::SPI..id::USART => (usize::from(number - id::SPI) * 5, 5),
        id::USART..id::I2C => (30 + usize::from(number - id::USART) * 5, 5),
        id::I2C..id::TIM => (70 + usize::from(number - id::I2C) * 3, 3),
        id::TIM..id::RTC => (79 + usize::from(number - id::TIM) * 9, 9),
        id::CAN1 => (208, 2),
        _ => (0, 0),
    };
    first..first + count
}
