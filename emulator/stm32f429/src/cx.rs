//! The interface between the part and its peripherals.
//!
//! A peripheral instance is a [`Peripheral`]: plain data that the part calls with a [`Cx`]. The [`Cx`] has the time and
//! the clocks, and takes the instance's effects. Methods return the levels of interrupts and DMA requests, and the part
//! asks for them after every other call. Through [`Wires`] the outside answers at once (a serial frame's bits, a
//! voltage). Only [`Peripheral::advance`] gets the [`Wires`], since no register access needs such an answer.
//!
//! Instances are made with the manual's number, such as `Spi::new(n)` and `Usart::new(n)` (UARTs too), or without one,
//! such as `Rtc::new()` and `Adc::new()` (all three with the common registers, offsets 0 to 0x3FF). A USART also has
//! `receive`, for [`emulator_part::Part::receive`]. Most RTC registers are reset with the backup domain only: the part
//! calls `Rtc::reset` for BDCR.BDRST and power-on, and `Rtc::system_reset` for other resets.

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, I2cAnswer, I2cEvent, NEVER, Outside, Pin, SpiFrame, UartFrame};

/// The core cycles of one tick of another clock, as an exact fraction. `num` is 0 while that clock stands still.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Ratio {
    num: u64,
    den: u64,
}

impl Ratio {
    pub(crate) const STOPPED: Self = Self { num: 0, den: 1 };

    pub(crate) fn new(num: u128, den: u128) -> Self {
        let (mut a, mut b) = (num, den);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let (mut num, mut den) = (num / a.max(1), den / a.max(1));
        // This loop never runs for real rates, which are whole hertz and parts per billion.
        while num > u128::from(u64::MAX) || den > u128::from(u64::MAX) {
            (num, den) = (num >> 1, den >> 1);
        }
        Self { num: num as u64, den: (den as u64).max(1) }
    }

    /// The core cycles of `ticks`, rounded up; [`NEVER`] if the clock stands still.
    pub(crate) fn cycles(self, ticks: u64) -> Cycle {
        if self.num == 0 {
            return NEVER;
        }
        u64::try_from((u128::from(ticks) * u128::from(self.num)).div_ceil(u128::from(self.den))).unwrap_or(NEVER)
    }

