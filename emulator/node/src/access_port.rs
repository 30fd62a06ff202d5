//! What the access port of a debug port does to a node: [`crate::debug_port`] is the port itself.
//!
//! Unlike [`super::hold`], which stops the whole world, this is what silicon offers: the core halts by its own debug
//! registers, and everything else goes on.

use cortex_m4::{Cost, Fault, Width};
use emulator_part::Part;

use super::{Board, Error, Firmware, Node};

impl<B: Board, C: Cost> Node<B, C> {
    /// `part` on `board` at power-on, running what its memory holds: nothing, on a new part. No symbols are known.
    #[must_use]
    pub fn programmed(part: B::Part, board: B) -> Self {
        let mut node = Self::begin(part, board, &Firmware::raw("what is in flash", Vec::new()));
        // What runs there until it is written anew is nobody's firmware.
        node.core.tell_faults(false);
        node
    }

    /// As [`Node::programmed`], for a part whose memory holds `firmware`, which names its addresses in reports.
    ///
    /// # Errors
    ///
    /// [`Error::Differs`] where memory holds something else.
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

    /// A debugger has the debug domain powered, or no longer: what resets on a lock-up does not meanwhile.
    pub fn set_debugged(&mut self, debugged: bool) {
        self.debugged = debugged;
    }

    /// Reads at `address`, aligned to `width`, as an access port does, now.
    ///
    /// # Errors
    ///
    /// The fault that the bus answers with.
    pub fn access_port_read(&mut self, address: u32, width: Width) -> Result<u32, Fault> {
        let at = self.present();
        let answer = self.core.access_port_read(&mut self.side, address, width, at);
        self.access_ended();
        answer
    }

    /// Writes as [`Node::access_port_read`] reads.
    ///
    /// # Errors
    ///
    /// The fault that the bus answers with.
    pub fn access_port_write(&mut self, address: u32, width: Width, value: u32) -> Result<(), Fault> {
        let at = self.present();
        let answer = self.core.access_port_write(&mut self.side, address, width, value, at);
        self.access_ended();
        answer
    }

    /// Calls the part at the present cycle, as a debug port does that has more than an access port to it.
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

    /// Lets the part know whether the core is halted for debug.
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
