//! Tests the receivers' interfaces. A scripted controller reads and writes.

use emulator_part::SpiMode;
use gnss_sim::ubx::{self, NavPvt};

use super::*;

const SCL: Pin = pin('F', 1);
const SDA: Pin = pin('F', 0);
const CS: Pin = pin('E', 3);
const BIT: u64 = 2_500;

const MS: u64 = 1_000_000;

struct Script {
    receivers: Receivers,
    now: u64,
}

impl Script {
    fn new() -> Self {
        let mut script = Self { receivers: Receivers::new(3), now: 10 * MS };
        script.receivers.attend();
        let mut inputs = vec![];
        script.receivers.powered(&mut inputs);
        assert!(inputs.contains(&Input::Level(SCL, Some(true))) && inputs.contains(&Input::Level(SDA, Some(true))));
        script
    }

    fn i2c(&mut self, event: I2cEvent) -> I2cAnswer {
        self.now += if event == I2cEvent::Stop { BIT } else { 9 * BIT };
        self.receivers.i2c(self.now, SCL, SDA, event)
    }

    fn read(&mut self, register: Option<u8>, bytes: usize) -> Vec<u8> {
        if let Some(register) = register {
            assert!(self.i2c(I2cEvent::Start(0x84)).acknowledged);
            assert!(self.i2c(I2cEvent::Write(register)).acknowledged);
        }
        assert!(self.i2c(I2cEvent::Start(0x85)).acknowledged);
        let read = (1..=bytes).map(|number| self.i2c(I2cEvent::Read(number < bytes)).data).collect();
        self.i2c(I2cEvent::Stop);
        read
    }

    fn select(&mut self, selected: bool) {
        self.receivers.pin(self.now, CS, Pad::Driven(!selected));
    }

    fn frame(&self, mosi: u32, bits: u8) -> SpiFrame {
        SpiFrame {
            sck: [Some(pin('F', 7)), None],
            mosi: [Some(pin('F', 9)), None],
            miso: Some(pin('F', 8)),
            mode: SpiMode::Mode0,
            bits,
            data: mosi,
            begins: 0,
            ends: 0,
        }
    }

    fn clock(&mut self, mosi: &[u8], takes: u64, every: u64) -> Vec<u8> {
        mosi.iter()
            .map(|&byte| {
                let frame = self.frame(u32::from(byte), 8);
                let answer = self.receivers.spi(self.now, self.now + takes, &frame);
                self.now += every;
                answer.unwrap_or(0x1EE) as u8
            })
            .collect()
    }

    fn transaction(&mut self, mosi: &[u8]) -> Vec<u8> {
        self.select(true);
        let miso = self.clock(mosi, 14_222, 14_222);
        self.select(false);
        miso
    }

    fn given(&mut self) -> Vec<ReadBytes> {
        self.receivers.take_read(self.now)
    }

    fn heard(&mut self) -> Vec<u8> {
        self.receivers.take_sent().into_iter().filter_map(|heard| heard.byte).collect()
    }
}

fn message() -> Vec<u8> {
    NavPvt { itow_ms: 0xFFFF, latitude_1e7: 475_000_000, ..NavPvt::default() }.encode()
}

#[test]
fn over_i2c_the_number_of_bytes_and_then_the_bytes_are_read() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 1, &message());
    assert_eq!(script.read(Some(0xFD), 2), [0, 100]);
    let begins = script.now + 9 * BIT;
    assert_eq!(script.read(None, 60), message()[..60]);
    assert_eq!(script.read(Some(0xFD), 2), [0, 40]);
    assert_eq!(script.read(Some(0xFF), 42), [&message()[60..], &[0xFF, 0xFF]].concat());
    assert_eq!(script.read(Some(0xFD), 2), [0, 0]);
    let given = script.given();
    assert_eq!(given.iter().flat_map(|given| given.bytes.clone()).collect::<Vec<_>>(), message(), "and no filler");
    assert!(given.iter().all(|given| given.clean && given.receiver == 1 && given.byte_ns == 9 * BIT));
    assert_eq!((given[0].at, given[0].bytes.len()), (begins, 60));
    assert_eq!(given.len(), 2);
}

