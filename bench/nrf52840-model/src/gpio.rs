//! GPIO: P0 and P1 (PS 6.9).
//!
//! | covered | PS |
//! |---|---|
//! | OUT, OUTSET, OUTCLR, DIR, DIRSET, DIRCLR, PIN_CNF with its direction in both places | 6.9 |
//! | IN of a pin whose input buffer is connected; 0 of one whose is not | 6.9 |
//! | pull resistors; DRIVE with its open-drain and open-source settings | 6.9 |
//! | SENSE, LATCH, DETECT and LDETECT across both ports | 6.9 |
//! | a pin taken over by a peripheral | 6.9 |
//!
//! | left out | why |
//! |---|---|
//! | drive strength, slew, analogue input | a level is high or low |
//! | P0.09 and P0.10 as NFC antenna until UICR.NFCPINS says otherwise | NFCT is not modelled and the pins are free |
//! | the waveform of a serial peripheral | bytes cross at their own instants; only chip selects move as pins |
use crate::instance::{Act, Outbox};
use crate::{FindingKind, Pin};

const INPUT_DISCONNECT: u32 = 1 << 1;
/// PIN_CNF after reset: input buffer disconnected.
const PIN_CNF_RESET: u32 = INPUT_DISCONNECT;
/// The bits PIN_CNF has: DIR, INPUT, PULL, DRIVE, SENSE.
const PIN_CNF_MASK: u32 = 0x0003_070F;
/// Pins of each port.
const PORT_PINS: [u32; 2] = [0xFFFF_FFFF, 0x0000_FFFF];

/// Both ports.
#[derive(Debug)]
pub(crate) struct Gpio {
    out: [u32; 2],
    latch: [u32; 2],
    ldetect: [bool; 2],
    cnf: [[u32; 32]; 2],
    /// What drives a pin from outside the part.
    outside: [Option<bool>; 64],
    /// What a peripheral that took the pin over drives.
    held: [Option<bool>; 64],
    levels: u64,
    /// The pads that something drives.
    driven: u64,
    detect: bool,
}

impl Default for Gpio {
    fn default() -> Self {
        Self {
            out: [0; 2],
            latch: [0; 2],
            ldetect: [false; 2],
            cnf: [[PIN_CNF_RESET; 32]; 2],
            outside: [None; 64],
            held: [None; 64],
            levels: 0,
            driven: 0,
            detect: false,
        }
    }
}

impl Gpio {
    pub(crate) fn level(&self, pin: Pin) -> bool {
        self.levels >> pin.index() & 1 != 0
    }

    /// What the part itself drives, if it does: a peripheral's level first, else OUT as DRIVE lets it through.
    fn inside(&self, pin: Pin) -> Option<bool> {
        let (port, n) = pin.place();
        let cnf = self.cnf[port][n as usize];
        self.held[pin.index()].or_else(|| {
            let out = self.out[port] >> n & 1 != 0;
            let disconnected = match cnf >> 8 & 7 {
                4 | 5 => !out,
                6 | 7 => out,
                _ => false,
            };
            (cnf & 1 != 0 && !disconnected).then_some(out)
        })
    }

    pub(crate) fn is_driven(&self, pin: Pin) -> bool {
        self.driven >> pin.index() & 1 != 0
    }

    pub(crate) fn is_driven_from_outside(&self, pin: Pin) -> bool {
        self.outside[pin.index()].is_some()
    }

    /// Resolves the pad, tells whoever listens when it moved, and senses it.
    fn settle(&mut self, pin: Pin, now: u64, out: &mut Outbox) {
        let (port, n) = pin.place();
        let (inside, outside) = (self.inside(pin), self.outside[pin.index()]);
        if let (Some(a), Some(b)) = (inside, outside)
            && a != b
        {
            let what = "an output is driven against from outside, pin";
            out.find(now, FindingKind::Misuse, "GPIO", what, pin.index() as u32);
        }
        let pulled_up = self.cnf[port][n as usize] >> 2 & 3 == 3;
        let level = inside.or(outside).unwrap_or(pulled_up);
        if level != self.level(pin) {
            self.levels ^= 1 << pin.index();
            out.acts.push_back(Act::Pad { pin, level });
        }
        let driven = inside.or(outside).is_some();
        if driven != (self.driven >> pin.index() & 1 != 0) {
            self.driven ^= 1 << pin.index();
            out.acts.push_back(Act::Driven { pin });
        }
        self.sense(out);
    }

