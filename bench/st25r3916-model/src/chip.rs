//! The chip: power, oscillator, registers, interrupts, timers, commands, and the order in which things happen.
//!
//! Everything the chip does by itself is a deadline in one small table; `advance` takes them in order of time. Between
//! deadlines nothing runs: a frame on its way through the FIFO is computed when somebody looks (see `radio`).
//!
//! | covered | DS13541 |
//! |---|---|
//! | power-up, Set default (C0, C1), oscillator start and I_osc, auxiliary | Power-on, Operating modes, 4.4 Direct |
//! | display (31) | commands |
//! | interrupts: four registers, masks, read clears, pin level | Interrupt interface |
//! | Stop (C2), transmit (C4–C7), initial field on (C8), mask and unmask (D0, D1), measurements | 4.4 Direct commands |
//! | (D3, D8, D9; DF in `supply`), reset gain (D5), regulators (D6), clear RSSI and FIFO (DA, |  |
//! | DB), RC calibration (EA) |  |
//! | mask-receive, no-response, general purpose and wake-up timers (E0–E3, E8) | Timers, 4.5 registers 0F–14, 32 |
//! | external field detector, own field, RF collision avoidance | External field detector, 4.4 NFC field on |
//!
//! | left out | why |
//! |---|---|
//! | response field on (C9), AM state (D2), transparent mode (DC), capacitive sensor (DD, | the link uses none; each |
//! | DE), PPON2 timer (E4), NFC-A target states (CD, CE) | is reported |
//! | wake-up mode (`wu`), test registers | as above; test register 04 is stored for the bring-up |
//! | the step of the NFC field-on guard time (B15) | recorded for 0 only (75.9 µs); 75.5 µs per step is assumed |
//! | general purpose timer in NFC active mode (12, gptc = 3), nrt_emv and nrt_nfc | the link uses none; the bits are |
//! | (12), response field (03, nfc_ar), no_rx_par, nfc_f0 and antcl (05) | kept, and reported when set |
//! | whether collision avoidance (C8) ends when it | not documented; it ends, with I_cac, when the detector sees |
//! | sees a field or when its time is up | a field at any instant of the window |

use std::collections::VecDeque;

use crate::clock::Clock;
use crate::fifo::Fifo;
use crate::irq_pin::IrqPin;
use crate::radio::{Incoming, Outgoing};
use crate::registers::{self, RESET_A, RESET_B};
use crate::report::{Reports, Space};
use crate::rng::SplitMix;
use crate::spi::Spi;
use crate::{AirEvent, Config, Kind, Report, Variant};

/// Interrupt bits as one word: register 1A is the lowest byte, 1D the highest.
pub(crate) mod irq {
    pub(crate) const OSC: u32 = 0x80;
    pub(crate) const WL: u32 = 0x40;
    pub(crate) const RXS: u32 = 0x20;
    pub(crate) const RXE: u32 = 0x10;
    pub(crate) const TXE: u32 = 0x08;
    pub(crate) const DCT: u32 = 0x80 << 8;
    pub(crate) const NRE: u32 = 0x40 << 8;
    pub(crate) const GPE: u32 = 0x20 << 8;
    pub(crate) const EON: u32 = 0x10 << 8;
    pub(crate) const EOF: u32 = 0x08 << 8;
    pub(crate) const CAC: u32 = 0x04 << 8;
    pub(crate) const CAT: u32 = 0x02 << 8;
    pub(crate) const NFCT: u32 = 0x01 << 8;
    pub(crate) const CRC: u32 = 0x80 << 16;
    pub(crate) const PAR: u32 = 0x40 << 16;
    pub(crate) const ERR1: u32 = 0x10 << 16;
    pub(crate) const WT: u32 = 0x08 << 16;
    pub(crate) const APON: u32 = 0x20 << 24;
    pub(crate) const RXE_PTA: u32 = 0x10 << 24;
    pub(crate) const WU_F: u32 = 0x08 << 24;
}

