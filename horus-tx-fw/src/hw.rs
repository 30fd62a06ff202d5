//! The registers behind the firmware, and the only `unsafe` of it
//!
//! # Design
//!
//! The HAL sets up clocks, pins, EXTI and the watchdog. What is here is below its types: DMA streams that run for ever or
//! are started and finished in different tasks, and a timer whose period must not be rounded. Memory that a DMA controller
//! reads or writes is made of atomics in main SRAM (the CCM RAM is out of a DMA's reach, RM0090 "Memory and bus
//! architecture"), so that no reference to it ever claims more than is true.
//!
//! | use | peripheral | DMA (RM0090 tables 42 and 43) | vectors |
//! |---|---|---|---|
//! | radio | SPI1 PA5/6/7, CS PD14, IRQ PA3 | DMA2 stream 0 (RX), 3 (TX), channel 3 | DMA2_STREAM0, DMA2_STREAM3, EXTI3 |
//! | GPS1 | USART2 RX PD6 | DMA1 stream 5 channel 4 | USART2, DMA1_STREAM5 |
//! | GPS2 | USART6 RX PC7 | DMA2 stream 1 channel 5 | USART6, DMA2_STREAM1 |
//! | GPS3 | UART4 RX PC11 | DMA1 stream 2 channel 4 | UART4, DMA1_STREAM2 |
//! | GPS4 | UART5 RX PD2 | DMA1 stream 0 channel 4 | UART5, DMA1_STREAM0 |
//! | GPS5 | UART7 RX PE7 | DMA1 stream 3 channel 5 | UART7, DMA1_STREAM3 |
//! | cycle | TIM2 | – | TIM2 |
//! | time-outs | TIM5 | – | TIM5 |
//!
//! # Errata (ES0206 rev 24, STM32F42x and F43x) of what is used here
//!
//! | item | what it says | what is done |
//! |---|---|---|
//! | 2.2.7 | a peripheral does not answer for some cycles after its clock is enabled | the HAL's `enable` reads back before it returns |
//! | 2.2.6 | a buffered write to the watchdog under an MPU attribute | no MPU region is configured |
//! | 2.11.1 | an idle frame may go unseen if the receiver's clock deviates | idle only makes it faster: half and whole laps of the ring, and every tick, look too |
//! | 2.12.1, 2.12.5 | BSY may stay high when the SPI is disabled, or after a transfer in other modes than ours | the SPI stays enabled; every wait for BSY has a bound |
//! | 2.12.4 | last bit corrupted in master mode with delayed SCK feedback | SCK at very high pad speed, and 9 MHz of the 45 MHz it may have |
//! | 2.7.3 | a second compare match right after CCR changed may be missed | CCR never changes |
//! | 2.8.3, 2.8.4 | PVU, RVU not cleared when APB is too slow | APB1 runs at 36 MHz; nothing waits for them |
//! | AN4031, DMA2 | DMA2 may corrupt data when it serves AHB and APB peripherals at once | DMA2 serves APB2 alone: SPI1 and USART6 |
//! | Cortex-M4 776924 | VDIV/VSQRT may be wrong if interrupted by a very short handler | every handler does more than the 14 cycles it names |
//! | Cortex-M4 838869 | a store right before exception return may return to the wrong vector | [`settle`] (DSB) ends every handler |

// RTIC's generated resource types are public, and so must be what they hold.
#![allow(unreachable_pub)]

use core::sync::atomic::{compiler_fence, AtomicU32, AtomicU8, Ordering};

use cortex_m::asm;
use horus_tx_fw::{
    cycle::timestamp,
    ring::{Span, Writer},
    telemetry::{Line, Telemetry},
    timing,
    transmitter::{Port, Slot, Ticket},
    FRAMES, RECEIVERS,
};
use profile::Profile;
use st25r3916::{command, Short};
use stm32f4xx_hal::pac::{self, dma2, spi1, uart4};

/// What the debugger or the bench reads.
#[no_mangle]
pub static HORUS_TELEMETRY: Telemetry = Telemetry::new();

