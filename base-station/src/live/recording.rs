//! Runs the recorder on a thread of its own.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::carrier::mavlink::commander::CommandRecord;
use crate::carrier::mavlink::voice::UplinkChange;
use crate::intake::{Carried, Judged};
use crate::recorder::{FLUSH_US, Files, Recorder, Sample};
use crate::recording::Trouble;
use crate::{Change, DroneId};

const WAITING: usize = 65_536;

enum What {
    Carried(Carried, Vec<Judged>, Vec<Sample>),
    Alarm(DroneId, Change),
    Uplink(u64, UplinkChange),
    Command(CommandRecord),
}

/// A recorder on a thread of its own.
#[derive(Debug)]
pub struct Recording {
    to: SyncSender<What>,
    trouble: Arc<Mutex<Option<Trouble>>>,
    thread: JoinHandle<Result<(), String>>,
}

impl Recording {
    /// Starts a recorder that writes these files.
    #[must_use]
    pub fn start(files: Files) -> Self {
        let (to, from) = sync_channel(WAITING);
        let trouble = Arc::new(Mutex::new(None));
        let told = Arc::clone(&trouble);
        let thread = thread::spawn(move || write(&from, Recorder::new(files), &told));
        Self { to, trouble, thread }
    }

    /// Records bytes that arrived, the verdicts on their objects, and the newly displayed data.
    pub fn carried(&self, carried: Carried, judged: Vec<Judged>, samples: Vec<Sample>) {
        let at_us = carried.at_us;
        self.offer(at_us, What::Carried(carried, judged, samples));
    }

    /// Records a new state of an uplink.
    pub fn uplink(&self, at_us: u64, told: UplinkChange) {
        self.offer(at_us, What::Uplink(at_us, told));
    }

    /// Records a new state of a command to a hold.
    pub fn command(&self, told: CommandRecord) {
        self.offer(told.at_us, What::Command(told));
    }

    /// Records an alarm that began or ended.
    pub fn alarm(&self, drone: DroneId, change: Change) {
        self.offer(change.at_us, What::Alarm(drone, change));
    }

    /// Returns the reason why nothing is recorded at present, if any.
    #[must_use]
    pub fn trouble(&self) -> Option<Trouble> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Writes the waiting data, and finishes the file.
    ///
    /// # Errors
    ///
    /// Returns the recorder's error.
    pub fn finish(self) -> Result<(), String> {
        drop(self.to);
        self.thread.join().unwrap_or_else(|_| Err("the recorder's thread died".into()))
    }

    fn offer(&self, at_us: u64, what: What) {
        let why = match self.to.try_send(what) {
            Ok(()) => return,
            Err(TrySendError::Full(_)) => "the disk is too slow",
            Err(TrySendError::Disconnected(_)) => "the recorder's thread died",
        };
        let trouble = Trouble { why: why.into(), since_us: at_us };
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(trouble);
    }
}

fn write(from: &Receiver<What>, mut recorder: Recorder<Files>, told: &Mutex<Option<Trouble>>) -> Result<(), String> {
    let half = Duration::from_micros(FLUSH_US / 2);
    // The recorder uses the time of the recorded data. Between arrivals that time advances in real time.
    let mut last = (0, Instant::now());
    loop {
        match from.recv_timeout(half) {
            Ok(What::Carried(carried, judged, samples)) => {
                last = (carried.at_us, Instant::now());
                recorder.carried(&carried, &judged, &samples);
            }
            Ok(What::Uplink(at_us, told)) => {
                last = (at_us, Instant::now());
                recorder.uplink(at_us, &told);
            }
            Ok(What::Command(told)) => {
                last = (told.at_us, Instant::now());
                recorder.command(&told);
            }
            Ok(What::Alarm(drone, change)) => {
                last = (change.at_us, Instant::now());
                recorder.alarm(drone, change);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return recorder.finish(),
        }
        let passed = u64::try_from(last.1.elapsed().as_micros()).unwrap_or(u64::MAX);
        recorder.tick(last.0.saturating_add(passed));
        *told.lock().unwrap_or_else(PoisonError::into_inner) = recorder.trouble().cloned();
    }
}
