//! Limits the connections to the page: their number, duration and memory.
//!
//! # Limits
//!
//! | subject | limit | what happens beyond the limit |
//! |---|---|---|
//! | connections at once | 512 | a further one is closed at once |
//! | time for a request's head, and from the last request to the next | 5 s | the connection is closed |
//! | length of a request's head | 16 KiB, 64 fields | the request is refused with 431 |
//! | time for which a reader accepts no data | 10 s | the connection is closed |
//! | streams of states | [`MAX_WATCHERS`](super::page::MAX_WATCHERS) | a further one is refused with 503 |
//!
//! A connection holds its buffers and one state, whatever its reader does. So the memory of all connections is bounded,
//! and a slow connection does not delay the others.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::time::sleep;
use tokio_io_timeout::TimeoutStream;

/// The limits of connections. In tests these limits are shorter.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// The greatest number of connections that may be open at once.
    pub connections: usize,
    /// The time within which a request's head must arrive.
    pub head: Duration,
    /// The time after which a reader that accepts no data is dropped.
    pub stall: Duration,
}

/// With the limits of the [module's](self) table, the process stays below the usual limit of 1024 open files.
impl Default for Limits {
    fn default() -> Self {
        Self { connections: 512, head: Duration::from_secs(5), stall: Duration::from_secs(10) }
    }
}

/// The number of bytes that a connection reads ahead, and the greatest length of a request's head.
const BUFFER: usize = 16 << 10;

/// How many bytes the system may hold for a slow reader: those of a few states.
const SEND_BUFFER: usize = 64 << 10;

/// The pause in accepting connections after an error that concerns all of them (too many open files).
const REST: Duration = Duration::from_millis(50);

/// Serves `router` to all clients, within the limits of this [module](self). This function does not return.
///
/// # Errors
///
/// At present this returns no error. An error of a connection ends only that connection.
pub async fn serve(listener: TcpListener, router: Router, limits: Limits) -> io::Result<()> {
    let places = Arc::new(Semaphore::new(limits.connections));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(limits.head).max_buf_size(BUFFER).max_headers(64);
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(REST).await;
            continue;
        };
        // If the limit of connections is reached, the new connection is dropped, which closes it.
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        // An error is ignored here, because the system may grant a smaller send buffer.
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
        // A state is sent at once, even before the last one is acknowledged, so Nagle's algorithm is off.
        let _ = stream.set_nodelay(true);
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(limits.stall));
        let connection =
            http.serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(router.clone()));
        tokio::spawn(async move {
            // A reader that disconnects or sends an invalid request is no error of the page.
            let _ = connection.await;
            drop(place);
        });
    }
}
