//! Plays a recording back, at any pace and from any instant in it.

use std::fs::File;
use std::io::{self, BufReader};
use std::path::PathBuf;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Event, Inlet};
use crate::recorder::{Reader, Record};

/// The files of a recording, its parts in their order.
#[derive(Clone, Debug)]
pub struct Recording {
    parts: Vec<PathBuf>,
}

/// A summary of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Contents {
    /// The number of arrivals.
    pub records: u64,
    /// The instant of the first arrival, µs since 1970.
    pub first_us: u64,
    /// The instant of the last arrival, µs since 1970.
    pub last_us: u64,
    /// The damaged or truncated parts, with the position of the damage as text.
    pub torn: Vec<String>,
}

impl Recording {
    /// Returns the recording that consists of these files.
    #[must_use]
    pub const fn new(parts: Vec<PathBuf>) -> Self {
        Self { parts }
    }

    /// Returns the size of all files of the recording, bytes.
    ///
    /// # Errors
    ///
    /// Returns an error if a file's metadata cannot be read.
    pub fn bytes(&self) -> io::Result<u64> {
        self.parts.iter().map(|part| Ok(part.metadata()?.len())).sum()
    }

    /// Passes each record to `each` until `each` returns false; `progress` gets the number of bytes read. Returns the
    /// parts that are cut off.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be read.
    pub fn read(&self, mut each: impl FnMut(Record) -> bool, mut progress: impl FnMut(u64)) -> io::Result<Vec<String>> {
        let (mut torn, mut before) = (vec![], 0);
        for part in &self.parts {
            let mut reader = Reader::new(BufReader::new(File::open(part)?));
            while let Some(record) = reader.next_record()? {
                if !each(record) {
                    return Ok(torn);
                }
                progress(before + reader.bytes_read());
            }
            before += reader.bytes_read();
            let lost = reader.lost().iter().map(String::as_str).chain(reader.torn());
            torn.extend(lost.map(|why| format!("{}: {why}", part.display())));
        }
        Ok(torn)
    }

    /// Reads the whole recording and counts its records.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be read.
    pub fn contents(&self, progress: impl FnMut(u64)) -> io::Result<Contents> {
        let mut contents = Contents::default();
        let count = |record: Record| {
            let at_us = record.carried.at_us;
            if contents.records == 0 {
                contents.first_us = at_us;
            }
            contents.records += 1;
            contents.last_us = contents.last_us.max(at_us);
            true
        };
        let torn = self.read(count, progress)?;
        Ok(Contents { torn, ..contents })
    }
}

#[derive(Clone, Copy, Debug)]
struct Pace {
    /// The position in the recording, µs, that the playback had at the instant `since`.
    at_us: u64,
    since: Instant,
    /// The pace as a multiple of real time. 0 means that the playback stands still.
    speed: f64,
    jump_us: Option<u64>,
    changes: u64,
}

/// The time of a playback, which can be stopped, sped up and moved.
#[derive(Debug)]
pub struct Player {
    first_us: u64,
    last_us: u64,
    pace: Mutex<Pace>,
    changed: Condvar,
}

/// The fastest pace, as a multiple of real time.
pub const MAX_SPEED: f64 = 100.0;

impl Player {
    /// Returns a player of a recording with these contents. The playback begins at `from_us`.
    #[must_use]
    pub fn new(contents: &Contents, from_us: u64, speed: f64) -> Self {
        let from_us = from_us.clamp(contents.first_us, contents.last_us);
        let pace =
            Pace { at_us: from_us, since: Instant::now(), speed: fit(speed), jump_us: Some(from_us), changes: 0 };
        let Contents { first_us, last_us, .. } = *contents;
        Self { first_us, last_us, pace: Mutex::new(pace), changed: Condvar::new() }
    }