    pub(crate) fn ticks(self, cycles: Cycle) -> u64 {
        if self.num == 0 {
            return 0;
        }
        u64::try_from(u128::from(cycles) * u128::from(self.den) / u128::from(self.num)).unwrap_or(u64::MAX)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Clocks {
    /// The nominal rate of HCLK in hertz. It is never 0, since no instance is called while HCLK stands still.
    pub hclk_hz: u64,
    /// How much faster HCLK is, in parts per billion.
    pub ppb: i64,
    /// The core cycles of one PCLK1 cycle: 1, 2, 4, 8 or 16.
    pub pclk1: u32,
    /// The core cycles of one PCLK2 cycle: 1, 2, 4, 8 or 16.
    pub pclk2: u32,
    /// The core cycles of one tick of the timers on APB1. Their number is whole for every PPRE1 and TIMPRE.
    pub tim1: u32,
    pub tim2: u32,
    pub lsi: Ratio,
    pub lse: Ratio,
    pub hse: Ratio,
    /// The core cycles of one tick of the RTC's clock, after RTCSEL and RTCPRE.
    pub rtc: Ratio,
    /// The core cycles of one tick of the 48 MHz clock (PLL output Q) of the RNG.
    pub pll48: Ratio,
    /// The rate of PLL output Q in hertz, 0 while it stands still.
    pub pll48_hz: u64,
    /// Whether the manual calls the value of PLLQ wrong. The rate of the 48 MHz clock is then an assumption.
    pub pll48_undefined: bool,
    /// The core cycles of one tick of the I2S clock: PLLI2S output R, or the I2S_CKIN pin, which is not connected.
    pub i2s: Ratio,
}

impl Clocks {
    pub(crate) fn pclk1_hz(&self) -> u64 {
        self.hclk_hz / u64::from(self.pclk1)
    }

    pub(crate) fn pclk2_hz(&self) -> u64 {
        self.hclk_hz / u64::from(self.pclk2)
    }

    /// The length of `cycles` core cycles in picoseconds, to the nearest. The division has 128 bits and is slow, so
    /// frequent callers keep the result.
    pub(crate) fn ps(&self, cycles: u64) -> u64 {
        let scale = 1_000_000_000_i64 + self.ppb;
        let rate = u128::from(self.hclk_hz) * scale.unsigned_abs() as u128;
        ((u128::from(cycles) * 1_000_000_000_000 * 1_000_000_000 + rate / 2) / rate.max(1)) as u64
    }

    /// The core cycles of `ps` picoseconds, rounded up. The division has 128 bits, as in [`Clocks::ps`], so this is
    /// slow too.
    pub(crate) fn cycles_of_ps(&self, ps: u64) -> u64 {
        let scale = 1_000_000_000_i64 + self.ppb;
        let rate = u128::from(self.hclk_hz) * scale.unsigned_abs() as u128;
        // The common factor 10^6 is taken out first, because the product of a long time would exceed 128 bits.
        ((u128::from(ps) * (rate / 1_000_000)).div_ceil(1_000_000_000_000_000)) as u64
    }

    /// The clocks after a reset: HSI with nothing divided.
    pub(crate) const AFTER_RESET: Self = Self {
        hclk_hz: 16_000_000,
        ppb: 0,
        pclk1: 1,
        pclk2: 1,
        tim1: 1,
        tim2: 1,
        lsi: Ratio { num: 500, den: 1 },
        lse: Ratio::STOPPED,
        hse: Ratio::STOPPED,
        rtc: Ratio::STOPPED,
        pll48: Ratio::STOPPED,
        pll48_hz: 0,
        pll48_undefined: false,
        i2s: Ratio::STOPPED,
    };
}

/// A pin of an SPI or I2S: CK of I2S is SCK, WS is NSS, and SD is MOSI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SpiPin {
    Sck,
    Miso,
    Mosi,
    Nss,
    Mck,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UartPin {
    Tx,
    Rx,
    Ck,
    Cts,
    Rts,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum I2cPin {
    Scl,
    Sda,
    Smba,
}

/// A pin of a timer. The data sheet's pin TIM2_CH1/TIM2_ETR is `Ch1`, and [`Pads::pins`] of `Etr` finds it too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TimPin {
    Ch1,
    Ch2,
    Ch3,
    Ch4,
    Ch1N,
    Ch2N,
    Ch3N,
    Bkin,
    Etr,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CanPin {
    Tx,
    Rx,
}

/// The signal that an alternate function connects to a pin. Instances have the manual's numbers, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Signal {
    Spi(u8, SpiPin),
    Uart(u8, UartPin),
    I2c(u8, I2cPin),
    Tim(u8, TimPin),
    Can(u8, CanPin),
    Mco(u8),
    /// RTC_REFIN (RTC_50Hz), PB15.
    RtcReference,
}

pub(crate) const SIGNALS: usize = 212;

impl Signal {
    /// Returns the signal's number, below [`SIGNALS`]. No other signal has this number.
    #[inline(always)]
    pub(crate) const fn index(self) -> usize {
        match self {
            Self::Spi(n, pin) => (n as usize - 1) * 5 + pin as usize,
            Self::Uart(n, pin) => 30 + (n as usize - 1) * 5 + pin as usize,
            Self::I2c(n, pin) => 70 + (n as usize - 1) * 3 + pin as usize,
            Self::Tim(n, pin) => 79 + (n as usize - 1) * 9 + pin as usize,
            Self::Mco(n) => 205 + (n as usize - 1),
            Self::RtcReference => 207,
            Self::Can(n, pin) => 208 + (n as usize - 1) * 2 + pin as usize,
        }
    }
}

/// A trigger from one instance to others: the manual's internal triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trigger {
    /// Timer n's TRGO had a rising edge.
    Trgo(u8),
    /// Timer n's output compare of channel c (1 to 4) had a rising edge. The ADC and the ITR inputs of other timers use
    /// this.
    Compare(u8, u8),
    /// The EXTI line had an event (11 and 15 trigger the ADCs).
    Exti(u8),
    /// The clock security system detected that HSE failed. It is a break of TIM1 and TIM8.
    ClockFailure,
}

/// The pads as peripherals see them, kept by the GPIO.
#[derive(Clone, Debug)]
pub(crate) struct Pads {
    /// The pins to which each signal is connected.
    pub(crate) routes: [[Option<Pin>; 2]; SIGNALS],
    pub(crate) levels: [u16; 11],
    /// The pins of each port whose output is an open drain.
    pub(crate) open_drain: [u16; 11],
    /// The voltages to which the DAC drives PA4 and PA5, in microvolts.
    pub(crate) dac: [Option<i32>; 2],
}

impl Pads {
    pub(crate) const OPEN: Self =
        Self { routes: [[None; 2]; SIGNALS], levels: [0; 11], open_drain: [0; 11], dac: [None; 2] };

