//! Makes a node at power-on, with an image in the part's memory.

use std::collections::BTreeSet;

use cortex_m4::{Core, Cost};
use emulator_part::{Part, Reset};

use super::probe::PROBE_PERIOD;
use super::rtt::{Channels, Text};
use super::side::Side;
use super::{Board, Error, Firmware, Hold, Node, Traps, memory};

impl<B: Board, C: Cost> Node<B, C> {
    /// Makes a node of `part` on `board` with `firmware` in its memory, at power-on.
    ///
    /// # Errors
    ///
    /// Returns an error for an image that does not fit the part, or that has no vector table where the core reads it.
    #[inline(never)]
    pub fn new(mut part: B::Part, board: B, firmware: &Firmware) -> Result<Self, Error> {
        for (address, bytes) in firmware.segments() {
            if !memory::write(&mut part, *address, bytes) {
                return Err(Error::Placement {
                    firmware: firmware.name().to_owned(),
                    part: B::Part::NAME,
                    address: *address,
                    length: bytes.len(),
                });
            }
        }
        let config = part.core();
        let boot = u64::from(config.vector_table);
        let vector = |number: u64| memory::value(&part, boot + 4 * number, 4);
        let (stack, entry) = (vector(0).unwrap_or(0), vector(1).unwrap_or(0));
        let erased = u64::from(u32::MAX);
        if entry & 1 == 0 || entry == erased || stack == 0 || stack == erased {
            let begins = firmware.segments().iter().map(|(address, _)| *address).min().unwrap_or(0);
            let firmware = firmware.name().to_owned();
            return Err(Error::NoVectors { firmware, part: B::Part::NAME, address: boot, begins });
        }
        Ok(Self::begin(part, board, firmware))
    }

    #[inline(never)]
    pub(super) fn begin(part: B::Part, board: B, firmware: &Firmware) -> Self {
        let config = part.core();
        // The linker may have inlined the panic handler into its only caller, so that the handler has no symbol.
        let panics = |name: &str| firmware.functions_called(name).collect::<BTreeSet<u64>>();
        let handler = panics("rust_begin_unwind");
        let traps = Traps {
            default_handler: firmware
                .symbol("DefaultHandler_")
                .or_else(|| firmware.symbol("DefaultHandler"))
                .map(|symbol| symbol.address)
                .into_iter()
                .collect(),
            panic: if handler.is_empty() { panics("core::panicking::panic_fmt") } else { handler },
        };
        let mut node = Self {
            core: Core::new(config),
            side: Side::new(part, board),
            semihosting: false,
            exit: None,
            powered: true,
            lowest: u32::MAX,
            debugged: false,
            told_halt: false,
            tasks: None,
            schedule: None,
            resets: Vec::new(),
            probe_at: PROBE_PERIOD,
            log_block: firmware.symbol("_SEGGER_RTT"),
            search_at: PROBE_PERIOD,
            log: Channels::default(),
            lines: Vec::new(),
            console: Text::default(),
            findings: Vec::new(),
            reported: BTreeSet::new(),
            firmware: firmware.clone(),
            traps,
            hold: Hold::default(),
        };
        node.arm();
        node.core.tell_faults(true);
        // The reset also tells the board the state of the pins at power-on.
        node.side.with(0, |part, view| part.reset(0, Reset::PowerOn, view));
        node.side.reset = None;
        node.side.settle(0);
        node.core.reset(&mut node.side);
        node
    }

    pub(super) fn arm(&mut self) {
        let traps = &self.traps;
        for &trap in traps.default_handler.iter().chain(&traps.panic) {
            self.core.set_breakpoint(u32::try_from(trap).unwrap_or(u32::MAX));
        }
    }
}
