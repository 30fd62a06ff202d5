//! DMA streams, which move the bytes of SPI, I2C and UARTs
//!
//! # Design
//!
//! The streams move bytes without their FIFOs (direct mode). Memory that DMA reads or writes consists of atomics, since
//! a reference to other types would promise that nobody else changes the memory. It is in main SRAM, because DMA cannot
//! reach the CCM RAM (RM0090 "Memory and bus architecture").
//!
//! **Switching off.** If EN is cleared, a stream first ends the transfer that it has begun, and EN reads 1 until then.
//! Only when EN reads 0 does the memory belong to the processor, and only then may the stream be set up again (RM0090
//! "DMA controller", stream configuration procedure, step 1; AN4031, which demands the same before the peripheral is
//! switched off). [`stop`] waits until EN reads 0, with a bound.
//!
//! # Errata (ES0206 rev 24, and AN4031) of the controllers
//!
//! - AN4031: DMA2 may corrupt data when it serves AHB and APB peripherals at once. Workaround: DMA2 serves only SPI1
//!   and SPI5, which are peripherals of APB2.
//!
//! `unsafe` is used here for shared access to the controllers' register blocks, for the addresses that a stream is
//! given, and for flag registers that are written as words.
#![allow(unsafe_code)]

use cortex_m::asm;
use stm32f4xx_hal::{
    pac::{self, dma2},
    rcc::Enable,
};

use crate::board::{Dma, Stream};

pub(super) enum Direction {
    /// The stream moves bytes from the peripheral to memory. If `advance` is true it writes one byte after the other,
    /// otherwise all to the same byte. If `circular` is true it never ends, and begins again after each round.
    In { circular: bool, advance: bool },
    /// The stream moves bytes from memory to the peripheral.
    Out,
}

pub(super) struct Transfer {
    pub(super) peripheral: u32,
    pub(super) memory: u32,
    /// The number of bytes, at least 1 and at most 65535.
    pub(super) len: usize,
    pub(super) direction: Direction,
}

pub(super) struct Flags(u32);

/// The mask of all five flags of a DMA stream.
const ALL_FLAGS: u32 = 0x3D;
const TRANSFER_ERROR: u32 = 1 << 3;
const TRANSFER_COMPLETE: u32 = 1 << 5;

impl Flags {
    /// Whether the bus answered the stream with an error, which has switched the stream off.
    pub(super) fn has_error(&self) -> bool {
        self.0 & TRANSFER_ERROR != 0
    }

    /// Whether all bytes have been transferred (in a ring: the last byte before the ring's end).
    pub(super) fn is_complete(&self) -> bool {
        self.0 & TRANSFER_COMPLETE != 0
    }
}

/// Switches the clocks of both DMA controllers on. May be called again at any time.
pub(super) fn enable() {
    // SAFETY: each call sets one bit in the clock enable register, atomically (the HAL uses the bit-band region).
    unsafe {
        pac::DMA1::enable_unchecked();
        pac::DMA2::enable_unchecked();
    }
}

fn controller(dma: Dma) -> &'static dma2::RegisterBlock {
    // SAFETY: a register block is always there, and every access through it is volatile. Each stream has one user (the
    // board's table asserts it), and the flag clear registers act only on bits that are written as one.
    unsafe {
        &*match dma {
            Dma::One => pac::DMA1::ptr(),
            Dma::Two => pac::DMA2::ptr(),
        }
    }
}

fn registers(stream: Stream) -> &'static dma2::ST {
    // Not covered: the other controller: the compiler keeps the code for both in the copies for callers that each have
    // a stream of one.
    controller(stream.dma).st(usize::from(stream.number))
}

const fn flag_shift(stream: Stream) -> u32 {
    // Not covered: the numbers of streams that the caller does not have, in its copy.
    match stream.number % 4 {
        0 => 0,
        1 => 6,
        2 => 16,
        _ => 22,
    }
}

pub(super) fn flags(stream: Stream) -> Flags {
    // Not covered: the other controller, in the copies for callers that each have a stream of one.
    let dma = controller(stream.dma);
    // Not covered: the other register, in the copies for callers whose streams are all in one.
    let word = if stream.number < 4 { dma.lisr().read().bits() } else { dma.hisr().read().bits() };
    Flags(word >> flag_shift(stream) & ALL_FLAGS)
}

/// Clears all flags of the stream. A stream does not start while one is set.
pub(super) fn clear_flags(stream: Stream) {
    let dma = controller(stream.dma);
    // Not covered: the numbers of other streams, as in `flag_shift`.
    let flags = ALL_FLAGS << flag_shift(stream);
    // SAFETY: ones clear the stream's flags, and zeros do nothing; the bits belong to this stream.
    unsafe {
        // Not covered: only this line, the other register, as in `flags`.
        if stream.number < 4 {
            dma.lifcr().write(|w| w.bits(flags));
        } else {
            dma.hifcr().write(|w| w.bits(flags));
        }
    }
}

/// Starts the stream with these interrupts: for incoming bytes the end and an error (of a ring also the half), for
/// outgoing bytes an error.
///
/// # Safety
///
/// - `transfer.peripheral` is the address of the data register of the peripheral to which the stream's channel belongs,
///   and a byte of that register may be read (in) or written (out).
/// - The memory of the transfer is the `transfer.len` bytes from `transfer.memory` on, or one byte if the transfer
///   comes in and does not advance. It lies in one or more statics in main SRAM that consist of atomics. No code relies
///   on the contents of this memory until the stream has ended or been stopped.
/// - The stream is off, as [`is_on`] tells, and its flags are clear.
pub(super) unsafe fn start(stream: Stream, transfer: &Transfer) {
    let registers = registers(stream);
    // SAFETY: the caller guarantees that both addresses, and the length behind the second, are right.
    unsafe {
        registers.par().write(|w| w.pa().bits(transfer.peripheral));
        registers.m0ar().write(|w| w.m0a().bits(transfer.memory));
    }
    registers.ndtr().write(|w| w.ndt().set(transfer.len as u16));
    // The stream must not start before the processor's writes into the memory are complete.
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

pub(super) fn is_on(stream: Stream) -> bool {
    registers(stream).cr().read().en().bit_is_set()
}

/// Returns the number of bytes that are left to transfer (in a ring: until the ring's end).
pub(super) fn left(stream: Stream) -> usize {
    usize::from(registers(stream).ndtr().read().ndt().bits())
}

#[derive(Debug)]
pub(super) struct StillOn;

/// How often [`stop`] asks whether the stream is off. Each poll takes at least 6 core cycles, so 128 polls take 5 µs.
/// Within that time the stream has at most one byte to finish, with one access to the peripheral and one to memory.
const STOP_POLLS: u32 = 128;

/// Switches the stream off, if it is on, and waits until it is off. Its peripheral must still answer.
///
/// # Errors
///
/// [`StillOn`] if the stream has not ended after some µs. Then the DMA controller or its bus hangs, the processor must
/// not use the stream's memory, and only a reset helps.
pub(super) fn stop(stream: Stream) -> Result<(), StillOn> {
    registers(stream).cr().modify(|_, w| w.en().clear_bit());
    // Not covered: the later polls, and their end without a stop: only a stream in the middle of an access needs them,
    // and that of the bench has ended its access when the register is written.
    if (0..STOP_POLLS).any(|_| !is_on(stream)) {
        // The processor must not read the memory before the stream has written it.
        asm::dmb();
        Ok(())
    } else {
        Err(StillOn)
    }
}
