//! HORUS side firmware: STM32F429ZI (NUCLEO-F429ZI), cortex-m-rtic 1
//!
//! # Tasks
//!
//! | priority | task | vector | what arrives | deadline |
//! |---|---|---|---|---|
//! | 5 | `slot` | TIM2 | the tick; a frame's slot | fires the loaded frame: command byte at the SPI within 1 µs peak to peak of the same instant after every tick. Shares nothing, so no lock ever masks it |
//! | 4 | `rf_done` | DMA2 stream 0, 3 | an SPI transfer has ended | starts the next; the whole load ends before the slot |
//! | 4 | `rf_irq` | EXTI3 | the ST25R3916 has something to say | end of frame noted before the next tick |
//! | 4 | `rf_time` | TIM5 | a wait of the poller machine is over | none: late is harmless |
//! | 4 | `rf_slot` | CAN1_TX | a slot has passed (from `slot`) | before the frame's end, 1.9 ms |
//! | 3 | `cycle` | CAN1_RX0 | the tick (from `slot`) | profile filled, sealed and offered so early that its load ends before the slot (see `timing`) |
//! | 2 | `gnss*` | UARTs, their DMA | a line is idle, or half a ring is full | positions noted within half a ring, 5.5 ms |
//! | 1 | `parse` | CAN1_RX1 | bytes (from `gnss*`) | parsed within one cycle |
//! | 0 | `idle` | – | – | feeds the watchdog when all have checked in; logs when that delays nothing |
//!
//! The vectors of CAN1 belong to a peripheral that stays off; they are how a task of higher priority
//! calls one of lower priority without a queue, and so without a lock.
//!
//! No task waits for the SPI but for the end of one byte, and none allocates. A panic or a fault switches the
//! RF field off, says why, and leaves the rest to the watchdog.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod hw;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!(
        "this is firmware for the STM32F429ZI: build it with `cargo xtask build`, flash it with `cargo xtask flash horus`"
    );
    std::process::ExitCode::FAILURE
}

#[cfg(target_os = "none")]
mod panic {
    //! The safe state: field off, then the watchdog.
    use core::sync::atomic::{AtomicBool, Ordering};

    use cortex_m::asm;
    use cortex_m_rt::{exception, ExceptionFrame};

    use crate::hw;

    static SAFE: AtomicBool = AtomicBool::new(false);

    /// Switches the field off, logs once (a fault inside the logger must not log again), and waits for
    /// the watchdog.
    fn safe_state(log: impl FnOnce()) -> ! {
        cortex_m::interrupt::disable();
        hw::field_off();
        if !SAFE.swap(true, Ordering::Relaxed) {
            log();
        }
        loop {
            asm::nop();
        }
    }

    #[panic_handler]
    fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
        safe_state(|| defmt::error!("{}", defmt::Display2Format(info)))
    }

    // SAFETY: nothing of what was interrupted is used again: the handler does not return.
    #[exception]
    unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
        safe_state(|| defmt::error!("hard fault at {=u32:#x}, from {=u32:#x}", frame.pc(), frame.lr()))
    }

    // SAFETY: as for `HardFault`.
    #[exception]
    unsafe fn DefaultHandler(number: i16) -> ! {
        safe_state(|| defmt::error!("interrupt {=i16} has no task", number))
    }
}