#[test]
fn number_and_stream_are_read_in_one_transfer() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 1, &message());
    assert_eq!(script.read(Some(0xFD), 102), [&[0, 100], &message()[..]].concat());
}

#[test]
fn reserved_registers_read_ff_and_count_up_to_the_number() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 1, &message());
    assert_eq!(script.read(Some(0xFB), 5), [0xFF, 0xFF, 0, 100, 0xB5]);
}

#[test]
fn more_than_a_byte_written_over_i2c_is_for_the_receiver() {
    let mut script = Script::new();
    assert!(script.i2c(I2cEvent::Start(0x84)).acknowledged);
    for byte in [0xB5, 0x62, 0xFF] {
        assert!(script.i2c(I2cEvent::Write(byte)).acknowledged);
    }
    assert!(!script.receivers.has_sent());
    script.i2c(I2cEvent::Stop);
    assert_eq!(script.heard(), [0xB5, 0x62, 0xFF]);
    script.receivers.offer(script.now, 1, b"\xB5");
    assert_eq!(script.read(None, 1), [0xB5], "the register address is where it was");
}

#[test]
fn another_address_and_other_pins_are_not_answered() {
    let mut script = Script::new();
    assert!(!script.i2c(I2cEvent::Start(0x86)).acknowledged);
    assert!(!script.i2c(I2cEvent::Write(1)).acknowledged);
    script.i2c(I2cEvent::Stop);
    let answer = script.receivers.i2c(script.now, SDA, SCL, I2cEvent::Start(0x84));
    assert_eq!(answer, I2cAnswer::NOBODY);
}

#[test]
fn i2c_that_is_too_fast_gives_wrong_bytes_and_one_report() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 1, &message());
    script.i2c(I2cEvent::Start(0x85));
    for _ in 0..10 {
        script.now += 9 * 2_000;
        let answer = script.receivers.i2c(script.now, SCL, SDA, I2cEvent::Read(true));
        assert_ne!(answer.data, message()[0]);
    }
    script.i2c(I2cEvent::Stop);
    assert!(script.given().iter().all(|given| !given.clean));
    let misuses = script.receivers.take_misuses();
    assert_eq!(misuses.len(), 1);
    assert!(misuses[0].1.starts_with("receiver 2: I2C: more than 400 kHz"), "{misuses:?}");
}

#[test]
fn bytes_offered_at_different_instants_are_reported_apart() {
    for receiver in [1, 2] {
        let mut script = Script::new();
        let offered = [script.now, script.now + 60 * MS];
        for at in offered {
            script.now = at;
            script.receivers.offer(at, receiver, &message());
        }
        script.now += 10 * MS;
        if receiver == 1 {
            script.read(Some(0xFD), 2 + 200);
        } else {
            script.transaction(&[0xFF; 220]);
        }
        let given: Vec<_> = script.given().iter().map(|given| (given.bytes.len(), given.clean, given.since)).collect();
        assert_eq!(given, offered.map(|since| (100, true, since)), "{receiver}");
    }
}

#[test]
fn over_spi_a_receiver_sends_its_stream_and_then_filler() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 2, &message());
    let begins = script.now;
    let miso = script.transaction(&[0xFF; 120]);
    assert_eq!(miso, [&message()[..], &[0xFF; 20]].concat());
    assert_eq!(
        script.given(),
        [ReadBytes { receiver: 2, at: begins, byte_ns: 14_222, bytes: message(), clean: true, since: begins }],
        "and no filler"
    );
    assert!(!script.receivers.has_sent());
}

#[test]
fn sixteen_bits_at_once_are_two_bytes() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 2, &message());
    script.select(true);
    let frame = script.frame(0xB562, 16);
    assert_eq!(script.receivers.spi(script.now, script.now + 28_444, &frame), Some(0xB562));
    script.select(false);
    assert_eq!(script.heard(), [0xB5, 0x62]);
    assert_eq!(script.given()[0].bytes, [0xB5, 0x62]);
}

