//! How actors outside a node act on the node.

use cortex_m4::Cost;
use emulator_part::{Cycle, Part, Pin, UartFrame};

use super::{Board, Node, View};

impl<B: Board, C: Cost> Node<B, C> {
    /// The board around the part.
    #[must_use]
    pub fn board(&self) -> &B {
        &self.side.board
    }

    /// Lets `act` change the board's chips, or take their output. The part's pins change at the present instant.
    pub fn board_mut<T>(&mut self, act: impl FnOnce(&mut B) -> T) -> T {
        let answer = act(&mut self.side.board);
        let at = self.present();
        self.side.settle(at);
        self.side.after(at);
        self.side.stirred = true;
        answer
    }

    /// The microcontroller without its core.
    #[must_use]
    pub fn part(&self) -> &B::Part {
        &self.side.part
    }

    /// Lets `act` change the part: its pins, a bus or an oscillator. `act` gets the part, its board, and the present
    /// cycle.
    pub fn input<T>(&mut self, act: impl FnOnce(&mut B::Part, &mut View<'_, B>, Cycle) -> T) -> T {
        let at = self.present();
        let answer = self.side.with(at, |part, view| act(part, view, at));
        self.side.part.signals().announce();
        self.side.stirred = true;
        answer
    }

    /// Drives `pin` from outside (`Some`), or stops driving it (`None`).
    pub fn drive(&mut self, pin: Pin, level: Option<bool>) {
        self.input(|part, view, at| part.drive(at, pin, level, view));
    }

    /// Sends a UART frame to `pin`. Its start bit begins now.
    pub fn receive(&mut self, pin: Pin, frame: UartFrame) {
        self.input(|part, view, at| part.receive(at, pin, frame, view));
    }
}
