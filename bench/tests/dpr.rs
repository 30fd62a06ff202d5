//! Tests what the DPR's release program reports and tolerates: the reason of its last reset, an undriven line,
//! transactions that are too long, the debug port.

use crate::{boards, reader};

use bench::boards::Dpr;
use bench::faults::ImageFault;
use bench::world::ssi::Order;
use boards::counter;
use dpr_fw::ssi::RECEIVE_BYTES;
use dpr_fw::telemetry::Telemetry;
use emulator_node::{FromOutside, Node};
use firmware_common::last_stop::Cause;
use nrf52840::{Settings, SpisEvent};
use profile::ResetReason;
use profile::ssi::{Request, encode};
use reader::{MS, View, carry, layout, transact, view};

fn count(node: &Node<Dpr>, offset: usize) -> u32 {
    counter(node, "DPR_TELEMETRY", offset)
}

fn pass(node: &mut Node<Dpr>, ns: u64) {
    let end = node.now() + ns;
    while node.now() < end {
        node.advance(end);
    }
}

#[derive(Clone, Copy, Debug)]
enum Reset {
    Pin,
    PowerOn,
    BrownOut,
    Lockup,
    Watchdog,
}

const BITE: u64 = 200 * MS;

impl Reset {
    fn strike(self, node: &mut Node<Dpr>) {
        match self {
            Self::Pin => node.restart(FromOutside::Pin),
            Self::PowerOn => node.restart(FromOutside::PowerOn(3)),
            Self::BrownOut => node.restart(FromOutside::BrownOut),
            Self::Lockup => node.lock_up(),
            Self::Watchdog => {
                let task = node.address_of("TIMER1").unwrap() & !1;
                let mut was = [0; 2];
                node.read(task, &mut was).unwrap();
                node.write(task, &0xE7FE_u16.to_le_bytes()).unwrap();
                let end = node.now() + BITE;
                while !node.advance_to_restart(end) {
                    assert!(node.now() < end, "the watchdog did not bite");
                }
                node.write(task, &was).unwrap();
            }
        }
    }
}

#[test]
fn link_status_tells_each_reason_of_the_last_reset_apart() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    let told = |node: &mut Node<Dpr>| {
        let status = view(node).link.expect("Link-Status").status;
        (status.reset_reason(), status.unasked_reset())
    };
    assert_eq!(told(&mut node), (Some(ResetReason::PowerOn), false), "at first");
    // The reasons of two successive resets differ, so that an old reason would be noticed.
    let resets = [
        (Reset::Pin, ResetReason::Pin),
        (Reset::Watchdog, ResetReason::Watchdog),
        (Reset::Lockup, ResetReason::Lockup),
        (Reset::BrownOut, ResetReason::BrownOutOrOther),
        (Reset::PowerOn, ResetReason::PowerOn),
        (Reset::Watchdog, ResetReason::Watchdog),
        (Reset::Pin, ResetReason::Pin),
        (Reset::BrownOut, ResetReason::BrownOutOrOther),
        (Reset::Lockup, ResetReason::Lockup),
        (Reset::PowerOn, ResetReason::PowerOn),
    ];
    for (nth, (reset, reason)) in resets.into_iter().enumerate() {
        reset.strike(&mut node);
        pass(&mut node, 50 * MS);
        assert_eq!(told(&mut node), (Some(reason), reason.is_unasked()), "{nth}: {reset:?}");
    }
    assert_eq!(node.resets().len(), resets.len());
}

#[test]
fn a_dpr_whose_crystal_is_dead_stops_by_name() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    node.input(|part, _, _| part.set_hfxo_startup(None));
    pass(&mut node, 20 * MS);
    assert!(view(&mut node).link.is_some(), "one that runs goes on");
    node.restart(FromOutside::Pin);
    let begun = node.now();
    while node.now() < begun + 450 * MS {
        pass(&mut node, 5 * MS);
        assert!(view(&mut node).silent, "{} ms", (node.now() - begun) / MS);
    }
    let after: Vec<u64> = node.resets()[1..].iter().map(|reset| (reset.at - begun) / MS).collect();
    assert_eq!(after, [100, 200, 300, 400], "its watchdog tries again and again");
    let log: String = node.take_log().iter().map(|line| format!("{line}\n")).collect();
    assert_eq!(log.matches("the 32 MHz crystal does not start").count(), 5, "{log}");

    node.input(|part, _, _| part.set_hfxo_startup(Some(9_000_000)));
    pass(&mut node, 150 * MS);
    let told = view(&mut node).link.expect("Link-Status").status;
    assert_eq!((told.reset_reason(), told.unasked_reset()), (Some(ResetReason::Watchdog), true));
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, last_stop)) >> 24, Cause::ClockStart as u32);
    assert_eq!(node.resets().len(), 6, "one that starts after 9 ms is waited for");
    assert_eq!(node.take_findings(), []);
}