#[test]
fn without_chip_select_or_on_other_pins_nothing_is_driven() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 2, &message());
    let frame = script.frame(0xFF, 8);
    assert_eq!(script.receivers.spi(script.now, script.now + 14_222, &frame), None);
    script.select(true);
    let other = SpiFrame { sck: [Some(pin('A', 5)), None], ..frame };
    assert_eq!(script.receivers.spi(script.now, script.now + 14_222, &other), None);
    let unread = SpiFrame { miso: None, ..frame };
    assert_eq!(script.receivers.spi(script.now, script.now + 14_222, &unread), None);
    script.now += 14_222;
    assert_eq!(script.transaction(&[0xFF]), [message()[1]], "the clock has moved the stream on");
}

#[test]
fn another_mode_or_too_fast_a_clock_gives_no_right_bytes() {
    for (mode, takes, words) in [(SpiMode::Mode1, 14_222, "not mode 0"), (SpiMode::Mode0, 889, "5.5 MHz")] {
        let mut script = Script::new();
        script.receivers.offer(script.now, 2, &message());
        script.select(true);
        let frame = SpiFrame { mode, ..script.frame(0xB5, 8) };
        let answer = script.receivers.spi(script.now, script.now + takes, &frame);
        script.select(false);
        assert_ne!(answer, Some(0xB5), "{mode:?}");
        assert!(script.given().iter().all(|given| !given.clean));
        assert!(script.heard().is_empty());
        let misuses = script.receivers.take_misuses();
        assert!(misuses.len() == 1 && misuses[0].1.contains(words), "{misuses:?}");
    }
}

#[test]
fn over_spi_no_more_than_125_kb_a_second_are_loaded() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 2, &message());
    script.select(true);
    // The receiver needs 8 µs to load a byte. At 4.5 MHz without gaps it therefore loads a new one at every fifth byte
    // only.
    let miso = script.clock(&[0xFF; 10], 1_778, 1_778);
    let sync = ubx::SYNC;
    assert_eq!(miso, [[sync[0]; 5], [sync[1]; 5]].concat());
    script.select(false);
    assert!(script.given().iter().all(|given| !given.clean));
    assert!(script.receivers.take_misuses()[0].1.contains("125 kB/s"));
    script.now += MS;
    script.select(true);
    assert_eq!(script.clock(&[0xFF; 98], 1_778, 8_000), message()[2..]);
    script.select(false);
    assert!(script.given().iter().all(|given| given.clean));
    assert!(script.receivers.take_misuses().is_empty());
}

#[test]
fn spi_input_is_ignored_after_fifty_bytes_of_filler() {
    let mut script = Script::new();
    assert!(script.transaction(&[0xFF; 200]).iter().all(|byte| *byte == 0xFF));
    assert!(script.heard().is_empty());
    script.transaction(&[&[0xB5][..], &[0xFF; 60], &[0x62]].concat());
    assert_eq!(script.heard(), [&[0xB5][..], &[0xFF; 50], &[0x62]].concat());
}

#[test]
fn a_message_that_does_not_fit_is_dropped_whole() {
    let mut script = Script::new();
    let messages = message().repeat(41);
    script.receivers.offer(script.now, 1, &messages);
    assert_eq!(script.read(Some(0xFD), 2), [(4_000 >> 8) as u8, 4_000_u16 as u8]);
    script.receivers.offer(script.now, 1, b"$GNGGA\r\n");
    assert_eq!(script.read(Some(0xFD), 2), [(4_008 >> 8) as u8, 4_008_u16 as u8]);
}

#[test]
fn a_receiver_not_read_for_two_seconds_queues_no_more_messages() {
    let mut script = Script::new();
    script.read(None, 1);
    script.receivers.offer(script.now + 1_999 * MS, 1, &message());
    script.receivers.offer(script.now + 2_001 * MS, 1, &message());
    script.now += 3_000 * MS;
    assert_eq!(script.read(Some(0xFD), 2), [0, 100]);
    script.receivers.offer(script.now, 1, &message());
    assert_eq!(script.read(Some(0xFD), 2), [0, 200]);
}

