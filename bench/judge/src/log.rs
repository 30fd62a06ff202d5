//! A run's log in memory and as a file. The file has one JSON object per line, the header first.

use std::io::{self, BufRead, Write};

use serde::{Deserialize, Serialize};

use crate::{Event, Header, What};

/// A run's events, in order of time, and what is known before them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Log {
    /// What is known before the first event.
    pub header: Header,
    /// The events, in order of time.
    pub events: Vec<Event>,
}

/// Why a stored log cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A line of the log is not an event, or the first line is not a header.
    #[error("line {line}")]
    Line {
        /// The number of the line, from 1.
        line: usize,
        /// What is wrong with the line.
        source: serde_json::Error,
    },
    /// The file has no header.
    #[error("the log is empty")]
    Empty,
    /// The log has a version of the format that this crate cannot read.
    #[error("the log has format {found}, and this version reads format {}", Header::VERSION)]
    Version {
        /// The version of the file's format.
        found: u32,
    },
    /// An event is earlier than the event before it.
    #[error("line {line}: an event at {at} ns after one at {before} ns")]
    Order {
        /// The number of the line, from 1.
        line: usize,
        /// The instant of the event on the wrong line, ns.
        at: u64,
        /// The instant of the event before the one on the wrong line, ns.
        before: u64,
    },
}

impl Log {
    /// Reads a stored log. An incomplete last line is ignored: a run that was killed leaves one.
    ///
    /// # Errors
    ///
    /// Returns a [`LogError`] if the file cannot be read, or does not hold a log of this format.
    pub fn read(mut from: impl BufRead) -> Result<Self, LogError> {
        Self::read_lines(&mut from)
    }

    /// This function has no type parameter, so that it is compiled here once, and not in each crate that reads logs.
    #[inline(never)]
    fn read_lines(from: &mut dyn BufRead) -> Result<Self, LogError> {
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

    /// Returns whether the log holds the end of the run. The log of a killed run does not.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.events.last().is_some_and(|event| event.what == What::End)
    }

    /// Stores the log.
    ///
    /// # Errors
    ///
    /// Returns the writer's error.
    pub fn write(&self, to: impl Write) -> io::Result<()> {
        let mut writer = LogWriter::new(to, &self.header)?;
        for event in &self.events {
            writer.take(event)?;
        }
        writer.finish()
    }
}

/// Writes a log during a run, one event at a time.
#[derive(Debug)]
pub struct LogWriter<W: Write> {
    to: W,
    /// The text of the last line. Room for it is made once.
    line: Vec<u8>,
}

impl<W: Write> LogWriter<W> {
    /// Begins a log by writing its header.
    ///
    /// # Errors
    ///
    /// Returns the writer's error.
    pub fn new(mut to: W, header: &Header) -> io::Result<Self> {
        let mut line = serde_json::to_vec(header)?;
        line.push(b'\n');
        to.write_all(&line)?;
        Ok(Self { to, line })
    }

    /// Writes the next event.
    ///
    /// # Errors
    ///
    /// Returns the writer's error.
    pub fn take(&mut self, event: &Event) -> io::Result<()> {
        put_event(&mut self.line, event)?;
        self.to.write_all(&self.line)
    }

    /// Ends the log, and writes out what is buffered.
    ///
    /// # Errors
    ///
    /// Returns the writer's error.
    pub fn finish(mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// Replaces `line` by the line of an event. This function has no type parameter, so that it is compiled here once, and
/// not for each writer.
#[inline(never)]
fn put_event(line: &mut Vec<u8>, event: &Event) -> io::Result<()> {
    line.clear();
    serde_json::to_writer(&mut *line, event)?;
    line.push(b'\n');
    Ok(())
}
