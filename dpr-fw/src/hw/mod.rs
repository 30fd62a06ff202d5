//! Accesses the registers. Only the files of this module have `unsafe` code in this firmware.
//!
//! | file | content |
//! |---|---|
//! | `mod.rs` | start-up: debug port, program check, supply, clocks, all files below; the safe state |
//! | `time.rs` | the timer for the deadline of the next frame |
//! | `integrity.rs` | reads of the streamed image, for the idle loop |
//! | `rf.rs` | SPI, interrupt pin and timer of a front end |
//! | `hold.rs` | what only the hold's front end has (feature `hold`) |
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
//! | no. | what is wrong | consequence or measure |
//! |---|---|---|
//! | 36 | CLOCK: some registers survive a reset | the event of the HFXO is cleared before it is awaited |
//! | 78 | TIMER: high current after STOP | harmless; TIMER3 stops after each pause, TIMER4 in the safe state |
//! | 87 | CPU: FPU exceptions wake the processor | the FPU computes nothing here; an extra wake-up does no harm |
//! | 136 | RESETREAS: bits set that should not be | if the pin's bit is set, the others are ignored |
//! | 155 | GPIOTE: an edge may be reported twice | the interrupt reads the pin's level ([`dpr_fw::rf`]) |
//! | 173, 210 | GPIO: LATCH is slow, and wrong | LATCH is not used |
//! | 176 | a flash erase through CTRL-AP fails with the watchdog running | the flashing tool must halt the part |
//! | 195, 198 | SPIM3 draws current when disabled and can corrupt what it sends | SPIM3 is not used |
//! | 213 | WDT: configuration lost in System OFF | System OFF is not used |
//! | 241 | SAADC: more current after it was used | the SAADC is not used |
//! | 242 | NVMC: an erase or write hangs the processor if POFWARN comes in it | the firmware writes no flash |
//! | 246 | extra current in idle after EasyDMA | only current is lost |
//!
//! Anomaly 241 is described by embassy-rs/embassy (`embassy-nrf`, change log, SAADC), and 242 by Zephyr
//! (`soc_flash_nrf.c`, `suspend_pofwarn`). No public source describes 259, 266 and 270: before a flight, Nordic's
//! errata sheet of the fitted revision must be read for them. Anomalies 58 (SPIM, one byte too many) and 156 (GPIOTE
//! CLR tasks) concern only the revision Engineering A.
#![allow(unsafe_code)]

#[cfg(feature = "hold")]
mod hold;
/// RTIC needs types for all resources, so without the feature the second port's types are empty.
#[cfg(not(feature = "hold"))]
mod hold {
    pub(crate) type HoldEdge = ();
    pub(crate) type HoldResponder = ();
    pub(crate) type HoldShared = ();
}
mod integrity;
mod rf;
mod ssi;
mod time;

use dpr_fw::{
    port::areas::SsiEnd, protection, publish::Doorbell, ssi::ReceiveArea, telemetry::Telemetry, triple::Filling,
};
use dpr_fw::{ImageMemory, ReceiveMemory};
use firmware_common::{
    last_stop::{Cause, Stop},
    mpu,
    nrf52840::{self, debug_port::DebugPort, POWER_FAIL_MV},
    program, safe_state,
};
use nrf52840_hal::{
    pac::{self, interrupt},
    wdt::{count::One, handles::Hdl0, Watchdog, WatchdogHandle},
};
use profile::ResetReason;
use st25r3916::Short;

pub(crate) use firmware_common::{nrf52840::now_us, take_event};
#[cfg(feature = "hold")]
pub(crate) use hold::HoldSelect;
pub(crate) use hold::{HoldEdge, HoldResponder, HoldShared};
pub(crate) use integrity::ShownImage;
pub(crate) use rf::{RfEdge, RfPort};
pub(crate) use ssi::{SsiDoorbell, SsiPort};
pub(crate) use time::Deadline;

use crate::board;

firmware_common::install_nrf52840_start!(cfg!(feature = "debugger-stops-watchdog"));
firmware_common::install_safe_state!(safe_state, protection::area, board::task_of);

/// The telemetry counters, which a debugger finds by this symbol.
#[no_mangle]
pub(crate) static DPR_TELEMETRY: Telemetry = Telemetry::new();

/// The counters of the second port, which a debugger finds by this symbol.
#[cfg(feature = "hold")]
#[no_mangle]
pub(crate) static DPR_HOLD_TELEMETRY: dpr_fw::hold::HoldTelemetry = dpr_fw::hold::HoldTelemetry::new();

pub(crate) type ReceiveBuffer = &'static mut ReceiveMemory;
pub(crate) type ImageBuffer = &'static mut ImageMemory;
pub(crate) type AreaBuffer = &'static mut ReceiveArea;