/// Register addresses, space A.
pub(crate) mod reg {
    pub(crate) const IO2: usize = 0x01;
    pub(crate) const OPERATION: usize = 0x02;
    pub(crate) const MODE: usize = 0x03;
    pub(crate) const BIT_RATE: usize = 0x04;
    pub(crate) const ISO14443A: usize = 0x05;
    pub(crate) const PREAMBLE: usize = 0x07;
    pub(crate) const PASSIVE_TARGET: usize = 0x08;
    pub(crate) const AUX: usize = 0x0A;
    pub(crate) const RX_CONF1: usize = 0x0B;
    pub(crate) const RX_CONF3: usize = 0x0D;
    pub(crate) const RX_CONF4: usize = 0x0E;
    pub(crate) const MASK_RECEIVE: usize = 0x0F;
    pub(crate) const NO_RESPONSE: usize = 0x10;
    pub(crate) const TIMERS: usize = 0x12;
    pub(crate) const GENERAL_PURPOSE: usize = 0x13;
    pub(crate) const MASK: usize = 0x16;
    pub(crate) const IRQ: usize = 0x1A;
    pub(crate) const TRANSMIT_LENGTH: usize = 0x22;
    pub(crate) const RATE_DETECTED: usize = 0x24;
    pub(crate) const AD_RESULT: usize = 0x25;
    pub(crate) const TUNE_A: usize = 0x26;
    pub(crate) const TUNE_B: usize = 0x27;
    pub(crate) const REGULATOR: usize = 0x2C;
    pub(crate) const RSSI: usize = 0x2D;
    pub(crate) const GAIN: usize = 0x2E;
    pub(crate) const WAKE_UP: usize = 0x32;
    /// Space B: correlator.
    pub(crate) const B_CORR1: usize = 0x0C;
    pub(crate) const B_CORR2: usize = 0x0D;
    /// Space B.
    pub(crate) const B_GUARD: usize = 0x15;
    /// Space B: lm_ext and lm_dri connect the load modulator.
    pub(crate) const B_AUX_MOD: usize = 0x28;
}

pub(crate) const EN: u8 = 0x80;
pub(crate) const RX_EN: u8 = 0x40;
pub(crate) const TX_EN: u8 = 0x08;
const EN_FD: u8 = 0x03;
pub(crate) const TARGET: u8 = 0x80;
const NEVER: u64 = u64::MAX;

/// What can fall due. The order decides between two at the same instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Due {
    Osc,
    FieldOn,
    FieldDetect,
    Heard,
    TxStart,
    TxMore,
    TxLevel,
    TxEnd,
    RxStart,
    RxLevel,
    RxEnd,
    Apon,
    Guard,
    CommandDone,
    MaskReceive,
    NoResponse,
    GeneralPurpose,
    WakeUp,
    Answer,
}

const DUES: [Due; 19] = [
    Due::Osc,
    Due::FieldOn,
    Due::FieldDetect,
    Due::Heard,
    Due::TxStart,
    Due::TxMore,
    Due::TxLevel,
    Due::TxEnd,
    Due::RxStart,
    Due::RxLevel,
    Due::RxEnd,
    Due::Apon,
    Due::Guard,
    Due::CommandDone,
    Due::MaskReceive,
    Due::NoResponse,
    Due::GeneralPurpose,
    Due::WakeUp,
    Due::Answer,
];

/// What the chip has done, for a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Frames sent to their end.
    pub sent: u64,
    /// Frames received to I_rxe, whatever their flags.
    pub received: u64,
    /// Of these, with a CRC error.
    pub crc_errors: u64,
    /// Frames that broke off while being received.
    pub broken: u64,
    /// Frames that passed by: not armed, receiver off, other mode or rate.
    pub missed: u64,
    /// Frames that began while their predecessor was unread in the FIFO.
    pub overwritten: u64,
}

