//! The carriers that need no other crate: a byte stream, and what another base station publishes.

pub mod published;
pub mod stream;
