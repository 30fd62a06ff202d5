//! The contents of this project's own hold: climate and vibration of a payload. They are an example that other makers
//! replace.
use core::mem::offset_of;

use bytemuck::{Pod, Zeroable};

use super::{Acknowledged, HoldObject, Words, object::WireAcknowledged};
use crate::{
    ABSENT_F32, Identifier, Rejection, ResetReason,
    criticality::{MayWrite, Writer, object},
    object_macro::object,
    status::bit_set,
    wire::{CrcBe, F32Le, U16Le, U32Le},
};

/// A command to the hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HoldCommand {
    /// Changes the set-point of the temperature, °C. The hold refuses NaN and a set-point outside its own limits.
    SetPoint(f32),
    /// Locks the hold.
    Lock,
    /// Unlocks the hold.
    Unlock,
    /// Sets the greatest shock that Hold-Status reports to 0.
    ClearShock,
}

impl Words for HoldCommand {
    fn encode(&self) -> (u16, f32) {
        match *self {
            Self::SetPoint(celsius) => (1, celsius),
            Self::Lock => (2, 0.0),
            Self::Unlock => (3, 0.0),
            Self::ClearShock => (4, 0.0),
        }
    }

    fn decode(word: u16, value: f32) -> Option<Self> {
        match word {
            1 => Some(Self::SetPoint(value)),
            2 => Some(Self::Lock),
            3 => Some(Self::Unlock),
            4 => Some(Self::ClearShock),
            _ => None,
        }
    }
}

bit_set! {
    /// The status word of Hold-Status.
    HoldStatusBits, used 0x01FF;
    /// Bit 0: the values are valid. A value that is not known is still NaN.
    values_valid, with_values_valid = 0;
    /// Bit 1: the values are within the hold's limits.
    within_limits, with_within_limits = 1;
    /// Bit 2: the hold is locked.
    locked, with_locked = 2;
    /// Bit 3: a sensor does not answer, or reports an impossible value.
    sensor_fault, with_sensor_fault = 3;
    /// Bit 4: the hold found a fault of its flash or of its RAM.
    memory_fault, with_memory_fault = 4;
    /// Bit 5: the hold is in its safe state: the output is off, and the lock stays as it is.
    safe_state, with_safe_state = 5;
}

impl HoldStatusBits {
    /// Bits 6-8: the reason of the hold's last start; `None` for a code that has no meaning yet.
    #[must_use]
    pub const fn reset_reason(self) -> Option<ResetReason> {
        let [code, _] = (self.0 >> 6 & 0x07).to_le_bytes();
        ResetReason::from_bits(code)
    }

    /// This status with bits 6-8 set to `reason`.
    #[must_use]
    pub const fn with_reset_reason(self, reason: ResetReason) -> Self {
        self.with(0x01C0, reason.bits() << 6)
    }
}

/// The contents of Hold-Status in plain numbers. A value that is not known is NaN ([`ABSENT_F32`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldValues {
    /// The timestamp, ms since the hold's start, wraps. It is one [period](super::PERIOD_MS) later in each object.
    pub timestamp: u32,
    /// The state of the hold.
    pub status: HoldStatusBits,
    /// The temperature, °C.
    pub temperature: f32,
    /// The relative humidity, %.
    pub humidity: f32,
    /// The set-point of the temperature, °C.
    pub set_point: f32,
    /// The root mean square of the vibration along x, y, z over the last second, m/s².
    pub vibration: [f32; 3],
    /// The greatest shock since the hold's start or the last [`HoldCommand::ClearShock`], m/s².
    pub greatest_shock: f32,
    /// The supply voltage, V.
    pub supply: f32,
    /// The output of the temperature control, -1 (cooling) to 1 (heating).
    pub output: f32,
    /// The acknowledgements of the last command of the base station and of the flight controller, in this order.
    pub acknowledged: [Acknowledged; 2],
    /// The time since the hold's start, s.
    pub seconds: u32,
}

impl HoldValues {
    /// The values of a starting hold at `timestamp`, ms: every value is NaN, every status bit clear, the output off.
    #[must_use]
    pub fn absent(timestamp: u32) -> Self {
        Self {
            timestamp,
            status: HoldStatusBits::new(),
            temperature: ABSENT_F32,
            humidity: ABSENT_F32,
            set_point: ABSENT_F32,
            vibration: [ABSENT_F32; 3],
            greatest_shock: ABSENT_F32,
            supply: ABSENT_F32,
            output: 0.0,
            acknowledged: [Acknowledged::default(); 2],
            seconds: 0,
        }
    }
}

