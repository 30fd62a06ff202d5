//! All tests of the profile in one binary, except those of the clients.

mod corpus;
mod detection;
mod golden;
mod hold;
mod port;
mod sequence;
mod spi;
mod support;
mod values;