/// One ST25R3916 or ST25R3916B on a virtual clock.
///
/// All times are virtual ns and do not go back: an instant before the last one counts as the last one.
#[derive(Clone, Debug)]
pub struct Chip {
    pub(crate) config: Config,
    pub(crate) clock: Clock,
    pub(crate) now: u64,
    pub(crate) powered: bool,
    pub(crate) a: [u8; 64],
    pub(crate) b: [u8; 64],
    pub(crate) test: [u8; 64],
    /// Passive target memory: NFC-A 15, NFC-F 21, TSN 12 bytes.
    pub(crate) pt_memory: [u8; 48],
    pub(crate) pending: u32,
    pub(crate) pin: IrqPin,
    /// Scatters what scatters on silicon.
    pub(crate) rng: SplitMix,
    pub(crate) fifo: Fifo,
    pub(crate) spi: Spi,
    pub(crate) osc_ok: bool,
    /// Own carrier.
    pub(crate) field: bool,
    /// A carrier from outside, whether or not the chip sees it.
    pub(crate) outside: bool,
    /// The detector's output.
    pub(crate) detected: bool,
    /// Virtual time from which the receiver has been unmasked; none when it is masked.
    pub(crate) unmasked_since: Option<u64>,
    pub(crate) tx: Option<Outgoing>,
    pub(crate) rx: Option<Incoming>,
    due: [u64; DUES.len()],
    next: u64,
    inbox: VecDeque<(u64, u64, AirEvent)>,
    pub(crate) outbox: Vec<(u64, AirEvent)>,
    reports: Reports,
    pub(crate) statistics: Statistics,
    /// Result registers that a command in progress will set.
    measuring: Option<(Space, u8, u8)>,
}

impl Chip {
    /// A chip that is powered from time 0, its registers at their reset values.
    pub fn new(config: Config) -> Self {
        let clock = Clock::new(config.crystal_ppb);
        let rng = SplitMix::new(config.seed);
        let mut chip = Self {
            config,
            clock,
            now: 0,
            powered: true,
            a: RESET_A,
            b: RESET_B,
            test: [0; 64],
            pt_memory: [0; 48],
            pending: 0,
            pin: IrqPin::new(),
            rng,
            fifo: Fifo::new(),
            spi: Spi::default(),
            osc_ok: false,
            field: false,
            outside: false,
            detected: false,
            unmasked_since: Some(0),
            tx: None,
            rx: None,
            due: [NEVER; DUES.len()],
            next: NEVER,
            inbox: VecDeque::new(),
            outbox: Vec::new(),
            reports: Reports::default(),
            statistics: Statistics::default(),
            measuring: None,
        };
        chip.set_default();
        chip
    }

    /// Its configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Supply on: every register takes its reset value. What was on the air is still there.
    pub fn power_on(&mut self, now: u64) {
        self.advance(now);
        if !self.powered {
            self.powered = true;
            self.set_default();
        }
    }

    /// Supply off: own field, IRQ pin and MISO go low, registers are lost. A frame on the air breaks off.
    pub fn power_off(&mut self, now: u64) {
        self.advance(now);
        if self.powered {
            self.set_default();
            // The clock's rate is the controller's.
            let hz = self.spi.hz;
            self.spi = Spi::default();
            self.spi.hz = hz;
            self.powered = false;
            self.irq_changes();
        }
    }

    /// Whether the supply is on.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// Whether its own carrier is on.
    pub fn field_on(&self) -> bool {
        self.field
    }

    /// Whether a frame of its own is on the air.
    pub fn is_transmitting(&self) -> bool {
        self.tx.as_ref().is_some_and(|t| t.started)
    }

    /// When the chip next does something by itself, ns; never before the time last advanced to.
    pub fn next_event(&self) -> Option<u64> {
        (self.next != NEVER).then(|| self.next.max(self.now))
    }

    /// Lets every internal event up to and including `now` take effect.
    pub fn advance(&mut self, now: u64) {
        while self.next <= now {
            let mut first = Due::Osc;
            for d in DUES {
                if self.due[d as usize] < self.due[first as usize] {
                    first = d;
                }
            }
            let at = self.due[first as usize];
            self.now = self.now.max(at);
            self.cancel(first);
            self.fall_due(first);
        }
        self.now = self.now.max(now);
    }

