//! Measures the time of the work at the end of an SSI transaction, of the hand-over of images and receive areas, and of
//! the port task.

use core::{hint::black_box, ops::Range};

use cortex_m::peripheral::DWT;
use dpr_fw::{
    port::{
        areas::{Areas, HandedOver, SsiEnd, Transaction, AREAS},
        Diagnostics, WritePort,
    },
    publish::{Events, Mailbox, Server, Ssi},
    ssi::{Asked, ReceiveArea, Windows, RECEIVE_BYTES},
    telemetry::Telemetry,
    triple::{self, Exchange, Filling, Received, Rotated, Rotation, Scrubbable, IMAGES},
    ImageMemory, ReceiveMemory, IMAGE_WORDS, RECEIVERS, RECEIVE_WORDS,
};
use on_target_tests::cycles::{bounds, Cycles, Taken};
use profile::{
    criticality::{BaseStation, FlightController, Writer},
    map::{Map, PortArea},
    ssi::{encode, Request},
    Command, CommandObject, Uplink, UplinkValues,
};

use super::commit::Own;

/// The number of bytes of the map that the flight controller can read.
const LEN: usize = Map::<RECEIVERS>::LEN;

type Mosi = [u8; RECEIVE_BYTES];

/// Returns the bytes on MOSI for a request and an object, followed by the byte `beyond` in all remaining places.
fn mosi(request: [u8; 8], object: &[u8; Uplink::SIZE], beyond: u8) -> Mosi {
    let mut bytes = [beyond; RECEIVE_BYTES];
    bytes[..8].copy_from_slice(&request);
    bytes[8..8 + Uplink::SIZE].copy_from_slice(object);
    bytes
}

const NOTHING: [u8; 8] = [0; 8];
const IDLE: [u8; Uplink::SIZE] = [0; Uplink::SIZE];

/// Returns requests: none, for windows, damaged ones, for windows outside the map, and random ones (from a fixed seed).
fn requests() -> [[u8; 8]; 16] {
    let window = |offset, length| encode(Request { offset, length });
    let mut damaged = window(96, 60);
    damaged[0] ^= 1;
    let mut crc = window(96, 60);
    crc[7] ^= 0x80;
    let mut all = [NOTHING; 16];
    let named = [
        NOTHING,
        [0xFF; 8],
        window(0, 1),
        window(0, LEN as u16),
        window(LEN as u16 - 1, 1),
        damaged,
        crc,
        window(0, 0),
        window(0, LEN as u16 + 1),
        window(u16::MAX, u16::MAX),
    ];
    all[..named.len()].copy_from_slice(&named);
    let mut state = 0x1234_5678_u32;
    for byte in all[named.len()..].as_flattened_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *byte = (state >> 24) as u8;
    }
    all
}

/// Times `Windows::transaction`, and the calculation of the window that follows from it.
pub(crate) fn windows(cycles: &Cycles) {
    let mut taken = Taken::NONE;
    let mut asked_for = 0;
    for request in requests() {
        let bytes = mosi(request, &IDLE, 0);
        let mut windows = Windows::<LEN>::new();
        let (took, asked) = cycles.timed(|| {
            let asked = windows.transaction(black_box(&bytes));
            black_box(windows.window());
            asked
        });
        asked_for += u32::from(asked == Asked::Window);
        taken.note(took);
    }
    defmt::assert_eq!(asked_for, 3);
    taken.assert("ssi::Windows::transaction", bounds(250, 180, 240, 16));
}

/// A model of the SSI's hardware in which every resource is available at once, with the receive areas that it lends.
struct Wires<'m, 'a, 'q> {
    mosi: &'m [u8],
    image: Option<Received<&'a mut ImageMemory, ()>>,
    area: Option<Filling<&'a mut ReceiveArea>>,
    areas: SsiEnd<'q, &'a mut ReceiveArea>,
    released: u32,
    begun_at: u32,
    released_at: u32,
    handed_over: Option<HandedOver>,
}

impl<'a> Ssi for Wires<'_, 'a, '_> {
    type Buffer = &'a mut ImageMemory;

    fn take_events(&mut self) -> Events<'_> {
        self.begun_at = DWT::cycle_count();
        Events { ours: true, received: Some(self.mosi), over_read: black_box(false), overflow: black_box(false) }
    }
    fn hand_over(&mut self, asked: Asked) -> HandedOver {
        let Some(mut area) = self.area.take() else { return HandedOver::Empty };
        // The fourth word of an area holds identifier and status. It is examined when the area is dropped.
        area.memory()[3] = 0x5A5A_5A5A;
        let (next, handed_over) = self.areas.hand_over(area, Transaction { asked, bytes: self.mosi.len() });
        self.area = Some(next);
        self.handed_over = Some(handed_over);
        handed_over
    }
    fn pass_on(&mut self) {
        black_box(self.areas.pass_on());
    }
    fn is_expired(&mut self) -> bool {
        black_box(false)
    }
    fn exchange<R>(
        &mut self,
        with: impl FnOnce(Option<Received<Self::Buffer, ()>>) -> (Option<Received<Self::Buffer, ()>>, R),
    ) -> R {
        let (image, result) = with(self.image.take());
        self.image = image;
        result
    }
    fn load(&mut self, window: Range<usize>) -> bool {
        black_box(window);
        black_box(true)
    }
    fn announce(&mut self) {}
    fn release(&mut self) {
        self.released_at = DWT::cycle_count();
        self.released += 1;
    }
}