    /// Returns the present instant of the playback in the recording, µs since 1970, at most the recording's end.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.at(&self.pace())
    }

    /// Returns the instants at which the recording begins and ends, µs since 1970.
    #[must_use]
    pub const fn span_us(&self) -> (u64, u64) {
        (self.first_us, self.last_us)
    }

    /// Returns the pace as a multiple of real time. 0 means that the playback stands still.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.pace().speed
    }

    /// Returns the number of changes of pace or instant so far. A caller compares it with the number of its own change,
    /// to learn whether that change has taken effect.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.pace().changes
    }

    /// Sets the pace as a multiple of real time, 0 to [`MAX_SPEED`].
    pub fn set_speed(&self, speed: f64) {
        let mut pace = self.pace();
        let changes = pace.changes + 1;
        *pace = Pace { at_us: self.at(&pace), since: Instant::now(), speed: fit(speed), changes, ..*pace };
        self.changed.notify_all();
    }

    /// Jumps to this instant of the recording, µs since 1970.
    pub fn jump(&self, to_us: u64) {
        let mut pace = self.pace();
        let (to_us, changes) = (to_us.clamp(self.first_us, self.last_us), pace.changes + 1);
        *pace = Pace { at_us: to_us, since: Instant::now(), jump_us: Some(to_us), changes, ..*pace };
        self.changed.notify_all();
    }

    fn pace(&self) -> MutexGuard<'_, Pace> {
        self.pace.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn at(&self, pace: &Pace) -> u64 {
        let passed = pace.since.elapsed().as_secs_f64() * pace.speed * 1e6;
        pace.at_us.saturating_add(passed as u64).min(self.last_us)
    }

    /// Waits until the playback reaches `at_us`. Returns false if a jump ended the wait.
    fn wait(&self, at_us: u64) -> bool {
        let mut pace = self.pace();
        loop {
            if pace.jump_us.is_some() {
                return false;
            }
            let now_us = self.at(&pace);
            if now_us >= at_us {
                return true;
            }
            let left = (at_us - now_us) as f64 / 1e6 / pace.speed.max(1e-3);
            let left = Duration::try_from_secs_f64(left).unwrap_or(Duration::MAX).min(Duration::from_secs(3_600));
            let waited = self.changed.wait_timeout(pace, left);
            pace = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Feeds a station with the recording, by the player's time, until the station ends.
    ///
    /// # Errors
    ///
    /// Returns an error if a file cannot be read.
    pub fn play(&self, recording: &Recording, inlet: &Inlet) -> io::Result<()> {
        loop {
            // The records before the target of a jump are judged without waiting, because the state at the target
            // depends on them.
            let target_us = self.pace().jump_us.take().unwrap_or(self.first_us);
            if !inlet.push(Event::Restart(self.first_us)) {
                return Ok(());
            }
            let mut there = true;
            let mut hold = |record: Record| {
                let at_us = record.carried.at_us;
                let due = if at_us <= target_us { self.pace().jump_us.is_none() } else { self.wait(at_us) };
                there = due && inlet.push(Event::Played(record));
                there
            };
            recording.read(&mut hold, |_| {})?;
            if !self.wait(u64::MAX) {
                continue;
            }
            return Ok(());
        }
    }
}

fn fit(speed: f64) -> f64 {
    if speed.is_finite() { speed.clamp(0.0, MAX_SPEED) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::thread;

    use profile::criticality::{ActiveLoad, Writer};
    use profile::hold::HoldCommand;
    use profile::{GpsValues, HoldStatus, HoldValues, Layout, Profile, ReportedValues};

    use super::*;
    use crate::carrier::mavlink::commander::{CommandRecord, CommandState};
    use crate::drone::hold::Presence;
    use crate::intake::{Carried, Intake, Kind};
    use crate::live::{self, Time};
    use crate::recorder::{Files, Recorder};

    const START: u64 = 1_790_000_000_000_000;

    fn arrival(cycle: u32) -> Carried {
        let timestamp = 70_000 + 100 * cycle;
        let values = ReportedValues::absent(timestamp);
        let bytes = Profile::seal(&values, &[GpsValues::absent(timestamp)]).as_bytes().to_vec();
        let at_us = START + 100_000 * u64::from(cycle);
        Carried { at_us, kind: Kind::Datagrams, line: 0, from: "127.0.0.1:4000".into(), bytes }
    }

    fn record(path: PathBuf, cycles: std::ops::Range<u32>, killed: bool) {
        let mut recorder = Recorder::new(Files::new(path));
        let mut intake = Intake::default();
        for carried in cycles.map(arrival) {
            let judged = intake.take(&carried);
            recorder.carried(&carried, &judged, &[]);
            recorder.tick(carried.at_us);
        }
        if killed { std::mem::forget(recorder) } else { recorder.finish().unwrap() }
    }

    #[test]
    fn a_playback_shows_the_hold_and_the_commands_to_it() {
        let folder = std::env::temp_dir().join(format!("horus-base-playback-hold-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("hold.mcap");
        let mut recorder = Recorder::new(Files::new(path.clone()));
        let mut intake = Intake::default();
        let layout = Layout::for_receivers(1).unwrap().with_hold();
        let command = |state| {
            let (drone, command, since_us) = ("127.0.0.1:4000".to_owned(), HoldCommand::Lock, START);
            CommandRecord { drone, number: 3, command, state, since_us, at_us: START }
        };
        for cycle in 0..5 {
            let mut carried = arrival(cycle);
            let values = HoldValues { temperature: 4.5, ..HoldValues::absent(100 * cycle) };
            let hold = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &values);
            carried.bytes = [&[0; 32][..], &carried.bytes, &[0; 192], hold.as_bytes()].concat();
            assert_eq!(carried.bytes.len(), layout.map_len());
            let judged = intake.take(&carried);
            recorder.carried(&carried, &judged, &[]);
            recorder.command(&command(if cycle < 2 { CommandState::Pending } else { CommandState::Done }));
        }
        recorder.finish().unwrap();
        let recording = Recording::new(vec![path]);
        let contents = recording.contents(|_| {}).unwrap();
        let player = Arc::new(Player::new(&contents, contents.last_us, 0.0));
        let (inlet, station, _) = live::start(None, None, Time::Playback(Arc::clone(&player)), |_, _| {});
        let mut changes = station.changes();
        thread::spawn(move || player.play(&recording, &inlet));
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(async {
            while station.known().commands.back() != Some(&command(CommandState::Done)) {
                changes.changed().await.unwrap();
            }
        });
        let known = station.known();
        assert_eq!(known.commands.len(), 1, "the states of one command");
        let (_, drone) = known.intake.fleet().iter().next().unwrap();
        let hold = drone.hold().unwrap();
        assert_eq!((hold.held().unwrap().values.temperature, hold.presence(known.now_us)), (4.5, Presence::Valid));
        drop(known);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_playback_jumps_to_any_instant_of_a_recording_in_two_parts() {
        let folder = std::env::temp_dir().join(format!("horus-base-playback-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let parts = [folder.join("a.mcap"), folder.join("b.mcap")];
        record(parts[0].clone(), 0..100, true);
        record(parts[1].clone(), 100..200, false);
        let recording = Recording::new(parts.to_vec());
        let contents = recording.contents(|_| {}).unwrap();
        assert_eq!((contents.first_us, contents.last_us), (START, START + 19_900_000));
        assert!((195..=200).contains(&contents.records), "{} records", contents.records);

        let player = Arc::new(Player::new(&contents, START + 15_000_000, 0.0));
        let (inlet, station, _) = live::start(None, None, Time::Playback(Arc::clone(&player)), |_, _| {});
        let feeding = Arc::clone(&player);
        let feeder = thread::spawn(move || feeding.play(&recording, &inlet));
        let mut changes = station.changes();
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let mut until = |timestamp| {
            runtime.block_on(async {
                while station.known().intake.fleet().iter().next().and_then(|(_, drone)| drone.timestamp())
                    != Some(timestamp)
                {
                    changes.changed().await.unwrap();
                }
            });
        };
        until(70_000 + 15_000);
        player.jump(START + 5_000_000);
        until(70_000 + 5_000);
        assert_eq!(player.now_us(), START + 5_000_000);
        assert!(!feeder.is_finished());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
