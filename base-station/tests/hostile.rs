//! Tests the page with hostile readers and requests, over real sockets.

use crate::common;

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use base_station::intake::{Carried, Kind};
use base_station::live::serve::{self, Limits};
use base_station::live::{self, Clock, Event, Time, page};
use common::image;
use socket2::{Domain, Socket, Type};
use tokio::sync::oneshot;

const BOUND: Duration = Duration::from_secs(30);

const LIMITS: Limits = Limits { connections: 200, head: Duration::from_millis(400), stall: Duration::from_millis(600) };

struct Page {
    address: SocketAddr,
    end: Option<oneshot::Sender<()>>,
    landed: Arc<AtomicBool>,
    threads: Vec<thread::JoinHandle<()>>,
}

impl Page {
    fn start(limits: Limits) -> Self {
        let clock = Clock::begin();
        let (inlet, station, _) = live::start(None, None, Time::Clock(clock.clone()), |_, _| {});
        let landed = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&landed);
        let began = Instant::now();
        let flying = thread::spawn(move || {
            while !told.load(Ordering::Relaxed) {
                let bytes = image(u32::try_from(began.elapsed().as_millis()).unwrap() / 10 * 10);
                let (kind, from) = (Kind::Datagrams, "127.0.0.1:4000".to_owned());
                assert!(inlet.offer(Event::Carried(Carried { at_us: clock.now_us(), kind, line: 0, from, bytes })));
                thread::sleep(Duration::from_millis(10));
            }
        });
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
        let address = listener.local_addr().unwrap();
        let (end, ended) = oneshot::channel();
        let router = page::router(station, None, address);
        let serving = thread::spawn(move || {
            runtime.block_on(async {
                tokio::select! {
                    _ = ended => {}
                    served = serve::serve(listener, router, limits) => served.unwrap(),
                }
            });
        });
        Self { address, end: Some(end), landed, threads: vec![flying, serving] }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(BOUND)).unwrap();
        stream
    }

    fn narrow(&self) -> TcpStream {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        socket.set_recv_buffer_size(2_048).unwrap();
        socket.connect(&self.address.into()).unwrap();
        socket.into()
    }

    fn answers(&self) -> bool {
        let mut stream = self.connect();
        let asked = write!(stream, "GET /state HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
        asked.is_ok() && String::from_utf8_lossy(&all(&mut stream)).contains("\"position\":[47.49")
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.landed.store(true, Ordering::Relaxed);
        let _ = self.end.take().map(|end| end.send(()));
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn all(stream: &mut TcpStream) -> Vec<u8> {
    let mut bytes = vec![];
    let mut buffer = [0; 4_096];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return bytes,
            Ok(read) => bytes.extend(&buffer[..read]),
            Err(error) if error.kind() == ErrorKind::ConnectionReset => return bytes,
            Err(error) => panic!("{error}, after {} bytes", bytes.len()),
        }
    }
}

struct Watcher {
    ended: Arc<AtomicBool>,
    thread: thread::JoinHandle<(u64, Duration)>,
}

