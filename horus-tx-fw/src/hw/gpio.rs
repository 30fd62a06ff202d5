//! Pins: their mode, their speed and their level
//!
//! Pins are set up by number, from the board's table, which the HAL does not allow: it has a type for each pin.
//!
//! `unsafe` is used here for shared access to the ports' register blocks, and for values that have no enumeration.
#![allow(unsafe_code)]

use stm32f4xx_hal::{
    pac::{self, gpioa},
    rcc::Enable,
};

use crate::board::{AlternatePin, GpioPort, Pin};

#[derive(Clone, Copy)]
pub(super) enum Speed {
    Low = 0b00,
    VeryHigh = 0b11,
}

/// The pull resistor, which holds the level of a pin that nothing drives.
#[derive(Clone, Copy)]
pub(super) enum Pull {
    None = 0b00,
    Up = 0b01,
    Down = 0b10,
}

const INPUT: u32 = 0b00;
const OUTPUT: u32 = 0b01;
const ALTERNATE: u32 = 0b10;

/// Switches on the clocks of all GPIO ports in use. May be called again at any time.
pub(super) fn enable_ports() {
    // SAFETY: each call sets one bit in the clock enable register, atomically (the HAL uses the bit-band region).
    unsafe {
        pac::GPIOA::enable_unchecked();
        pac::GPIOB::enable_unchecked();
        pac::GPIOC::enable_unchecked();
        pac::GPIOD::enable_unchecked();
        pac::GPIOE::enable_unchecked();
        pac::GPIOF::enable_unchecked();
    }
}

#[inline(always)]
fn block(port: GpioPort) -> &'static gpioa::RegisterBlock {
    // Not covered: the ports that no pin of the caller is on: a caller that holds its pins in a variable keeps the code
    // for all.
    let block: *const gpioa::RegisterBlock = match port {
        GpioPort::A => pac::GPIOA::ptr(),
        GpioPort::B => pac::GPIOB::ptr().cast(),
        GpioPort::C => pac::GPIOC::ptr().cast(),
        GpioPort::D => pac::GPIOD::ptr().cast(),
        GpioPort::E => pac::GPIOE::ptr().cast(),
        GpioPort::F => pac::GPIOF::ptr().cast(),
    };
    // SAFETY: a register block is always there, and every access through it is volatile. All ports have the same
    // registers (RM0090 "GPIO register map"); only their reset values differ. Configuration registers are changed only
    // where no other change can come in between: in `init`, before interrupts are enabled; by the tasks of the
    // receivers' sources, which have one priority ([`drive`], [`connect`]); and in the safe state, after interrupts are
    // disabled for good.
    unsafe { &*block }
}

/// Returns `word` with its field number `field`, of `width` bits, set to `value`.
const fn with_field(word: u32, field: u8, width: u8, value: u32) -> u32 {
    let at = field as u32 * width as u32;
    word & !(((1 << width) - 1) << at) | value << at
}

fn configure(pin: Pin, mode: u32, speed: Speed, pull: Pull) {
    // Not covered: the other ports, as in `block`.
    let port = block(pin.port);
    // SAFETY: every two-bit value of these registers is defined except 0b11 of PUPDR, which `Pull` does not have, and
    // only this pin's field changes.
    unsafe {
        port.pupdr().modify(|r, w| w.bits(with_field(r.bits(), pin.number, 2, pull as u32)));
        port.ospeedr().modify(|r, w| w.bits(with_field(r.bits(), pin.number, 2, speed as u32)));
        port.moder().modify(|r, w| w.bits(with_field(r.bits(), pin.number, 2, mode)));
    }
}

pub(super) fn alternate(alternate: AlternatePin, speed: Speed, pull: Pull) {
    let AlternatePin { pin, function } = alternate;
    // Not covered: the other ports, as in `block`.
    let port = block(pin.port);
    let function = u32::from(function & 0xF);
    // SAFETY: every four-bit value is one of the alternate functions, and only this pin's field changes.
    unsafe {
        // Not covered: only this line, the other half of the pins, in the copies for callers whose pins are all in one.
        if pin.number < 8 {
            port.afrl().modify(|r, w| w.bits(with_field(r.bits(), pin.number, 4, function)));
        } else {
            port.afrh().modify(|r, w| w.bits(with_field(r.bits(), pin.number - 8, 4, function)));
        }
    }
    // Not covered: the copies for other ports, as in `block`.
    configure(pin, ALTERNATE, speed, pull);
}

/// Makes a pin an output, whose level is `high` from the beginning.
pub(super) fn output(pin: Pin, speed: Speed, high: bool) {
    write(pin, high);
    configure(pin, OUTPUT, speed, Pull::None);
}

/// Connects a pin to its peripheral as an output that only ever pulls low, and whose level can be read. Its output
/// latch is high, so [`drive`] releases the pin at first.
pub(super) fn open_drain(alternate_pin: AlternatePin) {
    let AlternatePin { pin, .. } = alternate_pin;
    write(pin, true);
    // SAFETY: the register has one bit for each pin, and only this pin's bit changes.
    block(pin.port).otyper().modify(|r, w| unsafe { w.bits(with_field(r.bits(), pin.number, 1, 1)) });
    alternate(alternate_pin, Speed::Low, Pull::None);
}

/// Takes a pin from its peripheral, so that [`write`] drives it. [`open_drain`] has set the pin up. Only the tasks of
/// the receivers' sources may call this.
pub(super) fn drive(pin: Pin) {
    set_mode(pin, OUTPUT);
}

/// Gives a pin back to its peripheral. Only the tasks of the receivers' sources may call this.
pub(super) fn connect(pin: Pin) {
    // Not covered: the copies for other ports, as in `block`.
    set_mode(pin, ALTERNATE);
}

fn set_mode(pin: Pin, mode: u32) {
    // SAFETY: every two-bit value is a mode, and only this pin's field changes.
    // Not covered: the copies for other ports, as in `block`.
    block(pin.port).moder().modify(|r, w| unsafe { w.bits(with_field(r.bits(), pin.number, 2, mode)) });
}

pub(super) fn input(pin: Pin, pull: Pull) {
    configure(pin, INPUT, Speed::Low, pull);
}

#[inline(always)]
pub(super) fn write(pin: Pin, high: bool) {
    // Not covered: the copies for other ports, as in `block`.
    let set = 1 << pin.number;
    // SAFETY: BSRR changes only the pins whose bit is one: its low half sets them, and its high half resets them.
    // Not covered: the copies for other ports, as in `block`.
    block(pin.port).bsrr().write(|w| unsafe { w.bits(if high { set } else { set << 16 }) });
}

#[inline(always)]
pub(super) fn is_high(pin: Pin) -> bool {
    // Not covered: the copies for other ports, as in `block`.
    block(pin.port).idr().read().bits() & 1 << pin.number != 0
}
