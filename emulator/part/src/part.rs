//! A microcontroller without its core, and its surroundings.

use cortex_m4::{Access, Bound, BusError, Config, Signals, Width};

use crate::{Cycle, Finding, I2cAnswer, I2cEvent, Pad, Pin, Pins, SpiFrame, StuckBit, UartFrame};

/// The number of the exception that is interrupt 0 (ARMv7-M ARM table B1-4).
const FIRST_INTERRUPT: usize = 16;

/// The clock of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// The nominal rate in hertz, as if the clock's source were exact; 0 while the core has no clock.
    pub hz: u64,
    /// How much faster the clock's source is than nominal, in parts per billion; negative if it is slower.
    pub ppb: i64,
}

/// The cause of a restart of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// The supply came on. RAM holds noise.
    PowerOn,
    /// The supply fell below the brown-out threshold for a moment. RAM survived.
    BrownOut,
    /// The reset pin was pulled.
    Pin,
    /// A watchdog ran out. The text is the watchdog's name in the manual.
    Watchdog(&'static str),
    /// The core locked up, and the part resets on a lock-up.
    Lockup,
    /// The firmware wrote AIRCR.SYSRESETREQ.
    Software,
    /// The part left a sleep mode that ends in a reset. The text names the mode or the cause of the wake-up.
    Wakeup(&'static str),
}

/// The effect of the supply on a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supplied {
    /// The part is not held in reset.
    Enough,
    /// The part is held in reset: its core executes nothing.
    HeldInReset,
    /// The part was held in reset and now restarts for this cause.
    Restarts(Reset),
}

/// The receiver of everything that leaves a part. The bench implements it for the board around the part.
pub trait Outside {
    /// Reports that the part holds `pin` in another state from `at` on.
    fn pin(&mut self, at: Cycle, pin: Pin, pad: Pad);

    /// Takes a frame that an SPI controller has clocked out; the call comes at the frame's end. Returns the bits of
    /// MISO in the order of [`SpiFrame::data`], or `None` if nothing drove the pin. The part then reads the level that
    /// its pull resistor gives.
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32>;

    /// Takes a UART frame that was sent on `pin` and whose last stop bit ended at `at`.
    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame);

    /// Answers an I2C controller on these pins. Its action on the bus ended at `at`.
    fn i2c(&mut self, at: Cycle, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer;

    /// The voltage on an analogue input in microvolts, 0 if nothing is connected.
    fn microvolts(&self, at: Cycle, pin: Pin) -> i32;
}

/// An outside with nothing connected: every pin is open, and every bus is empty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Open;

impl Outside for Open {
    fn pin(&mut self, _: Cycle, _: Pin, _: Pad) {}

    fn spi(&mut self, _: &SpiFrame) -> Option<u32> {
        None
    }

    fn uart(&mut self, _: Cycle, _: Pin, _: &UartFrame) {}

    fn i2c(&mut self, _: Cycle, _: Pin, _: Pin, _: I2cEvent) -> I2cAnswer {
        I2cAnswer::NOBODY
    }

    fn microvolts(&self, _: Cycle, _: Pin) -> i32 {
        0
    }
}