    /// The pins of `port` that meet their SENSE criterion.
    fn sensed(&self, port: usize) -> u32 {
        (0..32).filter(|&n| PORT_PINS[port] >> n & 1 != 0).fold(0, |set, n| {
            let cnf = self.cnf[port][n as usize];
            let level = self.level(Pin::of(port, n));
            let met = match cnf >> 16 & 3 {
                2 => level,
                3 => !level,
                _ => false,
            };
            set | u32::from(met && cnf & INPUT_DISCONNECT == 0) << n
        })
    }

    /// LATCH takes up what is sensed, and DETECT follows.
    fn sense(&mut self, out: &mut Outbox) {
        let mut detect = false;
        for port in 0..2 {
            let sensed = self.sensed(port);
            self.latch[port] |= sensed;
            detect |= if self.ldetect[port] { self.latch[port] != 0 } else { sensed != 0 };
        }
        if detect && !self.detect {
            out.acts.push_back(Act::Detect);
        }
        self.detect = detect;
    }

    pub(crate) fn outside(&mut self, pin: Pin, level: Option<bool>, now: u64, out: &mut Outbox) {
        if self.outside[pin.index()] != level {
            self.outside[pin.index()] = level;
            self.settle(pin, now, out);
        }
    }

    pub(crate) fn hold(&mut self, pin: Pin, level: Option<bool>, now: u64, out: &mut Outbox) {
        if self.held[pin.index()] != level {
            self.held[pin.index()] = level;
            self.settle(pin, now, out);
        }
    }

    pub(crate) fn read(&self, offset: u32) -> Option<u32> {
        let (port, offset) = port_of(offset);
        let pins = || (0..32).filter(|&n| PORT_PINS[port] >> n & 1 != 0);
        let dir = || pins().fold(0, |set, n| set | (self.cnf[port][n as usize] & 1) << n);
        Some(match offset {
            0x504 | 0x508 | 0x50C => self.out[port],
            0x510 => pins().fold(0, |set, n| {
                let connected = self.cnf[port][n as usize] & INPUT_DISCONNECT == 0;
                set | u32::from(connected && self.level(Pin::of(port, n))) << n
            }),
            0x514 | 0x518 | 0x51C => dir(),
            0x520 => self.latch[port],
            0x524 => u32::from(self.ldetect[port]),
            0x700..0x780 => self.cnf[port][(offset as usize - 0x700) / 4],
            _ => return None,
        })
    }

    pub(crate) fn write(&mut self, offset: u32, value: u32, now: u64, out: &mut Outbox) {
        let (port, offset) = port_of(offset);
        let mut moved = 0;
        match offset {
            0x504 | 0x508 | 0x50C => {
                let was = self.out[port];
                let next = match offset {
                    0x504 => value,
                    0x508 => was | value,
                    _ => was & !value,
                } & PORT_PINS[port];
                self.out[port] = next;
                moved = was ^ next;
            }
            0x514 | 0x518 | 0x51C => {
                for n in (0..32).filter(|&n| PORT_PINS[port] >> n & 1 != 0) {
                    let bit = value >> n & 1;
                    let cnf = &mut self.cnf[port][n as usize];
                    let was = *cnf & 1;
                    let next = match offset {
                        0x514 => bit,
                        0x518 => was | bit,
                        _ => was & !bit,
                    };
                    *cnf = *cnf & !1 | next;
                    moved |= (was ^ next) << n;
                }
            }
            0x520 => {
                // Writing 1 clears, unless the pin still meets its criterion; DETECT from LATCH drops for that moment.
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
                if PORT_PINS[port] >> n & 1 != 0 {
                    self.cnf[port][n as usize] = value & PIN_CNF_MASK;
                    moved = 1 << n;
                }
            }
            _ => {}
        }
        for n in (0..32).filter(|n| moved >> n & 1 != 0) {
            self.settle(Pin::of(port, n), now, out);
        }
    }

    /// Every register back at its reset value; what drives the pins from outside goes on doing so.
    pub(crate) fn restart(&mut self, now: u64, out: &mut Outbox) {
        let Self { outside, levels, driven, .. } = *self;
        *self = Self { outside, levels, driven, ..Self::default() };
        for (port, pins) in PORT_PINS.into_iter().enumerate() {
            for n in (0..32).filter(|&n| pins >> n & 1 != 0) {
                self.settle(Pin::of(port, n), now, out);
            }
        }
    }
}

/// The port an offset belongs to, and the offset as port 0 has it.
fn port_of(offset: u32) -> (usize, u32) {
    if (0x804..0xA80).contains(&offset) { (1, offset - 0x300) } else { (0, offset) }
}
