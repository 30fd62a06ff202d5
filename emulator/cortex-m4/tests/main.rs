//! The tests of the core in one binary: each file is a module of it.

mod common;
mod coverage;
mod decode_oracle;
mod execute_oracle;
mod hold;
mod instructions;
mod interrupted;
mod pieces;
mod run;
mod watch;
