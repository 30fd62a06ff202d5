//! Records a day of one drone's profiles, reads it, and judges it again. Checks memory, and that no data are missing.
//!
//!     cargo run -p base-station --example endurance -- [HOURS] [FOLDER]
//!
//! 24 hours are 8.64 million images of three receivers at 100 Hz. One in a hundred is damaged, and one in a hundred
//! arrives twice. The images go through the intake and the recorder of `horus-base`, without its threads, as fast as
//! possible. The files are not forced to the disk each half second, because that would take most of the time. Then the
//! `mcap` crate's reader checks each chunk's CRC, a fresh intake judges each part again, and the part is removed.
//! FOLDER holds about 8 GB meanwhile.
//!
//! The program fails if data are missing, if a second judgement of the data differs from the first, or if memory grows.

use std::io;
use std::path::{Path, PathBuf};

use base_station::intake::{Carried, Intake, Kind};
use base_station::live::playback::Recording;
use base_station::recorder::{Files, Parts, Recorder, Sample};
use base_station::{Verdict, export};
use indicatif::{ProgressBar, ProgressStyle};
use profile::{GpsStatus, GpsValues, LinkStatus, LinkValues, Profile, ReportedStatus, ReportedValues};

const HOUR: u64 = 360_000;

const START_US: u64 = 1_790_000_000_000_000;

/// The limit for the growth of memory after the first tenth of the work, kB. It allows for the index of a recording's
/// part, which grows until the part is finished.
pub(crate) const GROWTH_KB: u64 = 16 << 10;

#[derive(Debug, Default)]
pub(crate) struct Figures {
    pub(crate) arrivals: u64,
    pub(crate) shown: u64,
    pub(crate) refused: u64,
    pub(crate) parts: usize,
    pub(crate) bytes: u64,
    pub(crate) read: u64,
    /// The memory of the process, kB, at each tenth of the recording and then at each tenth of the reading.
    pub(crate) memory_kb: Vec<u64>,
}

impl Figures {
    #[must_use]
    pub(crate) fn growth_kb(&self) -> u64 {
        let first = self.memory_kb.first().copied().unwrap_or_default();
        self.memory_kb.iter().max().map_or(0, |most| most.saturating_sub(first))
    }

    #[must_use]
    pub(crate) fn is_good(&self) -> bool {
        self.read == self.arrivals && self.growth_kb() <= GROWTH_KB
    }
}

struct Unforced(Files);

impl Parts for Unforced {
    type Part = <Files as Parts>::Part;

