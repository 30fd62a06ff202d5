//! The firmware of the active hold. This file is the RTIC table of tasks; the library has their logic, the module `hw`
//! accesses the registers, and the module `board` names pins and peripherals.
//!
//! A timer raises a *beat* every 25 ms; the first beat of a cycle is its tick ([`hold_fw::timing`]).
//!
//! | task | when it is called | longest time until it is done |
//! |---|---|---|
//! | `slot` | at a beat, and in the slot, in which it sends the frame | 10 µs |
//! | `rf_spi`, `rf_irq`, `rf_timer` | a transfer has ended, the front end's IRQ rises, a delay is over | 0.2 ms |
//! | `cycle` | at the tick | 0.3 ms |
//! | `answer` | an answer has arrived | 10 ms |
//! | `sensors` | at a beat | 25 ms |
//! | `idle` | no other task runs | 100 ms |
//!
//! The task with the highest priority stands first. `build.rs` makes the table in [`hold_fw::task`] from the tasks'
//! attributes.
//!
//! The longest times have these reasons:
//!
//! - `slot`: the time from the tick to the frame's first bit must be constant.
//! - `rf_*` load the rest of a frame within 0.3 ms, the time in which its first 16 bytes are sent. An answer begins 0.2
//!   ms after the frame at the earliest.
//! - `cycle` loads the frame's first bytes before the slot.
//! - `answer` ends before the next exchange, which comes after 90 ms.
//! - `sensors` ends before the next beat, which calls it again.
//! - `idle` feeds the watchdog, which resets the part 100 ms after the last feed.
//!
//! Only `sensors` waits for hardware, namely for the I2C bus. Each wait has a bound, and all interrupt tasks preempt
//! `sensors`, so a sensor cannot delay the cycle. Only `idle` writes to the log, and no task masks interrupts for that
//! ([`firmware_common::log_section`]).
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod hw;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "this is firmware for the nRF52840: build it with `cargo xtask build`, flash it with `cargo xtask flash hold`"
    );
    std::process::ExitCode::FAILURE
}

#[cfg(target_os = "none")]
// Not covered: only this line, the other outcome of the comparison of a task's priority with a resource's ceiling in
// RTIC's lock: both are constants.
#[rtic::app(device = nrf52840_hal::pac, peripherals = true)]
mod app {
    use core::sync::atomic::{AtomicBool, Ordering};

    use cortex_m::peripheral::DWT;
    use defmt_rtt as _;
    use firmware_common::{
        check_in::CheckIn,
        flow::Flow,
        last_stop::{self, Cause, Stop},
        memory, mpu,
        patrol::{self, ram::APART, Pace, PartMemory, Patrol},
        safe_state, start_test,
    };
    use hold_fw::{
        exchange::Link,
        integrity::{self, Consequence},
        protection,
        sensors::{Readings, Sensors},
        state::Hold,
        task::{Step, Task},
    };
    use nrf52840_hal::wdt::{handles::Hdl0, WatchdogHandle};

    use crate::board;
    use crate::hw::{
        self, beat, tick, Beat, Beats, BusMemory, Outputs, Pause, RfEdge, RfMemory, RfPort, SupplyMeter,
        HOLD_TELEMETRY as TELEMETRY,
    };

    static CHECK_IN: CheckIn<Task> = CheckIn::new();

    static FLOW: Flow<Step> = Flow::new();

    static MEMORY_FAULT: AtomicBool = AtomicBool::new(false);

    #[shared]
    struct Shared {
        link: Link<'static, RfPort>,
        #[lock_free]
        hold: Hold,
        readings: Readings,
    }

    #[local]
    struct Local {
        beats: Beats,
        rf_edge: RfEdge,
        outputs: Outputs,
        supply: SupplyMeter,
        sensors: Sensors<hw::Bus, Pause>,
        watchdog: Option<WatchdogHandle<Hdl0>>,
        patrol: Patrol,
        memory: PartMemory,
    }

