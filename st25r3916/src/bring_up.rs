//! Bring-up of a chip in any role: a list of operations, carried out one at a time.
//!
//! # The list
//!
//! 1. Power ([`Part::Power`]): send set default; write the IO configuration; read the identity; write the overheat
//!    protection (ST25R3916 only); clear the interrupts by reading them; switch the oscillator on and wait for I_osc;
//!    calibrate RC and wait for I_dct (ST25R3916B only); set and clear `reg_s`; measure the supply, wait for I_dct and
//!    read the result; write the IO configuration for that supply; adjust the regulators and wait for I_dct.
//! 2. Write ([`Part::Write`]): write the role's [`Setting`]s, in order.
//! 3. Read back ([`Part::ReadBack`]): read back IO, regulator control and the same [`Setting`]s; each must read as
//!    written. While the chip runs they are read back again, one after each frame ([`BringUp::read_next`]).
//! 4. Operate ([`Part::Operate`]): switch the receiver or the field on, send the role's last commands, and read back
//!    operation control, mode and bit rate.
//!
//! The order of the first part is the data sheet's power-up sequence. Two more steps serve a chip in an unknown state.
//! The IO drivers are set before the identity is read, so that MISO is driven as strongly as in operation. The
//! interrupt registers are read once before the first wait, because the IRQ pin may have been high since before the
//! host's reset. The field stays off until every register has been read back.
//!
//! # Sources of the supply sequence
//!
//! The order (oscillator, calibration, measurement, `sup3V`, regulators), the source `mpsv` = VDD, the step of 23.4 mV
//! and the threshold of 3.6 V are the same in ST's library (stm32duino/ST25R3916, `src/st25r3916.cpp`), in Flipper Zero
//! (`targets/f7/furi_hal/furi_hal_nfc.c`) and in embassy-rs/rnfc (`rnfc-st25r39/src/lib.rs`). ST's library and rnfc
//! toggle `reg_s` before the adjustment. ST's library waits for I_dct after the RC calibration and continues if I_dct
//! does not come. This driver does so too, because it must not take a late I_dct of the calibration for the end of the
//! measurement.

use crate::command;
use crate::machine::{Fault, Input, Short};
use crate::register as reg;
use crate::{
    CALIBRATION_US, MEASUREMENT_US, OSCILLATOR_US, REGULATOR_US, SUPPLY_5V_MV, SUPPLY_MAX_MV, SUPPLY_MIN_MV, Variant,
};

/// The time after the end of a frame within which an answer's first bit may come, µs.
pub const WINDOW_US: u32 = 3_000;
/// The number of steps of 64/fc in the no-response timer: the window for an answer, preamble and sync (64 bits of
/// 32/fc), and one step of jitter (RFAL, `RFAL_FWT_ADJUSTMENT`).
pub(crate) const NO_RESPONSE_STEPS: u16 = {
    let cycles = (WINDOW_US * 1_356).div_ceil(100) + HEADER_FC + 64;
    cycles.div_ceil(64) as u16
};
/// The duration of preamble and sync at 424 kbit/s, in carrier periods.
const HEADER_FC: u32 = 64 * 32;

/// A read of the interrupt registers alone, for the time before the masks are set.
const IRQ_READ: Short = Short::new([command::READ | reg::IRQ_MAIN, 0, 0, 0, 0]);
/// A read of operation control, mode and bit rate, which a reset would change.
pub(crate) const CONFIGURATION_READ: Short = Short::new([command::READ | reg::OPERATION_CONTROL, 0, 0, 0]);
pub(crate) const DISPLAY_READ: Short = Short::new([command::READ | reg::AUXILIARY_DISPLAY, 0]);
/// The number of interrupts in a row, without the awaited bit, after which the IRQ pin counts as stuck.
pub(crate) const IDLE_IRQS: u8 = 8;
/// The shortest back-off, that is the pause before a bring-up, µs. Each fault doubles the back-off.
const BACK_OFF_US: u32 = 1_000;
/// The number of faults in a row after which the back-off no longer doubles: 1 ms · 2⁶ = 64 ms.
const BACK_OFF_STEPS: u8 = 7;

/// The state of a poller's receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReceiverMode {
    /// `rx_en` = 0: the receiver is off, so the chip itself guarantees that the poller does not listen.
    #[default]
    Off,
    /// `rx_en` = 1 and the receive data masked (D0), for a chip that does not raise I_txe while its receiver is off.
    OnMasked,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// A poller, which sends frames and never listens.
    Poller(ReceiverMode),
    /// A poller that sends frames and receives at most one answer to each.
    Exchange,
    /// A listener, which receives frames and cannot answer.
    Listener,
    /// A listener that receives frames and answers them.
    Answerer,
}