/// The ticks so far; written by the cycle timer's interrupt alone.
static TICKS: AtomicU32 = AtomicU32::new(0);
/// The tick whose cycle has ended.
static ENDED: AtomicU32 = AtomicU32::new(0);
/// The ticket for the next slot.
static ARMED: AtomicU32 = AtomicU32::new(0);
/// What the last slot came to, for the radio's task: `PASSED | FIRED? | frame << 8 | response`.
static SLOT: AtomicU32 = AtomicU32::new(0);
const PASSED: u32 = 1 << 31;
const FIRED: u32 = 1 << 30;

/// Makes sure that what a handler has written has arrived before it returns: a flag that is still set
/// at the interrupt controller would call it again, and erratum 838869.
pub fn settle() {
    asm::dsb();
}

// ---------------------------------------------------------------------------------------------------
// Register blocks
// ---------------------------------------------------------------------------------------------------

fn spi() -> &'static spi1::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile. Who may use
    // the SPI when is settled by the ticket: from `arm` to the slot it is the slot's, else the radio's.
    unsafe { &*pac::SPI1::ptr() }
}

fn dma_1() -> &'static dma2::RegisterBlock {
    // SAFETY: as above; each stream has one user, the flag clear registers act on written ones only.
    unsafe { &*pac::DMA1::ptr() }
}

fn dma_2() -> &'static dma2::RegisterBlock {
    // SAFETY: as for `dma_1`.
    unsafe { &*pac::DMA2::ptr() }
}

fn tim2() -> &'static pac::tim2::RegisterBlock {
    // SAFETY: as above; outside the timer's own interrupt it is only read.
    unsafe { &*pac::TIM2::ptr() }
}

fn tim5() -> &'static pac::tim5::RegisterBlock {
    // SAFETY: as above; used by the radio's tasks alone, which have one priority.
    unsafe { &*pac::TIM5::ptr() }
}

fn select(low: bool) {
    // SAFETY: as above; BSRR changes only the pins whose bit is written, here PD14.
    let port = unsafe { &*pac::GPIOD::ptr() };
    port.bsrr().write(|w| if low { w.br14().set_bit() } else { w.bs14().set_bit() });
}

fn irq_pin() -> bool {
    // SAFETY: as above; IDR is read-only.
    let port = unsafe { &*pac::GPIOA::ptr() };
    port.idr().read().idr3().bit_is_set()
}

/// Polls of the SPI's status register that outlast one byte: 8 bits at 9 MHz are 128 core cycles, and a
/// poll over the APB takes at least 6.
const POLLS: u32 = 128;

/// Waits until the SPI has shifted its last bit out, one byte time at most, then raises chip select.
/// Chip select must not rise under a bit (RM0090 "SPI", disabling).
fn deselect() {
    for _ in 0..POLLS {
        if spi().sr().read().bsy().bit_is_clear() {
            break;
        }
    }
    select(false);
}

/// One byte out, one byte in, without DMA. Takes one byte time, and is bounded if the SPI is stuck.
fn exchange(byte: u8) -> u8 {
    spi().dr8().write(|w| w.dr().set(byte));
    for _ in 0..POLLS {
        if spi().sr().read().rxne().bit_is_set() {
            break;
        }
    }
    spi().dr8().read().dr().bits()
}

// ---------------------------------------------------------------------------------------------------
// Cycle timer
// ---------------------------------------------------------------------------------------------------

/// TIM2: the 10 ms cycle and its slots.
pub struct CycleTimer(());

/// What the cycle timer's interrupt was for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum CycleEvent {
    /// A slot has passed: the radio's task has something to do.
    Slot,
    /// The tick: the cycle's task has.
    Tick,
}

impl CycleTimer {
    /// Sets the timer up, stopped. Prescaler 1 and reload 719 999 are exact; the HAL's rounding of a
    /// frequency is not.
    pub fn new(_timer: pac::TIM2) -> Self {
        let timer = tim2();
        timer.psc().write(|w| w.psc().set(0));
        timer.arr().write(|w| w.arr().set(timing::PERIOD_TICKS - 1));
        for (channel, ticks) in timing::SLOT_TICKS.into_iter().enumerate() {
            timer.ccr(channel).write(|w| w.ccr().set(ticks));
        }
        // Load the prescaler now, and do not call that a tick.
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.sr().write(|w| w.uif().clear());
        timer.dier().write(|w| {
            for channel in 0..FRAMES {
                w.ccie(channel as u8).set_bit();
            }
            w.uie().set_bit()
        });
        Self(())
    }

