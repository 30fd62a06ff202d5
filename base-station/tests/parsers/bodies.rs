//! What must hold for any input of each parser of a carrier's bytes. The fuzz targets and the ordinary tests check it.
#![allow(dead_code, reason = "a fuzz target uses one of them")]

use base_station::carrier::mavlink::{Forwarder, Key, Rates, Received, Receiver, Signer, Verifier};
use base_station::carrier::published::{self, Name, Published};
use base_station::carrier::stream::{self, Deframer};
use base_station::intake::{Carried, Intake, Judged, Kind};
use base_station::recorder::{Parts, Reader, Recorder};
use base_station::{Bundle, Fleet, Place, Verdict, export};
use profile::criticality::{ActiveLoad, Writer};
use profile::{GpsValues, HoldStatus, HoldValues, LinkStatus, LinkValues, Profile, ReportedStatus, ReportedValues};

const NOW: u64 = 1_790_000_000_000_000;

const LONGEST: usize = 652;

pub(crate) type Body = (&'static str, fn(&[u8]));

pub(crate) const ALL: [Body; 5] = [
    ("mavlink", mavlink),
    ("datagram", datagram),
    ("stream", framed),
    ("published", message),
    ("recording", recording),
];

fn key() -> Key {
    Key::new([7; 32])
}

fn pieces(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let length = usize::from(*rest.first()?).max(1).min(rest.len());
        let (piece, later) = rest.split_at(length);
        rest = later;
        Some(piece)
    })
}

pub(crate) fn mavlink(bytes: &[u8]) {
    // The input's last bytes may look like the beginning of a message. The added zeros complete that message.
    let ended = [bytes, &[0; 600]].concat();
    let whole = Receiver::default().datagram(NOW, &ended);
    let mut receiver = Receiver::default();
    let cut: Vec<Received> = pieces(&ended).flat_map(|piece| receiver.stream(NOW, piece)).collect();
    assert_eq!(whole, cut, "however it is cut");
    assert_eq!(receiver.counts().tunnels, whole.len() as u64);
    let signed = Receiver::new(Some(Verifier::new(key()))).datagram(NOW, &ended);
    assert!(signed.iter().all(|received| whole.contains(received)), "a key adds nothing");
    for received in whole {
        let bundle = received.bundle().expect("only what has objects is received");
        let sizes: usize = bundle.objects().map(|(place, _)| place.size()).sum();
        assert_eq!(sizes, bundle.bytes().len());
    }
    let _ = Receiver::default().datagram(NOW, bytes);
}

/// Judges an input, and checks two rules: displayed objects are intact, and a drone exists only after an intact object.
fn judged(kind: Kind, from: &str, bytes: &[u8]) -> Vec<Judged> {
    let carried = Carried { at_us: NOW, kind, line: 1, from: from.into(), bytes: bytes.to_vec() };
    let mut intake = Intake::default();
    let mut brought = vec![];
    let all = |_, bundle: &Bundle<'_>, verdicts: &[Verdict]| {
        for ((place, bytes), verdict) in bundle.objects().zip(verdicts) {
            let intact = matches!(place.judge(bytes), profile::ssi::client::Shown::Intact(_));
            assert_eq!(verdict.is_intact(), intact, "{place}");
            brought.push(*verdict);
        }
    };
    let judged = intake.take_each(&carried, |_, _| true, all);
    assert_eq!(intake.fleet().iter().len() > 0, judged.iter().any(|judged| judged.verdict.is_intact()));
    // The first objects of an unknown drone, up to its first intact one, have no verdict in `judged`.
    let verdicts: Vec<_> = judged.iter().map(|judged| judged.verdict).collect();
    assert!(verdicts.ends_with(&brought));
    assert!(intake.take(&carried).iter().all(|judged| judged.verdict != Verdict::New));
    judged
}

pub(crate) fn datagram(bytes: &[u8]) {
    let found = judged(Kind::Datagrams, "127.0.0.1:4000", bytes);
    let known = found.iter().any(|judged| judged.verdict.is_intact());
    let objects = Bundle::all(bytes).iter().flat_map(Bundle::objects).collect::<Vec<_>>();
    // A hold's object alone does not make a drone known.
    let judged = objects.iter().filter(|(place, _)| known || *place != Place::Hold).count();
    assert_eq!(found.len(), judged);
}

pub(crate) fn framed(bytes: &[u8]) {
    let mut deframer = Deframer::new(LONGEST);
    for frame in bytes.iter().filter_map(|byte| deframer.push(*byte)).flatten() {
        assert!(frame.len() <= LONGEST + 2, "{}", frame.len());
        let mut line = vec![];
        stream::encode(&frame, &mut line);
        let mut again = Deframer::new(frame.len());
        assert_eq!(line.iter().filter_map(|byte| again.push(*byte)).collect::<Vec<_>>(), [Ok(frame)]);
    }
    let _ = Intake::default().take(&Carried {
        at_us: NOW,
        kind: Kind::Stream,
        line: 1,
        from: String::new(),
        bytes: bytes.to_vec(),
    });
}

