//! The front end's registers: SPI1 with its DMA streams, chip select, the IRQ pin, and TIM5 for the waits
//!
//! # Design
//!
//! Every operation of the port starts something and returns; the interrupt that ends it polls the executor. The SPI has
//! two users that never meet: from [`transmitter::FrontEndPort::arm`] to the slot it is the slot's interrupt, else it
//! is the tasks of the front end, which have one priority.
//!
//! The SPI runs in mode 1 (CPOL 0, CPHA 1; DS13541, SPI interface) at 72 MHz / 8 = 9 MHz, eight bits, most significant
//! first.
//!
//! [`field_off`] relies on nothing that was set up before it, so that it also works from the first instructions of the
//! start on, and after the clock security system has taken the PLL away: the SPI then runs at 2 or 1 MHz, and the
//! bounds of its waits, which are counted in cycles of the processor, hold as the ratio of the two clocks does not
//! grow.
//!
//! # Errata (ES0206 rev 24) of what is used here
//!
//! - 2.12.1, 2.12.5: BSY may stay high when the SPI is disabled, or after a transfer in other modes than ours. Here:
//!   the SPI stays enabled; every wait for BSY has a bound.
//! - 2.12.4: last bit corrupted in master mode with delayed SCK feedback. Here: SCK at very high pad speed, and 9 MHz
//!   of the 45 MHz it may have.
//!
//! `unsafe` here: shared access to the register blocks of SPI1 and TIM5, the DMA streams' starts, and the EXTI line's
//! port.
#![allow(unsafe_code)]

use core::{
    ops::Range,
    sync::atomic::{compiler_fence, AtomicU32, AtomicU8, Ordering},
};

use cortex_m::asm;
use firmware_common::memory;
use horus_tx_fw::{
    timing,
    transmitter::{self, Ticket},
    RECEIVERS,
};
use profile::Profile;
use st25r3916::{
    command,
    executor::{Failed, Port},
    Short,
};
use stm32f4xx_hal::{
    pac::{self, spi1},
    rcc::Enable,
};

use super::{
    dma::{self, Direction, Transfer},
    gpio::{self, Pull, Speed},
    HORUS_TELEMETRY,
};
use crate::board::{CHIP_SELECT, IRQ, MISO, MOSI, SCK, SPI_IN, SPI_OUT};

/// The ticket for the next slot.
pub(super) static ARMED: AtomicU32 = AtomicU32::new(0);

fn spi() -> &'static spi1::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile. Who may use the SPI when is
    // settled by the ticket: from `arm` to the slot it is the slot's, else the front end's tasks'.
    unsafe { &*pac::SPI1::ptr() }
}

fn tim5() -> &'static pac::tim5::RegisterBlock {
    // SAFETY: as above; used by the front end's tasks alone, which have one priority.
    unsafe { &*pac::TIM5::ptr() }
}

/// Polls of the SPI's status register that outlast one byte: 8 bits at 9 MHz are 128 core cycles, and a poll over the
/// APB takes at least 6. On HSI without the PLL a byte takes 64 or 128 core cycles.
const POLLS: u32 = 128;

/// Lowers chip select.
#[inline(always)]
pub(super) fn select() {
    gpio::write(CHIP_SELECT, false);
}

/// Waits until the SPI has shifted its last bit out, one byte time at most, then raises chip select. Chip select must
/// not rise under a bit (RM0090 "SPI", disabling).
pub(super) fn deselect() {
    for _ in 0..POLLS {
        if spi().sr().read().bsy().bit_is_clear() {
            break;
        }
    }
    gpio::write(CHIP_SELECT, true);
}

/// Starts to shift a byte out, without DMA.
#[inline(always)]
pub(super) fn put(byte: u8) {
    spi().dr8().write(|w| w.dr().set(byte));
}

/// Waits for the byte that is shifted in meanwhile, one byte time at most, also if the SPI hangs.
#[inline(always)]
pub(super) fn take() -> u8 {
    for _ in 0..POLLS {
        if spi().sr().read().rxne().bit_is_set() {
            break;
        }
    }
    spi().dr8().read().dr().bits()
}

/// Switches the clocks of the SPI, its pins and its DMA streams on.
fn enable_clocks() {
    gpio::enable_ports();
    dma::enable();
    // SAFETY: sets one bit in the clock enable register, atomically (the HAL uses the bit-band region).
    unsafe { pac::SPI1::enable_unchecked() };
}

/// Sets up the SPI and its pins. Changes nothing where they are set up already.
fn set_up_spi() {
    // Chip select is high before it is an output; the clock's edges are fast (erratum 2.12.4).
    gpio::output(CHIP_SELECT, Speed::VeryHigh, true);
    gpio::alternate(SCK, Speed::VeryHigh, Pull::None);
    gpio::alternate(MISO, Speed::Low, Pull::None);
    gpio::alternate(MOSI, Speed::VeryHigh, Pull::None);
    spi().cr1().write(|w| {
        w.cpol().idle_low();
        w.cpha().second_edge();
        w.mstr().master();
        w.br().div8();
        w.ssm().enabled();
        w.ssi().slave_not_selected();
        w.spe().enabled()
    });
}

