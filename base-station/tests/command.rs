//! Tests which arguments `horus-base` refuses, and of what it warns.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> (bool, String) {
    let Output { status, stderr, .. } =
        Command::new(env!("CARGO_BIN_EXE_horus-base")).args(arguments).output().unwrap();
    (status.success(), String::from_utf8(stderr).unwrap())
}

fn file(name: &str, text: &str) -> PathBuf {
    // Removed when the test's thread ends.
    thread_local!(static FOLDER: tempfile::TempDir = tempfile::tempdir().unwrap());
    let file = FOLDER.with(|folder| folder.path().join(name));
    fs::write(&file, text).unwrap();
    file
}

#[test]
fn a_key_is_not_taken_beside_lines_that_have_no_signatures() {
    let key = file("key-beside", &"0".repeat(64));
    let key = key.to_str().unwrap();
    for line in [["--datagrams", "127.0.0.1:0"], ["--plain-serial", "/dev/null"]] {
        let (began, said) = run(&[&["serve", "--key", key][..], &line].concat());
        assert!(!began && said.contains("cannot be used with"), "{said}");
    }
    let (began, said) = run(&["serve", "--key", file("no-key", "12").to_str().unwrap()]);
    assert!(!began && said.contains("a key is 64 hexadecimal digits"), "{said}");
}

#[test]
fn uplinks_need_a_key_and_a_heartbeat_is_asked_for() {
    let (began, said) = run(&["serve", "--uplink"]);
    assert!(!began && said.contains("--key <FILE>"), "{said}");
    let (began, said) = run(&["serve", "--heartbeat-to", "127.0.0.1:14555"]);
    assert!(!began && said.contains("--heartbeat"), "{said}");
    let (began, said) = run(&["serve", "--heartbeat", "--system-id", "0"]);
    assert!(!began && said.contains("--system-id"), "{said}");
}

#[test]
fn commands_to_a_hold_need_a_key_and_exclude_uplinks() {
    let (began, said) = run(&["serve", "--hold-commands"]);
    assert!(!began && said.contains("--key <FILE>"), "{said}");
    let key = file("key-of-a-hold", &"0".repeat(64));
    let on = |more: &[&str]| {
        let serve = ["serve", "--udp", "127.0.0.1:0", "--http", "127.0.0.1:0", "--seconds", "0", "--hold-commands"];
        run(&[&serve[..], &["--key", key.to_str().unwrap()], more].concat())
    };
    let (began, said) = on(&["--uplink"]);
    assert!(!began && said.contains("cannot be used with"), "{said}");
    let (began, said) = on(&[]);
    assert!(began && said.contains("whoever opens the page can command drones' active holds"), "{said}");
}

#[test]
fn a_page_for_other_machines_requires_a_login_or_explicit_consent() {
    let udp = ["serve", "--udp", "127.0.0.1:0", "--seconds", "0"];
    let on = |more: &[&str]| run(&[&udp[..], more].concat());
    let (began, said) = on(&["--http", "0.0.0.0:0"]);
    assert!(!began && said.contains("--page-login FILE") && said.contains("--page-open"), "{said}");
    let login = file("login", "user\npassword\n");
    for more in [&["--page-open"][..], &["--page-login", login.to_str().unwrap()]] {
        let (began, said) = on(&[&["--http", "0.0.0.0:0"], more].concat());
        assert!(began, "{said}");
    }
    assert!(on(&["--http", "127.0.0.1:0"]).0);
}

#[test]
fn a_broker_that_is_given_a_password_unencrypted_is_warned_of() {
    let login = file("broker-login", "user\npassword\n");
    let to = ["--broker", "127.0.0.1:9", "--login", login.to_str().unwrap(), "--seconds", "0"];
    let (began, said) = run(&[&["subscribe", "--http", "127.0.0.1:0"][..], &to].concat());
    assert!(began && said.contains("user and password go to the broker unencrypted"), "{said}");
}
