//! The tests of the voter in one binary: each file is a module of it.

mod oracle;
mod rules;
mod support;
