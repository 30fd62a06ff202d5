//! A stand-in for the chip with registers and a FIFO, and an executor that runs a machine against it.
//!
//! The stand-in behaves as the driver's documentation describes the chip, in whole µs. It can also be set to misbehave.
//! It has no analogue side, and only the two modes that the driver uses.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use st25r3916::executor::Machine;
use st25r3916::listener::BUFFER;
use st25r3916::{Fault, Input, Listener, ListenerEvent, Poller, PollerEvent, Step, Transfer, Variant};

pub(crate) const MAIN: usize = 0;
pub(crate) const TIMER: usize = 1;
pub(crate) const ERROR: usize = 2;
pub(crate) const RXS: u8 = 0x20;
pub(crate) const RXE: u8 = 0x10;
pub(crate) const TXE: u8 = 0x08;
pub(crate) const NRE: u8 = 0x40;
pub(crate) const EON: u8 = 0x10;
pub(crate) const EOF: u8 = 0x08;
pub(crate) const CRC: u8 = 0x80;

/// An event in the chip at a planned instant. No access by the driver causes it.
#[derive(Clone, Debug)]
pub(crate) enum Happening {
    Irq(usize, u8),
    Measured(u8),
    /// The sync of a frame is received, if the receiver is on and unmasked.
    Sync,
    /// A byte of the frame whose sync was accepted arrives.
    Byte(u8),
    /// The frame whose sync was accepted ends, with these error bits.
    End(u8),
    /// The frame whose sync was accepted ends within a byte. This number of that byte's bits has arrived.
    BrokenByte(u8),
    /// The transmitter takes a byte out of the FIFO.
    Taken,
    /// The chip's own frame on the air ends.
    TransmitEnd,
    PowerUpReset,
    /// The receiver becomes unmasked, although no command unmasked it.
    Unmask,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Miso {
    Driven,
    StuckLow,
    StuckHigh,
}

#[derive(Clone, Debug)]
pub(crate) struct Chip {
    pub(crate) now: u64,
    pub(crate) a: [u8; 64],
    pub(crate) b: [u8; 64],
    pub(crate) test: [u8; 64],
    pub(crate) irqs: [u8; 4],
    pub(crate) fifo: VecDeque<u8>,
    pub(crate) fifo_flags: u8,
    pub(crate) identity: u8,
    pub(crate) miso: Miso,
    pub(crate) db_clears_irqs: bool,
    /// Whether the end of a frame masks the receiver until the next command D1.
    pub(crate) end_masks_receiver: bool,
    pub(crate) oscillator_us: Option<u64>,
    pub(crate) regulator_us: Option<u64>,
    /// The time from the command for the RC calibration to I_dct (ST25R3916B); `None`: I_dct never comes.
    pub(crate) calibration_us: Option<u64>,
    /// The time from the command for the supply measurement to I_dct and the result; `None`: I_dct never comes.
    pub(crate) measurement_us: Option<u64>,
    pub(crate) supply_mv: u32,
    pub(crate) transmits: bool,
    pub(crate) transmit_ends: bool,
    pub(crate) no_response_ends: bool,
    pub(crate) pin_stuck: bool,
    /// The number that the FIFO status adds to the right FIFO level.
    pub(crate) level_error: i32,
    /// A register, by space and address, and the bits that the chip stores inverted in it.
    pub(crate) stuck: Option<(usize, usize, u8)>,
    /// Whether `reg_s` was set and cleared since the last adjustment of the regulators.
    pub(crate) adjusts: bool,
    /// The space and address of every register that the driver has written since the last set default.
    pub(crate) written: BTreeSet<(usize, usize)>,
    /// The MOSI bytes of every transfer, in order.
    pub(crate) log: Vec<Vec<u8>>,
    /// The frames that the chip has transmitted, with their instants in µs.
    pub(crate) sent: Vec<(u64, Vec<u8>)>,
    /// Accesses by the driver that a real chip would not answer as expected.
    pub(crate) misuse: Vec<String>,
    pub(crate) unmasked: bool,
    pub(crate) receiving: bool,
    pub(crate) sending: bool,
    pub(crate) schedule: BTreeMap<(u64, u32), Happening>,
    pub(crate) order: u32,
}

impl Chip {
    pub(crate) fn new(variant: Variant) -> Self {
        Self {
            now: 0,
            a: [0; 64],
            b: [0; 64],
            test: [0; 64],
            irqs: [0; 4],
            fifo: VecDeque::new(),
            fifo_flags: 0,
            identity: match variant {
                Variant::A => 0x2A,
                Variant::B => 0x31,
            },
            miso: Miso::Driven,
            db_clears_irqs: false,
            end_masks_receiver: true,
            oscillator_us: Some(700),
            regulator_us: Some(3_000),
            calibration_us: Some(2_000),
            measurement_us: Some(25),
            supply_mv: 5_000,
            transmits: true,
            transmit_ends: true,
            no_response_ends: true,
            pin_stuck: false,
            level_error: 0,
            stuck: None,
            adjusts: false,
            written: BTreeSet::new(),
            log: Vec::new(),
            sent: Vec::new(),
            misuse: Vec::new(),
            unmasked: false,
            receiving: false,
            sending: false,
            schedule: BTreeMap::new(),
            order: 0,
        }
    }