    /// Starts the first cycle.
    pub fn start(&mut self) {
        tim2().cr1().modify(|_, w| w.cen().set_bit());
    }

    /// The interrupt. A slot's command leaves first, by the same instructions every time; everything
    /// else comes after it.
    #[inline(always)]
    pub fn interrupt(&mut self) -> CycleEvent {
        let flags = tim2().sr().read();
        for frame in 0..FRAMES {
            if flags.ccif(frame as u8).bit_is_set() {
                self.slot(frame);
                return CycleEvent::Slot;
            }
        }
        tim2().sr().write(|w| w.uif().clear());
        let tick = TICKS.load(Ordering::Relaxed).wrapping_add(1);
        if ENDED.load(Ordering::Relaxed) != tick.wrapping_sub(1) {
            HORUS_TELEMETRY.cycle_overruns.count();
        }
        TICKS.store(tick, Ordering::Relaxed);
        HORUS_TELEMETRY.cycles.set(tick);
        CycleEvent::Tick
    }

    #[inline(always)]
    fn slot(&mut self, frame: usize) {
        let mut report = PASSED | (frame as u32) << 8;
        let ticket = Ticket::from_word(ARMED.load(Ordering::Acquire));
        let tick = TICKS.load(Ordering::Relaxed);
        match ticket.due(tick, frame) {
            Some(command) => {
                select(true);
                spi().dr8().write(|w| w.dr().set(command));
                let left = tim2().cnt().read().cnt().bits();
                // One byte time, the only wait at this priority: chip select has to rise after it.
                for _ in 0..POLLS {
                    if spi().sr().read().rxne().bit_is_set() {
                        break;
                    }
                }
                let response = spi().dr8().read().dr().bits();
                deselect();
                ARMED.store(0, Ordering::Release);
                HORUS_TELEMETRY.fired(left.wrapping_sub(timing::SLOT_TICKS[frame]));
                report |= FIRED | u32::from(response);
            }
            // Before the first tick no cycle has begun that could have anything to send.
            None if tick == 0 => {}
            None => HORUS_TELEMETRY.frames_skipped.count(),
        }
        SLOT.store(report, Ordering::Release);
        tim2().sr().write(|w| w.ccif(frame as u8).clear());
    }
}

/// The tick that is being served.
pub fn tick() -> u32 {
    TICKS.load(Ordering::Relaxed)
}

/// The cycle of `tick` has ended.
pub fn cycle_ended(tick: u32) {
    ENDED.store(tick, Ordering::Relaxed);
}

/// What the last slot came to, once.
pub fn take_slot() -> Option<Slot> {
    let word = SLOT.swap(0, Ordering::Acquire);
    (word & PASSED != 0).then_some(Slot {
        frame: (word >> 8 & 0xFF) as usize,
        fired: (word & FIRED != 0).then_some((word & 0xFF) as u8),
    })
}

/// Milliseconds since the first tick's cycle began, wraps.
pub fn now_ms() -> u32 {
    let before = tick();
    let count = tim2().cnt().read().cnt().bits();
    let after = tick();
    // The tick came in between: then this is its first moment.
    let within = if before == after { count / (timing::TIMER_HZ / 1_000) } else { 0 };
    timestamp(after).wrapping_add(within)
}

/// Runs `log` if the rest of the cycle has no slot and no tick left that it could delay. A log message
/// masks all interrupts while it is written; the check and the message are one such section.
pub fn when_quiet(log: impl FnOnce()) -> bool {
    cortex_m::interrupt::free(|_| {
        let quiet = timing::quiet(tim2().cnt().read().cnt().bits());
        if quiet {
            log();
        }
        quiet
    })
}

// ---------------------------------------------------------------------------------------------------
// Radio
// ---------------------------------------------------------------------------------------------------

