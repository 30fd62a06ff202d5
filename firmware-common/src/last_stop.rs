//! Why the firmware last stopped itself: recorded when a board enters its safe state, and read after the restart.
//!
//! # Design
//!
//! In flight no debugger reads the log, and the watchdog restarts the board after 100 ms. So the cause of the stop is
//! kept, with a CRC, in memory that the start-up code does not initialise (section `.uninit`). A record with a wrong
//! CRC is ignored. Only the first stop since a start is kept, so a failure in the safe state does not replace its
//! cause.
//!
//! After the restart the firmware [takes](take) the record once, logs it, and keeps its [`code`] for the telemetry. A
//! restart that no record explains (the supply, the reset pin, a task that hung) has code 0.
//!
//! # Code
//!
//! | bits | what |
//! |---|---|
//! | 31..24 | the [`Cause`], never 0 |
//! | 23..16 | the number of the exception whose handler was interrupted: 0 for start and idle loop, 255 if above |
//! | 15..0 | fault: the half word of CFSR that belongs to the cause; panic: the line; otherwise the detail's low half |

use core::{
    fmt,
    sync::atomic::{AtomicBool, AtomicU32, Ordering},
};

macro_rules! causes {
    ($($(#[$doc:meta])* $cause:ident = $number:literal, $name:literal;)*) => {
        /// The reason why the firmware stopped itself.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Cause {
            $($(#[$doc])* $cause = $number,)*
        }

        impl Cause {
            const ALL: [Self; [$($number),*].len()] = [$(Self::$cause),*];

            /// Returns the cause in words.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$cause => $name,)*
                }
            }
        }
    };
}

causes! {
    /// The memory protection unit has refused an access ([`mpu`](crate::mpu)).
    MemoryProtection = 1, "memory protection";
    /// The bus has refused an access: no memory or peripheral is at the address, or its clock is off.
    BusFault = 2, "bus fault";
    /// An instruction cannot be executed: it is undefined or unaligned, divides by zero, or needs another state of the
    /// processor.
    UsageFault = 3, "usage fault";
    /// A HardFault that is none of the other faults: a vector could not be read, or a debug event came.
    HardFault = 4, "hard fault";
    /// The firmware panicked. The detail is the line of the panic.
    Panic = 5, "panic";
    /// An exception or interrupt without a task came. The detail is its interrupt number.
    NoTask = 6, "interrupt without a task";
    /// The program in flash differs from the one that was built. The detail is the CRC of the flash.
    Flash = 7, "flash changed";
    /// Code that runs in RAM differs from its load image in flash. The detail is the address.
    CodeInRam = 8, "code in RAM changed";
    /// A guard word around the statics or at the end of the stack has changed. The detail is the guard's number.
    GuardWord = 9, "guard word changed";
    /// The external clock of HORUS has failed.
    Clock = 10, "external clock failed";
    /// An oscillator or a PLL did not become ready in its time at the start.
    ClockStart = 11, "clock did not start";
    /// RAM in use does not hold what is written to it, or a bit of a [checked](crate::checked) state has flipped. The
    /// detail is the address, or 0 if the RAM was not tested at the start.
    Ram = 12, "RAM faulty";
    /// The supply is below what the part needs. The detail is the threshold, mV.
    Supply = 13, "supply too low";
    /// The brown-out reset is not set to the level that HORUS needs. The detail is the level in the option bytes.
    BrownOutLevel = 14, "brown-out reset not set";
    /// A task ran out of order, twice, too early or without a call. The detail is the number of the step or task.
    Flow = 15, "task out of order";
}

impl Cause {
    /// Whether the cause is memory that does not hold what was written to it: flash, code in RAM, guard words, or RAM
    /// in use.
    #[must_use]
    pub const fn is_memory_fault(self) -> bool {
        matches!(self, Self::Flash | Self::CodeInRam | Self::GuardWord | Self::Ram)
    }

    const fn is_fault(self) -> bool {
        matches!(self, Self::MemoryProtection | Self::BusFault | Self::UsageFault | Self::HardFault)
    }
}

/// The last characters of the path of a source file, padded with zeros.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place([u8; Self::LEN]);

impl Place {
    /// The number of bytes that are kept of a source file's path.
    pub const LEN: usize = 24;

    /// Returns the last bytes of `path`.
    #[must_use]
    pub fn of(path: &str) -> Self {
        let mut bytes = [0; Self::LEN];
        let kept = path.len().min(Self::LEN);
        for (to, from) in bytes.iter_mut().zip(path.bytes().skip(path.len() - kept)) {
            *to = from;
        }
        Self(bytes)
    }

    /// Returns the end of the path as text, up to the first byte that is no graphic character.
    #[must_use]
    pub fn text(&self) -> &str {
        let len = self.0.iter().position(|byte| !byte.is_ascii_graphic()).unwrap_or(Self::LEN);
        self.0.get(..len).and_then(|text| core::str::from_utf8(text).ok()).unwrap_or("")
    }
}

/// The record of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stop {
    /// The reason of the stop.
    pub cause: Cause,
    /// The number of the active exception, or 0 outside handlers: at the start and in the idle loop (ARMv7-M ARM
    /// B1.5.2).
    pub exception: u16,
    /// The CFSR of a fault; otherwise the detail that [`Cause`] describes.
    pub detail: u32,
    /// The address that the faulting access had, if the processor has reported it.
    pub address: Option<u32>,
    /// The address of the instruction that was interrupted; 0 if it is not known.
    pub pc: u32,
    /// The return address of the interrupted function, or an address near it; 0 if it is not known.
    pub lr: u32,
    /// The source file of a panic.
    pub place: Place,
}