impl Watcher {
    fn start(page: &Page) -> Self {
        let mut stream = page.connect();
        write!(stream, "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        let ended = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&ended);
        let thread = thread::spawn(move || {
            let (mut states, mut longest, mut last) = (0, Duration::ZERO, Instant::now());
            let mut buffer = vec![0; 65_536];
            while !told.load(Ordering::Relaxed) {
                let read = stream.read(&mut buffer).unwrap();
                assert_ne!(read, 0, "the watcher was thrown out");
                states += buffer[..read].windows(6).filter(|window| window == b"data: ").count() as u64;
                longest = longest.max(last.elapsed());
                last = Instant::now();
            }
            (states, longest)
        });
        Self { ended, thread }
    }

    fn end(self) -> (u64, Duration) {
        self.ended.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

fn memory() -> u64 {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    pages.split(' ').nth(1).unwrap().parse::<u64>().unwrap() * 4_096
}

#[test]
fn readers_that_take_nothing_are_given_up_and_hold_no_other_up() {
    let page = Page::start(LIMITS);
    while !page.answers() {}
    let watcher = Watcher::start(&page);
    let before = memory();
    let mut readers: Vec<TcpStream> = (0..100).map(|_| page.narrow()).collect();
    for reader in &mut readers {
        write!(reader, "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    }
    // The page closes the connection of a client that does not read. The client's next write then fails with a reset.
    let began = Instant::now();
    while !readers.is_empty() {
        assert!(began.elapsed() < BOUND, "{} readers are still there", readers.len());
        readers.retain_mut(|reader| {
            reader.take_error().unwrap().is_none() && !matches!(write_one(reader), Err(ErrorKind::ConnectionReset))
        });
        thread::sleep(Duration::from_millis(50));
    }
    let grown = memory().saturating_sub(before);
    let (states, longest) = watcher.end();
    assert!(grown < 32 << 20, "{} kB", grown >> 10);
    assert!(states > 20 && longest < Duration::from_secs(5), "{states} states, {longest:?}");
    assert!(page.answers());
}

fn write_one(stream: &mut TcpStream) -> Result<(), ErrorKind> {
    match stream.write(b"x") {
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Err(ErrorKind::ConnectionReset),
        Err(error) => Err(error.kind()),
    }
}

#[test]
fn the_page_answers_again_after_a_thousand_idle_connections() {
    let page = Page::start(LIMITS);
    while !page.answers() {}
    let watcher = Watcher::start(&page);
    for _ in 0..5 {
        let mut idle: Vec<TcpStream> = (0..200).map(|_| page.connect()).collect();
        // Connections beyond the limit are closed at once. Connections within the limit are closed after a time without
        // a request.
        for stream in &mut idle {
            let bytes = all(stream);
            assert!(bytes.is_empty() || bytes.starts_with(b"HTTP/1.1 408"), "{}", String::from_utf8_lossy(&bytes));
        }
        assert!(page.answers());
    }
    let (states, longest) = watcher.end();
    assert!(states > 20 && longest < Duration::from_secs(5), "{states} states, {longest:?}");
}

#[test]
fn requests_that_come_byte_by_byte_end_at_the_time_limit() {
    let page = Page::start(LIMITS);
    while !page.answers() {}
    let request = format!("GET /state HTTP/1.1\r\nHost: localhost\r\nX: {}\r\n\r\n", "a".repeat(10_000));
    let mut slow: Vec<TcpStream> = (0..50).map(|_| page.connect()).collect();
    let began = Instant::now();
    let mut sent = request.bytes();
    while slow.iter_mut().any(|stream| stream.write(&[sent.next().unwrap()]).is_ok()) {
        assert!(began.elapsed() < BOUND, "they are still there");
        assert!(page.answers(), "the others are served meanwhile");
        thread::sleep(Duration::from_millis(20));
    }
    let mut kept = page.connect();
    write!(kept, "GET /state HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    assert!(String::from_utf8_lossy(&all(&mut kept)).starts_with("HTTP/1.1 200"));
}

#[test]
fn malformed_requests_are_refused_and_smuggle_nothing() {
    let page = Page::start(Limits::default());
    while !page.answers() {}
    let host = "Host: localhost\r\n";
    let inner = "GET /state HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let refused: Vec<(&str, Vec<u8>)> = vec![
        ("two lengths", format!("GET / HTTP/1.1\r\n{host}Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd").into()),
        ("a signed length", format!("GET / HTTP/1.1\r\n{host}Content-Length: +3\r\n\r\nabc").into()),
        ("a negative length", format!("GET / HTTP/1.1\r\n{host}Content-Length: -1\r\n\r\n").into()),
        ("a list of lengths", format!("GET / HTTP/1.1\r\n{host}Content-Length: 3, 4\r\n\r\nabcd").into()),
        ("a length of 2^70", format!("GET / HTTP/1.1\r\n{host}Content-Length: 1180591620717411303424\r\n\r\n").into()),
        ("chunked is not last", format!("GET / HTTP/1.1\r\n{host}Transfer-Encoding: chunked, gzip\r\n\r\n").into()),
        ("an unknown coding", format!("GET / HTTP/1.1\r\n{host}Transfer-Encoding: xchunked\r\n\r\n").into()),
        ("a zero byte in a field", format!("GET / HTTP/1.1\r\n{host}X: a\0b\r\n\r\n").into()),
        ("a space before the colon", format!("GET / HTTP/1.1\r\n{host}Content-Length : 3\r\n\r\nabc").into()),
        ("a folded field", format!("GET / HTTP/1.1\r\n{host}X: a\r\n b\r\n\r\n").into()),
        ("no version", "GET /\r\n\r\n".into()),
        ("an unknown version", format!("GET / HTTP/9.9\r\n{host}\r\n").into()),
        ("no UTF-8", [b"GET /\xFF\xFE HTTP/1.1\r\n", host.as_bytes(), b"\r\n"].concat()),
        ("a head of 20 KB", format!("GET / HTTP/1.1\r\n{host}X: {}\r\n\r\n", "a".repeat(20_000)).into()),
        ("an address of 20 KB", format!("GET /{} HTTP/1.1\r\n{host}\r\n", "a".repeat(20_000)).into()),
        ("a hundred fields", format!("GET / HTTP/1.1\r\n{host}{}\r\n", "X: a\r\n".repeat(100)).into()),
        ("TLS", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".repeat(20)),
        ("HTTP/2", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec()),
        ("no host", b"GET /state HTTP/1.1\r\n\r\n".to_vec()),
        ("another host", b"GET /state HTTP/1.1\r\nHost: example.org\r\n\r\n".to_vec()),
        ("two hosts", b"GET /state HTTP/1.1\r\nHost: example.org\r\nHost: localhost\r\n\r\n".to_vec()),
        (
            "an address with another host",
            b"GET http://example.org/state HTTP/1.1\r\nHost: example.org\r\n\r\n".to_vec(),
        ),
    ];
    for (what, request) in &refused {
        let mut stream = page.connect();
        // The page may refuse a request and close the connection before the client has written everything.
        let _ = stream.write_all(request).and_then(|()| stream.shutdown(std::net::Shutdown::Write));
        let answer = String::from_utf8_lossy(&all(&mut stream)).into_owned();
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{what}: {answer}");
        assert!(!answer.contains("HTTP/1.1 200"), "{what}: {answer}");
    }
    let body = format!("GET / HTTP/1.1\r\n{host}Content-Length: {}\r\nConnection: close\r\n\r\n{inner}", inner.len());
    let chunk = format!("{:x}\r\n{inner}\r\n0\r\n\r\n", inner.len());
    let chunked = format!("GET / HTTP/1.1\r\n{host}Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n{chunk}");
    let both = chunked.replacen("Transfer", "Content-Length: 3\r\nTransfer", 1);
    for request in [body, chunked, both] {
        let mut stream = page.connect();
        stream.write_all(request.as_bytes()).unwrap();
        let answer = String::from_utf8_lossy(&all(&mut stream)).into_owned();
        assert_eq!(answer.matches("HTTP/1.1 ").count(), 1, "{answer}");
    }
    assert!(page.answers());
    assert_eq!(page.address.ip(), Ipv4Addr::LOCALHOST);
}