    /// Returns the space and address of each register that the driver has written and that must keep its value. The
    /// register of the frame's length changes, so it is left out.
    pub(crate) fn written(&self) -> BTreeSet<(usize, usize)> {
        self.written.iter().copied().filter(|(space, address)| *space < 2 && !matches!(address, 0x22 | 0x23)).collect()
    }

    pub(crate) fn flip(&mut self, space: usize, address: usize, bit: u8) {
        let registers = if space == 0 { &mut self.a } else { &mut self.b };
        registers[address] ^= 1 << bit;
        if (space, address, bit) == (0, 0x02, 3) {
            self.a[0x31] &= !0x20;
        }
    }

    pub(crate) fn at(&mut self, instant: u64, happening: Happening) {
        self.order += 1;
        self.schedule.insert((instant.max(self.now), self.order), happening);
    }

    /// Plans a frame whose sync ends at `sync`. Its bytes are LEN, the payload and two fixed bytes in place of the
    /// CRC-16. Returns the instant of the frame's end.
    pub(crate) fn frame(&mut self, sync: u64, payload: &[u8]) -> u64 {
        let mut bytes = vec![payload.len() as u8 + 1];
        bytes.extend_from_slice(payload);
        bytes.extend_from_slice(&[0xC1, 0xC2]);
        self.raw_frame(sync, &bytes, Some(0))
    }

    /// Plans a frame of these bytes and returns the instant of its end. Without `end`, I_rxe never comes.
    pub(crate) fn raw_frame(&mut self, sync: u64, bytes: &[u8], end: Option<u8>) -> u64 {
        self.at(sync, Happening::Sync);
        let instant = |index: usize| sync + (index as u64 * 18_879) / 1_000;
        for (index, byte) in bytes.iter().enumerate() {
            self.at(instant(index + 1), Happening::Byte(*byte));
        }
        let over = instant(bytes.len());
        if let Some(errors) = end {
            self.at(over, Happening::End(errors));
        }
        over
    }

    pub(crate) fn clear_air(&mut self) {
        self.receiving = false;
        self.schedule.retain(|_, what| {
            matches!(what, Happening::Irq(..) | Happening::Measured(_) | Happening::Taken | Happening::TransmitEnd)
        });
    }

    pub(crate) fn senses_field(&mut self, there: bool) {
        self.a[0x31] = self.a[0x31] & !0x40 | u8::from(there) << 6;
    }

    /// Switches the poller's field on or off, with the interrupt of the field detector.
    pub(crate) fn field(&mut self, there: bool) {
        self.irqs[TIMER] |= if there { EON } else { EOF };
        self.senses_field(there);
    }

    pub(crate) fn pin(&self) -> bool {
        self.pin_stuck || self.irqs.iter().zip(&self.a[0x16..]).any(|(irq, mask)| irq & !mask != 0)
    }

    fn oscillates(&self) -> bool {
        self.a[0x31] & 0x10 != 0
    }

    /// Whether the receiver is on and unmasked, and has the filter, demodulator, gain and correlator that NFC-F needs
    /// in the chip's role: as a target, or as a poller with its field on.
    fn receiver_listens(&self) -> bool {
        let demodulator = match (self.a[3] & 0x80 != 0, self.identity & 0xF8) {
            (true, _) => 0x2D,
            (false, 0x28) => 0x3D,
            (false, _) => 0xFD,
        };
        self.oscillates()
            && self.a[2] & 0x40 != 0
            && self.a[3] & 0x80 != self.a[2] << 4 & 0x80
            && self.unmasked
            && !self.sending
            && self.a[0x0A] & 0x04 == 0
            && self.a[0x0B..=0x0E] == [0x13, demodulator, 0x00, 0x00]
            && self.b[0x0C..=0x0D] == [0x54, 0x00]
    }

