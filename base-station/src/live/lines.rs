//! Receives bytes over sockets and serial ports, over which [`Mouths`](super::mouths::Mouths) sends.

use std::io::{self, Read};
use std::net::{SocketAddr, UdpSocket};
use std::thread;
use std::time::Duration;

use socket2::SockRef;

use super::{Clock, Event, Inlet};
use crate::intake::{Carried, Kind, MAX_DATAGRAM};

const SERIAL_TIMEOUT: Duration = Duration::from_millis(5);

/// The size of the system's buffer for received bytes. The messages of a thousand drones in a second fit into it.
const RECEIVE_BUFFER: usize = 8 << 20;

const RETRY: Duration = Duration::from_secs(1);

const LOOK: Duration = Duration::from_millis(200);

/// Receives datagrams on a UDP port and returns the port's address.
///
/// # Errors
///
/// Returns an error if the address cannot be bound.
pub fn udp(address: SocketAddr, kind: Kind, line: u16, clock: Clock, inlet: Inlet) -> io::Result<SocketAddr> {
    let socket = UdpSocket::bind(address)?;
    // An error is ignored here, because the system may grant a smaller receive buffer.
    let _ = SockRef::from(&socket).set_recv_buffer_size(RECEIVE_BUFFER);
    socket.set_read_timeout(Some(LOOK))?;
    let bound = socket.local_addr()?;
    if kind == Kind::MavlinkDatagrams {
        inlet.mouths.add_socket(line, socket.try_clone()?);
    }
    thread::spawn(move || {
        // The buffer is one byte longer than the longest allowed datagram. A datagram that fills the buffer is too
        // long.
        let mut buffer = vec![0; MAX_DATAGRAM + 1];
        loop {
            let event = match socket.recv_from(&mut buffer) {
                Ok((length, from)) => {
                    let bytes = buffer[..length].to_vec();
                    Event::Carried(Carried { at_us: clock.now_us(), kind, line, from: from.to_string(), bytes })
                }
                // A read times out so that the loop can check whether the station still exists.
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    Event::Line { name: bound.to_string(), why: None }
                }
                Err(error) => {
                    thread::sleep(RETRY);
                    Event::Line { name: bound.to_string(), why: Some(error.to_string()) }
                }
            };
            if !inlet.offer(event) {
                return;
            }
        }
    });
    Ok(bound)
}

/// Receives bytes on a serial port. A port that fails is opened again, because a radio may be unplugged and plugged in
/// again.
pub fn serial(path: String, baud: u32, kind: Kind, line: u16, clock: Clock, inlet: Inlet) {
    thread::spawn(move || {
        let mut buffer = vec![0; 4_096];
        loop {
            let opened = serialport::new(&path, baud).timeout(SERIAL_TIMEOUT).open();
            let mut why = opened.as_ref().err().map(ToString::to_string);
            if !inlet.offer(Event::Line { name: path.clone(), why: why.clone() }) {
                return;
            }
            if let Ok(mut port) = opened {
                if let (Kind::MavlinkStream, Ok(mouth)) = (kind, port.try_clone()) {
                    inlet.mouths.add_port(line, mouth);
                }
                while why.is_none() {
                    match port.read(&mut buffer) {
                        Ok(0) => why = Some("the port is closed".into()),
                        Ok(length) => {
                            let bytes = buffer[..length].to_vec();
                            let carried = Carried { at_us: clock.now_us(), kind, line, from: String::new(), bytes };
                            if !inlet.offer(Event::Carried(carried)) {
                                return;
                            }
                        }
                        Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => {}
                        Err(error) => why = Some(error.to_string()),
                    }
                }
                inlet.mouths.remove(line);
                if !inlet.offer(Event::Line { name: path.clone(), why }) {
                    return;
                }
            }
            thread::sleep(RETRY);
        }
    });
}
