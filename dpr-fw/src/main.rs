//! Firmware of the DPR. This file is the table of tasks; what they do is in the library, the registers are in `hw`, and
//! pins, vectors and channels are in `board`.
//!
//! | priority | task | when | has to be through within |
//! |---|---|---|---|
//! | 5 | `ssi_end` | a transaction has ended, a newer image is there, the image has expired | 10 µs |
//! | 4 | `rf_spi`, `rf_irq`, `rf_timer` | a transfer has ended, the front end's IRQ rises, a wait is over | 40 µs |
//! | 3 | `commit`, `deadline` | a frame is in its buffer; 12.5 ms without one | 0.1 ms |
//! | 2 | `scrub` | a buffer was read | 10 ms |
//! | 0 | `idle` | nothing else wants to run | 100 ms |
//!
//! Where the bounds come from: after 10 µs the flight controller may select again; 40 µs are two bytes on air, and a
//! task that verifies an object early takes about 30 (the front end's FIFO holds what arrives meanwhile); 0.1 ms is
//! what the design allows from the last bit to a readable image; after 10 ms the next frame needs the buffer; after 100
//! ms the watchdog bites.
//!
//! SSI above RFID above commit above scrub above idle. A flight controller that never stops cannot keep the others from
//! running: how often the highest task runs is bounded by what it grants ([`dpr_fw::ssi::Budget`]).
//!
//! Only `idle` writes to the log, and no task masks interrupts for that ([`firmware_common::log_section`]).
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
firmware_common::install_safe_state!(hw::safe_state);

#[cfg(target_os = "none")]
#[rtic::app(device = nrf52840_hal::pac, peripherals = true)]
mod app {
    use cortex_m::peripheral::DWT;
    use defmt_rtt as _;
    use dpr_fw::{
        commit::Commit,
        intake,
        link::Health,
        publish::{Mailbox, Outbox, Server},
        rf::{FrameInfo, FrontEnd, Receiver},
        ssi::RECEIVE_BYTES,
        task::Task,
        triple::{self, Filling, Rotation, IMAGES},
        ImageMemory, ReceiveMemory, IMAGE_WORDS, RECEIVERS, RECEIVE_WORDS,
    };
    use firmware_common::check_in::CheckIn;
    use nrf52840_hal::{
        pac::Interrupt,
        wdt::{handles::Hdl0, WatchdogHandle},
    };
    use profile::{image::Image, ResetReason};
    use rtic::Mutex;
    use st25r3916::{Listener, ListenerConfig, ReadMode, Short};

    use crate::hw::{
        self, Deadline, ImageBuffer, ReceiveBuffer, RfEdge, RfPort, SsiDoorbell, SsiPort, DPR_TELEMETRY as TELEMETRY,
    };

    const LISTENER: ListenerConfig = ListenerConfig {
        read_mode: if cfg!(feature = "store-and-forward") { ReadMode::StoreAndForward } else { ReadMode::WhileFilling },
        ..ListenerConfig::new()
    };

    static CHECK_IN: CheckIn<Task> = CheckIn::new();

    /// What `commit` and `deadline`, of the same priority, share.
    pub struct Committing {
        commit: Commit<RECEIVERS>,
        filling: Option<Filling<ImageBuffer>>,
        deadline: Deadline,
        started: bool,
        reset_reason: ResetReason,
    }

    #[shared]
    struct Shared {
        rotation: Rotation<ReceiveBuffer, FrameInfo>,
        mailbox: Mailbox<ImageBuffer>,
        front_end: FrontEnd,
        #[lock_free]
        receiver: Receiver<RfPort>,
        #[lock_free]
        committing: Committing,
    }

    #[local]
    struct Local {
        ssi: SsiPort,
        server: Server<{ Image::<RECEIVERS>::LEN }>,
        rf_edge: RfEdge,
        watchdog: Option<WatchdogHandle<Hdl0>>,
    }

