//! Bring-up of either role: one list of operations, walked one at a time.
//!
//! The order is the data sheet's power-up sequence (set default, IO, oscillator, calibration,
//! regulators), then the role's registers, then a read-back. Two things are done that a chip in
//! order would not need: the IO drivers are set before the identity is read, so that MISO is driven
//! as strongly as in operation when it is first relied on; and the interrupt registers are read once
//! before the first wait, because the IRQ pin may have been high since before the host's reset.

use crate::command;
use crate::machine::{Fault, Input, Short};
use crate::poller::Receiver;
use crate::register as reg;
use crate::{OSCILLATOR_MICROS, REGULATOR_MICROS, Supply, Variant};

/// The interrupt registers alone, for the time before the masks are set.
const IRQ_READ: Short = Short::new([command::READ | reg::IRQ_MAIN, 0, 0, 0, 0]);
/// Operation control, mode and bit rate: what a reset would change.
pub(crate) const CONFIGURATION_READ: Short = Short::new([command::READ | reg::OPERATION_CONTROL, 0, 0, 0]);
/// Interrupts without the awaited bit before the pin is called stuck.
pub(crate) const IDLE_IRQS: u8 = 8;
/// The shortest back-off before a bring-up, in microseconds; doubled by each failure.
const BACK_OFF_MICROS: u32 = 1_000;
/// Back-off stops doubling at the seventh fault in a row: 1 ms · 2⁶ = 64 ms.
const BACK_OFF_STEPS: u8 = 7;

/// What the chip is brought up as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    Poller(Receiver),
    Listener,
}

impl Role {
    /// Registers 02, 03 and 04 as they read in operation.
    pub(crate) const fn configuration(self) -> [u8; 3] {
        match self {
            Self::Poller(Receiver::Off) => [reg::OP_EN | reg::OP_TX_EN, reg::MODE_POLLER_NFC_F, reg::BIT_RATE_424],
            Self::Poller(Receiver::OnMasked) => {
                [reg::OP_EN | reg::OP_RX_EN | reg::OP_TX_EN, reg::MODE_POLLER_NFC_F, reg::BIT_RATE_424]
            }
            Self::Listener => {
                [reg::OP_EN | reg::OP_RX_EN | reg::OP_FIELD_DETECTOR, reg::MODE_LISTENER_NFC_F, reg::BIT_RATE_424]
            }
        }
    }

    /// Whether a [`CONFIGURATION_READ`] found the registers as they were set.
    pub(crate) fn configuration_stands(self, response: &[u8]) -> bool {
        matches!(response, [_, found @ ..] if *found == self.configuration())
    }
}

/// One entry of the list.
enum Operation {
    /// A command or a write; the response means nothing.
    Send(Short),
    /// Read the identity.
    Identify,
    /// Wait for an interrupt: I_osc in the main register or I_dct in the timer register.
    Await(Awaited),
    /// Read the configuration back.
    Verify,
    /// Nothing for this part or configuration.
    Skip,
    /// The list is over.
    End,
}

#[derive(Clone, Copy)]
enum Awaited {
    Oscillator,
    Regulator,
}

impl Awaited {
    const fn micros(self) -> u32 {
        match self {
            Self::Oscillator => OSCILLATOR_MICROS,
            Self::Regulator => REGULATOR_MICROS,
        }
    }

    const fn fault(self) -> Fault {
        match self {
            Self::Oscillator => Fault::Oscillator,
            Self::Regulator => Fault::Regulator,
        }
    }

    const fn is_in(self, main: u8, timer: u8) -> bool {
        match self {
            Self::Oscillator => main & reg::IRQ_OSCILLATOR != 0,
            Self::Regulator => timer & reg::IRQ_DCT != 0,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The operation's transfer is under way.
    Sent,
    /// The awaited interrupt is outstanding.
    Waiting,
    /// The interrupt registers are being read; `last`: the wait's time is over.
    Reading { last: bool },
}

/// What bring-up wants next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    Transfer(Short),
    Wait(u32),
    Finished(Variant),
    Failed(Fault),
}

#[derive(Clone, Debug)]
pub(crate) struct BringUp {
    role: Role,
    supply: Supply,
    variant: Option<Variant>,
    index: u8,
    phase: Phase,
    /// Interrupts in a row that were not the awaited one.
    idle_irqs: u8,
    failures: u8,
}

impl BringUp {
    pub(crate) const fn new(role: Role, supply: Supply) -> Self {
        Self { role, supply, variant: None, index: 0, phase: Phase::Sent, idle_irqs: 0, failures: 0 }
    }

