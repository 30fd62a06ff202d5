//! Status words as typed bit sets.
//!
//! Undefined bits are sent as 0 and ignored when received, so that a later version can define them. A reserved code is
//! read as `None`.

/// The type of a receiver's fix: `fixType` of UBX-NAV-PVT.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum FixType {
    /// No fix.
    NoFix = 0,
    /// Dead reckoning only.
    DeadReckoning = 1,
    /// Two-dimensional fix.
    Fix2D = 2,
    /// Three-dimensional fix.
    Fix3D = 3,
    /// GNSS and dead reckoning combined.
    GnssDeadReckoning = 4,
    /// Time only.
    TimeOnly = 5,
}

impl FixType {
    /// The fix type with this UBX code; `None` for a reserved code.
    #[must_use]
    pub const fn from_ubx(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::NoFix),
            1 => Some(Self::DeadReckoning),
            2 => Some(Self::Fix2D),
            3 => Some(Self::Fix3D),
            4 => Some(Self::GnssDeadReckoning),
            5 => Some(Self::TimeOnly),
            _ => None,
        }
    }

    const fn bits(self) -> u16 {
        match self {
            Self::NoFix => 0,
            Self::DeadReckoning => 1,
            Self::Fix2D => 2,
            Self::Fix3D => 3,
            Self::GnssDeadReckoning => 4,
            Self::TimeOnly => 5,
        }
    }
}

/// The state that HORUS reports about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum HorusState {
    /// Starting: there has been no position since HORUS's start.
    Starting = 0,
    /// Monitoring: there is a position now.
    Monitoring = 1,
    /// The position is outside the flight range.
    OutsideRange = 2,
    /// HORUS has switched to the redundant flight controller.
    SwitchedToRedundant = 3,
    /// HORUS has cut the motors.
    MotorsCut = 4,
    /// HORUS has fired the emergency measure.
    EmergencyFired = 5,
    /// HORUS's state inputs contradict each other, and no more severe state is known.
    InputsContradict = 6,
    /// There was a position since HORUS's start, but there is none now.
    PositionLost = 7,
}

impl HorusState {
    const fn from_bits(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Starting),
            1 => Some(Self::Monitoring),
            2 => Some(Self::OutsideRange),
            3 => Some(Self::SwitchedToRedundant),
            4 => Some(Self::MotorsCut),
            5 => Some(Self::EmergencyFired),
            6 => Some(Self::InputsContradict),
            7 => Some(Self::PositionLost),
            _ => None,
        }
    }

    const fn bits(self) -> u16 {
        match self {
            Self::Starting => 0,
            Self::Monitoring => 1,
            Self::OutsideRange => 2,
            Self::SwitchedToRedundant => 3,
            Self::MotorsCut => 4,
            Self::EmergencyFired => 5,
            Self::InputsContradict => 6,
            Self::PositionLost => 7,
        }
    }
}

/// The reason why a processor last started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ResetReason {
    /// The processor's supply came on.
    #[default]
    PowerOn = 0,
    /// The processor's reset pin was low.
    Pin = 1,
    /// The processor's watchdog was not fed.
    Watchdog = 2,
    /// The processor locked up: a fault occurred while it handled a fault.
    Lockup = 3,
    /// Software or a debugger requested the reset.
    Software = 4,
    /// The supply dipped, or the reset had a cause that has no code of its own.
    BrownOutOrOther = 5,
}

impl ResetReason {
    /// Whether the reset was unintended: any but power-on, pin and software.
    #[must_use]
    pub const fn is_unasked(self) -> bool {
        matches!(self, Self::Watchdog | Self::Lockup | Self::BrownOutOrOther)
    }

