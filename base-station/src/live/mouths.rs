//! Sends messages over the sockets and serial ports on which a base station receives.

use std::collections::BTreeMap;
use std::io::Write;
use std::net::UdpSocket;
use std::sync::{Arc, Mutex, PoisonError};

use serialport::SerialPort;

use crate::carrier::mavlink::voice::To;

enum Mouth {
    Socket(UdpSocket),
    Port(Box<dyn SerialPort>),
}

/// The sending sides of all working MAVLink lines, by the lines' numbers.
#[derive(Clone, Default)]
pub struct Mouths(Arc<Mutex<BTreeMap<u16, Mouth>>>);

impl std::fmt::Debug for Mouths {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Mouths").finish_non_exhaustive()
    }
}

impl Mouths {
    pub(super) fn add_socket(&self, line: u16, socket: UdpSocket) {
        self.with(|mouths| mouths.insert(line, Mouth::Socket(socket)));
    }

    pub(super) fn add_port(&self, line: u16, port: Box<dyn SerialPort>) {
        self.with(|mouths| mouths.insert(line, Mouth::Port(port)));
    }

    pub(super) fn remove(&self, line: u16) {
        self.with(|mouths| mouths.remove(&line));
    }

    /// Sends a message. Errors are ignored, because the sender repeats a lost message or sends a newer one.
    pub fn send(&self, to: To, bytes: &[u8]) {
        self.with(|mouths| match (to.line, to.address) {
            (Some(line), _) => {
                if let Some(mouth) = mouths.get_mut(&line) {
                    mouth.send(to, bytes);
                }
            }
            // A message with an address but without a line goes over the first line that has addresses.
            (None, Some(_)) => {
                if let Some(mouth) = mouths.values_mut().find(|mouth| matches!(mouth, Mouth::Socket(_))) {
                    mouth.send(to, bytes);
                }
            }
            (None, None) => {
                mouths
                    .values_mut()
                    .filter(|mouth| matches!(mouth, Mouth::Port(_)))
                    .for_each(|mouth| mouth.send(to, bytes));
            }
        });
    }

    fn with<T>(&self, act: impl FnOnce(&mut BTreeMap<u16, Mouth>) -> T) -> T {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Mouth {
    fn send(&mut self, to: To, bytes: &[u8]) {
        let _ = match (self, to.address) {
            (Self::Socket(socket), Some(address)) => socket.send_to(bytes, address),
            // The serial port's timeout bounds the time of a write, even if a radio accepts no bytes.
            (Self::Port(port), _) => port.write(bytes),
            (Self::Socket(_), None) => Ok(0),
        };
    }
}
