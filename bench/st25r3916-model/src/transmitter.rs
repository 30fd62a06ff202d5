//! The transmitter: frames out of the FIFO onto the air.
//!
//! At the start of a frame, all bytes in the FIFO go to the air as one chunk. Bytes that the controller loads later
//! follow as further chunks, each at the instant at which the air needs its first byte. The number of bytes that have
//! left the FIFO is calculated when the FIFO is accessed ([`Transmitter::settle`]).
//!
//! | covered | DS13541 |
//! |---|---|
//! | NFC-F at 212 and 424 kbit/s, poller: preamble 48 to 96 bits (07), sync, | 4.4 Transmit commands; 4.5 register |
//! | LEN = ntx + 1, CRC-16 | 07, 22, 23 |
//! | NFC-A at 106 kbit/s, poller: frames with parity, incomplete last bytes, REQA, WUPA, | the same; register 05 |
//! | CRC_A |  |
//! | FIFO: sending while loading, water level on the way down (below 200), underflow breaks the frame off | FIFO |
//! | automatic SENSF_RES, slot 0; load modulation by C4 of a target: frame and start as a poller's | Passive target |
//! | scatter of the start of transmission around its mean | recorded, see `Config::transmit_scatter_ns` |
//! | FIFO cleared or read in mid-frame: the transmission | FIFO; silicon sends what is loaded in time |
//! | underflows at its next byte | the remaining bytes instead, if any |
//!
//! | left out | why |
//! |---|---|
//! | NFC-B, NFC-V, topaz, NFCIP-1, stream modes, higher rates of | the link is NFC-F; their use is |
//! | NFC-A | reported |

use crate::core::Core;
use crate::event::{AirEvent, Technology};
use crate::field::Field;
use crate::fifo::Fifo;
use crate::interrupts::irq;
use crate::load_modulation;
use crate::modulation;
use crate::outgoing::Outgoing;
use crate::registers::RX_EN;
use crate::report::Kind;
use crate::schedule::Due;
use crate::timers;

/// The number of bytes in the FIFO below which a transmission raises I_wl, the water level interrupt.
const LEVEL: usize = 200;

#[derive(Clone, Debug, Default)]
pub(crate) struct Transmitter {
    frame: Option<Outgoing>,
}

impl Transmitter {
    pub(crate) fn busy(&self) -> bool {
        self.frame.is_some()
    }

    pub(crate) fn on_air(&self) -> bool {
        self.frame.as_ref().is_some_and(Outgoing::started)
    }

    /// Returns the number of bytes that have left the FIFO since the last call of [`Transmitter::settle`].
    pub(crate) fn leaving(&self, core: &Core) -> usize {
        self.frame.as_ref().map_or(0, |frame| frame.due(core.now()))
    }

    pub(crate) fn settle(&mut self, core: &Core, fifo: &mut Fifo) {
        if let Some(frame) = &mut self.frame {
            fifo.drop_front(frame.take_due(core.now()));
        }
    }

    /// Whether `frame` can be sent now. Each reason against it is a finding.
    pub(crate) fn admits(&self, core: &mut Core, field: &Field, frame: &mut Outgoing) -> bool {
        if self.busy() {
            core.note(Kind::TransmitWhileBusy);
            return false;
        }
        let carrier = if frame.is_answer() { field.outside() } else { field.own() };
        if !carrier {
            core.note(Kind::TransmitWithoutField);
            return false;
        }
        if frame.is_answer() {
            if !core.config().answers {
                core.note(Kind::LoadModulation);
            }
            // `&` is used and not `&&`, so that both checks report their findings.
            let modulates = load_modulation::suits(core) & modulation::in_tune(core);
            frame.silent = !core.load_modulator() || !modulates && !core.config().unsuited_modulation_reaches;
        } else if frame.technology() == Technology::NfcF {
            // `&` is used and not `&&`, so that both checks report their findings.
            let modulates = modulation::suits(core) & modulation::in_tune(core);
            frame.silent = !modulates && !core.config().unsuited_modulation_reaches;
        }
        true
    }

