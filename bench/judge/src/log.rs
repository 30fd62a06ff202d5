//! A log in memory and as a file: one JSON object per line, the header first.

use std::io::{self, BufRead, Write};

use serde::{Deserialize, Serialize};

use crate::{Event, Header, What};

/// A run's events, in order of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Log {
    /// What the run is known by.
    pub header: Header,
    /// What happened.
    pub events: Vec<Event>,
}

/// Why a stored log cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A line is not an event, or the first not a header.
    #[error("line {line}")]
    Line {
        /// Which, from 1.
        line: usize,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// There is no header.
    #[error("the log is empty")]
    Empty,
    /// It is of a format that this version does not read.
    #[error("the log has format {found}, and this version reads format {}", Header::VERSION)]
    Version {
        /// The file's.
        found: u32,
    },
    /// An event before its predecessor.
    #[error("line {line}: an event at {at} ns after one at {before} ns")]
    Order {
        /// Which, from 1.
        line: usize,
        /// Its instant, ns.
        at: u64,
        /// The instant of the event before it, ns.
        before: u64,
    },
}

impl Log {
    /// Reads a stored log. Half a line at its end, which a run leaves that was killed, is no event.
    ///
    /// # Errors
    ///
    /// [`LogError`].
    pub fn read(from: impl BufRead) -> Result<Self, LogError> {
        let mut lines = (1..).zip(from.lines()).peekable();
        let (line, first) = lines.next().ok_or(LogError::Empty)?;
        let header: Header = serde_json::from_str(&first?).map_err(|source| LogError::Line { line, source })?;
        if header.version != Header::VERSION {
            return Err(LogError::Version { found: header.version });
        }
        let mut events: Vec<Event> = vec![];
        while let Some((line, text)) = lines.next() {
            let event: Event = match serde_json::from_str(&text?) {
                Ok(event) => event,
                Err(source) if source.is_eof() && lines.peek().is_none() => break,
                Err(source) => return Err(LogError::Line { line, source }),
            };
            let before = events.last().map_or(0, |event| event.at);
            if event.at < before {
                return Err(LogError::Order { line, at: event.at, before });
            }
            events.push(event);
        }
        Ok(Self { header, events })
    }

    /// Whether the run came to its end: the log of one that was killed ends anywhere.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.events.last().is_some_and(|event| event.what == What::End)
    }

    /// Stores the log.
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn write(&self, to: impl Write) -> io::Result<()> {
        let mut writer = LogWriter::new(to, &self.header)?;
        for event in &self.events {
            writer.take(event)?;
        }
        writer.finish()
    }
}

/// Writes a log as it comes.
#[derive(Debug)]
pub struct LogWriter<W: Write>(W);

impl<W: Write> LogWriter<W> {
    /// Begins a log.
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn new(mut to: W, header: &Header) -> io::Result<Self> {
        serde_json::to_writer(&mut to, header)?;
        to.write_all(b"\n")?;
        Ok(Self(to))
    }

    /// The next event.
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn take(&mut self, event: &Event) -> io::Result<()> {
        serde_json::to_writer(&mut self.0, event)?;
        self.0.write_all(b"\n")
    }

    /// The log is complete.
    ///
    /// # Errors
    ///
    /// What the writer says.
    pub fn finish(mut self) -> io::Result<()> {
        self.0.flush()
    }
}
