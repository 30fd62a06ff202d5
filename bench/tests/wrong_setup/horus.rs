//! Wrong setups of HORUS's registers by its program.

use super::*;

const HORUS_RUN: u64 = RAM_TEST + 250 * MS;

/// The observations of HORUS from outside during a run.
#[derive(Clone, Debug, Default)]
struct Sends {
    frames: Vec<u64>,
    air_ns: u64,
    /// For each receiver, the number of frames that had its valid position.
    valid: [usize; 3],
    ticks: Vec<u64>,
    field: bool,
    /// The numbers of UBX messages, bytes and errors on each line. HORUS drops the first message of the receiver on
    /// SPI.
    messages: [u32; 3],
    bytes: [u32; 3],
    errors: [u32; 3],
    skipped: u32,
    faults: u32,
    without_crystal: bool,
    log: String,
    restarts: Vec<Reset>,
}

impl Sends {
    fn watchdog(&self) -> bool {
        self.restarts.contains(&Reset::Watchdog("IWDG"))
    }
    fn period(&self) -> u64 {
        let [first, .., last] = self.ticks[..] else { return 0 };
        (last - first) / (self.ticks.len() as u64 - 1)
    }
}

/// Returns HORUS's board with three receivers that send their position every 20 ms.
fn horus() -> Option<&'static (Node<Horus>, Recording)> {
    static HORUS: OnceLock<Option<(Node<Horus>, Recording)>> = OnceLock::new();
    HORUS
        .get_or_init(|| {
            let node = boards::horus()?;
            let recording = Recording::of(&mut node.clone(), RAM_TEST + 30 * MS, |node| {
                node.board_mut(|board| board.front_end.take_air());
            });
            Some((node, recording))
        })
        .as_ref()
}

fn run_horus(changes: &[Change]) -> (Sends, Vec<String>) {
    let (node, recording) = horus().expect("an image");
    let mut node = node.clone();
    rewrite(&mut node, recording, changes).unwrap();
    let mut seen = Sends::default();
    let mut frame = vec![];
    let mut feed = RAM_TEST + 15 * MS;
    let mut epoch = 0;
    while node.now() < HORUS_RUN {
        node.advance(feed.min(HORUS_RUN));
        for (at, event) in node.board_mut(|board| board.front_end.take_air()) {
            match event {
                AirEvent::FieldOn => seen.field = true,
                AirEvent::FieldOff => {}
                AirEvent::FrameStart(start) => {
                    seen.frames.push(at);
                    frame = start.chunk.data;
                }
                AirEvent::Bytes(chunk) => frame.extend(&chunk.data),
                AirEvent::FrameEnd { .. } => {
                    seen.air_ns = at - seen.frames.last().unwrap();
                    let objects = frame.get(1 + ReportedPosition::SIZE..).unwrap_or_default();
                    for (index, bytes) in objects.as_chunks::<{ GpsObject::SIZE }>().0.iter().enumerate().take(3) {
                        let number = u16::try_from(index).unwrap() + 1;
                        let object = GpsObject::verify(bytes, Identifier(0x4800 + number));
                        seen.valid[index] +=
                            usize::from(object.is_ok_and(|object| object.values().status.position_valid()));
                    }
                }
            }
        }
        if node.now() >= feed {
            for index in 0..3 {
                let pvt = NavPvt {
                    itow_ms: 20 * epoch,
                    year: 2026,
                    month: 1,
                    day: 1,
                    valid: 7,
                    fix_type: 3,
                    flags: NavPvt::FLAG_FIX_OK,
                    satellites: 9,
                    horizontal_accuracy_mm: 1_200,
                    vertical_accuracy_mm: 2_000,
                    ..NavPvt::default()
                };
                node.board_mut(|board| board.say(feed, index, &pvt.encode()));
            }
            epoch += 1;
            feed += 20 * MS;
        }
    }
    let count = |offset| counter(&node, "HORUS_TELEMETRY", offset);
    for index in 0..3 {
        let line = std::mem::offset_of!(HorusTelemetry, lines) + index * size_of::<Line>();
        seen.messages[index] = count(line + std::mem::offset_of!(Line, messages));
        seen.bytes[index] = count(line + std::mem::offset_of!(Line, bytes));
        seen.errors[index] = count(line + std::mem::offset_of!(Line, uart_errors));
    }
    seen.skipped = count(std::mem::offset_of!(HorusTelemetry, frames_skipped));
    seen.faults = count(std::mem::offset_of!(HorusTelemetry, rf_faults));
    seen.without_crystal = count(std::mem::offset_of!(HorusTelemetry, without_crystal)) != 0;
    seen.ticks = node.board_mut(Horus::take_ticks);
    seen.log = node.take_log().iter().map(|line| format!("{line}\n")).collect();
    seen.restarts = node.resets().iter().map(|reset| reset.cause).collect();
    let mut told = words(node.take_findings());
    told.extend(node.board_mut(|board| board.receivers.take_misuses()).into_iter().map(|(_, words)| words));
    told.extend(node.board().front_end.chip().reports().iter().map(|report| format!("chip: {report}")));
    (seen, told)
}