    /// Whether there is anything for [`Chip::take_air`].
    pub fn has_air(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// What the chip has emitted since the last call, in order of time.
    pub fn take_air(&mut self) -> impl Iterator<Item = (u64, AirEvent)> + '_ {
        self.outbox.drain(..)
    }

    /// Something happens on the air at `at`. It may lie ahead, and then waits; what lies behind takes effect now, but a
    /// frame's bits keep the times they had.
    pub fn hear(&mut self, at: u64, event: &AirEvent) {
        let effect = at.max(self.now);
        let place = self.inbox.partition_point(|(t, _, _)| *t <= effect);
        self.inbox.insert(place, (effect, at, event.clone()));
        self.plan_hearing();
        self.advance(self.now);
    }

    /// What must not be passed over in silence.
    pub fn reports(&self) -> &[Report] {
        self.reports.all()
    }

    /// What the chip has done.
    pub fn statistics(&self) -> Statistics {
        self.statistics
    }

    /// A register's value as a read would find it, without the read's side effects.
    pub fn peek(&self, space: Space, address: u8) -> u8 {
        self.register(space, address & 0x3F)
    }

    pub(crate) fn note(&mut self, kind: Kind) {
        self.reports.note(self.now, kind);
    }

    pub(crate) fn emit(&mut self, event: AirEvent) {
        self.outbox.push((self.now, event));
    }

    pub(crate) fn plan(&mut self, what: Due, at: u64) {
        self.due[what as usize] = at;
        self.next = self.due.iter().copied().min().unwrap_or(NEVER);
    }

    pub(crate) fn plan_in(&mut self, what: Due, ns: u64) {
        self.plan(what, self.now.saturating_add(ns));
    }

    pub(crate) fn cancel(&mut self, what: Due) {
        self.plan(what, NEVER);
    }

    fn running(&self, what: Due) -> bool {
        self.due[what as usize] != NEVER
    }

    fn plan_hearing(&mut self) {
        let at = self.inbox.front().map_or(NEVER, |(t, _, _)| *t);
        self.plan(Due::Heard, at);
    }

    fn fall_due(&mut self, what: Due) {
        match what {
            Due::Osc => {
                self.osc_ok = true;
                self.raise(irq::OSC);
                self.field_follows();
            }
            Due::FieldOn => self.field_after_avoidance(),
            Due::FieldDetect => self.field_detected(),
            Due::Heard => {
                if let Some((_, at, event)) = self.inbox.pop_front() {
                    self.plan_hearing();
                    self.heard(at, event);
                }
            }
            Due::TxStart => self.transmission_starts(),
            Due::TxMore => self.transmission_goes_on(),
            Due::TxLevel => self.transmit_level(),
            Due::TxEnd => self.transmission_ends(),
            Due::RxStart => self.reception_starts(),
            Due::RxLevel => self.receive_level(),
            Due::RxEnd => self.reception_ends(),
            Due::Apon => self.raise(irq::APON),
            Due::Guard => self.raise(irq::CAT),
            Due::CommandDone => {
                match self.measuring.take() {
                    Some((Space::A, address, value)) => self.a[usize::from(address)] = value,
                    Some((Space::B, address, value)) => self.b[usize::from(address)] = value,
                    _ => {}
                }
                self.raise(irq::DCT);
            }
            // The mask ends by having been in the past.
            Due::MaskReceive => {}
            Due::NoResponse => self.raise(irq::NRE),
            Due::GeneralPurpose => self.raise(irq::GPE),
            Due::WakeUp => {
                // wto (32, bit 3): an interrupt at each time-out; without it the timer only measures, which is not
                // modelled.
                if self.a[reg::WAKE_UP] & 0x08 != 0 {
                    self.raise(irq::WT);
                }
            }
            Due::Answer => self.automatic_answer(),
        }
    }

    // --- interrupts ---

    pub(crate) fn mask(&self) -> u32 {
        u32::from_le_bytes([self.a[reg::MASK], self.a[reg::MASK + 1], self.a[reg::MASK + 2], self.a[reg::MASK + 3]])
    }

