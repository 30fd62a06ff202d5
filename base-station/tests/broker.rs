//! Tests fleets over a real broker: mosquitto and `horus-base` in separate processes. Each test of TLS makes its
//! certificates.

mod common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use base_station::carrier::mavlink::{Forwarder, Rates};
use base_station::intake::Kind;
use base_station::live::playback::Recording;
use base_station::{Bundle, carrier::published::Published};
use common::{image, not_run};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair, date_time_ymd};
use serde_json::Value;

const BOUND: Duration = Duration::from_secs(60);

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < BOUND, "not within {BOUND:?}: {what}");
        thread::sleep(Duration::from_millis(10));
    }
}

struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    fn interrupt(mut self) {
        let kill = Command::new("kill").args(["-INT", &self.0.id().to_string()]).status().unwrap();
        assert!(kill.success());
        until("horus-base ends", || self.0.try_wait().unwrap().is_some());
    }
}

fn mosquitto(port: u16, folder: &Path) -> Option<Running> {
    mosquitto_with(port, folder, "")
}

fn mosquitto_with(port: u16, folder: &Path, lines: &str) -> Option<Running> {
    let config = folder.join("mosquitto.conf");
    std::fs::write(&config, format!("listener {port} 127.0.0.1\nallow_anonymous true\n{lines}")).unwrap();
    let child = ["mosquitto", "/usr/sbin/mosquitto"].into_iter().find_map(|program| {
        let mut command = Command::new(program);
        command.arg("-c").arg(&config).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().ok()
    });
    let Some(child) = child else {
        not_run("there is no mosquitto", "apt-get install mosquitto");
        return None;
    };
    let broker = Running(child);
    until("mosquitto listens", || TcpStream::connect(("127.0.0.1", port)).is_ok());
    Some(broker)
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn horus_base(arguments: &[&str]) -> (Running, SocketAddr, Option<SocketAddr>) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_horus-base"));
    command.args(arguments).args(["--http", "127.0.0.1:0"]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut running = Running(command.spawn().unwrap());
    let mut errors = BufReader::new(running.0.stderr.take().unwrap());
    let mut line = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let page = line.trim().trim_start_matches("http://").trim_end_matches('/').parse();
    let page = page.unwrap_or_else(|_| {
        let mut said = String::new();
        let _ = errors.read_to_string(&mut said);
        panic!("{line:?} {said}")
    });
    let mut first = String::new();
    errors.read_line(&mut first).unwrap();
    let udp = first.strip_prefix("listening on UDP ").and_then(|rest| rest.split(',').next()?.parse().ok());
    thread::spawn(move || errors.lines().for_each(drop));
    (running, page, udp)
}

fn state(page: SocketAddr) -> Value {
    let mut stream = TcpStream::connect(page).unwrap();
    stream.set_read_timeout(Some(BOUND)).unwrap();
    write!(stream, "GET /state HTTP/1.1\r\nHost: {page}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let (_, body) = answer.split_once("\r\n\r\n").unwrap();
    let (begin, end) = (body.find('{').unwrap(), body.rfind('}').unwrap());
    serde_json::from_str(&body[begin..=end]).unwrap()
}

fn fresh(page: SocketAddr) -> Vec<String> {
    let state = state(page);
    let drones = state["drones"].as_array().unwrap();
    let fresh = drones.iter().filter(|drone| drone["age_ms"].as_u64().is_some_and(|age| age < 400));
    fresh.map(|drone| drone["id"].as_str().unwrap().to_owned()).collect()
}

struct Flying(Arc<AtomicBool>, Option<thread::JoinHandle<()>>);

impl Flying {
    fn start(systems: std::ops::RangeInclusive<u8>, to: SocketAddr) -> Self {
        let landed = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&landed);
        let thread = thread::spawn(move || {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            let rates = Rates { bytes_per_s: 1_000_000, period_us: 0, standard_us: 0 };
            let mut forwarders: Vec<_> = systems.map(|system| Forwarder::new(system, 1, rates)).collect();
            let began = Instant::now();
            while !told.load(Ordering::Relaxed) {
                // The drones' timestamps follow real time, so that a delay of this thread does not slow them down.
                let ms = u32::try_from(began.elapsed().as_millis()).unwrap() / 10 * 10;
                for forwarder in &mut forwarders {
                    forwarder.offer(&Bundle::datagram(&image(ms)).unwrap());
                    while let Some(message) = forwarder.poll(u64::from(ms) * 1_000 + 1_000_000, 0) {
                        socket.send_to(&message, to).unwrap();
                    }
                }
                thread::sleep(Duration::from_millis(100));
            }
        });
        Self(landed, Some(thread))
    }
}

impl Drop for Flying {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        let _ = self.1.take().map(thread::JoinHandle::join);
    }
}

