//! Boards that are set up wrongly on purpose: both release images, patched in flash, fail the way silicon would.
//!
//! Each row changes what the firmware writes to one register (see [`patch`]) and says what is seen of it from outside:
//! on the air, on the SSI, in the log, in the telemetry, by a restart. The same must not be seen of the image as it was
//! built. A row also says what the models have to report of it; where silicon would be silent, so must they be.

mod boards;
mod patch;
mod reader;

use std::fmt::Debug;
use std::sync::OnceLock;

use bench::engine::{Finding, Node};
use bench::sim::boards::{Dpr, Horus};
use bench_seam::Reset;
use boards::counter;
use dpr_fw::telemetry::Telemetry as DprTelemetry;
use gnss_sim::ubx::NavPvt;
use horus_tx_fw::telemetry::{Line, Telemetry as HorusTelemetry};
use patch::{Change, Recording, To};
use profile::{GpsObject, Identifier, ReportedPosition};
use reader::{MS, US, View, field_on, payload, send, view};
use st25r3916_model::AirEvent;

// ---- what is changed

/// The bits of `mask` are `value` whenever the image stores to `address`.
const fn bits(address: u32, mask: u32, value: u32) -> Change {
    Change { address, to: To::Bits { mask, value } }
}

/// The image stores `value` where it would store `of`.
const fn instead(address: u32, of: u32, value: u32) -> Change {
    Change { address, to: To::Instead { of, value } }
}

/// The image never stores to `address`.
const fn never(address: u32) -> Change {
    Change { address, to: To::Nothing }
}

/// The bit-band alias by which the image sets bit `bit` of the STM32's RCC at `offset` (ARMv7-M ARM B3.1.1).
const fn gate(offset: u32, bit: u32) -> Change {
    never(0x4247_0000 + 32 * offset + 4 * bit)
}

/// What must be reported of a wrong set-up.
#[derive(Clone, Copy, Debug)]
enum Told {
    /// Nothing: silicon has no way to tell.
    Nothing,
    /// A finding whose words hold this.
    Finding(&'static str),
}

/// One wrong set-up.
struct Row<S> {
    what: &'static str,
    changes: &'static [Change],
    seen: fn(&S) -> bool,
    told: Told,
}

const fn row<S>(what: &'static str, changes: &'static [Change], told: Told, seen: fn(&S) -> bool) -> Row<S> {
    Row { what, changes, seen, told }
}

/// Runs every row of `rows` on a clone of `board`, patched, and demands of each what it says.
fn check<S: Debug>(rows: &[Row<S>], healthy: &S, run: impl Fn(&[Change]) -> (S, Vec<String>)) {
    let mut wrong = vec![];
    for row in rows {
        let (seen, told) = run(row.changes);
        let mut say = |why: &str| wrong.push(format!("{}: {why}\n  {seen:?}\n  {told:#?}", row.what));
        if (row.seen)(healthy) {
            say("the image as it was built shows the same");
        }
        if !(row.seen)(&seen) {
            say("not seen");
        }
        match row.told {
            Told::Nothing if !told.is_empty() => say("silicon would not tell"),
            Told::Finding(words) if !told.iter().any(|text| text.contains(words)) => say("no such finding"),
            _ => {}
        }
    }
    assert!(wrong.is_empty(), "{} of {} rows:\n{}", wrong.len(), rows.len(), wrong.join("\n"));
}

/// For every row the same patch, but with each value stored as it was: what is seen must not hang on the stubs.
fn control<S: Debug>(rows: &[Row<S>], recording: &Recording, run: impl Fn(&[Change]) -> (S, Vec<String>)) -> Vec<S> {
    let mut all = vec![];
    for row in rows {
        let same = |change: &Change| {
            let values = recording.to(change.address).map(|stored| stored.value);
            values.map(|value| instead(change.address, value, value)).collect::<Vec<_>>()
        };
        let changes: Vec<Change> = row.changes.iter().flat_map(same).collect();
        let (seen, told) = run(&changes);
        assert!(told.is_empty(), "{}: {told:?}", row.what);
        all.push(seen);
    }
    all
}

fn words(findings: Vec<Finding>) -> Vec<String> {
    findings.iter().map(|finding| format!("{:?}: {}", finding.kind, finding.text)).collect()
}

// ---- HORUS

/// How long HORUS runs.
const HORUS_RUN: u64 = 250 * MS;

/// What is seen of the HORUS side from outside.
#[derive(Clone, Debug, Default)]
struct Sends {
    /// When each frame began, ns.
    frames: Vec<u64>,
    /// How long the last frame was on the air, ns.
    air_ns: u64,
    /// For each receiver, how many frames said that its position is valid.
    valid: [usize; 3],
    /// The 10 ms timer's ticks, ns.
    ticks: Vec<u64>,
    /// The field was switched on.
    field: bool,
    /// UBX messages, bytes, and errors of each receiver's line.
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

/// The HORUS board with three receivers that send their position every 20 ms.
fn horus() -> Option<&'static (Node<Horus>, Recording)> {
    static HORUS: OnceLock<Option<(Node<Horus>, Recording)>> = OnceLock::new();
    HORUS
        .get_or_init(|| {
            let node = boards::horus()?;
            let recording = Recording::of(&mut node.clone(), 30 * MS, |node| {
                node.board_mut(|board| board.front_end.take_air());
            });
            Some((node, recording))
        })
        .as_ref()
}

fn run_horus(changes: &[Change]) -> (Sends, Vec<String>) {
    let (node, recording) = horus().expect("an image");
    let mut node = node.clone();
    patch::patch(&mut node, recording, changes);
    let mut seen = Sends::default();
    let mut frame = vec![];
    let mut feed = 15 * MS;
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
                    ..NavPvt::default()
                };
                node.board_mut(|board| board.send(feed, index, &pvt.encode()));
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
    told.extend(node.board().front_end.chip().reports().iter().map(|report| format!("chip: {report}")));
    (seen, told)
}

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
const ISER: u32 = 0xE000_E100;