/// Profile bytes for the FIFO load, as words; every size of a profile is a whole number of them.
static FRAME: [AtomicU32; Profile::<RECEIVERS>::SIZE / 4] =
    [const { AtomicU32::new(0) }; Profile::<RECEIVERS>::SIZE / 4];
static SHORT_OUT: [AtomicU8; Short::MAX] = [const { AtomicU8::new(0) }; Short::MAX];
static SHORT_IN: [AtomicU8; Short::MAX] = [const { AtomicU8::new(0) }; Short::MAX];
/// Where what comes in during a load goes.
static DISCARD: AtomicU8 = AtomicU8::new(0);

const _: () = assert!(Profile::<RECEIVERS>::SIZE.is_multiple_of(4));

/// SPI1 with its two DMA streams, chip select, the IRQ pin's level, and the one-shot timer.
pub struct Radio {
    len: usize,
    response: [u8; Short::MAX],
}

/// How a transfer ended.
pub enum Ended<'a> {
    /// With this response, empty after a load.
    Done(&'a [u8]),
    /// With a DMA error.
    Failed,
}

const STREAM_RX: usize = 0;
const STREAM_TX: usize = 3;

impl Radio {
    /// Sets SPI1 (mode 1, 9 MHz, 8 bits, most significant first) and TIM5 (1 µs, one-shot) up.
    pub fn new(_spi: pac::SPI1, _timer: pac::TIM5) -> Self {
        select(false);
        let spi = spi();
        // Mode 1: CPOL 0, CPHA 1 (DS13541, SPI interface). /8 of APB2.
        spi.cr1().write(|w| {
            w.cpol().idle_low();
            w.cpha().second_edge();
            w.mstr().master();
            w.br().div8();
            w.ssm().enabled();
            w.ssi().slave_not_selected();
            w.spe().enabled()
        });
        let timer = tim5();
        timer.psc().write(|w| w.psc().set((timing::TICKS_PER_US - 1) as u16));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.sr().write(|w| w.uif().clear());
        timer.dier().write(|w| w.uie().set_bit());
        Self { len: 0, response: [0; Short::MAX] }
    }

    /// The interrupt of either stream: how the transfer ended, if it has.
    pub fn ended(&mut self) -> Option<Ended<'_>> {
        let flags = dma_2().lisr().read();
        if flags.teif0().bit_is_set() || flags.teif3().bit_is_set() {
            self.abort();
            return Some(Ended::Failed);
        }
        if flags.tcif0().bit_is_clear() {
            return None;
        }
        self.stop();
        deselect();
        compiler_fence(Ordering::Acquire);
        let response = &mut self.response[..self.len];
        for (to, from) in response.iter_mut().zip(&SHORT_IN) {
            *to = from.load(Ordering::Relaxed);
        }
        Some(Ended::Done(response))
    }

    /// TIM5's interrupt: whether the time is over (and was not cancelled meanwhile).
    pub fn time_is_over(&mut self) -> bool {
        let over = tim5().sr().read().uif().bit_is_set();
        tim5().sr().write(|w| w.uif().clear());
        over
    }

    /// EXTI3's interrupt: forgets the edge. What counts is the pin's level.
    pub fn forget_edge(&mut self) {
        // SAFETY: register block as above; PR is cleared by the ones written, and only line 3 is.
        let exti = unsafe { &*pac::EXTI::ptr() };
        exti.pr().write(|w| w.pr3().clear_bit_by_one());
    }

    fn stop(&mut self) {
        spi().cr2().write(|w| w);
        clear_flags(dma_2(), STREAM_RX);
        clear_flags(dma_2(), STREAM_TX);
    }

    /// Starts both streams. `lead` is sent ahead of what the TX stream reads.
    fn begin(&mut self, lead: Option<u8>, out: u32, into: u32, len: usize, keep: bool) {
        let received = len + usize::from(lead.is_some());
        self.stop();
        select(true);
        let data = spi().dr().as_ptr() as u32;
        spi().cr2().write(|w| w.rxdmaen().set_bit());
        start_stream(
            dma_2().st(STREAM_RX),
            &Stream {
                channel: 3,
                peripheral: data,
                memory: into,
                len: received,
                direction: Direction::In { circular: false, advance: keep },
            },
        );
        if let Some(byte) = lead {
            spi().dr8().write(|w| w.dr().set(byte));
        }
        start_stream(
            dma_2().st(STREAM_TX),
            &Stream { channel: 3, peripheral: data, memory: out, len, direction: Direction::Out },
        );
        spi().cr2().write(|w| w.rxdmaen().set_bit().txdmaen().set_bit());
    }
}

