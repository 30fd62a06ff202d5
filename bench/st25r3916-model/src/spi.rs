//! The SPI slave: mode bytes, address counting, prefixes.
//!
//! | covered | DS13541 |
//! |---|---|
//! | register write and read with counting address, FIFO load (80) and read (9F), passive | 4.3.3 Serial peripheral |
//! | target memory (A0, A8, AC, BF), direct commands, also several in one transfer, spaces | interface |
//! | B (FB) and test (FC) |  |
//! | what is shifted out is taken at the end of the byte before; a read clears an interrupt register at | recorded |
//! | the first clock edge of its own byte (`irq_pin`) |  |
//!
//! | left out | why |
//! |---|---|
//! | the I2C interface | strapped to SPI on the boards |
//! | bits: bytes are whole | a controller that stops inside a byte is not among those modelled |

use crate::Chip;
use crate::report::{Kind, Space};

/// The part's highest SPI clock, Hz.
const MAX_HZ: u32 = 10_000_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// The next byte is a mode byte.
    #[default]
    Mode,
    /// A prefix came: the next byte is a register mode byte of that space.
    Prefix(Space),
    /// A write's address came, its first value has not.
    WriteFirst(Space, u8),
    Write(Space, u8),
    Read(Space, u8),
    Load,
    /// True when a byte was there to be shifted out.
    ReadFifo(bool),
    LoadTarget(u8),
    ReadTarget(u8),
    /// The rest of the transfer means nothing.
    Ignore,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Spi {
    selected: bool,
    state: State,
    /// What the next byte shifts out.
    out: u8,
    /// The controller's clock, Hz; 0 when it was not told.
    pub(crate) hz: u32,
    /// End of the last byte, or the fall of chip select, ns.
    pub(crate) last_byte: u64,
}

impl Chip {
    /// Chip select goes low.
    pub fn select(&mut self, now: u64) {
        self.advance(now);
        if !self.powered {
            return self.note(Kind::NotPowered);
        }
        if self.spi.selected {
            self.note(Kind::SelectedTwice);
        }
        if self.spi.hz > MAX_HZ {
            self.note(Kind::SpiTooFast(self.spi.hz));
        }
        self.spi.selected = true;
        self.spi.state = State::Mode;
        self.spi.out = 0;
        self.spi.last_byte = self.now;
    }

    /// Eight clocks, the last of them ending at `now` (half a period after its falling edge): takes `mosi`, returns
    /// what was shifted out meanwhile. 0 where the part drives nothing.
    pub fn transfer(&mut self, now: u64, mosi: u8) -> u8 {
        self.advance(now);
        if !self.powered {
            self.note(Kind::NotPowered);
            return 0;
        }
        if !self.spi.selected {
            self.note(Kind::NotSelected);
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
                    self.note(Kind::UnknownModeByte(mosi));
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
                if let Some(cell) = self.pt_memory.get_mut(usize::from(i)) {
                    *cell = mosi;
                }
                State::LoadTarget(i.saturating_add(1))
            }
            State::ReadTarget(i) => self.read_target(i.saturating_add(1)),
            State::Ignore => State::Ignore,
        };
        self.spi.last_byte = self.now;
        miso
    }

    /// Chip select goes high.
    pub fn deselect(&mut self, now: u64) {
        self.advance(now);
        if self.spi.selected && matches!(self.spi.state, State::Prefix(_) | State::WriteFirst(..)) {
            self.note(Kind::TransferCutShort);
        }
        self.spi.selected = false;
        self.spi.state = State::Mode;
    }

    /// The SPI clock the controller uses, Hz; above 10 MHz is reported at each transfer. It also tells when in a byte
    /// the IRQ pin falls ([`Chip::take_irq_edges`]).
    pub fn spi_clock_hz(&mut self, hz: u32) {
        self.spi.hz = hz;
    }

    /// Fewer than eight clocks, `bits` of them, the last ending at `now`: the chip takes whole bytes and loses them.
    pub fn lose_bits(&mut self, now: u64, bits: u8) {
        self.advance(now);
        self.note(Kind::BitsLost(bits));
    }

    /// The controller's clock has not the polarity and phase of the chip's mode 1: bits are sampled one early or late.
    pub fn clocked_in_mode(&mut self, now: u64, mode: u8) {
        self.advance(now);
        if mode != 1 {
            self.note(Kind::WrongSpiMode(mode));
        }
    }

    fn mode_byte(&mut self, byte: u8) -> State {
        match byte {
            0x00..=0x3F => State::WriteFirst(Space::A, byte),
            0x40..=0x7F => self.read_from(Space::A, byte & 0x3F),
            0x80 => State::Load,
            0x9F => self.read_fifo(),
            // Passive target memory: from the NFC-A part, the NFC-F part, the TSN part; read from the start.
            0xA0 => State::LoadTarget(0),
            0xA8 => State::LoadTarget(15),
            0xAC => State::LoadTarget(36),
            0xBF => self.read_target(0),
            0xFB => State::Prefix(Space::B),
            0xFC => State::Prefix(Space::Test),
            0xC0..=0xFF => {
                self.command(byte);
                State::Mode
            }
            _ => {
                self.note(Kind::UnknownModeByte(byte));
                State::Ignore
            }
        }
    }

    fn read_from(&mut self, space: Space, address: u8) -> State {
        if space == Space::A && matches!(address, 0x1E | 0x1F) {
            self.settle();
        }
        self.spi.out = self.register(space, address);
        State::Read(space, address)
    }

    fn read_fifo(&mut self) -> State {
        self.settle();
        let byte = if self.osc_ok { self.fifo.peek(0) } else { None };
        self.spi.out = byte.unwrap_or(0);
        State::ReadFifo(byte.is_some())
    }

    fn read_target(&mut self, i: u8) -> State {
        self.spi.out = self.pt_memory.get(usize::from(i)).copied().unwrap_or(0);
        State::ReadTarget(i)
    }

    fn fifo_was_read(&mut self, there: bool) {
        if !self.osc_ok {
            self.note(Kind::FifoWithoutOscillator);
        } else if there {
            self.fifo_take();
        } else {
            self.fifo.underflow = true;
            self.note(Kind::FifoUnderflow);
        }
    }

    fn fifo_load(&mut self, byte: u8) {
        if !self.osc_ok {
            return self.note(Kind::FifoWithoutOscillator);
        }
        self.settle();
        if self.fifo.push(byte) {
            self.fifo_loaded();
        } else {
            self.note(Kind::FifoOverflow);
        }
    }
}