impl Role {
    /// The values of registers 02, 03 and 04 (operation control, mode, bit rate) while the chip operates.
    pub(crate) const fn configuration(self) -> [u8; 3] {
        // Not covered: the roles that the image's chip does not have. Each image has one role, the DPR with hold two,
        // but the compiler keeps the code for all.
        let [mode, rate] = match self {
            Self::Poller(_) | Self::Exchange => POLLER_MODE,
            Self::Listener | Self::Answerer => LISTENER_MODE,
        };
        // Not covered: the other roles, as above.
        let operation = match self {
            Self::Poller(ReceiverMode::Off) => reg::OP_EN | reg::OP_TX_EN,
            Self::Poller(ReceiverMode::OnMasked) | Self::Exchange => reg::OP_EN | reg::OP_RX_EN | reg::OP_TX_EN,
            Self::Listener | Self::Answerer => reg::OP_EN | reg::OP_RX_EN | reg::OP_FIELD_DETECTOR,
        };
        [operation, mode, rate]
    }

    /// # Errors
    /// [`Fault::Reset`] if the oscillator is not switched on, [`Fault::Register`] if another bit is wrong.
    pub(crate) fn check_configuration(self, response: &[u8]) -> Result<(), Fault> {
        match response {
            [_, operation, ..] if operation & reg::OP_EN == 0 => Err(Fault::Reset),
            [_, found @ ..] => check(reg::OPERATION_CONTROL, &self.configuration(), found),
            [] => Err(Fault::Bus),
        }
    }

    /// The settings that are written in this role before the chip goes on air, in order.
    const fn settings(self, variant: Variant) -> &'static [Setting] {
        // Not covered: the other roles, as in `configuration`.
        match (self, variant) {
            (Self::Poller(_), Variant::A) => &POLLER_A,
            (Self::Poller(_), Variant::B) => &POLLER_B,
            (Self::Exchange, Variant::A) => &EXCHANGE_A,
            (Self::Exchange, Variant::B) => &EXCHANGE_B,
            (Self::Listener, Variant::A) => &LISTENER_A,
            (Self::Listener, Variant::B) => &LISTENER_B,
            (Self::Answerer, Variant::A) => &ANSWERER_A,
            (Self::Answerer, Variant::B) => &ANSWERER_B,
        }
    }
}

/// Consecutive registers of one space and the values to write to them. The registers must read back these values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Setting {
    in_space_b: bool,
    address: u8,
    values: &'static [u8],
}

impl Setting {
    const fn a(address: u8, values: &'static [u8]) -> Self {
        Self { in_space_b: false, address, values }
    }

    const fn b(address: u8, values: &'static [u8]) -> Self {
        Self { in_space_b: true, address, values }
    }

    /// Returns a transfer that accesses the registers of this setting: operation mode and address, then `rest`.
    fn access(self, mode: u8, rest: &[u8]) -> Short {
        let head = [command::SPACE_B, mode | self.address];
        let from = usize::from(!self.in_space_b);
        // Not covered: the default: `from` is 0 or 1.
        Short::of(head.get(from..).unwrap_or(&head), rest)
    }

    fn write(self) -> Short {
        self.access(command::WRITE, self.values)
    }

    fn read(self) -> Short {
        const ZEROS: [u8; Short::MAX] = [0; Short::MAX];
        // Not covered: the default: no setting is longer than a transfer.
        self.access(command::READ, ZEROS.get(..self.values.len()).unwrap_or(&ZEROS))
    }

    /// # Errors
    /// [`Fault::Register`] names the first register that differs.
    fn check(self, response: &[u8]) -> Result<(), Fault> {
        let (head, space) = if self.in_space_b { (2, reg::SPACE_B) } else { (1, 0) };
        // Not covered: the default: a response is longer than its head.
        check(space | self.address, self.values, response.get(head..).unwrap_or(&[]))
    }
}

fn check(address: u8, set: &[u8], found: &[u8]) -> Result<(), Fault> {
    // Not covered: another length: a response is as long as its transfer, or the port reports that transfer as failed.
    if set.len() != found.len() {
        return Err(Fault::Bus);
    }
    // Not covered: a wrong value at some places of some settings, for which the compiler has made copies of the
    // comparison. Runs make single registers wrong, each of them at least in one copy.
    match (address..).zip(set.iter().zip(found)).find(|(_, (expected, found))| expected != found) {
        None => Ok(()),
        Some((address, (&expected, &found))) => Err(Fault::Register { address, expected, found }),
    }
}

