//! The interface between the part and its peripherals.
//!
//! A peripheral instance is a [`Peripheral`]: plain data that the part calls with a [`Cx`]. The [`Cx`] has the time and
//! the clocks, and takes the instance's effects. Levels that an instance drives all the time (interrupts, DMA requests)
//! are returned by methods, which the part calls after every other call. Answers that the outside of the part gives at
//! once (a serial frame's bits, a voltage) go through [`Wires`]. Only [`Peripheral::advance`] gets these, since on
//! silicon, too, no such answer comes within a register access.
//!
//! Instances are made by `Spi::new(n)`, `Usart::new(n)` (UARTs too), `I2c::new(n)`, `Tim::new(n)` with the manual's
//! number, and by `Rtc::new()`, `Rng::new()`, `Adc::new()` (all three with the common registers, offsets 0 to 0x3FF)
//! and `Crc::new()`. A USART has one more method for [`emulator_part::Part::receive`]: `receive(&mut self, begins:
//! Cycle, frame: &UartFrame, cx: &mut Cx)`. By RM0090, most RTC registers are reset with the backup domain only: the
//! part calls `Rtc::reset` for BDCR.BDRST and power-on only, and `Rtc::system_reset` for other resets.

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, I2cAnswer, I2cEvent, NEVER, Outside, Pin, SpiFrame, UartFrame};

/// The number of core cycles that one tick of another clock takes, as an exact fraction. `num` is 0 while that clock
/// stands still.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Ratio {
    num: u64,
    den: u64,
}

impl Ratio {
    /// The ratio of a clock that stands still.
    pub(crate) const STOPPED: Self = Self { num: 0, den: 1 };

    /// Makes the ratio `num / den` core cycles a tick, in lowest terms.
    pub(crate) fn new(num: u128, den: u128) -> Self {
        let (mut a, mut b) = (num, den);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        let (mut num, mut den) = (num / a.max(1), den / a.max(1));
        // Real rates are whole hertz and parts per billion, so this loop never runs for them.
        while num > u128::from(u64::MAX) || den > u128::from(u64::MAX) {
            (num, den) = (num >> 1, den >> 1);
        }
        Self { num: num as u64, den: (den as u64).max(1) }
    }

    /// The core cycles that `ticks` take, rounded up, or [`NEVER`] where the clock stands still.
    pub(crate) fn cycles(self, ticks: u64) -> Cycle {
        if self.num == 0 {
            return NEVER;
        }
        u64::try_from((u128::from(ticks) * u128::from(self.num)).div_ceil(u128::from(self.den))).unwrap_or(NEVER)
    }

    /// The number of whole ticks in `cycles`, the inverse of [`Ratio::cycles`].
    pub(crate) fn ticks(self, cycles: Cycle) -> u64 {
        if self.num == 0 {
            return 0;
        }
        u64::try_from(u128::from(cycles) * u128::from(self.den) / u128::from(self.num)).unwrap_or(u64::MAX)
    }
}

/// The clocks that peripherals need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Clocks {
    /// The nominal rate of HCLK in hertz, as if its source were exact. The rate is never 0, since no instance is called
    /// while HCLK has stopped.
    pub hclk_hz: u64,
    /// How much faster HCLK really is, in parts per billion.
    pub ppb: i64,
    /// The core cycles of one PCLK1 cycle: 1, 2, 4, 8 or 16.
    pub pclk1: u32,
    /// The core cycles of one PCLK2 cycle: 1, 2, 4, 8 or 16.
    pub pclk2: u32,
    /// The core cycles of one tick of the timers on APB1, which is a whole number in every setting of PPRE1 and TIMPRE.
    pub tim1: u32,
    /// The core cycles of one tick of the timers on APB2.
    pub tim2: u32,
    /// The core cycles of one tick of LSI.
    pub lsi: Ratio,
    /// The core cycles of one tick of LSE.
    pub lse: Ratio,
    /// The core cycles of one tick of HSE.
    pub hse: Ratio,
    /// The core cycles of one tick of the RTC's clock, after RTCSEL (and RTCPRE for HSE).
    pub rtc: Ratio,
    /// The core cycles of one tick of the 48 MHz clock (PLL output Q), which the RNG needs.
    pub pll48: Ratio,
    /// The rate of PLL output Q in hertz, 0 while it stands still.
    pub pll48_hz: u64,
    /// Whether PLLQ has a value that the manual calls wrong, so that the rate of this clock is an assumption.
    pub pll48_undefined: bool,
    /// The core cycles of one tick of the I2S clock (PLLI2S output R, or the I2S_CKIN pin, to which nothing is
    /// connected).
    pub i2s: Ratio,
}

impl Clocks {
    /// PCLK1 in hertz.
    pub(crate) fn pclk1_hz(&self) -> u64 {
        self.hclk_hz / u64::from(self.pclk1)
    }

    /// PCLK2 in hertz.
    pub(crate) fn pclk2_hz(&self) -> u64 {
        self.hclk_hz / u64::from(self.pclk2)
    }

