//! Drives the I2C bus of the sensors: TWIM1 as embedded-hal's `I2c`.
//!
//! The HAL's TWIM is not used, because it would wait for ever for a sensor that holds the bus. Here every wait has a
//! bound: a transfer that does not end in time is given up, and the bus is recovered. The caller waits for the end of
//! the transfer, so only a task of the lowest priority may use this driver.
//!
//! The bus works at 390 kbit/s. At 400 kbit/s the TWIM's SCL is low for only 1.25 µs (anomaly 219), and the
//! accelerometer needs 1.3 µs.

use core::sync::atomic::{compiler_fence, Ordering};

use embedded_hal::{
    delay::DelayNs,
    i2c::{self, ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation},
};
use hold_fw::sensors::bus::{recover, Lines};
use nrf52840_hal::pac;

use super::{now_us, HOLD_TELEMETRY};
use crate::board::BusPins;

/// The most bytes that one transfer sends or receives.
const LONGEST: usize = 8;
/// The time after which a transfer is given up, µs. [`LONGEST`] bytes in each direction with the addresses take 0.5 ms.
const TRANSFER_US: u32 = 1_000;
/// The value of FREQUENCY for 390 kbit/s (anomaly 219).
const FREQUENCY: u32 = 0x0620_0000;

pub(crate) struct Memory {
    send: [u8; LONGEST],
    receive: [u8; LONGEST],
}

impl Memory {
    pub(crate) const EMPTY: Self = Self { send: [0; LONGEST], receive: [0; LONGEST] };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Error {
    /// No sensor has acknowledged the address or a byte.
    NoAcknowledge,
    /// A line stays low, or the transfer did not end in time.
    Stuck,
    /// The driver does not support transfers of this kind or length.
    Unsupported,
}

impl i2c::Error for Error {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NoAcknowledge => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown),
            Self::Stuck => ErrorKind::Bus,
            Self::Unsupported => ErrorKind::Other,
        }
    }
}

pub(crate) struct Bus {
    twim: pac::TWIM1,
    lines: OpenDrains,
    memory: &'static mut Memory,
}

impl Bus {
    pub(super) fn new(twim: pac::TWIM1, pins: BusPins, memory: &'static mut Memory) -> Self {
        let mut lines = OpenDrains(pins);
        lines.let_go();
        // SAFETY: the selector is that of a pin that `lines` owns and has configured as PS v1.7, 6.31 wants.
        twim.psel.scl.write(|w| unsafe { w.bits(lines.0.scl.psel_bits()) });
        // SAFETY: as above.
        twim.psel.sda.write(|w| unsafe { w.bits(lines.0.sda.psel_bits()) });
        // SAFETY: the value is that of anomaly 219's measure.
        twim.frequency.write(|w| unsafe { w.bits(FREQUENCY) });
        twim.enable.write(|w| w.enable().enabled());
        Self { twim, lines, memory }
    }

    /// Frees the I2C bus. Returns whether SDA and SCL are high afterwards.
    fn recover(&mut self) -> bool {
        HOLD_TELEMETRY.bus_recoveries.add(1);
        self.twim.enable.write(|w| w.enable().disabled());
        let free = recover(&mut self.lines);
        self.lines.let_go();
        self.twim.enable.write(|w| w.enable().enabled());
        free
    }

    /// Waits until the TWIM has stopped; after an error it stops the TWIM. Returns false if that takes too long.
    fn stopped(&mut self) -> bool {
        let from = now_us();
        while self.twim.events_stopped.read().bits() == 0 {
            if self.twim.events_error.read().bits() != 0 {
                self.twim.events_error.reset();
                // SAFETY: 1 is a valid value of a task register.
                self.twim.tasks_stop.write(|w| unsafe { w.bits(1) });
            }
            if now_us().wrapping_sub(from) > TRANSFER_US {
                return false;
            }
        }
        true
    }

