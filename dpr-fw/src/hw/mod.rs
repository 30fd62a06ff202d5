//! The register accesses. This firmware has `unsafe` code only in the files of this module.
//!
//! | file | what |
//! |---|---|
//! | `mod.rs` | start-up: debug port, program check, supply, clocks, all the files below; the safe state |
//! | `start_up.rs` | the first instructions: reset reasons and watchdog |
//! | `time.rs` | the µs counter, the deadline of the next frame |
//! | `integrity.rs` | the image that the SSI streams, as the idle loop accesses it |
//! | `rf.rs` | the front end's SPI, interrupt pin and timer |
//! | `ssi.rs` | the SSI, FRESH and the expiry of the image |
//!
//! # Design
//!
//! Each peripheral is a type that owns the memory that its DMA may access. [`RfPort`] holds a receive buffer while
//! SPIM0 may write it, and [`SsiPort`] holds the image and the receive area while SPIS1 may access them. All are
//! `&'static mut`, so no other code can access them meanwhile. They are in RAM, as EasyDMA requires (PS v1.7, 6.3).
//! Compiler fences before each start and after each end keep accesses to a buffer from moving across; the Cortex-M4
//! itself has no data cache and completes its stores in order.
//!
//! # Anomalies
//!
//! The following anomalies of nRF52840 revisions 1 to 3 concern the peripherals that this firmware uses:
//!
//! | no. | what | measure |
//! |---|---|---|
//! | 36 | CLOCK: some registers survive a reset | the event of the HFXO is cleared before it is awaited |
//! | 78 | TIMER: high current after STOP | only TIMER3 stops, after each pause of the SSI; only current is lost |
//! | 87 | CPU: FPU exceptions wake the processor | the FPU computes nothing here; an extra wake-up does no harm |
//! | 136 | RESETREAS: bits set that should not be | if the pin's bit is set, the others are ignored |
//! | 155 | GPIOTE: an edge may be reported twice | the interrupt reads the pin's level ([`dpr_fw::rf`]) |
//! | 173, 210 | GPIO: LATCH is slow, and wrong | LATCH is not used |
//! | 176 | a flash erase through CTRL-AP fails with the watchdog running | the flashing tool must halt the part |
//! | 195, 198 | SPIM3 draws current when disabled and can corrupt what it sends | SPIM0 and SPIS1 are used |
//! | 213 | WDT: configuration lost in System OFF | System OFF is not used |
//! | 241 | SAADC: more current after it was used | the SAADC is not used |
//! | 242 | NVMC: an erase or write hangs the processor if POFWARN comes in it | the firmware writes no flash |
//! | 246 | extra current in idle after EasyDMA | only current is lost |
//!
//! Anomaly 241 is described by embassy-rs/embassy (`embassy-nrf`, change log, SAADC), and 242 by Zephyr
//! (`soc_flash_nrf.c`, `suspend_pofwarn`). No public source at hand describes 259, 266 and 270; Nordic's errata sheet
//! of the revision that is fitted has to be read for them before a board flies.
//!
//! Anomalies 58 (SPIM, one byte too many) and 156 (GPIOTE CLR tasks) concern only Engineering A.
#![allow(unsafe_code)]

mod integrity;
mod rf;
mod ssi;
mod start_up;
mod time;

use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::asm;
use dpr_fw::{
    crystal,
    debug_port::{self, DebugPort},
    port::areas::SsiEnd,
    protection,
    publish::Doorbell,
    reset,
    ssi::ReceiveArea,
    telemetry::Telemetry,
    triple::Filling,
};
use dpr_fw::{ImageMemory, ReceiveMemory};
use firmware_common::{
    last_stop::{Cause, Stop},
    mpu, program, safe_state, start,
};
use nrf52840_hal::{
    pac::{self, interrupt},
    wdt::{count::One, handles::Hdl0, Watchdog, WatchdogHandle},
};
use profile::ResetReason;
use st25r3916::Short;

pub(crate) use integrity::ShownImage;
pub(crate) use rf::{RfEdge, RfPort};
pub(crate) use ssi::{SsiDoorbell, SsiPort};
pub(crate) use time::{now_us, Deadline};

