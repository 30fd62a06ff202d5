//! Compiles the C client and the player of its tapes. The fuzz target `client` compares the C client with the Rust one.
fn main() {
    let files = ["../c/horus_dpr.c", "../c/tests/tape.c"];
    cc::Build::new().files(files).flag("-std=c11").warnings_into_errors(true).compile("horus_dpr");
    for file in files.into_iter().chain(["../c/horus_dpr.h", "../c/horus_dpr_crc.h", "../c/tests/tape.h"]) {
        println!("cargo::rerun-if-changed={file}");
    }
}
