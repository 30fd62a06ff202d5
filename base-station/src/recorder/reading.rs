//! Reads a recording, whether it is whole or cut off.
//!
//! The input may be damaged anywhere, so no length in it can be trusted. The `mcap` crate's reader (0.26) trusts
//! several. It allocates the buffer of a record or a string by the claimed length, up to 4 GiB. It subtracts without a
//! check if a record is longer than the rest of its chunk, or an attachment shorter than its CRC. So this module parses
//! a file itself, by <https://mcap.dev/spec>: an opcode, a length and that number of bytes, in and outside of chunks.
//! It reads only chunks, channels and messages: the arrivals, and the commands to holds.
//!
//! **Memory.** One record outside of chunks is held. Its buffer grows with the bytes that the file has: to at most
//! twice [`LONGEST`], and at most twice the file. **Time.** Each byte is read and checked once, and reading ends at the
//! first damage outside of a chunk.

use std::collections::HashSet;
use std::io::{self, Read};
use std::ops::Range;

use mcap::McapError;
use mcap::records::op;

use super::COMMANDS;
use super::ros::{self, Found, array, string, take};
use crate::carrier::mavlink::commander::CommandRecord;
use crate::intake::Carried;

/// The greatest length of a [`Recorder`](super::Recorder)'s chunk, bytes; a longer record ends the reading. Half a
/// second of a thousand drones is 2 MB.
pub(super) const LONGEST: u64 = 256 << 20;

/// The greatest number of commands that are kept between two arrivals.
const MOST_TOLD: usize = 1_000;

const HEAD: usize = 1 + 8;

const MESSAGE_HEAD: usize = 2 + 4 + 8 + 8;

/// Bytes that arrived, with the recorded verdicts.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// The bytes that arrived.
    pub carried: Carried,
    /// The verdict on each object in the bytes.
    pub found: Vec<Found>,
    /// The states of the station's commands to holds that were recorded since the arrival before.
    pub commands: Vec<CommandRecord>,
}

enum Stop {
    Io(io::Error),
    /// The file was cut or damaged. The text has the position and the reason.
    Torn(String),
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<McapError> for Stop {
    fn from(error: McapError) -> Self {
        Self::Torn(error.to_string())
    }
}

#[derive(Default)]
struct Channels {
    arrivals: HashSet<u16>,
    commands: HashSet<u16>,
    /// The commands read since the last arrival.
    told: Vec<CommandRecord>,
}

/// Reads the arrivals of a recording, in order, and holds at most one chunk.
pub struct Reader<R> {
    from: R,
    begun: bool,
    body: Vec<u8>,
    chunk: Range<usize>,
    channels: Channels,
    read: u64,
    torn: Option<String>,
    lost: Vec<String>,
    ended: bool,
}

impl<R: Read> Reader<R> {
    /// Returns a reader that begins at the recording's first byte.
    pub fn new(from: R) -> Self {
        Self {
            from,
            begun: false,
            body: vec![],
            chunk: 0..0,
            channels: Channels::default(),
            read: 0,
            torn: None,
            lost: vec![],
            ended: false,
        }
    }

    /// Returns the number of bytes of the file that were read.
    pub const fn bytes_read(&self) -> u64 {
        self.read
    }

    /// Returns where the file was cut or damaged, once the reader has reached that point.
    pub fn torn(&self) -> Option<&str> {
        self.torn.as_deref()
    }

    /// Returns the damaged chunks found so far, which are left out: where they are in the file, and what is wrong.
    pub fn lost(&self) -> &[String] {
        &self.lost
    }

    #[cfg(test)]
    pub(super) const fn held(&self) -> usize {
        self.body.capacity()
    }

    /// Returns the next arrival in the recording.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read. A truncated file is no error.
    pub fn next_record(&mut self) -> io::Result<Option<Record>> {
        while !self.ended {
            match self.step() {
                Ok(None) => {}
                Ok(record) => return Ok(record),
                Err(Stop::Io(error)) => return Err(error),
                Err(Stop::Torn(why)) => {
                    self.torn = Some(why);
                    self.ended = true;
                }
            }
        }
        Ok(None)
    }

    fn step(&mut self) -> Result<Option<Record>, Stop> {
        if !self.begun {
            self.begin()?;
        }
        if let Some(chunk) = self.body.get(self.chunk.clone()).filter(|chunk| !chunk.is_empty()) {
            let (opcode, length) = head(chunk).ok_or(McapError::UnexpectedEoc)?;
            let rest = chunk.get(HEAD..).unwrap_or_default();
            let body = usize::try_from(length).ok().and_then(|length| rest.get(..length));
            let body = body.ok_or(McapError::UnexpectedEoc)?;
            self.chunk.start += HEAD + body.len();
            return look(&mut self.channels, !self.lost.is_empty(), opcode, body);
        }
        let filled = self.fill(HEAD as u64)?;
        if self.body.is_empty() {
            self.ended = true;
            return Ok(None);
        }
        let (opcode, length) = head(&self.body).filter(|_| filled).ok_or(McapError::UnexpectedEof)?;
        if opcode == op::FOOTER {
            self.ended = true;
            return Ok(None);
        }
        if length > LONGEST {
            return Err(McapError::RecordTooLarge { opcode, len: length }.into());
        }
        if !self.fill(length)? {
            return Err(McapError::UnexpectedEof.into());
        }
        if opcode == op::CHUNK {
            match records(&self.body) {
                Ok(records) => self.chunk = records,
                // A damaged chunk loses only its own records, because its length tells where the next record is.
                Err(Stop::Torn(why)) => {
                    self.lost.push(format!(
                        "{} bytes at {}: {why}",
                        self.body.len(),
                        self.read - self.body.len() as u64
                    ));
                }
                Err(stop) => return Err(stop),
            }
            return Ok(None);
        }
        look(&mut self.channels, !self.lost.is_empty(), opcode, &self.body)
    }

