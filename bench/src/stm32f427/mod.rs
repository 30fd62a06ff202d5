//! The microcontroller of the HORUS board: an STM32F427/F429.
//!
//! Most of the part is rigless's: clock tree, ports, SPI, USART, I2C, DMA, TIM1 to TIM5 and TIM8, IWDG, flash
//! interface, ADC. This module adds what those lack and the HORUS firmware needs: the EXTI with SYSCFG's routing, the
//! simple timers, the window watchdog, the contents of flash, pins that keep what drives them across a reset, and pins
//! to watch. The F429 is this part with an LCD controller, which the firmware does not use.
//!
//! The board's clock is the ST-LINK's 8 MHz on OSC_IN with HSE in bypass. Its error shows in everything the firmware
//! clocks from HSE and in the core's own rate alike, see [`Oscillators`]. It can be absent, and it can fail and come
//! back in mid run ([`Stm32f427Part::fail_hse`], [`Stm32f427Part::restore_hse`]).

mod clocks;
mod exti;
mod upcounter;
mod wwdg;

use std::collections::BTreeMap;
use std::num::{NonZeroU32, NonZeroU64};
use std::ops::Range;

use rigless::chip::{Timeline, spi, uart};
use rigless::device::{ErasedDevice, Level, RegisterFile, ResetCause};
use rigless::emulator::{Access, AccessKind, CoreSpec};
use rigless::machine::armv7m;
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Bus;
use rigless::soc::stm32f427::generated::{flash, rcc, tim6, tim9, tim10, tim11};
use rigless::soc::stm32f427::peripherals::gpio::Pin;
use rigless::soc::stm32f427::peripherals::rcc::{Apb, Rcc};
use rigless::soc::stm32f427::peripherals::spi::Select;
use rigless::soc::stm32f427::{PORTS, Stm32f427};
use rigless::time::VirtualNanos;

use crate::engine::{FlashAction, Part, Rate, Supply};
use clocks::ClockControl;
pub use exti::{Exti, Syscfg};
pub use upcounter::{Rows, Upcounter};
pub use wwdg::Wwdg;

/// The interrupt of TIM2, RM0090 table 63.
pub const TIM2_INTERRUPT: u16 = 28;
/// The interrupt of EXTI line 3, RM0090 table 63.
pub const EXTI3_INTERRUPT: u16 = 9;

/// Priority bits of the interrupt controller, PM0214 section 4.3.
const PRIORITY_BITS: u8 = 4;
/// The core timer's reference clock is HCLK over eight, PM0214 section 4.5.
const REFCLK_DIVIDER: u32 = 8;
/// RAM on the core's data bus alone, RM0090 section 2.3.1: no DMA controller reaches it.
static CCM: Range<u64> = 0x1000_0000..0x1001_0000;
/// Where flash starts, and what one of its two banks holds: RM0090 table 6.
const FLASH_BASE: u64 = 0x0800_0000;
const BANK_BYTES: u64 = 1 << 20;
/// Address of `FLASH_CR`.
const FLASH_CR: u64 = 0x4002_3C10;

/// What clocks the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Oscillators {
    /// What OSC_IN is meant to carry, in hertz; `None` where nothing drives it, as on a NUCLEO whose ST-LINK has no
    /// power.
    pub hse_hz: Option<u64>,
    /// By how much it is fast, in parts per billion. Taken to the nearest hertz of `hse_hz`: 125 ppb at 8 MHz.
    pub hse_ppb: i64,
    /// By how much the internal 16 MHz oscillator (HSI) is fast, in parts per billion: ±1 % trimmed and at 25 °C, -8 %
    /// to +4.5 % from -40 °C to 105 °C (DS9405, table of the HSI oscillator's characteristics). What is clocked from it
    /// is taken to the nearest hertz.
    pub hsi_ppb: i64,
    /// The internal low-speed oscillator, which runs the independent watchdog: 17 to 47 kHz, 32 kHz typical (data sheet
    /// table 42).
    pub lsi_hz: u64,
    /// The core clock that the firmware sets in the end, in hertz: what SysTick counts, which rigless gives one rate
    /// for good. Everything else follows the clock tree, the rate of the instructions included.
    pub systick_hz: u64,
}

