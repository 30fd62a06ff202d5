//! The access to a node through the access port of a debug port.
//!
//! The debugger in [`super::hold`] stops the whole virtual world. Through the access port the core halts by its own
//! debug registers, as on silicon, and everything else goes on.

use cortex_m4::{Cost, Fault, Width};
use emulator_part::Part;

use super::{Board, Error, Firmware, Node};

impl<B: Board, C: Cost> Node<B, C> {
    /// Makes a node at power-on from `part` on `board`. The node runs what the part's memory holds, and has no symbols.
    /// A new part holds no firmware.
    #[must_use]
    pub fn programmed(part: B::Part, board: B) -> Self {
        let mut node = Self::begin(part, board, &Firmware::raw("what is in flash", Vec::new()));
        // A node without a known firmware does not report faults of the core, because its program cannot name them.
        node.core.tell_faults(false);
        node
    }

    /// Makes a node as [`Node::programmed`] does, for a part whose memory holds `firmware`. Reports name addresses by
    /// the symbols of `firmware`.
    ///
    /// # Errors
    ///
    /// Returns [`Error::Differs`] where memory holds other bytes than `firmware`.
    #[inline(never)]
    pub fn programmed_with(part: B::Part, board: B, firmware: &Firmware) -> Result<Self, Error> {
        for (address, bytes) in firmware.segments() {
            let held = u32::try_from(*address).ok().and_then(|address| part.memory(address, bytes.len()));
            let same = |held: &[u8]| held.iter().zip(bytes).take_while(|(held, wanted)| held == wanted).count();
            let same = held.map_or(0, same);
            if same < bytes.len() {
                let address = address + same as u64;
                return Err(Error::Differs { firmware: firmware.name().to_owned(), part: B::Part::NAME, address });
            }
        }
        Ok(Self::begin(part, board, firmware))
    }

    /// Sets whether a debugger has powered the debug domain. Meanwhile a lock-up does not reset the part.
    pub fn set_debugged(&mut self, debugged: bool) {
        self.debugged = debugged;
    }

    /// Reads at `address`, which is aligned to `width`, at the present instant.
    ///
    /// # Errors
    ///
    /// Returns the fault with which the bus answers.
    pub fn access_port_read(&mut self, address: u32, width: Width) -> Result<u32, Fault> {
        let at = self.present();
        let answer = self.core.access_port_read(&mut self.side, address, width, at);
        self.access_ended();
        answer
    }

    /// Writes `value` at `address`, see [`Node::access_port_read`].
    ///
    /// # Errors
    ///
    /// Returns the fault with which the bus answers.
    pub fn access_port_write(&mut self, address: u32, width: Width, value: u32) -> Result<(), Fault> {
        let at = self.present();
        let answer = self.core.access_port_write(&mut self.side, address, width, value, at);
        self.access_ended();
        answer
    }

    /// Calls `call` with the part and the present cycle. A debug port reaches its other access ports in this way.
    pub fn with_part<T>(&mut self, call: impl FnOnce(&mut B::Part, u64) -> T) -> T {
        let at = self.present();
        let answer = self.side.with(at, |part, _| call(part, at));
        self.access_ended();
        answer
    }

    fn access_ended(&mut self) {
        self.side.part.signals().announce();
        self.side.stirred = true;
        self.tell_halt();
    }

    pub(super) fn tell_halt(&mut self) {
        let halted = self.core.is_halted();
        if halted != self.told_halt {
            self.told_halt = halted;
            let at = self.present();
            self.side.with(at, |part, view| part.halts(at, halted, view));
        }
    }

    /// Whether the core is halted by its own debug registers.
    #[must_use]
    pub fn is_halted(&self) -> bool {
        self.core.is_halted()
    }
}
