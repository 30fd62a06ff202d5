//! Tests that traces in both formats can be read back.

use crate::waves;

use std::path::PathBuf;

use bench::trace::{Board, DPR, Error, HORUS, Mark, SSI, Task, TaskSignal, Trace, Wire, Word};

fn files(name: &str) -> [PathBuf; 2] {
    ["vcd", "fst"].map(|ending| PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.{ending}")))
}

fn tasks() -> [Task; 2] {
    [("slot", "TIM2", 44), ("rf_irq", "EXTI3", 25)].map(|(name, vector, exception)| Task { name, vector, exception })
}

fn changes(waves: &std::collections::BTreeMap<String, Vec<(u64, String)>>, name: &str) -> Vec<(u64, String)> {
    waves.get(name).unwrap_or_else(|| panic!("{name} is none of {:?}", waves.keys())).clone()
}

fn pairs(expected: &[(u64, &str)]) -> Vec<(u64, String)> {
    expected.iter().map(|&(at, value)| (at, value.to_owned())).collect()
}

#[test]
fn a_decoder_reads_each_spi_byte_back_from_the_waves() {
    for file in files("bytes") {
        for byte in [0x00, 0xFF, 0xA5, 0x01, 0x80, 0xC4] {
            let mut trace = Trace::create(&file, &[], &[]).unwrap();
            trace.take([
                Mark::Level(8_000, Wire::HorusCs, false),
                Mark::Byte(10_000, HORUS, byte, !byte, 9_000_000),
                Mark::Level(11_000, Wire::HorusCs, true),
                Mark::Byte(10_000, DPR, !byte, byte, 8_000_000),
                Mark::Byte(10_000, SSI, byte, 0, 8_000_000),
            ]);
            trace.finish().unwrap();
            let waves = waves::read(&file);
            // Data are sampled at one edge of the clock, as by a logic analyser.
            let sampled = |group: &str, wire: &str, edge: &str| {
                let data = changes(&waves, &format!("{group}.{group}_{wire}"));
                let level = |at: u64| data.iter().take_while(|(when, _)| *when <= at).last().unwrap().1 == "1";
                let clock = changes(&waves, &format!("{group}.{group}_sck"));
                let edges = clock.into_iter().filter(|(at, level)| *at > 0 && level == edge);
                edges.fold(0, |byte: u32, (at, _)| byte << 1 | u32::from(level(at)))
            };
            assert_eq!(sampled("horus", "mosi", "0"), u32::from(byte));
            assert_eq!(sampled("horus", "miso", "0"), u32::from(!byte));
            assert_eq!(sampled("dpr", "miso", "0"), u32::from(byte));
            assert_eq!(sampled("ssi", "mosi", "1"), u32::from(byte));
            let (sent, answered) = (format!("{byte:08b}"), format!("{:08b}", !byte));
            // Eight clocks at 9 MHz take 888.9 ns.
            let while_selected = |value| pairs(&[(0, "zzzzzzzz"), (9_112, value), (11_000, "zzzzzzzz")]);
            assert_eq!(changes(&waves, "horus.horus_mosi_byte"), while_selected(&sent));
            assert_eq!(changes(&waves, "horus.horus_miso_byte"), while_selected(&answered));
        }
    }
}

#[test]
fn events_out_of_order_within_the_window_are_written_in_order() {
    for file in files("order") {
        let mut trace = Trace::create(&file, &[], &[]).unwrap();
        trace.take([Mark::Level(500_000, Wire::Fresh, true), Mark::Level(400_000, Wire::Field, true)]);
        trace.flush_before(550_000).unwrap();
        trace.take([Mark::Level(501_000, Wire::Fresh, false), Mark::Level(500_500, Wire::HorusTick, true)]);
        trace.finish().unwrap();
        let waves = waves::read(&file);
        assert_eq!(changes(&waves, "ssi.ssi_fresh"), pairs(&[(0, "0"), (500_000, "1"), (501_000, "0")]));
        assert_eq!(changes(&waves, "air.field"), pairs(&[(0, "0"), (400_000, "1")]));
        assert_eq!(changes(&waves, "horus.horus_tick"), pairs(&[(0, "0"), (500_500, "1")]));
    }
}

#[test]
fn an_event_that_comes_after_its_instant_was_written_is_an_error() {
    for file in files("late") {
        let mut trace = Trace::create(&file, &[], &[]).unwrap();
        trace.flush_before(1_000_000).unwrap();
        trace.take([Mark::Level(700_000, Wire::Fresh, true)]);
        let error = trace.finish().unwrap_err();
        assert!(matches!(error, Error::Late { at: 700_000, written: 800_000, .. }), "{error}");
        assert!(error.to_string().contains("ssi_fresh"), "{error}");
    }
}

#[test]
fn numbers_and_tasks_come_back_under_their_names() {
    for file in files("tasks") {
        let mut trace = Trace::create(&file, &tasks(), &tasks()[..1]).unwrap();
        let task = |at, board, signal, value| Mark::Task(at, board, signal, value);
        trace.take([
            Mark::Word(1_000, Word::FrameTimestamp, Some(0xDEAD_BEEF)),
            Mark::Word(2_000, Word::FrameTimestamp, None),
            Mark::Word(3_000, Word::LinkStatusAge, Some(53)),
            task(1_000, Board::Horus, TaskSignal::Entered(1), 1),
            task(1_000, Board::Horus, TaskSignal::Running, 25),
            task(2_000, Board::Dpr, TaskSignal::Asleep, 1),
            task(3_000, Board::Dpr, TaskSignal::Entered(0), 1),
            task(4_000, Board::Dpr, TaskSignal::Other, 1),
            task(5_000, Board::Horus, TaskSignal::Idle, 1),
        ]);
        trace.finish().unwrap();
        let waves = waves::read(&file);
        let timestamp = format!("{:032b}", 0xDEAD_BEEF_u32);
        let nothing = "z".repeat(32);
        let expected = [(0, &*nothing), (1_000, &*timestamp), (2_000, &*nothing)];
        assert_eq!(changes(&waves, "air.frame_timestamp"), pairs(&expected));
        assert_eq!(changes(&waves, "ssi.link_status_age")[1..], pairs(&[(3_000, "0000000000110101")]));
        assert_eq!(changes(&waves, "horus.tasks.rf_irq_EXTI3"), pairs(&[(0, "0"), (1_000, "1")]));
        assert_eq!(changes(&waves, "horus.tasks.slot_TIM2"), pairs(&[(0, "0")]));
        assert_eq!(changes(&waves, "horus.tasks.horus_running"), pairs(&[(0, "000000000"), (1_000, "000011001")]));
        assert_eq!(changes(&waves, "horus.tasks.horus_idle"), pairs(&[(0, "0"), (5_000, "1")]));
        assert_eq!(changes(&waves, "dpr.tasks.dpr_asleep"), pairs(&[(0, "0"), (2_000, "1")]));
        assert_eq!(changes(&waves, "dpr.tasks.slot_TIM2"), pairs(&[(0, "0"), (3_000, "1")]));
        assert_eq!(changes(&waves, "dpr.tasks.dpr_other"), pairs(&[(0, "0"), (4_000, "1")]));
    }
}

#[test]
fn a_long_trace_loses_nothing_between_the_blocks_of_its_file() {
    let [_, file] = files("long");
    let mut trace = Trace::create(&file, &[], &[]).unwrap();
    let changes_of = |wire, every: u64| (1..=600_000_u64).map(move |n| Mark::Level(n * every, wire, n % 2 == 1));
    for (nth, (frame, field)) in changes_of(Wire::Frame, 1_000).zip(changes_of(Wire::Field, 1_000)).enumerate() {
        trace.take([frame, field]);
        if nth % 1_000 == 0 {
            trace.flush_before(nth as u64 * 1_000).unwrap();
        }
    }
    trace.finish().unwrap();
    for name in ["air.frame", "air.field"] {
        let waves = waves::read(&file);
        let changes = changes(&waves, name);
        assert_eq!(changes.len(), 600_001);
        assert!((1..).zip(&changes[1..]).all(|(n, (at, level))| *at == n * 1_000 && (level == "1") == (n % 2 == 1)));
    }
}

#[test]
fn a_trace_with_another_ending_or_a_missing_directory_is_refused() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    for name in ["trace", "trace.txt", "trace.vcd.gz", ".fst"] {
        let error = Trace::create(&folder.join(name), &[], &[]).err().unwrap();
        assert!(matches!(error, Error::Ending { .. }), "{name}: {error}");
        assert!(error.to_string().contains(".vcd") && error.to_string().contains(name), "{error}");
        assert!(!folder.join(name).exists());
    }
    for file in files("no such directory/trace") {
        let error = Trace::create(&file, &[], &[]).err().unwrap();
        assert!(matches!(error, Error::Io { .. }), "{error}");
        assert!(error.to_string().contains("no such directory"), "{error}");
    }
}