impl Default for Oscillators {
    /// The NUCLEO board with the HORUS firmware: 8 MHz from the ST-LINK, 144 MHz core.
    fn default() -> Self {
        Self { hse_hz: Some(8_000_000), hse_ppb: 0, hsi_ppb: 0, lsi_hz: 32_000, systick_hz: 144_000_000 }
    }
}

impl Oscillators {
    /// What OSC_IN really carries, zero where nothing drives it.
    fn hse(&self) -> u64 {
        let meant = self.hse_hz.unwrap_or(0);
        let off = i128::from(meant) * i128::from(self.hse_ppb);
        let rounded = (off + off.signum() * 500_000_000) / 1_000_000_000;
        u64::try_from(i128::from(meant) + rounded).unwrap_or(0)
    }

    /// rigless's clock control with these oscillators. What makes HSE absent is this module's, so it always has a rate
    /// here.
    fn control(&self) -> Rcc {
        let mut rcc = Rcc::new();
        rcc.attach_crystals(if self.hse_hz.is_some() { self.hse() } else { 8_000_000 }, 0);
        rcc.calibrate_lsi(self.lsi_hz);
        rcc
    }

    /// What SysTick really counts.
    fn systick(&self) -> u64 {
        let Some(meant) = self.hse_hz.filter(|&hz| hz > 0) else { return self.systick_hz };
        let hz = u128::from(self.systick_hz) * u128::from(self.hse()) / u128::from(meant);
        u64::try_from(hz).unwrap_or(0)
    }
}

/// A pin: port (0 is A) and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PinId {
    /// The port, `b'A'` to `b'K'`.
    port: u8,
    /// The pin, 0 to 15.
    pin: u8,
}

impl PinId {
    /// Pin `pin` of the port called `port`: `PinId::new('D', 14)`.
    ///
    /// # Panics
    ///
    /// On a port past K or a pin past 15.
    #[must_use]
    pub const fn new(port: char, pin: u8) -> Self {
        assert!(port >= 'A' && port <= 'K' && pin < 16, "a pin of the part");
        Self { port: port as u8 - b'A', pin }
    }

    fn port(self) -> usize {
        usize::from(self.port)
    }

    fn pin(self) -> Pin {
        Pin::new(self.pin).expect("checked when made")
    }
}

/// A watched pin changing its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEdge {
    /// The instant, in virtual nanoseconds.
    pub at: u64,
    /// The pin.
    pub pin: PinId,
    /// Whether it rose.
    pub high: bool,
}

/// A serial port, by its place in the part's models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SerialPort {
    /// USART1.
    Usart1 = 0,
    /// USART2.
    Usart2 = 1,
    /// USART3.
    Usart3 = 2,
    /// USART6.
    Usart6 = 3,
    /// UART7.
    Uart7 = 4,
    /// UART8.
    Uart8 = 5,
    /// UART4.
    Uart4 = 6,
    /// UART5.
    Uart5 = 7,
}

impl SerialPort {
    fn index(self) -> usize {
        self as usize
    }
}

/// The slots of the models this module adds.
#[derive(Clone, Copy, Debug)]
struct Slots {
    exti: usize,
    syscfg: usize,
    wwdg: usize,
    rcc: usize,
    flash: usize,
    tim6: [usize; 2],
    tim9: [usize; 2],
    tim10: [usize; 3],
    tim11: usize,
    ports: [usize; PORTS.len()],
}

/// The microcontroller.
#[derive(Debug)]
pub struct Stm32f427Part {
    mcu: Stm32f427,
    clocks: ClockControl,
    exti: Exti,
    syscfg: Syscfg,
    wwdg: Wwdg,
    tim6: [Upcounter<tim6::Register>; 2],
    tim9: [Upcounter<tim9::Register>; 2],
    tim10: [Upcounter<tim10::Register>; 3],
    tim11: Upcounter<tim11::Register>,
    slots: Slots,
    oscillators: Oscillators,
    /// The clock tree's registers as they were when the added models last heard of a rate.
    tree: [u64; 5],
    /// HCLK in that state, in hertz.
    hclk: u64,
    /// The next restart is the supply's doing.
    supply: Option<Supply>,
    driven: BTreeMap<PinId, Level>,
    watched: Vec<(PinId, Level)>,
    edges: Vec<PinEdge>,
}

