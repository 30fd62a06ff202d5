//! Tests which accesses the memory protection units refuse, and how the log names the cause of the stop.
//!
//! A task of each release program is overwritten with a few forbidden instructions. The board must enter its safe state
//! at once, and its watchdog must restart it. The next start must report the cause in the log and, as the code of
//! `firmware_common::last_stop`, in the telemetry.

use crate::{boards, reader};

use bench::boards::{Dpr, Horus};
use bench::faults::image::ImageFault;
use emulator_node::{Board, Node};
use emulator_part::Reset;
use firmware_common::last_stop::Cause;
use profile::LinkStatus;
use reader::{MS, transact};
use st25r3916_model::AirEvent;

const BITE: u64 = 200 * MS;

/// The longest period of the overwritten tasks, ns: the DPR's deadline of 12.5 ms, and a margin.
const PERIOD: u64 = 15 * MS;

/// Returns `MOVW` or `MOVT` of `value` to register `to`, encodings T3 and T1 (ARMv7-M ARM A7.7.76, A7.7.79).
fn mov(opcode: u16, to: u16, value: u16) -> [u16; 2] {
    [opcode | value >> 11 << 10 & 0x400 | value >> 12, (value >> 8 & 7) << 12 | to << 8 | value & 0xFF]
}

fn load_r0(value: u32) -> Vec<u16> {
    [mov(0xF240, 0, value as u16), mov(0xF2C0, 0, (value >> 16) as u16)].concat()
}

#[derive(Clone, Copy, Debug)]
enum Misdeed {
    Read(u32),
    Write(u32),
    Execute(u32),
    /// The task fills its stack and then continues.
    Recurse,
}

impl Misdeed {
    /// Returns the forbidden instructions, with a branch to itself at the end.
    fn code(self) -> Vec<u8> {
        const LDR_R1_R0: u16 = 0x6801;
        const STR_R1_R0: u16 = 0x6001;
        const BX_R0: u16 = 0x4700;
        const PUSH_R0_TO_R7: u16 = 0xB4FF;
        const BACK: u16 = 0xE7FD;
        const HANG: u16 = 0xE7FE;
        let halves = match self {
            Self::Read(address) => [load_r0(address), vec![LDR_R1_R0, HANG]].concat(),
            Self::Write(address) => [load_r0(address), vec![STR_R1_R0, HANG]].concat(),
            Self::Execute(address) => [load_r0(address | 1), vec![BX_R0, HANG]].concat(),
            Self::Recurse => vec![PUSH_R0_TO_R7, BACK],
        };
        halves.into_iter().flat_map(u16::to_le_bytes).collect()
    }
}

type Row = (Misdeed, &'static str, &'static str);

const DATA: &str = "memory protection, data access at ";
const EXECUTION: &str = "memory protection, execution";

fn patch<B: Board>(node: &mut Node<B>, handler: &str, misdeed: Misdeed) -> bench::faults::image::Repair {
    let address = u32::try_from(node.address_of(handler).unwrap() & !1).unwrap();
    ImageFault::Patch { address, bytes: misdeed.code(), sealed: false }.apply(node).unwrap()
}

fn restarted<B: Board>(node: &mut Node<B>, mut look: impl FnMut(&mut Node<B>)) {
    let end = node.now() + BITE;
    while node.now() < end {
        let restarted = node.advance_to_restart(end);
        look(node);
        if restarted {
            return;
        }
    }
    panic!("no restart");
}

fn run<B: Board>(node: &mut Node<B>, ns: u64) {
    let end = node.now() + ns;
    while node.now() < end {
        node.advance(end);
    }
}

fn run_horus(node: &mut Node<Horus>, ns: u64) {
    let end = node.now() + ns;
    while node.now() < end {
        node.advance(end);
        node.board_mut(|board| board.front_end.take_air());
    }
}

fn last_stop<B: Board>(node: &mut Node<B>) -> String {
    let lines: Vec<String> = node.take_log().iter().map(ToString::to_string).collect();
    let found = lines.iter().find(|line| line.contains("the last stop: "));
    found.unwrap_or_else(|| panic!("no last stop in {lines:#?}")).clone()
}

fn check<B: Board>(node: &mut Node<B>, row: Row, task: &str, code: u32) {
    let (misdeed, what, area) = row;
    let line = last_stop(node);
    for part in [what, area, &format!("task {task};")] {
        assert!(line.contains(part), "{misdeed:x?}: {part:?} is not in {line:?}");
    }
    assert_eq!(code >> 24, Cause::MemoryProtection as u32, "{misdeed:x?}: {code:#010x}");
    assert!(line.contains(&format!("code {code:#010x}")), "{misdeed:x?}: {line:?}");
}

fn dpr_counter(node: &Node<Dpr>, name: &str) -> u32 {
    let place = dpr_fw::telemetry::Telemetry::NAMES.iter().position(|it| *it == name).unwrap();
    boards::counter(node, "DPR_TELEMETRY", 4 * place)
}

