//! Reading a recording, whole or cut off.

use std::collections::HashSet;
use std::io::{self, Read};

use mcap::records::Record as McapRecord;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::ros::{self, Found};
use crate::intake::Carried;

/// No chunk that a [`Recorder`](super::Recorder) writes is longer, bytes: half a second of a thousand drones is 2 MB.
const LONGEST: usize = 256 << 20;

/// What arrived, and what was found of it then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// What arrived.
    pub carried: Carried,
    /// What was found of each object.
    pub found: Vec<Found>,
}

/// Reads what arrived out of a recording, in its order, without ever holding more than a chunk.
pub struct Reader<R> {
    from: R,
    mcap: LinearReader,
    /// The channels that hold what arrived.
    channels: HashSet<u16>,
    read: u64,
    torn: Option<String>,
    ended: bool,
}

impl<R: Read> Reader<R> {
    /// Reads from the recording's first byte on.
    pub fn new(from: R) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST);
        Self {
            from,
            mcap: LinearReader::new_with_options(options),
            channels: HashSet::new(),
            read: 0,
            torn: None,
            ended: false,
        }
    }

    /// Bytes of the file that were read.
    pub const fn bytes_read(&self) -> u64 {
        self.read
    }

    /// Where the file was cut or damaged, in words, once that place was reached. All before it was given.
    pub fn torn(&self) -> Option<&str> {
        self.torn.as_deref()
    }

    /// The next that arrived.
    ///
    /// # Errors
    ///
    /// If the file cannot be read. That it is cut off is none.
    pub fn next_record(&mut self) -> io::Result<Option<Record>> {
        while !self.ended {
            match self.mcap.next_event() {
                None => self.ended = true,
                Some(Ok(LinearReadEvent::ReadRequest(bytes))) => {
                    let read = self.from.read(self.mcap.insert(bytes))?;
                    self.mcap.notify_read(read);
                    self.read += read as u64;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => match mcap::parse_record(opcode, data) {
                    Ok(McapRecord::Channel(channel)) if channel.topic == "/carried" => {
                        self.channels.insert(channel.id);
                    }
                    Ok(McapRecord::Message { header, data }) if self.channels.contains(&header.channel_id) => {
                        if let Some((carried, found)) = ros::read_carried(&data) {
                            return Ok(Some(Record { carried, found }));
                        }
                    }
                    Ok(_) => {}
                    Err(error) => self.tear(&error),
                },
                Some(Err(error)) => self.tear(&error),
            }
        }
        Ok(None)
    }

    fn tear(&mut self, error: &mcap::McapError) {
        self.torn = Some(error.to_string());
        self.ended = true;
    }
}