impl Stm32f427Part {
    /// The part on a 3.3 V rail, with nothing on its pins.
    ///
    /// # Panics
    ///
    /// If the part's own tables are wrong, which no input changes.
    #[must_use]
    pub fn new(oscillators: Oscillators) -> Self {
        let mut mcu = Stm32f427::new().expect("the part's tables are whole");
        // A reset builds the next one from this one's oscillators.
        mcu.rcc = oscillators.control();
        mcu.set_supply(3300);
        let slot = |name: &'static str| mcu.bus().slot(name).expect("an instance of the part");
        let slots = Slots {
            exti: slot("EXTI"),
            syscfg: slot("SYSCFG"),
            wwdg: slot("WWDG"),
            rcc: slot("RCC"),
            flash: slot("FLASH"),
            tim6: ["TIM6", "TIM7"].map(slot),
            tim9: ["TIM9", "TIM12"].map(slot),
            tim10: ["TIM10", "TIM13", "TIM14"].map(slot),
            tim11: slot("TIM11"),
            ports: PORTS.map(slot),
        };
        let clocks =
            ClockControl::new(oscillators.control(), mcu.bus(), oscillators.hse_hz.is_some(), oscillators.hsi_ppb);
        mcu.rcc = oscillators.control();
        let mut part = Self {
            mcu,
            clocks,
            exti: Exti::default(),
            syscfg: Syscfg,
            wwdg: Wwdg::default(),
            tim6: Default::default(),
            tim9: Default::default(),
            tim10: Default::default(),
            tim11: Upcounter::default(),
            slots,
            oscillators,
            tree: [u64::MAX; 5],
            hclk: 0,
            supply: None,
            driven: BTreeMap::new(),
            watched: Vec::new(),
            edges: Vec::new(),
        };
        part.out_of_reset(VirtualNanos(0));
        part
    }

    /// The rigless part, for what this type does not cover.
    #[must_use]
    pub fn mcu(&self) -> &Stm32f427 {
        &self.mcu
    }

    /// The rigless part, to attach chips this type has no method for.
    pub fn mcu_mut(&mut self) -> &mut Stm32f427 {
        &mut self.mcu
    }

    /// Drives `pin` from outside from `at` on (virtual ns). A level that is already there changes nothing. What drives
    /// a pin goes on through a reset of the part.
    pub fn drive_pin(&mut self, at: u64, pin: PinId, high: bool) -> bool {
        let level = Level::from(high);
        if self.driven.insert(pin, level) == Some(level) {
            return false;
        }
        self.mcu.drive_port(VirtualNanos(at), pin.port(), |port, registers, context| {
            port.drive(pin.pin(), Some(level), registers, context);
        });
        true
    }

    /// The level on `pin` now, whoever drives it.
    #[must_use]
    pub fn pin(&self, pin: PinId) -> bool {
        self.level(pin) == Level::High
    }

    fn level(&self, pin: PinId) -> Level {
        let registers = self.mcu.bus().slots()[self.slots.ports[pin.port()]].registers();
        self.mcu.gpio[pin.port()].level(pin.pin(), registers)
    }

    /// Records every change of `pin` from now on.
    pub fn watch_pin(&mut self, pin: PinId) {
        if self.watched.iter().all(|&(watched, _)| watched != pin) {
            self.watched.push((pin, self.level(pin)));
        }
    }

    /// The changes of watched pins that were not taken yet, in order.
    #[must_use]
    pub fn edges(&self) -> &[PinEdge] {
        &self.edges
    }

    /// Takes the changes of watched pins.
    pub fn take_edges(&mut self) -> Vec<PinEdge> {
        std::mem::take(&mut self.edges)
    }

