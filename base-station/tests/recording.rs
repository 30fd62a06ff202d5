//! Tests `horus-base record` in a separate process that is killed, and on a full disk.

use crate::common;

use std::io::{BufRead, BufReader, Read};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use base_station::live::playback::Recording;
use common::image;

const BOUND: Duration = Duration::from_secs(60);

/// Starts `horus-base` from a shell that first sets a limit. Returns the process, its output, and the address of its
/// socket.
fn start(arguments: &[&str], file: &Path, limit: &str) -> (Child, BufReader<ChildStderr>, SocketAddr) {
    let mut command = Command::new("sh");
    // When a file would exceed its limit, the system ends the process by a signal. This trap makes the write fail
    // instead, as on a full disk.
    command.arg("-c").arg(format!("trap '' XFSZ; {limit}; exec \"$0\" \"$@\"")).arg(env!("CARGO_BIN_EXE_horus-base"));
    command.args(arguments).args(["--datagrams", "127.0.0.1:0"]).arg(file);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    let address = line.strip_prefix("listening on UDP ").and_then(|rest| rest.split(',').next()?.parse().ok());
    (child, said, address.unwrap_or_else(|| panic!("{line:?}")))
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("horus-base-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn recorded(parts: Vec<PathBuf>) -> (Vec<u32>, Vec<String>) {
    let mut times = vec![];
    let each = |record: base_station::recorder::Record| {
        times.push(u32::from_le_bytes(*record.carried.bytes[32..].first_chunk().unwrap()));
        true
    };
    let torn = Recording::new(parts).read(each, |_| {}).unwrap();
    (times, torn)
}

#[test]
fn a_recorder_that_is_killed_loses_less_than_a_second() {
    let folder = folder("killed");
    let file = folder.join("flight.mcap");
    let (mut child, _said, address) = start(&["record"], &file, "true");
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let began = Instant::now();
    let mut sent = vec![];
    while began.elapsed() < Duration::from_secs(3) {
        let time = 70_000 + 10 * sent.len() as u32;
        socket.send_to(&image(time), address).unwrap();
        sent.push((time, began.elapsed()));
        thread::sleep(Duration::from_millis(10));
    }
    let killed = began.elapsed();
    child.kill().unwrap();
    child.wait().unwrap();
    let (times, torn) = recorded(vec![file]);
    assert!(times.len() > 10 && times.iter().eq(sent.iter().map(|(time, _)| time).take(times.len())));
    let lost = sent.get(times.len()).map_or(Duration::ZERO, |(_, first)| killed - *first);
    assert!(lost < Duration::from_secs(1), "{} of {}, {lost:?}, {torn:?}", times.len(), sent.len());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_recorder_survives_a_full_disk_and_keeps_what_it_wrote() {
    let folder = folder("full");
    let file = folder.join("flight.mcap");
    // `ulimit` counts 256 blocks, 128 KiB, for a part of the recording. That is about two chunks of half a second.
    let (mut child, mut said, address) = start(&["record"], &file, "ulimit -f 256");
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let began = Instant::now();
    let (mut time, second) = (70_000, folder.join("flight.1.mcap"));
    while !second.metadata().is_ok_and(|second| second.len() > 10_000) {
        assert!(began.elapsed() < BOUND && child.try_wait().unwrap().is_none(), "it has not tried again");
        socket.send_to(&image(time), address).unwrap();
        time += 10;
        thread::sleep(Duration::from_millis(10));
    }
    // The recorder reports the recovery only once data are on the disk, and not when it has made a file.
    let mut words = String::new();
    while !words.contains("recording works again") {
        assert!(said.read_line(&mut words).unwrap() > 0, "{words}");
    }
    // A service manager ends a program by the signal TERM. The file must then be whole too.
    let end = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert!(end.success());
    assert!(child.wait().unwrap().success());
    said.read_to_string(&mut words).unwrap();
    assert!(words.contains("recording fails: "), "{words}");
    for part in [&file, &second] {
        assert!(words.contains(&format!("recording into {}", part.display())), "{words}");
        assert!(words.contains(&format!("recorded: {}", part.display())), "{words}");
    }
    for part in [file, second] {
        let (times, _) = recorded(vec![part.clone()]);
        assert!(times.len() > 20 && times.is_sorted(), "{}: {} images", part.display(), times.len());
        assert!(part.metadata().unwrap().len() <= 128 << 10);
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