/// A microcontroller without its core. It is plain data, and a clone runs on as the original does.
///
/// The bench calls [`Part::advance`] when the core's cycle reaches [`Part::due`], before the core's next access. A
/// `read` or `write` therefore finds all earlier events done. When the call returns, its immediate effects are done,
/// and [`Signals::is_announced`] tells whether lines or [`Part::due`] changed.
pub trait Part: Clone + std::fmt::Debug + Send + 'static {
    /// The part's name, as its maker writes it.
    const NAME: &'static str;

    /// The part's pins.
    const PINS: Pins;

    /// The names of the part's interrupts in its manual, by number; empty if nothing has that number. The program's
    /// symbols are no substitute, because the compiler merges handlers with equal code.
    const INTERRUPTS: &'static [&'static str];

    /// The addresses and sizes of the part's RAM. It has noise at power-on and belongs to a digest of the state.
    const RAM: &'static [(u32, usize)];

    /// Whether a lock-up of the core resets the part.
    const RESETS_ON_LOCKUP: bool;

    /// The number of the exception of the interrupt called `name`; `None` if the part has no such interrupt.
    #[must_use]
    fn exception(name: &str) -> Option<u16> {
        let number = Self::INTERRUPTS.iter().position(|other| !other.is_empty() && *other == name)?;
        u16::try_from(FIRST_INTERRUPT + number).ok()
    }

    /// The configuration of this part's core.
    fn core(&self) -> Config;

    /// Carries out a read by the core, see [`cortex_m4::Bus::read`].
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] where the part has nothing, or refuses the access.
    fn read<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError>;

    /// Carries out a write by the core, see [`cortex_m4::Bus::write`].
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] where the part has nothing, or refuses the access.
    fn write<O: Outside>(&mut self, access: &Access, value: u32, outside: &mut O) -> Result<(), BusError>;

    /// Reads memory that answers at once, see [`cortex_m4::Bus::read_memory`].
    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        let _ = (address, width);
        None
    }

    /// Writes memory that takes the value at once, see [`cortex_m4::Bus::write_memory`].
    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        let _ = (address, width, value);
        false
    }

    /// Reads a halfword for the decoder, see [`cortex_m4::Bus::fetch`].
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] where nothing can be executed.
    fn fetch(&mut self, address: u32) -> Result<u16, BusError>;

    /// Whether the memory at `address` stays the same, see [`cortex_m4::Bus::is_constant`].
    fn is_constant(&self, address: u32) -> bool;

    /// Begins to watch a page for writes, see [`cortex_m4::Bus::watch_code`]. [`crate::Ram`] implements it.
    fn watch_code(&mut self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// Whether a page is watched and was not written, see [`cortex_m4::Bus::is_watched`].
    fn is_watched(&self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// The number of watched pages that have been written, see [`cortex_m4::Bus::rewritten`].
    #[inline(always)]
    fn rewritten(&self) -> u64 {
        0
    }

    /// The next cycle at which something happens in the part.
    fn due(&self) -> Cycle;

    /// Carries out everything that is due at or before `to`, in order.
    fn advance<O: Outside>(&mut self, to: Cycle, outside: &mut O);

    /// The signals that the part drives into the core.
    fn signals(&mut self) -> &mut Signals;

    /// The wait states of an access, see [`cortex_m4::Bus::wait_states`].
    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32;

    /// The wait states of an access to memory, see [`cortex_m4::Bus::memory_waits`].
    #[inline(always)]
    fn memory_waits(&mut self, address: u32, fetch: bool, cycle: Cycle, bound: Bound) -> Option<u32> {
        let _ = (address, fetch, cycle, bound);
        None
    }

    /// Whether the part has the core's bit-band aliases.
    fn bit_banding(&self) -> bool {
        false
    }

    /// The present clock of the core. The part announces a change by [`Signals::announce`], and cycles then count at
    /// the new rate.
    fn clock(&self) -> Clock;

    /// Restarts the part at `at`. Registers take the reset values that the manual gives for this cause, and pins are no
    /// longer driven. Memory keeps its contents.
    fn reset<O: Outside>(&mut self, at: Cycle, cause: Reset, outside: &mut O);

    /// Takes a restart that the part requests (watchdog, wake-up). The bench calls this after every other call, and
    /// each request is returned once.
    fn take_reset(&mut self) -> Option<Reset>;

    /// Sets the supply to `microvolts` from `at` on. `seed` decides what goes wrong at a voltage too low for the part's
    /// work. A part without a model of its supply always has enough.
    fn supply<O: Outside>(&mut self, at: Cycle, microvolts: u32, seed: u64, outside: &mut O) -> Supplied {
        let _ = (at, microvolts, seed, outside);
        Supplied::Enough
    }

    /// Returns whether the part has warned its firmware of a falling supply since the last call.
    fn take_supply_warning(&mut self) -> bool {
        false
    }

    /// Tells the part that the core fell asleep (`asleep`; `deep` is SCR.SLEEPDEEP) or woke.
    fn sleeps<O: Outside>(&mut self, at: Cycle, asleep: bool, deep: bool, outside: &mut O) {
        let _ = (at, asleep, deep, outside);
    }

    /// Tells the part that the core was halted for debug (`halted`) or resumed.
    fn halts<O: Outside>(&mut self, at: Cycle, halted: bool, outside: &mut O) {
        let _ = (at, halted, outside);
    }

    /// Makes the outside drive `pin` (`Some`) or stop driving it (`None`) from `at` on.
    fn drive<O: Outside>(&mut self, at: Cycle, pin: Pin, level: Option<bool>, outside: &mut O);

    /// The level of `pin` now, whoever drives the pin. A floating pin is low.
    fn pin(&self, pin: Pin) -> bool;

    /// Receives a UART frame on `pin` whose start bit began at `begins`. The call comes at the frame's end or before.
    /// The receiver reacts at its own sample instants.
    fn receive<O: Outside>(&mut self, begins: Cycle, pin: Pin, frame: UartFrame, outside: &mut O);

    /// The `size` bytes of memory at `address` (flash, RAM, option bytes), as a debugger reads them; `None` if any of
    /// these bytes is not memory.
    fn memory(&self, address: u32, size: usize) -> Option<&[u8]>;

    /// The `size` bytes of memory at `address`, flash included, for a loader that changes them. The core then decodes
    /// its instructions anew.
    fn memory_mut(&mut self, address: u32, size: usize) -> Option<&mut [u8]>;

    /// Makes one bit of RAM stuck, and releases any bit that was stuck before. With `None` no bit is stuck. Returns
    /// whether the part supports this and has RAM there.
    fn stick(&mut self, _stuck: Option<StuckBit>) -> bool {
        false
    }

    /// The findings so far, in the order of their first occurrence.
    fn findings(&self) -> &[Finding];
}
