//! `horus-base`, the command line of a base station.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail};
use base_station::carrier::mavlink::voice::SYSTEM;
use base_station::carrier::mavlink::{Key, Signer, Verifier, Voice};
use base_station::carrier::published::is_station;
use base_station::export::{self, Form};
use base_station::intake::{Intake, Kind};
use base_station::live::broker::{self, Broker};
use base_station::live::page::{self, Access};
use base_station::live::serve::{self, Limits};
use base_station::live::tls::{Tls, Unusable};
use base_station::live::{self, Clock, Inlet, Station, Time, lines, playback};
use base_station::recorder::{Files, Reader, Recorder, Sample};
use base_station::recording::Made;
use base_station::{Change, DroneId};
use clap::{Args, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
#[cfg(unix)]
use tokio::signal::unix::{SignalKind, signal};

/// Judges, shows and records HORUS's objects that drones' flight controllers forward.
#[derive(Parser)]
#[command(name = "horus-base", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Show arriving data on a page, and record them if requested
    Serve {
        #[command(flatten)]
        listen: Listen,
        #[command(flatten)]
        allow: Allow,
        #[command(flatten)]
        output: Output,
    },
    /// Record arriving data, without a page
    Record {
        /// The file (MCAP); one that exists is not overwritten, the next free number is taken
        file: PathBuf,
        #[command(flatten)]
        listen: Listen,
    },
    /// Serve, and pass all judged data on to a broker (MQTT 5), for `subscribe` elsewhere; a recording also has what
    /// the broker did not accept
    Publish {
        #[command(flatten)]
        broker: BrokerArgs,
        /// This station's name: letters, digits, dots, hyphens, underscores, at most 32. Other stations name its drones
        /// `NAME/DRONE`, so no two stations at a broker may have the same name
        #[arg(long, value_name = "NAME")]
        station: String,
        #[command(flatten)]
        listen: Listen,
        #[command(flatten)]
        allow: Allow,
        #[command(flatten)]
        output: Output,
    },
    /// Show what other stations publish on a page, and record it if requested
    Subscribe {
        #[command(flatten)]
        broker: BrokerArgs,
        /// Show only what the station of this name publishes
        #[arg(long, value_name = "NAME")]
        station: Option<String>,
        #[command(flatten)]
        output: Output,
    },
    /// Play a recording back on the page
    Replay {
        /// The recording's parts, in their order
        #[arg(required = true)]
        files: Vec<PathBuf>,
        #[command(flatten)]
        page: Page,
        /// The pace as a multiple of the original one, up to 100; at 0 the playback stands still
        #[arg(long, default_value_t = 1.0)]
        speed: f64,
        /// Begin this many seconds after the recording's start
        #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
        from: f64,
    },
    /// Write a recording in a form that other programs read
    Export {
        /// The recording
        file: PathBuf,
        /// The form of the output; by default that of the output's file name
        #[arg(long)]
        form: Option<Forms>,
        /// The output file
        #[arg(long, short, value_name = "FILE")]
        output: PathBuf,
    },
    /// Copy the readable part of a recording that was cut off into a whole one
    Repair {
        /// The recording
        file: PathBuf,
        /// The output file
        #[arg(long, short, value_name = "FILE")]
        output: PathBuf,
    },
}

#[derive(Clone, Copy, ValueEnum)]
enum Forms {
    Csv,
    Gpx,
    Kml,
}

