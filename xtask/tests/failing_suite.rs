//! Tests that a failing suite on a board makes the command fail, with the failure reported through a debug probe.
//!
//! The board is one of the bench (`--probe bench`).
#![cfg(feature = "probe")]

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn suite() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut command = Command::new(env!("CARGO"));
    command.args(["test", "--no-run", "--release", "--target", "thumbv7em-none-eabihf", "--message-format=json"]);
    command.args(["--package", "on-target-tests", "--test", "failing", "--features", "failing"]);
    // With another linker cargo would compile all crates of this target again, here and for the next firmware. Without
    // flip-link the suite would do as well, since its stack never overflows.
    let tools = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("tools").join("bin");
    if tools.join("flip-link").exists() {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let folders = std::iter::once(tools).chain(std::env::split_paths(&path));
        command.env("PATH", std::env::join_paths(folders).unwrap());
    } else {
        command.args(["--config", "target.thumbv7em-none-eabihf.linker='rust-lld'"]);
    }
    // Cargo's variables for this test's package would be wrong for the suite.
    for (key, _) in std::env::vars_os() {
        let name = key.to_string_lossy();
        if name.starts_with("CARGO_") && name != "CARGO_HOME" && name != "CARGO_TARGET_DIR" {
            command.env_remove(&key);
        }
    }
    let built = command.env("DEFMT_LOG", "info").current_dir(root).stderr(Stdio::inherit()).output().unwrap();
    assert!(built.status.success(), "the suite is not built");
    let messages = String::from_utf8(built.stdout).unwrap();
    messages
        .lines()
        .filter_map(|line| {
            serde_json::from_str::<serde_json::Value>(line).unwrap()["executable"].as_str().map(Into::into)
        })
        .next_back()
        .expect("cargo names the image")
}

#[test]
fn a_failing_suite_reports_its_message_and_earlier_restarts() {
    let folder = std::env::temp_dir().join(format!("failing-suite-{}", std::process::id()));
    let ran = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["run", "--board", "dpr", "--on", "hardware", "--probe", "bench", "--erase-all"])
        .arg(suite())
        .env("CARGO_TARGET_DIR", &folder)
        .output()
        .unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let (out, err) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    let said = format!("{out}\n{err}");
    assert_eq!(ran.status.code(), Some(1), "{said}");
    assert_eq!(out.matches("(1/3) running `the_watchdog_bites_once`").count(), 2, "{said}");
    assert_eq!(out.matches("(2/3) running `one_and_one_are_three`").count(), 1, "{said}");
    assert!(out.contains("this test is made to fail"), "{said}");
    assert!(!out.contains("it went on") && !out.contains("passed"), "{said}");
    assert_eq!(err.matches("the part restarted").count(), 1, "{said}");
    assert_eq!(err.matches("error: the image ended in a HardFault in cortex_m::asm::udf").count(), 1, "{said}");
}