/// Mode and bit rate of a poller: registers 03 and 04.
const POLLER_MODE: [u8; 2] = [reg::MODE_POLLER_NFC_F, reg::BIT_RATE_424];
/// Mode and bit rate of a listener: registers 03 and 04.
const LISTENER_MODE: [u8; 2] = [reg::MODE_LISTENER_NFC_F, reg::BIT_RATE_424];

const IO_5V: Setting =
    Setting::a(reg::IO_CONFIGURATION_1, &[reg::IO_1_NO_CLOCK, reg::IO_2_MISO | reg::IO_2_ANTENNA_TUNING]);
const IO_3V: Setting = Setting::a(
    reg::IO_CONFIGURATION_1,
    &[reg::IO_1_NO_CLOCK, reg::IO_2_MISO | reg::IO_2_ANTENNA_TUNING | reg::IO_2_SUPPLY_3V],
);
const REGULATOR_MANUAL: Setting = Setting::a(reg::REGULATOR_CONTROL, &[reg::REGULATOR_MANUAL]);
const REGULATOR_ADJUSTED: Setting = Setting::a(reg::REGULATOR_CONTROL, &[reg::REGULATOR_ADJUSTED_MEASURE_VDD]);

/// Auxiliary definition, receiver and mask-receive timer: registers 0A to 0F. A poller whose receiver is off sets them
/// too, so that its register values do not depend on [`ReceiverMode`].
const RECEIVER: Setting = Setting::a(
    reg::AUXILIARY,
    &[
        reg::AUXILIARY_CORRELATOR,
        reg::RECEIVER_1_NFC_F,
        reg::RECEIVER_2_NFC_F,
        reg::RECEIVER_3_NFC_F,
        reg::RECEIVER_4_NFC_F,
        reg::MASK_RECEIVE_SHORT,
    ],
);
/// The registers 0A to 0F of a poller with an ST25R3916 that receives answers.
const ANSWER_RECEIVER_A: Setting = Setting::a(reg::AUXILIARY, &answer_receiver(reg::RECEIVER_2_ANSWER_A));
/// The registers 0A to 0F of a poller with an ST25R3916B that receives answers.
const ANSWER_RECEIVER_B: Setting = Setting::a(reg::AUXILIARY, &answer_receiver(reg::RECEIVER_2_ANSWER_B));
const CORRELATOR: Setting = Setting::b(reg::B_CORRELATOR, &reg::CORRELATOR_NFC_F);

const fn answer_receiver(demodulator: u8) -> [u8; 6] {
    [
        reg::AUXILIARY_CORRELATOR,
        reg::RECEIVER_1_NFC_F,
        demodulator,
        reg::RECEIVER_3_NFC_F,
        reg::RECEIVER_4_NFC_F,
        reg::MASK_RECEIVE_GUARD,
    ]
}

/// Active wave shaping of the ST25R3916B, which shapes and limits its amplitude modulation.
const WAVE_SHAPING: Setting = Setting::b(reg::B_WAVE_SHAPING, &reg::WAVE_SHAPING_NFC_F);
const WAVE_SHAPING_TIMES: Setting = Setting::b(reg::B_WAVE_SHAPING_TIMES, &reg::WAVE_SHAPING_TIMES_NFC_F);
const DRIVER_NON_OVERLAP: Setting = Setting::b(reg::B_DRIVER_NON_OVERLAP, &[reg::DRIVER_NON_OVERLAP_LEAST]);
const NFC_F_MODE: Setting = Setting::a(reg::MODE, &POLLER_MODE);
const PREAMBLE: Setting = Setting::a(reg::NFC_F_PREAMBLE, &[reg::PREAMBLE_48]);

/// The settings that differ between a poller that never listens and one that receives answers.
#[derive(Clone, Copy)]
struct Polling {
    receiver: Setting,
    no_response_timer: Setting,
    masks: Setting,
}

const SILENT: Polling = Polling {
    receiver: RECEIVER,
    no_response_timer: Setting::a(reg::NO_RESPONSE_TIMER, &[0, 0]),
    masks: Setting::a(reg::IRQ_MASK_MAIN, &reg::POLLER_MASKS),
};
const ANSWERED_A: Polling = Polling {
    receiver: ANSWER_RECEIVER_A,
    no_response_timer: Setting::a(reg::NO_RESPONSE_TIMER, &ANSWER_WINDOW),
    masks: Setting::a(reg::IRQ_MASK_MAIN, &reg::EXCHANGE_MASKS),
};
const ANSWERED_B: Polling = Polling { receiver: ANSWER_RECEIVER_B, ..ANSWERED_A };

