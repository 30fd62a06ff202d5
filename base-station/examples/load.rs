//! Measures the load that one `horus-base` carries: a thousand drones as MAVLink over UDP, and the time from a datagram
//! to its event on the page.
//!
//!     cargo run -p base-station --example load -- [DRONES] [SECONDS]
//!
//! MAVLink has 255 system ids; the drones above that use ids of 32 bits, which the `mavlink` crate reads. Each drone
//! sends {Link-Status, Reported-Position} and both messages of its three receivers ten times a second. The station and
//! its page run on threads of this process and share the processors with the drones and the page's readers. Each event
//! of a watched drone is compared with the instant at which its datagram was sent.
//!
//! The program fails if a message was dropped, an object was not shown, or the 99th percentile of the time from a
//! datagram to its event is above 50 ms.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpStream, UdpSocket};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use base_station::carrier::mavlink::tunnel::Tunnel;
use base_station::intake::Kind;
use base_station::live::server::Server;
use base_station::live::{self, Clock, Time, lines};
use base_station::{Bundle, Place, Who};
use mavlink::{MAVLinkV2MessageRaw, MavHeader};
use profile::{GpsValues, LinkStatus, LinkValues, Profile, ReportedStatus, ReportedValues};
use serde_json::Value;

const WATCHED: u32 = 8;

const BOUND_MS: f64 = 50.0;

fn main() -> Result<ExitCode, Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let drones: u32 = arguments.next().map_or(Ok(1_000), |argument| argument.parse())?;
    let seconds: u64 = arguments.next().map_or(Ok(30), |argument| argument.parse())?;
    let clock = Clock::begin();
    let (inlet, station, ended) = live::start(None, None, Time::Clock(clock.clone()), |_, _| {});
    let bound = lines::udp("127.0.0.1:0".parse()?, Kind::MavlinkDatagrams, 0, clock, inlet.clone())?;
    let server = Server::start(station.clone(), "127.0.0.1:0".parse()?)?;

    let cycles = seconds as usize * 10;
    let sent: Arc<Vec<Vec<AtomicU64>>> =
        Arc::new((0..WATCHED).map(|_| (0..cycles).map(|_| AtomicU64::new(0)).collect()).collect());
    let began = Instant::now();
    let over = Arc::new(AtomicBool::new(false));
    let step = drones / WATCHED.min(drones);
    let watched: Vec<u32> = (0..WATCHED.min(drones)).map(|nth| 1 + nth * step).collect();
    let watchers: Vec<_> = watched
        .iter()
        .enumerate()
        .map(|(nth, system)| {
            let (over, sent, address, system) = (Arc::clone(&over), Arc::clone(&sent), server.address(), *system);
            thread::spawn(move || watch(address, system, &sent[nth], began, &over))
        })
        .collect();

    let socket = UdpSocket::bind("127.0.0.1:0")?;
    socket.connect(bound)?;
    let mut datagrams = 0_u64;
    for cycle in 0..cycles {
        for system in 1..=drones {
            let due = Duration::from_millis(100) * cycle as u32 + Duration::from_millis(100) * (system - 1) / drones;
            sleep(due.saturating_sub(began.elapsed()));
            let time = 70_000 + 100 * cycle as u32;
            let nth = watched.iter().position(|watched| *watched == system);
            for message in messages(system, cycle as u8, time)? {
                if let Some(nth) = nth {
                    let now = u64::try_from(began.elapsed().as_nanos())?;
                    // The position is in the first message of a cycle, so only that message's instant is kept.
                    let _ = sent[nth][cycle].compare_exchange(0, now, Ordering::Relaxed, Ordering::Relaxed);
                }
                socket.send(&message)?;
                datagrams += 1;
            }
        }
    }
    let late = began.elapsed().saturating_sub(Duration::from_secs(seconds));
    sleep(Duration::from_secs(1));
    over.store(true, Ordering::Relaxed);
    let mut took: Vec<f64> = watchers.into_iter().flat_map(|watcher| watcher.join().unwrap_or_default()).collect();
    took.sort_by(f64::total_cmp);

    let known = station.known();
    let shown: u64 = (1..=drones)
        .filter_map(|system| known.intake.fleet().get(Who::System(system).first()))
        .map(|drone| drone.counts().new)
        .sum();
    drop(known);
    let objects = cycles as u64 * u64::from(drones) * 5;
    let at = |share: f64| took.get((took.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    println!("{drones} drones, {seconds} s, {datagrams} datagrams, the last {} ms late", late.as_millis());
    println!("dropped {}, objects shown {shown} of {objects}", station.dropped());
    println!("resident memory {} MB", resident_kb() / 1_024);
    println!(
        "datagram to page event, {} events: median {:.1} ms, 99 % {:.1} ms, most {:.1} ms",
        took.len(),
        at(0.5),
        at(0.99),
        took.last().copied().unwrap_or(f64::NAN)
    );
    inlet.close();
    let _ = ended.join();
    let good = station.dropped() == 0 && shown == objects && at(0.99) <= BOUND_MS;
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn messages(system: u32, sequence: u8, time: u32) -> Result<Vec<Vec<u8>>, Box<dyn std::error::Error>> {
    let status = ReportedStatus::new().with_position_valid(true);
    let (latitude, longitude) = (47.0 + f64::from(system) / 1e4, 8.0);
    let reported = ReportedValues { status, latitude, longitude, ..ReportedValues::absent(time) };
    let link = LinkStatus::seal(&LinkValues { timestamp: time, ..LinkValues::default() });
    let image = [link.as_bytes(), Profile::<3>::seal(&reported, &[GpsValues::absent(time); 3]).as_bytes()].concat();
    let units = [(Place::LinkStatus, 0..96), (Place::Gps(1), 96..216), (Place::Gps(3), 216..276)];
    let message = |(first, bytes): (Place, std::ops::Range<usize>)| {
        let tunnel = Tunnel::of(&Bundle::from_first(first, &image[bytes]).ok_or("whole objects")?).ok_or("they fit")?;
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(MavHeader { system_id: system, component_id: 1, sequence }, &tunnel);
        Ok(raw.raw_bytes().to_vec())
    };
    units.into_iter().map(message).collect()
}

/// Reads the page's events of a drone. Returns the time from each sample's datagram to the sample's first event, ms.
fn watch(
    address: std::net::SocketAddr,
    system: u32,
    sent: &[AtomicU64],
    began: Instant,
    over: &AtomicBool,
) -> Vec<f64> {
    let mut took = vec![];
    let Ok(mut stream) = TcpStream::connect(address) else { return took };
    if write!(stream, "GET /events?drone={system} HTTP/1.1\r\nHost: localhost\r\n\r\n").is_err() {
        return took;
    }
    let mut last = None;
    for line in BufReader::new(stream).lines().map_while(Result::ok) {
        let now = began.elapsed();
        if over.load(Ordering::Relaxed) {
            break;
        }
        let Some(state) = line.strip_prefix("data: ").and_then(|text| serde_json::from_str::<Value>(text).ok()) else {
            continue;
        };
        let time = state["drone"]["time_ms"].as_u64();
        if time.is_none() || time == last {
            continue;
        }
        last = time;
        let cycle = time.unwrap_or_default().saturating_sub(70_000) / 100;
        let at = sent.get(cycle as usize).map_or(0, |at| at.load(Ordering::Relaxed));
        took.push((now.as_nanos() as f64 - at as f64) / 1e6);
    }
    took
}

fn resident_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or_default()
}
