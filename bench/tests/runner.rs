//! Tests the runner of `cargo xtask run`. It refuses a file, or runs it alone on a board within a limit of time, and
//! shows the firmware's log in any format.

use crate::{boards, elf, thumb};

use elf::{EM_ARM, ET_EXEC, elf};
use emulator_node::{
    Bare, Clock, Connected, Event, Finding, FindingKind, Firmware, Limits, Node, Outcome, Sending, SentByte, Target,
};
use emulator_part::Pin;
use stm32f429::{Oscillators, Stm32f429};
use thumb::{COUNTER, FLASH, GPIOA, MAIN, RCC, STACK, Thumb, firmware, firmware_at};

const MS: u64 = 1_000_000;

const ET_REL: u16 = 1;
const EM_RISCV: u16 = 243;

fn refused(bytes: Vec<u8>) -> String {
    Firmware::parse("image", bytes).unwrap_err().to_string()
}

#[test]
fn a_file_that_is_no_firmware_is_refused_with_the_reason() {
    assert!(refused(Vec::new()).contains("the file is empty"));
    assert!(refused(b"fn main() {}\n".to_vec()).contains("not an ELF file"));
    assert!(refused(vec![0; 4096]).contains("not an ELF file"));
    let here = std::fs::read(std::env::current_exe().unwrap()).unwrap();
    let words = refused(here);
    assert!(words.contains("not for a Cortex-M") && words.contains("thumbv7em-none-eabihf"), "{words}");
    let code = [(u64::from(FLASH), vec![0; 64])];
    let words = refused(elf(ET_EXEC, EM_RISCV, &code, &[]));
    assert!(words.contains("Riscv32, not for a Cortex-M"), "{words}");
    assert!(refused(elf(ET_REL, EM_ARM, &code, &[])).contains("link it"));
    assert!(refused(elf(ET_EXEC, EM_ARM, &[], &[])).contains("nothing in it goes into memory"));
}

#[test]
fn a_file_cut_off_anywhere_is_refused_or_read_and_nothing_panics() {
    let whole = elf(ET_EXEC, EM_ARM, &[(u64::from(FLASH), vec![0x55; 64])], &[("_SEGGER_RTT", COUNTER)]);
    assert!(Firmware::parse("whole", whole.clone()).is_ok());
    for length in 0..whole.len() {
        let _ = Firmware::parse("cut", whole[..length].to_vec());
    }
    assert!(refused(whole[..60].to_vec()).contains("image"));
}

fn run_on(target: Target, firmware: &Firmware, ms: u64) -> Outcome {
    let limits = Limits { virtual_time: ms * MS, ..Limits::default() };
    target.run(Clock::Fast, firmware, limits, |_| {}).unwrap()
}

fn on_horus(firmware: &Firmware) -> Outcome {
    run_on(Target::Stm32f429, firmware, 200)
}

#[test]
fn an_image_that_does_not_fit_the_part_is_refused() {
    let refused = |target: Target, segments: Vec<(u64, Vec<u8>)>| {
        let firmware = Firmware::parse("image", elf(ET_EXEC, EM_ARM, &segments, &[])).unwrap();
        target.run(Clock::Fast, &firmware, Limits::default(), |_| {}).unwrap_err().to_string()
    };
    let words = refused(Target::Stm32f429, vec![(0x6000_0000, vec![0; 16])]);
    assert!(words.contains("16 bytes at 0x60000000") && words.contains("is it linked for this part?"), "{words}");
    let words = refused(Target::Stm32f429, vec![(0x0820_0000 - 8, vec![0; 16])]);
    assert!(words.contains("has no memory"), "{words}");
    let words = refused(Target::Stm32f429, vec![(u64::from(FLASH), vec![0; 4096])]);
    assert!(words.contains("no vector table at 0x00000000") && words.contains("begins at 0x08000000"), "{words}");
    let words = refused(Target::Nrf52840, vec![(0x5_0000, vec![1; 64])]);
    assert!(words.contains("begins at 0x00050000"), "{words}");
}

fn kinds(outcome: &Outcome) -> Vec<FindingKind> {
    outcome.findings.iter().map(|finding| finding.kind).collect()
}