/// Makes the rising edge of the IRQ pin an interrupt.
fn set_up_irq(syscfg: &pac::SYSCFG, exti: &pac::EXTI) {
    gpio::input(IRQ, Pull::Down);
    // SAFETY: port A's code is 0 (RM0090 "SYSCFG", external interrupt configuration register 1).
    syscfg.exticr1().modify(|_, w| unsafe { w.exti3().bits(0) });
    exti.rtsr().modify(|_, w| w.tr3().set_bit());
    exti.imr().modify(|_, w| w.mr3().set_bit());
}

/// Profile bytes for the FIFO load, as words; every size of a profile is a whole number of them.
static FRAME: [AtomicU32; Profile::<RECEIVERS>::SIZE / 4] =
    [const { AtomicU32::new(0) }; Profile::<RECEIVERS>::SIZE / 4];
static SHORT_OUT: [AtomicU8; Short::MAX] = [const { AtomicU8::new(0) }; Short::MAX];
static SHORT_IN: [AtomicU8; Short::MAX] = [const { AtomicU8::new(0) }; Short::MAX];
/// Where everything goes that comes in during a load.
static DISCARD: AtomicU8 = AtomicU8::new(0);

/// What DMA writes and reads.
pub(super) fn memory() -> [Range<u32>; 4] {
    [memory::span(&FRAME), memory::span(&SHORT_OUT), memory::span(&SHORT_IN), memory::span(&DISCARD)]
}

const _: () = assert!(Profile::<RECEIVERS>::SIZE.is_multiple_of(4));

/// SPI1 with its two DMA streams, chip select, the IRQ pin's level, and the one-shot timer.
pub struct Radio {
    /// Bytes of the response; none after a load.
    len: usize,
    response: [u8; Short::MAX],
    /// The transfer that ended last ended with a DMA error.
    failed: bool,
    /// The bytes of [`FRAME`] that are loaded.
    frame: Range<usize>,
    /// The timer has run out since it was started.
    over: bool,
}

impl Radio {
    /// Sets everything up, clocks and pins included.
    pub fn new(rcc: &mut pac::RCC, _spi: pac::SPI1, _timer: pac::TIM5, syscfg: pac::SYSCFG, exti: &pac::EXTI) -> Self {
        enable_clocks();
        pac::TIM5::enable(rcc);
        pac::SYSCFG::enable(rcc);
        set_up_spi();
        set_up_irq(&syscfg, exti);
        // 1 µs a count.
        let ticks = match HORUS_TELEMETRY.without_crystal.get() {
            0 => timing::TICKS_PER_US,
            _ => timing::INTERNAL_TICKS_PER_US,
        };
        let timer = tim5();
        timer.psc().write(|w| w.psc().set((ticks - 1) as u16));
        timer.cr1().write(|w| w.urs().set_bit());
        timer.egr().write(|w| w.ug().set_bit());
        timer.sr().write(|w| w.uif().clear());
        timer.dier().write(|w| w.uie().set_bit());
        Self { len: 0, response: [0; Short::MAX], failed: false, frame: 0..0, over: false }
    }

    /// Takes TIM5's interrupt, if that is why the task was called. What counts is whether the time is over.
    pub fn clear_pending_timer(&mut self) {
        if tim5().sr().read().uif().bit_is_set() {
            tim5().sr().write(|w| w.uif().clear());
            self.over = true;
        }
    }

    /// Clears EXTI3's pending edge. What counts is the pin's level.
    pub fn clear_pending_irq(&mut self) {
        // SAFETY: a register block is always there, and every access through it is volatile; PR is cleared by the ones
        // written, and only line 3 is.
        let exti = unsafe { &*pac::EXTI::ptr() };
        exti.pr().write(|w| w.pr3().clear_bit_by_one());
    }

    /// Takes the SPI's requests from streams that are off, and clears the streams' flags.
    fn finish(&mut self) {
        spi().cr2().write(|w| w);
        dma::clear_flags(SPI_IN);
        dma::clear_flags(SPI_OUT);
    }

    /// Starts both streams. `lead` is sent ahead of what the stream out reads from `out`; what comes in goes to `into`,
    /// one byte after the other if `keep`, else all to the first.
    ///
    /// # Safety
    ///
    /// - Both streams are off.
    /// - From `out` on lie `len` bytes of a static made of atomics, and from `into` on as many (if `keep`; then without
    ///   a `lead`), else one.
    unsafe fn begin(&mut self, lead: Option<u8>, out: u32, into: u32, len: usize, keep: bool) {
        let peripheral = spi().dr().as_ptr() as u32;
        let incoming = Transfer {
            peripheral,
            memory: into,
            len: len + usize::from(lead.is_some()),
            direction: Direction::In { circular: false, advance: keep },
        };
        let outgoing = Transfer { peripheral, memory: out, len, direction: Direction::Out };
        self.finish();
        select();
        spi().cr2().write(|w| w.rxdmaen().set_bit());
        // SAFETY: the data register is that of SPI1, to which the table's streams and channel belong; the caller
        // vouches for the memory and for the streams being off; `finish` has cleared their flags.
        unsafe { dma::start(SPI_IN, &incoming) };
        if let Some(byte) = lead {
            put(byte);
        }
        // SAFETY: as for the stream in.
        unsafe { dma::start(SPI_OUT, &outgoing) };
        spi().cr2().write(|w| w.rxdmaen().set_bit().txdmaen().set_bit());
    }
}