    /// Hangs `chip` on SPI `interface` (1 to 6), selected while `select` is low. Answers its place among the
    /// interface's chips.
    ///
    /// # Panics
    ///
    /// On an interface the part does not have.
    pub fn attach_spi(&mut self, interface: usize, chip: impl spi::Peer, select: PinId) -> usize {
        let spi = &mut self.mcu.spi[interface - 1];
        let place = spi.peers().count();
        let select = Select { port: PORTS[select.port()], pin: select.pin(), active: Level::Low };
        spi.attach_selected(chip, select);
        place
    }

    /// The chip at `place` on SPI `interface`, as the type it was attached as.
    pub fn spi_chip<C: spi::Peer>(&mut self, interface: usize, place: usize) -> Option<&mut C> {
        self.mcu.spi.get_mut(interface.checked_sub(1)?)?.chip_mut(place)
    }

    /// Lets the chip at `place` on SPI `interface` act at `at`, with a [`Timeline`] to schedule its own events on.
    pub fn with_spi_chip<C: spi::Peer, T>(
        &mut self,
        at: u64,
        interface: usize,
        place: usize,
        act: impl FnOnce(&mut C, &mut Timeline<'_, '_>) -> T,
    ) -> Option<T> {
        self.mcu.drive_serial(VirtualNanos(at), interface.checked_sub(1)?, |spi, _, context| {
            spi.chip_mut::<C>(place).map(|chip| act(chip, &mut Timeline::new(context)))
        })
    }

    /// Hangs `chip` on the far end of serial port `port`.
    pub fn attach_serial(&mut self, port: SerialPort, chip: impl uart::Peer) {
        self.mcu.usart[port.index()].attach(chip);
    }

    /// The chip on serial port `port`, as the type it was attached as.
    pub fn serial_chip<C: uart::Peer>(&mut self, port: SerialPort) -> Option<&mut C> {
        self.mcu.usart[port.index()].chip_mut()
    }

    /// Lets the chip on serial port `port` act at `at`, with a [`Timeline`] to schedule its own events on. A chip that
    /// sends on its own schedules its first event this way.
    pub fn with_serial_chip<C: uart::Peer, T>(
        &mut self,
        at: u64,
        port: SerialPort,
        act: impl FnOnce(&mut C, &mut Timeline<'_, '_>) -> T,
    ) -> Option<T> {
        self.mcu.drive_serial_port(VirtualNanos(at), port.index(), |usart, _, context| {
            usart.chip_mut::<C>().map(|chip| act(chip, &mut Timeline::new(context)))
        })
    }

    /// The oscillator on OSC_IN stops at `at` (virtual ns). With `CSSON` set the hardware switches what ran from it to
    /// HSI and raises the NMI; without, whatever it clocked stands still, the core with it (RM0090 section 6.2.7).
    /// Nothing happens where it does not run.
    pub fn fail_hse(&mut self, at: u64) {
        let (registers, mut context) = self.mcu.bus_mut().drive(VirtualNanos(at), self.slots.rcc);
        self.clocks.fail_hse(registers, &mut context);
    }

    /// The oscillator on OSC_IN runs again from `at` (virtual ns) on, also one that was absent from the start. Software
    /// that waits for `HSERDY` sees it rise; nothing switches back by itself.
    pub fn restore_hse(&mut self, at: u64) {
        let (registers, mut context) = self.mcu.bus_mut().drive(VirtualNanos(at), self.slots.rcc);
        self.clocks.restore_hse(registers, &mut context);
    }

    /// Whether OSC_IN carries a clock.
    #[must_use]
    pub fn has_hse(&self) -> bool {
        self.clocks.hse()
    }

    fn rcc(&self) -> &RegisterFile {
        self.mcu.bus().slots()[self.slots.rcc].registers()
    }

    /// What a reset leaves to this module: reset values the tables lack, and the levels that are still on the pins.
    fn out_of_reset(&mut self, at: VirtualNanos) {
        let bus = self.mcu.bus_mut();
        for slot in self.slots.tim6 {
            Upcounter::<tim6::Register>::set_reset_values(bus.slot_mut(slot).registers_mut());
        }
        for slot in self.slots.tim9 {
            Upcounter::<tim9::Register>::set_reset_values(bus.slot_mut(slot).registers_mut());
        }
        for slot in self.slots.tim10 {
            Upcounter::<tim10::Register>::set_reset_values(bus.slot_mut(slot).registers_mut());
        }
        Upcounter::<tim11::Register>::set_reset_values(bus.slot_mut(self.slots.tim11).registers_mut());
        for (&pin, &level) in &self.driven {
            self.mcu.drive_port(at, pin.port(), |port, registers, context| {
                port.drive(pin.pin(), Some(level), registers, context);
            });
        }
        let (registers, mut context) = self.mcu.bus_mut().drive(at, self.slots.rcc);
        self.clocks.take_over(registers, &mut context);
        self.tree = [u64::MAX; 5];
        self.follow_clock_tree(at);
    }