    /// Whether a direct command that raises I_dct at its end is in progress.
    fn is_busy(&self) -> bool {
        self.schedule.values().any(|what| matches!(what, Happening::Irq(TIMER, 0x80)))
    }

    /// Plans the end of a direct command after `us` µs; `None`: the command never ends.
    fn ends(&mut self, us: Option<u64>) {
        if let Some(us) = us {
            self.at(self.now + us, Happening::Irq(TIMER, 0x80));
        }
    }

    fn reset(&mut self) {
        self.written.clear();
        let field = self.a[0x31] & 0x40;
        self.a = [0; 64];
        self.a[0x31] = field;
        self.a[0x0B..=0x0E].copy_from_slice(&[0x08, 0x2D, 0xD8, 0x00]);
        self.a[0x28] = 0x70;
        self.b = [0; 64];
        self.b[0x0C] = 0x93;
        self.test = [0; 64];
        self.fifo.clear();
        self.fifo_flags = 0;
        self.unmasked = false;
        self.receiving = false;
        self.sending = false;
        self.schedule.retain(|_, what| {
            !matches!(
                what,
                Happening::Taken
                    | Happening::TransmitEnd
                    | Happening::Irq(TIMER, NRE)
                    | Happening::Measured(_)
                    | Happening::Irq(MAIN, 0x80)
                    | Happening::Irq(TIMER, 0x80)
            )
        });
    }

    pub(crate) fn advance(&mut self, to: u64) {
        while let Some(entry) = self.schedule.first_entry() {
            let &(instant, _) = entry.key();
            if instant > to {
                break;
            }
            let what = entry.remove();
            self.now = self.now.max(instant);
            self.happen(what);
        }
        self.now = self.now.max(to);
    }

    fn happen(&mut self, what: Happening) {
        match what {
            Happening::Irq(register, bits) => {
                self.irqs[register] |= bits;
                if register == MAIN && bits & 0x80 != 0 {
                    self.a[0x31] |= 0x10;
                }
                if register == TIMER && bits & (EON | EOF) != 0 {
                    self.senses_field(bits & EON != 0);
                }
            }
            Happening::Measured(steps) => self.a[0x25] = steps,
            Happening::Sync => {
                self.senses_field(true);
                self.receiving = self.receiver_listens();
                if self.receiving {
                    self.schedule.retain(|_, what| !matches!(what, Happening::Irq(TIMER, NRE)));
                    self.fifo.clear();
                    self.fifo_flags = 0;
                    self.irqs[MAIN] |= RXS;
                }
            }
            Happening::Byte(byte) if self.receiving => {
                if self.fifo.len() < 512 {
                    self.fifo.push_back(byte);
                } else {
                    self.fifo_flags |= 0x10;
                }
            }
            Happening::Byte(_) => {}
            Happening::End(errors) => self.end(errors),
            Happening::BrokenByte(bits) if self.receiving => {
                self.fifo.push_back(0);
                self.fifo_flags |= bits << 1;
                self.end(CRC | 0x10);
            }
            Happening::BrokenByte(_) => {}
            Happening::Taken => match (self.fifo.pop_front(), self.sent.last_mut()) {
                (Some(byte), Some((_, frame))) => frame.push(byte),
                _ => self.fifo_flags |= 0x20,
            },
            Happening::TransmitEnd => {
                self.sending = false;
                self.irqs[MAIN] |= if self.transmit_ends { TXE } else { 0 };
                let steps = u64::from(self.a[0x10]) << 8 | u64::from(self.a[0x11]);
                if self.a[2] & 0x40 != 0 && steps != 0 && self.no_response_ends {
                    self.at(self.now + steps * 6_400 / 1_356, Happening::Irq(TIMER, NRE));
                }
            }
            Happening::Unmask => self.unmasked = true,
            Happening::PowerUpReset => {
                self.reset();
                self.irqs = [0; 4];
            }
        }
    }

    fn end(&mut self, errors: u8) {
        if self.receiving {
            self.receiving = false;
            self.unmasked = !self.end_masks_receiver;
            self.irqs[MAIN] |= RXE;
            self.irqs[ERROR] |= errors;
        }
    }