#[test]
fn a_reset_vector_to_nowhere_ends_the_run_in_a_lock_up() {
    for (target, base) in [(Target::Stm32f429, FLASH), (Target::Nrf52840, 0)] {
        let lost = firmware_at(base, "lost", &Thumb::at(base + 0x0070_0000), &[]);
        let lost = Firmware::raw("lost", lost.segments()[..1].to_vec());
        let outcome = run_on(target, &lost, 60_000);
        assert_eq!((outcome.exit, outcome.died, outcome.status()), (None, true, 101), "{outcome:?}");
        let last = outcome.findings.last().unwrap();
        assert_eq!(last.kind, FindingKind::Lockup);
        assert!(last.text.contains("instruction bus error"), "{last}");
        assert!(last.text.contains("does the reset vector lead into the image?"), "{last}");
        assert!(last.at < MS / 10, "{last}");
        assert!(outcome.virtual_time <= 10 * MS, "{}", outcome.virtual_time);
    }
}

#[test]
fn a_firmware_that_never_ends_is_stopped_at_the_time_limit() {
    let mut spins = Thumb::at(MAIN);
    spins.branch(MAIN);
    let outcome = on_horus(&firmware("spins", &spins, &[]));
    assert_eq!((outcome.status(), outcome.virtual_time, outcome.findings.len()), (124, 200 * MS, 0), "{outcome:?}");
    assert_eq!(outcome.doing, "it runs at 0x08000400");
    let mut sleeps = Thumb::at(MAIN);
    sleeps.idle();
    let outcome = on_horus(&firmware("sleeps", &sleeps, &[]));
    assert_eq!((outcome.status(), outcome.virtual_time), (124, 200 * MS));
    assert!(outcome.doing.ends_with("and nothing is due that could wake it"), "{}", outcome.doing);
    let mut ticks = Thumb::at(MAIN);
    ticks.tim2_every(16_000).idle();
    let mut tick = Thumb::at(thumb::HANDLER);
    tick.store(thumb::TIM2 + 0x10, 0).ret();
    let outcome = on_horus(&firmware("ticks", &ticks, &[(28, &tick)]));
    assert_eq!(outcome.status(), 124);
    assert!(outcome.doing.starts_with("it sleeps at"), "{}", outcome.doing);
    assert!(!outcome.doing.contains("nothing is due"), "{}", outcome.doing);
}

fn with_exception(main: &Thumb, number: usize, handler: (u32, &Thumb)) -> Firmware {
    let mut segments = firmware("exception", main, &[]).segments().to_vec();
    segments[0].1[4 * number..][..4].copy_from_slice(&(handler.0 | 1).to_le_bytes());
    segments.push((u64::from(handler.0), handler.1.bytes()));
    Firmware::raw("exception", segments)
}

#[test]
fn a_firmware_that_only_switches_contexts_ends_at_the_limit() {
    const ICSR: u32 = 0xE000_ED04;
    let pend = |at| {
        let mut code = Thumb::at(at);
        code.store(ICSR, 1 << 28);
        code
    };
    let mut main = pend(MAIN);
    main.idle();
    let mut switch = pend(thumb::HANDLER);
    switch.count(COUNTER).ret();
    let image = with_exception(&main, 14, (thumb::HANDLER, &switch));
    let outcome = on_horus(&image);
    assert_eq!((outcome.status(), outcome.virtual_time), (124, 200 * MS), "{outcome:?}");
    assert_eq!(outcome.findings, []);
}

#[test]
fn a_hard_fault_handler_that_only_loops_ends_the_run() {
    let mut main = Thumb::at(MAIN);
    main.raw(&[0xDE00]);
    let mut handler = Thumb::at(thumb::HANDLER);
    handler.branch(thumb::HANDLER);
    let outcome = on_horus(&with_exception(&main, 3, (thumb::HANDLER, &handler)));
    assert_eq!(kinds(&outcome), [FindingKind::HardFault], "{outcome:?}");
    assert_eq!((outcome.status(), outcome.findings[0].pc), (101, Some(u64::from(MAIN))));
    assert!(outcome.findings[0].text.contains("undefined instruction"), "{}", outcome.findings[0]);
}