impl Port for Radio {
    fn start_short(&mut self, short: &Short) {
        self.len = short.bytes().len();
        for (to, from) in SHORT_OUT.iter().zip(short.padded()) {
            to.store(*from, Ordering::Relaxed);
        }
        let (out, into) = (SHORT_OUT.as_ptr() as u32, SHORT_IN.as_ptr() as u32);
        // SAFETY: both are statics of `Short::MAX` atomic bytes, which `len` does not exceed. The streams are off: the
        // executor starts a transfer only after the one before it has ended, which switches them off, or was aborted.
        unsafe { self.begin(None, out, into, self.len, true) };
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let start = self.frame.start + offset;
        if start + len > self.frame.end {
            return false;
        }
        self.len = 0;
        let (out, into) = (FRAME.as_ptr() as u32 + start as u32, DISCARD.as_ptr() as u32);
        // SAFETY: `FRAME` is a static of atomics as large as a profile, inside which `frame` lies (`point_at`) and so
        // `start` and `len` stay; `DISCARD` is one atomic byte, and the address does not advance. The streams are off,
        // as for `start_short`.
        unsafe { self.begin(Some(command::FIFO_LOAD), out, into, len, false) };
        true
    }

    fn ended(&mut self) -> bool {
        let incoming = dma::flags(SPI_IN);
        self.failed = incoming.has_error() || dma::flags(SPI_OUT).has_error();
        if self.failed {
            self.abort();
            return true;
        }
        // The last byte comes in after the last one has gone out, so the stream out has ended too.
        if !incoming.is_complete() {
            return false;
        }
        self.finish();
        deselect();
        compiler_fence(Ordering::Acquire);
        for (to, from) in self.response[..self.len].iter_mut().zip(&SHORT_IN) {
            *to = from.load(Ordering::Relaxed);
        }
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        if self.failed {
            return Err(Failed);
        }
        Ok(&self.response[..self.len])
    }

    /// # Panics
    ///
    /// If a stream does not stop: the memory under it would be written behind the processor's back. A panic is the safe
    /// state, field off, and the reset that follows is what helps a DMA controller that hangs.
    fn abort(&mut self) {
        let stopped = (dma::stop(SPI_OUT), dma::stop(SPI_IN));
        assert!(matches!(stopped, (Ok(()), Ok(()))), "a DMA stream of the front end's does not stop");
        self.finish();
        deselect();
        // What is left in the receive buffer belongs to no transfer.
        let _ = spi().dr8().read();
        let _ = spi().sr().read();
    }

    fn irq_is_high(&mut self) -> bool {
        gpio::is_high(IRQ)
    }

    fn start_timer(&mut self, us: u32) {
        let timer = tim5();
        timer.cr1().write(|w| w.urs().set_bit());
        timer.cnt().write(|w| w.cnt().set(0));
        // An update comes ARR + 1 counts on: never early.
        timer.arr().write(|w| w.arr().set(us.max(1)));
        timer.sr().write(|w| w.uif().clear());
        timer.cr1().write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
        self.over = false;
    }

    fn elapsed(&mut self) -> bool {
        self.over
    }
}

impl transmitter::FrontEndPort for Radio {
    fn deposit(&mut self, profile: &Profile<RECEIVERS>) {
        let (words, _) = profile.as_bytes().as_chunks::<4>();
        for (word, bytes) in FRAME.iter().zip(words) {
            word.store(u32::from_ne_bytes(*bytes), Ordering::Relaxed);
        }
    }

    fn point_at(&mut self, frame: Range<usize>) {
        let end = frame.end.min(Profile::<RECEIVERS>::SIZE);
        self.frame = frame.start.min(end)..end;
    }

    fn arm(&mut self, ticket: Ticket) {
        ARMED.store(ticket.word(), Ordering::Release);
    }

    fn disarm(&mut self) -> bool {
        ARMED.swap(0, Ordering::Acquire) != 0
    }
}

/// Switches the RF field off, whatever the SPI was doing and whether or not it was ever set up. Blocks for some
/// microseconds, with a bound, and expects all interrupts to be masked for ever.
pub(super) fn field_off() {
    enable_clocks();
    // A stream that does not stop has no further request to serve as soon as CR2 is cleared; the field has to go off in
    // any case.
    let _ = (dma::stop(SPI_OUT), dma::stop(SPI_IN));
    spi().cr2().write(|w| w);
    deselect();
    set_up_spi();
    let _ = spi().dr8().read();
    // Longer than any minimum high time of chip select.
    asm::delay(timing::CORE_HZ / 1_000_000);
    select();
    // Operation control (register 02) = 0: transmitter, receiver and oscillator off (DS13541).
    for byte in [command::WRITE | 0x02, 0x00] {
        put(byte);
        take();
    }
    deselect();
}