const I2C2: u32 = 0x4000_5800;
const SPI5: u32 = 0x4001_5000;
const USART2: u32 = 0x4000_4400;
const SPI1: u32 = 0x4001_3000;
const SYSCFG: u32 = 0x4001_3800;
const EXTI: u32 = 0x4001_3C00;
const GPIOA: u32 = 0x4002_0000;
const GPIOD: u32 = 0x4002_0C00;
const RCC: u32 = 0x4002_3800;
const FLASH: u32 = 0x4002_3C00;
const DMA1_STREAM5: u32 = 0x4002_6088;
const DMA2_STREAM0: u32 = 0x4002_6410;
const DMA2_STREAM3: u32 = 0x4002_6458;
const TIM2: u32 = 0x4000_0000;
const TIM5: u32 = 0x4000_0C00;
const IWDG: u32 = 0x4000_3000;

fn first_receiver_alone_is_lost(seen: &Sends) -> bool {
    let [first, second, third] = seen.valid;
    first == 0 && second >= 20 && third >= 20 && seen.messages == [0, 11, 11] && on_time(seen)
}

fn on_time(seen: &Sends) -> bool {
    seen.frames.len() >= 23 && seen.ticks.len() >= 23 && seen.period() == 10 * MS && seen.restarts.is_empty()
}

/// Returns whether the front end is never used, the log gives `reason` for that, and the rest of the board works.
fn off_air_for(seen: &Sends, reason: &str) -> bool {
    off_air(seen, reason) && seen.messages[2] == 11
}

fn off_air(seen: &Sends, reason: &str) -> bool {
    seen.frames.is_empty()
        && !seen.field
        && seen.faults >= 5
        && seen.log.contains(&format!("WARN  radio: {reason}"))
        && seen.period() == 10 * MS
        && seen.restarts.is_empty()
}

const REFUSED: &str = "written without its clock";
const I2C_FREQUENCY: &str = "CR2.FREQ is not PCLK1's frequency";

