//! General purpose I/O, RM0090 chapter 8, and the multiplexer of alternate functions.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `MODER`, `OTYPER`, `PUPDR`, `ODR`, `BSRR`, `AFRL`, `AFRH` | As in 8.4, in every mode, by byte, half-word, word |
//! | `IDR` | The level on the pad; 0 in analog mode, in which the Schmitt trigger is off, 8.3.12 |
//! | `LCKR` | The lock sequence, 8.3.6; the configuration of a locked pin stays until the next reset |
//! | Reset state | JTAG and SWD pins as in 8.3.2 |
//! | Alternate functions | The whole of DS9405's table for the peripherals that are modelled |
//!
//! `registers` handles accesses to the registers, and this module models the pads.
//!
//! An input of a peripheral reads the pad of the pin in alternate mode with that function. If no pin has it, the
//! peripheral's module documents what the peripheral reads.
//!
//! **Left out.** `OSPEEDR` has no effect. There is no delay between a pad and `IDR` (two clocks on silicon). A pin with
//! a function of a peripheral without a model floats and makes a finding.

mod registers;

use cortex_m4::Width;
use emulator_part::{Cycle, FindingKind, Pad, Pin};

use crate::alternate::{EXISTS, NONE, SIGNAL, SIGNAL_OF};
use crate::cx::{Effects, Note, Pads, SIGNALS, Signal, TimPin};

pub(crate) const PORTS: usize = 11;

const NAMES: [&str; PORTS] =
    ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG", "GPIOH", "GPIOI", "GPIOJ", "GPIOK"];

/// The pins of the 144-pin package (DS9405, pin definitions, LQFP144): all of A to G, and PH0 and PH1.
const BONDED: [u16; PORTS] = [0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0x0003, 0, 0, 0];

#[derive(Clone, Debug)]
struct Port {
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u16,
    afr: [u32; 2],
    /// The pins that the lock sequence in LCKR has selected.
    lock: u16,
    lock_step: u8,
    locked: bool,

    signal: [u8; 16],
    /// The pins that ODR drives. This mask and the masks below follow from the configuration.
    output: u16,
    analog: u16,
    open_drain: u16,
    pull_up: u16,
    pull_down: u16,
    /// The pins that a peripheral drives, of those in alternate function mode.
    driven_by_signal: u16,
    signal_level: u16,
    /// The pins that the outside drives.
    outside: u16,
    outside_level: u16,
    /// The pins whose pads the port drives.
    driven: u16,
    pulled: u16,
    level: u16,
}

impl Port {
    fn new(index: usize) -> Self {
        let (moder, ospeedr, pupdr) = match index {
            0 => (0xA800_0000, 0x0C00_0000, 0x6400_0000),
            1 => (0x0000_0280, 0x0000_00C0, 0x0000_0100),
            _ => (0, 0, 0),
        };
        Self {
            moder,
            otyper: 0,
            ospeedr,
            pupdr,
            odr: 0,
            afr: [0; 2],
            lock: 0,
            lock_step: 0,
            locked: false,
            signal: [NONE; 16],
            output: 0,
            analog: 0,
            open_drain: 0,
            pull_up: 0,
            pull_down: 0,
            driven_by_signal: 0,
            signal_level: 0,
            outside: 0,
            outside_level: 0,
            driven: 0,
            pulled: 0,
            level: 0,
        }
    }

    fn mode(&self, pin: usize) -> u32 {
        self.moder >> (2 * pin) & 3
    }

    fn function(&self, pin: usize) -> u32 {
        self.afr[pin / 8] >> (4 * (pin % 8)) & 0xF
    }

    /// The levels on the pins. Driving wins over pulling, and the part over the outside.
    fn levels(&self) -> u16 {
        self.driven & self.level
            | !self.driven & (self.outside & self.outside_level | !self.outside & self.pulled & self.level)
    }

