//! Tests the runner from another project's folder, as in docs/bench.md#your-own-firmware: `cargo run` builds the
//! project's firmware and runs it on a board of the bench.
//!
//! The project is made in a folder outside this workspace, with crates of this workspace's lock file only.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Output, Stdio};

const MANIFEST: &str = r#"
[package]
name = "blinky"
version = "0.1.0"
edition = "2024"

[dependencies]
cortex-m = "0.7"
cortex-m-rt = "0.7"

[workspace]
"#;

/// Cargo's folder for what it builds of this project, and of the projects of `emulator/command/tests/foreign.rs`, which
/// need the same macros.
const TARGET_DIR: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/foreign");

const MEMORY: &str = "MEMORY { FLASH : ORIGIN = 0, LENGTH = 1M RAM : ORIGIN = 0x20000000, LENGTH = 256K }\n";

/// The firmware prints a greeting through semihosting, makes two pulses on P0.13 while P0.11 is low, and runs for ever.
const MAIN: &str = r#"
#![no_std]
#![no_main]

use core::arch::asm;
use core::ptr::{read_volatile, write_volatile};

const P0: usize = 0x5000_0000;

#[cortex_m_rt::entry]
fn main() -> ! {
    let text = b"hello from another project\n\0";
    unsafe {
        asm!("bkpt 0xAB", inout("r0") 4 => _, in("r1") text.as_ptr());
        // PIN_CNF[11]: input, connected. DIRSET.
        write_volatile((P0 + 0x700 + 4 * 11) as *mut u32, 0);
        write_volatile((P0 + 0x518) as *mut u32, 1 << 13);
        let low = read_volatile((P0 + 0x510) as *const u32) >> 11 & 1 == 0;
        for _ in 0..if low { 2 } else { 0 } {
            write_volatile((P0 + 0x508) as *mut u32, 1 << 13);
            cortex_m::asm::delay(64_000);
            write_volatile((P0 + 0x50C) as *mut u32, 1 << 13);
            cortex_m::asm::delay(64_000);
        }
    }
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    cortex_m::asm::udf()
}
"#;

/// Runs the project's firmware with the real gdb. Returns the output of the run, without the lines about connecting
/// gdb, and the output of gdb.
fn run_with_gdb(arguments: &str, script: &[&str]) -> (Output, String) {
    let elf = Path::new(TARGET_DIR).join("thumbv7em-none-eabihf/debug/blinky");
    let mut run = Command::new(env!("CARGO_BIN_EXE_xtask"));
    run.args(["run", "--board", "dpr", "--gdb", "--port", "0"]).args(arguments.split(' ')).arg(&elf);
    let mut run = run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut errors = BufReader::new(run.stderr.take().unwrap());
    let mut line = String::new();
    errors.read_line(&mut line).unwrap();
    let address = line.split_once("dpr is halted at power-on and waits at ").expect(&line).1.trim_end_matches(":\n");
    let mut gdb = Command::new("gdb-multiarch");
    gdb.args(["-nx", "-batch", "-iex", "set pagination off", "-iex", "set confirm off"]).arg(&elf);
    gdb.args(["-ex", &format!("target remote {address}")]).args(script.iter().flat_map(|command| ["-ex", command]));
    let gdb = gdb.stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&gdb.stdout).into_owned() + &String::from_utf8_lossy(&gdb.stderr);
    let mut stderr = vec![];
    let how = line.clone();
    line.clear();
    errors.read_line(&mut line).unwrap();
    assert!(line.contains("gdb-multiarch ") && line.contains("target remote 127.0.0.1:"), "{how}{line}");
    errors.read_to_end(&mut stderr).unwrap();
    let ran = run.wait_with_output().unwrap();
    (Output { stderr, ..ran }, said)
}

fn cargo_run(folder: &Path, arguments: &str) -> Output {
    let runner = env!("CARGO_BIN_EXE_xtask");
    let config = format!(
        "[build]\ntarget = \"thumbv7em-none-eabihf\"\n\n[target.thumbv7em-none-eabihf]\n\
         runner = \"{runner} run --board dpr {arguments}\"\nrustflags = [\"-C\", \"link-arg=-Tlink.x\"]\n"
    );
    std::fs::create_dir_all(folder.join(".cargo")).unwrap();
    std::fs::write(folder.join(".cargo/config.toml"), config).unwrap();
    let mut command = Command::new(env!("CARGO"));
    // Cargo's variables for this test's package would be wrong for the other project.
    for (key, _) in std::env::vars_os() {
        let name = key.to_string_lossy();
        if name.starts_with("CARGO_") && name != "CARGO_HOME" {
            command.env_remove(&key);
        }
    }
    command.args(["run", "--quiet", "--offline", "--target-dir", TARGET_DIR]).current_dir(folder).output().unwrap()
}