const HORUS_ROWS: &[Row<Sends>] = &[
    row("USART2: half the baud rate", &[bits(USART2 + 8, 0xFFFF, 0x9C)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.errors[0] > 100
    }),
    row(
        "USART2: OVER8 with a divider for 16 samples",
        &[bits(USART2 + 0xC, 0x8000, 0x8000)],
        Expected::Nothing,
        |seen| first_receiver_alone_is_lost(seen) && seen.errors[0] > 100,
    ),
    // With nine bits in a character the UART takes the stop bit for the parity, and the next start bit for a stop bit.
    row("USART2: eight bits and parity", &[bits(USART2 + 0xC, 0x1400, 0x1400)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.errors[0] > 100
    }),
    row("USART2: receiver not enabled", &[bits(USART2 + 0xC, 4, 0)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 0
    }),
    // Without DMAR the UART reports no error (RM0090 30.6.6). The task finds an overrun at its check-in.
    row("USART2: no DMA requests", &[bits(USART2 + 0x14, 0x40, 0)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] >= 12
    }),
    row("USART2: no clock", &[gate(0x40, 17)], Expected::Finding(REFUSED), |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 0
    }),
    row(
        "PD6: alternate function 8",
        &[bits(GPIOD + 0x20, 0xF00_0000, 0x800_0000)],
        Expected::Finding("this pin has no such alternate function"),
        |seen| first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 0,
    ),
    row("DMA1 stream 5: channel 3", &[bits(DMA1_STREAM5, 7 << 25, 3 << 25)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] > 100
    }),
    // RXNE and the DMA request stay set. The ring therefore fills with zeros as fast as the DMA controller runs.
    row("DMA1 stream 5: towards the UART", &[bits(DMA1_STREAM5, 0xC0, 0x40)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] > 100_000 && seen.errors[0] > 100
    }),
    row("DMA1 stream 5: reads CR3 for DR", &[bits(DMA1_STREAM5 + 8, !0, USART2 + 0x14)], Expected::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] > 100_000 && seen.errors[0] > 100
    }),
    // The receiver's first byte causes an error of the DMA transfer. The firmware then restarts the ring.
    row(
        "DMA1 stream 5: ring in CCM RAM",
        &[bits(DMA1_STREAM5 + 0xC, !0, 0x1000_0000)],
        Expected::Finding("does not reach 0x10000000"),
        |seen| seen.errors == [1, 0, 0] && seen.messages == [11, 11, 11] && on_time(seen),
    ),
    row("DMA1: no clock", &[gate(0x30, 21)], Expected::Finding(REFUSED), |seen| {
        // DMA1 serves receivers 1 and 2.
        seen.valid[0] == 0 && seen.valid[1] == 0 && seen.valid[2] >= 20 && on_time(seen)
    }),
    row("I2C2: 667 kHz", &[bits(I2C2 + 0x1C, 0xFFF, 18)], Expected::Finding("more than 400 kHz"), |seen| {
        seen.valid[1] == 0 && seen.messages == [12, 0, 11] && on_time(seen)
    }),
    row("SPI5: clock divided by 16", &[bits(SPI5, 0x38, 0x18)], Expected::Finding("more than 125 kB/s"), |seen| {
        seen.valid[2] == 0 && seen.messages == [12, 11, 0] && on_time(seen)
    }),
    row("SPI5: mode 3", &[bits(SPI5, 3, 3)], Expected::Finding("not mode 0"), |seen| {
        seen.valid[2] == 0 && seen.messages == [12, 11, 0] && on_time(seen)
    }),
    row("SPI1: mode 0", &[bits(SPI1, 3, 0)], Expected::Finding("SPI mode 0"), |seen| off_air_for(seen, "Identity")),
    row("SPI1: mode 2", &[bits(SPI1, 3, 2)], Expected::Finding("SPI mode 2"), |seen| off_air_for(seen, "Identity")),
    row("SPI1: mode 3", &[bits(SPI1, 3, 3)], Expected::Finding("SPI mode 3"), |seen| off_air_for(seen, "Absent")),
    row("SPI1: least significant bit first", &[bits(SPI1, 0x80, 0x80)], Expected::Finding("chip:"), |seen| {
        off_air_for(seen, "Absent")
    }),
    row("SPI1: 16 bits", &[bits(SPI1, 0x800, 0x800)], Expected::Finding("chip:"), |seen| off_air_for(seen, "Identity")),
    // With SPI1 at 281 kHz a frame takes 7 ms to load, so its slot passes. The chip answers, so the firmware reports no
    // fault.
    row("SPI1: clock divided by 256", &[bits(SPI1, 0x38, 0x38)], Expected::Nothing, |seen| {
        seen.frames.is_empty() && seen.field && seen.skipped >= 23 && seen.faults == 0 && seen.log.contains("HORUS")
    }),
    row("SPI1: slave", &[bits(SPI1, 4, 0)], Expected::Finding("slave mode"), |seen| off_air_for(seen, "Bus")),
    // A mode fault switches off master mode and the SPI (RM0090 28.3.10).
    row("SPI1: not selected by software", &[bits(SPI1, 0x100, 0)], Expected::Nothing, |seen| off_air_for(seen, "Bus")),
    row("SPI1: not enabled", &[bits(SPI1, 0x40, 0)], Expected::Nothing, |seen| off_air_for(seen, "Bus")),
    row("SPI1: no clock", &[gate(0x44, 12)], Expected::Finding(REFUSED), |seen| off_air_for(seen, "Bus")),
    row("SCK: alternate function 0", &[bits(GPIOA + 0x20, 0xF0_0000, 0)], Expected::Nothing, |seen| {
        off_air_for(seen, "Absent")
    }),
    row("MOSI: input", &[bits(GPIOA, 0xC000, 0)], Expected::Finding("chip:"), |seen| off_air_for(seen, "Absent")),
    row("MISO: input", &[bits(GPIOA, 0x3000, 0)], Expected::Nothing, |seen| off_air_for(seen, "Absent")),
    row("chip select: input", &[bits(GPIOD, 0x3000_0000, 0)], Expected::Nothing, |seen| off_air_for(seen, "Absent")),
    row("GPIOA: no clock", &[gate(0x30, 0)], Expected::Finding(REFUSED), |seen| off_air_for(seen, "Absent")),
    // Two things fail with port D: the front end's chip select, and the line of the first receiver.
    row("GPIOD: no clock", &[gate(0x30, 3)], Expected::Finding(REFUSED), |seen| {
        off_air_for(seen, "Absent") && seen.bytes == [0, 1100, 1100]
    }),
    // The DMA transfer never completes, so the firmware's time limit ends it.
    row("DMA2 stream 0: channel 4", &[bits(DMA2_STREAM0, 7 << 25, 4 << 25)], Expected::Nothing, |seen| {
        off_air_for(seen, "Bus")
    }),
    row(
        "DMA2 stream 3: channel 4",
        &[bits(DMA2_STREAM3, 7 << 25, 4 << 25)],
        Expected::Finding("a stream's channel has no request"),
        |seen| off_air_for(seen, "Bus"),
    ),
    row("DMA2 stream 3: from the SPI", &[bits(DMA2_STREAM3, 0xC0, 0)], Expected::Nothing, |seen| {
        off_air_for(seen, "Bus")
    }),
    row("DMA2 stream 0: memory does not advance", &[bits(DMA2_STREAM0, 0x400, 0)], Expected::Nothing, |seen| {
        off_air_for(seen, "Absent")
    }),
    row(
        "DMA2 stream 3: sends from CCM RAM",
        &[bits(DMA2_STREAM3 + 0xC, !0, 0x1000_0000)],
        Expected::Finding("does not reach 0x10000000"),
        |seen| off_air_for(seen, "Bus"),
    ),
    row("DMA2: no clock", &[gate(0x30, 22)], Expected::Finding(REFUSED), |seen| {
        off_air(seen, "Bus") && seen.messages == [12, 11, 0]
    }),
    row("DMA2 stream 0: interrupt not enabled", &[never_iser(1, 0x0100_0000)], Expected::Nothing, |seen| {
        seen.frames.is_empty() && seen.watchdog()
    }),
    // Without the front end's interrupt, the firmware detects the start of the oscillator and the end of the first
    // frames only when its waits are over.
    row("EXTI3: from port D", &[bits(SYSCFG + 8, 0xF000, 0x3000)], Expected::Nothing, late_on_air),
    row("EXTI3: no rising edge", &[bits(EXTI + 8, 8, 0)], Expected::Nothing, late_on_air),
    row("EXTI3: masked", &[bits(EXTI, 8, 0)], Expected::Nothing, late_on_air),
    row("EXTI3: interrupt not enabled", &[never_iser(0, 0x200)], Expected::Nothing, Sends::watchdog),
    // Without the front end's interrupt and without TIM5, the firmware reads the IRQ pin's level only once per cycle,
    // at the tasks' check-in. Half of the frames are sent.
    row("EXTI3 masked, TIM5 without a clock", &[bits(EXTI, 8, 0), gate(0x40, 3)], Expected::Finding(REFUSED), |seen| {
        (1..=seen.ticks.len() / 2).contains(&seen.frames.len()) && seen.field && seen.faults == 0
    }),
    row("TIM5: no prescaler", &[bits(TIM5 + 0x28, 0xFFFF, 0)], Expected::Nothing, |seen| {
        off_air_for(seen, "Oscillator")
    }),
    row("TIM2: prescaler 2", &[bits(TIM2 + 0x28, 0xFFFF, 1)], Expected::Nothing, stops_out_of_order),
    row("TIM2: slot beyond the period", &[bits(TIM2 + 0x34, !0, 0xF_FFFF)], Expected::Nothing, stops_out_of_order),
    row("TIM2: no compare interrupt", &[bits(TIM2 + 0xC, 2, 0)], Expected::Nothing, stops_out_of_order),
    row("TIM2: no clock", &[gate(0x40, 0)], Expected::Finding(REFUSED), |seen| {
        seen.ticks.is_empty() && seen.frames.is_empty() && seen.watchdog()
    }),
    row("TIM2: interrupt not enabled", &[never_iser(0, 0x1000_0000)], Expected::Nothing, |seen| {
        !seen.ticks.is_empty() && seen.frames.is_empty() && seen.watchdog() && seen.log.contains("reset: watchdog")
    }),
    row("cycle's interrupt not enabled", &[never_iser(0, 0x10_0000)], Expected::Nothing, |seen| {
        !seen.ticks.is_empty() && seen.frames.is_empty() && seen.watchdog() && seen.log.contains("reset: watchdog")
    }),
    row("FLASH: no wait states", &[bits(FLASH, 0xF, 0)], Expected::Finding("too few wait states"), |seen| {
        seen.log.is_empty() && seen.ticks.is_empty() && !seen.field && seen.watchdog()
    }),
    row("FLASH: three wait states", &[bits(FLASH, 0xF, 3)], Expected::Finding("too few wait states"), |seen| {
        seen.log.is_empty() && seen.ticks.is_empty() && !seen.field && seen.watchdog()
    }),
    // With this PLL the UART has a wrong bit rate, and I2C is set up for another clock.
    row("PLL: 100 MHz", &[bits(RCC + 4, 0x7FC0, 100 << 6)], Expected::Finding(I2C_FREQUENCY), |seen| {
        // I2C and SPI have a clock line, so HORUS still reads the receivers on them. The last message may be on its
        // way.
        seen.period() == 14_400_000
            && seen.messages[0] == 0
            && seen.messages[1..].iter().all(|&messages| messages >= 10)
            && seen.errors[0] > 100
    }),
    row("PLL: input above 2 MHz", &[bits(RCC + 4, 0x3F, 3)], Expected::Finding("never locks"), |seen| {
        seen.log.is_empty() && seen.ticks.is_empty() && !seen.field && seen.watchdog()
    }),
    row("system clock left on HSI", &[bits(RCC + 8, 3, 0)], Expected::Finding(I2C_FREQUENCY), |seen| {
        seen.period() == 90 * MS && seen.messages[0] == 0 && seen.messages.iter().all(|&messages| messages < 6)
    }),
    row("HSE: not switched on", &[bits(RCC, 1 << 16, 0)], Expected::Nothing, |seen| {
        seen.without_crystal && seen.log.contains("the external clock is missing") && seen.period() == 10 * MS
    }),
    row("APB1: divided by 8", &[bits(RCC + 8, 0x1C00, 0x1800)], Expected::Finding(I2C_FREQUENCY), stops_out_of_order),
    row(
        "APB1: divided by 2",
        &[bits(RCC + 8, 0x1C00, 0x1000)],
        Expected::Finding("PCLK1 is faster"),
        stops_out_of_order,
    ),
    row("IWDG: never reloaded", &[instead(IWDG, 0xAAAA, 0)], Expected::Nothing, |seen| {
        seen.watchdog() && !seen.frames.is_empty() && seen.log.contains("reset: watchdog")
    }),
    // Without the interrupt of the timer HORUS does not poll the receivers 2 and 3.
    row(
        "IWDG: prescaler and reload stay locked, and TIM2's interrupt is not enabled",
        &[instead(IWDG, 0x5555, 0), never_iser(0, 0x1000_0000)],
        Expected::Finding("without the key 0x5555"),
        |seen| seen.frames.is_empty() && seen.restarts.is_empty() && seen.messages == [12, 0, 0],
    ),
    row(
        "IWDG: not started, and TIM2's interrupt is not enabled",
        &[instead(IWDG, 0xCCCC, 0), never_iser(0, 0x1000_0000)],
        Expected::Nothing,
        |seen| seen.frames.is_empty() && seen.restarts.is_empty() && seen.messages == [12, 0, 0],
    ),
];