    #[init(local = [
        receive: [ReceiveMemory; 3] = [[0; RECEIVE_WORDS]; 3],
        images: [ImageMemory; IMAGES] = [[0; IMAGE_WORDS]; IMAGES],
        spi_tx: [u8; Short::MAX] = [0; Short::MAX],
        spi_rx: [u8; Short::MAX] = [0; Short::MAX],
        ssi_rx: [u8; RECEIVE_BYTES] = [0; RECEIVE_BYTES],
    ])]
    fn init(cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let mut core = cx.core;
        let (filling, rotation, found) = Rotation::new(cx.local.receive.each_mut());
        TELEMETRY.scrubbed(3, found.stuck_bits);
        let mailbox = Mailbox::new(cx.local.images.each_mut());
        let memory = hw::DmaMemory { spi_tx: cx.local.spi_tx, spi_rx: cx.local.spi_rx, ssi_rx: cx.local.ssi_rx };
        let board = hw::init(&mut core, cx.device, memory, filling);
        defmt::info!(
            "DPR for {=usize} receivers; last reset: {}; debug port: {}",
            RECEIVERS,
            defmt::Debug2Format(&board.reset_reason),
            defmt::Debug2Format(&board.debug_port)
        );
        let receiver = Receiver::start(Listener::new(LISTENER), board.rf);
        let committing = Committing {
            commit: Commit::new(),
            filling: None,
            deadline: board.deadline,
            started: false,
            reset_reason: board.reset_reason,
        };
        // The first image, before anything is heard.
        rtic::pend(Interrupt::SWI0_EGU0);
        (
            Shared { rotation, mailbox, front_end: FrontEnd::Starting, receiver, committing },
            Local { ssi: board.ssi, server: Server::new(), rf_edge: board.rf_edge, watchdog: board.watchdog },
            init::Monotonics(),
        )
    }

    /// The lowest priority: logs changes and a summary each second, feeds the watchdog, sleeps.
    #[idle(local = [watchdog], shared = [front_end])]
    fn idle(mut cx: idle::Context) -> ! {
        let mut shown = FrontEnd::Starting;
        let mut last_us = hw::now_us();
        loop {
            if CHECK_IN.complete() {
                if let Some(watchdog) = cx.local.watchdog.as_mut() {
                    watchdog.pet();
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
            cortex_m::asm::wfi();
        }
    }

    /// A transaction has ended, or the semaphore has come for another reason, or the scrub asks for a sign of life.
    #[task(binds = SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1, priority = 5, local = [ssi, server], shared = [mailbox])]
    fn ssi_end(cx: ssi_end::Context) {
        let start = DWT::cycle_count();
        cx.local.server.serve(cx.local.ssi, cx.shared.mailbox, &TELEMETRY);
        CHECK_IN.check_in(Task::Ssi);
        TELEMETRY.ssi_worst_cycles.record_max(DWT::cycle_count().wrapping_sub(start));
    }

    /// A transfer with the front end has ended.
    #[task(binds = SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0, priority = 4, shared = [receiver, rotation, front_end])]
    fn rf_spi(cx: rf_spi::Context) {
        receive(cx.shared.receiver, cx.shared.rotation, cx.shared.front_end);
    }

    /// The front end's IRQ has risen, or the scrub asks for a sign of life.
    #[task(binds = GPIOTE, priority = 4, local = [rf_edge], shared = [receiver, rotation, front_end])]
    fn rf_irq(cx: rf_irq::Context) {
        cx.local.rf_edge.clear();
        receive(cx.shared.receiver, cx.shared.rotation, cx.shared.front_end);
        CHECK_IN.check_in(Task::Rf);
    }

    /// A wait of the front end's driver is over.
    #[task(binds = TIMER0, priority = 4, shared = [receiver, rotation, front_end])]
    fn rf_timer(cx: rf_timer::Context) {
        receive(cx.shared.receiver, cx.shared.rotation, cx.shared.front_end);
    }

    fn receive(
        receiver: &mut Receiver<RfPort>,
        rotation: impl Mutex<T = Rotation<ReceiveBuffer, FrameInfo>>,
        front_end: impl Mutex<T = FrontEnd>,
    ) {
        if receiver.serve::<RECEIVERS>(rotation, front_end, &TELEMETRY) {
            rtic::pend(Interrupt::SWI0_EGU0);
        }
    }

    /// A frame is in its buffer: verified, deposited, published.
    #[task(binds = SWI0_EGU0, priority = 3, shared = [committing, rotation, mailbox, front_end])]
    fn commit(cx: commit::Context) {
        publish(cx.shared.committing, cx.shared.rotation, cx.shared.mailbox, cx.shared.front_end);
    }

    /// No frame came in time: what was valid must not stay readable.
    #[task(binds = TIMER1, priority = 3, shared = [committing, rotation, mailbox, front_end])]
    fn deadline(cx: deadline::Context) {
        cx.shared.committing.deadline.clear();
        publish(cx.shared.committing, cx.shared.rotation, cx.shared.mailbox, cx.shared.front_end);
    }

    fn publish(
        committing: &mut Committing,
        rotation: impl Mutex<T = Rotation<ReceiveBuffer, FrameInfo>>,
        mailbox: impl Mutex<T = Mailbox<ImageBuffer>>,
        mut front_end: impl Mutex<T = FrontEnd>,
    ) {
        let start = DWT::cycle_count();
        let Committing { commit, filling, deadline, started, reset_reason } = committing;
        let health = Health {
            ram_fault: TELEMETRY.scrub_faults.get() > 0,
            front_end_fault: front_end.lock(|state| matches!(state, FrontEnd::Lost(_))),
            flash_fault: false,
            reset_reason: *reset_reason,
            access_violations: TELEMETRY.access_violations.get(),
        };
        let mut outbox = Outbox { mailbox, filling, doorbell: SsiDoorbell, telemetry: &TELEMETRY };
        if !core::mem::replace(started, true) {
            commit.begin(hw::now_us(), &health, &mut outbox);
        }
        intake::take_in(commit, rotation, hw::now_us, &health, &mut outbox, &TELEMETRY);
        deadline.set(commit.deadline_us());
        TELEMETRY.commit_worst_cycles.record_max(DWT::cycle_count().wrapping_sub(start));
        CHECK_IN.check_in(Task::Commit);
        rtic::pend(Interrupt::SWI1_EGU1);
    }

    /// Buffers were read or replaced: scrubs them, then asks the interrupts for their signs of life.
    #[task(binds = SWI1_EGU1, priority = 2, shared = [rotation, mailbox])]
    fn scrub(cx: scrub::Context) {
        for (buffers, stuck_bits) in
            [triple::scrub_waiting(cx.shared.rotation), triple::scrub_waiting(cx.shared.mailbox)]
        {
            TELEMETRY.scrubbed(buffers, stuck_bits);
        }
        CHECK_IN.check_in(Task::Scrub);
        rtic::pend(Interrupt::GPIOTE);
        rtic::pend(Interrupt::SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1);
    }
}
