//! Runs a base station: its lines, its clock, the recorder's thread, and the notifications to the page.
//!
//! # Threads
//!
//! | thread | what |
//! |---|---|
//! | one for each line | waits for bytes, timestamps them, passes them on to the station |
//! | station | judges and keeps the objects that arrive, updates alarms every [`TICK`] |
//! | recorder | writes the recording, so that a slow disk delays nothing else |
//! | one for each broker | passes data on to it, or receives from it ([`broker`]) |
//! | page | serves the page, where the program has other things to do ([`server`]) |
//!
//! In a playback, one thread reads the recording, and no line has a thread.
//!
//! Bounded queues connect the threads. A full queue drops the newest item. The page shows how many items were dropped.

pub mod broker;
pub mod lines;
pub mod mouths;
pub mod page;
pub mod playback;
mod recording;
pub mod serve;
pub mod server;
pub mod tls;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use tokio::sync::watch;

use crate::carrier::mavlink::{Verifier, Voice};
use crate::intake::{Carried, Intake};
use crate::recorder::{Files, Record, Sample};
use crate::station::history::History;
pub use crate::station::{KEPT_CHANGES, KEPT_COMMANDS, StationData, history};
use crate::{Bundle, Change, DroneId, Verdict, export};
use mouths::Mouths;
pub use recording::Recording;

/// The longest interval between updates of the alarms.
pub const TICK: Duration = Duration::from_millis(20);

/// The greatest number of arrivals that may wait: those of a thousand drones at 10 Hz in six seconds.
const WAITING: usize = 65_536;

const UNPUBLISHED_US: u64 = 5_000_000;

/// A clock of µs since 1970 that does not go back: the system's time at its start plus the elapsed time.
#[derive(Clone, Debug)]
pub struct Clock {
    unix_us: u64,
    passed: Passed,
}

#[derive(Clone, Debug)]
enum Passed {
    Since(Instant),
    /// The time since the clock's start as the caller has set it, µs.
    Told(Arc<AtomicU64>),
}

impl Clock {
    /// Returns a clock that begins now.
    #[must_use]
    pub fn begin() -> Self {
        Self { unix_us: unix_us(), passed: Passed::Since(Instant::now()) }
    }

    /// Returns a clock for a caller that sets the elapsed time, µs. The caller must not set it back.
    #[must_use]
    pub fn told(passed_us: Arc<AtomicU64>) -> Self {
        Self { unix_us: unix_us(), passed: Passed::Told(passed_us) }
    }

    /// Returns the present time of the clock, µs since 1970.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        let passed_us = match &self.passed {
            Passed::Since(began) => u64::try_from(began.elapsed().as_micros()).unwrap_or(u64::MAX),
            Passed::Told(passed_us) => passed_us.load(Ordering::Relaxed),
        };
        self.unix_us.saturating_add(passed_us)
    }
}

fn unix_us() -> u64 {
    let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(unix.as_micros()).unwrap_or_default()
}

/// An event of a line.
#[derive(Debug)]
pub enum Event {
    /// Bytes arrived on the line.
    Carried(Carried),
    /// The line failed, or works again.
    Line {
        /// The name of the line.
        name: String,
        /// The line's error; `None` if the line works again.
        why: Option<String>,
    },
    /// A record of a recording that is played back.
    Played(Record),
    /// A playback begins anew at this instant of its recording, µs. All state is dropped.
    Restart(u64),
    /// No further event comes, so the station ends.
    End,
}

/// Passes the events of one line on to the station.
#[derive(Clone, Debug)]
pub struct Inlet {
    to: SyncSender<Event>,
    dropped: Arc<AtomicU64>,
    mouths: Mouths,
}

impl Inlet {
    /// Passes an event on to the station, or counts it as dropped if too many events wait. Returns whether the station
    /// still exists.
    #[must_use]
    pub fn offer(&self, event: Event) -> bool {
        match self.to.try_send(event) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }

    /// Ends the station once it has processed the waiting events.
    pub fn close(&self) {
        let _ = self.to.send(Event::End);
    }

    /// Passes a playback's event on to the station once the queue has room. Returns whether the station still exists.
    #[must_use]
    pub fn push(&self, event: Event) -> bool {
        self.to.send(event).is_ok()
    }
}

/// A running station, for threads that read its state.
#[derive(Clone, Debug)]
pub struct Station {
    known: Arc<Mutex<StationData>>,
    changes: watch::Receiver<u64>,
    dropped: Arc<AtomicU64>,
    mouths: Mouths,
}

impl Station {
    /// Enables the station's own messages, which `voice` makes.
    pub fn speak(&self, voice: Voice) {
        self.known().voice = Some(voice);
    }

    /// Returns the present state. The station waits until the returned guard is dropped.
    pub fn known(&self) -> MutexGuard<'_, StationData> {
        // A poisoned lock is ignored: a thread that panicked while it held the lock has not changed the state.
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a channel whose counter increases with every arrival and every [`TICK`].
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changes.clone()
    }

    /// Returns the number of arrivals that were dropped because too many already waited for the station.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// The source of a station's time.
#[derive(Clone, Debug)]
pub enum Time {
    /// A clock gives the time.
    Clock(Clock),
    /// A playback gives the time.
    Playback(Arc<playback::Player>),
}

impl Time {
    fn now_us(&self) -> u64 {
        match self {
            Self::Clock(clock) => clock.now_us(),
            Self::Playback(player) => player.now_us(),
        }
    }
}

