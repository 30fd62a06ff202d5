//! A node, and a run of one firmware, of any part, board and clock behind one type.

use cortex_m4::{Cost, Register, Scheduled, Watchpoint};
use emulator_part::{Part, Pin, Pins};

use super::{Board, Error, Event, FromOutside, Halt, Node, Outcome, Resume, Running, Stack, Usage};

/// A [`Node`] of any board and clock. The methods are those of the node.
pub trait AnyNode {
    /// The pins of the part.
    fn pins(&self) -> Pins;
    /// See [`Node::core_register`].
    fn core_register(&self, register: Register) -> u32;
    /// See [`Node::set_core_register`].
    fn set_core_register(&mut self, register: Register, value: u32);
    /// See [`Node::peek`].
    fn peek(&self, address: u32, to: &mut [u8]) -> usize;
    /// See [`Node::poke`].
    ///
    /// # Errors
    ///
    /// Returns the errors of [`Node::poke`].
    fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), Error>;
    /// See [`Node::halted`].
    fn halted(&self) -> Option<Halt>;
    /// See [`Node::halt`].
    fn halt(&mut self);
    /// See [`Node::resume`].
    fn resume(&mut self, how: Resume);
    /// See [`Node::set_breakpoint`].
    fn set_breakpoint(&mut self, address: u32);
    /// See [`Node::clear_breakpoint`].
    fn clear_breakpoint(&mut self, address: u32) -> bool;
    /// See [`Node::set_watchpoint`].
    fn set_watchpoint(&mut self, watchpoint: Watchpoint);
    /// See [`Node::clear_watchpoint`].
    fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool;
    /// See [`Node::halt_after_reset`].
    fn halt_after_reset(&mut self, on: bool);
    /// See [`Node::halt_at_end`].
    fn halt_at_end(&mut self, on: bool);
    /// See [`Node::restart`].
    fn restart(&mut self, why: FromOutside);
    /// See [`Node::now`].
    fn now(&self) -> u64;
    /// See [`Node::instructions`].
    fn instructions(&self) -> u64;
    /// See [`Node::doing`].
    fn doing(&self) -> String;
    /// The number of the exception of the part's interrupt called `name`, see [`Part::exception`].
    fn exception(&self, name: &str) -> Option<u16>;
    /// The names of the part's interrupts, see [`Part::INTERRUPTS`].
    fn interrupts(&self) -> &'static [&'static str];
    /// See [`Node::exceptions_of`].
    fn exceptions_of(&self, handler: &str) -> Vec<u16>;
    /// See [`Node::has_handler`].
    fn has_handler(&self, exception: u16) -> bool;
    /// See [`Node::exception_priority`].
    fn exception_priority(&mut self, exception: u16) -> i16;
    /// See [`Node::watch_tasks`].
    fn watch_tasks(&mut self, on: bool);
    /// See [`Node::take_tasks`].
    fn take_tasks(&mut self) -> Vec<(u64, u16)>;
    /// See [`Node::take_sleeps`].
    fn take_sleeps(&mut self) -> Vec<(u64, bool)>;
    /// See [`Node::watch_schedule`].
    fn watch_schedule(&mut self, on: bool);
    /// See [`Node::take_schedule`].
    fn take_schedule(&mut self) -> Vec<(u64, Scheduled)>;
    /// See [`Node::usage`].
    fn usage(&self) -> Usage;
    /// See [`Node::stack`].
    fn stack(&self) -> Option<Stack>;
    /// See [`Node::stack_touched`].
    fn stack_touched(&self, stack: Stack, guard: u32) -> usize;
    /// See [`Node::exit_status`].
    fn exit_status(&self) -> Option<u32>;
    /// See [`Node::pin`].
    fn pin(&self, pin: Pin) -> bool;
    /// See [`Node::drive`].
    fn drive(&mut self, pin: Pin, level: Option<bool>);
}

impl<B: Board, C: Cost> AnyNode for Node<B, C> {
    fn pins(&self) -> Pins {
        B::Part::PINS
    }

    fn core_register(&self, register: Register) -> u32 {
        self.core_register(register)
    }

    fn set_core_register(&mut self, register: Register, value: u32) {
        self.set_core_register(register, value);
    }

    fn peek(&self, address: u32, to: &mut [u8]) -> usize {
        self.peek(address, to)
    }

    fn poke(&mut self, address: u32, from: &[u8]) -> Result<(), Error> {
        self.poke(address, from)
    }

    fn halted(&self) -> Option<Halt> {
        self.halted()
    }

    fn halt(&mut self) {
        self.halt();
    }

    fn resume(&mut self, how: Resume) {
        self.resume(how);
    }

    fn set_breakpoint(&mut self, address: u32) {
        self.set_breakpoint(address);
    }

    fn clear_breakpoint(&mut self, address: u32) -> bool {
        self.clear_breakpoint(address)
    }

    fn set_watchpoint(&mut self, watchpoint: Watchpoint) {
        self.set_watchpoint(watchpoint);
    }