    /// Returns the pins in alternate function mode whose selected function is `signal`. If there are more than two, the
    /// lowest two by port and number are returned.
    #[inline(always)]
    pub(crate) fn pins(&self, signal: Signal) -> [Option<Pin>; 2] {
        self.routes[signal.index()]
    }

    pub(crate) fn level(&self, pin: Pin) -> bool {
        self.levels[usize::from(pin.port)] >> pin.number & 1 != 0
    }

    pub(crate) fn is_open_drain(&self, pin: Pin) -> bool {
        self.open_drain[usize::from(pin.port)] >> pin.number & 1 != 0
    }

    /// The level of the first pin that is connected to `signal`; `None` if no pin is. Each instance documents the
    /// meaning of `None`.
    pub(crate) fn input(&self, signal: Signal) -> Option<bool> {
        self.pins(signal)[0].map(|pin| self.level(pin))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Note {
    pub(crate) kind: FindingKind,
    pub(crate) at: Cycle,
    pub(crate) pc: Option<u32>,
    pub(crate) place: &'static str,
    pub(crate) text: &'static str,
    pub(crate) value: Option<u32>,
}

/// The effects of one call of an instance. The part empties them after the call.
#[derive(Clone, Debug, Default)]
pub(crate) struct Effects {
    pub(crate) notes: Vec<Note>,
    pub(crate) outputs: Vec<(Cycle, Signal, Option<bool>)>,
    pub(crate) triggers: Vec<Trigger>,
}

#[derive(Debug)]
pub(crate) struct Cx<'a> {
    /// The core cycle of the access, or of the event that is due.
    pub now: Cycle,
    pub clocks: &'a Clocks,
    pub pads: &'a Pads,
    pub out: &'a mut Effects,
    /// The address of the instruction that made the access.
    pub pc: Option<u32>,
    /// The name of the instance in the manual.
    pub name: &'static str,
}

impl Cx<'_> {
    pub(crate) fn find(&mut self, kind: FindingKind, text: &'static str) {
        self.out.notes.push(Note { kind, at: self.now, pc: self.pc, place: self.name, text, value: None });
    }

    /// Reports a finding with a number, in hexadecimal after `text`.
    pub(crate) fn find_value(&mut self, kind: FindingKind, text: &'static str, value: u32) {
        self.out.notes.push(Note { kind, at: self.now, pc: self.pc, place: self.name, text, value: Some(value) });
    }

    /// Returns the pins that are connected to `signal`, see [`Pads::pins`].
    #[inline(always)]
    pub(crate) fn pins(&self, signal: Signal) -> [Option<Pin>; 2] {
        self.pads.pins(signal)
    }