impl Port for Radio {
    fn deposit(&mut self, profile: &Profile<RECEIVERS>) {
        let (words, _) = profile.as_bytes().as_chunks::<4>();
        for (word, bytes) in FRAME.iter().zip(words) {
            word.store(u32::from_ne_bytes(*bytes), Ordering::Relaxed);
        }
    }

    fn short(&mut self, bytes: &[u8]) {
        self.len = bytes.len().min(Short::MAX);
        for (to, from) in SHORT_OUT.iter().zip(bytes) {
            to.store(*from, Ordering::Relaxed);
        }
        self.begin(None, SHORT_OUT.as_ptr() as u32, SHORT_IN.as_ptr() as u32, self.len, true);
    }

    fn load(&mut self, start: usize, len: usize) {
        self.len = 0;
        let start = start.min(Profile::<RECEIVERS>::SIZE);
        let len = len.min(Profile::<RECEIVERS>::SIZE - start);
        self.begin(Some(command::FIFO_LOAD), FRAME.as_ptr() as u32 + start as u32, DISCARD.as_ptr() as u32, len, false);
    }

    fn abort(&mut self) {
        stop_stream(dma_2().st(STREAM_TX));
        stop_stream(dma_2().st(STREAM_RX));
        self.stop();
        deselect();
        // What is left in the receive buffer is nobody's.
        let _ = spi().dr8().read();
        let _ = spi().sr().read();
    }

    fn irq(&self) -> bool {
        irq_pin()
    }

    fn wait(&mut self, micros: u32) {
        let timer = tim5();
        timer.cr1().write(|w| w.urs().set_bit());
        timer.cnt().write(|w| w.cnt().set(0));
        // An update comes ARR + 1 counts on: never early.
        timer.arr().write(|w| w.arr().set(micros.max(1)));
        timer.sr().write(|w| w.uif().clear());
        timer.cr1().write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
    }

    fn cancel(&mut self) {
        tim5().cr1().write(|w| w.urs().set_bit());
        tim5().sr().write(|w| w.uif().clear());
    }

    fn arm(&mut self, ticket: Ticket) {
        ARMED.store(ticket.word(), Ordering::Release);
    }

    fn disarm(&mut self) -> bool {
        ARMED.swap(0, Ordering::Acquire) != 0
    }
}

/// Switches the RF field off, whatever the SPI was doing: the safe state. Blocks for some microseconds,
/// with a bound, and expects all interrupts to be masked.
pub fn field_off() {
    stop_stream(dma_2().st(STREAM_TX));
    stop_stream(dma_2().st(STREAM_RX));
    spi().cr2().write(|w| w);
    deselect();
    let _ = spi().dr8().read();
    // Longer than any minimum high time of chip select.
    asm::delay(timing::CORE_HZ / 1_000_000);
    select(true);
    // Operation control (register 02) = 0: transmitter, receiver and oscillator off (DS13541).
    exchange(command::WRITE | 0x02);
    exchange(0x00);
    deselect();
}

// ---------------------------------------------------------------------------------------------------
// DMA streams
// ---------------------------------------------------------------------------------------------------

enum Direction {
    In { circular: bool, advance: bool },
    Out,
}

struct Stream {
    channel: u8,
    peripheral: u32,
    memory: u32,
    len: usize,
    direction: Direction,
}