    fn pad(&self, pin: u8) -> Pad {
        let level = self.level >> pin & 1 != 0;
        if self.driven >> pin & 1 != 0 {
            Pad::Driven(level)
        } else if self.pulled >> pin & 1 != 0 {
            Pad::Pulled(level)
        } else {
            Pad::Floating
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Gpio {
    ports: [Port; PORTS],
    /// For each signal, whether its peripheral drives it (bit 1), and the level (bit 0).
    signals: [u8; SIGNALS],
    pub(crate) pads: Pads,
    /// The pins whose [`Pad`] changed and which the part has yet to report.
    pub(crate) changed: Vec<(Pin, Pad)>,
    /// The pins whose level changed, as port and mask.
    pub(crate) levels_changed: Vec<(u8, u16)>,
    pub(crate) inputs: Vec<(Signal, bool)>,
}

pub(crate) fn merge(register: u32, offset: u32, width: Width, value: u32) -> u32 {
    let shift = 8 * (offset & 3);
    let mask = match width {
        Width::Byte => 0xFF_u32,
        Width::Half => 0xFFFF,
        Width::Word => u32::MAX,
    };
    register & !(mask << shift) | (value & mask) << shift
}

pub(crate) fn lane(register: u32, offset: u32, width: Width) -> u32 {
    let value = register >> (8 * (offset & 3));
    match width {
        Width::Byte => value & 0xFF,
        Width::Half => value & 0xFFFF,
        Width::Word => value,
    }
}

/// The mask of pins whose two-bit field in `register` equals `value`.
fn fields(register: u32, value: u32) -> u16 {
    let mut mask = 0;
    for pin in 0..16 {
        mask |= u16::from(register >> (2 * pin) & 3 == value) << pin;
    }
    mask
}

impl Gpio {
    pub(crate) fn new() -> Self {
        let mut gpio = Self {
            ports: std::array::from_fn(Port::new),
            signals: [0; SIGNALS],
            pads: Pads::OPEN,
            changed: Vec::with_capacity(16),
            levels_changed: Vec::with_capacity(16),
            inputs: Vec::with_capacity(16),
        };
        for port in 0..PORTS {
            gpio.configure(port);
        }
        gpio
    }

    /// Carries out a system reset. The outside goes on driving its pins.
    pub(crate) fn reset(&mut self) {
        self.signals = [0; SIGNALS];
        for port in 0..PORTS {
            self.reset_port(port);
        }
    }

    pub(crate) fn reset_port(&mut self, port: usize) {
        let old = &self.ports[port];
        let fresh = Port {
            signal: old.signal,
            outside: old.outside,
            outside_level: old.outside_level,
            driven: old.driven,
            pulled: old.pulled,
            level: old.level,
            ..Port::new(port)
        };
        self.ports[port] = fresh;
        self.configure(port);
    }

    /// Computes connections and masks again after the configuration has changed.
    fn configure(&mut self, port: usize) {
        let p = &mut self.ports[port];
        p.output = fields(p.moder, 1);
        p.analog = fields(p.moder, 3);
        p.open_drain = p.otyper as u16;
        self.pads.open_drain[port] = p.open_drain;
        // Pulls are off in analog mode (RM0090 8.3.12). The reserved value 11 is no pull.
        p.pull_up = fields(p.pupdr, 1) & !p.analog;
        p.pull_down = fields(p.pupdr, 2) & !p.analog;
        let (mut touched, mut count) = ([NONE; 32], 0);
        for pin in 0..16 {
            let signal = if p.mode(pin) == 2 { SIGNAL_OF[port][pin][p.function(pin) as usize] } else { NONE };
            if p.signal[pin] != signal {
                touched[count] = p.signal[pin];
                touched[count + 1] = signal;
                count += 2;
                p.signal[pin] = signal;
            }
        }
        for &signal in &touched[..count] {
            if signal != NONE {
                self.connect(signal);
            }
        }
        self.drive_port(port);
    }

    fn connect(&mut self, signal: u8) {
        let mut pins = [None; 2];
        let mut count = 0;
        for (port, p) in self.ports.iter().enumerate() {
            for (pin, &own) in p.signal.iter().enumerate() {
                if own == signal && count < 2 {
                    pins[count] = Some(Pin::new(port as u8, pin as u8));
                    count += 1;
                }
            }
        }
        let Some(which) = SIGNAL[usize::from(signal)] else { return };
        self.pads.routes[usize::from(signal)] = pins;
        if which == Signal::Tim(2, TimPin::Ch1) {
            self.pads.routes[Signal::Tim(2, TimPin::Etr).index()] = pins;
        }
        if let Some(pin) = pins[0] {
            self.inputs.push((which, self.pads.level(pin)));
        }
    }

    fn drive_port(&mut self, port: usize) {
        let p = &mut self.ports[port];
        (p.driven_by_signal, p.signal_level) = (0, 0);
        for (pin, &signal) in p.signal.iter().enumerate() {
            if signal != NONE {
                let state = u16::from(self.signals[usize::from(signal)]);
                p.driven_by_signal |= (state >> 1) << pin;
                p.signal_level |= (state & 1) << pin;
            }
        }
    }

    pub(crate) fn signal(&mut self, signal: Signal, level: Option<bool>, now: Cycle, out: &mut Effects) {
        let state = level.map_or(0, |level| 2 | u8::from(level));
        if std::mem::replace(&mut self.signals[signal.index()], state) == state {
            return;
        }
        let index = signal.index() as u8;
        for port in 0..PORTS {
            if self.ports[port].signal.contains(&index) {
                self.drive_port(port);
                self.settle(port, now, None, out);
            }
        }
    }

    pub(crate) fn release(&mut self, range: std::ops::Range<usize>, now: Cycle, out: &mut Effects) {
        for index in range {
            if self.signals[index] != 0
                && let Some(signal) = SIGNAL[index]
            {
                self.signal(signal, None, now, out);
            }
        }
    }

    pub(crate) fn drive(&mut self, pin: Pin, level: Option<bool>, now: Cycle, out: &mut Effects) {
        let Some(p) = self.ports.get_mut(usize::from(pin.port)) else { return };
        let bit = 1_u16 << (pin.number & 15);
        p.outside &= !bit;
        p.outside_level &= !bit;
        if let Some(high) = level {
            p.outside |= bit;
            if high {
                p.outside_level |= bit;
            }
        }
        self.settle(usize::from(pin.port), now, None, out);
    }

    /// Computes the pads of a port and their levels after any change.
    #[inline]
    pub(crate) fn settle(&mut self, port: usize, now: Cycle, pc: Option<u32>, out: &mut Effects) {
        let p = &mut self.ports[port];
        let active = p.output | p.driven_by_signal;
        let wanted = p.output & p.odr | p.driven_by_signal & p.signal_level;
        let driven = active & !(p.open_drain & wanted);
        let pulled = (p.pull_up | p.pull_down) & !driven;
        let level = driven & wanted | pulled & p.pull_up;
        let moved = (driven ^ p.driven) | (pulled ^ p.pulled) | (level ^ p.level);
        (p.driven, p.pulled, p.level) = (driven, pulled, level);
        let mut rest = moved;
        while rest != 0 {
            let pin = rest.trailing_zeros() as u8;
            rest &= rest - 1;
            let pad = p.pad(pin);
            self.changed.push((Pin::new(port as u8, pin), pad));
        }
        let levels = p.levels();
        let against = driven & p.outside & (level ^ p.outside_level) & !p.open_drain;
        if against != 0 {
            out.notes.push(Note {
                kind: FindingKind::Misuse,
                at: now,
                pc,
                place: NAMES[port],
                text: "a pin is driven against what drives it from outside, mask",
                value: Some(u32::from(against)),
            });
        }
        let before = self.pads.levels[port];
        if levels == before {
            return;
        }
        self.pads.levels[port] = levels;
        let mut edges = levels ^ before;
        self.levels_changed.push((port as u8, edges));
        while edges != 0 {
            let pin = edges.trailing_zeros() as u8;
            edges &= edges - 1;
            let signal = p.signal[usize::from(pin)];
            if signal == NONE {
                continue;
            }
            let here = Some(Pin::new(port as u8, pin));
            if let Some(signal) = SIGNAL[usize::from(signal)]
                && self.pads.pins(signal)[0] == here
            {
                let high = levels >> pin & 1 != 0;
                self.inputs.push((signal, high));
                if signal == Signal::Tim(2, TimPin::Ch1) {
                    self.inputs.push((Signal::Tim(2, TimPin::Etr), high));
                }
            }
        }
    }

    /// Reports settings of a port that have no effect on this part.
    fn look(&self, port: usize, now: Cycle, pc: Option<u32>, out: &mut Effects) {
        let p = &self.ports[port];
        let mut find = |kind, text, pin: usize| {
            out.notes.push(Note { kind, at: now, pc, place: NAMES[port], text, value: Some(pin as u32) });
        };
        for pin in 0..16 {
            let mode = p.mode(pin);
            if mode != 0 && mode != 3 && BONDED[port] >> pin & 1 == 0 {
                find(FindingKind::Misuse, "the package does not bring this pin out:", pin);
            }
            let function = p.function(pin);
            // AF0 is no finding, because a driver may set the mode before the function.
            if mode != 2 || function == 0 || SIGNAL_OF[port][pin][function as usize] != NONE {
                continue;
            }
            if function == 15 || EXISTS[port][pin] >> function & 1 != 0 {
                find(FindingKind::Unmodelled, "the alternate function of this pin is not modelled:", pin);
            } else {
                find(FindingKind::Misuse, "this pin has no such alternate function:", pin);
            }
        }
    }

    pub(crate) fn level(&self, pin: Pin) -> bool {
        self.pads.level(pin)
    }

    pub(crate) fn pad(&self, pin: Pin) -> Pad {
        self.ports.get(usize::from(pin.port)).map_or(Pad::Floating, |port| port.pad(pin.number & 15))
    }

    pub(crate) fn signal_of(&self, pin: Pin) -> Option<Signal> {
        let port = self.ports.get(usize::from(pin.port))?;
        let signal = port.signal[usize::from(pin.number & 15)];
        if signal == NONE { None } else { SIGNAL[usize::from(signal)] }
    }

    pub(crate) fn settle_all(&mut self, now: Cycle, out: &mut Effects) {
        for port in 0..PORTS {
            self.settle(port, now, None, out);
        }
    }
}
