//! The reaction of any board to a panic, a fault or an interrupt without a task.
//!
//! Interrupts are masked, the board enters its own safe state (HORUS switches the field off, the DPR stops answering
//! the flight controller), and the cause is recorded ([`last_stop`](crate::last_stop)) and logged once. No code feeds
//! the watchdog any more, so it resets the part.
//!
//! A firmware installs the handlers with [`install_safe_state!`](crate::install_safe_state), and calls `name_faults`.
//!
//! # Faults
//!
//! MemManage, BusFault, UsageFault and HardFault have one handler. It begins in assembly: it saves the address of the
//! frame that the processor has stacked, and sets the stack pointer to the stack's start, since the fault may be an
//! overflow of the stack. No interrupted code runs again.
//!
//! The memory protection unit is switched off: the safe state uses peripherals that tasks must not access, and the
//! table may itself be wrong. A fault in the safe state is a HardFault, since the faults of lower priority are masked,
//! and begins the safe state anew. A further fault locks the core up until the watchdog resets it.

#[cfg(target_os = "none")]
#[allow(unsafe_code)]
mod imp {
    use core::sync::atomic::{compiler_fence, AtomicBool, Ordering};

    use cortex_m::peripheral::{scb::Exception, NVIC, SCB};

    use crate::{
        last_stop::{self, FaultStatus, Stop},
        log_section, memory, mpu,
    };

    /// Whether a cause has been logged or is being logged. A fault inside the logger must not call the logger again.
    static LOGGED: AtomicBool = AtomicBool::new(false);

    /// Enters the safe state by `enter`, then records and logs the stop that `stop` returns, and waits for the
    /// watchdog. `stop` may take long. Only the first stop is logged, and none while another message is being written.
    // Not covered: only this line, in the copies for stops that no run has: a wrong brown-out level (`init` of HORUS),
    // and, beside a hold, a regulator that cannot be set (`init` of the DPR).
    pub fn enter(enter: fn(), stop: impl FnOnce() -> Stop, log: impl FnOnce(&Stop)) -> ! {
        // Not covered: only this line, in the copies above.
        begin(enter);
        // Not covered: in the other copies, what the stops of these runs have in common: a stacked frame that lies in
        // the stack, and a fault of which the processor states the cause.
        let stop = stop();
        // Not covered: only this line, a stop that is not logged, because it interrupts the logger: few runs stop just
        // then.
        if note(&stop) {
            // Not covered: what `log` writes in the copies above.
            log(&stop);
        }
        loop {
            // Not covered: only this line, in the copies above.
            compiler_fence(Ordering::SeqCst);
        }
    }

    /// Masks all interrupts, and enters the board's safe state. This and [`note`] are in the image once, not once for
    /// each cause, so that a stop for any cause executes them.
    #[inline(never)]
    fn begin(enter: fn()) {
        cortex_m::interrupt::disable();
        mpu::off();
        enter();
    }

    /// Records the stop, and returns whether it is to be logged.
    #[inline(never)]
    fn note(stop: &Stop) -> bool {
        last_stop::note(stop);
        // Not covered: only this line, a second try of the exclusive access, since all interrupts are masked; and a
        // second stop, which that prevents too.
        !LOGGED.swap(true, Ordering::Relaxed) && !log_section::is_interrupted()
        // Not covered: only this line, the return behind a second stop.
    }

    /// Enables the separate handlers of MemManage, BusFault and UsageFault, so that a fault in the safe state is a
    /// HardFault. To be called once, before the memory protection unit is switched on.
    pub fn name_faults(scb: &mut SCB) {
        for exception in [Exception::MemoryManagement, Exception::BusFault, Exception::UsageFault] {
            scb.enable(exception);
        }
    }

    /// Returns the number of the most urgent active exception, or 0 for the start or the idle loop.
    ///
    /// The number is read from the interrupt controller, since the stacked frame may be missing.
    #[must_use]
    #[inline(never)]
    pub fn active_exception() -> u16 {
        /// The number of words of interrupt bits: STM32F429 has the most interrupts, 91 (RM0090, "vector table").
        const WORDS: usize = 3;
        // SAFETY: the register block is always there, and only registers without a side effect are read.
        let nvic = unsafe { &*NVIC::PTR };
        let mut found = (u8::MAX, 0);
        for interrupt in 0..32 * WORDS {
            let active = nvic.iabr.get(interrupt / 32).is_some_and(|word| word.read() >> (interrupt % 32) & 1 != 0);
            let Some(priority) = nvic.ipr.get(interrupt) else { break };
            let urgency = priority.read();
            // Not covered: only this line, in the turns of the unrolled loop for interrupts that the DPR and the hold
            // have no task for: 7, 15, 23 and so on, and in the hold also 2, 10, 18 and so on.
            if active && urgency < found.0 {
                found = (urgency, interrupt as u16 + 16);
            }
        }
        found.1
    }

