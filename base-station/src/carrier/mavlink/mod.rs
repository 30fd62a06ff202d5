//! MAVLink 2: objects in TUNNEL messages, and the standard messages beside them (decision 17).
//!
//! | file | what |
//! |---|---|
//! | [`tunnel`] | the message that carries objects |
//! | [`standard`] | the messages by which any MAVLink tool shows the position |
//! | [`signing`] | signatures |
//! | [`forwarder`] | the flight controller's side: which objects go when |
//! | [`receiver`] | the base station's side: which objects came |
//! | [`voice`] | what the base station says: HEARTBEAT, uplinks |
//! | [`inbound`] | the flight controller's side of uplinks: what is to be written, and what is answered |

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