use crate::board;

firmware_common::install_safe_state!(safe_state, protection::area, board::task_of);

/// The telemetry counters, which a debugger finds by this symbol.
#[no_mangle]
pub(crate) static DPR_TELEMETRY: Telemetry = Telemetry::new();

pub(crate) type ReceiveBuffer = &'static mut ReceiveMemory;
pub(crate) type ImageBuffer = &'static mut ImageMemory;
pub(crate) type AreaBuffer = &'static mut ReceiveArea;

/// Reads and clears an event register. Reads it again, so that the write is through the bus bridge and the event does
/// not raise its interrupt a second time (PS v1.7, 6.1.8).
macro_rules! take_event {
    ($event:expr) => {{
        let event = &$event;
        let set = event.read().bits() != 0;
        if set {
            event.reset();
            let _ = event.read();
        }
        set
    }};
}
pub(crate) use take_event;

pub(crate) struct Board {
    pub(crate) rf: RfPort,
    pub(crate) rf_edge: RfEdge,
    pub(crate) ssi: SsiPort,
    pub(crate) deadline: Deadline,
    /// The watchdog; `None` if it was configured by other software, which then has to feed it.
    pub(crate) watchdog: Option<WatchdogHandle<Hdl0>>,
    pub(crate) reset_reason: ResetReason,
    pub(crate) debug_port: DebugPort,
}

pub(crate) struct DmaMemory {
    pub(crate) spi_tx: &'static mut [u8; Short::MAX],
    /// The bytes that SPIM0 receives in a short transfer.
    pub(crate) spi_rx: &'static mut [u8; Short::MAX],
    /// The area into which the SSI receives, and the queues that carry the areas to the port task.
    pub(crate) ssi_rx: (Filling<AreaBuffer>, SsiEnd<'static, AreaBuffer>),
}

struct Protection<'a> {
    ficr: &'a pac::FICR,
    uicr: &'a pac::UICR,
}

/// The address of APPROTECT.DISABLE, which the PAC does not define.
const APPROTECT_DISABLE: u32 = 0x4000_0558;

impl debug_port::Registers for Protection<'_> {
    fn variant(&self) -> u32 {
        self.ficr.info.variant.read().bits()
    }

    fn uicr_approtect(&self) -> u32 {
        self.uicr.approtect.read().bits()
    }

    fn disable_protection(&mut self) {
        // SAFETY: the register exists on the parts for which this is called; it opens the debug port and does nothing
        // else.
        unsafe { (APPROTECT_DISABLE as *mut u32).write_volatile(debug_port::SW_DISABLE) };
    }
}

/// A word that keeps its value over every reset that leaves the RAM powered.
#[link_section = ".uninit.RAM_KEPT"]
static RAM_KEPT: AtomicU32 = AtomicU32::new(0);
/// The value that [`RAM_KEPT`] holds after the firmware has run once since power-on.
const KEPT: u32 = 0x4450_5221;

