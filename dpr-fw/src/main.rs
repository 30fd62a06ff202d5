//! Firmware of the DPR. This file is the table of tasks; what they do is in the library, and the registers are in `hw`.
//!
//! | priority | task | when | has to be through within |
//! |---|---|---|---|
//! | 5 | `ssi_end` | CSN rises, or a newer image is there | 10 µs: the flight controller may select again |
//! | 4 | `rf_spi`, `rf_irq`, `rf_timer` | a transfer has ended, the front end's IRQ rises, a wait is over | 40 µs, two bytes on air: one that verifies an object early takes about 30; the front end's FIFO holds what arrives meanwhile |
//! | 3 | `commit`, `deadline` | a frame is in its buffer; 12.5 ms without one | 0.1 ms: last bit to readable |
//! | 2 | `scrub` | a buffer was read | the next frame, 10 ms |
//! | 0 | `idle` | nothing else wants to | 100 ms: feeds the watchdog |
//!
//! SSI above RFID above commit above scrub above idle. A flight controller that never lets go cannot hold the others up: how often the highest task runs is
//! bounded by what it grants ([`dpr_fw::ssi::Budget`]).
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod hw;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("dpr-fw is firmware for the nRF52840: `cargo xtask build` makes it, `cargo xtask flash dpr` puts it on a board.");
    std::process::exit(1);
}

#[cfg(target_os = "none")]
#[rtic::app(device = nrf52840_hal::pac, peripherals = true)]
mod app {
    use cortex_m::peripheral::DWT;
    use defmt_rtt as _;
    use dpr_fw::{
        accept::Early,
        commit::{Commit, Committed, Frame, Images},
        link::Health,
        rf::{Executor, LEAD},
        ssi::{Asked, Budget, Windows, RECEIVE_BYTES},
        triple::{Exchange, Filling, Rotated, Rotation, Spent},
        watch::{Roll, Task},
        ImageMemory, ReceiveMemory, IMAGE_WORDS, RECEIVERS, RECEIVE_WORDS,
    };
    use nrf52840_hal::{
        pac::Interrupt,
        wdt::{handles::Hdl0, WatchdogHandle},
    };
    use profile::image::Image;
    use rtic::Mutex;
    use st25r3916::{
        listener::PAYLOAD_OFFSET, Fault, Listener, ListenerConfig, ListenerEvent, ReadMode, Short, Supply,
    };

    use crate::hw::{
        self, Deadline, Fresh, ImageBuffer, ReceiveBuffer, RfEdge, RfPort, SsiPort, DPR_TELEMETRY as TELEMETRY,
    };

    /// The NFC expansion boards are fed with 5 V from the DK.
    const LISTENER: ListenerConfig = ListenerConfig {
        supply: Supply::Volts5,
        read_mode: if cfg!(feature = "store-and-forward") { ReadMode::StoreAndForward } else { ReadMode::WhileFilling },
        ..ListenerConfig::new()
    };
    const IMAGE_LEN: usize = Image::<RECEIVERS>::LEN;

    static ROLL: Roll = Roll::new();

    /// What is told of a frame.
    #[derive(Clone, Copy)]
    pub struct FrameInfo {
        len: usize,
        ended_us: u32,
        early: Early,
    }

    /// What the RFID tasks, of the same priority, share.
    pub struct Receiving {
        executor: Executor<RfPort>,
        early: Early,
    }

    /// State of the RFID front end.
    #[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
    pub enum FrontEnd {
        /// Never listened yet.
        Starting,
        /// Configured and listening.
        Listening,
        /// Lost, for that reason; being brought up again.
        Lost(Fault),
    }

    /// What `commit` and `deadline`, of the same priority, share.
    pub struct Committing {
        commit: Commit<RECEIVERS>,
        filling: Option<Filling<ImageBuffer>>,
        fresh: Fresh,
        deadline: Deadline,
        started: bool,
        watchdog_reset: bool,
    }

    /// What `commit` and `ssi_end` hand over.
    pub struct Mailbox {
        exchange: Exchange<ImageBuffer>,
        /// FRESH has told of the newest image already.
        announced: bool,
    }

    #[shared]
    struct Shared {
        rotation: Rotation<ReceiveBuffer, FrameInfo>,
        mailbox: Mailbox,
        front_end: FrontEnd,
        #[lock_free]
        rf: Receiving,
        #[lock_free]
        committing: Committing,
    }

    #[local]
    struct Local {
        ssi: SsiPort,
        fresh: Fresh,
        windows: Windows<IMAGE_LEN>,
        budget: Budget,
        rf_edge: RfEdge,
        watchdog: Option<WatchdogHandle<Hdl0>>,
    }