/// The number of words in a record, including its CRC.
pub const WORDS: usize = 5 + Place::LEN / 4 + 1;

/// What the processor reports of a fault (ARMv7-M ARM B3.2.15 to B3.2.19).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultStatus {
    /// The Configurable Fault Status Register.
    pub cfsr: u32,
    /// The MemManage Fault Address Register.
    pub mmfar: u32,
    /// The BusFault Address Register.
    pub bfar: u32,
}

impl FaultStatus {
    const MEMORY: u32 = 0x0000_007F;
    const BUS: u32 = 0x0000_7F00;
    const USAGE: u32 = 0xFFFF_0000;
    const MMARVALID: u32 = 1 << 7;
    const BFARVALID: u32 = 1 << 15;
    /// The bits that say that the exception's frame could not be stacked: MSTKERR, STKERR.
    const NO_FRAME: u32 = 1 << 4 | 1 << 12;

    /// Whether the processor has stacked the frame of the exception.
    #[must_use]
    pub const fn has_frame(self) -> bool {
        self.cfsr & Self::NO_FRAME == 0
    }

    /// Returns the cause of the fault. A refused access comes first, because it often makes the stacking fail too.
    const fn cause(self) -> Cause {
        if self.cfsr & Self::MEMORY != 0 {
            Cause::MemoryProtection
        } else if self.cfsr & Self::BUS != 0 {
            Cause::BusFault
        } else if self.cfsr & Self::USAGE != 0 {
            Cause::UsageFault
        } else {
            Cause::HardFault
        }
    }

    const fn address(self) -> Option<u32> {
        if self.cfsr & Self::MMARVALID != 0 {
            Some(self.mmfar)
        } else if self.cfsr & Self::BFARVALID != 0 {
            Some(self.bfar)
        } else {
            None
        }
    }
}

impl Stop {
    /// Returns a stop of which only these values are known.
    #[must_use]
    pub const fn new(cause: Cause, exception: u16, detail: u32) -> Self {
        // Not covered: the copies for stops that no run has: a wrong brown-out level (`init` of HORUS), and, beside a
        // hold, a regulator that cannot be set (`init` of the DPR).
        Self { cause, exception, detail, address: None, pc: 0, lr: 0, place: Place([0; Place::LEN]) }
    }

    /// Returns the stop of a fault in the handler of `exception`. `frame` is the link register and the program counter
    /// that the processor has stacked; `None` if it could not stack them.
    #[must_use]
    pub fn of_fault(status: FaultStatus, frame: Option<(u32, u32)>, exception: u16) -> Self {
        let (lr, pc) = frame.unwrap_or((0, 0));
        // Not covered: only this line, in the copies for the handlers of faults, a cause and an address that no fault
        // of these runs has.
        Self { address: status.address(), pc, lr, ..Self::new(status.cause(), exception, status.cfsr) }
    }

    /// Returns the stop of a panic at `line` of the file at `path`.
    #[must_use]
    pub fn of_panic(path: &str, line: u32, exception: u16) -> Self {
        Self { place: Place::of(path), ..Self::new(Cause::Panic, exception, line) }
    }

    /// Returns the stop as a code (see the module's table).
    #[must_use]
    pub const fn code(&self) -> u32 {
        let detail = match self.cause {
            Cause::BusFault => (self.detail & FaultStatus::BUS) >> 8,
            Cause::UsageFault => self.detail >> 16,
            Cause::MemoryProtection => self.detail & FaultStatus::MEMORY,
            _ => self.detail & 0xFFFF,
        };
        // Not covered: an exception above 255: the part with the most interrupts has 91, with the numbers 16 to 106.
        let exception = if self.exception > 0xFF { 0xFF } else { self.exception as u32 };
        (self.cause as u32) << 24 | exception << 16 | detail
    }

    /// Returns the stop as a record, whose last word is its CRC.
    #[must_use]
    pub fn to_words(&self) -> [u32; WORDS] {
        let mut words = [0; WORDS];
        let known = u32::from(self.address.is_some());
        let head = [
            self.cause as u32 | known << 8 | u32::from(self.exception) << 16,
            self.detail,
            self.address.unwrap_or(0),
            self.pc,
            self.lr,
        ];
        let text = self.place.0.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
        for (to, from) in words.iter_mut().zip(head.into_iter().chain(text)) {
            *to = from;
        }
        words[WORDS - 1] = check_word(&words);
        words
    }

