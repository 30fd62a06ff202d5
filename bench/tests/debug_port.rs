//! Tests the debug port of both boards against the specifications: what a tool may rely on, and what the port must
//! refuse.

use bench::desk::{Desk, kept_bytes, switch_on};
use emulator_debug_port::{Ack, Request, Wire};
use emulator_node::FindingKind;

const MS: u64 = 1_000_000;

const ABORT: u8 = 0;
const CONTROL: u8 = 4;
const SELECT: u8 = 8;
const READ_BUFFER: u8 = 0xC;

/// The registers of the AHB-AP, all of them in bank 0.
const CSW: u8 = 0;
const TAR: u8 = 4;
const DRW: u8 = 0xC;

const POWER_UP: u32 = 1 << 28 | 1 << 30;
const STICKY_ERR: u32 = 1 << 5;

/// The core's debug registers, ARMv7-M C1.6.
const AIRCR: u32 = 0xE000_ED0C;
const DHCSR: u32 = 0xE000_EDF0;
const DCRSR: u32 = 0xE000_EDF4;
const DCRDR: u32 = 0xE000_EDF8;
const DEMCR: u32 = 0xE000_EDFC;
const DEBUG_KEY: u32 = 0xA05F_0000;

struct Tool(Box<dyn Wire>);

impl Tool {
    fn at(desk: Desk) -> Self {
        Self(switch_on(desk, None).unwrap())
    }

    fn connected(desk: Desk) -> Self {
        let mut tool = Self::at(desk);
        tool.connect();
        tool
    }

    fn connect(&mut self) {
        self.select_swd();
        assert_eq!(self.ask(Request::ReadPort(0)), Ack::Ok(0x2BA0_1477));
        self.write_port(CONTROL, POWER_UP);
    }

    fn line_reset(&mut self) {
        self.0.sequence(u64::MAX >> 13, 51);
        self.0.sequence(0, 3);
    }

    fn select_swd(&mut self) {
        self.0.sequence(u64::MAX >> 13, 51);
        self.0.sequence(0xE79E, 16);
        self.line_reset();
    }

    fn ask(&mut self, request: Request) -> Ack {
        self.0.pass(12_000);
        self.0.transfer(request)
    }

    fn write_port(&mut self, address: u8, value: u32) {
        assert_eq!(self.ask(Request::WritePort(address, value)), Ack::Ok(0));
    }

    fn status(&mut self) -> u32 {
        self.write_port(SELECT, 0);
        match self.ask(Request::ReadPort(CONTROL)) {
            Ack::Ok(word) => word,
            other => panic!("{other:?}"),
        }
    }

    fn access(&mut self, ap: u32, register: u8) -> u32 {
        self.write_port(SELECT, ap << 24 | u32::from(register & 0xF0));
        assert!(matches!(self.ask(Request::ReadAccess(register & 0xC)), Ack::Ok(_)));
        match self.ask(Request::ReadPort(READ_BUFFER)) {
            Ack::Ok(word) => word,
            other => panic!("{other:?}"),
        }
    }

    fn write_access(&mut self, ap: u32, register: u8, value: u32) {
        self.write_port(SELECT, ap << 24 | u32::from(register & 0xF0));
        assert_eq!(self.ask(Request::WriteAccess(register & 0xC, value)), Ack::Ok(0));
    }

    fn read(&mut self, address: u32) -> u32 {
        self.write_access(0, TAR, address);
        self.access(0, DRW)
    }

    fn write(&mut self, address: u32, value: u32) {
        self.write_access(0, TAR, address);
        self.write_access(0, DRW, value);
    }

    fn halt(&mut self) {
        self.write(DHCSR, DEBUG_KEY | 3);
        assert_eq!(self.read(DHCSR) >> 17 & 1, 1, "S_HALT");
    }

    fn register(&mut self, number: u32) -> u32 {
        self.write(DCRSR, number);
        self.read(DCRDR)
    }

    fn set_register(&mut self, number: u32, value: u32) {
        self.write(DCRDR, value);
        self.write(DCRSR, 1 << 16 | number);
    }

    fn soft_reset(&mut self) {
        self.write(AIRCR, 0x05FA_0004);
        self.0.pass(MS);
    }

    fn findings(&mut self) -> Vec<FindingKind> {
        self.0.take_findings().into_iter().map(|finding| finding.kind).collect()
    }
}

#[test]
fn a_port_that_nobody_selected_swd_on_does_not_answer() {
    let mut tool = Tool::at(Desk::Horus);
    assert_eq!(tool.ask(Request::ReadPort(0)), Ack::Nothing);
    tool.line_reset();
    assert_eq!(tool.ask(Request::ReadPort(0)), Ack::Nothing);
    tool.select_swd();
    assert_eq!(tool.ask(Request::ReadPort(0)), Ack::Ok(0x2BA0_1477));
}

