//! Tests `docs/flight-controller.md`: the code on this page compiles, and the page's numbers are those of the code.
use std::fs;
use std::path::Path;

use profile::Layout;
use profile::ssi::client::{Config, SEARCH_CYCLES};
use profile::ssi::timing::{CSN_HOLD_NS, CSN_SETUP_NS, GAP_NS, SPACING_NS};

use super::c::{WARNINGS, compile, folder, scratch};

fn guide() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/flight-controller.md");
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn blocks(language: &str) -> Vec<String> {
    let guide = guide();
    let begins = format!("```{language}\n");
    let parts = guide.split(&begins).skip(1);
    parts.map(|part| part.split("```").next().expect("the block's text").to_owned()).collect()
}

#[test]
fn each_block_of_c_in_the_guide_compiles_without_a_warning() {
    let blocks = blocks("c");
    assert_eq!(blocks.len(), 2);
    for (number, block) in blocks.iter().enumerate() {
        let source = scratch(&format!("guide{number}.c"));
        fs::write(&source, block).expect("written");
        let include = format!("-I{}", folder().display());
        compile(&[WARNINGS, &[&include, "-fsyntax-only", source.to_str().expect("text")]].concat());
    }
}

/// Compiles the guide's C++ code for an autopilot, against stand-ins for the autopilot's own declarations.
fn compile_for_autopilot(source: &Path, options: &[&str]) {
    let stubs = folder().join("tests/autopilots.hpp");
    let include = format!("-I{}", folder().display());
    let [source, stubs] = [source, &stubs].map(|path| path.to_str().expect("text"));
    let common = ["-x", "c++", "-std=c++14", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-include", stubs];
    compile(&[&common[..], options, &[&include, source]].concat());
}

#[test]
fn the_example_for_ardupilot_compiles_against_what_it_uses() {
    let blocks = blocks("cpp");
    assert_eq!(blocks.len(), 1);
    let source = scratch("guide.cpp");
    fs::write(&source, &blocks[0]).expect("written");
    compile_for_autopilot(&source, &[]);
}

#[test]
fn the_module_for_px4_compiles_against_what_it_uses_of_each_release() {
    let module = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/px4/src/drivers/horus_dpr/HorusDpr.cpp");
    let text = fs::read_to_string(&module).expect("the module");
    for (release, own_message) in [("115", false), ("116", false), ("118", true)] {
        // The autopilot's headers are empty here: `autopilots.hpp` declares all that the code uses.
        let headers = scratch(&format!("px4-{release}"));
        let _ = fs::remove_dir_all(&headers);
        for line in text.lines().filter_map(|line| line.strip_prefix("#include <")) {
            let name = line.strip_suffix('>').expect("a header");
            if own_message || !name.ends_with("/aux_global_position.h") {
                let path = headers.join(name);
                fs::create_dir_all(path.parent().expect("a folder")).expect("made");
                fs::write(path, "").expect("written");
            }
        }
        let defined = format!("-DPX4_RELEASE={release}");
        let headers = format!("-I{}", headers.display());
        compile_for_autopilot(&module, &[&defined, &headers]);
    }
}

#[test]
fn the_numbers_of_the_guide_are_those_of_the_code() {
    let guide = guide();
    let layout = Layout::for_receivers(3).expect("three receivers");
    for bytes in [96, layout.image_len(), layout.map_len()] {
        let wire_us = |clock_mhz: usize| bytes * 8 / clock_mhz + (CSN_SETUP_NS + CSN_HOLD_NS) as usize / 1_000;
        let row = format!("| {bytes} | {} µs | {} µs |", wire_us(2), wire_us(8));
        assert!(guide.contains(&row), "{row}");
    }
    let bounds = [
        format!("first edge of SCK | at least {} µs", CSN_SETUP_NS / 1_000),
        format!("CSN rises | at least {} µs", CSN_HOLD_NS / 1_000),
        format!("CSN rises to CSN falls | at least {} µs", GAP_NS / 1_000),
        format!("CSN rises to the next CSN rises | at least {} µs", SPACING_NS / 1_000),
        format!("`age_limit_us`, {} ms unless you set it", Config::AGE_LIMIT_US / 1_000),
        format!("nothing intact for {} ms", Config::SILENCE_US / 1_000),
        format!("after four samples, {} ms", (SEARCH_CYCLES + 1) * 10),
    ];
    for bound in bounds {
        assert!(guide.contains(&bound), "{bound}");
    }
}