/// The lines to listen on. Without any of these: MAVLink on UDP port 14550.
#[derive(Args)]
struct Listen {
    /// MAVLink on this UDP address
    #[arg(long, value_name = "ADDRESS:PORT")]
    udp: Vec<SocketAddr>,
    /// Profiles or images, one in a datagram, on this UDP address
    #[arg(long, value_name = "ADDRESS:PORT")]
    datagrams: Vec<SocketAddr>,
    /// MAVLink on this serial port, at 57600 baud by default
    #[arg(long, value_name = "PORT[,BAUD]")]
    serial: Vec<String>,
    /// Profiles or images in frames that end with a zero byte (COBS), on this serial port
    #[arg(long, value_name = "PORT[,BAUD]")]
    plain_serial: Vec<String>,
    /// Accept only MAVLink messages that are signed with the key in this file, 64 hexadecimal digits; this excludes
    /// lines that cannot be signed
    #[arg(long, value_name = "FILE", conflicts_with_all = ["datagrams", "plain_serial"])]
    key: Option<PathBuf>,
    /// Send HEARTBEAT each second to every MAVLink serial port and to every UDP peer, so that an autopilot that waits
    /// for a ground station sends. Without this option the station sends nothing
    #[arg(long)]
    heartbeat: bool,
    /// Send HEARTBEAT also to this UDP address, before its peer has sent anything
    #[arg(long, value_name = "ADDRESS:PORT", requires = "heartbeat")]
    heartbeat_to: Vec<SocketAddr>,
    /// MAVLink system id of this station's messages. It must not be that of the ground station that flies the drone,
    /// which is often 255: otherwise the autopilot would not detect the loss of that ground station
    #[arg(long, value_name = "1-255", default_value_t = SYSTEM, value_parser = clap::value_parser!(u8).range(1..))]
    system_id: u8,
}

/// What users of the page may send to drones, signed with --key; by default nothing.
#[derive(Args)]
struct Allow {
    /// Allow users of the page to send uplink objects to drones, signed with --key
    #[arg(long, requires = "key")]
    uplink: bool,
    /// Allow users of the page to command drones' active holds (set-point, lock, unlock, clear shock), signed with
    /// --key. Commands travel in uplink objects, so --uplink is excluded
    #[arg(long, requires = "key", conflicts_with = "uplink")]
    hold_commands: bool,
}

/// The broker's arguments.
#[derive(Args)]
struct BrokerArgs {
    /// The broker: `mqtts://` for TLS, on port 8883 if none is given; otherwise nothing is encrypted, and the port is
    /// 1883
    #[arg(long, value_name = "[mqtts://]HOST[:PORT]")]
    broker: String,
    /// With TLS: the certificates of the authorities, one of which signed the broker's, are in this file (PEM)
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// With TLS: this station's own certificate is in this file (PEM), for a broker that requires one
    #[arg(long, value_name = "FILE", requires_all = ["ca", "certificate_key"])]
    certificate: Option<PathBuf>,
    /// With TLS: the key of this station's certificate is in this file (PEM), not encrypted
    #[arg(long, value_name = "FILE", requires = "certificate")]
    certificate_key: Option<PathBuf>,
    /// User and password for the broker, one a line, are in this file
    #[arg(long, value_name = "FILE")]
    login: Option<PathBuf>,
}

#[derive(Args)]
struct Page {
    /// The page's address; another one than this machine's own needs --page-login or --page-open
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8480")]
    http: SocketAddr,
    /// User and password for the page, one a line, are in this file
    #[arg(long, value_name = "FILE")]
    page_login: Option<PathBuf>,
    /// Serve the page on another address than this machine's own to every client, without a login
    #[arg(long, conflicts_with = "page_login")]
    page_open: bool,
    /// End after this many seconds
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<u64>,
}

/// The outputs for arriving data: the page, and a recording if requested.
#[derive(Args)]
struct Output {
    #[command(flatten)]
    page: Page,
    /// Record into this file as well (MCAP); one that exists is not overwritten, the next free number is taken
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
}

/// The interval at which the program checks for failures. The recorder tries again after twice that time.
const COMPLAIN: Duration = Duration::from_millis(500);

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Serve { listen, allow, output } => serve(&listen, &allow, output),
        Command::Record { file, listen } => record(&listen, file),
        Command::Publish { broker, station, listen, allow, output } => {
            publish(&broker, &station, &listen, &allow, output)
        }
        Command::Subscribe { broker, station, output } => subscribe(&broker, station.as_deref(), output),
        Command::Replay { files, page, speed, from } => replay(files, &page, speed, from),
        Command::Export { file, form, output } => export(&file, form, &output),
        Command::Repair { file, output } => repair(&file, output),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn serve(listen: &Listen, allow: &Allow, Output { page, record }: Output) -> Result<()> {
    let clock = Clock::begin();
    let (inlet, station, ended) = live::start(verifier(listen)?, files(record)?, Time::Clock(clock.clone()), tell);
    speak(listen, allow, &station)?;
    open(listen, &clock, &inlet)?;
    show(station.clone(), None, &page)?;
    finish(inlet, &station, ended)
}

