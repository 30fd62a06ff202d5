//! The firmware of the HORUS side: STM32F429ZI (NUCLEO-F429ZI), cortex-m-rtic 1
//!
//! # Tasks
//!
//! The most urgent tasks come first. `build.rs` makes [`horus_tx_fw::task`]'s table from the tasks' attributes.
//!
//! | task | what calls it |
//! |---|---|
//! | NMI, in `hw::clock` | the external clock has failed |
//! | PVD, in `hw::supply` | the supply falls |
//! | `slot` | the tick; a frame's slot |
//! | `rf_spi`, `rf_spi_error` | an SPI transfer with the front end has ended, or failed |
//! | `rf_irq` | the ST25R3916's interrupt request |
//! | `rf_timer` | a wait of the front end's driver is over |
//! | `rf_slot` | a slot has passed (from `slot`) |
//! | `cycle` | the tick (from `slot`) |
//! | `vote` | a cycle's first slot (from `rf_slot`) |
//! | `gnss_tick` | a cycle's first slot (from `rf_slot`): every receiver's source is served |
//! | `gnss*` | an event of a receiver's source: see `hw::gnss` |
//! | `parse` | bytes of a receiver (from `gnss*`) |
//! | `idle` | nothing: it runs when no other task does |
//!
//! # Deadlines
//!
//! - `slot` fires the loaded frame: the command's byte is at the SPI at the same instant after every tick, within 1 µs
//!   peak to peak. The task shares nothing with other tasks, so no lock ever masks it.
//! - `rf_spi` starts the next SPI transfer; the load of a frame's head ends before the slot.
//! - `rf_irq` notes the end of a frame before the next tick.
//! - `rf_timer` has no deadline, because a late run does no harm.
//! - `rf_slot` runs before the frame's end, 1.9 ms after the slot at the earliest.
//! - `cycle` fills, seals and offers the profile early enough that the load ends before the slot (see `timing`).
//! - `vote` votes for the next tick and ends within the cycle. It begins after the slot, because it would delay the
//!   slot.
//! - `gnss*` reads a UART ring's position before another half of the ring is full, 5.5 ms. I2C and SPI have no
//!   deadline: I2C stretches its clock, SPI has its bytes in memory, and a transfer that has not ended by the next tick
//!   is ended as failed.
//! - `parse` parses within one cycle all bytes that have come.
//! - `idle` feeds the watchdog when all tasks have checked in, and logs when a message delays neither slot nor tick.
//!
//! CAN1 and CAN2 stay off. Their vectors let a task call one of lower priority without a queue and a lock.
//!
//! No task waits for the SPI except for the end of one byte, and no task allocates. A panic, a fault, a failing clock
//! and a changed program all end in the safe state: field off, the reason is logged, and the watchdog resets the part.
//!
//! # Start
//!
//! The order is: reset flags and watchdog (the first instructions, `hw::start_up`), test of the RAM, brown-out level,
//! oscillator, voltage detector, comparison of the program with its CRC, then front end, receivers and cycle. Before
//! the comparison of the program, the start changes nothing but the clocks. It changes the clocks first, because the
//! comparison takes 4 to 6 ms at 144 MHz. At the first 16 MHz it would take 40 ms of the watchdog's 68 ms at worst.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod hw;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "this is firmware for the STM32F429ZI: build it with `cargo xtask build`, and flash it with \
         `cargo xtask flash horus`"
    );
    std::process::ExitCode::FAILURE
}