/// The handler sends a report of the fault over a UART, which takes 87 µs for each byte at 115 200 baud.
#[test]
fn the_handler_of_a_hard_fault_is_heard_to_its_end() {
    const USART2: u32 = 0x4000_4400;
    let mut main = Thumb::at(MAIN);
    // The test's firmware sends by USART2 on PA2, with a clock of 16 MHz.
    main.store(RCC + 0x30, 1).store(RCC + 0x40, 1 << 17).store(GPIOA + 0x20, 7 << 8).store(GPIOA, 0xA800_0020);
    main.store(USART2 + 8, 139).store(USART2 + 12, 1 << 13 | 1 << 3).raw(&[0xDE00]);
    let mut handler = Thumb::at(thumb::HANDLER);
    // R3 counts the bytes that are left; a byte is sent when TXE is set.
    handler.mov(3, 500).mov(0, USART2).mov(2, u32::from(b'x'));
    let again = handler.here();
    handler.ldr(1, 0, 0).test(1, 7).branch_if(thumb::If::CarryClear, again);
    handler.str(2, 0, 4).raw(&[0x3B01]).branch_if(thumb::If::NotEqual, again);
    let end = handler.here();
    handler.branch(end);
    let image = with_exception(&main, 3, (thumb::HANDLER, &handler));
    let heard = |virtual_time: u64| {
        let connected = Connected { listened: vec![Pin::new(0, 2)], ..Connected::default() };
        let limits = Limits { virtual_time, ..Limits::default() };
        let mut bytes = 0;
        let count = |event: Event<'_>| bytes += usize::from(matches!(event, Event::Byte(SentByte { byte: b'x', .. })));
        let outcome = Target::Stm32f429.run_connected(Clock::Fast, &image, connected, limits, count).unwrap();
        assert_eq!((kinds(&outcome), outcome.status()), (vec![FindingKind::HardFault], 101), "{outcome:?}");
        (bytes, outcome.virtual_time)
    };
    let (bytes, ended) = heard(60_000 * MS);
    assert_eq!(bytes, 500);
    assert!((100 * MS..101 * MS).contains(&ended), "{ended}");
    assert!(heard(20 * MS).0 < 500, "the limit ends it");
}

#[test]
fn a_hard_fault_vector_to_reset_is_harmless_without_a_fault() {
    let mut main = Thumb::at(MAIN);
    main.idle();
    let outcome = on_horus(&with_exception(&main, 3, (MAIN, &main)));
    assert_eq!((outcome.findings.len(), outcome.status()), (0, 124), "{outcome:?}");
    let mut faulty = Thumb::at(MAIN);
    faulty.raw(&[0xDE00]);
    let outcome = on_horus(&with_exception(&faulty, 3, (MAIN, &faulty)));
    assert_eq!(kinds(&outcome), [FindingKind::HardFault, FindingKind::Lockup], "{outcome:?}");
}

/// This project's firmwares enable MemManage, BusFault and UsageFault, and handle them like a HardFault.
#[test]
fn a_fault_is_reported_only_if_it_shares_the_hard_fault_handler() {
    const SHCSR: u32 = 0xE000_ED24;
    let mut main = Thumb::at(MAIN);
    main.store(SHCSR, 7 << 16).raw(&[0xDE00]);
    let mut handler = Thumb::at(thumb::HANDLER);
    handler.branch(thumb::HANDLER);
    let own = with_exception(&main, 6, (thumb::HANDLER, &handler));
    let outcome = on_horus(&own);
    assert_eq!((kinds(&outcome), outcome.stopped_itself), (vec![], true), "{outcome:?}");
    let mut segments = own.segments().to_vec();
    segments[0].1[12..16].copy_from_slice(&(thumb::HANDLER | 1).to_le_bytes());
    let outcome = on_horus(&Firmware::raw("shared", segments));
    assert_eq!((kinds(&outcome), outcome.status()), (vec![FindingKind::HardFault], 101), "{outcome:?}");
    assert!(outcome.findings[0].text.contains("undefined instruction"), "{}", outcome.findings[0]);
}

/// The firmware moves VTOR to a table in RAM, as boot loaders and operating systems do.
#[test]
fn a_hard_fault_behind_a_moved_vector_table_is_told() {
    const TABLE: u32 = 0x2000_0800;
    let mut main = Thumb::at(MAIN);
    main.store(TABLE + 12, thumb::HANDLER | 1).store(0xE000_ED08, TABLE).raw(&[0xDE00]);
    let mut handler = Thumb::at(thumb::HANDLER);
    handler.branch(thumb::HANDLER);
    let mut segments = firmware("moved", &main, &[]).segments().to_vec();
    segments.push((u64::from(thumb::HANDLER), handler.bytes()));
    let outcome = on_horus(&Firmware::raw("moved", segments));
    assert_eq!(kinds(&outcome), [FindingKind::HardFault], "{outcome:?}");
}