#[test]
fn a_project_elsewhere_runs_its_firmware_on_the_bench_by_cargo_run() {
    let folder = std::env::temp_dir().join(format!("other-project-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("src")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("Cargo.toml", MANIFEST);
    write("memory.x", MEMORY);
    write("src/main.rs", MAIN);
    let lock = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.lock");
    std::fs::copy(lock, folder.join("Cargo.lock")).unwrap();

    let ran = cargo_run(&folder, "--seconds 0.1 --pin P0.13 --drive P0.11=0");
    let (out, err) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    assert_eq!(ran.status.code(), Some(0), "{out}{err}");
    assert!(out.contains("ms  hello from another project"), "{out}{err}");
    let edges = |level: &str| out.lines().filter(|line| line.ends_with(&format!("P0.13 {level}"))).count();
    assert_eq!((edges("high"), edges("low")), (2, 3), "low when it becomes an output, then two pulses: {out}");
    assert!(err.contains("still running after 0.1 s of virtual time, as it should (--seconds)"), "{err}");
    // The stack gets all RAM that the statics leave free. The firmware uses a little of it.
    let stack = err.split("stack ").nth(1).and_then(|rest| rest.split(" bytes at worst").next()).unwrap();
    let (used, size) = stack.split_once(" of ").unwrap();
    let (used, size): (usize, usize) = (used.parse().unwrap(), size.parse().unwrap());
    assert!((8..512).contains(&used) && (200 << 10..=256 << 10).contains(&size), "{stack}");

    if Command::new("gdb-multiarch").arg("--version").stdout(Stdio::null()).status().is_err() {
        assert!(std::env::var_os("CI").is_none(), "there is no gdb-multiarch: apt-get install gdb-multiarch");
        eprintln!("not run: there is no gdb-multiarch: apt-get install gdb-multiarch");
    } else {
        // The run's output and exit status must be the same with gdb.
        let looks = ["set language c", "tbreak main", "continue", "info registers pc", "monitor pin P0.11"];
        let watches = ["watch *(unsigned *)0x50000508", "continue", "stepi", "monitor pin P0.13", "delete", "continue"];
        let script = [&looks[..], &watches].concat();
        let (with, said) = run_with_gdb("--seconds 0.1 --pin P0.13 --drive P0.11=0", &script);
        let both = |ran: &Output| {
            let is_of_the_run = |line: &&str| !line.ends_with("a second of this machine");
            let lines = |text: &str| text.lines().filter(is_of_the_run).map(str::to_owned).collect::<Vec<_>>();
            let text = |bytes: &[u8]| lines(&String::from_utf8_lossy(bytes));
            (ran.status.code(), text(&ran.stdout), text(&ran.stderr))
        };
        assert_eq!(both(&with), both(&ran), "{said}");
        for words in
            ["Temporary breakpoint 1, ", "P0.11 is low", "Hardware watchpoint 2", "P0.13 is ", "exited normally"]
        {
            assert!(said.contains(words), "no \"{words}\" in:\n{said}");
        }
        let (ended, said) = run_with_gdb("--limit 0.1 --pin P0.13", &["tbreak main", "continue", "kill"]);
        let err = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{err}{said}");
        assert!(err.contains("the debugger ended the run after 0.0"), "{err}{said}");
    }

    let ran = cargo_run(&folder, "--limit 0.1 --pin P0.13 --drive P0.11=1");
    let (out, err) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    assert_eq!(ran.status.code(), Some(124), "{out}{err}");
    assert!(!out.contains("P0.13 high") && err.contains("say --seconds instead"), "{out}{err}");

    let ran = cargo_run(&folder, "--pin PA5");
    let err = String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(1), "{err}");
    assert!(err.contains("--pin: the nRF52840 has no pin PA5: it has P0.00 to P0.31, P1.00 to P1.15"), "{err}");
    std::fs::remove_dir_all(&folder).unwrap();
}
