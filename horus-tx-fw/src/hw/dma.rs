//! DMA streams
//!
//! # Design
//!
//! Bytes, one at a time, without the streams' FIFOs (direct mode). Memory that a DMA controller reads or writes is made
//! of atomics in main SRAM (the CCM RAM is out of a DMA's reach, RM0090 "Memory and bus architecture"), so that no
//! reference to it ever claims more than is true.
//!
//! **Switching off.** A stream whose EN is cleared goes on until the transfer that it has begun has ended, and EN reads
//! 1 until then; only when it reads 0 may the stream be set up again, and only then is the memory the processor's
//! (RM0090 "DMA controller", stream configuration procedure, step 1; AN4031, which asks for the same before the
//! peripheral is switched off). [`stop`] waits for that, with a bound.
//!
//! # Errata (ES0206 rev 24, and AN4031) of what is used here
//!
//! - AN4031, DMA2: DMA2 may corrupt data when it serves AHB and APB peripherals at once. Here: DMA2 serves APB2 alone:
//!   SPI1 and SPI5.
//!
//! `unsafe` here: shared access to the controllers' register blocks, addresses that a stream is given, and flag
//! registers that are written as words.
#![allow(unsafe_code)]

use cortex_m::asm;
use stm32f4xx_hal::{
    pac::{self, dma2},
    rcc::Enable,
};

use crate::board::{Dma, Stream};

/// Which way the bytes go.
pub(super) enum Direction {
    /// From the peripheral: to one byte after the other if `advance`, else all to the same; for ever round if
    /// `circular`.
    In { circular: bool, advance: bool },
    /// To the peripheral.
    Out,
}

/// What a stream is to transfer.
pub(super) struct Transfer {
    /// The address of the peripheral's data register.
    pub(super) peripheral: u32,
    /// The address of the first byte in memory.
    pub(super) memory: u32,
    /// How many bytes, at least 1 and at most 65535.
    pub(super) len: usize,
    pub(super) direction: Direction,
}

/// A stream's flags.
pub(super) struct Flags(u32);

/// All five flags of one stream, and two of them.
const ALL_FLAGS: u32 = 0x3D;
const TRANSFER_ERROR: u32 = 1 << 3;
const TRANSFER_COMPLETE: u32 = 1 << 5;

impl Flags {
    /// The bus answered with an error, which has switched the stream off.
    pub(super) fn has_error(&self) -> bool {
        self.0 & TRANSFER_ERROR != 0
    }

    /// All bytes have been transferred (in a ring: the last of the lap).
    pub(super) fn is_complete(&self) -> bool {
        self.0 & TRANSFER_COMPLETE != 0
    }
}

/// Switches both controllers' clocks on. Can be called again at any time.
pub(super) fn enable() {
    // SAFETY: sets one bit each in the clock enable register, atomically (the HAL uses the bit-band region).
    unsafe {
        pac::DMA1::enable_unchecked();
        pac::DMA2::enable_unchecked();
    }
}

fn controller(dma: Dma) -> &'static dma2::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile. Each stream has one user (the
    // board's table asserts it), and the flag clear registers act on the ones written alone.
    unsafe {
        &*match dma {
            Dma::One => pac::DMA1::ptr(),
            Dma::Two => pac::DMA2::ptr(),
        }
    }
}

fn registers(stream: Stream) -> &'static dma2::ST {
    controller(stream.dma).st(usize::from(stream.number))
}

const fn flag_shift(stream: Stream) -> u32 {
    match stream.number % 4 {
        0 => 0,
        1 => 6,
        2 => 16,
        _ => 22,
    }
}

/// The stream's flags.
pub(super) fn flags(stream: Stream) -> Flags {
    let dma = controller(stream.dma);
    let word = if stream.number < 4 { dma.lisr().read().bits() } else { dma.hisr().read().bits() };
    Flags(word >> flag_shift(stream) & ALL_FLAGS)
}

/// Clears all flags of the stream. A stream does not start while one is set.
pub(super) fn clear_flags(stream: Stream) {
    let dma = controller(stream.dma);
    let flags = ALL_FLAGS << flag_shift(stream);
    // SAFETY: ones clear those flags, zeros do nothing; the bits are the stream's own.
    unsafe {
        if stream.number < 4 {
            dma.lifcr().write(|w| w.bits(flags));
        } else {
            dma.hifcr().write(|w| w.bits(flags));
        }
    }
}

/// Starts the stream. Interrupts: end and error of what comes in (for a ring, its half too), error of what goes out.
///
/// # Safety
///
/// - `transfer.peripheral` is the address of the data register of the peripheral whose requests the stream's channel
///   is, a byte of which may be read (in) or written (out).
/// - From `transfer.memory` on lie `transfer.len` bytes (one byte if the transfer comes in and does not advance) of one
///   or more statics in main SRAM that are made of atomics, and nobody relies on what they hold until the stream has
///   ended or been stopped.
/// - The stream is off, [`is_on`] says so, and its flags are clear.
pub(super) unsafe fn start(stream: Stream, transfer: &Transfer) {
    let registers = registers(stream);
    // SAFETY: the caller vouches for both addresses and the length behind the second.
    unsafe {
        registers.par().write(|w| w.pa().bits(transfer.peripheral));
        registers.m0ar().write(|w| w.m0a().bits(transfer.memory));
    }
    registers.ndtr().write(|w| w.ndt().set(transfer.len as u16));
    // What the processor has written into that memory is there before the stream reads it.
    asm::dmb();
    registers.cr().write(|w| {
        w.chsel().set(stream.channel);
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

/// Whether the stream is on.
pub(super) fn is_on(stream: Stream) -> bool {
    registers(stream).cr().read().en().bit_is_set()
}

/// How many bytes are left to transfer (in a ring: in this lap).
pub(super) fn left(stream: Stream) -> usize {
    usize::from(registers(stream).ndtr().read().ndt().bits())
}

/// A stream that was switched off is still on.
#[derive(Debug)]
pub(super) struct StillOn;

/// How often [`stop`] asks whether the stream is off. Each time takes at least 6 core cycles, so 128 take 5 µs. The one
/// byte that can be under way needs one access to the peripheral and one to memory, each of a few cycles of its bus
/// even when it has to wait for the other masters' turn.
const STOP_POLLS: u32 = 128;

/// Switches the stream off, if it is on, and waits until it is. It must have been given a peripheral that still
/// answers.
///
/// # Errors
///
/// [`StillOn`] if it has not ended after some microseconds: the controller or its bus hangs, and the memory is not the
/// processor's. Nothing but a reset helps.
pub(super) fn stop(stream: Stream) -> Result<(), StillOn> {
    registers(stream).cr().modify(|_, w| w.en().clear_bit());
    if (0..STOP_POLLS).any(|_| !is_on(stream)) {
        // The memory is read after the stream has written it.
        asm::dmb();
        Ok(())
    } else {
        Err(StillOn)
    }
}