#[cfg(target_os = "none")]
#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use cortex_m::peripheral::DWT;
    use defmt_rtt as _;
    use horus_tx_fw::{
        checkin::{CheckIn, Task},
        cycle::Cycle,
        receiver::{Receiver, Solution, BYTES_PER_CALL},
        ring::Reader,
        timing,
        transmitter::Transmitter,
        RECEIVERS,
    };
    use st25r3916::PollerConfig;
    use stm32f4xx_hal::{
        gpio::{Edge, PinState, Pull, Speed},
        pac::{self, Interrupt},
        prelude::*,
        rcc::{Config, Enable},
        watchdog::IndependentWatchdog,
    };

    use crate::hw::{self, settle, CycleEvent, CycleTimer, Ended, GnssLine, Radio, HORUS_TELEMETRY, RING};

    defmt::timestamp!("{=u32:ms}", hw::now_ms());

    /// Who has to be alive for the watchdog to be fed.
    static CHECK_IN: CheckIn = CheckIn::new();

    /// The watchdog's time, ms at the nominal 32 kHz; LSI runs at 17 to 47 kHz (DS9405), so 68 to 190 ms.
    const WATCHDOG_MS: u32 = 100;

    #[shared]
    struct Shared {
        transmitter: Transmitter<'static>,
        radio: Radio,
        solutions: [Solution; RECEIVERS],
        #[lock_free]
        lines: [GnssLine; RECEIVERS],
    }

    #[local]
    struct Local {
        timer: CycleTimer,
        cycle: Cycle,
        receivers: [Receiver; RECEIVERS],
        readers: [Reader; RECEIVERS],
        watchdog: IndependentWatchdog,
    }

    #[init]
    fn init(mut cx: init::Context) -> (Shared, Local, init::Monotonics) {
        let device = cx.device;

        // First of all: a clock that does not start, or anything after it, ends in a reset too.
        let mut watchdog = IndependentWatchdog::new(device.IWDG);
        watchdog.stop_on_debug(&device.DBGMCU, true);
        watchdog.start(WATCHDOG_MS.millis());
        hw::count_resets(&device.RCC);

        cx.core.DCB.enable_trace();
        cx.core.DWT.enable_cycle_counter();

        // HSE is the 8 MHz that the ST-LINK's MCO feeds into OSC_IN.
        let mut rcc = device.RCC.freeze(
            Config::hse(8.MHz())
                .bypass_hse_oscillator()
                .sysclk(timing::CORE_HZ.Hz())
                .hclk(timing::CORE_HZ.Hz())
                .pclk1(timing::APB1_HZ.Hz())
                .pclk2(timing::APB2_HZ.Hz()),
        );
        assert!(
            rcc.clocks.timclk1() == timing::TIMER_HZ.Hz::<1, 1>()
                && rcc.clocks.pclk1() == timing::APB1_HZ.Hz::<1, 1>()
                && rcc.clocks.pclk2() == timing::APB2_HZ.Hz::<1, 1>(),
            "the clock tree is not the one the timing was derived for"
        );
        pac::DMA1::enable(&mut rcc);
        pac::DMA2::enable(&mut rcc);
        pac::SPI1::enable(&mut rcc);
        pac::TIM2::enable(&mut rcc);
        pac::TIM5::enable(&mut rcc);

        let gpioa = device.GPIOA.split(&mut rcc);
        let gpioc = device.GPIOC.split(&mut rcc);
        let gpiod = device.GPIOD.split(&mut rcc);
        let gpioe = device.GPIOE.split(&mut rcc);

        // Radio: chip select is high before it is an output, the clock pad fast (erratum 2.12.4).
        gpiod.pd14.into_push_pull_output_in_state(PinState::High).speed(Speed::VeryHigh);
        gpioa.pa5.into_alternate::<5>().speed(Speed::VeryHigh);
        gpioa.pa6.into_alternate::<5>();
        gpioa.pa7.into_alternate::<5>().speed(Speed::VeryHigh);
        let mut syscfg = device.SYSCFG.constrain(&mut rcc);
        let mut exti = device.EXTI;
        let mut irq = gpioa.pa3.into_pull_down_input();
        irq.make_interrupt_source(&mut syscfg);
        irq.trigger_on_edge(&mut exti, Edge::Rising);
        irq.enable_interrupt(&mut exti);

        // Receivers: an open line reads idle.
        gpiod.pd6.into_alternate::<7>().internal_resistor(Pull::Up);
        pac::USART2::enable(&mut rcc);
        if RECEIVERS > 1 {
            gpioc.pc7.into_alternate::<8>().internal_resistor(Pull::Up);
            pac::USART6::enable(&mut rcc);
        }
        if RECEIVERS > 2 {
            gpioc.pc11.into_alternate::<8>().internal_resistor(Pull::Up);
            pac::UART4::enable(&mut rcc);
        }
        if RECEIVERS > 3 {
            gpiod.pd2.into_alternate::<8>().internal_resistor(Pull::Up);
            pac::UART5::enable(&mut rcc);
            gpioe.pe7.into_alternate::<8>().internal_resistor(Pull::Up);
            pac::UART7::enable(&mut rcc);
        }

        // The watchdog's prescaler and reload reach its own clock domain some LSI periods after they were
        // written (RM0090 "IWDG", status register); from here on it counts with them.
        watchdog.feed();

        let mut radio = Radio::new(device.SPI1, device.TIM5);
        let mut transmitter = Transmitter::new(PollerConfig::new(), &HORUS_TELEMETRY);
        transmitter.start(&mut radio);
        let mut timer = CycleTimer::new(device.TIM2);
        timer.start();
        defmt::info!(
            "HORUS: {=usize} receivers, slots {=[?]} us, {=u32} watchdog resets",
            RECEIVERS,
            timing::SLOT_US.as_slice(),
            HORUS_TELEMETRY.watchdog_resets.get()
        );
        (
            Shared { transmitter, radio, solutions: [Solution::default(); RECEIVERS], lines: GnssLine::all() },
            Local {
                timer,
                cycle: Cycle::new(),
                receivers: core::array::from_fn(|_| Receiver::new()),
                readers: [Reader::new(); RECEIVERS],
                watchdog,
            },
            init::Monotonics(),
        )
    }

    #[idle(local = [watchdog], shared = [transmitter])]
    fn idle(mut cx: idle::Context) -> ! {
        let mut reported = 0;
        let mut fault = None;
        loop {
            if CHECK_IN.complete() {
                cx.local.watchdog.feed();
            }
            fault = fault.or_else(|| cx.shared.transmitter.lock(Transmitter::take_fault));
            if let Some(what) = fault {
                if hw::when_quiet(|| defmt::warn!("radio: {}", what)) {
                    fault = None;
                }
            }
            let seconds = hw::tick() / 100;
            if seconds != reported {
                let t = &HORUS_TELEMETRY;
                if hw::when_quiet(|| {
                    defmt::info!(
                        "{=u32} sent, {=u32} skipped, {=u32} faults, fill {=u32} cycles",
                        t.frames_sent.get(),
                        t.frames_skipped.get(),
                        t.rf_faults.get(),
                        t.worst_fill_cycles.get()
                    );
                }) {
                    reported = seconds;
                }
            }
            rtic::export::wfi();
        }
    }

    #[task(binds = TIM2, priority = 5, local = [timer])]
    fn slot(cx: slot::Context) {
        match cx.local.timer.interrupt() {
            CycleEvent::Slot => rtic::pend(Interrupt::CAN1_TX),
            CycleEvent::Tick => rtic::pend(Interrupt::CAN1_RX0),
        }
        settle();
    }

    #[task(binds = DMA2_STREAM0, priority = 4, shared = [transmitter, radio])]
    fn rf_done(cx: rf_done::Context) {
        (cx.shared.transmitter, cx.shared.radio).lock(transfer_ended);
        settle();
    }

    #[task(binds = DMA2_STREAM3, priority = 4, shared = [transmitter, radio])]
    fn rf_failed(cx: rf_failed::Context) {
        (cx.shared.transmitter, cx.shared.radio).lock(transfer_ended);
        settle();
    }

    fn transfer_ended(transmitter: &mut Transmitter<'static>, radio: &mut Radio) {
        let mut response = [0; st25r3916::Short::MAX];
        match radio.ended() {
            Some(Ended::Done(bytes)) => {
                let (response, _) = response.split_at_mut(bytes.len());
                response.copy_from_slice(bytes);
                transmitter.done(response, radio);
            }
            Some(Ended::Failed) => transmitter.failed(radio),
            None => {}
        }
    }

    #[task(binds = EXTI3, priority = 4, shared = [transmitter, radio])]
    fn rf_irq(cx: rf_irq::Context) {
        (cx.shared.transmitter, cx.shared.radio).lock(|transmitter, radio| {
            radio.forget_edge();
            transmitter.edge(radio);
        });
        settle();
    }

    #[task(binds = TIM5, priority = 4, shared = [transmitter, radio])]
    fn rf_time(cx: rf_time::Context) {
        (cx.shared.transmitter, cx.shared.radio).lock(|transmitter, radio| {
            if radio.time_is_over() {
                transmitter.elapsed(radio);
            }
        });
        settle();
    }

    #[task(binds = CAN1_TX, priority = 4, shared = [transmitter, radio])]
    fn rf_slot(cx: rf_slot::Context) {
        if let Some(slot) = hw::take_slot() {
            (cx.shared.transmitter, cx.shared.radio).lock(|transmitter, radio| transmitter.slot(slot, radio));
        }
        CHECK_IN.here(Task::Rf);
        settle();
    }

    #[task(binds = CAN1_RX0, priority = 3, local = [cycle], shared = [transmitter, radio, solutions])]
    fn cycle(mut cx: cycle::Context) {
        let begun = DWT::cycle_count();
        let tick = hw::tick();
        let profile = cx.shared.solutions.lock(|solutions| cx.local.cycle.fill(tick, solutions));
        HORUS_TELEMETRY.worst_fill_cycles.worst(DWT::cycle_count().wrapping_sub(begun));
        (cx.shared.transmitter, cx.shared.radio).lock(|transmitter, radio| transmitter.offer(tick, &profile, radio));
        // Every line is looked at once a tick, so that an idle line that went unseen costs 10 ms at most.
        for stream in STREAMS.into_iter().take(RECEIVERS) {
            rtic::pend(stream);
        }
        hw::cycle_ended(tick);
        CHECK_IN.here(Task::Cycle);
        settle();
    }

    /// The vectors of the receivers' DMA streams, GPS1 to GPS5.
    const STREAMS: [Interrupt; profile::MAX_RECEIVERS] = [
        Interrupt::DMA1_STREAM5,
        Interrupt::DMA2_STREAM1,
        Interrupt::DMA1_STREAM2,
        Interrupt::DMA1_STREAM0,
        Interrupt::DMA1_STREAM3,
    ];

    fn uart(lines: &mut [GnssLine; RECEIVERS], index: usize) {
        if let Some(line) = lines.get_mut(index) {
            line.uart_interrupt();
        }
        rtic::pend(Interrupt::CAN1_RX1);
        settle();
    }

    fn stream(lines: &mut [GnssLine; RECEIVERS], index: usize) {
        if let Some(line) = lines.get_mut(index) {
            line.stream_interrupt();
        }
        rtic::pend(Interrupt::CAN1_RX1);
        settle();
    }

    #[task(binds = USART2, priority = 2, shared = [lines])]
    fn gnss1(cx: gnss1::Context) {
        uart(cx.shared.lines, 0);
    }
    #[task(binds = USART6, priority = 2, shared = [lines])]
    fn gnss2(cx: gnss2::Context) {
        uart(cx.shared.lines, 1);
    }
    #[task(binds = UART4, priority = 2, shared = [lines])]
    fn gnss3(cx: gnss3::Context) {
        uart(cx.shared.lines, 2);
    }
    #[task(binds = UART5, priority = 2, shared = [lines])]
    fn gnss4(cx: gnss4::Context) {
        uart(cx.shared.lines, 3);
    }
    #[task(binds = UART7, priority = 2, shared = [lines])]
    fn gnss5(cx: gnss5::Context) {
        uart(cx.shared.lines, 4);
    }
    #[task(binds = DMA1_STREAM5, priority = 2, shared = [lines])]
    fn gnss1_ring(cx: gnss1_ring::Context) {
        stream(cx.shared.lines, 0);
    }
    #[task(binds = DMA2_STREAM1, priority = 2, shared = [lines])]
    fn gnss2_ring(cx: gnss2_ring::Context) {
        stream(cx.shared.lines, 1);
    }
    #[task(binds = DMA1_STREAM2, priority = 2, shared = [lines])]
    fn gnss3_ring(cx: gnss3_ring::Context) {
        stream(cx.shared.lines, 2);
    }
    #[task(binds = DMA1_STREAM0, priority = 2, shared = [lines])]
    fn gnss4_ring(cx: gnss4_ring::Context) {
        stream(cx.shared.lines, 3);
    }
    #[task(binds = DMA1_STREAM3, priority = 2, shared = [lines])]
    fn gnss5_ring(cx: gnss5_ring::Context) {
        stream(cx.shared.lines, 4);
    }

    #[task(binds = CAN1_RX1, priority = 1, local = [receivers, readers], shared = [solutions])]
    fn parse(mut cx: parse::Context) {
        let mut more = false;
        let now = hw::now_ms();
        for (index, (receiver, reader)) in cx.local.receivers.iter_mut().zip(cx.local.readers.iter_mut()).enumerate() {
            let written = hw::written(index);
            let span = reader.take(written, RING, BYTES_PER_CALL);
            let mut bytes = [0; BYTES_PER_CALL];
            receiver.receive(hw::copy_out(index, span, &mut bytes), now);
            cx.shared.solutions.lock(|solutions| {
                if let Some(solution) = solutions.get_mut(index) {
                    *solution = *receiver.solution();
                }
            });
            more |= reader.waiting(written) > 0;

            let (line, counts) = (&HORUS_TELEMETRY.lines[index], receiver.counts());
            line.bytes.set(written);
            line.overruns.set(reader.lost());
            line.messages.set(counts.messages);
            line.damaged.set(counts.damaged);
            line.unusable.set(counts.unusable);
            line.skipped.set(counts.skipped());
        }
        if more {
            rtic::pend(Interrupt::CAN1_RX1);
        }
        CHECK_IN.here(Task::Gnss);
        settle();
    }
}
