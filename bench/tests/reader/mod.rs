//! A simple reader of a DPR board, and a sender of frames to it, for tests without the simulated flight controller or
//! HORUS.

use bench::boards::{Dpr, Horus};
use bench::world::ssi::{Crystal, Filler, Order, Progress, SsiMaster, Start};
use emulator_node::{Downstream, Node, Upstream};
use profile::air::air_time_ns;
use profile::{GpsStatus, GpsValues, Layout, LinkStatus, LinkValues, Object, Profile, ReportedStatus, ReportedValues};
use st25r3916_model::{Air, AirEvent, AirFaults, Chunk, FrameStart, Technology};

pub(crate) const US: u64 = 1_000;
pub(crate) const MS: u64 = 1_000_000;

/// The number of receivers for which these tests' firmwares are built.
pub(crate) const RECEIVERS: usize = 3;

pub(crate) fn layout() -> Layout {
    Layout::for_receivers(RECEIVERS).expect("a profile of three receivers")
}

/// The duration of a bit at 424 kbit/s, attoseconds: 32 periods of 13.56 MHz.
const BIT_AS: u64 = 32 * 1_000_000_000_000_000 / 13_560;

#[derive(Clone, Debug)]
pub(crate) struct View {
    pub(crate) at: u64,
    pub(crate) silent: bool,
    pub(crate) link: Option<LinkValues>,
    pub(crate) valid: Vec<u32>,
    pub(crate) reported: Option<ReportedStatus>,
}

impl View {
    pub(crate) fn of(at: u64, miso: &[u8]) -> Self {
        let mut valid = vec![];
        let mut reported = None;
        for index in 0..layout().objects() {
            let bytes = layout().in_image(index).and_then(|place| miso.get(place));
            if let Some(Ok(object)) = bytes.map(|bytes| Object::verify(index, bytes)) {
                valid.push(object.timestamp());
                if let Some(position) = bytes.filter(|_| index == 0) {
                    reported = profile::ReportedPosition::verify(position).ok().map(|it| it.values().status);
                }
            }
        }
        let link = miso.get(..LinkStatus::SIZE).and_then(|bytes| LinkStatus::verify(bytes).ok());
        Self { at, silent: miso.iter().all(|byte| *byte == 0xFF), link: link.map(LinkStatus::values), valid, reported }
    }
}

/// Makes a transaction in which every byte on MOSI is `mosi`, and waits for the gap. Returns the bytes on MISO.
pub(crate) fn transact(node: &mut Node<Dpr>, bytes: usize, mosi: u8) -> Vec<u8> {
    carry(node, Order { filler: Filler::Byte(mosi), ..Order::read(bytes) })
}

pub(crate) fn carry(node: &mut Node<Dpr>, order: Order) -> Vec<u8> {
    carry_by(node, order, |node, end| {
        while node.now() < end {
            node.advance(end);
        }
    })
}

/// Makes a transaction like [`carry`]. The function `pass` runs the board to each instant.
pub(crate) fn carry_by(node: &mut Node<Dpr>, order: Order, mut pass: impl FnMut(&mut Node<Dpr>, u64)) -> Vec<u8> {
    let mut master = SsiMaster::new(Crystal::default());
    let start = Start { bench_ns: node.now(), own_ns: 0 };
    master.begin(start, order);
    loop {
        pass(node, master.next_at());
        if let Some(Progress::Over(transaction)) = master.act(node) {
            pass(node, master.free_at());
            return transaction.miso;
        }
    }
}

pub(crate) fn view(node: &mut Node<Dpr>) -> View {
    let at = node.now();
    View::of(at, &transact(node, layout().image_len(), 0))
}

pub(crate) fn views(node: &mut Node<Dpr>, end: u64) -> Vec<View> {
    let mut all = vec![];
    while node.now() < end {
        let next = node.now() + 2 * MS;
        while node.now() < next {
            node.advance(next);
        }
        all.push(view(node));
    }
    all
}

/// Returns the payload of a frame whose objects are all valid and have this timestamp (ms).
pub(crate) fn payload(timestamp: u32) -> Vec<u8> {
    let gps = GpsValues { status: GpsStatus::new().with_position_valid(true), ..GpsValues::absent(timestamp) };
    let reported = ReportedValues {
        status: ReportedStatus::new().with_position_valid(true).with_receivers_agreeing(3),
        ..ReportedValues::absent(timestamp)
    };
    Profile::<RECEIVERS>::seal(&reported, &[gps; RECEIVERS]).as_bytes().to_vec()
}

pub(crate) fn frame_ns() -> u64 {
    air_time_ns(u8::try_from(payload(0).len()).expect("it fits one frame"))
}

/// CRC-16 of NFC-F (ISO/IEC 18092): polynomial 0x1021, initial value 0, most significant bit first.
fn crc16(bytes: &[u8]) -> [u8; 2] {
    let crc = bytes.iter().fold(0_u16, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| if crc >> 15 == 1 { crc << 1 ^ 0x1021 } else { crc << 1 })
    });
    crc.to_be_bytes()
}

