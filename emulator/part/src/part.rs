//! A microcontroller without its core, and what is around it.

use cortex_m4::{Access, Bound, BusError, Config, Signals, Width};

use crate::{Cycle, Finding, I2cAnswer, I2cEvent, Pad, Pin, SpiFrame, StuckBit, UartFrame};

/// What the core runs at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// In hertz if its source were exact; 0 while the core has no clock.
    pub hz: u64,
    /// How much faster the source is, in parts per billion (negative: slower).
    pub ppb: i64,
}

/// What restarts a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reset {
    /// The supply came on: nothing of the time before is left.
    PowerOn,
    /// The supply fell below the brown-out threshold for a moment: RAM survived.
    BrownOut,
    /// The reset pin.
    Pin,
    /// A watchdog, by its name in the manual.
    Watchdog(&'static str),
    /// The core locked up, on a part that resets then.
    Lockup,
    /// AIRCR.SYSRESETREQ.
    Software,
    /// Leaving a sleep mode that is a reset on the way out, by its name in the manual.
    Wakeup(&'static str),
}

/// What a part makes of its supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supplied {
    /// It is not held in reset.
    Enough,
    /// It is held in reset: its core runs nothing.
    HeldInReset,
    /// It was, and now it has to restart for this cause.
    Restarts(Reset),
}

/// What leaves a part. The bench implements it for what is wired to the part.
pub trait Outside {
    /// The part does something else to `pin` from `at` on. Only changes are told.
    fn pin(&mut self, at: Cycle, pin: Pin, pad: Pad);

    /// An SPI controller's frame has been clocked out by now, which is its end. Answers the bits that MISO carried, in
    /// the order they travelled, as [`SpiFrame::data`] has them; `None` where nothing drove the pin: the part then
    /// reads what its pull resistor makes of it.
    fn spi(&mut self, frame: &SpiFrame) -> Option<u32>;

    /// A UART frame was sent on `pin`; its last stop bit ended at `at`.
    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame);

    /// An I2C controller with these pins acts on the bus; what it did ended at `at`.
    fn i2c(&mut self, at: Cycle, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer;

    /// The voltage on an analogue input, in microvolts against ground; 0 where nothing is connected.
    fn microvolts(&self, at: Cycle, pin: Pin) -> i32;
}

/// Nothing around the part: every pin open, every bus empty.
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

