//! The receiver: frames from the air into the FIFO.
//!
//! The number of received bytes in the FIFO is calculated when the FIFO is accessed ([`Receiver::settle`]).
//!
//! | covered | DS13541 |
//! |---|---|
//! | reception by a poller (answers, mask-receive timer) and by a target: fixed NFC-F (03 | Receiver, Passive target |
//! | = A0) or bit rate detection (03 = C0 with NFC-F or NFC-A) |  |
//! | I_rxs at the sync, FIFO emptied then, bytes as they come, I_rxe; CRC, parity and | Interrupt interface; |
//! | framing errors; re-arming by D1; water level on the way up (300) | Passive target; FIFO |
//! | SENSF_REQ for its own system code (passive target memory 15, 16): the automatic answer is started | Passive |
//! | | target |
//!
//! | left out | why |
//! |---|---|
//! | NFC-A target with its anticollision, TSN slots other than 0 | the link uses neither |
//! | collisions of two answers | the path of answers models them ([`crate::AnswerPath`]) |
//! | signal strength, noise, gain, squelch | the air is digital; errors come from its fault model |

use crate::clock::{bit_cycles, rate_of};
use crate::config::BrokenFrame;
use crate::core::Core;
use crate::crc;
use crate::event::{Chunk, FrameStart, Technology};
use crate::field::Field;
use crate::fifo::Fifo;
use crate::incoming::Incoming;
use crate::interrupts::irq;
use crate::modulation;
use crate::receive_chain;
use crate::registers::{RX_EN, reg};
use crate::report::Kind;
use crate::schedule::Due;
use crate::timers::{self, Trigger};

/// The number of bytes in the FIFO at which a reception raises I_wl, the water level interrupt.
const LEVEL: usize = 300;
/// The carrier cycles from the end of a SENSF_REQ to the first slot of its answer: 512 × 64 (ISO 18092, 2.417 ms).
const ANSWER_DELAY_CYCLES: u64 = 512 * 64;
/// The guard time: the carrier cycles from the end of a frame to the earliest answer in NFC-F (NFC Forum, Digital
/// Protocol 1.1, TR0F,LISTEN,MIN; proxmark3 `armsrc/felica.c`, stm32duino/ST25R3916's family of libraries).
const GUARD_CYCLES: u64 = 2_672;

#[derive(Clone, Debug)]
pub(crate) struct Receiver {
    frame: Option<Incoming>,
    /// The instant since which the receiver has been unmasked, ns; `None` if it is masked.
    unmasked_since: Option<u64>,
    /// The instant, ns, of the end of the last received frame, until an answer follows; `None` without such a frame.
    asked: Option<u64>,
}

impl Receiver {
    pub(crate) fn new() -> Self {
        Self { frame: None, unmasked_since: Some(0), asked: None }
    }

    pub(crate) fn set_default(&mut self, now: u64) {
        *self = Self { frame: None, unmasked_since: Some(now), asked: None };
    }

    pub(crate) fn busy(&self) -> bool {
        self.frame.as_ref().is_some_and(|frame| frame.locked)
    }

    /// Whether the receiver is masked. D0 masks it, and so does the end of a frame.
    pub(crate) fn masked(&self) -> bool {
        self.unmasked_since.is_none()
    }

    /// Masks the receiver, as D0 does, or as a broken frame does on which the receiver hangs.
    pub(crate) fn mask(&mut self) {
        self.unmasked_since = None;
    }

    /// Unmasks the receiver, as D1 does. A frame that is already past its sync is not received.
    pub(crate) fn unmask(&mut self, now: u64) {
        self.unmasked_since.get_or_insert(now);
    }

    /// Starts the decoder at the end of the mask-receive timer, unless the receiver is masked.
    pub(crate) fn mask_timer_ends(&mut self, now: u64) {
        self.unmasked_since = self.unmasked_since.map(|_| now);
    }

