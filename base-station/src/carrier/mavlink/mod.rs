//! MAVLink 2: objects travel in TUNNEL messages, with standard messages beside them (decision 17).
//!
//! | file | what |
//! |---|---|
//! | [`tunnel`] | the message that carries objects |
//! | [`standard`] | the messages with which any MAVLink tool shows the position |
//! | [`signing`] | signatures |
//! | [`forwarder`] | the flight controller's side: which objects are sent when |
//! | [`receiver`] | the base station's side: which objects arrive |
//! | [`voice`] | the base station's own messages: HEARTBEAT, uplinks |
//! | [`inbound`] | the flight controller's side of uplinks: which are written, and how they are answered |

pub mod forwarder;
pub mod inbound;
pub mod receiver;
pub mod signing;
pub mod standard;
pub mod tunnel;
pub mod voice;

pub use forwarder::{Forwarder, Rates};
pub use inbound::Inbound;
pub use receiver::{Received, Receiver};
pub use signing::{Key, Signer, Verifier};
pub use voice::Voice;

#[cfg(test)]
mod tests;
