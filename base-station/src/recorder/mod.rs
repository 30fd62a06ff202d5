//! The recorder: every byte that a carrier brought, when, and what was found of each object, in an MCAP file.
//!
//! # Design
//!
//! **What is in it.** `/carried` has the bytes and the verdicts, and is all that a playback needs; `/alarms` what came
//! and went; `/drone/ID/…` positions for maps. Schemas are in the file, in ROS 1's language, so that Foxglove and other
//! tools open it without anything of ours.
//!
//! **What a crash costs.** A chunk of the file is written whole, at least every [`FLUSH_US`], and then forced to the
//! disk. So a process that is killed, or a power loss, costs the last half second. What is before stays readable:
//! [`Reader`] checks each chunk's CRC before it gives anything of it, and ends where the file was cut. A chunk that was
//! damaged costs itself alone.
//!
//! **A full disk** is no end: what cannot be written is counted and told ([`Recorder::trouble`]), and after
//! [`RETRY_US`] the recorder tries again, in another part, so that nothing is appended to a torn one. The trouble is
//! over once something is on the disk again, not when a file could be made.
//!
//! **Parts.** After [`PART_BYTES`] a part is finished and another begun: what MCAP's index of a part takes in memory is
//! bounded, however long a recording is.

mod reading;
mod ros;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{WriteOptions, Writer};

use crate::intake::{Carried, Judged};
use crate::{Change, DroneId, Fleet, Place, Verdict};

pub use reading::{Reader, Record};
pub use ros::Found;

/// A chunk is written after so long at the latest, µs.
pub const FLUSH_US: u64 = 500_000;

/// After a failure it is tried again after so long, µs.
pub const RETRY_US: u64 = 1_000_000;

/// A part is finished when it has so many bytes.
pub const PART_BYTES: u64 = 512 << 20;

/// Where a recording's parts go.
pub trait Parts {
    /// A part.
    type Part: Write;

    /// Makes the part of this number, from 0.
    ///
    /// # Errors
    ///
    /// If it cannot be made. One that exists is never overwritten.
    fn make(&mut self, number: u32) -> io::Result<Self::Part>;

    /// Forces what was written to the last part onto the disk.
    ///
    /// # Errors
    ///
    /// If that fails.
    fn sync(&mut self) -> io::Result<()>;
}

/// Parts as files beside each other: `flight.mcap`, `flight.1.mcap`, …
#[derive(Debug)]
pub struct Files {
    path: PathBuf,
    last: Option<File>,
    made: Made,
}

/// The files that were made so far, for whoever tells of them.
#[derive(Clone, Debug, Default)]
pub struct Made(Arc<Mutex<Vec<PathBuf>>>);

impl Made {
    /// Their names, in their order.
    #[must_use]
    pub fn names(&self) -> Vec<PathBuf> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Files {
    /// Files of this name.
    #[must_use]
    pub fn new(path: PathBuf) -> Self {
        Self { path, last: None, made: Made::default() }
    }

    /// The files that are made, as they come to be: not this name's where it exists already.
    #[must_use]
    pub fn made(&self) -> Made {
        self.made.clone()
    }

    /// The name of the part of this number.
    #[must_use]
    pub fn name(path: &Path, number: u32) -> PathBuf {
        match (number, path.extension().and_then(|extension| extension.to_str())) {
            (0, _) => path.to_owned(),
            (_, Some(extension)) => path.with_extension(format!("{number}.{extension}")),
            (_, None) => path.with_extension(number.to_string()),
        }
    }
}

impl Parts for Files {
    type Part = BufWriter<File>;

    fn make(&mut self, number: u32) -> io::Result<Self::Part> {
        let name = Self::name(&self.path, number);
        let file = OpenOptions::new().write(true).create_new(true).open(&name)?;
        self.made.0.lock().unwrap_or_else(PoisonError::into_inner).push(name);
        self.last = Some(file.try_clone()?);
        Ok(BufWriter::new(file))
    }

    fn sync(&mut self) -> io::Result<()> {
        self.last.as_ref().map_or(Ok(()), File::sync_data)
    }
}

/// Why nothing is recorded at present.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trouble {
    /// What went wrong, in words.
    pub why: String,
    /// Since when, µs.
    pub since_us: u64,
}

/// A valid position that is shown since now, for maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Of which drone.
    pub drone: DroneId,
    /// Reported-Position, or a receiver.
    pub place: Place,
    /// Degrees north, degrees east, m above the ellipsoid.
    pub position: [f64; 3],
}

impl Fix {
    /// The valid positions among what was just `judged` and is now shown of `fleet`.
    #[must_use]
    pub fn of(judged: &[Judged], fleet: &Fleet) -> Vec<Self> {
        let new = judged.iter().filter(|judged| judged.verdict == Verdict::New);
        let fix = |judged: &Judged| {
            let drone = fleet.get(judged.drone)?;
            let position = match judged.place {
                Place::LinkStatus | Place::PortStatus | Place::Uplink => return None,
                Place::Reported => {
                    let values = &drone.reported()?.values;
                    let valid = values.status.position_valid();
                    valid.then_some([values.latitude, values.longitude, values.altitude])
                }
                Place::Gps(receiver) => {
                    let values = &drone.gps(usize::from(receiver))?.values;
                    let valid = values.status.position_valid();
                    valid.then_some([values.latitude, values.longitude, values.altitude])
                }
            };
            Some(Self { drone: judged.drone, place: judged.place, position: position? })
        };
        new.filter_map(fix).collect()
    }
}

