//! Waits for gdb at a socket.

use std::io;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;

/// The default port of OpenOCD and of editors.
pub const PORT: u16 = 3333;

/// Waits at `port` on 127.0.0.1 (0 selects a free one) for a debugger of the board called `board`, which runs `image`.
/// `say` gets the text that tells a user how to connect.
///
/// # Errors
///
/// The port is taken, or the system reports another error; the error's text says so.
pub fn wait(port: u16, board: &str, image: &Path, say: &mut dyn FnMut(&str)) -> io::Result<TcpStream> {
    let failed = |error: io::Error| {
        io::Error::new(error.kind(), format!("--port {port}: cannot wait there for a debugger: {error}"))
    };
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?;
    let here = std::env::current_dir().unwrap_or_default();
    let image = image.strip_prefix(here).unwrap_or(image);
    say(&format!(
        "{board} is halted at power-on and waits at {address}:\n  gdb-multiarch {} -ex 'target remote {address}'",
        image.display()
    ));
    // The listener is closed here, because a run has only one debugger.
    listener.accept().map(|(connection, _)| connection).map_err(failed)
}

/// Tells the user that the connection to the debugger failed.
pub fn say_lost(error: &str) {
    eprintln!("the debugger is gone ({error}); the run goes on without it");
}

/// Tells the user that the debugger ended the run at the instant `at`, virtual ns.
pub fn say_killed(at: u64) {
    eprintln!("the debugger ended the run after {:.3} ms", at as f64 / 1e6);
}