    pub(crate) fn next(&self) -> Option<u64> {
        self.schedule.first_key_value().map(|((instant, _), _)| *instant)
    }

    /// Makes one transfer with chip select low. It takes 2 µs plus 1 µs per byte (8 MHz).
    pub(crate) fn transfer(&mut self, mosi: &[u8]) -> Vec<u8> {
        self.log.push(mosi.to_vec());
        self.advance(self.now + 2);
        let start = self.now;
        let mut miso = vec![0; mosi.len()];
        if self.miso == Miso::Driven {
            self.answer(mosi, &mut miso);
        } else if self.miso == Miso::StuckHigh {
            miso.fill(0xFF);
        }
        self.advance(start + mosi.len() as u64);
        miso
    }

    fn answer(&mut self, mosi: &[u8], miso: &mut [u8]) {
        let (space, head, first) = match *mosi {
            [0xFB, head, ..] => (1, head, 2),
            [0xFC, head, ..] => (2, head, 2),
            [head, ..] => (0, head, 1),
            [] => return,
        };
        match head {
            0x00..=0x3F => {
                for (index, value) in mosi.iter().enumerate().skip(first) {
                    self.write(space, usize::from(head) + index - first, *value);
                }
            }
            0x40..=0x7F => {
                // A register is read when its own byte begins, because a frame may end between the reads of two
                // registers.
                self.advance(self.now + first as u64);
                for (offset, slot) in miso[first..].iter_mut().enumerate() {
                    *slot = self.read(space, usize::from(head & 0x3F) + offset);
                    self.advance(self.now + 1);
                }
            }
            0x80 => {
                self.needs_oscillator("FIFO load");
                self.fifo.extend(&mosi[1..]);
            }
            0x9F => {
                self.needs_oscillator("FIFO read");
                let mut dry = false;
                for slot in &mut miso[1..] {
                    // A byte leaves the FIFO only when its own clocks come, after the command's byte and the bytes
                    // before it.
                    self.advance(self.now + 1);
                    match self.fifo.pop_front() {
                        Some(byte) => *slot = byte,
                        None => {
                            self.fifo_flags |= 0x20;
                            self.misuse.push("FIFO read beyond its content".into());
                        }
                    }
                    dry |= self.receiving && self.fifo.is_empty();
                }
                if dry {
                    self.misuse.push("FIFO read empty while a frame arrives".into());
                }
            }
            _ => {
                if mosi.len() != 1 {
                    self.misuse.push(format!("command {head:02x} is not alone in its transfer"));
                }
                self.command(head);
            }
        }
    }

    fn needs_oscillator(&mut self, what: &str) {
        if !self.oscillates() {
            self.misuse.push(format!("{what} without oscillator"));
        }
    }

    fn write(&mut self, space: usize, address: usize, value: u8) {
        match (space, address) {
            (0, 0x02) => {
                let starts = value & 0x80 != 0 && self.a[2] & 0x80 == 0;
                if let Some(us) = self.oscillator_us.filter(|_| starts) {
                    self.at(self.now + us, Happening::Irq(MAIN, 0x80));
                }
                self.a[0x31] = self.a[0x31] & !0x20 | (value & 0x08) << 2;
            }
            (0, 0x03) => self.needs_oscillator("mode"),
            (0, 0x26 | 0x27) if self.a[1] & 0x20 == 0 => {
                self.misuse.push("antenna tuning written while aat_en is clear".into());
            }
            (0, 0x2C) if self.a[0x2C] & 0x80 != 0 && value & 0x80 == 0 => self.adjusts = true,
            _ => {}
        }
        self.written.insert((space, address));
        let value = match self.stuck {
            Some((stuck_space, stuck_address, bits)) if (stuck_space, stuck_address) == (space, address) => {
                value ^ bits
            }
            _ => value,
        };
        match space {
            0 => self.a[address] = value,
            1 => self.b[address] = value,
            _ => self.test[address] = value,
        }
    }

    fn read(&mut self, space: usize, address: usize) -> u8 {
        let level = (self.fifo.len() as i32 + self.level_error).clamp(0, 0x3FF) as u16;
        match (space, address) {
            (0, 0x1A..=0x1D) => std::mem::take(&mut self.irqs[address - 0x1A]),
            (0, 0x1E) => level as u8,
            (0, 0x1F) => ((level >> 8) as u8) << 6 | self.fifo_flags,
            (0, 0x3F) => self.identity,
            (0, _) => self.a[address],
            (1, _) => self.b[address],
            _ => self.test[address],
        }
    }