#[test]
fn the_dpr_stops_at_each_forbidden_access_and_reports_it_later() {
    let rows: [Row; 10] = [
        (Misdeed::Read(0), "data access at 0x00000000", "null page"),
        (Misdeed::Read(0xFC), DATA, "null page"),
        (Misdeed::Write(0x8000), "data access at 0x00008000", "flash"),
        (Misdeed::Write(0x0080_0000), DATA, "code in RAM"),
        (Misdeed::Write(0x2000_0000), DATA, "below the stack"),
        (Misdeed::Execute(0x2002_0000), EXECUTION, "pc 0x20020000"),
        (Misdeed::Write(0x4001_E504), DATA, "a peripheral that is shut"),
        (Misdeed::Read(0x4000_1000), DATA, "a peripheral that is shut"),
        (Misdeed::Read(0x1000_0100), DATA, "an address where nothing is"),
        (Misdeed::Recurse, DATA, "below the stack"),
    ];
    for row in rows {
        let Some(mut dpr) = boards::dpr() else { return };
        run(&mut dpr, 50 * MS);
        assert_eq!(dpr_counter(&dpr, "last_stop"), 0);
        let repair = patch(&mut dpr, "SWI1_EGU1", row.0);
        run(&mut dpr, PERIOD);
        let read = transact(&mut dpr, LinkStatus::SIZE, 0);
        assert!(read.iter().all(|byte| *byte == 0xFF), "{row:x?}: something can be read after the stop");
        repair.mend(&mut dpr).unwrap();
        restarted(&mut dpr, |_| {});
        dpr.take_log();
        run(&mut dpr, 50 * MS);
        let link = (0..2).find_map(|_| LinkStatus::verify(&transact(&mut dpr, LinkStatus::SIZE, 0)).ok().copied());
        let link = link.expect("Link-Status");
        assert!(link.status().unasked_reset(), "{row:x?}");
        assert_eq!(dpr.part().watchdog_resets().len(), 1, "{row:x?}");
        let code = dpr_counter(&dpr, "last_stop");
        check(&mut dpr, row, "scrub", code);
    }
}

const HORUS_LAST_STOP: usize = core::mem::offset_of!(horus_tx_fw::telemetry::Telemetry, last_stop);

#[test]
fn horus_stops_at_each_forbidden_access_and_reports_it_later() {
    let rows: [Row; 9] = [
        (Misdeed::Read(0), "data access at 0x00000000", "null page"),
        (Misdeed::Write(0x0800_8000), "data access at 0x08008000", "flash"),
        (Misdeed::Write(0x4002_3C04), DATA, "a peripheral that is shut"),
        (Misdeed::Read(0x4002_3800), DATA, "a peripheral that is shut"),
        (Misdeed::Write(0x1000_0000), DATA, "an address where nothing is"),
        (Misdeed::Write(0x2003_0000), DATA, "RAM"),
        (Misdeed::Execute(0x2001_0000), EXECUTION, "pc 0x20010000"),
        (Misdeed::Execute(0x4000_0000), EXECUTION, "pc 0x40000000"),
        (Misdeed::Recurse, DATA, "below the stack"),
    ];
    for row in rows {
        let Some(mut horus) = boards::horus() else { return };
        run_horus(&mut horus, 55 * MS);
        horus.board_mut(|board| board.front_end.take_air());
        let broken = horus.now();
        let repair = patch(&mut horus, "CAN1_RX0", row.0);
        let mut off = None;
        restarted(&mut horus, |node: &mut Node<Horus>| {
            let air = node.board_mut(|board| board.front_end.take_air());
            let went = air.iter().find(|(_, event)| matches!(event, AirEvent::FieldOff)).map(|(at, _)| *at);
            off = off.or(went);
        });
        let off = off.unwrap_or_else(|| panic!("{row:x?}: the field stayed on"));
        assert!(off <= broken + 11 * MS, "{row:x?}: {off}");
        let causes: Vec<Reset> = horus.resets().iter().map(|reset| reset.cause).collect();
        assert_eq!(causes, [Reset::Watchdog("IWDG")], "{row:x?}");
        repair.mend(&mut horus).unwrap();
        horus.take_log();
        run_horus(&mut horus, 55 * MS);
        let code = boards::counter(&horus, "HORUS_TELEMETRY", HORUS_LAST_STOP);
        check(&mut horus, row, "cycle", code);
    }
}

#[test]
fn after_a_restart_that_no_stop_explains_no_stop_is_told_of() {
    let Some(mut horus) = boards::horus() else { return };
    run_horus(&mut horus, 55 * MS);
    // `parse` is no step of the cycle, so the cycle goes on when `parse` hangs.
    let repair = ImageFault::Hung("CAN1_RX1".to_owned()).apply(&mut horus).unwrap();
    restarted(&mut horus, |node| drop(node.board_mut(|board| board.front_end.take_air())));
    repair.mend(&mut horus).unwrap();
    horus.take_log();
    run_horus(&mut horus, 55 * MS);
    let told = horus.take_log().iter().any(|line| line.to_string().contains("the last stop"));
    assert!(!told, "a task that hung has stopped nothing");
    assert_eq!(boards::counter(&horus, "HORUS_TELEMETRY", HORUS_LAST_STOP), 0);
}
