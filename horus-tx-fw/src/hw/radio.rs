//! The front end's registers: SPI1 with its DMA streams, chip select, the IRQ pin, and TIM5 for the waits
//!
//! # Design
//!
//! Every operation of the port starts something and returns; the interrupt that ends the operation polls the executor.
//! The SPI has two users at different times: the slot's interrupt from [`transmitter::FrontEndPort::arm`] to the slot,
//! and otherwise the tasks of the front end, which have one priority.
//!
//! The SPI runs in mode 1 (CPOL 0, CPHA 1; DS13541, SPI interface) at 72 MHz / 8 = 9 MHz, most significant bit first.
//!
//! [`field_off`] relies on no earlier set-up. So it also works in the first instructions of the start, and after the
//! clock security system has switched the PLL off. The SPI then runs at 2 or 1 MHz. The bounds of the waits still hold,
//! because they count cycles of the processor, which is slower too.
//!
//! # Errata (ES0206 rev 24) of the peripherals used here
//!
//! - ES0206 2.12.1, 2.12.5: BSY may stay high when the SPI is disabled, or after a transfer in some modes, which are
//!   not used here. Workaround: the SPI stays enabled, and every wait for BSY has a bound.
//! - ES0206 2.12.4: the last bit may be corrupted in master mode with delayed SCK feedback. Workaround: the pin of SCK
//!   has the fastest output speed setting, and SCK runs at 9 MHz of the 45 MHz allowed.
//!
//! `unsafe` is used here for shared access to the register blocks of SPI1 and TIM5, to start the DMA streams, and for
//! the EXTI line's port.
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

/// The ticket for the next slot, as a word that the tasks and the slot's interrupt access atomically.
pub(super) static ARMED: AtomicU32 = AtomicU32::new(0);

fn spi() -> &'static spi1::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile. The ticket settles who may use
    unsafe { &*pac::SPI1::ptr() }
}

fn tim5() -> &'static pac::tim5::RegisterBlock {
    // SAFETY: the block is always there, every access is volatile, and the tasks that use TIM5 have one priority.
    unsafe { &*pac::TIM5::ptr() }
}

/// The number of polls of the SPI's status register that last longer than one byte. A byte at 9 MHz takes 128 core
/// cycles, and a poll over the APB at least 6. On HSI without the PLL a byte takes 64 or 128 core cycles.
const POLLS: u32 = 128;

#[inline(always)]
pub(super) fn select() {
    gpio::write(CHIP_SELECT, false);
}

/// Waits until the SPI has shifted its last bit out, for one byte time at most, then raises chip select. Chip select
/// must not rise during a bit (RM0090 "SPI", disabling).
pub(super) fn deselect() {
    // Not covered: the later polls: only an SPI that hangs needs them, and the bench's ends each byte in time.
    for _ in 0..POLLS {
        if spi().sr().read().bsy().bit_is_clear() {
            break;
        }
    }
    gpio::write(CHIP_SELECT, true);
}

#[inline(always)]
pub(super) fn put(byte: u8) {
    spi().dr8().write(|w| w.dr().set(byte));
}

/// Waits for the byte that comes in while a byte is sent. The wait takes one byte time at most, even if the SPI hangs.
#[inline(always)]
pub(super) fn take() -> u8 {
    // Not covered: the later polls: only an SPI that hangs needs them, as in `deselect`.
    for _ in 0..POLLS {
        if spi().sr().read().rxne().bit_is_set() {
            break;
        }
    }
    spi().dr8().read().dr().bits()
}

fn enable_clocks() {
    gpio::enable_ports();
    dma::enable();
    // SAFETY: this sets one bit in the clock enable register, atomically (the HAL uses the bit-band region).
    unsafe { pac::SPI1::enable_unchecked() };
}

