//! Status words as typed bit sets.
//!
//! Bits without a meaning are sent 0 and ignored when received, so that a later version can give them one: the types here
//! hold only bits that have a meaning. A code that is reserved today reads as `None`.

/// UBX-NAV-PVT `fixType`.
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
    /// The type that UBX codes so; `None` for a code that UBX reserves.
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

/// What HORUS is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum HorusState {
    /// Starting: not yet monitoring.
    Starting = 0,
    /// Monitoring the flight range.
    Monitoring = 1,
    /// The position is outside the flight range.
    OutsideRange = 2,
    /// Switched to the redundant flight controller.
    SwitchedToRedundant = 3,
    /// Motors cut.
    MotorsCut = 4,
    /// Emergency measure fired.
    EmergencyFired = 5,
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
            /// The bits that have a meaning.
            pub const USED: u16 = $used;

            /// Nothing set.
            #[must_use]
            pub const fn new() -> Self {
                Self(0)
            }

            /// From the wire; bits without a meaning are dropped.
            #[must_use]
            pub const fn from_bits(bits: u16) -> Self {
                Self(bits & Self::USED)
            }

            /// As on the wire; bits without a meaning are 0.
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

                /// This status with that bit set to `on`; see the getter of the same name.
                #[must_use]
                pub const fn $with(self, on: bool) -> Self {
                    self.with(1 << $bit, if on { 1 << $bit } else { 0 })
                }
            )*
        }
    };
}

bit_set! {
    /// Status of a GPS object.
    GpsStatus, used 0x03FF;
    /// Bit 4: latitude, longitude and altitude are valid.
    position_valid, with_position_valid = 4;
    /// Bit 5: pitch, yaw and roll are valid.
    attitude_valid, with_attitude_valid = 5;
    /// Bit 6: the accelerations are valid.
    acceleration_valid, with_acceleration_valid = 6;
    /// Bit 7: the receiver was heard in the last 250 ms.
    heard, with_heard = 7;
    /// Bit 8: the solution is older than the receiver's own period allows.
    stale, with_stale = 8;
    /// Bit 9: the voter excluded this receiver.
    excluded, with_excluded = 9;
}

impl GpsStatus {
    /// Bits 0-3: the receiver's fix; `None` for a code that UBX reserves.
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
}

bit_set! {
    /// Status of Reported-Position.
    ReportedStatus, used 0x0F7F;
    /// Bit 3: latitude, longitude and altitude are valid.
    position_valid, with_position_valid = 3;
    /// Bit 4: pitch, yaw and roll are valid.
    attitude_valid, with_attitude_valid = 4;
    /// Bit 5: the accelerations are valid.
    acceleration_valid, with_acceleration_valid = 5;
    /// Bit 6: fewer receivers agree than are configured.
    degraded, with_degraded = 6;
}

impl ReportedStatus {
    /// Bits 0-2: how many receivers agree, 0 to 7.
    #[must_use]
    pub const fn receivers_agreeing(self) -> u8 {
        let [low, _] = self.0.to_le_bytes();
        low & 0x07
    }

    /// This status with bits 0-2 set to `receivers`, at most 7.
    #[must_use]
    pub const fn with_receivers_agreeing(self, receivers: u8) -> Self {
        let receivers = if receivers > 7 { 7 } else { receivers };
        self.with(0x0007, u16::from_le_bytes([receivers, 0]))
    }

    /// Bits 8-11: what HORUS is doing; `None` for a reserved code.
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
}

bit_set! {
    /// Status of Link-Status.
    LinkStatusBits, used 0x00FF;
    /// Bit 0: frames arrive within their deadline.
    link_up, with_link_up = 0;
    /// Bit 1: every object of the last cycle was accepted.
    all_accepted, with_all_accepted = 1;
    /// Bit 2: HORUS repeats its timestamp.
    horus_frozen, with_horus_frozen = 2;
    /// Bit 3: HORUS started again.
    horus_restarted, with_horus_restarted = 3;
    /// Bit 4: a scrub found a RAM fault.
    ram_fault, with_ram_fault = 4;
    /// Bit 5: the RFID front end has a fault.
    front_end_fault, with_front_end_fault = 5;
    /// Bit 6: the DPR's last reset was its watchdog's.
    watchdog_reset, with_watchdog_reset = 6;
    /// Bit 7: the last uplink was rejected.
    uplink_rejected, with_uplink_rejected = 7;
}