#[test]
fn bytes_of_a_transfer_that_is_not_ended_properly_are_marked_unsure() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 1, &message());
    script.i2c(I2cEvent::Start(0x85));
    script.i2c(I2cEvent::Read(true));
    assert_ne!(script.receivers.untold_since(), u64::MAX);
    assert!(script.given().is_empty(), "it may still end as it should");
    script.i2c(I2cEvent::Stop);
    assert!(!script.given()[0].clean);
    script.i2c(I2cEvent::Start(0x85));
    script.i2c(I2cEvent::Read(true));
    script.now += ABANDONED;
    let given = script.given();
    assert_eq!((given.len(), given[0].clean), (1, false));
    assert_eq!(script.receivers.untold_since(), u64::MAX);
}

#[test]
fn a_byte_at_another_rate_is_nothing_that_the_receiver_can_read() {
    let mut script = Script::new();
    let send = |script: &mut Script, baud| {
        script.now += MS;
        script.receivers.uart(script.now, pin('D', 5), &UartFrame::eight_n_one(0xB5, baud));
        script.receivers.take_sent().into_iter().map(|heard| heard.byte).collect::<Vec<_>>()
    };
    assert_eq!(send(&mut script, 460_800), [Some(0xB5)]);
    assert_eq!(send(&mut script, 466_667), [Some(0xB5)], "1.3 % off");
    assert_eq!(send(&mut script, 38_400), [None]);
    script.receivers.listen_at(0, 38_400);
    assert_eq!(send(&mut script, 38_400), [Some(0xB5)]);
    assert_eq!(send(&mut script, 460_800), [None]);
    for _ in 0..100 {
        send(&mut script, 460_800);
    }
    assert_eq!(send(&mut script, 38_400), []);
    script.now += 1_000 * MS;
    assert_eq!(send(&mut script, 38_400), [Some(0xB5)]);
}

fn levels(script: &mut Script) -> Vec<(Pin, bool)> {
    let mut inputs = vec![];
    script.receivers.settle(script.now, &mut inputs);
    inputs
        .into_iter()
        .map(|input| match input {
            Input::Level(pin, Some(level)) => (pin, level),
            other => panic!("{other:?}"),
        })
        .collect()
}

fn failing(fault: BusFault) -> Script {
    let mut script = Script::new();
    let receiver = if fault.interface() == gnss_sim::Port::I2c { 1 } else { 2 };
    script.receivers.offer(script.now, receiver, &message().repeat(10));
    script.receivers.begin_fault(script.now, receiver, fault, 7);
    script
}

fn clocks(script: &mut Script, number: u32) {
    for _ in 0..number {
        script.receivers.pin(script.now, SCL, Pad::Driven(false));
        script.receivers.pin(script.now, SCL, Pad::Floating);
    }
}

#[test]
fn a_receiver_that_holds_sda_releases_it_after_nine_clocks() {
    let mut script = failing(BusFault::SdaUntilClocked);
    assert_eq!(levels(&mut script), [(SDA, false)]);
    clocks(&mut script, 8);
    assert_eq!(levels(&mut script), []);
    clocks(&mut script, 1);
    assert_eq!(levels(&mut script), [(SDA, true)]);
    assert_eq!(script.read(Some(0xFD), 2), [(1_000 >> 8) as u8, 1_000_u16 as u8], "nothing is lost");
}

#[test]
fn a_stuck_line_stays_low_whatever_is_clocked_until_the_fault_ends() {
    for (fault, pin) in [(BusFault::SdaStuck, SDA), (BusFault::SclStuck, SCL)] {
        let mut script = failing(fault);
        assert_eq!(levels(&mut script), [(pin, false)]);
        clocks(&mut script, 20);
        assert_eq!(levels(&mut script), []);
        script.receivers.end_fault(1, fault);
        assert_eq!(levels(&mut script), [(pin, true)]);
        assert_eq!(script.read(Some(0xFF), 1), [0xB5]);
    }
}