/// All but what is asked for goes on as it should: the other two receivers, and a frame every 10 ms.
fn first_receiver_alone_is_lost(seen: &Sends) -> bool {
    let [first, second, third] = seen.valid;
    first == 0 && second >= 20 && third >= 20 && seen.messages == [0, 12, 12] && on_time(seen)
}

/// A frame in every cycle of 10 ms.
fn on_time(seen: &Sends) -> bool {
    seen.frames.len() >= 23 && seen.ticks.len() >= 23 && seen.period() == 10 * MS && seen.restarts.is_empty()
}

/// The front end is never used, the log says why, and the rest of the board goes on.
fn off_air_for(seen: &Sends, reason: &str) -> bool {
    seen.frames.is_empty()
        && !seen.field
        && seen.faults >= 5
        && seen.log.contains(&format!("WARN  radio: {reason}"))
        && seen.messages[2] == 12
        && seen.period() == 10 * MS
        && seen.restarts.is_empty()
}

const REFUSED: &str = "written without its clock";

const HORUS_ROWS: &[Row<Sends>] = &[
    // ---- the first receiver's line
    row("USART2: half the baud rate", &[bits(USART2 + 8, 0xFFFF, 0x9C)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.errors[0] > 100
    }),
    row("USART2: OVER8 with a divider for 16 samples", &[bits(USART2 + 0xC, 0x8000, 0x8000)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.errors[0] > 100
    }),
    // Nine bits take the stop bit for parity and the next start bit for a stop.
    row("USART2: eight bits and parity", &[bits(USART2 + 0xC, 0x1400, 0x1400)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.errors[0] > 100
    }),
    row("USART2: receiver not enabled", &[bits(USART2 + 0xC, 4, 0)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 0
    }),
    // EIE reports nothing without DMAR (RM0090 30.6.6): what is counted is the overrun that each idle line comes with.
    row("USART2: no DMA requests", &[bits(USART2 + 0x14, 0x40, 0)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 12
    }),
    row("USART2: no clock", &[gate(0x40, 17)], Told::Finding(REFUSED), |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 0
    }),
    row(
        "PD6: alternate function 8",
        &[bits(GPIOD + 0x20, 0xF00_0000, 0x800_0000)],
        Told::Finding("this pin has no such alternate function"),
        |seen| first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] == 0,
    ),
    row("DMA1 stream 5: channel 3", &[bits(DMA1_STREAM5, 7 << 25, 3 << 25)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] == 0 && seen.errors[0] > 100
    }),
    // RXNE stays, and with it the request: the ring fills with nothing as fast as the controller goes round.
    row("DMA1 stream 5: towards the UART", &[bits(DMA1_STREAM5, 0xC0, 0x40)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] > 100_000 && seen.errors[0] > 100
    }),
    row("DMA1 stream 5: reads CR3 for DR", &[bits(DMA1_STREAM5 + 8, !0, USART2 + 0x14)], Told::Nothing, |seen| {
        first_receiver_alone_is_lost(seen) && seen.bytes[0] > 100_000 && seen.errors[0] > 100
    }),
    // The first byte ends in a transfer error; the firmware starts the ring again, by code that is not changed.
    row(
        "DMA1 stream 5: ring in CCM RAM",
        &[bits(DMA1_STREAM5 + 0xC, !0, 0x1000_0000)],
        Told::Finding("does not reach 0x10000000"),
        |seen| seen.errors == [1, 0, 0] && seen.messages == [11, 12, 12] && on_time(seen),
    ),
    row("DMA1: no clock", &[gate(0x30, 21)], Told::Finding(REFUSED), |seen| {
        // Receivers 1 and 3 are DMA1's.
        seen.valid[0] == 0 && seen.valid[2] == 0 && seen.valid[1] >= 20 && on_time(seen)
    }),
    // ---- the front end's SPI
    row("SPI1: mode 0", &[bits(SPI1, 3, 0)], Told::Finding("SPI mode 0"), |seen| off_air_for(seen, "Identity")),
    row("SPI1: mode 2", &[bits(SPI1, 3, 2)], Told::Finding("SPI mode 2"), |seen| off_air_for(seen, "Identity")),
    row("SPI1: mode 3", &[bits(SPI1, 3, 3)], Told::Finding("SPI mode 3"), |seen| off_air_for(seen, "Absent")),
    row("SPI1: least significant bit first", &[bits(SPI1, 0x80, 0x80)], Told::Finding("chip:"), |seen| {
        off_air_for(seen, "Absent")
    }),
    row("SPI1: 16 bits", &[bits(SPI1, 0x800, 0x800)], Told::Finding("chip:"), |seen| off_air_for(seen, "Identity")),
    // 281 kHz: loading a frame takes 7 ms, and the slot passes. The chip answers, so nothing is at fault.
    row("SPI1: clock divided by 256", &[bits(SPI1, 0x38, 0x38)], Told::Nothing, |seen| {
        seen.frames.is_empty() && seen.field && seen.skipped >= 23 && seen.faults == 0 && seen.log.contains("HORUS")
    }),
    row("SPI1: slave", &[bits(SPI1, 4, 0)], Told::Finding("slave mode"), |seen| off_air_for(seen, "Bus")),
    // A mode fault switches master mode and the SPI off (RM0090 28.3.10).
    row("SPI1: not selected by software", &[bits(SPI1, 0x100, 0)], Told::Nothing, |seen| off_air_for(seen, "Bus")),
    row("SPI1: not enabled", &[bits(SPI1, 0x40, 0)], Told::Nothing, |seen| off_air_for(seen, "Bus")),
    row("SPI1: no clock", &[gate(0x44, 12)], Told::Finding(REFUSED), |seen| off_air_for(seen, "Bus")),
    row("SCK: alternate function 0", &[bits(GPIOA + 0x20, 0xF0_0000, 0)], Told::Nothing, |seen| {
        off_air_for(seen, "Absent")
    }),
    row("MOSI: input", &[bits(GPIOA, 0xC000, 0)], Told::Finding("chip:"), |seen| off_air_for(seen, "Absent")),
    row("MISO: input", &[bits(GPIOA, 0x3000, 0)], Told::Nothing, |seen| off_air_for(seen, "Absent")),
    row("chip select: input", &[bits(GPIOD, 0x3000_0000, 0)], Told::Nothing, |seen| off_air_for(seen, "Absent")),
    row("GPIOA: no clock", &[gate(0x30, 0)], Told::Finding(REFUSED), |seen| off_air_for(seen, "Absent")),
    // Port D has chip select and the first receiver's line.
    row("GPIOD: no clock", &[gate(0x30, 3)], Told::Finding(REFUSED), |seen| {
        off_air_for(seen, "Absent") && seen.bytes == [0, 1200, 1200]
    }),
    // A transfer that never completes is ended by the firmware's bound.
    row("DMA2 stream 0: channel 4", &[bits(DMA2_STREAM0, 7 << 25, 4 << 25)], Told::Nothing, |seen| {
        off_air_for(seen, "Bus")
    }),
    row(
        "DMA2 stream 3: channel 4",
        &[bits(DMA2_STREAM3, 7 << 25, 4 << 25)],
        Told::Finding("a stream's channel has no request"),
        |seen| off_air_for(seen, "Bus"),
    ),
    row("DMA2 stream 3: from the SPI", &[bits(DMA2_STREAM3, 0xC0, 0)], Told::Nothing, |seen| off_air_for(seen, "Bus")),
    row("DMA2 stream 0: memory does not advance", &[bits(DMA2_STREAM0, 0x400, 0)], Told::Nothing, |seen| {
        off_air_for(seen, "Absent")
    }),
    row(
        "DMA2 stream 3: sends from CCM RAM",
        &[bits(DMA2_STREAM3 + 0xC, !0, 0x1000_0000)],
        Told::Finding("does not reach 0x10000000"),
        |seen| off_air_for(seen, "Bus"),
    ),
    // DMA2 serves the second receiver, too.
    row("DMA2: no clock", &[gate(0x30, 22)], Told::Finding(REFUSED), |seen| {
        off_air_for(seen, "Bus") && seen.messages == [12, 0, 12]
    }),
    row("DMA2 stream 0: interrupt not enabled", &[never_iser(1, 0x0100_0000)], Told::Nothing, |seen| {
        off_air_for(seen, "Bus")
    }),
    // ---- the front end's interrupt and timer
    // Without the edge the firmware learns of the oscillator and of the first frames when its waits are over.
    row("EXTI3: from port D", &[bits(SYSCFG + 8, 0xF000, 0x3000)], Told::Nothing, late_on_air),
    row("EXTI3: no rising edge", &[bits(EXTI + 8, 8, 0)], Told::Nothing, late_on_air),
    row("EXTI3: masked", &[bits(EXTI, 8, 0)], Told::Nothing, late_on_air),
    row("EXTI3: interrupt not enabled", &[never_iser(0, 0x200)], Told::Nothing, late_on_air),
    row("EXTI3 masked, TIM5 without a clock", &[bits(EXTI, 8, 0), gate(0x40, 3)], Told::Finding(REFUSED), |seen| {
        seen.frames.is_empty() && !seen.field && seen.faults == 0 && seen.messages == [12; 3]
    }),
    row("TIM5: no prescaler", &[bits(TIM5 + 0x28, 0xFFFF, 0)], Told::Nothing, |seen| off_air_for(seen, "Oscillator")),
    // ---- the cycle
    row("TIM2: prescaler 2", &[bits(TIM2 + 0x28, 0xFFFF, 1)], Told::Nothing, |seen| {
        seen.period() == 20 * MS && seen.frames.len() == seen.ticks.len() && seen.restarts.is_empty()
    }),
    // CC1IF comes with the overflow where the compare value is beyond it (RM0090 18.4.5).
    row("TIM2: slot beyond the period", &[bits(TIM2 + 0x34, !0, 0xF_FFFF)], Told::Nothing, fires_at_the_tick),
    row("TIM2: no compare interrupt", &[bits(TIM2 + 0xC, 2, 0)], Told::Nothing, fires_at_the_tick),
    row("TIM2: no clock", &[gate(0x40, 0)], Told::Finding(REFUSED), |seen| {
        seen.ticks.is_empty() && seen.frames.is_empty() && seen.watchdog()
    }),
    row("TIM2: interrupt not enabled", &[never_iser(0, 0x1000_0000)], Told::Nothing, |seen| {
        !seen.ticks.is_empty() && seen.frames.is_empty() && seen.watchdog() && seen.log.contains("reset: watchdog")
    }),
    row("cycle's interrupt not enabled", &[never_iser(0, 0x10_0000)], Told::Nothing, |seen| {
        !seen.ticks.is_empty() && seen.frames.is_empty() && seen.watchdog() && seen.log.contains("reset: watchdog")
    }),
    // ---- clocks, flash, watchdog
    row("FLASH: no wait states", &[bits(FLASH, 0xF, 0)], Told::Finding("too few wait states"), |seen| {
        seen.log.is_empty() && seen.ticks.is_empty() && !seen.field && seen.watchdog()
    }),
    row("FLASH: three wait states", &[bits(FLASH, 0xF, 3)], Told::Finding("too few wait states"), |seen| {
        seen.log.is_empty() && seen.ticks.is_empty() && !seen.field && seen.watchdog()
    }),
    row("PLL: 100 MHz", &[bits(RCC + 4, 0x7FC0, 100 << 6)], Told::Nothing, |seen| {
        seen.period() == 14_400_000 && seen.messages == [0; 3] && seen.errors.iter().all(|&errors| errors > 100)
    }),
    row("PLL: input above 2 MHz", &[bits(RCC + 4, 0x3F, 3)], Told::Finding("never locks"), |seen| {
        seen.log.is_empty() && seen.ticks.is_empty() && !seen.field && seen.watchdog()
    }),
    row("system clock left on HSI", &[bits(RCC + 8, 3, 0)], Told::Nothing, |seen| {
        seen.period() == 90 * MS && seen.messages == [0; 3]
    }),
    row("HSE: not switched on", &[bits(RCC, 1 << 16, 0)], Told::Nothing, |seen| {
        seen.without_crystal && seen.log.contains("the external clock is missing") && seen.period() == 10 * MS
    }),
    row("APB1: divided by 8", &[bits(RCC + 8, 0x1C00, 0x1800)], Told::Nothing, |seen| {
        // Receiver 2 is on APB2.
        seen.period() == 20 * MS && seen.messages == [0, 12, 0]
    }),
    row("APB1: divided by 2", &[bits(RCC + 8, 0x1C00, 0x1000)], Told::Finding("PCLK1 is faster"), |seen| {
        seen.period() == 5 * MS && seen.messages == [0, 12, 0] && seen.frames.is_empty()
    }),
    row("IWDG: never reloaded", &[instead(IWDG, 0xAAAA, 0)], Told::Nothing, |seen| {
        seen.watchdog() && !seen.frames.is_empty() && seen.log.contains("reset: watchdog")
    }),
    row(
        "IWDG: prescaler and reload stay locked, and TIM2's interrupt is not enabled",
        &[instead(IWDG, 0x5555, 0), never_iser(0, 0x1000_0000)],
        Told::Finding("without the key 0x5555"),
        |seen| seen.frames.is_empty() && seen.restarts.is_empty() && seen.messages == [12; 3],
    ),
    row(
        "IWDG: not started, and TIM2's interrupt is not enabled",
        &[instead(IWDG, 0xCCCC, 0), never_iser(0, 0x1000_0000)],
        Told::Nothing,
        |seen| seen.frames.is_empty() && seen.restarts.is_empty() && seen.messages == [12; 3],
    ),
];