/// A part that is being written.
struct Open<W: Write> {
    writer: Writer<NoSeek<W>>,
    channels: HashMap<String, u16>,
    sequence: u32,
    /// Message bytes since it was begun.
    bytes: u64,
    flushed_us: u64,
}

/// A recorder. See the [module](self).
pub struct Recorder<P: Parts> {
    parts: P,
    open: Option<Open<P::Part>>,
    next_part: u32,
    trouble: Option<Trouble>,
    tried_us: Option<u64>,
    lost: u64,
    part_bytes: u64,
}

impl<P: Parts> Recorder<P> {
    /// A recorder; nothing is made before there is something to record.
    #[must_use]
    pub const fn new(parts: P) -> Self {
        Self { parts, open: None, next_part: 0, trouble: None, tried_us: None, lost: 0, part_bytes: PART_BYTES }
    }

    /// Records what arrived, what was found in it, and the positions that it brought.
    pub fn carried(&mut self, carried: &Carried, judged: &[Judged], fixes: &[Fix]) {
        self.put(carried.at_us, "/carried", ros::CARRIED, &ros::carried(carried, judged));
        for Fix { drone, place, position } in fixes {
            let topic = format!("/drone/{drone}/{place}");
            self.put(carried.at_us, &topic, ros::FIX, &ros::fix(carried.at_us, *position));
        }
    }

    /// Records that an alarm came or went.
    pub fn alarm(&mut self, drone: DroneId, change: Change) {
        let data = ros::alarm(drone, change.alarm, change.raised);
        self.put(change.at_us, "/alarms", ros::ALARM, &data);
    }

    /// To be called at least every [`FLUSH_US`]: writes what is not written yet.
    pub fn tick(&mut self, now_us: u64) {
        let Some(open) = &mut self.open else { return };
        if now_us.saturating_sub(open.flushed_us) < FLUSH_US {
            return;
        }
        open.flushed_us = now_us;
        let full = open.bytes >= self.part_bytes;
        let written = match full {
            true => open.writer.finish().map(|_| ()),
            false => open.writer.flush(),
        };
        let written = written.map_err(|error| error.to_string());
        let synced = written.and_then(|()| self.parts.sync().map_err(|error| error.to_string()));
        match synced {
            Err(why) => self.fail(now_us, why),
            Ok(()) => {
                self.trouble = None;
                if full {
                    self.open = None;
                }
            }
        }
    }

    /// Finishes the file.
    ///
    /// # Errors
    ///
    /// What went wrong, in words; what was flushed before is readable all the same.
    pub fn finish(mut self) -> Result<(), String> {
        let Some(mut open) = self.open.take() else { return Ok(()) };
        open.writer.finish().map_err(|error| error.to_string())?;
        self.parts.sync().map_err(|error| error.to_string())
    }

    /// Why nothing is recorded at present, if that is so.
    #[must_use]
    pub const fn trouble(&self) -> Option<&Trouble> {
        self.trouble.as_ref()
    }

    /// Messages that were not recorded.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    fn put(&mut self, at_us: u64, topic: &str, schema: ros::Schema, data: &[u8]) {
        match self.try_put(at_us, topic, schema, data) {
            Ok(true) => {}
            Ok(false) => self.lost += 1,
            Err(why) => {
                self.lost += 1;
                self.fail(at_us, why);
            }
        }
    }

    /// Answers whether it was recorded; not while it is too early to try again.
    fn try_put(&mut self, at_us: u64, topic: &str, schema: ros::Schema, data: &[u8]) -> Result<bool, String> {
        if self.open.is_none() {
            if self.tried_us.is_some_and(|tried| self.trouble.is_some() && at_us.saturating_sub(tried) < RETRY_US) {
                return Ok(false);
            }
            self.tried_us = Some(at_us);
            self.open = Some(self.begin(at_us)?);
        }
        let Some(open) = &mut self.open else { return Ok(false) };
        let channel = match open.channels.get(topic) {
            Some(channel) => *channel,
            None => {
                let words = |error: mcap::McapError| error.to_string();
                let id = open.writer.add_schema(schema.name, "ros1msg", schema.text.as_bytes()).map_err(words)?;
                let id = open.writer.add_channel(id, topic, "ros1", &BTreeMap::new()).map_err(words)?;
                open.channels.insert(topic.to_owned(), id);
                id
            }
        };
        open.sequence = open.sequence.wrapping_add(1);
        open.bytes += data.len() as u64;
        let (log_time, publish_time) = (at_us.saturating_mul(1_000), at_us.saturating_mul(1_000));
        let header = MessageHeader { channel_id: channel, sequence: open.sequence, log_time, publish_time };
        open.writer.write_to_known_channel(&header, data).map_err(|error| error.to_string())?;
        Ok(true)
    }

    /// Begins the next part whose name is free.
    fn begin(&mut self, at_us: u64) -> Result<Open<P::Part>, String> {
        let part = loop {
            match self.parts.make(self.next_part) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists && self.next_part < u32::MAX => {
                    self.next_part += 1;
                }
                made => break made.map_err(|error| error.to_string())?,
            }
        };
        self.next_part = self.next_part.saturating_add(1);
        let options = WriteOptions::new().profile("ros1").compression(None).chunk_size(None).disable_seeking(true);
        let writer = options.create(NoSeek::new(part)).map_err(|error| error.to_string())?;
        Ok(Open { writer, channels: HashMap::new(), sequence: 0, bytes: 0, flushed_us: at_us })
    }

    fn fail(&mut self, at_us: u64, why: String) {
        self.open = None;
        self.tried_us = Some(at_us);
        self.trouble.get_or_insert(Trouble { why, since_us: at_us });
    }
}
