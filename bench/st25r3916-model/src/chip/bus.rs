//! Bytes over SPI: mode bytes, address counting, prefixes, FIFO and passive target memory.
//!
//! | covered | DS13541 |
//! |---|---|
//! | register write and read with counting address, FIFO load (80) and read (9F), passive | 4.3.3 Serial peripheral |
//! | target memory (A0, A8, AC, BF), direct commands, also several in one transfer, spaces | interface |
//! | B (FB) and test (FC) |  |
//! | what is shifted out is taken at the end of the byte before; a read clears an interrupt register at | recorded |
//! | the first clock edge of its own byte (`interrupts`) |  |
//!
//! | left out | why |
//! |---|---|
//! | the I2C interface | strapped to SPI on the boards |

use super::Chip;
use crate::report::{Kind, Space};
use crate::spi::{MAX_HZ, State};

impl Chip {
    /// Begins a transfer at the falling edge of chip select at `now`, virtual ns.
    pub fn select(&mut self, now: u64) {
        self.advance(now);
        let Self { core, spi, .. } = self;
        if !core.powered() {
            return core.note(Kind::NotPowered);
        }
        if spi.selected {
            core.note(Kind::SelectedTwice);
        }
        if spi.hz() > MAX_HZ {
            core.note(Kind::SpiTooFast(spi.hz()));
        }
        spi.selected = true;
        spi.state = State::Mode;
        spi.out = 0;
        spi.last_byte = core.now();
    }

    /// Whether chip select is low.
    pub fn is_selected(&self) -> bool {
        self.spi.selected
    }

    /// Transfers one byte, whose last clock ends at `now` (virtual ns). Returns the byte on MISO, 0 if it is undriven.
    pub fn transfer(&mut self, now: u64, mosi: u8) -> u8 {
        self.advance(now);
        if !self.core.powered() {
            self.core.note(Kind::NotPowered);
            return 0;
        }
        if !self.spi.selected {
            self.core.note(Kind::NotSelected);
            return 0;
        }
        let miso = self.spi.out;
        self.spi.out = 0;
        self.spi.state = match self.spi.state {
            State::Mode => self.mode_byte(mosi),
            State::Prefix(space) => match mosi >> 6 {
                0b00 => State::WriteFirst(space, mosi & 0x3F),
                0b01 => self.read_from(space, mosi & 0x3F),
                _ => {
                    self.core.note(Kind::UnknownModeByte(mosi));
                    State::Ignore
                }
            },
            State::WriteFirst(space, address) | State::Write(space, address) => {
                self.write_register(space, address, mosi);
                State::Write(space, (address + 1) & 0x3F)
            }
            State::Read(space, address) => {
                self.register_was_read(space, address, miso);
                self.read_from(space, (address + 1) & 0x3F)
            }
            State::Load => {
                self.fifo_load(mosi);
                State::Load
            }
            State::ReadFifo(there) => {
                self.fifo_was_read(there);
                self.read_fifo()
            }
            State::LoadTarget(i) => {
                self.core.registers_mut().load_target_memory(i, mosi);
                State::LoadTarget(i.saturating_add(1))
            }
            State::ReadTarget(i) => self.read_target(i.saturating_add(1)),
            State::Ignore => State::Ignore,
        };
        self.spi.last_byte = self.core.now();
        miso
    }

    /// Ends a transfer at the rising edge of chip select at `now`, virtual ns.
    pub fn deselect(&mut self, now: u64) {
        self.advance(now);
        if self.spi.selected && matches!(self.spi.state, State::Prefix(_) | State::WriteFirst(..)) {
            self.core.note(Kind::TransferCutShort);
        }
        if std::mem::take(&mut self.spi.commanded) {
            self.transmits.push(self.core.now());
        }
        self.spi.selected = false;
        self.spi.state = State::Mode;
    }

    /// Returns the instants, virtual ns, at which chip select rose after a transmit command (C4 to C7) since the last
    /// call. This rise is the controller's last influence on the instant of a transmission.
    pub fn take_transmits(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.transmits)
    }

    fn mode_byte(&mut self, byte: u8) -> State {
        match byte {
            0x00..=0x3F => State::WriteFirst(Space::A, byte),
            0x40..=0x7F => self.read_from(Space::A, byte & 0x3F),
            0x80 => State::Load,
            0x9F => self.read_fifo(),
            // A0, A8 and AC load a section of the passive target memory (NFC-A, NFC-F, TSN); BF reads the memory.
            0xA0 => State::LoadTarget(0),
            0xA8 => State::LoadTarget(15),
            0xAC => State::LoadTarget(36),
            0xBF => self.read_target(0),
            0xFB => State::Prefix(Space::B),
            0xFC => State::Prefix(Space::Test),
            0xC0..=0xFF => {
                self.spi.commanded |= matches!(byte, 0xC4..=0xC7);
                self.command(byte);
                State::Mode
            }
            _ => {
                self.core.note(Kind::UnknownModeByte(byte));
                State::Ignore
            }
        }
    }

    fn read_from(&mut self, space: Space, address: u8) -> State {
        if space == Space::A && matches!(address, 0x1E | 0x1F) {
            self.settle();
        }
        self.spi.out = self.peek(space, address);
        State::Read(space, address)
    }

    fn register_was_read(&mut self, space: Space, address: u8, seen: u8) {
        if space == Space::A && (0x1A..=0x1D).contains(&address) {
            let shift = 8 * u32::from(address - 0x1A);
            let at = self.spi.after_first_edge(self.core.now(), self.core.config().irq_fall_ns);
            self.core.interrupts_were_read(u32::from(seen) << shift, at);
        }
        self.register_exists(space, address);
    }

    fn read_fifo(&mut self) -> State {
        self.settle();
        let byte = if self.core.oscillator() { self.fifo.peek(0) } else { None };
        self.spi.out = byte.unwrap_or(0);
        State::ReadFifo(byte.is_some())
    }

    fn read_target(&mut self, i: u8) -> State {
        self.spi.out = self.core.registers().target_memory().get(usize::from(i)).copied().unwrap_or(0);
        State::ReadTarget(i)
    }

    fn fifo_was_read(&mut self, there: bool) {
        let Self { core, fifo, transmitter, receiver, .. } = self;
        if !core.oscillator() {
            core.note(Kind::FifoWithoutOscillator);
        } else if there {
            transmitter.disturb(core);
            fifo.drop_front(1);
            receiver.taken(core, fifo);
        } else {
            fifo.underflow = true;
            core.note(Kind::FifoUnderflow);
        }
    }

    fn fifo_load(&mut self, byte: u8) {
        if !self.core.oscillator() {
            return self.core.note(Kind::FifoWithoutOscillator);
        }
        self.settle();
        if self.fifo.push(byte) {
            self.transmitter.loaded(&mut self.core, &mut self.fifo);
        } else {
            self.core.note(Kind::FifoOverflow);
        }
    }
}