fn record(listen: &Listen, file: PathBuf) -> Result<()> {
    let clock = Clock::begin();
    let (inlet, station, ended) = live::start(verifier(listen)?, files(Some(file))?, Time::Clock(clock.clone()), tell);
    speak(listen, &Allow { uplink: false, hold_commands: false }, &station)?;
    open(listen, &clock, &inlet)?;
    complain(station.clone());
    runtime()?.block_on(interrupted(None))?;
    eprintln!("{} drones, {} arrivals dropped", station.known().intake.fleet().iter().len(), station.dropped());
    finish(inlet, &station, ended)
}

fn publish(to: &BrokerArgs, name: &str, listen: &Listen, allow: &Allow, Output { page, record }: Output) -> Result<()> {
    let clock = Clock::begin();
    let broker = broker(to)?;
    let (outlet, unconnected) = broker::outlet(broker.clone(), station(name)?);
    let (verifier, files, time) = (verifier(listen)?, files(record)?, Time::Clock(clock.clone()));
    let (inlet, station, ended) = live::start_publishing(verifier, files, time, Some(outlet.clone()), tell);
    unconnected.connect(inlet.clone()).with_context(|| format!("cannot begin with {broker}"))?;
    speak(listen, allow, &station)?;
    open(listen, &clock, &inlet)?;
    eprintln!("publishing to {broker} as {name}");
    show(station.clone(), None, &page)?;
    if outlet.unpublished() > 0 {
        eprintln!("{} messages were not published", outlet.unpublished());
    }
    finish(inlet, &station, ended)
}

fn subscribe(to: &BrokerArgs, only: Option<&str>, Output { page, record }: Output) -> Result<()> {
    let clock = Clock::begin();
    let broker = broker(to)?;
    let only = only.map(station).transpose()?;
    let (inlet, station, ended) = live::start(None, files(record)?, Time::Clock(clock.clone()), tell);
    broker::subscribe(broker.clone(), only, 0, clock, inlet.clone())
        .with_context(|| format!("cannot begin with {broker}"))?;
    eprintln!("subscribed to {} at {broker}", only.unwrap_or("all stations"));
    show(station.clone(), None, &page)?;
    finish(inlet, &station, ended)
}

fn broker(args: &BrokerArgs) -> Result<Broker> {
    let (scheme, address) = args.broker.split_once("://").unwrap_or(("mqtt", &args.broker));
    let encrypted = match scheme {
        "mqtt" => false,
        "mqtts" => true,
        _ => bail!("{scheme}:// is no way to a broker: there are mqtt:// and, with TLS, mqtts://"),
    };
    let port = |digits: &str| digits.parse().with_context(|| format!("{digits} is no port"));
    let (host, port) = match address.rsplit_once(':') {
        // If an IPv6 address ends with a bracket, it has no port.
        Some((host, digits)) if !digits.ends_with(']') => (host, port(digits)?),
        _ => (address, if encrypted { 8883 } else { 1883 }),
    };
    let tls = match &args.ca {
        Some(ca) if encrypted => Some(tls(ca, args)?),
        Some(_) => bail!("--ca is for TLS, and the broker is called without it: mqtts://{host}"),
        None if encrypted => bail!(
            "TLS needs --ca FILE, the authority that signed the broker's certificate; for a public one \
             that of the system, often /etc/ssl/certs/ca-certificates.crt"
        ),
        None => None,
    };
    if encrypted && host.starts_with('[') {
        bail!("with TLS a broker is called by its name or its IPv4 address");
    }
    let login = args.login.as_deref().map(login).transpose()?;
    if login.is_some() && tls.is_none() {
        say("warning: user and password go to the broker unencrypted: anybody on the way can read them; use mqtts://");
    }
    Ok(Broker { host: host.to_owned(), port, login, tls })
}

/// Reads a user and a password from a file, one on each line.
fn login(file: &Path) -> Result<(String, String)> {
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut lines = text.lines().map(str::to_owned);
    lines.next().zip(lines.next()).with_context(|| format!("{} has not two lines", file.display()))
}

