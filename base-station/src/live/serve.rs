//! Limits of the page's connections: their number, duration and memory.
//!
//! # Limits
//!
//! | subject | limit | beyond it |
//! |---|---|---|
//! | connections at once | 512 | closed at once |
//! | a request's head, with the time until the next one | 5 s | closed |
//! | its length | 16 KiB, 64 fields | refused with 431 |
//! | a reader that accepts no data | 10 s | closed |
//! | streams of states | [`MAX_WATCHERS`](super::page::MAX_WATCHERS) | refused with 503 |
//!
//! A connection holds its buffers and one state, whatever its reader does. So the memory of all of them is bounded, and
//! a slow one delays no other.

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

/// The limits, which differ in tests.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// The most connections that may be open at once.
    pub connections: usize,
    /// The time within which a request's head must arrive.
    pub head: Duration,
    /// The time without accepted data after which a reader is dropped.
    pub stall: Duration,
}

/// The limits of the [module](self). The connections, with all other files, stay below the 1024 files that systems
/// allow a process.
impl Default for Limits {
    fn default() -> Self {
        Self { connections: 512, head: Duration::from_secs(5), stall: Duration::from_secs(10) }
    }
}

/// The number of bytes that a connection reads ahead: no head is longer.
const BUFFER: usize = 16 << 10;

/// The number of unread bytes that the system may hold for a reader: a few states.
const SEND_BUFFER: usize = 64 << 10;

/// The pause in accepting after an error that does not concern one connection (no more files).
const REST: Duration = Duration::from_millis(50);

/// Serves `router` to all clients, within the limits of this [module](self). It does not end.
///
/// # Errors
///
/// There are none at present: an error of one connection ends that one.
pub async fn serve(listener: TcpListener, router: Router, limits: Limits) -> io::Result<()> {
    let places = Arc::new(Semaphore::new(limits.connections));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(limits.head).max_buf_size(BUFFER).max_headers(64);
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(REST).await;
            continue;
        };
        // It is dropped and so closed; a later attempt succeeds once a place is free.
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        // The system may grant less, which is not an error.
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
        // A state must be sent at once, whatever the one before it waits for.
        let _ = stream.set_nodelay(true);
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(limits.stall));
        let connection =
            http.serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(router.clone()));
        tokio::spawn(async move {
            // A reader that disconnects, or sends no valid request, is not an error of the page.
            let _ = connection.await;
            drop(place);
        });
    }
}