    /// Returns the stop of a fault. The processor has stacked the frame of the exception at `frame`, unless that
    /// failed.
    #[must_use]
    pub fn fault(frame: u32) -> Stop {
        /// The offset of the link register in the frame, words (ARMv7-M ARM B1.5.6). The program counter comes next.
        const LR: u32 = 5;
        const PC: u32 = 6;
        // SAFETY: the register block is always there, and only registers without a side effect are read.
        let scb = unsafe { &*SCB::PTR };
        let status = FaultStatus { cfsr: scb.cfsr.read(), mmfar: scb.mmfar.read(), bfar: scb.bfar.read() };
        let stacked = status.has_frame() && memory::is_stack(frame, 4 * (PC + 2));
        let frame = stacked.then(|| (memory::load(frame + 4 * LR), memory::load(frame + 4 * PC)));
        Stop::of_fault(status, frame, active_exception())
    }
}

#[cfg(target_os = "none")]
pub use imp::{active_exception, enter, fault, name_faults};

/// Installs the handlers of panics, failed `defmt` assertions, faults, and exceptions without a handler.
///
/// `$enter` is the `fn()` that puts the board into its safe state with all interrupts masked. It must not panic and
/// must not wait without a bound. `$area` is a `fn(u32) -> &'static str` that returns the name of an address's area.
/// `$task` is a `fn(u16) -> &'static str` that returns the name of the task with this exception number.
#[macro_export]
macro_rules! install_safe_state {
    ($enter:path, $area:path, $task:path) => {
        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
            let stop = || {
                let (path, line) = info.location().map_or(("", 0), |place| (place.file(), place.line()));
                $crate::last_stop::Stop::of_panic(path, line, $crate::safe_state::active_exception())
            };
            $crate::safe_state::enter($enter, stop, |_| defmt::error!("{}", defmt::Display2Format(info)))
        }

        /// The macros of `defmt` that call this function, such as `defmt::panic!`, have already logged the reason.
        #[defmt::panic_handler]
        fn defmt_panic() -> ! {
            let stop = || $crate::last_stop::Stop::of_panic("", 0, $crate::safe_state::active_exception());
            $crate::safe_state::enter($enter, stop, |_| {})
        }

        pub(crate) fn log_stop(before: &str, stop: &$crate::last_stop::Stop) {
            defmt::error!(
                "{=str}: {}; {=str}; task {=str}; code {=u32:#010x}",
                before,
                defmt::Display2Format(stop),
                stop.address.map_or("no address", $area),
                $task(stop.exception),
                stop.code()
            );
        }

        // One handler serves the four faults. It saves the frame's address and resets the stack pointer.
        core::arch::global_asm!(
            ".section .text.fault_entry, \"ax\", %progbits",
            ".global MemoryManagement",
            ".global BusFault",
            ".global UsageFault",
            ".global HardFault",
            ".type MemoryManagement, %function",
            ".type BusFault, %function",
            ".type UsageFault, %function",
            ".type HardFault, %function",
            ".thumb_func",
            "MemoryManagement:",
            ".thumb_func",
            "BusFault:",
            ".thumb_func",
            "UsageFault:",
            ".thumb_func",
            "HardFault:",
            "mrs r0, msp",
            "ldr r1, =_stack_start",
            "msr msp, r1",
            "b {fault}",
            ".ltorg",
            fault = sym fault,
        );

        extern "C" fn fault(frame: u32) -> ! {
            $crate::safe_state::enter($enter, || $crate::safe_state::fault(frame), |stop| log_stop("fault", stop))
        }

        // SAFETY: the handler does not return, so no state of the code that it interrupted is used again.
        #[cortex_m_rt::exception]
        unsafe fn DefaultHandler(number: i16) -> ! {
            let exception = (number + 16) as u16;
            let stop = || $crate::last_stop::Stop::new($crate::last_stop::Cause::NoTask, exception, number as u32);
            $crate::safe_state::enter($enter, stop, |_| defmt::error!("interrupt {=i16} has no task", number))
        }
    };
}
