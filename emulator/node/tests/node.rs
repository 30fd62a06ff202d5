//! Tests of nodes whose firmware is a few instructions, written in the test itself.

use crate::{player, thumb};

use cortex_m4::Fast;
use emulator_node::{Bare, Between, Board, FindingKind, FromOutside, Limits, Lookahead, Node, Pair, Sent, run};
use emulator_part::{Pin, SpiMode};
use nrf52840::{Nrf52840, Settings, SpisWires};
use player::{IN, Player};
use stm32f429::{Oscillators, Stm32f429, TIM2_INTERRUPT};
use thumb::{COUNTER, EXTI, FLASH, GPIOD, HANDLER, MAIN, RCC, TIM2, Thumb, firmware};

const MS: u64 = 1_000_000;

fn bare(firmware: &emulator_node::Firmware) -> Node<Bare<Stm32f429>> {
    Node::new(Stm32f429::new(Oscillators::default()), Bare::new(), firmware).unwrap()
}

fn counter<B: Board>(node: &mut Node<B>) -> u32 {
    node.word(u64::from(COUNTER)).unwrap()
}

/// Returns a firmware that counts TIM2 updates in RAM and sleeps. The timer runs on the 16 MHz internal oscillator.
fn ticking() -> emulator_node::Firmware {
    let mut main = Thumb::at(MAIN);
    main.tim2_every(160_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    firmware("ticking", &main, &[(28, &tick)])
}

#[test]
fn a_timer_interrupt_is_exact_and_the_core_sleeps_between() {
    let mut node = bare(&ticking());
    node.watch_line(TIM2_INTERRUPT);
    node.advance(105 * MS);
    assert_eq!(counter(&mut node), 10);
    let rises: Vec<u64> = node.take_edges().iter().filter(|edge| edge.high).map(|edge| edge.at).collect();
    assert_eq!(rises.len(), 10);
    for pair in rises.windows(2) {
        assert_eq!(pair[1] - pair[0], 10 * MS);
    }
    let usage = node.usage();
    assert!(usage.awake > 0 && usage.load() < 0.001, "{usage:?}");
    assert_eq!(node.take_findings(), []);
}

/// A loop runs at 16 MHz and again at 8 MHz. TIM2 measures both on the core's clock.
#[test]
fn the_core_follows_its_clock_tree() {
    const TURNS: u32 = 10_000;
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x40, 1).store(TIM2 + 0x2C, u32::MAX).store(TIM2, 1);
    main.store(RCC, 1 << 18 | 1 << 16 | 0x83).wait_for(RCC, 17);
    let lap = |main: &mut Thumb, to: u32| {
        main.store(TIM2 + 0x24, 0).mov(0, TURNS);
        let again = main.here();
        main.raw(&[0x3801]).branch_if(thumb::If::NotEqual, again);
        main.mov(2, TIM2 + 0x24).ldr(1, 2, 0).mov(2, to).str(1, 2, 0);
    };
    lap(&mut main, COUNTER);
    main.store(RCC + 0x08, 1);
    lap(&mut main, COUNTER + 4);
    main.idle();
    let mut node = bare(&firmware("clock tree", &main, &[]));
    node.advance(20 * MS);
    let turns = [COUNTER, COUNTER + 4].map(|at| node.word(u64::from(at)).unwrap());
    // At 16 MHz and at 8 MHz, a turn of the loop takes two cycles of the core and of the timer.
    for cycles in turns {
        assert!(cycles.abs_diff(TURNS * 2) <= 20, "{turns:?}");
    }
    // The core is awake for 20 000 cycles at 16 MHz, then for 20 000 at 8 MHz.
    let awake = node.usage().awake;
    assert!(awake.abs_diff(1_250_000 + 2_500_000) <= 20_000, "{awake}");
    assert_eq!(node.take_findings(), []);
}

