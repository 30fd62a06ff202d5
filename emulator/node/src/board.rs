//! What is wired around a microcontroller.
//!
//! A node tells its [`Board`] what the part does to pins and buses ([`emulator_part::Outside`], with instants in
//! nanoseconds). [`Board::settle`] returns what the board's chips do to the part's pins. The node calls
//! [`Board::settle`] after every call that reaches the board and at [`Board::next_event`], and the part gets the result
//! at that same instant.

use std::fmt::Debug;
use std::marker::PhantomData;

use emulator_part::{Cycle, I2cAnswer, I2cEvent, Outside, Pad, Part, Pin, SpiFrame, Timebase, UartFrame};

/// An action of a board on a pin of its part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// The board drives the pin (`Some`) or stops driving it (`None`).
    Level(Pin, Option<bool>),
    /// The board sends a UART frame on the pin. The start bit begins at this instant (ns), at most a frame's length
    /// ago.
    Frame(Pin, u64, UartFrame),
}

/// The chips on a part's buses and the wires between them. Instants are virtual nanoseconds.
pub trait Board: Clone + Debug + Send + 'static {
    /// The board's microcontroller.
    type Part: Part;

    /// Tells the board what the part does to a pin, see [`Outside::pin`].
    fn pin(&mut self, at: u64, pin: Pin, pad: Pad) {
        let _ = (at, pin, pad);
    }

    /// Exchanges an SPI frame, see [`Outside::spi`]. `begins` and `ends` are the frame's instants.
    fn spi(&mut self, begins: u64, ends: u64, frame: &SpiFrame) -> Option<u32> {
        let _ = (begins, ends, frame);
        None
    }

    /// Receives a UART frame of the part, see [`Outside::uart`].
    fn uart(&mut self, at: u64, pin: Pin, frame: &UartFrame) {
        let _ = (at, pin, frame);
    }

    /// Answers an I2C controller, see [`Outside::i2c`].
    fn i2c(&mut self, at: u64, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer {
        let _ = (at, scl, sda, event);
        I2cAnswer::NOBODY
    }

    /// Returns the voltage on a pin in microvolts, see [`Outside::microvolts`].
    fn microvolts(&self, at: u64, pin: Pin) -> i32 {
        let _ = (at, pin);
        0
    }

    /// The instant (ns) at which a chip of the board next acts by itself, `u64::MAX` for never. At that instant the
    /// node calls [`Board::settle`]. After that call this function must return a later instant.
    fn next_event(&self) -> u64 {
        u64::MAX
    }

    /// Lets the chips act up to the instant `at`, and adds the changes of the part's pins to `inputs`.
    fn settle(&mut self, at: u64, inputs: &mut Vec<Input>) {
        let _ = (at, inputs);
    }

    /// Whether the board has output that the owner of the node must take. If so, [`super::Node::advance`] returns at
    /// once.
    fn outgoing(&self) -> bool {
        false
    }
}

/// A board with nothing around its part: every pin is open, and every bus is empty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bare<P>(PhantomData<P>);

impl<P> Bare<P> {
    /// Makes a board with nothing on it.
    #[must_use]
    pub const fn new() -> Self {
        Self(PhantomData)
    }
}

impl<P: Part> Board for Bare<P> {
    type Part = P;
}

/// A board from the view of its part: an [`Outside`] that converts the part's cycles into nanoseconds.
#[derive(Debug)]
pub struct View<'a, B> {
    pub(super) board: &'a mut B,
    pub(super) time: &'a Timebase,
    /// Whether the part has acted on the board since this flag was cleared.
    pub(super) touched: &'a mut bool,
}

impl<B: Board> Outside for View<'_, B> {
    fn pin(&mut self, at: Cycle, pin: Pin, pad: Pad) {
        *self.touched = true;
        self.board.pin(self.time.ns(at), pin, pad);
    }

    fn spi(&mut self, frame: &SpiFrame) -> Option<u32> {
        *self.touched = true;
        self.board.spi(self.time.ns(frame.begins), self.time.ns(frame.ends), frame)
    }

    fn uart(&mut self, at: Cycle, pin: Pin, frame: &UartFrame) {
        *self.touched = true;
        self.board.uart(self.time.ns(at), pin, frame);
    }

    fn i2c(&mut self, at: Cycle, scl: Pin, sda: Pin, event: I2cEvent) -> I2cAnswer {
        *self.touched = true;
        self.board.i2c(self.time.ns(at), scl, sda, event)
    }

    fn microvolts(&self, at: Cycle, pin: Pin) -> i32 {
        self.board.microvolts(self.time.ns(at), pin)
    }
}