/// Bytes, one at a time, FIFO off (direct mode). Interrupts: end and error of what comes in, error of what goes out.
fn start_stream(stream: &dma2::ST, transfer: &Stream) {
    // SAFETY: every address given to this function is that of a data register or of a static made of
    // atomics in main SRAM with at least `len` bytes from there on.
    stream.par().write(|w| unsafe { w.pa().bits(transfer.peripheral) });
    // SAFETY: see above.
    stream.m0ar().write(|w| unsafe { w.m0a().bits(transfer.memory) });
    stream.ndtr().write(|w| w.ndt().set(transfer.len as u16));
    // What the CPU has written into that memory is there before the stream looks.
    asm::dmb();
    stream.cr().write(|w| {
        w.chsel().set(transfer.channel);
        w.teie().set_bit();
        match transfer.direction {
            Direction::In { circular, advance } => {
                w.dir().peripheral_to_memory();
                w.minc().bit(advance);
                w.pl().very_high();
                w.circ().bit(circular);
                w.htie().bit(circular);
                w.tcie().set_bit();
            }
            Direction::Out => {
                w.dir().memory_to_peripheral();
                w.minc().set_bit();
                w.pl().high();
            }
        }
        w.en().set_bit()
    });
}

fn stop_stream(stream: &dma2::ST) {
    stream.cr().write(|w| w.en().clear_bit());
    // The byte in flight ends first (RM0090 "DMA", stream configuration).
    for _ in 0..POLLS {
        if stream.cr().read().en().bit_is_clear() {
            break;
        }
    }
}

/// All five flags of one stream.
const ALL_FLAGS: u32 = 0x3D;

const fn flag_shift(stream: usize) -> u32 {
    match stream % 4 {
        0 => 0,
        1 => 6,
        2 => 16,
        _ => 22,
    }
}

fn clear_flags(dma: &dma2::RegisterBlock, stream: usize) {
    let flags = ALL_FLAGS << flag_shift(stream);
    // SAFETY: writing ones clears those flags, zeros do nothing; the bits are the stream's own.
    unsafe {
        if stream < 4 {
            dma.lifcr().write(|w| w.bits(flags));
        } else {
            dma.hifcr().write(|w| w.bits(flags));
        }
    }
}

// ---------------------------------------------------------------------------------------------------
// GNSS receivers
// ---------------------------------------------------------------------------------------------------

/// Bytes of each receiver's ring: 11 ms at 460 800 baud, so half of it lasts for more than the 5 ms
/// that the slowest of the tasks in between takes.
pub const RING: usize = 512;

static RINGS: [[AtomicU8; RING]; RECEIVERS] = [const { [const { AtomicU8::new(0) }; RING] }; RECEIVERS];

/// Bytes ever written into each ring.
static WRITTEN: [AtomicU32; RECEIVERS] = [const { AtomicU32::new(0) }; RECEIVERS];

const _: () = assert!(RING.is_power_of_two());

/// The wiring of receiver `index`: its UART, DMA controller, stream, channel, and the UART's clock, Hz.
fn wiring(index: usize) -> (&'static uart4::RegisterBlock, &'static dma2::RegisterBlock, usize, u8, u32) {
    // SAFETY: a UART's register block is that of a USART without its last register, which is not used;
    // both are always there, every access is volatile, and each is used by one line alone.
    let uart = unsafe {
        &*match index {
            0 => pac::USART2::ptr().cast::<uart4::RegisterBlock>(),
            1 => pac::USART6::ptr().cast(),
            2 => pac::UART4::ptr(),
            3 => pac::UART5::ptr(),
            _ => pac::UART7::ptr(),
        }
    };
    match index {
        0 => (uart, dma_1(), 5, 4, timing::APB1_HZ),
        1 => (uart, dma_2(), 1, 5, timing::APB2_HZ),
        2 => (uart, dma_1(), 2, 4, timing::APB1_HZ),
        3 => (uart, dma_1(), 0, 4, timing::APB1_HZ),
        _ => (uart, dma_1(), 3, 5, timing::APB1_HZ),
    }
}

/// The DMA side of one receiver's line.
pub struct GnssLine {
    index: usize,
    writer: Writer,
}

impl GnssLine {
    /// The lines that are fitted, running. Their clocks and pins are.
    pub fn all() -> [Self; RECEIVERS] {
        core::array::from_fn(Self::new)
    }