/// The field comes on two cycles late; from there on a frame in every cycle.
fn late_on_air(seen: &Sends) -> bool {
    seen.frames.len() + 2 == seen.ticks.len() && seen.skipped == 2 && seen.faults == 0 && seen.messages == [12; 3]
}

/// Frames leave at the tick instead of the slot 300 us after it.
fn fires_at_the_tick(seen: &Sends) -> bool {
    let after = |frame: &u64| seen.ticks.iter().filter(|tick| *tick <= frame).map(|tick| frame - tick).min();
    seen.frames.len() >= 22 && seen.frames.iter().all(|frame| after(frame).is_some_and(|after| after < 50 * US))
}

/// The image's store that enables the interrupts `of` of ISER register `word` enables none.
const fn never_iser(word: u32, of: u32) -> Change {
    instead(ISER + 4 * word, of, 0)
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
        let well = on_time(seen) && seen.valid.iter().all(|&frames| frames >= 22) && seen.errors == [0; 3];
        assert!(well && seen.faults == 0 && seen.skipped == 0, "{}: {seen:?}", row.what);
    }
}

// ---- DPR

/// The DPR's run: frames come from here on, every 10 ms.
const FIRST: u64 = 60 * MS;
/// From here on the task `commit` hangs, so that the image has to expire in hardware.
const HANGS: u64 = 135 * MS;
const DPR_RUN: u64 = 200 * MS;

