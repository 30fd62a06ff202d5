//! The page's connections: how many, how long, how much.
//!
//! # Limits
//!
//! | what | limit | beyond it |
//! |---|---|---|
//! | connections at once | 512 | closed at once |
//! | a request's head, the time until the next one included | 5 s | closed |
//! | its length | 16 KiB, 64 fields | refused with 431 |
//! | a reader that takes nothing | 10 s | closed |
//! | streams of states | [`MAX_WATCHERS`](super::page::MAX_WATCHERS) | refused with 503 |
//!
//! A connection holds its buffers and one state, whatever its reader does; so the memory of all of them is bounded, and
//! one that is slow holds no other up.

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

/// What differs between a page and its tests.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// So many connections may be open at once.
    pub connections: usize,
    /// A request's head must be there after so long.
    pub head: Duration,
    /// A reader that has taken nothing for so long is given up.
    pub stall: Duration,
}

/// Those of the [module](self). With all else, the connections stay below the 1024 files that systems allow a process.
impl Default for Limits {
    fn default() -> Self {
        Self { connections: 512, head: Duration::from_secs(5), stall: Duration::from_secs(10) }
    }
}

/// What a connection reads ahead, bytes: no head is longer.
const BUFFER: usize = 16 << 10;

/// What the system may hold of what a reader has not taken, bytes: a few states.
const SEND_BUFFER: usize = 64 << 10;

/// After an error that is not one connection's (no more files), the next one is accepted so much later.
const REST: Duration = Duration::from_millis(50);

/// Serves `router` to whoever connects, within the limits of this [module](self). Does not end.
///
/// # Errors
///
/// None at present: what goes wrong with one connection ends that one.
pub async fn serve(listener: TcpListener, router: Router, limits: Limits) -> io::Result<()> {
    let places = Arc::new(Semaphore::new(limits.connections));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(limits.head).max_buf_size(BUFFER).max_headers(64);
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(REST).await;
            continue;
        };
        // Dropped, so closed: who comes again finds a place once one is free.
        let Ok(place) = Arc::clone(&places).try_acquire_owned() else { continue };
        // As much as the system allows; what it does not is no fault.
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
        // A state is to be there at once, whatever the one before it waits for.
        let _ = stream.set_nodelay(true);
        let mut stream = TimeoutStream::new(stream);
        stream.set_write_timeout(Some(limits.stall));
        let connection =
            http.serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(router.clone()));
        tokio::spawn(async move {
            // A reader that goes away, or says what is no request, is no fault of the page's.
            let _ = connection.await;
            drop(place);
        });
    }
}