pub(crate) fn message(bytes: &[u8]) {
    judged(Kind::Published, "north/7", bytes);
    if let Some(read) = Published::read(bytes)
        && let Some(verdicts) = read.verdicts().collect::<Option<Vec<_>>>()
    {
        assert_eq!(published::message(read.at_us, &read.bundle, &verdicts), bytes);
    }
    if let Some(name) = std::str::from_utf8(bytes).ok().and_then(Name::new) {
        assert_eq!(name.as_str().as_bytes(), bytes);
        assert_eq!(Name::of_topic(&format!("{}/{}", published::TOPICS, name.as_str())), Some(name));
    }
}

pub(crate) fn recording(bytes: &[u8]) {
    let mut reader = Reader::new(bytes);
    let mut intake = Intake::default();
    let mut records = 0;
    while let Some(record) = reader.next_record().expect("bytes in memory can be read") {
        records += 1;
        assert!(record.carried.bytes.len() <= bytes.len());
        let judged = export::judge(&mut intake, &record);
        assert!(judged.len() <= record.found.len() || judged.iter().all(|judged| !judged.verdict.is_intact()));
    }
    assert!(reader.bytes_read() <= bytes.len() as u64);
    assert!(records <= bytes.len());
}

fn image(time: u32) -> Vec<u8> {
    let status = ReportedStatus::new().with_position_valid(true);
    let (latitude, longitude) = (47.497_9, 8.728_9);
    let reported = ReportedValues { status, latitude, longitude, ..ReportedValues::absent(time) };
    let link = LinkStatus::seal(&LinkValues { timestamp: time, ..LinkValues::default() });
    [link.as_bytes(), Profile::<3>::seal(&reported, &[GpsValues::absent(time); 3]).as_bytes()].concat()
}

#[derive(Clone, Default)]
struct Memory(std::sync::Arc<std::sync::Mutex<Vec<u8>>>);

impl std::io::Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().expect("one thread").extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Parts for Memory {
    type Part = Self;

    fn make(&mut self, _number: u32) -> std::io::Result<Self> {
        Ok(self.clone())
    }

    fn sync(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn recorded() -> Vec<u8> {
    let memory = Memory::default();
    let mut recorder = Recorder::new(memory.clone());
    let mut intake = Intake::default();
    for cycle in 0..10_u32 {
        let at_us = NOW + 100_000 * u64::from(cycle);
        let (kind, from, bytes) = (Kind::Datagrams, "127.0.0.1:4000".to_owned(), image(70_000 + 100 * cycle));
        let carried = Carried { at_us, kind, line: 0, from, bytes };
        let judged = intake.take(&carried);
        recorder.carried(&carried, &judged, &[]);
        recorder.tick(at_us);
    }
    recorder.finish().expect("memory is not full");
    memory.0.lock().expect("one thread").clone()
}

pub(crate) fn seeds() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let image = image(70_000);
    let bundle = Bundle::datagram(&image).expect("an image of three receivers");
    let sent = |signer: Option<Signer>, standard_us| {
        let forwarder = Forwarder::new(7, 1, Rates { bytes_per_s: 100_000, period_us: 0, standard_us });
        let mut forwarder = match signer {
            Some(signer) => forwarder.signed(signer),
            None => forwarder,
        };
        forwarder.offer(&bundle);
        std::iter::from_fn(|| forwarder.poll(1_000_000, NOW)).flatten().collect::<Vec<u8>>()
    };
    let (plain, signed) = (sent(None, 1_000_000), sent(Some(Signer::new(key(), 3)), 0));
    let cut = [&signed[..118], &signed[..]].concat();
    let verdicts = Fleet::default().take(base_station::Who::System(7), base_station::Source::default(), NOW, &bundle).1;
    let whole = published::message(NOW, &bundle, &verdicts);
    let mut damaged = whole.clone();
    damaged[100] ^= 1;
    let mut frames = vec![];
    stream::encode(&image, &mut frames);
    stream::encode(&image[32..], &mut frames);
    let hold = HoldStatus::seal(Writer::<ActiveLoad>::claim(), &HoldValues::absent(100));
    let map = [&image[..], &[0; 192], hold.as_bytes()].concat();
    let recorded = recorded();
    let torn = recorded[..recorded.len() / 2].to_vec();
    vec![
        ("mavlink", "plain", plain),
        ("mavlink", "signed", signed),
        ("mavlink", "signed-cut", cut),
        ("datagram", "profile", image[32..].to_vec()),
        ("datagram", "map", map),
        ("datagram", "image", image),
        ("stream", "two-frames", frames),
        ("published", "image", whole),
        ("published", "image-hit", damaged),
        ("published", "name", b"north/127.0.0.1:5000".to_vec()),
        ("recording", "whole", recorded),
        ("recording", "torn", torn),
    ]
}