    fn make(&mut self, number: u32) -> io::Result<Self::Part> {
        self.0.make(number)
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Records `images` images into `folder` and reads them again. `progress` gets the finished share, 0 to 1.
///
/// # Errors
///
/// Returns an error if a file cannot be written or read.
pub(crate) fn run(images: u64, folder: &Path, progress: impl Fn(f64)) -> io::Result<Figures> {
    let mut figures = Figures::default();
    let file = folder.join("endurance.mcap");
    let mut recorder = Recorder::new(Unforced(Files::new(file.clone())));
    let mut intake = Intake::default();
    let tenth = (images / 10).max(1);
    for number in 0..images {
        let carried = arrival(number);
        for _ in 0..if number % 100 == 50 { 2 } else { 1 } {
            let judged = intake.take(&carried);
            figures.arrivals += 1;
            figures.shown += judged.iter().filter(|judged| judged.verdict == Verdict::New).count() as u64;
            figures.refused += judged.iter().filter(|judged| !judged.verdict.is_intact()).count() as u64;
            recorder.carried(&carried, &judged, &Sample::of(&judged, intake.fleet()));
        }
        for (drone, change) in intake.tick(carried.at_us) {
            recorder.alarm(drone, change);
        }
        recorder.tick(carried.at_us);
        if let Some(trouble) = recorder.trouble() {
            return Err(io::Error::other(trouble.why.clone()));
        }
        if number % tenth == tenth - 1 {
            figures.memory_kb.push(resident_kb());
            progress(0.5 * number as f64 / images as f64);
        }
    }
    recorder.finish().map_err(io::Error::other)?;

    let mut again = Intake::default();
    for part in (0..).map(|number| Files::name(&file, number)).take_while(|part| part.exists()) {
        figures.parts += 1;
        figures.bytes += part.metadata()?.len();
        let (mut read, mut memory_kb) = (figures.read, vec![]);
        let total = figures.arrivals;
        let each = |record: base_station::recorder::Record| {
            let judged = export::judge(&mut again, &record);
            let found = record.found.iter().map(|found| found.verdict.as_str());
            let same = judged.iter().map(|judged| judged.verdict.code()).eq(found);
            read += u64::from(same);
            if read % tenth == 0 {
                memory_kb.push(resident_kb());
                progress(0.5 + 0.5 * read as f64 / total as f64);
            }
            same
        };
        let torn = Recording::new(vec![part.clone()]).read(each, |_| {})?;
        figures.read = read;
        figures.memory_kb.extend(memory_kb);
        if let Some(torn) = torn.first() {
            return Err(io::Error::other(torn.clone()));
        }
        std::fs::remove_file(part)?;
    }
    Ok(figures)
}

fn arrival(number: u64) -> Carried {
    let time = u32::try_from(number * 10).unwrap_or(u32::MAX);
    let angle = number as f64 / 3_000.0;
    let (latitude, longitude) = (47.497_9 + 1e-3 * angle.cos(), 8.728_9 + 1e-3 * angle.sin());
    let status = ReportedStatus::new().with_position_valid(true).with_receivers_agreeing(3);
    let reported = ReportedValues { status, latitude, longitude, altitude: 470.0, ..ReportedValues::absent(time) };
    let status = GpsStatus::new().with_position_valid(true).with_heard(true);
    let gps = GpsValues { status, latitude, longitude, altitude: 470.0, ..GpsValues::absent(time) };
    let link = LinkStatus::seal(&LinkValues { timestamp: time, ..LinkValues::default() });
    let mut bytes = [link.as_bytes(), Profile::seal(&reported, &[gps; 3]).as_bytes()].concat();
    if number % 100 == 99 {
        let at = 32 + (number / 100) as usize % 244;
        bytes[at] ^= 1 << (number / 7 % 8);
    }
    let from = "127.0.0.1:4000".to_owned();
    Carried { at_us: START_US + 10_000 * number, kind: Kind::Datagrams, line: 0, from, bytes }
}

fn resident_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or_default()
}

#[allow(dead_code, reason = "a test runs the same for minutes of flight")]
fn main() -> io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let hours: f64 = arguments.next().map_or(Ok(24.0), |argument| argument.parse()).map_err(io::Error::other)?;
    let folder = arguments.next().map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = folder.join(format!("horus-endurance-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let style = ProgressStyle::with_template("{bar:40} {percent} %, {eta} left");
    let bar = ProgressBar::new(1_000).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let began = std::time::Instant::now();
    let figures = run((hours * HOUR as f64) as u64, &folder, |share| bar.set_position((share * 1e3) as u64));
    bar.finish_and_clear();
    std::fs::remove_dir_all(&folder)?;
    let figures = figures?;
    let Figures { arrivals, shown, refused, parts, bytes, read, memory_kb } = &figures;
    println!("{hours} h: {arrivals} arrivals, {shown} objects shown, {refused} refused; {:.0?}", began.elapsed());
    println!("{parts} parts, {} MB; {read} arrivals read and found as they were", bytes >> 20);
    let megabytes: Vec<String> = memory_kb.iter().map(|kb| format!("{:.1}", *kb as f64 / 1_024.0)).collect();
    println!("resident memory at each tenth, MB: {}", megabytes.join(" "));
    if figures.is_good() { Ok(()) } else { Err(io::Error::other("something is missing, or memory grew")) }
}