/// Returns whether the field comes on two cycles late, and every later cycle has a frame.
fn late_on_air(seen: &Sends) -> bool {
    seen.frames.len() + 2 == seen.ticks.len() && seen.skipped == 2 && seen.faults == 0 && seen.messages == [12, 11, 11]
}

/// Returns whether HORUS finds by SysTick that a slot or tick is wrong, and stops until its watchdog resets it.
fn stops_out_of_order(seen: &Sends) -> bool {
    seen.watchdog() && seen.log.contains("task out of order (0x") && seen.log.contains("task slot")
}

#[test]
fn the_horus_image_set_up_wrongly_fails_as_silicon_would() {
    if horus().is_none() {
        return;
    }
    let (healthy, told) = run_horus(&[]);
    assert!(told.is_empty(), "{told:?}");
    assert!(HORUS_ROWS.len() >= 24);
    check(HORUS_ROWS, &healthy, run_horus);
}

#[test]
fn the_horus_image_patched_to_store_what_it_stores_anyway_works() {
    let Some((_, recording)) = horus() else { return };
    for (seen, row) in control(HORUS_ROWS, recording, run_horus).iter().zip(HORUS_ROWS) {
        let well = on_time(seen) && seen.valid.iter().all(|&frames| frames >= 20) && seen.errors == [0; 3];
        assert!(well && seen.faults == 0 && seen.skipped == 0, "{}: {seen:?}", row.what);
    }
}