    fn begin(&mut self) -> Result<(), Stop> {
        if !self.fill(mcap::MAGIC.len() as u64)? {
            return Err(McapError::UnexpectedEof.into());
        }
        if self.body != mcap::MAGIC {
            return Err(McapError::BadMagic.into());
        }
        self.begun = true;
        Ok(())
    }

    /// Replaces the buffer's contents by the next `length` bytes. Returns whether the file had that many.
    fn fill(&mut self, length: u64) -> io::Result<bool> {
        self.chunk = 0..0;
        self.body.clear();
        let read = self.from.by_ref().take(length).read_to_end(&mut self.body)? as u64;
        self.read += read;
        Ok(read == length)
    }
}

fn head(mut bytes: &[u8]) -> Option<(u8, u64)> {
    let [opcode] = *take::<1>(&mut bytes)?;
    Some((opcode, u64::from_le_bytes(*take::<8>(&mut bytes)?)))
}

fn records(body: &[u8]) -> Result<Range<usize>, Stop> {
    let (crc, compression, length, rest) = chunk_head(body).ok_or(McapError::UnexpectedEoc)?;
    if !compression.is_empty() {
        return Err(McapError::UnsupportedCompression(compression).into());
    }
    let short = McapError::BadChunkLength { header: length, available: rest.len() as u64 };
    let records = usize::try_from(length).ok().and_then(|length| rest.get(..length)).ok_or(short)?;
    // A chunk whose CRC field is 0 has no CRC.
    if crc != 0 {
        let calculated = crc32fast::hash(records);
        if calculated != crc {
            return Err(McapError::BadChunkCrc { saved: crc, calculated }.into());
        }
    }
    let start = body.len() - rest.len();
    Ok(start..start + records.len())
}

fn chunk_head(body: &[u8]) -> Option<(u32, String, u64, &[u8])> {
    let mut rest = body;
    // The chunk's times of its first and last message, and its uncompressed length, are not used.
    take::<{ 8 + 8 + 8 }>(&mut rest)?;
    let crc = u32::from_le_bytes(*take::<4>(&mut rest)?);
    let compression = string(&mut rest)?;
    Some((crc, compression, u64::from_le_bytes(*take::<8>(&mut rest)?), rest))
}

/// Parses a record other than a chunk, and returns the record if it is an arrival. If the record defines a channel of
/// arrivals or commands, the channel's number is added to `channels`. If the record holds a command, the command is
/// added there too. `is_lossy` means that an earlier chunk was lost, perhaps with definitions of channels. Then each
/// message may be an arrival.
fn look(channels: &mut Channels, is_lossy: bool, opcode: u8, body: &[u8]) -> Result<Option<Record>, Stop> {
    let malformed = |what: &str| Stop::Torn(format!("a {what} that is malformed"));
    match opcode {
        op::CHANNEL => {
            let (id, topic) = channel(body).ok_or_else(|| malformed("channel"))?;
            if topic == b"/carried" {
                channels.arrivals.insert(id);
            } else if topic == COMMANDS.as_bytes() {
                channels.commands.insert(id);
            }
            Ok(None)
        }
        op::MESSAGE => {
            let mut data = body;
            let [low, high, ..] = *take::<MESSAGE_HEAD>(&mut data).ok_or_else(|| malformed("message"))?;
            let Channels { arrivals, commands, told } = channels;
            let channel = u16::from_le_bytes([low, high]);
            if commands.contains(&channel) && told.len() < MOST_TOLD {
                told.extend(ros::read_command(data));
            }
            let known = arrivals.contains(&channel) || (is_lossy && arrivals.is_empty());
            let carried = known.then(|| ros::read_carried(data));
            let record = |(carried, found)| Record { carried, found, commands: std::mem::take(told) };
            Ok(carried.flatten().map(record))
        }
        _ => Ok(None),
    }
}

fn channel(mut body: &[u8]) -> Option<(u16, &[u8])> {
    let id = u16::from_le_bytes(*take::<2>(&mut body)?);
    // The channel also names its schema by a number. This number is not needed here.
    take::<2>(&mut body)?;
    Some((id, array(&mut body)?))
}