    pub(crate) const fn role(&self) -> Role {
        self.role
    }

    pub(crate) const fn variant(&self) -> Option<Variant> {
        self.variant
    }

    /// A fault was reported: the next back-off is twice as long, up to 64 ms.
    pub(crate) const fn failed(&mut self) {
        if self.failures < BACK_OFF_STEPS {
            self.failures += 1;
        }
    }

    /// The time to wait before the next bring-up, in microseconds: 1 ms after the first fault.
    pub(crate) const fn back_off(&self) -> u32 {
        BACK_OFF_MICROS << self.failures.saturating_sub(1)
    }

    /// The link works: the next back-off is the shortest again. Not called at the end of bring-up, so
    /// that a chip that resets right after each bring-up is not hammered.
    pub(crate) const fn works(&mut self) {
        self.failures = 0;
    }

    pub(crate) fn begin(&mut self) -> Progress {
        self.index = 0;
        self.variant = None;
        self.issue()
    }

    pub(crate) fn step(&mut self, input: Input<'_>) -> Progress {
        match (self.phase, input) {
            (_, Input::Failed) => Progress::Failed(Fault::Bus),
            (Phase::Sent, Input::Done(response)) => self.answered(response),
            (Phase::Waiting, Input::Irq) => self.read_irqs(false),
            (Phase::Waiting, Input::Timeout) => self.read_irqs(true),
            (Phase::Reading { last }, Input::Done(response)) => self.irqs(response, last),
            _ => Progress::Failed(Fault::Executor),
        }
    }

    fn read_irqs(&mut self, last: bool) -> Progress {
        self.phase = Phase::Reading { last };
        Progress::Transfer(IRQ_READ)
    }

    fn irqs(&mut self, response: &[u8], last: bool) -> Progress {
        let &[_, main, timer, _, _] = response else {
            return Progress::Failed(Fault::Bus);
        };
        let Operation::Await(awaited) = self.operation() else {
            return Progress::Failed(Fault::Executor);
        };
        if awaited.is_in(main, timer) {
            return self.advance();
        }
        if last {
            return Progress::Failed(awaited.fault());
        }
        self.idle_irqs += 1;
        if self.idle_irqs >= IDLE_IRQS {
            return Progress::Failed(Fault::IrqStuck);
        }
        self.phase = Phase::Waiting;
        Progress::Wait(awaited.micros())
    }

