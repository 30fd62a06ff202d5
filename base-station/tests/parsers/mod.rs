//! Tests every parser of a carrier's bytes on its fuzz corpus, and on slightly changed inputs. `cargo xtask fuzz` tests
//! many more.

mod bodies;
use crate::common;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use common::Drawn;

const CHANGED: usize = 3_000;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz").join(name)
}

fn names(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    entries.map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned()).collect()
}

fn corpus(parser: &str) -> Vec<Vec<u8>> {
    let folder = folder("corpus").join(parser);
    names(&folder).iter().map(|name| std::fs::read(folder.join(name)).unwrap()).collect()
}

fn changed(drawn: &mut Drawn, input: &[u8], other: &[u8]) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for _ in 0..=drawn.below(4) {
        let at = drawn.below(bytes.len() as u64 + 1) as usize;
        let length = drawn.below(64) as usize;
        match drawn.below(6) {
            0 if at < bytes.len() => bytes[at] ^= 1 << drawn.below(8),
            1 if at < bytes.len() => bytes[at] = [0, 1, 0x7F, 0x80, 0xFD, 0xFF][drawn.below(6) as usize],
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..(at + length).min(bytes.len()))),
            4 => {
                let from = drawn.below(other.len() as u64 + 1) as usize;
                let piece = other[from..(from + length).min(other.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                let piece = bytes[at..(at + length).min(bytes.len())].to_vec();
                bytes.extend(piece);
            }
        }
    }
    bytes
}

#[test]
fn no_parser_fails_on_any_corpus_or_on_mutations_of_its_own() {
    for (nth, (parser, body)) in bodies::ALL.into_iter().enumerate() {
        body(&[]);
        for (other, _) in bodies::ALL {
            corpus(other).iter().for_each(|input| body(input));
        }
        let inputs = corpus(parser);
        let mut drawn = Drawn(nth as u64);
        for _ in 0..CHANGED {
            let [input, other] = [0; 2].map(|_| &inputs[drawn.below(inputs.len() as u64) as usize]);
            body(&changed(&mut drawn, input, other));
        }
    }
}

#[test]
fn every_parser_has_a_fuzz_target_and_the_corpus_holds_its_seeds() {
    let parsers: BTreeSet<String> = bodies::ALL.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(names(&folder("fuzz_targets")), parsers);
    assert_eq!(names(&folder("corpus")), parsers);
    for (parser, name, bytes) in bodies::seeds() {
        let path = folder("corpus").join(parser).join(name);
        let written = std::fs::read(&path).is_ok_and(|written| written == bytes);
        let how = "run `cargo run -p base-station --example carrier_corpus`";
        assert!(written, "{} is not what its seed is: {how}", path.display());
    }
}
