//! The tests of the profile in one binary: each file is a module of it. The clients have one of their own.

mod corpus;
mod detection;
mod golden;
mod hold;
mod port;
mod sequence;
mod spi;
mod support;
mod values;