fn tls(ca: &Path, args: &BrokerArgs) -> Result<Tls> {
    let read = |file: &Path| std::fs::read(file).with_context(|| format!("cannot read {}", file.display()));
    let authorities = read(ca)?;
    let Some((certificate, key)) = args.certificate.as_deref().zip(args.certificate_key.as_deref()) else {
        return Tls::new(&authorities, None).with_context(|| ca.display().to_string());
    };
    let made = Tls::new(&authorities, Some((&read(certificate)?, &read(key)?)));
    let file = match &made {
        Err(Unusable::NoCertificate) => certificate,
        Err(Unusable::NoKey | Unusable::Refused(_)) => key,
        _ => ca,
    };
    made.with_context(|| file.display().to_string())
}

fn station(name: &str) -> Result<&str> {
    let words = "is no station's name: 1 to 32 letters, digits, dots, hyphens, underscores";
    if is_station(name) { Ok(name) } else { bail!("{name:?} {words}") }
}

fn replay(files: Vec<PathBuf>, page: &Page, speed: f64, from: f64) -> Result<()> {
    let recording = playback::Recording::new(files);
    let bar = progress(recording.bytes().context("cannot look at the recording")?);
    let contents = recording.contents(|bytes| bar.set_position(bytes)).context("cannot read the recording")?;
    bar.finish_and_clear();
    for torn in &contents.torn {
        eprintln!("cut off: {torn}");
    }
    if contents.records == 0 {
        bail!("there is nothing in the recording");
    }
    let from_us = contents.first_us.saturating_add((from.max(0.0) * 1e6) as u64);
    let player = Arc::new(playback::Player::new(&contents, from_us, speed));
    let (inlet, station, _) = live::start(None, None, Time::Playback(Arc::clone(&player)), |_, _| {});
    let fed = Arc::clone(&player);
    thread::spawn(move || {
        if let Err(error) = fed.play(&recording, &inlet) {
            eprintln!("error: the recording cannot be read any more: {error}");
        }
    });
    show(station, Some(player), page)
}

fn export(file: &Path, form: Option<Forms>, output: &Path) -> Result<()> {
    let ending = output.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    let form = match (form, ending) {
        (Some(Forms::Csv), _) | (None, "csv") => Form::Csv,
        (Some(Forms::Gpx), _) | (None, "gpx") => Form::Gpx,
        (Some(Forms::Kml), _) | (None, "kml") => Form::Kml,
        (None, _) => bail!("--form says what to write, where the output does not end with .csv, .gpx or .kml"),
    };
    let (mut reader, bar) = reader(file)?;
    let to = File::create_new(output).with_context(|| format!("cannot make {}", output.display()))?;
    let written = export::export(&mut reader, form, &mut BufWriter::new(to), |bytes| bar.set_position(bytes));
    bar.finish_and_clear();
    eprintln!("{} {}", written?, if form == Form::Csv { "objects" } else { "points" });
    told_torn(&reader);
    // A user may name only the first file of a recording. The newest part is then in a file with a higher number.
    let more: Vec<_> = (1..).map(|number| Files::name(file, number)).take_while(|part| part.exists()).collect();
    if let Some(last) = more.last() {
        eprintln!("{} alone: there are {} more beside it, the last is {}", file.display(), more.len(), last.display());
    }
    Ok(())
}

fn repair(file: &Path, output: PathBuf) -> Result<()> {
    let (mut reader, bar) = reader(file)?;
    if output.exists() {
        bail!("{} exists already", output.display());
    }
    let mut recorder = Recorder::new(Files::new(output));
    let mut intake = Intake::default();
    let mut records = 0_u64;
    while let Some(record) = reader.next_record()? {
        let judged = export::judge(&mut intake, &record);
        recorder.carried(&record.carried, &judged, &Sample::of(&judged, intake.fleet()));
        record.commands.iter().for_each(|told| recorder.command(told));
        for (drone, change) in intake.tick(record.carried.at_us) {
            recorder.alarm(drone, change);
        }
        recorder.tick(record.carried.at_us);
        if let Some(trouble) = recorder.trouble() {
            bail!("cannot write: {}", trouble.why);
        }
        records += 1;
        bar.set_position(reader.bytes_read());
    }
    bar.finish_and_clear();
    recorder.finish().map_err(|why| anyhow!("cannot write: {why}"))?;
    eprintln!("{records} arrivals");
    match told_torn(&reader) {
        false => Ok(()),
        true => bail!("something is lost; what could be read is in the copy"),
    }
}