/// The core of an nRF52840 sleeps while its crystal starts. The crystal becomes the core's clock after 0.36 ms.
#[test]
fn a_sleep_during_a_clock_change_counts_as_no_time_awake() {
    let mut main = Thumb::at(0x400);
    main.store(0x4000_0000, 1).idle();
    let image = thumb::firmware_at(0, "asleep", &main, &[]);
    let mut node: Node<Bare<Nrf52840>> = Node::new(Nrf52840::new(Settings::default()), Bare::new(), &image).unwrap();
    node.advance(900_000);
    let awake = node.usage().awake;
    assert!((1..1_000).contains(&awake), "{awake}");
    // Until the reset the core has been awake for fewer cycles than it has slept. The reset returns it to the internal
    // oscillator.
    node.hang();
    node.restart(FromOutside::Pin);
    node.advance(1_800_000);
    let again = node.usage().awake;
    assert!((2 * awake..2 * awake + 500).contains(&again), "{awake}, then {again}");
}

fn ticking_on_hse() -> emulator_node::Firmware {
    let mut main = Thumb::at(MAIN);
    main.store(RCC, 1 << 18 | 1 << 16 | 0x83).wait_for(RCC, 17).store(RCC + 0x08, 1).tim2_every(80_000).idle();
    let mut tick = Thumb::at(HANDLER);
    tick.store(TIM2 + 0x10, 0).count(COUNTER).ret();
    firmware("ticking on HSE", &main, &[(28, &tick)])
}

#[test]
fn a_crystal_one_ppm_off_is_ten_microseconds_off_after_ten_seconds() {
    let last_rise = |ppb| {
        let part = Stm32f429::new(Oscillators { hse_ppb: ppb, ..Oscillators::default() });
        let mut node: Node<Bare<Stm32f429>> = Node::new(part, Bare::new(), &ticking_on_hse()).unwrap();
        node.watch_line(TIM2_INTERRUPT);
        node.advance(10_005 * MS);
        let edges = node.take_edges();
        let rises: Vec<u64> = edges.iter().filter(|edge| edge.high).map(|edge| edge.at).collect();
        assert_eq!(rises.len(), 1000);
        rises[999] - rises[0]
    };
    let nominal = last_rise(0);
    assert_eq!(nominal, 9_990 * MS);
    let gained = nominal - last_rise(1_000);
    assert!((9_980..=9_995).contains(&gained), "{gained} ns early after 9.99 s");
    let lost = last_rise(-1_000) - nominal;
    assert!((9_985..=10_000).contains(&lost), "{lost} ns late after 9.99 s");
}

#[test]
fn the_same_run_has_the_same_digest_however_it_is_cut() {
    let at = |steps: &[u64]| {
        let mut node = bare(&ticking());
        for &step in steps {
            node.advance(step);
        }
        node.digest()
    };
    let whole = at(&[105 * MS]);
    assert_eq!(at(&[105 * MS]), whole);
    let cut: Vec<u64> = (1..=1050).map(|step| step * MS / 10).collect();
    assert_eq!(at(&cut), whole);
    assert_ne!(at(&[95 * MS]), whole);
}

#[test]
fn an_access_where_nothing_is_faults_and_says_where() {
    let mut main = Thumb::at(MAIN);
    main.mov(0, 0x4003_0000);
    let load = main.here();
    main.ldr(1, 0, 0).idle();
    let mut node = bare(&firmware("stray", &main, &[]));
    node.advance(MS);
    let findings = node.take_findings();
    assert_eq!(findings[0].kind, FindingKind::Unmapped);
    assert_eq!(findings[0].pc, Some(u64::from(load)));
    assert!(findings[0].text.contains("0x40030000"), "{}", findings[0]);
    assert_eq!(findings.last().unwrap().kind, FindingKind::Lockup);
    assert!(node.now() >= MS);
}

#[test]
fn a_register_behind_a_shut_clock_gate_is_reported() {
    let mut main = Thumb::at(MAIN);
    main.store(TIM2, 1).idle();
    let mut node = bare(&firmware("gated", &main, &[]));
    node.advance(MS);
    let findings = node.take_findings();
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert_eq!(findings[0].kind, FindingKind::Refused);
    assert!(findings[0].pc.is_some());
    assert!(findings[0].text.contains("TIM2: written without its clock"), "{}", findings[0]);
}