    /// Returns the stop that `words` record; `None` if their CRC is wrong or they record no cause.
    #[must_use]
    pub fn from_words(words: &[u32; WORDS]) -> Option<Self> {
        let [head, detail, address, pc, lr, text @ .., check] = words;
        let cause = Cause::ALL.into_iter().find(|cause| *cause as u32 == head & 0xFF)?;
        if *check != check_word(words) {
            return None;
        }
        let mut place = Place::default();
        for (to, from) in place.0.as_chunks_mut::<4>().0.iter_mut().zip(text) {
            *to = from.to_le_bytes();
        }
        let address = (head >> 8 & 1 != 0).then_some(*address);
        Some(Self { cause, exception: (head >> 16) as u16, detail: *detail, address, pc: *pc, lr: *lr, place })
    }
}

fn check_word(words: &[u32; WORDS]) -> u32 {
    profile::crc::frame_of_words(words.iter().take(WORDS - 1).copied())
}

fn fault_in_words(cause: Cause, cfsr: u32) -> &'static str {
    let bits: &[(u32, &str)] = match cause {
        // The bit for a refused access comes before the bit for a failed entry to the handler, because the refused
        // access may have made the entry fail.
        Cause::MemoryProtection => {
            &[(0, "execution"), (1, "data access"), (4, "exception entry"), (3, "exception return"), (5, "FPU state")]
        }
        Cause::BusFault => &[
            (9, "data access"),
            (10, "write some instructions before"),
            (8, "execution"),
            (12, "exception entry"),
            (11, "exception return"),
            (13, "FPU state"),
        ],
        Cause::UsageFault => &[
            (16, "undefined instruction"),
            (17, "wrong state"),
            (18, "wrong exception return"),
            (19, "no coprocessor"),
            (24, "unaligned access"),
            (25, "division by zero"),
        ],
        _ => &[],
    };
    bits.iter().find(|(bit, _)| cfsr >> bit & 1 != 0).map_or("no more is known", |(_, name)| name)
}

/// Writes, for example, "memory protection, data access at 0x08000400, pc 0x08001234".
impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.cause.name())?;
        if self.cause == Cause::Panic {
            return write!(f, " at {}:{}", self.place.text(), self.detail);
        }
        if !self.cause.is_fault() {
            return write!(f, " ({:#x})", self.detail);
        }
        write!(f, ", {}", fault_in_words(self.cause, self.detail))?;
        if let Some(address) = self.address {
            write!(f, " at {address:#010x}")?;
        }
        if self.pc != 0 {
            write!(f, ", pc {:#010x}", self.pc)?;
        }
        Ok(())
    }
}

/// The memory of the record. After power-on its CRC is wrong, except in one case of 2^32.
#[cfg_attr(target_os = "none", allow(unsafe_code))] // The attribute names a section, which the compiler cannot check.
#[cfg_attr(target_os = "none", link_section = ".uninit.LAST_STOP")]
static RECORD: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

static NOTED: AtomicBool = AtomicBool::new(false);

static CODE: AtomicU32 = AtomicU32::new(0);

/// Records `stop` if it is the first since the start.
pub fn note(stop: &Stop) {
    // Not covered: a second try of the exclusive access, since interrupts are masked here; and a second stop, which
    // that prevents too.
    if NOTED.swap(true, Ordering::Relaxed) {
        return;
    }
    record(&stop.to_words());
}

/// Runs `wait` with `stop` recorded. If `wait` never ends, the watchdog resets the part, and the record tells the
/// reason. If `wait` ends, the record is erased, unless a stop during `wait` has recorded itself. An older record has
/// to be [taken](take) before.
pub fn unless_over<T>(stop: &Stop, wait: impl FnOnce() -> T) -> T {
    record(&stop.to_words());
    let over = wait();
    record(&[0; WORDS]);
    over
}

fn record(words: &[u32; WORDS]) {
    for (to, from) in RECORD.iter().zip(words) {
        to.store(*from, Ordering::Relaxed);
    }
}

/// Returns the stop before this start, if there was one, and erases the record. To be called once, at the start.
pub fn take() -> Option<Stop> {
    let mut words = [0; WORDS];
    for (to, from) in words.iter_mut().zip(&RECORD) {
        // Not covered: a second try of the exclusive access: no interrupt is enabled yet at the start.
        *to = from.swap(0, Ordering::Relaxed);
    }
    let stop = Stop::from_words(&words);
    CODE.store(stop.map_or(0, |stop| stop.code()), Ordering::Relaxed);
    stop
}

/// Returns the code of the stop before this start; 0 if there was none.
#[must_use]
pub fn code() -> u32 {
    CODE.load(Ordering::Relaxed)
}

#[cfg(test)]
mod tests;