    /// Sends bytes over the I2C bus, then receives bytes. One of the two may be empty.
    ///
    /// It is in the image once, not once for each access to a sensor, so that a fault of any access executes it.
    #[inline(never)]
    fn run(&mut self, address: u8, send: &[u8], receive: &mut [u8]) -> Result<(), Error> {
        let Some(out) = self.memory.send.get_mut(..send.len()) else { return Err(Error::Unsupported) };
        out.copy_from_slice(send);
        if receive.len() > LONGEST || send.is_empty() && receive.is_empty() {
            return Err(Error::Unsupported);
        }
        if !(self.lines.scl() && self.lines.sda()) && !self.recover() {
            return Err(Error::Stuck);
        }
        let twim = &self.twim;
        // SAFETY: an address has seven bits, as the field does.
        twim.address.write(|w| unsafe { w.address().bits(address & 0x7F) });
        // SAFETY: (all four) `self` owns the memory for ever, the counts are at most its lengths, and nobody else
        // accesses it before the transfer has ended or the TWIM was disabled.
        twim.txd.ptr.write(|w| unsafe { w.ptr().bits(self.memory.send.as_ptr() as u32) });
        // SAFETY: as above.
        twim.txd.maxcnt.write(|w| unsafe { w.maxcnt().bits(send.len() as u16) });
        // SAFETY: as above.
        twim.rxd.ptr.write(|w| unsafe { w.ptr().bits(self.memory.receive.as_mut_ptr() as u32) });
        // SAFETY: as above.
        twim.rxd.maxcnt.write(|w| unsafe { w.maxcnt().bits(receive.len() as u16) });
        twim.events_stopped.reset();
        twim.events_error.reset();
        // SAFETY: ones clear the bits of ERRORSRC, which are all defined (PS v1.7, 6.31).
        twim.errorsrc.write(|w| unsafe { w.bits(0b111) });
        compiler_fence(Ordering::SeqCst);
        if receive.is_empty() {
            twim.shorts.write(|w| w.lasttx_stop().enabled());
        } else {
            twim.shorts.write(|w| w.lasttx_startrx().enabled().lastrx_stop().enabled());
        }
        let start = if send.is_empty() { twim.tasks_startrx.as_ptr() } else { twim.tasks_starttx.as_ptr() };
        // SAFETY: the register is that of a task, for which 1 is a valid value.
        unsafe { start.write_volatile(1) };
        if !self.stopped() {
            self.recover();
            return Err(Error::Stuck);
        }
        compiler_fence(Ordering::SeqCst);
        // If a transfer skips a direction that has no bytes, AMOUNT of that direction keeps an earlier count. So AMOUNT
        // is not compared then.
        let sent = send.is_empty() || self.twim.txd.amount.read().bits() as usize == send.len();
        let received = receive.is_empty() || self.twim.rxd.amount.read().bits() as usize == receive.len();
        if self.twim.errorsrc.read().bits() != 0 || !sent || !received {
            return Err(Error::NoAcknowledge);
        }
        receive.copy_from_slice(&self.memory.receive[..receive.len()]);
        Ok(())
    }
}

impl ErrorType for Bus {
    type Error = Error;
}

impl I2c for Bus {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), Error> {
        match operations {
            [Operation::Write(send)] => self.run(address, send, &mut []),
            [Operation::Read(receive)] => self.run(address, &[], receive),
            [Operation::Write(send), Operation::Read(receive)] => self.run(address, send, receive),
            _ => Err(Error::Unsupported),
        }
    }
}

/// The lines SDA and SCL as open-drain GPIO pins, by which the bus is recovered.
struct OpenDrains(BusPins);

const SDA: usize = 26;
const SCL: usize = 27;

impl OpenDrains {
    fn port() -> &'static pac::p0::RegisterBlock {
        // SAFETY: a register block is always there. Tasks of other priorities access only other pins, through registers
        // in which zeros change nothing.
        unsafe { &*pac::P0::ptr() }
    }

    /// Makes SDA and SCL inputs, with the drive that the TWIM needs. The GPIO then no longer holds either line low.
    fn let_go(&mut self) {
        for pin in [SDA, SCL] {
            Self::port().pin_cnf[pin].write(|w| w.dir().input().input().connect().pull().pullup().drive().s0d1());
        }
    }

    fn set(pin: usize, high: bool) {
        if high {
            // SAFETY: the bit is that of a pin of this bus.
            Self::port().outset.write(|w| unsafe { w.bits(1 << pin) });
        } else {
            // SAFETY: the bit is that of a pin of this bus.
            Self::port().outclr.write(|w| unsafe { w.bits(1 << pin) });
        }
        Self::port().pin_cnf[pin].write(|w| w.dir().output().input().connect().pull().pullup().drive().s0d1());
    }

    fn is_high(pin: usize) -> bool {
        Self::port().in_.read().bits() >> pin & 1 != 0
    }
}

impl Lines for OpenDrains {
    fn set_scl(&mut self, high: bool) {
        Self::set(SCL, high);
    }

    fn set_sda(&mut self, high: bool) {
        Self::set(SDA, high);
    }

    fn scl(&mut self) -> bool {
        Self::is_high(SCL)
    }

    fn sda(&mut self) -> bool {
        Self::is_high(SDA)
    }

    fn pause(&mut self) {
        Pause.delay_us(5);
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Pause;

impl DelayNs for Pause {
    #[inline(never)]
    fn delay_ns(&mut self, ns: u32) {
        let from = now_us();
        // The µs counter may be about to advance, so one µs more is waited for.
        while now_us().wrapping_sub(from) <= ns.div_ceil(1_000) {}
    }
}