pub(crate) fn field_on(node: &mut Node<Dpr>) {
    node.board_mut(|board| board.front_end.hear(0, &AirEvent::FieldOn));
}

/// Sends a frame with `payload` to the chip. Its first bit is on the air at `at`, which is not in the past. Frames must
/// not overlap.
pub(crate) fn send(node: &mut Node<Dpr>, at: u64, payload: &[u8]) {
    let length = u8::try_from(payload.len()).expect("it fits one frame");
    let mut data = vec![length + 1];
    data.extend(payload);
    data.extend(crc16(&data));
    let bits = 8 * u32::try_from(data.len()).expect("a frame is short");
    let start = FrameStart {
        technology: Technology::NfcF,
        bits_per_second: 424_000,
        bit_as: BIT_AS,
        header_bits: 64,
        byte_bits: 8,
        load_modulation: false,
        chunk: Chunk { data, parity_error: false },
    };
    node.board_mut(|board| {
        board.front_end.hear(at, &AirEvent::FrameStart(start));
        board.front_end.hear(at + air_time_ns(length), &AirEvent::FrameEnd { bits });
    });
}

#[derive(Clone, Debug)]
pub(crate) struct Sent {
    pub(crate) started: u64,
    pub(crate) ended: u64,
    pub(crate) payload: Vec<u8>,
}

impl Sent {
    pub(crate) fn timestamp(&self) -> u32 {
        Object::verify(0, &self.payload[..64]).expect("Reported-Position comes first").timestamp()
    }
}

#[derive(Default)]
pub(crate) struct Antenna {
    pub(crate) transmits: Vec<u64>,
    pub(crate) ticks: Vec<u64>,
}

impl Upstream<Horus> for Antenna {
    type Message = AirEvent;
    type Notes = ();

    fn leave(&mut self, node: &mut Node<Horus>, sent: &mut Vec<(u64, AirEvent)>) {
        node.board_mut(|board| sent.extend(board.front_end.take_air()));
    }

    fn notes(&mut self, node: &mut Node<Horus>) {
        node.board_mut(|board| {
            self.transmits.extend(board.front_end.take_transmits());
            self.ticks.extend(board.take_ticks());
        });
    }
}

/// A flight controller that reads the image all the time, and the air to the DPR.
pub(crate) struct Reader {
    master: SsiMaster,
    pub(crate) views: Vec<View>,
    air: Air,
    started: u64,
    frame: Vec<u8>,
    pub(crate) sent: Vec<Sent>,
    pub(crate) field_off: Vec<u64>,
}

const FIRST_READ: u64 = 20 * MS;

/// The pause between two transactions, ns. It does not divide HORUS's cycle, so that transactions have many phases.
const PAUSE: u64 = 1_830 * US;

impl Reader {
    pub(crate) fn new() -> Self {
        let mut reader = Self {
            master: SsiMaster::new(Crystal::default()),
            views: vec![],
            air: Air::new(1, AirFaults::default()),
            started: 0,
            frame: vec![],
            sent: vec![],
            field_off: vec![],
        };
        reader.read(FIRST_READ);
        reader
    }

    fn read(&mut self, at: u64) {
        self.master.begin(Start { bench_ns: at, own_ns: 0 }, Order::read(layout().image_len()));
    }
}

impl Downstream<Dpr> for Reader {
    type Message = AirEvent;
    type Notes = ();

    fn hear(&mut self, at: u64, event: AirEvent, node: &mut Node<Dpr>) {
        match &event {
            AirEvent::FrameStart(start) => {
                self.started = at;
                self.frame.clone_from(&start.chunk.data);
            }
            AirEvent::Bytes(chunk) => self.frame.extend(&chunk.data),
            AirEvent::FrameEnd { .. } => {
                let payload = self.frame.get(1..self.frame.len() - 2).unwrap_or_default().to_vec();
                self.sent.push(Sent { started: self.started, ended: at, payload });
            }
            AirEvent::FieldOff => self.field_off.push(at),
            AirEvent::FieldOn => {}
        }
        let air = &mut self.air;
        node.board_mut(|board| air.from_poller(at, event, &mut |at, event| board.front_end.hear(at, event)));
    }

    fn noted(&mut self, (): ()) {}

    fn leave(&mut self, node: &mut Node<Dpr>) {
        let answers = node.board_mut(|board| board.front_end.take_air().len());
        assert_eq!(answers, 0, "the listener never answers");
    }

    fn next_at(&self) -> u64 {
        self.master.next_at()
    }

    fn act(&mut self, _at: u64, node: &mut Node<Dpr>) {
        if let Some(Progress::Over(transaction)) = self.master.act(node) {
            self.views.push(View::of(transaction.selected_ns, &transaction.miso));
            self.read(self.master.free_at() + PAUSE);
        }
    }
}