#[test]
fn a_firmware_that_no_interrupt_can_wake_has_stopped_itself() {
    let mut masked = Thumb::at(MAIN);
    masked.raw(&[0xB672, 0xE7FE]);
    let outcome = on_horus(&firmware("masked", &masked, &[]));
    assert!(outcome.stopped_itself, "{outcome:?}");
    assert!(outcome.doing.starts_with("it has stopped itself"), "{}", outcome.doing);
    let mut main = Thumb::at(MAIN);
    main.tim2_every(16_000).idle();
    let mut handler = Thumb::at(thumb::HANDLER);
    handler.branch(thumb::HANDLER);
    assert!(on_horus(&firmware("in its handler", &main, &[(28, &handler)])).stopped_itself);
    let mut spins = Thumb::at(MAIN);
    spins.branch(MAIN);
    assert!(!on_horus(&firmware("spins", &spins, &[])).stopped_itself, "an interrupt may come");
}

#[test]
fn a_firmware_that_only_restarts_ends_the_run_with_the_reason() {
    for (target, base) in [(Target::Stm32f429, FLASH), (Target::Nrf52840, 0)] {
        let mut main = Thumb::at(base + 0x400);
        main.store(0xE000_ED0C, 0x05FA_0004).idle();
        let outcome = run_on(target, &firmware_at(base, "restarts", &main, &[]), 60_000);
        assert_eq!((outcome.status(), outcome.resets), (101, 100), "{outcome:?}");
        assert_eq!(kinds(&outcome), [FindingKind::RestartLoop]);
        assert!(outcome.findings[0].text.contains("100 times (100 times by software)"), "{}", outcome.findings[0]);
        assert!(outcome.virtual_time < 100 * MS, "{}", outcome.virtual_time);
    }
}

#[test]
fn a_firmware_that_its_watchdog_restarts_for_ever_ends() {
    // The first period is 512 ms. The reload value of 1 takes effect after it.
    const IWDG: u32 = 0x4000_3000;
    let mut main = Thumb::at(MAIN);
    main.store(IWDG, 0x5555).store(IWDG + 8, 1).store(IWDG, 0xAAAA).store(IWDG, 0xCCCC).idle();
    let image = firmware("watchdog", &main, &[]);
    let outcome = run_on(Target::Stm32f429, &image, 60_000);
    assert_eq!((outcome.status(), outcome.resets), (101, 100), "{outcome:?}");
    assert!(outcome.findings.last().unwrap().text.contains("by its watchdog IWDG"), "{:?}", outcome.findings.last());
    let short = run_on(Target::Stm32f429, &image, 5);
    assert_eq!((short.status(), short.virtual_time), (124, 5 * MS), "{short:?}");
}

#[test]
fn a_firmware_that_calls_its_host_for_ever_ends_at_the_limit() {
    let mut main = Thumb::at(MAIN);
    main.store(COUNTER, u32::from(b'x'));
    let again = main.here();
    main.semihost(0x03, COUNTER).branch(again);
    let outcome = run_on(Target::Stm32f429, &firmware("calls", &main, &[]), 5);
    assert_eq!((outcome.status(), outcome.virtual_time), (124, 5 * MS));
    assert!(outcome.lines.iter().all(|line| line.text.starts_with("xxx")), "{:?}", outcome.lines);
    assert!(outcome.lines.len() > 1);
}

#[test]
fn a_finding_has_its_instant_and_peripheral_despite_a_change_of_clock() {
    const WAIT: u32 = 16_000;
    let mut main = Thumb::at(MAIN);
    main.mov(0, WAIT);
    let again = main.here();
    main.raw(&[0x3801]).branch_if(thumb::If::NotEqual, again);
    let store = main.here() + 16;
    // The test's firmware first writes to a timer whose clock is off, and then makes the 8 MHz crystal its clock.
    main.store(thumb::TIM2, 1);
    main.store(RCC, 1 << 18 | 1 << 16 | 0x83).wait_for(RCC, 17).store(RCC + 8, 1).idle();
    let outcome = on_horus(&firmware("clocks", &main, &[]));
    assert_eq!(outcome.findings.len(), 1, "{:?}", outcome.findings);
    let finding = &outcome.findings[0];
    assert_eq!((finding.kind, finding.pc), (FindingKind::Refused, Some(u64::from(store))));
    assert!(finding.text.starts_with("TIM2: "), "{finding}");
    // A loop with two clock cycles per turn lasts 2 ms at 16 MHz.
    assert!((2 * MS..2 * MS + 3_000).contains(&finding.at), "{finding}");
}

