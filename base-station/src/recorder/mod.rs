//! Records every byte that a carrier brought, with its time and the verdicts on its objects, in an MCAP file.
//!
//! **Contents.** `/carried` has the bytes and the verdicts, which suffice for a playback. `/alarms` has the alarms that
//! began or ended. `/drone/ID/…` has positions for maps, the state with agreement and attitude, and the link.
//! `/drone/ID/hold` has Hold-Status. `/uplinks` and `/hold-commands` have the uplinks and the commands to holds that
//! this station sent, and their states. The schemas in the file, in ROS 1's language,
//! let other tools such as Foxglove open it.
//!
//! **Crashes.** A chunk of the file is written whole, at least every [`FLUSH_US`], and forced to the disk. So a killed
//! process or a power loss costs at most the last half second. [`Reader`] checks each chunk's CRC before it returns the
//! chunk's data, leaves out damaged chunks, and ends where the file was cut.
//!
//! **A full disk** does not end the recorder. Lost data are counted and reported ([`Recorder::trouble`]). After
//! [`RETRY_US`] the recorder tries again in another part, because nothing can follow a part that was cut off. The
//! trouble is over once data are on the disk again.
//!
//! **Parts.** After [`PART_BYTES`] another part is begun, because MCAP's index of a part takes memory.

mod reading;
mod ros;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{WriteOptions, Writer};

use profile::{HoldValues, LinkValues, ReportedValues};

use crate::carrier::mavlink::commander::CommandRecord;
use crate::carrier::mavlink::voice::UplinkChange;
use crate::drone::hold::HoldState;
use crate::intake::{Carried, Judged};
use crate::recording::{Made, Trouble};
use crate::{Change, DroneId, Fleet, Place, Verdict};

pub use reading::{Reader, Record};
pub use ros::Found;

/// The longest time until a chunk is written to the disk, µs.
pub const FLUSH_US: u64 = 500_000;

/// The time after a failure until the recorder tries again, µs.
pub const RETRY_US: u64 = 1_000_000;

/// The size at which a part of a recording is finished, bytes.
pub const PART_BYTES: u64 = 512 << 20;

const COMMANDS: &str = "/hold-commands";

/// Makes the parts of a recording.
pub trait Parts {
    /// A writer to which a part's data go, such as a file.
    type Part: Write;

    /// Makes the part of this number, from 0, without overwriting an existing one.
    ///
    /// # Errors
    ///
    /// Returns an error if the part cannot be made.
    fn make(&mut self, number: u32) -> io::Result<Self::Part>;

    /// Forces the data of the last part onto the disk.
    ///
    /// # Errors
    ///
    /// Returns an error if the data cannot be forced onto the disk.
    fn sync(&mut self) -> io::Result<()>;
}

/// The parts of a recording as files beside each other: `flight.mcap`, `flight.1.mcap`, …
#[derive(Debug)]
pub struct Files {
    path: PathBuf,
    last: Option<File>,
    made: Made,
}

impl Files {
    /// Returns the files of a recording whose first file has this name.
    #[must_use]
    pub fn new(path: PathBuf) -> Self {
        Self { path, last: None, made: Made::default() }
    }

    /// Returns the list of the files, which grows as the recorder makes them. Names of existing files are skipped.
    #[must_use]
    pub fn made(&self) -> Made {
        self.made.clone()
    }

    /// Returns the file name of the part with this number.
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
        self.made.add(name);
        self.last = Some(file.try_clone()?);
        Ok(BufWriter::new(file))
    }

    fn sync(&mut self) -> io::Result<()> {
        self.last.as_ref().map_or(Ok(()), File::sync_data)
    }
}

/// Data that are newly displayed, in plain values for other tools.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sample {
    /// A valid position: degrees north, degrees east, m above the ellipsoid.
    Position(DroneId, Place, [f64; 3]),
    /// HORUS's state, and the drone's attitude.
    State(DroneId, ReportedValues),
    /// The values of Link-Status.
    Link(DroneId, LinkValues),
    /// The values of Hold-Status.
    Hold(DroneId, HoldValues),
}