    /// Starts the transmission of a frame that [`Transmitter::admits`] accepted. Returns the instant of the first bit,
    /// ns.
    pub(crate) fn send(&mut self, core: &mut Core, fifo: &mut Fifo, mut frame: Outgoing) -> u64 {
        core.cancel(Due::NoResponse);
        fifo.clear_flags();
        let (mean, half) = (core.config().transmit_latency_ns, core.config().transmit_scatter_ns / 2);
        let half = half.min(mean);
        let start = core.now().saturating_add(mean - half).saturating_add(core.scatter(2 * half));
        frame.starts_at(start);
        self.frame = Some(frame);
        core.plan(Due::TxStart, start);
        start
    }

    pub(crate) fn starts(&mut self, core: &mut Core, fifo: &mut Fifo) {
        let Some(frame) = &mut self.frame else { return };
        let start = frame.start(&fifo.front(frame.missing()));
        if !frame.silent {
            core.emit(AirEvent::FrameStart(start));
        }
        self.plan_level(core, fifo);
        self.plan(core);
    }

    fn plan(&mut self, core: &mut Core) {
        let Some(frame) = &self.frame else { return };
        match frame.needs_more_at() {
            Some(at) => core.plan(Due::TxMore, at),
            None => core.plan(Due::TxEnd, frame.ends_at()),
        }
    }

    /// Puts the bytes on the air that the controller has loaded in the meantime. Without such bytes the frame breaks
    /// off by an underflow.
    pub(crate) fn goes_on(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        let Some(frame) = &mut self.frame else { return };
        let data = fifo.front(frame.missing());
        if data.is_empty() || frame.is_cut() {
            fifo.underflow = true;
            core.note(Kind::TransmitUnderflow);
            self.break_off(core, fifo);
            over(core);
            return;
        }
        let chunk = frame.more(&data);
        if !frame.silent {
            core.emit(AirEvent::Bytes(chunk));
        }
        self.settle(core, fifo);
        self.plan_level(core, fifo);
        self.plan(core);
    }

    /// Records that the FIFO was cleared or read. A transmission that needs further bytes then breaks off at the next
    /// byte.
    pub(crate) fn disturb(&mut self, core: &mut Core) {
        let Some(frame) = self.frame.as_mut().filter(|frame| !frame.all_taken()) else { return };
        if frame.disturb() {
            core.cancel(Due::TxEnd);
            core.plan(Due::TxMore, frame.next_taken());
        }
        core.note(Kind::FifoDisturbed);
    }

    pub(crate) fn ends(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        let Some(frame) = self.frame.take() else { return };
        if !frame.silent {
            core.emit(AirEvent::FrameEnd { bits: frame.data_bits() });
        }
        core.statistics_mut().sent += 1;
        over(core);
    }

    pub(crate) fn break_off(&mut self, core: &mut Core, fifo: &mut Fifo) {
        if self.frame.is_none() {
            return;
        }
        self.settle(core, fifo);
        for due in [Due::TxStart, Due::TxMore, Due::TxLevel, Due::TxEnd] {
            core.cancel(due);
        }
        let Some(frame) = self.frame.take() else { return };
        if frame.started() && !frame.silent {
            core.emit(AirEvent::FrameEnd { bits: frame.bits_by(core.now()) });
        }
    }

    /// Plans the interrupt I_wl if a loaded byte has brought the FIFO back to its water level.
    pub(crate) fn loaded(&mut self, core: &mut Core, fifo: &mut Fifo) {
        if fifo.len() == LEVEL {
            self.plan_level(core, fifo);
        }
    }

    /// Plans the water level interrupt (I_wl) for the instant at which fewer than 200 bytes are left in the FIFO.
    fn plan_level(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        if let Some(at) = self.frame.as_ref().and_then(|frame| frame.falls_below(LEVEL, fifo.len())) {
            core.plan(Due::TxLevel, at);
        }
    }

    /// Raises the water level interrupt (I_wl) if the FIFO holds fewer than 200 bytes, and plans it again otherwise.
    pub(crate) fn level(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        if fifo.len() < LEVEL {
            core.raise(irq::WL);
        } else {
            self.plan_level(core, fifo);
        }
    }
}

/// Raises I_txe at the end of a transmission, even after an underflow, and starts the timers that begin there.
fn over(core: &mut Core) {
    core.cancel(Due::TxLevel);
    if core.operates(RX_EN) {
        core.raise(irq::TXE);
        timers::start_mask_receive(core);
        timers::start_no_response(core);
    } else if core.config().txe_with_rx_off {
        core.raise(irq::TXE);
    }
}