#[test]
fn a_line_that_sticks_in_a_transfer_makes_what_had_crossed_unsure() {
    let mut script = Script::new();
    script.receivers.offer(script.now, 1, &message());
    script.i2c(I2cEvent::Start(0x85));
    script.i2c(I2cEvent::Read(true));
    script.receivers.begin_fault(script.now, 1, BusFault::SdaStuck, 7);
    let given = script.given();
    assert_eq!((given.len(), given[0].clean), (1, false));
    assert_eq!(script.i2c(I2cEvent::Read(true)).data, 0xFF, "it has left the transfer");
}

#[test]
fn a_receiver_that_acknowledges_nothing_keeps_its_stream() {
    let mut script = failing(BusFault::NoAnswer);
    assert_eq!(script.i2c(I2cEvent::Start(0x84)), I2cAnswer::NOBODY);
    assert_eq!(script.i2c(I2cEvent::Start(0x85)), I2cAnswer::NOBODY);
    script.i2c(I2cEvent::Stop);
    script.receivers.end_fault(1, BusFault::NoAnswer);
    assert_eq!(script.read(Some(0xFD), 2), [3, 0xE8]);
}

#[test]
fn a_receiver_stretches_the_clock_as_long_as_its_data_sheet_states() {
    let mut script = failing(BusFault::Stretches);
    let answer = script.i2c(I2cEvent::Start(0x85));
    assert_eq!((answer.acknowledged, answer.stretched_ns), (true, 20 * MS));
    script.now += 20 * MS;
    assert_eq!(script.i2c(I2cEvent::Read(false)).data, 0xB5);
    script.i2c(I2cEvent::Stop);
    assert!(script.receivers.take_misuses().is_empty());
}

#[test]
fn glitches_are_short_and_come_as_often_as_they_should() {
    let mut script = failing(BusFault::Glitches);
    let (begun, mut falls, mut rises) = (script.now, vec![], vec![]);
    while script.now < begun + 100 * MS {
        script.now = script.receivers.next_event();
        for (pin, high) in levels(&mut script) {
            assert_eq!(pin, SDA);
            if high { rises.push(script.now) } else { falls.push(script.now) }
        }
    }
    assert!((400..600).contains(&falls.len()), "{}", falls.len());
    assert!(falls.iter().zip(&rises).all(|(fell, rose)| rose - fell == 1_000));
    script.receivers.end_fault(1, BusFault::Glitches);
    levels(&mut script);
    assert_eq!(script.receivers.next_event(), u64::MAX);
}

#[test]
fn bit_errors_on_i2c_are_reported_as_read_and_marked_unsure() {
    let mut script = failing(BusFault::Noise);
    let read = script.read(Some(0xFF), 1_000);
    let given = script.given();
    assert!(given.iter().all(|given| !given.clean));
    assert_eq!(given.iter().flat_map(|given| given.bytes.clone()).collect::<Vec<_>>(), read);
    let wrong: u32 = read.iter().zip(message().repeat(10)).map(|(read, said)| (read ^ said).count_ones()).sum();
    assert!((6..30).contains(&wrong), "{wrong} of 8000 bits");
}

#[test]
fn each_fault_of_miso_makes_of_the_stream_what_it_says() {
    let said = message();
    let seen = |fault| {
        let mut script = failing(fault);
        let miso = script.transaction(&[0xFF; 100]);
        let given = script.given();
        assert!(given.iter().all(|given| !given.clean), "{fault:?}");
        script.receivers.end_fault(2, fault);
        script.now += MS;
        assert_eq!(script.transaction(&[0xFF; 2]), said[..2], "{fault:?}: the stream has gone on");
        assert!(script.given()[0].clean);
        miso
    };
    assert_eq!(seen(BusFault::Ones), [0xFF; 100]);
    assert_eq!(seen(BusFault::Zeros), [0; 100]);
    let random = seen(BusFault::Random);
    assert!(random.iter().collect::<std::collections::BTreeSet<_>>().len() > 60);
    let shifted = seen(BusFault::Shifted);
    let bits = |bytes: &[u8]| bytes.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1)).collect();
    let (shifted, said): (Vec<u8>, Vec<u8>) = (bits(&shifted), bits(&said));
    assert_eq!(shifted[1..], said[..799]);
}
