//! The tests of the residual errors in one binary: each file is a module of it.

mod published;
mod report;
mod wire;