/// Registers 10 to 12, the no-response timer and the timer control, set so that the timer ends the wait for an answer.
const ANSWER_WINDOW: [u8; 3] = {
    let [high, low] = NO_RESPONSE_STEPS.to_be_bytes();
    [high, low, reg::TIMERS_64_FC]
};

const POLLER_A: [Setting; 10] = poller_a(SILENT);
const POLLER_B: [Setting; 12] = poller_b(SILENT);
const EXCHANGE_A: [Setting; 10] = poller_a(ANSWERED_A);
const EXCHANGE_B: [Setting; 12] = poller_b(ANSWERED_B);

const fn poller_a(polling: Polling) -> [Setting; 10] {
    [
        NFC_F_MODE,
        PREAMBLE,
        polling.receiver,
        CORRELATOR,
        polling.no_response_timer,
        Setting::a(reg::ANTENNA_TUNING, &reg::ANTENNA_TUNING_POLLER_A),
        Setting::a(reg::TRANSMIT_DRIVER, &[reg::TRANSMIT_DRIVER_12_PERCENT_A]),
        Setting::b(reg::B_AUXILIARY_MODULATION, &[reg::AM_BY_REGULATOR_A]),
        DRIVER_NON_OVERLAP,
        polling.masks,
    ]
}

const fn poller_b(polling: Polling) -> [Setting; 12] {
    [
        NFC_F_MODE,
        PREAMBLE,
        polling.receiver,
        CORRELATOR,
        polling.no_response_timer,
        Setting::a(reg::ANTENNA_TUNING, &reg::ANTENNA_TUNING_POLLER_B),
        Setting::a(reg::TRANSMIT_DRIVER, &[reg::TRANSMIT_DRIVER_12_PERCENT_B]),
        Setting::b(reg::B_AUXILIARY_MODULATION, &[reg::AM_BY_WAVE_SHAPING_B]),
        DRIVER_NON_OVERLAP,
        WAVE_SHAPING,
        WAVE_SHAPING_TIMES,
        polling.masks,
    ]
}

/// The settings that differ between a listener that cannot answer and one that answers.
#[derive(Clone, Copy)]
struct Listening {
    load_modulation: Setting,
    driver: Setting,
    masks: Setting,
}

const MUTE: Listening = Listening {
    load_modulation: Setting::a(reg::PASSIVE_TARGET_MODULATION, &[reg::PASSIVE_TARGET_HIGH_Z]),
    driver: Setting::b(reg::B_AUXILIARY_MODULATION, &[reg::NO_LOAD_MODULATION]),
    masks: Setting::a(reg::IRQ_MASK_MAIN, &reg::LISTENER_MASKS),
};
const ANSWERING_A: Listening = Listening {
    load_modulation: Setting::a(reg::PASSIVE_TARGET_MODULATION, &[reg::PASSIVE_TARGET_ANSWERS_A]),
    driver: Setting::b(reg::B_AUXILIARY_MODULATION, &[reg::LOAD_MODULATION_BY_DRIVER_A]),
    masks: Setting::a(reg::IRQ_MASK_MAIN, &reg::ANSWERER_MASKS),
};
const ANSWERING_B: Listening = Listening {
    load_modulation: Setting::a(reg::PASSIVE_TARGET_MODULATION, &[reg::PASSIVE_TARGET_ANSWERS_B]),
    driver: Setting::b(reg::B_AUXILIARY_MODULATION, &[reg::LOAD_MODULATION_BY_DRIVER_B]),
    ..ANSWERING_A
};

const LISTENER_A: [Setting; 9] = listener(MUTE, &reg::ANTENNA_TUNING_LISTENER_A);
const LISTENER_B: [Setting; 9] = listener(MUTE, &reg::ANTENNA_TUNING_LISTENER_B);
const ANSWERER_A: [Setting; 9] = listener(ANSWERING_A, &reg::ANTENNA_TUNING_LISTENER_A);
/// The settings of an ST25R3916B that answers. The supply of its antenna driver is set as for a poller, as in ST's
/// library.
const ANSWERER_B: [Setting; 10] = {
    let [silent, modulation, driver, antenna, field, receiver, correlator, masks, mode] =
        listener(ANSWERING_B, &reg::ANTENNA_TUNING_LISTENER_B);
    let supply = Setting::b(reg::B_WAVE_SHAPING, &[reg::WAVE_SHAPING_SUPPLY]);
    [silent, modulation, driver, supply, antenna, field, receiver, correlator, masks, mode]
};