    /// Masks a target that only D1 may arm again, and unmasks any other receiver.
    pub(crate) fn mask_idle(&mut self, core: &Core) {
        let waits = core.target() && core.config().target_rearms_by_command;
        self.unmasked_since = (!waits).then_some(core.now());
    }

    /// Returns the number of received bytes that have become due since the last call of [`Receiver::settle`].
    pub(crate) fn arriving(&self, core: &Core) -> usize {
        self.frame.as_ref().map_or(0, |frame| frame.due(core.now()))
    }

    pub(crate) fn settle(&mut self, core: &mut Core, fifo: &mut Fifo) {
        let Some(frame) = &mut self.frame else { return };
        let mut lost = false;
        for &byte in frame.take_due(core.now()) {
            lost |= !fifo.push(byte);
        }
        if lost {
            core.note(Kind::FifoOverflow);
        }
    }

    /// Plans the interrupt I_wl if a read has brought the FIFO below its water level.
    pub(crate) fn taken(&mut self, core: &mut Core, fifo: &mut Fifo) {
        if fifo.len() + 1 == LEVEL {
            self.plan_level(core, fifo);
        }
    }

    /// Plans the water level interrupt (I_wl) for the instant at which the FIFO holds 300 bytes.
    pub(crate) fn plan_level(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        let level = fifo.len();
        if level >= LEVEL {
            return;
        }
        core.cancel(Due::RxLevel);
        if let Some(at) = self.frame.as_ref().and_then(|frame| frame.reaches(LEVEL, level)) {
            core.plan(Due::RxLevel, at.max(core.now()));
        }
    }

    /// Raises the water level interrupt (I_wl) if the FIFO holds 300 bytes or more, and plans it again otherwise.
    pub(crate) fn level(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        if fifo.len() >= LEVEL {
            core.raise(irq::WL);
        } else {
            self.plan_level(core, fifo);
        }
    }

    pub(crate) fn frame_starts(&mut self, core: &mut Core, fifo: &mut Fifo, at: u64, frame: FrameStart) {
        // If a frame begins during another frame, the receiver loses the rest of the earlier one.
        self.signal_lost(core, fifo, at);
        if self.busy() {
            core.statistics_mut().missed += 1;
            return;
        }
        let config = core.config();
        let (latency, to_start) = match frame.technology {
            Technology::NfcA => (config.nfc_a_latency_ns, config.nfc_a_start_latency_ns),
            Technology::NfcF => (config.nfc_f_latency_ns, config.nfc_f_latency_ns),
        };
        let frame = Incoming::new(frame, at, latency);
        let sync = frame.header_end().saturating_add(to_start);
        self.frame = Some(frame);
        core.plan(Due::RxStart, sync.max(core.now()));
    }

    pub(crate) fn frame_goes_on(&mut self, core: &mut Core, fifo: &mut Fifo, chunk: &Chunk) {
        if let Some(frame) = self.frame.as_mut().filter(|frame| !frame.has_ended()) {
            frame.more(chunk);
            self.plan_end(core, fifo);
        }
    }

    pub(crate) fn frame_ends(&mut self, core: &mut Core, fifo: &mut Fifo, at: u64, bits: u32) {
        let Some(frame) = self.frame.as_mut().filter(|frame| !frame.has_ended()) else { return };
        if !frame.locked && at < frame.header_end() {
            // The frame broke off before the end of its sync, so the receiver cannot detect it.
            return self.signal_lost(core, fifo, at);
        }
        frame.ends(at, bits);
        self.plan_end(core, fifo);
    }

    pub(crate) fn signal_lost(&mut self, core: &mut Core, fifo: &mut Fifo, at: u64) {
        let Some(frame) = self.frame.as_mut().filter(|frame| !frame.has_ended()) else { return };
        if frame.stops(at) {
            self.plan_end(core, fifo);
        } else {
            self.frame = None;
            core.cancel(Due::RxStart);
            core.statistics_mut().missed += 1;
        }
    }

