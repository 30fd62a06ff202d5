//! A receiver on I2C, which u-blox calls DDC.
//!
//! | rule | source |
//! |---|---|
//! | Address 0x42, fast mode, at most 400 kHz, the clock is stretched for 20 ms at most | ZED-F9R data sheet 5.3 |
//! | Registers 0xFD, 0xFE: bytes available, high byte first; 0xFF: the stream, 0xFF when empty | see below |
//! | The register address counts up with each byte read and stays at 0xFF; at start it is 0xFF | see below |
//! | One byte written sets the register address, two or more are data for the receiver | see below |
//!
//! The registers and the forms of access are those of the u-blox integration manuals, "I2C register layout", "Read
//! access types" and "Write access" (ZED-F9P UBX-18010802, NEO-D9S UBX-19026111 and SAM-M10Q UBX-22020019 agree). The
//! manuals call reading any other register "undefined"; in this model it reads 0xFF. The model assumes that the
//! receiver latches the number of available bytes when its high byte is read, because otherwise a message that arrives
//! between the two reads would make the number wrong by 256.

use emulator_part::{I2cAnswer, I2cEvent, Pad, Pin};

use super::{Crossings, Outbox};
use crate::faults::Rng;
use crate::faults::receivers::NOISE_ONE_IN;
use crate::faults::receivers::bus::{BusFault, CLOCKS, GLITCH, STRETCHED};
use emulator_node::Input;

/// The receiver's I2C address, shifted left by one; the lowest bit is the direction.
const ADDRESS: u8 = 0x42 << 1;
/// The shortest permitted duration of a byte, ns: nine bits at 400 kHz, less 1 % for rounding.
const SHORTEST_BYTE: u64 = 22_270;

const TOO_FAST: &str = "I2C: more than 400 kHz (ZED-F9R data sheet 5.3)";

#[derive(Clone, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The controller writes. The field has the bytes of this transfer so far.
    Written(Vec<u8>),
    Read,
}

#[derive(Clone, Debug)]
struct Failing {
    fault: BusFault,
    rng: Rng,
    clocks: u32,
    glitch_at: u64,
}

#[derive(Clone, Debug)]
pub(super) struct Ddc {
    pub(super) scl: Pin,
    pub(super) sda: Pin,
    pub(super) outbox: Outbox,
    pub(super) crossings: Crossings,
    state: State,
    register: u8,
    /// The number of available bytes, latched when the controller read its high byte.
    available: u16,
    /// The end of the last byte, ns; `None` if the controller has held the clock since the last byte.
    last: Option<u64>,
    /// Whether the controller did not acknowledge the last byte. It must end the transfer then.
    closing: bool,
    failing: Option<Failing>,
    made: [bool; 2],
    /// Whether the receiver holds SCL and SDA low.
    low: [bool; 2],
    /// The levels of SCL and SDA that the part has received last.
    told: [bool; 2],
    glitch_over: u64,
}

impl Ddc {
    pub(super) fn new(scl: Pin, sda: Pin) -> Self {
        Self {
            scl,
            sda,
            outbox: Outbox::default(),
            crossings: Crossings::default(),
            state: State::Idle,
            register: 0xFF,
            available: 0,
            last: None,
            closing: false,
            failing: None,
            made: [true; 2],
            low: [false; 2],
            told: [false; 2],
            glitch_over: u64::MAX,
        }
    }

    pub(super) fn begin_fault(&mut self, now: u64, fault: BusFault, mut rng: Rng) {
        self.crossings.spoil_open();
        let glitch_at = fault.glitches().map_or(u64::MAX, |(least, most)| now + rng.between(least, most));
        match fault {
            BusFault::SdaUntilClocked | BusFault::SdaStuck => self.low[1] = true,
            BusFault::SclStuck => self.low[0] = true,
            _ => {}
        }
        if self.low != [false; 2] {
            self.state = State::Idle;
            self.crossings.end();
        }
        self.failing = Some(Failing { fault, rng, clocks: 0, glitch_at });
    }

    pub(super) fn end_fault(&mut self, fault: BusFault) {
        if self.failing.as_ref().is_some_and(|failing| failing.fault == fault) {
            self.failing = None;
            self.low = [false; 2];
            self.glitch_over = u64::MAX;
            self.crossings.spoil_open();
        }
    }

    fn fails(&self, fault: BusFault) -> bool {
        self.failing.as_ref().is_some_and(|failing| failing.fault == fault)
    }

    fn flips(&mut self) -> u8 {
        match &mut self.failing {
            Some(Failing { fault: BusFault::Noise, rng, .. }) => {
                (0..8).fold(0, |flips, bit| flips | u8::from(rng.one_in(NOISE_ONE_IN)) << bit)
            }
            _ => 0,
        }
    }

