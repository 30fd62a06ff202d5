//! Tests gdb at a board of the running link: what it reads, where it halts the board, and that the run's results do not
//! change.

use crate::boards;

use std::fmt::Write as _;
use std::fs::File;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, Receiver, Sender};

use bench::faults::Board as Side;
use bench::gdb::serve;
use bench::sim::{self, Images, Outcome, Setup};
use boards::{image, not_run};
use emulator::Session;
use emulator_gdb::{Ended, World};
use emulator_node::{self as node, AnyRun, Clock, Connected, Drive, Event, FindingKind, Firmware, Limits, Target};
use emulator_part::Pin;
use gdbstub::conn::{Connection, ConnectionExt};
use object::{Object as _, ObjectSymbol as _};

const MS: u64 = 1_000_000;
const END: u64 = 200 * MS;

fn setup(clock: Clock) -> Option<Setup> {
    let images = Images { horus: image(3, "horus-tx-fw.elf")?, dpr: image(3, "dpr-fw.elf")? };
    Some(Setup { clock, writes: true, ..Setup::new(images, 3, END) })
}

fn all_of(outcome: &Outcome) -> String {
    format!("{:#?}\n{:#?}\n{:#?}\n{}", outcome.report, outcome.verdict, outcome.logs, outcome.base)
}

/// Returns the address (without the Thumb bit) and the size of the symbol whose demangled name begins with `begins`.
fn symbol(image: &Path, begins: &str) -> (u32, u32) {
    let bytes = std::fs::read(image).unwrap();
    let elf = object::File::parse(bytes.as_slice()).unwrap();
    let name = |symbol: &object::Symbol<'_, '_>| format!("{:#}", rustc_demangle::demangle(symbol.name().unwrap_or("")));
    let found: Vec<_> = elf.symbols().filter(|symbol| name(symbol).starts_with(begins)).collect();
    assert_eq!(found.len(), 1, "{begins}");
    (u32::try_from(found[0].address()).unwrap() & !1, u32::try_from(found[0].size()).unwrap())
}

fn commit(image: &Path) -> u32 {
    symbol(image, "<dpr_fw::commit::Commit<3>>::publish::").0
}

/// Returns the address and the size of the memory for images, which the firmware fills in turn.
fn images(image: &Path) -> (u32, u32) {
    symbol(image, "dpr_fw::app::__rtic_internal_local_init_images")
}

struct InMemory {
    from_client: Receiver<u8>,
    to_client: Sender<u8>,
    peeked: Option<u8>,
}

fn gone() -> std::io::Error {
    std::io::Error::other("the client is gone")
}

impl Connection for InMemory {
    type Error = std::io::Error;

