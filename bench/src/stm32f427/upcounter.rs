//! The simple timers: TIM6 and TIM7 (RM0090 chapter 20), TIM9 to TIM14 (chapter 19).
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `CNT`, `PSC`, `ARR` | 16-bit up-counter on the clock over `PSC + 1`, wraps after `ARR`; `ARR` 0 blocks, 20.3.1 |
//! | Update event | At the wrap and at `EGR.UG`; loads `PSC` always and `ARR` when `CR1.ARPE` holds it back, 20.3.2 |
//! | `CR1` `CEN`, `UDIS`, `URS`, `OPM`, `ARPE` | As 20.4.1 |
//! | `SR` `UIF`, `CC1IF`, `CC2IF` | Set by hardware, cleared by writing 0; a match sets its channel's flag, 19.4.4 |
//! | `DIER` `UIE`, `CC1IE`, `CC2IE` | The interrupt is the OR of the flags they enable, 19.4.3 |
//!
//! Instants do not accumulate rounding: they come from the count of timer clock cycles since the counter started or its
//! clock changed.
//!
//! **Left out.** Input capture, output pins, slave mode and DMA requests: setting them up is told to the run.

use std::fmt::Debug;

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::Layout;
use rigless::soc::stm32f427::generated::{tim6, tim9, tim10, tim11};
use rigless::time::{EventId, NANOS_PER_SECOND, VirtualNanos};

const CEN: u64 = 1 << 0;
const UDIS: u64 = 1 << 1;
const URS: u64 = 1 << 2;
const OPM: u64 = 1 << 3;
const ARPE: u64 = 1 << 7;
/// The whole of the counter, 16 bits.
const MAXIMUM: u64 = 0xFFFF;

/// Most compare channels a timer of these chapters has.
const CHANNELS: usize = 2;

/// Where each register is in a timer's own table.
pub trait Rows: Layout + Copy + PartialEq + Debug + Send + 'static {
    /// `CR1`, `DIER`, `SR`, `EGR`, `CNT`, `PSC`, `ARR`, in this order.
    const COMMON: [Self; 7];
    /// The compare registers, as many as the timer has channels.
    const COMPARE: &'static [Self];
    /// The registers whose functions are left out.
    const LEFT_OUT: &'static [(Self, &'static str)];
}

macro_rules! rows {
    ($layout:ident, [$($compare:ident),*], [$($left:ident),*]) => {
        impl Rows for $layout::Register {
            const COMMON: [Self; 7] =
                [Self::Cr1, Self::Dier, Self::Sr, Self::Egr, Self::Cnt, Self::Psc, Self::Arr];
            const COMPARE: &'static [Self] = &[$(Self::$compare),*];
            const LEFT_OUT: &'static [(Self, &'static str)] = &[$((Self::$left, stringify!($left))),*];
        }
    };
}
rows!(tim6, [], [Cr2]);
rows!(tim9, [Ccr1, Ccr2], [Cr2, Smcr, Ccer]);
rows!(tim10, [Ccr1], [Ccer]);
rows!(tim11, [Ccr1], [Ccer, Or]);

/// One timer.
#[derive(Debug)]
pub struct Upcounter<R> {
    hz: u64,
    /// The instant cycles are counted from.
    epoch: u64,
    running: bool,
    /// The cycle since `epoch` at which the counter was at `segment_count`.
    segment: u128,
    segment_count: u64,
    prescaler: u64,
    reload: u64,
    /// Which compare channels matched since the last wrap.
    matched: [bool; CHANNELS],
    interrupt: bool,
    event: Option<EventId>,
    rows: std::marker::PhantomData<R>,
}

impl<R: Rows> Default for Upcounter<R> {
    fn default() -> Self {
        Self {
            hz: 0,
            epoch: 0,
            running: false,
            segment: 0,
            segment_count: 0,
            prescaler: 0,
            reload: MAXIMUM,
            matched: [false; CHANNELS],
            interrupt: false,
            event: None,
            rows: std::marker::PhantomData,
        }
    }
}

impl<R: Rows> Upcounter<R> {
    const CR1: R = R::COMMON[0];
    const DIER: R = R::COMMON[1];
    const SR: R = R::COMMON[2];
    const EGR: R = R::COMMON[3];
    const CNT: R = R::COMMON[4];
    const PSC: R = R::COMMON[5];
    const ARR: R = R::COMMON[6];

    /// `ARR` as it comes out of reset, 20.4.8, where the register tables hold zero.
    pub(super) fn set_reset_values(registers: &mut RegisterFile) {
        registers.set(Self::ARR, MAXIMUM);
    }

    fn cycle(&self, now: u64) -> u128 {
        u128::from(now.saturating_sub(self.epoch)) * u128::from(self.hz) / u128::from(NANOS_PER_SECOND)
    }

    fn instant(&self, cycle: u128) -> u64 {
        let nanos = (cycle * u128::from(NANOS_PER_SECOND)).div_ceil(u128::from(self.hz.max(1)));
        self.epoch.saturating_add(u64::try_from(nanos).unwrap_or(u64::MAX))
    }

    fn count(&self, now: u64) -> u64 {
        if !self.counts() {
            return self.segment_count;
        }
        let ticks = (self.cycle(now) - self.segment) / (u128::from(self.prescaler) + 1);
        (self.segment_count + u64::try_from(ticks).unwrap_or(u64::MAX)) & MAXIMUM
    }