/// Configures all hardware. If the program in flash differs from the one that was built, the DPR enters the safe state
/// before any pin is an output.
pub(crate) fn init(
    core: &mut cortex_m::Peripherals,
    p: pac::Peripherals,
    memory: DmaMemory,
    receive: Filling<ReceiveBuffer>,
) -> Board {
    let debug_port = debug_port::open(&mut Protection { ficr: &p.FICR, uicr: &p.UICR });

    // The watchdog already runs: the first instructions (`start_up`) have started it, or it ran on over a soft reset.
    let watchdog = Watchdog::try_recover::<One>(p.WDT).ok().map(|parts| parts.handles.0);

    let ram_kept = RAM_KEPT.swap(KEPT, Ordering::Relaxed) == KEPT;
    let reset_reason = reset::reason(start::reset_flags(), ram_kept);

    p.NVMC.icachecnf.write(|w| w.cacheen().enabled());
    let flash = program::compare();
    if !flash.is_intact() {
        safe_state::enter(
            safe_state,
            || Stop::new(Cause::Flash, 0, flash.computed),
            |_| {
                defmt::error!(
                    "flash holds CRC {=u32:#010x}, not {=u32:#010x}: build with `cargo xtask build`, or flash again",
                    flash.computed,
                    flash.expected
                );
            },
        );
    }
    safe_state::name_faults(&mut core.SCB);
    mpu::apply(&mut core.MPU, &protection::START);

    watch_supply(&p.POWER);
    start_crystal(&p.CLOCK);
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();

    let board::Pins { rf: rf_pins, ssi: ssi_pins, fresh } = board::Pins::new(p.P0, p.P1);
    let gpiote = board::connect(p.GPIOTE, p.PPI, &rf_pins.irq, fresh, &p.TIMER0, &p.TIMER2, &p.SPIS1);
    time::start(&p.TIMER0);
    let rf = RfPort::new(p.SPIM0, p.TIMER0, rf_pins, memory.spi_tx, memory.spi_rx, receive);
    let ssi = SsiPort::new(p.SPIS1, (p.TIMER2, p.TIMER3), ssi_pins, memory.ssi_rx);
    let deadline = Deadline::new(p.TIMER1);
    Board { rf, rf_edge: RfEdge::new(gpiote), ssi, deadline, watchdog, reset_reason, debug_port }
}

/// Starts the 32 MHz crystal and waits for it. Without it the DPR enters the safe state, since its clock would be too
/// coarse to judge HORUS's clock (docs/decisions/0023-start-and-clocks.md).
fn start_crystal(clock: &pac::CLOCK) {
    // The event HFCLKSTARTED may still be set from an earlier start (anomaly 36).
    clock.events_hfclkstarted.reset();
    // SAFETY: 1 is a valid value of a task register.
    clock.tasks_hfclkstart.write(|w| unsafe { w.bits(1) });
    let is_started = || clock.events_hfclkstarted.read().bits() != 0;
    if !crystal::starts(is_started, || asm::delay(crystal::PAUSE_CYCLES)) {
        safe_state::enter(
            safe_state,
            || Stop::new(Cause::ClockStart, 0, 0),
            |_| defmt::error!("the 32 MHz crystal does not start"),
        );
    }
}

/// The supply voltage at which the DPR stops, mV. The part needs 1.7 V, but its front end needs 2.4 V (DS13541,
/// operating conditions). This is the lowest threshold whose tolerance of 5 % (PS v1.7, 5.3.8) keeps it above 2.4 V:
/// 2.57 to 2.84 V, below the kit's 3.0 V.
const POWER_FAIL_MV: u32 = 2_700;

/// Switches the power-fail comparator and its interrupt on. A supply that is already below the threshold stops the DPR
/// here (PS v1.7, 5.3.3). The part's own brown-out reset, at 1.6 V, is always on.
fn watch_supply(power: &pac::POWER) {
    power.events_pofwarn.reset();
    power.intenset.write(|w| w.pofwarn().set());
    power.pofcon.write(|w| w.pof().enabled().threshold().v27());
    // SAFETY: the handler shares nothing, does not return, and has the highest priority, which no lock masks.
    unsafe { cortex_m::peripheral::NVIC::unmask(pac::Interrupt::POWER_CLOCK) };
    if power.events_pofwarn.read().bits() != 0 {
        stop_for_supply();
    }
}

fn stop_for_supply() -> ! {
    let stop = || Stop::new(Cause::Supply, safe_state::active_exception(), POWER_FAIL_MV);
    safe_state::enter(safe_state, stop, |stop| log_stop("supply", stop))
}

/// Stops the DPR because the supply falls. No other event of CLOCK and POWER can raise this interrupt.
#[interrupt]
fn POWER_CLOCK() -> ! {
    stop_for_supply()
}

/// Takes the SSI's buffers back, so that the flight controller reads 0xFF. A transaction under way still ends with its
/// image. Before the SSI is set up, every transaction reads 0xFF anyway.
pub(crate) fn safe_state() {
    if SsiDoorbell::is_enabled() {
        let _ = SsiDoorbell.request();
    }
}

defmt::timestamp!("{=u32:us}", now_us());