    /// Tells the added models what they run on, after a change of the clock tree.
    fn follow_clock_tree(&mut self, at: VirtualNanos) {
        use rcc::Register::{Cfgr, Cr, Dckcfgr, Pllcfgr};
        let registers = self.rcc();
        let [cr, pll, cfg, dck] = [Cr, Pllcfgr, Cfgr, Dckcfgr].map(|register| registers.get(register));
        let tree = [cr, pll, cfg, dck, u64::from(self.clocks.hse())];
        if tree == self.tree {
            return;
        }
        let apb1 = self.clocks.timer_clock(registers, Apb::One);
        let apb2 = self.clocks.timer_clock(registers, Apb::Two);
        let pclk1 = self.clocks.pclk1(registers);
        let hclk = self.clocks.hclk(registers);
        self.tree = tree;
        self.hclk = hclk;
        let Self { mcu, wwdg, tim6, tim9, tim10, tim11, slots, .. } = self;
        let bus = mcu.bus_mut();
        for (timer, slot) in tim6.iter_mut().zip(slots.tim6) {
            let (registers, mut context) = bus.drive(at, slot);
            timer.set_clock(apb1, registers, &mut context);
        }
        // TIM9, TIM10 and TIM11 are on APB2, TIM12, TIM13 and TIM14 on APB1: RM0090 table 1.
        for (timer, (slot, hz)) in tim9.iter_mut().zip(slots.tim9.into_iter().zip([apb2, apb1])) {
            let (registers, mut context) = bus.drive(at, slot);
            timer.set_clock(hz, registers, &mut context);
        }
        for (timer, (slot, hz)) in tim10.iter_mut().zip(slots.tim10.into_iter().zip([apb2, apb1, apb1])) {
            let (registers, mut context) = bus.drive(at, slot);
            timer.set_clock(hz, registers, &mut context);
        }
        let (registers, mut context) = bus.drive(at, slots.tim11);
        tim11.set_clock(apb2, registers, &mut context);
        let (registers, mut context) = bus.drive(at, slots.wwdg);
        wwdg.set_clock(pclk1, registers, &mut context);
    }

    /// Samples the pins the EXTI listens to. Answers whether a line became pending.
    fn sample_lines(&mut self, at: VirtualNanos) -> bool {
        let slots = self.mcu.bus().slots();
        let mut lines = Exti::listening(slots[self.slots.exti].registers());
        let mut pending = false;
        while lines != 0 {
            let line = u8::try_from(lines.trailing_zeros()).expect("below 16");
            lines &= lines - 1;
            let port = Syscfg::port_of(line, self.mcu.bus().slots()[self.slots.syscfg].registers());
            let Ok(port) = u8::try_from(port.min(PORTS.len() - 1)) else { continue };
            let level = self.level(PinId { port, pin: line });
            if self.exti.differs(line, level) {
                let (registers, mut context) = self.mcu.bus_mut().drive(at, self.slots.exti);
                pending |= self.exti.sample(line, level, registers, &mut context);
            }
        }
        pending
    }

