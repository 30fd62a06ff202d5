//! The firmware of the DPR. This file is the RTIC table of tasks; the library has their logic, `hw` the registers, and
//! `board` the pins and peripherals.
//!
//! | task | when it is called | longest time until it is done |
//! |---|---|---|
//! | `ssi_end` | a transaction has ended, a newer image was published, the image has expired | 95 µs |
//! | `ssi_pause` | 95 µs after a transaction's end was handled: the next end may call `ssi_end` | 95 µs |
//! | `rf_spi`, `rf_irq`, `rf_timer` | a transfer has ended, the front end's IRQ rises, a delay is over | 0.45 ms |
//! | `commit`, `deadline` | a frame is in its buffer; no frame for 12.5 ms | 0.45 ms |
//! | `scrub` | a buffer was read | 10 ms |
//! | `port` | a transaction has brought bytes; an image was published | 10 ms |
//! | `hold_spi`, `hold_irq`, `hold_timer` | as `rf_…`, for the front end of a hold (feature `hold`) | 1 ms |
//! | `idle` | no other task runs | 100 ms |
//!
//! The tasks with the highest priority stand first. `build.rs` makes the table in [`dpr_fw::task`] from the tasks'
//! attributes. The longest times have these reasons:
//!
//! - `ssi_*`: 95 µs after one call the next can come. The buffers are released within 10 µs (docs/timing.md#sums).
//! - `rf_*`: the front end's FIFO has 512 bytes and holds a whole frame, so it has to be read when the next frame's
//!   bytes come, 0.45 ms after a frame's end at the earliest. That an image is readable 0.1 ms after that end is a sum
//!   over several tasks (docs/timing.md#sums).
//! - `commit`: the next frame's bytes come 0.45 ms after a frame's end at the earliest. The image is readable 0.1 ms
//!   after that end (docs/timing.md#sums).
//! - `scrub`, `port`: the next frame needs the buffer, and the next image the prepared area, after 10 ms.
//! - `hold_*`: an answer has 1 ms to spare ([`dpr_fw::hold::ANSWER_US`]).
//! - `idle`: without a feed for 100 ms the watchdog resets the part.
//!
//! Transactions without end cannot keep other tasks from running: the pause between two served transactions, and the
//! limit on transactions between two images, bound how often the SSI tasks run ([`dpr_fw::ssi`]). A budget bounds the
//! tasks of the hold's front end ([`dpr_fw::hold`]).
//!
//! Only `idle` writes to the log, and no task masks interrupts for the log ([`firmware_common::log_section`]).
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod hw;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "this is firmware for the nRF52840: build it with `cargo xtask build`, flash it with `cargo xtask flash dpr`"
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
    use dpr_fw::{
        hold::Area,
        intake::{Intake, Notices},
        integrity::{self, Consequence, ImageCheck, Integrity, Judge},
        port::{
            areas::{Areas, PortEnd, AREAS},
            brought_nothing, Diagnostics, Prepared, WritePort,
        },
        protection,
        publish::{Mailbox, Outbox, Server},
        rf::{Call, FrameInfo, FrontEnd, Reception},
        ssi::{ReceiveArea, SignOfLife, RECEIVE_BYTES},
        task::Task,
        triple::{self, Filling, Rotation, IMAGES, RECEIVE_BUFFERS},
        ImageMemory, ReceiveMemory, IMAGE_WORDS, MAP_BYTES, RECEIVERS, RECEIVE_WORDS,
    };
    use firmware_common::{
        check_in::CheckIn,
        checked::Checked,
        last_stop::{self, Cause, Stop},
        memory, mpu,
        patrol::{self, ram::APART, Pace, PartMemory, Patrol},
        safe_state, start_test,
    };
    use nrf52840_hal::wdt::{handles::Hdl0, WatchdogHandle};
    use rtic::Mutex;
    use st25r3916::{Listener, ListenerConfig, ReadMode, Short};

    #[cfg(feature = "hold")]
    use crate::hw::DPR_HOLD_TELEMETRY as HOLD_TELEMETRY;
    #[cfg(feature = "hold")]
    use dpr_fw::hold::SpiMemory;

    use crate::board;
    use crate::hw::{
        self, AreaBuffer, Deadline, HoldEdge, HoldResponder, HoldShared, ImageBuffer, ReceiveBuffer, RfEdge, RfPort,
        SsiDoorbell, SsiPort, DPR_TELEMETRY as TELEMETRY,
    };

    const LISTENER: ListenerConfig = ListenerConfig {
        read_mode: if cfg!(feature = "store-and-forward") { ReadMode::StoreAndForward } else { ReadMode::WhileFilling },
        ..ListenerConfig::new()
    };

    static CHECK_IN: CheckIn<Task> = CheckIn::new();

    static INTEGRITY: Integrity = Integrity::new();

    /// Whether the RFID tasks want the commit task to prepare an image.
    static FRAME_ARRIVES: AtomicBool = AtomicBool::new(false);

    /// Whether a frame has ended, and the commit task has time to verify its state while the last bytes are read.
    static FRAME_ENDS: AtomicBool = AtomicBool::new(false);

    /// For how long the commit task does not verify its state again, processor cycles: 100 µs. The last bytes of a
    /// frame are read in less.
    const VERIFIED_FOR: u32 = 6_400;

    /// The least time between two calls by which the scrub task makes all other tasks check in, µs.
    const SIGNS_OF_LIFE_US: u32 = 9_000;

    /// The state that the tasks `commit` and `deadline` share, which have one priority.
    pub struct Committing {
        kept: Checked<(Intake<RECEIVERS>, Option<Filling<ImageBuffer>>)>,
        /// The value of the cycle counter when `kept` was last verified for a frame that had ended.
        verified: u32,
        deadline: Deadline,
    }

    #[shared]
    struct Shared {
        rotation: Rotation<ReceiveBuffer, FrameInfo>,
        mailbox: Mailbox<ImageBuffer>,
        prepared: Prepared<&'static mut Area>,
        front_end: FrontEnd,
        hold: HoldShared,
        #[lock_free]
        responder: HoldResponder,
        #[lock_free]
        receiver: Reception<RfPort>,
        #[lock_free]
        committing: Committing,
    }

    #[local]
    struct Local {
        ssi: SsiPort,
        server: Server<MAP_BYTES>,
        port: Checked<WritePort>,
        areas: PortEnd<'static, AreaBuffer>,
        spare: &'static mut Area,
        rf_edge: RfEdge,
        sign_of_life: SignOfLife,
        hold_edge: HoldEdge,
        watchdog: Option<WatchdogHandle<Hdl0>>,
        patrol: Patrol,
        memory: PartMemory,
    }

    #[init(local = [
        receive: [ReceiveMemory; RECEIVE_BUFFERS] = [[0; RECEIVE_WORDS]; RECEIVE_BUFFERS],
        images: [ImageMemory; IMAGES] = [[0; IMAGE_WORDS]; IMAGES],
        spi_tx: [u8; Short::MAX] = [0; Short::MAX],
        spi_rx: [u8; Short::MAX] = [0; Short::MAX],
        ssi_rx: [ReceiveArea; AREAS] = [[0; RECEIVE_BYTES / 4]; AREAS],
        ssi_areas: Areas<AreaBuffer> = Areas::new(),
        port_areas: [Area; 2] = [Area::EMPTY; 2],
        #[cfg(feature = "hold")]
        hold_receive: [ReceiveMemory; RECEIVE_BUFFERS] = [[0; RECEIVE_WORDS]; RECEIVE_BUFFERS],
        #[cfg(feature = "hold")]
        hold_spi: SpiMemory = SpiMemory::NEW,
    ])]
    fn init(cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let mut core = cx.core;
        // The patrol leaves out the memory that EasyDMA accesses, and the counters that a debugger reads.
        let mut shared = [const { 0..0 }; APART - 2];
        shared[0] = memory::span(cx.local.receive);
        shared[1] = memory::span(cx.local.images);
        shared[2] = memory::span(cx.local.ssi_rx);
        shared[3] = memory::span(cx.local.spi_tx);
        shared[4] = memory::span(cx.local.spi_rx);
        shared[5] = memory::span(&TELEMETRY);
        #[cfg(feature = "hold")]
        {
            shared[6] = memory::span(cx.local.hold_receive);
            shared[7] = memory::span(cx.local.hold_spi);
            shared[8] = memory::span(&HOLD_TELEMETRY);
        }
        let (filling, rotation, found) = Rotation::new(cx.local.receive.each_mut());
        TELEMETRY.scrubbed(found);
        let mailbox = Mailbox::new(cx.local.images.each_mut());
        let (area, ssi_end, areas, found_in_areas) = cx.local.ssi_areas.split(cx.local.ssi_rx.each_mut());
        TELEMETRY.scrubbed(found_in_areas);
        let [ready, spare] = cx.local.port_areas.each_mut();
        let mut port = WritePort::new();
        port.prepare(&Diagnostics::default(), 0, &mut ready.port);
        TELEMETRY.ram_errors.add(u32::from(start_test::take().fault().is_some()));
        #[cfg(feature = "hold")]
        let (hold_filling, hold_rotation, found_in_hold) = Rotation::new(cx.local.hold_receive.each_mut());
        #[cfg(feature = "hold")]
        HOLD_TELEMETRY.scrubbed(found_in_hold);
        let memory = hw::DmaMemory {
            spi_tx: cx.local.spi_tx,
            spi_rx: cx.local.spi_rx,
            ssi_rx: (area, ssi_end),
            #[cfg(feature = "hold")]
            hold: hw::HoldDma { spi: cx.local.hold_spi, receive: hold_filling },
        };
        let board = hw::init(&mut core, cx.device, memory, filling);
        defmt::info!(
            "DPR for {=usize} receivers; last reset: {}; debug port: {}",
            RECEIVERS,
            defmt::Debug2Format(&board.reset_reason),
            defmt::Debug2Format(&board.debug_port)
        );
        if let Some(stop) = last_stop::take() {
            hw::log_stop("the last stop", &stop);
        }
        TELEMETRY.last_stop.set(last_stop::code());
        let receiver = Reception::start(Listener::new(LISTENER), board.rf);
        #[cfg(feature = "hold")]
        let (hold, responder, hold_edge) = {
            let (port, edge) = board.hold;
            (HoldShared::new(), HoldResponder::start(port, hold_rotation, hw::now_us()), edge)
        };
        #[cfg(not(feature = "hold"))]
        let (hold, responder, hold_edge) = ((), (), ());
        let intake = Intake::new(board.reset_reason);
        let committing = Committing { kept: Checked::new((intake, None)), verified: 0, deadline: board.deadline };
        let mut memory = PartMemory::take();
        let patrol = Patrol::new(patrol::layout(integrity::SHUT_END, shared), integrity::RATE, &mut memory);
        mpu::apply(&mut core.MPU, &protection::TASKS);
        // The task `commit` publishes the first image at once, before any frame is received.
        board::call(Task::commit);
        (
            Shared {
                rotation,
                mailbox,
                prepared: Prepared::new(ready),
                front_end: FrontEnd::Starting,
                hold,
                responder,
                receiver,
                committing,
            },
            Local {
                ssi: board.ssi,
                server: Server::new(),
                port: Checked::new(port),
                areas,
                spare,
                rf_edge: board.rf_edge,
                sign_of_life: SignOfLife::new(),
                hold_edge,
                watchdog: board.watchdog,
                patrol,
                memory,
            },
            init::Monotonics(),
        )
    }

    #[idle(local = [watchdog, patrol, memory], shared = [front_end])]
    fn idle(mut cx: idle::Context) -> ! {
        let mut shown = FrontEnd::Starting;
        let mut last_us = hw::now_us();
        let mut pace = Pace::new(last_us);
        let mut judge = Judge::new();
        let mut image = ImageCheck::<RECEIVERS>::new();
        loop {
            // After most interrupts there is nothing to do, and the idle loop only asks `pace`.
            let due = pace.due(hw::now_us());
            if due == 0 {
                cortex_m::asm::wfi();
                continue;
            }
            if CHECK_IN.complete() {
                if let Some(watchdog) = cx.local.watchdog.as_mut() {
                    watchdog.pet();
                }
            }
            if judge.begin_self_test(&INTEGRITY) {
                cx.local.patrol.restart();
            }
            let each = if INTEGRITY.is_self_test_running() { integrity::SELF_TEST_SLICES } else { 1 };
            for number in 0..due * each {
                let (patrol, memory) = (&mut *cx.local.patrol, &mut *cx.local.memory);
                let mut slice = if number < due { patrol.slice(memory) } else { patrol.passes(memory) };
                // A bit of the patrol's own state that flips looks like changed flash. So what counts is a comparison
                // without that state.
                if slice.flash.is_some_and(|found| !found.is_intact()) {
                    slice.flash = Some(memory.compare());
                }
                // A self-test needs neither the image nor code in RAM, which get their usual number of slices.
                let damaged = if number < due { image.slice(&hw::ShownImage) } else { None };
                match judge.judge(&slice, damaged, &INTEGRITY, &TELEMETRY) {
                    Consequence::None => {}
                    Consequence::Withdraw => board::call(Task::commit),
                    Consequence::Stop(cause, detail) => {
                        stop("memory", Stop::new(cause, 0, detail));
                    }
                }
            }
            let front_end = cx.shared.front_end.lock(|state| *state);
            if front_end != shown {
                shown = front_end;
                defmt::info!("front end: {}", front_end);
            }
            if hw::now_us().wrapping_sub(last_us) >= 1_000_000 {
                last_us = last_us.wrapping_add(1_000_000);
                defmt::info!(
                    "frames {=u32}, missed {=u32}; objects {=u32}, rejected {=u32}; SSI {=u32}, violations {=u32}",
                    TELEMETRY.frames_received.get(),
                    TELEMETRY.frames_missed.get(),
                    TELEMETRY.objects_accepted.get(),
                    TELEMETRY.objects_rejected.get(),
                    TELEMETRY.ssi_transactions.get(),
                    TELEMETRY.access_violations.get()
                );
            }
        }
    }

    /// Stops the DPR unless `task`, which begins to run, was called. A debugger may make any interrupt pending.
    #[inline(always)]
    fn begin(task: Task) {
        if !board::was_called(task) && !cfg!(feature = "debugger-stops-watchdog") {
            stop("flow", Stop::new(Cause::Flow, safe_state::active_exception(), task as u32));
        }
    }

    /// Verifies what was kept since the last call, changes it by `with`, and checks it anew. The DPR stops if a bit of
    /// it has flipped.
    fn change<T, R>(kept: &mut Checked<T>, with: impl FnOnce(&mut T) -> R) -> R {
        if !kept.is_intact() {
            stop_changed(kept.address());
        }
        kept.change_verified(with)
    }

    fn stop_changed(address: u32) -> ! {
        stop("kept state", Stop::new(Cause::Ram, safe_state::active_exception(), address))
    }

    /// Stops the DPR because of `stop`, which the check of `what` has found.
    #[cold]
    #[inline(never)]
    fn stop(what: &'static str, stop: Stop) -> ! {
        safe_state::enter(hw::safe_state, || stop, |stop| hw::log_stop(what, stop))
    }

    /// Runs at the end of a transaction and whenever the processor gets the semaphore of the SSI's buffers.
    #[task(binds = SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1, priority = 6, local = [ssi, server], shared = [mailbox])]
    fn ssi_end(cx: ssi_end::Context) {
        let start = DWT::cycle_count();
        cx.local.server.serve(cx.local.ssi, cx.shared.mailbox, &TELEMETRY);
        CHECK_IN.check_in(Task::ssi_end);
        TELEMETRY.ssi_worst_cycles.record_max(DWT::cycle_count().wrapping_sub(start));
    }

    /// Runs when the pause after a transaction is over. After this task has run, the end of a transaction calls
    /// `ssi_end` again.
    #[task(binds = TIMER3, priority = 6)]
    fn ssi_pause(_: ssi_pause::Context) {
        SsiDoorbell::end_pause();
        CHECK_IN.check_in(Task::ssi_pause);
    }

    #[task(binds = SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0, priority = 5, shared = [receiver, rotation, front_end])]
    fn rf_spi(cx: rf_spi::Context) {
        receive(cx.shared.receiver, cx.shared.rotation, cx.shared.front_end);
        CHECK_IN.check_in(Task::rf_spi);
    }

    #[task(binds = GPIOTE, priority = 5, local = [rf_edge], shared = [receiver, rotation, front_end])]
    fn rf_irq(cx: rf_irq::Context) {
        cx.local.rf_edge.clear();
        receive(cx.shared.receiver, cx.shared.rotation, cx.shared.front_end);
        // Only the end of a frame raises the pin when most of the frame has arrived.
        if cx.shared.receiver.verify_early() {
            FRAME_ENDS.store(true, Ordering::Relaxed);
            board::call(Task::commit);
        }
        CHECK_IN.check_in(Task::rf_irq);
    }

    #[task(binds = TIMER0, priority = 5, shared = [receiver, rotation, front_end])]
    fn rf_timer(cx: rf_timer::Context) {
        receive(cx.shared.receiver, cx.shared.rotation, cx.shared.front_end);
        CHECK_IN.check_in(Task::rf_timer);
    }

    fn receive(
        receiver: &mut Reception<RfPort>,
        rotation: impl Mutex<T = Rotation<ReceiveBuffer, FrameInfo>>,
        front_end: impl Mutex<T = FrontEnd>,
    ) {
        match receiver.serve::<RECEIVERS>(rotation, front_end, &TELEMETRY) {
            Call::None => {}
            Call::Prepare => {
                FRAME_ARRIVES.store(true, Ordering::Relaxed);
                board::call(Task::commit);
            }
            Call::Handed => {
                FRAME_ENDS.store(false, Ordering::Relaxed);
                board::call(Task::commit);
                board::call_step(Task::scrub);
            }
        }
    }

    #[task(binds = SWI0_EGU0, priority = 4, shared = [committing, rotation, mailbox, prepared, front_end])]
    fn commit(cx: commit::Context) {
        let commit::SharedResources { committing, rotation, mailbox, mut prepared, front_end } = cx.shared;
        if FRAME_ENDS.swap(false, Ordering::Relaxed) {
            // The task is called again when the frame's last bytes have been read.
            committing.verified = DWT::cycle_count();
            if !committing.kept.is_intact() {
                stop_changed(committing.kept.address());
            }
            CHECK_IN.check_in(Task::commit);
            return;
        }
        prepared.lock(|prepared| publish(committing, rotation, mailbox, prepared.newest(), front_end));
        CHECK_IN.check_in(Task::commit);
    }

    /// Runs when no frame came in time. It publishes an image without objects, so that old objects are no longer
    /// readable.
    #[task(binds = TIMER1, priority = 4, shared = [committing, rotation, mailbox, prepared, front_end])]
    fn deadline(cx: deadline::Context) {
        // Without the timer's event only `scrub` has called the task. Its mark is left if both have.
        if !cx.shared.committing.deadline.clear() {
            begin(Task::deadline);
            let kept = &cx.shared.committing.kept;
            if !kept.is_intact() {
                stop_changed(kept.address());
            }
            if !kept.get().0.has_lapsed(hw::now_us()) {
                CHECK_IN.check_in(Task::deadline);
                return;
            }
        }
        let deadline::SharedResources { committing, rotation, mailbox, mut prepared, front_end } = cx.shared;
        prepared.lock(|prepared| publish(committing, rotation, mailbox, prepared.newest(), front_end));
        CHECK_IN.check_in(Task::deadline);
    }

    fn publish(
        committing: &mut Committing,
        rotation: impl Mutex<T = Rotation<ReceiveBuffer, FrameInfo>>,
        mailbox: impl Mutex<T = Mailbox<ImageBuffer>>,
        port: &Area,
        mut front_end: impl Mutex<T = FrontEnd>,
    ) {
        let start = DWT::cycle_count();
        if start.wrapping_sub(committing.verified) > VERIFIED_FOR && !committing.kept.is_intact() {
            stop_changed(committing.kept.address());
        }
        let notices = Notices {
            frame_arrives: FRAME_ARRIVES.swap(false, Ordering::Relaxed),
            front_end: front_end.lock(|state| *state),
            integrity: &INTEGRITY,
            shown: hw::ShownImage,
        };
        let published = committing.kept.change_verified(|(intake, filling)| {
            let mut outbox = Outbox { mailbox, filling, doorbell: SsiDoorbell, port, telemetry: &TELEMETRY };
            intake.serve(rotation, &notices, &mut outbox, &mut committing.deadline)
        });
        if published {
            TELEMETRY.commit_worst_cycles.record_max(DWT::cycle_count().wrapping_sub(start));
            board::call_step(Task::scrub);
        }
    }

    /// Scrubs the buffers that wait for a scrub. Once a cycle it also calls the other tasks, so that they check in.
    #[task(binds = SWI1_EGU1, priority = 3, local = [sign_of_life, asked_us: u32 = 0], shared = [rotation, mailbox])]
    fn scrub(cx: scrub::Context) {
        begin(Task::scrub);
        TELEMETRY.scrubbed(triple::scrub_waiting(cx.shared.rotation));
        TELEMETRY.scrubbed(triple::scrub_waiting(cx.shared.mailbox));
        CHECK_IN.check_in(Task::scrub);
        // With five receivers the scrub task runs twice a cycle, but one check-in per cycle is enough for the watchdog.
        let now_us = hw::now_us();
        if now_us.wrapping_sub(*cx.local.asked_us) < SIGNS_OF_LIFE_US {
            return;
        }
        *cx.local.asked_us = now_us;
        // A frame has already called the RFID tasks and the commit task, so that they have checked in.
        let called = [Task::rf_spi, Task::rf_irq, Task::rf_timer, Task::commit, Task::deadline];
        #[cfg(feature = "hold")]
        let called = called.into_iter().chain([Task::hold_spi, Task::hold_irq, Task::hold_timer]);
        for task in called {
            if !CHECK_IN.has_checked_in(task) {
                board::call_step(task);
            }
        }
        SsiDoorbell::ask_for_sign_of_life(cx.local.sign_of_life);
        board::call_step(Task::port);
    }

    /// Runs when a transaction has brought bytes, or an image was published. Judges the bytes, and prepares Port-Status
    /// and uplinks for the next image.
    #[task(binds = SWI2_EGU2, priority = 2, local = [port, areas, spare, prepared_for: u32 = 0],
        shared = [prepared, hold])]
    fn port(mut cx: port::Context) {
        let start = DWT::cycle_count();
        begin(Task::port);
        let port::LocalResources { port, areas, spare, prepared_for } = cx.local;
        // The loop ends, because the SSI task grants only a bounded number of transactions between two images.
        let mut changed = false;
        while let Some(brought) = areas.take() {
            let area: &ReceiveArea = brought.memory();
            if !brought_nothing(area) {
                changed |= change(port, |port| port.transaction(*brought.about(), area, hw::now_us()));
            }
            TELEMETRY.scrubbed(areas.done(brought));
        }
        let publications = TELEMETRY.publications.get();
        changed |= core::mem::replace(prepared_for, publications) != publications;
        let self_test = INTEGRITY.serve_self_test(port.get().self_test_requested());
        if changed || self_test.is_some() {
            change(port, |port| {
                if let Some(passed) = self_test {
                    port.self_test_done(passed);
                }
                #[cfg(feature = "hold")]
                let hold = cx.shared.hold.lock(|hold| {
                    port.hand_on(hold);
                    hold.show(hw::now_us(), &mut spare.hold)
                });
                let diagnostics = Diagnostics {
                    too_many: TELEMETRY.ssi_budgets_spent.get().wrapping_add(TELEMETRY.ssi_objects_dropped.get()),
                    integrity_faults: TELEMETRY.image_faults.get(),
                    flash_passes: TELEMETRY.flash_passes.get(),
                    stuck_bits: TELEMETRY.scrub_faults.get(),
                    buffers_out_of_use: TELEMETRY.buffers_out_of_use.get(),
                    last_stop: last_stop::code(),
                    #[cfg(feature = "hold")]
                    hold,
                };
                port.prepare(&diagnostics, hw::now_us(), &mut spare.port);
                TELEMETRY.access_violations.set(port.access_violations());
                TELEMETRY.uplink_rejected.set(u32::from(port.last_refused()));
                TELEMETRY.uplinks_accepted.set(port.uplinks_accepted());
            });
            cx.shared.prepared.lock(|prepared| prepared.exchange(spare));
        }
        CHECK_IN.check_in(Task::port);
        TELEMETRY.port_worst_cycles.record_max(DWT::cycle_count().wrapping_sub(start));
    }

    #[cfg(feature = "hold")]
    #[task(binds = SPIM2_SPIS2_SPI2, priority = 1, shared = [responder, hold])]
    fn hold_spi(cx: hold_spi::Context) {
        respond(cx.shared.responder, cx.shared.hold);
        CHECK_IN.check_in(Task::hold_spi);
    }

    #[cfg(feature = "hold")]
    #[task(binds = SWI3_EGU3, priority = 1, local = [hold_edge], shared = [responder, hold])]
    fn hold_irq(cx: hold_irq::Context) {
        cx.local.hold_edge.clear();
        respond(cx.shared.responder, cx.shared.hold);
        CHECK_IN.check_in(Task::hold_irq);
    }

    #[cfg(feature = "hold")]
    #[task(binds = TIMER4, priority = 1, shared = [responder, hold])]
    fn hold_timer(cx: hold_timer::Context) {
        respond(cx.shared.responder, cx.shared.hold);
        CHECK_IN.check_in(Task::hold_timer);
    }

    #[cfg(feature = "hold")]
    fn respond(responder: &mut HoldResponder, shared: impl Mutex<T = HoldShared>) {
        let start = DWT::cycle_count();
        responder.serve(shared, hw::now_us, &HOLD_TELEMETRY);
        HOLD_TELEMETRY.worst_cycles.record_max(DWT::cycle_count().wrapping_sub(start));
    }
}