pub(crate) struct Board {
    pub(crate) rf: RfPort,
    pub(crate) rf_edge: RfEdge,
    pub(crate) ssi: SsiPort,
    pub(crate) deadline: Deadline,
    /// The port and the IRQ edge of the hold's front end.
    #[cfg(feature = "hold")]
    pub(crate) hold: (hold::HoldPort, HoldEdge),
    /// The watchdog. `None` if other code has configured the watchdog, and so has to feed it.
    pub(crate) watchdog: Option<WatchdogHandle<Hdl0>>,
    pub(crate) reset_reason: ResetReason,
    pub(crate) debug_port: DebugPort,
}

pub(crate) struct DmaMemory {
    pub(crate) spi_tx: &'static mut [u8; Short::MAX],
    pub(crate) spi_rx: &'static mut [u8; Short::MAX],
    /// The area into which the SSI receives, and the queues that carry the areas to the port task.
    pub(crate) ssi_rx: (Filling<AreaBuffer>, SsiEnd<'static, AreaBuffer>),
    #[cfg(feature = "hold")]
    pub(crate) hold: HoldDma,
}

#[cfg(feature = "hold")]
pub(crate) struct HoldDma {
    pub(crate) spi: &'static mut dpr_fw::hold::SpiMemory,
    pub(crate) receive: Filling<ReceiveBuffer>,
}

/// Configures all hardware. If the program differs from the one that was built, the DPR enters the safe state before
/// any pin is an output.
pub(crate) fn init(
    core: &mut cortex_m::Peripherals,
    p: pac::Peripherals,
    memory: DmaMemory,
    receive: Filling<ReceiveBuffer>,
) -> Board {
    // Opening the debug port comes first, so that a debugger can connect even if the firmware stops early.
    let debug_port = nrf52840::open_debug_port(&p.FICR, &p.UICR);

    // The watchdog runs already: the first instructions have started it, or it was running before a soft reset or a
    // lockup.
    let watchdog = Watchdog::try_recover::<One>(p.WDT).ok().map(|parts| parts.handles.0);

    let reset_reason = nrf52840::reset_reason();

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

    if nrf52840::watch_supply(&p.POWER) {
        stop_for_supply();
    }
    // Without the crystal the DPR's clock is too coarse to judge HORUS's (docs/decisions/0023-start-and-clocks.md).
    if !nrf52840::start_crystal(&p.CLOCK) {
        let log = |_: &Stop| defmt::error!("the 32 MHz crystal does not start");
        safe_state::enter(safe_state, || Stop::new(Cause::ClockStart, 0, 0), log);
    }
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();

    let board::Pins {
        rf: rf_pins,
        ssi: ssi_pins,
        fresh,
        #[cfg(feature = "hold")]
            hold: hold_pins,
    } = board::Pins::new(p.P0, p.P1);
    let (gpiote, _ppi) = board::connect(p.GPIOTE, p.PPI, &rf_pins.irq, fresh, &p.TIMER0, &p.TIMER2, &p.SPIS1);
    nrf52840::start_counter(&p.TIMER0);
    let rf = RfPort::new(p.SPIM0, p.TIMER0, (), rf_pins, memory.spi_tx, memory.spi_rx, receive);
    #[cfg(feature = "hold")]
    let hold = {
        let HoldDma { spi: dpr_fw::hold::SpiMemory { tx, rx, answer }, receive } = memory.hold;
        let pins = board::connect_hold(HoldSelect, &gpiote, _ppi, hold_pins, &p.TIMER4, &p.SPIM2, &p.EGU3);
        nrf52840::start_counter(&p.TIMER4);
        let answers = hold::Answers::new(answer);
        let port = hold::HoldPort::new(p.SPIM2, p.TIMER4, answers, pins, tx, rx, receive);
        (port, HoldEdge::new(p.EGU3))
    };
    let ssi = SsiPort::new(p.SPIS1, (p.TIMER2, p.TIMER3), ssi_pins, memory.ssi_rx);
    let deadline = Deadline::new(p.TIMER1);
    Board {
        rf,
        rf_edge: RfEdge::new(gpiote),
        ssi,
        deadline,
        #[cfg(feature = "hold")]
        hold,
        watchdog,
        reset_reason,
        debug_port,
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

/// Takes the SSI's buffers back, so that the flight controller reads 0xFF. A transaction in progress still ends with
/// its image. Before the SSI is set up, every transaction reads 0xFF anyway.
pub(crate) fn safe_state() {
    // Stopping the timer comes first, so that no further answer to the hold starts.
    #[cfg(feature = "hold")]
    hold::stop();
    if SsiDoorbell::is_enabled() {
        let _ = SsiDoorbell.request();
    }
}

defmt::timestamp!("{=u32:us}", now_us());
