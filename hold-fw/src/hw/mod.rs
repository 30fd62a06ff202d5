//! Accesses the registers. Only the files of this module have `unsafe` code in this firmware.
//!
//! | file | content |
//! |---|---|
//! | `mod.rs` | start-up: debug port, program check, supply, clock, all files below; the safe state |
//! | `beats.rs` | the timer that raises the beats (every 25 ms) and the slot; the transmit command in the slot |
//! | `radio.rs` | SPI, interrupt pin and timer of the front end |
//! | `i2c.rs` | I2C bus of the sensors |
//! | `outputs.rs` | heater, cooler and lock |
//! | `supply.rs` | measurement of the supply voltage |
//!
//! # Design
//!
//! Each peripheral is a type that owns the memory that its DMA accesses. The compiler must not move an access to a
//! buffer before or after a transfer. A compiler fence before each start and after each end of a transfer prevents
//! that. The Cortex-M4 itself has no data cache and completes its stores in order.
//!
//! # Anomalies
//!
//! The table lists errata of the nRF52840 by Nordic's numbers. `dpr-fw/src/hw/mod.rs` lists the errata of the
//! peripherals that both firmwares use.
//!
//! | no. | what is wrong | consequence or measure |
//! |---|---|---|
//! | 87 | FPU exceptions wake the processor | harmless: the idle loop runs once more |
//! | 195, 198 | SPIM3 draws current when disabled and can corrupt what it sends | SPIM0 is used |
//! | 219 | at 400 kbit/s the TWIM's SCL is low for 1.25 µs only, and I2C wants 1.3 µs | 390 kbit/s, see `i2c.rs` |
//! | 241 | the SAADC draws more current after its first use | harmless |
#![allow(unsafe_code)]

mod beats;
mod i2c;
mod outputs;
mod radio;
mod supply;

use core::sync::atomic::AtomicU32;

use firmware_common::{
    last_stop::{Cause, Stop},
    mpu,
    nrf52840::{self, debug_port::DebugPort, POWER_FAIL_MV},
    program, safe_state,
};
use hold_fw::{kept, protection, telemetry::Telemetry};
use nrf52840_hal::{
    pac::{self, interrupt},
    wdt::{count::One, handles::Hdl0, Watchdog, WatchdogHandle},
};
use profile::ResetReason;

pub(crate) use beats::{beat, tick, Beat, Beats};
pub(crate) use firmware_common::{nrf52840::now_us, take_event};
pub(crate) use i2c::{Bus, Memory as BusMemory, Pause};
pub(crate) use outputs::Outputs;
pub(crate) use radio::{Memory as RfMemory, RfEdge, RfPort};
pub(crate) use supply::SupplyMeter;

use crate::board;

firmware_common::install_nrf52840_start!(cfg!(feature = "debugger-stops-watchdog"));
firmware_common::install_safe_state!(safe_state, protection::area, board::task_of);

/// The counters. A debugger finds them by this symbol.
#[no_mangle]
pub(crate) static HOLD_TELEMETRY: Telemetry = Telemetry::new();

/// The records that outlive a reset. The start code does not clear them.
#[link_section = ".uninit.KEPT"]
static KEPT: kept::Memory = [const { [const { AtomicU32::new(0) }; kept::WORDS] }; 2];

pub(crate) struct Board {
    pub(crate) rf: RfPort,
    pub(crate) rf_edge: RfEdge,
    /// The timer of beats and slot, which is started last.
    pub(crate) beats: Beats,
    pub(crate) bus: Bus,
    pub(crate) outputs: Outputs,
    pub(crate) supply: SupplyMeter,
    /// The watchdog; `None` if other code has configured the watchdog, and so has to feed it.
    pub(crate) watchdog: Option<WatchdogHandle<Hdl0>>,
    pub(crate) reset_reason: ResetReason,
    pub(crate) debug_port: DebugPort,
    /// The keeper of the records that outlive a reset, and the newest of these records.
    pub(crate) kept: (kept::Keeper, Option<kept::Kept>),
}

pub(crate) struct DmaMemory {
    pub(crate) radio: &'static mut radio::Memory,
    pub(crate) bus: &'static mut i2c::Memory,
    pub(crate) duties: &'static mut outputs::Memory,
    pub(crate) supply: &'static mut supply::Memory,
}

/// Configures all hardware. If the program differs from the one that was built, the hold enters the safe state before
/// any pin is an output.
pub(crate) fn init(core: &mut cortex_m::Peripherals, p: pac::Peripherals, memory: DmaMemory) -> Board {
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
    // Only the crystal is exact enough for the hold's time, on which the DPR and the writers of commands rely.
    if !nrf52840::start_crystal(&p.CLOCK) {
        let log = |_: &Stop| defmt::error!("the 32 MHz crystal does not start");
        safe_state::enter(safe_state, || Stop::new(Cause::ClockStart, 0, 0), log);
    }
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();

    let kept = kept::Keeper::take(&KEPT);
    let locked = kept.1.unwrap_or_default().locked;
    let board::Pins { rf: rf_pins, bus: bus_pins, outputs: output_pins } = board::Pins::new(p.P0, p.P1, locked);
    let gpiote = board::connect(p.GPIOTE, &rf_pins.irq);
    nrf52840::start_counter(&p.TIMER0);
    Board {
        rf: RfPort::new(p.SPIM0, p.TIMER0, rf_pins, memory.radio),
        rf_edge: RfEdge::new(gpiote),
        beats: Beats::new(p.TIMER1),
        bus: Bus::new(p.TWIM1, bus_pins, memory.bus),
        outputs: Outputs::new(p.PWM0, output_pins, memory.duties),
        supply: SupplyMeter::new(p.SAADC, memory.supply),
        watchdog,
        reset_reason,
        debug_port,
        kept,
    }
}

fn stop_for_supply() -> ! {
    let stop = || Stop::new(Cause::Supply, safe_state::active_exception(), POWER_FAIL_MV);
    safe_state::enter(safe_state, stop, |stop| log_stop("supply", stop))
}

/// Stops the hold because the supply voltage falls. No other event raises this interrupt.
#[interrupt]
fn POWER_CLOCK() -> ! {
    stop_for_supply()
}

/// Enters the safe state: heater and cooler are off, and the lock stays as it is.
pub(crate) fn safe_state() {
    outputs::off();
}

defmt::timestamp!("{=u32:us}", now_us());