    fn write(&mut self, byte: u8) -> Result<(), Self::Error> {
        self.to_client.send(byte).map_err(|_| gone())
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

impl ConnectionExt for InMemory {
    fn read(&mut self) -> Result<u8, Self::Error> {
        let peeked = self.peeked.take();
        peeked.map_or_else(|| self.from_client.recv().map_err(|_| gone()), Ok)
    }

    fn peek(&mut self) -> Result<Option<u8>, Self::Error> {
        self.peeked = self.peeked.or_else(|| self.from_client.try_recv().ok());
        Ok(self.peeked)
    }
}

/// The debugger's end of the connection. It speaks packets as in "Debugging with GDB", appendix E.
struct Client {
    to_stub: Sender<u8>,
    from_stub: Receiver<u8>,
}

impl Client {
    fn send(&self, bytes: &[u8]) {
        // The server may have ended.
        for byte in bytes {
            let _ = self.to_stub.send(*byte);
        }
    }

    fn packet(text: &str) -> Vec<u8> {
        let sum = text.bytes().fold(0_u8, u8::wrapping_add);
        format!("${text}#{sum:02x}").into_bytes()
    }

    /// Returns the server's next packet with its run-length encoding expanded.
    fn reply(&self) -> String {
        while self.from_stub.recv().unwrap() != b'$' {}
        let mut text = String::new();
        loop {
            match self.from_stub.recv().unwrap() {
                b'#' => break,
                b'*' => {
                    let (last, count) = (text.chars().last().unwrap(), self.from_stub.recv().unwrap() - 29);
                    (0..count).for_each(|_| text.push(last));
                }
                byte => text.push(char::from(byte)),
            }
        }
        for _sum in 0..2 {
            self.from_stub.recv().unwrap();
        }
        self.send(b"+");
        text
    }

    fn ask(&self, text: &str) -> String {
        self.send(&Self::packet(text));
        self.reply()
    }

    fn word(&self, text: &str) -> u32 {
        u32::from_str_radix(&self.ask(text), 16).unwrap_or_else(|error| panic!("{text}: {error}")).swap_bytes()
    }

    fn pc(&self) -> u32 {
        self.word("pf")
    }

    fn monitor(&self, command: &str) -> String {
        let hex = command.bytes().fold(String::new(), |mut hex, byte| {
            let _ = write!(hex, "{byte:02x}");
            hex
        });
        let mut said = String::new();
        let mut reply = self.ask(&format!("qRcmd,{hex}"));
        while let Some(hex) = reply.strip_prefix('O').filter(|hex| *hex != "K") {
            let bytes: Vec<u8> =
                (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap()).collect();
            said.push_str(&String::from_utf8(bytes).unwrap());
            reply = self.reply();
        }
        assert_eq!(reply, "OK");
        said
    }
}

fn attended<R>(script: impl FnOnce(&Client) + Send, serve: impl FnOnce(InMemory, &mut dyn FnMut(String)) -> R) -> R {
    let (to_stub, from_client) = mpsc::channel();
    let (to_client, from_stub) = mpsc::channel();
    std::thread::scope(|threads| {
        let client = threads.spawn(move || script(&Client { to_stub, from_stub }));
        let connection = InMemory { from_client, to_client, peeked: None };
        let mut lost = vec![];
        let ended = serve(connection, &mut |text| lost.push(text));
        if let Err(panic) = client.join() {
            std::panic::resume_unwind(panic);
        }
        assert_eq!(lost, Vec::<String>::new());
        ended
    })
}

fn debugged(setup: &Setup, side: Side, script: impl FnOnce(&Client) + Send) -> Ended<Outcome> {
    attended(script, |connection, lost| serve(setup, side, Box::new(connection), &mut (), lost).unwrap())
}

fn finished<O>(ended: Ended<O>) -> O {
    match ended {
        Ended::Finished(outcome) => *outcome,
        Ended::Killed(at) => panic!("killed at {at} ns"),
    }
}

#[test]
fn a_debugging_session_leaves_the_run_unchanged_on_every_clock() {
    for clock in [Clock::Fast, Clock::Optimistic, Clock::Pessimistic] {
        let Some(setup) = setup(clock) else { return };
        let without = sim::run(&setup, &mut ()).unwrap();
        let (commit, (images, size)) = (commit(&setup.images.dpr), images(&setup.images.dpr));
        let with = finished(debugged(&setup, Side::Dpr, |gdb| {
            assert!(gdb.ask("qSupported:swbreak+;hwbreak+;vContSupported+").contains("qXfer:features:read+"));
            assert_eq!(&gdb.ask("?")[1..3], "05");
            assert!(gdb.ask("qXfer:features:read:target.xml:0,fff").contains("org.gnu.gdb.arm.m-profile"));
            assert_eq!(gdb.pc(), gdb.word("m4,4") & !1);
            assert_eq!(gdb.word("mE000ED00,4"), 0x410F_C241, "CPUID");
            assert_eq!(gdb.word("m10000100,4"), 0x0005_2840, "FICR.INFO.PART");
            assert_eq!(gdb.ask("m60000000,4"), "E0e", "nothing is there");
            assert_eq!(gdb.ask("g").len(), 2 * (23 * 4 + 16 * 8 + 4));
            // The breakpoint is in RAM, to which the firmware has not copied its code yet.
            assert_eq!(gdb.ask(&format!("Z1,{commit:x},2")), "OK");
            for nth in 0..3 {
                assert!(gdb.ask("c").contains("hwbreak"), "stop {nth}");
                assert_eq!(gdb.pc(), commit);
            }
            assert!(gdb.monitor("time").contains(" ms of 200 ms"));
            assert!(gdb.monitor("pins").starts_with("high: "));
            assert!(gdb.monitor("pin P9.00").contains("no pin"));
            // Single steps also enter interrupts.
            let mut distinct = std::collections::BTreeSet::new();
            for _ in 0..3000 {
                assert_eq!(&gdb.ask("s")[1..3], "05");
                distinct.insert(gdb.pc());
            }
            assert!(distinct.len() > 300, "{}", distinct.len());
            // On silicon, a read of some of these peripheral registers would change them. A read by gdb must not.
            for address in ["40004400", "40000504", "40008540", "4001F500", "E000E010", "E000E100"] {
                assert_eq!(gdb.ask(&format!("m{address},40")).len(), 0x80, "{address}");
            }
            (0..40).for_each(|number| assert!(gdb.ask(&format!("p{number:x}")).len() >= 8));
            // The watchpoint over the images is for stores, then for any access, then for loads.
            assert_eq!(gdb.ask(&format!("z1,{commit:x},2")), "OK");
            let watched = format!("{images:x},{size:x}");
            for (kind, name) in [(2, "watch:"), (4, "awatch:"), (3, "rwatch:")] {
                assert_eq!(gdb.ask(&format!("Z{kind},{watched}")), "OK");
                for _ in 0..20 {
                    let reply = gdb.ask("c");
                    assert!(reply.contains(name), "{reply}");
                    let at = reply.split_once(name).unwrap().1.split_once(';').unwrap().0;
                    let at = u32::from_str_radix(at, 16).unwrap();
                    assert!((images..images + size).contains(&at), "{reply}");
                }
                assert_eq!(gdb.ask(&format!("z{kind},{watched}")), "OK");
            }
            // The debugger sends Ctrl-C before the board has executed anything.
            gdb.send(&[Client::packet("c"), vec![3]].concat());
            assert_eq!(&gdb.reply()[1..3], "02");
            assert_eq!(gdb.ask(&format!("Z0,{commit:x},2")), "OK");
            assert!(gdb.ask("c").contains("swbreak"));
            // The debugger leaves a breakpoint behind, which must not halt the board any more.
            assert_eq!(gdb.ask("D"), "OK");
        }));
        assert!(all_of(&with) == all_of(&without), "{clock} clock:\n{:#?}\n{:#?}", with.report, without.report);
    }
}

#[test]
fn a_debugger_at_horus_leaves_the_run_of_the_link_unchanged() {
    let Some(setup) = setup(Clock::Fast) else { return };
    let without = sim::run(&setup, &mut ()).unwrap();
    let (tick, _) = symbol(&setup.images.horus, "TIM2");
    let with = finished(debugged(&setup, Side::Horus, |gdb| {
        assert!(!gdb.ask("qSupported:swbreak+;hwbreak+;vContSupported+").is_empty());
        assert_eq!(gdb.word("me0042000,4") & 0xFFF, 0x419, "DBGMCU_IDCODE");
        assert_eq!(gdb.ask(&format!("Z0,{tick:x},2")), "OK");
        for _ in 0..8 {
            assert!(gdb.ask("c").contains("swbreak"));
            assert_eq!(gdb.pc(), tick);
            (0..50).for_each(|_| assert_eq!(&gdb.ask("s")[1..3], "05"));
        }
        // A read of the UART's data register would remove the byte on silicon.
        assert_eq!(gdb.ask("m40004400,20").len(), 0x40);
        assert_eq!(gdb.ask("D"), "OK");
    }));
    assert!(all_of(&with) == all_of(&without), "{:#?}\n{:#?}", with.report, without.report);
}

#[test]
fn what_a_debugger_changes_happens_and_shows() {
    let Some(setup) = setup(Clock::Fast) else { return };
    let commit = commit(&setup.images.dpr);
    let with = finished(debugged(&setup, Side::Dpr, |gdb| {
        assert!(!gdb.ask("qSupported:swbreak+;hwbreak+;vContSupported+").is_empty());
        let reset = gdb.pc();
        assert_eq!(gdb.ask("P0=78563412"), "OK");
        assert_eq!(gdb.word("p0"), 0x1234_5678);
        assert_eq!(gdb.ask("M20000000,4:01020304"), "OK");
        assert_eq!(gdb.word("m20000000,4"), 0x0403_0201);
        assert_eq!(gdb.ask(&format!("Z0,{commit:x},2")), "OK");
        assert!(gdb.ask("c").contains("swbreak"));
        let said = gdb.monitor("reset");
        assert!(said.contains("it runs in Reset"), "{said}");
        assert_eq!(gdb.pc(), reset);
        assert!(gdb.monitor("help").contains("monitor faults"));
        assert!(gdb.monitor("faults moon").contains("no kind of fault"));
        assert!(gdb.monitor("faults ram").contains("copies of the bench"));
        assert!(gdb.monitor("faults air").contains("too little of the run is left"));
        assert!(gdb.monitor("pin P0.02 high").contains("P0.02 is high"));
        assert!(gdb.monitor("pin P0.02 release").contains("P0.02 is low"));
        assert!(gdb.ask("c").contains("swbreak"));
        assert_eq!(gdb.ask("D"), "OK");
    }));
    assert_eq!(with.report.faults.injected.get("power dpr reset pin"), Some(&1), "{:?}", with.report.faults);
    assert_eq!(with.report.violations, Vec::<String>::new());
}

#[test]
fn kill_ends_the_run_and_a_lost_connection_does_not() {
    let Some(setup) = setup(Clock::Fast) else { return };
    let ended = debugged(&setup, Side::Dpr, |gdb| {
        assert!(!gdb.ask("qSupported:swbreak+").is_empty());
        gdb.send(&Client::packet("k"));
        while gdb.from_stub.recv().is_ok() {}
    });
    assert!(matches!(ended, Ended::Killed(0)), "{ended:?}");
    let (to_stub, from_client) = mpsc::channel();
    let (to_client, _from_stub) = mpsc::channel();
    drop(to_stub);
    let mut lost = vec![];
    let connection = InMemory { from_client, to_client, peeked: None };
    let ended = serve(&setup, Side::Dpr, Box::new(connection), &mut (), &mut |text| lost.push(text)).unwrap();
    assert_eq!(all_of(&finished(ended)), all_of(&sim::run(&setup, &mut ()).unwrap()));
    assert_eq!(lost.len(), 1, "{lost:?}");
}

/// Calls `run` with the DPR's firmware on a board alone. The test drives pins in place of the front end.
fn dpr_alone(clock: Clock, run: impl FnOnce(&dyn Fn() -> Box<dyn AnyRun>, &Path)) {
    let Some(path) = image(3, "dpr-fw.elf") else { return };
    let firmware = Firmware::read(&path).unwrap();
    let connected = Connected {
        watched: vec![Pin::new(1, 5), Pin::new(1, 12)],
        driven: vec![Drive { at: 20 * MS, pin: Pin::new(0, 3), level: true }],
        ..Connected::default()
    };
    let limits = Limits { virtual_time: 100 * MS, ..Limits::default() };
    run(&|| Target::Nrf52840.start(clock, &firmware, connected.clone(), limits).unwrap(), &path);
}

fn alone(
    run: Box<dyn AnyRun>,
    connection: InMemory,
    event: &mut dyn FnMut(Event<'_>),
    lost: &mut dyn FnMut(String),
) -> Ended<node::Outcome> {
    let mut say = |_: &str| {};
    let mut session = Session::new(run, true, event, &mut say);
    session.node().halt_at_end(true);
    match emulator_gdb::serve(session, connection, lost).unwrap() {
        Ended::Finished(session) => Ended::Finished(Box::new(session.finish().unwrap().0)),
        Ended::Killed(at) => Ended::Killed(at),
    }
}

fn shown(to: &mut Vec<String>) -> impl FnMut(Event<'_>) + '_ {
    |event| {
        if let Event::Line(_) | Event::Pin(_) = event {
            to.push(format!("{event:?}"));
        }
    }
}

#[test]
fn a_debugger_at_a_board_alone_leaves_its_run_unchanged() {
    for clock in [Clock::Fast, Clock::Optimistic, Clock::Pessimistic] {
        dpr_alone(clock, |start, path| {
            let (mut seen_without, mut seen_with) = (vec![], vec![]);
            let mut run = start();
            while !run.is_over() {
                run.go(&mut shown(&mut seen_without));
            }
            let without = run.finish();
            assert!(without.lines.len() > 1 && seen_without.len() > without.lines.len(), "lines and edges");
            let (images, size) = images(path);
            let script = |gdb: &Client| {
                assert!(!gdb.ask("qSupported:swbreak+;hwbreak+;vContSupported+").is_empty());
                assert_eq!(gdb.pc(), gdb.word("m4,4") & !1);
                assert_eq!(gdb.ask(&format!("Z2,{images:x},{size:x}")), "OK");
                for _ in 0..20 {
                    assert!(gdb.ask("c").contains("watch:"));
                    (0..50).for_each(|_| assert_eq!(&gdb.ask("s")[1..3], "05"));
                }
                // On silicon, a read of some registers of USART2 would change them. A read by gdb must not.
                assert_eq!(gdb.ask("m40004400,40").len(), 0x80);
                assert!(gdb.monitor("time").contains(" ms of 100 ms"));
                assert!(gdb.monitor("faults air").contains("no monitor command"));
                assert!(!gdb.monitor("help").contains("faults"));
                assert_eq!(gdb.ask("D"), "OK");
            };
            let with = finished(attended(script, |connection, lost| {
                alone(start(), connection, &mut shown(&mut seen_with), lost)
            }));
            assert!(with == without, "{clock} clock:\n{with:#?}\n{without:#?}");
            assert!(seen_with == seen_without, "{clock} clock:\n{seen_with:#?}\n{seen_without:#?}");
        });
    }
}

#[test]
fn a_board_alone_halts_where_its_firmware_ends() {
    dpr_alone(Clock::Fast, |start, path| {
        let commit = commit(path);
        let script = |gdb: &Client| {
            assert!(!gdb.ask("qSupported:swbreak+;hwbreak+;vContSupported+").is_empty());
            let start = gdb.pc();
            (0..20).for_each(|_| assert_eq!(&gdb.ask("s")[1..3], "05"));
            let said = gdb.monitor("reset");
            assert!(said.contains("it runs in Reset"), "{said}");
            assert_eq!(gdb.pc(), start);
            assert_eq!(gdb.ask(&format!("Z1,{commit:x},2")), "OK");
            assert!(gdb.ask("c").contains("hwbreak"));
            // No memory is at this address.
            assert_eq!(gdb.ask("Pf=00000060"), "OK");
            assert_eq!(&gdb.ask("c")[1..3], "0b", "SIGSEGV");
            assert_eq!(gdb.pc(), gdb.word("mc,4") & !1, "before the HardFault handler's first instruction");
            assert_eq!(gdb.ask("c"), "W65", "exited with code 101");
        };
        let ended = attended(script, |connection, lost| alone(start(), connection, &mut |_| {}, lost));
        let outcome = finished(ended);
        assert!(outcome.died && outcome.status() == 101, "{outcome:#?}");
        assert_eq!(outcome.resets, 1);
        let ends = outcome.findings.iter().filter(|finding| finding.kind == FindingKind::HardFault).count();
        assert_eq!(ends, 1, "{:#?}", outcome.findings);
    });
}

fn real_gdb(setup: &Setup, script: &[String]) -> (Ended<Outcome>, String) {
    let folder = std::env::temp_dir().join(format!("bench-gdb-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (socket, written) = (folder.join("socket"), folder.join("written"));
    let listener = UnixListener::bind(&socket).unwrap();
    listener.set_nonblocking(true).unwrap();
    let file = File::create(&written).unwrap();
    let mut gdb = Command::new("gdb-multiarch");
    gdb.args(["-nx", "-batch", "-iex", "set pagination off", "-iex", "set confirm off", "-ex", "set language c"]);
    gdb.args(["-ex", &format!("target extended-remote {}", socket.display())]);
    gdb.args(script.iter().flat_map(|command| ["-ex", command]));
    gdb.arg(&setup.images.dpr);
    let mut gdb = gdb.stdin(Stdio::null()).stderr(file.try_clone().unwrap()).stdout(file).spawn().unwrap();
    let connection = accept(&listener, &mut gdb, &written);
    let ended = serve(setup, Side::Dpr, Box::new(connection), &mut (), &mut |text| panic!("{text}")).unwrap();
    gdb.wait().unwrap();
    let text = std::fs::read_to_string(&written).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    (ended, text)
}

/// Accepts gdb's connection; panics if gdb ends before it connects.
fn accept(listener: &UnixListener, gdb: &mut std::process::Child, written: &Path) -> UnixStream {
    loop {
        if let Ok((connection, _)) = listener.accept() {
            return connection;
        }
        if let Some(status) = gdb.try_wait().unwrap() {
            panic!("gdb ended with {status}: {}", std::fs::read_to_string(written).unwrap());
        }
        std::thread::yield_now();
    }
}

#[test]
fn a_session_of_the_real_gdb_leaves_the_run_as_it_is() {
    let Some(setup) = setup(Clock::Fast) else { return };
    if Command::new("gdb-multiarch").arg("--version").stdout(Stdio::null()).status().is_err() {
        not_run("there is no gdb-multiarch", "apt-get install gdb-multiarch");
        return;
    }
    let (commit, (images, _)) = (commit(&setup.images.dpr), images(&setup.images.dpr));
    let script: Vec<String> = [
        &format!("break *{commit:#x}"),
        "continue",
        "backtrace 1",
        "info registers pc xpsr msp d0 fpscr",
        "print $s0",
        // These gdb commands are sent by the editor extension cortex-debug when it attaches.
        "monitor halt",
        // These commands read the images in RAM, and the first words of flash.
        &format!("x/4xw {images:#x}"),
        "x/2xw 0",
        &format!("watch *(unsigned *)({images:#x} + 8)"),
        "delete 1",
        "continue",
        "stepi",
        "stepi",
        "next",
        "info watchpoints",
        "delete",
        &format!("tbreak *{commit:#x}"),
        "continue",
        "finish",
        "print/x *(unsigned *)0xe000ed00",
        "detach",
    ]
    .map(str::to_owned)
    .into();
    let (ended, text) = real_gdb(&setup, &script);
    let place = format!("{commit:#010x}");
    let lines = [
        "Breakpoint 1, ",
        "commit.rs",
        "Hardware watchpoint 2",
        "Old value = ",
        "New value = ",
        "Temporary breakpoint 3, ",
    ];
    for line in lines.into_iter().chain([place.trim_start_matches("0x00"), "= 0x410fc241", "detached"]) {
        assert!(text.contains(line), "no \"{line}\" in:\n{text}");
    }
    let without = sim::run(&setup, &mut ()).unwrap();
    assert!(all_of(&finished(ended)) == all_of(&without), "{text}");
}