    /// The time that `cycles` core cycles take, in picoseconds, to the nearest, for the bit times of frames. The
    /// function divides 128-bit numbers, so callers that need the result often should keep it.
    pub(crate) fn ps(&self, cycles: u64) -> u64 {
        let scale = 1_000_000_000_i64 + self.ppb;
        let rate = u128::from(self.hclk_hz) * scale.unsigned_abs() as u128;
        ((u128::from(cycles) * 1_000_000_000_000 * 1_000_000_000 + rate / 2) / rate.max(1)) as u64
    }

    /// The number of whole core cycles in `ps` picoseconds, rounded up. The function is as slow as [`Clocks::ps`].
    pub(crate) fn cycles_of_ps(&self, ps: u64) -> u64 {
        let scale = 1_000_000_000_i64 + self.ppb;
        let rate = u128::from(self.hclk_hz) * scale.unsigned_abs() as u128;
        // For long times, the product of rate and 10^21 exceeds 128 bits, so the common factor 10^6 is taken out first.
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

/// A pin of a USART or UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UartPin {
    Tx,
    Rx,
    Ck,
    Cts,
    Rts,
}

/// A pin of an I2C.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum I2cPin {
    Scl,
    Sda,
    Smba,
}

/// A pin of a timer. On TIM2, ETR shares a pin with channel 1 (data sheet: TIM2_CH1/TIM2_ETR). Such a pin is `Ch1`, and
/// [`Pads::pins`] of `Etr` finds it too.
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

/// A pin of a CAN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CanPin {
    Tx,
    Rx,
}

/// The signal that an alternate function connects to a pin. Instances are numbered from 1, as in the manual.
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

/// The number of values of [`Signal::index`].
pub(crate) const SIGNALS: usize = 212;

impl Signal {
    /// A number below [`SIGNALS`] that no other signal has.
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

/// A trigger that one instance sends to others without software: the manual's internal triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trigger {
    /// Timer n's TRGO had a rising edge.
    Trgo(u8),
    /// Timer n's output compare of channel c (1 to 4) had a rising edge. In this way TIM10 to TIM14 reach the ITR
    /// inputs of other timers, and channels trigger the ADC.
    Compare(u8, u8),
    /// The EXTI line had an event (11 and 15 trigger the ADCs).
    Exti(u8),
    /// The clock security system detected a failure of HSE, which is a break of TIM1 and TIM8.
    ClockFailure,
}

/// The pads as peripherals see them. The GPIO ports keep this state.
#[derive(Clone, Debug)]
pub(crate) struct Pads {
    /// The pins to which each signal is connected.
    pub(crate) routes: [[Option<Pin>; 2]; SIGNALS],
    /// The levels on the pins of each port.
    pub(crate) levels: [u16; 11],
    /// The pins of each port whose output is an open drain.
    pub(crate) open_drain: [u16; 11],
    /// The voltages to which the DAC drives PA4 and PA5, in microvolts.
    pub(crate) dac: [Option<i32>; 2],
}

impl Pads {
    /// Pads with no signal connected and all levels low.
    pub(crate) const OPEN: Self =
        Self { routes: [[None; 2]; SIGNALS], levels: [0; 11], open_drain: [0; 11], dac: [None; 2] };

    /// The pins in alternate function mode whose selected function is `signal`. If there are more than two, the lowest
    /// two by port and number.
    #[inline(always)]
    pub(crate) fn pins(&self, signal: Signal) -> [Option<Pin>; 2] {
        self.routes[signal.index()]
    }

    /// The level on `pin`, whoever drives it. A floating pin is low.
    pub(crate) fn level(&self, pin: Pin) -> bool {
        self.levels[usize::from(pin.port)] >> pin.number & 1 != 0
    }

    /// Whether `pin` is an open drain.
    pub(crate) fn is_open_drain(&self, pin: Pin) -> bool {
        self.open_drain[usize::from(pin.port)] >> pin.number & 1 != 0
    }

    /// The level of the first pin that is connected to `signal`, `None` where none is. Each instance documents how it
    /// treats `None`.
    pub(crate) fn input(&self, signal: Signal) -> Option<bool> {
        self.pins(signal)[0].map(|pin| self.level(pin))
    }
}

/// A finding that an instance reports: static words, and an optional number to append.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Note {
    pub(crate) kind: FindingKind,
    pub(crate) at: Cycle,
    pub(crate) pc: Option<u32>,
    pub(crate) place: &'static str,
    pub(crate) text: &'static str,
    pub(crate) value: Option<u32>,
}

/// The effects of one call of an instance. The part empties them after the call, and the vectors keep their capacity.
#[derive(Clone, Debug, Default)]
pub(crate) struct Effects {
    pub(crate) notes: Vec<Note>,
    pub(crate) outputs: Vec<(Cycle, Signal, Option<bool>)>,
    pub(crate) triggers: Vec<Trigger>,
}