    /// Restarts the rigless part. It knows neither a window watchdog nor a failing supply: those go through as the
    /// core's own reset and the pin's, and the flags of RM0090 section 6.3.21 are put in afterwards.
    fn reset_by(&mut self, at: VirtualNanos, cause: ResetCause) {
        const BORRSTF: u64 = 1 << 25;
        const PINRSTF: u64 = 1 << 26;
        const PORRSTF: u64 = 1 << 27;
        const SFTRSTF: u64 = 1 << 28;
        const WWDGRSTF: u64 = 1 << 30;
        const EVERY: u64 = 0xFE00_0000;
        let before = self.rcc().get(rcc::Register::Csr);
        let by_wwdg = cause == ResetCause::Model("WWDG");
        let supply = self.supply.take();
        let stands_in = match (cause, supply) {
            (_, Some(_)) | (ResetCause::PowerOn, _) => ResetCause::Pin,
            _ if by_wwdg => ResetCause::Core,
            _ => cause,
        };
        self.mcu.reset(at, stands_in);
        self.clocks.restarted(&mut self.mcu.rcc);
        let registers = self.mcu.bus_mut().slot_mut(self.slots.rcc).registers_mut();
        let now = registers.get(rcc::Register::Csr);
        let supply = supply.or((cause == ResetCause::PowerOn).then_some(Supply::PowerOn));
        let flags = match supply {
            // "Reset by power reset only": nothing of the time before is left.
            Some(Supply::PowerOn) => PORRSTF | BORRSTF | PINRSTF,
            Some(Supply::BrownOut) => BORRSTF | PINRSTF,
            None if by_wwdg => now & EVERY & !SFTRSTF | before & SFTRSTF | WWDGRSTF,
            None => now & EVERY,
        };
        registers.set(rcc::Register::Csr, now & !EVERY | flags);
        if supply == Some(Supply::PowerOn) {
            // The board's VBAT is its VDD, section 6.1.3.
            registers.set(rcc::Register::Bdcr, 0);
        }
    }

    fn flash_registers(&self) -> [u64; 2] {
        let registers = self.mcu.bus().slots()[self.slots.flash].registers();
        [registers.get(flash::Register::Cr), registers.get(flash::Register::Sr)]
    }

    fn raise_flash_error(&mut self, flag: u64) {
        let registers = self.mcu.bus_mut().slot_mut(self.slots.flash).registers_mut();
        registers.set(flash::Register::Sr, registers.get(flash::Register::Sr) | flag);
    }
}

impl Mcu for Stm32f427Part {
    fn bus(&self) -> &Bus {
        self.mcu.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.mcu.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.reset_by(at, cause);
        self.exti = Exti::default();
        self.wwdg = Wwdg::default();
        self.tim6 = Default::default();
        self.tim9 = Default::default();
        self.tim10 = Default::default();
        self.tim11 = Upcounter::default();
        self.out_of_reset(at);
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.mcu.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let Self { mcu, clocks, exti, syscfg, wwdg, tim6, tim9, tim10, tim11, slots, .. } = self;
        let added: Option<&mut dyn ErasedDevice> = match slot {
            slot if slot == slots.rcc => Some(clocks),
            slot if slot == slots.exti => Some(exti),
            slot if slot == slots.syscfg => Some(syscfg),
            slot if slot == slots.wwdg => Some(wwdg),
            slot if slot == slots.tim11 => Some(tim11),
            slot if slots.tim6.contains(&slot) => at(tim6, &slots.tim6, slot),
            slot if slots.tim9.contains(&slot) => at(tim9, &slots.tim9, slot),
            slot if slots.tim10.contains(&slot) => at(tim10, &slots.tim10, slot),
            slot => return mcu.split(slot),
        };
        (mcu.bus_mut(), added)
    }
}

/// The timer whose slot is `slot`.
fn at<'a, R: Rows>(timers: &'a mut [Upcounter<R>], slots: &[usize], slot: usize) -> Option<&'a mut dyn ErasedDevice> {
    let nth = slots.iter().position(|&own| own == slot)?;
    timers.get_mut(nth).map(|timer| -> &mut dyn ErasedDevice { timer })
}

impl Part for Stm32f427Part {
    const NAME: &'static str = "STM32F427";