    /// Applies an event that ended at `at` (ns). Calls `heard` with each data byte that the receiver accepts.
    pub(super) fn act(
        &mut self,
        at: u64,
        event: I2cEvent,
        mut heard: impl FnMut(u8),
    ) -> (I2cAnswer, Option<&'static str>) {
        let yes = I2cAnswer { acknowledged: true, ..I2cAnswer::NOBODY };
        let before = self.last.replace(at);
        let fast = matches!(event, I2cEvent::Write(_) | I2cEvent::Read(_))
            && before.is_some_and(|before| at.saturating_sub(before) < SHORTEST_BYTE);
        let misuse = fast.then_some(TOO_FAST);
        let answer = match event {
            I2cEvent::Start(address) => {
                self.finish(&mut heard);
                if address & !1 == ADDRESS && !self.fails(BusFault::NoAnswer) && !self.low[0] {
                    self.outbox.read_at = at;
                    self.state = if address & 1 == 0 { State::Written(vec![]) } else { State::Read };
                    if self.fails(BusFault::Stretches) {
                        self.last = Some(at + STRETCHED);
                        I2cAnswer { stretched_ns: STRETCHED, ..yes }
                    } else {
                        yes
                    }
                } else {
                    I2cAnswer::NOBODY
                }
            }
            I2cEvent::Write(byte) => match &mut self.state {
                State::Written(bytes) if !fast => {
                    bytes.push(byte);
                    yes
                }
                _ => I2cAnswer::NOBODY,
            },
            I2cEvent::Read(acknowledged) if self.state == State::Read && !self.closing => {
                let flips = self.flips();
                let data = self.next(at, before.unwrap_or(at), flips) ^ flips;
                self.closing = !acknowledged;
                // The controller may misread a byte that it clocks too fast, or a byte on a failing bus.
                if fast || self.failing.is_some() {
                    self.crossings.spoil();
                }
                I2cAnswer { data: if fast { data >> 1 | 0x80 } else { data }, ..yes }
            }
            I2cEvent::Read(_) => I2cAnswer::NOBODY,
            I2cEvent::Stop => {
                self.finish(&mut heard);
                I2cAnswer::NOBODY
            }
        };
        (answer, misuse)
    }

    /// Returns the next byte of the selected register. The byte's transfer lasts from `before` to `at` (ns).
    fn next(&mut self, at: u64, before: u64, flips: u8) -> u8 {
        let register = self.register;
        self.register = register.saturating_add(1);
        match register {
            0xFD => {
                self.available = u16::try_from(self.outbox.bytes.len()).unwrap_or(u16::MAX);
                (self.available >> 8) as u8
            }
            0xFE => self.available as u8,
            0xFF => self.outbox.take().map_or(0xFF, |(byte, since)| {
                self.crossings.byte(before, at, byte ^ flips, since);
                byte
            }),
            _ => 0xFF,
        }
    }

    fn finish(&mut self, heard: &mut impl FnMut(u8)) {
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Written(bytes) => match bytes[..] {
                [] => {}
                [register] => self.register = register,
                _ => bytes.into_iter().for_each(heard),
            },
            State::Read => {
                // A controller must end a read by leaving the last byte unacknowledged.
                if !std::mem::take(&mut self.closing) {
                    self.crossings.spoil();
                }
                self.crossings.end();
            }
            State::Idle => {}
        }
        self.closing = false;
    }

    pub(super) fn pin(&mut self, pin: Pin, pad: Pad) {
        let Some(line) = [self.scl, self.sda].iter().position(|line| *line == pin) else { return };
        let high = pad != Pad::Driven(false);
        let was = std::mem::replace(&mut self.made[line], high);
        let rose = high && !was;
        if let (0, true, Some(failing)) = (line, rose, &mut self.failing) {
            failing.clocks += 1;
            if failing.fault == BusFault::SdaUntilClocked && failing.clocks >= CLOCKS {
                self.low[1] = false;
            }
        }
    }

    pub(super) fn next_at(&self) -> u64 {
        let glitch = self.failing.as_ref().map_or(u64::MAX, |failing| failing.glitch_at);
        let changed = if self.low == self.told { u64::MAX } else { 0 };
        glitch.min(self.glitch_over).min(changed)
    }

    pub(super) fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) -> bool {
        let mut moved = false;
        if at >= self.glitch_over {
            self.glitch_over = u64::MAX;
            self.low[1] = false;
            moved = true;
        }
        if let Some(failing) = self.failing.as_mut().filter(|failing| at >= failing.glitch_at) {
            let (least, most) = failing.fault.glitches().unwrap_or((u64::MAX, u64::MAX));
            failing.glitch_at = at.saturating_add(failing.rng.between(least, most));
            self.glitch_over = at + GLITCH;
            self.low[1] = true;
            moved = true;
        }
        for (line, pin) in [self.scl, self.sda].into_iter().enumerate() {
            if self.low[line] != self.told[line] {
                self.told[line] = self.low[line];
                inputs.push(Input::Level(pin, Some(!self.low[line])));
                moved = true;
            }
        }
        moved
    }
}
