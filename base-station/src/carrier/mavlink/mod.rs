//! MAVLink 2: objects travel in TUNNEL messages, with standard messages beside them (decision 17).

pub mod commander;
pub mod forwarder;
pub mod inbound;
mod not_sent;
pub mod receiver;
pub mod signing;
pub mod standard;
pub mod tunnel;
pub mod voice;

pub use commander::Commander;
pub use forwarder::{Forwarder, Rates};
pub use inbound::Inbound;
pub use receiver::{Received, Receiver};
pub use signing::{Key, Signer, Verifier};
pub use voice::Voice;

#[cfg(test)]
mod tests;
