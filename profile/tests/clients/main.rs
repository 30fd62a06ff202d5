//! Compares the flight controller's client in Rust and in C: the same transactions must give the same reports, byte for
//! byte. In `profile/c/tests/recorded`, `NAME.tape` has the transactions and `NAME.txt` what a client writes for them.
//! After a change of the wire format, of the client or of `recordings.rs`, `RECORD=1 cargo test -p profile --test
//! clients` writes these files anew; read the differences before you commit them.
use std::fs;

mod c;
mod fuzz;
mod guide;
mod recordings;
#[path = "../support/mod.rs"]
mod support;

use c::{Build, WARNINGS, compile, folder};
use support::tape::play;

// Shows CLI-4, CLI-5.
#[test]
fn both_clients_reproduce_the_recordings() {
    let recorded = folder().join("tests/recorded");
    let mut names = vec![];
    for (name, tape) in recordings::all() {
        let said = play(&tape.0, |_| {});
        let (tape_path, text_path) = (recorded.join(format!("{name}.tape")), recorded.join(format!("{name}.txt")));
        if std::env::var_os("RECORD").is_some() {
            fs::write(&tape_path, &tape.0).expect("written");
            fs::write(&text_path, &said).expect("written");
        }
        let remedy = "run `RECORD=1 cargo test -p profile --test clients` and read the difference";
        assert!(fs::read(&tape_path).is_ok_and(|found| found == tape.0), "{name}.tape is not current: {remedy}");
        let text = fs::read_to_string(&text_path).unwrap_or_default();
        assert_same(&format!("{name}.txt, recorded and in Rust"), &text, &said);
        for build in [Build::Optimised, Build::Sanitised] {
            assert_same(&format!("{name}, recorded and in C ({build:?})"), &text, &build.play(&tape.0));
        }
        names.extend([format!("{name}.tape"), format!("{name}.txt")]);
    }
    names.sort();
    let mut found: Vec<_> = fs::read_dir(&recorded)
        .expect("the recordings")
        .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
        .collect();
    found.sort();
    assert_eq!(found, names, "there is nothing else in {}", recorded.display());
}

fn assert_same(what: &str, left: &str, right: &str) {
    for (number, (left, right)) in left.lines().zip(right.lines()).enumerate() {
        assert_eq!(left, right, "{what}: line {}", number + 1);
    }
    assert_eq!(left.lines().count(), right.lines().count(), "{what}: lines");
    assert!(left == right, "{what}: line ends");
}

#[test]
fn a_recording_shows_every_verdict() {
    let mut seen = [0; 12];
    for (_, tape) in recordings::all() {
        play(&tape.0, |told| seen[usize::from(told.report.verdict as u8)] += 1);
    }
    assert!(seen[0] == 0 && seen[1..].iter().all(|count| *count > 0), "{seen:?}");
}

#[test]
fn the_header_serves_c_plus_plus_and_c_that_includes_it_twice() {
    let source = c::scratch("twice.c");
    fs::write(&source, "#include \"horus_dpr.h\"\n#include \"horus_dpr.h\"\n").expect("written");
    let source = source.to_str().expect("a path of text");
    compile(&[WARNINGS, &["-I.", "-fsyntax-only", source]].concat());
    for source in [source, "horus_dpr.c"] {
        let strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I.", "-fsyntax-only", source];
        compile(&[&["-x", "c++", "-std=c++11"][..], &strict].concat());
    }
    let sources = [folder().join("horus_dpr.h"), folder().join("horus_dpr.c"), folder().join("horus_dpr_crc.h")];
    for source in sources {
        let text = fs::read_to_string(&source).expect("readable");
        assert!(text.starts_with("/* SPDX-License-Identifier: MIT OR Apache-2.0\n"), "{}", source.display());
    }
}
