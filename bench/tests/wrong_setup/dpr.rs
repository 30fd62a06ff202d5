//! Wrong setups of the DPR's registers by its program.

use bench::world::ssi::Order;
use dpr_fw::ssi::{BUDGET, PAUSE_US};
use profile::ssi::REQUEST_SIZE;
use reader::{carry_by, layout, transact};

use super::*;

/// The instant of the first frame in the DPR's run, ns. A frame follows every 10 ms.
const FIRST: u64 = 60 * MS;
/// The instant, ns, from which the task `commit` hangs. After that, the image has to expire in hardware.
const HANGS: u64 = 135 * MS;
const DPR_RUN: u64 = 200 * MS;
/// The interval, ns, in which each read of the image is followed by two short transactions within one pause.
const HASTY: std::ops::Range<u64> = 110 * MS..120 * MS;
const READ_EVERY: u64 = 2 * MS;

/// The observations of the DPR from outside during a run.
#[derive(Clone, Debug, Default)]
struct Shows {
    silent: usize,
    intact: usize,
    valid: usize,
    all: usize,
    /// The number of transactions that read data although they came within the pause after another transaction.
    hasty: usize,
    /// The longest time, ns, from when `commit` began to hang until a transaction read valid data.
    stale: u64,
    fresh: (usize, usize),
    received: u32,
    missed: u32,
    faults: u32,
    /// The longest time from a frame's end to its publication, µs.
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
        // Transactions are made during the recording too, so that it contains the stores that they cause.
        let (mut run, mut recording) = (node.clone(), Recording::default());
        while run.now() < RAM_TEST + 30 * MS {
            let next = run.now() + READ_EVERY;
            recording.go_on(&mut run, next, |_| {});
            carry_by(&mut run, Order::read(layout().image_len()), |run, end| recording.go_on(run, end, |_| {}));
        }
        Some((node, recording))
    })
    .as_ref()
}