impl Sample {
    /// Returns the samples of the objects in `judged` that `fleet` shows as new.
    #[must_use]
    pub fn of(judged: &[Judged], fleet: &Fleet) -> Vec<Self> {
        let mut samples = vec![];
        for Judged { drone: id, place, .. } in judged.iter().filter(|judged| judged.verdict == Verdict::New) {
            let Some(drone) = fleet.get(*id) else { continue };
            match place {
                Place::LinkStatus => samples.extend(drone.link().map(|held| Self::Link(*id, held.values))),
                Place::Reported => {
                    let Some(values) = drone.reported().map(|held| held.values) else { continue };
                    samples.push(Self::State(*id, values));
                    if values.status.position_valid() {
                        let position = [values.latitude, values.longitude, values.altitude];
                        samples.push(Self::Position(*id, *place, position));
                    }
                }
                Place::Gps(receiver) => {
                    let values = drone.gps(usize::from(*receiver)).map(|held| held.values);
                    let valid = values.filter(|values| values.status.position_valid());
                    let position = valid.map(|values| [values.latitude, values.longitude, values.altitude]);
                    samples.extend(position.map(|position| Self::Position(*id, *place, position)));
                }
                // No samples are made of Port-Status and uplinks. The part of the station that sends an uplink reports
                // its state.
                Place::Hold => {
                    let held = drone.hold().and_then(HoldState::held);
                    samples.extend(held.map(|held| Self::Hold(*id, held.values)));
                }
                Place::PortStatus | Place::Uplink => {}
            }
        }
        samples
    }
}

struct Open<W: Write> {
    writer: Writer<NoSeek<W>>,
    channels: HashMap<String, u16>,
    sequence: u32,
    bytes: u64,
    flushed_us: u64,
}

/// The writer of a recording. See the [module](self).
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
    /// Returns a recorder. It makes no file before the first record.
    #[must_use]
    pub const fn new(parts: P) -> Self {
        Self { parts, open: None, next_part: 0, trouble: None, tried_us: None, lost: 0, part_bytes: PART_BYTES }
    }

    /// Records bytes that arrived, the verdicts on their objects, and the newly displayed data.
    pub fn carried(&mut self, carried: &Carried, judged: &[Judged], samples: &[Sample]) {
        let at_us = carried.at_us;
        self.put(at_us, "/carried", ros::CARRIED, &ros::carried(carried, judged));
        for sample in samples {
            let (topic, schema, data) = match sample {
                Sample::Position(drone, place, position) => {
                    (format!("/drone/{drone}/{place}"), ros::FIX, ros::fix(at_us, *position))
                }
                Sample::State(drone, values) => (format!("/drone/{drone}/state"), ros::STATE, ros::state(values)),
                Sample::Link(drone, values) => (format!("/drone/{drone}/link"), ros::LINK, ros::link(values)),
                Sample::Hold(drone, values) => (format!("/drone/{drone}/hold"), ros::HOLD, ros::hold(values)),
            };
            self.put(at_us, &topic, schema, &data);
        }
    }

    /// Records the state that an uplink of this station took at `at_us`.
    pub fn uplink(&mut self, at_us: u64, told: &UplinkChange) {
        self.put(at_us, "/uplinks", ros::UPLINK, &ros::uplink(told));
    }

    /// Records the state of a command of this station to a hold.
    pub fn command(&mut self, told: &CommandRecord) {
        self.put(told.at_us, COMMANDS, ros::COMMAND, &ros::command(told));
    }

    /// Records an alarm that began or ended.
    pub fn alarm(&mut self, drone: DroneId, change: Change) {
        let data = ros::alarm(drone, change.alarm, change.raised);
        self.put(change.at_us, "/alarms", ros::ALARM, &data);
    }

    /// Writes the waiting data if they are due; to be called at least every [`FLUSH_US`].
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

    /// Finishes the file of the present part.
    ///
    /// # Errors
    ///
    /// Returns the recorder's error. Data that are already on the disk stay readable.
    pub fn finish(mut self) -> Result<(), String> {
        let Some(mut open) = self.open.take() else { return Ok(()) };
        open.writer.finish().map_err(|error| error.to_string())?;
        self.parts.sync().map_err(|error| error.to_string())
    }

    /// Returns the reason why nothing is recorded at present, if any.
    #[must_use]
    pub const fn trouble(&self) -> Option<&Trouble> {
        self.trouble.as_ref()
    }

    /// Returns the number of messages that were not recorded.
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

    /// Records a message, unless a failure was less than [`RETRY_US`] ago. Returns whether it was recorded.
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