    pub(crate) const fn from_bits(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::PowerOn),
            1 => Some(Self::Pin),
            2 => Some(Self::Watchdog),
            3 => Some(Self::Lockup),
            4 => Some(Self::Software),
            5 => Some(Self::BrownOutOrOther),
            _ => None,
        }
    }

    pub(crate) const fn bits(self) -> u16 {
        match self {
            Self::PowerOn => 0,
            Self::Pin => 1,
            Self::Watchdog => 2,
            Self::Lockup => 3,
            Self::Software => 4,
            Self::BrownOutOrOther => 5,
        }
    }
}

macro_rules! bit_set {
    (
        $(#[$doc:meta])* $name:ident, used $used:literal;
        $($(#[$flag_doc:meta])* $get:ident, $with:ident = $bit:literal;)*
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $name(u16);

        impl $name {
            /// The bits that are defined.
            pub const USED: u16 = $used;

            /// The status word with no bit set.
            #[must_use]
            pub const fn new() -> Self {
                Self(0)
            }

            /// The status word from the wire, without undefined bits.
            #[must_use]
            pub const fn from_bits(bits: u16) -> Self {
                Self(bits & Self::USED)
            }

            /// The status word for the wire. Undefined bits are 0.
            #[must_use]
            pub const fn bits(self) -> u16 {
                self.0
            }

            const fn with(self, mask: u16, bits: u16) -> Self {
                Self(self.0 & !mask | bits & mask)
            }

            $(
                $(#[$flag_doc])*
                #[must_use]
                pub const fn $get(self) -> bool {
                    self.0 & (1 << $bit) != 0
                }

                /// Returns this status with the bit set to `on`. The getter of the same name says what the bit means.
                #[must_use]
                pub const fn $with(self, on: bool) -> Self {
                    self.with(1 << $bit, if on { 1 << $bit } else { 0 })
                }
            )*
        }
    };
}

pub(crate) use bit_set;

bit_set! {
    /// The status of a GPS object.
    GpsStatus, used 0xFFFF;
    /// Bit 4: latitude and longitude are valid, and so is the altitude unless it is NaN, as in a 2D fix.
    position_valid, with_position_valid = 4;
    /// Bit 5: pitch, yaw and roll are valid.
    attitude_valid, with_attitude_valid = 5;
    /// Bit 6: the accelerations are valid.
    acceleration_valid, with_acceleration_valid = 6;
    /// Bit 7: an intact message came from the receiver within the last 250 ms.
    heard, with_heard = 7;
    /// Bit 8: the solution is older than the receiver's own sending period allows.
    stale, with_stale = 8;
    /// Bit 9: the voter excluded this receiver.
    excluded, with_excluded = 9;
}

impl GpsStatus {
    /// Bits 0-3: the type of the receiver's fix; `None` for a reserved code.
    #[must_use]
    pub const fn fix_type(self) -> Option<FixType> {
        let [low, _] = self.0.to_le_bytes();
        FixType::from_ubx(low & 0x0F)
    }

    /// This status with bits 0-3 set to `fix`.
    #[must_use]
    pub const fn with_fix_type(self, fix: FixType) -> Self {
        self.with(0x000F, fix.bits())
    }

    /// The step of [`solution_age_ms`](Self::solution_age_ms), ms.
    pub const AGE_STEP_MS: u16 = 25;
    /// The greatest [`solution_age_ms`](Self::solution_age_ms), ms, which also stands for every greater age.
    pub const OLDEST_MS: u16 = 62 * Self::AGE_STEP_MS;
    const AGE: u16 = 0xFC00;
    const NEVER: u16 = 63;

    /// Bits 10-15: the age of the receiver's solution at the tick, ms; `None` if there was none since HORUS's start.
    ///
    /// The age is the time from the arrival at HORUS of the newest NAV-PVT message with a new time of week, valid or
    /// not, to the tick. It is rounded down to [`AGE_STEP_MS`](Self::AGE_STEP_MS) and saturates at
    /// [`OLDEST_MS`](Self::OLDEST_MS). The epoch of the solution is 40 to 80 ms before its arrival: the receiver's time
    /// for computing and sending it.
    #[must_use]
    pub const fn solution_age_ms(self) -> Option<u16> {
        match (self.0 & Self::AGE) >> 10 {
            Self::NEVER => None,
            steps => Some(steps * Self::AGE_STEP_MS),
        }
    }

    /// This status with bits 10-15 set to a solution's age, ms, or to `None` for no solution; see
    /// [`solution_age_ms`](Self::solution_age_ms).
    #[must_use]
    pub const fn with_solution_age_ms(self, age_ms: Option<u32>) -> Self {
        const STEP_MS: u32 = 25;
        const OLDEST_MS: u32 = 62 * STEP_MS;
        let steps: u32 = match age_ms {
            None => 63,
            // `min` has no branch, so that the time for filling a profile does not depend on a solution's age.
            Some(age_ms) => (if age_ms < OLDEST_MS { age_ms } else { OLDEST_MS }) / STEP_MS,
        };
        let [steps, ..] = steps.to_le_bytes();
        self.with(Self::AGE, u16::from_le_bytes([0, steps << 2]))
    }
}

bit_set! {
    /// The status of Reported-Position.
    ReportedStatus, used 0xFFFF;
    /// Bit 3: latitude and longitude are valid, and so is the altitude unless it is NaN, as in a 2D fix.
    position_valid, with_position_valid = 3;
    /// Bit 4: pitch, yaw and roll are valid.
    attitude_valid, with_attitude_valid = 4;
    /// Bit 5: the accelerations are valid.
    acceleration_valid, with_acceleration_valid = 5;
    /// Bit 6: fewer receivers agree than are configured, or too few of them have an altitude, so Reported-Position has
    /// none.
    degraded, with_degraded = 6;
    /// Bit 7: HORUS runs on its internal oscillator, because its crystal's clock is missing. The oscillator is trimmed
    /// to 1 % at 25 °C and deviates more over temperature (DS9405), and so does the length of HORUS's cycle. The DPR
    /// detects a deviation of more than 2 %.
    without_crystal, with_without_crystal = 7;
    /// Bit 12: flash, code or RAM did not hold the written contents. HORUS has found this since its start, or stopped
    /// because of it before that start.
    memory_fault, with_memory_fault = 12;
}

impl ReportedStatus {
    /// Bits 0-2: the number of agreeing receivers, 0 to 7.
    #[must_use]
    pub const fn receivers_agreeing(self) -> u8 {
        let [low, _] = self.0.to_le_bytes();
        low & 0x07
    }

    /// This status with bits 0-2 set to `receivers`, at most 7.
    #[must_use]
    pub const fn with_receivers_agreeing(self, receivers: u8) -> Self {
        let receivers = match receivers {
            0..=7 => receivers,
            _ => 7,
        };
        self.with(0x0007, u16::from_le_bytes([receivers, 0]))
    }

    /// Bits 8-11: HORUS's state; `None` for a reserved code.
    #[must_use]
    pub const fn state(self) -> Option<HorusState> {
        let [_, high] = self.0.to_le_bytes();
        HorusState::from_bits(high & 0x0F)
    }

    /// This status with bits 8-11 set to `state`.
    #[must_use]
    pub const fn with_state(self, state: HorusState) -> Self {
        self.with(0x0F00, state.bits() << 8)
    }

    /// Bits 13-15: the reason of HORUS's last start; `None` for a reserved code.
    #[must_use]
    pub const fn reset_reason(self) -> Option<ResetReason> {
        let [_, high] = self.0.to_le_bytes();
        ResetReason::from_bits(high >> 5)
    }

    /// This status with bits 13-15 set to `reason`.
    #[must_use]
    pub const fn with_reset_reason(self, reason: ResetReason) -> Self {
        self.with(0xE000, reason.bits() << 13)
    }
}

bit_set! {
    /// The status of Link-Status.
    LinkStatusBits, used 0xF7FF;
    /// Bit 0: HORUS's frames arrive within their deadline.
    link_up, with_link_up = 0;
    /// Bit 1: every object of the last cycle was accepted.
    all_accepted, with_all_accepted = 1;
    /// Bit 2: HORUS repeats its timestamp.
    horus_frozen, with_horus_frozen = 2;
    /// Bit 3: HORUS started again.
    horus_restarted, with_horus_restarted = 3;
    /// Bit 4: a scrub found a RAM fault.
    ram_fault, with_ram_fault = 4;
    /// Bit 5: the RFID front end has a fault, or receives nothing for 0.5 s although it detects HORUS's field.
    front_end_fault, with_front_end_fault = 5;
    /// Bit 6: the DPR's last reset was unintended; see [`LinkStatusBits::reset_reason`].
    unasked_reset, with_unasked_reset = 6;
    /// Bit 7: the last uplink was rejected.
    uplink_rejected, with_uplink_rejected = 7;
    /// Bit 8: HORUS's timestamps are out of sequence. Its objects are not shown until the sequence is found again.
    out_of_sequence, with_out_of_sequence = 8;
    /// Bit 9: cycles are in sequence, but over the last second HORUS's clock differed from the DPR's by more than 2 %.
    horus_clock_implausible, with_horus_clock_implausible = 9;
    /// Bit 10: the DPR's program memory does not have the CRC that the build stored in it.
    flash_fault, with_flash_fault = 10;
    /// Bit 15: the RFID front end works and detects no field of HORUS. If bit 5 is set, the field is unknown.
    no_field, with_no_field = 15;
}

bit_set! {
    /// The status of Port-Status.
    PortStatusBits, used 0xFFFF;
    /// Bit 0: the base station's uplink is fresh and shown.
    base_station_fresh, with_base_station_fresh = 0;
    /// Bit 1: the flight controller's uplink is fresh and shown.
    flight_controller_fresh, with_flight_controller_fresh = 1;
    /// Bit 2: the last received uplink or command was refused.
    last_refused, with_last_refused = 2;
    /// Bit 3: a self-test is under way.
    self_test_running, with_self_test_running = 3;
    /// Bit 4: the last finished self-test found no fault.
    self_test_passed, with_self_test_passed = 4;
    /// Bit 5: the last finished self-test found a fault.
    self_test_failed, with_self_test_failed = 5;
    /// Bit 6: fewer than three receive buffers, or fewer than four images, are in use.
    buffers_out_of_use, with_buffers_out_of_use = 6;
    /// Bit 7: a frame came from the [hold](crate::hold) within the last 300 ms, accepted or not. Without a hold, bits 7
    /// to 15 are clear.
    hold_heard, with_hold_heard = 7;
    /// Bit 8: the last frame from the hold was accepted.
    hold_accepted, with_hold_accepted = 8;
}

impl PortStatusBits {
    /// Bits 9-12: the number of the hold's objects that were accepted since the DPR's start, modulo 16.
    #[must_use]
    pub const fn hold_objects_accepted(self) -> u8 {
        let [count, _] = (self.0 >> 9 & 0x0F).to_le_bytes();
        count
    }

    /// Bits 13-15: the number of the hold's frames that were rejected since the DPR's start, modulo 8.
    #[must_use]
    pub const fn hold_objects_rejected(self) -> u8 {
        let [count, _] = (self.0 >> 13).to_le_bytes();
        count
    }

    /// This status with bits 9-12 set to `accepted` modulo 16, and bits 13-15 to `rejected` modulo 8.
    #[must_use]
    pub const fn with_hold_counts(self, accepted: u32, rejected: u32) -> Self {
        let ([accepted, ..], [rejected, ..]) = (accepted.to_le_bytes(), rejected.to_le_bytes());
        let (accepted, rejected) = (u16::from_le_bytes([accepted, 0]), u16::from_le_bytes([rejected, 0]));
        self.with(0x1E00, accepted << 9).with(0xE000, rejected << 13)
    }
}

impl LinkStatusBits {
    /// Bits 12-14: the reason of the DPR's last start; `None` for a reserved code.
    #[must_use]
    pub const fn reset_reason(self) -> Option<ResetReason> {
        let [_, high] = self.0.to_le_bytes();
        ResetReason::from_bits(high >> 4 & 0x07)
    }

    /// This status with bits 12-14 set to `reason`, and bit 6 set if such a reset is unintended.
    #[must_use]
    pub const fn with_reset_reason(self, reason: ResetReason) -> Self {
        self.with(0x7000, reason.bits() << 12).with_unasked_reset(reason.is_unasked())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_reads_back_as_written_and_a_reserved_one_as_none() {
        let fixes = (0..=0xF).map(|code| GpsStatus::from_bits(0xFFF0 | code).fix_type());
        let states = (0..=0xF).map(|code| ReportedStatus::from_bits(0xF0FF | code << 8).state());
        let reasons = (0..=7).map(|code| LinkStatusBits::from_bits(0x07FF | code << 12).reset_reason());
        for (code, fix) in (0..).zip(fixes) {
            assert_eq!(fix.map(FixType::bits), (code <= 5).then_some(code));
            let written = fix.map_or(GpsStatus::new(), |fix| GpsStatus::from_bits(0xFFFF).with_fix_type(fix));
            assert_eq!(written.bits(), if code <= 5 { 0xFFF0 | code } else { 0 });
        }
        for (code, state) in (0..).zip(states) {
            assert_eq!(state.map(HorusState::bits), (code <= 7).then_some(code));
            let written =
                state.map_or(ReportedStatus::new(), |state| ReportedStatus::from_bits(0xFFFF).with_state(state));
            assert_eq!(written.bits(), if code <= 7 { 0xF0FF | code << 8 } else { 0 });
        }
        for (code, reason) in (0..).zip(reasons) {
            assert_eq!(reason.map(ResetReason::bits), (code <= 5).then_some(code));
            let Some(reason) = reason else { continue };
            let unasked = [2, 3, 5].contains(&code);
            assert_eq!(reason.is_unasked(), unasked);
            let written = LinkStatusBits::from_bits(0xF7FF).with_reset_reason(reason).bits();
            assert_eq!(written, 0x87BF | u16::from(unasked) << 6 | code << 12);
            let horus = ReportedStatus::from_bits(0xFFFF).with_reset_reason(reason);
            assert_eq!((horus.bits(), horus.reset_reason()), (0x1FFF | code << 13, Some(reason)));
        }
        assert_eq!(ReportedStatus::from_bits(0xDFFF).reset_reason(), None, "reserved");
    }

    #[test]
    fn an_age_is_told_in_steps_up_to_1550_ms() {
        let told = |age: Option<u32>| {
            let status = GpsStatus::from_bits(0x03FF).with_solution_age_ms(age);
            assert_eq!(status.bits() & 0x03FF, 0x03FF, "no other bit changes");
            (status.bits() >> 10, status.solution_age_ms())
        };
        for (age, code, ms) in [(0, 0, 0), (24, 0, 0), (25, 1, 25), (1_549, 61, 1_525), (1_550, 62, 1_550)] {
            assert_eq!(told(Some(age)), (code, Some(ms)), "{age} ms");
        }
        assert_eq!(told(Some(u32::MAX)), (62, Some(1_550)));
        assert_eq!(told(Some(65_536)), (62, Some(1_550)), "what does not fit 16 bits is old, not young");
        assert_eq!(told(None), (63, None));
    }

    #[test]
    fn more_than_seven_receivers_that_agree_are_shown_as_seven() {
        for receivers in 0..=u8::MAX {
            let status = ReportedStatus::from_bits(0xFFFF).with_receivers_agreeing(receivers);
            assert_eq!(status.receivers_agreeing(), receivers.min(7));
            assert_eq!(status.bits() & !0x0007, 0xFFF8);
        }
    }
}