    pub(crate) fn raise(&mut self, bits: u32) {
        self.pin.raised(bits & !self.pending, self.now);
        self.pending |= bits;
        self.irq_changes();
    }

    // --- registers ---

    pub(crate) fn register(&self, space: Space, address: u8) -> u8 {
        let i = usize::from(address & 0x3F);
        match space {
            Space::A => match i {
                0x1A..=0x1D => self.pending.to_le_bytes()[i - reg::IRQ],
                0x1E => (self.fifo_level() & 0xFF) as u8,
                0x1F => {
                    let level = self.fifo_level();
                    (((level >> 8) & 0x03) << 6) as u8
                        | u8::from(self.fifo.underflow) << 5
                        | u8::from(self.fifo.overflow) << 4
                        | self.fifo.last_bits << 1
                }
                reg::RATE_DETECTED => {
                    self.a[i] & 0x30
                        | u8::from(self.running(Due::GeneralPurpose)) << 2
                        | u8::from(self.running(Due::NoResponse)) << 1
                        | u8::from(self.running(Due::MaskReceive))
                }
                0x31 => self.auxiliary_display(),
                0x3F => match self.config.variant {
                    Variant::St25r3916 => 0x2A,
                    Variant::St25r3916b => 0x31,
                },
                _ => self.a[i],
            },
            Space::B => self.b[i],
            Space::Test => self.test[i],
        }
    }

    fn auxiliary_display(&self) -> u8 {
        let detector = self.a[reg::OPERATION] & EN_FD;
        // Recorded: detector automatic and own field off reads en_peer. With the field on, automatic means collision
        // avoidance.
        let (peer, avoidance) = match detector {
            1 => (false, true),
            2 => (true, false),
            3 => (!self.field, self.field),
            _ => (false, false),
        };
        let target = self.a[reg::MODE] & TARGET != 0;
        let receiver = self.osc_ok && self.a[reg::OPERATION] & RX_EN != 0;
        let receiving = self.rx.as_ref().is_some_and(|r| r.locked);
        let rx_on =
            receiver && self.unmasked_since.is_some() && (target || self.field) && !self.running(Due::MaskReceive);
        u8::from(self.detected) << 6
            | u8::from(self.field) << 5
            | u8::from(self.osc_ok) << 4
            | u8::from(rx_on) << 3
            | u8::from(receiving) << 2
            | u8::from(peer) << 1
            | u8::from(avoidance)
    }

    /// A read has been shifted out: what it clears. `seen` is the value that went out.
    pub(crate) fn register_was_read(&mut self, space: Space, address: u8, seen: u8) {
        if space == Space::A && (0x1A..=0x1D).contains(&address) {
            let shift = 8 * u32::from(address - 0x1A);
            self.irqs_were_read(u32::from(seen) << shift);
        }
        if registers::class(self.config.variant, space, address) == registers::Class::Absent {
            self.note(Kind::NoSuchRegister(space, address));
        }
    }

    pub(crate) fn write_register(&mut self, space: Space, address: u8, value: u8) {
        match registers::class(self.config.variant, space, address) {
            registers::Class::Absent => return self.note(Kind::NoSuchRegister(space, address)),
            registers::Class::ReadOnly => return self.note(Kind::ReadOnlyWritten(space, address)),
            registers::Class::Unmodelled => {
                if value != registers::reset(space, address) {
                    self.note(Kind::UnmodelledRegister(space, address));
                }
            }
            registers::Class::Stored => {}
        }
        let value = value & registers::writable(space, address);
        let unmodelled = registers::unmodelled_bits(space, address, value);
        if unmodelled != 0 {
            self.note(Kind::UnmodelledBits(space, address, unmodelled));
        }
        let i = usize::from(address & 0x3F);
        match space {
            Space::B => self.b[i] = value,
            Space::Test => self.test[i] = value,
            Space::A => match i {
                reg::OPERATION => {
                    self.a[i] = value;
                    if value & 0x04 != 0 {
                        self.note(Kind::UnmodelledRegister(space, address));
                    }
                    self.operation_changed();
                }
                reg::MODE if !self.osc_ok => self.note(Kind::ModeWithoutOscillator),
                reg::MODE => {
                    self.changes_in_frame(address, value);
                    let entered = value & TARGET != 0 && self.a[i] & TARGET == 0;
                    self.a[i] = value;
                    self.abort_reception();
                    if entered || value & TARGET == 0 {
                        self.mask_idle();
                    }
                }
                reg::BIT_RATE => {
                    self.changes_in_frame(address, value);
                    let receives = (value ^ self.a[i]) & 0x03 != 0;
                    self.a[i] = value;
                    if receives {
                        self.abort_reception();
                    }
                }
                reg::IO2 | reg::TUNE_A | reg::TUNE_B => {
                    self.a[i] = value;
                    if i != reg::IO2 && self.antenna_in_use() {
                        self.tuning_suits();
                    }
                }
                0x16..=0x19 => {
                    self.a[i] = value;
                    self.irq_changes();
                }
                _ => self.a[i] = value,
            },
        }
    }