    /// Makes the instance drive the pins that are connected to `signal`; `None` stops that, as a reset does. Within a
    /// frame the pins keep the level that they have between frames.
    pub(crate) fn output(&mut self, signal: Signal, level: Option<bool>) {
        self.out.outputs.push((self.now, signal, level));
    }

    pub(crate) fn trigger(&mut self, trigger: Trigger) {
        self.out.triggers.push(trigger);
    }
}

/// The outside of the part.
pub(crate) trait Wires {
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32>;
    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame);
    fn i2c(&mut self, at: Cycle, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer;
    fn microvolts(&self, at: Cycle, pin: Pin) -> i32;
}

#[derive(Debug)]
pub(crate) struct Outward<'a, O>(pub(crate) &'a mut O);

impl<O: Outside> Wires for Outward<'_, O> {
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32> {
        self.0.spi(frame)
    }

    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame) {
        self.0.uart(at, pin, frame);
    }

    fn i2c(&mut self, at: Cycle, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer {
        self.0.i2c(at, scl, sda, event)
    }

    fn microvolts(&self, at: Cycle, pin: Pin) -> i32 {
        self.0.microvolts(at, pin)
    }
}

/// The part first calls [`Peripheral::advance`] for everything that is due before the present cycle. While RCC gates
/// the instance's clock off, accesses are blocked, but pending events still happen.
pub(crate) trait Peripheral: Clone {
    /// Reads the register at `offset`, which is aligned to `width`. A byte read at offset 1 returns bits 15:8 of the
    /// register at 0, in its low bits.
    fn read(&mut self, offset: u32, width: Width, cx: &mut Cx) -> u32;

    /// Writes the low `width` bytes of `value`. An APB peripheral that takes only words gets the value copied to all
    /// lanes (RM0090 2.1.6).
    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx);

    fn peek(&self, offset: u32, cx: &mut Cx) -> u32 {
        let _ = (offset, cx);
        0
    }

    /// The cycle at which the instance next acts by itself, or [`NEVER`]. This function is called often, so it must be
    /// fast.
    fn due(&self) -> Cycle;

    fn advance<W: Wires>(&mut self, cx: &mut Cx, wires: &mut W);

    /// The levels of the instance's interrupt outputs. USART, SPI, RNG, ADC, TIM2 to TIM7: bit 0. I2C: bit 0 event, bit
    /// 1 error. TIM1, TIM8: bit 0 break, 1 update, 2 trigger and commutation, 3 capture compare. TIM9 to TIM14: bit 0.
    /// RTC: bit 0 alarm (EXTI line 17), 1 tamper and time stamp (21), 2 wake-up (22).
    fn irq(&self) -> u32;

    /// The levels of the instance's DMA request outputs. USART, SPI, I2C: bit 0 RX, 1 TX. TIM: bit 0 UP, 1 to 4 CC1 to
    /// CC4, 5 TRIG, 6 COM. ADC: bit 0 to 2 for ADC1 to ADC3.
    fn dma(&self) -> u32 {
        0
    }

    /// Tells the instance that the DMA has served request `bit`. The DMA may have accessed another register than the
    /// data register. `left` is NDTR afterwards: 0 is the end of the transfer, and 1 is the signal EOT_1 for the I2C's
    /// LAST bit.
    fn dma_served(&mut self, bit: u8, left: u32, cx: &mut Cx) {
        let _ = (bit, left, cx);
    }

    /// Tells the instance that the clocks changed at `cx.now`. The instance converts its pending times from `old` to
    /// `cx.clocks`.
    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx);

    /// Resets the instance. The part itself stops driving the instance's outputs.
    fn reset(&mut self);

    /// Tells the instance that the level of `signal` changed, at its pin or by a connection to another pin.
    fn input(&mut self, signal: Signal, level: bool, cx: &mut Cx) {
        let _ = (signal, level, cx);
    }

    fn trigger(&mut self, trigger: Trigger, cx: &mut Cx) {
        let _ = (trigger, cx);
    }
}