#[test]
fn after_a_line_reset_the_identification_has_to_be_read_first() {
    let mut tool = Tool::at(Desk::Horus);
    tool.select_swd();
    assert_eq!(tool.ask(Request::ReadPort(CONTROL)), Ack::Nothing);
    assert_eq!(tool.ask(Request::ReadPort(0)), Ack::Nothing, "a protocol error wants another line reset");
    tool.line_reset();
    assert_eq!(tool.ask(Request::ReadPort(0)), Ack::Ok(0x2BA0_1477));
    assert!(matches!(tool.ask(Request::ReadPort(CONTROL)), Ack::Ok(_)));
}

#[test]
fn an_access_port_is_not_reached_before_the_domains_have_power() {
    let mut tool = Tool::at(Desk::Horus);
    tool.select_swd();
    assert!(matches!(tool.ask(Request::ReadPort(0)), Ack::Ok(_)));
    assert_eq!(tool.ask(Request::ReadAccess(CSW)), Ack::Fault);
    tool.write_port(ABORT, 1 << 2);
    tool.write_port(CONTROL, POWER_UP);
    assert_eq!(tool.status() & 0xF000_0000, 0xF000_0000, "both requests are acknowledged");
    assert_eq!(tool.access(0, 0xFC), 0x2477_0011);
    assert_eq!(tool.access(0, 0xF8), 0xE00F_F003);
    assert_eq!(tool.access(7, 0xFC), 0, "no access port is there");
}

#[test]
fn a_bus_error_is_sticky_until_it_is_cleared() {
    let mut tool = Tool::connected(Desk::Horus);
    tool.write_access(0, TAR, 0x6000_0000);
    assert!(matches!(tool.ask(Request::ReadAccess(DRW)), Ack::Ok(_)), "the error comes with the next transfer");
    assert_eq!(tool.ask(Request::ReadPort(READ_BUFFER)), Ack::Fault);
    assert_eq!(tool.ask(Request::WriteAccess(TAR, 0x2000_0000)), Ack::Fault);
    assert_eq!(tool.ask(Request::WritePort(SELECT, 0)), Ack::Fault);
    match tool.ask(Request::ReadPort(CONTROL)) {
        Ack::Ok(word) => assert_eq!(word & STICKY_ERR, STICKY_ERR),
        other => panic!("{other:?}"),
    }
    tool.write_port(ABORT, 1 << 2);
    assert_eq!(tool.status() & STICKY_ERR, 0);
    tool.write(0x2000_0000, 0x1234_5678);
    assert_eq!(tool.read(0x2000_0000), 0x1234_5678);
}

#[test]
fn the_halted_core_runs_a_program_that_the_debugger_put_into_ram() {
    let mut tool = Tool::connected(Desk::Horus);
    assert_eq!(tool.read(0xE004_2000) & 0xFFF, 0x419, "DBGMCU_IDCODE");
    // A core without a program locks up. A halt ends the lock-up.
    assert_eq!(tool.read(DHCSR) >> 19 & 1, 1, "S_LOCKUP");
    tool.halt();
    assert_eq!(tool.read(DHCSR) >> 19 & 1, 0, "S_LOCKUP");
    // The code in RAM is movs r0, #7; adds r0, r0, r0; bkpt 0.
    tool.write(0x2000_0100, 0x1800_2007);
    tool.write(0x2000_0104, 0x0000_BE00);
    tool.set_register(15, 0x2000_0100);
    tool.set_register(13, 0x2000_1000);
    tool.set_register(16, 1 << 24);
    tool.write(DHCSR, DEBUG_KEY | 1);
    assert_eq!(tool.read(DHCSR) >> 17 & 1, 1, "the breakpoint halts it");
    assert_eq!((tool.register(0), tool.register(15)), (14, 0x2000_0104));
}

#[test]
fn vector_catch_halts_the_core_at_its_reset() {
    let mut tool = Tool::connected(Desk::Horus);
    tool.write(DHCSR, DEBUG_KEY | 1);
    tool.write(DEMCR, 1);
    tool.soft_reset();
    let status = tool.read(DHCSR);
    assert_eq!((status >> 17 & 1, status >> 25 & 1), (1, 1), "S_HALT, S_RESET_ST");
    assert_eq!(tool.read(DHCSR) >> 25 & 1, 0, "reading clears it");
}

