//! Keeps the memory of the bench's boards without their supply, in one file for each board below `target/bench`.
//!
//! A file holds the result of [`emulator_debug_port::Wire::kept`]: for the DPR 1 MiB of flash and 4 KiB of UICR, for
//! HORUS 2 MiB of flash and 16 bytes of options. A board without a file starts like a new one.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bench::desk::{Desk, kept_bytes};

use crate::{Board, workspace};

pub(crate) const fn desk(board: Board) -> Desk {
    match board {
        Board::Dpr => Desk::Dpr,
        Board::Horus => Desk::Horus,
    }
}

pub(crate) fn file(board: Board) -> PathBuf {
    workspace::target_dir().join("bench").join(board.name()).with_extension("flash")
}

/// Reads the kept memory from `file`, or returns `None` for a new board, which has no file.
pub(crate) fn read(board: Board, file: &Path) -> Result<Option<Vec<u8>>> {
    let bytes = match std::fs::read(file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        bytes => bytes.with_context(|| format!("could not read {}", file.display()))?,
    };
    if bytes.len() != kept_bytes(desk(board)) {
        bail!("{} is no flash of the bench's {} board: remove it, and flash again", file.display(), board.name());
    }
    Ok(Some(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flash_file_of_another_size_is_refused() {
        let folder = std::env::temp_dir().join(format!("bench-flash-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("dpr.flash");
        assert_eq!(read(Board::Dpr, &file).unwrap(), None);
        std::fs::write(&file, [0; 100]).unwrap();
        let words = read(Board::Dpr, &file).unwrap_err().to_string();
        assert!(words.contains("dpr.flash is no flash of the bench's dpr board"), "{words}");
        let whole = vec![0x5A; (1 << 20) + 4096];
        std::fs::write(&file, &whole).unwrap();
        assert_eq!(read(Board::Dpr, &file).unwrap(), Some(whole));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