/// Times `Server::serve` after each kind of transaction, with the area handed over, and when all areas are used up.
pub(crate) fn serve(cycles: &Cycles) {
    let requests = requests().map(|request| mosi(request, &[0x5A; Uplink::SIZE], 0));
    let mut images: [ImageMemory; IMAGES] = [[0; IMAGE_WORDS]; IMAGES];
    let mut memory: [ReceiveArea; AREAS] = [[0; RECEIVE_BYTES / 4]; AREAS];
    let mut queues = Areas::new();
    let (area, ssi_end, mut port_end, _) = queues.split(memory.each_mut());
    let mut mailbox = Mailbox::new(images.each_mut());
    let telemetry = Telemetry::new();
    let mut port = Wires {
        mosi: &[],
        image: None,
        area: Some(area),
        areas: ssi_end,
        released: 0,
        begun_at: 0,
        released_at: 0,
        handed_over: None,
    };
    // There are three classes of calls: the next receive area is ready, the port task has just returned it, or there is
    // none.
    let mut released = [Taken::NONE; 3];
    let mut whole = [Taken::NONE; 3];
    let mut granted = 0;
    for bytes in &requests {
        for (number, judged) in [true, true, false, false, false].into_iter().enumerate() {
            let mut server = Server::<LEN>::new();
            port.mosi = black_box(bytes);
            let took = cycles.of(|| server.serve(&mut port, Own(&mut mailbox), &telemetry));
            // The first call of each request comes just after all receive areas were used up and returned, so it is in
            // the second class.
            let class = match port.handed_over {
                Some(HandedOver::Waits) if number == 0 => 1,
                Some(HandedOver::Waits) => 0,
                Some(HandedOver::Dropped) => 2,
                _ => defmt::panic!("an object that is not idle was not handed over"),
            };
            whole[class].note(took);
            released[class].note(port.released_at.wrapping_sub(port.begun_at));
            granted += 1;
            if judged {
                if let Some(brought) = port_end.take() {
                    port_end.done(brought);
                }
            }
        }
        while let Some(brought) = port_end.take() {
            port_end.done(brought);
        }
    }
    defmt::assert_eq!(port.released, granted);
    // The flight controller waits until the buffers are released, so that time has a bound and may vary only within a
    // limit. The whole call has a bound only, because its time depends on how many areas the port task has.
    released[0].assert("Server::serve, until the release", bounds(330, 250, 330, 16));
    released[1].assert("Server::serve, until the release, area just returned", bounds(360, 280, 360, 16));
    released[2].assert("Server::serve, until the release, areas used up", bounds(400, 330, 420, 16));
    whole[0].assert("Server::serve", bounds(500, 400, 540, u32::MAX));
    whole[1].assert("Server::serve, area just returned", bounds(500, 400, 540, u32::MAX));
    whole[2].assert("Server::serve, areas used up", bounds(500, 400, 540, u32::MAX));
}

/// Times `Exchange`, by which an image is begun, published and taken.
pub(crate) fn exchange(cycles: &Cycles) {
    let mut images: [ImageMemory; IMAGES] = [[0; IMAGE_WORDS]; IMAGES];
    let mut exchange = Exchange::new(images.each_mut());
    let mut streamed = None;
    let (mut begin, mut publish, mut take) = (Taken::NONE, Taken::NONE, Taken::NONE);
    for round in 0..12 {
        triple::scrub_waiting(Own(&mut exchange));
        let (took, blank) = cycles.timed(|| exchange.begin());
        begin.note(took);
        let (mut filling, _) = defmt::unwrap!(blank).fill();
        filling.memory().fill(round);
        publish.note(cycles.of(|| exchange.publish(filling)));
        let before = streamed.take();
        let (took, (image, newer)) = cycles.timed(|| exchange.take(before));
        defmt::assert!(newer);
        // The first image replaces no other, so taking it is not counted.
        if round > 0 {
            take.note(took);
        }
        let image: Received<&mut ImageMemory, ()> = defmt::unwrap!(image);
        defmt::assert!(image.memory().iter().all(|word| *word == round));
        streamed = Some(image);
    }
    begin.assert("Exchange::begin", bounds(50, 45, 65, 8));
    publish.assert("Exchange::publish", bounds(25, 25, 35, 8));
    take.assert("Exchange::take", bounds(65, 55, 75, 8));
}