#[test]
fn flash_keeps_what_was_programmed_over_a_power_cycle() {
    const KEYR: u32 = 0x4002_3C04;
    const SR: u32 = 0x4002_3C0C;
    const CR: u32 = 0x4002_3C10;
    let mut tool = Tool::connected(Desk::Horus);
    tool.halt();
    tool.write(KEYR, 0x4567_0123);
    tool.write(KEYR, 0xCDEF_89AB);
    tool.write(CR, 1 | 2 << 8);
    tool.write(0x0800_4000, 0x1234_5678);
    tool.0.pass(MS);
    assert_eq!(tool.read(SR), 0);
    assert_eq!(tool.read(0x0800_4000), 0x1234_5678);
    // Programming of flash can only clear bits.
    tool.write(0x0800_4000, 0xFFFF_0000);
    tool.0.pass(MS);
    assert_eq!(tool.read(0x0800_4000), 0x1234_0000);
    let kept = tool.0.kept();
    assert_eq!(kept.len(), kept_bytes(Desk::Horus));
    let mut later = Tool(switch_on(Desk::Horus, Some(&kept)).unwrap());
    later.connect();
    assert_eq!(later.read(0x0800_4000), 0x1234_0000);
    assert!(switch_on(Desk::Dpr, Some(&kept)).is_none(), "that is another board's");
    later.halt();
    later.write(KEYR, 0x4567_0123);
    later.write(KEYR, 0xCDEF_89AB);
    later.write(CR, 1 << 1 | 1 << 3 | 2 << 8 | 1 << 16);
    later.0.pass(300 * MS);
    assert_eq!(later.read(0x0800_4000), u32::MAX);
}

#[test]
fn a_bit_that_sticks_survives_erasing_and_programming() {
    let mut tool = Tool::connected(Desk::Horus);
    assert!(tool.0.stick_flash(0x0800_4001, 3, false));
    assert!(!tool.0.stick_flash(0x2000_0000, 3, false), "that is no flash");
    assert!(tool.0.stick_flash(0x0800_4001, 3, false));
    assert_eq!(tool.read(0x0800_4000), 0xFFFF_F7FF);
}

#[test]
fn erasing_opens_a_new_nrf52840_until_the_next_power_on() {
    let mut tool = Tool::connected(Desk::Dpr);
    assert_eq!(tool.access(0, 0xFC), 0, "no memory access port");
    assert_eq!(tool.access(1, 0xFC), 0x0288_0000, "CTRL-AP");
    assert_eq!(tool.access(1, 0x0C), 0, "APPROTECTSTATUS: enabled");
    tool.write_access(1, 0x04, 1);
    assert_eq!(tool.access(1, 0x08), 1, "ERASEALLSTATUS: busy");
    tool.0.pass(170 * MS);
    assert_eq!((tool.access(1, 0x08), tool.access(1, 0x0C)), (0, 1));
    assert_eq!(tool.access(0, 0xFC), 0x2477_0011);
    tool.halt();
    assert_eq!(tool.read(0x1000_0104), u32::from_be_bytes(*b"AAF0"), "INFO.VARIANT");
    // A soft reset by the core or by CTRL-AP leaves the debug port open.
    tool.soft_reset();
    assert_eq!(tool.access(1, 0x0C), 1);
    tool.write_access(1, 0x00, 1);
    tool.write_access(1, 0x00, 0);
    tool.0.pass(MS);
    assert_eq!(tool.access(1, 0x0C), 1);
    let kept = tool.0.kept();
    let mut later = Tool(switch_on(Desk::Dpr, Some(&kept)).unwrap());
    later.connect();
    assert_eq!(later.access(1, 0x0C), 0, "nothing in UICR opens it");
}

#[test]
fn an_nrf52840_stays_locked_unless_its_firmware_opens_the_port() {
    const NVMC_CONFIG: u32 = 0x4001_E504;
    let mut tool = Tool::connected(Desk::Dpr);
    tool.write_access(1, 0x04, 1);
    tool.0.pass(170 * MS);
    tool.halt();
    tool.write(NVMC_CONFIG, 1);
    tool.write(0x1000_1208, 0x5A);
    tool.0.pass(MS);
    assert_eq!(tool.read(0x1000_1208), 0x5A);
    assert_eq!(tool.findings().iter().filter(|kind| **kind == FindingKind::Misuse).count(), 0);
    let kept = tool.0.kept();
    let mut later = Tool(switch_on(Desk::Dpr, Some(&kept)).unwrap());
    later.connect();
    assert_eq!(later.access(1, 0x0C), 0, "APPROTECT.DISABLE is the firmware's to write");
}

