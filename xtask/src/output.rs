//! Writes a file that appears as a whole at the end of a run, or not at all.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use tempfile::TempPath;

/// A file that is written beside its path and moved there at the end. A path that is no regular file (`/dev/stdout`, a
/// named pipe) is written directly.
pub(crate) struct Output {
    place: PathBuf,
    beside: Option<TempPath>,
}

impl Output {
    /// Creates the file beside the path `place` of the option `option`.
    ///
    /// # Errors
    ///
    /// `place` is a folder, or the folder in which it lies cannot be written to.
    pub(crate) fn new(option: &str, place: &Path) -> Result<Self> {
        // A symbolic link stays, and the file to which it leads is written.
        let place = place.canonicalize().unwrap_or_else(|_| place.to_owned());
        if place.is_dir() {
            bail!("{option}: {} is a folder", place.display());
        }
        if place.exists() && !place.is_file() {
            return Ok(Self { place, beside: None });
        }
        let folder = place.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        let ending = place.extension().map(|ending| format!(".{}", ending.display())).unwrap_or_default();
        let beside =
            tempfile::Builder::new().prefix(".").suffix(&ending).make_in(folder, |path| File::create_new(path));
        let beside = beside.with_context(|| format!("{option}: {} cannot be written", place.display()))?;
        Ok(Self { place, beside: Some(beside.into_temp_path()) })
    }

    pub(crate) fn path(&self) -> &Path {
        self.beside.as_deref().unwrap_or(&self.place)
    }

    /// Moves the whole file to its final path.
    ///
    /// # Errors
    ///
    /// The file system refuses to move the file.
    pub(crate) fn finish(self) -> Result<()> {
        let Self { place, beside } = self;
        let Some(beside) = beside else { return Ok(()) };
        beside.persist(&place).with_context(|| format!("{} cannot be written", place.display()))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_appears_when_it_is_whole_and_else_nothing_changes() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("report.json");
        fs::write(&place, "before").unwrap();
        let output = Output::new("--json", &place).unwrap();
        assert_eq!(output.path().extension(), place.extension());
        fs::write(output.path(), "half").unwrap();
        assert_eq!(fs::read_to_string(&place).unwrap(), "before");
        drop(output);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "what was written beside it is gone");

        let output = Output::new("--json", &place).unwrap();
        fs::write(output.path(), "whole").unwrap();
        output.finish().unwrap();
        assert_eq!(fs::read_to_string(&place).unwrap(), "whole");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_place_that_cannot_be_written_is_told_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let error = |path: &Path| Output::new("--plot", path).err().unwrap().to_string();
        assert!(error(folder.path()).ends_with("is a folder"), "{}", error(folder.path()));
        let nowhere = folder.path().join("missing/flight.svg");
        assert_eq!(error(&nowhere), format!("--plot: {} cannot be written", nowhere.display()));
    }

    #[test]
    fn a_device_is_written_to_directly() {
        let device = Path::new("/dev/null");
        let output = Output::new("--events", device).unwrap();
        assert_eq!(output.path(), device);
        output.finish().unwrap();
        assert!(!device.is_file());
    }
}
