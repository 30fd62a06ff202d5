//! Tests a firmware project outside this repository with the command alone. The project is built in a folder of its
//! own, and is run with scripts on both microcontrollers.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

const MANIFEST: &str = r#"
[package]
name = "bell"
version = "0.1.0"
edition = "2024"

[dependencies]
cortex-m = "0.7"
cortex-m-rt = "0.7"

[features]
nrf52840 = []

[workspace]
"#;

const CONFIG: &str = r#"
[build]
target = "thumbv7em-none-eabihf"

[target.thumbv7em-none-eabihf]
rustflags = ["-C", "link-arg=-Tlink.x"]
"#;

const SOURCE: &str = include_str!("project/bell.rs");

/// One of the microcontrollers, and the pins that the project's firmware uses on it.
struct Part {
    name: &'static str,
    memory: &'static str,
    button: &'static str,
    bell: &'static str,
    sends: &'static str,
    hears: &'static str,
}

const NRF52840: Part = Part {
    name: "nrf52840",
    memory: "MEMORY { FLASH : ORIGIN = 0, LENGTH = 1M RAM : ORIGIN = 0x20000000, LENGTH = 256K }\n",
    button: "P0.11",
    bell: "P0.13",
    sends: "P0.06",
    hears: "P0.08",
};

const STM32F429ZI: Part = Part {
    name: "stm32f429zi",
    memory: "MEMORY { FLASH : ORIGIN = 0x08000000, LENGTH = 2M RAM : ORIGIN = 0x20000000, LENGTH = 192K }\n",
    button: "PA0",
    bell: "PB7",
    sends: "PD5",
    hears: "PD6",
};

impl Part {
    /// Replaces the names of the pins' functions in a script by the names of the pins.
    fn script(&self, text: &str) -> String {
        let pins = [("BUTTON", self.button), ("BELL", self.bell), ("SENDS", self.sends), ("HEARS", self.hears)];
        pins.iter().fold(text.to_owned(), |text, (word, pin)| text.replace(word, pin))
    }
}

/// Returns the folder with the firmware that was built for both microcontrollers.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        // The folder is the same for each run in one checkout, so that a second run does not build anew.
        let mut checkout = DefaultHasher::new();
        env!("CARGO_MANIFEST_DIR").hash(&mut checkout);
        let folder = std::env::temp_dir().join(format!("emulator-foreign-{:016x}", checkout.finish()));
        std::fs::create_dir_all(folder.join("src")).unwrap();
        std::fs::create_dir_all(folder.join(".cargo")).unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
        write("Cargo.toml", MANIFEST);
        write(".cargo/config.toml", CONFIG);
        write("src/main.rs", SOURCE);
        std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../Cargo.lock"), folder.join("Cargo.lock"))
            .unwrap();
        for part in [NRF52840, STM32F429ZI] {
            write("memory.x", part.memory);
            let mut command = Command::new(env!("CARGO"));
            // The variables that cargo sets for this test's package are removed, because they would be wrong for the
            // other project.
            for (key, _) in std::env::vars_os() {
                let name = key.to_string_lossy();
                if name.starts_with("CARGO_") && name != "CARGO_HOME" {
                    command.env_remove(&key);
                }
            }
            command.args(["build", "--quiet", "--offline", "--target-dir", part.name]).current_dir(&folder);
            if part.name == NRF52840.name {
                command.args(["--features", part.name]);
            }
            let built = command.output().unwrap();
            assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
            std::fs::copy(
                folder.join(part.name).join("thumbv7em-none-eabihf/debug/bell"),
                folder.join(format!("{}.elf", part.name)),
            )
            .unwrap();
        }
        folder
    })
}

fn emulator(part: &Part, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_emulator"));
    command.arg("run").arg(folder().join(format!("{}.elf", part.name))).args(["--part", part.name]).args(arguments);
    command.current_dir(folder());
    command
}

fn run(part: &Part, arguments: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = emulator(part, arguments).output().unwrap();
    (status.code(), String::from_utf8_lossy(&stdout).into_owned(), String::from_utf8_lossy(&stderr).into_owned())
}

fn scripted(part: &Part, name: &str, script: &str, arguments: &[&str]) -> (Option<i32>, String, String) {
    let name = format!("{name}-{}.script", part.name);
    std::fs::write(folder().join(&name), part.script(script)).unwrap();
    run(part, &[&["--script", &name], arguments].concat())
}

/// Returns the example script that stands in the command's README, indented by four blanks. The script's first line is
/// `drive`.
fn readme() -> String {
    let lines = include_str!("../README.md").lines().skip_while(|line| !line.starts_with("    drive"));
    lines.map_while(|line| line.strip_prefix("    ")).collect::<Vec<_>>().join("\n")
}