    #[init(local = [
        receive: [ReceiveMemory; 3] = [[0; RECEIVE_WORDS]; 3],
        images: [ImageMemory; 3] = [[0; IMAGE_WORDS]; 3],
        spi_tx: [u8; Short::MAX] = [0; Short::MAX],
        spi_rx: [u8; Short::MAX] = [0; Short::MAX],
        ssi_rx: [u8; RECEIVE_BYTES] = [0; RECEIVE_BYTES],
    ])]
    fn init(cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let mut core = cx.core;
        let [first, second, third] = cx.local.receive;
        let (receive, rotation, found) = Rotation::new([first, second, third]);
        scrubbed(3, found.stuck_bits);
        let [first, second, third] = cx.local.images;
        let exchange = Exchange::new([first, second, third]);
        let memory = hw::Memory { spi_tx: cx.local.spi_tx, spi_rx: cx.local.spi_rx, ssi_rx: cx.local.ssi_rx };
        let board = hw::init(&mut core, cx.device, memory, receive);
        defmt::info!("DPR for {=usize} receivers; watchdog reset: {=bool}", RECEIVERS, board.watchdog_reset);
        // The first step of the bring-up; nothing else can have come yet.
        let mut executor = Executor::new(Listener::new(LISTENER), board.rf);
        let _ = executor.resume();
        let rf = Receiving { executor, early: Early::default() };
        // The first image, before anything is heard.
        rtic::pend(Interrupt::TIMER1);
        let committing = Committing {
            commit: Commit::new(),
            filling: None,
            fresh: board.fresh,
            deadline: board.deadline,
            started: false,
            watchdog_reset: board.watchdog_reset,
        };
        (
            Shared {
                rotation,
                mailbox: Mailbox { exchange, announced: false },
                front_end: FrontEnd::Starting,
                rf,
                committing,
            },
            Local {
                ssi: board.ssi,
                fresh: board.fresh,
                windows: Windows::new(),
                budget: Budget::new(),
                rf_edge: board.rf_edge,
                watchdog: board.watchdog,
            },
            init::Monotonics(),
        )
    }

    /// The lowest priority: logs changes and a summary each second, feeds the watchdog, sleeps.
    #[idle(local = [watchdog], shared = [front_end])]
    fn idle(mut cx: idle::Context) -> ! {
        let mut shown = FrontEnd::Starting;
        let mut last_us = hw::now_us();
        loop {
            if ROLL.complete() {
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
                // A statement each: logging masks interrupts, and two numbers take about 2 µs.
                defmt::info!(
                    "frames {=u32}, missed {=u32}",
                    TELEMETRY.frames_received.get(),
                    TELEMETRY.frames_missed.get()
                );
                defmt::info!(
                    "objects {=u32}, rejected {=u32}",
                    TELEMETRY.objects_accepted.get(),
                    TELEMETRY.objects_rejected.get()
                );
                defmt::info!(
                    "SSI {=u32}, violations {=u32}",
                    TELEMETRY.ssi_transactions.get(),
                    TELEMETRY.access_violations.get()
                );
            }
            cortex_m::asm::wfi();
        }
    }

    /// A transaction has ended, the buffers have come back for a newer image, or the scrub asks for a sign of life.
    #[task(binds = SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1, priority = 5, local = [ssi, fresh, windows, budget], shared = [mailbox])]
    fn ssi_end(mut cx: ssi_end::Context) {
        let start = DWT::cycle_count();
        let ssi_end::LocalResources { ssi, fresh, windows, budget } = cx.local;
        let (ours, received) = ssi.look();
        if let Some(mosi) = received {
            TELEMETRY.ssi_transactions.add(1);
            let violations = u32::from(windows.transaction(mosi) == Asked::Violation) + u32::from(budget.used());
            TELEMETRY.access_violations.add(violations);
        }
        if ours {
            let (newer, announced) = cx.shared.mailbox.lock(|mailbox| {
                let newer = ssi.exchange(|image| mailbox.exchange.take(image));
                (newer, core::mem::take(&mut mailbox.announced))
            });
            if newer {
                *budget = Budget::new();
            }
            if budget.is_left() && ssi.grant(windows.window()) && newer {
                if !announced {
                    fresh.pulse();
                }
                TELEMETRY.images_readable.add(1);
            }
        }
        ROLL.check_in(Task::Ssi);
        TELEMETRY.ssi_worst_cycles.at_least(DWT::cycle_count().wrapping_sub(start));
    }

    /// A transfer with the front end has ended.
    #[task(binds = SPIM0_SPIS0_TWIM0_TWIS0_SPI0_TWI0, priority = 4, shared = [rf, rotation, front_end])]
    fn rf_spi(cx: rf_spi::Context) {
        serve(cx.shared.rf, cx.shared.rotation, cx.shared.front_end);
    }

    /// The front end's IRQ has risen, or the scrub asks for a sign of life.
    #[task(binds = GPIOTE, priority = 4, local = [rf_edge], shared = [rf, rotation, front_end])]
    fn rf_irq(cx: rf_irq::Context) {
        cx.local.rf_edge.clear();
        serve(cx.shared.rf, cx.shared.rotation, cx.shared.front_end);
        ROLL.check_in(Task::Rf);
    }

    /// A wait of the front end's driver is over.
    #[task(binds = TIMER0, priority = 4, shared = [rf, rotation, front_end])]
    fn rf_timer(cx: rf_timer::Context) {
        serve(cx.shared.rf, cx.shared.rotation, cx.shared.front_end);
    }

    /// Carries the front end's driver as far as it goes. A frame goes to `commit`, and the driver on with a clean buffer. While a frame
    /// arrives, the objects that are complete are verified here, so that they are not in the way after its last bit.
    fn serve(
        rf: &mut Receiving,
        mut rotation: impl Mutex<T = Rotation<ReceiveBuffer, FrameInfo>>,
        mut front_end: impl Mutex<T = FrontEnd>,
    ) {
        let Receiving { executor, early } = rf;
        let mut event = executor.poll();
        while let Some(happened) = event {
            match happened {
                ListenerEvent::Frame { len, flags } => {
                    TELEMETRY.chip_crc_flags.add(u32::from(!flags.is_clean()));
                    let info = FrameInfo { len, ended_us: executor.irq_us(), early: *early };
                    executor.port().exchange(|filled| {
                        let (next, rotated) = rotation.lock(|rotation| rotation.rotate(filled, info));
                        if let Rotated::Overrun(found) = rotated {
                            TELEMETRY.overruns.add(1);
                            scrubbed(1, found.stuck_bits);
                        }
                        next
                    });
                    rtic::pend(Interrupt::SWI0_EGU0);
                }
                ListenerEvent::Listening => front_end.lock(|state| {
                    TELEMETRY.rf_recoveries.add(u32::from(*state != FrontEnd::Starting));
                    *state = FrontEnd::Listening;
                }),
                ListenerEvent::Fault(fault) => {
                    TELEMETRY.rf_faults.add(1);
                    front_end.lock(|state| *state = FrontEnd::Lost(fault));
                }
                ListenerEvent::Dropped(_) => TELEMETRY.rf_faults.add(1),
                ListenerEvent::FieldOn | ListenerEvent::FieldOff => {}
            }
            event = if matches!(happened, ListenerEvent::Frame { .. }) {
                executor.rest();
                None
            } else {
                executor.resume()
            };
        }
        if let Some(arrived) = executor.arrived() {
            early.follow::<RECEIVERS>(executor.port().arrived(arrived));
        }
    }

    /// A frame is in its buffer: verified, deposited, published.
    #[task(binds = SWI0_EGU0, priority = 3, shared = [committing, rotation, mailbox, front_end])]
    fn commit(cx: commit::Context) {
        let commit::SharedResources { committing, mut rotation, mailbox, front_end } = cx.shared;
        let start = DWT::cycle_count();
        let mut outbox = Outbox { mailbox, filling: &mut committing.filling, fresh: committing.fresh };
        let health = health(front_end, committing.watchdog_reset);
        while let Some(received) = rotation.lock(Rotation::read) {
            let FrameInfo { len, ended_us, early } = *received.about();
            let bytes: &[u8] = bytemuck::cast_slice(received.memory().as_slice());
            let payload = bytes.get(LEAD + PAYLOAD_OFFSET..LEAD + PAYLOAD_OFFSET + len).unwrap_or(&[]);
            let result =
                committing.commit.frame(Frame { payload, ended_us, early }, hw::now_us(), &health, &mut outbox);
            match result {
                Ok(Committed { published, deadline_us }) => {
                    let passed = hw::now_us().wrapping_sub(ended_us);
                    committing.deadline.restart(deadline_us.saturating_sub(passed));
                    if published > 0 {
                        TELEMETRY.rxe_to_publish_us.set(passed);
                        TELEMETRY.rxe_to_publish_worst_us.at_least(passed);
                    }
                }
                Err(_) => TELEMETRY.wrong_length.add(1),
            }
            rotation.lock(|rotation| rotation.done(received));
        }
        after_commit(&committing.commit, start);
    }

    /// No frame came in time: what was valid must not stay readable.
    #[task(binds = TIMER1, priority = 3, shared = [committing, rotation, mailbox, front_end])]
    fn deadline(cx: deadline::Context) {
        let deadline::SharedResources { committing, mut rotation, mailbox, front_end } = cx.shared;
        let start = DWT::cycle_count();
        let health = health(front_end, committing.watchdog_reset);
        let mut outbox = Outbox { mailbox, filling: &mut committing.filling, fresh: committing.fresh };
        if !core::mem::replace(&mut committing.started, true) {
            committing.commit.begin(hw::now_us(), &health, &mut outbox);
        } else if committing.deadline.passed() && !rotation.lock(|rotation| rotation.waiting()) {
            // Were a frame in its buffer already, it would have come in time: `commit` is pending then, and restarts the
            // deadline.
            let now_us = hw::now_us();
            let Committed { deadline_us, .. } = committing.commit.expired(now_us, &health, &mut outbox);
            committing.deadline.follow(deadline_us);
        } else {
            return;
        }
        after_commit(&committing.commit, start);
    }

    fn after_commit(commit: &Commit<RECEIVERS>, start: u32) {
        let [accepted, rejected, received, missed] = commit.link().counters();
        TELEMETRY.objects_accepted.set(accepted);
        TELEMETRY.objects_rejected.set(rejected);
        TELEMETRY.frames_received.set(received);
        TELEMETRY.frames_missed.set(missed);
        TELEMETRY.commit_worst_cycles.at_least(DWT::cycle_count().wrapping_sub(start));
        ROLL.check_in(Task::Commit);
        rtic::pend(Interrupt::SWI1_EGU1);
    }

    fn health(mut front_end: impl Mutex<T = FrontEnd>, watchdog_reset: bool) -> Health {
        Health {
            ram_fault: TELEMETRY.scrub_faults.get() > 0,
            front_end_fault: front_end.lock(|state| matches!(state, FrontEnd::Lost(_))),
            watchdog_reset,
            access_violations: TELEMETRY.access_violations.get(),
        }
    }

    /// Where `commit` puts images: into the mailbox of the SSI, which is told.
    struct Outbox<'a, M> {
        mailbox: M,
        filling: &'a mut Option<Filling<ImageBuffer>>,
        fresh: Fresh,
    }

    impl<M: Mutex<T = Mailbox>> Images for Outbox<'_, M> {
        fn filling(&mut self) -> &mut ImageMemory {
            let Self { mailbox, filling, .. } = self;
            filling
                .get_or_insert_with(|| {
                    let blank = mailbox.lock(|mailbox| mailbox.exchange.begin()).expect("of three images one is free");
                    let (filling, found) = blank.fill();
                    TELEMETRY.scrub_faults.add(found.stuck_bits);
                    filling
                })
                .memory()
        }

        /// If nobody is reading, the SSI interrupt puts the image in at once, and pulses FRESH when it has. During a transaction it does so at
        /// its end; but what the next transaction gets is settled now, so FRESH pulses now.
        fn publish(&mut self) {
            let Self { mailbox, filling, fresh } = self;
            if let Some(filled) = filling.take() {
                mailbox.lock(|mailbox| {
                    mailbox.exchange.publish(filled);
                    mailbox.announced = hw::request_ssi();
                    if mailbox.announced {
                        fresh.pulse();
                    }
                });
                TELEMETRY.publications.add(1);
            }
        }
    }

    /// Buffers were read or replaced: scrubs them, then asks the interrupts for their signs of life.
    #[task(binds = SWI1_EGU1, priority = 2, shared = [rotation, mailbox])]
    fn scrub(cx: scrub::Context) {
        let scrub::SharedResources { mut rotation, mut mailbox } = cx.shared;
        while let Some(spent) = rotation.lock(Rotation::dirty) {
            let (clean, found) = Spent::scrub(spent);
            scrubbed(1, found.stuck_bits);
            rotation.lock(|rotation| rotation.cleaned(clean));
        }
        while let Some(spent) = mailbox.lock(|mailbox| mailbox.exchange.dirty()) {
            let (clean, found) = Spent::scrub(spent);
            scrubbed(1, found.stuck_bits);
            mailbox.lock(|mailbox| mailbox.exchange.cleaned(clean));
        }
        ROLL.check_in(Task::Scrub);
        rtic::pend(Interrupt::GPIOTE);
        rtic::pend(Interrupt::SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1);
    }

    fn scrubbed(buffers: u32, stuck_bits: u32) {
        TELEMETRY.scrubs.add(buffers);
        TELEMETRY.scrub_faults.add(stuck_bits);
    }
}