#[test]
fn a_finding_in_a_release_image_names_the_firmwares_function_and_line() {
    let Some(path) = boards::image(3, "dpr-fw.elf") else { return };
    // On HORUS's board the processor cannot fetch the DPR's code in RAM at its address.
    let outcome = on_horus(&Firmware::read(&path).unwrap());
    // The first stores go to registers of the nRF52840, from assembler code without line numbers.
    let place_of = |finding: &Finding| finding.symbol.clone().unwrap_or_default();
    let (assembler, rust): (Vec<_>, Vec<_>) =
        outcome.findings.iter().partition(|finding| place_of(finding).starts_with("__pre_init+"));
    assert!(!assembler.is_empty() && !rust.is_empty(), "{:?}", outcome.findings);
    for finding in rust {
        let place = place_of(finding);
        assert!(!place.contains("core/src") && !place.contains("/registry/"), "{finding}");
        assert!(place.contains("dpr-fw/src/") || place.contains("firmware-common/src/"), "{finding}");
        assert!(place.contains("dpr_fw::") || place.contains("firmware_common::"), "{finding}");
    }
}

const BLOCK: u32 = 0x2000_1000;
const NAMES: u32 = FLASH + 0x4000;
const TEXTS: u32 = FLASH + 0x4100;

/// An RTT up channel of the firmware: its name, the contents of its buffer, and its mode.
struct Up<'a>(&'a str, &'a [u8], u32);