const PASSES: &str = r#"
# The button is open, and the bell is silent.
drive BUTTON high
uart HEARS 115200
expect SENDS "ready\r\n" within 10 ms
check BELL low
never BELL rise for 20 ms

drive BUTTON low
expect BELL rise within 1 ms
drive BUTTON high
expect BELL fall within 1 ms
expect log "rang" within 5 ms
send HEARS "?"
expect SENDS "1\r\n" within 1 ms       # one ring so far
reset
expect restart within 1 ms
expect SENDS "ready" within 10 ms
send HEARS "!"
expect exit 0 within 5 ms
pass
"#;

#[test]
fn a_script_tests_the_firmware_of_a_project_elsewhere_on_both_parts() {
    for part in [NRF52840, STM32F429ZI] {
        let (status, out, err) = scripted(&part, "passes", PASSES, &[]);
        assert_eq!(status, Some(0), "{out}{err}");
        let answers: Vec<&str> = out.lines().filter(|line| line.starts_with("ok ")).collect();
        assert_eq!(answers.len(), 18, "{out}");
        assert!(answers[17].starts_with("ok 21 at ") && answers[17].ends_with(" ms: pass"), "{out}");
        assert!(out.contains("ms  rang") && err.contains(", 0 findings, 1 restart,"), "{out}{err}");
        assert_eq!(scripted(&part, "passes", PASSES, &[]).1, out, "another run is the same");
    }
}

#[test]
fn the_script_in_the_readme_passes() {
    let (status, out, err) = scripted(&NRF52840, "readme", &readme(), &[]);
    assert_eq!(status, Some(0), "{out}{err}");
    let (first, last) = (out.lines().next(), out.lines().last());
    assert_eq!(first, Some("ok 1 at 0.000000 ms: drive P0.11 high"));
    assert!(last.unwrap().starts_with("ok 10 at ") && last.unwrap().ends_with("ms: pass"), "{out}");
}

#[test]
fn a_script_fails_at_the_line_that_does_not_come_true() {
    let start = "drive BUTTON high\nuart HEARS 115200\nexpect SENDS \"ready\" within 10 ms\n";
    for part in [NRF52840, STM32F429ZI] {
        for (name, line, words) in [
            ("edge", "expect BELL rise within 20 ms", "expected BELL to rise within 20 ms: BELL stayed low; at "),
            ("text", "expect SENDS \"OK\" within 3 ms", "expected \"OK\" from SENDS within 3 ms: \"\\r\\n\" came; at "),
            ("log", "expect log \"rang\" within 3 ms", "expected \"rang\" in the log within 3 ms: nothing came; at "),
            ("level", "check BELL high", "expected BELL high: it is low"),
            ("never", "never SENDS \"\\n\" for 1 ms", "expected not \"\\n\" from SENDS for 1 ms: it came at "),
            ("exit", "expect exit 0 within 3 ms", "expected exit status 0 within 3 ms: it did not come; at "),
            ("failed", "fail \"no bell\"", "no bell"),
        ] {
            let end = if line.starts_with("fail") { "" } else { "pass\n" };
            let (status, out, err) = scripted(&part, name, &format!("{start}{line}\n{end}"), &[]);
            let words = part.script(words);
            assert_eq!(status, Some(1), "{name}: {out}{err}");
            assert!(err.contains(&format!("error: {name}-{}.script line 4: {words}", part.name)), "{name}: {err}");
            assert!(out.contains("\nfailed 4 at ") && !out.contains("pass"), "{name}: {out}");
        }
        let exits = format!("{start}send HEARS \"!\"\nrun 10 ms\npass\n");
        let (status, _, err) = scripted(&part, "exits", &exits, &[]);
        assert_eq!(status, Some(1), "{err}");
        assert!(err.contains("line 5: the firmware exited with status 0"), "{err}");
    }
}