    fn counts(&self) -> bool {
        self.running && self.hz > 0 && self.reload > 0
    }

    /// The cycle `ticks` counter steps after the segment's start.
    fn cycle_after(&self, ticks: u64) -> u128 {
        self.segment + u128::from(ticks) * (u128::from(self.prescaler) + 1)
    }

    /// The cycle of the wrap. A counter set past `ARR` first runs to its end.
    fn wrap(&self) -> u128 {
        let last = if self.segment_count > self.reload { MAXIMUM } else { self.reload };
        self.cycle_after(last - self.segment_count + 1)
    }

    fn next_match(&self, registers: &RegisterFile) -> Option<(u128, usize)> {
        R::COMPARE
            .iter()
            .enumerate()
            .filter(|&(channel, _)| !self.matched[channel])
            .filter_map(|(channel, &register)| {
                let ticks = registers.get(register).checked_sub(self.segment_count)?;
                Some((self.cycle_after(ticks), channel))
            })
            .min()
    }

    /// Brings the counter to `now`: flags set, wraps made.
    fn catch_up(&mut self, now: u64, registers: &mut RegisterFile) {
        while self.counts() {
            let cycle = self.cycle(now);
            let wrap = self.wrap();
            match self.next_match(registers) {
                Some((at, channel)) if at <= cycle && at < wrap => {
                    self.matched[channel] = true;
                    let flags = registers.get(Self::SR);
                    registers.set(Self::SR, flags | 2 << channel);
                }
                _ if wrap <= cycle => {
                    self.segment = wrap;
                    self.segment_count = 0;
                    self.matched = [false; CHANNELS];
                    self.update(true, registers);
                    if registers.get(Self::CR1) & OPM != 0 {
                        registers.set(Self::CR1, registers.get(Self::CR1) & !CEN);
                        self.running = false;
                    }
                }
                _ => break,
            }
        }
    }

    fn update(&mut self, flagged: bool, registers: &mut RegisterFile) {
        if registers.get(Self::CR1) & UDIS != 0 {
            return;
        }
        self.prescaler = registers.get(Self::PSC) & MAXIMUM;
        self.reload = registers.get(Self::ARR) & MAXIMUM;
        if flagged {
            let flags = registers.get(Self::SR);
            registers.set(Self::SR, flags | 1);
        }
    }

    /// Counts from `now` on with the count it has then.
    fn rebase(&mut self, now: u64) {
        self.segment_count = self.count(now);
        self.epoch = now;
        self.segment = 0;
    }

    fn refresh(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let high = registers.get(Self::SR) & registers.get(Self::DIER) & 7 != 0;
        if high != self.interrupt {
            self.interrupt = high;
            context.interrupt(0, Level::from(high));
        }
        self.event = self.counts().then(|| {
            let wrap = self.wrap();
            let next = self.next_match(registers).map_or(wrap, |(at, _)| at.min(wrap));
            context.schedule(VirtualNanos(self.instant(next)))
        });
    }

    /// The timer clock's rate, which the part keeps in step with its clock tree.
    pub(super) fn set_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if hz == self.hz {
            return;
        }
        let now = context.now().0;
        self.catch_up(now, registers);
        self.rebase(now);
        self.hz = hz;
        self.refresh(registers, context);
    }
}

impl<R: Rows> Device for Upcounter<R> {
    type Register = R;

    fn read(&mut self, register: R, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Option<u64> {
        let now = context.now().0;
        self.catch_up(now, registers);
        self.refresh(registers, context);
        (register == Self::CNT).then(|| self.count(now))
    }

    fn peek(&self, register: R, _registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        (register == Self::CNT).then(|| self.count(now.0))
    }

    fn write(&mut self, register: R, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let now = context.now().0;
        self.catch_up(now, registers);
        if register == Self::CR1 {
            self.rebase(now);
            self.running = value & CEN != 0;
        } else if register == Self::CNT {
            self.rebase(now);
            self.segment_count = value & MAXIMUM;
            self.matched = [false; CHANNELS];
        } else if register == Self::ARR && registers.get(Self::CR1) & ARPE == 0 {
            self.rebase(now);
            self.reload = value & MAXIMUM;
        } else if register == Self::EGR {
            if value & 1 != 0 {
                self.rebase(now);
                self.segment_count = 0;
                self.matched = [false; CHANNELS];
                self.update(registers.get(Self::CR1) & URS == 0, registers);
            }
            registers.set(Self::SR, registers.get(Self::SR) | value & (2 | 4));
        } else if let Some(channel) = R::COMPARE.iter().position(|&compare| compare == register) {
            self.matched[channel] = value < self.count(now);
        } else if value != 0
            && let Some(&(_, name)) = R::LEFT_OUT.iter().find(|(left_out, _)| *left_out == register)
        {
            context.tell(name, "capture, output pins, slave mode and triggers of the simple timers are not modelled");
        }
        self.refresh(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.event == Some(event) {
            self.catch_up(context.now().0, registers);
            self.refresh(registers, context);
        }
    }

    fn reset(&mut self) {
        *self = Self { hz: self.hz, ..Self::default() };
    }
}