#[test]
fn a_register_without_a_model_is_reported_once() {
    let mut main = Thumb::at(MAIN);
    main.store(RCC + 0x44, 1 << 11); // SDIO
    let again = main.here();
    main.store(0x4001_2C00, 3).branch(again);
    let mut node = bare(&firmware("sdio", &main, &[]));
    node.advance(MS);
    node.advance(2 * MS);
    let findings = node.take_findings();
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert_eq!(findings[0].kind, FindingKind::Unmodelled);
    assert!(findings[0].text.contains("SDIO"), "{}", findings[0]);
}

#[test]
fn a_firmware_that_exits_ends_its_run_with_its_status() {
    let status = |reason: u32, code: u32| {
        let block = COUNTER + 16;
        let mut main = Thumb::at(MAIN);
        main.store(block, reason).store(block + 4, code).semihost(0x20, block).idle();
        run::<_, Fast>(
            Stm32f429::new(Oscillators::default()),
            &firmware("exits", &main, &[]),
            Limits::default(),
            |_| {},
        )
        .unwrap()
    };
    let passed = status(0x2_0026, 0);
    assert!(passed.passed(), "{passed:?}");
    let failed = status(0x2_0026, 7);
    assert_eq!((failed.exit, failed.status(), failed.passed()), (Some(7), 7, false));
}

#[test]
fn a_firmware_that_hangs_runs_into_the_limit() {
    let mut main = Thumb::at(MAIN);
    main.idle();
    let limits = Limits { virtual_time: 200 * MS, ..Limits::default() };
    let outcome =
        run::<_, Fast>(Stm32f429::new(Oscillators::default()), &firmware("hangs", &main, &[]), limits, |_| {}).unwrap();
    assert_eq!((outcome.exit, outcome.status(), outcome.virtual_time), (None, 124, 200 * MS));
}

#[test]
fn console_output_through_semihosting_arrives_line_by_line() {
    let text = COUNTER + 0x100;
    let mut main = Thumb::at(MAIN);
    main.store(text, u32::from_le_bytes(*b"hi\nt")).store(text + 4, u32::from_le_bytes(*b"here"));
    main.store(text + 8, u32::from_le_bytes(*b"\n\0\0\0")).semihost(0x04, text).semihost(0x18, 0x2_0026);
    let mut lines = Vec::new();
    let outcome = run::<_, Fast>(
        Stm32f429::new(Oscillators::default()),
        &firmware("console", &main, &[]),
        Limits::default(),
        |event| {
            if let emulator_node::Event::Line(line) = event {
                lines.push(line.text.clone());
            }
        },
    )
    .unwrap();
    assert_eq!(lines, ["hi", "there"]);
    assert_eq!(outcome.exit, Some(0));
}

#[test]
fn an_image_that_does_not_fit_is_refused() {
    let firmware = emulator_node::Firmware::raw("too far", vec![(0x0900_0000, vec![0; 16])]);
    let error =
        Node::<Bare<Stm32f429>>::new(Stm32f429::new(Oscillators::default()), Bare::new(), &firmware).unwrap_err();
    assert!(error.to_string().contains("0x09000000"), "{error}");
}

#[derive(Debug)]
struct Wires {
    lookahead: Lookahead,
    crossed: Vec<(u64, char, bool)>,
}

impl Between<Player, Player> for Wires {
    type ToA = bool;
    type ToB = bool;

    fn lookahead(&self) -> Lookahead {
        self.lookahead
    }

    fn leave_a(&mut self, node: &mut Node<Player>, to_b: &mut Sent<bool>) {
        for (at, high) in node.board_mut(Player::take_edges) {
            to_b.send(at + self.lookahead.a_to_b, high);
        }
    }

    fn leave_b(&mut self, node: &mut Node<Player>, to_a: &mut Sent<bool>) {
        for (at, high) in node.board_mut(Player::take_edges) {
            to_a.send(at + self.lookahead.b_to_a, high);
        }
    }