    /// 03 or 04 gets a value while a frame is on its way out or in.
    fn changes_in_frame(&mut self, address: u8, value: u8) {
        let on_its_way = self.tx.is_some() || self.rx.as_ref().is_some_and(|r| r.locked);
        if on_its_way && self.a[usize::from(address)] != value {
            self.note(Kind::ChangedInFrame(address));
        }
    }

    /// The receiver's mask when nobody has asked: a target waits for D1, a poller's receiver is open.
    pub(crate) fn mask_idle(&mut self) {
        let target = self.a[reg::MODE] & TARGET != 0;
        let waits = target && self.config.target_rearms_by_command;
        self.unmasked_since = (!waits).then_some(self.now);
    }

    fn set_default(&mut self) {
        self.abort_transmission();
        self.rx = None;
        self.a = RESET_A;
        self.b = RESET_B;
        self.b[0x2B] = self.config.driver_timing_display;
        self.test = [0; 64];
        self.pending = 0;
        self.fifo.clear();
        self.osc_ok = false;
        self.measuring = None;
        self.field_follows();
        self.detected = false;
        self.unmasked_since = Some(self.now);
        self.due = [NEVER; DUES.len()];
        self.next = NEVER;
        self.plan_hearing();
        self.irq_changes();
    }

    fn operation_changed(&mut self) {
        let operation = self.a[reg::OPERATION];
        if operation & EN == 0 {
            self.osc_ok = false;
            self.cancel(Due::Osc);
            for d in [Due::MaskReceive, Due::NoResponse, Due::GeneralPurpose, Due::CommandDone, Due::Answer] {
                self.cancel(d);
            }
            self.measuring = None;
            self.abort_transmission();
            self.abort_reception();
        } else if !self.osc_ok && !self.running(Due::Osc) {
            self.plan_in(Due::Osc, self.config.oscillator_startup_ns);
        }
        if operation & RX_EN == 0 {
            self.abort_reception();
        } else if self.osc_ok {
            self.supply_suits();
        }
        self.field_follows();
        if self.antenna_in_use() {
            self.tuning_suits();
        }
        self.look_for_field();
    }

    // --- field ---

    /// The own field is on when oscillator and transmitter are.
    fn field_follows(&mut self) {
        let on = self.powered && self.osc_ok && self.a[reg::OPERATION] & (EN | TX_EN) == EN | TX_EN;
        if on == self.field {
            return;
        }
        if on {
            self.field = true;
            self.supply_suits();
            self.tuning_suits();
            self.emit(AirEvent::FieldOn);
        } else {
            self.abort_transmission();
            self.abort_reception();
            self.cancel(Due::Apon);
            self.cancel(Due::Guard);
            self.field = false;
            self.emit(AirEvent::FieldOff);
        }
        self.look_for_field();
    }

    /// Starts the detector's delay when its output must change.
    pub(crate) fn look_for_field(&mut self) {
        let sees = self.sees_field();
        if sees == self.detected {
            self.cancel(Due::FieldDetect);
        } else if !self.running(Due::FieldDetect) {
            self.plan_in(Due::FieldDetect, self.config.field_detect_ns);
        }
    }