fn objects(file: PathBuf, station: &str) -> Vec<(String, String, String, Vec<u8>)> {
    let mut objects = vec![];
    let mut intake = base_station::intake::Intake::default();
    let each = |record: base_station::recorder::Record| {
        let carried = &record.carried;
        let mut bytes = vec![];
        let all = |_: base_station::DroneId, bundle: &Bundle<'_>, _: &[base_station::Verdict]| {
            bytes.extend(bundle.objects().map(|(_, bytes)| bytes.to_vec()));
        };
        intake.take_each(carried, |_, _| true, all);
        assert_eq!(bytes.len(), record.found.len());
        let told: Option<Vec<String>> = (carried.kind == Kind::Published).then(|| {
            let published = Published::read(&carried.bytes).unwrap();
            published.verdicts().map(|verdict| verdict.unwrap().code().to_owned()).collect()
        });
        for (nth, (found, bytes)) in record.found.iter().zip(bytes).enumerate() {
            let verdict = told.as_ref().map_or(&found.verdict, |told| &told[nth]);
            let drone = found.drone.strip_prefix(&format!("{station}/")).unwrap_or(&found.drone);
            objects.push((drone.to_owned(), found.place.to_string(), verdict.clone(), bytes));
        }
        true
    };
    let torn = Recording::new(vec![file]).read(each, |_| {}).unwrap();
    assert_eq!(torn, Vec::<String>::new());
    objects
}