    fn arrive_a(&mut self, at: u64, high: bool, node: &mut Node<Player>) {
        self.crossed.push((at, 'a', high));
        node.drive(IN, Some(high));
    }

    fn arrive_b(&mut self, at: u64, high: bool, node: &mut Node<Player>) {
        self.crossed.push((at, 'b', high));
        node.drive(IN, Some(high));
    }
}

/// Returns a firmware that answers each rising edge of PA3 with a pulse on PD14. With `serves` it also pulses once at
/// its start.
fn player(serves: bool) -> emulator_node::Firmware {
    let mut main = Thumb::at(MAIN);
    main.exti3_on_pa3().store(GPIOD, 1 << 28);
    if serves {
        main.store(GPIOD + 0x18, 1 << 14).store(GPIOD + 0x18, 1 << 30);
    }
    main.idle();
    let mut hit = Thumb::at(HANDLER);
    hit.store(EXTI + 0x14, 1 << 3).count(COUNTER).store(GPIOD + 0x18, 1 << 14).store(GPIOD + 0x18, 1 << 30).ret();
    firmware("player", &main, &[(9, &hit)])
}

fn match_of(lookahead: Lookahead, stops: impl Iterator<Item = u64>) -> (Vec<(u64, char, bool)>, u64, u64) {
    let a = Player::with(&player(true));
    let b = Player::with(&player(false));
    let mut pair = Pair::new(a, b, Wires { lookahead, crossed: Vec::new() });
    for stop in stops {
        pair.run_until(stop);
    }
    assert_eq!(pair.a.take_findings(), []);
    assert_eq!(pair.b.take_findings(), []);
    let digests = (pair.a.digest(), pair.b.digest());
    (pair.between.crossed, digests.0, digests.1)
}

#[test]
fn two_cores_interrupting_each_other_keep_step_to_the_instruction() {
    let lookahead = Lookahead { a_to_b: 0, b_to_a: 500 };
    let (crossed, ..) = match_of(lookahead, std::iter::once(2 * MS));
    let rises: Vec<_> = crossed.iter().filter(|crossing| crossing.2).collect();
    assert!(rises.len() > 1_000, "{} hits", rises.len());
    for (nth, hit) in rises.iter().enumerate() {
        assert_eq!(hit.1, if nth % 2 == 0 { 'b' } else { 'a' });
    }
    // An answer takes the handler's instructions, 93 or 94 ns, and the delay of the wire. A wake-up rounds to the next
    // nanosecond.
    let answers: Vec<u64> = rises.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
    let (towards_a, towards_b): (Vec<_>, Vec<_>) = answers.iter().enumerate().partition(|(nth, _)| nth % 2 == 0);
    let spread = |answers: &[(usize, &u64)]| {
        let times = answers.iter().map(|(_, time)| **time);
        times.clone().max().unwrap() - times.min().unwrap()
    };
    assert!(spread(&towards_a) <= 190 && spread(&towards_b) <= 190);
    let difference = towards_a[3].1.abs_diff(towards_b[3].1 + 500);
    assert!(difference <= 190, "{difference} ns");
}

#[test]
fn a_pair_does_the_same_every_time_and_however_it_is_cut() {
    let lookahead = Lookahead { a_to_b: 0, b_to_a: 500 };
    let whole = match_of(lookahead, std::iter::once(MS));
    assert_eq!(match_of(lookahead, std::iter::once(MS)), whole);
    let cut = match_of(lookahead, (1..=100).map(|step| step * MS / 100));
    assert_eq!(cut.0, whole.0);
}

#[test]
fn a_one_way_link_needs_no_lookahead_back() {
    let lookahead = Lookahead { a_to_b: 0, b_to_a: Lookahead::NEVER };
    let a = Player::with(&player(true));
    let b = Player::with(&player(false));
    let mut pair = Pair::new(a, b, OneWay(Wires { lookahead, crossed: Vec::new() }));
    pair.run_until(2 * MS);
    assert_eq!(pair.between.0.crossed.len(), 2);
    assert_eq!((counter(&mut pair.a), counter(&mut pair.b)), (0, 1));
}