/// What is seen of the DPR from outside.
#[derive(Clone, Debug, Default)]
struct Shows {
    /// Transactions in which everything read 0xFF, those with an intact Link-Status, and those with a valid object.
    silent: usize,
    intact: usize,
    valid: usize,
    all: usize,
    /// How long after `commit` hung something valid was still read, ns.
    stale: u64,
    /// How often FRESH rose and fell.
    fresh: (usize, usize),
    received: u32,
    missed: u32,
    faults: u32,
    /// The longest from a frame's end to its publication, us.
    publish_us: u32,
    expired: u32,
    log: String,
    restarts: Vec<Reset>,
}

fn dpr() -> Option<&'static (Node<Dpr>, Recording)> {
    static DPR: OnceLock<Option<(Node<Dpr>, Recording)>> = OnceLock::new();
    DPR.get_or_init(|| {
        let mut node = boards::dpr()?;
        field_on(&mut node);
        let recording = Recording::of(&mut node.clone(), 30 * MS, |_| {});
        Some((node, recording))
    })
    .as_ref()
}

fn run_dpr(changes: &[Change]) -> (Shows, Vec<String>) {
    let (node, recording) = dpr().expect("an image");
    let mut node = node.clone();
    patch::patch(&mut node, recording, changes);
    for (cycle, at) in (FIRST..DPR_RUN).step_by(10_000_000).enumerate() {
        send(&mut node, at, &payload(100 + 10 * u32::try_from(cycle).unwrap()));
    }
    let mut seen = Shows::default();
    let mut hangs = false;
    while node.now() < DPR_RUN {
        let next = node.now() + 2 * MS;
        while node.now() < next {
            node.advance(next);
        }
        if !hangs && node.now() >= HANGS {
            hangs = true;
            let task = node.address_of("SWI0_EGU0").unwrap() & !1;
            node.write(task, &0xE7FE_u16.to_le_bytes()).unwrap();
        }
        let read: View = view(&mut node);
        seen.all += 1;
        seen.silent += usize::from(read.silent);
        seen.intact += usize::from(read.link.is_some());
        if !read.valid.is_empty() {
            seen.valid += 1;
            seen.stale = read.at.saturating_sub(HANGS);
        }
    }
    let levels = node.board_mut(Dpr::take_fresh);
    seen.fresh = (levels.iter().filter(|(_, high)| *high).count(), levels.iter().filter(|(_, high)| !high).count());
    let count = |offset| counter(&node, "DPR_TELEMETRY", offset);
    seen.received = count(std::mem::offset_of!(DprTelemetry, frames_received));
    seen.missed = count(std::mem::offset_of!(DprTelemetry, frames_missed));
    seen.faults = count(std::mem::offset_of!(DprTelemetry, rf_faults));
    seen.publish_us = count(std::mem::offset_of!(DprTelemetry, rxe_to_publish_worst_us));
    seen.expired = count(std::mem::offset_of!(DprTelemetry, images_expired));
    seen.log = node.take_log().iter().map(|line| format!("{line}\n")).collect();
    seen.restarts = node.resets().iter().map(|reset| reset.cause).collect();
    let mut told = words(node.take_findings());
    told.extend(node.board().front_end.chip().reports().iter().map(|report| format!("chip: {report}")));
    (seen, told)
}

