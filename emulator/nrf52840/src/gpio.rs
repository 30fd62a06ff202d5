//! GPIO: P0 and P1 (PS 6.9).
//!
//! | covered | PS |
//! |---|---|
//! | OUT, OUTSET, OUTCLR, DIR, DIRSET, DIRCLR, PIN_CNF with its direction in both places | 6.9 |
//! | IN of a pin with a connected input buffer; a pin without one reads 0 | 6.9 |
//! | pull resistors; DRIVE with its open-drain and open-source settings | 6.9 |
//! | SENSE, LATCH, DETECT and LDETECT across both ports | 6.9 |
//! | a pin taken over by a peripheral | 6.9 |
//!
//! | left out | why |
//! |---|---|
//! | drive strength, slew rate | a level is either high or low |
//! | P0.09 and P0.10 as NFC antenna until UICR.NFCPINS frees them | NFCT is not modelled, and the pins are free |
//! | the waveform of a serial peripheral | a frame crosses at its own instant; only chip selects move as pins |
//!
//! A peripheral reads a pin through the input buffer that IN uses, and reads 0 if PIN_CNF disconnects the buffer. This
//! is assumed: the PS only demands direction "Input" in each peripheral's table of pins, and Nordic's drivers connect
//! the buffer.
use crate::act::{Act, Outbox};
use crate::pin::Pin;
use emulator_part::{Cycle, FindingKind, Pad};

const INPUT_DISCONNECT: u32 = 1 << 1;
/// PIN_CNF after a reset: the input buffer is disconnected.
const PIN_CNF_RESET: u32 = INPUT_DISCONNECT;
/// The bits of PIN_CNF: DIR, INPUT, PULL, DRIVE, SENSE.
const PIN_CNF_MASK: u32 = 0x0003_070F;
const PORT_PINS: [u32; 2] = [0xFFFF_FFFF, 0x0000_FFFF];

#[derive(Clone, Debug)]
pub(crate) struct Gpio {
    out: [u32; 2],
    latch: [u32; 2],
    ldetect: [bool; 2],
    cnf: [[u32; 32]; 2],
    /// For each port, the pins whose direction in PIN_CNF is output.
    dir: [u32; 2],
    connected: [u32; 2],
    senses_high: [u32; 2],
    senses_low: [u32; 2],
    outside: [Option<bool>; 64],
    /// For each pin that a peripheral has taken over, the level that the peripheral drives.
    held: [Option<bool>; 64],
    levels: [u32; 2],
    pads: [Pad; 64],
    detect: bool,
}

impl Default for Gpio {
    fn default() -> Self {
        Self {
            out: [0; 2],
            latch: [0; 2],
            ldetect: [false; 2],
            cnf: [[PIN_CNF_RESET; 32]; 2],
            dir: [0; 2],
            connected: [0; 2],
            senses_high: [0; 2],
            senses_low: [0; 2],
            outside: [None; 64],
            held: [None; 64],
            levels: [0; 2],
            pads: [Pad::Floating; 64],
            detect: false,
        }
    }
}

impl Gpio {
    #[inline]
    pub(crate) fn level(&self, pin: Pin) -> bool {
        let (port, n) = pin.place();
        self.levels[port] >> n & 1 != 0
    }

    #[inline]
    pub(crate) fn is_output(&self, pin: Pin) -> bool {
        let (port, n) = pin.place();
        self.dir[port] >> n & 1 != 0
    }

    #[inline]
    pub(crate) fn is_connected(&self, pin: Pin) -> bool {
        let (port, n) = pin.place();
        self.connected[port] >> n & 1 != 0
    }

    /// Returns the level of a pin as a peripheral reads it: 0 without an input buffer.
    #[inline]
    pub(crate) fn input(&self, pin: Pin) -> bool {
        self.is_connected(pin) && self.level(pin)
    }

    pub(crate) fn detects(&self) -> bool {
        self.detect
    }

    /// The level to which the part drives the pin, if any: a peripheral's level, or else OUT as DRIVE allows.
    fn inside(&self, pin: Pin) -> Option<bool> {
        let (port, n) = pin.place();
        self.held[pin.index()].or_else(|| {
            let out = self.out[port] >> n & 1 != 0;
            let disconnected = match self.cnf[port][n as usize] >> 8 & 7 {
                4 | 5 => !out,
                6 | 7 => out,
                _ => false,
            };
            (self.is_output(pin) && !disconnected).then_some(out)
        })
    }

    pub(crate) fn is_driven_from_outside(&self, pin: Pin) -> bool {
        self.outside[pin.index()].is_some()
    }

    /// Computes the level of a pin's pad, reports a change of the pad, and updates whether the pin meets its SENSE
    /// criterion.
    fn settle(&mut self, pin: Pin, now: Cycle, out: &mut Outbox) {
        let (port, n) = pin.place();
        let (inside, outside) = (self.inside(pin), self.outside[pin.index()]);
        if let (Some(a), Some(b)) = (inside, outside)
            && a != b
        {
            let what = "an output is driven against from outside, pin";
            out.find(now, FindingKind::Misuse, "GPIO", what, pin.index() as u32);
        }
        let pad = match (inside, self.cnf[port][n as usize] >> 2 & 3) {
            (Some(level), _) => Pad::Driven(level),
            (None, 1) => Pad::Pulled(false),
            (None, 3) => Pad::Pulled(true),
            (None, _) => Pad::Floating,
        };
        if pad != self.pads[pin.index()] {
            self.pads[pin.index()] = pad;
            out.acts.push_back(Act::Pad { pin, pad });
        }
        let level = inside.or(outside).unwrap_or(pad.level());
        if level != self.level(pin) {
            self.levels[port] ^= 1 << n;
            out.acts.push_back(Act::Level { pin, level });
        }
        self.sense(out);
    }

