//! Turns on features of other crates, as its Cargo.toml says. It has no code.