    #[init(local = [
        radio: RfMemory = RfMemory::EMPTY,
        bus: BusMemory = BusMemory::EMPTY,
        duties: [u16; 4] = [0; 4],
        result: [i16; 1] = [0],
    ])]
    fn init(cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let mut core = cx.core;
        // The patrol leaves out the memory that EasyDMA accesses, and the counters that a debugger reads.
        let mut shared = [const { 0..0 }; APART - 2];
        shared[0] = memory::span(cx.local.radio);
        shared[1] = memory::span(cx.local.bus);
        shared[2] = memory::span(cx.local.duties);
        shared[3] = memory::span(cx.local.result);
        shared[4] = memory::span(&TELEMETRY);
        let ram_fault = start_test::take().fault().is_some();
        TELEMETRY.ram_errors.add(u32::from(ram_fault));
        let memory = hw::DmaMemory {
            radio: cx.local.radio,
            bus: cx.local.bus,
            duties: cx.local.duties,
            supply: cx.local.result,
        };
        let board = hw::init(&mut core, cx.device, memory);
        defmt::info!(
            "hold; last reset: {}; debug port: {}; kept: {=bool}",
            defmt::Debug2Format(&board.reset_reason),
            defmt::Debug2Format(&board.debug_port),
            board.kept.1.is_some()
        );
        if let Some(stop) = last_stop::take() {
            hw::log_stop("the last stop", &stop);
        }
        TELEMETRY.last_stop.set(last_stop::code());
        MEMORY_FAULT.store(ram_fault, Ordering::Relaxed);
        let hold = Hold::new(board.reset_reason, board.kept);
        let link = Link::start(&TELEMETRY, board.rf);
        let mut memory = PartMemory::take();
        let patrol = Patrol::new(patrol::layout(protection::NULL_PAGE_END, shared), integrity::RATE, &mut memory);
        mpu::apply(&mut core.MPU, &protection::TASKS);
        let mut beats = board.beats;
        beats.start();
        (
            Shared { link, hold, readings: Readings::default() },
            Local {
                beats,
                rf_edge: board.rf_edge,
                outputs: board.outputs,
                supply: board.supply,
                sensors: Sensors::new(board.bus, Pause),
                watchdog: board.watchdog,
                patrol,
                memory,
            },
            init::Monotonics(),
        )
    }

    #[idle(local = [watchdog, patrol, memory], shared = [link, readings])]
    fn idle(mut cx: idle::Context) -> ! {
        let mut last_us = hw::now_us();
        let mut pace = Pace::new(last_us);
        loop {
            // After most interrupts no memory check is due, and the idle loop only asks `pace`.
            let due = pace.due(hw::now_us());
            if due == 0 {
                cortex_m::asm::wfi();
                continue;
            }
            if CHECK_IN.complete() {
                // Not covered: a watchdog that other code has configured before, for example a bootloader, so that the
                // hold cannot feed it: none runs on the bench.
                if let Some(watchdog) = cx.local.watchdog.as_mut() {
                    watchdog.pet();
                }
            }
            for _ in 0..due {
                let slice = cx.local.patrol.slice(cx.local.memory);
                match integrity::judge(&slice, &TELEMETRY) {
                    Consequence::None => {}
                    Consequence::MemoryFault => MEMORY_FAULT.store(true, Ordering::Relaxed),
                    Consequence::Stop(cause, detail) => {
                        stop("memory", Stop::new(cause, 0, detail));
                    }
                }
            }
            if hw::now_us().wrapping_sub(last_us) >= 1_000_000 {
                last_us = last_us.wrapping_add(1_000_000);
                if let Some(fault) = cx.shared.link.lock(Link::take_fault) {
                    defmt::warn!("front end: {}", fault);
                }
                let readings = cx.shared.readings.lock(|readings| *readings);
                let [celsius, percent] = readings.climate.unwrap_or([f32::NAN; 2]);
                defmt::info!(
                    "frames {=u32}, answers {=u32}; {=f32} C, {=f32} %, sensor fault {=bool}; bus recoveries {=u32}",
                    TELEMETRY.frames_sent.get(),
                    TELEMETRY.answers.get(),
                    celsius,
                    percent,
                    readings.fault,
                    TELEMETRY.bus_recoveries.get()
                );
            }
        }
    }

    /// Records that a step of the cycle begins. If it is not the step's turn, the hold stops. A debugger that halts the
    /// processor delays steps. So a firmware whose watchdog stops with the processor (`debugger-stops-watchdog`) does
    /// not stop for this reason.
    #[inline(always)]
    fn begin(step: Step) {
        if !FLOW.begin(step, hw::now_us) && !cfg!(feature = "debugger-stops-watchdog") {
            stop_out_of_order(step);
        }
    }

    fn stop_out_of_order(step: Step) -> ! {
        stop("flow", Stop::new(Cause::Flow, safe_state::active_exception(), step as u32))
    }

    #[cold]
    #[inline(never)]
    fn stop(what: &'static str, stop: Stop) -> ! {
        safe_state::enter(hw::safe_state, || stop, |stop| hw::log_stop(what, stop))
    }

    /// Runs at each beat and in the slot. In the slot it sends the loaded frame; at a beat it calls the other tasks.
    #[task(binds = TIMER1, priority = 4, local = [beats])]
    fn slot(cx: slot::Context) {
        match cx.local.beats.interrupt() {
            Beat::Slot => begin(Step::Slot),
            Beat::Began { is_tick } => {
                begin(Step::Beat);
                if is_tick {
                    TELEMETRY.cycles.add(1);
                }
                // A task that has no work at this beat only checks in.
                for task in [Task::rf_spi, Task::rf_irq, Task::rf_timer, Task::cycle, Task::answer, Task::sensors] {
                    board::call(task);
                }
            }
            Beat::Nothing => stop_out_of_order(Step::Slot),
        }
        CHECK_IN.check_in(Task::slot);
    }

    #[task(binds = SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0, priority = 3, shared = [link])]
    fn rf_spi(mut cx: rf_spi::Context) {
        cx.shared.link.lock(serve);
        CHECK_IN.check_in(Task::rf_spi);
    }

    #[task(binds = GPIOTE, priority = 3, local = [rf_edge], shared = [link])]
    fn rf_irq(mut cx: rf_irq::Context) {
        cx.local.rf_edge.clear();
        cx.shared.link.lock(serve);
        CHECK_IN.check_in(Task::rf_irq);
    }

    #[task(binds = TIMER0, priority = 3, shared = [link])]
    fn rf_timer(mut cx: rf_timer::Context) {
        cx.shared.link.lock(|link| {
            link.port().clear_timer();
            serve(link);
        });
        CHECK_IN.check_in(Task::rf_timer);
    }

    fn serve(link: &mut Link<'static, RfPort>) {
        if link.poll() {
            board::call(Task::answer);
        }
    }

    #[task(binds = SWI0_EGU0, priority = 2, local = [outputs, supply, done: Option<u32> = None],
        shared = [hold, link, readings])]
    fn cycle(mut cx: cycle::Context) {
        let begun = DWT::cycle_count();
        begin(Step::Cycle);
        let tick = tick();
        if cx.local.done.replace(tick) != Some(tick) {
            if MEMORY_FAULT.load(Ordering::Relaxed) {
                cx.shared.hold.found_memory_fault();
            }
            let supply = cx.local.supply.take();
            let mut readings = cx.shared.readings.lock(|readings| {
                let taken = *readings;
                readings.shock = None;
                taken
            });
            let (status, outputs) = cx.shared.hold.cycle(tick, &mut readings, supply);
            TELEMETRY.fill_worst_cycles.record_max(DWT::cycle_count().wrapping_sub(begun));
            cx.shared.link.lock(|link| link.offer(tick, &status));
            cx.local.outputs.apply(outputs);
        }
        CHECK_IN.check_in(Task::cycle);
    }

    #[task(binds = SWI1_EGU1, priority = 2, shared = [hold, link])]
    fn answer(mut cx: answer::Context) {
        if let Some(answer) = cx.shared.link.lock(Link::take_answer) {
            cx.shared.hold.command(&answer, tick(), &TELEMETRY);
        }
        CHECK_IN.check_in(Task::answer);
    }

    #[task(binds = SWI2_EGU2, priority = 1, local = [sensors], shared = [readings])]
    fn sensors(mut cx: sensors::Context) {
        let begun = hw::now_us();
        cx.local.sensors.serve(beat(), &TELEMETRY);
        cx.shared.readings.lock(|readings| cx.local.sensors.report(readings));
        CHECK_IN.check_in(Task::sensors);
        TELEMETRY.sensors_worst_us.record_max(hw::now_us().wrapping_sub(begun));
    }
}