    /// Sets LATCH from the pins that meet their criterion, and updates DETECT.
    #[inline]
    fn sense(&mut self, out: &mut Outbox) {
        let mut detect = false;
        for port in 0..2 {
            let levels = self.levels[port];
            let met = levels & self.senses_high[port] | !levels & self.senses_low[port];
            let sensed = met & self.connected[port];
            self.latch[port] |= sensed;
            detect |= if self.ldetect[port] { self.latch[port] != 0 } else { sensed != 0 };
        }
        if detect && !self.detect {
            out.acts.push_back(Act::Detect);
        }
        self.detect = detect;
    }

    pub(crate) fn outside(&mut self, pin: Pin, level: Option<bool>, now: Cycle, out: &mut Outbox) {
        if self.outside[pin.index()] != level {
            self.outside[pin.index()] = level;
            self.settle(pin, now, out);
        }
    }

    pub(crate) fn hold(&mut self, pin: Pin, level: Option<bool>, now: Cycle, out: &mut Outbox) {
        if self.held[pin.index()] != level {
            self.held[pin.index()] = level;
            self.settle(pin, now, out);
        }
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        let (port, offset) = port_of(offset);
        Some(match offset {
            0x504 | 0x508 | 0x50C => self.out[port],
            0x510 => self.levels[port] & self.connected[port],
            0x514 | 0x518 | 0x51C => self.dir[port],
            0x520 => self.latch[port],
            0x524 => u32::from(self.ldetect[port]),
            0x700..0x780 => {
                let n = (offset - 0x700) / 4;
                self.cnf[port][n as usize] & !1 | self.dir[port] >> n & 1
            }
            _ => return None,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: Cycle, out: &mut Outbox) {
        let (port, offset) = port_of(offset);
        let written = |was: u32, register: u32| match register {
            0 => value & PORT_PINS[port],
            1 => was | value & PORT_PINS[port],
            _ => was & !value,
        };
        let mut moved = 0;
        match offset {
            0x504 | 0x508 | 0x50C => {
                let was = self.out[port];
                self.out[port] = written(was, (offset - 0x504) / 4);
                moved = was ^ self.out[port];
            }
            0x514 | 0x518 | 0x51C => {
                let was = self.dir[port];
                self.dir[port] = written(was, (offset - 0x514) / 4);
                moved = was ^ self.dir[port];
            }
            0x520 => {
                // A written 1 clears a latch. If the pin still meets its criterion, DETECT goes low for a moment and
                // the latch is set again.
                self.latch[port] &= !value;
                if self.ldetect[port] {
                    self.detect = false;
                }
                self.sense(out);
            }
            0x524 => {
                self.ldetect[port] = value & 1 != 0;
                self.sense(out);
            }
            0x700..0x780 => {
                let n = (offset - 0x700) / 4;
                let bit = 1 << n;
                if PORT_PINS[port] & bit != 0 {
                    self.cnf[port][n as usize] = value & PIN_CNF_MASK;
                    let put = |set: &mut u32, on: bool| *set = if on { *set | bit } else { *set & !bit };
                    put(&mut self.dir[port], value & 1 != 0);
                    put(&mut self.connected[port], value & INPUT_DISCONNECT == 0);
                    put(&mut self.senses_high[port], value >> 16 & 3 == 2);
                    put(&mut self.senses_low[port], value >> 16 & 3 == 3);
                    moved = bit;
                }
            }
            _ => {}
        }
        while moved != 0 {
            let n = moved.trailing_zeros();
            moved &= moved - 1;
            self.settle(Pin::of(port, n), now, out);
        }
    }

    /// Resets every register. Levels that are driven from outside stay.
    pub(crate) fn restart(&mut self, now: Cycle, out: &mut Outbox) {
        let Self { outside, levels, pads, .. } = *self;
        *self = Self { outside, levels, pads, ..Self::default() };
        self.settle_all(now, out);
    }

    pub(crate) fn let_go(&mut self, now: Cycle, out: &mut Outbox) {
        self.held = [None; 64];
        self.settle_all(now, out);
    }

    fn settle_all(&mut self, now: Cycle, out: &mut Outbox) {
        for (port, pins) in PORT_PINS.into_iter().enumerate() {
            for n in (0..32).filter(|&n| pins >> n & 1 != 0) {
                self.settle(Pin::of(port, n), now, out);
            }
        }
    }
}

/// Returns the port to which an offset belongs, and the offset of the same register in port 0.
#[inline]
fn port_of(offset: u32) -> (usize, u32) {
    if (0x804..0xA80).contains(&offset) { (1, offset - 0x300) } else { (0, offset) }
}
