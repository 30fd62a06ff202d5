//! `cargo xtask`. All of it is a library, which is compiled while the bench still is; a program has to wait for that.

use std::process::ExitCode;

fn main() -> ExitCode {
    xtask::main()
}