    /// Whether the receiver accepts the frame `rx`. `sending` says that the transmitter is sending a frame.
    fn takes(&self, core: &Core, field: &Field, sending: bool, rx: &Incoming) -> bool {
        if !core.powered() || !core.oscillator() || !core.operates(RX_EN) || sending {
            return false;
        }
        // The decoder must run before the sync of an NFC-F frame or the start of communication of an NFC-A frame.
        if self.unmasked_since.is_none_or(|since| since > rx.sync_start()) {
            return false;
        }
        let om = core.operation_mode();
        let right_rate = rate_of(bit_cycles(core.a(reg::BIT_RATE) & 0x03)) == rx.frame.bits_per_second;
        if core.target() {
            if rx.frame.load_modulation || !field.detected() {
                return false;
            }
            match rx.frame.technology {
                Technology::NfcF if om == 0x04 => right_rate,
                // With bit rate detection (om3), om2 selects NFC-F and om0 selects NFC-A.
                Technology::NfcF => om & 0x08 != 0 && om & 0x04 != 0,
                Technology::NfcA => om & 0x08 != 0 && om & 0x01 != 0,
            }
        } else {
            let right_mode = match rx.frame.technology {
                Technology::NfcA => om == 0x01,
                Technology::NfcF => om == 0x03,
            };
            rx.frame.load_modulation && field.own() && !timers::masking_receive(core) && right_mode && right_rate
        }
    }

    /// Reports a mode or a bit rate as a finding if the model does not cover it for the frame `rx`.
    fn is_modelled(&self, core: &mut Core, sending: bool, rx: &Incoming) {
        let listening = core.powered() && core.oscillator() && core.operates(RX_EN) && !sending;
        if !listening || self.masked() || core.target() == rx.frame.load_modulation {
            return;
        }
        let rate = core.a(reg::BIT_RATE) & 0x03;
        let rate_modelled = match (core.target(), core.operation_mode()) {
            (false, 0x01) => rate == 0,
            (false, 0x03) | (true, 0x04) => matches!(rate, 1 | 2),
            // With bit rate detection (om3) the chip determines the rate.
            (true, 0x09 | 0x0C | 0x0D) => true,
            _ => return core.note(Kind::UnmodelledMode(core.a(reg::MODE))),
        };
        if !rate_modelled {
            core.note(Kind::UnmodelledBitRate(core.a(reg::BIT_RATE)));
        }
    }

    /// Accepts or misses a frame at the end of its header. `sending` says that the transmitter is sending a frame.
    pub(crate) fn starts(&mut self, core: &mut Core, fifo: &mut Fifo, field: &Field, sending: bool) {
        let Some(mut rx) = self.frame.take() else { return };
        self.is_modelled(core, sending, &rx);
        let takes = self.takes(core, field, sending, &rx);
        let chain = !takes || receive_chain::suits(core, rx.frame.technology) || core.config().unsuited_chain_receives;
        let tuned = !core.target() || modulation::in_tune(core) || core.config().unsuited_modulation_reaches;
        if !takes || !chain || !tuned {
            core.statistics_mut().missed += 1;
            return;
        }
        if fifo.len() != 0 {
            core.statistics_mut().overwritten += 1;
            core.note(Kind::FrameOverwritten);
        }
        fifo.clear();
        core.raise(irq::RXS);
        core.cancel(Due::NoResponse);
        timers::general_purpose_trigger(core, Trigger::StartOfReception);
        if core.target() && core.operation_mode() & 0x08 != 0 {
            let rate = match rx.frame.bits_per_second {
                212_000 => 1,
                424_000 => 2,
                _ => 0,
            };
            core.set_a(reg::RATE_DETECTED, rate << 4);
            core.raise(irq::NFCT);
        }
        rx.locked = true;
        self.frame = Some(rx);
        self.plan_level(core, fifo);
        self.plan_end(core, fifo);
    }

