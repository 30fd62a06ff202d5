//! The tests of the residual errors in one binary.

mod published;
mod report;
mod wire;