#[test]
fn an_nrf52840_that_locks_up_is_not_reset_under_a_debugger() {
    let mut tool = Tool::connected(Desk::Dpr);
    tool.write_access(1, 0x04, 1);
    tool.0.pass(170 * MS);
    assert_eq!(tool.access(1, 0x0C), 1);
    tool.read(DHCSR);
    tool.0.pass(MS);
    let status = tool.read(DHCSR);
    assert_eq!((status >> 19 & 1, status >> 25 & 1), (1, 0), "locked up, and not reset since");
}

#[test]
fn the_reset_pin_holds_the_part_and_its_debug_registers_answer_meanwhile() {
    let mut tool = Tool::connected(Desk::Horus);
    tool.write(DHCSR, DEBUG_KEY | 1);
    tool.write(DEMCR, 1);
    tool.0.reset_pin(true);
    assert_eq!(tool.read(DEMCR) & 1, 1);
    tool.write_access(0, TAR, 0x2000_0000);
    assert!(matches!(tool.ask(Request::ReadAccess(DRW)), Ack::Ok(_)));
    assert_eq!(tool.ask(Request::ReadPort(READ_BUFFER)), Ack::Fault, "memory does not");
    tool.write_port(ABORT, 1 << 2);
    tool.0.reset_pin(false);
    tool.0.pass(MS);
    assert_eq!(tool.read(DHCSR) >> 17 & 1, 1, "caught at its reset");
}

#[test]
fn only_a_pin_reset_clears_the_debug_registers_of_an_nrf52840() {
    // A pin reset locks the debug port. A tool must then erase the microcontroller before it can inspect it.
    let erase = |tool: &mut Tool| {
        tool.write_access(1, 0x04, 1);
        tool.0.pass(170 * MS);
        tool.write_access(1, 0x04, 0);
        assert_eq!(tool.access(1, 0x0C), 1);
    };
    const NVMC_CONFIG: u32 = 0x4001_E504;
    let mut tool = Tool::connected(Desk::Dpr);
    erase(&mut tool);
    tool.halt();
    // At the next reset P0.18 becomes the reset pin (UICR.PSELRESET, both words).
    tool.write(NVMC_CONFIG, 1);
    for word in [0x1000_1200, 0x1000_1204] {
        tool.write(word, 18);
        tool.0.pass(MS);
    }
    tool.write(NVMC_CONFIG, 0);
    tool.write(DEMCR, 1);
    tool.soft_reset();
    assert_eq!(tool.read(DEMCR) & 1, 1);
    assert_eq!(tool.read(DHCSR) & 1, 1, "C_DEBUGEN");
    tool.0.reset_pin(true);
    tool.0.reset_pin(false);
    tool.0.pass(MS);
    assert_eq!(tool.access(1, 0x0C), 0, "the pin has reset and locked the part");
    erase(&mut tool);
    assert_eq!(tool.read(DEMCR) & 1, 0);
    assert_eq!(tool.read(DHCSR) & 1, 0, "C_DEBUGEN");
}

#[test]
fn an_nrf52840s_watchdog_pauses_while_the_core_is_halted() {
    const WDT: u32 = 0x4001_0000;
    let mut tool = Tool::connected(Desk::Dpr);
    tool.write_access(1, 0x04, 1);
    tool.0.pass(170 * MS);
    assert_eq!(tool.access(1, 0x0C), 1);
    tool.halt();
    // The code in RAM is a branch to itself.
    tool.write(0x2000_0100, 0xE7FE_E7FE);
    // The watchdog of 100 ms pauses while the core is halted, but not while it sleeps.
    tool.write(WDT + 0x504, 3276);
    tool.write(WDT + 0x50C, 1);
    tool.write(WDT, 1);
    tool.0.pass(300 * MS);
    assert_eq!(tool.0.resets().last().unwrap().why(), "from a lock-up", "of the time before the debugger came");
    tool.write(DEMCR, 1);
    tool.soft_reset();
    assert_eq!(tool.read(WDT + 0x400), 1, "RUNSTATUS");
    tool.0.pass(300 * MS);
    assert_eq!(tool.0.resets().last().unwrap().why(), "by software");
    for part in [15, 0x2000_0100, 13, 0x2000_1000, 16, 1 << 24].chunks(2) {
        tool.set_register(part[0], part[1]);
    }
    tool.write(DHCSR, DEBUG_KEY | 1);
    tool.0.pass(90 * MS);
    assert_eq!(tool.0.resets().last().unwrap().why(), "by software");
    tool.0.pass(20 * MS);
    assert_eq!(tool.0.resets().last().unwrap().why(), "by its watchdog WDT");
    assert_eq!(tool.access(1, 0x0C), 0, "and it is locked again");
}