    fn plan_end(&mut self, core: &mut Core, fifo: &mut Fifo) {
        let Some(rx) = self.frame.as_ref().filter(|rx| rx.locked) else { return };
        match rx.done_at() {
            Some(at) => {
                core.plan(Due::RxEnd, at.max(core.now()));
                self.plan_level(core, fifo);
            }
            None => {
                self.plan_level(core, fifo);
                core.cancel(Due::RxEnd);
            }
        }
    }

    /// Completes the reception of a frame: its last bytes go into the FIFO, and its interrupts are raised.
    pub(crate) fn ends(&mut self, core: &mut Core, fifo: &mut Fifo) {
        self.settle(core, fifo);
        core.cancel(Due::RxLevel);
        let Some(mut rx) = self.frame.take() else { return };
        for &byte in rx.take_rest() {
            if !fifo.push(byte) {
                core.note(Kind::FifoOverflow);
            }
        }
        let broken = !rx.whole();
        if broken {
            core.statistics_mut().broken += 1;
            if core.config().broken_frame == BrokenFrame::NeverEnds {
                return self.mask();
            }
        }
        fifo.last_bits = rx.last_bits();
        let crc_wrong = broken || fifo.last_bits != 0 || !crc_right(&rx);
        let mut raised = irq::RXE;
        if crc_wrong && core.a(reg::AUX) & 0x80 == 0 {
            raised |= irq::CRC;
            core.statistics_mut().crc_errors += 1;
        }
        if broken {
            raised |= irq::ERR1;
        }
        if rx.frame.chunk.parity_error && core.a(reg::ISO14443A) & 0x40 == 0 {
            raised |= irq::PAR;
        }
        // The bit d_212_424_1r (register 08, bit 2) disables the automatic answer.
        if core.target() && !crc_wrong && asks_for_own(core, &rx) && core.a(reg::PASSIVE_TARGET) & 0x04 == 0 {
            raised = (raised & !irq::RXE) | irq::RXE_PTA | irq::WU_F;
            let delay = core.clock().cycles(ANSWER_DELAY_CYCLES);
            core.plan_in(Due::Answer, delay);
        }
        core.raise(raised);
        self.asked = rx.done_at().map(|done| done.saturating_sub(core.config().nfc_f_latency_ns));
        core.statistics_mut().received += 1;
        timers::general_purpose_trigger(core, Trigger::EndOfReception);
        if core.target() {
            self.mask_idle(core);
        }
    }

    /// Reports an answer that begins at `start`, if it comes within the guard time or if no frame waits for an answer.
    pub(crate) fn answers(&mut self, core: &mut Core, start: u64) {
        let Some(end) = self.asked.take() else { return core.note(Kind::AnswerUnasked) };
        let after = start.saturating_sub(end);
        if after < core.clock().cycles(GUARD_CYCLES) {
            core.note(Kind::AnswerTooEarly(after));
        }
    }

    pub(crate) fn abort(&mut self, core: &mut Core, fifo: &mut Fifo) {
        if self.busy() {
            self.settle(core, fifo);
            self.frame = None;
            core.cancel(Due::RxLevel);
            core.cancel(Due::RxEnd);
        }
    }
}

fn crc_right(rx: &Incoming) -> bool {
    let Some((body, crc)) = rx.data().split_last_chunk::<2>() else { return false };
    let right = match rx.frame.technology {
        Technology::NfcF => crc::nfc_f(body),
        Technology::NfcA => crc::nfc_a(body),
    };
    right == *crc
}

/// Whether the frame is a SENSF_REQ (LEN 6, command 0, system code, request code, slots) for the chip's system code.
/// The chip has its system code in the passive target memory. A byte FF in the request's system code fits any value
/// (JIS X 6319-4).
fn asks_for_own(core: &Core, rx: &Incoming) -> bool {
    let own = &core.registers().target_memory()[15..17];
    rx.frame.technology == Technology::NfcF
        && matches!(*rx.data(), [6, 0, code1, code2, ..]
            if [code1, code2].iter().zip(own).all(|(asked, own)| *asked == 0xFF || asked == own))
}