    fn sees_field(&self) -> bool {
        // Its own field blinds the detector.
        self.powered && self.outside && !self.field && self.a[reg::OPERATION] & EN_FD != 0
    }

    fn field_detected(&mut self) {
        let sees = self.sees_field();
        if sees != self.detected {
            self.detected = sees;
            self.raise(if sees { irq::EON } else { irq::EOF });
            if sees && self.running(Due::FieldOn) {
                self.field_avoided();
            }
        }
    }

    /// C8: listens for a foreign field during T_IDT + n T_RFW (4096 + n 512 carrier cycles), then switches its own on.
    /// A field that the detector sees at its start or at any instant of the window ends it.
    fn initial_field_on(&mut self) {
        if self.a[reg::OPERATION] & EN_FD == 0 {
            self.note(Kind::CollisionAvoidanceBlind);
        }
        if self.detected {
            return self.field_avoided();
        }
        let n = u64::from(self.a[reg::AUX] & 0x03);
        self.plan_in(Due::FieldOn, self.clock.cycles(4096 + n * 512));
    }

    /// Collision avoidance has seen a foreign field.
    fn field_avoided(&mut self) {
        self.cancel(Due::FieldOn);
        self.raise(irq::CAC);
    }

    fn field_after_avoidance(&mut self) {
        self.a[reg::OPERATION] |= TX_EN;
        self.field_follows();
        self.plan_in(Due::Apon, self.config.field_on_latency_ns);
        let steps = 1 + u64::from(self.b[reg::B_GUARD]);
        self.plan_in(Due::Guard, self.clock.cycles(steps * 1024) + self.config.guard_extra_ns);
    }

    // --- timers ---

    pub(crate) fn start_no_response(&mut self) {
        let n = u64::from(u16::from_be_bytes([self.a[reg::NO_RESPONSE], self.a[reg::NO_RESPONSE + 1]]));
        if n == 0 {
            return;
        }
        let step = if self.a[reg::TIMERS] & 0x01 != 0 { 4096 } else { 64 };
        self.plan_in(Due::NoResponse, self.clock.cycles(n * step) + self.config.no_response_extra_ns);
    }

    pub(crate) fn start_mask_receive(&mut self) {
        let step = if self.a[reg::TIMERS] & 0x08 != 0 { 512 } else { 64 };
        self.plan_in(Due::MaskReceive, self.clock.cycles(u64::from(self.a[reg::MASK_RECEIVE]) * step));
    }

    pub(crate) fn masking_receive(&self) -> bool {
        self.running(Due::MaskReceive)
    }

    fn start_general_purpose(&mut self) {
        let n = u64::from(u16::from_be_bytes([self.a[reg::GENERAL_PURPOSE], self.a[reg::GENERAL_PURPOSE + 1]]));
        self.plan_in(Due::GeneralPurpose, self.clock.cycles(n * 8));
    }

    /// The general purpose timer's trigger (12, gptc): 1 end of reception, 2 start of reception.
    pub(crate) fn general_purpose_trigger(&mut self, trigger: u8) {
        if self.a[reg::TIMERS] >> 5 == trigger {
            self.start_general_purpose();
        }
    }

    fn start_wake_up(&mut self) {
        let w = self.a[reg::WAKE_UP];
        // wur: 1 = 10 ms steps, 0 = 100 ms steps; wut: 1 to 8 of them. From the RC oscillator, taken as exact.
        let step = if w & 0x80 != 0 { 10_000_000 } else { 100_000_000 };
        self.plan_in(Due::WakeUp, step * (1 + u64::from((w >> 4) & 0x07)));
    }

    // --- commands ---

