//! Serves the page on a thread of its own.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use axum::Router;
use tokio::sync::oneshot;

use super::serve::{self, Limits};
use super::{Station, page};

/// A page that is served until this value is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    interrupted: Arc<AtomicBool>,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves the page of `station` at `address`; with port 0 the system chooses one. While the page is served, Ctrl-C
    /// does not end the process; [`interrupted`](Self::interrupted) reports it.
    ///
    /// # Errors
    ///
    /// Returns an error if the address cannot be bound, or the system provides no event loop.
    pub fn start(station: Station, address: SocketAddr) -> io::Result<Self> {
        Self::of(address, |address| page::router(station, None, address))
    }

    /// Serves the pages that `router` makes once the address is known, as [`start`](Self::start) does.
    ///
    /// # Errors
    ///
    /// Returns an error in the cases in which [`start`](Self::start) does.
    pub fn of(address: SocketAddr, router: impl FnOnce(SocketAddr) -> Router) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (end, ended) = oneshot::channel::<()>();
        let interrupted = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&interrupted);
        let router = router(address);
        let thread = thread::spawn(move || {
            runtime.block_on(async {
                let served = async {
                    let listener = tokio::net::TcpListener::from_std(listener)?;
                    serve::serve(listener, router, Limits::default()).await
                };
                let interrupts = async {
                    while tokio::signal::ctrl_c().await.is_ok() {
                        told.store(true, Ordering::Relaxed);
                    }
                };
                // A graceful shutdown would wait for the event streams, which do not end.
                tokio::select! {
                    _ = ended => {}
                    served = async { tokio::join!(served, interrupts).0 } => {
                        if let Err(error) = served {
                            eprintln!("error: the page ended: {error}");
                        }
                    }
                }
            });
        });
        Ok(Self { address, interrupted, end: Some(end), thread: Some(thread) })
    }

    /// Returns the address of the page.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns whether the user has pressed Ctrl-C.
    #[must_use]
    pub fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.end.take().map(|end| end.send(()));
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