/// The settings of a listener. Automatic answers are disabled and load modulation is set before the mode is set.
const fn listener(listening: Listening, antenna: &'static [u8]) -> [Setting; 9] {
    [
        Setting::a(reg::PASSIVE_TARGET, &[reg::PASSIVE_TARGET_SILENT]),
        listening.load_modulation,
        listening.driver,
        Setting::a(reg::ANTENNA_TUNING, antenna),
        Setting::a(reg::FIELD_THRESHOLDS, &reg::FIELD_THRESHOLDS_WITH_HYSTERESIS),
        RECEIVER,
        CORRELATOR,
        listening.masks,
        Setting::a(reg::MODE, &LISTENER_MODE),
    ]
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Power,
    Write,
    ReadBack,
    Operate,
}

enum Operation {
    /// Sends a command or a write; the response is ignored.
    Send(Short),
    /// Sends a command or a write, then waits for the interrupt that reports its end.
    Run(Short, Awaited),
    Identify,
    ReadSupply,
    /// Reads back the registers of a setting.
    ReadBack(Setting),
    /// Reads back operation control, mode and bit rate.
    Verify,
    /// Does nothing, because this type of chip needs no operation at this point.
    Skip,
    End,
}

#[derive(Clone, Copy)]
enum Awaited {
    Oscillator,
    Calibration,
    Measurement,
    Regulator,
}

impl Awaited {
    /// The longest wait for the interrupt, µs.
    const fn limit_us(self) -> u32 {
        match self {
            Self::Oscillator => OSCILLATOR_US,
            Self::Calibration => CALIBRATION_US,
            Self::Measurement => MEASUREMENT_US,
            Self::Regulator => REGULATOR_US,
        }
    }

    /// The fault if the interrupt does not come in time. `None` for the RC calibration: without the interrupt the chip
    /// falls back to a default.
    const fn fault(self) -> Option<Fault> {
        match self {
            Self::Oscillator => Some(Fault::Oscillator),
            Self::Calibration => None,
            Self::Measurement => Some(Fault::SupplyMeasurement),
            Self::Regulator => Some(Fault::Regulator),
        }
    }