    pub(crate) fn command(&mut self, code: u8) {
        let needs_oscillator = matches!(code, 0xC4..=0xC9 | 0xD0..=0xDA | 0xDC..=0xDF | 0xE0 | 0xE2 | 0xE3 | 0xEA);
        if needs_oscillator && !self.osc_ok {
            return self.note(Kind::CommandWithoutOscillator(code));
        }
        match code {
            0xC0 | 0xC1 => self.set_default(),
            0xC2 | 0xC3 => self.stop_all(),
            0xC4 => self.transmit(true),
            0xC5 => self.transmit(false),
            0xC6 => self.transmit_short(0x26),
            0xC7 => self.transmit_short(0x52),
            0xC8 => self.initial_field_on(),
            0xD0 => {
                self.abort_reception();
                self.unmasked_since = None;
            }
            0xD1 => {
                // A frame already past its sync cannot be joined, one being received goes on.
                if self.unmasked_since.is_none() {
                    self.unmasked_since = Some(self.now);
                }
                self.cancel(Due::MaskReceive);
                self.check_silence();
                if self.antenna_in_use() {
                    self.tuning_suits();
                }
            }
            0xD3 => self.measure(reg::AD_RESULT as u8, self.config.amplitude),
            0xD9 => self.measure(reg::AD_RESULT as u8, self.config.phase),
            0xDF => self.measure_supply(),
            0xD5 => self.a[reg::GAIN] = 0,
            0xD6 => {
                self.supply_suits();
                // reg_s (2C, bit 7): the voltage is set by hand, and the display shows what was set.
                let shown = if self.a[reg::REGULATOR] & 0x80 != 0 {
                    (self.a[reg::REGULATOR] & 0x78) << 1
                } else {
                    self.config.regulator_display
                };
                self.measuring = Some((Space::B, 0x2C, shown));
                self.plan_in(Due::CommandDone, self.config.adjust_regulators_ns);
            }
            0xD8 => {
                self.measuring = Some((Space::B, 0x2B, self.config.driver_timing_display));
                self.plan_in(Due::CommandDone, self.config.measurement_ns);
            }
            0xDA => self.a[reg::RSSI] = 0,
            0xDB => {
                self.settle();
                self.disturb_transmission();
                self.fifo.clear();
                self.cancel(Due::TxLevel);
                self.plan_receive_level();
                if self.config.db_clears_irqs {
                    self.pending = 0;
                    self.irq_changes();
                }
            }
            0xE0 => self.start_general_purpose(),
            0xE1 => self.start_wake_up(),
            0xE2 => self.start_mask_receive(),
            0xE3 => self.start_no_response(),
            0xE8 => self.cancel(Due::NoResponse),
            0xEA if self.config.variant == Variant::St25r3916b => {
                self.measuring = Some((Space::B, 0x39, self.config.rc_calibration_display));
                self.plan_in(Due::CommandDone, self.config.rc_calibration_ns);
            }
            _ => self.note(Kind::UnmodelledCommand(code)),
        }
    }

    fn stop_all(&mut self) {
        self.abort_transmission();
        self.abort_reception();
        self.mask_idle();
        self.fifo.clear();
        if self.config.stop_clears_irqs {
            self.pending = 0;
            self.irq_changes();
        }
        self.measuring = None;
        for d in [
            Due::FieldOn,
            Due::Apon,
            Due::Guard,
            Due::CommandDone,
            Due::MaskReceive,
            Due::NoResponse,
            Due::GeneralPurpose,
            Due::WakeUp,
            Due::Answer,
        ] {
            self.cancel(d);
        }
    }

    pub(crate) fn measure(&mut self, address: u8, value: u8) {
        self.measuring = Some((Space::A, address, value));
        self.plan_in(Due::CommandDone, self.config.measurement_ns);
    }

    /// A target that is about to listen: can it answer by itself?
    fn check_silence(&mut self) {
        let target = self.a[reg::MODE] & TARGET != 0;
        // d_ac_ap2p, d_212_424_1r, d_106_ac_a
        let silent = self.a[reg::PASSIVE_TARGET] & 0x0D == 0x0D;
        if target && !silent && self.load_modulator() {
            self.note(Kind::AutomaticAnswersEnabled);
        }
    }

    /// Whether the load modulator is connected: lm_ext or lm_dri (B28).
    pub(crate) fn load_modulator(&self) -> bool {
        self.b[reg::B_AUX_MOD] & 0x30 != 0
    }
}