    fn command(&mut self, command: u8) {
        if self.is_busy() && command != 0xC1 {
            self.misuse.push(format!("command {command:02x} before the one before has ended"));
        }
        match command {
            // A reset leaves the interrupt bits set, so the driver must cope with an IRQ pin that is high already.
            0xC1 => self.reset(),
            0xC2 => {
                self.sending = false;
                self.receiving = false;
                self.schedule.retain(|_, what| !matches!(what, Happening::Taken | Happening::TransmitEnd));
            }
            0xC4 if !self.transmits => {}
            0xC4 => {
                if self.a[3] & 0x80 != 0 && self.a[0x31] & 0x40 == 0 {
                    return self.misuse.push("answer without a field".into());
                }
                (self.sending, self.receiving) = (true, false);
                let ntx = usize::from(self.a[0x22]) << 5 | usize::from(self.a[0x23]) >> 3;
                self.sent.push((self.now, vec![]));
                // The time, µs, of preamble, sync and this number of bytes. A bit takes 32 periods of 13.56 MHz.
                let after = |bytes: usize| (48 + 16 + 8 * bytes as u64) * 3_200 / 1_356;
                for byte in 0..ntx {
                    self.at(self.now + after(1 + byte), Happening::Taken);
                }
                self.at(self.now + after(ntx + 3) + 1, Happening::TransmitEnd);
            }
            0xD0 => (self.unmasked, self.receiving) = (false, false),
            0xD1 => self.unmasked = true,
            0xD5 => {}
            0xD6 => {
                self.needs_oscillator("regulator adjustment");
                if !self.adjusts {
                    self.misuse.push("regulators adjusted without reg_s set and cleared before".into());
                }
                self.adjusts = false;
                if (self.a[1] & 0x80 != 0) != (self.supply_mv < 3_600) {
                    self.misuse.push(format!("sup3V is wrong for {} mV", self.supply_mv));
                }
                self.ends(self.regulator_us);
            }
            0xDF => {
                self.needs_oscillator("supply measurement");
                self.a[0x25] = 0;
                let steps = if self.a[0x2C] & 0x07 == 0 { (self.supply_mv * 10 + 117) / 234 } else { 146 };
                if let Some(us) = self.measurement_us {
                    self.at(self.now + us, Happening::Measured(steps.min(255) as u8));
                }
                self.ends(self.measurement_us);
            }
            0xDB => {
                self.fifo.clear();
                self.fifo_flags = 0;
                if self.db_clears_irqs {
                    self.irqs = [0; 4];
                }
            }
            0xEA if self.identity & 0xF8 == 0x30 => {
                self.needs_oscillator("RC calibration");
                self.ends(self.calibration_us);
            }
            other => self.misuse.push(format!("command {other:02x}")),
        }
    }
}

/// Returns the space, the address and the wrong bits of the register that a fault names.
pub(crate) fn told(fault: Fault) -> (usize, usize, u8) {
    let Fault::Register { address, expected, found } = fault else { panic!("{fault:02x?}") };
    (usize::from(address >> 6), usize::from(address & 0x3F), expected ^ found)
}

/// A chip, and the executor that runs a machine against it. The executor has the payload to send and the buffer to
/// fill.
#[derive(Clone, Debug)]
pub(crate) struct Rig {
    pub(crate) chip: Chip,
    pub(crate) payload: Vec<u8>,
    pub(crate) buffer: [u8; BUFFER],
    response: Vec<u8>,
    /// The delay, µs, before the executor answers a wait, as if it were busy.
    pub(crate) lateness: u64,
    pub(crate) transfers: u32,
    pub(crate) outstanding: Step<ListenerEvent>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Given {
    Start,
    Done,
    Irq,
    Timeout,
}

impl Rig {
    pub(crate) fn new(chip: Chip) -> Self {
        Self {
            chip,
            payload: Vec::new(),
            buffer: [0; BUFFER],
            response: Vec::new(),
            lateness: 0,
            transfers: 0,
            outstanding: Step::Event(ListenerEvent::Listening),
        }
    }