    const fn is_in(self, main: u8, timer: u8) -> bool {
        match self {
            Self::Oscillator => main & reg::IRQ_OSCILLATOR != 0,
            Self::Calibration | Self::Measurement | Self::Regulator => timer & reg::IRQ_DCT != 0,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The transfer of the operation is in progress.
    Sent,
    /// The awaited interrupt has not come yet.
    Waiting,
    /// The interrupt registers are being read. `last` means that the time limit of the wait is over.
    Reading { last: bool },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    Transfer(Short),
    /// The machine waits for the IRQ pin, at most this many µs.
    Wait(u32),
    Finished,
    Failed(Fault),
}

#[derive(Clone, Debug)]
pub(crate) struct BringUp {
    role: Role,
    variant: Option<Variant>,
    supply_mv: Option<u16>,
    part: Part,
    index: u8,
    phase: Phase,
    /// The number of interrupts in a row without the awaited bit.
    idle_irqs: u8,
    failures: u8,
    /// The index of the setting that is read back next while the chip runs.
    rotation: u8,
}

impl BringUp {
    pub(crate) const fn new(role: Role) -> Self {
        Self {
            role,
            variant: None,
            supply_mv: None,
            part: Part::Power,
            index: 0,
            phase: Phase::Sent,
            idle_irqs: 0,
            failures: 0,
            rotation: 0,
        }
    }

    pub(crate) const fn role(&self) -> Role {
        self.role
    }

    pub(crate) const fn variant(&self) -> Option<Variant> {
        self.variant
    }

    pub(crate) const fn supply_mv(&self) -> Option<u16> {
        self.supply_mv
    }

    /// Records a fault, which doubles the next back-off (up to 64 ms).
    pub(crate) const fn failed(&mut self) {
        // Not covered: the copies of this for faults that never come seven times in a row: those of the executor never
        // come at all, and those behind a frame come behind one that resets the count.
        if self.failures < BACK_OFF_STEPS {
            self.failures += 1;
        }
    }

    /// The back-off before the next bring-up, µs: 1 ms after the first fault.
    pub(crate) const fn back_off_us(&self) -> u32 {
        BACK_OFF_US << self.failures.saturating_sub(1)
    }

    /// Records that the link works, so that the next back-off is the shortest again. Not called at the end of bring-up:
    /// a chip that resets right after each bring-up must also be given a back-off.
    pub(crate) const fn works(&mut self) {
        self.failures = 0;
    }

    pub(crate) fn begin(&mut self) -> Progress {
        self.part = Part::Power;
        self.index = 0;
        self.rotation = 0;
        self.variant = None;
        self.supply_mv = None;
        self.issue()
    }

    pub(crate) fn step(&mut self, input: Input<'_>) -> Progress {
        // Not covered: only this line, inputs that a phase does not wait for, which the executor never gives.
        match (self.phase, input) {
            (_, Input::Failed) => Progress::Failed(Fault::Bus),
            // Not covered: a response of another length, as in `check`, and in HORUS and the hold a register that has
            // lost the bit for the oscillator while the chip is brought up.
            (Phase::Sent, Input::Done(response)) => self.answered(response),
            (Phase::Waiting, Input::Irq) => self.read_irqs(false),
            (Phase::Waiting, Input::Timeout) => self.read_irqs(true),
            // Not covered: the operations' faults that a chip does not have in this role, and the end of the
            // interrupts' count for operations whose interrupt always comes.
            (Phase::Reading { last }, Input::Done(response)) => self.irqs(response, last),
            _ => Progress::Failed(Fault::Executor),
        }
    }

    fn read_irqs(&mut self, last: bool) -> Progress {
        self.phase = Phase::Reading { last };
        Progress::Transfer(IRQ_READ)
    }

    fn irqs(&mut self, response: &[u8], last: bool) -> Progress {
        // Not covered: another length, as in `check`.
        let &[_, main, timer, _, _] = response else {
            return Progress::Failed(Fault::Bus);
        };
        // Not covered: another operation: interrupts are read only for one that waits for them.
        let Operation::Run(_, awaited) = self.operation() else {
            return Progress::Failed(Fault::Executor);
        };
        if awaited.is_in(main, timer) {
            return self.advance();
        }
        if last {
            return match awaited.fault() {
                Some(fault) => Progress::Failed(fault),
                None => self.advance(),
            };
        }
        self.idle_irqs += 1;
        if self.idle_irqs >= IDLE_IRQS {
            return Progress::Failed(Fault::IrqStuck);
        }
        self.wait(awaited)
    }

    fn wait(&mut self, awaited: Awaited) -> Progress {
        self.phase = Phase::Waiting;
        Progress::Wait(awaited.limit_us())
    }

    fn answered(&mut self, response: &[u8]) -> Progress {
        match self.operation() {
            Operation::Run(_, awaited) => {
                self.idle_irqs = 0;
                return self.wait(awaited);
            }
            Operation::Identify => match response {
                // Not covered: another length, as in `check`.
                [_, 0x00 | 0xFF] => return Progress::Failed(Fault::Absent),
                &[_, identity] => {
                    self.variant = match identity & reg::IDENTITY_TYPE {
                        reg::IDENTITY_A => Some(Variant::A),
                        reg::IDENTITY_B => Some(Variant::B),
                        _ => return Progress::Failed(Fault::Identity(identity)),
                    }
                }
                _ => return Progress::Failed(Fault::Bus),
            },
            Operation::ReadSupply => {
                // Not covered: another length, as in `check`.
                let &[_, steps] = response else {
                    return Progress::Failed(Fault::Bus);
                };
                let millivolts = supply_mv(steps);
                if !(SUPPLY_MIN_MV..=SUPPLY_MAX_MV).contains(&millivolts) {
                    return Progress::Failed(Fault::SupplyOutOfRange { millivolts });
                }
                self.supply_mv = Some(millivolts);
            }
            Operation::ReadBack(setting) => {
                if let Err(fault) = setting.check(response) {
                    return Progress::Failed(fault);
                }
            }
            Operation::Verify => {
                if let Err(fault) = self.role.check_configuration(response) {
                    return Progress::Failed(fault);
                }
            }
            _ => {}
        }
        self.advance()
    }

    fn advance(&mut self) -> Progress {
        self.index += 1;
        self.issue()
    }

    /// Issues the operation at `index`, or the next one if this type of chip does not need that operation. No two
    /// operations in a row are skipped and each part has an operation, so the loop runs at most three times.
    fn issue(&mut self) -> Progress {
        self.phase = Phase::Sent;
        loop {
            return Progress::Transfer(match self.operation() {
                Operation::Send(short) | Operation::Run(short, _) => short,
                Operation::Identify => const { Short::new([command::READ | reg::IDENTITY, 0]) },
                Operation::ReadSupply => const { Short::new([command::READ | reg::AD_RESULT, 0]) },
                Operation::ReadBack(setting) => setting.read(),
                Operation::Verify => CONFIGURATION_READ,
                Operation::Skip => {
                    self.index += 1;
                    continue;
                }
                Operation::End => {
                    self.part = match self.part {
                        Part::Power => Part::Write,
                        Part::Write => Part::ReadBack,
                        Part::ReadBack => Part::Operate,
                        Part::Operate => return Progress::Finished,
                    };
                    self.index = 0;
                    continue;
                }
            });
        }
    }

    /// The IO configuration for the measured supply, or for 5 V before the measurement.
    fn io(&self) -> Setting {
        // Not covered: a supply of 3 V: each board supplies its chips from 5 V.
        match self.supply_mv {
            Some(millivolts) if millivolts < SUPPLY_5V_MV => IO_3V,
            _ => IO_5V,
        }
    }

    fn operation(&self) -> Operation {
        // Bring-up reads the chip's type before every operation that depends on it, and fails if the type is unknown.
        // So the default is never used.
        let variant = self.variant.unwrap_or(Variant::A);
        match self.part {
            Part::Power => self.power(variant),
            // Not covered: the other roles, as in `setting`.
            Part::Write => match self.setting(variant, self.index) {
                Some(setting) => Operation::Send(setting.write()),
                None => Operation::End,
            },
            // Not covered: the other roles, as in `setting`.
            Part::ReadBack => match self.in_force(self.index) {
                Some(setting) => Operation::ReadBack(setting),
                None => Operation::End,
            },
            // Not covered: the other roles, as in `operate`.
            Part::Operate => self.operate(),
        }
    }

    /// The setting at `index` among those that are read back. Operation control is not among them, because
    /// [`CONFIGURATION_READ`] covers it.
    fn in_force(&self, index: u8) -> Option<Setting> {
        match index {
            // Not covered: a supply of 3 V, as in `io`.
            0 => Some(self.io()),
            1 => Some(REGULATOR_ADJUSTED),
            index => self.setting(self.variant.unwrap_or(Variant::A), index - 2),
        }
    }

    /// The setting to read back next. After the last one comes `None`, which means operation control, mode and bit
    /// rate.
    fn turn(&self) -> Option<Setting> {
        self.in_force(self.rotation)
    }

    /// The transfer that reads the next setting back. To be made once for each frame.
    pub(crate) fn read_next(&self) -> Short {
        // Not covered: the other roles, as in `setting`.
        self.turn().map_or(CONFIGURATION_READ, Setting::read)
    }

    /// # Errors
    /// [`Fault::Register`] if a register differs from its setting, or the errors of [`Role::check_configuration`].
    pub(crate) fn check_next(&mut self, response: &[u8]) -> Result<(), Fault> {
        // Not covered: only this line, the other roles, as in `setting`.
        match self.turn() {
            Some(setting) => {
                self.rotation += 1;
                setting.check(response)
            }
            None => {
                self.rotation = 0;
                // Not covered: a response of another length, as in `check`, and a register that has lost the bit for
                // the oscillator: in these runs `CONFIGURATION_READ` finds it first.
                self.role.check_configuration(response)
            }
        }
    }

    fn setting(&self, variant: Variant, index: u8) -> Option<Setting> {
        // Not covered: the other roles, for each of which the compiler has made a copy of this access.
        self.role.settings(variant).get(usize::from(index)).copied()
    }

    fn power(&self, variant: Variant) -> Operation {
        const OVERHEAT: Short =
            Short::new([command::SPACE_TEST, command::WRITE | reg::TEST_OVERHEAT, reg::TEST_OVERHEAT_PROTECTION]);
        const OSCILLATOR_ON: Short = Short::new([command::WRITE | reg::OPERATION_CONTROL, reg::OP_EN]);
        match (self.index, variant) {
            (0, _) => Operation::Send(command::SET_DEFAULT),
            (1 | 11, _) => Operation::Send(self.io().write()),
            (2, _) => Operation::Identify,
            (3, Variant::A) => Operation::Send(OVERHEAT),
            (4, _) => Operation::Send(IRQ_READ),
            (5, _) => Operation::Run(OSCILLATOR_ON, Awaited::Oscillator),
            (6, Variant::B) => Operation::Run(command::RC_CALIBRATION, Awaited::Calibration),
            (3 | 6, _) => Operation::Skip,
            (7, _) => Operation::Send(REGULATOR_MANUAL.write()),
            (8, _) => Operation::Send(REGULATOR_ADJUSTED.write()),
            (9, _) => Operation::Run(command::MEASURE_SUPPLY, Awaited::Measurement),
            (10, _) => Operation::ReadSupply,
            (12, _) => Operation::Run(command::ADJUST_REGULATORS, Awaited::Regulator),
            _ => Operation::End,
        }
    }

    fn operate(&self) -> Operation {
        let [operation, ..] = self.role.configuration();
        let on = Short::new([command::WRITE | reg::OPERATION_CONTROL, operation]);
        // Not covered: the other roles, as in `configuration`.
        match (self.index, self.role) {
            (0, _) => Operation::Send(on),
            (1, Role::Poller(ReceiverMode::Off)) => Operation::Skip,
            (1, Role::Poller(ReceiverMode::OnMasked) | Role::Exchange) => Operation::Send(command::MASK_RECEIVE_DATA),
            (1, Role::Listener | Role::Answerer) => Operation::Send(command::CLEAR_FIFO),
            (2, Role::Listener | Role::Answerer) => Operation::Send(command::UNMASK_RECEIVE_DATA),
            (2, Role::Poller(_) | Role::Exchange) | (3, Role::Listener | Role::Answerer) => Operation::Verify,
            _ => Operation::End,
        }
    }
}

/// Converts a result of the supply measurement to mV: steps of 23.4 mV, rounded.
const fn supply_mv(steps: u8) -> u16 {
    (steps as u16 * 234 + 5) / 10
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests {
    use super::*;

    const LISTS: [&[Setting]; 9] = [
        &POLLER_A,
        &POLLER_B,
        &EXCHANGE_A,
        &EXCHANGE_B,
        &LISTENER_A,
        &LISTENER_B,
        &ANSWERER_A,
        &ANSWERER_B,
        &[IO_5V, IO_3V, REGULATOR_MANUAL, REGULATOR_ADJUSTED],
    ];

    #[test]
    fn every_setting_fits_one_transfer_whole() {
        for setting in LISTS.into_iter().flatten() {
            let head = if setting.in_space_b { 2 } else { 1 };
            assert_eq!(setting.write().bytes().len(), head + setting.values.len(), "{setting:?}");
            assert_eq!(setting.read().bytes().len(), head + setting.values.len(), "{setting:?}");
            assert!(setting.write().bytes().ends_with(setting.values));
        }
    }

    #[test]
    fn a_setting_stands_only_if_every_register_reads_as_written() {
        for setting in LISTS.into_iter().flatten() {
            let head = if setting.in_space_b { 2 } else { 1 };
            let end = head + setting.values.len();
            let mut response = [0; Short::MAX];
            response[head..end].copy_from_slice(setting.values);
            assert_eq!(setting.check(&response[..end]), Ok(()));
            for place in head..end {
                response[place] ^= 0x10;
                let expected = setting.values[place - head];
                let address = setting.address + (place - head) as u8 + if setting.in_space_b { 0x40 } else { 0 };
                let fault = Fault::Register { address, expected, found: expected ^ 0x10 };
                assert_eq!(setting.check(&response[..end]), Err(fault), "{setting:?}");
                response[place] ^= 0x10;
            }
            assert_eq!(setting.check(&response[..end - 1]), Err(Fault::Bus));
        }
    }

    #[test]
    fn the_roles_settings_agree_with_what_is_checked_in_operation() {
        for role in [
            Role::Poller(ReceiverMode::Off),
            Role::Poller(ReceiverMode::OnMasked),
            Role::Exchange,
            Role::Listener,
            Role::Answerer,
        ] {
            for variant in [Variant::A, Variant::B] {
                let mode = role.settings(variant).iter().find(|setting| setting.address == reg::MODE).unwrap();
                assert_eq!(mode.values, &role.configuration()[1..]);
            }
        }
    }

    #[test]
    fn a_step_of_the_measurement_is_23_4_millivolts() {
        for (steps, millivolts) in [(0, 0), (1, 23), (5, 117), (103, 2_410), (141, 3_299), (214, 5_008), (255, 5_967)] {
            assert_eq!(supply_mv(steps), millivolts);
        }
    }

    // Shows FE-3.
    #[test]
    fn back_off_doubles_from_1_ms_and_stays_at_64_ms() {
        let mut list = BringUp::new(Role::Listener);
        for us in [1_000, 2_000, 4_000, 8_000, 16_000, 32_000, 64_000, 64_000, 64_000] {
            list.failed();
            assert_eq!(list.back_off_us(), us);
        }
        list.works();
        list.failed();
        assert_eq!(list.back_off_us(), 1_000);
    }
}