/// A Hold-Status object of 64 bytes. The last four bytes are the frame CRC of the other 60.
///
/// | bytes | | bytes | |
/// |---|---|---|---|
/// | 0..4 | u32 timestamp of the hold, ms | 36..40 | f32 supply, V |
/// | 4..6 | u16 identifier, 0x4100 | 40..44 | f32 output, -1 to 1 |
/// | 6..8 | u16 [status](HoldStatusBits) | 44..46 | u16 number of the base station's last command |
/// | 8..12 | f32 temperature, °C | 46..48 | u16 its [outcome](super::Outcome) |
/// | 12..16 | f32 relative humidity, % | 48..52 | the same for the flight controller |
/// | 16..20 | f32 set-point, °C | 52..56 | u32 time since start, s |
/// | 20..32 | f32 vibration x, y, z, m/s² | 56..60 | zero |
/// | 32..36 | f32 greatest shock, m/s² | 60..64 | [frame CRC](crate::crc) over 0..60 |
#[derive(Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct HoldStatus {
    timestamp: U32Le,
    identifier: U16Le,
    status: U16Le,
    temperature: F32Le,
    humidity: F32Le,
    set_point: F32Le,
    vibration: [F32Le; 3],
    greatest_shock: F32Le,
    supply: F32Le,
    output: F32Le,
    acknowledged: [WireAcknowledged; 2],
    seconds: U32Le,
    reserved: [u8; 4],
    crc: CrcBe,
}

object!(HoldStatus, 64 bytes, status: HoldStatusBits, timestamp: "ms since the hold's start, wraps.", also shown: []);

const _: () = {
    assert!(HoldStatus::SIZE == HoldObject::SIZE);
    assert!(offset_of!(HoldStatus, temperature) == 8);
    assert!(offset_of!(HoldStatus, humidity) == 12);
    assert!(offset_of!(HoldStatus, set_point) == 16);
    assert!(offset_of!(HoldStatus, vibration) == 20);
    assert!(offset_of!(HoldStatus, greatest_shock) == 32);
    assert!(offset_of!(HoldStatus, supply) == 36);
    assert!(offset_of!(HoldStatus, output) == 40);
    assert!(offset_of!(HoldStatus, acknowledged) == HoldObject::ACKNOWLEDGED);
    assert!(offset_of!(HoldStatus, seconds) == 52);
    assert!(offset_of!(HoldStatus, reserved) == 56);
};

impl HoldStatus {
    /// Seals `values` in an object with its CRC.
    #[must_use]
    pub fn seal<W: MayWrite<object::Hold>>(_writer: Writer<W>, values: &HoldValues) -> Self {
        Self {
            timestamp: U32Le::new(values.timestamp),
            identifier: U16Le::new(Identifier::HOLD_STATUS.0),
            status: U16Le::new(values.status.bits()),
            temperature: F32Le::new(values.temperature),
            humidity: F32Le::new(values.humidity),
            set_point: F32Le::new(values.set_point),
            vibration: values.vibration.map(F32Le::new),
            greatest_shock: F32Le::new(values.greatest_shock),
            supply: F32Le::new(values.supply),
            output: F32Le::new(values.output),
            acknowledged: values.acknowledged.map(WireAcknowledged::new),
            seconds: U32Le::new(values.seconds),
            reserved: [0; 4],
            crc: CrcBe::UNSEALED,
        }
        .sealed()
    }

    /// The Hold-Status in `bytes`, if it is intact.
    ///
    /// # Errors
    ///
    /// [`Rejection::Length`] if `bytes` are not 64, [`Rejection::Crc`] if they are damaged, [`Rejection::Identifier`]
    /// if they are another object.
    pub fn verify(bytes: &[u8]) -> Result<&Self, Rejection> {
        let (object, findings) = Self::look(bytes)?;
        findings.check(object.identifier() == Identifier::HOLD_STATUS, Rejection::Identifier).judge(object)
    }

    /// This Hold-Status in the layout that all makers share.
    #[must_use]
    pub const fn as_object(&self) -> &HoldObject {
        bytemuck::must_cast_ref(self)
    }

    /// The contents of Hold-Status in plain numbers.
    #[must_use]
    pub fn values(&self) -> HoldValues {
        HoldValues {
            timestamp: self.timestamp.get(),
            status: self.status(),
            temperature: self.temperature.get(),
            humidity: self.humidity.get(),
            set_point: self.set_point.get(),
            vibration: self.vibration.map(F32Le::get),
            greatest_shock: self.greatest_shock.get(),
            supply: self.supply.get(),
            output: self.output.get(),
            acknowledged: self.acknowledged.map(WireAcknowledged::get),
            seconds: self.seconds.get(),
        }
    }
}