#[test]
fn a_page_fed_by_the_broker_shows_the_drones_of_all_stations() {
    let folder = std::env::temp_dir().join(format!("horus-base-broker-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let port = free_port();
    let Some(broker) = mosquitto(port, &folder) else { return };
    let at = format!("127.0.0.1:{port}");
    let files = ["north", "south", "all"].map(|name| folder.join(format!("{name}.mcap")));
    let names = files.each_ref().map(|file| file.to_str().unwrap());
    let publish = |station: &str, file: &str| {
        let udp = ["--udp", "127.0.0.1:0"];
        horus_base(&[&["publish", "--broker", &at, "--station", station, "--record", file][..], &udp].concat())
    };
    let (north, north_page, north_udp) = publish("north", names[0]);
    let (south, _, south_udp) = publish("south", names[1]);
    let (all, page, _) = horus_base(&["subscribe", "--broker", &at, "--record", names[2]]);

    let flying = [Flying::start(1..=3, north_udp.unwrap()), Flying::start(3..=4, south_udp.unwrap())];
    let drones = ["north/1", "north/2", "north/3", "south/3", "south/4"];
    until("all drones are shown", || fresh(page) == drones);
    assert_eq!(state(page)["drone"]["id"], "north/1");

    drop(broker);
    let complains = |page| state(page)["station"]["lines"].to_string().contains("broker 127.0.0.1");
    until("the loss is told", || complains(page) && complains(north_page) && fresh(page).is_empty());
    assert_eq!(fresh(north_page), ["1", "2", "3"]);
    let _broker = mosquitto(port, &folder).unwrap();
    until("all drones are shown again", || fresh(page) == drones && !complains(page) && !complains(north_page));

    drop(flying);
    north.interrupt();
    south.interrupt();
    all.interrupt();
    let [north, south, all] = files;
    let recorded = objects(all.clone(), "");
    assert!(recorded.len() >= 2 * 5 * 5, "before and after the restart, five drones, five objects each");
    for (station, file) in [("north", north), ("south", south)] {
        // The publishing station recorded every object that came through the broker, in the same order.
        let here = objects(file, station);
        let through = objects(all.clone(), station);
        let through: Vec<_> = through.iter().filter(|(drone, ..)| !drone.contains('/')).collect();
        let mut rest = here.iter();
        assert!(through.iter().all(|object| rest.any(|other| other == *object)), "{station}");
        assert!(through.len() < here.len(), "some were lost while there was no broker");
        assert!(through.iter().all(|(_, _, verdict, _)| verdict == "new"));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_somebody_else_publishes_there_changes_nothing() {
    let folder = std::env::temp_dir().join(format!("horus-base-foreign-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let port = free_port();
    let Some(_broker) = mosquitto(port, &folder) else { return };
    let at = format!("127.0.0.1:{port}");
    let (_all, page, _) = horus_base(&["subscribe", "--broker", &at]);
    let (_north, _, udp) = horus_base(&["publish", "--broker", &at, "--station", "north", "--udp", "127.0.0.1:0"]);

    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let _flying = Flying::start(7..=7, udp.unwrap());
    until("the drone is shown", || fresh(page) == ["north/7"]);
    runtime.block_on(async {
        use rumqttc::PublishOptions;
        let mut options = rumqttc::MqttOptions::new("somebody", ("127.0.0.1", port));
        options.set_keep_alive(5);
        let (client, mut events) = rumqttc::AsyncClient::builder(options).capacity(100).build();
        let whole = image(50_000);
        let bundle = Bundle::datagram(&whole).unwrap();
        let message = base_station::carrier::published::message(5, &bundle, &[base_station::Verdict::New; 5]);
        let mut damaged = message.clone();
        damaged.iter_mut().skip(20).step_by(50).for_each(|byte| *byte ^= 0x55);
        let foreign: [(&str, bool, &[u8]); 7] = [
            ("horus/1/north/8", true, &message), // kept by the broker: its age is not known
            ("horus/1/north/9", false, &damaged),
            ("horus/1/north/10", false, &message[..100]),
            ("horus/1/no rth/11", false, &message),
            ("horus/1/north", false, &message),
            ("horus/1/north/7", false, b"hello"),
            ("horus/1/north/12", false, &[0; 5_000]),
        ];
        for (topic, retain, bytes) in foreign {
            let options = PublishOptions::at_least_once().retain(retain);
            client.publish(topic, bytes.to_vec(), options).await.unwrap();
        }
        let mut acknowledged = 0;
        while acknowledged < foreign.len() {
            if let rumqttc::Event::Incoming(rumqttc::Packet::PubAck(_)) = events.poll().await.unwrap() {
                acknowledged += 1;
            }
        }
    });
    let (_late, late, _) = horus_base(&["subscribe", "--broker", &at, "--station", "north"]);
    until("both show the drone, and no other", || fresh(late) == ["north/7"] && fresh(page) == ["north/7"]);
    for page in [page, late] {
        let drones = state(page)["drones"].as_array().unwrap().len();
        // The page of the subscriber that started earlier may show `north/8`, because that drone's message was new when
        // it arrived there.
        let ids: Vec<_> = (0..drones).map(|nth| state(page)["drones"][nth]["id"].clone()).collect();
        assert!(ids.iter().all(|id| id == "north/7" || id == "north/8"), "{ids:?}");
        assert!(page != late || ids.len() == 1, "{ids:?}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

fn authority(folder: &Path, name: &str) -> CertifiedIssuer<'static, KeyPair> {
    let mut params = CertificateParams::default();
    params.distinguished_name.push(DnType::CommonName, name);
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    let authority = CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap();
    std::fs::write(folder.join(name).with_extension("pem"), authority.pem()).unwrap();
    authority
}

/// Writes a certificate for `host`, valid until this year, to `NAME.pem`, and its key to `NAME.key`.
fn certificate(folder: &Path, authority: &CertifiedIssuer<'_, KeyPair>, name: &str, host: &str, until: i32) {
    let mut params = CertificateParams::new([host.to_owned()]).unwrap();
    params.distinguished_name.push(DnType::CommonName, name);
    params.not_before = date_time_ymd(2000, 1, 1);
    params.not_after = date_time_ymd(until, 1, 1);
    let key = KeyPair::generate().unwrap();
    let signed = params.signed_by(&key, authority).unwrap();
    std::fs::write(folder.join(name).with_extension("pem"), signed.pem()).unwrap();
    std::fs::write(folder.join(name).with_extension("key"), key.serialize_pem()).unwrap();
}

#[test]
fn over_tls_only_an_authenticated_broker_and_station_exchange_data() {
    let folder = std::env::temp_dir().join(format!("horus-base-tls-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let ours = authority(&folder, "ours");
    certificate(&folder, &ours, "broker", "localhost", 2090);
    certificate(&folder, &ours, "expired", "localhost", 2001);
    certificate(&folder, &ours, "station", "north", 2090);
    certificate(&folder, &authority(&folder, "theirs"), "stranger", "north", 2090);
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();

    // Without `user root` the broker would drop its privileges, and could not read the files in another user's folder.
    let lines = |certificate: &str| {
        let [ca, certificate, key] = [file("ours.pem"), file(certificate), file(&certificate.replace("pem", "key"))];
        format!("user root\ncafile {ca}\ncertfile {certificate}\nkeyfile {key}\nrequire_certificate true\n")
    };
    let port = free_port();
    let Some(_broker) = mosquitto_with(port, &folder, &lines("broker.pem")) else { return };
    let old = free_port();
    let _old = mosquitto_with(old, &folder, &lines("expired.pem")).unwrap();

    let at = format!("mqtts://localhost:{port}");
    let [ca, mine, key] = ["ours.pem", "station.pem", "station.key"].map(file);
    let known = ["--ca", &ca, "--certificate", &mine, "--certificate-key", &key];
    let publish = ["publish", "--broker", &at, "--station", "north", "--udp", "127.0.0.1:0"];
    let (_north, north_page, udp) = horus_base(&[&publish[..], &known].concat());
    let (_all, page, _) = horus_base(&[&["subscribe", "--broker", &at][..], &known].concat());
    let _flying = Flying::start(7..=7, udp.unwrap());
    until("the drone is shown", || fresh(page) == ["north/7"]);
    // At first a connected station still reports the arrivals that it could not publish before it was connected.
    let is_well = |page| state(page)["station"]["lines"].as_array().unwrap().is_empty();
    until("nothing is wrong", || is_well(page) && is_well(north_page));

    let told = |broker: &str, certificates: &[&str], words: &str| {
        let (_running, page, _) = horus_base(&[&["subscribe", "--broker", broker][..], certificates].concat());
        until(words, || {
            let lines = state(page)["station"]["lines"].to_string();
            lines.contains(&format!("broker {broker}")) && lines.contains(words)
        });
        assert_eq!(fresh(page), Vec::<String>::new());
    };
    let [theirs, strangers, their_key] = ["theirs.pem", "stranger.pem", "stranger.key"].map(file);
    let other = ["--ca", &theirs, "--certificate", &mine, "--certificate-key", &key];
    told(&at, &other, "its certificate is signed by none of the authorities in --ca");
    told(&format!("mqtts://127.0.0.1:{port}"), &known, "its certificate is for another name than 127.0.0.1");
    told(&format!("mqtts://localhost:{old}"), &known, "its certificate has expired");
    told(&at, &known[..2], "it wants a certificate of this station");
    let stranger = ["--ca", &ca, "--certificate", &strangers, "--certificate-key", &their_key];
    told(&at, &stranger, "it does not believe this station's certificate");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_cannot_be_used_for_tls_is_refused_before_anything_is_sent() {
    let folder = std::env::temp_dir().join(format!("horus-base-unusable-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let ours = authority(&folder, "ours");
    certificate(&folder, &ours, "station", "north", 2090);
    certificate(&folder, &ours, "other", "north", 2090);
    std::fs::write(folder.join("nothing"), "nothing\n").unwrap();
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let [ca, mine, key, other, nothing, missing] =
        ["ours.pem", "station.pem", "station.key", "other.key", "nothing", "missing"].map(file);
    let refused = |arguments: &[&str], words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_horus-base"));
        let done = command.args(["subscribe", "--http", "127.0.0.1:0"]).args(arguments).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        assert!(!done.status.success() && words.iter().all(|words| said.contains(words)), "{arguments:?}: {said}");
    };
    let tls = "mqtts://localhost:1";
    refused(&["--broker", "https://localhost"], &["https:// is no way to a broker", "mqtts://"]);
    refused(&["--broker", tls], &["needs --ca"]);
    refused(&["--broker", "mqtts://[::1]:1", "--ca", &ca], &["by its name or its IPv4 address"]);
    refused(&["--broker", "localhost:1", "--ca", &ca], &["--ca is for TLS", "mqtts://localhost"]);
    refused(&["--broker", tls, "--ca", &missing], &["cannot read", &missing]);
    refused(&["--broker", tls, "--ca", &nothing], &[&nothing, "no certificate of an authority"]);
    refused(&["--broker", tls, "--ca", &ca, "--certificate", &mine], &["--certificate-key"]);
    let with = |certificate: &str, key: &str, words: &[&str]| {
        refused(&["--broker", tls, "--ca", &ca, "--certificate", certificate, "--certificate-key", key], words);
    };
    with(&nothing, &key, &[&nothing, "no certificate is in it"]);
    with(&mine, &nothing, &[&nothing, "no private key is in it"]);
    with(&mine, &other, &[&other, "certificate and key cannot be used"]);
    std::fs::remove_dir_all(&folder).unwrap();
}
