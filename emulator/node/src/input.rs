//! How something outside acts on a node.

use cortex_m4::Cost;
use emulator_part::{Cycle, Part, Pin, UartFrame};

use super::{Board, Node, View};

impl<B: Board, C: Cost> Node<B, C> {
    /// What is wired around the part, to read.
    #[must_use]
    pub fn board(&self) -> &B {
        &self.side.board
    }

    /// Something outside acts on the board's chips now, or takes out what they collected. The chips may have other
    /// plans afterwards, and the part hears of what they do at this instant.
    pub fn board_mut<T>(&mut self, act: impl FnOnce(&mut B) -> T) -> T {
        let answer = act(&mut self.side.board);
        let at = self.present();
        self.side.settle(at);
        self.side.after(at);
        self.side.stirred = true;
        answer
    }

    /// The microcontroller, to read.
    #[must_use]
    pub fn part(&self) -> &B::Part {
        &self.side.part
    }

    /// Something outside acts on the part now: its pins, a bus, an oscillator. `act` gets the part, what is around it,
    /// and the present cycle.
    pub fn input<T>(&mut self, act: impl FnOnce(&mut B::Part, &mut View<'_, B>, Cycle) -> T) -> T {
        let at = self.present();
        let answer = self.side.with(at, |part, view| act(part, view, at));
        self.side.part.signals().announce();
        self.side.stirred = true;
        answer
    }

    /// Drives `pin` from outside from now on, or lets go of it.
    pub fn drive(&mut self, pin: Pin, level: Option<bool>) {
        self.input(|part, view, at| part.drive(at, pin, level, view));
    }

    /// A UART frame whose start bit begins now arrives at `pin`.
    pub fn receive(&mut self, pin: Pin, frame: UartFrame) {
        self.input(|part, view, at| part.receive(at, pin, frame, view));
    }
}