/// Times `Rotation`, by which a frame is handed on, read and discarded.
pub(crate) fn rotation(cycles: &Cycles) {
    let mut memory: [ReceiveMemory; 3] = [[0; RECEIVE_WORDS]; 3];
    let (mut filling, mut rotation, _) = Rotation::<_, u32>::new(memory.each_mut());
    let (mut rotate, mut read, mut done) = (Taken::NONE, Taken::NONE, Taken::NONE);
    for frame in 1..=9 {
        let (took, (next, rotated)) = cycles.timed(|| rotation.rotate(filling, frame));
        filling = next;
        defmt::assert!(rotated == Rotated::Handed);
        rotate.note(took);
        let (took, received) = cycles.timed(|| rotation.read());
        read.note(took);
        let received = defmt::unwrap!(received);
        defmt::assert_eq!(*received.about(), frame);
        done.note(cycles.of(|| rotation.done(received)));
        let outcome = defmt::unwrap!(rotation.take_dirty()).scrub();
        rotation.scrubbed(outcome);
    }
    rotate.assert("Rotation::rotate", bounds(75, 65, 90, 8));
    read.assert("Rotation::read", bounds(55, 45, 65, 8));
    done.assert("Rotation::done", bounds(35, 30, 45, 8));
}

/// Times `WritePort::transaction` and `WritePort::prepare`. Only the idle loop waits for them, so their time may vary
/// with the data.
pub(crate) fn port(cycles: &Cycles) {
    let (base, own) = (Writer::<BaseStation>::claim(), Writer::<FlightController>::claim());
    let values = |timestamp| UplinkValues { timestamp, payload: [0xA5; Uplink::PAYLOAD], ..UplinkValues::default() };
    let mut damaged = *Uplink::seal(own, &values(8)).as_bytes();
    damaged[63] ^= 1;
    let sealed = |place: usize, value: u8| {
        let mut bytes = *CommandObject::seal(own, 9, Command::SelfTest).as_bytes();
        bytes[place] = value;
        let crc = profile::crc::frame(&bytes[..60]);
        bytes[60..].copy_from_slice(&crc.to_be_bytes());
        bytes
    };
    let outside = encode(Request { offset: LEN as u16, length: 1 });
    let mut chance = NOTHING;
    chance[3] = 7;
    let transactions = [
        mosi(NOTHING, &IDLE, 0),
        mosi([0xFF; 8], &[0xFF; Uplink::SIZE], 0xFF),
        mosi(NOTHING, Uplink::seal(base, &values(5)).as_bytes(), 0),
        mosi(NOTHING, Uplink::seal(own, &values(5)).as_bytes(), 0),
        mosi(NOTHING, Uplink::seal(own, &values(5)).as_bytes(), 0), // is not newer than the uplink before
        mosi(NOTHING, CommandObject::seal(own, 6, Command::ClearCounters).as_bytes(), 0),
        mosi(NOTHING, CommandObject::seal(own, 7, Command::SelfTest).as_bytes(), 0),
        mosi(NOTHING, CommandObject::seal(own, 8, Command::SelfTest).as_bytes(), 0), // meets a test that is under way
        mosi(NOTHING, &sealed(8, 0), 0),                                             // has an unknown word
        mosi(NOTHING, &sealed(40, 1), 0),                                            // has reserved bytes that are set
        mosi(NOTHING, &sealed(5, 0x77), 0),                                          // has a wrong identifier
        mosi(NOTHING, &damaged, 0),
        mosi(chance, &damaged, 1), // has a wrong request, object and rest
        mosi(outside, &IDLE, 0),
    ];
    let mut port = WritePort::new();
    let mut area = PortArea::EMPTY;
    let (mut transaction, mut prepare) = (Taken::NONE, Taken::NONE);
    let mut now_us = 1_000;
    for bytes in &transactions {
        for length in [0, 5, 8, 40, RECEIVE_BYTES] {
            let mut brought: ReceiveArea = [0; RECEIVE_BYTES / 4];
            for (word, bytes) in brought.iter_mut().zip(bytes.as_chunks().0) {
                *word = u32::from_ne_bytes(*bytes);
            }
            let asked = Windows::<LEN>::new().transaction(&bytes[..length]);
            let what = Transaction { asked, bytes: length };
            now_us += 1_000;
            transaction.note(cycles.of(|| port.transaction(black_box(what), black_box(&brought), now_us)));
            prepare.note(cycles.of(|| port.prepare(black_box(&Diagnostics::default()), now_us, &mut area)));
        }
    }
    defmt::assert!(port.uplinks_accepted() == 0 && port.self_test_requested());
    defmt::assert!(port.access_violations() >= 10);
    transaction.assert("WritePort::transaction", bounds(1_700, 1_300, 2_400, u32::MAX));
    prepare.assert("WritePort::prepare", bounds(400, 400, 650, u32::MAX));
}