struct OneWay(Wires);

impl Between<Player, Player> for OneWay {
    type ToA = bool;
    type ToB = bool;

    fn lookahead(&self) -> Lookahead {
        self.0.lookahead
    }

    fn leave_a(&mut self, node: &mut Node<Player>, to_b: &mut Sent<bool>) {
        self.0.leave_a(node, to_b);
    }

    fn leave_b(&mut self, node: &mut Node<Player>, _to_a: &mut Sent<bool>) {
        node.board_mut(Player::take_edges);
    }

    fn arrive_b(&mut self, at: u64, high: bool, node: &mut Node<Player>) {
        self.0.arrive_b(at, high, node);
    }
}

#[test]
fn flash_keeps_what_the_firmware_programs_and_erases() {
    const KEYR: u32 = 0x4002_3C04;
    const SR: u32 = 0x4002_3C0C;
    const CR: u32 = 0x4002_3C10;
    let (kept, erased) = (FLASH + 0xC000, FLASH + 0x8000);
    let mut main = Thumb::at(MAIN);
    main.store(kept, 0); // locked: refused
    main.store(KEYR, 0x4567_0123).store(KEYR, 0xCDEF_89AB);
    main.store(CR, 2 << 8 | 1).store(kept, 0x1234_5678).store(erased, 0);
    main.store(CR, 2 << 8 | 2 << 3 | 2).store(CR, 1 << 16 | 2 << 8 | 2 << 3 | 2); // sector 2
    let again = main.here();
    main.mov(0, SR).ldr(1, 0, 0).test(1, 16).branch_if(thumb::If::CarrySet, again).count(COUNTER).idle();
    let mut node = bare(&firmware("flash", &main, &[]));
    node.advance(3_000 * MS);
    assert_eq!(counter(&mut node), 1);
    assert_eq!(node.word(u64::from(kept)), Some(0x1234_5678));
    assert_eq!(node.word(u64::from(erased)), Some(0xFFFF_FFFF));
}

// Tests with the DPR's part.

/// Returns a firmware whose SPIS1 on P1.01 to P1.04 answers 0x11 0x22 from RAM. After 25 ms TIMER1 takes the buffer
/// through PPI.
fn expiring(then: impl FnOnce(&mut Thumb)) -> emulator_node::Firmware {
    const SPIS1: u32 = 0x4000_4000;
    const TIMER1: u32 = 0x4000_9000;
    const PPI: u32 = 0x4001_F000;
    let mut main = Thumb::at(0x400);
    main.store(COUNTER, 0x2211);
    let set_up = [
        (0x5000_0A04, 0),
        (0x5000_0A08, 0),
        (0x5000_0A10, 0),
        (SPIS1 + 0x508, 0x21),
        (SPIS1 + 0x50C, 0x23),
        (SPIS1 + 0x510, 0x22),
        (SPIS1 + 0x514, 0x24),
        (SPIS1 + 0x55C, 0xFF),
        (SPIS1 + 0x500, 2),
        (SPIS1 + 0x534, COUNTER + 0x40),
        (SPIS1 + 0x538, 2),
        (SPIS1 + 0x544, COUNTER),
        (SPIS1 + 0x548, 2),
        (SPIS1 + 0x28, 1),
        (TIMER1 + 0x508, 3),
        (TIMER1 + 0x510, 0),
        (TIMER1 + 0x540, 400_000),
        (PPI + 0x510, TIMER1 + 0x140),
        (PPI + 0x514, SPIS1 + 0x24),
        (PPI + 0x504, 1),
        (TIMER1, 1),
    ];
    for (address, value) in set_up {
        main.store(address, value);
    }
    then(&mut main);
    thumb::firmware_at(0, "expiring", &main, &[])
}

