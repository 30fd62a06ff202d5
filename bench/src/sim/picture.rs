//! Draws a run's flight into a file.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use bench_judge::Event;
use gnss_sim::Flight;
use profile::Layout;

use super::{Error, Setup};
use crate::plot::History;

pub(super) struct Picture {
    path: PathBuf,
    file: File,
    history: History,
}

impl Picture {
    pub(super) fn create(path: &Path, setup: &Setup) -> Result<Self, Error> {
        let unwritten = |source: std::io::Error| Error::Plot { path: path.to_owned(), source: source.into() };
        let title = format!("{} receivers, seed {}, {} clock", setup.gps, setup.seed, setup.clock);
        let layout = Layout::for_receivers(setup.gps).ok_or_else(|| unwritten(ErrorKind::InvalidInput.into()))?;
        let file = File::create(path).map_err(unwritten)?;
        Ok(Self { path: path.to_owned(), file, history: History::new(layout, title) })
    }

    pub(super) fn take(&mut self, event: &Event) {
        self.history.take(event);
    }

    pub(super) fn write(mut self, setup: &Setup) -> Result<(), Error> {
        let recorded = setup.recordings.iter().any(Option::is_some);
        let flight = (!recorded).then(|| Flight::new(setup.seed, setup.duration_ns as f64 / 1e9));
        let drawn = self.history.svg(flight.as_ref()).map_err(|error| error.to_string().into());
        drawn
            .and_then(|svg: String| Ok(self.file.write_all(svg.as_bytes())?))
            .map_err(|source| Error::Plot { path: self.path, source })
    }
}