#[test]
fn a_wrong_command_line_is_told_in_the_fields_words() {
    let nrf = NRF52840;
    for (script, words) in [
        ("drive P0.11 up\npass\n", "wrong-nrf52840.script line 1: expected high or low, not up"),
        ("\nwait PB7\npass\n", "line 2: expected watch, drive, release"),
        ("send P0.08 \"x\"\npass\n", "line 1: expected a line like \"uart P0.08 115200\" before"),
        ("run 1 ms\n", "line 2: expected pass or fail, and the script ends"),
        ("pass\nrun 1 ms\n", "line 2: the script ended with the verdict of line 1"),
    ] {
        let (status, out, err) = scripted(&nrf, "wrong", script, &[]);
        assert_eq!((status, out.as_str()), (Some(2), ""), "{err}");
        assert!(err.contains(words), "{err}");
    }
    let stm32 = folder().join("stm32f429zi.elf");
    let source = folder().join("src/main.rs");
    let cases = [
        (
            vec!["run", stm32.to_str().unwrap(), "--part", "nrf52840"],
            "where the nRF52840 has no memory: is it linked for",
        ),
        (
            vec!["run", "nrf52840.elf", "--part", "stm32f429zi"],
            "nothing at 0x08000000, where the STM32F429ZI has its flash",
        ),
        (vec!["run", source.to_str().unwrap(), "--part", "nrf52840"], "not an ELF file"),
        (vec!["run", "absent.elf", "--part", "nrf52840"], "absent.elf"),
        (vec!["run", "nrf52840.elf", "--part", "stm32f407"], "no model of a part called stm32f407: take nrf52840 or"),
        (vec!["run", "nrf52840.elf"], "--part"),
        (vec!["run", "nrf52840.elf", "--part", "nrf52840", "--script", "absent"], "could not read absent"),
        (vec!["run", "nrf52840.elf", "--part", "nrf52840", "--pin", "PA5"], "no pin PA5: it has P0.00 to P0.31"),
        (vec!["run", "nrf52840.elf", "--part", "nrf52840", "--trace", "trace.txt"], "ends in .vcd or in .fst"),
    ];
    for (arguments, words) in cases {
        let ran = Command::new(env!("CARGO_BIN_EXE_emulator")).args(&arguments).current_dir(folder()).output().unwrap();
        let err = String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(2), "{arguments:?}: {err}");
        assert!(err.contains(words), "{arguments:?}: {err}");
    }
}

#[test]
fn a_program_gets_an_answer_to_each_line_of_its_script() {
    let part = NRF52840;
    let mut emulator = emulator(&part, &["--script", "-"]);
    let mut emulator = emulator.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut input = emulator.stdin.take().unwrap();
    let mut output = BufReader::new(emulator.stdout.take().unwrap()).lines();
    let mut ask = |line: &str| {
        writeln!(input, "{}", part.script(line)).unwrap();
        let is_answer = |line: &String| line.starts_with("ok ") || line.starts_with("failed ");
        output.by_ref().map(Result::unwrap).find(is_answer).unwrap()
    };
    assert_eq!(ask("drive BUTTON low"), "ok 1 at 0.000000 ms: drive P0.11 low");
    assert!(ask("expect BELL rise").starts_with("ok 2 at "));
    assert!(ask("run 1 ms").starts_with("ok 3 at "));
    assert!(ask("expect BELL fall within 2 ms").starts_with("failed 4 at "));
    drop(input);
    assert_eq!(emulator.wait().unwrap().code(), Some(1));
    // Input that ends before a verdict does not count as a success.
    let mut silent = self::emulator(&part, &["--script", "-"]);
    let silent = silent.stdin(Stdio::null()).output().unwrap();
    assert_eq!(silent.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&silent.stderr).contains("standard input line 1: expected pass or fail"));
}

#[test]
fn a_run_without_a_script_ends_as_its_options_say() {
    for part in [NRF52840, STM32F429ZI] {
        let (status, out, err) = run(&part, &["--seconds", "0.01", "--uart", &format!("{}=-", part.sends)]);
        assert_eq!(status, Some(0), "{out}{err}");
        assert!(out.contains("ms  ready\n") && !out.contains("ok "), "{out}");
        let (status, _, err) = run(&part, &["--limit", "0.01"]);
        assert_eq!(status, Some(1), "{err}");
        assert!(err.contains("still running after 0.01 s of virtual time (--limit)"), "{err}");
    }
}

#[test]
fn a_trace_has_the_pins_and_the_handlers_of_the_run() {
    for part in [NRF52840, STM32F429ZI] {
        let trace = format!("{}.vcd", part.name);
        let (status, out, err) = scripted(&part, "traced", PASSES, &["--trace", &trace]);
        assert_eq!(status, Some(0), "{out}{err}");
        let text = std::fs::read_to_string(folder().join(trace)).unwrap();
        // A value change dump gives each signal a code. The closure finds the changes of a signal by its code.
        let changes = |name: &str| {
            let name = format!(" {name} $end");
            let code = text.lines().find(|line| line.ends_with(&name)).and_then(|line| line.split(' ').nth(3)).unwrap();
            let is_change =
                |line: &&str| line.len() == 1 + code.len() && line.ends_with(code) && !line.starts_with('$');
            text.lines().filter(is_change).map(|line| line.chars().next().unwrap()).collect::<String>()
        };
        // A pull resistor first holds the button's pin high. Then the script drives the pin low, and a restart releases
        // it.
        assert!(changes(&part.button.replace('.', "_")).contains("101"), "{}", changes(&part.button.replace('.', "_")));
        assert!(changes(&part.bell.replace('.', "_")).contains("010"), "{}", changes(&part.bell.replace('.', "_")));
        assert!(changes("SysTick").matches("10").count() > 20, "{}", changes("SysTick"));
    }
}