    pub(crate) fn carry_out<E>(&mut self, step: Step<E>) -> Given {
        match step {
            Step::Event(_) => Given::Start,
            Step::Transfer(transfer) => {
                self.transfers += 1;
                match transfer {
                    Transfer::Short(short) => self.response = self.chip.transfer(short.bytes()),
                    Transfer::Load { offset, len } => {
                        let mut mosi = vec![0x80];
                        mosi.extend_from_slice(&self.payload[offset..offset + len]);
                        self.chip.transfer(&mosi);
                        self.response.clear();
                    }
                    Transfer::Read { offset, len } => {
                        let mut mosi = vec![0; len + 1];
                        mosi[0] = 0x9F;
                        let miso = self.chip.transfer(&mosi);
                        self.buffer[offset..offset + len].copy_from_slice(&miso[1..]);
                        self.response = miso[1..].to_vec();
                    }
                }
                Given::Done
            }
            Step::Wait { us } => {
                let end = self.chip.now + u64::from(us);
                let given = loop {
                    if self.chip.pin() {
                        break Given::Irq;
                    }
                    match self.chip.next() {
                        Some(instant) if instant < end => self.chip.advance(instant),
                        _ => {
                            self.chip.advance(end);
                            break if self.chip.pin() { Given::Irq } else { Given::Timeout };
                        }
                    }
                };
                self.chip.advance(self.chip.now + self.lateness);
                given
            }
            Step::Delay { us } => {
                self.chip.advance(self.chip.now + u64::from(us));
                Given::Timeout
            }
        }
    }

    pub(crate) fn input(&self, given: Given) -> Input<'_> {
        match given {
            Given::Start => Input::Start,
            Given::Done => Input::Done(&self.response),
            Given::Irq => Input::Irq,
            Given::Timeout => Input::Timeout,
        }
    }

    pub(crate) fn poller(&mut self, machine: &mut Poller, step: Step<PollerEvent>) -> PollerEvent {
        self.run_within(machine, step, 200)
    }

    /// Runs a machine from `step` to its next event, even if that comes only after a listener's silence of one second.
    pub(crate) fn run<M: Machine>(&mut self, machine: &mut M, step: Step<M::Event>) -> M::Event {
        self.run_within(machine, step, 600)
    }

    fn run_within<M: Machine>(&mut self, machine: &mut M, mut step: Step<M::Event>, steps: u32) -> M::Event {
        for _ in 0..steps {
            let given = self.carry_out(step);
            step = machine.step(self.input(given));
            if let Step::Event(event) = step {
                return event;
            }
        }
        panic!("no event within {steps} steps");
    }

    pub(crate) fn poller_next(&mut self, machine: &mut Poller) -> PollerEvent {
        self.poller(machine, Step::Event(PollerEvent::Ready))
    }

    pub(crate) fn send(&mut self, machine: &mut Poller, payload: &[u8]) -> PollerEvent {
        self.payload = payload.to_vec();
        match self.load(machine, payload.len()) {
            PollerEvent::Loaded => self.poller(machine, Step::Transfer(Transfer::Short(Poller::transmit()))),
            other => other,
        }
    }

    pub(crate) fn load(&mut self, machine: &mut Poller, len: usize) -> PollerEvent {
        let step = machine.prepare(len).expect("the poller is ready");
        match self.poller(machine, step) {
            PollerEvent::Prepared => self.poller(machine, Step::Event(PollerEvent::Prepared)),
            other => other,
        }
    }

    /// Runs a listener to its next event, for at most `steps` steps. The next call continues from there.
    pub(crate) fn listener_within(&mut self, machine: &mut Listener, steps: u32) -> Option<ListenerEvent> {
        for _ in 0..steps {
            let given = self.carry_out(self.outstanding);
            self.outstanding = machine.step(self.input(given));
            if let Step::Event(event) = self.outstanding {
                return Some(event);
            }
        }
        None
    }

    pub(crate) fn listener(&mut self, machine: &mut Listener) -> ListenerEvent {
        self.listener_within(machine, 400).expect("an event within 400 steps")
    }

    /// Returns the MOSI bytes of every transfer since the last call, as text.
    pub(crate) fn log(&mut self) -> Vec<String> {
        self.chip
            .log
            .drain(..)
            .map(|bytes| bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" "))
            .collect()
    }

    pub(crate) fn assert_no_misuse(&self) {
        assert_eq!(self.chip.misuse, Vec::<String>::new());
    }
}