/// Starts a station. It ends when an inlet is closed or all inlets are gone; then it writes everything, and the
/// returned thread ends. `told` gets each alarm that begins or ends.
#[must_use]
pub fn start(
    verifier: Option<Verifier>,
    files: Option<Files>,
    time: Time,
    told: impl FnMut(DroneId, Change) + Send + 'static,
) -> (Inlet, Station, thread::JoinHandle<Result<(), String>>) {
    start_publishing(verifier, files, time, None, told)
}

/// Starts a station like [`start`], and passes judged data on to a broker if there is an `outlet`.
#[must_use]
pub fn start_publishing(
    verifier: Option<Verifier>,
    files: Option<Files>,
    time: Time,
    outlet: Option<broker::Outlet>,
    told: impl FnMut(DroneId, Change) + Send + 'static,
) -> (Inlet, Station, thread::JoinHandle<Result<(), String>>) {
    let (to, from) = sync_channel(WAITING);
    let dropped = Arc::new(AtomicU64::new(0));
    let recording = files.as_ref().map(Files::made);
    let known = StationData { intake: Intake::new(verifier), recording, ..StationData::default() };
    let known = Arc::new(Mutex::new(known));
    let (changed, changes) = watch::channel(0);
    let mouths = Mouths::default();
    let station = Station { known, changes, dropped: Arc::clone(&dropped), mouths: mouths.clone() };
    let inside = station.clone();
    let handle = thread::spawn(move || {
        let recording = files.map(Recording::start);
        run(&from, &inside, &changed, &time, recording.as_ref(), outlet.as_ref(), told);
        recording.map_or(Ok(()), Recording::finish)
    });
    (Inlet { to, dropped, mouths }, station, handle)
}

#[derive(Default)]
struct Unpublished {
    count: u64,
    since_us: u64,
}

impl Unpublished {
    fn tell(&mut self, known: &mut StationData, count: u64) {
        const NAME: &str = "publishing";
        if count > self.count {
            *self = Self { count, since_us: known.now_us };
            known.lines.retain(|(name, _)| name != NAME);
            known.lines.push((NAME.into(), format!("{count} messages were not handed on to the broker")));
        } else if known.now_us.saturating_sub(self.since_us) > UNPUBLISHED_US {
            known.lines.retain(|(name, _)| name != NAME);
        }
    }
}

fn run(
    from: &Receiver<Event>,
    station: &Station,
    changed: &watch::Sender<u64>,
    time: &Time,
    recording: Option<&Recording>,
    outlet: Option<&broker::Outlet>,
    mut told: impl FnMut(DroneId, Change),
) {
    let mut ticked = Instant::now();
    let mut unpublished = Unpublished::default();
    loop {
        let event = from.recv_timeout(TICK.saturating_sub(ticked.elapsed()));
        if matches!(event, Err(RecvTimeoutError::Disconnected)) {
            return;
        }
        let mut known = station.known();
        // Several waiting events cause a single notification of the readers.
        for event in event.into_iter().chain(from.try_iter().take(256)) {
            match event {
                Event::Carried(carried) => {
                    let hand_on = |drone, bundle: &Bundle<'_>, verdicts: &[Verdict]| {
                        if let Some(outlet) = outlet {
                            outlet.offer(drone, carried.at_us, bundle, verdicts);
                        }
                    };
                    let judged = known.take(&carried, hand_on);
                    if let Some(recording) = recording {
                        let samples = Sample::of(&judged, known.intake.fleet());
                        recording.carried(carried, judged, samples);
                    }
                }
                Event::Played(record) => {
                    export::judge(&mut known.intake, &record);
                    record.commands.iter().for_each(|told| known.note_command(told.clone()));
                    known.now_us = known.now_us.max(record.carried.at_us);
                    // The history uses the time of the recorded data. During a jump a playback's own time is ahead of
                    // the data.
                    let StationData { history, intake, .. } = &mut *known;
                    history.look(record.carried.at_us, intake.fleet());
                }
                Event::Line { name, why } => {
                    known.lines.retain(|(other, _)| *other != name);
                    known.lines.extend(why.map(|why| (name, why)));
                }
                Event::End => return,
                Event::Restart(at_us) => {
                    known.intake = Intake::default();
                    known.history = History::default();
                    known.alarms.clear();
                    known.commands.clear();
                    known.now_us = at_us;
                }
            }
        }
        if ticked.elapsed() >= TICK {
            ticked = Instant::now();
            let now_us = time.now_us().max(known.now_us);
            for (drone, change) in known.tick(now_us) {
                told(drone, change);
                if let Some(recording) = recording {
                    recording.alarm(drone, change);
                }
            }
            if matches!(time, Time::Clock(_)) {
                known.look();
            }
            let StationData { voice, intake, .. } = &mut *known;
            for (to, bytes) in voice.as_mut().map(|voice| voice.tick(now_us, intake.fleet())).unwrap_or_default() {
                station.mouths.send(to, &bytes);
            }
            for told in voice.as_mut().map(Voice::take_told).unwrap_or_default() {
                if let Some(recording) = recording {
                    recording.uplink(now_us, told);
                }
            }
            let commands = voice.as_mut().map(Voice::take_commands).unwrap_or_default();
            for told in commands {
                if let Some(recording) = recording {
                    recording.command(told.clone());
                }
                known.note_command(told);
            }
            known.recorder = recording.and_then(Recording::trouble);
            if let Some(outlet) = outlet {
                unpublished.tell(&mut known, outlet.unpublished());
            }
        }
        drop(known);
        changed.send_modify(|count| *count = count.wrapping_add(1));
    }
}