const CLOCK: u32 = 0x4000_0000;
const SPIM0: u32 = 0x4000_3000;
const SPIS1: u32 = 0x4000_4000;
const GPIOTE: u32 = 0x4000_6000;
const TIMER0: u32 = 0x4000_8000;
const TIMER1: u32 = 0x4000_9000;
const TIMER2: u32 = 0x4000_A000;
const WDT: u32 = 0x4001_0000;
const PPI_CHENSET: u32 = 0x4001_F504;
/// PIN_CNF of port 1.
const P1_CNF: u32 = 0x5000_0A00;

/// The front end is never used, the log says why; the SSI shows images with nothing valid in them.
fn deaf_for(seen: &Shows, reason: &str) -> bool {
    seen.received == 0
        && seen.valid == 0
        && seen.intact >= 60
        && seen.faults >= 5
        && seen.log.contains(&format!("front end: Lost({reason}"))
        && seen.restarts.is_empty()
}

/// Frames are received and published; the flight controller gets nothing of it.
fn mute(seen: &Shows) -> bool {
    seen.received == 8 && seen.fresh.0 >= 10 && seen.intact == 0 && seen.valid == 0 && seen.restarts.is_empty()
}

/// As [`mute`], and what it reads is what a line shows that nobody drives, or SPIS's default character.
fn mute_and_silent(seen: &Shows) -> bool {
    mute(seen) && seen.silent == seen.all
}