/// Returns a firmware whose RTT control block has these channels. Each has a buffer of 256 bytes, which `main` fills.
fn logging(channels: &[Up<'_>], then: impl FnOnce(&mut Thumb)) -> Firmware {
    let mut main = Thumb::at(MAIN);
    let mut names = vec![0; 0x100];
    let put = |main: &mut Thumb, at: u32, bytes: &[u8]| {
        for (index, chunk) in (0..).zip(bytes.chunks(4)) {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            main.store(at + 4 * index, u32::from_le_bytes(word));
        }
    };
    main.store(BLOCK + 16, u32::try_from(channels.len()).unwrap());
    main.store(BLOCK + 20, 0);
    for (index, Up(name, text, mode)) in (0..).zip(channels) {
        let (entry, buffer) = (BLOCK + 24 + 24 * index, 0x2000_2000 + 0x100 * index);
        names[32 * index as usize..][..name.len()].copy_from_slice(name.as_bytes());
        put(&mut main, buffer, text);
        let length = u32::try_from(text.len()).unwrap();
        for (at, word) in [(0, NAMES + 32 * index), (4, buffer), (8, 256), (12, length), (16, 0), (20, *mode)] {
            main.store(entry + at, word);
        }
    }
    // RAM holds arbitrary values, so the firmware writes all 16 bytes of the identifier.
    put(&mut main, BLOCK, b"SEGGER RTT\0\0\0\0\0\0");
    then(&mut main);
    main.idle();
    let mut segments = firmware("logging", &main, &[]).segments().to_vec();
    segments.push((u64::from(NAMES), names));
    segments.push((u64::from(TEXTS), vec![0; 4]));
    Firmware::parse("logging", elf(ET_EXEC, EM_ARM, &segments, &[("_SEGGER_RTT", BLOCK)])).unwrap()
}

fn shown(outcome: &Outcome) -> Vec<String> {
    outcome.lines.iter().map(ToString::to_string).collect()
}

#[test]
fn text_channels_are_shown_by_lines_under_their_names() {
    let one = on_horus(&logging(&[Up("Terminal", b"one\r\nt\xFFo\nunfinished", 0)], |_| {}));
    assert_eq!(shown(&one), ["one", "t\u{FFFD}o", "unfinished"]);
    assert_eq!(one.findings, []);
    let two = on_horus(&logging(&[Up("Terminal", b"here\n", 0), Up("", b"there\n", 2)], |_| {}));
    assert_eq!(shown(&two), ["[Terminal] here", "[1] there"]);
}

#[test]
fn defmt_frames_without_a_table_are_reported_as_dropped() {
    let outcome = on_horus(&logging(&[Up("defmt", &[3, 1, 2, 0, 5, 0], 1), Up("Terminal", b"text\n", 0)], |_| {}));
    assert_eq!(shown(&outcome), ["[Terminal] text"]);
    assert_eq!(kinds(&outcome), [FindingKind::LogCorrupt]);
    assert!(outcome.findings[0].text.contains("no table to decode them"), "{}", outcome.findings[0]);
}

#[test]
fn a_corrupt_channel_is_a_finding_once_and_the_others_go_on() {
    let spoil = |main: &mut Thumb| {
        main.store(BLOCK + 24 + 12, 0xFFFF_FFF0);
    };
    let outcome = on_horus(&logging(&[Up("a", b"lost\n", 0), Up("b", b"kept\n", 0)], spoil));
    assert_eq!(shown(&outcome).len(), 1, "{:?}", outcome.lines);
    assert!(outcome.lines[0].text == "kept");
    assert_eq!(kinds(&outcome), [FindingKind::LogCorrupt], "{:?}", outcome.findings);
    for (offset, value) in [(16, 0), (16, u32::MAX), (24 + 4, 0x2002_FFF0), (24 + 8, u32::MAX), (24, 0xFFFF_FFFF)] {
        let outcome = on_horus(&logging(&[Up("a", b"text\n", 0)], |main| {
            main.store(BLOCK + offset, value);
        }));
        assert!(outcome.findings.len() <= 1, "{:?}", outcome.findings);
        assert_eq!(outcome.status(), 124);
    }
}

#[test]
fn a_channel_that_overflows_is_a_finding_unless_the_firmware_waits() {
    let text = [b'.'; 255];
    let lossy = on_horus(&logging(&[Up("Terminal", &text, 1)], |_| {}));
    assert_eq!(kinds(&lossy), [FindingKind::LogOverrun]);
    assert!(lossy.findings[0].text.contains("RTT channel Terminal was full"), "{}", lossy.findings[0]);
    let waits = on_horus(&logging(&[Up("Terminal", &text, 2)], |_| {}));
    assert_eq!((waits.findings.len(), waits.lines[0].text.len()), (0, 255));
}

#[test]
fn the_bytes_of_a_channel_can_be_taken_as_they_came() {
    let image = logging(&[Up("Terminal", b"text\n", 0), Up("data", &[1, 2, 3, 0xFF], 0)], |_| {});
    let mut node: Node<Bare<Stm32f429>> =
        Node::new(Stm32f429::new(Oscillators::default()), Bare::new(), &image).unwrap();
    node.advance(5 * MS);
    assert_eq!(node.take_channel(1), [1, 2, 3, 0xFF]);
    assert!(node.take_channel(1).is_empty());
    assert!(node.take_channel(7).is_empty());
}

#[test]
fn the_test_images_stack_is_where_the_vector_table_says() {
    let mut main = Thumb::at(MAIN);
    main.idle();
    let bytes = elf(ET_EXEC, EM_ARM, firmware("whole", &main, &[]).segments(), &[("here", COUNTER)]);
    let image = Firmware::parse("whole", bytes).unwrap();
    assert_eq!(image.segments()[0].1[..4], STACK.to_le_bytes());
    assert_eq!(image.symbol("here").unwrap().address, u64::from(COUNTER));
    assert_eq!(on_horus(&image).status(), 124);
}

const USART2: u32 = 0x4000_4400;

#[test]
fn a_uart_of_a_board_receives_and_sends_bytes() {
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x30, 1).store(RCC + 0x40, 1 << 17);
    // PA2 and PA3 get alternate function 7, and the debug port keeps its pins.
    main.store(GPIOA + 0x20, 0x7700).store(GPIOA, 0xA800_00A0);
    // 16 MHz / 139 is 115 108 baud.
    main.store(USART2 + 8, 139).store(USART2 + 0xC, 1 << 13 | 1 << 3 | 1 << 2);
    // The loop sends each received byte, increased by one.
    let again = main.here();
    main.wait_for(USART2, 5).mov(0, USART2).ldr(1, 0, 4).raw(&[0x3101]).str(1, 0, 4).branch(again);
    let [transmits, receives] = [2, 3].map(|number| Pin::new(0, number));
    let sent = Sending { at: 5 * MS, pin: receives, baud: 115_200, bytes: b"HAL".to_vec() };
    let connected = Connected { listened: vec![transmits], sent: vec![sent], ..Connected::default() };
    let limits = Limits { virtual_time: 10 * MS, ..Limits::default() };
    let mut heard = vec![];
    let event = |event: Event<'_>| {
        if let Event::Byte(SentByte { pin, byte, .. }) = event {
            heard.push((pin, byte));
        }
    };
    let image = firmware("echo", &main, &[]);
    let outcome = Target::Stm32f429.run_connected(Clock::Fast, &image, connected, limits, event).unwrap();
    assert_eq!(outcome.findings, []);
    assert_eq!(heard, [(transmits, b'I'), (transmits, b'B'), (transmits, b'M')]);
}