fn set_up_spi() {
    // Chip select is made high before its pin becomes an output. The edges of the clock are fast because of erratum
    // 2.12.4.
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

fn set_up_irq(syscfg: &pac::SYSCFG, exti: &pac::EXTI) {
    gpio::input(IRQ, Pull::Down);
    // SAFETY: port A's code is 0 (RM0090 "SYSCFG", external interrupt configuration register 1).
    syscfg.exticr1().modify(|_, w| unsafe { w.exti3().bits(0) });
    exti.rtsr().modify(|_, w| w.tr3().set_bit());
    exti.imr().modify(|_, w| w.mr3().set_bit());
}

/// The profile's bytes, which DMA loads into the FIFO, as words. Every size of a profile is a whole number of words.
static FRAME: [AtomicU32; Profile::<RECEIVERS>::SIZE / 4] =
    [const { AtomicU32::new(0) }; Profile::<RECEIVERS>::SIZE / 4];
static SHORT_OUT: [AtomicU8; Short::MAX] = [const { AtomicU8::new(0) }; Short::MAX];
static SHORT_IN: [AtomicU8; Short::MAX] = [const { AtomicU8::new(0) }; Short::MAX];
/// During a load, DMA writes all bytes that come in to this byte, because nobody reads them.
static DISCARD: AtomicU8 = AtomicU8::new(0);

pub(super) fn memory() -> [Range<u32>; 4] {
    [memory::span(&FRAME), memory::span(&SHORT_OUT), memory::span(&SHORT_IN), memory::span(&DISCARD)]
}

const _: () = assert!(Profile::<RECEIVERS>::SIZE.is_multiple_of(4));

/// The front end's port: SPI1 with its two DMA streams, chip select, the IRQ pin's level, and the one-shot timer.
pub struct Radio {
    /// The number of bytes that the last transfer has brought as its response; 0 after a load.
    len: usize,
    response: [u8; Short::MAX],
    failed: bool,
    frame: Range<usize>,
    /// Whether the one-shot timer has run out.
    over: bool,
}

impl Radio {
    pub fn new(rcc: &mut pac::RCC, _spi: pac::SPI1, _timer: pac::TIM5, syscfg: pac::SYSCFG, exti: &pac::EXTI) -> Self {
        enable_clocks();
        pac::TIM5::enable(rcc);
        pac::SYSCFG::enable(rcc);
        set_up_spi();
        set_up_irq(&syscfg, exti);
        // The timer counts µs.
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

    /// Clears TIM5's interrupt if it is set, and records for the state machine that the time is over.
    pub fn clear_pending_timer(&mut self) {
        if tim5().sr().read().uif().bit_is_set() {
            tim5().sr().write(|w| w.uif().clear());
            self.over = true;
        }
    }

    /// Clears the pending edge of EXTI3. The driver's state machine reads the pin's level afterwards, so no edge is
    /// lost.
    pub fn clear_pending_irq(&mut self) {
        // SAFETY: a register block is always there, and every access through it is volatile; ones clear bits of PR, and
        // only the bit of line 3 is written as one.
        let exti = unsafe { &*pac::EXTI::ptr() };
        exti.pr().write(|w| w.pr3().clear_bit_by_one());
    }

    /// Disconnects SPI1's requests from both DMA streams, which must be off, and clears the streams' flags.
    fn finish(&mut self) {
        spi().cr2().write(|w| w);
        dma::clear_flags(SPI_IN);
        dma::clear_flags(SPI_OUT);
    }

    /// Starts both DMA streams of a transfer. The byte `lead` is sent before the bytes at `out`. The bytes that come in
    /// go to `into`: one after the other if `keep` is true, otherwise all to the same byte.
    ///
    /// # Safety
    ///
    /// - Both streams are off.
    /// - `out` is the address of `len` bytes of a static made of atomics. `into` is the address of `len` bytes of such
    ///   a static if `keep` is set, and of one byte otherwise. With `keep` there is no `lead`.
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
        // SAFETY: the data register is that of SPI1, to which the streams and channel of the board's table belong; the
        // caller guarantees the memory and that the streams are off; `finish` has cleared their flags.
        unsafe { dma::start(SPI_IN, &incoming) };
        if let Some(byte) = lead {
            put(byte);
        }
        // SAFETY: the data register is that of SPI1; the caller guarantees the memory and that the stream is off.
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
        // SAFETY: both buffers are statics of `Short::MAX` atomic bytes, which `len` does not exceed. The streams are
        // off: the executor starts a transfer only after the last one ended, which switches them off, or was aborted.
        unsafe { self.begin(None, out, into, self.len, true) };
    }

    fn start_load(&mut self, offset: usize, len: usize) -> bool {
        let start = self.frame.start + offset;
        // Not covered: bytes beyond the frame: the poller loads only those of the frame for which it was prepared.
        if start + len > self.frame.end {
            return false;
        }
        self.len = 0;
        let (out, into) = (FRAME.as_ptr() as u32 + start as u32, DISCARD.as_ptr() as u32);
        // SAFETY: `FRAME` is a static of atomics as large as a profile, inside which `frame` lies (`point_at`), and so
        // do `start` and `len`; `DISCARD` is one atomic byte, and the address does not advance. The streams are off, as
        // `start_short` says.
        unsafe { self.begin(Some(command::FIFO_LOAD), out, into, len, false) };
        true
    }

    fn ended(&mut self) -> bool {
        let incoming = dma::flags(SPI_IN);
        // Not covered: an error of a stream, which it has only at an address without memory: all addresses are those of
        // statics.
        self.failed = incoming.has_error() || dma::flags(SPI_OUT).has_error();
        // Not covered: an error of a stream, as above.
        if self.failed {
            self.abort();
            return true;
        }
        // The last byte comes in after the last one was sent, so the outgoing DMA stream has ended too.
        if !incoming.is_complete() {
            return false;
        }
        self.finish();
        // Not covered: the later polls of the SPI, as in `deselect`.
        deselect();
        compiler_fence(Ordering::Acquire);
        for (to, from) in self.response[..self.len].iter_mut().zip(&SHORT_IN) {
            *to = from.load(Ordering::Relaxed);
        }
        true
    }

    fn response(&self) -> Result<&[u8], Failed> {
        // Not covered: an error of a stream, as in `ended`.
        if self.failed {
            return Err(Failed);
        }
        Ok(&self.response[..self.len])
    }

    // Not covered: a transfer that does not end needs an SPI or a DMA controller that hangs, which the bench's do not.
    /// # Panics
    ///
    /// Panics if a stream does not stop, since it would write memory that the processor uses. The panic leads to the
    /// safe state with the field off, and the reset after it recovers a DMA controller that hangs.
    fn abort(&mut self) {
        let stopped = (dma::stop(SPI_OUT), dma::stop(SPI_IN));
        assert!(matches!(stopped, (Ok(()), Ok(()))), "a DMA stream of the front end's does not stop");
        self.finish();
        deselect();
        // A byte left in the SPI's receive buffer belongs to no transfer, and is dropped.
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
        // TIM5 raises its update ARR + 1 counts after the start, so a wait never ends early.
        // Not covered: a wait of 0 µs, which no state machine asks for.
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

/// Switches the RF field off, whatever the SPI was doing and even if it was never set up. This blocks for some µs at
/// most. All interrupts must be masked for good.
pub(super) fn field_off() {
    enable_clocks();
    // The field must go off even if a DMA stream does not stop. Once CR2 is cleared, such a stream has no request to
    // serve.
    let _ = (dma::stop(SPI_OUT), dma::stop(SPI_IN));
    spi().cr2().write(|w| w);
    deselect();
    set_up_spi();
    let _ = spi().dr8().read();
    // The delay keeps chip select high for 1 µs or more, longer than the chip requires.
    asm::delay(timing::CORE_HZ / 1_000_000);
    select();
    // Writing 0 to operation control (register 02) switches the chip's transmitter, receiver and oscillator off
    // (DS13541).
    for byte in [command::WRITE | 0x02, 0x00] {
        put(byte);
        // Not covered: the later polls of the SPI, as in `take`.
        take();
    }
    deselect();
}