fn reader(file: &Path) -> Result<(Reader<BufReader<File>>, ProgressBar)> {
    let from = File::open(file).with_context(|| format!("cannot open {}", file.display()))?;
    let bar = progress(from.metadata()?.len());
    Ok((Reader::new(BufReader::new(from)), bar))
}

/// Prints which parts of a recording could not be read. Returns whether there were any.
fn told_torn<R: std::io::Read>(reader: &Reader<R>) -> bool {
    for why in reader.lost() {
        eprintln!("a chunk is damaged and left out ({why}); all before and behind it is there");
    }
    if let Some(why) = reader.torn() {
        eprintln!("the recording is cut off ({why}); all before that is there");
    }
    reader.torn().is_some() || !reader.lost().is_empty()
}

fn progress(bytes: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {bytes} of {total_bytes}, {eta} left");
    ProgressBar::new(bytes).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

fn verifier(listen: &Listen) -> Result<Option<Verifier>> {
    Ok(key(listen)?.map(Verifier::new))
}

/// The number of the link in this station's signatures. Senders with the same key need different numbers.
const SIGNING_LINK: u8 = 254;

fn speak(listen: &Listen, allow: &Allow, station: &Station) -> Result<()> {
    if !listen.heartbeat && !allow.uplink && !allow.hold_commands {
        return Ok(());
    }
    let signer = key(listen)?.map(|key| Signer::new(key, SIGNING_LINK));
    let mut voice = Voice::new(listen.system_id, signer);
    if listen.heartbeat {
        voice = voice.with_heartbeat(listen.heartbeat_to.clone());
        eprintln!("sending HEARTBEAT as MAVLink system {}", listen.system_id);
    }
    if allow.hold_commands {
        voice = voice.with_commands();
        eprintln!("whoever opens the page can command drones' active holds");
    }
    if allow.uplink {
        voice = voice.with_uplinks();
        eprintln!("whoever opens the page can send uplinks to drones");
    }
    station.speak(voice);
    Ok(())
}

fn key(listen: &Listen) -> Result<Option<Key>> {
    let Some(file) = &listen.key else { return Ok(None) };
    let digits = std::fs::read_to_string(file).with_context(|| format!("cannot read the key {}", file.display()))?;
    Ok(Some(Key::from_hex(&digits).context("a key is 64 hexadecimal digits")?))
}

fn files(file: Option<PathBuf>) -> Result<Option<Files>> {
    let Some(file) = file else { return Ok(None) };
    let free = (0..).map(|number| Files::name(&file, number)).find(|name| !name.exists());
    if let Some(free) = free.filter(|free| *free != file) {
        eprintln!("{} exists: recording into {}", file.display(), free.display());
    }
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        bail!("there is no folder {} to record in", folder.display());
    }
    Ok(Some(Files::new(file)))
}

fn open(listen: &Listen, clock: &Clock, inlet: &Inlet) -> Result<()> {
    let mut number = 0_u16;
    let default = [SocketAddr::from(([0, 0, 0, 0], 14_550))];
    let lines = listen.udp.len() + listen.datagrams.len() + listen.serial.len() + listen.plain_serial.len();
    let udp = if lines == 0 { &default[..] } else { &listen.udp };
    let sockets = udp.iter().map(|address| (address, Kind::MavlinkDatagrams));
    for (address, kind) in sockets.chain(listen.datagrams.iter().map(|address| (address, Kind::Datagrams))) {
        let bound = lines::udp(*address, kind, number, clock.clone(), inlet.clone());
        let bound = bound.with_context(|| format!("cannot listen on UDP {address}"))?;
        eprintln!("listening on UDP {bound}, {}", words(kind));
        number += 1;
    }
    let ports = listen.serial.iter().map(|port| (port, Kind::MavlinkStream));
    for (port, kind) in ports.chain(listen.plain_serial.iter().map(|port| (port, Kind::Stream))) {
        let (path, baud) = match port.rsplit_once(',') {
            Some((path, baud)) => (path, baud.parse().with_context(|| format!("{baud} is no baud rate"))?),
            None => (port.as_str(), 57_600),
        };
        lines::serial(path.to_owned(), baud, kind, number, clock.clone(), inlet.clone());
        eprintln!("listening on {path}, {baud} baud, {}", words(kind));
        number += 1;
    }
    Ok(())
}

