//! The program behind `cargo xtask`. Its code is a library, because cargo compiles a library while the bench is still
//! being compiled, and a program only after that.

use std::process::ExitCode;

fn main() -> ExitCode {
    xtask::main()
}