    fn clear_watchpoint(&mut self, watchpoint: Watchpoint) -> bool {
        self.clear_watchpoint(watchpoint)
    }

    fn halt_after_reset(&mut self, on: bool) {
        self.halt_after_reset(on);
    }

    fn halt_at_end(&mut self, on: bool) {
        self.halt_at_end(on);
    }

    fn restart(&mut self, why: FromOutside) {
        self.restart(why);
    }

    fn now(&self) -> u64 {
        self.now()
    }

    fn instructions(&self) -> u64 {
        self.instructions()
    }

    fn doing(&self) -> String {
        self.doing()
    }

    fn exception(&self, name: &str) -> Option<u16> {
        B::Part::exception(name)
    }

    fn interrupts(&self) -> &'static [&'static str] {
        B::Part::INTERRUPTS
    }

    fn exceptions_of(&self, handler: &str) -> Vec<u16> {
        self.exceptions_of(handler)
    }

    fn has_handler(&self, exception: u16) -> bool {
        self.has_handler(exception)
    }

    fn exception_priority(&mut self, exception: u16) -> i16 {
        self.exception_priority(exception)
    }

    fn watch_tasks(&mut self, on: bool) {
        self.watch_tasks(on);
    }

    fn take_tasks(&mut self) -> Vec<(u64, u16)> {
        self.take_tasks()
    }

    fn take_sleeps(&mut self) -> Vec<(u64, bool)> {
        self.take_sleeps()
    }

    fn watch_schedule(&mut self, on: bool) {
        self.watch_schedule(on);
    }

    fn take_schedule(&mut self) -> Vec<(u64, Scheduled)> {
        self.take_schedule()
    }

    fn usage(&self) -> Usage {
        self.usage()
    }

    fn stack(&self) -> Option<Stack> {
        self.stack()
    }

    fn stack_touched(&self, stack: Stack, guard: u32) -> usize {
        self.stack_touched(stack, guard)
    }

    fn exit_status(&self) -> Option<u32> {
        self.exit_status()
    }

    fn pin(&self, pin: Pin) -> bool {
        self.pin(pin)
    }

    fn drive(&mut self, pin: Pin, level: Option<bool>) {
        self.drive(pin, level);
    }
}

/// A run of one firmware alone on one board, of any part and clock: [`Running`]. [`super::Target::start`] makes it.
pub trait AnyRun {
    /// See [`Running::go`].
    fn go(&mut self, event: &mut dyn FnMut(Event<'_>));
    /// See [`Running::go_to`].
    fn go_to(&mut self, to: u64, event: &mut dyn FnMut(Event<'_>));
    /// See [`super::Leads::watch`].
    fn watch(&mut self, pin: Pin);
    /// See [`super::Leads::wait_for`].
    fn wait_for(&mut self, pin: Option<Pin>);
    /// Drives `pin` from now on (`Some`), or stops driving it (`None`).
    fn drive(&mut self, pin: Pin, level: Option<bool>);
    /// Sends bytes to a UART's pin from now on, see [`super::Leads::send`].
    fn send(&mut self, pin: Pin, baud: u32, bytes: &[u8]);
    /// See [`Running::is_over`].
    fn is_over(&self) -> bool;
    /// See [`Running::node`].
    fn node(&mut self) -> &mut dyn AnyNode;
    /// See [`Running::status`].
    fn status(&self, runs_on: bool) -> u32;
    /// See [`Running::end`].
    fn end(&self) -> u64;
    /// See [`Running::finish`].
    fn finish(self: Box<Self>) -> Outcome;
}

impl<P: Part, C: Cost> AnyRun for Running<P, C> {
    fn go(&mut self, event: &mut dyn FnMut(Event<'_>)) {
        self.go(event);
    }

    fn go_to(&mut self, to: u64, event: &mut dyn FnMut(Event<'_>)) {
        self.go_to(to, event);
    }

    fn watch(&mut self, pin: Pin) {
        self.node().board_mut(|leads| leads.watch(pin));
    }

    fn wait_for(&mut self, pin: Option<Pin>) {
        self.node().board_mut(|leads| leads.wait_for(pin));
    }

    fn drive(&mut self, pin: Pin, level: Option<bool>) {
        let now = self.node().now();
        self.node().board_mut(|leads| leads.drive(now, pin, level));
    }

    fn send(&mut self, pin: Pin, baud: u32, bytes: &[u8]) {
        let now = self.node().now();
        self.node().board_mut(|leads| leads.send(now, pin, baud, bytes));
    }

    fn is_over(&self) -> bool {
        self.is_over()
    }

    fn node(&mut self) -> &mut dyn AnyNode {
        self.node()
    }

    fn status(&self, runs_on: bool) -> u32 {
        self.status(runs_on)
    }

    fn end(&self) -> u64 {
        self.end()
    }

    fn finish(self: Box<Self>) -> Outcome {
        (*self).finish()
    }
}
