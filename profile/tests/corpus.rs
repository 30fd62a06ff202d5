//! Replays the fuzz corpus, so that every ordinary test run tests every committed input.
use std::{collections::BTreeSet, fs, path::PathBuf};

use crate::support;

use support::{invariants, seeds};

fn corpus(target: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "fuzz", "corpus", target].iter().collect()
}

#[test]
fn every_input_of_the_corpus_keeps_the_invariants_of_its_parser() {
    for (target, check) in invariants::ALL {
        let mut inputs: Vec<_> = fs::read_dir(corpus(target))
            .unwrap_or_else(|error| panic!("{}: {error}", corpus(target).display()))
            .map(|entry| entry.expect("readable").path())
            .collect();
        inputs.sort();
        assert!(!inputs.is_empty(), "{target} has no corpus");
        for input in inputs {
            println!("{}", input.display());
            check(&fs::read(&input).expect("readable"));
        }
    }
}

#[test]
fn every_input_keeps_the_invariants_of_every_other_parser_too() {
    for (_, inputs) in seeds::all() {
        for (_, bytes) in inputs {
            for (_, check) in invariants::ALL {
                check(&bytes);
            }
        }
    }
}

#[test]
fn the_committed_corpus_holds_the_seeds() {
    for (target, inputs) in seeds::all() {
        for (name, bytes) in inputs {
            let path = corpus(target).join(&name);
            let committed = fs::read(&path).unwrap_or_default();
            assert!(
                committed == bytes && path.exists(),
                "{} is not what its seed is: run `cargo run -p profile --example corpus`",
                path.display()
            );
        }
    }
}

#[test]
fn every_parser_has_a_fuzz_target_and_seeds() {
    let parsers: BTreeSet<_> = invariants::ALL.iter().map(|(name, _)| (*name).to_owned()).collect();
    let seeded: BTreeSet<_> = seeds::all().iter().map(|(name, _)| (*name).to_owned()).collect();
    let targets: BTreeSet<_> = fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz/fuzz_targets"))
        .expect("the fuzz targets")
        .map(|entry| entry.expect("readable").path())
        .map(|path| path.file_stem().expect("a file").to_string_lossy().into_owned())
        .collect();
    assert_eq!(parsers, targets);
    assert_eq!(parsers, seeded);
}