/// Everything but FRESH is as it should be.
fn shows_as_ever(seen: &Shows) -> bool {
    seen.received == 8 && seen.valid >= 25 && seen.intact >= 60 && seen.restarts.is_empty()
}

const NO_OUTPUT: &str = "SCK or MOSI of SPIM is no output";
const NO_INPUT: &str = "MISO of SPIM is no connected input";
const NO_SPIS_INPUT: &str = "SCK, MOSI or CSN of SPIS is no connected input";

const DPR_ROWS: &[Row<Shows>] = &[
    // ---- the front end's SPI
    row("SCK: input", &[bits(P1_CNF + 0x3C, 3, 0)], Told::Finding(NO_OUTPUT), |seen| deaf_for(seen, "Absent")),
    row("MOSI: input", &[bits(P1_CNF + 0x34, 3, 0)], Told::Finding(NO_OUTPUT), |seen| deaf_for(seen, "Absent")),
    row("chip select: input", &[bits(P1_CNF + 0x30, 3, 0)], Told::Nothing, |seen| deaf_for(seen, "Absent")),
    row("MISO: disconnected", &[bits(P1_CNF + 0x38, 3, 2)], Told::Finding(NO_INPUT), |seen| deaf_for(seen, "Absent")),
    row("SPIM0: SCK on P1.11", &[bits(SPIM0 + 0x508, 0x3F, 0x2B)], Told::Finding(NO_OUTPUT), |seen| {
        deaf_for(seen, "Absent")
    }),
    row("SPIM0: MISO on P1.11", &[bits(SPIM0 + 0x510, 0x3F, 0x2B)], Told::Finding(NO_INPUT), |seen| {
        deaf_for(seen, "Absent")
    }),
    row("SPIM0: mode 0", &[bits(SPIM0 + 0x554, 7, 0)], Told::Finding("SPI mode 0"), |seen| deaf_for(seen, "Identity")),
    row("SPIM0: mode 3", &[bits(SPIM0 + 0x554, 7, 6)], Told::Finding("SPI mode 3"), |seen| deaf_for(seen, "Absent")),
    row("SPIM0: least significant bit first", &[bits(SPIM0 + 0x554, 7, 3)], Told::Finding("chip:"), |seen| {
        deaf_for(seen, "Absent")
    }),
    // The chip is set up, but its FIFO is read more slowly than the air fills it.
    row("SPIM0: 125 kbit/s", &[bits(SPIM0 + 0x524, !0, 0x0200_0000)], Told::Nothing, |seen| {
        seen.received == 0 && seen.valid == 0 && seen.faults >= 3 && seen.log.contains("Lost(Bus)")
    }),
    row("SPIM0: no interrupt", &[bits(SPIM0 + 0x304, !0, 0)], Told::Nothing, publishes_late),
    row(
        "SPIM0: not enabled",
        &[bits(SPIM0 + 0x500, !0, 0)],
        Told::Finding("START while SPIM is not enabled"),
        |seen| seen.log.contains("SPIM0 does not stop") && seen.valid == 0 && seen.restarts == [Reset::Watchdog("WDT")],
    ),
    row(
        "SPIM0: sends from flash",
        &[bits(SPIM0 + 0x544, !0, 0x1000)],
        Told::Finding("reads outside data RAM"),
        |seen| deaf_for(seen, "Absent"),
    ),
    row(
        "SPIM0: receives to flash",
        &[bits(SPIM0 + 0x534, !0, 0x1000)],
        Told::Finding("writes outside data RAM"),
        |seen| deaf_for(seen, "Absent"),
    ),
    // ---- the SSI
    row("SPIS1: CPHA", &[bits(SPIS1 + 0x554, 7, 2)], Told::Finding("another SPI mode"), mute),
    row("SPIS1: CPOL", &[bits(SPIS1 + 0x554, 7, 4)], Told::Finding("another SPI mode"), mute),
    row("SPIS1: least significant bit first", &[bits(SPIS1 + 0x554, 7, 1)], Told::Nothing, |seen| {
        // What is 0xFF throughout reads the same from either end.
        mute(seen) && seen.silent < seen.all / 2
    }),
    row("SPIS1: MISO on P1.07", &[bits(SPIS1 + 0x50C, 0x3F, 0x27)], Told::Nothing, mute_and_silent),
    row("SPIS1: CSN on P1.06", &[bits(SPIS1 + 0x514, 0x3F, 0x26)], Told::Nothing, mute_and_silent),
    row("SPIS1: SCK on P1.07", &[bits(SPIS1 + 0x508, 0x3F, 0x27)], Told::Finding(NO_SPIS_INPUT), mute),
    row("CSN: disconnected", &[bits(P1_CNF + 0x10, 2, 2)], Told::Finding(NO_SPIS_INPUT), mute_and_silent),
    row("SPIS1: image in flash", &[bits(SPIS1 + 0x544, !0, 0x1000)], Told::Finding("outside data RAM"), mute),
    row("SPIS1: window of no bytes", &[bits(SPIS1 + 0x548, !0, 0)], Told::Nothing, mute_and_silent),
    row("SPIS1: not enabled", &[bits(SPIS1 + 0x500, !0, 0)], Told::Finding("while SPIS is not enabled"), |seen| {
        seen.received == 8 && seen.silent == seen.all && seen.fresh == (0, 0)
    }),
    // The task runs only when the scrub asks for a sign of life, so most transactions find no image.
    row("SPIS1: no interrupts", &[bits(SPIS1 + 0x304, !0, 0)], Told::Nothing, rarely_shows),
    row("SPIS1: interrupt not enabled", &[never_iser(0, 0x10)], Told::Nothing, |seen| {
        seen.silent == seen.all && seen.fresh.0 <= 1
    }),
    // ---- FRESH and the expiry
    row("PPI 3: FRESH is never cleared", &[instead(PPI_CHENSET, 8, 0)], Told::Nothing, |seen| {
        shows_as_ever(seen) && seen.fresh == (1, 0)
    }),
    row("FRESH: channel on P1.06", &[bits(GPIOTE + 0x514, 0x1F00, 0x600)], Told::Nothing, |seen| {
        shows_as_ever(seen) && seen.fresh == (0, 0)
    }),
    row("FRESH: channel is an input", &[bits(GPIOTE + 0x514, 3, 1)], Told::Nothing, |seen| {
        shows_as_ever(seen) && seen.fresh == (0, 0)
    }),
    // One transaction more reads the image; at its end the SSI's task sees that its time is over.
    row("PPI 1 and 2: no expiry", &[instead(PPI_CHENSET, 2, 0), instead(PPI_CHENSET, 4, 0)], Told::Nothing, |seen| {
        shows_as_ever(seen) && (24 * MS..30 * MS).contains(&seen.stale)
    }),
    row("TIMER2: prescaler 2^9", &[bits(TIMER2 + 0x510, 0xF, 9)], Told::Nothing, |seen| {
        shows_as_ever(seen) && seen.stale > 50 * MS && seen.expired == 0
    }),
    // ---- the interrupt of the front end, and time
    row("PPI 0: the edge is not captured", &[instead(PPI_CHENSET, 1, 0)], Told::Nothing, |seen| {
        seen.received == 8 && seen.valid == 0 && seen.publish_us > 50_000
    }),
    row("IRQ: falling edge", &[bits(GPIOTE + 0x510, 0x3_0000, 0x2_0000)], Told::Nothing, |seen| {
        seen.valid == 0 && seen.received < 8 && seen.intact >= 60
    }),
    row("IRQ: P0.04", &[bits(GPIOTE + 0x510, 0x1F00, 0x400)], Told::Nothing, |seen| {
        seen.valid == 0 && seen.publish_us > 50_000 && seen.intact >= 60
    }),
    row("IRQ: no interrupt", &[bits(GPIOTE + 0x304, !0, 0)], Told::Nothing, |seen| {
        seen.valid == 0 && seen.publish_us > 1_000 && seen.intact >= 60
    }),
    row("IRQ: interrupt not enabled", &[never_iser(0, 0x40)], Told::Nothing, |seen| seen.valid == 0),
    row("SPIM0: interrupt not enabled", &[never_iser(0, 0x8)], Told::Nothing, publishes_late),
    row("TIMER0: no prescaler", &[bits(TIMER0 + 0x510, 0xF, 0)], Told::Nothing, |seen| {
        deaf_for(seen, "Oscillator") && seen.log.contains("2.0")
    }),
    row("TIMER0: not started", &[never(TIMER0)], Told::Nothing, |seen| seen.valid == 0 && seen.silent > 50),
    row("TIMER1: no interrupt", &[bits(TIMER1 + 0x304, !0, 0)], Told::Nothing, |seen| {
        // No image while no frame comes: what was there expires.
        seen.silent > 30 && seen.fresh.0 < 12 && seen.received == 8
    }),
    row("commit's interrupt not enabled", &[never_iser(0, 0x10_0000)], Told::Nothing, |seen| seen.valid == 0),
    // ---- clock and watchdog
    row("HFXO: not started", &[never(CLOCK)], Told::Nothing, |seen| {
        seen.silent == seen.all && seen.log.is_empty() && seen.restarts.contains(&Reset::Watchdog("WDT"))
    }),
    row("WDT: never reloaded", &[never(WDT + 0x600)], Told::Nothing, |seen| {
        seen.valid > 0 && seen.restarts.contains(&Reset::Watchdog("WDT")) && seen.log.contains("last reset: Watchdog")
    }),
];

/// The end of a transfer is noticed when the driver's wait is over, 2 ms later.
fn publishes_late(seen: &Shows) -> bool {
    seen.received == 8 && seen.publish_us > 1_000
}

/// Images are published, and few of them reach the flight controller.
fn rarely_shows(seen: &Shows) -> bool {
    seen.received == 8 && seen.silent > 60 && seen.valid < 10
}

#[test]
fn the_dpr_image_set_up_wrongly_fails_as_silicon_would() {
    if dpr().is_none() {
        return;
    }
    let (healthy, told) = run_dpr(&[]);
    assert!(told.is_empty(), "{told:?}");
    assert!(DPR_ROWS.len() >= 24);
    check(DPR_ROWS, &healthy, run_dpr);
}

#[test]
fn the_dpr_image_patched_to_store_what_it_stores_anyway_works() {
    let Some((_, recording)) = dpr() else { return };
    for (seen, row) in control(DPR_ROWS, recording, run_dpr).iter().zip(DPR_ROWS) {
        let well = shows_as_ever(seen) && seen.faults == 0 && seen.missed == 0 && seen.publish_us < 100;
        assert!(well && seen.stale < 25 * MS && seen.fresh.0 == seen.fresh.1, "{}: {seen:?}", row.what);
    }
}