#[cfg(target_os = "none")]
#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use cortex_m::{asm, peripheral::DWT};
    use defmt_rtt as _;
    use firmware_common::{
        check_in::CheckIn,
        checked::Checked,
        flow::Flow,
        last_stop::{self, Cause, Stop},
        mpu,
        patrol::{self, PartMemory, Patrol},
        program, safe_state, start_test,
    };
    use horus_tx_fw::{
        configuration::{self, Configuration},
        cycle::{Cycle, Start},
        flow::Step,
        idle::{Journal, Message, Slices},
        integrity, protection,
        receiver::{Receiver, Solution, BYTES_PER_CALL},
        reset,
        ring::Reader,
        source::{Vector, RING},
        state_inputs::{Levels, INPUTS},
        supply,
        task::Task,
        timing,
        transmitter::Transmitter,
        RECEIVERS,
    };
    use st25r3916::PollerConfig;
    use stm32f4xx_hal::watchdog::IndependentWatchdog;

    use crate::{
        board::{self, source_of},
        hw::{
            self, buffers,
            cycle_timer::{self, CycleEvent, CycleTimer},
            gnss::{self, GnssLine},
            radio::Radio,
            settle, state_inputs, HORUS_TELEMETRY,
        },
    };

    defmt::timestamp!("{=u32:ms}", cycle_timer::now_ms());

    static CHECK_IN: CheckIn<Task> = CheckIn::new();

    static FLOW: Flow<Step> = Flow::new();

    #[shared]
    struct Shared {
        transmitter: Transmitter<'static, Radio>,
        solutions: [Checked<Solution>; RECEIVERS],
        #[lock_free]
        cycle: Checked<Cycle<RECEIVERS>>,
        /// The levels of the state inputs at the tick, until the vote takes them.
        #[lock_free]
        levels: Option<[Levels; INPUTS]>,
        #[lock_free]
        lines: [Checked<GnssLine>; RECEIVERS],
    }

    #[local]
    struct Local {
        timer: CycleTimer,
        receivers: [Checked<(Receiver, Reader)>; RECEIVERS],
        configurations: [Configuration; RECEIVERS],
        watchdog: IndependentWatchdog,
        patrol: Patrol,
        memory: PartMemory,
    }

    #[init]
    fn init(mut cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let mut device = cx.device;

        // The watchdog has been running since the first instructions (`hw::start_up`). DBGMCU's bits, which stop it
        // under a debugger, are set at each start, because only power-on clears them.
        let mut watchdog = IndependentWatchdog::new(device.IWDG);
        watchdog.stop_on_debug(&device.DBGMCU, cfg!(feature = "debugger-stops-watchdog"));
        // The watchdog is fed once its reload value has arrived, so that it counts from that value.
        asm::delay(timing::WATCHDOG_UPDATE_CYCLES);
        watchdog.feed();
        let reason = hw::reset::note_reason();

        cx.core.DCB.enable_trace();
        cx.core.DWT.enable_cycle_counter();

        // The clock of the cycle timer is switched on early, so that log messages have a time even if the start fails.
        cycle_timer::enable_clock(&mut device.RCC);
        // The record of the last stop is read before the clocks are set up, because that set-up writes a record of its
        // own.
        let stopped = last_stop::take();
        HORUS_TELEMETRY.last_stop.set(last_stop::code());
        // The brown-out level is checked before the clocks are set up. At 144 MHz only the brown-out reset prevents
        // wrong reads of instructions while the supply falls.
        let level = hw::supply::brown_out_level();
        // Not covered: another brown-out level in the option bytes: `cargo xtask flash` sets it, and no fault of the
        // bench changes option bytes.
        if level != supply::BROWN_OUT_LEVEL {
            let stop = Stop::new(Cause::BrownOutLevel, 0, level);
            safe_state::enter(
                hw::safe_state,
                || stop,
                |stop| {
                    hw::log_stop("flash HORUS by `cargo xtask flash horus`, which sets the brown-out level", stop);
                },
            );
        }
        // Not covered: only this line, a clock that differs, as in `hw/clock.rs`.
        let (mut rcc, clock) = hw::clock::start(device.RCC);
        if hw::supply::watch(&mut rcc) {
            hw::supply::stop();
        }

        // Not covered: only this line, no test: the first instructions of each start make it.
        if let Some(address) = start_test::take().fault() {
            let stop = Stop::new(Cause::Ram, 0, address);
            safe_state::enter(hw::safe_state, || stop, |stop| hw::log_stop("memory", stop));
        }
        let found = program::compare();
        if !found.is_intact() {
            safe_state::enter(
                hw::safe_state,
                || Stop::new(Cause::Flash, 0, found.computed),
                |_| {
                    defmt::error!(
                        "the image in flash has the CRC {=u32:#010x}, but was built with {=u32:#010x}",
                        found.computed,
                        found.expected
                    );
                },
            );
        }

        safe_state::name_faults(&mut cx.core.SCB);
        mpu::apply(&mut cx.core.MPU, &protection::START);

        watchdog.feed();

        let radio = Radio::new(&mut rcc, device.SPI1, device.TIM5, device.SYSCFG, &device.EXTI);
        state_inputs::set_up();
        let lines = GnssLine::all(&mut rcc).map(Checked::new);
        let transmitter = Transmitter::start(PollerConfig::new(), &HORUS_TELEMETRY, radio);
        let mut timer = CycleTimer::new(device.TIM2);
        timer.start(&mut cx.core.SYST);
        defmt::info!(
            "HORUS: {=usize} receivers, slots {=[?]} us, {=u32} watchdog resets, last reset: {=str}",
            RECEIVERS,
            timing::SLOT_US.as_slice(),
            HORUS_TELEMETRY.watchdog_resets.get(),
            reset::name(reason)
        );
        let excluded = hw::reset::kept_exclusions(reason);
        let mut cycle = Cycle::after(Start { clock, reason, excluded });
        if let Some(stop) = stopped {
            hw::log_stop("the last stop", &stop);
            if stop.cause.is_memory_fault() {
                cycle.found_memory_fault();
            }
        }
        if HORUS_TELEMETRY.without_crystal.get() != 0 {
            defmt::warn!("the external clock is missing: running on the internal oscillator");
        }
        let mut memory = PartMemory::take();
        // The patrol can read the whole program: flash does not begin at address 0, so the memory protection shuts no
        // part of it.
        let layout = patrol::layout(0, hw::shared_memory());
        let patrol = Patrol::new(layout, integrity::RATE, &mut memory);
        mpu::apply(&mut cx.core.MPU, &protection::TASKS);
        (
            Shared {
                transmitter,
                solutions: core::array::from_fn(|_| Checked::new(Solution::default())),
                cycle: Checked::new(cycle),
                levels: None,
                lines,
            },
            Local {
                timer,
                receivers: core::array::from_fn(|_| Checked::new((Receiver::new(), Reader::new()))),
                configurations: core::array::from_fn(gnss::configuration),
                watchdog,
                patrol,
                memory,
            },
            init::Monotonics(),
        )
    }

    #[idle(local = [watchdog, patrol, memory], shared = [transmitter])]
    fn idle(mut cx: idle::Context) -> ! {
        let mut journal = Journal::new();
        // Not covered: a tick that ends between the two readings of the time, in this copy of `now_ms`: one in
        // thousands of calls meets it, and the tests of `timing` have all orders.
        let now_us = || cycle_timer::now_ms().wrapping_mul(1_000);
        let mut slices = Slices::new(now_us());
        loop {
            if CHECK_IN.complete() {
                cx.local.watchdog.feed();
            }
            // Most interrupts that wake the processor leave no work for the idle loop, so the cheap query comes first.
            if !slices.are_due(now_us()) || !cycle_timer::is_quiet() {
                rtic::export::wfi();
                continue;
            }
            while slices.take(cycle_timer::is_quiet) {
                let slice = cx.local.patrol.slice(cx.local.memory);
                if let Some((cause, detail)) = integrity::judge(&slice, &HORUS_TELEMETRY) {
                    stop("memory", Stop::new(cause, 0, detail));
                }
            }
            let take_fault = || cx.shared.transmitter.lock(Transmitter::take_fault);
            let second = cycle_timer::tick() / 100;
            // Not covered: a message that waits, since the quiet part ends within the few instructions since the loop
            // asked for it; findings that no run has; and the copies for other priorities in the lock.
            journal.write(take_fault, second, &HORUS_TELEMETRY, |message| cycle_timer::when_quiet(|| log(message)));
        }
    }

    fn log(message: Message) {
        match message {
            Message::Radio(fault) => defmt::warn!("radio: {}", fault),
            Message::Configuration { receiver, standing } => {
                defmt::info!("GPS{=usize}: {=str}", receiver + 1, configuration::name(standing));
            }
            Message::Second => {
                let t = &HORUS_TELEMETRY;
                defmt::info!(
                    "{=u32} sent, {=u32} skipped, {=u32} faults, fill {=u32} cycles",
                    t.frames_sent.get(),
                    t.frames_skipped.get(),
                    t.rf_faults.get(),
                    t.worst_fill_cycles.get()
                );
            }
            Message::Bus { receiver, recoveries, timed_out } => {
                defmt::warn!("GPS{=usize}: {=u32} recoveries, {=u32} timed out", receiver + 1, recoveries, timed_out);
            }
        }
    }

    /// Records that a step of the cycle begins. HORUS stops if another step should come first. A debugger that halts
    /// the processor delays steps, so the order counts only where the watchdog runs on.
    #[inline(always)]
    fn begin(step: Step) {
        if !FLOW.begin(step, cycle_timer::counter) && !cfg!(feature = "debugger-stops-watchdog") {
            stop_out_of_order(step);
        }
    }

    fn stop_out_of_order(step: Step) -> ! {
        stop("flow", Stop::new(Cause::Flow, safe_state::active_exception(), step as u32))
    }

    /// Verifies the checked state `kept`, changes it by `with`, and computes its check word anew. HORUS stops if a bit
    /// of the state has flipped.
    fn change<T, R>(kept: &mut Checked<T>, with: impl FnOnce(&mut T) -> R) -> R {
        match kept.change(with) {
            Some(result) => result,
            None => stop_changed(kept.address()),
        }
    }

    /// Returns the number of the tick. HORUS stops if the last vote was for another tick: the count of ticks was then
    /// damaged, because each cycle votes once for the next tick. Only a debugger that halts the processor makes HORUS
    /// leave out cycles.
    fn tick_of(cycle: &Checked<Cycle<RECEIVERS>>) -> u32 {
        let tick = cycle_timer::tick();
        if !cycle.get().has_voted_for(tick) && !cfg!(feature = "debugger-stops-watchdog") {
            stop_changed(cycle.address());
        }
        tick
    }

    fn stop_changed(address: u32) -> ! {
        stop("kept state", Stop::new(Cause::Ram, safe_state::active_exception(), address))
    }

    #[cold]
    #[inline(never)]
    fn stop(what: &'static str, stop: Stop) -> ! {
        safe_state::enter(hw::safe_state, || stop, |stop| hw::log_stop(what, stop))
    }

    #[task(binds = TIM2, priority = 5, local = [timer])]
    fn slot(cx: slot::Context) {
        match cx.local.timer.interrupt() {
            CycleEvent::Slot(frame) => {
                begin(Step::slot(frame));
                board::call(Task::rf_slot);
            }
            CycleEvent::Tick => {
                begin(Step::Tick);
                board::call(Task::cycle);
            }
        }
        CHECK_IN.check_in(Task::slot);
        settle();
    }

    #[task(binds = DMA2_STREAM0, priority = 4, shared = [transmitter])]
    fn rf_spi(mut cx: rf_spi::Context) {
        cx.shared.transmitter.lock(Transmitter::poll);
        CHECK_IN.check_in(Task::rf_spi);
        settle();
    }

    #[task(binds = DMA2_STREAM3, priority = 4, shared = [transmitter])]
    fn rf_spi_error(mut cx: rf_spi_error::Context) {
        cx.shared.transmitter.lock(Transmitter::poll);
        CHECK_IN.check_in(Task::rf_spi_error);
        settle();
    }

    #[task(binds = EXTI3, priority = 4, shared = [transmitter])]
    fn rf_irq(mut cx: rf_irq::Context) {
        cx.shared.transmitter.lock(|transmitter| {
            transmitter.port().clear_pending_irq();
            transmitter.poll();
        });
        CHECK_IN.check_in(Task::rf_irq);
        settle();
    }

    #[task(binds = TIM5, priority = 4, shared = [transmitter])]
    fn rf_timer(mut cx: rf_timer::Context) {
        cx.shared.transmitter.lock(|transmitter| {
            transmitter.port().clear_pending_timer();
            transmitter.poll();
        });
        CHECK_IN.check_in(Task::rf_timer);
        settle();
    }

    #[task(binds = CAN1_TX, priority = 4, shared = [transmitter])]
    fn rf_slot(mut cx: rf_slot::Context) {
        let slot = cycle_timer::take_slot();
        // Not covered: a second frame of the cycle, which three receivers do not have.
        begin(Step::rf_slot(slot.as_ref().map_or(0, |slot| slot.frame)));
        // Not covered: only this line, no slot: then `begin` has stopped HORUS.
        if let Some(slot) = slot {
            // Not covered: only this line, a second frame of the cycle, which three receivers do not have.
            if slot.frame == 0 {
                // The vote and the receivers' tick are called only after the slot. Before it, a division or a slow bus
                // access of theirs would delay the slot's interrupt.
                board::call(Task::vote);
                board::call(Task::gnss_tick);
            }
            // Not covered: only this line, in the path of a second frame, as above.
            cx.shared.transmitter.lock(|transmitter| transmitter.slot(slot));
        }
        CHECK_IN.check_in(Task::rf_slot);
        settle();
    }

    #[task(binds = CAN1_RX0, priority = 3, shared = [cycle, levels, transmitter, solutions])]
    fn cycle(mut cx: cycle::Context) {
        let begun = DWT::cycle_count();
        begin(Step::Cycle);
        let tick = tick_of(cx.shared.cycle);
        *cx.shared.levels = Some(state_inputs::levels());
        // There is no time to verify solutions and vote before the slot. `vote` verifies both while the frame is on
        // air.
        let profile = cx.shared.solutions.lock(|solutions| cx.shared.cycle.get().fill(tick, solutions));
        HORUS_TELEMETRY.worst_fill_cycles.record_max(DWT::cycle_count().wrapping_sub(begun));
        // Not covered: a frame that keeps its bytes from being replaced, as in `Transmitter::offer`.
        cx.shared.transmitter.lock(|transmitter| transmitter.offer(tick, &profile));
        CHECK_IN.check_in(Task::cycle);
        settle();
    }

    #[task(binds = CAN2_RX0, priority = 3, shared = [cycle, levels, solutions])]
    fn vote(mut cx: vote::Context) {
        begin(Step::Vote);
        let tick = tick_of(cx.shared.cycle);
        let levels = cx.shared.levels.take();
        let excluded = cx.shared.solutions.lock(|solutions| {
            if let Some(changed) = solutions.iter().find(|solution| !solution.is_intact()) {
                stop_changed(changed.address());
            }
            change(cx.shared.cycle, |cycle| {
                if let Some(levels) = levels {
                    cycle.sample(levels);
                }
                cycle.vote(tick.wrapping_add(1), solutions);
                cycle.excluded()
            })
        });
        hw::reset::keep_exclusions(excluded);
        cycle_timer::cycle_ended(tick);
        CHECK_IN.check_in(Task::vote);
        settle();
    }

    #[task(binds = CAN2_TX, priority = 2, shared = [lines])]
    fn gnss_tick(cx: gnss_tick::Context) {
        begin(Step::GnssTick);
        for line in cx.shared.lines {
            change(line, GnssLine::poll);
        }
        board::call(Task::parse);
        board::ask_for_signs_of_life();
        CHECK_IN.check_in(Task::gnss_tick);
        settle();
    }

    fn serve(task: Task, lines: &mut [Checked<GnssLine>; RECEIVERS], (index, vector): (usize, Vector)) {
        if let Some(line) = lines.get_mut(index) {
            // A bus has some 20 interrupts a cycle, all within a short time after the tick, which verifies its state.
            let serve = |line: &mut GnssLine| line.interrupt(vector);
            let have_come = if line.get().is_bus() { line.change_verified(serve) } else { change(line, serve) };
            if have_come {
                board::call(Task::parse);
            }
        }
        CHECK_IN.check_in(task);
        settle();
    }

    // There is a task for each vector of each row of `board::RECEIVER_PORTS`; a vector in no row does not compile.

    #[task(binds = USART2, priority = 2, shared = [lines])]
    fn gnss1(cx: gnss1::Context) {
        serve(Task::gnss1, cx.shared.lines, const { source_of(Task::gnss1) });
    }
    #[task(binds = DMA1_STREAM5, priority = 2, shared = [lines])]
    fn gnss1_ring(cx: gnss1_ring::Context) {
        serve(Task::gnss1_ring, cx.shared.lines, const { source_of(Task::gnss1_ring) });
    }
    #[task(binds = I2C2_EV, priority = 2, shared = [lines])]
    fn gnss2(cx: gnss2::Context) {
        serve(Task::gnss2, cx.shared.lines, const { source_of(Task::gnss2) });
    }
    #[task(binds = I2C2_ER, priority = 2, shared = [lines])]
    fn gnss2_error(cx: gnss2_error::Context) {
        serve(Task::gnss2_error, cx.shared.lines, const { source_of(Task::gnss2_error) });
    }
    #[task(binds = DMA1_STREAM2, priority = 2, shared = [lines])]
    fn gnss2_read(cx: gnss2_read::Context) {
        serve(Task::gnss2_read, cx.shared.lines, const { source_of(Task::gnss2_read) });
    }
    #[task(binds = TIM4, priority = 2, shared = [lines])]
    fn gnss2_step(cx: gnss2_step::Context) {
        serve(Task::gnss2_step, cx.shared.lines, const { source_of(Task::gnss2_step) });
    }
    #[task(binds = DMA2_STREAM5, priority = 2, shared = [lines])]
    fn gnss3(cx: gnss3::Context) {
        serve(Task::gnss3, cx.shared.lines, const { source_of(Task::gnss3) });
    }
    #[task(binds = DMA2_STREAM6, priority = 2, shared = [lines])]
    fn gnss3_error(cx: gnss3_error::Context) {
        serve(Task::gnss3_error, cx.shared.lines, const { source_of(Task::gnss3_error) });
    }
    #[task(binds = TIM3, priority = 2, shared = [lines])]
    fn gnss3_step(cx: gnss3_step::Context) {
        serve(Task::gnss3_step, cx.shared.lines, const { source_of(Task::gnss3_step) });
    }
    #[task(binds = UART5, priority = 2, shared = [lines])]
    fn gnss4(cx: gnss4::Context) {
        serve(Task::gnss4, cx.shared.lines, const { source_of(Task::gnss4) });
    }
    #[task(binds = DMA1_STREAM0, priority = 2, shared = [lines])]
    fn gnss4_ring(cx: gnss4_ring::Context) {
        serve(Task::gnss4_ring, cx.shared.lines, const { source_of(Task::gnss4_ring) });
    }
    #[task(binds = UART7, priority = 2, shared = [lines])]
    fn gnss5(cx: gnss5::Context) {
        serve(Task::gnss5, cx.shared.lines, const { source_of(Task::gnss5) });
    }
    #[task(binds = DMA1_STREAM3, priority = 2, shared = [lines])]
    fn gnss5_ring(cx: gnss5_ring::Context) {
        serve(Task::gnss5_ring, cx.shared.lines, const { source_of(Task::gnss5_ring) });
    }

    #[task(binds = CAN1_RX1, priority = 1, local = [receivers, configurations], shared = [solutions])]
    fn parse(mut cx: parse::Context) {
        let mut more = false;
        // Not covered: a tick that ends between the two readings of the time, as in `idle`.
        let now = cycle_timer::now_ms();
        for (index, kept) in cx.local.receivers.iter_mut().enumerate() {
            let ring = buffers::ring(index);
            let Some(written) = ring.written() else { stop_changed(ring.address()) };
            let (receiver, reader) = kept.get();
            let mut answer = None;
            // In most calls most receivers have sent nothing new. Their states then need no verification.
            if reader.waiting(written) > 0 || receiver.is_due(now) || kept.is_unchanged() {
                answer = change(kept, |(receiver, reader)| {
                    let span = reader.take(written, RING, BYTES_PER_CALL);
                    let mut bytes = [0; BYTES_PER_CALL];
                    receiver.receive(ring.copy_out(span, &mut bytes), now);
                    receiver.take_answer()
                });
                cx.shared.solutions.lock(|solutions| {
                    if let Some(solution) = solutions.get_mut(index) {
                        solution.set(*kept.get().0.solution());
                    }
                });
            }
            let (receiver, reader) = kept.get();
            more |= reader.waiting(written) > 0;

            let (line, counts) = (&HORUS_TELEMETRY.lines[index], receiver.counts());
            line.bytes.set(written);
            line.overruns.set(reader.lost());
            line.messages.set(counts.messages);
            line.damaged.set(counts.damaged);
            line.unusable.set(counts.unusable);
            line.skipped.set(counts.skipped());

            let configuration = &mut cx.local.configurations[index];
            if let Some(message) = configuration.poll(now, counts.messages, answer) {
                // A message that finds the outbox full gets no answer, and is therefore sent again.
                buffers::outbox(index).put(&message);
            }
            HORUS_TELEMETRY.sources[index].configuration.set(configuration.standing() as u32);
        }
        if more {
            board::call(Task::parse);
        }
        CHECK_IN.check_in(Task::parse);
        settle();
    }
}
