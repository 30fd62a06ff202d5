//! All tests of the profile in one binary: each file is a module of it. The tests of the clients have a binary of their
//! own.

mod corpus;
mod detection;
mod golden;
mod hold;
mod port;
mod sequence;
mod spi;
mod support;
mod values;