const fn words(kind: Kind) -> &'static str {
    match kind {
        Kind::MavlinkDatagrams | Kind::MavlinkStream => "MAVLink",
        Kind::Datagrams => "profiles as they are",
        Kind::Stream => "profiles in frames",
        Kind::Published => "what other stations publish",
    }
}

fn tell(drone: DroneId, change: Change) {
    let what = if change.raised { "ALARM" } else { "over " };
    say(&format!("drone {drone}: {what} {}", change.alarm));
}

fn say(words: &str) {
    eprintln!("{} {words}", export::time(Clock::begin().now_us()));
}

fn runtime() -> Result<tokio::runtime::Runtime> {
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?)
}

/// Waits until the user ends the program or `seconds` have passed.
async fn interrupted(seconds: Option<u64>) -> Result<()> {
    let time = async {
        match seconds {
            Some(seconds) => tokio::time::sleep(Duration::from_secs(seconds)).await,
            None => std::future::pending().await,
        }
    };
    // A service manager ends the program by the signal TERM. The recording must be whole then too.
    #[cfg(unix)]
    let mut term = signal(SignalKind::terminate())?;
    #[cfg(unix)]
    let term = term.recv();
    #[cfg(not(unix))]
    let term = std::future::pending::<Option<()>>();
    tokio::select! {
        signal = tokio::signal::ctrl_c() => signal.context("cannot wait for a signal"),
        _ = term => Ok(()),
        () = time => Ok(()),
    }
}

/// Prints when the recorder or a line begins to fail, and when it works again, because the user may have no page open.
fn complain(station: Station) {
    thread::spawn(move || {
        let mut told = BTreeMap::<String, String>::new();
        let mut files = 0;
        loop {
            let made = station.known().recording.as_ref().map(Made::names).unwrap_or_default();
            for name in made.iter().skip(files) {
                say(&format!("recording into {}", name.display()));
            }
            files = made.len();
            let mut troubles: BTreeMap<_, _> = {
                let known = station.known();
                let recorder = known.recorder.as_ref().map(|trouble| ("recording".to_owned(), trouble.why.clone()));
                known.lines.iter().cloned().chain(recorder).collect()
            };
            for (name, why) in troubles.iter().filter(|(name, _)| !told.contains_key(*name)) {
                say(&format!("{name} fails: {why}"));
            }
            for name in told.keys().filter(|name| !troubles.contains_key(*name)) {
                say(&format!("{name} works again"));
            }
            std::mem::swap(&mut told, &mut troubles);
            thread::sleep(COMPLAIN);
        }
    });
}

fn show(station: Station, player: Option<Arc<playback::Player>>, page: &Page) -> Result<()> {
    let mut access = Access::from(page.http);
    if let Some(file) = &page.page_login {
        let (user, password) = login(file)?;
        access = access.with_login(&format!("{user}:{password}"));
    } else if !page.http.ip().is_loopback() && !page.page_open {
        bail!(
            "whoever reaches {} would see every drone: --page-login FILE asks for a user and a password, --page-open \
             serves it to everybody",
            page.http
        );
    }
    complain(station.clone());
    runtime()?.block_on(async {
        let listener = tokio::net::TcpListener::bind(page.http).await;
        let listener = listener.with_context(|| format!("cannot serve a page on {}", page.http))?;
        let address = listener.local_addr()?;
        println!("http://{address}/");
        let router = page::router(station, player, access);
        // A graceful shutdown would wait for the event streams, which never end.
        tokio::select! {
            served = serve::serve(listener, router, Limits::default()) => served.context("the page ended"),
            ended = interrupted(page.seconds) => ended,
        }
    })
}

/// Ends the station, and waits until everything that has arrived is written.
fn finish(inlet: Inlet, station: &Station, ended: thread::JoinHandle<Result<(), String>>) -> Result<()> {
    inlet.close();
    drop(inlet);
    let written = ended.join().map_err(|_| anyhow!("the station's thread died"))?;
    if let Some(made) = station.known().recording.as_ref().map(Made::names) {
        match &made[..] {
            [] => eprintln!("nothing was recorded: nothing arrived"),
            names => names.iter().for_each(|name| eprintln!("recorded: {}", name.display())),
        }
    }
    written.map_err(|why| anyhow!("recording: {why}"))
}