fn run_dpr(changes: &[Change]) -> (Shows, Vec<String>) {
    let (node, recording) = dpr().expect("an image");
    let mut node = node.clone();
    rewrite(&mut node, recording, changes).unwrap();
    for (cycle, at) in (FIRST..DPR_RUN).step_by(10_000_000).enumerate() {
        send(&mut node, at, &payload(100 + 10 * u32::try_from(cycle).unwrap()));
    }
    let mut seen = Shows::default();
    let mut hangs = false;
    while node.now() < DPR_RUN {
        let next = node.now() + READ_EVERY;
        while node.now() < next {
            node.advance(next);
        }
        if !hangs && node.now() >= HANGS {
            hangs = true;
            let _ = ImageFault::Hung("SWI0_EGU0".into()).apply(&mut node).unwrap();
        }
        let read: View = view(&mut node);
        seen.all += 1;
        seen.silent += usize::from(read.silent);
        seen.intact += usize::from(read.link.is_some());
        if !read.valid.is_empty() {
            seen.valid += 1;
            seen.stale = read.at.saturating_sub(HANGS);
        }
        if HASTY.contains(&node.now()) {
            transact(&mut node, REQUEST_SIZE, 0);
            seen.hasty += usize::from(transact(&mut node, REQUEST_SIZE, 0) != [0xFF; REQUEST_SIZE]);
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
const TIMER3: u32 = 0x4001_A000;
const PPI_CHENSET: u32 = 0x4001_F504;
/// The PIN_CNF registers of the nRF52840's port 1.
const P1_CNF: u32 = 0x5000_0A00;

/// Returns whether the front end is never used, the log gives `reason` for that, and the SSI shows no valid object.
fn deaf_for(seen: &Shows, reason: &str) -> bool {
    seen.received == 0
        && seen.valid == 0
        && seen.intact >= 60
        && seen.faults >= 5
        && seen.log.contains(&format!("front end: Lost({reason}"))
        && seen.restarts.is_empty()
}

fn mute(seen: &Shows) -> bool {
    seen.received == 8 && seen.fresh.0 >= 10 && seen.intact == 0 && seen.valid == 0 && seen.restarts.is_empty()
}

/// Returns whether every transaction reads only an undriven line or SPIS's default character. Frames must be received
/// and published all the same.
fn mute_and_silent(seen: &Shows) -> bool {
    mute(seen) && seen.silent == seen.all
}

/// Returns whether as many intact images are read as with the original program. FRESH is not checked.
fn shows_as_ever(seen: &Shows) -> bool {
    seen.received == 8 && seen.valid >= 25 && seen.intact >= 60 && seen.restarts.is_empty()
}

const NO_OUTPUT: &str = "SCK or MOSI of SPIM is no output";
const NO_INPUT: &str = "MISO of SPIM is no connected input";
const NO_SPIS_INPUT: &str = "SCK, MOSI or CSN of SPIS is no connected input";

const _: () = assert!(PAUSE_US <= 0xFF);

const DPR_ROWS: &[Row<Shows>] = &[
    row("SCK: input", &[bits(P1_CNF + 0x3C, 3, 0)], Expected::Finding(NO_OUTPUT), |seen| deaf_for(seen, "Absent")),
    row("MOSI: input", &[bits(P1_CNF + 0x34, 3, 0)], Expected::Finding(NO_OUTPUT), |seen| deaf_for(seen, "Absent")),
    row("chip select: input", &[bits(P1_CNF + 0x30, 3, 0)], Expected::Nothing, |seen| deaf_for(seen, "Absent")),
    row("MISO: disconnected", &[bits(P1_CNF + 0x38, 3, 2)], Expected::Finding(NO_INPUT), |seen| {
        deaf_for(seen, "Absent")
    }),
    row("SPIM0: SCK on P1.11", &[bits(SPIM0 + 0x508, 0x3F, 0x2B)], Expected::Finding(NO_OUTPUT), |seen| {
        deaf_for(seen, "Absent")
    }),
    row("SPIM0: MISO on P1.11", &[bits(SPIM0 + 0x510, 0x3F, 0x2B)], Expected::Finding(NO_INPUT), |seen| {
        deaf_for(seen, "Absent")
    }),
    row("SPIM0: mode 0", &[bits(SPIM0 + 0x554, 7, 0)], Expected::Finding("SPI mode 0"), |seen| {
        deaf_for(seen, "Identity")
    }),
    row("SPIM0: mode 3", &[bits(SPIM0 + 0x554, 7, 6)], Expected::Finding("SPI mode 3"), |seen| {
        deaf_for(seen, "Absent")
    }),
    row("SPIM0: least significant bit first", &[bits(SPIM0 + 0x554, 7, 3)], Expected::Finding("chip:"), |seen| {
        deaf_for(seen, "Absent")
    }),
    // At 125 kbit/s the firmware reads the chip's FIFO more slowly than the air fills it.
    row("SPIM0: 125 kbit/s", &[bits(SPIM0 + 0x524, !0, 0x0200_0000)], Expected::Nothing, |seen| {
        seen.received == 0 && seen.valid == 0 && seen.faults >= 3 && seen.log.contains("Lost(Bus)")
    }),
    row("SPIM0: no interrupt", &[bits(SPIM0 + 0x304, !0, 0)], Expected::Nothing, publishes_late),
    row(
        "SPIM0: not enabled",
        &[bits(SPIM0 + 0x500, !0, 0)],
        Expected::Finding("START while SPIM is not enabled"),
        |seen| seen.log.contains("SPIM0 does not stop") && seen.valid == 0 && restarts_by_watchdog(seen),
    ),
    row(
        "SPIM0: sends from flash",
        &[bits(SPIM0 + 0x544, !0, 0x1000)],
        Expected::Finding("reads outside data RAM"),
        |seen| deaf_for(seen, "Absent"),
    ),
    row(
        "SPIM0: receives to flash",
        &[bits(SPIM0 + 0x534, !0, 0x1000)],
        Expected::Finding("writes outside data RAM"),
        |seen| deaf_for(seen, "Absent"),
    ),
    row("SPIS1: CPHA", &[bits(SPIS1 + 0x554, 7, 2)], Expected::Finding("another SPI mode"), mute),
    row("SPIS1: CPOL", &[bits(SPIS1 + 0x554, 7, 4)], Expected::Finding("another SPI mode"), mute),
    row("SPIS1: least significant bit first", &[bits(SPIS1 + 0x554, 7, 1)], Expected::Nothing, |seen| {
        // A transaction that reads only 0xFF reads the same in either bit order.
        mute(seen) && seen.silent < seen.all / 2
    }),
    row("SPIS1: MISO on P1.07", &[bits(SPIS1 + 0x50C, 0x3F, 0x27)], Expected::Nothing, mute_and_silent),
    row("SPIS1: CSN on P1.06", &[bits(SPIS1 + 0x514, 0x3F, 0x26)], Expected::Nothing, mute_and_silent),
    row("SPIS1: SCK on P1.07", &[bits(SPIS1 + 0x508, 0x3F, 0x27)], Expected::Finding(NO_SPIS_INPUT), mute),
    row("CSN: disconnected", &[bits(P1_CNF + 0x10, 2, 2)], Expected::Finding(NO_SPIS_INPUT), mute_and_silent),
    row("SPIS1: image in flash", &[bits(SPIS1 + 0x544, !0, 0x1000)], Expected::Finding("outside data RAM"), mute),
    row("SPIS1: window of no bytes", &[bits(SPIS1 + 0x548, !0, 0)], Expected::Nothing, mute_and_silent),
    row("SPIS1: not enabled", &[bits(SPIS1 + 0x500, !0, 0)], Expected::Finding("while SPIS is not enabled"), |seen| {
        seen.received == 8 && seen.silent == seen.all && seen.fresh == (0, 0)
    }),
    // The SSI's task has no interrupts. It runs only when the scrub requests its check-in.
    row("SPIS1: no interrupts", &[bits(SPIS1 + 0x304, !0, 0)], Expected::Nothing, rarely_shows),
    row("SPIS1: interrupt not enabled", &[never_iser(0, 0x10)], Expected::Nothing, |seen| {
        seen.silent == seen.all && seen.fresh.0 <= 1
    }),
    row("PPI 3: FRESH is never cleared", &[instead(PPI_CHENSET, 8, 0)], Expected::Nothing, |seen| {
        shows_as_ever(seen) && seen.fresh == (1, 0)
    }),
    row("FRESH: channel on P1.06", &[bits(GPIOTE + 0x514, 0x1F00, 0x600)], Expected::Nothing, |seen| {
        shows_as_ever(seen) && seen.fresh == (0, 0)
    }),
    row("FRESH: channel is an input", &[bits(GPIOTE + 0x514, 3, 1)], Expected::Nothing, |seen| {
        shows_as_ever(seen) && seen.fresh == (0, 0)
    }),
    // Without an expiry by hardware, one more transaction reads the expired image. At its end the SSI's task finds the
    // image expired.
    row(
        "PPI 1 and 2: no expiry",
        &[instead(PPI_CHENSET, 2, 0), instead(PPI_CHENSET, 4, 0)],
        Expected::Nothing,
        |seen| shows_as_ever(seen) && (24 * MS..30 * MS).contains(&seen.stale),
    ),
    // The image expires only after 800 ms. By then all transactions granted for it have been made.
    row("TIMER2: prescaler 2^9", &[bits(TIMER2 + 0x510, 0xF, 9)], Expected::Nothing, |seen| {
        let granted = READ_EVERY * u64::from(BUDGET);
        shows_as_ever(seen) && (granted..granted + 3 * READ_EVERY).contains(&seen.stale) && seen.expired == 0
    }),
    // Two settings of TIMER3 have no row: its mode keeps the reset value anyway, and a width of eight bits suffices for
    // the pause.
    row("TIMER3: prescaler 2^9", &[bits(TIMER3 + 0x510, 0xF, 9)], Expected::Nothing, |seen| {
        seen.received == 8 && seen.valid < 25 && seen.intact < 60 && seen.restarts.is_empty()
    }),
    row("TIMER3: no prescaler", &[bits(TIMER3 + 0x510, 0xF, 0)], Expected::Nothing, |seen| {
        shows_as_ever(seen) && seen.hasty > 0
    }),
    row("TIMER3: not started", &[never(TIMER3)], Expected::Nothing, is_bitten),
    row("TIMER3: compares with 0", &[bits(TIMER3 + 0x540, !0, 0)], Expected::Nothing, is_bitten),
    row("TIMER3: no interrupt", &[bits(TIMER3 + 0x304, !0, 0)], Expected::Nothing, is_bitten),
    row("TIMER3: interrupt not enabled", &[never_iser(0, 0x400_0000)], Expected::Nothing, is_bitten),
    row("PPI 0: the edge is not captured", &[instead(PPI_CHENSET, 1, 0)], Expected::Nothing, |seen| {
        seen.received == 8 && seen.valid == 0 && seen.publish_us > 50_000
    }),
    row("IRQ: falling edge", &[bits(GPIOTE + 0x510, 0x3_0000, 0x2_0000)], Expected::Nothing, |seen| {
        seen.valid == 0 && seen.received < 8 && seen.intact >= 60
    }),
    row("IRQ: P0.04", &[bits(GPIOTE + 0x510, 0x1F00, 0x400)], Expected::Nothing, |seen| {
        seen.valid == 0 && seen.publish_us > 50_000 && seen.intact >= 60
    }),
    row("IRQ: no interrupt", &[bits(GPIOTE + 0x304, !0, 0)], Expected::Nothing, |seen| {
        seen.valid == 0 && seen.publish_us > 1_000 && seen.intact >= 60
    }),
    row("IRQ: interrupt not enabled", &[never_iser(0, 0x40)], Expected::Nothing, |seen| seen.valid == 0),
    row("SPIM0: interrupt not enabled", &[never_iser(0, 0x8)], Expected::Nothing, is_bitten),
    // Without the prescaler TIMER0 counts 16 times as fast, so the DPR's second lasts 63 ms.
    row("TIMER0: no prescaler", &[bits(TIMER0 + 0x510, 0xF, 0)], Expected::Nothing, |seen| {
        deaf_for(seen, "Oscillator") && seen.log.contains("\n1.0")
    }),
    // Without TIMER0 the idle loop finds no work and does not feed the watchdog.
    row("TIMER0: not started", &[never(TIMER0)], Expected::Nothing, |seen| {
        seen.valid == 0 && restarts_by_watchdog(seen)
    }),
    row("TIMER1: no interrupt", &[bits(TIMER1 + 0x304, !0, 0)], Expected::Nothing, |seen| {
        // Without frames no image is published, so the last image expires.
        seen.silent > 30 && seen.fresh.0 < 12 && seen.received == 8
    }),
    row("commit's interrupt not enabled", &[never_iser(0, 0x10_0000)], Expected::Nothing, is_bitten),
    row("HFXO: not started", &[never(CLOCK)], Expected::Nothing, |seen| {
        seen.silent == seen.all
            && seen.log.lines().all(|line| line.ends_with("the 32 MHz crystal does not start"))
            && seen.restarts.contains(&Reset::Watchdog("WDT"))
    }),
    row("WDT: never reloaded", &[never(WDT + 0x600)], Expected::Nothing, |seen| {
        seen.valid > 0 && seen.restarts.contains(&Reset::Watchdog("WDT")) && seen.log.contains("last reset: Watchdog")
    }),
];

fn restarts_by_watchdog(seen: &Shows) -> bool {
    seen.restarts == [Reset::Watchdog("WDT"); 2]
}

/// Returns whether images are published late. The firmware then detects the end of a transfer only after the driver's
/// wait of 2 ms.
fn publishes_late(seen: &Shows) -> bool {
    seen.received == 8 && seen.publish_us > 1_000
}

fn rarely_shows(seen: &Shows) -> bool {
    seen.received == 8 && seen.silent > 60 && seen.valid < 10
}

fn is_bitten(seen: &Shows) -> bool {
    seen.restarts.contains(&Reset::Watchdog("WDT"))
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