    fn new(index: usize) -> Self {
        let line = Self { index, writer: Writer::new() };
        line.start_ring();
        let (uart, .., clock) = wiring(index);
        // 16 times oversampling: BRR is the divider itself, nearest (36 MHz: 78, 0.16 % fast).
        let divider = (clock + timing::GNSS_BAUD / 2) / timing::GNSS_BAUD;
        // SAFETY: any 16-bit value is a divider; this one is within 1 % of the baud rate wanted.
        uart.brr().write(|w| unsafe { w.bits(divider as u16) });
        uart.cr3().write(|w| w.dmar().set_bit().eie().set_bit());
        uart.cr1().write(|w| w.ue().set_bit().re().set_bit().idleie().set_bit());
        line
    }

    fn start_ring(&self) {
        let (uart, dma, stream, channel, _) = wiring(self.index);
        clear_flags(dma, stream);
        start_stream(
            dma.st(stream),
            &Stream {
                channel,
                peripheral: uart.dr().as_ptr() as u32,
                memory: RINGS[self.index].as_ptr() as u32,
                len: RING,
                direction: Direction::In { circular: true, advance: true },
            },
        );
    }

    fn telemetry(&self) -> &'static Line {
        &HORUS_TELEMETRY.lines[self.index]
    }

    /// The UART's interrupt: idle line, or an error.
    pub fn uart_interrupt(&mut self) {
        let (uart, ..) = wiring(self.index);
        let flags = uart.sr().read();
        if flags.fe().bit_is_set() || flags.nf().bit_is_set() || flags.ore().bit_is_set() {
            self.telemetry().uart_errors.count();
        }
        // Reading SR, then DR, clears all of these (RM0090 "USART", status register). The line has been
        // idle for a whole frame, or its byte was bad, so the byte read here is not one the DMA wants.
        let _ = uart.dr().read();
        self.look();
    }

    /// The stream's interrupt: half or whole lap, or pended by the cycle to have a look.
    pub fn stream_interrupt(&mut self) {
        let (_, dma, stream, ..) = wiring(self.index);
        clear_flags(dma, stream);
        if dma.st(stream).cr().read().en().bit_is_clear() {
            // A transfer error stops a circular stream. It begins at the ring's start again, as the
            // writer must; what was in between does not pass a checksum.
            self.telemetry().uart_errors.count();
            self.writer.advance(RING, RING);
            self.start_ring();
        }
        self.look();
    }

    fn look(&mut self) {
        let (_, dma, stream, ..) = wiring(self.index);
        let left = dma.st(stream).ndtr().read().ndt().bits();
        let written = self.writer.advance(usize::from(left), RING);
        WRITTEN[self.index].store(written, Ordering::Release);
    }
}

/// Bytes that receiver `index` has ever sent, wraps.
pub fn written(index: usize) -> u32 {
    WRITTEN[index].load(Ordering::Acquire)
}

/// Copies `span` of receiver `index`'s ring out.
pub fn copy_out(index: usize, span: Span, into: &mut [u8]) -> &[u8] {
    let len = span.len.min(into.len());
    let (into, _) = into.split_at_mut(len);
    for (to, from) in into.iter_mut().zip(&RINGS[index][span.start..]) {
        *to = from.load(Ordering::Relaxed);
    }
    into
}

// ---------------------------------------------------------------------------------------------------
// Resets
// ---------------------------------------------------------------------------------------------------

/// Survives every reset but that of the power: `MAGIC`, then the watchdog's resets so far.
#[link_section = ".uninit.RESETS"]
static RESETS: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];
const MAGIC: u32 = 0x484F_5255;

/// Counts the watchdog's resets since power-up, from the reset flags, which it clears.
pub fn count_resets(rcc: &pac::RCC) {
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    let [magic, count] = &RESETS;
    if magic.load(Ordering::Relaxed) != MAGIC || flags.porrstf().bit_is_set() {
        magic.store(MAGIC, Ordering::Relaxed);
        count.store(0, Ordering::Relaxed);
    }
    if flags.wdgrstf().bit_is_set() {
        count.fetch_add(1, Ordering::Relaxed);
    }
    HORUS_TELEMETRY.watchdog_resets.set(count.load(Ordering::Relaxed));
}
