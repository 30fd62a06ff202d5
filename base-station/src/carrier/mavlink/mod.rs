//! MAVLink 2: objects in TUNNEL messages, and the standard messages beside them (decision 17).
//!
//! | file | what |
//! |---|---|
//! | [`tunnel`] | the message that carries objects |
//! | [`standard`] | the messages by which any MAVLink tool shows the position |
//! | [`signing`] | signatures |
//! | [`forwarder`] | the flight controller's side: which objects go when |
//! | [`receiver`] | the base station's side: which objects came |

pub mod forwarder;
pub mod receiver;
pub mod signing;
pub mod standard;
pub mod tunnel;

pub use forwarder::{Forwarder, Rates};
pub use receiver::{Received, Receiver};
pub use signing::{Key, Signer, Verifier};

#[cfg(test)]
mod tests;