/// The context that an instance gets with each call.
#[derive(Debug)]
pub(crate) struct Cx<'a> {
    /// The core cycle (HCLK) of the access, or of the event that is due.
    pub now: Cycle,
    /// The present clocks.
    pub clocks: &'a Clocks,
    /// The present state of the pads.
    pub pads: &'a Pads,
    /// The effects of the call.
    pub out: &'a mut Effects,
    /// The address of the instruction that made the access.
    pub pc: Option<u32>,
    /// The name of the instance in the manual.
    pub name: &'static str,
}

impl Cx<'_> {
    /// Reports a finding. It costs little if the same finding was reported before.
    pub(crate) fn find(&mut self, kind: FindingKind, text: &'static str) {
        self.out.notes.push(Note { kind, at: self.now, pc: self.pc, place: self.name, text, value: None });
    }

    /// Reports a finding with a number, which follows `text` in hexadecimal.
    pub(crate) fn find_value(&mut self, kind: FindingKind, text: &'static str, value: u32) {
        self.out.notes.push(Note { kind, at: self.now, pc: self.pc, place: self.name, text, value: Some(value) });
    }

    /// Returns the pins that are connected to `signal`, see [`Pads::pins`].
    #[inline(always)]
    pub(crate) fn pins(&self, signal: Signal) -> [Option<Pin>; 2] {
        self.pads.pins(signal)
    }

    /// Makes the instance drive the pins that are connected to `signal` from now on. With `None` it stops driving,
    /// which is every signal's state at the start and after a reset. While an instance clocks frames on a signal, the
    /// signal's pins keep the idle level.
    pub(crate) fn output(&mut self, signal: Signal, level: Option<bool>) {
        self.out.outputs.push((self.now, signal, level));
    }

    /// Sends a trigger to the other instances.
    pub(crate) fn trigger(&mut self, trigger: Trigger) {
        self.out.triggers.push(trigger);
    }
}

/// The outside of the part, which answers at once.
pub(crate) trait Wires {
    /// Exchanges an SPI frame, see [`Outside::spi`].
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32>;
    /// Sends a UART frame, see [`Outside::uart`].
    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame);
    /// Carries out an action on an I2C bus, see [`Outside::i2c`].
    fn i2c(&mut self, at: Cycle, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer;
    /// Reads the voltage on a pin, see [`Outside::microvolts`].
    fn microvolts(&self, at: Cycle, pin: Pin) -> i32;
}

/// An adapter that makes an [`Outside`] usable as [`Wires`].
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

/// One instance of a peripheral.
///
/// Before any call at a later cycle, the part calls [`Peripheral::advance`] for everything that is due. If RCC gates
/// the instance's clock off, accesses are blocked, but events that are pending still happen.
pub(crate) trait Peripheral: Clone {
    /// Reads the register at `offset`, which is aligned to `width`. The result has the bits from `offset` on: a byte
    /// read at offset 1 returns bits 15:8 of the register at 0, in its low bits.
    fn read(&mut self, offset: u32, width: Width, cx: &mut Cx) -> u32;

    /// Writes the low `width` bytes of `value`. Each instance handles narrow writes as the manual says: an APB
    /// peripheral that takes only words gets the value copied to all lanes (RM0090 2.1.6).
    fn write(&mut self, offset: u32, width: Width, value: u32, cx: &mut Cx);

    /// Reads as a debugger does, without any change. The default returns 0.
    fn peek(&self, offset: u32, cx: &mut Cx) -> u32 {
        let _ = (offset, cx);
        0
    }

    /// The cycle at which the instance next acts by itself, [`NEVER`] if it does not. The function must be O(1).
    fn due(&self) -> Cycle;

    /// Carries out everything that is due up to and at `cx.now`, in order. Afterwards [`Peripheral::due`] is later than
    /// `cx.now`.
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

    /// Tells the instance that the DMA has served request `bit`. The DMA has read or written the address to which its
    /// stream points, which may be another register than the data register. `left` is NDTR afterwards: 0 is the end of
    /// the transfer, and 1 is the signal EOT_1 that the I2C's LAST bit uses.
    fn dma_served(&mut self, bit: u8, left: u32, cx: &mut Cx) {
        let _ = (bit, left, cx);
    }

    /// Tells the instance that the clocks changed at `cx.now`. The instance converts its pending times from `old` to
    /// `cx.clocks`.
    fn clocks_changed(&mut self, old: &Clocks, cx: &mut Cx);

    /// Carries out an RCC peripheral reset or a system reset. The part itself stops driving the instance's outputs.
    fn reset(&mut self);

    /// Tells the instance that a pin connected to `signal` changed its level, or that `signal` was connected to a pin
    /// of another level.
    fn input(&mut self, signal: Signal, level: bool, cx: &mut Cx) {
        let _ = (signal, level, cx);
    }

    /// Delivers a trigger of another instance.
    fn trigger(&mut self, trigger: Trigger, cx: &mut Cx) {
        let _ = (trigger, cx);
    }
}