    fn core(&self) -> CoreSpec {
        let hz = NonZeroU64::new(self.oscillators.systick()).expect("a running clock");
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: hz,
            interrupt_lines: NonZeroU32::from(
                std::num::NonZeroU16::new(self.mcu.cpu().interrupt_lines).expect("a part with interrupts"),
            ),
            priority_bits: PRIORITY_BITS,
            refclk_divider: NonZeroU32::new(REFCLK_DIVIDER).expect("a divider"),
            instructions_per_second: hz,
            boot: "flash",
        };
        core.spec_with_parts(
            &rigless::cpu::armv7m::windows(self.mcu.bus()),
            armv7m::Fpu::FpV4Sp,
            armv7m::MpuRegions::Eight,
        )
    }

    /// HCLK, of the oscillator as it is.
    fn rate(&self) -> Rate {
        Rate { hz: self.hclk, ppb: 0 }
    }

    /// The clock security system's, the only one of the part: RM0090 section 6.2.7.
    fn nmi(&self) -> bool {
        ClockControl::nmi(self.rcc())
    }

    fn supply_failed(&mut self, how: Supply) {
        self.supply = Some(how);
    }

    fn core_only(&self) -> &'static [Range<u64>] {
        std::slice::from_ref(&CCM)
    }

    fn settle(&mut self, now: u64) -> bool {
        let at = VirtualNanos(now);
        self.follow_clock_tree(at);
        for nth in 0..self.watched.len() {
            let (pin, was) = self.watched[nth];
            let level = self.level(pin);
            if level != was {
                self.watched[nth].1 = level;
                self.edges.push(PinEdge { at: now, pin, high: level == Level::High });
            }
        }
        self.sample_lines(at)
    }

    /// RM0090 section 3.6: what the interface's registers make of a store into flash, and of a started erase. The model
    /// sets `BSY` only for an erase it accepts, so write protection counts. A programmed word is there at once, without
    /// its 16 µs.
    fn flash(&mut self, access: &Access) -> FlashAction {
        const PG: u64 = 1 << 0;
        const SER: u64 = 1 << 1;
        const MER: u64 = 1 << 2;
        const MER1: u64 = 1 << 15;
        const STRT: u64 = 1 << 16;
        const LOCK: u64 = 1 << 31;
        const PGPERR: u64 = 1 << 6;
        const PGSERR: u64 = 1 << 7;
        const BSY: u64 = 1 << 16;
        if access.kind != AccessKind::Write {
            return FlashAction::None;
        }
        let in_flash = (FLASH_BASE..FLASH_BASE + 2 * BANK_BYTES).contains(&access.address);
        if !in_flash && access.address != FLASH_CR {
            return FlashAction::None;
        }
        let [control, status] = self.flash_registers();
        if in_flash {
            if control & (LOCK | PG) != PG {
                self.raise_flash_error(PGSERR);
                return FlashAction::None;
            }
            // PSIZE: 8, 16, 32 or 64 bits in one access, section 3.6.2.
            if 8_u32 << (control >> 8 & 3) != u32::from(access.width.bits()) {
                self.raise_flash_error(PGPERR);
                return FlashAction::None;
            }
            return FlashAction::Program;
        }
        if access.value & STRT == 0 || status & BSY == 0 {
            return FlashAction::None;
        }
        if control & SER != 0 {
            return FlashAction::Erase(sector(control >> 3 & 0x1F));
        }
        match (control & MER != 0, control & MER1 != 0) {
            (true, true) => FlashAction::Erase(FLASH_BASE..FLASH_BASE + 2 * BANK_BYTES),
            (true, false) => FlashAction::Erase(FLASH_BASE..FLASH_BASE + BANK_BYTES),
            (false, true) => FlashAction::Erase(FLASH_BASE + BANK_BYTES..FLASH_BASE + 2 * BANK_BYTES),
            (false, false) => FlashAction::None,
        }
    }
}

/// The addresses of a sector by `SNB`, RM0090 table 6 and section 3.9.8: four of 16 KiB, one of 64 KiB and seven of 128
/// KiB in each bank, the second bank's numbered from 16.
fn sector(number: u64) -> Range<u64> {
    const KIB: u64 = 1 << 10;
    let bank = FLASH_BASE + (number >> 4) * BANK_BYTES;
    let (offset, size) = match number & 0xF {
        small @ 0..=3 => (small * 16 * KIB, 16 * KIB),
        4 => (64 * KIB, 64 * KIB),
        large => ((large - 4) * 128 * KIB, 128 * KIB),
    };
    bank + offset..bank + offset + size
}