#[test]
fn an_undriven_mosi_reads_the_image_and_violates_nothing() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    let (mut read, mut silent) = (0, 0);
    while node.now() < 1_000 * MS {
        // The transactions have the length of an image, of a request and object, and shorter lengths.
        let bytes = [layout().image_len(), 96, 7, 32, 8, 1][read as usize % 6];
        let miso = transact(&mut node, bytes, 0xFF);
        if bytes >= 32 {
            let shown = View::of(node.now(), &miso);
            // A transaction reads only ones while the DPR puts in a new image, and the DPR does not count it.
            let is_busy = miso.iter().all(|byte| *byte == 0xFF);
            assert!(shown.link.is_some() || is_busy, "transaction {read} of {bytes} bytes: {miso:02x?}");
            silent += usize::from(is_busy);
        }
        read += 1;
        pass(&mut node, 2 * MS);
    }
    assert!(read >= 400, "{read}");
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, access_violations)), 0);
    let events = node.input(|part, _, _| part.take_spis_events());
    let busy = events.iter().filter(|(.., event)| *event == SpisEvent::Busy).count();
    assert!(silent <= busy && busy <= 2, "{busy} of {read}, {silent} of them seen");
    let granted = count(&node, std::mem::offset_of!(Telemetry, ssi_transactions));
    assert_eq!(granted + u32::try_from(busy).unwrap(), read);
    let link = view(&mut node).link.expect("Link-Status");
    assert_eq!(link.access_violations, 0);
}

#[test]
fn a_busy_dpr_keeps_its_window_and_ignores_a_request() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    let whole = layout().image_len();
    let ask = |node: &mut Node<Dpr>, offset, length, bytes| {
        let mosi = encode(Request { offset, length }).to_vec();
        carry(node, Order { mosi, ..Order::read(bytes) })
    };
    // The transactions begin just after a publication; without frames the next one comes 10 ms later.
    let mut rose = vec![];
    while rose.is_empty() {
        pass(&mut node, MS / 10);
        rose = node.board_mut(Dpr::take_fresh);
    }
    // The task of the SSI hangs after the first transaction, so the DPR stays busy.
    let hung = ImageFault::Hung("SPIM1_SPIS1_TWIM1_TWIS1_SPI1_TWI1".into()).apply(&mut node).unwrap();
    let image = ask(&mut node, 16, 16, whole);
    assert!(image.iter().any(|byte| *byte != 0xFF));
    assert_eq!(ask(&mut node, 4, 8, whole), vec![0xFF; whole]);
    hung.mend(&mut node).unwrap();
    pass(&mut node, MS / 10);
    assert_eq!(transact(&mut node, 16, 0), image[16..32]);
    assert_eq!(transact(&mut node, whole, 0), image);
}

#[test]
fn transactions_that_clock_too_many_bytes_out_or_in_are_counted() {
    let Some(mut node) = boards::dpr() else { return };
    pass(&mut node, 50 * MS);
    let counts = |node: &Node<Dpr>| {
        (
            count(node, std::mem::offset_of!(Telemetry, ssi_over_reads)),
            count(node, std::mem::offset_of!(Telemetry, ssi_overflows)),
        )
    };
    assert_eq!(counts(&node), (0, 0));
    let image = layout().map_len();
    // A row has a transaction's length in bytes, and whether the DPR counts it as reading or as writing too much.
    let mut expected = (0, 0);
    for (bytes, reads, writes) in [
        (RECEIVE_BYTES, 0, 0),
        (RECEIVE_BYTES + 1, 0, 1),
        (image, 0, 1),
        (image + 1, 1, 1),
        (8, 0, 0),
        (image + 40, 1, 1),
        (image, 0, 1),
    ] {
        let miso = transact(&mut node, bytes, 0);
        expected = (expected.0 + reads, expected.1 + writes);
        assert_eq!(counts(&node), expected, "{bytes} bytes");
        assert!(miso.iter().skip(image).all(|byte| *byte == 0xFF), "{bytes} bytes: {miso:02x?}");
        pass(&mut node, 3 * MS);
    }
    assert_eq!(count(&node, std::mem::offset_of!(Telemetry, access_violations)), 0);
}

/// UICR.APPROTECT (PS v1.7, 4.5.1).
const UICR_APPROTECT: u64 = 0x1000_1208;

#[test]
fn a_revision_3_parts_debug_port_is_opened_if_uicr_allows_it() {
    for (build_code, uicr, opened) in
        [(*b"AAF0", 0x5A, true), (*b"AAF0", 0xFFFF_FFFF, false), (*b"AAF0", 0, false), (*b"AAD0", 0x5A, false)]
    {
        let settings = Settings { build_code, ..Settings::default() };
        let Some(mut node) = boards::dpr_on(settings) else { return };
        node.write(UICR_APPROTECT, &u32::to_le_bytes(uicr)).unwrap();
        pass(&mut node, 50 * MS);
        // With the value 0x5A in UICR.APPROTECT, only the firmware determines whether the debug port is open.
        let software = node.part().debug_port_open(0x5A);
        assert_eq!(software, opened, "{build_code:?} with {uicr:#x}");
        assert_eq!(node.part().debug_port_open(uicr), opened, "{build_code:?} with {uicr:#x}");
        // A reset closes the debug port, and the firmware opens it again.
        node.restart(FromOutside::Pin);
        assert!(!node.part().debug_port_open(uicr));
        pass(&mut node, 50 * MS);
        assert_eq!(node.part().debug_port_open(uicr), opened, "{build_code:?} after a reset");
        assert_eq!(node.take_findings(), [], "{build_code:?}");
    }
}