/// A microcontroller without its core. Plain data: a clone run on does what the original does.
///
/// The bench calls [`Part::advance`] whenever the core's cycle reaches [`Part::due`], before the core's next access.
/// `read` and `write` therefore find everything that was due before them done; what an access itself sets off at once
/// is done when it returns, and [`Signals::is_announced`] says if lines or [`Part::due`] moved.
pub trait Part: Clone + std::fmt::Debug + Send + 'static {
    /// The part's name, as its maker writes it.
    const NAME: &'static str;

    /// Where its RAM is, and how much: what comes up with noise at power-on and belongs to a digest of the state.
    const RAM: &'static [(u32, usize)];

    /// Whether a lock-up of the core resets the part.
    const RESETS_ON_LOCKUP: bool;

    /// The core of this part.
    fn core(&self) -> Config;

    /// The core reads. See [`cortex_m4::Bus::read`].
    ///
    /// # Errors
    ///
    /// [`BusError`] where the part has nothing, or refuses.
    fn read<O: Outside>(&mut self, access: &Access, outside: &mut O) -> Result<u32, BusError>;

    /// The core writes. See [`cortex_m4::Bus::write`].
    ///
    /// # Errors
    ///
    /// [`BusError`] where the part has nothing, or refuses.
    fn write<O: Outside>(&mut self, access: &Access, value: u32, outside: &mut O) -> Result<(), BusError>;

    /// See [`cortex_m4::Bus::read_memory`].
    #[inline(always)]
    fn read_memory(&self, address: u32, width: Width) -> Option<u32> {
        let _ = (address, width);
        None
    }

    /// See [`cortex_m4::Bus::write_memory`].
    #[inline(always)]
    fn write_memory(&mut self, address: u32, width: Width, value: u32) -> bool {
        let _ = (address, width, value);
        false
    }

    /// See [`cortex_m4::Bus::fetch`].
    ///
    /// # Errors
    ///
    /// [`BusError`] where nothing can be executed.
    fn fetch(&mut self, address: u32) -> Result<u16, BusError>;

    /// See [`cortex_m4::Bus::is_constant`].
    fn is_constant(&self, address: u32) -> bool;

    /// See [`cortex_m4::Bus::watch_code`], which [`crate::Ram`] carries out.
    fn watch_code(&mut self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// See [`cortex_m4::Bus::is_watched`].
    fn is_watched(&self, address: u32) -> bool {
        let _ = address;
        false
    }

    /// See [`cortex_m4::Bus::rewritten`].
    #[inline(always)]
    fn rewritten(&self) -> u64 {
        0
    }

    /// The next cycle at which something happens in the part.
    fn due(&self) -> Cycle;

    /// Everything that is due up to and at `to` happens, in order.
    fn advance<O: Outside>(&mut self, to: Cycle, outside: &mut O);

    /// What the part drives into the core.
    fn signals(&mut self) -> &mut Signals;

    /// See [`cortex_m4::Bus::wait_states`].
    fn wait_states(&mut self, access: &Access, bound: Bound) -> u32;

    /// Whether the core's bit-band aliases are there.
    fn bit_banding(&self) -> bool {
        false
    }

    /// What the core runs at now. A change is announced by [`Signals::announce`]; cycles go on being counted, at the
    /// new rate.
    fn clock(&self) -> Clock;

    /// The part restarts at `at`. Registers take their reset values as far as the manual says so for this cause, pins
    /// let go; memory stays.
    fn reset<O: Outside>(&mut self, at: Cycle, cause: Reset, outside: &mut O);

    /// A restart the part wants itself (watchdog, wake-up): asked for after every call; answered once.
    fn take_reset(&mut self) -> Option<Reset>;

    /// The supply has `microvolts` from `at` on. What a voltage that is too low for what the part does makes of it
    /// follows from `seed`. A part that knows no supply always has enough.
    fn supply<O: Outside>(&mut self, at: Cycle, microvolts: u32, seed: u64, outside: &mut O) -> Supplied {
        let _ = (at, microvolts, seed, outside);
        Supplied::Enough
    }

    /// Whether the part has warned its firmware of a supply that falls, since this was last asked.
    fn take_supply_warning(&mut self) -> bool {
        false
    }

    /// The core sleeps (`true`; `deep` is SCR.SLEEPDEEP) or woke.
    fn sleeps<O: Outside>(&mut self, at: Cycle, asleep: bool, deep: bool, outside: &mut O) {
        let _ = (at, asleep, deep, outside);
    }

    /// The core was halted for debug (`true`), or goes on.
    fn halts<O: Outside>(&mut self, at: Cycle, halted: bool, outside: &mut O) {
        let _ = (at, halted, outside);
    }

    /// Something outside drives `pin` (`Some`) or lets go of it, from `at` on.
    fn drive<O: Outside>(&mut self, at: Cycle, pin: Pin, level: Option<bool>, outside: &mut O);

    /// The level of `pin` now, whoever drives it; a floating pin is low.
    fn pin(&self, pin: Pin) -> bool;

    /// A UART frame arrives on `pin`; its start bit's edge was at `begins`. The part is called at the frame's end or
    /// before it: what the receiver makes of the frame happens at its own sample instants.
    fn receive<O: Outside>(&mut self, begins: Cycle, pin: Pin, frame: UartFrame, outside: &mut O);

    /// `size` bytes of memory at `address` as a debugger reads them (flash, RAM, option bytes), `None` where some are
    /// not memory.
    fn memory(&self, address: u32, size: usize) -> Option<&[u8]>;

    /// The same to change, flash included, as a loader does. The core forgets what it decoded.
    fn memory_mut(&mut self, address: u32, size: usize) -> Option<&mut [u8]>;

    /// A bit of RAM is stuck from now on, and no other; `None`: none is. Answers whether the part has RAM there and can
    /// do that.
    fn stick(&mut self, _stuck: Option<StuckBit>) -> bool {
        false
    }

    /// What the models found wrong so far, in the order it first came.
    fn findings(&self) -> &[Finding];
}