fn nrf(settings: Settings, firmware: &emulator_node::Firmware) -> Node<Bare<Nrf52840>> {
    let pin = |number| Pin::new(1, number);
    let mut node = Node::new(Nrf52840::new(settings), Bare::new(), firmware).unwrap();
    node.input(|part, _, _| part.wire_spis(SpisWires { sck: pin(1), mosi: pin(2), miso: pin(3), csn: pin(4) }));
    node
}

fn transact(node: &mut Node<Bare<Nrf52840>>) -> [u8; 2] {
    node.input(|part, view, at| part.spis_select(at, Pin::new(1, 4), view));
    node.advance(node.now() + 3_000);
    let read = [(); 2].map(|()| {
        node.advance(node.now() + 1_100);
        node.input(|part, view, at| part.spis_clock(at, 0, SpiMode::Mode0, view)).unwrap()
    });
    node.input(|part, view, at| part.spis_deselect(at, Pin::new(1, 4), view));
    node.advance(node.now() + 3_000);
    read
}

#[test]
fn what_an_spis_answers_expires_in_hardware_whatever_the_processor_does() {
    let hung = |main: &mut Thumb| {
        main.raw(&[0xB672]);
        let here = main.here();
        main.branch(here);
    };
    let asleep = |main: &mut Thumb| {
        main.idle();
    };
    let images = [("hung", expiring(hung)), ("asleep", expiring(asleep))];
    for (what, firmware) in images {
        let settings = Settings { hfint_ppb: 0, ..Settings::default() };
        let mut node = nrf(settings, &firmware);
        for read in 1..25 {
            node.advance(read * MS);
            assert_eq!(transact(&mut node), [0x11, 0x22], "{what} at {read} ms");
        }
        node.advance(25 * MS + MS / 10);
        for _ in 0..5 {
            assert_eq!(transact(&mut node), [0xFF; 2], "{what}");
        }
        assert_eq!(node.take_findings(), [], "{what}");
    }
}

#[test]
fn uicr_in_the_image_opens_the_debug_port_only_with_the_firmware() {
    const UICR_APPROTECT: u64 = 0x1000_1208;
    for (uicr, disable, open) in [(0x5A, 0x5A, true), (0x5A, 0, false), (0xFF, 0x5A, false)] {
        let mut main = Thumb::at(0x400);
        main.store(0x4000_0558, disable).idle();
        let image = thumb::firmware_at(0, "debug port", &main, &[]);
        let mut segments = image.segments().to_vec();
        segments.push((UICR_APPROTECT, vec![uicr, 0xFF, 0xFF, 0xFF]));
        let image = emulator_node::Firmware::raw("debug port", segments);
        let mut node = nrf(Settings::default(), &image);
        node.advance(MS);
        let word = node.word(UICR_APPROTECT).unwrap();
        assert_eq!(word, 0xFFFF_FF00 | u32::from(uicr));
        assert_eq!(node.part().debug_port_open(word), open, "{uicr:#x} {disable:#x}");
        node.restart(FromOutside::Pin);
        assert!(!node.part().debug_port_open(word), "a reset closes it");
        assert_eq!(node.take_findings(), []);
    }
}

#[test]
fn an_nrf52840_reports_why_it_was_reset_including_a_lock_up() {
    let mut main = Thumb::at(0x400);
    main.idle();
    let image = thumb::firmware_at(0, "reasons", &main, &[]);
    let mut node = nrf(Settings::default(), &image);
    fn reason(node: &Node<Bare<Nrf52840>>) -> u32 {
        node.part().reset_reason()
    }
    assert_eq!(reason(&node), 0, "power-on");
    node.restart(FromOutside::Pin);
    assert_eq!(reason(&node), 1);
    node.advance(MS);
    node.lock_up();
    node.advance(2 * MS);
    assert_eq!(reason(&node), 1 | 1 << 3);
    assert_eq!(node.resets().len(), 2);
    node.restart(FromOutside::BrownOut);
    assert_eq!(reason(&node), 0);
    node.restart(FromOutside::Pin);
    node.restart(FromOutside::PowerOn(3));
    assert_eq!(reason(&node), 0);
}