    fn answered(&mut self, response: &[u8]) -> Progress {
        match self.operation() {
            Operation::Identify => match response {
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
            Operation::Verify if !self.role.configuration_stands(response) => {
                return Progress::Failed(Fault::Configuration);
            }
            _ => {}
        }
        self.advance()
    }

    fn advance(&mut self) -> Progress {
        self.index += 1;
        self.issue()
    }

    /// Issues the operation at `index`, or the first after it that this part needs. The list has no
    /// more than one entry to skip in a row, so this is constant time.
    fn issue(&mut self) -> Progress {
        let mut operation = self.operation();
        if matches!(operation, Operation::Skip) {
            self.index += 1;
            operation = self.operation();
        }
        self.phase = Phase::Sent;
        match operation {
            Operation::Send(short) => Progress::Transfer(short),
            Operation::Identify => Progress::Transfer(const { Short::new([command::READ | reg::IDENTITY, 0]) }),
            Operation::Verify => Progress::Transfer(CONFIGURATION_READ),
            Operation::Await(awaited) => {
                self.phase = Phase::Waiting;
                self.idle_irqs = 0;
                Progress::Wait(awaited.micros())
            }
            Operation::Skip | Operation::End => match self.variant {
                Some(variant) => Progress::Finished(variant),
                None => Progress::Failed(Fault::Configuration),
            },
        }
    }

    fn operation(&self) -> Operation {
        let is_b = matches!(self.variant, Some(Variant::B));
        match self.index {
            0 => Operation::Send(command::SET_DEFAULT),
            1 => Operation::Send(write([
                reg::IO_CONFIGURATION_1,
                reg::IO_1_NO_CLOCK,
                match self.supply {
                    Supply::Volts5 => reg::IO_2_MISO,
                    Supply::Volts3 => reg::IO_2_MISO | reg::IO_2_SUPPLY_3V,
                },
            ])),
            2 => Operation::Identify,
            3 if is_b => Operation::Skip,
            3 => Operation::Send(
                const {
                    Short::new([
                        command::SPACE_TEST,
                        command::WRITE | reg::TEST_OVERHEAT,
                        reg::TEST_OVERHEAT_PROTECTION,
                    ])
                },
            ),
            4 => Operation::Send(IRQ_READ),
            5 => Operation::Send(const { write([reg::OPERATION_CONTROL, reg::OP_EN]) }),
            6 => Operation::Await(Awaited::Oscillator),
            7 if is_b => Operation::Send(command::RC_CALIBRATION),
            7 => Operation::Skip,
            8 => Operation::Send(command::ADJUST_REGULATORS),
            9 => Operation::Await(Awaited::Regulator),
            index => match self.role {
                Role::Poller(receiver) => self.poller_operation(index, receiver, is_b),
                Role::Listener => self.listener_operation(index, is_b),
            },
        }
    }

    fn poller_operation(&self, index: u8, receiver: Receiver, is_b: bool) -> Operation {
        let [op, mode, rate] = self.role.configuration();
        let [main, timer, error, target] = reg::POLLER_MASKS;
        Operation::Send(match index {
            10 => write([reg::MODE, mode, rate]),
            11 => const { write([reg::NFC_F_PREAMBLE, reg::PREAMBLE_48]) },
            12 => const { write([reg::AUXILIARY, 0]) },
            13 => const { write([reg::NO_RESPONSE_TIMER, 0, 0]) },
            14 if is_b => const { write([reg::TRANSMIT_DRIVER, reg::TRANSMIT_DRIVER_12_PERCENT_B]) },
            14 => const { write([reg::TRANSMIT_DRIVER, reg::TRANSMIT_DRIVER_12_PERCENT_A]) },
            15 => write([reg::IRQ_MASK_MAIN, main, timer, error, target]),
            16 => write([reg::OPERATION_CONTROL, op]),
            17 => match receiver {
                Receiver::Off => return Operation::Skip,
                Receiver::OnMasked => command::MASK_RECEIVE_DATA,
            },
            18 => return Operation::Verify,
            _ => return Operation::End,
        })
    }

    fn listener_operation(&self, index: u8, is_b: bool) -> Operation {
        let [op, mode, rate] = self.role.configuration();
        let [main, timer, error, target] = reg::LISTENER_MASKS;
        Operation::Send(match index {
            10 => const { write([reg::PASSIVE_TARGET, reg::PASSIVE_TARGET_SILENT]) },
            11 => const { write([reg::PASSIVE_TARGET_MODULATION, reg::PASSIVE_TARGET_HIGH_Z]) },
            12 => {
                const {
                    Short::new([
                        command::SPACE_B,
                        command::WRITE | reg::B_AUXILIARY_MODULATION,
                        reg::NO_LOAD_MODULATION,
                    ])
                }
            }
            13 if is_b => const { write([reg::ANTENNA_TUNING, 0x00, 0x00]) },
            13 => const { write([reg::ANTENNA_TUNING, 0x00, 0xFF]) },
            14 => const { write([reg::MASK_RECEIVE_TIMER, reg::MASK_RECEIVE_SHORT]) },
            15 => write([reg::IRQ_MASK_MAIN, main, timer, error, target]),
            16 => write([reg::MODE, mode, rate]),
            17 => write([reg::OPERATION_CONTROL, op]),
            18 => command::CLEAR_FIFO,
            19 => command::UNMASK_RECEIVE_DATA,
            20 => return Operation::Verify,
            _ => return Operation::End,
        })
    }
}

/// A write of `N - 1` registers from the first byte's address on.
const fn write<const N: usize>(bytes: [u8; N]) -> Short {
    Short::new(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_operations_in_a_row_are_skipped() {
        for role in [Role::Poller(Receiver::Off), Role::Poller(Receiver::OnMasked), Role::Listener] {
            for variant in [Variant::A, Variant::B] {
                let mut list = BringUp::new(role, Supply::Volts5);
                list.variant = Some(variant);
                let mut skipped = false;
                for index in 0..=21 {
                    list.index = index;
                    let skip = matches!(list.operation(), Operation::Skip);
                    assert!(!(skip && skipped), "{role:?} {variant:?} at {index}");
                    skipped = skip;
                }
            }
        }
    }

    #[test]
    fn back_off_doubles_from_1_ms_and_stays_at_64_ms() {
        let mut list = BringUp::new(Role::Listener, Supply::Volts5);
        for micros in [1_000, 2_000, 4_000, 8_000, 16_000, 32_000, 64_000, 64_000, 64_000] {
            list.failed();
            assert_eq!(list.back_off(), micros);
        }
        list.works();
        list.failed();
        assert_eq!(list.back_off(), 1_000);
    }
}
