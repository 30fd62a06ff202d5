//! The digest of a run's event log.

use std::cell::RefCell;
use std::io::{self, Write};
use std::rc::Rc;

use sha2::{Digest as _, Sha256};

/// Computes the SHA-256 of an event log, which is that of the file of `cargo xtask sim --events`.
#[derive(Clone, Default)]
pub(crate) struct LogDigest(Rc<RefCell<Sha256>>);

impl LogDigest {
    /// Returns the digest of the written bytes in hexadecimal digits.
    pub(crate) fn hex(&self) -> String {
        self.0.borrow().clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

impl Write for LogDigest {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
